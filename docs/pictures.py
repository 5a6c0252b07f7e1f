"""Draw the pictures of the README and of the pages here from plans of the templates: part of `make pictures`."""

from pathlib import Path
from typing import Any

import padgen as pg
from padgen.core.display import plot_bytes

DRAWN: tuple[tuple[str, str, dict[str, Any], str], ...] = (
    ("section.svg", "paper-32", {}, "section"),
    ("responses.svg", "quad-64", {}, "responses"),
    ("pad.svg", "paper-32", {}, "pad"),
    ("exploded.png", "paper-32", {}, "exploded"),
    ("wiring.svg", "paper-32", {}, "wiring"),
    ("ladder.svg", "pad-32", {}, "ladder"),
    ("spurs.svg", "quad-64", {"drive": {"scheme": "tones"}}, "responses"),
    ("heard.svg", "wide-11", {}, "selectivity"),
    ("prints.svg", "pad-32", {"delta_y": 11.3}, "prints"),
)
"""File, template, changed fields of its spec, and the picture."""


def main() -> None:
    for name, template, fields, picture in DRAWN:
        figure = pg.plan(template, **fields).plot(picture)
        Path(__file__).with_name(name).write_bytes(plot_bytes(figure, Path(name).suffix[1:]))


if __name__ == "__main__":
    main()
