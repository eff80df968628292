"""Operators on labellings: draw one, change one, cross two, convert keys to one."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.batch.rows import Joining
from jld_core.deadline import checkpoint
from jld_explore.drivers.operators.atom_graph import AtomGraph, BufferedRandom, PartLimits, Parts, atom_graph, limits_of
from jld_explore.drivers.operators.cutting import Cutter, FreeBits, Repair
from jld_explore.space.labelling import blocks_of
from jld_explore.space.search_space import SearchSpace

THRESHOLD: Final = 0.5  # a pair with a key above it is separated, a pair with a lower key is joined
_ROUNDS: Final = 2  # passes over all pairs that join parts that are too small to others

# Width of the random interval of keys of a child of two parents, for four kinds of pairs. The kinds are those of
# `_LEAST`.
_WIDTH: Final = np.array([0.05, 0.05, 0.2, 0.2])
# Smallest key of a child of two parents, for four kinds of pairs. The kinds are: inside a block of both parents,
# between blocks of both, and where the parents differ, inside and between blocks of the parent that the child follows.
_LEAST: Final = np.array([0.0, 0.95, 0.25, 0.55])

# Smallest keys of pairs that a change keeps: inside a block, and between two blocks
_LEAST_KEPT: Final = np.array([0.2, 0.7])

Names = NDArray[Any]  # integer array of part names


class Batches:
    """Batch operators on segmentations, by keys (k, pairs), for limits on cells alone."""

    def __init__(self, space: SearchSpace, graph: AtomGraph, limits: PartLimits) -> None:
        self.space, self.graph = space, graph
        self.least, self.most = limits.cells
        pairs = np.array(graph.pairs, dtype=np.int64).reshape(-1, 2)
        self._p, self._q = pairs[:, 0], pairs[:, 1]
        self._cells = np.array(graph.cells, dtype=np.int64)
        low, high = np.minimum(graph.face_a, graph.face_b), np.maximum(graph.face_a, graph.face_b)
        face_of_pair = {(int(low[f]), int(high[f])): int(f) for f in np.flatnonzero(space.candidates)}
        self._face = np.array([face_of_pair[pair] for pair in graph.pairs], dtype=np.int64)
        self._line = np.array([lines[0] for lines in graph.lines], dtype=np.int64)
        centre = space.assembly.elements.centroid[graph.first]
        self._middle = 0.5 * (centre[self._p] + centre[self._q])
        self._joining = Joining(self._p, self._q, self._cells, self.least, self.most, _ROUNDS)
        self._span = float(np.ptp(centre, axis=0).max())

    def draw(self, count: int, rng: np.random.Generator) -> Bits:
        """Draw at most `count` random segmentations (j, m), each with its own threshold."""
        keys = rng.random((count, len(self._p)))
        return self.read(keys, rng.random((count, 1)))

    def cross(self, first: Bits, second: Bits, rng: np.random.Generator) -> Floats:
        """Return keys (k, pairs) of one child of each couple of parents (k, m)."""
        # Joints of both parents stay, and so do pairs that both have inside blocks. At other pairs the child follows
        # `first` in a patch and `second` outside, or one of them at random for each pair.
        first_cut, second_cut = first[:, self._face], second[:, self._face]
        count = len(first_cut)
        patch = np.empty(first_cut.shape, dtype=bool)
        by_patch = rng.random(count) < 0.7
        patch[by_patch] = self._patch(int(np.count_nonzero(by_patch)), rng)
        scattered = np.flatnonzero(~by_patch)
        patch[scattered] = rng.random((len(scattered), first_cut.shape[1])) < rng.random((len(scattered), 1))
        # index of the kind of each pair, see _LEAST
        is_cut, differs = (first_cut & patch) | (second_cut & ~patch), first_cut ^ second_cut
        kind = is_cut.view(np.uint8) + 2 * differs.view(np.uint8)
        keys = rng.random(first_cut.shape)
        keys *= _WIDTH.take(kind)
        keys += _LEAST.take(kind)
        return keys

    def vary(self, parents: Bits, rng: np.random.Generator) -> Floats:
        """Return keys (k, pairs) of one change of each parent (k, m)."""
        # The change cuts the two blocks beside a random joint anew, sometimes with a third one. Otherwise it moves one
        # atom, or all atoms along the straight line of the joint, across the joint.
        cut, count = parents[:, self._face], len(parents)
        name = blocks_of(self.space.graph, parents)[:, self.graph.first]
        rows = np.arange(count)
        chances = rng.random(cut.shape)
        chances *= cut
        joint = np.argmax(chances, axis=1)
        turn = rng.random(count) < 0.5
        mover = np.where(turn, self._q[joint], self._p[joint])
        target = np.where(turn, self._p[joint], self._q[joint])
        old, new = name[rows, mover][:, None], name[rows, target][:, None]
        keys = rng.random(cut.shape)
        keys *= 0.1
        keys += _LEAST_KEPT.take(cut.view(np.uint8))
        kind = rng.random(count)
        chosen = np.flatnonzero(kind < 0.5)
        names = name[chosen]
        inside = self._region(names, (names == old[chosen]) | (names == new[chosen]), rng)
        row, pair = np.nonzero(inside[:, self._p] & inside[:, self._q])
        loose = rng.random(len(row)) - rng.random(len(chosen))[row] + THRESHOLD
        keys[chosen[row], pair] = np.clip(loose, 0.0, 1.0)
        chosen = np.flatnonzero(kind >= 0.5)
        moving = self._moving(
            name[chosen], cut[chosen], old[chosen], new[chosen], joint[chosen], mover[chosen], kind[chosen] < 0.75
        )
        row, pair = np.nonzero(moving[:, self._p] | moving[:, self._q])
        p, q = self._p[pair], self._q[pair]
        mp, mq = moving[row, p], moving[row, q]
        row = chosen[row]
        joined = (mp & (mq | (name[row, q] == new[row, 0]))) | (mq & (name[row, p] == new[row, 0]))
        keys[row, pair] = np.where(joined, 0.01, 0.9)
        return keys

    def _region(self, name: Ints, inside: Bools, rng: np.random.Generator) -> Bools:
        """Add a third block that touches the region to 40 % of the rows of `inside` (k, atoms), in place."""
        rows = np.flatnonzero(rng.random(len(name)) < 0.4)
        touching = inside[rows][:, self._p] != inside[rows][:, self._q]
        pair = np.argmax(touching * rng.random(touching.shape), axis=1)
        outer = np.where(inside[rows, self._p[pair]], self._q[pair], self._p[pair])
        third = name[rows] == name[rows, outer][:, None]
        inside[rows] |= third & touching.any(axis=1)[:, None]
        return inside

    def _moving(self, name: Ints, cut: Bits, old: Ints, new: Ints, joint: Ints, mover: Ints, single: Bools) -> Bools:
        """Return the atoms (k, atoms) that a move transfers to the block beyond a joint (k,)."""
        # Where `single`, only atom `mover` moves. Elsewhere all atoms of block `old` move that touch block `new` along
        # the straight line of the joint.
        moving = np.zeros(name.shape, dtype=bool)
        moving[np.arange(len(name)), mover] = True
        rows = np.flatnonzero(~single)
        p, q = name[rows][:, self._p], name[rows][:, self._q]
        along = cut[rows] & (self._line == self._line[joint[rows]][:, None])
        line = np.zeros((len(rows), name.shape[1]), dtype=bool)
        for names_here, names_there, end in ((p, q, self._p), (q, p, self._q)):
            row, pair = np.nonzero(along & (names_here == old[rows]) & (names_there == new[rows]))
            line[row, end[pair]] = True
        moving[rows] = line
        return moving

    def _patch(self, count: int, rng: np.random.Generator) -> Bools:
        """Mark (count, pairs) the pairs on one side of a random plane, or in a random box."""
        centre = self._middle[rng.integers(len(self._middle), size=count)]
        planes = np.flatnonzero(rng.random(count) < 0.5)
        inside = np.ones((count, len(self._middle)), dtype=bool)
        reach = 0.6 * self._span * rng.random((count, 1))
        reach[planes] = np.inf
        side = np.zeros((len(planes), len(self._middle)))
        for coordinate, centre_coordinate, normal in zip(
            self._middle.T, centre.T, rng.normal(size=(centre.shape[1], len(planes))), strict=True
        ):
            offset = coordinate - centre_coordinate[:, None]
            inside &= abs(offset) <= reach
            side += offset[planes] * normal[:, None]
        inside[planes] = side > 0.0
        return inside

    def read(self, keys: Floats, threshold: float | Floats = THRESHOLD) -> Bits:
        """Convert keys (k, pairs) to labellings (j, m), j ≤ k; keys that break a limit give none."""
        return self.read_some(keys, threshold)[0]

    def read_some(self, keys: Floats, threshold: float | Floats = THRESHOLD) -> tuple[Bits, Ints]:
        """Convert keys as `read` does; also return (j,) the row of keys of each labelling."""
        name, complete = self._assemble(keys, threshold)
        across = name[:, self.graph.face_a] != name[:, self.graph.face_b]
        return np.asarray(np.where(self.space.candidates, across, self.space.fixed)), np.flatnonzero(complete)

    def _assemble(self, keys: Floats, threshold: float | Floats) -> tuple[Names, Bools]:
        """Join atoms by keys: parts (j, atoms), and (k,) True for the j rows without a part too small."""
        order = np.argsort(keys, axis=1)
        parts = self._joining.parts(order, np.count_nonzero(keys <= threshold, axis=1))
        if parts is not None:
            return np.asarray(parts[0][parts[1]]), parts[1]
        to_join = np.take_along_axis(keys <= threshold, order, axis=1).T.copy()
        ends = [end[order].T.copy() for end in (self._p, self._q)]
        forest = _Forest(len(keys), self._cells, self.least, self.most)
        for a, b, joined in zip(*ends, to_join, strict=True):
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
        complete = ~forest.lacking
        return forest.name[complete], complete


class _Forest:
    """Partitions under construction, one per row, as disjoint sets."""

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
        """Join the parts of atoms a and b (r,) in rows (r,) if the union has at most `most` cells."""
        # The part of b takes the name of that of a. Indices are those of flat arrays: `take` is the fastest.
        base = rows * self.atoms
        name_a: Names = self._names.take(base + a)
        name_b: Names = self._names.take(base + b)
        part_a: Ints = base + name_a
        part_b: Ints = base + name_b
        size_a, size_b = self.size.take(part_a), self.size.take(part_b)
        fits = (name_a != name_b) & (size_a + size_b <= self.most)
        if small_only:
            fits &= (size_a < self.least) | (size_b < self.least)
        chosen = np.flatnonzero(fits)
        if not len(chosen):
            return
        rows = rows.take(chosen)
        names = self.name.take(rows, axis=0)
        np.copyto(names, name_a.take(chosen)[:, None], where=names == name_b.take(chosen)[:, None])
        self.name[rows] = names
        self.size[part_a.take(chosen)] += size_b.take(chosen)
        self.size[part_b.take(chosen)] = 0


_TREES_TRIED: Final = 6  # number of spanning trees tried for one set of keys
_OFFSPRING_FACTOR: Final = 4  # children made for each evaluated one, where children are made in batches
_DRAWN_PER_REQUESTED: Final = 2  # random segmentations made in a batch per requested one, because limits exclude many
_FURTHER_BATCHES: Final = 4  # number of further batches made if the first one gives too few segmentations

# Share of a batch that must keep the limits for batches to be used. Otherwise segmentations are made one by one, with
# repair.
_LEAST_SHARE: Final = 0.125


class Segmentations:
    """Operators on segmentations, as partitions of atoms: blocks and joints change, never single labels."""

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self.graph = atom_graph(space)
        self.limits = limits_of(space, self.graph)
        self.cutter = Cutter(self.graph, self.limits)
        self.repair = Repair(self.graph, self.limits, self.cutter)
        # cuts that keep all limits need no repair
        self.sound = self.cutter.exact and not self.repair.counted
        self.keys = len(self.graph.pairs)
        in_batches = self.sound and self.keys > 0 and not any(self.graph.walls)
        self._batches = Batches(space, self.graph, self.limits) if in_batches else None
        self.always_feasible = (
            in_batches and not space.limits.on_counts and not space.limits.on_shapes and space.laying is None
        )
        self.offspring_factor = _OFFSPRING_FACTOR if in_batches else FreeBits.offspring_factor
        self._corner: list[list[float]] = self.graph.sized.corner.tolist()
        self._every = list(range(len(self.graph)))
        self._moves: list[Callable[[Parts, BufferedRandom], Parts | None]] = [
            self.split, self.merge, self.move, self.move, self.shift, self.recut, self.recut,
        ]  # fmt: skip

    def labels(self, parts: list[Parts]) -> Bits:
        names = np.array(parts, dtype=np.int64).reshape(len(parts), len(self.graph))
        across = names[:, self.graph.face_a] != names[:, self.graph.face_b]
        return np.asarray(np.where(self.space.candidates, across, self.space.fixed))

    def parts(self, labellings: Bits) -> list[Parts]:
        parts: list[Parts] = blocks_of(self.space.graph, labellings)[:, self.graph.first].tolist()
        return parts

    def draw(self, count: int, rng: BufferedRandom) -> Bits:
        # Each has a random threshold of its own, so that numbers of blocks spread.
        if self._batches is not None:
            rows = self._batches.draw(_DRAWN_PER_REQUESTED * count, rng.generator)
            if len(rows) >= _LEAST_SHARE * _DRAWN_PER_REQUESTED * count:
                for _ in range(_FURTHER_BATCHES):
                    checkpoint()
                    if len(rows) >= count:
                        break
                    rows = np.concatenate([rows, self._batches.draw(_DRAWN_PER_REQUESTED * count, rng.generator)])
                return rows[:count]
        return self.labels([part for _ in range(count) if (part := self.random(rng)) is not None])

    def vary(self, parents: Bits, rng: BufferedRandom) -> Bits:
        return self.labels([child for part in self.parts(parents) if (child := self.change(part, rng)) is not None])

    def cross(self, first: Bits, second: Bits, rng: BufferedRandom) -> Bits:
        couples = zip(self.parts(first), self.parts(second), strict=True)
        return self.labels([child for p, q in couples if (child := self.overlay(p, q, rng)) is not None])

    def cross_indexed(self, first: Bits, second: Bits, rng: BufferedRandom) -> tuple[Bits, Ints]:
        if self._batches is not None:
            labellings, of = self._batches.read_some(self._batches.cross(first, second, rng.generator))
            if len(labellings) >= _LEAST_SHARE * len(first):
                return labellings, of
        children = [self.overlay(p, q, rng) for p, q in zip(self.parts(first), self.parts(second), strict=True)]
        of = np.array([k for k, child in enumerate(children) if child is not None], dtype=np.int64)
        return self.labels([child for child in children if child is not None]), of

    def breed(self, first: Bits, second: Bits, single: Bits, rng: BufferedRandom) -> Bits:
        if self._batches is not None:
            children = self._batches.cross(first, second, rng.generator)
            changed = self._batches.vary(single, rng.generator)
            labellings = self._batches.read(np.concatenate([children, changed]))
            if len(labellings) >= _LEAST_SHARE * (len(first) + len(single)):
                return labellings
        return np.concatenate([self.cross(first, second, rng), self.vary(single, rng)])

    def read(self, keys: Floats, *, repair: bool = True) -> tuple[Bits, Ints]:
        """Return labellings of keys (k, pairs), and the row that each comes from."""
        labellings, source = self.labels([]), np.empty(0, dtype=np.int64)
        if self._batches is not None:
            labellings, source = self._batches.read_some(keys)
            exact = ((self.write(labellings) > THRESHOLD) == (keys[source] > THRESHOLD)).all(axis=1)
            labellings, source = labellings[exact], source[exact]
            if not repair:
                return labellings, source
        partitions, repaired = [], []
        for k in np.setdiff1d(np.arange(len(keys)), source).tolist():
            # the seed derives from the keys, so that the same keys give the same repair
            seed = np.random.default_rng(np.frombuffer(keys[k].tobytes(), dtype=np.uint32))
            partition = self._assemble(keys[k].tolist(), THRESHOLD, BufferedRandom(seed))
            if partition is not None:
                partitions.append(partition)
                repaired.append(k)
        return np.concatenate([labellings, self.labels(partitions)]), np.append(
            source, np.array(repaired, dtype=np.int64)
        )

    def write(self, labellings: Bits) -> Floats:
        part = blocks_of(self.space.graph, labellings)[:, self.graph.first]
        a, b = np.array(self.graph.pairs, dtype=np.int64).reshape(-1, 2).T
        return np.where(part[:, a] != part[:, b], 0.75, 0.25)

    def random(self, rng: BufferedRandom) -> Parts | None:
        """Draw a partition by random keys; limits on parts set the threshold."""
        low, high = self.limits.parts
        threshold = rng.real()
        if (low, high) != (-inf, inf):
            most = len(self.graph)
            parts_wanted = max(low, 1.0) + rng.real() * (min(high, most) - max(low, 1.0))
            threshold = 1.0 - (parts_wanted - 1.0) / max(most - 1.0, 1.0)
        keys = rng.reals(self.keys)
        if self.limits.sink is not None:
            # draw the share that stays first, so that few cells are left out as often as many
            stays = rng.real()
            for number, pair in enumerate(self.graph.pairs):
                if self.limits.sink.atom in pair and rng.real() < stays:
                    keys[number] = 1.0
        return self._assemble(keys, threshold, rng)

    def _assemble(self, keys: list[float], threshold: float, rng: BufferedRandom) -> Parts | None:
        """Convert keys to a partition that keeps all limits; return None if none is found."""
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
        """Merge the two blocks beside a random joint; return None without a joint or repair."""
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
        """Shift a joint line by one atom; return None without a joint or repair."""
        # The atoms that cross the joint lie along one straight part of it or along the whole joint between two blocks.
        # A third kind of shift moves all atoms along one straight line through the structure.
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
        """Return whether atom a lies before its neighbour b, alike along a straight line of faces."""
        first, second = self._corner[a], self._corner[b]
        return first < second

    def overlay(self, first: Parts, second: Parts, rng: BufferedRandom) -> Parts | None:
        """Cross two parents: overlay their joints, and merge the fragments; None if that fails."""
        # A key says how late a pair of atoms is joined: pairs above THRESHOLD stay apart where limits allow. Where both
        # parents agree, keys lie at the ends of [0, 1], so that limits undo them last. Where they differ, seven
        # children in ten take compact pieces of each: they follow `first` inside a connected patch and `second`
        # outside. The others separate each such pair with a probability that is drawn once for the child, so that some
        # children have few joints and some have many. Keys of one kind differ at random: so does the order of joining.
        patch = self._patch(rng) if rng.real() < 0.7 else None
        separating_share = rng.real()
        keys = []
        for a, b in self.graph.pairs:
            cut_first, cut_second = first[a] != first[b], second[a] != second[b]
            if cut_first == cut_second:
                keys.append(0.95 + 0.05 * rng.real() if cut_first else 0.05 * rng.real())
            elif patch is not None:
                follow = cut_first if patch[a] and patch[b] else cut_second
                keys.append((0.55 if follow else 0.25) + 0.2 * rng.real())
            else:
                keys.append(0.1 + 0.4 * rng.real() + (0.4 if rng.real() < separating_share else 0.0))
        return self._assemble(keys, THRESHOLD, rng)

    def _patch(self, rng: BufferedRandom) -> list[bool]:
        """Mark (atoms) a random connected set of 20 to 80 % of the atoms."""
        count = len(self.graph)
        size = max(1, int(count * (0.2 + 0.6 * rng.real())))
        inside = [False] * count
        queue = [rng.below(count)]
        inside[queue[0]] = True
        for a in queue:
            for b, _ in rng.shuffled(self.graph.links[a]):
                if not inside[b] and len(queue) < size:
                    inside[b] = True
                    queue.append(b)
        return inside

    def _joint(self, part: Parts, rng: BufferedRandom) -> tuple[int, int, int] | None:
        """Return a random pair (a, b, index) of neighbours in different parts, or None."""
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
        """Return the partition with some atoms cut into new pieces, repaired if needed, or None."""
        child, fresh = list(part), max(part) + 1
        for number, piece in enumerate(pieces):
            for a in piece:
                child[a] = fresh + number
        return child if self.sound else self.repair(child, rng, list(range(fresh, fresh + len(pieces))))


class Operators(Protocol):
    """Operators on labellings (k, m): draw, change, cross; rows that cannot keep limits are left out."""

    keys: int
    """Number of keys that `read` takes."""

    offspring_factor: int
    """Number of children that are cheap enough to make for each evaluated one."""

    always_feasible: bool
    """True if every row is feasible, because the operators keep all limits of the space."""

    def draw(self, count: int, rng: BufferedRandom) -> Bits:
        """Draw random labellings, at most `count`."""

    def vary(self, parents: Bits, rng: BufferedRandom) -> Bits:
        """Return one child of each parent (k, m), which differs by a small change."""

    def cross(self, first: Bits, second: Bits, rng: BufferedRandom) -> Bits:
        """Return one child of each couple of `first` and `second` (k, m)."""

    def cross_indexed(self, first: Bits, second: Bits, rng: BufferedRandom) -> tuple[Bits, Ints]:
        """Return one child of each couple, as `cross`, and the couple of each child (j,)."""

    def breed(self, first: Bits, second: Bits, single: Bits, rng: BufferedRandom) -> Bits:
        """Return one child of each couple (k, m), then one change of each single parent (i, m)."""

    def read(self, keys: Floats, *, repair: bool = True) -> tuple[Bits, Ints]:
        """Convert keys (k, keys) in [0, 1] to labellings (j, m), and the row (j,) of each; equal ones to equal ones.

        Without repair those are left out where a pair would not be as its key asks, if that is known at little cost.
        """

    def write(self, labellings: Bits) -> Floats:
        """Return keys (k, keys) of labellings (k, m), from which `read` makes the same labellings again."""


def operators(space: SearchSpace) -> Operators:
    """Make the operators on the labellings of a space.

    Parameters
    ----------
    space : SearchSpace
        The search space.

    Returns
    -------
    Operators
        On segmentations, or on single labels if slits are allowed.
    """
    return Segmentations(space) if space.search.segmentation else FreeBits(space)


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
        origin: list[int] = []
        for k, (labels, part) in enumerate(zip(labellings, parts, strict=True)):
            if segmentations is None:
                changed = self._closed(labels, moving[k], rng)
                rows += changed
                origin += [k] * len(changed)
            elif (child := self._child(segmentations, labels, part, moving[k], rng)) is not None:
                children.append(child)
                origin.append(k)
        if segmentations is not None:
            rows = list(segmentations.labels(children))
        empty = np.empty((0, labellings.shape[1]), dtype=bool)
        return (np.array(rows) if rows else empty), np.array(origin, dtype=np.int64)

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
        faces: list[int] = np.flatnonzero(labels & self.space.candidates & (moving > _LEAST_MOTION)).tolist()
        return faces

    def _join(self, segmentations: Segmentations, owner: Parts, a: int, b: int, rng: BufferedRandom) -> Parts | None:
        """Form a new block around atoms a and b, out of their two blocks; None if that fails."""
        # The pieces left of the two blocks join neighbours or become blocks of their own.
        cutter, links = segmentations.cutter, segmentations.graph.links
        old = (owner[a], owner[b])
        block = [a, b]
        if not cutter.fits(block):
            return None
        remaining = {atom for atom, name in enumerate(owner) if name in old} - {a, b}
        while rng.real() < _GROWTH_PROBABILITY:
            neighbours = sorted({other for atom in block for other, _ in links[atom] if other in remaining})
            fitting = [atom for atom in neighbours if cutter.fits([*block, atom])]
            if not fitting:
                break
            added = rng.pick(fitting)
            block.append(added)
            remaining.discard(added)
        child, fresh = list(owner), max(owner) + 1
        for atom in block:
            child[atom] = fresh
        members = {fresh: sorted(block)}  # of blocks that a piece may have joined
        unchecked = [fresh]
        # pieces of the two blocks stay separate, because together they may be too large
        pieces = [
            piece
            for name in old
            for piece in cutter.components([atom for atom in sorted(remaining) if owner[atom] == name])
        ]
        for number, piece in enumerate(pieces):
            name = fresh + 1 + number
            if rng.real() < _JOIN_PROBABILITY:
                around = sorted({child[other] for atom in piece for other, _ in links[atom]} - {*old, fresh})
                for beside in around:
                    if beside not in members:
                        members[beside] = [atom for atom, block_of_atom in enumerate(owner) if block_of_atom == beside]
                fitting = [n for n in around if cutter.fits([*piece, *members[n]])]
                if fitting:
                    name = rng.pick(fitting)
            for atom in piece:
                child[atom] = name
            members[name] = sorted([*members.get(name, []), *piece])
            unchecked.append(name)
        if segmentations.sound and all(cutter.large_enough(members[name]) for name in unchecked):
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
