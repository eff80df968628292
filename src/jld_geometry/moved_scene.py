"""Scenes with the same elements and interfaces at other positions of their vertices."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.build.assemble import build_geometry
from jld_core.scene import Scene, parse_scene
from jld_geometry.convex_cells import VertexMesh
from jld_geometry.variables import SAME


class MovedScene:
    """Scene whose vertices move while elements, interfaces and labels stay.

    Grids are written out as elements and interfaces. Points by which the key "move" names vertices move with them.

    scene: planar scene. labels: (m,) True = dry. mesh: vertices of the assembly.
    """

    def __init__(self, scene: Scene, assembly: Assembly, labels: Bits, mesh: VertexMesh) -> None:
        self._mesh = mesh
        document: dict[str, Any] = scene.model_dump(mode="json", exclude_defaults=True)
        document.pop("grid", None)
        document.pop("labels", None)
        document["thickness"] = float(assembly.interfaces.l2[0]) if len(assembly.interfaces) else 1.0
        geometry = build_geometry(scene)
        self._elements = [entry.model_dump(mode="json", exclude_defaults=True) for entry in geometry.entries]
        ids, faces = assembly.elements.ids, assembly.interfaces
        self._interfaces: list[dict[str, Any]] = []
        for k, given in enumerate(geometry.given):
            own = {} if given is None else given.model_dump(mode="json", exclude_defaults=True)
            label = "dry" if labels[k] else "inner"
            self._interfaces.append({**own, "elements": [ids[faces.a[k]], ids[faces.b[k]]], "label": label})
        self._document = document
        self._size = assembly.size

    def document(self, places: Floats, friction: float = 1.0) -> dict[str, Any]:
        """Return the scene file as a dict with the vertices at the positions (v, 2), unchecked."""
        found = dict(self._document)
        found["elements"] = [
            {**entry, "polygon": places[loop].tolist()}
            for entry, loop in zip(self._elements, self._mesh.loops, strict=True)
        ]
        found["interfaces"] = [
            {**entry, "polygon": places[ends].tolist()}
            for entry, ends in zip(self._interfaces, self._mesh.ends, strict=True)
        ]
        if "move" in found:
            found["move"] = move_with_points(found["move"], self._mesh.places, places, self._size)
        return found if friction == 1.0 else _with_friction_factor(found, friction)

    def at(self, places: Floats, friction: float = 1.0) -> Scene:
        """Return the validated scene with the vertices at the positions (v, 2).

        Raises InputError where the positions make no valid scene.
        """
        return parse_scene(self.document(places, friction), "the moved scene")


def move_with_points(move: dict[str, Any], start: Floats, places: Floats, size: float) -> dict[str, Any]:
    """Return the key "move" with each point at a vertex replaced by the vertex's new position.

    start, places: (v, d) positions before and now.
    """

    def moved(point: list[float]) -> list[float]:
        """Return the present position of the vertex at a point, or the point if none is there."""
        distance = np.linalg.norm(start - np.array(point, dtype=float), axis=1)
        vertex = int(np.argmin(distance))
        if distance[vertex] > SAME * size:
            return point
        found: list[float] = places[vertex].tolist()
        return found

    found = dict(move)
    if "along" in move:
        found["along"] = [{**path, "at": moved(path["at"])} if "at" in path else path for path in move["along"]]
    if isinstance(move.get("ties"), list):
        found["ties"] = [[moved(point) for point in group] for group in move["ties"]]
    return found


def _with_friction_factor(document: dict[str, Any], factor: float) -> dict[str, Any]:
    """Return a document with the friction of dry joints multiplied by a factor."""

    def changed(entry: dict[str, Any]) -> dict[str, Any]:
        """Return an entry with its friction coefficient multiplied."""
        entry = dict(entry)
        angle = entry.pop("friction_angle", None)
        if angle is not None:
            entry["friction_coefficient"] = float(np.tan(np.radians(_nominal(angle))))
        if "friction_coefficient" in entry:
            entry["friction_coefficient"] = factor * _nominal(entry["friction_coefficient"])
        return entry

    materials = dict(document["materials"])
    materials["dry"] = changed(materials["dry"])
    if "faces" in materials:
        materials["faces"] = [
            {**one, "dry": changed(one["dry"])} if "dry" in one else one for one in materials["faces"]
        ]
    interfaces = [changed(one) for one in document["interfaces"]]
    return {**document, "materials": materials, "interfaces": interfaces}


def _nominal(value: Any) -> float:
    """Return the number itself, or its nominal value or mean."""
    return float(value["nominal" if "nominal" in value else "mean"] if isinstance(value, dict) else value)
