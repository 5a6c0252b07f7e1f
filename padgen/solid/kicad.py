"""Write a board as KiCad files: ``.kicad_pcb`` (version 6) and ``.kicad_pro`` with the board house's design rules.

Identifiers of items are numbers of their order, so that the same board gives the same bytes.
"""

import json
from collections.abc import Iterable, Iterator
from typing import Any
from uuid import NAMESPACE_URL, uuid5

from padgen.planner.board_layout import LABEL_MM, Board

__all__ = ["layer_names", "pcb_text", "project_text"]

VERSION = 20211014
ORIGIN_MM = (150.0, 100.0)
"""Place of the pad's centre on KiCad's sheet, whose y runs down."""
STROKE_MM = 0.15
"""Width of lines on the silkscreen."""
FIXED_LAYERS = (
    (37, "F.SilkS", 'user "F.Silkscreen"'),
    (38, "B.Mask", "user"),
    (39, "F.Mask", "user"),
    (36, "B.SilkS", 'user "B.Silkscreen"'),
    (44, "Edge.Cuts", "user"),
    (46, "B.CrtYd", 'user "B.Courtyard"'),
    (47, "F.CrtYd", 'user "F.Courtyard"'),
    (48, "B.Fab", "user"),
    (49, "F.Fab", "user"),
)


def layer_names(count: int) -> tuple[str, ...]:
    """Return KiCad's names of `count` copper layers, from the top."""
    return ("F.Cu", *(f"In{k}.Cu" for k in range(1, count - 1)), "B.Cu")


def pcb_text(board: Board) -> str:
    """Return the text of the ``.kicad_pcb``."""
    return "\n".join(("(kicad_pcb", *_lines(board), ")", ""))


def _lines(board: Board) -> Iterator[str]:
    number = _identifiers(board.name)
    names = layer_names(board.layers)
    yield f"  (version {VERSION}) (generator padgen)"
    yield f"  (general (thickness {_mm(board.thickness_mm)}))"
    yield '  (paper "A3")'
    yield "  (layers"
    for k, name in enumerate(names):
        yield f'    ({31 if name == "B.Cu" else k} "{name}" signal)'
    for index, name, kind in sorted(FIXED_LAYERS):
        yield f'    ({index} "{name}" {kind})'
    yield "  )"
    yield "  (setup (pad_to_mask_clearance 0.05))"
    yield '  (net 0 "")'
    for k, net in enumerate(board.nets):
        yield f'  (net {k + 1} "{net}")'
    yield from _connectors(board, number)
    for k, hole in enumerate(board.holes):
        yield f'  (footprint "padgen:hole" (layer "F.Cu") (tstamp {next(number)}) (at {_at(hole.at_mm)})'
        yield "    (attr exclude_from_pos_files exclude_from_bom)"
        yield f'    (fp_text reference "H{k + 1}" (at 0 0) (layer "F.Fab") {_effects()} (tstamp {next(number)}))'
        yield f'    (fp_text value "hole" (at 0 0) (layer "F.Fab") hide {_effects()} (tstamp {next(number)}))'
        size = _mm(hole.diameter_mm)
        yield (
            f'    (pad "" np_thru_hole circle (at 0 0) (size {size} {size}) (drill {size}) (layers "*.Cu" "*.Mask")'
            f" (tstamp {next(number)})))"
        )
    x0, y0, x1, y1 = board.outline_mm
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        yield f'  (gr_line (start {_at(a)}) (end {_at(b)}) (layer "Edge.Cuts") (width 0.1) (tstamp {next(number)}))'
    mark = board.mark_mm
    yield (
        f'  (gr_circle (center {_at(mark)}) (end {_at((mark[0] + 0.5, mark[1]))}) (layer "F.SilkS") (width {STROKE_MM})'
        f" (fill solid) (tstamp {next(number)}))"
    )
    for label in board.labels:
        angle = f" {_mm(label.angle)}" if label.angle else ""
        yield (
            f'  (gr_text "{label.text}" (at {_at(label.at_mm)}{angle}) (layer "F.SilkS") (tstamp {next(number)})'
            f" {_effects()})"
        )
    for track in board.tracks:
        ends = f"(start {_at(track.start_mm)})"
        if track.middle_mm is not None:
            ends += f" (mid {_at(track.middle_mm)})"
        kind = "segment" if track.middle_mm is None else "arc"
        yield (
            f"  ({kind} {ends} (end {_at(track.end_mm)}) (width {_mm(track.width_mm)})"
            f' (layer "{names[track.layer]}") (net {track.net}) (tstamp {next(number)}))'
        )
    for via in board.vias:
        yield (
            f"  (via (at {_at(via.at_mm)}) (size {_mm(via.size_mm)}) (drill {_mm(via.drill_mm)})"
            f' (layers "F.Cu" "B.Cu") (net {via.net}) (tstamp {next(number)}))'
        )


def _connectors(board: Board, number: Iterator[str]) -> Iterator[str]:
    """Yield the KiCad text of the connectors, two rows of pins each."""
    pad_mm = board.connector.pad_mm
    for connector in sorted({pin.connector for pin in board.pins}):
        pins = [pin for pin in board.pins if pin.connector == connector]
        first = pins[0].at_mm
        name = f"{board.connector.name}-2x{len(pins) // 2}"
        yield f'  (footprint "padgen:{name}" (layer "F.Cu") (tstamp {next(number)}) (at {_at(first)})'
        yield "    (attr through_hole)"
        yield (
            f'    (fp_text reference "J{connector + 1}" (at -2.6 0) (layer "F.SilkS") {_effects()}'
            f" (tstamp {next(number)}))"
        )
        yield f'    (fp_text value "{name}" (at 0 0) (layer "F.Fab") hide {_effects()} (tstamp {next(number)}))'
        for pin in pins:
            x = _mm(pin.at_mm[0] - first[0])
            y = _mm(first[1] - pin.at_mm[1])
            shape = "rect" if pin.number == 1 else "circle"
            yield (
                f'    (pad "{pin.number}" thru_hole {shape} (at {x} {y}) (size {_mm(pad_mm)} {_mm(pad_mm)})'
                f' (drill {_mm(board.connector.drill_mm)}) (layers "*.Cu" "*.Mask")'
                f' (net {pin.net} "{board.nets[pin.net - 1]}")'
                f" (tstamp {next(number)}))"
            )
        yield "  )"


def _effects() -> str:
    return f"(effects (font (size {LABEL_MM} {LABEL_MM}) (thickness {STROKE_MM})))"


def _identifiers(name: str) -> Iterator[str]:
    k = 0
    while True:
        yield str(uuid5(NAMESPACE_URL, f"padgen board {name} {k}"))
        k += 1


def _at(point: Iterable[float]) -> str:
    """Return a place, in mm from the pad's centre, as text in the coordinates of KiCad's sheet."""
    x, y = point
    return f"{_mm(ORIGIN_MM[0] + x)} {_mm(ORIGIN_MM[1] - y)}"


def _mm(value: float) -> str:
    """Return a length in mm as text to a nanometre, as KiCad stores it."""
    return f"{round(value, 6) + 0.0:.6f}".rstrip("0").rstrip(".")


def project_text(board: Board, house: dict[str, Any]) -> str:
    """Return the text of the ``.kicad_pro``: a board house's design rules, with every design-rule check left on."""
    ring_mm = round((house["via_mm"] - house["drill_mm"]) / 2, 6)
    net_class = {
        "clearance": house["space_mm"],
        "name": "Default",
        "track_width": house["track_mm"],
        "via_diameter": house["via_mm"],
        "via_drill": house["drill_mm"],
    }
    rules = {
        "min_clearance": house["space_mm"],
        "min_track_width": house["track_mm"],
        "min_via_diameter": house["via_mm"],
        "min_via_annular_width": ring_mm,
        "min_through_hole_diameter": house["drill_mm"],
        "min_copper_edge_clearance": house["edge_mm"],
        "min_hole_clearance": house["space_mm"],
        "min_hole_to_hole": house["space_mm"],
        "min_silk_clearance": 0.0,
        "allow_blind_buried_vias": False,
        "allow_microvias": False,
    }
    project = {
        "board": {"design_settings": {"rules": rules, "defaults": {}, "meta": {"version": 2}}, "layer_presets": []},
        "meta": {"filename": f"{board.name}.kicad_pro", "version": 1},
        "net_settings": {"classes": [net_class], "meta": {"version": 2}},
    }
    return json.dumps(project, indent=2) + "\n"
