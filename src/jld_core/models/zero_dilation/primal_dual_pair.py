"""Pairs of forces and velocities: candidates for solutions of friction without dilation."""

from __future__ import annotations

import math
from dataclasses import dataclass

from jld_core import tolerances
from jld_core.limit import Motion, State


@dataclass(frozen=True)
class PrimalDualPair:
    """Forces and velocities evaluated as one candidate solution, scaled.

    A frozen problem is one whose friction is fixed at μN of the state, docs/method.md (4.1).

    state: forces in equilibrium. They lie inside the true friction cone if repairs succeeded. motion: mechanism of the
    frozen problem; None if none has finite dissipation. locked: True if the frozen problem has no finite λ. violation:
    largest excess of friction (|V| − μN)⁺ over the largest N. dilation: largest dilation of pressed faces over the
    largest slip; inf without a mechanism. gap: complementarity gap Γ, docs/method.md (4.3); inf without a mechanism.
    dissipation: σ D_N(J), docs/method.md (4.5). area_change: change of effective areas that the forces require; 0
    without effective areas. load_scale: scaled λ below which λ counts as zero. settled: True if λ of the last two
    programs agree: minimisation of Γ, and frozen problem.
    """

    state: State
    motion: Motion | None
    locked: bool
    violation: float
    dilation: float
    gap: float
    dissipation: float
    area_change: float
    load_scale: float
    settled: bool

    @property
    def relative_gap(self) -> float:
        """Return the complementarity gap relative to the dissipation; inf without a mechanism.

        Where nothing dissipates, as in pure rocking, the gap is relative to the work of the loads.
        """
        if self.motion is None:
            return math.inf
        work = max(abs(self.state.load), abs(self.motion.bound), self.load_scale)
        size = self.dissipation if self.dissipation > 1e-6 * work else work
        return abs(self.gap) / size if size > 0.0 else math.inf

    def bracket_within(self, width: float) -> bool:
        """Return True if λ of the forces and of the velocities agree within a relative width."""
        if self.motion is None:
            return False
        size = max(abs(self.state.load), abs(self.motion.bound), self.load_scale)
        return abs(self.motion.bound - self.state.load) <= width * size

    def is_solution(self, width: float) -> bool:
        """Return True if the pair is an admissible, converged solution with a narrow bracket.

        width: largest relative width of the bracket.
        """
        return not self.locked and self.state.admissible and self.converged and self.bracket_within(width)

    @property
    def converged(self) -> bool:
        """Return True if the pair meets all tolerances of a solution, docs/method.md (4.3), (4.5)."""
        if self.motion is None:
            return False
        return (
            self.violation <= tolerances.VIOLATION
            and self.dilation <= tolerances.DILATION
            and self.relative_gap <= tolerances.COMPLEMENTARITY
            and self.settled
            and self.area_change <= tolerances.FIXED_POINT
        )


def rank(pair: PrimalDualPair) -> tuple[bool, bool, float]:
    """Return a sort key of a pair: greater keys are better candidates.

    Solutions come before admissible pairs, these before others, and a small gap Γ before a large one.
    """
    return pair.is_solution(tolerances.GAP), pair.state.admissible, -pair.gap
