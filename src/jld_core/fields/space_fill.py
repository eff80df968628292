"""Coarsest mesh of tetrahedra in spatial cells, conforming across every interface."""

from __future__ import annotations

import numpy as np
import shapely
from scipy.spatial import cKDTree

from jld_core.arrays import Bools
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.space_cones import across
from jld_core.fields.space_layers import Layers, pieces
from jld_core.fields.space_mesh import SolidMesh, patch_tag
from jld_core.fields.space_surface import Facet, Surface, ring_of

# Relative difference between the area of an interface and that of its triangles, above which the mesh does not fit it
_COVER = 1e-4

# Size of the inner part of a dry interface over the whole: tractions of a hinge press on the ring around it. With 0.6,
# 0.7, 0.8 and 0.9 the lower bound of an arch is 0.250, 0.262, 0.273 and 0.283 on its first mesh; stones that are weak
# for their load have no use for thin rings.
_RING = 0.7

# Relative difference between the areas of a region and of its convex hull up to which a fan about its centre fills it
_CONVEX = 1e-6


class _Filler:
    """Fills regions of facets with triangles; adds nodes to `points` where fans need a centre.

    surface: surfaces of all cells. ids: names of the elements, for errors.
    """

    def __init__(self, surface: Surface, ids: tuple[str, ...]) -> None:
        self.surface, self.ids = surface, ids
        self.points = surface.points.tolist()

    def triangles(self, facet: Facet, region: shapely.Polygon, ringed: bool = False) -> list[tuple[int, int, int]]:
        """Triangulate a plane region of a facet, counter-clockwise seen from outside.

        region: in the plane of the facet. ringed: True if a convex region gets a ring of triangles along its edges.
        Returns the nodes of each triangle. Raises InputError where a corner of the region is no node, or the region is
        not valid.
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
                nodes.append(close[int(np.linalg.norm(facet.flat(fixed[close]) - place, axis=1).argmin())])
            named.append(ring_of(fixed, np.array(nodes), reach))
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
        """Return the error for a facet that cannot be filled."""
        return InputError(
            f"element {self.ids[facet.cell]!r}", "its faces cannot be filled with triangles", "plainer contacts"
        )


def coarse_solids(
    assembly: Assembly, surface: Surface, dry: Bools, layers: dict[int, Layers] | None = None
) -> SolidMesh:
    """Fill cells with tetrahedra from their centroids to their surfaces: the coarsest mesh.

    assembly: spatial assembly. surface: surfaces of its free cells. dry: (m,) interfaces whose triangles have a ring
    along the edges, where hinges press. layers: cells that are cut in parts, each of which is filled by itself; their
    corners are nodes of the surface. Result: no tetrahedron has two faces on a surface. Convex regions are fans about
    their centroids, so that the mesh does not depend on position and rotation. Raises InputError: an interface that
    does not lie on the surfaces of both of its cells, and parts that do not fill their cell.
    """
    filler = _Filler(surface, assembly.elements.ids)
    skins = _Skins(surface, filler, layers or {})
    skins.add_surfaces(dry)
    skins.add_cuts()
    solids, cells = [], []
    for (cell, _), skin in skins.of_part.items():
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
        tagged=np.array(list(skins.tags), dtype=np.int64).reshape(-1, 3),
        tag=np.array(list(skins.tags.values()), dtype=np.int64),
    )
    _require_cover(assembly, mesh)
    for cell in layers or {}:
        _require_filled(assembly, surface, mesh, cell)
    return mesh


_Triangles = list[tuple[int, int, int]]  # nodes of triangles, counter-clockwise from outside


class _Skins:
    """Outward triangles on the surface of each part of each cell, with their tags.

    `of_part` holds them by cell and `Part.side`, () for a whole cell; `tags` by sorted nodes.
    """

    def __init__(self, surface: Surface, filler: _Filler, layers: dict[int, Layers]) -> None:
        self.surface, self.filler, self.layers = surface, filler, layers
        self.of_part: dict[tuple[int, tuple[bool, ...]], _Triangles] = {}
        self.tags: dict[tuple[int, ...], int] = {}

    def add_surfaces(self, dry: Bools) -> None:
        """Fill the facets of all cells with triangles; dry: (m,) interfaces with a ring."""
        surface = self.surface
        done: dict[int, _Triangles] = {}
        patched: dict[int, list[int]] = {}
        for index, (place, _) in enumerate(surface.patches):
            patched.setdefault(place, []).append(index)
        for index, facet in enumerate(surface.facets):
            for face, polygon in zip(facet.faces, surface.covered(facet), strict=True):
                if face in done:
                    # the other side of the interface looks at the same triangles from behind
                    self._put(facet.cell, [(a, c, b) for a, b, c in done[face]])
                else:
                    done[face] = self._filled(index, polygon, face, ringed=bool(dry[face]))
                    self._put(facet.cell, done[face], face)
            loaded = surface.loaded(index)
            for patch, polygon in zip(patched.get(index, []), loaded, strict=True):
                self._put(facet.cell, self._filled(index, polygon), patch_tag(patch))
            for region in surface.free(facet):
                rest = shapely.difference(region, shapely.union_all(loaded)) if loaded else region
                for part in shapely.get_parts(rest):
                    if part.geom_type == "Polygon" and part.area > surface.reach * part.length:
                        self._put(facet.cell, self._filled(index, part))

    def add_cuts(self) -> None:
        """Fill the planes between the parts of a cell with triangles, seen from either side."""
        for cell, layers in self.layers.items():
            for part in layers.parts:
                for plane, outline in part.caps:
                    if part.side[plane]:
                        continue
                    beyond = (*part.side[:plane], True, *part.side[plane + 1 :])
                    one, two = across(layers.normal[[plane]])
                    frame = Facet(cell, outline[0], layers.normal[plane], one[0], two[0], np.zeros(0, dtype=int), ())
                    own = self.filler.triangles(frame, shapely.Polygon(frame.flat(outline)))
                    self.of_part.setdefault((cell, part.side), []).extend(own)
                    self.of_part.setdefault((cell, beyond), []).extend((a, c, b) for a, b, c in own)

    def _filled(
        self, index: int, region: shapely.Polygon, face: int | None = None, *, ringed: bool = False
    ) -> _Triangles:
        """Triangulate a region of facet `index`, with each triangle in one part of the cell.

        face: interface that the region is, None for any other region. ringed: as for `_Filler.triangles`.
        """
        cut = pieces(self.surface, index, region, self.layers, face)
        return [three for one in cut for three in self.filler.triangles(self.surface.facets[index], one, ringed)]

    def _put(self, cell: int, triangles: _Triangles, tag: int | None = None) -> None:
        """Add triangles to the parts of a cell on whose surface they lie.

        tag: interface or load patch of all of them; None for no tag.
        """
        points, layers = self.filler.points, self.layers.get(cell)
        for three in triangles:
            side = layers.side(np.mean([points[node] for node in three], axis=0)) if layers else ()
            self.of_part.setdefault((cell, side), []).append(three)
            if tag is not None:
                self.tags[tuple(sorted(three))] = tag


def _require_cover(assembly: Assembly, mesh: SolidMesh) -> None:
    """Raise InputError for an interface off one of its cells, or a flat tetrahedron."""
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


def _require_filled(assembly: Assembly, surface: Surface, mesh: SolidMesh, cell: int) -> None:
    """Raise InputError unless the tetrahedra of a cell fill its volume and its surface."""
    sides = mesh.sides
    in_a, in_b = mesh.cell[sides.a] == cell, (sides.b >= 0) & (mesh.cell[np.maximum(sides.b, 0)] == cell)
    area = float(sides.area[in_a != in_b].sum())
    whole = sum(shapely.Polygon(f.flat(surface.points[f.ring])).area for f in surface.facets if f.cell == cell)
    volume = float(mesh.volume[mesh.cell == cell].sum())
    if abs(area - whole) > _COVER * whole or abs(volume / assembly.elements.volume[cell] - 1.0) > _COVER:
        raise InputError(f"element {assembly.elements.ids[cell]!r}", "its layers do not fill it", "a plainer element")
