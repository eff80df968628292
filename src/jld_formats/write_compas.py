"""Writer of COMPAS JSON as in compas_assembly: blocks at nodes, interfaces along edges."""

from __future__ import annotations

import json
import uuid
from typing import Any, Final

import numpy as np

from jld_core import Floats, Layout
from jld_core.geometry import area_vector, unions
from jld_formats.facts import element_keys, facts_of, interfaces_of, scene_of
from jld_formats.read_mesh import solids_of

# Namespace of the name-based guids of written objects
_SPACE: Final = uuid.UUID("6f1c2a52-6d0e-5a5e-9a54-6a6c64636f6d")


def compas_text(layout: Layout, *, cells: bool) -> str:
    """Write the JSON of a `compas_assembly` Assembly: a node for each block (or cell), an edge for each contact."""
    # Facts that COMPAS has no place for (loads, strengths, stated interfaces) go into an attribute of jld's own.
    solids = list(solids_of(layout, cells=cells))
    keys = weights_of(layout, cells)
    if cells and layout.assembly.dimension == 3:
        facts = scene_of(layout, interfaces=True)
        facts.pop("elements")  # the nodes say them
    else:
        facts = facts_of(layout, cells=cells)
    if cells and layout.assembly.dimension == 2:  # stated faces are drawn in space, as blocks are
        facts["interfaces"] = [
            {**entry, "polygon": _in_space(layout, np.array(entry["polygon"])).tolist()}
            for entry in interfaces_of(layout)
        ]
    nodes, edges = {}, {str(k): {} for k in range(len(solids))}  # type: ignore[var-annotated]
    for k, (name, support, surface) in enumerate(solids):
        block = _block(name, k, surface)
        x, y, z = surface.points.mean(axis=0).tolist()
        own = dict(keys.get(name, {}))
        if "block" in own:  # "block" is COMPAS's own key
            own["block_name"] = own.pop("block")
        nodes[str(k)] = {
            "block": _envelope("compas_assembly.datastructures/Block", block, name),
            "name": name,
            "is_support": support,
            "x": x,
            "y": y,
            "z": z,
            **own,
        }
    number = {name: k for k, (name, _, _) in enumerate(solids)}
    for a, b, points, _ in named_faces(layout, cells):
        face = {
            "points": points.tolist(),
            "size": float(np.linalg.norm(area_vector(points))),
            "frame": _envelope("compas.geometry/Frame", _frame(points), ""),
            "forces": None,
            "mesh": None,
        }
        others = edges[str(number[a])]
        entry = others.setdefault(str(number[b]), {"interfaces": []})
        entry["interfaces"].append(_envelope("compas_assembly.datastructures/Interface", face, f"{a} {b}"))
    graph = {
        "attributes": {"name": "Graph"},
        "default_node_attributes": {"block": None, "is_support": False, "displacement": [0, 0, 0, 0, 0, 0]},
        "default_edge_attributes": {"interfaces": None},
        "node": nodes,
        "edge": edges,
        "max_node": len(nodes) - 1,
    }
    data = {
        "attributes": {"name": layout.assembly.name, "jld": facts},
        "graph": _envelope("compas.datastructures/Graph", graph, "graph"),
    }
    return json.dumps(_envelope("compas_assembly.datastructures/Assembly", data, layout.assembly.name), indent=1) + "\n"


def mesh_data(surface: unions.Surface) -> dict[str, Any]:
    """Return the data that a mesh of COMPAS states of a closed surface, without attributes."""
    return {
        "attributes": {},
        "default_vertex_attributes": {"x": 0.0, "y": 0.0, "z": 0.0},
        "default_edge_attributes": {},
        "default_face_attributes": {},
        "vertex": {str(i): dict(zip("xyz", p, strict=True)) for i, p in enumerate(surface.points.tolist())},
        "face": {str(i): list(loop) for i, loop in enumerate(surface.faces)},
        "facedata": {},
        "edgedata": {},
        "max_vertex": len(surface.points) - 1,
        "max_face": len(surface.faces) - 1,
    }


def _block(name: str, node: int, surface: unions.Surface) -> dict[str, Any]:
    """Return the data of a block: its name, its node in the graph, and its mesh."""
    return {**mesh_data(surface), "attributes": {"name": name, "node": node}}


def _envelope(kind: str, data: Any, name: str) -> dict[str, Any]:
    """Return an object in its COMPAS envelope, its guid derived from its name: same layout, same file."""
    found = {"dtype": kind, "data": data}
    return found if kind.startswith("compas.geometry") else {**found, "guid": str(uuid.uuid5(_SPACE, f"{kind} {name}"))}


def named_faces(layout: Layout, cells: bool) -> list[tuple[str, str, Floats, int]]:
    """Return both names, corners (k, 3) and index of each interface between written solids."""
    # Corners run counter-clockwise about the normal out of the first solid.
    assembly = layout.assembly
    faces = assembly.interfaces
    found = []
    for k, (a, b, polygon) in enumerate(zip(faces.a.tolist(), faces.b.tolist(), faces.polygon, strict=True)):
        if cells:
            one, two = assembly.elements.ids[a], assembly.elements.ids[b]
        else:
            one, two = (layout.blocks[int(layout.block_of[e])].name for e in (a, b))
        if one == two:
            continue
        points = _in_space(layout, polygon)
        # corners run counter-clockwise about the normal out of the first solid, as COMPAS expects
        out = faces.normal[k] if assembly.dimension == 3 else np.array([faces.normal[k, 0], 0.0, faces.normal[k, 1]])
        found.append((one, two, points if area_vector(points) @ out > 0.0 else points[::-1], k))
    return found


def point_in_space(layout: Layout, point: Floats) -> Floats:
    """Convert a point of a scene to space, (3,).

    One of a planar scene lies in the middle of the thickness.
    """
    return point if len(point) == 3 else np.array([point[0], 0.5 * layout.thickness, point[1]])


def _in_space(layout: Layout, polygon: Floats) -> Floats:
    """Return the corners (k, 3) of an interface; a planar one extends over the thickness."""
    if layout.assembly.dimension == 3:
        return polygon
    (x0, z0), (x1, z1) = polygon.tolist()
    depth = layout.thickness
    return np.array([[x0, 0.0, z0], [x1, 0.0, z1], [x1, depth, z1], [x0, depth, z0]])


def weights_of(layout: Layout, cells: bool) -> dict[str, dict[str, Any]]:
    """Return weight and centroid of written free solids by name, scene units; cells: each element is a solid."""
    layout = layout.drawn_from or layout
    elements = layout.assembly.elements
    weight = np.linalg.norm(elements.weight, axis=1)
    found: dict[str, dict[str, Any]] = element_keys(layout) if cells and layout.assembly.dimension == 3 else {}
    if cells and layout.assembly.dimension == 3:
        return found
    if cells:
        rows = [
            (name, weight[k], elements.centroid[k]) for k, name in enumerate(elements.ids) if not elements.support[k]
        ]
    else:
        free = [block for block in layout.blocks if block.cells and not block.support]
        rows = [(b.name, weight[list(b.elements)].sum(), np.array(b.centroid)) for b in free]
    for name, force, centroid in rows:
        x = centroid.tolist()
        place = x if len(x) == 3 else [x[0], 0.5 * layout.thickness, x[1]]
        found[name] = {"weight": float(force), "centroid": place}
    return found


def _frame(points: Floats) -> dict[str, list[float]]:
    normal = area_vector(points)
    x = points[1] - points[0]
    x = x / np.linalg.norm(x)
    y = np.cross(normal / np.linalg.norm(normal), x)
    return {"point": points.mean(axis=0).tolist(), "xaxis": x.tolist(), "yaxis": y.tolist()}
