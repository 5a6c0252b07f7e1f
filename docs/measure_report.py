"""Measure the report page for docs/performance.md: size, time, first picture, and moves of the live page.

Run on its own it prints the table of moves.
"""

import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from playwright.sync_api import CDPSession, sync_playwright

import padgen as pg
from padgen.planner import Plan
from padgen.report.page import page_data, page_html

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.report.test_explore import Server
from tests.report.test_page import ARGUMENTS, MANY, chromium

FIRST = """new MutationObserver(() => {
    const canvas = document.getElementById("canvas");
    if (canvas?.dataset.drawn) window.first ??= performance.now();
}).observe(document, {subtree: true, attributes: true, childList: true})"""
RUNS = 5
MOVE = """([name, value]) => new Promise((done) => {
    // A task that follows a frame's own begins when the frame is painted.
    const painted = (then) => requestAnimationFrame(() => setTimeout(then));
    const start = performance.now();
    document.addEventListener("padgen-figures", () => painted(() => done(performance.now() - start)), {once: true});
    window.all = new Promise((told) => document.addEventListener(
        "padgen-planned", () => painted(() => told(performance.now() - start)), {once: true}));
    const field = document.getElementById(`field-${name}`);
    field.value = value;
    field.dispatchEvent(new Event("change"));
})"""
MOVED = "paper-32", "pad-32", "big-512"


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
        "| pad | MB | data and page, beyond the build s | figures of a move s | first picture s |",
        "|---|---|---|---|---|",
    ]
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        for name in ("paper-32", MANY):
            pad = pg.build(name)
            pad.check()
            html = page_of(pad)
            page_s = best_s(partial(page_of, pad))
            move_s = best_s(partial(page_data, pad.plan, live=True))
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


def steps(plan: Plan) -> list[tuple[str, str]]:
    """Return moves of different fields, those of the layout included, each to a value that it did not have."""
    spec, (low, high) = plan.spec, plan.spec.band_hz
    return [
        move
        for k in range(1, 6)
        for move in (
            ("q_min", f"{spec.q_min + 0.3 * k}"),
            ("coil.gap_mm", f"{spec.coil.gap_mm * (1 + 0.03 * k):.3f}"),
            ("pad.width_mm", f"{spec.pad.width_mm + k}"),
            ("delta_y", f"{spec.delta_y * (1 + 0.02 * k):.3f}"),
            ("resolution", f"{spec.resolution - 1 - k % 3}"),
            ("band_hz", f"{low}, {high + 2 * k}"),
            ("pad.border_mm", f"{spec.pad.border_mm + 0.2 * k:.1f}"),
        )
    ]


def moves() -> list[str]:
    """Return the table of moves of the live page: time to the figures, the processor's part in it, and time to all."""
    lines = [
        "| spec | moves | figures ms: median | worst | of processor: server | page | all ms: median | worst |",
        "|---|---|---|---|---|---|---|---|",
    ]
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        for name in MOVED:
            server = Server(Path(folder), name)
            browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
            page = browser.new_page(viewport={"width": 1280, "height": 860})
            page.goto(server.address)
            page.wait_for_timeout(1000)
            tools = page.context.new_cdp_session(page)
            tools.send("Performance.enable", {"timeDomain": "threadTicks"})

            def spent_ms(server: Server = server, tools: CDPSession = tools) -> tuple[float, float]:
                # The server's own and that of its workers, who plan.
                pids = [server.process.pid, *(worker.pid for worker in server.workers())]
                times = [Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13] for pid in pids]
                told = {metric["name"]: metric["value"] for metric in tools.send("Performance.getMetrics")["metrics"]}
                ticks = sum(int(user) + int(kernel) for user, kernel in times)
                return 1e3 * ticks / os.sysconf("SC_CLK_TCK"), 1e3 * told["TaskDuration"]

            rows = []
            for step in steps(pg.plan(name)):
                before = spent_ms()
                figures_ms = page.evaluate(MOVE, list(step))
                spent = [after - was for after, was in zip(spent_ms(), before, strict=True)]
                rows.append((figures_ms, *spent, page.evaluate("window.all")))
            figures, own, browsers, everything = zip(*rows, strict=True)
            ms = (
                *(statistics.median(figures), max(figures)),
                *(statistics.mean(own), statistics.mean(browsers)),
                *(statistics.median(everything), max(everything)),
            )
            lines.append(f"| {name} | {len(rows)} | {' | '.join(f'{value:.0f}' for value in ms)} |")
            browser.close()
            server.stop()
    return lines


if __name__ == "__main__":
    print("\n".join(moves()))
