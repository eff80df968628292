"""Random cases of searches: proofs against enumeration, certificates, time limits."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np
import psutil

from benchmarks.claims import Tally, run_cases
from benchmarks.scenes import cells, names_of, stones
from jld_core import Deadline, InputError, Scene, Status, build_assembly, parse_scene, samples
from jld_core.limit import load_scale
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers import make_driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.certifying import certify, check_certifiable
from jld_explore.drivers.exact.driver import Exact, MinimumCount
from jld_explore.evaluation import EvaluatorSettings, evaluator_of
from jld_explore.evaluation.protocol import Evaluation
from jld_explore.space import count_named, feasible, values_of
from jld_explore.space.search_space import SearchSpace
from jld_explore.verification import verify
from jld_samples import box

Document = dict[str, Any]
Known = list[tuple[Any, Evaluation]]  # labellings and what they come to
MOST: Final = 11  # faces that may change, at the most: 2 048 labellings
# faces below which a scene is drawn again, the oftener the fewer: one or two leave little to be wrong about
_FEW: Final = 6


def drawn_trials(seed: int) -> tuple[Scene, SearchSpace, list[str], np.random.Generator, Document]:
    """The scene of a seed: the first that its numbers draw which is a scene, and small enough."""
    rng = np.random.default_rng(seed)
    while True:
        document, kinds = draw(rng)
        try:
            scene = parse_scene(document)
            space = search_space(scene, build_assembly(scene))
        except InputError:
            continue
        faces = int(space.candidates.sum())
        if faces <= MOST and rng.random() * _FEW < faces:
            return scene, space, kinds, rng, document


def draw(rng: np.random.Generator) -> tuple[Document, list[str]]:
    kinds: list[str] = []
    spatial = rng.random() < 0.15
    dry: Document = {"friction_coefficient": float(rng.choice([0.0, 0.3, 0.75, 1.5], p=[0.05, 0.25, 0.6, 0.1]))}
    strength = float(rng.choice([0.0, 5e2, 2e3, 1e4, 1e6], p=[0.1, 0.25, 0.3, 0.25, 0.1]))
    inner: Document = {"tensile_strength": strength}
    inner["shear_strength"] = strength * float(rng.choice([0.5, 1.0, 2.0]))
    if rng.random() < 0.2:
        dry["cohesion"] = 500.0
        kinds.append("cohesion")
    if rng.random() < 0.2 and strength:
        inner["friction_coefficient"] = 0.9 * inner["shear_strength"] / strength
        kinds.append("inner friction")
    if rng.random() < 0.3:
        # crushing of dry faces asks for that of inner ones nowhere
        which = rng.integers(1, 4)
        for side, bit in ((dry, 1), (inner, 2)):
            if which & bit:
                side["compressive_strength"] = float(rng.choice([2e4, 2e5]))
        kinds.append("crushing")
    search = _limits(rng, spatial, kinds)
    if spatial:
        kinds.append("space")
        places = [(i, j, k) for i in range(2) for j in range(rng.integers(1, 3)) for k in range(rng.integers(1, 3))]
        names = [f"b{i}{j}{k}" for i, j, k in places]
        elements = [_cubes("ground", (0, 0, -1), (2, 2, 1), support=True), *map(_cubes, names, places)]
        document = stones(elements, [], dry, inner, density=1400) | {"loads": random_loads(rng, names, spatial, kinds)}
    else:
        rows, cell = _rows(rng, kinds), [0.1, float(rng.choice([0.05, 0.1, 0.2]))]
        document = cells(rows, cell, dry, inner, random_loads(rng, names_of(rows), spatial, kinds))
    document |= {"name": "trial", "search": search}
    if rng.random() < 0.2:
        document["labels"] = {"default": "inner"}
    return document, kinds


def _rows(rng: np.random.Generator, kinds: list[str]) -> list[str]:
    across, up = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    rows = [["a"] * across for _ in range(up)]
    if rng.random() < 0.25 and across > 2 and up > 1:
        rows[-1][1] = "."
        kinds.append("holes")
    foot = ["#"] * across
    if rng.random() < 0.25:
        kinds.append("between abutments")
        return ["#" + "".join(row) + "#" for row in rows]
    if rng.random() < 0.3 and across > 2:
        foot = ["#", *["."] * (across - 2), "#"]
        kinds.append("bearings")
    return ["".join(row) for row in [*rows, foot]]


def _cubes(name: str, low: Sequence[int], size: Sequence[int] = (1, 1, 1), **keys: Any) -> Document:
    """An element of so many cubes of 0.1 m."""
    return box(name, [0.1 * v for v in low], [0.1 * (v + s) for v, s in zip(low, size, strict=True)], **keys)


def random_loads(rng: np.random.Generator, names: list[str], spatial: bool, kinds: list[str]) -> Document:
    def live() -> list[Document]:
        if rng.random() < 0.6:
            body = [float(rng.choice([-1.0, 1.0])), float(rng.choice([0.0, 0.0, 0.4, -0.5]))]
            return [{"body": [*body, 0.0] if spatial else body}]
        force = [float(rng.choice([0.0, 1.0])), -1.0]
        return [{"element": str(rng.choice(names)), "force": [force[0], 0.0, -1.0] if spatial else force}]

    if rng.random() < 0.2:
        kinds.append("cases")
        sides = ("one", "two")
        return {"cases": [{"name": k, "live": live(), "required": float(rng.choice([1.0, 1.5]))} for k in sides]}
    return {"live": live()}


def _limits(rng: np.random.Generator, spatial: bool, kinds: list[str]) -> Document:
    found: Document = {}
    low, high = sorted(int(v) for v in rng.integers(1, 5, 2))
    unit = 0.001 if spatial else 0.0005
    known: Document = {
        "block_cells": [None if rng.random() < 0.6 else low, high],
        "block_extent": [None, float(rng.choice([0.1, 0.2, 0.3]))],
        "block_mass": [None, 1400 * unit * high * 2.0],
        "block_weight": [9.81 * 1400 * unit * float(rng.choice([0.5, 1.5])), None],
        "block_aspect": [None, float(rng.choice([1.5, 2.0, 3.0]))],
        "convex_blocks": True,
        "blocks": [int(rng.integers(1, 4)), int(rng.integers(4, 8))],
        "dry_faces": [int(rng.integers(0, 4)), int(rng.integers(4, 12))],
        "shapes": [None, int(rng.integers(1, 4))],
    }
    for key in rng.permutation(list(known)).tolist()[: int(rng.choice([0, 1, 1, 1, 2, 2, 3]))]:
        if not (spatial and key in ("block_aspect", "convex_blocks")):
            found[key] = known[key]
            kinds.append(key)
    for kind, key, value in (("slits", "segmentation", False), ("supports", "candidates", "all+supports")):
        if rng.random() < 0.15:
            found[key] = value
            kinds.append(kind)
    if rng.random() < 0.2:
        found["symmetry"] = "none"
    if rng.random() < 0.1 and "segmentation" not in found:
        found["assemble"] = "translation"
        kinds.append("laid")
    return found


_CLOSE: Final = 2e-6  # how near proven and true have to be: twice what counts as proven


def every(space: SearchSpace) -> Iterator[tuple[np.ndarray[Any, Any], Evaluation]]:
    spots = np.flatnonzero(space.candidates)
    rows = np.repeat(space.fixed[None], 1 << len(spots), axis=0)
    rows[:, spots] = (np.arange(len(rows))[:, None] >> np.arange(len(spots))) & 1
    rows = rows[feasible(space, rows)]
    evaluator = evaluator_of(space.assembly, EvaluatorSettings())
    yield from zip(rows, evaluator.evaluate_all(rows), strict=True)


def case_trials(seed: int, tally: Tally) -> str:
    """Hold what is proven of the scene of a seed against all its labellings; return what disagrees, "" for nothing.

    Every labelling of a small random scene is evaluated, those that its limits leave are kept, and the largest λ is
    held against what the exact driver proves, with whatever options the seed draws: blocks listed or not, a tree of
    blocks or none, hardly any search before the proof, stopped on the way and gone on with, two jobs (threads in the
    place of processes), whole fronts, a load factor required and a count proven, and, where the scene has one, a
    certificate that is written and verified. Scenes draw supports, holes, materials with every strength, limits of
    every kind, kept labels, slits, layouts that can be laid, load cases, and space. ``notes`` counts what the scenes
    had.
    """
    scene, space, kinds, rng, document = drawn_trials(seed)
    options: Document = {
        "by_blocks": str(rng.choice(["auto", "on", "off"])),
        "list_blocks": bool(rng.random() < 0.7) or "blocks" in kinds,
        "search": int(rng.choice([0, 1, 10])),
        "aim": "front" if rng.random() < 0.15 else "best",
    }
    stopped = int(rng.integers(1, 25)) if rng.random() < 0.25 else 0
    jobs = 2 if rng.random() < 0.1 else 1
    rng.random()  # Formerly the choice of an option; drawn so that a seed means the same scene as before.
    had = (("front", options["aim"] == "front"), ("stopped", stopped > 0), ("two jobs", jobs > 1))
    kinds += [name for name, on in had if on]
    known = list(every(space))
    required = _required(rng, document, known) if rng.random() < 0.1 else None
    try:
        with tempfile.TemporaryDirectory() as folder, _threads_for_processes():
            if required is not None:
                kinds.append("required")
                problem = _compare_required(required, known, jobs, Path(folder))
            else:
                problem = _compare(scene, space, known, options, stopped, jobs, kinds, Path(folder))
    except Exception:
        problem = traceback.format_exc()
    for kind in kinds:
        tally.count(kind)
    return f"{problem}; {json.dumps(document)}" if problem else ""


def _compare(
    scene: Scene,
    space: SearchSpace,
    known: Known,
    options: Document,
    stopped: int,
    jobs: int,
    kinds: list[str],
    at: Path,
) -> str:
    folder, path = at, at / "proof.jld"
    settings = ExploreSettings(pictures=False, jobs=jobs, small=0)
    if jobs > 1:
        options = {**options, "solo_relaxations": 0}
    try:
        check_certifiable(Exact(space, **options), settings.model, scene)
        certified = all(found.status is not Status.LOCKED for _, found in known) and bool(known)
    except InputError:
        certified = False
    driver = Exact(space, **options)
    try:
        if stopped:
            explore(scene, folder / "out", settings, driver=Exact(space, **options, programs=stopped))
        again = replace(settings, resume=stopped > 0)
        facts = explore(scene, folder / "out", again, driver=driver).summary.facts
    except InputError as error:
        if not known and "no labelling" in str(error):
            return ""
        raise
    sure = all(found.status not in (Status.UNCERTIFIED, Status.FAILED) for _, found in known)
    values = [(labels, found) for labels, found in known if found.status is Status.COLLAPSE]
    best = max((found.load_factor for _, found in values), default=None)
    left = facts["counts_by_status"]
    sure = sure and not any(left.get(str(status)) for status in (Status.UNCERTIFIED, Status.FAILED))
    if not sure:
        kinds.append("uncertified labellings")
    room = _CLOSE * max(abs(best or 0.0), min(load_scale(case_trials) for case_trials in space.assembly.by_case))
    if best is None:
        return "" if facts["best"] is None or not sure else f"nothing stands, found {facts['best']}"
    if facts["best"] is None or abs(facts["best"] - best) > room:
        return "" if not sure else f"the best is {best!r}, found {facts['best']!r}, proven {facts['proven']}"
    if facts["bound"] is not None and facts["bound"] < best - room:
        return f"the best is {best!r}, bounded by {facts['bound']!r}"
    if sure and not facts["proven"]:
        return f"{best!r} not proven: bound {facts['bound']!r}, stopped for {facts['stop_reason']}"
    if any(found.status is Status.LOCKED for _, found in known) != bool(facts["unbounded"]) and facts["classes"]:
        return "unbounded is not said right"
    if certified:
        try:
            certify(driver, scene, path, None)
        except InputError:
            kinds.append("no certificate")
            return ""
        kinds.append("certificate")
        bound = verify(path, scene).claim.bound
        if not best - room <= bound <= best + 2.0 * room and sure:
            return f"the best is {best!r}, certified {bound!r}"
    if options["aim"] == "front" and sure and "best_by_count" in facts:
        return _fronts(space, values, facts["best_by_count"], room)
    return ""


def _required(rng: np.random.Generator, document: Document, known: Known) -> Document | None:
    loads = np.unique([found.load_factor for _, found in known if found.status is Status.COLLAPSE])
    loads = loads[loads > 1e-3]
    apart = np.flatnonzero(np.diff(loads) > 1e-3 * loads[1:])
    if not len(loads):
        return None
    choices = [2.0 * loads[-1], *(0.5 * (loads[apart] + loads[apart + 1]))]
    front = {"count": str(rng.choice(["blocks", "dry_faces", "shapes"])), "sense": str(rng.choice(["min", "max"]))}
    require = {"load_factor": float(rng.choice(choices))}
    return {**document, "search": {**document["search"], "front": front, "require": require}}


def _compare_required(document: Document, known: Known, jobs: int, folder: Path) -> str:
    """The best count of what carries enough, proven, against all that does."""
    scene = parse_scene(document)
    space = search_space(scene, build_assembly(scene))
    assert scene.search.require is not None
    least, (name, sense) = scene.search.require.load_factor, scene.search.front.axes[0]
    driver = make_driver("exact", space, 0)
    settings = ExploreSettings(pictures=False, jobs=jobs, small=0)
    asked = explore(scene, folder / "out", settings, driver=driver).summary.facts["require"]
    if any(found.status in (Status.UNCERTIFIED, Status.FAILED) for _, found in known):
        return ""

    def carries(found: Evaluation) -> bool:
        return found.status is Status.LOCKED or (found.status is Status.COLLAPSE and found.load_factor >= least)

    rows = [labels for labels, found in known if carries(found)]
    counts = values_of(count_named(name), space.assembly, np.array(rows)).tolist() if rows else []
    best = (min(counts) if sense == "min" else max(counts)) if counts else None
    if asked["best"] != best or not asked["proven"]:
        return f"the best {name} ({sense}) of λ ≥ {least!r} is {best}, found {asked['best']}, proven {asked['proven']}"
    return ""


def _fronts(space: SearchSpace, values: list[tuple[Any, Evaluation]], rows: list[Document], room: float) -> str:
    rows_of_labels = np.array([labels for labels, _ in values])
    counts = values_of(count_named(space.search.front.count), space.assembly, rows_of_labels)
    best: dict[int, float] = {}
    for count, (_, found) in zip(counts.tolist(), values, strict=True):
        best[count] = max(best.get(count, -np.inf), found.load_factor)
    proven = {row["count"]: row["load_factor"] for row in rows if row["load_factor"] is not None}
    for count in sorted(best.keys() | proven.keys()):
        if count not in best or count not in proven or abs(best[count] - proven[count]) > room:
            return f"front at {count}: the best is {best.get(count)}, proven {proven.get(count)}"
    return ""


MOST_CLASSES: Final = 1000  # classes up to which a space is enumerated
SECONDS_PROOFS: Final = 1.5  # time for one proof, s; a proof that takes longer claims nothing
TOGETHER: Final = 64  # layouts evaluated together: between two such portions the time is looked at
# multiple of its time after which a search that lists all layouts is given up; it then claims nothing
LATE: Final = 4.0
EVERY: Final = 10  # one scene in this number is proven by real processes as well
PROCESS_SECONDS: Final = 40.0  # time for a proof by real processes, s; most of it passes before they have started
PROCESSES: Final = 3  # number of real worker processes
CLOSE_PROOFS: Final = 3e-6  # relative difference of λ that is allowed: three times what counts as proven


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


def case_proofs(seed: int, tally: Tally) -> str:
    """Prove the scene of a seed in several ways; return what disagrees, "" for nothing.

    Scenes of 6 to 30 faces draw supports, holes, materials, cohesion, crushing, load cases, limits of every kind,
    shapes, slits, layouts that can be assembled, required factors and fronts. Every scene is proven with one job and
    with two, three or four, by threads and by cubes, with and without a search before the proof, with targets that
    change at every step, and with random delays where the work of threads meets. Where the space is small enough all
    layouts are evaluated.

    Threads stand for the worker processes of cubes, which take seconds to start. Every tenth scene is proven by three
    real processes, and in half of these proofs one process is killed once it has worked: the result is the same, or not
    proven.
    """
    rng = np.random.default_rng([seed, 28])
    space, document, aim = _scene_proofs(rng)
    evaluator = evaluator_of(space.assembly, EvaluatorSettings())
    truth = _enumerate(space, evaluator, aim)
    tally.count("enumerated", truth is not None)
    first = None
    for jobs, threads in ((1, True), (int(rng.integers(2, 5)), bool(rng.random() < 0.7))):
        options: Document = {"search": int(rng.choice([0, 0, 1]))}
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
        notes = {aim: 1, "stopped and resumed": stopped, "proven": found.proven}
        notes |= {"proof ms": round(1e3 * found.seconds), "check ms": round(1e3 * found.check_seconds)}
        for name, number in notes.items():
            tally.count(name, number)
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
    own = {} if aim == "require" else {"aim": aim, "by_blocks": "off"}
    options: Document = {"search": 0, "solo_relaxations": 0, **own}
    killer = _WorkerKiller(seed // EVERY % 2)
    found = _prove(space, evaluator, aim, PROCESSES, options, killer)
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
    cube_workers = getattr(getattr(driver, "_sources", None), "cube_workers", None)
    return [] if cube_workers is None else cube_workers.task_seconds


def _scene_proofs(rng: np.random.Generator) -> tuple[SearchSpace, Document, str]:
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


def _document(rng: np.random.Generator) -> tuple[Document, str]:
    across, up = int(rng.integers(3, 5)), int(rng.integers(2, 5))
    rows = [["a"] * across for _ in range(up)]
    if rng.random() < 0.2:
        rows[int(rng.integers(up))][int(rng.integers(across))] = "."
    foot = ["#"] * across if rng.random() < 0.7 else ["#", *["."] * (across - 2), "#"]
    strength = float(rng.choice([0.0, 1e3, 4e3, 1e4, 1e6]))
    dry: Document = {"friction_coefficient": float(rng.choice([0.3, 0.6, 0.75, 1.0]))}
    inner: Document = {"tensile_strength": strength, "shear_strength": strength}
    if rng.random() < 0.15:
        dry["cohesion"] = 300.0
    if rng.random() < 0.15:
        dry["compressive_strength"] = inner["compressive_strength"] = 2e5
    search: Document = {"block_cells": [1, int(rng.choice([2, 3, 4, 4]))]}
    limits: Document = {"blocks": [None, int(rng.integers(5, 9))], "shapes": [None, int(rng.integers(2, 4))]}
    limits |= {"dry_faces": [int(rng.integers(0, 6)), None], "convex_blocks": True, "assemble": "translation"}
    limits["block_extent"] = [None, 0.35]
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
    cell, lines = [0.1, float(rng.choice([0.1, 0.15, 0.2]))], ["".join(row) for row in [*rows, foot]]
    loads = random_loads(rng, names_of(rows), False, [])
    return cells(lines, cell, dry, inner, loads, density=2000, name="proof", search=search), aim


def _enumerate(space: SearchSpace, evaluator: Any, aim: str) -> Proof | None:
    rows: list[np.ndarray[Any, Any]] = []
    count = 0
    end = time.perf_counter() + SECONDS_PROOFS
    for batch, _ in Enumeration(space).batches():
        rows.append(batch)
        count += len(batch)
        if count > MOST_CLASSES or time.perf_counter() > end:
            return None
    labellings = np.concatenate(rows) if rows else np.empty((0, len(space.fixed)), dtype=bool)
    found = []
    for low in range(0, len(labellings), TOGETHER):
        found += evaluator.evaluate_all(labellings[low : low + TOGETHER])
        if time.perf_counter() > end + LATE * SECONDS_PROOFS:
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
        carries = counts[(loads >= space.search.require.load_factor * (1.0 - CLOSE_PROOFS)) | locked]
        proof.count = None if not len(carries) else float(carries.min() if sense == "min" else carries.max())
    return proof


def _prove(
    space: SearchSpace, evaluator: Any, aim: str, jobs: int, options: Document, killer: _WorkerKiller | None = None
) -> Proof:
    """Let the exact driver prove a scene, by threads for processes unless one is given that kills processes."""
    seconds = PROCESS_SECONDS if killer else SECONDS_PROOFS
    driver: Any = (MinimumCount if aim == "require" else Exact)(space, 0, **options)
    rows: list[Any] = []
    evaluations: list[Evaluation] = []
    start, whole = time.perf_counter(), True
    with nullcontext() if killer else _threads_for_processes():
        driver.set_workers(jobs)
        driver.start(Deadline(seconds), lambda: killer(driver) if killer else None)
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
    check = getattr(driver, "proof_check", None)
    found.seconds, found.tasks = time.perf_counter() - start, tasks
    found.check_seconds = 0.0 if check is None else check.seconds
    found.proven = whole and bool(driver.finished or driver.exhaustive)
    found.bound = None if driver.exhaustive or aim == "require" else driver.bound
    if aim == "front" and not driver.exhaustive:
        found.front = {one.count: one.load_factor for one in driver.found.values() if one.count is not None}
        found.front = {count: load for count, load in found.front.items() if not math.isnan(load)}
    return found


def _stop_and_resume(space: SearchSpace, scene: Scene, aim: str, jobs: int, options: Document, programs: int) -> Proof:
    """Let the exact driver prove through `explore`, stop it after some programs, and go on from the record."""
    settings = ExploreSettings(pictures=False, jobs=jobs, small=0, seconds=2.0 * SECONDS_PROOFS)
    with _threads_for_processes(), tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "out"
        explore(scene, folder, settings, driver=Exact(space, 0, **options, programs=programs))
        done = explore(scene, folder, replace(settings, resume=True), driver=Exact(space, 0, **options))
    facts = done.summary.facts
    found = Proof(facts["best"], facts["bound"], bool(facts["proven"]), seconds=facts["seconds"])
    found.check_seconds = facts.get("proof_check", {}).get("seconds", 0.0)
    if aim == "front":
        points = facts.get("best_by_count", facts["front"])
        rows = [row for row in points if row["load_factor"] is not None and row["proven"]]
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
    if truth is None or not found.proven or not truth.proven:
        return ""
    if space.search.require is not None:
        wrong = found.count != truth.count
        return f"the best count is {truth.count}, called proven {found.count}" if wrong else ""
    if (found.best is None) != (truth.best is None):
        return f"λ = {truth.best}, called proven {found.best}"
    if found.best is None or truth.best is None:
        return ""
    room = CLOSE_PROOFS * max(abs(truth.best), load_scale(space.assembly))
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
    rng = np.random.default_rng([seed, 7])
    delays = rng.exponential(0.002, 997) * (rng.random(997) < 0.3)
    waits = itertools.cycle(delays.tolist())
    with patch("jld_explore.drivers.exact.cube_workers.delay_point", lambda _: time.sleep(next(waits))):
        yield


CLOSE_MEMBERS: Final = 1e-6  # largest relative difference of both optima
ABOVE: Final = 1e-5  # largest relative distance of the bound of a certificate above the optimum
_INSIDE: Final = [["c0r0", "c1r0"], ["c0r0", "c0r1"], ["c1r0", "c1r1"], ["c0r1", "c1r1"]]
SEARCHES: Final[list[Document]] = [  # searches that scenes take in turn; certificates know the first one
    {"block_cells": [1, 2]},
    {"block_cells": [1, 2], "candidates": "all+supports"},
    {"block_cells": [1, 2], "segmentation": False, "candidates": _INSIDE},
    {"block_cells": [1, 3], "front": {"count": "blocks", "sense": "min"}, "require": {"load_factor": 0.4}},
]


def case_members(seed: int, tally: Tally) -> str:
    """Return "" if the optima of one wall agree, otherwise one line that says how they differ.

    Random walls of 2 by 3 cells have one to three ties, tendons over two or three points, and pins, anchored in cells
    and in supports. Half of them have bond, a third crush, and in turn supports are candidates, slits are allowed, or a
    load factor is required. The exact driver and enumeration must agree to 1e-6. `jld verify` must accept the
    certificate of a proof, where the search allows one, and its bound must lie above the optimum by at most 1e-5.
    """
    scene = parse_scene(drawn_members(seed))
    with tempfile.TemporaryDirectory() as folder:
        out, file = Path(folder), Path(folder) / "proof"
        common: Document = {"pictures": False, "check_fields": 0, "seconds": 60.0}
        every = explore(scene, out / "every", ExploreSettings(driver="enumeration", **common)).summary
        certificate = file if seed % len(SEARCHES) == 0 else None
        exact = ExploreSettings(driver="exact", certificate=certificate, **common)
        proof = explore(scene, out / "exact", exact).summary
        tally.count("members", len(scene.members))
        if not (every.proven and proof.proven):
            tally.count("not proven")
            return ""
        if every.best is None or proof.best is None:
            tally.count("no finite λ")
            same = every.best == proof.best
            return "" if same else f"seed {seed}: {every.best} by enumeration, {proof.best} by proof"
        if abs(every.best - proof.best) > CLOSE_MEMBERS * abs(every.best):
            return f"seed {seed}: {every.best:.9g} by enumeration, {proof.best:.9g} by proof"
        if certificate is not None:
            bound = float(verify(file).claim.bound)
            tally.count("verified")
            if not every.best * (1.0 - CLOSE_MEMBERS) <= bound <= every.best * (1.0 + ABOVE):
                return f"seed {seed}: the certificate bounds {bound:.9g}, the optimum is {every.best:.9g}"
    return ""


def drawn_members(seed: int) -> Document:
    rng = np.random.default_rng(seed)
    friction = float(rng.uniform(0.3, 0.8))
    dry: Document = {"friction_coefficient": friction}
    inner: Document = {key: float(rng.uniform(3e3, 1e4)) for key in ("tensile_strength", "shear_strength")}
    if rng.random() < 0.5:
        bond = float(rng.uniform(100.0, 2000.0))
        dry |= {"tensile_strength": bond, "cohesion": bond * friction * float(rng.uniform(1.0, 2.0))}
    if rng.random() < 0.3:
        dry["compressive_strength"] = inner["compressive_strength"] = float(rng.uniform(1e5, 5e5))
    members = [found for _ in range(rng.integers(1, 4)) if (found := _member(rng)) is not None]
    loads = {"live": [{"body": [float(rng.choice([-1, 1])), 0]}]}
    own: Document = {"thickness": 1.0, "density": 1000, "members": members, "search": SEARCHES[seed % len(SEARCHES)]}
    return cells(["abc", "def", "###"], [1, 1], dry, inner, loads, name=f"wall {seed}", **own)


def _member(rng: np.random.Generator) -> Document | None:
    """Return a random member; None for one between supports alone."""
    cells = [divmod(int(k), 3) for k in rng.choice(9, 3, replace=False)]
    anchors = [
        {"element": f"c{c}r{r}", "at": [c + float(rng.uniform()), 2 - r + float(rng.uniform())]} for c, r in cells
    ]
    if all(row == 2 for _, row in cells[:2]):
        return None
    found: Document = {"from": anchors[0], "to": anchors[1]}
    kind, force = str(rng.choice(["tie", "tendon", "pin"])), float(rng.uniform(1e3, 2e4))
    if kind == "tie":
        return {**found, "kind": kind, "tension": force, "compression": float(rng.choice([0.0, 0.5 * force]))}
    if kind == "pin":
        return {**found, "kind": kind, "shear": force, "tension": float(rng.choice([0.0, force / 3.0]))}
    more = {"tension": force} if rng.random() < 0.6 else {}
    over = {"through": [anchors[2]]} if rng.random() < 0.5 else {}
    return {**found, "kind": kind, "prestress": 0.25 * force, **more, **over}


_MUTATIONS: Final = 30
# share of λ by which the best layout of an enumeration may exceed a bound: width of brackets, gap of proofs
_TOLERANCE: Final = 2e-6


def case_certificates(seed: int, tally: Tally) -> str:
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = folder / "proof.jld"
        try:
            settings = ExploreSettings(driver="exact", certificate=path, pictures=False, seed=seed)
            explore(parse_scene(_scene_certificates(rng)), folder / "out", settings)
        except InputError as error:
            tally.count("no certificate")
            # a bound whose mechanisms do not stand in whole numbers, or no layout at all
            return "" if "\n" not in str(error) else f"refused in several lines: {error}"
        whole = path.read_bytes()
        for number in range(_MUTATIONS + 1):
            changed = whole if number == 0 else _changed(whole, rng)
            path.write_bytes(changed)
            problem = _judged(path, folder / f"again{number}", changed == whole, tally)
            if problem:
                return f"mutation {number}: {problem}"
    return ""


def _judged(path: Path, folder: Path, is_whole: bool, tally: Tally) -> str:
    """Return what is wrong with the answer about one file, "" if nothing is."""
    try:
        claim = verify(path).claim
    except InputError as error:
        tally.count("refused")
        return "a whole certificate is refused: " + str(error) if is_whole else ""
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    tally.count("accepted")
    if not isinstance(claim.bound, int | float) or not math.isfinite(claim.bound):
        return f"the bound {claim.bound!r} is accepted"
    if not isinstance(claim.load_factor, int | float | None):
        return f"the found load factor {claim.load_factor!r} is accepted"
    if claim.load_factor is not None and not claim.load_factor <= claim.bound:
        return f"a found load factor {claim.load_factor} above the bound {claim.bound} is accepted"
    try:
        settings = ExploreSettings(driver="enumeration", pictures=False)
        found = explore(parse_scene(claim.scene), folder, settings).summary.facts
    except InputError:
        return ""  # no layout at all: any bound holds
    best = math.inf if found["unbounded"] else found["best"]
    if best is not None and best > claim.bound + _TOLERANCE * max(abs(claim.bound), 1e-3):
        return f"the bound {claim.bound} is accepted, and a layout carries {best}"
    return ""


def _scene_certificates(rng: random.Random) -> Document:
    """Return a random wall of at most six cells on supports."""
    width, height = rng.choice([(2, 1), (3, 1), (2, 2), (3, 2), (2, 3)])
    dry: dict[str, float] = {"friction_coefficient": rng.choice([0.3, 0.75, 1.2])}
    inner: dict[str, float] = {key: rng.choice([1e3, 2e3, 2e4]) for key in ("tensile_strength", "shear_strength")}
    if rng.random() < 0.3:
        dry["compressive_strength"] = inner["compressive_strength"] = rng.choice([2e4, 1e6])
    search: Document = {"block_cells": rng.choice([[1, 2], [1, 3], [2, 4], [None, None]])}
    if rng.random() < 0.2:
        search["segmentation"] = False
    if rng.random() < 0.2:
        search["candidates"] = "all+supports"
    if rng.random() < 0.3:
        search["dry_faces"] = [1, None]
    loads: Document = {"live": [{"body": [1, rng.choice([0, -0.4, 0.3])]}]}
    if rng.random() < 0.2:
        sides = (("left", 1), ("right", -1))
        loads = {"cases": [{"name": side, "live": [{"body": [sign, 0]}]} for side, sign in sides]}
    rows = ["a" * width] * height + ["#" * width]
    return cells(rows, [rng.choice([0.1, 0.25]), 0.1], dry, inner, loads, search=search)


def _changed(whole: bytes, rng: random.Random) -> bytes:
    """Return the file with a few bytes, or one field or line, changed; mostly with the digest that it has then."""
    body = whole[: whole.rstrip(b"\n").rfind(b"\n") + 1]
    if rng.random() < 0.3:
        found = bytearray(body)
        for _ in range(rng.randint(1, 3)):
            place = rng.randrange(len(found))
            found[place : place + rng.randint(0, 2)] = bytes(
                rng.choice(b'0123456789-.,e[]{}":ntfNI\n \xff') for _ in "ab"
            )
        body = bytes(found)
    else:
        lines = [json.loads(line) for line in body.splitlines()]
        _change_lines(lines, rng)
        body = "".join(json.dumps(line) + "\n" for line in lines).encode()
    digest = "0" * 64 if rng.random() < 0.1 else hashlib.sha256(body).hexdigest()
    return body + json.dumps({"sha256": digest}).encode() + b"\n"


def _change_lines(lines: list[Any], rng: random.Random) -> None:
    kind = rng.random()
    place = rng.randrange(len(lines))
    if kind < 0.08:
        del lines[place]
    elif kind < 0.14:
        lines.insert(rng.randrange(len(lines)), lines[place])
    elif kind < 0.2:
        other = rng.randrange(len(lines))
        lines[place], lines[other] = lines[other], lines[place]
    else:
        _change_field(lines[0] if rng.random() < 0.5 else lines[place], rng)


def _change_field(part: Any, rng: random.Random) -> None:
    """Change, remove or add one entry at a random depth of a JSON object or list."""
    while True:
        keys = list(part) if isinstance(part, dict) else list(range(len(part)))
        if not keys:
            return
        key = rng.choice(keys)
        if isinstance(part[key], dict | list) and part[key] and rng.random() < 0.8:
            part = part[key]
            continue
        break
    action = rng.random()
    if action < 0.1:
        del part[key]
    elif action < 0.15 and isinstance(part, list):
        part.append(part[key])
    else:
        part[key] = _other_value(part[key], rng)


def _other_value(value: Any, rng: random.Random) -> Any:
    near: list[Any] = []
    if isinstance(value, int | float) and not isinstance(value, bool):
        near = [value * 0.999, value * 0.5, value * 2, -value, value + 1, value - 1, round(value), value * (1 - 1e-6)]
    strange: list[Any] = [0, 1, -1, None, math.nan, math.inf, -math.inf, "", "a", [], {}, 10**30, 1e308, 5e-324, True]
    strange += [-0.0, [[]]]
    return rng.choice(near if near and rng.random() < 0.7 else strange)


# drivers by name, "" for the one that is chosen where none is named
DRIVERS: Final = ("", "enumeration", "random", "hillclimb", "anneal", "genetic", "portfolio", "optuna", "exact")
SECONDS_TIME_LIMITS: Final = (2.0, 3.0, 4.0)  # time limits, s
HANGS: Final = 90.0  # seconds after which a search is killed
TURNS: Final = 3  # how often a search that ends late is run at the most
# bounds of the classes in which the seconds past the limit S are counted
STEPS: Final = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
# words of the message of a search that neither found a layout in time nor proved that there is none
UNDECIDED: Final = "nor a proof that there is none"
# time by the clock over processor time of one start of the program below which a machine counts as idle
IDLE_BELOW: Final = 1.1
# file with the times, ns, that a process ran and that it waited for a processor, on systems that have it
WAITED: Final = Path("/proc/self/schedstat")

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


def run_time_limits(claim: str, first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim; as `run_cases` does.

    Each case is `jld explore SCENE --seconds S` as a process of its own. The scenes are samples with random limits on
    blocks, counts, shapes, assembly, required load factors, cells that may be left out and load cases; every driver
    takes its turn, and so does the automatic choice.

    A process that waits for a processor is late whatever the program does, so the claim is for an idle machine. A
    search that ends late is run again, and the notes count searches that were in time only then. The notes also say how
    busy the machine was: the time by the clock over the processor time of one start of the program, once before the
    first case. Where the system tells how long a process waited for a processor, a search that is late every time is
    run once more by the clock of an idle machine, which stands still while the main thread waits. The report then tells
    what is late whatever the machine from what only waited; either is a disagreement.

    A space may be so tight that a search neither finds a layout in time nor proves that there is none. The message must
    say exactly that, and the notes count such cases.
    """
    busy = _slower()
    with tempfile.TemporaryDirectory() as folder:
        found = run_cases(claim, partial(_case_time_limits, Path(folder)), first_seed, cases, seconds)
    found.count("on an idle machine" if busy <= IDLE_BELOW else "beside other work", found.cases)
    return found


def _case_time_limits(folder: Path, seed: int, tally: Tally) -> str:
    rng = np.random.default_rng([20, seed])
    file = folder / f"{seed}.json"
    file.write_text(json.dumps(random_scene(rng)), encoding="utf-8")
    limit = float(rng.choice(SECONDS_TIME_LIMITS))
    options = ["--seconds", f"{limit:g}", *_options(rng, DRIVERS[seed % len(DRIVERS)])]
    for turn in range(TURNS):
        out = folder / f"out-{seed}-{turn}"
        seconds, undecided, wrong = _ended(file, out, options)
        late = seconds > 1.1 * limit + 2.0
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
            tally.count("late by the clock of an idle machine", idle > 1.1 * limit + 2.0)
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
        environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONWARNINGS": "ignore"}
        how: Document = {"cwd": file.parent, "capture_output": True, "text": True, "env": environment}
        done = subprocess.run(command, timeout=HANGS, check=False, **how)
    except subprocess.TimeoutExpired:
        return HANGS, False, [f"not ended after {HANGS:g} s"]
    seconds = float(clock.read_text(encoding="ascii")) if idle else time.perf_counter() - start
    undecided = done.returncode == 2 and UNDECIDED in done.stderr
    return seconds, undecided, _wrong(done, out)


def _wrong(done: subprocess.CompletedProcess[str], out: Path) -> list[str]:
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


def _options(rng: np.random.Generator, driver: str) -> list[str]:
    options = [*(["--driver", driver] if driver else []), "--jobs", str(rng.choice([1, 2]))]
    draw = rng.random()
    if draw < 0.1:
        options += ["--objective", "zero-dilation"]
    elif draw < 0.15:
        options += ["--objective", "zero-dilation-floor"]
    elif 0.2 <= draw < 0.3 and driver == "exact":
        options += ["--aim", "front"]
    return options


def random_scene(rng: np.random.Generator) -> Document:
    document: Document = _sample(rng).model_dump(mode="json", exclude_defaults=True, by_alias=True)
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


def _search(rng: np.random.Generator) -> Document:
    search: Document = {"block_cells": [1, int(rng.integers(2, 7))]}
    more: list[Document] = [
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
