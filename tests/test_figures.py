"""Figures are data: each renderer shows the same numbers, also of a figure that padgen does not know.

| what is drawn | equals | within |
|---|---|---|
| matplotlib's marks and spans | the figure's | 1e-9 of the value: the same floats |
| places of marks and spans in the SVG | the figure's | 0.051 px, far ends 0.11 px: written with one decimal |
"""

import re
from math import log

import pytest
from matplotlib.figure import Figure as Canvas

from padgen.report.charts import draw_rows
from padgen.report.figures import FIGURES, Figure, Line, Scale, Series, svg


def toy(plan):
    """Return a figure of two rows that has nothing to do with resonances."""
    series = Series("set-1", "range", "mass", (0.0, 1.0), (2.0, 8.0), ((1.5, 3.0), (7.0, 9.5)), (0.1, 0.2))
    mass = Scale("mass", "g", 1.0, 10.0, is_log=True)
    return Figure("masses", mass, Scale("part", "", -0.6, 1.6), (series,), (Line("limit", 9.0),))


@pytest.mark.parametrize("name", ["ladder", "toy"])
def test_each_renderer_shows_the_same_numbers(name, paper_plan, monkeypatch):
    """Marks and spans of matplotlib and of the SVG are those of the figure."""
    monkeypatch.setitem(FIGURES, "toy", toy)
    figure = FIGURES[name](paper_plan)
    marks = [mark for series in figure.series for mark in series.marks]
    spans = [span for series in figure.series for span in series.spans]

    axis = Canvas().subplots()
    draw_rows(axis, figure)
    drawn = [hz for bars in axis.containers if hasattr(bars, "lines") for hz in bars.lines[0].get_xdata()]
    assert drawn == pytest.approx(marks, rel=1e-9)
    ends = [(bar.get_x(), bar.get_x() + bar.get_width()) for bar in axis.patches]
    assert ends == [pytest.approx(span, rel=1e-9) for span in spans]

    def px(value):
        return 559 * log(value / figure.x.low) / log(figure.x.high / figure.x.low)

    text = svg(figure, "a <label>")
    assert "a &lt;label&gt;" in text
    lines = [float(place) for place in re.findall(r'<line x1="([\d.]+)"', text)]
    assert lines == pytest.approx([px(mark) for mark in marks], abs=0.051)
    boxes = [
        (float(x), float(x) + float(width)) for x, width in re.findall(r'<rect x="([\d.]+)".*?width="([\d.]+)"', text)
    ]
    assert boxes == [pytest.approx((px(first), px(last)), abs=0.11) for first, last in spans]
    words = re.findall(r"<text[^>]*>([^<]*)</text>", text)
    assert words == [f"{mark:.0f} {figure.x.unit}" for mark in marks]
    crossings = [float(place) for place in re.findall(r'<path d="M([\d.]+) ', text)]
    assert crossings == pytest.approx([px(line.at) for line in figure.lines], abs=0.051)
    assert [line.get_xdata()[0] for line in axis.lines if line.get_linestyle() == ":"] == [
        line.at for line in figure.lines
    ]
