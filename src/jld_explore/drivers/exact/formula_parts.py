"""Parts of the formula: clauses that hold above a λ, counts as unary numbers, and paths of inner faces."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Sequence

from pysat.card import ITotalizer

from jld_core.arrays import Bits
from jld_explore.space import SearchSpace
from jld_explore.space.measures import Range

Pairs = tuple[tuple[int, bool], ...]
"""Faces and labels (True = dry) that no labelling above some scaled λ has together."""


class AssumptionLiterals:
    """Assumption literals, one per threshold level, in ascending order of the levels.

    A literal is true where every labelling sought exceeds its level. A clause that holds above a bound is guarded by
    the literal of the lowest level not below that bound. While no such level exists the clause waits. A new level
    takes over the clauses that already hold at it.

    new: creates a variable of the solver and returns its number. rule_out: adds the clause that forbids some labels
    unless one of the given literals is true. With no labels the clause consists of the literals alone. threshold:
    scaled λ that labellings must exceed at present. assumed: literals to assume in every call of the solver.
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
        """Set the scaled λ that labellings must exceed, and update `assumed`."""
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


class UnaryCounter:
    """Number of true literals among some, plus a constant, as a unary number.

    The clauses in `clauses` must be added to the solver; then assuming literals of `within` bounds the number.
    Two totalizers (Bailleux and Boufkhad 2003) encode the literals and their negations, because each totalizer
    implies only upper bounds.

    literals: literals to count. constant: constant added to the number. top: largest variable in use. clauses: clauses
    that define the digits. top: largest variable in use afterwards.
    """

    def __init__(self, literals: Sequence[int], constant: int, top: int) -> None:
        self._size, self._constant = len(literals), constant
        self._false = top = top + 1
        self.clauses: list[list[int]] = [[-self._false]]
        self._digits: list[list[int]] = []
        for chosen in (list(literals), [-literal for literal in literals]):
            if chosen:
                with ITotalizer(chosen, ubound=len(chosen), top_id=top) as made:
                    top = max(top, made.top_id)
                    self.clauses += made.cnf.clauses
                    self._digits.append(list(made.rhs))
        self.top = top

    def within(self, bounds: Range) -> list[int]:
        """Return the literals to assume so that the number, with the constant, is within bounds.

        For bounds that cannot be kept, the result is a literal that is always false.
        """
        low = 0 if bounds.low is None else int(bounds.low) - self._constant
        high = self._size if bounds.high is None else int(bounds.high) - self._constant
        if low > self._size or high < 0:
            return [self._false]
        most = [-self._digits[0][high]] if high < self._size else []
        return most + ([-self._digits[1][self._size - low]] if low > 0 else [])


class InnerPaths:
    """Graph of the elements of a space, to search along the inner faces of labellings."""

    def __init__(self, space: SearchSpace) -> None:
        graph = space.graph
        # per element pairs (face, neighbour); face −1 for supports that touch without a face
        self._links: list[list[tuple[int, int]]] = [[] for _ in range(len(graph.start))]
        pairs = [(face, a, b) for face, (a, b) in enumerate(zip(graph.a, graph.b, strict=True))]
        for face, a, b in pairs + [(-1, a, b) for a, b in graph.touching]:
            self._links[int(a)].append((face, int(b)))
            self._links[int(b)].append((face, int(a)))
        self._free = frozenset(space.assembly.elements.free.tolist())
        self._limits = space.limits

    def path(self, labels: Bits, start: int, end: int) -> list[int]:
        """Return the inner faces of a shortest path between two elements of one block.

        labels: (m,), True = dry. start, end: elements. The path may also pass where elements touch without a face; the
        block must join both elements.
        """
        previous = self._reach(labels, start, lambda seen: end in seen)
        path, element = [], end
        while element != start:
            element, face = previous[element]
            if face >= 0:
                path.append(face)
        return path

    def tree(self, labels: Bits, start: int) -> list[int]:
        """Return inner faces that join enough elements to `start` that their block is too large.

        labels: (m,), True = dry. If the block never exceeds a limit, the faces span the whole block.
        """
        limits = self._limits
        previous = self._reach(labels, start, lambda seen: bool(limits.too_large(limits.sized.one(seen & self._free))))
        return [face for _, face in previous.values() if face >= 0]

    def _reach(self, labels: Bits, start: int, found: Callable[[set[int]], bool]) -> dict[int, tuple[int, int]]:
        """Search breadth first from element `start` until `found` or to the end; return the tree.

        Steps go through inner faces of `labels` (m,) and contacts without a face. found: gets the elements reached,
        True ends the search. The tree maps each element to the element before it and the face between them, −1 for
        none.
        """
        previous = {start: (start, -1)}
        waiting = deque([start])
        while waiting:
            element = waiting.popleft()
            for face, other in self._links[element]:
                if other not in previous and (face < 0 or not labels[face]):
                    previous[other] = (element, face)
                    waiting.append(other)
                    if found(set(previous)):
                        return previous
        return previous
