"""Random segmentations, tables, processes and parts that benchmarks share."""

from __future__ import annotations

import importlib
import json
import math
import os
import platform
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import Assembly, build_assembly, load_scene
from jld_core.arrays import Bits
from jld_core.mechanics import equilibrium_matrix, load_vectors
from jld_core.strengths import Route

ROOT: Final = Path(__file__).resolve().parent.parent
RESULTS: Final = ROOT / "benchmarks" / "results"
CPUINFO: Final = Path("/proc/cpuinfo")


def scene(name: str) -> Assembly:
    """One of the scenes that come with the project."""
    return build_assembly(load_scene(ROOT / "scenes" / f"{name}.json"))


def random_segmentations(assembly: Assembly, count: int, seed: int) -> Bits:
    """Segmentations (count, m) from joining elements at random, from a few joints to nearly all; supports stay dry."""
    rng = np.random.default_rng(seed)
    faces = assembly.interfaces
    inner_of = np.flatnonzero(assembly.free_faces)
    labellings = np.ones((count, len(faces)), dtype=bool)
    for row in labellings:
        block = np.arange(len(assembly.elements))
        for face in rng.permutation(inner_of)[: rng.integers(0, len(inner_of) // 2)]:
            a, b = block[faces.a[face]], block[faces.b[face]]
            block[block == max(a, b)] = min(a, b)
        row[inner_of] = block[faces.a[inner_of]] != block[faces.b[inner_of]]
    return labellings


def apart(name: str, *arguments: Any) -> Any:
    """What a function returns, as JSON, from a process of its own, whose memory is its own; name: "large.solved"."""
    module, _, function = name.rpartition(".")
    code = f"import json; from benchmarks.{module} import {function} as f; print(json.dumps(f(*{arguments!r})))"
    answer = subprocess.run([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(answer.stdout.splitlines()[-1])


def run_parts(**parts: Callable[[], None]) -> None:
    """Run the part of a benchmark that the command line names, with what stands behind the name, or all parts."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name in parts:
        del sys.argv[1]
    for part in [parts[name]] if name in parts else parts.values():
        part()


def load_of_machine() -> str:
    """How many processes asked for the cores in the last minute, in a sentence."""
    return f"Load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."


def table(head: Sequence[str] | str, rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; head and each row: cells, or one text with " | " between them."""
    lines = [line if isinstance(line, str) else " | ".join(line) for line in (head, *rows)]
    rule = " | ".join(["---"] * (1 + lines[0].count(" | ")))
    return "\n".join(f"| {line} |" for line in (lines[0], rule, *lines[1:]))


def about(doc: str | None) -> str:
    """What a benchmark's docstring says below its first line, in one paragraph: the words that its page begins with."""
    return " ".join((doc or "").split("\n\n", 1)[1].split())


def machine() -> str:
    """The processor and how many of its cores there are, in words."""
    lines = CPUINFO.read_text(encoding="utf-8").splitlines() if CPUINFO.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor() or platform.machine()}, {os.cpu_count()} cores"


def versions(packages: Sequence[str]) -> str:
    """Names and versions of packages, those that are not installed left out."""
    found = []
    for package in packages:
        with suppress(PackageNotFoundError):
            found.append(f"{package} {version(package)}")
    return ", ".join(found)


def write(name: str, *parts: str, also: Sequence[str] = ()) -> None:
    """Print a result, paragraph by paragraph, and keep it in benchmarks/results, with machine and versions.

    also: packages to name beside the usual ones.
    """
    packages = versions(("clarabel", "highspy", "cvxpy", "numpy", "scipy", *also))
    last = f"{machine()}; Python {platform.python_version()}, {packages}, one thread.\n"
    text = "\n\n".join([*parts, last])
    print(text)
    RESULTS.mkdir(parents=True, exist_ok=True)
    (RESULTS / f"{name}.md").write_text(text, encoding="utf-8")


ROUTE = Route("a benchmark")
CLARABEL_DEFAULT: Final = {"tol_gap_abs": 1e-8, "tol_gap_rel": 1e-8, "tol_feas": 1e-8}


def stated(assembly: Assembly, labels: Bits, solver: str = "CLARABEL", **options: Any) -> float:
    """λ of one labelling, NaN where the solver has none. Planar faces, or spatial ones that are rectangles.

    labels: (m,) True dry. solver: a name CVXPY knows. options: of that solver; default its own tolerances.
    Source: Iannuzzo et al. 2024, eq. (2)–(7), as docs/method.md (2.1) to (2.7).
    """
    cp: Any = importlib.import_module("cvxpy")  # half of it is typed, and a strict check trips over the other
    unit = assembly.total_dead
    forces, load = cp.Variable((len(assembly.interfaces), assembly.freedoms)), cp.Variable()
    dead, live = load_vectors(assembly)
    balance = equilibrium_matrix(assembly) @ cp.vec(forces, order="C") + dead / unit + load * live / unit == 0
    admissible = _planar if assembly.dimension == 2 else _spatial
    problem = cp.Problem(cp.Maximize(load), [balance, *admissible(cp, assembly, labels, forces)])
    if solver == "CLARABEL":
        options = {**CLARABEL_DEFAULT, **options}
    problem.solve(solver=solver, **options)
    return float("nan") if load.value is None else float(load.value)


def plainly(assembly: Assembly, labels: Bits) -> tuple[float, float]:
    """Processor seconds and λ of the plain way; NaN where its solver fails, as an unstable labelling makes it."""
    start, value = time.process_time(), math.nan
    with warnings.catch_warnings(), suppress(Exception):
        warnings.simplefilter("ignore")  # of inaccurate answers, which are among what it costs
        value = stated(assembly, labels)
    return time.process_time() - start, value


def _planar(cp: Any, assembly: Assembly, labels: Bits, forces: Any) -> list[Any]:
    faces, strengths, unit = assembly.interfaces, assembly.strengths(ROUTE), assembly.total_dead
    n, v, m = forces[:, 0], forces[:, 1], forces[:, 2]
    half, dry, inner = 0.5 * faces.l1, np.flatnonzero(labels), np.flatnonzero(~labels)
    constraints = []
    if dry.size:
        constraints += [
            cp.abs(m[dry]) <= cp.multiply(half[dry], n[dry]),
            cp.abs(v[dry]) <= cp.multiply(strengths.friction[dry], n[dry]),
        ]
    if inner.size:
        tension = strengths.tension[inner] * faces.area[inner] / unit
        shear = strengths.shear[inner] * faces.area[inner] / unit
        constraints += [
            cp.abs(m[inner]) <= cp.multiply(half[inner] / 3.0, n[inner] + tension),
            cp.abs(v[inner]) <= shear,
        ]
    return constraints


def _spatial(cp: Any, assembly: Assembly, labels: Bits, forces: Any) -> list[Any]:
    faces, strengths, unit = assembly.interfaces, assembly.strengths(ROUTE), assembly.total_dead
    constraints = []
    for kind, share in ((np.flatnonzero(labels), 0.5), (np.flatnonzero(~labels), 1.0 / 6.0)):
        if not kind.size:
            continue
        n, twist = forces[kind, 0], cp.multiply(1.0 / faces.c_t[kind], cp.abs(forces[kind, 5]))
        dry = share == 0.5
        held = n if dry else n + strengths.tension[kind] * faces.area[kind] / unit
        capacity = cp.multiply(strengths.friction[kind], n) if dry else strengths.shear[kind] * faces.area[kind] / unit
        constraints += [
            cp.abs(forces[kind, 3]) <= cp.multiply(share * faces.l2[kind], held),
            cp.abs(forces[kind, 4]) <= cp.multiply(share * faces.l1[kind], held),
            cp.norm(forces[kind, 1:3], axis=1) + twist <= capacity,
        ]
    return constraints
