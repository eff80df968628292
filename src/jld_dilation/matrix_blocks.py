"""Solve the program over products by matrix blocks along the graph of velocities.

Slides that are multiplied with their own face only have four products per face instead of a column of X. The result
contains multipliers like those of `solve_rlt`; a certificate decides what they prove.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from jld_core import Floats
from jld_dilation.certificate import BITS, BinaryFractions, Certifier, drop_rounding, round_to_bits
from jld_dilation.interior_point import ProductProgram, minimise_product_program
from jld_dilation.modes import BoundedModes, Region
from jld_dilation.normal_equations import NormalEquations
from jld_dilation.product_space import LocalProductSpace, lone_faces, velocities_of
from jld_dilation.rlt_relaxation import (
    Multipliers,
    RltOptions,
    RltSolution,
    combined_states,
    cost_form,
    moving_forms,
    region_forms,
    row_maxima,
    scaling_matrix,
    zero_product_pairs,
)

_FREE: Final = (1e-6, 1e-4)  # sizes, tried in order, above which a multiplier may change without limit in a correction

_GONE: Final = 1e-14  # size below which a multiplier counts as zero

_SHIFT: Final = 1e-14  # regularisation of the normal equations, compensated by refinement

_REFINED: Final = 40  # maximum number of steps of conjugate gradients per correction

_EXACT: Final = 1e-9  # relative residual at which these steps end


def solve_rlt_by_matrix_blocks(bounded: BoundedModes, region: Region, options: RltOptions) -> RltSolution | None:
    """Solve the RLT relaxation of one region by matrix blocks; None without convergence."""
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
    whole = local_space.rates * (modes.hinges | ~np.repeat(lone, 4))[:, None]
    return RltSolution(
        multipliers, combined_states(x, live, whole), x[-1] @ local_space.rates.T, modes.slacks @ x @ live
    )


class BlockCertifier(Certifier):
    """Certifier whose corrections are computed by small matrix blocks; distance: as in `RltOptions`."""

    def __init__(self, bounded: BoundedModes, region: Region, slack: float, distance: int | None = None) -> None:
        super().__init__(bounded, region, slack)
        self.local_space = LocalProductSpace(self.modes, region.closed, distance)
        self._equilibrium = lambda rest: self.local_space.equilibrium(self.modes.statics, rest)

    def bound(self, multipliers: Multipliers, sufficient_bound: float = math.inf) -> float:
        found = -math.inf
        lone = lone_faces(multipliers.products != 0.0, self.region.closed, self.modes.loops)
        self.unbalanced[-len(lone) :] = lone
        for self.least_free in _FREE:
            found = super().bound(multipliers, sufficient_bound)
            if found > -math.inf:
                break
        return found

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
        solved = NormalEquations(space, share > 0.0, velocities.groups).factor(weights, 1.0, _SHIFT)

        def change(rest: Floats) -> tuple[BinaryFractions, BinaryFractions, BinaryFractions]:
            """Return the changes of products, live work and bound for the residual R in `rest`."""
            residual_size = float(abs(rest).max(initial=0.0)) or 1.0
            left = velocities.split(self.force_bounds[:, None] * (rest / residual_size) @ velocities.basis)
            point = solved(left, _EXACT, _REFINED)
            more, raised = weights * space.values(point), float((space.unit * point[0]).sum())
            more = np.asarray(more * (residual_size / largest[:, None]), dtype=np.float64)
            tables = (more, np.zeros((len(price), 1)), np.array([[raised * residual_size]]))
            one, two, three = (BinaryFractions.of(round_to_bits(table, 2 * BITS)) for table in tables)
            return one, two, three

        return change
