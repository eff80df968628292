"""Targets of a proof: the best λ known, the proven bound for each count, and the claims about them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.limit import Status
from jld_core.limit.bounds import exceeds
from jld_explore.drivers.exact.proof_check import Claim
from jld_explore.evaluation import Evaluation
from jld_explore.space import Count, SearchSpace, count_named, values_of
from jld_explore.space.limits import Range

if TYPE_CHECKING:
    import pandas as pd


class Incumbents:
    """Bounds of all evaluated labellings, and the best λ for each count; None for all labellings."""

    def __init__(self, space: SearchSpace, count: Count | None) -> None:
        self._space, self._count = space, count
        self._bounds: dict[bytes, tuple[float, float, int]] = {}
        self._best: dict[int | None, float] = {}

    def learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Record the bounds of evaluated labellings (k, m), with k evaluations in their order."""
        # Labellings that collapse have both bounds. A failed or uncertified one keeps its upper bound, inf without one.
        # All others have −inf for both, since no λ of theirs counts. With zero dilation the upper bound is at least the
        # associative λ.
        number = [0] * len(labellings)
        if self._count is not None:
            number = values_of(self._count, self._space.assembly, labellings, self._space.graph).tolist()
        for labels, found, count in zip(labellings, evaluations, number, strict=True):
            low = found.low if found.status is Status.COLLAPSE else -math.inf
            high = found.high if found.status is Status.COLLAPSE else -math.inf
            if found.status in (Status.UNCERTIFIED, Status.FAILED):
                high = found.high if math.isfinite(found.high) else math.inf
            if math.isfinite(found.zero_dilation):
                # other solutions without dilation may exist; the associative λ bounds all of them
                high = max(high, found.associative * (1.0 + tolerances.PROVEN))
            self._bounds[np.packbits(labels).tobytes()] = (low, high, count)
            for target in (None, count):
                self._best[target] = max(low, self._best.get(target, -math.inf))

    def __bool__(self) -> bool:
        """Return whether any labelling was evaluated."""
        return bool(self._bounds)

    def __contains__(self, labels: Bits) -> bool:
        """Return whether a canonical labelling (m,) was evaluated."""
        return np.packbits(labels).tobytes() in self._bounds

    def strongest(self, count: int) -> tuple[Bits, Floats]:
        """Return the labellings (k, m) of largest proven λ, and that λ (k,), scene units, best first."""
        stands = [(low, key) for key, (low, _, _) in self._bounds.items() if math.isfinite(low)]
        stands.sort(key=lambda one: (-one[0], one[1]))
        faces = len(self._space.fixed)
        packed = np.frombuffer(b"".join(key for _, key in stands[:count]), dtype=np.uint8)
        rows = np.unpackbits(packed.reshape(-1, (faces + 7) // 8), axis=1, count=faces).astype(bool)
        return rows, np.array([low for low, _ in stands[:count]])

    def best(self, target: int | None) -> float:
        """Return the largest proven λ, scene units, for a count or None for all; −inf without one."""
        return self._best.get(target, -math.inf)

    def high(self, labels: Bits, target: int | None) -> float:
        """Return the λ, scene units, that a labelling (m,) does not exceed; −inf if of another count."""
        _, high, count = self._bounds.get(np.packbits(labels).tobytes(), (-math.inf, math.inf, target))
        return high if target is None or count == target else -math.inf


@dataclass(frozen=True)
class Best:
    """Best λ found and proven bound of the labellings with one count, or of all."""

    count: int | None  # value of the count; None for all labellings
    load_factor: float  # largest λ found, scene units; NaN if there is none
    # proven upper bound on λ, scene units; −inf if no labelling stands or none exists, inf if nothing is known
    bound: float
    load_scale: float = 0.0  # λ below which differences do not matter, scene units

    @property
    def proven(self) -> bool:
        """True if no labelling is better by more than `tolerances.PROVEN`, relative."""
        if self.bound == -math.inf:
            return True
        if not (math.isfinite(self.bound) and math.isfinite(self.load_factor)):
            return False
        size = max(abs(self.bound), abs(self.load_factor), self.load_scale)
        return bool(self.bound - self.load_factor <= tolerances.PROVEN * size)


def claims_of(
    found: Iterable[Best], incumbents: Incumbents, scale: float, load_scale: float
) -> tuple[list[Claim], str]:
    """Return the claims of a proof, and the first contradiction to a λ found ("" for none)."""
    claims, problem = [], ""
    for best in found:
        # if no labelling stands none exceeds zero
        claims.append(Claim(best.count, (0.0 if best.bound == -math.inf else best.bound) / scale))
        low = incumbents.best(best.count)
        if not best.proven:
            problem = problem or f"the bound {best.bound:.9g} is not met"
        if math.isfinite(low) and exceeds(low, best.bound, load_scale):
            problem = problem or f"a layout carries {low:.9g}, above the bound {best.bound:.9g}"
    return claims, problem


def front(found: Iterable[Best]) -> list[dict[str, Any]]:
    """Return the rows of the proven front: count, load_factor, bound and proven."""
    # Counts for which no labelling stands are left out.
    rows: list[dict[str, Any]] = []
    for best in found:
        if best.count is None or (math.isnan(best.load_factor) and best.bound == -math.inf):
            continue
        known = None if math.isnan(best.load_factor) else best.load_factor
        bound = best.bound if math.isfinite(best.bound) else None
        rows.append({"count": best.count, "load_factor": known, "bound": bound, "proven": best.proven})
    return sorted(rows, key=lambda row: int(row["count"]))


def front_of_all(results: pd.DataFrame, count: str, complete: bool) -> list[dict[str, Any]]:
    """Return the rows of the front of an enumerated space: count, load_factor, bound, proven."""
    rows: list[dict[str, Any]] = []
    for value, group in results.groupby(count):
        stands = group["stands_at_zero"].fillna(True).astype(bool)
        ranked = group[(group["status"] == str(Status.COLLAPSE)) & stands]
        if not ranked.empty:
            sure = complete and not group["status"].isin([str(Status.UNCERTIFIED), str(Status.FAILED)]).any()
            best, bound = float(ranked["load_factor"].max()), float(ranked["bracket_hi"].max())
            low, others = float(ranked["bracket_lo"].max()), ranked["bracket_hi"].drop(ranked["bracket_lo"].idxmax())
            sure = sure and not others.max() - low > tolerances.PROVEN * abs(bound)
            number = value if isinstance(value, float) else int(str(value))
            rows.append({"count": number, "load_factor": best, "bound": bound if sure else None, "proven": sure})
    return rows


def counts_of(space: SearchSpace, count: Count) -> list[int]:
    """Return all values that a count may take within the limits of a space, ascending."""
    if count.terms is None:
        raise ValueError(f"{count.name} is no sum of binary terms")
    most = count.terms(space.assembly).most(space.assembly)
    bounds = next((bounds for one, bounds in space.limits.on_counts if one is count), None)
    if bounds is None:
        return list(range(most + 1))
    return list(range(int(bounds.low or 0), (most if bounds.high is None else min(int(bounds.high), most)) + 1))


# Relative distance above the best λ known at which labellings are sought. It is half of `tolerances.PROVEN`, the
# relative difference that counts as proven.
_INCREASE: Final = 0.5 * tolerances.PROVEN


def front_count(space: SearchSpace) -> Count | None:
    """Return the count of an exact front; None where no formula expresses the front."""
    asked = space.search.front
    count = count_named(asked.count)
    return None if asked.counts or count.terms is None else count


class Targets:
    """Targets of a proof: all labellings, and for a front those of each value of its count."""

    def __init__(self, space: SearchSpace, count: Count | None, incumbents: Incumbents, load_scale: float) -> None:
        self._space, self._count, self._incumbents, self._load_scale = space, count, incumbents, load_scale
        self.found: dict[int | None, Best] = {}  # by count; None: all labellings
        self.left: list[int | None] = []  # targets that are not settled
        self._listed = False
        self.restart()

    def restart(self) -> None:
        """Forget all bounds and return to the first target."""
        self.found = {None: self._target_with_bound(None, math.inf)}
        self.left = [None]
        self._listed = False

    def _target_with_bound(self, target: int | None, bound: float) -> Best:
        """Return a target with its best λ known and a given bound, scene units."""
        low = self._incumbents.best(target)
        return Best(target, low if math.isfinite(low) else math.nan, bound, self._load_scale)

    def learn(self) -> None:
        """Raise the best λ of each target to the best one among the incumbents."""
        for target, best in self.found.items():
            low = self._incumbents.best(target)
            if math.isfinite(low) and not best.load_factor >= low:
                self.found[target] = replace(best, load_factor=low)

    def least(self, target: int | None) -> float:
        """Return the λ, scene units, that a labelling must exceed to count as better; 0 without a best."""
        low = self._incumbents.best(target)
        return low + _INCREASE * max(abs(low), self._load_scale) if math.isfinite(low) else 0.0

    def lower_bound(self, target: int | None, bound: float, handed_over: Iterable[Bits]) -> None:
        """Lower the bound of a target, but not below those of labellings (m,) handed over."""
        for labels in handed_over:
            bound = max(bound, self._incumbents.high(labels, target))
        best = self.found[target]
        if bound < best.bound:
            self.found[target] = replace(best, bound=bound)

    def raise_to(self, claims: Iterable[Claim], scale: float) -> None:
        """Raise bounds to claims that hold after a correction, and take up targets no longer proven."""
        for claim in claims:
            assert not isinstance(claim.count, Range)  # of the driver that minimises a count
            best = self.found[claim.count]
            if claim.threshold * scale > max(best.bound, 0.0):
                self.found[claim.count] = best = replace(best, bound=claim.threshold * scale)
            if not best.proven and claim.count not in self.left:
                self.left.append(claim.count)

    def settle(self, target: int | None) -> None:
        """Remove a proven target from `left`; for a front the first one adds one target per count."""
        # A target without a λ whose bound is at most 0 gets the bound −inf: none of its labellings stands.
        best = self.found[target]
        if math.isnan(best.load_factor) and best.bound <= 0.0:
            self.found[target] = best = replace(best, bound=-math.inf)
        self.left.remove(target)
        if self._count is None or self._listed:
            return
        self._listed = True
        for count in counts_of(self._space, self._count):
            self.found[count] = self._target_with_bound(count, best.bound)
            self.left.append(count)
