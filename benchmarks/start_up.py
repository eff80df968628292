"""How long commands take to start, and what a fresh clone needs until `make demo` has ended.

Each command runs in turns from today's sources and from those of another commit, without the batch solver. The least
processor time of all turns is given: on a free machine the clock shows the same, since a start uses one thread. The
parts of `make demo` are run one after the other in a copy of the checkout; on two free cores the compiler works beside
the installation. `python -m benchmarks.start_up [COMMIT]` writes the table; COMMIT (default: the last one before
imports were cut) has to hold the sources to compare with, and `--demo` sets up the copy as well, which needs a package
index.
"""

from __future__ import annotations

import io
import os
import resource
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Final

from benchmarks.common import ROOT, about, table, write
from jld_core.batch import build

TURNS: Final = 5
"""Turns of each command; the least time of all is taken."""

BEFORE: Final = "ada5083"
"""Commit that today's sources are compared with, unless another is named."""

COMMANDS: Final = (
    ("--help",),
    ("--version",),
    ("check", "scenes/ferris_tinloi_1.json"),
    ("solve", "scenes/ferris_tinloi_1.json"),
    ("solve", "scenes/flat_beam_arch.json"),
)
"""Commands that are timed."""


def seconds(command: list[str], folder: Path, variables: dict[str, str] | None = None) -> float:
    """Processor seconds of a command and the processes that it starts."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    env = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"} | (variables or {})
    subprocess.run(command, cwd=folder, env=env, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def sources(commit: str, folder: Path) -> Path:
    """Unpack the sources of a commit, and return the folder of its packages."""
    packed = subprocess.run(["git", "archive", commit, "src"], cwd=ROOT, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        archive.extractall(folder, filter="data")
    return folder / "src"


def starts(commit: str, folder: Path) -> list[list[str]]:
    """A row for each command: least processor seconds from the sources of the commit, and from today's."""
    places = [sources(commit, folder), ROOT / "src"]
    rows = []
    for command in COMMANDS:
        least = [float("inf"), float("inf")]
        for turn in range(TURNS + 1):
            for k, place in enumerate(places):
                spent = seconds(
                    [sys.executable, "-m", "jld_explore", *command],
                    ROOT,
                    {"PYTHONPATH": str(place), "JLD_KERNEL": "off"},
                )
                if turn:  # the first turn compiles the modules
                    least[k] = min(least[k], spent)
        rows.append([f"`jld {' '.join(command)}`", *(f"{spent:.2f}" for spent in least)])
    return rows


def demo(folder: Path) -> list[list[str]]:
    """A row for each part of `make demo` in a copy of the checkout, and one for all on two free cores."""
    held = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in held.splitlines():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    python, scene = str(folder / ".venv" / "bin" / "python"), "scenes/flat_beam_arch.json"
    pip = [python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", "--no-compile"]
    parts = {
        "environment": [sys.executable, "-m", "venv", ".venv"],
        "libraries of jld": [*pip, "-c", "constraints.txt", "-e", "."],
        f"batch solver, {build.best()} alone": [sys.executable, "src/jld_core/batch/build.py", "--in-place", "--best"],
        "`jld check`, with all modules compiled": [python, "-m", "jld_explore", "check", scene],
        "`jld explore`": [python, "-m", "jld_explore", "explore", scene, "--out", "out"],
    }
    spent = [seconds(command, folder, {"JLD_COMPILED_APART": "1"}) for command in parts.values()]
    together = max(spent[0] + spent[1], spent[2], sum(spent[:3]) / 2) + spent[3] + spent[4]
    return [[name, f"{one:.1f}"] for name, one in zip(parts, spent, strict=True)] + [
        ["**on two free cores**", f"**{together:.1f}**"]
    ]


def main() -> None:
    """Write benchmarks/results/start_up.md."""
    named = [word for word in sys.argv[1:] if not word.startswith("-")]
    commit = named[0] if named else BEFORE
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        rows = starts(commit, Path(one))
        text = ["# Start-up", about(__doc__), table(["processor seconds", commit, "today"], rows)]
        if "--demo" in sys.argv[1:]:
            text += ["## `make demo` in a fresh clone", table(["part", "processor seconds"], demo(Path(other)))]
    write("start_up", "\n\n".join(text))


if __name__ == "__main__":
    main()
