"""Lower bound on λ over all non-dilatant solutions: RLT relaxation (4.7) as one linear program.

Modes that cannot move remove their velocities from the program. Source: reformulation-linearisation technique of
Sherali & Adams.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from jld_core import Bools, Floats, Ints, time_left, tolerances
from jld_dilation.modes import BoundedModes, LinearAnswer, LinearModes, Modes, Region, interior_point

_NOTHING: Final = 1e-11  # size of coefficients that are rounding errors of an elimination
_MIXED: Final = 6  # number of modes, the largest, whose states are computed from X
_SEEN: Final = 1e-6  # least z of a mode whose state is computed from X
_VIOLATED: Final = 1e-7  # size of a negative product from which its row is added to the program


@dataclass(frozen=True)
class Multipliers:
    """Multipliers of products of forms in an RLT program, from which `Certifier` derives a bound."""

    # Forms of forces: 4m slacks y, λ − L, U − λ, 1. Of velocities: 4m rates z, 2e sums around loops. Held modes have
    # y_k = 0.

    products: Floats  # (4m + 3, 4m + 2e) multipliers of the products; ≥ 0 except for y_k z_k and the rows of held modes
    live_work: Floats  # (4m + 2,) multipliers of the forms of forces, without 1, times b_λ·u; ≥ 0 except for held modes
    bound: float  # bound that the solver claims, scaled λ


@dataclass(frozen=True)
class RltSolution:
    """Solution of the RLT relaxation (4.7): `multipliers` prove; other arrays, of primal X, are hints."""

    multipliers: Multipliers
    # (k, 3m + 1) forces and λ, scaled: the mean state of X first, then those of the modes with the largest rates
    states: Floats
    # rates, slacks: (4m,) mean mode rates z and mean yield slacks y
    rates: Floats
    slacks: Floats
    # (4m, 4m + 2e) True for products y_k h_l outside the program that are negative in X; None if unknown
    violated: Bools | None = None
    accurate: bool = True  # True if the solver reports an optimum; otherwise the multipliers may still prove a bound


@dataclass(frozen=True)
class RltOptions:
    pairs: Bools  # (4m, 4m + 2e) rows y_k h_l ≥ 0 to include: slacks y of yield rows times forms h of velocities
    # σ, decrease of the objective per unit of `cost_form`. It gives the multipliers the margin that a proof needs.
    slack: float
    seconds: float = np.inf  # time limit: wall-clock time of HiGHS, processor time of the solver by matrix blocks
    # number of faces within which a velocity is multiplied with forces and equilibrium; None: all of them. Used by the
    # solver by matrix blocks only.
    distance: int | None = None
    # residual and complementarity of the solver by matrix blocks; None: its default. With a large tolerance multipliers
    # are larger and easier to make exact.
    tolerance: float | None = None


def null_space(rows: Floats) -> Floats:
    """Return a sparse basis (n, k) of the null space of a matrix `rows` (r, n)."""
    # Gaussian elimination prefers pivots in columns with few entries. Each basis vector has one entry 1 that all others
    # lack.
    table, n = rows.copy(), rows.shape[1]
    used, pivots = np.zeros(n, dtype=bool), []
    for i in range(len(table)):
        pivot_sizes = np.where(used, 0.0, abs(table[i]))
        if pivot_sizes.max(initial=0.0) < 1e-9:
            continue
        fit = np.flatnonzero(pivot_sizes > 0.3 * pivot_sizes.max())
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


def product_rows(first: Any, second: Any, i: Ints, j: Ints) -> Any:
    """Return the sparse Kronecker products of rows i (k,) of one matrix with rows j of another."""
    # The rows state products of two linear forms, of forces and of velocities, as linear forms of X, docs/method.md
    # (4.7).
    first_rows, second_rows = sp.csr_array(first)[i], sp.csr_array(second)[j]
    a, b = np.diff(first_rows.indptr), np.diff(second_rows.indptr)
    count = a * b
    row = np.repeat(np.arange(len(i)), count)
    offset = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    at, to = first_rows.indptr[row] + offset // b[row], second_rows.indptr[row] + offset % b[row]
    columns = first_rows.indices[at].astype(np.int64) * second.shape[1] + second_rows.indices[to]
    shape = (len(i), first.shape[1] * second.shape[1])
    return sp.csr_array((first_rows.data[at] * second_rows.data[to], (row, columns)), shape=shape)


def cost_form(modes: Modes) -> Floats:
    """Return the cost Σ_hinges z + Σ_faces capacity (z₊ + z₋) as a form (3m + 2, 3n + m), docs/method.md (4.8)."""
    form = np.zeros(modes.matrix.shape[1] + 2)
    form[-1] = 1.0
    hinged = np.outer(form, modes.rates[modes.hinges].sum(axis=0))
    return np.asarray(hinged + modes.capacities.T @ (modes.rates[2::4] + modes.rates[3::4]))


def region_forms(modes: LinearModes, region: Region) -> Floats:
    """Return the forms (k + 3, q + 2) of (F, λ, 1) ≥ 0 in a region: slacks, λ − low, high − λ, 1 (4.7)."""
    last = np.zeros((3, modes.matrix.shape[1] + 2))
    last[0, -2:], last[1, -2:], last[2, -1] = (1.0, -region.low), (-1.0, region.high), 1.0
    return np.vstack([modes.slacks, last])


def solve_rlt(bounded: BoundedModes, region: Region, options: RltOptions) -> RltSolution | None:
    """Solve the RLT relaxation of one region as one linear program; None if the solver fails."""
    modes, force_bounds, pairs, slack = bounded.modes, bounded.force_bounds, options.pairs, options.slack
    count, columns = len(modes.rows), modes.matrix.shape[1] + 2
    basis = null_space(modes.rates[region.closed])
    forms = modes.forms @ basis
    forms[abs(forms) < _NOTHING] = 0.0
    rates = forms[:count]
    live, width = modes.live_rate @ basis, basis.shape[1]
    moving = np.flatnonzero(~region.closed)
    used = moving_forms(forms, region)
    alive = np.flatnonzero(used)
    unit, wide = scaling_matrix(region, force_bounds), region.high - region.low
    facts, largest, statics = scaled_forms(modes, region, unit)
    held = np.flatnonzero(region.held)
    included = pairs & used
    included[np.arange(count), np.arange(count)] = False
    included[held] = False
    row, form = np.nonzero(included)
    zero_k, zero_l = zero_product_pairs(held, moving)
    by_live = live[None]
    slacks = np.arange(len(facts) - 1)  # all facts but the last, which is 1
    blocks = [
        product_rows(statics, np.eye(width), *_all(len(statics), width)),  # equilibrium times any velocity: 0
        product_rows(facts, rates, zero_k, zero_l),  # complementary products: 0
        product_rows(facts, forms, row, form),  # included products of slacks and rates: ≥ 0
        product_rows(facts, forms, *_all(3, len(alive), count, alive)),  # the last three facts times rates: ≥ 0
        product_rows(facts, by_live, slacks, np.zeros_like(slacks)),  # slacks at unit live work: ≥ 0, held ones 0
        product_rows(facts, by_live, np.array([len(slacks)]), np.array([0])),  # 1 at unit live work: 1
    ]
    sizes = [block.shape[0] for block in blocks]
    high = np.concatenate([np.zeros(sizes[0] + sizes[1]), np.full(sum(sizes[2:4]), np.inf), np.zeros(sizes[4]), [1.0]])
    high[-1 - sizes[4] : -1] = np.where(np.append(region.held, [False, False]), 0.0, np.inf)
    above = np.zeros(columns)
    above[-2:] = 1.0, -region.low
    objective = unit.T @ (np.outer(above, live) - slack * (cost_form(modes) @ basis)) / wide
    answer = solve_products(objective, sp.vstack(blocks, format="csr"), high, options.seconds)
    if answer is None:
        return None
    duals = np.split(wide * answer.dual[:-1], np.cumsum(sizes)[:-1])
    _, of_zero, of_included, of_last, of_slacks, of_one = duals
    of_products = np.zeros((len(facts), len(forms)))
    of_products[zero_k, zero_l] = of_zero
    of_products[row, form] = np.maximum(of_included, 0.0)
    of_products[count:, alive] = np.maximum(of_last.reshape(3, len(alive)), 0.0)
    sign_free = np.append(region.held, [False, False])
    of_slacks = np.where(sign_free, of_slacks, np.maximum(of_slacks, 0.0))
    load = region.low + float(of_one[0])
    multipliers = Multipliers(of_products / largest[:, None], of_slacks / largest[:-1], load)
    x = unit @ answer.point[:-1].reshape(columns, width)
    states, z, y, violated = _read(modes, region, x, forms, live, included)
    return RltSolution(multipliers, states, z, y, violated, answer.found)


def solve_products(
    objective: Floats, matrix: Any, high: Floats, seconds: float, presolve: bool = True
) -> LinearAnswer | None:
    """Minimise an objective of the products X subject to 0 ≤ matrix X ≤ high (rows,)."""
    # The last row of `matrix` is the equation b_λ·u = 1. An additional last unknown, ≥ 0, may replace b_λ·u at a cost
    # of 1, so that the equation can always be met. One row is appended for the sign of this unknown.
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


def scaled_forms(modes: LinearModes, region: Region, unit: Floats) -> tuple[Floats, Floats, Floats]:
    """Return `region_forms` over their largest entries, these divisors (k + 3,), and equilibrium rows."""
    facts, statics = region_forms(modes, region) @ unit, modes.statics @ unit
    largest = row_maxima(facts)
    return facts / largest[:, None], largest, statics / row_maxima(statics)[:, None]


def row_maxima(rows: Floats) -> Floats:
    """Return the largest absolute entry (k,) of each row, but 1 for rows of zeros, of cracks without strength."""
    sizes = abs(rows).max(axis=1)
    return np.where(sizes > 0.0, sizes, 1.0)


def scaling_matrix(region: Region, force_bounds: Floats) -> Floats:
    """Return the matrix (3m + 2, 3m + 2) from scaled (F, λ, 1): forces by bounds, λ by the region's width."""
    unit = np.diag(force_bounds)
    unit[-2, -2:] = region.high - region.low, region.low
    return unit


def _read(
    modes: Modes, region: Region, x: Floats, forms: Floats, live: Floats, included: Bools
) -> tuple[Floats, Floats, Floats, Bools]:
    """Compute states, mean rates, mean slacks and violated rows from products X (3m + 2, w), for `RltSolution`."""
    values, count = x @ forms.T, len(modes.rows)
    violated = (modes.slacks @ values < -_VIOLATED) & ~included & moving_forms(forms, region) & ~region.held[:, None]
    violated[np.arange(count), np.arange(count)] = False
    return combined_states(x, live, forms[:count]), values[-1, :count], modes.slacks @ x @ live, violated


def moving_forms(forms: Floats, region: Region) -> Bools:
    """Return a mask (4m + 2e,) of the forms (4m + 2e, w) that are not zero in a region."""
    moving = (forms != 0.0).any(axis=1)
    moving[: len(region.closed)] = ~region.closed
    return np.asarray(moving)


def combined_states(x: Floats, live: Floats, rates: Floats) -> Floats:
    """Return states (k, q + 1) of which X (q + 2, w) is a weighted mean: the mean, then those of largest rate."""
    mean, z = x @ live, x[-1] @ rates.T
    states = [mean / mean[-1]] if mean[-1] > _SEEN else []
    states += [x @ rates[mode] / z[mode] for mode in np.argsort(-z, kind="stable")[:_MIXED] if z[mode] > _SEEN]
    return np.array(states).reshape(len(states), len(x))[:, :-1]


def zero_product_pairs(held: Ints, moving: Ints) -> tuple[Ints, Ints]:
    """Return the (k, l) with y_k z_l = 0: k = l, and every held k with every moving l (4.7)."""
    both = np.isin(moving, held)
    k = np.concatenate([moving[~both], np.repeat(held, len(moving))])
    return k, np.concatenate([moving[~both], np.tile(moving, len(held))])


def _all(first: int, second: int, start: int = 0, chosen: Ints | None = None) -> tuple[Ints, Ints]:
    """Return index pairs (i, j), (k,) each, of all rows of one matrix with rows of another."""
    other = np.arange(second) if chosen is None else chosen
    return np.repeat(np.arange(first) + start, len(other)), np.tile(other, first)


PATIENT: Final = 600.0  # processor time in seconds from which products are formed for any number of faces
_LEAST: Final = 1e-8  # lower limit of the scaled |λ| to which relative distances refer
_ROOM: Final = 0.02  # margin above the lowest solution found, relative to the interval of λ not yet excluded

# Additional margin relative to λ; an interval of zero width leaves the interior-point method no interior
_LEAST_ROOM: Final = 1e-3

# Fraction of the remaining distance that a step must gain; below it rows are added or the region is split
_STALL: Final = 0.05
_TRUSTED: Final = 1e-7  # relative reduction of an unproven bound; it exceeds the tolerance of the solver


@dataclass(frozen=True)
class LowerBound:
    """Lower bounds on λ of all non-dilatant solutions with λ ≥ 0, scaled."""

    proven: float  # bound by certificates only
    bound: float  # highest bound, valid within `tolerance`
    tolerance: float  # relative; 0 if `bound` is proven, otherwise it covers the error of the solver
    closed: bool  # True if `bound` meets the lowest solution found
    programs: int  # number of programs solved
    seconds: float  # processor time, s
    solve_log: tuple[str, ...]  # steps in order


class LowerBoundProblem:
    """Shared state of a lower-bound search: lowest solution found, time budget, log.

    offer: takes states (k, q + 1), and returns the scaled λ of the lowest solution found.
    """

    def __init__(self, load: float, seconds: float, offer: Callable[[Floats], float] | None = None) -> None:
        self.load = load
        self.programs, self.solve_log = 0, list[str]()
        self._start, self._seconds, self._offer = time.process_time(), seconds, offer

    def record(self, step: str, programs: int = 0) -> None:
        """Append a step to the log, and add its number of programs to the count."""
        self.solve_log.append(step)
        self.programs += programs

    @property
    def seconds_used(self) -> float:
        return time.process_time() - self._start

    @property
    def seconds_left(self) -> float:
        """Return the remaining processor time in seconds, limited by the deadline of the command."""
        return min(self._seconds - self.seconds_used, time_left())

    @property
    def load_unit(self) -> float:
        """Return the scaled load to which relative distances of λ refer: |load|, at least 1e-8."""
        return max(abs(self.load), _LEAST)

    def scaled_slack(self, slack: float) -> float:
        """Convert a relative slack σ to scaled λ per unit of cost."""
        return slack * max(abs(self.load), 1.0)

    def interval_end(self, low: float) -> float:
        """Return the scaled end of the next interval to exclude, a little above the lowest solution."""
        return self.load + _ROOM * (self.load - low) + _LEAST_ROOM * self.load_unit

    def load_below(self, share: float) -> float:
        """Return the scaled λ of the lowest solution found, reduced by a relative share."""
        return self.load - share * self.load_unit

    def closes_gap(self, bound: float) -> bool:
        """Return True if a bound meets the lowest solution found within the gap tolerance."""
        return bound >= self.load_below(tolerances.GAP)

    def gains_enough(self, low: float, bound: float, share: float = _STALL) -> bool:
        return bound - low > share * (self.load - low)

    def less_solver_tolerance(self, bound: float) -> float:
        """Reduce a claimed bound, at most the lowest solution, by the solver's tolerance on λ."""
        return min(bound, self.load) - _TRUSTED * self.load_unit

    def offer_states(self, states: Floats) -> None:
        """Search for solutions from states (k, q + 1), and update the lowest λ found."""
        if self._offer is not None:
            self.load = min(self.load, self._offer(states))

    def allows_products(self, faces: int, most: int, force_bounds: Floats) -> bool:
        """Return True if the relaxation may be formed, force bounds finite; otherwise log why."""
        if faces > most and self._seconds < PATIENT:
            self.record(f"no products: {faces} faces")
        elif not np.isfinite(force_bounds).all():
            self.record("no products: self-stress is not bounded")
        else:
            return True
        return False

    def result(self, proven: float, believed: float) -> LowerBound:
        """Build the result of the search from the proven bound and the believed one."""
        sure = proven >= believed - tolerances.GAP * self.load_unit
        bound = proven if sure else believed
        return LowerBound(
            proven=proven,
            bound=bound,
            tolerance=0.0 if sure else _TRUSTED,
            closed=self.closes_gap(bound),
            programs=self.programs,
            seconds=self.seconds_used,
            solve_log=tuple(self.solve_log),
        )
