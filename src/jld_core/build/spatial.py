"""Elements and interfaces of spatial scenes, with the same steps as in planar.py."""

from __future__ import annotations

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Elements
from jld_core.build.elements import Geometry, collect_elements, pair_index, refuse_twins, snapping
from jld_core.errors import InputError
from jld_core.geometry import Faces, facets_of, find_spatial_contacts, near_pairs, snap_solids, solids
from jld_core.geometry.misfits import words_of
from jld_core.geometry.overlapping_solids import check_overlaps
from jld_core.geometry.polyhedra import Facets, lay_out
from jld_core.geometry.spatial_contacts import SpatialContact, near_solids, nearer_pairs
from jld_core.geometry.spatial_interfaces import spatial_interfaces
from jld_core.geometry.stated_contacts import given_normals
from jld_core.geometry.stated_fit import fit_of_polygon, judge_fit, refuse_crossing, refuse_repeated
from jld_core.scene import Scene
from jld_core.scene.schema import Contact


def spatial_geometry(scene: Scene) -> Geometry:
    """Compute the elements and interfaces of a spatial scene.

    Gaps and overlaps up to the tolerance are closed. Interfaces are those that the scene states, or all contacts found.
    Interfaces between two supports are dropped. Raises InputError for invalid polyhedra or interfaces.
    """
    entries = list(scene.elements or [])
    ids = [entry.id for entry in entries]
    refuse_twins(ids)
    vertices: list[Floats] = [np.array(entry.vertices, dtype=float) for entry in entries]
    faces: list[Faces] = [tuple(tuple(face) for face in entry.faces or []) for entry in entries]
    drawn = vertices
    vertices, moved = _closed(scene, drawn, faces)
    try:
        vertices, faces, volume, centroid = solids(ids, vertices, faces)
    except InputError as error:
        if moved > 0.0 and scene.tolerance is not None:
            solids(ids, drawn, faces)  # raises the error of the drawing itself where snapping is not the cause
            problem = f"within {scene.tolerance:g} {error.where} cannot be kept: {error.problem}"
            raise InputError("tolerance", problem, "less than the elements measure") from None
        raise
    elements = collect_elements(scene, entries, centroid, volume, vertices, tuple(faces))
    facets = facets_of(vertices, faces)
    lower, upper = elements.lower, elements.upper
    size = (upper - lower).max(axis=1)
    around = near_pairs(lower, upper, tolerances.WEDGE * size)
    pairs = nearer_pairs(lower, upper, tolerances.FACE * size, around)
    check_overlaps(ids, vertices, facets, pairs)
    given: list[Contact | None]
    warnings: tuple[str, ...] = ()
    if scene.interfaces is None:
        free = ~(elements.support[pairs[0]] & elements.support[pairs[1]])
        contacts = find_spatial_contacts(facets, (pairs[0][free], pairs[1][free]))
        given = [None] * len(contacts)
        one, two = around
        free = ~(elements.support[one] & elements.support[two])
        warnings = words_of(near_solids(facets, (one[free], two[free])), ids, scene.units.length)
    else:
        contacts = _given_contacts(scene.interfaces, elements, facets)
        warnings = _misfits(scene, contacts, elements, facets)
        given = list(scene.interfaces)
    kept = [k for k, c in enumerate(contacts) if not (elements.support[c.a] and elements.support[c.b])]
    interfaces = spatial_interfaces([contacts[k] for k in kept])
    grounded = elements.support[pairs[0]] & elements.support[pairs[1]]
    between = find_spatial_contacts(facets, (pairs[0][grounded], pairs[1][grounded]))
    touching = tuple(sorted({(contact.a, contact.b) for contact in between}))
    return Geometry(elements, entries, interfaces, [given[k] for k in kept], touching, moved, warnings)


def _closed(scene: Scene, vertices: list[Floats], faces: list[Faces]) -> tuple[list[Floats], float]:
    """Close gaps between solids and make their faces plane, up to the tolerance of the scene.

    vertices: (k, 3) of each solid. faces: loops of vertex indices of each. Returns the new vertices and the largest
    displacement. Scenes with stated interfaces or a tolerance of 0 stay unchanged. So do scenes whose largest
    displacement is within the tolerance of contact detection.
    """
    if scene.interfaces is not None or scene.tolerance == 0.0:
        return vertices, 0.0
    surface = lay_out(vertices, faces)
    edges = surface.points[surface.after] - surface.points[surface.vertex]
    tolerance, shortest = snapping(scene, np.linalg.norm(edges, axis=1))
    if not tolerance > 0.0:
        return vertices, 0.0
    snapped = snap_solids(vertices, faces, tolerance)
    if snapped.largest <= tolerances.FACE * shortest:
        return vertices, 0.0
    return snapped.vertices, snapped.largest


def _given_contacts(entries: list[Contact], elements: Elements, facets: Facets) -> list[SpatialContact]:
    """Convert interfaces stated by the scene to contacts.

    Normals point out of the first element of each. Raises InputError for an unknown element, or a polygon that is not
    spatial and plane.
    """
    if not entries:
        return []
    couples, polygons = [], []
    for position, entry in enumerate(entries):
        where = f"interfaces[{position}]"
        couples.append(pair_index(entry.elements, elements, f"{where}.elements"))
        if len(entry.polygon) < 3 or any(len(point) != 3 for point in entry.polygon):
            raise InputError(f"{where}.polygon", "it is not a spatial contact", "three or more points [x, y, z]")
        polygons.append(np.array(entry.polygon, dtype=float))
    first = np.array([a for a, _ in couples], dtype=np.int64)
    normals = given_normals(polygons, first, facets, lambda position: f"interfaces[{position}]")
    return [SpatialContact(a, b, p, n) for (a, b), p, n in zip(couples, polygons, normals, strict=True)]


def _misfits(scene: Scene, contacts: list[SpatialContact], elements: Elements, facets: Facets) -> tuple[str, ...]:
    """Return warnings about stated interfaces that fit the faces of their elements poorly.

    Raises InputError for interfaces beyond a face, inside an element, or stated twice.
    """
    refuse_repeated([(c.a, c.b) for c in contacts], [c.polygon for c in contacts])
    start = np.searchsorted(facets.element, np.arange(len(elements) + 1)).tolist()
    found = []
    for position, contact in enumerate(contacts):
        where = f"interfaces[{position}].polygon"
        refuse_crossing(where, contact.polygon, contact.normal)
        for element, sign in ((contact.a, 1.0), (contact.b, -1.0)):
            own = slice(start[element], start[element + 1])
            fit = fit_of_polygon(contact.polygon, sign * contact.normal, facets.loops[own], facets.normal[own])
            found.append(judge_fit(where, elements.ids[element], fit, scene.tolerance, scene.units.length))
    return tuple(text for text in found if text)
