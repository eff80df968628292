"""What a formula holds only where it aims high enough: clauses behind guards, one for each λ that was aimed at."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable

Pairs = tuple[tuple[int, bool], ...]
"""Faces and the labels that no labelling above some λ has on them together."""


class AssumptionLiterals:
    """Guards in the order of their levels, each true where all that is looked for exceeds its level.

    new: makes a variable. rule_out: adds the clause of some labels, unless one of some literals is true; of a guard
    alone as well. What holds above a bound stands behind the lowest level that is not below it, and waits while there
    is none. A level that comes between takes in what holds there already.
    """

    def __init__(self, new: Callable[[], int], rule_out: Callable[[Pairs, tuple[int, ...]], None]) -> None:
        self._new, self._rule_out = new, rule_out
        self._levels: list[float] = []
        self._assumption_literals: list[int] = []
        self._held: list[list[tuple[float, Pairs]]] = [[]]
        self._known: dict[Pairs, float] = {}
        self.threshold = -math.inf
        self.assumed: list[int] = []

    def hold(self, pairs: Pairs, bound: float) -> None:
        """Rule out labels wherever the level is not below a bound: everywhere if that is −inf."""
        if self._known.get(pairs, math.inf) <= bound:
            return
        self._known[pairs] = bound
        if bound == -math.inf:
            self._rule_out(pairs, ())
            return
        place = bisect_left(self._levels, bound)
        self._held[place].append((bound, pairs))
        if place < len(self._levels):
            self._rule_out(pairs, (-self._assumption_literals[place],))

    def aim(self, threshold: float) -> None:
        """Look for what exceeds a threshold."""
        self.threshold = threshold
        place = bisect_left(self._levels, threshold)
        if place == len(self._levels) or self._levels[place] != threshold:
            self._insert(place, threshold)
        above = [-self._assumption_literals[place + 1]] if place + 1 < len(self._assumption_literals) else []
        self.assumed = [self._assumption_literals[place], *above]

    def _insert(self, place: int, level: float) -> None:
        guard = self._new()
        if place > 0:
            self._rule_out((), (-guard, self._assumption_literals[place - 1]))
        if place < len(self._assumption_literals):
            self._rule_out((), (-self._assumption_literals[place], guard))
        waiting = self._held[place]
        here = [one for one in waiting if one[0] <= level]
        self._levels.insert(place, level)
        self._assumption_literals.insert(place, guard)
        self._held.insert(place, here)
        self._held[place + 1] = [one for one in waiting if one[0] > level]
        for _, pairs in here:
            self._rule_out(pairs, (-guard,))
