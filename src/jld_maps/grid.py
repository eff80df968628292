"""Grids of values of a scene: its keys, and how strengths and loads depend on them."""

from __future__ import annotations

import itertools
import math
import pickle
import re
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from jld_core import (
    Assembly,
    Bools,
    Floats,
    InputError,
    ParameterError,
    Route,
    Scene,
    Strengths,
    build_assembly,
    parse_scene,
)
from jld_core.build import build_geometry

MOST: Final = 1_000_000  # points of a grid
ANGLE: Final = "loads.angle"  # degrees by which all live loads are turned, counter-clockwise, in space about z
_JOINED: Final = 20_000  # points up to which axes that act on the same values are built one by one
_ROUTE: Final = Route("maps")
_APART: Final = ("materials", "loads")  # parts of a scene on which its geometry does not depend
_FREE: Final = ("name", "source", "notes", "expected", "units")  # parts on which no answer depends


def points_of(grid: Any) -> dict[str, list[Any]]:
    """Return the values of a grid by key; raise InputError for an empty or too large one."""
    if not isinstance(grid, Mapping) or not grid:
        raise ParameterError("grid", "it names no key", "a dict of keys with the values of each")
    axes = {str(key): one if isinstance(one, list) else np.atleast_1d(one).tolist() for key, one in grid.items()}
    for key, values in axes.items():
        if not values:
            raise ParameterError(key, "it has no values", "one value or more")
    if (count := math.prod(map(len, axes.values()))) > MOST:
        raise ParameterError("grid", f"it has {count} points", f"at most {MOST}")
    return axes


def put(document: dict[str, Any], key: str, value: Any) -> None:
    """Set a key of a scene, such as `loads.live[0].force[1]`; raise InputError for one that cannot be set."""
    if key == ANGLE:
        _turn(document, key, float(value))
        return
    path = parts_of(key)
    _, place, part = place_of(document, key)
    if path[0] in _FREE or isinstance(place.get(part) if isinstance(place, dict) else place[part], dict):
        raise InputError(key, "it is no number that λ depends on", "a key such as materials.dry.friction_coefficient")
    if isinstance(place, dict) and str(part).startswith("friction_"):  # a scene states one of both
        place.pop("friction_angle", None)
        place.pop("friction_coefficient", None)
    place[part] = value


def parts_of(key: str) -> list[Any]:
    return [int(one) if one.isdigit() else one for one in re.findall(r"[^.\[\]]+", key)] or [key]


def place_of(document: Any, key: str) -> tuple[Any, Any, Any]:
    """Return the value of a key in a scene or None, the object that holds it, and its last part; objects are made."""
    place: Any = document
    path = parts_of(key)
    for depth, part in enumerate(path):
        listed = isinstance(place, list)
        if not isinstance(place, list | dict) or listed != isinstance(part, int) or (listed and part >= len(place)):
            has = f"an entry from 0 to {len(place) - 1}" if listed else "a key of the scene"
            raise InputError(key, f"there is no {part} in {'.'.join(map(str, path[:depth])) or 'the scene'}", has)
        if depth < len(path) - 1:
            place = place[part] if isinstance(place, list) else place.setdefault(part, {})
    return place[path[-1]] if isinstance(place, list) else place.get(path[-1]), place, path[-1]


def _turn(document: dict[str, Any], key: str, degrees: float) -> None:
    """Turn all live loads of a scene; raise InputError for loads that are no vectors."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    loads = document.get("loads", {})
    for entry in [one for case in [loads, *loads.get("cases", [])] for one in case.get("live") or []]:
        named = [name for name in ("force", "body") if name in entry]
        if not named or "pressure" in entry or "tilt" in entry:
            raise InputError(key, "a live load has no direction of its own", "live loads with a force or a body load")
        for name in named:
            x, y, *rest = entry[name]
            entry[name] = [c * x - s * y, s * x + c * y, *rest]


@dataclass(frozen=True)
class States:
    """Strengths and loads of every point of a grid, from those of its groups of axes that act on different values."""

    base: tuple[Floats, Floats]  # strengths (s, m), loads (c, 2, n, q)
    # for each group its axes, how many values they have, and strengths and loads that differ with where they do
    groups: list[tuple[list[int], tuple[int, ...], list[tuple[Floats, Bools]]]]

    def at(self, places: Floats) -> tuple[Strengths, Floats]:
        """Return strengths (k·m,) and loads (c, 2, k, n, q) of points given by positions (k, axes) of their values.

        A position between two values gives the state between theirs.
        """
        parts = [np.repeat(one[None], len(places), axis=0) for one in self.base]
        for axes, shape, changes in self.groups:
            low = np.floor(places[:, axes]).astype(np.int64)
            share = (places[:, axes] - low).max(axis=1)
            between = share > 0.0
            high = np.ceil(places[:, axes]).astype(np.int64)
            first, second = (np.ravel_multi_index(tuple(one.T), shape) for one in (low, high[between]))
            for part, (values, where) in zip(parts, changes, strict=True):
                part[:, where] = values[first][:, where]
                own = share[between].reshape(-1, *[1] * (values.ndim - 1))
                mixed = (1.0 - own) * values[first[between]] + own * values[second]
                part[between] = np.where(where, mixed, part[between])
        names = Strengths.__dataclass_fields__
        strengths = Strengths(**{name: parts[0][:, k].ravel() for k, name in enumerate(names)})
        return strengths, np.moveaxis(parts[1], 0, 2)

    def linear(self, axis: int, values: Floats) -> bool:
        """Return True if strengths and loads grow in proportion to the values (k,) of an axis."""
        axes, shape, changes = next(one for one in self.groups if axis in one[0])
        share = (values - values[0]) / (values[-1] - values[0])
        for table, where in changes:
            each = np.moveaxis(table[:, where].reshape(*shape, -1), axes.index(axis), 0)
            line = each[0] + np.multiply.outer(share, each[-1] - each[0])
            if not np.allclose(each, line, rtol=1e-12, atol=1e-12 * abs(np.nan_to_num(each)).max(initial=0.0)):
                return False
        return True


def _state(assembly: Assembly) -> tuple[Floats, Floats]:
    """Return strengths (s, m) and loads (c, 2, n, q)."""
    strengths = assembly.strengths(_ROUTE)
    loads = np.array([[case.dead, case.live] for case in assembly.by_case])
    return np.array([getattr(strengths, name) for name in Strengths.__dataclass_fields__]), loads


def _rest(assembly: Assembly) -> bytes:
    """Return what else than strengths and loads λ depends on, where the geometry is the same."""
    return pickle.dumps((assembly.members, assembly.labels, assembly.required, assembly.cracks))


class Grid:
    """Scenes at the points of a grid.

    document: the scene, as in a file. axes: values by key.
    """

    def __init__(self, scene: Scene, axes: dict[str, list[Any]]) -> None:
        self.document = scene.model_dump(mode="json", exclude_unset=True)
        self.axes = {key: [self._number(key, one) for one in values] for key, values in axes.items()}
        self.shape = tuple(map(len, axes.values()))
        self.middle = np.array([(count - 1) // 2 for count in self.shape])

    def _number(self, key: str, value: Any) -> Any:
        """Return a value as a number in scene units where it is a text with a unit."""
        if not isinstance(value, str):
            return value
        document = deepcopy(self.document)
        put(document, key, value)
        return place_of(parse_scene(document).model_dump(mode="json"), key)[0]

    def scene(self, place: Any) -> Scene:
        """Return the scene at positions (axes,) of values, or between two."""
        changed = deepcopy(self.document)
        values = {key: _value(own, float(k)) for (key, own), k in zip(self.axes.items(), place, strict=True)}
        for key in sorted(values, key=lambda one: one == ANGLE):  # what is turned is stated first
            put(changed, key, values[key])
        return parse_scene(changed)

    @cached_property
    def _geometry(self) -> Any:
        shared = all(key == ANGLE or key.split(".")[0] in _APART for key in self.axes)
        return build_geometry(self.scene(self.middle)) if shared else None

    def assembly(self, place: Any) -> Assembly:
        """Return the structure at positions (axes,) of values."""
        return build_assembly(self.scene(place), self._geometry)

    def states(self) -> States | None:
        """Return strengths and loads at all points; None where more depends on the values.

        Raises InputError for a key on which nothing depends.
        """
        for key in self.axes:
            if key.split(".")[0] in ("search", "move", "design"):
                raise InputError(key, "λ of one layout does not depend on it", "`explore=True` with it, or another key")
        middle = self.assembly(self.middle)
        if self._geometry is None or middle.cracks != "faces" or middle.face_strengths.criteria:
            return None
        base, rest = _state(middle), _rest(middle)
        changed = []
        for axis, (key, count) in enumerate(zip(self.axes, self.shape, strict=True)):
            found = self._along([axis], rest)
            if found is None:
                return None
            changed.append([_differs(one, values) for one, values in zip(base, found, strict=True)])
            if count > 1 and not any(one.any() for one in changed[-1]):
                raise InputError(key, "no load factor depends on it", "a key of strengths, weights, loads or geometry")
        groups: list[list[int]] = []
        for axis in range(len(self.shape)):
            near = [one for one in groups if any(self._acts_together(changed, axis, other) for other in one)]
            groups = [one for one in groups if one not in near] + [sorted([axis, *itertools.chain(*near)])]
        states = []
        for axes in groups:
            shape = tuple(self.shape[axis] for axis in axes)
            found = self._along(axes, rest) if math.prod(shape) <= _JOINED else None
            if found is None:
                return None
            states.append((axes, shape, [(one, _differs(own, one)) for own, one in zip(base, found, strict=True)]))
        return States(base, states)

    def _along(self, axes: list[int], rest: bytes) -> list[Floats] | None:
        """Return strengths and loads at all values of some axes, others at their middle; None where more changes."""
        states = []
        for values in itertools.product(*(range(self.shape[axis]) for axis in axes)):
            place = self.middle.copy()
            place[axes] = values
            assembly = self.assembly(place)
            if _rest(assembly) != rest:
                return None
            states.append(_state(assembly))
        return [np.array(one) for one in zip(*states, strict=True)]

    def _acts_together(self, changed: list[list[Bools]], one: int, two: int) -> bool:
        """Return True if two axes change the same values, both change loads, or stand in one object of the scene."""
        first, second = (changed[k] for k in (one, two))
        keys = list(self.axes)
        beside = keys[one].rpartition(".")[0] == keys[two].rpartition(".")[0] and "inner" in keys[one]
        # of strengths of one material some are refused beside others, where inner faces have friction
        friction = self.document.get("materials", {}).get("inner") or {}
        joined = beside and any("friction" in key for key in (*friction, keys[one], keys[two]))
        return bool((first[0] & second[0]).any() or (first[1].any() and second[1].any()) or joined)


def _value(own: list[Any], place: float) -> Any:
    """Return the value at a position, or between two."""
    low = int(place)
    return own[low] if low == place else (1.0 - place + low) * own[low] + (place - low) * own[low + 1]


def _differs(base: Floats, values: Floats) -> Bools:
    """Return where values (k, ...) differ from a base (...) at any k."""
    return np.asarray(~((values == base) | (np.isnan(values) & np.isnan(base))).all(axis=0))
