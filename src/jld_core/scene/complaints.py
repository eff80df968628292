"""Conversion of pydantic errors to one-line messages: key, problem, expected value."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from jld_core.errors import InputError

# Expected values in words, by type of pydantic error
_EXPECTED = {
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": "a text",
    "float_type": "a number",
    "int_type": "a whole number",
    "list_type": "a list",
    "dict_type": "an object",
    "model_type": "an object",
}


def first_complaint(error: ValidationError, model: type[BaseModel], known: Iterable[str] = ()) -> InputError:
    """Return the most informative of pydantic's errors as an InputError with its key path."""
    complaints = error.errors(include_url=False)

    def weight(candidate: ErrorDetails) -> tuple[int, bool, bool]:
        """Return the sort key of an error: path length, unknown key, content before type."""
        kind = candidate["type"]
        return len(_keys(candidate)), kind == "extra_forbidden", not _is_of_form(kind)

    complaint = max(complaints, key=weight)
    keys, kind, context = _keys(complaint), complaint["type"], complaint.get("ctx", {})
    where = "".join(f"[{key}]" if isinstance(key, int) else f".{plain(key)}" for key in keys).lstrip(".")
    if kind == "value_error" and isinstance(cause := context["error"], InputError):
        return InputError((where + cause.where).lstrip("."), cause.problem, cause.expected)
    owner = _owner(model, keys)
    field = _fields_by_key(owner).get(str(keys[-1])) if keys else None
    meaning = field.description if field is not None else None
    if kind == "extra_forbidden":
        names = [*(known if owner is model else ()), *_fields_by_key(owner)]
        names = list(dict.fromkeys(names))
        near = get_close_matches(str(keys[-1]), names, 1)
        all_names = ", ".join(names)
        expected = f'"{near[0]}", or another of {all_names}' if near else f"one of {all_names}"
        return InputError(where, "unknown key", expected)
    if kind == "missing":
        return InputError(where, "missing", meaning or "this key to be given")
    value = complaint.get("input")
    if meaning and _is_of_form(kind):
        return InputError(where, f"{shown(value)} is wrong", meaning)
    if kind in ("too_short", "too_long", "string_too_short"):
        too_few = kind != "too_long"
        size = f"at least {context['min_length']}" if too_few else f"at most {context['max_length']}"
        number = len(value) if isinstance(value, list | str) else 0
        plural, singular = ("letters", "letter") if kind.startswith("string") else ("entries", "entry")
        noun = singular if number == 1 else plural
        return InputError(where, f"it has {number} {noun}", size + (f": {meaning}" if meaning else ""))
    # a value of a form that is allowed, but out of its bounds, is told the bounds, not the other forms
    forms = [c for c in complaints if _keys(c) == keys and _is_of_form(c["type"])] if _is_of_form(kind) else [complaint]
    expected = " or ".join(dict.fromkeys(_expected_in_words(c) for c in forms))
    return InputError(where, f"{shown(value)} is wrong", expected)


def _is_of_form(kind: str) -> bool:
    """Return True if an error says that a value has the wrong type or is no allowed literal."""
    return kind.endswith("_type") or kind == "literal_error"


def _expected_in_words(complaint: ErrorDetails) -> str:
    """Return in words which value pydantic expected in place of a wrong one."""
    kind, context = complaint["type"], complaint.get("ctx", {})
    bounds = {
        "greater_than": ("a number above", "gt"),
        "greater_than_equal": ("a number of at least", "ge"),
        "less_than": ("a number below", "lt"),
        "less_than_equal": ("a number of at most", "le"),
    }
    if kind in bounds:
        words, bound = bounds[kind]
        return f"{words} {context[bound]:g}"
    if kind == "literal_error":
        return str(context["expected"]).replace("'", '"')
    return _EXPECTED.get(kind) or complaint["msg"]


def _keys(complaint: ErrorDetails) -> list[int | str]:
    """Return the key path of a pydantic error, without the names of alternative types in it."""
    forms = re.compile(r"[\[\(]|^(constrained-)?(float|str|int|bool|list|dict)$")
    loc = complaint["loc"]
    last = len(loc) - 1 if complaint["type"] == "extra_forbidden" else len(loc)
    # an unknown key may have any name, also that of a form
    return [key for n, key in enumerate(loc) if n == last or isinstance(key, int) or not forms.search(key)]


def _owner(model: type[BaseModel], keys: list[int | str]) -> type[BaseModel]:
    """Return the model that has the last key of a key path as its field."""
    for key in keys[:-1]:
        if isinstance(key, str) and key in model.model_fields:
            model = _model_in(model.model_fields[key].annotation) or model
    return model


def _fields_by_key(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a model by the keys that a scene file uses for them."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """Return the first pydantic model within a type annotation, or None."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    models = (_model_in(argument) for argument in get_args(annotation))
    return next((argument for argument in models if argument is not None), None)


def plain(key: str) -> str:
    """Return a key of a scene file for a message, quoted unless it is an identifier."""
    return key if key.isidentifier() else shown(key)


def shown(value: object) -> str:
    """Return a value as JSON text for a message, cut to 40 characters."""
    text = json.dumps(value, default=lambda item: type(item).__name__, skipkeys=True)
    return text if len(text) <= 40 else text[:37] + "..."
