"""Normal equations over products of forces and velocities: the one system that bounds without dilation are made by.

Rows c_k ⊗ h_l over X = S Z, one for every slack times every mode, with weights d_kl give
Σ_l (Cᵀ diag(d_l) C) ⊗ h_l h_lᵀ: blocks as large as the forces are free, one for every two velocities that some mode has
in common, so that a factor of blocks along the graph of velocities takes a small part of what one of single numbers
does (multifrontal Cholesky; Duff & Reid 1983).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sp
from scipy.linalg import blas, lapack

from jld_core.arrays import Bools, Floats, Ints

Point = tuple[Floats, Floats]
"""(Z, T): coefficients of the states by velocities (k, w), and own products of slides of lone faces (f, 4)."""

Solve = Callable[[Point, float, int], Point]
"""(right-hand side, share of it that may be left, corrections at the most) → solution."""

_MORE: Final = 10.0  # by which the shift grows where a factor fails, for good
_TRIES: Final = 8
_FLAT: Final = 1e-30  # curvature, relative, that is none
_AWAY: Final = 1e3  # times the least that was left, at which corrections have gone astray


@dataclass(frozen=True)
class ProductSpace:
    """Forms y_k z_l over (Z, T).

    facts: (r, k) slacks and the like over free states, the last of them 1. rates: (modes, w) over free velocities.
    lone: (f,) faces whose two slides, modes 4f + 2 and 4f + 3, are t and t + s with t of their own: T holds the
    products of t with the face's own forces and 1, of which `own` (f, 5, 4) makes its slacks and 1, and `states`
    (f, 4, k) says what they are over free states. live: (w,) b_λ·u.
    """

    facts: Floats
    rates: Floats
    lone: Ints
    own: Floats
    states: Floats
    live: Floats

    def values(self, point: Point) -> Floats:
        """(r, modes) y_k z_l; of slides of lone faces those with their own slacks and 1 alone mean something."""
        z, t = point
        out = np.asarray(self.facts @ z @ self.rates.T)
        more = np.einsum("frc,fc->rf", self.own, t)
        rows, one = self._rows
        for slide in (2, 3):
            out[rows, one * (4 * self.lone + slide)] += more
        return out

    def adjoint(self, table: Floats) -> Point:
        """What a weighted sum of values (r, modes) is over (Z, T)."""
        rows, one = self._rows
        both = table[rows, one * (4 * self.lone + 2)] + table[rows, one * (4 * self.lone + 3)]
        return self.facts.T @ table @ self.rates, np.einsum("frc,rf->fc", self.own, both)

    @property
    def unit(self) -> Floats:
        """(k, w) b_λ·u over Z."""
        return np.outer(self.facts[-1], self.live)

    @property
    def _rows(self) -> tuple[Ints, Ints]:
        """(5, f) rows of the own slacks of lone faces and of 1, and ones."""
        rows = np.vstack([4 * self.lone + k for k in range(4)] + [np.full(len(self.lone), len(self.facts) - 1)])
        return rows, np.ones((5, 1), dtype=np.int64)


class NormalEquations:
    """Σ d_kl (y_k z_l)(y_k z_l)ᵀ + d (b_λ·u)(b_λ·u)ᵀ + shift over one space, factored again and again."""

    def __init__(self, space: ProductSpace, used: Bools, groups: Ints) -> None:
        """groups: (w,) velocities that are eliminated together. used: (r, modes) where weights may stand, of slides of
        lone faces on own slacks and 1 alone."""
        self.space = space
        slides = np.concatenate([4 * space.lone + 2, 4 * space.lone + 3])
        modes = np.flatnonzero(used.any(axis=0))
        self._modes = modes[~np.isin(modes, slides)]
        self._of = [np.flatnonzero(used[:, mode]) for mode in self._modes]
        # of a lone face the two slides act as one, along s
        ways = np.vstack([space.rates[self._modes], space.rates[4 * space.lone + 3]])
        self._tree = _Tree(ways, groups)
        self._shift = 0.0

    def factor(self, weights: Floats, live: float, shift: float, plain: bool = False) -> Solve:
        """(right-hand side, what may be left of it, corrections) → solution. weights: (r, modes) ≥ 0.

        The shift, and what rounding adds, is taken back by conjugate gradients with the factor as preconditioner, or
        by plain corrections, which leave alone what the equations hardly see.
        """
        once = self._once(weights, live, shift)
        space = self.space

        def applied(x: Point) -> Point:
            z, t = space.adjoint(weights * space.values(x))
            return z + live * float((space.unit * x[0]).sum()) * space.unit, t

        def solve(rhs: Point, exact: float, most: int) -> Point:
            x = way = old = (np.zeros_like(rhs[0]), np.zeros_like(rhs[1]))
            rest, goal = rhs, exact * length(rhs)
            product = 1.0
            best, least = x, length(rhs)
            for turn in range(most + 1):
                near = once(rest)
                after = _dot(near, rest)
                share = (after - _dot(near, old)) / product if turn and not plain else 0.0
                way = (near[0] + share * way[0], near[1] + share * way[1])
                pushed = applied(way)
                bent = _dot(way, pushed)
                if not plain and not (after > 0.0 and bent > _FLAT * _dot(way, way)):
                    break  # what is left is rounding
                step = 1.0 if plain else _dot(way, rest) / bent
                x = (x[0] + step * way[0], x[1] + step * way[1])
                old, product = rest, after
                rest = (rest[0] - step * pushed[0], rest[1] - step * pushed[1])
                left = length(rest)
                if left < least or turn == 0:
                    best, least = x, left
                if left <= goal or not left < _AWAY * least:
                    break
            return best

        return solve

    def _once(self, weights: Floats, live: float, shift: float) -> Callable[[Point], Point]:
        """Right-hand side → solution of what is shifted, as exact as it comes."""
        space = self.space
        size, shift = space.facts.shape[1], max(shift, self._shift)
        tables = np.empty((len(self._modes) + len(space.lone), size, size))
        for n, (mode, rows) in enumerate(zip(self._modes, self._of, strict=True)):
            part = space.facts[rows]
            tables[n] = part.T @ (weights[rows, mode][:, None] * part)
        rows, one = space._rows
        first, second = (weights[rows, one * (4 * space.lone + slide)].T[:, :, None] for slide in (2, 3))
        across = np.swapaxes(space.own, 1, 2)
        stays, slips = across @ (first * space.own), across @ (second * space.own)
        both = stays + slips + shift * np.eye(4)
        back = np.linalg.inv(both) if len(both) else both
        half = slips @ back @ (stays + shift * np.eye(4))  # slips − slips back slips, without its cancellation
        tables[len(self._modes) :] = np.swapaxes(space.states, 1, 2) @ (
            0.5 * (half + np.swapaxes(half, 1, 2)) @ space.states
        )
        for _ in range(_TRIES):
            held = self._tree.factor(tables, shift)
            if held is not None:
                break
            shift = self._shift = _MORE * shift
        else:
            raise np.linalg.LinAlgError("normal equations of products are not positive definite")
        solved = held
        ways = space.rates[4 * space.lone + 3]
        unit = space.unit
        along = solved(unit)
        price = live / (1.0 + live * float((unit * along).sum()))

        def solve(rhs: Point) -> Point:
            t = np.einsum("fab,fb->fa", back, rhs[1])
            pulled = np.einsum("fak,fa->fk", space.states, np.einsum("fab,fb->fa", slips, t))
            z = solved(rhs[0] - pulled.T @ ways)
            z = z - price * float((unit * z).sum()) * along
            own = np.einsum("fak,fk->fa", space.states, (z @ ways.T).T)
            return z, t - np.einsum("fab,fb->fa", back, np.einsum("fab,fb->fa", slips, own))

        return solve


def length(point: Point) -> float:
    """Of (Z, T) as one vector."""
    return float(np.hypot(np.linalg.norm(point[0]), np.linalg.norm(point[1])))


def _dot(one: Point, other: Point) -> float:
    return float((one[0] * other[0]).sum() + (one[1] * other[1]).sum())


class _Tree:
    """Elimination of blocks along the graph in which columns of ways (modes, w) meet where a mode has both."""

    def __init__(self, ways: Floats, groups: Ints) -> None:
        """groups: (w,) columns that are taken together, counted from 0."""
        touches = np.zeros((len(ways), int(groups.max(initial=-1)) + 1))
        np.maximum.at(touches.T, groups, (ways != 0.0).T.astype(float))
        order, later = _least_fill((touches.T @ touches) > 0.0)
        place = np.empty(len(order), dtype=np.int64)
        place[order] = np.arange(len(order))
        # groups and what they reach, by place; chains in which nothing is lost become one
        reach = [sorted(int(place[k]) for k in later[int(j)]) for j in order]
        nodes: list[tuple[list[int], list[int]]] = []
        of = []
        for j in range(len(order)):
            last = nodes[-1] if nodes else None
            if last is not None and last[1] and last[1][0] == j and len(last[1]) == len(reach[j]) + 1:
                last[0].append(j)
                nodes[-1] = (last[0], reach[j])
            else:
                nodes.append(([j], reach[j]))
            of.append(len(nodes) - 1)
        self._parent = [of[rest[0]] if rest else -1 for _, rest in nodes]
        columns_of = [np.flatnonzero(groups == j) for j in order]
        order = self._order = np.concatenate([*columns_of, np.zeros(0, dtype=np.int64)]).astype(np.int64)
        ends = np.cumsum([0] + [len(columns) for columns in columns_of])
        self._nodes = [tuple([k for j in part for k in range(ends[j], ends[j + 1])] for part in node) for node in nodes]
        placed = ways[:, order]
        self._parts = []
        for columns, rest in self._nodes:
            rows = columns + rest
            pairs, modes, shares = [], [], []
            for a, j in enumerate(columns):
                for b in range(a, len(rows)):
                    here = np.flatnonzero((placed[:, j] != 0.0) & (placed[:, rows[b]] != 0.0))
                    pairs += [(b, a)] * len(here)
                    modes += here.tolist()
                    shares += (placed[here, j] * placed[here, rows[b]]).tolist()
            distinct = sorted(set(pairs))
            number = {pair: n for n, pair in enumerate(distinct)}
            at = [number[pair] for pair in pairs]
            table = sp.csr_array((shares, (at, modes)), shape=(len(distinct), len(ways)))
            self._parts.append((distinct, table))

    def factor(self, tables: Floats, shift: float) -> Callable[[Floats], Floats] | None:
        """tables: (modes, k, k) of the ways, symmetric. Right-hand side (k, w) → solution; None where it fails."""
        size, flat = tables.shape[1], tables.reshape(len(tables), -1)
        updates: list[list[tuple[list[int], Floats]]] = [[] for _ in self._nodes]
        out = []
        for node, (columns, rest) in enumerate(self._nodes):
            rows = columns + rest
            first = len(columns) * size
            front = np.zeros((len(rows) * size, len(rows) * size), order="F")
            pairs, shares = self._parts[node]
            blocks = (shares @ flat).reshape(len(pairs), size, size)
            for (b, a), block in zip(pairs, blocks, strict=True):
                front[b * size : (b + 1) * size, a * size : (a + 1) * size] = block
            front[np.arange(first), np.arange(first)] += shift
            at = {row: n for n, row in enumerate(rows)}
            for where, update in updates[node]:
                _add(front, update, [at[row] for row in where], size)
            updates[node] = []
            lower, failed = lapack.dpotrf(front[:first, :first], lower=1)
            if failed:
                return None
            below = np.zeros((0, first))
            if rest:
                below = blas.dtrsm(1.0, lower, front[first:, :first], side=1, lower=1, trans_a=1)
                update = blas.dsyrk(-1.0, below, beta=1.0, c=front[first:, first:], lower=1)
                updates[self._parent[node]].append((rest, update))
            out.append((lower, below))
        return lambda rhs: self._solve(out, rhs)

    def _solve(self, held: list[tuple[Floats, Floats]], rhs: Floats) -> Floats:
        size = len(rhs)
        x = np.ascontiguousarray(rhs[:, self._order].T)
        for (columns, rest), (lower, below) in zip(self._nodes, held, strict=True):
            part = blas.dtrsv(lower, x[columns].ravel(), lower=1)
            x[columns] = part.reshape(-1, size)
            if rest:
                x[rest] -= (below @ part).reshape(-1, size)
        for (columns, rest), (lower, below) in zip(reversed(self._nodes), reversed(held), strict=True):
            part = x[columns].ravel()
            if rest:
                part = part - below.T @ x[rest].ravel()
            x[columns] = blas.dtrsv(lower, part, lower=1, trans=1).reshape(-1, size)
        out = np.empty_like(rhs)
        out[:, self._order] = x.T
        return out


def _add(front: Floats, update: Floats, places: list[int], size: int) -> None:
    """Add the lower half of an update to a front, run by run of rows that stand together there too."""
    runs: list[tuple[int, int, int]] = []
    for n, place in enumerate(places):
        if runs and runs[-1][1] + runs[-1][2] == place:
            runs[-1] = (runs[-1][0], runs[-1][1], runs[-1][2] + 1)
        else:
            runs.append((n, place, 1))
    for k, (n, place, long) in enumerate(runs):
        for n2, place2, long2 in runs[: k + 1]:
            front[place * size : (place + long) * size, place2 * size : (place2 + long2) * size] += update[
                n * size : (n + long) * size, n2 * size : (n2 + long2) * size
            ]


def _least_fill(meets: Bools) -> tuple[Ints, list[list[int]]]:
    """An order of elimination that fills little, least degree first, and what each column meets later."""
    width = len(meets)
    left = [set(np.flatnonzero(meets[j]).tolist()) - {j} for j in range(width)]
    remaining = list(range(width))
    order: list[int] = []
    later: Any = [[] for _ in range(width)]
    while remaining:
        # ties go to who shares most with the last one, so that columns of one element follow one another
        last = left[order[-1]] if order else set()
        j = min(remaining, key=lambda k: (len(left[k]), k not in last, k))
        remaining.remove(j)
        order.append(j)
        later[j] = sorted(left[j])
        for k in left[j]:
            left[k] |= left[j]
            left[k] -= {k, j}
    return np.array(order, dtype=np.int64), later
