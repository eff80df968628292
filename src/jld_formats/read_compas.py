"""Reader of COMPAS JSON: compas_assembly, compas_cra and compas_dem.

The first two hold assemblies, the third a model. COMPAS itself is not needed.
"""

from __future__ import annotations

import json
from pathlib import Path as File
from typing import Any, Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.drawn import MOST
from jld_core.exchange.facts import STORED
from jld_core.exchange.libraries import text_of
from jld_core.exchange.options import ImportOptions, Notes
from jld_core.exchange.solids import Part, Solids
from jld_formats.read_dem import data_of, model_and_problems, problem_facts

FACTS: Final = "jld"
"""Attribute of an assembly written by jld: scene keys that COMPAS cannot represent."""

_UNNAMED: Final = "Block"  # name of a block of compas_dem that was given none

_ELEMENT: Final = ("density", "weight", "volume", "centroid", "block")  # element keys that are read back


def read_compas(path: File, options: ImportOptions, notes: Notes) -> Solids:
    """Read the blocks, supports and interfaces of a COMPAS JSON file.

    notes: receives what was found. Scene keys that jld has stored in the file are read back; stored interfaces replace
    those of the file. Raises InputError where the file is not JSON or holds no assembly.
    """
    try:
        document = json.loads(text_of(path), parse_constant=_refuse)
    except json.JSONDecodeError as error:
        raise InputError("", f"it is not JSON (line {error.lineno}, column {error.colno})", "COMPAS JSON") from None
    except RecursionError:
        raise InputError("", "it is nested too deeply", "COMPAS JSON") from None
    try:
        model, problems = model_and_problems(document)
        data = data_of(model)
        graph = data_of(data["graph"])
        if "elements" in data:
            parts, of_node = _elements(data, graph)
        else:
            parts, of_node = _nodes(graph)
        contacts = list(_contacts(graph, of_node))
        facts = data_of(data.get("attributes") or {}).get(FACTS) or {}
        stated = problem_facts(problems, parts, of_node, notes)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        what = f"{type(error).__name__}: {error}"[:80]
        raise InputError("", f"it is no COMPAS assembly ({what})", "an assembly or a block model") from error
    kind = model.get("dtype", "?") if isinstance(model, dict) else "?"
    notes.found.append(f"{kind} of {len(parts)} blocks")
    name = str(facts.get("name") or (data.get("attributes") or {}).get("name") or data.get("name") or path.stem)
    if facts.get("interfaces"):
        contacts = []
    keys = stated | {key: value for key, value in facts.items() if key in STORED - {"name", "elements", "thickness"}}
    if "materials" in stated and (known := {part.keys["density"] for part in parts if "density" in part.keys}):
        keys["materials"]["density"] = max(known)
    return Solids(parts, contacts, keys, name)


def _refuse(name: str) -> float:
    """Raise InputError for NaN and infinities in the JSON text."""
    raise InputError("", f"it holds the number {name}", "finite numbers only")


def _nodes(graph: dict[str, Any]) -> tuple[list[Part], dict[str, str]]:
    """Read the blocks at the nodes of a graph, and the name of each by node.

    This is the form of compas_assembly and compas_cra. Raises InputError for a node without a block, or too many.
    """
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
    """Return the elements of a model (compas_dem) and their names by node of its graph.

    The name of a block is the one that it states; a stated name that equals the name of its class is ignored.
    """
    node_of = {str(attributes.get("element")): key for key, attributes in graph["node"].items()}
    materials = {guid: data_of(material) for guid, material in (model.get("materials") or {}).items()}
    parts, names = [], {}
    for number, (guid, element) in enumerate(model["elements"].items()):
        data = data_of(element)
        key = node_of.get(guid, str(number))
        stated = str(data.get("name") or "")
        names[key] = stated if stated and stated != _UNNAMED else f"b{key}"
        density = materials.get(str(data.get("material")), {}).get("density")
        keys = {} if density is None else {"density": float(density)}
        move = data.get("transformation")
        matrix = None if move is None else np.array(data_of(move)["matrix"], dtype=float)
        support = bool(data.get("is_support", False))
        parts.append(_part(names[key], key, data_of(data["geometry"]), support, keys, matrix))
    return _unique(parts, names)


def _unique(parts: list[Part], names: dict[str, str]) -> tuple[list[Part], dict[str, str]]:
    """Replace all names by "b" and the node number if any two are equal.

    names: by node number. Returns parts and names.
    """
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
    """Return one block of a COMPAS mesh; matrix: (4, 4) transformation, None for none.

    name: future id. key: node number. keys: further keys of the element. Raises InputError without faces.
    """
    vertex, face = mesh["vertex"], mesh["face"]
    number = {label: k for k, label in enumerate(vertex)}
    points = np.array([[v[axis] for axis in "xyz"] for v in vertex.values()], dtype=float).reshape(-1, 3)
    if matrix is not None:
        points = points @ matrix[:3, :3].T + matrix[:3, 3]
    loops = face.values() if isinstance(face, dict) else face
    faces = tuple(tuple(number[str(index)] for index in loop) for loop in loops)
    if not faces:
        raise InputError(f"node {key}", "its block has no faces", "a closed mesh")
    return Part(name, key, points, faces, support, keys)


def _contacts(graph: dict[str, Any], names: dict[str, str]) -> Any:
    """Yield both element names and the corners (k, 3) of each interface on a graph's edges.

    names: by node. Interfaces with fewer than three corners are left out.
    """
    for u, others in graph.get("edge", {}).items():
        for v, attributes in others.items():
            faces = attributes.get("interfaces") or attributes.get("contacts") or []
            if not faces and attributes.get("interface"):
                faces = [attributes["interface"]]
            for face in faces:
                corners = [p["data"] if isinstance(p, dict) else p for p in data_of(face).get("points") or []]
                if len(corners) > 2:
                    yield names[u], names[v], np.array(corners, dtype=float)
