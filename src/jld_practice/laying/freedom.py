"""Free translations of blocks, and the blocks that obstruct them in each direction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import shapely

from jld_core import Assembly, Bits, Bools, Elements, Floats, Ints, ParameterError, blocks_of, checkpoint
from jld_core.geometry import across, area_of, area_vector

# relative volume by which a sweep may overlap an element by rounding; its power 2/3 times the size is a depth
SHARED: Final = 1e-6
_SIDES: Final = 12  # planes around a shadow above which those that do not bound it are dropped


class Solids:
    """Tests whether elements of a spatial assembly meet others when translated to infinity."""

    def __init__(self, assembly: Assembly) -> None:
        # an element that is not convex is its surface, or its hull where it moves past one that is not convex
        elements = assembly.elements
        self.elements = elements
        self.size = (elements.upper - elements.lower).max(axis=1)
        from scipy.spatial import ConvexHull  # local, here and below: slow to import, spatial scenes only

        hulls = [ConvexHull(corners) for corners in elements.shape]
        self.planes = [np.unique(np.round(hull.equations, 12), axis=0) for hull in hulls]
        self._met: dict[tuple[int, int, bytes], bool] = {}
        self._paths: dict[tuple[int, float, bytes], Floats] = {}
        self._spans_of: dict[bytes, tuple[Floats, Floats]] = {}
        self.convex = np.array([hull.volume for hull in hulls]) <= (1.0 + SHARED) * _volumes(elements)

    def swept(self, moving: Ints, others: Ints, direction: Floats, owner: Ints) -> Ints:
        """Return owners (n,) of `others` (k,) that an element of `moving` meets along a unit vector (3,), each once."""
        low, high = self.elements.lower, self.elements.upper
        least, most = self._spans(direction)
        met: dict[int, None] = {}
        for e in moving.tolist():
            reach = 1e-9 * self.size[e]
            # exclude what can never be met: cheap, and nearly all
            ahead = (high[others] > low[e] + reach) | (direction < -1e-12)
            behind = (low[others] < high[e] - reach) | (direction > 1e-12)
            beside = (least[others, 1:] >= most[e, 1:]) | (most[others, 1:] <= least[e, 1:])
            passed = beside.any(axis=1) | (most[others, 0] <= least[e, 0])
            for other in others[np.all(ahead & behind, axis=1) & ~passed].tolist():
                if owner[other] not in met and self.meets(e, other, direction):
                    met[int(owner[other])] = None
        return np.array([*met], dtype=np.int64)

    def _spans(self, direction: Floats) -> tuple[Floats, Floats]:
        """Return the least and the largest coordinate (n, 5) of each element along a unit vector and four across."""
        key = direction.tobytes()
        if key not in self._spans_of:
            first, second = tangents(direction)[:2]
            axes = np.array([direction, first, second, first + second, first - second])
            projections = np.concatenate(self.elements.shape) @ axes.T
            starts = np.cumsum([0, *(len(corners) for corners in self.elements.shape[:-1])])
            self._spans_of[key] = np.minimum.reduceat(projections, starts), np.maximum.reduceat(projections, starts)
        return self._spans_of[key]

    def meets(self, moving: int, still: int, direction: Floats) -> bool:
        """Return whether an element moved along a unit vector (3,) would overlap another; results are stored."""
        key = (moving, still, direction.tobytes())
        if key not in self._met:
            checkpoint()
            self._met[key] = self._meets(moving, still, direction)
        return self._met[key]

    def _meets(self, moving: int, still: int, direction: Floats) -> bool:
        # equivalent: a convex element at rest moves the opposite way, past the surface of one that is not
        if self.convex[still] and not self.convex[moving]:
            moving, still, direction = still, moving, -direction
        # p, q: (k, 4) outward normals and offsets of the planes of the moving element and of that at rest, with the
        # triangles `faces` (t, 3, 3)
        p, (faces, normals) = self.planes[moving], self._skin(still)
        # one that meets a solid takes in some of its surface, by more than two elements overlap that only touch
        depth = 2.0 * SHARED ** (2.0 / 3.0) * float(min(self.size[moving], self.size[still]))
        if self.convex[still]:
            q = self.planes[still]
            outside = (self.elements.shape[moving] @ q[:, :3].T).min(axis=0) + q[:, 3]
            if np.any((outside >= -depth) & (q[:, :3] @ direction >= -1e-9)):
                return False
        # clear triangles: beyond a plane of the moving element that does not advance, or not approached from one side
        rates = normals @ direction
        beyond = (faces @ p[:, :3].T).min(axis=1) + p[:, 3]
        clear = ((beyond >= -depth) & (p[:, :3] @ direction <= 1e-9)).any(axis=1)
        height = self.elements.shape[moving] @ normals.T - np.einsum("ij,ij->i", normals, faces[:, 0])
        clear |= (height.min(axis=0) >= -depth) & (rates >= -1e-9)
        clear |= (height.max(axis=0) <= depth) & (rates <= 1e-9)
        if clear.all():
            return False
        key = (moving, depth, direction.tobytes())
        if key not in self._paths:
            middle = self.elements.shape[moving].mean(axis=0)
            self._paths[key] = _swept(p + np.array([0.0, 0.0, 0.0, depth]), direction, middle)
        planes = self._paths[key]
        faces = faces[~clear]
        # most are settled at once: a corner or the middle within, or all corners beyond one plane
        points = np.concatenate([faces, faces.mean(axis=1, keepdims=True)], axis=1)
        distance = points @ planes[:, :3].T + planes[:, 3]
        if (distance <= 0.0).all(axis=2).any():
            return True
        return any(_meets(planes, face, 1e-3 * depth) for face in faces[~(distance.min(axis=1) > 0.0).any(axis=1)])

    def _skin(self, element: int) -> tuple[Floats, Floats]:
        # triangles and their unit normals
        if element not in self._skins:
            corners = self.elements.shape[element]
            faces = np.concatenate([_triangles(corners[list(loop)]) for loop in self.elements.faces[element]])
            normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
            self._skins[element] = faces, normals / np.linalg.norm(normals, axis=1)[:, None]
        return self._skins[element]

    @cached_property
    def _skins(self) -> dict[int, tuple[Floats, Floats]]:
        return {}


def _swept(planes: Floats, direction: Floats, middle: Floats) -> Floats:
    """Return the planes (k, 4) around all that the solid in planes (p, 4), n·x + c ≤ 0, passes along a direction."""
    # a point x is passed if n·(x − t·d) + c ≤ 0 for some t ≥ 0: t is eliminated between each pair of planes
    speed = planes[:, :3] @ direction
    ahead, behind = speed > 1e-9, speed < -1e-9
    lower, upper = planes[ahead] / speed[ahead, None], planes[behind] / speed[behind, None]
    sides = (lower[:, None] - upper[None]).reshape(-1, 4)
    length = np.linalg.norm(sides[:, :3], axis=1)
    sides = sides[length > 1e-9] / length[length > 1e-9, None]
    # of hundreds of pairs few bound the shadow: the corners of its polar about a point within
    room = -(sides[:, :3] @ middle + sides[:, 3])
    if len(sides) > _SIDES and (room > 0.0).all():
        from scipy.spatial import ConvexHull

        sides = sides[ConvexHull(sides[:, :3] @ tangents(direction)[:2].T / room[:, None]).vertices]
    return np.concatenate([planes[~ahead], sides])


def _meets(planes: Floats, polygon: Floats, near: float) -> bool:
    """Return whether a convex polygon (k, 3) meets the solid in planes (p, 4), to a length."""
    for _ in range(len(planes)):
        away = polygon @ planes[:, :3].T + planes[:, 3]
        if (away.min(axis=0) > 0.0).any():
            return False
        worst = int(away.max(axis=0).argmax())
        height = away[:, worst]
        if height.max() <= near:
            return True
        pairs = []
        for k, at in enumerate(height.tolist()):
            j = (k + 1) % len(polygon)
            if at <= 0.0:
                pairs.append(polygon[k])
            if (at <= 0.0) != (height[j] <= 0.0):
                pairs.append(polygon[k] + at / (at - height[j]) * (polygon[j] - polygon[k]))
        polygon = np.array(pairs)
    return True


def _volumes(elements: Elements) -> Floats:
    # Volumes given by a scene are ignored.
    volumes = []
    for corners, faces in zip(elements.shape, elements.faces, strict=True):
        total = 0.0
        for loop in faces:
            points = corners[list(loop)] - corners[0]
            total += float((np.cross(points[1:-1], points[2:]) @ points[0]).sum())
        volumes.append(abs(total) / 6.0)
    return np.array(volumes)


def _triangles(face: Floats) -> Floats:
    """Split a plane polygon (k, 3) into triangles (t, 3, 3)."""
    if len(face) == 3:
        return face[None]
    normal = area_vector(face)
    plane = across(normal / np.linalg.norm(normal))
    # a face with a hole is one outline with a bridge, which is not an edge of the region
    flat = area_of(shapely.Polygon((face - face[0]) @ plane.T))
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(flat))
    return np.array([face[0] + shapely.get_coordinates(part)[:3] @ plane for part in parts])


def tangents(normal: Floats) -> Floats:
    """Return two axes of the plane of a unit normal (3,), and their negatives: (4, 3)."""
    plane = across(normal)
    return np.concatenate([plane, -plane])


_MOST: Final = 500  # largest number of places; more indicate a spacing in another unit


@dataclass(frozen=True)
class Stations:
    """Places at which props push upwards along the underside of a planar structure."""

    points: Floats  # (s, 2) places, scene units
    element: Ints  # (s,) element above each, which has to be laid for the prop to act


def stations_below(assembly: Assembly, spacing: float) -> Stations:
    """Return places at equal distances below a planar structure; ParameterError for a wrong spacing."""
    # Places are the same on both sides of the structure's middle. Places above a support are left out.
    if assembly.dimension != 2:
        raise ParameterError("props", "props along a line are for planar scenes", "a search without it")
    if not 0.0 < spacing < math.inf:
        raise ParameterError("props", f"a spacing of {spacing:g} is wrong", "a length above 0")
    elements = assembly.elements
    total = elements.weight[elements.free].sum(axis=0)
    up = -total / np.linalg.norm(total) if np.any(total) else np.array([0.0, 1.0])
    right = np.array([up[1], -up[0]])
    along = np.concatenate([elements.shape[e] @ right for e in elements.free])
    low, high = float(along.min()), float(along.max())
    count = math.floor((high - low) / spacing * (1.0 + 1e-9))
    if count + 1 > _MOST:
        raise ParameterError("props", f"a spacing of {spacing:g} gives {count + 1} places", f"at most {_MOST} places")
    first = low + 0.5 * (high - low - count * spacing)
    points, owner = [], []
    for position in first + spacing * np.arange(count + 1):
        below = {
            e: _lowest(elements.shape[e] @ right, elements.shape[e] @ up, float(position)) for e in range(len(elements))
        }
        heights = {e: height for e, height in below.items() if height is not None}
        on_support = any(elements.support[e] for e in heights)
        if heights and not on_support:
            element = min(heights, key=lambda e: (heights[e], e))
            points.append(position * right + heights[element] * up)
            owner.append(element)
    if not points:
        ends = [elements.shape[e] @ right for e in range(len(elements)) if elements.support[e]]
        grounds = shapely.union_all([shapely.LineString([(end.min(), 0.0), (end.max(), 0.0)]) for end in ends])
        line = shapely.LineString([(low, 0.0), (high, 0.0)])
        if shapely.difference(line, shapely.buffer(grounds, 1e-9 * assembly.size)).is_empty:
            problem = "the structure stands on supports along its whole length: places lie below a free underside only"
            raise ParameterError("props", problem, "no such option; each stage then says which blocks need props")
        raise ParameterError("props", f"a spacing of {spacing:g} leaves no place below the structure", "a shorter one")
    return Stations(np.array(points), np.array(owner, dtype=np.int64))


def _lowest(across: Floats, height: Floats, position: float) -> float | None:
    """Return the lowest height of a polygon, by its corners (k,), at a horizontal place; None beside it."""
    after, above = np.roll(across, -1), np.roll(height, -1)
    crossed = (np.minimum(across, after) <= position) & (position <= np.maximum(across, after)) & (across != after)
    if not crossed.any():
        return None
    share = (position - across[crossed]) / (after - across)[crossed]
    return float((height[crossed] + share * (above - height)[crossed]).min())


# Wilson & Latombe, Geometric reasoning about mechanical assembly, Artificial Intelligence 71 (1994) 371–396


_SMALLER: Final = 1e-6  # relative shrinkage of pieces at rest, so that touching pieces do not overlap by rounding

TURN: Final = 1e-7  # angle, radians, by which a direction may point into an obstacle: accuracy of normals in drawings

_SAME: Final = 1e-9  # distance, relative to the largest element, up to which two corners coincide

# Angle, radians, up to which the end of an exact arc belongs to the end of an arc of the shrunk pieces
_NEAR: Final = 1e-5

_PIECES: Final = 150  # largest number of pieces for which groups are tried at all ends of arcs

# Largest number of directions in which groups are tried. With more ends of arcs, or more than `_PIECES` pieces,
# directions along contacts replace them.
_TURNS: Final = 2000

_CHUNK: Final = 1 << 22  # number of entries of one batch of the blocking table


class Arcs:
    """Blocked directions of translation between the convex pieces of planar elements, as arcs of angles."""

    def __init__(self, assembly: Assembly) -> None:
        # elements that are not convex are split into triangles; `owner` (p,) is the element of each piece
        self.assembly = assembly
        pieces, owner = [], []
        for element, shape in enumerate(assembly.elements.shape):
            convex = _convex_pieces(shape)
            pieces += convex
            owner += [element] * len(convex)
        self.owner = np.array(owner, dtype=np.int64)
        size = max(len(piece) for piece in pieces)
        # Pad pieces to equally many corners by repeating the last one: only minima and maxima are taken over corners.
        self._corner = np.array([piece[np.minimum(np.arange(size), len(piece) - 1)] for piece in pieces])
        self._middle = np.array([piece.mean(axis=0) for piece in pieces])
        self._smaller = self._middle[:, None] + (1.0 - _SMALLER) * (self._corner - self._middle[:, None])
        self._size = float(max(np.ptp(shape, axis=0).max() for shape in assembly.elements.shape))
        self._of: dict[int, Floats] = {}
        self._exact: dict[int, Floats] = {}

    def of(self, piece: int) -> Floats:
        """Return the directions in which a piece meets each of the p pieces, as arcs (p, 2).

        A row has the begin, 0 to 2π, and the width; a width below 0 means never.
        """
        # pieces at rest are shrunk, so that sliding along a contact is free
        if piece not in self._of:
            begin, width = self._seen(piece, self._smaller, 0.0)
            arcs = np.column_stack([(begin + TURN) % (2.0 * np.pi), width - 2.0 * TURN])
            arcs[piece, 1] = -1.0
            self._of[piece] = arcs
        return self._of[piece]

    def ends(self, piece: int) -> Floats:
        """Return the directions (p, 2) in which a piece begins and ends to meet each piece; NaN for never."""
        # at the exact size: motion along an end is parallel to the faces in contact, which `of` does not give
        if piece not in self._exact:
            begin, width = self._seen(piece, self._corner, _SAME * self._size)
            ends = np.column_stack([begin, begin + width])
            ends[self.of(piece)[:, 1] <= 0.0] = np.nan
            self._exact[piece] = ends
        return self._exact[piece]

    def _seen(self, piece: int, resting: Floats, same: float) -> tuple[Floats, Floats]:
        """Compute begin (p,) and width (p,) of the directions blocked by pieces at rest (p, k, 2)."""
        arm = resting[:, None] - self._corner[piece][None, :, None]
        arm = arm.reshape(len(self._corner), -1, 2)
        towards = self._middle - self._middle[piece]
        along = np.einsum("pki,pi->pk", arm, towards)
        across = towards[:, None, 0] * arm[:, :, 1] - towards[:, None, 1] * arm[:, :, 0]
        angle = np.where(np.hypot(arm[:, :, 0], arm[:, :, 1]) <= same, 0.0, np.arctan2(across, along))
        low, high = angle.min(axis=1), angle.max(axis=1)
        # pieces that overlap by more than rounding only block directions towards one another
        over = high - low >= np.pi + (TURN if same else 0.0)
        low, high = np.where(over, -0.5 * np.pi, low), np.where(over, 0.5 * np.pi, high)
        return np.arctan2(towards[:, 1], towards[:, 0]) + low, high - low

    def way_out(self, moving: Bools, still: Bools, up: Floats) -> Floats | None:
        """Return the direction (2,) nearest to `up` in which elements can leave others, or None.

        moving, still: (n,) masks of the elements that move together, and of those at rest.
        """
        own_pieces, others = np.flatnonzero(moving[self.owner]), still[self.owner]
        arcs = np.concatenate([self.of(int(piece))[others] for piece in own_pieces])
        arcs = arcs[arcs[:, 1] > 0.0]
        upwards = float(np.arctan2(up[1], up[0])) % (2.0 * np.pi)
        if not len(arcs):
            return up
        begin = arcs[np.argsort(arcs[:, 0], kind="stable")]
        end = np.maximum.accumulate(begin[:, 0] + begin[:, 1])
        # gaps between arcs: from the largest end so far, modulo a full turn, to the next begin
        before = np.concatenate([[end[-1] - 2.0 * np.pi], np.maximum(end[:-1], end[-1] - 2.0 * np.pi)])
        free = before <= begin[:, 0]
        if not free.any():
            return None
        low, high = before[free], begin[free, 0]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        angle = _nearest(upwards, middle, half)
        best = int(np.argmin(np.round(abs(_reduce_angles(angle - upwards)), 6)))
        ends = np.concatenate([self.ends(int(piece))[others] for piece in own_pieces])
        # the same gap between exact arcs, whose ends differ from those of the shrunk pieces
        after, before = _reduce_angles(ends[:, 1] - low[best]), _reduce_angles(ends[:, 0] - high[best])
        low_end = low[best] + np.max(after, initial=0.0, where=abs(after) <= _NEAR)
        high_end = high[best] + np.min(before, initial=0.0, where=abs(before) <= _NEAR)
        between = float(_nearest(upwards, 0.5 * (low_end + high_end), max(0.5 * float(high_end - low_end), 0.0)))
        direction = np.round([np.cos(between), np.sin(between)], 15)
        return np.asarray(direction / np.linalg.norm(direction)) + 0.0

    @cached_property
    def turns(self) -> Floats:
        """Angles (k,) of the directions tried for groups of blocks, radians, from 0 to 2π."""
        # The directions are the ends of all arcs, at which blocking changes. An assembly with too many pieces or ends
        # has the directions along its contacts instead, at most 2000.
        if len(self.owner) <= _PIECES:
            every = np.concatenate([self.ends(piece) for piece in range(len(self.owner))]).ravel()
            turns = _different(every[np.isfinite(every)])
            if len(turns) <= _TURNS:
                return turns
        tangent = self.assembly.interfaces.e1
        angles = np.arctan2(tangent[:, 1], tangent[:, 0])
        return _different(np.concatenate([angles, angles + np.pi]))[:_TURNS]

    def blocking(self, of: Ints, count: int) -> Bools:
        """Return a table (k, b, b): in a direction of `turns`, block i meets block j.

        of: (n,) block of each element. count: number b of blocks.
        """
        row = of[self.owner]
        table = np.array([self.of(piece) for piece in range(len(self.owner))])
        blocks = np.zeros((len(self.turns), count, count), dtype=bool)
        step = max(1, _CHUNK // max(1, table[:, :, 0].size))
        holds = np.zeros((len(row), count), dtype=np.float32)
        holds[np.arange(len(row)), row] = 1.0
        for first in range(0, len(self.turns), step):
            angle = self.turns[first : first + step, None, None]
            # angles that differ by less than 1e-6 are equal: an arc blocks directions inside it by more than that
            inside = (angle - table[:, :, 0] - 1e-6) % (2.0 * np.pi) < table[:, :, 1] - 2e-6
            blocks[first : first + step] = (holds.T @ inside.astype(np.float32) @ holds) > 0.0
        blocks[:, np.arange(count), np.arange(count)] = False
        return blocks


def _reduce_angles(angle: Floats | float) -> Floats:
    """Reduce angles of any shape to −π … π, radians."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _nearest(angle: float, middle: Floats | float, half: Floats | float) -> Floats:
    """Return the angle nearest to the wanted one in each interval (middle ± half)."""
    return np.asarray(middle + np.clip(_reduce_angles(angle - middle), -half, half))


def _different(angles: Floats) -> Floats:
    """Reduce angles to [0, 2π) and drop those that are equal when rounded to 1e-6."""
    # the order is that of the rounded angles modulo 2π: one just below 2π counts as 0 and may come first
    angles = angles % (2.0 * np.pi)
    _, first = np.unique(np.round(angles, 6) % round(2.0 * np.pi, 6), return_index=True)
    return angles[first]


def _convex_pieces(shape: Floats) -> list[Floats]:
    """Split a polygon (k, 2) into convex polygons: itself if convex, else triangles."""
    edge = np.roll(shape, -1, axis=0) - shape
    turn = edge[:, 0] * np.roll(edge, -1, axis=0)[:, 1] - edge[:, 1] * np.roll(edge, -1, axis=0)[:, 0]
    size = float(abs(edge).max())
    if turn.min() >= -1e-9 * size * size:
        return [shape]
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(shape)))
    return [shapely.get_coordinates(part)[:3] for part in parts]


@dataclass(frozen=True)
class Blocks:
    """Blocks of a labelling, numbered by their first element; all supports form one fixed block."""

    assembly: Assembly
    of: Ints  # (n,) block of each element
    fixed: Bools  # (k,) True for the block that holds the supports
    # first, second: (c,) blocks on both sides of each contact between two blocks
    first: Ints
    second: Ints
    normal: Floats  # (c, d) unit normals from the first to the second block

    def __len__(self) -> int:
        return len(self.fixed)

    def elements(self, block: int) -> Ints:
        return np.flatnonzero(self.of == block)

    def name(self, block: int) -> str:
        return self.assembly.elements.ids[int(self.elements(block)[0])]

    def contacts_of(self, block: int) -> tuple[Ints, Floats]:
        """Return the neighbour across each contact of a block (c,), and unit normals (c, d) to it."""
        out, back = self.first == block, self.second == block
        return (
            np.concatenate([self.second[out], self.first[back]]),
            np.concatenate([self.normal[out], -self.normal[back]]),
        )


def blocks_of_labelling(assembly: Assembly, labels: Bits) -> Blocks:
    """Return the blocks of labels (m,) as rigid bodies, with the contacts between them."""
    faces, elements = assembly.interfaces, assembly.elements
    ground = np.flatnonzero(elements.support)
    of = blocks_of(assembly, labels, (ground[:-1], ground[1:]))
    fixed = np.zeros(int(of.max()) + 1, dtype=bool)
    fixed[of[elements.support]] = True
    between = np.flatnonzero(of[faces.a] != of[faces.b])
    return Blocks(assembly, of, fixed, of[faces.a[between]], of[faces.b[between]], faces.normal[between])


_TURN: Final = 1e-7  # sine of the angle by which a direction may point into a contact: accuracy of normals in drawings

_DIRECTIONS: Final = 400  # largest number of directions in space that are tried for a block or a group


_SIDEWAYS: Final = (0.0, 0.0, 1.0)  # direction out of the plane of a planar wall


class Bodies:
    """Data on translations of the elements of an assembly, shared by all its labellings."""

    def __init__(self, assembly: Assembly, sideways: bool = False) -> None:
        # sideways: blocks of a planar wall may leave it out of its plane
        self.assembly = assembly
        self.sideways = sideways and assembly.dimension == 2
        weight = assembly.elements.weight.sum(axis=0)
        up = -weight if np.any(weight) else np.eye(assembly.dimension)[-1]
        self.up: Floats = up / np.linalg.norm(up)
        self._directions_of: dict[bytes, Floats] = {}

    @cached_property
    def arcs(self) -> Arcs:
        """Directions in which pairs of elements block each other, in the plane."""
        return Arcs(self.assembly)

    @cached_property
    def solids(self) -> Solids:
        """Sweep tests between the elements, in space."""
        return Solids(self.assembly)

    @cached_property
    def common(self) -> Floats:
        """Unit directions in space (k, 3) that are tried for groups."""
        return _directions(self.assembly.interfaces.normal)

    def ways_of(self, moving: Bools) -> Floats:
        """Return the unit directions in space (k, 3) that are tried for a block (n,), upward first."""
        # They follow from the block's own contacts and from the assembly, never from other blocks present: a block that
        # can be removed can still be removed when fewer remain, and blocks that lock one another always do.
        key = np.packbits(moving).tobytes()
        if key not in self._directions_of:
            faces = self.assembly.interfaces
            border = moving[faces.a] != moving[faces.b]
            every = np.concatenate([_directions(faces.normal[border]), self.common])
            every = every[np.sort(np.unique(np.round(every, 9), axis=0, return_index=True)[1])]
            self._directions_of[key] = every[np.argsort(-np.round(every @ self.up, 6), kind="stable")]
        return self._directions_of[key]


class Freedom:
    """Tests in which directions the blocks of one labelling can be translated away."""

    def __init__(self, blocks: Blocks, sideways: bool = False, bodies: Bodies | None = None) -> None:
        self.blocks = blocks
        self.bodies = bodies or Bodies(blocks.assembly, sideways)
        self.sideways = self.bodies.sideways
        self._planar = blocks.assembly.dimension == 2
        self._apart: dict[bytes, bool] = {}

    def way_out(self, block: int, there: Bools) -> Floats | None:
        """Return the unit direction nearest to upward in which a block can leave those in `there`, or None."""
        # there: (k,) mask of the blocks present. The direction is (d,), or (3,) for out of the plane.
        checkpoint()
        if self.sideways:
            return np.array(_SIDEWAYS)
        of = self.blocks.of
        moving, fixed = of == block, there[of] & (of != block)
        if self._planar:
            return self.bodies.arcs.way_out(moving, fixed, self.bodies.up)
        others, normals = self.blocks.contacts_of(block)
        touching = normals[there[others] & (others != block)]
        directions = self.bodies.ways_of(moving)
        directions = directions[(directions @ touching.T).max(axis=1, initial=-np.inf) <= _TURN]
        elements, still = np.flatnonzero(moving), np.flatnonzero(fixed)
        anyone = np.zeros(len(self.bodies.solids.size), dtype=np.int64)
        swept = self.bodies.solids.swept
        free = (direction for direction in directions if not len(swept(elements, still, direction, anyone)))
        return next(free, None)

    def group_out(self, there: Bools, most: int) -> tuple[Ints, Floats] | None:
        """Return the smallest group of at most `most` blocks that can leave `there` (k,) together, or None.

        It comes as blocks, ascending, and a unit direction (d,).
        """
        # in space the group must come apart afterwards; blocks of a planar wall are put together from the side
        return next((group for group in self._groups(there, most) if self._planar or self._separable(group[0])), None)

    def _groups(self, there: Bools, most: int) -> list[tuple[Ints, Floats]]:
        """Return the smallest group that must leave with each block, in each direction, smaller ones first.

        there: (k,) mask of the blocks present. most: largest size of a group.
        """
        # a group is a block with all that it meets along a direction, and all that these meet
        blocks = self.blocks
        if not self._planar and not self._loose(there):
            return []
        directions, obstructs, swept = self._blocking
        present = np.flatnonzero(there)
        fixed = blocks.fixed[present]
        groups: dict[bytes, tuple[Ints, Floats]] = {}
        step = max(1, _CHUNK // max(1, len(present) ** 2))

        def reach_and_free(numbers: Ints) -> tuple[Bools, Bools]:
            """Return what each block takes along (w, s, s) in directions (w,), and those (w, s) that leave."""
            reach = _transitive_closure(obstructs[numbers][:, present][:, :, present])
            return reach, (reach.sum(axis=2) <= most) & ~reach[:, :, fixed].any(axis=2)

        for first in range(0, len(directions), step):
            numbers = np.arange(first, min(first + step, len(directions)))
            reach, free_pairs = reach_and_free(numbers)
            # sweeps only take groups away, so they are made where contacts leave some, until all in a group are swept
            for row in np.flatnonzero(free_pairs.any(axis=1)).tolist() if not self._planar else ():
                number = numbers[row]
                while len(todo := present[reach[row][free_pairs[row]].any(axis=0) & ~swept[number, present]]):
                    for block in todo.tolist():
                        self._sweep(number, block)
                    row_reach, row_free = reach_and_free(numbers[row : row + 1])
                    reach[row], free_pairs[row] = row_reach[0], row_free[0]
            for direction_number, row in zip(*np.nonzero(free_pairs), strict=True):
                group = present[reach[direction_number, row]]
                groups.setdefault(group.tobytes(), (group, directions[first + direction_number]))
        return sorted(groups.values(), key=lambda entry: (len(entry[0]), entry[0].tolist()))

    def _loose(self, there: Bools) -> bool:
        """Return whether some blocks of `there` (k,) may begin to move apart, each by a translation of its own."""
        blocks = self.blocks
        standing = there[blocks.first] & there[blocks.second]
        first, second, normal = blocks.first[standing], blocks.second[standing], blocks.normal[standing]
        if len(first):
            pairs = np.column_stack([first, second, np.round(normal, 9)])
            once = np.unique(pairs, axis=0, return_index=True)[1]
            first, second, normal = first[once], second[once], normal[once]
        free = np.flatnonzero(there & ~blocks.fixed)
        if not len(free) or not len(first):
            return True
        # without a support, one block is at rest: what moves, moves apart
        free = free if np.any(there & blocks.fixed) else free[1:]
        position = np.full(len(blocks), -1)
        position[free] = np.arange(len(free))
        rows = np.zeros((len(first), len(free) + 1, 3))
        rows[np.arange(len(first)), position[first]] += normal
        rows[np.arange(len(first)), position[second]] -= normal
        matrix = rows[:, :-1].reshape(len(first), -1)
        from scipy.optimize import linprog

        for row in np.concatenate([np.eye(matrix.shape[1]), -np.eye(matrix.shape[1])]):
            checkpoint()
            # a group that moves does so at unit speed, .57 or more along some axis
            answer = linprog(-row, A_ub=matrix, b_ub=np.full(len(matrix), _TURN), bounds=(-1.0, 1.0))
            if answer.x is None or float(row @ answer.x) > 0.5:
                return True
        return False

    def _separable(self, group: Ints) -> bool:
        """Return whether the blocks of a group can be moved apart."""
        if len(group) < 2:
            return True
        key = group.tobytes()
        if key not in self._apart:
            in_group = np.zeros(len(self.blocks), dtype=bool)
            in_group[group] = True
            parts = [part for part, _ in self._groups(in_group, len(group) - 1)]
            # the order of removal is irrelevant: fewer obstacles remain later
            others = None if not parts else np.setdiff1d(group, parts[0])
            self._apart[key] = others is not None and self._separable(parts[0]) and self._separable(others)
        return self._apart[key]

    @cached_property
    def _blocking(self) -> tuple[Floats, Bools, Bools]:
        """Directions (k, d), which blocks obstruct which (k, b, b), and which rows (k, b) of it are complete."""
        # Entry (direction, i, j) is True where block i, moved along the direction, meets block j. In space, rows hold
        # contacts until `_sweep` adds the rest.
        blocks, count = self.blocks, len(self.blocks)
        if self._planar:
            angle = self.bodies.arcs.turns
            obstructs = self.bodies.arcs.blocking(blocks.of, count)
            return np.column_stack([np.cos(angle), np.sin(angle)]), obstructs, np.ones(obstructs.shape[:2], dtype=bool)
        directions = self.bodies.common
        obstructs = np.zeros((len(directions), count, count), dtype=bool)
        towards = blocks.normal @ directions.T
        for face, number in zip(*np.nonzero(abs(towards) > _TURN), strict=True):
            ends = (blocks.first[face], blocks.second[face])
            obstructs[(number, *(ends if towards[face, number] > 0.0 else ends[::-1]))] = True
        return directions, obstructs, np.repeat(blocks.fixed[None], len(directions), axis=0)

    def _sweep(self, number: int, block: int) -> None:
        """Add the blocks that one in space meets along a direction to the table of those that obstruct it."""
        directions, obstructs, swept = self._blocking
        swept[number, block] = True
        moving = self.blocks.of == block
        others = np.flatnonzero(~moving & ~obstructs[number, block][self.blocks.of])
        met = self.bodies.solids.swept(np.flatnonzero(moving), others, directions[number], self.blocks.of)
        obstructs[number, block, met] = True


def _transitive_closure(arrows: Bools) -> Bools:
    """Return the reflexive transitive closure (k, b, b) of directed graphs (k, b, b)."""
    reach = np.asarray(arrows | np.eye(arrows.shape[1], dtype=bool))
    while True:
        wide = reach.astype(np.float32)
        wider = np.asarray((wide @ wide) > 0.0)
        if np.array_equal(wider, reach):
            return reach
        reach = wider


def _directions(normals: Floats) -> Floats:
    """Return candidate unit directions in space (k, 3) derived from contact normals (c, 3)."""
    # Candidates are the normals, the intersection lines of contact planes, tangents, and the bisectors of these.
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
