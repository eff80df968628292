"""Conversion of meshes to spatial elements: snapping, merging of faces, supports by name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.errors import InputError
from jld_core.exchange.drawing import check_supports
from jld_core.exchange.drawn import MOST, SolidMark
from jld_core.exchange.options import (
    LOWEST,
    SNAP,
    Imported,
    ImportOptions,
    Notes,
    complete,
    listed,
    rounded,
    several,
)
from jld_core.exchange.solid_contacts import contacts_of, given_contacts, labels_of
from jld_core.exchange.solid_loads import solid_loads
from jld_core.geometry import (
    Faces,
    area_vector,
    facets_of,
    merge_points,
    snap_solids,
)
from jld_core.geometry import solids as closed_solids
from jld_core.geometry.snapping_solids import SnappedSolids
from jld_core.linalg import components
from jld_core.scene.units import METRES


@dataclass(frozen=True)
class Part:
    """One solid of a spatial file.

    name: future id of its element. group: name by which its role (support) is decided. vertices: (k, 3), file units.
    faces: loops of vertex indices. support: True if the file says so. keys: further keys of its element in the scene.
    """

    name: str
    group: str
    vertices: Floats
    faces: Faces
    support: bool = False
    keys: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Solids:
    """Content of a spatial file before it is converted to elements.

    parts: the solids. contacts: (name, name, corners (k, 3)) where the file gives interfaces. facts: keys of a scene
    that an earlier export stored in the file. name: name of the scene. unit: unit of length of the file, None if
    unknown.
    marks: points, texts and arrows. drawn: role "dry" or "inner", and corners (k, 3), of faces with a label.
    """

    parts: list[Part]
    contacts: list[tuple[str, str, Floats]] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    name: str = "solids"
    unit: str | None = None
    marks: list[SolidMark] = field(default_factory=list)
    drawn: list[tuple[str, Floats]] = field(default_factory=list)


def _size(vertices: list[Floats]) -> float:
    """Return the longest side of the bounding box of all solids.

    Raises InputError where it is out of range.
    """
    every = np.concatenate(vertices)
    if not np.isfinite(every).all():
        raise InputError("", "it holds a coordinate that is no number", "finite numbers only")
    size = float(np.ptp(every, axis=0).max())
    if not 1e-12 <= size <= 1e12:
        raise InputError("", f"it is {size:g} large, out of range", "from 1e-12 to 1e+12")
    return size


def _supports(parts: list[Part], vertices: list[Floats], options: ImportOptions, near: float) -> list[bool]:
    """Return True for each solid that is a support: by the file, by its group, or as lowest.

    Any of the three suffices; the lowest point counts only with `LOWEST` in `options.support`. near: height above it
    that still counts as lowest.
    """
    low = min(float(v[:, 2].min()) for v in vertices)
    return [
        part.support
        or options.role(part.group) == "support"
        or (LOWEST in options.support and float(v[:, 2].min()) <= low + near)
        for part, v in zip(parts, vertices, strict=True)
    ]


def spatial_scene(found: Solids, options: ImportOptions, notes: Notes) -> Imported:
    """Convert the solids of a file to a spatial scene document.

    Corners are snapped, faces that are not plane are triangulated, and coplanar faces are merged. Decisions are added
    to `notes`, and the result holds them as its report. Raises InputError where there is no solid, an open solid, no
    support, or more content than a structure has.
    """
    parts = found.parts
    if not parts:
        raise InputError("", "it holds no solid", "closed surfaces, one for each block")
    if sum(len(part.faces) + len(part.vertices) for part in parts) > 4 * MOST:
        raise InputError("", "it holds too many faces", f"at most {MOST}")
    scale, unit, drawn_in = _scale(found, options, notes)
    names = _names([part.name for part in parts])
    vertices = [scale * part.vertices for part in parts]
    size = _size(vertices)
    tolerance = SNAP * size if options.tolerance is None else scale * options.tolerance
    snapped = snap_solids(vertices, [part.faces for part in parts], tolerance)
    notes.largest = snapped.largest
    _note_moved(snapped, tolerance, scale, drawn_in, notes)
    kept = [_without_slivers(v, part.faces) for v, part in zip(snapped.vertices, parts, strict=True)]
    bent = sum(map(len, kept))
    kept = [_triangulated(v, loops) for v, loops in zip(snapped.vertices, kept, strict=True)]
    if sum(map(len, kept)) > bent:
        notes.found.append("faces that are no planes are cut into triangles, the same on both sides")
    whole, faces, volume, _ = closed_solids(names, snapped.vertices, kept)
    turned = sum(a != b for a, b in zip(faces, kept, strict=True))
    notes.skip("surfaces", turned, "they were inside out or mended, and are turned outward")
    given = sum(len(part.faces) for part in parts)
    whole, faces = _merged(whole, faces)
    if (now := sum(map(len, faces))) < given:
        notes.found.append(f"{given} faces merged to {now} plane ones")
    supports = _supports(parts, whole, options, max(tolerance, 1e-9 * size))
    if LOWEST in options.support:
        chosen = (name for name, support in zip(names, supports, strict=True) if support)
        notes.found.append(f"supports where the lowest point is: {listed(chosen)}")
    check_supports(supports, options)
    document: dict[str, Any] = {"name": found.name, **found.facts}
    document["elements"] = [
        {
            "id": name,
            "vertices": rounded(v, size),
            "faces": [list(loop) for loop in loops],
            **part.keys,
            **({"support": True} if support else {}),
        }
        for name, v, loops, support, part in zip(names, whole, faces, supports, parts, strict=True)
    ]
    if found.contacts:
        of_part = dict(zip((part.name for part in parts), names, strict=True))
        document["interfaces"] = given_contacts(found.contacts, of_part, scale, size)
        notes.found.append(f"{several(len(found.contacts), 'interface')} as the file gives them")
    else:
        contacts = contacts_of(whole, faces, notes)
        if found.drawn and "interfaces" not in document:
            drawn = [(role, scale * corners) for role, corners in found.drawn]
            document["labels"] = labels_of(contacts, names, drawn, max(2.0 * tolerance, 1e-4 * size), notes)
    if found.marks and not found.facts.get("loads"):
        marks = [mark.scaled(scale) for mark in found.marks]
        reach = max(2.0 * tolerance, 1e-7 * size)
        document["loads"] = solid_loads(marks, names, whole, faces, supports, reach, options, notes)
    if unit is not None:
        document["units"] = {"force": "N", **document.get("units", {}), "length": unit}
    free = len(parts) - sum(supports)
    counted = f"{several(free, 'element')} and {several(sum(supports), 'support')}"
    notes.found.insert(0, f"{counted}, volume {volume.sum():.6g}")
    return Imported(complete(document, options, notes, dimension=3), notes.report(), drawn_in, scale)


def _note_moved(snapped: SnappedSolids, tolerance: float, scale: float, unit: str, notes: Notes) -> None:
    """Note how many vertices were moved, and how far, in the unit of the file.

    tolerance: scene units. scale: scene units per unit of the file.
    """
    if snapped.moved:
        moved = several(snapped.moved, "vertex", "vertices")
        said = f"by at most {snapped.largest / scale:.3g} {unit}; tolerance {tolerance / scale:.3g} {unit}"
        notes.snapped.append(f"{moved}, {said}")


def _scale(found: Solids, options: ImportOptions, notes: Notes) -> tuple[float, str | None, str]:
    """Return scene units per file unit, the scene's unit of length, and that of the file.

    The second is None where stored facts state it, and where no unit is known. Raises InputError for an unknown unit.
    """
    given = options.unit or found.unit
    if given is not None and given not in METRES:
        raise InputError("", f"its lengths are in {given}", "`unit` " + "|".join(METRES))
    stated = found.facts.get("units", {}).get("length")
    if stated is not None:
        own = str(stated)
        return (METRES[given] / METRES[own] if given and own in METRES else 1.0), None, given or own
    if given is None:
        notes.assumed.append("lengths in m: the file names no unit, give --unit")
        return 1.0, None, "m"
    if given != "m":
        notes.found.append(f"lengths in {given}, times {METRES[given]:g} to m")
    return METRES[given], "m", given


def _names(given: Sequence[str]) -> list[str]:
    """Make names unique: empty ones become "b" and number, repeated ones get a suffix."""
    taken: set[str] = set()
    names = []
    for number, name in enumerate(given):
        base = name.strip() or f"b{number}"
        fresh, k = base, 1
        while fresh in taken:
            k += 1
            fresh = f"{base}.{k}"
        taken.add(fresh)
        names.append(fresh)
    return names


def _without_slivers(vertices: Floats, faces: Faces) -> Faces:
    """Return faces without those that snapping collapsed, and without repeated corners.

    vertices: (k, 3). Corners at one place get one index.
    """
    node = merge_points(vertices, 0.0)
    first = np.unique(node, return_index=True)[1]
    kept = []
    for loop in faces:
        named = [int(first[node[index]]) for index in loop]
        short = tuple(index for position, index in enumerate(named) if index != named[position - 1])
        if len(set(short)) > 2:
            kept.append(short)
    return tuple(kept)


def _triangulated(vertices: Floats, faces: Faces) -> Faces:
    """Split faces that are not plane into triangles.

    A face with the same corners is split in the same way in every solid.
    """
    found: list[tuple[int, ...]] = []
    for loop in faces:
        corners = vertices[list(loop)]
        normal = area_vector(corners)
        length = float(np.linalg.norm(normal))
        off = np.abs((corners - corners.mean(axis=0)) @ normal).max() / length if length > 0.0 else 0.0
        if len(loop) == 3 or off <= 0.1 * tolerances.FACE * float(np.ptp(corners, axis=0).max()):
            found.append(loop)
            continue
        first = _apex(corners)
        turned = loop[first:] + loop[:first]
        found += [(turned[0], turned[k], turned[k + 1]) for k in range(1, len(turned) - 1)]
    return tuple(found)


def _apex(corners: Floats) -> int:
    """Return the index of the corner from which a bent face (k, 3) is split.

    It is an end of the shorter diagonal of a quadrilateral, else the first corner in lexicographic order.
    """
    order = np.lexsort(corners.T)
    if len(corners) != 4:
        return int(order[0])
    diagonals = [float(np.linalg.norm(corners[k] - corners[k + 2])) for k in (0, 1)]
    if abs(diagonals[0] - diagonals[1]) <= 1e-9 * max(diagonals):
        return int(order[0])
    return int(np.argmin(diagonals))


def _merged(vertices: Sequence[Floats], faces: Sequence[Faces]) -> tuple[list[Floats], list[Faces]]:
    """Merge coplanar faces of solids to one face per plane piece; return vertices and faces.

    Solids with a piece that has holes keep their faces.
    """
    facets = facets_of(list(vertices), list(faces))
    start = np.searchsorted(facets.element, np.arange(len(vertices) + 1))
    merged_vertices, merged_faces = [], []
    for k, (points, loops) in enumerate(zip(vertices, faces, strict=True)):
        pieces = facets.loops[start[k] : start[k + 1]]
        if any(len(piece) > 1 for piece in pieces):
            used = sorted({index for loop in loops for index in loop})
            rename = {old: new for new, old in enumerate(used)}
            merged_vertices.append(points[used])
            merged_faces.append(tuple(tuple(rename[index] for index in loop) for loop in loops))
            continue
        place: dict[tuple[float, ...], int] = {}
        outlines = tuple(
            tuple(place.setdefault(tuple(corner), len(place)) for corner in piece[0].tolist()) for piece in pieces
        )
        merged_vertices.append(np.array(list(place)))
        merged_faces.append(outlines)
    return merged_vertices, merged_faces


def split(points: Floats, faces: Faces, tolerance: float) -> list[Ints]:
    """Split the faces of a mesh into solids, as arrays (k,) of face indices.

    points: (n, 3) corners. faces: loops of corner indices. tolerance: length within which corners are equal.

    Faces connected by corner indices form a solid where they are closed. In a file without shared indices, a solid ends
    where the surface first closes, so that touching blocks stay separate. Otherwise faces that touch are connected.
    Raises InputError where touching solids cannot be told apart.
    """
    loose = _connected(faces)
    if all(_closed(faces, part) for part in loose):
        return loose
    node = merge_points(points, tolerance).tolist()
    named = tuple(tuple(node[index] for index in loop) for loop in faces)
    closing: list[Ints] = []
    open_edges: set[tuple[int, int]] = set()
    begin = 0
    for number, loop in enumerate(named):
        for edge in _edges(loop):
            open_edges ^= {edge}
        if not open_edges:
            closing.append(np.arange(begin, number + 1))
            begin = number + 1
    if begin == len(named) and all(_closed(named, part) for part in closing):
        return closing
    touching = _connected(named)
    for part in touching:
        if max(_uses(named, part).values()) > 3:
            raise InputError(
                "", "solids that touch share their corners and cannot be told apart", "a group or a name for each solid"
            )
    return touching


def _edges(loop: Sequence[int]) -> list[tuple[int, int]]:
    """Return the edges of a loop, each with ordered ends."""
    return [(min(a, b), max(a, b)) for a, b in zip(loop, (*loop[1:], loop[0]), strict=True)]


def _connected(faces: Faces) -> list[Ints]:
    """Return the connected components of faces by shared corners, in order of first face."""
    start = np.repeat([loop[0] for loop in faces], [len(loop) for loop in faces])
    end = np.array([index for loop in faces for index in loop])
    label = components(int(end.max()) + 1, start, end)
    part = label[[loop[0] for loop in faces]]
    _, first = np.unique(part, return_index=True)
    return [np.flatnonzero(part == part[k]) for k in np.sort(first).tolist()]


def _uses(faces: Faces, part: Ints) -> Counter[tuple[int, int]]:
    """Count the uses of each edge of some faces."""
    return Counter(edge for k in part.tolist() for edge in _edges(faces[k]))


def _closed(faces: Faces, part: Ints) -> bool:
    """Return True if the faces `part` (k,) number at least four and share each edge in pairs."""
    return len(part) > 3 and set(_uses(faces, part).values()) == {2}
