"""Run the studio: open a scene, listen on a local port, and stop all searches at the end."""

from __future__ import annotations

import base64
import json
import secrets
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import anyio
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from jld_core import InputError, ParameterError, Scene, SolverError, load_scene, parse_scene
from jld_explore import read_folder
from jld_formats import ImportOptions, formats
from jld_studio.api import Api
from jld_studio.jobs import evaluate
from jld_studio.opening import read_file, require_followed, stated, understood
from jld_studio.session import StudioSession, first_data
from jld_views import page_data

START: dict[str, Any] = {  # scene that the studio opens without a source
    "name": "a wall to begin with",
    "grid": {"cell": [0.4, 0.2], "thickness": 0.2, "rows": ["aabbcc", "addeec", "ffgghh", "######"]},
    "materials": {
        "density": 2000,
        "dry": {"friction_coefficient": 0.65},
        "inner": {"tensile_strength": 2e5, "shear_strength": 2e5},
    },
    "loads": {"live": [{"body": [1, 0]}]},
}

_SENT: Final = 11_500_000  # largest drawing that the page can send back, bytes


def open_studio(
    source: Path | None, port: int, announce: Callable[[str], None], browser: bool, options: ImportOptions | None = None
) -> None:
    """Serve the studio on 127.0.0.1 until it is interrupted.

    Parameters
    ----------
    source : Path or None
        Scene file, drawing, file of solids, folder written by `jld explore`, or None for a sample wall.
    port : int
        Port; 0 takes a free one.
    announce : callable
        Function called with the address.
    browser : bool
        Open the address in a browser.
    options : ImportOptions, optional
        How a drawing or a file of solids is read.

    Raises
    ------
    InputError
        If the source cannot be opened, the port is taken, or the extra `studio` is not installed.
    """
    try:
        import uvicorn

        from jld_studio.api import Api
    except ImportError as error:
        raise InputError("jld studio", f"{error.name} is not installed", "pip install 'jld[studio]'") from None
    from jld_studio.jobs import Jobs

    scene, root, study = opened(source, options, announce)
    drawing = _drawing(source, options or ImportOptions()) if source is not None and is_drawing(source) else None
    session = StudioSession(scene)
    listener = _listener(port)
    port_number = listener.getsockname()[1]
    token = secrets.token_urlsafe(24)
    jobs = Jobs(root, study)
    api = Api(session, jobs, root, lambda: first_data(session, root, study), drawing)
    app = build_app(api, token, (f"127.0.0.1:{port_number}", f"localhost:{port_number}"))
    config = uvicorn.Config(
        app, log_level="warning", access_log=False, server_header=False, timeout_graceful_shutdown=_LAST_ANSWERS
    )
    server = uvicorn.Server(config)
    address = f"http://127.0.0.1:{port_number}/{token}/"
    announce(address)
    if browser:
        import webbrowser

        webbrowser.open(address)
    try:
        with _interrupting(signal.SIGTERM):
            server.run(sockets=[listener])
    finally:
        jobs.close()
        listener.close()


_LAST_ANSWERS: Final = 5  # time in which answers that are under way may end, s


@contextmanager
def _interrupting(number: int) -> Iterator[None]:
    """Let a signal end this process as Ctrl-C does, with cleanup; main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(_: int, __: object) -> None:
        raise KeyboardInterrupt

    # uvicorn shuts down at the signal and then raises it again for the previous handler.
    before = signal.signal(number, stop)
    try:
        yield
    finally:
        signal.signal(number, before)


def opened(
    source: Path | None, options: ImportOptions | None = None, announce: Callable[[str], None] = print
) -> tuple[Scene, Path, Path | None]:
    """Return the scene to open, by default a sample wall, the folder for files, and the study's folder or None."""
    plain = options is None or options == ImportOptions()
    if source is not None and not source.is_dir() and (not plain or is_drawing(source)):
        try:
            file = read_file(source, options or ImportOptions())
        except InputError as error:
            if error.parameter or not is_drawing(source):
                raise
            understood(source, options or ImportOptions(), {})
            announce(f"not opened   {error}")
            return parse_scene(START), source.with_name(f"{source.stem}_studio"), None
        if not plain and not file.unit:
            raise InputError(str(source), "it is a scene, which is read as it is", "a drawing, or no options of layers")
        for kind, text in file.report:
            announce(f"{kind:<12} {text}")
        return file.scene, source.with_name(f"{source.stem}_studio"), None
    if not plain:
        raise InputError(str(source or "jld studio"), "there is no drawing to read by layers", "a drawing")
    if source is None:
        return parse_scene(START), Path("studio"), None
    scene = read_folder(source).scene if source.is_dir() else load_scene(source)
    require_followed(scene, str(source))
    if source.is_dir():
        return scene, source / "studio", source
    return scene, source.with_name(f"{source.stem}_studio"), None


def is_drawing(source: Path) -> bool:
    """Return True for a drawing or a file of solids, by the ending of its name."""
    return not source.is_dir() and source.suffix.lower().lstrip(".") in set(formats.readers()) - {"json"}


def _drawing(source: Path, options: ImportOptions) -> dict[str, Any] | None:
    """Return name, content and options of a drawing for the page; None for one too large to be sent."""
    data = source.read_bytes()
    if len(data) > _SENT:
        return None
    return {"name": source.name, "content": base64.b64encode(data).decode("ascii"), "options": stated(options)}


def _listener(port: int) -> socket.socket:
    """Return a listening socket; raise InputError if the port cannot be used."""
    # Name the protocol, because asyncio disables Nagle's delay only for sockets that are declared as TCP.
    # A response with separate head and body would otherwise be delayed by 40 ms.
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(("127.0.0.1", port))
        listener.listen()  # a browser may connect before the server is ready
    except (OSError, OverflowError) as error:
        listener.close()
        raise ParameterError("port", f"{port} cannot be opened ({error})", "a free port, or none for any") from None
    return listener


LARGEST: Final = 16_000_000  # largest size of a request, bytes: files of 12 MB in base64

HEADERS: Final = {  # security headers of every response
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cache-control": "no-store",
}


class Guard:
    """ASGI middleware that admits only requests with the right host, origin and token, of at most `LARGEST` bytes."""

    # POST requests need JSON, and an `Origin` of these hosts or none. token: first part of every path.

    def __init__(self, app: ASGIApp, token: str, hosts: tuple[str, ...]) -> None:
        self.app, self.token, self.hosts = app, token, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass an admissible HTTP request to the application, and answer any other with a refusal.

        scope, receive, send: arguments of the ASGI interface. Other kinds of connections are ignored.
        """
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return
        refused = self._refusal(scope)
        if refused is not None:
            await PlainTextResponse(refused[1], status_code=refused[0])(scope, receive, _with_headers(send))
            return
        prefix = f"/{self.token}"
        inside = {**scope, "path": scope["path"][len(prefix) :], "root_path": scope.get("root_path", "")}
        body = await _body(receive) if scope["method"] == "POST" else b""
        if body is None:
            await PlainTextResponse("too large\n", status_code=413)(scope, receive, _with_headers(send))
            return
        message: Message = {"type": "http.request", "body": body, "more_body": False}
        waiting = [message]

        async def once() -> Message:
            return waiting.pop() if waiting else await receive()

        await self.app(inside, once, _with_headers(send))

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Return status code and text of a refusal, None for an admissible request."""
        headers: dict[str, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
        if headers.get("host", []) not in [[host] for host in self.hosts]:
            return 421, "this server answers to 127.0.0.1 only\n"
        origins = headers.get("origin", [])
        if any(origin not in [f"http://{host}" for host in self.hosts] for origin in origins):
            return 403, "not from another page\n"
        if headers.get("sec-fetch-site", ["none"])[0] not in ("none", "same-origin"):
            return 403, "not from another page\n"
        token, slash, _ = scope["path"].removeprefix("/").partition("/")
        if not slash or not secrets.compare_digest(token.encode("utf-8"), self.token.encode("ascii")):
            return 403, "the token is missing; use the whole address that jld studio printed\n"
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return 405, "GET or POST\n"
        if scope["method"] == "POST":
            if headers.get("content-type", [""])[0].partition(";")[0].strip() != "application/json":
                return 415, "JSON only\n"
            length = headers.get("content-length", ["0"])[0]
            if not length.isdigit() or int(length) > LARGEST:
                return 413, "too large\n"
        return None


async def _body(receive: Receive) -> bytes | None:
    """Return the body of a request, None if it is larger than `LARGEST`.

    The actual size counts, whatever the request states as its length.
    """
    parts, size, more = [], 0, True
    while more:
        message = await receive()
        parts.append(message.get("body", b""))
        size += len(parts[-1])
        if size > LARGEST:
            return None
        more = message.get("more_body", False)
    return b"".join(parts)


def _with_headers(send: Send) -> Send:
    """Return a `send` that adds the security headers to every response."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            security = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
            message = {**message, "headers": [*message.get("headers", []), *security]}
        await send(message)

    return sending


KINDS: Final = {"js": "text/javascript", "css": "text/css", "html": "text/html"}
"""Media type by file extension."""


def _json_of(body: bytes) -> dict[str, Any]:
    """Return the JSON object of a request; raise InputError if there is none."""
    try:
        # json raises ValueError for invalid JSON, invalid UTF-8, or a number of thousands of digits.
        content = json.loads(body or b"{}")
    except (ValueError, RecursionError):
        raise InputError("request", "it is not JSON", "one JSON object") from None
    if not isinstance(content, dict):
        raise InputError("request", "it is no JSON object", "an object")
    return content


def build_app(api: Api, token: str, hosts: tuple[str, ...]) -> Guard:
    """Return the web application of the studio: page, front-end files and the API."""

    def calling(call: Callable[[dict[str, Any]], dict[str, Any]]) -> Callable[[Request], Any]:
        async def answer(request: Request) -> Response:
            try:
                content = _json_of(await request.body()) if request.method == "POST" else {}
                return JSONResponse(await anyio.to_thread.run_sync(call, content))
            except InputError as error:
                return JSONResponse({"error": str(error), "key": error.where}, status_code=400)
            except SolverError as error:
                return JSONResponse({"error": str(error)}, status_code=400)
            except OSError as error:
                words = f"{error.filename or 'a file'}: {error.strerror or error}"
                line = f"{words}; expected a place that can be read and written"
                return JSONResponse({"error": line}, status_code=500)

        return answer

    async def page(_: Request) -> Response:
        return HTMLResponse(page_data.asset("studio.html", "studio"))

    ours, shared = page_data.asset_names("studio"), page_data.asset_names()

    async def file(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in ours and name not in shared:
            return Response("no such file\n", status_code=404, media_type="text/plain")
        text = page_data.asset(name, "studio" if name in ours else "report")
        return Response(text, media_type=KINDS[name.rpartition(".")[2]])

    calls: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
        "solve": api.solve,
        "evaluate": evaluate,
        "edit": api.edit,
        "open": api.open,
        "read": api.read,
        "design": api.design,
        "show": api.show,
        "support": api.support,
        "drawing": api.drawing,
        "fields": api.fields,
        "improve": api.improve,
        "start": api.start_job,
        "stop": api.stop_job,
        "resume": api.resume_job,
        "results": api.results,
        "report": api.report,
        "candidates": api.keep,
        "scene": api.scene,
        "export": api.export,
        "save": api.save,
    }
    routes = [
        Route("/", page),
        Route("/assets/{name:path}", file),
        Route("/api/data", calling(api.data)),
        Route("/api/jobs", calling(api.list_jobs)),
        *(Route(f"/api/{name}", calling(call), methods=["POST"]) for name, call in calls.items()),
    ]
    return Guard(Starlette(routes=routes), token, hosts)
