"""Linear systems of the interior-point method, solved by a Schur complement (8.5).

W is the scaling of the cones, E the equations, G the yield rows, docs/method.md (8.4). H = GᵀW⁻²G has one small matrix
block per face. Columns that border the matrix blocks are eliminated last. Source: Wright, Primal-Dual Interior-Point
Methods (SIAM 1997), ch. 11.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.deadline import Deadline
from jld_core.errors import SolverError
from jld_core.linalg.factors import Fronts
from jld_core.program import ConicProgram
from jld_core.program.template import Structure
from jld_core.solvers.base import EARLY, RawSolution, RawStatus, Solver, Suffices
from jld_core.solvers.schur_fronts import (
    BlockEquations,
    Cones,
    FaceBlocks,
    Family,
    NesterovTodd,
    Solves,
    face_blocks,
    factorisation,
    filled,
)

_SHIFT = 1e-14  # added to the diagonal of the Schur complement, which is scaled to ones
_RETRIES = 5  # attempts to factor; each failure multiplies the shift by 100
_ACCURACY = 1e-13  # residual, relative to the right-hand side, at which refinement ends by default
_PASSES = 3  # largest number of solutions of one system, the refinements included

_NONE = np.zeros(0, dtype=np.int64)
_EMPTY = np.zeros(0)

_SHIFT_GROWTH = 100.0  # factor on the shift after each failure
_LEAST_SIDE = 1e-3  # size of right-hand sides below which residuals are not made smaller
_NO_COLUMN = 1e-150  # diagonal entry in the place of 0 for a column without entries


class SchurSystem:
    """Linear systems of the interior-point method, for all programs of one structure.

    Call `load` once per program, `factor` once per iteration, `solve` for each right-hand side: Eᵀu + Gᵀv = p, E x = q,
    G x − W²v = r. The constructor raises SolverError if the structure does not separate into faces. accuracy: relative
    residual at which refinement ends.
    """

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self.blocks: FaceBlocks = face_blocks(structure)
        self._lay_out(structure.equalities, structure.places)
        self.accuracy = _ACCURACY

    def _lay_out(self, size: int, places: Floats | None) -> None:
        """Analyse the pattern (size, size) of the Schur complement, and where the entries of faces add up."""
        # An entry's key is row · size + column, of the diagonal and of the lower triangles of all faces.
        keys, signature = [np.arange(size) * (size + 1)], np.zeros(size)
        rng = np.random.default_rng(0)
        for family in self.blocks.families:
            equations = family.equations
            lower = np.tril_indices(equations.shape[1])
            keys.append((equations[:, lower[0]] * size + equations[:, lower[1]]).ravel())
            np.add.at(signature, equations, rng.random(len(equations))[:, None])
        unique, inverse = np.unique(np.concatenate(keys), return_inverse=True)
        of_faces = inverse[size:]  # entry of the Schur complement to which each entry of a face is added
        self._sum = sp.csr_array(
            (np.ones(len(of_faces)), (of_faces, np.arange(len(of_faces)))), shape=(len(unique), len(of_faces))
        )
        # row and column of each entry of the Schur complement, and which of them are on the diagonal
        self._rows, self._columns = unique // size, unique % size
        self._diagonal = np.flatnonzero(self._rows == self._columns)
        self._prepare_products(size)
        # Equations of one element meet the same faces; equal sums of random numbers per face identify them.
        _, first, node = np.unique(np.round(signature, 9), return_index=True, return_inverse=True)
        self._fronts = factorisation(Fronts(self._rows, self._columns, node, None if places is None else places[first]))

    def _prepare_products(self, size: int) -> None:
        """Lay out sparse matrices of the columns of all faces, whose values `factor` fills in."""
        families = self.blocks.families
        self._columns_of_faces = np.concatenate([family.columns.ravel() for family in families] or [_NONE])
        count, offset = len(self._columns_of_faces), 0
        # columns of each row, row by row, and number of entries of each row: the k columns of the same face, and the
        # equations that the face enters
        of_face, of_face_count, of_equations, of_equations_count = [_NONE], [_NONE], [_NONE], [_NONE]
        for family in families:
            m, k = family.columns.shape
            local = offset + np.arange(m * k).reshape(m, k)
            of_face.append(np.repeat(local, k, axis=0).ravel())
            of_face_count.append(np.full(m * k, k))
            of_equations.append(np.repeat(family.equations, k, axis=0).ravel())
            of_equations_count.append(np.full(m * k, family.equations.shape[1]))
            offset += m * k

        def pattern(columns: list[Ints], entries: list[Ints], width: int) -> sp.csr_array:
            start = np.concatenate([[0], np.cumsum(np.concatenate(entries))])
            return sp.csr_array((np.zeros(start[-1]), np.concatenate(columns), start), shape=(count, width))

        # of all faces: R⁻¹ (columns, columns) and R⁻ᵀEᵀ (columns, equations), where RᵀR is the Hessian of a face; the
        # Schur complement is the product of the latter with itself
        self._r_inverse = pattern(of_face, of_face_count, count)
        self._r_equations = pattern(of_equations, of_equations_count, size)

    def load(self, program: ConicProgram) -> None:
        """Take over the numbers of a program; raise SolverError if a column without yield rows has entries."""
        data, blocks = program.data, self.blocks
        matrix = program.matrix
        equations = self.structure.equalities
        if blocks.idle.size and abs(matrix[:, blocks.idle]).sum() > 0.0:
            raise SolverError("a column of this program has no yield row to hold it")
        self._equations, self._yields = sp.csr_array(matrix[:equations]), sp.csr_array(matrix[equations:])
        self._equations_t, self._yields_t = sp.csr_array(matrix[:equations].T), sp.csr_array(matrix[equations:].T)
        count = len(blocks.border)
        self._border_equations = blocks.border_equations.table(data, equations, count)
        self._border_yields = blocks.border_yields.table(data, self._yields.shape[0], count)
        self._border_rows = np.unique(blocks.border_yields.row)
        # per family: yield rows G, equations A transposed, yield rows in border columns
        self._yields_of_faces: list[Floats] = []
        self._equations_of_faces: list[Floats] = []
        self._borders_of_faces: list[Floats] = []
        for family in blocks.families:
            m, k = family.columns.shape
            rows, r = family.rows.shape[1], family.equations.shape[1]
            self._yields_of_faces.append(filled((m, rows, k), family.g, data))
            self._equations_of_faces.append(np.ascontiguousarray(filled((m, r, k), family.a, data).transpose(0, 2, 1)))
            self._borders_of_faces.append(filled((m, rows, count), family.border, data))

    def equations(self, x: Floats) -> Floats:
        return np.asarray(self._equations @ x)

    def yields(self, x: Floats) -> Floats:
        return np.asarray(self._yields @ x)

    def transposed(self, u: Floats, v: Floats) -> Floats:
        """Return Eᵀu + Gᵀv (columns,) for u (equations,) and v (yield rows,)."""
        return np.asarray(self._equations_t @ u + self._yields_t @ v)

    def factor(self, scaling: NesterovTodd) -> None:
        """Factor the linear system of the loaded program for one scaling of the cones."""
        # `solve` then uses this factor until the next call. Raises np.linalg.LinAlgError if the Schur complement stays
        # indefinite under the largest shift of its diagonal.
        self._scaling = scaling
        count = len(self.blocks.border)
        r_inverses, r_equations, r_borders, complements = [_EMPTY], [_EMPTY], [np.zeros((0, count))], [_EMPTY]
        # Columns of faces are eliminated by QR of their scaled yield rows. What this subtracts from the equations and
        # the Hessian of the border columns is collected face by face.
        border_equations = self._border_equations.copy()
        border_yields = self._border_yields[self._border_rows] / scaling.linear[self._border_rows, None]  # times W⁻¹
        hessian = border_yields.T @ border_yields
        for number, family in enumerate(self.blocks.families):
            scaled = _divide_rows(scaling, family, self._yields_of_faces[number])
            r_inverse = _right_inverse_of_r(scaled)
            equation_part = r_inverse.transpose(0, 2, 1) @ self._equations_of_faces[number]
            r_inverses.append(r_inverse.ravel())
            r_equations.append(equation_part.ravel())
            border_part = np.zeros((len(scaled), scaled.shape[2], count))  # R⁻ᵀ times the Hessian's border columns
            if count:
                border = _divide_rows(scaling, family, self._borders_of_faces[number])
                border_part = r_inverse.transpose(0, 2, 1) @ (scaled.transpose(0, 2, 1) @ border)
                orthogonal = border - scaled @ (r_inverse @ border_part)
                hessian = hessian + np.einsum("nij,nik->jk", orthogonal, orthogonal)
                np.subtract.at(border_equations, family.equations, equation_part.transpose(0, 2, 1) @ border_part)
            r_borders.append(border_part.reshape(-1, count))
            lower = np.tril_indices(equation_part.shape[2])
            complement = equation_part.transpose(0, 2, 1) @ equation_part
            complements.append(complement[:, lower[0], lower[1]].ravel())
        self._r_inverse.data, self._r_equations.data = np.concatenate(r_inverses), np.concatenate(r_equations)
        self._r_border = np.concatenate(r_borders)
        data = self._sum @ np.concatenate(complements)
        diagonal = data[self._diagonal]
        self._row_scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        data = data * self._row_scale[self._rows] * self._row_scale[self._columns]
        self._factor = self._factor_shifted(data)
        self._reduced_border = border_equations
        if count:
            self._border_solved = self._solve(border_equations)
            self._border_complement = hessian + border_equations.T @ self._border_solved

    def _factor_shifted(self, data: Floats) -> Solves:
        """Factor the scaled Schur complement with the least diagonal shift tried that succeeds."""
        shift = _SHIFT
        for _ in range(_RETRIES):
            data[self._diagonal] = 1.0 + shift
            try:
                return self._fronts.factor(data)
            except np.linalg.LinAlgError:
                shift *= _SHIFT_GROWTH
        raise np.linalg.LinAlgError("the Schur complement is not positive definite")

    def _solve(self, rhs: Floats) -> Floats:
        """Solve the factored Schur complement for right-hand sides (equations,) or (equations, k)."""
        size = self._row_scale if rhs.ndim == 1 else self._row_scale[:, None]
        return size * self._factor.solve(size * rhs)

    def solve(self, p: Floats, q: Floats, r: Floats) -> tuple[Floats, Floats, Floats]:
        """Return x (columns,), u (equations,) and W v (yield rows,), refined while that halves the residual."""
        scaling = self._scaling
        x, u, wv = self._solve_unrefined(p, q, r)
        target = self.accuracy * max(_LEAST_SIDE, *(float(abs(part).max(initial=0.0)) for part in (p, q, r)))
        best_residual, best = np.inf, (x, u, wv)
        for _ in range(_PASSES):
            residual_p = p - self.transposed(u, scaling.divide(wv))
            residual_q = q - self.equations(x)
            residual_r = r - self.yields(x) + scaling.times(wv)
            residual = max(float(abs(part).max(initial=0.0)) for part in (residual_p, residual_q, residual_r))
            if not residual < 0.5 * best_residual:
                break
            best_residual, best = residual, (x, u, wv)
            if residual <= target:
                return best
            dx, du, dwv = self._solve_unrefined(residual_p, residual_q, residual_r)
            x, u, wv = x + dx, u + du, wv + dwv
        else:
            return x, u, wv
        return best

    def _solve_unrefined(self, p: Floats, q: Floats, r: Floats) -> tuple[Floats, Floats, Floats]:
        """Solve as `solve` does, once: eliminate v, then the columns of faces, and solve for u and the border."""
        blocks, scaling = self.blocks, self._scaling
        scaled_r = scaling.divide(r)
        c = p + np.asarray(self._yields_t @ scaling.divide(scaled_r))  # (GᵀW⁻²G) x + Eᵀu = c
        e = self._r_inverse.T @ c[self._columns_of_faces]
        u = self._solve(self._r_equations.T @ e - q)
        x = np.zeros(len(p))
        border = np.zeros(len(blocks.border))
        if len(blocks.border):
            right = c[blocks.border] - self._reduced_border.T @ u - self._r_border.T @ e
            border = np.linalg.solve(self._border_complement, right)
            u = u + self._border_solved @ border
            x[blocks.border] = border
        x[self._columns_of_faces] = self._r_inverse @ (e - self._r_equations @ u - self._r_border @ border)
        return x, u, scaling.divide(self.yields(x)) - scaled_r


def _divide_rows(scaling: NesterovTodd, family: Family, rows: Floats) -> Floats:
    """Return the yield rows (m, rows, ·) of a family, multiplied by W⁻¹."""
    linear, cones = family.linear, scaling.cones
    out = np.empty_like(rows)
    out[:, :linear] = rows[:, :linear] / scaling.linear[family.rows[:, :linear], None]
    size = cones.size
    for k in range(family.cones):
        part = slice(linear + size * k, linear + size * (k + 1))
        cone: Ints = (family.rows[:, linear + size * k] - cones.linear) // size
        out[:, part] = scaling.inverse[cone] @ rows[:, part]
    return out


def _right_inverse_of_r(matrices: Floats) -> Floats:
    """Return R⁻¹ (m, k, k) of the QR factorisations of m matrices (rows, k)."""
    # The matrices have full column rank. Householder reflections treat all faces at once, with faces as the last axis.
    # Cholesky of the product of a matrix with itself would lose digits where weights differ by more than half of the
    # digits of a float; QR keeps them.
    r = np.array(matrices.transpose(1, 2, 0), order="C")
    width, count = r.shape[1:]
    inverse = np.zeros((width, width, count))
    for j in range(width):
        column = r[j:, j]
        norm = np.sqrt(np.einsum("in,in->n", column, column))
        sign = np.where(column[0] < 0.0, -1.0, 1.0)
        v = column.copy()
        v[0] += sign * norm
        scale = np.einsum("in,in->n", v, v)
        scale = np.where(scale > 0.0, 2.0 / np.where(scale > 0.0, scale, 1.0), 0.0)
        if j + 1 < width:
            r[j:, j + 1 :] -= v[:, None] * (scale * np.einsum("in,ijn->jn", v, r[j:, j + 1 :]))
        r[j, j] = np.where(norm > 0.0, -sign * norm, _NO_COLUMN)
    for j in range(width):
        inverse[j, j] = 1.0 / r[j, j]
        if j:
            inverse[:j, j] = -np.einsum("ikn,kn->in", inverse[:j, :j], r[:j, j]) * inverse[j, j]
    return np.ascontiguousarray(inverse.transpose(2, 0, 1))


SETTLED = 1e-3  # κ/τ below which the program counts as solvable and iterations leave the embedding

_EXACT = 1e-13  # relative residual of linear systems near the solution
_COARSE = 1e-10  # relative residual of linear systems far from it, where later iterations remove what is left
_PER_GAP = 1e-9  # residual of linear systems for each unit of the relative duality gap, between the two above
_WEIGHTS = 5  # weights of a corrector that are compared
_LEAST_WEIGHT = 0.1  # smallest of them
_CENTRAL = 0.1, 10.0  # range of complementarity products, in multiples of their target, that needs no correction
_LONG = 0.9  # step from which no centrality corrector is worth its linear system
_SHORT = 0.03  # step below which an iterate is jammed at the boundary of its cones and is centred instead
_LEAST_CENTRING = 1e-6  # least share of μ to aim at
_CENTRING = 0.9  # share of μ that is kept while an iterate is centred
_LONGER = 1.5, 0.1  # step for which a centrality corrector aims: factor of the step at hand, and what is added


@dataclass
class Iterate:
    """Iterate of the homogeneous self-dual embedding of a program."""

    x: Floats  # values of the columns
    u: Floats  # multipliers of the equations
    # s, v: slacks and multipliers of the yield rows
    s: Floats
    v: Floats
    # tau, kappa: the scalars τ and κ of the embedding
    tau: float = 1.0
    kappa: float = 1.0

    def relative_gap(self, objective: Floats) -> float:
        """Return the duality gap over the larger of 1 and the objective (columns,)."""
        return float(self.s @ self.v) / self.tau**2 / max(1.0, abs(float(objective @ self.x) / self.tau))

    def progress(self, objective: Floats) -> float:
        """Return the relative duality gap.

        For an iterate that tends to a ray, whose gap grows with 1/τ, its complementarity.
        """
        return float(self.s @ self.v) if self.kappa > self.tau else self.relative_gap(objective)


@dataclass(frozen=True)
class Direction:
    """Search direction: dx, du, W⁻¹ds, W dv, dτ and dκ."""

    x: Floats
    u: Floats
    ws: Floats
    wv: Floats
    tau: float
    kappa: float

    def plus(self, force_factor: float, motion_factor: float, other: Direction) -> Direction:
        """Add multiples of another direction: the first of its x, W⁻¹ds, τ and κ, the second of its u and W dv."""
        return Direction(
            self.x + force_factor * other.x,
            self.u + motion_factor * other.u,
            self.ws + force_factor * other.ws,
            self.wv + motion_factor * other.wv,
            self.tau + force_factor * other.tau,
            self.kappa + force_factor * other.kappa,
        )


class Newton:
    """Newton system of the central path at one iterate, factored for several right-hand sides.

    vectors: objective q, right-hand sides r of equations and h of yield rows. embedded: τ and κ are variables.
    separate_steps: forces and motion take steps of different length, which linear programs allow; with cones that took
    more iterations. mu: mean complementarity product. res_x, res_u, res_v, res_t: residuals of the embedding.
    """

    def __init__(self, system: SchurSystem, vectors: tuple[Floats, Floats, Floats], it: Iterate) -> None:
        self.system, self.vectors, self.it, self.cones = system, vectors, it, system.blocks.cones
        q, r, h = vectors
        self.scaling = NesterovTodd(self.cones, it.s, it.v)
        system.factor(self.scaling)
        coarse = _COARSE if not self.cones.count else _EXACT
        system.accuracy = min(coarse, max(_EXACT, _PER_GAP * it.progress(q)))
        self.embedded = it.kappa > SETTLED * it.tau
        self.separate_steps = not self.embedded and not self.cones.count
        # τκ is one more complementarity product of the embedding
        total, products = float(it.s @ it.v), self.cones.degree
        if self.embedded:
            total, products = total + it.tau * it.kappa, products + 1
        self.mu = total / products
        self.res_x = system.transposed(it.u, it.v) + it.tau * q
        self.res_u = system.equations(it.x) - it.tau * r
        self.res_v = system.yields(it.x) + it.s - it.tau * h
        self.res_t = it.kappa + float(q @ it.x + r @ it.u + h @ it.v)
        if self.embedded:
            # change of the solution, and of the equation of τ, with τ
            x1, u1, wv1 = system.solve(-q, r, h)
            self.column = x1, u1, wv1
            self.slope = float(q @ x1 + r @ u1 + h @ self.scaling.divide(wv1)) - it.kappa / it.tau

    def direction(self, eta: float, ds: Floats, dk: float) -> Direction:
        """Return the direction that removes a share eta of the residuals, and ds, dk of complementarity."""
        it, scaling = self.it, self.scaling
        comp = self.cones.quotient(scaling.point, ds)
        x2, u2, wv2 = self.system.solve(-eta * self.res_x, -eta * self.res_u, -eta * self.res_v - scaling.times(comp))
        if not self.embedded:
            return Direction(x2, u2, comp - wv2, wv2, 0.0, 0.0)
        (q, r, h), (x1, u1, wv1) = self.vectors, self.column
        power = float(q @ x2 + r @ u2 + h @ scaling.divide(wv2))
        dt = (-eta * self.res_t - dk / it.tau - power) / self.slope
        wv = wv2 + dt * wv1
        # Scaled slack and multiplier satisfy W⁻¹ds + W dv = λ \ ds.
        return Direction(x2 + dt * x1, u2 + dt * u1, comp - wv, wv, dt, (dk - it.kappa * dt) / it.tau)

    def step_lengths(self, direction: Direction, share: float = 1.0) -> tuple[float, float]:
        """Return the steps of forces and of motion, at most 1: a share of the longest within slacks and multipliers."""
        alpha, beta = (share * self.cones.step(self.scaling.point, change) for change in (direction.ws, direction.wv))
        if self.separate_steps:
            return min(1.0, alpha), min(1.0, beta)
        for value, change in ((self.it.tau, direction.tau), (self.it.kappa, direction.kappa)):
            if change < 0.0:
                alpha = min(alpha, share * -value / change)
        alpha = min(1.0, alpha, beta)
        return alpha, alpha

    def corrected_direction(self) -> Direction:
        """Return the predictor-corrector direction of Mehrotra."""
        # The predictor aims at complementarity 0 (λ∘λ is removed), its step says which share σ of μ to aim at, and the
        # corrector adds σμ less the product of the predictor's changes. With cones both are solved as one direction. In
        # linear programs the corrector is added by the weight that allows the longest step; a step that is still short
        # pays for a further system that centres (Gondzio), and a jammed iterate is centred alone.
        it, lam, cones = self.it, self.scaling.point, self.cones
        square = cones.product(lam, lam)
        direction = self.direction(1.0, -square, -it.tau * it.kappa)
        steps = self.step_lengths(direction)
        sigma = self._centring_share(direction, steps)
        # only in the homogeneous embedding do residuals have to shrink as μ does; elsewhere they are removed whole
        target, eta = sigma * self.mu, sigma if self.embedded else 0.0
        ds = target * cones.unit() - cones.product(direction.ws, direction.wv)
        dk = target - direction.kappa * direction.tau
        if cones.count:
            return self.direction(1.0 - eta, ds - square, dk - it.tau * it.kappa)
        direction, steps = self._add_weighted(direction, self.direction(-eta, ds, dk), steps)
        if min(steps) > _LONG:
            return direction
        direction = self._add_centring(direction, steps, target)
        return direction if min(self.step_lengths(direction)) > _SHORT else self._centring_direction(square)

    def _centring_direction(self, square: Floats) -> Direction:
        """Return the direction to the central path at nearly the same μ, along which a jammed iterate can move."""
        target, it = _CENTRING * self.mu, self.it
        return self.direction(1.0 - _CENTRING, target * self.cones.unit() - square, target - it.tau * it.kappa)

    def _centring_share(self, direction: Direction, steps: tuple[float, float]) -> float:
        """Return the share of μ to aim at, from the affine direction and its steps."""
        if not self.separate_steps:
            return min(1.0, max(_LEAST_CENTRING, (1.0 - steps[0]) ** 3))
        # Mehrotra's share of μ that an affine step would leave.
        lam, (alpha, beta) = self.scaling.point, steps
        remaining_share = float((lam + alpha * direction.ws) @ (lam + beta * direction.wv)) / float(lam @ lam)
        # Out of its cones a step leaves less than nothing, and the cube of −10¹¹⁰ is an error.
        return max(_LEAST_CENTRING, max(0.0, min(1.0, remaining_share)) ** 3)

    def _add_weighted(
        self, direction: Direction, corrector: Direction, steps: tuple[float, float]
    ) -> tuple[Direction, tuple[float, float]]:
        """Add the multiple of a corrector that allows the longest steps; return the direction and its steps."""
        weights = np.linspace(max(_LEAST_WEIGHT, min(steps) ** 2), 1.0, _WEIGHTS).tolist()
        lengths = [self.step_lengths(direction.plus(weight, weight, corrector)) for weight in weights]
        # of forces and of motion; where steps are equal, the larger weight is taken
        first, second = (max(range(_WEIGHTS), key=lambda k: (lengths[k][side], k)) for side in (0, 1))
        return direction.plus(weights[first], weights[second], corrector), (lengths[first][0], lengths[second][1])

    def _add_centring(self, direction: Direction, steps: tuple[float, float], target: float) -> Direction:
        """Add a corrector that brings complementarity products nearer to their target, for longer steps."""
        it, lam = self.it, self.scaling.point
        force_step, motion_step = (min(1.0, _LONGER[0] * length + _LONGER[1]) for length in steps)
        low, high = (factor * target for factor in _CENTRAL)

        def correction(product: Floats) -> Floats:
            """Return what a product lacks of the central range, at least −high."""
            return np.asarray(np.maximum(np.clip(product, low, high) - product, -high))

        ds = correction((lam + force_step * direction.ws) * (lam + motion_step * direction.wv))
        tau, kappa = it.tau + force_step * direction.tau, it.kappa + force_step * direction.kappa
        dk = float(correction(np.array(tau * kappa)))
        return self._add_weighted(direction, self.direction(0.0, ds, dk), steps)[0]


_PROGRESS = 0.9  # ratio to the least error so far below which an iteration counts as progress
_STALLED = 6  # iterations without progress after which the best iterate is the answer
_NEAR_THE_END = 1e6  # error, in multiples of the tolerances, from which on iterations without progress go on
_INSIDE = 0.99  # share that is taken of the longest step within the cones
_NO_STEP = 1e-8  # step below which iterations break down
_VANISHED = 1e-14  # τ/κ below which no further iterate can be a point; rays are reached to tolerance well above it


class SchurSolver(Solver):
    """Schur-complement interior-point solver for large assemblies; it keeps the analysis of the last structure.

    Columns must separate into faces, and cones have one size; `solve` raises SolverError for other programs. gap:
    relative duality gap to reach. most: largest number of iterations. until: DeadlinePassed is raised after it.
    """

    name = "schur"

    def __init__(
        self, tolerance: float | None = None, gap: float = 1e-8, most: int = 100, until: Deadline | None = None
    ) -> None:
        self._tolerance, self._gap, self._most, self._until = tolerance, gap, most, until or Deadline()
        self._structure: Structure | None = None
        self._system: SchurSystem | None = None
        self._equations: BlockEquations | None = None

    def solve(self, program: ConicProgram) -> RawSolution:
        return self.solve_until(program, None)

    def solve_until(self, program: ConicProgram, suffices: Suffices | None) -> RawSolution:
        # An iterate is offered once its relative duality gap is at most `EARLY`. The structure is analysed if it is
        # new.
        start = time.perf_counter()
        equations = self._block_equations(program)
        if equations is not None:
            program = equations.changed(program)
        program = program.rounded
        if self._system is None or self._structure is not program.structure:
            self._system = SchurSystem(program.structure)
            self._structure = program.structure
        self._system.load(program)
        defaults = tolerances.FRICTION_CONES if program.structure.cones else tolerances.LINEAR
        iteration = _Iteration(program, self._system, self._tolerance or defaults.residual, self._gap)
        # Breakdown shows as values that are not finite, so floating-point warnings add nothing.
        with np.errstate(all="ignore"):
            restore = equations.multipliers if equations is not None else np.asarray
            if suffices is not None:
                iteration.suffices = lambda point, dual: suffices(point, restore(dual))
            status, iterate, iterations = iteration.run(self._most, self._until)
            point, dual = iteration.answer(status, iterate)
            dual = restore(dual)
        return RawSolution(status, point, dual, iterations, time.perf_counter() - start, note=iteration.note)

    def _block_equations(self, program: ConicProgram) -> BlockEquations | None:
        """Return the transformation of a program to equilibrium of whole blocks; None where each is one element."""
        # The last transformation is stored and reused if it fits the program.
        bodies, equations = program.bodies, self._equations
        if bodies is None:
            return None
        if equations is None or not equations.fits(program):
            sums = bodies.sums(program.structure.equalities)
            equations = None if sums is None else BlockEquations(program, sums)
            self._equations = equations
        return equations


_START_SLACK = 1e-3  # slack below which the first iterate is shifted into the cones
_RAY = 10.0  # residual of a ray, in tolerances, up to which it counts as one


class _Iteration:
    def __init__(self, program: ConicProgram, system: SchurSystem, tolerance: float, gap: float) -> None:
        edge = program.structure.equalities
        self.system, self.tolerance, self.gap = system, tolerance, gap
        self.cones: Cones = system.blocks.cones
        self.q, self.r, self.h = program.objective, program.rhs[:edge], program.rhs[edge:]
        self.unit = self.cones.unit()
        self.note = ""
        self.suffices: Suffices | None = None

    def run(self, most: int, until: Deadline) -> tuple[RawStatus, Iterate, int]:
        """Iterate until convergence, a ray or stagnation; return status, iterate and count."""
        # Without convergence the best iterate is returned.
        try:
            current = self._start()
        except np.linalg.LinAlgError:
            self.note = "singular"
            origin = Iterate(np.zeros(len(self.q)), np.zeros(len(self.r)), self.unit.copy(), self.unit.copy())
            return RawStatus.FAILED, origin, 0
        best, best_merit, stalled = current, np.inf, 0
        for iteration in range(most):
            until.check()
            status, merit = self._status_of(current)
            if status is not None:
                return status, current, iteration
            if self._is_enough(current):
                self.note = "bounds narrow enough"
                return RawStatus.OPTIMAL, current, iteration
            stalled = 0 if merit < _PROGRESS * best_merit else stalled + 1
            if merit < best_merit:
                best, best_merit = current, merit
            if stalled >= _STALLED and best_merit < _NEAR_THE_END:
                self.note = "no further progress"
                return RawStatus.ALMOST, best, iteration
            try:
                following = self._advance(current)
            except np.linalg.LinAlgError:
                following = None
            if following is None:
                self.note = "breakdown"
                return RawStatus.ALMOST, best, iteration
            current = following
        return RawStatus.LIMIT, best, most

    def _is_enough(self, it: Iterate) -> bool:
        """Return True if the caller accepts an iterate; asked only at gaps up to `EARLY` and κ small against τ."""
        if self.suffices is None or it.kappa > SETTLED * it.tau:
            return False
        return it.relative_gap(self.q) <= EARLY and self.suffices(*self.answer(RawStatus.OPTIMAL, it))

    def answer(self, status: RawStatus, it: Iterate) -> tuple[Floats, Floats]:
        """Return point (columns,) and multipliers (rows,) of an iterate, or a ray by its status."""
        dual = np.concatenate([it.u, it.v])
        if status in (RawStatus.INFEASIBLE, RawStatus.NEARLY_INFEASIBLE):
            return it.x, dual / -(self.r @ it.u + self.h @ it.v)
        if status is RawStatus.UNBOUNDED:
            return it.x / -(self.q @ it.x), dual
        return it.x / it.tau, dual / it.tau

    def _start(self) -> Iterate:
        """Return the first iterate: least-squares points, shifted into the cones."""
        system, zeros = self.system, np.zeros(len(self.q))
        system.factor(NesterovTodd(self.cones, self.unit, self.unit))
        x, _, minus_s = system.solve(zeros, self.r, self.h)
        _, u, v = system.solve(-self.q, np.zeros(len(self.r)), np.zeros(len(self.h)))
        s = -minus_s
        for vector in (s, v):
            slack = self.cones.slack(vector)
            if slack < _START_SLACK:
                vector += (1.0 - slack) * self.unit
        return Iterate(x, u, s, v)

    def _status_of(self, it: Iterate) -> tuple[RawStatus | None, float]:
        # The status that an iterate proves, None for none, and its error, relative to the tolerances.
        system, q, r, h = self.system, self.q, self.r, self.h
        gradient = system.transposed(it.u, it.v)
        residual_u, yield_slack = system.equations(it.x), system.yields(it.x) + it.s
        cost, value = float(q @ it.x), float(r @ it.u + h @ it.v)
        primal = max(_largest(residual_u - it.tau * r), _largest(yield_slack - it.tau * h)) / it.tau
        dual = _largest(gradient + it.tau * q) / it.tau
        merit = max(primal / self.tolerance, dual / self.tolerance, it.relative_gap(self.q) / self.gap)
        if merit <= 1.0:
            return RawStatus.OPTIMAL, merit
        if it.kappa > it.tau:
            ray = _RAY * self.tolerance
            if value < 0.0 and _largest(gradient) <= ray * -value:
                return RawStatus.INFEASIBLE, merit
            if cost < 0.0 and max(_largest(residual_u), _largest(yield_slack)) <= ray * -cost:
                return RawStatus.UNBOUNDED, merit
            if value < 0.0 and it.tau < _VANISHED * it.kappa:
                return RawStatus.NEARLY_INFEASIBLE, merit
        return None, merit

    def _advance(self, it: Iterate) -> Iterate | None:
        """Take one predictor–corrector step; None if no step is possible."""
        cones = self.cones
        newton = Newton(self.system, (self.q, self.r, self.h), it)
        direction = newton.corrected_direction()
        alpha, beta = newton.step_lengths(direction, _INSIDE)
        if not (np.isfinite([alpha, beta]).all() and min(alpha, beta) > _NO_STEP and np.isfinite(direction.x).all()):
            return None
        s, v = it.s + alpha * newton.scaling.times(direction.ws), it.v + beta * newton.scaling.divide(direction.wv)
        if cones.slack(s) <= 0.0 or cones.slack(v) <= 0.0:
            return None
        # τ may become zero at breakdown; numpy's float then gives inf or nan where Python's float would raise.
        tau, kappa = np.float64(it.tau + alpha * direction.tau), np.float64(it.kappa + alpha * direction.kappa)
        x, u, scale = it.x + alpha * direction.x, it.u + beta * direction.u, 1.0 / max(tau, kappa)
        return Iterate(x * scale, u * scale, s * scale, v * scale, tau * scale, kappa * scale)


def _largest(vector: Floats) -> float:
    return float(abs(vector).max(initial=0.0))
