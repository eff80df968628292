"""Conic programs with semidefinite cones of size 3 by Clarabel; tensors as vectors.

A symmetric tensor is the vector (xx, √2 xy, yy, √2 xz, √2 yz, zz) of its upper triangle, so that products of tensors
are products of vectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats
from jld_core.fields.cone_pattern import Answer

ROOT_TWO = float(np.sqrt(2.0))
"""√2, factor of the shear entries in the vector of a tensor."""

DIAGONAL = (0, 2, 5)
"""Positions of xx, yy and zz in the vector of a tensor."""

_FEASIBILITY = 1e-9  # residual that the solver is asked for: below the margins to flow rules and yield in its programs

_GAP = 1e-5  # relative duality gap that the solver is asked for: far below the relative gap of two meshes

_MOST_STEPS = 100  # largest number of iterations of the interior-point method

# Regularisation of the solver's linear systems. With its default 1e-8 it fails half way, because rows of equilibrium
# depend on each other around edges.
_REGULAR = 1e-7

_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # row and column of the tensor for each entry of its vector


@dataclass(frozen=True)
class ConeSizes:
    """Numbers of cones of a program, in the order of its rows."""

    zero: int  # equations
    linear: int  # inequalities s ≥ 0
    # threes, fours: second-order cones of 3 and of 4 rows
    threes: int
    fours: int
    tensors: int  # cones of 6 rows, positive semidefinite tensors as vectors (see `tensors`)


def tensors(vectors: Floats) -> Floats:
    """Convert vectors (..., 6) to symmetric tensors (..., 3, 3).

    A vector is (xx, √2 xy, yy, √2 xz, √2 yz, zz), the order of the solver.
    """
    found = np.empty((*vectors.shape[:-1], 3, 3))
    for place, (i, j) in enumerate(_PLACES):
        found[..., i, j] = found[..., j, i] = vectors[..., place] / (1.0 if i == j else ROOT_TWO)
    return found


def normal_map(normals: Floats) -> Floats:
    """Return matrices (..., 3, 6) that map vectors of stresses to tractions σ n on planes."""
    found = np.zeros((*normals.shape[:-1], 3, 6))
    for place, (i, j) in enumerate(_PLACES):
        found[..., i, place] = normals[..., j] / (1.0 if i == j else ROOT_TWO)
        found[..., j, place] = normals[..., i] / (1.0 if i == j else ROOT_TWO)
    return found


def across(normals: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors perpendicular to each normal and to each other, (k, 3) each.

    normals: (k, 3) unit vectors. Slip and shear on planes are written in these directions.
    """
    axis = np.eye(3)[np.argmin(abs(normals), axis=1)]
    one = np.cross(normals, axis)
    one = one / np.linalg.norm(one, axis=1)[:, None]
    return one, np.cross(normals, one)


def solve_cones(objective: Floats, matrix: sp.csr_array, rhs: Floats, sizes: ConeSizes) -> Answer:
    """Minimise q x where A x + s = b and s lies in cones; the answer is not verified.

    objective: (columns,) q. matrix: (rows, columns) A. rhs: (rows,) b.
    """
    cones = [clarabel.ZeroConeT(sizes.zero), clarabel.NonnegativeConeT(sizes.linear)]
    cones += [clarabel.SecondOrderConeT(3)] * sizes.threes
    cones += [clarabel.SecondOrderConeT(4)] * sizes.fours
    cones += [clarabel.PSDTriangleConeT(3)] * sizes.tensors
    width = len(objective)
    solver: Any = clarabel.DefaultSolver(
        sp.csc_matrix((width, width)), objective, sp.csc_matrix(matrix), rhs, cones, _settings()
    )
    answer = solver.solve()
    status = str(answer.status)
    usable = status in ("Solved", "AlmostSolved", "InsufficientProgress", "MaxIterations", "NumericalError")
    point = np.array(answer.x)
    usable = usable and bool(np.isfinite(point).all())
    return Answer(point, np.array(answer.z), float(answer.obj_val), usable, status)


def _settings() -> Any:
    """Return the settings of Clarabel."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False
    settings.input_sparse_dropzeros = True
    settings.chordal_decomposition_enable = False
    settings.max_iter = _MOST_STEPS
    settings.direct_solve_method = "qdldl"
    settings.static_regularization_constant = _REGULAR
    settings.tol_feas = _FEASIBILITY
    settings.tol_gap_abs = settings.tol_gap_rel = _GAP
    return settings
