"""List all possible blocks: connected sets of free elements within the limits on blocks, docs/method.md (5.2)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_core.deadline import checkpoint
from jld_explore.space import SearchSpace
from jld_explore.space.limits import SizeOf

MOST: Final = 20_000  # number of possible blocks above which they are not listed

_ROWS: Final = 512  # number of sets whose sizes are computed at once

_GROWN: Final = 4  # sets, as a multiple of `MOST`, above which sets of one size are not compared with the limits


@dataclass(frozen=True)
class PossibleBlocks:
    """List of p possible blocks."""

    members: tuple[tuple[int, ...], ...]  # elements of each block, ascending
    inside: tuple[tuple[int, ...], ...]  # faces with both sides in the block, ascending

    def __len__(self) -> int:
        return len(self.members)

    def labelling(self, space: SearchSpace, chosen: Ints) -> Bits:
        """Return the labels (m,) of the segmentation into chosen blocks."""
        labels = np.ones(len(space.fixed), dtype=bool)
        for p in chosen.tolist():
            labels[list(self.inside[p])] = False
        return labels


def possible_blocks(space: SearchSpace) -> PossibleBlocks | None:
    """List the possible blocks of a space; None with slits, blocks on supports, or above `MOST`."""
    assembly = space.assembly
    faces, support = assembly.interfaces, assembly.elements.support
    a, b = faces.a, faces.b
    may_join = space.candidates | ~space.fixed
    to_support = support[a] | support[b]
    if not space.search.segmentation or np.any(may_join & to_support):
        return None
    must_join = ~space.candidates & ~space.fixed
    free = assembly.elements.free
    place = np.full(len(assembly.elements), -1)
    place[free] = np.arange(len(free))
    inner = np.flatnonzero(~to_support)
    ends = np.column_stack([place[a[inner]], place[b[inner]]])
    connected = _connected_sets(space, ends[may_join[inner]])
    if connected is None:
        return None
    members, inside = [], []
    for rows in np.array_split(connected, max(1, len(connected) // _ROWS)):
        checkpoint()
        first, second = rows[:, ends[:, 0]], rows[:, ends[:, 1]]
        wrong = (first & second & ~may_join[inner]).any(axis=1) | ((first ^ second) & must_join[inner]).any(axis=1)
        wrong |= space.limits.too_small(_sizes(rows, space))
        for row, links in zip(rows[~wrong], (first & second)[~wrong], strict=True):
            block = free[row].tolist()
            if not space.limits.misshapen(block):
                members.append(tuple(block))
                inside.append(tuple(inner[links].tolist()))
    return PossibleBlocks(tuple(members), tuple(inside))


def _connected_sets(space: SearchSpace, links: Ints) -> Bools | None:
    """List the connected sets (p, f) of free elements below upper limits, by links (k, 2); None for too many."""
    # A set is grown by one element at a time, so that a set above a limit is not grown further.
    number = len(space.assembly.elements.free)
    around = [0] * number
    for e, other in links.tolist():
        around[e] |= 1 << other
        around[other] |= 1 << e
    level = {1 << e: around[e] for e in range(number)}  # each set as bits, with the elements that it touches
    found = [np.zeros((0, number), dtype=bool)]
    total = 0
    while level:
        rows = _rows_of(list(level), number)
        found.append(rows[np.lexsort(~rows.T[::-1])])
        total += len(level)
        if total > MOST:
            return None
        grown: dict[int, int] = {}
        for block, touched in level.items():
            checkpoint()
            left = touched & ~block
            while left:
                added = left & -left
                left ^= added
                if block | added not in grown:
                    grown[block | added] = touched | around[added.bit_length() - 1]
            if len(grown) > _GROWN * MOST:
                return None
        level = _within_limits(grown, space)
    return np.concatenate(found)


def _within_limits(sets: dict[int, int], space: SearchSpace) -> dict[int, int]:
    """Return the sets, keys as bits over the free elements, that exceed no upper limit on blocks."""
    limits, number = space.limits, len(space.assembly.elements.free)
    kept: dict[int, int] = {}
    items = iter(sets.items())
    while part := list(islice(items, _ROWS)):
        checkpoint()
        large = limits.too_large(_sizes(_rows_of([block for block, _ in part], number), space))
        kept.update(one for one, over in zip(part, np.broadcast_to(large, len(part)), strict=True) if not over)
    return kept


def _rows_of(sets: list[int], number: int) -> Bools:
    """Return sets given as bits as rows (k, number), True = in the set."""
    width = -(-number // 8)
    packed = np.frombuffer(b"".join(one.to_bytes(width, "little") for one in sets), dtype=np.uint8)
    rows = np.unpackbits(packed.reshape(len(sets), width), axis=1, count=number, bitorder="little")
    return rows.astype(bool)


def _sizes(rows: Bools, space: SearchSpace) -> SizeOf:
    """Return a function that gives the sizes (k,) of sets of free elements (k, f)."""
    members = np.zeros((len(space.assembly.elements), len(rows)), dtype=bool)
    members[space.assembly.elements.free] = rows.T
    return space.limits.sized.together(members)


class BlockTables:
    """Tables (c, p) of the possible blocks that contain, touch or lie on the first side of a face."""

    def __init__(self, space: SearchSpace, blocks: PossibleBlocks) -> None:
        free, a, b = space.assembly.elements.free, space.assembly.interfaces.a, space.assembly.interfaces.b
        covers = np.zeros((len(space.assembly.elements), len(blocks)), dtype=bool)
        contains = np.zeros((len(a), len(blocks)), dtype=bool)
        for p, (members, inside) in enumerate(zip(blocks.members, blocks.inside, strict=True)):
            covers[list(members), p] = True
            contains[list(inside), p] = True
        self._covering = covers[free]
        self.faces = np.flatnonzero(space.candidates & contains.any(axis=1))
        # blocks that contain each face, that have the element on its first side, and on whose edge it lies
        self.inside = contains[self.faces]
        self.beside = covers[a[self.faces]]
        self.separated_by = (self.beside | covers[b[self.faces]]) & ~self.inside
        overlap = self._covering.T.astype(np.int64) @ self._covering.astype(np.int64) > 0
        np.fill_diagonal(overlap, False)
        self._overlaps = overlap

    def agreeing(self, faces: Ints, labels: Bits) -> Bools:
        """Return (p,) True for the blocks that labels (k,) on faces (k,) admit."""
        label = dict(zip(faces.tolist(), labels.tolist(), strict=True))
        known = np.isin(self.faces, faces)
        dry = np.array([label.get(face, False) for face in self.faces.tolist()], dtype=bool)
        excluded = self.inside[known & dry].any(axis=0) | self.separated_by[known & ~dry].any(axis=0)
        return np.asarray(~excluded, dtype=bool)

    def propagated(self, allowed: Bools) -> Bools | None:
        """Return (p,) True for the allowed blocks left by propagation; None if an element has none."""
        # An element with a single block left takes that block, which excludes the blocks that overlap it.
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
        """Return the positions in `faces` of faces inside some blocks left and on the edge of others."""
        around = (self.beside & allowed).sum(axis=1)
        holding = (self.inside & allowed).sum(axis=1)
        return np.flatnonzero((holding > 0) & (holding < around))
