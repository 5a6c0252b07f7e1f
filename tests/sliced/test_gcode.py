"""A pad as a slicer lays it, judged on G-code made here by hand, whose widths, heights and volumes are known.

| what | against | tolerance | why |
|---|---|---|---|
| plastic and places of moves | lengths and circles by hand | 1e-6, arcs 0.2 % | chords 5 µm off their arc |
| laid widths | the width of the beads that were written | 0.01 mm | pieces of 0.04 mm, nodes 0.5 mm apart |
| depth, room, gap | rectangles and circles by hand | 0.02 mm | pixels of 0.02 mm |
| resonance with fewer layers | f ~ w^1/2 t^3/2 | 3 % | what the beam's ends give differs with its thickness |
"""

import gzip
import json
import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

import padgen as pg
from padgen import cli
from padgen.core.errors import FileError
from padgen.planner import make_plan
from padgen.report.results import laid_text
from padgen.sliced.judge_laid import check_gcode
from padgen.sliced.laid_pad import PadMaps, TaxelMap, read_layers, read_settings
from padgen.spec import parse_spec

REFERENCE = Path(__file__).parents[1] / "reference" / "four-0.2mm.gcode.gz"
"""`prusa-slicer --export-gcode pad.stl --layer-height=0.2 --first-layer-height=0.2 --elefant-foot-compensation=0.2
--nozzle-diameter=0.4 --bed-shape=0x0,250x0,250x210,0x210 --center=90,100 --rotate=90` of PrusaSlicer 2.5.0, all else
its defaults, of the pad of FOUR."""
FOUR = """
name = "four"
resolution = 4
band_hz = [50, 200]
q_min = 15
resonances_hz = [56, 76]
pad = { width_mm = 25, depth_mm = 25 }
coil = { grid = [1, 2] }
taxel = { washer_clearance_mm = 0.2, glue_gap_mm = 0.1 }
suspension = { topology = "cantilever", thickness_mm = 0.3 }
"""
# Half as deep, so that its files have half as many lines.
NARROW = FOUR.replace("depth_mm = 25", "depth_mm = 12.5")
ONE_COIL = FOUR.replace("[1, 2]", "[1, 1]").replace("resolution = 4", "resolution = 2")
FILAMENT_MM2 = math.pi / 4 * 1.75**2
HEAVY = """
name = "heavy"
resolution = 4
band_hz = [100, 200]
q_min = 15
resonances_hz = [120, 170]
magnet = "disc-4x2"
ballast = "steel-rod-4x2"
pad = { width_mm = 25, depth_mm = 16, frame_thickness_mm = 4.5 }
coil = { name = "air-10", grid = [1, 2] }
taxel = { plate_thickness_mm = 4.5, fillet_mm = 0 }
contactor = { diameter_mm = 0.9, place = 0.5, protrusion_mm = 0.4 }
suspension = { topology = "cantilever", thickness_mm = 0.6 }
"""
"""Magnets under rods pressed into plates, and pins on the beams."""
LINE_MM = 0.45
THIN_MM = 0.15


@pytest.fixture(scope="module")
def plan():
    return make_plan(parse_spec(NARROW))


@pytest.fixture(scope="module")
def usual(plan, tmp_path_factory):
    return check_gcode(plan, Hand(plan, quarters=1).file(tmp_path_factory.mktemp("usual")))


def as_planned(taxel, layer):
    return None


@dataclass
class Hand:
    """Writer of a pad of cantilevers as straight beads that fill rectangles, in each taxel's axes, then on the bed.

    Faults that it can make: wrong `steps_mm` (first layer, other layers), a raft of `raft_mm`; for a taxel and a layer
    another `width` of the beam, or a `piece` missing between two shares of its length; recesses of other depth or
    smaller radius, roofs with strands of `strand_mm`; pockets of ballast `shallower_mm` by so much; another `flow` in
    the plates, of beads `thin_mm` wide; a bead in one `gap`.
    """

    plan: pg.Plan
    at: tuple = (100.0, 90.0)
    quarters: int = 0
    notes: bool = True
    steps_mm: tuple = (0.2, 0.1)
    raft_mm: float = 0.0
    width: object = staticmethod(as_planned)
    piece: object = staticmethod(as_planned)
    recess_mm: float = 0.4
    strand_mm: float | None = None
    tighter_mm: float = 0.0
    shallower_mm: float = 0.0
    flow: float = 1.0
    gap: str = ""
    thin_mm: float = THIN_MM
    beads: list = field(default_factory=list)

    def layers(self):
        top = 0.0
        while top < self.plan.spec.contact_top_mm - 1e-6:
            step = self.steps_mm[bool(top)]
            top = round(top + step, 6)
            yield top, step

    def fill(self, x0, x1, y0, y1, z, h, hole=None, flow=1.0, line=LINE_MM):
        """Fill a rectangle exactly with beads along x, but for a round hole (x, y, radius)."""
        count = max(round((y1 - y0) / min(line, (x1 - x0) / 4)), 1)
        width = (y1 - y0) / count
        for k in range(count):
            y = y0 + (k + 0.5) * width
            runs = [(x0, x1)]
            if hole and abs(y - hole[1]) < hole[2] + width / 2:
                # Where the nearer side of the bead meets the circle, so that none of it reaches in.
                near = max(abs(y - hole[1]) - width / 2, 0.0)
                half = math.sqrt(max(hole[2] ** 2 - near**2, 0))
                runs = [(x0, hole[0] - half), (hole[0] + half, x1)]
            for a, b in runs:
                if b - a > width:
                    # Drawn in by half its width, since its ends are round, with as much plastic.
                    area = width * h * (b - a) / (b - a - width) * flow
                    self.beads.append((a + width / 2, y, b - width / 2, y, area, h, z))

    def taxel(self, taxel, layer, z, h):
        plan = self.plan
        first = len(self.beads)
        channel = plan.channels[taxel.channel]
        arrangement = plan.arrangement(channel)
        (path,), (block,) = arrangement.beams, arrangement.blocks
        x0, x1, _, y1 = (float(v) for v in block[:4])
        long, wide = (float(v) for v in arrangement.window_mm)
        washer = float(arrangement.washer_x_mm), 0.0
        if z <= plan.plate.thickness_mm + 1e-6:
            hole = None
            ballast = plan.spec.ballast
            if ballast and z <= plan.spec.pocket_top_mm - self.shallower_mm + 1e-6:
                hole = (*washer, ballast.width_mm / 2)
            if z <= self.recess_mm + 1e-6:
                hole = (*washer, plan.plate.recess_diameter_mm / 2 - self.tighter_mm)
            self.fill(x0, x1, -y1, y1, z, h, hole, self.flow, self.thin_mm)
            if self.strand_mm and not hole and z - h <= self.recess_mm + 1e-6:
                self.beads[first:] = [(*bead[:5], self.strand_mm, z) for bead in self.beads[first:]]
            cx, cy = self.own(channel, *channel.site.centre_mm)
            half_x = plan.cell.width_mm / 2
            half_y = plan.cell.depth_mm / 2
            west = cx - half_x
            east = cx + half_x
            south = cy - half_y
            north = cy + half_y
            for box in ((west, 0, south, north), (long, east, south, north), (0, long, south, -wide / 2)):
                self.fill(*box, z, h)
            self.fill(0, long, wide / 2, north, z, h)
            if taxel.id == self.gap:
                self.fill(x0, x1, y1, wide / 2, z, h)
        half = math.sqrt(math.pi) / 4 * plan.plate.boss_diameter_mm  # of a square of the boss's area
        if channel.pin.on_beam:
            if z > channel.beam.thickness_mm + 1e-6:
                self.fill(channel.pin.x_mm - half, channel.pin.x_mm + half, -half, half, z, h)
        elif z > plan.plate.thickness_mm + 1e-6:
            self.fill(washer[0] - half, washer[0] + half, -half, half, z, h)
        width = self.width(taxel, layer)
        piece = self.piece(taxel, layer)
        if width is None:
            width = channel.beam.width_mm if z <= channel.beam.thickness_mm + 1e-6 else 0.0
        count = max(round(width / LINE_MM), 1)
        for k in range(count if width else 0):
            y = (k + 0.5) * width / count - width / 2
            a, b = (share * path.length_mm for share in piece or (0, 1))
            self.beads.append((a, y, b, y, width / count * h, h, z))
        for k in range(first, len(self.beads)):
            bead = self.beads[k]
            ends = [self.on_pad(taxel, channel, washer, *bead[i : i + 2]) for i in (0, 2)]
            self.beads[k] = (*ends[0], *ends[1], *bead[4:])

    @staticmethod
    def turn(along, x, y, back=False):
        for _ in range({"+x": 0, "+y": 1, "-x": 2, "-y": 3}[along]):
            x, y = (y, -x) if back else (-y, x)
        return x, y

    def own(self, channel, x, y):
        return self.turn(channel.site.along, x - channel.site.origin_mm[0], y - channel.site.origin_mm[1], True)

    def on_pad(self, taxel, channel, washer, x, y):
        x, y = self.turn(channel.site.along, x - washer[0], y)
        return (taxel.x_mm - x, taxel.y_mm - y) if taxel.turned else (taxel.x_mm + x, taxel.y_mm + y)

    def lay(self):
        pad = self.plan.spec.pad
        half_x = pad.width_mm / 2
        half_y = pad.depth_mm / 2
        border = pad.border_mm
        self.beads = []
        for number, (z, h) in enumerate(self.layers()):
            for taxel in self.plan.taxels:
                self.taxel(taxel, number, z, h)
            if z <= pad.frame_thickness_mm + 1e-6:
                x = half_x + border - LINE_MM
                y = half_y + border - LINE_MM
                for low, high in ((-y, -half_y), (half_y, y)):
                    self.fill(-x, x, low, high, z, h)
                for low, high in ((-x, -half_x), (half_x, x)):
                    self.fill(low, high, -half_y, half_y, z, h)
                # Around it the outline, by which slicers begin.
                x = x + LINE_MM / 2
                y = y + LINE_MM / 2
                area = LINE_MM * h
                for a, b in (((-x, -y), (x, -y)), ((x, -y), (x, y)), ((x, y), (-x, y)), ((-x, y), (-x, -y))):
                    self.beads.append((*a, *b, area, h, z))
        return self

    def text(self, relative=False, unit=1.0, footer=""):
        cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[self.quarters]
        lines = ["; laid by hand", "G20" if unit != 1 else "G21", "G90", "M83" if relative else "M82", "G92 E0"]
        e = 0.0
        at = None
        for x0, y0, x1, y1, area, height, z in self.beads:
            ends = [
                (cosine * x - sine * y + self.at[0], sine * x + cosine * y + self.at[1])
                for x, y in ((x0, y0), (x1, y1))
            ]
            if z != at:
                if self.notes:
                    lines += [";LAYER_CHANGE", f";Z:{z:.4g}", f";HEIGHT:{height:.4g}"]
                lines.append(f"G1 Z{(z + self.raft_mm) / unit:.6f} F600")
                at = z
                last = height
            if self.notes and height != last:
                lines.append(f";HEIGHT:{height:.4g}")
                last = height
            fed = area * math.dist(*ends) / FILAMENT_MM2 / unit
            e = fed if relative else e + fed
            lines.append(f"G0 X{ends[0][0] / unit:.6f} Y{ends[0][1] / unit:.6f} F9000")
            lines.append(f"G1 X{ends[1][0] / unit:.6f} Y{ends[1][1] / unit:.6f} E{e:.7f}")
        return "\n".join([*lines, footer, ""])

    def file(self, folder, **how):
        path = folder / "pad.gcode"
        path.write_text(self.lay().text(**how))
        return path


def told(report, level=None):
    return {f.code for f in report.findings if level in (None, f.level)}


def one(report, code):
    (finding,) = (f for f in report.findings if f.code == code)
    return finding


def test_what_is_laid_as_planned_holds(plan, usual):
    assert usual.findings == ()
    figures = usual.figures
    assert figures["centre_mm"] == pytest.approx([100, 90], abs=0.01)
    assert (figures["turned_deg"], figures["layers"]) == (90, 49)
    blocks = 4.6**2 * 4 - math.pi / 4 * 3.7**2 * 0.4
    # The broken edge is a triangle that turns about the axis (Pappus).
    boss = math.pi / 4 * 2.5**2 - 0.3**2 / 2 * 2 * math.pi * (1.25 - 0.1)
    for taxel in figures["taxels"]:
        channel = plan.channels[taxel["channel"]]
        (beam,) = taxel["beams"]
        assert beam["width_mm"] == pytest.approx([channel.beam.width_mm] * 2, abs=0.01)
        assert (beam["layers"], beam["thickness_mm"]) == (2, pytest.approx(0.3))
        assert taxel["recess_depth_mm"] == pytest.approx(0.4, abs=1e-6)
        # A bead's round edges are 0.215 of 0.2 mm wider than its rectangle; its ends are steps about the circle.
        assert taxel["recess_room_mm"] == pytest.approx(3.7 - 0.043, abs=0.04)
        assert taxel["gap_mm"] == pytest.approx(0.3 - 0.043, abs=0.03)
        assert taxel["planned_plate_mg"] == pytest.approx(1.24 * (blocks + boss), rel=1e-4)
        assert taxel["resonance_hz"] == pytest.approx(channel.resonance_hz, rel=0.01)


def test_ballast_and_pins_on_beams_are_laid_as_planned(tmp_path):
    """The pocket above the recess belongs to the plan; a pin's plastic makes no layer of the beam that it stands on."""
    plan = make_plan(parse_spec(HEAVY))
    hand = Hand(plan, recess_mm=2.1, thin_mm=0.05)
    report = check_gcode(plan, hand.file(tmp_path))
    assert not report.findings
    blocks = 5.15**2 * 4.5 - math.pi / 4 * (4.25**2 * 2.1 + 4.0**2 * 2.0)
    for taxel in report.figures["taxels"]:
        channel = plan.channels[taxel["channel"]]
        (beam,) = taxel["beams"]
        assert (beam["layers"], beam["thickness_mm"]) == (5, pytest.approx(0.6))
        assert taxel["planned_plate_mg"] == pytest.approx(1.24 * blocks, rel=1e-4)
        assert taxel["recess_depth_mm"] == pytest.approx(4.1, abs=1e-6)
        # The magnet's recess, not the narrower pocket of the rod above it.
        assert taxel["recess_room_mm"] == pytest.approx(4.25 - 0.043, abs=0.04)
        assert taxel["resonance_hz"] == pytest.approx(channel.resonance_hz, rel=0.01)
    shallow = check_gcode(plan, replace(hand, shallower_mm=0.3).file(tmp_path))
    assert "roof over the ballast's pocket" in one(shallow, "laid.recess").message
    assert told(shallow, "error") == {"laid.recess"}


@pytest.mark.sample(1)
@pytest.mark.parametrize("quarters", [2, 3])
def test_the_pad_is_found_wherever_it_lies(plan, tmp_path, quarters):
    """Turned by 180° the pad differs by its beams' widths alone."""
    figures = check_gcode(plan, Hand(plan, (31.37, 208.11), quarters).file(tmp_path)).figures
    assert figures["turned_deg"] == 90 * quarters
    assert figures["centre_mm"] == pytest.approx([31.37, 208.11], abs=0.01)


@pytest.mark.sample(1)
@pytest.mark.parametrize("how", [{"unit": 25.4}, {"footer": "G92 E0\nM104 S0"}, {"relative": True, "unit": 25.4}])
def test_dialects_say_the_same(plan, usual, tmp_path, how):
    """The same moves in other dialects, one without comments, give the same figures."""
    other = check_gcode(plan, Hand(plan, quarters=1, notes=False).file(tmp_path, **how)).figures
    for one, two in zip(usual.figures["taxels"], other["taxels"], strict=True):
        assert two["resonance_hz"] == pytest.approx(one["resonance_hz"], rel=2e-3)
        assert two["plate_mg"] == pytest.approx(one["plate_mg"], rel=1e-4)
        assert two["recess_depth_mm"] == pytest.approx(one["recess_depth_mm"], abs=1e-4)


def test_a_lost_layer_lowers_the_resonance_as_thickness_does(plan, tmp_path):
    hand = Hand(plan, width=lambda taxel, layer: 0.0 if taxel.channel == 0 and layer else None)
    report = check_gcode(plan, hand.file(tmp_path))
    assert told(report) == {"laid.layers", "laid.resonance", "laid.selectivity"}
    finding = one(report, "laid.layers")
    assert finding.where == "2 of 4 beams" and "0.2 mm thick in 1 layer, instead of 0.3 mm in 2" in finding.message
    assert report.figures["taxels"][0]["resonance_hz"] == pytest.approx(
        plan.channels[0].resonance_hz * (0.2 / 0.3) ** 1.5, rel=0.03
    )
    assert report.figures["taxels"][1]["resonance_hz"] == pytest.approx(plan.channels[1].resonance_hz, rel=0.01)


def test_other_layers_are_named_with_the_setting(plan, tmp_path):
    def width(taxel, layer):
        return plan.channels[taxel.channel].beam.width_mm if layer == 0 else 0.0

    report = check_gcode(plan, Hand(plan, steps_mm=(0.2, 0.2), width=width).file(tmp_path))
    finding = one(report, "laid.layers")
    assert finding.where == "4 of 4 beams" and finding.level == "error"
    assert finding.message.endswith("layer height is 0.2 mm, must be 0.1 mm")


def test_a_narrow_first_layer_lowers_the_resonance_by_the_root_of_its_share(plan, tmp_path):
    """Of two layers, 0.2 and 0.1 mm, the first is 0.4 mm narrower; the second moment is computed by hand."""
    wide = plan.channels[1].beam.width_mm
    hand = Hand(plan, width=lambda taxel, layer: wide - 0.4 if taxel.channel == 1 and not layer else None)
    footer = "; elefant_foot_compensation = 0.2\n; layer_height = 0.1"
    report = check_gcode(plan, hand.file(tmp_path, footer=footer))
    finding = one(report, "laid.width")
    assert finding.where == "2 of 4 beams" and "laid 0.39" in finding.message
    assert "elephant foot compensation is 0.2 mm, must be 0 mm" in finding.message
    areas = np.array([0.2 * (wide - 0.4), 0.1 * wide])
    middles = np.array([0.1, 0.25])
    heights = np.array([0.2, 0.1])
    mean = (areas * middles).sum() / areas.sum()
    stiff = (areas * (heights**2 / 12 + (middles - mean) ** 2)).sum() / (wide * 0.3**3 / 12)
    laid = report.figures["taxels"][1]["resonance_hz"]
    assert laid == pytest.approx(plan.channels[1].resonance_hz * math.sqrt(stiff), rel=0.02)


SPOILED = [
    (
        {"width": lambda taxel, layer: 0.0 if taxel.id == "r0c1k0" else None, "gap": "r0c0k0", "raft_mm": 0.6},
        {"laid.beam": "r0c1k0", "laid.gap": "is closed", "laid.raft": "0.6 mm above the bed"},
        {"laid.beam", "laid.gap", "laid.raft"},
    ),
    (
        {"piece": lambda taxel, layer: (0, 0.6) if taxel.id == "r0c0k1" else None, "flow": 1.06},
        {"laid.beam": "r0c0k1 at 4.", "laid.mass": "% of the plan's"},
        {"laid.beam"},
    ),
    (
        {"piece": lambda taxel, layer: (0, 0.6) if taxel.id == "r0c0k1" and layer else None, "recess_mm": 0.2},
        {
            "laid.beam": "have a layer with a piece missing, so far from the root (r0c0k1 at 4.",
            "laid.recess": "0.2 mm are left of 0.4 mm",
        },
        {"laid.recess"},
    ),
    (
        {"width": lambda taxel, layer: 0.8 if taxel.channel == 0 and not layer else None, "tighter_mm": 0.15},
        {"laid.width": "wider", "laid.washer": "3.5 mm"},
        {"laid.washer"},
    ),
    ({"strand_mm": 0.4}, {"laid.recess": "0.1 mm are left of 0.4 mm"}, {"laid.recess"}),
    ({"recess_mm": 0.6}, {"laid.recess": "0.6 mm deep"}, set()),
]
"""Faults of a print, what is told of each, and which are errors."""


@pytest.mark.sample(3)
@pytest.mark.parametrize(("changes", "words", "errors"), SPOILED)
def test_what_is_spoiled_is_told(plan, tmp_path, changes, words, errors):
    report = check_gcode(plan, Hand(plan, **changes).file(tmp_path))
    for code, said in words.items():
        assert said in one(report, code).message
    assert errors <= told(report, "error")
    lost = [t["id"] for t in report.figures["taxels"] if t["resonance_hz"] is None]
    assert lost == [name[:6] for name in (words.get("laid.beam", ""),) if name.startswith("r0c")]


@pytest.mark.sample(4)
@pytest.mark.parametrize("deeper_mm", np.arange(0, 0.81, 0.08).round(2).tolist())
def test_both_sides_of_a_gap_are_measured_at_the_same_stations(deeper_mm):
    """Also where the edge of two stations, 0.4 mm apart, runs along the middle of the gap."""
    plan = make_plan(parse_spec(NARROW.replace("depth_mm = 12.5", f"depth_mm = {12.5 + deeper_mm}")))
    taxel = TaxelMap(plan, plan.channels[0])
    assert taxel.stations > 30
    for station in range(taxel.stations):
        assert {*taxel.side[taxel.station == station].tolist()} == {0, 1}


def test_plates_as_heavy_as_laid(plan, usual, tmp_path):
    """f goes with the inverse root of the moving mass: plastic by hand, and a washer of 7.85 g/cm³ and 0.3 mm."""
    heavy = check_gcode(plan, Hand(plan, flow=1.06).file(tmp_path)).figures["taxels"][0]
    usual = usual.figures["taxels"][0]
    more = heavy["plate_mg"] - usual["plate_mg"]
    assert more == pytest.approx(0.06 * 1.24 * (4.6**2 * 4 - math.pi / 4 * 3.7**2 * 0.4), rel=0.02)
    moving = usual["plate_mg"] + 7.85 * 0.3 * math.pi / 4 * (3.5**2 - 1.7**2)
    # What is more is spread nearly as what moves is; the effect is 2.4 %.
    assert heavy["resonance_hz"] / usual["resonance_hz"] == pytest.approx((1 + more / moving) ** -0.5, abs=2e-3)


def test_a_print_with_warnings_alone_is_nearly_as_planned(plan, usual, tmp_path):
    heavy = check_gcode(plan, Hand(plan, flow=1.03).file(tmp_path))
    assert told(heavy, "warning") and not told(heavy, "error")
    first, planned = (
        laid_text(replace(report, figures={**report.figures, "compared_with": "the plan"}), "pad.gcode").splitlines()[0]
        for report in (heavy, usual)
    )
    assert first.startswith("pad.gcode would print nearly as planned (")
    assert planned == "pad.gcode would print as planned"


def test_rows_of_channels_are_in_their_order(usual):
    taxels = usual.figures["taxels"][::-1]
    assert taxels[0]["channel"] > taxels[-1]["channel"]
    lines = laid_text(
        replace(usual, figures={**usual.figures, "compared_with": "the plan", "taxels": taxels}), "pad.gcode"
    ).splitlines()
    rows = [line.split()[0] for line in lines[lines.index("") + 3 :] if line]
    assert rows == sorted({str(taxel["channel"]) for taxel in taxels})


def test_moves_arcs_and_modes_by_hand(tmp_path):
    """Half circles each way, a whole one, and lines in both modes and units have length and plastic known by hand."""
    path = tmp_path / "arcs.gcode"
    path.write_text(
        "G21\nG90\nM83\nG1 Z0.2\nG0 X10 Y0\n"
        "G2 X-10 Y0 I-10 J0 E1\n"  # below: clockwise from +x
        "G3 X10 Y0 I10 J0 E1\n"  # back the same way
        "G3 I-10 J0 E2\n"  # once around
        ";TYPE:Skirt/Brim\nG1 X50 E9\n;TYPE:Perimeter\n"
        "G91\nG1 X-10 Y5 E1 ; X99 E99\nG90\nG92 X0 Y0\nG20\nG1 X1 E0.1\n"
        "M117 X7 Y8 E9\nG1 Z1 E-1\n;HEIGHT:0.3\nG1X0Y0E.5\n"
    )
    below, above = read_layers(path, 1.75)
    length = np.hypot(*(below.stop - below.start).T)
    # 5 micrometres of 10 mm: a chord is 0.02 % short.
    assert length.sum() == pytest.approx(4 * math.pi * 10 + math.hypot(10, 5) + 25.4, rel=2e-4)
    assert below.volume_mm3.sum() == pytest.approx(FILAMENT_MM2 * (1 + 1 + 2 + 1 + 2.54), rel=1e-9)
    on_circle = np.hypot(*below.start[below.area_mm2 < 0.16].T)
    assert np.abs(on_circle[:-2] - 10).max() < 1e-6
    assert below.start[1, 1] < 0 and np.isnan(below.height_mm).all()
    assert (above.top_mm, above.height_mm.tolist()) == (pytest.approx(25.4), [0.3])


def test_relative_and_absolute_extrusion_are_the_same(plan, tmp_path):
    """A file with M83 has the layers of one with M82."""
    one = list(read_layers(Hand(plan).file(tmp_path), 1.75))
    two = list(read_layers(Hand(plan).file(tmp_path, relative=True), 1.75))
    assert len(one) == len(two) == 49
    for a, b in zip(one, two, strict=True):
        assert a.top_mm == b.top_mm
        for name in ("start", "stop", "area_mm2", "height_mm"):
            np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=2e-4)


def test_thick_filament_is_told_by_the_plastic(plan, tmp_path):
    """Cura's files do not state the filament; the same plastic then is (1.75/2.85)² of the length."""
    path = Hand(plan, notes=False).file(tmp_path, relative=True)
    share = (1.75 / 2.85) ** 2
    lines = [
        f"{line[: line.index(' E')]} E{float(line[line.index(' E') + 2 :]) * share:.7f}" if " E" in line else line
        for line in path.read_text().replace("G92 E0\n", "").splitlines()
    ]
    path.write_text("\n".join(lines))
    report = check_gcode(plan, path)
    assert report.findings == () and report.figures["filament_mm"] == 2.85


def moved(path, change):
    """Move every point (x, y) of a file of G-code in mm."""

    def replaced(match):
        x, y = change(float(match[1]), float(match[2]))
        return f"X{x:.6f} Y{y:.6f}"

    path.write_text(re.sub(r"X([-\d.]+) Y([-\d.]+)", replaced, path.read_text()))
    return path


def test_a_pad_whose_outline_is_a_micrometre_off_is_found_as_before(plan, tmp_path):
    """Files have coordinates in micrometres, so that the ends of a straight bead may differ by one or two of them.

    Only beads along the right and the upper edge are bent. Looked for without them, the pad would lie half a line off.
    """

    def bent(x, y):
        up = x - 100 > 12.5 and y > 90
        right = y - 90 > 12.5 and x > 100
        return x + 1.5e-3 * up, y + 1.5e-3 * right

    figures = check_gcode(plan, moved(Hand(plan).file(tmp_path), bent)).figures
    assert figures["centre_mm"] == pytest.approx([100, 90], abs=2e-3)


@pytest.mark.parametrize("gap_mm", [0.3, 0.311, 0.322])
def test_beads_on_both_sides_of_a_gap_are_as_far_apart_as_they_are(gap_mm):
    """Within 2 µm wherever they lie in the map's pixels of 20 µm: the middle of the gap is nobody's pixel."""
    plan = make_plan(parse_spec(f'{FOUR}printer = {{ name = "fdm-0.4", smallest_gap_mm = {gap_mm} }}'))
    maps = PadMaps(plan)
    taxel = plan.taxels[0]
    channel = plan.channels[taxel.channel]
    arrangement = plan.arrangement(channel)
    half_mm = float(arrangement.blocks[0][3])
    wall_mm = float(arrangement.window_mm[1]) / 2
    inward_mm = np.linspace(0.03, 0.3, 101)
    hand = Hand(plan)
    washer = float(arrangement.washer_x_mm), 0.0
    away_mm = []
    for y in (half_mm - inward_mm, wall_mm + inward_mm):
        points = np.array([hand.on_pad(taxel, channel, washer, washer[0] + 0.013, float(at)) for at in y])
        away_mm.append(maps.from_gap_mm(*maps.looked_up(points)))
    assert sum(away_mm) == pytest.approx(wall_mm - half_mm + 2 * inward_mm, abs=2e-3)


def test_what_is_shorter_than_its_rounding_says_nothing_of_its_width(plan, tmp_path):
    """A micrometre of bead with the least plastic that a file can state would be 0.8 mm wide, and narrow a recess."""
    at = next(t for t in plan.taxels if t.id == "r0c1k0")
    x, y = at.x_mm + 100 + 1.9, at.y_mm + 90
    dot = f"M83\nG1 Z0.3\nG0 X{x:.3f} Y{y:.3f}\nG1 X{x:.3f} Y{y + 1e-3:.3f} E0.00003\nM82\n"
    path = Hand(plan).file(tmp_path)
    text = path.read_text()
    rest = text.index(";LAYER_CHANGE", text.index(";Z:0.3"))
    path.write_text(text[:rest] + dot + text[rest:])
    report = check_gcode(plan, path)
    assert report.findings == ()
    room = {taxel["id"]: taxel["recess_room_mm"] for taxel in report.figures["taxels"]}
    assert room[at.id] == pytest.approx(3.7 - 0.043, abs=0.04)


def test_supports_in_a_recess_are_told(plan, tmp_path):
    """A taxel's recess holds a support, at a height of its own; a skirt around the pad is none."""
    at = next(t for t in plan.taxels if t.id == "r0c1k0")
    x, y = at.x_mm + 100, at.y_mm + 90
    support = f"G92 E0\n;TYPE:Support material\nG0 X{x - 1:.3f} Y{y:.3f} Z0.25\nG1 X{x + 1:.3f} Y{y:.3f} E0.05"
    skirt = "G92 E0\n;TYPE:Skirt/Brim\nG0 X70 Y70\nG1 X130 Y70 E1"
    report = check_gcode(plan, Hand(plan).file(tmp_path, footer=f"{skirt}\n{support}\n; support_material = 1"))
    (finding,) = report.findings
    assert (finding.code, finding.level, finding.where) == ("laid.support", "error", "1 of 4 taxels")
    assert finding.message.endswith("(r0c1k0): supports is 1, must be none")
    assert check_gcode(plan, Hand(plan).file(tmp_path, footer=skirt)).findings == ()


@pytest.mark.sample(1)
@pytest.mark.parametrize("scale", [0.985, 1.0, 1.01])
def test_a_pad_of_another_size_is_told_with_its_size(plan, tmp_path, scale):
    """Within 0.3 %: beads lie half their width inside the plan's plastic, and the middle of all sizes is taken."""
    path = moved(Hand(plan).file(tmp_path), lambda x, y: (100 + scale * (x - 100), 90 + scale * (y - 90)))
    report = check_gcode(plan, path)
    assert report.figures["scale"] == pytest.approx(scale, abs=3e-3)
    assert ("laid.scale" in told(report, "error")) == (scale != 1)


def test_a_mirrored_pad_is_told(plan, tmp_path):
    path = moved(Hand(plan).file(tmp_path), lambda x, y: (200 - x, y))
    with pytest.raises(FileError, match="holds the pad four mirrored; switch mirroring off"):
        check_gcode(plan, path)


def test_every_pad_on_the_plate_is_judged(plan, tmp_path):
    """Three of them, the second without a beam; one after the other only the first is, which is said."""
    whole = Hand(plan).lay()
    spoiled = Hand(plan, width=lambda taxel, layer: 0.0 if taxel.id == "r0c1k0" else None).lay()
    beads = [*whole.beads]
    for pad, aside_mm in ((spoiled, 50.0), (whole, 100.0)):
        beads += [(x0 + aside_mm, y0, x1 + aside_mm, y1, *rest) for x0, y0, x1, y1, *rest in pad.beads]
    path = tmp_path / "three.gcode"
    whole.beads = sorted(beads, key=lambda bead: bead[-1])
    path.write_text(whole.text())
    report = check_gcode(plan, path)
    pads = sorted((*pad["centre_mm"], pad["errors"] > 0) for pad in report.figures["pads"])
    assert [bad for *_, bad in pads] == [False, True, False]
    assert np.array([pad[:2] for pad in pads]) == pytest.approx(np.array([[100, 90], [150, 90], [200, 90]]), abs=0.01)
    beam = one(report, "laid.beam")
    assert beam.where.endswith("1 of 4 beams") and "r0c1k0" in beam.message
    first = Hand(plan).lay().text()
    path.write_text(first + Hand(plan, (150.0, 90.0)).lay().text())
    one_by_one = check_gcode(plan, path)
    assert [(f.code, f.level) for f in one_by_one.findings] == [("laid.after", "note")]
    assert len(one_by_one.figures["pads"]) == 1


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("setting", "cause"),
    [
        ("extrusion_multiplier = 0.9", "extrusion multiplier is 0.9, must be 1"),
        ("filament_flow_ratio = 0.9", "extrusion multiplier is 0.9, must be 1"),
        ("ironing = 1\n; ironing_type = top", "ironing is 1, must be 0"),
        ("spiral_mode = 1", "spiral vase is 1, must be 0"),
        ("fuzzy_skin = all", "fuzzy skin is all, must be none"),
    ],
)
def test_a_setting_that_may_spoil_all_is_named_with_what_is_spoiled(plan, tmp_path, setting, cause):
    report = check_gcode(plan, Hand(plan, flow=0.9).file(tmp_path, footer=f"; {setting}"))
    assert one(report, "laid.mass").level == "error" and one(report, "laid.mass").message.endswith(cause)
    as_planned = check_gcode(plan, Hand(plan).file(tmp_path, footer=f"; {setting}\n; ironing_type = top"))
    assert as_planned.findings == ()


def test_what_detuned_taxels_cost_is_told_in_db(tmp_path, monkeypatch, capsys):
    """As re-tuning says of a print of one coil that was measured to have these resonances, and the planned Q."""
    monkeypatch.chdir(tmp_path)
    plan = make_plan(parse_spec(ONE_COIL))
    wide = plan.channels[1].beam.width_mm
    hand = Hand(plan, width=lambda taxel, layer: 0.9 * wide if taxel.channel and layer < 2 else None)
    report = check_gcode(plan, hand.file(tmp_path))
    figures = report.figures
    lost = one(report, "laid.selectivity")
    # With the report's own figures, rounded twice as these are.
    laid = f"has {figures['planned_db']:.1f} dB of ON over OFF with the planned tones"
    assert f"{laid} (laid as planned: {figures['drawn_db']:.1f} dB)" in lost.message
    assert f"and {figures['retuned_db']:.1f} dB re-tuned (" in lost.message
    assert figures["planned_db"] < figures["drawn_db"] - 1
    rows = [f"{t['id']},{t['resonance_hz']},{plan.channels[t['channel']].q}" for t in figures["taxels"]]
    Path("measured.csv").write_text("\n".join(["taxel,resonance_hz,q", *rows, ""]))
    Path("two.toml").write_text(ONE_COIL)
    assert cli.run(["retune", "two.toml", "measured.csv", "--json"]) in (0, 1)
    measured = json.loads(capsys.readouterr().out)
    assert figures["planned_db"] == pytest.approx(measured["before_db"], abs=0.3)
    assert figures["retuned_db"] == pytest.approx(measured["after_db"], abs=0.3)


def gcode_of_another(plan, folder):
    return Hand(make_plan(parse_spec(ONE_COIL))).file(folder)


def cut_short(plan, folder):
    path = Hand(plan).file(folder)
    path.write_text(path.read_text()[: path.stat().st_size // 2].rpartition("\n")[0])
    return path


def bytes_of(data, name="pad.gcode"):
    def make(plan, folder):
        (folder / name).write_bytes(data)
        return folder / name

    return make


BAD = {
    "another pad": (gcode_of_another, "does not hold the pad four"),
    "cut short": (cut_short, "the file is cut short"),
    "binary G-code": (bytes_of(b"GCDE\1\0\0\0"), "export it as text"),
    "an STL": (bytes_of(bytes(80) + (1).to_bytes(4, "little") + bytes(50)), "is an STL; slice it first"),
    "a text STL": (bytes_of(b"solid pad\nfacet normal 0 0 1\n"), "is an STL; slice it first"),
    "a 3MF": (bytes_of(b"PK\3\4" + bytes(99)), "slice it first"),
    "other binary": (bytes_of(bytes(range(256))), "is binary"),
    "empty": (bytes_of(b" \n"), "is empty"),
    "a profile": (bytes_of("Schichthöhe = 0,2\nlayer_height = 0.2\n".encode()), "no moves that lay plastic"),
    "wide text": (bytes_of("G1 X1 Y2 E3\n".encode("utf-16")), "is UTF-16"),
    "no number": (bytes_of(b"G1 Z1\nG1 X1 Y2 E3\nG1 X1.2.3 E4\n"), "line 3 is no G-code .* 'G1 X1.2.3 E4'"),
    "one line": (bytes_of(b"x" * 9_000_000), "has a line that does not end"),
    "an arc by radius": (bytes_of(b"G1 Z1\nG1 X1 Y2 E3\nG2 X5 R3 E4\n"), "line 3 is an arc by its radius"),
    "another size": (bytes_of(b"G1 Z1\nG1 X1 E1\nG1 X90000 E2\nG1 Y3 E3\n"), "spreads over"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_gcode_of_this_pad_is_refused(plan, tmp_path, name):
    make, words = BAD[name]
    with pytest.raises(FileError, match=words):
        check_gcode(plan, make(plan, tmp_path))


def test_the_command_gives_the_verdict_first_then_what_to_set(tmp_path, capsys, monkeypatch):
    """A real slicer's usual profile: layers, elephant foot, bridges, and every lost beam are reported."""
    monkeypatch.chdir(tmp_path)
    Path("four.toml").write_text(FOUR)
    Path("four.gcode").write_bytes(gzip.decompress(REFERENCE.read_bytes()))
    assert cli.run(["check", "--gcode", "four.gcode", "--spec", "four.toml"]) == 1
    out = capsys.readouterr().out
    assert "would not print as planned" in out.splitlines()[0]
    told = " ".join(out.split())
    for words in (
        "layer height 0.1 mm (is 0.2 mm)",
        "elephant foot compensation 0 mm (is 0.2 mm)",
        "thick bridges off",
    ):
        assert words in told
    assert "4 of 4 beams" in told and "[laid.layers]" in told
    assert cli.run(["check", "--gcode", "four.gcode", "--spec", "four.toml", "--verbose"]) == 1
    assert len(re.findall(r"^ *r0c\dk\d +\d", capsys.readouterr().out, re.M)) == 4
    assert cli.run(["check", "--json", "--gcode", "four.gcode", "--spec", "four.toml"]) == 1
    shown = json.loads(capsys.readouterr().out)
    assert shown["figures"]["slicer"] == "PrusaSlicer 2.5.0" and shown["figures"]["turned_deg"] == 90
    assert shown["figures"]["centre_mm"] == pytest.approx([90, 100], abs=0.01)
    for taxel in shown["figures"]["taxels"]:
        assert [beam["layers"] for beam in taxel["beams"]] == [1]
        # (2/3)^1.5 of the thickness, less what the elephant foot takes of the width.
        assert 0.4 < taxel["resonance_hz"] / taxel["planned_hz"] < 0.56
    report = pg.check("four.gcode", "four.toml", gcode=True)
    assert {f.code for f in report.findings} >= {"laid.layers", "laid.recess", "laid.resonance", "laid.width"}


def test_usage(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for arguments, words in (
        (["--gcode", "a.gcode"], "padgen: --spec: is needed to check G-code"),
        ([], "needs either a mesh or --gcode FILE"),
        (["a.stl", "--gcode", "a.gcode"], "needs either a mesh or --gcode FILE"),
        (["--gcode", "a.gcode", "--spec", "paper-32"], "there is no such file"),
    ):
        assert cli.run(["check", *arguments]) == 2
        assert words in capsys.readouterr().err


def test_settings_of_slicers(tmp_path):
    path = tmp_path / "a.gcode"
    path.write_text(
        "; generated by OrcaSlicer 2.1.0 on 2026\nG1 X1\n; elefant_foot_compensation = 0.15\r\n;layer_height = 0.2\n"
    )
    assert read_settings(path) == {
        "slicer": "OrcaSlicer 2.1.0",
        "elefant_foot_compensation": "0.15",
        "layer_height": "0.2",
    }


def test_a_slicer_whose_name_is_no_unicode_is_read_with_marks(tmp_path):
    path = tmp_path / "torn.gcode"
    path.write_bytes(b"; generated by PrusaSlicer\xc3 on\nG1 X1 Y1 E1\n; layer_height = 0.2\n")
    assert read_settings(path) == {"slicer": "PrusaSlicer\ufffd", "layer_height": "0.2"}
