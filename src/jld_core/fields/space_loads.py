"""Loads of spatial cells as body forces and tractions with the resultants of the scene.

Rules: docs/method.md (9.5) and (10.3). Self-weight and body loads are uniform in each cell. A force on a free face of
its cell is a traction that is linear on that face, or on a patch of it. All other forces and moments are body forces
that are constant in each tetrahedron of the coarsest mesh, so that refinement never changes the load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.space_fill import coarse_solids
from jld_core.fields.space_layers import corners_of, layers_of
from jld_core.fields.space_mesh import SolidMesh
from jld_core.fields.space_surface import Facet, Patch, Surface, surface_of

_LEAST_PATCH = 0.01
"""Least area of a patch, relative to its free region. A smaller one means a force at an edge of the face."""


@dataclass(frozen=True)
class Traction:
    """Linear live traction on a patch of a free face, for λ = 1, scene units.

    cell: element. origin: (3,) reference point. mean: (3,) stress vector there. slope: (3, 3) derivatives of the stress
    vector; column k by coordinate k.
    """

    cell: int
    origin: Floats
    mean: Floats
    slope: Floats

    def at(self, places: Floats) -> Floats:
        """Return the stress vectors (..., 3) at places (..., 3), both in scene units."""
        return np.asarray(self.mean + (places - self.origin) @ self.slope.T)


@dataclass(frozen=True)
class SpatialLoads:
    """Loads of a spatial assembly over its coarsest mesh, scene units.

    dead, live: (r, 3) force per volume in each of the r tetrahedra of the coarsest mesh, live for λ = 1. tractions:
    number i acts on the triangles with tag `patch_tag(i)`.
    """

    dead: Floats
    live: Floats
    tractions: tuple[Traction, ...]


@dataclass(frozen=True)
class _Force:
    """Live force on a free face: place (3,), vector (3,), width of its patch or None."""

    place: Floats
    vector: Floats
    width: float | None


_Piece = tuple[shapely.Polygon, Traction]
"""Part of a facet in its plane, and the traction on it."""


def loaded_solids(
    assembly: Assembly, patch: float | None = None, labels: Bits | None = None, cut: tuple[int, ...] = ()
) -> tuple[SolidMesh, SpatialLoads]:
    """Return the coarsest mesh of a spatial assembly with its loads.

    Parameters
    ----------
    assembly : Assembly
        Spatial assembly with one load case.
    patch : float, optional
        Side of the square that each live force without a width of its own is spread on, centred at its place. By
        default all of these on one free region become one linear traction: over the whole region where its normal part
        has one sign, else over the largest part that is symmetric about the resultant.
    labels : (m,) bool array, optional
        True = dry: such interfaces have a ring of triangles along their edges. By default none.
    cut : tuple of int
        Cells that are cut in layers where they are long or flat.

    Returns
    -------
    mesh : SolidMesh
        Triangles of interfaces and of load patches are tagged.
    loads : SpatialLoads
        Forces per volume and tractions.

    Raises
    ------
    InputError
        Cells that are not convex, and a force on the surface of its cell without a free face or room for its patch.
    """
    plain = surface_of(assembly)
    chosen: dict[tuple[int, int], list[_Force]] = {}
    taken = np.zeros_like(assembly.live)
    widths = assembly.live_widths or (None,) * len(assembly.live_points)
    for (at, vector), width in zip(assembly.live_points, widths, strict=True):
        force = _Force(np.array(at, dtype=float), np.array(vector, dtype=float), patch if width is None else width)
        found = _region_of(assembly, plain, force, taken)
        if found is None:
            if width is not None:
                raise InputError(
                    "loads.live",
                    f"the force at {_place_text(force.place)} has a width and no free face",
                    "a place on a free face of the element, or no width",
                )
            continue
        chosen.setdefault(found, []).append(force)
        cell = plain.facets[found[0]].cell
        arm = force.place - assembly.elements.centroid[cell]
        taken[cell] += (*force.vector, *np.cross(arm, force.vector))
    patches, tractions = _patches(assembly, plain, chosen)
    dry = np.zeros(len(assembly.interfaces), dtype=bool) if labels is None else labels
    surface = surface_of(assembly, tuple(patches)) if patches else plain
    layers = {cell: one for cell in cut if (one := layers_of(surface, cell)) is not None}
    if layers:
        surface = surface_of(assembly, tuple(patches), corners_of(surface, layers))
    mesh = coarse_solids(assembly, surface, dry, layers)
    rest = assembly.live - taken
    gross = abs(assembly.live) + abs(taken)
    gross[:, 3:] += gross[:, :3].sum(axis=1)[:, None] * assembly.size
    rest[abs(rest) <= tolerances.ROUNDING * gross] = 0.0
    return mesh, SpatialLoads(_body(assembly, mesh, assembly.dead), _body(assembly, mesh, rest), tuple(tractions))


def _region_of(assembly: Assembly, surface: Surface, force: _Force, taken: Floats) -> tuple[int, int] | None:
    """Return facet and number of the free region that a live force acts on, None if inside.

    taken: (n, 6) live loads that regions took before. Of several regions, one of the cell whose remaining live force is
    nearest to the force is taken, then the steepest push. Raises InputError for a force on a surface without a free
    region there.
    """
    reach = max(surface.reach, tolerances.ON_OUTLINE * assembly.size)
    height: dict[int, float] = {}
    for facet in surface.facets:
        off = float((force.place - facet.origin) @ facet.normal)
        height[facet.cell] = max(height.get(facet.cell, -np.inf), off)
    near = [cell for cell, off in height.items() if off <= reach and assembly.live[cell].any()]
    if not near or any(height[cell] < -reach for cell in near):
        return None
    best: tuple[float, float, int, int] | None = None
    for index, facet in enumerate(surface.facets):
        if facet.cell not in near or abs(float((force.place - facet.origin) @ facet.normal)) > reach:
            continue
        point = shapely.Point(*facet.flat(force.place[None])[0])
        misfit = float(np.linalg.norm(assembly.live[facet.cell, :3] - taken[facet.cell, :3] - force.vector))
        for number, region in enumerate(surface.free(facet)):
            if region.distance(point) <= reach:
                key = (misfit, -abs(float(force.vector @ facet.normal)), index, number)
                best = key if best is None or key < best else best
    if best is None:
        raise InputError(
            f"element {assembly.elements.ids[near[0]]!r}",
            f"a live force acts on its surface at {_place_text(force.place)}, where it has no free face",
            "a force on a free face or inside the element",
        )
    return best[2:]


def _patches(
    assembly: Assembly, surface: Surface, chosen: dict[tuple[int, int], list[_Force]]
) -> tuple[list[Patch], list[Traction]]:
    """Return the load patches on free regions, cut where they overlap, and their tractions.

    chosen: live forces on each region, by facet and number of its free region. Tractions add up where patches overlap.
    Raises InputError where a patch does not fit.
    """
    patches, tractions = [], []
    for (index, number), forces in chosen.items():
        facet = surface.facets[index]
        region = surface.free(facet)[number]
        pieces = [_stated(assembly, facet, region, force, surface.reach) for force in forces if force.width is not None]
        plain = [force for force in forces if force.width is None]
        if plain:
            pieces.append(_spread(assembly, facet, region, plain))
        for polygon, traction in _overlaid(pieces, surface.reach):
            rings = tuple(facet.placed(np.asarray(r.coords)[:-1]) for r in (polygon.exterior, *polygon.interiors))
            patches.append(Patch(index, rings))
            tractions.append(traction)
    return patches, tractions


def _spread(assembly: Assembly, facet: Facet, region: shapely.Polygon, forces: list[_Force]) -> _Piece:
    """Spread forces without a stated width over a free region as a linear traction.

    If forces of one sign would make it pull and press, it covers only the largest part that is symmetric about the
    resultant. Raises InputError if that part is too small.
    """
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


def _stated(assembly: Assembly, facet: Facet, region: shapely.Polygon, force: _Force, reach: float) -> _Piece:
    """Spread one force over a square of its stated width; sides are along e1 and e2.

    Raises InputError if the square exceeds the region by more than `reach`.
    """
    assert force.width is not None
    x, y = facet.flat(force.place[None])[0]
    half = 0.5 * force.width
    square = shapely.box(x - half, y - half, x + half, y + half)
    if not region.buffer(reach).contains(square):
        raise _no_room(assembly, facet, force.place)
    return square, _linear(facet, square, [force])


def _linear(facet: Facet, region: shapely.Polygon, forces: list[_Force]) -> Traction:
    """Compute the traction F/A + n g·x + ω n × x on a region, docs/method.md (10.3).

    F, A: total force and area. g, ω: such that the traction has the force and moment of `forces`. x: place from the
    centroid.
    """
    area = float(region.area)
    middle = np.array(region.centroid.coords[0])
    origin = facet.placed(middle[None])[0]
    total = np.sum([force.vector for force in forces], axis=0)
    moment = np.sum([np.cross(force.place - origin, force.vector) for force in forces], axis=0)
    second = _second_moment(region, middle)
    one, two, turn = facet.e1 @ moment, facet.e2 @ moment, facet.normal @ moment
    lean = np.linalg.solve(second, np.array([-two, one]))
    n = facet.normal
    spin = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]]) * (turn / np.trace(second))
    slope = np.outer(n, lean[0] * facet.e1 + lean[1] * facet.e2) + spin
    gross = sum(float(np.linalg.norm(force.vector)) for force in forces) / area
    slope[abs(slope) * np.sqrt(area) <= tolerances.ROUNDING * gross] = 0.0
    return Traction(facet.cell, origin, total / area, slope)


def _second_moment(region: shapely.Polygon, middle: Floats) -> Floats:
    """Return the second moments ∫ x xᵀ dA (2, 2) of a region about point `middle`."""
    total = np.zeros((2, 2))
    for sign, ring in ((1.0, region.exterior), *((-1.0, hole) for hole in region.interiors)):
        flat = np.asarray(ring.coords)[:-1] - middle
        after = np.roll(flat, -1, axis=0)
        cross = flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]
        both = flat + after
        part = np.einsum("k,ki,kj->ij", cross, both, both)
        part += np.einsum("k,ki,kj->ij", cross, flat, flat) + np.einsum("k,ki,kj->ij", cross, after, after)
        total += sign * np.sign(cross.sum()) * part / 24.0
    return total


def _overlaid(pieces: list[_Piece], reach: float) -> list[_Piece]:
    """Cut overlapping pieces into disjoint parts, each with the sum of its tractions.

    pieces: polygons and tractions on one facet. reach: parts thinner than about this length are dropped.
    """
    done: list[_Piece] = []
    for polygon, traction in pieces:
        rest, new = polygon, []
        for other, there in done:
            both = _sum(there, traction)
            new += [(part, both) for part in _parts(shapely.intersection(other, rest), reach)]
            new += [(part, there) for part in _parts(shapely.difference(other, rest), reach)]
            rest = shapely.difference(rest, other)
        done = new + [(part, traction) for part in _parts(rest, reach)]
    return done


def _parts(region: shapely.Geometry, reach: float) -> list[shapely.Polygon]:
    """Return the polygons of a geometry that are wider than about `reach`."""
    parts = shapely.get_parts(region)
    return [part for part in parts if part.geom_type == "Polygon" and part.area > reach * part.length]


def _sum(one: Traction, two: Traction) -> Traction:
    """Return the sum of two tractions on one facet."""
    return Traction(one.cell, one.origin, one.mean + two.at(one.origin), one.slope + two.slope)


def _no_room(assembly: Assembly, facet: Facet, place: Floats) -> InputError:
    """Return the error for a force whose patch does not fit its free face."""
    return InputError(
        f"element {assembly.elements.ids[facet.cell]!r}",
        f"its free face has no room for the patch of the live force at {_place_text(place)}",
        "a force farther from the edges of the face, or a smaller patch",
    )


def _place_text(place: Floats) -> str:
    """Return a place as text, for messages."""
    return "(" + ", ".join(f"{value:g}" for value in place) + ")"


def _body(assembly: Assembly, mesh: SolidMesh, loads: Floats) -> Floats:
    """Spread loads on cells over their root tetrahedra as forces per volume (t, 3).

    loads: (n, 6) forces and moments about the centroids of the elements, scene units. Force and moment of each cell are
    kept.
    """
    middle = mesh.corners.mean(axis=1)
    body = np.zeros((len(mesh), 3))
    for cell in np.unique(mesh.cell).tolist():
        if not loads[cell].any():
            continue
        own = np.flatnonzero(mesh.cell == cell)
        volume = mesh.volume[own]
        centroid = volume @ middle[own] / volume.sum()
        force = loads[cell, :3]
        moment = loads[cell, 3:] + np.cross(assembly.elements.centroid[cell] - centroid, force)
        body[own] = force / volume.sum()
        away = middle[own] - centroid
        size = float(np.cbrt(volume.sum()))
        if np.linalg.norm(moment) > tolerances.ROUNDING * size * np.linalg.norm(force):
            inertia = np.einsum("t,ti,ti->", volume, away, away) * np.eye(3) - np.einsum(
                "t,ti,tj->ij", volume, away, away
            )
            body[own] += np.cross(np.linalg.solve(inertia, moment), away)
    return body
