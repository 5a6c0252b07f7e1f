"""Random specs: each gets a plan that holds or a refusal in one sentence, never a traceback."""

from dataclasses import replace
from itertools import pairwise

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from padgen.core.errors import PadgenError
from padgen.physics.ladder import slot_half_width
from padgen.planner import make_plan, plan_from_json, plan_to_json
from padgen.planner.sizing import steps_are_coarse
from padgen.report.plans import plan_text
from padgen.solid.checks import check_pad
from padgen.solid.pad_solid import build_pad
from padgen.spec import catalogue, make_spec
from padgen.spec.load import without_none

QUIET = {"deadline": None, "suppress_health_check": list(HealthCheck), "derandomize": True, "database": None}


@st.composite
def tables(draw):
    """Draw specs that a person might write, most of them feasible."""
    low = draw(st.floats(50, 150))
    width = draw(st.floats(25, 130))
    depth = draw(st.floats(25, 130))
    printer = draw(st.sampled_from(sorted(catalogue("printer"))))
    washers = sorted(w for w, e in catalogue("washer").items() if e["relative_permeability"] > 2)
    table = {
        "name": "random",
        "resolution": draw(st.integers(1, max(1, int(width * depth / 150)))),
        "band_hz": [low, low * draw(st.floats(1.5, 12))],
        "q_min": draw(st.floats(8, 60)),
        "printer": printer,
        "washer": draw(st.sampled_from(washers[-4:] + ["iso7092-m1.6"] * 4)),
        "pad": {"width_mm": width, "depth_mm": depth},
        "spacing": draw(st.sampled_from(["spread", "closest"])),
        "suspension": {"topology": draw(st.sampled_from(["auto"] * 4 + ["cantilever", "folded", "bridge"]))},
        "taxel": {"centre_post": draw(st.booleans())},
        "drive": {
            "scheme": draw(st.sampled_from(["auto", "auto", "tones", "spur-free", "biased", "time-shared"])),
            "level_law": draw(st.sampled_from([0.0, 1.0, 2.0])),
        },
        "coil": {"reuse": draw(st.sampled_from(["same", "same", "alternate"]))},
    }
    if draw(st.booleans()):
        table["pad"]["rib_mm"] = draw(st.floats(0.6, 2.0))
    return table


def planned(table):
    try:
        return make_plan(make_spec(table), tries_cures=False)
    except PadgenError as refusal:
        assert "\n" not in str(refusal)
        assert len(str(refusal)) < 1000
        return None


@settings(max_examples=3, **QUIET)
@given(tables())
def test_random_plans_hold_what_they_promise(table):
    plan = planned(table)
    assume(plan is not None)
    spec = plan.spec
    assert plan_text(plan_from_json(plan_to_json(plan)))
    assert len(plan.taxels) == spec.resolution
    assert len(plan.sets[0]) <= plan.capacity.paper
    assert plan_to_json(plan_from_json(plan_to_json(plan))) == plan_to_json(plan)
    for channel in plan.channels:
        beam = channel.beam
        assert channel.sag_um > 0
        assert channel.root_stress_mpa > 0
        assert spec.band_hz[0] <= channel.resonance_hz <= spec.band_hz[1]
        assert beam.width_mm >= spec.printer.smallest_beam_mm - 1e-9
        assert beam.layers >= spec.printer.smallest_beam_layers
        assert channel.force_constant_n_per_a2 > 0
    # Beams in coarse steps may leave their target by up to half a slot on either side.
    slack = slot_half_width(spec.q_min, spec.delta_y) if steps_are_coarse(spec) else 3e-3
    for own in plan.sets:
        for lower, upper in pairwise(own):
            assert upper.resonance_hz / lower.resonance_hz >= plan.capacity.ratio * (1 - slack)
    figures = plan.selectivity
    if figures.all_states_db is not None:
        assert figures.all_states_db <= figures.one_hot_db + 1e-9
        assert figures.drive != "auto"
    assert plan.load.reachable_level_um > 0
    half = (spec.pad.width_mm / 2, spec.pad.depth_mm / 2)
    assert all(abs(t.x_mm) < half[0] and abs(t.y_mm) < half[1] for t in plan.taxels)


@settings(max_examples=1, **QUIET)
@given(tables().filter(lambda table: planned(table) is not None))
def test_random_pads_pass_their_checks(table):
    plan = planned(table)
    spec = plan.spec
    # The bed is not what is tried here.
    wide = replace(spec, printer=replace(spec.printer, bed_x_mm=500.0, bed_y_mm=500.0))
    plan = replace(plan, spec=wide)
    report = check_pad(build_pad(plan), plan)
    assert all(finding.level != "error" for finding in report.findings), report.findings


@settings(max_examples=60, **QUIET)
@given(
    st.sampled_from(["resolution", "band_hz", "q_min", "pad", "coil", "washer", "printer", "taxel", "suspension"]),
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-5, 10**7),
        st.floats(allow_nan=True),
        st.text(max_size=5),
        st.lists(st.floats(allow_nan=True), max_size=3),
        st.dictionaries(st.text(max_size=12), st.floats(), max_size=2),
    ),
)
def test_nonsense_is_refused_in_one_sentence(key, value):
    table = {"name": "a", "resolution": 4, "band_hz": [50, 200], "q_min": 15, key: value}
    planned(without_none(table) if value is not None else table)
