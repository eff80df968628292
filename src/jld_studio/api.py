"""Answer the requests under `api/` of the studio: solutions, scenes, searches and files."""

from __future__ import annotations

import base64
import json
import re
import tempfile
import threading
import unicodedata
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from jld_core import InputError, Layout, files, load_scene
from jld_explore import read_folder
from jld_formats import FORMATS, export
from jld_formats import formats as exchange_formats
from jld_studio.jobs import Job, Jobs, orders_for
from jld_studio.opening import design_command, options_of, read_file, received, stated_scene, understood
from jld_studio.session import SceneStore, StudioSession, drawing_data, parsed, scene_data, with_support
from jld_views import page_contract, page_of_study

SECONDS: Final = (1.0, 86_400.0)  # smallest and largest time limit of a search begun from the page, s
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,63}")  # names under which a scene may be saved
PAGES: Final = 64  # number of open pages whose newest revision is remembered
CANDIDATES: Final = "candidates.json"  # file of the candidates that the page keeps


class Api:
    """Handlers of the page's requests: from the JSON object of a request to that of the answer.

    InputError becomes status 400.

    Requests about a state have "labelling", "changes" of the scene, and "scene", the name of another scene than the
    first. root: the only folder into which files are written.
    """

    def __init__(
        self,
        session: StudioSession,
        jobs: Jobs,
        root: Path,
        first: Callable[[], page_contract.PageData],
        drawing: dict[str, Any] | None = None,
    ) -> None:
        self.jobs, self.root, self._first, self._drawing = jobs, root, first, drawing
        self.scenes = SceneStore(session, root)
        self._newest: OrderedDict[str, int] = OrderedDict()  # newest revision that each page asked for
        self._newest_lock, self._solve_lock = threading.Lock(), threading.Lock()

    def data(self, _: dict[str, Any]) -> dict[str, Any]:
        """Return the data with which the page starts, with the candidates kept earlier."""
        path = self.root / CANDIDATES
        try:
            candidates = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
        except ValueError as error:
            raise InputError(str(path), f"it is damaged ({error})", "a file as the studio left it, or none") from None
        page = self._first()
        extra = {"candidates": candidates, "scene": self.scenes.first_name, "file": plain_name(page["title"])}
        return {**page, "studio": {**(page["studio"] or {}), **extra, "drawing": self._drawing}}

    def _session(self, request: dict[str, Any]) -> StudioSession:
        """Return the solver of the scene of a request; raise InputError for an unknown scene."""
        return self.scenes.find(request.get("scene"))

    def _opened(self, name: str) -> dict[str, Any]:
        """Return the data with which the page shows a scene of the store."""
        page = scene_data(self.scenes.find(name), self.root)
        extra = {"scene": name, "file": plain_name(page["title"])}
        return {"scene": name, "data": {**page, "studio": {**(page["studio"] or {}), **extra}}}

    def open(self, request: dict[str, Any]) -> dict[str, Any]:
        """Open a file: a scene, a drawing or a file of solids."""
        options = options_of(request.get("options", {}))
        with received(request.get("name"), request.get("content")) as path:
            file = read_file(path, options)
        opened = self._opened(self.scenes.add(file.scene))
        return {**opened, "report": [list(line) for line in file.report], "unit": file.unit}

    def read(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return what an import understands of a file (`understood`), or {"scene": True} for a scene file."""
        options, settings = options_of(request.get("options", {})), _settings(request)
        with received(request.get("name"), request.get("content")) as path:
            return {"scene": True} if stated_scene(path) else understood(path, options, settings)

    def design(self, request: dict[str, Any]) -> dict[str, Any]:
        """Start `jld design` with a file as its outline, and return the facts of this search (`Job.facts`)."""
        options, settings = options_of(request.get("options", {})), _settings(request)
        with received(request.get("name"), request.get("content")) as path:
            command = design_command(path.name, "results", options, settings)
            return self.jobs.design(path, command, settings.get("seconds", 300.0)).facts()

    def show(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return "scene" and "data" of a scene opened before; "scene" is its name."""
        return self._opened(str(request.get("scene")))

    def support(self, request: dict[str, Any]) -> dict[str, Any]:
        """Make an element a support, or free, in a new scene with labels and changes of the page."""
        document = self._session(request).scene_with(request.get("labelling"), _changes(request))
        changed = with_support(document, request.get("element"), request.get("support"))
        return self._opened(self.scenes.add(parsed(changed)))

    def edit(self, request: dict[str, Any]) -> dict[str, Any]:
        """Check a changed part of the scene before the page takes it."""
        return {"value": self._session(request).edited(_changes(request), request.get("part"))}

    def drawing(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the page data without solutions, in which layouts of the search "name" are drawn."""
        job = self.jobs.find(str(request.get("name")))
        return {**drawing_data(load_scene(job.scene_file))}

    def solve(self, request: dict[str, Any]) -> dict[str, Any]:
        """Solve a state of the page and return its solution, or "superseded" if there is a newer "revision"."""
        page, revision = str(request.get("page", "")), _revision(request.get("revision"))
        session = self._session(request)
        self._note(page, revision)
        with self._solve_lock:
            if self._note(page, revision) > revision:
                return {"revision": revision, "superseded": True}
            return {"revision": revision, **session.solve(request.get("labelling"), _changes(request))}

    def fields(self, request: dict[str, Any]) -> dict[str, Any]:
        """Solve one more mesh of the bounds by fields for a state of the page, and return them."""
        page, revision = str(request.get("page", "")), _revision(request.get("revision"))
        if self._note(page, revision) > revision:
            return {"revision": revision, "superseded": True}
        return {"revision": revision, **self._session(request).fields(request.get("labelling"), _changes(request))}

    def improve(self, request: dict[str, Any]) -> dict[str, Any]:
        """Move joints by some steps from a state of the page."""
        return self._session(request).improve(request.get("labelling"), _changes(request))

    def _note(self, page: str, revision: int) -> int:
        with self._newest_lock:
            newest = self._newest[page] = max(revision, self._newest.get(page, revision))
            self._newest.move_to_end(page)
            while len(self._newest) > PAGES:
                self._newest.popitem(last=False)
            return newest

    def list_jobs(self, _: dict[str, Any]) -> dict[str, Any]:
        """Return {"jobs": facts of all searches}, each as `Job.facts` returns them."""
        return {"jobs": [job.facts() for job in self.jobs.listed()]}

    def start_job(self, request: dict[str, Any]) -> dict[str, Any]:
        """Start a search from a state of the page, and return its facts (`Job.facts`)."""
        kind, seconds = request.get("kind"), request.get("seconds", 3600.0)
        if kind not in ("improve", "prove", "explore"):
            raise InputError("kind", f"there is no {str(kind)[:40]!r}", "improve, prove or explore")
        if not isinstance(seconds, int | float) or not SECONDS[0] <= seconds <= SECONDS[1]:
            raise InputError("seconds", f"it is {str(seconds)[:40]}", f"a number from {SECONDS[0]:g} to {SECONDS[1]:g}")
        session, letters, changes = self._session(request), request.get("labelling"), _changes(request)
        setup = session.setup(changes)
        session.labels(letters)
        document = setup.scene.model_dump(mode="json", exclude_defaults=True)
        page_state = {"scene": request.get("scene") or self.scenes.first_name, "changes": changes}
        self.scenes.write(page_state["scene"])
        return self.jobs.start(kind, document, orders_for(kind, str(letters), float(seconds)), page_state).facts()

    def stop_job(self, request: dict[str, Any]) -> dict[str, Any]:
        """Ask the search of a "name" to stop, and return its facts (`Job.facts`)."""
        return self.jobs.stop(str(request.get("name"))).facts()

    def resume_job(self, request: dict[str, Any]) -> dict[str, Any]:
        """Resume the search of a "name", and return its facts (`Job.facts`)."""
        return self.jobs.resume(str(request.get("name"))).facts()

    def results(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the page's data for the results of the search of a "name", with "scene" and "changes" in "studio"."""
        job = self.jobs.find(str(request.get("name")))
        if job.kind == "design":
            return self._opened(self.scenes.add(load_scene(job.scene_file)))
        return {**page_of_study.study_data(read_folder(job.results), patience=0.3, studio=self._shown(job))}

    def _shown(self, job: Job) -> dict[str, Any]:
        if job.kind == "study":
            return {"scene": self.scenes.first_name, "changes": {}}
        if job.shown and self.scenes.has(job.shown.get("scene")):
            return job.shown
        return {"scene": self.scenes.add(load_scene(job.scene_file)), "changes": {}}

    def report(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the report of the search of a "name": {"name": file name, "text": HTML}."""
        job = self.jobs.find(str(request.get("name")))
        if job.kind == "design":
            return {"name": f"{job.name}.html", "text": _page_with_picture(job.results)}
        return {"name": f"{job.name}.html", "text": page_of_study.study_page(read_folder(job.results))}

    def keep(self, request: dict[str, Any]) -> dict[str, Any]:
        """Write the candidates of the page to `candidates.json`, and their scenes."""
        # The file in `root` is replaced.
        candidates = request.get("candidates")
        if not isinstance(candidates, list) or len(candidates) > 500:
            raise InputError("candidates", "it is no list of up to 500", "a list")
        for candidate in candidates:
            if isinstance(candidate, dict):
                self.scenes.write(candidate.get("scene"))
        self.root.mkdir(parents=True, exist_ok=True)
        files.write_text(self.root / CANDIDATES, json.dumps(candidates))
        return {"kept": len(candidates)}

    def scene(self, request: dict[str, Any]) -> dict[str, Any]:
        return self._session(request).scene_with(request.get("labelling"), _changes(request))

    def export(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return a state as a file of another program: {"name", "content": base64}."""
        kind = request.get("format")
        if not isinstance(kind, str) or kind not in FORMATS:
            raise InputError("format", f"there is no {str(kind)[:40]!r}", "one of " + ", ".join(FORMATS))
        session = self._session(request)
        setup, labels = session.setup(_changes(request)), session.labels(request.get("labelling"))
        stem = plain_name(setup.scene.name) if request.get("name") is None else _checked_name(request.get("name"))
        result = setup.solver.solve(labels) if exchange_formats.formats()[kind].analysed else None
        name = f"{stem}{FORMATS[kind]}"
        with tempfile.TemporaryDirectory() as folder:
            path = export(Layout(setup.scene, setup.assembly, labels, result), kind, Path(folder) / name)
            content = base64.b64encode(path.read_bytes()).decode("ascii")
        return {"name": name, "content": content}

    def save(self, request: dict[str, Any]) -> dict[str, Any]:
        """Write the scene of a state into `root`: {"path", "exists": True if an existing file was left alone}."""
        name = _checked_name(request.get("name"))
        name = name if name.endswith(".json") else f"{name}.json"
        if name == CANDIDATES:
            raise InputError("name", f"{CANDIDATES} is taken", "another name")
        path = self.root / name
        scene = self.scene(request)
        if path.exists() and request.get("overwrite") is not True:
            return {"path": str(path), "exists": True}
        self.root.mkdir(parents=True, exist_ok=True)
        files.write_text(path, json.dumps(scene, indent=1))
        return {"path": str(path), "exists": False}


def plain_name(title: str) -> str:
    """Return a plain file name, without an ending, for the title of a scene."""
    plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode()
    words = re.sub(r"[^A-Za-z0-9-]+", "_", plain).strip("_-")
    return words[:60].rstrip("_-") or "scene"


def _page_with_picture(folder: Path) -> str:
    """Return the page of a design with its picture inside; raise InputError where there is none yet."""
    if not (folder / "report.html").exists():
        raise InputError("design", "it has no page yet", "a design that has found a layout")
    page, picture = (folder / "report.html").read_text(encoding="utf-8"), folder / "best.png"
    if not picture.exists():
        return page
    encoded = base64.b64encode(picture.read_bytes()).decode("ascii")
    return page.replace('src="best.png"', f'src="data:image/png;base64,{encoded}"')


def _settings(request: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of a design that a request states; raise InputError if they are no object."""
    settings = request.get("settings", {})
    if not isinstance(settings, dict):
        raise InputError("settings", "they are no JSON object", "an object")
    return {key: value for key, value in settings.items() if value not in (None, "")}


def _checked_name(name: object) -> str:
    """Return the name of a file; raise InputError for anything but a plain one."""
    if not isinstance(name, str) or not _NAME.fullmatch(name) or ".." in name:
        raise InputError("name", f"it is {str(name)[:60]!r}", "letters, digits, blanks, '-', '_' and '.'")
    return name


def _revision(value: object) -> int:
    """Return a revision number; raise InputError if it is not an integer from 0."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise InputError("revision", f"it is {str(value)[:40]!r}", "a whole number from 0")
    return value


def _changes(request: dict[str, Any]) -> dict[str, Any]:
    """Return the changes of a request; raise InputError if they are not an object."""
    changes = request.get("changes", {})
    if not isinstance(changes, dict):
        raise InputError("changes", "they are no JSON object", "an object")
    return changes
