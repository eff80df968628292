"""Loads from a drawing: arrows, points and texts on load layers."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.drawn import Cell, Drawing, Mark
from jld_core.exchange.forces import WrittenForce, parse_force
from jld_core.exchange.options import ImportOptions, Notes
from jld_core.exchange.paths import Path


def drawn_loads(
    paths: list[Path], marks: list[Mark], cells: list[Cell], options: ImportOptions, drawing: Drawing, notes: Notes
) -> dict[str, Any]:
    """Return the entry "loads" of a scene from the lines, points and texts of a drawing.

    A line on a load layer is a force that ends at its point of application. The nearest text states its magnitude;
    without one it is 1. Any other text is a force at its place: two components, or one magnitude downwards. A force
    acts on the nearest free cell. Keys without loads are left out.

    paths, marks: lines, and points or texts, in scene units. cells: elements of the scene. drawing: source of the force
    unit and of stored loads. notes: receives what was found and assumed. Raises InputError for a text that is no force.
    """
    entries: dict[str, list[dict[str, Any]]] = {"live": [], "dead": []}
    unit = str(drawing.facts.get("units", {}).get("force", "N"))
    structure = _Structure(cells, [shapely.Polygon(cell.points) for cell in cells])
    for role, key in (("load", "live"), ("dead", "dead")):
        texts = [mark for mark in marks if options.role(mark.layer) == role and mark.text]
        bare = [mark for mark in marks if options.role(mark.layer) == role and not mark.text]
        arrows = [path for path in paths if options.role(path.layer) == role and len(path.points) > 1]
        drawn, taken = _of_arrows(arrows, texts, unit, notes)
        for number, mark in enumerate(texts):
            if number not in taken:
                written = _written(mark, unit, notes)
                force = written.values if written.components else (0.0, -written.values[0])
                drawn.append((np.array(mark.at), force, repr(mark.text)))
        for at, values, source in drawn:
            entry = structure.entry(at, values)
            entries[key].append(entry)
            notes.found.append(f"{key} force {_force_text(entry, unit)}, {source}")
        for mark in bare:
            notes.skip("loads", 1, f"a point on layer {mark.layer} without a text that says its force")
    loads: dict[str, Any] = dict(entries)
    bodies = {key: list(drawing.facts.get("loads", {}).get(key, [])) for key in loads}
    for key in loads:
        loads[key] += bodies[key]
    found = {key: value for key, value in loads.items() if value}
    cases = drawing.facts.get("loads", {}).get("cases")
    return {**found, "cases": cases} if cases and "live" not in found else found


def _nearest(texts: list[Mark], middle: Floats, start: Floats, end: Floats, taken: set[int]) -> int | None:
    """Return the number of the text nearest to an arrow, None if all are too far.

    A text may be at most the arrow's length away. start, end: (2,) of the arrow. taken: numbers of texts that other
    arrows use. middle: not used.
    """
    arrow = shapely.LineString([start, end])
    away = [(arrow.distance(shapely.Point(mark.at)), k) for k, mark in enumerate(texts) if k not in taken]
    close = [(distance, k) for distance, k in away if distance <= arrow.length]
    return min(close)[1] if close else None


def _of_arrows(
    arrows: list[Path], texts: list[Mark], unit: str, notes: Notes
) -> tuple[list[tuple[Floats, tuple[float, ...], str]], set[int]]:
    """Return place, force and source of every arrow, and the numbers of the texts used."""
    found: list[tuple[Floats, tuple[float, ...], str]] = []
    taken: set[int] = set()
    for path in arrows:
        start, end = path.points[0, :2], path.points[-1, :2]
        length = float(np.hypot(*(end - start)))
        if length == 0.0:
            notes.skip("loads", 1, "a line without length")
            continue
        number = _nearest(texts, 0.5 * (start + end), start, end, taken)
        size, source = 1.0, "an arrow without a text"
        if number is None:
            notes.assumed.append(f"a force of 1 {unit} along a line on layer {path.layer}: it has no text")
        else:
            taken.add(number)
            mark = texts[number]
            written = _written(mark, unit, notes)
            if written.components:
                problem = f"the text {mark.text!r} beside an arrow states components"
                raise InputError(f"layer {mark.layer!r}", problem, "the size alone: the arrow is the direction")
            size, source = written.values[0], f"{mark.text!r} along an arrow"
        found.append((end, tuple((size * (end - start) / length).tolist()), source))
    return found, taken


def _written(mark: Mark, unit: str, notes: Notes) -> WrittenForce:
    """Parse the text of a mark, and note a missing unit.

    Raises InputError for a text that is no force.
    """
    try:
        written = parse_force(mark.text or "", unit)
    except InputError as error:
        raise error.within(f"layer {mark.layer!r}") from None
    if not written.has_unit:
        notes.assumed.append(f"the text {mark.text!r} is in {unit}: it names no unit")
    return written


def _force_text(entry: dict[str, Any], unit: str) -> str:
    """Return a force in words, with its unit, element and place."""
    force, at = (", ".join(f"{value:.9g}" for value in entry[key]) for key in ("force", "at"))
    return f"({force}) {unit} on element {entry['element']!r} at ({at})"


class _Structure:
    """Cells with their polygons, for finding the element that a force acts on."""

    def __init__(self, cells: list[Cell], shapes: list[shapely.Polygon]) -> None:
        self._cells, self._shapes = cells, shapes
        self._free = [k for k, cell in enumerate(cells) if not cell.support]

    def entry(self, at: Floats, force: tuple[float, ...]) -> dict[str, Any]:
        """Return the load entry of a force on the free element nearest to its place.

        Among equally near elements the first one counts.
        """
        point = shapely.Point(at)
        chosen = min(self._free, key=lambda k: (round(self._shapes[k].distance(point), 12), k))
        name = self._cells[chosen].name
        # adding 0.0 turns a negative zero into zero
        return {"element": name, "force": [float(f) + 0.0 for f in force], "at": [float(v) + 0.0 for v in at]}
