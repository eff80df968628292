"""Own bounds by stress and velocity fields on a uniform mesh, for plane and space: shares no code with jld.

Blocks are boxes of a lattice whose cells are split into simplices. Stresses and velocities are linear in each simplex
and jump between them. Both programs go to Clarabel as they are: yield is a second-order cone in the plane and two
semidefinite cones in space. Loads act at nodes of the lattice, so that their ends are nodes of the mesh.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import clarabel
import numpy as np
import scipy.sparse as sp

Array = np.ndarray[Any, Any]
Pull = Callable[[Array, Array], Array]
"""Force per area (d,) at a point (d,) of a free face with an outward normal (d,)."""

_PSD: Final = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
"""Entries of a symmetric 3 × 3 matrix in the order of the solver, which counts those off the diagonal √2 times."""


@dataclass(frozen=True)
class Lattice:
    """Structure of lattice boxes.

    step: (d,) size of a cell. block: number of the block of each cell by its indices. support: indices of support
    cells. dry: pairs of blocks whose face is dry, block −1 for supports. lines: (a, b) of yield R ≤ a + b m. friction,
    cohesion, crushing: of dry faces. body: dead and live force per volume (2, d). pull: dead and live tractions.
    """

    step: Array
    block: dict[tuple[int, ...], int]
    support: frozenset[tuple[int, ...]]
    dry: frozenset[frozenset[int]]
    lines: list[tuple[float, float]]
    friction: float
    cohesion: float
    crushing: float
    body: Array
    pull: tuple[list[tuple[Pull, Callable[[Array], bool]]], list[tuple[Pull, Callable[[Array], bool]]]]


@dataclass(frozen=True)
class Simplices:
    """Mesh: nodes (p, d), cells (t, d + 1) of nodes, block (t,) of each, and its facets.

    facets: (simplex, its corners, outward normal, area, second simplex or −1, its corners, kind), kind "inside",
    "joint", "support" or "free", and True where it is dry.
    """

    nodes: Array
    cells: Array
    block: Array
    facets: list[tuple[int, tuple[int, ...], Array, float, int, tuple[int, ...], str, bool]]


def mesh_of(lattice: Lattice) -> Simplices:
    """Split each square in four about its middle, each cube in six along a diagonal."""
    d, number = len(lattice.step), dict[tuple[float, ...], int]()
    cells, blocks = [], []

    def node(place: Array) -> int:
        return number.setdefault(tuple(np.round(place, 6).tolist()), len(number))

    for cell, block in lattice.block.items():
        corner = np.array(cell, dtype=float)
        if d == 2:
            ring = [corner + shift for shift in ((0, 0), (1, 0), (1, 1), (0, 1))]
            parts = [[ring[k], ring[(k + 1) % 4], corner + 0.5] for k in range(4)]
        else:
            parts = [
                [corner, *np.cumsum(np.eye(3)[list(order)], axis=0) + corner]
                for order in itertools.permutations(range(3))
            ]
        for part in parts:
            cells.append([node(place) for place in part])
            blocks.append(block)
    nodes = np.array(list(number)) * lattice.step
    sides = dict[tuple[int, ...], list[tuple[int, tuple[int, ...]]]]()
    for t, cell_nodes in enumerate(cells):
        for left_out in range(d + 1):
            own = tuple(k for k in range(d + 1) if k != left_out)
            key = tuple(sorted(cell_nodes[k] for k in own))
            ordered = tuple(sorted(own, key=lambda k, c=cell_nodes: c[k]))  # type: ignore[misc]
            sides.setdefault(key, []).append((t, ordered))
    facets = []
    for key, users in sides.items():
        places, (t, own) = nodes[list(key)], users[0]
        if d == 2:
            along = places[1] - places[0]
            vector = np.array([along[1], -along[0]])
        else:
            vector = 0.5 * np.cross(places[1] - places[0], places[2] - places[0])
        area = float(np.linalg.norm(vector))
        normal, middle = vector / area, places.mean(axis=0)
        if (nodes[cells[t]].mean(axis=0) - middle) @ normal > 0.0:
            normal = -normal
        if len(users) == 2:
            (other, theirs), pair = users[1], frozenset({blocks[t], blocks[users[1][0]]})
            kind, dry = ("inside", False) if len(pair) == 1 else ("joint", pair in lattice.dry)
        else:
            other, theirs = -1, ()
            beyond = tuple(math.floor(x) for x in (middle + 0.1 * lattice.step.min() * normal) / lattice.step)
            held = beyond in lattice.support
            kind, dry = ("support", frozenset({blocks[t], -1}) in lattice.dry) if held else ("free", False)
        facets.append((t, own, normal, area, other, theirs, kind, dry))
    return Simplices(nodes, np.array(cells), np.array(blocks), facets)


class _Rows:
    """Rows of one kind of cone, s = right − A x."""

    def __init__(self) -> None:
        self.entries: tuple[list[int], list[int], list[float]] = ([], [], [])
        self.right: list[float] = []

    def add(self, terms: list[tuple[int, float]], right: float = 0.0) -> None:
        """Append Σ value x + s = right."""
        for column, value in terms:
            self.entries[0].append(len(self.right))
            self.entries[1].append(column)
            self.entries[2].append(value)
        self.right.append(right)


class _Program:
    """Minimise cost · x over equalities, inequalities, second-order and semidefinite cones."""

    def __init__(self) -> None:
        self.cost: list[float] = []
        self.equal, self.least = _Rows(), _Rows()
        self.soc: dict[int, _Rows] = {}
        self.psd = _Rows()

    def unknowns(self, count: int, cost: float = 0.0) -> int:
        """Return the first number of new unknowns."""
        self.cost += [cost] * count
        return len(self.cost) - count

    def cone(self, parts: list[tuple[list[tuple[int, float]], float]]) -> None:
        """Append that the first of some affine functions is at least the length of the others."""
        rows = self.soc.setdefault(len(parts), _Rows())
        for terms, constant in parts:
            rows.add([(column, -value) for column, value in terms], constant)

    def semidefinite(self, entries: dict[tuple[int, int], list[tuple[int, float]]]) -> None:
        """Append that a symmetric 3 × 3 matrix of linear functions is positive semidefinite."""
        for i, j in _PSD:
            self.psd.add([(c, -v * (1.0 if i == j else math.sqrt(2.0))) for c, v in entries[i, j]])

    def solve(self) -> tuple[str, float]:
        """Return status and cost."""
        groups = [(self.equal, "zero", 1), (self.least, "least", 1)]
        groups += [(rows, "soc", size) for size, rows in sorted(self.soc.items())] + [(self.psd, "psd", 6)]
        parts, right, cones = [], [], []
        for rows, kind, size in groups:
            if not rows.right:
                continue
            (row, column, value), count = rows.entries, len(rows.right)
            parts.append(sp.csc_matrix((value, (row, column)), shape=(count, len(self.cost))))
            right += rows.right
            if kind in ("zero", "least"):
                cones.append(clarabel.ZeroConeT(count) if kind == "zero" else clarabel.NonnegativeConeT(count))
            else:
                one = clarabel.SecondOrderConeT(size) if kind == "soc" else clarabel.PSDTriangleConeT(3)
                cones += [one] * (count // size)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        none = sp.csc_matrix((len(self.cost), len(self.cost)))
        matrix = sp.csc_matrix(sp.vstack(parts))
        found = clarabel.DefaultSolver(none, np.array(self.cost), matrix, np.array(right), cones, settings).solve()
        return str(found.status), float(found.obj_val)


def _value(status: str, cost: float, sign: float, unbounded: float) -> float | None:
    """Return a bound from a status, None where it proves nothing."""
    if status == "Solved":
        return sign * cost
    if status == "DualInfeasible":
        return unbounded
    return -unbounded if status == "PrimalInfeasible" else None


def _gradients(mesh: Simplices) -> tuple[Array, Array]:
    """Return gradients (t, d + 1, d) of the linear functions of corners, and volumes (t,)."""
    d = int(mesh.nodes.shape[1])
    edges = mesh.nodes[mesh.cells[:, 1:]] - mesh.nodes[mesh.cells[:, :1]]
    inner = np.linalg.inv(edges).transpose(0, 2, 1)
    volume = abs(np.linalg.det(edges)) / math.factorial(d)
    return np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1), volume


def _pulls(lattice: Lattice, mesh: Simplices, facet: Any) -> Array:
    """Return dead and live tractions (2, d corners, d) of a free facet."""
    t, own, normal, *_ = facet
    places = mesh.nodes[mesh.cells[t][list(own)]]
    found = np.zeros((2, len(own), places.shape[1]))
    for kind, loads in enumerate(lattice.pull):
        for value, acts in loads:
            if acts(np.append(places.mean(axis=0), mesh.block[t])):
                found[kind] += [value(place, normal) for place in places]
    return found


def lower_bound(lattice: Lattice) -> float | None:
    """Return the largest λ of a stress field, −inf without one, inf where it is unbounded, None if undecided."""
    mesh, program = mesh_of(lattice), _Program()
    d = int(mesh.nodes.shape[1])
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    gradient, _ = _gradients(mesh)
    first = program.unknowns(len(mesh.cells) * (d + 1) * len(pairs))
    load = program.unknowns(1, -1.0)

    def sigma(t: int, k: int, i: int, j: int) -> int:
        return first + (t * (d + 1) + k) * len(pairs) + pairs.index((min(i, j), max(i, j)))

    def traction(t: int, k: int, i: int, normal: Array, sign: float = 1.0) -> list[tuple[int, float]]:
        return [(sigma(t, k, i, j), sign * normal[j]) for j in range(d)]

    for t in range(len(mesh.cells)):
        for i in range(d):
            terms = [(sigma(t, k, i, j), gradient[t, k, j]) for k in range(d + 1) for j in range(d)]
            program.equal.add([*terms, (load, lattice.body[1, i])], -lattice.body[0, i])
        for k in range(d + 1):
            _within_yield(program, lattice, {(i, j): sigma(t, k, i, j) for i, j in pairs}, d)
    for facet in mesh.facets:
        t, own, normal, _, other, theirs, kind, dry = facet
        pulls = _pulls(lattice, mesh, facet) if kind == "free" else None
        for corner, k in enumerate(own):
            for i in range(d):
                if other >= 0:
                    terms = traction(t, k, i, normal) + traction(other, theirs[corner], i, normal, -1.0)
                    program.equal.add(terms)
                elif pulls is not None:
                    dead, live = pulls[:, corner, i]
                    program.equal.add([*traction(t, k, i, normal), (load, -live)], dead)
            if dry:
                _within_joint(program, lattice, [traction(t, k, i, normal) for i in range(d)], normal)
    return _value(*program.solve(), -1.0, math.inf)


def _within_yield(program: _Program, lattice: Lattice, s: dict[tuple[int, int], int], d: int) -> None:
    """Add yield of the stress with the given unknowns."""
    if d == 2:
        xx, yy, xy = s[0, 0], s[1, 1], s[0, 1]
        for a, b in lattice.lines:
            program.cone([([(xx, 0.5 * b), (yy, 0.5 * b)], a), ([(xx, 0.5), (yy, -0.5)], 0.0), ([(xy, 1.0)], 0.0)])
        return
    top = program.unknowns(2)
    for sign, limit in ((-1.0, top), (1.0, top + 1)):
        program.semidefinite({(i, j): [(s[i, j], sign), *([(limit, -sign)] if i == j else [])] for i, j in _PSD})
    for a, b in lattice.lines:
        program.least.add([(top, 0.5 - 0.5 * b), (top + 1, -0.5 - 0.5 * b)], a)


def _tangents(normal: Array) -> list[Array]:
    if len(normal) == 2:
        return [np.array([-normal[1], normal[0]])]
    one = np.cross(normal, np.eye(3)[int(np.argmin(abs(normal)))])
    one = one / np.linalg.norm(one)
    return [one, np.cross(normal, one)]


def _along(parts: list[list[tuple[int, float]]], axis: Array, factor: float = 1.0) -> list[tuple[int, float]]:
    """Return the component along an axis of a vector of linear functions."""
    return [(c, factor * axis[i] * v) for i, terms in enumerate(parts) for c, v in terms]


def _within_joint(program: _Program, lattice: Lattice, pull: list[list[tuple[int, float]]], normal: Array) -> None:
    """Add friction, no tension, and crushing of a traction on a dry face."""
    program.least.add(_along(pull, normal))
    sliding = [(_along(pull, axis), 0.0) for axis in _tangents(normal)]
    program.cone([(_along(pull, normal, -lattice.friction), lattice.cohesion), *sliding])
    if math.isfinite(lattice.crushing):
        program.least.add(_along(pull, normal, -1.0), lattice.crushing)


def upper_bound(lattice: Lattice) -> float | None:
    """Return the least λ of a velocity field, −inf where it is unbounded, inf without one, None if undecided."""
    mesh, program = mesh_of(lattice), _Program()
    d = int(mesh.nodes.shape[1])
    gradient, volume = _gradients(mesh)
    first = program.unknowns(len(mesh.cells) * (d + 1) * d)

    def velocity(t: int, k: int, i: int, factor: float = 1.0) -> tuple[int, float]:
        return first + (t * (d + 1) + k) * d + i, factor

    work = np.zeros((2, len(program.cost)))
    for t in range(len(mesh.cells)):
        for k in range(d + 1):
            for i in range(d):
                work[:, velocity(t, k, i)[0]] += lattice.body[:, i] * volume[t] / (d + 1)

        def rate(i: int, j: int, t: int = t) -> list[tuple[int, float]]:
            return [velocity(t, k, i, 0.5 * gradient[t, k, j]) for k in range(d + 1)] + [
                velocity(t, k, j, 0.5 * gradient[t, k, i]) for k in range(d + 1)
            ]

        _strain(program, lattice, rate, volume[t], d)
    for facet in mesh.facets:
        t, own, _, area, other, theirs, kind, dry = facet
        if kind == "free":
            pulls = _pulls(lattice, mesh, facet)
            # a linear traction on a linear velocity, exactly
            share = (pulls + pulls.sum(axis=1, keepdims=True)) * (area / (d * (d + 1)))
            for corner, k in enumerate(own):
                for i in range(d):
                    work[:, velocity(t, k, i)[0]] += share[:, corner, i]
            continue
        for corner, k in enumerate(own):
            jump = [
                [velocity(t, k, i, -1.0), *([velocity(other, theirs[corner], i)] if other >= 0 else [])]
                for i in range(d)
            ]
            _jump(program, lattice, jump, facet[2], area / d, dry)
    program.equal.add([(k, float(v)) for k, v in enumerate(work[1]) if v], 1.0)
    for k, value in enumerate(work[0]):
        program.cost[k] -= float(value)
    return _value(*program.solve(), 1.0, -math.inf)


def _multipliers(program: _Program, lattice: Lattice, size: float) -> list[int]:
    """Return the unknowns y ≥ 0 of the yield lines, which cost a y times a size."""
    found = []
    for a, _ in lattice.lines:
        found.append(program.unknowns(1, a * size))
        program.least.add([(found[-1], -1.0)])
    return found


def _strain(
    program: _Program, lattice: Lattice, rate: Callable[[int, int], list[tuple[int, float]]], size: float, d: int
) -> None:
    """Add the dissipation of strain rates in one simplex."""
    y = _multipliers(program, lattice, size)
    trace = [term for i in range(d) for term in rate(i, i)]
    slopes = [b for _, b in lattice.lines]
    if d == 2:
        program.equal.add([*trace, *((k, b) for k, b in zip(y, slopes, strict=True))])
        spread = [*rate(0, 0), *((c, -v) for c, v in rate(1, 1))]
        twice = [(c, 2.0 * v) for c, v in rate(0, 1)]
        program.cone([([(k, 1.0) for k in y], 0.0), (spread, 0.0), (twice, 0.0)])
        return
    stretch = program.unknowns(6)
    place = {pair: stretch + k for k, pair in enumerate(_PSD)}
    program.semidefinite({pair: [(place[pair], 1.0)] for pair in _PSD})
    program.semidefinite({(i, j): [(place[i, j], 1.0), *((c, -v) for c, v in rate(i, j))] for i, j in _PSD})
    heads = [(place[i, i], 1.0) for i in range(3)]
    program.equal.add([*heads, *((k, -0.5 * (1.0 - b)) for k, b in zip(y, slopes, strict=True))])
    program.equal.add(
        [*heads, *((c, -v) for c, v in trace), *((k, -0.5 * (1.0 + b)) for k, b in zip(y, slopes, strict=True))]
    )


def _jump(
    program: _Program, lattice: Lattice, jump: list[list[tuple[int, float]]], normal: Array, size: float, dry: bool
) -> None:
    """Add the dissipation of a velocity jump at one corner of a facet."""
    opening = _along(jump, normal)
    if not dry:
        y = _multipliers(program, lattice, size)
        program.equal.add([*opening, *((k, b) for k, (_, b) in zip(y, lattice.lines, strict=True))])
        program.cone([([(k, 1.0) for k in y], 0.0), *((terms, 0.0) for terms in jump)])
        return
    slip = program.unknowns(1, lattice.cohesion * size)
    program.cone([([(slip, 1.0)], 0.0), *((_along(jump, axis), 0.0) for axis in _tangents(normal))])
    closing = [(slip, lattice.friction), *((c, -v) for c, v in opening)]
    if math.isfinite(lattice.crushing):
        crush = program.unknowns(1, lattice.crushing * size)
        program.least.add([(crush, -1.0)])
        closing.append((crush, -1.0))
    program.least.add(closing)
