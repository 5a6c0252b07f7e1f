"""Drawings of the pad to scale, in mm: both sides, a section through a taxel, the parts in a stack.

Everything is drawn from the plan, in two dimensions. Parts have their names as the artists' ``gid``.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import chain, groupby
from math import cos, pi, sin
from typing import Any, NamedTuple

import numpy as np

from padgen.core.display import COLOURS, INK, PALE
from padgen.core.errors import InfeasibleError, number, plural
from padgen.planner.board_layout import board_of
from padgen.planner.fixtures import plan_tray, spacer_mm
from padgen.planner.guard import pin_places
from padgen.planner.layout import Outline, coil_axis_mm, corner_groove, outline, to_cell
from padgen.planner.pins import felt_parts
from padgen.planner.plan import TURNS, Channel, Plan
from padgen.planner.suspensions import BeamPath, Segment
from padgen.spec import Coil

__all__ = [
    "NAME_PT",
    "SMALL_PT",
    "Sheet",
    "circle",
    "coil_outline",
    "draw_exploded",
    "draw_pad",
    "draw_section",
    "pad_corners",
    "pad_shapes",
    "title_of",
]

FILLS = {
    "frame": "#ece5d6",
    "plate": "#d8c9a3",
    "beam": COLOURS[4],
    "boss": "#bfa76a",
    "pin": "#bfa76a",
    "washer": "#5f7383",
    "magnet": "#5f7383",
    "coil": "#cf8a5b",
    "core": "#43474d",
    "ballast": "#8a9199",
    "board": "#4f7d5c",
    "tray": "#b9cad3",
    "guard": "#c9d8c5",
    "screw": "#8d979f",
    "shank": "#8d979f",
    "recess": "#ffffff",
    "window": "#ffffff",
    "behind": "#f6f2ea",
    "beam behind": "#f6ddaa",
    "inside": "#7d786c",
    "socket": "#55666f",
    "spacer": "#b9cad3",
    "connector": "#3a3f46",
    "hole": "#55524b",
}
SMALL_PT = 8.0
NAME_PT = 9.0
CIRCLE = np.linspace(0, 2 * pi, 48, endpoint=False)
Points = np.ndarray


def title_of(plan: Plan, words: str) -> str:
    """Return a picture's title: the pad's name, with dollar signs escaped for matplotlib, and what is shown."""
    return plan.name.replace("$", r"\$") + f": {words}"


class Note(NamedTuple):
    """Words beside a drawing: a name, a sentence about it (or none), and the place in mm that they are about."""

    name: str
    sentence: str
    place: tuple[float, float]


class Sheet:
    """A figure to scale with one plot whose axes are in mm, without ticks; `mm` is how many mm an inch shows.

    Around the `area` in mm is room in inches for words: (left, right, below, above). `most` is the largest width and
    height in inches.
    """

    def __init__(
        self,
        title: str,
        area: Outline,
        room: tuple[float, float, float, float] = (0.3, 0.3, 0.75, 0.85),
        most: tuple[float, float] = (9.5, 7.6),
    ) -> None:
        from matplotlib.figure import Figure

        left, right, below, above = room
        wide = area.x1 - area.x0
        deep = area.y1 - area.y0
        self.mm = mm = max(wide / (most[0] - left - right), deep / (most[1] - below - above))
        size = wide / mm + left + right, deep / mm + below + above
        self.figure = Figure(figsize=size)
        self.axis: Any = self.figure.add_axes((0, 0, 1, 1))
        x = (area.x0 - left * mm, area.x1 + right * mm)
        y = (area.y0 - below * mm, area.y1 + above * mm)
        self.axis.set(xlim=x, ylim=y)
        self.axis.set_axis_off()
        self.figure.suptitle(title, x=0.15 / size[0], y=1 - 0.12 / size[1], ha="left", va="top")

    def part(self, name: str, shapes: Iterable[Points], **style: Any) -> Any:
        """Draw polygons (n, 2) in mm as one matplotlib artist, in the fill colour of the part `name`."""
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path

        path = Path.make_compound_path(*(Path(np.vstack([shape, shape[:1]]), closed=True) for shape in shapes))
        style = {"facecolor": FILLS.get(name, "none"), "edgecolor": INK, "linewidth": 0.6, **style}
        return self.axis.add_patch(PathPatch(path, gid=name, **style))

    def words(self, place: Sequence[float] | Points, text: str, **style: Any) -> None:
        """Write text at a place in mm, centred unless `style` says otherwise."""
        self.axis.text(*place, text, **{"ha": "center", "va": "center", "fontsize": SMALL_PT, **style})

    def dimension(self, ends: tuple[float, float], at: float, start: float, text: str = "", tall: bool = False) -> None:
        """Draw a dimension line along x (or, `tall`, along z) at `at`, with extension lines that begin at `start`."""
        turn = slice(None, None, -1 if tall else 1)
        for end in ends:
            self.axis.plot(*[(end, end), (start, at)][turn], color=PALE, linewidth=0.5)
        arrow = {"arrowstyle": "<->", "color": INK, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 6}
        self.axis.annotate("", *[(end, at)[turn] for end in ends], arrowprops=arrow)
        if text:
            side = {"rotation": 90, "ha": "right"} if tall else {"va": "bottom"}
            gap = 0.04 * self.mm * (-1 if tall else 1)
            bare = {"color": "white", "pad": 0.6}  # hides the lines that other dimensions begin with
            self.words([sum(ends) / 2, at + gap][turn], text, bbox=bare, **side)

    def column(self, x: float, to_right: bool, notes: Sequence[Note]) -> None:
        """Write notes below each other at `x`, each with a line to the place that it is about."""
        notes = sorted(notes, key=lambda note: -note.place[1])
        heights = [self.mm * (0.24 + 0.135 * (note.sentence.count("\n") + bool(note.sentence))) for note in notes]
        tops = []
        low = np.inf
        for note, height in zip(notes, heights, strict=True):
            tops.append(min(low, note.place[1] + height / 2))
            low = tops[-1] - height
        # All come up by half of what the lowest was pushed down by for want of room.
        shift = max(notes[-1].place[1] - heights[-1] / 2 - low, 0.0) / 2
        bottom, top = self.axis.get_ylim()
        if (lack := bottom - low - shift) > 0:
            self.axis.set_ylim(bottom - lack, top)
            self.figure.set_figheight(self.figure.get_figheight() + lack / self.mm)
        ha, out = ("left", 0.08 * self.mm) if to_right else ("right", -0.08 * self.mm)
        thin = {"arrowstyle": "-", "color": PALE, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0}
        for (name, sentence, place), top in zip(notes, tops, strict=True):
            y = top + shift - 0.1 * self.mm
            self.axis.annotate("", place, (x, y), gid=f"to {name}", arrowprops=thin)
            self.axis.plot(*place, ".", color=INK, markersize=3, zorder=9)
            self.words((x + out, y), name, ha=ha, fontsize=NAME_PT, weight="bold" if sentence else "normal")
            self.words((x + out, y - 0.09 * self.mm), sentence, ha=ha, va="top", color="#555555")


def rectangle(x0: float, x1: float, y0: float, y1: float) -> Points:
    """Return the corners (4, 2) of a rectangle."""
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def circle(x: float, y: float, diameter: float) -> Points:
    """Return points (n, 2) of a circle."""
    return np.stack([x + diameter / 2 * np.cos(CIRCLE), y + diameter / 2 * np.sin(CIRCLE)], -1)


def coil_outline(coil: Coil, x: float, y: float, turned: bool = False) -> Points:
    """Return the outline (n, 2) in mm of a coil about a place; with `turned` in axes of which the first is y."""
    if coil.shape == "round":
        return circle(x, y, coil.outer_diameter_mm)
    half_x, half_y = np.array(coil.sides_mm[:: -1 if turned else 1]) / 2
    return rectangle(x - half_x, x + half_x, y - half_y, y + half_y)


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


def taxel_shapes(plan: Plan, channel: Channel) -> dict[str, list[Points]]:
    """Return the outlines of a taxel's parts from above, by name, in its own axes."""
    arrangement = plan.arrangement(channel)
    plate = plan.plate
    length, width = (float(v) for v in arrangement.window_mm)
    x = float(arrangement.washer_x_mm)
    washer = plan.spec.washer_or_magnet
    bore = [circle(x, 0, washer.inner_diameter_mm)[::-1]] if washer.inner_diameter_mm else []
    return {
        "window": [rectangle(0, length, -width / 2, width / 2)],
        "beam": [beam_outline(path, channel.beam.fillet_mm) for path in arrangement.beams],
        "plate": [rectangle(*(float(v) for v in block[:4])) for block in arrangement.blocks],
        "recess": [circle(x, 0, plate.recess_diameter_mm)],
        "washer": [circle(x, 0, washer.outer_diameter_mm), *bore],
        "boss": [circle(channel.pin.x_mm, channel.pin.y_mm, channel.pin.diameter_mm)],
    }


def all_shapes(plan: Plan, names: Sequence[str]) -> dict[str, list[Points]]:
    """Return the outlines of the named parts of all taxels, by part, in the pad's axes."""
    shapes_of = [_in_cell(plan, channel) for channel in plan.channels]
    return {
        name: [
            coil_axis_mm(plan.coils, *taxel.coil) + (-shape if taxel.turned else shape)
            for taxel in plan.taxels
            for shape in shapes_of[taxel.channel][name]
        ]
        for name in names
    }


def _in_cell(plan: Plan, channel: Channel) -> dict[str, list[Points]]:
    """Return the `taxel_shapes` of a channel in the axes of its coil's cell."""
    return {name: [to_cell(shape, channel) for shape in shapes] for name, shapes in taxel_shapes(plan, channel).items()}


def pad_corners(plan: Plan, grow: float = 1.0) -> Points:
    """Return the corners (4, 2) of the active area widened by `grow` times the border: of the whole pad by default."""
    pad = plan.spec.pad
    x, y = (side / 2 + grow * pad.border_mm for side in (pad.width_mm, pad.depth_mm))
    return rectangle(-x, x, -y, y)


def pad_shapes(plan: Plan) -> list[tuple[str, Points]]:
    """Return the outlines of the pad from the touch side, by name: its frame, the groove in a corner, and its holes."""
    pad = plan.spec.pad
    groove = corner_groove(plan.spec)
    low = pad_corners(plan)[0, 1]
    corners = pad_corners(plan, 0.5)[[2, 3, 0, 1]]
    round_corner = circle(0, 0, pad.border_mm)
    bows = [corner + round_corner[np.arange(12 * k, 12 * k + 13) % 48] for k, corner in enumerate(corners)]
    shapes = [("frame", np.vstack(bows)), ("groove", rectangle(groove.x0, groove.x1, low, groove.y1))]
    if pad.hole_diameter_mm:
        shapes += [("hole", circle(x, y, pad.hole_diameter_mm)) for x, y in corners]
    return shapes


def both_sides(
    plan: Plan, title: str, sides: tuple[str, str], most: tuple[float, float] = (9.5, 7.6)
) -> tuple[Sheet, list[Callable[[Points], Points]]]:
    """Return a sheet with the pad's outline from the touch side and, turned over about its y axis, from below.

    The functions bring points (n, 2) from the pad's axes to each side's place on the sheet.
    """
    (left, low), (right, high) = pad_corners(plan)[[0, 2]]
    apart = 1.12 * (right - left)
    sheet = Sheet(title_of(plan, title), Outline(left, right + apart, low, high), (0.7, 0.3, 1.1, 0.85), most)
    views: list[Callable[[Points], Points]] = [lambda shape: shape, lambda shape: shape * (-1, 1) + (apart, 0)]
    for view, side in zip(views, sides, strict=True):
        for name, shapes in groupby(pad_shapes(plan), lambda pair: pair[0]):
            fill = {"groove": INK, "hole": "white"}.get(name, FILLS["frame"])
            sheet.part(name, [view(shape) for _, shape in shapes], facecolor=fill)
        place = view(np.array([(0.0, high + 0.12 * sheet.mm)]))[0]
        sheet.words(place, side, va="bottom", weight="bold", fontsize=NAME_PT)
    return sheet, views


def draw_pad(plan: Plan) -> Any:
    """Draw the printed pad from the touch side and from below, with its dimensions."""
    pad = plan.spec.pad
    x, y = pad_corners(plan)[2]
    inner_x, inner_y = pad_corners(plan, 0)[2]
    sides = (f"touch side: {felt_parts(plan)} to feel", f"underside: beams, recesses and {plan.spec.mover.kind}s")
    sheet, views = both_sides(plan, "the printed pad, in mm", sides)
    parts = ("window", "beam", "plate", "boss"), ("window", "plate", "beam", "recess", "washer")
    shapes = all_shapes(plan, ("recess", "washer", *parts[0]))
    for view, names in zip(views, parts, strict=True):
        for name in names:
            style = {"linewidth": 0.3, "rasterized": True} if len(plan.taxels) > MANY else {}
            sheet.part(name, [view(shape) for shape in shapes[name]], **style)
    step = 0.3 * sheet.mm
    sheet.dimension((-inner_x, inner_x), -y - step, -inner_y, number(pad.width_mm))
    sheet.dimension((-x, x), -y - 2 * step, -y, number(2 * x))
    sheet.dimension((-y, y), -x - step, -x, number(2 * y), tall=True)
    holes = f", holes {number(pad.hole_diameter_mm)}" if pad.hole_diameter_mm else ""
    note = (
        f"frame {number(pad.frame_thickness_mm)} high, border {number(pad.border_mm)} wide{holes};"
        f" {plan.spec.mover.kind}s"
        f" {number(plan.spec.washer_or_magnet.outer_diameter_mm)} across; black: the groove that marks a corner"
    )
    sheet.words((-x, -y - 2 * step - 0.2 * sheet.mm), note, ha="left", va="top")
    return sheet.figure


MANY = 128
"""More taxels than these are drawn with thinner lines, and in an SVG as an image, which is smaller."""


def draw_section(plan: Plan) -> Any:
    """Draw the taxel of the lowest channel from the touch side and, below, cut along its beam, to one scale."""
    channel = plan.channels[0]
    spec = plan.spec
    plate = plan.plate
    washer = plan.spec.washer_or_magnet
    ballast = spec.ballast
    coil = spec.coil
    thick = spec.pad.frame_thickness_mm
    outline_points = outline(plan, channel)
    arrangement = plan.arrangement(channel)
    shapes = taxel_shapes(plan, channel)
    beam = arrangement.beams[0]
    length = float(arrangement.window_mm[0])
    x = float(arrangement.washer_x_mm)
    thin = channel.beam.thickness_mm
    low = plan.spec.mover_low_mm
    pin = channel.pin
    proud = pin.top_mm
    guard = plan.spec.guard_height_mm
    peak = max(proud, thick + guard)
    roof = low + washer.thickness_mm
    top = low - coil.gap_mm
    bottom = top - coil.length_mm
    core = coil.core_diameter_mm / 2
    cosine, sine = TURNS[channel.site.along]
    axis = 0 if cosine else 1
    reach = coil.sides_mm[axis] / 2
    inner = coil.bore_sides_mm[axis] / 2
    ahead, aside = channel.site.origin_mm
    coil_x = -cosine * ahead - sine * aside
    coil_y = sine * ahead - cosine * aside
    left = min(outline_points.x0, coil_x - reach)
    right = max(outline_points.x1, coil_x + reach)
    # Room for a line of words and a dimension between both views, at whichever scale comes out.
    apart = max(0.13 * (right - left), 0.08 * (peak - bottom + outline_points.y1 - outline_points.y0))
    lift = peak + apart - outline_points.y0
    above = peak + apart + outline_points.y1 - outline_points.y0
    up = np.array([0.0, lift])
    title = (
        f"one taxel from the touch side and, below, cut along its beam (mm; channel 0, {channel.resonance_hz:.4g} Hz)"
    )
    sheet = Sheet(title_of(plan, title), Outline(left, right, bottom, above), (2.3, 2.75, 0.35, 0.95))

    for name in ("frame", "window", "beam", "plate", "boss"):
        drawn = [rectangle(*outline_points)] if name == "frame" else shapes[name]
        sheet.part(f"{name} from above", [shape + up for shape in drawn], facecolor=FILLS[name])
    below = (("washer", shapes["washer"][0]), ("coil", coil_outline(coil, coil_x, coil_y, bool(axis))))
    for name, shape in below:
        dashed = {"facecolor": "none", "edgecolor": FILLS[name], "linestyle": (0, (4, 2))}
        sheet.part(f"{name} from above", [shape + up], **dashed).set_clip_path(sheet.axis.patches[0])
    sheet.axis.plot(
        [outline_points.x0, outline_points.x1],
        [lift, lift],
        color=INK,
        linewidth=0.7,
        linestyle=(0, (8, 2, 1, 2)),
        zorder=8,
    )
    sheet.words((outline_points.x1 + 0.05 * sheet.mm, lift), "cut", ha="left")
    sheet.words(
        (outline_points.x0, outline_points.y0 + lift - 0.05 * sheet.mm),
        f"dashed: {plan.spec.mover.kind} and coil below",
        ha="left",
        va="top",
    )

    cuts = beam_cuts(shapes["beam"])
    along = np.concatenate(shapes["beam"])[:, 0]
    side = rectangle(float(along.min()), float(along.max()), 0, thin)
    blocks = [[float(v) for v in b] for b in arrangement.blocks if float(b.low_y_mm) < 0 < float(b.high_y_mm)]
    hollow, post, half = (d / 2 for d in (plate.recess_diameter_mm, plate.post_diameter_mm, pin.diameter_mm))
    outer = washer.outer_diameter_mm / 2
    bore = washer.inner_diameter_mm / 2
    edge = plate.boss_edge_mm
    stands_on = 0.0 if pin.on_beam else plate.thickness_mm
    profile = [(half, stands_on), (half, proud - edge), (half - edge, proud)]
    if pin.shape == "dome":
        arcs = np.linspace(0, pi / 2, 13).tolist()
        profile = [(half, stands_on), *((half * cos(at), proud - half + half * sin(at)) for at in arcs)]
    profile += [(-across, z) for across, z in reversed(profile)]
    felt = pin.x_mm
    word = "boss" if felt_parts(plan) == "bosses" else "pin"
    # The plate over the pad is cut along the beam's middle, through the hole where that is there.
    reach_of_hole = max(plan.spec.guard_hole_mm**2 / 4 - pin.y_mm**2, 0.0) ** 0.5
    open_at = [outline_points.x0, felt - reach_of_hole, felt + reach_of_hole, outline_points.x1]
    under = thick + plan.spec.guard.clearance_mm
    covers = [rectangle(open_at[at], open_at[at + 1], under, thick + guard) for at in (0, 2)]
    covers += [rectangle(outline_points.x0, 0, thick, under), rectangle(length, outline_points.x1, thick, under)]
    mover = plan.spec.mover.kind
    halves = [rectangle(x + s * bore, x + s * outer, low, roof) for s in (-1, 1)]
    parts = {
        "behind": [rectangle(0, length, 0, thick)],
        "beam behind": [side],
        "frame": [rectangle(outline_points.x0, 0, 0, thick), rectangle(length, outline_points.x1, 0, thick)],
        "beam": [rectangle(*ends, 0, thin) for ends in cuts] or [side],
        "plate": [rectangle(block[0], block[1], 0, block[4]) for block in blocks],
        "recess": [rectangle(x + s * post, x + s * hollow, 0, plate.recess_depth_mm) for s in (-1, 1)],
        word: [np.array([(felt + across, z) for across, z in profile])],
        **({"guard": covers} if guard else {}),
        mover: halves if bore else [rectangle(x - outer, x + outer, low, roof)],
        "coil": [rectangle(coil_x + s * inner, coil_x + s * reach, bottom, top) for s in (-1, 1)],
        **({"core": [rectangle(coil_x - core, coil_x + core, bottom, top)]} if core else {}),
    }
    if ballast:
        half_ballast = ballast.width_mm / 2
        ballast_top = spec.pocket_top_mm
        parts["ballast"] = [rectangle(x - half_ballast, x + half_ballast, ballast_top - ballast.height_mm, ballast_top)]
    for name, cut in parts.items():
        sheet.part(name, cut, **({"linewidth": 0.4} if "behind" in name else {}))

    steel = x + (bore + outer) / 2
    hole = f"{number(2 * bore)} x " if bore else ""
    size = f"{number(2 * outer)} x {hole}{number(washer.thickness_mm)}"
    made_of = "steel" if plan.spec.washer else "magnet"
    acts = "pulled by the coil" if plan.spec.washer else "moved by the coil"
    spring = sum(cuts[0]) / 2 if cuts else (float(along.min()) + blocks[0][0]) / 2
    if pin.on_beam and abs(spring - felt) < half:
        spring = (felt + half + blocks[0][0]) / 2
    wall = max((x + hollow + blocks[0][1]) / 2, x + half)
    rib = (length + outline_points.x1) / 2
    winding = f"copper, {number(2 * reach)} across: the frequency\nof its current chooses among taxels"
    notes = [
        *([Note("guard", "a second part, for the hand to rest on", (rib, thick + guard / 2))] if guard else []),
        Note(word, "what the finger feels", (felt + half / 2, (proud + max(thin, stands_on)) / 2)),
        Note("plate", f"swings up and down\nwith {word} and {mover}", (wall, 0.8 * plate.thickness_mm)),
        Note(
            "frame",
            f"holds all taxels; printed in one piece\nwith beams, plates and {felt_parts(plan)}",
            (rib, thick / 2),
        ),
        *(
            [
                Note(
                    "ballast",
                    f"{ballast.name}: mass\nthat skin detunes little",
                    (x, ballast_top - ballast.height_mm / 2),
                )
            ]
            if ballast
            else []
        ),
        Note(mover, f"{made_of}, {size};\nglued in, and {acts}", (steel, (low + roof) / 2)),
        Note("gap", f"air between {mover} and coil", (steel, (low + top) / 2)),
        Note(
            "core",
            f"iron, {number(2 * core)} across: leads the field up",
            (coil_x + core / 2, bottom + 0.75 * (top - bottom)),
        ),
        Note("coil", winding, (coil_x + (inner + reach) / 2, (top + bottom) / 2)),
    ]
    absent = {name for name, size in (("core", core), (word, proud - stands_on)) if size < LEAST_MM}
    sheet.column(right + 0.35 * sheet.mm, True, [note for note in notes if note.name not in absent])

    notes = []
    step = 0.2 * sheet.mm
    at_y = lift + float(beam.root_mm[1])
    for text, place, low_end, high_end, start in (
        (f"{word} {{:.3g}} high", 1, stands_on, proud, felt - half),
        ("frame {:.3g} high", 1, 0.0, thick, outline_points.x0),
        ("beam {:.3g} thick", 2, 0.0, thin, 0.0),
        ("gap {:.3g}", 1, top, low, coil_x - reach),
        ("coil {:.3g} high", 1, bottom, top, coil_x - reach),
        ("beam {:.3g} wide", 1, at_y - beam.width_mm / 2, at_y + beam.width_mm / 2, float(beam.root_mm[0])),
    ):
        sheet.dimension((low_end, high_end), left - place * step, start, tall=True)
        notes.append(Note(text.format(high_end - low_end), "", (left - place * step, (low_end + high_end) / 2)))
    notes.append(Note("beam", "the spring: its width,\nthickness and length\nset the frequency", (spring, thin / 2)))
    sheet.column(left - 3 * step, False, notes)
    if abs(coil_y) > SAME_PLACE_MM:
        sheet.words((coil_x, bottom - 0.08 * sheet.mm), "cut through its axis, which lies beside the beam", va="top")
    first = shapes["beam"][0][:, 0]
    bent = "" if beam.is_straight else ", along its path"
    long = f"beam {float(beam.length_mm):.3g} long{bent}"
    sheet.dimension((float(first.min()), float(first.max())), above + 0.1 * sheet.mm, lift, long)
    plate_ends = blocks[0][0], blocks[0][1]
    sheet.dimension(plate_ends, above + 0.32 * sheet.mm, lift, f"plate {plate_ends[1] - plate_ends[0]:.3g}")
    sheet.dimension((felt - half, felt + half), peak + 0.08 * sheet.mm, proud, f"{word} {2 * half:.3g}")
    return sheet.figure


def beam_cuts(beams: Sequence[Points]) -> list[tuple[float, float]]:
    """Return the intervals of x in which the plane y = 0 cuts beams with these outlines."""
    from matplotlib.path import Path

    x = np.linspace(min(b[:, 0].min() for b in beams), max(b[:, 0].max() for b in beams), CUT_POINTS)
    inside = np.any([Path(beam).contains_points(np.stack([x, 0 * x], -1)) for beam in beams], axis=0)
    runs = [[at for at, _ in run] for is_in, run in groupby(zip(x, inside, strict=True), lambda p: p[1]) if is_in]
    return [(float(run[0]), float(run[-1])) for run in runs]


CUT_POINTS = 4001
SAME_PLACE_MM = 0.05
LEAST_MM = 1e-6


TURN = np.array([(cos(pi / 6), sin(pi / 6)), (-sin(pi / 6), cos(pi / 6))])
UP = pi / 7.5
"""The direction that the stack is seen from: right and away in the pad's x and y, and the angle above the horizon."""


class Prism(NamedTuple):
    """A part as an upright prism: name, convex outline (n, 2) in mm, anticlockwise, lower and upper height in mm."""

    part: str
    outline: Points
    low: float
    high: float


def _board_solids(plan: Plan, grid: Sequence[tuple[float, float]], low: float) -> tuple[list[Prism], list[Prism]]:
    """Return a board with its coils and connectors from a height up, and the spacers on it; no spacers without screws.

    Where the tracks have no room it is as large as the pad.
    """
    coil = plan.spec.coil
    top = low + coil.length_mm
    spirals = [Prism("coil", coil_outline(coil, x, y), top, top) for x, y in grid]
    try:
        board = board_of(plan)
    except InfeasibleError:
        return [Prism("board", pad_corners(plan), low, top), *spirals], []
    left, near, right, far = board.outline_mm
    solids = [Prism("board", rectangle(left, right, near, far), low, top), *spirals]
    for index in sorted({pin.connector for pin in board.pins}):
        pins = np.array([pin.at_mm for pin in board.pins if pin.connector == index])
        (x0, y0), (x1, y1) = pins.min(0) - board.connector.body_mm, pins.max(0) + board.connector.body_mm
        solids.append(Prism("connector", rectangle(x0, x1, y0, y1), top, top + CONNECTOR_MM))
    above = top + CONNECTOR_MM
    holes = sorted(board.holes, key=lambda hole: -float(np.array(hole.at_mm) @ TURN[1]))
    spacers = [
        Prism("spacer", circle(*hole.at_mm, hole.diameter_mm + 2 * SPACER_WALL_MM), above, above + spacer_mm(plan))
        for hole in holes
    ]
    return solids, spacers


CONNECTOR_MM = 2.5
SPACER_WALL_MM = 1.0
"""Height of connectors and wall of spacers as they are drawn."""


def projected(places: Points, z: float) -> Points:
    """Project places (n, 2) at a height in mm onto the picture's plane, in parallel and from above."""
    right, away = (places @ TURN.T).T
    return np.stack([right, z * cos(UP) + away * sin(UP)], -1)


def draw_exploded(plan: Plan) -> Any:
    """Draw an exploded view: the parts above each other in the order of assembly, in parallel projection."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    spec = plan.spec
    coil = plan.spec.coil
    washer = plan.spec.washer_or_magnet
    plate = plan.plate
    edges = pad_corners(plan)
    grid = [coil_axis_mm(plan.coils, r, c) for r in reversed(range(plan.coils.rows)) for c in range(plan.coils.columns)]
    bosses = np.array([(taxel.x_mm, taxel.y_mm) for taxel in plan.taxels])
    bosses = bosses[np.argsort(-(bosses @ TURN[1]), kind="stable")]
    try:
        tray = plan_tray(plan)
    except InfeasibleError:
        tray = None
    step = 0.8 * float(np.ptp(projected(edges, 0.0)[:, 1]))
    layers = []

    def prisms(part: str, centres: Any, diameter: float, low: float, high: float | None = None) -> list[Prism]:
        return [Prism(part, circle(x, y, diameter), low, low if high is None else high) for x, y in centres]

    z = 0.0
    if tray:
        z = tray.height_mm
        sockets = prisms("socket", grid, tray.socket_diameter_mm, z)
        layers.append(("tray", "1 tray", "printed: sockets that set the gap", [Prism("tray", edges, 0.0, z), *sockets]))
        z += step / 2
    top = z + coil.length_mm
    windings = [Prism("coil", coil_outline(coil, x, y), z, top) for x, y in grid]
    cores = prisms("core", grid, coil.core_diameter_mm, top)
    coils = [*chain(*zip(windings, cores, strict=True))]
    words = f"{len(grid)} coil{plural(len(grid))}"
    if coil.kind == "board":
        board, spacers = _board_solids(plan, grid, z)
        layers.append(("board", "1 board", f"printed circuit: {words},\nan amplifier output each", board))
        if spacers:
            layers.append(("spacer", f"{len(spacers)} spacers", "or one printed frame: sets the gap", spacers))
            top = spacers[0].high
    else:
        layers.append(("coil", words, "an amplifier output each", coils))
    z = top + step
    top = z + washer.thickness_mm
    rings = prisms("washer", bosses, washer.outer_diameter_mm, z, top)
    rings += prisms("hole", bosses, washer.inner_diameter_mm, top)
    name = f"{len(bosses)} {plan.spec.mover.kind}{plural(len(bosses))}"
    layers.append(("washer", name, "glued into the plates from below", rings))
    if spec.ballast:
        z = top + step / 3
        top = z + spec.ballast.height_mm
        name = f"{len(bosses)} {spec.ballast.name}"
        sentence = f"ballast, pressed into the plates\nbefore the {plan.spec.mover.kind}s"
        layers.append(("ballast", name, sentence, prisms("ballast", bosses, spec.ballast.width_mm, z, top)))
    z = top + step
    top = z + spec.pad.frame_thickness_mm
    height = z + plate.thickness_mm
    shapes = all_shapes(plan, ("window", "plate"))
    pad = [Prism("frame", edges, z, top), *(Prism("inside", shape, top, top) for shape in shapes["window"])]
    pad += [Prism("plate", shape, height, height) for shape in shapes["plate"]]
    pins = np.array(pin_places(plan))
    pins = pins[np.argsort(-(pins @ TURN[1]), kind="stable")]
    foot = z if plan.channels[0].pin.on_beam else height
    pad += prisms("boss", pins, plan.channels[0].pin.diameter_mm, foot, z + plan.channels[0].pin.top_mm)
    corners = pad_corners(plan, 0.5)[[3, 2, 0, 1] if spec.pad.hole_diameter_mm else []]
    pad += prisms("hole", corners, spec.pad.hole_diameter_mm, top)
    layers.append(("frame", "1 pad", f"printed: frame, beams, plates, {felt_parts(plan)}", pad))
    if spec.guard_height_mm:
        low = z + plan.channels[0].pin.top_mm + step / 2
        top = low + spec.guard_height_mm
        cover = [Prism("guard", edges, low, top), *prisms("hole", pins, spec.guard_hole_mm, top)]
        cover += prisms("hole", corners, spec.pad.hole_diameter_mm, top)
        layers.append(("guard", "1 guard plate", "printed: a hole round each pin", cover))
    if tray and tray.screw:
        low = top + step / 2
        high = top + step / 2 + tray.screw.length_mm
        shanks = prisms("shank", corners, 0.9 * spec.pad.hole_diameter_mm, low, high)
        heads = prisms("screw", corners, tray.screw.head_mm, high, high + tray.screw.head_mm / 2)
        name = "4 screws, 4 nuts" if tray.screw.nut else "4 screws"
        layers.append(("screw", name, f"{tray.screw.name}, {number(tray.screw.length_mm)} mm long", shanks + heads))

    faces = []
    notes = []
    for meant, name, sentence, solids in layers:
        places = []
        for part, shape, low, high in solids:
            if high > low:
                # The edges of an anticlockwise outline that are seen from the front lead to the right.
                leads = (np.roll(shape, -1, 0) - shape) @ TURN[0] > 0
                first = int(np.argmax(leads & ~np.roll(leads, 1)))
                front = shape[np.arange(first, first + leads.sum() + 1) % len(shape)]
                faces.append((part, np.vstack([projected(front, low), projected(front[::-1], high)]), 0.8))
                places += [tuple(projected(front[-2:], (low + high) / 2).mean(0).tolist())] if part == meant else []
            faces.append((part, projected(shape, high), 1.0))
        notes.append(Note(name, sentence, max(places)))
    points = np.concatenate([shape for _, shape, _ in faces])
    area = Outline(*np.stack([points.min(0), points.max(0)]).T.ravel())
    sheet = Sheet(title_of(plan, "what lies above what"), area, (0.3, 2.9, 0.3, 0.6), (9.0, 8.0))
    many = len(bosses) > MANY
    stack = PolyCollection(
        [shape for _, shape, _ in faces],
        facecolors=[tuple(shade * v for v in to_rgb(FILLS[part])) for part, _, shade in faces],
        edgecolors=INK,
        linewidths=0.25 if many else 0.4,
        rasterized=many,
    )
    sheet.axis.add_collection(stack, autolim=False)
    sheet.column(area.x1 + 0.35 * sheet.mm, True, notes)
    return sheet.figure
