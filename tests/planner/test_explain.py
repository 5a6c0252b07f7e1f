"""`plan --explain`, `plan --yield`, beams in the printer's steps, and optimised spacing, as a user meets them."""

import json
import re
import subprocess
import sys
import tempfile
from dataclasses import asdict, replace

import pytest

import padgen as pg
from padgen.cli import run
from padgen.core.errors import InfeasibleError, as_lines
from padgen.core.files import json_text
from padgen.physics.schemes import in_order
from padgen.planner import explain, make_plan
from padgen.planner.cures import varied
from padgen.planner.explain import CapacityRow, _changes, _channels_held, _limits, explain_plan
from padgen.planner.print_yield import print_yield
from padgen.report.plans import explanation_text, plan_text, yield_text
from padgen.spec import load_spec, make_spec, parse_spec
from padgen.spec.load import laid_over, without_none

SCHEMES = in_order()
FOUR = (
    'name = "four"\nresolution = 16\nband_hz = [50, 400]\nq_min = 15\nprinter = "fdm-0.25"\n'
    "[pad]\nwidth_mm = 25\ndepth_mm = 25\nrib_mm = 0.6\n[coil]\ngrid = [2, 2]\n"
)


# Explaining


@pytest.fixture(scope="module")
def explained():
    spec = parse_spec(FOUR)
    plan = make_plan(spec)
    return spec, plan, explain_plan(plan)


def row_of(again, plan):
    """Return what a row says of a plan made anew, beside the plan that is explained."""
    coils = again.coils.rows * again.coils.columns
    prints = again.retuned_prints
    kept_db = [one.selectivity.kept_db for one in (again, plan)]
    gained_db = None if None in kept_db else kept_db[0] - kept_db[1]
    figures = prints.good_share, again.life.good_share, prints.print_db, gained_db
    return coils, len(again.sets[0]), again.selectivity.drive, *figures


def row_told(change):
    figures = change.good_share, change.life_share, change.print_db, change.gained_db
    return change.coils, change.channels, change.drive, *figures


def test_a_row_is_what_plan_makes_of_the_spec_with_its_lines(explained):
    spec, plan, explanation = explained
    specs = {as_lines(cure): varied(spec, cure) for _, cure in _changes(plan, spec)}
    changes = explanation.changes
    assert len(changes) >= 5
    for change in (changes[0], changes[len(changes) // 2], changes[-1]):
        again = make_plan(specs[change.change], tries_cures=False)
        assert row_told(change) == row_of(again, plan), change
        assert not [finding for finding in again.findings if finding.level == "error"]


@pytest.mark.soak
def test_a_row_is_of_the_layout_that_is_found_with_its_lines(monkeypatch):
    """Not of the one that was found without them: at Q = 10 every taxel has a coil of its own, at 15 two share one."""
    spec = parse_spec('name = "free"\nresolution = 16\nband_hz = [60, 400]\nq_min = 10\n')
    plan = make_plan(spec, tries_cures=False)
    (sharper,) = [item for item in _changes(plan, spec) if item[1] == {"q_min": 15.0}]
    monkeypatch.setattr(explain, "_changes", lambda plan, asked: [sharper])
    monkeypatch.setattr(explain, "MOVERS_COMPARED", ())
    explanation = explain_plan(plan, spec)
    (change,) = explanation.changes
    assert row_told(change) == row_of(make_plan(varied(spec, sharper[1]), tries_cures=False), plan)
    assert explanation.layout == (plan.coils.rows * plan.coils.columns, len(plan.sets[0]))
    assert (change.coils, change.channels) != explanation.layout
    assert change.cost == "other parts"


def test_a_row_of_a_part_that_touch_searches_gives_that_part():
    """A line that names a part takes it out of the search, as in a file; resonances and grids end the search."""
    spec = make_spec({"name": "felt", "resolution": 8, "band_hz": [60, 400], "q_min": 8, "touch": "fingertip"})
    assert spec.touch.search == "mover+coil+ballast+suspension+contactor+resonances"
    for cure, left in (
        ({"contactor.place": 0.5}, "mover+coil+ballast+suspension+resonances"),
        ({"washer": "iso7089-m2.5"}, "coil+ballast+suspension+contactor+resonances"),
        ({"coil": "air-10", "suspension.topology": "cantilever"}, "mover+ballast+contactor+resonances"),
        ({"q_min": 9.0}, "mover+coil+ballast+suspension+contactor+resonances"),
        ({"coil.grid": [2, 2]}, "none"),
        ({"resonances_hz": [100, 200]}, "none"),
    ):
        assert varied(spec, cure).touch.search == left
        written = make_spec(
            laid_over(
                {"name": "felt", "resolution": 8, "band_hz": [60, 400], "q_min": 8, "touch": "fingertip"},
                cure,
            )
        )
        assert written.touch.search == left


def test_one_more_than_held_does_not_hold(explained):
    spec, _, explanation = explained
    # There is no room for a fifth.
    assert (explanation.channels, explanation.drive) == (4, "biased")
    with pytest.raises(InfeasibleError):
        make_plan(replace(spec, resolution=4 * 5))
    narrow = replace(spec, band_hz=(50.0, 250.0))
    assert _channels_held(narrow, (2, 2), 4) == (3, "biased")
    limits = list(_limits(make_plan(narrow), 3, "biased"))
    assert any(limit.startswith("selectivity: 4 channels per coil with 'spread' spacing") for limit in limits)
    assert make_plan(narrow).selectivity.kept_db < 20


def test_a_line_of_the_spec_that_changes_beams_costs_another_print(explained):
    spec, plan, explanation = explained
    made = {as_lines(cure): varied(spec, cure) for _, cure in _changes(plan, spec)}
    costs = {change.change: change.cost for change in explanation.changes}
    spec_lines = [name for name, cost in costs.items() if cost == "a line of the spec"]
    for name in costs:
        if name.startswith(("suspension.", "spacing")):
            assert costs[name] == "another print"
    for name in spec_lines:
        again = make_plan(made[name], tries_cures=False)
        assert [channel.beam for channel in again.channels] == [channel.beam for channel in plan.channels]
    assert spec_lines


def test_one_more_channel_that_the_coil_does_not_pull_is_a_limit():
    plan = pg.plan("magnet-6")
    (limit,) = [limit for limit in _limits(plan, 6, "linear") if limit.startswith("pull: ")]
    assert limit.startswith("pull: of 7 magnets over a coil 2 ")


@pytest.mark.soak
def test_movers_for_a_pad_to_touch_keep_what_they_do_under_touch():
    plan = pg.plan("palm-24")
    row = explain._with_mover(plan.spec, "magnet", "disc-3x1", "air-10")
    # Untouched they keep 23 dB.
    assert row.print_db == pytest.approx(plan.touch.print_db, abs=3)


def test_a_count_may_hold_where_two_before_it_fail(monkeypatch):
    """All counts up to the planned one are tried; beyond it, two failures in a row end the search."""
    plan = make_plan(parse_spec(FOUR))
    holds = {1, 4, 9}

    def figures(spec, grid, count, optimise):
        return plan.selectivity if count in holds else None

    monkeypatch.setattr(explain, "_figures", figures)
    assert [_channels_held(plan.spec, (2, 2), least)[0] for least in (1, 2, 3, 4, 8, 9)] == [1, 1, 1, 4, 4, 9]


@pytest.mark.sample(1)
@pytest.mark.parametrize("resolution", [28, 32])
def test_naming_what_the_search_takes_changes_nothing(resolution):
    """A spec that names the found coil grid, reuse, gap and drive gets the same plan."""
    text = f'name = "own"\nresolution = {resolution}\nband_hz = [50, 200]\nq_min = 15\n'
    plan = make_plan(parse_spec(text))
    coils = plan.coils
    taken = plan.spec
    named = make_plan(
        parse_spec(
            f"{text}drive = '{taken.drive.scheme}'\n[coil]\ngrid = [{coils.rows}, {coils.columns}]\n"
            f"reuse = '{taken.coil.reuse}'\ngap_mm = {taken.coil.gap_mm}\n"
        )
    )
    assert named.taxels == plan.taxels
    assert named.selectivity.kept_db == pytest.approx(plan.selectivity.kept_db)


def test_optimised_spacing_is_tried(explained):
    _spec, plan, explanation = explained
    (change,) = [c for c in explanation.changes if c.change == "spacing = 'optimised'"]
    assert change.gained_db == pytest.approx(
        optimised(FOUR, "optimised").selectivity.kept_db - plan.selectivity.kept_db
    )
    assert change.gained_db > 1


def test_changes_are_ranked_by_what_prints_keep_then_by_what_they_buy(monkeypatch):
    """Of 18 dB, which prints of some changes keep."""
    plan = make_plan(parse_spec(FOUR.replace("[pad]", "delta_y = 8\n[pad]")), tries_cures=False)
    planned = _changes
    monkeypatch.setattr(explain, "_changes", lambda plan, asked: planned(plan, asked)[::2])
    monkeypatch.setattr(explain, "MOVERS_COMPARED", ())
    explanation = explain_plan(plan)
    changes = explanation.changes
    asked = plan.spec.print_share
    assert (explanation.good_share, explanation.print_db) == (plan.prints.good_share, plan.prints.print_db)
    assert plan.prints.good_share < asked
    works = [c.good_share >= asked for c in changes]
    assert any(works) and works == sorted(works, reverse=True)
    stages = explanation.stage_channels
    assert stages == tuple(sorted(stages)) and stages[0] < stages[-1] == plan.capacity.prints
    bought = [(-min(c.life_share, asked), c.coils) for c, good in zip(changes, works, strict=True) if good]
    assert bought == sorted(bought)
    lacking = [(-c.good_share, -(c.print_db or 0.0)) for c in changes[sum(works) :]]
    assert lacking == sorted(lacking)
    assert any(c.change.startswith("q_min = ") and c.gained_in_band > 0 for c in changes)


@pytest.mark.parametrize(
    ("figures", "helps"),
    [
        ({"good_share": 0.97}, True),  # more prints work
        ({"life_share": 0.5, "good_share": 0.8}, True),  # for life
        ({"good_share": 0.8, "gained_db": 3.0}, False),  # only perfect prints keep more
        ({"print_db": 21.0}, True),
        ({"coils": 8}, True),
        ({"coils": 8, "good_share": 0.8}, False),
        ({"coils": 20, "print_db": 25.0}, False),
        ({"gained_in_band": 1}, True),
        ({}, False),
    ],
)
def test_a_row_is_better_in_some_way_and_else_no_worse(figures, helps):
    """Of a pad of 16 coils of whose prints 95 % keep 20 dB today, and 20 % for life; 90 % are asked for."""
    now = explain._Printed(0.95, 0.2, 20.0)
    same = explain.Change("q_min = 20", explain.COSTS[0], 16, 2, "biased", 0.95, 0.2, 20.0, 0.0, 0)
    assert explain._helps(replace(same, **figures), now, 16, 0.9) == helps


def test_movers_are_ranked_for_the_same_pad(explained):
    """Those whose prints work come first, by heat; a row is what a plan of that mover says."""
    _, plan, explanation = explained
    rows = explanation.movers
    assert len(rows) == 4
    works = [(row.good_share or 0.0) >= plan.spec.print_share for row in rows]
    assert works == sorted(works, reverse=True)
    heat = [row.heat_w for row, good in zip(rows, works, strict=True) if good]
    assert heat == sorted(heat)
    (row,) = [row for row in rows if row.mover == "magnet disc-3x1"]
    table = without_none(asdict(plan.spec))
    for name in ("washer", "mover", "coil", "resonances_hz"):
        table.pop(name, None)
    table["drive"]["scheme"] = "auto"
    again = make_plan(make_spec(table | {"magnet": "disc-3x1", "coil": "air-10"}))
    coils = again.coils.rows * again.coils.columns
    assert (row.coils, row.heat_w) == (coils, again.load.copper_loss_w * coils)
    assert "magnet disc-3x1" in explanation_text(explanation)


def test_movers_whose_prints_work_come_first_then_the_coolest(monkeypatch):
    figures = iter([(3.0, 1.0), (None, None), (1.0, 0.5), (2.0, 0.95)])
    names = iter("abcd")

    def made(spec, kind, part, coil):
        heat_w, share = next(figures)
        return explain.MoverRow(next(names), coil, heat_w=heat_w, good_share=share)

    monkeypatch.setattr(explain, "_with_mover", made)
    assert [row.mover for row in explain._movers(parse_spec(FOUR))] == ["d", "a", "c", "b"]


def test_the_limit_that_binds_is_named():
    room = load_spec("quad-64")
    limits = list(_limits(make_plan(room), 4, "biased"))
    assert any(limit.startswith("pitch and washer: 5 channels per coil") for limit in limits)
    weak = parse_spec(FOUR + "[drive]\nlevel_um = 60\n")
    assert any(limit.startswith("copper loss: it allows") for limit in _limits(make_plan(weak), 4, "biased"))


def test_capacities_by_scheme_and_law(explained):
    rows = json.loads(json_text(explained[2]))["capacities"]
    rows = [CapacityRow(**row) for row in rows]
    assert {(row.scheme, row.level_law) for row in rows} == {(s, p) for s in SCHEMES for p in (0.0, 1.0, 2.0)}
    assert all(1 <= row.all_states <= row.one_hot for row in rows)
    text = explanation_text(explained[2])
    assert (
        "printed perfectly, 4 channels of a coil would keep what was asked (drive: biased); what stops one more:"
        in text
    )
    assert "time-shared  " in text


def test_explain_on_the_command_line(tmp_path, capsys, monkeypatch):
    planned = _changes
    monkeypatch.setattr(explain, "_changes", lambda plan, asked: planned(plan, asked)[:8])
    monkeypatch.setattr(explain, "MOVERS_COMPARED", explain.MOVERS_COMPARED[:1])
    assert run(["plan", "paper-32", "--explain", "--plot", "-o", str(tmp_path)]) == 0
    assert "explain" not in json.loads((tmp_path / "plan.json").read_text())
    out = " ".join(capsys.readouterr().out.split())  # lines may break anywhere
    assert (
        "1 channel of a coil would keep what was asked" in out
        and "keeps what was asked, untouched: 0.0% on channel 0, 0.0% on channel 1" in out
    )
    assert "plan.json plan.svg" in out and (tmp_path / "plan.svg").read_text().endswith("</svg>\n")


# Yield


def test_yield_on_the_command_line(tmp_path, capsys):
    def figures(*arguments):
        assert run(["plan", "paper-32", "--yield", "500", "--json", "-o", str(tmp_path), *arguments]) == 0
        return json.loads(capsys.readouterr().out)["yield"]

    first = figures()
    assert figures() == first
    assert figures("--seed", "1") != first
    assert json.loads((tmp_path / "yield.json").read_text())["pads"] == 500
    assert run(["plan", "paper-32", "-o", str(tmp_path)]) == 0
    assert (tmp_path / "yield.json").exists(), "the plan has not changed"


def test_a_yield_of_another_plan_is_taken_away(tmp_path, capsys):
    assert run(["plan", "paper-32", "--yield", "50", "-o", str(tmp_path)]) == 0
    assert run(["plan", "paper-16", "-o", str(tmp_path)]) == 0
    capsys.readouterr()
    assert not (tmp_path / "yield.json").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--yield", "0"], "--yield: must be 1 … 10000000 pads, got 0"),
        (["--yield", "99999999"], "--yield: must be 1 … 10000000 pads, got 99999999"),
        (["--yield", "5", "--seed", "-1"], "--seed: must be 0 or more, got -1"),
    ],
)
def test_bad_yields_are_refused(arguments, sentence, tmp_path, capsys):
    assert run(["plan", "paper-32", *arguments, "-o", str(tmp_path / "new")]) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_yield_text_says_what_costs_most(paper_plan):
    text = yield_text(print_yield(paper_plan, 200))
    assert "200 pads printed in the computer (seed 0)" in text
    # As planned, common height and each taxel's own thickness cost about alike.
    as_planned = r'with tones as planned, the error "thickness, (whole print|each taxel), mm" costs the most \w+'
    assert re.search(rf'{as_planned}.*\nre-tuned, the error "thickness, each taxel, mm" costs the most \w+', text)
    assert "so that hardly a pad can be good at 20.0 dB" in text


# Steps of the printer


def coarse(step_mm, extra=""):
    return make_plan(
        parse_spec(
            f'name = "lines"\nresolution = 32\nband_hz = [40, 400]\nq_min = 15\n{extra}'
            f'coil = {{ grid = [2, 4] }}\n[printer]\nname = "fdm-0.4"\nwidth_step_mm = {step_mm}\n'
        )
    )


@pytest.mark.parametrize("step_mm", [0.05, 0.2, 0.45])
def test_beams_are_whole_steps_wide(step_mm):
    plan = coarse(step_mm)
    for channel in plan.channels:
        steps = (channel.beam.width_mm - 0.45) / step_mm
        assert steps == pytest.approx(round(steps), abs=1e-6)
        layers = (channel.beam.thickness_mm - 0.2) / 0.1
        assert layers == pytest.approx(round(layers), abs=1e-6)
    # Nearest widths alone would cost 2 dB and more at whole lines; the re-fitted ladder has them back.
    assert plan.selectivity.snapping_db < 0.3
    assert plan.selectivity.all_states_db > 20


def test_resonances_are_those_of_the_beams_that_print():
    from padgen.planner.suspensions import BeamShape
    from padgen.planner.taxel_model import TaxelModel, plate_shape

    plan = coarse(0.45)
    for channel in plan.channels:
        beam = channel.beam
        spec = plan.spec
        shape = BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm)
        model = TaxelModel(spec, beam.topology, plate_shape(spec), shape)
        assert channel.resonance_hz == pytest.approx(float(model.resonance_hz))


def test_what_steps_cost_is_shown():
    """Explicit resonances may not be re-fitted: the nearest beams are taken, and their cost is stated in dB."""
    # Only the width may change, so whole lines come nowhere near.
    text = (
        'name = "pair"\nresolution = 32\nband_hz = [50, 200]\nq_min = 15\nresonances_hz = [56, 76]\n'
        '[coil]\ngrid = [4, 4]\n[suspension]\ntopology = "cantilever"\ntune = "width"\n[printer]\nname = "fdm-0.4"\n'
    )
    fine, steps = (make_plan(parse_spec(f"{text}width_step_mm = {step}\n")) for step in (0.001, 0.45))
    # Half a micrometre of a 0.6 mm beam is 0.04 % of its resonance; the pair loses 30 dB an octave: 0.02 dB.
    assert abs(fine.selectivity.snapping_db) < 0.02
    nearest = [c.beam.width_mm for c in steps.channels]
    assert nearest != [c.beam.width_mm for c in fine.channels]
    cost = fine.selectivity.all_states_db - steps.selectivity.all_states_db
    assert cost > 1
    assert steps.selectivity.snapping_db == pytest.approx(cost, abs=0.05)
    assert {"resonance.off", "selectivity.snapping"} <= {f.code for f in steps.findings}
    assert f"lost to the printer's resolution: {steps.selectivity.snapping_db:.2f} dB" in plan_text(steps)


# Optimised spacing

OWN_MASSES = """
name = "own2"
resolution = 12
band_hz = [69.5, 885]
q_min = 34
drive = {scheme="tones", level_law=2}
pad = {width_mm=100,depth_mm=100,border_mm=5,rib_mm=0.6}
coil = {grid=[2,2]}
"""


def optimised(text, spacing):
    table = asdict(parse_spec(text)) | {"spacing": spacing}
    return make_plan(make_spec(without_none(table)))


@pytest.mark.sample(2)
@pytest.mark.parametrize("scheme", ["spur-free", "time-shared", "tones", "auto"])
def test_optimised_spacing_is_no_worse(scheme):
    text = FOUR + f"[drive]\nscheme = '{scheme}'\n"
    spread, best = (optimised(text, spacing) for spacing in ("spread", "optimised"))
    key = "one_hot_db" if scheme == "time-shared" else "all_states_db"
    # The spread ladder leaves half a slot at the band's ends, which the optimised one uses.
    assert getattr(best.selectivity, key) >= getattr(spread.selectivity, key)
    if scheme == "tones":
        assert best.selectivity.all_states_db > spread.selectivity.all_states_db + 5
        figures = best.selectivity
        # The beams' masses are not equal.
        assert figures.all_states_db == pytest.approx(figures.optimum_db, abs=1.0)
        reached = f"were all taxels of one mass, the best resonances would reach {figures.optimum_db:.2f} dB"
        assert reached in plan_text(best)


def test_three_plain_tones_can_be_clean():
    """With optimised spacing the automatic drive keeps plain tones where their spurs can miss all channels."""
    text = FOUR.replace("resolution = 16", "resolution = 12").replace("[50, 400]", "[50, 800]")
    plan = optimised(text, "optimised")
    assert (len(plan.channels), plan.selectivity.drive) == (3, "tones")
    assert plan.selectivity.all_states_db >= 20


@pytest.mark.sample(3)
@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize("scheme", ["auto", "tones", "spur-free"])
def test_two_optimised_sets_stay_in_the_band(count, scheme):
    text = FOUR.replace("resolution = 16", f"resolution = {4 * count}")
    plan = optimised(f"{text}reuse = 'alternate'\n[drive]\nscheme = '{scheme}'\n", "optimised")
    assert len(plan.channels) == 2 * count
    assert "resonance.band" not in {f.code for f in plan.findings}


def test_coarse_steps_leave_the_optimum_in_the_band():
    coarse_text = FOUR.replace('printer = "fdm-0.25"\n', "").replace("[50, 400]", "[50, 800]").replace("= 16", "= 12")
    coarse_text += '[printer]\nname = "fdm-0.25"\nwidth_step_mm = 0.1\n'
    plan = optimised(coarse_text, "optimised")
    assert "resonance.band" not in {f.code for f in plan.findings}
    assert plan.selectivity.drive == "tones"


def test_optimised_keeps_the_spread_ladder_where_it_prints_better():
    """The optimum for equal masses can be worse than the even ladder where masses differ."""
    text = OWN_MASSES
    spread, best = (optimised(text, spacing) for spacing in ("spread", "optimised"))
    assert best.selectivity.all_states_db == pytest.approx(spread.selectivity.all_states_db)
    assert best.selectivity.all_states_db > best.selectivity.optimum_db


def test_planning_loads_no_optimiser():
    code = "import sys; from padgen.cli import run; run(['plan', 'paper-32', '-o', sys.argv[1]]); "
    code += "bad = [m for m in sys.modules if m.split('.')[0] == 'scipy' or m.endswith(('optimal_ladder', '_yield'))]; "
    code += "assert not bad, bad"
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-c", code, folder], check=True, capture_output=True)
