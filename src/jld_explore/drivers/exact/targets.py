"""Keep the targets of a proof: the best λ and the proven bound for each count."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from jld_core import tolerances
from jld_core.arrays import Bits
from jld_core.errors import InputError
from jld_explore.drivers.exact.incumbents import Incumbents
from jld_explore.drivers.exact.optimum import Best, counts_of
from jld_explore.space import Count, SearchSpace, count_named, registered

_INCREASE: Final = 0.5 * tolerances.PROVEN
"""Relative distance above the best λ known at which labellings are sought.

It is half of `tolerances.PROVEN`, the relative difference that counts as proven.
"""


def front_count(space: SearchSpace) -> Count:
    """Return the count of an exact front.

    Parameters
    ----------
    space : SearchSpace
        The search space.

    Returns
    -------
    Count
        Count of the front that the scene asks for.

    Raises
    ------
    InputError
        If the scene asks for two counts, or for a count that is no sum of binary terms.
    """
    asked = space.search.front
    if asked.counts:
        raise InputError("search.front.counts", "two counts have no exact front", 'one count, or `driver="genetic"`')
    count = count_named(asked.count)
    if count.terms is None:
        known = " or ".join(one.name for one in registered() if one.terms)
        raise InputError("search.front.count", f"{count.name} has no exact front", known)
    return count


class Targets:
    """Targets of a proof: all labellings, and for a front the labellings of each value of its count.

    Parameters
    ----------
    space : SearchSpace
        The search space.
    count : Count or None
        Count of the front; None to prove the largest λ alone.
    incumbents : Incumbents
        Bounds of the evaluated labellings.
    load_scale : float
        λ below which differences do not matter, scene units.

    Attributes
    ----------
    found : dict
        Best labelling and bound (`Best`) for each count; key None for all labellings.
    left : list of int or None
        Targets that are not settled.
    """

    def __init__(self, space: SearchSpace, count: Count | None, incumbents: Incumbents, load_scale: float) -> None:
        self._space, self._count, self._incumbents, self._load_scale = space, count, incumbents, load_scale
        self.found: dict[int | None, Best] = {}
        self.left: list[int | None] = []
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
        """Raise the best λ of each target to those of the incumbents."""
        for target, best in self.found.items():
            low = self._incumbents.best(target)
            if math.isfinite(low) and not best.load_factor >= low:
                self.found[target] = replace(best, load_factor=low)

    def least(self, target: int | None) -> float:
        """Return the λ that a labelling must exceed to count as better, scene units.

        Parameters
        ----------
        target : int or None
            Value of the count; None for all labellings.
        """
        low = self._incumbents.best(target)
        return low + _INCREASE * max(abs(low), self._load_scale) if math.isfinite(low) else 0.0

    def lower_bound(self, target: int | None, bound: float, handed_over: Iterable[Bits]) -> None:
        """Lower the bound of a target, but not below the brackets of labellings handed over.

        No mechanism refutes those labellings, so only their own brackets bound them.
        """
        for labels in handed_over:
            bound = max(bound, self._incumbents.high(labels, target))
        best = self.found[target]
        if bound < best.bound:
            self.found[target] = replace(best, bound=bound)

    def settle(self, target: int | None) -> None:
        """Close a target; after the first target of a front add one target per value of the count."""
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
