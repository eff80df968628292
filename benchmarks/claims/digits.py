"""Claim: an answer does not hang on the last digits of the machine.

Hard and ordinary scenes, each solved as it is and ten times with coefficients disturbed by 1e-15, relative, under four
kernels of OpenBLAS. Each kernel has a process of its own, which reads ``OPENBLAS_CORETYPE`` as it loads the library. A
scene disagrees where two of its answers have different statuses, or brackets that do not meet. ``notes`` counts the
answers that are not `uncertified` under each kernel; these shares may differ by 0.2 %.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import warnings
from dataclasses import fields, replace
from typing import Any, Final

import numpy as np

from benchmarks.claims import refined
from benchmarks.claims.tally import Tally
from benchmarks.hard_cases import hard_cases
from jld_core import Assembly, build_assembly, parse_scene, solve
from jld_core.arrays import Bits, Floats
from jld_core.limit import load_scale
from jld_core.loads import Loads
from jld_core.strengths import Route

ROUTE: Final = Route("a benchmark")

CLAIM: Final = "ten disturbances of 1e-15 under four kernels of OpenBLAS give one status and brackets that meet"
KERNELS: Final = ("Haswell", "ZEN", "SKYLAKEX", "SANDYBRIDGE")
DISTURBANCES: Final = 10
SIZE: Final = 1e-15
"""Relative size of a disturbance."""
APART: Final = 1e-10
"""Relative distance up to which brackets meet: what a disturbance changes in λ itself."""
SHARE: Final = 0.002
"""Greatest difference of the shares settled."""
_LARGE: Final = ("1000 blocks", "µN, mm")
_CELLS: Final = 60

Answer = tuple[str, float, float]
"""Status, and both ends of the bracket."""


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on scenes; the kernels work on the same ones, one after another.

    Parameters
    ----------
    first_seed, cases : int
        Seeds to test.
    seconds : float
        Time limit for each kernel, s; the choice of the scenes is not counted.

    Returns
    -------
    Tally
        Disagreements, and in `notes` the number of answers and of those settled, by kernel.
    """
    tally, start = Tally(CLAIM), time.perf_counter()
    places = {seed: _place(seed) for seed in range(first_seed, first_seed + cases)}
    answers: dict[str, dict[int, list[Answer]]] = {}
    names: dict[int, tuple[str, float]] = {}
    for kernel in KERNELS:
        command = [sys.executable, "-m", "benchmarks.claims.digits", str(seconds)]
        environment = {**os.environ, "OPENBLAS_CORETYPE": kernel}
        done = subprocess.run(
            command, input=json.dumps(places), env=environment, stdout=subprocess.PIPE, text=True, check=True
        )
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        answers[kernel] = {line["seed"]: [tuple(one) for one in line["answers"]] for line in lines}
        names |= {line["seed"]: (line["name"], line["floor"]) for line in lines}
        print(f"  {kernel}: {len(lines)} scenes, {time.perf_counter() - start:.0f} s", flush=True)
    common = set.intersection(*(set(found) for found in answers.values()))
    settled = {}
    for kernel, found in answers.items():
        statuses = [status for seed in common for status, _, _ in found[seed]]
        settled[kernel] = sum(status != "uncertified" for status in statuses)
        tally.count(f"answers settled under {kernel}", settled[kernel])
    count = len(common) * (1 + DISTURBANCES)
    tally.count("answers under each kernel", count)
    for seed in sorted(common):
        tally.cases += 1
        problem = _problem({kernel: found[seed] for kernel, found in answers.items()}, *names[seed])
        if problem:
            tally.disagreements.append(f"seed {seed}: {problem}")
    if max(settled.values()) - min(settled.values()) > SHARE * count:
        tally.disagreements.append(f"shares settled differ: {settled} of {count}")
    tally.seconds = time.perf_counter() - start
    return tally


def _problem(found: dict[str, list[Answer]], name: str, floor: float) -> str:
    """Return what the answers to one scene contradict each other in; "" for nothing. floor: its least load scale."""
    statuses = {kernel: sorted({status for status, _, _ in answers}) for kernel, answers in found.items()}
    if len({status for names in statuses.values() for status in names}) > 1:
        return f"{name}: {statuses}"
    ends = np.array([(low, high) for answers in found.values() for _, low, high in answers])
    low, high = ends[:, 0].max(), ends[:, 1].min()
    if low - high > APART * max(abs(low), abs(high), floor):
        return f"{name}: a lower bound of {low!r} and an upper bound of {high!r}"
    return ""


def _place(seed: int) -> int:
    """Return which refined sample a seed takes, the first that is small; 0 for other scenes."""
    if seed % 5 not in (1, 2):
        return 0
    return next(k for k in range(1000) if len(_refined(seed, k)[1].elements) <= _CELLS)


def _refined(seed: int, place: int) -> tuple[str, Assembly]:
    kind, scene = refined.scene_of(4000 + 1000 * seed + place)
    return f"refined {kind}", build_assembly(scene)


def scene_of(seed: int, place: int) -> tuple[str, Assembly, Bits]:
    """Return name, assembly and labels of a seed: of five, one is a hard case, two are refined samples, two grids."""
    if seed % 5 == 0:
        known = [case for case in hard_cases() if case.name not in _LARGE]
        case = known[seed // 5 % len(known)]
        assembly = case.make()
        return str(case), assembly, assembly.labels if case.labels is None else case.labels(assembly)
    if seed % 5 in (1, 2):
        name, assembly = _refined(seed, place)
        return name, assembly, assembly.labels
    return _grid(seed)


def _grid(seed: int) -> tuple[str, Assembly, Bits]:
    """Return a planar grid with random strengths, of which some crush, and random labels."""
    rng = np.random.default_rng(seed)
    wide, high = (int(value) for value in rng.integers(2, 7, 2))
    crush = {"compressive_strength": float(10 ** rng.uniform(5, 8))} if rng.random() < 0.4 else {}
    inner = {"tensile_strength": float(10 ** rng.uniform(3, 7)), "shear_strength": float(10 ** rng.uniform(3, 7))}
    document: dict[str, Any] = {
        "grid": {"cell": rng.uniform(0.1, 0.5, 2).tolist(), "thickness": 0.2, "rows": ["a" * wide] * high},
        "materials": {
            "density": 2000,
            "dry": {"friction_coefficient": float(rng.uniform(0.2, 0.9)), **crush},
            "inner": {**inner, **crush},
        },
        "loads": {"live": [{"body": rng.normal(size=2).tolist()}]},
    }
    document["grid"]["rows"].append("#" * wide)
    assembly = build_assembly(parse_scene(document))
    return "grid", assembly, rng.random(len(assembly.interfaces)) < rng.random()


def disturbed(assembly: Assembly, rng: np.random.Generator) -> Assembly:
    """Return an assembly whose loads, strengths and centroids are changed in their last digits."""

    def changed(values: Floats) -> Floats:
        return np.asarray(values * (1.0 + SIZE * rng.uniform(-1.0, 1.0, values.shape)))

    def changed_loads(loads: Loads) -> Loads:
        return loads.weighted(changed(np.ones(len(loads.body))))

    strengths, elements = assembly.strengths(ROUTE), assembly.elements
    known = {one.name: getattr(strengths, one.name) for one in fields(strengths)}
    numbers = {
        name: changed(value)
        for name, value in known.items()
        if isinstance(value, np.ndarray) and value.dtype.kind == "f"
    }
    return replace(
        assembly.with_strengths(replace(strengths, **numbers)),
        dead_loads=changed_loads(assembly.dead_loads),
        live_loads=changed_loads(assembly.live_loads),
        elements=replace(elements, centroid=changed(elements.centroid)),
    )


def answers_of(seed: int, place: int) -> dict[str, Any]:
    """Return the answers to one scene and to its disturbances, under the kernel of this process."""
    name, assembly, labels = scene_of(seed, place)
    rng = np.random.default_rng(seed)
    results = [solve(one, labels) for one in (assembly, *(disturbed(assembly, rng) for _ in range(DISTURBANCES)))]
    unknown = {"unstable": (0.0, 0.0), "locked": (0.0, 0.0)}
    answers = [(str(one.status), *unknown.get(str(one.status), _ends(one.bracket))) for one in results]
    floor = min(load_scale(case) for case in assembly.by_case)
    return {"seed": seed, "name": name, "floor": floor, "answers": answers}


def _ends(bracket: tuple[float, float]) -> tuple[float, float]:
    """Return the ends of a bracket, infinite where one is missing."""
    low, high = bracket
    return (low if np.isfinite(low) else -np.inf), (high if np.isfinite(high) else np.inf)


def _work(places: dict[str, int], seconds: float) -> None:
    """Print the answers to scenes as lines of JSON, until the time is up."""
    warnings.simplefilter("ignore")
    end = time.perf_counter() + seconds
    for seed, place in places.items():
        if time.perf_counter() > end:
            break
        print(json.dumps(answers_of(int(seed), place)), flush=True)


if __name__ == "__main__":
    _work(json.loads(sys.stdin.read()), float(sys.argv[1]))
