"""Writer of compas_dem JSON: an analysis with model, problems, forces and mechanism."""

from __future__ import annotations

import json
import uuid
from typing import Any, Final

import numpy as np

from jld_core import Floats, InputError, Layout, Route
from jld_core.geometry import area_vector, unions
from jld_core.limit import displacement
from jld_core.scene import standard
from jld_formats.facts import element_keys, facts_of, interfaces_of, scene_of
from jld_formats.read_mesh import solids_of
from jld_views import quantities

# Namespace of the name-based guids of written objects
_NAMES: Final = uuid.UUID("6f1c2a52-6d0e-5a5e-9a54-6a6c64636f6d")


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
        attributes = dict(keys.get(name, {}))
        if "block" in attributes:  # "block" is COMPAS's own key
            attributes["block_name"] = attributes.pop("block")
        nodes[str(k)] = {
            "block": _envelope("compas_assembly.datastructures/Block", block, name),
            "name": name,
            "is_support": support,
            "x": x,
            "y": y,
            "z": z,
            **attributes,
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
    return {**mesh_data(surface), "attributes": {"name": name, "node": node}}


def _envelope(kind: str, data: Any, name: str) -> dict[str, Any]:
    """Return an object in its COMPAS envelope, its guid derived from its name: same layout, same file."""
    envelope = {"dtype": kind, "data": data}
    return (
        envelope
        if kind.startswith("compas.geometry")
        else {**envelope, "guid": str(uuid.uuid5(_NAMES, f"{kind} {name}"))}
    )


def named_faces(layout: Layout, cells: bool) -> list[tuple[str, str, Floats, int]]:
    """Return both names, corners (k, 3) and index of each interface between written solids."""
    # Corners run counter-clockwise about the normal out of the first solid.
    assembly = layout.assembly
    faces = assembly.interfaces
    named = []
    for k, (a, b, polygon) in enumerate(zip(faces.a.tolist(), faces.b.tolist(), faces.polygon, strict=True)):
        if cells:
            first, second = assembly.elements.ids[a], assembly.elements.ids[b]
        else:
            first, second = (layout.blocks[int(layout.block_of[e])].name for e in (a, b))
        if first == second:
            continue
        points = _in_space(layout, polygon)
        # corners run counter-clockwise about the normal out of the first solid, as COMPAS expects
        out = faces.normal[k] if assembly.dimension == 3 else np.array([faces.normal[k, 0], 0.0, faces.normal[k, 1]])
        named.append((first, second, points if area_vector(points) @ out > 0.0 else points[::-1], k))
    return named


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
    keys_of: dict[str, dict[str, Any]] = element_keys(layout) if cells and layout.assembly.dimension == 3 else {}
    if cells and layout.assembly.dimension == 3:
        return keys_of
    if cells:
        rows = [
            (name, weight[k], elements.centroid[k]) for k, name in enumerate(elements.ids) if not elements.support[k]
        ]
    else:
        free = [block for block in layout.blocks if block.cells and not block.support]
        rows = [(b.name, weight[list(b.elements)].sum(), np.array(b.centroid)) for b in free]
    for name, force, centroid in rows:
        x = centroid.tolist()
        position = x if len(x) == 3 else [x[0], 0.5 * layout.thickness, x[1]]
        keys_of[name] = {"weight": float(force), "centroid": position}
    return keys_of


def _frame(points: Floats) -> dict[str, list[float]]:
    normal = area_vector(points)
    x = points[1] - points[0]
    x = x / np.linalg.norm(x)
    y = np.cross(normal / np.linalg.norm(normal), x)
    return {"point": points.mean(axis=0).tolist(), "xaxis": x.tolist(), "yaxis": y.tolist()}


_ROUTE: Final = Route("files of COMPAS")

# Namespace of the name-based guids of written objects
_SPACE: Final = uuid.UUID("2f0a4d4e-0f55-5f2e-9d0e-6a6c6464656d")


def dem_text(layout: Layout, *, cells: bool) -> str:
    """Return a layout as the JSON text of a compas_dem `Analysis` and its `Results`, if analysed."""
    file = Dem(layout, cells)
    document: dict[str, Any] = {"analysis": file.analysis()}
    if layout.result is not None:
        document["results"] = file.results()
    return json.dumps(document, indent=1) + "\n"


class Dem:
    """Objects of one file; nodes: node of the graph of each solid, by name, by default in their order."""

    def __init__(self, layout: Layout, cells: bool, nodes: dict[str, str] | None = None) -> None:
        self._layout, self._cells = layout, cells
        self._solids = list(solids_of(layout, cells=cells))
        self._number = nodes or {name: str(k) for k, (name, _, _) in enumerate(self._solids)}
        self._name = layout.assembly.name
        self._faces = list(named_faces(layout, cells))

    def _object(self, kind: str, name: str, data: dict[str, Any]) -> dict[str, Any]:
        """Return an object in its COMPAS envelope, with a guid derived from its kind and name."""
        return {"dtype": kind, "data": data, "guid": self._guid(kind, name), "name": name}

    def _guid(self, kind: str, name: str) -> str:
        """Return the guid of an object; the same layout always gives the same file."""
        return str(uuid.uuid5(_SPACE, f"{self._name} {kind} {name}"))

    def analysis(self) -> dict[str, Any]:
        data = {"name": self._name, "model": self._model(), "problems": [self._problem()]}
        return self._object("compas_dem.models/Analysis", self._name, data)

    def _model(self) -> dict[str, Any]:
        """Return the block model: blocks with materials, and contacts on the graph's edges."""
        elements, materials, nodes = {}, {}, {}
        for k, ((name, support, surface), density) in enumerate(zip(self._solids, self._densities(), strict=True)):
            material = self._guid("compas_dem.material/GenericMaterial", f"{density:.12g}")
            materials[material] = self._object(
                "compas_dem.material/GenericMaterial",
                f"{density:.12g}",
                {"name": "GenericMaterial", "density": density, "fck": None, "ft": None, "Ecm": None, "poisson": 0.2},
            )
            data: dict[str, Any] = {
                "transformation": None,
                "features": [],
                "name": name,
                "material": material,
                "geometry": {"dtype": "compas.datastructures/Mesh", "data": mesh_data(surface)},
                "is_support": support,
            }
            block = self._object("compas_dem.elements/Block", name, data)
            elements[block["guid"]] = block
            nodes[str(k)] = {"element": block["guid"]}
        edges: dict[str, dict[str, Any]] = {key: {} for key in nodes}
        for a, b, points, face in self._faces:
            entry = edges[self._number[a]].setdefault(self._number[b], {"contacts": []})
            entry["contacts"].append(self._contact(points, face))
        graph = {
            "attributes": {},
            "default_node_attributes": {"x": 0.0, "y": 0.0, "z": 0.0, "element": None},
            "default_edge_attributes": {"modifiers": None, "contacts": None},
            "node": nodes,
            "edge": edges,
            "max_node": len(nodes) - 1,
        }
        children = [{"name": "ElementNode", "element": guid} for guid in elements]
        model: dict[str, Any] = {
            "transformation": None,
            "elements": elements,
            "materials": materials,
            "tree": {"attributes": {}, "root": {"name": "root", "children": children}},
            "graph": graph,
        }
        return self._object("compas_dem.models/BlockModel", self._name, model)

    def _densities(self) -> list[float]:
        """Return the density of each solid; one without mass gets that of the scene, or 1."""
        layout = self._layout
        elements = layout.assembly.elements
        usual = layout.scene.materials.density
        fallback = float(usual) if isinstance(usual, int | float) and usual > 0 else 1.0
        if self._cells:
            mass, volume = elements.mass, elements.volume
            pairs = [(float(m), float(v)) for m, v in zip(mass, volume, strict=True)]
        else:
            surfaces = [len(parts) for parts in layout.surfaces]
            pairs = [(b.mass, b.volume) for b, n in zip(layout.blocks, surfaces, strict=True) for _ in range(n)]
        densities = [m / v if m > 0.0 and v > 0.0 else fallback for m, v in pairs]
        return [float(f"{value:.12g}") for value in densities]

    def _frame(self, points: Floats, face: int) -> Floats:
        """Return the axes e1, e2 and n of an interface in space, as the rows of an array (3, 3)."""
        faces = self._layout.assembly.interfaces
        if self._layout.assembly.dimension == 3:
            return np.array([faces.e1[face], faces.e2[face], faces.normal[face]])
        (tx, tz), (nx, nz) = faces.e1[face], faces.normal[face]
        return np.array([[tx, 0.0, tz], [0.0, -1.0, 0.0], [nx, 0.0, nz]])

    def _contact(self, points: Floats, face: int) -> dict[str, Any]:
        """Return a contact with its forces at the corners, where there is an analysis."""
        axes = self._frame(points, face)
        centre = point_in_space(self._layout, self._layout.assembly.interfaces.origin[face])
        frame = {"point": centre.tolist(), "xaxis": axes[0].tolist(), "yaxis": axes[1].tolist()}
        data = {
            "name": "FrictionContact",
            "points": [{"dtype": "compas.geometry/Point", "data": point} for point in points.tolist()],
            "frame": {"dtype": "compas.geometry/Frame", "data": frame},
            "size": float(np.linalg.norm(area_vector(points))),
            "mesh": None,
            "holes": None,
            "forces": self._corner_forces(points, face, axes, centre),
        }
        return {"dtype": "compas_dem.interactions/FrictionContact", "data": data}

    def _resultants(self, face: int) -> Floats:
        """Return N, V1, V2, M1, M2, MT (6,) of an interface; planar ones have V2 = M1 = MT = 0."""
        result = self._layout.result
        if result is None or result.forces is None:
            raise ValueError("the layout has no analysis with forces")
        if self._layout.assembly.dimension == 3:
            return np.asarray(result.forces[face])
        normal, shear, moment = result.forces[face]
        return np.array([normal, shear, 0.0, 0.0, moment, 0.0])

    def _corner_forces(self, points: Floats, face: int, axes: Floats, centre: Floats) -> list[dict[str, float]]:
        """Return linear forces at corners (k, 3) with an interface's resultants; empty without forces."""
        # Normal forces satisfy Σ f = N, Σ f x1 = −M2 and Σ f x2 = M1; shear forces Σ c = V, Σ (x1 c2 − x2 c1) = MT.
        result = self._layout.result
        if result is None or result.forces is None:
            return []
        normal, v1, v2, m1, m2, torsion = self._resultants(face).tolist()
        x1, x2 = ((points - centre) @ axes[:2].T).T
        ones, zeros = np.ones(len(points)), np.zeros(len(points))
        pressure = np.linalg.pinv(np.array([ones, x1, x2])) @ np.array([normal, -m2, m1])
        rows = np.block([[ones, zeros], [zeros, ones], [-x2, x1]])
        shear = np.linalg.pinv(rows) @ np.array([v1, v2, torsion])
        count = len(points)
        return [
            {
                "c_np": max(float(pressure[k]), 0.0),
                "c_nn": max(-float(pressure[k]), 0.0),
                "c_u": float(shear[k]),
                "c_v": float(shear[count + k]),
            }
            for k in range(count)
        ]

    def _problem(self) -> dict[str, Any]:
        """Return the problem: boundary conditions of each load case, and the contact model."""
        facts = facts_of(self._layout, cells=self._cells)["loads"]
        cases = facts.get("cases") or [{"name": "Live", "live": facts.get("live", []), "dead": []}]
        groups = [self._group(str(case["name"]), case.get("live", [])) for case in cases]
        if facts.get("dead"):
            groups.insert(0, self._group("Dead", facts["dead"]))
        law = self._object("compas_dem.interactions/MohrCoulomb", "MohrCoulomb", self._law())
        contact = {"name": "ContactProperties", "contact_model": law, "joint_model": None}
        data = {
            "name": self._name,
            "model_id": self._guid("compas_dem.models/BlockModel", self._name),
            "boundary_conditions": groups,
            "contact_properties": self._object(
                "compas_dem.interactions/ContactProperties", "ContactProperties", contact
            ),
            "solver": None,
        }
        return self._object("compas_dem.problem/Problem", self._name, data)

    def _gravity(self) -> float:
        """Return the acceleration of gravity; raise InputError where it does not act along −z."""
        gravity = self._layout.scene.materials.gravity
        if isinstance(gravity, int | float):
            return float(gravity)
        vector = [float(value) for value in gravity]
        if any(vector[:-1]) or vector[-1] > 0.0:
            raise InputError(
                "materials.gravity", f"it acts along {gravity}", "gravity downwards: compas_dem knows no other"
            )
        return -vector[-1]

    def _group(self, name: str, entries: list[dict[str, Any]]) -> dict[str, Any]:
        """Convert load entries to a group of boundary conditions of COMPAS."""
        gravity = self._gravity()
        points, bodies = [], []
        for number, entry in enumerate(entries):
            if "body" in entry:
                data: dict[str, Any] = {"acceleration": [gravity * v for v in entry["body"]], "loading_type": "ramp"}
                bodies.append(self._object("compas_dem.problem/BodyForce", f"{name} {number}", data))
                continue
            if "face" in entry:
                raise InputError(f"loads of {name!r}", "a pressure has no place in this file", "forces")
            block = int(self._number[entry["element"]])
            moment, force, at = entry.get("moment"), entry.get("force") or [0.0, 0.0, 0.0], entry.get("at")
            loads = [(force, None, at)] if any(force) else []
            if moment is not None and np.any(moment):
                loads.append(([0.0, 0.0, 0.0], moment, None))
            for part, (vector, turning, point) in enumerate(loads):
                data = {
                    "block_index": block,
                    "force": vector,
                    "moment": turning,
                    "point": point,
                    "loading_type": "ramp",
                }
                points.append(self._object("compas_dem.problem/PointLoad", f"{name} {number} {part}", data))
        data = {"name": name, "g": gravity, "body_forces": bodies, "point_loads": points, "surface_loads": []}
        return self._object("compas_dem.problem/BoundaryConditionGroup", name, {**data, "displacements": []})

    def _law(self) -> dict[str, Any]:
        """Return the Mohr–Coulomb law of the dry joints; raise InputError where joints differ."""
        strengths = self._layout.assembly.strengths(_ROUTE)
        dry = self._layout.labels
        if not dry.any():
            return {"name": "MohrCoulomb", "phi": 0.0, "mu": 0.0, "c": None, "t_c": None}
        side = strengths.side(dry=True)
        friction, shear = side.friction[dry], side.shear[dry]
        for strength, values in (("friction", friction), (standard.key_of("dry", "shear"), shear)):
            if np.ptp(values) > 1e-9 * float(np.abs(values).max()):
                raise InputError(f"materials ({strength})", "joints differ in it", "one contact model for all joints")
        mu, c = float(friction[0]), float(shear[0])
        return {"name": "MohrCoulomb", "phi": float(np.degrees(np.arctan(mu))), "mu": mu, "c": c or None, "t_c": None}

    def results(self) -> dict[str, Any]:
        """Return moved blocks, resultant by pair of blocks, at its first contact, and load factor."""
        result = self._layout.result
        if result is None:
            raise ValueError("the layout has no analysis")
        nodes = {self._number[name]: {"transformation": self._moved(k)} for k, (name, _, _) in enumerate(self._solids)}
        edges: dict[str, dict[str, Any]] = {}
        for a, b, points, face in self._faces:
            if result.forces is None:
                break
            axes = self._frame(points, face)
            normal, v1, v2, *_ = self._resultants(face).tolist()
            force = np.array([v1, v2, normal]) @ axes
            edge = edges.setdefault(f"{self._number[a]},{self._number[b]}", {"resultant_global": [0.0, 0.0, 0.0]})
            edge["resultant_global"] = (np.array(edge["resultant_global"]) + force).tolist()
            edge["force_magnitude"] = float(np.linalg.norm(edge["resultant_global"]))
            # a pair with several contacts keeps the first one here; the model holds all of them
            if "contact_data" not in edge:
                contact = self._contact(points, face)
                forces = contact["data"]["forces"]
                corners = {"points": contact["data"]["points"]}
                edge |= {
                    "face_contact": True,
                    "edge_contact": False,
                    "point_contact": False,
                    "contact_points": points.tolist(),
                    "contact_polygon": {"dtype": "compas.geometry/Polygon", "data": corners},
                    "contact_data": contact,
                    "contact_frame": contact["data"]["frame"],
                    "resultant_local": [v1, v2, normal],
                    "force_normal": [entry["c_np"] - entry["c_nn"] for entry in forces],
                    "force_tangent1": [entry["c_u"] for entry in forces],
                    "force_tangent2": [entry["c_v"] for entry in forces],
                }
        low, high = result.bracket
        metadata = {
            "program": "jld",
            "status": str(result.status),
            "load_factor": _number(result.load_factor),
            "bracket": [_number(low), _number(high)],
            "mechanism_scale": self._scale(),
        }
        data = {
            "model_id": self._guid("compas_dem.models/BlockModel", self._name),
            "problem_id": self._guid("compas_dem.problem/Problem", self._name),
            "displacement_scale": 1.0,
            "node_data": nodes,
            "edge_data": edges,
            "metadata": metadata,
        }
        return self._object("compas_dem.problem/Results", self._name, data)

    def _scale(self) -> float:
        result = self._layout.result
        if result is None or result.mechanism is None:
            return 0.0
        return float(quantities.mechanism_scale(self._layout.assembly, result.mechanism))

    def _moved(self, number: int) -> dict[str, Any]:
        """Return the rigid motion of a solid by the scaled mechanism, as a COMPAS transformation."""
        from scipy.spatial.transform import Rotation

        layout, result = self._layout, self._layout.result
        matrix = np.eye(4)
        if result is not None and result.mechanism is not None:
            elements = layout.assembly.elements
            owner = [k for k, parts in enumerate(layout.surfaces) for _ in parts] if not self._cells else []
            members = np.array([number]) if self._cells else layout.members[owner[number]]
            element = int(members[np.argmax(elements.volume[members])])
            centre = elements.centroid[element]
            velocity = displacement(layout.assembly, result.mechanism, element, centre[None])[0]
            spin = result.mechanism[element][layout.assembly.dimension :]
            if layout.assembly.dimension == 2:
                centre, velocity = (np.array([v[0], 0.0, v[1]]) for v in (centre, velocity))
                spin = np.array([0.0, -float(spin[0]), 0.0])
            scale = self._scale()
            turn = Rotation.from_rotvec(scale * spin).as_matrix()
            matrix[:3, :3], matrix[:3, 3] = turn, centre + scale * velocity - turn @ centre
        return {"dtype": "compas.geometry/Transformation", "data": {"matrix": matrix.tolist()}}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
