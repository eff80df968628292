"""Searches behind a page: each a process of its own with a folder of its own, so that it outlives a closed tab."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final, Literal

from jld_core.errors import InputError
from jld_explore.report import write_text

Kind = Literal["improve", "prove", "explore", "study"]
State = Literal["running", "stopping", "stopped", "done", "failed"]

ORDERS: Final = "order.json"
"""In a job's folder, beside its results: what it was told to do."""

MOST: Final = 4
"""Searches that may run at a time."""


@dataclass
class Job:
    """One search. orders: settings of the search. progress: as it last reported. error: why it failed, in one line."""

    name: str
    kind: Kind
    folder: Path
    orders: dict[str, Any]
    state: State = "stopped"
    progress: dict[str, Any] = field(default_factory=dict)
    error: str = ""
    process: subprocess.Popen[str] | None = None

    @property
    def results(self) -> Path:
        """The folder of its study."""
        return self.folder if self.kind == "study" else self.folder / "results"

    def told(self) -> dict[str, Any]:
        """What a page is told about it."""
        summary = self.results / "summary.json"
        found: dict[str, Any] = {}
        if self.state not in ("running", "stopping") and summary.exists():
            found = json.loads(summary.read_text(encoding="utf-8"))
        return {
            "name": self.name,
            "kind": self.kind,
            "state": self.state,
            "progress": self.progress,
            "error": self.error,
            "summary": {key: found.get(key) for key in ("best", "bound", "gap", "proven", "stop_reason", "evaluated")},
        }


class Jobs:
    """All searches of one opened folder, those of earlier sessions too; any thread may ask."""

    def __init__(self, root: Path, study: Path | None = None) -> None:
        self.root = root
        self._turn = threading.RLock()
        self.all: dict[str, Job] = {}
        if study is not None:
            self.all["study"] = Job("study", "study", study, _orders_of(study), state="done")
        for place in sorted(root.glob("*/" + ORDERS)):
            told = json.loads(place.read_text(encoding="utf-8"))
            state: State = "done" if told.get("done") else "stopped"
            self.all[place.parent.name] = Job(place.parent.name, told["kind"], place.parent, told["orders"], state)

    def start(self, kind: Kind, scene: Mapping[str, Any], orders: Mapping[str, Any]) -> Job:
        """Begin a search of a scene. Raises InputError where too many are running."""
        with self._turn:
            self._room()
            number = 1
            while (self.root / f"{kind}-{number}").exists():
                number += 1
            folder = self.root / f"{kind}-{number}"
            folder.mkdir(parents=True)
            write_text(folder / "scene.json", json.dumps(scene, indent=1))
            job = self.all[folder.name] = Job(folder.name, kind, folder, dict(orders))
            self._launch(job)
            return job

    def resume(self, name: str) -> Job:
        """Go on with a search. Raises InputError where it runs, or too many do."""
        with self._turn:
            job = self.find(name)
            if job.state in ("running", "stopping"):
                raise InputError(name, "it is running", "a search that was stopped")
            self._room()
            self._launch(job)
            return job

    def stop(self, name: str) -> Job:
        """Ask a search to stop; what it has finished is on disk."""
        with self._turn:
            job = self.find(name)
            if job.process is not None and job.state == "running":
                job.state = "stopping"
                job.process.send_signal(signal.SIGTERM)
            return job

    def listed(self) -> list[Job]:
        """All searches, in the order they were begun."""
        with self._turn:
            return list(self.all.values())

    def find(self, name: str) -> Job:
        """A search by its name. Raises InputError for none."""
        if name not in self.all:
            raise InputError("job", f"there is none named {name[:60]!r}", "one of the list")
        return self.all[name]

    def close(self) -> None:
        """Stop all that run, and wait for them."""
        for job in self.listed():
            self.stop(job.name)
        for job in self.listed():
            if job.process is not None:
                try:
                    job.process.wait(timeout=10.0)
                except subprocess.TimeoutExpired:
                    job.process.kill()
                    job.process.wait()

    def _room(self) -> None:
        if sum(job.state in ("running", "stopping") for job in self.all.values()) >= MOST:
            raise InputError("job", f"{MOST} searches are running", "one of them stopped first")

    def _launch(self, job: Job) -> None:
        scene = job.results / "scene.json" if job.kind == "study" else job.folder / "scene.json"
        resume = job.results.exists() and any(job.results.iterdir())
        told = {"kind": job.kind, "orders": job.orders, "done": False}
        if job.kind != "study":
            write_text(job.folder / ORDERS, json.dumps(told))
        orders = json.dumps({**job.orders, "resume": resume})
        command = [sys.executable, "-m", "jld_explore.studio.worker", str(scene), str(job.results), orders]
        job.state, job.error = "running", ""
        # a file, as a pipe that nobody reads while stdout is read fills up and halts the worker
        words = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 – the listener closes it
        job.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=words, encoding="utf-8", errors="replace"
        )
        threading.Thread(target=self._listen, args=(job, job.process, words, told), daemon=True).start()

    def _listen(self, job: Job, process: subprocess.Popen[str], words: IO[str], told: dict[str, Any]) -> None:
        assert process.stdout is not None
        with process.stdout, words:
            for line in process.stdout:
                progress = _progress_of(line)
                if progress is not None:
                    job.progress = {**progress, "at": time.time()}
            code = process.wait()
            words.seek(0)
            last = deque((line.strip() for line in words if line.strip()), maxlen=1)
        with self._turn:
            job.error = last[0][:300] if code not in (0, 3) and last else ""
            job.state = "done" if code == 0 else "stopped" if code == 3 else "failed"
        if job.kind != "study":
            write_text(job.folder / ORDERS, json.dumps({**told, "done": code == 0}))


def _progress_of(line: str) -> dict[str, Any] | None:
    """A report of a worker; None for a line of another kind, as a library may print."""
    try:
        told = json.loads(line)
    except ValueError:
        return None
    return told if isinstance(told, dict) else None


def _orders_of(study: Path) -> dict[str, Any]:
    """The settings of a study that was begun elsewhere, as far as its summary says them."""
    summary = json.loads((study / "summary.json").read_text(encoding="utf-8"))
    return {"driver": summary.get("driver"), "seed": summary.get("seed", 0)}


def orders_for(kind: Kind, labelling: str, seconds: float) -> dict[str, Any]:
    """What the three kinds of search are told to do."""
    if kind == "improve":
        return {"driver": "hillclimb", "seconds": seconds, "options": {"start": labelling}}
    if kind == "prove":
        return {"driver": "exact", "seconds": seconds}
    return {"seconds": seconds}
