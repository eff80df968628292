"""Solve many cone programs of one sparsity by a compiled interior-point method.

SIMD lanes solve several programs at once. No answer is proven: `LowerBound` and `UpperBound` compute bounds from it, as
from those of Clarabel.
"""

from __future__ import annotations

import ctypes
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bits, Floats, Ints
from jld_core.batch import chosen, interface
from jld_core.batch.library import Cones, ConeTask, library, pointers, require_success
from jld_core.fields.cone_pattern import factor_of, independent_rows, terms_of

STATUS: Final = {
    code: {"OPEN": "Open", "SOLVED": "Solved", "INFEASIBLE": "PrimalInfeasible", "UNBOUNDED": "DualInfeasible"}[
        name.removeprefix("CONES_")
    ]
    for name, code in interface.codes("JldConeState").items()
}
"""Names of `JldConeState`, those of Clarabel; "Open" is a program without result."""


@dataclass(frozen=True)
class Regularisation:
    """Regularisation of the linear systems of the interior-point method.

    The values suit programs with numbers of order one.

    regular: added to every pivot with its sign. least_pivot, new_pivot: pivots below the first are replaced by the
    second. bound: added to the squared scaling of cones, whose small eigenvalues rounding would eat. Of 64 upper bounds
    of the flagship 1e-12 leaves four open, 1e-8 none. refined: complementarity below which solutions are refined; above
    it refinement changes nothing.
    """

    regular: float = 1e-8
    least_pivot: float = 1e-13
    new_pivot: float = 2e-7
    bound: float = 1e-8
    refined: float = 1e-3


@dataclass(frozen=True)
class Stopping:
    """Stopping criteria of the interior-point method.

    gap, residual: absolute or relative duality gap, and relative residual, at which a program counts as solved. ray:
    relative residual of a ray that shows a program to be infeasible or unbounded. share: share that is taken of the
    longest step to the boundary of the cones. least_step: step below which iterations end without result. iterations:
    largest number of iterations.
    """

    gap: float = 1e-9
    residual: float = 1e-9
    ray: float = 1e-8
    share: float = 0.99
    least_step: float = 1e-4
    iterations: int = 60


@dataclass(frozen=True)
class ConeAnswers:
    """Unproven answers to k programs.

    status: (k,) values of `STATUS`. iterations: (k,). point: (k, n) variables, or a ray. dual: (k, m)
    multipliers. objective: (k,) values.
    """

    status: list[str]
    iterations: Ints
    point: Floats
    dual: Floats
    objective: Floats


class ConeBatch:
    """Compiled solver of cone programs that differ in costs and in rows that are switched off.

    matrix: (m, n) A, with equations, inequalities and cones of three rows in this order. rhs, idle: (m,) b, and the
    right-hand sides of rows that are switched off. Equations are never switched off. sizes: numbers of equations,
    inequalities and cones. Raises ValueError: no compiled solver is installed; see `is_installed`.
    """

    def __init__(self, matrix: sp.csr_array, rhs: Floats, idle: Floats, sizes: tuple[int, int, int]) -> None:
        variant = chosen()
        if variant is None:
            raise ValueError("no compiled solver is installed; test is_installed()")
        self._library = library(variant)
        own = sp.csr_array(matrix)
        equations, linear, cones = sizes
        kept = np.ones(len(rhs), dtype=bool)
        if equations > 1:
            # around nodes equations of equilibrium depend on each other
            kept[:equations] = independent_rows(sp.csr_array(own[:equations]))
        self._kept, self._rows, self._width = np.flatnonzero(kept), len(rhs), own.shape[1]
        own = sp.csr_array(own[self._kept])
        own.eliminate_zeros()
        own.sort_indices()
        sizes = (int(kept[:equations].sum()), linear, cones)
        self._arrays = _arrays(own, sizes, rhs[self._kept], idle[self._kept])
        numbers = {"columns": self._width, "equations": sizes[0], "linear": linear, "cones": cones}
        self._problem = Cones(**numbers, **asdict(Regularisation()), **pointers(**self._arrays))

    def solve(self, off: Bits, objective: Floats) -> ConeAnswers:
        """Solve k programs; each answer is independent of the others to the last digit.

        off: (k, m) True for rows switched off; of a cone all three. objective: (k, n) costs.
        """
        count = len(off)
        state, used = np.zeros(count, dtype=np.int32), np.zeros(count, dtype=np.int32)
        point, dual, value = np.zeros((count, self._width)), np.zeros((count, len(self._kept))), np.zeros(count)
        # numpy keeps these arrays while the call runs
        arrays = {
            "off": np.ascontiguousarray(off[:, self._kept], dtype=np.uint8),
            "objective": np.ascontiguousarray(objective, dtype=float),
            "x": point,
            "z": dual,
            "value": value,
            "state": state,
            "used": used,
        }
        task = ConeTask(count=count, **asdict(Stopping()), **pointers(**arrays))
        require_success(self._library.jld_solve_cones(ctypes.byref(self._problem), ctypes.byref(task)))
        whole = np.zeros((count, self._rows))
        whole[:, self._kept] = dual
        return ConeAnswers([STATUS[int(one)] for one in state], used.astype(np.int64), point, whole, value)


def is_installed() -> bool:
    """Return True if there is a compiled solver for this processor; JLD_KERNEL=off hides it."""
    return chosen() is not None


def _arrays(matrix: sp.csr_array, sizes: tuple[int, int, int], rhs: Floats, idle: Floats) -> dict[str, Any]:
    """Compute the arrays of `JldCones` by name, with the factor pattern; see `ConeBatch`."""
    factor = factor_of(matrix, sizes)
    terms = terms_of(factor, matrix, sizes)
    sign = np.ones(len(factor.place))
    sign[factor.place[matrix.shape[1] :]] = -1.0
    return {
        "row_start": matrix.indptr.astype(np.int64),
        "column": matrix.indices.astype(np.int32),
        "value": np.ascontiguousarray(matrix.data),
        "rhs": np.ascontiguousarray(rhs),
        "idle": np.ascontiguousarray(idle),
        "place": factor.place.astype(np.int32),
        "factor_start": factor.start,
        "factor_row": factor.row.astype(np.int32),
        "left_start": factor.left_start,
        "left_column": factor.left_column.astype(np.int32),
        "left_place": factor.left_place.astype(np.int64),
        "sign": sign,
        "fixed": terms.fixed,
        "term_start": terms.start,
        "term": terms.weight.astype(np.int32),
        "coefficient": np.ascontiguousarray(terms.coefficient),
    }
