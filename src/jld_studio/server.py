"""Run the studio: open a scene, listen on a local port, and stop all searches at the end."""

from __future__ import annotations

import base64
import secrets
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from jld_core import InputError, ParameterError
from jld_core.exchange import ImportOptions, formats
from jld_core.scene import Scene, load_scene, parse_scene
from jld_explore.report import read_folder
from jld_studio.opening import read_file, require_followed, stated
from jld_studio.page_start import first_data
from jld_studio.session import StudioSession
from jld_studio.understanding import understood

START: dict[str, Any] = {
    "name": "a wall to begin with",
    "grid": {"cell": [0.4, 0.2], "thickness": 0.2, "rows": ["aabbcc", "addeec", "ffgghh", "######"]},
    "materials": {
        "density": 2000,
        "dry": {"friction_coefficient": 0.65},
        "inner": {"tensile_strength": 2e5, "shear_strength": 2e5},
    },
    "loads": {"live": [{"body": [1, 0]}]},
}
"""Scene that the studio opens without a source."""

_SENT: Final = 11_500_000  # largest drawing that the page can send back, bytes


def open_studio(
    source: Path | None,
    port: int,
    announce: Callable[[str], None],
    browser: bool,
    options: ImportOptions | None = None,
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
        from jld_studio.app import build_app
    except ImportError as error:
        raise InputError("jld studio", f"{error.name} is not installed", "pip install 'jld[studio]'") from None
    from jld_studio.jobs import Jobs

    scene, root, study = opened(source, options, announce)
    drawing = _drawing(source, options or ImportOptions()) if source is not None and is_drawing(source) else None
    desk = StudioSession(scene)
    listener = _listener(port)
    number = listener.getsockname()[1]
    token = secrets.token_urlsafe(24)
    jobs = Jobs(root, study)
    answers = Api(desk, jobs, root, lambda: first_data(desk, root, study), drawing)
    app = build_app(answers, token, (f"127.0.0.1:{number}", f"localhost:{number}"))
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning", access_log=False, server_header=False))
    address = f"http://127.0.0.1:{number}/{token}/"
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
            found = read_file(source, options or ImportOptions())
        except InputError as error:
            if error.parameter or not is_drawing(source):
                raise
            understood(source, options or ImportOptions(), {})
            announce(f"not opened   {error}")
            return parse_scene(START), source.with_name(f"{source.stem}_studio"), None
        if not plain and not found.unit:
            raise InputError(str(source), "it is a scene, which is read as it is", "a drawing, or no options of layers")
        for kind, text in found.report:
            announce(f"{kind:<12} {text}")
        return found.scene, source.with_name(f"{source.stem}_studio"), None
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
