"""Multifrontal Cholesky in the compiled library, with the BLAS of scipy; numpy computes the same without it.

The compiled library has no linear algebra of its own for large fronts. It is given the addresses of scipy's routines,
which scipy publishes for Cython. Their number of threads is limited as everywhere (`jld_core.threads`).
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cython_blas, cython_lapack

from jld_core.arrays import Floats, Ints
from jld_core.batch import chosen
from jld_core.batch.library import Fronts as FrontsOfC
from jld_core.batch.library import library, pointers, require_success
from jld_core.linalg.cholesky import Fronts

# Routines in the order in which `JldFronts` takes them
_ROUTINES: Final = (
    (cython_lapack, "dpotrf"),
    (cython_blas, "dtrsm"),
    (cython_blas, "dsyrk"),
    (cython_blas, "dtrsv"),
    (cython_blas, "dgemv"),
)


class Solves(Protocol):
    """A factored matrix."""

    def solve(self, rhs: Floats) -> Floats:
        """Solve the system for right-hand sides (n,) or (n, k)."""


class Factorisation(Protocol):
    """Symbolic Cholesky analysis of one sparsity pattern, reused for matrices of that pattern.

    `factor` computes the factor for given entries; the result solves linear systems.
    """

    def factor(self, data: Floats) -> Solves:
        """Compute the Cholesky factor; raise np.linalg.LinAlgError if the matrix is indefinite."""


def factorisation(fronts: Fronts) -> Factorisation:
    """Return the compiled factorisation of a pattern; `fronts` itself if that cannot be used.

    It needs the batch solver's library, and a BLAS of scipy with 32-bit integers.
    """
    variant, routines = chosen(), _addresses()
    return fronts if variant is None or routines is None else CompiledFronts(fronts, variant, routines)


@cache
def _addresses() -> tuple[int, ...] | None:
    """Return the addresses of `_ROUTINES`; None if scipy's BLAS has no 32-bit integers."""
    if any("int *" not in repr(module.__pyx_capi__[name]) for module, name in _ROUTINES):
        return None
    api = ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    capsules = [module.__pyx_capi__[name] for module, name in _ROUTINES]
    return tuple(api.PyCapsule_GetPointer(one, api.PyCapsule_GetName(one)) for one in capsules)


class CompiledFronts:
    """Compiled factorisation of matrices of one pattern.

    fronts: analysis of the pattern. routines: addresses of `_ROUTINES`.
    """

    def __init__(self, fronts: Fronts, variant: str, routines: tuple[int, ...]) -> None:
        self._library = library(variant)
        self.order, self.place = fronts.order, fronts.place
        own, rest = np.diff(fronts.bounds), np.array([len(passed) for passed in fronts.passed], dtype=np.int64)
        ends = np.cumsum(own * (own + rest))
        start, self.size = ends - own * (own + rest), int(ends[-1]) if len(ends) else 0
        # Entries are numbered in the pivot matrix and in the panel of their front; here both are one array.
        half = np.repeat(np.arange(2 * len(own)), np.diff(fronts.cut))
        front, below = half // 2, half % 2
        height = np.where(below == 1, rest[front], own[front])
        local, row = fronts.where // height, fronts.where % height
        self._entries = fronts.entries
        self._where = start[front] + local * (own + rest)[front] + row + below * own[front]
        self._arrays: dict[str, NDArray[Any]] = {
            "bounds": np.ascontiguousarray(fronts.bounds, dtype=np.int64),
            "passed_start": np.concatenate([[0], np.cumsum(rest)]).astype(np.int64),
            "passed": np.concatenate([*fronts.passed, np.zeros(0, dtype=np.int64)]).astype(np.int64),
            "place": _rows_in_parents(fronts),
            "parent": fronts.parent.astype(np.int32),
            "factor_start": start.astype(np.int64),
            "routines": np.array(routines, dtype=np.int64),
        }
        self.stated = FrontsOfC(count=len(own), **pointers(**self._arrays))

    def factor(self, data: Floats) -> CompiledFactor:
        """Compute the Cholesky factor of a matrix with this pattern, as `Fronts.factor` does."""
        numbers, definite = np.zeros(self.size), np.zeros(1, dtype=np.uint8)
        numbers[self._where] = data[self._entries]
        given = pointers(factor=numbers, definite=definite)
        require_success(self._library.jld_factor_fronts(self.stated, given["factor"], given["definite"]))
        if not definite[0]:
            raise np.linalg.LinAlgError("matrix is not positive definite")
        return CompiledFactor(self, numbers)

    def solve(self, factor: Floats, columns: Floats) -> None:
        """Solve for right-hand sides (k, n) in the order of elimination, in place."""
        given = pointers(factor=factor, x=columns)
        require_success(self._library.jld_solve_fronts(self.stated, given["factor"], len(columns), given["x"]))


class CompiledFactor:
    """Cholesky factorisation made by `CompiledFronts.factor`.

    fronts: analysis of the pattern. numbers: pivot columns of all fronts.
    """

    def __init__(self, fronts: CompiledFronts, numbers: Floats) -> None:
        self._fronts, self._numbers = fronts, numbers

    def solve(self, rhs: Floats) -> Floats:
        """Solve the system for right-hand sides (n,) or (n, k)."""
        fronts = self._fronts
        columns = np.ascontiguousarray(np.atleast_2d(rhs.T)[:, fronts.order], dtype=float)
        fronts.solve(self._numbers, columns)
        return np.asarray(columns[:, fronts.place].T.reshape(rhs.shape))


def _rows_in_parents(fronts: Fronts) -> Ints:
    """Return the row of each unknown of the update matrices in its parent front.

    The pivot unknowns of the parent come first. Fronts follow each other; roots have zeros.
    """
    found = [np.zeros(0, dtype=np.int64)]
    for passed, parent in zip(fronts.passed, fronts.parent.tolist(), strict=True):
        if parent < 0:
            found.append(np.zeros(len(passed), dtype=np.int64))
            continue
        first, last = fronts.bounds[parent : parent + 2].tolist()
        below = np.searchsorted(fronts.passed[parent], passed)
        found.append(np.where(passed < last, passed - first, last - first + below))
    return np.concatenate(found).astype(np.int32)
