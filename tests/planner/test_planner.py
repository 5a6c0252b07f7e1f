"""Plans: their channels, layouts and findings, and the refusals where no layout holds."""

import json
import random
import re
from dataclasses import asdict, replace
from itertools import pairwise
from math import hypot
from types import SimpleNamespace

import numpy as np
import pytest

from padgen.core.errors import FileError, InfeasibleError, OlderPlanError, SpecError
from padgen.ladders.extreme import random_table
from padgen.make.planning import recorded_plan
from padgen.physics.ladder import slot_half_width
from padgen.physics.selectivity import Scheme, all_states, channels, one_hot_db
from padgen.planner import make, make_plan, plan_from_json, plan_to_json, sizing
from padgen.planner.channels import wanted_line_a2
from padgen.planner.layout import candidates, channel_counts, room, sub_cell_centres, taxel_site
from padgen.planner.make import choose, finish
from padgen.planner.plan import level_law
from padgen.planner.search import TRIED_SINGLY, largest_counts
from padgen.planner.sizing import SizedChannel, crowded_modes, reach
from padgen.planner.suspensions import BeamShape, PlateShape, Room, allowed, names, suspension
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.planner.verdict import with_verdict
from padgen.report.plans import plan_text
from padgen.spec import load_spec, make_spec, parse_spec, template_paths
from padgen.spec.load import without_none

FOUR_LINES = 'name = "a"\nresolution = {}\nband_hz = [{}, {}]\nq_min = 15\n'


def plan_of(resolution=32, low=50, high=200, extra=""):
    """Return a plan whose findings' cures are not tried, which takes longer than all else."""
    return finish(choose(parse_spec(FOUR_LINES.format(resolution, low, high) + extra)))


def test_the_papers_pad(paper_plan):
    assert len(paper_plan.taxels) == 32
    assert (paper_plan.coils.rows, paper_plan.coils.columns, paper_plan.coils.pitch_mm) == (4, 4, 12.5)
    found = [c.resonance_hz for c in paper_plan.channels]
    # A width is drawn to a micrometre: 0.05 % of the smallest beam's frequency, doubled.
    assert found == pytest.approx([56, 76], rel=1e-3)
    assert [c.drive_hz for c in paper_plan.channels] == pytest.approx([f / 2 for f in found], rel=1e-12)


def test_capacity_of_the_papers_band():
    capacity = plan_of(4, 20, 1000, "[pad]\nwidth_mm = 60\ndepth_mm = 60\n").capacity
    assert capacity.paper == 11
    assert capacity.paper_unrounded == pytest.approx(11.627, abs=1e-3)
    assert capacity.ratio == pytest.approx(1.4)
    assert capacity.exact <= capacity.exact_one_hot


@pytest.mark.sample(3)
@pytest.mark.parametrize("asked_db", [3.0, 10.0, 25.9])
@pytest.mark.parametrize("scheme", ["spur-free", "time-shared"])
def test_large_counts_of_channels_hold_and_one_more_does_not(asked_db, scheme):
    band_hz = (200.0, 460.0)
    law = level_law(load_spec("pad-32"))
    scheme = Scheme(scheme)
    states, one_hot = largest_counts(band_hz, 1500.0, law, scheme, asked_db)

    def ladder(count):
        hz = np.geomspace(*band_hz, count)
        return channels(hz, 1500.0, law(hz))

    assert one_hot >= states > TRIED_SINGLY
    assert all_states(ladder(states), scheme).db >= asked_db > all_states(ladder(states + 1), scheme).db
    assert one_hot_db(ladder(one_hot), scheme) >= asked_db > one_hot_db(ladder(one_hot + 1), scheme)


def test_fewest_coils_whose_prints_work():
    """Eight coils of four channels have room, but no print of them keeps 20 dB."""
    plan = plan_of()
    assert (plan.coils.rows * plan.coils.columns, len(plan.sets[0])) == (16, 2)
    eight = plan_of(extra="[coil]\ngrid = [2, 4]\n")
    assert eight.prints.good_share < 0.01 < plan.spec.print_share <= plan.prints.good_share
    less = plan_of(extra="delta_y = 3\n")
    assert less.coils.rows * less.coils.columns < 16 and less.prints.good_share >= less.spec.print_share


@pytest.mark.parametrize(("rows", "columns", "axis"), [(2, 4, "y_mm"), (4, 2, "x_mm")])
def test_a_layout_with_a_hole_is_a_warning(rows, columns, axis, paper_plan):
    """Rows 6.25, 18.75, 6.25 mm apart over 2 x 4 coils, columns over 4 x 2; paper-32 is even."""
    plan = plan_of(extra=f"[coil]\ngrid = [{rows}, {columns}]\n")
    gaps = np.diff(sorted({round(getattr(taxel, axis), 3) for taxel in plan.taxels}))
    assert gaps == pytest.approx([6.25, 18.75, 6.25], abs=0.01)
    (found,) = (f for f in plan.findings if f.code == "layout.pitch")
    assert found.level == "warning" and "6.25 to 18.75 mm apart" in found.message
    assert "layout.pitch" not in {f.code for f in paper_plan.findings}


def test_only_width_differs_where_it_reaches(paper_plan):
    beams = [c.beam for c in paper_plan.channels]
    assert len({(b.thickness_mm, b.length_mm, b.topology) for b in beams}) == 1
    assert beams[0].width_mm < beams[1].width_mm


def test_thickness_is_whole_layers_where_width_does_not_reach():
    plan = plan_of(6, 60, 900, "resonances_hz = [80, 240, 800]\n[coil]\ngrid = [1, 2]\n")
    printer = plan.spec.printer
    assert len({c.beam.thickness_mm for c in plan.channels}) > 1
    for channel in plan.channels:
        layers = (channel.beam.thickness_mm - printer.first_layer_mm) / printer.layer_mm + 1
        assert layers == pytest.approx(channel.beam.layers, abs=1e-9)
        assert channel.beam.width_mm >= printer.smallest_beam_mm


def test_tune_width_only_is_obeyed_or_refused():
    wide = "resonances_hz = [80, 240, 800]\n[coil]\ngrid = [1, 2]\n[suspension]\ntune = 'width'\n"
    with pytest.raises(InfeasibleError, match="beams for 80, 240, 800 Hz hold a washer beyond"):
        plan_of(6, 60, 900, wide)


@pytest.mark.parametrize("topology", names())
def test_every_topology_plans_and_resonates_as_asked(topology):
    extra = f"resonances_hz = [150, 260]\n[pad]\nwidth_mm = 40\ndepth_mm = 40\n[suspension]\ntopology = '{topology}'\n"
    plan = plan_of(8, 100, 400, extra)
    assert {c.beam.topology for c in plan.channels} == {topology}
    assert [c.resonance_hz for c in plan.channels] == pytest.approx([150, 260], rel=2e-3)


@pytest.mark.parametrize("topology", names())
@pytest.mark.parametrize("room", [Room(8, 7), Room(14, 8), Room(30, 20)])
def test_arrangements_stay_in_their_room_and_apart(topology, room):
    gap = 0.3
    plate = PlateShape(4.6, 4.6, 4.0)
    shape = suspension(topology)
    length = shape.longest(room, plate, gap)
    width = shape.widest(room, plate, gap)
    if length < shape.shortest(plate, gap) or width < 0.45:
        return
    made = shape.arrange(plate, BeamShape(width, 0.3, length), gap)
    assert made.window_mm[0] <= room.length_mm + 1e-9
    assert made.window_mm[1] <= room.width_mm + 1e-9
    for block in made.blocks:
        assert block.low_x_mm >= 0
        assert block.high_x_mm <= made.window_mm[0]
        assert max(abs(block.low_y_mm), abs(block.high_y_mm)) <= made.window_mm[1] / 2 - gap + 1e-9


def test_resonance_rises_with_width_and_thickness_and_falls_with_length(paper_spec):
    plate = plate_shape(paper_spec)
    for topology in names():
        length = np.array([9.0, 9.0, 9.0, 10.0])
        length += max(suspension(topology).shortest(plate, 0.3) - 9.0, 0.0)
        beam = BeamShape(np.array([0.6, 0.9, 0.6, 0.6]), np.array([0.3, 0.3, 0.4, 0.3]), length)
        base, wide, thick, long = TaxelModel(paper_spec, topology, plate, beam).resonance_hz
        assert wide > base
        assert thick > base
        assert long < base


def test_reach_is_what_the_model_says(paper_spec):
    grid = reach(paper_spec, "cantilever", Room(11.5, 5.25))
    widths = grid.widths_for(np.array([60.0]))[0]
    t, n = np.argwhere(np.isfinite(widths))[0]
    beam = BeamShape(widths[t, n], grid.thickness_mm[t], grid.length_mm[n])
    found = TaxelModel(paper_spec, "cantilever", plate_shape(paper_spec), beam).resonance_hz
    # Log-log interpolation between four widths.
    assert found == pytest.approx(60, rel=0.02)


def test_taxels_lie_on_the_pad_apart_and_level_with_their_coil(paper_plan):
    places = [(t.x_mm, t.y_mm) for t in paper_plan.taxels]
    assert max(max(abs(x), abs(y)) for x, y in places) < 25
    nearest = min(hypot(a[0] - b[0], a[1] - b[1]) for i, a in enumerate(places) for b in places[:i])
    assert nearest > 5
    distances = {round(t.coil_distance_mm, 6) for t in paper_plan.taxels}
    assert len(distances) == 1
    for taxel in paper_plan.taxels:
        row, column = taxel.coil
        coil = ((column - 1.5) * 12.5, (row - 1.5) * 12.5)
        assert hypot(taxel.x_mm - coil[0], taxel.y_mm - coil[1]) == pytest.approx(taxel.coil_distance_mm)


def test_ids_are_unique_and_channels_complete(paper_plan):
    assert len({t.id for t in paper_plan.taxels}) == 32
    counts = np.bincount([t.channel for t in paper_plan.taxels])
    assert counts.tolist() == [16, 16]


@pytest.mark.parametrize("resolution", [7, 31])
def test_awkward_resolutions_leave_places_empty_and_say_so(resolution):
    plan = plan_of(resolution)
    assert len(plan.taxels) == resolution
    assert "layout.surplus" in {f.code for f in plan.findings}


def test_whole_grids_come_before_empty_places():
    assert all(layout.surplus == 0 for layout in candidates(parse_spec(FOUR_LINES.format(32, 50, 200)), 4)[:3])


@pytest.mark.parametrize(
    ("resolution", "low", "high", "extra", "sentence"),
    [
        (128, 50, 200, "", "128 taxels .* room for 25 coils .* at most 4 channels: .*; .*resolution = .* would do"),
        (100000, 20, 1000, "", "room for 25 coils of 10 mm; .* allow each at most 11 channels"),
        (32, 50, 200, 'washer = "iso7089-m3"\n', "washer iso7089-m3 .* mm too wide; washer = .* would do"),
        (
            12,
            50,
            200,
            "suspension = 'serpentine-3'\ncoil = {grid = [2, 2]}\npad = {width_mm = 33, depth_mm = 33}\n",
            r"the plate \(4.65 mm\) leaves too little width for a beam \(0.0833\d* mm short\)",
        ),
        (64, 50, 400, "", "leaves no length for a beam .*pad.width_mm = .* with pad.depth_mm = .* would do"),
        (16, 5, 9, "", "can be printed for .* Hz .asked: "),
        (
            4,
            50,
            200,
            "[coil]\ngrid = [9, 9]\n",
            "exceeds the pitch of 5.5556 mm; coil.grid = \\[1, 1\\]",
        ),
        (33, 50, 200, "resonances_hz = [56, 76]\n[coil]\ngrid = [4, 4]\n", "allow each at most 2 channels"),
        (16, 50, 200, "[coil]\nouter_diameter_mm = 60\ngrid = [1, 4]\n", "the coil \\(60 mm\\) exceeds the pitch"),
        (
            4,
            50,
            200,
            "[suspension]\nlength_mm = 200\n",
            "no beam of suspension.length_mm = 200; leaving out suspension.length_mm would do",
        ),
        (31, 50, 200, "[coil]\ngrid = [4, 4]\n[suspension]\ntopology = 'folded'\n", "suspension.topology = 'auto'"),
    ],
)
def test_infeasible_specs_name_the_limit_and_a_cure(resolution, low, high, extra, sentence):
    with pytest.raises(InfeasibleError, match=sentence) as refusal:
        plan_of(resolution, low, high, extra)
    assert "\n" not in str(refusal.value)


def test_a_band_narrower_than_a_slot_is_refused():
    with pytest.raises(SpecError, match=r"band_hz: holds no channel.*; band_hz = \[50, 70\.07\] would do$"):
        plan_of(4, 50, 60)


def test_no_wider_band_is_proposed_than_skin_feels():
    # At Q = 5 a slot of 26 dB is a band of 1 : 799, up to 64 kHz from 80 Hz on.
    table = {"name": "x", "resolution": 4, "band_hz": [80, 320], "q_min": 5, "delta_y": 19.95}
    with pytest.raises(SpecError, match=r"band_hz: holds no channel.*; delta_y = 4\.5\d* would do$") as caught:
        make_plan(make_spec(table))
    (cure,) = caught.value.cures
    assert make_plan(make_spec({**table, **cure}), tries_cures=False).channels


def test_a_band_narrower_than_a_drawn_beam_is_refused():
    with pytest.raises(
        SpecError, match=r"band_hz: is narrower than beams can be drawn, to 0\.2%.*; band_hz = \[100, 100\.3\]"
    ):
        make_plan(parse_spec(FOUR_LINES.format(4, 100, 100.0001).replace("15", "1e8")))
    make_plan(parse_spec(FOUR_LINES.format(1, 100, 100.3).replace("15", "1e8")))


def test_closest_spacing_is_the_papers_ladder():
    plan = plan_of(8, 50, 400, 'spacing = "closest"\n')
    ratios = [b.target_hz / a.target_hz for a, b in pairwise(plan.channels)]
    assert ratios == pytest.approx([1.4] * len(ratios), rel=1e-4)


def test_spread_uses_the_band():
    plan = plan_of(32, 50, 200, "[coil]\ngrid = [4, 4]\n")
    half = 10 / 60
    assert plan.channels[0].target_hz == pytest.approx(50 / (1 - half), rel=1e-4)
    assert plan.channels[-1].target_hz == pytest.approx(200 / (1 + half), rel=1e-4)


def test_plan_survives_json(paper_plan, paper_spec):
    text = plan_to_json(paper_plan)
    again = plan_from_json(text)
    assert plan_to_json(again) == text
    assert again.spec == paper_spec


def test_a_plan_of_an_older_padgen_is_planned_anew(paper_plan, tmp_path):
    table = json.loads(plan_to_json(paper_plan))
    del table["verdict"], table["parts"]
    older = tmp_path / "plan.json"
    older.write_text(json.dumps(table))
    with pytest.raises(OlderPlanError, match="older padgen; padgen plan makes it anew"):
        plan_from_json(older.read_text())
    assert plan_to_json(recorded_plan(older)) == plan_to_json(paper_plan)


def test_a_plan_holds_the_wanted_lines_of_the_squared_current():
    for name in ("paper-32", "wide-11"):
        for channel in json.loads(plan_to_json(make_plan(load_spec(name))))["channels"]:
            pulled_mn = channel["line_a2"] * channel["force_constant_n_per_a2"] * 1e3
            assert pulled_mn == pytest.approx(channel["force_mn"], rel=1e-9)
    assert wanted_line_a2(1.0, -1e-9) == wanted_line_a2(1.0, 0.0) == 0.0


def test_the_text_of_a_plan_is_the_same_every_time(paper_plan):
    text = plan_text(paper_plan)
    assert "19.4 dB with one channel on (19.2 dB by the paper's formula)" in text
    assert plan_text(paper_plan) == text


def jittered(value, seed):
    """Return a spec's tables with all the digits of a float in their numbers."""
    if isinstance(value, dict):
        return {key: jittered(entry, seed) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [jittered(entry, seed) for entry in value]
    return value * (1 - seed.uniform(0, 1e-7)) if isinstance(value, float) else value


@pytest.mark.sample(4)
@pytest.mark.parametrize(
    "name",
    [
        name if name in ("pad-32", "magnet-6", "palm-24", "wide-11") else pytest.param(name, marks=pytest.mark.soak)
        for name in sorted(template_paths())
    ],
)
def test_a_plan_of_a_plan_is_the_same_to_the_last_digit(name):
    seed = random.Random(name)
    table = without_none(asdict(load_spec(name)))
    for part in ("q_min", "delta_y", "pad", "material", "drive", "suspension"):
        table[part] = jittered(table[part], seed)
    # The paper's cells are just as wide as its plates need: the pad became smaller, the ribs must, too.
    table["pad"]["rib_mm"] *= 1 - 1e-5
    # At the edge of its bounds.
    table["material"]["cross_layer_ratio"] = 1 - 2**-53
    thickness_mm = 0.98 * table["pad"]["frame_thickness_mm"] if "ballast" in table else 3.9  # with room for ballast
    table["taxel"] |= {"glue_mg": 5e-324, "boss_protrusion_mm": 1 + 2**-52, "plate_thickness_mm": thickness_mm}
    spec = make_spec(table)
    assert re.search(r"\d\.\d{12}", json.dumps(table))
    text = plan_to_json(make_plan(spec))
    again = plan_from_json(text).spec
    assert again == spec
    assert plan_to_json(make_plan(again)) == text


def test_a_threshold_curve_is_recorded_to_the_last_digit():
    lists = (
        "threshold_hz = [49.00000000000001, 100.1234567890123, 200.3]\nthreshold_um = [0.30000000000000004, 0.1, 2e-5]"
    )
    plan = plan_of(8, extra=f"[drive]\n{lists}\n")
    again = plan_from_json(plan_to_json(plan))
    assert again.spec.drive.threshold_um == (0.1 + 0.2, 0.1, 2e-5)
    assert plan_to_json(make_plan(again.spec)) == plan_to_json(plan)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"name": 3}', "[" * 100_000, '{"name": ' + "9" * 5000 + "}"])
def test_what_is_no_plan_is_refused(text):
    with pytest.raises(FileError, match="is not a plan"):
        plan_from_json(text)


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        (("channels", 0, "beam", "width_mm"), "0.6", r"channels\[0\]\.beam\.width_mm must be a number"),
        (("channels", 0, "beam", "width_mm"), True, r"width_mm must be a number"),
        (("channels", 0, "beam", "width_mm"), None, r"width_mm must be a number"),
        (("channels", 0, "beam", "width_mm"), float("nan"), r"width_mm must be a number"),
        pytest.param(("channels", 0, "beam", "width_mm"), 10**400, "width_mm must be a number", id="huge"),
        (("channels", 0, "beam", "width_mm"), -0.5, r"width_mm must be a size of a pad"),
        (("channels", 0, "beam", "topology"), "spiral", r"channels\[0\] has a topology or a direction"),
        (("channels", 1, "index"), 0, r"channels\[1\]\.index must be 1"),
        (("channels",), [], "no channels"),
        (("taxels", 3, "channel"), 2, r"taxels\[3\] is of a coil or a channel that there is not"),
        (("taxels", 3, "coil"), [0, 4], r"taxels\[3\] is of a coil or a channel that there is not"),
        (("taxels", 3, "coil"), [0], r"taxels\[3\]\.coil must be a list of 2"),
        (("cell", "width_mm"), 0.0, r"cell\.width_mm must be a size"),
        (("spec", "q_min"), -1, "its spec: q_min: must be at least 0.5"),
    ],
)
def test_a_garbled_plan_is_refused(paper_plan, path, value, sentence):
    table = json.loads(plan_to_json(paper_plan))
    entry = table
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] = value
    with pytest.raises(FileError, match=f"is not a plan .*{sentence}") as refusal:
        plan_from_json(json.dumps(table))
    assert "\n" not in str(refusal.value)


def test_a_plan_is_the_same_every_time(paper_spec):
    assert plan_to_json(make_plan(paper_spec)) == plan_to_json(make_plan(paper_spec))


def test_stress_beyond_fatigue_is_an_error():
    plan = plan_of(32, 50, 200, "[drive]\nlevel_um = 3000\n")
    assert {"beam.stress", "beam.sag"} <= {f.code for f in plan.findings}
    assert any(f.level == "error" for f in plan.findings)


def test_stress_grows_with_level():
    one, two = (plan_of(4, extra=f"[drive]\nlevel_um = {n}\n").channels[0] for n in (4, 8))
    assert two.root_stress_mpa == pytest.approx(2 * one.root_stress_mpa)


def test_stress_by_hand():
    """A force at the washer, with the arm l + plate/2 − r from the end of the flare, gives σ = 6 F arm/(w t²)."""
    plan = plan_of(4, extra="[suspension]\ntopology = 'cantilever'\n")
    channel = plan.channels[0]
    beam = channel.beam
    fillet = channel.beam.fillet_mm
    force_n = channel.stiffness_n_per_m * channel.level_um * 1e-6
    arm = beam.length_mm + 4.6 / 2 - fillet
    by_hand = 6 * force_n * arm / (beam.width_mm * beam.thickness_mm**2)
    # The mode's inertia acts along the plate, not at the washer alone: a few per cent.
    assert channel.root_stress_mpa == pytest.approx(by_hand, rel=0.05)


def test_sag_by_hand():
    """The weight at x on a light cantilever gives F (x³ − (x−l)³)/(3EI), and more by the compliance of its ends."""
    plan = plan_of(4, extra="[suspension]\ntopology = 'cantilever'\n[taxel]\nfillet_mm = 0\n")
    channel = plan.channels[0]
    beam = channel.beam
    model = TaxelModel(
        plan.spec,
        "cantilever",
        plate_shape(plan.spec),
        BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm),
    )
    inertia = beam.width_mm * beam.thickness_mm**3 / 12
    reach = beam.length_mm + 2.3
    length = beam.length_mm
    give = beam.thickness_mm * (0.33 * reach**2 + 0.75 * 2.3**2)
    per_newton = ((reach**3 - 2.3**3) / 3 + give) / (3000 * inertia)
    sag_um = float(model.body.mass) * 9.80665 * per_newton * 1e3
    # The beam's own weight, shear and the anticlastic stiffening are left out by hand.
    assert channel.sag_um == pytest.approx(sag_um, rel=0.03)
    assert length > 0


def test_bridge_plan_with_silent_second_mode_survives_json():
    extra = "resonances_hz = [150, 260]\n[pad]\nwidth_mm = 40\ndepth_mm = 40\n[suspension]\ntopology = 'bridge'\n"
    plan = plan_from_json(plan_to_json(plan_of(8, 100, 400, extra)))
    assert all(0 < c.second_mode_hz < 1e5 for c in plan.channels)
    assert all(c.second_mode_share == pytest.approx(0, abs=1e-9) for c in plan.channels)
    assert "bridge" in plan_text(plan)


def test_crowded_modes_are_found():
    """A folded suspension's pitch mode is excited, and lies in the other channel's slot."""
    spec = parse_spec(FOUR_LINES.format(2, 100, 400) + "q_min = 15\n".replace("q_min = 15\n", ""))
    plate = plate_shape(spec)
    beam = BeamShape(0.6, 0.3, 6.6)
    model = TaxelModel(spec, "cantilever", plate, beam)
    first = SizedChannel(float(model.resonance_hz), "cantilever", beam, model)
    pitch = float(model.modes.frequency_hz[np.argsort(model.compliances)[-2]])
    # A second channel at the first one's pitch mode, tuned by its modulus.
    share = (pitch / float(model.resonance_hz)) ** 2
    stiff = replace(spec, material=replace(spec.material, youngs_modulus_gpa=3.0 * share))
    other = TaxelModel(stiff, "cantilever", plate, beam)
    second = SizedChannel(float(other.resonance_hz), "cantilever", beam, other)
    loud = replace(spec, drive=replace(spec.drive, level_law=0.0))
    found = crowded_modes(loud, (first, second))
    assert [(i, j) for i, _, j, _ in found] == [(0, 1)]
    quiet = replace(spec, drive=replace(spec.drive, level_law=2.0))
    assert crowded_modes(quiet, (first, second)) == []


def test_silent_second_modes_near_a_channel_are_noted():
    plan = make_plan(load_spec("wide-11"))
    (found,) = [f for f in plan.findings if f.code == "modes.near"]
    half = slot_half_width(15, plan.spec.delta_y)
    near = [
        c.index
        for c in plan.channels
        if c.second_mode_share < 1e-6
        and any(c is not o and abs(c.second_mode_hz / o.resonance_hz - 1) < half for o in plan.channels)
    ]
    # A channel may have another mode that is loud.
    crowded = {(f.where, number) for f in plan.findings if f.code == "modes.crowded" for number in f.message.split()}
    quiet = [k for k in near if (f"channel {k}", f"{plan.channels[k].second_mode_hz:.5g}") not in crowded]
    assert quiet
    assert (found.level, found.where) == ("note", f"channel{'s' * (len(quiet) > 1)} {', '.join(map(str, quiet))}")
    assert "modes.near" not in {f.code for f in make_plan(load_spec("paper-32")).findings}


@pytest.mark.parametrize(("kept_db", "told"), [(13.84, "at least 13.8 dB more"), (-3.12, "at most 3.1 dB less")])
def test_the_verdict_has_no_negative_decibels(paper_plan, kept_db, told):
    plan = replace(paper_plan, prints=replace(paper_plan.prints, print_db=kept_db, planned_db=-10.0))
    sentence = with_verdict(plan, plan.findings).verdict.sentence
    assert f"in 90% of prints ON taxels then vibrate {told} than OFF ones (asked: 20.0 dB)." in sentence


def test_unequal_pull_is_found():
    plan = plan_of(44, 20, 1000, WIDE)
    figures = plan.selectivity
    assert figures.placed_one_hot_db < figures.one_hot_db - 1
    assert "selectivity.pull" in {f.code for f in plan.findings}
    assert "selectivity.pull" not in {f.code for f in plan_of().findings}


WIDE = """
[pad]
width_mm = 100
depth_mm = 100
[washer]
name = "iso7092-m3"
[coil]
outer_diameter_mm = 44
inner_diameter_mm = 16
core_diameter_mm = 16
grid = [2, 2]
"""


@pytest.mark.sample(1)
@pytest.mark.parametrize("q", [2.6, 1e3, 1e8])
def test_extreme_q_is_planned_as_quickly(q):
    """At Q = 1e8 ten million channels would fit the band; no more are tried than were asked for."""
    spec = parse_spec(f'name = "a"\nresolution = 9\nband_hz = [20, 9000]\nq_min = {q}\n')
    plan = make_plan(spec, tries_cures=False)
    assert len(plan.taxels) == 9
    assert len(channel_counts(plan.spec, 10**8)) <= 9
    assert plan.capacity.paper == int(np.log(450) / (2 * np.arctanh(2.5 / q)) * (1 + 1e-12))


def test_resonances_finer_than_a_micrometre_of_beam():
    plan = plan_of(2, 50, 200, "resonances_hz = [60, 60.0001]\n")
    assert "ladder.ratio" in {f.code for f in plan.findings}
    fine = make_plan(parse_spec(FOUR_LINES.format(4, 100, 101).replace("15", "1e6")))
    assert {"resonance.off"} <= {f.code for f in fine.findings}
    assert fine.selectivity.all_states_db <= fine.selectivity.one_hot_db


def test_a_pad_beyond_the_bed_is_said_before_it_is_built():
    long = make_plan(parse_spec(FOUR_LINES.format(4, 50, 200) + "[pad]\nwidth_mm = 300\ndepth_mm = 20\n"))
    (finding,) = [f for f in long.findings if f.code == "plan.bed"]
    assert finding.level == "error"
    assert finding.message.endswith("; pad.width_mm = 238 with pad.depth_mm = 20 would do")
    assert "plan.bed" not in {f.code for f in plan_of().findings}


def test_a_pad_that_no_smaller_one_replaces_is_told_the_bed_that_bears_it():
    """On less area 64 taxels of this band keep 13 dB less, so that a smaller pad is no cure."""
    wide = make_plan(parse_spec(FOUR_LINES.format(64, 50, 250) + "[pad]\nwidth_mm = 300\ndepth_mm = 150\n"))
    (finding,) = [f for f in wide.findings if f.code == "plan.bed"]
    assert finding.message.endswith("; printer.bed_x_mm = 312 with printer.bed_y_mm = 210 would do")
    printed = make_plan(replace(wide.spec, printer=replace(wide.spec.printer, bed_x_mm=312.0)))
    assert "plan.bed" not in {f.code for f in printed.findings}


def test_no_beam_is_shorter_than_thick_and_those_beyond_the_model_are_found():
    plan = plan_of(7, 220, 22000, "[suspension]\ntopology = 'cantilever'\n")
    assert all(c.beam.length_mm >= c.beam.thickness_mm for c in plan.channels)
    doubtful = [c.index for c in plan.channels if c.model_error > 0.02]
    worst = max(plan.channels, key=lambda c: c.model_error)
    # One finding for all, in the words of the worst.
    (finding,) = [f for f in plan.findings if f.code == "model.error"]
    assert finding.where == f"channels {', '.join(map(str, doubtful))}"
    assert finding.message.startswith(f"at worst, on channel {worst.index}, the beam model may be off by")
    assert f"{worst.model_error:.1%}" in finding.message
    stubby = {c.index for c in plan.channels if c.beam.length_mm < 2 * c.beam.thickness_mm}
    assert stubby and stubby <= set(doubtful)
    relaxed = plan_of(7, 220, 22000, "model = {tolerance = 0.5}\n[suspension]\ntopology = 'cantilever'\n")
    assert "model.error" not in {f.code for f in relaxed.findings}


@pytest.mark.parametrize(
    "extra",
    [
        "gap_mm = 0.05\n",  # sag alone
        "gap_mm = 0.5\n[drive]\nlevel_um = 420\n",  # amplitude
        "gap_mm = 0.3\n[drive]\nlevel_um = 60\nscheme = 'biased'\nbias_ratio = 30\n",  # static pull
        "gap_mm = 0.7\n[material]\nyoungs_modulus_gpa = 0.01\n[pad]\nwidth_mm = 100\ndepth_mm = 100\n",
    ],
)
def test_a_washer_that_meets_the_coil_is_an_error(extra):
    plan = plan_of(4, 15 if "material" in extra else 50, 200, f"[coil]\ngrid = [1, 2]\n{extra}")
    gap_um = plan.spec.coil.gap_mm * 1e3
    travels_um = {f"channel {c.index}": c.sag_um + c.static_um + c.level_um for c in plan.channels}
    assert max(travels_um.values()) >= gap_um
    found = {f.code: f for f in plan.findings}
    met = {where for where, travel_um in travels_um.items() if travel_um >= gap_um}
    near = {where for where, travel_um in travels_um.items() if gap_um > travel_um > gap_um / 3}
    meeting = [found[code] for code in ("coil.pull_in", "gap.contact") if code in found]
    assert {f"channel {index}" for f in meeting for index in re.findall(r"\d+", f.where)} == met
    assert {f.level for f in meeting} == {"error"}
    close = found.get("gap.travel")
    assert {f"channel {index}" for index in re.findall(r"\d+", close.where if close else "")} == near
    assert close is None or close.level == "warning"


def test_no_gap_is_suggested_that_a_coil_may_not_have():
    soft = "[material]\nname = 'pla'\nyoungs_modulus_gpa = 0.01\n[pad]\nwidth_mm = 400\ndepth_mm = 400\n"
    text = FOUR_LINES.format(1, 1, 20) + f"resonances_hz = [2.5]\n[coil]\ngrid = [1, 1]\n{soft}"
    plan = make_plan(parse_spec(text))
    (found,) = [f for f in plan.findings if f.code == "gap.contact"]
    assert found.level == "error"
    assert "coil.gap_mm =" not in found.message.partition(", above ")[2].partition(";")[2]


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("extra", "depth_mm"),
    [
        ("", 0.4),
        ("[taxel]\nglue_gap_mm = 0.05\n", 0.4),
        ("[taxel]\nglue_gap_mm = 0\n", 0.3),
        ("[taxel]\nglue_gap_mm = 0.10001\n", 0.5),
        ("printer = 'fdm-0.25'\n[washer]\nname = 'iso7092-m1.6'\nthickness_mm = 0.31\n", 0.45),
        ("[printer]\nname = 'fdm-0.4'\nlayer_mm = 0.2\nfirst_layer_mm = 0.3\n", 0.5),
        ("[printer]\nname = 'fdm-0.4'\nnozzle_mm = 0.8\nfirst_layer_mm = 0.6\n", 0.6),
    ],
)
def test_a_recess_is_whole_layers_deep(extra, depth_mm):
    plan = plan_of(4, extra=extra)
    spec = plan.spec
    asked_mm = plan.spec.washer.thickness_mm + plan.spec.taxel.glue_gap_mm
    assert plan.plate.recess_depth_mm == pytest.approx(depth_mm, abs=1e-9)
    notes = [f.message for f in plan.findings if f.code == "recess.layers"]
    if depth_mm - asked_mm < 1e-6:
        assert notes == []
        return
    # The plan is that of the depth as it is printed.
    said = re.search(r"taxel\.glue_gap_mm = ([\d.]+) says the same", notes[0]).group(1)
    same = make_plan(replace(spec, taxel=replace(spec.taxel, glue_gap_mm=float(said))))
    assert "recess.layers" not in {f.code for f in same.findings}
    assert [c.resonance_hz for c in same.channels] == [c.resonance_hz for c in plan.channels]
    assert [c.effective_mass_g for c in same.channels] == [c.effective_mass_g for c in plan.channels]


def test_whole_layers_leave_the_roof_its_two():
    coarse = "[printer]\nname = 'fdm-0.4'\nlayer_mm = 0.2\nfirst_layer_mm = 0.3\n"
    with pytest.raises(SpecError, match=r"taxel\.plate_thickness_mm: must be at least 0\.9 mm"):
        plan_of(4, extra=f"{coarse}[taxel]\nplate_thickness_mm = 0.8\n")


def test_single_layers_are_noted():
    plan = plan_of(4, 50, 200, "[suspension]\nthickness_mm = 0.2\n")
    assert "beam.single_layer" in {f.code for f in plan.findings}
    thick = plan_of(4, 50, 200, "[suspension]\nthickness_mm = 0.5\n")
    assert "beam.single_layer" not in {f.code for f in thick.findings}


def test_explicit_pair_too_close_is_judged(paper_plan):
    codes = [f.code for f in paper_plan.findings]
    assert "ladder.ratio" in codes
    assert {f.level for f in paper_plan.findings} <= {"warning", "note"}


@pytest.mark.parametrize(("coil_mm", "reaches"), [(6, False), (12, False), (45, True)])
def test_a_coil_that_does_not_reach_its_washers_is_refused(coil_mm, reaches):
    extra = f"resonances_hz = [60, 84, 118, 164, 230]\n[coil]\ngrid = [1, 1]\nouter_diameter_mm = {coil_mm}\n"
    if reaches:
        plan_of(5, 50, 300, extra)
        return
    with pytest.raises(InfeasibleError, match=r"beyond the coil's reach of [\d.]+ mm"):
        plan_of(5, 50, 300, extra)


def test_glue_and_post_change_the_mass(paper_spec):
    def mass(**changes):
        spec = replace(paper_spec, taxel=replace(paper_spec.taxel, **changes))
        return float(TaxelModel(spec, "cantilever", plate_shape(spec), BeamShape(0.6, 0.3, 6.6)).body.mass)

    assert mass(glue_mg=2.0) - mass() == pytest.approx(2e-6)
    bore = 1.7 - 0.25
    depth = 0.4
    assert mass(centre_post=True) - mass() == pytest.approx(np.pi / 4 * bore**2 * depth * 1.24e-6)


def test_body_mass_by_hand(paper_spec):
    """The mass of the default taxel's plate and boss, less the recess."""
    spec = paper_spec
    model = TaxelModel(spec, "cantilever", plate_shape(spec), BeamShape(0.6, 0.3, 6.6))
    plastic = 4.65**2 * 4 + np.pi / 4 * (2.5**2 * 1.0 - 3.75**2 * 0.4)
    steel = np.pi / 4 * (3.5**2 - 1.7**2) * 0.3
    assert float(model.body.mass) == pytest.approx((plastic * 1.24 + steel * 7.85) * 1e-6)


def test_make_spec_refuses_what_is_no_table():
    with pytest.raises(SpecError):
        make_spec({"name": "a", "resolution": 1, "band_hz": [1, 2], "q_min": 15, "drive": 4})


def hung_on(paper_spec, topology, tune="width+thickness+length"):
    suspension = replace(paper_spec.suspension, topology=topology, tune=tune)
    return make_plan(replace(paper_spec, suspension=suspension))


def slopes(plan, channel):
    """Return d ln f / d ln of width, thickness and length, by whole steps of 1 %."""
    beam = plan.channels[channel].beam
    spec = plan.spec
    size = np.array([beam.width_mm, beam.thickness_mm, beam.length_mm])
    found = []
    for axis in np.eye(3):
        pair = [
            TaxelModel(spec, beam.topology, plate_shape(spec), BeamShape(*(size * np.exp(side * axis).tolist())))
            for side in (-0.01, 0.01)
        ]
        found.append(float(np.log(pair[1].resonance_hz / pair[0].resonance_hz)) / 0.02)
    return np.array(found)


def test_serpentines_print_alike_in_the_papers_cell(paper_spec, paper_plan):
    """Of the paper's pair in one plan, at most 60 % of the straight beams' spread, and no more of a taxel's own.

    By typical terms of a print: thickness and width of a taxel's own, 0.006 and 0.015 mm; height common to a print and
    over the bed, 0.015 and 0.01 mm; modulus 2 %.
    """

    def spreads(plan, channel):
        width, thickness, _ = slopes(plan, channel)
        beam = plan.channels[channel].beam
        own = np.hypot(width * 0.015 / beam.width_mm, thickness * 0.006 / beam.thickness_mm)
        return own, np.sqrt(own**2 + (thickness / beam.thickness_mm) ** 2 * (0.015**2 + 0.01**2) + 0.01**2)

    plan = hung_on(paper_spec, "serpentine")
    assert [c.beam.topology for c in plan.channels] == ["serpentine-7", "serpentine-5"]
    for channel in range(2):
        assert plan.channels[channel].resonance_hz == pytest.approx((56, 76)[channel], rel=2e-3)
        assert plan.channels[channel].model_error < 0.025
        assert plan.cell == paper_plan.cell
        (own, total), (straight_own, straight_total) = spreads(plan, channel), spreads(paper_plan, channel)
        assert straight_total == pytest.approx(0.095, abs=0.002)
        assert total <= 0.6 * straight_total
        assert own <= straight_own
        ranked = plan.channels[channel].print_spread
        assert ranked < 0.6 * paper_plan.channels[channel].print_spread


def test_exponents_of_a_serpentine_are_what_a_print_goes_with(paper_spec):
    """The exponents of the planner's ranking grid, of one channel, and by steps of each dimension agree."""
    plan = hung_on(paper_spec, "serpentine-5")
    beam = plan.channels[0].beam
    size = BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm)
    of_channel = TaxelModel(paper_spec, "serpentine-5", plate_shape(paper_spec), size).exponents
    assert of_channel == pytest.approx(slopes(plan, 0), rel=2e-3)
    grid = reach(paper_spec, "serpentine-5", Room(11.5, 5.25))
    t = int(np.abs(grid.thickness_mm - beam.thickness_mm).argmin())
    n = int(np.abs(grid.length_mm - beam.length_mm).argmin())
    ranked = grid.spread(grid.widths_for(np.array([56.0])), paper_spec)[0, t, n]
    # Between four widths and nine lengths.
    assert ranked == pytest.approx(plan.channels[0].print_spread, rel=0.1)


def test_a_mode_on_the_working_one_is_told(paper_spec, paper_plan):
    def told(plan):
        return [finding.where for finding in plan.findings if finding.code == "modes.doubled"]

    assert told(paper_plan) == told(hung_on(paper_spec, "serpentine-5")) == []
    # No bend of seven legs at 76 Hz there has its plate's sideways mode clear of it.
    assert told(hung_on(paper_spec, "serpentine-7")) == ["channel 1"]


def test_auto_leaves_serpentines_to_those_who_name_them():
    assert allowed("auto") == ["cantilever", "folded", "bridge"]
    assert allowed("serpentine-3") == ["serpentine-3"]
    assert allowed("serpentine") == ["serpentine-3", "serpentine-5", "serpentine-7"]


def test_washers_keep_a_ring_where_that_evens_their_pull():
    """The paper's eleven channels: nearest to the axis their pulls differ 36 : 1 and what draws two washers cancels."""
    plan = make_plan(load_spec("wide-11"))
    pull = [c.force_constant_n_per_a2 for c in plan.channels]
    assert 1 < max(pull) / min(pull) < 5
    assert max(c.force_error for c in plan.channels) < 0.05
    layout = next(o for o in candidates(plan.spec, 11) if o.margin_mm >= 0)
    arrangement = TaxelModel(plan.spec, "cantilever", plate_shape(plan.spec), BeamShape(0.6, 0.5, 8.2)).arrangement
    inside = room(plan.spec, layout)
    for centre in sub_cell_centres(layout):
        u, v = centre
        nearest, *others = (
            taxel_site(plan.spec, replace(layout, ring_mm=mm), centre, arrangement) for mm in (0, 8, 12, 18, 99)
        )
        for ring, site in zip((8, 12, 18, 99), others, strict=True):
            assert nearest.coil_distance_mm - 1e-6 <= site.coil_distance_mm
            far = others[-1].coil_distance_mm
            assert site.coil_distance_mm == pytest.approx(np.clip(ring, nearest.coil_distance_mm, far), abs=2e-6)
            # Within its sub-cell: the window slides by what the room leaves.
            middle = (-1 if site.along[0] == "-" else 1) * (arrangement.washer_x_mm - arrangement.window_mm[0] / 2)
            assert abs(site.washer_mm[0] - middle - u) <= (inside.length_mm - arrangement.window_mm[0]) / 2 + 2e-6
            assert abs(site.washer_mm[1] - v) <= (inside.width_mm - arrangement.window_mm[1]) / 2 + 2e-6


def test_runners_up_are_other_layouts():
    plan = plan_of(8, 50, 200, "")
    own = plan.coils.rows, plan.coils.columns, len(plan.sets[0])
    assert plan.layouts
    assert own not in [(o.rows, o.columns, o.channels) for o in plan.layouts]


@pytest.mark.parametrize("topology", ["serpentine-3", "serpentine-5", "serpentine-7"])
def test_no_bent_beam_resonates_beyond_the_corners_of_its_grid(topology):
    """Searches pass over rooms by the corners alone; 152 random rooms and specs were within 0.1 % of them."""
    chance = random.Random(4)
    judged_rooms = 0
    for number in range(40):
        table = random_table(number)
        if "suspension" in table:
            table["suspension"] = {"topology": topology}
        try:
            spec = make_spec(table)
        except SpecError:
            continue
        space = Room(4 * 10 ** chance.random(), 4 * 10 ** chance.random())
        whole = sizing._reach(spec, topology, space, 0)
        if whole is None:
            continue
        judged_rooms += 1
        low, high = sizing._bent_corners_hz(spec, topology, space, 0)
        assert low / 1.1 < whole.span_hz[0]
        assert whole.span_hz[1] < high * 1.1
    assert judged_rooms >= 5


def test_of_hopeless_choices_few_are_printed(monkeypatch):
    """Some ninety choices, of which no print keeps what is asked; without the bound all ninety are printed."""
    printed = []

    def counted(*arguments):
        paper_db, prints = compared_prints(*arguments)
        if prints is not make.NOT_PRINTED:
            printed.append(prints)
        return paper_db, prints

    compared_prints = make.compared_prints
    monkeypatch.setattr(make, "compared_prints", counted)
    table = {"name": "hopeless", "resolution": 48, "band_hz": [340, 21000], "q_min": 314, "spacing": "closest"}
    choose(make_spec({**table, "pad": {"width_mm": 70, "depth_mm": 50}}))
    assert len(printed) <= make.MOST_PRINTED


def test_a_printed_choice_counts_beyond_the_bound_on_prints(monkeypatch):
    """More hopeless choices than are printed, each with a higher upper bound, stand before one whose prints work."""
    parts = {
        "coil": SimpleNamespace(reuse="same", gap_mm=1.0, sides_mm=(10.0, 10.0)),
        "drive": SimpleNamespace(scheme="auto"),
        "suspension": SimpleNamespace(topology="auto"),
    }
    spec = SimpleNamespace(delta_y=10.0, print_share=0.9, leaves_layout_free=False, **parts)
    choices = [make.Choice(spec, number, (number,)) for number in range(make.MOST_PRINTED + 5)]
    works = choices[-1]
    known = set()

    def tried(choice, *_):
        if choice is works:
            return make.ChoiceFigures(21.0, 0.6, 19.0)
        if choice.channels in known:
            return make.ChoiceFigures(25.0, 0.0, 1.0)
        known.add(choice.channels)
        return make.ChoiceFigures(25.0)

    monkeypatch.setattr(make, "_tried", tried)
    assert make._best(iter(choices), make.MOST_PRINTED) == (works, False)
