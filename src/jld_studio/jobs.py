"""Manage the searches of the studio, each in its own process and folder.

A search therefore continues after its browser tab is closed.
"""

from __future__ import annotations

import json
import math
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final, Literal, get_args

from jld_core import InputError, build_assembly, files, load_scene, one_thread, parse_scene, solve
from jld_core import assembly as structures
from jld_explore import ExploreSettings, Interrupted, Progress, explore
from jld_explore.evaluation import raise_deferred
from jld_explore.space import LETTERS, from_string, to_string

# Purpose of a search; "study" is a study begun outside the studio, "design" is `jld design` of a file.
Kind = Literal["improve", "prove", "explore", "design", "study"]
_KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
State = Literal["running", "stopping", "stopped", "done", "failed"]
"""State of a search."""

ORDERS: Final = "order.json"  # file in the folder of a job that holds its settings
MOST: Final = 4  # largest number of searches that may run at a time

# Time for a stopped search to write its tables and its page, s; 1 s on an idle core, 10 s where six share two cores
_LAST_PAGE: Final = 60.0

# Entries of summary.json that a page shows
_SUMMARY: Final = ("best", "bound", "gap", "proven", "unbounded", "stop_reason", "evaluated")

# Remedy in error messages about a damaged file of a search
_UNDAMAGED: Final = "the file as it was written, or the folder removed"


@dataclass
class Job:
    """Search of the studio, which runs or has run in a process of its own."""

    name: str  # name of the job and of its folder
    kind: Kind  # purpose of the search: improve, prove, explore, or study for one that was opened
    folder: Path
    orders: dict[str, Any]  # settings of the search, by the names of `ExploreSettings`
    state: State = "stopped"  # running, stopping, stopped, done or failed
    progress: dict[str, Any] = field(default_factory=dict)  # last progress report; empty before the first one
    error: str = ""  # reason of a failure, in one line; "" without one
    process: subprocess.Popen[str] | None = None  # process of the search; None if it was not started in this session
    listener: threading.Thread | None = None  # thread that reads the output of the process, and ends after it
    # "scene" (its name in the studio) and "changes" of the page that began the search; empty if unknown
    shown: dict[str, Any] = field(default_factory=dict)

    @property
    def results(self) -> Path:
        return self.folder if self.kind == "study" else self.folder / "results"

    @property
    def scene_file(self) -> Path:
        """Return the file of the scene that is searched, or of the best layout of a design."""
        if self.kind == "design":
            return self.results / "best.json"
        return (self.results if self.kind == "study" else self.folder) / "scene.json"

    @property
    def seconds_left(self) -> float | None:
        """Return the time until the limit of a running search, s; None without limit or search."""
        limit, since = self.orders.get("seconds"), self.progress.get("seconds")
        if self.state != "running" or not isinstance(limit, int | float) or not isinstance(since, int | float):
            return None
        return max(0.0, limit - since - (time.time() - float(self.progress["at"])))

    def facts(self) -> dict[str, Any]:
        """Return the facts that a page shows about the search, as JSON data."""
        # The facts are name, kind, state, progress with the best layout so far, seconds_left, shown, error, and main
        # entries of summary.json, which are None until the search ends.
        summary = self.results / "summary.json"
        entries: dict[str, Any] = {}
        problem = self.error
        if self.state not in ("running", "stopping") and summary.exists():
            try:
                entries = _read_object(summary)
            except InputError as error:
                problem = problem or str(error)  # one damaged folder must not hide the other searches
        return {
            "name": self.name,
            "kind": self.kind,
            "state": self.state,
            "progress": self.progress,
            "seconds_left": self.seconds_left,
            "shown": self.shown,
            "error": problem,
            "summary": {key: entries.get(key) for key in _SUMMARY},
        }


class Jobs:
    """All searches of one folder, earlier ones too; thread-safe. study: an opened folder, the search "study"."""

    def __init__(self, root: Path, study: Path | None = None) -> None:
        self.root = root
        self._lock = threading.RLock()
        self.all: dict[str, Job] = {}
        if study is not None:
            self.all["study"] = Job("study", "study", study, _orders_of(study), state="done")
        for path in sorted(root.glob("*/" + ORDERS)):
            record = _read_object(path)
            kind = next((kind for kind in _KINDS if kind == record.get("kind")), None)
            orders = record.get("orders")
            if kind is None or not isinstance(orders, dict):
                raise InputError(str(path), "it is damaged (no kind or no settings)", _UNDAMAGED)
            state: State = "done" if record.get("done") else "stopped"
            shown = record.get("shown")
            shown = shown if isinstance(shown, dict) else {}
            self.all[path.parent.name] = Job(path.parent.name, kind, path.parent, orders, state, shown=shown)

    def start(
        self, kind: Kind, scene: Mapping[str, Any], orders: Mapping[str, Any], shown: Mapping[str, Any] | None = None
    ) -> Job:
        def fill(folder: Path) -> None:
            files.write_text(folder / "scene.json", json.dumps(scene, indent=1))

        return self._begin(kind, orders, fill, shown or {})

    def design(self, file: Path, command: Sequence[str], seconds: float) -> Job:
        """Start a design of a copied outline in a new folder and process; command: words of `jld design`."""

        def fill(folder: Path) -> None:
            (folder / "outline").mkdir()
            shutil.copy(file, folder / "outline")

        return self._begin("design", {"command": list(command), "seconds": seconds}, fill, {})

    def _begin(self, kind: Kind, orders: Mapping[str, Any], fill: Callable[[Path], object], shown: Any) -> Job:
        """Start a search in a new folder, which is filled before."""
        with self._lock:
            self._require_room()
            number = 1
            while (self.root / f"{kind}-{number}").exists():
                number += 1
            folder = self.root / f"{kind}-{number}"
            job = Job(folder.name, kind, folder, dict(orders), shown=dict(shown))
            try:
                folder.mkdir(parents=True)
                fill(folder)
                self._launch(job)
            except OSError:
                # Leave nothing half-written, for example on a full disk.
                shutil.rmtree(folder, ignore_errors=True)
                raise
            self.all[folder.name] = job
            return job

    def resume(self, name: str) -> Job:
        """Start the process of a stopped search again, and return the search."""
        with self._lock:
            job = self.find(name)
            if job.state in ("running", "stopping"):
                raise InputError(name, "it is running", "a search that was stopped")
            if job.kind == "design":
                raise InputError(name, "a design does not go on where it was stopped", "a new one")
            self._require_room()
            self._launch(job)
            return job

    def stop(self, name: str) -> Job:
        """Ask a search to stop, and return it at once; its finished evaluations stay on disk."""
        with self._lock:
            job = self.find(name)
            if job.process is not None and job.state == "running":
                job.state = "stopping"
                job.process.send_signal(signal.SIGTERM)
            return job

    def listed(self) -> list[Job]:
        """Return all searches in the order in which they were begun."""
        with self._lock:
            return list(self.all.values())

    def find(self, name: str) -> Job:
        with self._lock:
            if name not in self.all:
                raise InputError("job", f"there is none named {name[:60]!r}", "one of the list")
            return self.all[name]

    def close(self) -> None:
        """Stop all running searches; wait for their processes and read their remaining output."""
        # A process that is still running after `_LAST_PAGE` is killed.
        for job in self.listed():
            self.stop(job.name)
        for job in self.listed():
            if job.process is not None:
                try:
                    job.process.wait(timeout=_LAST_PAGE)
                except subprocess.TimeoutExpired:
                    job.process.kill()
                    job.process.wait()
            if job.listener is not None:
                # Its end closes the pipe; a process that the search began may keep the other end open for a while.
                job.listener.join(timeout=10.0)

    def _require_room(self) -> None:
        """Raise InputError if no further search may run."""
        if sum(job.state in ("running", "stopping") for job in self.all.values()) >= MOST:
            raise InputError("job", f"{MOST} searches are running", "one of them stopped first")

    def _launch(self, job: Job) -> None:
        """Start the process of a search and a thread that reads its output."""
        resume = job.results.exists() and any(job.results.iterdir())
        record = {"kind": job.kind, "orders": job.orders, "shown": job.shown, "done": False}
        if job.kind != "study":
            files.write_text(job.folder / ORDERS, json.dumps(record))
        if job.kind == "design":
            _, name, outline, _, _, *options = job.orders["command"]
            command = ["jld_explore", name, str(job.folder / "outline" / outline), "-o", str(job.results), *options]
        else:
            orders = json.dumps({**job.orders, "resume": resume})
            command = ["jld_studio.jobs", str(job.scene_file), str(job.results), orders]
        # Use a file for stderr: a pipe that is not read fills up and blocks the worker.
        errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 – the listener closes it
        try:
            job.process = subprocess.Popen(
                [sys.executable, "-m", *command],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=errors,
                encoding="utf-8",
                errors="replace",
            )
        except OSError:
            errors.close()
            raise
        # Only a job with a process is running; a job that could not start would otherwise occupy a place for ever.
        job.state, job.error = "running", ""
        job.listener = threading.Thread(target=self._listen, args=(job, job.process, errors, record), daemon=True)
        job.listener.start()

    def _listen(self, job: Job, process: subprocess.Popen[str], errors: IO[str], record: dict[str, Any]) -> None:
        """Read the progress of a process until it ends, then record its state in the job."""
        if process.stdout is None:
            raise RuntimeError("a search was started without a pipe for its progress")
        begun, design = time.time(), job.kind == "design"
        with process.stdout, errors:
            if design:
                job.progress = {"line": "", "seconds": 0.0, "at": begun}
            for line in process.stdout:
                progress = {"line": line.strip(), "seconds": time.time() - begun} if design else _progress_of(line)
                if progress is not None:
                    job.progress = {**progress, "at": time.time()}
            code = process.wait()
            errors.seek(0)
            last_line = deque((line.strip() for line in errors if line.strip()), maxlen=1)
        with self._lock:
            stopped = code == 3 or (design and job.state == "stopping")
            job.error = last_line[0].removeprefix("jld: ")[:300] if code and not stopped and last_line else ""
            job.state = "done" if code == 0 else "stopped" if stopped else "failed"
        if job.kind != "study":
            try:
                files.write_text(job.folder / ORDERS, json.dumps({**record, "done": code == 0}))
            except OSError as error:
                with self._lock:
                    problem = f"{job.folder / ORDERS}: {error.strerror or error}; expected room to write it"
                    job.error = job.error or problem


def _read_object(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file; raise InputError if there is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(str(path), f"it is damaged ({error})", _UNDAMAGED) from None
    if not isinstance(content, dict):
        raise InputError(str(path), "it is damaged (no JSON object)", _UNDAMAGED)
    return content


def _progress_of(line: str) -> dict[str, Any] | None:
    """Return a progress report; None for any other line, such as output of a library."""
    try:
        report = json.loads(line)
    except ValueError:
        return None
    return report if isinstance(report, dict) else None


def _orders_of(study: Path) -> dict[str, Any]:
    """Return driver and seed of a study begun elsewhere, from its summary."""
    summary = _read_object(study / "summary.json")
    return {"driver": summary.get("driver"), "seed": summary.get("seed", 0)}


def orders_for(kind: Kind, labelling: str, seconds: float) -> dict[str, Any]:
    """Return keywords of `ExploreSettings`: "improve" by hillclimb from a labelling, "prove" exactly, "explore"."""
    if kind == "improve":
        return {"driver": "hillclimb", "seconds": seconds, "options": {"start": labelling}}
    if kind == "prove":
        return {"driver": "exact", "seconds": seconds}
    return {"seconds": seconds}


EVERY: Final = 0.2  # smallest time between two progress reports, s


class _Teller:
    """Progress reporter that writes at most one line every `EVERY` seconds."""

    def __init__(self) -> None:
        self._last = -math.inf

    def __call__(self, progress: Progress) -> None:
        """Write progress unless the last report is too recent."""
        now = time.monotonic()
        if now - self._last < EVERY:
            return
        self._last = now
        self.tell(progress)

    def tell(self, progress: Progress) -> None:
        best, bound = (None if not math.isfinite(v) else v for v in (progress.best, progress.bound))
        report: dict[str, Any] = {"done": progress.done, "total": progress.total, "best": best, "bound": bound}
        report["labelling"] = progress.labelling
        sys.stdout.write(json.dumps({**report, "seconds": progress.seconds}) + "\n")
        sys.stdout.flush()


def main(scene: str, folder: str, orders: str) -> int:
    """Search a scene into a folder, with progress as JSON lines on stdout."""

    def stop(number: int, frame: object) -> None:
        raise_deferred(Interrupted())

    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)
    try:
        explore(load_scene(scene), Path(folder), ExploreSettings(**json.loads(orders)), report=_Teller())
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    except Interrupted:
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))


KEYS = ("scene", "labelling")  # entries of a request


@one_thread()
def evaluate(request: Mapping[str, Any]) -> dict[str, Any]:
    """Solve a scene as another program states it, and return JSON data."""
    start = time.perf_counter()
    unknown = sorted(set(request) - set(KEYS))
    if unknown:
        raise InputError(unknown[0], "the request has no such entry", " or ".join(KEYS))
    if not isinstance(request.get("scene"), dict):
        raise InputError("scene", "it is no JSON object", "a scene document")
    assembly = build_assembly(parse_scene(request["scene"], ""))
    labels = assembly.labels
    letters = request.get("labelling")
    if letters is not None:
        count = assembly.faces
        if not isinstance(letters, str) or len(letters) != count or letters.strip(LETTERS):
            raise InputError("labelling", f"it is {str(letters)[:40]!r}", f"{count} letters d or i")
        labels = structures.with_members(assembly, from_string(letters))
    result = solve(assembly, labels)
    answer, elements = result.to_json(), result.assembly.elements
    answer["labelling"] = to_string(labels[: assembly.faces])
    answer["centroids"] = dict(zip(elements.ids, elements.centroid.tolist(), strict=True))
    answer["seconds"] = {**answer["seconds"], "answer": time.perf_counter() - start}
    return answer
