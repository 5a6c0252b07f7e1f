"""Measure size, time and first picture of the report page, for docs/performance.md."""

import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from playwright.sync_api import sync_playwright

import padgen as pg
from padgen.report.page import page_data, page_html

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.test_page import ARGUMENTS, MANY, chromium

FIRST = """new MutationObserver(() => {
    const canvas = document.getElementById("canvas");
    if (canvas?.dataset.drawn) window.first ??= performance.now();
}).observe(document, {subtree: true, attributes: true, childList: true})"""
RUNS = 5


def best_s(work: Callable[[], object]) -> float:
    """Return the least processor time in s of a few runs."""
    times = []
    for _ in range(RUNS):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def page_of(pad: pg.Pad) -> str:
    """Return the page of a built pad."""
    return page_html(page_data(pad.plan, pad))


def report() -> list[str]:
    """Return the table of the page's size and times."""
    lines = [
        "| pad | MB | data and page, beyond the build s | data of a plan, without prints s | first picture s |",
        "|---|---|---|---|---|",
    ]
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        for name in ("paper-32", MANY):
            pad = pg.build(name)
            pad.check()
            html = page_of(pad)
            page_s = best_s(partial(page_of, pad))
            move_s = best_s(partial(page_data, pad.plan, quick=True))
            path = Path(folder, "report.html")
            path.write_text(html, encoding="utf-8")
            firsts = []
            for _ in range(RUNS):
                page = browser.new_page(viewport={"width": 1280, "height": 860})
                page.add_init_script(FIRST)
                page.goto(path.as_uri())
                page.wait_for_function("window.first", timeout=120_000)
                firsts.append(page.evaluate("window.first") / 1e3)
                page.close()
            count = len(pad.plan.taxels)
            lines.append(
                f"| {pad.plan.name}, {count} taxels | {len(html.encode()) / 1e6:.2f} | {page_s:.2f} | {move_s:.3f} |"
                f" {min(firsts):.2f} |"
            )
        browser.close()
    return lines
