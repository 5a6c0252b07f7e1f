"""Serve a pad's page on this machine: every change of a field plans anew, and buttons save the spec and build.

Only this machine is served, and only a page that brings the token of its own address: another page in the same browser
can neither read nor ask for anything (Host, Origin and token are checked before a request is looked at).
"""

import json
import secrets
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from importlib import import_module
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from padgen.core.errors import EngineMissingError, PadgenError, SpecError
from padgen.core.files import OutputFolder, json_line
from padgen.make.pad import Pad
from padgen.make.planning import plan_for
from padgen.planner.plan import Plan
from padgen.report.page import page_data, page_html, scene_data
from padgen.spec import Spec, make_spec
from padgen.spec.load import find_spec, laid_over, read_table, spec_schema

__all__ = ["Live", "serve"]

HOST = "127.0.0.1"
LARGEST_BODY = 65_536
"""Most bytes of a request; all fields of a spec are some 5 kB."""
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
TOKEN_HEADER = "x-padgen-token"


@dataclass
class _Build:
    """A build that runs beside the page: its steps so far, then the page of the pad or why there is none."""

    steps: list[str] = field(default_factory=list)
    done: bool = False
    error: dict[str, str] | None = None
    html: str = ""


@dataclass
class Live:
    """The answers to a page's requests: plan, save and build the spec in `table` with the page's fields laid over it.

    `folder` is where files go (the spec as NAME.toml, a built pad as NAME/), `home` where those are that a spec names.
    """

    table: dict[str, Any]
    home: Path
    folder: Path
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    _build: _Build | None = None
    _last: tuple[str, Plan] | None = None
    _lock: Lock = field(default_factory=Lock)

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

    def index(self) -> str:
        """Return the page with the form and the plan of the unchanged spec."""
        plan = self._planned({})
        here = Path(__file__).parent / "page"
        # "<" is escaped, as a name might end the script.
        form = json.dumps({"schema": spec_schema(), "values": asdict(plan.spec)}).replace("<", "\\u003c")
        script = f"window.padgenForm = {form};\n{(here / 'explore.js').read_text(encoding='utf-8')}"
        style = (here / "explore.css").read_text(encoding="utf-8")
        data = {**page_data(plan, live=True), **scene_data(plan)}
        return page_html(data, script=script, style=style, connect=True)

    def _planned(self, fields: Mapping[str, Any]) -> Plan:
        """Return the plan of the changed spec; the last one is kept, since a page asks for its scene next."""
        last, told = self._last, repr(fields)
        if last is None or last[0] != told:
            last = self._last = told, plan_for(self.spec(fields))
        return last[1]

    def plan(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        """Return the page's figures for the plan of the changed spec."""
        return page_data(self._planned(fields), live=True)

    def scene(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        """Return the rest of the page's data for the plan of the changed spec: shapes and masses."""
        return scene_data(self._planned(fields))

    def save(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        """Write the changed spec as NAME.toml and return its path."""
        import tomli_w

        name = f"{self.spec(fields).name}.toml"
        with OutputFolder(self.folder) as out:
            out.write(name, tomli_w.dumps(self._changed(fields)))
            out.commit()
        return {"written": str(self.folder / name)}

    def build(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        """Start to build the changed spec's pad; `progress` tells how far it is."""
        spec = self.spec(fields)
        with self._lock:
            if self._build and not self._build.done:
                raise PadgenError("a pad is being built; wait until it is done", "build")
            job = self._build = _Build()
        Thread(target=self._work, args=(job, spec), daemon=True).start()
        return self.progress({})

    def _work(self, job: _Build, spec: Spec) -> None:
        try:
            pad = Pad(spec, progress=job.steps.append)
            folder = pad.save(self.folder / spec.name).folder
            job.steps.append(f"written: {folder}")
            job.html = page_html(page_data(pad.plan, pad))
        except Exception as error:  # the page must learn of it, whatever it is
            job.error = _told(error)
        job.done = True

    def progress(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        """Return the steps of the running build, whether it is done, and why it failed if it did."""
        job = self._build or _Build(done=True)
        return {"steps": list(job.steps), "done": job.done, "error": job.error, "report": bool(job.html)}

    def report(self) -> str:
        """Return the page of the pad that was built last; empty if there is none."""
        return self._build.html if self._build else ""

    def app(self, port: int) -> Any:
        """Return the web application (ASGI) that answers at this port of this machine."""
        from starlette.applications import Starlette
        from starlette.concurrency import run_in_threadpool
        from starlette.exceptions import HTTPException
        from starlette.requests import Request
        from starlette.responses import HTMLResponse, Response
        from starlette.routing import Route

        hosts = {f"{name}:{port}" for name in (HOST, "localhost")}

        def check(request: Request) -> None:
            """Refuse a request that does not come from this page."""
            host, origin = request.headers.get("host", ""), request.headers.get("origin")
            token = request.headers.get(TOKEN_HEADER) or request.query_params.get("token", "")
            if host not in hosts or (origin is not None and origin.removeprefix("http://") not in hosts):
                raise HTTPException(403, "this address is served to its own page only", HEADERS)
            if not secrets.compare_digest(token.encode(), self.token.encode()):
                raise HTTPException(403, "the token is wrong; open the address that padgen explore printed", HEADERS)

        def page(make: Callable[[], str]) -> Any:
            async def answer(request: Request) -> Response:
                check(request)
                if html := await run_in_threadpool(make):
                    return HTMLResponse(html, 200, HEADERS)
                raise HTTPException(404, "not built yet", HEADERS)

            return answer

        def call(function: Callable[[Mapping[str, Any]], dict[str, Any]]) -> Any:
            async def answer(request: Request) -> Response:
                check(request)
                body = bytearray()
                async for part in request.stream():
                    body += part
                    if len(body) > LARGEST_BODY:
                        raise HTTPException(413, f"at most {LARGEST_BODY} bytes are read", HEADERS)
                try:
                    data = await run_in_threadpool(function, json.loads(bytes(body) or b"{}"))
                except (PadgenError, ValueError, RecursionError, MemoryError) as error:
                    data = {"error": _told(error)}  # an answer, too: browsers report other codes as faults
                return Response(json_line(data), 200, HEADERS, "application/json")

            return answer

        calls = (self.plan, self.scene, self.save, self.build, self.progress)
        routes = [Route("/", page(self.index)), Route("/report", page(self.report))]
        routes += [Route(f"/{function.__name__}", call(function), methods=["POST"]) for function in calls]
        return Starlette(routes=routes)


def _told(error: Exception) -> dict[str, str]:
    if isinstance(error, PadgenError):
        return {"where": error.where, "message": error.message}
    return {"where": "", "message": f"{type(error).__name__}: {error}"[:500]}


def serve(spec: str, folder: Path, port: int, ready: Callable[[str], None]) -> None:
    """Serve the page of `spec` until Ctrl-C; `ready` gets its address once it answers.

    `port` 0 takes a free one.

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
    import uvicorn

    path = find_spec(spec)
    live = Live(read_table(path, spec), path.parent, folder)
    live.spec({})
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((HOST, port))
        except OSError as error:
            raise SpecError(f"{port} cannot be used ({error.strerror}); 0 takes a free one", "--port") from error
        port = listener.getsockname()[1]
        config = uvicorn.Config(live.app(port), log_level="error", lifespan="off", access_log=False)
        listener.listen()
        ready(f"http://{HOST}:{port}/?token={live.token}")
        uvicorn.Server(config).run(sockets=[listener])
