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
    """(k,) the count of the scene's front of labellings (k, m), with the sign that makes less better."""
    front = space.search.front
    sign = -1.0 if front.sense == "max" else 1.0
    return np.asarray(
        sign * values_of(count_named(front.count), space.assembly, labellings, space.graph, space.limits.block_shapes)
    )


def objectives(space: SearchSpace, labellings: Bits, evaluations: Sequence[Evaluation]) -> Floats:
    """(k, 2) what is minimised: −λ, and the count of the scene's front with the sign of its sense.

    labellings: (k, m). Rows without collapse have no λ: theirs is 0 and must be kept apart by `places`.
    """
    value = [worth(found) for found in evaluations]
    return np.column_stack([-np.array(value), front_counts(space, labellings)])
