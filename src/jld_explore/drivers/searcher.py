"""Base of the drivers with random proposals: no class twice, and enumeration at the end.

When a driver finds hardly any new labellings, enumeration adds the remaining classes one by one. A space smaller than
the budget is then evaluated completely, whatever the driver.
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
from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.interface import Operators
from jld_explore.drivers.operators.make import operators
from jld_explore.space import SearchSpace, keys
from jld_explore.space.labelling import canonical
from jld_explore.space.search_space import feasible

PATIENCE: Final = 12
"""Proposals per new labelling wanted after which `Searcher.fresh` gives up."""

_ROUND: Final = 16  # least number of proposals per batch; the cost of a check hardly depends on its size


class Register:
    """Set of the classes that a driver has proposed.

    Parameters
    ----------
    space : SearchSpace
        The search space.

    Attributes
    ----------
    space : SearchSpace
        As the parameter.
    seen : set of bytes
        Keys of the canonical labellings proposed.
    """

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self.seen: set[bytes] = set()

    def admit(self, rows: Bits, most: int | None = None, *, all_feasible: bool = False) -> Bits:
        """Register the new feasible classes among labellings, and return them.

        Parameters
        ----------
        rows : (k, m) bool array
            Labels, True = dry.
        most : int, optional
            Largest number of classes; the first ones are taken.
        all_feasible : bool
            Whether all rows are known to be feasible (see `Operators.always_feasible`).

        Returns
        -------
        (j, m) bool array
            Canonical labels of the new classes.
        """
        return self.admitted(rows, most, all_feasible=all_feasible)[0]

    def admitted(
        self, rows: Bits, most: int | None = None, *, all_feasible: bool = False
    ) -> tuple[Bits, list[bytes], Ints]:
        """Register new classes as `admit` does, and also return their keys and row numbers.

        Parameters
        ----------
        rows, most, all_feasible
            As in `admit`.

        Returns
        -------
        (j, m) bool array
            Canonical labels of the new classes.
        list of j bytes
            Their keys.
        (j,) int array
            The row of each among the k rows, ascending.
        """
        rows = canonical(rows, self.space.group)
        fresh: dict[bytes, int] = {}
        # A converging search proposes mostly known classes. They are not checked again.
        for number, key in enumerate(keys(rows)):
            if key not in self.seen:
                fresh.setdefault(key, number)
        named, places = list(fresh), np.fromiter(fresh.values(), dtype=np.int64, count=len(fresh))
        if not all_feasible:
            good = feasible(self.space, rows[places])
            places = places[good]
            named = [key for key, fine in zip(named, good.tolist(), strict=True) if fine]
        named, places = named[:most], places[:most]
        self.seen.update(named)
        return rows[places], named, places

    def forget(self, names: Iterable[bytes]) -> None:
        """Remove classes by their keys, so that they may be proposed again.

        names: keys of canonical labellings that `ask` has not returned. Unknown keys are ignored.
        """
        self.seen.difference_update(names)


class Searcher(Driver):
    """Driver with random proposals (abstract base class).

    Each call of `propose` gives about `size` labellings, independent of the limits given to `ask`.

    size: number of labellings per batch.
    """

    def __init__(self, space: SearchSpace, seed: int, size: int) -> None:
        super().__init__(space, seed)
        self.size = size
        self.rng = BufferedRandom(np.random.default_rng(seed))
        self.operators: Operators = operators(space)
        self.register = Register(space)
        self._unreturned = self._none
        self._enumeration: Iterator[Bits] | None = None

    @property
    def exhaustive(self) -> bool:
        """Always True, because the remaining classes are enumerated; see `Driver.exhaustive`."""
        return True

    @property
    def _none(self) -> Bits:
        """Empty array of labellings (0, m)."""
        return np.empty((0, len(self.space.fixed)), dtype=bool)

    def ask(self, limit: int | None = None) -> Bits:
        """Return the next labellings (k, m), True = dry: the rest of the last batch, or a new one.

        limit: largest number; None for the whole batch. Once `propose` returns few, the remaining classes are
        enumerated. k = 0: none is left, or the limit is 0.
        """
        if limit is not None and limit <= 0:
            return self._none
        if not len(self._unreturned):
            self._unreturned = self._batch()
        given, self._unreturned = (
            self._unreturned[:limit],
            self._unreturned[len(self._unreturned) if limit is None else limit :],
        )
        return given

    def _batch(self) -> Bits:
        """Return the next proposals, or enumerated classes once proposals have become rare."""
        if self._enumeration is None:
            rows = self.propose()
            if len(rows) < max(1, self.size // 8):
                self._enumeration = self._remaining()
            if len(rows):
                return rows
        return next(self._enumeration, self._none) if self._enumeration is not None else self._none

    @abstractmethod
    def propose(self) -> Bits:
        """Propose up to `size` new labellings, (k, m) bool array, True = dry.

        They are canonical and in `register`. A driver returns fewer where new labellings have become rare; below an
        eighth of `size`, enumeration follows.
        """

    def fresh(self, make: Callable[[int], Bits], count: int) -> Bits:
        """Collect up to `count` new classes from proposals, and register them as proposed.

        make: called with a number n; returns at most n labellings, (j, m) bool array, True = dry. count: number of
        classes wanted. Returns (k, m): canonical labellings. k < count if about `PATIENCE` × max(count, 16) proposals
        give no more. Raises DeadlinePassed: after an enforced deadline.
        """
        found = self._none
        tries = PATIENCE * max(count, _ROUND)
        while len(found) < count and tries > 0:
            checkpoint()
            wanted = max(_ROUND, count - len(found))
            tries -= wanted
            admitted = self.register.admit(
                make(wanted), count - len(found), all_feasible=self.operators.always_feasible
            )
            found = np.concatenate([found, admitted])
        return found

    def draw(self, count: int) -> Bits:
        """Draw at most `count` random labellings (j, m), True = dry; pass this method to `fresh`."""
        return self.operators.draw(count, self.rng)

    def _remaining(self) -> Iterator[Bits]:
        """Yield the classes that were not proposed yet, in batches of `size`, by enumeration."""
        waiting = self._none
        for rows, _ in Enumeration(self.space).batches():
            waiting = np.concatenate([waiting, self.register.admit(rows)])
            while len(waiting) >= self.size:
                yield waiting[: self.size]
                waiting = waiting[self.size :]
        if len(waiting):
            yield waiting
