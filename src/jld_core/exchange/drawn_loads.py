"""Loads that are drawn: arrows, points and texts on the layers for them."""

from __future__ import annotations

import re
from typing import Any, Final

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.drawn import Cell, Drawing, Mark
from jld_core.exchange.options import ImportOptions, Notes, several
from jld_core.exchange.paths import Path

_NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def drawn_loads(
    paths: list[Path], marks: list[Mark], cells: list[Cell], options: ImportOptions, drawing: Drawing, notes: Notes
) -> dict[str, Any]:
    """Forces: arrows along lines, or points and texts; their sizes from texts, 1 where there is none."""
    loads: dict[str, Any] = {"live": [], "dead": []}
    shapes = [shapely.Polygon(cell.points) for cell in cells]
    for role, key in (("load", "live"), ("dead", "dead")):
        texts = [mark for mark in marks if options.role(mark.layer) == role and mark.text]
        bare = [mark for mark in marks if options.role(mark.layer) == role and not mark.text]
        arrows = [path for path in paths if options.role(path.layer) == role and len(path.points) > 1]
        taken: set[int] = set()
        for path in arrows:
            start, end = path.points[0, :2], path.points[-1, :2]
            length = float(np.hypot(*(end - start)))
            if length == 0.0:
                notes.skip("loads", 1, "a line without length")
                continue
            number = _nearest(texts, 0.5 * (start + end), start, end, taken)
            size = 1.0
            if number is None:
                notes.assumed.append(f"a force of 1 along a line on layer {path.layer}: it has no text")
            else:
                taken.add(number)
                size = _numbers(texts[number])[0]
            _apply(loads[key], cells, shapes, end, (size * (end - start) / length).tolist())
        for number, mark in enumerate(texts):
            if number not in taken:
                values = _numbers(mark)
                force = values[:2] if len(values) > 1 else [0.0, -values[0]]
                _apply(loads[key], cells, shapes, np.array(mark.at), force)
        for mark in bare:
            notes.skip("loads", 1, f"a point on layer {mark.layer} without a text that says its force")
    bodies = {key: list(drawing.facts.get("loads", {}).get(key, [])) for key in loads}
    for key in loads:
        drawn = len(loads[key])
        loads[key] += bodies[key]
        if drawn:
            notes.found.append(f"{several(drawn, key + ' force')}")
    found = {key: value for key, value in loads.items() if value}
    cases = drawing.facts.get("loads", {}).get("cases")
    return {**found, "cases": cases} if cases and "live" not in found else found


def _nearest(texts: list[Mark], middle: Floats, start: Floats, end: Floats, taken: set[int]) -> int | None:
    """The text nearest to an arrow, no further from it than the arrow is long."""
    arrow = shapely.LineString([start, end])
    away = [(arrow.distance(shapely.Point(mark.at)), k) for k, mark in enumerate(texts) if k not in taken]
    close = [(distance, k) for distance, k in away if distance <= arrow.length]
    return min(close)[1] if close else None


def _numbers(mark: Mark) -> list[float]:
    found = [float(text) for text in _NUMBER.findall(mark.text or "")]
    if not found or not all(np.isfinite(found)):
        raise InputError(f"layer {mark.layer!r}", f"the text {mark.text!r} is no force", "a number, or two as fx,fy")
    return found


def _apply(
    entries: list[dict[str, Any]], cells: list[Cell], shapes: list[shapely.Polygon], at: Floats, force: list[float]
) -> None:
    """A force on the free element it touches; of several that of the least number."""
    point = shapely.Point(at)
    free = [k for k, cell in enumerate(cells) if not cell.support]
    chosen = min(free, key=lambda k: (round(shapes[k].distance(point), 12), k))
    entries.append({"element": cells[chosen].name, "force": [float(f) for f in force], "at": [float(v) for v in at]})
