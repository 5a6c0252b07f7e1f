"""A real slicer's judgement of the paper's pad (`make slice` installs it and runs this)."""

import json
import shutil
import subprocess

import pytest

from padgen.make.pad import Pad
from padgen.measured.judge_laid import check_gcode
from padgen.planner import plan_from_json
from padgen.spec import load_spec

pytestmark = pytest.mark.slicer

CENTRE_MM = (125.0, 105.0)


def slicer(*arguments):
    program = shutil.which("prusa-slicer")
    assert program, "prusa-slicer is not installed; make slice installs it"
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=True)
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("sliced")
    Pad(load_spec("paper-32")).save(path)
    return path


@pytest.mark.parametrize("name", ["pad.stl", "pad.3mf"])
def test_it_is_one_manifold_part(folder, name):
    lines = slicer("--info", folder / name).splitlines()
    told = dict(part.split("=", 1) for part in (line.replace(" ", "") for line in lines) if "=" in part)
    assert told["manifold"] == "yes"
    assert told["number_of_parts"] == "1"
    checks = json.loads((folder / "checks.json").read_text())
    assert float(told["volume"]) == pytest.approx(checks["figures"]["volume_mm3"], rel=1e-4)


@pytest.fixture(scope="module")
def sliced(folder):
    """The plan, and the G-code of its pad with the settings that it gives."""
    plan = plan_from_json((folder / "plan.json").read_text())
    printing = {key: value.removesuffix(" mm").replace(" %", "%") for key, value in plan.printing.items()}
    widths = [
        f"--{kind}extrusion-width={printing['line_width']}"
        for kind in ("", "first-layer-", "perimeter-", "external-perimeter-", "infill-", "solid-infill-", "top-infill-")
    ]
    slicer(
        "--export-gcode", folder / "pad.stl", "--output", folder / "pad.gcode", *widths,
        f"--nozzle-diameter={printing['nozzle']}", f"--layer-height={printing['layer_height']}",
        f"--first-layer-height={printing['first_layer_height']}", "--perimeter-generator=arachne",
        f"--elefant-foot-compensation={printing['elephant_foot_compensation']}",
        f"--xy-size-compensation={printing['xy_size_compensation']}", f"--fill-density={printing['infill']}",
        f"--infill-overlap={printing['infill_overlap']}", f"--thick-bridges={int(printing['thick_bridges'] == 'on')}",
        "--filament-diameter=1.75", "--fill-pattern=rectilinear", "--skirts=0",
        "--bed-shape=0x0,250x0,250x210,0x210", f"--center={CENTRE_MM[0]},{CENTRE_MM[1]}",
    )  # fmt: skip
    return plan, check_gcode(plan, folder / "pad.gcode")


def test_it_lies_where_the_slicer_was_told(sliced):
    _, report = sliced
    assert report.figures["centre_mm"] == pytest.approx(CENTRE_MM, abs=0.02)
    assert report.figures["turned_deg"] == 0 and report.figures["settings_to_change"] == []


def test_every_beam_is_laid_as_wide_and_as_thick_as_planned(sliced):
    plan, report = sliced
    assert len(report.figures["taxels"]) == 32
    for taxel in report.figures["taxels"]:
        planned = plan.channels[taxel["channel"]].beam
        (beam,) = taxel["beams"]
        assert beam["broken_at_mm"] is None and beam["thin_at_mm"] is None, taxel
        # Half of what a bead's round edges take off in the thickest layer: 0.215 * 0.2 mm / 2.
        assert beam["width_mm"] == pytest.approx([planned.width_mm] * planned.layers, abs=0.022), taxel
        assert taxel["resonance_hz"] == pytest.approx(taxel["planned_hz"], rel=0.02), taxel


def test_the_pad_weighs_what_was_planned(folder, sliced):
    _, report = sliced
    checks = json.loads((folder / "checks.json").read_text())
    assert report.figures["plastic_mm3"] == pytest.approx(checks["figures"]["volume_mm3"], rel=0.01)
    for taxel in report.figures["taxels"]:
        assert taxel["plate_mg"] == pytest.approx(taxel["planned_plate_mg"], rel=0.01), taxel


def test_washers_enter_their_recesses_and_sink_in(sliced):
    plan, report = sliced
    for taxel in report.figures["taxels"]:
        assert taxel["recess_depth_mm"] == pytest.approx(plan.plate.recess_depth_mm, abs=1e-3), taxel
        assert taxel["recess_room_mm"] >= plan.spec.washer.outer_diameter_mm, taxel
        assert taxel["gap_mm"] >= 0.7 * plan.plate.gap_mm, taxel


def test_an_ordinary_profile_is_told_with_its_settings_and_every_lost_layer(folder, sliced):
    """0.2 mm layers and 0.2 mm of elephant-foot compensation lose the second layer of every beam."""
    plan, _ = sliced
    slicer(
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
