"""Return one labelling of a space quickly, for studies whose driver proposed none in time."""

from __future__ import annotations

from contextlib import suppress
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.deadline import Deadline, DeadlinePassed, checkpoint, time_left
from jld_explore.drivers.exact.admissible import admissible_layout
from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.make import operators
from jld_explore.space import SearchSpace
from jld_explore.space.labelling import canonical
from jld_explore.space.search_space import feasible

_ROUND: Final = 16
"""Labellings drawn per batch; the cost of a batch hardly depends on its size."""

_ROUNDS: Final = 4
"""Batches of random labellings that are tried before a labelling is constructed."""

_SHARE: Final = 0.2
"""Largest share of the time left for these batches."""


def first_layout(space: SearchSpace, seed: int = 0) -> Bits:
    """Return the labelling of the scene if the space contains it, else a random or constructed one.

    Call this function inside `Deadline.enforced`. Few random labellings keep tight limits. One is then constructed from
    the formula of the limits, which also finds out where no labelling keeps them.

    Parameters
    ----------
    space : SearchSpace
        Search space with m faces.
    seed : int
        Seed of the random choices.

    Returns
    -------
    (k, m) bool array
        Canonical labels, True = dry; k = 1, or 0 if no labelling is in the space.

    Raises
    ------
    DeadlinePassed
        If the deadline passes first.
    """
    ways, rng = operators(space), BufferedRandom(np.random.default_rng(seed))
    none = np.empty((0, len(space.fixed)), dtype=bool)

    def in_space(rows: Bits) -> Bits:
        """Return the first of some labellings (k, m) that is in the space, one at a time as each may take long."""
        for row in canonical(rows, space.group):
            checkpoint()
            if feasible(space, row[None])[0]:
                return np.asarray(row[None])
        return none

    with suppress(DeadlinePassed), Deadline(_SHARE * time_left()).enforced():
        rows = space.assembly.labels[None]
        for _ in range(_ROUNDS + 1):
            if len(found := in_space(rows)):
                return found
            rows = ways.draw(_ROUND, rng)
    constructed = admissible_layout(space, seed)
    if constructed is not None or space.void is None:
        return none if constructed is None else constructed
    while not len(found := in_space(ways.draw(_ROUND, rng))):
        checkpoint()
    return found
