"""A real slicer's judgement of the paper's pad (`make slice` installs it and runs this)."""

import json
import shutil
import subprocess

import pytest

from padgen.make.pad import Pad
from padgen.planner import plan_from_json
from padgen.spec import load_spec
from tests.gcode import laid_beams, laid_recesses, read_gcode

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
    return plan, read_gcode(folder / "pad.gcode")


def test_every_beam_is_laid_as_wide_and_as_thick_as_planned(sliced):
    plan, laid_lines = sliced
    beams = laid_beams(plan, laid_lines, CENTRE_MM)
    assert len(beams) == 32
    for beam in beams:
        *laid, above = beam.laid_width_mm
        assert above == 0.0, beam
        # Half of what a bead's round edges take off in the thickest layer: 0.215 * 0.2 mm / 2.
        assert laid == pytest.approx([beam.planned_width_mm] * beam.planned_layers, abs=0.022), beam


def test_the_pad_weighs_what_was_planned(folder, sliced):
    _, laid_lines = sliced
    checks = json.loads((folder / "checks.json").read_text())
    assert laid_lines.volume_mm3.sum() == pytest.approx(checks["figures"]["volume_mm3"], rel=0.01)


def test_washers_enter_their_recesses_and_sink_in(sliced):
    plan, laid_lines = sliced
    washer = plan.spec.washer
    recesses = laid_recesses(plan, laid_lines, CENTRE_MM)
    assert len(recesses) == 32
    for recess in recesses:
        assert recess.depth_mm == pytest.approx(plan.plate.recess_depth_mm, abs=1e-6), recess
        assert recess.room_mm >= washer.outer_diameter_mm, recess
