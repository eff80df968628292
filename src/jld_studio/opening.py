"""Open a file that is dropped on the page or named by a command: a scene, a drawing or a file of solids."""

from __future__ import annotations

import base64
import binascii
import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from jld_core import InputError
from jld_core.build import build_assembly, build_geometry
from jld_core.exchange import Imported, ImportOptions, Report, import_file
from jld_core.exchange import options as exchange_options
from jld_core.scene import NeedsImport, Scene, cracks, load_scene, parse_scene

LAYERS: Final = (*exchange_options.LAYER_ROLES, "layer")
"""Options of an import that name layers."""
NUMBERS: Final = ("thickness", "tolerance", "facet")
"""Options of an import that are lengths."""
KNOWN: Final = (*LAYERS, *NUMBERS, "unit", "up")
"""Options of an import that the page may state."""
KINDS: Final = ("found", "snapped", "assumed", "skipped", "doubtful")
"""Kinds of sentences of a report, as its attributes."""


@dataclass(frozen=True)
class OpenedFile:
    """Scene of a file, with the report of its import."""

    scene: Scene  # scene of the file, its name that of the file where the file has none
    report: tuple[tuple[str, str], ...]  # what was read in sentences, each after its kind, as "found" or "skipped"
    unit: str = ""  # length unit of the file, in which tolerances are given; "" for a scene file


@contextmanager
def received(name: object, content: object) -> Iterator[Path]:
    """Write a file that the page sends in base64 into a folder, not named by errors, while it is read."""
    if not isinstance(name, str) or not name or len(name) > 200 or not name.isprintable() or set(name) & set("/\\"):
        raise InputError("name", f"it is {str(name)[:60]!r}", "the plain name of a file")
    if not isinstance(content, str):
        raise InputError("content", "it is no text", "the bytes of the file in base64")
    try:
        data = base64.b64decode(content, validate=True)
    except (binascii.Error, ValueError):
        raise InputError("content", "it is not base64", "the bytes of the file in base64") from None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        try:
            yield path
        except InputError as error:
            if error.parameter:
                raise
            where = error.where.replace(f"{folder}/", "")
            raise InputError(where, error.problem.replace(f"{folder}/", ""), error.expected) from None


def require_followed(scene: Scene, where: str) -> Scene:
    """Return a scene; raise InputError if the studio does not support it."""
    if isinstance(scene.cracks, cracks.CellCracks):
        raise InputError(
            f"{where}: cracks", "the studio supports cracks by faces and by fields only", '"faces" or "fields"'
        )
    return scene


def read_file(path: Path, options: ImportOptions) -> OpenedFile:
    """Return the scene of a scene file, drawing or file of solids; raise InputError for none."""
    scene = stated_scene(path)
    if scene is not None:
        entries = [one.model_dump(mode="json", exclude_defaults=True) for one in build_geometry(scene).entries]
        measured = exchange_options.measure(entries)
        supports = exchange_options.several(len(entries) - measured.free, "support")
        counted = f"{exchange_options.several(measured.free, 'element')} and {supports}"
        return OpenedFile(scene, (("found", f"{counted}, {exchange_options.in_words(measured, scene.units.length)}"),))
    found = import_file(path, options)
    said = tuple((kind, on_page(text)) for kind, text in sentences(found.report))
    return OpenedFile(scene_of(found, path), said, found.unit)


def stated_scene(path: Path) -> Scene | None:
    """Return the scene of a scene file, None for a file that is to be imported; raise InputError for a broken scene."""
    if path.suffix.lower() != ".json":
        return None
    try:
        scene = require_followed(load_scene(path), path.name)
        build_assembly(scene)
    except NeedsImport:
        return None
    except InputError as error:
        if path.read_bytes()[:1] == b"[":  # a list of meshes
            return None
        raise (error if error.where.startswith(str(path)) else error.within(path.name)) from None
    return scene


def scene_of(found: Imported, path: Path) -> Scene:
    """Return the scene of an import if it can be built."""
    try:
        scene = parse_scene(found.document, "")
        build_assembly(scene)
    except InputError as error:
        raise found.in_unit_of_file(error, "tolerance").within(path.name) from None
    return require_followed(scene, path.name)


def sentences(report: Report) -> Iterator[tuple[str, str]]:
    """Yield the sentences of the report of an import, each after its kind."""
    yield from ((kind, text) for kind in KINDS for text in getattr(report, kind))


def on_page(text: str) -> str:
    """Return a sentence of an import with the fields of the page in place of flags."""
    return re.sub(r"--([a-z]+)", r'"\1"', text.replace(", or --like SCENE", ""))


def options_of(options: object) -> ImportOptions:
    """Return the options of an import that a request states; raise InputError for others."""
    if not isinstance(options, Mapping):
        raise InputError("options", "they are no JSON object", "an object")
    given: dict[str, Any] = {}
    for key, value in options.items():
        if key not in KNOWN:
            raise InputError(str(key)[:40], "an import has no such option", "one of " + ", ".join(KNOWN))
        if value is None or value == "":
            continue
        if key in NUMBERS:
            if type(value) not in (int, float):
                raise InputError(key, f"{str(value)[:40]!r} is wrong", "a length as a number")
            given[key] = float(value)
        elif key in LAYERS and isinstance(value, list) and all(isinstance(part, str) for part in value):
            given[key] = tuple(value)
        elif not isinstance(value, str):
            raise InputError(key, f"{str(value)[:40]!r} is wrong", "a text")
        else:
            given[key] = (
                value if key in ("unit", "up") else tuple(part.strip() for part in value.split(",") if part.strip())
            )
    return ImportOptions(**given)


def stated(options: ImportOptions) -> dict[str, Any]:
    """Return the options of an import that differ from those of none, as a request states them."""
    given = {key: getattr(options, key) for key in KNOWN}
    return {key: list(value) if key in LAYERS else value for key, value in given.items() if value not in (None, ())}
