"""Explain in words why a labelling is not in a search space, by the tests of `feasible`."""

from __future__ import annotations

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_explore.space.counts import values_of
from jld_explore.space.labelling import blocks_of
from jld_explore.space.limits import Range, block_sizes
from jld_explore.space.search_space import SearchSpace


def reasons_against(space: SearchSpace, labels: Bits) -> tuple[str, ...]:
    """Explain why a labelling is not in a search space.

    Parameters
    ----------
    space : SearchSpace
        Search space.
    labels : (m,) array of bool
        True = dry.

    Returns
    -------
    tuple of str
        One sentence per violated condition; empty if `feasible` accepts the labelling.
    """
    blocks = blocks_of(space.graph, labels[None])
    return (*_of_faces(space, labels, blocks[0]), *_of_blocks(space, blocks), *_of_counts(space, labels))


def _of_faces(space: SearchSpace, labels: Bits, block: Ints) -> list[str]:
    """Return violations of fixed labels and of `search.segmentation`; block: (n,) of each element."""
    found = []
    for label, name in ((True, "dry"), (False, "inner")):
        kept = (labels != space.fixed) & ~space.candidates & (space.fixed == label)
        if kept.any():
            found.append(f"{_faces(space, kept)} must be {name}")
    slits = labels & (block[space.graph.a] == block[space.graph.b])
    if space.search.segmentation and slits.any():
        found.append(f"{_faces(space, slits)} dry with one block on both sides")
    return found


def _of_blocks(space: SearchSpace, blocks: Ints) -> list[str]:
    """Return violations of limits on the size and shape of blocks."""
    limits, found = space.limits, []
    names = np.unique(blocks[0][space.assembly.elements.free])
    excepted = np.isin(names, blocks[0][limits.excepted])
    for measure, bounds in limits.on_blocks:
        sizes = block_sizes(space.assembly, blocks, [measure])[measure.key][0][names]
        wrong = bounds.outside(sizes) & ~excepted
        if wrong.any():
            worst = int(np.argmax(np.where(wrong, sizes, -1.0)))
            what = f"{_block(space, blocks[0], int(names[worst]), wrong)} has {sizes[worst]:.6g} {measure.words}"
            found.append(f"{what}; {measure.key} allows {_words(bounds)}")
    if limits.on_shapes:
        wrong = np.array([limits.misshapen(_members(space, blocks[0], int(name)).tolist()) for name in names])
        if wrong.any():
            first = int(names[np.argmax(wrong)])
            allowed = ", ".join(f"{name} {_words(bounds)}" for name, bounds in limits.on_shapes)
            found.append(f"{_block(space, blocks[0], first, wrong)} has a shape that is not allowed ({allowed})")
    return found


def _of_counts(space: SearchSpace, labels: Bits) -> list[str]:
    """Return violations of limits on counts and of the assembly sequence."""
    limits, found = space.limits, []
    for count, bounds in limits.on_counts:
        value = values_of(count, space.assembly, labels[None], space.graph, limits.block_shapes)[0]
        if bounds.outside(value):
            found.append(f"{count.name} is {value:.6g}; the search allows {_words(bounds)}")
    if not space.can_be_laid(labels[None])[0]:
        found.append(f"it cannot be laid as assemble: {space.search.assemble} asks")
    return found


def _words(bounds: Range) -> str:
    if bounds.low is None:
        return f"at most {bounds.high:.6g}"
    return f"at least {bounds.low:.6g}" if bounds.high is None else f"{bounds.low:.6g} to {bounds.high:.6g}"


def _members(space: SearchSpace, block: Ints, name: int) -> Ints:
    """Return the free elements of a block."""
    return np.flatnonzero((block == name) & ~space.assembly.elements.support)


def _block(space: SearchSpace, block: Ints, name: int, wrong: Bools) -> str:
    """Name a block for a message, with the number of blocks (n,) that violate the limit."""
    first, more = space.assembly.elements.ids[_members(space, block, name)[0]], int(wrong.sum()) - 1
    return f"the block of {first!r}" + (f" (one of {more + 1})" if more else "")


def _faces(space: SearchSpace, chosen: Bools) -> str:
    pair, count = space.assembly.pair(int(np.argmax(chosen))), int(chosen.sum())
    return f"face {pair}" if count == 1 else f"{count} faces, the first {pair},"
