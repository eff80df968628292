"""How drivers compare evaluations: the order of the results table, and objectives where there are numbers.

Collapse comes first, by λ; then locked, uncertified, unstable and failed, each a rank of its own and never a
number. Locked stands below every number although it carries any load: one such labelling answers the question
whether the load can be unbounded, and more of them would draw a search away from the largest finite λ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
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


def meets(space: SearchSpace, evaluation: Evaluation) -> bool:
    """Whether a labelling is proven to carry what is required; True where nothing is. Locked ones carry any load."""
    required = space.search.require
    if required is None or evaluation.status is Status.LOCKED:
        return True
    return evaluation.status is Status.COLLAPSE and evaluation.low >= required.threshold


def may_meet(space: SearchSpace, evaluation: Evaluation) -> bool:
    """Whether a labelling is not proven to carry less than is required."""
    required = space.search.require
    if required is None or meets(space, evaluation):
        return True
    if evaluation.status is Status.UNSTABLE:
        return False
    # there may be other solutions without dilation than the one found; the associative λ bounds them all
    high = evaluation.high if math.isnan(evaluation.zero_dilation) else evaluation.associative
    return not high < required.threshold


def aims(space: SearchSpace, labellings: Bits, evaluations: Sequence[Evaluation]) -> Floats:
    """(k,) the number to be made large: λ; where a load factor is required, what λ has of it, and from there on the
    better the first count of the scene's front the more. Without a number 0.
    """
    value = np.array([worth(found) for found in evaluations], dtype=np.float64)
    required = space.search.require
    if required is None:
        return value
    met = np.array([meets(space, found) for found in evaluations], dtype=bool)
    share = 1.0 / (1.0 + abs(front_counts(space, labellings)[:, 0]))
    gain = share if space.search.front.axes[0][1] == "min" else 1.0 - share
    short = np.minimum(value, required.threshold * (1.0 - tolerances.PROVEN))
    return np.asarray(np.where(met, required.load_factor * (1.0 + gain), short))


def standing(evaluation: Evaluation, aim: float | None = None) -> tuple[int, float]:
    """What sorts evaluations, the best first: place of the status, then −λ, or −aim where given, if there is one."""
    place = _place(evaluation)
    return place, -(worth(evaluation) if aim is None else aim) if place == 0 else 0.0


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
        kept = ~np.triu(_as_good(counts, counts), 1).any(axis=0)
        self.values, self.counts = values[kept], counts[kept]

    def best(self, counts: Floats) -> Floats:
        """(k,) for counts (k, c); −inf where nothing is known."""
        if not len(self.values):
            return np.full(len(counts), -np.inf)
        as_good = _as_good(self.counts, counts)
        return np.asarray(np.where(as_good, self.values[:, None], -np.inf).max(axis=0))


def _as_good(counts: Floats, others: Floats) -> Bools:
    """(a, b) where counts (a, c) are none worse than others (b, c)."""
    found = np.ones((len(counts), len(others)), dtype=bool)
    for one, other in zip(counts.T, others.T, strict=True):
        found &= one[:, None] <= other[None]
    return found


def objectives(space: SearchSpace, labellings: Bits, evaluations: Sequence[Evaluation]) -> Floats:
    """(k, 1 + c) what is minimised: −λ (see `aims`), and the counts of the scene's front with the signs of senses.

    labellings: (k, m). Rows without collapse have no λ: theirs is 0 and must be kept apart by `places`.
    """
    return np.column_stack([-aims(space, labellings, evaluations), front_counts(space, labellings)])
