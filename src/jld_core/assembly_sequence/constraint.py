"""Laying as a constraint: whether a labelling can be laid and, where it cannot, which labels are to blame.

Blocks that lock one another do so in every labelling that has each of them as a part of a block of its own: more
blocks beside them are more in the way, and a group that could leave would leave with those of them that are in it. So
only these labels are to blame: inner faces that hold each of them together, and dry faces around all of them but one,
by which no two are ever one block. Where there is a single one, held between supports, it must not grow together with
those. What is joined to a support and in the way is held there by inner faces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from jld_core.arrays import Bits, Bools, Ints
from jld_core.assembly import Assembly
from jld_core.assembly_sequence.blocks import blocks_of_labelling
from jld_core.assembly_sequence.freedom import Bodies, Freedom
from jld_core.assembly_sequence.order import GROUP, SequenceRule, assembly_order, built_up, emptied, locked_blocks
from jld_core.assembly_sequence.standing import Parts, Standing

COUNTED: Final = {"translation": 2000, "standing": 60}
"""Labellings of which it is said within seconds whether they can be laid."""


@dataclass(frozen=True)
class Lock:
    """No labelling with `labels` (k,) on `faces` (k,) can be laid. elements: (e,) of the blocks that are to blame."""

    faces: Ints
    labels: Bits
    elements: Ints


class SequenceConstraint:
    """Whether labellings of one assembly can be laid. What was found is remembered, and locks settle other labellings.

    wish: "translation": there is an order by translations; "standing": one whose every stage stands without props.
    sideways: a planar wall may be laid out of its plane. may_join: (m,) faces that may be inner.
    """

    def __init__(
        self, assembly: Assembly, wish: SequenceRule, may_join: Bools, *, sideways: bool = False, group: int = GROUP
    ) -> None:
        self.assembly, self.wish, self.group = assembly, wish, group
        self._bodies = Bodies(assembly, sideways)
        self._parts = Parts(assembly)
        self._known: dict[bytes, Lock | None] = {}
        self.locks: list[Lock] = []
        faces = assembly.interfaces
        # an inner face to a support makes what it holds a part of the ground
        self._may_rest = bool(
            np.any((assembly.elements.support[faces.a] | assembly.elements.support[faces.b]) & may_join)
        )

    @property
    def counted(self) -> int:
        """Labellings of which it is said within seconds whether they can be laid."""
        return COUNTED[self.wish]

    @property
    def refused(self) -> int:
        """How many labellings were found that cannot be laid."""
        return sum(lock is not None for lock in self._known.values())

    def lock(self, labels: Bits) -> Lock | None:
        """Why a labelling (m,) cannot be laid; None where it can."""
        key = np.packbits(labels).tobytes()
        if key not in self._known:
            known = next((one for one in self.locks if np.array_equal(labels[one.faces], one.labels)), None)
            self._known[key] = known or self._found(labels)
        return self._known[key]

    def possible(self, labellings: Bits) -> Bools:
        """(k,) True where labellings (k, m) can be laid."""
        return np.array([self.lock(labels) is None for labels in labellings], dtype=bool)

    def _found(self, labels: Bits) -> Lock | None:
        members = locked_blocks(self.assembly, labels, group=self.group, bodies=self._bodies)
        if members:
            lock = self._blamed(labels, np.array(members, dtype=np.int64))
            self.locks.append(lock)
            return lock
        return None if self.wish == "translation" else self._falls(labels)

    def _falls(self, labels: Bits) -> Lock | None:
        """Why a labelling (m,) that can be laid by translations has no order whose every stage stands; None if one."""
        every, elements = np.arange(len(labels)), self.assembly.elements
        whole = Lock(every, labels, elements.free)
        blocks = blocks_of_labelling(self.assembly, labels)
        freedom, standing = Freedom(blocks, bodies=self._bodies), Standing(blocks, labels, self._parts)
        if not standing.stage(np.ones(len(blocks), dtype=bool)).stands:
            return whole
        heavy = bool(np.linalg.norm(elements.weight[elements.free], axis=1).min() > 0.0)
        if heavy and not np.any(emptied(freedom, np.ones(len(blocks), dtype=bool), 1) & ~blocks.fixed):
            built = built_up(freedom, standing)
            if built.possible:
                return None
            if built.possible is False:
                return self._blamed_for(built.seen, labels)
        laying = assembly_order(
            self.assembly, labels, wish="standing", group=self.group, bodies=self._bodies, parts=self._parts
        )
        if laying.possible and laying.stands:
            return None
        return whole

    def _blamed_for(self, seen: Bools, labels: Bits) -> Lock:
        """The labels of all faces of elements (n,) that were seen in a search that found no order."""
        faces, free = self.assembly.interfaces, ~self.assembly.elements.support
        seen = seen & free
        about = np.flatnonzero(seen[faces.a] | seen[faces.b])
        lock = Lock(about, labels[about], np.flatnonzero(seen))
        if len(about) < len(labels):
            self.locks.append(lock)
        return lock

    def _blamed(self, labels: Bits, members: Ints) -> Lock:
        """The labels that blocks lock one another by."""
        elements, faces, count = self.assembly.elements, self.assembly.interfaces, len(self.assembly.elements)
        # all supports are one node
        place = np.where(elements.support, elements.support.argmax(), np.arange(count))
        a, b = place[faces.a], place[faces.b]
        block = connected_components(_graph(a[~labels], b[~labels], count), directed=False)[1]
        among = np.isin(np.arange(count), members)
        start = int(elements.support.argmax())
        ground = ~elements.support & elements.support.any() & (block == block[start])
        held = self._tree(among, a, b, labels)
        needed = self._in_the_way(labels, among, ground)
        if needed.any():
            # inner faces on the way from what is in the way to a support
            tree = self._tree(ground | elements.support, a, b, labels)
            _, before = breadth_first_order(_graph(a[tree], b[tree], count), start, directed=False)
            between = {(int(a[face]), int(b[face])): face for face in tree.tolist()}
            path: set[int] = set()
            for at in np.flatnonzero(needed).tolist():
                while at != start:
                    at, last = int(before[at]), at
                    path.add(between.get((at, last), between.get((last, at), -1)))
            held = np.concatenate([held, np.array(sorted(path), dtype=np.int64)])
        around = [np.flatnonzero((block[a] == name) != (block[b] == name)) for name in np.unique(block[members])]
        if len(around) > 1:
            # the one with most around it may grow: it is told from the others by what is around these
            around.pop(int(np.argmax([len(one) for one in around])))
        elif not self._may_rest:
            around = []
        found = np.concatenate([held, np.unique(np.concatenate([np.empty(0, dtype=np.int64), *around]))])
        return Lock(found, labels[found], members)

    def _tree(self, among: Bools, a: Ints, b: Ints, labels: Bits) -> Ints:
        """Inner faces that join some elements as far as they are joined among themselves, as few as do."""
        faces = self.assembly.interfaces
        inside = np.flatnonzero(among[faces.a] & among[faces.b] & ~labels)
        _, first = np.unique(np.sort(np.column_stack([a[inside], b[inside]]), axis=1), axis=0, return_index=True)
        tree = minimum_spanning_tree(_graph(a[inside[first]], b[inside[first]], len(among))).tocoo().data
        return np.asarray(inside[first[np.round(tree).astype(np.int64) - 1]])

    def _in_the_way(self, labels: Bits, among: Bools, ground: Bools) -> Bools:
        """(n,) free elements joined to the ground without which blocks would not lock one another; as few as found."""
        faces, support = self.assembly.interfaces, self.assembly.elements.support
        blocks = blocks_of_labelling(self.assembly, labels | ground[faces.a] | ground[faces.b])
        first = np.unique(blocks.of, return_index=True)[1]
        freedom = Freedom(replace(blocks, fixed=blocks.fixed | ~among[first]), bodies=self._bodies)
        needed = ground.copy()
        for tried in [ground, *(np.arange(len(ground)) == e for e in np.flatnonzero(ground))]:
            there = np.zeros(len(blocks), dtype=bool)
            there[blocks.of[among | support | (needed & ~tried)]] = True
            if np.array_equal(emptied(freedom, there, self.group), there):
                needed &= ~tried
        return needed


def _graph(a: Ints, b: Ints, count: int) -> coo_array:
    """Arrows (k,) from a to b among so many, each with its number, from 1, as its weight."""
    return coo_array((1.0 + np.arange(len(a)), (a, b)), shape=(count, count))
