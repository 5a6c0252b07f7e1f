"""Figures are data: each renderer shows the same numbers, also of figures that padgen does not know.

| what is drawn | equals | within |
|---|---|---|
| matplotlib's marks, curves and bars | the figure's | 1e-9 of the value: the same floats |
| places in the SVG of notebooks | the figure's | 0.051 px, far ends 0.11 px: written with one decimal |
| places on the page | the figure's | 0.01 px: numbers of seven digits |
| lines of i² of the motion | the squared current, fitted | 1e-6 of the strongest line |
| motion under a line | the sum over modes, term by term | 1e-9 of the level |
| what the page moves | that motion, summed over a state's lines | 1e-5 of the level: 32-bit floats |
"""

import base64
import json
import os
import re
import subprocess
import sys
from contextlib import contextmanager
from math import log
from types import SimpleNamespace

import numpy as np
import pytest

import padgen as pg
from padgen.core.errors import SpecError
from padgen.physics.schemes import bias_a, current_lines_a
from padgen.planner.channels import coil_modes
from padgen.report import figures
from padgen.report.charts import picture, picture_names
from padgen.report.figures import (
    MEDIA,
    Bars,
    Curves,
    Discs,
    Facts,
    Figure,
    Line,
    Matrix,
    Panel,
    Points,
    RowLabel,
    Rows,
    Scale,
    Shape,
    Stems,
    figure_names,
    figures_of,
    page_figures,
)
from padgen.report.inline_svg import svg
from padgen.report.motion import coil_lines, line_motion
from padgen.report.page import page_html
from tests.conftest import SMALL
from tests.report.test_page import browser, opened, whole

__all__ = ["browser", "opened"]

MASS = Scale("mass <g>", "g", 1.0, 10.0, is_log=True)
PART = Scale("part", "", -0.6, 1.6, short="no.")
AGE = Scale("age", "days", 0.0, 8.0)
LINES = (Line("limit", 9.0, "too heavy"),)
TOYS = {
    "rows": Panel(
        MASS,
        PART,
        (
            Rows(
                *("set-1", "range", "mass", "± 1 sigma"),
                (0.0, 1.0),
                (2.0, 8.0),
                ((1.5, 3.0), (7.0, 9.5)),
                (0.1, 0.2),
            ),
        ),
        LINES,
        row_labels=(RowLabel(0.0, "a", "2 g"), RowLabel(1.0, "b", "8 g")),
    ),
    "curves": Panel(
        MASS,
        AGE,
        (
            Curves(
                np.array([1.0, 2.0, 10.0]),
                np.array([[0.5, 4.0, 8.0], [8.0, 2.0, 1.0]]),
                ("channel-0", "set-1"),
                ("young", "old"),
                ("y", "o"),
            ),
        ),
        LINES,
    ),
    "bars": Panel(
        MASS,
        AGE,
        (Bars("planned", "before", (1.0, 2.0, 4.0), (3, 7)), Bars("set-0", "after", (4.0, 8.0), (5,))),
        LINES,
    ),
    "stems": Panel(MASS, AGE, (Stems("tone", "lines", (2.0, 5.0), (3.0, 6.0)),), LINES),
    "points": Panel(MASS, AGE, (), LINES, (Points("found", "X", (2.0, 5.0), (3.0, 6.0), ("spur", "channel-1")),)),
    "discs": Panel(
        Scale("x", "mm", -20.0, 30.0),
        Scale("y", "mm", -10.0, 15.0),
        (Discs("coil", "copper", "coin", (0.0, 12.0), (-3.0, 8.0), 7.0, ("1", "2"), ("left", "right"), "coins"),),
        shapes=(Shape("plate", "table", ((-20.0, -10.0), (30.0, -10.0), (30.0, 15.0)), "a corner"),),
    ),
    "matrix": Panel(
        PART, PART, (Matrix("dB", ("a", "b"), ((0.0, 12.5), (3.0, 0.0)), Scale("", "dB", 0.0, 20.0), 6.0),)
    ),
}
"""A figure of each kind of marks, none of which has to do with resonances."""


def toy(kind):
    """Return the file of a figure: what a module of that name would have."""

    def make(plan, quick):
        facts = Facts("masses", (("a", "2 g"), ("b", "8 g")))
        return (Figure(f"{kind} of masses", f"{kind} <read out>", (TOYS[kind],), channels=2, facts=facts),)

    return SimpleNamespace(
        TITLE=f"Masses <{kind}>", CAPTION="Of parts.", SHOWN_IN=("draw", "page", "notebook"), make=make
    )


@contextmanager
def registered(**kinds):
    for name, kind in kinds.items():
        figures.register(name, kind)
    try:
        yield
    finally:
        for name in kinds:
            figures.unregister(name)


@pytest.fixture
def toys():
    with registered(**{f"toy{kind}": toy(kind) for kind in TOYS}):
        yield


def px(value, scale, first, last):
    """Return where a value is between the ends of an axis, worked out here anew."""
    at = log if scale.is_log else float
    return first + (last - first) * (at(value) - at(scale.low)) / (at(scale.high) - at(scale.low))


def numbers(pattern, text):
    return [tuple(map(float, found.groups())) for found in re.finditer(pattern, text)]


def test_matplotlib_draws_what_figures_say(toys, paper_plan):
    (rows,) = TOYS["rows"].marks
    axis = picture(paper_plan, "toyrows").axes[0]
    drawn = [at for bars in axis.containers if hasattr(bars, "lines") for at in bars.lines[0].get_xdata()]
    assert drawn == pytest.approx(rows.marks, rel=1e-9)
    assert [(bar.get_x(), bar.get_x() + bar.get_width()) for bar in axis.patches] == [
        pytest.approx(span, rel=1e-9) for span in rows.spans
    ]
    assert [text.get_text() for text in axis.get_yticklabels()] == ["a:  2 g", "b:  8 g"]
    (curves,) = TOYS["curves"].marks
    axis = picture(paper_plan, "toycurves").axes[0]
    for line, y in zip(axis.lines, curves.y, strict=False):
        assert np.array_equal(line.get_data(), (curves.x, y))
    assert [text.get_text() for text in axis.get_legend().get_texts()] == ["young", "old", "too heavy"]
    axis = picture(paper_plan, "toybars").axes[0]
    assert [(bar.get_x(), bar.get_width(), bar.get_height()) for bar in axis.patches] == [
        (1, 1, 3),
        (2, 2, 7),
        (4, 4, 5),
    ]
    axis = picture(paper_plan, "toystems").axes[0]
    assert [segment.tolist() for segment in axis.collections[0].get_segments()] == [[[2, 0], [2, 3]], [[5, 0], [5, 6]]]
    axis = picture(paper_plan, "toypoints").axes[0]
    assert axis.collections[0].get_offsets().tolist() == [[2, 3], [5, 6]]
    axis = picture(paper_plan, "toymatrix").axes[0]
    assert [text.get_text() for text in axis.texts] == ["ON", "12.5", "3.0", "ON"]
    assert len(axis.patches) == 1, "one of the two is below the 6 dB that are asked"
    axis = picture(paper_plan, "toydiscs").axes[0]
    table, *coins = axis.patches
    assert (table.get_gid(), [coin.get_gid() for coin in coins]) == ("table", ["coin", "coin"])
    assert table.get_path().vertices[:3].tolist() == [[-20, -10], [30, -10], [30, 15]]
    boxes = [coin.get_path().get_extents().bounds for coin in coins]
    assert boxes == [pytest.approx(box) for box in ((-3.5, -6.5, 7, 7), (8.5, 4.5, 7, 7))]
    assert {"1", "2", "left", "right", "coins"} <= {text.get_text() for text in axis.texts}
    for kind in set(TOYS) - {"matrix", "discs"}:
        axis = picture(paper_plan, f"toy{kind}").axes[0]
        across = [line.get_xdata()[0] for line in axis.lines if line.get_linestyle() == ":"]
        assert across == [9.0]
        assert (axis.get_xlabel(), axis.get_xlim(), axis.get_xscale()) == ("mass <g>, g", (1, 10), "log")


def test_notebooks_show_what_figures_say(toys, paper_plan):
    text = paper_plan._repr_html_()
    (rows,) = TOYS["rows"].marks
    drawn = {
        kind: re.search(f'<svg role="img" aria-label="{kind} &lt;read out&gt;".*?</svg>', text)[0] for kind in TOYS
    }
    places = numbers(r'<line x1="([\d.]+)"', drawn["rows"])
    assert places == [pytest.approx((px(mark, MASS, 0, 559),), abs=0.051) for mark in rows.marks]
    boxes = [(x, x + wide) for x, wide in numbers(r'<rect x="([\d.]+)".*?width="([\d.]+)"', drawn["rows"])]
    assert boxes == [pytest.approx([px(end, MASS, 0, 559) for end in span], abs=0.11) for span in rows.spans]
    assert re.findall(r"<text[^>]*>([^<]*)</text>", drawn["rows"]) == ["2 g", "8 g"]
    assert numbers(r'<path d="M([\d.]+) 2V30"', drawn["rows"]) == [pytest.approx((px(9, MASS, 0, 559),), abs=0.051)]

    def at(x, y):
        return pytest.approx((px(x, MASS, 52, 559), px(y, AGE, 156, 8)), abs=0.051)

    (curves,) = TOYS["curves"].marks
    lines = re.findall(r'<polyline points="([^"]*)"', drawn["curves"])
    for line, y in zip(lines, curves.y, strict=True):
        assert numbers(r"([\d.]+),([\d.]+)", line) == [at(*place) for place in zip(curves.x, y, strict=True)]
    assert numbers(r'<rect x="([\d.]+)" y="([\d.]+)"', drawn["bars"]) == [at(1, 3), at(2, 7), at(4, 5)]
    assert numbers(r'<path d="M([\d.]+) 156V([\d.]+)" s', drawn["stems"]) == [at(2, 3), at(5, 6)]
    assert numbers(r'<circle cx="([\d.]+)" cy="([\d.]+)"', drawn["points"]) == [at(2, 3), at(5, 6)]
    words = re.findall(r"<text[^>]*>([^<]*)</text>", drawn["matrix"])
    assert words == ["dB", "no. a", "no. b", "no. a", "on", "12.5", "no. b", "3.0", "on"]
    assert drawn["matrix"].count("<rect") == 1
    # To scale: 50 mm are 559 px wide, from the left and from above.
    each = 559 / 50
    places = [pytest.approx((each * (x + 20), each * (15 - y), each * 3.5), abs=0.051) for x, y in ((0, -3), (12, 8))]
    assert numbers(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="([\d.]+)"', drawn["discs"]) == places
    assert re.findall(r"<text[^>]*>([^<]*)</text>", drawn["discs"]) == ["1", "2"]
    for kind in ("curves", "bars", "stems", "points"):
        assert numbers(r'<path d="M([\d.]+) 8V156"', drawn[kind]) == [pytest.approx((px(9, MASS, 52, 559),), abs=0.051)]
        assert "mass &lt;g&gt;, g" in drawn[kind]


def test_the_page_shows_what_figures_say(toys, opened, small_plan):
    page = opened(page_html(whole(small_plan)))
    titles = page.locator("main section > h2").all_text_contents()
    assert [f"Masses <{kind}>" for kind in TOYS] == [title for title in titles if title.startswith("Masses")]
    assert page.locator("#contents a", has_text="Masses <rows>").count() == 1

    def drawn(kind, selector, names):
        return page.eval_on_selector_all(
            f"#toy{kind}-body {selector}",
            "(all, names) => all.map((e) => names.map((n) => Number(e.getAttribute(n))))",
            names,
        )

    for kind in TOYS:
        assert page.locator(f"#toy{kind}-body table.plain td").all_text_contents() == ["2 g", "8 g"]
    (rows,) = TOYS["rows"].marks
    wide = page.evaluate("document.querySelector('#toyrows-body svg').viewBox.baseVal.width")
    ends = 58, wide - 74
    boxes = [(x, x + width) for x, width in drawn("rows", "rect", ["x", "width"])]
    assert boxes == [pytest.approx([px(end, MASS, *ends) for end in span], abs=0.01) for span in rows.spans]
    lines = drawn("rows", "line[stroke-width='3']", ["x1"])
    assert lines == [pytest.approx([px(mark, MASS, *ends)], abs=0.01) for mark in rows.marks]
    assert {"no. a", "no. b", "2 g", "8 g", "mass <g>, g"} <= set(
        page.locator("#toyrows-body text").all_text_contents()
    )

    def at(x, y):
        return pytest.approx([px(x, MASS, 52, wide - 14), px(y, AGE, 238, 28)], abs=0.01)

    bars = [[x - 0.5, y] for x, y in drawn("bars", "rect", ["x", "y"])]
    assert bars == [at(1, 3), at(2, 7), at(4, 5)]
    assert drawn("stems", "g.stems line", ["x1", "y2"]) == [at(2, 3), at(5, 6)]
    assert drawn("points", "circle", ["cx", "cy"]) == [at(2, 3), at(5, 6)]
    assert drawn("discs", "circle", ["cx", "cy", "r"]) == [[0, 3, 3.5], [12, -8, 3.5]]
    assert page.locator("#toydiscs-body text").all_text_contents() == ["▲ a corner", "1", "2"]
    assert page.get_attribute("#toydiscs-body polygon", "points") == "-20,10 30,10 30,-15"
    assert page.locator("#toymatrix-body td").all_text_contents() == ["", "on", "12.5", "3.0", "on", "2 g", "8 g"]
    framed = "cells => cells.filter((c) => getComputedStyle(c).outlineStyle === 'solid').map((c) => c.textContent)"
    assert page.eval_on_selector_all("#toymatrix-body td", framed) == ["3.0"]
    for kind in ("bars", "stems", "points"):
        assert drawn(kind, "line.across", ["x1"]) == [pytest.approx([px(9, MASS, 52, wide - 14)], abs=0.01)]
    # A curve is pixels: its colour is where the figure says, in the middle of the axes.
    ((left, top, right, bottom),) = page.evaluate(
        """() => [...document.querySelectorAll('#toycurves-body .u-over')].map((e) => {
            const box = e.getBoundingClientRect();
            const from = e.parentElement.querySelector('canvas').getBoundingClientRect();
            return [box.left - from.left, box.top - from.top, box.right - from.left, box.bottom - from.top];
        })"""
    )
    seen = page.evaluate(
        """([x, y]) => {
            const canvas = document.querySelector('#toycurves-body canvas');
            const scale = canvas.width / canvas.clientWidth;
            return [...canvas.getContext('2d').getImageData(Math.round(x * scale), Math.round(y * scale), 1, 1).data];
        }""",
        [px(2, MASS, left, right), px(4, AGE, bottom, top)],
    )
    assert seen[:3] == pytest.approx([0x00, 0x72, 0xB2], abs=60), "channel 0 is blue"


PLUGIN = """
from types import SimpleNamespace
from padgen.report.figures import Bars, Figure, Panel, Scale, register

def make(plan, quick):
    spans = Bars("set-0", "channels", (0.0, 1.0), (len(plan.channels),))
    panel = Panel(Scale("half", "", 0.0, 2.0), Scale("count", "", 0.0, 9.0), (spans,))
    return (Figure("how many channels there are", "one bar", (panel,)),)

register("howmany", SimpleNamespace(TITLE="How many", CAPTION="Few.", SHOWN_IN=("draw", "page", "notebook"), make=make))
"""


def test_a_figure_is_one_file(tmp_path):
    """Named by `PADGEN_PLUGINS`, a file brings its figure into files, page and notebooks, in every process."""
    (tmp_path / "my_figure.py").write_text(PLUGIN)
    (tmp_path / "tiny.toml").write_text(SMALL)
    environment = {**os.environ, "PADGEN_PLUGINS": "my_figure", "PYTHONPATH": str(tmp_path)}

    def run(*words):
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    run("-m", "padgen", "draw", "tiny.toml", "--only", "howmany", "--format", "svg", "-o", "pictures")
    assert (tmp_path / "pictures" / "howmany.svg").read_text().startswith("<?xml")
    run("-m", "padgen", "report", "tiny.toml")
    html = (tmp_path / "out" / "tiny" / "report.html").read_text()
    assert '<section id="howmany" data-figure><h2>How many</h2>' in html
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)[1])
    assert data["later_charts"]["howmany"][0]["panels"][0]["marks"][0]["counts"] == [4]
    shown = run("-c", "import padgen as pg; print(pg.plan('tiny.toml')._repr_html_())")
    assert 'aria-label="one bar"' in shown


def test_padgens_own_figures_have_their_media():
    assert figure_names("draw") == ("responses", "selectivity", "ladder", "kept", "wiring")
    assert figure_names("page") == figure_names("draw")
    assert (figure_names("move"), figure_names("notebook")) == (("ladder",), ("ladder",))
    assert set(figure_names("draw")) < set(picture_names())
    assert len(set(picture_names())) == len(picture_names())
    for name in figure_names("draw"):
        assert set(figures.FIGURES.get(name).SHOWN_IN) <= set(MEDIA)


@pytest.mark.parametrize("name", ["ladder", "wiring", "bom", "Toy"])
def test_a_name_that_is_taken_is_refused(name):
    with pytest.raises(SpecError):
        figures.register(name, toy("rows"))


def test_what_lacks_something_is_refused():
    with pytest.raises(SpecError, match="the figure 'half' lacks CAPTION, SHOWN_IN, make"):
        figures.register("half", SimpleNamespace(TITLE="Half"))
    with pytest.raises(ValueError, match="marks of one kind, got Bars and Curves"):
        Panel(MASS, AGE, (*TOYS["curves"].marks, *TOYS["bars"].marks))


def test_a_map_is_no_matrix():
    """A matrix has a row and a column for each name, and its diagonal is ON; a map of 2 x 4 coils is made of discs."""
    with pytest.raises(ValueError, match="for each of its 2 names"):
        Matrix("heat", ("a", "b"), ((1.0,) * 4,) * 2, Scale("heat", "W", 0, 1), 0.0)


def test_bars_of_prints_say_what_was_measured(paper_plan):
    """A legend is read without the sentence of a plan: "nothing" or "every taxel" alone says nothing."""
    (drawn,) = figures_of(paper_plan, "kept", "draw")
    assert [bars.label for bars in drawn.panels[0].marks] == ["nothing measured", "every taxel measured"]
    assert all(name.endswith(" measured") for name, _ in drawn.facts.rows)


def test_each_medium_gets_its_parts(paper_plan):
    """Points and the lines' strengths are for files; lines across the curves and the nearer range for the page."""
    drawn = figures_of(paper_plan, "responses", "draw")[0]
    assert [panel.kind for panel in drawn.panels] == ["curves", "stems"]
    assert drawn.panels[0].points and [line.role for line in drawn.panels[0].lines] == ["asked"]
    (sent,) = page_figures(paper_plan, ("responses",), quick=True)["responses"]
    (panel,) = sent["panels"]
    assert panel["points"] == []
    assert [line["role"] for line in panel["lines"]] == ["spur", "spur", "channel-0", "channel-1"]
    whole_x = drawn.panels[0].marks[0].x
    x = np.frombuffer(base64.b64decode(panel["marks"][0]["x"]["float32"]), "<f4")
    assert len(x) < len(whole_x) and (panel["x"]["low"] <= x.min() < x.max() <= panel["x"]["high"])
    y = np.frombuffer(base64.b64decode(panel["marks"][0]["y"]["float32"]), "<f4").reshape(2, -1)
    inside = (whole_x >= panel["x"]["low"]) & (whole_x <= panel["x"]["high"])
    assert y == pytest.approx(drawn.panels[0].marks[0].y[:, inside], abs=6e-4), "half of a thousandth of a dB"


def played(plan, channel_set, seconds):
    """Return the current (n,) in A of a coil with all channels on, by the formulas of docs/driving.md."""
    line_a2 = np.array([c.line_a2 for c in channel_set])
    hz = np.array([c.resonance_hz for c in channel_set])[:, None]
    scheme = plan.scheme
    if scheme.is_root:
        return np.sqrt(2 * line_a2.sum() + (line_a2[:, None] * np.cos(2 * np.pi * hz * seconds)).sum(0))
    if scheme.is_biased:
        tones = current_lines_a(scheme, line_a2)[:, None] * np.sin(2 * np.pi * hz * seconds)
        return bias_a(scheme, line_a2) + tones.sum(0)
    return (current_lines_a(scheme, line_a2)[:, None] * np.sin(np.pi * hz * seconds)).sum(0)


@pytest.mark.parametrize("name", ["paper-32", "triple-48", "quad-64", "pad-32"])
def test_lines_are_those_of_the_squared_current(name):
    """Sizes and phases of all lines, by fitting them to the square of the current itself."""
    plan = pg.plan(name)
    for channel_set in plan.sets:
        lines = coil_lines(plan, channel_set, 64)
        seconds = np.linspace(0, 30, 40_001)
        turns = np.exp(2j * np.pi * lines.hz[:, None] * seconds)
        columns = np.concatenate([np.ones((1, len(seconds))), turns.real, -turns.imag]).T
        found = np.linalg.lstsq(columns, played(plan, channel_set, seconds) ** 2, rcond=None)[0][1:]
        squared = found[: len(lines.hz)] + 1j * found[len(lines.hz) :]
        # A taxel that answers everything alike, at once: its motion under each line is that line.
        modes = coil_modes(plan.spec, channel_set)
        stiff = modes._replace(frequency_hz=np.full_like(modes.frequency_hz, 1e9), gain=np.zeros_like(modes.gain))
        stiff.gain[:, 0, 0] = 1.0
        moved_um = line_motion(plan, channel_set, lines, stiff)[0]
        scale = np.abs(moved_um).max() / np.abs(squared).max()
        assert moved_um == pytest.approx(scale * squared, abs=1e-6 * np.abs(moved_um).max())


def answer(channel, spec, hz):
    """Return the complex felt motion (3,) of a taxel under a line of one newton, term by term."""
    arm = spec.taxel.boss_diameter_mm / 2 * 1e-3 / 2
    parts = np.array([channel.rest_motion[2], arm * channel.rest_motion[3], arm * channel.rest_motion[4]], complex)
    for mode_hz, motion in zip(channel.modes_hz, channel.mode_motions, strict=True):
        push = sum(a * b for a, b in zip(motion, channel.pull_wrench, strict=True)) / (2 * np.pi * mode_hz) ** 2
        share = push / (1 - (hz / mode_hz) ** 2 + 1j * hz / mode_hz / channel.q)
        parts += share * np.array([motion[2], arm * motion[3], arm * motion[4]])
    return parts


@pytest.mark.parametrize("name", ["triple-48", "wide-11"])
def test_motion_is_the_sum_over_modes(name):
    plan = pg.plan(name)
    channel_set = plan.sets[-1]
    lines = coil_lines(plan, channel_set, 64)
    moved_um = line_motion(plan, channel_set, lines, coil_modes(plan.spec, channel_set))
    own = {maker: k for k, (maker, *more) in enumerate(lines.makers) if not more and lines.kinds[k] == "tone"}
    for taxel, channel in enumerate(channel_set):
        felt = np.linalg.norm(answer(channel, plan.spec, channel.resonance_hz))
        tone = own[taxel]
        for line, hz in enumerate(lines.hz):
            size_um = channel.level_um * np.sqrt(lines.square[line] / lines.square[tone])
            asked = size_um * abs(answer(channel, plan.spec, hz)[0]) / felt
            assert abs(moved_um[taxel, line]) == pytest.approx(asked, abs=1e-9 * size_um)
        # Against the pull's own phase, at resonance a taxel is a quarter behind, but for its other modes.
        delay = np.angle(answer(channel, plan.spec, channel.resonance_hz)[0])
        start = {"biased": -np.pi / 2, "root": 0.0}[plan.scheme.kind.CURRENT]
        assert np.angle(moved_um[taxel, tone] * np.exp(-1j * (delay + start))) == pytest.approx(0, abs=1e-9)
        assert delay == pytest.approx(-np.pi / 2, abs=0.1)


@pytest.mark.parametrize("name", ["triple-48", "wide-11"])
def test_the_page_moves_each_taxel_by_its_lines(name, opened):
    plan = pg.plan(name)
    page = opened(page_html(whole(plan)))
    count = len(plan.sets[0])
    bits = "1" * (count - 1) + "0"
    page.evaluate("bits => padgen.setState(bits)", bits)
    for seconds in (0.0, 0.0123):
        moved = dict(
            zip(
                page.evaluate("padgen.data.taxels.id"),
                page.evaluate("seconds => padgen.displaced(seconds, 0)", seconds),
                strict=True,
            )
        )
        for which, channel_set in enumerate(plan.sets):
            lines = coil_lines(plan, channel_set, 64)
            modes = coil_modes(plan.spec, channel_set)
            turned = line_motion(plan, channel_set, lines, modes) * np.exp(2j * np.pi * lines.hz * seconds)
            plays = [all(maker < count - 1 for maker in makers) for makers in lines.makers]
            for position, channel in enumerate(channel_set):
                ids = [
                    t.id for t in plan.taxels if t.channel == channel.index and sum(t.coil) % plan.coils.sets == which
                ]
                asked_um = turned[position, plays].real.sum()
                # Modes that are hardly heard are left out of the page: `LEFT_OUT` of what is heard of others.
                assert moved[ids[0]] == pytest.approx(asked_um, abs=1e-4 * channel.level_um)


def test_the_svg_of_every_figure_is_well_formed(paper_plan):
    from xml.etree import ElementTree

    for name in figure_names("draw"):
        for figure in figures_of(paper_plan, name, "draw"):
            ElementTree.fromstring(svg(figure))
