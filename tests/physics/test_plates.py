"""Wide beams as plates: Kirchhoff's equation, yokes and layers by theory, and random taxels by cells.

| what | held to | why |
|---|---|---|
| stiffness of clamped strips against polynomials solved here | 0.1 % | the fit is within 0.05 % |
| a yoke that bends, against beam elements solved here | 1e-9 | the same theory, another method |
| edges of layered half-planes against Lekhnitskii's quartic | 1e-7 | double roots have half the digits |
| working modes of fresh cells | 92 % within what is stated, 88 % of 10 | drawn after the code was fixed |
| their bias; what is stated | below half of what is stated; three times the median error | too wide says nothing |
| their other modes | 90 % | lateral, torsion, pitch, in plane |
| sag, deflection and stress | 88 % within what is stated | static solutions, integrated bending moments |
| bridges wider than four thicknesses, longer than 3 w | 3 %, without a bias beyond 0.5 % | they were 1-3 % low |
| folded beams wider than four thicknesses | half the error that they have on a yoke that only twists | they were high |
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.stats import binom

sys.path.append(str(Path(__file__).parents[2] / "docs"))
import measure_campaign as campaign

from padgen.physics import beams
from padgen.physics.beams import (
    RIGID,
    ROOT,
    BeamSection,
    Surroundings,
    YokeSize,
    anticlastic_factors,
    layered_edge,
    on_elastic_ends,
    tip_stiffness,
    torsion_constant,
)
from padgen.verify.elasticity import Elastic, layered, stiffness_pa

CELLS = campaign.rows_of(campaign.CELL_SET)
"""Taxels that were seen when the errors were chosen."""
FRESH = campaign.rows_of(campaign.FRESH_SET)
SOLVED = 500
"""Taxels of the fresh draw that were solved at least."""
ALONG = 26
ACROSS = 12


def polynomials(at, count, scale):
    """Return Legendre polynomials at places in -1 … 1 and their first two derivatives in a coordinate `scale` long."""
    found = []
    for order in range(3):
        rows = [legendre.legval(at, legendre.legder(one, order) if order else one) for one in np.eye(count)]
        found.append(np.array(rows) * (2 / scale) ** order)
    return found


def strip_flexibility(length, poisson):
    """Return deflection and slope (2, 2) per unit force and moment of a strip 1 wide with EI = 1, by Ritz' method.

    The root is clamped, the tip a rigid edge, the sides are free.
    """
    place, weight = legendre.leggauss(60)
    x = polynomials(place, ALONG, length)
    y = [rows[::2] for rows in polynomials(place, ACROSS, 1.0)]

    def both(a, b, c, d):
        over_x = (x[a] * weight * length / 2) @ x[b].T
        over_y = (y[c] * weight / 2) @ y[d].T
        return np.kron(over_x, over_y)

    bent = both(2, 2, 0, 0) + both(0, 0, 2, 2) + poisson * (both(2, 0, 0, 2) + both(0, 2, 2, 0))
    stiffness = (bent + 2 * (1 - poisson) * both(1, 1, 1, 1)) / (1 - poisson**2)
    across = np.eye(ACROSS // 2)
    root, tip = (polynomials(np.array([end]), ALONG, length) for end in (-1.0, 1.0))
    held = [np.kron(root[order][:, 0], one) for order in (0, 1) for one in across]
    held += [np.kron(tip[order][:, 0], one) for order in (0, 1) for one in across[1:]]
    _, size, turned = np.linalg.svd(np.array(held))
    free = turned[int((size > 1e-10 * size[0]).sum()) :].T
    load = free.T @ np.stack([np.kron(tip[order][:, 0], across[0]) for order in (0, 1)], 1)
    return load.T @ np.linalg.solve(free.T @ stiffness @ free, load)


@pytest.mark.parametrize("poisson", [0.25, 0.36, 0.45])
@pytest.mark.parametrize("length", [0.4, 1.0, 2.5, 6.0])
def test_a_clamped_strip_is_a_plate(length, poisson):
    pure, guided = (share * poisson**2 for share in anticlastic_factors(np.array(length)))
    ends = RIGID._replace(curl_pure=pure, curl_guided=guided)
    thickness = 1e-4  # shear counts for nothing
    section = BeamSection(1.0, thickness, length, ends=ends)
    stiffness = tip_stiffness(section, 12 / thickness**3, poisson)[np.ix_([2, 4], [2, 4])]
    true = np.linalg.inv(strip_flexibility(length, poisson))
    true[0, 1] *= -1  # a rotation about y lowers what lies ahead
    true[1, 0] *= -1
    assert stiffness == pytest.approx(true, rel=1e-3)


def test_short_strips_are_plates_and_long_ones_are_beams():
    assert anticlastic_factors(np.array(1e-6)) == pytest.approx((1, 1), abs=1e-5)
    assert max(anticlastic_factors(np.array(1e4))) < 1e-3


def cantilever_tip(length, bending, held, spring):
    """Return the lift of a bar's tip per unit force on it, by a Hermite element clamped through a hinge.

    The hinge turns as a piece of bar `held` long; `spring` resists the tip's rotation.
    """
    k = bending / length**3
    element = k * np.array(
        [
            [4 * length**2, -6 * length, 2 * length**2],
            [-6 * length, 12, -6 * length],
            [2 * length**2, -6 * length, 4 * length**2],
        ]
    )
    element[0, 0] += bending / held
    element[2, 2] += spring
    return np.linalg.solve(element, [0, 1, 0])[1]


@pytest.mark.parametrize("width", [0.4e-3, 3e-3])
def test_a_yoke_bends_as_beams(width):
    """What a yoke adds to the beam's flexibility, in SI: the neck's and the crossbar's, without twist of the bar."""
    thickness = 0.3e-3
    length = 9e-3
    modulus = 2e9
    poisson = 0.36
    arm, bar, height, neck, neck_width = 1.5e-3, 0.8e-3, 1.1e-3, 2e-3, 2.5e-3
    bare = BeamSection(width, thickness, length)
    around = Surroundings(1e-3, 1e-3, 1e-3, 2e-3, YokeSize(arm, bar, height, neck, neck_width))
    ends = on_elastic_ends(bare, around, poisson).ends
    more = RIGID._replace(yoke_turn=ends.yoke_turn, yoke_both=ends.yoke_both, yoke_lift=ends.yoke_lift)
    with_yoke, without = (
        np.linalg.inv(tip_stiffness(bare._replace(ends=these), modulus, poisson)[np.ix_([2, 4], [2, 4])])
        for these in (more, RIGID)
    )
    # Both beams load the neck, whose end at the plate turns as in a frame; moments as within the beam beside it.
    at, weight = legendre.leggauss(20)
    s = (at + 1) * neck / 2
    arms = np.stack([s, np.ones_like(s)])
    end = np.array([neck, 1.0])
    necks = 2 / (modulus * neck_width * height**3 / 12) * ((arms * weight * neck / 2) @ arms.T)
    necks = necks + 2 / (modulus * neck_width * height**3 / 12) * ROOT * height * np.outer(end, end)
    shear_modulus = modulus / 2 / (1 + poisson)
    reach = arm + width / 2
    spring = shear_modulus * torsion_constant(width, thickness) / length
    lift = cantilever_tip(reach, modulus * bar * height**3 / 12, ROOT * height, spring)
    necks[0, 0] += lift + 1.2 * reach / (shear_modulus * bar * height)
    signs = np.array([[1, -1], [-1, 1]])
    assert with_yoke - without == pytest.approx(signs * necks, rel=1e-9)


@pytest.mark.parametrize("across", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("poisson", [0.3, 0.45])
def test_layered_edges_yield_by_the_roots_of_the_quartic(across, poisson):
    s = np.linalg.inv(stiffness_pa(layered(Elastic(1.0, poisson, 1.0), across)))
    roots = np.roots([s[0, 0], 0, 2 * s[0, 2] + s[4, 4], 0, s[2, 2]])
    # An isotropic edge has the double root i.
    assert layered_edge(across, poisson) == pytest.approx(roots[roots.imag > 0].imag.sum() / 2, rel=1e-7)


def test_wide_folded_beams_bend_their_yoke(monkeypatch):
    rows = [row for row in CELLS if row["topology"] == "folded" and row["width_mm"] > 4 * row["thickness_mm"]]

    def error():
        found = [one.error for row in rows for one in campaign.compared(row) if one.working]
        return np.sqrt(np.mean(np.square(found)))

    assert len(rows) >= 25
    usual = error()
    monkeypatch.setattr(beams, "_yoke_bending", lambda *_: (0.0, 0.0, 0.0))
    assert error() > 2 * usual


@pytest.fixture(scope="module")
def fresh():
    return [one for row in FRESH for one in campaign.compared(row)]


@pytest.fixture(scope="module")
def working(fresh):
    return [one for one in fresh if one.working]


def covered(group):
    return float(np.mean([abs(one.error) <= one.stated for one in group]))


def test_stated_error_covers_fresh_cells(working):
    assert len(working) >= SOLVED
    assert {row["topology"].partition("-")[0] for row in FRESH} == {*campaign.TOPOLOGIES, "serpentine"}
    assert covered(working) >= 0.92


@pytest.mark.parametrize("named", [campaign.cell_of, campaign.group_of])
def test_every_fresh_cell_is_covered(working, named):
    """None is surely below 88 %: with a chance of 1 % as few would be covered if it were that."""
    for name in {named(one.row) for one in working}:
        group = [one for one in working if named(one.row) == name]
        seen = sum(abs(one.error) <= one.stated for one in group)
        assert binom.cdf(seen, len(group), 0.88) > 0.01, name


def test_stated_error_is_no_wider_than_it_must_be(working):
    """Three times the median error was aimed at; it is 3.3 (docs/accuracy.md)."""
    error, stated = (np.array([getattr(one, key) for one in working]) for key in ("error", "stated"))
    assert abs(np.median(error)) < np.median(stated) / 2
    assert np.median(stated) <= 3.4 * np.median(np.abs(error))


def test_other_modes_are_covered(fresh):
    assert covered([one for one in fresh if not one.working]) >= 0.9


@pytest.mark.sample(1)
@pytest.mark.parametrize("what", campaign.STATIC)
def test_static_answers_are_covered(what):
    pairs = [campaign.static_compared(row)[what] for row in FRESH]
    assert np.mean([abs(error) <= stated for error, stated in pairs if np.isfinite(error)]) >= 0.88


def test_wide_bridges_are_not_soft():
    errors = [
        one.error
        for row in CELLS
        if row["topology"] == "bridge"
        and row["width_mm"] > 4 * row["thickness_mm"]
        and row["length_mm"] > 3 * row["width_mm"]
        for one in campaign.compared(row)
        if one.working
    ]
    assert len(errors) >= 8
    assert max(map(abs, errors)) < 0.03
    assert abs(np.median(errors)) < 0.005
