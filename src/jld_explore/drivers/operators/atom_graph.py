"""The element graph as operators on segmentations see it: atoms, what may join them, and limits on parts.

An **atom** is a set of elements that every labelling keeps in one block (through fixed inner faces and
touching supports). A segmentation is a partition of the atoms into **parts** that are connected through
candidate faces, hold no **wall** (a face fixed dry) and keep all limits. Plain lists, because one operator
touches a handful of atoms, where an array costs more to call than to compute.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, inf
from typing import TypeVar

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Ints
from jld_explore.space import SearchSpace

Parts = list[int]
"""The name of the part of each atom, (atoms,); names are any integers."""

Item = TypeVar("Item")

_BLOCK = 4096


class BufferedRandom:
    """Random choices from a numpy Generator, drawn in blocks: one call of it costs as much as an operator.

    generator: for those who draw many numbers at once.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        self.generator = generator
        self._drawn: list[float] = []

    def real(self) -> float:
        """A number in [0, 1)."""
        if not self._drawn:
            self._drawn = self.generator.random(_BLOCK).tolist()
        return self._drawn.pop()

    def reals(self, count: int) -> list[float]:
        """`count` numbers in [0, 1)."""
        return [self.real() for _ in range(count)]

    def below(self, count: int) -> int:
        """An integer in 0 … count − 1."""
        return int(self.real() * count)

    def pick(self, items: list[Item]) -> Item:
        """One of a list that is not empty."""
        return items[int(self.real() * len(items))]

    def shuffled(self, items: list[Item]) -> list[Item]:
        """The items in random order."""
        return [items[i] for _, i in sorted((self.real(), i) for i in range(len(items)))]


@dataclass(frozen=True)
class Limits:
    """Inclusive bounds (least, most) with rounding allowed for. cells, weight, extent: of a part that holds a
    free element; parts: their number; dry: number of dry faces between free elements."""

    cells: tuple[int, float]
    weight: tuple[float, float]
    extent: tuple[float, float]
    parts: tuple[float, float]
    dry: tuple[float, float]

    @property
    def only_cells(self) -> bool:
        """Whether cells alone decide if a part is allowed."""
        return self.weight == (0.0, inf) and self.extent == (0.0, inf)


@dataclass(frozen=True)
class AtomGraph:
    """Atoms and what lies between them.

    of_element: (n,) atom of each element. first: (atoms,) an element of each atom. cells, weight, corner:
    free elements of each atom, their weight, and the upper corner of their box followed by the negative
    lower one. pairs: atoms that may be joined; links: for each atom (neighbour, pair). walls: atoms that a
    face fixed dry keeps apart from each atom. seams: (a, b, free faces between them) of every two atoms
    that touch. lines: for each pair, the straight lines or planes its candidate faces lie on. face_a,
    face_b: (m,) atoms.
    """

    of_element: Ints
    first: Ints
    cells: list[int]
    weight: list[float]
    corner: list[list[float]]
    pairs: list[tuple[int, int]]
    links: list[list[tuple[int, int]]]
    walls: list[list[int]]
    seams: list[tuple[int, int, int]]
    lines: list[list[int]]
    face_a: Ints
    face_b: Ints

    def __len__(self) -> int:
        return len(self.cells)


def atom_graph(space: SearchSpace) -> AtomGraph:
    """The atoms of a search space; in a space of loose bits faces fixed dry keep nothing apart."""
    assembly = space.assembly
    elements, faces = assembly.elements, assembly.interfaces
    first, of_element = np.unique(space.least, return_inverse=True)
    count = len(first)
    free = elements.free
    cells = np.bincount(of_element[free], minlength=count)
    weight = np.bincount(of_element[free], np.linalg.norm(elements.weight[free], axis=1), minlength=count)
    corner = np.full((count, 2 * assembly.dimension), -inf)
    np.maximum.at(corner, of_element[free], np.hstack([elements.upper[free], -elements.lower[free]]))
    a, b = of_element[faces.a], of_element[faces.b]
    low, high = np.minimum(a, b), np.maximum(a, b)
    between = low != high
    apart: set[tuple[int, int]] = set()
    if space.search.segmentation:
        fixed = np.flatnonzero(between & ~space.candidates & space.fixed)
        apart = set(zip(low[fixed].tolist(), high[fixed].tolist(), strict=True))
    joinable = np.flatnonzero(between & space.candidates)
    touching = sorted(set(zip(low[joinable].tolist(), high[joinable].tolist(), strict=True)) - apart)
    links: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for number, (p, q) in enumerate(touching):
        links[p].append((q, number))
        links[q].append((p, number))
    walls: list[list[int]] = [[] for _ in range(count)]
    reach = _reach(links)
    for p, q in sorted(apart):
        if reach[p] == reach[q]:  # else nothing could ever join them
            walls[p].append(q)
            walls[q].append(p)
    seam: dict[tuple[int, int], int] = {}
    for p, q in zip(
        low[between & assembly.free_faces].tolist(), high[between & assembly.free_faces].tolist(), strict=True
    ):
        seam[p, q] = seam.get((p, q), 0) + 1
    place = {pair: number for number, pair in enumerate(touching)}
    lines: list[list[int]] = [[] for _ in touching]
    line = _lines(space)
    for face in joinable.tolist():
        joint = place.get((int(low[face]), int(high[face])))
        if joint is not None:
            lines[joint].append(int(line[face]))
    return AtomGraph(
        of_element=of_element,
        first=first,
        cells=cells.tolist(),
        weight=weight.tolist(),
        corner=corner.tolist(),
        pairs=touching,
        links=links,
        walls=walls,
        seams=[(p, q, number) for (p, q), number in sorted(seam.items())],
        lines=lines,
        face_a=a,
        face_b=b,
    )


def _reach(links: list[list[tuple[int, int]]]) -> list[int]:
    """For each atom the first atom that it could be joined with."""
    first = [-1] * len(links)
    for start in range(len(links)):
        if first[start] < 0:
            first[start] = start
            queue = [start]
            for a in queue:
                for b, _ in links[a]:
                    if first[b] < 0:
                        first[b] = start
                        queue.append(b)
    return first


def _lines(space: SearchSpace) -> Ints:
    """(m,) number of the straight line (spatial: plane) that each face lies on."""
    assembly = space.assembly
    normal, origin = assembly.interfaces.normal, assembly.interfaces.origin
    rough = np.round(normal, 6)
    lead = np.take_along_axis(rough, np.argmax(abs(rough) > 1e-5, axis=1)[:, None], axis=1)
    sign = np.where(lead < 0.0, -1.0, 1.0)
    offset = (sign * normal * origin).sum(axis=1) / (assembly.size * 10.0 * tolerances.SYMMETRY)
    names = np.column_stack([np.round(sign * normal, 5) + 0.0, np.round(offset)])
    return np.asarray(np.unique(names, axis=0, return_inverse=True)[1].ravel(), dtype=np.int64)


def limits_of(space: SearchSpace, graph: AtomGraph) -> Limits:
    """The limits of a search; weights that go with the number of cells are turned into limits on cells."""
    search = space.search

    def bounds(pair: Sequence[float | None], slack: float) -> tuple[float, float]:
        low, high = pair
        least = -inf if low is None else low * (1.0 - slack)
        return least, inf if high is None else high * (1.0 + slack)

    low, high = bounds(search.block_cells, 0.0)
    light, heavy = bounds(search.block_weight, tolerances.DECIMALS)
    per_cell = {w / c for w, c in zip(graph.weight, graph.cells, strict=True) if c}
    if max(per_cell) - min(per_cell) <= 1e-12 * max(per_cell) and max(per_cell) > 0.0:
        unit = max(per_cell)
        low = max(low, ceil(light / unit - 1e-9) if light > 0.0 else low)
        high = min(high, floor(heavy / unit + 1e-9) if heavy < inf else high)
        light, heavy = 0.0, inf
    short, long = bounds(search.block_extent, tolerances.DECIMALS)
    return Limits(
        cells=(max(0, int(low)) if low > -inf else 0, high),
        weight=(max(0.0, light), heavy),
        extent=(max(0.0, short), long),
        parts=bounds(search.blocks, 0.0),
        dry=bounds(search.dry_faces, 0.0),
    )
