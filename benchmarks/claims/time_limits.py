"""A search with a time limit ends in time, with a layout, its page and its best λ, whatever the scene and the driver.

Each case is `jld explore SCENE --seconds S` as a process of its own. The scenes are samples with random limits on
blocks, counts, shapes, assembly, required load factors, cells that may be left out and load cases; every driver takes
its turn, and so does the automatic choice.

A process that waits for a processor is late whatever the program does, so the claim is for an idle machine. A search
that ends late is run again, and the notes count searches that were in time only then. The notes also say how busy the
machine was: the time by the clock over the processor time of one start of the program, once before the first case.
Where the system tells how long a process waited for a processor, a search that is late every time is run once more by
the clock of an idle machine, which stands still while the main thread waits. The report then tells what is late
whatever the machine from what only waited; either is a disagreement.

A space may be so tight that a search neither finds a layout in time nor proves that there is none. The message must say
exactly that, and the notes count such cases.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.claims.tally import Tally, run_cases
from jld_core import samples

CLAIM: Final = "jld explore --seconds S ends within 1.1 S + 2 s with a layout, its page and its best λ"

DRIVERS: Final = ("", "enumeration", "random", "hillclimb", "anneal", "genetic", "portfolio", "optuna", "exact")
"""Drivers by name, "" for the one that is chosen where none is named."""

SECONDS: Final = (2.0, 3.0, 4.0)
"""Time limits, s."""

HANGS: Final = 90.0
"""Seconds after which a search is killed."""

TURNS: Final = 3
"""How often a search that ends late is run at the most."""

STEPS: Final = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Bounds of the classes in which the seconds past the limit S are counted."""


UNDECIDED: Final = "nor a proof that there is none"
"""Words of the message of a search that neither found a layout in time nor proved that there is none."""

IDLE_BELOW: Final = 1.1
"""Time by the clock over processor time of one start of the program below which a machine counts as idle."""

WAITED: Final = Path("/proc/self/schedstat")
"""File with the times, ns, that a process ran and that it waited for a processor, on systems that have it."""

IDLE: Final = """
import atexit, os, sys, time
from pathlib import Path
real, waited = time.perf_counter, os.open(f"/proc/self/task/{os.getpid()}/schedstat", os.O_RDONLY)
time.perf_counter = lambda: real() - int(os.pread(waited, 99, 0).split()[1]) / 1e9
started, file = time.perf_counter(), Path(sys.argv.pop(1))
atexit.register(lambda: file.write_text(str(time.perf_counter() - started)))
from jld_explore.__main__ import main
main()
"""
"""Program that runs the command line by a clock that stands still while the main thread waits for a processor."""


def allowed(seconds: float) -> float:
    """Seconds after which a search with a time limit must have ended."""
    return 1.1 * seconds + 2.0


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim; see `benchmarks.claims.tally.Family`."""
    busy = _slower()
    with tempfile.TemporaryDirectory() as folder:
        found = run_cases(CLAIM, partial(_case, Path(folder)), first_seed, cases, seconds)
    found.count("on an idle machine" if busy <= IDLE_BELOW else "beside other work", found.cases)
    return found


def _case(folder: Path, seed: int, tally: Tally) -> str:
    rng = np.random.default_rng([20, seed])
    file = folder / f"{seed}.json"
    file.write_text(json.dumps(random_scene(rng)), encoding="utf-8")
    limit = float(rng.choice(SECONDS))
    options = ["--seconds", f"{limit:g}", *_options(rng, DRIVERS[seed % len(DRIVERS)])]
    for turn in range(TURNS):
        out = folder / f"out-{seed}-{turn}"
        seconds, undecided, wrong = _ended(file, out, options)
        late = seconds > allowed(limit)
        if not late or wrong:
            break
    if turn and not late:
        tally.count("in time when run again")
    tally.count("no layout found or excluded in time", undecided)
    step = max(low for low in STEPS if low <= max(seconds - limit, 0.0))
    tally.count(f"ended {step:g} s past S or later")
    if (out / "summary.json").exists():
        reason = json.loads((out / "summary.json").read_text(encoding="utf-8"))["stop_reason"]
        tally.count(f"stopped: {reason}")
    elif not wrong:
        tally.count("refused")
    if late:
        wrong.append(f"ended after {seconds:.1f} s")
        if WAITED.exists():
            idle = _ended(file, folder / f"out-{seed}-idle", options, idle=True)[0]
            wrong.append(f"{idle:.1f} s by the clock of an idle machine")
            tally.count("late by the clock of an idle machine", idle > allowed(limit))
    return f"{' '.join(options)}: {'; '.join(wrong)}" if wrong else ""


def _slower() -> float:
    """How many times slower than an idle machine this one is: time by the clock over processor time, of a start."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, "-m", "jld_explore", "--version"], capture_output=True, check=True)
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return max(1.0, seconds / (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime))


def _ended(file: Path, out: Path, options: list[str], *, idle: bool = False) -> tuple[float, bool, list[str]]:
    """Run a search: seconds until it ended, whether it is undecided if a layout exists, and what is wrong with its end.

    idle: by the clock of an idle machine.
    """
    clock = out.with_suffix(".seconds")
    program = ["-c", IDLE, str(clock)] if idle else ["-m", "jld_explore"]
    command = [sys.executable, *program, "explore", str(file), "--out", str(out), *options]
    start = time.perf_counter()
    try:
        done = subprocess.run(
            command, cwd=file.parent, capture_output=True, text=True, timeout=HANGS, check=False, env=_environment()
        )
    except subprocess.TimeoutExpired:
        return HANGS, False, [f"not ended after {HANGS:g} s"]
    seconds = float(clock.read_text(encoding="ascii")) if idle else time.perf_counter() - start
    undecided = done.returncode == 2 and UNDECIDED in done.stderr
    return seconds, undecided, _wrong(done, out)


def _wrong(done: subprocess.CompletedProcess[str], out: Path) -> list[str]:
    """What is wrong with the end of a search, in words."""
    if done.returncode == 2 and done.stderr.count("\n") == 1:
        # a space that is provably empty or not decided, or a driver that says what it is not for
        if "within --seconds" in done.stderr and UNDECIDED not in done.stderr:
            return [f"no layout: {done.stderr.strip()[-160:]}"]
        return []
    if done.returncode != 0:
        return [f"exit code {done.returncode}: {done.stderr.strip()[-160:]}"]
    wrong = [] if (out / "report.html").exists() else ["no report.html"]
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    if summary["evaluated"] < 1:
        wrong.append("no layout evaluated")
    ranked = summary["counts_by_status"].get("collapse", 0)
    if summary["best"] is None and ranked:
        wrong.append("no best λ")
    return wrong


def _environment() -> dict[str, str]:
    return {**os.environ, "MPLBACKEND": "Agg", "PYTHONWARNINGS": "ignore"}


def _options(rng: np.random.Generator, driver: str) -> list[str]:
    """Random options of a search."""
    options = ["--driver", driver] if driver else []
    options += ["--jobs", str(rng.choice([1, 2]))]
    draw = rng.random()
    if draw < 0.1:
        options += ["--objective", "zero-dilation"]
    elif draw < 0.15:
        options += ["--objective", "zero-dilation-floor"]
    elif 0.2 <= draw < 0.3 and driver == "exact":
        options += ["--aim", "front"]
    return options


def random_scene(rng: np.random.Generator) -> dict[str, Any]:
    """A sample of a random kind and size with random loads and limits, as the document of a scene file."""
    document: dict[str, Any] = _sample(rng).model_dump(mode="json", exclude_defaults=True, by_alias=True)
    document["search"] = _search(rng)
    if rng.random() < 0.25:
        live = document["loads"].pop("live")
        tilted = len(live[0].get("body", [])) == 2
        number = int(rng.choice([2, 4, 10]))
        each = [[{"body": [1.0, float(rng.normal())]}] if tilted else live for _ in range(number)]
        document["loads"]["cases"] = [{"name": f"case {k}", "live": one} for k, one in enumerate(each)]
    return document


def _sample(rng: np.random.Generator) -> Any:
    kind = rng.choice(
        ["arch", "wall", "grid", "flat-arch", "buttress", "vault", "dome"], p=[0.2, 0.2, 0.3, 0.1, 0.1, 0.05, 0.05]
    )
    push = str(rng.choice(["push", "crown", "quarter"]))
    whole = rng.integers
    if kind == "arch":
        return samples.arch(voussoirs=int(whole(4, 24)), rings=int(whole(1, 4)), thickness=0.3, load=push)
    if kind == "wall":
        return samples.wall(courses=int(whole(2, 9)), length=float(rng.choice([1.2, 2.4, 3.6])), load=push)
    if kind == "grid":
        return samples.grid(columns=int(whole(2, 11)), rows=int(whole(2, 7)), load=push)
    if kind == "flat-arch":
        return samples.flat_arch(voussoirs=int(whole(3, 12)), rings=int(whole(1, 4)), load=push)
    if kind == "buttress":
        return samples.buttress(courses=int(whole(3, 10)), columns=int(whole(1, 4)))
    if kind == "vault":
        return samples.vault(voussoirs=int(whole(3, 8)), courses=int(whole(1, 4)), load=push)
    return samples.dome(meridians=int(whole(4, 9)), parallels=int(whole(2, 4)), load=push)


def _search(rng: np.random.Generator) -> dict[str, Any]:
    """Random limits."""
    search: dict[str, Any] = {"block_cells": [1, int(rng.integers(2, 7))]}
    more: list[dict[str, Any]] = [
        {"shapes": [None, int(rng.integers(1, 5))]},
        {"shapes": [None, 3], "moulds": {"rotate": True, "flip": True}},
        {"block_cells": [2, int(rng.integers(3, 9))]},
        {"block_cells": [None, None]},
        {"blocks": [2, int(rng.integers(4, 20))]},
        {"dry_faces": [int(rng.integers(0, 6)), int(rng.integers(10, 60))]},
        {"block_aspect": [None, float(rng.uniform(2.0, 5.0))]},
        {"convex_blocks": True},
        {"assemble": "translation"},
        {"assemble": "standing"},
        {"require": {"load_factor": float(rng.uniform(0.05, 0.5))}},
        {"void": {"cells": "all", "most": 0.3}},
        {"segmentation": False},
        {"symmetry": "none"},
        {"candidates": "all+supports"},
        {"front": {"counts": ["dry_faces", "blocks"]}},
    ]
    for place in rng.permutation(len(more))[: int(rng.integers(0, 4))]:
        search |= more[place]
    return search
