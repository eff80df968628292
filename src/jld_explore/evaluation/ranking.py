"""Rank evaluations: the order of the results table and the objectives of drivers.

Collapse comes first, sorted by λ. Locked, uncertified, unstable and failed follow, each as a rank without a number.
Locked ranks below every number although a locked labelling carries any load.
One such labelling answers whether the load can be unbounded; more would draw a search away from the largest finite λ.
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
"""Statuses in the order of the results table, best first."""


def comparison_value(evaluation: Evaluation) -> float:
    """Return the number by which a driver compares an evaluation.

    evaluation: result of one labelling. Result: λ of a collapse, the upper bound of a pruned labelling, else 0; scene
    units.
    """
    if evaluation.settled == BOUND:
        return evaluation.high
    return evaluation.load_factor if evaluation.status is Status.COLLAPSE else 0.0


def meets_requirement(space: SearchSpace, evaluation: Evaluation) -> bool:
    """Return True if a labelling provably reaches the required load factor.

    space: search space with the requirement `search.require`, which may be None. evaluation: result of one labelling.
    Result: True without a requirement and for locked labellings, which carry any load.
    """
    required = space.search.require
    if required is None or evaluation.status is Status.LOCKED:
        return True
    return evaluation.status is Status.COLLAPSE and evaluation.low >= required.threshold


def may_meet_requirement(space: SearchSpace, evaluation: Evaluation) -> bool:
    """Return True unless a labelling provably misses the required load factor.

    space: search space with the requirement `search.require`, which may be None. evaluation: result of one labelling.
    Result: True without a requirement. Otherwise False for unstable labellings and for those whose upper bound on λ is
    below the required one.
    """
    required = space.search.require
    if required is None or meets_requirement(space, evaluation):
        return True
    if evaluation.status is Status.UNSTABLE:
        return False
    # Solutions without dilation are not unique; the associative λ bounds all of them from above.
    high = evaluation.high if math.isnan(evaluation.zero_dilation) else evaluation.associative
    return not high < required.threshold


def objective_values(space: SearchSpace, labellings: Bits, evaluations: Sequence[Evaluation]) -> Floats:
    """Compute the objective that a driver maximises.

    Without a requirement the objective is `comparison_value`. With a required load factor it is λ up to the
    requirement. Beyond the requirement it grows with the quality of the first count of the scene's front.

    space: search space with requirement and front. labellings: (k, m) True = dry. evaluations: results of the k
    labellings. Returns (k,): objectives, scene units of λ; 0 for an evaluation without a number.
    """
    value = np.array([comparison_value(found) for found in evaluations], dtype=np.float64)
    required = space.search.require
    if required is None:
        return value
    met = np.array([meets_requirement(space, found) for found in evaluations], dtype=bool)
    share = 1.0 / (1.0 + abs(front_counts(space, labellings)[:, 0]))
    gain = share if space.search.front.axes[0][1] == "min" else 1.0 - share
    short = np.minimum(value, required.threshold * (1.0 - tolerances.PROVEN))
    return np.asarray(np.where(met, required.load_factor * (1.0 + gain), short))


def sort_key(evaluation: Evaluation, objective: float | None = None) -> tuple[int, float]:
    """Return the key that sorts evaluations, best first.

    evaluation: result of one labelling. objective: objective from `objective_values` that replaces `comparison_value`.
    Result: rank of the status (see `status_ranks`), then minus the objective for rank 0, and 0.0 for other ranks.
    """
    rank = _status_rank(evaluation)
    return rank, -(comparison_value(evaluation) if objective is None else objective) if rank == 0 else 0.0


def _status_rank(evaluation: Evaluation) -> int:
    """Return the rank of the status in `ORDER`, 0 for an evaluation settled by a bound."""
    return 0 if evaluation.settled == BOUND else ORDER.index(evaluation.status)


def status_ranks(evaluations: Sequence[Evaluation]) -> Ints:
    """Return the rank of each evaluation's status.

    evaluations: results of k labellings. Returns (k,): positions in `ORDER`; 0 for collapse and for evaluations settled
    by a bound.
    """
    return np.array([_status_rank(found) for found in evaluations], dtype=np.int64)


def front_counts(space: SearchSpace, labellings: Bits) -> Floats:
    """Compute the counts of the scene's front, signed so that less is better.

    space: search space with the axes of the front. labellings: (k, m) True = dry. Returns (k, c): values of the c
    counts; counts to be maximised are negated.
    """
    graph, shapes = space.graph, space.limits.block_shapes
    found = [
        (-1.0 if sense == "max" else 1.0) * values_of(count_named(name), space.assembly, labellings, graph, shapes)
        for name, sense in space.search.front.axes
    ]
    return np.column_stack(found)


class Envelope:
    """Largest λ known among labellings whose counts are equal or better.

    Call `learn` for known labellings, then `best`.

    size: number c of counts of the front. values: (p,) λ of the non-dominated labellings, descending. counts: (p, c)
    counts of these labellings; less is better.
    """

    def __init__(self, size: int) -> None:
        self.values, self.counts = np.empty(0), np.empty((0, size))

    def learn(self, values: Floats, counts: Floats) -> None:
        """Add λ (k,) of labellings with counts (k, c) and drop dominated labellings.

        Less is better for every count.
        """
        values, counts = np.concatenate([self.values, values]), np.concatenate([self.counts, counts])
        # Sort by descending λ: a later entry matters only if no earlier one has equal or better counts.
        order = np.lexsort((*counts.T, -values))
        values, counts = values[order], counts[order]
        kept = ~np.triu(_as_good(counts, counts), 1).any(axis=0)
        self.values, self.counts = values[kept], counts[kept]

    def best(self, counts: Floats) -> Floats:
        """Return (k,) largest λ known for counts (k, c) or better; −inf if nothing is known."""
        if not len(self.values):
            return np.full(len(counts), -np.inf)
        as_good = _as_good(self.counts, counts)
        return np.asarray(np.where(as_good, self.values[:, None], -np.inf).max(axis=0))


def _as_good(counts: Floats, others: Floats) -> Bools:
    """Return a mask (a, b), True where counts are equal to or better than other counts.

    counts: (a, c), others: (b, c); less is better for every count.
    """
    found = np.ones((len(counts), len(others)), dtype=bool)
    for one, other in zip(counts.T, others.T, strict=True):
        found &= one[:, None] <= other[None]
    return found


def objectives(space: SearchSpace, labellings: Bits, evaluations: Sequence[Evaluation]) -> Floats:
    """Compute the objectives that a driver minimises: −λ and the counts of the front.

    space: search space with requirement and front. labellings: (k, m) True = dry. evaluations: results of the k
    labellings. Returns (k, 1 + c): objectives, with signs such that less is better; for λ see `objective_values`. Rows
    without collapse have 0 instead of λ; use `status_ranks` to tell them apart.
    """
    return np.column_stack([-objective_values(space, labellings, evaluations), front_counts(space, labellings)])
