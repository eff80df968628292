"""Checks of what a caller gives, by the annotations of dataclasses and functions."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from functools import cache, wraps
from numbers import Integral, Real
from types import NoneType
from typing import Any, Final, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

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
    np.ndarray: ((np.ndarray, list, tuple), "an array"),
}

_MOST: Final = 2**62  # largest whole number, which arrays can hold

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Settings = TypeVar("_Settings")


@dataclass(frozen=True)
class _Sequence:
    """List or tuple whose values are of some kinds."""

    of: tuple[Any, ...]


def setting(default: Any, words: str, **option: Any) -> Any:
    """Return a field of settings: its default, what it means in words, and what limits its option (`min`).

    Help texts and the section Attributes are made of the words, in which another setting is written `name=value`.
    """
    facts = {"words": words, **option}
    return field(default_factory=dict, metadata=facts) if default is dict else field(default=default, metadata=facts)


def documented(kind: type[_Settings]) -> type[_Settings]:
    """Add the section Attributes, made of the fields that `setting` states; a decorator."""
    rows = [f"{f.name} : {f.type}\n    {f.metadata['words']}" for f in fields(kind) if "words" in f.metadata]  # type: ignore[arg-type]
    kind.__doc__ = f"{inspect.cleandoc(kind.__doc__ or '')}\n\nAttributes\n----------\n" + "\n".join(rows)
    return kind


def require_kind(parameter: str, value: Any, *kinds: Any) -> None:
    """Raise ParameterError unless a value is of one of the kinds: keys of `_KINDS`, or classes."""
    if any(_is(value, kind) for kind in kinds):
        return
    raise ParameterError(parameter, f"{shown_value(value)} is wrong", _words(kinds))


def _words(kinds: tuple[Any, ...]) -> str:
    kinds_told = [kind for kind in kinds if kind is not NoneType]
    return " or ".join(
        dict.fromkeys(
            f"a list of values, each {_words(kind.of)}"
            if isinstance(kind, _Sequence)
            else _KINDS.get(kind, (kind, f"a {getattr(kind, '__name__', kind)}"))[1]
            for kind in kinds_told
        )
    )


def typed(function: _Function) -> _Function:
    """Make a function raise ParameterError for an argument that its annotation excludes."""
    signature = inspect.signature(function)

    @wraps(function)
    def checked(*positional: Any, **named: Any) -> Any:
        for name, value in signature.bind(*positional, **named).arguments.items():
            kinds = _kinds_of_arguments(function).get(name)
            if kinds:
                require_kind(name, value, *kinds)
        return function(*positional, **named)

    return cast(_Function, checked)


@cache
def _kinds_of_arguments(function: Callable[..., Any]) -> dict[str, tuple[Any, ...]]:
    kinds, namespace = {}, inspect.unwrap(function).__globals__
    for name, parameter in inspect.signature(function).parameters.items():
        try:
            hint = parameter.annotation
            hint = eval(hint, namespace) if isinstance(hint, str) else hint
        except NameError:  # a type that is imported for the checker of types only
            continue
        if hint is not parameter.empty and parameter.kind not in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
            kinds[name] = _flat(hint)
    return kinds


def require_field_types(thing: Any) -> None:
    """Raise ParameterError for the first field of a dataclass whose value its annotation excludes."""
    for name, kinds in _kinds_of(thing.__class__).items():
        if kinds:
            require_kind(name, getattr(thing, name), *kinds)


def near(word: str, names: Any) -> str:
    """Return the names as a remedy for an unknown word; of many only the one most like it."""
    choices = list(names)
    similar = [f'"{name}"' for name in get_close_matches(word, choices, 1, 0.6)]
    return ", ".join(similar + (["one of " + ", ".join(choices)] if len(choices) < 12 or not similar else []))


@cache
def _kinds_of(kind: Any) -> dict[str, tuple[Any, ...]]:
    """Return the kinds that each field admits; an empty tuple where any value may be right."""
    hints = get_type_hints(kind)
    return {field.name: _flat(hints[field.name]) for field in fields(kind)}


def _flat(hint: Any) -> tuple[Any, ...]:
    """Return the alternatives of an annotation; () where one of them is not known here."""
    origin = get_origin(hint)
    if origin in (dict, Mapping):
        return (dict,)
    if origin is Callable or hint is Callable:
        return (Callable,)
    if origin is Literal:
        return (str,)
    if origin is np.ndarray:
        return (np.ndarray,)
    if origin is not None and get_args(hint):
        parts = [_flat(part) for part in get_args(hint) if part is not Ellipsis]
        if origin in (tuple, list, Sequence):
            return (_Sequence(sum(parts, ())),) if all(parts) else ()
        return sum(parts, ()) if all(parts) and origin is not set else ()
    if isinstance(hint, type) and issubclass(hint, os.PathLike):
        return (os.PathLike,)
    return (hint,) if hint in _KINDS or (isinstance(hint, type) and not getattr(hint, "_is_protocol", False)) else ()


def _is(value: Any, kind: Any) -> bool:
    """Return True if a value is of a kind; truth values are no numbers."""
    if kind in (int, float) and (isinstance(value, bool | np.bool_) or (isinstance(value, int) and abs(value) > _MOST)):
        return False
    if isinstance(kind, _Sequence):
        return isinstance(value, list | tuple | np.ndarray) and all(any(_is(v, k) for k in kind.of) for v in value)
    matches: bool = isinstance(value, _KINDS[kind][0] if kind in _KINDS else kind)
    return matches


def shown_value(value: Any) -> str:
    text = " ".join(repr(value).split())
    if len(text) <= 60 and " at 0x" not in text:
        return text
    return f"{getattr(type(value), '__name__', 'it')!r}"
