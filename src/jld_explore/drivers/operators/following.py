"""Changes of a labelling that its mechanism suggests: joined across a face that moves, cut where nothing does."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.drivers.operators.atom_graph import BufferedRandom, Parts
from jld_explore.drivers.operators.segmentations import Operators, Segmentations
from jld_explore.space import SearchSpace

_MOVES: Final = 0.01
"""Share of the largest jump above which a face counts as moving."""

_JOIN: Final = 0.55
_CUT: Final = 0.1
"""Share of changes that join across a moving face, and that cut a block with none; the others look at no mechanism."""

_WHOLE: Final = 0.8
"""Chance that a block that is joined takes one more atom of the two it is made of, as long as limits allow it."""

_ADOPT: Final = 0.7
"""Chance that what is left over of them joins a neighbour."""


class Following:
    """Changes of labellings of one space. operators: of the space."""

    def __init__(self, space: SearchSpace, operators: Operators) -> None:
        self.space, self._operators = space, operators
        self._own = operators if isinstance(operators, Segmentations) else None

    def changes(self, labellings: Bits, parts: list[Parts], moving: Floats, rng: BufferedRandom) -> tuple[Bits, Ints]:
        """One change of each labelling (k, m) where one is found: rows (j, m), and which of the k each is of (j,).

        parts: of each, as `parts` gives them. moving: (k, m) jumps beside the largest, zero where unknown.
        """
        own = self._own
        rows: list[Bits] = []
        children: list[Parts] = []
        of: list[int] = []
        for k, (labels, part) in enumerate(zip(labellings, parts, strict=True)):
            if own is None:
                found = self._closed(labels, moving[k], rng)
                rows += found
                of += [k] * len(found)
            elif (child := self._child(own, labels, part, moving[k], rng)) is not None:
                children.append(child)
                of.append(k)
        if own is not None:
            rows = list(own.labels(children))
        empty = np.empty((0, labellings.shape[1]), dtype=bool)
        return (np.array(rows) if rows else empty), np.array(of, dtype=np.int64)

    def parts(self, labellings: Bits) -> list[Parts]:
        """Partitions of labellings (k, m), empty where slits are allowed."""
        return [[] for _ in labellings] if self._own is None else self._own.parts(labellings)

    def _closed(self, labels: Bits, moving: Floats, rng: BufferedRandom) -> list[Bits]:
        """Where slits are allowed: one face that moves becomes inner, or a change at random."""
        faces = self._moving_joints(labels, moving)
        if not faces or rng.real() >= _JOIN:
            return list(self._operators.vary(labels[None], rng))
        child = labels.copy()
        child[rng.pick(faces)] = False
        return [child]

    def _child(
        self, own: Segmentations, labels: Bits, part: Parts, moving: Floats, rng: BufferedRandom
    ) -> Parts | None:
        way = rng.real()
        if way < _JOIN and (faces := self._moving_joints(labels, moving)):
            face = rng.pick(faces)
            a, b = int(own.graph.face_a[face]), int(own.graph.face_b[face])
            return self._join(own, part, a, b, rng) if part[a] != part[b] else None
        if _JOIN <= way < _JOIN + _CUT:
            return self._cut(own, part, moving, rng)
        return own.change(part, rng)

    def _moving_joints(self, labels: Bits, moving: Floats) -> list[int]:
        found: list[int] = np.flatnonzero(labels & self.space.candidates & (moving > _MOVES)).tolist()
        return found

    def _join(self, own: Segmentations, part: Parts, a: int, b: int, rng: BufferedRandom) -> Parts | None:
        """A block around two atoms out of the blocks that hold them; what is left of those goes to others, or stays."""
        cutter, links = own.cutter, own.graph.links
        union = [c for c, name in enumerate(part) if name in (part[a], part[b])]
        block = [a, b]
        if not cutter.fits(block):
            return None
        left = set(union) - {a, b}
        while rng.real() < _WHOLE:
            near = sorted({d for c in block for d, _ in links[c] if d in left})
            fitting = [c for c in near if cutter.fits([*block, c])]
            if not fitting:
                break
            taken = rng.pick(fitting)
            block.append(taken)
            left.discard(taken)
        child, fresh = list(part), max(part) + 1
        for c in block:
            child[c] = fresh
        doubtful = [fresh]
        # what is left of either block stays apart: together they may be too large
        rest = [cutter.components([c for c in sorted(left) if part[c] == name]) for name in (part[a], part[b])]
        for number, piece in enumerate([*rest[0], *rest[1]]):
            name = fresh + 1 + number
            if rng.real() < _ADOPT:
                around = sorted({child[d] for c in piece for d, _ in links[c]} - {part[a], part[b], fresh})
                fitting = [n for n in around if cutter.fits([*piece, *(c for c, m in enumerate(child) if m == n)])]
                if fitting:
                    name = rng.pick(fitting)
            for c in piece:
                child[c] = name
            doubtful.append(name)
        if own.sound and all(cutter.enough([c for c, m in enumerate(child) if m == name]) for name in doubtful):
            return child
        return own.repair(child, rng, doubtful)

    def _cut(self, own: Segmentations, part: Parts, moving: Floats, rng: BufferedRandom) -> Parts | None:
        """A block none of whose faces moves becomes two or more."""
        faces = np.flatnonzero(moving > _MOVES)
        moved = {part[c] for c in (*own.graph.face_a[faces].tolist(), *own.graph.face_b[faces].tolist())}
        still = [c for c, name in enumerate(part) if name not in moved]
        return own.split_at(part, rng.pick(still), rng) if still else None
