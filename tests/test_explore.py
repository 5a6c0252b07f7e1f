"""`padgen explore`: only its own page is served, and what the page shows is what `padgen plan` says."""

import http.client
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import sync_playwright

import padgen as pg
from padgen.core.files import json_line
from padgen.planner import plan_to_json
from padgen.report.page import page_data, scene_data
from tests.test_page import ARGUMENTS, LATE_S, chromium, hear


class Server:
    """A running `padgen explore`."""

    def __init__(self, folder, spec="paper-32"):
        command = [sys.executable, "-m", "padgen", "explore", spec, "--no-browser", "-o", str(folder)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=dict(os.environ))
        self.address = self.process.stdout.readline().strip()
        parts = urlsplit(self.address)
        self.port, self.token = parts.port, parse_qs(parts.query)["token"][0]
        self.folder = folder

    def ask(self, path, body=None, method="POST", token=None, **headers):
        line = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        data = json.dumps(body).encode() if isinstance(body, dict) else body
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        line.request(method, path, data, {"X-Padgen-Token": self.token if token is None else token, **named})
        answer = line.getresponse()
        text = answer.read().decode()
        line.close()
        return answer.status, text

    def call(self, name, fields):
        status, text = self.ask(f"/{name}", fields)
        return status, json.loads(text)

    def libraries(self):
        return Path(f"/proc/{self.process.pid}/maps").read_text()

    def stop(self):
        self.process.terminate()
        self.process.communicate(timeout=10)


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    running = Server(tmp_path_factory.mktemp("explore"))
    yield running
    running.stop()


CHANGES = [{}, {"q_min": 17.25}, {"coil.gap_mm": 1.3, "delta_y": 7}, {"printer": "fdm-0.25", "band_hz": [45, 180]}]


@pytest.mark.parametrize("fields", CHANGES, ids=str)
def test_a_move_shows_what_padgen_plan_says(server, fields):
    tables = {name: value for name, value in fields.items() if "." not in name}
    for name, value in fields.items():
        if "." in name:
            table, key = name.split(".")
            tables[table] = {key: value}
    status, data = server.call("plan", fields)
    assert status == 200
    # To the last digit: both are the same calls, in two processes.
    plan = pg.plan("paper-32", **tables)
    assert data == json.loads(json_line(page_data(plan, live=True)))
    assert server.call("scene", fields) == (200, json.loads(json_line(scene_data(plan))))
    recorded = json.loads(plan_to_json(plan))
    for key in ("resonance_hz", "drive_hz", "q", "level_um"):
        assert [channel[key] for channel in data["channels"]] == [channel[key] for channel in recorded["channels"]]
    assert data["selectivity"].items() >= recorded["selectivity"].items()


def test_no_cad_kernel_is_loaded_by_planning(server):
    server.call("plan", {"q_min": 16})
    assert "OCP" not in server.libraries()
    assert "numpy" in server.libraries()  # the check can see libraries at all


def test_a_refusal_names_its_field(server):
    status, data = server.call("plan", {"coil.gap_mm": 900})
    assert status == 200
    assert data["error"]["where"] == "coil.gap_mm"
    status, data = server.call("plan", {"resolution": 4096})
    assert status == 200
    assert data["error"]["message"]


def test_the_spec_is_written_and_plans_alike(server):
    status, data = server.call("save", {"name": "turned", "q_min": 18, "coil.gap_mm": 1.2})
    assert (status, Path(data["written"])) == (200, server.folder / "turned.toml")
    own = pg.plan("paper-32", name="turned", q_min=18, coil={"gap_mm": 1.2})
    assert plan_to_json(pg.plan(data["written"])) == plan_to_json(own)


@pytest.mark.parametrize(
    "headers",
    [
        {"token": ""},
        {"token": "x" * 32},
        {"Host": "padgen.example"},
        {"Host": "padgen.example:80"},
        {"Origin": "http://padgen.example"},
        {"Origin": "null"},
    ],
    ids=str,
)
@pytest.mark.parametrize(("method", "path"), [("POST", "/plan"), ("POST", "/save"), ("POST", "/build"), ("GET", "/")])
def test_other_pages_get_nothing(server, headers, method, path):
    before = sorted(server.folder.rglob("*"))
    status, text = server.ask(path, {"name": "stolen"}, method, **headers)
    assert status == 403
    assert server.token not in text
    assert sorted(server.folder.rglob("*")) == before


def test_large_requests_are_cut_off(server):
    """A hundred megabytes are refused after 64 kB, whether their length is stated or not."""

    def endless():
        for _ in range(100):
            yield b" " * 1_000_000

    start = time.perf_counter()
    for body in (b" " * 100_000_000, endless()):
        try:
            status, _ = server.ask("/plan", body)
            assert status == 413
        except (BrokenPipeError, ConnectionResetError):
            pass  # hung up on while it was sending
    assert time.perf_counter() - start < 30
    assert server.call("plan", {})[0] == 200


@pytest.mark.parametrize("path", ["/../../etc/passwd", "/..%2f..%2fetc%2fpasswd", "/static/x", "/out", "/plan/../save"])
def test_paths_outside_are_not_served(server, path):
    assert server.ask(path, None, "GET")[0] in (404, 405)


@pytest.mark.parametrize(
    "fields",
    [
        {"name": "../../x"},
        {"name": "<script>alert(1)</script>"},
        {"name": "x" * 50_000},
        {"printer": "/etc/passwd.toml"},
        {"drive.threshold_file": "../../secret.csv"},
        {"q_min": "'; drop"},
        {"nothing.like.it": 1},
        {"q_min": None},
        {"coil": {"grid": [[[[1]]]]}},
    ],
    ids=lambda fields: str(fields)[:40],
)
def test_hostile_fields_are_refused_in_words(server, fields):
    for name in ("plan", "save", "build"):
        status, data = server.call(name, fields)
        assert status == 200
        assert data["error"]["message"]
        assert "Traceback" not in data["error"]["message"]


@pytest.mark.parametrize("field", ["printer", "drive.threshold_file", "drive"])
def test_files_that_a_page_names_are_not_read(server, field):
    secret = server.folder / ("secret.toml" if field == "printer" else "secret")
    secret.write_text("sesame = 1\n")
    value = {"threshold_file": str(secret)} if field == "drive" else str(secret)
    told = server.call("plan", {field: value})[1]["error"]
    assert told["where"] == field
    assert told["message"].startswith(("names a file", "must be one field"))
    secret.unlink()


@pytest.mark.parametrize("body", [b"[1, 2]", b"nonsense", b"[" * 60_000, b'{"q_min": 1e999}', b"\xff\xfe"])
def test_bodies_that_are_no_fields_are_refused(server, body):
    status, text = server.ask("/plan", body)
    assert status == 200 and json.loads(text)["error"]["message"]


PLANNED = """async ([name, kind, value]) => {
  const box = document.getElementById(`field-${name}`);
  const moved = kind === "slider" ? box.nextElementSibling : box;
  const planned = new Promise((done) => document.addEventListener("padgen-planned", done, { once: true }));
  moved.value = value;
  moved.dispatchEvent(new Event(kind === "slider" ? "input" : "change"));
  await planned;
  return box.value;
}"""


WATCH = """
window.linked = 0;
const link = WebGL2RenderingContext.prototype.linkProgram;
WebGL2RenderingContext.prototype.linkProgram = function (...given) { linked += 1; return link.apply(this, given); };
window.first = [];
document.addEventListener("padgen-figures", () =>
  first.push([document.querySelector("#verdict span:last-child").textContent, padgen.view().shows(padgen.data)]));
"""
BURST = """(values) => new Promise((done) => {
  document.addEventListener("padgen-planned", done, { once: true });
  const slider = document.getElementById("field-q_min").nextElementSibling;
  for (const value of values) {
    slider.value = value;
    slider.dispatchEvent(new Event("input"));
  }
}).then(() => Number(document.getElementById("field-q_min").value))"""


def test_a_slider_moves_the_page_and_a_refusal_is_told_beside_its_field(server):
    """In a real browser: figures as `padgen plan` has them to the last digit; after a refusal the last plan stays.

    Figures come before the 3-D view, no shader is compiled anew, and moves that a later one overtakes are not planned.
    """
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        page = running.new_page(viewport={"width": 1280, "height": 860})
        told, asked = [], []
        page.add_init_script(WATCH)
        page.on("request", lambda request: asked.append(urlsplit(request.url).path))
        hear(page, told)
        page.goto(server.address, timeout=1000 * LATE_S)
        linked = page.evaluate("linked")
        value = page.evaluate(PLANNED, ["q_min", "slider", 700])
        assert float(value) > 15
        plan = pg.plan("paper-32", q_min=float(value))
        assert page.evaluate("first") == [[plan.verdict.sentence, False]]
        assert page.evaluate("padgen.view().shows(padgen.data)")
        own = json.loads(plan_to_json(plan))
        for key in ("resonance_hz", "q", "drive_hz"):
            shown = page.evaluate("window.padgen.data.channels").copy()
            assert [channel[key] for channel in shown] == [channel[key] for channel in own["channels"]]
        assert page.evaluate("window.padgen.data.selectivity.all_states_db") == own["selectivity"]["all_states_db"]
        assert not page.locator("#live .status").is_visible()
        page.evaluate(PLANNED, ["pad.width_mm", "number", "9"])
        assert "9" in page.locator("#live .status").inner_text()
        assert page.evaluate("document.body.classList.contains('refused')")
        assert page.evaluate("window.padgen.data.spec.q_min") == float(value)
        page.evaluate(PLANNED, ["pad.width_mm", "number", "52"])
        assert not page.evaluate("document.body.classList.contains('refused')")
        assert page.evaluate("padgen.view().drawNow(), linked") == linked > 0
        asked.clear()
        last = page.evaluate(BURST, list(range(500, 600, 5)))
        assert page.evaluate("padgen.data.spec.q_min") == last > 15
        assert asked.count("/plan") == 2, "the first of twenty moves and the last"
        plan = pg.plan("paper-32", q_min=last, pad={"width_mm": 52})
        assert page.text_content("#verdict span:last-child") == plan.verdict.sentence
        running.close()
    assert told == []
