"""How drivers compare evaluations: the order of the results table, and objectives where there are numbers.

Collapse comes first, by λ; then locked, uncertified, unstable and failed, each a rank of its own and never a
number. Locked stands below every number although it carries any load: one such labelling answers the question
whether the load can be unbounded, and more of them would draw a search away from the largest finite λ.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.limit import Status
from jld_explore.evaluation.evaluation import BOUND, Evaluation
from jld_explore.space import SearchSpace, count_named, values_of

ORDER: Final = (Status.COLLAPSE, Status.LOCKED, Status.UNCERTIFIED, Status.UNSTABLE, Status.FAILED)
"""Statuses, the best first."""


def worth(evaluation: Evaluation) -> float:
    """What a driver goes by: λ; of a labelling that was not worth a solve its upper bound; else 0."""
    if evaluation.settled == BOUND:
        return evaluation.high
    return evaluation.load_factor if evaluation.status is Status.COLLAPSE else 0.0


def standing(evaluation: Evaluation) -> tuple[int, float]:
    """What sorts evaluations, the best first: place of the status, then −λ where λ is a number."""
    place = _place(evaluation)
    return place, -worth(evaluation) if place == 0 else 0.0


def _place(evaluation: Evaluation) -> int:
    return 0 if evaluation.settled == BOUND else ORDER.index(evaluation.status)


def places(evaluations: Sequence[Evaluation]) -> Ints:
    """(k,) place of each status in ORDER, 0 for collapse and for what has a number to go by."""
    return np.array([_place(found) for found in evaluations], dtype=np.int64)


def front_counts(space: SearchSpace, labellings: Bits) -> Floats:
    """(k, c) the counts of the scene's front of labellings (k, m), with the signs that make less better."""
    graph, shapes = space.graph, space.limits.block_shapes
    found = [
        (-1.0 if sense == "max" else 1.0) * values_of(count_named(name), space.assembly, labellings, graph, shapes)
        for name, sense in space.search.front.axes
    ]
    return np.column_stack(found)


class Envelope:
    """The largest λ known for what counts as well or better. size: counts of the front."""

    def __init__(self, size: int) -> None:
        self.values, self.counts = np.empty(0), np.empty((0, size))

    def learn(self, values: Floats, counts: Floats) -> None:
        """Take in λ (k,) of labellings that count (k, c), less being better."""
        values, counts = np.concatenate([self.values, values]), np.concatenate([self.counts, counts])
        # the best first: what comes later matters only where it counts better than all before
        order = np.lexsort((*counts.T, -values))
        values, counts = values[order], counts[order]
        kept: list[int] = []
        for row in range(len(values)):
            if not (counts[kept] <= counts[row]).all(axis=1).any():
                kept.append(row)
        self.values, self.counts = values[kept], counts[kept]

    def best(self, counts: Floats) -> Floats:
        """(k,) for counts (k, c); −inf where nothing is known."""
        if not len(self.values):
            return np.full(len(counts), -np.inf)
        as_good = (self.counts[None] <= counts[:, None]).all(axis=2)
        return np.asarray(np.where(as_good, self.values[None], -np.inf).max(axis=1))


def objectives(space: SearchSpace, labellings: Bits, evaluations: Sequence[Evaluation]) -> Floats:
    """(k, 1 + c) what is minimised: −λ, and the counts of the scene's front with the signs of their senses.

    labellings: (k, m). Rows without collapse have no λ: theirs is 0 and must be kept apart by `places`.
    """
    value = [worth(found) for found in evaluations]
    return np.column_stack([-np.array(value), front_counts(space, labellings)])
