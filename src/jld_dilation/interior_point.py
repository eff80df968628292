"""Interior-point method for programs over products of forces and velocities, whose answers a certificate checks.

Mehrotra's predictor and corrector with more correctors (Gondzio 1996). Equations are regularised as by proximal
multipliers (Friedlander & Orban 2012).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sp
from scipy.linalg import blas, lapack

from jld_core import Bools, Floats, Ints
from jld_dilation.product_space import Point, ProductSpace

Solve = Callable[[Point, float, int], Point]
"""Function from right-hand side, relative residual and maximum number of corrections to a solution."""

_MORE: Final = 10.0  # factor by which the shift grows, permanently, where a factorisation fails

_TRIES: Final = 8  # maximum number of factorisations with growing shift

_FLAT: Final = 1e-30  # relative curvature that counts as zero

_AWAY: Final = 1e3  # ratio of the residual to the least residual so far at which corrections have diverged


class NormalEquations:
    """Normal equations Σ d_kl (y_k z_l)(y_k z_l)ᵀ + d (b_λ·u)(b_λ·u)ᵀ + shift of an interior-point step over (Z, T)."""

    def __init__(self, space: ProductSpace, used: Bools, groups: Ints) -> None:
        """Prepare elimination order and tables of a space."""
        # used: (r, forms) weights that may be positive; slides of lone faces have their own slacks and 1 only. groups:
        # (w,) group in which each velocity is eliminated.
        self.space = space
        slides = np.concatenate([4 * space.lone + 2, 4 * space.lone + 3])
        modes = np.flatnonzero(used.any(axis=0))
        self._modes = modes[~np.isin(modes, slides)]
        self._rows_of_mode = [np.flatnonzero(used[:, mode]) for mode in self._modes]
        # The two slides of a lone face act as one, along s.
        forms = np.vstack([space.rates[self._modes], space.rates[4 * space.lone + 3]])
        self._tree = _EliminationTree(forms, groups, space.of, np.array([basis.shape[1] for basis in space.bases]))
        self._facts = [space.facts @ basis for basis in space.bases]
        self._shift = 0.0

    def factor(self, weights: Floats, live: float, shift: float, plain: bool = False) -> Solve:
        """Factor for weights (r, forms) ≥ 0, and return the solver; plain: no conjugate directions.

        The solver takes (Z, T), residual to reach and most corrections, and returns the point of least residual. Raises
        LinAlgError.
        """
        once = self._once(weights, live, shift)
        space = self.space

        def applied(x: Point) -> Point:
            """Return the product of the unshifted matrix with a point (Z, T), see `ProductSpace`."""
            z, t = space.adjoint(weights * space.values(x))
            return z + live * float((space.unit * x[0]).sum()) * space.unit, t

        def solve(rhs: Point, exact: float, most: int) -> Point:
            """Correct by conjugate gradients, preconditioned by the factor; plain: by iterative refinement."""
            x = direction = old_residual = (np.zeros_like(rhs[0]), np.zeros_like(rhs[1]))
            residual, goal = rhs, exact * length(rhs)
            old_product = 1.0
            best, least = x, length(rhs)
            for turn in range(most + 1):
                solved = once(residual)
                product = _dot(solved, residual)
                share = (product - _dot(solved, old_residual)) / old_product if turn and not plain else 0.0
                direction = _add(solved, share, direction)
                image = applied(direction)
                curvature = _dot(direction, image)
                if not plain and not (product > 0.0 and curvature > _FLAT * _dot(direction, direction)):
                    break  # The residual is rounding.
                step = 1.0 if plain else _dot(direction, residual) / curvature
                x = _add(x, step, direction)
                old_residual, old_product = residual, product
                residual = _add(residual, -step, image)
                size = length(residual)
                if size < least or turn == 0:
                    best, least = x, size
                if size <= goal or not size < _AWAY * least:
                    break
            return best

        return solve

    def _once(self, weights: Floats, live: float, shift: float) -> Callable[[Point], Point]:
        """Factor the shifted matrix, and return a function that solves without refinement."""
        space, shift = self.space, max(shift, self._shift)
        # T couples to Z only through the slip of its own lone face, so its (f, 4, 4) diagonal blocks `both` are
        # eliminated first; `half` is what the two slides add to Z after that.
        slides = space.ones * (4 * space.lone)
        first, second = (weights[space.rows, slides + slide].T[:, :, None] for slide in (2, 3))
        across = np.swapaxes(space.own, 1, 2)
        stays, slips = across @ (first * space.own), across @ (second * space.own)
        both = stays + slips + shift * np.eye(4)
        back = np.linalg.inv(both) if len(both) else both
        half = slips @ back @ (stays + shift * np.eye(4))  # Equals slips − slips back slips, without cancellation.
        tables = self._tables(weights, 0.5 * (half + np.swapaxes(half, 1, 2)))
        for _ in range(_TRIES):
            factored = self._tree.factor(tables, shift)
            if factored is not None:
                break
            shift = self._shift = _MORE * shift
        else:
            raise np.linalg.LinAlgError("normal equations of products are not positive definite")
        solved = factored
        # The live work is a matrix of rank one: Sherman and Morrison.
        forms = space.rates[4 * space.lone + 3]
        unit = space.unit
        along = solved(unit)
        price = live / (1.0 + live * float((unit * along).sum()))

        def solve(rhs: Point) -> Point:
            """Solve the shifted equations once, without refinement, for a right-hand side (Z, T)."""
            t = np.einsum("fab,fb->fa", back, rhs[1])
            pulled = np.zeros((space.facts.shape[1], len(space.of)))
            for rows_of_face, part, form in zip(space.at, np.einsum("fab,fb->fa", slips, t), forms, strict=True):
                pulled[rows_of_face] += np.outer(part, form)
            z = solved(rhs[0] - space.gather(pulled))
            z = z - price * float((unit * z).sum()) * along
            slips_of_z = np.einsum("fpw,fw->fp", space.expand(z)[space.at], forms)
            return z, t - np.einsum("fab,fb->fa", back, np.einsum("fab,fb->fa", slips, slips_of_z))

        return solve

    def _tables(self, weights: Floats, lone_blocks: Floats) -> dict[tuple[int, int], Floats]:
        """Compute the blocks Cᵀ diag(d_l) C of each form, (forms, k, k′); C: facts over a basis, d_l: weights."""
        space, blocks = self.space, {}
        for (first, second), forms in self._tree.couplings.items():
            table = np.empty((len(forms), space.bases[first].shape[1], space.bases[second].shape[1]))
            for n, form in enumerate(forms):
                if form < len(self._modes):
                    rows = self._rows_of_mode[form]
                    by = weights[rows, self._modes[form]][:, None]
                    table[n] = self._facts[first][rows].T @ (by * self._facts[second][rows])
                else:  # the slide of a face alone: its block (4, 4) acts on N, V, M and 1
                    face = form - len(self._modes)
                    rows_of_face = space.at[face]
                    table[n] = (
                        space.bases[first][rows_of_face].T @ lone_blocks[face] @ space.bases[second][rows_of_face]
                    )
            blocks[first, second] = table
        return blocks


def length(point: Point) -> float:
    """Return the Euclidean norm of a point (Z, T), see `ProductSpace`, taken as one vector."""
    return float(np.hypot(np.linalg.norm(point[0]), np.linalg.norm(point[1])))


def _add(point: Point, share: float, other: Point) -> Point:
    return point[0] + share * other[0], point[1] + share * other[1]


def _dot(first: Point, second: Point) -> float:
    """Return the scalar product of two points (Z, T), see `ProductSpace`."""
    return float((first[0] * second[0]).sum() + (first[1] * second[1]).sum())


class _EliminationTree:
    """Elimination tree of matrix blocks, for a multifrontal Cholesky factor; a form couples its columns."""

    def __init__(self, forms: Floats, groups: Ints, of: Ints, sizes: Ints) -> None:
        """Compute elimination order and fronts from forms (modes, w), groups (w,) and bases `of` (w,)."""
        touches = np.zeros((len(forms), int(groups.max(initial=-1)) + 1))
        np.maximum.at(touches.T, groups, (forms != 0.0).T.astype(float))
        order, later = _minimum_degree_order((touches.T @ touches) > 0.0)
        position = np.empty(len(order), dtype=np.int64)
        position[order] = np.arange(len(order))
        # Groups eliminated in one front, and the later groups that it couples, by place in the order. Chains without
        # additional fill are merged.
        reach = [sorted(int(position[k]) for k in later[int(j)]) for j in order]
        eliminated: list[list[int]] = []
        coupled: list[list[int]] = []
        front_of = []
        for j in range(len(order)):
            if coupled and coupled[-1] and coupled[-1][0] == j and len(coupled[-1]) == len(reach[j]) + 1:
                eliminated[-1].append(j)
                coupled[-1] = reach[j]
            else:
                eliminated.append([j])
                coupled.append(reach[j])
            front_of.append(len(eliminated) - 1)
        self._parent = [front_of[later_groups[0]] if later_groups else -1 for later_groups in coupled]
        columns_of = [np.flatnonzero(groups == j) for j in order]
        order = self._order = np.concatenate([*columns_of, np.zeros(0, dtype=np.int64)]).astype(np.int64)
        ends = np.cumsum([0] + [len(columns) for columns in columns_of])

        def columns_in(positions: list[int]) -> list[int]:
            return [k for j in positions for k in range(ends[j], ends[j + 1])]

        self._nodes = [
            (columns_in(of_front), columns_in(of_later)) for of_front, of_later in zip(eliminated, coupled, strict=True)
        ]
        self._of, self._sizes = of[order], sizes[of[order]]
        self._starts = np.concatenate([[0], np.cumsum(self._sizes)]).astype(np.int64)
        self._ends = [
            _FrontPositions(columns, later_columns, self._sizes, self._starts) for columns, later_columns in self._nodes
        ]
        self.couplings, self._blocks_of_fronts = self._couplings(forms[:, order])

    def _couplings(self, forms: Floats) -> tuple[dict[tuple[int, int], list[int]], list[list[_FrontBlock]]]:
        """List the forms that couple each pair of bases, and the blocks of each front."""
        # a block of the matrix is a sum of tables, one for each form that couples both columns, times these shares
        shares_of_fronts: list[dict[tuple[int, int], dict[tuple[int, int], dict[int, float]]]] = []
        forms_of: dict[tuple[int, int], dict[int, int]] = {}
        for columns, later_columns in self._nodes:
            rows = columns + later_columns
            shares_of: dict[tuple[int, int], dict[tuple[int, int], dict[int, float]]] = {}
            for a, j in enumerate(columns):
                for b in range(a, len(rows)):
                    common = np.flatnonzero((forms[:, j] != 0.0) & (forms[:, rows[b]] != 0.0))
                    if len(common):
                        key = int(self._of[rows[b]]), int(self._of[j])
                        number = forms_of.setdefault(key, {})
                        shares = {
                            number.setdefault(int(form), len(number)): forms[form, j] * forms[form, rows[b]]
                            for form in common
                        }
                        shares_of.setdefault(key, {})[b, a] = shares
            shares_of_fronts.append(shares_of)
        blocks_of_fronts = []
        for shares_of in shares_of_fronts:
            blocks_in_front: list[_FrontBlock] = []
            for key, blocks in shares_of.items():
                row = [n for n, shares in enumerate(blocks.values()) for _ in shares]
                form = [k for shares in blocks.values() for k in shares]
                share = [value for shares in blocks.values() for value in shares.values()]
                blocks_in_front.append(
                    (key, list(blocks), sp.csr_array((share, (row, form)), shape=(len(blocks), len(forms_of[key]))))
                )
            blocks_of_fronts.append(blocks_in_front)
        return {key: list(number) for key, number in forms_of.items()}, blocks_of_fronts

    def factor(self, tables: dict[tuple[int, int], Floats], shift: float) -> Callable[[Floats], Floats] | None:
        """Factor tables (forms, k, k′) + shift, and return the solver of (k, w); None if not positive definite."""
        flat = {key: table.reshape(len(table), -1) for key, table in tables.items()}
        updates: list[list[tuple[list[int], Floats, Ints]]] = [[] for _ in self._nodes]
        factors = []
        for node, ((columns, later), ends) in enumerate(zip(self._nodes, self._ends, strict=True)):
            pivots, start = ends.first, ends.at  # number of pivots, and first row of each block
            front = np.zeros((start[-1], start[-1]), order="F")
            for key, pairs, shares in self._blocks_of_fronts[node]:
                blocks = (shares @ flat[key]).reshape(len(pairs), *tables[key].shape[1:])
                for (b, a), block in zip(pairs, blocks, strict=True):
                    front[start[b] : start[b + 1], start[a] : start[a + 1]] = block
            front[np.arange(pivots), np.arange(pivots)] += shift
            # add the Schur complements of the fronts below
            position = {row: n for n, row in enumerate(columns + later)}
            for rows, update, update_start in updates[node]:
                _extend_add(front, update, [position[row] for row in rows], start, update_start)
            updates[node] = []
            lower, failed = lapack.dpotrf(front[:pivots, :pivots], lower=1)
            if failed:
                return None
            below = np.zeros((0, pivots))
            if later:
                below = blas.dtrsm(1.0, lower, front[pivots:, :pivots], side=1, lower=1, trans_a=1)
                update = blas.dsyrk(-1.0, below, beta=1.0, c=front[pivots:, pivots:], lower=1)
                updates[self._parent[node]].append((later, update, start[len(columns) :] - pivots))
            factors.append((lower, below))
        return lambda rhs: self._solve(factors, rhs)

    def _solve(self, factors: list[tuple[Floats, Floats]], rhs: Floats) -> Floats:
        """Solve for a right-hand side (k, w) by forward and backward substitution."""
        rows = np.arange(len(rhs))
        used = rows[None, :] < self._sizes[:, None]
        x = rhs.T[self._order][used]
        for ends, (lower, below) in zip(self._ends, factors, strict=True):
            part = x[ends.own] = blas.dtrsv(lower, x[ends.own], lower=1)
            if len(below):
                x[ends.rest] -= below @ part
        for ends, (lower, below) in zip(reversed(self._ends), reversed(factors), strict=True):
            part = x[ends.own]
            if len(below):
                part = part - below.T @ x[ends.rest]
            x[ends.own] = blas.dtrsv(lower, part, lower=1, trans=1)
        unknowns = np.zeros(used.shape)
        unknowns[used] = x
        solution = np.empty_like(rhs)
        solution[:, self._order] = unknowns.T
        return solution


# Pair of bases, (row, column) of the matrix blocks of a front, and the tables each is the sum of, (blocks, forms)
_FrontBlock = tuple[tuple[int, int], list[tuple[int, int]], Any]


class _FrontPositions:
    """Index arrays of one front: own, rest: positions eliminated here, and of others; first: their number."""

    def __init__(self, columns: list[int], later: list[int], sizes: Ints, starts: Ints) -> None:
        self.at = np.concatenate([[0], np.cumsum(sizes[columns + later])]).astype(np.int64)
        self.first = int(self.at[len(columns)])
        self.own = np.concatenate([np.arange(starts[j], starts[j + 1]) for j in columns])
        self.rest = np.concatenate([np.zeros(0, dtype=np.int64), *(np.arange(starts[j], starts[j + 1]) for j in later)])


def _extend_add(front: Floats, update: Floats, positions: list[int], at: Ints, its: Ints) -> None:
    """Add an update matrix to a front, in the lower half of both (extend-add), by rows `at`, `its` of blocks."""
    # Runs of rows that are contiguous in both are added at once.
    runs: list[tuple[int, int, int]] = []
    for n, position in enumerate(positions):
        if runs and runs[-1][1] + runs[-1][2] == position:
            runs[-1] = (runs[-1][0], runs[-1][1], runs[-1][2] + 1)
        else:
            runs.append((n, position, 1))
    for k, (n, position, count) in enumerate(runs):
        for n2, position2, count2 in runs[: k + 1]:
            front[at[position] : at[position + count], at[position2] : at[position2 + count2]] += update[
                its[n] : its[n + count], its[n2] : its[n2 + count2]
            ]


def _minimum_degree_order(meets: Bools) -> tuple[Ints, list[list[int]]]:
    """Return a minimum-degree order of a graph (w, w), and the neighbours eliminated later."""
    width = len(meets)
    neighbours = [set(np.flatnonzero(meets[j]).tolist()) - {j} for j in range(width)]
    remaining = list(range(width))
    order: list[int] = []
    later: Any = [[] for _ in range(width)]
    while remaining:
        # Among columns of equal degree prefer neighbours of the last one, so that columns of one element stay together.
        last = neighbours[order[-1]] if order else set()
        j = min(remaining, key=lambda k: (len(neighbours[k]), k not in last, k))
        remaining.remove(j)
        order.append(j)
        later[j] = sorted(neighbours[j])
        for k in neighbours[j]:
            neighbours[k] |= neighbours[j]
            neighbours[k] -= {k, j}
    return np.array(order, dtype=np.int64), later


_STEPS: Final = 120  # maximum number of steps

_FIRST: Final = 0.1  # initial slacks and multipliers; with 0.01 or 1, walls take half as many steps again

_EQUAL: Final = 1e-6  # regularisation of equations: residual per unit change of the multiplier

_POSITIVE: Final = 1e-8  # regularisation of inequalities: residual per unit change of the multiplier

_SHIFT: Final = 1e-9  # shift of the diagonal of the normal equations

_REFINED: Final = 3  # maximum number of corrections of a solution by the same factor

_EXACT: Final = (1e-7, 1e-12)  # relative residual at which such corrections end: far from the optimum, and near to it

_CORRECTORS: Final = 2  # maximum number of additional correctors per step

_BACK: Final = 0.995  # fraction of the distance to the boundary that a step takes

_CENTRE: Final = 0.5  # lower limit of the centring target, as a fraction of the tolerance

_SURE: Final = 5.0  # multiple of the tolerance up to which an answer counts as accurate

# Default tolerance of residuals and complementarity. Multipliers nearer to zero are hard to make exact.
_DONE: Final = 2e-7

_IDLE: Final = 3  # number of consecutive steps without improvement at which the method ends, once `_NEAR` is reached

_NEAR: Final = 1e-3  # error from which `_IDLE` applies as it is; before, ten times as many steps are allowed

# Multiple of `_IDLE` that replaces ten if the tolerance is `_ROUGH` or larger: further steps then gain nothing
_HASTY: Final = 2

_ROUGH: Final = 1e-2  # tolerance from which `_HASTY` and `_OPEN` apply

_STATED: Final = 100.0  # weight of the dual residual in the error, for tolerances of `_LITTLE` or more

# Tolerance from which `_STATED` applies: the bound may be low, but its multipliers must be easy to make exact
_LITTLE: Final = 1e-3

# Weight of complementarity in the error, for tolerances of `_ROUGH` or more: a bound does not require it
_OPEN: Final = 0.01

_GAINS: Final = 0.9  # factor by which the error must decrease to count as an improvement


@dataclass(frozen=True)
class ProductProgram:
    """Program min cost·(Z, T) + (1 − b_λ·u)⁺; masked products y_k z_l are zero, or not negative."""

    space: ProductSpace  # map from the unknowns (Z, T) to the products (r, forms)
    # equal, positive: (r, forms) products that are zero, and products that are not negative
    equal: Bools
    positive: Bools
    cost: Point  # (Z, T) coefficients of the objective, in the shape of a point
    groups: Ints  # (w,) number of the group in which each velocity is eliminated


@dataclass(frozen=True)
class ProductSolution:
    """Result of the interior-point method for one program over products."""

    point: Point  # (Z, T) best point found
    multipliers: Floats  # (r, forms) multipliers of the products, ≥ 0 for positive ones, 0 for those not in the program
    bound: float  # multiplier of b_λ·u = 1, at most 1
    error: float  # largest one of residuals and complementarity, all of order one
    steps: int  # number of steps taken
    accurate: bool  # True if `error` is near the tolerance


def minimise_product_program(
    program: ProductProgram, seconds: float = np.inf, tolerance: float | None = None
) -> ProductSolution | None:
    """Minimise a program over products: the best iterate, or None if a factorisation fails."""
    try:
        return _InteriorPointMethod(program, _DONE if tolerance is None else tolerance).run(seconds)
    except np.linalg.LinAlgError:
        return None


class _InteriorPointMethod:
    """State of the interior-point iterations for one program over products."""

    def __init__(self, program: ProductProgram, tolerance: float) -> None:
        self.tolerance = tolerance
        self.space = space = program.space
        self.shape = program.equal.shape
        self.k, self.l = np.nonzero(program.positive)
        self.ke, self.le = np.nonzero(program.equal)
        self.normal = NormalEquations(space, program.equal | program.positive, program.groups)
        unit = space.unit
        self.cost = (program.cost[0] - unit, program.cost[1])
        self.x: Point = (np.zeros_like(program.cost[0]), np.zeros_like(program.cost[1]))
        # Slacks of the rows; the last one is 1 − b_λ·u.
        self.s, self.v = np.full((2, len(self.k) + 1), _FIRST)
        self.q = np.zeros(len(self.ke))

    def rows(self, x: Point) -> tuple[Floats, Floats]:
        """Return the rows at a point (Z, T): positive ones, the last −b_λ·u, then zero ones."""
        table = self.space.values(x)
        last = -float((self.space.unit * x[0]).sum())
        return np.append(table[self.k, self.l], last), table[self.ke, self.le]

    def apply_transpose(self, v: Floats, q: Floats) -> Point:
        """Return the rows weighted by v and q, as a form of (Z, T): the transpose of `rows`."""
        table = np.zeros(self.shape)
        table[self.k, self.l] = v[:-1]
        table[self.ke, self.le] = q
        z, t = self.space.adjoint(table)
        return z - v[-1] * self.space.unit, t

    def run(self, seconds: float) -> ProductSolution:
        """Take steps until the tolerance is met or progress ends; return the best iterate."""
        end, best, idle = time.process_time() + seconds, None, 0
        for step in range(_STEPS):
            g, e = self.rows(self.x)
            g[-1] += 1.0
            rp, re = self.s - g, -e
            pulled = self.apply_transpose(self.v, self.q)
            rd = (self.cost[0] - pulled[0], self.cost[1] - pulled[1])
            work = float(self.s @ self.v)
            stated = (_STATED if self.tolerance >= _LITTLE else 1.0) * _largest(rd)
            open_ = (_OPEN if self.tolerance >= _ROUGH else 1.0) * work
            error = max(open_, float(abs(rp).max()), float(abs(re).max(initial=0.0)), stated)
            if best is None or error < _GAINS * best.error:
                best, idle = self._answer(error, step), 0
            else:
                idle += 1
            patience = 1 if best.error <= _NEAR else 10 if self.tolerance < _ROUGH else _HASTY
            if error < self.tolerance or idle >= patience * _IDLE or time.process_time() > end:
                break
            self._step(rp, re, rd, work / len(self.s), _EXACT[error < _NEAR])
        assert best is not None
        return best

    def _answer(self, error: float, step: int) -> ProductSolution:
        """Return the current iterate as a solution with a given error and number of steps."""
        table = np.zeros(self.shape)
        table[self.k, self.l] = self.v[:-1]
        table[self.ke, self.le] = self.q
        return ProductSolution(self.x, table, 1.0 - float(self.v[-1]), error, step, error <= _SURE * self.tolerance)

    def _step(self, rp: Floats, re: Floats, rd: Point, mu: float, tolerance: float) -> None:
        """Take one predictor-corrector step from residuals of positive rows, zero rows and dual equations."""
        d = 1.0 / (self.s / self.v + _POSITIVE)
        weights = np.zeros(self.shape)
        weights[self.k, self.l] = d[:-1]
        weights[self.ke, self.le] = 1.0 / _EQUAL
        solve = self.normal.factor(weights, float(d[-1]), _SHIFT, plain=True)

        def direction(rc: Floats, times: int = _REFINED) -> tuple[Point, Floats, Floats, Floats]:
            """Return the changes of point, slacks, and both kinds of multipliers in one direction."""
            z, t = self.apply_transpose(d * (rp + rc / self.v), re / _EQUAL)
            dx = solve((z - rd[0], t - rd[1]), tolerance, times)
            g, e = self.rows(dx)
            dv = d * (rp + rc / self.v - g)
            return dx, (rc - self.s * dv) / self.v, dv, (re - e) / _EQUAL

        rc = -self.s * self.v
        _, ds, dv, _ = direction(rc, 0)
        a, b = _step_length(self.s, ds), _step_length(self.v, dv)
        after = float((self.s + a * ds) @ (self.v + b * dv)) / len(self.s)
        centre = max(min((after / mu) ** 3, 1.0) * mu, _CENTRE * self.tolerance / len(self.s))
        rc = centre - self.s * self.v - ds * dv
        dx, ds, dv, dq = direction(rc)
        a, b = _step_length(self.s, ds), _step_length(self.v, dv)
        for _ in range(_CORRECTORS):
            if min(a, b) > 0.9:
                break
            to_a, to_b = min(a + 0.1 + 0.08 * a, 1.0), min(b + 0.1 + 0.08 * b, 1.0)
            product = (self.s + to_a * ds) * (self.v + to_b * dv)
            rc2 = rc + np.maximum(np.clip(product, 0.1 * centre, 10.0 * centre) - product, -10.0 * centre)
            dx2, ds2, dv2, dq2 = direction(rc2)
            a2, b2 = _step_length(self.s, ds2), _step_length(self.v, dv2)
            if a2 + b2 < a + b + 0.02:
                break
            rc, dx, ds, dv, dq, a, b = rc2, dx2, ds2, dv2, dq2, a2, b2
        a, b = min(_BACK * a, 1.0), min(_BACK * b, 1.0)
        self.x = (self.x[0] + a * dx[0], self.x[1] + a * dx[1])
        self.s, self.v, self.q = self.s + a * ds, self.v + b * dv, self.q + b * dq


def _step_length(at: Floats, step: Floats) -> float:
    """Return the largest fraction of a step, at most 1 / _BACK, that keeps a vector ≥ 0."""
    falls = step < 0.0
    return min(1.0 / _BACK, float((-at[falls] / step[falls]).min(initial=np.inf)))


def _largest(point: Point) -> float:
    """Return the largest absolute entry of a point (Z, T), see `ProductSpace`."""
    return max(float(abs(point[0]).max(initial=0.0)), float(abs(point[1]).max(initial=0.0)))
