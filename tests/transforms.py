"""Transformations of a planar scene that must leave λ as it is."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np

from jld_core import Scene, build_assembly

Document = dict[str, Any]


def as_elements(scene: Scene) -> Document:
    """The scene as a document with general elements, interfaces found from geometry, labels by pairs."""
    assembly = build_assembly(scene)
    elements, faces = assembly.elements, assembly.interfaces
    document = scene.model_dump(mode="json", exclude_none=True)
    thickness = scene.grid.thickness if scene.grid is not None else scene.thickness or 1.0
    document.pop("grid", None)
    document["thickness"] = thickness
    document["elements"] = [
        {"id": name, "polygon": shape.tolist(), "weight": float(np.hypot(*weight)), "support": bool(support)}
        for name, shape, weight, support in zip(
            elements.ids, elements.shape, elements.weight, elements.support, strict=True
        )
    ]
    pairs: dict[str, list[list[str]]] = {"dry": [], "inner": []}
    for a, b, dry in zip(faces.a, faces.b, assembly.labels, strict=True):
        pairs["dry" if dry else "inner"].append([elements.ids[a], elements.ids[b]])
    document["labels"] = pairs
    gravity = document["materials"].get("gravity", 9.81)
    document["materials"]["gravity"] = [0.0, -gravity] if isinstance(gravity, int | float) else gravity
    return document


def _map(document: Document, point: Any, vector: Any, moment: float) -> Document:
    changed = copy.deepcopy(document)
    for element in changed["elements"]:
        element["polygon"] = [point(p) for p in element["polygon"]]
        if "centroid" in element:
            element["centroid"] = point(element["centroid"])
    changed["materials"]["gravity"] = vector(changed["materials"]["gravity"])
    for entry in changed["loads"].get("dead", []) + changed["loads"]["live"]:
        for key in ("force", "body"):
            if key in entry:
                entry[key] = vector(entry[key])
        if "at" in entry:
            entry["at"] = point(entry["at"])
        if "moment" in entry:
            entry["moment"] = moment * entry["moment"]
    return changed


def rotated(document: Document, degrees: float, shift: tuple[float, float] = (0.0, 0.0)) -> Document:
    """The whole scene turned about the origin and moved, gravity and loads with it."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))

    def turn(v: list[float]) -> list[float]:
        return [c * v[0] - s * v[1], s * v[0] + c * v[1]]

    def move(p: list[float]) -> list[float]:
        x, y = turn(p)
        return [x + shift[0], y + shift[1]]

    return _map(document, move, turn, 1.0)


def mirrored(document: Document) -> Document:
    """The scene reflected in the vertical axis."""
    return _map(document, lambda p: [-p[0], p[1]], lambda v: [-v[0], v[1]], -1.0)


def in_units(document: Document, length: float, force: float) -> Document:
    """The scene in other units: numbers of length times `length`, forces times `force`."""
    changed = _map(document, lambda p: [length * x for x in p], lambda v: v, 1.0)
    changed["thickness"] *= length
    for element in changed["elements"]:
        element["weight"] *= force
    for entry in changed["loads"].get("dead", []) + changed["loads"]["live"]:
        if "force" in entry:
            entry["force"] = [force * x for x in entry["force"]]
        if "moment" in entry:
            entry["moment"] *= force * length
    for material in ("dry", "inner"):
        for key, value in changed["materials"].get(material, {}).items():
            if key.endswith("strength"):
                changed["materials"][material][key] = value * force / length**2
    return changed


def renumbered(document: Document, seed: int) -> Document:
    """The same elements in another order."""
    changed = copy.deepcopy(document)
    order = np.random.default_rng(seed).permutation(len(changed["elements"]))
    changed["elements"] = [changed["elements"][i] for i in order]
    return changed
