"""Record of what is proven about one labelling: bounds, status and solve log."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits
from jld_core.batch.batch_solver import LOCKED, BatchResults
from jld_core.limit.bounds import Motion, Prover, State, relative_width
from jld_core.limit.options import Status


@dataclass
class Proof:
    """Bounds proven so far for one labelling of a template, scaled as in the template.

    Attributes
    ----------
    state : State or None
        Admissible forces of the lower bound.
    motion : Motion or None
        Mechanism of the upper bound.
    ray : State or None
        Ray that carries the live load for every larger λ, docs/method.md (3.14).
    collapse_below_zero : Motion or None
        Mechanism that proves that no λ ≥ 0 is admissible, docs/method.md (3.15).
    solve_log : list of str
        Names of the methods tried, in order.
    solves : int
        Number of programs solved.
    guess : float
        λ without proof, NaN where there is none.
    status : Status
        Outcome that the proof supports.
    stands : bool or None
        True if λ = 0 is admissible, False if not; None where undecided.
    found : State or None
        Forces to report where they differ from those of the lower bound. With zero dilation they may violate friction.
    associative : float
        λ with associative friction, of a zero-dilation proof.
    outbid : bool
        True if a zero-dilation proof stopped at its associative λ, because that is too low to be of interest.
    seconds : float
        Wall-clock time.
    extra : dict
        Further facts of the model, as in the JSON output.
    notes : list of str
        The same facts in sentences.
    """

    state: State | None = None
    motion: Motion | None = None
    ray: State | None = None
    collapse_below_zero: Motion | None = None
    solve_log: list[str] = field(default_factory=list)
    solves: int = 0
    guess: float = math.nan
    status: Status = Status.UNCERTIFIED
    stands: bool | None = None
    found: State | None = None
    associative: float = math.nan
    outbid: bool = False
    seconds: float = 0.0
    extra: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def offer_state(self, state: State) -> None:
        """Keep an admissible state if its λ is the highest so far, by more than rounding."""
        # A λ above that of an exact state (error zero) by less than rounding proves no more than the exact state.
        if not state.admissible:
            return
        known = self.state
        exact = known is not None and known.error == 0.0
        if known is None or state.load > known.load + (tolerances.ROUNDING if exact else 0.0):
            self.state = state

    def offer_motion(self, motion: Motion) -> None:
        """Keep a motion of live work 1 and margin ≥ 0 if its bound is the lowest so far."""
        if motion.margin >= 0.0 and motion.work > 0.0 and (self.motion is None or motion.bound < self.motion.bound):
            self.motion = motion

    @property
    def crossed(self) -> bool:
        """Return True if the bounds contradict each other by more than rounding.

        In that case neither bound is reliable.
        """
        if self.state is None or self.motion is None:
            return False
        # Same test as `brackets.crossed`, which accepts arrays and takes ten times as long.
        low, high = self.state.load, self.motion.bound
        return bool(low - high > 10.0 * tolerances.ROUNDING * max(abs(low), abs(high), 1.0))

    @property
    def low(self) -> float:
        """Return the proven lower bound on λ, scaled; −inf where there is none."""
        if self.state is None or self.crossed:
            return -math.inf
        return self.state.load if self.motion is None else min(self.state.load, self.motion.bound)

    @property
    def high(self) -> float:
        """Return the proven upper bound on λ, scaled; +inf where there is none."""
        if self.motion is None or self.crossed:
            return math.inf
        if self.state is None:
            return self.motion.bound
        above = self.motion.bound - self.state.load
        # Next to the state without forces at λ = 0, the rounding of a bound proves no width.
        nothing = self.state.error == 0.0 and self.state.load == 0.0
        at_state = above < 0.0 or (nothing and above <= self.motion.noise)
        return self.state.load if at_state else self.motion.bound

    @property
    def bracket(self) -> tuple[float, float]:
        """Return the proven bounds on λ, scaled; NaN if unproven or infinite, or if no λ exists."""
        low = self.low if math.isfinite(self.low) else math.nan
        high = self.high if math.isfinite(self.high) else math.nan
        if self.status is Status.UNSTABLE:
            return math.nan, math.nan
        return (low, math.nan) if self.status is Status.LOCKED else (low, high)

    @property
    def load_factor(self) -> float:
        """Return λ of the forces found, else of the bracket: its middle if narrow, its lower end; else the guess."""
        if self.status in (Status.UNSTABLE, Status.LOCKED):
            return math.nan
        if self.found is not None:
            return self.found.load
        low, high = self.bracket
        if math.isnan(low) or math.isnan(high):
            return self.guess if self.status is Status.UNCERTIFIED else math.nan
        is_wide = relative_width(low, high, tolerances.GAP_FLOOR) > tolerances.GAP
        return low if is_wide else 0.5 * (low + high)


FACES_WHERE_BATCH_IS_FASTER: Final = (48, 400)
"""Least and largest number of faces of a spatial assembly for which the batch solver is faster for one labelling.

Its setup is included. Source: benchmarks/results/batch_solver_single.md.
"""


def offer_results(
    found: BatchResults, labels: Bits, proof: Proof, prover: Prover, opening: Callable[[], Motion | None]
) -> None:
    """Check the batch solver's bounds of one labelling, and add the valid ones to a proof."""
    if found.forces is None:
        return
    if np.isfinite(found.low[0]):
        proof.offer_state(prover.state(np.append(found.forces[0], found.low[0]), labels))
    if found.verdict[0] == LOCKED and found.rays is not None:
        ray = prover.ray(np.append(found.rays[0], 1.0), labels)
        proof.ray = ray if prover.is_ray(ray) else proof.ray
    elif found.velocity is not None and found.velocity[0].any():
        motion = prover.motion(found.velocity[0], labels)
        wider = opening() if motion.margin < 0.0 else None
        proof.offer_motion(motion if wider is None else prover.add_opening(motion, wider, labels))
