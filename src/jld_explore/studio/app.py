"""Answer the requests of the studio: its page, front-end modules, and JSON under `api/`."""

from __future__ import annotations

import base64
import json
import re
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import anyio
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from jld_core.errors import InputError, SolverError
from jld_core.exchange import FORMATS, Layout, export
from jld_core.exchange.writers import ANALYSED
from jld_core.files import write_text
from jld_explore.report import read_folder
from jld_explore.report.page import asset, asset_names
from jld_explore.report.page_contract import PageData
from jld_explore.report.page_of_study import study_data, study_page
from jld_explore.studio.guard import Guard
from jld_explore.studio.jobs import Jobs, orders_for
from jld_explore.studio.session import StudioSession

KINDS: Final = {"js": "text/javascript", "css": "text/css", "html": "text/html"}
"""Media type by file extension."""
SECONDS: Final = (1.0, 86_400.0)
"""Smallest and largest time limit of a search begun from the page, s."""
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,63}")
"""Names under which a scene may be saved."""
PAGES: Final = 64
"""Number of open pages whose newest revision is remembered."""
CANDIDATES: Final = "candidates.json"
"""File of the candidates that the page keeps."""


class Api:
    """Handlers of the requests of the studio's page, and their state.

    A handler takes the JSON object of a request and returns that of the answer. `build_app` converts InputError to an
    answer with status 400. Requests about a state of the page have "labelling" (letters d and i, one per face) and
    "changes" (parts of the scene that differ).

    Parameters
    ----------
    desk : StudioSession
        Solver of the scene.
    jobs : Jobs
        Searches.
    root : Path
        The only folder into which files are written.
    first : callable
        Function that returns the initial data of the page.
    """

    def __init__(self, desk: StudioSession, jobs: Jobs, root: Path, first: Callable[[], PageData]) -> None:
        self.desk, self.jobs, self.root, self._first = desk, jobs, root, first
        self._newest: OrderedDict[str, int] = OrderedDict()
        self._counting, self._turn = threading.Lock(), threading.Lock()

    def data(self, _: dict[str, Any]) -> dict[str, Any]:
        """Return the data with which the page starts, with the candidates kept earlier.

        Raises InputError if the file of the candidates is damaged.
        """
        kept = self.root / CANDIDATES
        try:
            candidates = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else []
        except ValueError as error:
            raise InputError(str(kept), f"it is damaged ({error})", "a file as the studio left it, or none") from None
        found = self._first()
        return {**found, "studio": {**(found["studio"] or {}), "candidates": candidates}}

    def solve(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Solve a state of the page and return its solution, or that a newer one supersedes it.

        asked: state, "page" (name of the open page) and "revision" (number of the state). The answer has "revision" and
        the entries of `StudioSession.solve`; "superseded" alone where the page has sent a newer revision.
        """
        page, revision = str(asked.get("page", "")), _whole(asked.get("revision"))
        self._note(page, revision)
        with self._turn:
            if self._note(page, revision) > revision:
                return {"revision": revision, "superseded": True}
            return {"revision": revision, **self.desk.solve(asked.get("labelling"), _changes(asked))}

    def fields(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Solve one more mesh of the bounds by fields for a state of the page, and return them.

        asked: as in `solve`. The answer has "revision" and the entries of `StudioSession.fields`; "superseded" alone
        where the page has sent a newer revision.
        """
        page, revision = str(asked.get("page", "")), _whole(asked.get("revision"))
        if self._note(page, revision) > revision:
            return {"revision": revision, "superseded": True}
        return {"revision": revision, **self.desk.fields(asked.get("labelling"), _changes(asked))}

    def improve(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Move joints by some steps from a state of the page, and return the entries of `StudioSession.improve`."""
        return self.desk.improve(asked.get("labelling"), _changes(asked))

    def _note(self, page: str, revision: int) -> int:
        """Record a revision of a page and return the newest one."""
        with self._counting:
            newest = self._newest[page] = max(revision, self._newest.get(page, revision))
            self._newest.move_to_end(page)
            while len(self._newest) > PAGES:
                self._newest.popitem(last=False)
            return newest

    def list_jobs(self, _: dict[str, Any]) -> dict[str, Any]:
        """Return {"jobs": facts of all searches}, each as `Job.told` returns them."""
        return {"jobs": [job.told() for job in self.jobs.listed()]}

    def start_job(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Start a search from a state of the page, and return its facts (`Job.told`).

        asked: state, "kind" ("improve", "prove" or "explore") and "seconds", its time limit, default 3600. Raises
        InputError for anything else, or if too many searches are running.
        """
        kind, seconds = asked.get("kind"), asked.get("seconds", 3600.0)
        if kind not in ("improve", "prove", "explore"):
            raise InputError("kind", f"there is no {str(kind)[:40]!r}", "improve, prove or explore")
        if not isinstance(seconds, int | float) or not SECONDS[0] <= seconds <= SECONDS[1]:
            raise InputError("seconds", f"it is {str(seconds)[:40]}", f"a number from {SECONDS[0]:g} to {SECONDS[1]:g}")
        letters = asked.get("labelling")
        setup = self.desk.setup(_changes(asked))
        self.desk.labels(letters)
        document = setup.scene.model_dump(mode="json", exclude_defaults=True)
        return self.jobs.start(kind, document, orders_for(kind, str(letters), float(seconds))).told()

    def stop_job(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Ask the search of a "name" to stop, and return its facts (`Job.told`)."""
        return self.jobs.stop(str(asked.get("name"))).told()

    def resume_job(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Resume the search of a "name", and return its facts (`Job.told`)."""
        return self.jobs.resume(str(asked.get("name"))).told()

    def results(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Return the data of the page for the results of the search of a "name".

        Raises InputError if there is no such search, or its results are not on disk yet.
        """
        job = self.jobs.find(str(asked.get("name")))
        return {**study_data(read_folder(job.results), patience=0.3)}

    def report(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Return the report of the search of a "name": {"name": file name, "text": HTML}.

        Raises InputError if there is no such search, or its results are not on disk yet.
        """
        job = self.jobs.find(str(asked.get("name")))
        return {"name": f"{job.name}.html", "text": study_page(read_folder(job.results))}

    def keep(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Write the candidates of the page to `candidates.json` in `root`, replacing the file.

        asked: "candidates", a list of at most 500 entries. The answer is {"kept": number of entries}. Raises InputError
        for anything else.
        """
        kept = asked.get("candidates")
        if not isinstance(kept, list) or len(kept) > 500:
            raise InputError("candidates", "it is no list of up to 500", "a list")
        self.root.mkdir(parents=True, exist_ok=True)
        write_text(self.root / CANDIDATES, json.dumps(kept))
        return {"kept": len(kept)}

    def scene(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Return the scene file of a state of the page as a document."""
        return self.desk.scene_with(asked.get("labelling"), _changes(asked))

    def export(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Return a state of the page as a file of another program.

        asked: state, and "format", one of `FORMATS`. The answer is {"name": file name, "content": base64 of the file}.
        Raises InputError for an unknown format, or one that does not fit the layout.
        """
        kind = asked.get("format")
        if kind not in FORMATS:
            raise InputError("format", f"there is no {str(kind)[:40]!r}", "one of " + ", ".join(FORMATS))
        setup, labels = self.desk.setup(_changes(asked)), self.desk.labels(asked.get("labelling"))
        result = setup.solver.solve(labels) if kind in ANALYSED else None
        name = f"layout{FORMATS[str(kind)]}"
        with tempfile.TemporaryDirectory() as folder:
            path = export(Layout(setup.scene, setup.assembly, labels, result), str(kind), Path(folder) / name)
            content = base64.b64encode(path.read_bytes()).decode("ascii")
        return {"name": name, "content": content}

    def save(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Write the scene of a state of the page into `root`.

        asked: state, "name" (a plain file name) and "overwrite". An existing file is replaced only if "overwrite" is
        true. The answer is {"path": file, "exists": True if an existing file was left alone}. Raises InputError for
        another name.
        """
        name = asked.get("name")
        if not isinstance(name, str) or not _NAME.fullmatch(name) or ".." in name:
            raise InputError("name", f"it is {str(name)[:60]!r}", "letters, digits, blanks, '-', '_' and '.'")
        name = name if name.endswith(".json") else f"{name}.json"
        if name == CANDIDATES:
            raise InputError("name", f"{CANDIDATES} is taken", "another name")
        path = self.root / name
        scene = self.scene(asked)
        if path.exists() and asked.get("overwrite") is not True:
            return {"path": str(path), "exists": True}
        self.root.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(scene, indent=1))
        return {"path": str(path), "exists": False}


def _whole(value: object) -> int:
    """Return a revision number; raise InputError if it is not an integer from 0."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise InputError("revision", f"it is {str(value)[:40]!r}", "a whole number from 0")
    return value


def _asked(body: bytes) -> dict[str, Any]:
    """Return the JSON object of a request; raise InputError if there is none."""
    try:
        # json raises ValueError for invalid JSON, invalid UTF-8, or a number of thousands of digits.
        asked = json.loads(body or b"{}")
    except (ValueError, RecursionError):
        raise InputError("request", "it is not JSON", "one JSON object") from None
    if not isinstance(asked, dict):
        raise InputError("request", "it is no JSON object", "an object")
    return asked


def _changes(asked: dict[str, Any]) -> dict[str, Any]:
    """Return the changes of a request; raise InputError if they are not an object."""
    changes = asked.get("changes", {})
    if not isinstance(changes, dict):
        raise InputError("changes", "they are no object", "an object")
    return changes


def build_app(answers: Api, token: str, hosts: tuple[str, ...]) -> Guard:
    """Return the web application of the studio: page, front-end files and the API.

    answers: handlers of the API. token: first part of every path. hosts: admissible values of the header `Host`.
    """

    def calling(call: Callable[[dict[str, Any]], dict[str, Any]]) -> Callable[[Request], Any]:
        async def answer(request: Request) -> Response:
            try:
                asked = _asked(await request.body()) if request.method == "POST" else {}
                return JSONResponse(await anyio.to_thread.run_sync(call, asked))
            except (InputError, SolverError) as error:
                return JSONResponse({"error": str(error)}, status_code=400)
            except OSError as error:
                words = f"{error.filename or 'a file'}: {error.strerror or error}"
                line = f"{words}; expected a place that can be read and written"
                return JSONResponse({"error": line}, status_code=500)

        return answer

    async def page(_: Request) -> Response:
        return HTMLResponse(asset("studio.html", "studio"))

    ours, shared = asset_names("studio"), asset_names()

    async def file(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in ours and name not in shared:
            return Response("no such file\n", status_code=404, media_type="text/plain")
        text = asset(name, "studio" if name in ours else "report")
        return Response(text, media_type=KINDS[name.rpartition(".")[2]])

    calls: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
        "solve": answers.solve,
        "fields": answers.fields,
        "improve": answers.improve,
        "start": answers.start_job,
        "stop": answers.stop_job,
        "resume": answers.resume_job,
        "results": answers.results,
        "report": answers.report,
        "candidates": answers.keep,
        "scene": answers.scene,
        "export": answers.export,
        "save": answers.save,
    }
    routes = [
        Route("/", page),
        Route("/assets/{name:path}", file),
        Route("/api/data", calling(answers.data)),
        Route("/api/jobs", calling(answers.list_jobs)),
        *(Route(f"/api/{name}", calling(call), methods=["POST"]) for name, call in calls.items()),
    ]
    return Guard(Starlette(routes=routes), token, hosts)
