"""Surfaces of convex cells, cut along interfaces and load patches, and the coarsest mesh of tetrahedra in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.space_mesh import SolidMesh, patch_tag
from jld_core.geometry import facets_of
from jld_core.geometry.facet_planes import FacetFrames
from jld_core.linalg import components

_COVER = 1e-4
"""Relative difference of the area of an interface and that of its triangles, above which it does not fit the mesh."""

_RING = 0.6
"""Size of the inner part of a dry interface over the whole: it raises λ of an arch by half on the first mesh."""

_CONVEX = 1e-6
"""Share of its area by which a plane region may differ from its convex hull and is filled by a fan about its centre."""


@dataclass(frozen=True)
class Facet:
    """Plane face of a free cell.

    cell: element. origin, normal, e1, e2: (3,) frame, the normal outward. ring: nodes counter-clockwise. faces: the
    interfaces on it.
    """

    cell: int
    origin: Floats
    normal: Floats
    e1: Floats
    e2: Floats
    ring: Ints
    faces: tuple[int, ...]

    def flat(self, places: Floats) -> Floats:
        """Return coordinates (k, 2) in the plane of places (k, 3)."""
        arm = places - self.origin
        return np.column_stack([arm @ self.e1, arm @ self.e2])

    def placed(self, flat: Floats) -> Floats:
        """Return places (k, 3) of coordinates (k, 2) in the plane."""
        return np.asarray(self.origin + flat[:, :1] * self.e1 + flat[:, 1:] * self.e2)


@dataclass(frozen=True)
class Patch:
    """Part of a facet with a live traction: index of the facet, corners (k, 3) of its outline and of its holes."""

    facet: int
    rings: tuple[Floats, ...]


@dataclass(frozen=True)
class Surface:
    """Surfaces of all free cells over common nodes.

    points: (p, 3) nodes, scene units. facets: of all free cells. faces: nodes of each interface, None between
    supports. patches: facet and nodes of the rings of each load patch. reach: distance within which nodes are
    one, length.
    """

    points: Floats
    facets: tuple[Facet, ...]
    faces: tuple[Ints | None, ...]
    patches: tuple[tuple[int, tuple[Ints, ...]], ...]
    reach: float

    def covered(self, facet: Facet) -> list[shapely.Polygon]:
        """Return the interfaces on a facet as polygons in its plane."""
        return [
            shapely.Polygon(facet.flat(self.points[ring])) for f in facet.faces if (ring := self.faces[f]) is not None
        ]

    def free(self, facet: Facet) -> list[shapely.Polygon]:
        """Return the regions of a facet outside its interfaces, in its plane."""
        whole = shapely.Polygon(facet.flat(self.points[facet.ring]))
        rest = shapely.difference(whole, shapely.union_all(self.covered(facet)))
        return [part for part in shapely.get_parts(rest) if part.area > self.reach * part.length]


def surface_of(assembly: Assembly, patches: tuple[Patch, ...] = ()) -> Surface:
    """Return the surfaces of the free cells of a spatial assembly.

    Parameters
    ----------
    assembly : Assembly
        Spatial assembly.
    patches : tuple of Patch
        Load patches, whose corners become nodes.

    Returns
    -------
    Surface
        Corners of cells, interfaces and patches within the reach are one node.

    Raises
    ------
    InputError
        A cell that is not convex or has a face that is not plane.
    """
    elements, faces = assembly.elements, assembly.interfaces
    free = elements.free
    facets = facets_of([elements.shape[k] for k in free], [elements.faces[k] for k in free])
    frames = FacetFrames.on(facets)
    reach = 2.0 * tolerances.FACE * float(np.ptp(np.array([elements.lower[free], elements.upper[free]]), axis=0).min())
    for index in range(len(facets)):
        cell = int(free[facets.element[index]])
        height = (elements.shape[cell] - facets.origin[index]) @ facets.normal[index]
        own = (facets.loops[index][0] - facets.origin[index]) @ facets.normal[index]
        if len(facets.loops[index]) > 1 or height.max() > reach or own.min() < -reach:
            raise InputError(
                f"element {elements.ids[cell]!r}",
                "fields in space fill convex cells with plane faces, and it is none",
                "a convex element, or several of them",
            )
    loops = [facets.loops[k][0] for k in range(len(facets))]
    every = [*loops, *faces.polygon, *(ring for patch in patches for ring in patch.rings)]
    points, number = _merged(np.concatenate(every), reach)
    split = np.split(number, np.cumsum([len(one) for one in every])[:-1])
    rings = [_ring(points, corners, reach) for corners in split]
    free_side = ~(elements.support[faces.a] & elements.support[faces.b])
    face_rings = rings[len(loops) : len(loops) + len(faces)]
    made = []
    for index in range(len(facets)):
        cell = int(free[facets.element[index]])
        origin, normal = facets.origin[index], facets.normal[index]
        on = []
        for face in np.flatnonzero((faces.a == cell) | (faces.b == cell)).tolist():
            outward = faces.normal[face] if faces.a[face] == cell else -faces.normal[face]
            off = abs((points[face_rings[face]] - origin) @ normal).max()
            if outward @ normal > 0.5 and off <= 2.0 * reach:
                on.append(face)
        made.append(Facet(cell, origin, normal, frames.e1[index], frames.e2[index], rings[index], tuple(on)))
    chosen = tuple(ring if ok else None for ring, ok in zip(face_rings, free_side, strict=True))
    rest = iter(rings[len(loops) + len(faces) :])
    placed = tuple((patch.facet, tuple(next(rest) for _ in patch.rings)) for patch in patches)
    return Surface(points, tuple(made), chosen, placed, reach)


def _merged(places: Floats, reach: float) -> tuple[Floats, Ints]:
    """Return different points (p, 3) and the number (k,) of each place (k, 3)."""
    pairs = cKDTree(places).query_pairs(reach, output_type="ndarray")
    group = components(len(places), pairs[:, 0], pairs[:, 1])
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    return places[first], np.asarray(number)


def _ring(points: Floats, corners: Ints, reach: float) -> Ints:
    """Nodes of a closed polygon: its corners, and all nodes that lie on its edges, in order."""
    corners = corners[corners != np.roll(corners, 1)]
    nodes: list[int] = []
    for a, b in zip(corners.tolist(), np.roll(corners, -1).tolist(), strict=True):
        along = points[b] - points[a]
        length = float(np.linalg.norm(along))
        away = points - points[a]
        place = away @ (along / length)
        off = np.linalg.norm(away - place[:, None] * (along / length), axis=1)
        between = np.flatnonzero((off <= reach) & (place > reach) & (place < length - reach))
        nodes += [a, *between[np.argsort(place[between])].tolist()]
    return np.array(nodes, dtype=np.int64)


class _Filler:
    """Triangles and tetrahedra under construction: nodes are added where fans need a centre."""

    def __init__(self, surface: Surface, ids: tuple[str, ...]) -> None:
        self.surface, self.ids = surface, ids
        self.points = surface.points.tolist()

    def triangles(self, facet: Facet, region: shapely.Polygon, ringed: bool = False) -> list[tuple[int, int, int]]:
        """Return triangles of a plane region of a facet, counter-clockwise seen from outside.

        ringed: whether a convex region has a ring of triangles along its edges.
        """
        reach, fixed = self.surface.reach, self.surface.points
        rings = [np.asarray(ring.coords)[:-1] for ring in (region.exterior, *region.interiors)]
        near = cKDTree(facet.flat(fixed))
        high = abs((fixed - facet.origin) @ facet.normal)
        named = []
        for ring in rings:
            nodes = []
            for place in ring:
                close = [k for k in near.query_ball_point(place, 4.0 * reach) if high[k] <= 4.0 * reach]
                if not close:
                    raise self._refusal(facet)
                nodes.append(min(close, key=lambda k: float(np.hypot(*(facet.flat(fixed[[k]])[0] - place)))))
            named.append(_ring(fixed, np.array(nodes), reach))
        region = shapely.Polygon(
            *[facet.flat(fixed[nodes]) for nodes in named[:1]], [facet.flat(fixed[n]) for n in named[1:]]
        )
        if not region.is_valid:
            raise self._refusal(facet)
        outer = named[0].tolist() if region.exterior.is_ccw else named[0][::-1].tolist()
        if len(outer) == 3 and len(named) == 1:
            return [(outer[0], outer[1], outer[2])]
        if len(named) == 1 and region.convex_hull.area - region.area <= _CONVEX * region.area:
            middle = facet.placed(np.array([region.centroid.coords[0]]))[0]
            found = []
            if ringed:
                inner = list(range(len(self.points), len(self.points) + len(outer)))
                self.points += (middle + _RING * (fixed[outer] - middle)).tolist()
                for a, b, p, q in zip(outer, outer[1:] + outer[:1], inner, inner[1:] + inner[:1], strict=True):
                    found += [(a, b, q), (a, q, p)]
                outer = inner
            self.points.append(middle.tolist())
            return found + [(a, b, len(self.points) - 1) for a, b in zip(outer, outer[1:] + outer[:1], strict=True)]
        known = {
            tuple(place): int(k)
            for nodes in named
            for k, place in zip(nodes, facet.flat(fixed[nodes]).tolist(), strict=True)
        }
        found = []
        for part in shapely.get_parts(shapely.constrained_delaunay_triangles(region)):
            a, b, c = (known[tuple(place)] for place in shapely.get_coordinates(part)[:3].tolist())
            p, q, r = shapely.get_coordinates(part)[:3]
            found.append((a, b, c) if np.linalg.det([q - p, r - p]) > 0.0 else (a, c, b))
        return found

    def _refusal(self, facet: Facet) -> InputError:
        return InputError(
            f"element {self.ids[facet.cell]!r}", "its faces cannot be filled with triangles", "plainer contacts"
        )


def coarse_solids(assembly: Assembly, surface: Surface, dry: Bools) -> SolidMesh:
    """Return the coarsest mesh: each cell is filled by tetrahedra from its centroid to the triangles of its surface.

    Parameters
    ----------
    assembly : Assembly
        Spatial assembly.
    surface : Surface
        Surfaces of its free cells.
    dry : (m,) bool array
        Interfaces whose triangles have a ring along the edges, where hinges press.

    Returns
    -------
    SolidMesh
        No tetrahedron has two faces on a surface. Convex regions are fans about their centroids, so that the mesh does
        not depend on position and rotation.

    Raises
    ------
    InputError
        An interface that does not lie on the surfaces of both of its cells.
    """
    filler = _Filler(surface, assembly.elements.ids)
    skins, tags = _skins(surface, filler, dry)
    solids, cells = [], []
    for cell, skin in skins.items():
        three = np.array(filler.points)[np.array(skin)]
        base = three.reshape(-1, 3).mean(axis=0)
        volume = np.linalg.det(three - base) / 6.0
        centre = base + 0.25 * (volume @ (three - base).sum(axis=1)) / volume.sum()
        solids += [(len(filler.points), *nodes) for nodes in skin]
        filler.points.append(centre.tolist())
        cells += [cell] * len(skin)
    mesh = SolidMesh(
        points=np.array(filler.points),
        tetrahedra=np.array(solids, dtype=np.int64),
        cell=np.array(cells, dtype=np.int64),
        root=np.arange(len(solids)),
        tagged=np.array(list(tags), dtype=np.int64).reshape(-1, 3),
        tag=np.array(list(tags.values()), dtype=np.int64),
    )
    _require_cover(assembly, mesh)
    return mesh


def _skins(
    surface: Surface, filler: _Filler, dry: Bools
) -> tuple[dict[int, list[tuple[int, int, int]]], dict[tuple[int, ...], int]]:
    """Return the triangles on the surface of each cell, outward, and the tags of those on interfaces and patches."""
    skins: dict[int, list[tuple[int, int, int]]] = {}
    tags: dict[tuple[int, ...], int] = {}
    done: dict[int, list[tuple[int, int, int]]] = {}
    patched: dict[int, list[int]] = {}
    for index, (place, _) in enumerate(surface.patches):
        patched.setdefault(place, []).append(index)
    for index, facet in enumerate(surface.facets):
        skin = skins.setdefault(facet.cell, [])
        for face, polygon in zip(facet.faces, surface.covered(facet), strict=True):
            if face in done:
                # the other side of the interface looks at the same triangles from behind
                skin += [(a, c, b) for a, b, c in done[face]]
            else:
                done[face] = filler.triangles(facet, polygon, bool(dry[face]))
                skin += done[face]
                tags |= {tuple(sorted(three)): face for three in done[face]}
        loaded = []
        for patch in patched.get(index, []):
            outer, *holes = (facet.flat(surface.points[ring]) for ring in surface.patches[patch][1])
            polygon = shapely.Polygon(outer, holes)
            own = filler.triangles(facet, polygon)
            skin += own
            tags |= {tuple(sorted(three)): patch_tag(patch) for three in own}
            loaded.append(polygon)
        for region in surface.free(facet):
            rest = shapely.difference(region, shapely.union_all(loaded)) if loaded else region
            for part in shapely.get_parts(rest):
                if part.geom_type == "Polygon" and part.area > surface.reach * part.length:
                    skin += filler.triangles(facet, part)
    return skins, tags


def _require_cover(assembly: Assembly, mesh: SolidMesh) -> None:
    """Raise InputError where an interface does not lie on both of its cells, or a tetrahedron is flat."""
    flat = np.flatnonzero(mesh.volume <= 0.0)
    if flat.size:
        name = assembly.elements.ids[int(mesh.cell[flat[0]])]
        raise InputError(f"element {name!r}", "it cannot be filled with tetrahedra", "a plainer element")
    faces, sides, support = assembly.interfaces, mesh.sides, assembly.elements.support
    held = support[faces.a] | support[faces.b]
    joined = sides.tag >= 0
    own = np.where(joined, sides.tag, 0)
    paired = (sides.b >= 0) != held[own]
    area = np.bincount(own[joined & paired], sides.area[joined & paired], minlength=len(faces))
    off = (abs(area - faces.area) > _COVER * faces.area) & ~(support[faces.a] & support[faces.b])
    wrong = np.flatnonzero(off)
    if wrong.size or not paired[joined].all():
        face = int(wrong[0]) if wrong.size else int(own[joined & ~paired][0])
        raise InputError(
            f"interface {assembly.pair(face)}",
            "it does not lie on the faces of both elements",
            "interfaces found from the elements, without stated ones",
        )
