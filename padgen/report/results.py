"""Describe drive files, measured prints, G-code, sweeps and the cache, as text for people and as plain data.

This loads without numpy, which `padgen cache` does not need.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen.core.display import seconds_text, span_text, table
from padgen.core.errors import Finding, about, number, plain, plural
from padgen.report.plans import findings_text, outcome_line, serious_text, verdict_text

if TYPE_CHECKING:
    import numpy as np

    from padgen.batch.definition import Sweep
    from padgen.batch.index import Overview, RefusedVariants
    from padgen.batch.sweep import Event, SweepResult
    from padgen.core.cache import CacheInfo
    from padgen.driver.drive_folder import Driven
    from padgen.driver.ear import Heard
    from padgen.driver.excitation import Excitation
    from padgen.driver.formats.wav import WaveReport
    from padgen.driver.outputs import Outputs
    from padgen.driver.signs import PlayedRecoil
    from padgen.driver.slots import FrameContrast
    from padgen.measured.tune import Retuned
    from padgen.planner.plan import Plan

__all__ = [
    "cache_text",
    "counts_text",
    "driven_table",
    "driven_text",
    "excitation_text",
    "laid_text",
    "retuned_text",
    "sweep_table",
    "sweep_text",
]

MOST_MAPPED = 16
"""Most rows and columns of a pad for which the map of taxels is printed."""
MOST_PICTURES = 4
"""Most frames that are printed as text with ``--verbose``."""


def driven_text(
    plan: "Plan", driven: "Driven", frames: "np.ndarray | None", notes: Sequence[str], verbose: bool = False
) -> str:
    """Return text on how a drive's files came out, the verdict, what they play, and how a simulated pad moves."""
    from padgen.driver.frames import frames_text, map_text, taxel_grid

    heard = driven.heard
    name = plan.name
    done = f"The drive of {name} is written"
    if heard is not None and heard.selectivity_db is not None:
        untouched = "" if plan.touch is None else " that nobody touches"
        done = (
            f"Played on a simulated {name}{untouched}, drive.wav has {heard.selectivity_db:.1f} dB of ON over OFF,"
            f" the faintest ON over the loudest OFF of all that it shows (asked: {heard.asked_db:.1f} dB)"
        )
    picture = ""
    place = plain(str(driven.folder))
    if frames is not None:
        # Dark frames at the beginning show nothing.
        first = next((k for k, frame in enumerate(frames) if frame.any()), 0)
        shown = frames[first : first + (MOST_PICTURES if verbose else 1)]
        frame_count = counted(len(frames), "frame")
        if len(shown) < len(frames):
            frame_count = (
                f"{frame_count}, here from frame {first + 1} on"
                if len(shown) > 1
                else f"frame {first + 1} of {len(frames)}{', the first with a taxel ON' if first else ''}"
            )
        key = "seen from the touch side (# ON, + between, . OFF, blank: no taxel)"
        picture = f"{frame_count}, {key}:\n{frames_text(plan, shown)}"
    elif max(taxel_grid(plan).shape) <= MOST_MAPPED:
        picture = f"the taxel at each pixel of an image, seen from the touch side (-: none):\n{map_text(plan)}\n"
    errors = [finding for finding in plan.findings if finding.level == "error"]
    lines = [
        outcome_line(done, [*errors, *driven.findings]),
        "" if driven.outputs is None else _outputs_text(driven.outputs),
        verdict_text(plan.verdict),
        serious_text(driven.findings, verbose),
        picture,
        "" if driven.report is None else _wave_text(driven.report),
        "" if driven.beam_rise_k is None else _warmth_text(plan, driven.beam_rise_k),
        "" if driven.contrast is None else _contrast_text(driven.contrast),
        "" if driven.recoil is None else _recoil_text(driven.recoil),
        "" if heard is None else heard_text(plan, heard),
        *(f"note: {plain(note)}" for note in notes),
        f"written to {place}: {', '.join(driven.files)}",
        f"the other files in {place} are of an earlier plan; padgen build makes them anew" if driven.stale else "",
    ]
    return "\n".join(line for line in lines if line)


def _outputs_text(outputs: "Outputs") -> str:
    """Return how many amplifier outputs a drive needs, and what an AC-coupled sound card would do to the motion."""
    if outputs.ac_corner_hz is None:
        return f"It needs {counted(outputs.count, 'output')}, AC or DC coupled."
    left = "no taxel would vibrate at its resonance"
    if outputs.ac_selectivity_db is not None and outputs.selectivity_db is not None:
        left = f"ON over OFF would be {outputs.ac_selectivity_db:.1f} dB instead of {outputs.selectivity_db:.1f} dB"
    elif outputs.ac_level_db is not None:
        left = f"ON taxels would vibrate {-outputs.ac_level_db[1]:.1f} to {-outputs.ac_level_db[0]:.1f} dB less"
    return f"It needs {counted(outputs.count, 'DC-coupled output')}: through an AC-coupled sound card {left}."


def driven_table(plan: "Plan", driven: "Driven", notes: Sequence[str]) -> dict[str, Any]:
    """Return the pad's verdict and the figures of a drive's files as plain data."""
    from padgen.driver.ear import heard_table

    return {
        "verdict": asdict(plan.verdict),
        "folder": str(driven.folder),
        "files": list(driven.files),
        "wave": None if driven.report is None else {**asdict(driven.report), "seconds": driven.report.seconds},
        "contrast": None if driven.contrast is None else driven.contrast._asdict(),
        "recoil": None if driven.recoil is None else driven.recoil._asdict(),
        "heard": None if driven.heard is None else heard_table(driven.heard),
        "outputs": None if driven.outputs is None else asdict(driven.outputs),
        "beam_rise_k": driven.beam_rise_k,
        "notes": list(notes),
        "findings": [asdict(finding) for finding in driven.findings],
    }


def counted(count: int, word: str) -> str:
    """Return a number with its word, in the plural where it is not 1."""
    return f"{count} {word}{plural(count)}"


def _wave_text(report: "WaveReport") -> str:
    from padgen.physics.selectivity import Scheme

    unit = "V" if report.signal == "voltage" else "A"
    depth = "24 bit" if report.depth == "24" else "32-bit float"
    lines = [
        f"drive.wav: {report.seconds:.3g} s for {len(report.rms_current_a)} coils (one WAV channel each, row by row) at"
        f" {report.rate_hz} Hz, {depth}, drive: {report.scheme}; a sample of 1 stands for"
        f" {number(report.full_scale)} {unit}, the largest is {report.peak:.3g} {unit}",
        f"each coil draws at most {1e3 * max(report.rms_current_a):.3g} mA rms and {max(report.copper_loss_w):.3g} W",
    ]
    if report.loss_over_tones is not None and Scheme(report.scheme).has_constant:
        lines[-1] += (
            f"; all coils together heat up {_heat_text(report.loss_over_tones)} with plain tones of the same force"
        )
    if report.loops:
        lines.append("it repeats without a seam")
    if report.carrier_hz is not None:
        lines[-1] += f"; on a carrier of {number(report.carrier_hz)} Hz"
    return "\n".join(lines)


def _heat_text(times: float) -> str:
    """Return a ratio of two heats as words, to two digits: 'N times as much as', or 'as much as' for 1."""
    return "as much as" if about(times) == "1" else f"{about(times)} times as much as"


def _warmth_text(plan: "Plan", beam_rise_k: float) -> str:
    error = plan.warm.error
    return f"played over and over, it warms beams by {about(beam_rise_k)} K at most (± {error:.0%})"


def _contrast_text(contrast: "FrameContrast") -> str:
    end = "" if contrast.end_db is None else f"; at the end of a frame, {contrast.end_db:.1f} dB"
    row, column = contrast.coil
    return (
        f"predicted: on average over a frame of {about(contrast.frame_s, 3)} s, {contrast.slot_db:.1f} dB of ON over"
        f" OFF or more (least: coil r{row}c{column} in frame {contrast.frame + 1}){end} or more"
    )


def _recoil_text(recoil: "PlayedRecoil") -> str:
    if recoil.signed_db is None or recoil.in_step_db is None or recoil.moving_g is None:
        return ""
    return (
        f"predicted: {recoil.mount}, the pad of {number(round(recoil.moving_g))} g recoils from its ON taxels:"
        f" {recoil.signed_db:.1f} dB of ON over OFF in the worst frame, other coils' leakage counted"
        f" ({recoil.in_step_db:.1f} dB if all taxels of a frequency moved in step)"
    )


def heard_text(plan: "Plan", heard: "Heard") -> str:
    """Return a table of the levels that ON and OFF taxels of a simulated pad reach while it plays a drive file."""
    import numpy as np

    on = heard.on
    off = heard.off
    rows = []
    for channel in plan.channels:
        indices = [k for k, taxel in enumerate(plan.taxels) if taxel.channel == channel.index]
        played = on[:, indices]
        quiet = off[:, indices]
        rows.append(
            (
                str(channel.index),
                f"{channel.resonance_hz:.2f}",
                span_text(heard.wanted_um[indices], ".3g"),
                span_text(20 * np.log10(np.maximum(played, 1e-12)).ravel(), "+.2f"),
                _quiet_text(float(np.nanmax(quiet, initial=-1.0))),
            )
        )
    gap = ", with the pull growing as the gap closes" if heard.with_gap else ""
    leak = plan.reuse.most_leak_db
    leaked = "" if leak is None or not plan.reuse.is_known else f", by the plan {leak:.1f} dB below ON or quieter"
    nothing_off = "\nno coil plays while a taxel of it is OFF: of ON over OFF this file tells nothing"
    slot = heard.slot_contrast
    held = heard.held_contrast
    frames = "" if slot is None else f"\nheard: on average over a frame, {slot[0]:.1f} dB of ON over OFF or more"
    frames += "" if slot is None or held is None else f"; at the end of a frame, {held[0]:.1f} dB or more"
    return (
        f"heard in {counted(len(heard.spans), 'state')} of the file{gap}:\n"
        + table(("ch", "planned Hz", "wanted µm", "ON, dB of wanted", "OFF, dB at most"), rows)
        + (nothing_off if heard.selectivity_db is None else "")
        + f"\n(wanted: the level that a finger on the boss is to feel; left out here: what other coils leak{leaked})"
        + frames
        + _shaken_text(heard)
    )


def _quiet_text(loudest: float) -> str:
    """Return in dB how loud the loudest OFF taxel is, of its level when ON; negative: none is OFF."""
    from padgen.driver.ear import STILL

    if loudest < 0:
        return ""
    return f"{20 * log10(loudest):.1f}" if loudest > STILL else "still"


def _shaken_text(heard: "Heard") -> str:
    if heard.unshaken:
        return f"\nthe pad as it moves is not heard: it {heard.unshaken}"
    if heard.shaken is None or heard.shaken_db is None:
        return ""
    return (
        f"\nheard with the recoil of the pad ({number(round(heard.shaken.moving_g))} g, {heard.shaken.mount}):"
        f" {heard.shaken_db:.1f} dB of ON over OFF; what other coils leak is left out"
    )


def excitation_text(played: "Excitation", folder: Path, findings: "Sequence[Finding]") -> str:
    """Describe an excitation file, and what to do with it."""
    low, high = played.band_hz
    how = "on all coils at once" if played.together else f"on each of {len(played.coils)} coils in turn"
    how = "on the coil" if len(played.coils) == 1 else how
    share = "" if played.level_share >= 1 else f"{played.level_share:.3g} times "
    what = "a chirp whose force runs" if played.kind == "chirp" else f"{played.kind} whose force has frequencies"
    return (
        f"excitation.wav: {what} from {low:.3g} to {high:.3g} Hz"
        f" {'in' if played.kind == 'chirp' else 'for'} {played.sweep_s:.3g} s, then silence, {how};"
        f" {played.seconds:.3g} s in all at {played.rate_hz} Hz; taxels reach {share}their planned levels\n"
        "record each taxel's motion with the current or voltage beside it, and give the recording to padgen retune\n"
        + "".join(f"{findings_text([finding])}\n" for finding in findings)
        + f"written to {plain(str(folder))}: plan.json, excitation.wav, excitation.json"
    )


def laid_text(report: Any, file: str, verbose: bool = False) -> str:
    """Return the verdict on a G-code, the settings to change, and a table of each channel (`verbose`: each taxel)."""
    figures = report.figures
    count = {level: sum(f.level == level for f in report.findings) for level in ("error", "warning")}
    faults = ", ".join(f"{n} {level}{plural(n)}" for level, n in count.items() if n)
    verdict = "would print as planned"
    if count["error"]:
        verdict = f"would not print as planned ({faults})"
    elif count["warning"]:
        verdict = f"would print nearly as planned ({faults})"
    x, y = figures["centre_mm"]
    turned = f", turned by {figures['turned_deg']}°" if figures["turned_deg"] else ""
    lines = [
        f"{plain(file)} {verdict}",
        f"by {plain(figures['slicer'])}: {figures['layers']} layers, {number(figures['height_mm'])} mm high, the pad's"
        f" centre at ({number(x)}, {number(y)}) mm{turned}; compared with {figures['compared_with']}",
    ]
    if len(figures["pads"]) > 1:
        bad = sum(pad["errors"] > 0 for pad in figures["pads"])
        lines.append(
            f"{len(figures['pads'])} pads are on the plate, {bad or 'none'} with errors; the table is of the first"
        )
    if figures["drawn_db"] is not None and figures["planned_db"] is not None:
        lines.append(
            f"laid so the pad has {figures['planned_db']:.1f} dB of ON over OFF with the planned tones (laid as"
            f" planned: {figures['drawn_db']:.1f} dB), {figures['retuned_db']:.1f} dB re-tuned; other coils' leakage"
            " is counted"
        )
    if figures["settings_to_change"] and faults:
        changes = (f"{s['name']} {s['needs']} (is {plain(s['has'])})" for s in figures["settings_to_change"])
        # Only these read the profile.
        reads_profile = any(name in figures["slicer"] for name in ("PrusaSlicer", "SuperSlicer"))
        load = "load the pad.ini that padgen build writes, or set: " if reads_profile else "set: "
        lines.append(f"in the slicer {load}{', '.join(changes)}")
    groups: dict[Any, list[dict[str, Any]]] = {}
    for taxel in figures["taxels"] if verbose else sorted(figures["taxels"], key=lambda taxel: taxel["channel"]):
        groups.setdefault(taxel["id"] if verbose else taxel["channel"], []).append(taxel)
    headings = ("taxel" if verbose else "ch", "planned Hz", *(heading for heading, _, _ in LAID))
    rows = []
    for name, taxels in groups.items():
        row = [str(name), f"{taxels[0]['planned_hz']:.1f}"]
        for _, digits, values_of in LAID:
            values = [value for taxel in taxels for value in values_of(taxel)]
            missing = "-" if not values or None in values else ""
            row.append(" … ".join(filter(None, (span_text(values, f".{digits}f"), missing))))
        rows.append(row)
    return "\n".join([*lines, "", table(headings, rows), ""])


LAID: "tuple[tuple[str, int, Callable[[dict[str, Any]], list[float | None]]], ...]" = (
    ("as laid Hz", 1, lambda t: [t["resonance_hz"]]),
    ("off %", 1, lambda t: [None if t["resonance_hz"] is None else 100 * (t["resonance_hz"] / t["planned_hz"] - 1)]),
    ("beam layers", 0, lambda t: [beam["layers"] for beam in t["beams"]]),
    ("thick mm", 2, lambda t: [beam["thickness_mm"] for beam in t["beams"]]),
    ("1st layer mm wide", 3, lambda t: [width for beam in t["beams"] for width in beam["width_mm"][:1]]),
    ("others mm wide", 3, lambda t: [width for beam in t["beams"] for width in beam["width_mm"][1:]]),
    ("plate mg", 1, lambda t: [t["plate_mg"]]),
    ("recess mm deep", 2, lambda t: [t["recess_depth_mm"]]),
    ("recess mm wide", 2, lambda t: [t["recess_room_mm"]]),
    ("gap mm", 2, lambda t: [t["gap_mm"]]),
)
"""Columns of a pad as laid: heading, digits, and the values of a taxel; the smallest and the largest are shown, and a
dash where some are missing."""


SHOWN_TAXELS = 12
MOST_TAXELS = 40
"""Most taxels in the table, and with ``--verbose``."""


def retuned_text(plan: "Plan", result: "Retuned", verbose: bool = False) -> str:
    """Return the selectivity that the new tones will reach, the findings, and a table of the measured taxels."""
    from padgen.measured.tune import measured_rows

    measured = [row for row in measured_rows(plan, result.tuning) if row["measured"]]
    rows = [
        (
            row["taxel"],
            f"{row['planned_hz']:.2f}",
            f"{row['resonance_hz']:.2f}",
            f"{row['resonance_error_hz']:.2g}",
            f"{100 * (row['resonance_hz'] / row['planned_hz'] - 1):+.1f}",
            f"{row['q']:.1f}",
            f"{row['q_error']:.1g}",
            f"{row['drive_hz']:.3f}",
            f"{row['current_ma_peak']:.3g}",
            f"{row['voltage_v_peak']:.3g}",
        )
        for row in measured[: MOST_TAXELS if verbose else SHOWN_TAXELS]
    ]
    head = ("taxel", "planned Hz", "measured Hz", "± Hz", "off %", "Q", "± Q", "drive Hz", "mA peak", "V peak")
    done = f"{len(measured)} of {len(plan.taxels)} taxels are re-tuned"
    kept, likely = _kept_texts(result, len(plan.taxels) - len(measured))
    lines = [
        outcome_line(f"{done}{kept}", result.findings),
        likely,
        serious_text(result.findings, verbose),
        table(head, rows),
        f"… and {len(measured) - len(rows)} more, in retune.json" if len(measured) > len(rows) else "",
    ]
    return "\n".join(line for line in lines if line)


def _kept_texts(result: "Retuned", unmeasured: int) -> tuple[str, str]:
    """Return the end of a sentence on the dB that the worst coil keeps re-tuned, and a line on how sure these dB are.

    Where taxels are unmeasured, what 95 of 100 such prints keep comes first: the figure itself takes these as planned.
    """
    if result.before_db is None or result.after_db is None or result.after_low_db is None:
        return "", ""  # no coil has two channels
    asked = f"asked: {result.asked_db:.1f} dB"
    before = f"{result.before_db:.1f} dB with the planned tones"
    planned = "" if result.planned_db is None else f"; the plan, without print errors, has {result.planned_db:.1f} dB"
    if unmeasured:
        others = "the other one" if unmeasured == 1 else f"the {unmeasured} others"
        kept = f"the worst coil keeps at least {result.after_low_db:.1f} dB of ON over OFF in 95 of 100 such prints"
        as_taken = "as their tones assume" if unmeasured > 1 else "as its tone assumes"
        return f": {kept} ({asked})", f"If {others} came out {as_taken}: {result.after_db:.1f} dB ({before}){planned}."
    sure = f"With the errors of the measurement it keeps at least {result.after_low_db:.1f} dB in 95 of 100 cases"
    return f": the worst coil keeps {result.after_db:.1f} dB of ON over OFF ({asked}; {before})", f"{sure}{planned}."


MOST_ROWS = 12
"""Most variants of a Pareto front that are all shown; of a longer front only the best in each objective are."""


def sweep_text(sweep: "Sweep", result: "SweepResult", files: Sequence[str]) -> str:
    """Return the counts of a sweep's variants, a table of the best, and where the results are."""
    overview = result.overview
    total = counted(result.total, "variant")
    faulty = overview.judged["faulty"]
    short = overview.judged["short"]
    more = result.refused - sum(refusal.variants for refusal in overview.refused)
    lines = [
        f"{sweep.settings.name}: {total}, {counts_text(result)}, in {seconds_text(result.seconds)}",
        f"{result.kept} of them were finished before and not made again" if result.kept else "",
        f"{faulty} of those made {'does' if faulty == 1 else 'do'} not work: index.csv, column findings, says why"
        if faulty
        else "",
        f"{short} of those made {'falls' if short == 1 else 'fall'} short of what is asked" if short else "",
        *map(_refusal_text, overview.refused),
        f"… and {more} more refused for other reasons: index.csv, column sentence, says why" if more > 0 else "",
        f"\n{_front_text(sweep, overview)}" if overview.rows else "",
        f"\nwritten to {plain(str(result.folder))}: {', '.join(('index.csv', *files))}",
    ]
    return "\n".join(line.rstrip() for text in lines if text for line in text.splitlines())


def _refusal_text(refusal: "RefusedVariants") -> str:
    """Return which variants of a sweep are refused, and why."""
    rest = refusal.variants - len(refusal.names)
    names = ", ".join(refusal.names) + (f" and {rest} more" if rest else "")
    details = "" if refusal.is_whole else "; index.csv, column sentence, has each one's details"
    return f"refused: {names}: {refusal.sentence}{details}"


def counts_text(event: "Event | SweepResult") -> str:
    """Return the counts of variants done and failed, and of those refused and those still to do if there are any."""
    counts = [f"{event.done} done", (f"{event.refused} refused" if event.refused else ""), f"{event.failed} failed"]
    return ", ".join(count for count in [*counts, (f"{event.left} left" if event.left else "")] if count)


NONE_WORKS = {
    "works": "",
    "short": "; every variant falls short of what it asks, and these come nearest",
    "faulty": "; no variant works",
}
"""The end of a front's heading, by the kind of variant that the front is of."""


def _front_text(sweep: "Sweep", overview: "Overview") -> str:
    """Return the Pareto front as a table: varied fields, objectives reached, and those that a variant is best in."""
    from padgen.batch.index import OBJECTIVES

    axes = [name for axis in sweep.axes for name in axis.fields]
    objectives = overview.objectives
    weighed = ", ".join(OBJECTIVES[name].word for name in objectives)
    count = len(overview.rows)
    head = f"Pareto front over {weighed}: {counted(count, 'variant')} that no other beats"
    head += NONE_WORKS[overview.front_of]
    head += "; those best in one of these" if count > MOST_ROWS else ""
    best: dict[int, list[str]] = {row: [] for row in range(count) if count <= MOST_ROWS}
    for objective, row in overview.best().items():
        best.setdefault(row, []).append(OBJECTIVES[objective].word)
    varied = [overview.header.index(name) for name in ("number", *axes)]
    reached = [overview.header.index(name) for name in objectives]
    cells = [
        [
            *(_cell(overview.rows[row][i]) for i in varied),
            *(_cell(overview.rows[row][i] or "-") for i in reached),
            names,
        ]
        for row in sorted(best)
        for names in (", ".join(best[row]),)
    ]
    # Dotted names are shortened to their last parts where these differ.
    last = [name.rsplit(".", 1)[-1] for name in axes]
    short = [end if last.count(end) == 1 else name for end, name in zip(last, axes, strict=True)]
    headings = ["variant", *short, *(OBJECTIVES[name].heading for name in objectives), "best in"]
    return f"{head}:\n{table(headings, cells)}"


def _cell(text: str) -> str:
    try:
        return number(float(text)) if "." in text or "e" in text else text
    except ValueError:
        return text


def sweep_table(sweep: "Sweep", result: "SweepResult", files: Sequence[str]) -> dict[str, Any]:
    """Return the summary of a sweep as plain data: the last line of ``--json``."""
    overview = result.overview
    at = {name: overview.header.index(name) for name in ("number", "name")} if overview.rows else {}
    counts = {key: getattr(result, key) for key in ("total", "done", "refused", "failed", "kept", "left", "seconds")}
    return {
        "kind": "summary",
        "name": sweep.settings.name,
        "stage": sweep.settings.stage,
        "folder": str(result.folder),
        "files": ["index.csv", *files],
        **counts,
        "stopped": result.stopped,
        "interrupted": result.interrupted,
        "with_errors": overview.judged["faulty"],
        "short": overview.judged["short"],
        "objectives": list(overview.objectives),
        "front": [int(row[at["number"]]) for row in overview.rows],
        "best": {
            objective: {
                "number": int(overview.rows[row][at["number"]]),
                "name": overview.rows[row][at["name"]],
                "value": float(overview.values[row, overview.objectives.index(objective)]),
            }
            for objective, row in overview.best().items()
        },
    }


def cache_text(held: "CacheInfo", dropped: bool = False) -> str:
    """Describe the content of the cache, or the content that was dropped from it."""
    entries = "1 entry" if held.entries == 1 else f"{held.entries} entries"
    if dropped:
        return f"{plain(held.folder)}: {entries} dropped, {_megabytes(held.bytes)}"
    lines = [f"{plain(held.folder)}: {entries}, {_megabytes(held.bytes)} of {_megabytes(held.limit_bytes)}"]
    if held.kinds:
        rows = [(kind, str(entries), _megabytes(size)) for kind, (entries, size) in held.kinds.items()]
        lines.append(table(("kind", "entries", "size"), rows))
    return "\n".join(lines)


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"
