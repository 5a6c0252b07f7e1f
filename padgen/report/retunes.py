"""Describe re-tuned prints as text for people."""

from typing import TYPE_CHECKING

from padgen.core.display import table
from padgen.core.errors import number
from padgen.report.plans import held_line, serious_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from padgen.measured.tune import Retuned
    from padgen.measured.tuned_folder import MeasuredRow

__all__ = ["retuned_text"]

SHOWN_ROWS, MOST_ROWS = 12, 40
"""Most taxels in the table, and with ``--verbose``."""


def retuned_text(result: "Retuned", taxels: "Sequence[MeasuredRow]", verbose: bool = False) -> str:
    """Return the selectivity that the new tones will reach, the findings, and a table of the measured `taxels`."""
    measured = [row for row in taxels if row.measured]
    rows = [
        (
            row.taxel,
            f"{row.planned_hz:.2f}",
            f"{row.resonance_hz:.2f}",
            f"{row.resonance_error_hz:.2g}",
            f"{100 * (row.resonance_hz / row.planned_hz - 1):+.1f}",
            f"{row.q:.1f}",
            f"{row.q_error:.1g}",
            f"{row.drive_hz:.3f}",
            f"{row.current_ma_peak:.3g}",
            f"{row.voltage_v_peak:.3g}",
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
