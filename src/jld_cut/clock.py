"""One clock for all stages of a cut: each has its share, and what cannot end in what is left is left out and named."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, TypeVar

from jld_core import Deadline, DeadlinePassed

T = TypeVar("T")

SEARCHED: Final = 0.45  # share of the time at which the search ends
CHOSEN: Final = 0.65  # at which the best are judged
KEYED: Final = 0.87  # at which keys are in their joints
FILED: Final = 0.93  # at which its files are written
DRAWN: Final = 0.97  # at which all is drawn


class Clock:
    """Time of a cut, and the stages that it had no room for."""

    def __init__(self, seconds: float) -> None:
        self.start, self.seconds = time.time(), seconds
        self.left_out: list[str] = []

    def at(self, share: float) -> float:
        """Return the moment at which a share of the time is spent, s since the epoch."""
        return self.start + share * self.seconds

    def left(self, share: float = 1.0) -> float:
        """Return the time until a share of all is spent, s."""
        return self.at(share) - time.time()

    def run(self, name: str, share: float, work: Callable[[], T], least: float = 0.0) -> T | None:
        """Do a stage that needs so many seconds at least, up to a share of all time; None, and named, for no room."""
        if self.left(share) > least:
            try:
                with Deadline(self.left(share)).enforced():
                    return work()
            except DeadlinePassed:
                pass
        self.left_out.append(name)
        return None
