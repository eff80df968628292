"""Element graph for operators on segmentations: atoms, pairs that may be joined, limits, in plain lists."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TypeVar

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bools, Ints
from jld_explore.space.limits import CELLS, EXEMPT, Range, Sized
from jld_explore.space.search_space import SearchSpace

Parts = list[int]  # partition: the name, any integer, of the part of each atom

Item = TypeVar("Item")  # items of a list

_BLOCK = 4096  # random numbers generated in one call of numpy


class BufferedRandom:
    """Random choices from numbers that a numpy Generator produces in batches.

    Parameters
    ----------
    generator : numpy.random.Generator
        Source of the numbers; also an attribute, for callers that need many at once.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        self.generator = generator
        self._drawn: list[float] = []

    def real(self) -> float:
        if not self._drawn:
            self._drawn = self.generator.random(_BLOCK).tolist()
        return self._drawn.pop()

    def reals(self, count: int) -> list[float]:
        return [self.real() for _ in range(count)]

    def below(self, count: int) -> int:
        return int(self.real() * count)

    def pick(self, items: list[Item]) -> Item:
        return items[int(self.real() * len(items))]

    def shuffled(self, items: list[Item]) -> list[Item]:
        return [items[i] for _, i in sorted((self.real(), i) for i in range(len(items)))]


Seams = list[tuple[int, int, int]]  # pairs of atoms that touch, as (a, b, number of faces between them)


@dataclass(frozen=True)
class Sink:
    """Part of a partition that collects the cells left out of the structure."""

    atom: int  # atom that represents the part; it is no cell
    may: frozenset[int]  # atoms that may be left out
    volume: list[float]  # volume of each atom, scene units
    most: float  # largest total volume left out

    def takes(self, members: list[int]) -> bool:
        """Return whether all atoms of the part that contains the sink may be left out together."""
        inside = all(a in self.may or a == self.atom for a in members)
        return inside and sum([self.volume[a] for a in members]) <= self.most


@dataclass(frozen=True)
class PartLimits:
    # limits on each part with a free element, by key of the measure. Limits that are proportional to the number of
    # cells are converted to limits on cells.
    sizes: dict[str, Range]
    parts: tuple[float, float]  # least and largest number of parts
    # for each limited count of dry faces: its seams, its least and its largest value
    seams: tuple[tuple[Seams, float, float], ...]
    exempt: frozenset[int] = frozenset()  # atoms whose parts are exempt from limits on single parts
    sink: Sink | None = None  # part of the cells left out of the structure, None if all cells stay

    @property
    def cells(self) -> tuple[int, float]:
        """Least and largest number of free elements of a part."""
        bounds = self.sizes[CELLS.key]
        return max(0, int(max(bounds.least, 0.0))), bounds.most

    @property
    def only_cells(self) -> bool:
        """True if the limits on single parts are on the number of cells alone."""
        return not self.exempt and not any(bounds.given for key, bounds in self.sizes.items() if key != CELLS.key)


@dataclass(frozen=True)
class AtomGraph:
    """Graph of atoms: groups of elements that no labelling separates, by inner faces or supports."""

    of_element: Ints  # (n,) atom of each element
    first: Ints  # (atoms,) one element of each atom
    cells: list[int]  # number of free elements of each atom
    sized: Sized  # all sizes of the atoms
    pairs: list[tuple[int, int]]  # pairs of atoms that may be joined
    links: list[list[tuple[int, int]]]  # for each atom its neighbours, as (neighbour, index of the pair)
    walls: list[list[int]]  # for each atom the atoms that a face fixed dry separates from it
    seams: Seams  # pairs of atoms that touch by faces between free elements, as (a, b, number of these faces)
    lines: list[list[int]]  # for each pair the straight lines (spatial: planes) of its candidate faces, by number
    # face_a, face_b: (m,) atoms on both sides of each face
    face_a: Ints
    face_b: Ints

    def __len__(self) -> int:
        # plain lists, since operators use a handful of atoms, for which numpy costs more than it saves
        return len(self.cells)


def atom_graph(space: SearchSpace) -> AtomGraph:
    """Build the graph of atoms of a space: pairs that may be joined, walls that keep atoms apart."""
    # If slits are allowed, faces fixed dry separate no atoms.
    assembly = space.assembly
    faces = assembly.interfaces
    first, of_element = np.unique(space.least, return_inverse=True)
    count = len(first)
    sized = space.limits.sized.joined(of_element, count)
    a, b = of_element[faces.a], of_element[faces.b]
    low, high = np.minimum(a, b), np.maximum(a, b)
    between = low != high
    # pairs of atoms that a face fixed dry keeps apart, and those that a candidate may join
    apart: set[tuple[int, int]] = set()
    if space.search.segmentation:
        fixed = np.flatnonzero(between & ~space.candidates & space.fixed)
        apart = set(zip(low[fixed].tolist(), high[fixed].tolist(), strict=True))
    joinable = np.flatnonzero(between & space.candidates)
    touching = sorted(set(zip(low[joinable].tolist(), high[joinable].tolist(), strict=True)) - apart)
    links: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for number, (atom, other) in enumerate(touching):
        links[atom].append((other, number))
        links[other].append((atom, number))
    walls: list[list[int]] = [[] for _ in range(count)]
    reach = _reach(links)
    for atom, other in sorted(apart):
        if reach[atom] == reach[other]:  # atoms of different components can never be joined
            walls[atom].append(other)
            walls[other].append(atom)
    # the straight lines in which the faces of each joint lie
    number_of = {pair: number for number, pair in enumerate(touching)}
    lines: list[list[int]] = [[] for _ in touching]
    line = _lines(space)
    for face in joinable.tolist():
        joint = number_of.get((int(low[face]), int(high[face])))
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
    """Return for each atom the first atom of its connected component."""
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
    """Return the number (m,) of the straight line (spatial: plane) of each face."""
    assembly = space.assembly
    normal, origin = assembly.interfaces.normal, assembly.interfaces.origin
    rough = np.round(normal, 6)
    lead = np.take_along_axis(rough, np.argmax(abs(rough) > 1e-5, axis=1)[:, None], axis=1)
    sign = np.where(lead < 0.0, -1.0, 1.0)
    offset = (sign * normal * origin).sum(axis=1) / (assembly.size * 10.0 * tolerances.SYMMETRY)
    names = np.column_stack([np.round(sign * normal, 5) + 0.0, np.round(offset)])
    return np.asarray(np.unique(names, axis=0, return_inverse=True)[1].ravel(), dtype=np.int64)


def _seams(a: Ints, b: Ints, counted: Bools) -> Seams:
    """Return the seams of the counted faces (m,), given the atoms a and b (m,) of each face."""
    rows = np.flatnonzero(counted & (a != b))
    pairs = np.column_stack([np.minimum(a, b)[rows], np.maximum(a, b)[rows]])
    distinct, number = np.unique(pairs, axis=0, return_counts=True)
    return [(p, q, count) for (p, q), count in zip(distinct.tolist(), number.tolist(), strict=True)]


def _sink(space: SearchSpace, graph: AtomGraph) -> Sink | None:
    """Return the sink of a space whose cells may be left out, None for any other space."""
    # Only atoms that consist of such cells alone may be left out.
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
    # Limits that are proportional to the number of cells are converted to limits on cells, which are faster to check.
    parts, seams = (-inf, inf), []
    for terms, bounds in space.limits.on_terms:
        if terms.faces is None:
            parts = max(parts[0], bounds.least), min(parts[1], bounds.most)
        elif not terms.blocks:
            seams.append((_seams(graph.face_a, graph.face_b, terms.faces), bounds.least, bounds.most))
    exempt = frozenset(np.flatnonzero(graph.sized.adds[EXEMPT.key]).tolist())
    return PartLimits(space.limits.by_cells(graph.sized), parts, tuple(seams), exempt, _sink(space, graph))
