"""Check the types of what a caller gives, by the annotations of dataclasses."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from difflib import get_close_matches
from functools import cache
from numbers import Integral, Real
from types import NoneType
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

import numpy as np

from jld_core.errors import ParameterError

# What each annotation admits, and its words
_KINDS: Final[dict[Any, tuple[Any, str]]] = {
    bool: ((bool, np.bool_), "True or False"),
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    str: (str, "a text"),
    os.PathLike: ((str, os.PathLike), "the name of a file or folder"),
    Callable: (Callable, "a function"),
    dict: (Mapping, "names with values"),
    NoneType: (NoneType, "None"),
}


def require_kind(parameter: str, value: Any, *kinds: Any) -> None:
    """Raise ParameterError unless a value is of one of the kinds, which are keys of `_KINDS` or classes."""
    if any(_is(value, kind) for kind in kinds):
        return
    expected = " or ".join(_KINDS.get(kind, (kind, f"a {kind.__name__}"))[1] for kind in kinds if kind is not NoneType)
    raise ParameterError(parameter, f"{_shown(value)} is wrong", expected)


def require_field_types(thing: Any) -> None:
    """Raise ParameterError for the first field of a dataclass whose value its annotation excludes.

    Annotations that are none of `_KINDS`, nor words nor classes, admit every value.
    """
    for name, kinds in _kinds_of(thing.__class__).items():
        if kinds:
            require_kind(name, getattr(thing, name), *kinds)


def near(word: str, names: Any) -> str:
    """Return the names as a remedy for an unknown word, or only the one that is most like it where they are many."""
    known = list(names)
    like = [f'"{name}"' for name in get_close_matches(word, known, 1, 0.6)]
    return ", ".join(like + (["one of " + ", ".join(known)] if len(known) < 12 or not like else []))


@cache
def _kinds_of(kind: Any) -> dict[str, tuple[Any, ...]]:
    """Return the kinds that each field admits; an empty tuple where any value may be right."""
    hints = get_type_hints(kind)
    return {one.name: _flat(hints[one.name]) for one in fields(kind)}


def _flat(hint: Any) -> tuple[Any, ...]:
    """Return the alternatives of an annotation; () where one of them is not known here."""
    origin = get_origin(hint)
    if origin in (dict, Mapping):
        return (dict,)
    if origin is Callable or hint is Callable:
        return (Callable,)
    if origin is Literal:
        return (str,)
    if origin is not None and get_args(hint):
        parts = [_flat(part) for part in get_args(hint)]
        return sum(parts, ()) if all(parts) and origin not in (tuple, list, set) else ()
    if isinstance(hint, type) and issubclass(hint, os.PathLike):
        return (os.PathLike,)
    return (hint,) if hint in _KINDS or (isinstance(hint, type) and not getattr(hint, "_is_protocol", False)) else ()


def _is(value: Any, kind: Any) -> bool:
    """Return True if a value is of a kind; truth values are no numbers."""
    if kind in (int, float) and isinstance(value, bool | np.bool_):
        return False
    found: bool = isinstance(value, _KINDS[kind][0] if kind in _KINDS else kind)
    return found


def _shown(value: Any) -> str:
    """Return a value in a few letters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{type(value).__name__!r}"
