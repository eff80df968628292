"""Branch and bound over the choice of blocks, for spaces whose blocks are small (docs/method.md (6.5)).

A node decides the labels of some faces, which leaves some of the possible blocks. The relaxation by blocks bounds λ
over all segmentations made of those, shares them out, and gives a mechanism. That one has to tear apart the blocks that
hold the faces it opens: what it dissipates there, times the share of those blocks, is what the bound is expected to
lose when the face is dry. The few faces of most are tried, both labels of each, and the one is decided that lowers both
bounds most; labels under which nothing is left are ruled out all together. From a node the search goes on to the better
child while there is one; then to the node of highest bound.

The tree proves nothing by itself being searched to its end: every node that falls is a conflict, and it is the formula
of all conflicts that says whether a labelling is left.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_core.limit import Asked, Choice
from jld_explore.drivers.exact.block_bound_pool import BlockBoundPool
from jld_explore.drivers.exact.conflict_minimization import Conflict, Evidence
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.space import SearchSpace

_TRIED: Final = (2, 4)
"""Faces tried at a node, one program after another, and where the batch solver solves as many as a register has lanes.
With
1, 2, 4 and 8 the wall of 10 × 12 cells in blocks of two takes 50, 16, 13 and 10 nodes, 100, 69, 110, 163 programs."""

_SMALL: Final = 1e-5
"""Least effect taken into account, scaled λ, so that a label without any does not hide the effect of the other."""

Possible = Callable[[Ints, Bits], bool]
"""Whether any labelling is left with labels (k,) on faces (k,)."""


@dataclass(frozen=True)
class Node:
    """faces, labels: (k,) decided, True dry. allowed: (p,) blocks left. choice: what the relaxation says of them."""

    faces: Ints
    labels: Bits
    allowed: Bools
    choice: Choice


@dataclass(frozen=True)
class Tried:
    """What becomes of a node when one more face is decided, inner and dry: None where no labelling is left worth
    finding."""

    inner: Node | None
    dry: Node | None

    @property
    def left(self) -> list[Node]:
        """Children there are."""
        return [one for one in (self.inner, self.dry) if one is not None]


Looked = tuple[list[Tried], list[Conflict]]
"""What becomes of a node with either label of several faces, and conflicts that say why."""

Waiting = tuple[tuple[int, bool], Node]
"""A child by the face, among the candidates, and the label that it decides."""


@dataclass(frozen=True)
class Question:
    """What is asked of a node: allowed: (p,) blocks left there; threshold: scaled λ that they are to reach; possible,
    late: as of `BlockTree.step`."""

    node: Node
    allowed: Bools
    threshold: float
    possible: Possible
    late: Callable[[], bool]


@dataclass(frozen=True)
class Step:
    """The node that was taken; conflicts found; a labelling (m,) with nothing undecided, to be looked at."""

    node: Node
    conflicts: tuple[Conflict, ...] = ()
    labelling: Bits | None = None


class BlockTree:
    """Partial choices of blocks, the one of highest bound first.

    space: of planar segmentations. blocks: its possible ones. threshold: scaled λ to be reached. most: scaled λ that
    no labelling exceeds.
    """

    def __init__(
        self,
        relaxation: BlockBoundPool,
        space: SearchSpace,
        blocks: PossibleBlocks,
        threshold: float,
        most: float,
    ) -> None:
        self._relaxation, self._space, self._blocks = relaxation, space, blocks
        self._lay_out(space, blocks)
        every = np.ones(len(blocks), dtype=bool)
        nothing = np.empty(0, dtype=np.int64)
        self.root = relaxation.choose(every, threshold, most)
        self._open: list[tuple[float, int, Node]] = []
        self._looked: dict[int, Looked] = {}
        self._count = 0
        self._next: Node | None = Node(nothing, nothing.astype(bool), every, self.root)

    def _lay_out(self, space: SearchSpace, blocks: PossibleBlocks) -> None:
        """Which blocks cover an element (n, p), hold a face (c, p), touch an end of it without holding it (c, p)."""
        free, a, b = space.assembly.elements.free, space.assembly.interfaces.a, space.assembly.interfaces.b
        covers = np.zeros((len(space.assembly.elements), len(blocks)), dtype=bool)
        held = np.zeros((len(a), len(blocks)), dtype=bool)
        for p, (members, inside) in enumerate(zip(blocks.members, blocks.inside, strict=True)):
            covers[list(members), p] = True
            held[list(inside), p] = True
        self._covers = covers[free]
        self._faces = np.flatnonzero(space.candidates & held.any(axis=1))
        self._held = held[self._faces]
        self._at = covers[a[self._faces]]
        self._parted = (self._at | covers[b[self._faces]]) & ~self._held
        overlap = self._covers.T.astype(np.int64) @ self._covers.astype(np.int64) > 0
        np.fill_diagonal(overlap, False)
        self._overlaps = overlap

    @property
    def bound(self) -> float:
        """Scaled λ that no labelling exceeds that is still open; −inf where none is."""
        known = -self._open[0][0] if self._open else -np.inf
        return known if self._next is None else max(known, self._next.choice.bound)

    @property
    def open_conflicts(self) -> list[Conflict]:
        """A conflict for each open node: its labels, and the bound of its relaxation."""
        nodes = [node for _, _, node in self._open] + ([] if self._next is None else [self._next])
        return [Conflict(node.faces, node.labels, node.choice.bound, Evidence.BLOCKS) for node in nodes]

    @property
    def finished(self) -> bool:
        """No node is open."""
        return self._next is None and not self._open

    def step(self, threshold: float, possible: Possible, late: Callable[[], bool]) -> Step:
        """Take an open node and decide one more face.

        threshold: scaled, not lower than before. late: asked between programs; True leaves the node open.
        """
        node = self._next or heapq.heappop(self._open)[2]
        self._next = None
        fallen = Conflict(node.faces, node.labels, threshold, Evidence.BLOCKS)
        if node.choice.bound <= threshold:
            return Step(node, (fallen,))
        allowed = self._settled(node.allowed & ~node.choice.useless)
        if allowed is None:
            return Step(node, (fallen,))
        undecided = self._undecided(allowed)
        if not undecided.size:
            return Step(node, (), self._blocks.labelling(self._space, np.flatnonzero(allowed)))
        asked = Question(node, allowed, threshold, possible, late)
        looked = self._look(asked)
        if looked is None:
            self._next = node
            return Step(node)
        tried, conflicts = looked
        if all(len(one.left) == 2 for one in tried):
            # the first one of several
            best = max(tried, key=lambda one: self._gain(node, one))
            # the better child may be as good as it looks, and then the other is seen with a higher threshold
            self._next, other = sorted(best.left, key=lambda child: -child.choice.bound)
            self._push(other)
        else:
            self._next = self._narrowed(asked, [one.left for one in tried if len(one.left) < 2], conflicts)
        return Step(node, tuple(conflicts))

    def rounded(self, node: Node) -> tuple[Ints, Bits]:
        """Labels (k,) of faces (k,) that the larger shares of a node's blocks suggest, with those it decides."""
        chosen = np.flatnonzero(node.allowed & (node.choice.share > 0.5))
        held = self._held[:, chosen].any(axis=1)
        split_cube = self._parted[:, chosen].any(axis=1) & ~held
        known = np.isin(self._faces, node.faces)
        faces = np.concatenate([node.faces, self._faces[held & ~known], self._faces[split_cube & ~known]])
        counts = int((held & ~known).sum()), int((split_cube & ~known).sum())
        return faces, np.concatenate([node.labels, np.zeros(counts[0], dtype=bool), np.ones(counts[1], dtype=bool)])

    # --- deciding ---------------------------------------------------------------------------------------

    def _push(self, node: Node) -> None:
        self._count += 1
        heapq.heappush(self._open, (-node.choice.bound, -self._count, node))

    def _settled(self, allowed: Bools) -> Bools | None:
        """The blocks left once every element with a single one has it; None where an element has none."""
        while True:
            left = self._covers & allowed
            number = left.sum(axis=1)
            if not number.all():
                return None
            taken = left[number == 1].any(axis=0)
            kept = allowed & ~self._overlaps[taken].any(axis=0)
            if (kept == allowed).all():
                return allowed
            allowed = kept

    def _undecided(self, allowed: Bools) -> Ints:
        """Faces, by place among the candidates, that some blocks left hold and some part."""
        around = (self._at & allowed).sum(axis=1)
        holding = (self._held & allowed).sum(axis=1)
        return np.flatnonzero((holding > 0) & (holding < around))

    def _telling(self, node: Node, undecided: Ints) -> list[int]:
        """The faces, by place among the candidates, that are worth trying, most telling first."""
        share = node.choice.share
        torn = self._held[undecided] @ (share * node.choice.inside)
        inner = np.clip(self._held[undecided] @ share, 0.0, 1.0)
        score = np.maximum(torn, 0.0) + _SMALL * np.minimum(inner, 1.0 - inner)
        most = _TRIED[self._relaxation.many]
        return [int(face) for face in undecided[np.argsort(-score, kind="stable")[:most]]]

    def _look(self, asked: Question) -> Looked | None:
        """What becomes of a node with either label of the faces that are worth trying; None where time ran out."""
        known = self._looked.pop(id(asked.node), None)
        if known is not None:
            return known
        faces = self._telling(asked.node, self._undecided(asked.allowed))
        if self._relaxation.many:
            if asked.late():
                return None
            first, *others = self._looks(asked, faces)
            self._looked.update(others)
            return first[1]
        found, conflicts = list[Tried](), list[Conflict]()
        # one program after another there is no use in asking for more once something is ruled out
        for face in faces:
            if asked.late():
                return None
            waiting = self._children(asked, [face], conflicts)
            choices = self._relaxation.bound_all([self._program(asked, child) for _, child in waiting])
            found += self._tried(asked, [face], waiting, choices, conflicts)
            if len(found[-1].left) < 2:
                break
        return found, conflicts

    def _looks(self, asked: Question, faces: list[int]) -> list[tuple[int, Looked]]:
        """The same of a node and of the best open one that was not looked at yet, which is kept for its turn: so there
        is work for two threads. By what `id` says of the nodes."""
        parts = []
        for one, own in [(asked, faces), *self._ahead(asked)]:
            conflicts: list[Conflict] = []
            parts.append((one, own, self._children(one, own, conflicts), conflicts))
        programs = [self._program(one, child) for one, _, waiting, _ in parts for _, child in waiting]
        choices = iter(self._relaxation.bound_all(programs))
        found = []
        for one, own, waiting, conflicts in parts:
            tried = self._tried(one, own, waiting, list(islice(choices, len(waiting))), conflicts)
            found.append((id(one.node), (tried, conflicts)))
        return found

    def _ahead(self, asked: Question) -> list[tuple[Question, list[int]]]:
        for bound, _, node in sorted(self._open, key=lambda one: one[:2]):
            if id(node) in self._looked or -bound <= asked.threshold:
                continue
            allowed = self._settled(node.allowed & ~node.choice.useless)
            if allowed is not None and (undecided := self._undecided(allowed)).size:
                return [(replace(asked, node=node, allowed=allowed), self._telling(node, undecided))]
        return []

    @staticmethod
    def _program(asked: Question, child: Node) -> Asked:
        return child.allowed, asked.threshold, asked.node.choice.bound

    def _children(self, asked: Question, faces: list[int], conflicts: list[Conflict]) -> list[Waiting]:
        """Children of a node by face and label, those that have labellings, with its own choice until theirs is known.
        conflicts: to be added to."""
        node, waiting = asked.node, []
        for face in faces:
            for label, others in ((False, self._parted), (True, self._held)):
                decided = np.append(node.faces, self._faces[face]), np.append(node.labels, label)
                allowed = self._settled(asked.allowed & ~others[face])
                if allowed is None:
                    conflicts.append(Conflict(*decided, asked.threshold, Evidence.BLOCKS))
                elif asked.possible(*decided):
                    waiting.append(((face, label), Node(*decided, allowed, node.choice)))
        return waiting

    def _tried(
        self,
        asked: Question,
        faces: list[int],
        waiting: list[Waiting],
        choices: Sequence[Choice],
        conflicts: list[Conflict],
    ) -> list[Tried]:
        """What is left of children (k,) whose choices (k,) are known. conflicts: to be added to."""
        children: dict[tuple[int, bool], Node] = {}
        for (place, child), choice in zip(waiting, choices, strict=True):
            if choice.refuted:
                conflicts.append(Conflict(child.faces, child.labels, asked.threshold, Evidence.BLOCKS))
            else:
                children[place] = replace(child, choice=choice)
        return [Tried(children.get((face, False)), children.get((face, True))) for face in faces]

    def _gain(self, node: Node, tried: Tried) -> float:
        """How much two children lower the bound together."""
        return float(np.prod([max(node.choice.bound - one.choice.bound, _SMALL) for one in tried.left]))

    def _narrowed(self, asked: Question, forced: list[list[Node]], conflicts: list[Conflict]) -> Node | None:
        """A node with all the faces decided of which a label was ruled out. forced: what was left, at most one each."""
        if not all(forced):
            return None
        left = [one for (one,) in forced]
        if len(left) == 1:
            return left[0]
        faces = np.concatenate([asked.node.faces, *(one.faces[-1:] for one in left)])
        labels = np.concatenate([asked.node.labels, *(one.labels[-1:] for one in left)])
        allowed = self._settled(np.logical_and.reduce([one.allowed for one in left]))
        if allowed is not None:
            least = min(left, key=lambda one: one.choice.bound)
            return Node(faces, labels, allowed, replace(least.choice, share=np.where(allowed, least.choice.share, 0.0)))
        conflicts.append(Conflict(faces, labels, asked.threshold, Evidence.BLOCKS))
        return None
