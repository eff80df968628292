"""Hill climbing with restarts: several runs, each at the best labelling it has found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits
from jld_core.assembly import with_members
from jld_core.errors import ParameterError
from jld_explore.drivers.base import DriverOptions
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluation.protocol import Evaluation, objective_values, sort_key
from jld_explore.space import LETTERS, feasible, from_string, keys
from jld_explore.space.search_space import SearchSpace

_EVERY_RUN = -1  # owner index of the labelling at which all runs start


@dataclass
class _Run:
    labelling: Bits | None = None  # (m,) current labelling, True = dry; None before its start is evaluated
    sort_key: tuple[int, float] = (99, 0.0)  # sort key of the current labelling, from `sort_key`; less is better
    stalled: int = 0  # rounds without improvement


class HillClimbOptions(DriverOptions):
    start: str | None = Field(None, description="letters d and i of the labelling at which all runs start")


class HillClimb(Searcher):
    """Driver that climbs in several runs, which restart from random labellings."""

    name = "hillclimb"
    Options = HillClimbOptions
    ahead: int = 1

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        climbers: int = 8,
        neighbours: int = 8,
        rounds: int = 4,
        start: str | None = None,
    ) -> None:
        """Set up `climbers` runs of `neighbours` changes a round, which restart after `rounds` without gain."""
        super().__init__(space, seed, climbers * neighbours)
        self.neighbours, self.rounds, self.start_text = neighbours, rounds, start
        self._runs = [_Run() for _ in range(climbers)]
        self._run_of_key: dict[bytes, int] = {}
        self._first: Bits | None = None
        if start is not None:
            faces = space.assembly.faces
            if len(start) != faces or start.strip(LETTERS):
                raise ParameterError("start", f"it is {start[:40]!r}", f"{faces} letters d or i")
            self._first = with_members(space.assembly, from_string(start))
            if not feasible(space, self._first[None])[0]:
                raise ParameterError("start", "the search does not admit it", "a segmentation within all limits")

    @property
    def settings(self) -> dict[str, Any]:
        return {} if self.start_text is None else {"start": self.start_text}

    def propose(self) -> Bits:
        # Runs that restart give one random labelling. The first call has the given start, if any, and changes of it.
        if self._first is not None:
            return self._beginning(self._first)
        batches = []
        for number, run in enumerate(self._runs):
            if run.stalled >= self.rounds:
                run = self._runs[number] = _Run()
            rows = self._no_labellings
            if run.labelling is not None:
                labelling = run.labelling

                def near(count: int, labelling: Bits = labelling) -> Bits:
                    return self.operators.vary(np.repeat(labelling[None], count, axis=0), self.rng)

                rows = self.fresh(near, self.neighbours)
                run.stalled += 1
                if len(rows) == 0:
                    run = self._runs[number] = _Run()
            if run.labelling is None:
                rows = self.fresh(self.draw, 1)
            self._run_of_key.update((key, number) for key in keys(rows))
            batches.append(rows)
        return np.concatenate(batches)

    def _beginning(self, first: Bits) -> Bits:
        """Return the given start, shared by all runs, and neighbours that fill the round: (k, m)."""
        self._first = None
        start = self.register.admit(first[None])
        near = self.fresh(lambda count: self.operators.vary(np.repeat(start, count, axis=0), self.rng), self.size - 1)
        self._run_of_key.update((key, _EVERY_RUN) for key in keys(start))
        self._run_of_key.update((key, k % len(self._runs)) for k, key in enumerate(keys(near)))
        return np.concatenate([start, near])

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        # each run moves to its best change, if that is better; labellings of no run are ignored
        values = objective_values(self.space, labellings, evaluations).tolist()
        for key, labels, evaluation, value in zip(keys(labellings), labellings, evaluations, values, strict=True):
            number = self._run_of_key.pop(key, None)
            if number is None:
                continue
            new_key = sort_key(evaluation, value)
            for run in self._runs if number == _EVERY_RUN else [self._runs[number]]:
                if new_key < run.sort_key:
                    run.labelling, run.sort_key, run.stalled = labels, new_key, 0
