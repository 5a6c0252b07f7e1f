"""Can a drawing be read: do its words keep clear of each other, and do its labels point at what they name?"""

from itertools import combinations

from matplotlib.text import Text

SMALLEST_PT = 8.0
TOUCH_PX = 0.5
"""Boxes of words may share less than a pixel, by rounding."""


def assert_readable(figure) -> None:
    """All words lie in the picture, are large enough, and no two of them overlap."""
    words = [text for text in figure.findobj(Text) if text.get_text().strip()]
    boxes = [
        (text.get_text(), text.get_window_extent()) for text in words if text.axes is None or text.axes.axison is False
    ]
    width, height = figure.get_size_inches() * figure.dpi
    assert len(boxes) > 5
    for text, box in boxes:
        assert box.x0 >= 0 and box.x1 <= width and box.y0 >= 0 and box.y1 <= height, f"{text!r} is cut off"
    for (one, a), (other, b) in combinations(boxes, 2):
        apart = min(a.x1, b.x1) - max(a.x0, b.x0) < TOUCH_PX or min(a.y1, b.y1) - max(a.y0, b.y0) < TOUCH_PX
        assert apart, f"{one!r} and {other!r} overlap"
    assert min(text.get_fontsize() for text in words) >= SMALLEST_PT


def assert_labels_point_into_their_parts(figure) -> None:
    """The place that each label's line leads to lies in the part of that name, and the gap's in no part at all."""
    (axis,) = figure.axes
    parts = {patch.get_gid(): patch.get_path() for patch in axis.patches}
    places = {note.get_gid().removeprefix("to "): note.xy for note in axis.texts if note.get_gid()}
    assert places.keys() >= {"plate", "frame", "beam", "gap", "coil"}
    assert places.keys() & {"boss", "pin"}
    assert places.keys() & {"washer", "magnet"}
    for name in places.keys() & parts.keys():
        assert parts[name].contains_point(places[name]), f"the label {name!r} points elsewhere"
    assert not any(path.contains_point(places["gap"]) for name, path in parts.items() if "above" not in name)
