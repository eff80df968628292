"""Certificate of a lower bound without dilation, checked in integer arithmetic.

For multipliers M ≥ 0, g ≥ 0 and any Q, Ψ there is an identity of forms in Φ = (F, λ, 1) and w = (u, t),

    (λ − p)(b_λ·u) − σ cost = Σ M_kl ŷ_k h_l + Σ g_k ŷ_k (b_λ·u) + (K Φ)ᵀ Q w + Φᵀ Ψ z_closed + Φᵀ R w

with forms h = (z, forms of loops). In a solution, its left side is λ − p − σ cost and its right side is at least
ΦᵀR w. Every double precision number in the identity is a binary fraction, so R follows without rounding. With
|Φ| ≤ size and |w| ≤ reach · cost, λ ≥ p is proven if Σ |R_ij| size_i reach_j ≤ σ (docs/method.md (4.8)). Rounding
errors in the identities of loops are charged together with R.

The multipliers are first corrected so that R becomes small.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.linalg import lapack

from jld_core.arrays import Bools, Floats
from jld_core.deadline import checkpoint
from jld_core.models.zero_dilation.binary_fractions import BITS, BinaryFractions, cut
from jld_core.models.zero_dilation.modes import Modes
from jld_core.models.zero_dilation.rlt_relaxation import (
    Multipliers,
    Region,
    extended,
    products,
    row_sizes,
    without,
)

_ROUNDS: Final = 20
"""Maximum number of corrections of the multipliers."""

_FREE: Final = 1e-7
"""Size above which a multiplier may change without limit in a correction; smaller ones change in proportion."""

_GONE: Final = 1e-14
"""Size below which a multiplier counts as zero."""

_FINER: Final = 0.2
"""Factor by which the slack σ decreases after a proof, as less slack may prove a higher bound."""

_FINEST: Final = 2e-4
"""Fraction of the initial slack at which this reduction ends."""

_ASTRAY: Final = 1e4
"""Ratio of the charge to the least charge so far at which corrections have diverged."""

_STALLED: Final = 0.7
"""Factor by which a correction must reduce the charge; three failures in a row end the corrections."""

_REFINED: Final = 12
"""Maximum number of refinements of a correction with the same factor."""

_GAINS: Final = 0.5
"""Factor by which each refinement must reduce the residual."""

_IN_FULL: Final = 9000
"""Number of unknowns up to which normal equations are factored as a dense matrix (0.65 GB)."""

_SHIFT: Final = 1e-15
"""Regularisation of the normal equations, compensated by refinement."""

_NIL: Final = 1e-60
"""Upper limit of what is lost where residuals are converted to doubles."""


class Certifier:
    """Certifier of one planar region: makes multipliers exact and checks what they prove.

    slack: σ. size, reach: see `Statics.size` and `statics.reach`.
    """

    def __init__(self, modes: Modes, region: Region, slack: float, size: Floats, reach: Floats) -> None:
        self.modes, self.region, self.slack, self.size, self.reach = modes, region, slack, size, reach
        self.facts = extended(modes, region)
        self.states = size[:, None] * without(modes.statics * size)
        self.motions = without(modes.rates[region.closed])
        count = len(modes.rows)
        self.still = np.zeros(len(modes.forms), dtype=bool)
        self.still[:count] = region.closed
        self.free = np.zeros((count + 3, len(modes.forms)), dtype=bool)
        self.free[np.arange(count), np.arange(count)] = True
        self.free[:count][region.held] = True
        # Forms h, and how far below zero those of loops may be per unit of cost, due to rounding of their identities.
        rates = _exact_rates(modes)
        self._forms = BinaryFractions.of(np.vstack([np.eye(count), modes.loops])) @ rates
        identities = (BinaryFractions.of(modes.loops[::2] - modes.loops[1::2]) @ rates).floats()
        self.misses = np.repeat(abs(identities) @ reach, 2)
        # Mask (3n + m,) of velocities to which no multiple of equilibrium is applied.
        self.alone = np.zeros(modes.rates.shape[1], dtype=bool)
        self.sign_free = np.append(region.held, [False, False])
        self._equilibrium: Callable[[Floats], Floats] | None = None
        # Divisors of the rows, and divisors of the multipliers of rows times b_λ·u.
        self.largest = row_sizes(self.facts * self.size)
        self.prices = self.largest[:-1]

    def bound(self, multipliers: Multipliers, enough: float = math.inf) -> float:
        """Return the bound of multipliers, or a bound close to it, if proven; −inf if not.

        enough: bound at which refinement of the certificate ends.
        """
        over, live = BinaryFractions.of(cut(multipliers.over)), BinaryFractions.of(cut(multipliers.live[:, None]))
        bound = BinaryFractions.of(cut(np.array([[multipliers.bound]])))
        over.values[:, self.still] = 0
        correct: Any = None
        proven, slack = -math.inf, self.slack
        last, least, idle = math.inf, math.inf, 0
        for _ in range(_ROUNDS):
            checkpoint()
            rest = self._settled(over, live, bound, slack)
            charge = (float(self.size @ (abs(rest) @ self.reach)) + self._missed(over)) * (1.0 + 1e-9) + _NIL
            if charge <= slack:
                # Less slack may prove a higher bound, since slack costs λ.
                # A proven bound is cut off at the end of the region: beyond, nothing is known about λ.
                found = math.nextafter(float(bound.floats()[0, 0]), -math.inf)
                proven = max(proven, min(found, self.region.high))
                if proven >= enough or slack <= self.slack * _FINEST:
                    break
                slack, charge, idle = slack * _FINER, math.inf, 0
                rest = self._settled(over, live, bound, slack)
            idle = idle + 1 if charge > _STALLED * last else 0
            last, least = charge, min(charge, least)
            if idle == 3 or math.inf > charge > _ASTRAY * least:
                break
            if correct is None:
                near, price = over.floats(), live.floats()[:, 0]
                over.values[~self.free & (near * self.largest[:, None] < _GONE)] = 0
                live.values[~self.sign_free & (price * self.prices < _GONE)] = 0
                rest = self._settled(over, live, bound, slack)
                correct = self._correction(near, price)
            change = correct(rest)
            over, live, bound = over + change[0], live + change[1], bound + change[2]
            # Multipliers that became negative are set to zero and may not change again.
            wrong, dear = (over.values < 0) & ~self.free, (live.values[:, 0] < 0) & ~self.sign_free
            over.values[wrong], live.values[dear] = 0, 0
            if wrong.any() or dear.any():
                correct = None
        return proven

    def _correction(self, over: Floats, price: Floats) -> Any:
        """Return a function from the residual R to the change of multipliers that reduces R.

        Forces are scaled by their upper bounds, and rows by their largest entries, so that all numbers compared are of
        order one. Small multipliers change in proportion to their size. The changes are returned as fractions.
        """
        largest = self.largest
        facts, rates = clean((self.facts / largest[:, None]) @ self.states), clean(self.modes.forms @ self.motions)
        live = self.modes.live_rate @ self.motions
        weight = np.where(self.free, 1.0, np.minimum(over * largest[:, None] / _FREE, 1.0))
        weight = np.where(weight < _GONE / _FREE, 0.0, weight)
        weight[:, self.still] = 0.0
        i, j = np.nonzero(weight)
        dear = np.where(self.sign_free, 1.0, np.minimum(price * largest[:-1] / _FREE, 1.0))
        g = np.flatnonzero(dear >= _GONE / _FREE)
        last = np.append(g, len(facts) - 1)
        by_live = products(facts, live[None], last, np.zeros(len(last), dtype=np.int64))
        rows = sp.vstack([products(facts, rates, i, j), by_live], format="csr")
        solve = least_change(rows, np.concatenate([weight[i, j], dear[g], [1.0]]))
        scales = 1.0 / np.concatenate([largest[i], largest[last]])

        def change(rest: Floats) -> tuple[BinaryFractions, BinaryFractions, BinaryFractions]:
            """Return the changes of `over`, `live` and `bound` for a residual."""
            size = float(abs(rest).max(initial=0.0)) or 1.0
            found = solve((self.states.T @ (rest / size) @ self.motions).ravel()) * size * scales
            more, paid = np.zeros(over.shape), np.zeros((len(price), 1))
            more[i, j], paid[g, 0] = found[: len(i)], found[len(i) : -1]
            one, two, three = (BinaryFractions.of(cut(table, 2 * BITS)) for table in (more, paid, found[-1:, None]))
            return one, two, three

        return change

    # --- in integers --------------------------------------------------------------------------------------

    def _settled(self, over: BinaryFractions, live: BinaryFractions, bound: BinaryFractions, slack: float) -> Floats:
        """Return R (3m + 2, 3n + m): the residual of the identity after two reductions by Q and Ψ."""
        lacking = self._lacking(over, live, bound, slack)
        return taken_off(lacking, self.modes.statics, self._forms.rows(self.still), self.alone, self._equilibrium)

    def _missed(self, over: BinaryFractions) -> float:
        """Return how far products with the forms of loops may be below zero, due to rounding."""
        of_loops = BinaryFractions(over.values[:, len(over.values[0]) - len(self.misses) :], over.scale).floats()
        return float((abs(self.facts) @ self.size) @ abs(of_loops) @ self.misses)

    def _lacking(
        self, over: BinaryFractions, live: BinaryFractions, bound: BinaryFractions, slack: float
    ) -> BinaryFractions:
        """Return the left minus the right side of the identity without R, Q and Ψ, exactly."""
        modes, columns, rates = self.modes, self.facts.shape[1], self._forms.rows(slice(len(self.modes.rows)))
        facts, unit = BinaryFractions.of(self.facts), np.eye(columns)
        load = BinaryFractions.of(unit[:, -2:-1]) - BinaryFractions.of(unit[:, -1:]) @ bound
        by_live = BinaryFractions.of(modes.live_rate[None])
        total = (load - facts.rows(slice(-1)).transposed() @ live) @ by_live
        ones = BinaryFractions.of(unit[:, -1:] @ np.ones((1, int(modes.hinges.sum()))))
        four = modes.slacks.reshape(modes.faces, 4, columns)
        capacity = BinaryFractions.of(np.repeat(0.5 * four[:, 2], 2, axis=0)) + BinaryFractions.of(
            np.repeat(0.5 * four[:, 3], 2, axis=0)
        )
        cost = ones @ rates.rows(modes.hinges) + capacity.transposed() @ rates.rows(~modes.hinges)
        return total - cost.times(slack) - facts.transposed() @ (over @ self._forms)


def taken_off(
    lacking: BinaryFractions,
    statics: Floats,
    still: BinaryFractions,
    alone: Bools,
    equilibrium: Callable[[Floats], Floats] | None = None,
) -> Floats:
    """Reduce a form in Φ and w by multiples of equilibrium K Φ = 0 and of zero velocities.

    statics: K. still: (e, w) forms of w that are zero. alone: (w,) velocities to which no multiple of equilibrium is
    applied. equilibrium: function from a residual to the multipliers of K that reduce the residual most; None: least
    squares.
    """
    exact = BinaryFractions.of(statics)
    if equilibrium is None:
        by_statics = np.asarray(np.linalg.pinv(statics.T, rcond=1e-12))
        equilibrium = by_statics.__matmul__
    by_still = np.linalg.pinv(still.floats(), rcond=1e-12) if len(still.values) else None
    for turn in (1, 2):
        rest = lacking.floats()
        rest[:, alone] = 0.0
        q = BinaryFractions.of(cut(equilibrium(rest), turn * BITS))
        lacking = lacking - exact.transposed() @ q
        if by_still is not None:
            lacking = lacking - BinaryFractions.of(cut(lacking.floats() @ by_still, turn * BITS)) @ still
    return lacking.floats()


def clean(table: Floats) -> Floats:
    """Set entries that are rounding errors of numbers of order one to zero."""
    return np.where(abs(table) < 1e-11, 0.0, table)


def least_change(rows: Any, share: Floats) -> Any:
    """Return a solver for the least weighted change with rowsᵀ change ≈ target.

    rows: sparse rows. share: weight of each multiplier. The solver uses refined normal equations.
    """
    weighted = sp.csr_array(sp.diags_array(share) @ rows)
    normal = sp.csc_array(weighted.T @ weighted)
    solved = _factor(normal, _SHIFT * float(normal.diagonal().max(initial=1.0)))

    def solve(target: Floats) -> Floats:
        """Solve for the change of the multipliers that meets one target, by iterative refinement."""
        change, left = np.zeros(len(share)), target
        for _ in range(_REFINED):
            more = share * (weighted @ solved(left))
            after = target - rows.T @ (change + more)
            if not np.linalg.norm(after) < _GAINS * np.linalg.norm(left):
                break
            change, left = change + more, after
        return change

    return solve


def _factor(normal: Any, shift: float) -> Any:
    """Return a solver of (normal + shift) x = rhs.

    Products that no multiplier touches are rows of zeros, and all others fill in completely. A dense factor of these
    is three times as fast as a sparse one, as long as the matrix fits in memory.
    """
    used = np.flatnonzero(np.diff(normal.indptr))
    if len(used) <= _IN_FULL:
        table = normal[used][:, used].toarray(order="F")
        table[np.diag_indices_from(table)] += shift
        factor, failed = lapack.dpotrf(table, lower=1, overwrite_a=1)
        if failed == 0:

            def in_full(rhs: Floats) -> Floats:
                """Solve with the dense factor."""
                out = np.zeros(len(rhs))
                out[used] = lapack.dpotrs(factor, rhs[used], lower=1)[0]
                return out

            return in_full
    shifted = sp.csc_matrix(normal + shift * sp.eye_array(normal.shape[0], format="csc"))
    return spla.splu(shifted, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve


def _exact_rates(modes: Modes) -> BinaryFractions:
    """Return H from the numbers of A exactly, without the rounding of βδ ∓ θ."""
    jumps = BinaryFractions.of(modes.matrix.T.copy())
    values = jumps.values.reshape(modes.faces, 3, -1)
    beta = np.array([int(b) for b in modes.rows.reshape(modes.faces, 4, -1, 3).sum(axis=2)[:, 1, 2]], dtype=object)
    rates = np.zeros((modes.faces, 4, modes.rates.shape[1]), dtype=object)
    width = values.shape[2]
    rates[:, 0, :width] = beta[:, None] * values[:, 0] - values[:, 2]
    rates[:, 1, :width] = beta[:, None] * values[:, 0] + values[:, 2]
    rates[:, 3, :width] = values[:, 1]
    face = np.arange(modes.faces)
    rates[face, 2, width + face] = rates[face, 3, width + face] = 1 << jumps.scale
    return BinaryFractions(rates.reshape(len(modes.rows), -1), jumps.scale)
