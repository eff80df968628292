"""The scene format for editors and for readers: a JSON schema, and tables of all keys."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from jld_core.scene import FillLoad, PointLoad, cracks, design, loads, materials, move, search
from jld_core.scene import materials as fill
from jld_core.scene import part as members
from jld_core.scene import schema as structure
from jld_core.scene.loads import BodyLoad, FaceLoad, TiltLoad
from jld_core.scene.schema import Scene
from jld_core.scene.units import QUANTITIES
from tools.scene_meanings import MEANINGS, Meaning

Node = dict[str, Any]


def json_schema() -> Node:
    """JSON schema (draft 2020-12) of a scene file, with what each key means; editors complete and check by it."""
    schema = Scene.model_json_schema()
    for model in MEANINGS:
        node = schema if model is Scene else schema["$defs"].get(model.__name__)
        if node is None:
            continue
        for key, meaning in _spelled(model).items():
            unit = f" [{meaning.unit}]" if meaning.unit else ""
            node["properties"][key]["description"] = meaning.text.replace("`", '"') + unit
            if key in QUANTITIES:
                _allow_text(node["properties"][key])
    # an editor is told of its schema by this key, which the program does not read
    schema["properties"] = {"$schema": {"type": "string"}, **schema["properties"]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "jld scene"}


def _allow_text(node: Node) -> None:
    """Let the numbers of a value be texts with units as well."""
    if node.get("type") == "number":
        node["type"] = ["number", "string"]
    for inner in (*node.get("anyOf", []), *([node["items"]] if "items" in node else [])):
        _allow_text(inner)


def parts() -> Iterator[tuple[str, type[BaseModel]]]:
    """Every part of a scene once, in order, with the path of the key that holds it."""
    schema = Scene.model_json_schema()
    models = {
        name: model
        for part in (structure, materials, loads, search, cracks, move, members, fill, design)
        for name, model in vars(part).items()
        if isinstance(model, type)
    }
    seen = {"Scene"}
    pending = [("", "Scene")]
    while pending:
        path, name = pending.pop(0)
        yield path, models[name]
        node = schema if name == "Scene" else schema["$defs"][name]
        inside = []
        for key, value in node["properties"].items():
            for found, listed in _references(value):
                if found not in seen:
                    seen.add(found)
                    inside.append((f"{path}.{key}".lstrip(".") + ("[]" if listed else ""), found))
        pending = inside + pending


def key_tables() -> str:
    """Markdown: a table for each part of the scene, one line for each key."""
    schema = Scene.model_json_schema()
    pages = []
    for path, model in parts():
        node = schema if model is Scene else schema["$defs"][model.__name__]
        lines = ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
        for key, value in node["properties"].items():
            meaning = _spelled(model).get(key, Meaning("", "–"))
            default = "required" if key in node.get("required", []) else _default(value)
            kind = _kind(value).replace("|", "\\|")
            lines.append(f"| `{key}` | {kind} | {meaning.unit} | {default} | {meaning.text} |")
        title = f"## `{path}`" if path else "## The scene"
        if model in (PointLoad, BodyLoad, FaceLoad, FillLoad, TiltLoad):
            title += f" with `{node['required'][0]}`"
        pages.append("\n".join([title, "", *lines]))
    return "\n\n".join(pages) + "\n"


def _spelled(model: type[BaseModel]) -> dict[str, Meaning]:
    """Meanings by the key as it is written, which may be no name for a field."""
    fields = model.model_fields
    return {fields[name].alias or name: meaning for name, meaning in MEANINGS.get(model, {}).items()}


def _references(node: Node) -> Iterator[tuple[str, bool]]:
    """Names of parts that a value may hold, and whether in a list."""
    if "$ref" in node:
        yield node["$ref"].rsplit("/", 1)[1], False
    for form in node.get("anyOf", []):
        yield from _references(form)
    if "items" in node:
        yield from ((name, True) for name, _ in _references(node["items"]))


def _default(node: Node) -> str:
    value = node.get("default")
    if value is None or value in ("", [], {}):
        return "–"
    if value == [None, None]:
        return "no limit"
    return "all its own" if isinstance(value, dict) else f"`{json.dumps(value)}`"


def _kind(node: Node) -> str:
    """The type of a value in words."""
    if "$ref" in node:
        return "object"
    if "anyOf" in node:
        return " or ".join(dict.fromkeys(_kind(form) for form in node["anyOf"] if form.get("type") != "null"))
    if "const" in node:
        return f"`{json.dumps(node['const'])}`"
    if "enum" in node:
        return " or ".join(f"`{json.dumps(value)}`" for value in node["enum"])
    if node.get("type") == "array":
        return _list(node)
    word = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false"}
    limits = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    bounds = ", ".join(f"{sign} {node[key]:g}" for key, sign in limits.items() if key in node)
    return f"{word.get(node.get('type', ''), 'object')} {bounds}".strip()


def _list(node: Node) -> str:
    least, most = node.get("minItems"), node.get("maxItems")
    forms = node["items"].get("anyOf", [node["items"]])
    if any(form.get("type") == "null" for form in forms):
        return f"[least, most], each a {_kind(node['items'])} or null"
    size = f"{least} " if least == most and least else f"{least} or {most} " if most else ""
    inner = _kind(node["items"])
    return f"list of {size}({inner})" if " " in inner else f"list of {size}{inner}s"
