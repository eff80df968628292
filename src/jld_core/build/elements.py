"""Conversion of a scene's element entries to `Elements`, and look-up of elements by id."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Elements, Interfaces
from jld_core.build import materials
from jld_core.errors import InputError
from jld_core.geometry import Faces, facets_of, solids
from jld_core.geometry import outlines as polygons
from jld_core.geometry.planar_contacts import (
    PlanarContact,
    check_polygons,
    find_planar_contacts,
    near_misses,
    planar_interfaces,
    without_repeats,
)
from jld_core.geometry.polyhedra import Facets, lay_out
from jld_core.geometry.snapping import snap_polygons, snap_solids
from jld_core.geometry.spatial_contacts import (
    SpatialContact,
    check_overlaps,
    find_spatial_contacts,
    near_pairs,
    near_solids,
    nearer_pairs,
    spatial_interfaces,
)
from jld_core.geometry.stated_fit import (
    fit_of_line,
    fit_of_polygon,
    given_normals,
    judge_fits,
    refuse_crossing,
    refuse_repeated,
    words_of,
)
from jld_core.scene.schema import Contact, Element, Grid, Scene


def collect_elements(
    scene: Scene,
    entries: list[Element],
    centroid: Floats,
    volume: Floats,
    shape: list[Floats],
    faces: tuple[tuple[tuple[int, ...], ...], ...],
) -> Elements:
    """Build the elements of a scene without weights. Entries may replace computed centroids (n, d) and volumes (n,)."""
    volume = np.array([e.volume if e.volume is not None else v for e, v in zip(entries, volume, strict=True)])
    centroid = np.array([e.centroid if e.centroid is not None else c for e, c in zip(entries, centroid, strict=True)])
    support = np.array([entry.support for entry in entries])
    if support.all():
        raise InputError("elements", "all of them are supports", "at least one free element")
    if not support.any():
        if scene.grid is not None:
            raise InputError("grid.rows", "no cell is a support", "at least one '#'")
        raise InputError("elements", "none of them is a support", 'at least one with "support": true')
    return Elements(
        ids=tuple(entry.id for entry in entries),
        blocks=tuple(entry.block for entry in entries),
        support=support,
        centroid=centroid,
        volume=volume,
        weight=np.zeros_like(centroid),
        shape=tuple(shape),
        faces=faces,
        stated=tuple(
            frozenset(key for key in ("weight", "volume", "centroid") if getattr(entry, key) is not None)
            for entry in entries
        ),
    )


def with_self_weights(elements: Elements, entries: list[Element], scene: Scene) -> Elements:
    direction = materials.direction_of_weight(scene)
    gravity = float(np.linalg.norm(materials.gravity_vector(scene.materials, scene.dimension)))
    weight = [
        materials.self_weight(entry, size, scene.materials, direction, gravity)
        for entry, size in zip(entries, elements.volume, strict=True)
    ]
    return replace(elements, weight=np.array(weight), gravity=gravity)


@dataclass(frozen=True)
class Geometry:
    """Elements and interfaces of a scene, independent of materials and loads."""

    elements: Elements  # elements without weights
    entries: list[Element]  # the scene's entry for each element
    interfaces: Interfaces  # interfaces, except those between two supports
    given: list[Contact | None]  # the scene's entry for each interface; None for a detected interface
    # pairs of supports that share a face, whether or not the scene states an interface there
    touching: tuple[tuple[int, int], ...]
    moved: float = 0.0  # largest displacement of a corner when gaps and overlaps were closed, length
    warnings: tuple[str, ...] = ()  # near misses of faces, or poor fits of stated interfaces


def snapping(scene: Scene, edges: Floats) -> tuple[float, float]:
    """Return the snapping tolerance of a scene and its shortest edge, both lengths."""
    shortest = float(edges[edges > 0.0].min(initial=np.inf))
    tolerance = scene.tolerance if scene.tolerance is not None else tolerances.SNAP * shortest
    return (tolerance if tolerance < np.inf else 0.0), shortest


def refuse_twins(ids: list[str]) -> None:
    """Raise InputError if an element id is used twice."""
    used: set[str] = set()
    for position, name in enumerate(ids):
        if name in used:
            raise InputError(f"elements[{position}].id", f"{name!r} is used twice", "an id of its own for each element")
        used.add(name)


def pair_index(pair: list[str], elements: Elements, where: str) -> tuple[int, int]:
    """Return the indices of two different elements named by their ids; raise InputError for others."""
    first, second = (elements.named(name, where, "ids of two elements") for name in pair)
    if first == second:
        raise InputError(where, f"{pair[0]!r} is named twice", "ids of two elements")
    return first, second


def faces_of_pairs(pairs: list[list[str]], elements: Elements, interfaces: Interfaces, where: str) -> Bits:
    """Return the mask (m,) of interfaces between pairs of ids; `where`: key of the list, for InputError."""
    mask = np.zeros(len(interfaces), dtype=bool)
    if not pairs:
        return mask
    count = len(elements)
    keys = np.minimum(interfaces.a, interfaces.b) * count + np.maximum(interfaces.a, interfaces.b)
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    for position, pair in enumerate(pairs):
        a, b = sorted(pair_index(pair, elements, f"{where}[{position}]"))
        first, last = np.searchsorted(keys, a * count + b, "left"), np.searchsorted(keys, a * count + b, "right")
        if first == last:
            raise InputError(
                f"{where}[{position}]", f"{pair[0]!r} and {pair[1]!r} share no interface", "two elements that touch"
            )
        mask[order[first:last]] = True
    return mask


def planar_geometry(scene: Scene) -> Geometry:
    """Compute the elements and interfaces of a planar scene, given as a grid or as polygons."""
    # Gaps and overlaps up to the tolerance are closed. Interfaces are those that the scene states, or all contacts
    # found. Interfaces between two supports are dropped.
    entries = _cells(scene.grid) if scene.grid is not None else list(scene.elements or [])
    thickness = scene.plane_thickness
    ids = [entry.id for entry in entries]
    refuse_twins(ids)
    outlines = without_repeats([np.array(entry.polygon, dtype=float) for entry in entries])
    outlines, moved = _closed_polygon(scene, ids, outlines)
    overlap_warnings = check_polygons(ids, outlines, _within(scene))
    area, centroid = np.empty(len(ids)), np.empty((len(ids), 2))
    for indices, stack in polygons.by_corner_count(outlines):
        signed = polygons.area(stack)
        for position in indices[signed < 0.0].tolist():
            outlines[position] = outlines[position][::-1].copy()
        area[indices], centroid[indices] = abs(signed), polygons.centroid(stack)
    volume = area * thickness
    elements = collect_elements(scene, entries, centroid, volume, outlines, ())
    stated_of: list[Contact | None]
    warnings: tuple[str, ...] = ()
    if scene.interfaces is None:
        contacts = find_planar_contacts(outlines)
        stated_of = [None] * len(contacts)
        if scene.grid is None:
            free = ~elements.support
            misses = [miss for miss in near_misses(outlines) if free[miss.a] or free[miss.b]]
            warnings = words_of(misses, ids, scene.units.length)
    else:
        contacts = [_given_contact(entry, position, elements) for position, entry in enumerate(scene.interfaces)]
        warnings = _polygon_misfits(scene, contacts, elements)
        stated_of = list(scene.interfaces)
    with_free_element = [k for k, c in enumerate(contacts) if not (elements.support[c.a] and elements.support[c.b])]
    interfaces = planar_interfaces([contacts[k] for k in with_free_element], thickness)
    supports = np.flatnonzero(elements.support).tolist()
    touching = {(supports[c.a], supports[c.b]) for c in find_planar_contacts([outlines[k] for k in supports])}
    stated = [stated_of[k] for k in with_free_element]
    return Geometry(elements, entries, interfaces, stated, tuple(sorted(touching)), moved, overlap_warnings + warnings)


def _within(scene: Scene) -> float:
    """Return the depth of overlaps that a scene accepts: its tolerance where it states its interfaces, else 0."""
    return 0.0 if scene.interfaces is None else scene.tolerance or 0.0


def _closed_polygon(scene: Scene, ids: list[str], outlines: list[Floats]) -> tuple[list[Floats], float]:
    """Close gaps and overlaps between outlines (k, 2); return them and the largest displacement."""
    # Grids, scenes with stated interfaces, displacements within the tolerance of contacts, and, without a stated
    # tolerance, scenes in which an element would vanish stay unchanged. With one, that raises InputError.
    if scene.grid is not None or scene.interfaces is not None:
        return outlines, 0.0
    edges = np.concatenate([np.hypot(*(np.roll(outline, -1, axis=0) - outline).T) for outline in outlines])
    tolerance, shortest = snapping(scene, edges)
    if not tolerance > 0.0:
        return outlines, 0.0
    snapped = snap_polygons(outlines, tolerance)
    if snapped.collapsed and scene.tolerance is not None:
        vanished = ids[snapped.collapsed[0]]
        raise InputError(
            "tolerance", f"within {tolerance:g} element {vanished!r} has no area", "less than the elements measure"
        )
    if snapped.collapsed or snapped.largest <= tolerances.CONTACT * shortest:
        return outlines, 0.0
    return snapped.paths, snapped.largest


def _cells(grid: Grid) -> list[Element]:
    """Return the elements of a grid, named c{column}r{row}; blocks are the connected parts of equal letters."""
    width, height = grid.cell
    count = len(grid.rows)
    block = _joined_letters(grid.rows)
    cells = []
    for r, row in enumerate(grid.rows):
        for c, letter in enumerate(row):
            if letter == ".":
                continue
            x0, x1, y0, y1 = c * width, (c + 1) * width, (count - 1 - r) * height, (count - r) * height
            cells.append(
                Element(
                    id=f"c{c}r{r}",
                    polygon=[[x0, y0], [x1, y0], [x1, y1], [x0, y1]],
                    block=block.get((r, c)),
                    support=letter == "#",
                )
            )
    return cells


def _joined_letters(rows: list[str]) -> dict[tuple[int, int], str]:
    """Return the block of each free cell of a grid, by (row, column): its letter, and a number if in several parts."""
    number_of: dict[tuple[int, int], int] = {}
    count_of: dict[str, int] = {}
    for r, row in enumerate(rows):
        for c, letter in enumerate(row):
            if letter in ".#" or (r, c) in number_of:
                continue
            number = count_of[letter] = count_of.get(letter, 0) + 1
            queue = deque([(r, c)])
            number_of[r, c] = number
            while queue:
                i, j = queue.popleft()
                for cell in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                    in_grid = 0 <= cell[0] < len(rows) and 0 <= cell[1] < len(row)
                    if in_grid and cell not in number_of and rows[cell[0]][cell[1]] == letter:
                        number_of[cell] = number
                        queue.append(cell)
    return {
        (r, c): rows[r][c] + (str(number) if count_of[rows[r][c]] > 1 else "") for (r, c), number in number_of.items()
    }


def _polygon_misfits(scene: Scene, contacts: list[PlanarContact], elements: Elements) -> tuple[str, ...]:
    """Return warnings about stated interfaces that fit outlines poorly; raise InputError for those that cannot be."""
    refuse_repeated([(c.a, c.b) for c in contacts], [c.ends for c in contacts])
    fits = [
        (
            f"interfaces[{position}].polygon",
            elements.ids[element],
            fit_of_line(contact.ends, sign * contact.normal, elements.shape[element]),
        )
        for position, contact in enumerate(contacts)
        for element, sign in ((contact.a, 1.0), (contact.b, -1.0))
    ]
    return judge_fits(fits, scene.tolerance, scene.units.length)


def _given_contact(entry: Contact, position: int, elements: Elements) -> PlanarContact:
    """Convert a stated interface to a contact; raise InputError unless it is a line of two points."""
    where = f"interfaces[{position}]"
    a, b = pair_index(entry.elements, elements, f"{where}.elements")
    if len(entry.polygon) != 2 or any(len(point) != 2 for point in entry.polygon):
        raise InputError(f"{where}.polygon", "it is not a planar contact", "two points [x, y]")
    ends = np.array(entry.polygon, dtype=float)
    length = float(np.hypot(*(ends[1] - ends[0])))
    if not length > 0.0:
        raise InputError(f"{where}.polygon", "it has no length", "two different points")
    outline = elements.shape[a]
    edge = np.roll(outline, -1, axis=0) - outline
    edge /= np.hypot(*edge.T)[:, None]
    outward = np.column_stack([edge[:, 1], -edge[:, 0]])
    tangent = (ends[1] - ends[0]) / length
    distance = abs(np.einsum("ij,ij->i", ends.mean(axis=0) - outline, outward)) + length * abs(outward @ tangent)
    outward_normal = outward[int(np.argmin(distance))]
    # the stated line gives the direction of the normal, the element's nearest edge only its sign
    normal_to_line = np.array([tangent[1], -tangent[0]])
    return PlanarContact(a, b, ends, normal_to_line if normal_to_line @ outward_normal > 0 else -normal_to_line)


def spatial_geometry(scene: Scene) -> Geometry:
    """Build elements and interfaces of a spatial scene, gaps and overlaps up to the tolerance closed."""
    # Interfaces are those that the scene states, or all contacts found. Interfaces between two supports are dropped.
    entries = list(scene.elements or [])
    ids = [entry.id for entry in entries]
    refuse_twins(ids)
    vertices: list[Floats] = [np.array(entry.vertices, dtype=float) for entry in entries]
    faces: list[Faces] = [tuple(tuple(face) for face in entry.faces or []) for entry in entries]
    as_drawn = vertices
    vertices, moved = _close_gaps(scene, as_drawn, faces)
    try:
        vertices, faces, volume, centroid = solids(ids, vertices, faces)
    except InputError as error:
        if moved > 0.0 and scene.tolerance is not None:
            solids(ids, as_drawn, faces)  # raises the error of the drawing itself where snapping is not the cause
            problem = f"within {scene.tolerance:g} {error.where} cannot be kept: {error.problem}"
            raise InputError("tolerance", problem, "less than the elements measure") from None
        raise
    elements = collect_elements(scene, entries, centroid, volume, vertices, tuple(faces))
    facets = facets_of(vertices, faces)
    lower, upper = elements.lower, elements.upper
    size = (upper - lower).max(axis=1)
    around = near_pairs(lower, upper, tolerances.WEDGE * size)
    pairs = nearer_pairs(lower, upper, tolerances.FACE * size, around)
    overlap_warnings = check_overlaps(ids, vertices, facets, pairs, _within(scene))
    stated_of: list[Contact | None]
    warnings: tuple[str, ...] = ()
    if scene.interfaces is None:
        free = ~(elements.support[pairs[0]] & elements.support[pairs[1]])
        contacts = find_spatial_contacts(facets, (pairs[0][free], pairs[1][free]))
        stated_of = [None] * len(contacts)
        a, b = around
        free = ~(elements.support[a] & elements.support[b])
        warnings = words_of(near_solids(facets, (a[free], b[free])), ids, scene.units.length)
    else:
        contacts = _given_contacts(scene.interfaces, elements, facets)
        warnings = _misfits(scene, contacts, elements, facets)
        stated_of = list(scene.interfaces)
    with_free_element = [k for k, c in enumerate(contacts) if not (elements.support[c.a] and elements.support[c.b])]
    interfaces = spatial_interfaces([contacts[k] for k in with_free_element])
    grounded = elements.support[pairs[0]] & elements.support[pairs[1]]
    support_contacts = find_spatial_contacts(facets, (pairs[0][grounded], pairs[1][grounded]))
    touching = tuple(sorted({(contact.a, contact.b) for contact in support_contacts}))
    stated = [stated_of[k] for k in with_free_element]
    return Geometry(elements, entries, interfaces, stated, touching, moved, overlap_warnings + warnings)


def _close_gaps(scene: Scene, vertices: list[Floats], faces: list[Faces]) -> tuple[list[Floats], float]:
    """Close gaps between solids (k, 3) and make their faces plane, up to the tolerance of the scene."""
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
    """Convert stated interfaces to contacts, whose normals point out of their first element."""
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
    """Return warnings about stated interfaces that fit faces poorly; raise InputError for those that cannot be."""
    refuse_repeated([(c.a, c.b) for c in contacts], [c.polygon for c in contacts])
    start = np.searchsorted(facets.element, np.arange(len(elements) + 1)).tolist()
    fits = []
    for position, contact in enumerate(contacts):
        where = f"interfaces[{position}].polygon"
        refuse_crossing(where, contact.polygon, contact.normal)
        for element, sign in ((contact.a, 1.0), (contact.b, -1.0)):
            rows = slice(start[element], start[element + 1])
            fit = fit_of_polygon(contact.polygon, sign * contact.normal, facets.loops[rows], facets.normal[rows])
            fits.append((where, elements.ids[element], fit))
    return judge_fits(fits, scene.tolerance, scene.units.length)
