"""The command line as a user meets it: called in this process where speed counts, as a process where it matters."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from jld_core import InputError, Scene
from jld_explore.__main__ import main as entry
from jld_explore.cli.command import app, main

__all__ = ["app", "entry", "main"]


@dataclass(frozen=True)
class Outcome:
    """Exit code and what was printed."""

    code: int
    out: str
    err: str

    def done(self) -> Outcome:
        """Assert that a command ended with exit code 0; what it printed."""
        assert self.code == 0, self.err
        return self

    def refused(self, *words: str) -> None:
        """Assert that a command ended with exit code 2, nothing on stdout, and one line on stderr with these words."""
        assert (self.code, self.out, self.err.count("\n")) == (2, "", 1), self
        assert [word for word in words if word not in self.err] == [], self.err


Command = Callable[..., Outcome]
"""What the fixture `jld` is: `call` with the fixtures that it asks for."""


@contextmanager
def refused(*words: str, match: str | None = None) -> Iterator[None]:
    """An InputError of one line with these words is raised in the block."""
    with pytest.raises(InputError, match=match) as error:
        yield
    assert "\n" not in str(error.value)
    assert [word for word in words if word not in str(error.value)] == [], error.value


def saved(path: Path, scene: Any) -> Path:
    """Write a document, or a scene, as a file of JSON; its path."""
    text = scene.model_dump_json(exclude_defaults=True) if isinstance(scene, Scene) else json.dumps(scene)
    path.write_text(text, encoding="utf-8")
    return path


def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> Outcome:
    """Run `jld` with these arguments in this process. Any exception but SystemExit passes through."""
    monkeypatch.setattr(sys, "argv", ["jld", *map(str, arguments)])
    capsys.readouterr()
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with pytest.raises(SystemExit) as end:
            main()
    finally:  # the command takes signals for itself, and this process is not its own
        for number, handler in handlers.items():
            signal.signal(number, handler)
    printed = capsys.readouterr()
    code = end.value.code
    assert isinstance(code, int)
    return Outcome(code, printed.out, printed.err)


def command(*arguments: str | Path, pictures: bool = True) -> list[str]:
    """The same as a command for a process of its own; without pictures searches write tables only."""
    program = ["-m", "jld_explore"] if pictures else [str(Path(__file__).with_name("without_pictures.py"))]
    return [sys.executable, *program, *map(str, arguments)]


def environment() -> dict[str, str]:
    """One BLAS thread per process, whoever runs the tests."""
    return {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}


def process(*arguments: str | Path, timeout: float = 300.0) -> Outcome:
    """Run `jld` as a process of its own and wait for it."""
    done = subprocess.run(
        command(*arguments), capture_output=True, text=True, timeout=timeout, env=environment(), check=False
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


@contextmanager
def ended(started: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    """Kill a process that a failed test leaves running, and close its pipes: else another test would fail of them."""
    with started:
        try:
            yield started
        finally:
            started.kill()  # nothing to a process that has ended


@contextmanager
def running(*arguments: str | Path, stderr: int | None = None) -> Iterator[subprocess.Popen[str]]:
    """`jld` as a process of its own, stdout in a pipe, which is not left running behind the block."""
    started = subprocess.Popen(command(*arguments), stdout=subprocess.PIPE, stderr=stderr, text=True, env=environment())
    with ended(started):
        yield started


# Where the project's own files are, wherever the checkout is.


ROOT = Path(__file__).resolve().parent.parent
SCENES = ROOT / "scenes"


# The example package of plug-ins as an installer would leave it: in a folder of its own, on the path.


SOURCE = Path(__file__).parent / "plugin"


def install(folder: Path, source: Path = SOURCE) -> Path:
    """Install the package of a folder with a pyproject.toml into another folder, which goes onto PYTHONPATH."""
    project = tomllib.loads((source / "pyproject.toml").read_text("utf-8"))["project"]
    shutil.copytree(source / "src", folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    facts = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    lines = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in points.items())]
    (facts / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder
