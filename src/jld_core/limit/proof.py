"""What is proven of one labelling: bounds, status, and how they were come by."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from jld_core import tolerances
from jld_core.limit.bounds import Motion, State
from jld_core.limit.status import Status


@dataclass
class Proof:
    """What has been proven so far about one labelling of a template, scaled as in it, and by what.

    status: what it amounts to. state, motion: of the lower and the upper bound. ray: a way to carry ever more.
    collapse_below_zero: a motion that no λ ≥ 0 holds up. found: forces that are reported where they are not those of
    the lower bound (without dilation, where forces may violate friction). guess: λ without proof. associative: λ with
    associative friction, of a proof without dilation. outbid: left at an upper bound that is below what matters.
    stands: is λ = 0 admissible? route, solves, seconds: what was done. extra: what the model has to say besides.
    notes: the same in sentences.
    """

    state: State | None = None
    motion: Motion | None = None
    ray: State | None = None
    collapse_below_zero: Motion | None = None
    route: list[str] = field(default_factory=list)
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
        """Keep an admissible state if its λ is the highest so far.

        A λ above that of an exact state (error zero) by less than rounding proves no more than that state.
        """
        if not state.admissible:
            return
        known = self.state
        exact = known is not None and known.error == 0.0
        if known is None or state.load > known.load + (tolerances.ROUNDING if exact else 0.0):
            self.state = state

    def offer_motion(self, motion: Motion) -> None:
        """Keep a motion with finite dissipation if its bound is the lowest so far."""
        if motion.margin >= 0.0 and motion.work > 0.0 and (self.motion is None or motion.bound < self.motion.bound):
            self.motion = motion

    @property
    def crossed(self) -> bool:
        """Do the two proofs contradict each other by more than rounding? Then neither is to be relied on."""
        if self.state is None or self.motion is None:
            return False
        low, high = self.state.load, self.motion.bound  # as `bounds.crossed`, which takes arrays and ten times as long
        return bool(low - high > 10.0 * tolerances.ROUNDING * max(abs(low), abs(high), 1.0))

    @property
    def low(self) -> float:
        """Proven lower bound, scaled; −inf where there is none."""
        if self.state is None or self.crossed:
            return -math.inf
        return self.state.load if self.motion is None else min(self.state.load, self.motion.bound)

    @property
    def high(self) -> float:
        """Proven upper bound, scaled; +inf where there is none."""
        if self.motion is None or self.crossed:
            return math.inf
        if self.state is None:
            return self.motion.bound
        above = self.motion.bound - self.state.load
        # beside the state of no force at λ = 0 the rounding of a bound proves no width
        nothing = self.state.error == 0.0 and self.state.load == 0.0
        at_state = above < 0.0 or (nothing and above <= self.motion.noise)
        return self.state.load if at_state else self.motion.bound

    @property
    def bracket(self) -> tuple[float, float]:
        """Ends of λ, scaled; NaN where unproven, infinite, or where it is proven that there is no λ."""
        low = self.low if math.isfinite(self.low) else math.nan
        high = self.high if math.isfinite(self.high) else math.nan
        if self.status is Status.UNSTABLE:
            return math.nan, math.nan
        return (low, math.nan) if self.status is Status.LOCKED else (low, high)

    @property
    def load_factor(self) -> float:
        """λ, scaled: of the forces found, else the middle of the bracket, else a guess; NaN where there is none."""
        if self.status in (Status.UNSTABLE, Status.LOCKED):
            return math.nan
        if self.found is not None:
            return self.found.load
        low, high = self.bracket
        middle = 0.5 * (low + high)
        return self.guess if self.status is Status.UNCERTIFIED and math.isnan(middle) else middle
