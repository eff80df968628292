"""Scenes with the same elements and interfaces at other positions of their vertices."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Bits, Bools, Floats, Ints, Scene, parse_scene
from jld_core.build import build_geometry
from jld_core.linalg import merged_points
from jld_geometry.convex_cells import VertexMesh
from jld_geometry.variables import SAME


def _stated_interfaces(geometry: Any, assembly: Assembly, labels: Bits) -> list[dict[str, Any]]:
    """Return the interfaces of an assembly as a scene states them, without their places."""
    ids, faces = assembly.elements.ids, assembly.interfaces
    interfaces = []
    for k, contact in enumerate(geometry.given):
        strengths = {} if contact is None else contact.model_dump(mode="json", exclude_defaults=True)
        label = "dry" if labels[k] else "inner"
        interfaces.append({**strengths, "elements": [ids[faces.a[k]], ids[faces.b[k]]], "label": label})
    return interfaces


class MovedScene:
    """Planar scene whose vertices, and points that name them, move; all else stays."""

    def __init__(self, scene: Scene, assembly: Assembly, labels: Bits, mesh: VertexMesh) -> None:
        self._mesh = mesh
        document: dict[str, Any] = scene.model_dump(mode="json", exclude_defaults=True)
        document.pop("grid", None)
        document.pop("labels", None)
        document["thickness"] = float(assembly.interfaces.l2[0]) if len(assembly.interfaces) else 1.0
        geometry = build_geometry(scene)
        self._elements = [entry.model_dump(mode="json", exclude_defaults=True) for entry in geometry.entries]
        self._interfaces = _stated_interfaces(geometry, assembly, labels)
        self._document = document
        self._size = assembly.size

    def document(self, places: Floats, friction: float = 1.0) -> dict[str, Any]:
        """Return the scene file as a dict with the vertices at the positions (v, 2), unchecked."""
        document = dict(self._document)
        document["elements"] = [
            {**entry, "polygon": places[loop].tolist()}
            for entry, loop in zip(self._elements, self._mesh.loops, strict=True)
        ]
        document["interfaces"] = [
            {**entry, "polygon": places[ends].tolist()}
            for entry, ends in zip(self._interfaces, self._mesh.ends, strict=True)
        ]
        if "move" in document:
            document["move"] = move_with_points(document["move"], self._mesh.places, places, self._size)
        return document if friction == 1.0 else _with_friction_factor(document, friction)

    def at(self, places: Floats, friction: float = 1.0) -> Scene:
        """Return the validated scene with the vertices at (v, 2); InputError where it is none."""
        return parse_scene(self.document(places, friction), "the moved scene")


def move_with_points(move: dict[str, Any], start: Floats, places: Floats, size: float) -> dict[str, Any]:
    """Return the key "move" with points at vertices, at `start` (v, d), moved to `places` (v, d)."""

    def moved(point: list[float]) -> list[float]:
        distance = np.linalg.norm(start - np.array(point, dtype=float), axis=1)
        vertex = int(np.argmin(distance))
        if distance[vertex] > SAME * size:
            return point
        moved_point: list[float] = places[vertex].tolist()
        return moved_point

    key = dict(move)
    if "along" in move:
        key["along"] = [{**path, "at": moved(path["at"])} if "at" in path else path for path in move["along"]]
    if isinstance(move.get("ties"), list):
        key["ties"] = [[moved(point) for point in group] for group in move["ties"]]
    return key


def _with_friction_factor(document: dict[str, Any], factor: float) -> dict[str, Any]:
    """Return a scene with all friction coefficients multiplied by a factor."""

    def changed(entry: dict[str, Any]) -> dict[str, Any]:
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
            {**contact, "dry": changed(contact["dry"])} if "dry" in contact else contact
            for contact in materials["faces"]
        ]
    interfaces = [changed(contact) for contact in document["interfaces"]]
    return {**document, "materials": materials, "interfaces": interfaces}


def _nominal(value: Any) -> float:
    return float(value["nominal" if "nominal" in value else "mean"] if isinstance(value, dict) else value)


_MERGED: Final = 1e-2  # distance of two corners that are one vertex, relative to the shortest edge


@dataclass(frozen=True)
class SpatialMesh:
    """Elements and interfaces of a spatial assembly by the v vertices they share."""

    places: Floats  # (v, 3) positions of the vertices, scene units
    corners: tuple[Ints, ...]  # vertex of each corner of each element
    # vertices around each face of each element, seen from outside counter-clockwise
    rings: tuple[tuple[Ints, ...], ...]
    polygons: tuple[Ints, ...]  # vertices around each interface

    def at(self, places: Floats) -> SpatialMesh:
        return SpatialMesh(places, self.corners, self.rings, self.polygons)

    @property
    def edges(self) -> tuple[Ints, Ints]:
        """Element (k,) and vertices (k, 2) of every edge of every face of every element."""
        owner = [k for k, rings in enumerate(self.rings) for ring in rings for _ in ring]
        pairs = [np.column_stack([ring, np.roll(ring, -1)]) for rings in self.rings for ring in rings]
        return np.array(owner, dtype=np.int64), np.concatenate(pairs)


def spatial_mesh(assembly: Assembly) -> SpatialMesh:
    """Find the vertices that the elements and interfaces of a spatial assembly share."""
    assembly.members.refuse("a move of joints")
    shapes, polygons = assembly.elements.shape, assembly.interfaces.polygon
    places, number = merged_points(np.concatenate([*shapes, *polygons]), _MERGED * shortest_edge(assembly))
    starts = np.cumsum([0, *(len(points) for points in (*shapes, *polygons))]).tolist()
    vertices = [number[a:b] for a, b in itertools.pairwise(starts)]
    corners = tuple(vertices[: len(shapes)])
    rings = tuple(
        tuple(corner[list(ring)] for ring in faces)
        for corner, faces in zip(corners, assembly.elements.faces, strict=True)
    )
    return SpatialMesh(places, corners, rings, tuple(vertices[len(shapes) :]))


def shortest_edge(assembly: Assembly) -> float:
    loops = [
        shape[list(ring)]
        for shape, rings in zip(assembly.elements.shape, assembly.elements.faces, strict=True)
        for ring in rings
    ]
    loops += list(assembly.interfaces.polygon)
    return min(float(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).min()) for loop in loops)


class SpatialMovedScene:
    """Spatial scene whose vertices move; outer faces that move become triangles."""

    def __init__(self, scene: Scene, assembly: Assembly, labels: Bits, mesh: SpatialMesh, moving: Bools) -> None:
        self._mesh, self._reach = mesh, assembly.size
        document: dict[str, Any] = scene.model_dump(mode="json", exclude_defaults=True)
        document.pop("labels", None)
        geometry = build_geometry(scene)
        joints = {frozenset(polygon.tolist()) for polygon in mesh.polygons}
        self._elements = []
        for entry, corner, rings, faces in zip(
            geometry.entries, mesh.corners, mesh.rings, assembly.elements.faces, strict=True
        ):
            strengths = entry.model_dump(mode="json", exclude_defaults=True)
            if moving[corner].any():
                strengths["faces"] = [
                    list(part)
                    for ring, face in zip(rings, faces, strict=True)
                    for part in _parts(ring, list(face), joints, moving)
                ]
            self._elements.append(strengths)
        self._interfaces = _stated_interfaces(geometry, assembly, labels)
        self._document = document

    def at(self, places: Floats, friction: float = 1.0) -> Scene:
        document = dict(self._document)
        document["elements"] = [
            {**entry, "vertices": places[corner].tolist()}
            for entry, corner in zip(self._elements, self._mesh.corners, strict=True)
        ]
        document["interfaces"] = [
            {**entry, "polygon": places[polygon].tolist()}
            for entry, polygon in zip(self._interfaces, self._mesh.polygons, strict=True)
        ]
        if "move" in document:
            document["move"] = move_with_points(document["move"], self._mesh.places, places, self._reach)
        return parse_scene(document, "the moved scene")


def _parts(ring: Ints, face: list[int], joints: set[frozenset[int]], moving: Bools) -> list[list[int]]:
    """Return the loops of a face: triangles if it is outer and has a vertex that moves."""
    if frozenset(ring.tolist()) in joints or len(face) == 3 or not moving[ring].any():
        return [face]
    return [[face[0], face[k], face[k + 1]] for k in range(1, len(face) - 1)]
