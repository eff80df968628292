"""Upper bounds of partial labellings: velocity fields for any labels of undecided faces.

An undecided face dissipates at most the larger of its dissipations under the two labels, and obeys both flow rules.
Formulas: docs/method.md (9.15) and (9.16).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.fields.adaptive import finer_by_dissipation
from jld_core.fields.mesh import Mesh
from jld_core.fields.opening import Settling
from jld_core.fields.problem import Problem
from jld_core.fields.transfer import REPAIRED, FieldMechanism, weighed
from jld_core.fields.upper import UpperBound

# Multiples of a motion under the dead load alone that are added to a mechanism, in the order tried
_FAR: Final = (1e2, 1e4, 1e6)

# Largest distance of the bound of a repaired field from the solver's objective, relative, at which nothing else is
# tried
_COST: Final = 1e-3

_LEAST: Final = -1.0  # scaled bound that is stated for collapse under the dead load alone: any larger bound holds too


@dataclass(frozen=True)
class WeighedField:
    """Velocity field with the bound that it proves for a partial labelling."""

    velocity: Floats  # (t, 3, 2) velocities at the corners of the triangles, scaled
    mechanism: FieldMechanism  # dissipation of the field in the blocks and on faces, scene units of λ
    bound: float  # λ that no labelling exceeds that agrees on the decided faces, scene units


class PartialUpperBound:
    """Upper bounds on λ of partial labellings on one mesh; many: see `ConeProgram`."""

    def __init__(self, problem: Problem, many: bool = False) -> None:
        self._upper, self._many = UpperBound(problem, many), many
        self._settling: Settling | None = None
        self._weightless: PartialUpperBound | None = None
        joints, material = problem.joints, problem.material
        # the flow rule that asks for more opening is the one that undecided faces are moved onto
        self._as_dry = (joints.friction >= material.friction) & np.isinf(joints.crushing)
        self.solves = 0

    def field(self, labels: Bits, undecided: Bools) -> WeighedField | None:
        """Find the velocity field with the least bound for a partial labelling; None where none is finite."""
        p = self._upper.problem
        self.solves += 1
        answer = self._upper.propose(labels, undecided)
        ray = answer.status == "DualInfeasible"
        if not (answer.usable or ray):
            return None
        velocity = answer.point[: 6 * len(p.mesh)].reshape(-1, 3, 2)
        if ray:
            return self._along(velocity, labels, undecided)
        wanted = (1.0 + _COST) * answer.objective if answer.objective > 0.0 else (1.0 - _COST) * answer.objective
        found = self._least(velocity, labels, undecided, wanted * p.units.load)
        if found is not None and found.bound <= wanted * p.units.load:
            return found
        if self._settling is None:
            self._settling = Settling(p)
        own = np.where(undecided, self._as_dry, labels)
        near = self._settling.settled(velocity, p.is_dry(own))
        both = [found, self._least(near, labels, undecided, wanted * p.units.load)]
        return min((one for one in both if one is not None), key=lambda one: one.bound, default=None)

    def weigh(self, velocity: Floats) -> FieldMechanism | None:
        """Compute the bounds that velocities (t, 3, 2) prove, without a solver; None where they prove nothing."""
        return weighed(self._upper, velocity)

    def finer(self, mesh: Mesh, velocity: Floats, labels: Bits, undecided: Bools) -> Mesh:
        """Refine the mesh where a velocity field dissipates most, undecided faces taken as inner."""
        upper = self._upper
        power = upper.power(upper.rates(velocity), labels & ~undecided, upper.allowance(velocity))
        return finer_by_dissipation(mesh, power)

    def _least(self, velocity: Floats, labels: Bits, undecided: Bools, enough: float) -> WeighedField | None:
        """Repair velocities by each of `REPAIRED`; return those of least bound, or None."""
        # The first with a bound of at most `enough` (λ, scene units) ends the attempts.
        best: WeighedField | None = None
        for share in REPAIRED:
            moved = self._upper.repaired(velocity, share)
            found = weighed(self._upper, moved)
            bound = np.inf if found is None else found.bound_of(labels, undecided)
            if found is not None and np.isfinite(bound) and (best is None or bound < best.bound):
                best = WeighedField(moved, found, float(bound))
                if bound <= enough:
                    break
        return best

    def _along(self, ray: Floats, labels: Bits, undecided: Bools) -> WeighedField | None:
        """Return a field that proves collapse under the dead load alone, or None."""
        # The field is a mechanism of the live load plus a large multiple of `ray`, (t, 3, 2), along which the program
        # is unbounded.
        p, size = self._upper.problem, float(abs(ray).max())
        if self._weightless is None:
            self._weightless = PartialUpperBound(p.without_dead_load(), self._many)
        base = self._weightless.field(labels, undecided)
        if base is None or not size > 0.0:
            return None
        ray = ray * (float(abs(base.velocity).max()) / size)
        least = _LEAST * p.units.load
        for far in _FAR:
            found = self._least(base.velocity + far * ray, labels, undecided, least)
            if found is not None and found.bound <= least:
                return WeighedField(found.velocity, found.mechanism, least)
        return None
