"""Symbolic factorisation of the linear systems of many cone programs, computed once.

The reduced system is docs/method.md (9.17). Cones are eliminated first, so that only variables and equations remain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from jld_core.arrays import Bools, Floats, Ints

# Pivot of an equation over the largest below which it depends on others; independent ones have 1e-4 and more
_DEPENDENT = 1e-7

_SMALL = 1e-10  # added to the diagonal where dependent equations are looked for


@dataclass(frozen=True)
class Factor:
    """Pattern of the factor L D Lᵀ of the reduced system, in the order of elimination.

    The system has N unknowns: the variables, then the equations.

    place: (N,) place of each variable, then of each equation. start, row: (N + 1,) rows of L below the diagonal, column
    by column. left_start, left_column, left_place: (N + 1,) entries of each row of L: their columns, and their places
    among the entries of all columns.
    """

    place: Ints
    start: Ints
    row: Ints
    left_start: Ints
    left_column: Ints
    left_place: Ints


@dataclass(frozen=True)
class Terms:
    """Entries of the reduced system as sums over weights of rows.

    The e entries are the diagonal ones, then those of `Factor.row`.

    Attributes
    ----------
    fixed : (e,) float array
        Part of each entry without weights.
    start, weight, coefficient : (e + 1,), (t,), (t,) arrays
        Terms of each entry. Weights are those of linear rows, then six of each cone: its upper triangle row by row.
    """

    fixed: Floats
    start: Ints
    weight: Ints
    coefficient: Floats


def independent_rows(matrix: sp.csr_array) -> Bools:
    """Return a mask (rows,) of independent rows that span all rows."""
    square = sp.csc_matrix(matrix @ matrix.T)
    size = float(square.diagonal().max())
    square = sp.csc_matrix(square + _SMALL * size * sp.eye_array(square.shape[0]))
    factor = splu(square, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    pivots = np.asarray(factor.U.diagonal())[factor.perm_c]
    return np.asarray(abs(pivots) > _DEPENDENT * size)


def factor_of(matrix: sp.csr_array, sizes: tuple[int, int, int]) -> Factor:
    """Find the pattern of the factor of the reduced system.

    matrix: A with equations, linear rows and cones in this order. sizes: their numbers. Variables within cones come
    first, then equations, then variables that stand in equations alone: so pivots keep their sign and size.
    """
    equations, width = sizes[0], matrix.shape[1]
    hessian = _hessian_pattern(matrix, sizes)
    inner = np.flatnonzero(hessian.diagonal() > 0)
    outer = np.flatnonzero(hessian.diagonal() == 0)
    place = np.empty(width + equations, dtype=np.int64)
    place[inner] = _minimum_degree(sp.csr_array(hessian[inner][:, inner]))
    if equations:
        # variables that are connected fill each other
        count, group = connected_components(hessian[inner][:, inner], directed=False)
        joins = sp.csr_array((np.ones(len(inner)), (np.arange(len(inner)), group)), shape=(len(inner), count))
        own = abs(sp.csr_array(matrix[:equations][:, inner])) @ joins
        place[width:] = len(inner) + _minimum_degree(sp.csr_array(own @ own.T))
    place[outer] = len(inner) + equations + np.arange(len(outer))
    inside, first = sp.coo_array(hessian), sp.coo_array(sp.csr_array(matrix[:equations]))
    row = place[np.concatenate([inside.coords[0], width + first.coords[0]])]
    column = place[np.concatenate([inside.coords[1], first.coords[1]])]
    return _filled(place, np.maximum(row, column), np.minimum(row, column))


def _hessian_pattern(matrix: sp.csr_array, sizes: tuple[int, int, int]) -> sp.csr_array:
    """Return a matrix (n, n) with entries where variables share a linear row or a cone."""
    equations, linear, cones = sizes
    group = np.concatenate([np.arange(linear), linear + np.repeat(np.arange(cones), 3)])
    rows = len(group)
    joins = sp.csr_array((np.ones(rows), (group, np.arange(rows))), shape=(linear + cones, rows))
    pattern = sp.csr_array(matrix[equations:]).copy()
    pattern.data = (pattern.data != 0.0).astype(float)
    shared = joins @ pattern
    return sp.csr_array(shared.T @ shared)


def _minimum_degree(pattern: sp.csr_array) -> Ints:
    """Return the position (k,) of each of k unknowns in a minimum-degree elimination order.

    pattern: (k, k) symmetric sparse matrix, whose entries are the edges of the graph.
    """
    dummy = pattern.copy()
    dummy.data = np.full(len(dummy.data), -1.0)
    heavy = sp.csc_matrix(dummy + (2.0 + np.diff(pattern.indptr).max(initial=0)) * sp.eye_array(pattern.shape[0]))
    factor = splu(heavy, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.asarray(factor.perm_c, dtype=np.int64)


def _filled(place: Ints, one: Ints, other: Ints) -> Factor:
    """Compute the pattern of a symmetric matrix's factor, with fill.

    place: (N,) place of each unknown. one, other: (k,) row and column places of the entries; those with one ≤ other are
    ignored.
    """
    count = len(place)
    below = one > other
    structure: list[set[int]] = [set() for _ in range(count)]
    for row, column in zip(one[below].tolist(), other[below].tolist(), strict=True):
        structure[column].add(row)
    for column in range(count):
        rest = structure[column]
        if rest:
            parent = min(rest)
            structure[parent] |= rest
            structure[parent].discard(parent)
    rows = [sorted(rest) for rest in structure]
    start = np.concatenate([[0], np.cumsum([len(rest) for rest in rows])]).astype(np.int64)
    row = np.array([k for rest in rows for k in rest], dtype=np.int64)
    column = np.repeat(np.arange(count), np.diff(start))
    order = np.lexsort((column, row))
    left_start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))]).astype(np.int64)
    return Factor(place, start, row, left_start, column[order], order)


def terms_of(factor: Factor, matrix: sp.csr_array, sizes: tuple[int, int, int]) -> Terms:
    """Compute the entries of the reduced system as sums over weights of rows.

    factor: pattern. matrix, sizes: as for `factor_of`.
    """
    equations, linear, cones = sizes
    width, count = matrix.shape[1], len(factor.place)
    column = np.repeat(np.arange(count), np.diff(factor.start))
    keys = np.concatenate([np.arange(count) * (count + 1), column * count + factor.row])
    order = np.argsort(keys)

    def entry(a: Ints, b: Ints) -> Ints:
        """Return the numbers of the entries at pairs of places a, b, in either order."""
        wanted = np.minimum(a, b) * count + np.maximum(a, b)
        return np.asarray(order[np.searchsorted(keys[order], wanted)])

    fixed = np.zeros(len(keys))
    first = sp.coo_array(sp.csr_array(matrix[:equations]))
    fixed[entry(factor.place[width + first.coords[0]], factor.place[first.coords[1]])] = first.data
    every = equations + np.arange(linear)
    found = [_products(matrix, every, every, np.arange(linear))]
    head = equations + linear + 3 * np.arange(cones)
    for number, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        found.append(_products(matrix, head + i, head + j, linear + 6 * np.arange(cones) + number))
        if i != j:
            found.append(_products(matrix, head + j, head + i, linear + 6 * np.arange(cones) + number))
    a, b, weight, value = (np.concatenate(parts) for parts in zip(*found, strict=True))
    keep = factor.place[a] >= factor.place[b]
    a, b, weight, value = a[keep], b[keep], weight[keep], value[keep]
    shape = (len(keys), linear + 6 * cones)
    sums = sp.csr_array((value, (entry(factor.place[a], factor.place[b]), weight)), shape=shape)
    sums.sum_duplicates()
    return Terms(fixed, sums.indptr.astype(np.int64), sums.indices.astype(np.int64), sums.data)


def _products(matrix: sp.csr_array, one: Ints, other: Ints, weight: Ints) -> tuple[Ints, Ints, Ints, Floats]:
    """Multiply all pairs of entries of row one[k] and row other[k] of a matrix.

    one, other, weight: (k,) row numbers, and weight number of each pair of rows. Returns columns of both factors,
    weight number and product of each pair of entries.
    """
    start, length = matrix.indptr, np.diff(matrix.indptr)
    count = length[one] * length[other]
    pair = np.repeat(np.arange(len(one)), count)
    inside = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    first = start[one[pair]] + inside // length[other][pair]
    second = start[other[pair]] + inside % length[other][pair]
    return matrix.indices[first], matrix.indices[second], weight[pair], matrix.data[first] * matrix.data[second]
