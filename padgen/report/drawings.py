"""Drawings of the pad to scale, in mm: both sides, a section through a taxel, the parts in a stack, the wiring.

Everything is drawn from the plan, in two dimensions. Parts have their names as the artists' ``gid``.
"""

from collections.abc import Iterable, Sequence
from itertools import groupby
from math import cos, pi, sin
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from padgen.core.display import COLOURS, INK, PALE
from padgen.core.errors import InfeasibleError, number
from padgen.planner.fixtures import coil_axis_mm, plan_tray, washer_underside_mm
from padgen.planner.suspensions import BeamPath, Segment
from padgen.planner.tile import Outline, corner_groove, outline, to_cell

if TYPE_CHECKING:
    from padgen.planner.plan import Channel, Plan, Taxel

__all__ = ["draw_exploded", "draw_pad", "draw_section", "draw_wiring", "title_of"]

FILLS = {
    "frame": "#ece5d6",
    "plate": "#d8c9a3",
    "beam": COLOURS[4],
    "boss": "#bfa76a",
    "washer": "#5f7383",
    "coil": "#cf8a5b",
    "core": "#43474d",
    "tray": "#b9cad3",
    "screw": "#8d979f",
    "recess": "#ffffff",
    "window": "#ffffff",
    "behind": "#f6f2ea",
}
SMALL_PT, NAME_PT = 8.0, 9.0
CIRCLE = np.linspace(0, 2 * pi, 49)
Points = np.ndarray


def title_of(plan: "Plan", words: str) -> str:
    """Return a picture's title: the pad's name, in which a dollar sign begins no formula, and what is shown."""
    return plan.name.replace("$", r"\$") + f": {words}"


class Room(NamedTuple):
    """Space in inches around a drawing for its words, and the largest width and height of the whole picture."""

    left: float = 0.3
    right: float = 0.3
    below: float = 0.3
    above: float = 0.6
    width: float = 9.0
    height: float = 7.5


class Sheet:
    """A figure with a single axis in mm, to scale, without ticks; `mm` is how many mm an inch shows."""

    def __init__(self, title: str, area: Outline, room: Room) -> None:
        from matplotlib.figure import Figure

        wide, deep = area.x1 - area.x0, area.y1 - area.y0
        self.mm = max(wide / (room.width - room.left - room.right), deep / (room.height - room.below - room.above))
        size = (wide / self.mm + room.left + room.right, deep / self.mm + room.below + room.above)
        self.figure = Figure(figsize=size)
        self.axis = axis = self.figure.add_axes((0, 0, 1, 1))
        axis.set_axis_off()
        axis.set_xlim(area.x0 - room.left * self.mm, area.x1 + room.right * self.mm)
        axis.set_ylim(area.y0 - room.below * self.mm, area.y1 + room.above * self.mm)
        self.figure.suptitle(title, x=0.15 / size[0], y=1 - 0.12 / size[1], ha="left", va="top")

    def part(self, name: str, shapes: Iterable[Points], **style: Any) -> Any:
        """Draw polygons (n, 2) in mm as one artist, filled as the part of this name is."""
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path

        path = Path.make_compound_path(*(Path(np.vstack([shape, shape[:1]]), closed=True) for shape in shapes))
        style = {"facecolor": FILLS.get(name, "none"), "edgecolor": INK, "linewidth": 0.6, **style}
        return self.axis.add_patch(PathPatch(path, gid=name, **style))

    def words(self, x: float, y: float, text: str, **style: Any) -> Any:
        """Write text at a place in mm, centred unless `style` says otherwise."""
        return self.axis.text(x, y, text, **{"ha": "center", "va": "center", "fontsize": SMALL_PT, **style})

    def dimension(self, ends: tuple[float, float], at: float, start: float, text: str = "", tall: bool = False) -> None:
        """Draw a dimension line along x (or, `tall`, along z) at `at`, from lines that begin at `start`."""
        turn = slice(None, None, -1 if tall else 1)
        for end in ends:
            self.axis.plot(*[(end, end), (start, at)][turn], color=PALE, linewidth=0.5)
        arrow = {"arrowstyle": "<->", "color": INK, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 6}
        places = [(end, at)[turn] for end in ends]
        self.axis.annotate("", *places, arrowprops=arrow)
        if text:
            side = {"rotation": 90, "ha": "right"} if tall else {"va": "bottom"}
            gap = 0.04 * self.mm * (-1 if tall else 1)
            bare = {"color": "white", "pad": 0.6}  # hides the lines that other dimensions begin with
            self.words(*(sum(ends) / 2, at + gap)[turn], text, bbox=bare, **side)

    def column(self, x: float, to_right: bool, notes: Sequence[tuple[str, str, str, tuple[float, float]]]) -> None:
        """Write notes (part, name, sentence, place that is meant) below each other at `x`, with lines to the places."""
        notes = sorted(notes, key=lambda note: -note[3][1])
        heights = [self.mm * (0.24 + 0.135 * (note[2].count("\n") + bool(note[2]))) for note in notes]
        tops, low = [], np.inf
        for note, height in zip(notes, heights, strict=True):
            tops.append(min(low, note[3][1] + height / 2))
            low = tops[-1] - height
        # What the lowest were pushed down for want of room, all come up by half of.
        shift = max(notes[-1][3][1] - heights[-1] / 2 - low, 0.0) / 2
        ha, out = ("left", 0.08 * self.mm) if to_right else ("right", -0.08 * self.mm)
        for (part, name, sentence, place), top in zip(notes, tops, strict=True):
            y = top + shift - 0.1 * self.mm
            self.axis.annotate(
                "",
                place,
                (x, y),
                gid=f"to {part}",
                arrowprops={"arrowstyle": "-", "color": PALE, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0},
            )
            self.axis.plot(*place, ".", color=INK, markersize=3, zorder=9)
            self.words(x + out, y, name, ha=ha, fontsize=NAME_PT, weight="bold" if sentence else "normal")
            self.words(x + out, y - 0.09 * self.mm, sentence, ha=ha, va="top", color="#555555")


def rectangle(x0: float, x1: float, y0: float, y1: float) -> Points:
    """Return the corners (4, 2) of a rectangle."""
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def circle(x: float, y: float, diameter: float) -> Points:
    """Return points (n, 2) of a circle."""
    return np.stack([x + diameter / 2 * np.cos(CIRCLE), y + diameter / 2 * np.sin(CIRCLE)], -1)


def beam_outline(path: BeamPath, fillet_mm: float) -> Points:
    """Return the outline (n, 2) of a beam with the fillets of its root, in the taxel's own axes."""
    ends = []
    for side in (1, -1):
        half = float(path.width_mm) / 2
        flare = [
            path.corners[0].along(Segment(fillet_mm * (1 - cos(a)))).beside(side * (half + fillet_mm * (1 - sin(a))))
            for a in np.linspace(0, pi / 2, 6)
        ]
        along = [
            path.within(k, share).beside(side * half)
            for k, segment in enumerate(path.segments)
            for share in np.linspace(0, 1, 13 if segment.turn_rad else 2)
        ]
        ends.append((flare if fillet_mm else along[:1]) + along[1:])
    return np.array(ends[0] + ends[1][::-1], float)


def taxel_shapes(plan: "Plan", channel: "Channel") -> dict[str, list[Points]]:
    """Return the outlines of a taxel's parts from above, by name, in its own axes."""
    arrangement, plate = plan.arrangement(channel), plan.plate
    length, width = (float(v) for v in arrangement.window_mm)
    x, washer = float(arrangement.washer_x_mm), plan.spec.washer
    bore = [circle(x, 0, washer.inner_diameter_mm)[::-1]] if washer.inner_diameter_mm else []
    return {
        "window": [rectangle(0, length, -width / 2, width / 2)],
        "beam": [beam_outline(path, channel.beam.fillet_mm) for path in arrangement.beams],
        "plate": [rectangle(*(float(v) for v in block[:4])) for block in arrangement.blocks],
        "recess": [circle(x, 0, plate.recess_diameter_mm)],
        "washer": [circle(x, 0, washer.outer_diameter_mm), *bore],
        "boss": [circle(x, 0, plate.boss_diameter_mm)],
    }


def on_pad(plan: "Plan", taxel: "Taxel", points: Points) -> Points:
    """Turn and shift points (n, 2) from a taxel's own axes to the pad's."""
    placed = to_cell(points, plan.channels[taxel.channel])
    return np.array(coil_axis_mm(plan.coils, *taxel.coil)) + (-placed if taxel.turned else placed)


def all_shapes(plan: "Plan", names: Sequence[str]) -> dict[str, list[Points]]:
    """Return the outlines of these parts of all taxels, in the pad's axes."""
    own = [taxel_shapes(plan, channel) for channel in plan.channels]
    return {name: [on_pad(plan, t, shape) for t in plan.taxels for shape in own[t.channel][name]] for name in names}


def border(plan: "Plan", grow: float = 1.0) -> Points:
    """Return the corners (4, 2) of the pad, or with `grow` 0 of its active area."""
    pad = plan.spec.pad
    x, y = (side / 2 + grow * pad.border_mm for side in (pad.width_mm, pad.depth_mm))
    return rectangle(-x, x, -y, y)


def draw_pad(plan: "Plan") -> Any:
    """Draw the pad from the touch side and, turned over about its y axis, from below."""
    pad = plan.spec.pad
    wide, deep = (side + 2 * pad.border_mm for side in (pad.width_mm, pad.depth_mm))
    apart = wide + 0.12 * wide
    area = Outline(-wide / 2, apart + wide / 2, -deep / 2, deep / 2)
    sheet = Sheet(title_of(plan, "the printed pad, in mm"), area, Room(left=0.75, below=1.1, above=0.85, width=10.0))
    hole = [circle(x, y, pad.hole_diameter_mm) for x, y in (border(plan) + border(plan, 0)) / 2]
    shapes = all_shapes(plan, ("window", "beam", "plate", "boss", "recess", "washer"))
    radius = pad.border_mm / 2
    corners = (border(plan) - np.sign(border(plan)) * radius)[[2, 3, 0, 1]]
    turns = [CIRCLE[:13] + k * pi / 2 for k in range(4)]
    rounded = np.vstack(
        [c + radius * np.stack([np.cos(t), np.sin(t)], -1) for c, t in zip(corners, turns, strict=True)]
    )
    thin = {"linewidth": 0.3 if len(plan.taxels) > MANY else 0.6}
    for shift, mirror, names in (
        (0.0, 1.0, ("window", "beam", "plate", "boss")),
        (apart, -1.0, ("window", "plate", "beam", "recess", "washer")),
    ):
        place = np.array([mirror, 1.0])

        def seen(them: list[Points], shift: float = shift, place: Points = place) -> list[Points]:
            return [shape * place + (shift, 0) for shape in them]

        sheet.part("frame", seen([rounded]))
        if pad.hole_diameter_mm:
            sheet.part("window", seen(hole))
        groove = corner_groove(plan.spec)
        sheet.part("groove", seen([rectangle(groove.x0, groove.x1, -deep / 2, groove.y1)]), facecolor=INK)
        for name in names:
            sheet.part(name, seen(shapes[name]), **thin)
        side = "touch side: bosses to feel" if mirror > 0 else "underside: beams, recesses and washers"
        sheet.words(shift, deep / 2 + 0.12 * sheet.mm, side, va="bottom", fontsize=NAME_PT, weight="bold")
    step, low = 0.3 * sheet.mm, -deep / 2
    sheet.dimension((-pad.width_mm / 2, pad.width_mm / 2), low - step, -pad.depth_mm / 2, f"{number(pad.width_mm)}")
    sheet.dimension((-wide / 2, wide / 2), low - 2 * step, low, f"{number(wide)}")
    sheet.dimension((-deep / 2, deep / 2), -wide / 2 - step, -wide / 2, f"{number(deep)}", tall=True)
    holes = f", holes {number(pad.hole_diameter_mm)}" if pad.hole_diameter_mm else ""
    told = f"frame {number(pad.frame_thickness_mm)} high, border {number(pad.border_mm)} wide{holes};"
    told += f" washers {number(plan.spec.washer.outer_diameter_mm)} across; black: the groove that marks a corner"
    sheet.words(-wide / 2, low - 2 * step - 0.2 * sheet.mm, told, ha="left", va="top")
    return sheet.figure


MANY = 128
"""More taxels than these are drawn with thinner lines."""


def draw_section(plan: "Plan") -> Any:
    """Draw the taxel of the lowest channel from the touch side and, below, cut along its beam, to one scale."""
    channel, spec, plate = plan.channels[0], plan.spec, plan.plate
    coil, washer, thick = spec.coil, spec.washer, spec.pad.frame_thickness_mm
    own, arrangement, shapes = outline(plan, channel), plan.arrangement(channel), taxel_shapes(plan, channel)
    length, x = float(arrangement.window_mm[0]), float(arrangement.washer_x_mm)
    thin, low = channel.beam.thickness_mm, washer_underside_mm(plan)
    roof, top = low + washer.thickness_mm, low - coil.gap_mm
    coil_x, coil_y = coil_place(channel)
    bottom, reach = top - coil.length_mm, coil.outer_diameter_mm / 2
    left, right = min(own.x0, coil_x - reach), max(own.x1, coil_x + reach)
    # Room for a line of words and a dimension between both views, at whichever scale comes out.
    apart = max(0.13 * (right - left), 0.08 * (plate.boss_top_mm - bottom + own.y1 - own.y0))
    lift = plate.boss_top_mm + apart - own.y0
    room = Room(left=2.3, right=2.75, below=0.35, above=0.95, width=9.2, height=7.6)
    title = (
        f"one taxel from the touch side and, below, cut along its beam (mm; channel 0, {channel.resonance_hz:.4g} Hz)"
    )
    sheet = Sheet(title_of(plan, title), Outline(left, right, bottom, own.y1 + lift), room)

    from_above = np.array([0.0, lift])
    sheet.part("view", [rectangle(*own) + from_above], facecolor=FILLS["frame"])
    for name in ("window", "beam", "plate", "boss"):
        sheet.part(f"{name} from above", [s + from_above for s in shapes[name]], facecolor=FILLS[name])
    hidden = {"facecolor": "none", "linestyle": (0, (4, 2)), "edgecolor": FILLS["washer"]}
    sheet.part("washer from above", [shapes["washer"][0] + from_above], **hidden)
    under = sheet.part("coil from above", [circle(coil_x, coil_y + lift, 2 * reach)], **hidden)
    under.set(edgecolor=FILLS["coil"], clip_path=sheet.axis.patches[0])
    sheet.axis.plot([own.x0, own.x1], [lift, lift], color=INK, linewidth=0.7, linestyle=(0, (8, 2, 1, 2)), zorder=8)
    sheet.words(own.x1 + 0.05 * sheet.mm, lift, "cut", ha="left")
    sheet.words(own.x0, own.y0 + lift - 0.05 * sheet.mm, "dashed: washer and coil below", ha="left", va="top")

    cut, behind = beam_cuts(shapes["beam"]), np.concatenate(shapes["beam"])[:, 0]
    sheet.part("behind", [rectangle(0, length, 0, thick)], linewidth=0.4)
    sheet.part("beam behind", [rectangle(behind.min(), behind.max(), 0, thin)], facecolor="#f6ddaa", linewidth=0.4)
    sheet.part("frame", [rectangle(own.x0, 0, 0, thick), rectangle(length, own.x1, 0, thick)])
    sheet.part("beam", [rectangle(*ends, 0, thin) for ends in cut] or [rectangle(behind.min(), behind.max(), 0, thin)])
    blocks = [[float(v) for v in b] for b in arrangement.blocks if float(b.low_y_mm) < 0 < float(b.high_y_mm)]
    sheet.part("plate", [rectangle(b[0], b[1], 0, b[4]) for b in blocks])
    hollow, post = plate.recess_diameter_mm / 2, plate.post_diameter_mm / 2
    sheet.part("recess", [rectangle(x - hollow, x + hollow, 0, plate.recess_depth_mm)])
    if post:
        sheet.part("post", [rectangle(x - post, x + post, 0, plate.recess_depth_mm)], facecolor=FILLS["plate"])
    half, edge, peak = plate.boss_diameter_mm / 2, plate.boss_edge_mm, plate.boss_top_mm
    across = np.array([-half, half, half, half - edge, edge - half, -half])
    levels = [plate.thickness_mm] * 2 + [peak - edge, peak, peak, peak - edge]
    sheet.part("boss", [np.stack([x + across, levels], -1)])
    outer, bore = washer.outer_diameter_mm / 2, washer.inner_diameter_mm / 2
    sheet.part("washer", [rectangle(x + s * bore, x + s * outer, low, roof) for s in (-1, 1)])
    inner, core = coil.inner_diameter_mm / 2, coil.core_diameter_mm / 2
    sheet.part("coil", [rectangle(coil_x + s * inner, coil_x + s * reach, bottom, top) for s in (-1, 1)])
    if core:
        sheet.part("core", [rectangle(coil_x - core, coil_x + core, bottom, top)])
    middle = (length + own.x1) / 2

    beam_x = sum(cut[0]) / 2 if cut else (behind.min() + blocks[0][0]) / 2
    steel, wire = x + (bore + outer) / 2, coil_x + (inner + reach) / 2
    wall = max((x + hollow + blocks[0][1]) / 2, x + half)
    around = f"steel, {number(2 * outer)} x {number(2 * bore)} x {number(washer.thickness_mm)};\nglued in, and pulled by the coil"
    notes = [
        ("boss", "boss", "what the finger feels", (x + half / 2, (peak + plate.thickness_mm) / 2)),
        ("plate", "plate", "swings up and down\nwith boss and washer", (wall, 0.8 * plate.thickness_mm)),
        ("frame", "frame", "holds all taxels; printed in one piece\nwith beams, plates and bosses", (middle, thick / 2)),
        ("washer", "washer", around, (steel, (low + roof) / 2)),
        ("gap", "gap", "air between washer and coil", (steel, (low + top) / 2)),
        ("core", "core", f"iron, {number(2 * core)} across: leads the field up", (coil_x + core / 2, top - coil.length_mm / 4)),
        ("coil", "coil", f"copper, {number(2 * reach)} across: the frequency\nof its current chooses among taxels", (wire, (top + bottom) / 2)),
    ]  # fmt: skip
    sheet.column(right + 0.35 * sheet.mm, True, [note for note in notes if core or note[0] != "core"])

    step, beam = 0.2 * sheet.mm, arrangement.beams[0]
    beside, wide = lift + float(beam.root_mm[1]), float(beam.width_mm) / 2
    sizes = [
        ("boss", "high", 1, plate.thickness_mm, peak, x - half),
        ("frame", "high", 1, 0.0, thick, own.x0),
        ("beam", "thick", 2, 0.0, thin, 0.0),
        ("gap", "", 1, top, low, coil_x - reach),
        ("coil", "high", 1, bottom, top, coil_x - reach),
        ("beam", "wide", 1, beside - wide, beside + wide, float(beam.root_mm[0])),
    ]
    for _, _, place, start, end, beginning in sizes:
        sheet.dimension((start, end), left - place * step, beginning, tall=True)
    told = [
        (f"{name} size", f"{name} {end - start:.3g} {word}".strip(), "", (left - place * step, (start + end) / 2))
        for name, word, place, start, end, _ in sizes
    ]
    told.append(("beam", "beam", "the spring: its width,\nthickness and length\nset the frequency", (beam_x, thin / 2)))
    sheet.column(left - 3 * step, False, told)
    if np.hypot(coil_y, 0) > SAME_PLACE_MM:
        sheet.words(coil_x, bottom - 0.08 * sheet.mm, "cut through its axis, which lies beside the beam", va="top")
    above, first = own.y1 + lift, shapes["beam"][0][:, 0]
    long = f"beam {float(beam.length_mm):.3g} long" + ("" if beam.is_straight else ", along its path")
    sheet.dimension((float(first.min()), float(first.max())), above + 0.1 * sheet.mm, lift, long)
    sheet.dimension(
        (blocks[0][0], blocks[0][1]), above + 0.32 * sheet.mm, lift, f"plate {blocks[0][1] - blocks[0][0]:.3g}"
    )
    sheet.dimension((x - half, x + half), peak + 0.08 * sheet.mm, peak, f"boss {2 * half:.3g}")
    return sheet.figure


def coil_place(channel: "Channel") -> tuple[float, float]:
    """Return the place of the coil's axis in the own axes of a channel's taxel."""
    ahead, aside = (to_cell(np.array([end]), channel)[0] - channel.site.origin_mm for end in ((1.0, 0.0), (0.0, 1.0)))
    away = -np.array(channel.site.origin_mm)
    return float(away @ ahead), float(away @ aside)


def beam_cuts(beams: Sequence[Points]) -> list[tuple[float, float]]:
    """Return where the plane y = 0 cuts beams of these outlines: stretches of x."""
    from matplotlib.path import Path

    x = np.linspace(min(b[:, 0].min() for b in beams), max(b[:, 0].max() for b in beams), CUT_POINTS)
    inside = np.any([Path(beam).contains_points(np.stack([x, 0 * x], -1)) for beam in beams], axis=0)
    runs = [[at for at, _ in run] for is_in, run in groupby(zip(x, inside, strict=True), lambda p: p[1]) if is_in]
    return [(float(run[0]), float(run[-1])) for run in runs]


CUT_POINTS, SAME_PLACE_MM = 4001, 0.05


LEFT_TURN, UP = np.radians(30), np.radians(24)
"""The direction that the stack is seen from: degrees about the vertical, and above the horizon."""


def projected(x: Any, y: Any, z: Any) -> Points:
    """Project places in mm onto the picture's plane, in parallel and from above: (n, 2)."""
    away = -np.sin(LEFT_TURN) * x + np.cos(LEFT_TURN) * y
    return np.stack(
        np.broadcast_arrays(np.cos(LEFT_TURN) * x + np.sin(LEFT_TURN) * y, z * np.cos(UP) + away * np.sin(UP)), -1
    )


def draw_exploded(plan: "Plan") -> Any:
    """Draw the parts above each other in the order in which they are put together, in parallel projection."""
    from matplotlib.colors import to_rgb

    spec, coils, thick = plan.spec, plan.coils, plan.spec.pad.frame_thickness_mm
    edges = border(plan)
    (x0, y0), (x1, y1) = edges.min(0), edges.max(0)
    try:
        tray = plan_tray(plan)
    except InfeasibleError:
        tray = None
    step = 0.8 * float(np.ptp(projected(*edges.T, 0.0)[:, 1]))
    faces: list[tuple[str, Points, float]] = []

    def disc(name: str, x: float, y: float, low: float, high: float, diameter: float, hole: float = 0.0) -> None:
        # The outline of the side: the front of the lower edge, then the back of the upper one.
        turned = CIRCLE + LEFT_TURN
        ring = np.cos(turned) * diameter / 2, np.sin(turned) * diameter / 2
        front, back = (slice(24, None), slice(None, 25))
        sides = [projected(x + ring[0][part], y + ring[1][part], z) for part, z in ((front, low), (back, high))]
        faces.append((name, np.vstack(sides), 0.8))
        faces.append((name, projected(x + ring[0], y + ring[1], high), 1.0))
        if hole:
            faces.append(("hole", projected(x + ring[0] * hole / diameter, y + ring[1] * hole / diameter, high), 1.0))

    def slab(name: str, low: float) -> float:
        high = low + (tray.height_mm if tray and name == "tray" else thick)
        faces.append((name, projected(np.array([x0, x1, x1, x0]), y0, np.array([low, low, high, high])), 0.85))
        faces.append((name, projected(x1, np.array([y0, y1, y1, y0]), np.array([low, low, high, high])), 0.7))
        faces.append((name, projected(*edges.T, high), 1.0))
        return high

    places = [coil_axis_mm(coils, r, c) for r in range(coils.rows - 1, -1, -1) for c in range(coils.columns)]
    taxels = sorted(plan.taxels, key=lambda t: np.sin(LEFT_TURN) * t.x_mm - np.cos(LEFT_TURN) * t.y_mm)
    holes = (edges + border(plan, 0)) / 2
    notes = []

    def note(part: str, name: str, sentence: str, z: float, place: Points | None = None) -> None:
        at = projected(x1, (y0 + y1) / 2, z) if place is None else place
        notes.append((part, name, sentence, tuple(at.tolist())))

    z = 0.0
    if tray:
        high = slab("tray", z)
        for x, y in places:
            faces.append(("socket", projected(*circle(x, y, tray.socket_diameter_mm).T, high), 1.0))
        note("tray", "1 tray", "printed: sockets that set the gap", high / 2)
        z = high + step / 2
    for x, y in places:
        disc("coil", x, y, z, z + spec.coil.length_mm, spec.coil.outer_diameter_mm)
        if spec.coil.core_diameter_mm:
            faces.append(("core", projected(*circle(x, y, spec.coil.core_diameter_mm).T, z + spec.coil.length_mm), 1.0))
    last = coil_axis_mm(coils, coils.rows // 2, coils.columns - 1)
    reach = spec.coil.outer_diameter_mm / 2 * 0.9
    count = coils.rows * coils.columns
    note("coil", f"{count} coils" if count > 1 else "1 coil", "an amplifier output each", 0,
         projected(last[0] + reach * np.cos(LEFT_TURN), last[1] + reach * np.sin(LEFT_TURN), z + spec.coil.length_mm / 2))  # fmt: skip
    z += spec.coil.length_mm + step
    for taxel in taxels:
        disc(
            "washer",
            taxel.x_mm,
            taxel.y_mm,
            z,
            z + spec.washer.thickness_mm,
            spec.washer.outer_diameter_mm,
            spec.washer.inner_diameter_mm,
        )
    out = max(plan.taxels, key=lambda t: (t.x_mm, -abs(t.y_mm)))
    rim = (spec.washer.outer_diameter_mm + spec.washer.inner_diameter_mm) / 4
    note(
        "washer",
        f"{len(taxels)} washers",
        "glued into the plates from below",
        0,
        projected(out.x_mm + rim, out.y_mm, z + spec.washer.thickness_mm),
    )
    z = slab("frame", z + step)
    shapes = [taxel_shapes(plan, channel) for channel in plan.channels]
    for taxel in taxels:
        for name, height in (("window", thick), ("plate", plan.plate.thickness_mm)):
            for shape in shapes[taxel.channel][name]:
                faces.append(
                    (
                        "inside" if name == "window" else name,
                        projected(*on_pad(plan, taxel, shape).T, z - thick + height),
                        1.0,
                    )
                )
        disc(
            "boss",
            taxel.x_mm,
            taxel.y_mm,
            z - thick + plan.plate.thickness_mm,
            z - thick + plan.plate.boss_top_mm,
            plan.plate.boss_diameter_mm,
        )
    note("frame", "1 pad", "printed: frame, beams, plates, bosses", z - thick / 2)
    if spec.pad.hole_diameter_mm:
        faces += [("hole", projected(*circle(x, y, spec.pad.hole_diameter_mm).T, z), 1.0) for x, y in holes]
    if tray and tray.screw:
        z += step / 2
        for x, y in holes[[3, 2, 0, 1]]:
            disc("screw", x, y, z - tray.screw.length_mm, z, spec.pad.hole_diameter_mm * 0.9)
            disc("screw", x, y, z, z + tray.screw.head_mm / 2, tray.screw.head_mm)
        nut = " and nuts" if tray.screw.nut else ""
        note("screw", f"4 screws{nut}", f"{tray.screw.name}, {number(tray.screw.length_mm)} mm long", 0,
             projected(*(holes[2] + (tray.screw.head_mm / 4, 0)), z + tray.screw.head_mm / 2))  # fmt: skip

    from matplotlib.collections import PolyCollection

    points = np.concatenate([shape for _, shape, _ in faces])
    (left, bottom), (right, top) = points.min(0), points.max(0)
    area = Outline(left, right, bottom, top)
    sheet = Sheet(title_of(plan, "what lies above what"), area, Room(right=2.9, height=8.0))
    fills = {**FILLS, "inside": "#7d786c", "socket": "#55666f", "hole": "#55524b"}
    colours = [tuple(shade * v for v in to_rgb(fills[name])) for name, _, shade in faces]
    drawn = PolyCollection(
        [s for _, s, _ in faces],
        facecolors=colours,
        edgecolors=INK,
        linewidths=0.25 if len(plan.taxels) > MANY else 0.4,
    )
    sheet.axis.add_collection(drawn, autolim=False)
    sheet.column(right + 0.35 * sheet.mm, True, notes)
    return sheet.figure


def draw_wiring(plan: "Plan") -> Any:
    """Draw which coil is fed by which amplifier output, from the touch side and as the wires are seen, from below."""
    pad, coils = plan.spec.pad, plan.coils
    wide, deep = (side + 2 * pad.border_mm for side in (pad.width_mm, pad.depth_mm))
    apart = 1.12 * wide
    area = Outline(-wide / 2, apart + wide / 2, -deep / 2, deep / 2)
    # At least so large that a number of three digits fits into the circle of its coil.
    least = LEAST_CELL_IN * 2.12 * wide / min(coils.pitch_x_mm, coils.pitch_y_mm, plan.spec.coil.outer_diameter_mm)
    room = Room(below=0.75, above=0.85, width=max(9.0, least), height=max(7.5, least))
    sheet = Sheet(title_of(plan, "which amplifier output feeds which coil"), area, room)
    amplifier, groove = plan.spec.amplifier, corner_groove(plan.spec)
    cell_in = min(coils.pitch_x_mm, coils.pitch_y_mm) / sheet.mm
    for shift, mirror, side in ((0.0, 1, "from the touch side"), (apart, -1, "from below, where the wires are")):
        sheet.part("frame", [border(plan) * (mirror, 1) + (shift, 0)], facecolor="#fbfaf7")
        sheet.part("active", [border(plan, 0) * (mirror, 1) + (shift, 0)], linestyle=":", edgecolor=PALE)
        notch = rectangle(groove.x0, groove.x1, -deep / 2, groove.y1) * (mirror, 1) + (shift, 0)
        sheet.part("groove", [notch], facecolor=INK)
        sheet.words(shift, deep / 2 + 0.12 * sheet.mm, side, va="bottom", fontsize=NAME_PT, weight="bold")
        for index in range(coils.rows * coils.columns):
            row, column = divmod(index, coils.columns)
            x, y = coil_axis_mm(coils, row, column)
            x = shift + mirror * x
            sheet.part(
                "coil", [circle(x, y, plan.spec.coil.outer_diameter_mm)], facecolor="#f3dfd0", edgecolor=FILLS["coil"]
            )
            output = (
                f"{index // amplifier.channels + 1}.{index % amplifier.channels + 1}" if amplifier else f"{index + 1}"
            )
            roomy = cell_in > ROOMY_CELL_IN
            sheet.words(
                x, y + (0.08 * sheet.mm if roomy else 0), output, fontsize=11 if roomy else SMALL_PT, weight="bold"
            )
            if roomy:
                sheet.words(x, y - 0.11 * sheet.mm, f"r{row}c{column}", color="#555555")
    numbers = "amplifier.output" if amplifier else "amplifier output = channel of the WAV file, counted from 1"
    told = f"bold: {numbers}; row by row from the corner with the black groove (row 0, column 0)"
    if cell_in > ROOMY_CELL_IN:
        told += "\nr1c2: row 1, column 2, as in the names of taxels"
    sheet.words(-wide / 2, -deep / 2 - 0.15 * sheet.mm, told, ha="left", va="top")
    return sheet.figure


LEAST_CELL_IN, ROOMY_CELL_IN = 0.33, 0.55
