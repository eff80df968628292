"""Estimate time and memory of one labelling, as benchmarks/large.py measured on one core, small blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.geometry.planar_contacts import certain_contacts
from jld_core.parameters import typed
from jld_core.scene.schema import Scene
from jld_core.threads import memory_limit

_FACES: Final = 2e4  # number of faces at which the times in `_COSTS` were measured

# Cost by dimension: seconds and bytes at `_FACES` faces, each followed by its exponent of the number of faces
_COSTS: Final = {2: (14.0, 1.6, 3.2e8, 1.0), 3: (90.0, 1.5, 1.4e9, 1.17)}
_BASE: Final = 1.5e8  # memory of Python and its libraries, in bytes
LONG: Final = 5.0  # time of one evaluation in seconds above which the user is warned in advance


@dataclass(frozen=True)
class CostEstimate:
    seconds: float  # time on one core, in seconds
    memory: float  # memory of one process, in bytes

    @property
    def long(self) -> str | None:
        """Return a sentence with the expected time if it is above `LONG`, else None."""
        if self.seconds <= LONG:
            return None
        time = f"{self.seconds:.0f} s" if self.seconds < 100.0 else f"{self.seconds / 60.0:.0f} min"
        return f"one layout of this size is expected to take some {time} to evaluate"


@typed
def cost_estimate(assembly: Assembly) -> CostEstimate:
    """Estimate time and memory to evaluate one labelling under all load cases.

    Parameters
    ----------
    assembly : Assembly
        Planar or spatial assembly, with or without load cases.

    Returns
    -------
    CostEstimate
        Seconds on one core for all load cases together, and bytes of one process.
    """
    return _cost(assembly.dimension, len(assembly.interfaces), len(assembly.by_case))


def _cost(dimension: int, faces: int, cases: int) -> CostEstimate:
    """Estimate time and memory of one labelling from the size of the structure."""
    seconds, power, size, growth = _COSTS[dimension]
    share = faces / _FACES
    return CostEstimate(cases * seconds * share**power, _BASE + size * share**growth)


def _least_faces(scene: Scene) -> int:
    """Return a lower bound on the number of faces, known before contacts are built."""
    # Each free element has a face of its own on a path to a support. In grids, all pairs of neighbouring cells count.
    # In spatial scenes that may be too large, pairs of elements that certainly touch count.
    if scene.grid is not None:
        return _grid_faces(scene.grid.rows)
    elements = scene.elements or []
    supports = {element.id for element in elements if element.support}
    free = len(elements) - len(supports)
    if scene.interfaces is not None:
        return max(free, sum(not supports.issuperset(entry.elements) for entry in scene.interfaces))
    loops = sum(len(element.faces or ()) for element in elements)
    if scene.dimension == 2 or _cost(3, loops, 1).memory <= memory_limit():
        return free
    vertices = [np.array(element.vertices, dtype=float) for element in elements]
    faces = [tuple(tuple(loop) for loop in element.faces or ()) for element in elements]
    return max(free, certain_contacts(vertices, faces, np.array([element.support for element in elements])))


def _grid_faces(rows: Sequence[str]) -> int:
    """Return the number of faces between neighbouring cells of a grid, those between two supports excepted."""
    width = max(len(row) for row in rows)
    cells = np.array([list(row.ljust(width, ".")) for row in rows])
    filled, free = cells != ".", (cells != ".") & (cells != "#")
    beside = filled[:, 1:] & filled[:, :-1] & (free[:, 1:] | free[:, :-1])
    above = filled[1:] & filled[:-1] & (free[1:] | free[:-1])
    return int(np.count_nonzero(beside) + np.count_nonzero(above))


@typed
def require_memory(structure: Assembly | Scene) -> CostEstimate:
    """Raise InputError if one labelling needs more memory than there is; return the estimate.

    Of a scene, whose contacts are not known yet, the least number of faces counts, so that hopeless ones are refused
    early.
    """
    if isinstance(structure, Scene):
        faces, prefix = _least_faces(structure), "at least "
        estimate = _cost(structure.dimension, faces, 1)
    else:
        faces, prefix = len(structure.interfaces), ""
        estimate = cost_estimate(structure)
    available = memory_limit()
    if estimate.memory > available:
        raise InputError(
            "",
            f"{prefix}{faces} faces take {prefix or 'some '}{estimate.memory / 1e9:.1f} GB of memory to evaluate",
            f"a scene that the {available / 1e9:.1f} GB there are suffice for",
        )
    return estimate
