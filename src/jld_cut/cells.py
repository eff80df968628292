"""Cells of a solid by plane cuts, the joints between them, and convex pieces of cells."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Floats, Ints, checkpoint
from jld_cut.meshes import (
    manifold3d,
    normals_of,
    open_edges,
    outer_surface,
    pieces_of,
    solid_of,
    surface_of,
    triangles_of,
)

CORNERS: Final = 8  # most corners of a joint
SLIVER: Final = 0.02  # of the mean volume: smaller cells are joined to a neighbour
_SPLINTER: Final = 1e-4  # of the mean volume: such convex pieces join another one
_SHEET: Final = 1e-7  # thickness below which a piece is a sheet, by size
_NEAR: Final = 1e-6  # distance of a joint from a plane in which it is met again, by size
_FLAT: Final = 1e-8  # distance of corners from a plane that they lie in, by size
_LEAST: Final = 1e-9  # area of a section by the square of the size
JOINT: Final = 1e-5  # the same of a joint that carries
BENT: Final = 0.06  # share of a convex hull that a joint of the search may lack: facets of a curve are one joint
SPLIT: Final = BENT / 60  # the same of one between convex cells
_CONCAVE: Final = np.radians(20.0)  # turn of a concave edge that is split


@dataclass(frozen=True)
class Limits:
    fit: Floats  # (3,) sides of the box that a part must fit in, ascending
    volume: float  # largest volume of a part
    aim: int = 24  # cells, where nothing else decides
    cells: int = 60  # most cells
    faces: int = 100  # most joints

    def hold(self, box: Floats, volume: float) -> bool:
        """Return whether a body of a box (6,) and a volume is within them."""
        fits = (np.sort(box[3:] - box[:3]) <= self.fit * (1 + 1e-9)).all()
        return bool(fits and volume <= self.volume * (1 + 1e-9))

    @property
    def extent(self) -> float:
        return float(self.fit[-1])


@dataclass(frozen=True)
class Joint:
    """Plane convex joint between two cells, or of a cell and a support."""

    a: int
    b: int
    polygon: Floats  # (k, 3)
    normal: Floats  # (3,) from a to b
    area: float


@dataclass
class Cutting:
    """Cells of a solid, and the planes that part them."""

    solid: Any
    cells: list[Any] = field(default_factory=list)
    planes: list[Floats] = field(default_factory=list)  # (4,) each: unit normal and offset

    def __post_init__(self) -> None:
        self.cells = self.cells or [self.solid]
        box = np.array(self.solid.bounding_box())
        self.size = float((box[3:] - box[:3]).max())

    def through(self, normal: Floats, offset: float, which: Iterable[int] | None = None) -> None:
        """Cut some cells, by default all, by a plane."""
        chosen = set(range(len(self.cells)) if which is None else which)
        pieces: list[Any] = []
        for k, cell in enumerate(self.cells):
            pieces += self._split(cell, normal, offset) if k in chosen else [cell]
        if len(pieces) > len(self.cells):
            self.cells = pieces
            self.planes.append(np.array([*normal, offset]))

    def _split(self, cell: Any, normal: Floats, offset: float) -> list[Any]:
        """Return connected pieces of a cell; the cell itself where the plane only grazes it."""
        halves = cell.split_by_plane(tuple(normal), float(offset))
        if min(half.volume() for half in halves) < 1e-9 * self.size**3:
            return [cell]
        sides = [[piece for piece in pieces_of(half) if piece.volume() > 1e-12 * self.size**3] for half in halves]
        # where the plane runs along a face, rounding leaves a sheet on the other side of it
        sheets = [
            [piece for piece in side if 2 * piece.volume() < _SHEET * self.size * piece.surface_area()]
            for side in sides
        ]
        if any(sheets):
            thick = [[piece for piece in side if piece not in thin] for side, thin in zip(sides, sheets, strict=True)]
            if not all(thick):
                return [cell]
            join = manifold3d().Manifold.batch_boolean
            joins = zip(thick, sheets[::-1], strict=True)
            sides = [pieces_of(join([*body, *thin], manifold3d().OpType.Add)) for body, thin in joins]
        return [piece for side in sides for piece in side]

    def locally(self, point: Floats, normal: Floats) -> bool:
        """Cut the cell at a point, only where the section through the point is connected."""
        ball = manifold3d().Manifold.sphere(1e-3 * self.size, 8).translate(tuple(point))
        holding = [(float((cell ^ ball).volume()), k) for k, cell in enumerate(self.cells)]
        volume, cut_cell = max(holding)
        if volume <= 0.0:
            return False
        offset = float(normal @ point)
        pieces = self._split(self.cells[cut_cell], normal, offset)
        if len(pieces) < 2:
            return False
        plane = np.array([*normal, offset])
        meeting = sorted(sections(pieces, plane, self.size), key=lambda section: section[2].distance(_at(plane, point)))
        # all pieces that meet at other sections stay joined, unless this also joins the two sides of the chosen one
        side = list(range(len(pieces)))
        first, second = meeting[0][:2] if meeting else (0, 1)
        for a, b, _ in meeting[1:]:
            ends = {side[a], side[b]}
            if ends != {side[first], side[second]}:
                side = [side[a] if section in ends else section for section in side]
        groups = [[pieces[k] for k in range(len(pieces)) if side[k] == name] for name in sorted(set(side))]
        self.cells[cut_cell : cut_cell + 1] = [union(group) for group in groups]
        self.planes.append(plane)
        return True

    def halve(self, limits: Limits) -> None:
        """Halve cells that exceed limits, along their longest sides."""
        for _ in range(12):
            if all(limits.hold(np.array(cell.bounding_box()), cell.volume()) for cell in self.cells):
                return
            cells, self.cells = self.cells, []
            for cell in cells:
                box = np.array(cell.bounding_box())
                if limits.hold(box, cell.volume()):
                    self.cells.append(cell)
                    continue
                order = np.argsort(box[3:] - box[:3])
                over = (box[3:] - box[:3])[order] / limits.fit
                axis = int(order[np.argmax(over)])
                normal = np.eye(3)[axis]
                offset = float(box[axis] + box[axis + 3]) / 2
                self.cells += self._split(cell, normal, offset)
                if not any(np.allclose(plane, [*normal, offset], atol=1e-12) for plane in self.planes):
                    self.planes.append(np.array([*normal, offset]))

    def tidy(self, limits: Limits) -> list[Joint]:
        """Join slivers, and the smallest cells above the limits of numbers; return the joints."""
        joints = joints_of(self.cells, self.planes, self.size)
        for _ in range(6):
            group = _join_small(self.cells, joints, limits)
            if len(set(group)) == len(self.cells):
                return joints
            names = sorted(set(group))
            self.cells = [union([self.cells[k] for k in range(len(group)) if group[k] == name]) for name in names]
            joints = joints_of(self.cells, self.planes, self.size)
        return joints


def _at(plane: Floats, point: Floats) -> Any:
    return shapely.Point(*(basis(plane[:3]) @ point))


def union(cells: list[Any]) -> Any:
    """Return the union of bodies that touch, without walls of no thickness between them where possible."""
    checkpoint()
    if len(cells) == 1:
        return cells[0]
    volume = sum(cell.volume() for cell in cells)
    return closed(cells, volume) or manifold3d().Manifold.batch_boolean(cells, manifold3d().OpType.Add)


def closed(bodies: list[Any], volume: float) -> Any | None:
    """Return touching bodies as one with a surface each of whose edges two faces meet at; None where there is none."""
    surfaces = [surface_of(body) for body in bodies]
    starts = np.cumsum([0, *(len(points) for points, _ in surfaces)])
    points = np.concatenate([points for points, _ in surfaces])
    triangles = np.concatenate([faces + start for (_, faces), start in zip(surfaces, starts, strict=False)])
    size = float(np.ptp(points, axis=0).max())
    for tolerance in (1e-9, 1e-7, 1e-6):
        try:
            surface = outer_surface(points, triangles, tolerance * size)
        except (shapely.errors.GEOSException, ValueError):  # regions that cannot be split to triangles
            continue
        if not len(open_edges(surface[1])):
            body = solid_of(*surface)
            if body.status().name == "NoError" and abs(body.volume() - volume) <= 1e-8 * volume:
                return body
    return None


def _join_small(cells: list[Any], joints: list[Joint], limits: Limits) -> list[int]:
    """Join slivers, and smallest cells of too many, to neighbours: the owner of each cell."""
    owner, volume = list(range(len(cells))), [cell.volume() for cell in cells]
    boxes = [np.array(cell.bounding_box()) for cell in cells]
    area: dict[tuple[int, int], float] = {}
    pieces: dict[tuple[int, int], int] = {}
    for joint in joints:
        pair = min(joint.a, joint.b), max(joint.a, joint.b)
        area[pair], pieces[pair] = area.get(pair, 0.0) + joint.area, pieces.get(pair, 0) + 1
    mean, remaining = sum(volume) / len(volume), set(owner)
    stuck: set[int] = set()
    while remaining - stuck:
        smallest = min(remaining - stuck, key=lambda k: volume[k])
        too_many = len(remaining) > limits.cells or sum(pieces.values()) > limits.faces
        if volume[smallest] >= SLIVER * mean and not too_many:
            break
        neighbours = sorted(((size, pair) for pair, size in area.items() if smallest in pair), reverse=True)
        for _, pair in neighbours:  # largest common area first
            other = pair[0] if pair[1] == smallest else pair[1]
            box = np.concatenate(
                [np.minimum(boxes[smallest][:3], boxes[other][:3]), np.maximum(boxes[smallest][3:], boxes[other][3:])]
            )
            if limits.hold(box, volume[smallest] + volume[other]):
                break
        else:
            stuck.add(smallest)
            continue
        # the joints of the joined cell become those of its owner
        boxes[other], volume[other] = box, volume[other] + volume[smallest]
        remaining.remove(smallest)
        owner = [other if name == smallest else name for name in owner]
        for old in [pair for pair in area if smallest in pair]:
            third = old[0] if old[1] == smallest else old[1]
            size, number = area.pop(old), pieces.pop(old)
            if third != other:
                new = min(third, other), max(third, other)
                area[new], pieces[new] = area.get(new, 0.0) + size, pieces.get(new, 0) + number
    return owner


def basis(normal: Floats) -> Floats:
    """Return two unit vectors (2, 3) that span a plane, e1 × e2 = normal."""
    # by numbers: for single vectors, `np.cross` takes twenty times as long
    x, y, z = normal.tolist()
    least = min(range(3), key=lambda k: abs((x, y, z)[k]))
    a, b, c = ((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))[least]
    length = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / length, b / length, c / length
    return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])


def sides_of(cell: Any, plane: Floats, size: float) -> tuple[Any, Any]:
    """Return the regions of a plane that a cell covers from below and from above."""
    points, triangles = surface_of(cell)
    flat = np.abs(points @ plane[:3] - plane[3]) < _FLAT * size
    in_plane = triangles[flat[triangles].all(axis=1)]
    if not len(in_plane):
        return shapely.Polygon(), shapely.Polygon()
    corners = (points @ basis(plane[:3]).T)[in_plane]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    turn = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    below, above = turn > 1e-14 * size**2, turn < -1e-14 * size**2
    return tuple(shapely.union_all(shapely.polygons(corners[side])) for side in (below, above))


def sections(cells: list[Any], plane: Floats, size: float) -> list[tuple[int, int, Any]]:
    """Return the regions of a plane between pairs of cells: the cell below, the one above, a polygon."""
    low, high = np.array([cell.bounding_box() for cell in cells]).reshape(-1, 2, 3).transpose(1, 0, 2)
    reach = np.where(plane[:3] > 0, high, low) @ plane[:3], np.where(plane[:3] > 0, low, high) @ plane[:3]
    touched = np.flatnonzero((reach[0] >= plane[3] - _FLAT * size) & (reach[1] <= plane[3] + _FLAT * size))
    sides = {k: sides_of(cells[k], plane, size) for k in touched.tolist()}
    regions = []
    for a, (below, _) in sides.items():
        for b, (_, above) in sides.items():
            if a == b or below.is_empty or above.is_empty or not shapely.intersects(below, above):
                continue
            common = shapely.intersection(below, above, grid_size=1e-10 * size)
            regions += [
                (a, b, part)
                for part in shapely.get_parts(common).tolist()
                if part.geom_type == "Polygon" and part.area > _LEAST * size**2
            ]
    return regions


def joints_of(
    cells: list[Any], planes: list[Floats], size: float, bent: float = BENT, corners: int | None = CORNERS
) -> list[Joint]:
    """Return the joints between cells in planes, as pieces of so many corners, convex but for a share `bent`."""
    joints = []
    rings_of: dict[tuple[int, int], list[Floats]] = {}
    for plane in unique_planes(planes, size):
        checkpoint()
        new = []
        for a, b, region in sections(cells, plane, size):
            # cells that meet in a plane also meet in one that differs by rounding: that is the same joint
            rings = rings_of.get((min(a, b), max(a, b)), ())
            if not any(_covers(ring, region, plane, size) for ring in rings):
                new.append((a, b, region))
        for a, b, region in new:
            for piece in convex_pieces(region, 1e-7 * size, bent, corners):
                joints.append(Joint(a, b, lifted(piece, plane), plane[:3], piece.area))
            rings_of.setdefault((min(a, b), max(a, b)), []).append(lifted(region, plane))
    return joints


def _covers(ring: Floats, region: Any, plane: Floats, size: float) -> bool:
    """Return whether a joint of corners (k, 3) lies in a plane, and holds most of a region of it."""
    if np.abs(ring @ plane[:3] - plane[3]).max() > _NEAR * size:
        return False
    common = shapely.intersection(shapely.Polygon(ring @ basis(plane[:3]).T).buffer(0.0), region)
    return bool(common.area > 0.5 * region.area)


def unique_planes(planes: list[Floats], size: float) -> list[Floats]:
    """Return planes (4,), turned to one side, without those that differ by rounding."""
    unique: list[Floats] = []
    for plane in planes:
        sign = 1.0 if plane[:3][np.argmax(np.abs(plane[:3]) > 1e-6)] > 0 else -1.0
        oriented = sign * plane
        gaps = (np.abs(oriented - other) for other in unique)
        if not any(gap[:3].max() < 1e-9 and gap[3] < 1e-9 * size for gap in gaps):
            unique.append(oriented)
    return unique


def lifted(polygon: Any, plane: Floats) -> Floats:
    """Return the corners (k, 3) of a polygon in the frame of a plane."""
    corners = shapely.get_coordinates(polygon.exterior)[:-1] @ basis(plane[:3]) + plane[3] * plane[:3]
    return np.where(np.abs(corners) < 1e-15, 0.0, corners)  # without the dust of rounding


def convex_pieces(region: Any, tolerance: float, bent: float, corners: int | None = CORNERS) -> list[Any]:
    """Split a polygon into convex pieces of so many corners at most; a piece may exceed it by a share `bent`."""
    pieces = _pieces(shapely.simplify(shapely.orient_polygons(region), tolerance), tolerance, bent, corners)
    total = sum(piece.area for piece in pieces)
    if total - shapely.union_all(pieces).area > 1e-9 * total:  # hulls of bent pieces overlap
        return _pieces(region, tolerance, 1e-6, corners)
    return pieces


def _pieces(region: Any, tolerance: float, bent: float, corners: int | None) -> list[Any]:
    """Return few convex polygons that together are a region, by joining triangles."""
    pieces = [region]
    if not _is_convex(region, bent):
        pieces = [piece for piece in triangles_of(region) if piece.area > 0.0]
    merging = True
    while merging and len(pieces) > 1:
        merging = False
        shared = sorted(
            (
                (shapely.intersection(first, second).length, a, b)
                for a, first in enumerate(pieces)
                for b, second in enumerate(pieces[:a])
                if shapely.intersects(first, second)
            ),
            reverse=True,
        )
        for length, a, b in shared:
            both = shapely.union(pieces[a], pieces[b])
            if length > 0.0 and both.geom_type == "Polygon" and _is_convex(both, bent):
                others = [piece for k, piece in enumerate(pieces) if k not in (a, b)]
                pieces = [*others, shapely.simplify(both, tolerance)]
                merging = True
                break
    least = 1e-4 * region.area
    return [_inscribed(piece, corners) for piece in pieces if piece.area > least]


def _is_convex(polygon: Any, bent: float) -> bool:
    return not polygon.interiors and bool(polygon.convex_hull.area - polygon.area <= bent * polygon.area)


def _inscribed(polygon: Any, most: int | None) -> Any:
    """Return a convex polygon of so many corners of another one at most, without the corners that hold least area."""
    corners = shapely.get_coordinates(polygon.convex_hull.exterior)[:-1]
    while most and len(corners) > most:
        before, after = np.roll(corners, 1, axis=0) - corners, np.roll(corners, -1, axis=0) - corners
        areas = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
        corners = np.delete(corners, int(np.argmin(areas)), axis=0)
    return shapely.Polygon(corners)


def concave_edges(solid: Any) -> list[tuple[float, Floats, Floats, Floats]]:
    """Return the concave edges of a solid: turn, middle, outward normals of both faces; the sharpest first."""
    # corners that cuts left side by side hide an edge between faces of no area
    points, triangles = surface_of(solid.simplify(1e-7 * float(np.ptp(np.array(solid.bounding_box()).reshape(2, 3)))))
    normal, length = normals_of(points[triangles])
    normal = normal / np.maximum(length, 1e-300)[:, None]
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    forwards, backwards = start * len(points) + end, end * len(points) + start
    order = np.argsort(forwards, kind="stable")
    position = np.minimum(np.searchsorted(forwards[order], backwards), len(order) - 1)
    twin = order[position]
    edges_of_two = np.flatnonzero((forwards[twin] == backwards) & (start < end))
    f, g = edges_of_two // 3, twin[edges_of_two] // 3
    along = points[end[edges_of_two]] - points[start[edges_of_two]]
    along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    sine = np.einsum("ij,ij->i", np.cross(normal[f], normal[g]), along)
    turn = np.arctan2(sine, np.einsum("ij,ij->i", normal[f], normal[g]))
    middle = (points[start[edges_of_two]] + points[end[edges_of_two]]) / 2
    concave = np.flatnonzero((turn < -1e-3) & (np.minimum(length[f], length[g]) > 1e-12))
    edges = [(-float(turn[k]), middle[k], normal[f[k]], normal[g[k]]) for k in concave.tolist()]
    return sorted(edges, key=lambda edge: -edge[0])


def convex_parts(
    cells: list[Any], most: int, least: float = _CONCAVE, few: bool = False
) -> tuple[list[Any], Ints, list[Floats], bool]:
    """Split cells at concave edges: pieces, their cells, planes, and whether all are convex.

    least: turn of an edge that is split, radians. few: by planes that leave fewest such edges.
    """
    # the sharpest edge of all pieces is split first, so that a limit leaves the flattest
    pieces, of, planes = list(cells), list(range(len(cells))), []
    edges = [concave_edges(cell) for cell in cells]
    while len(pieces) < most:
        checkpoint()
        turn, at = max((concave[0][0], k) if concave else (0.0, k) for k, concave in enumerate(edges))
        if turn < least:
            break
        _, middle, first, second = edges[at].pop(0)
        cuts: list[tuple[tuple[int, int, int], Cutting, list[Any]]] = []  # rank, cut, concave edges of its pieces
        for across in (first - second, first, second):  # a bisector may graze a thin piece
            cutting = Cutting(pieces[at])
            across = across / np.linalg.norm(across)
            cutting.through(across, float(across @ middle))
            if len(cutting.cells) > 1 and (few or not cuts):
                edges_left = [concave_edges(cell) for cell in cutting.cells]
                # bodies that touch along an edge are not convex and have no concave edge to split at
                stuck = sum(
                    not sharp_edges and not _convex(cell)
                    for sharp_edges, cell in zip(edges_left, cutting.cells, strict=True)
                )
                sharp = sum(edge_turn >= least for edge_turn, *_ in itertools.chain(*edges_left))
                cuts.append(((stuck, sharp, len(edges_left)), cutting, edges_left))
        if cuts:
            _, cutting, edges_left = min(cuts, key=lambda entry: entry[0])
            planes += cutting.planes
            pieces[at : at + 1], of[at : at + 1] = (cutting.cells, [of[at]] * len(edges_left))
            edges[at : at + 1] = edges_left
    return pieces, np.array(of), planes, all(_convex(piece) for piece in pieces)


def without_splinters(pieces: list[Any], cell_of: Ints, joints: list[Joint]) -> tuple[list[Any], Ints] | None:
    """Return pieces and their cells, splinters joined to the piece of the same cell with most in common; None as is."""
    volume = np.array([piece.volume() for piece in pieces])
    group = list(range(len(pieces)))
    for k in np.flatnonzero(volume < _SPLINTER * volume.mean()).tolist():
        shared: dict[int, float] = {}
        for joint in joints:
            if k in (joint.a, joint.b) and cell_of[joint.a] == cell_of[joint.b]:
                other = joint.a + joint.b - k
                shared[other] = shared.get(other, 0.0) + joint.area
        if shared:
            old, new = group[k], group[max(shared, key=lambda other: shared[other])]
            group = [new if name == old else name for name in group]
    names = sorted(set(group))
    if len(names) == len(pieces):
        return None
    joined = [union([pieces[k] for k in range(len(group)) if group[k] == name]) for name in names]
    return joined, cell_of[names]


def _convex(piece: Any) -> bool:
    hull = piece.hull().volume()
    return bool(hull - piece.volume() < 1e-6 * hull)
