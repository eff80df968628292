"""All blocks there can be: connected sets of free elements within the limits on one block.

One binary per such set, and every element in exactly one of those chosen, says at once what a segmentation is:
no slits, every limit on a block kept (docs/method.md (5.2)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Ints
from jld_explore.space import SearchSpace

MOST: Final = 20_000
"""Blocks above which they are not listed."""


@dataclass(frozen=True)
class PossibleBlocks:
    """p possible blocks. members: elements of each, ascending. inside: faces with both sides in it."""

    members: tuple[tuple[int, ...], ...]
    inside: tuple[tuple[int, ...], ...]

    def __len__(self) -> int:
        return len(self.members)

    def labelling(self, space: SearchSpace, chosen: Ints) -> Bits:
        """The labelling (m,) of the segmentation into the chosen blocks (indices)."""
        labels = np.ones(len(space.fixed), dtype=bool)
        for p in chosen.tolist():
            labels[list(self.inside[p])] = False
        return labels


def possible_blocks(space: SearchSpace) -> PossibleBlocks | None:
    """The possible blocks of a space; None where there are too many, or blocks that hold a support.

    Raises nothing; a space without any gives an empty tuple.
    """
    assembly = space.assembly
    faces, support = assembly.interfaces, assembly.elements.support
    a, b = faces.a, faces.b
    may_join = space.candidates | ~space.fixed
    to_support = support[a] | support[b]
    if not space.search.segmentation or np.any(may_join & to_support):
        return None
    must_join = ~space.candidates & ~space.fixed
    around: dict[int, list[tuple[int, int]]] = {int(e): [] for e in assembly.elements.free}
    for face in np.flatnonzero(~to_support).tolist():
        around[int(a[face])].append((face, int(b[face])))
        around[int(b[face])].append((face, int(a[face])))
    limits, sized = space.limits, space.limits.sized
    found: list[frozenset[int]] = []
    level: set[frozenset[int]] = {frozenset([e]) for e in around}
    while level:
        found += sorted(level, key=sorted)
        if len(found) > MOST:
            return None
        grown: set[frozenset[int]] = set()
        for block in level:
            for e in block:
                for face, other in around[e]:
                    if other not in block and may_join[face]:
                        bigger = block | {other}
                        if not limits.too_large(sized.one(bigger)):
                            grown.add(bigger)
            if len(grown) > MOST:
                return None
        level = grown
    members, inside = [], []
    for block in found:
        links = {face for e in block for face, other in around[e] if other in block}
        cut = any(must_join[face] for e in block for face, other in around[e] if other not in block)
        if (
            cut
            or any(not may_join[face] for face in links)
            or limits.too_small(sized.one(block))
            or limits.misshapen(block)
        ):
            continue
        members.append(tuple(sorted(block)))
        inside.append(tuple(sorted(links)))
    return PossibleBlocks(tuple(members), tuple(inside))
