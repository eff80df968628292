"""The element graph as operators on segmentations see it: atoms, what may join them, and limits on parts.

An **atom** is a set of elements that every labelling keeps in one block (through fixed inner faces and
touching supports). A segmentation is a partition of the atoms into **parts** that are connected through
candidate faces, hold no **wall** (a face fixed dry) and keep all limits. Plain lists, because one operator
touches a handful of atoms, where an array costs more to call than to compute.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TypeVar

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bools, Ints
from jld_explore.space import CELLS, EXEMPT, Range, SearchSpace, Sized

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


Seams = list[tuple[int, int, int]]
"""(a, b, faces between them) of atoms that touch, where there are such faces."""


@dataclass(frozen=True)
class Sink:
    """What may be left out, in a part of its own. atom: the one that stands for it. may: atoms that may be in its part.
    volume: of each atom; most: of those left out together.
    """

    atom: int
    may: frozenset[int]
    volume: list[float]
    most: float

    def takes(self, members: list[int]) -> bool:
        """Whether a part with the sink may be left out."""
        inside = all(a in self.may or a == self.atom for a in members)
        return inside and sum([self.volume[a] for a in members]) <= self.most


@dataclass(frozen=True)
class PartLimits:
    """Limits of a search as operators keep them; those on counts that are no sums of ones are left to `feasible`.

    sizes: on each part that holds a free element, by the keys of measures, as far as they do not go with cells.
    parts: (least, most) parts. seams: of counts of dry faces, with their (least, most). exempt: atoms that limits on
    single parts except. sink: what may be left out.
    """

    sizes: dict[str, Range]
    parts: tuple[float, float]
    seams: tuple[tuple[Seams, float, float], ...]
    exempt: frozenset[int] = frozenset()
    sink: Sink | None = None

    @property
    def cells(self) -> tuple[int, float]:
        """Least and most free elements of a part."""
        bounds = self.sizes[CELLS.key]
        return max(0, int(max(bounds.least, 0.0))), bounds.most

    @property
    def only_cells(self) -> bool:
        """Whether cells alone decide if a part is allowed."""
        return not self.exempt and not any(bounds.given for key, bounds in self.sizes.items() if key != CELLS.key)


@dataclass(frozen=True)
class AtomGraph:
    """Atoms and what lies between them.

    of_element: (n,) atom of each element. first: (atoms,) an element of each atom. cells: free elements of each
    atom; sized: all sizes of atoms. pairs: atoms that may be joined; links: for each atom (neighbour, pair). walls:
    atoms that a face fixed dry keeps apart from each atom. seams: by faces between free elements. lines: for each
    pair, the straight lines or planes its candidate faces lie on. face_a, face_b: (m,) atoms.
    """

    of_element: Ints
    first: Ints
    cells: list[int]
    sized: Sized
    pairs: list[tuple[int, int]]
    links: list[list[tuple[int, int]]]
    walls: list[list[int]]
    seams: Seams
    lines: list[list[int]]
    face_a: Ints
    face_b: Ints

    def __len__(self) -> int:
        return len(self.cells)


def atom_graph(space: SearchSpace) -> AtomGraph:
    """The atoms of a search space; in a space of loose bits faces fixed dry keep nothing apart."""
    assembly = space.assembly
    faces = assembly.interfaces
    first, of_element = np.unique(space.least, return_inverse=True)
    count = len(first)
    sized = space.limits.sized.joined(of_element, count)
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
        cells=sized.adds[CELLS.key].astype(np.int64).tolist(),
        sized=sized,
        pairs=touching,
        links=links,
        walls=walls,
        seams=_seams(a, b, assembly.free_faces),
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


def _seams(a: Ints, b: Ints, counted: Bools) -> Seams:
    """Seams by those faces (m,) that are counted; a, b: (m,) their atoms."""
    rows = np.flatnonzero(counted & (a != b))
    pairs = np.column_stack([np.minimum(a, b)[rows], np.maximum(a, b)[rows]])
    found, number = np.unique(pairs, axis=0, return_counts=True)
    return [(p, q, count) for (p, q), count in zip(found.tolist(), number.tolist(), strict=True)]


def _sink(space: SearchSpace, graph: AtomGraph) -> Sink | None:
    """What a search may leave out, by atoms: those of candidate cells alone."""
    if space.void is None:
        return None
    elements, cells = space.assembly.elements, space.void.cells
    free = np.where(elements.support, 0.0, elements.volume)
    volume = np.bincount(graph.of_element, free, minlength=len(graph))
    others = np.delete(np.arange(len(elements) - 1), cells)
    may = set(graph.of_element[cells].tolist()) - set(graph.of_element[others].tolist())
    most = space.limits.most_left_out
    return Sink(int(graph.of_element[space.assembly.sink]), frozenset(may), volume.tolist(), most)


def limits_of(space: SearchSpace, graph: AtomGraph) -> PartLimits:
    """The limits of a search; those that go with the number of cells are turned into limits on cells."""
    parts, seams = (-inf, inf), []
    for terms, bounds in space.limits.on_terms:
        if terms.faces is None:
            parts = max(parts[0], bounds.least), min(parts[1], bounds.most)
        elif not terms.blocks:
            seams.append((_seams(graph.face_a, graph.face_b, terms.faces), bounds.least, bounds.most))
    exempt = frozenset(np.flatnonzero(graph.sized.adds[EXEMPT.key]).tolist())
    return PartLimits(space.limits.by_cells(graph.sized), parts, tuple(seams), exempt, _sink(space, graph))
