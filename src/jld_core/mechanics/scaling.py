"""Non-dimensional scaling, docs/method.md (8.1): solvers see values of order one in any units of the scene.

Forces are divided by the weight of a pile of elements, live work is normalised to the sum of live loads. Relative
residuals of a solver then measure the error of λ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import shortest_path

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.strengths import CRITERIA, STANDARD, Route

_ROUTE: Final = Route("scales", STANDARD | CRITERIA)


@dataclass(frozen=True)
class Scaling:
    """Factors between scene values and scaled values: scene value = factor × scaled value.

    Attributes
    ----------
    force : float
        Scale of all forces, scene units.
    face : (m, q) array
        Factors of the resultants: `force`, for moments times the half-size of the interface, for torsion times c_T.
    row : (free, q) array
        Factors of the equilibrium rows: `force`, for moments times half the diagonal of the element's bounding box.
    load : float
        λ = load × scaled λ.

    Notes
    -----
    Source: docs/method.md (8.1) to (8.3).
    """

    force: float
    face: Floats
    row: Floats
    load: float


def scaling_of(assembly: Assembly) -> Scaling:
    """Compute the scales of an assembly from its loads, strengths and sizes.

    A labelling never enters.

    Parameters
    ----------
    assembly : Assembly
        A planar or spatial structure.

    Returns
    -------
    Scaling
        Scales, docs/method.md (8.1) to (8.3).
    """
    faces, elements = assembly.interfaces, assembly.elements
    force = _force_scale(assembly)
    ones = np.ones(len(faces))
    if assembly.dimension == 2:
        face = np.column_stack([ones, ones, 0.5 * faces.l1])
    else:
        face = np.column_stack([ones, ones, ones, 0.5 * faces.l2, 0.5 * faces.l1, faces.c_t])
    free = elements.free
    radius = 0.5 * np.linalg.norm(elements.upper[free] - elements.lower[free], axis=1)
    row = np.repeat(
        np.column_stack([np.ones(len(free)), radius]),
        [assembly.dimension, assembly.freedoms - assembly.dimension],
        axis=1,
    )
    return Scaling(force=force, face=force * face, row=force * row, load=force / (assembly.total_live or force))


def _force_scale(assembly: Assembly) -> float:
    """Return the force scale: mean weight of free elements times the height of their pile."""
    # The height is the largest number of interfaces between a free element and a support, docs/method.md (8.2). Without
    # weight the result is that of `reference_load`.
    elements, faces = assembly.elements, assembly.interfaces
    free = elements.free
    weights = np.linalg.norm(assembly.dead[free, : assembly.dimension], axis=1)
    if weights.any():
        count = len(elements)
        links = csr_array((np.ones(len(faces)), (faces.a, faces.b)), shape=(count + 1, count + 1))
        ground = csr_array(
            (
                np.ones(int(elements.support.sum())),
                (np.full(int(elements.support.sum()), count), np.flatnonzero(elements.support)),
            ),
            shape=(count + 1, count + 1),
        )
        steps = shortest_path(links + ground, directed=False, unweighted=True, indices=count)
        depth = float(steps[free].max()) - 1.0
        return float(weights.mean()) * max(depth, 1.0)
    return reference_load(assembly)


def reference_load(assembly: Assembly) -> float:
    """Compute the reference force of an assembly: weight, else a strength, else live load.

    Forces far below it count as zero in the width of a bracket. Source: docs/method.md (3.13).

    Parameters
    ----------
    assembly : Assembly
        Structure.

    Returns
    -------
    float
        Total weight, scene units. Without weight: the least strength times area of any face, under either label.
        Without strengths: the total live load.
    """
    if assembly.total_dead:
        return assembly.total_dead
    usable = _usable(assembly, *assembly.strengths(_ROUTE).stresses.values())
    return float(usable.min()) if usable.size else assembly.total_live


def _usable(assembly: Assembly, *strengths: Floats) -> Floats:
    """Return all finite strengths (m,) above zero, each times the area of its face."""
    capacity = np.concatenate(strengths) * np.tile(assembly.interfaces.area, len(strengths))
    return np.asarray(capacity[np.isfinite(capacity) & (capacity > 0.0)])
