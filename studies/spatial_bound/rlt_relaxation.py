"""Linear program over products of spatial forces with velocities (RLT relaxation).

The program multiplies the conditions of `spatial_modes`. As in the plane, X = E[Φ wᵀ] of Φ = (F, λ, 1) and
w = (u, z, t): equilibrium times every w_j, ties times every Φ_i, y_k z_l ≥ 0 of given pairs, = 0 of a bending row with
its own mode, the forms that couple friction with slip, (λ − L) z ≥ 0, (U − λ) z ≥ 0, z ≥ 0, y b_λ·u ≥ 0, b_λ·u = 1
(docs/method.md (4.9)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bools, Floats
from jld_core.models.zero_dilation.bounded_modes import Region
from jld_core.models.zero_dilation.rlt_relaxation import (
    Multipliers,
    combined_states,
    null_space,
    product_rows,
    region_forms,
    scaled_forms,
    scaling_matrix,
    solve_products,
)
from studies.spatial_bound.modes import SpaceModes

_SMALL: Final = 1e-2
"""Fraction of the largest length that is added to each length, so that small vectors violate their circles less."""

_SEEN: Final = 1e-6
"""Absolute length added in the same way, a power (force times velocity)."""

_NOTHING: Final = 1e-11
"""Size of coefficients that are rounding errors of an elimination."""


@dataclass(frozen=True)
class SpaceRltSolution:
    """Solution of the spatial relaxation, as `RltSolution`.

    multipliers: those of the coupling forms follow those of (y, λ − L, U − λ) in `live`. states: (·, q + 1) forces and
    λ. violation: (k, l) how far omitted products are below zero. beyond: (2, m) largest relative violation of the
    circles by V and s, over all forms of the other factor. toward: (2, m, 2) the direction of this violation.
    disagreeing: (b,) of bending modes: min(z, 1) times y on the mean. torn: (m, 3) of s1, s2 and ω: dissipation in
    excess of that of the means. Both are powers. accurate: True if the solver reports an optimum.
    """

    multipliers: Multipliers
    states: Floats
    violation: Floats
    beyond: Floats
    toward: Floats
    disagreeing: Floats
    torn: Floats
    accurate: bool


def equal_of(modes: SpaceModes, region: Region) -> Bools:
    """Return a mask (k + 3, l) of products that are zero.

    These are opposed rows and rates, and held rows with all rates. Closed rates are excluded.
    """
    equal = np.zeros((len(modes.rows) + 3, len(modes.rates)), dtype=bool)
    moving = np.flatnonzero(~region.closed)
    equal[tuple(modes.opposed.T)] = True
    equal[np.ix_(np.flatnonzero(region.held), moving)] = True
    equal[:, region.closed] = False
    return equal


def still(modes: SpaceModes, region: Region) -> Floats:
    """Return the forms (e, w) of w that are zero: ties and closed modes."""
    return np.vstack([modes.ties, modes.rates[region.closed]]) @ modes.motions


def solve_space_rlt(
    modes: SpaceModes, region: Region, force_bounds: Floats, pairs: Bools, slack: float, seconds: float = np.inf
) -> SpaceRltSolution | None:
    """Solve the spatial relaxation with given rows y_k z_l; None if the solver fails.

    pairs: (k, l) mask of rows. force_bounds, slack, seconds and the scaling: as for `solve_rlt`.
    """
    count, columns = len(modes.rows), modes.matrix.shape[1] + 2
    basis = null_space(still(modes, region))
    motions = modes.motions @ basis
    motions[abs(motions) < _NOTHING] = 0.0
    rates = modes.rates @ motions
    rates[abs(rates) < _NOTHING] = 0.0
    live, width = modes.live_rate @ basis, basis.shape[1]
    unit, wide = scaling_matrix(region, force_bounds), region.high - region.low
    facts, largest, statics = scaled_forms(modes, region, unit)
    equal = equal_of(modes, region)
    asked = pairs & ~region.closed[None, :] & ~equal[:count] & ~region.held[:, None]
    moving = np.flatnonzero(~region.closed)
    zero, asking = np.nonzero(equal), np.nonzero(asked)
    every = np.repeat(count + np.arange(3), len(moving)), np.tile(moving, 3)
    bounds = np.arange(len(facts) - 1)
    forms, sizes_of_forms = _coupled(modes, unit, motions)
    equilibrium = np.repeat(np.arange(len(statics)), width), np.tile(np.arange(width), len(statics))
    blocks = [
        product_rows(statics, np.eye(width), *equilibrium),
        product_rows(facts, rates, *zero),
        forms,
        product_rows(facts, rates, *asking),
        product_rows(facts, rates, *every),
        product_rows(facts, live[None], bounds, np.zeros_like(bounds)),
        product_rows(facts, live[None], np.array([len(facts) - 1]), np.array([0])),
    ]
    sizes = np.array([block.shape[0] for block in blocks])
    sign_free = np.append(region.held, [False, False])
    by_live = np.where(sign_free, 0.0, np.inf)
    high = np.concatenate([np.zeros(sizes[:3].sum()), np.full(sizes[3:5].sum(), np.inf), by_live, [1.0]])
    above = np.zeros(columns)
    above[-2:] = 1.0, -region.low
    cost = modes.cost.table(0, (columns, len(motions))) @ motions
    objective = unit.T @ (np.outer(above, live) - slack * cost) / wide
    # Presolve is off because forms and products repeat some rows.
    answer = solve_products(objective, sp.vstack(blocks, format="csr"), high, seconds, presolve=False)
    if answer is None:
        return None
    dual = np.split(wide * answer.dual[:-1], np.cumsum(sizes)[:-1])
    over = np.zeros((len(facts), len(modes.rates)))
    over[zero] = dual[1]
    over[asking] = np.maximum(dual[3], 0.0)
    over[every] = np.maximum(dual[4], 0.0)
    priced = np.where(sign_free, dual[5], np.maximum(dual[5], 0.0)) / largest[:-1]
    multipliers = Multipliers(
        over / largest[:, None],
        np.concatenate([priced, dual[2] / sizes_of_forms]),
        region.low + float(dual[6][0]),
    )
    x = unit @ answer.point[:-1].reshape(columns, width)
    return _read(modes, region, x, motions, live, asked | equal[:count], multipliers, answer.found)


def _coupled(modes: SpaceModes, unit: Floats, motions: Floats) -> tuple[Any, Floats]:
    """Return the coupling forms as rows over X, each of order one, and their divisors."""
    shape = (len(unit), len(motions))
    rows, sizes = [], []
    for form in range(modes.coupled.count):
        table = sp.csr_array(sp.csr_array(unit.T) @ modes.coupled.table(form, shape) @ sp.csr_array(motions))
        largest_entry = float(abs(table.data).max(initial=0.0)) or 1.0
        rows.append(sp.csr_array(table.reshape((1, shape[0] * motions.shape[1])) / largest_entry))
        sizes.append(largest_entry)
    stacked = sp.vstack(rows, format="csr") if rows else sp.csr_array((0, shape[0] * motions.shape[1]))
    return stacked, np.array(sizes)


def _read(
    modes: SpaceModes,
    region: Region,
    x: Floats,
    motions: Floats,
    live: Floats,
    asked: Bools,
    multipliers: Multipliers,
    accurate: bool,
) -> SpaceRltSolution:
    """Compute states, violations and measures for splitting from X."""
    rates = modes.rates @ motions
    mean, seen, z = x @ live, x @ rates.T, x[-1] @ rates.T
    left_out = ~asked & ~region.closed[None, :] & ~region.held[:, None]
    bends, jumps, torn = modes.bending, motions @ x[-1], np.zeros((modes.faces, 3))
    for face in np.flatnonzero(modes.slip >= 0):
        for component, column in enumerate(modes.columns[face, [1, 2, 5]]):
            if column >= 0:
                torn[face, component] = -(x[column] @ motions[column]) - abs(mean[column] * jumps[column])
    beyond, toward = _circles(modes, region, x, motions, np.column_stack([live, rates.T]))
    return SpaceRltSolution(
        multipliers=multipliers,
        states=combined_states(x, live, rates),
        violation=np.where(left_out, np.maximum(-(modes.slacks @ seen), 0.0), 0.0),
        beyond=beyond,
        toward=toward,
        disagreeing=np.minimum(z[:bends], 1.0) * (modes.slacks @ mean)[:bends],
        torn=np.maximum(torn, 0.0),
        accurate=accurate,
    )


def _circles(modes: SpaceModes, region: Region, x: Floats, motions: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Measure how far forces and slips violate their friction circles.

    Forces are multiplied by non-negative forms of motions, slips by non-negative forms of forces.
    """
    beyond, toward = np.zeros((2, modes.faces)), np.zeros((2, modes.faces, 2))
    forces, slips = x @ weights, region_forms(modes, region) @ x @ motions.T
    for face in np.flatnonzero(modes.slip >= 0).tolist():
        pair, share = modes.columns[face, [1, 2]], modes.share[face]
        holds = modes.capacities[face] @ forces - (forces[share] if share >= 0 else 0.0)
        for side, (radius, ways) in enumerate(((holds, forces[pair].T), (slips[:, modes.slip[face]], slips[:, pair]))):
            length = np.hypot(*ways.T)
            out = (length - radius) / (length + _SMALL * float(length.max(initial=0.0)) + _SEEN)
            worst = int(np.argmax(out))
            beyond[side, face], toward[side, face] = max(float(out[worst]), 0.0), ways[worst]
    return beyond, toward
