"""Pads sliced by a real slicer, with the settings that padgen writes beside them (`make slice` runs this)."""

import json
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest

from padgen.core.errors import PadgenError
from padgen.make.pad import Pad
from padgen.make.planning import plan_for
from padgen.planner import plan_from_json
from padgen.planner.plan import TURNS
from padgen.planner.printing import PROFILE_FILE
from padgen.planner.suspensions import names
from padgen.sliced.judge_laid import check_gcode
from padgen.spec import load_spec, parse_spec
from padgen.spec.load import template_paths
from tests.gcode import ROUND_EDGES, laid_recesses, read_gcode

pytestmark = pytest.mark.slicer

ODD = 10


def program(name, *arguments):
    found = shutil.which(name)
    assert found, f"{name} is not installed; make slice installs it"
    return subprocess.run([found, *map(str, arguments)], capture_output=True, text=True, check=True).stdout


@cache
def odd_specs():
    """Draw small pads with random printers, suspensions, washers, plates and gaps; keep those that can be planned."""
    rng = np.random.default_rng(16)
    found = {}
    while len(found) < ODD:
        printer = rng.choice(["fdm-0.4", "fdm-0.25"])
        washer = rng.choice(["m1.6", "m2", "m2.5", "m3"])
        topology = rng.choice(names())
        rows, columns, channels = rng.integers(1, 3, 3)
        low = rng.uniform(40, 90)
        width = rng.uniform(9, 22) * columns * channels
        depth = rng.uniform(9, 22) * rows
        text = f"""
            name = "odd-{len(found)}-{printer}-{topology}-{washer}"
            resolution = {rows * columns * channels}
            band_hz = [{low}, {low * rng.uniform(2, 6)}]
            q_min = {rng.uniform(10, 30)}
            printer = "{printer}"
            washer = "iso7092-{washer}"
            pad = {{ width_mm = {width}, depth_mm = {depth}, rib_mm = {rng.uniform(0.6, 1.5)} }}
            taxel = {{ washer_clearance_mm = {rng.uniform(0.25, 0.4)}, fillet_mm = {rng.uniform(0, 0.6)} }}
            coil = {{ grid = [{rows}, {columns}] }}
            suspension = {{ topology = "{topology}" }}
        """
        try:
            spec = parse_spec(text)
            plan_for(spec)
        except PadgenError:
            continue
        found[spec.name] = spec
    return found


def fdm_templates():
    return [name for name in template_paths() if load_spec(name).printer.process == "fdm"]


@cache
def built(name, folder):
    """Build and slice a template or an odd spec; return its plan, folder, G-code lines and middle on the bed.

    The project 3MF is sliced as it is, with nothing set and nothing moved.
    """
    spec = load_spec(name) if name in fdm_templates() else odd_specs()[name]
    pad = Pad(spec)
    path = folder / name
    pad.save(path, formats=["stl", "3mf"])
    program("prusa-slicer", "--export-gcode", path / "pad.3mf", "--dont-arrange", "--output", path / "pad.gcode")
    middle = np.array([spec.printer.bed_x_mm, spec.printer.bed_y_mm]) / 2
    return pad.plan, path, read_gcode(path / "pad.gcode"), middle


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("sliced")


@pytest.fixture(params=[*fdm_templates(), *(range(ODD))], ids=str)
def sliced(request, folder):
    name = request.param if isinstance(request.param, str) else list(odd_specs())[request.param]
    return built(name, folder)


def around(lines, middle, reach):
    """Return the lines that come within `reach` of a place."""
    low = np.minimum(lines.start, lines.stop)
    high = np.maximum(lines.start, lines.stop)
    near = ((low < middle + reach) & (high > middle - reach)).all(1)
    parts = (getattr(lines, name)[near] for name in ("start", "stop", "width", "height", "layer"))
    return type(lines)(*parts, lines.layer_top_mm)


def own_axes(plan, taxel, lines, middle):
    """Return the ends of lines in the taxel's own axes: the root at x = 0, the washer at y = 0."""
    channel = plan.channels[taxel.channel]
    cosine, sine = TURNS[channel.site.along]
    sign = -1 if taxel.turned else 1
    turn = sign * np.array([[cosine, -sine], [sine, cosine]])
    place = np.array([taxel.x_mm, taxel.y_mm]) + middle
    washer = np.array([float(plan.arrangement(channel).washer_x_mm), 0.0])
    return [(ends - place) @ turn + washer for ends in (lines.start, lines.stop)]


def laid_mm3(plan, taxel, lines, middle, low, high):
    """Return the plastic of each line between two corners in the taxel's own axes."""
    start, stop = own_axes(plan, taxel, lines, middle)
    along = stop - start
    low = np.array(low, float)
    high = np.array(high, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort(np.stack([(low - start) / along, (high - start) / along]), axis=0)
    # Of a line along an axis the other coordinate decides.
    flat = np.abs(along) < 1e-9
    inside = (start > low) & (start < high)
    first = np.where(flat, np.where(inside, 0.0, 2.0), ends[0]).max(1)
    last = np.where(flat, np.where(inside, 1.0, -1.0), ends[1]).min(1)
    return np.clip(np.minimum(last, 1.0) - np.maximum(first, 0.0), 0.0, 1.0) * lines.volume_mm3


def straight_pieces(plan, channel):
    """Beams and the numbers of those of their pieces that are straight and long enough to be measured."""
    least = plan.spec.printer.shortest_beam_mm
    return [
        (path, k)
        for path in plan.arrangement(channel).beams
        for k, piece in enumerate(path.segments)
        if not piece.turn_rad and piece.length_mm >= least
    ]


def laid_widths(plan, taxel, lines, middle):
    """Return the excess width of every layer of every beam, and the plastic above the beams.

    The width is that of the plastic in the beam's middle half, less the planned width.
    """
    channel = plan.channels[taxel.channel]
    widths = []
    above = 0.0
    beam = channel.beam
    for path, k in straight_pieces(plan, channel):
        centre, along = np.split(np.array(path.within(k, 0.5), float), 2)
        half = float(path.segments[k].length_mm) / 4
        reach = np.abs(along) * half + np.abs(along[::-1]) * (beam.width_mm / 2 + 0.15)
        laid = laid_mm3(plan, taxel, lines, middle, centre - reach, centre + reach)
        layers = [lines.layer == layer for layer in range(beam.layers)]
        widths += [laid[at].sum() / (2 * half * lines.height[at].max()) - beam.width_mm for at in layers]
        above += laid[lines.layer == beam.layers].sum()
    return widths, above


def hollow_mm3(plan):
    """Return the volume of a plate's recess and of the pocket for round ballast above it."""
    plate = plan.plate
    recess = (plate.recess_diameter_mm**2 - plate.post_diameter_mm**2) * plate.recess_depth_mm
    ballast = plan.spec.ballast
    pocket = 0.0 if ballast is None else ballast.width_mm**2 * (plan.spec.pocket_top_mm - plate.recess_depth_mm)
    return np.pi / 4 * (recess + pocket)


def plate_share(plan, taxel, lines, middle):
    """Return the plastic laid in a plate with its boss, over the modelled volume."""
    block = plan.arrangement(plan.channels[taxel.channel]).blocks[0]
    low = np.array([block.low_x_mm, block.low_y_mm], float)
    high = np.array([block.high_x_mm, block.high_y_mm], float)
    plate = plan.plate
    boss = plate.boss_diameter_mm / 2
    edge = plate.boss_edge_mm
    modelled = np.prod(high - low) * plate.thickness_mm - hollow_mm3(plan)
    modelled += np.pi * (boss**2 * (plate.boss_top_mm - plate.thickness_mm) - boss * edge**2 + edge**3 / 3)
    return float(laid_mm3(plan, taxel, lines, middle, low, high).sum() / modelled)


def laid_gap(plan, taxel, lines, middle):
    """The narrowest gap beside plate and beams, as laid: from the gap's middle to the next beads on both sides."""
    channel = plan.channels[taxel.channel]
    gap = plan.spec.printer.smallest_gap_mm
    block = plan.arrangement(channel).blocks[0]
    sides = ((float(block.low_y_mm) - gap / 2, -1.0), (float(block.high_y_mm) + gap / 2, 1.0))
    xs = np.linspace(float(block.low_x_mm) + 0.2, float(block.high_x_mm) - 0.2, 25)
    places = [(x, y, 0.0, out) for x in xs for y, out in sides]
    for (path, k), share, out in product(straight_pieces(plan, channel), np.linspace(0.1, 0.9, 7), (-1.0, 1.0)):
        point = path.within(k, share)
        places.append((*point.beside(out * (path.width_mm + gap) / 2), -out * point.along_y, out * point.along_x))
    start, stop = own_axes(plan, taxel, lines, middle)
    beads = (lines.width + ROUND_EDGES * lines.height) / 2
    along = stop - start
    rooms = []
    for place in np.array(places, float):
        off = place[:2] - start
        away = off - np.clip((off * along).sum(1) / (along**2).sum(1), 0, 1)[:, None] * along
        free = np.hypot(*away.T) - beads
        beyond = away @ place[2:] < 0
        for layer in range(plan.spec.printer.layers_up_to(float(block.height_mm))):
            own = lines.layer == layer
            rooms.append(free[own & beyond].min(initial=gap) + free[own & ~beyond].min(initial=gap))
    return float(min(rooms))


def test_beams_plates_gaps_and_recesses_are_laid_as_planned(sliced, capsys):
    plan, path, lines, middle = sliced
    spec = plan.spec
    reach = np.array([plan.cell.width_mm, plan.cell.depth_mm]).max()
    widths = []
    plates = []
    gaps = []
    recesses = []
    for taxel in plan.taxels:
        one = replace(plan, taxels=(taxel,))
        near = around(lines, np.array([taxel.x_mm, taxel.y_mm]) + middle, reach)
        off, above = laid_widths(plan, taxel, near, middle)
        assert above == 0.0 or plan.channels[taxel.channel].pin.on_beam, taxel
        widths += off
        plates.append(plate_share(plan, taxel, near, middle))
        gaps.append(laid_gap(plan, taxel, near, middle) / spec.printer.smallest_gap_mm)
        recesses += laid_recesses(one, near, tuple(middle))
    checks = json.loads((path / "checks.json").read_text())
    whole = lines.volume_mm3.sum() / checks["figures"]["volume_mm3"]
    room = min(recess.room_mm for recess in recesses) - spec.washer_or_magnet.outer_diameter_mm
    lost = plan.plate.recess_diameter_mm - 2 * spec.printer.xy_compensation_mm - min(r.room_mm for r in recesses)
    with capsys.disabled():
        print(
            f"\n{plan.name}: widths {min(widths):+.3f} ... {max(widths):+.3f} mm, plates {min(plates) - 1:+.2%} ..."
            f" {max(plates) - 1:+.2%}, pad {whole - 1:+.2%}, gaps {min(gaps):.0%}, washer {room:+.3f} mm,"
            f" lost {lost:.3f} mm"
        )
    assert np.abs(widths).max() <= 0.02
    deepest_mm = spec.pocket_top_mm or plan.plate.recess_depth_mm
    # Walls round deep recesses are laid heavy where one line becomes two, or light.
    assert np.abs(np.array(plates) - 1).max() <= (0.01 if deepest_mm < 0.6 else 0.07)
    assert whole == pytest.approx(1, abs=0.01 if deepest_mm < 0.6 else 0.015)
    assert min(gaps) >= 0.7
    for recess in recesses:
        assert recess.depth_mm == pytest.approx(deepest_mm, abs=0.02), recess
    # What the print check counts on, and that a washer enters.
    assert lost <= spec.printer.hole_loss_mm
    assert room >= 0


@pytest.mark.parametrize("name", ["pad.stl", "pad.3mf"])
def test_it_is_one_manifold_part(folder, name):
    _, path, *_ = built("paper-16", folder)
    lines = program("prusa-slicer", "--info", path / name).splitlines()
    told = dict(part.split("=", 1) for part in (line.replace(" ", "") for line in lines) if "=" in part)
    assert told["manifold"] == "yes"
    assert told["number_of_parts"] == "1"
    checks = json.loads((path / "checks.json").read_text())
    assert float(told["volume"]) == pytest.approx(checks["figures"]["volume_mm3"], rel=1e-4)


def test_profile_and_project_are_the_same_to_the_slicer(folder):
    """PrusaSlicer knows every line of the profile, takes it as it is, and finds it in the 3MF as well."""
    _, path, *_ = built("paper-16", folder)
    program(
        "prusa-slicer",
        "--export-gcode",
        path / "pad.stl",
        "--load",
        path / PROFILE_FILE,
        "--output",
        path / "stl.gcode",
    )
    asked = settings((path / PROFILE_FILE).read_text().splitlines())
    for name in ("pad.gcode", "stl.gcode"):
        lines = (path / name).read_text().splitlines()
        taken = settings(line.removeprefix("; ") for line in lines if line.startswith("; "))
        assert {key: taken.get(key) for key in asked} == asked, name


def test_a_slicer_without_variable_line_width(folder):
    """Slic3r 1.3 lays every beam in every layer, but in whole lines only: docs/printing.md advises against it."""
    plan, path, _, middle = built("paper-16", folder)
    printer = plan.spec.printer
    same = (path / PROFILE_FILE).read_text().splitlines()
    known = (
        "layer_height",
        "first_layer",
        "extrusion_",
        "perimeter_ex",
        "external_perimeter_ex",
        "fill_",
        "infill_",
        "thin_",
    )
    known += ("solid_infill_ex", "top_infill_ex", "xy_", "nozzle_", "filament_", "perimeters", "skirts", "bed_shape")
    (path / "slic3r.ini").write_text("\n".join(line for line in same if line.startswith(known)))
    centre = ",".join(str(v) for v in middle)
    program(
        "slic3r", "--load", path / "slic3r.ini", "--print-center", centre, "-o", path / "slic3r.gcode", path / "pad.stl"
    )
    told = []
    top = 0.0
    for line in (path / "slic3r.gcode").read_text().splitlines():
        words = line.split()
        height = float(words[1][1:]) if line.startswith("G1 Z") else top
        if line.startswith("G1 Z") and height in (printer.first_layer_mm, round(top + printer.layer_mm, 6)):
            told += [";LAYER_CHANGE", f";Z:{height}", f";HEIGHT:{height - top}"]
            top = height
        told.append(line)
    (path / "told.gcode").write_text("\n".join(told))
    lines = read_gcode(path / "told.gcode")
    widths = []
    for taxel in plan.taxels:
        off, above = laid_widths(plan, taxel, lines, middle)
        assert above == 0.0 or plan.channels[taxel.channel].pin.on_beam, taxel
        widths += off
    assert 0.04 < np.abs(widths).max() < 0.14


LINES = ("perimeter", "external_perimeter", "first_layer", "infill", "solid_infill", "top_infill")
WIDE = [f"--{kind.replace('_', '-')}-extrusion-width=0.7" for kind in LINES]
SUPPORTED = ["--support-material"]
VASE = ["--spiral-vase", "--perimeters=1", "--top-solid-layers=0", "--fill-density=0"]
KINDS = [
    ("as planned", [], "", ""),
    ("supports", SUPPORTED, "laid.support", "supports is 1"),
    (
        "supports from the bed",
        ["--support-material", "--support-material-buildplate-only"],
        "laid.support",
        "supports is 1",
    ),
    ("ironing", ["--ironing"], "laid.width", "ironing is 1"),
    (
        "vase",
        ["--spiral-vase", "--perimeters=1", "--top-solid-layers=0", "--fill-density=0"],
        "laid.mass",
        "spiral vase is 1",
    ),
    ("two pads", ["--duplicate=2"], "", ""),
    ("three pads", ["--duplicate=3"], "", ""),
    ("one after the other", ["--duplicate=2", "--complete-objects"], "laid.after", "object by object"),
    ("scale 101 %", ["--scale=1.01"], "laid.scale", "its size"),
    ("scale 99 %", ["--scale=0.99"], "laid.scale", "its size"),
    ("flow 90 %", ["--extrusion-multiplier=0.9"], "laid.mass", "extrusion multiplier is 0.9"),
    ("flow 110 %", ["--extrusion-multiplier=1.1"], "laid.mass", "extrusion multiplier is 1.1"),
    ("layers of 0.2 mm", ["--layer-height=0.2", "--first-layer-height=0.2"], "laid.layers", "layer height is 0.2"),
    ("infill 20 %", ["--fill-density=20%"], "laid.mass", "infill is 20%"),
    ("brim", ["--brim-width=5"], "", ""),
    ("raft", ["--raft-layers=2"], "laid.raft", "raft is 2"),
    ("elephant foot", ["--elefant-foot-compensation=0.3"], "laid.width", "elephant foot compensation is 0.3"),
    ("narrower", ["--xy-size-compensation=-0.1"], "laid.width", "xy size compensation is -0.1"),
    ("wider", ["--xy-size-compensation=0.1"], "laid.width", "xy size compensation is 0.1"),
    ("thick bridges", ["--thick-bridges"], "laid.recess", "thick bridges is on"),
    ("turned by 90°", ["--rotate=90"], "", ""),
    ("fuzzy skin", ["--fuzzy-skin=all"], "laid.gap", "fuzzy skin is all"),
    ("infill overlap", ["--infill-overlap=50%"], "laid.mass", "infill overlap is 50%"),
    ("coarse meshes", ["--resolution=0.2"], "laid.washer", "resolution is 0.2"),
    ("coarse paths", ["--gcode-resolution=0.3"], "laid.washer", "gcode resolution is 0.3"),
    ("outer walls first", ["--external-perimeters-first"], "", ""),
    ("thick filament", ["--filament-diameter=2.85"], "", ""),
    ("fed by volume", ["--use-volumetric-e"], "", ""),
    ("skirt", ["--skirts=3"], "", ""),
    ("seam at the rear", ["--seam-position=rear"], "", ""),
    ("round about perimeters", ["--avoid-crossing-perimeters"], "", ""),
    ("one wall", ["--perimeters=1"], "", ""),
    ("five walls", ["--perimeters=5"], "", ""),
    ("walls of one width", ["--perimeter-generator=classic"], "laid.width", "wall generator is classic"),
    ("no solid top", ["--top-solid-layers=0"], "", ""),
    ("five solid layers", ["--top-solid-layers=5", "--bottom-solid-layers=5"], "", ""),
    ("zigzag infill", ["--fill-pattern=rectilinear"], "laid.mass", "fill pattern is rectilinear"),
    ("thin walls", ["--thin-walls"], "", ""),
    ("thin bridges", ["--bridge-flow-ratio=0.6"], "", ""),
    ("above the bed", ["--z-offset=0.15"], "laid.raft", "above the bed"),
]
"""Kinds of slicing: arguments, the finding that it must have, and what that must say; none where it is as planned."""
DEPENDING = ("ironing", "elephant foot", "layers of 0.2 mm", "zigzag infill")
"""Kinds whose finding depends on the printer's line and layers."""
HARMLESS = ("zigzag infill",)
"""Kinds that some printers lay as planned."""
PRINTERS = {
    "fdm-0.25": '"fdm-0.25"',
    "0.3": '{ name = "own-0.3", nozzle_mm = 0.3 }',
    "fdm-0.4": '"fdm-0.4"',
    "0.5": '{ name = "own-0.5", nozzle_mm = 0.5 }',
    "0.6": '{ name = "own-0.6", nozzle_mm = 0.6 }',
}


@cache
def of_eight(printer, folder):
    """Build a pad of eight taxels for a printer; one that lays it as planned by our own profile."""
    text = (
        f'name = "eight"\nresolution = 8\nband_hz = [50, 200]\nq_min = 15\nprinter = {PRINTERS[printer]}\n'
        "pad = { width_mm = 40, depth_mm = 40 }\ncoil = { grid = [2, 2] }\n"
    )
    Pad(parse_spec(text)).save(folder / f"eight-{printer}", ("stl",))
    return folder / f"eight-{printer}"


@pytest.mark.parametrize("printer", PRINTERS)
@pytest.mark.parametrize(("kind", "arguments", "code", "word"), KINDS, ids=[kind for kind, *_ in KINDS])
def test_a_kind_of_slicing_is_judged_with_its_cause(folder, printer, kind, arguments, code, word):
    pad = of_eight(printer, folder)
    plan = plan_from_json((pad / "plan.json").read_text())
    path = pad / f"{kind}.gcode"
    ours = ("--load", pad / PROFILE_FILE, pad / "pad.stl", "--output", path)
    program("prusa-slicer", "--export-gcode", *ours, *arguments)
    report = check_gcode(plan, path)
    codes = {finding.code for finding in report.findings if finding.level != "note"}
    as_planned = {finding.code for finding in sliced_as_planned(printer, folder).findings}
    if not code or (code == "laid.support" and ";TYPE:Support" not in path.read_text()):
        assert codes <= as_planned, [finding.message for finding in report.findings]
    elif report.findings or kind not in HARMLESS:
        assert report.findings
        changes = [f"{setting['name']} is {setting['has']}" for setting in report.figures["settings_to_change"]]
        said = [*changes, *(finding.message for finding in report.findings)]
        assert any(word in sentence for sentence in said), [str(finding) for finding in report.findings]
        assert code in codes | {"laid.after"} or kind in DEPENDING
    count = 3 if kind == "three pads" else 2 if kind == "two pads" else 1
    assert len(report.figures["pads"]) == count


@cache
def sliced_as_planned(printer, folder):
    pad = of_eight(printer, folder)
    path = pad / "honest.gcode"
    program("prusa-slicer", "--export-gcode", "--load", pad / PROFILE_FILE, pad / "pad.stl", "--output", path)
    report = check_gcode(plan_from_json((pad / "plan.json").read_text()), path)
    assert not [finding for finding in report.findings if finding.level == "error"], report.findings
    return report


@pytest.mark.parametrize("printer", PRINTERS)
def test_another_nozzle_is_named_or_lays_the_pad_as_planned(folder, printer):
    pad = of_eight(printer, folder)
    path = pad / "nozzle.gcode"
    ours = ("--load", pad / PROFILE_FILE, pad / "pad.stl", "--output", path)
    program("prusa-slicer", "--export-gcode", *ours, "--nozzle-diameter=0.8", *WIDE)
    report = check_gcode(plan_from_json((pad / "plan.json").read_text()), path)
    assert {setting["name"]: setting["has"] for setting in report.figures["settings_to_change"]}["nozzle"] == "0.8 mm"


def settings(lines):
    return dict(line.split(" = ", 1) for line in lines if " = " in line and not line.startswith("#"))


def test_an_ordinary_profile_is_told_with_its_settings_and_every_lost_layer(folder):
    """0.2 mm layers and 0.2 mm of elephant-foot compensation lose the second layer of every beam."""
    Pad(load_spec("paper-32")).save(folder / "ordinary")
    folder = folder / "ordinary"
    plan = plan_from_json((folder / "plan.json").read_text())
    program(
        "prusa-slicer",
        "--export-gcode", folder / "pad.stl", "--output", folder / "ordinary.gcode", "--nozzle-diameter=0.4",
        "--layer-height=0.2", "--first-layer-height=0.2", "--elefant-foot-compensation=0.2", "--rotate=90",
        "--bed-shape=0x0,250x0,250x210,0x210", "--center=90,100",
    )  # fmt: skip
    report = check_gcode(plan, folder / "ordinary.gcode")
    assert report.figures["centre_mm"] == pytest.approx((90, 100), abs=0.02)
    assert report.figures["turned_deg"] == 90
    changes = {s["name"]: s["has"] for s in report.figures["settings_to_change"]}
    assert changes["layer height"] == "0.2 mm" and changes["elephant foot compensation"] == "0.2 mm"
    found = {f.code: f for f in report.findings}
    assert found["laid.layers"].where == "32 of 32 beams" and "layer height is 0.2 mm" in found["laid.layers"].message
    assert "elephant foot compensation is 0.2 mm" in found["laid.width"].message
    for taxel in report.figures["taxels"]:
        assert [beam["layers"] for beam in taxel["beams"]] == [1]
        # (0.2/0.3)^1.5 is -46 %; the rest is the width that the elephant foot takes.
        assert -0.6 < taxel["resonance_hz"] / taxel["planned_hz"] - 1 < -0.45
