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
from jld_core.fields.layers import Facet, Layers, Patch, Surface, corners_of, layers_of, pieces, surface_of
from jld_core.fields.loads import FieldLoads, PatchLoad, body_forces, steepest
from jld_core.fields.mesh import Mesh, patch_tag, ring_of
from jld_core.loads import Loads, Traction, resultants

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
        reach, fixed = self.surface.reach, self.surface.points
        near = cKDTree(facet.flat(fixed))
        height = abs((fixed - facet.origin) @ facet.normal)
        loops = []
        for ring in (region.exterior, *region.interiors):
            nodes = []
            for place in np.asarray(ring.coords)[:-1]:
                close = [k for k in near.query_ball_point(place, 4.0 * reach) if height[k] <= 4.0 * reach]
                if not close:
                    raise self._refusal(facet)
                nodes.append(close[int(np.linalg.norm(facet.flat(fixed[close]) - place, axis=1).argmin())])
            loops.append(ring_of(fixed, self._near, np.array(nodes), reach))
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
    _require_cover(assembly, mesh)
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
                unloaded = shapely.difference(region, shapely.union_all(loaded)) if loaded else region
                for part in shapely.get_parts(unloaded):
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


def _require_cover(assembly: Assembly, mesh: Mesh) -> None:
    """Raise InputError for an interface off one of its cells, or a flat tetrahedron."""
    flat = np.flatnonzero(mesh.volume <= 0.0)
    if flat.size:
        name = assembly.elements.ids[int(mesh.cell[flat[0]])]
        raise InputError(f"element {name!r}", "it cannot be filled with tetrahedra", "a plainer element")
    faces, sides, support = assembly.interfaces, mesh.sides, assembly.elements.support
    held = support[faces.a] | support[faces.b]
    joined = sides.tag >= 0
    face_of_side = np.where(joined, sides.tag, 0)
    # an interface has a cell on both sides, one at a support on one
    paired = (sides.b >= 0) != held[face_of_side]
    area = np.bincount(face_of_side[joined & paired], sides.area[joined & paired], minlength=len(faces))
    off = (abs(area - faces.area) > _COVER * faces.area) & ~(support[faces.a] & support[faces.b])
    wrong = np.flatnonzero(off)
    if wrong.size or not paired[joined].all():
        face = int(wrong[0]) if wrong.size else int(face_of_side[joined & ~paired][0])
        raise InputError(
            f"interface {assembly.pair(face)}",
            "it does not lie on the faces of both elements",
            "interfaces found from the elements, without stated ones",
        )


def _require_filled(assembly: Assembly, surface: Surface, mesh: Mesh, cell: int) -> None:
    """Raise InputError unless the tetrahedra of a cell fill its volume and its surface."""
    sides = mesh.sides
    in_a, in_b = mesh.cell[sides.a] == cell, (sides.b >= 0) & (mesh.cell[np.maximum(sides.b, 0)] == cell)
    area = float(sides.area[in_a != in_b].sum())
    whole = sum(shapely.Polygon(f.flat(surface.points[f.ring])).area for f in surface.facets if f.cell == cell)
    volume = float(mesh.volume[mesh.cell == cell].sum())
    if abs(area - whole) > _COVER * whole or abs(volume / assembly.elements.volume[cell] - 1.0) > _COVER:
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
    plain = surface_of(assembly)
    pieces: dict[int, list[_Piece]] = {}
    rest = [
        _pieces(assembly, plain, loads, kind, patch, pieces)
        for kind, loads in enumerate((assembly.dead_loads, assembly.live_loads))
    ]
    patches, tractions = list[Patch](), list[PatchLoad]()
    for index, on_facet in sorted(pieces.items()):
        facet = plain.facets[index]
        for polygon, mean, slope in _overlaid(on_facet, plain.reach):
            rings = tuple(facet.placed(np.asarray(r.coords)[:-1]) for r in (polygon.exterior, *polygon.interiors))
            patches.append(Patch(index, rings))
            tractions.append(PatchLoad(facet.cell, facet.origin, mean, slope))
    dry = np.zeros(len(assembly.interfaces), dtype=bool) if labels is None else labels
    surface = surface_of(assembly, tuple(patches)) if patches else plain
    layers = {cell: one for cell in cut if (one := layers_of(surface, cell)) is not None}
    if layers:
        surface = surface_of(assembly, tuple(patches), corners_of(surface, layers))
    mesh = coarse_solids(assembly, surface, dry, layers)
    dead, live = (body_forces(assembly, mesh, one) for one in rest)
    return mesh, FieldLoads(dead, live, tuple(tractions))


def _pieces(
    assembly: Assembly, surface: Surface, loads: Loads, kind: int, patch: float | None, pieces: dict[int, list[_Piece]]
) -> Floats:
    """Add the tractions of loads to the pieces of each facet; return the rest (n, 6) of the loads."""
    for traction in loads.tractions:
        index, polygon = _pressed(assembly, surface, traction)
        pieces.setdefault(index, []).append(_piece(surface.facets[index], polygon, traction, kind))
    points, chosen = loads.points, dict[tuple[int, int], list[_Force]]()
    inside = np.ones(len(points), dtype=bool)  # points of loads on no free face: they stay body forces
    for k, (cell, place, vector) in enumerate(zip(points.element, points.at, points.force, strict=True)):
        stated = not np.isnan(points.width[k])
        force = _Force(place, vector, float(points.width[k]) if stated else patch)
        region_key = _region_of(assembly, surface, int(cell), force)
        if region_key is not None:
            inside[k] = False
            chosen.setdefault(region_key, []).append(force)
        elif stated:
            raise InputError(
                f"element {assembly.elements.ids[cell]!r}",
                f"the force at {_place_text(place)} has a width and no free face",
                "a place on a free face of the element, or no width",
            )
    for (index, number), forces in chosen.items():
        facet = surface.facets[index]
        region = surface.free(facet)[number]
        spread = [_stated(assembly, facet, region, force, surface.reach) for force in forces if force.width is not None]
        plain = [force for force in forces if force.width is None]
        if plain:
            spread.append(_spread(assembly, facet, region, plain))
        pieces.setdefault(index, []).extend(_piece(facet, polygon, one, kind) for polygon, one in spread)
    left = replace(points, **{name: values[inside] for name, values in vars(points).items()})
    return resultants(replace(loads, points=left, tractions=()), assembly.elements)


def _piece(facet: Facet, polygon: shapely.Polygon, traction: Traction, kind: int) -> _Piece:
    """Return a traction on part of a facet as a piece; kind: 0 dead, 1 live."""
    mean, slope = np.zeros((2, 3)), np.zeros((2, 3, 3))
    mean[kind], slope[kind] = traction.at(facet.origin), traction.slope
    return _Piece(polygon, mean, slope)


def _pressed(assembly: Assembly, surface: Surface, traction: Traction) -> tuple[int, shapely.Polygon]:
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
    push = np.array([force.vector @ facet.normal for force in forces])
    whole = _linear(facet, region, forces)
    if not abs(push.sum()) >= abs(push).sum() * (1.0 - tolerances.ROUNDING) or not push.any():
        return region, whole
    corners = np.asarray(region.exterior.coords)
    pressed = whole.at(facet.placed(corners)) @ facet.normal * np.sign(push.sum())
    if pressed.min() >= -tolerances.CONTACT * pressed.max():
        return region, whole
    middle = push @ facet.flat(np.array([force.place for force in forces])) / push.sum()
    turned = shapely.transform(region, lambda flat: 2.0 * middle - flat)
    parts = shapely.get_parts(shapely.intersection(region, turned))
    part = max((one for one in parts if one.geom_type == "Polygon"), key=lambda one: one.area, default=None)
    if part is None or part.area < _LEAST_PATCH * region.area:
        raise _no_room(assembly, facet, facet.placed(middle[None])[0])
    return part, _linear(facet, part, forces)


def _stated(assembly: Assembly, facet: Facet, region: shapely.Polygon, force: _Force, reach: float) -> _Spread:
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
    lean = np.linalg.solve(second, np.array([-about_e2, about_e1]))
    n = facet.normal
    spin = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]]) * (turn / np.trace(second))
    slope = np.outer(n, lean[0] * facet.e1 + lean[1] * facet.e2) + spin
    gross = sum(float(np.linalg.norm(force.vector)) for force in forces) / area
    slope[abs(slope) * np.sqrt(area) <= tolerances.ROUNDING * gross] = 0.0
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
    done: list[_Piece] = []
    for polygon, mean, slope in pieces:
        uncovered, new = polygon, []
        for other in done:
            shared = _parts(shapely.intersection(other.polygon, uncovered), reach)
            new += [_Piece(part, other.mean + mean, other.slope + slope) for part in shared]
            new += [
                other._replace(polygon=part) for part in _parts(shapely.difference(other.polygon, uncovered), reach)
            ]
            uncovered = shapely.difference(uncovered, other.polygon)
        done = new + [_Piece(part, mean, slope) for part in _parts(uncovered, reach)]
    return done


def _parts(region: shapely.Geometry, reach: float) -> list[shapely.Polygon]:
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
