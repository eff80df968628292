"""What all drivers but enumeration share: nothing proposed twice, and the rest of a space that runs dry.

A driver that no longer finds anything new lets enumeration go through what is left, class by class, so that a
space smaller than the budget ends completely known whatever the driver.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Ints
from jld_core.deadline import checkpoint
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

    def admit(self, rows: Bits, most: int | None = None, *, sure: bool = False) -> Bits:
        """The first `most` new classes among the feasible of rows (k, m), canonical; registers them.

        sure: they are known to be feasible (see `Operators.sure`).
        """
        return self.admitted(rows, most, sure=sure)[0]

    def admitted(self, rows: Bits, most: int | None = None, *, sure: bool = False) -> tuple[Bits, list[bytes], Ints]:
        """The same, with the keys of those admitted, and which of the k rows each was, ascending."""
        rows = canonical(rows, self.space.group)
        fresh: dict[bytes, int] = {}
        # known classes are most of what a search that converges proposes: they are not checked again
        for number, key in enumerate(keys(rows)):
            if key not in self.seen:
                fresh.setdefault(key, number)
        named, places = list(fresh), np.fromiter(fresh.values(), dtype=np.int64, count=len(fresh))
        if not sure:
            good = feasible(self.space, rows[places])
            places = places[good]
            named = [key for key, fine in zip(named, good.tolist(), strict=True) if fine]
        named, places = named[:most], places[:most]
        self.seen.update(named)
        return rows[places], named, places

    def forget(self, names: Iterable[bytes]) -> None:
        """Take back classes by their keys that were admitted and never asked, so that they may come again."""
        self.seen.difference_update(names)


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
        """Up to `count` new classes out of what `make` proposes by the operators; make takes how many to propose."""
        found = self._none
        tries = PATIENCE * max(count, _ROUND)
        while len(found) < count and tries > 0:
            checkpoint()
            wanted = max(_ROUND, count - len(found))
            tries -= wanted
            admitted = self.register.admit(make(wanted), count - len(found), sure=self.operators.sure)
            found = np.concatenate([found, admitted])
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
