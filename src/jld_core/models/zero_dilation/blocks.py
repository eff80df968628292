"""Solve the program over products by matrix blocks along the graph of velocities.

Slides that are multiplied with their own face only have four products per face instead of a column of X. The result
contains multipliers like those of `relax`; a certificate decides what they prove.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bools, Floats
from jld_core.models.zero_dilation.binary_fractions import BITS, BinaryFractions, cut
from jld_core.models.zero_dilation.certificate import Certifier, clean
from jld_core.models.zero_dilation.interior import ProductProgram, minimise
from jld_core.models.zero_dilation.modes import Modes
from jld_core.models.zero_dilation.normal import NormalEquations
from jld_core.models.zero_dilation.product_space import LocalProductSpace, lone_faces, velocities_of
from jld_core.models.zero_dilation.rlt_relaxation import (
    Multipliers,
    Region,
    cost_of,
    equal_pairs,
    extended,
    mixed,
    moving_forms,
    row_sizes,
    units_of,
)

_FREE: Final = (1e-6, 1e-4)
"""Sizes, tried in order, above which a multiplier may change without limit in a correction."""

_GONE: Final = 1e-14
"""Size below which a multiplier counts as zero."""

_SHIFT: Final = 1e-14
"""Regularisation of the normal equations, compensated by refinement."""

_REFINED: Final = 40
"""Maximum number of steps of conjugate gradients per correction."""

_EXACT: Final = 1e-9
"""Relative residual at which these steps end."""


@dataclass(frozen=True)
class BlockAnswer:
    """Multipliers of a relaxation, and means and states computed from X.

    states: (k, 3m + 1) forces and λ that X combines. rates, slacks: (4m,) mean z and mean y.
    """

    multipliers: Multipliers
    states: Floats
    rates: Floats
    slacks: Floats


def relax_in_blocks(
    modes: Modes,
    region: Region,
    size: Floats,
    pairs: Bools,
    slack: float,
    seconds: float,
    distance: int | None = None,
    exact: float | None = None,
) -> BlockAnswer | None:
    """Solve the program of `relax` by matrix blocks; None if the method does not converge.

    Parameters as for `relax`. distance: number of faces within which a velocity is multiplied with forces and
    equilibrium, None: all of them. exact: tolerance, as for `minimise`. With a large tolerance multipliers are larger
    and easier to make exact.
    """
    count = len(modes.rows)
    unit, wide = units_of(region, size), region.high - region.low
    facts = extended(modes, region) @ unit
    largest = row_sizes(facts)
    around = LocalProductSpace(modes, region.closed, distance)
    held, moving = np.flatnonzero(region.held), np.flatnonzero(~region.closed)
    equal, positive = np.zeros((2, len(facts), len(around.forms)), dtype=bool)
    equal[equal_pairs(held, moving)] = True
    positive[:count] = pairs & moving_forms(around.forms, region) & ~equal[:count]
    positive[count + 2] = positive[:count].any(axis=0)
    positive[count + 2, :count] = ~region.closed
    lone = lone_faces((equal | positive) & around.products, region.closed, modes.loops)
    positive[count : count + 2] = positive[count + 2]
    positive[count : count + 2, :count] &= modes.hinges | ~np.repeat(lone, 4)
    velocities = velocities_of(around, facts / largest[:, None], modes.statics @ unit, lone)
    above = np.zeros(len(unit))
    above[-2:] = 1.0, -region.low
    goal = unit.T @ (np.outer(above, modes.live_rate) - slack * cost_of(modes)) / wide @ velocities.basis
    program = ProductProgram(
        velocities.space,
        equal & around.products,
        positive & around.products,
        velocities.split(goal),
        velocities.groups,
    )
    answer = minimise(program, seconds, exact)
    if answer is None or not answer.sure:
        return None
    multipliers = Multipliers(
        wide * answer.multipliers / largest[:, None], np.zeros(count + 2), region.low + wide * answer.bound
    )
    x = unit @ velocities.joined(answer.point)
    live = modes.live_rate @ around.basis
    whole = around.rates * (modes.hinges | ~np.repeat(lone, 4))[:, None]
    return BlockAnswer(multipliers, mixed(x, live, whole), x[-1] @ around.rates.T, modes.slacks @ x @ live)


class BlockCertifier(Certifier):
    """Certifier whose corrections are computed by matrix blocks; the proof is the same.

    distance: as given to `relax_in_blocks`.
    """

    def __init__(
        self, modes: Modes, region: Region, slack: float, size: Floats, reach: Floats, distance: int | None = None
    ) -> None:
        super().__init__(modes, region, slack, size, reach)
        self.around = LocalProductSpace(modes, region.closed, distance)
        self._equilibrium = lambda rest: self.around.equilibrium(modes.statics, rest)

    def bound(self, multipliers: Multipliers, enough: float = math.inf) -> float:
        """Return the bound of multipliers, or a bound close to it, if proven; −inf if not.

        enough: bound at which refinement of the certificate ends.
        """
        found = -math.inf
        lone = lone_faces(multipliers.over != 0.0, self.region.closed, self.modes.loops)
        self.alone[-len(lone) :] = lone
        for self.least_free in _FREE:
            found = super().bound(multipliers, enough)
            if found > -math.inf:
                break
        return found

    def _correction(self, over: Floats, price: Floats) -> Any:
        """Return a function from the residual R to the change of multipliers that reduces R."""
        largest = self.largest
        share = np.where(self.free, 1.0, np.minimum(over * largest[:, None] / self.least_free, 1.0))
        share = np.where((share < _GONE / self.least_free) | ~self.around.products, 0.0, share)
        share[:, self.still] = 0.0
        lone = lone_faces(share > 0.0, self.region.closed, self.modes.loops)
        facts = clean(self.facts * self.size / largest[:, None])
        velocities = velocities_of(self.around, facts, self.modes.statics * self.size, lone)
        space = velocities.space
        weights = share**2
        solved = NormalEquations(space, share > 0.0, velocities.groups).factor(weights, 1.0, _SHIFT)

        def change(rest: Floats) -> tuple[BinaryFractions, BinaryFractions, BinaryFractions]:
            """Return the changes of `over`, `live` and `bound` for a residual."""
            size = float(abs(rest).max(initial=0.0)) or 1.0
            left = velocities.split(self.size[:, None] * (rest / size) @ velocities.basis)
            point = solved(left, _EXACT, _REFINED)
            more, raised = weights * space.values(point), float((space.unit * point[0]).sum())
            more = np.asarray(more * (size / largest[:, None]), dtype=np.float64)
            tables = (more, np.zeros((len(price), 1)), np.array([[raised * size]]))
            one, two, three = (BinaryFractions.of(cut(table, 2 * BITS)) for table in tables)
            return one, two, three

        return change
