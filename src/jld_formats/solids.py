"""Conversion of meshes to spatial elements: snapping, merging of faces, supports by name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Floats, InputError, Ints, parse_scene, tolerances
from jld_core.build import build_geometry
from jld_core.geometry import (
    Faces,
    area_vector,
    facets_of,
    merge_points,
    polyhedra,
    snapping,
    spatial_contacts,
    stated_fit,
)
from jld_core.geometry import solids as closed_solids
from jld_core.linalg import components
from jld_core.scene import units
from jld_formats.cells import say_size
from jld_formats.drawing import check_supports
from jld_formats.drawn_loads import MOST, SolidMark
from jld_formats.forces import closest_first, parse_force
from jld_formats.options import (
    LOWEST,
    SNAP,
    Imported,
    ImportOptions,
    Notes,
    complete,
    in_words,
    listed,
    measure,
    refuse_unknown,
    round_up,
    rounded,
    several,
)


def contact_entries(
    contacts: list[tuple[str, str, Floats]], names: dict[str, str], scale: float, size: float
) -> list[dict[str, Any]]:
    """Convert interfaces stated by a file to scene entries, projected onto best-fit planes."""
    entries = []
    for a, b, corners in contacts:
        points = scale * corners
        middle = points.mean(axis=0)
        normal = np.linalg.svd(points - middle)[2][2]
        flat = points - np.outer((points - middle) @ normal, normal)
        entries.append({"elements": [names[a], names[b]], "polygon": rounded(flat, size)})
    return entries


def contacts_of(vertices: list[Floats], faces: list[Faces], notes: Notes) -> list[spatial_contacts.SpatialContact]:
    """Find the contacts between solids; note their number, and pairs with several contacts."""
    lower, upper = np.array([v.min(axis=0) for v in vertices]), np.array([v.max(axis=0) for v in vertices])
    pairs = spatial_contacts.near_pairs(lower, upper, 1e-5 * (upper - lower).max(axis=1))
    contacts = spatial_contacts.find_spatial_contacts(facets_of(vertices, faces), pairs)
    of_pair: dict[tuple[int, int], int] = {}
    for contact in contacts:
        of_pair[contact.a, contact.b] = of_pair.get((contact.a, contact.b), 0) + 1
    counts = [count for count in of_pair.values() if count > 1]
    notes.found.append(f"{several(len(contacts), 'contact')} of {several(len(of_pair), 'pair')}")
    if counts:
        verb = "touches" if len(counts) == 1 else "touch"
        remark = "a label given to the pair holds for all of them"
        notes.found.append(f"{several(len(counts), 'pair')} {verb} along {sum(counts)} facets: {remark}")
    return contacts


def labels_of(
    contacts: list[spatial_contacts.SpatialContact],
    names: list[str],
    drawn: list[tuple[str, Floats]],
    reach: float,
    notes: Notes,
) -> dict[str, list[list[str]]]:
    """Return the labels of pairs of solids with a drawn labelled face; InputError for different ones of a pair."""
    label_of: dict[tuple[str, str], str] = {}
    unmatched = 0
    centres = np.array([contact.polygon.mean(axis=0) for contact in contacts]).reshape(-1, 3)
    for role, corners in drawn:
        distance = np.linalg.norm(centres - corners.mean(axis=0), axis=1) if len(centres) else np.zeros(0)
        if not len(distance) or distance.min() > reach:
            unmatched += 1
            continue
        contact = contacts[int(np.argmin(distance))]
        pair = names[contact.a], names[contact.b]
        if label_of.setdefault(pair, role) != role:
            raise InputError(f"elements {pair[0]!r} and {pair[1]!r}", "faces of both labels are drawn", "one label")
    counted = ", ".join(f"{sum(word == role for word in label_of.values())} {role}" for role in ("dry", "inner"))
    notes.found.append(f"labels of pairs by drawn faces: {counted}")
    notes.skip("drawn faces", unmatched, "they lie on no contact")
    return {role: [list(pair) for pair, word in label_of.items() if word == role] for role in ("inner", "dry")}


def solid_loads(
    marks: list[SolidMark],
    names: list[str],
    vertices: list[Floats],
    faces: list[Faces],
    supports: list[bool],
    reach: float,
    options: ImportOptions,
    notes: Notes,
) -> dict[str, Any]:
    """Return the entry "loads" from the marks of a spatial file; free elements within `reach` of the nearest share."""
    # A text with components is a force at its place, one number a force downwards; an arrow has its own text or the
    # nearest.

    def entries(force: Floats, at: Floats) -> list[dict[str, Any]]:
        chosen = _nearest(at, vertices, faces, supports, reach)
        share = (force / len(chosen) + 0.0).tolist()
        return [{"element": names[k], "force": share, "at": (at + 0.0).tolist()} for k in chosen]

    loads: dict[str, Any] = {}
    for role, key in (("load", "live"), ("dead", "dead")):
        of_role = [mark for mark in marks if options.role(mark.layer) == role]
        texts = [mark for mark in of_role if mark.tail is None and mark.text]
        arrows = [mark for mark in of_role if mark.tail is not None]
        text_of_arrow = _beside([mark for mark in arrows if mark.text is None], texts, reach)
        for mark in of_role:
            if mark.tail is None and not mark.text:
                notes.skip("loads", 1, f"a point on layer {mark.layer} without a text that says its force")
        unlabelled = iter(range(len(arrows)))
        for mark in arrows:
            text = mark.text
            if text is None:
                number = text_of_arrow.get(next(unlabelled))
                text = None if number is None else texts[number].text
            loads.setdefault(key, []).extend(entries(_arrow(mark, text), mark.at))
        for number in sorted(set(range(len(texts))) - set(text_of_arrow.values())):
            loads.setdefault(key, []).extend(entries(_written(texts[number]), texts[number].at))
        for entry in loads.get(key, []):
            size, at = (", ".join(f"{value:.9g}" for value in entry[part]) for part in ("force", "at"))
            notes.found.append(f"{key} force ({size}) N on element {entry['element']!r} at ({at})")
    if loads:
        notes.found.append(f"loads on layers {listed(sorted({m.layer for m in marks if options.role(m.layer)}))}")
    return loads


def _written(mark: SolidMark) -> Floats:
    """Return the force (3,) of a text; a magnitude alone acts downwards."""
    try:
        written = parse_force(mark.text or "", dimension=3)
    except InputError as error:
        raise error.within(f"layer {mark.layer!r}") from None
    return np.array(written.values if written.components else (0.0, 0.0, -written.values[0]))


def _beside(arrows: list[SolidMark], texts: list[SolidMark], reach: float) -> dict[int, int]:
    """Return the number of the text of each arrow, at most its length from its middle."""
    ends = np.array([(mark.tail, mark.at) for mark in arrows]).reshape(-1, 2, 3)
    points = np.array([mark.at for mark in texts]).reshape(-1, 3)
    distance = np.linalg.norm(ends.mean(axis=1)[:, None] - points[None], axis=2)
    arrow, text = np.nonzero(distance <= np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[:, None])
    return closest_first(arrow, text, distance[arrow, text], reach, [(mark.layer, str(mark.text)) for mark in texts])


def _arrow(mark: SolidMark, text: str | None) -> Floats:
    """Return the force (3,) of an arrow: its text's magnitude; InputError if that is none."""
    along = mark.at - (mark.at if mark.tail is None else mark.tail)
    length = float(np.linalg.norm(along))
    if text is None:
        raise InputError(f"layer {mark.layer!r}", "a line has no text that says its force", "a text beside it")
    try:
        written = parse_force(text, dimension=3)
    except InputError as error:
        raise error.within(f"layer {mark.layer!r}") from None
    if written.components or not length:
        raise InputError(f"layer {mark.layer!r}", f"the text {text!r} beside an arrow states components", "its size")
    return np.asarray(written.values[0] * along / length)


def _nearest(at: Floats, vertices: list[Floats], faces: list[Faces], supports: list[bool], reach: float) -> list[int]:
    """Return the free elements within `reach` of the least distance to a point (3,), in order."""
    boxes = np.array([(v.min(axis=0), v.max(axis=0)) for v in vertices])
    least = np.linalg.norm(np.maximum(np.maximum(boxes[:, 0] - at, at - boxes[:, 1]), 0.0), axis=1)
    free = np.flatnonzero(~np.array(supports))
    distances: dict[int, float] = {}
    for k in free[np.argsort(least[free], kind="stable")].tolist():
        if distances and least[k] > min(distances.values()) + reach:
            break  # no element is nearer than its box
        distances[k] = polyhedra.distance_to(vertices[k], tuple(map(tuple, faces[k])), at)
    return sorted(k for k, distance in distances.items() if distance <= min(distances.values()) + reach)


@dataclass(frozen=True)
class Part:
    """One solid of a spatial file.

    Attributes
    ----------
    name : str
        Future id of its element.
    group : str
        Name by which its role is decided, such as a layer.
    vertices : (k, 3) array
        Corners, length in the unit of the file.
    faces : tuple of tuple of int
        Loops of vertex indices.
    support : bool
        True if the file says so.
    keys : dict
        Further keys of its element in the scene.
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

    Attributes
    ----------
    parts : list of Part
        The solids.
    contacts : list of (str, str, (k, 3) array)
        Names and corners where the file gives interfaces.
    facts : dict
        Keys of a scene that an earlier export stored in the file.
    name : str
        Name of the scene.
    unit : str or None
        Unit of length of the file, None if unknown.
    marks : list of SolidMark
        Points, texts and arrows.
    drawn : list of (str, (k, 3) array)
        Role "dry" or "inner", and corners, of faces with a label.
    """

    parts: list[Part]
    contacts: list[tuple[str, str, Floats]] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    name: str = "solids"
    unit: str | None = None
    marks: list[SolidMark] = field(default_factory=list)
    drawn: list[tuple[str, Floats]] = field(default_factory=list)


def _size(vertices: list[Floats]) -> float:
    """Return the longest side of the bounding box of all solids; InputError where it is out of range."""
    corners = np.concatenate(vertices)
    if not np.isfinite(corners).all():
        raise InputError("", "it holds a coordinate that is no number", "finite numbers only")
    size = float(np.ptp(corners, axis=0).max())
    if not 1e-12 <= size <= 1e12:
        raise InputError("", f"it is {size:g} large, out of range", "from 1e-12 to 1e+12")
    return size


def _supports(parts: list[Part], options: ImportOptions) -> list[bool]:
    """Return which solids are supports: by file, group, or lowest with `LOWEST` in `options.support`."""
    heights = np.array([float(part.vertices[:, 2].min()) for part in parts])
    size = float(np.ptp(np.concatenate([part.vertices for part in parts]), axis=0).max())
    tolerance = (
        1e-9 * size if options.tolerance == 0.0 else SNAP * size if options.tolerance is None else options.tolerance
    )
    lowest = heights <= heights.min() + tolerance if LOWEST in options.support else np.zeros(len(parts), bool)
    return [
        part.support or options.role(part.group) == "support" or bool(low)
        for part, low in zip(parts, lowest, strict=True)
    ]


_LEVEL: Final = 1e-6  # height above the lowest point, relative to the size, up to which a face lies there

_FOOT: Final = 0.05  # height of supports that are added, relative to the size

_Y_UP: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # (x, y, z) becomes (x, −z, y)


def spatial_scene(content: Solids, options: ImportOptions, notes: Notes, *, feet: bool = False) -> Imported:
    """Convert solids to a scene document; InputError: none, open, no support, too many. feet: adds supports."""
    # Corners are snapped, faces that are not plane are triangulated, and coplanar faces are merged. Decisions are added
    # to `notes`, and the result holds them as its report.
    content = _select(content, options, notes)
    parts = content.parts
    notes.reached("solids", len(parts))
    if not parts:
        raise InputError("", "it holds no solid", "closed surfaces, one for each block")
    if sum(len(part.faces) + len(part.vertices) for part in parts) > 4 * MOST:
        raise InputError("", "it holds too many faces", f"at most {MOST}")
    scale, unit, drawn_in = _scale(content, options, notes)
    parts, supports = _with_supports(parts, options, notes, feet=feet)
    names = _names([part.name for part in parts])
    vertices = [scale * part.vertices for part in parts]
    size = _size(vertices)
    tolerance = SNAP * size if options.tolerance is None else scale * options.tolerance
    snapped = snapping.snap_solids(vertices, [part.faces for part in parts], tolerance)
    notes.largest = snapped.largest
    _note_snapping(snapped, tolerance, scale, drawn_in, notes)
    corners, faces = _outer_faces(parts, names, snapped, notes)
    check_supports(supports, options)
    if LOWEST in options.support:
        chosen = (name for name, support in zip(names, supports, strict=True) if support)
        notes.found.append(f"supports where the lowest point is: {listed(chosen)}")
    _say_axis(corners, supports, options, notes)
    document: dict[str, Any] = {"name": content.name, **content.facts}
    if options.tolerance:
        document["tolerance"] = tolerance  # misfits of faces that share no corner are left to the scene
    document["elements"] = [
        {
            "id": name,
            "vertices": rounded(v, size),
            "faces": [list(loop) for loop in loops],
            **part.keys,
            **({"support": True} if support else {}),
        }
        for name, v, loops, support, part in zip(names, corners, faces, supports, parts, strict=True)
    ]
    _state_contacts(document, content, parts, names, corners, faces, (scale, size, tolerance), notes)
    if content.marks and not content.facts.get("loads"):
        marks = [mark.scaled(scale) for mark in content.marks]
        reach = max(2.0 * tolerance, 1e-7 * size)
        document["loads"] = solid_loads(marks, names, corners, faces, supports, reach, options, notes)
    document |= _stated_tolerance(document, options, notes)
    if unit is not None:
        document["units"] = {"force": "N", **document.get("units", {}), "length": unit}
    elif options.like is not None:
        document.setdefault("units", options.like.units.model_dump())
    free = len(parts) - sum(supports)
    counts = f"{several(free, 'element')} and {several(sum(supports), 'support')}"
    measured = measure(document["elements"])
    length = unit or str(document.get("units", {}).get("length", "m"))
    notes.found.insert(0, f"{counts}, {in_words(measured, length)}")
    if not content.facts:
        say_size(measured, length, drawn_in, notes)
    return Imported(complete(document, options, notes, dimension=3), notes.report(), drawn_in, scale)


def _state_contacts(
    document: dict[str, Any],
    content: Solids,
    parts: list[Part],
    names: list[str],
    solids: list[Floats],
    faces: list[Faces],
    lengths: tuple[float, float, float],
    notes: Notes,
) -> None:
    """Add the interfaces that a file states, or labels of drawn ones; lengths: scale, size and tolerance."""
    scale, size, tolerance = lengths
    if content.contacts:
        of_part = dict(zip((part.name for part in parts), names, strict=True))
        document["interfaces"] = contact_entries(content.contacts, of_part, scale, size)
        if len(parts) > len(content.parts):  # supports that were added, which no file states
            document["interfaces"] += [
                {"elements": [names[contact.a], names[contact.b]], "polygon": rounded(contact.polygon, size)}
                for contact in contacts_of(solids, faces, Notes())
                if max(contact.a, contact.b) >= len(content.parts)
            ]
        notes.found.append(f"{several(len(content.contacts), 'interface')} as the file gives them")
    else:
        contacts = contacts_of(solids, faces, notes)
        if content.drawn and "interfaces" not in document:
            drawn = [(role, scale * corners) for role, corners in content.drawn]
            document["labels"] = labels_of(contacts, names, drawn, max(2.0 * tolerance, 1e-4 * size), notes)


def _stated_tolerance(document: dict[str, Any], options: ImportOptions, notes: Notes) -> dict[str, Any]:
    """Return the key "tolerance" within which all stated interfaces are taken, where they fit poorly."""
    if options.tolerance is not None or "interfaces" not in document or "tolerance" in document:
        return {}
    try:
        build_geometry(parse_scene({**complete({**document, "loads": {}}, options, Notes(), dimension=3)}))
    except stated_fit.Misfit as error:
        remark = f"{error.problem}: interfaces are taken as the file states them, within {round_up(error.most)}"
        notes.doubtful.append(f"{error.where}: {remark}")
        return {"tolerance": float(round_up(error.most))}
    except InputError:
        pass  # said where the scene is built
    return {}


def _select(content: Solids, options: ImportOptions, notes: Notes) -> Solids:
    """Return the parts that the options choose, with z upwards."""
    if content.parts:
        names = [name for part in content.parts for name in (part.group, part.name)]
        refuse_unknown(options, [*names, *(mark.layer for mark in content.marks)], "layer, group or name")
    parts = [part for part in content.parts if options.chosen(part.group, part.name)]
    notes.skip("solids", len(content.parts) - len(parts), "their layer or group is not to be read")
    if options.up != "y":
        return replace(content, parts=parts)
    notes.found.append("y up, made z")
    return replace(
        content,
        parts=[replace(part, vertices=part.vertices @ _Y_UP) for part in parts],
        contacts=[(a, b, corners @ _Y_UP) for a, b, corners in content.contacts],
        marks=[
            replace(mark, at=mark.at @ _Y_UP, tail=None if mark.tail is None else mark.tail @ _Y_UP)
            for mark in content.marks
        ],
        drawn=[(role, corners @ _Y_UP) for role, corners in content.drawn],
    )


def _with_supports(
    parts: list[Part], options: ImportOptions, notes: Notes, *, feet: bool
) -> tuple[list[Part], list[bool]]:
    """Return solids with True for each support; feet are added where a file names no support."""
    # Without `feet` only where all solids would be supports, since each reaches the lowest point: they stand on
    # something.
    supports = _supports(parts, options)
    if (feet and not options.support and not any(supports)) or (all(supports) and LOWEST in options.support):
        added = _feet(parts, 0.0 if options.tolerance is None else options.tolerance)
        if added:
            notes.assumed.append("supports below the lowest faces: the file names none")
            return [*parts, *added], [*(part.support for part in parts), *(True for _ in added)]
    return parts, supports


def _outer_faces(
    parts: list[Part], names: list[str], snapped: snapping.SnappedSolids, notes: Notes
) -> tuple[list[Floats], list[Faces]]:
    """Return vertices and plane faces of snapped solids, turned outward and merged; InputError if open."""
    cleaned = [_without_slivers(v, part.faces) for v, part in zip(snapped.vertices, parts, strict=True)]
    bent = sum(map(len, cleaned))
    cleaned = [_triangulated(v, loops) for v, loops in zip(snapped.vertices, cleaned, strict=True)]
    if sum(map(len, cleaned)) > bent:
        notes.found.append("faces that are no planes are cut into triangles, the same on both sides")
    corners, faces, *_ = closed_solids(names, snapped.vertices, cleaned)
    turned = sum(a != b for a, b in zip(faces, cleaned, strict=True))
    notes.skip("surfaces", turned, "they were inside out or mended, and are turned outward")
    before = sum(len(part.faces) for part in parts)
    corners, faces = _merge_coplanar(corners, faces)
    if (after := sum(map(len, faces))) < before:
        notes.found.append(f"{before} faces merged to {after} plane ones")
    return corners, faces


def _say_axis(vertices: list[Floats], supports: list[bool], options: ImportOptions, notes: Notes) -> None:
    """Note supports that lie below the elements along y, and not along z."""
    middles = np.array([0.5 * (v.min(axis=0) + v.max(axis=0)) for v in vertices])
    below = middles[np.array(supports)].mean(axis=0) - middles[~np.array(supports)].mean(axis=0)
    if options.up is None and below[1] < 0.0 and below[2] >= 0.3 * below[1] and abs(below[1]) > abs(below[0]):
        notes.doubtful.append("the supports lie below the other solids along y: if y points upwards, --up y")


def _feet(parts: list[Part], tolerance: float) -> list[Part]:
    """Return supports below the lowest faces of solids; none where no face is level."""
    corners = np.concatenate([part.vertices for part in parts])
    size, low = float(np.ptp(corners, axis=0).max()), float(corners[:, 2].min())
    down = np.array([0.0, 0.0, _FOOT * size])
    level_tolerance = max(_LEVEL * size, tolerance)
    level = [
        part.vertices[list(loop)]
        for part in parts
        for loop in part.faces
        if (part.vertices[list(loop), 2] <= low + level_tolerance).all()
    ]
    # triangles of one face are one foot
    footprint = shapely.union_all([shapely.Polygon(face[:, :2]) for face in level])
    feet = []
    for k, foot in enumerate(part for part in shapely.get_parts(footprint) if part.geom_type == "Polygon"):
        plan = shapely.get_coordinates(shapely.orient_polygons(foot).exterior)[:-1]
        top: Floats = np.column_stack([plan, np.full(len(plan), low)])
        count = len(top)
        sides = [(i, (i + 1) % count, count + (i + 1) % count, count + i) for i in range(count)]
        loops = (tuple(range(count))[::-1], tuple(range(count, 2 * count)), *sides)
        feet.append(Part(f"foot{k}", "supports", np.concatenate([top - down, top]), loops, support=True))
    return feet


def _note_snapping(snapped: snapping.SnappedSolids, tolerance: float, scale: float, unit: str, notes: Notes) -> None:
    """Note how many vertices were moved, and how far, in the unit of the file."""
    if snapped.moved:
        moved = several(snapped.moved, "vertex", "vertices")
        remark = f"by at most {snapped.largest / scale:.3g} {unit}; tolerance {tolerance / scale:.3g} {unit}"
        notes.snapped.append(f"{moved}, {remark}")


def _scale(content: Solids, options: ImportOptions, notes: Notes) -> tuple[float, str | None, str]:
    """Return scene units per file unit, the scene's unit of length, and the file's; InputError if unknown."""
    # The second is None where stored facts state it, and where no unit is known.
    file_unit = options.unit or content.unit
    if file_unit is not None and file_unit not in units.METRES:
        raise InputError("", f"its lengths are in {file_unit}", "`unit` " + "|".join(units.METRES))
    scene_unit = content.facts.get("units", {}).get("length")
    if scene_unit is not None:
        unit = str(scene_unit)
        return (
            (units.METRES[file_unit] / units.METRES[unit] if file_unit and unit in units.METRES else 1.0),
            None,
            file_unit or unit,
        )
    if file_unit is None:
        unit = "m" if options.like is None else options.like.units.length
        notes.assumed.append(f"lengths in {unit}: the file names no unit, give --unit")
        return 1.0, None, unit
    if file_unit != "m":
        notes.found.append(f"lengths in {file_unit}, times {units.METRES[file_unit]:g} to m")
    return units.METRES[file_unit], "m", file_unit


def _names(wanted: Sequence[str]) -> list[str]:
    """Make names unique: empty ones become "b" and number, repeated ones get a suffix."""
    used: set[str] = set()
    names = []
    for number, name in enumerate(wanted):
        base = name.strip() or f"b{number}"
        unique, k = base, 1
        while unique in used:
            k += 1
            unique = f"{base}.{k}"
        used.add(unique)
        names.append(unique)
    return names


def _without_slivers(vertices: Floats, faces: Faces) -> Faces:
    """Return faces without collapsed ones and repeated corners; corners (k, 3) at one place get one index."""
    node = merge_points(vertices, 0.0)
    first = np.unique(node, return_index=True)[1]
    loops = []
    for loop in faces:
        corners = [int(first[node[index]]) for index in loop]
        short = tuple(index for position, index in enumerate(corners) if index != corners[position - 1])
        if len(set(short)) > 2:
            loops.append(short)
    return tuple(loops)


def _triangulated(vertices: Floats, faces: Faces) -> Faces:
    # A face with the same corners is split in the same way in every solid.
    loops: list[tuple[int, ...]] = []
    for loop in faces:
        corners = vertices[list(loop)]
        normal = area_vector(corners)
        length = float(np.linalg.norm(normal))
        off = np.abs((corners - corners.mean(axis=0)) @ normal).max() / length if length > 0.0 else 0.0
        if len(loop) == 3 or off <= 0.1 * tolerances.FACE * float(np.ptp(corners, axis=0).max()):
            loops.append(loop)
            continue
        first = _apex(corners)
        turned = loop[first:] + loop[:first]
        loops += [(turned[0], turned[k], turned[k + 1]) for k in range(1, len(turned) - 1)]
    return tuple(loops)


def _apex(corners: Floats) -> int:
    """Return the corner from which a bent face (k, 3) is split."""
    # Of a quad's shorter diagonal, else the lexicographic first.
    order = np.lexsort(corners.T)
    if len(corners) != 4:
        return int(order[0])
    diagonals = [float(np.linalg.norm(corners[k] - corners[k + 2])) for k in (0, 1)]
    if abs(diagonals[0] - diagonals[1]) <= 1e-9 * max(diagonals):
        return int(order[0])
    return int(np.argmin(diagonals))


def _merge_coplanar(vertices: Sequence[Floats], faces: Sequence[Faces]) -> tuple[list[Floats], list[Faces]]:
    """Merge coplanar faces of solids to one face per plane piece; return vertices and faces."""
    # Solids with a piece that has holes keep their faces.
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
        index_of: dict[tuple[float, ...], int] = {}
        outlines = tuple(
            tuple(index_of.setdefault(tuple(corner), len(index_of)) for corner in piece[0].tolist()) for piece in pieces
        )
        merged_vertices.append(np.array(list(index_of)))
        merged_faces.append(outlines)
    return merged_vertices, merged_faces


def with_own_points(points: Floats, faces: Iterable[tuple[int, ...]]) -> tuple[Floats, Faces]:
    """Return the points that faces use, and the faces by their indices among them."""
    loops = list(faces)
    used = sorted({index for loop in loops for index in loop})
    index_of = {old: new for new, old in enumerate(used)}
    return points[used], tuple(tuple(index_of[index] for index in loop) for loop in loops)


def split(points: Floats, faces: Faces, tolerance: float) -> list[Ints]:
    """Split the faces of a mesh into solids, as arrays (k,); InputError where touching solids cannot be told apart."""
    # Faces connected by corner indices form a solid where they are closed. In a file without shared indices, a solid
    # ends where the surface first closes, so that touching blocks stay separate. Otherwise faces that touch are
    # connected.
    loose = _components(faces)
    if all(_is_closed(faces, part) for part in loose):
        return loose
    node = merge_points(points, tolerance).tolist()
    loops = tuple(tuple(node[index] for index in loop) for loop in faces)
    closing: list[Ints] = []
    open_edges: set[tuple[int, int]] = set()
    begin = 0
    for number, loop in enumerate(loops):
        for edge in _edges(loop):
            open_edges ^= {edge}
        if not open_edges:
            closing.append(np.arange(begin, number + 1))
            begin = number + 1
    if begin == len(loops) and all(_is_closed(loops, part) for part in closing):
        return closing
    touching = _components(loops)
    for part in touching:
        if max(_uses(loops, part).values()) > 3:
            raise InputError(
                "", "solids that touch share their corners and cannot be told apart", "a group or a name for each solid"
            )
    return touching


def _edges(loop: Sequence[int]) -> list[tuple[int, int]]:
    return [(min(a, b), max(a, b)) for a, b in zip(loop, (*loop[1:], loop[0]), strict=True)]


def _components(faces: Faces) -> list[Ints]:
    """Return the connected components of faces by shared corners, in order of first face."""
    start = np.repeat([loop[0] for loop in faces], [len(loop) for loop in faces])
    end = np.array([index for loop in faces for index in loop])
    label = components(int(end.max()) + 1, start, end)
    part = label[[loop[0] for loop in faces]]
    _, first = np.unique(part, return_index=True)
    return [np.flatnonzero(part == part[k]) for k in np.sort(first).tolist()]


def _uses(faces: Faces, part: Ints) -> Counter[tuple[int, int]]:
    return Counter(edge for k in part.tolist() for edge in _edges(faces[k]))


def _is_closed(faces: Faces, part: Ints) -> bool:
    """Return True if the faces `part` (k,) number at least four and share each edge in pairs."""
    return len(part) > 3 and set(_uses(faces, part).values()) == {2}
