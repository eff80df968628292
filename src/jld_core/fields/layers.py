"""Long and flat cells, cut in layers by planes before they are filled with tetrahedra.

Fans about their centroid have no planes at 45° to edges, where blocks shear, and none in the middle of the depth, where
bending changes sign. Bricks of the smallest width at the ends have both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.mesh import merged, ring_of
from jld_core.geometry import facets_of
from jld_core.geometry.polyhedra import FacetFrames, Facets


@dataclass(frozen=True)
class Facet:
    """Plane face of a free cell."""

    cell: int  # element
    origin: Floats  # (3,) point of the plane
    normal: Floats  # (3,) outward unit vector
    # e1, e2: (3,) unit vectors of the plane
    e1: Floats
    e2: Floats
    ring: Ints  # (k,) nodes of the outline, counter-clockwise from outside
    faces: tuple[int, ...]  # interfaces on it

    def flat(self, places: Floats) -> Floats:
        arm = places - self.origin
        return np.column_stack([arm @ self.e1, arm @ self.e2])

    def placed(self, flat: Floats) -> Floats:
        return np.asarray(self.origin + flat[:, :1] * self.e1 + flat[:, 1:] * self.e2)


@dataclass(frozen=True)
class Patch:
    """Part of a facet that carries a live traction."""

    facet: int  # index of the facet
    rings: tuple[Floats, ...]  # corners (k, 3) of the outline, then of each hole, scene units


@dataclass(frozen=True)
class Surface:
    """Surfaces of all free cells, cut along interfaces and load patches, over common nodes."""

    points: Floats  # (p, 3) nodes, scene units
    facets: tuple[Facet, ...]  # facets of all free cells
    faces: tuple[Ints | None, ...]  # nodes of the outline of each of the m interfaces, None between two supports
    # for each load patch its facet, and the nodes of its outline and holes
    patches: tuple[tuple[int, tuple[Ints, ...]], ...]
    reach: float  # distance up to which two points count as one node, scene units

    def covered(self, facet: Facet) -> list[shapely.Polygon]:
        """Return the interfaces on a facet as polygons, in the coordinates of `Facet.flat`."""
        return [
            shapely.Polygon(facet.flat(self.points[ring])) for f in facet.faces if (ring := self.faces[f]) is not None
        ]

    def free(self, facet: Facet) -> list[shapely.Polygon]:
        """Return the regions of a facet outside its interfaces, without slivers thinner than about `reach`."""
        whole = shapely.Polygon(facet.flat(self.points[facet.ring]))
        rest = shapely.difference(whole, shapely.union_all(self.covered(facet)))
        return [part for part in shapely.get_parts(rest) if part.area > self.reach * part.length]

    def loaded(self, index: int) -> list[shapely.Polygon]:
        """Return the load patches on facet number `index` as polygons in the plane."""
        flat = self.facets[index].flat
        rings = [[flat(self.points[ring]) for ring in loops] for place, loops in self.patches if place == index]
        return [shapely.Polygon(outer, holes) for outer, *holes in rings]


def surface_of(assembly: Assembly, patches: tuple[Patch, ...] = (), more: Floats | None = None) -> Surface:
    """Return the surfaces of the free cells, with nodes at `more` places (k, 3).

    InputError unless convex, with plane faces.
    """
    elements, faces = assembly.elements, assembly.interfaces
    free = elements.free
    facets = facets_of([elements.shape[k] for k in free], [elements.faces[k] for k in free])
    reach = 2.0 * tolerances.FACE * float(np.ptp(np.array([elements.lower[free], elements.upper[free]]), axis=0).min())
    _require_convex(assembly, facets, reach)
    # outlines of facets, then of interfaces, then those of patches
    loops = [facet_loops[0] for facet_loops in facets.loops]
    outlines = [*loops, *faces.polygon, *(ring for patch in patches for ring in patch.rings)]
    points, number = merged(np.concatenate([*outlines, np.zeros((0, 3)) if more is None else more]), reach)
    nodes = np.split(number, np.cumsum([len(outline) for outline in outlines]))[:-1]
    near = cKDTree(points)
    rings = [ring_of(points, near, corners, reach) for corners in nodes]
    of_faces, of_patches = rings[len(loops) : len(loops) + len(faces)], iter(rings[len(loops) + len(faces) :])
    frames = FacetFrames.on(facets)
    made = []
    for index in range(len(facets)):
        cell = int(free[facets.element[index]])
        origin, normal = facets.origin[index], facets.normal[index]
        on = []
        for face in np.flatnonzero((faces.a == cell) | (faces.b == cell)).tolist():
            outward = faces.normal[face] if faces.a[face] == cell else -faces.normal[face]
            off = abs((points[of_faces[face]] - origin) @ normal).max()
            if outward @ normal > _SAME_WAY and off <= 2.0 * reach:
                on.append(face)
        made.append(Facet(cell, origin, normal, frames.e1[index], frames.e2[index], rings[index], tuple(on)))
    between_supports = elements.support[faces.a] & elements.support[faces.b]
    stated = tuple(None if skip else ring for ring, skip in zip(of_faces, between_supports, strict=True))
    placed = tuple((patch.facet, tuple(next(of_patches) for _ in patch.rings)) for patch in patches)
    return Surface(points, tuple(made), stated, placed, reach)


def _require_convex(assembly: Assembly, facets: Facets, reach: float) -> None:
    elements = assembly.elements
    for index in range(len(facets)):
        cell = int(elements.free[facets.element[index]])
        origin, normal = facets.origin[index], facets.normal[index]
        # no corner of the cell lies before a facet, and none of the facet behind its plane
        height, of_facet = (elements.shape[cell] - origin) @ normal, (facets.loops[index][0] - origin) @ normal
        if len(facets.loops[index]) > 1 or height.max() > reach or of_facet.min() < -reach:
            raise InputError(
                f"element {elements.ids[cell]!r}",
                "fields in space fill convex cells with plane faces, and it is none",
                "a convex element, or several of them",
            )


_SAME_WAY = 0.5  # cosine above which an interface and a facet look the same way

_TWICE = 2.0 - 1e-6  # least ratio of the width of a cell to the size of its end at which it is cut in the middle

# Least ratio of the width of a cell to the size of its end at which it is cut at that size from both ends
_THRICE = 3.0 - 1e-6

_DIGITS = 9  # decimal digits to which places of planes are compared

_SNAP = 0.3  # distance, relative to the size of the end, within which a plane is moved to a node

_OPPOSITE = -0.7  # cosine between outward normals of two facets below which they are ends of their cell


@dataclass(frozen=True)
class Part:
    """Convex part of a cell that planes cut.

    side: (k,) True where the part lies beyond a plane, in the direction of its normal. skin: pairs of facet and outline
    (c, 3), for faces on facets of the cell. caps: pairs of plane and outline (c, 3), for faces on planes. Outlines are
    in scene units.
    """

    side: tuple[bool, ...]
    skin: tuple[tuple[int, Floats], ...]
    caps: tuple[tuple[int, Floats], ...]


@dataclass(frozen=True)
class Layers:
    """Planes that cut one cell into layers, and the parts between them."""

    normal: Floats  # (k, 3) unit normals n
    offset: Floats  # (k,) distances d of the planes n·x = d, scene units
    parts: tuple[Part, ...]  # the convex parts, which fill the cell

    def side(self, place: Floats) -> tuple[bool, ...]:
        """Return for each of k planes whether a place (3,) lies beyond it, as `Part.side` of the part that holds it."""
        return tuple((self.normal @ place > self.offset).tolist())


def layers_of(surface: Surface, cell: int) -> Layers | None:
    """Cut a cell of width w between opposite facets of size s: at s from both if w ≥ 3 s, half way if w ≥ 2 s.

    None for others.
    """
    facets = [index for index, facet in enumerate(surface.facets) if facet.cell == cell]
    normals = np.array([surface.facets[index].normal for index in facets])
    cosine = normals @ normals.T
    across = cosine.argmin(axis=1)
    nodes = _nodes(surface, facets)
    planes: list[tuple[Floats, float]] = []
    for i, j in enumerate(across.tolist()):
        # facets that are each other's most opposite one
        if i < j and across[j] == i and cosine[i, j] < _OPPOSITE:
            planes += _planes(surface, surface.facets[facets[i]], surface.facets[facets[j]], nodes)
    if not planes:
        return None
    parts = [Part((), tuple((k, surface.points[surface.facets[k].ring]) for k in facets), ())]
    for number, (normal, offset) in enumerate(planes):
        parts = [half for part in parts for half in _halves(part, number, normal, offset, surface.reach)]
    return Layers(np.array([n for n, _ in planes]), np.array([d for _, d in planes]), tuple(parts))


def corners_of(surface: Surface, layers: dict[int, Layers]) -> Floats:
    """Return the points (k, 3) where layered cells need nodes, scene units; some repeat."""
    # The points are the corners of the cells' parts, and of the pieces of interfaces, load patches and free regions on
    # their facets.
    places = [outline for one in layers.values() for part in one.parts for _, outline in (*part.skin, *part.caps)]
    for index, facet in enumerate(surface.facets):
        if facet.cell not in layers:
            continue
        cut_regions = [
            piece
            for face, region in zip(facet.faces, surface.covered(facet), strict=True)
            for piece in pieces(surface, index, region, layers, face)
        ]
        for region in (*surface.free(facet), *surface.loaded(index)):
            cut_regions += pieces(surface, index, region, layers)
        places += [facet.placed(shapely.get_coordinates(piece)) for piece in cut_regions]
    return np.concatenate(places)


def pieces(
    surface: Surface, index: int, region: shapely.Polygon, layers: dict[int, Layers], face: int | None = None
) -> list[shapely.Polygon]:
    """Cut a region along the parts of its cell, and of both cells at an interface; without slivers."""
    facet, cut = surface.facets[index], [region]
    on_both_sides = [k for k, facet in enumerate(surface.facets) if face is not None and face in facet.faces]
    for place in on_both_sides or [index]:
        cell = surface.facets[place].cell
        if cell not in layers:
            continue
        outlines = [outline for part in layers[cell].parts for name, outline in part.skin if name == place]
        cutters = [shapely.Polygon(facet.flat(outline)) for outline in outlines]
        parts = [shapely.intersection(piece, cutter) for piece in cut for cutter in cutters]
        cut = [
            _without_straight_corners(piece, surface.reach)
            for part in parts
            for piece in shapely.get_parts(part).tolist()
            if piece.geom_type == "Polygon" and piece.area > surface.reach * piece.length
        ]
    return cut


def _without_straight_corners(region: shapely.Polygon, reach: float) -> shapely.Polygon:
    plain = shapely.simplify(region, reach)
    corners = shapely.get_coordinates(plain.exterior)[:-1]
    along = corners[1] - corners[-1]
    off = abs(float(np.linalg.det([along, corners[0] - corners[-1]]))) / float(np.linalg.norm(along))
    # the first corner is never simplified away
    return shapely.Polygon(corners[1:], plain.interiors) if off <= reach and len(corners) > 3 else plain


def _nodes(surface: Surface, facets: list[int]) -> Floats:
    """Return the nodes (k, 3) of facets, and of the interfaces and load patches on them."""
    rings: list[Ints] = []
    for index in facets:
        facet = surface.facets[index]
        rings += [facet.ring, *(ring for f in facet.faces if (ring := surface.faces[f]) is not None)]
        rings += [ring for place, loops in surface.patches if place == index for ring in loops]
    return surface.points[np.unique(np.concatenate(rings))]


def _planes(surface: Surface, one: Facet, other: Facet, nodes: Floats) -> list[tuple[Floats, float]]:
    """Return the planes, unit normal (3,) and offset, that cut a long or flat cell between two facets."""

    # Where the facets lean, all planes meet in one line; a plane close to a node is moved to it.
    def share(places: Floats) -> Floats:  # of the way from one facet to the other
        near, far = (one.origin - places) @ one.normal, (other.origin - places) @ other.normal
        return np.asarray(near / (near + far))

    middle = nodes.mean(axis=0)
    width = float((one.origin - middle) @ one.normal + (other.origin - middle) @ other.normal)
    side = max(_smaller_side(surface, one), _smaller_side(surface, other))
    if width >= _THRICE * side:
        places = [side / width, 1.0 - side / width]
    else:
        places = [0.5] if width >= _TWICE * side else []
    known = np.unique(np.round(share(nodes), _DIGITS))
    planes = []
    for place in places:
        nearest = float(known[np.argmin(np.round(abs(known - place), _DIGITS))])
        at = nearest if abs(nearest - place) * width <= _SNAP * side else place
        normal = at * other.normal - (1.0 - at) * one.normal
        size = float(np.linalg.norm(normal))
        offset = at * float(other.origin @ other.normal) - (1.0 - at) * float(one.origin @ one.normal)
        planes.append((normal / size, offset / size))
    return planes


def _smaller_side(surface: Surface, facet: Facet) -> float:
    frame = shapely.minimum_rotated_rectangle(shapely.Polygon(facet.flat(surface.points[facet.ring])))
    corners = shapely.get_coordinates(frame)
    return float(np.linalg.norm(np.diff(corners[:3], axis=0), axis=1).min())


def _halves(part: Part, number: int, normal: Floats, offset: float, reach: float) -> list[Part]:
    """Cut a part by plane `number`: its two halves, or the part alone if it lies on one side."""
    skins: tuple[list[tuple[int, Floats]], ...] = ([], [])
    caps: tuple[list[tuple[int, Floats]], ...] = ([], [])
    on_plane: list[Floats] = []
    for source, target in ((part.skin, skins), (part.caps, caps)):
        for name, outline in source:
            for half, (piece, edge) in enumerate(_clipped(outline, normal, offset, reach)):
                on_plane.append(edge)
                if len(piece) > 2:
                    target[half].append((name, piece))
    for half in (0, 1):
        if not skins[half] and not caps[half]:
            return [Part((*part.side, half == 0), part.skin, part.caps)]
    cap = _convex(np.concatenate(on_plane), normal, reach)
    return [Part((*part.side, bool(half)), tuple(skins[half]), (*caps[half], (number, cap))) for half in (0, 1)]


def _clipped(outline: Floats, normal: Floats, offset: float, reach: float) -> list[tuple[Floats, Floats]]:
    """Cut a convex outline (c, 3) by a plane: pieces (c, 3) before and beyond it, with their points on it (j, 3)."""
    height = outline @ normal - offset
    height = np.where(abs(height) <= reach, 0.0, height)
    after, next_height = np.roll(outline, -1, axis=0), np.roll(height, -1)
    halves = []
    for sign in (-1.0, 1.0):
        piece, edge = [], []
        for a, b, h, k in zip(outline, after, height, next_height, strict=True):
            if sign * h >= 0.0:
                piece.append(a)
                if h == 0.0:
                    edge.append(a)
            if h * k < 0.0:
                piece.append(a + (b - a) * (h / (h - k)))
                edge.append(piece[-1])
        inside = bool((sign * height > 0.0).any())
        halves.append((np.array(piece) if inside else np.zeros((0, 3)), np.array(edge).reshape(-1, 3)))
    return halves


def _convex(places: Floats, normal: Floats, reach: float) -> Floats:
    """Order the corners (k, 3) of a convex polygon counter-clockwise and merge repeated ones."""
    e1 = np.cross(normal, np.eye(3)[np.argmin(abs(normal))])
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(normal, e1)
    away = places - places.mean(axis=0)
    angle = np.arctan2(away @ e2, away @ e1)
    ordered = places[np.argsort(angle)]
    apart = np.linalg.norm(ordered - np.roll(ordered, 1, axis=0), axis=1) > reach
    return ordered[apart] if apart.any() else ordered[:1]
