"""Brute force against the exact driver on random small scenes, seed by seed: what is called proven has to be the best.

Every labelling of a scene is evaluated, those that its limits leave are kept, and the largest λ is held against what
the exact driver proves, with whatever options the seed draws: blocks listed or not, a tree of blocks or none, hardly
any search before the proof, stopped on the way and gone on with, two jobs (threads in the place of processes),
whole fronts, a load factor required and a count proven, and, where the scene has one, a
certificate that is written and verified.
Scenes draw supports, holes, materials with every strength, limits of every kind, kept labels, slits, layouts that can
be laid, load cases, and space.

`python -m benchmarks.trust_trials FIRST LAST SECONDS` runs seeds FIRST to LAST − 1, as many as there is time for, and
adds a row to the results.
"""

from __future__ import annotations

import csv
import json
import math
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from benchmarks.common import RESULTS, table, write
from benchmarks.trust_scenes import MOST, drawn
from jld_core import InputError, Scene, build_assembly, parse_scene
from jld_core.limit import Status, load_scale
from jld_explore import ExploreSettings, explore
from jld_explore.drivers import make_driver
from jld_explore.drivers.exact.certifying import certify, check_certifiable
from jld_explore.drivers.exact.driver import Exact
from jld_explore.evaluation import Evaluation, EvaluatorSettings, evaluator_of
from jld_explore.space import SearchSpace, count_named, search_space, values_of
from jld_explore.space.search_space import feasible
from jld_explore.verification import verify

SEEDS: Final = (0, 2000)

_CLOSE: Final = 2e-6
"""How near proven and true have to be: twice what counts as proven."""


@dataclass(frozen=True)
class Trial:
    """What a seed drew, and what was wrong: "" where nothing was."""

    seed: int
    faces: int
    kinds: tuple[str, ...]
    problem: str = ""
    document: dict[str, Any] | None = None


def every(space: SearchSpace) -> Iterator[tuple[np.ndarray[Any, Any], Evaluation]]:
    """All labellings of a space, each evaluated by itself."""
    spots = np.flatnonzero(space.candidates)
    rows = np.repeat(space.fixed[None], 1 << len(spots), axis=0)
    rows[:, spots] = (np.arange(len(rows))[:, None] >> np.arange(len(spots))) & 1
    rows = rows[feasible(space, rows)]
    evaluator = evaluator_of(space.assembly, EvaluatorSettings())
    yield from zip(rows, evaluator.evaluate_all(rows), strict=True)


def trial(seed: int) -> Trial:
    """Hold what is proven of one scene against all its labellings."""
    scene, space, kinds, rng, document = drawn(seed)
    faces = int(space.candidates.sum())
    options: dict[str, Any] = {
        "by_blocks": str(rng.choice(["auto", "on", "off"])),
        "list_blocks": bool(rng.random() < 0.7) or "blocks" in kinds,
        "search": int(rng.choice([0, 1, 10])),
        "aim": "front" if rng.random() < 0.15 else "best",
    }
    stopped = int(rng.integers(1, 25)) if rng.random() < 0.25 else None
    jobs = 2 if rng.random() < 0.1 else 1
    rng.random()  # Formerly the choice of an option; drawn so that a seed means the same scene as before.
    kinds += [
        name
        for name, on in (
            ("front", options["aim"] == "front"),
            ("stopped", stopped is not None),
            ("two jobs", jobs > 1),
        )
        if on
    ]
    known = list(every(space))
    required = _required(rng, document, known) if rng.random() < 0.1 else None
    try:
        # processes would take a second each to start
        threads = patch("jld_explore.evaluation.worker_pool._start_process", lambda: ThreadPoolExecutor(1))
        with (
            tempfile.TemporaryDirectory() as folder,
            threads,
            patch("jld_explore.drivers.exact.cube_workers.TASK_SECONDS", 0.0),
        ):
            if required is not None:
                kinds.append("required")
                problem = _compare_required(required, known, jobs, Path(folder))
            else:
                problem = _compare(scene, space, known, options, stopped, jobs, kinds, Path(folder))
    except Exception:
        problem = traceback.format_exc()
    return Trial(seed, faces, tuple(kinds), problem, document if problem else None)


def _compare(
    scene: Scene,
    space: SearchSpace,
    known: list[tuple[Any, Evaluation]],
    options: dict[str, Any],
    stopped: int | None,
    jobs: int,
    kinds: list[str],
    folder: Path,
) -> str:
    path = folder / "proof.jld"
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
        if stopped is not None:
            explore(scene, folder / "out", settings, driver=Exact(space, **options, programs=stopped))
        facts = explore(
            scene, folder / "out", replace(settings, resume=stopped is not None), driver=driver
        ).summary.facts
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
    room = _CLOSE * max(abs(best or 0.0), min(load_scale(case) for case in space.assembly.by_case))
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


def _required(
    rng: np.random.Generator, document: dict[str, Any], known: list[tuple[Any, Evaluation]]
) -> dict[str, Any] | None:
    """The scene with a load factor required that some labellings have and others do not, or none has."""
    loads = np.unique([found.load_factor for _, found in known if found.status is Status.COLLAPSE])
    loads = loads[loads > 1e-3]
    apart = np.flatnonzero(np.diff(loads) > 1e-3 * loads[1:])
    if not len(loads):
        return None
    choices = [2.0 * loads[-1], *(0.5 * (loads[apart] + loads[apart + 1]))]
    front = {
        "count": str(rng.choice(["blocks", "dry_faces", "shapes"])),
        "sense": str(rng.choice(["min", "max"])),
    }
    require = {"load_factor": float(rng.choice(choices))}
    return {**document, "search": {**document["search"], "front": front, "require": require}}


def _compare_required(document: dict[str, Any], known: list[tuple[Any, Evaluation]], jobs: int, folder: Path) -> str:
    """The best count of what carries enough, proven, against all that does."""
    scene = parse_scene(document)
    space = search_space(scene, build_assembly(scene))
    assert scene.search.require is not None
    least, (name, sense) = scene.search.require.load_factor, scene.search.front.axes[0]
    driver = make_driver("exact", space, 0)
    asked = explore(
        scene, folder / "out", ExploreSettings(pictures=False, jobs=jobs, small=0), driver=driver
    ).summary.facts["require"]
    if any(found.status in (Status.UNCERTIFIED, Status.FAILED) for _, found in known):
        return ""
    rows = [
        labels
        for labels, found in known
        if found.status is Status.LOCKED or (found.status is Status.COLLAPSE and found.load_factor >= least)
    ]
    counts = values_of(count_named(name), space.assembly, np.array(rows)).tolist() if rows else []
    best = (min(counts) if sense == "min" else max(counts)) if counts else None
    if asked["best"] != best or not asked["proven"]:
        return f"the best {name} ({sense}) of λ ≥ {least!r} is {best}, found {asked['best']}, proven {asked['proven']}"
    return ""


def _fronts(space: SearchSpace, values: list[tuple[Any, Evaluation]], rows: list[dict[str, Any]], room: float) -> str:
    counts = values_of(
        count_named(space.search.front.count), space.assembly, np.array([labels for labels, _ in values])
    )
    best: dict[int, float] = {}
    for count, (_, found) in zip(counts.tolist(), values, strict=True):
        best[count] = max(best.get(count, -np.inf), found.load_factor)
    proven = {row["count"]: row["load_factor"] for row in rows if row["load_factor"] is not None}
    for count in sorted(best.keys() | proven.keys()):
        if count not in best or count not in proven or abs(best[count] - proven[count]) > room:
            return f"front at {count}: the best is {best.get(count)}, proven {proven.get(count)}"
    return ""


def run(first: int, last: int, seconds: float) -> list[Trial]:
    """Trials of seeds, as many as there is time for; those that disagree are printed as they are found."""
    found: list[Trial] = []
    start = time.perf_counter()
    for seed in range(first, last):
        if time.perf_counter() - start > seconds:
            break
        one = trial(seed)
        found.append(one)
        if one.problem:
            print(
                json.dumps(
                    {
                        "seed": seed,
                        "faces": one.faces,
                        "kinds": one.kinds,
                        "problem": one.problem,
                        "scene": one.document,
                    }
                ),
                flush=True,
            )
    return found


def main(first: int = SEEDS[0], last: int = SEEDS[1], seconds: float = math.inf) -> None:
    """Run the seeds, and write what was compared, with what earlier pieces of the range found."""
    start = time.perf_counter()
    trials = run(first, last, seconds)
    last = first + len(trials)
    wrong = sorted((one for one in trials if one.problem), key=lambda one: one.faces)
    if wrong:
        print("smallest:", json.dumps(wrong[0].document), wrong[0].problem, flush=True)
    kinds = Counter(kind for one in trials for kind in one.kinds)
    row = {"first": first, "last": last, "disagree": len(wrong), "seconds": round(time.perf_counter() - start)}
    path = RESULTS / "trust_trials.csv"
    rows = []
    if path.exists():
        with path.open(newline="", encoding="utf-8") as file:
            rows = [one for one in csv.DictReader(file) if int(one["last"]) <= first or int(one["first"]) >= last]
    rows.append({name: str(value) for name, value in {**row, "kinds": json.dumps(dict(sorted(kinds.items())))}.items()})
    rows.sort(key=lambda one: int(one["first"]))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, ["first", "last", "disagree", "seconds", "kinds"])
        writer.writeheader()
        writer.writerows(rows)
    total: Counter[str] = Counter()
    for one in rows:
        total.update(json.loads(one["kinds"]))
    count = sum(int(one["last"]) - int(one["first"]) for one in rows)
    disagree = sum(int(one["disagree"]) for one in rows)
    parts = [
        "# Brute force against proof",
        f"{count} random scenes of at most {MOST} faces that may change; on {disagree} of them the exact driver and "
        "brute force disagree. What they had:",
        table(["", "scenes"], [[kind, str(number)] for kind, number in sorted(total.items())]),
        table(
            ["seeds", "disagree", "s"],
            [[f"{one['first']}–{int(one['last']) - 1}", one["disagree"], one["seconds"]] for one in rows],
        ),
    ]
    write("trust_trials", "\n\n".join(parts))


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
