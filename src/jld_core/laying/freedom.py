"""Which blocks can be moved away by a translation, and what stands in their way.

A direction d frees a block from what it touches where d·n ≤ 0 for every contact, n the normal towards the other: the
directions that free it are a cone. Along one direction to infinity a block is blocked by every other that the volume
it sweeps meets. Blocks and what blocks them are a directed graph for each direction; a set that no arrow leaves can
be taken out together. Source: Wilson & Latombe, Geometric reasoning about mechanical assembly, Artificial
Intelligence 71 (1994) 371–396.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, Final

import numpy as np
import shapely
from scipy.optimize import linprog
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Elements
from jld_core.laying.blocks import Blocks

_TURN: Final = 1e-7
"""Sine by which a direction may point into a contact: what the normals of a drawing leave."""

_SHARED: Final = 1e-6
"""Area or depth, relative to the smaller block, that a sweep may share with another block: rounding of contacts."""

_DIRECTIONS: Final = 400
"""Directions that are tried for a block or a group at the most."""


class Freedom:
    """Translations of the blocks of one labelling. sideways: planar walls may be taken apart out of their plane."""

    def __init__(self, blocks: Blocks, sideways: bool = False) -> None:
        self.blocks = blocks
        self.sideways = sideways and blocks.assembly.dimension == 2
        self._bodies: Bodies = _Plates(blocks) if blocks.assembly.dimension == 2 else _Solids(blocks)
        weight = blocks.assembly.elements.weight.sum(axis=0)
        self._up = -weight if np.any(weight) else np.eye(blocks.assembly.dimension)[-1]
        self._swept: dict[tuple[int, tuple[float, ...]], Ints] = {}

    def directions_of(self, normals: Floats) -> Floats:
        """Unit directions (k, d) that leave contacts with these normals (c, d): the cone's edges and its middle."""
        d = self.blocks.assembly.dimension
        if not len(normals):
            return np.concatenate([np.eye(d), -np.eye(d)])
        normals = np.unique(np.round(normals, 9), axis=0)
        tried = [-normals]
        if d == 2:
            tangent = np.column_stack([-normals[:, 1], normals[:, 0]])
            tried += [tangent, -tangent]
        else:
            i, j = np.triu_indices(len(normals), 1)
            cross = np.cross(normals[i], normals[j])
            length = np.linalg.norm(cross, axis=1)
            cross = cross[length > 1e-6] / length[length > 1e-6, None]
            tried += [cross, -cross, *(_tangents(normal) for normal in normals[:8])]
        every = np.concatenate(tried)
        free: Floats = every[(every @ normals.T).max(axis=1) <= _TURN]
        if not len(free):
            return np.asarray(free)
        middle = free.sum(axis=0)
        if np.linalg.norm(middle) > 1e-6:
            middle = middle / np.linalg.norm(middle)
            if (normals @ middle).max() <= _TURN:
                # out of the middle of the cone first: it leaves every contact at once
                between = free + middle
                size = np.linalg.norm(between, axis=1)
                free = np.concatenate([middle[None], between[size > 1e-6] / size[size > 1e-6, None], free])
        return np.asarray(free[np.sort(np.unique(np.round(free, 9), axis=0, return_index=True)[1])][:_DIRECTIONS])

    def way_out(self, block: int, there: Bools) -> tuple[Floats | None, set[int]]:
        """A direction (d,) along which one block leaves the others that are there (k,), or None; and what blocks it.

        Out of the plane the direction is the third unit vector.
        """
        if self.sideways:
            return np.array([0.0, 0.0, 1.0]), set()
        others, normals = self.blocks.contacts_of(block)
        touching = there[others]
        blockers: set[int] = set(others[touching].tolist())
        free = self.directions_of(normals[touching])
        # from above where that can be: a way against the weight needs no hands below
        for direction in free[np.argsort(-np.round(free @ self._up, 6), kind="stable")]:
            hit = self.swept(block, direction)
            hit = hit[there[hit]]
            if not len(hit):
                return direction, set()
            blockers |= set(hit.tolist())
        return None, blockers

    def swept(self, block: int, direction: Floats) -> Ints:
        """Blocks that the volume meets which a block sweeps along a direction to infinity."""
        key = (block, tuple(np.round(direction, 12).tolist()))
        if key not in self._swept:
            self._swept[key] = self._bodies.swept(block, direction)
        return self._swept[key]

    def group_out(self, there: Bools, most: int) -> tuple[Ints, Floats] | None:
        """The smallest group of at most so many blocks that leaves the others together, and its direction.

        there: (k,) blocks not yet taken away, fixed ones among them. None where there is none.
        """
        alive = np.flatnonzero(there & ~self.blocks.fixed)
        best: tuple[Ints, Floats] | None = None
        for direction in self._common_directions(there):
            sources, targets = self._blocking(direction, there)
            count = len(self.blocks)
            graph = coo_array((np.ones(len(sources)), (sources, targets)), shape=(count, count))
            _, part = connected_components(graph, directed=True, connection="strong")
            leaves = np.ones(count, dtype=bool)
            leaves[part[sources[part[sources] != part[targets]]]] = False
            leaves[part[self.blocks.fixed]] = False
            for name in np.unique(part[alive]):
                group = alive[part[alive] == name]
                if leaves[name] and len(group) <= most and (best is None or len(group) < len(best[0])):
                    best = group, direction
        return best

    def _common_directions(self, there: Bools) -> Floats:
        """Directions at which the graph of blocking changes, and those between them."""
        kept = there[self.blocks.first] & there[self.blocks.second]
        normals = self.blocks.normal[kept]
        if self.blocks.assembly.dimension == 3:
            both = np.unique(np.round(np.concatenate([normals, -normals]), 9), axis=0)
            i, j = np.triu_indices(len(both), 1)
            cross = np.cross(both[i], both[j])
            length = np.linalg.norm(cross, axis=1)
            every = np.concatenate([both, cross[length > 1e-6] / length[length > 1e-6, None]])
            return np.unique(np.round(every, 9), axis=0)[:_DIRECTIONS]
        tangent = np.arctan2(normals[:, 0], -normals[:, 1])
        angle = np.unique(np.round(np.concatenate([tangent, tangent + np.pi]) % (2.0 * np.pi), 9))
        if not len(angle):
            return np.concatenate([np.eye(2), -np.eye(2)])
        between = 0.5 * (angle + np.append(angle[1:], angle[0] + 2.0 * np.pi))
        every = np.concatenate([angle, between])[:_DIRECTIONS]
        return np.column_stack([np.cos(every), np.sin(every)])

    def _blocking(self, direction: Floats, there: Bools) -> tuple[Ints, Ints]:
        """Arrows of the blocking graph among the blocks that are there: who is blocked, and by whom."""
        blocks = self.blocks
        kept = there[blocks.first] & there[blocks.second]
        towards = blocks.normal[kept] @ direction
        first, second = blocks.first[kept], blocks.second[kept]
        sources = [first[towards > _TURN], second[towards < -_TURN]]
        targets = [second[towards > _TURN], first[towards < -_TURN]]
        for block in np.flatnonzero(there & ~blocks.fixed).tolist():
            hit = self.swept(block, direction)
            hit = hit[there[hit]]
            sources.append(np.full(len(hit), block))
            targets.append(hit)
        return np.concatenate(sources), np.concatenate(targets)


class Bodies:
    """Shapes of blocks that can be swept."""

    def swept(self, block: int, direction: Floats) -> Ints:
        """Other blocks met by what a block sweeps along a unit direction to infinity."""
        raise NotImplementedError


class _Plates(Bodies):
    """Planar blocks, each the union of its elements."""

    def __init__(self, blocks: Blocks) -> None:
        assembly = blocks.assembly
        self.far = 4.0 * assembly.size
        self.region = [
            shapely.union_all([shapely.Polygon(assembly.elements.shape[e]) for e in blocks.elements(k)])
            for k in range(len(blocks))
        ]
        self.area = shapely.area(self.region)
        self.tree = shapely.STRtree(self.region)

    def swept(self, block: int, direction: Floats) -> Ints:
        step = self.far * direction
        parts: list[Any] = [self.region[block]]
        for part in shapely.get_parts(self.region[block]):
            for ring in [part.exterior, *part.interiors]:
                corners = shapely.get_coordinates(ring)
                quads = np.stack([corners[:-1], corners[1:], corners[1:] + step, corners[:-1] + step], axis=1)
                shapes = shapely.polygons(quads)
                parts += list(shapes[shapely.area(shapes) > 0.0])
        near = self.tree.query(shapely.union_all(parts))
        volume = shapely.union_all(parts)
        near = near[near != block]
        shared = shapely.area(shapely.intersection(volume, np.array(self.region, dtype=object)[near]))
        return np.sort(near[shared > _SHARED * np.minimum(self.area[near], self.area[block])]).astype(np.int64)


class _Solids(Bodies):
    """Spatial blocks, each a set of elements; one that is not convex is its skin of triangles to what moves past it.

    Where both a moving and a resting element are not convex the moving one is swept as its hull.
    """

    def __init__(self, blocks: Blocks) -> None:
        elements = blocks.assembly.elements
        self.blocks, self.elements = blocks, elements
        self.size = (elements.upper - elements.lower).max(axis=1)
        hulls = [ConvexHull(corners) for corners in elements.shape]
        self.planes = [np.unique(np.round(hull.equations, 12), axis=0) for hull in hulls]
        self.convex = np.array([hull.volume for hull in hulls]) <= (1.0 + _SHARED) * _volumes(elements)

    def swept(self, block: int, direction: Floats) -> Ints:
        mine = self.blocks.elements(block)
        others = np.flatnonzero(self.blocks.of != block)
        low, high = self.elements.lower, self.elements.upper
        met: set[int] = set()
        for e in mine.tolist():
            reach = 1e-9 * self.size[e]
            # a box that can never be met, whichever way: cheap, and nearly all of them
            ahead = (high[others] > low[e] + reach) | (direction < -1e-12)
            behind = (low[others] < high[e] - reach) | (direction > 1e-12)
            for other in others[np.all(ahead & behind, axis=1)].tolist():
                if self.blocks.of[other] not in met and self._meets(e, other, direction):
                    met.add(int(self.blocks.of[other]))
        return np.array(sorted(met), dtype=np.int64)

    def _meets(self, moving: int, still: int, direction: Floats) -> bool:
        """Does one element, moved along a direction, ever share a volume with another?"""
        if self.convex[still]:
            if self.convex[moving]:
                return self._solid_meets(moving, still, direction)
            # what rests, moved the other way, past the skin of what moves
            return any(self._solid_meets_face(still, face, -direction) for face in self._skin(moving))
        return any(self._solid_meets_face(moving, face, direction) for face in self._skin(still))

    def _solid_meets(self, moving: int, still: int, direction: Floats) -> bool:
        p, q = self.planes[moving], self.planes[still]
        depth = self._depth(moving, still)
        ahead = (self.elements.shape[still] @ p[:, :3].T).min(axis=0) + p[:, 3]
        if np.any((ahead >= -depth) & (p[:, :3] @ direction <= 1e-9)):
            return False
        behind = (self.elements.shape[moving] @ q[:, :3].T).min(axis=0) + q[:, 3]
        if np.any((behind >= -depth) & (q[:, :3] @ direction >= -1e-9)):
            return False
        # a point x of the moving one and a way t with x + t·d inside the other, both by the most
        rows = np.block(
            [
                [p[:, :3], np.zeros((len(p), 1)), np.ones((len(p), 1))],
                [q[:, :3], (q[:, :3] @ direction)[:, None], np.ones((len(q), 1))],
            ]
        )
        return bool(self._inside(rows, -np.concatenate([p[:, 3], q[:, 3]]), None) > depth)

    def _solid_meets_face(self, moving: int, face: Floats, direction: Floats) -> bool:
        """The same for a triangle (3, 3): a point well inside the moving one comes to lie on it."""
        p = self.planes[moving]
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        normal = normal / np.linalg.norm(normal)
        depth = _SHARED ** (2.0 / 3.0) * float(self.size[moving])
        ahead = (face @ p[:, :3].T).min(axis=0) + p[:, 3]
        if np.any((ahead >= -depth) & (p[:, :3] @ direction <= 1e-9)):
            return False
        height = (self.elements.shape[moving] - face[0]) @ normal
        way = float(normal @ direction)
        if (height.min() >= -depth and way >= -1e-9) or (height.max() <= depth and way <= 1e-9):
            return False
        edge = np.cross(np.roll(face, -1, axis=0) - face, normal)
        rows = np.block(
            [
                [p[:, :3], np.zeros((len(p), 1)), np.ones((len(p), 1))],
                [edge, (edge @ direction)[:, None], np.zeros((3, 1))],
            ]
        )
        right = np.concatenate([-p[:, 3], np.einsum("ij,ij->i", edge, face)])
        equal = np.concatenate([normal, [way, 0.0]])[None], np.array([float(normal @ face[0])])
        return bool(self._inside(rows, right, equal) > depth)

    def _depth(self, moving: int, still: int) -> float:
        return float(_SHARED ** (2.0 / 3.0) * min(self.size[moving], self.size[still]))

    def _inside(self, rows: Floats, right: Floats, equal: tuple[Floats, Floats] | None) -> float:
        """Greatest depth, the last of the unknowns x, t ≥ 0, depth; −inf where there is none."""
        bounds = [(None, None)] * 3 + [(0.0, None), (None, float(self.size.max()))]
        matrix, values = equal or (None, None)
        answer = linprog([0.0] * 4 + [-1.0], A_ub=rows, b_ub=right, A_eq=matrix, b_eq=values, bounds=bounds)
        return -np.inf if answer.x is None else float(answer.x[4])

    def _skin(self, element: int) -> Floats:
        """(t, 3, 3) triangles of the surface of an element."""
        if element not in self._skins:
            corners = self.elements.shape[element]
            faces = [corners[list(loop)] for loop in self.elements.faces[element]]
            self._skins[element] = np.concatenate([_triangles(face) for face in faces])
        return self._skins[element]

    @cached_property
    def _skins(self) -> dict[int, Floats]:
        return {}


def _volumes(elements: Elements) -> Floats:
    """(n,) volumes of polyhedra from their faces, whatever volume a scene states."""
    found = []
    for corners, faces in zip(elements.shape, elements.faces, strict=True):
        total = 0.0
        for loop in faces:
            points = corners[list(loop)] - corners[0]
            total += float((np.cross(points[1:-1], points[2:]) @ points[0]).sum())
        found.append(abs(total) / 6.0)
    return np.array(found)


def _triangles(face: Floats) -> Floats:
    """(t, 3, 3) triangles that make up a plane polygon (k, 3)."""
    if len(face) == 3:
        return face[None]
    arm = face - face[0]
    normal = np.cross(arm, np.roll(arm, -1, axis=0)).sum(axis=0)
    across = _tangents(normal / np.linalg.norm(normal))[:2]
    flat = shapely.Polygon(arm @ across.T)
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(flat))
    return np.array([face[0] + shapely.get_coordinates(part)[:3] @ across for part in parts])


def _tangents(normal: Floats) -> Floats:
    """Four directions at right angles to a normal."""
    other = np.eye(3)[np.argmin(abs(normal))]
    one = np.cross(normal, other)
    one = one / np.linalg.norm(one)
    two = np.cross(normal, one)
    return np.array([one, two, -one, -two])
