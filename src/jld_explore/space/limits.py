"""What a labelling must satisfy under "search", and the counts of tables and fronts; many rows at a time."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_core.assembly import Assembly
from jld_explore.space.labelling import Connectivity, above, below, block_sizes, blocks_of
from jld_explore.space.search_space import SearchSpace

_CHUNK: Final = 8192
"""Rows counted together: what stays in a cache level."""


def _cells(assembly: Assembly, graph: Connectivity, labellings: Bits) -> Ints:
    """(n, k) free elements in each block, at the row of its smallest element; labellings (k, m).

    Joins blocks face by face in small integers: for many rows ten times faster than `blocks_of`.
    """
    count, width = len(graph.start), len(labellings)
    kind = np.uint8 if count <= 256 else np.uint16 if count <= 65536 else np.uint32
    block = np.repeat(np.arange(count, dtype=kind)[:, None], width, axis=1)
    inner = np.ascontiguousarray(~labellings.T)
    always = np.ones(width, dtype=bool)
    joints = [(a, b, always) for a, b in graph.touching]
    for a, b, joined in [*joints, *zip(graph.a, graph.b, inner, strict=True)]:
        low, high = np.minimum(block[a], block[b]), np.maximum(block[a], block[b])
        high[~joined] = low[~joined]
        if np.any(low != high):
            np.copyto(block, low, where=block == high)
    place = block[assembly.elements.free].astype(np.int64) * width + np.arange(width)
    return np.bincount(place.ravel(), minlength=count * width).reshape(count, width)


def feasible(space: SearchSpace, labellings: Bits) -> Bools:
    """(k,) True for labellings (k, m) that are in the space: fixed labels, segmentation and all limits."""
    blocks = blocks_of(space.graph, labellings)
    good = ~np.any((labellings != space.fixed) & ~space.candidates, axis=1)
    if space.search.segmentation:
        good &= ~np.any(labellings & (blocks[:, space.graph.a] == blocks[:, space.graph.b]), axis=1)
    return np.asarray(good & within_limits(space, labellings, blocks))


def within_limits(space: SearchSpace, labellings: Bits, blocks: Ints) -> Bools:
    """(k,) True where block sizes, number of blocks and number of dry faces are within their limits.

    labellings: (k, m); blocks: (k, n), their blocks as `blocks_of` names them. Bounds are inclusive, and
    lengths and weights may pass them by `tolerances.DECIMALS`. A block without a free element has no size.
    """
    search = space.search
    sizes = block_sizes(space.assembly, blocks, extents=search.block_extent != [None, None])
    holds = sizes.cells > 0
    good = np.ones(len(labellings), dtype=bool)
    for values, (low, high) in (
        (sizes.cells, search.block_cells),
        (sizes.weight, search.block_weight),
        (sizes.extent, search.block_extent),
    ):
        good &= ~np.any(holds & (above(values, high) | below(values, low)), axis=1)
    dry = labellings[:, space.assembly.free_faces].sum(axis=1)
    for values, (low, high) in ((holds.sum(axis=1), search.blocks), (dry, search.dry_faces)):
        good &= ~(above(values, high) | below(values, low))
    return good
