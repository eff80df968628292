"""Assembly sequence as a constraint on labellings, with the labels that violate it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from jld_core import Assembly, Bits, Bools, Deadline, DeadlinePassed, Ints
from jld_practice.laying.freedom import Bodies, Freedom, blocks_of_labelling
from jld_practice.laying.order import (
    GROUP,
    MOST_STAGES,
    Laying,
    SequenceRule,
    assembly_order,
    emptied,
    locked_blocks,
    turn_of,
    words_of_fall,
)
from jld_practice.laying.standing import Parts, Standing


@dataclass(frozen=True)
class Built:
    """Result of `built_up`: whether an order of single blocks with standing stages exists."""

    # True where an order was found, False where none exists, None where the search reached its limit or a stage was
    # undecided
    possible: bool | None
    seen: Bools  # (n,) bool mask of the elements of all blocks that were laid or tried, and of the fixed block


def built_up(freedom: Freedom, standing: Standing) -> Built:
    """Search an order of single blocks, each touching a laid one, whose every stage stands."""
    # Depth first, the lowest block first. If single blocks can be removed until none is left, an order is found
    # wherever one exists. A block that touches no laid block cannot stand. The outcome therefore depends on the visited
    # blocks alone.
    blocks = freedom.blocks
    failed: set[bytes] = set()
    turn = turn_of(blocks)
    tried = blocks.fixed.copy()
    looked, settled = 0, True

    def search(laid: Bools) -> bool | None:
        """Return whether the laid blocks can be completed, None at the limit."""
        nonlocal looked, settled
        key = np.packbits(laid).tobytes()
        if laid.all():
            return True
        if key in failed:
            return False
        near = laid[blocks.first] != laid[blocks.second]
        border = np.unique(np.concatenate([blocks.first[near], blocks.second[near]]))
        moves = [((block,), freedom.bodies.up) for block in border[~laid[border]].tolist()]
        for move in sorted(moves, key=lambda move: turn(laid, move[0]), reverse=True):
            if looked >= MOST_STAGES:
                return None
            looked += 1
            tried[move[0][0]] = True
            more = laid.copy()
            more[move[0][0]] = True
            stands = standing.stage(more).stands
            settled &= stands is not None
            if not stands or freedom.way_out(move[0][0], more) is None:
                continue
            extended = search(more)
            if extended is not False:
                return extended
        failed.add(key)
        return False

    possible = search(blocks.fixed.copy())
    return Built(possible if possible or settled else None, tried[blocks.of])


COUNTED: Final = {"translation": 2000, "standing": 60}  # labellings that can be tested within seconds, by rule

_COMPARED: Final = 8  # largest number of refused labellings whose orders are compared for a message


@dataclass(frozen=True)
class Lock:
    """Labels on some faces that allow no order of laying."""

    faces: Ints  # (k,) faces of the conflict
    labels: Bits  # (k,) their labels, True = dry
    elements: Ints  # (e,) elements of the blocks that prevent the assembly
    # False where the search for stages that stand stopped at its limit, or a stage was undecided. An order may then
    # exist although none is known, and the conflict covers all faces.
    proven: bool = True


class SequenceConstraint:
    """Test whether labellings of one assembly can be laid; it remembers results and conflicts.

    Parameters
    ----------
    assembly : Assembly
        The structure.
    wish : {"translation", "standing"}
        Some order by translations must exist; "standing": every stage of it must also stand without props.
    may_join : (m,) bool array
        Faces that may be inner.
    sideways : bool
        Allow a planar wall to be assembled out of its plane.
    group : int
        Largest number of blocks that are moved together where single blocks are locked.
    """

    def __init__(
        self, assembly: Assembly, wish: SequenceRule, may_join: Bools, *, sideways: bool = False, group: int = GROUP
    ) -> None:
        assembly.members.refuse("an assembly sequence")
        self.assembly, self.wish, self.group = assembly, wish, group
        self.bodies = Bodies(assembly, sideways)
        self._parts = Parts(assembly)
        self._locks: dict[bytes, Lock | None] = {}
        self.locks: list[Lock] = []
        faces = assembly.interfaces
        # an inner face to a support makes the elements behind it part of the ground
        self._may_rest = bool(
            np.any((assembly.elements.support[faces.a] | assembly.elements.support[faces.b]) & may_join)
        )

    @property
    def counted(self) -> int:
        """Number of labellings that can be tested one by one within seconds."""
        return COUNTED[self.wish]

    @property
    def refused(self) -> int:
        """Number of labellings found without a sequence."""
        return sum(lock is not None for lock in self._locks.values())

    @property
    def undecided(self) -> int:
        """Number of refused labellings for which an unlimited search might find a sequence."""
        return sum(lock is not None and not lock.proven for lock in self._locks.values())

    def farthest(self) -> Laying | None:
        """Return the order of a refused labelling with the largest share of standing steps, or None."""
        # Up to eight labellings are compared, the first to be refused.
        refused = [key for key, lock in self._locks.items() if lock is not None][:_COMPARED]
        best: tuple[float, Laying] | None = None
        for key in refused:
            packed = np.frombuffer(key, dtype=np.uint8)
            labels = np.unpackbits(packed, count=len(self.assembly.interfaces)).astype(bool)
            laying = assembly_order(self.assembly, labels, group=self.group, bodies=self.bodies, parts=self._parts)
            if laying.first_fall is not None:
                share = laying.first_fall[0] / len(laying.steps)
                if best is None or share > best[0]:
                    best = share, laying
        return None if best is None else best[1]

    def words_of_farthest(self, seconds: float) -> str | None:
        """Describe where that order falls; None if none is found in time, s."""
        try:
            with Deadline(seconds).enforced():
                laying = self.farthest()
        except DeadlinePassed:
            return None
        return None if laying is None or laying.first_fall is None else words_of_fall(laying, *laying.first_fall)

    def lock(self, labels: Bits) -> Lock | None:
        """Return the conflict that refuses labels (m,); None where they can be laid."""
        key = np.packbits(labels).tobytes()
        if key not in self._locks:
            matching = next((lock for lock in self.locks if np.array_equal(labels[lock.faces], lock.labels)), None)
            self._locks[key] = matching or self._found(labels)
        return self._locks[key]

    def possible(self, labellings: Bits) -> Bools:
        """Return which labellings (k, m) can be laid."""
        return np.array([self.lock(labels) is None for labels in labellings], dtype=bool)

    def _found(self, labels: Bits) -> Lock | None:
        """Test labels (m,) and return their conflict, or None."""
        members = locked_blocks(self.assembly, labels, group=self.group, bodies=self.bodies)
        if members:
            lock = self._lock_conflict(labels, np.array(members, dtype=np.int64))
            self.locks.append(lock)
            return lock
        return None if self.wish == "translation" else self._stage_conflict(labels)

    def _stage_conflict(self, labels: Bits) -> Lock | None:
        """Return the conflict of labels (m,) without an order whose every stage stands, or None."""
        # it has all faces if the whole structure does not stand or blocks may be laid in groups
        every, elements = np.arange(len(labels)), self.assembly.elements
        lock = Lock(every, labels, elements.free)
        blocks = blocks_of_labelling(self.assembly, labels)
        freedom, standing = Freedom(blocks, bodies=self.bodies), Standing(blocks, labels, self._parts)
        stands = standing.stage(np.ones(len(blocks), dtype=bool)).stands
        if not stands:
            return replace(lock, proven=stands is False)
        heavy = bool(np.linalg.norm(elements.weight[elements.free], axis=1).min() > 0.0)
        if heavy and not np.any(emptied(freedom, np.ones(len(blocks), dtype=bool), 1) & ~blocks.fixed):
            built = built_up(freedom, standing)
            if built.possible:
                return None
            if built.possible is False:
                return self._visited_conflict(built.seen, labels)
        laying = assembly_order(
            self.assembly, labels, wish="standing", group=self.group, bodies=self.bodies, parts=self._parts
        )
        if laying.possible and laying.stands:
            return None
        return replace(lock, proven=not laying.undecided and laying.stands is not None)

    def _visited_conflict(self, visited: Bools, labels: Bits) -> Lock:
        """Return the conflict of all faces of the elements `visited` (n,) by a search without success."""
        faces, free = self.assembly.interfaces, ~self.assembly.elements.support
        visited = visited & free
        about = np.flatnonzero(visited[faces.a] | visited[faces.b])
        lock = Lock(about, labels[about], np.flatnonzero(visited))
        if len(about) < len(labels):
            self.locks.append(lock)
        return lock

    def _lock_conflict(self, labels: Bits, members: Ints) -> Lock:
        """Return the conflict of blocks, by their elements, that lock one another."""
        # Such blocks do so in every labelling that has each of them in a separate block: further blocks only add
        # obstacles. The conflict thus has inner faces that hold each together, and dry faces around all but one. A
        # single block must stay separate from the supports that lock it, and obstacles joined to a support are held
        # there by inner faces.
        elements, faces, count = self.assembly.elements, self.assembly.interfaces, len(self.assembly.elements)
        # represent all supports by one node
        node = np.where(elements.support, elements.support.argmax(), np.arange(count))
        a, b = node[faces.a], node[faces.b]
        block = connected_components(_graph(a[~labels], b[~labels], count), directed=False)[1]
        among = np.isin(np.arange(count), members)
        start = int(elements.support.argmax())
        ground = ~elements.support & elements.support.any() & (block == block[start])
        inner = self._tree(among, a, b, labels)
        needed = self._in_the_way(labels, among, ground)
        if needed.any():
            # inner faces on the path from an obstacle to a support
            tree = self._tree(ground | elements.support, a, b, labels)
            _, before = breadth_first_order(_graph(a[tree], b[tree], count), start, directed=False)
            between = {(int(a[face]), int(b[face])): face for face in tree.tolist()}
            path: set[int] = set()
            for at in np.flatnonzero(needed).tolist():
                while at != start:
                    at, last = int(before[at]), at
                    path.add(between.get((at, last), between.get((last, at), -1)))
            inner = np.concatenate([inner, np.array(sorted(path), dtype=np.int64)])
        around = [np.flatnonzero((block[a] == name) != (block[b] == name)) for name in np.unique(block[members])]
        if len(around) > 1:
            # The block with most faces around it needs none of them: the faces around the others separate them from it.
            around.pop(int(np.argmax([len(entry) for entry in around])))
        elif not self._may_rest:
            around = []
        needed_faces = np.concatenate([inner, np.unique(np.concatenate([np.empty(0, dtype=np.int64), *around]))])
        return Lock(needed_faces, labels[needed_faces], members)

    def _tree(self, among: Bools, a: Ints, b: Ints, labels: Bits) -> Ints:
        """Return a spanning forest of the inner faces between elements `among` (n,), as faces.

        a, b: (m,) nodes of each face, all supports being one node.
        """
        faces = self.assembly.interfaces
        inside = np.flatnonzero(among[faces.a] & among[faces.b] & ~labels)
        _, first = np.unique(np.sort(np.column_stack([a[inside], b[inside]]), axis=1), axis=0, return_index=True)
        tree = minimum_spanning_tree(_graph(a[inside[first]], b[inside[first]], len(among))).tocoo().data
        return np.asarray(inside[first[np.round(tree).astype(np.int64) - 1]])

    def _in_the_way(self, labels: Bits, among: Bools, ground: Bools) -> Bools:
        """Return few elements (n,) of `ground`, held by supports, that lock the elements `among` (n,)."""
        # dropped one by one while the blocks stay locked: few, but not the fewest
        faces, support = self.assembly.interfaces, self.assembly.elements.support
        blocks = blocks_of_labelling(self.assembly, labels | ground[faces.a] | ground[faces.b])
        first = np.unique(blocks.of, return_index=True)[1]
        freedom = Freedom(replace(blocks, fixed=blocks.fixed | ~among[first]), bodies=self.bodies)
        needed = ground.copy()
        for tried in [ground, *(np.arange(len(ground)) == e for e in np.flatnonzero(ground))]:
            there = np.zeros(len(blocks), dtype=bool)
            there[blocks.of[among | support | (needed & ~tried)]] = True
            if np.array_equal(emptied(freedom, there, self.group), there):
                needed &= ~tried
        return needed


def _graph(a: Ints, b: Ints, count: int) -> coo_array:
    """Return a sparse matrix (count, count) of edges a to b, (k,), with values 1 to k."""
    return coo_array((1.0 + np.arange(len(a)), (a, b)), shape=(count, count))
