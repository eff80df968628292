"""The shapes of blocks: which are alike, how slender they are, where they turn inwards. Each block is looked at once.

Two blocks have one shape where a translation lays one onto the other; with moulds that may be turned, a rotation as
well; with moulds that may be turned over, a mirror. What is compared is the boundary of the union of a block's
elements, corners and middles of edges (planar) or of faces (spatial), within the tolerance of the geometry.
"""

from __future__ import annotations

from functools import cached_property
from threading import RLock
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import checkpoint
from jld_core.geometry import Kinds, Outline, Outlines, reach_of

_SHIFT: Final = 0.37
"""Where places are rounded: off the halves, which rounding would throw to either side."""


class BlockShapes:
    """The shapes of all blocks that are asked for, of one assembly. rotate, flip: what moulds may be."""

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
        self._step = reach_of(assembly)
        # threads of a proof ask for the blocks of labellings at the same time
        self._lock = RLock()

    def __getstate__(self) -> dict[str, Any]:
        """Return what is sent to another process: all but the lock."""
        return {name: value for name, value in self.__dict__.items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = RLock()

    def look(self, blocks: Ints) -> tuple[Bools, Ints]:
        """See `_look`; one thread at a time."""
        with self._lock:
            return self._look(blocks)

    def _look(self, blocks: Ints) -> tuple[Bools, Ints]:
        """Where blocks with free elements are named, (k, n) as by `blocks_of`, and their places among the known."""
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
        """The shape of one block by its free elements, ascending."""
        key = int(self._sign[members].sum(dtype=np.uint64))
        with self._lock:
            if key not in self._place:
                self._known.append(self._of(members))
                self._place[key] = len(self._known) - 1
            return self._known[self._place[key]]

    def different(self, blocks: Ints, sink: int = -1) -> Ints:
        """(k,) number of different shapes of blocks in each row (k, n), without the block of an element `sink` ≥ 0."""
        with self._lock:
            holds, places = self._look(blocks)
            number = self._numbers()
        if sink >= 0:
            holds[np.arange(len(blocks)), blocks[:, sink]] = False
        kind = np.where(holds, number[places], -1)
        kind.sort(axis=1)
        new = np.diff(kind, axis=1, prepend=-1) != 0
        return np.asarray((new & (kind >= 0)).sum(axis=1), dtype=np.int64)

    def values(self, name: str) -> Floats:
        """(b,) an attribute of every block that is known, in the order of their positions."""
        with self._lock:
            known = self._known[:]
        return np.array([float(getattr(shape, name)) for shape in known])

    def _numbers(self) -> Ints:
        """(b,) number of the shape of each known block."""
        for outline in self._known[len(self._number) :]:
            # equal cells at equal places have the same object
            if id(outline) not in self._numbered:
                self._numbered[id(outline)] = self._kinds.number(outline)
            self._number.append(self._numbered[id(outline)])
        return np.array(self._number, dtype=np.int64)

    def _of(self, members: Ints) -> Outline:
        """The outline of a block; one for all blocks of equal elements that lie alike, as on a grid nearly all do."""
        centroid = self.assembly.elements.centroid[members]
        places = np.floor((centroid - centroid[0]) / self._step + _SHIFT).astype(np.int64)
        key = self._like[members].tobytes() + places.tobytes()
        if key not in self._outline:
            self._outline[key] = self._outlines.of(members)
        return self._outline[key]

    @cached_property
    def _like(self) -> Ints:
        """(n,) a number for each element, the same only where corners and faces are the same about the centroid."""
        elements = self.assembly.elements
        names: dict[object, int] = {}
        found = []
        for k, shape in enumerate(elements.shape):
            corners = np.floor((shape - elements.centroid[k]) / self._step + _SHIFT).astype(np.int64)
            name = (corners.shape, corners.tobytes(), elements.faces[k] if elements.faces else ())
            found.append(names.setdefault(name, len(names)))
        return np.array(found, dtype=np.int64)
