"""Generate segmentations in batches: operators choose keys, and one pass converts them.

A **key** is a number for each pair of neighbouring atoms, low where both should be in one part. All rows of a batch
join atoms in ascending order of their own keys. Joining stops at the threshold, and no part exceeds the largest
number of cells. Parts that are still too small are then joined to neighbours. Rows with a part that stays too small
are dropped. A row takes a tenth of the time of a single segmentation, in the batch solver a hundredth. A driver can
therefore compare many children for each one it evaluates.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.batch.parts import Joining
from jld_core.deadline import checkpoint
from jld_explore.drivers.operators.atom_graph import AtomGraph, PartLimits
from jld_explore.space import SearchSpace
from jld_explore.space.labelling import blocks_of

THRESHOLD: Final = 0.5
"""Threshold: a pair with a key above it is separated, a pair with a lower key is joined."""

_ROUNDS: Final = 2  # passes over all pairs that join parts that are too small to others

# Width of the random interval of keys of a child of two parents, for four kinds of pairs. The kinds are those of
# `_LEAST`.
_WIDTH: Final = np.array([0.05, 0.05, 0.2, 0.2])
# Smallest key of a child of two parents, for four kinds of pairs. The kinds are: inside a block of both parents,
# between blocks of both, and where the parents differ, inside and between blocks of the parent that the child follows.
_LEAST: Final = np.array([0.0, 0.95, 0.25, 0.55])

# Smallest keys of pairs that a change keeps: inside a block, and between two blocks
_LEAST_KEPT: Final = np.array([0.2, 0.7])

Names = NDArray[Any]
"""Integer array of part names."""


class Batches:
    """Batch operators on segmentations, for spaces with limits on cells alone.

    A key is a number in [0, 1] for each pair of atoms that may be joined: pairs with keys up to a threshold are joined,
    lowest first, while limits allow. Labellings are rows (k, m), True = dry; keys are rows (k, pairs). Results hold at
    most one row per requested one. Rows are in the search space, but may be neither canonical nor new.

    graph: its atoms.
    """

    def __init__(self, space: SearchSpace, graph: AtomGraph, limits: PartLimits) -> None:
        self.space, self.graph = space, graph
        self.least, self.most = limits.cells
        pairs = np.array(graph.pairs, dtype=np.int64).reshape(-1, 2)
        self._p, self._q = pairs[:, 0], pairs[:, 1]
        self._cells = np.array(graph.cells, dtype=np.int64)
        low, high = np.minimum(graph.face_a, graph.face_b), np.maximum(graph.face_a, graph.face_b)
        place = {(int(low[f]), int(high[f])): int(f) for f in np.flatnonzero(space.candidates)}
        self._face = np.array([place[pair] for pair in graph.pairs], dtype=np.int64)
        self._line = np.array([lines[0] for lines in graph.lines], dtype=np.int64)
        centre = space.assembly.elements.centroid[graph.first]
        self._middle = 0.5 * (centre[self._p] + centre[self._q])
        self._joining = Joining(self._p, self._q, self._cells, self.least, self.most, _ROUNDS)
        self._span = float(np.ptp(centre, axis=0).max())

    def draw(self, count: int, rng: np.random.Generator) -> Bits:
        """Draw at most `count` random segmentations (j, m).

        Each has a random threshold of its own, so that numbers of blocks spread.
        """
        keys = rng.random((count, len(self._p)))
        return self.read(keys, rng.random((count, 1)))

    def cross(self, first: Bits, second: Bits, rng: np.random.Generator) -> Floats:
        """Return keys (k, pairs) of one child of each couple of parents (k, m), for `read`.

        Joints of both parents stay, and so do pairs that both have inside blocks. At other pairs the child follows
        `first` in a patch and `second` outside, or one of them at random for each pair.
        """
        one, two = first[:, self._face], second[:, self._face]
        count = len(one)
        patch = np.empty(one.shape, dtype=bool)
        whole = rng.random(count) < 0.7
        patch[whole] = self._patch(int(np.count_nonzero(whole)), rng)
        scattered = np.flatnonzero(~whole)
        patch[scattered] = rng.random((len(scattered), one.shape[1])) < rng.random((len(scattered), 1))
        # index of the kind of each pair, see _LEAST
        kind = ((one & patch) | (two & ~patch)).view(np.uint8) + 2 * (one ^ two).view(np.uint8)
        keys = rng.random(one.shape)
        keys *= _WIDTH.take(kind)
        keys += _LEAST.take(kind)
        return keys

    def vary(self, parents: Bits, rng: np.random.Generator) -> Floats:
        """Return keys (k, pairs) of one change of each parent (k, m), for `read`.

        The change cuts the two blocks beside a random joint anew, sometimes with a third one. Otherwise it moves one
        atom, or all atoms along the straight line of the joint, across the joint.
        """
        cut, count = parents[:, self._face], len(parents)
        name = blocks_of(self.space.graph, parents)[:, self.graph.first]
        rows = np.arange(count)
        lot = rng.random(cut.shape)
        lot *= cut
        joint = np.argmax(lot, axis=1)
        turn = rng.random(count) < 0.5
        here = np.where(turn, self._q[joint], self._p[joint])
        there = np.where(turn, self._p[joint], self._q[joint])
        old, new = name[rows, here][:, None], name[rows, there][:, None]
        keys = rng.random(cut.shape)
        keys *= 0.1
        keys += _LEAST_KEPT.take(cut.view(np.uint8))
        kind = rng.random(count)
        some = np.flatnonzero(kind < 0.5)
        own = name[some]
        inside = self._region(own, (own == old[some]) | (own == new[some]), rng)
        row, pair = np.nonzero(inside[:, self._p] & inside[:, self._q])
        loose = rng.random(len(row)) - rng.random(len(some))[row] + THRESHOLD
        keys[some[row], pair] = np.clip(loose, 0.0, 1.0)
        some = np.flatnonzero(kind >= 0.5)
        moving = self._moving(name[some], cut[some], old[some], new[some], joint[some], here[some], kind[some] < 0.75)
        row, pair = np.nonzero(moving[:, self._p] | moving[:, self._q])
        p, q = self._p[pair], self._q[pair]
        mp, mq = moving[row, p], moving[row, q]
        row = some[row]
        joined = (mp & (mq | (name[row, q] == new[row, 0]))) | (mq & (name[row, p] == new[row, 0]))
        keys[row, pair] = np.where(joined, 0.01, 0.9)
        return keys

    def _region(self, name: Ints, inside: Bools, rng: np.random.Generator) -> Bools:
        """Add a third block that touches the region to 40 % of the rows, chosen at random.

        name: (k, atoms) block of each atom. inside: (k, atoms) True in two blocks of each row; changed in place and
        returned.
        """
        rows = np.flatnonzero(rng.random(len(name)) < 0.4)
        touching = inside[rows][:, self._p] != inside[rows][:, self._q]
        pair = np.argmax(touching * rng.random(touching.shape), axis=1)
        outer = np.where(inside[rows, self._p[pair]], self._q[pair], self._p[pair])
        third = name[rows] == name[rows, outer][:, None]
        inside[rows] |= third & touching.any(axis=1)[:, None]
        return inside

    def _moving(self, name: Ints, cut: Bits, old: Ints, new: Ints, joint: Ints, here: Ints, single: Bools) -> Bools:
        """Return a mask (k, atoms) of the atoms that a move transfers to the block beyond a joint.

        Where `single`, only atom `here` moves. Elsewhere all atoms of block `old` move that touch block `new` along the
        straight line of the joint. name: (k, atoms) block of each atom. cut: (k, pairs) True = dry. old, new: (k, 1)
        blocks. joint: (k,) pair of atoms. here: (k,) atom of `old` at the joint. single: (k,).
        """
        moving = np.zeros(name.shape, dtype=bool)
        moving[np.arange(len(name)), here] = True
        rows = np.flatnonzero(~single)
        p, q = name[rows][:, self._p], name[rows][:, self._q]
        along = cut[rows] & (self._line == self._line[joint[rows]][:, None])
        line = np.zeros((len(rows), name.shape[1]), dtype=bool)
        for here_is, there_is, end in ((p, q, self._p), (q, p, self._q)):
            row, pair = np.nonzero(along & (here_is == old[rows]) & (there_is == new[rows]))
            line[row, end[pair]] = True
        moving[rows] = line
        return moving

    def _patch(self, count: int, rng: np.random.Generator) -> Bools:
        """Mark (count, pairs) the pairs on one side of a random plane, or in a random box."""
        centre = self._middle[rng.integers(len(self._middle), size=count)]
        planes = np.flatnonzero(rng.random(count) < 0.5)
        found = np.ones((count, len(self._middle)), dtype=bool)
        reach = 0.6 * self._span * rng.random((count, 1))
        reach[planes] = np.inf
        side = np.zeros((len(planes), len(self._middle)))
        for place, own, normal in zip(
            self._middle.T, centre.T, rng.normal(size=(centre.shape[1], len(planes))), strict=True
        ):
            away = place - own[:, None]
            found &= abs(away) <= reach
            side += away[planes] * normal[:, None]
        found[planes] = side > 0.0
        return found

    def read(self, keys: Floats, threshold: float | Floats = THRESHOLD) -> Bits:
        """Convert keys (k, pairs) to labellings (j, m), j ≤ k; keys that break a limit give none.

        The threshold is a number, or (k, 1) for one number per row.
        """
        return self.read_some(keys, threshold)[0]

    def read_some(self, keys: Floats, threshold: float | Floats = THRESHOLD) -> tuple[Bits, Ints]:
        """Convert keys as `read` does; also return (j,) the row of keys of each labelling."""
        name, good = self._assemble(keys, threshold)
        across = name[:, self.graph.face_a] != name[:, self.graph.face_b]
        return np.asarray(np.where(self.space.candidates, across, self.space.fixed)), np.flatnonzero(good)

    def _assemble(self, keys: Floats, threshold: float | Floats) -> tuple[Names, Bools]:
        """Join atoms by keys as `read`; return the part of each atom (j, atoms).

        Also returns (k,) True for the j rows without a part that is too small; the others are left out.
        """
        order = np.argsort(keys, axis=1)
        made = self._joining.parts(order, np.count_nonzero(keys <= threshold, axis=1))
        if made is not None:
            return np.asarray(made[0][made[1]]), made[1]
        wanted = np.take_along_axis(keys <= threshold, order, axis=1).T.copy()
        ends = [end[order].T.copy() for end in (self._p, self._q)]
        forest = _Forest(len(keys), self._cells, self.least, self.most)
        for a, b, joined in zip(*ends, wanted, strict=True):
            rows = np.flatnonzero(joined)
            if not len(rows):
                break
            forest.join(rows, a[rows], b[rows], small_only=False)
        for _ in range(_ROUNDS):
            checkpoint()
            lacking = np.flatnonzero(forest.lacking)
            if not len(lacking):
                break
            for a, b in zip(*ends, strict=True):
                forest.join(lacking, a[lacking], b[lacking], small_only=True)
        good = ~forest.lacking
        return forest.name[good], good


class _Forest:
    """Partitions under construction, one per row, as disjoint sets.

    count: number of rows. cells: (atoms,) cells of each atom. least, most: least and largest number of cells of a part.
    name: (rows, atoms) part of each atom. size: (rows · atoms,) cells of each part, at the index of its name.
    """

    def __init__(self, count: int, cells: Ints, least: int, most: float) -> None:
        self.least, self.most, self.atoms = least, most, len(cells)
        kind = np.int16 if self.atoms < 1 << 15 else np.int32
        self.name: Names = np.broadcast_to(np.arange(self.atoms, dtype=kind), (count, self.atoms)).copy()
        self.size = np.tile(cells, count)
        self._names = self.name.reshape(-1)

    @property
    def lacking(self) -> Bools:
        """(rows,) True where some part has fewer cells than `least`."""
        size = self.size.reshape(self.name.shape)
        return np.asarray(((size > 0) & (size < self.least)).any(axis=1))

    def join(self, rows: Ints, a: Ints, b: Ints, small_only: bool) -> None:
        """Join the parts of atoms a and b (r,) in rows (r,) if the union has at most `most` cells.

        small_only: join only where one of the two parts has fewer cells than `least`. Changes `name` and `size`.
        """
        base = rows * self.atoms
        p: Names = self._names.take(base + a)
        q: Names = self._names.take(base + b)
        to: Ints = base + p
        of: Ints = base + q
        one, two = self.size.take(to), self.size.take(of)
        fits = (p != q) & (one + two <= self.most)
        if small_only:
            fits &= (one < self.least) | (two < self.least)
        chosen = np.flatnonzero(fits)
        if not len(chosen):
            return
        rows = rows.take(chosen)
        some = self.name.take(rows, axis=0)
        np.copyto(some, p.take(chosen)[:, None], where=some == q.take(chosen)[:, None])
        self.name[rows] = some
        self.size[to.take(chosen)] += two.take(chosen)
        self.size[of.take(chosen)] = 0
