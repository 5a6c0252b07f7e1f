"""Serve a pad's page on this machine: every change of a field plans anew, and buttons save the spec and build.

Only this machine is served, and only a page that brings the token of its own address: another page in the same browser
can neither read nor ask for anything (Host, Origin and token are checked before a request is looked at).

This process only answers: plans, saves and builds run in worker processes. So a plan that takes too long, that a newer
one of the same page replaces, or whose page has gone is ended with its worker, and another worker is ready.
"""

import asyncio
import gc
import json
import logging
import secrets
from collections.abc import Callable, Coroutine, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import lru_cache
from html import escape
from importlib import import_module
from math import inf
from pathlib import Path
from threading import Event
from types import TracebackType
from typing import Any

from padgen.core.errors import EngineMissingError, PadgenError, SolverError, SpecError, number
from padgen.core.files import OutputFolder, json_line
from padgen.core.runner import Answer, Runner, tell
from padgen.make.pad import Pad
from padgen.make.planning import plan_for
from padgen.planner.plan import Plan
from padgen.report.page import page_data, page_html, scene_data
from padgen.spec import Spec, make_spec
from padgen.spec.load import find_spec, laid_over, read_table, spec_schema, without_none

__all__ = ["Live", "serve"]

HOST = "127.0.0.1"
LARGEST_BODY = 65_536
"""Most bytes of a request; all fields of a spec are some 5 kB."""
MOST_CONNECTIONS = 400
"""Most open connections; further ones are closed, so that files can still be opened."""
REQUEST_S = 10.0
"""Longest time in s that the receipt of a request may take."""
END_S = 0.5
"""Longest time in s in which answers under way are still sent when the server ends."""
PLANNERS = 2
IMPORTS = ("padgen.report.live", "padgen.planner")
"""Modules that a worker loads before its first job."""
MOST_OBJECTS = 50_000
"""New objects between two searches for cycles, as in `padgen.cli`: more frequent ones cost a plan 15 ms."""
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
TOKEN_HEADER = "x-padgen-token"
PAGE_HEADER = "x-padgen-page"
"""Headers of a request: the token of the address, and the number by which a page's own requests are known."""


@lru_cache(maxsize=1)
def _plan_of(spec: Spec) -> Plan:
    """Return the plan of a spec; the last one is cached, since a page then asks for the shapes of the same plan."""
    return plan_for(spec)


@dataclass(frozen=True)
class Live:
    """The answers to a page's requests: plan, save and build the spec in `table` with the page's fields laid over it.

    `folder` is where files go (the spec as NAME.toml, a built pad as NAME/), `home` where those are that a spec names.
    """

    table: dict[str, Any]
    home: Path
    folder: Path

    def spec(self, fields: Mapping[str, Any]) -> Spec:
        """Return the spec with `fields`, by their dotted names, changed."""
        return make_spec(self._changed(fields), self.home)

    def _changed(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        if not isinstance(fields, Mapping):
            raise SpecError("must be a table of fields by their dotted names", "fields")
        for name, value in fields.items():
            if isinstance(value, Mapping):
                raise SpecError("must be one field, by its dotted name, got a table", name)
            # A spec file may name files beside it; a page may name none.
            if name == "drive.threshold_file" or (isinstance(value, str) and value.endswith(".toml")):
                raise SpecError("names a file; only the spec that this was started with may", name)
        return laid_over(self.table, dict(fields))

    def page(self, fields: Mapping[str, Any]) -> str:
        """Return the page with the form and the plan of the changed spec."""
        plan = _plan_of(self.spec(fields))
        return _page(plan.spec, fields, {**page_data(plan, live=True), **scene_data(plan)}, None)

    def bare_page(self, fields: Mapping[str, Any], error: PadgenError) -> str:
        """Return the form without a plan, `error` in the verdict's place; the original form for invalid `fields`."""
        try:
            spec = self.spec(fields)
        except PadgenError:
            # These do not even make a spec, so the form is that of the unchanged one.
            fields = {}
            spec = self.spec(fields)
        return _page(spec, fields, None, error)

    def plan(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        """Return the page's figures for the plan of the changed spec."""
        return page_data(_plan_of(self.spec(fields)), live=True)

    def scene(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        """Return the rest of the page's data for the plan of the changed spec: shapes and masses."""
        return scene_data(_plan_of(self.spec(fields)))

    def save(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        """Write the changed spec as NAME.toml and return its path."""
        import tomli_w

        name = f"{self.spec(fields).name}.toml"
        with OutputFolder(self.folder) as out:
            out.write(name, tomli_w.dumps(without_none(self._changed(fields))))
            out.commit()
        return {"written": str(self.folder / name)}

    def check(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        """Raise `PadgenError` if the fields make no valid spec; return an empty answer."""
        self.spec(fields)
        return {}

    def build(self, fields: Mapping[str, Any]) -> str:
        """Build the changed spec's pad, report each step to the worker's listener, and return the pad's page."""
        spec = self.spec(fields)
        pad = Pad(spec, progress=tell)
        folder = pad.save(self.folder / spec.name).folder
        tell(f"written: {folder}")
        return page_html(page_data(pad.plan, pad))


def _page(spec: Spec, fields: Mapping[str, Any], data: dict[str, Any] | None, error: PadgenError | None) -> str:
    """Return the page with a form of `spec`, in which `fields` are changed, and its plan's `data` or the `error`."""
    here = Path(__file__).parent / "page"
    message = error and _told(error)
    form = json.dumps({"schema": spec_schema(), "values": asdict(spec), "changed": dict(fields), "error": message})
    # "<" is escaped, as a name might end the script.
    escaped = form.replace("<", "\\u003c")
    script = f"window.padgenForm = {escaped};\n{(here / 'explore.js').read_text(encoding='utf-8')}"
    style = (here / "explore.css").read_text(encoding="utf-8")
    return page_html(data or {"name": spec.name}, script=script, style=style, connect=True, drawn=data is not None)


def _told(error: PadgenError) -> dict[str, str]:
    return {"where": error.where, "message": error.message}


def _fields(body: bytes) -> Any:
    """Return the fields of the spec that a request's body holds as JSON.

    Raises
    ------
    SpecError
        It is not JSON.
    """
    try:
        return json.loads(body or b"{}")
    except (ValueError, RecursionError, MemoryError) as error:
        raise SpecError(f"are not JSON that can be read ({error})", "fields") from error


# What workers do.


def _call_live(live: Live, name: str, body: bytes) -> str:
    """Call the method `name` of `live` with the fields in a request's body; return a page, or else JSON."""
    gc.set_threshold(MOST_OBJECTS)
    answer = getattr(live, name)(_fields(body))
    return answer if isinstance(answer, str) else json_line(answer)


def _bare_page(live: Live, body: bytes, error: PadgenError) -> str:
    """Return the page without a plan; fields that cannot be read are left out."""
    fields = {}
    with suppress(PadgenError):
        fields = _fields(body)
    return live.bare_page(fields, error)


def _built(live: Live, body: bytes) -> str:
    return live.build(_fields(body))


class Work:
    """The work for all pages, in worker processes: at most `PLANNERS` plans, a save and a build at a time.

    A plan is ended as soon as nobody waits for it: after `plan_s`, when its page asks for another, when the page has
    gone, or at the end of the server. A context manager that ends everything.
    """

    def __init__(self, live: Live, plan_s: float) -> None:
        self.live = live
        self.plan_s = plan_s
        self._planners = Runner(PLANNERS, IMPORTS, inf)
        self._savers = Runner(1, IMPORTS, inf)
        self._builders = Runner()
        self._planners.prepare(PLANNERS)
        # Why the answer to each request under way is not wanted any more; by a page's number, its newest.
        self._ends: set[asyncio.Future[str]] = set()
        self._newest: dict[str, asyncio.Future[str]] = {}
        self._build: Future[Answer] | None = None
        self._steps: list[str] = []

    def __enter__(self) -> "Work":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End all work, even plans and builds under way, whose files stay as they were."""
        for end in tuple(self._ends):
            _end(end, "was ended with padgen explore")
        for runner in (self._planners, self._savers, self._builders):
            runner.close()

    async def planned(self, name: str, body: bytes, page: str, gone: Coroutine[Any, Any, None]) -> Answer:
        """Return the answer of a `Live` method that plans; stop the work once `gone` returns, as the page has gone.

        A page's newer call ends its older one, where `page` is its number.
        """
        end = asyncio.get_running_loop().create_future()
        if page:
            if page in self._newest:
                _end(self._newest[page], "was replaced by a newer plan of the same page")
            self._newest[page] = end
        leaving = asyncio.ensure_future(gone)
        leaving.add_done_callback(lambda _: _end(end, "was ended, since its page has gone"))
        try:
            return await self._run_in_worker(end, self._planners, _call_live, self.live, name, body)
        finally:
            leaving.cancel()
            if self._newest.get(page) is end:
                del self._newest[page]

    async def saved(self, name: str, body: bytes) -> Answer:
        """Return the answer of a quick method of `Live`, such as to save; finish it even if the page has gone."""
        return await self._run_in_worker(None, self._savers, _call_live, self.live, name, body)

    async def bare_page(self, body: bytes, error: PadgenError) -> Answer:
        """Return the page with the form and the `error` in place of a plan."""
        return await self._run_in_worker(None, self._savers, _bare_page, self.live, body, error)

    async def _run_in_worker(
        self, end: "asyncio.Future[str] | None", runner: Runner, function: Callable[..., str], *arguments: Any
    ) -> Answer:
        """Run `function` in a worker and return its answer, or a failure once `end` is set or time is up."""
        loop = asyncio.get_running_loop()
        end = end or loop.create_future()
        wanted = Event()
        wanted.set()
        job = runner.submit(function, *arguments, wanted=wanted.is_set)
        # A worker that was ended is replaced at once, so that no later plan waits for its start.
        job.add_done_callback(lambda _: None if wanted.is_set() else self._planners.prepare(PLANNERS))
        limit = f"took longer than {number(self.plan_s)} s, with its wait for others; --time-limit sets another limit"
        timer = loop.call_later(self.plan_s, _end, end, limit)
        self._ends.add(end)
        answer = asyncio.wrap_future(job)
        try:
            either: set[asyncio.Future[Any]] = {answer, end}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            if not answer.done():
                wanted.clear()
                answer.cancel()
                return Answer("failed", None, SolverError(end.result(), "plan"), limit="wanted")
            return answer.result()
        except PadgenError as error:
            return Answer("failed", None, error)
        finally:
            timer.cancel()
            self._ends.discard(end)

    def build(self, body: bytes) -> dict[str, Any]:
        """Start to build a pad, whose fields were checked; `progress` tells how far it is.

        Raises
        ------
        PadgenError
            Another one is being built.
        """
        if self._build and not self._build.done():
            raise PadgenError("a pad is being built; wait until it is done", "build")
        steps = self._steps = []
        self._build = self._builders.submit(_built, self.live, body, hear=steps.append)
        return self.progress()

    def progress(self) -> dict[str, Any]:
        """Return the steps of the running build, whether it is done, and why it failed if it did."""
        built = self._built()
        done = self._build is None or self._build.done()
        error = built.error and _told(built.error)
        return {"steps": list(self._steps), "done": done, "error": error, "report": bool(built.value)}

    def report(self) -> str:
        """Return the page of the pad that was built last; empty if there is none."""
        return self._built().value or ""

    def _built(self) -> Answer:
        """Return the answer of the finished build; an answer without a value if no build has finished."""
        if self._build is None or not self._build.done():
            return Answer("value")
        try:
            return self._build.result()
        except PadgenError as error:
            return Answer("failed", None, error)


def _end(end: "asyncio.Future[str]", reason: str) -> None:
    if not end.done():
        end.set_result(reason)


def application(work: Work, token: str, port: int) -> Any:
    """Return the web application (ASGI) for `port` of this machine, which answers only requests with the `token`."""
    from starlette.applications import Starlette
    from starlette.exceptions import HTTPException
    from starlette.requests import ClientDisconnect, Request
    from starlette.responses import HTMLResponse, Response
    from starlette.routing import Route

    hosts = {f"{name}:{port}" for name in (HOST, "localhost")}

    def check(request: Request) -> None:
        """Refuse a request that does not come from this page."""
        host = request.headers.get("host", "")
        origin = request.headers.get("origin")
        given = request.headers.get(TOKEN_HEADER) or request.query_params.get("token", "")
        if host not in hosts or (origin is not None and origin.removeprefix("http://") not in hosts):
            raise HTTPException(403, "this address is served to its own page only", HEADERS)
        if not secrets.compare_digest(given.encode(errors="replace"), token.encode()):
            raise HTTPException(403, "the token is wrong; open the address that padgen explore printed", HEADERS)

    async def body_of(request: Request) -> bytes:
        body = bytearray()
        async for part in request.stream():
            body += part
            if len(body) > LARGEST_BODY:
                raise HTTPException(413, f"at most {LARGEST_BODY} bytes are read", HEADERS)
        return bytes(body)

    async def gone(request: Request) -> None:
        """Wait until the client disconnects; to be called after the request's body was read."""
        while (await request.receive())["type"] != "http.disconnect":
            pass

    async def index(request: Request) -> Response:
        await body_of(request)
        fields = request.query_params.get("fields", "{}").encode(errors="replace")
        answer = await work.planned("page", fields, "", gone(request))
        if answer.error:
            answer = await work.bare_page(fields, answer.error)
        return HTMLResponse(answer.value or escape(answer.sentence), 200, HEADERS)

    async def report(request: Request) -> Response:
        if html := work.report():
            return HTMLResponse(html, 200, HEADERS)
        raise HTTPException(404, "not built yet", HEADERS)

    async def planned(request: Request) -> str:
        page = request.headers.get(PAGE_HEADER, "")
        name = request.url.path.removeprefix("/")
        return text_of(await work.planned(name, await body_of(request), page, gone(request)))

    async def save(request: Request) -> str:
        return text_of(await work.saved("save", await body_of(request)))

    async def build(request: Request) -> str:
        body = await body_of(request)
        text_of(await work.saved("check", body))
        return json_line(work.build(body))

    async def progress(request: Request) -> str:
        await body_of(request)
        return json_line(work.progress())

    def text_of(answer: Answer) -> str:
        """Return the text of an answer, or raise the error that it holds."""
        if answer.error:
            raise answer.error
        return str(answer.value)

    def answering(function: Callable[[Request], Coroutine[Any, Any, Response | str]]) -> Any:
        """Wrap a handler: check each request; answer errors as JSON with status 200 (browsers log other statuses)."""

        async def answer(request: Request) -> Response:
            check(request)
            try:
                text = await function(request)
            except ClientDisconnect:
                text = ""  # which nobody reads
            except HTTPException:
                raise
            except PadgenError as error:
                text = json_line({"error": _told(error)})
            except Exception as error:  # a fault of padgen, which is no reason to answer nothing
                text = json_line({"error": {"where": "", "message": f"broke down ({type(error).__name__}: {error})"}})
            return text if isinstance(text, Response) else Response(text, 200, HEADERS, "application/json")

        return answer

    routes = [Route("/", answering(index)), Route("/report", answering(report))]
    calls = {"plan": planned, "scene": planned, "save": save, "build": build, "progress": progress}
    routes += [Route(f"/{name}", answering(function), methods=["POST"]) for name, function in calls.items()]
    return Starlette(routes=routes)


def _web_server(work: Work, token: str, port: int, request_s: float) -> Any:
    """Return the web server (uvicorn's) of the application.

    It hangs up on a request that is not whole after `request_s`, which uvicorn does not, and ends all work first when
    it is to end.
    """
    import h11
    import uvicorn
    from uvicorn.protocols.http.h11_impl import H11Protocol

    class Protocol(H11Protocol):
        timer: asyncio.TimerHandle | None = None

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            if len(self.connections) > MOST_CONNECTIONS:
                transport.abort()
            self.watch()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            self.watch()

        def on_response_complete(self) -> None:
            super().on_response_complete()
            self.watch()

        def connection_lost(self, exc: Exception | None) -> None:
            super().connection_lost(exc)
            self.rest()

        def watch(self) -> None:
            """Limit the time of an incomplete request, however many bytes come; stop the timer once complete."""
            if self.conn.their_state not in (h11.IDLE, h11.SEND_BODY):
                self.rest()
            elif self.timer is None:
                self.timer = self.loop.call_later(request_s, self.transport.abort)

        def rest(self) -> None:
            if self.timer is not None:
                self.timer.cancel()
            self.timer = None

    class Server(uvicorn.Server):
        async def shutdown(self, sockets: Any = None) -> None:
            work.close()
            await super().shutdown(sockets)

    config = uvicorn.Config(
        application(work, token, port),
        http=Protocol,
        ws="none",
        lifespan="off",
        access_log=False,
        # Clients that go away or send nonsense are no news to who runs this, and faults are told to the page.
        log_level="critical",
        timeout_keep_alive=int(max(request_s, 1)),
        timeout_graceful_shutdown=END_S,  # type: ignore[arg-type]
    )
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)
    return Server(config)


def serve(
    spec: str,
    folder: Path,
    port: int,
    ready: Callable[[str], None],
    plan_s: float,
    request_s: float = REQUEST_S,
) -> None:
    """Serve the page of `spec` until Ctrl-C; `ready` gets its address once it answers.

    `port` 0 takes a free one. A plan may take `plan_s`, its wait for others included, the receipt of a request
    `request_s`.

    Raises
    ------
    SpecError, FileError
        The spec cannot be read, or the port is taken.
    EngineMissingError
        The extra ``explore`` is not installed.
    """
    import socket

    try:
        for name in ("starlette", "tomli_w", "uvicorn"):
            import_module(name)
    except ImportError as error:
        raise EngineMissingError("needs the extra explore: pip install 'padgen[explore]'", "explore") from error

    path = find_spec(spec)
    live = Live(read_table(path, spec), path.parent, folder)
    live.spec({})
    token = secrets.token_urlsafe(24)
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((HOST, port))
        except OSError as error:
            raise SpecError(f"{port} cannot be used ({error.strerror}); 0 takes a free one", "--port") from error
        port = listener.getsockname()[1]
        with Work(live, plan_s) as work:
            server = _web_server(work, token, port, request_s)
            listener.listen()
            ready(f"http://{HOST}:{port}/?token={token}")
            server.run(sockets=[listener])
