"""Loads of a spatial file: points, texts and arrows on load layers."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.drawn import SolidMark
from jld_core.exchange.forces import parse_force
from jld_core.exchange.options import ImportOptions, Notes, listed


def solid_loads(
    marks: list[SolidMark],
    names: list[str],
    vertices: list[Floats],
    supports: list[bool],
    options: ImportOptions,
    notes: Notes,
) -> dict[str, Any]:
    """Return the entry "loads" of a scene from the marks of a spatial file, scene units.

    A text with components is a force at its place, one number a force downwards. An arrow has its own text or the
    nearest one. A force acts on the free element whose box is nearest. Raises InputError for a text that is no force.
    """
    loads: dict[str, Any] = {}
    for role, key in (("load", "live"), ("dead", "dead")):
        own = [mark for mark in marks if options.role(mark.layer) == role]
        texts = [mark for mark in own if mark.tail is None and mark.text]
        taken: set[int] = set()
        for mark in own:
            if mark.tail is None and not mark.text:
                notes.skip("loads", 1, f"a point on layer {mark.layer} without a text that says its force")
            if mark.tail is not None:
                loads.setdefault(key, []).append(_entry(_arrow(mark, texts, taken), mark.at, names, vertices, supports))
        for number, mark in enumerate(texts):
            if number not in taken:
                loads.setdefault(key, []).append(_entry(_written(mark), mark.at, names, vertices, supports))
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


def _arrow(mark: SolidMark, texts: list[SolidMark], taken: set[int]) -> Floats:
    """Return the force (3,) of an arrow: the magnitude of its text along its direction.

    The text is its own or the nearest one, at most its length from its middle. texts: marks with a text. taken: indices
    of used texts, to which one is added. Raises InputError without a text, and for one that is no magnitude.
    """
    tail = mark.at if mark.tail is None else mark.tail
    along = mark.at - tail
    length = float(np.linalg.norm(along))
    text = mark.text
    if text is None:
        near = [(float(np.linalg.norm(one.at - 0.5 * (mark.at + tail))), k) for k, one in enumerate(texts)]
        close = [pair for pair in near if pair[1] not in taken and pair[0] <= length]
        if not close or not length:
            raise InputError(f"layer {mark.layer!r}", "a line has no text that says its force", "a text beside it")
        taken.add(min(close)[1])
        text = texts[min(close)[1]].text
    try:
        written = parse_force(text or "", dimension=3)
    except InputError as error:
        raise error.within(f"layer {mark.layer!r}") from None
    if written.components or not length:
        raise InputError(f"layer {mark.layer!r}", f"the text {text!r} beside an arrow states components", "its size")
    return np.asarray(written.values[0] * along / length)


def _entry(force: Floats, at: Floats, names: list[str], vertices: list[Floats], supports: list[bool]) -> dict[str, Any]:
    """Return the load entry of a force on the nearest free element, by bounding boxes.

    Of equally near elements the smallest one is taken. force, at: (3,) vector and place. names, vertices, supports: of
    all elements.
    """

    def away(k: int) -> tuple[float, float, int]:
        low, high = vertices[k].min(axis=0), vertices[k].max(axis=0)
        outside = np.maximum(np.maximum(low - at, at - high), 0.0)
        return round(float(np.linalg.norm(outside)), 9), float((high - low).max()), k

    chosen = min((k for k, support in enumerate(supports) if not support), key=away)
    return {"element": names[chosen], "force": (force + 0.0).tolist(), "at": (at + 0.0).tolist()}
