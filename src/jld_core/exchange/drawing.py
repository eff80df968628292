"""Conversion of a drawing to planar elements: outlines or a network of lines.

Paths are snapped, cut into cells and given roles by their layers. All planar readers use this module.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.drawn import MOST, Cell, Drawing, Mark
from jld_core.exchange.drawn_loads import drawn_loads
from jld_core.exchange.options import (
    FACET,
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
from jld_core.exchange.paths import Path, flatten
from jld_core.geometry import find_planar_contacts, polygons
from jld_core.geometry.snapping import Snapped, snap_paths, straight
from jld_core.scene.units import METRES

_LEAST, _MOST_SIZE = 1e-12, 1e12
"""Limits of the size of a drawing, scene units."""

_CHUNK, _CROSSINGS = 64, 5
"""Number of lines per batch in counting crossings, and largest number of crossings in units of `MOST`."""


def planar_scene(drawing: Drawing, options: ImportOptions, notes: Notes) -> Imported:
    """Convert the content of a planar drawing to a scene document.

    The paths are scaled to metres where a unit is known, snapped, and cut into elements. Layers decide supports, labels
    and loads. Decisions are added to `notes`, and the result holds them as its report.

    Raises InputError if nothing can become an element, or a support is missing. It also does so for an invalid unit,
    size or load, and for more than `MOST` corners or cells.
    """
    scale, unit = _scale(drawing, options, notes)
    paths = [_scaled(path, scale) for path in drawing.paths if options.role(path.layer) not in ("skip", "id")]
    ignored = len(drawing.paths) - len(paths)
    notes.skip("paths", ignored, "on layers for dimensions and texts")
    marks = [_moved(mark, scale) for mark in drawing.marks]
    loads = [path for path in paths if options.role(path.layer) in ("load", "dead")]
    paths = [path for path in paths if options.role(path.layer) not in ("load", "dead")]
    if not paths:
        raise InputError(
            "", "it holds no closed outline and no line", "outlines, or a network of lines, to be elements"
        )
    if sum(len(path.points) for path in paths) > MOST:
        raise InputError("", "it holds more corners than a structure has", f"at most {MOST}")
    size = float(max(np.ptp(np.concatenate([path.points[:, :2] for path in paths]), axis=0)))
    if not _LEAST <= size <= _MOST_SIZE:
        raise InputError("", f"it is {size:g} {unit} large, out of range", f"from {_LEAST:g} to {_MOST_SIZE:g}")
    tolerance = SNAP * size if options.tolerance is None else options.tolerance
    chords = flatten(paths, FACET * size if options.facet is None else options.facet, max(tolerance, 1e-9 * size))
    if chords.arcs:
        notes.found.append(f"{several(chords.arcs, 'arc')} as chords, at most {chords.deviation:.3g} off")
    snapped = snap_paths(chords.points, [path.closed for path in paths], tolerance, keep_nodes=True)
    _note_snapped(snapped, tolerance, notes)
    cells = _cells(paths, snapped, options, size, tolerance, notes)
    _name(cells, marks, options)
    _support(cells, marks, options, size, tolerance, notes)
    document: dict[str, Any] = {"name": drawing.name, "units": {"length": unit, "force": "N"}}
    document |= {key: value for key, value in drawing.facts.items() if key not in ("loads", "elements")}
    keys = drawing.facts.get("elements", {})
    document["elements"] = [_element(cell, size) | keys.get(cell.name, {}) for cell in cells]
    if options.thickness is not None or "thickness" not in document:
        document["thickness"] = 1.0 if options.thickness is None else options.thickness
        if options.thickness is None:
            notes.assumed.append("thickness 1: give --thickness")
    document["loads"] = drawn_loads(loads, marks, cells, options, drawing, notes)
    document |= _labels(cells, paths, snapped, options, max(2.0 * tolerance, 1e-7 * size), notes)
    free = sum(not cell.support for cell in cells)
    notes.found.insert(0, f"{several(free, 'element')} and {several(len(cells) - free, 'support')}")
    return Imported(complete(document, options, notes, dimension=2), notes.report())


def _scale(drawing: Drawing, options: ImportOptions, notes: Notes) -> tuple[float, str]:
    """Return the factor to the scene's length unit, and the name of this unit."""
    if "units" in drawing.facts and options.unit is None:
        return 1.0, str(drawing.facts["units"].get("length", "m"))
    unit = options.unit or drawing.unit
    if unit is None:
        notes.assumed.append("lengths in m: the file names no unit, give --unit")
        return 1.0, "m"
    if unit not in METRES:
        raise InputError("", f"its lengths are in {unit}", "`unit` " + "|".join(METRES))
    if unit != "m":
        notes.found.append(f"lengths in {unit}, times {METRES[unit]:g} to m")
    return METRES[unit], "m"


def _scaled(path: Path, scale: float) -> Path:
    """Return a path with scaled coordinates."""
    factor = np.array([scale, scale, 1.0])
    return Path(path.points * factor, path.closed, path.layer, path.name, tuple(hole * factor for hole in path.holes))


def _moved(mark: Mark, scale: float) -> Mark:
    """Return a mark with scaled coordinates."""
    end = None if mark.end is None else (mark.end[0] * scale, mark.end[1] * scale)
    return Mark((mark.at[0] * scale, mark.at[1] * scale), mark.layer, mark.text, end)


def _note_snapped(snapped: Snapped, tolerance: float, notes: Notes) -> None:
    """Note the number and largest displacement of moved corners, and the collapsed paths."""
    notes.largest = snapped.largest
    if snapped.moved:
        notes.snapped.append(
            f"{several(snapped.moved, 'corner')}, by at most {snapped.largest:.3g}; tolerance {tolerance:.3g}"
        )
    notes.skip("paths", len(snapped.collapsed), f"nothing left of them within the tolerance {tolerance:.3g}")


def _cells(
    paths: list[Path], snapped: Snapped, options: ImportOptions, size: float, tolerance: float, notes: Notes
) -> list[Cell]:
    """Return the cells that become elements, without those inside holes.

    They are outlines, cut by lines that cross them; without outlines of free elements, the cells of the network of
    lines. size, tolerance: of the drawing, scene units. Raises InputError for no cell, or for too many.
    """
    kept = [k for k in range(len(paths)) if k not in snapped.collapsed]
    holes = [k for k in kept if paths[k].closed and options.role(paths[k].layer) == "hole"]
    outlines = [k for k in kept if paths[k].closed and k not in holes]
    lines = [k for k in kept if not paths[k].closed]
    notes.skip(
        "holes", sum(len(paths[k].holes) for k in outlines), "an element has none; what lies in them stays empty"
    )
    network = [k for k in outlines if options.role(paths[k].layer) != "support"] == []
    segments = [shapely.LineString(snapped.paths[k]) for k in lines]
    segments += [shapely.LinearRing(snapped.paths[k]) for k in holes]
    empty = shapely.union_all([shapely.Polygon(snapped.paths[k]) for k in holes])
    if network and not segments:
        raise InputError("", "all it holds are supports", "at least one outline, or a network of lines, that is free")
    _refuse_crossings(segments)
    used = _one_outline_each(outlines, paths, snapped, notes)
    cells: list[Cell] = []
    if network:
        cells = _network(segments, [paths[k].layer for k in (*lines, *holes)], options, size, notes)
        cells += [Cell(snapped.paths[k], paths[k].layer, paths[k].name) for k in used]
    else:
        tree = shapely.STRtree(segments) if segments else None
        for k in used:
            shape = shapely.Polygon(snapped.paths[k])
            uncut = tree is None or options.role(paths[k].layer) == "support"
            near = [] if uncut or tree is None else [segments[i] for i in sorted(tree.query(shape).tolist())]
            pieces = _cut(shape, near, size) if shape.is_valid else []
            if len(pieces) > 1:
                cells += [Cell(piece, paths[k].layer, None, owner=k) for piece in pieces]
            else:
                cells.append(Cell(snapped.paths[k], paths[k].layer, paths[k].name))
        parts = sum(cell.owner is not None for cell in cells)
        if parts:
            whole = len({cell.owner for cell in cells if cell.owner is not None})
            notes.found.append(f"{several(whole, 'outline')} cut into {parts} cells by the lines that cross them")
    cells = [cell for cell in cells if not empty.contains(shapely.Polygon(cell.points).representative_point())]
    if not cells:
        raise InputError("", "its lines enclose nothing", "lines that meet within `tolerance` around every cell")
    if len(cells) > MOST:
        raise InputError("", f"it makes {len(cells)} cells", f"at most {MOST}")
    return cells


def _refuse_crossings(segments: list[shapely.LineString]) -> None:
    """Raise InputError for too many crossings, before these are computed.

    A few thousand lines may have millions of crossings.
    """
    if len(segments) ** 2 <= MOST:
        return
    tree, total = shapely.STRtree(segments), 0
    for begin in range(0, len(segments), _CHUNK):
        total += tree.query(np.array(segments[begin : begin + _CHUNK]), predicate="intersects").shape[1]
        if total > _CROSSINGS * MOST:
            raise InputError(
                "", "its lines cross one another more often than those of a structure", "a network of cells"
            )


def _one_outline_each(outlines: list[int], paths: list[Path], snapped: Snapped, notes: Notes) -> list[int]:
    """Return the outlines, indices into `paths`, without those drawn twice.

    Two outlines are the same if they have the same corners in any order.
    """
    seen: dict[bytes, int] = {}
    kept = []
    for k in outlines:
        corners = snapped.paths[k]
        key = np.sort(corners.view([("x", corners.dtype), ("y", corners.dtype)]).ravel(), order=("x", "y")).tobytes()
        if key in seen:
            continue
        seen[key] = k
        kept.append(k)
    notes.skip("outlines", len(outlines) - len(kept), "drawn twice")
    return kept


def _network(
    segments: list[shapely.LineString], layers: list[str], options: ImportOptions, size: float, notes: Notes
) -> list[Cell]:
    """Return the cells enclosed by a network of lines, from below to above.

    A cell is a support where more than half of its boundary lies on support lines.
    """
    noded = shapely.node(shapely.MultiLineString(segments))
    cells, cuts, dangles, invalid = shapely.polygonize_full([noded])
    notes.skip(
        "lines", len(cuts.geoms) + len(dangles.geoms), "they end inside a cell, or between two, without dividing it"
    )
    notes.skip("rings", len(invalid.geoms), "they cross themselves")
    found = []
    supports = [s for s, layer in zip(segments, layers, strict=True) if options.role(layer) == "support"]
    ground = shapely.union_all(supports) if supports else None
    for cell in cells.geoms:
        if cell.area <= 1e-12 * size**2:
            continue
        for piece in _without_holes(cell):
            ring = shapely.get_coordinates(piece.exterior)[:-1]
            drawn = 0.0 if ground is None else cell.exterior.intersection(ground).length / cell.exterior.length
            layer = next(la for la in layers if options.role(la) == "support") if drawn > 0.5 else ""
            found.append(Cell(ring, layer, None))
    found.sort(key=lambda cell: tuple(np.round(cell.points.mean(axis=0)[::-1] / size, 9)))
    notes.found.append(f"a network of {several(len(segments), 'line')} around {several(len(found), 'cell')}")
    return found


def _cut(shape: shapely.Polygon, lines: list[shapely.LineString], size: float) -> list[Floats]:
    """Cut an outline by lines; return corners (k, 2) of the pieces, the lowest first.

    Empty where no line crosses it.
    """
    inside = [shapely.intersection(shape, line) for line in lines]
    kept = [part for part in inside if part.length > 1e-9 * size]
    if not kept:
        return []
    noded = shapely.union_all([shape.exterior, *kept])
    pieces = [piece for piece in shapely.polygonize([noded]).geoms if piece.area > 1e-12 * size**2]
    pieces = [part for piece in pieces if shape.covers(piece.representative_point()) for part in _without_holes(piece)]
    rings = [shapely.get_coordinates(piece.exterior)[:-1] for piece in pieces]
    return sorted(rings, key=lambda ring: tuple(np.round(ring.mean(axis=0)[::-1] / size, 9)))


def _without_holes(cell: shapely.Polygon) -> list[shapely.Polygon]:
    """Return a cell without holes, cut through them, since an element has one outline."""
    if not cell.interiors:
        return [cell]
    x0, y0, x1, y1 = cell.bounds
    middle = shapely.Polygon(cell.interiors[0]).centroid.x
    halves = [cell.intersection(shapely.box(a, y0, b, y1)) for a, b in ((x0, middle), (middle, x1))]
    parts = [part for half in halves for part in shapely.get_parts(half) if part.geom_type == "Polygon"]
    return [piece for part in parts for piece in _without_holes(part)]


def _name(cells: list[Cell], marks: list[Mark], options: ImportOptions) -> None:
    """Name the cells: by a text on a name layer inside, else by the outline, else by number.

    Changes the cells; of equal names the first one stays.
    """
    named = [mark for mark in marks if mark.text and options.role(mark.layer) == "id"]
    if named:
        tree = shapely.STRtree([shapely.Polygon(cell.points) for cell in cells])
        points = shapely.points([mark.at for mark in named])
        for which, cell in zip(*tree.query(points, predicate="intersects").tolist(), strict=True):
            cells[cell].name = str(named[which].text).strip()
    taken: set[str] = set()
    counter = 0
    for cell in cells:
        if cell.name is None or not cell.name or cell.name in taken:
            counter += 1
            while f"e{counter}" in taken or any(other.name == f"e{counter}" for other in cells):
                counter += 1
            cell.name = f"e{counter}"
        taken.add(cell.name)


def _support(
    cells: list[Cell], marks: list[Mark], options: ImportOptions, size: float, tolerance: float, notes: Notes
) -> None:
    """Mark the cells that are supports: by layer, by a support mark inside, or as lowest.

    Any of the three suffices; the lowest point counts only with `LOWEST` in `options.support`. size, tolerance: of the
    drawing, scene units. Raises InputError if no cell, or every cell, is a support.
    """
    shapes = [shapely.Polygon(cell.points) for cell in cells]
    pins = [mark.at for mark in marks if options.role(mark.layer) == "support"]
    pinned = set()
    if pins:
        pinned = set(shapely.STRtree(shapes).query(shapely.points(pins), predicate="intersects")[1].tolist())
    low = min(float(cell.points[:, 1].min()) for cell in cells)
    for k, cell in enumerate(cells):
        lowest = LOWEST in options.support and cell.points[:, 1].min() <= low + max(tolerance, 1e-9 * size)
        cell.support = options.role(cell.layer) == "support" or k in pinned or lowest
    if LOWEST in options.support:
        notes.found.append(f"supports where the lowest point is: {listed(c.name or '' for c in cells if c.support)}")
    check_supports([cell.support for cell in cells], options)


def check_supports(support: Sequence[bool], options: ImportOptions) -> None:
    """Raise InputError where no element is a support, or every element is one.

    support: True for each element that is a support. options: options of the import, named in the message.
    """
    if not any(support):
        given = f"no layer is like {listed(options.support)}" if options.support else "no layer is named for supports"
        raise InputError("", f"it has no support: {given}", '`support` with the name of a layer, or `support="lowest"`')
    if all(support):
        raise InputError("", "all of its elements are supports", "at least one that is free")


def _element(cell: Cell, size: float) -> dict[str, Any]:
    """Return the scene entry of a cell."""
    # corners of neighbours in straight edges were needed for cutting; the element does not need them
    cell.points = straight(cell.points)
    cell.points = points = cell.points if polygons.area(cell.points[None])[0] > 0.0 else cell.points[::-1]
    entry: dict[str, Any] = {"id": cell.name, "polygon": rounded(points, size)}
    return entry | ({"support": True} if cell.support else {})


def _labels(
    cells: list[Cell], paths: list[Path], snapped: Snapped, options: ImportOptions, reach: float, notes: Notes
) -> dict[str, Any]:
    """Return labels of the interfaces that lie on lines of joint or crack layers.

    The result holds lists of pairs of elements, or all interfaces where two of one pair have different labels. It is
    empty without such lines. reach: distance within which an interface lies on a line, scene units.
    """
    drawn: dict[str, list[shapely.Geometry]] = {"dry": [], "inner": []}
    for k, path in enumerate(paths):
        role = options.role(path.layer)
        if role in drawn and len(snapped.paths[k]) > 1:
            points = snapped.paths[k]
            drawn[role].append(shapely.LineString(np.concatenate([points, points[:1]]) if path.closed else points))
    if not any(drawn.values()):
        return {}
    outlines = [cell.points for cell in cells]
    contacts = [c for c in find_planar_contacts(outlines) if not (cells[c.a].support and cells[c.b].support)]
    if not contacts:
        return {}
    ends = np.array([contact.ends for contact in contacts])
    probes = np.stack([ends[:, 0] + share * (ends[:, 1] - ends[:, 0]) for share in (0.25, 0.5, 0.75)], axis=1)
    label = np.full(len(contacts), "", dtype=object)
    for role in ("dry", "inner"):
        if drawn[role]:
            far = shapely.distance(shapely.points(probes), shapely.union_all(drawn[role])).max(axis=1)
            label[far <= reach] = role
    of_pair: dict[tuple[str, str], list[str]] = {}
    for contact, word in zip(contacts, label.tolist(), strict=True):
        of_pair.setdefault((cells[contact.a].name or "", cells[contact.b].name or ""), []).append(word)
    counted = ", ".join(f"{int((label == role).sum())} {role}" for role in ("dry", "inner"))
    notes.found.append(f"labels of {several(int((label != '').sum()), 'face')} by their layers: {counted}")
    if all(len(set(words)) == 1 for words in of_pair.values()):
        return {
            "labels": {
                role: [list(pair) for pair, words in of_pair.items() if words[0] == role] for role in ("inner", "dry")
            }
        }
    entries = [
        {
            "elements": [cells[contact.a].name, cells[contact.b].name],
            "polygon": contact.ends.tolist(),
            **({"label": word} if word else {}),
        }
        for contact, word in zip(contacts, label.tolist(), strict=True)
    ]
    return {"interfaces": entries}
