"""λ of one layout when its blocks crack along faces, along finer cells, along Voronoi cells, or anywhere by fields."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Scene, Status, build_assembly, parse_scene, solve
from jld_core.arrays import Bits
from jld_core.fields import bounds_by_fields
from jld_core.fields.bounds import FieldBounds
from jld_core.limit.result import LimitAnalysisResult
from jld_core.refinement import refine
from jld_core.refinement.refine import CrackCells, joint_faces

MASONRY: Final = {"density": 2000, "dry": {"friction_coefficient": 0.75}}
"""Density and dry friction of the walls of the trial in /docs/guide/cracks.md: 2000 kg/m³, μ = 0.75."""


@dataclass(frozen=True)
class Cells:
    """Kind of finer cells: its name, over how many parts an element is cut, "grid" or "voronoi"."""

    name: str
    parts: int
    kind: str = "grid"


HALVES: Final = Cells("cells / 2", 2)
QUARTERS: Final = Cells("cells / 4", 4)
VORONOI: Final = Cells("Voronoi cells / 2", 2, "voronoi")


def finer(scene: Scene, assembly: Assembly, cells: Cells, seed: int = 0) -> CrackCells:
    """Cells of elements cut into parts along both axes, or into random cells of that size.

    The size of an element is the median of both extents over free elements.
    """
    elements = assembly.elements
    extent = np.median((elements.upper - elements.lower)[elements.free], axis=0)
    sizes = tuple(float(f"{value / cells.parts:.12g}") for value in extent)
    refined = refine(scene, sizes, kind=cells.kind, seed=seed)
    fine = build_assembly(refined.scene)
    return CrackCells(fine, joint_faces(assembly, fine, refined.parent))


def by_cells(cells: CrackCells, labels: Bits) -> LimitAnalysisResult:
    """Limit analysis of a layout (m,) on finer cells."""
    return solve(cells.fine, cells.labels(labels))


def value(result: LimitAnalysisResult) -> float:
    """λ of a result, 0 where it does not stand, NaN where none is proven."""
    if result.status is Status.UNSTABLE:
        return 0.0
    return float(result.load_factor) if result.status is Status.COLLAPSE else math.nan


def by_fields(assembly: Assembly, labels: Bits, gap: float, seconds: float) -> tuple[FieldBounds, FieldBounds]:
    """Bounds of a layout on uniform meshes up to 1000 triangles, and on adaptive ones to a gap."""
    uniform = bounds_by_fields(assembly, labels, gap=1e-9, adaptive=False, most=1000, seconds=0.2 * seconds)
    return uniform, bounds_by_fields(assembly, labels, gap=gap, seconds=0.8 * seconds)


def rows_of(
    case: str, layout: str, scene: Scene, labels: Bits, seconds: float, gap: float = 0.05
) -> tuple[list[dict[str, Any]], FieldBounds]:
    """Rows of the table of one layout under every crack model, and its bounds on adaptive meshes.

    seconds: budget of the layout; what would begin after it is left out.
    """
    start, assembly = time.perf_counter(), build_assembly(scene)
    common = {"case": case, "layout": layout}
    rows: list[dict[str, Any]] = [
        {**common, "cracks": "faces", "cells": len(assembly.elements.free), "lower": value(solve(assembly, labels))}
    ]
    for cells in (HALVES, QUARTERS, VORONOI):
        if time.perf_counter() - start > 0.4 * seconds:
            continue
        fine = finer(scene, assembly, cells)
        found = value(by_cells(fine, labels))
        rows.append({**common, "cracks": cells.name, "cells": len(fine.fine.elements.free), "lower": found})
    for row in rows:
        row["upper"] = row["lower"]
    uniform, adaptive = by_fields(assembly, labels, gap, seconds - (time.perf_counter() - start))
    for name, bounds in (("fields, uniform", uniform), ("fields, adaptive", adaptive)):
        rows += [
            {**common, "cracks": name, "cells": step.simplices, "lower": step.lower, "upper": step.upper}
            for step in bounds.history
        ]
    return rows, adaptive


def wall(rows: int, columns: int, strength: float, search: dict[str, Any] | None = None) -> Scene:
    """A wall of cells of 0.4 × 0.2 m on the ground under a horizontal body load; strength σt = τ in Pa."""
    return parse_scene(
        {
            "name": f"wall of {rows} × {columns} cells, {strength / 1e3:g} kPa",
            "grid": {"cell": [0.4, 0.2], "thickness": 0.2, "rows": ["a" * columns] * rows + ["#" * columns]},
            "materials": {**MASONRY, "inner": {"tensile_strength": strength, "shear_strength": strength}},
            "loads": {"live": [{"body": [1, 0]}]},
            "search": search or {},
        }
    )


def bridge(search: dict[str, Any] | None = None) -> Scene:
    """A footbridge of 6 × 2 cells of 0.3 m on two bearings under a force at a third of its span."""
    return parse_scene(
        {
            "name": "footbridge of 6 × 2 cells",
            "grid": {"cell": [0.3, 0.3], "thickness": 0.3, "rows": ["aaaaaa", "aaaaaa", "#....#"]},
            "materials": {
                "density": 2000,
                "dry": {"friction_coefficient": 0.6},
                "inner": {"tensile_strength": 2e5, "shear_strength": 4e5, "friction_coefficient": 0.6},
            },
            "loads": {"live": [{"element": "c2r0", "force": [0, -1000], "at": [0.75, 0.9], "width": 0.2}]},
            "search": search or {},
        }
    )
