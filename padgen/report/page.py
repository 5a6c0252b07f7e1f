"""The report: one HTML file that shows a pad without network, server or installation.

`page_data` collects all that is shown as plain data, `page_html` puts it into the page, the same bytes for the same
data. Scripts and styles in ``page/`` are bundled once (`make bundle`) into ``page.min.js`` and ``page.min.css``. All
that is shown is put in as text, so that no name can be run as code; a policy in the page allows its own scripts only.
"""

import csv
import io
import json
import re
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from functools import cached_property
from hashlib import sha256
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from padgen import __version__
from padgen.core.cache import versions
from padgen.core.display import COLOURS, channel_colours
from padgen.core.errors import FileError, InfeasibleError, PadgenError, about, number
from padgen.core.files import json_line, read_bounded, reason, write_synced
from padgen.core.registry import FIGURES
from padgen.core.units import G_PER_CM3, GRAM, MM
from padgen.driver.formats.csv import drive_rows
from padgen.driver.frames import taxel_grid
from padgen.make.pad import Pad
from padgen.planner.ballast import ballast_size, ballast_step
from padgen.planner.drive_rows import COLUMNS, HEADINGS
from padgen.planner.fixtures import plan_tray, spacer_mm
from padgen.planner.guard import plan_guard
from padgen.planner.layout import coil_axis_mm
from padgen.planner.movers import assembly_of
from padgen.planner.pins import felt_parts
from padgen.planner.plan import Plan, plan_from_json, plan_to_json
from padgen.planner.printing import other_slicers_text
from padgen.report.figures import ROLES, figure_names, page_figures, plain_figure
from padgen.report.motion import motion_data
from padgen.report.plans import gain_line, output_coupling, pad_line
from padgen.report.rungs import marks_read, study_figure
from padgen.solid.mesh import signed_volume_mm3
from padgen.solid.parts import bill_of_materials
from padgen.solid.scene import ScenePart, scene_parts

__all__ = ["REPORT_FILE", "Page", "page_data", "page_html", "scene_data", "study_of"]

REPORT_FILE = "report.html"
PAGE = Path(__file__).with_name("page")
LARGEST_STUDY = 10_000_000
STEPS = 32767
"""Steps from the middle to the ends of a mesh, as 16-bit integers have them: 1 µm for a pad of 65 mm."""
HEIGHT_STEPS = 8192
"""Steps of a displacement as large as the washer's."""


@dataclass(frozen=True, eq=False, repr=False)
class Page:
    """The report of a plan, or of its built pad; notebooks show it, ``.save(path)`` writes the file.

    `bill` is the bill of materials (CSV) of a pad that was built before; without it, that of `pad` or of the plan.
    """

    plan: Plan
    pad: Pad | None = None
    study: dict[str, Any] | None = None
    bill: str = ""

    def __repr__(self) -> str:
        return f"<Page {self.plan.name}: {'the built pad' if self.pad else 'the plan'}>"

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html)}" width="100%" height="760" style="border:0"></iframe>'

    @cached_property
    def html(self) -> str:
        """The whole page."""
        return page_html(page_data(self.plan, self.pad, study=self.study, bill=self.bill))

    def save(self, path: str | Path) -> Path:
        """Write the page as one file; raises `FileError` where that is impossible."""
        target = Path(path)
        raw = self.html.encode()
        try:
            with TemporaryDirectory(prefix=".padgen-", dir=target.absolute().parent) as aside:
                write_synced(Path(aside) / REPORT_FILE, raw)
                (Path(aside) / REPORT_FILE).replace(target)
        except OSError as error:
            raise FileError(f"cannot be written ({reason(error)})", str(target)) from error
        return target


def page_data(
    plan: Plan,
    pad: Pad | None = None,
    *,
    live: bool = False,
    study: dict[str, Any] | None = None,
    bill: str = "",
) -> dict[str, Any]:
    """Return all that the page shows of a plan, as plain data.

    Parameters
    ----------
    plan : Plan
        The plan shown.
    pad : Pad, optional
        The built pad of this plan: its own meshes and checks are shown then, else what the plan's dimensions give.
    live : bool
        Leave out what takes more than some milliseconds, which is `scene_data`.
    study : dict, optional
        The table of a ``study.json`` (`study_of`).
    bill : str
        The bill of materials of what was built, as CSV; by default that of `pad`, or of the plan alone.
    """
    if not live:
        # As plan.json records it, so that the page is the same from a plan just made as from one read back.
        plan = plan_from_json(plan_to_json(plan))
    report = pad.check() if pad else None
    figures = report.figures if report else {}
    return {
        "name": plan.name,
        "built": report is not None,
        "verdict": {**asdict(plan.verdict), "badge": _badge(plan), "about": pad_line(plan)},
        "figures": _figures(plan),
        "pad": _pad(plan),
        "coils": _coils(plan),
        "channels": [_channel(plan, index) for index in range(len(plan.channels))],
        "colours": channel_colours(len(plan.channels)),
        "palette": COLOURS,
        "taxels": _taxels(plan),
        "selectivity": asdict(plan.selectivity),
        "roles": ROLES,
        "motion": motion_data(plan),
        "charts": page_figures(plan, figure_names("move"), quick=live),
        "drive": {"columns": COLUMNS, "headings": HEADINGS, "rows": [astuple(row) for row in drive_rows(plan)]},
        "findings": [
            {name: getattr(finding, name) for name in ("level", "code", "where", "message")}
            for finding in (*plan.findings, *(report.findings if report else ()))
        ],
        "checked": {key: value for key, value in figures.items() if isinstance(value, (int, float, list))},
        "study": study,
        "left_out": [asdict(entry) for entry in plan.left_out],
        "manual": _manual(plan),
        "spec": {key: value for key, value in asdict(plan.spec).items() if value is not None},
        "versions": {"padgen": __version__, **versions()},
        **({} if live else scene_data(plan, pad, bill, live=False)),
    }


def scene_data(plan: Plan, pad: Pad | None = None, bill: str = "", *, live: bool = True) -> dict[str, Any]:
    """Return the part of the page's data that the live page loads later: shapes, masses, bill and most figures.

    Shapes and masses need the meshes of a plan's parts; the histogram of prints is there only if it is not `live`.
    """
    parts = scene_parts(plan, pad.solid if pad else None)
    volumes_mm3 = {
        material: sum(len(p.places) * signed_volume_mm3(p.mesh) for p in parts if p.material == material)
        for material in ("pad", "steel")
    }
    measured_g = pad.check().figures.get("plastic_g") if pad else None
    plastic_g = measured_g or _mass_g(volumes_mm3["pad"], plan.spec.material.density_g_per_cm3)
    at_once = figure_names("move")
    return {
        "later_charts": page_figures(plan, tuple(n for n in figure_names("page") if n not in at_once), quick=live),
        "shapes": [_shape(part) for part in parts],
        "bom": list(csv.reader(io.StringIO(bill or (pad.bill if pad else bill_of_materials(plan, plastic_g))))),
        "masses_g": {
            "plastic": plastic_g,
            "washers": _mass_g(volumes_mm3["steel"], plan.spec.washer_or_magnet.density_g_per_cm3)
            + (plan.spec.ballast.mass_g * len(plan.taxels) if plan.spec.ballast else 0.0),
        },
    }


def _mass_g(volume_mm3: float, density_g_per_cm3: float) -> float:
    return volume_mm3 * MM**3 * density_g_per_cm3 * G_PER_CM3 / GRAM


def _badge(plan: Plan) -> str:
    """Return the badge beside the verdict: whether the pad works, touched or not, as printed or re-tuned."""
    where = "untouched"
    if plan.touch:
        where = "under its own contact" if plan.touch.contact == "own" else f"under a {plan.touch.contact}"
    words = {"good": f"Works {where}, as printed", "retune": f"Works {where}, re-tuned", "short": "Falls short"}
    return words.get(plan.verdict.level, "Does not work")


def _figures(plan: Plan) -> list[dict[str, str]]:
    """Return the four key figures of the page's first screen: dB kept by prints, dB under a finger, heat, outputs."""
    is_touched = plan.touch is not None
    of_what = plan.spec.touch.prints_text
    prints = plan.prints
    load = plan.load
    coil = plan.spec.coil
    count = plan.coils.rows * plan.coils.columns
    shown_db = prints.print_db if plan.verdict.figure_db is None else plan.verdict.figure_db
    measured = "as printed" if plan.verdict.level == "good" else "re-tuned"
    kept = "no limit" if shown_db is None else f"{shown_db:.1f} dB"
    typical = next(touched for touched in plan.touched if touched.skin == "typical")
    felt = "not known" if typical.all_states_db is None else f"{typical.all_states_db:.1f} dB".replace("-", "−")
    fitting = [f"{n}\u00a0×\u00a0{name}" for name, n in plan.parts.amplifiers.items()]
    if plan.spec.amplifier:
        named = f"as {plan.spec.amplifier.name}"
    else:
        named = fitting[0] if fitting else "none of the catalogue suffices"
    idle = f"; all coils with all taxels OFF: {about(count * load.idle_w)} W" if load.idle_w else ""
    return [
        {
            "label": "Touched" if is_touched else "Untouched",
            "value": kept,
            "note": f"ON over OFF in {plan.spec.print_share:.0%} of {of_what}, {measured};"
            f" asked: {plan.selectivity.asked_db:.1f} dB",
        },
        {
            "label": "With typical skin" if is_touched else "Under a finger",
            "value": felt,
            "note": "ON over OFF, typical skin (a provisional model), as planned"
            if typical.all_states_db is not None
            else "no taxel of its coil beside it; its resonance moves",
        },
        {
            "label": "Heat",
            "value": f"{about(plan.heat_w)} W",
            "note": f"all coils, all taxels on; a coil draws up to {about(load.copper_loss_w)} W (limit"
            f" {about(coil.power_limit_w, 3)} W)" + idle,
        },
        {
            "label": "Outputs",
            "value": str(count),
            "note": f"{output_coupling(plan)} coupled; {load.current_peak_ma:.0f} mA and {load.voltage_peak_v:.2g} V"
            f" peak each; {named}",
        },
    ]


def _pad(plan: Plan) -> dict[str, Any]:
    pad = plan.spec.pad
    washer = plan.spec.washer_or_magnet
    coil = plan.spec.coil
    return {
        "width_mm": pad.width_mm,
        "depth_mm": pad.depth_mm,
        "border_mm": pad.border_mm,
        "frame_mm": pad.frame_thickness_mm,
        "boss_top_mm": max(channel.pin.top_mm for channel in plan.channels),
        "boss_diameter_mm": plan.spec.contact_diameter_mm,
        "hole_mm": pad.hole_diameter_mm,
        "cell_mm": [plan.cell.width_mm, plan.cell.depth_mm],
        "gap_mm": coil.gap_mm,
        "washer_underside_mm": plan.spec.mover_low_mm,
        "washer_mm": [washer.outer_diameter_mm, washer.inner_diameter_mm, washer.thickness_mm],
        "coil_mm": [coil.outer_diameter_mm, coil.length_mm],
    }


def _coils(plan: Plan) -> dict[str, Any]:
    grid = plan.coils
    places = [coil_axis_mm(grid, row, column) for row in range(grid.rows) for column in range(grid.columns)]
    return {"rows": grid.rows, "columns": grid.columns, "places": places, "print_shares": plan.prints.coil_shares}


CHANNEL = (
    *("index", "resonance_hz", "drive_hz", "q", "ring_up_ms"),
    *("level_um", "root_stress_mpa", "print_spread", "model", "model_error"),
)
"""Fields of a channel that the page shows as the plan has them."""


def _channel(plan: Plan, index: int) -> dict[str, Any]:
    channel = plan.channels[index]
    reuse = plan.reuse
    leaks = reuse.retuned_leaks_db or reuse.leaks_db
    beam = channel.beam
    return {
        **{name: getattr(channel, name) for name in CHANNEL},
        "beam": f"{beam.width_mm:.3f} × {beam.thickness_mm:.2f} × {beam.length_mm:.2f}",
        "suspension": beam.topology,
        "leak_db": leaks[index] if leaks else None,
    }


def _taxels(plan: Plan) -> dict[str, list]:
    """Return the taxels' data as one list per column, which takes a third of the bytes of one table per taxel."""
    grid = taxel_grid(plan)
    pixel = {int(grid[row, column]): (int(row), int(column)) for row, column in np.argwhere(grid >= 0)}
    return {
        "id": [t.id for t in plan.taxels],
        "coil": [t.coil[0] * plan.coils.columns + t.coil[1] for t in plan.taxels],
        "channel": [t.channel for t in plan.taxels],
        "x_mm": [t.x_mm for t in plan.taxels],
        "y_mm": [t.y_mm for t in plan.taxels],
        "pixel": [pixel[index] for index in range(len(plan.taxels))],
    }


def _shape(part: ScenePart) -> dict[str, Any]:
    """Return a part as plain data: mesh and motion as 16-bit integers in base64, places of its copies as numbers."""
    vertices = part.mesh.vertices_mm
    low = vertices.min(0)
    high = vertices.max(0)
    middle = (low + high) / 2
    scale = float((high - low).max()) / 2 / STEPS
    heights = np.zeros(len(vertices)) if part.heights is None else part.heights
    steps = np.c_[np.rint((vertices - middle) / scale), np.clip(np.rint(heights * HEIGHT_STEPS), -STEPS, STEPS)]
    index = part.mesh.triangles.astype("<u2" if len(vertices) < 1 << 16 else "<u4")
    return {
        "name": part.name,
        "material": part.material,
        "channel": part.channel,
        "middle_mm": middle.tolist(),
        "depth_mm": float(high[2] - low[2]),
        "step_mm": scale,
        "height_step": 1 / HEIGHT_STEPS,
        "vertices": b64encode(steps.astype("<i2").tobytes()).decode(),
        "triangles": b64encode(index.tobytes()).decode(),
        "wide": index.itemsize == 4,
        "places": [(p.x_mm, p.y_mm, p.z_mm, int(p.turned)) for p in part.places],
        "names": [p.name for p in part.places] if part.material == "pad" and part.channel is not None else [],
    }


def _board_of(plan: Plan) -> dict[str, str] | None:
    """Return the assembly manual's texts on a board of coils; None with wound coils."""
    coil = plan.spec.coil
    if coil.kind != "board":
        return None
    count = plan.coils.rows * plan.coils.columns
    size = f"{coil.size_text} on {coil.layers} layers"
    return {
        "part": f"{count} coils of {size}; padgen build --formats board makes its files, and board-parts.csv",
        "step": "Solder the connector to the board, on the side with the names. Lay the board under the pad, that side"
        f" up and its dot under the groove, on spacers of {number(spacer_mm(plan))} mm at the screws or on the frame"
        " that padgen build --parts spacer makes.",
    }


def _manual(plan: Plan) -> dict[str, Any]:
    """Return what assembling this pad needs: the tray's heights, screws, slicer settings."""
    tray = None
    why = ""
    try:
        tray = plan_tray(plan)
    except InfeasibleError as error:
        why = error.message
    heeded = assembly_of(plan.spec)
    heights = ("floor_mm", "socket_top_mm", "coil_top_mm", "height_mm", "gap_mm", "wires")
    return {
        "tray": {name: getattr(tray, name) for name in heights} if tray else None,
        "no_tray": why,
        "felt": felt_parts(plan),
        "guard": _guard_of(plan),
        "screw": tray.screw._asdict() if tray and tray.screw else None,
        "mover": plan.spec.mover.kind,
        "washer": plan.spec.washer_or_magnet.name,
        "ballast": ballast_size(plan.spec.ballast) if plan.spec.ballast else "",
        "ballast_step": ballast_step(plan.spec),
        "board": _board_of(plan),
        "gluing": heeded[0],
        "wiring": heeded[1],
        "gain": gain_line(plan),
        "has_two_sets": plan.coils.sets > 1,
        "screws": heeded[2],
        "pull_change": max(c.pull_exponent for c in plan.channels) * 10 / plan.spec.coil.gap_mm,
        "coil": plan.spec.coil.name,
        "glue_mg": plan.spec.taxel.glue_mg,
        "printing": plan.printing,
        "slicers": other_slicers_text(plan),
    }


def _guard_of(plan: Plan) -> dict[str, float] | None:
    """Return the sizes of the guard plate; None where the spec has none."""
    if not plan.spec.guard.thickness_mm:
        return None
    guard = plan_guard(plan)
    return {"height_mm": guard.height_mm, "hole_diameter_mm": guard.hole_diameter_mm}


def study_of(folder: Path) -> dict[str, Any] | None:
    """Return figure and points of a folder's ``study.json`` (error against run time); None if it cannot be read."""
    try:
        table = json.loads(read_bounded(folder / "study.json", LARGEST_STUDY, "a study"))
        rungs = [rung for rung in marks_read(table) if rung.seconds > 0 and rung.error > 0]
        figure = study_figure(str(table.get("name", "")), rungs)
    except (PadgenError, ValueError, KeyError, TypeError, RecursionError, OverflowError):
        return None
    return {"figure": plain_figure(figure), "rungs": [rung._asdict() for rung in rungs]}


def page_html(
    data: dict[str, Any], *, script: str = "", style: str = "", connect: bool = False, drawn: bool = True
) -> str:
    """Return the page that shows `data`, with a further `script` and `style` where these are given.

    If it is not `drawn`, the page's own script, which shows a plan, is left out; of `data` the name suffices. Its
    policy allows these scripts and styles by their hashes and nothing else; with `connect` it may ask its own
    server, else it may load nothing at all.
    """
    styles = [_text("page.min.css"), *([style] if style else [])]
    scripts = [*([_text("page.min.js")] if drawn else []), *([script] if script else [])]
    own_server = "'self'" if connect else "'none'"
    policy = (
        f"default-src 'none'; img-src data: blob:; script-src {_hashes(scripts)}; style-src {_hashes(styles)};"
        f" connect-src {own_server}; base-uri 'none'; form-action 'none'"
    )
    filled = {
        "policy": policy,
        "title": escape(data["name"]),
        "charts": "\n\n".join(_section(name) for name in figure_names("page") if name != "wiring"),
        "wiring": _section("wiring"),
        "styles": "".join(f"<style>{text}</style>" for text in styles),
        # Within JSON "<" stands in texts alone, where it may be written by its number: no text can end the element.
        "data": json_line(data).replace("<", "\\u003c"),
        "scripts": "".join(f"<script>{text}</script>" for text in scripts),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: filled[match[1]], _text("page.html"))


def _section(name: str) -> str:
    """Return the empty HTML section of a figure, which the page's script fills."""
    kind = FIGURES.get(name)
    sheet = ' class="sheet"' if "sheet" in kind.SHOWN_IN else ""
    return (
        f'<section id="{name}"{sheet} data-figure><h2>{escape(kind.TITLE)}</h2>\n'
        f'<p class="caption">{escape(kind.CAPTION)}</p>\n'
        f'<div class="field" hidden><label for="{name}-which"></label><select id="{name}-which"></select></div>\n'
        f'<div id="{name}-body"></div></section>'
    )


def _text(name: str) -> str:
    return (PAGE / name).read_text(encoding="utf-8")


def _hashes(texts: Sequence[str]) -> str:
    """Return the sources of a content security policy that allow exactly these inline texts."""
    return " ".join(f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'" for text in texts)
