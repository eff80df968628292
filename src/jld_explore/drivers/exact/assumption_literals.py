"""Clauses that hold above a λ threshold only, guarded by one assumption literal each."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable

Pairs = tuple[tuple[int, bool], ...]
"""Faces and labels (True = dry) that no labelling above some scaled λ has together."""


class AssumptionLiterals:
    """Assumption literals, one per threshold level, in ascending order of the levels.

    A literal is true where every labelling sought exceeds its level. A clause that holds above a bound is guarded by
    the literal of the lowest level not below that bound. While no such level exists the clause waits. A new level
    takes over the clauses that already hold at it.

    Parameters
    ----------
    new : callable
        Creates a variable of the solver and returns its number.
    rule_out : callable
        Adds the clause that forbids some labels unless one of the given literals is true. With no labels the clause
        consists of the literals alone.

    Attributes
    ----------
    threshold : float
        Scaled λ that labellings must exceed at present.
    assumed : list of int
        Literals to assume in every call of the solver.
    """

    def __init__(self, new: Callable[[], int], rule_out: Callable[[Pairs, tuple[int, ...]], None]) -> None:
        self._new, self._rule_out = new, rule_out
        self._levels: list[float] = []
        self._literals: list[int] = []
        self._waiting: list[list[tuple[float, Pairs]]] = [[]]
        self._known: dict[Pairs, float] = {}
        self.threshold = -math.inf
        self.assumed: list[int] = []

    def forbid_above(self, pairs: Pairs, bound: float) -> None:
        """Forbid labels at every level not below a bound (scaled λ); −inf forbids them always.

        A call has no effect where the same labels are forbidden under the same or a lower bound already.
        """
        if self._known.get(pairs, math.inf) <= bound:
            return
        self._known[pairs] = bound
        if bound == -math.inf:
            self._rule_out(pairs, ())
            return
        place = bisect_left(self._levels, bound)
        self._waiting[place].append((bound, pairs))
        if place < len(self._levels):
            self._rule_out(pairs, (-self._literals[place],))

    def aim(self, threshold: float) -> None:
        """Set the scaled λ that labellings must exceed, and update the literals to assume."""
        self.threshold = threshold
        place = bisect_left(self._levels, threshold)
        if place == len(self._levels) or self._levels[place] != threshold:
            self._insert(place, threshold)
        above = [-self._literals[place + 1]] if place + 1 < len(self._literals) else []
        self.assumed = [self._literals[place], *above]

    def _insert(self, place: int, level: float) -> None:
        """Insert a level, order its literal between its neighbours and add its clauses."""
        literal = self._new()
        if place > 0:
            self._rule_out((), (-literal, self._literals[place - 1]))
        if place < len(self._literals):
            self._rule_out((), (-self._literals[place], literal))
        above_previous = self._waiting[place]
        holding = [one for one in above_previous if one[0] <= level]
        self._levels.insert(place, level)
        self._literals.insert(place, literal)
        self._waiting.insert(place, holding)
        self._waiting[place + 1] = [one for one in above_previous if one[0] > level]
        for _, pairs in holding:
            self._rule_out(pairs, (-literal,))
