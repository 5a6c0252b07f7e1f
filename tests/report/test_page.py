"""The report page in a real browser: what it shows, answers and prints, and that it runs nothing but its own script."""

import base64
import io
import itertools
import json
import re
import shutil
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from matplotlib.colors import to_hex
from PIL import Image
from playwright.sync_api import sync_playwright

import padgen as pg
from padgen import cli
from padgen.physics.selectivity import off_energy
from padgen.planner import plan_to_json
from padgen.planner.channels import heard_modes
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.layout import coil_axis_mm
from padgen.planner.plan import plan_from_json
from padgen.report.page import PAGE, page_data, page_html, scene_data, study_of
from padgen.solid.mesh import signed_volume_mm3
from padgen.solid.scene import mode_heights, scene_parts
from tests.conftest import SMALL

ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # WebGL draws the pad alone; else the whole page would pass through the same software, which takes twice as long.
    "--disable-gpu-compositing",
]
MANY = {
    "name": "many",
    "resolution": 2048,
    "band_hz": [50, 250],
    "q_min": 15,
    "delta_y": 3,
    "pad": {"width_mm": 400, "depth_mm": 400},
}
DRAWN = "document.getElementById('canvas').dataset.drawn"
LATE_S = 20
"""A hang: pictures take a second on a free machine (docs/performance.md)."""


def chromium():
    """Return the browser's path."""
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    assert path, "needs chromium, which make test installs"
    return path


def hear(page, told):
    """Add to `told` what a page writes to its console and the errors of its scripts."""

    def add(text):
        # Said of this browser alone, which copies the canvas into the page by software.
        if "GPU stall due to ReadPixels" not in text:
            told.append(text)

    page.on("console", lambda message: add(message.text))
    page.on("pageerror", lambda error: told.append(str(error)))


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        yield running
        running.close()


@contextmanager
def opening(browser, folder):
    """Give a function that opens a page, and fail at the end if a page wrote to its console or asked for more.

    Pages are closed then: one that is left open goes on drawing its motion.
    """
    told = []
    contexts = []

    def open_page(html, **options):
        path = folder / f"report-{len(contexts)}.html"
        path.write_text(html, encoding="utf-8")
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 860}, **options})
        contexts.append(context)
        page = context.new_page()
        hear(page, told)
        page.on("request", lambda request: request.url.startswith(("file:", "data:")) or told.append(request.url))
        page.goto(path.as_uri())
        assert page.evaluate(DRAWN), "the first picture is drawn before the page has loaded"
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert told == []


@pytest.fixture
def opened(browser, tmp_path_factory):
    with opening(browser, tmp_path_factory.mktemp("page")) as open_page:
        yield open_page


@pytest.fixture(scope="module")
def paper_html(paper_plan):
    pad = pg.build(paper_plan)
    return pad.report().html


@pytest.fixture(scope="module")
def paper_page(browser, paper_html, tmp_path_factory):
    with opening(browser, tmp_path_factory.mktemp("page")) as open_page:
        page = open_page(paper_html)
        page.evaluate("window.first = padgen.data")
        yield page


@pytest.fixture
def page(paper_page):
    """The report of paper-32, shown again after a test that has shown another pad."""
    yield paper_page
    paper_page.evaluate("padgen.data === window.first || padgen.show(window.first)")


def whole(plan):
    """Return all that the live page shows of a plan, which has no histogram of prints."""
    return {**page_data(plan, live=True), **scene_data(plan)}


def pixels(page) -> np.ndarray:
    """Return what the canvas shows, red, green, blue and opacity (rows, columns, 4)."""
    page.evaluate("padgen.view().drawNow()")
    data = page.evaluate("document.getElementById('canvas').toDataURL()")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data.partition(",")[2]))).convert("RGBA")).astype(int)


def look(page, name):
    page.evaluate("name => document.querySelector(`[data-look=${name}]`).click()", name)


def test_the_first_screen_has_verdict_picture_and_figures(page, paper_plan, paper_html):
    assert page.text_content("h1") == "paper-32"
    assert "in 90% of prints ON taxels then vibrate at least 13.7 dB more" in page.text_content("#verdict")
    assert "Under a finger it does not choose its taxels" in page.text_content("#touched")
    assert page.locator(".figure h2").all_text_contents() == ["Untouched", "Under a finger", "Heat", "Outputs"]
    assert page.locator(".figure .value").all_text_contents() == ["13.7 dB", "−2.9 dB", "0.93 W", "16"]
    assert page.locator("#canvas").bounding_box()["y"] < 400
    assert page.locator("#shaken").is_hidden()
    assert len(paper_html.encode()) <= 1.5e6


def test_a_touched_plan_says_what_it_keeps_under_a_finger(opened):
    """Its figures are the plan's, and the coils are bought as one board."""
    plan = pg.plan("fingertip-board-24")
    page = opened(page_html(page_data(plan)))
    typical = next(touched for touched in plan.touched if touched.skin == "typical")
    assert page.text_content("#verdict .pill") == "Works under a fingertip, re-tuned"
    assert page.locator(".figure h2").all_text_contents() == ["Touched", "With typical skin", "Heat", "Outputs"]
    values = page.locator(".figure .value").all_text_contents()
    assert values[:2] == [f"{plan.touch.print_db:.1f} dB", f"{typical.all_states_db:.1f} dB"]
    assert "in 90% of prints and fingers" in page.text_content(".figure:first-child p:last-child")
    manual = page.text_content("#manual")
    assert "12 coils of 12 x 10.8 mm on 4 layers" in manual
    assert "Lay the board under the pad" in manual
    # A tenth of the amplifier's 30 V, which every amplifier of the catalogue but small ones gives.
    assert "at a tenth of full scale (-20 dB) and set each output of the amplifier to 3 V peak, 2.1 V rms" in manual
    assert "Sound card (motu-24ao), output k → amplifier (6 x pam8403), input k" in page.text_content("#wiring")


WINDOWS = [(1280, 720), (1366, 768), (1280, 860), (1920, 1080), (390, 844)]
TIGHT = [(name, window) for name in ("big-512", "fingertip-board-24") for window in (WINDOWS[0], WINDOWS[-1])]


@pytest.mark.parametrize(("name", "window"), [*(("paper-16", window) for window in WINDOWS), *TIGHT])
def test_all_four_figures_are_in_the_window(opened, name, window):
    """Also below the verdicts of paper-16 and of a touched plan, which say what they keep where they lie loose."""
    width, height = window
    plan = pg.plan(name)
    page = opened(page_html(page_data(plan)), viewport={"width": width, "height": height})
    assert page.text_content("#shaken") == plan.verdict.shaken
    assert page.locator("#shaken").is_visible() == (name != "big-512")
    boxes = [figure.bounding_box() for figure in page.locator(".figure").all()]
    assert len(boxes) == 4
    assert max(box["y"] + box["height"] for box in boxes) <= height
    assert max(box["x"] + box["width"] for box in boxes) <= width


def test_the_picture_shows_frame_and_channels(page):
    image = pixels(page)
    red, _, blue, opaque = np.moveaxis(image, -1, 0)
    assert 0.1 < (opaque > 250).mean() < 0.9
    solid = opaque > 250
    assert (solid & (blue > red + 60)).sum() > 2000, "channel 0 is blue"
    assert (solid & (red > blue + 90)).sum() > 2000, "channel 1 is orange"
    assert (solid & (np.ptp(image[..., :3], axis=-1) < 30)).sum() > 10_000, "the frame is grey"


def test_a_click_where_a_taxel_is_tells_its_id(page, paper_plan):
    """From the touch side places are found by the pad's outline alone: 62 mm from edge to edge."""
    look(page, "top")
    opaque = pixels(page)[..., 3] > 128
    box = page.locator("#canvas").bounding_box()
    (left, right), (top, bottom) = (np.flatnonzero(opaque.any(axis))[[0, -1]] for axis in (0, 1))
    scale = (right - left) / 62
    for taxel in paper_plan.taxels[::7]:
        x = box["x"] + (left + right) / 2 + scale * taxel.x_mm
        y = box["y"] + (top + bottom) / 2 - scale * taxel.y_mm
        page.mouse.click(x, y)
        assert page.text_content("#taxel-name") == taxel.id
    figures = page.text_content("#taxel-figures")
    channel = paper_plan.channels[taxel.channel]
    assert f"{channel.resonance_hz:.2f} Hz" in figures and f"{channel.level_um:.2f} µm" in figures
    page.keyboard.press("Escape")
    page.mouse.click(box["x"] + 4, box["y"] + box["height"] - 4)
    assert page.evaluate("padgen.state.selected") is None
    page.focus("#canvas")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowUp")
    assert page.evaluate("padgen.state.selected") in {t.id for t in paper_plan.taxels}
    page.keyboard.press("Escape")
    look(page, "aslant")


def test_on_taxels_move_ten_times_as_far_as_off_ones(opened, paper_html, paper_plan):
    """By the page's own figures, and by the heights of the bosses that stand out of the frame, seen from the side."""
    page = opened(paper_html, viewport={"width": 800, "height": 640})
    page.fill("#state", "10")
    levels = page.evaluate("padgen.levels")
    on, off = ([levels[t.id] for t in paper_plan.taxels if t.channel == k] for k in (0, 1))
    assert on == pytest.approx([paper_plan.channels[0].level_um] * len(on), rel=0.01)
    assert min(on) >= 10 * max(off) > 0
    # Of the last row of coils alone, behind a cut, bosses of both channels stand side by side.
    page.select_option("#parts", "pad")
    page.evaluate("padgen.view().section(0.7)")
    look(page, "side")
    page.evaluate("padgen.view().zoom(0.4)")
    # All move with the one tone that plays; of so many pictures in a period its amplitude is the first harmonic.
    count = 6
    period = 50 / paper_plan.channels[0].resonance_hz
    frames = np.array([tops(page, k * period / count) for k in range(count)])
    amplitude = 2 * np.abs(np.fft.fft(frames, axis=0)[1]) / count
    box = page.locator("#canvas").bounding_box()
    moved = ([], [])
    for taxel in paper_plan.taxels:
        if taxel.coil[0] == 3:
            x = page.evaluate("id => padgen.placeOf(id)[0]", taxel.id) - box["x"]
            moved[taxel.channel].append(amplitude[int(x) - 2 : int(x) + 3].mean())
    assert min(moved[0]) >= 10 * max(moved[1]) > 0, moved


def tops(page, seconds):
    """Return how far each column of the picture is opaque above the frame's middle, in pixels and parts of them.

    The pad is shown as it is at a time of the page's clock.
    """
    page.evaluate("time => padgen.moveTo(time)", float(seconds))
    top = page.locator("#canvas").bounding_box()["y"]
    middle = page.evaluate("padgen.view().placeOf(0, 25, 2)[1]") - top
    return pixels(page)[: int(middle), :, 3].sum(0) / 255


def test_sequences_play_and_stop(page, paper_plan):
    page.select_option("#sequence", "each")
    for k, taxel in ((0, paper_plan.taxels[0]), (5, paper_plan.taxels[5])):
        page.evaluate("seconds => padgen.moveTo(seconds)", 0.9 * k + 0.1)
        levels = page.evaluate("padgen.levels")
        own = {t.id for t in paper_plan.taxels if t.coil == taxel.coil}
        assert max(levels, key=levels.get) == taxel.id
        assert {id for id, level in levels.items() if level > 0} == own, "only coils that play move anything"
    page.select_option("#sequence", "rows")
    page.evaluate("padgen.moveTo(0.1)")
    top = max(t.y_mm for t in paper_plan.taxels)
    levels = page.evaluate("padgen.levels")
    full = {t.id: paper_plan.channels[t.channel].level_um for t in paper_plan.taxels}
    assert {id for id in levels if levels[id] > 0.5 * full[id]} == {t.id for t in paper_plan.taxels if t.y_mm == top}
    page.select_option("#sequence", "")
    drawn = int(page.evaluate(DRAWN))
    page.click("#play")
    for _ in range(10 * LATE_S):
        if int(page.evaluate(DRAWN)) > drawn + 2:
            break
        page.wait_for_timeout(100)
    assert int(page.evaluate(DRAWN)) > drawn + 2
    assert page.evaluate("padgen.state.playing") and page.text_content("#play") == "Stop"
    page.click("#play")
    assert not page.evaluate("padgen.state.playing")


def test_colours_cut_and_explosion(page, paper_plan):
    told = {"leak": f"{min(paper_plan.reuse.retuned_leaks_db):.1f} dB", "stress": "MPa", "print": "0 %"}
    for mode, text in told.items():
        page.select_option("#colour", mode)
        assert text in page.text_content("#legend"), mode
    image = pixels(page)
    assert ((image[..., 2] > image[..., 0] + 60) & (image[..., 3] > 250)).sum() < 500, "no channel's blue is left"
    page.select_option("#colour", "channel")
    look(page, "top")
    rows = (pixels(page)[..., 3] > 128).any(1)
    page.evaluate("padgen.view().section(0.5)")
    cut = (pixels(page)[..., 3] > 128).any(1)
    assert cut.sum() == pytest.approx(rows.sum() / 2, abs=0.03 * rows.sum()), "the nearer half is cut away"
    page.evaluate("padgen.view().section(0)")
    look(page, "side")
    high = (pixels(page)[..., 3] > 128).any(1).sum()
    page.evaluate("padgen.view().explode(1)")
    assert (pixels(page)[..., 3] > 128).any(1).sum() > 1.5 * high
    page.evaluate("padgen.view().explode(0)")
    look(page, "aslant")


def test_taken_apart_the_pad_stays_in_the_picture(page):
    before = page.evaluate("document.getElementById('explode').value")
    for part in ("100", before):
        page.evaluate(
            "v => { const e = document.getElementById('explode'); e.value = v; e.dispatchEvent(new Event('input')); }",
            part,
        )
        opaque = pixels(page)[..., 3] > 128
        edges = [opaque[0], opaque[-1], opaque[:, 0], opaque[:, -1]]
        assert opaque.any() and not any(edge.any() for edge in edges)
    look(page, "aslant")


def test_the_cut_names_what_it_goes_through(page, paper_plan):
    """Through the middle of a row of coils the cut meets frame, coils and tray; the labels lie in the canvas."""
    pad = page.evaluate("padgen.data.pad")
    depth_mm = pad["depth_mm"] + 2 * pad["border_mm"]
    y_mm = page.evaluate("padgen.data.coils.places[0][1]")
    share = 100 * (depth_mm / 2 + y_mm) / depth_mm
    page.evaluate(
        "v => { const e = document.getElementById('section'); e.step = 'any'; e.value = v;"
        " e.dispatchEvent(new Event('input')); }",
        share,
    )
    page.evaluate("padgen.view().drawNow()")
    told = page.locator("#labels text").all_text_contents()
    assert {"frame", "coil", "tray"} <= set(told)
    box = page.locator("#canvas").bounding_box()
    for label in page.locator("#labels text").all():
        at = label.bounding_box()
        assert box["x"] <= at["x"] and at["x"] + at["width"] <= box["x"] + box["width"]
    page.evaluate(
        "() => { const e = document.getElementById('section'); e.value = 0; e.dispatchEvent(new Event('input')); }"
    )
    page.evaluate("padgen.view().drawNow()")
    assert page.locator("#labels text").count() == 0


def test_a_phone_shows_what_decides_first(opened, paper_html):
    phone = opened(paper_html, viewport={"width": 390, "height": 844})
    for where in ("#verdict", "#touched", "#figures"):
        box = phone.locator(where).bounding_box()
        assert box["y"] + box["height"] <= 844
    # All of each sentence is in sight: nothing is cut by a box that is too low.
    for where in ("#verdict", "#touched", ".figure p"):
        assert phone.evaluate(
            "w => [...document.querySelectorAll(w)].every(e => e.scrollHeight <= e.clientHeight + 1)", where
        )


LETTERS_EM = 1.362
"""Ascent and descent of Noto Sans, the highest of usual fonts, over its size."""


def test_lines_of_the_figures_are_as_high_as_the_letters_of_any_usual_font(opened, paper_html):
    page = opened(paper_html)
    for media, width in itertools.product(("screen", "print"), (390, 718, 1280)):
        page.set_viewport_size({"width": width, "height": 844})
        page.emulate_media(media=media)
        ratios = page.evaluate(
            "() => [...document.querySelectorAll('.figure p')].map(e => getComputedStyle(e))"
            ".map(s => parseFloat(s.lineHeight) / parseFloat(s.fontSize))"
        )
        assert len(ratios) >= 8
        assert min(ratios) >= LETTERS_EM, (media, width)


def test_on_paper_no_sentence_and_no_figure_is_cut(opened, paper_html):
    sheet = opened(paper_html, viewport={"width": 718, "height": 1010})
    sheet.emulate_media(media="print")
    for where in ("#verdict", "#touched", "#about", ".figure", ".figure p"):
        assert sheet.evaluate(
            "w => [...document.querySelectorAll(w)].every(e => e.scrollHeight <= e.clientHeight + 1)", where
        )
    assert sheet.locator(".figure h2").all_text_contents() == ["Untouched", "Under a finger", "Heat", "Outputs"]


@pytest.mark.parametrize("name", ["pad-32", "wide-11"])
def test_a_channel_has_one_colour_on_the_page_and_in_pictures(name):
    plan = pg.plan(name)
    on_page = page_data(plan, live=True)["colours"]
    responses = plan.plot("responses")
    drawn = {line.get_label(): line.get_color() for line in responses.axes[0].lines}
    for channel in plan.sets[0]:
        label = f"channel {channel.index}, {channel.resonance_hz:.1f} Hz"
        if label in drawn:
            assert to_hex(drawn[label]) == on_page[channel.index]


def test_a_cut_shows_full_material(page, paper_plan):
    """As much copper as the windings of one row of coils have in the plane through their axes."""
    coil = paper_plan.spec.coil
    pad = paper_plan.spec.pad
    half = pad.depth_mm / 2 + pad.border_mm
    y = coil_axis_mm(paper_plan.coils, paper_plan.coils.rows - 1, 0)[1]
    page.evaluate("share => padgen.view().section(share)", (y + half) / (2 * half))
    look(page, "side")
    image = pixels(page)
    # Lids have 0.4 of the light of copper, #b8753a, and no shades.
    lid = [round(255 * srgb(0.4 * linear(v / 255))) for v in (0xB8, 0x75, 0x3A)]
    found = (np.abs(image[..., :3] - lid).max(-1) <= 2) & (image[..., 3] > 250)
    ends = page.evaluate("y => [-20, 20].map((x) => padgen.view().placeOf(x, y, -8)[0])", y)
    mm = 40 / (ends[1] - ends[0])
    asked = paper_plan.coils.columns * (coil.outer_diameter_mm - coil.inner_diameter_mm) * coil.length_mm
    # Pixels at the edges of copper are mixed with others.
    assert found.sum() * mm**2 == pytest.approx(asked, rel=0.06)
    page.evaluate("padgen.view().section(0)")
    look(page, "aslant")


def linear(share):
    """Return the light of a colour's part in sRGB (IEC 61966-2-1), both 0 … 1."""
    return ((share + 0.055) / 1.055) ** 2.4


def srgb(light):
    """Return a colour's part in sRGB of its light, both 0 … 1."""
    return 1.055 * light ** (1 / 2.4) - 0.055


@pytest.mark.parametrize("name", ["triple-48", "quad-64", "wide-11", "pad-32"])
def test_the_page_s_motion_is_the_planner_s(page, name):
    """The script's lines and modes against `off_energy`, for every taxel off while all others of its coil are on."""
    plan = pg.plan(name)
    page.evaluate("data => padgen.figures(data)", page_data(plan, live=True))
    for which, own in enumerate(plan.sets):
        placed = placed_channels(plan.spec, own)
        energy = off_energy(placed, plan.scheme, heard_modes(plan.spec, own, placed.line))
        for position, channel in enumerate(own):
            bits = "".join("0" if k == position else "1" for k in range(len(own)))
            page.evaluate("bits => padgen.setState(bits)", bits)
            levels = page.evaluate("padgen.levels")
            there = [t.id for t in plan.taxels if t.channel == channel.index and sum(t.coil) % plan.coils.sets == which]
            # Figures in the page have ten digits; the plan counts no spurs of two channels for which there is no third.
            assert levels[there[0]] / channel.level_um == pytest.approx(energy[position] ** 0.5, rel=1e-6)


def data_of(html):
    return re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)[1]


def test_nothing_serious_for_screen_readers(page, opened, paper_html):
    page.evaluate("padgen.select('r0c1k0')")
    phone = opened(paper_html, color_scheme="dark", viewport={"width": 390, "height": 844})
    for each in (page, phone):
        found = Axe().run(each).response["violations"]
        serious = [(v["id"], v["nodes"][0]["html"]) for v in found if v["impact"] in ("serious", "critical")]
        assert serious == []
        wide = each.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert wide <= 0, "the page must not scroll sideways"
    page.evaluate("padgen.select(null)")


@pytest.mark.parametrize("name", ["paper-32", "big-512", "wide-11", "crowded"])
def test_prints_as_two_pages(page, name):
    """Also where channels, coils and findings are many."""
    if name != "paper-32":
        data = whole(pg.plan("wide-11" if name == "crowded" else name))
        page.evaluate("data => padgen.show(data)", crowded(data) if name == "crowded" else data)
    page.emulate_media(media="print")
    told = page.locator(".only-print:visible").all_text_contents()
    parts = "[...document.querySelectorAll('.leaf, #bom, #checks')]"
    cut = dict(page.evaluate(f"{parts}.map((part, k) => [part.id || k, part.scrollHeight - part.clientHeight])"))
    page.emulate_media(media="null")
    # Of crowded findings, what has no room is cut off; the page says before them where all are.
    findings = cut.pop("checks")
    assert max(cut.values()) <= 1 and (findings <= 1 or name == "crowded"), "nothing is cut off at the end of a leaf"
    assert count_pages(page) == 2
    notes = page.evaluate("padgen.data.findings.filter((finding) => finding.level === 'note').length")
    asked = [f"{notes} more finding{'s' * (notes > 1)}: see report.html"] * bool(notes)
    if name == "crowded":
        asked = ["36 more rows: see drive.csv", "34 more findings: see report.html", "29 more rows: see bom.csv"]
    assert told == asked


def crowded(data):
    """Return the data of a page with four times the channels, and with forty findings of two thousand characters."""
    channels = [{**channel, "index": k} for k, channel in enumerate(4 * data["channels"])]
    drive = {**data["drive"], "rows": 4 * data["drive"]["rows"]}
    finding = {"level": "warning", "code": "a.b", "where": "pad", "message": "much " * 400}
    many = {"findings": 40 * [finding], "bom": data["bom"] + 4 * data["bom"][1:]}
    (ladder,) = data["charts"]["ladder"]
    (panel,) = ladder["panels"]
    (series,) = panel["marks"]
    several = ("marks", "spans", "sigmas", "roles")
    rows = {"rows": list(range(4 * len(series["rows"]))), **{name: 4 * series[name] for name in several}}
    labels = [{**label, "at": k, "name": str(k)} for k, label in enumerate(4 * panel["row_labels"])]
    high = {**panel["y"], "high": len(labels) - 0.4}
    longer = {**panel, "y": high, "marks": [{**series, **rows}], "row_labels": labels}
    charts = {"ladder": [{**ladder, "panels": [longer]}]}
    return {**data, **many, "channels": channels, "drive": drive, "charts": charts}


def count_pages(page):
    return len(re.findall(rb"/Type\s*/Page\b", page.pdf(prefer_css_page_size=True)))


EVIL = (
    "<script>window.ran = 1</script><img src=x onerror='window.ran = 2'>{{scripts}}]]>--></script>&quot;"
    "\u202e\u2028'\"`${1}"
)
NO_TEXT = {"shapes", "motion", "level", "colours", "palette", "kind", "role", "roles", "axis", "symbol", "float32"}
"""Entries that are no words: base64, kinds of marks, classes, colours of padgen's own."""


def spoiled(value, text, key=""):
    """Return data with every word in it replaced by a hostile text."""
    if key in NO_TEXT and not (key == "level" and not isinstance(value, str)):
        return value
    if isinstance(value, dict):
        whole = key in ("spec", "printing", "versions")
        return {(f"{text[:300]}{k}" if whole else k): spoiled(v, text, k) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [spoiled(v, text, key) for v in value]
    return text if isinstance(value, str) else value


@pytest.mark.parametrize("text", [EVIL, "../../x", "x" * 100_000], ids=["html", "path", "long"])
def test_names_are_text_and_never_run(opened, paper_plan, text):
    """A page with a hostile text in the place of every word: of names, findings, parts, settings and the spec."""
    data = whole(paper_plan)
    hostile = spoiled(data, text)
    hostile["versions"]["padgen"] = text
    hostile["taxels"]["id"] = [f"{text[:200]}{k}" for k in range(len(paper_plan.taxels))]
    hostile["drive"]["columns"] = data["drive"]["columns"]
    hostile["findings"].append({"level": "error", "code": text, "where": "channel 1", "message": text})
    page = opened(page_html(hostile), viewport={"width": 600, "height": 400})
    shown = text if len(text) <= 2000 else f"{text[:1000]}…{text[-1000:]}"
    assert page.text_content("h1") == shown
    assert shown in page.text_content("#bom-body") and shown in page.text_content("#manual-body")
    page.evaluate("padgen.select(padgen.data.taxels.id[3])")
    page.click("#checks-body button.finding >> nth=0")
    assert page.evaluate("window.ran") is None
    assert page.locator("img[onerror], section script").count() == 0
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert count_pages(page) == 2


@pytest.mark.parametrize("name", [EVIL, "../../x", "x" * 100_000], ids=["html", "path", "long"])
def test_a_folder_s_hostile_plan_is_shown_as_text_and_no_path(tmp_path, capsys, paper_plan, name):
    folder = tmp_path / "deep" / "er" / "folder"
    folder.mkdir(parents=True)
    (folder / "plan.json").write_text(plan_to_json(replace(paper_plan, name=name)))
    assert cli.run(["report", str(folder)]) == 0
    assert json.loads(data_of((folder / "report.html").read_text()))["name"] == name
    assert {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.html")} == {"deep/er/folder/report.html"}
    assert len(capsys.readouterr().out) < 5000


def test_a_spec_with_such_a_name_is_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("<script>", "../../x", "x" * 100_000):
        Path("a.toml").write_text(f'name = "{name}"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\n')
        assert cli.run(["report", "a.toml"]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert cli.run(["report", str(tmp_path)]) == 2
    assert f"{tmp_path}: has no plan.json; name a spec" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["a.toml"]


def test_the_policy_allows_the_page_s_own_scripts_only(browser, small_plan, tmp_path):
    html = page_html(whole(small_plan), script="window.second = 1", style="h1 { color: red }")
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)[1]
    assert policy.startswith("default-src 'none'") and "unsafe" not in policy and "connect-src 'none'" in policy
    assert "connect-src 'self'" in page_html({"name": "x"}, connect=True)
    (tmp_path / "report.html").write_text(html, encoding="utf-8")
    page = browser.new_page(viewport={"width": 600, "height": 400})
    page.goto((tmp_path / "report.html").as_uri())
    assert page.evaluate("[window.second, getComputedStyle(document.querySelector('h1')).color]") == [
        1,
        "rgb(255, 0, 0)",
    ]
    blocked = page.evaluate(
        """() => new Promise((done) => {
            document.addEventListener("securitypolicyviolation", (event) => done(event.violatedDirective));
            const script = document.createElement("script");
            script.textContent = "window.third = 1";
            document.body.append(script);
        })"""
    )
    assert blocked == "script-src-elem" and page.evaluate("window.third") is None
    page.close()


def test_everything_is_shown_anew_without_reloading(page):
    page.evaluate("padgen.select('r1c1k1')")
    page.evaluate("document.addEventListener('padgen-show', () => (window.shown = (window.shown || 0) + 1))")
    page.evaluate("data => padgen.show(data)", whole(pg.plan("pad-32")))
    assert page.text_content("h1") == "pad-32"
    assert page.evaluate("[padgen.state.selected, window.shown]") == ["r1c1k1", 1]
    assert page.locator("#drive-body tbody tr").count() == 6
    page.evaluate("padgen.show(window.first)")
    assert page.text_content("h1") == "paper-32" and page.locator("#drive-body tbody tr").count() == 2


def test_tables_sort_and_findings_mark_their_places(page, paper_plan):
    page.click("#taxels-body thead button >> nth=3")
    page.click("#taxels-body thead button >> nth=3")
    assert page.locator("#taxels-body th[aria-sort]").get_attribute("aria-sort") == "descending"
    assert page.locator("#taxels-body tbody tr >> nth=0").locator("td").nth(2).text_content() == "76.02"
    page.click("#checks-body button.finding:has-text('channel 1')")
    assert page.text_content("#taxel-told").startswith("16 places marked")
    page.click("#taxels-body tbody button >> nth=0")
    assert page.evaluate("padgen.state.selected") in {t.id for t in paper_plan.taxels if t.channel == 1}
    page.evaluate("padgen.select(null)")


def test_histogram_and_verdict_are_of_the_same_prints(paper_plan, monkeypatch):
    """In bins so narrow that other prints of the same pad would show."""
    monkeypatch.setattr("padgen.report.figures.kept.BINS", 20_000)
    bars = page_data(paper_plan)["later_charts"]["kept"][0]["panels"][0]["marks"]
    edges = np.array(bars[0]["edges"])
    counts = np.array([each["counts"] for each in bars])
    assert counts.sum(1).tolist() == [paper_plan.prints.pads] * 2
    above = counts[1][::-1].cumsum()[::-1] / paper_plan.prints.pads
    kept = np.searchsorted(edges, paper_plan.prints.print_db) - 1
    assert above[kept + 1] <= paper_plan.spec.print_share <= above[kept], "nine in ten keep print_db"


@pytest.mark.parametrize("name", ["tiny", "paper-16"])
def test_the_scene_is_the_pad(small_plan, small_pad, name):
    """Every corner of the welded pad is one of the scene's; paper-16 has cells that are turned by 180°."""
    plan, pad = (small_plan, small_pad) if name == "tiny" else (pg.plan(name), pg.build(name).solid)
    assert any(taxel.turned for taxel in plan.taxels) == (name == "paper-16")
    corners = [
        part.mesh.vertices_mm * ((-1, -1, 1) if place.turned else 1) + (place.x_mm, place.y_mm, place.z_mm)
        for part in scene_parts(plan, pad)
        for place in part.places
        if part.material == "pad"
    ]
    steps = {tuple(row) for at in (0.0, 5e-5) for row in np.floor((np.concatenate(corners) + at) / 1e-4).tolist()}
    welded = pad.mesh.vertices_mm
    assert all(any(tuple(np.floor((v + at) / 1e-4)) in steps for at in (0.0, 5e-5)) for v in welded[::5])


def test_a_plan_s_own_shapes_come_near_the_solids(small_plan, small_pad):
    """Volumes within a fillet and a chamfer."""
    own, built = (
        sum(len(p.places) * signed_volume_mm3(p.mesh) for p in scene_parts(small_plan, pad) if p.material == "pad")
        for pad in (None, small_pad)
    )
    assert built == pytest.approx(small_pad.volume_mm3, rel=1e-3)
    assert own == pytest.approx(built, rel=3e-3)


def test_a_scene_has_each_distinct_taxel_once(paper_plan):
    parts = scene_parts(paper_plan)
    assert len(parts) == 9, "two taxels, two washers, border, windings, cores, tray and its cells"
    named = {place.name: place for part in parts for place in part.places}
    assert len(named) == sum(len(part.places) for part in parts)
    for taxel in paper_plan.taxels:
        assert named[taxel.id][1:3] == named[f"washer-{taxel.id}"][1:3] == (taxel.x_mm, taxel.y_mm)


def test_beams_bend_as_their_modes_do(small_plan):
    """A straight beam against the cubic that a force and a moment at its tip bend it to; washer and frame beside it."""
    channel = small_plan.channels[0]
    arrangement = small_plan.arrangement(channel)
    beam = arrangement.beams[0]
    length = float(beam.length_mm)
    x0, y0 = (float(v) for v in beam.root_mm)
    at = np.linspace(0.01, 0.99, 9) * length
    ahead = np.array(beam.direction)
    points = np.c_[np.array([x0, y0]) + at[:, None] * ahead, np.zeros(9)]
    tip = np.array([[*(np.array([x0, y0]) + length * ahead), 0], [*(np.array([x0, y0]) + (length + 0.05) * ahead), 0]])
    z, (end, beyond) = (mode_heights(arrangement, channel, each) for each in (points, tip))
    slope = (beyond - end) / 0.05 * length
    s = at / length
    assert z == pytest.approx((3 * end - slope) * s**2 + (slope - 2 * end) * s**3, abs=0.02 * abs(end))
    washer = np.array([[float(arrangement.washer_x_mm), 0, 1.0]])
    assert mode_heights(arrangement, channel, washer) == pytest.approx(1.0)
    assert mode_heights(arrangement, channel, np.array([[-1.0, 0, 0]])) == 0


def test_command_folder_and_call_write_the_same_page(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("tiny.toml").write_text(SMALL)
    assert cli.run(["report", "tiny.toml"]) == 0
    planned = Path("out/tiny/report.html").read_bytes()
    assert pg.plan("tiny.toml").report().save("a.html").read_bytes() == planned
    assert cli.run(["build", "tiny.toml", "--formats", "stl", "--report"]) == 0
    built = Path("out/tiny/report.html").read_bytes()
    assert built != planned and "report.html" in json.loads(Path("out/tiny/manifest.json").read_text())["built"]
    assert pg.build("tiny.toml").report().save("b.html").read_bytes() == built
    capsys.readouterr()
    for given in ("out/tiny", "tiny.toml"):
        assert cli.run(["report", given, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["built"] and Path(told["file"]).read_bytes() == built
    with pytest.raises(pg.FileError, match="cannot be written"):
        pg.plan("tiny.toml").report().save("none/a.html")
    assert "<iframe srcdoc=" in pg.plan("tiny.toml").report()._repr_html_()
    assert pg.build("tiny.toml")._repr_html_() == pg.plan("tiny.toml")._repr_html_()


def test_a_plan_read_back_gives_the_same_page(paper_plan):
    again = plan_from_json(plan_to_json(paper_plan))
    assert again != paper_plan, "files have ten digits"
    assert page_html(page_data(again)) == page_html(page_data(paper_plan))


def test_a_study_in_the_folder_is_shown(tmp_path, page, paper_plan):
    rung = {"model": "beam", "resolution": "6", "seconds": 1e-3, "error_at_most": 0.01, "is_bound": False}
    slow = {**rung, "model": "solid", "resolution": "<b>7", "seconds": 2.0, "is_bound": True}
    table = {"ladders": [{"ladder": "structure", "quantity": "Hz", "rungs": [rung, slow]}]}
    for text in ("{", "[]", '{"ladders": [1]}', json.dumps(table)[:-1]):
        (tmp_path / "study.json").write_text(text)
        assert study_of(tmp_path) is None
    (tmp_path / "study.json").write_text(json.dumps(table))
    page.evaluate("data => padgen.show(data)", {**whole(paper_plan), "study": study_of(tmp_path)})
    assert page.locator("#study-body circle").count() == 2 and "0.001 s" in page.text_content("#study-body")
    places = page.locator("#study-body circle").evaluate_all(
        "all => all.map(one => [one.cx.baseVal.value, one.style.fill])"
    )
    assert places[0][0] < places[1][0] and [fill == "none" for _, fill in places] == [False, True]
    told = page.locator("#study-body circle title").all_text_contents()
    assert told == ["beam, 6", "solid, <b>7"]


@pytest.mark.soak
def test_two_thousand_taxels_fit_six_megabytes(opened):
    plan = pg.plan(MANY)
    html = page_html(page_data(plan))
    assert len(html.encode()) <= 6e6
    page = opened(html, viewport={"width": 500, "height": 400})
    assert len(page.evaluate("Object.keys(padgen.levels)")) == len(plan.taxels) >= 2048
    assert (pixels(page)[..., 3] > 250).mean() > 0.1


def test_the_bundle_is_of_these_sources():
    """After a change of the scripts: make bundle."""
    for line in (PAGE / "SHA256SUMS").read_text().splitlines():
        known, name = line.split()
        assert sha256((PAGE / name).read_bytes()).hexdigest() == known, f"{name} has changed; run make bundle"
    text = (PAGE / "page.min.js").read_text()
    assert "</script" not in text and "three.js authors" in text and "Leon Sorokin" in text
