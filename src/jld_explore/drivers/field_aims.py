"""Aims of a proof by fields: the best layout, the front, or the best count."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, Protocol

import numpy as np

from jld_core.arrays import Bools, Floats
from jld_core.errors import InputError, ParameterError
from jld_explore.drivers.exact.proof_check import Claim
from jld_explore.drivers.exact.targets import counts_of, front_count
from jld_explore.space import Count, SearchSpace, registered
from jld_explore.space.limits import Range

_BELOW: Final = 1e-9  # relative amount by which the goal lies below best / (1 − gap), for rounding of the gap


class ProofAim(Protocol):
    """Aim of a proof by fields: ask for `target` and `goal`, refute, and `next` until None; then check `claims`.

    `best` maps each count to the largest governing factor that a layout of it is proven to carry.
    """

    count: Count | None  # count whose values are the targets; None where all labellings are one target
    gap: float  # relative distance between the best lower bound and the bound at which a target is reached
    in_steps: bool  # whether a bound far above the goal is lowered in steps

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        """Return the count, or range of counts, of the labellings to refute now; None for all."""
        ...

    def goal(self, best: Mapping[int, float]) -> float:
        """Return the governing factor above which labellings of the target must be refuted."""
        ...

    def enough(self, best: Mapping[int, float]) -> float:
        """Return the governing factor that a lower bound of a labelling must exceed to be of use."""
        ...

    def restart(self) -> None:
        """Forget all bounds and return to the first target."""
        ...

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        """Record the target's bound; return the known one of the next, None at the end. left: (k,) open counts."""
        ...

    def claims(self) -> list[Claim]:
        """Return the bounds that the check has to confirm after the last target."""
        ...

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        """Return entries of the summary, without bounds unless they are `sure`."""
        ...


def goal_of(best: float, gap: float) -> float:
    """Return best / (1 − gap), less rounding: the factor above which labellings must be refuted."""
    if best <= 0.0:
        return 0.0
    return best / (1.0 - gap) * (1.0 - _BELOW) if gap < 1.0 else math.inf


def holds(target: int | Range | None, counts: Floats) -> Bools:
    """Return for each count (k,) whether it belongs to a target."""
    if target is None:
        return np.ones(len(counts), dtype=bool)
    return ~target.outside(counts) if isinstance(target, Range) else np.asarray(counts == target)


class StrongestAim:
    """Aim to prove the strongest layout to a gap, with all labellings as the only target."""

    count: Count | None = None
    in_steps = True

    def __init__(self, gap: float) -> None:
        self.gap = gap
        self.restart()

    def restart(self) -> None:
        self._bound = math.inf

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        return None

    def goal(self, best: Mapping[int, float]) -> float:
        return goal_of(self.enough(best), self.gap)

    def enough(self, best: Mapping[int, float]) -> float:
        return max(best.values(), default=-math.inf)

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        self._bound = bound
        return None

    def claims(self) -> list[Claim]:
        return [Claim(None, max(self._bound, 0.0))]

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        return {}


def _count_of_formula(space: SearchSpace) -> Count:
    """Return the count of the front of a space; InputError where no formula expresses it."""
    count, asked = front_count(space), space.search.front
    if asked.counts:
        raise InputError(
            "search.front.counts", "by fields two counts have no exact front", 'one, or `driver="genetic"`'
        )
    if count is None:
        known = " or ".join(one.name for one in registered() if one.terms)
        raise InputError("search.front.count", f"by fields {asked.count} has no exact front", known)
    return count


class FrontAim:
    """Aim to prove to a gap the strongest layout of every count of the front."""

    in_steps = True

    def __init__(self, space: SearchSpace, gap: float) -> None:
        # All labellings are bounded first, then those of one count after the other, best count first. The goal is the
        # best λ of this count or a better one: a weaker layout is not on the front.
        self.gap = gap
        count = _count_of_formula(space)
        self.count: Count | None = count
        self._sign = -1.0 if space.search.front.axes[0][1] == "max" else 1.0
        self._all = sorted(counts_of(space, count), key=lambda value: self._sign * value)
        self.restart()

    def restart(self) -> None:
        self._left = list(self._all)
        self._now: int | None = None
        self.bounds: dict[int | None, float] = {}

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        return self._now

    def goal(self, best: Mapping[int, float]) -> float:
        return goal_of(self.enough(best), self.gap)

    def enough(self, best: Mapping[int, float]) -> float:
        return self._no_worse(self._now, best)

    def _no_worse(self, value: int | None, best: Mapping[int, float]) -> float:
        """Return the best factor of layouts whose count is `value` or a better one, else −inf."""
        known = (low for count, low in best.items() if value is None or self._sign * (count - value) <= 0.0)
        return max(known, default=-math.inf)

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        self.bounds[self._now] = bound
        self._now = self._left.pop(0) if self._left else None
        return None if self._now is None else self.bounds[None]

    def claims(self) -> list[Claim]:
        return [Claim(count, max(bound, 0.0)) for count, bound in self.bounds.items()]

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        """Return the front as entry "front", one row for each count."""
        # A row has the count, the best load factor, the bound (None unless `sure`), and whether it is proven to the
        # gap. Counts of which no layout stands are left out once that is proven.
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
    """Aim to prove the best count of the front among layouts that carry a required factor."""

    in_steps = False

    def __init__(self, space: SearchSpace, gap: float) -> None:
        required = space.search.require
        if required is None:
            raise ParameterError("aim", "the scene requires no load factor", "search.require")
        self.gap = gap
        self.count: Count | None = _count_of_formula(space)
        self._sense, self._threshold = space.search.front.axes[0][1], required.threshold
        # a layout that is refuted carries less than what is required
        self._goal = required.threshold * (1.0 - _BELOW)
        self.restart()

    def restart(self) -> None:
        self._claim: Claim | None = None
        self.open_counts: Floats = np.empty(0)

    def met(self, best: Mapping[int, float]) -> int | None:
        """Return the best count whose factor is at least the required one, or None."""
        found = [count for count, low in best.items() if low >= self._threshold]
        return None if not found else min(found) if self._sense == "min" else max(found)

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        return self._better(self.met(best))

    def _better(self, value: int | None) -> Range | None:
        """Return the range of counts better than `value`, None for any."""
        if value is None:
            return None
        return Range.of((None, value - 1) if self._sense == "min" else (value + 1, None), whole=True)

    def goal(self, best: Mapping[int, float]) -> float:
        return self._goal

    def enough(self, best: Mapping[int, float]) -> float:
        return self._threshold

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        # without open labellings no count better than `met` carries the factor; else the best open count takes its
        # place
        value = self.met(best)
        self.open_counts = left
        if len(left):
            value = int(left.min() if self._sense == "min" else left.max())
        self._claim = Claim(self._better(value), self._goal)
        return None

    def claims(self) -> list[Claim]:
        return [] if self._claim is None else [self._claim]

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        """Return the best count that may still carry the factor, and the number of open layouts."""
        value = self.met(best)
        if len(self.open_counts):
            value = int(self.open_counts.min() if self._sense == "min" else self.open_counts.max())
        return {
            "count_bound": value if sure and self._claim is not None else None,
            "open_layouts": len(self.open_counts),
        }


def aim_of(space: SearchSpace, aim: str, gap: float) -> ProofAim:
    """Make the aim of a proof from the option of the driver and the scene."""
    if space.search.require is not None:
        if aim != "best":
            raise ParameterError("aim", "a front is not what search.require asks for", "best")
        return RequirementAim(space, gap)
    return FrontAim(space, gap) if aim == "front" else StrongestAim(gap)
