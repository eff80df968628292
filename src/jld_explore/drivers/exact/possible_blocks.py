"""List all possible blocks: connected sets of free elements within the limits on blocks.

A formula has one binary variable per possible block, and every element in exactly one chosen block. It thus describes
all segmentations without slits and within the limits on blocks (docs/method.md (5.2)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_core.deadline import checkpoint
from jld_explore.space import SearchSpace

MOST: Final = 20_000
"""Number of possible blocks above which they are not listed."""


@dataclass(frozen=True)
class PossibleBlocks:
    """List of p possible blocks.

    Attributes
    ----------
    members : tuple of p tuples of int
        Elements of each block, ascending.
    inside : tuple of p tuples of int
        Faces with both sides in the block, ascending.
    """

    members: tuple[tuple[int, ...], ...]
    inside: tuple[tuple[int, ...], ...]

    def __len__(self) -> int:
        return len(self.members)

    def labelling(self, space: SearchSpace, chosen: Ints) -> Bits:
        """Return the labels (m,) of the segmentation into chosen blocks, True = dry.

        Parameters
        ----------
        space : SearchSpace
            The search space.
        chosen : int array
            Indices of the blocks.
        """
        labels = np.ones(len(space.fixed), dtype=bool)
        for p in chosen.tolist():
            labels[list(self.inside[p])] = False
        return labels


def possible_blocks(space: SearchSpace) -> PossibleBlocks | None:
    """List the possible blocks of a space.

    Parameters
    ----------
    space : SearchSpace
        The search space.

    Returns
    -------
    PossibleBlocks or None
        The blocks, possibly none. None if they are too many (`MOST`), if slits are allowed, or if a block may contain
        a support.

    Raises
    ------
    DeadlinePassed
        If an enforced deadline passes first.
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
        refused: set[frozenset[int]] = set()
        for block in level:
            checkpoint()
            for e in block:
                for face, other in around[e]:
                    if other not in block and may_join[face]:
                        bigger = block | {other}
                        if bigger in grown or bigger in refused:
                            continue
                        (refused if limits.too_large(sized.one(bigger)) else grown).add(bigger)
            if len(grown) > MOST:
                return None
        level = grown
    members, inside = [], []
    for block in found:
        checkpoint()
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


class BlockTables:
    """Tables of the possible blocks that contain, touch or lie on the first side of a face.

    Each row is one of the c faces that can separate or join blocks; columns are the p blocks.

    Parameters
    ----------
    space : SearchSpace
        The search space.
    blocks : PossibleBlocks
        Its p possible blocks.

    Attributes
    ----------
    faces : (c,) int array
        Candidate faces that some block contains.
    inside : (c, p) bool array
        Blocks that contain each of these faces.
    beside : (c, p) bool array
        Blocks with the element on the first side of each face.
    separated_by : (c, p) bool array
        Blocks on whose edge each face lies.
    """

    def __init__(self, space: SearchSpace, blocks: PossibleBlocks) -> None:
        free, a, b = space.assembly.elements.free, space.assembly.interfaces.a, space.assembly.interfaces.b
        covers = np.zeros((len(space.assembly.elements), len(blocks)), dtype=bool)
        contains = np.zeros((len(a), len(blocks)), dtype=bool)
        for p, (members, inside) in enumerate(zip(blocks.members, blocks.inside, strict=True)):
            covers[list(members), p] = True
            contains[list(inside), p] = True
        self._covering = covers[free]
        self.faces = np.flatnonzero(space.candidates & contains.any(axis=1))
        self.inside = contains[self.faces]
        self.beside = covers[a[self.faces]]
        self.separated_by = (self.beside | covers[b[self.faces]]) & ~self.inside
        overlap = self._covering.T.astype(np.int64) @ self._covering.astype(np.int64) > 0
        np.fill_diagonal(overlap, False)
        self._overlaps = overlap

    def agreeing(self, faces: Ints, labels: Bits) -> Bools:
        """Return (p,) True for the blocks that labels (k,), True = dry, on faces (k,) admit."""
        label = dict(zip(faces.tolist(), labels.tolist(), strict=True))
        known = np.isin(self.faces, faces)
        dry = np.array([label.get(face, False) for face in self.faces.tolist()], dtype=bool)
        excluded = self.inside[known & dry].any(axis=0) | self.separated_by[known & ~dry].any(axis=0)
        return np.asarray(~excluded, dtype=bool)

    def propagated(self, allowed: Bools) -> Bools | None:
        """Return (p,) True for the blocks left by propagation; None if an element has none.

        An element with a single block left takes that block, which excludes the blocks that overlap it.

        allowed: (p,) True for the blocks left before.
        """
        while True:
            left = self._covering & allowed
            number = left.sum(axis=1)
            if not number.all():
                return None
            taken = left[number == 1].any(axis=0)
            kept = allowed & ~self._overlaps[taken].any(axis=0)
            if (kept == allowed).all():
                return allowed
            allowed = kept

    def undecided(self, allowed: Bools) -> Ints:
        """Return the positions in `faces` of faces whose label the blocks left do not decide.

        Such a face is inside some blocks left and on the edge of others. allowed: (p,) True for the blocks left.
        """
        around = (self.beside & allowed).sum(axis=1)
        holding = (self.inside & allowed).sum(axis=1)
        return np.flatnonzero((holding > 0) & (holding < around))
