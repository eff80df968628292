"""Make the problems: `python -m benchmarks.problems [NAME…] [--seconds S] [--scenes] [--drivers] [--layouts FILE]`.

Without options the records of the problems named (default all) are sought anew, and kept where they are better.
`--scenes` writes the scenes, `--drivers` the table of all drivers, `--layouts` random layouts with brackets as Parquet.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from benchmarks.common import RESULTS, load_of_machine, machine, table, versions
from benchmarks.problems import FOLDER, PROBLEMS
from benchmarks.problems.milp import METHODS, plain
from jld_core import InputError, Scene, build_assembly, files, load_scene, solve, solve_many
from jld_explore import explore, search_space
from jld_explore.drivers import BufferedRandom, Register, operators
from jld_explore.space import from_string, to_string
from jld_explore.space.counts import counts

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


def written(name: str) -> bool:
    """Write the scene of a problem; whether it was missing or has changed."""
    path = FOLDER / f"{name}.json"
    text = json.dumps(PROBLEMS[name]().model_dump(mode="json", exclude_unset=True) | {"name": name}, ensure_ascii=False)
    changed = not path.exists() or path.read_text("utf-8") != text + "\n"
    if changed:
        path.write_text(text + "\n", "utf-8")
    return changed


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
    """Do what the options ask for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="problems, default all")
    parser.add_argument("--seconds", type=float, default=10.0, help="time of each search")
    parser.add_argument("--scenes", action="store_true", help="write the scenes alone")
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
    records = json.loads(RECORDS.read_text("utf-8")) if RECORDS.exists() else {}
    for name in given.names or PROBLEMS:
        old = None if written(name) else records.get(name)  # a changed scene has no record yet
        if not given.scenes:
            records[name] = better(record_of(name, given.seconds), old)
            print(name, {key: value for key, value in records[name].items() if key != "labels"}, flush=True)
            ordered = {one: records[one] for one in PROBLEMS if one in records}
            RECORDS.write_text(json.dumps(ordered, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
