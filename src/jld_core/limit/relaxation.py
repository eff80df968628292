"""Faces whose label is not decided: what bounds λ over all labellings that agree on the faces that are.

The relaxation of an **undecided** face is the closed hull of its dry and its inner set, docs/method.md (6.3), which the
yield set knows (`YieldSet.hull`); a set that does not leaves no relaxation.

What a mechanism then bounds is measured with the hull's own support function, max(D_dry, D_inner), whatever the
rows were: a bound is right for every labelling it speaks of, however loose the program that it came from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.lanes import CARRIES, OPEN, Lanes, chosen, fits
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.bounds import Motion, usable
from jld_core.program import ConicProgram
from jld_core.solvers import make_solver

_TINY: Final = 1e-6
"""Margins, relative to the largest jump, that are worth closing by opening all faces a little."""

_ANY: Final = 1e12
"""A scaled λ above any that is of use."""

_RESIDUAL: Final = 1e-10
"""Asked of the solver: bounds are computed from its answer, so that it need not be exact."""


@dataclass(frozen=True)
class DualBound:
    """Why no labelling that agrees on some faces reaches a load factor.

    excess: threshold · b_λ·u + b·u − Σ D, above zero with what rounding may take. cost: (m,) what a face takes from
    the excess when it becomes undecided, inf where the mechanism bounds nothing then. bound: λ that no such
    labelling exceeds, scaled; −inf where none stands.
    """

    excess: float
    cost: Floats
    bound: float


class Relaxation:
    """Upper bounds on λ for partial labellings of one assembly.

    analysis: of the assembly; template, prover and the motion that opens all faces are shared with it.
    """

    def __init__(self, analysis: LimitAnalysis) -> None:
        self.template = analysis.template
        self._prover, self._interior = analysis.prover, analysis.interior
        hull = self.template.yield_set.hull()
        if hull is None:
            raise TypeError("no hull is known of these yield sets")
        self._open = self.template.with_rows(hull)
        self._lanes: Lanes | None = None
        if chosen() is not None and fits(self.template, hull):
            opening = analysis.interior.opening()
            velocity = None if opening is None else opening.velocity
            self._lanes = Lanes(self.template, velocity, zero=analysis.floor, undecided=hull)
        self._route = make_solver("clarabel", tolerance=max(_RESIDUAL, self.template.precision.residual))
        self._margin = max(_RESIDUAL, self.template.precision.margin)
        self.solves = 0

    def program(self, labels: Bits, undecided: Bools) -> ConicProgram:
        """The program of a partial labelling: labels (m,) True dry, of no force where undecided (m,)."""
        return self.template.program(labels, self._margin, other=self._open, taken=undecided)

    def refute(self, labels: Bits, undecided: Bools, threshold: float) -> DualBound | None:
        """A proof that no labelling that agrees where decided reaches a scaled λ; None where there is none.

        labels: (m,) True dry. undecided: (m,). threshold: scaled λ.
        """
        return self.refute_all(labels[None], undecided[None], np.array([threshold]))[0]

    def refute_all(self, labellings: Bits, undecided: Bools, thresholds: Floats) -> list[DualBound | None]:
        """The same for labellings and undecided faces (k, m) and thresholds (k,): at once where the kernel can."""
        count = len(labellings)
        self.solves += count
        found: list[DualBound | None] = [None] * count
        left = list(range(count))
        if self._lanes is not None:
            answers = self._lanes.solve(labellings, undecided=undecided, thresholds=thresholds, vectors=True)
            assert answers.velocity is not None
            left = []
            for k in range(count):
                # forces that carry more are a hint: to refute nothing is never wrong
                if answers.verdict[k] == CARRIES:
                    continue
                if answers.verdict[k] == OPEN:
                    left.append(k)
                else:
                    found[k] = self._weighed(answers.velocity[k], labellings[k], undecided[k], float(thresholds[k]))
        for k in left:
            raw = self._route.solve(self.program(labellings[k], undecided[k]))
            velocity = raw.dual[: self.template.matrix.shape[0]]
            found[k] = self._weighed(velocity, labellings[k], undecided[k], float(thresholds[k]))
        return found

    def _weighed(self, velocity: Floats, labels: Bits, undecided: Bools, threshold: float) -> DualBound | None:
        """What velocities bound, as they are or with a little of a motion that opens all faces."""
        if not usable(velocity):
            return None
        size = float(abs(velocity).max())
        if not size > 0.0:
            return None
        motion = self._prover.motion(velocity / size, labels, normalise=False)
        found = self._weigh(motion, labels, undecided, threshold)
        return found if found is not None else self._weigh(self._parted(motion), labels, undecided, threshold)

    def bound(self, labels: Bits, undecided: Bools) -> float:
        """Scaled λ that no labelling exceeds that agrees where decided; inf where none was found."""
        found = self.refute(labels, undecided, _ANY)
        return np.inf if found is None else found.bound

    def _parted(self, motion: Motion) -> Motion:
        """A motion with a little of one that opens all faces added to it."""
        opening = self._interior.opening()
        if opening is None:
            return motion
        share = 1e-9 * float(abs(motion.velocity).max()) / float(abs(opening.velocity).max())
        velocity = motion.velocity + share * opening.velocity
        return self._prover.motion(velocity, np.ones(len(motion.jumps), dtype=bool), normalise=False)

    def _weigh(self, motion: Motion, labels: Bits, undecided: Bools, threshold: float) -> DualBound | None:
        sets, jumps = self.template.yield_set, motion.jumps
        if not usable(motion.velocity):
            return None
        every = np.ones(len(labels), dtype=bool)
        finite = np.array([sets.margin(jumps, every), sets.margin(jumps, ~every)])
        motion, finite = self._opened(motion, finite, labels, undecided)
        jumps = motion.jumps
        dissipation = np.array([sets.dissipation(jumps, every), sets.dissipation(jumps, ~every)])
        dissipation = np.where(finite >= 0.0, dissipation, np.inf)
        either = dissipation.max(axis=0)
        own = np.where(undecided, either, np.where(labels, dissipation[0], dissipation[1]))
        work = float(self.template.live @ motion.velocity)
        if abs(work) < tolerances.ROUNDING * float(abs(self.template.live) @ abs(motion.velocity)):
            work = 0.0  # what is left of terms that cancel bounds nothing
        dead = float(self.template.dead @ motion.velocity)
        total = float(own.sum()) - dead
        if not np.isfinite(total) or work < 0.0:
            return None
        total += self._prover.noise(motion.velocity, total)
        excess = threshold * work - total
        if not excess > 0.0:
            return None
        with np.errstate(invalid="ignore"):
            cost = np.where(undecided, 0.0, either - own)
        bound = total / work if work > 0.0 else -np.inf
        return DualBound(excess, cost, bound)

    def _opened(self, motion: Motion, finite: Floats, labels: Bits, undecided: Bools) -> tuple[Motion, Floats]:
        """The motion with just the opening added that margins missed by rounding need, and the margins then."""
        opening = self._interior.opening()
        reach = _TINY * max(float(abs(motion.jumps).max()), 1e-300)
        missed = (finite < 0.0) & (finite > -reach)
        if opening is None or not missed.any():
            return motion, finite
        share = 1.01 * float(-finite[missed].min()) / opening.margin
        every = np.ones(len(labels), dtype=bool)
        motion = self._prover.motion(motion.velocity + share * opening.velocity, every, normalise=False)
        sets = self.template.yield_set
        return motion, np.array([sets.margin(motion.jumps, every), sets.margin(motion.jumps, ~every)])
