"""Pushes on taxels: closing forces and skin by closed forms, and the findings and cures about them."""

from math import pi

import pytest

from padgen.planner.cures import varied
from padgen.planner.make import make_plan
from padgen.planner.plan import plan_from_json, plan_to_json
from padgen.spec import parse_spec

PAD = "name = 'pad'\nresolution = 32\nband_hz = [50, 200]\nq_min = 15\ndelta_y = 5\ndrive = 'spur-free'\n"
GRID = "[coil]\ngrid = [4, 4]\nreuse = 'alternate'\ngap_mm = 1\n"


@pytest.fixture(scope="module")
def plan():
    return make_plan(parse_spec(PAD + GRID))


def test_a_gap_closes_under_stiffness_times_gap(plan):
    """The spring of the working mode alone, k = m ω²: other modes give way by at most 1 % more."""
    for channel, force_mn in zip(plan.channels, plan.pushed.closing_force_mn, strict=True):
        spring = channel.effective_mass_g * 1e-3 * (2 * pi * channel.resonance_hz) ** 2
        assert force_mn == pytest.approx(spring * (1 - channel.sag_um * 1e-3), rel=0.01)
    assert plan.pushed.closing_force_mn[:2] == pytest.approx((16, 38), abs=0.5)
    assert all(rim < force for rim, force in zip(plan.pushed.rim_force_mn, plan.pushed.closing_force_mn, strict=True))


def test_pushes_and_skin_leave_a_gap_or_none(plan):
    for push in plan.pushed.pushes:
        for k, channel in enumerate(plan.channels):
            gap_mm = 1 - channel.sag_um * 1e-3
            if push.push_mn is not None:
                moved_mm = push.push_mn / channel.stiffness_n_per_m
            else:  # skin of 2 E* (a + a0), a = 1.25 mm, in series with the spring, over 1 mm
                skin = {"low": 60 * 1.35, "typical": 160 * 1.55, "high": 500 * 1.65}[push.skin]
                moved_mm = skin / (skin + channel.stiffness_n_per_m)
            assert push.deflection_mm[k] == pytest.approx(moved_mm, rel=0.01)
            assert push.gap_left_mm[k] == pytest.approx(max(gap_mm - push.deflection_mm[k], 0))
            # The tilted washer's rim is lower than its middle, in the ratio of the pushes that bring either down.
            tilted = plan.pushed.closing_force_mn[k] / plan.pushed.rim_force_mn[k]
            assert push.contact[k] == (tilted * push.deflection_mm[k] >= gap_mm)
    again = plan_from_json(plan_to_json(plan)).pushed
    assert again.closing_force_mn == pytest.approx(plan.pushed.closing_force_mn, rel=1e-9)


def test_one_finding_tells_of_pushes_and_its_cure_holds(plan):
    (found,) = (f for f in plan.findings if f.code == "touch.push")
    assert (found.level, found.where) == ("warning", "channel 0")
    assert "presses the rim of its boss with 13 mN stops it" in found.message
    assert "of typical skin (a provisional model) that only rests on the frame" in found.message
    assert "in by 0.93 mm, and stops channels 0" in found.message
    cured = make_plan(varied(plan.spec, found.cures[0]), tries_cures=False)
    assert not any(next(p for p in cured.pushed.pushes if p.skin == "typical").contact)
    assert [f.level for f in cured.findings if f.code == "touch.push"] == ["note"]
