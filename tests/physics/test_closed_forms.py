"""Small formulas against what they say, worked out in another way.

| formula | against | tolerance |
|---|---|---|
| motion of a beam's tip | the cross product, turned into the beam's axes by its angle | rounding |
| slope of a bent beam, squared | Gauss's rule on the cubic | rounding: exact for its degree |
| shared area of two circles | counting points of a grid | 0.5 %: a grid of 1000 × 1000 |
| loss to saturation | the magnetisation by Fröhlich's law, twice | rounding |
| mass of a taxel of less dense plastic | its volumes, by hand | rounding |
| stress of a straight beam | 6 F L/(b t²) at the root, and of a moment at the tip | rounding |
| what skin adds to a taxel | a disc on a half-space: its stiffness, half of Lamb's 8/3 ρ a³, its waves | rounding |
| χN of a core | the slope of ln(flux) over ln χ, by differences | 0.3 %: 1e-4 … 1e-3 seen, of the charges as solved |
| room of a washer beside its coil | where the coil is passed sideways, none along it | rounding |
| places along a beam of a taxel's map | the distance from the root | a pixel |
"""

from dataclasses import replace
from math import cos, pi, sin

import numpy as np
import pytest

from padgen.physics.beams import BeamSection, largest_stress
from padgen.physics.bounds import _squared_slope, core_polarisation, saturation_loss
from padgen.physics.contact import Contactor, loaded_resonance
from padgen.physics.contact.half_space import HalfSpace
from padgen.physics.magnetics import charged_core, solenoid
from padgen.physics.modes import BeamPlacement, to_tip
from padgen.planner.drive_scheme import cell_is_turned
from padgen.planner.layout import candidates, room, sub_cell_centres
from padgen.planner.left_out import _common_radius
from padgen.planner.plan import Plan
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.sliced.laid_pad import BEAM, TaxelMap
from padgen.spec import load_spec


@pytest.mark.parametrize("angle", [0.0, 0.7, pi / 2, -2.1])
def test_a_tip_moves_with_its_body(angle: float) -> None:
    tip = np.array([1.3, -0.4, 0.2])
    at = np.array([0.5, 0.6, -0.7])
    beam = BeamPlacement(None, tip, np.array([cos(angle), sin(angle)]))  # type: ignore[arg-type]
    shift = np.array([0.11, -0.23, 0.31])
    turn = np.array([0.7, 0.5, -0.9])
    own = np.array([[cos(angle), sin(angle), 0], [-sin(angle), cos(angle), 0], [0, 0, 1]])
    expected = np.concatenate([own @ (shift + np.cross(turn, tip - at)), own @ turn])
    assert to_tip(beam, at) @ np.concatenate([shift, turn]) == pytest.approx(expected, abs=1e-14)


def test_the_squared_slope_of_a_cubic() -> None:
    """A beam of unit length: w(0) = 0, slopes a at the root and b at the tip, w at the tip."""
    rng = np.random.default_rng(1)
    nodes, weights = np.polynomial.legendre.leggauss(6)
    x = (nodes + 1) / 2
    for a, w, b in rng.normal(size=(5, 3)):
        slope = a * (1 - 4 * x + 3 * x**2) + w * (6 * x - 6 * x**2) + b * (3 * x**2 - 2 * x)
        assert _squared_slope((a, w, b)) == pytest.approx(weights @ slope**2 / 2, rel=1e-12)


@pytest.mark.parametrize("radius, apart", [(1.0, 0.4), (0.5, 1.0), (2.5, 0.3), (0.2, 0.1), (2.0, 4.0)])
def test_the_area_that_two_circles_share(radius: float, apart: float) -> None:
    other = 1.0
    side = np.linspace(-1, 1, 1000)
    x, y = np.meshgrid(side, side)
    shared = ((x**2 + y**2 < other**2) & ((x - apart) ** 2 + y**2 < radius**2)).mean() * 4
    assert pi * _common_radius(np.array([radius]), other, np.array([apart]))[0] ** 2 == pytest.approx(
        shared, rel=5e-3, abs=1e-9
    )


@pytest.mark.parametrize("share, chi, demagnetising", [(0.2, 300.0, 0.05), (0.6, 1000.0, 0.3), (0.4, 50.0, 0.0)])
def test_the_magnetisation_lost_to_saturation(share: float, chi: float, demagnetising: float) -> None:
    """The steel's χ(1 − s) in place of χ, where edges make s a quarter larger."""

    def magnetisation(susceptibility: float) -> float:
        return susceptibility / (1 + susceptibility * demagnetising)

    left = magnetisation(chi * (1 - 1.25 * share)) / magnetisation(chi)
    assert saturation_loss(share, chi * demagnetising) == pytest.approx(1 - left, rel=1e-12)
    assert saturation_loss(0.8, chi * demagnetising) == 1.0


def test_the_stress_of_a_straight_beam() -> None:
    width = 8e-4
    thickness = 3e-4
    length = 6e-3
    force = 0.02
    moment = 3e-5
    beam = BeamSection(width, thickness, length)
    for load, expected in (
        (np.array([0, 0, force, 0, 0, 0]), 6 * force * length / (width * thickness**2)),
        (np.array([0, 0, 0, 0, moment, 0]), 6 * moment / (width * thickness**2)),
    ):
        assert float(largest_stress(beam, load)) == pytest.approx(expected, rel=1e-12)


def test_what_skin_adds() -> None:
    """A rigid disc on a half-space has k = 2 E* a; with it moves half of the 8/3 ρ a³ of a disc in a fluid (Lamb).

    Slow and without loss: waves then add Lysmer's 3.4 a² √(ρ G)/(1 − ν) to its damping.
    """
    radius = 3e-3
    skin = HalfSpace(90e3, 0.0, 0.0)
    mass = 2e-4
    hz = 60.0
    q = 15.0
    stiffness = mass * (2 * pi * hz) ** 2
    all_k = stiffness + 2 * 90e3 * radius
    all_m = mass + 8 / 3 * 1100.0 * radius**3 / 2
    loss = stiffness / (2 * pi * hz * q) + 3.4 * radius**2 * (1100.0 * 90e3 / 4) ** 0.5 / 0.5
    touched = [float(v) for v in loaded_resonance(skin, Contactor(radius), stiffness, mass, q)]
    assert touched == pytest.approx([(all_k / all_m) ** 0.5 / 2 / pi, (all_k * all_m) ** 0.5 / loss], rel=1e-12)


@pytest.mark.parametrize("permeability", [50.0, 1000.0])
def test_how_the_cores_flux_follows_its_permeability(permeability: float) -> None:
    coil = solenoid(12e-3, 5e-3, 9e-3, 800, 4e-3, permeability)

    def flux(change: float) -> float:
        charged = charged_core(coil._replace(core_permeability=1 + (permeability - 1) * (1 + change)))
        assert charged is not None
        core, charge = charged
        return float(np.abs(np.cumsum((core.area * charge)[np.argsort(-core.height, kind="stable")])).max())

    slope = (np.log(flux(1e-3)) - np.log(flux(-1e-3))) / (np.log1p(1e-3) - np.log1p(-1e-3))
    assert core_polarisation(coil)[1] == pytest.approx(1 / slope - 1, rel=3e-3)


def test_a_map_counts_its_beams_places_from_the_root(paper_plan: Plan) -> None:
    channel = paper_plan.channels[0]
    seen = TaxelMap(paper_plan, channel)
    (beam,) = seen.beams
    steps = beam.stop - beam.start - 1
    own = np.argwhere(seen.owner == BEAM)
    (path,) = paper_plan.arrangement(channel).beams
    middle = seen.low + (own + 0.5) * seen.pixel_mm
    away = (middle - np.array(path.root_mm, float)) @ np.array(path.direction, float)
    inside = (away > 0.5) & (away < float(path.length_mm) - 0.5)
    places = seen.node[own[:, 0], own[:, 1]] * float(path.length_mm) / steps
    assert places[inside] == pytest.approx(away[inside], abs=seen.pixel_mm)


def test_a_washer_beside_a_narrow_coil_has_no_room_along_it() -> None:
    spec = load_spec("quad-64")
    narrow = replace(spec, coil=replace(spec.coil, outer_diameter_mm=3.0, grid=None))
    layout = next(o for o in candidates(narrow, 8) if o.beam_axis == "y")
    inside, (u, v) = room(narrow, layout), np.abs(sub_cell_centres(layout)).max(0)
    assert v > 3.0 and u > 3.0
    assert (inside.before_washer_mm, inside.behind_washer_mm) == pytest.approx(
        (inside.length_mm / 2 + np.abs(sub_cell_centres(layout))[:, 1].min(), inside.length_mm / 2 - v), rel=1e-12
    )


def test_plastic_with_voids_weighs_its_share(paper_plan: Plan) -> None:
    """A print of half the plastic, as `judge_laid` has it, misses half of what is no washer."""

    class Half(TaxelModel):
        plastic_share = 0.5

    spec = paper_plan.spec
    beam = paper_plan.channels[0].beam
    shape = BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm)
    whole, half = (kind(spec, beam.topology, plate_shape(spec), shape).body.mass for kind in (TaxelModel, Half))
    washer = spec.washer
    ring_mm3 = pi / 4 * (washer.outer_diameter_mm**2 - washer.inner_diameter_mm**2) * washer.thickness_mm
    steel_kg = ring_mm3 * washer.density_g_per_cm3 * 1e-6
    assert half - steel_kg == pytest.approx((whole - steel_kg) / 2, rel=1e-9)


@pytest.mark.parametrize("turned", ["none", "odd rows", "odd columns"])
def test_the_first_coil_has_its_cell_as_drawn(turned: str) -> None:
    """Every second row or column is turned, counted from the first, which is not: pictures and wiring show it so."""
    cells = [(row, column) for row in range(3) for column in range(3) if cell_is_turned(turned, row, column)]
    assert (
        cells
        == {
            "none": [],
            "odd rows": [(1, 0), (1, 1), (1, 2)],
            "odd columns": [(0, 1), (1, 1), (2, 1)],
        }[turned]
    )
