"""Which blocks can be moved away by a translation, and what stands in their way.

Along one direction to infinity a block is blocked by every other that the volume it sweeps meets. Blocks and what
blocks them are a directed graph for each direction; a set that no arrow leaves can be taken out together. Source:
Wilson & Latombe, Geometric reasoning about mechanical assembly, Artificial Intelligence 71 (1994) 371–396.

Which directions are tried for a block follows from the block alone, and for groups from the assembly alone, never from
what stands beside them: a block or group that can be moved away can be so when less is there, and blocks that lock one
another do so whatever else is there.
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

_TURN: Final = 1e-7
"""Sine by which a direction may point into a contact: what the normals of a drawing leave."""

_DIRECTIONS: Final = 400
"""Directions in space that are tried for a block or a group at the most."""

_CHUNK: Final = 1 << 22
"""Arrows between blocks that are followed at once."""

_SIDEWAYS: Final = (0.0, 0.0, 1.0)


class Bodies:
    """What is known of the translations of an assembly's elements, shared by all its labellings.

    sideways: planar walls may be taken apart out of their plane.
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
        """Of a planar assembly: the directions in which elements meet."""
        return Arcs(self.assembly)

    @cached_property
    def solids(self) -> Solids:
        """Of a spatial one: which elements are met along a direction."""
        return Solids(self.assembly)

    @cached_property
    def common(self) -> Floats:
        """Directions in space (k, 3) that groups are tried in."""
        return _directions(self.assembly.interfaces.normal)

    def ways_of(self, mine: Bools) -> Floats:
        """Directions in space (k, 3) that some elements (n,) are tried in, from above first."""
        key = np.packbits(mine).tobytes()
        if key not in self._ways:
            faces = self.assembly.interfaces
            border = mine[faces.a] != mine[faces.b]
            every = np.concatenate([_directions(faces.normal[border]), self.common])
            every = every[np.sort(np.unique(np.round(every, 9), axis=0, return_index=True)[1])]
            self._ways[key] = every[np.argsort(-np.round(every @ self.up, 6), kind="stable")]
        return self._ways[key]


class Freedom:
    """Translations of the blocks of one labelling. bodies: of their assembly, made where not given."""

    def __init__(self, blocks: Blocks, sideways: bool = False, bodies: Bodies | None = None) -> None:
        self.blocks = blocks
        self.bodies = bodies or Bodies(blocks.assembly, sideways)
        self.sideways = self.bodies.sideways
        self._planar = blocks.assembly.dimension == 2
        self._apart: dict[bytes, bool] = {}

    def way_out(self, block: int, there: Bools) -> Floats | None:
        """A direction (d,) along which one block leaves the others that are there (k,), the nearest to upwards.

        None where there is none. Out of the plane the direction is the third unit vector.
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
        """The smallest group of at most so many blocks that leaves the others together, and its direction.

        there: (k,) blocks not yet taken away, fixed ones among them. None where there is none. In space its blocks must
        come apart as well; those of a planar wall slide together from the side before they are lifted.
        """
        return next((found for found in self._groups(there, most) if self._planar or self._separable(found[0])), None)

    def _groups(self, there: Bools, most: int) -> list[tuple[Ints, Floats]]:
        """All smallest sets that leave together along some direction, the fewest blocks first, each once."""
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
        """Whether the blocks of a group come apart by themselves, by translations."""
        if len(group) < 2:
            return True
        key = group.tobytes()
        if key not in self._apart:
            there = np.zeros(len(self.blocks), dtype=bool)
            there[group] = True
            parts = [part for part, _ in self._groups(there, len(group) - 1)]
            # what comes apart does so whatever is taken first: less is in the way later
            rest = None if not parts else np.setdiff1d(group, parts[0])
            self._apart[key] = rest is not None and self._separable(parts[0]) and self._separable(rest)
        return self._apart[key]

    @cached_property
    def _blocking(self) -> tuple[Floats, Bools]:
        """Directions (k, d), and for each who is blocked by whom (k, b, b)."""
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
    """(k, b, b) what is reached along arrows (k, b, b), each from itself too."""
    reach = np.asarray(arrows | np.eye(arrows.shape[1], dtype=bool))
    while True:
        wide = reach.astype(np.float32)
        wider = np.asarray((wide @ wide) > 0.0)
        if np.array_equal(wider, reach):
            return reach
        reach = wider


def _directions(normals: Floats) -> Floats:
    """Unit directions in space (k, 3) that normals (c, 3) suggest: along them, along their edges, and between those."""
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
