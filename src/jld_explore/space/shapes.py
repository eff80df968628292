"""The shapes of blocks: which are alike, how slender they are, where they turn inwards. Each block is looked at once.

Two blocks have one shape where a translation lays one onto the other; with moulds that may be turned, a rotation as
well; with moulds that may be turned over, a mirror. What is compared is the boundary of the union of a block's
elements, corners and middles of edges (planar) or of faces (spatial), within the tolerance of the geometry.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from scipy.spatial import ConvexHull, cKDTree

from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly

_REACH: Final = 1e-6
"""Distance, relative to the structure, within which corners of congruent blocks fall on one another."""

_FLAT: Final = 1e-5
"""Share of its hull's area or volume that a block may lack and still count as convex."""


@dataclass(frozen=True)
class BlockShape:
    """One block's boundary.

    points: (k + e, d) corners about its centroid, then middles of edges or faces. count: k. size: area or volume.
    aspect: longest over shortest side of the smallest box around it. reentrant: corners that turn inwards (planar);
    spatial: 1 where it is not convex, else 0.
    """

    points: Floats
    count: int
    size: float
    aspect: float
    reentrant: int


class BlockShapes:
    """The shapes of all blocks that are asked for, of one assembly. rotate, flip: what moulds may be."""

    def __init__(self, assembly: Assembly, *, rotate: bool = False, flip: bool = False) -> None:
        self.assembly, self.rotate, self.flip = assembly, rotate, flip
        self.reach = max(_REACH * assembly.size, 4.0 * assembly.moved)
        rng = np.random.default_rng(20240711)
        self._sign = rng.integers(1, 2**63, size=len(assembly.elements), dtype=np.uint64)
        self._sign[assembly.elements.support] = 0
        self._place: dict[int, int] = {}
        self._known: list[BlockShape] = []
        self._number: list[int] = []
        self._kinds: list[int] = []

    def look(self, blocks: Ints) -> tuple[Bools, Ints]:
        """Where blocks with free elements are named, (k, n) as by `blocks_of`, and their places among the known."""
        rows, count = blocks.shape
        names = (blocks + count * np.arange(rows)[:, None]).ravel()
        key = np.zeros(rows * count, dtype=np.uint64)
        np.add.at(key, names, np.tile(self._sign, rows))
        holds = key != 0
        unique, first, inverse = np.unique(key[holds], return_index=True, return_inverse=True)
        where = np.flatnonzero(holds)[first]
        places = np.empty(len(unique), dtype=np.int64)
        free = ~self.assembly.elements.support
        for k, (value, at) in enumerate(zip(unique.tolist(), where.tolist(), strict=True)):
            if value not in self._place:
                row, name = divmod(at, count)
                self._place[value] = len(self._known)
                self._known.append(self._shape(np.flatnonzero((blocks[row] == name) & free)))
            places[k] = self._place[value]
        found = np.full(rows * count, -1, dtype=np.int64)
        found[holds] = places[inverse.reshape(-1)]
        return holds.reshape(rows, count), found.reshape(rows, count)

    def one(self, members: Ints) -> BlockShape:
        """The shape of one block by its free elements, ascending."""
        key = int(self._sign[members].sum(dtype=np.uint64))
        if key not in self._place:
            self._place[key] = len(self._known)
            self._known.append(self._shape(members))
        return self._known[self._place[key]]

    def different(self, blocks: Ints) -> Ints:
        """(k,) number of different shapes of blocks in each row (k, n)."""
        holds, places = self.look(blocks)
        number = self._numbers()
        kind = np.where(holds, number[places], -1)
        kind.sort(axis=1)
        new = np.diff(kind, axis=1, prepend=-1) != 0
        return np.asarray((new & (kind >= 0)).sum(axis=1), dtype=np.int64)

    def values(self, name: str) -> Floats:
        """(b,) an attribute of every block that is known, in the order of their positions."""
        return np.array([float(getattr(shape, name)) for shape in self._known])

    def _numbers(self) -> Ints:
        """(b,) number of the shape of each known block; new ones are compared with one block of each kind."""
        for shape in self._known[len(self._number) :]:
            for kind in self._kinds:
                if self._same(shape, self._known[kind]):
                    self._number.append(self._number[kind])
                    break
            else:
                self._kinds.append(len(self._number))
                self._number.append(len(self._kinds) - 1)
        return np.array(self._number, dtype=np.int64)

    # --- one block --------------------------------------------------------------------------------------

    def _shape(self, members: Ints) -> BlockShape:
        return self._flat(members) if self.assembly.dimension == 2 else self._solid(members)

    def _flat(self, members: Ints) -> BlockShape:
        shapes = self.assembly.elements.shape
        if len(members) == 1:
            region = shapely.Polygon(shapes[members[0]])
        else:
            region = shapely.union_all([shapely.Polygon(shapes[e]) for e in members], grid_size=1e-3 * self.reach)
        centre = shapely.get_coordinates(region.centroid)[0]
        corners, middles, inwards = [], [], 0
        for part in shapely.get_parts(region):
            for ring in [part.exterior, *part.interiors]:
                points = _straightened(shapely.get_coordinates(ring)[:-1], self.reach)
                before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
                turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
                way = 1.0 if ring.is_ccw else -1.0
                outer = ring is part.exterior or ring.equals(part.exterior)
                inwards += int(np.count_nonzero(way * turn < 0.0 if outer else way * turn > 0.0))
                corners.append(points - centre)
                middles.append(points + 0.5 * after - centre)
        box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(region))
        sides = np.hypot(*(box[1:3] - box[:2]).T)
        points = np.concatenate(corners + middles)
        count = sum(len(ring) for ring in corners)
        return BlockShape(points, count, float(region.area), float(sides.max() / sides.min()), inwards)

    def _solid(self, members: Ints) -> BlockShape:
        elements = self.assembly.elements
        corners = np.concatenate([elements.shape[e] for e in members])
        volume = float(self._volume[members].sum())
        hull = ConvexHull(corners)
        convex = hull.volume <= (1.0 + _FLAT) * volume
        outline = _skin([(elements.shape[e], elements.faces[e]) for e in members], self.reach)
        unique = _merged(np.concatenate(outline), self.reach)
        middles = np.array([face.mean(axis=0) for face in outline])
        centre = np.average(elements.centroid[members], axis=0, weights=self._volume[members])
        points = np.concatenate([unique - centre, middles - centre])
        return BlockShape(points, len(unique), volume, _box_aspect(corners, hull), int(not convex))

    @cached_property
    def _volume(self) -> Floats:
        return np.abs(self.assembly.elements.volume)

    # --- two blocks -------------------------------------------------------------------------------------

    def _same(self, one: BlockShape, other: BlockShape) -> bool:
        near = abs(one.size - other.size) <= 1e-3 * other.size
        if not near or one.count != other.count or len(one.points) != len(other.points):
            return False
        if self._falls_on(one.points, one.count, other):
            return True
        if not (self.rotate or self.flip):
            return False
        return any(self._falls_on(one.points @ matrix.T, one.count, other) for matrix in self._turns(one, other))

    def _falls_on(self, points: Floats, count: int, other: BlockShape) -> bool:
        """Whether every corner falls on a corner of the other and every middle on a middle, one to one."""
        for part in (slice(0, count), slice(count, None)):
            mine, there = points[part], other.points[part]
            if not len(mine):
                continue
            distance, to = cKDTree(there).query(mine)
            if float(np.max(distance)) > 2.0 * self.reach or len(np.unique(to)) != len(there):
                return False
        return True

    def _turns(self, one: BlockShape, other: BlockShape) -> list[Floats]:
        """Orthogonal matrices that may lay one block onto the other: turns, mirrors, or both, as moulds may be."""
        d = one.points.shape[1]
        corners, images = one.points[: one.count], other.points[: other.count]
        radius, there = np.linalg.norm(corners, axis=1), np.linalg.norm(images, axis=1)
        first = int(np.argmax(radius))
        slack = 4.0 * self.reach
        matrices: list[Floats] = []
        signs = [1.0] * self.rotate + [-1.0] * self.flip
        if d == 2:
            for q in np.flatnonzero(abs(there - radius[first]) <= slack).tolist():
                for sign in signs:
                    angle = np.arctan2(images[q, 1], images[q, 0]) - sign * np.arctan2(
                        corners[first, 1], corners[first, 0]
                    )
                    c, s = np.cos(angle), np.sin(angle)
                    matrices.append(np.array([[c, -s], [s, c]]) @ np.diag([1.0, sign]))
            return matrices if self.rotate else [m for m in matrices if _is_mirror_along_an_axis(m)]
        away = np.linalg.norm(np.cross(corners, corners[first]), axis=1)
        second = int(np.argmax(away))
        gram = float(corners[first] @ corners[second])
        base = _frame(corners[first], corners[second])
        for p in np.flatnonzero(abs(there - radius[first]) <= slack).tolist():
            for q in np.flatnonzero(abs(there - radius[second]) <= slack).tolist():
                if p == q or abs(float(images[p] @ images[q]) - gram) > slack * 2.0 * radius[first]:
                    continue
                for sign in signs:
                    matrices.append(_frame(images[p], images[q]).T @ np.diag([1.0, 1.0, sign]) @ base)
        return matrices if self.rotate else [m for m in matrices if _is_mirror_along_an_axis(m)]


def _is_mirror_along_an_axis(matrix: Floats) -> bool:
    """Whether a matrix only turns axes round, without turning the block: moulds that may be turned over, not round."""
    return bool(abs(abs(matrix) - np.eye(len(matrix))).max() < 1e-6)


def _frame(first: Floats, second: Floats) -> Floats:
    one = first / np.linalg.norm(first)
    two = second - (second @ one) * one
    two = two / np.linalg.norm(two)
    return np.array([one, two, np.cross(one, two)])


def _straightened(points: Floats, reach: float) -> Floats:
    """A ring (k, 2) without corners that lie on the line of their neighbours within the reach."""
    while len(points) > 3:
        before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
        chord = after - before
        length = np.hypot(*chord.T)
        arm = points - before
        off = abs(chord[:, 0] * arm[:, 1] - chord[:, 1] * arm[:, 0]) / np.where(length > 0.0, length, 1.0)
        idle = off <= reach
        if not idle.any():
            return points
        # one at a time where neighbours are idle both, the flattest first
        kept = np.ones(len(points), dtype=bool)
        kept[int(np.argmin(np.where(idle, off, np.inf)))] = False
        points = points[kept]
    return points


def _merged(points: Floats, reach: float) -> Floats:
    """Points without those that repeat one before within the reach."""
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    kept = np.ones(len(points), dtype=bool)
    kept[pairs[:, 1]] = False
    return points[kept]


def _skin(solids: list[tuple[Floats, tuple[tuple[int, ...], ...]]], reach: float) -> list[Floats]:
    """Outlines of the faces of a union of solids, idle corners left out: what two of them share is inside."""
    planes: list[tuple[Floats, float, list[tuple[float, Floats]]]] = []
    for corners, faces in solids:
        for loop in faces:
            ring = corners[list(loop)]
            arm = ring - ring[0]
            vector = np.cross(arm, np.roll(arm, -1, axis=0)).sum(axis=0)
            normal = vector / np.linalg.norm(vector)
            for other, offset, members in planes:
                sign = float(np.sign(normal @ other))
                if abs(abs(normal @ other) - 1.0) < 1e-9 and abs(float(ring.mean(axis=0) @ other) - offset) < reach:
                    members.append((sign, ring))
                    break
            else:
                planes.append((normal, float(ring.mean(axis=0) @ normal), [(1.0, ring)]))
    found = []
    for normal, offset, members in planes:
        across = _across(normal)
        sides = [
            shapely.union_all([shapely.Polygon(ring @ across.T) for sign, ring in members if sign == side])
            for side in (1.0, -1.0)
        ]
        for here, there in (sides, sides[::-1]):
            for part in shapely.get_parts(shapely.difference(here, there, grid_size=1e-3 * reach)):
                if part.geom_type != "Polygon" or part.area <= reach * part.length:
                    continue
                for ring in [part.exterior, *part.interiors]:
                    flat = _straightened(shapely.get_coordinates(ring)[:-1], reach)
                    found.append(flat @ across + offset * normal)
    return found


def _across(normal: Floats) -> Floats:
    other = np.eye(3)[int(np.argmin(abs(normal)))]
    one = np.cross(normal, other)
    one = one / np.linalg.norm(one)
    return np.array([one, np.cross(normal, one)])


def _box_aspect(corners: Floats, hull: ConvexHull) -> float:
    """Longest over shortest side of the smallest box with a side in a face of the hull."""
    best, sides_of = np.inf, np.ones(3)
    for normal in np.unique(np.round(hull.equations[:, :3], 9), axis=0):
        across = _across(normal / np.linalg.norm(normal))
        high = float(np.ptp(corners @ normal))
        box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapely.multipoints(corners @ across.T)))
        sides = np.array([high, *(float(np.hypot(*(b - a))) for a, b in pairwise(box[:3]))])
        if np.prod(sides) < best:
            best, sides_of = float(np.prod(sides)), sides
    return float(sides_of.max() / sides_of.min())
