"""Write the contract of a page into contract.js: its types for the type checker, and the keys that must be there.

`python -m tools.page_contract` writes the part of the file between two marks. A test fails where it is not current.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from jld_views.page_contract import FORMAT, VERSION, page_schema

FILE: Final = Path(__file__).parents[1] / "src" / "jld_views" / "assets" / "contract.js"
"""File of the page that holds the contract."""
BEGIN: Final = "// Generated from page_contract.py by `python -m tools.page_contract`; do not edit."
END: Final = "// End of what is generated."

_NAMES: Final = {"string": "string", "number": "number", "integer": "number", "boolean": "boolean", "null": "null"}


def type_of(part: dict[str, Any]) -> str:
    """Return the type of a part of a JSON schema as JSDoc writes it."""
    if "$ref" in part:
        return str(part["$ref"]).rsplit("/", 1)[-1]
    if "const" in part or "enum" in part:
        return " | ".join(json.dumps(value) for value in part.get("enum", [part.get("const")]))
    if "anyOf" in part:
        return " | ".join(type_of(one) for one in part["anyOf"])
    if part["type"] == "array":
        item = type_of(part["items"])
        if part.get("minItems") == part.get("maxItems") == 2:
            return f"[{item}, {item}]"
        return f"({item})[]" if " " in item else f"{item}[]"
    if part["type"] == "object":
        values = part.get("additionalProperties", True)
        return f"Record<string, {type_of(values) if isinstance(values, dict) else 'unknown'}>"
    return _NAMES[part["type"]]


def text() -> str:
    """Return the generated part of contract.js, with its marks."""
    schema = page_schema()
    parts = {**schema["$defs"], "PageData": schema}
    lines = [BEGIN, "", f"export const FORMAT = {json.dumps(FORMAT)};", f"export const VERSION = {VERSION};", ""]
    for name, part in parts.items():
        if "properties" not in part:
            lines += [f"/** @typedef {{{type_of(part)}}} {name} */", ""]
            continue
        words = f" {part['description']}" if "description" in part else ""
        lines += ["/**", f" * @typedef {{object}} {name}{words}"]
        for key, value in part["properties"].items():
            meaning = f" {value['description']}" if "description" in value else ""
            lines.append(f" * @property {{{type_of(value)}}} {key}{meaning}")
        lines += [" */", ""]
    lines += [
        "/** Keys that each object must have, by the name of its type. */",
        "export const REQUIRED = Object.freeze({",
    ]
    lines += [f"  {name}: {json.dumps(part['required'])}," for name, part in parts.items() if "required" in part]
    return "\n".join([*lines, "});", "", END])


def joined(content: str) -> str:
    """Return the content of contract.js with its generated part made anew."""
    before, rest = content.split(BEGIN)
    return before + text() + rest.split(END)[1]


if __name__ == "__main__":
    FILE.write_text(joined(FILE.read_text(encoding="utf-8")), encoding="utf-8")
