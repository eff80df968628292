"""Branch and bound over the choice of blocks, for spaces whose blocks are small (docs/method.md (6.5)).

A node decides the labels of some faces, which leaves some of the possible blocks. The relaxation by blocks bounds λ
over all segmentations made of those, and shares them out; the face is decided next whose two labels are expected to
lower the bound most, by what deciding it did elsewhere and, until that is known, by trying. From a node the search
goes on to a child while there is one, since what deciding a face does is learnt deep down; then to the node of highest
bound.

The tree proves nothing by itself being searched to its end: every node that falls is a conflict, and it is the formula
of all conflicts that says whether a labelling is left.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.limit import Choice
from jld_explore.drivers.exact.choosers import Choosers
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.shrinking import Conflict
from jld_explore.space import SearchSpace

_TRIED: Final = 4
"""Faces tried at a node at the most, before one is decided."""

_SURE: Final = 2
"""Times a face must have been decided either way until its effect is expected instead of tried."""

_SMALL: Final = 1e-5
"""Least effect taken into account, scaled λ, so that a label without any does not hide the effect of the other."""

_PART: Final = 0.05
"""Least part of a face left to be decided, when effects are compared."""

Possible = Callable[[Ints, Bits], bool]
"""Whether any labelling is left with labels (k,) on faces (k,)."""


@dataclass(frozen=True)
class Node:
    """faces, labels: (k,) decided, True dry. allowed: (p,) blocks left. choice: what the relaxation says of them."""

    faces: Ints
    labels: Bits
    allowed: Bools
    choice: Choice


Child = Node | Conflict | None
"""What becomes of a node when one more face is decided: None where no labelling is left there."""


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
        relaxation: Choosers,
        space: SearchSpace,
        blocks: PossibleBlocks,
        threshold: float,
        most: float,
    ) -> None:
        self._relaxation, self._space, self._blocks = relaxation, space, blocks
        self._lay_out(space, blocks)
        self._effect, self._times = np.zeros((2, len(self._faces))), np.zeros((2, len(self._faces)))
        every = np.ones(len(blocks), dtype=bool)
        nothing = np.empty(0, dtype=np.int64)
        self.root = relaxation.choose(every, threshold, most)
        self._open: list[tuple[float, int, Node]] = []
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
    def finished(self) -> bool:
        """No node is open."""
        return self._next is None and not self._open

    def step(self, threshold: float, possible: Possible, late: Callable[[], bool]) -> Step:
        """Take an open node and decide one more face.

        threshold: scaled, not lower than before. late: asked between programs; True leaves the node open.
        """
        node = self._next or heapq.heappop(self._open)[2]
        self._next = None
        fallen = Conflict(node.faces, node.labels, threshold)
        if node.choice.bound <= threshold:
            return Step(node, (fallen,))
        allowed = self._settled(node.allowed & ~node.choice.useless)
        if allowed is None:
            return Step(node, (fallen,))
        undecided = self._undecided(allowed)
        if not undecided.size:
            return Step(node, (), self._blocks.labelling(self._space, np.flatnonzero(allowed)))
        children = self._branch(Question(node, allowed, threshold, possible, late), undecided)
        if children is None:
            self._next = node
            return Step(node)
        alive = [child for child in children if isinstance(child, Node)]
        for child in alive[1:]:
            self._push(child)
        self._next = alive[0] if alive else None
        return Step(node, tuple(child for child in children if isinstance(child, Conflict)))

    def rounded(self, node: Node) -> tuple[Ints, Bits]:
        """Labels (k,) of faces (k,) that the larger shares of a node's blocks suggest, with those it decides."""
        chosen = np.flatnonzero(node.allowed & (node.choice.share > 0.5))
        held = self._held[:, chosen].any(axis=1)
        parted = self._parted[:, chosen].any(axis=1) & ~held
        known = np.isin(self._faces, node.faces)
        faces = np.concatenate([node.faces, self._faces[held & ~known], self._faces[parted & ~known]])
        counts = int((held & ~known).sum()), int((parted & ~known).sum())
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

    def _branch(self, asked: Question, undecided: Ints) -> list[Child] | None:
        """What follows from either label of the face to decide, inner first; None where time ran out."""
        inner = np.clip((self._held[undecided] * asked.node.choice.share).sum(axis=1), 0.0, 1.0)
        score = self._expected(undecided, inner)
        order = np.argsort(-score - 1e-9 * (0.5 - abs(inner - 0.5)), kind="stable").tolist()
        sure = self._times[:, undecided].min(axis=0) >= _SURE
        expected = next((place for place in order if sure[place]), None)
        best, best_children = (-1.0 if expected is None else float(score[expected])), None
        for place in [place for place in order if not sure[place]][:_TRIED]:
            tried = self._tried(asked, int(undecided[place]), inner[place])
            if tried is None:
                return None
            children, found = tried
            if not all(isinstance(child, Node) for child in children):
                return children
            if found > best:
                best, best_children = found, children
        if best_children is None:
            assert expected is not None
            tried = self._tried(asked, int(undecided[expected]), inner[expected])
            return None if tried is None else tried[0]
        return best_children

    def _expected(self, undecided: Ints, inner: Floats) -> Floats:
        """Product of how far either label is expected to lower the bound, (k,)."""
        times, effect = self._times, self._effect
        usual = np.where(times.any(axis=1), effect.sum(axis=1) / np.maximum(times.sum(axis=1), 1.0), 1.0)
        rate = np.where(times > 0, effect / np.maximum(times, 1.0), usual[:, None])[:, undecided]
        joined, parted = rate[0] * (1.0 - inner), rate[1] * inner
        return np.asarray(np.maximum(joined, _SMALL) * np.maximum(parted, _SMALL))

    def _tried(self, asked: Question, face: int, inner: float) -> tuple[list[Child], float] | None:
        """Both children of a node, inner first, and how much they gain together; None where time ran out."""
        if asked.late():
            return None
        left = [self._settled(asked.allowed & ~parted[face]) for parted in (self._parted, self._held)]
        children = self._children(asked, left, face)
        gains = []
        for label, child in zip((False, True), children, strict=True):
            low = child.choice.bound if isinstance(child, Node) else asked.threshold
            gain = max(asked.node.choice.bound - low, 0.0)
            part = inner if label else 1.0 - inner
            self._effect[int(label), face] += gain / max(part, _PART)
            self._times[int(label), face] += 1.0
            gains.append(max(gain, _SMALL))
        return children, gains[0] * gains[1]

    def _children(self, asked: Question, left: list[Bools | None], face: int) -> list[Child]:
        """What becomes of a node with either label of a face, inner first. left: (p,) blocks then, None for none."""
        node, children, waiting = asked.node, list[Child](), list[tuple[int, Node]]()
        for label, allowed in zip((False, True), left, strict=True):
            faces, labels = np.append(node.faces, self._faces[face]), np.append(node.labels, label)
            if allowed is not None and not asked.possible(faces, labels):
                children.append(None)
                continue
            children.append(Conflict(faces, labels, asked.threshold))
            if allowed is not None:
                waiting.append((len(children) - 1, Node(faces, labels, allowed, node.choice)))
        programs = [(child.allowed, asked.threshold, node.choice.bound) for _, child in waiting]
        for (place, child), choice in zip(waiting, self._relaxation.choose_all(programs), strict=True):
            if not choice.refuted:
                children[place] = replace(child, choice=choice)
        return children
