"""Solids for tests: unions of boxes of a grid, such as walls with openings."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


def solid_of(name: str, cells: NDArray[np.bool_], levels: Sequence[Any]) -> dict[str, Any]:
    """Return the element of the full cells of a grid, whose faces are many coplanar rectangles.

    cells: (i, j, k), True for full ones. levels: coordinates of the grid along each axis, ascending.
    """
    taken = np.pad(cells, 1)
    points: dict[tuple[int, ...], int] = {}
    faces = []
    for axis, sign in itertools.product(range(3), (-1, 1)):
        for cell in np.argwhere(taken & ~np.roll(taken, -sign, axis=axis)) - 1:
            loop = []
            for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1))[::sign]:
                corner = cell.copy()
                corner[axis] += sign > 0
                corner[(axis + 1) % 3] += du
                corner[(axis + 2) % 3] += dv
                loop.append(points.setdefault(tuple(corner.tolist()), len(points)))
            faces.append(loop)
    vertices = [[float(levels[k][key[k]]) for k in range(3)] for key in points]
    return {"id": name, "vertices": vertices, "faces": faces}
