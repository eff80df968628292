"""Construct one labelling of a space from the formula of its limits, or prove that there is none.

Random labellings rarely keep tight limits. The formula of the exact driver states most limits, and a satisfiability
solver finds a model of it in milliseconds. Limits on different shapes become a limit on the kinds of chosen blocks.
Limits that the formula cannot express are checked on each model, and a model that violates one is ruled out.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from jld_core.arrays import Bits
from jld_core.deadline import checkpoint
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks, possible_blocks
from jld_explore.space import SearchSpace
from jld_explore.space.labelling import canonical
from jld_explore.space.search_space import feasible


def admissible_layout(space: SearchSpace, seed: int = 0) -> Bits | None:
    """Construct a labelling of a space, or prove that there is none.

    Call this function inside `Deadline.enforced`. Where cells may be left out it seeks labellings with all cells only.

    Parameters
    ----------
    space : SearchSpace
        Search space with m faces.
    seed : int
        Seed of the labels that the satisfiability solver tries first.

    Returns
    -------
    (1, m) bool array or None
        Canonical labels, True = dry; None if the space has no labelling, or none with all cells.

    Raises
    ------
    DeadlinePassed
        If the deadline passes first.
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
    """Return a labelling (1, m) of part of a space from the formula of the part; None if the part is empty.

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
