"""Random cases of contacts, steps of assembly, and derivatives by vertices."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from scipy.spatial import ConvexHull, cKDTree

from benchmarks.claims import Tally
from benchmarks.scenes import stones
from jld_core import Assembly, InputError, Status, build_assembly, geometry_sensitivities, parse_scene, samples, solve
from jld_core.arrays import Floats, Ints
from jld_core.mechanics import scaling_of, yield_set
from jld_core.strengths import Route
from jld_geometry import MovedScene, vertex_mesh
from jld_practice.laying import assembly_order

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
            left = {tuple(cell) for cell in np.argwhere(labels == 0).tolist()}
            open_cells = sorted(left & {beside for cell in element for beside in neighbours(cell)})
            if not open_cells:
                break
            element.append(open_cells[rng.integers(len(open_cells))])
    reached, cells = {1}, [tuple(cell) for cell in np.argwhere(labels > 0).tolist()]
    touching = {(labels[c], labels[n]) for c in cells for n in neighbours(c) if n in set(cells)}
    for _ in range(count):
        reached |= {b for a, b in touching if a in reached}
    labels[~np.isin(labels, sorted(reached))] = 0
    return labels


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
    corners = np.full((4, 3), lines[axis][level])
    for row, (u, v) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
        corners[row, [one, two]] = lines[one][place[one] + u], lines[two][place[two] + v]
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
    loops = [_bridged(_traced(_edges(cells)))] if whole else [_ring(cell) for cell in sorted(cells)]
    # the axes left over, in order, are right-handed about the plane's own axis, save for the middle one
    turned = (side == 0) != (axis == 1)
    placed = [[(*node[:axis], level, *node[axis:]) for node in loop] for loop in loops]
    return [loop[::-1] if turned else loop for loop in placed]


def _ring(cell: Cell) -> list[Cell]:
    i, j = cell
    return [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]


def _edges(cells: set[Cell]) -> dict[Cell, list[Cell]]:
    """Ends of the directed edges around squares, by their beginnings; the squares lie on the left."""
    edges: dict[Cell, list[Cell]] = {}
    for i, j in sorted(cells):
        ring = _ring((i, j))
        for k, (di, dj) in enumerate(((0, -1), (1, 0), (0, 1), (-1, 0))):
            if (i + di, j + dj) not in cells:
                edges.setdefault(ring[k], []).append(ring[(k + 1) % 4])
    return edges


def _traced(edges: dict[Cell, list[Cell]]) -> list[list[Cell]]:
    loops = []
    while edges:
        start = min(edges)
        loop, came, here = [start], start, edges[start][0]
        edges[start].remove(here)
        while here != start or len(loop) < 3:
            loop.append(here)
            left = (here[0] - here[1] + came[1], here[1] + here[0] - came[0])
            following = left if left in edges[here] else edges[here][0]
            edges[here].remove(following)
            came, here = here, following
        loops.append(loop)
        edges = {node: ends for node, ends in edges.items() if ends}
    return loops


def _bridged(loops: list[list[Cell]]) -> list[Cell]:
    def area(loop: list[Cell]) -> float:
        return 0.5 * sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(loop, loop[1:] + loop[:1], strict=True))

    whole, *holes = sorted(loops, key=area, reverse=True)
    while holes:
        nodes = [(number, j, q) for number, hole in enumerate(holes) for j, q in enumerate(hole)]
        pairs = itertools.product(enumerate(whole), nodes)
        _, number, i, j = min((abs(p[0] - q[0]) + abs(p[1] - q[1]), n, i, j) for (i, p), (n, j, q) in pairs)
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
    loops = _traced(_edges({tuple(cell) for cell in np.argwhere(labels == label).tolist()}))
    return loops[0] if len(loops) == 1 and len(set(loops[0])) == len(loops[0]) else None


EXACT: Final = 1e-9  # relative difference of lengths, areas and moments that counts as a disagreement
_SOLVED: Final = 20  # one case in so many is solved, in both positions
_PLANAR: Final = 4  # one case in so many is planar
_DIRECTIONS: Final = 24  # in which hulls and kerns are compared


@dataclass(frozen=True)
class Move:
    """Similarity x → scale · turn · x + shift, mirrored where the determinant of turn is −1."""

    turn: Floats
    scale: float
    shift: Floats

    def points(self, places: Floats) -> Floats:
        return np.asarray(self.scale * places @ self.turn.T + self.shift)


def case_geometry(seed: int, tally: Tally) -> str:
    """Return "" where one random assembly has the contacts, sections and λ of its grid, else what differs.

    Merged voxels and merged cells of planar grids, turned, mirrored, scaled, moved and shuffled, against contacts
    counted on the grid. Areas, centroids, second moments and torsion lengths are sums over the squares of the grid in
    closed form, hulls and kerns those of their corners.
    """
    rng = np.random.default_rng([seed, 1915])
    try:
        drawn_case = (_planar_case if seed % _PLANAR == 0 else _spatial_case)(rng)
        if drawn_case is None:
            tally.count("nothing stands")
            return ""
        names, plain, moved, known, compare = drawn_case
        for where, elements in (("straight", plain), ("moved", moved)):
            problem = compare(build_assembly(parse_scene(document(*elements))), elements[1])
            if problem:
                return f"{where}: {problem}"
        tally.count("contacts", known)
        return "" if (seed // 2) % _SOLVED else _compare_loads(plain, moved, names, rng, tally)
    except InputError as error:
        return f"refused: {error}"


Placed = tuple[list[dict[str, Any]], Move]  # elements, and how they were moved
# labels of elements; these as drawn and moved; number of contacts; and what compares these with an assembly
Drawn = tuple[list[int], Placed, Placed, int, Callable[[Assembly, Move], str]]


def random_move(rng: np.random.Generator, dimension: int) -> Move:
    """Draw a rotation, in half of all cases mirrored, a scale of 1e-3 to 1e3 and a shift of up to 1e3 sizes."""
    turn = np.linalg.qr(rng.normal(size=(dimension, dimension)))[0]
    scale = 10.0 ** rng.uniform(-3.0, 3.0)
    return Move(turn, scale, scale * 10.0 ** rng.uniform(-1.0, 3.0) * rng.normal(size=dimension))


def document(elements: list[dict[str, Any]], move: Move, **keys: Any) -> dict[str, Any]:
    """Return a scene of elements under a body load, all of it moved; strengths grow with the scale."""
    planar, weight = len(move.shift) == 2, 1000.0 * 9.81 * move.scale
    down = np.array([0.0, -9.81]) if planar else np.array([0.0, 0.0, -9.81])
    live = np.array([1.0, 0.1]) if planar else np.array([0.6, 0.8, 0.1])
    inner = {"tensile_strength": 0.8 * weight, "shear_strength": 1.1 * weight}
    body, gravity = (move.turn @ live).tolist(), (move.turn @ down).tolist()
    found = stones(elements, [{"body": body}], 0.6, inner, density=1000.0, gravity=gravity)
    return found | ({"thickness": move.scale} if planar else {}) | keys


def _spatial_case(rng: np.random.Generator) -> Drawn | None:
    shape = (int(rng.integers(3, 5)), int(rng.integers(3, 5)), int(rng.integers(2, 5)))
    lines = [np.concatenate([[0.0], np.cumsum(rng.uniform(0.3, 1.5, count))]) for count in shape]
    first = with_hole(rng, shape) if shape[2] > 2 and rng.random() < 0.5 else set()
    labels = grown(rng, shape, first, int(rng.integers(1, 6)))
    names = _labels(labels)
    if len(names) < 2:
        return None
    plain = [{"id": f"e{n}", "support": n == 1, **solid(rng, labels, n, lines)} for n in names]
    known = known_contacts(labels, lines)
    move = random_move(rng, 3)
    again = [{"id": f"e{n}", "support": n == 1, **solid(rng, labels, n, lines)} for n in names]
    moved = [{**e, "vertices": move.points(np.array(e["vertices"])).tolist()} for e in again]
    moved = [moved[k] for k in rng.permutation(len(moved))]
    still = Move(np.eye(3), 1.0, np.zeros(3))
    return names, (plain, still), (moved, move), len(known), lambda built, at: _compare(built, known, at, rng)


def _labels(labels: Ints) -> list[int]:
    return [label for label in np.unique(labels).tolist() if label > 0]


def _compare(built: Assembly, known: list[Known], move: Move, rng: np.random.Generator) -> str:
    pairs = _pairs(built)
    if len(pairs) != len(known):
        return f"{len(pairs)} interfaces, expected {len(known)}"
    left = set(range(len(pairs)))
    for contact in known:
        section = _Section.of(contact, move)
        couple = {f"e{contact.a}", f"e{contact.b}"}
        face = _nearest(pairs, left, couple, built.interfaces.origin, section.centroid)
        if face is None:
            return f"no interface left for {couple}"
        sign = 1.0 if pairs[face][0] == f"e{contact.a}" else -1.0
        problem = _differences_geometry(built, face, section, sign, rng)
        if problem:
            return f"interface {pairs[face]}: {problem}"
    return ""


@dataclass(frozen=True)
class _Section:
    """Plane section as sums over rectangles: normal, corners (n, 3), area, centroid, moments (3, 3), c_T, sides."""

    normal: Floats
    corners: Floats
    area: float
    centroid: Floats
    moments: Floats
    torsion: float
    sides: tuple[float, float] | None

    @classmethod
    def of(cls, contact: Known, move: Move) -> _Section:
        """Sections of a contact after a move; integrals are taken before it, where sides follow the axes."""
        squares = contact.rectangles
        one, two = (axis for axis in range(3) if not contact.normal[axis])
        low, high = squares.min(axis=1)[:, [one, two]], squares.max(axis=1)[:, [one, two]]
        size, middle = high - low, 0.5 * (low + high)
        part = size.prod(axis=1)
        area = float(part.sum())
        centre = part @ middle / area
        own = np.array([np.diag(p * s * s / 12.0) for p, s in zip(part, size, strict=True)])
        arm = middle - centre
        tensor = (own + part[:, None, None] * arm[:, :, None] * arm[:, None, :]).sum(axis=0)
        whole = np.zeros((3, 3))
        whole[np.ix_((one, two), (one, two))] = tensor
        place = squares[0, 0].copy()
        place[[one, two]] = centre
        radial = sum(_radial(a - centre, b - centre) for a, b in zip(low, high, strict=True))
        extent = high.max(axis=0) - low.min(axis=0)
        filled = abs(area - extent.prod()) <= 1e-12 * area
        scale = move.scale
        corners, moments = move.points(squares.reshape(-1, 3)), move.turn @ whole @ move.turn.T * scale**4
        sides = (float(extent.min()) * scale, float(extent.max()) * scale) if filled else None
        normal, torsion = move.turn @ contact.normal, radial / area * scale
        return cls(normal, corners, area * scale**2, move.points(place), moments, torsion, sides)


def _radial(low: Floats, high: Floats) -> float:
    """∫ r dA over a rectangle between two corners; r about the origin."""

    def quarter(x: float, y: float) -> float:
        r = float(np.hypot(x, y))
        third = x**3 * np.arcsinh(y / abs(x)) if x else 0.0
        other = y**3 * np.arcsinh(x / abs(y)) if y else 0.0
        return float(2.0 * x * y * r + third + other) / 6.0

    (x0, y0), (x1, y1) = low.tolist(), high.tolist()
    return quarter(x1, y1) - quarter(x0, y1) - quarter(x1, y0) + quarter(x0, y0)


def _differences_geometry(built: Assembly, face: int, section: _Section, sign: float, rng: np.random.Generator) -> str:
    faces = built.interfaces
    size = float(np.ptp(section.corners, axis=0).max())
    # what coordinates far from the origin cannot say better
    grain = 1e-14 * float(abs(section.corners).max()) / size
    allowed = max(EXACT, 100.0 * grain)
    checks: list[tuple[str, Any, Any, float]] = [
        ("area", faces.area[face], section.area, section.area),
        ("centroid", faces.origin[face], section.centroid, size),
        ("normal", sign * faces.normal[face], section.normal, 1.0),
        ("torsion length", faces.c_t[face], section.torsion, section.torsion),
    ]
    ways = rng.normal(size=(_DIRECTIONS, 3))
    ways -= np.outer(ways @ section.normal, section.normal)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    arm = section.corners - section.centroid
    most = (ways @ arm.T).max(axis=1)
    polygon = faces.polygon[face] - section.centroid
    checks.append(("hull", (ways @ polygon.T).max(axis=1), most, size))
    if section.sides is not None:
        checks.append(("sides", np.sort([faces.l1[face], faces.l2[face]]), np.array(section.sides), size))
    if bool(faces.rectangle[face]) != (section.sides is not None):
        return f"rectangle is {bool(faces.rectangle[face])}"
    hull, kern = _bending(built, face, ways, section)
    checks += [("bending of dry faces", *hull, 1.0), ("bending of inner faces", *kern, 1.0)]
    for name, found, expected, unit in checks:
        off = float(np.max(np.abs(np.asarray(found) - np.asarray(expected)))) / unit
        if not off <= allowed:
            return f"{name} differs by {off:.2g}"
    return ""


def _bending(
    built: Assembly, face: int, ways: Floats, section: _Section
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Greatest N that a unit moment about each direction (k, 3) needs on a dry and on an inner face, over its scale.

    The program's rows against the corners of the grid: N ≥ M × n · a / d on the hull of a dry face, and
    N ≥ −A x·S⁻¹(n × M) at all corners x of an inner one, docs/method.md (2.3) and (2.6).
    """
    faces = built.interfaces
    if section.sides is not None:
        none = np.zeros(1)
        return (none, none), (none, none)
    bending = yield_set(built, scaling_of(built), "kern").bending  # type: ignore[attr-defined]
    rows = slice(int(bending.start[face]), int(bending.start[face + 1]))
    frame = np.array([faces.e1[face] / (0.5 * faces.l2[face]), faces.e2[face] / (0.5 * faces.l1[face])])
    moments = ways @ frame.T
    dry, inner = (np.max(moments @ table[rows].T, axis=1) for table in (bending.dry, bending.inner))
    # n × M, with n of the program: what presses at x = (n × M) / N
    towards = np.cross(faces.normal[face], ways)
    arm = section.corners - section.centroid
    plane = np.array([faces.e1[face], faces.e2[face]])
    flat, way = arm @ plane.T, towards @ plane.T
    tensor = plane @ section.moments @ plane.T
    kern = (-section.area * flat @ np.linalg.solve(tensor, way.T)).max(axis=0)
    # 1 / N: how far the hull reaches from the centroid along n × M
    reach = np.array([_reach(flat, direction) for direction in way])
    return (dry * reach, np.ones(len(reach))), (inner / kern, np.ones(len(kern)))


def _reach(points: Floats, way: Floats) -> float:
    """How far the convex hull of points (n, 2) reaches from the origin along a unit direction."""
    planes = ConvexHull(points).equations
    along = planes[:, :2] @ way
    return float(np.min(-planes[along > 1e-12, 2] / along[along > 1e-12]))


def _planar_case(rng: np.random.Generator) -> Drawn | None:
    labels, nodes, straight = planar_grid(rng)
    names = _labels(labels)
    if len(names) < 2:
        return None
    known = _planar_contacts(labels, nodes, straight=straight)
    move, still = random_move(rng, 2), Move(np.eye(2), 1.0, np.zeros(2))
    plain, moved = (
        [polygon_entry(rng, labels, n, nodes, position, straight) for n in names] for position in (still, move)
    )
    moved = [moved[k] for k in rng.permutation(len(moved))]
    return names, (plain, still), (moved, move), len(known), lambda built, at: _compare_planar(built, known, at)


def planar_grid(rng: np.random.Generator) -> tuple[Ints, Floats, bool]:
    """Draw labels (p, q) of the cells of a planar grid, its nodes, and whether its lines are straight.

    nodes: (p + 1, q + 1, 2). Elements have no holes and do not touch themselves.
    """
    shape = (int(rng.integers(3, 7)), int(rng.integers(3, 6)))
    labels = grown(rng, shape, set(), int(rng.integers(2, 9)))
    for label in np.unique(labels[labels > 1]).tolist():
        if outline(labels, label) is None:  # with a hole: its cells, one by one
            for cell in np.argwhere(labels == label)[1:].tolist():
                labels[tuple(cell)] = labels.max() + 1
    nodes = np.stack(np.meshgrid(*(np.arange(n + 1.0) for n in shape), indexing="ij"), axis=-1)
    straight = bool(rng.random() < 0.5)
    if straight:
        nodes = nodes @ (np.eye(2) + rng.uniform(-0.3, 0.3, (2, 2)))
    else:
        nodes = nodes + rng.uniform(-0.15, 0.15, nodes.shape)
    return labels, nodes, straight


def polygon_entry(
    rng: np.random.Generator, labels: Ints, label: int, nodes: Floats, move: Move, straight: bool
) -> dict[str, Any]:
    """Entry of a planar element: it begins anywhere, goes round either way, and has some corners in straight edges."""
    ring = outline(labels, label)
    assert ring is not None
    steps = np.diff(np.array([*ring, ring[0]]), axis=0)
    idle = np.all(steps == np.roll(steps, 1, axis=0), axis=1) if straight else np.zeros(len(ring), dtype=bool)
    kept = ~idle | (rng.random(len(ring)) < 0.3)
    places = move.points(nodes[tuple(np.array(ring)[kept].T)])
    places = np.roll(places, int(rng.integers(len(places))), axis=0)
    return {"id": f"e{label}", "support": label == 1, "polygon": places[:: rng.choice([1, -1])].tolist()}


def _planar_contacts(labels: Ints, nodes: Floats, *, straight: bool) -> list[tuple[int, int, Floats]]:
    """(a, b, ends (2, 2)) of each contact, a below or left of b: runs of shared edges where these are straight."""
    found: list[tuple[int, int, Floats]] = []
    for axis in (0, 1):
        turned, place = (labels, nodes) if axis == 0 else (labels.T, nodes.transpose(1, 0, 2))
        for i in range(turned.shape[0] - 1):
            pairs = [(int(turned[i, j]), int(turned[i + 1, j])) for j in range(turned.shape[1])]
            for (a, b), run_ in itertools.groupby(range(len(pairs)), key=lambda j, pairs=pairs: pairs[j]):  # type: ignore[misc]
                places = list(run_)
                if a == b or a == 0 or b == 0:
                    continue
                runs = [places] if straight else [[j] for j in places]
                found += [(a, b, np.array([place[i + 1, j[0]], place[i + 1, j[-1] + 1]])) for j in runs]
    return found


def _compare_planar(built: Assembly, known: Sequence[tuple[int, int, Floats]], move: Move) -> str:
    faces, pairs = built.interfaces, _pairs(built)
    if len(pairs) != len(known):
        return f"{len(pairs)} interfaces, expected {len(known)}"
    left = set(range(len(pairs)))
    for a, b, places in known:
        ends = move.points(places)
        face = _nearest(pairs, left, {f"e{a}", f"e{b}"}, faces.origin, ends.mean(axis=0))
        if face is None:
            return f"no interface left for e{a} and e{b}"
        length = float(np.hypot(*(ends[1] - ends[0])))
        allowed = max(EXACT, 1e-12 * float(abs(ends).max()) / length)
        away = float(np.linalg.norm(faces.origin[face] - ends.mean(axis=0)))
        turned = abs(float(faces.normal[face] @ (ends[1] - ends[0])))
        off = max(abs(faces.l1[face] - length), away, turned) / length
        if not off <= allowed:
            return f"interface {pairs[face]} differs by {off:.2g}"
    return ""


def _compare_loads(one: Placed, other: Placed, names: list[int], rng: np.random.Generator, tally: Tally) -> str:
    """Return where λ of two positions differs: all faces dry, and some of them inner."""
    glued = [list(pair) for pair in itertools.combinations([f"e{n}" for n in names], 2) if rng.random() < 0.4]
    built = build_assembly(parse_scene(document(*one)))
    touching = {frozenset(pair) for pair in _pairs(built)}
    glued = [pair for pair in glued if frozenset(pair) in touching]
    for labels in ({"default": "dry"}, {"default": "dry", "inner": glued}):
        results = [solve(build_assembly(parse_scene(document(*each, labels=labels)))) for each in (one, other)]
        statuses = {result.status for result in results}
        if Status.UNCERTIFIED in statuses:
            tally.count("uncertified")
            continue
        if len(statuses) > 1:
            return f"status {results[0].status} and {results[1].status}"
        tally.count("solved")
        if results[0].status is not Status.COLLAPSE:
            continue
        (low, high), (least, greatest) = (result.bracket for result in results)
        slack = EXACT * max(1e-3, abs(high))
        if max(low, least) > min(high, greatest) + slack:
            return f"λ in [{low:.10g}, {high:.10g}] and in [{least:.10g}, {greatest:.10g}]"
    return ""


def _pairs(built: Assembly) -> list[tuple[str, str]]:
    """Names of both elements of each interface."""
    faces, ids = built.interfaces, built.elements.ids
    return [(ids[a], ids[b]) for a, b in zip(faces.a.tolist(), faces.b.tolist(), strict=True)]


def _nearest(pairs: list[tuple[str, str]], left: set[int], names: set[str], origin: Floats, at: Floats) -> int | None:
    """Take the interface of two elements that lies nearest to a place from those left; None where there is none."""
    mine = [k for k in sorted(left) if set(pairs[k]) == names]
    face = min(mine, key=lambda k: float(np.linalg.norm(origin[k] - at)), default=None)
    left -= {face}
    return face


CUT: Final = 1e-9  # area, relative to the square of the unit of the grid, that a sweep may share with what rests
_FAR: Final = 30.0  # length of a sweep, in units of the grid


def case_laying(seed: int, tally: Tally) -> str:
    """Return "" where no step of the order of one random wall cuts another block, else the first that does."""
    rng = np.random.default_rng([seed, 1994])
    labels, nodes, straight = planar_grid(rng)
    names = _labels(labels)
    if len(names) < 2:
        return ""
    move = Move(random_move(rng, 2).turn, 1.0, np.zeros(2))
    elements = [polygon_entry(rng, labels, name, nodes, move, straight) for name in names]
    try:
        built = build_assembly(parse_scene(document(elements, move)))
    except InputError as error:
        return f"refused: {error}"
    order = assembly_order(built, np.ones(len(built.interfaces), dtype=bool))
    of, shapes = order.blocks.of, [shapely.Polygon(shape) for shape in built.elements.shape]
    resting = set(of[built.elements.support].tolist())
    for number, step in enumerate(order.steps):
        still = [shapes[k] for k in range(len(shapes)) if of[k] in resting]
        moving = [shapes[k] for k in np.flatnonzero(np.isin(of, step.blocks)).tolist()]
        cut = max(_shared(shape, still, _FAR * step.direction) for shape in moving)
        if cut > CUT:
            return f"step {number} of {len(order.steps)} cuts {cut:.2g}"
        resting.update(step.blocks)
    tally.count("steps", len(order.steps))
    return ""


def _shared(shape: shapely.Polygon, still: list[shapely.Polygon], way: np.ndarray) -> float:
    """Largest area that the sweep of a triangle of a polygon along a vector shares with a polygon at rest."""
    most = 0.0
    for part in shapely.get_parts(shapely.constrained_delaunay_triangles(shape)):
        corners = shapely.get_coordinates(part)[:3]
        swept = shapely.convex_hull(shapely.multipoints(np.concatenate([corners, corners + way])))
        most = max(most, *(float(shapely.intersection(swept, other, grid_size=1e-12).area) for other in still))
    return most


ROUTE = Route("a benchmark")
PLANAR: Final = 1e-7  # largest relative difference in the plane
SPATIAL: Final = 1e-6  # largest relative difference in space
Document = dict[str, Any]


def case_vertex_rates(seed: int, tally: Tally) -> str:
    """Hold the derivatives of one scene against differences.

    Random arches, walls and grids with shaken vertices: labels, strengths, cohesion, friction of cracks, stated
    weights, loads at centroids and at fixed places differ, and every seventh crushes. Every fifth scene is a strip of a
    vault in space with leaning joints. All vertices move at once along random directions, by steps of 2e-5 of the size,
    3e-4 where joints crush, in space 1e-3. A case disagrees where the relative difference, over |gradient| |direction|,
    exceeds 1e-7 in the plane or 1e-6 in space. Scenes without collapse, and those whose differences with half the step
    are not alike (a kink lies between), are counted in ``notes``.
    """
    spatial = seed % 5 == 4
    rates, difference, other, size = (_of_strip if spatial else _of_plane)(seed)
    if math.isnan(rates):
        tally.count("no collapse")
        return ""
    allowed = (SPATIAL if spatial else PLANAR) * size
    if abs(difference - other) > allowed:
        tally.count("kink within the steps")
        return ""
    tally.count("smooth in space" if spatial else "smooth in the plane")
    if abs(rates - difference) <= allowed:
        return ""
    return f"derivative {rates:.12g}, difference {difference:.12g}, relative {abs(rates - difference) / size:.2g}"


def drawn(seed: int) -> Document:
    random = np.random.default_rng(seed)
    kind = ("arch", "wall", "grid")[seed % 3]
    options: Document = {}
    if kind == "arch":
        options = {"thickness": float(random.uniform(0.2, 0.35)), "voussoirs": int(random.integers(5, 11))}
        options |= {"rings": int(random.integers(1, 3)), "load": str(random.choice(["push", "quarter"]))}
    elif kind == "wall":
        options = {"length": float(random.uniform(0.8, 1.6)), "courses": int(random.integers(2, 5))}
    scene = samples.KINDS[kind](**options)
    assembly = build_assembly(scene)
    mesh = vertex_mesh(assembly)
    faces = len(assembly.interfaces)
    labels = random.random(faces) < 0.6 if random.random() < 0.6 else np.ones(faces, dtype=bool)
    shift = 0.01 * assembly.size / np.sqrt(len(assembly.elements)) * random.normal(size=mesh.places.shape)
    document = MovedScene(scene, assembly, labels, mesh).document(mesh.places + shift)
    document.pop("search", None)
    weight = float(np.linalg.norm(assembly.elements.weight, axis=1)[assembly.elements.free].sum())
    stress = weight / float(assembly.interfaces.area.mean())
    dry: Document = {"friction_coefficient": float(random.uniform(0.3, 0.9))}
    inner: Document = {"tensile_strength": stress * float(random.uniform(0.05, 0.5))}
    inner["shear_strength"] = stress * float(random.uniform(0.5, 2.0))
    if random.random() < 0.5:
        inner["friction_coefficient"] = 0.3
    if random.random() < 0.5:
        dry["cohesion"] = 0.02 * stress
    if seed % 7 == 0:
        dry["compressive_strength"] = inner["compressive_strength"] = stress * float(random.uniform(3.0, 10.0))
    document["materials"] = {**document["materials"], "dry": dry, "inner": inner}
    element = assembly.elements.ids[int(random.choice(assembly.elements.free))]
    if random.random() < 0.5:
        document["loads"]["live"].append({"element": element, "force": [0.1 * weight, -0.1 * weight]})
    if random.random() < 0.3:
        for entry in document["elements"]:
            if entry["id"] == element:
                entry["weight"] = 0.1 * weight
    return json.loads(json.dumps(document))  # type: ignore[no-any-return]


def _of_plane(seed: int) -> tuple[float, float, float, float]:
    """Return the derivative along a random direction, its difference by two steps, and its scale."""
    scene = parse_scene(drawn(seed))
    assembly = build_assembly(scene)
    result = solve(assembly)
    if result.status is not Status.COLLAPSE:
        return math.nan, math.nan, math.nan, math.nan
    found = geometry_sensitivities(result, one_sided=False)
    assert found is not None
    mesh = vertex_mesh(assembly)
    moved = MovedScene(scene, assembly, assembly.labels, mesh)
    way = np.random.default_rng(seed + 1).normal(size=mesh.places.shape)

    def load_factor(share: float) -> float:
        return solve(build_assembly(moved.at(mesh.places + share * way))).load_factor

    size = float(np.linalg.norm(found.derivative) * np.linalg.norm(way))
    # brackets of scenes that crush are wider, and steps have to be larger for rates to stand out
    step = 3e-4 if np.isfinite(assembly.strengths(ROUTE).crush_dry).any() else 2e-5
    return float((found.derivative * way).sum()), *_differences_vertex_rates(load_factor, step * assembly.size), size


def _differences_vertex_rates(function: Any, step: float) -> tuple[float, float]:
    def difference(by: float) -> float:
        return float((8.0 * (function(by) - function(-by)) - (function(2.0 * by) - function(-2.0 * by))) / (12.0 * by))

    return difference(step), difference(0.5 * step)


def strip(seed: int) -> tuple[Floats, Floats, Document]:
    """Draw the joints (k, 4, 3) of a strip of a vault, directions that keep them plane, and its load."""
    random = np.random.default_rng(seed)
    angles = np.linspace(np.pi, 0.0, 7)
    radii, widths = np.array([0.88, 1.12, 1.12, 0.88]), np.array([0.0, 0.0, 0.4, 0.4])
    joints, ways = np.empty((7, 4, 3)), np.empty((7, 4, 3))
    for k, angle in enumerate(angles):
        along = np.array([np.sin(angle), 0.0, -np.cos(angle)])
        corners = np.column_stack([radii * np.cos(angle), widths, radii * np.sin(angle)])
        plane = np.column_stack([np.ones(4), radii - 1.0, widths - 0.2])
        joints[k] = corners + (plane @ (random.normal(size=3) * [0.02, 0.1, 0.1]))[:, None] * along
        ways[k] = (plane @ (random.normal(size=3) * [0.1, 1.0, 1.0]))[:, None] * along
    live = [{"body": [0.5, 0.4, 0.0]}] if seed % 2 else [{"element": "v1", "force": [0.3, 0.2, -1.0]}]
    return joints, ways, {"live": live}


def strip_scene(joints: Floats, loads: Document, cohesion: float = 0.0) -> Assembly:
    """Build the strip between joints (k, 4, 3) as solids with triangular sides."""
    down = np.array([0.0, 0.0, -0.3])
    sections = [joints[0] + down, *joints, joints[-1] + down]
    names = ["left", *(f"v{k}" for k in range(len(joints) - 1)), "right"]
    sides = [face for i in range(4) for j in [(i + 1) % 4] for face in ([i, j, j + 4], [i, j + 4, i + 4])]
    faces = [[3, 2, 1, 0], [4, 5, 6, 7], *sides]
    elements = []
    for name, first, last in zip(names, sections[:-1], sections[1:], strict=True):
        corners = np.vstack([first, last])
        volume = sum(
            float(corners[f[0]] @ np.cross(corners[a], corners[b])) for f in faces for a, b in itertools.pairwise(f[1:])
        )
        own = faces if volume > 0.0 else [face[::-1] for face in faces]
        support = name in ("left", "right")
        elements.append({"id": name, "vertices": corners.tolist(), "faces": own, "support": support})
    interfaces = [{"elements": [names[k], names[k + 1]], "polygon": joint.tolist()} for k, joint in enumerate(joints)]
    dry = {"friction_coefficient": 0.6, "cohesion": cohesion}
    document = {"elements": elements, "interfaces": interfaces, "loads": loads}
    return build_assembly(parse_scene({**document, "materials": {"density": 2000, "dry": dry}}))


def _of_strip(seed: int) -> tuple[float, float, float, float]:
    """Return the derivative of a strip along plane motions of its joints, its differences, and its scale."""
    joints, ways, loads = strip(seed)
    cohesion = 300.0 if seed % 3 == 0 else 0.0
    result = solve(strip_scene(joints, loads, cohesion))
    if result.status is not Status.COLLAPSE:
        return math.nan, math.nan, math.nan, math.nan
    found = geometry_sensitivities(result)
    assert found is not None
    vertices = cKDTree(found.vertices).query(joints.reshape(-1, 3))[1]
    way = ways.reshape(-1, 3)

    def load_factor(share: float) -> float:
        return solve(strip_scene(joints + share * ways, loads, cohesion)).load_factor

    size = float(np.linalg.norm(found.derivative) * np.linalg.norm(way))
    return float((found.derivative[vertices] * way).sum()), *_differences_vertex_rates(load_factor, 1e-3), size
