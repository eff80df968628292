"""Compute outlines of blocks: which are congruent, their aspect, and reentrant corners."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from threading import RLock
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import checkpoint
from jld_core.geometry.congruence import Kinds
from jld_core.geometry.outlines import Outline, Outlines, reach_of

# Step to which coordinates are rounded, relative to the reach of a comparison: blocks that agree there are copies
_COPY: Final = 1e-3

_SEEDS: Final = 400  # largest number of blocks that are numbered before those of any layout

# Offset before coordinates are rounded; it avoids multiples of one half, where rounding is ambiguous
_SHIFT: Final = 0.37


class BlockShapes:
    """Outlines of the blocks of one assembly, computed on request and cached; thread-safe."""

    def __init__(self, assembly: Assembly, *, rotate: bool = False, flip: bool = False) -> None:
        self.assembly = assembly
        self._kinds = Kinds(reach_of(assembly), rotate=rotate, flip=flip)
        rng = np.random.default_rng(20240711)
        self._sign = rng.integers(1, 2**63, size=len(assembly.elements), dtype=np.uint64)
        self._sign[assembly.elements.support] = 0
        self._place: dict[int, int] = {}
        self._known: list[Outline] = []
        self._number: list[int] = []
        self._outline: dict[bytes, Outline] = {}
        self._outlines = Outlines(assembly)
        self._numbered: dict[int, int] = {}
        self._seeded = False
        self._step = _COPY * self._kinds.reach
        # Threads of a proof request blocks at the same time.
        self._lock = RLock()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = RLock()

    def look(self, blocks: Ints) -> tuple[Bools, Ints]:
        """Compute missing outlines of blocks (k, n): mask of columns with a block, and positions, else −1."""
        with self._lock:
            return self._look(blocks)

    def _look(self, blocks: Ints) -> tuple[Bools, Ints]:
        """Find the outlines as `look` does; the caller holds the lock."""
        rows, count = blocks.shape
        names = (blocks + count * np.arange(rows)[:, None]).ravel()
        key = np.zeros(rows * count, dtype=np.uint64)
        np.add.at(key, names, np.tile(self._sign, rows))
        holds = key != 0
        unique, first, inverse = np.unique(key[holds], return_index=True, return_inverse=True)
        where = np.flatnonzero(holds)[first]
        places = np.empty(len(unique), dtype=np.int64)
        free = ~self.assembly.elements.support
        for k, (value, at) in enumerate(zip(unique.tolist(), where.tolist(), strict=True)):
            if value not in self._place:
                checkpoint()
                row, name = divmod(at, count)
                self._known.append(self._of(np.flatnonzero((blocks[row] == name) & free)))
                self._place[value] = len(self._known) - 1
            places[k] = self._place[value]
        found = np.full(rows * count, -1, dtype=np.int64)
        found[holds] = places[inverse.reshape(-1)]
        return holds.reshape(rows, count), found.reshape(rows, count)

    def one(self, members: Ints) -> Outline:
        """Return the outline of one block given by its free elements in ascending order."""
        return self._known[self._placed(members)]

    def _placed(self, members: Ints) -> int:
        """Return the position of the outline of one block, computed if it is not yet known."""
        key = int(self._sign[members].sum(dtype=np.uint64))
        with self._lock:
            if key not in self._place:
                self._known.append(self._of(members))
                self._place[key] = len(self._known) - 1
            return self._place[key]

    def kinds(self, blocks: Sequence[Sequence[int]]) -> Ints:
        """Return the shape number (b,) of blocks, ascending free elements each; equal if congruent."""
        places = []
        for members in blocks:
            checkpoint()
            places.append(self._placed(np.array(members, dtype=np.int64)))
        with self._lock:
            return np.asarray(self._numbers()[places])

    def different(self, blocks: Ints, sink: int = -1) -> Ints:
        """Return (k,) number of different block shapes of each row (k, n)."""
        # The block that contains the element `sink` is not counted if `sink` is at least 0.
        with self._lock:
            holds, places = self._look(blocks)
            number = self._numbers()
        if sink >= 0:
            holds[np.arange(len(blocks)), blocks[:, sink]] = False
        kind = np.where(holds, number[places], -1)
        kind.sort(axis=1)
        new = np.diff(kind, axis=1, prepend=-1) != 0
        return np.asarray((new & (kind >= 0)).sum(axis=1), dtype=np.int64)

    def total(self, blocks: Ints, name: str, sink: int = -1, *, once: bool = False) -> Ints:
        """Return (k,) sums of a whole-number attribute of outlines over the blocks (k, n)."""
        with self._lock:
            holds, places = self._look(blocks)
            number = self._numbers()
            value = np.array([getattr(shape, name) for shape in self._known], dtype=np.int64)
        if sink >= 0:
            holds[np.arange(len(blocks)), blocks[:, sink]] = False
        if not once:
            return np.asarray(np.where(holds, value[places], 0).sum(axis=1), dtype=np.int64)
        of_kind = np.zeros(int(number.max(initial=-1)) + 1, dtype=np.int64)
        of_kind[number[::-1]] = value[::-1]
        kind = np.where(holds, number[places], -1)
        kind.sort(axis=1)
        new = (np.diff(kind, axis=1, prepend=-1) != 0) & (kind >= 0)
        return np.asarray(np.where(new, of_kind[kind], 0).sum(axis=1), dtype=np.int64)

    def values(self, name: str) -> Floats:
        """Return (b,) values of one attribute of all known outlines, ordered by position."""
        with self._lock:
            known = self._known[:]
        return np.array([float(getattr(shape, name)) for shape in known])

    def _numbers(self) -> Ints:
        """Return (b,) shape number of each known block; congruent blocks have the same number."""
        if not self._seeded:
            self._seed()
            self._seeded = True
        for outline in self._known[len(self._number) :]:
            # Blocks of equal cells in equal positions share one outline object.
            if id(outline) not in self._numbered:
                self._numbered[id(outline)] = self._kinds.number(outline)
            self._number.append(self._numbered[id(outline)])
        return np.array(self._kinds.roots(self._number), dtype=np.int64)

    def _seed(self) -> None:
        """Give numbers to the smallest blocks first, so that connected shapes depend on no layout seen."""
        # The smallest blocks are single elements and, where some are alike without being copies, connected ones of
        # growing number.
        free = [k for k in self.assembly.elements.free.tolist() if k != self.assembly.sink]
        if len(free) > _SEEDS:
            return
        neighbours: dict[int, set[int]] = {k: set() for k in free}
        faces = self.assembly.interfaces
        for a, b in zip(faces.a.tolist(), faces.b.tolist(), strict=True):
            if a in neighbours and b in neighbours:
                neighbours[a].add(b)
                neighbours[b].add(a)
        level, count = {(k,) for k in free}, 0
        while level and count + len(level) <= _SEEDS:
            count += len(level)
            for members in sorted(level):
                checkpoint()
                self._kinds.number(self._of(np.array(members, dtype=np.int64)))
            if self._kinds.exact:
                return
            level = {
                tuple(sorted({*members, other}))
                for members in level
                for k in members
                for other in neighbours[k] - set(members)
            }

    def _of(self, members: Ints) -> Outline:
        """Return the outline of a block, cached for equal elements in equal positions."""
        centroid = self.assembly.elements.centroid[members]
        places = np.floor((centroid - centroid[0]) / self._step + _SHIFT).astype(np.int64)
        key = self._like[members].tobytes() + places.tobytes()
        if key not in self._outline:
            self._outline[key] = self._outlines.of(members)
        return self._outline[key]

    @cached_property
    def _like(self) -> Ints:
        """(n,) number of each element, equal where corners and faces agree about the centroid."""
        elements = self.assembly.elements
        names: dict[object, int] = {}
        found = []
        for k, shape in enumerate(elements.shape):
            corners = np.floor((shape - elements.centroid[k]) / self._step + _SHIFT).astype(np.int64)
            name = (corners.shape, corners.tobytes(), elements.faces[k] if elements.faces else ())
            found.append(names.setdefault(name, len(names)))
        return np.array(found, dtype=np.int64)
