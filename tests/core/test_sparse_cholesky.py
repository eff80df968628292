"""Multifrontal Cholesky against dense algebra, on graphs in one piece, in several, with and without places."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from jld_core.batch import chosen
from jld_core.linalg.cholesky import Fronts, nested_dissection
from jld_core.solvers.schur.compiled_fronts import CompiledFronts, factorisation


def grid_edges(width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges of a grid graph, and its places."""
    node = np.arange(width * height).reshape(height, width)
    rows = np.concatenate([node[:, 1:].ravel(), node[1:].ravel()])
    columns = np.concatenate([node[:, :-1].ravel(), node[:-1].ravel()])
    y, x = np.divmod(node.ravel(), width)
    return rows, columns, np.column_stack([x, y]).astype(float)


def matrix_of(rows: np.ndarray, columns: np.ndarray, count: int, size: int, seed: int) -> sp.coo_array:
    """Random symmetric positive definite matrix, a size × size block per node and edge; lower triangle and all."""
    rng = np.random.default_rng(seed)
    dense = np.zeros((count * size, count * size))
    for a, b in zip(rows, columns, strict=True):
        dense[a * size : (a + 1) * size, b * size : (b + 1) * size] = rng.standard_normal((size, size))
    dense = dense + dense.T
    return sp.coo_array(dense + np.diag(abs(dense).sum(axis=1) + 1.0))


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(("width", "height", "size"), [(1, 1, 3), (2, 1, 6), (9, 7, 3), (30, 4, 6), (17, 16, 1)])
def test_solves(width: int, height: int, size: int, known: bool) -> None:
    rows, columns, places = grid_edges(width, height)
    matrix = matrix_of(rows, columns, width * height, size, seed=1)
    row, column = matrix.coords
    lower = row >= column
    node = np.arange(width * height * size) // size
    fronts = Fronts(row[lower].astype(np.int64), column[lower].astype(np.int64), node, places if known else None)
    rhs = np.random.default_rng(2).standard_normal((len(node), 2))
    exact = np.linalg.solve(matrix.toarray(), rhs)
    factor = fronts.factor(matrix.data[lower])
    np.testing.assert_allclose(factor.solve(rhs), exact, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(factor.solve(rhs[:, 0]), exact[:, 0], rtol=1e-10, atol=1e-12)


def test_several_pieces_and_nodes_of_different_sizes() -> None:
    """Two grids that do not touch, a node alone, and nodes of one to four unknowns."""
    rows, columns, _ = grid_edges(8, 6)
    rows, columns = np.concatenate([rows, rows + 48]), np.concatenate([columns, columns + 48])
    rng = np.random.default_rng(3)
    node = np.repeat(np.arange(97), rng.integers(1, 5, 97))
    linked = np.eye(97, dtype=bool)
    linked[rows, columns] = linked[columns, rows] = True
    dense = np.where(linked[np.ix_(node, node)], rng.standard_normal((len(node), len(node))), 0.0)
    dense = dense + dense.T + 200.0 * np.eye(len(node))
    row, column = np.nonzero(np.tril(dense))
    fronts = Fronts(row, column, node)
    rhs = rng.standard_normal(len(node))
    np.testing.assert_allclose(fronts.factor(dense[row, column]).solve(rhs), np.linalg.solve(dense, rhs), rtol=1e-10)


def test_an_indefinite_matrix_is_refused() -> None:
    rows, columns, places = grid_edges(12, 10)
    matrix = matrix_of(rows, columns, 120, 1, seed=4)
    row, column = matrix.coords
    lower = row >= column
    data = matrix.data[lower].copy()
    data[(row == column)[lower]] *= -1.0
    with pytest.raises(np.linalg.LinAlgError):
        Fronts(row[lower].astype(np.int64), column[lower].astype(np.int64), np.arange(120), places).factor(data)


def test_dissection_is_an_order_with_small_separators() -> None:
    """Every node once; no edge joins parts of which neither is above the other; separators of a grid are lines."""
    rows, columns, places = grid_edges(40, 20)
    tree = nested_dissection(rows, columns, 800, 12, places)
    np.testing.assert_array_equal(np.sort(tree.order), np.arange(800))
    part = np.empty(800, dtype=int)
    part[tree.order] = np.repeat(np.arange(len(tree.parent)), np.diff(tree.start))
    assert np.all((tree.parent > np.arange(len(tree.parent))) | (tree.parent == -1))

    def line(p: int) -> set[int]:
        found = set()
        while p >= 0:
            found.add(p)
            p = int(tree.parent[p])
        return found

    for a, b in zip(part[rows].tolist(), part[columns].tolist(), strict=True):
        assert a in line(b) or b in line(a)
    assert np.diff(tree.start)[-1] == 20


@pytest.mark.skipif(chosen() is None, reason="no compiled library")
@pytest.mark.parametrize(("width", "height", "size"), [(3, 2, 3), (30, 20, 3), (25, 25, 6)])
def test_the_compiled_factor_is_that_of_numpy(width: int, height: int, size: int) -> None:
    """Both routes, one and two right-hand sides; indefinite matrices are refused by both."""
    rows, columns, places = grid_edges(width, height)
    rng = np.random.default_rng(7)
    matrix = sp.kron(
        sp.coo_array((np.ones(len(rows)), (rows, columns)), shape=(width * height,) * 2), np.ones((size,) * 2)
    )
    matrix = matrix + matrix.T + sp.block_diag([np.ones((size, size))] * (width * height))
    row, column = sp.tril(matrix).tocoo().coords
    data = rng.standard_normal(len(row))
    data[row == column] = 20.0 * size
    fronts = Fronts(row.astype(np.int64), column.astype(np.int64), np.repeat(np.arange(len(places)), size), places)
    compiled = factorisation(fronts)
    assert isinstance(compiled, CompiledFronts)
    whole = sp.csr_array((data, (row, column)), shape=matrix.shape)
    whole = whole + sp.tril(whole, -1).T
    one, two = fronts.factor(data), compiled.factor(data)
    for rhs in (rng.standard_normal(matrix.shape[0]), rng.standard_normal((matrix.shape[0], 2))):
        np.testing.assert_allclose(two.solve(rhs), one.solve(rhs), rtol=1e-9, atol=1e-13)
        np.testing.assert_allclose(whole @ two.solve(rhs), rhs, rtol=1e-9, atol=1e-12)
    data[np.flatnonzero(row == column)[-1]] *= -1.0
    with pytest.raises(np.linalg.LinAlgError):
        compiled.factor(data)


def test_without_a_library_numpy_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JLD_KERNEL", "off")
    fronts = Fronts(np.arange(3), np.arange(3), np.arange(3))
    assert factorisation(fronts) is fronts
