"""Forty problems of joint layout design for others to enter, from 9 to 900 faces: see docs/guide/benchmark.md.

`python -m benchmarks.problems [NAME…] [--seconds S] [--drivers] [--layouts FILE]`. Without options the records of the
problems named (default all) are sought anew, and kept where they are better. Scenes stand in the package `jld_maps`; a
new one gets its record by its name; that of a changed one is taken out first. `--drivers` writes the table of all
drivers, `--layouts` random layouts with brackets as Parquet. Plain programs of planar layouts are stated as one writes
them without this project, to compare with: a mixed-integer program (HiGHS), the same constraints in whole numbers
(CP-SAT of OR-Tools) and a genetic algorithm on the labels (pymoo), the last two where their packages are installed.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import scipy.sparse as sp
from scipy.optimize import Bounds, LinearConstraint
from scipy.optimize import milp as solve_milp

from benchmarks.common import RESULTS, load_of_machine, machine, table, versions
from jld_core import (
    FACTS,
    Assembly,
    Bits,
    Floats,
    InputError,
    Route,
    Scene,
    blocks_of,
    build_assembly,
    files,
    load_scene,
    solve,
    solve_many,
)
from jld_core.mechanics import equilibrium_matrix
from jld_explore import SearchSpace, explore, search_space
from jld_explore.drivers import BufferedRandom, Register, operators
from jld_explore.space import feasible, from_string, to_string
from jld_explore.space.counts import counts
from jld_maps.benchmark import PROBLEMS as FOLDER

Answer = tuple[float, float, bool]  # λ (NaN: none), seconds, and whether it is said to be optimal
NONE: Answer = (math.nan, 0.0, False)


@dataclass(frozen=True)
class Plain:
    """Constraints of a planar problem: equilibrium, and rows that hold under one label of a face.

    balance: (e, 3m + 1) over forces N, V, M and λ, with right-hand side −dead. rows: (r, 3); faces, least, dry: (r,).
    """

    assembly: Assembly
    space: SearchSpace
    balance: Floats
    dead: Floats
    rows: Floats
    faces: Any
    least: Floats
    dry: Bits


def plain(scene: Scene) -> Plain | None:
    """The constraints of a problem; None in space, with load cases, fields, or limits other than `block_cells`."""
    assembly = build_assembly(scene)
    limits = scene.search.model_fields_set - {"segmentation", "candidates", "symmetry", "block_cells"}
    if assembly.dimension == 3 or assembly.cases or scene.cracks != "faces" or limits:
        return None
    strengths, faces = assembly.strengths(Route("a plain program", frozenset(FACTS))), assembly.interfaces
    free = assembly.elements.free
    balance = np.column_stack([equilibrium_matrix(assembly).toarray(), assembly.live[free].ravel()])
    rows = []
    for k in range(len(faces)):
        half, area, tension = 0.5 * faces.l1[k], faces.area[k], strengths.tension[k]
        for sign in (1.0, -1.0):
            rows += [(k, (strengths.friction[k], sign, 0.0), 0.0, True), (k, (half, 0.0, sign), 0.0, True)]
            if not np.isnan(tension):
                rows.append((k, (half / 3.0, 0.0, sign), -tension * area * half / 3.0, False))
                rows.append((k, (0.0, sign, 0.0), -strengths.shear[k] * area, False))
    which, coefficients, least, dry = (np.array(one) for one in zip(*rows, strict=True))
    space = search_space(scene, assembly)
    return Plain(assembly, space, balance, assembly.dead[free].ravel(), coefficients, which, least, dry)


def cuts_of(problem: Plain, dry: Bits) -> list[tuple[list[int], list[int]]]:
    """Conditions that labels violate: of the faces of each, one of the first is dry or one of the second is inner."""
    assembly, (least, most) = problem.assembly, problem.space.search.block_cells
    faces, near = assembly.interfaces, dict[int, list[tuple[int, int]]]()
    for face in np.flatnonzero(~dry).tolist():
        for a, b in ((faces.a[face], faces.b[face]), (faces.b[face], faces.a[face])):
            near.setdefault(int(a), []).append((int(b), face))

    def tree(start: int, ends: Callable[[list[int]], bool]) -> tuple[list[int], dict[int, tuple[int, int]]]:
        """Elements reached from one over inner faces until `ends`, and the face over which each is reached."""
        reached, by, waiting = [start], dict[int, tuple[int, int]](), deque([start])
        while waiting and not ends(reached):
            here = waiting.popleft()
            for other, face in near.get(here, []):
                if other not in by and other != start and not ends(reached):
                    by[other] = (here, face)
                    reached.append(other)
                    waiting.append(other)
        return reached, by

    found: list[tuple[list[int], list[int]]] = []
    for face in np.flatnonzero(dry).tolist():  # a slit: the ends of a dry face are joined around it
        a, b = int(faces.a[face]), int(faces.b[face])
        _, by = tree(a, lambda reached, b=b: b in reached)  # type: ignore[misc]
        if b in by:
            path, here = [], b
            while here != a:
                here, step = by[here]
                path.append(step)
            found.append((path, [face]))
    group, support = blocks_of(assembly, dry), assembly.elements.support
    for block in np.unique(group[~support]).tolist():
        cells = np.flatnonzero((group == block) & ~support)
        inside, by = tree(int(cells[0]), lambda reached: most is not None and len(reached) > most)
        if most is not None and len(inside) > most:
            found.append(([face for _, face in by.values()], []))
        elif least is not None and len(inside) < least:
            border = np.isin(faces.a, inside) ^ np.isin(faces.b, inside)
            found.append(([face for _, face in by.values()], np.flatnonzero(border).tolist()))
    return found


def milp(problem: Plain, seconds: float) -> Answer:
    """A binary for each face, yield sets by large numbers, conditions on blocks added where they are violated."""
    start, m = time.perf_counter(), len(problem.assembly.interfaces)
    big = 1e3 * max(1.0, float(abs(problem.dead).sum()))
    count = len(problem.faces)
    table = np.zeros((count, 4 * m + 1))
    for k in range(3):
        table[np.arange(count), 3 * problem.faces + k] = problem.rows[:, k]
    table[np.arange(count), 3 * m + problem.faces] = np.where(problem.dry, -big, big)
    ends = (problem.least - big * problem.dry).tolist()
    balance = np.insert(problem.balance, [3 * m] * m, 0.0, axis=1)
    low, high = np.full(4 * m + 1, -big), np.full(4 * m + 1, big)
    low[3 * m : -1], high[3 * m : -1] = 0.0, 1.0
    kept = np.flatnonzero(~problem.space.candidates)
    low[3 * m + kept] = high[3 * m + kept] = problem.space.fixed[kept]
    whole, goal = np.zeros(4 * m + 1), np.zeros(4 * m + 1)
    whole[3 * m : -1], goal[-1] = 1, -1.0
    cuts: list[Floats] = []
    while (left := seconds - (time.perf_counter() - start)) > 0.0:
        rows = LinearConstraint(sp.csr_array(np.vstack([table, *cuts])), np.array(ends), np.inf)
        held = LinearConstraint(sp.csr_array(balance), -problem.dead, -problem.dead)
        found = solve_milp(goal, integrality=whole.astype(int), bounds=Bounds(low, high), constraints=[held, rows],
                           options={"time_limit": left})  # fmt: skip
        if found.x is None:
            break
        violated = cuts_of(problem, found.x[3 * m : -1] > 0.5)
        if not violated:
            return -float(found.fun), time.perf_counter() - start, found.status == 0
        for some_dry, some_inner in violated:
            row = np.zeros(4 * m + 1)
            row[[3 * m + one for one in some_dry]], row[[3 * m + one for one in some_inner]] = 1.0, -1.0
            cuts.append(row)
            ends.append(1.0 - len(some_inner))
    return NONE


def cp_sat(problem: Plain, seconds: float) -> Answer:
    """The same in whole numbers, forces in 1e-3 of the weight; λ is that of its labels, solved."""
    from ortools.sat.python import cp_model  # an extra, not among the packages of the project

    start, m = time.perf_counter(), len(problem.assembly.interfaces)
    unit = max(1.0, float(abs(problem.dead).sum())) * 1e-3
    length = 0.5 * float(problem.assembly.interfaces.l1.min())
    model, most = cp_model.CpModel(), 1_000_000
    dry = [model.new_bool_var("") for _ in range(m)]
    force = [model.new_int_var(-most, most, "") for _ in range(3 * m)]  # M in unit × length
    load = model.new_int_var(0, most, "")
    scale = np.append(np.tile([1.0, 1.0, length], m), 1.0)
    over = np.tile([1.0, 1.0, length], len(problem.dead) // 3)
    whole = np.rint(problem.balance * scale / over[:, None] * 1e3).astype(int)
    for row, dead, size in zip(whole, problem.dead, over, strict=True):
        terms = [int(row[j]) * (force[j] if j < 3 * m else load) for j in np.flatnonzero(row)]
        slack = model.new_int_var(-2_000, 2_000, "")  # what rounding leaves
        model.add(sum(terms) + slack == -round(dead / size / unit * 1e3))
    for row, face, least, is_dry in zip(problem.rows, problem.faces, problem.least, problem.dry, strict=True):
        size = length if row[2] else 1.0
        own = np.rint(row * [1.0, 1.0, length] / size * 1e3).astype(int)
        terms = [int(own[j]) * force[3 * face + j] for j in range(3) if own[j]]
        bound = max(-most * 1_000, round(least / size / unit * 1e3))
        model.add(sum(terms) >= bound).only_enforce_if(dry[face] if is_dry else ~dry[face])
    for face in np.flatnonzero(~problem.space.candidates).tolist():
        model.add(dry[face] == int(problem.space.fixed[face]))
    model.maximize(load)
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 2
    while (left := seconds - (time.perf_counter() - start)) > 0.0:
        solver.parameters.max_time_in_seconds = left
        status = solver.solve(model)
        if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
            break
        labels = np.array([solver.value(one) for one in dry], dtype=bool)
        violated = cuts_of(problem, labels)
        if not violated:
            value = float(solve_many(problem.assembly, labels[None]).load_factor[0])
            return value, time.perf_counter() - start, status == cp_model.OPTIMAL
        for some_dry, some_inner in violated:
            model.add_bool_or([dry[one] for one in some_dry] + [~dry[one] for one in some_inner])
    return NONE


def genetic(problem: Plain, seconds: float) -> Answer:
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.problem import Problem
    from pymoo.operators.crossover.ux import UniformCrossover
    from pymoo.operators.mutation.bitflip import BitflipMutation
    from pymoo.operators.sampling.rnd import BinaryRandomSampling
    from pymoo.optimize import minimize

    start, space = time.perf_counter(), problem.space
    candidates = np.flatnonzero(space.candidates)

    class Layouts(Problem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(n_var=len(candidates), n_obj=1, xl=0, xu=1, vtype=bool)

        def _evaluate(self, x: Any, out: Any, *_: Any, **__: Any) -> None:
            labels = np.repeat(space.fixed[None], len(x), axis=0)
            labels[:, candidates] = x
            good = feasible(space, labels)
            value = np.full(len(x), 1e12)
            value[~good] += [len(cuts_of(problem, one)) for one in labels[~good]]
            if good.any():
                value[good] = -np.nan_to_num(solve_many(problem.assembly, labels[good]).load_factor, nan=-1e12)
            out["F"] = value

    how = GA(pop_size=100, sampling=BinaryRandomSampling(), crossover=UniformCrossover(), mutation=BitflipMutation())
    done = minimize(Layouts(), how, ("time", seconds), seed=0, verbose=False)
    best = -float(done.F[0])
    return (best if best > -1e11 else math.nan), time.perf_counter() - start, False


# methods by name
METHODS: dict[str, Callable[[Plain, float], Answer]] = {"MILP": milp, "CP-SAT": cp_sat, "pymoo GA": genetic}
RECORDS: Final = FOLDER / "records.json"
CERTIFICATE: Final = 300_000  # largest size of a certificate that is kept, bytes
COMPARED: Final = ("lintel-3x2", "bridge-5x2", "wall-3x3", "bridge-7x2", "wall-4x4", "wall-5x4", "wall-6x5",
                   "overhang-6x3", "beam-arch", "leonardo-9x2", "opening-7x4", "bridge-7x3", "wall-8x6", "cubes-2",
                   "corner-2")  # fmt: skip
DRIVERS: Final = ("enumeration", "random", "hillclimb", "anneal", "genetic", "portfolio", "optuna", "exact")
DRAWN: Final = ("wall-4x4", "wall-5x4", "wall-6x5", "wall-8x6", "wall-6x4-corner", "bridge-7x3", "bridge-8x6",
                "arch-2-rings", "cubes-3", "corner-4")  # fmt: skip
IDLE: Final = 20  # draws without a new layout after which a problem has no more
TITLE: Final = """# What drivers reach

λ over the best known, each driver and method in the same time; "not stated": a plain program of planar problems.
`python -m benchmarks.problems --drivers`, see docs/guide/benchmark.md.

"""
EACH: Final = 10_000  # layouts drawn of each


def record_of(name: str, seconds: float) -> dict[str, Any]:
    """Search a problem by the exact driver, or by the genetic one where it is large, and state what was found."""
    scene = load_scene(FOLDER / f"{name}.json")
    assembly = build_assembly(scene)
    candidates = int(search_space(scene, assembly).candidates.sum())
    driver = "exact" if candidates <= 60 and scene.cracks == "faces" else None if candidates <= 60 else "genetic"
    with tempfile.TemporaryDirectory() as folder:
        proof = Path(folder) / "proof.jsonl"
        search: dict[str, Any] = {"driver": driver, "seconds": seconds, "pictures": False}
        try:
            done = explore(scene, Path(folder) / "out", certificate=proof if driver == "exact" else None, **search)
        except InputError:  # certificates express neither all limits nor all faces
            done = explore(scene, Path(folder) / "again", **search)
        summary = done.summary
        kept = proof.exists() and summary.proven and proof.stat().st_size <= CERTIFICATE
        if kept:
            (FOLDER / "certificates").mkdir(exist_ok=True)
            (FOLDER / "certificates" / f"{name}.jsonl").write_bytes(proof.read_bytes())
    labels = from_string(summary.best_labelling or "")
    low, high = solve(assembly, labels).bracket
    return {
        "faces": assembly.faces,
        "candidates": candidates,
        "dimension": assembly.dimension,
        "cases": len(assembly.by_case),
        "cracks": scene.cracks if isinstance(scene.cracks, str) else "fields",
        "limits": sorted(set(scene.search.model_fields_set) - {"segmentation", "candidates", "symmetry"}),
        "best": low,
        "best_hi": high,
        "labels": summary.best_labelling,
        "bound": summary.bound,
        "proven": bool(summary.proven),
        "certificate": f"certificates/{name}.jsonl" if kept else None,
        "driver": summary.driver,
        "seconds": round(summary.seconds, 2),
    }


def better(new: dict[str, Any], old: dict[str, Any] | None) -> dict[str, Any]:
    """The record with the stronger layout, and the lower bound of both."""
    if old is None or (new["proven"] and not old["proven"]):
        return new
    best = new if new["best"] > old["best"] * (1 + 1e-9) else old
    bounds = [one["bound"] for one in (new, old) if one["bound"] is not None and math.isfinite(one["bound"])]
    return best | {"bound": min(bounds, default=None), "proven": new["proven"] or old["proven"]}


def drivers(names: Sequence[str], seconds: float) -> None:
    """Write λ that drivers and plain programs reach in the same time, over the best known; rows of others stay."""
    records = json.loads(RECORDS.read_text("utf-8"))
    path = RESULTS / "problems.csv"
    rows: dict[str, Any] = {}
    if path.exists():
        rows = {one["problem"]: one for one in pd.read_csv(path, dtype=str).to_dict("records")}
    for name in names:
        scene = load_scene(FOLDER / f"{name}.json")
        row: dict[str, Any] = {"problem": name, "seconds": f"{seconds:g}", "best_known": f"{records[name]['best']:.7g}"}
        for driver in DRIVERS:
            start = time.perf_counter()
            with tempfile.TemporaryDirectory() as folder:
                done = explore(scene, Path(folder) / "out", driver=driver, seconds=seconds, pictures=False)
            best = done.summary.best
            reached = math.nan if best is None else best / records[name]["best"]
            row[driver] = f"{reached:.4f}" + (
                f", proven in {done.summary.seconds:.1f} s" if done.summary.proven else ""
            )
            print(name, driver, row[driver], f"{time.perf_counter() - start:.1f} s", flush=True)
        problem = plain(scene)
        for method, run in METHODS.items():
            try:
                value, took, optimal = (math.nan, 0.0, False) if problem is None else run(problem, seconds)
            except ImportError:
                row[method] = "not installed"
                continue
            reached = "none" if problem is not None else "not stated"
            reached = reached if math.isnan(value) else f"{value / records[name]['best']:.4f}"
            row[method] = reached + (f", optimal in {took:.1f} s" if optimal else "")
            print(name, method, row[method], f"{took:.1f} s", flush=True)
        rows[name] = row
        found = pd.DataFrame([rows[one] for one in COMPARED if one in rows])
        found.to_csv(path, index=False)
        lines = [[str(one) for one in row] for row in found.to_numpy()]
        text = table(list(found.columns), lines)
        head = f"{TITLE}{machine()}. {load_of_machine()} {versions(['highspy', 'ortools', 'pymoo'])}\n\n"
        files.write_text(RESULTS / "problems.md", head + text + "\n")


def layouts(path: Path, each: int) -> pd.DataFrame:
    """Random layouts of ten problems, with proven brackets and counts, as one Parquet file."""
    parts = []
    for name in DRAWN:
        scene: Scene = load_scene(FOLDER / f"{name}.json")
        assembly = build_assembly(scene)
        space = search_space(scene, assembly)
        moves, register, random = operators(space), Register(space), BufferedRandom(np.random.default_rng(0))
        rows: list[Any] = []
        idle = 0
        while sum(len(one) for one in rows) < each and idle < IDLE:
            rows.append(register.admit(moves.draw(1024, random)))
            idle = 0 if len(rows[-1]) else idle + 1
        labels = np.concatenate(rows)[:each]
        start = time.perf_counter()
        found = solve_many(assembly, labels)
        counted = counts(assembly, labels, space.graph)
        part = {"problem": name, "labels": [to_string(one) for one in labels], "load_factor": found.load_factor}
        part |= {"bracket_lo": found.low, "bracket_hi": found.high, "status": [str(one) for one in found.status]}
        parts.append(pd.DataFrame(part | {one: counted[one] for one in ("dry_faces", "blocks")}))
        print(f"{name}: {len(labels)} layouts in {time.perf_counter() - start:.1f} s", flush=True)
    done = pd.concat(parts, ignore_index=True)
    done.to_parquet(path, index=False)
    return done


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="problems, default all")
    parser.add_argument("--seconds", type=float, default=10.0, help="time of each search")
    parser.add_argument("--drivers", action="store_true", help="compare all drivers")
    parser.add_argument("--layouts", type=Path, help="Parquet file of random layouts")
    parser.add_argument("--each", type=int, default=EACH, help="layouts of each problem")
    given = parser.parse_args()
    if given.layouts is not None:
        layouts(given.layouts, given.each)
        return
    if given.drivers:
        drivers(given.names or COMPARED, given.seconds)
        return
    records = json.loads(RECORDS.read_text("utf-8"))
    for name in given.names or list(records):
        records[name] = better(record_of(name, given.seconds), records.get(name))
        print(name, {key: value for key, value in records[name].items() if key != "labels"}, flush=True)
        RECORDS.write_text(json.dumps(records, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
