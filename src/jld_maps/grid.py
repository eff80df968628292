"""Grids of values of a scene: its keys, how strengths and loads depend on them, borders between mechanisms."""

from __future__ import annotations

import itertools
import math
import pickle
import re
import shutil
import tempfile
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from jld_core import (
    FACTS,
    Assembly,
    Bits,
    Bools,
    Floats,
    InputError,
    Model,
    ParameterError,
    Route,
    Scene,
    Status,
    Strengths,
    build_assembly,
    load_scene,
    one_thread,
    parse_scene,
    solve,
)
from jld_core import assembly as assemblies
from jld_core.build import build_geometry
from jld_core.limit import CaseBounds, SampleAnalysis, face_jumps, governing, movements
from jld_core.mechanics import equilibrium_matrix, require_materials
from jld_core.models import CaseAnalysis, limit_analysis
from jld_explore import explore as search

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
    axes = {
        str(key): value if isinstance(value, list) else np.atleast_1d(value).tolist() for key, value in grid.items()
    }
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
    current, container, part = place_of(document, key)
    # a number may take the place of one with a distribution, or with a nominal and a low value
    if path[0] in _FREE or (isinstance(current, dict) and current.keys().isdisjoint(("mean", "nominal"))):
        raise InputError(key, "it is no number that λ depends on", "a key such as materials.dry.friction_coefficient")
    if isinstance(container, dict) and str(part).startswith("friction_"):  # a scene states one of both
        container.pop("friction_angle", None)
        container.pop("friction_coefficient", None)
    container[part] = value


def parts_of(key: str) -> list[Any]:
    return [int(part) if part.isdigit() else part for part in re.findall(r"[^.\[\]]+", key)] or [key]


def place_of(document: Any, key: str) -> tuple[Any, Any, Any]:
    """Return the value of a key in a scene or None, the object that holds it, and its last part; objects are made."""
    container: Any = document
    path = parts_of(key)
    for depth, part in enumerate(path):
        listed = isinstance(container, list)
        if (
            not isinstance(container, list | dict)
            or listed != isinstance(part, int)
            or (listed and part >= len(container))
        ):
            has = f"an entry from 0 to {len(container) - 1}" if listed else "a key of the scene"
            raise InputError(key, f"there is no {part} in {'.'.join(map(str, path[:depth])) or 'the scene'}", has)
        if depth < len(path) - 1:
            container = container[part] if isinstance(container, list) else container.setdefault(part, {})
    return container[path[-1]] if isinstance(container, list) else container.get(path[-1]), container, path[-1]


def _turn(document: dict[str, Any], key: str, degrees: float) -> None:
    """Turn all live loads of a scene; raise InputError for loads that are no vectors."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    loads = document.get("loads", {})
    for load in [entry for case in [loads, *loads.get("cases", [])] for entry in case.get("live") or []]:
        keys = [name for name in ("force", "body") if name in load]
        if not keys or "pressure" in load or "tilt" in load:
            raise InputError(key, "a live load has no direction of its own", "live loads with a force or a body load")
        for name in keys:
            x, y, *others = load[name]
            load[name] = [c * x - s * y, s * x + c * y, *others]


@dataclass(frozen=True)
class States:
    """Strengths and loads of every point of a grid, from those of its groups of axes that act on different values."""

    base: tuple[Floats, Floats]  # strengths (s, m), loads (c, 2, n, q)
    # for each group its axes, how many values they have, and strengths and loads that differ with where they do
    groups: list[tuple[list[int], tuple[int, ...], list[tuple[Floats, Bools]]]]

    def at(self, indices: Floats) -> tuple[Strengths, Floats]:
        """Return strengths (k·m,) and loads (c, 2, k, n, q) of points given by positions (k, axes) of their values.

        A position between two values gives the state between theirs.
        """
        parts = [np.repeat(array[None], len(indices), axis=0) for array in self.base]
        for axes, shape, changes in self.groups:
            low = np.floor(indices[:, axes]).astype(np.int64)
            share = (indices[:, axes] - low).max(axis=1)
            between = share > 0.0
            high = np.ceil(indices[:, axes]).astype(np.int64)
            first, second = (np.ravel_multi_index(tuple(array.T), shape) for array in (low, high[between]))
            for part, (values, where) in zip(parts, changes, strict=True):
                part[:, where] = values[first][:, where]
                share_of_state = share[between].reshape(-1, *[1] * (values.ndim - 1))
                mixed = (1.0 - share_of_state) * values[first[between]] + share_of_state * values[second]
                part[between] = np.where(where, mixed, part[between])
        names = Strengths.__dataclass_fields__
        strengths = Strengths(**{name: parts[0][:, k].ravel() for k, name in enumerate(names)})
        return strengths, np.moveaxis(parts[1], 0, 2)

    def linear(self, axis: int, values: Floats) -> bool:
        """Return True if strengths and loads grow in proportion to the values (k,) of an axis."""
        axes, shape, changes = next(group for group in self.groups if axis in group[0])
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
        self.axes = {key: [self._number(key, value) for value in values] for key, values in axes.items()}
        self.shape = tuple(map(len, axes.values()))
        self.middle = np.array([(count - 1) // 2 for count in self.shape])

    def _number(self, key: str, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        document = deepcopy(self.document)
        put(document, key, value)
        return place_of(parse_scene(document).model_dump(mode="json"), key)[0]

    def scene(self, indices: Any) -> Scene:
        """Return the scene at positions (axes,) of values, or between two."""
        changed = deepcopy(self.document)
        values = {
            key: _value(axis_values, float(k)) for (key, axis_values), k in zip(self.axes.items(), indices, strict=True)
        }
        for key in sorted(values, key=lambda value: value == ANGLE):  # what is turned is stated first
            put(changed, key, values[key])
        return parse_scene(changed)

    @cached_property
    def _geometry(self) -> Any:
        shared = all(key == ANGLE or key.split(".")[0] in _APART for key in self.axes)
        return build_geometry(self.scene(self.middle)) if shared else None

    def assembly(self, indices: Any) -> Assembly:
        """Return the structure at positions (axes,) of values."""
        return build_assembly(self.scene(indices), self._geometry)

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
        base, other_keys = _state(middle), _rest(middle)
        changed = []
        for axis, (key, count) in enumerate(zip(self.axes, self.shape, strict=True)):
            along = self._along([axis], other_keys)
            if along is None:
                return None
            changed.append([_differs(array, values) for array, values in zip(base, along, strict=True)])
            if count > 1 and not any(array.any() for array in changed[-1]):
                raise InputError(key, "no load factor depends on it", "a key of strengths, weights, loads or geometry")
        groups: list[list[int]] = []
        for axis in range(len(self.shape)):
            near = [group for group in groups if any(self._acts_together(changed, axis, other) for other in group)]
            groups = [group for group in groups if group not in near] + [sorted([axis, *itertools.chain(*near)])]
        states = []
        for axes in groups:
            shape = tuple(self.shape[axis] for axis in axes)
            along = self._along(axes, other_keys) if math.prod(shape) <= _JOINED else None
            if along is None:
                return None
            differing = [(values, _differs(array, values)) for array, values in zip(base, along, strict=True)]
            states.append((axes, shape, differing))
        return States(base, states)

    def _along(self, axes: list[int], other_keys: bytes) -> list[Floats] | None:
        """Return strengths and loads at all values of some axes, others at their middle; None where more changes."""
        states = []
        for values in itertools.product(*(range(self.shape[axis]) for axis in axes)):
            indices = self.middle.copy()
            indices[axes] = values
            assembly = self.assembly(indices)
            if _rest(assembly) != other_keys:
                return None
            states.append(_state(assembly))
        return [np.array(array) for array in zip(*states, strict=True)]

    def _acts_together(self, changed: list[list[Bools]], axis: int, other: int) -> bool:
        """Return True if two axes change the same values, both change loads, or stand in one object of the scene."""
        first, second = (changed[k] for k in (axis, other))
        keys = list(self.axes)
        beside = keys[axis].rpartition(".")[0] == keys[other].rpartition(".")[0] and "inner" in keys[axis]
        # of strengths of one material some are refused beside others, where inner faces have friction
        friction = self.document.get("materials", {}).get("inner") or {}
        joined = beside and any("friction" in key for key in (*friction, keys[axis], keys[other]))
        return bool((first[0] & second[0]).any() or (first[1].any() and second[1].any()) or joined)


def _value(axis_values: list[Any], index: float) -> Any:
    """Return the value at an index, interpolated between two values."""
    low = int(index)
    return (
        axis_values[low]
        if low == index
        else (1.0 - index + low) * axis_values[low] + (index - low) * axis_values[low + 1]
    )


def _differs(base: Floats, values: Floats) -> Bools:
    return np.asarray(~((values == base) | (np.isnan(values) & np.isnan(base))).all(axis=0))


_WORDS: Final = ("sliding at the base", "sliding", "rocking", "hinges", "twisting", "inner shear", "inner opening")


def mechanism_names(assembly: Assembly, labels: Bits, kinds: Any) -> Any:
    """Name k mechanisms by the kinds (k, m) of movement of their faces."""
    # Sliding is "at the base" where all faces that slide touch a support. Hinges are "rocking" where there is one, or
    # all touch supports. Several parts are joined by "and"; a mechanism in which joints only open is "opening".
    faces, support = assembly.interfaces, assembly.elements.support
    is_face = np.arange(len(labels)) < assembly.faces
    base = (support[faces.a] | support[faces.b]) & is_face

    def found(kind: str, where: Any = is_face) -> Any:
        return (kinds == kind) & where

    slides, hinges = found("slide"), found("hinge")
    elsewhere, turns = (slides & ~base).any(axis=1), hinges.any(axis=1)
    rocks = turns & ((hinges.sum(axis=1) == 1) | ~(hinges & ~base).any(axis=1))
    flags = np.column_stack([
        slides.any(axis=1) & ~elsewhere, elsewhere, rocks, turns & ~rocks,
        *(found(kind).any(axis=1) for kind in ("twist", "crack in shear", "crack in tension")),
        found("open").any(axis=1),
    ])  # fmt: skip
    patterns, each = np.unique(flags, axis=0, return_inverse=True)
    return np.array([_name(row) for row in patterns.tolist()], dtype=object)[each.ravel()]


def _name(flags: list[bool]) -> str:
    parts = [word for word, flag in zip(_WORDS, flags, strict=False) if flag] or (["opening"] if flags[-1] else [])
    return " and ".join(filter(None, [", ".join(parts[:-1]), *parts[-1:]]))


_SWEEP_ROUTE: Final = Route("maps", frozenset(FACTS))
_OPTIONS: Final = Model(cracks="faces")
_PORTION: Final = 4096  # points that are solved together
_STARTS: Final = 4  # starting points of the batch solver
_FEW: Final = 16  # points that are solved one by one rather than from another starting point
_DECIDED: Final = (Status.COLLAPSE, Status.LOCKED, Status.UNSTABLE)


def sweep(
    structure: Any,
    grid: Any,
    labels: Any = None,
    explore: bool = False,
    jobs: int = 1,
    *,
    fields: bool = False,
    seconds: float | None = None,
) -> pd.DataFrame:
    """Compute λ over a grid, see `jld_explore.sweep`."""
    axes = points_of(grid)
    points = None
    if not callable(structure):
        points = Grid(structure if isinstance(structure, Scene) else load_scene(structure), axes)
        axes = points.axes
    indices = np.array(list(itertools.product(*(range(len(axis)) for axis in axes.values()))))
    columns = zip(axes.items(), indices.T.tolist(), strict=True)
    table = pd.DataFrame({key: [values[k] for k in column] for (key, values), column in columns})
    one_by_one = delayed(_best if explore else _solved)
    if points is None:
        points_in = [{str(key): value for key, value in row.items()} for row in table.to_dict("records")]
        # a function of one parameter with another name than the keys takes a point as a dict
        parameters = list(signature(structure).parameters.values())
        takes_dict = (
            len(parameters) == 1 and parameters[0].name not in axes and parameters[0].kind is not Parameter.VAR_KEYWORD
        )
        structures = [structure(row) if takes_dict else structure(**row) for row in points_in]
        rows = Parallel(n_jobs=jobs)(one_by_one(scene, labels, fields, seconds) for scene in structures)
        return table.assign(**pd.DataFrame(rows))
    states = None if explore else points.states()
    swept = None if states is None else Swept(points, states, labels)
    if swept is None or not swept.batched:
        rows = Parallel(n_jobs=jobs)(one_by_one(points.scene(row), labels, fields, seconds) for row in indices)
        return table.assign(**pd.DataFrame(rows))
    table = table.assign(**swept.all(indices, jobs))
    if fields:
        more = Parallel(n_jobs=jobs)(delayed(_by_fields)(points.assembly(row), labels, seconds) for row in indices)
        table = table.assign(**pd.DataFrame(more))
    return table


def _uncut(assembly: Assembly, labels: Bits) -> Bits:
    """Return labels (m,) of which all faces that may be inner are: those between free elements with inner strength."""
    tension = assembly.strengths(_SWEEP_ROUTE).tension
    return labels & ~(assembly.free_faces & ~np.isnan(tension))


def _solved(structure: Any, labels: Any, fields: bool, seconds: float | None) -> dict[str, Any]:
    assembly = structure if isinstance(structure, Assembly) else build_assembly(structure)
    layout_labels = assemblies.labels_of(assembly, labels)
    result = solve(assembly, layout_labels)
    row = _row(result) | {"uncut": result.bracket[1]}
    uncut = _uncut(assembly, layout_labels)
    if (uncut != layout_labels).any():
        row["uncut"] = solve(assembly, uncut).bracket[1]
    return row | (_by_fields(assembly, layout_labels, seconds) if fields else {})


def _bounds_of(columns: dict[str, Any]) -> list[CaseBounds]:
    """Return the bounds of one load case at each point."""
    rows = zip(columns["status"], columns["bracket_lo"], columns["bracket_hi"], strict=True)
    return [CaseBounds(Status(name or "uncertified"), low, high, 0.5 * (low + high)) for name, low, high in rows]


def _row(result: Any) -> dict[str, Any]:
    """Return the columns of one solved point."""
    name = ""
    if result.status is Status.COLLAPSE and result.mechanism is not None:
        jumps = face_jumps(result.assembly, result.mechanism)[None]
        friction = np.nan_to_num(result.assembly.strengths(_SWEEP_ROUTE).friction)
        kinds = movements(result.assembly, result.labels, jumps, friction)[0]
        name = mechanism_names(result.assembly, result.labels, kinds)[0]
    return {
        "load_factor": result.load_factor,
        "bracket_lo": result.bracket[0],
        "bracket_hi": result.bracket[1],
        "status": str(result.status),
        "mechanism": name,
        "proven": result.status in _DECIDED,
    }


def _by_fields(assembly: Assembly, labels: Any, seconds: float | None) -> dict[str, float]:
    result = solve(assembly, labels, cracks="fields", seconds=seconds)
    return {"fields_lo": result.bracket[0], "fields_hi": result.bracket[1]}


def _best(structure: Any, labels: Any, fields: bool, seconds: float | None) -> dict[str, Any]:
    """Return the columns of the strongest layout at one point."""
    folder = Path(tempfile.mkdtemp(prefix="jld-map-"))
    try:
        exploration = search(structure, folder / "search", pictures=False, seconds=seconds)
        facts, best = exploration.summary, exploration.result(1) if exploration.summary.best is not None else None
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    numbers = dict.fromkeys(("load_factor", "bracket_lo", "bracket_hi"), np.nan)
    row = {**numbers, "status": "unstable", "mechanism": ""} if best is None else _row(best)
    assembly = build_assembly(structure)
    uncut = solve(assembly, _uncut(assembly, assembly.labels)).bracket[1]
    row |= {"proven": bool(facts.proven), "uncut": uncut, "labelling": facts.best_labelling}
    if fields:
        row["fields_lo"], row["fields_hi"] = facts.by_fields or (np.nan, np.nan)
    return row


class Swept:
    """Bounds at all points of a grid on whose values only strengths and loads depend, by the batch solver."""

    def __init__(self, points: Grid, states: States, labels: Any, *, uncut: bool = True) -> None:
        self.points, self.states, self.assembly = points, states, points.assembly(points.middle)
        self.labels = assemblies.labels_of(self.assembly, labels)
        require_materials(self.assembly, self.labels, ~self.labels)
        uncut_labels = _uncut(self.assembly, self.labels) if uncut else self.labels
        self._uncut_labels = None if (uncut_labels == self.labels).all() else uncut_labels
        layouts = {layout.tobytes(): layout for layout in (self.labels, uncut_labels)}
        self._analyses_by_labels = {key: self._analyses(self.assembly, layout) for key, layout in layouts.items()}
        self.batched = all(case.batched for cases in self._analyses_by_labels.values() for case in cases)

    @staticmethod
    def _analyses(assembly: Assembly, labels: Bits) -> list[SampleAnalysis]:
        return [SampleAnalysis(limit_analysis(case, _OPTIONS, reference=labels), labels) for case in assembly.by_case]

    def all(self, indices: Floats, jobs: int) -> dict[str, Any]:
        size = min(_PORTION, -(-len(indices) // jobs))
        portions = [indices[k : k + size] for k in range(0, len(indices), size)]
        parts = Parallel(n_jobs=jobs, prefer="threads")(delayed(self._portion)(portion) for portion in portions)
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    @one_thread()
    def _portion(self, indices: Floats) -> dict[str, Any]:
        bounds = self._bounds(indices, self.labels)
        uncut = bounds if self._uncut_labels is None else self._bounds(indices, self._uncut_labels, named=False)
        return bounds | {"uncut": np.where(np.isfinite(uncut["bracket_hi"]), uncut["bracket_hi"], np.nan)}

    def _bounds(self, indices: Floats, labels: Bits, *, named: bool = True) -> dict[str, Any]:
        """Return the columns of points: by batches, then one by one."""
        analyses, open_rows = self._analyses_by_labels[labels.tobytes()], np.arange(len(indices))
        columns: dict[str, Any] = {}
        for _ in range(_STARTS):
            strengths, loads = self.states.at(indices[open_rows])
            each = zip(analyses, loads, strict=True)
            solved = self._governing(
                [self._case(analysis, strengths, load, labels, named=named) for analysis, load in each]
            )
            # strengths that only a scene can refuse
            refused = strengths.tension * strengths.inner_friction > strengths.shear * (1 + 1e-12)
            solved["status"][refused.reshape(len(open_rows), -1).any(axis=1)] = ""
            for name, values in solved.items():
                columns.setdefault(name, values)[open_rows] = values
            open_rows = open_rows[solved["status"] == ""]
            if len(open_rows) < _FEW:
                break
            # a starting point among those that are left
            analyses = self._analyses(self.points.assembly(indices[open_rows[len(open_rows) // 2]]), labels)
        for k in open_rows.tolist():
            single = CaseAnalysis(self.points.assembly(indices[k]), _OPTIONS, single_labelling=True).solve(labels)
            for name, value in _row(single).items():
                columns[name][k] = value
        return columns

    def _case(
        self, analysis: SampleAnalysis, strengths: Strengths, loads: Floats, labels: Bits, *, named: bool
    ) -> dict[str, Any]:
        """Return the columns of k points under one load case; status "" where it is open. loads: (2, k, n, q)."""
        solved = analysis.solve(strengths, *loads, vectors=named)
        bounds, scaling = analysis.bounds(solved), analysis.analysis.template.scaling
        columns: dict[str, Any] = {
            "status": np.array([str(bounds.status(k) or "") for k in range(len(solved.low))], dtype=object),
            "bracket_lo": scaling.load * bounds.low,
            "bracket_hi": scaling.load * bounds.high,
            "mechanism": np.full(len(solved.low), "", dtype=object),
        }
        falls = np.flatnonzero(columns["status"] == str(Status.COLLAPSE)) if named else np.zeros(0, dtype=np.int64)
        if len(falls):
            velocity = solved.velocities[falls] / scaling.row.ravel()
            jumps = (equilibrium_matrix(self.assembly).T @ velocity.T).T.reshape(len(falls), len(labels), -1)
            friction = np.nan_to_num(strengths.friction.reshape(-1, len(labels))[falls])
            kinds = movements(self.assembly, labels, jumps, friction)[0]
            columns["mechanism"][falls] = mechanism_names(self.assembly, labels, kinds)
        return columns

    def _governing(self, cases: list[dict[str, Any]]) -> dict[str, Any]:
        """Combine the columns of load cases to those of the governing factor; status "": open."""
        columns = cases[0]
        if self.assembly.cases:
            required = self.assembly.required.tolist()
            decided = [governing(bounds, required) for bounds in zip(*map(_bounds_of, cases), strict=True)]
            columns = {
                "status": np.array(
                    [str(outcome.status).replace("uncertified", "") for outcome in decided], dtype=object
                ),
                "bracket_lo": np.array([outcome.low for outcome in decided]),
                "bracket_hi": np.array([outcome.high for outcome in decided]),
                "mechanism": np.array(
                    [cases[worst.case]["mechanism"][k] for k, worst in enumerate(decided)], dtype=object
                ),
            }
        value = 0.5 * (columns["bracket_lo"] + columns["bracket_hi"])
        proven = np.isin(columns["status"].astype(str), [str(status) for status in _DECIDED])
        return {"load_factor": value, **columns, "proven": proven}


_HALVINGS: Final = 6  # halvings of the distance of two points of a grid before λ is extrapolated
_NEAR: Final = 1e-3  # share of that distance to the second point of a side at the edge of the map


def borders(structure: Any, grid: Any, table: pd.DataFrame, labels: Any = None) -> pd.DataFrame:
    """Find points on the borders between the mechanisms of a map.

    Between neighbours of different mechanisms the distance is halved by the mechanism in the middle. λ is then
    extrapolated from both sides; the border is where both meet.

    Parameters
    ----------
    structure : str, Path, dict or Scene
        Scene.
    grid : dict
        Values of the keys of the map, numbers.
    table : pandas.DataFrame
        Result of `sweep` over this grid.
    labels : (m,) array or str, optional
        As in `sweep`.

    Returns
    -------
    pandas.DataFrame
        Columns: the keys; `one` and `other`, the mechanisms below and above along the key `along`; `load_factor`. Empty
        where more than strengths and loads depends on the keys.

    Raises
    ------
    InputError
        As `sweep`.
    """
    scene = structure if isinstance(structure, Scene) else load_scene(structure)
    axes = Grid(scene, points_of(grid)).axes
    names = np.where(table["status"] == str(Status.COLLAPSE), table["mechanism"], "").reshape(
        [*map(len, axes.values())]
    )
    parts = []
    for axis, key in enumerate(axes):
        first, second = (np.moveaxis(names, axis, 0)[cut] for cut in (slice(None, -1), slice(1, None)))
        edges = np.argwhere((first != second) & (first != "") & (second != ""))
        if len(edges):
            edge_indices = np.insert(edges[:, 1:], axis, edges[:, 0], axis=1)
            rows = _along(scene, axes, key, edge_indices, labels)
            if rows is not None:
                parts.append(rows)
    columns = [*axes, "along", "one", "other", "load_factor"]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns)


def _along(scene: Scene, axes: dict[str, list[Any]], key: str, indices: Any, labels: Any) -> pd.DataFrame | None:
    """Find the borders on edges of a grid along a key; indices: (e, axes) of the lower ends of the edges."""
    axis, values = list(axes).index(key), np.array(axes[key], dtype=float)
    # one assembly for each value of the map and between its ends; where states lie on a line, none for further values
    all_values = np.unique([*values, 0.5 * (values[0] + values[-1])])
    points = Grid(scene, axes | {key: all_values.tolist()})
    states = points.states()
    swept_map = None if states is None else Swept(points, states, labels, uncut=False)
    if states is None or swept_map is None or not swept_map.batched:
        return None
    linear = states.linear(axis, all_values)

    def at(x: Any) -> dict[str, Any]:
        """Return the columns of `sweep` at values (e,) of the key, or several for each edge."""
        positions, swept = np.tile(indices.astype(float), (len(x) // len(indices), 1)), swept_map
        if linear:
            positions[:, axis] = np.interp(x, all_values, np.arange(len(all_values)))
        else:
            all_x, where = np.unique(np.concatenate([x, values[:2]]), return_inverse=True)
            further = Grid(scene, axes | {key: all_x.tolist()})
            swept = Swept(further, further.states(), labels, uncut=False)  # type: ignore[arg-type]
            positions[:, axis] = where[: len(x)]
        return swept.all(positions, 1)

    low, high = values[indices[:, axis]], values[indices[:, axis] + 1]
    name = at(low)["mechanism"]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        same = at(middle)["mechanism"] == name
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    # λ of either mechanism is continued by a secant through two points of its side; the border is where they meet
    step = high - low
    # the second point of each side stays within the map, where values are known to make sense
    before = np.where(low - step < values.min(), low + _NEAR * step, low - step)
    after = np.where(high + step > values.max(), high - _NEAR * step, high + step)
    swept_points = at(np.concatenate([before, low, high, after]))
    mechanisms = np.split(swept_points["mechanism"], 4)
    factor_before, factor_low, factor_high, factor_after = np.split(swept_points["load_factor"].copy(), 4)
    factor_before[(before > low) & (mechanisms[0] != name)] = np.nan
    factor_after[(after < high) & (mechanisms[3] != mechanisms[2])] = np.nan
    slope_low, slope_high = (factor_low - factor_before) / (low - before), (factor_after - factor_high) / (after - high)
    with np.errstate(divide="ignore", invalid="ignore"):
        border = low + (factor_high - factor_low - slope_high * step) / (slope_low - slope_high)
    meets = np.isfinite(border) & (border >= low - step) & (border <= high + step)
    border = np.where(meets, border, 0.5 * (low + high))
    table = {column: np.array(axes[column], dtype=object)[indices[:, k]] for k, column in enumerate(axes)}
    table |= {key: border, "along": key, "one": mechanisms[1], "other": mechanisms[2]}
    load_factor = np.where(meets, factor_low + slope_low * (border - low), 0.5 * (factor_low + factor_high))
    return pd.DataFrame(table | {"load_factor": load_factor})
