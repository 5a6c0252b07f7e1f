"""Describe, as text for people, a print as it was measured and the pad that a slicer's G-code would lay."""

from typing import TYPE_CHECKING, Any

from padgen.core.display import span_text, table
from padgen.core.errors import number, plain
from padgen.report.plans import held_line, serious_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from padgen.measured.tune import Retuned

__all__ = ["laid_text", "retuned_text"]


def laid_text(report: Any, file: str, verbose: bool = False) -> str:
    """Return the verdict on a G-code, the settings to change, and a table of each channel (`verbose`: each taxel)."""
    figures = report.figures
    count = {level: sum(f.level == level for f in report.findings) for level in ("error", "warning")}
    verdict = "would print as planned"
    if any(count.values()):
        told = (f"{n} {level}{'s' * (n > 1)}" for level, n in count.items() if n)
        verdict = f"would not print as planned ({', '.join(told)})"
    x, y = figures["centre_mm"]
    turned = f", turned by {figures['turned_deg']}°" if figures["turned_deg"] else ""
    lines = [
        f"{plain(file)} {verdict}",
        f"by {plain(figures['slicer'])}: {figures['layers']} layers, {number(figures['height_mm'])} mm high, the pad's"
        f" centre at ({number(x)}, {number(y)}) mm{turned}; compared with {figures['compared_with']}",
    ]
    if figures["settings_to_change"] and any(count.values()):
        changes = (f"{s['name']} {s['needs']} (is {plain(s['has'])})" for s in figures["settings_to_change"])
        lines.append(f"in the slicer set: {', '.join(changes)}")
    groups: dict[Any, list[dict[str, Any]]] = {}
    for taxel in figures["taxels"]:
        groups.setdefault(taxel["id"] if verbose else taxel["channel"], []).append(taxel)
    headings = (
        "taxel" if verbose else "ch",
        "planned Hz",
        "as laid Hz",
        "off %",
        "beam layers",
        "thick mm",
        "first mm wide",
        "above mm wide",
        "plate mg",
        "recess mm",
        "room mm",
        "gap mm",
    )
    return "\n".join([*lines, "", table(headings, [_row(str(name), group) for name, group in groups.items()]), ""])


def _row(name: str, taxels: list[dict[str, Any]]) -> tuple[str, ...]:
    beams = [beam for taxel in taxels for beam in taxel["beams"]]
    hz = [taxel["resonance_hz"] for taxel in taxels]
    planned = taxels[0]["planned_hz"]
    return (
        name,
        f"{planned:.1f}",
        _span(hz, 1),
        _span([None if f is None else 100 * (f / planned - 1) for f in hz], 1),
        _span([beam["layers"] for beam in beams], 0),
        _span([beam["thickness_mm"] for beam in beams], 2),
        _span([width for beam in beams for width in beam["width_mm"][:1]], 3),
        _span([width for beam in beams for width in beam["width_mm"][1:]], 3),
        _span([taxel["plate_mg"] for taxel in taxels], 1),
        _span([taxel["recess_depth_mm"] for taxel in taxels], 2),
        _span([taxel["recess_room_mm"] for taxel in taxels], 2),
        _span([taxel["gap_mm"] for taxel in taxels], 2),
    )


def _span(values: list[float | None], digits: int) -> str:
    """Return the smallest and the largest value as text, and a dash if some are missing."""
    missing = "-" if not values or None in values else ""
    return " … ".join(filter(None, (span_text(values, f".{digits}f"), missing)))


SHOWN_ROWS, MOST_ROWS = 12, 40
"""Most taxels in the table, and with ``--verbose``."""


def retuned_text(result: "Retuned", taxels: "Sequence[dict[str, Any]]", verbose: bool = False) -> str:
    """Return the selectivity that the new tones will reach, the findings, and a table of the measured `taxels`."""
    measured = [row for row in taxels if row["measured"]]
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
        for row in measured[: MOST_ROWS if verbose else SHOWN_ROWS]
    ]
    head = ("taxel", "planned Hz", "f Hz", "±", "off %", "Q", "±", "drive Hz", "mA peak", "V peak")
    done = f"{len(measured)} of {len(taxels)} taxels are re-tuned"
    if result.before_db is not None and result.after_db is not None:
        low = f", at least {result.after_low_db:.1f} dB in 95 of 100" if result.after_low_db is not None else ""
        done += (
            f": the worst coil then keeps {result.after_db:.1f} dB of ON over OFF{low}, instead of"
            f" {result.before_db:.1f} dB with the planned tones (planned {number(round(result.planned_db or 0, 1))} dB,"
            f" asked {result.asked_db:.1f} dB)"
        )
    more = len(measured) - len(rows)
    told = [held_line(done, result.findings), serious_text(result.findings, verbose), table(head, rows)]
    return "\n".join([line for line in told if line] + [f"… and {more} more, in retune.json"] * (more > 0))
