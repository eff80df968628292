"""Linear systems of the interior-point method, solved by a Schur complement.

With W the scaling of the cones, E the equations and G the yield rows of a program, each step solves

    [ 0  Eᵀ  Gᵀ ] [x]   [p]
    [ E  0   0  ] [u] = [q]
    [ G  0  −W² ] [v]   [r]

H = GᵀW⁻²G has one small matrix block per face, so that A H⁻¹ Aᵀ couples only elements that touch. Its pattern is
analysed once and it is factored by sparse Cholesky. Columns that border the matrix blocks are eliminated last. Source:
docs/method.md (8.5); Wright, Primal-Dual Interior-Point Methods (SIAM 1997), ch. 11.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats, Ints
from jld_core.errors import SolverError
from jld_core.linalg.cholesky import Fronts
from jld_core.program import ConicProgram, Structure
from jld_core.solvers.schur.compiled_fronts import Solves, factorisation
from jld_core.solvers.schur.face_blocks import FaceBlocks, Family, face_blocks, filled
from jld_core.solvers.schur.nesterov_todd import NesterovTodd

_SHIFT = 1e-14  # added to the diagonal of the Schur complement, which is scaled to ones
_RETRIES = 5  # attempts to factor; each failure multiplies the shift by 100
_ACCURACY = 1e-13  # residual, relative to the right-hand side, at which refinement ends by default
_PASSES = 3

_NONE = np.zeros(0, dtype=np.int64)
_EMPTY = np.zeros(0)


class SchurSystem:
    """Linear systems of the interior-point method, for all programs of one structure.

    Call `load` once per program, then `factor` once per iteration, then `solve` for each right-hand side. With the
    equations E and the yield rows G of the program, and the scaling W of the cones, the system is

        Eᵀu + Gᵀv = p,   E x = q,   G x − W²v = r.

    x are the columns of the program, u and v the multipliers of its equations and of its yield rows. The constructor
    raises SolverError if the structure does not separate into faces. `accuracy` is the residual, relative to the
    right-hand side, at which refinement ends.
    """

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self.blocks: FaceBlocks = face_blocks(structure)
        self._lay_out(structure.equalities, structure.places)
        self.accuracy = _ACCURACY

    def _lay_out(self, size: int, places: Floats | None) -> None:
        """Analyse the pattern of the Schur complement, and where the entries of faces add up.

        size: number of equations. places: (size, d) coordinates of the equations, None where unknown.
        """
        keys, cover = [np.arange(size) * (size + 1)], np.zeros(size)
        rng = np.random.default_rng(0)
        for family in self.blocks.families:
            equations = family.equations
            lower = np.tril_indices(equations.shape[1])
            keys.append((equations[:, lower[0]] * size + equations[:, lower[1]]).ravel())
            np.add.at(cover, equations, rng.random(len(equations))[:, None])
        unique, inverse = np.unique(np.concatenate(keys), return_inverse=True)
        count = len(inverse)
        self._sum = sp.csr_array(
            (np.ones(count - size), (inverse[size:], np.arange(count - size))), shape=(len(unique), count - size)
        )
        self._rows, self._columns = unique // size, unique % size
        self._diagonal = np.flatnonzero(self._rows == self._columns)
        self._prepare_products(size)
        # Equations of one element meet the same faces; equal sums of random numbers per face identify them.
        _, first, node = np.unique(np.round(cover, 9), return_index=True, return_inverse=True)
        self._fronts = factorisation(Fronts(self._rows, self._columns, node, None if places is None else places[first]))

    def _prepare_products(self, size: int) -> None:
        """Lay out sparse matrices of the columns of all faces, one face after another, whose values `factor` fills in.

        size: number of equations. A sparse product takes a quarter of the time of products face by face.
        """
        families = self.blocks.families
        self._columns_of_faces = np.concatenate([family.columns.ravel() for family in families] or [_NONE])
        count, done = len(self._columns_of_faces), 0
        own, touched, wide, deep = [_NONE], [_NONE], [_NONE], [_NONE]
        for family in families:
            m, k = family.columns.shape
            numbers = done + np.arange(m * k).reshape(m, k)
            own.append(np.repeat(numbers, k, axis=0).ravel())
            touched.append(np.repeat(family.equations, k, axis=0).ravel())
            wide.append(np.full(m * k, k))
            deep.append(np.full(m * k, family.equations.shape[1]))
            done += m * k

        def laid(columns: list[Ints], entries: list[Ints], width: int) -> sp.csr_array:
            start = np.concatenate([[0], np.cumsum(np.concatenate(entries))])
            return sp.csr_array((np.zeros(start[-1]), np.concatenate(columns), start), shape=(count, width))

        self._inverse, self._half = laid(own, wide, count), laid(touched, deep, size)

    def load(self, program: ConicProgram) -> None:
        """Take over the numbers of a program; the next call must be `factor`.

        Raises SolverError if a column without yield rows has entries.
        """
        data, blocks = program.data, self.blocks
        matrix = program.matrix
        edge = self.structure.equalities
        if blocks.idle.size and abs(matrix[:, blocks.idle]).sum() > 0.0:
            raise SolverError("a column of this program has no yield row to hold it")
        self._equations, self._yields = sp.csr_array(matrix[:edge]), sp.csr_array(matrix[edge:])
        self._equations_t, self._yields_t = sp.csr_array(matrix[:edge].T), sp.csr_array(matrix[edge:].T)
        count = len(blocks.border)
        self._edge_equations = np.zeros((edge, count))
        self._edge_equations[blocks.edge[1], blocks.edge[2]] = data[blocks.edge[0]]
        self._loose = np.zeros((self._yields.shape[0], count))
        self._loose[blocks.loose[1], blocks.loose[2]] = data[blocks.loose[0]]
        self._loose_rows = np.unique(blocks.loose[1])
        self._g: list[Floats] = []
        self._a: list[Floats] = []
        self._edge: list[Floats] = []
        for family in blocks.families:
            m, wide = family.columns.shape
            high, deep = family.rows.shape[1], family.equations.shape[1]
            self._g.append(filled((m, high, wide), family.g, data))
            self._a.append(np.ascontiguousarray(filled((m, deep, wide), family.a, data).transpose(0, 2, 1)))
            self._edge.append(filled((m, high, count), family.edge, data))

    def equations(self, x: Floats) -> Floats:
        """Return the product E x (equations,) of the loaded equations with x (columns,)."""
        return np.asarray(self._equations @ x)

    def yields(self, x: Floats) -> Floats:
        """Return the product G x (yield rows,) of the loaded yield rows with x (columns,)."""
        return np.asarray(self._yields @ x)

    def transposed(self, u: Floats, v: Floats) -> Floats:
        """Return Eᵀu + Gᵀv (columns,) for u (equations,) and v (yield rows,)."""
        return np.asarray(self._equations_t @ u + self._yields_t @ v)

    def factor(self, scaling: NesterovTodd) -> None:
        """Factor the linear system of the loaded program for one scaling of the cones.

        `solve` then uses this factor until the next call. Raises np.linalg.LinAlgError if the Schur complement stays
        indefinite under the largest shift of its diagonal.
        """
        self._scaling = scaling
        count = len(self.blocks.border)
        inverses, halves, sides, summands = [_EMPTY], [_EMPTY], [np.zeros((0, count))], [_EMPTY]
        edges = self._edge_equations.copy()
        loose = self._scaled_loose(scaling)
        corner = loose.T @ loose
        for number, family in enumerate(self.blocks.families):
            scaled = _divided(scaling, family, self._g[number])
            inverse = _right_inverse_of_r(scaled)
            half = inverse.transpose(0, 2, 1) @ self._a[number]
            inverses.append(inverse.ravel())
            halves.append(half.ravel())
            side = np.zeros((len(scaled), scaled.shape[2], count))
            if count:
                border = _divided(scaling, family, self._edge[number])
                side = inverse.transpose(0, 2, 1) @ (scaled.transpose(0, 2, 1) @ border)
                rest = border - scaled @ (inverse @ side)
                corner = corner + np.einsum("nij,nik->jk", rest, rest)
                np.subtract.at(edges, family.equations, half.transpose(0, 2, 1) @ side)
            sides.append(side.reshape(-1, count))
            lower = np.tril_indices(half.shape[2])
            square = half.transpose(0, 2, 1) @ half
            summands.append(square[:, lower[0], lower[1]].ravel())
        self._inverse.data, self._half.data = np.concatenate(inverses), np.concatenate(halves)
        self._side = np.concatenate(sides)
        data = self._sum @ np.concatenate(summands)
        diagonal = data[self._diagonal]
        self._size = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        data = data * self._size[self._rows] * self._size[self._columns]
        self._factor = self._shifted(data)
        self._edges = edges
        if count:
            self._reach = self._solve(edges)
            self._corner = corner + edges.T @ self._reach

    def _shifted(self, data: Floats) -> Solves:
        """Factor the scaled Schur complement with the least diagonal shift tried that succeeds.

        data: values of its entries, whose diagonal is overwritten. Raises np.linalg.LinAlgError if none succeeds.
        """
        shift = _SHIFT
        for _ in range(_RETRIES):
            data[self._diagonal] = 1.0 + shift
            try:
                return self._fronts.factor(data)
            except np.linalg.LinAlgError:
                shift *= 100.0
        raise np.linalg.LinAlgError("the Schur complement is not positive definite")

    def _scaled_loose(self, scaling: NesterovTodd) -> Floats:
        """Return the yield rows that only border columns enter, (rows, border), times W⁻¹."""
        return self._loose[self._loose_rows] / scaling.linear[self._loose_rows, None]

    def _solve(self, rhs: Floats) -> Floats:
        """Solve the factored Schur complement for right-hand sides (equations,) or (equations, k)."""
        size = self._size if rhs.ndim == 1 else self._size[:, None]
        return size * self._factor.solve(size * rhs)

    def solve(self, p: Floats, q: Floats, r: Floats) -> tuple[Floats, Floats, Floats]:
        """Solve the factored system for one right-hand side, and return x, u and W v.

        p: (columns,), q: (equations,), r: (yield rows,); x, u and W v have these shapes in this order. Iterative
        refinement continues while it halves the residual, at most three times.
        """
        scaling = self._scaling
        x, u, wv = self._once(p, q, r)
        aim = self.accuracy * max(1e-3, *(float(abs(part).max(initial=0.0)) for part in (p, q, r)))
        least, best = np.inf, (x, u, wv)
        for _ in range(_PASSES):
            left_p = p - self.transposed(u, scaling.divide(wv))
            left_q = q - self.equations(x)
            left_r = r - self.yields(x) + scaling.times(wv)
            left = max(float(abs(part).max(initial=0.0)) for part in (left_p, left_q, left_r))
            if not left < 0.5 * least:
                break
            least, best = left, (x, u, wv)
            if left <= aim:
                return best
            dx, du, dwv = self._once(left_p, left_q, left_r)
            x, u, wv = x + dx, u + du, wv + dwv
        else:
            return x, u, wv
        return best

    def _once(self, p: Floats, q: Floats, r: Floats) -> tuple[Floats, Floats, Floats]:
        """Solve the system of the module docstring once, without refinement.

        p: (columns,), q: (equations,), r: (yield rows,). The results are x, u and W v.
        """
        blocks, scaling = self.blocks, self._scaling
        rho = scaling.divide(r)
        c = p + np.asarray(self._yields_t @ scaling.divide(rho))
        e = self._inverse.T @ c[self._columns_of_faces]
        u = self._solve(self._half.T @ e - q)
        x = np.zeros(len(p))
        apart = np.zeros(len(blocks.border))
        if len(blocks.border):
            rest = c[blocks.border] - self._edges.T @ u - self._side.T @ e
            apart = np.linalg.solve(self._corner, rest)
            u = u + self._reach @ apart
            x[blocks.border] = apart
        x[self._columns_of_faces] = self._inverse @ (e - self._half @ u - self._side @ apart)
        return x, u, scaling.divide(self.yields(x)) - rho


def _divided(scaling: NesterovTodd, family: Family, rows: Floats) -> Floats:
    """Return the yield rows (m, rows, ·) of a family, multiplied by the inverse scaling W⁻¹."""
    half, cones = family.linear, scaling.cones
    out = np.empty_like(rows)
    out[:, :half] = rows[:, :half] / scaling.linear[family.rows[:, :half], None]
    size = cones.size
    for k in range(family.cones):
        part = slice(half + size * k, half + size * (k + 1))
        which: Ints = (family.rows[:, half + size * k] - cones.linear) // size
        out[:, part] = scaling.inverse[which] @ rows[:, part]
    return out


def _right_inverse_of_r(stack: Floats) -> Floats:
    """Return R⁻¹ (m, k, k) of the QR factorisations of m matrices (rows, k).

    The matrices have full column rank. Householder reflections treat all faces at once, with faces as the last axis.
    The product WᵀW would lose digits where the weights differ by more than half of the digits of a float; QR keeps
    them.
    """
    table = np.array(stack.transpose(1, 2, 0), order="C")
    wide, count = table.shape[1:]
    inverse = np.zeros((wide, wide, count))
    for j in range(wide):
        column = table[j:, j]
        norm = np.sqrt(np.einsum("in,in->n", column, column))
        sign = np.where(column[0] < 0.0, -1.0, 1.0)
        v = column.copy()
        v[0] += sign * norm
        scale = np.einsum("in,in->n", v, v)
        scale = np.where(scale > 0.0, 2.0 / np.where(scale > 0.0, scale, 1.0), 0.0)
        if j + 1 < wide:
            table[j:, j + 1 :] -= v[:, None] * (scale * np.einsum("in,ijn->jn", v, table[j:, j + 1 :]))
        table[j, j] = np.where(norm > 0.0, -sign * norm, 1e-150)
    for j in range(wide):
        inverse[j, j] = 1.0 / table[j, j]
        if j:
            inverse[:j, j] = -np.einsum("ikn,kn->in", inverse[:j, :j], table[:j, j]) * inverse[j, j]
    return np.ascontiguousarray(inverse.transpose(2, 0, 1))
