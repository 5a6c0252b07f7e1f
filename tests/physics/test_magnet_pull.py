"""Agreement table of the pull on magnets: what must equal which number, to what tolerance, and why.

| what | reference | tolerance | reason |
|---|---|---|---|
| Bessel functions | mpmath | 2e-8 | below 1e-8 the argument counts as that |
| coils without a core: force, moment, slope | turns in magpylib's field | 0.1 % of the axis, slope 0.2 % | bars 5 × |
| voltage of a moving magnet | magpylib's flux through all turns | 0.1 % | a central difference |
| coils with a core | field of coil and core by elements | 0.5 % of the axis, the stated error | the bar is 2 % |
| core's pull on the axis | elements in the half plane | 1 % | their own error far away |
| core's pull, side force, moment off the axis; two magnets | elements in space | 3 % | their own error |
| slopes and side forces | differences of pulls | 0.5 % | steps of finite size |
| coupling of neighbours | magpylib | 0.5 % | a difference of forces |
| demagnetising factors | Chen, Brug and Goldfarb 1991; magpylib | 5e-4 | digits printed; the mean over points |
| eddy currents | dipole over a thin sheet | 2 % | the next multipole |
| coupling of many pairs | one pair after the other | 1e-6 | as stated |
| steel on a magnet: pull | elements in the half plane, by reciprocity | 1.5 % | as stated, and their differences |
| steel on top of magnets: coupling far away | dipoles of both moments | 1 % | the next multipole |
| rest on a spring | the balance of pull and spring | 0.2 % | straight lines between gaps |
| waves over a winding's radius | Struve functions (scipy) | 1e-8 of their envelope | Bessel functions to 1e-10 |
"""

from functools import cache

import mpmath
import numpy as np
import pytest
from scipy.special import jv, struve

from padgen.core.units import COPPER_OHM_M, MM, UM
from padgen.physics.magnet_pull import (
    LEAST_GAP,
    _integral_of_rings,
    _ring_wave,
    _spectrum,
    magnet_pull,
    rest_on_spring,
    shared_core,
)
from padgen.physics.magnetics import MU_0, SteelRing, solenoid
from padgen.physics.magnets import (
    DiscMagnet,
    bessel,
    demagnetising_factor,
    dipole_stiffness,
    eddy_damping,
    face_factor,
    margin_temperature,
    neighbour_pull,
    neighbour_stiffness,
    steel_charges,
    working_polarisation,
)
from padgen.spec.load import catalogue
from tests.magnet_oracles import (
    Case,
    coaxial_core_pull,
    core_pull_by_elements,
    flux_linkage,
    force_by_elements,
    force_on_turns,
    force_with_steel,
    magnets_force,
    mean_field,
    random_cases,
)

AIR = solenoid(10 * MM, 4 * MM, 10 * MM, 1000)
CORE = solenoid(10 * MM, 4 * MM, 10 * MM, 1000, 4 * MM, 1000)
DISC = DiscMagnet(3 * MM, 0.0, 1 * MM, 1.2)
RING = DiscMagnet(4 * MM, 1.5 * MM, 1 * MM, 1.3)


@pytest.mark.parametrize("most", [1, 3, 24])
def test_bessel_functions(most):
    x = np.array([0.0, 1e-9, 1e-3, 0.5, 3.0, 7.0, 15.9, 16.1, 23.9, 24.1, 60.0, 900.0])
    exact = np.array([[float(mpmath.besselj(m, v)) for v in x] for m in range(most + 1)])
    assert np.abs(bessel(x, most) - exact).max() < 2e-8


@cache
def without_core():
    """Twelve of the cases of `docs/measure_magnets.py`."""
    return random_cases(300, 1, core=False)[::25]


@pytest.mark.parametrize("case", without_core())
def test_coils_without_a_core(case):
    exact = force_on_turns(case, 2)
    pull = magnet_pull(case.coil, case.magnet, case.gap, np.array([case.offset, 0.0]))
    on_axis = abs(pull.force[1])
    arm = case.magnet.outer_diameter
    assert [pull.force[0], pull.side[0]] == pytest.approx(exact[:2], abs=1e-3 * on_axis)
    assert pull.moment[0] == pytest.approx(exact[2], abs=1e-3 * on_axis * arm)
    step = 0.01 * case.gap
    far, near = (force_on_turns(case._replace(gap=case.gap + d), 2)[0] for d in (step, -step))
    assert pull.slope[0] == pytest.approx((far - near) / (2 * step), abs=2e-3 * abs(pull.slope[1]))
    assert abs(pull.force[0] - exact[0]) < pull.error[0] + 1e-4 * on_axis  # windings of boards are one layer there
    assert pull.core_pull[0] == pull.core_stiffness[0] == 0


def test_known_forces():
    """Force per ampere of 1000 turns on three discs 1 mm above them, as known before to two or three digits."""
    offset = np.array([0, 2, 3.1, 4.4]) * MM
    known = {
        (2, 1): [0.040, 0.034, 0.021, 0.0034],
        (3, 1): [0.090, 0.073, 0.045, 0.0091],
        (3, 2): [0.147, 0.118, 0.075, 0.020],
    }
    for (wide, high), forces in known.items():
        pull = magnet_pull(AIR, DiscMagnet(wide * MM, 0.0, high * MM, 1.2), 1 * MM, offset)
        assert pull.force == pytest.approx(forces, abs=6e-4)


@pytest.mark.parametrize("offset", [0.0, 3 * MM])
def test_a_moving_magnet_induces_its_force_per_ampere(offset):
    case = Case(AIR, RING, 1 * MM, offset)
    step = 10 * UM
    rise = (flux_linkage(case, case.gap + step) - flux_linkage(case, case.gap - step)) / (2 * step)
    assert -rise == pytest.approx(magnet_pull(AIR, RING, case.gap, offset).force[0], rel=1e-3)


@cache
def with_core():
    """Six of the cases of `docs/measure_magnets.py`."""
    return random_cases(300, 2, core=True)[::50]


@pytest.mark.sample(3)
@pytest.mark.parametrize("case", with_core())
def test_coils_with_a_core(case):
    exact = force_by_elements(case, 0.02 * case.gap)[0]
    pull = magnet_pull(case.coil, case.magnet, case.gap, np.array([case.offset, 0.0]))
    on_axis = abs(pull.force[1])
    assert [pull.force[0], pull.side[0]] == pytest.approx(exact, abs=0.005 * on_axis)
    assert abs(pull.force[0] - exact[0]) < pull.error[0] + 1e-3 * on_axis  # a share of the elements' own
    work, stress = coaxial_core_pull(case)
    doubt = abs(work - stress) + 0.003 * work
    assert pull.core_pull[1] == pytest.approx(work, abs=pull.core_error[1] + doubt)
    assert pull.core_pull[1] == pytest.approx(work, rel=0.01 + doubt / work)


def test_core_off_the_axis_by_elements():
    case = Case(CORE, DiscMagnet(3 * MM, 0.0, 2 * MM, 1.2), 0.6 * MM, 3.1 * MM)
    side, _, axial, _, moment, _ = core_pull_by_elements(case, [])[0]
    pull = magnet_pull(CORE, case.magnet, case.gap, case.offset)
    assert pull.core_pull[0] == pytest.approx(-axial, rel=0.01)
    assert pull.core_side[0] == pytest.approx(side, rel=0.01)
    assert pull.core_moment[0] == pytest.approx(moment, rel=0.03)


@pytest.mark.soak
def test_two_magnets_over_one_core_by_elements():
    """Of one polarity they weaken each other's pull: 67 in place of 86 mN each."""
    places = np.array([[2.2, 0.0], [-2.2, 0.0]]) * MM
    case = Case(CORE, DISC, 1 * MM, 2.2 * MM)
    side, _, axial, _, _, _ = core_pull_by_elements(case, [(-2.2 * MM, 0.0)])[0]
    gap = np.full(2, case.gap)
    alike = shared_core(CORE, DISC, gap, places, np.ones(2))
    assert alike.force == pytest.approx([-axial, -axial], rel=0.01)
    alone = magnet_pull(CORE, DISC, case.gap, case.offset)
    opposite = shared_core(CORE, DISC, gap, places, np.array([1, -1]))
    assert (alike.force + opposite.force) / 2 == pytest.approx([alone.core_pull[0]] * 2, rel=1e-9)
    beside = neighbour_pull(DISC, places, np.ones(2)).force[0, 0]
    assert beside > 0 > alone.core_side[0]
    assert 0 < side < beside


@pytest.mark.parametrize("polarity", [(1, 1, 1), (1, -1, 1)])
def test_stiffness_of_a_shared_core(polarity):
    """The matrix is the slope of the pulls, each over all gaps."""
    places = np.array([[1.0, 0.5], [-2.2, 0.0], [0.5, 3.0]]) * MM
    gap = np.array([0.8, 1.0, 1.2]) * MM
    signs = np.array(polarity)
    coupling = shared_core(CORE, DISC, gap, places, signs)
    assert coupling.stiffness == pytest.approx(coupling.stiffness.T, rel=1e-9)
    for j in range(3):
        step = 5 * UM * (np.arange(3) == j)
        far, near = (shared_core(CORE, DISC, gap + d, places, signs).force for d in (step, -step))
        assert coupling.stiffness[:, j] == pytest.approx((far - near) / (10 * UM), rel=2e-3, abs=0.05)


@pytest.mark.parametrize("coil", [AIR, CORE])
@pytest.mark.parametrize("magnet", [DISC, RING])
def test_derivatives(coil, magnet):
    """Slopes are those of pulls, and side forces those of the same energy."""
    gap = 0.7 * MM
    offset = 2.5 * MM
    at = magnet_pull(coil, magnet, gap, offset)
    step = 5 * UM
    far, near = (magnet_pull(coil, magnet, gap + d, offset) for d in (step, -step))
    out, back = (magnet_pull(coil, magnet, gap, offset + d) for d in (step, -step))
    for pull, slope, side in (("force", "slope", "side"), ("core_pull", "core_stiffness", "core_side")):
        pulls, sides = ([getattr(p, name)[0] for p in (far, near)] for name in (pull, side))
        assert getattr(at, slope)[0] == pytest.approx((pulls[0] - pulls[1]) / (2 * step), rel=5e-3, abs=1e-9)
        sideways = (getattr(out, pull)[0] - getattr(back, pull)[0]) / (2 * step)
        assert (sides[0] - sides[1]) / (2 * step) == pytest.approx(-sideways, rel=5e-3, abs=1e-9)


def test_places_are_independent_of_each_other():
    gap = np.array([0.5, 3.0, 0.5, 0.9]) * MM
    offset = np.array([0.0, 12.0, 0.0, 2.0]) * MM
    together = magnet_pull(CORE, DISC, gap, offset)
    for i in range(4):
        alone = magnet_pull(CORE, DISC, gap[i], offset[i])
        assert together.force[i] == pytest.approx(alone.force[0], rel=2e-3, abs=1e-6)
        assert together.core_pull[i] == pytest.approx(alone.core_pull[0], rel=2e-3, abs=1e-9)
    assert magnet_pull(CORE, DISC, np.zeros(0), np.zeros(0)).force.shape == (0,)
    assert magnet_pull(AIR, DISC, 0.0, 0.0).force == magnet_pull(AIR, DISC, LEAST_GAP, 0.0).force


def test_polarity_and_strength():
    """Force per ampere goes as the polarisation, the core's pull as its square."""
    strong = DISC._replace(polarisation=2 * DISC.polarisation)
    turned = DISC._replace(polarisation=-DISC.polarisation)
    pulls = [magnet_pull(CORE, magnet, 1 * MM, 1 * MM) for magnet in (DISC, strong, turned)]
    assert [p.force[0] / pulls[0].force[0] for p in pulls] == pytest.approx([1, 2, -1], rel=1e-12)
    assert [p.core_pull[0] / pulls[0].core_pull[0] for p in pulls] == pytest.approx([1, 4, 1], rel=1e-12)


@pytest.mark.parametrize("magnet", [DISC, RING, DiscMagnet(3 * MM, 0.0, 2 * MM, 1.2)])
@pytest.mark.parametrize("apart", [1.1, 2.0, 3.0])
def test_neighbours(magnet, apart):
    distance = apart * magnet.outer_diameter
    places = np.array([[0.0, 0.0], [0.0, distance]])
    coupling = neighbour_pull(magnet, places, np.ones(2))
    exact = magnets_force(magnet, np.array([distance, 0.0, 0.0]), 2)
    assert coupling.force[1] == pytest.approx([0.0, exact[0]], rel=5e-3, abs=1e-12)
    step = 0.01 * MM
    far, near = (magnets_force(magnet, np.array([distance, 0.0, d]), 2)[2] for d in (step, -step))
    assert coupling.stiffness[0, 0] == pytest.approx(-(far - near) / (2 * step), rel=5e-3)
    assert coupling.stiffness == pytest.approx(coupling.stiffness[0, 0] * np.array([[1, -1], [-1, 1]]), rel=1e-9)
    opposite = neighbour_pull(magnet, places, np.array([1, -1]))
    assert opposite.stiffness == pytest.approx(-coupling.stiffness)
    assert opposite.force == pytest.approx(-coupling.force)


def test_neighbours_far_away_are_dipoles():
    places = np.array([[0.0, 0.0], [60 * MM, 0.0]])
    far = neighbour_pull(DISC, places, np.ones(2)).stiffness[0, 0]
    assert far == pytest.approx(float(dipole_stiffness(DISC.moment, 60 * MM)), rel=0.01)
    assert far < 0  # side by side and alike, they would rather be on top of each other


@pytest.mark.parametrize("magnet", [DISC, RING])
def test_stiffnesses_of_many_pairs_are_those_of_each(magnet):
    apart = magnet.outer_diameter * np.array([[1.06, 1.2, 1.3], [2.0, 4.0, 15.0]])
    found = neighbour_stiffness(magnet, apart)
    for place, distance in np.ndenumerate(apart):
        pair = neighbour_pull(magnet, np.array([[0.0, 0.0], [distance, 0.0]]), np.ones(2))
        assert found[place] == pytest.approx(-pair.stiffness[0, 1], rel=1e-6)


STEELS = [
    (DISC, SteelRing(3 * MM, 0.0, 3 * MM, 100)),
    (DISC, SteelRing(5 * MM, 2.2 * MM, 2 * MM, 300)),
    (RING, SteelRing(2 * MM, 0.0, 5 * MM, 50)),
]


@pytest.mark.parametrize(("magnet", "steel"), STEELS)
def test_steel_on_top_of_a_magnet(magnet, steel):
    gap = 1.0 * MM
    found = magnet_pull(AIR, magnet, gap, 0.0, steel).force[0]
    bare = magnet_pull(AIR, magnet, gap, 0.0).force[0]
    assert found == pytest.approx(force_with_steel(Case(AIR, magnet, gap, 0.0), steel, 30 * UM), rel=0.015)
    assert found > 1.1 * bare
    faint = magnet_pull(AIR, magnet, gap, 0.0, steel._replace(permeability=1 + 1e-6)).force[0]
    assert faint == pytest.approx(bare, rel=1e-5)


def test_moment_by_steel_is_the_slope_of_the_energy():
    """Off the axis the side force is the slope of the energy with the offset, and the pull its slope with the gap."""
    magnet, steel = STEELS[0]
    step = 2 * UM
    gaps = np.array([1.0 * MM, 1.0 * MM, 1.0 * MM + step, 1.0 * MM - step])
    offsets = np.array([2 * MM + step, 2 * MM - step, 2 * MM, 2 * MM])
    found = magnet_pull(AIR, magnet, gaps, offsets, steel)
    # The pull is -dU/dgap and the side force -dU/doffset, so that their cross slopes are alike.
    pull_over_offset = (found.force[0] - found.force[1]) / (2 * step)
    side_over_gap = (found.side[2] - found.side[3]) / (2 * step)
    assert pull_over_offset == pytest.approx(-side_over_gap, rel=1e-4)


def test_rings_of_charge_are_pulled_and_turned_as_the_faces_of_a_magnet():
    node, weight = np.polynomial.legendre.leggauss(24)
    radius = DISC.outer_diameter / 4 * (node + 1)
    charge = 2 * np.pi * radius * weight * DISC.outer_diameter / 4 * DISC.polarisation / MU_0
    both = [np.tile(radius, 2), np.repeat([DISC.height, 0.0], 24), np.concatenate([charge, -charge])]
    spectrum = _spectrum(AIR, DISC, 1 * MM, 3 * MM)
    some = spectrum.k < 8e3
    weights = spectrum.faces / _ring_wave(np.array(both), spectrum.k)[0]
    turned = _ring_wave(np.array(both), spectrum.k)[1]
    scale = np.abs(spectrum.turned[some]).max()
    assert spectrum.turned[some] == pytest.approx((weights * turned)[some], abs=1e-6 * scale)


def test_magnets_with_steel_are_dipoles_far_away():
    magnet, steel = STEELS[0]
    charges = steel_charges(magnet, steel)
    assert abs(charges[2].sum()) < 1e-5 * magnet.moment / magnet.height
    moment = magnet.moment + charges[1] @ charges[2]
    assert moment > 1.5 * magnet.moment
    found = neighbour_stiffness(magnet, np.array([60 * MM]), steel)[0]
    assert found == pytest.approx(dipole_stiffness(moment, 60 * MM), rel=0.01)
    near = neighbour_stiffness(magnet, np.array([6.25 * MM]), steel)[0]
    pairs = charges_apart(magnet, steel, 6.25 * MM)
    assert near == pytest.approx(pairs, rel=0.005)


def charges_apart(magnet, steel, apart):
    """Return the second difference over height of the energy of two clouds of charges, magnets with their steel."""
    rings = steel_charges(magnet, steel)
    turn = (np.arange(24) + 0.5) / 24 * 2 * np.pi
    node = (np.arange(24) + 0.5) / 24
    radius = magnet.outer_diameter / 2 * np.sqrt(node)
    charge = np.full(24, magnet.moment / magnet.height / 24)
    flat = np.concatenate([rings, [radius, np.full(24, magnet.height), charge], [radius, np.zeros(24), -charge]], 1)
    x, y = (np.outer(flat[0], wave).ravel() for wave in (np.cos(turn), np.sin(turn)))
    z, q = (np.repeat(part, 24) for part in (flat[1], flat[2] / 24))

    def energy(rise):
        total = 0.0
        for at in range(len(x)):
            away = np.sqrt((x + apart - x[at]) ** 2 + (y - y[at]) ** 2 + (z + rise - z[at]) ** 2)
            total += q[at] * (q / away).sum()
        return MU_0 / (4 * np.pi) * total

    step = 0.1 * MM
    return (energy(step) - 2 * energy(0.0) + energy(-step)) / step**2


@pytest.mark.parametrize("radii_mm", [(1, 5), (1.5, 15), (4.8, 5), (0, 30)])
def test_waves_over_the_radius_of_a_winding(radii_mm):
    """∫ x J₁(x) dx = π x/2 (J₁ H₀ − J₀ H₁), with Struve's H (DLMF 10.22.2)."""
    inner, outer = (radius * MM for radius in radii_mm)
    k = np.geomspace(30, 10 / LEAST_GAP, 400)

    def below(x):
        return np.pi * x / 2 * (jv(1, x) * struve(0, x) - jv(0, x) * struve(1, x))

    expected = (below(k * outer) - below(k * inner)) / k**2
    envelope = np.maximum(np.abs(expected), np.sqrt(outer / k) / k)
    assert (np.abs(_integral_of_rings(k, inner, outer) - expected) < 1e-8 * envelope).all()


@pytest.mark.parametrize("gap_mm", [0.3, 0.71, 1.6])
def test_magnets_of_any_gap_rest_where_pull_and_spring_balance(gap_mm):
    gap = gap_mm * MM
    offset = np.array([0.0, 1.0, 2.5]) * MM
    least = rest_on_spring(CORE, DISC, gap, offset, np.full(3, 1e6)).least_stiffness
    rest = rest_on_spring(CORE, DISC, gap, offset, 1.5 * least)
    at = magnet_pull(CORE, DISC, rest.gap, offset)
    assert 1.5 * least * (gap - rest.gap) == pytest.approx(at.core_pull, rel=2e-3)
    assert rest.stiffness == pytest.approx(1.5 * least + at.core_stiffness, rel=5e-3)


def test_rest_on_a_spring():
    stiffness = np.array([900.0, 900.0, 500.0])
    rest = rest_on_spring(CORE, DISC, 1 * MM, np.array([0.0, 2.0, 0.0]) * MM, stiffness)
    assert np.isnan(rest.gap[2])  # snaps in at once
    for i, offset in enumerate((0.0, 2 * MM)):
        at = magnet_pull(CORE, DISC, rest.gap[i], offset)
        assert stiffness[i] * (1 * MM - rest.gap[i]) == pytest.approx(at.core_pull[0], rel=2e-3)
        assert rest.stiffness[i] == pytest.approx(stiffness[i] + at.core_stiffness[0], rel=5e-3)
    soft = rest_on_spring(CORE, DISC, 1 * MM, np.zeros(2), rest.least_stiffness[0] * np.array([1.01, 0.99]))
    assert soft.stiffness[0] > 0
    assert np.isnan(soft.gap[1])
    snap = magnet_pull(CORE, DISC, soft.snap_gap[0], 0.0)
    needed = 1.01 * rest.least_stiffness[0] * (1 * MM - soft.snap_gap[0])
    assert needed == pytest.approx(snap.core_pull[0], rel=2e-3)
    assert soft.snap_gap[0] < soft.gap[0]
    free = rest_on_spring(AIR, DISC, 1 * MM, np.zeros(1), np.array([100.0]))
    assert [free.gap[0], free.stiffness[0], free.least_stiffness[0]] == pytest.approx([1 * MM, 100, 0])


@pytest.mark.parametrize(("high", "factor"), [(0.1, 0.7967), (1.0, 0.3116), (10.0, 0.0411)])
def test_demagnetising_factors_of_cylinders(high, factor):
    """Height over diameter, and the magnetometric factor (Chen, Brug and Goldfarb 1991, susceptibility 0)."""
    assert demagnetising_factor(DiscMagnet(1 * MM, 0.0, high * MM, 1.0)) == pytest.approx(factor, abs=5e-4)


@pytest.mark.parametrize("magnet", [DISC, RING])
def test_demagnetising_factors_by_the_field_within(magnet):
    within, middle = mean_field(magnet)
    assert demagnetising_factor(magnet) == pytest.approx(-within * MU_0 / magnet.polarisation, rel=5e-3)
    if magnet.inner_diameter == 0:
        assert face_factor(magnet) == pytest.approx(-middle * MU_0 / magnet.polarisation, rel=1e-3)
    else:
        assert face_factor(magnet) > -middle * MU_0 / magnet.polarisation


@pytest.mark.parametrize("grade", catalogue("magnet_grade").values(), ids=lambda grade: grade["name"])
def test_limits_of_makers_lie_between_the_first_and_the_mean_point(grade):
    """Makers state the temperature for a height of 0.7 diameters (shanghaimagnet): neither bound may contradict it."""
    magnet = DiscMagnet(10 * MM, 0.0, 7 * MM, 0.0)
    remanence = (grade["remanence_low_t"] + grade["remanence_high_t"]) / 2
    changes = grade["remanence_per_k"], grade["coercivity_per_k"]
    mean = demagnetising_factor(magnet)
    polarisation = working_polarisation(remanence, grade["recoil_permeability"], mean)
    first, half = (
        margin_temperature(polarisation, 1e3 * grade["coercivity_ka_per_m"], factor, changes)
        for factor in (face_factor(magnet), mean)
    )
    assert first < grade["limit_c"] < half


def test_margin_temperature_is_where_the_field_meets_the_knee():
    changes = -0.0012, -0.0075
    at = margin_temperature(1.3, 955e3, 0.5, changes, opposing=20e3)
    own = 0.5 * 1.3 / MU_0 * (1 + changes[0] * (at - 20))
    assert own + 20e3 == pytest.approx(0.9 * 955e3 * (1 + changes[1] * (at - 20)))
    assert margin_temperature(1.3, 955e3, 0.6, changes) < margin_temperature(1.3, 955e3, 0.5, changes)


def test_eddy_currents_far_away():
    away = 30 * MM
    dipole = 3 * MU_0**2 * DISC.moment**2 * 35 * UM / (64 * np.pi * COPPER_OHM_M * (away + DISC.height / 2) ** 4)
    assert eddy_damping(DISC, away, 35 * UM, COPPER_OHM_M) == pytest.approx(dipole, rel=0.02)


def test_eddy_currents_by_magpylib():
    """The damping is the power of the currents σ v B_r at a speed v, over v²."""
    from tests.magnet_oracles import radial_field_square

    thin = 5 * UM
    gap = 0.8 * MM
    power = thin / COPPER_OHM_M * radial_field_square(DISC, gap + thin / 2)
    assert eddy_damping(DISC, gap, thin, COPPER_OHM_M) == pytest.approx(power, rel=2e-3)


def test_catalogue_of_magnets():
    """Every magnet has a grade and is a magnet; the mass that a shop states is that of size and density."""
    grades = catalogue("magnet_grade")
    magnets = catalogue("magnet")
    for name, row in magnets.items():
        assert row["grade"] in grades, name
        assert row["outer_diameter_mm"] > row["inner_diameter_mm"] >= 0, name
        assert row["source"], name
    for name, grade in grades.items():
        assert 1.0 < grade["remanence_low_t"] < grade["remanence_high_t"] < 1.55, name
        assert grade["source"], name
    stated = magnets["ring-12x5x2"]
    ring = DiscMagnet(*(stated[key] * MM for key in ("outer_diameter_mm", "inner_diameter_mm", "thickness_mm")), 1.0)
    assert 1e6 * ring.volume * grades[stated["grade"]]["density_g_per_cm3"] == pytest.approx(1.4, abs=0.05)
