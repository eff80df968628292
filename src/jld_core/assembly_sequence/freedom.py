"""Free translations of blocks, and the blocks that obstruct them.

Along one direction to infinity, a block is obstructed by every other block that meets its swept volume. This gives a
directed graph for each direction; a set without outgoing edges can be removed together. Source: Wilson & Latombe,
Geometric reasoning about mechanical assembly, Artificial Intelligence 71 (1994) 371–396.

The directions tried for a block depend on the block alone, and those for groups on the assembly alone. They never
depend on the other blocks present. A block or group that can be removed can therefore still be removed when fewer
blocks remain. Blocks that lock one another do so beside any other blocks.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.assembly_sequence.arcs import Arcs
from jld_core.assembly_sequence.blocks import Blocks
from jld_core.assembly_sequence.solids import Solids, tangents
from jld_core.deadline import checkpoint

_TURN: Final = 1e-7  # sine of the angle by which a direction may point into a contact: accuracy of normals in drawings

_DIRECTIONS: Final = 400  # largest number of directions in space that are tried for a block or a group

_CHUNK: Final = 1 << 22  # number of entries of the blocking table that are processed in one batch

_SIDEWAYS: Final = (0.0, 0.0, 1.0)  # direction out of the plane of a planar wall


class Bodies:
    """Translation data of an assembly's elements, computed once for all its labellings.

    sideways: blocks of a planar wall may leave it out of its plane; without effect in space. The attribute `up` (d,) is
    the unit vector against the total weight, or the last axis without weight.
    """

    def __init__(self, assembly: Assembly, sideways: bool = False) -> None:
        self.assembly = assembly
        self.sideways = sideways and assembly.dimension == 2
        weight = assembly.elements.weight.sum(axis=0)
        up = -weight if np.any(weight) else np.eye(assembly.dimension)[-1]
        self.up: Floats = up / np.linalg.norm(up)
        self._ways: dict[bytes, Floats] = {}

    @cached_property
    def arcs(self) -> Arcs:
        """Return the directions in which pairs of elements block each other (planar only)."""
        return Arcs(self.assembly)

    @cached_property
    def solids(self) -> Solids:
        """Return the sweep tests between the elements of a spatial assembly."""
        return Solids(self.assembly)

    @cached_property
    def common(self) -> Floats:
        """Return the unit directions in space (k, 3) that are tried for groups, at most 400.

        They follow from the contact normals of the assembly.
        """
        return _directions(self.assembly.interfaces.normal)

    def ways_of(self, mine: Bools) -> Floats:
        """Return the unit directions in space (k, 3) that are tried for one block, upward first.

        mine: (n,) bool mask of the block's elements. The directions follow from the normals of its own contacts, and
        include `common`.
        """
        key = np.packbits(mine).tobytes()
        if key not in self._ways:
            faces = self.assembly.interfaces
            border = mine[faces.a] != mine[faces.b]
            every = np.concatenate([_directions(faces.normal[border]), self.common])
            every = every[np.sort(np.unique(np.round(every, 9), axis=0, return_index=True)[1])]
            self._ways[key] = every[np.argsort(-np.round(every @ self.up, 6), kind="stable")]
        return self._ways[key]


class Freedom:
    """Tests in which directions the blocks of one labelling can be translated away.

    bodies: translation data of the assembly; made with `sideways` if not given.
    """

    def __init__(self, blocks: Blocks, sideways: bool = False, bodies: Bodies | None = None) -> None:
        self.blocks = blocks
        self.bodies = bodies or Bodies(blocks.assembly, sideways)
        self.sideways = self.bodies.sideways
        self._planar = blocks.assembly.dimension == 2
        self._apart: dict[bytes, bool] = {}

    def way_out(self, block: int, there: Bools) -> Floats | None:
        """Return a unit direction (d,) in which one block can leave the other blocks present.

        there: (k,) bool mask of the blocks present. The free direction nearest to upward is chosen among those tried;
        None where there is none. Where `sideways` applies, the result is always the out-of-plane vector (3,). Raises
        DeadlinePassed after an enforced deadline.
        """
        checkpoint()
        if self.sideways:
            return np.array(_SIDEWAYS)
        of = self.blocks.of
        mine, rest = of == block, there[of] & (of != block)
        if self._planar:
            return self.bodies.arcs.way_out(mine, rest, self.bodies.up)
        others, normals = self.blocks.contacts_of(block)
        touching = normals[there[others] & (others != block)]
        ways = self.bodies.ways_of(mine)
        ways = ways[(ways @ touching.T).max(axis=1, initial=-np.inf) <= _TURN]
        elements, still = np.flatnonzero(mine), np.flatnonzero(rest)
        free = (way for way in ways if not len(self.bodies.solids.swept(elements, still, way)))
        return next(free, None)

    def group_out(self, there: Bools, most: int) -> tuple[Ints, Floats] | None:
        """Return the smallest group of blocks that can leave together, and its direction.

        there: (k,) bool mask of the blocks present, fixed ones included. most: largest size of the group. Returns the
        block indices, ascending, and a unit vector (d,); None where no such group exists. In space, the blocks of the
        group must also be separable from one another afterwards. Those of a planar wall can be put together from the
        side beforehand.
        """
        return next((found for found in self._groups(there, most) if self._planar or self._separable(found[0])), None)

    def _groups(self, there: Bools, most: int) -> list[tuple[Ints, Floats]]:
        """Return the smallest group that must leave with each block, for each direction tried.

        there: (k,) mask of the blocks present. most: largest size of a group. Groups that hold a fixed block are left
        out. Each comes as block indices with a unit direction (d,), smaller groups first.
        """
        blocks = self.blocks
        ways, table = self._blocking
        standing = np.flatnonzero(there)
        held = blocks.fixed[standing]
        found: dict[bytes, tuple[Ints, Floats]] = {}
        step = max(1, _CHUNK // max(1, len(standing) ** 2))
        for first in range(0, len(ways), step):
            reach = _closed(table[first : first + step][:, standing][:, :, standing])
            good = (reach.sum(axis=2) <= most) & ~reach[:, :, held].any(axis=2)
            for way, place in zip(*np.nonzero(good), strict=True):
                group = standing[reach[way, place]]
                found.setdefault(group.tobytes(), (group, ways[first + way]))
        return sorted(found.values(), key=lambda one: (len(one[0]), one[0].tolist()))

    def _separable(self, group: Ints) -> bool:
        """Return True if the blocks of a group can be separated by translations.

        group: indices of the blocks, ascending. Results are stored.
        """
        if len(group) < 2:
            return True
        key = group.tobytes()
        if key not in self._apart:
            there = np.zeros(len(self.blocks), dtype=bool)
            there[group] = True
            parts = [part for part, _ in self._groups(there, len(group) - 1)]
            # the order of removal is irrelevant: fewer obstacles remain later
            rest = None if not parts else np.setdiff1d(group, parts[0])
            self._apart[key] = rest is not None and self._separable(parts[0]) and self._separable(rest)
        return self._apart[key]

    @cached_property
    def _blocking(self) -> tuple[Floats, Bools]:
        """Return directions (k, d) and a table (k, b, b) of the blocks that obstruct others.

        Entry (direction, i, j) is True where block i, moved along the direction, meets block j.
        """
        blocks, count = self.blocks, len(self.blocks)
        if self._planar:
            angle = self.bodies.arcs.turns
            return np.column_stack([np.cos(angle), np.sin(angle)]), self.bodies.arcs.blocking(blocks.of, count)
        ways = self.bodies.common
        table = np.zeros((len(ways), count, count), dtype=bool)
        towards = blocks.normal @ ways.T
        for face, way in zip(*np.nonzero(abs(towards) > _TURN), strict=True):
            ends = (blocks.first[face], blocks.second[face])
            table[(way, *(ends if towards[face, way] > 0.0 else ends[::-1]))] = True
        every = np.arange(len(blocks.of))
        for block in np.flatnonzero(~blocks.fixed).tolist():
            mine = blocks.of == block
            for number, way in enumerate(ways):
                others = every[~mine & ~table[number, block][blocks.of]]
                met = self.bodies.solids.swept(np.flatnonzero(mine), others, way)
                table[number, block, blocks.of[met]] = True
        return ways, table


def _closed(arrows: Bools) -> Bools:
    """Return the reflexive transitive closure (k, b, b) of directed graphs (k, b, b)."""
    reach = np.asarray(arrows | np.eye(arrows.shape[1], dtype=bool))
    while True:
        wide = reach.astype(np.float32)
        wider = np.asarray((wide @ wide) > 0.0)
        if np.array_equal(wider, reach):
            return reach
        reach = wider


def _directions(normals: Floats) -> Floats:
    """Return candidate unit directions in space (k, 3) derived from contact normals (c, 3).

    They are the normals, the intersection lines of contact planes, tangents, and the bisectors of these.
    """
    if not len(normals):
        return np.concatenate([np.eye(3), -np.eye(3)])
    both = np.concatenate([normals, -normals]) + 0.0
    normals = both[np.unique(np.round(both, 9) + 0.0, axis=0, return_index=True)[1]]
    i, j = np.triu_indices(len(normals), 1)
    edges = np.cross(normals[i], normals[j])
    size = np.linalg.norm(edges, axis=1)
    edges = edges[size > 1e-6] / size[size > 1e-6, None]
    beside = [tangents(normal) for normal in normals[:16]]
    first = np.concatenate([normals, edges, -edges, *beside])
    first = first[np.sort(np.unique(np.round(first, 9), axis=0, return_index=True)[1])][:_DIRECTIONS]
    i, j = np.triu_indices(len(first), 1)
    between = first[i] + first[j]
    size = np.linalg.norm(between, axis=1)
    every = np.concatenate([first, between[size > 1e-6] / size[size > 1e-6, None]])
    return every[np.sort(np.unique(np.round(every, 9), axis=0, return_index=True)[1])][:_DIRECTIONS]
