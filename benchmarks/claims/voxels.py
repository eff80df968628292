"""Random assemblies of merged cells, whose contacts are known from the grid: solids of voxels, and planar polygons."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jld_core.arrays import Floats, Ints

Cell = tuple[int, ...]


@dataclass(frozen=True)
class Known:
    """Contact of two elements as the grid has it.

    a, b: labels of the elements; the normal points from a to b. normal: unit normal. rectangles: corners in order of
    the squares that make up the contact.
    """

    a: int
    b: int
    normal: Floats
    rectangles: Floats


def neighbours(cell: Cell) -> Iterator[Cell]:
    """Yield the cells that share a face with a cell."""
    for axis, step in itertools.product(range(len(cell)), (-1, 1)):
        yield (*cell[:axis], cell[axis] + step, *cell[axis + 1 :])


def connected(cells: set[Cell]) -> list[set[Cell]]:
    """Return the parts of a set of cells that hang together by faces, in order of their least cells."""
    left, parts = set(cells), []
    for start in sorted(cells):
        if start not in left:
            continue
        left.discard(start)
        part, front = {start}, [start]
        while front:
            new = [cell for cell in neighbours(front.pop()) if cell in left]
            left.difference_update(new)
            part.update(new)
            front += new
        parts.append(part)
    return parts


def grown(rng: np.random.Generator, shape: tuple[int, ...], first: set[Cell], count: int) -> Ints:
    """Return labels of the cells of a grid: 1 the support, from 2 on free elements, 0 nothing.

    The last axis points up and its lowest layer is the support. first: cells of the first free element; the others
    grow at random. Elements without a path of faces to the support are left out.
    """
    labels = np.zeros(shape, dtype=np.int64)
    labels[..., 0] = 1
    for cell in first:
        labels[cell] = 2
    for label in range(3 if first else 2, count + 2):
        free = np.argwhere(labels == 0)
        if not len(free):
            break
        element = [tuple(free[rng.integers(len(free))].tolist())]
        for _ in range(int(rng.integers(1, 9))):
            labels[element[-1]] = label
            inside = [c for cell in element for c in neighbours(cell) if _within(c, shape)]
            open_cells = sorted({cell for cell in inside if labels[cell] == 0})
            if not open_cells:
                break
            element.append(open_cells[rng.integers(len(open_cells))])
    reached, cells = {1}, [tuple(cell) for cell in np.argwhere(labels > 0).tolist()]
    touching = {(labels[c], labels[n]) for c in cells for n in neighbours(c) if n in set(cells)}
    for _ in range(count):
        reached |= {b for a, b in touching if a in reached}
    labels[~np.isin(labels, sorted(reached))] = 0
    return labels


def _within(cell: Cell, shape: tuple[int, ...]) -> bool:
    return all(0 <= place < count for place, count in zip(cell, shape, strict=True))


def with_hole(rng: np.random.Generator, shape: tuple[int, ...]) -> set[Cell]:
    """Return the cells of a ring, a U, an L or a T on the support of a grid of at least 3 × 3 cells."""
    across, along = (int(rng.integers(3, n + 1)) for n in shape[:2])
    frame = {(i, j) for i in range(across) for j in range(along)}
    inner = {(i, j) for i in range(1, across - 1) for j in range(1, along - 1)}
    kind = rng.integers(4)
    if kind == 1:
        inner |= {(0, j) for j in range(1, along - 1)}
    elif kind == 2:
        inner = {(i, j) for i in range(1, across) for j in range(1, along)}
    elif kind == 3:
        inner = {(i, j) for i, j in frame if i != 1 and j > 0}
    height = int(rng.integers(2, max(3, shape[2])))
    return {(i, j, k) for i, j in frame - inner for k in range(1, height)}


def known_contacts(labels: Ints, lines: Sequence[Floats]) -> list[Known]:
    """Return the contacts of merged voxels: parts of common planes that hang together by edges."""
    faces: dict[tuple[int, int, int, int], set[Cell]] = {}
    for axis in range(3):
        ahead, behind = np.moveaxis(labels, axis, 0)[1:], np.moveaxis(labels, axis, 0)[:-1]
        for place in np.argwhere((ahead != behind) & (ahead > 0) & (behind > 0)).tolist():
            level, cell = place[0] + 1, tuple(place[1:])
            faces.setdefault((int(behind[tuple(place)]), int(ahead[tuple(place)]), axis, level), set()).add(cell)
    found = []
    for (a, b, axis, level), cells in sorted(faces.items()):
        for part in connected(cells):
            found.append(Known(a, b, np.eye(3)[axis], np.array([_square(c, axis, level, lines) for c in sorted(part)])))
    return found


def _square(cell: Cell, axis: int, level: int, lines: Sequence[Floats]) -> Floats:
    """Corners (4, 3) of the square between four nodes of a grid, counter-clockwise about its axis."""
    one, two = (axis + 1) % 3, (axis + 2) % 3
    first = sorted((one, two))
    place = {first[0]: cell[0], first[1]: cell[1]}
    corners = np.empty((4, 3))
    for row, (u, v) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
        corners[row, axis] = lines[axis][level]
        corners[row, one] = lines[one][place[one] + u]
        corners[row, two] = lines[two][place[two] + v]
    return corners


def solid(rng: np.random.Generator, labels: Ints, label: int, lines: Sequence[Floats]) -> dict[str, Any]:
    """Return vertices and faces of merged voxels: as squares, as triangles, or as whole faces with bridges to holes."""
    style = rng.integers(3)
    faces: list[list[Cell]] = []
    for axis, side in itertools.product(range(3), (0, 1)):
        open_cells: dict[int, set[Cell]] = {}
        for cell in [tuple(c) for c in np.argwhere(labels == label).tolist()]:
            beside = (*cell[:axis], cell[axis] + 2 * side - 1, *cell[axis + 1 :])
            inside = 0 <= beside[axis] < labels.shape[axis] and labels[beside] == label
            if not inside:
                flat = (*cell[:axis], *cell[axis + 1 :])
                open_cells.setdefault(cell[axis] + side, set()).add(flat)
        for level, cells in open_cells.items():
            for part in connected(cells):
                faces += _faces_of(part, axis, level, side, whole=bool(style == 2))
    if style == 2:
        faces = _without_idle(faces)
    if style == 1:
        faces = [[f[0], f[k], f[k + 1]] for f in faces for k in (1, 2)]
    return _shuffled(rng, faces, lines)


def _faces_of(cells: set[Cell], axis: int, level: int, side: int, *, whole: bool) -> list[list[Cell]]:
    """Outward loops of grid nodes around squares of one plane, one for each square or one for all."""
    edges: dict[Cell, list[Cell]] = {}
    loops: list[list[Cell]] = []
    for i, j in sorted(cells):
        ring: list[Cell] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        loops.append(ring)
        for k, (di, dj) in enumerate(((0, -1), (1, 0), (0, 1), (-1, 0))):
            if (i + di, j + dj) not in cells:
                edges.setdefault(ring[k], []).append(ring[(k + 1) % 4])
    if whole:
        loops = [_bridged(_traced(edges))]
    # the axes left over, in order, are right-handed about the plane's own axis, save for the middle one
    turned = (side == 0) != (axis == 1)
    placed = [[(*node[:axis], level, *node[axis:]) for node in loop] for loop in loops]
    return [loop[::-1] if turned else loop for loop in placed]


def _traced(edges: dict[Cell, list[Cell]]) -> list[list[Cell]]:
    """Loops of directed edges with the area on the left; where two meet, each stays with its own square."""
    loops = []
    while edges:
        start = min(edges)
        loop, here, came = [start], edges[start][0], start
        _take(edges, start, here)
        while here != start or len(loop) < 3:
            loop.append(here)
            way = (here[0] - came[0], here[1] - came[1])
            left = (here[0] - way[1], here[1] + way[0])
            following = left if left in edges[here] else edges[here][0]
            _take(edges, here, following)
            came, here = here, following
        loops.append(loop)
    return loops


def _take(edges: dict[Cell, list[Cell]], start: Cell, end: Cell) -> None:
    edges[start].remove(end)
    if not edges[start]:
        del edges[start]


def _bridged(loops: list[list[Cell]]) -> list[Cell]:
    """One loop of several, joined by bridges between their nearest nodes."""

    def area(loop: list[Cell]) -> float:
        return 0.5 * sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(loop, loop[1:] + loop[:1], strict=True))

    whole, *holes = sorted(loops, key=area, reverse=True)
    while holes:
        _, number, i, j = min(
            (abs(p[0] - q[0]) + abs(p[1] - q[1]), number, i, j)
            for number, hole in enumerate(holes)
            for i, p in enumerate(whole)
            for j, q in enumerate(hole)
        )
        hole = holes.pop(number)
        around = [*hole[j:], *hole[: j + 1]]
        bridge = whole[i:] if whole[i] != hole[j] else whole[i + 1 :]
        whole = [*whole[: i + 1], *(around if whole[i] != hole[j] else around[1:]), *bridge]
    return whole


def _without_idle(faces: list[list[Cell]]) -> list[list[Cell]]:
    """Faces without nodes that are a corner of no face."""
    used: set[Cell] = set()
    for face in faces:
        nodes = np.array(face)
        before, after = nodes - np.roll(nodes, 1, axis=0), np.roll(nodes, -1, axis=0) - nodes
        bent = np.any(np.cross(before, after) != 0, axis=1) | (np.einsum("ij,ij->i", before, after) < 0)
        used.update(node for node, corner in zip(face, bent.tolist(), strict=True) if corner)
    return [[node for node in face if node in used] for face in faces]


def _shuffled(rng: np.random.Generator, faces: list[list[Cell]], lines: Sequence[Floats]) -> dict[str, Any]:
    """Vertices and faces in any order; each face begins anywhere, and all may be turned over."""
    nodes = sorted({node for face in faces for node in face})
    order = rng.permutation(len(nodes))
    number = {nodes[k]: int(place) for place, k in enumerate(order)}
    loops = [[number[node] for node in face] for face in faces]
    starts = [int(rng.integers(len(loop))) for loop in loops]
    loops = [[*loop[start:], *loop[:start]] for loop, start in zip(loops, starts, strict=True)]
    if rng.random() < 0.5:
        loops = [loop[::-1] for loop in loops]
    loops = [loops[k] for k in rng.permutation(len(loops))]
    vertices = [[float(lines[axis][nodes[k][axis]]) for axis in range(3)] for k in order]
    return {"vertices": vertices, "faces": loops}


def outline(labels: Ints, label: int) -> list[Cell] | None:
    """Return the nodes around a planar element, counter-clockwise; None where it has a hole or touches itself."""
    cells = {tuple(cell) for cell in np.argwhere(labels == label).tolist()}
    edges: dict[Cell, list[Cell]] = {}
    for i, j in cells:
        ring: list[Cell] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        for k, (di, dj) in enumerate(((0, -1), (1, 0), (0, 1), (-1, 0))):
            if (i + di, j + dj) not in cells:
                edges.setdefault(ring[k], []).append(ring[(k + 1) % 4])
    loops = _traced(edges)
    return loops[0] if len(loops) == 1 and len(set(loops[0])) == len(loops[0]) else None
