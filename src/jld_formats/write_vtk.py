"""Writer of VTK for ParaView (by meshio): surfaces of elements, interfaces, and fields."""

from __future__ import annotations

import itertools
import json
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import Floats, Layout
from jld_core.limit import displacement
from jld_core.scene import units
from jld_formats.facts import block_facts
from jld_formats.libraries import library
from jld_formats.read_mesh import solids_of
from jld_views import quantities

# Cell fields of one number each
_NAMES: Final = ("part", "element", "block", "shape", "support", "label", "utilisation", "normal_force")


class _Polygons:
    """Polygons of a layout with their fields, collected one element or interface at a time."""

    def __init__(self, layout: Layout) -> None:
        self.layout, self.result = layout, layout.result
        self.planar = layout.assembly.dimension == 2
        self.points: list[Floats] = []
        self.faces: list[tuple[int, ...]] = []
        self.rows: dict[str, list[float]] = {name: [] for name in _NAMES}
        self.forces: list[list[float]] = []
        self.motion: list[Floats] = []
        count = len(layout.assembly.interfaces)
        self._used, self._normal, self._vectors = np.zeros(count), np.zeros(count), np.zeros((count, 3))
        if self.result is not None and self.result.forces is not None:
            self._used, self._normal = quantities.utilisation(self.result), self.result.forces[:, 0]
            plain = quantities.face_vectors(layout.assembly, self.result.forces)
            self._vectors = np.column_stack([plain[:, 0], np.zeros(len(plain)), plain[:, 1]]) if self.planar else plain

    def add(self, corners: Floats, loops: list[tuple[int, ...]], element: int, part: int, face: int | None) -> None:
        """Add faces of an element or an interface with their fields.

        corners: (k, 3).
        """
        start = sum(map(len, self.points))
        self.points.append(corners)
        self.motion.append(self._velocity(element, corners))
        block = int(self.layout.block_of[element])
        own = {
            "part": part,
            "element": element,
            "block": block,
            "shape": self.layout.blocks[block].shape,
            "support": float(self.layout.assembly.elements.support[element]),
            "label": -1.0 if face is None else float(self.layout.labels[face]),
            "utilisation": 0.0 if face is None else float(self._used[face]),
            "normal_force": 0.0 if face is None else float(self._normal[face]),
        }
        for loop in loops:
            self.faces.append(tuple(start + index for index in loop))
            for name, value in own.items():
                self.rows[name].append(value)
            self.forces.append([0.0, 0.0, 0.0] if face is None else self._vectors[face].tolist())

    def _velocity(self, element: int, corners: Floats) -> Floats:
        """Return the velocities (k, 3) of corners by the mechanism."""
        if self.result is None or self.result.mechanism is None:
            return np.zeros((len(corners), 3))
        flat = corners[:, [0, 2]] if self.planar else corners
        moved = displacement(self.layout.assembly, self.result.mechanism, element, flat)
        return np.column_stack([moved[:, 0], np.zeros(len(moved)), moved[:, 1]]) if self.planar else moved


def write_vtk(layout: Layout, path: Path, *, cells: bool = False) -> None:
    """Write a layout and its analysis as a VTK grid of polygons, for ParaView."""
    # A file that ends in .vtk has the older format. Each polygon is part 0 (surface of an element) or part 1
    # (interface). Its further fields are: element, block, shape, support, label, utilisation, force and normal_force.
    # Label is 1 dry, 0 inner, and −1 on surfaces; force is the vector on element b, scene units. The field of the
    # points is mechanism, the velocity that gives the live load power 1. Without an analysis its fields are zero.
    meshio = library("meshio", path)
    found = _polygons_of(layout)
    faces = found.faces
    order = sorted(range(len(faces)), key=lambda k: len(faces[k]))
    groups: list[tuple[str, list[tuple[int, ...]]]] = []
    for k in order:
        if not groups or len(groups[-1][1][0]) != len(faces[k]):
            groups.append(({3: "triangle", 4: "quad"}.get(len(faces[k]), "polygon"), []))
        groups[-1][1].append(faces[k])
    stops = np.cumsum([0, *(len(block) for _, block in groups)])

    def by_block(values: Floats) -> list[Floats]:
        """Split values (k, …) of polygons by cell type, in the order of the file."""
        return [values[order[a:b]] for a, b in itertools.pairwise(stops)]

    fields = {name: by_block(np.array(values)) for name, values in found.rows.items()}
    fields["force"] = by_block(np.array(found.forces))
    mesh = meshio.Mesh(
        np.concatenate(found.points),
        [(kind, np.array(block)) for kind, block in groups],
        point_data={"mechanism": np.concatenate(found.motion)},
        cell_data=fields,
    )
    if path.suffix == ".vtk":
        meshio.vtk.write(path, mesh, binary=True)
    else:
        meshio.vtu.write(path, mesh, binary=True)


def _polygons_of(layout: Layout) -> _Polygons:
    """Collect the surfaces of all elements, then the interfaces."""
    found = _Polygons(layout)
    interfaces = layout.assembly.interfaces
    for element, (_, _, surface) in enumerate(solids_of(layout, cells=True)):
        found.add(surface.points, list(surface.faces), element, 0, None)
    for face, polygon in enumerate(interfaces.polygon):
        corners = polygon
        if found.planar:
            (x0, z0), (x1, z1) = polygon.tolist()
            depth = layout.thickness
            corners = np.array([[x0, 0.0, z0], [x1, 0.0, z1], [x1, depth, z1], [x0, depth, z0]])
        found.add(corners, [tuple(range(len(corners)))], int(interfaces.a[face]), 1, face)
    return found


_FLOAT: Final = 5126  # glTF code of numbers of four bytes with a sign and an exponent

_VERTICES: Final = 34962  # glTF code of a buffer of vertices

# Red, green and blue of the shapes, used cyclically; supports are grey
_COLOURS: Final = ((0.87, 0.72, 0.5), (0.6, 0.73, 0.86), (0.72, 0.83, 0.6), (0.88, 0.64, 0.64), (0.76, 0.68, 0.86))


def gltf_bytes(layout: Layout, *, cells: bool) -> bytes:
    """Return the content of a .glb file: a node with a mesh of flat triangles for each block."""
    facts = block_facts(layout)
    scale = units.METRES.get(layout.assembly.units[0], 1.0)
    owner = [int(k) for k in layout.block_of] if cells else [
        k for k, surfaces in enumerate(layout.surfaces) for _ in surfaces
    ]  # fmt: skip
    nodes: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    views: list[dict[str, Any]] = []
    buffer = bytearray()

    def stored(values: np.ndarray, bounds: bool) -> int:
        """Add an array (k, 3) to the buffer and return the number of its accessor."""
        data = values.astype("<f4")
        views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": data.nbytes, "target": _VERTICES})
        buffer.extend(data.tobytes())
        entry = {"bufferView": len(views) - 1, "componentType": _FLOAT, "count": len(data), "type": "VEC3"}
        if bounds:
            entry |= {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
        accessors.append(entry)
        return len(accessors) - 1

    for number, (name, support, surface) in enumerate(solids_of(layout, cells=cells)):
        fact = facts[owner[number]]
        # positions relative to the node keep the digits of large coordinates; z up becomes y up
        middle = surface.points.mean(axis=0)
        corners = (scale * (surface.points - middle))[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
        triangles = corners[np.array(surface.triangles)]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        length = np.linalg.norm(normals, axis=1)
        kept = length > 0.0
        normals = np.repeat(normals[kept] / length[kept, None], 3, axis=0)
        attributes = {"POSITION": stored(triangles[kept].reshape(-1, 3), True), "NORMAL": stored(normals, False)}
        material = 0 if support else 1 + fact.shape % len(_COLOURS)
        meshes.append({"name": name, "primitives": [{"attributes": attributes, "material": material, "mode": 4}]})
        place = (scale * middle)[[0, 2, 1]] * [1.0, 1.0, -1.0]
        extras = fact.entries()
        nodes.append({"name": name, "mesh": number, "translation": place.tolist(), "extras": extras})
    materials = [_material("supports", (0.6, 0.6, 0.6))]
    materials += [_material(f"shape {k}", colour) for k, colour in enumerate(_COLOURS)]
    document = {
        "asset": {"version": "2.0", "generator": "jld"},
        "scene": 0,
        "scenes": [{"name": layout.assembly.name, "nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(buffer)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    buffer.extend(b"\0" * (-len(buffer) % 4))
    total = 12 + 8 + len(text) + 8 + len(buffer)
    head = struct.pack("<4sII", b"glTF", 2, total)
    return b"".join(
        [head, struct.pack("<I4s", len(text), b"JSON"), text, struct.pack("<I4s", len(buffer), b"BIN\0"), bytes(buffer)]
    )


def _material(name: str, colour: tuple[float, float, float]) -> dict[str, Any]:
    surface = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9}
    return {"name": name, "pbrMetallicRoughness": surface}
