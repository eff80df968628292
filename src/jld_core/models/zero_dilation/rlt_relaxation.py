"""A lower bound on λ over all solutions without dilation: products of forces with velocities, as one linear program.

With Φ = (F, λ, 1) and w = (u, t), every solution gives a matrix X = Φ wᵀ, and what is known of Φ and w separately
multiplies to linear facts about X: equilibrium times every w is zero, y_k z_l ≥ 0 and = 0 for k = l, (λ − L) z ≥ 0,
b_λ·u = 1. The least λ b_λ·u over all X that obey them bounds λ from below (docs/method.md (4.7); reformulation and
linearisation of Sherali & Adams). Modes that cannot move take their w out of the program altogether.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bools, Floats, Ints
from jld_core.models.zero_dilation.modes import LinearModes, Modes
from jld_core.solvers import LinearAnswer, interior_point

_NOTHING: Final = 1e-11  # coefficients below this are rounding of an elimination
_MIXED: Final = 6  # modes, the largest, whose forces are read off X
_SEEN: Final = 1e-6  # z from which they are
_VIOLATED: Final = 1e-7  # product below zero by more than this asks for its row


@dataclass(frozen=True)
class Multipliers:
    """Of the rows of the program: what proves its bound.

    over: (4m + 3, 4m + 2e) of (y, λ − L, U − λ, 1) times forms of w, ≥ 0 but for y_l z_l and held rows. live: (4m + 2,)
    of (y, λ − L, U − λ) times b_λ·u, ≥ 0 but for held rows. bound: scaled.
    """

    over: Floats
    live: Floats
    bound: float


@dataclass(frozen=True)
class RltSolution:
    """What came out: multipliers, and from X the forces it mixes (k, 3m + 1) with λ, z and y on the mean (4m,), and the
    rows left out that it violates (4m, 4m + 2e). sure: the solver calls it optimal; else its multipliers are worth a
    try."""

    multipliers: Multipliers
    states: Floats
    rates: Floats
    slacks: Floats
    violated: Bools
    sure: bool


@dataclass(frozen=True)
class Region:
    """Where solutions are sought: low ≤ λ ≤ high, closed modes (4m,) with z = 0, held ones with y = 0."""

    low: float
    high: float
    closed: Bools
    held: Bools

    def halves(self, rates: Floats, slacks: Floats) -> tuple[Region, Region] | None:
        """Both sides of the mode that disagrees most with itself, which on the mean moves and has slack: it is still,
        or has none. None where all agree. rates, slacks: z and y on the mean (4m,).

        A slide that moves keeps the other one of its face still.
        """
        apart = np.where(self.closed | self.held, 0.0, np.minimum(rates, 1.0) * slacks)
        if not apart.max() > 0.0:
            return None
        mode = int(np.argmax(apart))
        number = np.arange(len(apart))
        one = number == mode
        other = (number == mode ^ 1) & (mode % 4 > 1)
        return replace(self, closed=self.closed | one), replace(self, closed=self.closed | other, held=self.held | one)


def without(rows: Floats) -> Floats:
    """(n, k) basis of what rows (r, n) leave free, sparse where they are: by elimination, small columns first."""
    table, n = rows.copy(), rows.shape[1]
    used, pivots = np.zeros(n, dtype=bool), []
    for i in range(len(table)):
        size = np.where(used, 0.0, abs(table[i]))
        if size.max(initial=0.0) < 1e-9:
            continue
        fit = np.flatnonzero(size > 0.3 * size.max())
        j = int(fit[np.argmin((abs(table[:, fit]) > 1e-9).sum(axis=0))])
        table[i] /= table[i, j]
        column = table[:, j].copy()
        column[i] = 0.0
        table -= np.outer(column, table[i])
        table[abs(table) < 1e-13] = 0.0
        pivots.append((i, j))
        used[j] = True
    free = np.flatnonzero(~used)
    basis = np.zeros((n, len(free)))
    basis[free, np.arange(len(free))] = 1.0
    for i, j in pivots:
        basis[j] = -table[i, free]
    basis[abs(basis) < _NOTHING] = 0.0
    return basis


def products(first: Any, second: Any, i: Ints, j: Ints) -> Any:
    """Rows first_i ⊗ second_j of two sparse tables, (len(i), columns of first × columns of second)."""
    one, two = sp.csr_array(first)[i], sp.csr_array(second)[j]
    a, b = np.diff(one.indptr), np.diff(two.indptr)
    count = a * b
    row = np.repeat(np.arange(len(i)), count)
    offset = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    at, to = one.indptr[row] + offset // b[row], two.indptr[row] + offset % b[row]
    columns = one.indices[at].astype(np.int64) * second.shape[1] + two.indices[to]
    shape = (len(i), first.shape[1] * second.shape[1])
    return sp.csr_array((one.data[at] * two.data[to], (row, columns)), shape=shape)


def cost_of(modes: Modes) -> Floats:
    """(3m + 2, 3n + m): Σ_hinges z + Σ_faces capacity (z₊ + z₋), as a form in Φ and w."""
    one = np.zeros(modes.matrix.shape[1] + 2)
    one[-1] = 1.0
    hinged = np.outer(one, modes.rates[modes.hinges].sum(axis=0))
    return np.asarray(hinged + modes.capacities.T @ (modes.rates[2::4] + modes.rates[3::4]))


def extended(modes: LinearModes, region: Region) -> Floats:
    """(k + 3, q + 2): y, λ − L, U − λ and 1 of (F, λ, 1)."""
    last = np.zeros((3, modes.matrix.shape[1] + 2))
    last[0, -2:], last[1, -2:], last[2, -1] = (1.0, -region.low), (-1.0, region.high), 1.0
    return np.vstack([modes.slacks, last])


def relax(
    modes: Modes, region: Region, size: Floats, pairs: Bools, slack: float, seconds: float = np.inf
) -> RltSolution | None:
    """Solve the program of a region with the rows of given pairs, slacks times forms of w (4m, 4m + 2e); None where the
    solver fails.

    size: (3m + 2,) of Φ, see `Statics.size`: in the program forces are shares of it and λ of the way from low to high,
    and every row is of order one, as is what is minimised, (λ − low) b_λ·u: of a narrow region, too, digits are left.

    slack: what each unit of `cost_of` earns; it leaves the multipliers room that the proof needs. The bound never
    exceeds region.high: beyond, an elastic b_λ·u = 1 gives way.
    """
    count, columns = len(modes.rows), modes.matrix.shape[1] + 2
    basis = without(modes.rates[region.closed])
    forms = modes.forms @ basis
    forms[abs(forms) < _NOTHING] = 0.0
    rates = forms[:count]
    live, width = modes.live_rate @ basis, basis.shape[1]
    moving = np.flatnonzero(~region.closed)
    used = moving_forms(forms, region)
    alive = np.flatnonzero(used)
    unit, wide = units_of(region, size), region.high - region.low
    facts, largest, statics = scaled(modes, region, unit)
    held = np.flatnonzero(region.held)
    asked = pairs & used
    asked[np.arange(count), np.arange(count)] = False
    asked[held] = False
    row, form = np.nonzero(asked)
    zero_k, zero_l = equal_pairs(held, moving)
    by_live = live[None]
    none = np.zeros(len(facts) - 1, dtype=np.int64)
    blocks = [
        products(statics, np.eye(width), *_all(len(statics), width)),
        products(facts, rates, zero_k, zero_l),
        products(facts, forms, row, form),
        products(facts, forms, *_all(3, len(alive), count, alive)),
        products(facts, by_live, np.arange(len(facts) - 1), none),
        products(facts, by_live, np.array([len(facts) - 1]), np.array([0])),
    ]
    sizes = [block.shape[0] for block in blocks]
    high = np.concatenate([np.zeros(sizes[0] + sizes[1]), np.full(sum(sizes[2:4]), np.inf), np.zeros(sizes[4]), [1.0]])
    high[-1 - sizes[4] : -1] = np.where(np.append(region.held, [False, False]), 0.0, np.inf)
    above = np.zeros(columns)
    above[-2:] = 1.0, -region.low
    objective = unit.T @ (np.outer(above, live) - slack * (cost_of(modes) @ basis)) / wide
    answer = solve_products(objective, sp.vstack(blocks, format="csr"), high, seconds)
    if answer is None:
        return None
    dual = np.split(wide * answer.dual[:-1], np.cumsum(sizes)[:-1])
    over = np.zeros((len(facts), len(forms)))
    over[zero_k, zero_l] = dual[1]
    over[row, form] = np.maximum(dual[2], 0.0)
    over[count:, alive] = np.maximum(dual[3].reshape(3, len(alive)), 0.0)
    sign_free = np.append(region.held, [False, False])
    by_live_ = np.where(sign_free, dual[4], np.maximum(dual[4], 0.0))
    multipliers = Multipliers(over / largest[:, None], by_live_ / largest[:-1], region.low + float(dual[5][0]))
    x = unit @ answer.point[:-1].reshape(columns, width)
    states, z, y, violated = _read(modes, region, x, forms, live, asked)
    return RltSolution(multipliers, states, z, y, violated, answer.found)


def solve_products(
    objective: Floats, matrix: Any, high: Floats, seconds: float, presolve: bool = True
) -> LinearAnswer | None:
    """min objective·X with 0 ≤ rows ≤ high but for the last, b_λ·u = 1, which an amount ≥ 0 may make up for at a price
    of 1, the last unknown, its sign the last row. None where no multipliers come of it. presolve: see `interior_point`.
    """
    elastic = np.zeros((matrix.shape[0], 1))
    elastic[-1] = 1.0
    low = np.append(elastic[:, 0], 0.0)
    unknowns = objective.size
    positive = sp.csr_array(([1.0], ([0], [unknowns])), shape=(1, unknowns + 1))
    rows: Any = sp.vstack([sp.hstack([matrix, sp.csr_array(elastic)], format="csr"), positive], format="csc")
    cost, above = np.append(objective.ravel(), 1.0), np.append(high, np.inf)
    answer = interior_point(cost, rows, low, above, seconds, presolve=presolve)
    usable = len(answer.dual) == rows.shape[0] and np.isfinite(answer.dual).all() and np.isfinite(answer.point).all()
    return answer if usable and answer.dual.any() else None


def scaled(modes: LinearModes, region: Region, unit: Floats) -> tuple[Floats, Floats, Floats]:
    """`extended` over Φ in units, rows divided by their largest numbers; these; equilibrium, divided likewise."""
    facts, statics = extended(modes, region) @ unit, modes.statics @ unit
    largest = row_sizes(facts)
    return facts / largest[:, None], largest, statics / row_sizes(statics)[:, None]


def row_sizes(rows: Floats) -> Floats:
    """(k,) largest number of each row; 1 where all are zero, as those of a crack without strength are."""
    sizes = abs(rows).max(axis=1)
    return np.where(sizes > 0.0, sizes, 1.0)


def units_of(region: Region, size: Floats) -> Floats:
    """(3m + 2, 3m + 2): (F, λ, 1) of forces as shares of the largest, λ as a share of the region, and 1."""
    unit = np.diag(size)
    unit[-2, -2:] = region.high - region.low, region.low
    return unit


def _read(
    modes: Modes, region: Region, x: Floats, forms: Floats, live: Floats, asked: Bools
) -> tuple[Floats, Floats, Floats, Bools]:
    """Forces that X mixes, z and y on the mean, and the rows it violates."""
    seen, count = x @ forms.T, len(modes.rows)
    violated = (modes.slacks @ seen < -_VIOLATED) & ~asked & moving_forms(forms, region) & ~region.held[:, None]
    violated[np.arange(count), np.arange(count)] = False
    return mixed(x, live, forms[:count]), seen[-1, :count], modes.slacks @ x @ live, violated


def moving_forms(forms: Floats, region: Region) -> Bools:
    """(4m + 2e,) forms, given over free velocities, that are not zero throughout."""
    moving = (forms != 0.0).any(axis=1)
    moving[: len(region.closed)] = ~region.closed
    return np.asarray(moving)


def mixed(x: Floats, live: Floats, rates: Floats) -> Floats:
    """Forces and λ (k, q + 1) that X mixes: on the mean, and as the largest modes see them."""
    mean, z = x @ live, x[-1] @ rates.T
    states = [mean / mean[-1]] if mean[-1] > _SEEN else []
    states += [x @ rates[mode] / z[mode] for mode in np.argsort(-z, kind="stable")[:_MIXED] if z[mode] > _SEEN]
    return np.array(states).reshape(len(states), len(x))[:, :-1]


def equal_pairs(held: Ints, moving: Ints) -> tuple[Ints, Ints]:
    """y_k z_l = 0: for k = l, and for every held k."""
    both = np.isin(moving, held)
    k = np.concatenate([moving[~both], np.repeat(held, len(moving))])
    return k, np.concatenate([moving[~both], np.tile(moving, len(held))])


def _all(first: int, second: int, start: int = 0, chosen: Ints | None = None) -> tuple[Ints, Ints]:
    """Every row of one table with every (chosen) row of the other."""
    other = np.arange(second) if chosen is None else chosen
    return np.repeat(np.arange(first) + start, len(other)), np.tile(other, first)
