"""The board format: KiCad, Gerber and drill files, picture and order list of the circuit board of a pad's coils.

``<pad>.kicad_pcb`` and ``.kicad_pro``, Gerber X2 and drill files (``board-*``), ``board.svg``, ``board.txt`` and
``board-parts.csv``. Nothing is written for parts beside the pad.
"""

from math import dist

from padgen.core.errors import InfeasibleError, number
from padgen.core.files import OutputFolder
from padgen.planner.board_layout import Board, arc_centre, board_of
from padgen.planner.coils.board import house_of
from padgen.planner.drive_rows import table_csv
from padgen.planner.fixtures import board_parts, spacer_mm
from padgen.planner.plan import Plan
from padgen.solid.formats import ExportJob
from padgen.solid.gerber import gerber_files, label_strokes
from padgen.solid.kicad import pcb_text, project_text

__all__ = ["board_svg", "order_text", "write"]

COLOURS = ("#c83737", "#c8ab37", "#37a0c8", "#5fd38d", "#8d5fd3", "#d35fbc", "#a0a0a0", "#3771c8")
"""Of the copper layers from the top; the bottom layer has the last."""


def write(out: OutputFolder, job: ExportJob) -> None:
    """Add the files of the printed circuit board of coils; do nothing for parts beside the pad.

    Raises
    ------
    InfeasibleError
        The coils are no board coils, or the board cannot be laid out.
    """
    if job.pad is None:
        return
    try:
        board = board_of(job.plan)
    except InfeasibleError as error:
        tried = [cure for finding in job.plan.findings if finding.code == "board.room" for cure in finding.cures]
        raise InfeasibleError(error.message, error.where, tried[:1]) from error
    house = house_of(job.plan.spec.coil)
    out.write(f"{board.name}.kicad_pcb", pcb_text(board))
    out.write(f"{board.name}.kicad_pro", project_text(board, house))
    for end, text in gerber_files(board).items():
        out.write(f"board-{end}", text)
    out.write("board.svg", board_svg(board))
    out.write("board.txt", order_text(job.plan, board))
    rows = [
        *board_parts(job.plan),
        ("board", 1, "pieces", f"{board.layers} layers, {number(board.thickness_mm)} mm: board.txt"),
    ]
    out.write("board-parts.csv", table_csv(("item", "quantity", "unit", "what"), rows))


def order_text(plan: Plan, board: Board) -> str:
    """Return the board's specification as text, for the order at a board house."""
    coil = plan.spec.coil
    x0, y0, x1, y1 = board.outline_mm
    return f"""Board of {board.name}, by the rules of {coil.house!r}

layers            {board.layers}
size              {number(x1 - x0)} x {number(y1 - y0)} mm
thickness         {number(board.thickness_mm)} mm, FR-4
copper            {number(coil.copper_um or 0)} um outside, {number(coil.inner_copper_um or 0)} um inside
track and space   {number(coil.track_mm or 0)} / {number(coil.space_mm or 0)} mm
vias              {len(board.vias)}, through, covered by solder mask; none blind or buried
holes             {len(board.holes)} without plating
files             board-copper-1 (top) to board-copper-{board.layers} (bottom), board-mask-*, board-silk-top,
                  board-outline, board-plated.drl, board-holes.drl

All of a coil is one net: coils are spirals with the space stated between turns, no short circuit.
A coil has {number(coil.resistance_ohm)} ohm at 20 C and {number(coil.inductance_mh * 1e3)} uH, and with its tracks
between its two pins, in ohm at 20 C (coils and their amplifier outputs have one number):

{_pin_table(board, coil.resistance_ohm)}

The pad lies on the side of the names, the groove in its edge over the dot, on spacers of {number(spacer_mm(plan))} mm.
"""


def _pin_table(board: Board, coil_ohm: float) -> str:
    """Return a text table of the coils in the order of their pins: connector, pins, name, number, resistance in ohm."""
    first_pins = sorted((pin.connector, pin.number, pin.net) for pin in board.pins if pin.row == 0)
    rows = [
        (f"J{connector + 1}", f"{number}-{number + 1}", board.nets[net - 1], str(net))
        for connector, number, net in first_pins
    ]
    ohms = [f"{coil_ohm + board.leads_ohm[net - 1]:.2f}" for _, _, net in first_pins]
    lines = [("", "pins", "coil", "number", "ohm"), *((*row, ohm) for row, ohm in zip(rows, ohms, strict=True))]
    return "\n".join(f"{a:4}{b:8}{c:9}{d:9}{e}".rstrip() for a, b, c, d, e in lines)


def board_svg(board: Board) -> str:
    """Return a picture of the board from above, its layers in colours, in mm."""
    x0, y0, x1, y1 = board.outline_mm
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{x0 - 1:.2f} {-y1 - 1:.2f} {x1 - x0 + 2:.2f}'
        f' {y1 - y0 + 2:.2f}" width="{10 * (x1 - x0 + 2):.0f}" fill="none" stroke-linecap="round">',
        f"<title>{board.name}: board from above, top copper red, bottom blue</title>",
        f'<rect x="{x0:.3f}" y="{-y1:.3f}" width="{x1 - x0:.3f}" height="{y1 - y0:.3f}" fill="#14352a"/>',
    ]
    for k in range(board.layers - 1, -1, -1):
        colour = COLOURS[-1] if k == board.layers - 1 else COLOURS[k]
        by_width: dict[float, list[str]] = {}
        for track in board.tracks:
            if track.layer == k:
                ax, ay = track.start_mm
                bx, by = track.end_mm
                way = f"M{ax:.3f} {-ay:.3f}"
                if track.middle_mm is None:
                    way += f"L{bx:.3f} {-by:.3f}"
                else:
                    mx, my = track.middle_mm
                    left = (mx - ax) * (by - ay) - (my - ay) * (bx - ax) > 0
                    radius = dist(track.start_mm, arc_centre(track.start_mm, track.middle_mm, track.end_mm))
                    way += f"A{radius:.3f} {radius:.3f} 0 0 {0 if left else 1} {bx:.3f} {-by:.3f}"
                by_width.setdefault(track.width_mm, []).append(way)
        for width, ways in sorted(by_width.items()):
            parts.append(f'<path d="{"".join(ways)}" stroke="{colour}" stroke-width="{width:g}" opacity="0.8"/>')
    for via in board.vias:
        x, y = via.at_mm
        parts.append(f'<circle cx="{x:.3f}" cy="{-y:.3f}" r="{via.size_mm / 2:g}" fill="#d9c27a"/>')
        parts.append(f'<circle cx="{x:.3f}" cy="{-y:.3f}" r="{via.drill_mm / 2:g}" fill="#222"/>')
    for pin in board.pins:
        x, y = pin.at_mm
        half = board.connector.pad_mm / 2
        round_edges = 0 if pin.number == 1 else half
        parts.append(
            f'<rect x="{x - half:.3f}" y="{-y - half:.3f}" width="{2 * half:g}" height="{2 * half:g}"'
            f' rx="{round_edges:g}" fill="#d9c27a"/>'
        )
        parts.append(f'<circle cx="{x:.3f}" cy="{-y:.3f}" r="{board.connector.drill_mm / 2:g}" fill="#222"/>')
    for hole in board.holes:
        x, y = hole.at_mm
        parts.append(f'<circle cx="{x:.3f}" cy="{-y:.3f}" r="{hole.diameter_mm / 2:g}" fill="#fff"/>')
    names = "".join(
        "M" + "L".join(f"{x:.3f} {-y:.3f}" for x, y in line) for label in board.labels for line in label_strokes(label)
    )
    x, y = board.mark_mm
    parts += [
        f'<path d="{names}" stroke="#fff" stroke-width="0.15"/>',
        f'<circle cx="{x:.3f}" cy="{-y:.3f}" r="0.5" fill="#fff"/>',
        "</svg>",
        "",
    ]
    return "\n".join(parts)
