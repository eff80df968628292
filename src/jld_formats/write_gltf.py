"""Writer of binary glTF 2.0 files: one mesh per solid, with its name and facts as extras."""

from __future__ import annotations

import json
import struct
from typing import Any, Final

import numpy as np

from jld_core.exchange.block_facts import block_facts
from jld_core.exchange.layout import Layout
from jld_core.exchange.write_mesh import solids_of
from jld_core.scene.units import METRES

_FLOAT: Final = 5126  # glTF code of numbers of four bytes with a sign and an exponent

_VERTICES: Final = 34962  # glTF code of a buffer of vertices

# Red, green and blue of the shapes, used cyclically; supports are grey
_COLOURS: Final = ((0.87, 0.72, 0.5), (0.6, 0.73, 0.86), (0.72, 0.83, 0.6), (0.88, 0.64, 0.64), (0.76, 0.68, 0.86))


def gltf_bytes(layout: Layout, *, cells: bool) -> bytes:
    """Return the content of a .glb file: a node with a mesh of flat triangles for each block.

    cells: write every element, not every block. Lengths are metres where the scene's unit is known, and the y axis
    points up, as glTF has it. Each node carries the facts of its block as extras: mass, mould, order of laying, λ.
    """
    facts = block_facts(layout)
    scale = METRES.get(layout.assembly.units[0], 1.0)
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
    """Return a rough material of a colour."""
    surface = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9}
    return {"name": name, "pbrMetallicRoughness": surface}
