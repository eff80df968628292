"""Elements and interfaces of planar scenes: grids of cells, or general polygons."""

from __future__ import annotations

from collections import deque

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Elements
from jld_core.build.elements import Geometry, collect_elements, pair_index, refuse_twins, snapping
from jld_core.errors import InputError
from jld_core.geometry import find_planar_contacts, polygons
from jld_core.geometry.misfits import words_of
from jld_core.geometry.planar_contacts import (
    PlanarContact,
    check_polygons,
    near_misses,
    planar_interfaces,
    without_repeats,
)
from jld_core.geometry.snapping import snap_polygons
from jld_core.geometry.stated_fit import fit_of_line, judge_fit, refuse_repeated
from jld_core.scene import Scene
from jld_core.scene.schema import Contact, Element, Grid


def planar_geometry(scene: Scene) -> Geometry:
    """Compute the elements and interfaces of a planar scene, given as a grid or as polygons.

    Gaps and overlaps up to the tolerance are closed. Interfaces are those that the scene states, or all contacts found.
    Interfaces between two supports are dropped. Raises InputError for invalid polygons or interfaces.
    """
    entries = _cells(scene.grid) if scene.grid is not None else list(scene.elements or [])
    thickness = scene.plane_thickness
    ids = [entry.id for entry in entries]
    refuse_twins(ids)
    outlines = without_repeats([np.array(entry.polygon, dtype=float) for entry in entries])
    outlines, moved = _closed(scene, ids, outlines)
    check_polygons(ids, outlines)
    area, centroid = np.empty(len(ids)), np.empty((len(ids), 2))
    for chosen, stack in polygons.by_corner_count(outlines):
        signed = polygons.area(stack)
        for position in chosen[signed < 0.0].tolist():
            outlines[position] = outlines[position][::-1].copy()
        area[chosen], centroid[chosen] = abs(signed), polygons.centroid(stack)
    volume = area * thickness
    elements = collect_elements(scene, entries, centroid, volume, outlines, ())
    given: list[Contact | None]
    warnings: tuple[str, ...] = ()
    if scene.interfaces is None:
        contacts = find_planar_contacts(outlines)
        given = [None] * len(contacts)
        if scene.grid is None:
            free = ~elements.support
            misses = [miss for miss in near_misses(outlines) if free[miss.a] or free[miss.b]]
            warnings = words_of(misses, ids, scene.units.length)
    else:
        contacts = [_given_contact(entry, position, elements) for position, entry in enumerate(scene.interfaces)]
        warnings = _misfits(scene, contacts, elements)
        given = list(scene.interfaces)
    kept = [k for k, c in enumerate(contacts) if not (elements.support[c.a] and elements.support[c.b])]
    interfaces = planar_interfaces([contacts[k] for k in kept], thickness)
    supports = np.flatnonzero(elements.support).tolist()
    touching = {(supports[c.a], supports[c.b]) for c in find_planar_contacts([outlines[k] for k in supports])}
    own = [given[k] for k in kept]
    return Geometry(elements, entries, interfaces, own, tuple(sorted(touching)), moved, warnings)


def _closed(scene: Scene, ids: list[str], outlines: list[Floats]) -> tuple[list[Floats], float]:
    """Close gaps and overlaps between outlines, each up to the tolerance of the scene.

    ids: names of the elements. outlines: corners (k, 2) of each. Returns the new outlines and the largest displacement.
    Grids and scenes with stated interfaces stay unchanged. So do scenes whose largest displacement is within the
    tolerance of contact detection, and scenes without a stated tolerance in which an element would vanish. Raises
    InputError if an element vanishes within a stated tolerance.
    """
    if scene.grid is not None or scene.interfaces is not None:
        return outlines, 0.0
    edges = np.concatenate([np.hypot(*(np.roll(outline, -1, axis=0) - outline).T) for outline in outlines])
    tolerance, shortest = snapping(scene, edges)
    if not tolerance > 0.0:
        return outlines, 0.0
    snapped = snap_polygons(outlines, tolerance)
    if snapped.collapsed and scene.tolerance is not None:
        lost = ids[snapped.collapsed[0]]
        raise InputError(
            "tolerance", f"within {tolerance:g} element {lost!r} has no area", "less than the elements measure"
        )
    if snapped.collapsed or snapped.largest <= tolerances.CONTACT * shortest:
        return outlines, 0.0
    return snapped.paths, snapped.largest


def _cells(grid: Grid) -> list[Element]:
    """Return the elements of a grid, named c{column}r{row}.

    Blocks are the connected parts of equal letters.
    """
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
    """Return the block name of each free cell of a grid, by (row, column).

    rows: letters of the grid. The name is the letter, numbered where one letter forms several connected blocks.
    """
    part: dict[tuple[int, int], int] = {}
    parts: dict[str, int] = {}
    for r, row in enumerate(rows):
        for c, letter in enumerate(row):
            if letter in ".#" or (r, c) in part:
                continue
            number = parts[letter] = parts.get(letter, 0) + 1
            queue = deque([(r, c)])
            part[r, c] = number
            while queue:
                i, j = queue.popleft()
                for cell in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                    inside = 0 <= cell[0] < len(rows) and 0 <= cell[1] < len(row)
                    if inside and cell not in part and rows[cell[0]][cell[1]] == letter:
                        part[cell] = number
                        queue.append(cell)
    return {
        (r, c): rows[r][c] if parts[rows[r][c]] == 1 else f"{rows[r][c]}{number}" for (r, c), number in part.items()
    }


def _misfits(scene: Scene, contacts: list[PlanarContact], elements: Elements) -> tuple[str, ...]:
    """Return warnings about stated interfaces that fit the outlines of their elements poorly.

    Raises InputError for interfaces beyond an outline, inside an element, or stated twice.
    """
    refuse_repeated([(c.a, c.b) for c in contacts], [c.ends for c in contacts])
    found = []
    for position, contact in enumerate(contacts):
        for element, sign in ((contact.a, 1.0), (contact.b, -1.0)):
            fit = fit_of_line(contact.ends, sign * contact.normal, elements.shape[element])
            where = f"interfaces[{position}].polygon"
            found.append(judge_fit(where, elements.ids[element], fit, scene.tolerance, scene.units.length))
    return tuple(text for text in found if text)


def _given_contact(entry: Contact, position: int, elements: Elements) -> PlanarContact:
    """Convert an interface stated by the scene to a contact.

    position: index of the entry, for messages. The normal points out of the first element. Raises InputError for an
    unknown element, or a polygon that is no straight line of two points.
    """
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
    along = (ends[1] - ends[0]) / length
    distance = abs(np.einsum("ij,ij->i", ends.mean(axis=0) - outline, outward)) + length * abs(outward @ along)
    normal = outward[int(np.argmin(distance))]
    # the stated line gives the direction of the normal, the element's nearest edge only its sign
    across = np.array([along[1], -along[0]])
    return PlanarContact(a, b, ends, across if across @ normal > 0 else -across)
