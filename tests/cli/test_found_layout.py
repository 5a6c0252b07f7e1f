"""A folder of results keeps the layout that a search found, from command to command and from version to version."""

import json

import padgen as pg
from padgen import cli

SEARCHED = """name = "found"
resolution = 16
band_hz = [50, 200]
q_min = 15
"""


def test_a_plan_whose_layout_was_searched_for_stays_as_it_is(tmp_path, capsys):
    """Neither are the files of a drive called old nor is its plan made anew, whichever command comes next."""
    spec = tmp_path / "found.toml"
    spec.write_text(SEARCHED)
    into = ["-o", str(tmp_path / "out")]
    assert cli.run(["plan", str(spec), *into]) == 0
    planned = (tmp_path / "out" / "plan.json").read_bytes()
    for command in ("drive", "plan", "drive"):
        assert cli.run([command, str(spec), *into]) == 0
        assert (tmp_path / "out" / "plan.json").read_bytes() == planned
        assert "earlier plan" not in capsys.readouterr().out
    assert (tmp_path / "out" / "drive.csv").exists()


def test_the_layout_of_another_version_is_kept(tmp_path):
    """As that of a pad that has been printed: its gap is the recorded one, though this version would take another."""
    spec = tmp_path / "found.toml"
    spec.write_text(SEARCHED)
    folder = tmp_path / "out"
    assert cli.run(["plan", str(spec), "-o", str(folder)]) == 0
    table = json.loads((folder / "plan.json").read_text())
    table["spec"]["coil"]["gap_mm"] = 0.8
    (folder / "plan.json").write_text(json.dumps(table))
    assert pg.read_spec(spec, folder=folder).coil.gap_mm is None
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"padgen": "0.14.0"}))
    assert pg.read_spec(spec, folder=folder).coil.gap_mm == 0.8
