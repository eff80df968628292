"""Spatial scene → elements and interfaces, parallel to build_planar.py."""

from __future__ import annotations

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Elements, Interfaces
from jld_core.build.elements import collect_elements, pair_index, refuse_twins
from jld_core.errors import InputError
from jld_core.geometry import (
    Faces,
    Facets,
    SpatialContact,
    check_overlaps,
    facets_of,
    find_spatial_contacts,
    given_normals,
    near_pairs,
    solids,
    spatial_interfaces,
)
from jld_core.scene import Contact, Scene


def spatial_geometry(scene: Scene) -> tuple[Elements, Interfaces, list[Contact | None]]:
    """Elements and interfaces of a spatial scene, and the scene's own entry for each interface.

    Interfaces between two supports are dropped.
    Raises InputError for polyhedra or interfaces that cannot be used.
    """
    entries = list(scene.elements or [])
    ids = [entry.id for entry in entries]
    refuse_twins(ids)
    vertices: list[Floats] = [np.array(entry.vertices, dtype=float) for entry in entries]
    faces: list[Faces] = [tuple(tuple(face) for face in entry.faces or []) for entry in entries]
    vertices, faces, volume, centroid = solids(ids, vertices, faces)
    elements = collect_elements(scene, entries, centroid, volume, vertices, tuple(faces))
    facets = facets_of(vertices, faces)
    pairs = near_pairs(elements.lower, elements.upper, tolerances.FACE * (elements.upper - elements.lower).max(axis=1))
    check_overlaps(ids, vertices, facets, pairs)
    given: list[Contact | None]
    if scene.interfaces is None:
        free = ~(elements.support[pairs[0]] & elements.support[pairs[1]])
        contacts = find_spatial_contacts(facets, (pairs[0][free], pairs[1][free]))
        given = [None] * len(contacts)
    else:
        contacts = _given_contacts(scene.interfaces, elements, facets)
        given = list(scene.interfaces)
    kept = [k for k, c in enumerate(contacts) if not (elements.support[c.a] and elements.support[c.b])]
    return elements, spatial_interfaces([contacts[k] for k in kept]), [given[k] for k in kept]


def _given_contacts(entries: list[Contact], elements: Elements, facets: Facets) -> list[SpatialContact]:
    """Interfaces the scene states, their normals out of the faces of their first elements."""
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
