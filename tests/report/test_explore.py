"""`padgen explore`: only its own page is served, and what the page shows is what `padgen plan` says."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import parse_qs, quote, urlsplit

import psutil
import pytest
from playwright.sync_api import sync_playwright

import padgen as pg
from padgen.core.files import MANIFEST, PARTIAL, json_line
from padgen.core.registry import PLUGINS
from padgen.planner import plan_to_json
from padgen.report.live import MOST_CONNECTIONS, PLANNERS
from padgen.report.page import page_data, scene_data
from padgen.spec.load import find_spec, read_table
from tests.core.test_runner import alive, wait_until
from tests.report.test_page import ARGUMENTS, LATE_S, chromium, hear

PLENTY_S = 30
"""Bound on what takes fractions of a second, on a busy machine."""


class Server:
    """A running `padgen explore`."""

    def __init__(self, folder, spec="paper-32", options=(), own=(), **environment):
        start = own or ("-m", "padgen", "explore", str(spec), "--no-browser", "-o", str(folder), *options)
        self.told = folder / "stderr.txt"
        with self.told.open("w") as told:
            self.process = subprocess.Popen(
                [sys.executable, *start], stdout=subprocess.PIPE, stderr=told, text=True, env=os.environ | environment
            )
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

    def send(self, data):
        """Send the bytes of a request, and return the connection."""
        line = socket.create_connection(("127.0.0.1", self.port), timeout=60)
        line.sendall(data)
        return line

    def request(self, path, fields, page=""):
        """Return the bytes of a request."""
        body = json.dumps(fields).encode()
        own = {"Host": f"127.0.0.1:{self.port}", "X-Padgen-Token": self.token, "X-Padgen-Page": page}
        lines = "".join(f"{name}: {value}\r\n" for name, value in own.items() if value)
        return f"POST {path} HTTP/1.1\r\n{lines}Content-Length: {len(body)}\r\n\r\n".encode() + body

    def workers(self):
        return psutil.Process(self.process.pid).children(recursive=True)

    def libraries(self):
        processes = [self.process.pid, *(worker.pid for worker in self.workers())]
        return "".join(Path(f"/proc/{pid}/maps").read_text() for pid in processes)

    def stop(self):
        self.process.terminate()
        self.process.communicate(timeout=10)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.process.kill()
        self.process.communicate()


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


BODIES = [
    b"null",
    b"[1, 2]",
    b"3",
    b'"q_min"',
    b"nonsense",
    b"{",
    b"[" * 60_000,
    b'{"q_min": ' + b"[" * 20_000 + b"]" * 20_000 + b"}",
    b'{"q_min": 1e999}',
    b'{"q_min": NaN}',
    b'{"resolution": 1' + b"0" * 400 + b"}",
    b'{"resolution": 1' + b"0" * 5000 + b"}",
    b'{"name": "\\ud800"}',
    b'{"\\ud800": 1}',
    b'{"": 1}',
    b'{"...": 1}',
    b'{"name.x": 1}',
    b'{"coil": [null, {"a": []}]}',
    b'{"pad": null}',
    b'{"band_hz": [null, null]}',
    b'{"amplifier": {"name": 1}}',
    b"\xff\xfe",
    b'{"name": "\xff"}',
]


@pytest.mark.parametrize("body", BODIES, ids=lambda body: str(body[:30]))
def test_bodies_that_are_no_fields_are_refused(server, body):
    before = sorted(server.folder.rglob("*"))
    for path in ("/plan", "/scene", "/save", "/build"):
        status, text = server.ask(path, body)
        assert status == 200
        told = json.loads(text)["error"]["message"]
        assert told and "\n" not in told and "broke down" not in told
    # The page comes in any case, with the form, so that the fields can be mended.
    status, text = server.ask(f"/?fields={quote(body[:8000])}", None, "GET")
    assert status == 200 and "window.padgenForm = " in text
    assert sorted(server.folder.rglob("*")) == before


def test_fields_may_be_left_out(server):
    """A field that is null is one that the spec does not have, in a plan as in the spec that is written."""
    fields = {"name": "without", "amplifier": None, "q_min": 17}
    assert "error" not in server.call("plan", fields)[1]
    status, data = server.call("save", fields)
    assert status == 200
    plan = pg.plan("paper-32", name="without", q_min=17)
    assert plan_to_json(pg.plan(data["written"])) == plan_to_json(plan)


# A drive scheme for whose plans one waits forever.
ENDLESS = """
import time
from types import SimpleNamespace
from padgen.physics import schemes
from padgen.physics.schemes import tones

names = ("current_lines_a", "mean_square_a2", "pair_square", "peak_current_a")
thing = {name: getattr(tones, name) for name in names} | {"CURRENT": "tones", "TAKES_TURNS": False}
wait = lambda *given: time.sleep(1000)
schemes.register("endless", SimpleNamespace(HAS_PAIR_SPURS=True, peak_voltage_v=wait, **thing))
"""
SLOW = {"drive.scheme": "endless"}


def patient(folder, spec="paper-32", options=(), own=()):
    """Return a server that knows the drive scheme "endless"."""
    (folder / "endless_plugin.py").write_text(ENDLESS)
    path = os.pathsep.join([str(folder), str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    return Server(folder, spec, options, own, PYTHONPATH=path, **{PLUGINS: "endless_plugin"})


@pytest.fixture(scope="module")
def slow_server(tmp_path_factory):
    running = patient(tmp_path_factory.mktemp("slow"), options=("--time-limit", "86400"))
    yield running
    running.stop()
    assert running.told.read_text() == ""


def answer_on(line):
    """Return the answer that comes on a connection."""
    answer = http.client.HTTPResponse(line)
    answer.begin()
    return json.loads(answer.read())


def at_work(server):
    """Return the numbers of the processes that a server has started."""
    return {worker.pid for worker in server.workers() if worker.status() != psutil.STATUS_ZOMBIE}


def test_abandoned_plans_end_and_keep_nobody_waiting(slow_server):
    server = slow_server
    assert "error" not in server.call("plan", {})[1]
    wait_until(lambda: len(at_work(server)) >= PLANNERS)
    lines = [server.send(server.request("/plan", SLOW)) for _ in range(50)]
    time.sleep(0.5)
    before = at_work(server)
    start = time.monotonic()
    assert server.call("progress", {})[0] == 200
    assert time.monotonic() - start < PLENTY_S
    for line in lines:
        line.close()
    # All that were at work on these are ended, and others plan.
    wait_until(lambda: len(before - at_work(server)) >= PLANNERS)
    assert "error" not in server.call("plan", {"q_min": 16})[1]
    wait_until(lambda: len(at_work(server)) == len(before))


def test_a_newer_plan_of_a_page_ends_its_older_one_and_no_other_page_s(slow_server):
    server = slow_server
    other = server.send(server.request("/plan", SLOW, "other"))
    older = server.send(server.request("/plan", SLOW, "own"))
    time.sleep(0.2)
    start = time.monotonic()
    newer = server.send(server.request("/plan", {"q_min": 18}, "own"))
    assert "was replaced by a newer plan of the same page" in answer_on(older)["error"]["message"]
    assert "error" not in answer_on(newer)
    assert time.monotonic() - start < PLENTY_S
    other.settimeout(0.2)
    with pytest.raises(TimeoutError):
        other.recv(1)
    for line in (other, older, newer):
        line.close()


def test_a_plan_that_takes_too_long_is_given_up(tmp_path):
    """The page then comes without a plan, and tells why."""
    (tmp_path / "slow.toml").write_text(
        'name = "slow"\nresolution = 32\nband_hz = [50, 200]\nq_min = 15\ndrive = "endless"\n'
    )
    with patient(tmp_path, tmp_path / "slow.toml", ("--time-limit", "5")) as server:
        told = "took longer than 5 s"
        status, text = server.ask("/", None, "GET")
        assert status == 200 and told in text and "window.padgenForm = " in text
        assert "error" not in server.call("plan", {"drive.scheme": "tones"})[1]
        server.stop()


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_everything_under_way(tmp_path, end):
    with patient(tmp_path) as server:
        lines = [server.send(server.request(path, SLOW)) for path in ("/plan", "/scene", "/build", "/plan")]
        wait_until(lambda: len(at_work(server)) > PLANNERS + 1)  # with those that save and build
        lines += [server.send(server.request("/plan", {})[:size]) for size in (1, 60, -1)]
        workers = at_work(server)
        start = time.monotonic()
        server.process.send_signal(end)
        server.process.communicate(timeout=PLENTY_S)
        # A second, were nobody else at work here; a plan would have taken a quarter of an hour.
        assert time.monotonic() - start < PLENTY_S / 3
        wait_until(lambda: not any(map(alive, workers)))
        assert "Traceback" not in server.told.read_text()
        assert not list(tmp_path.rglob("*.json"))
        for line in lines:
            line.close()


IMPATIENT = """
import sys
from pathlib import Path
from padgen.report.live import serve
serve("paper-32", Path(sys.argv[1]), 0, lambda address: print(address, flush=True), 20, request_s=0.5)
"""


def test_half_sent_requests_are_dropped(tmp_path):
    """Wherever they stop, even if single bytes keep coming; also more of them than there may be connections."""
    with Server(tmp_path, own=("-c", IMPATIENT, str(tmp_path))) as server:
        whole = server.request("/plan", {"q_min": 16})
        lines = [server.send(whole[: len(whole) * share // 100]) for share in (0, 1, 20, 90, 99) for _ in range(10)]

        def is_hung_up(line):
            try:
                return line.recv(1) == b""
            except ConnectionResetError:
                return True

        drip = server.send(whole[:20])
        with pytest.raises(OSError):
            for byte in whole[20:]:
                drip.send(bytes([byte]))
                time.sleep(0.1)
        assert all(map(is_hung_up, lines))
        many = [server.send(b"POST") for _ in range(MOST_CONNECTIONS + 20)]
        assert all(map(is_hung_up, many))
        for line in (drip, *lines, *many):
            line.close()
        # A whole one is answered, although its plan comes later than a half one is dropped; and nothing was printed.
        assert "error" not in server.call("plan", {"q_min": 16})[1]
        server.stop()
        assert server.told.read_text() == ""


def test_clients_that_go_away_are_no_news(slow_server):
    server = slow_server
    for path in ("/plan", "/save", "/progress", "/"):
        whole = server.request(path, {})
        for size in (10, len(whole) - 1, len(whole)):
            server.send(whole[:size]).close()
    server.send(b"\x16\x03\x01 nonsense\r\n\r\n").close()
    assert server.call("progress", {})[0] == 200
    assert server.told.read_text() == ""


SAVED = """
import sys
from pathlib import Path
from padgen.report.live import Live
from padgen.spec.load import find_spec, read_table

def saved(folder, number):
    path = find_spec("paper-32")
    live = Live(read_table(path, "paper-32"), path.parent, folder)
    return live.save({"name": f"own-{number % 10}", "q_min": 15 + number % 10})["written"]
"""


def test_a_hundred_threads_save_at_once(tmp_path):
    """Ten names, ten times each: all succeed, and every file is whole."""
    names = {}
    exec(SAVED, names)
    with ThreadPoolExecutor(100) as threads:
        written = set(threads.map(lambda number: names["saved"](tmp_path, number), range(100)))
    check_saved(tmp_path, written)


@pytest.mark.soak
def test_eight_processes_save_at_once(tmp_path):
    command = [
        sys.executable,
        "-c",
        f"{SAVED}\nfor number in range(10):\n    saved(Path(sys.argv[1]), number)",
        tmp_path,
    ]
    started = [subprocess.Popen(command) for _ in range(8)]
    assert [process.wait(120) for process in started] == [0] * 8
    check_saved(tmp_path, {str(tmp_path / f"own-{number}.toml") for number in range(10)})


def check_saved(folder, written):
    assert {str(path) for path in folder.glob("*.toml")} == written
    assert len(written) == 10
    for path in written:
        number = int(Path(path).stem.removeprefix("own-"))
        assert read_table(Path(path), path)["q_min"] == 15 + number
    assert not list(folder.glob(f"{PARTIAL}*")) and not list(folder.glob("*.old"))
    assert set(json.loads((folder / MANIFEST).read_text())["files"]) == {Path(path).name for path in written}


def test_many_saves_at_once_through_the_page(server):
    with ThreadPoolExecutor(30) as threads:
        answers = list(
            threads.map(lambda k: server.call("save", {"name": f"many-{k % 15}", "q_min": 15 + k}), range(30))
        )
    assert all(status == 200 and "error" not in data for status, data in answers)
    assert {Path(data["written"]).name for _, data in answers} == {f"many-{k}.toml" for k in range(15)}


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
        told = []
        asked = []
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
        marked = "document.getElementById('field-resolution').getAttribute('aria-invalid')"
        faded = "Number(getComputedStyle(document.getElementById('verdict')).opacity)"
        assert page.evaluate(marked) == "true" and page.evaluate(faded) < 0.6
        page.evaluate(PLANNED, ["pad.width_mm", "number", "52"])
        assert not page.evaluate("document.body.classList.contains('refused')")
        assert page.evaluate(marked) is None and page.evaluate(faded) == 1
        labels = {name: page.text_content(f"label[for='field-{name}']") for name in ("q_min", "pad.width_mm")}
        assert labels == {"q_min": "smallest Q", "pad.width_mm": "width, mm"}
        assert page.evaluate("padgen.view().drawNow(), linked") == linked > 0
        asked.clear()
        last = page.evaluate(BURST, list(range(500, 600, 5)))
        assert page.evaluate("padgen.data.spec.q_min") == last > 15
        assert asked.count("/plan") == 2, "the first of twenty moves and the last"
        plan = pg.plan("paper-32", q_min=last, pad={"width_mm": 52})
        assert page.text_content("#verdict span:last-child") == plan.verdict.sentence
        running.close()
    assert told == []


def test_a_spec_without_a_plan_shows_its_form_and_is_mended_there(tmp_path):
    """The reason stands where the verdict would; once the fields make a pad, the page shows it."""
    spec = tmp_path / "crowded.toml"
    spec.write_text(Path(find_spec("paper-32")).read_text().replace("resolution = 32", "resolution = 4096"))
    with Server(tmp_path, spec) as server:
        reason = server.call("plan", {})[1]["error"]["message"]
        assert "4096 taxels" in reason
        with sync_playwright() as playwright:
            running = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
            page = running.new_page(viewport={"width": 1280, "height": 860})
            told = []
            hear(page, told)
            assert page.goto(server.address, timeout=1000 * LATE_S).status == 200
            assert reason in page.text_content("#verdict")
            assert not page.locator("#view").is_visible()
            page.fill("#field-resolution", "3000")
            page.dispatch_event("#field-resolution", "change")
            wait_until(lambda: "3000 taxels" in page.text_content("#verdict"))
            page.fill("#field-resolution", "32")
            page.dispatch_event("#field-resolution", "change")
            wait_until(lambda: page.locator("#view").is_visible())
            assert page.text_content("#verdict span:last-child") == pg.plan("paper-32").verdict.sentence
            assert page.input_value("#field-resolution") == "32"
            page.evaluate(PLANNED, ["q_min", "number", "16"])
            plan = pg.plan("paper-32", q_min=16)
            assert page.text_content("#verdict span:last-child") == plan.verdict.sentence
            running.close()
        server.stop()
        assert told == [] and server.told.read_text() == ""


CHOOSE = """(scheme) => {
  const box = document.getElementById("field-drive");
  box.value = scheme;
  box.dispatchEvent(new Event("change"));
}"""


def test_a_slow_plan_is_given_up_for_a_newer_move(slow_server):
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        page = running.new_page(viewport={"width": 1280, "height": 860})
        page.goto(slow_server.address, timeout=1000 * LATE_S)
        for scheme in ("endless", "tones"):
            page.evaluate(CHOOSE, scheme)
            page.wait_for_timeout(200)
        wait_until(lambda: page.evaluate("padgen.data.motion.scheme") == "tones")
        assert not page.locator("#live .status").is_visible()
        running.close()
