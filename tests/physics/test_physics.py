"""Agreement table: which model must equal which number, to what tolerance, and why.

| model | reference | tolerance | reason |
|---|---|---|---|
| capacity, ladder, sag, ring-up | paper's and computed figures | as printed | they are printed to these digits |
| impedance of the paper's coil | computed figures | as printed | |
| beam model of a taxel, f1 | 3-D elasticity, converged | 0.8 % | Timoshenko's own error there |
| beam model, modes 2 and 3 | 3-D elasticity, converged | 1.5 % | torsion and lateral |
| bent beam, its bends as stiff as its axis | Castigliano's arcs and corners, straight beams | 1e-9 | same assumptions |
| flared bent beam | flared straight beam | 5e-5 | four Gauss points on the flare, not six |
| point mass on a beam | Euler-Bernoulli closed forms | 1e-6 | slender limit |
| field of a thin winding on its axis | closed form | 1e-5 | quadrature |
"""

import json
from math import log10
from pathlib import Path

import numpy as np
import pytest

from padgen.physics import beams
from padgen.physics.beams import (
    BeamSection,
    EndCompliance,
    largest_inverse_square,
    largest_stress,
    root_load,
    tip_mass,
    tip_stiffness,
    torsion_constant,
)
from padgen.physics.ladder import capacity, geometric_ladder, ladder_ratio, paper_ladder, whole_channels
from padgen.physics.magnetics import (
    SteelRing,
    flux_density,
    impedance,
    paper_force_constant,
    ring_factor,
    solenoid,
)
from padgen.physics.modes import BeamPlacement, box, combine, ring, suspended_modes
from padgen.physics.resonator import natural_frequency, receptance, ring_up_time, rule_stiffness

REFERENCE = Path(__file__).parents[1] / "reference"
TAXELS = json.loads((REFERENCE / "taxel_modes.json").read_text())
MAGNETS = json.loads((REFERENCE / "magnetostatics.json").read_text())
MM = 1e-3


def test_capacity_of_the_papers_case():
    bound = capacity(20, 1000, q=15, delta_y=10)
    assert bound == pytest.approx(11.627, abs=5e-4)
    assert whole_channels(bound) == 11
    assert ladder_ratio(15, 10) == pytest.approx(1.4)


def test_capacity_keeps_its_digits_at_large_q():
    # n -> ln(f2/f1) 2Q/dy as a -> 0; the plain logarithm of (1+a)/(1-a) loses 1e-8 there.
    q = 1e8
    assert capacity(20, 1000, q, 10) == pytest.approx(np.log(50) * 2 * q / 10, rel=1e-12)


def test_no_capacity_when_slots_overlap_zero():
    assert capacity(20, 1000, q=2.5, delta_y=10) == 0


def test_paper_ladder_starts_with_its_slots_edge_on_the_band():
    ladder = paper_ladder(20, 11, q=15, delta_y=10)
    assert ladder[0] == pytest.approx(24.0)
    assert ladder[-1] == pytest.approx(694, abs=0.5)
    assert np.allclose(ladder[1:] / ladder[:-1], 1.4)


def test_ring_up():
    assert ring_up_time(20.0, 15.0) == pytest.approx(0.239, abs=5e-4)


def test_receptance_peaks_with_q_and_is_static_at_zero():
    k = 0.1 * (2 * np.pi * 60) ** 2
    assert abs(receptance(0.0, 60.0, 0.1, 15.0)) == pytest.approx(1 / k)
    assert abs(receptance(60.0, 60.0, 0.1, 15.0)) == pytest.approx(15 / k)


def test_impedance_of_the_papers_coil():
    assert abs(impedance(62.9, 41.7e-3, 38.0)) / 62.9 == pytest.approx(1.012, abs=1e-3)
    assert abs(impedance(62.9, 41.7e-3, 500.0)) == pytest.approx(145, abs=0.5)
    loss_db = 40 * log10(62.9 / abs(impedance(62.9, 41.7e-3, 500.0)))
    assert loss_db == pytest.approx(-14.5, abs=0.05)


def test_slender_tip_mass_is_the_closed_form():
    """One slender beam with a heavy point at its tip has f = sqrt(3EI/(l³ m))/2π."""
    width = 1 * MM
    thickness = 0.2 * MM
    length = 50 * MM
    modulus = 3e9
    mass = 1e-3
    point = box((0, 0, 0), (1e-7, 1e-7, 1e-7), mass / 1e-21)
    beam = BeamPlacement(BeamSection(width, thickness, length), np.zeros(3) + point.centroid, np.array([1.0, 0.0]))
    modes = suspended_modes(point, [beam], modulus, 0.3, 1e-6)
    stiffness = 3 * modulus * width * thickness**3 / 12 / length**3
    # Shear adds (t/l)² = 1.6e-5 of compliance.
    assert modes.frequency_hz[0] == pytest.approx(natural_frequency(stiffness, mass), rel=3e-5)


def test_rule_is_the_cantilever_with_a_point_mass():
    stiffness = rule_stiffness(3e9, 1 * MM, 0.2 * MM, 50 * MM, 0.25)
    assert stiffness == pytest.approx(3 * 3e9 * (1 * MM * (0.2 * MM) ** 3 / 12) / (50 * MM) ** 3)


def reference_taxel(case):
    t, length, w = (case[key] * MM for key in ("t_mm", "l_mm", "w_mm"))
    plate = box((0, -2.5 * MM, 0), (6.5 * MM, 2.5 * MM, 1.6 * MM), 1240.0)
    boss = ring((3.25 * MM, 0), 1.6 * MM, 2.6 * MM, 2.5 * MM, 0, 1240.0)
    # The washer's bore is filled by the plate, so steel replaces plastic.
    washer = ring((3.25 * MM, 0), 0, 0.5 * MM, 4 * MM, 2 * MM, 7900.0 - 1240.0)
    beam = BeamPlacement(BeamSection(w, t, length), np.array([0, 0, t / 2]), np.array([1.0, 0.0]))
    return suspended_modes(combine(plate, boss, washer), [beam], 3e9, 0.36, 1240.0)


@pytest.mark.parametrize("name", sorted(TAXELS["cases"]))
def test_beam_model_against_elasticity(name):
    case = TAXELS["cases"][name]
    found = reference_taxel(case).frequency_hz
    reference = case["modes_hz"]
    assert found[0] == pytest.approx(reference[0], rel=8e-3)
    assert found[1:3] == pytest.approx(reference[1:3], rel=1.5e-2)


def test_flare_stiffens_between_the_beam_and_a_beam_shorter_by_its_radius():
    def bending(length, fillet):
        return tip_stiffness(BeamSection(1 * MM, 0.5 * MM, length, fillet), 3e9, 0.3)[2, 2]

    plain = bending(5 * MM, 0.0)
    flared = bending(5 * MM, 0.5 * MM)
    shorter = bending(4.5 * MM, 0.0)
    assert plain < flared < shorter


def test_tip_matrices_are_positive_definite_over_extremes():
    width, thickness, length = np.meshgrid([0.05, 1, 20], [0.05, 1, 5], [0.5, 5, 300])
    section = BeamSection(width * MM, thickness * MM, length * MM)
    for matrix in (tip_stiffness(section, 3e9, 0.36), tip_mass(section, 1240.0)):
        scale = np.sqrt(np.einsum("...ii->...i", matrix))
        normal = matrix / scale[..., :, None] / scale[..., None, :]
        assert np.linalg.eigvalsh(normal).min() > 1e-4


E = 3e9
NU = 0.36
G = E / (2 * (1 + NU))
BENT = BeamSection(0.6 * MM, 0.4 * MM, 8 * MM)
GIVING = EndCompliance(0.1 * MM, 0.2 * MM, 0.15 * MM, 0.05 * MM, 0.3 * MM, 0.2 * MM, -0.1 * MM, 0.07, 0.07)


def rigidities(section):
    """Return the rigidities of bending up and sideways, twist, stretch and shear."""
    w = section.width
    t = section.thickness
    sheared = 10 * (1 + NU) / (12 + 11 * NU) * G * w * t
    return E * w * t**3 / 12, E * t * w**3 / 12, G * float(torsion_constant(w, t)), E * w * t, sheared


def flexible(section, *path):
    """Return the flexibility matrix of the tip of a beam along this path."""
    length = sum(piece[0] for piece in path)
    return np.linalg.inv(tip_stiffness(section._replace(length=length, path=path), E, NU))


@pytest.fixture
def thin(monkeypatch):
    """Make bends no stiffer than their axis, as in thin bars."""
    monkeypatch.setattr(beams, "bend_stiffening", np.ones_like)


@pytest.mark.parametrize("turn", [0.3, np.pi / 2, np.pi, 2 * np.pi])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.usefixtures("thin")
def test_arc_against_castigliano(turn, side):
    """Forces and moments on the tip of an arc, in its plane and out of it, agree with Castigliano's by hand."""
    radius = 3 * MM
    up, across, twist, stretch, shear = rigidities(BENT)
    found = flexible(BENT, (radius * turn, side * turn))
    double = np.sin(2 * turn) / 4
    sines = turn / 2 - double
    cosines = turn / 2 + double
    falling = 1.5 * turn - 2 * np.sin(turn) + double
    by_hand = [
        radius**3 * falling / across + radius * (cosines / stretch + sines / shear),
        radius**3 * sines / across + radius * (sines / stretch + cosines / shear),
        radius**3 * (sines / up + falling / twist) + radius * turn / shear,
        radius * (cosines / twist + sines / up),
        radius * (sines / twist + cosines / up),
        radius * turn / across,
    ]
    assert np.diag(found) == pytest.approx(np.array(by_hand), rel=1e-9)
    # A force along the tip bends it sideways, to where the centre is; a force up twists it.
    pulled = side * radius**3 * (1 - np.cos(turn) - np.sin(turn) ** 2 / 2) / across
    assert found[1, 0] == pytest.approx(
        pulled - side * radius * np.sin(turn) ** 2 / 2 * (1 / stretch - 1 / shear), rel=1e-6, abs=1e-12
    )


def test_corner_against_castigliano():
    """Two legs at a right angle: bending the second twists the first."""
    first = 5 * MM
    second = 3 * MM
    up, _, twist, _, shear = rigidities(BENT)
    found = flexible(BENT, (first, 0.0), (0.0, np.pi / 2), (second, 0.0))
    bent = (first**3 + second**3) / (3 * up) + second**2 * first / twist + (first + second) / shear
    assert found[2, 2] == pytest.approx(bent, rel=1e-9)
    assert found[3, 3] == pytest.approx(second / twist + first / up, rel=1e-9)
    load = np.array([0.0, 0, 1, 0, 0, 0])
    path = BENT._replace(length=first + second, path=((first, 0.0), (0.0, np.pi / 2), (second, 0.0)))
    assert root_load(path, load) == pytest.approx(np.array([0, 0, 1, second, -first, 0]), abs=1e-15)
    # Roark: 0.6 by 0.4 mm has a twisting stress of T/(0.231 w t^2).
    pulled = 6 * first / (0.6 * 0.4**2)
    twisted = second / (0.231 * 0.6 * 0.4**2)
    assert largest_stress(path, load) == pytest.approx(np.hypot(pulled, np.sqrt(3) * twisted) / MM**3, rel=5e-3)


@pytest.mark.parametrize("fillet", [0.0, 0.3 * MM])
@pytest.mark.parametrize("ends", [EndCompliance(), GIVING])
def test_straight_pieces_in_line_are_one_beam(monkeypatch, fillet, ends):
    if fillet:
        # Ends keep a bent beam's flare from curling, but not a straight one's, which its root holds.
        ends = ends._replace(curl_pure=0.0, curl_guided=0.0)
    one = BENT._replace(fillet=fillet, ends=ends)
    pieces = one._replace(path=((3 * MM, 0.0), (5 * MM, 0.0)))
    parted = tip_stiffness(pieces, E, NU)
    rounded = 5e-5 if fillet else 1e-10
    assert parted == pytest.approx(tip_stiffness(one, E, NU), rel=rounded, abs=1e-12 * parted.max())
    # With as few Gauss points on the straight beam's flare as on the path's they are the same sums.
    nodes, weights = np.polynomial.legendre.leggauss(4)
    monkeypatch.setattr(beams, "_NODES", (nodes + 1) / 2)
    monkeypatch.setattr(beams, "_WEIGHTS", weights / 2)
    assert parted == pytest.approx(tip_stiffness(one, E, NU), rel=1e-10, abs=1e-12 * parted.max())
    load = np.arange(1.0, 7.0)
    assert root_load(pieces, load) == pytest.approx(root_load(one, load), rel=1e-10)


def test_bends_and_held_pieces_are_stiffer_out_of_their_plane():
    """Both corrections have their values by hand, and none for pieces without length."""
    # As wide as its radius (w/2R = 1/2): 1 + 1/12. A piece as long as its warping: 1 - tanh 1.
    assert beams.bend_stiffening(0.5) == pytest.approx(13 / 12, rel=1e-15)
    assert beams.piece_twist(1e-3, 1e-3) == pytest.approx(0.23840584404423515, rel=1e-12)
    assert beams.piece_twist(1e-3, 0.0) == pytest.approx(1, abs=1e-8)
    radius = BENT.width
    turn = np.pi / 2
    bent = flexible(BENT, (radius * turn, turn))
    loose = flexible(BENT._replace(ends=EndCompliance(warping=1 * MM)), (3 * MM, 0.0), (0.0, 0.0), (2 * MM, 0.0))
    up, _, twist, _, _ = rigidities(BENT)
    assert bent[3, 3] == pytest.approx(radius * np.pi / 4 * (1 / twist + 1 / up) / (13 / 12), rel=1e-9)
    held = 3 * MM * (1 - np.tanh(3) / 3) + 2 * MM * (1 - np.tanh(2) / 2)
    assert loose[3, 3] == pytest.approx(held / twist, rel=1e-9)


def test_a_wide_arc_tends_to_a_straight_beam():
    straight = tip_stiffness(BENT, E, NU)
    for turn in (1e-2, 1e-3, 1e-4):
        off = np.diag(tip_stiffness(BENT._replace(path=((BENT.length, turn),)), E, NU)) / np.diag(straight) - 1
        assert np.abs(off).max() < 100 * turn**2


def test_mass_of_a_slender_straight_path_is_the_cubics():
    slender = BENT._replace(width=BENT.width / 100, thickness=BENT.thickness / 100)
    whole, parted = (tip_mass(s, 1240.0, NU) for s in (slender, slender._replace(path=((8 * MM, 0.0),))))
    assert parted == pytest.approx(whole, rel=2e-6, abs=1e-15 * whole.max())
    bending, *_, stretch, _ = rigidities(slender)
    # Dunkerley's sum for a clamped beam: l^4/420, beside 1/500.6 of its lowest mode.
    lowest = largest_inverse_square(slender._replace(path=((8 * MM, 0.0),)), E, NU, 1240.0)
    assert lowest == pytest.approx(1240.0 * stretch / E * slender.length**4 / 420 / bending, rel=1e-4)


def test_a_grid_of_bent_beams_is_its_beams():
    width, length = np.meshgrid([0.4 * MM, 0.9 * MM], [4 * MM, 6 * MM])
    path = ((length, 0.0), (np.pi * width, np.pi), (length / 2, 0.0))
    grid = BeamSection(width, 0.4 * MM + 0 * width, 1.5 * length + np.pi * width, 0.2 * MM + 0 * width, path=path)
    stiffness = tip_stiffness(grid, E, NU)
    mass = tip_mass(grid, 1240.0, NU)
    for at in np.ndindex(width.shape):
        one = BeamSection(*(np.asarray(v)[at] for v in grid[:4]), path=tuple((p[0][at], p[1]) for p in path))
        assert stiffness[at] == pytest.approx(tip_stiffness(one, E, NU), rel=1e-9, abs=1e-9)
        assert mass[at] == pytest.approx(tip_mass(one, 1240.0, NU), rel=1e-9, abs=1e-18)


def test_torsion_constant_of_square_and_strip():
    # Timoshenko, Theory of Elasticity, table of rectangles: 0.1406 a^4 and a b^3/3 in the limit.
    assert torsion_constant(1.0, 1.0) == pytest.approx(0.1406, rel=5e-3)
    assert torsion_constant(1000.0, 1.0) == pytest.approx(1000 / 3, rel=1e-3)


def test_a_ring_of_quarters_is_a_ring():
    whole = ring((1.0, 2.0), 0.0, 1.0, 4.0, 2.0, 3.0)
    parts = combine(ring((1.0, 2.0), 0.0, 0.25, 4.0, 2.0, 3.0), ring((1.0, 2.0), 0.25, 1.0, 4.0, 2.0, 3.0))
    for a, b in zip(whole, parts, strict=True):
        assert a == pytest.approx(b)


COIL = solenoid(10 * MM, 4 * MM, 10 * MM, 1000, 4 * MM, 1000)
WASHER = SteelRing(4 * MM, 2 * MM, 0.5 * MM, 1000)
CURRENT_A = 0.05


def test_core_is_an_equipotential():
    """Just above the top face of a highly permeable core the field is normal to it."""
    coil = COIL._replace(core_permeability=1e9)
    radial, axial = flux_density(coil, np.array([0.5, 1.0, 1.5]) * MM, np.full(3, 0.05 * MM))
    assert np.abs(radial / axial).max() < 0.1


def test_ring_factors():
    """The disc by its exact polarisation ∝ √(1 − r²/a²), the ring by its inductance: ln(8R/r) − 2 of a line ∝ cos φ."""
    thin = 1e-4
    assert ring_factor(SteelRing(2.0, 0.0, thin, 300)) == pytest.approx(np.pi / 6 * thin, rel=0.08)
    wire = ring_factor(SteelRing(2.01, 1.99, 0.01, 300))
    angle = (np.arange(200_000) + 0.5) / 200_000 * 2 * np.pi
    own = np.cos(angle) / np.sqrt(2 - 2 * np.cos(angle) + (0.2235 * 0.02) ** 2)
    assert wire == pytest.approx(0.01**2 / (4 * np.pi) * own.mean() * 2 * np.pi, rel=1e-3)
    assert ring_factor(SteelRing(1.0, 0.2, 9.0, 300)) == 0


def test_papers_equation_4_misses_by_decades():
    area = np.pi / 4 * (4 * MM) ** 2
    assert paper_force_constant(COIL, area) * CURRENT_A**2 == pytest.approx(1364, rel=1e-3)


def test_field_on_the_axis_is_the_solenoids():
    """The axial field of a thin solenoid has a closed form."""
    thin = solenoid(4.0002 * MM, 3.9998 * MM, 10 * MM, 1000, 0.0, 1.0)
    height = np.array([0.5, 1.0, 3.0]) * MM
    _, axial = flux_density(thin, np.zeros(3), height)
    a = 2 * MM
    length = 10 * MM
    exact = (
        4e-7
        * np.pi
        * 1000
        / length
        / 2
        * ((height + length) / np.hypot(height + length, a) - height / np.hypot(height, a))
    )
    assert axial == pytest.approx(exact, rel=1e-5)


def test_geometric_ladder_keeps_its_ends():
    ladder = geometric_ladder(20, 1000, 11)
    assert (ladder[0], ladder[-1]) == (pytest.approx(20), pytest.approx(1000))
