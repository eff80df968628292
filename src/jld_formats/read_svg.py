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

from jld_core import Floats, InputError
from jld_core.scene import units as core_units
from jld_formats.drawn_loads import MOST, Drawing, Mark
from jld_formats.libraries import library, parsing, text_of
from jld_formats.options import FACET, ImportOptions, Notes, listed, several
from jld_formats.paths import Path

# Largest number of XML elements of a file after its copies are made; the parser reads some 20 000 a second
_MOST_EXPANDED: Final = 50_000

_PIXEL: Final = 96.0  # pixels per inch, the CSS reference value

_ABSOLUTE: Final = {"mm": 1e-3, "cm": 0.01, "in": 0.0254, "pt": 0.0254 / 72, "pc": 0.0254 / 6, "Q": 2.5e-4}  # m

# Pattern of a page size in a unit of length; other units of CSS are those of screens
_LENGTH: Final = re.compile(rf"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*({'|'.join(_ABSOLUTE)})\s*")

_G: Final = "{http://www.w3.org/2000/svg}g"

_DEFINED: Final = ("defs", "symbol", "clipPath", "mask", "pattern", "marker", "metadata", "linearGradient", "script")

_OF_USE: Final = ("x", "y", "width", "height", "transform", "href", "{http://www.w3.org/1999/xlink}href")

# Relative difference up to which width and height of a page state the same scale: programs round them
_SAME_SCALE: Final = 1e-3


# Attributes that may be shares of the page, and of which side
_SHARES: Final = {key: side for side, keys in enumerate((("x", "width", "cx"), ("y", "height", "cy"))) for key in keys}


def read_svg(path: File, options: ImportOptions, notes: Notes) -> Drawing:
    """Read the shapes and texts of an SVG file as a drawing in the file's own units."""
    # The y axis is turned upwards. The name of the innermost named group is the layer. Where the page has a size in a
    # unit of length, coordinates are scaled to it; a unit of the options is that of the numbers in the file.
    svg = library("svgelements", path)
    text = text_of(path)
    if re.search(r"<!ENTITY", text, flags=re.I):
        raise InputError("", "it defines XML entities, which are not expanded", "an SVG without a DTD of its own")
    if text.count("<") > 2 * MOST:
        raise InputError("", "it holds too many shapes", f"at most {MOST}")
    with parsing("SVG", "an SVG file"):
        notes.reached("bytes in its text", len(text))
        tree = ElementTree.fromstring(text)
        if (count := _count_expanded(tree)) > _MOST_EXPANDED:
            uses = " by <use>" if any(_kind(node) == "use" for node in tree.iter()) else ""
            raise InputError("", f"it expands to {count:.3g} shapes{uses}", f"at most {_MOST_EXPANDED}")
        page = _page(tree)
        resolved = _resolve(tree, notes, page[2] if page else 1.0)
        root = svg.SVG.parse(io.BytesIO(ElementTree.tostring(resolved)), reify=True, ppi=_PIXEL)
        return _in_stated_unit(_drawing(svg, root, path.stem, options, notes), None if options.unit else page)


def _href(element: ElementTree.Element) -> str:
    """Return the id that a <use> names; "" without one."""
    return next((value[1:] for key, value in element.items() if key.rpartition("}")[2] == "href"), "")


def _kind(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _resolve(root: ElementTree.Element, notes: Notes, uneven: float) -> ElementTree.Element:
    """Return what a file shows: copies for <use>, nothing of definitions, and no page."""
    by_id = {name: node for node in root.iter() if (name := node.get("id"))}
    clipped, sides = 0, _sides(root)

    def copied(element: ElementTree.Element) -> ElementTree.Element | None:
        nonlocal clipped
        kind = _kind(element)
        if kind in _DEFINED:
            return None
        clipped += element.get("clip-path", "none") != "none" or "clip-path:" in element.get("style", "")
        attributes = {key: _of_page(key, value, sides) for key, value in element.items()}
        if kind != "use":
            copy = ElementTree.Element(element.tag, attributes)
            copy.text, children = element.text, list(element)
        else:
            target = by_id.get(_href(element))
            copy = ElementTree.Element(_G, {k: v for k, v in attributes.items() if k not in _OF_USE})
            move = f"translate({element.get('x', '0')},{element.get('y', '0')})"
            if target is not None and _kind(target) == "symbol":
                move += _viewbox_transform(target, element)
                children = list(target)
            else:
                children = [] if target is None else [target]
            copy.set("transform", f"{element.get('transform', '')} {move}".strip())
        for child in children:
            if (part := copied(child)) is not None:
                part.tail = child.tail
                copy.append(part)
        return copy

    result = ElementTree.Element(root.tag)
    group = ElementTree.SubElement(result, _G, {"transform": f"scale({uneven!r},1)"} if uneven != 1.0 else {})
    group.extend([part for child in root if (part := copied(child)) is not None])
    if clipped:
        notes.doubtful.append(f"{several(clipped, 'shape')} cut by a clip path, which is not applied: read whole")
    return result


def _sides(root: ElementTree.Element) -> tuple[float, float] | None:
    """Return width and height of a page in its own units; None where it states none."""
    box = re.findall(r"[^\s,]+", root.get("viewBox", ""))[2:]
    try:
        wide, tall = map(float, box or [root.get(key, "").removesuffix("px") for key in ("width", "height")])
    except ValueError:
        return None
    return wide, tall


def _of_page(key: str, value: str, sides: tuple[float, float] | None) -> str:
    if sides is None or not value.endswith("%") or key not in _SHARES:
        return value
    try:
        return repr(0.01 * float(value[:-1]) * sides[_SHARES[key]])
    except ValueError:
        return value


def _viewbox_transform(symbol: ElementTree.Element, use: ElementTree.Element) -> str:
    """Return the transformation of a symbol's viewBox to the size of its copy, as text; "" without these."""
    box = re.findall(r"[^\s,]+", symbol.get("viewBox", ""))
    sides = [use.get(key, symbol.get(key, "")) for key in ("width", "height")]
    try:
        left, top, wide, tall = map(float, box)
        scales = [float(side.removesuffix("px")) / span for side, span in zip(sides, (wide, tall), strict=True)]
    except (ValueError, ZeroDivisionError):
        return ""
    if symbol.get("preserveAspectRatio") != "none":
        scales = [min(scales)] * 2
        # the drawing stands in the middle of its box
        left -= 0.5 * (float(sides[0].removesuffix("px")) / scales[0] - wide)
        top -= 0.5 * (float(sides[1].removesuffix("px")) / scales[1] - tall)
    return f" scale({scales[0]!r},{scales[1]!r}) translate({-left!r},{-top!r})"


def _count_expanded(root: ElementTree.Element) -> int:
    """Return the number of XML elements once <use> is replaced; InputError where a copy contains itself."""
    by_id = {name: node for node in root.iter() if (name := node.get("id"))}
    counts: dict[ElementTree.Element, int] = {}
    open_elements: set[ElementTree.Element] = set()
    pending = [(root, False)]
    while pending:
        element, ready = pending.pop()
        parts = list(element)
        if _kind(element) == "use":
            parts += [by_id[_href(element)]] if _href(element) in by_id else []
        if ready:
            counts[element] = 1 + sum(counts[part] for part in parts)
            open_elements.discard(element)
        elif element in open_elements:
            raise InputError("", f"a <use> of {element.get('id')!r} contains itself", "copies of other shapes")
        elif element not in counts:
            open_elements.add(element)
            pending += [(element, True), *((part, False) for part in parts)]
    return counts[root]


def _page(root: ElementTree.Element) -> tuple[float, str, float] | None:
    """Return vertical length and unit of a drawing unit, and the ratio of scales; None where the page has no size."""
    sides = [_LENGTH.fullmatch(root.get(key, "")) for key in ("width", "height")]
    side_with_unit = next((side for side in sides if side), None)
    if side_with_unit is None:
        return None
    units = {side[2] for side in sides if side}
    unit = side_with_unit[2] if side_with_unit[2] in core_units.METRES and len(units) == 1 else "mm"
    numbers = re.findall(r"[^\s,]+", root.get("viewBox", ""))
    if not numbers:  # the units of the drawing are pixels
        return _ABSOLUTE["in"] / _PIXEL / core_units.METRES[unit], unit, 1.0
    try:
        scales = [
            float(side[1]) * _ABSOLUTE[side[2]] / core_units.METRES[unit] / float(box) if side else np.nan
            for side, box in zip(sides, numbers[2:4], strict=True)
        ]
    except (ValueError, ZeroDivisionError):
        return None
    wide, tall = (scales[k] if np.isfinite(scales[k]) else scales[1 - k] for k in (0, 1))
    if not (0.0 < wide < np.inf and 0.0 < tall < np.inf):
        return None
    if abs(wide - tall) > _SAME_SCALE * wide:
        ratio = root.get("preserveAspectRatio", "xMidYMid meet")
        if "none" in ratio:
            return tall, unit, wide / tall
        tall = max(wide, tall) if "slice" in ratio else min(wide, tall)
    # a page rounded to whole units has the scale 1
    return (1.0 if abs(tall - 1.0) <= _SAME_SCALE else tall), unit, 1.0


def _in_stated_unit(drawing: Drawing, page: tuple[float, str, float] | None) -> Drawing:
    if page is None:
        return drawing
    scale, unit, _ = page
    paths, marks = [path.scaled(scale) for path in drawing.paths], [mark.scaled(scale) for mark in drawing.marks]
    return replace(drawing, paths=paths, marks=marks, unit=unit)


def _drawing(svg: Any, root: Any, name: str, options: ImportOptions, notes: Notes) -> Drawing:
    """Collect the paths and texts of a parsed SVG file."""
    paths: list[Path] = []
    marks: list[Mark] = []
    unread: dict[str, int] = {}
    hidden: dict[str, int] = {}

    def walk(group: Any, layer: str) -> None:
        for item in group:
            notes.reached("shapes", len(paths))
            values = item.values if isinstance(getattr(item, "values", None), dict) else {}
            attributes = values.get("attributes", {})
            if isinstance(item, svg.Group):
                walk(item, _group_name(attributes) or layer)
            elif str(values.get("visibility", "")) in ("hidden", "collapse"):
                hidden[layer] = hidden.get(layer, 0) + 1
            elif isinstance(item, svg.Text):
                if item.text:
                    point = svg.Point(item.x, item.y) * item.transform
                    marks.append(Mark((float(point.x), -float(point.y)), layer, str(item.text)))
            elif isinstance(item, svg.Shape):
                shape = svg.Path(item).reify()  # mirrored shapes keep their transformation until then
                for part in shape.as_subpaths():
                    points, closed = _points(svg, svg.Path(part), options)
                    if len(points) > (2 if closed and not points[:, 2].any() else 1):
                        paths.append(
                            Path(points, closed, attributes.get("data-layer") or layer, attributes.get("data-name"))
                        )
                    if len(paths) > MOST:
                        raise InputError("", "it holds too many shapes", f"at most {MOST}")
            elif not isinstance(item, svg.Title):
                kind = type(item).__name__
                unread[kind] = unread.get(kind, 0) + 1

    walk(root, "")
    for layer, count in sorted(hidden.items()):
        notes.skip(f"shapes in group {layer or '(none)'}", count, "they are hidden")
    for kind, count in sorted(unread.items()):
        notes.skip(kind, count, "no path, shape or text")
    if paths:
        notes.found.append(f"groups {listed(sorted({path.layer or '(none)' for path in paths}), 12)}")
    return Drawing(paths, marks, None, {}, name, sum(unread.values()))


def _group_name(attributes: dict[str, Any]) -> str:
    """Return the name of a group: its label in a drawing program, else its id."""
    for key, value in attributes.items():
        if key.endswith("label") and value:
            return str(value)
    return str(attributes.get("id") or "")


def _points(svg: Any, path: Any, options: ImportOptions) -> tuple[Floats, bool]:
    """Return rows (k, 3) of x, y and bulge of one subpath, and True if it is closed."""
    # The y axis points upwards. Arcs of circles are kept; other curves become chords within the facet tolerance.
    rows: list[tuple[float, float, float]] = []
    closed = False
    for segment in path:
        if isinstance(segment, svg.Move):
            if segment.end is not None:
                rows.append((float(segment.end.x), -float(segment.end.y), 0.0))
            continue
        if isinstance(segment, svg.Close):
            closed = True
            continue
        if isinstance(segment, svg.Arc) and _round(segment) and rows:
            rows = rows[:-1] + _halves(segment)
        elif not isinstance(segment, svg.Line):
            rows += [(x, y, 0.0) for x, y in _chords(segment, options)]
            if len(rows) > MOST:
                raise InputError("", "it holds too many corners", f"at most {MOST}")
        rows.append((float(segment.end.x), -float(segment.end.y), 0.0))
    points = np.array(rows, dtype=float).reshape(-1, 3)
    if not np.isfinite(points).all():
        raise InputError("", "it holds a coordinate that is no number", "finite numbers only")
    size = float(np.ptp(points[:, :2], axis=0).max()) if len(points) else 0.0
    if len(points) > 2 and np.hypot(*(points[0] - points[-1])[:2]) <= 1e-9 * size:
        return points[:-1], True
    return points, closed


def _round(arc: Any) -> bool:
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
        points = np.array(segment.npoint(np.arange(2 * number + 1) / (2 * number)), dtype=float) * (1.0, -1.0)
        size = float(np.ptp(points, axis=0).max())
        facet = FACET * size if options.facet is None else options.facet
        distance = np.hypot(*(points[1::2] - 0.5 * (points[:-1:2] + points[2::2])).T)
        if distance.max() <= facet:
            return [(float(x), float(y)) for x, y in points[2:-1:2]]
        number *= 2
    return [(float(x), float(y)) for x, y in points[2:-1:2]]
