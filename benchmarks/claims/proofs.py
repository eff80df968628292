"""A layout that the exact driver calls proven strongest is the strongest: proofs against enumeration and one job.

Scenes of 6 to 30 faces draw supports, holes, materials, cohesion, crushing, load cases, limits of every kind, shapes,
slits, layouts that can be assembled, required factors and fronts. Every scene is proven with one job and with two,
three or four, by threads and by cubes, with and without a search before the proof, with targets that change at every
step, and with random delays where the work of threads meets. Where the space is small enough all layouts are evaluated.

Threads stand for the worker processes of cubes, which take seconds to start. Every tenth scene is proven by three real
processes, and in half of these proofs one process is killed once it has worked: the result is the same, or not proven.
"""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np
import psutil

from benchmarks.claims.tally import Tally, run_cases
from benchmarks.claims.trials import random_loads
from jld_core import InputError, Scene, build_assembly, parse_scene
from jld_core.limit import load_scale
from jld_core.limit.options import Status
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.driver import Exact
from jld_explore.evaluation import EvaluatorSettings, evaluator_of
from jld_explore.evaluation.protocol import Evaluation
from jld_explore.space import count_named, values_of
from jld_explore.space.search_space import SearchSpace

MOST_CLASSES: Final = 1000
"""Classes up to which a space is enumerated."""

SECONDS: Final = 1.5
"""Time for one proof, s; a proof that takes longer claims nothing."""

TOGETHER: Final = 64
"""Layouts evaluated together: between two such portions the time is looked at."""

LATE: Final = 4.0
"""Multiple of its time after which a search that lists all layouts is given up; it then claims nothing."""

EVERY: Final = 10
"""One scene in this number is proven by real processes as well."""

PROCESS_SECONDS: Final = 40.0
"""Time for a proof by real processes, s; most of it passes before they have started."""

PROCESSES: Final = 3
"""Number of real worker processes."""

CLOSE: Final = 3e-6
"""Relative difference of λ that is allowed: three times what counts as proven."""


@dataclass
class Proof:
    """What a driver found: λ of the best layout, its bound, whether that is proven, and the front or required count.

    seconds, check_seconds: time of the proof, and of the check at its end. tasks: number of tasks of its workers.
    """

    best: float | None
    bound: float | None
    proven: bool
    front: dict[int, float] | None = None
    count: float | None = None
    seconds: float = 0.0
    check_seconds: float = 0.0
    tasks: int = 0


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test proofs on random scenes: see `run_cases`."""
    return run_cases("a layout called proven strongest is the strongest", case, first_seed, cases, seconds)


def case(seed: int, tally: Tally) -> str:
    """Prove the scene of a seed in several ways; return what disagrees, "" for nothing."""
    rng = np.random.default_rng([seed, 28])
    space, document, aim = _scene(rng)
    evaluator = evaluator_of(space.assembly, EvaluatorSettings())
    truth = _enumerate(space, evaluator, aim)
    tally.count("enumerated", truth is not None)
    first = None
    for jobs, threads in ((1, True), (int(rng.integers(2, 5)), bool(rng.random() < 0.7))):
        options: dict[str, Any] = {"search": int(rng.choice([0, 0, 1]))}
        if aim != "require":
            options |= {"step_after": [None, 1, 5][int(rng.integers(3))], "aim": aim}
            options["by_blocks"] = str(rng.choice(["off", "off", "auto", "on"]))
        if not threads:
            options["solo_relaxations"] = 0
        stopped = aim != "require" and jobs > 1 and rng.random() < 0.12
        with _delays(seed) if jobs > 1 else ExitStack():
            if stopped:
                found = _stop_and_resume(space, parse_scene(document), aim, jobs, options, int(rng.integers(1, 40)))
            else:
                found = _prove(space, evaluator, aim, jobs, options)
        tally.count(aim)
        tally.count("stopped and resumed", stopped)
        tally.count("proven", found.proven)
        tally.count("proof ms", round(1e3 * found.seconds))
        tally.count("check ms", round(1e3 * found.check_seconds))
        reference = truth or first
        first = first or found
        problem = _difference(found, reference, space)
        if problem:
            return f"{problem}; {jobs} jobs, {options}, {json.dumps(document)}"
    if seed % EVERY == 0:
        problem = _difference(_by_processes(space, evaluator, aim, seed, tally), truth or first, space)
        if problem:
            return f"{problem}; {PROCESSES} processes, {json.dumps(document)}"
    return ""


def _by_processes(space: SearchSpace, evaluator: Any, aim: str, seed: int, tally: Tally) -> Proof:
    """Prove with real worker processes from the start; in every other such scene kill one that has worked."""
    options: dict[str, Any] = {"search": 0, "solo_relaxations": 0} | (
        {} if aim == "require" else {"aim": aim, "by_blocks": "off"}
    )
    killer = _WorkerKiller(seed // EVERY % 2)
    found = _prove(space, evaluator, aim, PROCESSES, options, PROCESS_SECONDS, nullcontext(), killer)
    tally.count("by processes")
    tally.count("by processes, proven", found.proven)
    tally.count("tasks of processes", found.tasks)
    tally.count("processes killed", killer.killed)
    return found


class _WorkerKiller:
    """Kills worker processes of a driver once one of them has returned a result.

    most: number of processes to kill. killed: number of those killed so far.
    """

    def __init__(self, most: int) -> None:
        self.most, self.killed = most, 0

    def __call__(self, driver: Any) -> None:
        """Kill the next process of a driver; the driver calls this during its work."""
        if self.killed >= self.most or not len(_tasks_of(driver)):
            return
        for process in psutil.Process().children(recursive=True):
            with suppress(psutil.NoSuchProcess):
                if "popen_loky" in " ".join(process.cmdline()):
                    process.kill()
                    self.killed += 1
                    return


def _tasks_of(driver: Any) -> Sequence[float]:
    """Times of the tasks that the worker processes of a driver have finished, s, in versions that keep them."""
    cube_workers = getattr(getattr(driver, "_sources", None), "cube_workers", None)
    return [] if cube_workers is None else cube_workers.task_seconds


def _scene(rng: np.random.Generator) -> tuple[SearchSpace, dict[str, Any], str]:
    """A random space, its scene, and what is to be proven: "best", "front" or "require"."""
    while True:
        document, aim = _document(rng)
        try:
            scene = parse_scene(document)
            space = search_space(scene, build_assembly(scene))
        except InputError:
            continue
        if 6 <= int(space.candidates.sum()) <= 30:
            return space, document, aim


def _document(rng: np.random.Generator) -> tuple[dict[str, Any], str]:
    across, up = int(rng.integers(3, 5)), int(rng.integers(2, 5))
    rows = [["a"] * across for _ in range(up)]
    if rng.random() < 0.2:
        rows[int(rng.integers(up))][int(rng.integers(across))] = "."
    foot = ["#"] * across if rng.random() < 0.7 else ["#", *["."] * (across - 2), "#"]
    strength = float(rng.choice([0.0, 1e3, 4e3, 1e4, 1e6]))
    dry: dict[str, Any] = {"friction_coefficient": float(rng.choice([0.3, 0.6, 0.75, 1.0]))}
    inner: dict[str, Any] = {"tensile_strength": strength, "shear_strength": strength}
    if rng.random() < 0.15:
        dry["cohesion"] = 300.0
    if rng.random() < 0.15:
        dry["compressive_strength"] = 2e5
        inner["compressive_strength"] = 2e5
    search: dict[str, Any] = {"block_cells": [1, int(rng.choice([2, 3, 4, 4]))]}
    limits: dict[str, Any] = {
        "blocks": [None, int(rng.integers(5, 9))],
        "shapes": [None, int(rng.integers(2, 4))],
        "dry_faces": [int(rng.integers(0, 6)), None],
        "convex_blocks": True,
        "assemble": "translation",
        "block_extent": [None, 0.35],
    }
    for name in rng.permutation(list(limits)).tolist()[: int(rng.choice([0, 0, 1, 1, 2]))]:
        search[name] = limits[name]
    if "shapes" in search and rng.random() < 0.5:
        search["moulds"] = {"rotate": bool(rng.random() < 0.5), "flip": bool(rng.random() < 0.5)}
    if rng.random() < 0.15 and "assemble" not in search:
        search["segmentation"] = False
    aim = str(rng.choice(["best", "best", "best", "front", "require"]))
    search["front"] = {"count": str(rng.choice(["blocks", "dry_faces"])), "sense": "max"}
    if aim == "require":
        search["front"]["sense"] = str(rng.choice(["min", "max"]))
        search["require"] = {"load_factor": float(rng.choice([0.2, 0.4, 0.6]))}
    names = [f"c{x}r{y}" for y, row in enumerate(rows) for x, letter in enumerate(row) if letter == "a"]
    document = {
        "name": "proof",
        "grid": {
            "cell": [0.1, float(rng.choice([0.1, 0.15, 0.2]))],
            "thickness": 0.1,
            "rows": ["".join(row) for row in [*rows, foot]],
        },
        "materials": {"density": 2000, "dry": dry, "inner": inner},
        "loads": random_loads(rng, names, False, []),
        "search": search,
    }
    return document, aim


def _enumerate(space: SearchSpace, evaluator: Any, aim: str) -> Proof | None:
    """The truth by evaluating every class; None where there are too many, or where one is not certain."""
    rows: list[np.ndarray[Any, Any]] = []
    count = 0
    end = time.perf_counter() + SECONDS
    for batch, _ in Enumeration(space).batches():
        rows.append(batch)
        count += len(batch)
        if count > MOST_CLASSES or time.perf_counter() > end:
            return None
    labellings = np.concatenate(rows) if rows else np.empty((0, len(space.fixed)), dtype=bool)
    found = []
    for low in range(0, len(labellings), TOGETHER):
        found += evaluator.evaluate_all(labellings[low : low + TOGETHER])
        if time.perf_counter() > end + LATE * SECONDS:
            return None
    if any(one.status in (Status.UNCERTIFIED, Status.FAILED) for one in found):
        return None
    return _best_of(space, labellings, found, aim)


def _best_of(space: SearchSpace, labellings: Any, found: Sequence[Evaluation], aim: str) -> Proof:
    loads = np.array([one.load_factor if one.status is Status.COLLAPSE else -math.inf for one in found])
    stands = np.isfinite(loads)
    best = float(loads[stands].max()) if stands.any() else None
    proof = Proof(best, best, True)
    name, sense = space.search.front.axes[0]
    counts = values_of(count_named(name), space.assembly, labellings) if len(found) else np.empty(0)
    if aim == "front":
        proof.front = {int(c): float(loads[stands & (counts == c)].max()) for c in np.unique(counts[stands])}
    if aim == "require" and space.search.require is not None:
        locked = np.array([one.status is Status.LOCKED for one in found], dtype=bool)
        # seed 1689: exactly the required load, which brackets of equal layouts end on either side of
        carries = counts[(loads >= space.search.require.load_factor * (1.0 - CLOSE)) | locked]
        proof.count = None if not len(carries) else float(carries.min() if sense == "min" else carries.max())
    return proof


def _prove(
    space: SearchSpace,
    evaluator: Any,
    aim: str,
    jobs: int,
    options: dict[str, Any],
    seconds: float = SECONDS,
    workers: AbstractContextManager[object] | None = None,
    disturb: Callable[[Any], None] = lambda driver: None,
) -> Proof:
    """Let the exact driver prove a scene.

    workers: context that provides them, by default threads for processes. disturb: called with the driver as it works.
    """
    driver: Any
    if aim == "require":
        from jld_explore.drivers.exact.driver import MinimumCount

        driver = MinimumCount(space, 0, **options)
    else:
        driver = Exact(space, 0, **options)
    rows: list[Any] = []
    evaluations: list[Evaluation] = []
    start, whole = time.perf_counter(), True
    with workers or _threads_for_processes():
        driver.set_workers(jobs)
        driver.start(_deadline(seconds), lambda: disturb(driver))
        try:
            while len(asked := driver.ask(None)):
                answers = []
                for low in range(0, len(asked), TOGETHER):
                    answers += evaluator.evaluate_all(asked[low : low + TOGETHER])
                    whole &= time.perf_counter() - start < LATE * seconds
                    if not whole:
                        break
                if not whole:
                    break
                driver.tell(asked, answers)
                rows.append(asked)
                evaluations += answers
            tasks = len(_tasks_of(driver))
        finally:
            driver.close()
    labellings = np.concatenate(rows) if rows else np.empty((0, len(space.fixed)), dtype=bool)
    found = _best_of(space, labellings, evaluations, aim)
    found.seconds = time.perf_counter() - start
    check = getattr(driver, "proof_check", None)
    found.check_seconds = 0.0 if check is None else check.seconds
    found.tasks = tasks
    found.proven = whole and bool(driver.finished or driver.exhaustive)
    found.bound = None if driver.exhaustive or aim == "require" else driver.bound
    if aim == "front" and not driver.exhaustive:
        found.front = {one.count: one.load_factor for one in driver.found.values() if one.count is not None}
        found.front = {count: load for count, load in found.front.items() if not math.isnan(load)}
    return found


def _deadline(seconds: float) -> Any:
    """The time limit of one proof, s, as the version at hand takes it."""
    try:
        from jld_core.deadline import Deadline
    except ImportError:  # version 0.2 takes seconds of the clock
        return time.perf_counter() + seconds
    return Deadline(seconds)


def _stop_and_resume(
    space: SearchSpace, scene: Scene, aim: str, jobs: int, options: dict[str, Any], programs: int
) -> Proof:
    """Let the exact driver prove through `explore`, stop it after some programs, and go on from the record."""
    settings = ExploreSettings(pictures=False, jobs=jobs, small=0, seconds=2.0 * SECONDS)
    with _threads_for_processes(), tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "out"
        explore(scene, folder, settings, driver=Exact(space, 0, **options, programs=programs))
        done = explore(scene, folder, replace(settings, resume=True), driver=Exact(space, 0, **options))
    facts = done.summary.facts
    found = Proof(facts["best"], facts["bound"], bool(facts["proven"]), seconds=facts["seconds"])
    found.check_seconds = facts.get("proof_check", {}).get("seconds", 0.0)
    if aim == "front":
        rows = [
            row
            for row in facts.get("best_by_count", facts["front"])
            if row["load_factor"] is not None and row["proven"]
        ]
        found.front = {int(row["count"]): float(row["load_factor"]) for row in rows}
    return found


@contextmanager
def _threads_for_processes() -> Iterator[None]:
    """Put threads in the place of worker processes, which take a second each to start, and lend cubes but briefly."""
    with (
        patch("jld_explore.evaluation.pool.make_executor", ThreadPoolExecutor),
        patch("jld_explore.drivers.exact.cube_workers.TASK_SECONDS", 0.0),
    ):
        yield


def _difference(found: Proof, truth: Proof | None, space: SearchSpace) -> str:
    """What a proof has wrong, "" for nothing."""
    if truth is None or not found.proven or not truth.proven:
        return ""
    if space.search.require is not None:
        wrong = found.count != truth.count
        return f"the best count is {truth.count}, called proven {found.count}" if wrong else ""
    if (found.best is None) != (truth.best is None):
        return f"λ = {truth.best}, called proven {found.best}"
    if found.best is None or truth.best is None:
        return ""
    room = CLOSE * max(abs(truth.best), load_scale(space.assembly))
    if abs(found.best - truth.best) > room:
        return f"λ = {truth.best:.9g}, called proven {found.best:.9g}"
    if found.bound is not None and found.bound < truth.best - room:
        return f"λ = {truth.best:.9g} above the bound {found.bound:.9g}"
    if found.front is not None and truth.front is not None:
        for count in sorted(found.front.keys() | truth.front.keys()):
            low, high = found.front.get(count, -math.inf), truth.front.get(count, -math.inf)
            if abs(low - high) > room:
                return f"front at {count}: λ = {high:.9g}, called proven {low:.9g}"
    return ""


@contextmanager
def _delays(seed: int) -> Iterator[None]:
    """Random delays where the work of threads meets."""
    import jld_explore.drivers.exact.cube_workers as conflict_sources

    rng = np.random.default_rng([seed, 7])
    delays = rng.exponential(0.002, 997) * (rng.random(997) < 0.3)
    number = 0

    def random_delay(_: str) -> None:
        nonlocal number
        number += 1
        time.sleep(float(delays[number % 997]))

    with patch.object(conflict_sources, "delay_point", random_delay):
        yield
