"""Chart of the resonances of all channels, each with its scatter from print to print and the band kept free for it."""

from typing import TYPE_CHECKING

from padgen.physics.ladder import slot_half_width
from padgen.report.figures import Figure, Line, Panel, RowLabel, Rows, Scale

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = ["CAPTION", "ORDER", "SHOWN_IN", "TITLE", "make"]

TITLE = "Ladder of resonances"
CAPTION = (
    "Each channel's resonance inside the band that it needs for itself; whiskers show how far a print is likely to"
    " miss it."
)
SHOWN_IN = ("draw", "page", "sheet", "move", "notebook")
ORDER = 3


def make(plan: "Plan", quick: bool) -> tuple[Figure, ...]:
    """Return the chart of all channels' resonances, in one colour for each set of channels that share a coil."""
    half = slot_half_width(plan.spec.q_min, plan.spec.delta_y)
    several = len(plan.sets) > 1
    series = []
    for place, (channel_set, name) in enumerate(zip(plan.sets, ("even", "odd"), strict=False)):
        slots = [(c.resonance_hz * max(1 - half, 0.0), c.resonance_hz * (1 + half)) for c in channel_set]
        series.append(
            Rows(
                role=f"set-{place}",
                # The paper's Δy/4Q.
                span_label="slot, Δy/4Q to each side",
                mark_label="resonance",
                sigma_label="± 1 sigma of prints",
                rows=tuple(float(c.index) for c in channel_set),
                marks=tuple(c.resonance_hz for c in channel_set),
                spans=tuple(slots),
                sigmas=tuple(c.resonance_hz * c.print_spread for c in channel_set),
                roles=tuple(f"channel-{c.index}" for c in channel_set),
                which=f"(coils of {name} row + column)" if several else "",
            )
        )
    low_hz, high_hz = plan.spec.band_hz
    spreads = [max(half, c.print_spread) for c in plan.channels]
    pairs = list(zip(plan.channels, spreads, strict=True))
    least = min(c.resonance_hz * max(1 - spread, 0.05) for c, spread in pairs)
    most = max(c.resonance_hz * (1 + spread) for c, spread in pairs)
    near_low = 0.97 * min(c.resonance_hz * max(1 - spread, 0.0) for c, spread in pairs)
    panel = Panel(
        x=Scale(
            "frequency",
            "Hz",
            0.93 * min(least, low_hz),
            1.07 * max(most, high_hz),
            is_log=True,
            near=(max(near_low, plan.channels[0].resonance_hz / 4), 1.03 * most),
        ),
        y=Scale("channel", "", -0.6, len(plan.channels) - 0.4, short="ch"),
        marks=tuple(series),
        lines=tuple(
            Line("limit", hz, label, only=("draw", "notebook"))
            for hz, label in ((low_hz, "band asked for"), (high_hz, ""))
        ),
        row_labels=tuple(RowLabel(float(c.index), str(c.index), f"{c.resonance_hz:.1f} Hz") for c in plan.channels),
    )
    ends = plan.channels[0].resonance_hz, plan.channels[-1].resonance_hz
    return (
        Figure(
            title="resonances of the channels, and the slots that keep them apart",
            description=f"Resonances of {len(plan.channels)} channels from {ends[0]:.1f} to {ends[1]:.1f} hertz, each"
            " within its slot",
            panels=(panel,),
            channels=len(plan.channels),
        ),
    )
