"""One optimisation of joints from several starts: options, time limit and accepted points."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from jld_core.arrays import Floats
from jld_geometry.search import GeometrySearch, TrustRegion


@dataclass(frozen=True)
class Point:
    """Accepted point of a search.

    start: number of the start, from 0. step: number of the point within its search; 0 is the start itself. value: λ,
    least friction coefficient factor, or least thickness. bracket: (float, float) proven bounds on λ; NaN where λ is
    not the objective or not bounded. predicted: value that the program of the step promised. radius: radius of the
    trust region, length. solves: number of proven solves so far. seconds: time since the search began, s.
    """

    start: int
    step: int
    value: float
    bracket: tuple[float, float]
    predicted: float
    radius: float
    solves: int
    seconds: float


class MoveOptions(TypedDict, total=False):
    """Options that every optimisation of joints takes by keyword.

    seconds: time limit, s. The point in work is finished. Default: none. starts: number of starts: the scene itself,
    and shaken ones. Default: 1. trust: parameters of the search. Default: those of `TrustRegion`. progress: called with
    every accepted point. Default: none.
    """

    seconds: float
    starts: int
    trust: TrustRegion | None
    progress: Callable[[Point], None] | None


class MoveRun:
    """Starts of an optimisation under one time limit, and the record of their points.

    deadline: end of the time limit, as `time.perf_counter` counts, s. trust: parameters of the search. points: all
    accepted points so far. best: (k,) variables of the best end so far, which the caller keeps here: later starts are
    shaken near it. watched: True if somebody is told of every point.
    """

    def __init__(
        self,
        *,
        seconds: float = math.inf,
        starts: int = 1,
        trust: TrustRegion | None = None,
        progress: Callable[[Point], None] | None = None,
    ) -> None:
        self._began, self._starts, self._progress = time.perf_counter(), starts, progress
        self.deadline, self.trust, self.watched = self._began + seconds, trust, progress is not None
        self.points: list[Point] = []
        self.best: Floats | None = None
        self._taken: Counter[int] = Counter()

    def each_start(self, search: GeometrySearch) -> Iterator[tuple[int, Floats | None]]:
        """Return number and variables (k,) of each start until the time is over.

        Variables are None where no shaken start was found.
        """
        for number in range(self._starts):
            if number and time.perf_counter() > self.deadline:
                return
            yield number, np.zeros(search.variables.count) if number == 0 else search.shaken(number, self.best)

    def record(
        self, start: int, value: float, bracket: tuple[float, float], predicted: float, radius: float, solves: int
    ) -> None:
        """Record an accepted point of a start; arguments as the attributes of `Point`."""
        spent = time.perf_counter() - self._began
        point = Point(start, self._taken[start], value, bracket, predicted, radius, solves, spent)
        self._taken[start] += 1
        self.points.append(point)
        if self._progress is not None:
            self._progress(point)
