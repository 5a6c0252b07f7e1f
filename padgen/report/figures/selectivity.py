"""Table of how much quieter each OFF taxel is than when ON, while another channel of its coil plays."""

from typing import TYPE_CHECKING

import numpy as np

from padgen.physics.selectivity import tone_energy
from padgen.planner.drive_scheme import placed_channels
from padgen.report.figures import Figure, Matrix, Panel, Scale

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = ["CAPTION", "ORDER", "SHOWN_IN", "TITLE", "make"]

TITLE = "Selectivity"
CAPTION = (
    "How many decibels a taxel that is off stays below its own full level while another channel of its coil plays; the"
    " more, the better."
)
SHOWN_IN = ("draw", "page")
ORDER = 2
LARGEST_DB = 60.0
LONGEST_STATE = 24


def make(plan: "Plan", quick: bool) -> tuple[Figure, ...]:
    """Return the figure with a selectivity table for each set of channels."""
    selectivity = plan.selectivity
    asked_db = selectivity.asked_db
    # Of many channels the plan has no table.
    many = [placed_channels(plan.spec, channel_set) for channel_set in plan.sets if not selectivity.matrix_db]
    tables = [np.array(table) for table in selectivity.matrix_db] or [-10 * np.log10(tone_energy(c, c)) for c in many]
    largest_db = max([2 * asked_db, *(float(table.max()) for table in tables)])
    shade = Scale("", "dB", 0.0, min(largest_db, LARGEST_DB), near=(0.0, 2 * asked_db))
    panels = []
    for which, (channel_set, table) in enumerate(zip(plan.sets, tables, strict=True)):
        count = len(channel_set)
        matrix = Matrix(
            label=f"Coils of set {which}, dB" if len(plan.sets) > 1 else "dB below its own level",
            names=tuple(str(c.index) for c in channel_set),
            values=tuple(map(tuple, table.tolist())),
            z=shade,
            asked=asked_db,
        )
        panels.append(
            Panel(
                x=Scale("tone of channel", "", -0.5, count - 0.5, short="tone"),
                y=Scale("OFF taxel of channel", "", -0.5, count - 0.5, short="taxel"),
                marks=(matrix,),
                title="one channel per coil: there is no other tone to hear" if count < 2 and not which else "",
            )
        )
    notes = [f"Asked are {asked_db:.1f} dB; less is framed."]
    states_db = (selectivity.all_states_db, selectivity.placed_all_states_db)
    if selectivity.one_hot_db is not None and None not in states_db:
        worst_db = min(db for db in states_db if db is not None)
        notes.append(
            f"With one channel on, a coil keeps {selectivity.one_hot_db:.1f} dB, in its worst state"
            f" ({selectivity.worst_state[:LONGEST_STATE]}) {worst_db:.1f} dB, as drawn.".replace("-", "−")
        )
    no_table = (
        "With so many channels the plan keeps no table; the response above and the driver table have the figures."
    )
    return (
        Figure(
            title="how much quieter an OFF taxel is than ON, at the tone of another",
            description="Selectivity of each taxel against each tone",
            panels=tuple(panels),
            channels=len(plan.channels),
            notes=tuple(notes),
            instead="" if selectivity.matrix_db else no_table,
        ),
    )
