"""Stop long commands by signals and by their time limits: `python -m benchmarks.interruption [NAME...]`.

Each case is a command as a process of its own, on a large structure: walls and grids of 2 500 cells, and a design with
300 faces. It runs once to its time limit, and once for each signal and moment. A signal must leave exit code 3, one
line, and the files that the case names, of which `summary.json` or the scene holds the best λ. A limit S may be passed
by max(2 s, 0.05 S). Modules are compiled beforehand, as after an installation.
Columns: seconds from the signal, or from the limit, to the end by the clock, and what is missing.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.common import table, write
from benchmarks.designs import outlines

MOMENTS: Final = (("SIGINT", 0.3), ("SIGTERM", 0.6), ("SIGINT SIGINT", 0.6), ("SIGINT", 0.95))
"""Signals, and when they are sent as a share of the time limit."""

AGAIN: Final = 0.2
"""Time between two signals, s."""

HANGS: Final = 120.0
"""Time after which a command is killed, s."""


@dataclass(frozen=True)
class Case:
    """Command with a time limit, s; left: files that it leaves, also after a signal."""

    name: str
    arguments: tuple[str, ...]
    seconds: float
    left: tuple[str, ...]


def cases(folder: Path) -> list[Case]:
    """Write the scenes, and return the commands."""
    jld("new", "grid", "--columns", "50", "--rows", "50", "-o", str(folder / "grid.json"))
    jld("new", "wall", "--courses", "36", "--length", "14", "-o", str(folder / "wall.json"))
    jld("new", "wall", "--courses", "8", "--length", "2.4", "-o", str(folder / "small.json"))
    jld("new", "arch", "--voussoirs", "41", "--rings", "2", "-o", str(folder / "arch.json"))
    ending, text, _ = outlines()["wall"]
    outline = folder / f"opening{ending}"
    outline.write_text(text)
    moved = json.loads((folder / "arch.json").read_text(encoding="utf-8"))
    moved["move"] = {"inner": "follow"}
    (folder / "arch.json").write_text(json.dumps(moved), encoding="utf-8")
    page = ("out/summary.json", "out/report.html")
    small = json.loads((folder / "small.json").read_text(encoding="utf-8"))
    for name, search in (
        ("shapes", {"shapes": [None, 3], "block_cells": [1, 4]}),
        ("standing", {"assemble": "standing"}),
    ):
        limited = {**small, "search": {**small.get("search", {}), **search}}
        (folder / f"{name}.json").write_text(json.dumps(limited), encoding="utf-8")
    load = ("--load", "10 kN", "--places", "0.25", "--push", "0.05", "--friction", "0.6", "--thickness", "0.3")
    stone = ("--density", "2000", "--tension", "3e5", "--shear", "5e5", "--block-mass", "12")
    return [
        Case("explore, 2 500 cells", ("explore", "grid.json", "--out", "out"), 10.0, page),
        Case("explore exact, 2 500 cells", ("explore", "grid.json", "--out", "out", "--driver", "exact"), 10.0, page),
        Case("explore cells", ("explore", "small.json", "--out", "out", "--cracks", "cells:0.05"), 10.0, page),
        Case("explore shapes", ("explore", "shapes.json", "--out", "out"), 10.0, page),
        Case("explore standing", ("explore", "standing.json", "--out", "out"), 10.0, page),
        Case("explore --move", ("explore", "small.json", "--out", "out", "--move", "3"), 10.0, page),
        Case("explore fields", ("explore", "small.json", "--out", "out", "--cracks", "fields"), 10.0, page),
        Case("design, 300 faces", ("design", str(outline), "-o", "out", *load, *stone), 20.0, page),
        Case("move", ("move", "arch.json", "-o", "moved.json"), 10.0, ("moved.json",)),
        Case("assembly", ("assembly", "wall.json", "--out", "out", "--stages", "--animation"), 10.0, ()),
    ]


def jld(*arguments: str) -> None:
    """Run a command that has to succeed."""
    command = [sys.executable, "-m", "jld_explore", *arguments]
    subprocess.run(command, check=True, capture_output=True, env=environment())


def environment() -> dict[str, str]:
    """Return the environment of the commands, in which Python keeps compiled files as after an installation."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return {**kept, "MPLBACKEND": "Agg"}


def _attentive() -> None:
    """Let a process take SIGINT, which shells have background jobs ignore."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _send(run: subprocess.Popen[str], numbers: list[str]) -> None:
    """Send signals one after another, until the process has ended."""
    for position, number in enumerate(numbers):
        if position:
            with suppress(subprocess.TimeoutExpired):
                run.wait(AGAIN)
        if run.poll() is None:
            os.kill(run.pid, getattr(signal, number))


def measure(case: Case, scenes: Path, number: str | None, share: float) -> list[str]:
    """Run a command to its limit, or to a signal; return a row of the table."""
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        for scene in scenes.glob("*.json"):
            (folder / scene.name).write_bytes(scene.read_bytes())
        command = [sys.executable, "-m", "jld_explore", *case.arguments, "--seconds", f"{case.seconds:g}"]
        start = time.perf_counter()
        run = subprocess.Popen(
            command,
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=environment(),
            start_new_session=True,
            preexec_fn=_attentive,
        )
        try:
            if number is not None:
                try:
                    run.wait(share * case.seconds)
                except subprocess.TimeoutExpired:
                    _send(run, number.split())
            since = time.perf_counter() if number is not None else start + case.seconds
            err = run.communicate(timeout=HANGS)[1]
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            run.communicate()
            return [case.name, f"{case.seconds:g}", number or "limit", f"> {HANGS:g}", "–", "it did not end"]
        over = time.perf_counter() - since
        missing = [name for name in case.left if not (folder / name).exists()]
        wrong = [f"no {name}" for name in missing]
        if (folder / "out/summary.json").exists():
            facts = json.loads((folder / "out/summary.json").read_text(encoding="utf-8"))
            wrong += ["no λ"] if facts.get("best") is None else []
        last = err.strip().rpartition("\n")[2][-200:]
        if err.count("\n") > 1 or "Traceback" in err:
            wrong.append(f"{err.count(chr(10))} lines: {last}")
        if (number is not None and run.returncode not in (0, 3)) or (number is None and run.returncode != 0):
            wrong.append(f"exit code {run.returncode}: {last}")
        if over > max(2.0, 0.05 * case.seconds):
            wrong.append("late")
    when = "limit" if number is None else f"{number} at {share * case.seconds:.3g} s"
    return [case.name, f"{case.seconds:g}", when, f"{over:.2f}", str(run.returncode), "; ".join(wrong) or "–"]


def main() -> None:
    """Measure the cases whose names hold the words given; all of them also write the table."""
    wanted = sys.argv[1:]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        scenes = Path(folder)
        for case in cases(scenes):
            if wanted and not any(word in case.name for word in wanted):
                continue
            measure(case, scenes, "SIGINT", 1.0)  # compiles the modules that are imported
            for number, share in ((None, 1.0), *MOMENTS):
                rows.append(measure(case, scenes, number, share))
                sys.stderr.write("  ".join(rows[-1]) + "\n")
    if wanted:
        return
    about = " ".join((__doc__ or "").split("\n\n", 1)[1].split())
    head = ["command", "S", "stopped by", "seconds past it", "exit code", "missing or wrong"]
    words = f"Written by `python -m benchmarks.interruption`, beside a load of {os.getloadavg()[0]:.0f}. {about}"
    write("interruption", f"# Commands that are stopped\n\n{words}\n\n" + table(rows=rows, head=head))


if __name__ == "__main__":
    main()
