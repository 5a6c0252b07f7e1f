"""Ballast: its mass and moments, what it does to modes, the pocket in the solid, bill, steps and bad input.

| what | against | tolerance and why |
|---|---|---|
| masses of the catalogue | 0.05 to 2.5 g, sums over the outline on a raster | 1 %: raster of 400 x 400 |
| body of a taxel with a nut | all its parts on a raster of cubes of 0.05 mm | 1 % mass and place, 2 % moments: raster |
| a resonance | finite elements of the STEP file | the stated error |
| volume of the solid | the taxel without ballast, less the pocket's prism | 1e-6: both exact |
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest

import padgen as pg
from padgen.cli import run
from padgen.core.errors import SpecError
from padgen.core.units import GRAM, MM
from padgen.make.solid_tuning import solid_taxel
from padgen.planner import make_plan
from padgen.planner.ballast import NEAR_RATIO
from padgen.planner.plan import plan_from_json, plan_to_json
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.solid.formats.step import write_taxel_step
from padgen.solid.taxel import ballast_solid, taxel_solid
from padgen.spec import Ballast, catalogue, make_spec

ONE = {
    "name": "one",
    "resolution": 16,
    "band_hz": [60, 240],
    "q_min": 15,
    "delta_y": 5,
    "magnet": "disc-3x1",
    "coil": "air-10",
    "ballast": "nut-m2.5",
}


@pytest.fixture(scope="module")
def nut():
    return make_plan(make_spec(ONE))


def raster(ballast, count=400):
    """Return the area in mm² of a cross-section by counting points in it."""
    half = ballast.corners_mm / 2
    x, y = np.meshgrid(*[(np.arange(count) + 0.5) / count * 2 * half - half] * 2)
    return inside(ballast, x, y).mean() * (2 * half) ** 2


def inside(ballast, x, y):
    """Return which places lie in the cross-section of a ballast; two flats of a hexagon face x."""
    radius = np.hypot(x, y)
    outline = radius < ballast.width_mm / 2
    if ballast.shape == "hexagon":
        ways = np.radians([0, 60, 120])
        away = np.abs(np.multiply.outer(np.cos(ways), x) + np.multiply.outer(np.sin(ways), y))
        outline = away.max(0) < ballast.width_mm / 2
    return outline & (radius >= ballast.inner_diameter_mm / 2)


def test_masses_of_the_catalogue_are_those_of_their_outlines():
    masses = []
    for name, entry in catalogue("ballast").items():
        ballast = Ballast(**entry)
        counted_g = raster(ballast) * ballast.height_mm * ballast.density_g_per_cm3 * 1e-3
        assert ballast.mass_g == pytest.approx(counted_g, rel=0.01), name
        assert entry["source"]
        masses.append(ballast.mass_g)
    assert 0.05 < min(masses) < 0.1
    assert 1.5 < max(masses) < 2.5


def model_of(plan, channel):
    beam = channel.beam
    shape = BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm)
    return TaxelModel(plan.spec, beam.topology, plate_shape(plan.spec), shape)


def test_mass_and_moments_are_those_of_a_raster(nut):
    """Plate, boss, magnet, ballast and the hollows around them, in cubes of 0.05 mm."""
    spec = nut.spec
    model = model_of(nut, nut.channels[0])
    body = model.body
    plate = model.plate
    step = 0.05
    at = float(model.arrangement.washer_x_mm)
    top = spec.pad.frame_thickness_mm + spec.taxel.boss_protrusion_mm
    sides = (plate.length_mm, plate.width_mm, top)
    axes = [(np.arange(round(side / step)) + 0.5) * side / round(side / step) for side in sides]
    x, y, z = np.meshgrid(axes[0] - plate.length_mm / 2, axes[1] - plate.width_mm / 2, axes[2], indexing="ij")
    radius = np.hypot(x, y)
    density = np.where(z < plate.thickness_mm, spec.material.density_g_per_cm3, 0.0)
    density[(z > plate.thickness_mm) & (radius < spec.taxel.boss_diameter_mm / 2)] = spec.material.density_g_per_cm3
    solid = replace(spec.ballast, inner_diameter_mm=0.0)
    density[inside(solid, x, y) & (z < spec.pocket_top_mm)] = 0.0
    recess = (spec.washer_or_magnet.outer_diameter_mm + spec.taxel.washer_clearance_mm) / 2
    density[(radius < recess) & (z < spec.recess_depth_mm)] = 0.0
    of_ballast = inside(spec.ballast, x, y) & (z < spec.pocket_top_mm)
    density[of_ballast & (z > spec.pocket_top_mm - spec.ballast.height_mm)] = spec.ballast.density_g_per_cm3
    low = spec.pocket_top_mm - spec.ballast.height_mm - spec.washer_or_magnet.thickness_mm
    of_magnet = (
        (radius < spec.washer_or_magnet.outer_diameter_mm / 2)
        & (z > low)
        & (z < low + spec.washer_or_magnet.thickness_mm)
    )
    density[of_magnet] = spec.washer_or_magnet.density_g_per_cm3
    mass_g = density * np.prod([side / round(side / step) for side in sides]) * 1e-3
    total_g = mass_g.sum()
    height_mm = (mass_g * z).sum() / total_g
    assert float(body.mass) / GRAM == pytest.approx(total_g, rel=0.01)
    assert body.centroid[2] / MM == pytest.approx(height_mm, rel=0.01)
    assert body.centroid[0] / MM == pytest.approx(at, rel=1e-6)
    about_y = (mass_g * (x**2 + (z - height_mm) ** 2)).sum() * GRAM * MM**2
    about_z = (mass_g * (x**2 + y**2)).sum() * GRAM * MM**2
    assert body.inertia[1, 1] == pytest.approx(about_y, rel=0.02)
    assert body.inertia[2, 2] == pytest.approx(about_z, rel=0.02)


def solve(taxel):
    """Return the modes of a taxel by elements of order 3."""
    from padgen.verify.elasticity import solve_modes

    return solve_modes(taxel, 3, 0)


def test_resonance_is_that_of_finite_elements(nut, tmp_path):
    """`docs/measure_ballast.py` does so for 24 random taxels of all suspensions."""
    channel = nut.channels[1]
    write_taxel_step(nut, channel, tmp_path / "taxel.step")
    # In a process of its own, since the elements bring a CAD kernel that the other one does not bear.
    with ProcessPoolExecutor(1, get_context("spawn")) as child:
        solved = child.submit(solve, solid_taxel(nut, channel, tmp_path / "taxel.step")).result()
    found = float(solved.modes.frequency_hz[solved.modes.working])
    assert channel.resonance_hz == pytest.approx(found, rel=channel.model_error)
    light = replace(nut.spec, ballast=None)
    unloaded = TaxelModel(light, channel.beam.topology, plate_shape(nut.spec), model_of(nut, channel).beam)
    assert float(unloaded.resonance_hz) > 1.3 * found


def test_the_pocket_is_cut_and_the_ballast_fills_it(nut):
    channel = nut.channels[0]
    spec = nut.spec
    with_pocket = taxel_solid(nut, channel)
    ballast = ballast_solid(nut, channel)
    assert ballast.volume == pytest.approx(spec.ballast.area_mm2 * spec.ballast.height_mm, rel=1e-6)
    assert pytest.approx(spec.pocket_top_mm) == ballast.bounding_box().max.Z
    assert pytest.approx(spec.ballast.width_mm) == ballast.bounding_box().size.X  # its flats face the beam
    assert (with_pocket & ballast) is None or (with_pocket & ballast).volume < 1e-6
    solid = replace(spec.ballast, inner_diameter_mm=0.0)
    without = taxel_solid(replace(nut, spec=replace(spec, ballast=None)), channel)
    recess_mm3 = np.pi / 4 * nut.plate.recess_diameter_mm**2 * nut.plate.recess_depth_mm
    assert without.volume - with_pocket.volume == pytest.approx(solid.area_mm2 * spec.pocket_top_mm - recess_mm3)


def test_a_pad_with_ballast_is_built_counted_and_read_back(nut, tmp_path):
    pad = pg.build(nut)
    assert not [finding for finding in pad.check().findings if finding.level == "error"]
    (line,) = [line for line in pad.bill.splitlines() if line.startswith("ballast,")]
    assert "ballast,16,pieces,nut-m2.5: 5 mm across flats bore 2.208 2 mm high 0.2798 g each" in line
    assert plan_to_json(plan_from_json(plan_to_json(nut))) == plan_to_json(nut)
    assert "ballast" not in plan_to_json(make_plan(make_spec({k: v for k, v in ONE.items() if k != "ballast"})))


def test_rocking_near_a_tone_is_a_warning_with_a_cure_that_was_tried(nut):
    others = [
        max(hz / tone.resonance_hz, tone.resonance_hz / hz)
        for channel in nut.channels
        for hz, share in zip(channel.modes_hz, channel.mode_shares, strict=True)
        for tone in nut.channels
        if share < 1
    ]
    assert min(others) < NEAR_RATIO
    (found,) = [finding for finding in nut.findings if finding.code == "modes.rocking"]
    assert found.level == "warning"
    assert f"a factor of {min(others):.2f} off" in found.message
    assert found.cures == ({"suspension.topology": "bridge"},)
    steady = make_plan(make_spec(ONE | {"suspension": {"topology": "bridge"}}))
    assert all(finding.code != "modes.rocking" for finding in steady.findings)


@pytest.mark.parametrize(
    ("change", "where", "words"),
    [
        ({"ballast": "nut-m9"}, "ballast.name", "there is no ballast 'nut-m9'"),
        ({"ballast": "dowel-3x8"}, "ballast", "must leave two layers of roof"),
        ({"ballast": "dowel-3x8"}, "ballast", "pressed out towards the coil"),
        ({"ballast": {"name": "nut-m2.5", "inner_diameter_mm": 6}}, "ballast.inner_diameter_mm", "below its width"),
        (
            {
                "ballast": "tungsten-6.4x3",
                "taxel": {"plate_thickness_mm": 5},
                "pad": {"frame_thickness_mm": 5},
                "printer": {"name": "fdm-0.4", "longest_bridge_mm": 5},
            },
            "ballast",
            "bridges 5",
        ),
        ({"ballast": {"name": "own", "width_mm": 3}}, "ballast.height_mm", "is missing"),
        ({"taxel": {"centre_post": True}}, "taxel.centre_post", "pressed in through the recess"),
        ({"taxel": {"plate_width_mm": 5.5}}, "taxel.plate_width_mm", "nut-m2.5 in its walls"),
    ],
)
def test_bad_ballast_is_one_sentence_with_a_cure(change, where, words):
    with pytest.raises(SpecError) as told:
        make_spec(ONE | change)
    assert told.value.where == where
    assert words in str(told.value)


def test_refused_ballast_writes_nothing_and_its_cure_holds(tmp_path, capsys):
    spec = tmp_path / "tall.toml"
    text = 'name = "tall"\nresolution = 16\nband_hz = [60, 240]\nq_min = 15\ndelta_y = 5\ncoil = "air-10"\n'
    spec.write_text(text + 'magnet = "disc-3x1"\nballast = "dowel-3x8"\n')
    assert run(["plan", str(spec), "-o", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    cure = told[told.index("ballast = '") + 11 :].split("'")[0]
    spec.write_text(text + f'magnet = "disc-3x1"\nballast = "{cure}"\n')
    assert run(["plan", str(spec), "-o", str(tmp_path / "out")]) in (0, 1)
