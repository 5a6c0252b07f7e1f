"""Map of the coils from both sides, each with the number of the amplifier output that feeds it."""

from typing import TYPE_CHECKING

from padgen.planner.layout import coil_axis_mm
from padgen.planner.movers import assembly_of
from padgen.report.drawings import pad_corners, pad_shapes
from padgen.report.figures import Discs, Figure, Panel, Scale, Shape
from padgen.report.plans import feeding_line

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = ["CAPTION", "ORDER", "SHOWN_IN", "TITLE", "make"]

TITLE = "Wiring"
CAPTION = (
    "Coils and the amplifier outputs that feed them, seen from the touch side; the mark is the groove in the edge of"
    " the pad and of what lies under it."
)
SHOWN_IN = ("draw", "page", "sheet")
ORDER = 5
ROLES = {"frame": "plate", "groove": "groove", "hole": "hole"}


def make(plan: "Plan", quick: bool) -> tuple[Figure, ...]:
    """Return the map from the touch side, and for files also turned over about its y axis, from below."""
    grid = plan.coils
    where = [(row, column) for row in range(grid.rows) for column in range(grid.columns)]
    half_x, half_y = pad_corners(plan)[2].tolist()
    panels = []
    for side, turn in (("from the touch side", 1), ("from below", -1)):
        places = [coil_axis_mm(grid, row, column) for row, column in where]
        coils = Discs(
            role="coil",
            edge_role="copper",
            label="winding",
            x=tuple(turn * float(x) for x, _ in places),
            y=tuple(float(y) for _, y in places),
            diameter=plan.spec.coil.outer_diameter_mm,
            depth=None if plan.spec.coil.shape == "round" else plan.spec.coil.sides_mm[1],
            numbers=tuple(str(k + 1) for k in range(len(where))),
            names=tuple(f"r{row}c{column}" for row, column in where),
            names_note="r1c2: row 1, column 2, as in the names of taxels",
        )
        panels.append(
            Panel(
                x=Scale("x", "mm", -half_x, half_x),
                y=Scale("y", "mm", -half_y, half_y),
                marks=(coils,),
                shapes=tuple(
                    Shape(ROLES[name], name, tuple(map(tuple, (outline * (turn, 1)).tolist())), NOTES.get(name, ""))
                    for name, outline in pad_shapes(plan)
                ),
                title=side,
                only=() if turn > 0 else ("draw",),
            )
        )
    notes = [
        "Bold numbers are amplifier outputs, and channels of the WAV file counted from 1, row by row from the corner"
        f" with the groove. {assembly_of(plan.spec).wiring}"
    ]
    if len(plan.sets) > 1:
        played = (
            f"set {k} plays channels {', '.join(str(channel.index) for channel in channel_set)}"
            for k, channel_set in enumerate(plan.sets)
        )
        notes.append(f"Coils of two kinds alternate: {'; '.join(played)}.")
    notes.append(feeding_line(plan))
    return (
        Figure(
            title="which amplifier output feeds which coil",
            description=f"{len(where)} coils in {grid.rows} rows and {grid.columns} columns, numbered row by row from"
            " the corner with the groove",
            panels=tuple(panels),
            channels=len(plan.channels),
            notes=tuple(notes),
        ),
    )


NOTES = {"groove": "groove: the corner of coil 1"}
"""Notes on the parts of the pad, by their names."""
