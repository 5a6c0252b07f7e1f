"""The command ``padgen retune``."""

import argparse
from typing import Any

from padgen.cli.common import (
    add_model,
    add_output,
    add_spec,
    add_verbose,
    code_of,
    folder_of,
    print_json,
    progress_line,
    show,
)
from padgen.cli.drive import plan_of
from padgen.core.errors import SpecError, plain

__all__ = ["add", "tell"]

KINDS = ("spectrum", "chirp", "pluck")


def add(commands: Any) -> None:
    """Declare the command and its options."""
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
        help="a CSV (resonances, spectra or time series) or a WAV (the coil's current and the sensor; or a pluck), or"
        " several or a folder of them, each named after its taxel or coil",
    )
    parser.add_argument("--coupon", metavar="FILE", help="what was measured on the coupon printed beside the pad")
    parser.add_argument(
        "--estimate-rest",
        action="store_true",
        help="taxels that were not measured get the tones that the others make likely, not the plan's",
    )
    parser.add_argument(
        "--nearest", action="store_true", help="of two peaks that are alike, take the one nearer to the plan's"
    )
    parser.add_argument(
        "--excitation",
        default="current",
        metavar="current|voltage",
        help="what the first channel of a WAV holds, where it has one more than taxels (default: current)",
    )
    parser.add_argument(
        "--sensor",
        metavar="displacement|velocity|acceleration",
        help="what was measured (default: as the files say, or as recognised)",
    )
    parser.add_argument(
        "--simulate", metavar="SEED", type=int, help="measure a pad that the computer prints, to try the loop"
    )
    parser.add_argument(
        "--kind",
        default="spectrum",
        metavar="|".join(KINDS),
        help="with --simulate: what is measured (default: spectrum)",
    )
    parser.add_argument(
        "--snr", default=30.0, metavar="DB", type=float, help="with --simulate: signal over noise (default: 30)"
    )
    add_verbose(parser, "all notes, and more taxels")
    add_model(parser)
    add_output(parser)
    parser.set_defaults(command=_retune, late="measured")


def _retune(options: argparse.Namespace) -> int:
    if bool(options.measured) == (options.simulate is not None):
        raise SpecError("needs MEASURED, a file or a folder, or --simulate SEED, and not both", "padgen retune")
    from padgen.measured.tuned_folder import write_retuned

    with progress_line() as progress:
        plan = plan_of(options, progress)
        simulated = _simulated(options, plan, progress) if options.simulate is not None else None
        folder = folder_of(options, plan.name)
        written = write_retuned(
            plan,
            folder,
            options.measured,
            simulated,
            options.excitation,
            options.sensor,
            options.nearest,
            options.estimate_rest,
            options.coupon,
            progress,
        )
    return tell(options, plan, written)


def tell(options: argparse.Namespace, plan: Any, written: Any) -> int:
    """Print what a re-tuned folder holds, and return the exit code."""
    if options.json:
        print_json(written.table())
    else:
        from padgen.measured.tuned_folder import measured_rows
        from padgen.report.measured_prints import retuned_text

        show(retuned_text(written.result, measured_rows(plan, written.result.tuning), options.verbose))
        place = plain(str(written.folder))
        show(f"written to {place}: {', '.join(written.files)}")
        show(f"next: padgen drive {plain(options.spec)} --tuning {place}/tuning.json --state all --hear")
    return code_of(written.result.findings)


def _simulated(options: argparse.Namespace, plan: Any, progress: Any) -> Any:
    from padgen.measured.tuned_folder import simulated_print

    if options.simulate < 0:
        raise SpecError(f"must be 0 or more, got {options.simulate}", "--simulate")
    if not 0 <= options.snr <= 200:
        raise SpecError(f"must be 0 … 200 dB, got {options.snr:g}", "--snr")
    progress("printing and measuring a pad")
    return simulated_print(plan, options.simulate, options.kind, options.snr)
