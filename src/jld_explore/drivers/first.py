"""One labelling of a space, as soon as can be: what is shown where a driver named none in its time."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.deadline import checkpoint
from jld_explore.drivers.operators import BufferedRandom, operators
from jld_explore.space import SearchSpace, canonical, feasible

_ROUND: Final = 16
"""Labellings drawn at a time: what a batch of draws costs hardly depends on its size."""


def first_layout(space: SearchSpace, seed: int = 0) -> Bits:
    """Return one labelling of a space: the scene's own where the space holds it, else the first drawn that it holds.

    Draws until one is found, so it is called inside `Deadline.enforced`.

    Parameters
    ----------
    space : SearchSpace
        Space with m faces.
    seed : int
        Seed of the draws.

    Returns
    -------
    (1, m) bool array
        True = dry, canonical.

    Raises
    ------
    DeadlinePassed
        Where the time is up first.
    """
    ways, rng = operators(space), BufferedRandom(np.random.default_rng(seed))
    rows = canonical(space.assembly.labels[None], space.group)
    while True:
        for row in rows:
            # one by one: what decides may take long
            checkpoint()
            if feasible(space, row[None])[0]:
                return np.asarray(row[None])
        rows = canonical(ways.draw(_ROUND, rng), space.group)
