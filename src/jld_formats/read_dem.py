"""Reader of problems of compas_dem: loads, movements of supports and the contact model."""

from __future__ import annotations

import math
from pathlib import Path as File
from typing import Any, Final

import numpy as np

from jld_core import Floats, InputError, files
from jld_core.geometry import area_vector
from jld_core.scene import standard
from jld_formats.drawn_loads import MOST
from jld_formats.facts import STORED
from jld_formats.libraries import text_of
from jld_formats.options import DEFAULT_MATERIALS, DEFAULT_STRENGTHS, ImportOptions, Notes, several
from jld_formats.solids import Part, Solids

_SHEAR: Final = standard.key_of("dry", "shear")  # key of a joint's resistance without pressure

_GRAVITY: Final = 9.81  # acceleration of a problem that states none, m/s²


def data_of(value: Any) -> dict[str, Any]:
    """Return the data of an object, without its COMPAS envelopes if it has some, those of before COMPAS 1 too."""
    for key in ("value", "data"):
        if isinstance(value, dict) and key in value and ("dtype" in value or "datatype" in value):
            value = value[key]
    if not isinstance(value, dict):
        raise InputError("", "a value is no JSON object where COMPAS expects one", "an assembly or a block model")
    return value


def _is_mesh(value: Any) -> bool:
    return isinstance(value, dict) and {"vertex", "face"} <= data_of(value).keys()


def _as_assembly(document: Any) -> Any:
    """Return lists of meshes, and the files of the first versions of compas_assembly, as an assembly by nodes."""
    meshes = (
        [entry[0] if isinstance(entry, list) and len(entry) == 1 else entry for entry in document if entry]
        if isinstance(document, list)
        else []
    )
    if meshes and all(_is_mesh(one) for one in meshes):
        return {"node": {str(k): {"block": mesh} for k, mesh in enumerate(meshes)}}
    if isinstance(document, dict) and {"assembly", "blocks"} <= document.keys():
        graph, blocks = data_of(document["assembly"]), document["blocks"]
        default = graph.get("node_attributes") or graph.get("dva") or {}
        nodes = graph.get("node") or graph["vertex"]
        node = {key: {**default, **nodes.get(key, {}), "block": mesh} for key, mesh in blocks.items()}
        edge = {
            u: {
                v: {"interfaces": [{"points": one["interface_points"]}]}
                for v, one in others.items()
                if one.get("interface_points")
            }
            for u, others in graph.get("edge", {}).items()
        }
        return {"attributes": graph.get("attributes"), "node": node, "edge": edge}
    return document


def model_and_problems(document: Any) -> tuple[Any, list[dict[str, Any]]]:
    # The document may be an analysis, a list or an object of COMPAS objects by name, or the model itself.
    if isinstance(document, dict) and not {"dtype", "datatype", "data", "node"} & document.keys():
        items = list(document.values())
    else:
        items = document if isinstance(document, list) else [document]
    models, problems = [], []
    for item in items:
        kind = str(item.get("dtype") or item.get("datatype") or "") if isinstance(item, dict) else ""
        if kind.endswith("/Analysis"):
            data = data_of(item)
            models.append(data["model"])
            problems += [data_of(problem) for problem in data.get("problems") or []]
        elif kind.endswith("/Problem"):
            problems.append(data_of(item))
        elif kind.endswith(("Model", "/Assembly")):
            models.append(item)
    if problems and not any(models):
        raise InputError("", "it holds a problem without its model", "an analysis, or the model beside the problem")
    return (models[0] if models else document), problems


def problem_facts(
    problems: list[dict[str, Any]], parts: list[Part], names: dict[str, str], notes: Notes
) -> dict[str, Any]:
    """Return the scene keys of the first problem: loads, materials and settlements."""
    # Each group of boundary conditions is a load case, a group whose name begins with "dead" is dead load.
    if not problems:
        return {}
    problem = problems[0]
    notes.skip("problems", len(problems) - 1, "the first one is read")
    groups = [data_of(group) for group in problem.get("boundary_conditions") or []]
    gravity = {float(group.get("g", _GRAVITY)) for group in groups} or {_GRAVITY}
    if len(gravity) > 1:
        raise InputError(f"problem {problem.get('name')!r}", f"its groups have {len(gravity)} values of g", "one")
    facts: dict[str, Any] = {"materials": {"gravity": gravity.pop(), **_materials(problem, notes)}}
    of_node = {part.group: part for part in parts}
    groups_read = _Groups(of_node, names, facts["materials"]["gravity"])
    loads: dict[str, Any] = {}
    cases = []
    for number, group in enumerate(groups):
        title = str(group.get("name") or f"case {number + 1}")
        entries = groups_read.loads(group)
        if title.casefold().startswith("dead"):
            loads.setdefault("dead", []).extend(entries)
        elif entries:
            cases.append({"name": title, "live": entries})
        moves = groups_read.moves(group)
        if moves:
            facts.setdefault("settlements", []).append({"name": title, "supports": moves})
    if len(cases) == 1:
        loads["live"] = cases[0]["live"]
    elif cases:
        loads["cases"] = cases
    if loads:
        facts["loads"] = loads
    count = sum(len(case["live"]) for case in cases) + len(loads.get("dead", []))
    remark = f"{several(count, 'load')} in {several(len(cases), 'case')}"
    notes.found.append(f"problem {problem.get('name') or '(no name)'}: {remark}")
    return facts


def _materials(problem: dict[str, Any], notes: Notes) -> dict[str, Any]:
    """Read the scene's materials "dry" and "inner" from the contact model of a problem."""
    # Without a contact model they are defaults; assumptions are added to `notes`.
    contact = data_of(problem.get("contact_properties") or {})
    law = contact.get("contact_model")
    if not law:
        notes.assumed.append(f"friction 0.6, {DEFAULT_STRENGTHS}: the problem has no contact model")
        return {key: DEFAULT_MATERIALS[key] for key in ("dry", "inner")}
    kind, values = str(law.get("dtype", "")), data_of(law)
    if not kind.endswith("MohrCoulomb"):
        raise InputError("contact model", f"it is {kind.rpartition('/')[2]}", "MohrCoulomb")
    dry: dict[str, Any] = {"friction_coefficient": float(values["mu"])}
    if values.get("c"):
        dry[_SHEAR] = float(values["c"])
    if values.get("t_c"):
        apex = dry.get(_SHEAR, 0.0) / dry["friction_coefficient"] if dry["friction_coefficient"] else math.inf
        dry["tensile_strength"] = min(float(values["t_c"]), apex)
        if apex < float(values["t_c"]):
            notes.assumed.append(f"tensile strength {apex:g} of joints for t_c {values['t_c']:g}: the apex of friction")
    if contact.get("joint_model"):
        notes.skip("joint model", 1, "limit analysis knows no stiffness")
    notes.assumed.append(f"{DEFAULT_STRENGTHS}: edit materials, or --like SCENE")
    inner = DEFAULT_MATERIALS["inner"]
    # blocks are at least as strong as their joints
    inner = {**inner, "tensile_strength": max(inner["tensile_strength"], dry.get("tensile_strength", 0.0))}
    return {"dry": dry, "inner": inner}


class _Groups:
    """Conversion of groups of boundary conditions to loads and movements of a scene.

    parts, names: blocks, and their names, by node of the graph. gravity: m/s².
    """

    def __init__(self, parts: dict[str, Part], names: dict[str, str], gravity: float) -> None:
        self._parts, self._names, self._gravity = parts, names, gravity

    def _node(self, entry: dict[str, Any], where: str) -> str:
        """Return the node that an entry acts on; raise InputError where no block is there."""
        node = str(entry["block_index"])
        if node not in self._parts:
            raise InputError(where, f"it acts on block {node}, which is not there", "a node of the model")
        return node

    def loads(self, group: dict[str, Any]) -> list[dict[str, Any]]:
        """Convert point, body and surface loads of a group to load entries of a scene."""
        entries: list[dict[str, Any]] = []
        for item in group.get("point_loads") or []:
            load = data_of(item)
            entry: dict[str, Any] = {"element": self._names[self._node(load, "point load")]}
            if any(load["force"]):
                entry["force"] = _vector(load["force"])
            if load.get("point") is not None:
                entry["at"] = _vector(load["point"])
            if load.get("moment") is not None:
                entry["moment"] = _vector(load["moment"])
            if len(entry) > 1:
                entries.append(entry)
        for item in group.get("body_forces") or []:
            if not self._gravity:
                raise InputError("body force", "the problem has no gravity", "g above 0")
            entries.append({"body": [value / self._gravity for value in _vector(data_of(item)["acceleration"])]})
        for item in group.get("surface_loads") or []:
            load = data_of(item)
            part = self._parts[self._node(load, "surface load")]
            if not 0 <= int(load["face_index"]) < len(part.faces):
                raise InputError("surface load", f"block {part.name!r} has no face {load['face_index']}", "its faces")
            corners = part.vertices[list(part.faces[int(load["face_index"])])]
            # the area of a plane polygon (k, 3) and its centroid
            first = corners[0]
            area_normal = area_vector(corners)
            size = float(np.linalg.norm(area_normal))
            parts = 0.5 * np.cross(corners[1:-1] - first, corners[2:] - first) @ (area_normal / size)
            centres = (first + corners[1:-1] + corners[2:]) / 3.0
            area, middle = float(parts.sum()), (parts @ centres / parts.sum()).tolist()
            force = [area * value for value in _vector(load["load"])]
            entries.append({"element": part.name, "force": force, "at": middle})
        return entries

    def moves(self, group: dict[str, Any]) -> list[dict[str, Any]]:
        """Return the movements of supports of a group; raise InputError for one of a free block."""
        moves = []
        for item in group.get("displacements") or []:
            entry = data_of(item)
            part = self._parts[self._node(entry, "displacement")]
            if not part.support:
                raise InputError("displacement", f"block {part.name!r} is no support", "displacements of supports")
            if "translation" in entry:
                moves.append({"elements": part.name, "move": [float(value or 0.0) for value in entry["translation"]]})
            else:
                moves.append({"elements": part.name, "move": [0.0, 0.0, 0.0], "turn": _vector(entry["rotation"])})
        return moves


def _vector(values: Any) -> list[float]:
    """Convert three numbers to floats; raise an error for any other count."""
    x, y, z = (float(value) for value in values)
    return [x, y, z]


FACTS: Final = "jld"
"""Attribute of an assembly written by jld: scene keys that COMPAS cannot represent."""

_UNNAMED: Final = ("Block", "BlockElement")  # names of blocks of compas_dem that were given none

_ELEMENT: Final = ("density", "weight", "volume", "centroid", "block")  # element keys that are read back


def read_compas(path: File, options: ImportOptions, notes: Notes) -> Solids:
    try:
        document = files.json_of(text_of(path), parse_constant=_refuse)
    except InputError:
        raise
    except ValueError as error:
        raise InputError("", str(error), "COMPAS JSON") from None
    return solids_of(document, path.stem, notes)


def solids_of(document: Any, title: str, notes: Notes) -> Solids:
    """Return the blocks, supports, interfaces and the first problem of a COMPAS document; title: name without another.

    Raises InputError for a document that holds no assembly.
    """
    try:
        document = _as_assembly(document)
        model, problems = model_and_problems(document)
        data = data_of(model)
        graph = data if "node" in data else data_of(data["graph"])
        if "elements" in data:
            parts, of_node = _elements(data, graph)
        else:
            parts, of_node = _nodes(graph)
        contacts = list(_contacts(graph, of_node))
        facts = data_of(data.get("attributes") or {}).get(FACTS) or {}
        of_problem = problem_facts(problems, parts, of_node, notes)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        expected = "an assembly of blocks, a block model, or a list of meshes"
        raise InputError(
            "", "it is no COMPAS assembly: something of its blocks is missing or of another form", expected
        ) from error
    kind = model.get("dtype", "?") if isinstance(model, dict) else "?"
    notes.found.append(f"{kind} of {len(parts)} blocks")
    name = str(facts.get("name") or (data.get("attributes") or {}).get("name") or data.get("name") or title)
    if facts.get("interfaces"):
        contacts = []
    keys = of_problem | {
        key: value for key, value in facts.items() if key in STORED - {"name", "elements", "thickness"}
    }
    if "materials" in of_problem and (densities := {part.keys["density"] for part in parts if "density" in part.keys}):
        keys["materials"]["density"] = max(densities)
    return Solids(parts, contacts, keys, name)


def _refuse(name: str) -> float:
    """Raise InputError for NaN and infinities in the JSON text."""
    raise InputError("", f"it holds the number {name}", "finite numbers only")


def _nodes(graph: dict[str, Any]) -> tuple[list[Part], dict[str, str]]:
    # compas_assembly and compas_cra write blocks in this form.
    default = bool((graph.get("default_node_attributes") or {}).get("is_support", False))
    parts, names = [], {}
    nodes = graph["node"].items()
    if len(nodes) > MOST:
        raise InputError("", f"it has {len(nodes)} blocks", f"at most {MOST}")
    for key, attributes in sorted(nodes, key=lambda item: (len(item[0]), item[0])):
        block = attributes["block"]
        if block is None:
            raise InputError(f"node {key}", "it holds no block", "a mesh at every node")
        names[key] = str(attributes.get("name") or data_of(block).get("attributes", {}).get("name") or f"b{key}")
        support = bool(attributes.get("is_support", default))
        keys = {name: attributes[name] for name in _ELEMENT if attributes.get(name) is not None and name != "block"}
        if attributes.get("block_name"):
            keys["block"] = str(attributes["block_name"])
        parts.append(_part(names[key], key, data_of(block), support, keys, None))
    return _unique(parts, names)


def _elements(model: dict[str, Any], graph: dict[str, Any]) -> tuple[list[Part], dict[str, str]]:
    """Return the elements of a model (compas_dem) and their names by node of its graph."""
    # The name of a block is the one that it states; a stated name that equals the name of its class is ignored.
    node_of = {str(attributes.get("element")): key for key, attributes in graph["node"].items()}
    materials = {guid: data_of(material) for guid, material in _by_guid(model.get("materials") or {})}
    of_element = model.get("element_material") or {}
    parts, names = [], {}
    for number, (guid, element) in enumerate(_by_guid(model["elements"])):
        data = data_of(element)
        key = node_of.get(guid, str(number))
        name = str(data.get("name") or "")
        names[key] = name if name and name not in _UNNAMED else f"b{key}"
        density = materials.get(str(data.get("material") or of_element.get(guid)), {}).get("density")
        keys = {} if density is None else {"density": float(density)}
        move = data.get("transformation")
        matrix = None if move is None else np.array(data_of(move)["matrix"], dtype=float)
        support = bool(data.get("is_support", False))
        parts.append(_part(names[key], key, data_of(data.get("geometry") or data["shape"]), support, keys, matrix))
    return _unique(parts, names)


def _by_guid(entries: Any) -> list[tuple[str, Any]]:
    """Return entries with their identities; older files list them."""
    if isinstance(entries, dict):
        return list(entries.items())
    return [(str(entry.get("guid", k)), entry) for k, entry in enumerate(entries)]


def _unique(parts: list[Part], names: dict[str, str]) -> tuple[list[Part], dict[str, str]]:
    """Replace all names by "b" and the node number if any two are equal."""
    if len({part.name for part in parts}) == len(parts):
        return parts, names
    # repeated names identify nothing
    numbered = {key: f"b{key}" for key in names}
    return [
        Part(numbered[part.group], part.group, part.vertices, part.faces, part.support, part.keys) for part in parts
    ], numbered


def _part(
    name: str, key: str, mesh: dict[str, Any], support: bool, keys: dict[str, Any], matrix: Floats | None
) -> Part:
    """Return one block of a COMPAS mesh; matrix: (4, 4) transformation, None for none."""
    vertex, face = mesh["vertex"], mesh["face"]
    number = {label: k for k, label in enumerate(vertex)}
    points = np.array([[v[axis] for axis in "xyz"] for v in vertex.values()], dtype=float).reshape(-1, 3)
    if matrix is not None:
        points = points @ matrix[:3, :3].T + matrix[:3, 3]
    loops = face.values() if isinstance(face, dict) else face
    # files of the first versions store faces as half-edges: the next corner of each
    rings = (_ring(loop) if isinstance(loop, dict) else loop for loop in loops)
    faces = tuple(tuple(number[str(index)] for index in loop) for loop in rings)
    if not faces:
        raise InputError(f"node {key}", "its block has no faces", "a closed mesh")
    return Part(name, key, points, faces, support, keys)


def _ring(following: dict[str, str]) -> list[str]:
    """Return the corners of a face from the next corner of each; raise an error where they are no ring."""
    first = next(iter(following))
    ring = [first]
    while (corner := following[ring[-1]]) != first:
        if len(ring) > len(following):
            raise ValueError
        ring.append(corner)
    return ring


def _contacts(graph: dict[str, Any], names: dict[str, str]) -> Any:
    """Yield both element names and the corners (k, 3) of each interface on a graph's edges."""
    for u, others in graph.get("edge", {}).items():
        for v, attributes in others.items():
            faces = attributes.get("interfaces") or attributes.get("contacts") or []
            if not faces and attributes.get("interface"):
                faces = [attributes["interface"]]
            for face in faces:
                corners = [p["data"] if isinstance(p, dict) else p for p in data_of(face).get("points") or []]
                if len(corners) > 2:
                    yield names[u], names[v], np.array(corners, dtype=float)
