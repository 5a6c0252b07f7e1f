"""The frame of Timoshenko elements, against published problems, exact equations and itself.

| against | tolerance | why |
|---|---|---|
| roots of Timoshenko's frequency equation, forty digits | 1e-8 | t/l 1/500 … 1, mass ratios 1e-3 … 1e3 |
| NAFEMS FV4 (Euler-Bernoulli) | 0.05 % | published to four digits, without shear |
| VPCS SDLL09 (taper) | 0.3 % | published without rotary inertia |
| Blevins' tip mass | 0.5 % | his 0.24 is rounded |
| the condensed model of `physics.modes` | 0.3 % | its beam mass is that of one cubic |
"""

from itertools import pairwise

import numpy as np
import pytest

from padgen.core.errors import SolverError
from padgen.ladders.extreme import Cantilever, exact_frequencies, frame_answer, structure_cases
from padgen.physics import beams
from padgen.physics.beams import BeamSection, tip_stiffness
from padgen.physics.modes import RigidBody, box, combine
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import parse_spec
from padgen.verify import frame
from padgen.verify.frame import (
    AttachedBody,
    Element,
    Frame,
    Section,
    checked_frame_modes,
    divided,
    frame_modes,
    rectangle,
)
from padgen.verify.taxel_frame import taxel_frame

STEEL = (200e9, 200e9 / 2.6, 8000.0)
SPEC = parse_spec('name = "a"\nresolution = 1\nband_hz = [20, 2000]\nq_min = 15\n')


def circle(diameter: float, poisson: float) -> Section:
    """Return the section of a solid circle, `diameter` in m; the shear coefficient is Cowper's (1966)."""
    inertia = np.pi * diameter**4 / 64
    shear = 6 * (1 + poisson) / (7 + 6 * poisson)
    return Section(np.pi * diameter**2 / 4, inertia, inertia, 2 * inertia, shear, shear)


def frame_deflection(of, load):
    """Return the static motion (n + b, 6) of nodes and bodies under a `load` (n + b, 6) in N and N·m."""
    free = frame._motions(of)
    factor, scale, _ = frame._stiffness_factor(of, free)
    scaled = (free / scale)[: frame._outer(of)]
    return (scaled @ np.linalg.solve(factor, np.linalg.solve(factor.T, scaled.T @ load.ravel()))).reshape(-1, 6)


def bar(start, end, count, section, material=STEEL, bodies=(), bubbles=2, up=(0, 0, 1)):
    nodes, pairs = divided(np.asarray(start, float), np.asarray(end, float), count)
    elements = tuple(Element(a, b, section, *material, up=up) for a, b in pairs)
    return Frame(nodes, elements, tuple(bodies), (0,), bubbles=bubbles)


def point(mass, place):
    return RigidBody(np.asarray(mass), np.asarray(place, float), np.zeros((3, 3)))


def test_nafems_fv4():
    """10 m cantilever, solid circle of 0.5 m, 10,000 and 1,000 kg on arms of 2 m across its tip (ν 0.3)."""
    thin = circle(0.5, 0.3)._replace(shear_up=1e6, shear_across=1e6)
    masses = combine(point(1e4, (10, 2, 0)), point(1e3, (10, -2, 0)))
    frame = bar((0, 0, 0), (10, 0, 0), 5, thin, bodies=[AttachedBody(masses, (5,))])
    published = [1.723, 1.727, 7.413, 9.972, 18.155, 26.957]
    # The published figures leave shear out and have four digits.
    assert frame_modes(frame).frequency_hz == pytest.approx(published, rel=5e-4)


def test_vpcs_sdll09_taper():
    """1 m, 40 x 40 to 10 x 10 mm, E 200 GPa, density 7800: f = λ h_tip/(2π l²) √(E/12ρ) (Mabie and Rogers, 1972)."""
    count = 48
    nodes, pairs = divided(np.zeros(3), np.array([1.0, 0, 0]), count)
    sides = [0.04 - 0.03 * (a + 0.5) / count for a, _ in pairs]
    # Thin-beam theory: no shear.
    sections = [rectangle(h, h, 0.3)._replace(shear_up=1e6, shear_across=1e6) for h in sides]
    elements = tuple(
        Element(a, b, section, 200e9, 77e9, 7800.0) for (a, b), section in zip(pairs, sections, strict=True)
    )
    found = frame_modes(Frame(nodes, elements, (), (0,), bubbles=0), 6).frequency_hz
    published = np.array([23.289, 73.9, 165.23]) * 0.01 / (2 * np.pi) * np.sqrt(200e9 / 12 / 7800)
    # The published figures leave rotary inertia out, 0.2 % of the third; each bending mode comes twice.
    assert found[0::2] == pytest.approx(published, rel=3e-3)
    assert found[1::2] == pytest.approx(found[0::2], rel=1e-9)


def test_blevins_tip_mass():
    section = rectangle(0.02, 0.02, 0.3)
    beam_mass = 8000 * 0.02**2
    for ratio in (0.1, 1.0, 10.0):
        frame = bar((0, 0, 0), (1, 0, 0), 2, section, bodies=[AttachedBody(point(ratio * beam_mass, (1, 0, 0)), (2,))])
        stiffness = 3 * 200e9 * section.inertia_up
        expected = np.sqrt(stiffness / (beam_mass * (ratio + 0.24))) / (2 * np.pi)
        assert frame_modes(frame, 1).frequency_hz[0] == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("per_length", [1 / 500, 1 / 20, 1.0])
@pytest.mark.parametrize("ratio", [0.0, 1e-3, 1e3])
def test_timoshenko_frequency_equation(per_length, ratio):
    beam = Cantilever(1e-3, per_length * 10e-3, 10e-3, ratio, 1e-3, 0.2)
    found = frame_answer(beam)
    exact = exact_frequencies(beam, found.values[:2])
    assert found.values[:2] == pytest.approx(exact, rel=1e-8)
    assert found.residual < 1e-8


def test_exact_equation_is_the_textbook_s_for_a_thin_beam():
    """β l = 1.8751041 and 4.6940911 of a clamped-free Euler beam; shear and rotary inertia are 1e-7 of it here."""
    beam = Cantilever(1e-3, 1e-5, 0.1)
    wave = np.sqrt(beam.modulus * 1e-5**2 / 12 / beam.density) / (2 * np.pi * 0.1**2)
    expected = np.array([1.8751041, 4.6940911]) ** 2 * wave
    assert exact_frequencies(beam, expected * 1.00005) == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize(("bubbles", "order"), [(0, 4), (2, 6)])
def test_order_of_convergence(bubbles, order):
    """Slender beams converge with h⁴ by cubics, and with h⁶ by two inner motions more."""
    section = rectangle(0.01, 0.01, 0.3)
    # The third pair of modes, far enough from rounding.
    found = [frame_modes(bar((0, 0, 0), (1, 0, 0), n, section, bubbles=bubbles), 5).frequency_hz[4] for n in (2, 4, 8)]
    exact = frame_modes(bar((0, 0, 0), (1, 0, 0), 4, section, bubbles=8), 5).frequency_hz[4]
    errors = [f / exact - 1 for f in found]
    assert min(errors) > 0
    # The last halving; shear's h² with plain cubics is 1e-3 of the rest at t/l = 1/100.
    assert np.log2(errors[1] / errors[2]) == pytest.approx(order, abs=0.5)


def test_stated_error_holds_and_is_small():
    section = rectangle(0.1, 0.3, 0.3)
    rough = bar((0, 0, 0), (1, 0, 0), 2, section, bubbles=1)
    modes, error = checked_frame_modes(rough, 4)
    exact = frame_modes(rough._replace(bubbles=8), 4).frequency_hz
    assert (np.abs(modes.frequency_hz / exact - 1) <= error).all()
    assert error.max() < 1e-2


def test_rotated_frame_has_the_same_modes():
    section = rectangle(2e-3, 1e-3, 0.36)
    body = box((0.01, -2e-3, 0), (0.014, 3e-3, 4e-3), 1240.0)
    plain = bar((0, 0, 0), (0.01, 0, 0), 3, section, bodies=[AttachedBody(body, (3,))])
    axis = np.array([0.48, 0.6, 0.64])
    cross = np.cross(np.eye(3), axis)
    turn = np.eye(3) + np.sin(0.7) * cross + (1 - np.cos(0.7)) * cross @ cross
    turned_body = RigidBody(body.mass, turn @ body.centroid, turn @ body.inertia @ turn.T)
    turned = plain._replace(
        nodes=plain.nodes @ turn.T,
        elements=tuple(e._replace(up=tuple(turn[:, 2])) for e in plain.elements),
        bodies=(AttachedBody(turned_body, (3,)),),
    )
    assert frame_modes(turned).frequency_hz == pytest.approx(frame_modes(plain).frequency_hz, rel=1e-9)


def test_static_deflection_is_the_unit_load_method_s():
    """One element, hinged at both ends, has exactly the condensed stiffness of a beam."""
    width = 2e-3
    thickness = 1e-3
    length = 4e-3
    modulus = 3e9
    poisson = 0.36
    section = rectangle(width, thickness, poisson)
    element = Element(0, 1, section, modulus, modulus / (2 * (1 + poisson)), 1240.0)
    nodes = np.array([[0, 0, 0], [length, 0, 0]])
    bare = tip_stiffness(BeamSection(width, thickness, length), modulus, poisson)
    loads = np.zeros((2, 6, 6))
    loads[1] = np.eye(6)
    moved = np.stack(
        [frame_deflection(Frame(nodes, (element,), (), (0,)), loads[..., k])[1] for k in range(6)], axis=-1
    )
    scale = np.sqrt(np.outer(moved.diagonal(), moved.diagonal()))
    assert np.linalg.inv(bare) / scale == pytest.approx(moved / scale, abs=1e-10)
    hinged = element._replace(hinge_start=(0.1, 0.02), hinge_end=(0.3, 0.05))
    tip_moment = frame_deflection(Frame(nodes, (hinged,), (), (0,)), loads[..., 4])[1, 4]
    # Both hinges turn the tip under a moment, in series with the beam.
    assert tip_moment == pytest.approx(moved[4, 4] + 0.4, rel=1e-10)


def taxel(topology, width, thickness, length):
    return TaxelModel(SPEC, topology, plate_shape(SPEC), BeamShape(width, thickness, length))


@pytest.mark.parametrize(
    ("topology", "shape"), [("cantilever", (0.6, 0.3, 6.6)), ("bridge", (1.0, 0.4, 3.0)), ("folded", (0.8, 0.4, 8.0))]
)
def test_taxel_frame_agrees_with_the_condensed_model(monkeypatch, topology, shape):
    """With the same end compliances and rigid parts the models differ by the beams' mass, 1 … 3 % of the body's.

    The frame's ends turn about the beams' axes and give neither along them nor, where a yoke bends, across.
    """
    monkeypatch.setattr(beams, "_yoke_bending", lambda *_: (0.0, 0.0, 0.0))
    for name in ("ROOT_HEIGHT", "TIP_HEIGHT", "BAR_PULL"):
        monkeypatch.setattr(beams, name, 0.0)
    # The frame spreads evenly what ends add by keeping the section from curling.
    monkeypatch.setattr(beams, "anticlastic_factors", lambda slenderness: (0 * slenderness, 0 * slenderness))
    model = taxel(topology, *shape)
    found = frame_modes(taxel_frame(model, 2, rigid_crossbar=True))
    # Beams have modes of their own between the body's last two.
    assert found.frequency_hz[:4] == pytest.approx(model.modes.frequency_hz[:4], rel=3e-3)
    finer = frame_modes(taxel_frame(model, 6, rigid_crossbar=True))
    assert finer.frequency_hz[:4] == pytest.approx(found.frequency_hz[:4], rel=1e-5)


@pytest.mark.parametrize("topology", ["serpentine-3"])
def test_a_frame_of_a_serpentine_agrees_with_its_path(topology):
    """Elements in space agree with integrals along the path; chords of bends are 0.3 % shorter than their arcs."""
    legs = int(topology[-1])
    for thickness in (0.4, 1.2):
        model = taxel(topology, 0.5, thickness, 4.0 * legs)
        found = frame_modes(taxel_frame(model)).frequency_hz[:3]
        assert found == pytest.approx(model.modes.frequency_hz[:3], rel=6e-3)


def test_symmetric_taxel_moves_symmetrically():
    modes = frame_modes(taxel_frame(taxel("folded", 0.8, 0.4, 8.0), 2), 4)
    plate = np.abs(modes.body_motion[:, 0] * np.repeat([1.0, 2e-3], 3))
    along = plate[:, [0, 2, 4]].max(1)
    across = plate[:, [1, 3, 5]].max(1)
    # Every mode is either along the plane of symmetry or across it.
    assert (np.minimum(along, across) < 1e-6 * np.maximum(along, across)).all()


def test_crossbar_and_neck_give_as_much_as_the_condensed_model_says():
    model = taxel("folded", 1.2, 0.6, 8.0)
    soft, stiff = (frame_modes(taxel_frame(model, 2, rigid_crossbar=r)).frequency_hz for r in (False, True))
    assert soft[:4] == pytest.approx(stiff[:4], rel=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f._replace(clamped=()), "mechanism"),
        (lambda f: f._replace(bodies=(AttachedBody(point(1.0, (0, 0, 0)), ()),)), "part of it is not held"),
        (lambda f: f._replace(nodes=np.zeros((3, 3))), "no length"),
        (lambda f: f._replace(bodies=(AttachedBody(point(1.0, (0, 0, 0)), (0,)),)), "fixed to a rigid body"),
        (lambda f: f._replace(elements=tuple(e._replace(density=0.0) for e in f.elements)), "fewer than 6 modes"),
    ],
)
def test_refusals(change, words):
    frame = bar((0, 0, 0), (1, 0, 0), 2, rectangle(0.1, 0.1, 0.3))
    with pytest.raises(SolverError, match=words):
        frame_modes(change(frame))


def test_extreme_frames_know_their_error():
    """A few of the extreme cases; `padgen study` runs all."""
    cases = [case for case in structure_cases() if case.model == "frame"]
    assert len({case.name for case in cases}) == len(cases) >= 25
    for case in cases[::6]:
        answer = case.solve()
        error = np.abs(answer.values / case.reference() - 1).max()
        assert error <= answer.stated_error
        assert answer.stated_error < 1e-8


def test_extreme_taxels_know_their_error_or_are_refused():
    cases = [case for case in structure_cases() if case.model == "beam"]
    refused = 0
    for case in cases:
        try:
            answer = case.solve()
        except SolverError as error:
            assert "solve the solid" in str(error)
            refused += 1
            continue
        assert np.abs(answer.values / case.reference() - 1).max() <= answer.stated_error
    assert (len(cases), refused) == (7, 3)


def test_pairs_of_divided_nodes_are_neighbours():
    nodes, pairs = divided(np.zeros(3), np.array([3.0, 0, 0]), 3, first_node=5)
    assert pairs == [(5, 6), (6, 7), (7, 8)]
    assert [float(b - a) for a, b in pairwise(nodes[:, 0])] == pytest.approx([1, 1, 1])
