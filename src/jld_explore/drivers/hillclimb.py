"""Hill climbing with restarts: several climbers, each at the best labelling it has met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from jld_core.arrays import Bits
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluation import Evaluation, standing
from jld_explore.space import SearchSpace, keys


@dataclass
class _Climber:
    """place: (m,) where it stands, None before its start is known. worth: as `standing` gives it. stalled:
    rounds without a step."""

    place: Bits | None = None
    worth: tuple[int, float] = (99, 0.0)
    stalled: int = 0


class HillClimb(Searcher):
    """Each climber tries `neighbours` changes of its labelling a round and steps to the best of them where
    that is better; after `rounds` rounds without a step it starts again from a random labelling."""

    name = "hillclimb"
    ahead: ClassVar[int] = 1

    def __init__(self, space: SearchSpace, seed: int, climbers: int = 8, neighbours: int = 8, rounds: int = 4) -> None:
        super().__init__(space, seed, climbers * neighbours)
        self.neighbours, self.rounds = neighbours, rounds
        self._climbers = [_Climber() for _ in range(climbers)]
        self._owner: dict[bytes, int] = {}

    def propose(self) -> Bits:
        """The neighbours of every climber, and random starts for those that begin."""
        batches = []
        for number, climber in enumerate(self._climbers):
            if climber.stalled >= self.rounds:
                climber = self._climbers[number] = _Climber()
            rows = self._none
            if climber.place is not None:
                place = climber.place

                def near(count: int, place: Bits = place) -> Bits:
                    return self.operators.vary(np.repeat(place[None], count, axis=0), self.rng)

                rows = self.fresh(near, self.neighbours)
                climber.stalled += 1
                if len(rows) == 0:
                    climber = self._climbers[number] = _Climber()
            if climber.place is None:
                rows = self.fresh(self.draw, 1)
            self._owner.update((key, number) for key in keys(rows))
            batches.append(rows)
        return np.concatenate(batches)

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Climbers step to what is better than where they stand."""
        for key, labels, found in zip(keys(labellings), labellings, evaluations, strict=True):
            number = self._owner.pop(key, None)
            if number is None:
                continue
            climber, worth = self._climbers[number], standing(found)
            if worth < climber.worth:
                climber.place, climber.worth, climber.stalled = labels, worth, 0
