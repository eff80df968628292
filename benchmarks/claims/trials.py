"""Claim: what the exact driver calls proven is the best of all layouts, whatever the scene and the options.

Every labelling of a small random scene is evaluated, those that its limits leave are kept, and the largest λ is held
against what the exact driver proves, with whatever options the seed draws: blocks listed or not, a tree of blocks or
none, hardly any search before the proof, stopped on the way and gone on with, two jobs (threads in the place of
processes), whole fronts, a load factor required and a count proven, and, where the scene has one, a certificate that is
written and verified.
Scenes draw supports, holes, materials with every strength, limits of every kind, kept labels, slits, layouts that can
be laid, load cases, and space. ``notes`` counts what the scenes had.
"""

from __future__ import annotations

import json
import tempfile
import traceback
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from benchmarks.claims.tally import Tally, run_cases
from jld_core import InputError, Scene, build_assembly, parse_scene
from jld_core.limit import load_scale
from jld_core.limit.options import Status
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers import make_driver
from jld_explore.drivers.exact.certifying import certify, check_certifiable
from jld_explore.drivers.exact.driver import Exact
from jld_explore.evaluation import EvaluatorSettings, evaluator_of
from jld_explore.evaluation.protocol import Evaluation
from jld_explore.space import count_named, feasible, values_of
from jld_explore.space.search_space import SearchSpace
from jld_explore.verification import verify

MOST: Final = 11
"""Faces that may change, at the most: 2 048 labellings."""

_FEW: Final = 6
"""Faces below which a scene is drawn again, the oftener the fewer: one or two leave little to be wrong about."""


def drawn(seed: int) -> tuple[Scene, SearchSpace, list[str], np.random.Generator, dict[str, Any]]:
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


def draw(rng: np.random.Generator) -> tuple[dict[str, Any], list[str]]:
    """A scene document, and words for what it has."""
    kinds: list[str] = []
    spatial = rng.random() < 0.15
    dry: dict[str, Any] = {"friction_coefficient": float(rng.choice([0.0, 0.3, 0.75, 1.5], p=[0.05, 0.25, 0.6, 0.1]))}
    strength = float(rng.choice([0.0, 5e2, 2e3, 1e4, 1e6], p=[0.1, 0.25, 0.3, 0.25, 0.1]))
    inner: dict[str, Any] = {
        "tensile_strength": strength,
        "shear_strength": strength * float(rng.choice([0.5, 1.0, 2.0])),
    }
    if rng.random() < 0.2:
        dry["cohesion"] = 500.0
        kinds.append("cohesion")
    if rng.random() < 0.2 and strength:
        inner["friction_coefficient"] = 0.9 * inner["shear_strength"] / strength
        kinds.append("inner friction")
    if rng.random() < 0.3:
        # crushing of dry faces asks for that of inner ones nowhere
        which = rng.integers(1, 4)
        if which & 1:
            dry["compressive_strength"] = float(rng.choice([2e4, 2e5]))
        if which & 2:
            inner["compressive_strength"] = float(rng.choice([2e4, 2e5]))
        kinds.append("crushing")
    document: dict[str, Any] = {
        "name": "trial",
        "materials": {"density": 1400, "dry": dry, "inner": inner},
        "search": _limits(rng, spatial, kinds),
    }
    if spatial:
        kinds.append("space")
        cells = [(i, j, k) for i in range(2) for j in range(rng.integers(1, 3)) for k in range(rng.integers(1, 3))]
        document["elements"] = [
            _box("ground", (0, 0, -1), (2, 2, 1), True),
            *(_box(f"b{i}{j}{k}", (i, j, k)) for i, j, k in cells),
        ]
        names = [f"b{i}{j}{k}" for i, j, k in cells]
    else:
        rows = _rows(rng, kinds)
        document["grid"] = {"cell": [0.1, float(rng.choice([0.05, 0.1, 0.2]))], "thickness": 0.1, "rows": rows}
        names = [f"c{x}r{y}" for y, row in enumerate(rows) for x, letter in enumerate(row) if letter == "a"]
    document["loads"] = random_loads(rng, names, spatial, kinds)
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


def _box(
    name: str, low: tuple[int, int, int], size: tuple[int, int, int] = (1, 1, 1), support: bool = False
) -> dict[str, Any]:
    x, y, z = (0.1 * v for v in low)
    a, b, c = (0.1 * (v + s) for v, s in zip(low, size, strict=True))
    corners = [[x, y, z], [a, y, z], [a, b, z], [x, b, z], [x, y, c], [a, y, c], [a, b, c], [x, b, c]]
    faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    return {"id": name, "vertices": corners, "faces": faces, "support": support}


def random_loads(rng: np.random.Generator, names: list[str], spatial: bool, kinds: list[str]) -> dict[str, Any]:
    def live() -> list[dict[str, Any]]:
        if rng.random() < 0.6:
            body = [float(rng.choice([-1.0, 1.0])), float(rng.choice([0.0, 0.0, 0.4, -0.5]))]
            return [{"body": [*body, 0.0] if spatial else body}]
        force = [float(rng.choice([0.0, 1.0])), -1.0]
        return [{"element": str(rng.choice(names)), "force": [force[0], 0.0, -1.0] if spatial else force}]

    if rng.random() < 0.2:
        kinds.append("cases")
        return {
            "cases": [
                {"name": name, "live": live(), "required": float(rng.choice([1.0, 1.5]))} for name in ("one", "two")
            ]
        }
    return {"live": live()}


def _limits(rng: np.random.Generator, spatial: bool, kinds: list[str]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    low, high = sorted(int(v) for v in rng.integers(1, 5, 2))
    unit = 0.001 if spatial else 0.0005
    known: dict[str, Any] = {
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
    if rng.random() < 0.15:
        found["segmentation"] = False
        kinds.append("slits")
    if rng.random() < 0.15:
        found["candidates"] = "all+supports"
        kinds.append("supports")
    if rng.random() < 0.2:
        found["symmetry"] = "none"
    if rng.random() < 0.1 and "segmentation" not in found:
        found["assemble"] = "translation"
        kinds.append("laid")
    return found


_CLOSE: Final = 2e-6
"""How near proven and true have to be: twice what counts as proven."""


def every(space: SearchSpace) -> Iterator[tuple[np.ndarray[Any, Any], Evaluation]]:
    """All labellings of a space, each evaluated by itself."""
    spots = np.flatnonzero(space.candidates)
    rows = np.repeat(space.fixed[None], 1 << len(spots), axis=0)
    rows[:, spots] = (np.arange(len(rows))[:, None] >> np.arange(len(spots))) & 1
    rows = rows[feasible(space, rows)]
    evaluator = evaluator_of(space.assembly, EvaluatorSettings())
    yield from zip(rows, evaluator.evaluate_all(rows), strict=True)


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Hold proofs of random scenes against all their labellings: see `run_cases`."""
    return run_cases(
        "what the exact driver proves of a small scene is the best of all its layouts", case, first_seed, cases, seconds
    )


def case(seed: int, tally: Tally) -> str:
    """Hold what is proven of the scene of a seed against all its labellings; return what disagrees, "" for nothing."""
    scene, space, kinds, rng, document = drawn(seed)
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
        for name, on in (("front", options["aim"] == "front"), ("stopped", stopped is not None), ("two jobs", jobs > 1))
        if on
    ]
    known = list(every(space))
    required = _required(rng, document, known) if rng.random() < 0.1 else None
    try:
        # processes would take a second each to start
        threads = patch("jld_explore.evaluation.pool.make_executor", ThreadPoolExecutor)
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
    for kind in kinds:
        tally.count(kind)
    return f"{problem}; {json.dumps(document)}" if problem else ""


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
    front = {"count": str(rng.choice(["blocks", "dry_faces", "shapes"])), "sense": str(rng.choice(["min", "max"]))}
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
