"""Contacts of imported solids: given ones, found ones, and labels by drawn faces."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.options import Notes, rounded, several
from jld_core.geometry import Faces, facets_of, find_spatial_contacts, near_pairs
from jld_core.geometry.spatial_contacts import SpatialContact


def given_contacts(
    contacts: list[tuple[str, str, Floats]], names: dict[str, str], scale: float, size: float
) -> list[dict[str, Any]]:
    """Convert interfaces stated by a file to scene entries, projected onto best-fit planes.

    contacts: (name, name, corners (k, 3)) in file units. names: ids in the scene by those names. scale: scene units per
    file unit. size: of the structure, scene units.
    """
    entries = []
    for a, b, corners in contacts:
        points = scale * corners
        middle = points.mean(axis=0)
        normal = np.linalg.svd(points - middle)[2][2]
        flat = points - np.outer((points - middle) @ normal, normal)
        entries.append({"elements": [names[a], names[b]], "polygon": rounded(flat, size)})
    return entries


def contacts_of(vertices: list[Floats], faces: list[Faces], notes: Notes) -> list[SpatialContact]:
    """Find the contacts between solids; note their number, and pairs with several contacts.

    vertices, faces: of each solid. A label given to a pair holds for all its contacts.
    """
    lower, upper = np.array([v.min(axis=0) for v in vertices]), np.array([v.max(axis=0) for v in vertices])
    pairs = near_pairs(lower, upper, 1e-5 * (upper - lower).max(axis=1))
    contacts = find_spatial_contacts(facets_of(vertices, faces), pairs)
    of_pair: dict[tuple[int, int], int] = {}
    for contact in contacts:
        of_pair[contact.a, contact.b] = of_pair.get((contact.a, contact.b), 0) + 1
    many = [count for count in of_pair.values() if count > 1]
    notes.found.append(f"{several(len(contacts), 'contact')} of {several(len(of_pair), 'pair')}")
    if many:
        verb = "touches" if len(many) == 1 else "touch"
        held = "a label given to the pair holds for all of them"
        notes.found.append(f"{several(len(many), 'pair')} {verb} along {sum(many)} facets: {held}")
    return contacts


def labels_of(
    contacts: list[SpatialContact], names: list[str], drawn: list[tuple[str, Floats]], reach: float, notes: Notes
) -> dict[str, list[list[str]]]:
    """Return the labels of pairs of solids on whose contacts a face with a label is drawn.

    drawn: role "dry" or "inner", and corners (k, 3). reach: largest distance between the centroids of a contact and of
    the face drawn on it. Raises InputError where a pair has faces with different labels.
    """
    found: dict[tuple[str, str], str] = {}
    lost = 0
    places = np.array([contact.polygon.mean(axis=0) for contact in contacts]).reshape(-1, 3)
    for role, corners in drawn:
        away = np.linalg.norm(places - corners.mean(axis=0), axis=1) if len(places) else np.zeros(0)
        if not len(away) or away.min() > reach:
            lost += 1
            continue
        contact = contacts[int(np.argmin(away))]
        pair = names[contact.a], names[contact.b]
        if found.setdefault(pair, role) != role:
            raise InputError(f"elements {pair[0]!r} and {pair[1]!r}", "faces of both labels are drawn", "one label")
    counted = ", ".join(f"{sum(word == role for word in found.values())} {role}" for role in ("dry", "inner"))
    notes.found.append(f"labels of pairs by drawn faces: {counted}")
    notes.skip("drawn faces", lost, "they lie on no contact")
    return {role: [list(pair) for pair, word in found.items() if word == role] for role in ("inner", "dry")}
