"""The verdict on a pad, judged again from plan.json alone by a program that knows nothing of the planner."""

import json
import random
from dataclasses import replace
from html import unescape

import pytest

import padgen as pg
from padgen import cli
from padgen.core.errors import PadgenError, Verdict
from padgen.planner import plan_to_json
from padgen.planner.verdict import with_verdict
from padgen.report.plans import plan_html
from padgen.spec import template_paths
from tests.conftest import FOUR_LINES, SMALL
from tests.judge_from_json import broken_limits, judged_level

FEW = 12
MANY = 300
"""Random pads in every run of the tests, on a grid that is quickly searched, and with ``-m soak``."""


def random_table(draw: random.Random, is_quick: bool) -> dict:
    """Return the tables of a spec with a coil, a gap or an amplifier of its own; three in ten burn or cannot be fed."""
    low_hz = draw.uniform(40, 150)
    side_mm = draw.uniform(30, 70)
    table = {
        "name": "random",
        "resolution": draw.choice([4, 8, 16, 24, 32]),
        "band_hz": [low_hz, low_hz * draw.uniform(2, 8)],
        "q_min": draw.uniform(8, 40),
        "delta_y": draw.choice([3, 10, 30]),
        "printer": draw.choice(["fdm-0.4", "fdm-0.25", "resin-0.05"]),
        "pad": {"width_mm": side_mm, "depth_mm": side_mm},
        "drive": {"level_um": draw.choice([2.0, 5.0, 10.0, 30.0])},
    }
    kind = draw.randrange(10)
    if kind < 5:
        turns = draw.choice([100, 300, 1000])
        table["coil"] = {
            "resistance_ohm": draw.uniform(4, 80),
            "inductance_mh": draw.uniform(0.05, 40),
            "turns": turns,
            "power_limit_w": draw.choice([0.1, 0.5, 2.0]),
        }
    if kind in (2, 3, 4, 5, 6):
        table.setdefault("coil", {})["gap_mm"] = draw.choice([0.3, 0.6, 1.0, 2.0])
    if kind in (4, 7):
        table["limits"] = {"power_w": draw.choice([0.2, 1.0, 5.0])}
    if kind in (6, 8):
        table["drive"]["voltage_limit_v"] = draw.choice([1.0, 5.0, 12.0])
    if draw.random() < 0.2:
        table["drive"]["least_frames_per_s"] = draw.choice([2.0, 5.0, 20.0])
    if draw.random() < 0.4:
        table["mount"] = {"kind": draw.choice(["resting", "foam", "screwed", "glued"])}
        if table["mount"]["kind"] != "screwed" and draw.random() < 0.5:
            table["mount"]["base_mass_g"] = draw.choice([20.0, 200.0, 2000.0])
    if is_quick:
        table |= {"resolution": 8, "printer": "fdm-0.4"}
        table.setdefault("coil", {})["grid"] = [2, 2]
    return table


def random_pads(count: int, is_quick: bool) -> list:
    """Return so many plans of random specs, each with the table of its plan.json."""
    draw = random.Random(31)
    found = []
    while len(found) < count:
        try:
            plan = pg.plan(random_table(draw, is_quick))
        except PadgenError:
            continue
        found.append((plan, json.loads(plan_to_json(plan))))
    return found


@pytest.fixture(scope="module")
def pads():
    return random_pads(FEW, is_quick=True)


def wrong_verdicts(pads) -> list[str]:
    """Return a line for each pad whose verdict is not what its figures say."""
    return [
        f"{table['verdict']['level']} is {judged_level(table)}: {broken_limits(table)}"
        for _, table in pads
        if table["verdict"]["level"] != judged_level(table)
    ]


@pytest.mark.soak
def test_verdicts_of_random_pads_are_what_their_figures_say(pads):
    assert not wrong_verdicts(pads)
    assert len({table["verdict"]["level"] for _, table in pads}) > 2


@pytest.mark.soak
def test_verdicts_of_many_random_pads_are_what_their_figures_say():
    assert not wrong_verdicts(random_pads(MANY, is_quick=False))


def test_a_wrong_verdict_is_caught(pads):
    plan, table = next(pair for pair in pads if pair[1]["verdict"]["level"] == "error")
    works = {**table["verdict"], "level": "good"}
    assert len(wrong_verdicts([*pads, (plan, {**table, "verdict": works})])) == 1


def test_a_verdict_says_its_figure_and_what_decides(pads):
    for plan, table in pads:
        verdict = plan.verdict
        assert verdict.sentence.startswith(f"{plan.name} ") and verdict.sentence.endswith(".")
        assert verdict.limit in {"", *(finding.code for finding in plan.findings)}
        if verdict.level == "error":
            assert verdict.figure_db is None and not verdict.is_worth_printing
            assert next(f.code for f in plan.findings if f.level == "error") == verdict.limit
        elif verdict.figure_db is not None:
            assert f"{abs(verdict.figure_db):.1f} dB" in verdict.sentence
            assert "untouched" in verdict.sentence
            assert table["verdict"]["figure_db"] == pytest.approx(verdict.figure_db, rel=1e-9)


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", sorted(template_paths()))
def test_a_template_says_what_a_finger_does(name):
    plan = pg.plan(name)
    typical = next(touched for touched in plan.touched if touched.skin == "typical")
    assert f"instead of {plan.channels[0].resonance_hz:.0f} Hz" in plan.verdict.touched
    kept_db = typical.all_states_db
    assert (kept_db is None) == (len(plan.sets[0]) == 1)
    if kept_db is not None:
        word = "less" if kept_db >= 0 else "more"
        assert f"OFF taxels vibrate {abs(kept_db):.1f} dB {word} than ON ones" in plan.verdict.touched
        assert ("does not choose its taxels" in plan.verdict.touched) == (kept_db <= 0)


def test_every_output_shows_the_same_verdict(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(FOUR_LINES + "coil = { grid = [2, 2] }\n")
    plan = pg.plan("tiny.toml")
    told = {}
    for command in ("plan", "build", "build", "drive", "report"):
        assert cli.run([command, "tiny.toml"]) == 0
        told[command] = " ".join(capsys.readouterr().out.split())
    tables = {}
    for command in ("plan", "build", "drive", "report"):
        cli.run([command, "tiny.toml", "--json"])
        tables[command] = json.loads(capsys.readouterr().out)["verdict"]
    for command, text in told.items():
        assert " ".join(plan.verdict.sentence.split()) in text, command
        assert text.startswith(plan.name if command != "drive" else f"The drive of {plan.name} is written")
        assert plan.verdict.touched in text
    assert all(table == tables["plan"] for table in tables.values())
    assert tables["plan"]["sentence"] == plan.verdict.sentence
    page = unescape(plan_html(plan))
    assert plan.verdict.sentence in page and plan.verdict.touched in page


def test_only_a_pad_that_works_is_to_be_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    asked = {"works": "delta_y = 1.2\n", "falls short": "delta_y = 10\n", "does not work": "delta_y = 1.2\n"}
    for words, extra in asked.items():
        limits = "[limits]\npower_w = 0.01\n" if words == "does not work" else ""
        (tmp_path / "tiny.toml").write_text(extra + SMALL + limits)
        assert cli.run(["build", "tiny.toml"]) == (words == "does not work")
        told = capsys.readouterr().out
        assert told.startswith(f"tiny {words}")
        assert ("next: print and assemble it" in told) == (words == "works")


def test_the_deepest_cause_of_a_shortfall_is_named(paper_plan):
    prints = replace(paper_plan.prints, planned_db=1.0, print_db=2.0, good_share=0.1)
    short = with_verdict(replace(paper_plan, prints=prints), paper_plan.findings)
    assert (short.verdict.level, short.verdict.limit) == ("short", "selectivity.all_states")


def test_a_verdict_of_an_unknown_level_is_refused():
    with pytest.raises(ValueError, match="must be one of"):
        Verdict("fine", "", "", "", "", None)
