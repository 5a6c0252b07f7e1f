"""Re-tuned prints as text for people."""

from typing import TYPE_CHECKING

from padgen.core.errors import number
from padgen.report.plans import table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from padgen.measured.tune import Retuned
    from padgen.measured.tuned_folder import MeasuredRow

__all__ = ["retuned_text"]

MOST_ROWS = 40


def retuned_text(result: "Retuned", taxels: "Sequence[MeasuredRow]") -> str:
    """Tell what was measured, of all `taxels`, and what the new tones will reach."""
    rows = []
    measured = [row for row in taxels if row.measured]
    for row in measured[:MOST_ROWS]:
        rows.append(
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
        )
    head = ("taxel", "planned Hz", "f Hz", "±", "off %", "Q", "±", "drive Hz", "mA peak", "V peak")
    text = [f"{len(measured)} of {len(taxels)} taxels measured", table(head, rows)]
    if len(measured) > len(rows):
        text.append(f"… and {len(measured) - len(rows)} more, in retune.json")
    if result.before_db is not None and result.after_db is not None:
        low = f", at least {result.after_low_db:.1f} dB in 95 of 100" if result.after_low_db is not None else ""
        text.append(
            f"selectivity in all states, worst coil, predicted: {result.before_db:.1f} dB with the planned tones,"
            f" {result.after_db:.1f} dB re-tuned{low} (planned {number(round(result.planned_db or 0, 1))} dB,"
            f" asked {result.asked_db:.1f} dB)"
        )
    return "\n".join(text)
