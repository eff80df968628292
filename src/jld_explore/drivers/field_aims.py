"""What a proof by fields finds out: the strongest layout, that of every count, or the best count above a factor.

A proof has one **target** after the other: labellings whose count lies in some range, and the governing factor above
which no mechanism may leave one of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, Protocol

import numpy as np

from jld_core.arrays import Bools, Floats
from jld_core.errors import ParameterError
from jld_explore.drivers.exact.proof_check import Claim
from jld_explore.drivers.exact.targets import counts_of, front_count
from jld_explore.space import Count, SearchSpace
from jld_explore.space.measures import Range

_BELOW: Final = 1e-9
"""Relative distance from best / (1 − gap), below which a bound ends, that covers rounding of the gap."""


class ProofAim(Protocol):
    """Aim of a proof; `best` maps counts to the largest factor that a layout of that count is proven to carry.

    Attributes
    ----------
    count : Count or None
        Count that targets are told apart by; None where there is one target alone.
    gap : float
        Relative distance between the best lower bound and the bound at which a target is reached.
    in_steps : bool
        Whether a bound far above the goal is lowered in steps.
    """

    count: Count | None
    gap: float
    in_steps: bool

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        """Return the count of the labellings to refute now, bounds on it, or None for all labellings."""
        ...

    def goal(self, best: Mapping[int, float]) -> float:
        """Return the governing factor above which labellings of the target must be refuted."""
        ...

    def enough(self, best: Mapping[int, float]) -> float:
        """Return the governing factor below which a lower bound of a labelling of the target is of no use."""
        ...

    def restart(self) -> None:
        """Return to the first target."""
        ...

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        """Take the bound of the target, and the counts (k,) of its labellings that stay open, and go to the next.

        Returns
        -------
        float or None
            Known bound of the next target; None where the proof ends.
        """
        ...

    def claims(self) -> list[Claim]:
        """Return what is to be checked at the end."""
        ...

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        """Return entries of the summary; `sure` is False where the proof did not pass its check."""
        ...


def goal_of(best: float, gap: float) -> float:
    """Return the factor above which labellings are refuted for a best known one, 0 where none stands."""
    if best <= 0.0:
        return 0.0
    return best / (1.0 - gap) * (1.0 - _BELOW) if gap < 1.0 else math.inf


def holds(target: int | Range | None, counts: Floats) -> Bools:
    """Return (k,) which counts (k,) belong to a target."""
    if target is None:
        return np.ones(len(counts), dtype=bool)
    return ~target.outside(counts) if isinstance(target, Range) else np.asarray(counts == target)


class StrongestAim:
    """Prove the strongest layout; parameters and attributes are those of `ProofAim`."""

    count: Count | None = None
    in_steps = True

    def __init__(self, gap: float) -> None:
        self.gap = gap
        self.restart()

    def restart(self) -> None:
        """Forget the bound; see `ProofAim`."""
        self._bound = math.inf

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        """Return None: all labellings; see `ProofAim`."""
        return None

    def goal(self, best: Mapping[int, float]) -> float:
        """Return the best factor over one minus the gap; see `ProofAim`."""
        return goal_of(self.enough(best), self.gap)

    def enough(self, best: Mapping[int, float]) -> float:
        """Return the best factor; see `ProofAim`."""
        return max(best.values(), default=-math.inf)

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        """End the proof; see `ProofAim`."""
        self._bound = bound
        return None

    def claims(self) -> list[Claim]:
        """Return the bound on all labellings; see `ProofAim`."""
        return [Claim(None, max(self._bound, 0.0))]

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        """Return nothing beside bound and gap; see `ProofAim`."""
        return {}


class FrontAim:
    """Prove the strongest layout of every count of the front; attributes are those of `ProofAim`.

    All labellings are bounded first. Those of one count must then be refuted above what layouts of this count or better
    ones carry, since a weaker one is not on the front.

    Parameters
    ----------
    space : SearchSpace
        The search space.
    gap : float
        As for `ProofAim`.

    Raises
    ------
    InputError
        As `front_count`.
    """

    in_steps = True

    def __init__(self, space: SearchSpace, gap: float) -> None:
        self.gap = gap
        self.count: Count | None = front_count(space)
        self._sign = -1.0 if space.search.front.axes[0][1] == "max" else 1.0
        self._all = sorted(counts_of(space, front_count(space)), key=lambda value: self._sign * value)
        self.restart()

    def restart(self) -> None:
        """Return to all labellings; see `ProofAim`."""
        self._left = list(self._all)
        self._now: int | None = None
        self.bounds: dict[int | None, float] = {}

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        """Return the count, best ones first, after all labellings; see `ProofAim`."""
        return self._now

    def goal(self, best: Mapping[int, float]) -> float:
        """Return what counts no worse carry over one minus the gap; see `ProofAim`."""
        return goal_of(self.enough(best), self.gap)

    def enough(self, best: Mapping[int, float]) -> float:
        """Return the best factor of counts no worse; see `ProofAim`."""
        return self._no_worse(self._now, best)

    def _no_worse(self, value: int | None, best: Mapping[int, float]) -> float:
        """Return the best factor of layouts whose count is a value or a better one."""
        known = (low for count, low in best.items() if value is None or self._sign * (count - value) <= 0.0)
        return max(known, default=-math.inf)

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        """Keep the bound of this count, which the bound on all labellings starts; see `ProofAim`."""
        self.bounds[self._now] = bound
        self._now = self._left.pop(0) if self._left else None
        return None if self._now is None else self.bounds[None]

    def claims(self) -> list[Claim]:
        """Return the bound of every count; see `ProofAim`."""
        return [Claim(count, max(bound, 0.0)) for count, bound in self.bounds.items()]

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        """Return the front: count, load factor, bound, and whether it is proven to the gap; see `ProofAim`."""
        rows: list[dict[str, Any]] = []
        for count in sorted({*best, *(count for count in self.bounds if count is not None)}):
            low, bound = best.get(count, -math.inf), self.bounds.get(count, self.bounds.get(None, math.inf))
            if low < 0.0 and bound <= 0.0:
                continue
            reached = (
                sure
                and count in self.bounds
                and bound <= goal_of(self._no_worse(count, best), self.gap) * (1.0 + 2.0 * _BELOW)
            )
            known = bound if sure and math.isfinite(bound) else None
            rows.append({"count": count, "load_factor": low if low >= 0.0 else None, "bound": known, "proven": reached})
        return {"front": rows}


class RequirementAim:
    """Prove the best count of the front among layouts that carry a required factor; attributes as `ProofAim`.

    Parameters
    ----------
    space : SearchSpace
        The search space, with `search.require`.
    gap : float
        As for `ProofAim`; the proof has none.

    Raises
    ------
    InputError
        If the count of the front is no sum of binary terms, or the space requires no factor.
    """

    in_steps = False

    def __init__(self, space: SearchSpace, gap: float) -> None:
        required = space.search.require
        if required is None:
            raise ParameterError("aim", "the scene requires no load factor", "search.require")
        self.gap = gap
        self.count: Count | None = front_count(space)
        self._sense, self._threshold = space.search.front.axes[0][1], required.threshold
        # a layout that is refuted carries less than what is required
        self._goal = required.threshold * (1.0 - _BELOW)
        self.restart()

    def restart(self) -> None:
        """Forget the claim; see `ProofAim`."""
        self._claim: Claim | None = None
        self.open_counts: Floats = np.empty(0)

    def met(self, best: Mapping[int, float]) -> int | None:
        """Return the best count of a layout that is proven to carry the factor, None without any."""
        found = [count for count, low in best.items() if low >= self._threshold]
        return None if not found else min(found) if self._sense == "min" else max(found)

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        """Return the counts better than the best that is met; see `ProofAim`."""
        return self._better(self.met(best))

    def _better(self, value: int | None) -> Range | None:
        """Return the range of better counts, None for any."""
        if value is None:
            return None
        return Range.of((None, value - 1) if self._sense == "min" else (value + 1, None), whole=True)

    def goal(self, best: Mapping[int, float]) -> float:
        """Return the required factor, less rounding; see `ProofAim`."""
        return self._goal

    def enough(self, best: Mapping[int, float]) -> float:
        """Return the required factor; see `ProofAim`."""
        return self._threshold

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        """End the proof; counts of labellings that stay open limit what is claimed; see `ProofAim`."""
        value = self.met(best)
        self.open_counts = left
        if len(left):
            value = int(left.min() if self._sense == "min" else left.max())
        self._claim = Claim(self._better(value), self._goal)
        return None

    def claims(self) -> list[Claim]:
        """Return that no better count carries the required factor; see `ProofAim`."""
        return [] if self._claim is None else [self._claim]

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        """Return the count that no layout which carries the factor betters, None for none, and how many stay open.

        See `ProofAim`.
        """
        value = self.met(best)
        if len(self.open_counts):
            value = int(self.open_counts.min() if self._sense == "min" else self.open_counts.max())
        return {
            "count_bound": value if sure and self._claim is not None else None,
            "open_layouts": len(self.open_counts),
        }


def aim_of(space: SearchSpace, aim: str, gap: float) -> ProofAim:
    """Return the aim of a proof.

    Parameters
    ----------
    space : SearchSpace
        The search space; a required factor makes the count of the front the aim.
    aim : {"best", "front"}
        The strongest layout, or that of every count.
    gap : float
        As for `ProofAim`.

    Returns
    -------
    ProofAim
        The aim.

    Raises
    ------
    InputError
        If a front is aimed at beside a required factor, or its count is no sum of binary terms.
    """
    if space.search.require is not None:
        if aim != "best":
            raise ParameterError("aim", "a front is not what search.require asks for", "best")
        return RequirementAim(space, gap)
    return FrontAim(space, gap) if aim == "front" else StrongestAim(gap)
