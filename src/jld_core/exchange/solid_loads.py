"""Loads of a spatial file: points, texts and arrows on load layers."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.drawn import SolidMark
from jld_core.exchange.forces import closest_first, parse_force
from jld_core.exchange.options import ImportOptions, Notes, listed
from jld_core.geometry import Faces
from jld_core.geometry.inside import distance_to


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
    """Return the entry "loads" of a scene from the marks of a spatial file, scene units.

    A text with components is a force at its place, one number a force downwards. An arrow has its own text or the
    nearest one. A force acts on the nearest free element; those within `reach` of it share the force. Raises InputError
    for a text that is no force.
    """

    def entries(force: Floats, at: Floats) -> list[dict[str, Any]]:
        """Return the load entries of a force (3,) at a point (3,)."""
        chosen = _nearest(at, vertices, faces, supports, reach)
        share = (force / len(chosen) + 0.0).tolist()
        return [{"element": names[k], "force": share, "at": (at + 0.0).tolist()} for k in chosen]

    loads: dict[str, Any] = {}
    for role, key in (("load", "live"), ("dead", "dead")):
        own = [mark for mark in marks if options.role(mark.layer) == role]
        texts = [mark for mark in own if mark.tail is None and mark.text]
        arrows = [mark for mark in own if mark.tail is not None]
        beside = _beside([mark for mark in arrows if mark.text is None], texts, reach)
        for mark in own:
            if mark.tail is None and not mark.text:
                notes.skip("loads", 1, f"a point on layer {mark.layer} without a text that says its force")
        bare = iter(range(len(arrows)))
        for mark in arrows:
            text = mark.text
            if text is None:
                number = beside.get(next(bare))
                text = None if number is None else texts[number].text
            loads.setdefault(key, []).extend(entries(_arrow(mark, text), mark.at))
        for number in sorted(set(range(len(texts))) - set(beside.values())):
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
    """Return the number of the text of each arrow, by its number; it lies at most its length from its middle."""
    ends = np.array([(mark.tail, mark.at) for mark in arrows]).reshape(-1, 2, 3)
    places = np.array([mark.at for mark in texts]).reshape(-1, 3)
    away = np.linalg.norm(ends.mean(axis=1)[:, None] - places[None], axis=2)
    arrow, text = np.nonzero(away <= np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[:, None])
    return closest_first(arrow, text, away[arrow, text], reach, [(mark.layer, str(mark.text)) for mark in texts])


def _arrow(mark: SolidMark, text: str | None) -> Floats:
    """Return the force (3,) of an arrow: the magnitude of its text along its direction.

    Raises InputError without a text, and for one that is no magnitude.
    """
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
    """Return the free elements nearest to a point (3,), in order: those within `reach` of the least distance.

    vertices, faces, supports: of all elements.
    """
    boxes = np.array([(v.min(axis=0), v.max(axis=0)) for v in vertices])
    least = np.linalg.norm(np.maximum(np.maximum(boxes[:, 0] - at, at - boxes[:, 1]), 0.0), axis=1)
    free = np.flatnonzero(~np.array(supports))
    found: dict[int, float] = {}
    for k in free[np.argsort(least[free], kind="stable")].tolist():
        if found and least[k] > min(found.values()) + reach:
            break  # no element is nearer than its box
        found[k] = distance_to(vertices[k], tuple(map(tuple, faces[k])), at)
    return sorted(k for k, away in found.items() if away <= min(found.values()) + reach)
