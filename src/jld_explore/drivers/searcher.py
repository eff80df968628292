"""What all drivers but enumeration share: nothing proposed twice, and the rest of a space that runs dry.

A driver that no longer finds anything new lets enumeration go through what is left, class by class, so that a
space smaller than the budget ends completely known whatever the driver.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.operators import BufferedRandom, Operators, operators
from jld_explore.space import SearchSpace, canonical, feasible, keys

PATIENCE: Final = 12
"""Proposals tried for each new labelling wanted before a driver looks for them elsewhere."""

_ROUND: Final = 16
"""Proposals made at a time at the least: what a batch of checks costs hardly depends on its size."""


class Register:
    """All classes that were proposed, and the gate to it."""

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self.seen: set[bytes] = set()

    def admit(self, rows: Bits, most: int | None = None) -> Bits:
        """The first `most` new classes among the feasible of rows (k, m), canonical; registers them."""
        rows = canonical(rows, self.space.group)
        named = keys(rows)
        # known classes are most of what a search that converges proposes: they are not checked again
        unknown = list(
            {key: number for number, key in reversed(list(enumerate(named))) if key not in self.seen}.values()
        )
        unknown.sort()
        good = feasible(self.space, rows[unknown])
        kept = [number for number, fine in zip(unknown, good.tolist(), strict=True) if fine][:most]
        self.seen.update(named[number] for number in kept)
        return rows[kept]

    def forget(self, rows: Bits) -> None:
        """Take back classes (k, m) that were admitted and never asked, so that they may come again."""
        self.seen.difference_update(keys(rows))


class Searcher(Driver):
    """A driver that proposes by chance. It makes `size` proposals at a time, whatever portions are asked."""

    def __init__(self, space: SearchSpace, seed: int, size: int) -> None:
        super().__init__(space, seed)
        self.size = size
        self.rng = BufferedRandom(np.random.default_rng(seed))
        self.operators: Operators = operators(space)
        self.register = Register(space)
        self._held = self._none
        self._rest: Iterator[Bits] | None = None

    @property
    def exhaustive(self) -> bool:
        """See `Driver.exhaustive`: what is left in the end is enumerated."""
        return True

    @property
    def _none(self) -> Bits:
        return np.empty((0, len(self.space.fixed)), dtype=bool)

    def ask(self, limit: int | None = None) -> Bits:
        """The next classes, (k, m): the rest of the last batch, or a new one."""
        if limit is not None and limit <= 0:
            return self._none
        if not len(self._held):
            self._held = self._batch()
        given, self._held = self._held[:limit], self._held[len(self._held) if limit is None else limit :]
        return given

    def _batch(self) -> Bits:
        if self._rest is None:
            rows = self.propose()
            if len(rows) < max(1, self.size // 8):
                self._rest = self._remaining()
            if len(rows):
                return rows
        return next(self._rest, self._none) if self._rest is not None else self._none

    @abstractmethod
    def propose(self) -> Bits:
        """Up to `size` new labellings, canonical and registered; fewer where new ones have become rare."""

    def fresh(self, make: Callable[[int], Bits], count: int) -> Bits:
        """Up to `count` new classes out of what `make` proposes; make takes how many to propose."""
        found = self._none
        tries = PATIENCE * max(count, _ROUND)
        while len(found) < count and tries > 0:
            wanted = max(_ROUND, count - len(found))
            tries -= wanted
            found = np.concatenate([found, self.register.admit(make(wanted), count - len(found))])
        return found

    def draw(self, count: int) -> Bits:
        """Random rows, as `fresh` takes them."""
        return self.operators.draw(count, self.rng)

    def _remaining(self) -> Iterator[Bits]:
        """What enumeration finds and nobody has proposed, in batches of `size`."""
        waiting = self._none
        for rows, _ in Enumeration(self.space).batches():
            waiting = np.concatenate([waiting, self.register.admit(rows)])
            while len(waiting) >= self.size:
                yield waiting[: self.size]
                waiting = waiting[self.size :]
        if len(waiting):
            yield waiting
