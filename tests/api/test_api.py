"""The public names of `import padgen`: they write the same files as the commands, and importing them stays light."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import padgen as pg
from padgen import cli
from padgen.core.errors import SpecError
from tests.conftest import SMALL

ROOT = Path(pg.__file__).parent


def run(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture
def work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(SMALL)
    return tmp_path


def test_importing_is_light():
    """Neither numpy nor any room is loaded before a name is touched."""
    loaded = run("import sys, padgen; print(*sorted(m for m in sys.modules if m.startswith(('padgen.', 'numpy'))))")
    assert loaded == ""
    assert run("import sys, padgen; padgen.Finding; print('numpy' in sys.modules)") == "False"


def test_every_name_resolves_and_none_is_a_module():
    rooms = {path.stem for path in ROOT.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert not rooms & set(pg.__all__)
    assert sorted(pg.__all__) == sorted(dir(pg))
    for name in pg.__all__:
        assert getattr(pg, name).__class__ is not type(pg), name
    with pytest.raises(AttributeError, match="no attribute 'plam'"):
        _ = pg.plam


def test_public_docstrings_say_what_comes_in_and_out():
    for name in ("plan", "build", "check", "drive", "retune", "study", "sweep"):
        text = getattr(pg, name).__doc__
        assert all(section in text for section in ("Parameters\n", "Returns\n", "Raises\n")), name


def test_a_spec_from_anything(work):
    table = {
        "name": "tiny",
        "resolution": 4,
        "band_hz": [50, 200],
        "q_min": 15,
        "coil": {"grid": [1, 1]},
        "pad": {"width_mm": 25, "depth_mm": 25},
    }
    by_path = pg.plan("tiny.toml")
    by_table = pg.plan(table)
    assert by_path == by_table == pg.plan(Path("tiny.toml")) == pg.plan(by_path.spec)
    assert pg.plan("tiny.toml", q_min=20).channels[0].q == 20
    changed = pg.plan(by_path.spec, coil={"gap_mm": 1.5}, drive="biased").spec
    assert (changed.coil.gap_mm, changed.drive.scheme) == (1.5, "biased")
    assert changed.coil.turns == by_path.spec.coil.turns
    with pytest.raises(SpecError, match="q_mim"):
        pg.plan("tiny.toml", q_mim=20)
    with pytest.raises(SpecError, match="must be a template, a path, tables or a Spec, got int"):
        pg.plan(7)


def test_a_plan_shows_itself_in_one_line_and_in_notebooks(paper_plan):
    assert len(repr(paper_plan)) < 120 and "32 taxels" in repr(paper_plan)
    html = paper_plan._repr_html_()
    assert html.count("<tr>") == 1 + len(paper_plan.channels) and "<svg" in html and "56 Hz" in html


def test_build_writes_what_the_command_writes(work):
    assert cli.run(["build", "tiny.toml", "--formats", "stl,3mf", "-o", "a"]) == 0
    pad = pg.build("tiny.toml")
    assert repr(pad) == "<Pad tiny: 4 taxels>"
    built = pad.save("b", formats=["stl", "3mf"])
    assert {p.name: p.read_bytes() for p in Path("a").iterdir()} == {
        p.name: p.read_bytes() for p in Path("b").iterdir()
    }
    assert not built.up_to_date and pad.save("b", formats=["stl", "3mf"]).up_to_date
    assert pg.build("tiny.toml").save("b", formats=["stl", "3mf"]).up_to_date
    assert pad.check().findings == () and pad.mesh.vertices_mm.shape[1] == 3
    assert "compared_with" in pg.check("b/pad.stl", "tiny.toml").figures


def test_a_changed_plan_is_built_though_its_spec_is_the_same(work):
    from dataclasses import replace

    plan = pg.plan("tiny.toml")
    pg.build(plan).save("b", formats=["stl"])
    assert pg.build(plan).save("b", formats=["stl"]).up_to_date
    first = replace(plan.channels[0], level_um=plan.channels[0].level_um * 2)
    other = replace(plan, channels=(first, *plan.channels[1:]))
    assert not pg.build(other).save("b", formats=["stl"]).up_to_date
    assert pg.read_plan("b/plan.json").channels[0].level_um == first.level_um


def test_drive_writes_a_file_or_a_folder(work):
    plan = pg.plan("paper-pair")
    (work / "on.txt").write_text("1 0 0 0\n" * 8)
    shown = pg.drive(plan, frames="on.txt")
    assert shown.save("drive.wav").files == ("drive.wav",)
    assert sorted(p.name for p in work.iterdir()) == ["drive.wav", "on.txt", "tiny.toml"]
    assert repr(shown) == "<Drive paper-pair: 1 frames, tones>"
    levels = shown.frames
    folder = pg.drive(plan, frames=levels[0]).save("d", formats=["wav"])
    assert (work / "d/drive.wav").read_bytes() == (work / "drive.wav").read_bytes()
    assert "drive-wave.json" in folder.files
    with pytest.raises(SpecError, match="levels in 0"):
        pg.drive(plan, frames=2 * levels)
    with pytest.raises(SpecError, match="not both"):
        pg.drive(plan, state="10", frames=levels)
    with pytest.raises(SpecError, match="mp3"):
        pg.drive(plan, state="10").save("drive.mp3")


def test_retune_and_drive_a_print(work):
    assert cli.run(["retune", "tiny.toml", "--simulate", "3", "-o", "r"]) in (0, 1)
    plan = pg.plan("tiny.toml")
    result = pg.retune(plan, "r/measured.csv")
    assert result.tuning == pg.retune(plan, "r/measured.csv").tuning
    read = pg.read_tuning("r/tuning.json", plan)
    hz = [taxel.resonance_hz for taxel in result.tuning.taxels]
    assert [taxel.resonance_hz for taxel in read.taxels] == pytest.approx(hz, rel=1e-9)  # ten digits in the file
    assert pg.drive(plan, state="1000", tuning="r/tuning.json").tuning == read


def test_a_sweep_is_a_table(work):
    swept = pg.sweep("tiny.toml", q_min=[15, 20], coil={"gap_mm": (1.0, 1.5, 2.0)}, workers=1)
    rows = swept.table()
    assert [(row["q_min"], row["coil.gap_mm"]) for row in rows] == [(q, g) for q in (15, 20) for g in (1.0, 1.5, 2.0)]
    assert swept.counts == {"done": 6} and "6 done" in repr(swept)
    assert rows[3]["selectivity_db"] == pytest.approx(pg.plan("tiny.toml", q_min=20).selectivity.kept_db, rel=1e-9)
    assert sorted(p.name for p in work.iterdir()) == ["tiny.toml"]  # nothing is left behind
    with pytest.raises(SpecError, match="needs a folder"):
        pg.sweep("tiny.toml", stage="build", q_min=[15])


def test_all_stages_use_the_model_that_the_plan_records(work, monkeypatch):
    """Builds and drives follow a plan by solids with solids, unless the spec or the command names a model."""
    from padgen.make import solid_tuning
    from padgen.planner import make_plan

    asked = []
    monkeypatch.setattr(solid_tuning, "plan_tuned_to_solid", lambda spec, _: asked.append(spec) or make_plan(spec))
    assert cli.run(["plan", "tiny.toml"]) == 0
    assert cli.run(["build", "tiny.toml", "--formats", "stl"]) == 0
    assert not asked
    assert cli.run(["plan", "tiny.toml", "--model", "solid"]) == 0
    for command in (["build", "tiny.toml", "--formats", "stl"], ["drive", "tiny.toml"]):
        assert cli.run(command) == 0
    assert [spec.model.structure for spec in asked] == ["solid"] * 3
    assert cli.run(["drive", "tiny.toml", "--model", "beam"]) == 0 and len(asked) == 3
    assert json.loads(Path("out/tiny/plan.json").read_text())["spec"]["model"]["structure"] == "beam"


def test_no_plan_solves_what_nobody_asked_for(work, monkeypatch):
    from padgen.make import solid_tuning

    monkeypatch.setattr(solid_tuning, "plan_tuned_to_solid", lambda *_: pytest.fail("nobody asked"))
    (work / "tight.toml").write_text(SMALL + "[model]\ntolerance = 1e-4\n")
    plan = pg.plan("tight.toml")
    assert "model.error" in {finding.code for finding in plan.findings}
    assert cli.run(["build", "tight.toml", "--formats", "stl"]) in (0, 1)


def test_nobody_but_planning_decides_which_model_plans():
    """`make_plan` and the tuned plan are called in only one module above the planner."""
    callers = set()
    for path in ROOT.rglob("*.py"):
        if path.relative_to(ROOT).parts[0] in ("planner",):
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("make_plan", "plan_tuned_to_solid"):
                callers.add(str(path.relative_to(ROOT)))
    assert callers == {"make/planning.py"}
