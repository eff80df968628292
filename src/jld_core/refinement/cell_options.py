"""Options of a refinement that define its cells, and their checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from jld_core.errors import InputError, ParameterError
from jld_core.scene import Scene

KINDS: Final = ("grid", "bond", "voronoi", "radial")
"""Names of the kinds of cells of a given size; the last two are planar only."""

BY: Final = ("block", "material")
"""Names of the groups of old joints that a search must keep, for the parameter `by` of `refine`."""

SNAP: Final = 0.4
"""Largest distance, relative to a cell, to which corners of cells move: beyond it cells degenerate."""


@dataclass(frozen=True)
class CellOptions:
    """Arguments of `refine` that define the cells."""

    cell: tuple[float, ...]
    kind: str
    centre: tuple[float, float] | None
    seed: int
    bond: str
    voussoirs: int | None
    rings: int
    courses: int
    snap: float
    own: Sequence[shapely.Polygon] | None
    skew: float | None
    lintel: int
    bearing: float | None


def check_options(scene: Scene, grid: CellOptions, by: str | None) -> None:
    """Raise an error for arguments of `refine` that are invalid or do not fit the scene.

    ParameterError: `grid` or `by` is wrong. InputError: the scene cannot be refined.
    """
    if by is not None and by not in BY:
        raise ParameterError("by", f"{by!r} is unknown", "one of " + ", ".join(BY))
    if grid.voussoirs is None:
        _check_sizes(scene, grid)
    elif grid.cell or grid.kind != "grid" or grid.own is not None:
        raise ParameterError("voussoirs", "it does not go with `cell` or `kind`", "one or the other")
    elif grid.bond not in ("running", "stack"):
        raise ParameterError("bond", f"{grid.bond!r} is no bond of voussoirs", "running or stack")
    elif grid.courses < 1:
        raise ParameterError("courses", f"{grid.courses} is wrong", "a whole number from 1")
    elif scene.dimension == 2 and grid.courses != 1:
        raise ParameterError("courses", "the scene is planar and has no axis", "a spatial scene, or no `courses`")
    elif scene.dimension == 3 and grid.centre is not None:
        raise ParameterError("centre", "the scene is spatial", "a planar scene, or a vault with an arc")
    if grid.skew is not None and (grid.voussoirs is None or grid.centre is not None):
        raise ParameterError("skew", "it is that of a flat arch without a centre", "`voussoirs`, and no `centre`")
    if grid.skew is not None and not 1.0 <= grid.skew < 90.0:
        raise ParameterError("skew", f"{grid.skew:g} is no inclination of joints", "from 1 to below 90 degrees")
    if (grid.lintel != 1 or grid.bearing is not None) and (grid.kind != "bond" or scene.dimension == 2):
        name = "lintel" if grid.lintel != 1 else "bearing"
        raise ParameterError(name, "it is that of openings in walls drawn as solids", "`kind` bond, of a spatial scene")
    if grid.lintel < 1:
        raise ParameterError("lintel", f"{grid.lintel} is no number of stones", "1, or more for a flat arch")
    if grid.bearing is not None and not 0.0 < grid.bearing < float("inf"):
        raise ParameterError("bearing", f"{grid.bearing:g} is wrong", "a length above 0")
    if grid.centre is not None and not np.isfinite(grid.centre).all():
        raise ParameterError("centre", f"{grid.centre[0]:g},{grid.centre[1]:g} is no point", "x,y")
    if not 0.0 <= grid.snap <= SNAP:
        raise ParameterError("snap", f"{grid.snap:g} of a cell is wrong", f"0 to {SNAP:g}")
    if grid.snap and scene.dimension == 3:
        raise ParameterError("snap", "the scene is spatial", "a planar scene, or 0")
    if scene.interfaces is not None:
        raise InputError("interfaces", "they are given by hand", "a scene whose interfaces are found")
    if scene.materials.faces:
        raise InputError("materials.faces", "they name elements that are split", "a scene without them")
    if scene.materials.inner is None:
        raise InputError("materials.inner", "missing, and cells are joined by inner faces", "strengths of the material")


def _check_sizes(scene: Scene, grid: CellOptions) -> None:
    """Raise ParameterError for options of a grid that are invalid or contradict each other."""
    cell, kind = grid.cell, grid.kind
    if grid.own is not None and (kind != "grid" or scene.dimension == 3):
        raise ParameterError("cells", "own cells are planar and of no kind", "a planar scene, without `kind`")
    if kind not in KINDS:
        raise ParameterError("kind", f"no cells are named {kind!r}", "one of " + ", ".join(KINDS))
    if not cell:
        raise ParameterError("cell", "missing", "the size of a cell, or `voussoirs` with their number")
    if not 1 <= len(cell) <= scene.dimension or not all(0.0 < size < float("inf") for size in cell):
        raise ParameterError(
            "cell", f"{','.join(f'{size:g}' for size in cell)} is wrong", "one size above 0 for each axis"
        )
    if grid.rings != 1 or grid.courses != 1:
        name = "rings" if grid.rings != 1 else "courses"
        raise ParameterError(name, "it goes with `voussoirs` only", "`voussoirs` with their number")
    if kind not in ("grid", "bond") and scene.dimension == 3:
        raise ParameterError("kind", f"{kind} cells are planar and the scene is spatial", "grid or bond")
    if kind == "radial" and (grid.centre is None or len(cell) != 2):
        what = "it has no centre" if grid.centre is None else "it has one size"
        raise ParameterError("kind", what, "`centre` x,y and `cell` THICKNESS,DEGREES")
