"""Scenes, random segmentations and tables that benchmarks share."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import Assembly, build_assembly, load_scene, parse_scene
from jld_core.arrays import Bits

ROOT: Final = Path(__file__).resolve().parent.parent
RESULTS: Final = ROOT / "benchmarks" / "results"
CPUINFO: Final = Path("/proc/cpuinfo")


def wall(rows: int, columns: int, tension: float = 2e6, shear: float = 2e5) -> Assembly:
    """A wall of cells of 0.1 m on a row of supports under a horizontal body load; 6 × 8 cells have 90 faces."""
    document: dict[str, Any] = {
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["a" * columns] * rows + ["#" * columns]},
        "materials": {
            "density": 1400,
            "dry": {"friction_angle": 30},
            "inner": {"tensile_strength": tension, "shear_strength": shear},
        },
        "loads": {"live": [{"body": [1, 0]}]},
    }
    return build_assembly(parse_scene(document))


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


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def about(doc: str | None) -> str:
    """What a benchmark's docstring says below its first line, in one paragraph: the words that its page begins with."""
    return " ".join((doc or "").split("\n\n", 1)[1].split())


def machine() -> str:
    """The processor and how many of its cores there are, in words."""
    names = [
        line.partition(":")[2].strip()
        for line in (CPUINFO.read_text(encoding="utf-8").splitlines() if CPUINFO.exists() else [])
        if line.startswith("model name")
    ]
    return f"{names[0] if names else platform.processor() or platform.machine()}, {os.cpu_count()} cores"


def versions(packages: Sequence[str]) -> str:
    """Names and versions of packages, those that are not installed left out."""
    found = []
    for package in packages:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def write(name: str, text: str, also: Sequence[str] = ()) -> None:
    """Print a result and keep it in benchmarks/results, with machine and versions that it depends on.

    also: packages to name beside the usual ones.
    """
    packages = versions(("clarabel", "highspy", "cvxpy", "numpy", "scipy", *also))
    text = f"{text}\n\n{machine()}; Python {platform.python_version()}, {packages}, one thread.\n"
    print(text)
    RESULTS.mkdir(parents=True, exist_ok=True)
    (RESULTS / f"{name}.md").write_text(text, encoding="utf-8")
