"""Write a board as Gerber X2 and Excellon files, which any board house takes.

Every copper layer, solder mask and silkscreen, the outline and the two kinds of holes is one file, named by layer.
Formats: Ucamco, The Gerber Layer Format Specification (2021.02); IPC-NC-349 for holes. Arcs are full-quadrant (G75).
"""

from collections.abc import Iterable
from itertools import pairwise

from padgen.planner.board_layout import LABEL_MM, Board, Label, arc_centre

__all__ = ["drill_text", "gerber_files", "label_strokes"]

MASK_MM = 0.05
"""Width by which the solder mask stays away from pads."""
STROKE_MM = 0.15
OUTLINE_MM = 0.1

Point = tuple[float, float]


class _Layer:
    """The commands of one Gerber file; apertures are numbered as they are first used."""

    def __init__(self, function: str, polarity: str = "Positive") -> None:
        self._function = function
        self._polarity = polarity
        self._apertures: dict[tuple[str, str], int] = {}
        self._commands: list[str] = []
        self._current = 0

    def _select(self, shape: str, function: str) -> None:
        number = self._apertures.setdefault((shape, function), 10 + len(self._apertures))
        if number != self._current:
            self._commands.append(f"D{number}*")
            self._current = number

    def flash(self, at: Point, shape: str, function: str, net: str = "") -> None:
        """Add a copper pad or mask opening at a place, shaped as an aperture such as ``C,1.7`` (a 1.7 mm circle)."""
        self._select(shape, function)
        self._net(net)
        self._commands.append(f"{_at(at)}D03*")

    def draw(
        self, start: Point, end: Point, width_mm: float, function: str, middle: Point | None = None, net: str = ""
    ) -> None:
        """Add a straight line, or an arc through `middle`."""
        self._select(f"C,{_number(width_mm)}", function)
        self._net(net)
        self._commands.append(f"{_at(start)}D02*")
        if middle is None:
            self._commands.append(f"G01*\n{_at(end)}D01*")
            return
        centre = arc_centre(start, middle, end)
        left = (middle[0] - start[0]) * (end[1] - start[1]) - (middle[1] - start[1]) * (end[0] - start[0]) > 0
        # Counterclockwise where the middle lies to the right of the chord.
        turn = "G03" if left else "G02"
        i, j = (_number_6(c - s) for c, s in zip(centre, start, strict=True))
        self._commands.append(f"{turn}*\n{_at(end)}I{i}J{j}D01*")

    def _net(self, net: str) -> None:
        if net:
            self._commands.append(f"%TO.N,{net}*%")

    def text(self) -> str:
        lines = [
            "%TF.GenerationSoftware,padgen*%",
            "%TF.SameCoordinates,padgen*%",
            f"%TF.FileFunction,{self._function}*%",
            f"%TF.FilePolarity,{self._polarity}*%",
            "%FSLAX46Y46*%",
            "%MOMM*%",
            "%LPD*%",
            "G75*",
            "G01*",
        ]
        for (shape, function), number in self._apertures.items():
            lines += [f"%TA.AperFunction,{function}*%", f"%ADD{number}{shape}*%", "%TD*%"]
        return "\n".join((*lines, *self._commands, "%TD*%", "M02*", ""))


def gerber_files(board: Board) -> dict[str, str]:
    """Return the texts of a board's Gerber and drill files, keyed by the end of the file's name."""
    files = {}
    for k in range(board.layers):
        side = "Inr"
        if k == 0:
            side = "Top"
        elif k == board.layers - 1:
            side = "Bot"
        layer = _Layer(f"Copper,L{k + 1},{side}")
        for track in board.tracks:
            if track.layer == k:
                net = board.nets[track.net - 1]
                layer.draw(track.start_mm, track.end_mm, track.width_mm, "Conductor", track.middle_mm, net)
        for via in board.vias:
            layer.flash(via.at_mm, f"C,{_number(via.size_mm)}", "ViaPad", board.nets[via.net - 1])
        for pin in board.pins:
            layer.flash(pin.at_mm, _pad(pin.number, board.connector.pad_mm), "ComponentPad", board.nets[pin.net - 1])
        files[f"copper-{k + 1}.gbr"] = layer.text()
    for side in ("top", "bottom"):
        mask = _Layer(f"Soldermask,{'Top' if side == 'top' else 'Bot'}", "Negative")
        for pin in board.pins:
            mask.flash(pin.at_mm, _pad(pin.number, board.connector.pad_mm + 2 * MASK_MM), "Material")
        for hole in board.holes:
            mask.flash(hole.at_mm, f"C,{_number(hole.diameter_mm + 2 * MASK_MM)}", "Material")
        files[f"mask-{side}.gbr"] = mask.text()
    silk = _Layer("Legend,Top")
    for label in board.labels:
        for line in label_strokes(label):
            for a, b in pairwise(line):
                silk.draw(a, b, STROKE_MM, "Material")
    silk.flash(board.mark_mm, "C,1.", "Material")
    files["silk-top.gbr"] = silk.text()
    outline = _Layer("Profile,NP")
    x0, y0, x1, y1 = board.outline_mm
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
    for a, b in pairwise(corners):
        outline.draw(a, b, OUTLINE_MM, "Profile")
    files["outline.gbr"] = outline.text()
    plated = [(via.drill_mm, via.at_mm) for via in board.vias]
    plated += [(board.connector.drill_mm, pin.at_mm) for pin in board.pins]
    files["plated.drl"] = drill_text(f"Plated,1,{board.layers},PTH", plated)
    files["holes.drl"] = drill_text(
        f"NonPlated,1,{board.layers},NPTH", [(hole.diameter_mm, hole.at_mm) for hole in board.holes]
    )
    return files


def drill_text(function: str, holes: Iterable[tuple[float, Point]]) -> str:
    """Return the text of an Excellon drill file in mm for `holes`, each a diameter and a place."""
    by_size: dict[float, list[Point]] = {}
    for size, at in holes:
        by_size.setdefault(size, []).append(at)
    lines = ["M48", f"; #@! TF.FileFunction,{function}", "FMAT,2", "METRIC,TZ"]
    lines += [f"T{k + 1}C{size:.3f}" for k, size in enumerate(sorted(by_size))]
    lines += ["%", "G90", "G05"]
    for k, size in enumerate(sorted(by_size)):
        lines.append(f"T{k + 1}")
        lines += [f"X{x:.3f}Y{y:.3f}" for x, y in by_size[size]]
    return "\n".join((*lines, "T0", "M30", ""))


def _pad(number: int, size_mm: float) -> str:
    """Return the Gerber aperture of a pin's copper pad: square for pin 1, else round."""
    size = _number(size_mm)
    return f"R,{size}X{size}" if number == 1 else f"C,{size}"


def _at(point: Point) -> str:
    return f"X{_number_6(point[0])}Y{_number_6(point[1])}"


def _number_6(value: float) -> int:
    """Return a length in mm as whole nanometres, the unit of the file."""
    return round(value * 1e6)


def _number(value: float) -> str:
    return f"{value:.4f}".rstrip("0")


GLYPHS = {
    "0": ((0, 0), (4, 0), (4, 6), (0, 6), (0, 0)),
    "1": ((1, 5), (2, 6), (2, 0)),
    "2": ((0, 6), (4, 6), (4, 3), (0, 3), (0, 0), (4, 0)),
    "3": ((0, 6), (4, 6), (4, 3), (1, 3), (4, 3), (4, 0), (0, 0)),
    "4": ((0, 6), (0, 3), (4, 3), (4, 6), (4, 0)),
    "5": ((4, 6), (0, 6), (0, 3), (4, 3), (4, 0), (0, 0)),
    "6": ((4, 6), (0, 6), (0, 0), (4, 0), (4, 3), (0, 3)),
    "7": ((0, 6), (4, 6), (2, 0)),
    "8": ((0, 3), (0, 0), (4, 0), (4, 6), (0, 6), (0, 3), (4, 3)),
    "9": ((4, 3), (0, 3), (0, 6), (4, 6), (4, 0)),
    "c": ((4, 4), (0, 4), (0, 0), (4, 0)),
    "r": ((0, 0), (0, 4), (3, 4)),
}
"""Characters of a label as lines on a grid of 4 × 6."""
ADVANCE = 6


def label_strokes(label: Label) -> list[list[Point]]:
    """Return the polylines in mm that draw a label's text on the silkscreen, at its place and angle (0 or 90°)."""
    scale = LABEL_MM / 6
    width = ADVANCE * len(label.text) - 2
    lines = []
    for k, character in enumerate(label.text):
        points = [((x + ADVANCE * k - width / 2) * scale, (y - 3) * scale) for x, y in GLYPHS[character]]
        if label.angle:
            points = [(-y, x) for x, y in points]
        lines.append([(label.at_mm[0] + x, label.at_mm[1] + y) for x, y in points])
    return lines
