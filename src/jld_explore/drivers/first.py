"""Return one labelling of a space quickly, for studies whose driver proposed none in time."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.deadline import checkpoint
from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.segmentations import operators
from jld_explore.space import SearchSpace
from jld_explore.space.labelling import canonical
from jld_explore.space.search_space import feasible

_ROUND: Final = 16
"""Labellings drawn per batch; the cost of a batch hardly depends on its size."""


def first_layout(space: SearchSpace, seed: int = 0) -> Bits:
    """Return the labelling of the scene if the space contains it, else a random one.

    The function draws until it finds a feasible labelling. Call it inside `Deadline.enforced`.

    Parameters
    ----------
    space : SearchSpace
        Search space with m faces.
    seed : int
        Seed of the random choices.

    Returns
    -------
    (1, m) bool array
        Canonical labels, True = dry.

    Raises
    ------
    DeadlinePassed
        If the deadline passes first.
    """
    ways, rng = operators(space), BufferedRandom(np.random.default_rng(seed))
    rows = canonical(space.assembly.labels[None], space.group)
    while True:
        for row in rows:
            # check one labelling at a time, because feasibility may take long to decide
            checkpoint()
            if feasible(space, row[None])[0]:
                return np.asarray(row[None])
        rows = canonical(ways.draw(_ROUND, rng), space.group)
