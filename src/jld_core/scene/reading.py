"""Reading and validation of scene files, before any computation."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from jld_core.errors import InputError, ParameterError
from jld_core.scene.complaints import first_complaint, plain, shown
from jld_core.scene.schema import Scene
from jld_core.scene.uncertain import lowered
from jld_core.scene.units import with_numbers

DRAWINGS: Final = ("dxf", "svg", "csv", "obj", "ply", "stl", "3dm", "ifc")
"""Endings of files that `jld import` makes a scene of, COMPAS JSON apart."""

_PLAIN: Final = {int, float, str}  # types of JSON that most lists hold


class NeedsImport(InputError):
    """Error for a drawing or a file of solids where a scene is expected; it states the command to import it."""


def load_scene(path: str | Path | Mapping[str, Any]) -> Scene:
    """Read and validate a scene file.

    Parameters
    ----------
    path : str, Path or dict
        JSON file in UTF-8, or its content.

    Returns
    -------
    Scene
        Validated scene, in the file's own units.

    Raises
    ------
    InputError
        The file is missing, is not UTF-8 or not JSON, or has an unknown, missing or wrong key; `NeedsImport` for a
        drawing.
    """
    if isinstance(path, Mapping):
        return parse_scene(dict(path))
    if not isinstance(path, str | Path):
        raise ParameterError("path", f"{type(path).__name__!r} is no scene", "the name of a scene file, or a dict")
    path = Path(path)
    if path.suffix.lower().lstrip(".") in DRAWINGS and path.is_file():
        raise _not_imported(path, "it is a drawing or a file of solids, not a scene")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(str(path), error.strerror or "it cannot be read", "a readable scene file") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "it is not UTF-8 text", "a JSON document in UTF-8") from None
    try:
        document = json.loads(
            text, parse_float=_float, parse_constant=_refuse_constant, object_pairs_hook=_refuse_twins
        )
    except json.JSONDecodeError as error:
        reason = error.msg.removesuffix(" at").lower()
        problem = (
            f"it is not JSON (line {error.lineno}, column {error.colno}: {reason})" if text.strip() else "it is empty"
        )
        raise InputError(str(path), problem, "one JSON object") from None
    except RecursionError:
        raise InputError(str(path), "it is nested too deeply", f"at most {_DEPTH} levels") from None
    except InputError as error:
        raise error.within(str(path)) from None
    except ValueError:  # Python limits the number of digits of an integer
        raise InputError(str(path), "it holds a number of thousands of digits", _NUMBERS) from None
    if isinstance(document, dict) and ("dtype" in document or {"analysis", "problems"} & document.keys()):
        raise _not_imported(path, "it is a file of COMPAS, not a scene")
    return parse_scene(document, str(path))


def _not_imported(path: Path, problem: str) -> NeedsImport:
    """Return the error for a file that has to be imported first."""
    return NeedsImport(str(path), problem, f"a scene: jld import {path} -o {path.stem}_scene.json")


def parse_scene(document: object, file: str = "scene") -> Scene:
    """Validate a scene given as a Python object.

    Parameters
    ----------
    document : object
        Nested dicts and lists as in the scene file; tuples and numpy arrays count as lists, numpy numbers as numbers.
    file : str
        Name used in error messages.

    Returns
    -------
    Scene
        Validated scene.

    Raises
    ------
    InputError
        One line that names the key or element and what is expected.
    """
    if not isinstance(document, Mapping):
        raise InputError(file, f"it holds {shown(document)}", "one JSON object")
    plain_document: dict[str, Any] = _as_json(document)
    try:
        _refuse_extremes(plain_document)
        plain_document.pop("$schema", None)  # only used by editors
        return Scene.model_validate(with_numbers(plain_document))
    except InputError as error:
        raise error.within(file) from None
    except ValidationError as error:
        raise first_complaint(error, Scene).within(file) from None


def _as_json(value: Any, depth: int = 0) -> Any:
    """Return a value with lists in place of arrays and tuples, and plain numbers in place of those of numpy."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if depth > _DEPTH:  # refused afterwards
        return value
    if isinstance(value, Mapping):
        return {key: _as_json(item, depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [item if type(item) in _PLAIN else _as_json(item, depth + 1) for item in value]
    return value


def at_low(scene: Scene) -> Scene:
    """Return the scene with the low value of every material value; raise InputError if there is none."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    low = document | {key: lowered(document[key]) for key in ("materials", "interfaces", "members") if key in document}
    if low == document:
        expected = '{"nominal": …, "low": …} for friction or a strength'
        raise ParameterError("robust", "no material value of the scene has a low one", expected)
    return parse_scene(low, "the scene at its low values")


def _refuse_constant(name: str) -> float:
    """Raise InputError for NaN and infinities in the JSON text."""
    raise InputError("", f"it holds the number {name}", "finite numbers only")


def _float(text: str) -> float:
    """Convert a JSON number; raise InputError for a non-zero number too small for a double."""
    value = float(text)
    if value == 0.0 and text.lower().partition("e")[0].strip("-0."):  # underflow of a non-zero number
        raise InputError("", f"it holds the number {text[:24]}", _NUMBERS)
    return value


def _refuse_twins(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object's pairs as a dict; raise InputError for a repeated key."""
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise InputError(key, "the key is given twice in one object", "each key once")
        result[key] = value
    return result


_DEPTH = 64  # largest depth of nesting of a scene file
_LEAST, _MOST = 1e-30, 1e30  # limits of the magnitude of non-zero numbers
_NUMBERS = f"0 or a magnitude from {_LEAST:g} to {_MOST:g}"  # expected numbers, for error messages


# Path of a value within a scene: the path of what holds it, and its key or index; None for the scene
_Path = tuple[Any, "str | int"] | None


def _refuse_extremes(document: object) -> None:
    """Refuse JSON values that cannot be computed with or written again."""
    # Refused are excessive depth, numbers outside `_LEAST` to `_MOST`, and unpaired surrogates.
    pending: list[tuple[_Path, object, int]] = [(None, document, 0)]
    while pending:
        path, value, depth = pending.pop()
        if depth > _DEPTH:
            place = _words(path)
            place = place if len(place) <= 40 else place[:37] + "..."
            raise InputError(place, "it is nested too deeply", f"at most {_DEPTH} levels")
        if isinstance(value, dict):
            for key in value:
                _refuse_surrogates(path, key)
            pending += [((path, key), inner, depth + 1) for key, inner in value.items()]
        elif isinstance(value, list):
            pending += [((path, index), inner, depth + 1) for index, inner in enumerate(value)]
        elif isinstance(value, str):
            _refuse_surrogates(path, value)
        elif isinstance(value, int | float) and value == value and value and not _LEAST <= abs(value) <= _MOST:
            text = f"{value:g}" if isinstance(value, float) else f"a number of {len(str(abs(value)))} digits"
            raise InputError(_words(path), f"{text} is out of range", _NUMBERS)


def _words(path: _Path) -> str:
    """Return a path within a scene as messages name it: loads.live[0].body."""
    parts: list[str] = []
    while path is not None:
        path, key = path
        parts.append(f"[{key}]" if isinstance(key, int) else f".{plain(str(key))}")
    return "".join(reversed(parts)).lstrip(".")


def _refuse_surrogates(where: _Path, text: object) -> None:
    """Raise InputError for a text with unpaired surrogates."""
    if isinstance(text, str) and any("\ud800" <= letter <= "\udfff" for letter in text):
        raise InputError(_words(where), f"{text!a} contains an unpaired surrogate", "text in UTF-8")
