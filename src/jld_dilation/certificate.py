"""Certificate of a lower bound without dilation (4.8), checked in integer arithmetic.

Every double precision number in the identity is a binary fraction, so its remainder R follows without rounding.
Rounding errors in the identities of loops are charged together with R. Multipliers are first corrected so that R
becomes small.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.linalg import lapack

from jld_core import Bools, Floats, LimitAnalysis, Status, checkpoint
from jld_core.limit import Proof, number, relative_width
from jld_dilation.interior_point import NormalEquations, ProductProgram, minimise_product_program
from jld_dilation.modes import BoundedModes, Modes, Region
from jld_dilation.product_space import LocalProductSpace, PrimalDualPair, lone_faces, velocities_of
from jld_dilation.rlt_relaxation import (
    Multipliers,
    RltOptions,
    RltSolution,
    combined_states,
    cost_form,
    moving_forms,
    null_space,
    product_rows,
    region_forms,
    row_maxima,
    scaling_matrix,
    zero_product_pairs,
)

BITS: Final = 70  # number of binary places to which numbers are rounded


@dataclass(frozen=True)
class BinaryFractions:
    """Matrix of binary fractions of any length; +, − and @ are exact."""

    values: Any  # (r, c) integers of any length
    scale: int  # each entry is its integer divided by 2^scale

    @staticmethod
    def of(table: Floats) -> BinaryFractions:
        """Convert a matrix of finite doubles to binary fractions, exactly.

        table: (r, c) doubles.
        """
        part, power = np.frexp(table)
        used = table != 0.0
        least = int(power[used].min(initial=0))
        digits = np.ldexp(part, 53).astype(np.int64).astype(object)
        return BinaryFractions(digits << np.where(used, power - least, 0).astype(object), 53 - least)

    def transposed(self) -> BinaryFractions:
        return BinaryFractions(self.values.T, self.scale)

    def rows(self, chosen: Any) -> BinaryFractions:
        """Return the matrix of the chosen rows, given by indices, a mask or a slice."""
        return BinaryFractions(self.values[chosen], self.scale)

    def times(self, factor: float) -> BinaryFractions:
        """Multiply every entry by the double `factor`, exactly."""
        by = BinaryFractions.of(np.array([[factor]]))
        return BinaryFractions(self.values * by.values[0, 0], self.scale + by.scale)

    def __add__(self, other: BinaryFractions) -> BinaryFractions:
        scale = max(self.scale, other.scale)
        first, second = self.values << (scale - self.scale), other.values << (scale - other.scale)
        return BinaryFractions(first + second, scale)

    def __sub__(self, other: BinaryFractions) -> BinaryFractions:
        return self + BinaryFractions(-other.values, other.scale)

    def __matmul__(self, other: BinaryFractions) -> BinaryFractions:
        """Multiply two matrices exactly, skipping zero entries."""
        product = np.zeros((self.values.shape[0], other.values.shape[1]), dtype=object)
        columns = [np.flatnonzero(row) for row in other.values]
        nonzero = [row[at] for row, at in zip(other.values, columns, strict=True)]
        for i, k in zip(*np.nonzero(self.values), strict=True):
            product[i, columns[k]] += self.values[i, k] * nonzero[k]
        return BinaryFractions(product, self.scale + other.scale)

    def floats(self) -> Floats:
        """Convert the entries to doubles, correct to about 15 digits."""
        drop = max(self.scale - 300, 0)
        doubles = [
            math.ldexp(float(v >> drop if v >= 0 else -(-v >> drop)), drop - self.scale) for v in self.values.flat
        ]
        # A matrix without rows keeps its number of columns: structures without loops have such matrices.
        return np.array(doubles, dtype=float).reshape(self.values.shape)


def round_to_bits(table: Floats, bits: int = BITS) -> Floats:
    return np.asarray(np.ldexp(np.rint(np.ldexp(table, bits)), -bits))


_ROUNDS: Final = 20  # maximum number of corrections of the multipliers

# Size above which a multiplier may change without limit in a correction; smaller ones change in proportion
_FREE: Final = 1e-7
_GONE: Final = 1e-14  # size below which a multiplier counts as zero
_FINER: Final = 0.2  # factor by which the slack σ decreases after a proof, as less slack may prove a higher bound
_FINEST: Final = 2e-4  # fraction of the initial slack at which this reduction ends
_ASTRAY: Final = 1e4  # ratio of the charge to the least charge so far at which corrections have diverged

# Factor by which a correction must reduce the charge; three failures in a row end the corrections
_STALLED: Final = 0.7
_REFINED: Final = 12  # maximum number of refinements of a correction with the same factor
_GAINS: Final = 0.5  # factor by which each refinement must reduce the residual
_IN_FULL: Final = 9000  # number of unknowns up to which normal equations are factored as a dense matrix (0.65 GB)
_SHIFT: Final = 1e-15  # regularisation of the normal equations, compensated by refinement
_NIL: Final = 1e-60  # upper limit of what is lost where residuals are converted to doubles


class Certifier:
    """Certifier of one planar region: makes multipliers exact and checks the bound they prove, docs/method.md (4.8).

    slack: σ, decrease of scaled λ per unit of cost. ValueError if velocities are not bounded.
    """

    def __init__(self, bounded: BoundedModes, region: Region, slack: float) -> None:
        if bounded.velocity_bounds is None:
            raise ValueError("velocities are not bounded: no certificate is possible")
        self.modes, self.region, self.slack = bounded.modes, region, slack
        self.force_bounds, self.velocity_bounds = bounded.force_bounds, bounded.velocity_bounds
        modes, force_bounds, velocity_bounds = self.modes, self.force_bounds, self.velocity_bounds
        self.facts = region_forms(modes, region)
        self.states = force_bounds[:, None] * null_space(modes.statics * force_bounds)
        self.motions = null_space(modes.rates[region.closed])
        count = len(modes.rows)
        self.closed_forms = np.zeros(len(modes.forms), dtype=bool)
        self.closed_forms[:count] = region.closed
        self.free = np.zeros((count + 3, len(modes.forms)), dtype=bool)
        self.free[np.arange(count), np.arange(count)] = True
        self.free[:count][region.held] = True
        # Forms h, and how far below zero those of loops may be per unit of cost, due to rounding of their identities.
        rates = _exact_rates(modes)
        self._forms = BinaryFractions.of(np.vstack([np.eye(count), modes.loops])) @ rates
        identities = (BinaryFractions.of(modes.loops[::2] - modes.loops[1::2]) @ rates).floats()
        self.loop_errors = np.repeat(abs(identities) @ velocity_bounds, 2)
        # Mask (3n + m,) of velocities to which no multiple of equilibrium is applied.
        self.unbalanced = np.zeros(modes.rates.shape[1], dtype=bool)
        self.sign_free = np.append(region.held, [False, False])
        self._equilibrium: Callable[[Floats], Floats] | None = None
        # Divisors of the rows, and divisors of the multipliers of rows times b_λ·u.
        self.largest = row_maxima(self.facts * self.force_bounds)
        self.prices = self.largest[:-1]

    def bound(self, multipliers: Multipliers, sufficient_bound: float = math.inf) -> float:
        """Correct multipliers until they prove a scaled bound ≤ region.high; return it, −inf without proof."""
        of_products = BinaryFractions.of(round_to_bits(multipliers.products))
        live_work = BinaryFractions.of(round_to_bits(multipliers.live_work[:, None]))
        bound = BinaryFractions.of(round_to_bits(np.array([[multipliers.bound]])))
        of_products.values[:, self.closed_forms] = 0
        correct: Any = None
        proven, slack = -math.inf, self.slack
        last, least, idle = math.inf, math.inf, 0
        for _ in range(_ROUNDS):
            checkpoint()
            residual = self._residual(of_products, live_work, bound, slack)
            charge = (
                float(self.force_bounds @ (abs(residual) @ self.velocity_bounds)) + self._loop_charge(of_products)
            ) * (1.0 + 1e-9) + _NIL
            if charge <= slack:
                # Less slack may prove a higher bound, since slack costs λ.
                # A proven bound is cut off at the end of the region: beyond, nothing is known about λ.
                candidate_bound = math.nextafter(float(bound.floats()[0, 0]), -math.inf)
                proven = max(proven, min(candidate_bound, self.region.high))
                if proven >= sufficient_bound or slack <= self.slack * _FINEST:
                    break
                slack, charge, idle = slack * _FINER, math.inf, 0
                residual = self._residual(of_products, live_work, bound, slack)
            idle = idle + 1 if charge > _STALLED * last else 0
            last, least = charge, min(charge, least)
            if idle == 3 or math.inf > charge > _ASTRAY * least:
                break
            if correct is None:
                near, price = of_products.floats(), live_work.floats()[:, 0]
                of_products.values[~self.free & (near * self.largest[:, None] < _GONE)] = 0
                live_work.values[~self.sign_free & (price * self.prices < _GONE)] = 0
                residual = self._residual(of_products, live_work, bound, slack)
                correct = self._correction(near, price)
            change = correct(residual)
            of_products, live_work, bound = of_products + change[0], live_work + change[1], bound + change[2]
            # Multipliers that became negative are set to zero and may not change again.
            wrong, movable = (of_products.values < 0) & ~self.free, (live_work.values[:, 0] < 0) & ~self.sign_free
            of_products.values[wrong], live_work.values[movable] = 0, 0
            if wrong.any() or movable.any():
                correct = None
        return proven

    def _correction(self, of_products: Floats, price: Floats) -> Any:
        """Return a function that computes changes of the multipliers which reduce a residual R."""
        # R is the violation of the identity in the module docstring.
        largest = self.largest
        facts, rates = (
            drop_rounding((self.facts / largest[:, None]) @ self.states),
            drop_rounding(self.modes.forms @ self.motions),
        )
        live = self.modes.live_rate @ self.motions
        weight = np.where(self.free, 1.0, np.minimum(of_products * largest[:, None] / _FREE, 1.0))
        weight = np.where(weight < _GONE / _FREE, 0.0, weight)
        weight[:, self.closed_forms] = 0.0
        i, j = np.nonzero(weight)
        movable = np.where(self.sign_free, 1.0, np.minimum(price * largest[:-1] / _FREE, 1.0))
        g = np.flatnonzero(movable >= _GONE / _FREE)
        last = np.append(g, len(facts) - 1)
        by_live = product_rows(facts, live[None], last, np.zeros(len(last), dtype=np.int64))
        rows = sp.vstack([product_rows(facts, rates, i, j), by_live], format="csr")
        solve = least_change_solver(rows, np.concatenate([weight[i, j], movable[g], [1.0]]))
        scales = 1.0 / np.concatenate([largest[i], largest[last]])

        def change(residual: Floats) -> tuple[BinaryFractions, BinaryFractions, BinaryFractions]:
            """Return the changes of products, live work and bound for the residual R."""
            residual_size = float(abs(residual).max(initial=0.0)) or 1.0
            solution = (
                solve((self.states.T @ (residual / residual_size) @ self.motions).ravel()) * residual_size * scales
            )
            more, paid = np.zeros(of_products.shape), np.zeros((len(price), 1))
            more[i, j], paid[g, 0] = solution[: len(i)], solution[len(i) : -1]
            of_equilibrium, of_live_work, of_bound = (
                BinaryFractions.of(round_to_bits(table, 2 * BITS)) for table in (more, paid, solution[-1:, None])
            )
            return of_equilibrium, of_live_work, of_bound

        return change

    # --- in integers --------------------------------------------------------------------------------------

    def _residual(
        self, of_products: BinaryFractions, live_work: BinaryFractions, bound: BinaryFractions, slack: float
    ) -> Floats:
        """Return the residual R (3m + 2, 3n + m), reduced by multiples of equilibrium and closed modes."""
        lacking = self._identity_difference(of_products, live_work, bound, slack)
        return reduce_residual(
            lacking, self.modes.statics, self._forms.rows(self.closed_forms), self.unbalanced, self._equilibrium
        )

    def _loop_charge(self, of_products: BinaryFractions) -> float:
        """Return the bound on what rounding in the identities of loops may take from the proven λ."""
        of_loops = BinaryFractions(
            of_products.values[:, len(of_products.values[0]) - len(self.loop_errors) :], of_products.scale
        ).floats()
        return float((abs(self.facts) @ self.force_bounds) @ abs(of_loops) @ self.loop_errors)

    def _identity_difference(
        self, of_products: BinaryFractions, live_work: BinaryFractions, bound: BinaryFractions, slack: float
    ) -> BinaryFractions:
        """Return the left minus the right side of the certificate's identity, without rounding."""
        # Left: (λ − p)(b_λ·u) − σ cost. Right: Σ g ŷ (b_λ·u) + Σ M ŷ h, without the terms with R, Q and Ψ of the module
        # docstring. p = `bound`, σ = `slack`, g = `live_work`, M = `of_products`; rows of `facts` are ŷ, the last 1.
        modes, columns, rates = self.modes, self.facts.shape[1], self._forms.rows(slice(len(self.modes.rows)))
        facts, unit = BinaryFractions.of(self.facts), np.eye(columns)
        load = BinaryFractions.of(unit[:, -2:-1]) - BinaryFractions.of(unit[:, -1:]) @ bound
        by_live = BinaryFractions.of(modes.live_rate[None])
        total = (load - facts.rows(slice(-1)).transposed() @ live_work) @ by_live
        ones = BinaryFractions.of(unit[:, -1:] @ np.ones((1, int(modes.hinges.sum()))))
        four = modes.slacks.reshape(modes.faces, 4, columns)
        capacity = BinaryFractions.of(np.repeat(0.5 * four[:, 2], 2, axis=0)) + BinaryFractions.of(
            np.repeat(0.5 * four[:, 3], 2, axis=0)
        )
        cost = ones @ rates.rows(modes.hinges) + capacity.transposed() @ rates.rows(~modes.hinges)
        return total - cost.times(slack) - facts.transposed() @ (of_products @ self._forms)


def reduce_residual(
    lacking: BinaryFractions,
    statics: Floats,
    zero_forms: BinaryFractions,
    unbalanced: Bools,
    equilibrium: Callable[[Floats], Floats] | None = None,
) -> Floats:
    """Reduce a residual (q + 2, w) by equilibrium, but for velocities `unbalanced` (w,), and zero forms (e, w)."""
    # The forms are multiples of equilibrium and of velocities that are zero, the terms with Q and Ψ of docs/method.md
    # (4.8). Sums are exact; the result (q + 2, w) is converted to doubles.
    exact = BinaryFractions.of(statics)
    if equilibrium is None:
        by_statics = np.asarray(np.linalg.pinv(statics.T, rcond=1e-12))
        equilibrium = by_statics.__matmul__
    by_zero_forms = np.linalg.pinv(zero_forms.floats(), rcond=1e-12) if len(zero_forms.values) else None
    for turn in (1, 2):
        residual = lacking.floats()
        residual[:, unbalanced] = 0.0
        q = BinaryFractions.of(round_to_bits(equilibrium(residual), turn * BITS))
        lacking = lacking - exact.transposed() @ q
        if by_zero_forms is not None:
            lacking = (
                lacking - BinaryFractions.of(round_to_bits(lacking.floats() @ by_zero_forms, turn * BITS)) @ zero_forms
            )
    return lacking.floats()


def drop_rounding(table: Floats) -> Floats:
    """Return an array in which entries below 1e-11, rounding of numbers of order one, are zero."""
    return np.where(abs(table) < 1e-11, 0.0, table)


def least_change_solver(rows: Any, share: Floats) -> Any:
    """Return a solver, from target (columns,) to the least weighted x (k,) with rowsᵀ x ≈ target."""
    weighted = sp.csr_array(sp.diags_array(share) @ rows)
    normal = sp.csc_array(weighted.T @ weighted)
    solved = _factor(normal, _SHIFT * float(normal.diagonal().max(initial=1.0)))

    def solve(target: Floats) -> Floats:
        """Solve for the change of the multipliers that meets one target, by iterative refinement."""
        change, remaining = np.zeros(len(share)), target
        for _ in range(_REFINED):
            more = share * (weighted @ solved(remaining))
            after = target - rows.T @ (change + more)
            if not np.linalg.norm(after) < _GAINS * np.linalg.norm(remaining):
                break
            change, remaining = change + more, after
        return change

    return solve


def _factor(normal: Any, shift: float) -> Any:
    """Factor normal + shift · I, and return the function that solves with it."""
    # A dense Cholesky factor is used where memory allows, else a sparse LU factor. Products that no multiplier touches
    # are rows of zeros, and all others fill in completely. A dense factor of these is three times as fast as a sparse
    # one.
    used = np.flatnonzero(np.diff(normal.indptr))
    if len(used) <= _IN_FULL:
        table = normal[used][:, used].toarray(order="F")
        table[np.diag_indices_from(table)] += shift
        factor, failed = lapack.dpotrf(table, lower=1, overwrite_a=1)
        if failed == 0:

            def in_full(rhs: Floats) -> Floats:
                out = np.zeros(len(rhs))
                out[used] = lapack.dpotrs(factor, rhs[used], lower=1)[0]
                return out

            return in_full
    shifted = sp.csc_matrix(normal + shift * sp.eye_array(normal.shape[0], format="csc"))
    return spla.splu(shifted, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve


def _exact_rates(modes: Modes) -> BinaryFractions:
    """Return the matrix of mode rates z = H (u, t) as fractions, without rounding."""
    # Formed from the numbers of the equilibrium matrix, as `modes` does in doubles.
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


def pair_proof(associative: Proof, analysis: LimitAnalysis, pair: PrimalDualPair | None, solves: int) -> Proof:
    """Convert a pair of forces and velocities into a proof of its load factor."""
    converged = pair is not None and bool(pair.converged)
    proof = Proof(
        status=associative.status,
        stands=associative.stands,
        associative=associative.load_factor,
        solves=solves + associative.solves,
        solve_log=[*associative.solve_log, f"zero dilation ({solves})"],
    )
    if pair is not None:
        proof.status, proof.motion, proof.found = Status.UNCERTIFIED, pair.motion, pair.state
        proof.offer_state(pair.state)
        if pair.locked:
            proof.status = Status.LOCKED
        elif converged and relative_width(*proof.bracket, analysis.load_scale) <= analysis.gap:
            proof.status = Status.COLLAPSE
    proof.extra = {
        "associative_load_factor": number(associative.load_factor * analysis.template.scaling.load),
        "friction_violation": None if pair is None else number(pair.violation),
        "complementarity_gap": None if pair is None else number(pair.relative_gap),
        "dilation": None if pair is None else number(pair.dilation),
        "converged": converged or proof.status in (Status.LOCKED, Status.UNSTABLE),
        "bracket_of": "problem with friction frozen at μN of these forces",
        "zero_dilation_iterations": solves,
    }
    return proof


_FREE_BLOCKS: Final = (
    1e-6,
    1e-4,
)  # sizes, tried in order, above which a multiplier may change without limit in a correction


_SHIFT_BLOCKS: Final = 1e-14  # regularisation of the normal equations, compensated by refinement
_REFINED_BLOCKS: Final = 40  # maximum number of steps of conjugate gradients per correction
_EXACT: Final = 1e-9  # relative residual at which these steps end


def solve_rlt_by_matrix_blocks(bounded: BoundedModes, region: Region, options: RltOptions) -> RltSolution | None:
    # The same program as that of `solve_rlt`, solved faster where faces are many.
    modes, force_bounds, pairs, slack = bounded.modes, bounded.force_bounds, options.pairs, options.slack
    count = len(modes.rows)
    unit, wide = scaling_matrix(region, force_bounds), region.high - region.low
    facts = region_forms(modes, region) @ unit
    largest = row_maxima(facts)
    local_space = LocalProductSpace(modes, region.closed, options.distance)
    held, moving = np.flatnonzero(region.held), np.flatnonzero(~region.closed)
    # Rows of `facts` are the slacks y, then λ − low, high − λ and 1; columns are mode rates, then forms of loops.
    # Products y z of held and moving modes are zero, those asked for by `pairs` are ≥ 0, and the last three rows take
    # part with each form that moves.
    equal, positive = np.zeros((2, len(facts), len(local_space.forms)), dtype=bool)
    equal[zero_product_pairs(held, moving)] = True
    positive[:count] = pairs & moving_forms(local_space.forms, region) & ~equal[:count]
    positive[count + 2] = positive[:count].any(axis=0)
    positive[count + 2, :count] = ~region.closed
    lone = lone_faces((equal | positive) & local_space.allowed_products, region.closed, modes.loops)
    positive[count : count + 2] = positive[count + 2]
    positive[count : count + 2, :count] &= modes.hinges | ~np.repeat(lone, 4)
    velocities = velocities_of(local_space, facts / largest[:, None], modes.statics @ unit, lone)
    # Minimise ((λ − low)(b_λ·u) − σ cost) / wide.
    above = np.zeros(len(unit))
    above[-2:] = 1.0, -region.low
    goal = unit.T @ (np.outer(above, modes.live_rate) - slack * cost_form(modes)) / wide @ velocities.basis
    program = ProductProgram(
        velocities.space,
        equal & local_space.allowed_products,
        positive & local_space.allowed_products,
        velocities.split(goal),
        velocities.groups,
    )
    answer = minimise_product_program(program, options.seconds, options.tolerance)
    if answer is None or not answer.accurate:
        return None
    multipliers = Multipliers(
        wide * answer.multipliers / largest[:, None], np.zeros(count + 2), region.low + wide * answer.bound
    )
    x = unit @ velocities.assemble(answer.point)
    live = modes.live_rate @ local_space.basis
    rates_of_hinges = local_space.rates * (modes.hinges | ~np.repeat(lone, 4))[:, None]
    return RltSolution(
        multipliers, combined_states(x, live, rates_of_hinges), x[-1] @ local_space.rates.T, modes.slacks @ x @ live
    )


class BlockCertifier(Certifier):
    """Certifier whose corrections are computed by small matrix blocks; distance: as in `RltOptions`."""

    def __init__(self, bounded: BoundedModes, region: Region, slack: float, distance: int | None = None) -> None:
        super().__init__(bounded, region, slack)
        self.local_space = LocalProductSpace(self.modes, region.closed, distance)
        self._equilibrium = lambda residual: self.local_space.equilibrium(self.modes.statics, residual)

    def bound(self, multipliers: Multipliers, sufficient_bound: float = math.inf) -> float:
        best = -math.inf
        lone = lone_faces(multipliers.products != 0.0, self.region.closed, self.modes.loops)
        self.unbalanced[-len(lone) :] = lone
        for self.least_free in _FREE_BLOCKS:
            best = super().bound(multipliers, sufficient_bound)
            if best > -math.inf:
                break
        return best

    def _correction(self, of_products: Floats, price: Floats) -> Any:
        """Return a function that computes changes of the multipliers from a residual R."""
        # The changes reduce R, the part of the identity in `certificate` that is not yet zero.
        largest = self.largest
        share = np.where(self.free, 1.0, np.minimum(of_products * largest[:, None] / self.least_free, 1.0))
        share = np.where((share < _GONE / self.least_free) | ~self.local_space.allowed_products, 0.0, share)
        share[:, self.closed_forms] = 0.0
        lone = lone_faces(share > 0.0, self.region.closed, self.modes.loops)
        facts = drop_rounding(self.facts * self.force_bounds / largest[:, None])
        velocities = velocities_of(self.local_space, facts, self.modes.statics * self.force_bounds, lone)
        space = velocities.space
        weights = share**2
        solved = NormalEquations(space, share > 0.0, velocities.groups).factor(weights, 1.0, _SHIFT_BLOCKS)

        def change(residual: Floats) -> tuple[BinaryFractions, BinaryFractions, BinaryFractions]:
            """Return the changes of products, live work and bound for the residual R."""
            residual_size = float(abs(residual).max(initial=0.0)) or 1.0
            parts = velocities.split(self.force_bounds[:, None] * (residual / residual_size) @ velocities.basis)
            point = solved(parts, _EXACT, _REFINED_BLOCKS)
            more, raised = weights * space.values(point), float((space.unit * point[0]).sum())
            more = np.asarray(more * (residual_size / largest[:, None]), dtype=np.float64)
            tables = (more, np.zeros((len(price), 1)), np.array([[raised * residual_size]]))
            one, two, three = (BinaryFractions.of(round_to_bits(table, 2 * BITS)) for table in tables)
            return one, two, three

        return change
