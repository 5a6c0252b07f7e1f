"""The slicer's settings: its profile, the project in the 3MF, the names in other slicers, the place on the bed."""

import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

import padgen as pg
from padgen.make.pad import Pad
from padgen.planner.layout import corner_groove
from padgen.planner.printing import (
    IN_ORCA,
    OTHER_SLICERS_FILE,
    PROFILE_FILE,
    orca_text,
    other_slicers_text,
    print_settings,
    profile_text,
    prusa_profile,
    shaping_profile,
)
from padgen.solid.formats._3mf import read_3mf
from padgen.solid.mesh import as_manifold
from padgen.spec import load_spec, parse_spec
from tests.conftest import SMALL


def settings(lines):
    return dict(line.split(" = ", 1) for line in lines if " = " in line and not line.startswith("#"))


@pytest.mark.parametrize("name", ["paper-32", "quad-64"])
def test_the_profile_says_what_the_plan_counts_on(name):
    spec = load_spec(name)
    printer = spec.printer
    told = settings(profile_text(pg.plan(spec)).splitlines())
    assert told == prusa_profile(spec)
    for key, value in (
        ("layer_height", printer.layer_mm),
        ("first_layer_height", printer.first_layer_mm),
        ("nozzle_diameter", printer.nozzle_mm),
        ("external_perimeter_extrusion_width", printer.line_width_mm),
        ("xy_size_compensation", printer.xy_compensation_mm),
        ("elefant_foot_compensation", 0.0),
        ("thick_bridges", 0.0),
    ):
        assert float(told[key]) == value, key
    assert told["perimeter_generator"] == "arachne"
    assert told["bed_shape"].split(",")[2] == f"{printer.bed_x_mm:g}x{printer.bed_y_mm:g}"
    # Told to people in the same order, the five that matter most first.
    first = list(print_settings(spec, []))[:5]
    assert first == [
        "layer_height", "first_layer_height", "wall_generator", "elephant_foot_compensation", "thick_bridges"
    ]  # fmt: skip


def test_filament_and_depth_of_recesses_are_in_the_profile():
    """Temperatures are those of the material, else PLA's; walls round deep recesses are laid in one line where it fits.

    The recess of pad-32 is 0.4 mm deep, that of magnet-32 1.1 mm, and fingertip-24 has 4.1 mm with its ballast.
    """
    flat = load_spec("pad-32")
    assert [prusa_profile(flat)[key] for key in ("temperature", "bed_temperature")] == ["215", "60"]
    soft = prusa_profile(parse_spec('material = "tpu-95a"\n' + SMALL))
    assert [soft[key] for key in ("first_layer_temperature", "first_layer_bed_temperature")] == ["230", "50"]
    mine = prusa_profile(parse_spec('material = { name = "pla", nozzle_c = 205.5 }\n' + SMALL))
    assert [mine[key] for key in ("temperature", "bed_temperature")] == ["205.5", "60"]
    for name, angle in {"pad-32": "10", "magnet-32": "59", "fingertip-24": "59"}.items():
        assert prusa_profile(load_spec(name))["wall_transition_angle"] == angle


def test_other_slicers_have_it_by_their_names():
    text = other_slicers_text(pg.plan("paper-32"))
    cura, orca = text.split("Cura:\n")[1].split("OrcaSlicer, Bambu Studio:\n")
    assert "untested" in text
    assert "  Initial Layer Height: 0.2 mm\n" in cura
    assert "Thick" not in cura
    assert "  Wall generator: variable line width (Arachne)\n" in orca
    assert "X-Y contour compensation: 0.014 mm, X-Y hole compensation: -0.014 mm" in orca


def test_the_preset_for_orca_says_what_pad_ini_says():
    """All that shapes a print, by the names in a G-code of Bambu Studio 2.4; what has no name there is named here."""
    plan = pg.plan("quad-64")
    preset = json.loads(orca_text(plan))
    assert (preset["type"], preset["from"], preset["name"]) == ("process", "User", "padgen quad-64")
    assert all(isinstance(value, str) for value in preset.values())
    shaping = shaping_profile(plan.spec)
    said_otherwise = {
        "nozzle_diameter", "extra_perimeters", "infill_every_layers", "external_perimeters_first", "gap_fill_enabled",
        "extrusion_multiplier", "resolution", "ironing",
    }  # fmt: skip
    for key in shaping.keys() - said_otherwise:
        assert preset[IN_ORCA.get(key, key)] == shaping[key], key
    assert float(preset["xy_hole_compensation"]) == -float(shaping["xy_size_compensation"]) < 0
    assert preset["resolution"] == shaping["gcode_resolution"]
    # Names that are taken from the file are those that a Bambu Studio of version 2.4 writes.
    known = (Path(__file__).parents[1] / "reference" / "bambu_studio_settings.txt").read_text(encoding="ascii").split()
    assert {*preset} - {"type", "name", "from", "inherits"} <= {*known}


def test_resin_has_no_such_profile(tmp_path):
    plan = pg.plan("resin-fine")
    assert profile_text(plan) == orca_text(plan) == ""
    assert "layer height: 0.05 mm" in other_slicers_text(plan)
    assert "Arachne" not in other_slicers_text(plan)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "tiny"
    Pad(parse_spec(SMALL)).save(path, ["3mf"])
    return path


def test_the_3mf_brings_profile_and_place(folder):
    package = zipfile.ZipFile(folder / "pad.3mf")
    profile = settings((folder / PROFILE_FILE).read_text().splitlines())
    first, *lines = package.read("Metadata/Slic3r_PE.config").decode().splitlines()
    assert "=" not in first  # PrusaSlicer skips it
    assert settings(line.removeprefix("; ") for line in lines) == profile
    (place,) = re.findall(rb'<item objectid="1" transform="([^"]*)"', package.read("3D/3dmodel.model"))
    assert [float(v) for v in place.split()] == [1, 0, 0, 0, 1, 0, 0, 0, 1, 125, 105, 0]
    assert (folder / OTHER_SLICERS_FILE).read_text().startswith("Settings for tiny on fdm-0.4")


def test_a_pad_is_read_as_it_was_modelled_wherever_it_lies_on_the_bed(folder, small_pad):
    assert np.abs(read_3mf(folder / "pad.3mf").vertices_mm.mean(0)[:2]).max() < 1
    assert np.ptp(read_3mf(folder / "pad.3mf").vertices_mm, 0) == pytest.approx(np.ptp(small_pad.mesh.vertices_mm, 0))


def test_turned_by_180_degrees_a_pad_is_not_the_same(small_plan, small_pad):
    """The groove marks the coil of row 0, column 0, on the pad as on the tray."""
    solid = as_manifold(small_pad.mesh, "pad")
    mark = corner_groove(small_plan.spec)
    cut = solid.slice(small_plan.spec.pad.frame_thickness_mm / 2)
    at = np.array([(mark.x0 + mark.x1) / 2, (mark.y0 + mark.y1) / 2 + (mark.y1 - mark.y0) / 4])

    def holds(x, y):
        import manifold3d

        spot = manifold3d.CrossSection.square((0.1, 0.1), True).translate((x, y))
        return (cut ^ spot).area() > 0

    assert not holds(*at)
    assert holds(*-at)
