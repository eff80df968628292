"""Loads of spatial cells as body forces and tractions with the scene's resultants, docs/method.md (9.5), (10.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial import cKDTree

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.forms import across
from jld_core.fields.loads import FieldLoads, PatchLoad, body_forces, require_cover, steepest
from jld_core.fields.mesh import Mesh, patch_tag, ring_of
from jld_core.geometry import facets_of
from jld_core.geometry.polyhedra import FacetFrames, Facets
from jld_core.linalg import merged_points
from jld_core.loads import Loads, PointForces, Traction, resultants


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
        uncovered = shapely.difference(whole, shapely.union_all(self.covered(facet)))
        return _polygons_in(uncovered, self.reach)

    def loaded(self, index: int) -> list[shapely.Polygon]:
        """Return the load patches on facet number `index` as polygons in the plane."""
        flat = self.facets[index].flat
        rings = [[flat(self.points[ring]) for ring in loops] for place, loops in self.patches if place == index]
        return [shapely.Polygon(outer, holes) for outer, *holes in rings]


def surface_of(assembly: Assembly, patches: tuple[Patch, ...] = (), extra: Floats | None = None) -> Surface:
    """Return the surfaces of the free cells, with nodes at `extra` points (k, 3); InputError for any not convex."""
    elements, faces = assembly.elements, assembly.interfaces
    free = elements.free
    facets = facets_of([elements.shape[k] for k in free], [elements.faces[k] for k in free])
    reach = 2.0 * tolerances.FACE * float(np.ptp(np.array([elements.lower[free], elements.upper[free]]), axis=0).min())
    _require_convex(assembly, facets, reach)
    # outlines of facets, then of interfaces, then those of patches
    loops = [facet_loops[0] for facet_loops in facets.loops]
    outlines = [*loops, *faces.polygon, *(ring for patch in patches for ring in patch.rings)]
    points, number = merged_points(np.concatenate([*outlines, np.zeros((0, 3)) if extra is None else extra]), reach)
    nodes = np.split(number, np.cumsum([len(outline) for outline in outlines]))[:-1]
    tree = cKDTree(points)
    rings = [ring_of(points, tree, corners, reach) for corners in nodes]
    of_faces, of_patches = rings[len(loops) : len(loops) + len(faces)], iter(rings[len(loops) + len(faces) :])
    frames = FacetFrames.on(facets)
    result = []
    for index in range(len(facets)):
        cell = int(free[facets.element[index]])
        origin, normal = facets.origin[index], facets.normal[index]
        faces_on_facet = []
        for face in np.flatnonzero((faces.a == cell) | (faces.b == cell)).tolist():
            outward = faces.normal[face] if faces.a[face] == cell else -faces.normal[face]
            distance = abs((points[of_faces[face]] - origin) @ normal).max()
            if outward @ normal > _SAME_WAY and distance <= 2.0 * reach:
                faces_on_facet.append(face)
        e1, e2 = frames.e1[index], frames.e2[index]
        result.append(Facet(cell, origin, normal, e1, e2, rings[index], tuple(faces_on_facet)))
    between_supports = elements.support[faces.a] & elements.support[faces.b]
    rings_of_faces = tuple(None if skip else ring for ring, skip in zip(of_faces, between_supports, strict=True))
    patch_nodes = tuple((patch.facet, tuple(next(of_patches) for _ in patch.rings)) for patch in patches)
    return Surface(points, tuple(result), rings_of_faces, patch_nodes, reach)


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
    """Convex part of a cell that planes cut."""

    side: tuple[bool, ...]  # (k,) True where the part lies beyond a plane, in the direction of its normal
    # number and outline (c, 3), scene units, of each face: on facets of the cell, and on planes
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
    opposite = cosine.argmin(axis=1)
    nodes = _nodes(surface, facets)
    planes: list[tuple[Floats, float]] = []
    for i, j in enumerate(opposite.tolist()):
        # facets that are each other's most opposite one
        if i < j and opposite[j] == i and cosine[i, j] < _OPPOSITE:
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
    places = [outline for layer in layers.values() for part in layer.parts for _, outline in (*part.skin, *part.caps)]
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
    facet, result = surface.facets[index], [region]
    on_both_sides = [k for k, facet in enumerate(surface.facets) if face is not None and face in facet.faces]
    for place in on_both_sides or [index]:
        cell = surface.facets[place].cell
        if cell not in layers:
            continue
        outlines = [outline for part in layers[cell].parts for name, outline in part.skin if name == place]
        cutters = [shapely.Polygon(facet.flat(outline)) for outline in outlines]
        parts = [shapely.intersection(piece, cutter) for piece in result for cutter in cutters]
        polygons = [polygon for part in parts for polygon in _polygons_in(part, surface.reach)]
        result = [_without_straight_corners(polygon, surface.reach) for polygon in polygons]
    return result


def _without_straight_corners(region: shapely.Polygon, reach: float) -> shapely.Polygon:
    simplified = shapely.simplify(region, reach)
    corners = shapely.get_coordinates(simplified.exterior)[:-1]
    chord = corners[1] - corners[-1]
    height = abs(float(np.linalg.det([chord, corners[0] - corners[-1]]))) / float(np.linalg.norm(chord))
    # the first corner is never simplified away
    return shapely.Polygon(corners[1:], simplified.interiors) if height <= reach and len(corners) > 3 else simplified


def _nodes(surface: Surface, facets: list[int]) -> Floats:
    """Return the nodes (k, 3) of facets, and of the interfaces and load patches on them."""
    rings: list[Ints] = []
    for index in facets:
        facet = surface.facets[index]
        rings += [facet.ring, *(ring for f in facet.faces if (ring := surface.faces[f]) is not None)]
        rings += [ring for place, loops in surface.patches if place == index for ring in loops]
    return surface.points[np.unique(np.concatenate(rings))]


def _planes(surface: Surface, start: Facet, end: Facet, nodes: Floats) -> list[tuple[Floats, float]]:
    """Return the planes, unit normal (3,) and offset, that cut a long or flat cell between two facets."""

    # Where the facets lean, all planes meet in one line; a plane close to a node is moved to it.
    def share_of_way(points: Floats) -> Floats:
        """Return 0 at points (k, 3) on the first facet, 1 on the second one."""
        from_start, to_end = (start.origin - points) @ start.normal, (end.origin - points) @ end.normal
        return np.asarray(from_start / (from_start + to_end))

    middle = nodes.mean(axis=0)
    width = float((start.origin - middle) @ start.normal + (end.origin - middle) @ end.normal)
    side = max(_smaller_side(surface, start), _smaller_side(surface, end))
    if width >= _THRICE * side:
        targets = [side / width, 1.0 - side / width]
    else:
        targets = [0.5] if width >= _TWICE * side else []
    of_nodes = np.unique(np.round(share_of_way(nodes), _DIGITS))
    planes = []
    for target in targets:
        nearest = float(of_nodes[np.argmin(np.round(abs(of_nodes - target), _DIGITS))])
        share = nearest if abs(nearest - target) * width <= _SNAP * side else target
        normal = share * end.normal - (1.0 - share) * start.normal
        size = float(np.linalg.norm(normal))
        offset = share * float(end.origin @ end.normal) - (1.0 - share) * float(start.origin @ start.normal)
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
            for half, (piece, edge) in enumerate(_cut_outline(outline, normal, offset, reach)):
                on_plane.append(edge)
                if len(piece) > 2:
                    target[half].append((name, piece))
    for half in (0, 1):
        if not skins[half] and not caps[half]:
            return [Part((*part.side, half == 0), part.skin, part.caps)]
    cap = _convex(np.concatenate(on_plane), normal, reach)
    return [Part((*part.side, bool(half)), tuple(skins[half]), (*caps[half], (number, cap))) for half in (0, 1)]


def _cut_outline(outline: Floats, normal: Floats, offset: float, reach: float) -> list[tuple[Floats, Floats]]:
    """Cut a convex outline (c, 3) by a plane: pieces (c, 3) before and beyond it, with their points on it (j, 3)."""
    height = outline @ normal - offset
    height = np.where(abs(height) <= reach, 0.0, height)
    next_corner, next_height = np.roll(outline, -1, axis=0), np.roll(height, -1)
    halves = []
    for sign in (-1.0, 1.0):
        piece, edge = [], []
        for a, b, height_a, height_b in zip(outline, next_corner, height, next_height, strict=True):
            if sign * height_a >= 0.0:
                piece.append(a)
                if height_a == 0.0:
                    edge.append(a)
            if height_a * height_b < 0.0:
                piece.append(a + (b - a) * (height_a / (height_a - height_b)))
                edge.append(piece[-1])
        has_corner = bool((sign * height > 0.0).any())
        halves.append((np.array(piece) if has_corner else np.zeros((0, 3)), np.array(edge).reshape(-1, 3)))
    return halves


def _convex(places: Floats, normal: Floats, reach: float) -> Floats:
    """Order the corners (k, 3) of a convex polygon counter-clockwise and merge repeated ones."""
    e1 = np.cross(normal, np.eye(3)[np.argmin(abs(normal))])
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(normal, e1)
    offset = places - places.mean(axis=0)
    angle = np.arctan2(offset @ e2, offset @ e1)
    ordered = places[np.argsort(angle)]
    distinct = np.linalg.norm(ordered - np.roll(ordered, 1, axis=0), axis=1) > reach
    return ordered[distinct] if distinct.any() else ordered[:1]


# Relative difference between the area of an interface and that of its triangles, above which the mesh does not fit it
_COVER = 1e-4

# Size of the inner part of a dry interface over the whole: tractions of a hinge press on the ring around it. With 0.6,
# 0.7, 0.8 and 0.9 the lower bound of an arch is 0.250, 0.262, 0.273 and 0.283 on its first mesh; stones that are weak
# for their load have no use for thin rings.
_RING = 0.7

# Relative difference between the areas of a region and of its convex hull up to which a fan about its centre fills it
_CONVEX = 1e-6


_Triangles = list[tuple[int, int, int]]  # nodes of triangles, counter-clockwise from outside


class _Filler:
    """Fills regions of facets with triangles; adds nodes to `points` where fans need a centre."""

    def __init__(self, surface: Surface, ids: tuple[str, ...]) -> None:
        self.surface, self.ids = surface, ids
        self.points = surface.points.tolist()
        self._near = cKDTree(surface.points)

    def triangles(self, facet: Facet, region: shapely.Polygon, ringed: bool = False) -> _Triangles:
        """Triangulate a region seen from outside, with a ring along its edges if `ringed`; InputError if not valid."""
        loops = self._nodes_of(facet, region)
        flat = [facet.flat(self.surface.points[nodes]) for nodes in loops]
        region = shapely.Polygon(flat[0], flat[1:])
        if not region.is_valid:
            raise self._refusal(facet)
        outer = loops[0].tolist() if region.exterior.is_ccw else loops[0][::-1].tolist()
        if len(outer) == 3 and len(loops) == 1:
            return [(outer[0], outer[1], outer[2])]
        if len(loops) == 1 and region.convex_hull.area - region.area <= _CONVEX * region.area:
            return self._fan(facet, region, outer, ringed)
        return _delaunay(region, loops, flat)

    def _nodes_of(self, facet: Facet, region: shapely.Polygon) -> list[Ints]:
        """Return the nodes (k,) of the outline and the holes of a region; InputError for a corner without a node."""
        reach, points = self.surface.reach, self.surface.points
        tree = cKDTree(facet.flat(points))
        height = abs((points - facet.origin) @ facet.normal)
        loops = []
        for ring in (region.exterior, *region.interiors):
            nodes = []
            for corner in np.asarray(ring.coords)[:-1]:
                candidates = [k for k in tree.query_ball_point(corner, 4.0 * reach) if height[k] <= 4.0 * reach]
                if not candidates:
                    raise self._refusal(facet)
                nodes.append(candidates[int(np.linalg.norm(facet.flat(points[candidates]) - corner, axis=1).argmin())])
            loops.append(ring_of(points, self._near, np.array(nodes), reach))
        return loops

    def _fan(self, facet: Facet, region: shapely.Polygon, outer: list[int], ringed: bool) -> _Triangles:
        """Fill a convex region with a fan about its centroid, after a ring of quadrilaterals if `ringed`."""
        middle = facet.placed(np.array([region.centroid.coords[0]]))[0]
        ring: _Triangles = []
        if ringed:
            inner = list(range(len(self.points), len(self.points) + len(outer)))
            self.points += (middle + _RING * (self.surface.points[outer] - middle)).tolist()
            for a, b, p, q in zip(outer, outer[1:] + outer[:1], inner, inner[1:] + inner[:1], strict=True):
                ring += [(a, b, q), (a, q, p)]
            outer = inner
        centre = len(self.points)
        self.points.append(middle.tolist())
        return ring + [(a, b, centre) for a, b in zip(outer, outer[1:] + outer[:1], strict=True)]

    def _refusal(self, facet: Facet) -> InputError:
        return InputError(
            f"element {self.ids[facet.cell]!r}", "its faces cannot be filled with triangles", "plainer contacts"
        )


def _delaunay(region: shapely.Polygon, loops: list[Ints], flat: list[Floats]) -> _Triangles:
    """Triangulate a region without further nodes; loops, flat: nodes of its outline and holes, and their places."""
    node_at = {
        tuple(place): int(node)
        for nodes, places in zip(loops, flat, strict=True)
        for node, place in zip(nodes, places.tolist(), strict=True)
    }
    triangles = []
    for part in shapely.get_parts(shapely.constrained_delaunay_triangles(region)):
        p, q, r = shapely.get_coordinates(part)[:3]
        a, b, c = (node_at[tuple(place)] for place in (p.tolist(), q.tolist(), r.tolist()))
        triangles.append((a, b, c) if np.linalg.det([q - p, r - p]) > 0.0 else (a, c, b))
    return triangles


def coarse_solids(assembly: Assembly, surface: Surface, dry: Bools, layers: dict[int, Layers] | None = None) -> Mesh:
    """Fill cells with tetrahedra from centroids to surfaces; dry interfaces have a ring, where hinges press.

    No tetrahedron has two faces on a surface. InputError: an interface off its cells, and parts that do not fill their
    cell.
    """
    filler = _Filler(surface, assembly.elements.ids)
    skins = _Skins(surface, filler, layers or {})
    skins.add_surfaces(dry)
    skins.add_cuts()
    solids, cells = [], []
    for (cell, _), skin in skins.of_part.items():
        corners = np.array(filler.points)[np.array(skin)]
        # the centroid of a part is that of the tetrahedra from a point inside to its skin
        base = corners.reshape(-1, 3).mean(axis=0)
        volume = np.linalg.det(corners - base) / 6.0
        centre = base + 0.25 * (volume @ (corners - base).sum(axis=1)) / volume.sum()
        solids += [(len(filler.points), *nodes) for nodes in skin]
        filler.points.append(centre.tolist())
        cells += [cell] * len(skin)
    mesh = Mesh(
        points=np.array(filler.points),
        simplices=np.array(solids, dtype=np.int64),
        cell=np.array(cells, dtype=np.int64),
        root=np.arange(len(solids)),
        tagged=np.array(list(skins.tags), dtype=np.int64).reshape(-1, 3),
        tag=np.array(list(skins.tags.values()), dtype=np.int64),
    )
    require_cover(assembly, mesh)
    for cell in layers or {}:
        _require_filled(assembly, surface, mesh, cell)
    return mesh


class _Skins:
    """Outward triangles by cell and `Part.side`, () for a whole cell; `tags` by sorted nodes."""

    def __init__(self, surface: Surface, filler: _Filler, layers: dict[int, Layers]) -> None:
        self.surface, self.filler, self.layers = surface, filler, layers
        self.of_part: dict[tuple[int, tuple[bool, ...]], _Triangles] = {}
        self.tags: dict[tuple[int, ...], int] = {}

    def add_surfaces(self, dry: Bools) -> None:
        """Fill the facets of all cells with triangles; dry: (m,) interfaces with a ring."""
        surface = self.surface
        triangles_of_face: dict[int, _Triangles] = {}
        patches_on: dict[int, list[int]] = {}
        for index, (facet_index, _) in enumerate(surface.patches):
            patches_on.setdefault(facet_index, []).append(index)
        for index, facet in enumerate(surface.facets):
            for face, polygon in zip(facet.faces, surface.covered(facet), strict=True):
                if face in triangles_of_face:
                    # the other side of the interface looks at the same triangles from behind
                    self._put(facet.cell, [(a, c, b) for a, b, c in triangles_of_face[face]])
                else:
                    triangles_of_face[face] = self._filled(index, polygon, face, ringed=bool(dry[face]))
                    self._put(facet.cell, triangles_of_face[face], face)
            loaded = surface.loaded(index)
            for patch, polygon in zip(patches_on.get(index, []), loaded, strict=True):
                self._put(facet.cell, self._filled(index, polygon), patch_tag(patch))
            for region in surface.free(facet):
                unloaded = shapely.difference(region, shapely.union_all(loaded)) if loaded else region
                for part in _polygons_in(unloaded, surface.reach):
                    self._put(facet.cell, self._filled(index, part))

    def add_cuts(self) -> None:
        """Fill the planes between the parts of a cell with triangles, seen from either side."""
        for cell, layers in self.layers.items():
            for part in layers.parts:
                for plane, outline in part.caps:
                    if part.side[plane]:
                        continue
                    beyond = (*part.side[:plane], True, *part.side[plane + 1 :])
                    e1, e2 = (axes[0] for axes in across(layers.normal[[plane]]))
                    frame = Facet(cell, outline[0], layers.normal[plane], e1, e2, np.zeros(0, dtype=int), ())
                    triangles = self.filler.triangles(frame, shapely.Polygon(frame.flat(outline)))
                    self.of_part.setdefault((cell, part.side), []).extend(triangles)
                    self.of_part.setdefault((cell, beyond), []).extend((a, c, b) for a, b, c in triangles)

    def _filled(
        self, index: int, region: shapely.Polygon, face: int | None = None, *, ringed: bool = False
    ) -> _Triangles:
        """Triangulate a region of facet `index`, with each triangle in one part of the cell."""
        cut = pieces(self.surface, index, region, self.layers, face)
        facet = self.surface.facets[index]
        return [triangle for part in cut for triangle in self.filler.triangles(facet, part, ringed)]

    def _put(self, cell: int, triangles: _Triangles, tag: int | None = None) -> None:
        """Add triangles to the parts of a cell on whose surface they lie."""
        points, layers = self.filler.points, self.layers.get(cell)
        for nodes in triangles:
            side = layers.side(np.mean([points[node] for node in nodes], axis=0)) if layers else ()
            self.of_part.setdefault((cell, side), []).append(nodes)
            if tag is not None:
                self.tags[tuple(sorted(nodes))] = tag


def _require_filled(assembly: Assembly, surface: Surface, mesh: Mesh, cell: int) -> None:
    """Raise InputError unless the tetrahedra of a cell fill its volume and its surface."""
    sides = mesh.sides
    in_a, in_b = mesh.cell[sides.a] == cell, (sides.b >= 0) & (mesh.cell[np.maximum(sides.b, 0)] == cell)
    area = float(sides.area[in_a != in_b].sum())
    surface_area = sum(shapely.Polygon(f.flat(surface.points[f.ring])).area for f in surface.facets if f.cell == cell)
    volume = float(mesh.volume[mesh.cell == cell].sum())
    if abs(area - surface_area) > _COVER * surface_area or abs(volume / assembly.elements.volume[cell] - 1.0) > _COVER:
        raise InputError(f"element {assembly.elements.ids[cell]!r}", "its layers do not fill it", "a plainer element")


# Least area of a patch, relative to its free region. A smaller one means a force at an edge of the face.
_LEAST_PATCH = 0.01


@dataclass(frozen=True)
class _Force:
    """Force on a free face: place (3,), vector (3,), width of its patch or None."""

    place: Floats
    vector: Floats
    width: float | None


class _Piece(NamedTuple):
    polygon: shapely.Polygon
    mean: Floats  # (2, 3) dead and live stress vector at the origin of the facet
    slope: Floats  # (2, 3, 3) their derivatives


def loaded_solids(
    assembly: Assembly, patch: float | None = None, labels: Bits | None = None, cut: tuple[int, ...] = ()
) -> tuple[Mesh, FieldLoads]:
    """Return the coarsest tagged mesh of a spatial assembly with its loads.

    InputError as `surface_of` and `_region_of`.
    """
    unpatched = surface_of(assembly)
    pieces: dict[int, list[_Piece]] = {}
    remainders = [
        _add_pieces(assembly, unpatched, loads, kind, patch, pieces)
        for kind, loads in enumerate((assembly.dead_loads, assembly.live_loads))
    ]
    patches, tractions = list[Patch](), list[PatchLoad]()
    for index, on_facet in sorted(pieces.items()):
        facet = unpatched.facets[index]
        for polygon, mean, slope in _overlaid(on_facet, unpatched.reach):
            rings = tuple(facet.placed(np.asarray(r.coords)[:-1]) for r in (polygon.exterior, *polygon.interiors))
            patches.append(Patch(index, rings))
            tractions.append(PatchLoad(facet.cell, facet.origin, mean, slope))
    dry = np.zeros(len(assembly.interfaces), dtype=bool) if labels is None else labels
    surface = surface_of(assembly, tuple(patches)) if patches else unpatched
    layers = {cell: cut_cell for cell in cut if (cut_cell := layers_of(surface, cell)) is not None}
    if layers:
        surface = surface_of(assembly, tuple(patches), corners_of(surface, layers))
    mesh = coarse_solids(assembly, surface, dry, layers)
    dead, live = (body_forces(assembly, mesh, remainder) for remainder in remainders)
    return mesh, FieldLoads(dead, live, tuple(tractions))


def _add_pieces(
    assembly: Assembly, surface: Surface, loads: Loads, kind: int, patch: float | None, pieces: dict[int, list[_Piece]]
) -> Floats:
    """Add tractions of dead (kind 0) or live loads (1) to the pieces by facet; return the loads (n, 6) that remain."""
    for traction in loads.tractions:
        index, polygon = _pressed_facet(assembly, surface, traction)
        pieces.setdefault(index, []).append(_piece(surface.facets[index], polygon, traction, kind))
    points = loads.points
    on_face, inside = _forces_by_region(assembly, surface, points, patch)
    for (index, number), forces in on_face.items():
        facet = surface.facets[index]
        region = surface.free(facet)[number]
        spread = [
            _square_of_width(assembly, facet, region, force, surface.reach)
            for force in forces
            if force.width is not None
        ]
        without_width = [force for force in forces if force.width is None]
        if without_width:
            spread.append(_spread(assembly, facet, region, without_width))
        pieces.setdefault(index, []).extend(_piece(facet, polygon, load, kind) for polygon, load in spread)
    body_forces_at = replace(points, **{name: values[inside] for name, values in vars(points).items()})
    return resultants(replace(loads, points=body_forces_at, tractions=()), assembly.elements)


def _forces_by_region(
    assembly: Assembly, surface: Surface, points: PointForces, patch: float | None
) -> tuple[dict[tuple[int, int], list[_Force]], Bools]:
    """Return forces by free region (facet, number), and (k,) True for those inside."""
    on_face: dict[tuple[int, int], list[_Force]] = {}
    inside = np.ones(len(points), dtype=bool)
    for k, (cell, place, vector) in enumerate(zip(points.element, points.at, points.force, strict=True)):
        stated = not np.isnan(points.width[k])
        force = _Force(place, vector, float(points.width[k]) if stated else patch)
        region_key = _region_of(assembly, surface, int(cell), force)
        if region_key is not None:
            inside[k] = False
            on_face.setdefault(region_key, []).append(force)
        elif stated:
            raise InputError(
                f"element {assembly.elements.ids[cell]!r}",
                f"the force at {_place_text(place)} has a width and no free face",
                "a place on a free face of the element, or no width",
            )
    return on_face, inside


def _piece(facet: Facet, polygon: shapely.Polygon, traction: Traction, kind: int) -> _Piece:
    """Return a traction on part of a facet as a piece; kind: 0 dead, 1 live."""
    mean, slope = np.zeros((2, 3)), np.zeros((2, 3, 3))
    mean[kind], slope[kind] = traction.at(facet.origin), traction.slope
    return _Piece(polygon, mean, slope)


def _pressed_facet(assembly: Assembly, surface: Surface, traction: Traction) -> tuple[int, shapely.Polygon]:
    """Return the facet that a traction acts on, and its part in the plane; InputError if none."""
    corners = np.concatenate(traction.rings)
    reach = max(surface.reach, 2.0 * tolerances.ON_OUTLINE * assembly.size)
    for index, facet in enumerate(surface.facets):
        if facet.cell == traction.element and abs((corners - facet.origin) @ facet.normal).max() <= reach:
            outer, *holes = (facet.flat(ring) for ring in traction.rings)
            polygon = shapely.Polygon(outer, holes)
            whole = shapely.Polygon(facet.flat(surface.points[facet.ring]))
            if whole.buffer(reach).contains(polygon):
                return index, polygon
    raise InputError(
        f"element {assembly.elements.ids[traction.element]!r}",
        f"the load about {_place_text(traction.origin)} lies on no face",
        "a load on a free face",
    )


_Spread = tuple[shapely.Polygon, Traction]  # part of a free region in the plane of its facet, and the traction on it


def _region_of(assembly: Assembly, surface: Surface, cell: int, force: _Force) -> tuple[int, int] | None:
    """Return facet and free region of a cell that a force acts on, None if inside; InputError where it is not clear."""
    # Of several regions, that of the steepest push is taken.
    reach = max(surface.reach, tolerances.ON_OUTLINE * assembly.size)
    of_cell = [(index, facet) for index, facet in enumerate(surface.facets) if facet.cell == cell]
    height = max(float((force.place - facet.origin) @ facet.normal) for _, facet in of_cell)
    if abs(height) > reach:
        return None
    pushes: list[tuple[float, int]] = []
    regions: list[tuple[int, int]] = []
    for index, facet in of_cell:
        if abs(float((force.place - facet.origin) @ facet.normal)) > reach:
            continue
        point = shapely.Point(*facet.flat(force.place[None])[0])
        for number, region in enumerate(surface.free(facet)):
            if region.distance(point) <= reach:
                pushes.append((abs(float(force.vector @ facet.normal)), len(regions)))
                regions.append((index, number))
    if not pushes:
        raise InputError(
            f"element {assembly.elements.ids[cell]!r}",
            f"a force acts on its surface at {_place_text(force.place)}, where it has no free face",
            "a force on a free face or inside the element",
        )
    return regions[steepest(pushes, assembly.elements.ids[cell], force.place)]


def _spread(assembly: Assembly, facet: Facet, region: shapely.Polygon, forces: list[_Force]) -> _Spread:
    """Spread forces without a width over a free region as a linear traction; InputError if too small."""
    # If forces of one sign would make it pull and press, it covers only the largest part that is symmetric about the
    # resultant.
    pushes = np.array([force.vector @ facet.normal for force in forces])
    whole = _linear(facet, region, forces)
    if not abs(pushes.sum()) >= abs(pushes).sum() * (1.0 - tolerances.ROUNDING) or not pushes.any():
        return region, whole
    corners = np.asarray(region.exterior.coords)
    pressure = whole.at(facet.placed(corners)) @ facet.normal * np.sign(pushes.sum())
    if pressure.min() >= -tolerances.CONTACT * pressure.max():
        return region, whole
    middle = pushes @ facet.flat(np.array([force.place for force in forces])) / pushes.sum()
    mirrored = shapely.transform(region, lambda flat: 2.0 * middle - flat)
    polygons = _polygons_in(shapely.intersection(region, mirrored), 0.0)
    symmetric = max(polygons, key=lambda polygon: polygon.area, default=None)
    if symmetric is None or symmetric.area < _LEAST_PATCH * region.area:
        raise _no_room(assembly, facet, facet.placed(middle[None])[0])
    return symmetric, _linear(facet, symmetric, forces)


def _square_of_width(assembly: Assembly, facet: Facet, region: shapely.Polygon, force: _Force, reach: float) -> _Spread:
    """Spread a force over a square of its width; InputError if that exceeds the region by more than `reach`."""
    assert force.width is not None
    x, y = facet.flat(force.place[None])[0]
    half = 0.5 * force.width
    square = shapely.box(x - half, y - half, x + half, y + half)
    if not region.buffer(reach).contains(square):
        raise _no_room(assembly, facet, force.place)
    return square, _linear(facet, square, [force])


def _linear(facet: Facet, region: shapely.Polygon, forces: list[_Force]) -> Traction:
    """Compute the traction F/A + n g·x + ω n × x on a region, docs/method.md (10.3)."""
    # F, A: total force and area. g, ω: such that the traction has the force and moment of `forces`. x: place from the
    # centroid.
    area = float(region.area)
    middle = np.array(region.centroid.coords[0])
    origin = facet.placed(middle[None])[0]
    total = np.sum([force.vector for force in forces], axis=0)
    moment = np.sum([np.cross(force.place - origin, force.vector) for force in forces], axis=0)
    second = _second_moment(region, middle)
    about_e1, about_e2, turn = facet.e1 @ moment, facet.e2 @ moment, facet.normal @ moment
    gradient = np.linalg.solve(second, np.array([-about_e2, about_e1]))
    n = facet.normal
    spin = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]]) * (turn / np.trace(second))
    slope = np.outer(n, gradient[0] * facet.e1 + gradient[1] * facet.e2) + spin
    mean_size = sum(float(np.linalg.norm(force.vector)) for force in forces) / area
    slope[abs(slope) * np.sqrt(area) <= tolerances.ROUNDING * mean_size] = 0.0
    return Traction(facet.cell, (), origin, total / area, slope)


def _second_moment(region: shapely.Polygon, middle: Floats) -> Floats:
    """Return the second moments ∫ x xᵀ dA (2, 2) of a region about point `middle`."""
    total = np.zeros((2, 2))
    for sign, ring in ((1.0, region.exterior), *((-1.0, hole) for hole in region.interiors)):
        flat = np.asarray(ring.coords)[:-1] - middle
        after = np.roll(flat, -1, axis=0)
        cross = flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]
        sums = flat + after
        part = np.einsum("k,ki,kj->ij", cross, sums, sums)
        part += np.einsum("k,ki,kj->ij", cross, flat, flat) + np.einsum("k,ki,kj->ij", cross, after, after)
        total += sign * np.sign(cross.sum()) * part / 24.0
    return total


def _overlaid(pieces: list[_Piece], reach: float) -> list[_Piece]:
    """Cut overlapping pieces of one facet into disjoint parts, each with the sum of its tractions."""
    disjoint: list[_Piece] = []
    for polygon, mean, slope in pieces:
        uncovered, next_disjoint = polygon, []
        for piece in disjoint:
            shared = _polygons_in(shapely.intersection(piece.polygon, uncovered), reach)
            next_disjoint += [_Piece(part, piece.mean + mean, piece.slope + slope) for part in shared]
            next_disjoint += [
                piece._replace(polygon=part)
                for part in _polygons_in(shapely.difference(piece.polygon, uncovered), reach)
            ]
            uncovered = shapely.difference(uncovered, piece.polygon)
        disjoint = next_disjoint + [_Piece(part, mean, slope) for part in _polygons_in(uncovered, reach)]
    return disjoint


def _polygons_in(region: shapely.Geometry, reach: float) -> list[shapely.Polygon]:
    """Return the polygons of a geometry, without slivers thinner than about `reach`."""
    parts = shapely.get_parts(region)
    return [part for part in parts if part.geom_type == "Polygon" and part.area > reach * part.length]


def _no_room(assembly: Assembly, facet: Facet, place: Floats) -> InputError:
    """Return the error for a force whose patch does not fit its free face."""
    return InputError(
        f"element {assembly.elements.ids[facet.cell]!r}",
        f"its free face has no room for the patch of the force at {_place_text(place)}",
        "a force farther from the edges of the face, or a smaller patch",
    )


def _place_text(place: Floats) -> str:
    return "(" + ", ".join(f"{value:g}" for value in place) + ")"
