"""Reader of SVG by svgelements: paths and shapes as outlines or lines, groups as layers.

The y axis is reversed so that it points upwards.
"""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path as File
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.drawn_loads import MOST, Drawing, Mark
from jld_core.exchange.libraries import library, parsing, text_of
from jld_core.exchange.options import FACET, ImportOptions, Notes, listed
from jld_core.exchange.paths import Path

# Largest number of XML elements of a file after its copies are made; the parser reads some 20 000 a second
_MOST_EXPANDED: Final = 50_000

_PIXEL: Final = 96.0  # pixels per inch, the CSS reference value

# Pattern of the attributes of page size and viewBox
_PAGE: Final = r"""\s(viewBox|width|height)\s*=\s*("[^"]*"|'[^']*')"""

# Pattern of a page size in a unit of length; other units of CSS are those of screens and print
_LENGTH: Final = re.compile(r"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(mm|cm|in)\s*")

# Relative difference up to which width and height of a page state the same scale: programs round them
_SAME_SCALE: Final = 1e-3


def read_svg(path: File, options: ImportOptions, notes: Notes) -> Drawing:
    """Read the shapes and texts of an SVG file as a drawing in the file's own units.

    Raises InputError where the file is not SVG, is broken or excessive, or defines XML entities.
    """
    # The y axis is turned upwards. The name of the innermost named group is the layer. Where page size and viewBox
    # state a unit of length, coordinates are scaled to it; a unit of the options is that of the numbers in the file.
    svg = library("svgelements", path)
    text = text_of(path)
    if re.search(r"<!ENTITY", text, flags=re.I):
        raise InputError("", "it defines XML entities, which are not expanded", "an SVG without a DTD of its own")
    if text.count("<") > 2 * MOST:
        raise InputError("", "it holds too many shapes", f"at most {MOST}")
    stated = None if options.unit else _stated_unit(text)
    # drop the page size and viewBox: lengths are those in which the drawing was made
    text = re.sub(r"<svg\b[^>]*>", lambda tag: re.sub(_PAGE, "", tag[0]), text, count=1)
    with parsing("SVG", "an SVG file"):
        if (count := _expanded(ElementTree.fromstring(text))) > _MOST_EXPANDED:
            raise InputError("", f"it expands to {count:.3g} shapes by <use>", f"at most {_MOST_EXPANDED}")
        root = svg.SVG.parse(io.StringIO(text), reify=True, ppi=_PIXEL)
        return _in_stated_unit(_drawing(svg, root, path.stem, options, notes), stated)


def _expanded(root: ElementTree.Element) -> int:
    """Return the number of XML elements below a root after each <use> is replaced by a copy of what it names.

    Raises InputError where a copy would contain itself.
    """
    named = {name: one for one in root.iter() if (name := one.get("id"))}
    counts: dict[ElementTree.Element, int] = {}
    open_elements: set[ElementTree.Element] = set()
    pending = [(root, False)]
    while pending:
        element, ready = pending.pop()
        parts = list(element)
        if element.tag.rpartition("}")[2] == "use":
            target = next((value for key, value in element.items() if key.rpartition("}")[2] == "href"), "")
            parts += [named[target[1:]]] if target[1:] in named else []
        if ready:
            counts[element] = 1 + sum(counts[part] for part in parts)
            open_elements.discard(element)
        elif element in open_elements:
            raise InputError("", f"a <use> of {element.get('id')!r} contains itself", "copies of other shapes")
        elif element not in counts:
            open_elements.add(element)
            pending += [(element, True), *((part, False) for part in parts)]
    return counts[root]


def _stated_unit(text: str) -> tuple[float, str] | None:
    """Return length and unit of one unit of the viewBox, as the page of an SVG states it.

    None where width, height and viewBox do not state the same scale in mm, cm or inches.
    """
    tag = re.search(r"<svg\b[^>]*>", text)
    page = {key: value[1:-1] for key, value in re.findall(_PAGE, tag[0] if tag else "")}
    sides = [_LENGTH.fullmatch(page.get(key, "")) for key in ("width", "height")]
    numbers = re.findall(r"[^\s,]+", page.get("viewBox", ""))
    if sides[0] is None or sides[1] is None or sides[0][2] != sides[1][2] or len(numbers) != 4:
        return None
    try:
        wide, tall = (float(side[1]) / float(box) for side, box in zip(sides, numbers[2:], strict=True) if side)
    except (ValueError, ZeroDivisionError):
        return None
    if not (0.0 < wide < np.inf and abs(wide - tall) <= _SAME_SCALE * wide):
        return None
    # a page rounded to whole units has the scale 1
    return (1.0 if abs(wide - 1.0) <= _SAME_SCALE else wide), sides[0][2]


def _in_stated_unit(drawing: Drawing, stated: tuple[float, str] | None) -> Drawing:
    """Convert a drawing to the unit that its page states."""
    if stated is None:
        return drawing
    scale, unit = stated
    paths, marks = [path.scaled(scale) for path in drawing.paths], [mark.scaled(scale) for mark in drawing.marks]
    return replace(drawing, paths=paths, marks=marks, unit=unit)


def _drawing(svg: Any, root: Any, name: str, options: ImportOptions, notes: Notes) -> Drawing:
    """Collect the paths and texts of a parsed SVG file."""
    paths: list[Path] = []
    marks: list[Mark] = []
    unread: dict[str, int] = {}

    def walk(group: Any, layer: str) -> None:
        """Collect the items of a group and its subgroups."""
        for item in group:
            own = item.values.get("attributes", {}) if hasattr(item, "values") and isinstance(item.values, dict) else {}
            if isinstance(item, svg.Group):
                walk(item, _named(own) or layer)
            elif isinstance(item, svg.Text):
                if item.text:
                    place = svg.Point(item.x, item.y) * item.transform
                    marks.append(Mark((float(place.x), -float(place.y)), layer, str(item.text)))
            elif isinstance(item, svg.Shape):
                shape = svg.Path(item)
                for part in shape.as_subpaths():
                    points, closed = _points(svg, svg.Path(part), options)
                    if len(points) > (2 if closed and not points[:, 2].any() else 1):
                        paths.append(Path(points, closed, own.get("data-layer") or layer, own.get("data-name")))
                    if len(paths) > MOST:
                        raise InputError("", "it holds too many shapes", f"at most {MOST}")
            elif not isinstance(item, svg.Title):
                kind = type(item).__name__
                unread[kind] = unread.get(kind, 0) + 1

    walk(root, "")
    for kind, count in sorted(unread.items()):
        notes.skip(kind, count, "no path, shape or text")
    if paths:
        notes.found.append(f"groups {listed(sorted({path.layer or '(none)' for path in paths}), 12)}")
    return Drawing(paths, marks, None, {}, name)


def _named(attributes: dict[str, Any]) -> str:
    """Return the name of a group: its label in a drawing program, else its id."""
    for key, value in attributes.items():
        if key.endswith("label") and value:
            return str(value)
    return str(attributes.get("id") or "")


def _points(svg: Any, path: Any, options: ImportOptions) -> tuple[Floats, bool]:
    """Return rows (k, 3) of x, y and bulge of one subpath, and True if it is closed."""
    # The y axis points upwards. Arcs of circles are kept; other curves become chords within the facet tolerance.
    found: list[tuple[float, float, float]] = []
    closed = False
    for segment in path:
        if isinstance(segment, svg.Move):
            if segment.end is not None:
                found.append((float(segment.end.x), -float(segment.end.y), 0.0))
            continue
        if isinstance(segment, svg.Close):
            closed = True
            continue
        if isinstance(segment, svg.Arc) and _round(segment) and found:
            found = found[:-1] + _halves(segment)
        elif not isinstance(segment, svg.Line):
            found += [(x, y, 0.0) for x, y in _chords(segment, options)]
        found.append((float(segment.end.x), -float(segment.end.y), 0.0))
    points = np.array(found, dtype=float).reshape(-1, 3)
    if not np.isfinite(points).all():
        raise InputError("", "it holds a coordinate that is no number", "finite numbers only")
    size = float(np.ptp(points[:, :2], axis=0).max()) if len(points) else 0.0
    if len(points) > 2 and np.hypot(*(points[0] - points[-1])[:2]) <= 1e-9 * size:
        return points[:-1], True
    return points, closed


def _round(arc: Any) -> bool:
    """Return True if an arc is one of a circle."""
    wide, tall = float(arc.rx), float(arc.ry)
    return wide > 0.0 and abs(wide - tall) <= 1e-6 * wide


def _halves(arc: Any) -> list[tuple[float, float, float]]:
    """Return the rows x, y, bulge that begin the two halves of a circular arc, y upwards."""
    bulge = -float(np.tan(float(arc.sweep) / 8.0))
    middle = arc.point(0.5)
    return [(float(p.x), -float(p.y), bulge) for p in (arc.start, middle)]


def _chords(segment: Any, options: ImportOptions) -> list[tuple[float, float]]:
    """Return points inside a curve, doubled until all chords meet the facet tolerance."""
    # Doubling ends at 2048 chords, even where these do not meet it.
    number = 8
    while number < 4096:
        points = np.array([[p.x, -p.y] for p in (segment.point(k / (2 * number)) for k in range(2 * number + 1))])
        size = float(np.ptp(points, axis=0).max())
        facet = FACET * size if options.facet is None else options.facet
        off = np.hypot(*(points[1::2] - 0.5 * (points[:-1:2] + points[2::2])).T)
        if off.max() <= facet:
            return [(float(x), float(y)) for x, y in points[2:-1:2]]
        number *= 2
    return [(float(x), float(y)) for x, y in points[2:-1:2]]
