"""Return one labelling of a space quickly, for studies whose driver proposed none in time.

Random labellings rarely keep tight limits. The formula of the exact driver states most limits, and a satisfiability
solver finds a model of it in milliseconds, or proves that there is none. Limits on different shapes become a limit on
the kinds of chosen blocks. Limits that the formula cannot express are checked on each model, and a model that violates
one is ruled out.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.deadline import Deadline, DeadlinePassed, checkpoint, time_left
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks, possible_blocks
from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.make import operators
from jld_explore.space import SearchSpace
from jld_explore.space.labelling import canonical
from jld_explore.space.search_space import feasible

_ROUND: Final = 16  # labellings drawn per batch; the cost of a batch hardly depends on its size

_ROUNDS: Final = 4  # batches of random labellings that are tried before a labelling is constructed

_SHARE: Final = 0.2  # largest share of the time left for these batches


def first_layout(space: SearchSpace, seed: int = 0) -> Bits:
    """Return a labelling of the space: that of the scene, a random or a constructed one.

    Call this function inside `Deadline.enforced`. Few random labellings keep tight limits. One is then constructed from
    the formula of the limits, which also finds out where no labelling keeps them.

    space: search space with m faces. Returns (k, m): canonical labels, True = dry; k = 1, or 0 if no labelling is in
    the space. Raises DeadlinePassed if the deadline passes first.
    """
    ways, rng = operators(space), BufferedRandom(np.random.default_rng(seed))
    none = np.empty((0, len(space.fixed)), dtype=bool)

    def in_space(rows: Bits) -> Bits:
        """Return the first of some labellings (k, m) that is in the space, if any."""
        for row in canonical(rows, space.group):  # one at a time, as each may take long
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


def admissible_layout(space: SearchSpace, seed: int = 0) -> Bits | None:
    """Construct a labelling of a space, or prove that there is none.

    Call this function inside `Deadline.enforced`. Where cells may be left out it seeks labellings with all cells only.

    space: search space with m faces. seed: seed of the labels that the satisfiability solver tries first. Result: (1,
    m) canonical labels, True = dry; None if the space has no labelling, or none with all cells. Raises DeadlinePassed
    if the deadline passes first.
    """
    low, high = space.search.block_cells
    least, most = max(1, int(low or 1)), len(space.assembly.elements.free) if high is None else int(high)
    for cells in [*range(least, most), None]:
        subspace = space.part_of_blocks(cells)
        blocks = possible_blocks(subspace)
        if blocks is None and cells is not None:
            continue
        found = _constructed(subspace, blocks, space, seed)
        if found is not None or subspace is space:
            return found
    return None if space.void is not None else _constructed(space, None, space, seed)


def _constructed(subspace: SearchSpace, blocks: PossibleBlocks | None, space: SearchSpace, seed: int) -> Bits | None:
    """Return a labelling (1, m) of part of a space from its formula; None if it is empty.

    `blocks` are the possible blocks of the part, if they are listed.
    """
    formula = Formula(subspace, blocks, partial=True)
    shapes = [bounds for count, bounds in subspace.limits.on_counts if count.kinds]
    if blocks is not None and shapes:
        formula.limit_kinds(subspace.limits.block_shapes.kinds(blocks.members).tolist(), shapes[0])
    preferred_labels = _preferred(space, seed)
    while (labels := formula.next(preferred=next(preferred_labels))) is not None:
        row = canonical(labels[None], space.group)
        if feasible(space, row)[0]:
            return row
        formula.forbid(np.arange(len(labels)), labels)
    return None


def _preferred(space: SearchSpace, seed: int) -> Iterator[Bits]:
    """Yield preferred labels (m,) without end: those of the scene, then random ones."""
    rng = np.random.default_rng(seed)
    yield space.assembly.labels
    while True:
        checkpoint()
        yield rng.random(len(space.fixed)) < rng.random()
