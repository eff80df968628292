"""Change labellings by their mechanism: join blocks at moving faces, cut blocks at rest."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.drivers.operators.atom_graph import BufferedRandom, Parts
from jld_explore.drivers.operators.segmentations import Operators, Segmentations
from jld_explore.space import SearchSpace

_LEAST_MOTION: Final = 0.01  # share of the largest jump above which a face counts as moving

_JOIN_SHARE: Final = 0.55  # share of changes that join blocks across a moving face
# Share of changes that cut a block without moving faces. The remaining changes ignore the mechanism.
_CUT_SHARE: Final = 0.1

# Probability that a joined block takes one more atom of the two blocks it replaces. The block grows with this
# probability per atom as long as limits allow.
_GROWTH_PROBABILITY: Final = 0.8

_JOIN_PROBABILITY: Final = 0.7  # probability that a remaining piece of the two blocks joins a neighbour


class Following:
    """Operator that joins blocks where their mechanism moves, and cuts blocks at rest."""

    def __init__(self, space: SearchSpace, operators: Operators) -> None:
        self.space, self._operators = space, operators
        self._segmentations = operators if isinstance(operators, Segmentations) else None

    def changes(self, labellings: Bits, parts: list[Parts], moving: Floats, rng: BufferedRandom) -> tuple[Bits, Ints]:
        """Change labellings (k, m) by relative jumps (k, m); return rows (j, m) and their origin (j,)."""
        segmentations = self._segmentations
        rows: list[Bits] = []
        children: list[Parts] = []
        of: list[int] = []
        for k, (labels, part) in enumerate(zip(labellings, parts, strict=True)):
            if segmentations is None:
                found = self._closed(labels, moving[k], rng)
                rows += found
                of += [k] * len(found)
            elif (child := self._child(segmentations, labels, part, moving[k], rng)) is not None:
                children.append(child)
                of.append(k)
        if segmentations is not None:
            rows = list(segmentations.labels(children))
        empty = np.empty((0, labellings.shape[1]), dtype=bool)
        return (np.array(rows) if rows else empty), np.array(of, dtype=np.int64)

    def parts(self, labellings: Bits) -> list[Parts]:
        """Return the partition of each labelling (k, m), empty lists if slits are allowed."""
        return [[] for _ in labellings] if self._segmentations is None else self._segmentations.parts(labellings)

    def _closed(self, labels: Bits, moving: Floats, rng: BufferedRandom) -> list[Bits]:
        """Make one moving dry face of labels (m,) inner, or vary at random, where slits are allowed."""
        faces = self._moving_joints(labels, moving)
        if not faces or rng.real() >= _JOIN_SHARE:
            return list(self._operators.vary(labels[None], rng))
        child = labels.copy()
        child[rng.pick(faces)] = False
        return [child]

    def _child(
        self, segmentations: Segmentations, labels: Bits, part: Parts, moving: Floats, rng: BufferedRandom
    ) -> Parts | None:
        """Return a partition joined at a moving face, cut at rest, or varied; None if that fails."""
        # The choice is random.
        choice = rng.real()
        if choice < _JOIN_SHARE and (faces := self._moving_joints(labels, moving)):
            face = rng.pick(faces)
            a, b = int(segmentations.graph.face_a[face]), int(segmentations.graph.face_b[face])
            return self._join(segmentations, part, a, b, rng) if part[a] != part[b] else None
        if _JOIN_SHARE <= choice < _JOIN_SHARE + _CUT_SHARE:
            return self._cut(segmentations, part, moving, rng)
        return segmentations.change(part, rng)

    def _moving_joints(self, labels: Bits, moving: Floats) -> list[int]:
        """Return the dry candidate faces that move; labels, moving: (m,)."""
        found: list[int] = np.flatnonzero(labels & self.space.candidates & (moving > _LEAST_MOTION)).tolist()
        return found

    def _join(self, segmentations: Segmentations, part: Parts, a: int, b: int, rng: BufferedRandom) -> Parts | None:
        """Form a new block around atoms a and b, out of their two blocks; None if that fails."""
        # The pieces left of the two blocks join neighbours or become blocks of their own.
        cutter, links = segmentations.cutter, segmentations.graph.links
        union = [c for c, name in enumerate(part) if name in (part[a], part[b])]
        block = [a, b]
        if not cutter.fits(block):
            return None
        left = set(union) - {a, b}
        while rng.real() < _GROWTH_PROBABILITY:
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
        unchecked = [fresh]
        # pieces of the two blocks stay separate, because together they may be too large
        rest = [cutter.components([c for c in sorted(left) if part[c] == name]) for name in (part[a], part[b])]
        for number, piece in enumerate([*rest[0], *rest[1]]):
            name = fresh + 1 + number
            if rng.real() < _JOIN_PROBABILITY:
                around = sorted({child[d] for c in piece for d, _ in links[c]} - {part[a], part[b], fresh})
                fitting = [n for n in around if cutter.fits([*piece, *(c for c, m in enumerate(child) if m == n)])]
                if fitting:
                    name = rng.pick(fitting)
            for c in piece:
                child[c] = name
            unchecked.append(name)
        if segmentations.sound and all(
            cutter.large_enough([c for c, m in enumerate(child) if m == name]) for name in unchecked
        ):
            return child
        return segmentations.repair(child, rng, unchecked)

    def _cut(self, segmentations: Segmentations, part: Parts, moving: Floats, rng: BufferedRandom) -> Parts | None:
        """Cut a random block whose faces do not move into two or more; None if that fails."""
        faces = np.flatnonzero(moving > _LEAST_MOTION)
        moved = {
            part[c] for c in (*segmentations.graph.face_a[faces].tolist(), *segmentations.graph.face_b[faces].tolist())
        }
        still = [c for c, name in enumerate(part) if name not in moved]
        return segmentations.split_at(part, rng.pick(still), rng) if still else None
