"""Equilibrium of free elements, A_eq F + b + λ b_λ = 0; only this module builds its matrices."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.geometry import moment_about


def equilibrium_matrix(assembly: Assembly) -> sp.csc_array:
    """Assemble A_eq: forces, then moments about the centroid, of each free element.

    Column q·f + j is resultant j of interface f, planar (N, V, M), spatial (N, V1, V2, M1, M2, MT). It acts as +F on
    element b and as −F on element a. Supports have no rows.

    Parameters
    ----------
    assembly : Assembly
        A planar or spatial structure.

    Returns
    -------
    (q·free, q·m) sparse array
        A_eq in scene units, q = 3 (planar) or 6 (spatial).

    Notes
    -----
    Source: Iannuzzo et al. 2024, eq. (2); docs/method.md (1.1), (1.2).
    """
    faces, elements, q, d = assembly.interfaces, assembly.elements, assembly.freedoms, assembly.dimension
    count = len(faces)
    row_of = np.full(len(elements), -1, dtype=np.int64)
    row_of[elements.free] = np.arange(len(elements.free))
    directions = [faces.normal, faces.e1] if d == 2 else [faces.normal, faces.e1, faces.e2]
    couples = [None] if d == 2 else [faces.e1, faces.e2, faces.normal]
    rows, columns, values = [], [], []
    for element, sign in ((faces.a, -1.0), (faces.b, 1.0)):
        free = row_of[element] >= 0
        base = q * row_of[element[free]]
        arm = faces.origin[free] - elements.centroid[element[free]]
        for j in range(q):
            column = q * np.flatnonzero(free) + j
            block = np.zeros((len(base), q))
            if j < d:
                along = directions[j][free]
                block[:, :d] = along
                block[:, d:] = moment_about(arm, along)
            elif d == 2:
                block[:, 2] = 1.0
            else:
                block[:, 3:] = couples[j - d][free]  # type: ignore[index]
            rows.append((base[:, None] + np.arange(q)).ravel())
            columns.append(np.repeat(column, q))
            values.append((sign * block).ravel())
    row, column, value = np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
    kept = value != 0.0
    shape = (q * len(elements.free), q * count)
    return sp.csc_array((value[kept], (row[kept], column[kept])), shape=shape)


def load_vectors(assembly: Assembly) -> tuple[Floats, Floats]:
    """Return b and b_λ on the free elements: dead loads with self-weight, and live loads.

    Parameters
    ----------
    assembly : Assembly
        A planar or spatial structure.

    Returns
    -------
    dead, live : (q·free,) arrays
        Forces, then moments about the centroid, of each free element, scene units.
    """
    free = assembly.elements.free
    return assembly.dead[free].ravel(), assembly.live[free].ravel()
