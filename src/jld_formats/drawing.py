"""Conversion of a planar drawing to elements: paths are snapped, cut into cells, given roles by layers."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Floats, InputError, ParameterError
from jld_core.geometry import outlines as polygons
from jld_core.geometry import planar_contacts, snapping
from jld_core.scene import units
from jld_formats.cells import (
    FoundCells,
    Gap,
    NothingEnclosed,
    find_cells,
    find_gaps,
    line_of,
    refuse_crossings,
    say_large,
    say_nested,
    say_size,
    with_holes,
    without_frames,
)
from jld_formats.drawn_loads import MOST, Cell, Drawing, Mark, Structure, drawn_loads
from jld_formats.forces import states_force
from jld_formats.options import (
    CLOSED,
    EDGE,
    FACET,
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
from jld_formats.paths import Path, flatten, without_repeats

_LEVEL: Final = 1e-6  # height above the lowest point, relative to the size, up to which an edge or a face lies there
_LEAN: Final = 0.05  # least run of the sides of a flat arch over its depth; below it an outline is a wall
_FOOT: Final = 0.05  # height of supports that are added, relative to the size
_SMOOTH: Final = np.cos(np.radians(35.0))  # cosine of the largest turn between chords of one curve
_CURVED: Final = np.radians(10.0)  # least turn of a curve from end to end
_RINGS: Final = 8  # largest number of rings of an arch
_RISING: Final = 0.6  # largest upward component of the outer normal of a springing


def planar_feet(cells: list[Cell], tolerance: float, notes: Notes) -> list[Cell]:
    """Return supports for the cells of a drawing that names none; none where nothing is level or raked."""
    shapes = [shapely.Polygon(cell.points) for cell in cells if not cell.support]
    structure = shapely.union_all([shapely.make_valid(shape) for shape in shapes])
    rings = [_ring(part) for part in shapely.get_parts(structure) if part.geom_type == "Polygon"]
    corners = np.concatenate(rings)
    size, lowest = float(np.ptp(corners, axis=0).max()), float(corners[:, 1].min())
    depth = _FOOT * size
    near = max(_LEVEL * size, tolerance)
    skewbacks = _skewbacks(rings[0], size, near) if len(rings) == 1 else []
    if skewbacks:
        notes.assumed.append("supports beside the raked sides of a flat arch: the drawing names none")
        return [_support_cell(points) for points in skewbacks]
    springings = [line for ring in rings for line in _springings(ring)]
    if not springings and len(shapes) <= _RINGS:  # rings of an arch whose ends are no line
        of_ring = [_springings(_ring(shape)) for shape in shapes]
        springings = list(itertools.chain(*of_ring)) if all(of_ring) else []
    spans = [
        sorted((float(a[0]), float(b[0])))
        for a, b in itertools.chain(*map(_edges, rings))
        if max(a[1], b[1]) - lowest <= near and abs(b[0] - a[0]) > near
    ]
    if spans and not any(line[:, 1].max() - lowest > near for line in springings):
        notes.assumed.append("supports below the lowest edges: the drawing names none")
        below = lowest - depth
        return [_support_cell(np.array([(x0, below), (x1, below), (x1, lowest), (x0, lowest)])) for x0, x1 in spans]
    springings = springings or [np.array(edge) for ring in rings for edge in _lowest_edges(ring)]
    if not springings:
        return []
    notes.assumed.append("supports at the springings: the drawing names none")
    feet = [shapely.Polygon([*line, *(line + depth * _normal(line[0], line[-1]))[::-1]]) for line in springings]
    return [_support_cell(_ring(foot)) for foot in _without(feet, structure)]


def _support_cell(points: Floats) -> Cell:
    return Cell(points, "supports", None, support=True)


def _ring(shape: shapely.Polygon) -> Floats:
    """Return the corners (k, 2) of an outline, counter-clockwise, without those in straight edges."""
    return snapping.straight(shapely.get_coordinates(shapely.orient_polygons(shape).exterior)[:-1])


def _without(feet: list[shapely.Polygon], structure: shapely.Geometry) -> list[shapely.Polygon]:
    """Return the largest part of each area that lies outside a structure and outside those before."""
    areas: list[shapely.Polygon] = []
    for foot in feet:
        occupied = shapely.union_all([structure, *areas])
        if occupied.intersection(foot).area > 1e-9 * foot.area:
            parts = [p for p in shapely.get_parts(foot.difference(occupied)) if p.geom_type == "Polygon"]
            foot = max(parts, key=lambda part: float(part.area), default=shapely.Polygon())
        if not foot.is_empty:
            areas.append(foot)
    return areas


def _edges(ring: Floats) -> list[tuple[Floats, Floats]]:
    return list(zip(ring, np.roll(ring, -1, axis=0), strict=True))


def _normal(a: Floats, b: Floats) -> Floats:
    """Return the outer unit normal (2,) of an edge of a counter-clockwise ring."""
    along = (b - a) / np.hypot(*(b - a))
    return np.array([along[1], -along[0]])


def _springings(ring: Floats) -> list[Floats]:
    """Return the two ends (j, 2) of a band between two curves; none for any other counter-clockwise ring (k, 2)."""
    along = np.roll(ring, -1, axis=0) - ring
    along = along / np.hypot(*along.T)[:, None]
    before = np.roll(along, 1, axis=0)
    cosine = np.einsum("ij,ij->i", before, along)
    turn = np.arctan2(before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0], cosine)
    corners = np.flatnonzero(cosine < _SMOOTH).tolist()
    if len(corners) != 4:
        return []
    runs = []
    for first, last in zip(corners, [*corners[1:], corners[0] + len(ring)], strict=True):
        inside = np.arange(first + 1, last) % len(ring)
        runs.append((ring[np.arange(first, last + 1) % len(ring)], abs(float(turn[inside].sum())) > _CURVED))
    ends = [line for line, curved in runs if not curved]
    if [curved for _, curved in runs] not in ([True, False] * 2, [False, True] * 2):
        return []
    return ends if all(_normal(line[0], line[-1])[1] < _RISING for line in ends) else []


def _lowest_edges(ring: Floats) -> list[tuple[Floats, Floats]]:
    """Return the edge at the lowest corner of either half of a ring (k, 2) that looks down and out."""
    middle = 0.5 * (ring[:, 0].min() + ring[:, 0].max())
    edges = _edges(ring)
    edges_found: dict[int, tuple[Floats, Floats]] = {}
    for side in (-1.0, 1.0):
        half = np.flatnonzero(side * (ring[:, 0] - middle) > 0.0)
        if not len(half):
            continue
        corner = int(half[np.argmin(ring[half, 1])])
        pair = [(corner - 1) % len(ring), corner]
        best = max(pair, key=lambda k: float(_normal(*edges[k]) @ (side, -1.0)))
        if float(_normal(*edges[best]) @ (side, -1.0)) > 0.0:
            edges_found[best] = edges[best]
    return list(edges_found.values())


def _skewbacks(corners: Floats, size: float, near: float) -> list[Floats]:
    """Return supports beside both sides of a flat arch's outline (k, 2); none for any other."""
    # A flat arch has four corners, a level soffit at least as long as it is deep, and sides that lean outwards.
    if len(corners) != 4:
        return []
    order = np.argsort(corners[:, 1], kind="stable")
    (x0, y0), (x1, y1) = sorted(corners[order[:2]].tolist())
    (x2, y2), (x3, y3) = sorted(corners[order[2:]].tolist())
    deep = min(y2, y3) - y0
    if not (abs(y1 - y0) <= near and 0.0 < deep <= x1 - x0 and x0 - x2 > _LEAN * deep and x3 - x1 > _LEAN * deep):
        return []
    out = _FOOT * size
    return [
        np.array([[xs, y0], [xt + side * out, y0], [xt + side * out, yt], [xt, yt]])
        for xs, xt, yt, side in ((x0, x2, y2, -1.0), (x1, x3, y3, 1.0))
    ]


_LEAST, _MOST_SIZE = 1e-12, 1e12  # limits of the size of a drawing, scene units
_REACH: Final = 0.05  # width of a gap, relative to the size, up to which a tolerance may close it
_OPEN: Final = 20.0  # width of a gap, in tolerances, up to which it is one that was hardly meant
_SHARE: Final = 0.9  # least share of closed area and of entities that is read without a word


def _state_thickness(document: dict[str, Any], options: ImportOptions, notes: Notes) -> None:
    """Put the thickness of the options into a document, 1 where nothing states it."""
    if options.thickness is not None or "thickness" not in document:
        document["thickness"] = 1.0 if options.thickness is None else options.thickness
        if options.thickness is None:
            notes.assumed.append("thickness 1: give --thickness")


def planar_scene(drawing: Drawing, options: ImportOptions, notes: Notes, *, feet: bool = False) -> Imported:
    """Convert the content of a planar drawing to a scene document.

    Raises InputError if nothing can become an element, or a support is missing. It also does so for an invalid unit,
    size or load, and for more than `MOST` corners or cells.

    Parameters
    ----------
    drawing : Drawing
        Content.
    options : ImportOptions
        Options.
    notes : Notes
        Notes, which grow.
    feet : bool
        Add supports below the lowest edges or at springings where the drawing names none.

    Returns
    -------
    Imported
        Document with its report.
    """
    # The paths are scaled to metres where a unit is known, snapped, and cut into elements. Layers decide supports,
    # labels and loads. Decisions are added to `notes`, and the result holds them as its report.
    if feet:
        _refuse_self_crossing(drawing, options)
    scale, unit = _scale(drawing, options, notes)
    drawn_in = options.unit or drawing.unit or unit
    paths, loads = _read_paths(drawing, options, scale, notes)
    marks = [mark.scaled(scale) for mark in drawing.marks]
    _refuse_range(paths, loads, marks, unit)
    notes.reached("paths", len(paths))
    paths = without_frames(paths, marks, options, notes)
    read = len(paths)
    paths, holes = with_holes(paths)
    # arcs as chords, whose ends are snapped
    size = float(max(np.ptp(np.concatenate([path.points[:, :2] for path in paths]), axis=0)))
    tolerance = _tolerance(paths, size, options, drawing) if options.tolerance is None else scale * options.tolerance
    facet = FACET * size if options.facet is None else scale * options.facet
    paths = [without_repeats(path, tolerance) for path in paths]
    chords = flatten(paths, facet, max(tolerance, 1e-9 * size))
    if chords.arcs:
        notes.found.append(f"{several(chords.arcs, 'arc')} as chords, at most {chords.deviation:.3g} off")
    refuse_crossings([line_of(path, points) for path, points in zip(paths, chords.points, strict=True)], paths)
    snapped = snapping.snap_paths(chords.points, [path.closed for path in paths], tolerance, keep_nodes=True)
    gaps = find_gaps(chords.points, paths, options, _OPEN * tolerance)
    _note_snapped(snapped, gaps, tolerance, scale, drawn_in, notes)
    # elements and supports
    try:
        cells_found = find_cells(paths, snapped, holes, options, size, tolerance, notes)
    except NothingEnclosed as error:
        gaps = [gap for gap in find_gaps(chords.points, paths, options, size) if gap.width > tolerance]
        raise _too_wide(error, gaps, size, scale, drawn_in) from None
    cells = cells_found.cells
    _support(cells, marks, options, size, tolerance, notes, nested=cells_found.nested, feet=feet, paths=paths)
    _name(cells, marks, options)
    _note_open(gaps, tolerance, scale, drawn_in, notes)
    if LOWEST in options.support:
        notes.found.append(f"supports where the lowest point is: {listed(c.name or '' for c in cells if c.support)}")
    _say_forces([] if drawing.facts else marks, options, notes)
    say_large(cells, notes)
    say_nested(cells_found.nested, notes)
    _say_dropped(drawing, cells_found, paths, snapped, read, notes)
    # the scene, with loads and labels
    document: dict[str, Any] = {"name": drawing.name, "units": {"length": unit, "force": "N"}}
    document |= {key: value for key, value in drawing.facts.items() if key not in ("loads", "elements")}
    keys = drawing.facts.get("elements", {})
    document["elements"] = [_element(cell, size) | keys.get(cell.name, {}) for cell in cells]
    _state_thickness(document, options, notes)
    reach = max(2.0 * tolerance, 1e-7 * size)
    structure = Structure(cells, float(document["thickness"]), unit, reach)
    document["loads"] = drawn_loads(loads, marks, structure, options, drawing, notes)
    in_contacts = {name for entry in document.get("interfaces", []) for name in entry["elements"]}
    if not in_contacts or not in_contacts <= {cell.name for cell in cells}:
        document.pop("interfaces", None)  # of elements that are drawn no more
        document |= _labels(cells, paths, snapped, options, reach, notes)
    free = sum(not cell.support for cell in cells)
    measured = measure(document["elements"])
    if not drawing.facts:
        say_size(measured, unit, drawn_in, notes)
    counts = f"{several(free, 'element')} and {several(len(cells) - free, 'support')}"
    notes.found.insert(0, f"{counts}, {in_words(measured, unit)}")
    document = complete(document, options, notes, dimension=2)
    return Imported(document, notes.report(), drawn_in, scale)


def _read_paths(drawing: Drawing, options: ImportOptions, scale: float, notes: Notes) -> tuple[list[Path], list[Path]]:
    """Return the paths of structure and of loads, scene units; InputError where none is structure."""
    if options.up is not None:
        raise ParameterError("up", "the file is a drawing, which has no such axis", "no such option")
    layers = [path.layer for path in drawing.paths] + [mark.layer for mark in drawing.marks]
    refuse_unknown(options, [*layers, *drawing.layers], "layer")
    ignored = Counter(path.layer for path in drawing.paths if options.role(path.layer) == "skip")
    for layer, count in sorted(ignored.items()):
        why = "its name says a frame, axis, dimension or text" if options.chosen(layer) else "it is not to be read"
        notes.skip(f"{'path' if count == 1 else 'paths'} on layer {layer or '(none)'}", count, why)
    read = [path.scaled(scale) for path in drawing.paths if options.role(path.layer) not in ("skip", "id")]
    loads = [path for path in read if options.role(path.layer) in ("load", "dead")]
    paths = [path for path in read if options.role(path.layer) not in ("load", "dead")]
    if not paths:
        remark = f": all paths are on layers that are not read ({listed(sorted(ignored))})" if ignored else ""
        expected = "outlines, or a network of lines, to be elements"
        raise InputError("", f"it holds no closed outline and no line{remark}", expected)
    if sum(len(path.points) for path in paths) > MOST:
        raise InputError("", "it holds too many corners", f"at most {MOST}")
    return paths, loads


def _refuse_self_crossing(drawing: Drawing, options: ImportOptions) -> None:
    """Raise InputError if a closed outline of a drawing crosses itself, naming the place."""
    # Crossings that enclose less than a thousandth of the area are left to the import, which closes gaps.
    for path in drawing.paths:
        if not path.closed or options.role(path.layer) is not None or len(path.points) < 4:
            continue
        outline = shapely.Polygon(path.points[:, :2])
        covered = shapely.make_valid(outline).area
        if outline.is_valid or abs(covered - outline.area) <= 1e-3 * covered:
            continue
        x, y = shapely.is_valid_reason(outline).rstrip("]").rpartition("[")[2].split()[:2]
        problem = f"its outline crosses itself at ({float(x):.6g}, {float(y):.6g})"
        raise InputError("", problem, "corners in the order in which one walks round the outline")


def _refuse_range(paths: list[Path], loads: list[Path], marks: list[Mark], unit: str) -> None:
    """Raise InputError for a size, or a place of a load, out of range."""
    size = float(max(np.ptp(np.concatenate([path.points[:, :2] for path in paths]), axis=0)))
    points = [np.array(mark.at) for mark in marks] + [path.points[:, :2] for path in loads]
    if not all((np.abs(point) <= _MOST_SIZE).all() for point in points):
        raise InputError("", "a point, a text or an arrow lies out of range", f"coordinates up to {_MOST_SIZE:g} m")
    if not _LEAST <= size <= _MOST_SIZE:
        raise InputError("", f"it is {size:g} {unit} large, out of range", f"from {_LEAST:g} to {_MOST_SIZE:g}")


def _scale(drawing: Drawing, options: ImportOptions, notes: Notes) -> tuple[float, str]:
    """Return scene units per drawing unit, and the scene's unit of length; InputError for an unknown unit."""
    if drawing.facts:
        unit_of_file = str(drawing.facts.get("units", {}).get("length", "m"))
        used = options.unit or drawing.unit
        return (
            units.METRES[used] / units.METRES[unit_of_file]
            if used in units.METRES and unit_of_file in units.METRES
            else 1.0
        ), unit_of_file
    unit = options.unit or drawing.unit
    if unit is None:
        notes.assumed.append("lengths in m: the file names no unit, give --unit")
        return 1.0, "m"
    if unit not in units.METRES:
        raise InputError("", f"its lengths are in {unit}", "`unit` " + "|".join(units.METRES))
    if unit != "m":
        notes.found.append(f"lengths in {unit}, times {units.METRES[unit]:g} to m")
    return units.METRES[unit], "m"


def _tolerance(paths: list[Path], size: float, options: ImportOptions, drawing: Drawing) -> float:
    """Return the default snapping tolerance of a drawing, scene units."""
    # At least a tiny share of the size, which alone counts for drawings written by jld. The tolerance grows with the
    # median edge, up to a larger share of the size.
    if drawing.facts:
        return SNAP * size
    ends = [
        np.diff(np.concatenate([path.points, path.points[:1]]) if path.closed else path.points, axis=0)[:, :2]
        for path in paths
    ]
    lengths = np.hypot(*np.concatenate(ends).T)
    return max(SNAP * size, min(CLOSED * size, EDGE * float(np.median(lengths[lengths > 0.0]))))


def _note_snapped(
    snapped: snapping.Snapped, gaps: list[Gap], tolerance: float, scale: float, drawn_in: str, notes: Notes
) -> None:
    """Note number and largest displacement of moved corners, closed gaps with their place, and collapsed paths."""
    notes.largest = snapped.largest
    remark = f"tolerance {tolerance / scale:.3g} {drawn_in}"
    if snapped.moved:
        moved = several(snapped.moved, "corner")
        notes.snapped.append(f"{moved}, by at most {snapped.largest / scale:.3g} {drawn_in}; {remark}")
    if closed := [gap for gap in gaps if gap.width <= tolerance]:
        notes.snapped.append(f"{several(len(closed), 'gap')} closed, {_widest(closed, scale, drawn_in)}")
    notes.skip("paths", len(snapped.collapsed), f"nothing left of them within the {remark}")


def _widest(gaps: list[Gap], scale: float, drawn_in: str) -> str:
    """Return width and place of the widest of some gaps, in the unit of the file."""
    widest = max(gaps, key=lambda gap: gap.width)
    x, y = (value / scale for value in widest.at)
    lead = "the widest" if len(gaps) > 1 else "it is"
    return f"{lead} {widest.width / scale:.3g} {drawn_in} wide, at ({x:.6g}, {y:.6g})"


def _closing(gaps: list[Gap], scale: float) -> str:
    return f"--tolerance {round_up(max(gap.width for gap in gaps) / scale)}"


def _note_open(gaps: list[Gap], tolerance: float, scale: float, drawn_in: str, notes: Notes) -> None:
    if wide := [gap for gap in gaps if gap.width > tolerance]:
        remark = _widest(wide, scale, drawn_in)
        notes.doubtful.append(f"{several(len(wide), 'gap')} not closed, {remark}: {_closing(wide, scale)} closes it")


def _too_wide(error: InputError, gaps: list[Gap], size: float, scale: float, drawn_in: str) -> InputError:
    """Return the error about lines that enclose nothing, with the widest of their gaps if any."""
    if not gaps:
        return error
    small = [gap for gap in gaps if gap.width <= _REACH * size]
    problem = f"its outline is not closed: {several(len(gaps), 'gap')}, {_widest(gaps, scale, drawn_in)}"
    remedy = "lines whose ends meet" if small != gaps else f"{_closing(gaps, scale)} (in {drawn_in})"
    return InputError("", problem, remedy)


def _say_dropped(
    drawing: Drawing, cells_found: FoundCells, paths: list[Path], snapped: snapping.Snapped, read: int, notes: Notes
) -> None:
    """Note where less than `_SHARE` of the closed area, or of the entities, became structure."""
    rings = [shapely.Polygon(snapped.paths[k]) for k in cells_found.closed]
    area = shapely.union_all([shapely.make_valid(ring) for ring in rings]).area
    cells = [shapely.make_valid(shapely.Polygon(cell.points)) for cell in cells_found.cells]
    used = shapely.union_all([*cells, cells_found.empty])
    if area and (share := used.area / area) < _SHARE:
        notes.doubtful.append(f"only {100 * share:.0f} % of the area of closed outlines became elements or openings")
    lost = drawing.unread + cells_found.unused + len(snapped.collapsed)
    if read + drawing.unread and (share := 1.0 - lost / (read + drawing.unread)) < _SHARE:
        notes.doubtful.append(f"only {100 * share:.0f} % of the entities were read; the others are listed as skipped")


def _say_forces(marks: list[Mark], options: ImportOptions, notes: Notes) -> None:
    """Note texts that state forces on layers that are not those of loads."""
    texts_of_layer: dict[str, list[str]] = {}
    for mark in marks:
        if mark.text and options.role(mark.layer) not in ("load", "dead", "id") and states_force(mark.text):
            texts_of_layer.setdefault(mark.layer, []).append(mark.text)
    for layer, texts in sorted(texts_of_layer.items()):
        more = f" and {len(texts) - 1} more" if len(texts) > 1 else ""
        notes.doubtful.append(f"the text {texts[0]!r}{more} on layer {layer} states a force: a load? --load {layer!r}")


def _name(cells: list[Cell], marks: list[Mark], options: ImportOptions) -> None:
    """Name the cells: by a text on a name layer inside, else by the outline, else by number."""
    # The names of `cells` are changed. Of equal names the first one stays, others become numbers.
    name_marks = [mark for mark in marks if mark.text and options.role(mark.layer) == "id"]
    if name_marks:
        tree = shapely.STRtree([shapely.Polygon(cell.points) for cell in cells])
        points = shapely.points([mark.at for mark in name_marks])
        for which, cell in zip(*tree.query(points, predicate="intersects").tolist(), strict=True):
            cells[cell].name = str(name_marks[which].text).strip()
    names, used, counter = {cell.name for cell in cells}, set[str](), 0
    for cell in cells:
        if not cell.name or cell.name in used:
            counter += 1
            while f"e{counter}" in names:
                counter += 1
            cell.name = f"e{counter}"
        used.add(cell.name)


def _support(
    cells: list[Cell],
    marks: list[Mark],
    options: ImportOptions,
    size: float,
    tolerance: float,
    notes: Notes,
    *,
    nested: list[tuple[Cell, Cell]],
    feet: bool,
    paths: list[Path],
) -> None:
    """Mark supports by layer, by mark inside, or as lowest; add feet where none is. InputError if no or every cell."""
    # Any of the three suffices; the lowest point counts only with `LOWEST` in `options.support`.
    pins = [mark.at for mark in marks if options.role(mark.layer) == "support"]
    pinned = set()
    if pins:
        tree = shapely.STRtree([shapely.Polygon(cell.points) for cell in cells])
        pinned = set(tree.query(shapely.points(pins), predicate="intersects")[1].tolist())
    low = min(float(cell.points[:, 1].min()) for cell in cells)
    for k, cell in enumerate(cells):
        cell.support = options.role(cell.layer) == "support" or k in pinned
    any_named = any(cell.support for cell in cells)
    lowest = [LOWEST in options.support and c.points[:, 1].min() <= low + max(tolerance, 1e-9 * size) for c in cells]
    nested_cells = {id(inner) for inner, _ in nested}
    all_lowest = all(is_lowest or id(cell) in nested_cells for cell, is_lowest in zip(cells, lowest, strict=True))
    if LOWEST in options.support and not any_named and all_lowest:
        feet = True  # the structure itself is lowest, and stands on something
    elif LOWEST in options.support:
        for cell, is_lowest in zip(cells, lowest, strict=True):
            cell.support |= is_lowest
    if feet and not any(cell.support for cell in cells) and (not options.support or all_lowest):
        cells += planar_feet(cells, tolerance, notes)
    lined = sorted({path.layer for path in paths if options.role(path.layer) == "support"})
    check_supports([cell.support for cell in cells], options, lined)


def check_supports(support: Sequence[bool], options: ImportOptions, lined: Sequence[str] = ()) -> None:
    """Raise InputError where no element is a support, or every element is one; lined: layers of supports with lines."""
    if not any(support) and lined:
        remark = f"no line on layer {listed(lined)} encloses an area"
        raise InputError("", f"it has no support: {remark}", 'closed outlines there, or `support="lowest"`')
    if not any(support):
        remark = f"no layer is like {listed(options.support)}" if options.support else "no layer is named for supports"
        raise InputError(
            "", f"it has no support: {remark}", '`support` with the name of a layer, or `support="lowest"`'
        )
    if all(support):
        raise InputError("", "all of its elements are supports", "at least one that is free")


def _element(cell: Cell, size: float) -> dict[str, Any]:
    """Return the scene entry of a cell without corners in straight edges, counter-clockwise as its points then are."""
    # corners of neighbours in straight edges were needed for cutting; the element does not need them
    cell.points = snapping.straight(cell.points)
    cell.points = points = cell.points if polygons.area(cell.points[None])[0] > 0.0 else cell.points[::-1]
    entry: dict[str, Any] = {"id": cell.name, "polygon": rounded(points, size)}
    if cell.joined is not None:
        entry["block"] = cell.joined.name
    return entry | ({"support": True} if cell.support else {})


def _labels(
    cells: list[Cell], paths: list[Path], snapped: snapping.Snapped, options: ImportOptions, reach: float, notes: Notes
) -> dict[str, Any]:
    """Read labels from lines on joint or crack layers, as scene keys.

    "labels", or "interfaces" where a pair has both.
    """
    lines: dict[str, list[shapely.Geometry]] = {"dry": [], "inner": []}
    for k, path in enumerate(paths):
        role = options.role(path.layer)
        if role in lines and len(snapped.paths[k]) > 1:
            points = snapped.paths[k]
            lines[role].append(shapely.LineString(np.concatenate([points, points[:1]]) if path.closed else points))
    if not any(lines.values()):
        return {}
    outlines = [cell.points for cell in cells]
    contacts = [
        c for c in planar_contacts.find_planar_contacts(outlines) if not (cells[c.a].support and cells[c.b].support)
    ]
    if not contacts:
        return {}
    # a contact has the label of lines near its quarter points and its middle
    ends = np.array([contact.ends for contact in contacts])
    probes = np.stack([ends[:, 0] + share * (ends[:, 1] - ends[:, 0]) for share in (0.25, 0.5, 0.75)], axis=1)
    label = np.full(len(contacts), "", dtype=object)
    for role in ("dry", "inner"):
        if lines[role]:
            far = shapely.distance(shapely.points(probes), shapely.union_all(lines[role])).max(axis=1)
            label[far <= reach] = role
    of_pair: dict[tuple[str, str], list[str]] = {}
    for contact, word in zip(contacts, label.tolist(), strict=True):
        of_pair.setdefault((cells[contact.a].name or "", cells[contact.b].name or ""), []).append(word)
    counts = ", ".join(f"{int((label == role).sum())} {role}" for role in ("dry", "inner"))
    notes.found.append(f"labels of {several(int((label != '').sum()), 'face')} by their layers: {counts}")
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
