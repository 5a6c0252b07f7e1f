"""Pictures show the plan's numbers at the plan's places, can be read, and come out the same each time.

| what is drawn | equals | within |
|---|---|---|
| bosses, washers, coils | places and diameters of the plan | 1e-9 mm |
| plastic at half the beams' thickness | a slice of the mesh that is built | 0.1 %: circles and fillets of few corners |
| the loudest OFF taxel's mark | `placed_one_hot_db` of the plan | 0.01 dB: modes that the plan leaves out |
"""

import json
from dataclasses import replace

import matplotlib
import numpy as np
import pytest

import padgen as pg
from padgen import cli
from padgen.core.display import plot_bytes
from padgen.core.errors import number
from padgen.planner import make_plan
from padgen.planner.layout import coil_axis_mm
from padgen.report.charts import picture
from padgen.report.figures import figures_of
from padgen.solid.mesh import as_manifold
from padgen.spec import parse_spec
from tests.conftest import SMALL
from tests.readable import assert_labels_point_into_their_parts, assert_readable


def polygons(axis, name):
    """Return the closed outlines (n, 2) of all artists of one name, in mm."""
    paths = [patch.get_path() for patch in axis.patches if patch.get_gid() == name]
    return [shape for path in paths for shape in path.to_polygons()]


def middles(shapes):
    return np.array([(shape.min(0) + shape.max(0)) / 2 for shape in shapes])


def area(shapes):
    """Return the sum of the areas by the shoelace formula."""
    return sum(abs(np.sum(s[:-1, 0] * s[1:, 1] - s[1:, 0] * s[:-1, 1])) / 2 for s in shapes)


def test_the_pad_is_drawn_where_the_plan_has_it_from_both_sides(paper_plan):
    figure = picture(paper_plan, "pad")
    (axis,) = figure.axes
    places = np.array([(taxel.x_mm, taxel.y_mm) for taxel in paper_plan.taxels])
    bosses, washers, frames = (polygons(axis, name) for name in ("boss", "washer", "frame"))
    assert middles(bosses) == pytest.approx(places, abs=1e-9)
    assert {round(float(np.ptp(shape[:, 0])), 9) for shape in bosses} == {paper_plan.plate.boss_diameter_mm}
    # From below, left and right change places; the second half of each washer is its bore.
    below = middles(washers[::2]) - middles(frames)[1]
    assert below == pytest.approx(places * (-1, 1), abs=1e-9)
    assert [float(np.ptp(shape[:, 1])) for shape in washers[:2]] == pytest.approx([3.5, 1.7])
    assert {"50", "62"} <= {text.get_text() for text in axis.texts}
    assert_readable(figure)


@pytest.mark.parametrize("topology", ["cantilever", "folded", "bridge", "serpentine-3"])
def test_the_drawn_plastic_is_that_of_the_built_pad(topology):
    plan = small_with(topology)
    height = min(plan.plate.recess_depth_mm, *(channel.beam.thickness_mm for channel in plan.channels)) / 2
    axis = picture(plan, "pad").axes[0]

    def plastic(name):
        both = polygons(axis, name)
        return area(both if name == "recess" else both[: len(both) // 2])  # the recesses show from below alone

    parts = {"frame": 1, "groove": -1, "hole": -1, "window": -1, "beam": 1, "plate": 1, "recess": -1}
    drawn = sum(sign * plastic(name) for name, sign in parts.items())
    built = as_manifold(pg.build(plan).mesh, "the pad").slice(height).area()
    assert drawn == pytest.approx(built, rel=1e-3)


def small_with(topology):
    text = SMALL.replace("[1, 1]", "[2, 2]").replace("= 25", "= 40")
    return make_plan(parse_spec(text + f'[suspension]\ntopology = "{topology}"\n'))


@pytest.mark.parametrize("topology", ["folded", "bridge", "serpentine-3"])
def test_sections_of_other_suspensions_can_be_read(topology):
    figure = picture(small_with(topology), "section")
    assert_readable(figure)
    assert_labels_point_into_their_parts(figure)


@pytest.mark.parametrize("coil", ["length_mm = 1", "core_diameter_mm = 0\ncore_relative_permeability = 1"])
def test_sections_of_odd_coils_can_be_read(coil):
    """A coil so flat that its notes are higher than the drawing, and one without a core."""
    figure = picture(
        make_plan(parse_spec(SMALL.replace("coil = { grid = [1, 1] }\n", "") + f"[coil]\ngrid = [1, 1]\n{coil}")),
        "section",
    )
    assert_readable(figure)
    assert_labels_point_into_their_parts(figure)


def test_the_section_has_the_plans_sizes(paper_plan):
    (axis,) = picture(paper_plan, "section").axes
    channel = paper_plan.channels[0]
    plate = paper_plan.plate
    spec = paper_plan.spec
    sizes = {
        name: np.ptp(np.vstack(polygons(axis, name)), axis=0)
        for name in ("beam", "boss", "washer", "coil", "core", "plate")
    }
    assert sizes["beam"] == pytest.approx((channel.beam.length_mm, channel.beam.thickness_mm), abs=0.01)
    assert sizes["boss"] == pytest.approx((plate.boss_diameter_mm, plate.boss_top_mm - plate.thickness_mm))
    assert sizes["plate"] == pytest.approx((plate.length_mm, plate.thickness_mm))
    assert sizes["washer"] == pytest.approx((spec.washer.outer_diameter_mm, spec.washer.thickness_mm))
    assert sizes["coil"] == pytest.approx((spec.coil.outer_diameter_mm, spec.coil.length_mm))
    assert sizes["core"][0] == pytest.approx(spec.coil.core_diameter_mm)
    washer, coil = (np.vstack(polygons(axis, name)) for name in ("washer", "coil"))
    assert washer[:, 1].min() - coil[:, 1].max() == pytest.approx(spec.coil.gap_mm)
    # Seen along the rows, the washer is off the coil's axis by as much as the plan's site says.
    off = washer[:, 0].mean() - (coil[:, 0].min() + coil[:, 0].max()) / 2
    assert abs(off) == pytest.approx(abs(channel.site.washer_mm[0]))
    told = {text.get_text() for text in axis.texts}
    assert {
        "beam 6.55 long",
        f"beam {number(channel.beam.width_mm)} wide",
        "beam 0.3 thick",
        "gap 1",
        "coil 10 high",
        "boss 2.5",
    } <= told


def test_the_stack_counts_all_parts(paper_plan):
    figure = picture(paper_plan, "exploded")
    told = {text.get_text() for text in figure.axes[0].texts}
    assert {"1 pad", "32 washers", "16 coils", "1 tray", "4 screws"} <= told
    assert_readable(figure)
    without = replace(
        paper_plan, spec=replace(paper_plan.spec, coil=replace(paper_plan.spec.coil, outer_diameter_mm=12.4))
    )
    told = {text.get_text() for text in picture(without, "exploded").axes[0].texts}
    assert "1 tray" not in told and "16 coils" in told, "coils too near for a tray"


def test_rectangular_coils_are_drawn_as_they_are():
    plan = pg.plan("fingertip-board-24")
    (coils,) = figures_of(plan, "wiring", "draw")[0].panels[0].marks
    assert (coils.diameter, coils.depth) == (12, 10.8)
    assert_readable(picture(plan, "wiring"))
    # Seen along the beam, which lies along y, the coil is as wide as it is deep.
    told = {text.get_text() for text in picture(plan, "section").axes[0].texts}
    assert any("copper, 12 across" in words or "copper, 10.8 across" in words for words in told)


def test_the_wiring_follows_the_channels_of_the_file(paper_plan):
    figure = picture(paper_plan, "wiring")
    assert_readable(figure)
    (axis,) = figure.axes
    numbered = [text for text in axis.texts if text.get_text().isdigit()]
    assert [int(text.get_text()) for text in numbered] == [*range(1, 17)] * 2
    coils = middles(polygons(axis, "winding"))
    grid = np.array([coil_axis_mm(paper_plan.coils, *divmod(k, 4)) for k in range(16)])
    assert coils[:16] == pytest.approx(grid, abs=1e-9)
    across = middles(polygons(axis, "frame"))[1]
    assert coils[16:] == pytest.approx(grid * (-1, 1) + across, abs=1e-9)
    assert np.array([text.get_position() for text in numbered])[:, 0] == pytest.approx(coils[:, 0])
    # The groove is beside row 0, column 0 from both sides.
    for side, groove in zip((coils[:16], coils[16:]), middles(polygons(axis, "groove")), strict=True):
        assert np.hypot(*(side - groove).T).argmin() == 0


def test_the_marks_are_what_the_plan_says_of_off_taxels(paper_plan):
    top, bottom = picture(paper_plan, "responses").axes
    (marks,) = top.collections
    assert np.asarray(marks.get_offsets())[:, 1].max() == pytest.approx(
        -paper_plan.selectivity.placed_one_hot_db, abs=0.01
    )
    resonances = [c.resonance_hz for c in paper_plan.channels]
    assert np.asarray(marks.get_offsets())[:, 0] == pytest.approx(resonances)
    for curve, hz in zip(top.lines, resonances, strict=False):
        at, level = curve.get_data()
        assert level[at == hz] == pytest.approx(0.0, abs=1e-9), "a taxel's own tone moves it by its ON level"
    tones, spurs = (lines.get_segments() for lines in bottom.collections)
    assert sorted(line[0, 0] for line in tones) == pytest.approx(resonances)
    low, high = resonances
    assert sorted(line[0, 0] for line in spurs) == pytest.approx([(high - low) / 2, (high + low) / 2])
    # A sum or difference of two tones is 2 √(F_a F_b) strong (docs/driving.md).
    assert spurs[0][1, 1] == pytest.approx(6.02 + np.mean([line[1, 1] for line in tones]), abs=0.01)


def test_the_heat_map_has_the_plans_table(paper_plan):
    axis = picture(paper_plan, "selectivity").axes[0]
    table = np.array(paper_plan.selectivity.matrix_db[0])
    shown = axis.images[0].get_array()
    assert shown.mask.tolist() == np.eye(2, dtype=bool).tolist()
    assert shown.data == pytest.approx(table)
    assert [text.get_text() for text in axis.texts] == ["ON", "19.4", "19.4", "ON"]
    assert len(axis.patches) == 2, "both are below the 20 dB that are asked"
    # Where a plan lists no table: with each washer's own pull, which here moves both by 0.21 dB, up and down.
    many = replace(paper_plan, selectivity=replace(paper_plan.selectivity, matrix_db=()))
    shown = picture(many, "selectivity").axes[0].images[0].get_array()
    assert shown.data == pytest.approx(table, abs=0.25)
    assert shown.sum() == pytest.approx(table.sum(), abs=1e-3)


def test_the_ladder_and_the_map_of_prints(paper_plan):
    """Each coil's share stands in its cell, its lower left corner where the grid has it, and colours it."""
    shares = (*[1.0] * 6, 0.975, *[0.0] * 9)
    plan = replace(paper_plan, prints=replace(paper_plan.prints, coil_shares=shares))
    pad, ladder, _ = plan.plot().axes
    resonances = [c.resonance_hz for c in plan.channels]
    assert ladder.lines[0].get_xdata() == pytest.approx(resonances)
    half = 10 / (4 * 15)  # Δy/4Q
    assert [bar.get_x() for bar in ladder.patches] == pytest.approx([hz * (1 - half) for hz in resonances])
    marked = {text.get_text(): text.xy for text in pad.texts}
    assert marked["97.5 %"] == pytest.approx((0.0, -12.5)), "row 1, column 2 of four, 12.5 mm apart"
    cells, bosses = pad.collections
    fills = cells.get_facecolor()
    white = fills[0]
    least = fills[-1]
    assert white == pytest.approx((1, 1, 1, 1))
    # 256 steps of colour.
    assert fills[6] == pytest.approx(0.75 * white + 0.25 * least, abs=1 / 256)
    places = [path.get_extents() for path in bosses.get_paths()]
    centres = np.array([((box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2) for box in places])
    assert centres == pytest.approx(np.array([(taxel.x_mm, taxel.y_mm) for taxel in plan.taxels]))


def test_a_picture_is_the_same_whatever_style_the_user_has_set(small_plan):
    for name, kind in (("section", "svg"), ("prints", "png")):
        first = plot_bytes(picture(small_plan, name), kind)
        with matplotlib.rc_context({"font.size": 20, "axes.grid": True, "savefig.bbox": "tight"}):
            assert plot_bytes(picture(small_plan, name), kind) == first
        assert b"tiny: " in first, "the title is in the file's metadata"


@pytest.mark.parametrize("name", [r"$\frac$", "<script>", "a" * 80])
def test_a_name_is_text_and_no_formula(small_plan, name):
    data = plot_bytes(picture(replace(small_plan, name=name), "ladder"), "svg").decode()
    assert "<script>" not in data


def test_there_is_no_such_picture(paper_plan, tmp_path, monkeypatch, capsys):
    with pytest.raises(pg.SpecError, match=r"there is no picture 'secton'; did you mean 'section'\?"):
        paper_plan.plot("secton")
    monkeypatch.chdir(tmp_path)
    for option, value, told in (
        ("--only", "secton", "did you mean 'section'?"),
        ("--only", ",", "must name one or more of pad, section, "),
        ("--format", "pdf", "must be among svg, png, got 'pdf'"),
    ):
        assert cli.run(["draw", "paper-32", option, value]) == 2
        assert told in capsys.readouterr().err
    assert not list(tmp_path.iterdir()), "nothing is written"


def test_draw_writes_the_pictures_that_were_asked_for(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(SMALL)
    assert cli.run(["draw", "tiny.toml", "--only", "wiring,section", "--format", "svg", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == {"name": "tiny", "folder": "out/tiny/pictures", "files": ["section.svg", "wiring.svg"]}
    files = {path.name for path in (tmp_path / "out/tiny/pictures").iterdir()}
    assert files == {*told["files"], "manifest.json"}
    assert pg.draw("tiny.toml", "again", only=["section"], formats=["svg"]) == ("section.svg",)
    assert (tmp_path / "again/section.svg").read_bytes() == (tmp_path / "out/tiny/pictures/section.svg").read_bytes()
    with pytest.raises(pg.SpecError, match="did you mean 'section'"):
        pg.draw("tiny.toml", "other", only=["secton"])
    assert not (tmp_path / "other").exists()


def test_the_stack_shows_a_board_and_the_ballast():
    plan = pg.plan("fingertip-board-24")
    figure = picture(plan, "exploded")
    assert_readable(figure)
    told = " ".join(text.get_text() for text in figure.axes[0].texts)
    for words in ("1 board", "24 magnets", "24 steel-rod-4x2", "12 coils", "4 spacers"):
        assert words in told
    figure = picture(plan, "section")
    assert_readable(figure)
    assert "ballast" in {text.get_text() for text in figure.axes[0].texts}
