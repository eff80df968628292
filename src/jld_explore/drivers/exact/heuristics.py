"""Labellings that heuristic drivers propose before a proof, and from time to time beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from jld_core.arrays import Bits
from jld_explore.drivers.base import Driver
from jld_explore.evaluation import Evaluation


class Heuristics:
    """Heuristic drivers of a proof: one that may begin it, and one that runs whenever it is due.

    driver: driver that runs whenever it is due. due: number of its labellings before the proof. due: number of its
    labellings that are due now. limit: largest number of labellings that are proposed together; None for no limit.
    """

    def __init__(self, driver: Driver, due: int) -> None:
        self.driver, self.due = driver, due
        self.limit: int | None = None
        self._starter: Driver | None = None
        self._starter_due = 0

    @property
    def starting(self) -> bool:
        """Return True if labellings of the driver that begins are due."""
        return self._starter_due > 0

    def begin_with(self, starter: Driver, due: int) -> None:
        """Let another driver begin the proof with `due` labellings, in place of the usual driver."""
        self._starter, self._starter_due = starter, due
        self.due = 0

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations of labellings (k, m); see `Driver.tell`."""
        self.driver.tell(labellings, evaluations)
        if self._starter is not None:
            self._starter.tell(labellings, evaluations)

    def start(self) -> Iterator[Bits]:
        """Yield labellings (k, m) of the driver that begins, until none is due."""
        while self._starter is not None and self._starter_due > 0:
            found = self._starter.ask(self._limited(self._starter_due))
            self._starter_due -= len(found) or self._starter_due
            yield found
        self._starter = None

    def run(self) -> Iterator[Bits]:
        """Yield labellings (k, m) of the usual driver, until none is due."""
        while self.due > 0:
            found = self.driver.ask(self._limited(self.due))
            self.due -= len(found) or self.due
            yield found

    def _limited(self, due: int) -> int:
        """Return the number of labellings to ask for, if `due` are due."""
        return due if self.limit is None else min(self.limit, due)
