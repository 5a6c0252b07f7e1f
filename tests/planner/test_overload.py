"""What coils, amplifiers and pads do not bear is an error of the plan, as it is of a drive with all taxels on."""

from dataclasses import replace

import numpy as np
import pytest

from padgen.driver.loads import judge_load, load_of
from padgen.driver.waveform import CONTROLLER_RATES_HZ, drive_at
from padgen.planner.judge import judge
from padgen.planner.make import make_plan
from padgen.spec import parse_spec

PCB = """
name = "pcb"
resolution = {count}
band_hz = [100, 400]
q_min = 15
delta_y = 5
material = "tough-resin"
[printer]
name = "resin-0.05"
bed_x_mm = 218
bed_y_mm = 123
bed_z_mm = 250
[pad]
width_mm = {side}
depth_mm = {side}
[coil]
resistance_ohm = {ohm}
inductance_mh = 0.05
turns = {turns}
outer_diameter_mm = 11.5
inner_diameter_mm = 3
length_mm = 1.6
core_diameter_mm = 0
power_limit_w = {watts}
"""


def test_a_coil_that_burns_is_an_error():
    text = PCB.format(count=16, side=25, ohm=8, turns=100, watts=0.5)
    plan = make_plan(parse_spec(text), tries_cures=False)
    found = {f.code: f.level for f in plan.findings}
    assert plan.load.copper_loss_w > 5 and found["coil.heat"] == "error"


@pytest.mark.parametrize("seed", range(4))
def test_the_plan_and_a_drive_agree_on_what_burns(seed):
    """Away from the limit by 3 %, the margin by which a drive's own bounds may differ."""
    rng = np.random.default_rng(seed)
    ohm = float(rng.uniform(2, 60))
    turns = int(rng.integers(80, 600))
    text = PCB.format(count=16, side=25, ohm=round(ohm, 2), turns=turns, watts=0.5)
    plan = make_plan(parse_spec(text), tries_cures=False)
    for factor in (0.8, 1.25):
        coil = replace(plan.spec.coil, power_limit_w=plan.load.copper_loss_w * factor)
        limited = replace(plan, spec=replace(plan.spec, coil=coil))
        drive = drive_at(limited, CONTROLLER_RATES_HZ)
        driven = {f.code for f in judge_load("", limited, load_of(limited, drive, None))}
        planned = {f.code for f in judge(limited) if f.level == "error"}
        assert ("coil.heat" in driven) == ("coil.heat" in planned) == (factor < 1)
