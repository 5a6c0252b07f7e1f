"""The commands on measured prints: ``padgen bench``, ``padgen retune`` and ``padgen calibrate``."""

import argparse
import sys
from pathlib import Path
from typing import Any

from padgen.api.prints import (
    bench,
    calibrate,
    fit_touch,
    retune,
    save_printer,
    save_retuned,
    save_touch,
    simulate_print,
)
from padgen.cli.common import (
    DONE,
    add_model,
    add_option,
    add_shared,
    add_spec,
    answer,
    exit_code_of,
    folder_of,
    plan_of,
    progress_line,
    show,
)
from padgen.core.errors import EngineMissingError, FileError, SolverError, SpecError, plain, plural
from padgen.core.rules import Rule, refuse

__all__ = ["add_bench", "add_calibrate", "add_retune"]

MOST_TRIES = 20


def add_retune(commands: Any) -> None:
    """Declare ``padgen retune`` and its options."""
    parser = commands.add_parser(
        "retune",
        help="fit what a print was measured to be, and re-tune tones and levels to it",
        description="Fit resonance, Q and level of every taxel that was measured, and write the tones that suit the"
        " print: tuning.json (for padgen drive --tuning), drive-tuned.csv, retune.json; and tuning.png, the data with"
        " their fits, which is also written where a taxel cannot be fitted.",
    )
    add_spec(parser)
    parser.add_argument(
        "measured",
        metavar="MEASURED",
        nargs="*",
        help="a CSV (resonances, spectra or time series) or a WAV (the coil's current in the first channel, then the"
        " sensor; or a pluck alone); or several or a folder of them, each named after its taxel, as r0c1k0.wav, or"
        " coil, as r0c1.wav",
    )
    add_option(parser, retune, "coupon", metavar="FILE")
    add_option(parser, fit_touch, "touched", metavar="FILE", nargs="+", default=None)
    add_option(parser, retune, "estimate_rest")
    add_option(parser, retune, "nearest")
    add_option(parser, retune, "excitation", metavar="current|voltage")
    add_option(parser, retune, "sensor", metavar="displacement|velocity|acceleration")
    add_option(parser, simulate_print, "seed", "--simulate", metavar="SEED", type=int)
    add_option(parser, simulate_print, "kind", metavar="spectrum|chirp|pluck")
    add_option(parser, simulate_print, "snr_db", "--snr", metavar="DB", type=float)
    add_shared(parser, _retune, "all notes, and more taxels", late="measured")


def _retune(options: argparse.Namespace) -> int:
    simulated = None
    needs = "needs MEASURED, too, the same taxels untouched; --simulate makes no fingers"
    refuse(Rule(options.touched is None or bool(options.measured), "--touched", needs))
    is_one = bool(options.measured) != (options.simulate is not None)
    refuse(Rule(is_one, "padgen retune", "needs MEASURED, a file or a folder, or --simulate SEED, and not both"))
    if options.touched is not None:
        return _touched(options)
    with progress_line() as progress:
        plan = plan_of(options, progress)
        if options.simulate is not None:
            progress("printing and measuring a pad")
            simulated = simulate_print(plan, options.simulate, kind=options.kind, snr_db=options.snr)
        written = save_retuned(
            plan,
            folder_of(options, plan.name),
            options.measured,
            simulated,
            excitation=options.excitation,
            sensor=options.sensor,
            nearest=options.nearest,
            estimate_rest=options.estimate_rest,
            coupon=options.coupon,
            progress=progress,
        )
    return _tell(options, plan, written)


def _touched(options: argparse.Namespace) -> int:
    """Run ``padgen retune --touched``: fit a finger's stiffness, damping and mass; write them as a spec's table."""
    with progress_line() as progress:
        plan = plan_of(options, progress)
        progress("fitting the finger")
        finger = fit_touch(
            plan,
            options.measured,
            options.touched,
            excitation=options.excitation,
            sensor=options.sensor,
            nearest=options.nearest,
        )
        folder = folder_of(options, plan.name)
        files = save_touch(plan, finger, folder)
    mass = "measured" if finger.mass_is_measured else "taken as typical"
    summary = (
        f"the finger under {finger.diameter_mm:g} mm: {finger.k_n_per_m:.4g} ± {finger.k_error_n_per_m:.2g} N/m,"
        f" {finger.c_n_s_per_m:.3g} ± {finger.c_error_n_s_per_m:.2g} N s/m, {finger.m_g:.2g} ± {finger.m_error_g:.1g} g"
        f" ({mass}); {len(finger.taxels)} taxel{plural(len(finger.taxels))}"
    )
    place = plain(str(folder))
    use = f"written to {place}: {', '.join(files)}; put the [touch] of touch.toml into the spec to plan for this finger"
    answer(options, finger, summary, use)
    return DONE


def _tell(options: argparse.Namespace, plan: Any, written: Any) -> int:
    """Print the results and files of a re-tuned print, and return the exit code."""
    from padgen.report.results import retuned_text

    place = plain(str(written.folder))
    answer(
        options,
        written.table(),
        retuned_text(plan, written.result, options.verbose),
        f"written to {place}: {', '.join(written.files)}",
        f"next: padgen drive {plain(options.spec)} --tuning {place}/tuning.json --state all --hear",
    )
    return exit_code_of(written.result.findings)


def add_bench(commands: Any) -> None:
    """Declare ``padgen bench`` and its options."""
    parser = commands.add_parser(
        "bench",
        help="measure a print at the bench, taxel by taxel, and re-tune tones and levels to it",
        description="Shake every taxel in turn, through a sound card or a microcontroller with the firmware, record it"
        " by a sensor at an input of a sound card, fit it at once, and write what padgen retune writes. What is"
        " recorded is kept in the folder; the same command goes on where it was stopped. Needs the extra padgen[play].",
    )
    add_spec(parser)
    where = parser.add_mutually_exclusive_group()
    add_option(where, bench, "device", metavar="NAME")
    add_option(where, bench, "port", metavar="PORT")
    add_option(parser, bench, "record", metavar="NAME")
    parser.add_argument("--coils", action="store_true", help="the sensor hears all taxels of a coil: record by coil")
    parser.add_argument("--tries", metavar="N", type=int, default=3, help="most recordings of one taxel (default: 3)")
    add_option(parser, bench, "rate_hz", "--rate", metavar="HZ", type=int)
    add_option(parser, bench, "baud", metavar="N", type=int)
    add_option(parser, bench, "tuning", metavar="FILE")
    add_option(parser, retune, "nearest")
    add_shared(parser, _bench, "all notes, and more taxels")


def _bench(options: argparse.Namespace) -> int:
    for name, most in (("tries", MOST_TRIES), ("baud", 10**8), ("rate", 10**7)):
        value = getattr(options, name)
        refuse(Rule(value is None or 1 <= value <= most, f"--{name}", f"must be 1 … {most}, got {value}"))
    with progress_line() as progress:
        plan = plan_of(options, progress)
    folder = folder_of(options, plan.name)
    session = bench(
        plan,
        folder,
        device=options.device,
        record=options.record,
        rate_hz=options.rate,
        port=options.port,
        baud=options.baud,
        tuning=options.tuning,
    )
    if session.sink and session.by_hand and not _is_interactive():
        raise SpecError(
            f"{session.sink.name} has {session.sink.channels} output channels for"
            f" {plan.coils.rows * plan.coils.columns} coils; run this in a terminal, which asks to connect one coil"
            " after the other to output 1",
            "--device",
        )
    names = session.names(options.coils)
    left = [name for name in names if not session.is_kept(name)]
    if len(left) < len(names):
        _say(options, f"{len(names) - len(left)} of {len(names)} were recorded before, and are kept")
    try:
        for name in left:
            _measure(options, session, name)
    except (KeyboardInterrupt, EOFError) as error:
        kept = sum(map(session.is_kept, names))
        summary = f"stopped with {kept} of {len(names)} recorded; the same command goes on with the others"
        raise FileError(summary, str(folder)) from error
    if not any(map(session.is_kept, names)):
        raise FileError("has no recording that shows a resonance; nothing is re-tuned", str(session.recordings))
    with progress_line() as progress:
        written = save_retuned(plan, folder, [session.recordings], nearest=options.nearest, progress=progress)
    return _tell(options, plan, written)


def _measure(options: argparse.Namespace, session: Any, name: str) -> None:
    """Record and fit a taxel, or all taxels over a coil, with retries; print one line per taxel, fitted or missing."""
    for attempt in range(options.tries):
        if not _is_ready(session, name, attempt):
            _say(options, f"{name}: left out")
            return
        try:
            with progress_line() as progress:
                fits = session.take(name, attempt, options.nearest, progress)
        except SolverError as error:
            if isinstance(error, EngineMissingError):
                raise
            again = "once more" if attempt + 1 < options.tries else "it is left out"
            _say(options, f"{name}: {error.message}; {again}")
            continue
        for fit in fits:
            _say(
                options,
                f"{fit.id}  {fit.resonance_hz:.2f} ± {fit.resonance_error_hz:.1g} Hz,"
                f" Q {fit.q:.1f} ± {fit.q_error:.1g}",
            )
        due = (taxel.id for taxel in session.plan.taxels if name in (taxel.id, taxel.id.partition("k")[0]))
        for missing in sorted(set(due) - {fit.id for fit in fits}):
            _say(options, f"{missing}: not heard, and keeps the plan's tone; a sensor nearer to it may hear it")
        return


def _is_interactive() -> bool:
    """Tell whether standard input is a terminal, so that the user can be asked."""
    return sys.stdin is not None and sys.stdin.isatty()


def _is_ready(session: Any, name: str, attempt: int) -> bool:
    """Ask at a terminal whether sensor and coil are in place; without a terminal return True."""
    if not _is_interactive():
        return True
    coil = name.partition("k")[0]
    wired = f"coil {coil} at output 1, " if session.by_hand else ""
    sensor = f"where all taxels of {name} are heard" if name == coil else f"at {name}"
    repeats = "repeats" if attempt else "records"
    print(f"{wired}sensor {sensor}: Enter {repeats}, s leaves it out ", end="", file=sys.stderr, flush=True)
    return input().strip().lower() != "s"


def _say(options: argparse.Namespace, text: str) -> None:
    """Print a line for the user and flush it: to standard error with ``--json``, else to standard output."""
    stream = sys.stderr if options.json else sys.stdout
    show(text, stream)
    stream.flush()


def add_calibrate(commands: Any) -> None:
    """Declare ``padgen calibrate`` and its options."""
    parser = commands.add_parser(
        "calibrate",
        help="find a printer's offsets and a material's modulus from measured prints",
        description="Fit how much thicker and wider a printer makes beams, and the modulus, to measured prints of SPEC;"
        ' a spec that says printer = "my-printer.toml" is then planned for that printer.',
    )
    add_spec(parser)
    parser.add_argument(
        "measured",
        metavar="MEASURED",
        nargs="+",
        help="what was measured, one for each print: a CSV, a WAV, or a folder of them",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        default="my-printer.toml",
        help="the printer's file that is written (default: my-printer.toml)",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    add_model(parser, in_folder=False)
    parser.set_defaults(command=_calibrate)


def _calibrate(options: argparse.Namespace) -> int:
    path = Path(options.output)
    kind = f"must be a file of the kind my-printer.toml, got {options.output!r}"
    refuse(Rule(path.suffix == ".toml", "--output", kind))
    with progress_line() as progress:
        plan = plan_of(options, progress, recorded=False)
        progress("fitting")
        calibration = calibrate(plan, options.measured)
        save_printer(plan, calibration, path)
    summary = (
        f"beams print {calibration.z_offset_mm:.4f} ± {calibration.z_offset_error_mm:.4f} mm thicker and"
        f" {calibration.width_offset_mm:.4f} ± {calibration.width_offset_error_mm:.4f} mm wider than drawn, of"
        f" {calibration.modulus_gpa:.3f} ± {calibration.modulus_error_gpa:.3f} GPa"
        f" ({calibration.prints} print{plural(calibration.prints)}, {calibration.taxels} taxels, chi-square"
        f" {calibration.chi_square:.1f} of {calibration.freedom})"
    )
    use = f'written: {plain(str(path))}; printer = "{plain(path.name)}" in a spec beside it plans for this printer'
    answer(options, calibration, summary, use)
    return DONE
