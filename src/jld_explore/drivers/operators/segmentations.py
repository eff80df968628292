"""Operators on labellings: draw one, change one, cross two, convert keys to one.

On segmentations the operators change blocks and joints, never single labels. They split a block, merge two, move a
cell across a joint, shift a joint line, or cut the union of blocks anew. Two parents are crossed by overlaying their
joints and merging the fragments. A result that breaks a limit is repaired, or dropped if repair fails. Operators may
therefore return fewer rows than requested. All rows are in the search space, but may be neither canonical nor new;
`Register` removes such rows.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Ints
from jld_core.deadline import checkpoint
from jld_explore.drivers.operators.atom_graph import BufferedRandom, Parts, atom_graph, limits_of
from jld_explore.drivers.operators.batches import THRESHOLD, Batches
from jld_explore.drivers.operators.cutting import Cutter
from jld_explore.drivers.operators.free_bits import FreeBits
from jld_explore.drivers.operators.repair import Repair
from jld_explore.space import SearchSpace
from jld_explore.space.labelling import blocks_of

_TREES_TRIED: Final = 6  # number of spanning trees tried for one set of keys

_OFFSPRING_FACTOR: Final = 4  # children made for each evaluated one, where children are made in batches

_DRAWN_PER_REQUESTED: Final = 2  # random segmentations made in a batch per requested one, because limits exclude many

_FURTHER_BATCHES: Final = 4  # number of further batches made if the first one gives too few segmentations

# Share of a batch that must keep the limits for batches to be used. Otherwise segmentations are made one by one, with
# repair.
_LEAST_SHARE: Final = 0.125


class Segmentations:
    """Operators on the segmentations of a search space: draw, change and cross them.

    A segmentation is handled as a partition: the part, a block, of each atom. An atom is a group of elements that no
    labelling separates. Methods that fail return None or leave rows out.

    graph: atoms of the space. cutter: cuts regions into parts. repair: repairs partitions that break a limit. sound:
    whether cuts keep all limits, so that no repair is needed.
    """

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self.graph = atom_graph(space)
        self.limits = limits_of(space, self.graph)
        self.cutter = Cutter(self.graph, self.limits)
        self.repair = Repair(self.graph, self.limits, self.cutter)
        # cuts that keep all limits need no repair
        self.sound = self.cutter.exact and not self.repair.counted
        self.keys = len(self.graph.pairs)
        whole = self.sound and self.keys > 0 and not any(self.graph.walls)
        self._batches = Batches(space, self.graph, self.limits) if whole else None
        self.always_feasible = (
            whole and not space.limits.on_counts and not space.limits.on_shapes and space.laying is None
        )
        self.offspring_factor = _OFFSPRING_FACTOR if whole else FreeBits.offspring_factor
        self._corner: list[list[float]] = self.graph.sized.corner.tolist()
        self._every = list(range(len(self.graph)))
        self._moves: list[Callable[[Parts, BufferedRandom], Parts | None]] = [
            self.split, self.merge, self.move, self.move, self.shift, self.recut, self.recut,
        ]  # fmt: skip

    def labels(self, parts: list[Parts]) -> Bits:
        """Return the labellings (k, m), True = dry, of k partitions."""
        names = np.array(parts, dtype=np.int64).reshape(len(parts), len(self.graph))
        across = names[:, self.graph.face_a] != names[:, self.graph.face_b]
        return np.asarray(np.where(self.space.candidates, across, self.space.fixed))

    def parts(self, labellings: Bits) -> list[Parts]:
        """Return the partition of each labelling (k, m): the part of each atom."""
        found: list[Parts] = blocks_of(self.space.graph, labellings)[:, self.graph.first].tolist()
        return found

    def draw(self, count: int, rng: BufferedRandom) -> Bits:
        """Draw at most `count` random segmentations (j, m).

        Each has a random threshold of its own, so that numbers of blocks spread.
        """
        if self._batches is not None:
            found = self._batches.draw(_DRAWN_PER_REQUESTED * count, rng.generator)
            if len(found) >= _LEAST_SHARE * _DRAWN_PER_REQUESTED * count:
                for _ in range(_FURTHER_BATCHES):
                    checkpoint()
                    if len(found) >= count:
                        break
                    found = np.concatenate([found, self._batches.draw(_DRAWN_PER_REQUESTED * count, rng.generator)])
                return found[:count]
        return self.labels([part for _ in range(count) if (part := self.random(rng)) is not None])

    def vary(self, parents: Bits, rng: BufferedRandom) -> Bits:
        """Change each parent (k, m) once, sometimes two or three times; see `Operators.vary`."""
        return self.labels([child for part in self.parts(parents) if (child := self.change(part, rng)) is not None])

    def cross(self, first: Bits, second: Bits, rng: BufferedRandom) -> Bits:
        """Return one child of each couple by overlaying the joints of its parents.

        first, second: (k, m) parents. Couples without a child are left out.
        """
        couples = zip(self.parts(first), self.parts(second), strict=True)
        return self.labels([child for p, q in couples if (child := self.overlay(p, q, rng)) is not None])

    def cross_indexed(self, first: Bits, second: Bits, rng: BufferedRandom) -> tuple[Bits, Ints]:
        """Return one child of each couple, and the couple of each child (j,); see `Operators`.

        Children are made in batches where limits allow.
        """
        if self._batches is not None:
            found, of = self._batches.read_some(self._batches.cross(first, second, rng.generator))
            if len(found) >= _LEAST_SHARE * len(first):
                return found, of
        made = [self.overlay(p, q, rng) for p, q in zip(self.parts(first), self.parts(second), strict=True)]
        of = np.array([k for k, child in enumerate(made) if child is not None], dtype=np.int64)
        return self.labels([child for child in made if child is not None]), of

    def breed(self, first: Bits, second: Bits, single: Bits, rng: BufferedRandom) -> Bits:
        """Return one child of each couple, and one change of each single parent.

        Both are made in batches where limits allow.
        """
        if self._batches is not None:
            children = self._batches.cross(first, second, rng.generator)
            changed = self._batches.vary(single, rng.generator)
            found = self._batches.read(np.concatenate([children, changed]))
            if len(found) >= _LEAST_SHARE * (len(first) + len(single)):
                return found
        return np.concatenate([self.cross(first, second, rng), self.vary(single, rng)])

    def read(self, keys: list[float]) -> Bits:
        """Convert keys to a segmentation (1, m), or (0, m) if none is found.

        keys: one key per pair of neighbouring atoms; a pair with a key above `THRESHOLD` is separated.
        """
        # the seed derives from the keys, so that the same keys give the same repair
        seed = np.random.default_rng(np.frombuffer(np.asarray(keys).tobytes(), dtype=np.uint32))
        part = self._assemble(keys, THRESHOLD, BufferedRandom(seed))
        return self.labels([] if part is None else [part])

    def write(self, labelling: Bits) -> list[float]:
        """Return one key for each pair of neighbouring atoms of a segmentation (m,).

        It is 0.25 inside a block and 0.75 between two blocks.
        """
        part = self.parts(labelling[None])[0]
        return [0.75 if part[a] != part[b] else 0.25 for a, b in self.graph.pairs]

    def random(self, rng: BufferedRandom) -> Parts | None:
        """Return a random segmentation as a partition, or None if none is found."""
        low, high = self.limits.parts
        threshold = rng.real()
        if (low, high) != (-inf, inf):
            most = len(self.graph)
            wanted = max(low, 1.0) + rng.real() * (min(high, most) - max(low, 1.0))
            threshold = 1.0 - (wanted - 1.0) / max(most - 1.0, 1.0)
        keys = rng.reals(self.keys)
        if self.limits.sink is not None:
            # draw the share that stays first, so that few cells are left out as often as many
            stays = rng.real()
            for number, pair in enumerate(self.graph.pairs):
                if self.limits.sink.atom in pair and rng.real() < stays:
                    keys[number] = 1.0
        return self._assemble(keys, threshold, rng)

    def _assemble(self, keys: list[float], threshold: float, rng: BufferedRandom) -> Parts | None:
        """Convert keys to a partition that keeps all limits; return None if none is found.

        keys: one per pair of atoms. threshold: key above which a pair is separated. Keys that lead to no allowed parts
        are changed at random and tried again.
        """
        pieces = None
        for tries in range(_TREES_TRIED):
            checkpoint()
            if tries:  # this tree allows no cuts, so keys farther and farther from the given ones are tried
                keys = [0.7 * key + 0.3 * rng.real() for key in keys]
            pairs = zip(keys, self.graph.pairs, strict=True)
            keyed = sorted([(key, n, a, b) for n, (key, (a, b)) in enumerate(pairs)])
            pieces = self.cutter.assemble(self._every, keyed, threshold)
            if pieces is not None:
                break
        sound = self.sound and pieces is not None
        if pieces is None:
            # no tree allows cuts: start from parts that are not too large
            pieces = self.cutter.grow(self._every, keyed, 1.0)
        part = [0] * len(self.graph)
        for name, members in enumerate(pieces):
            for a in members:
                part[a] = name
        return part if sound else self.repair(part, rng)

    def change(self, part: Parts, rng: BufferedRandom) -> Parts | None:
        """Return a partition after one random change, sometimes more; None if a change fails."""
        child: Parts | None = rng.pick(self._moves)(part, rng)
        while child is not None and rng.real() < 0.25:
            child = rng.pick(self._moves)(child, rng)
        return child

    def split(self, part: Parts, rng: BufferedRandom) -> Parts | None:
        """Split a random block into two or more; return None if it cannot be split."""
        return self.split_at(part, rng.below(len(part)), rng)

    def split_at(self, part: Parts, atom: int, rng: BufferedRandom) -> Parts | None:
        """Split the block of an atom into two or more; return None if it cannot be split."""
        name = part[atom]
        members = [a for a, other in enumerate(part) if other == name]
        if len(members) < 2:
            return None
        pieces = self.cutter.cut(members, rng, 0.5 + 0.5 * rng.real())
        return None if pieces is None or len(pieces) < 2 else self._with(part, pieces, rng)

    def merge(self, part: Parts, rng: BufferedRandom) -> Parts | None:
        """Merge the two blocks beside a random joint; return None without a joint or repair.

        A union that is too large is cut anew.
        """
        joint = self._joint(part, rng)
        if joint is None:
            return None
        old, new = part[joint[0]], part[joint[1]]
        return self.repair([new if name == old else name for name in part], rng, [new])

    def recut(self, part: Parts, rng: BufferedRandom) -> Parts | None:
        """Cut the union of two or three neighbouring blocks anew; return None if that fails."""
        joint = self._joint(part, rng)
        if joint is None:
            return None
        names = {part[joint[0]], part[joint[1]]}
        if rng.real() < 0.3:
            links = self.graph.links
            more = [part[b] for a, name in enumerate(part) if name in names for b, _ in links[a]]
            more = [name for name in more if name not in names]
            if more:
                names.add(rng.pick(more))
        members = [a for a, name in enumerate(part) if name in names]
        pieces = self.cutter.cut(members, rng, rng.real())
        return None if pieces is None else self._with(part, pieces, rng)

    def move(self, part: Parts, rng: BufferedRandom) -> Parts | None:
        """Move one atom across a random joint; return None without a joint or repair."""
        joint = self._joint(part, rng)
        if joint is None:
            return None
        child = list(part)
        child[joint[0]] = part[joint[1]]
        return self.repair(child, rng, [part[joint[0]], part[joint[1]]])

    def shift(self, part: Parts, rng: BufferedRandom) -> Parts | None:
        """Shift a joint line by one atom; return None without a joint or repair.

        The atoms that cross the joint lie along one straight part of it or along the whole joint between two blocks.
        A third kind of shift moves all atoms along one straight line through the structure.
        """
        joint = self._joint(part, rng)
        if joint is None:
            return None
        a, b, pair = joint
        old, new = part[a], part[b]
        lines, links = self.graph.lines, self.graph.links
        kind = rng.below(3)
        line = rng.pick(lines[pair])
        child = list(part)
        unchecked = {old: None, new: None}
        if kind == 2:
            side = self._side(a, b)
            for number, (p, q) in enumerate(self.graph.pairs):
                if part[p] != part[q] and line in lines[number]:
                    p, q = (p, q) if self._side(p, q) == side else (q, p)
                    child[p] = part[q]
                    unchecked[part[p]] = unchecked[part[q]] = None
        else:
            for c, name in enumerate(part):
                if name == old and any(
                    part[d] == new and (kind == 1 or line in lines[number]) for d, number in links[c]
                ):
                    child[c] = new
        return self.repair(child, rng, list(unchecked))

    def _side(self, a: int, b: int) -> bool:
        """Return True if atom a lies before its neighbour b, in the order of coordinates.

        The result is the same for all pairs along a straight line of faces.
        """
        first, second = self._corner[a], self._corner[b]
        return first < second

    def overlay(self, first: Parts, second: Parts, rng: BufferedRandom) -> Parts | None:
        """Cross two parents: overlay their joints, and merge the fragments.

        A joint of both parents stays where limits allow, and a face inside blocks of both stays inside. At the other
        faces the child follows `first` inside a random patch and `second` outside, or one of them at random for each
        face. The result is the partition of the child, None if none is found.

        first, second: partitions of the parents. rng: source of random numbers.
        """
        patch = self._patch(rng) if rng.real() < 0.7 else None
        bias = rng.real()
        keys = []
        for a, b in self.graph.pairs:
            one, two = first[a] != first[b], second[a] != second[b]
            if one == two:
                keys.append(0.95 + 0.05 * rng.real() if one else 0.05 * rng.real())
            elif patch is not None:
                follow = one if patch[a] and patch[b] else two
                keys.append((0.55 if follow else 0.25) + 0.2 * rng.real())
            else:
                keys.append(0.1 + 0.8 * (rng.real() * 0.5 + (0.5 if rng.real() < bias else 0.0)))
        return self._assemble(keys, THRESHOLD, rng)

    def _patch(self, rng: BufferedRandom) -> list[bool]:
        """Mark (atoms) a random connected set of 20 to 80 % of the atoms."""
        count = len(self.graph)
        wanted = max(1, int(count * (0.2 + 0.6 * rng.real())))
        inside = [False] * count
        queue = [rng.below(count)]
        inside[queue[0]] = True
        for a in queue:
            for b, _ in rng.shuffled(self.graph.links[a]):
                if not inside[b] and len(queue) < wanted:
                    inside[b] = True
                    queue.append(b)
        return inside

    def _joint(self, part: Parts, rng: BufferedRandom) -> tuple[int, int, int] | None:
        """Return a random pair of neighbours in different parts, None if all are in one part.

        The result is (a, b, index of the pair), a and b in random order.
        """
        pairs = self.graph.pairs
        if not pairs:
            return None
        for _ in range(8):
            number = rng.below(len(pairs))
            a, b = pairs[number]
            if part[a] != part[b]:
                break
        else:
            joints = [n for n, (p, q) in enumerate(pairs) if part[p] != part[q]]
            if not joints:
                return None
            number = rng.pick(joints)
            a, b = pairs[number]
        return (a, b, number) if rng.real() < 0.5 else (b, a, number)

    def _with(self, part: Parts, pieces: list[list[int]], rng: BufferedRandom) -> Parts | None:
        """Return the partition with some atoms cut into new pieces, repaired if needed, or None.

        part: partition before. pieces: atoms of each new part. None if no repair is found.
        """
        child, fresh = list(part), max(part) + 1
        for number, piece in enumerate(pieces):
            for a in piece:
                child[a] = fresh + number
        return child if self.sound else self.repair(child, rng, list(range(fresh, fresh + len(pieces))))
