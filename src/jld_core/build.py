"""Scene → Assembly: the one place where a validated file becomes geometry, loads and labels."""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jld_core import loads, materials
from jld_core.assembly import DRY, INNER, Assembly, Bits, Elements, Floats, Interfaces
from jld_core.contacts import (
    PlanarContact,
    check_polygons,
    find_planar_contacts,
    planar_interfaces,
    without_repeats,
)
from jld_core.errors import InputError
from jld_core.scene import Contact, Element, Grid, Scene

LABELS = {"dry": DRY, "inner": INNER}


def build_assembly(scene: Scene) -> Assembly:
    """Elements, interfaces, loads, strengths and own labels of a scene, in scene units.

    Raises InputError: geometry, references, loads or materials that cannot be used, each by name.
    """
    if scene.dimension == 3:
        from jld_core.build_spatial import spatial_geometry

        elements, interfaces, given = spatial_geometry(scene)
    else:
        elements, interfaces, given = planar_geometry(scene)
    _check_paths(elements, interfaces)
    dead = loads.generalised(scene.loads.dead, elements, "loads.dead")
    dead[:, : scene.dimension] += np.where(elements.support[:, None], 0.0, elements.weight)
    live = loads.generalised(scene.loads.live, elements, "loads.live")
    if not np.any(live):
        raise InputError(
            "loads.live", "the live load is zero", "at least one load that acts on a free element"
        )
    return Assembly(
        name=scene.name,
        dimension=scene.dimension,
        units=(scene.units.length, scene.units.force),
        elements=elements,
        interfaces=interfaces,
        strengths=materials.strengths(scene.materials, given),
        dead=dead,
        live=live,
        labels=_own_labels(scene, elements, interfaces, given),
        live_points=_points(scene, elements),
    )


def planar_geometry(scene: Scene) -> tuple[Elements, Interfaces, list[Contact | None]]:
    """Elements and interfaces of a planar scene, and the scene's own entry for each interface.

    Raises InputError for polygons or interfaces that cannot be used.
    """
    entries = _cells(scene.grid) if scene.grid is not None else list(scene.elements or [])
    thickness = scene.grid.thickness if scene.grid is not None else (scene.thickness or 1.0)
    ids = [entry.id for entry in entries]
    refuse_twins(ids)
    outlines = [without_repeats(np.array(entry.polygon, dtype=float)) for entry in entries]
    check_polygons(ids, outlines)
    outlines = [outline if _signed_area(outline) > 0 else outline[::-1].copy() for outline in outlines]
    area = np.array([_signed_area(outline) for outline in outlines])
    centroid = np.array([_centroid(outline) for outline in outlines])
    volume = area * thickness
    elements = collect_elements(scene, entries, centroid, volume, outlines, ())
    given: list[Contact | None]
    if scene.interfaces is None:
        contacts = find_planar_contacts(outlines)
        given = [None] * len(contacts)
    else:
        contacts = [
            _given_contact(entry, position, elements) for position, entry in enumerate(scene.interfaces)
        ]
        given = list(scene.interfaces)
    kept = [k for k, c in enumerate(contacts) if not (elements.support[c.a] and elements.support[c.b])]
    return elements, planar_interfaces([contacts[k] for k in kept], thickness), [given[k] for k in kept]


def collect_elements(
    scene: Scene,
    entries: list[Element],
    centroid: Floats,
    volume: Floats,
    shape: list[Floats],
    faces: tuple[tuple[tuple[int, ...], ...], ...],
) -> Elements:
    """Elements with their weights, given volumes and centroids put in place of computed ones.

    centroid: (n, d); volume: (n,); shape, faces: as in Elements.
    """
    volume = np.array([e.volume if e.volume is not None else v for e, v in zip(entries, volume, strict=True)])
    centroid = np.array(
        [e.centroid if e.centroid is not None else c for e, c in zip(entries, centroid, strict=True)]
    )
    direction = materials.direction_of_weight(scene)
    gravity = float(np.linalg.norm(materials.gravity_vector(scene.materials, scene.dimension)))
    weight = [
        materials.self_weight(entry, size, scene.materials, direction, gravity)
        for entry, size in zip(entries, volume, strict=True)
    ]
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
        weight=np.array(weight),
        shape=tuple(shape),
        faces=faces,
    )


def refuse_twins(ids: list[str]) -> None:
    """Raise InputError for an id that two elements share."""
    seen: set[str] = set()
    for position, name in enumerate(ids):
        if name in seen:
            raise InputError(
                f"elements[{position}].id", f"{name!r} is used twice", "an id of its own for each element"
            )
        seen.add(name)


def pair_index(pair: list[str], elements: Elements, where: str) -> tuple[int, int]:
    """Element indices of a pair of ids. Raises InputError for an unknown id or twice the same one."""
    for name in pair:
        if name not in elements.index:
            raise InputError(where, f"no element is named {name!r}", "ids of two elements")
    if pair[0] == pair[1]:
        raise InputError(where, f"{pair[0]!r} is named twice", "ids of two elements")
    return elements.index[pair[0]], elements.index[pair[1]]


def faces_of_pairs(pairs: list[list[str]], elements: Elements, interfaces: Interfaces, where: str) -> Bits:
    """(m,) mask of all interfaces between the elements of each pair.

    where: the key, for complaints. Raises InputError for unknown ids and for elements that do not touch.
    """
    chosen = np.zeros(len(interfaces), dtype=bool)
    low = np.minimum(interfaces.a, interfaces.b)
    high = np.maximum(interfaces.a, interfaces.b)
    for position, pair in enumerate(pairs):
        a, b = sorted(pair_index(pair, elements, f"{where}[{position}]"))
        faces = (low == a) & (high == b)
        if not faces.any():
            raise InputError(
                f"{where}[{position}]",
                f"{pair[0]!r} and {pair[1]!r} share no interface",
                "two elements that touch",
            )
        chosen |= faces
    return chosen


def _cells(grid: Grid) -> list[Element]:
    """Elements of a grid, named c{column}r{row}; blocks are the joined parts of equal letters."""
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
    """Block name of each free cell: the letter, numbered where one letter makes several blocks."""
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
        (r, c): rows[r][c] if parts[rows[r][c]] == 1 else f"{rows[r][c]}{number}"
        for (r, c), number in part.items()
    }


def _signed_area(outline: Floats) -> float:
    # taken about a corner of the outline: far from the origin the plain sum loses digits
    x, y = (outline - outline[0]).T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def _centroid(outline: Floats) -> Floats:
    x, y = (outline - outline[0]).T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    mean = np.array([np.dot(x + np.roll(x, -1), cross), np.dot(y + np.roll(y, -1), cross)]) / (
        3.0 * cross.sum()
    )
    return np.asarray(outline[0] + mean)


def _given_contact(entry: Contact, position: int, elements: Elements) -> PlanarContact:
    """An interface the scene states, its normal taken from the outline of its first element."""
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
    distance = abs(np.einsum("ij,ij->i", ends.mean(axis=0) - outline, outward)) + length * abs(
        outward @ along
    )
    normal = outward[int(np.argmin(distance))]
    # the stated line decides the direction, the element's face only on which side the other element lies
    across = np.array([along[1], -along[0]])
    return PlanarContact(a, b, ends, across if across @ normal > 0 else -across)


def _check_paths(elements: Elements, interfaces: Interfaces) -> None:
    """Every free element must reach a support through interfaces, or its equilibrium has no solution."""
    count = len(elements)
    links = coo_array((np.ones(len(interfaces)), (interfaces.a, interfaces.b)), shape=(count, count))
    _, part = connected_components(links, directed=False)
    reached = np.isin(part, part[elements.support])
    if not reached.all():
        lost = elements.ids[int(np.flatnonzero(~reached)[0])]
        raise InputError(
            f"element {lost!r}",
            "no path of interfaces leads from it to a support",
            "every free element joined to a support through faces that touch",
        )


def _own_labels(
    scene: Scene, elements: Elements, interfaces: Interfaces, given: list[Contact | None]
) -> Bits:
    """Labels by the scene's precedence: interface, lists, default, then block membership."""
    number = {name: n for n, name in enumerate(dict.fromkeys(elements.blocks))}
    block = np.array([-1 if name is None else number[name] for name in elements.blocks])
    same = (block[interfaces.a] == block[interfaces.b]) & (block[interfaces.a] >= 0)
    support = elements.support[interfaces.a] | elements.support[interfaces.b]
    labels = np.where(same & ~support, INNER, DRY)
    if scene.labels.default is not None:
        labels = np.full(len(interfaces), LABELS[scene.labels.default])
    inner = faces_of_pairs(scene.labels.inner, elements, interfaces, "labels.inner")
    dry = faces_of_pairs(scene.labels.dry, elements, interfaces, "labels.dry")
    if np.any(inner & dry):
        face = int(np.flatnonzero(inner & dry)[0])
        pair = f"{elements.ids[interfaces.a[face]]!r}, {elements.ids[interfaces.b[face]]!r}"
        raise InputError("labels", f"the pair {pair} stands under both inner and dry", "each pair under one")
    labels = np.where(inner, INNER, np.where(dry, DRY, labels))
    for face, contact in enumerate(given):
        if contact is not None and contact.label is not None:
            labels[face] = LABELS[contact.label]
    return labels.astype(bool)


def _points(scene: Scene, elements: Elements) -> tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]:
    points = []
    for entry in scene.loads.live:
        force = getattr(entry, "force", None)
        if force is not None:
            index = elements.index[entry.element]  # type: ignore[union-attr]
            at = entry.at or elements.centroid[index].tolist()  # type: ignore[union-attr]
            points.append((tuple(at), tuple(force)))
    return tuple(points)
