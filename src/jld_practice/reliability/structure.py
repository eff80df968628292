"""Structure whose strengths and loads depend on random variables, and proven bounds of its samples."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Final

import numpy as np

from jld_core import (
    Assembly,
    Bits,
    Bools,
    Floats,
    InputError,
    Ints,
    LimitAnalysis,
    Loads,
    Route,
    Scene,
    SolveOptions,
    Status,
    Strengths,
    build_assembly,
    one_thread,
    parse_scene,
)
from jld_core.batch import batch_solver
from jld_core.build import build_geometry
from jld_core.limit import Proof, SampleAnalysis, crossed
from jld_core.mechanics import require_materials
from jld_core.models import limit_analysis, solve_labelling
from jld_core.scene import standard, uncertain

_FARTHEST: Final = 1e3  # largest size of a standard normal variable

_FACTOR: Final = 12.0  # natural logarithm of the largest factor on the median of a lognormal value


@dataclass(frozen=True)
class Variables:
    """Independent normal and lognormal random variables, docs/method.md (12.1), (12.2)."""

    names: tuple[str, ...]  # key of each in the scene, with the face or element where each has its own
    # mean, deviation: (v,) means and standard deviations, in the units of the scene
    mean: Floats
    deviation: Floats
    lognormal: Bools  # (v,) True where |x| is lognormal, else x is normal

    def __len__(self) -> int:
        return len(self.names)

    def _spread(self) -> Floats:
        """Return ζ of the lognormal variables (v,), with the formula also for the others."""
        return np.sqrt(np.log1p((self.deviation / self.mean) ** 2))

    @property
    def reach(self) -> Floats:
        """Largest sizes (v,) of standard normal variables at which values are computed."""
        return np.where(self.lognormal, np.minimum(_FARTHEST, _FACTOR / self._spread()), _FARTHEST)

    def values(self, normal: Floats) -> Floats:
        """Return the values (..., v) that belong to independent standard normal ones (..., v)."""
        spread = self._spread()
        with np.errstate(over="ignore"):
            scaled = self.mean * np.exp(spread * normal - 0.5 * spread * spread)
        return np.where(self.lognormal, scaled, self.mean + self.deviation * normal)

    def slopes(self, normal: Floats) -> Floats:
        """Return the derivatives (..., v) of `values` by the standard normal variables."""
        return np.where(self.lognormal, self._spread() * self.values(normal), self.deviation)


_ROUTE: Final = Route("the reliability of a layout")

_STEP: Final = 2.0**-6  # relative change of a value by which the dependence of a structure on it is measured

_EQUAL: Final = 1e-9  # relative error up to which a strength follows its value, or loads are linear in theirs

_LEAST: Final = 1e-9  # compressive strength, relative to its mean, that stands for samples of zero and below

_STEEPEST: Final = 89.9  # angle of friction, degrees, that stands for samples above it


@dataclass(frozen=True)
class _Follower:
    """Strengths that follow random variables: base + T(x) − T(mean), at least 0."""

    field: str  # of `Strengths`
    # faces, variables: (k,) faces and the variable of each
    faces: Ints
    variables: Ints
    angle: bool  # True if x is an angle of friction in degrees, so that T is its tangent


@dataclass(frozen=True)
class Growth:
    """Loads of one case that grow with random variables: Π (x − mean) times loads."""

    variables: tuple[int, ...]  # one or two
    # dead, live: (n, q) loads
    dead: Floats
    live: Floats


@dataclass(frozen=True)
class RandomStructure:
    """Assembly at the means of its uncertain values, and how it depends on them."""

    assembly: Assembly  # structure at the means
    variables: Variables  # random variables
    followers: tuple[_Follower, ...]  # strengths that follow variables
    growths: tuple[tuple[Growth, ...], ...]  # for each load case, loads that grow with variables

    @cached_property
    def cases(self) -> tuple[Assembly, ...]:
        return self.assembly.by_case

    @property
    def varies_in_strength(self) -> bool:
        return bool(self.followers)

    def strengths(self, values: Floats) -> Strengths:
        """Return the strengths of all faces, scene units, of samples (k, v); 0 for negative ones."""
        strengths, mean = self.assembly.strengths(_ROUTE), self.variables.mean
        tables = {name: np.repeat(getattr(strengths, name)[None], len(values), axis=0) for name in vars(strengths)}
        for follower in self.followers:
            x, m = values[:, follower.variables], mean[follower.variables]
            if follower.angle:
                x, m = _tangent(x), _tangent(m)
            base = getattr(strengths, follower.field)[follower.faces]
            least = _LEAST * base if follower.field in standard.ENDS else 0.0
            tables[follower.field][:, follower.faces] = np.maximum(base + (x - m), least)
        inner = {parameter.side: parameter.field for parameter in standard.PARAMETERS if parameter.label == "inner"}
        tension, shear, friction = (tables[inner[side]] for side in ("tension", "shear", "friction"))
        with np.errstate(divide="ignore", invalid="ignore"):
            apex = np.where(friction > 0.0, shear / friction, np.inf)
        if self.followers:
            tables[inner["tension"]] = np.where(tension > apex, apex, tension)
        return Strengths(**{name: np.ascontiguousarray(table.ravel()) for name, table in tables.items()})

    def loads(self, values: Floats, case: int) -> tuple[Floats, Floats]:
        """Return the dead and live loads (k, n, q), scene units, of samples (k, v) under a load case."""
        assembly, away = self.cases[case], values - self.variables.mean
        dead, live = (np.repeat(load[None], len(values), axis=0) for load in (assembly.dead, assembly.live))
        linear = self._linear[case]
        if linear is not None:
            rows, more_dead, more_live = linear
            dead += (away[:, rows] @ more_dead).reshape(dead.shape)
            live += (away[:, rows] @ more_live).reshape(live.shape)
        for growth in self.growths[case]:
            if len(growth.variables) == 2:
                factor = away[:, growth.variables].prod(axis=1)[:, None, None]
                dead += factor * growth.dead
                live += factor * growth.live
        return dead, live

    @cached_property
    def _linear(self) -> list[tuple[Ints, Floats, Floats] | None]:
        """For each case the variables (r,) of linear loads, and their rates (r, n·q)."""
        maps: list[tuple[Ints, Floats, Floats] | None] = []
        for growths in self.growths:
            plain = [growth for growth in growths if len(growth.variables) == 1]
            rows = np.array([growth.variables[0] for growth in plain], dtype=np.int64)
            dead, live = (np.array([getattr(growth, name).ravel() for growth in plain]) for name in ("dead", "live"))
            maps.append((rows, dead, live) if plain else None)
        return maps

    def at(self, values: Floats, case: int) -> Assembly:
        dead, live = self.loads(values[None], case)
        stress = self.cases[case].members.self_stress
        return replace(
            self.cases[case].with_strengths(self.strengths(values[None])),
            dead_loads=Loads.of_resultants(dead[0] if stress is None else dead[0] - stress),
            live_loads=Loads.of_resultants(live[0]),
        )

    def rates(
        self, values: Floats, case: int, by_strength: dict[str, Floats], by_load: tuple[Floats, Floats]
    ) -> Floats:
        """Return derivatives (v,) by the variables, from those by strengths (m,) and loads (n, q)."""
        derivatives, deviation = np.zeros(len(values)), values - self.variables.mean
        for follower in self.followers:
            slope: Any = 1.0
            if follower.angle:
                x = np.clip(values[follower.variables], 0.0, _STEEPEST)
                slope = np.radians(1.0) / np.cos(np.radians(x)) ** 2
            np.add.at(derivatives, follower.variables, slope * by_strength[follower.field][follower.faces])
        for growth in self.growths[case]:
            rate = float((by_load[0] * growth.dead).sum() + (by_load[1] * growth.live).sum())
            for position, variable in enumerate(growth.variables):
                others = [deviation[k] for n, k in enumerate(growth.variables) if n != position]
                derivatives[variable] += rate * float(np.prod(others))
        return derivatives


def _tangent(degrees: Floats) -> Floats:
    """Return the friction coefficients of angles in degrees, which count as 0 to `_STEEPEST`."""
    return np.tan(np.radians(np.clip(degrees, 0.0, _STEEPEST)))


def random_structure(scene: Scene) -> RandomStructure:
    """Return a structure as it depends on uncertain values; InputError for one that acts otherwise."""
    values = list(uncertain.uncertain_values(scene))
    if not values:
        expected = '{"mean": …, "cov": …, "kind": "normal" | "lognormal"} for friction, a strength, a density or a load'
        raise InputError("", "no value of the scene has uncertainty", expected)
    return _Measurement(scene, values).structure()


class _Measurement:
    """Measure how the assembly of a scene depends on its values with uncertainty."""

    def __init__(
        self,
        scene: Scene,
        uncertain_values: list[tuple[uncertain.Path, uncertain.Uncertain | uncertain.UncertainVector]],
    ) -> None:
        self.uncertain_values = uncertain_values
        self.document = scene.model_dump(mode="json", exclude_defaults=True)
        for path, value in uncertain_values:
            _put(self.document, path, list(value) if isinstance(value, uncertain.UncertainVector) else float(value))
        self.plain = parse_scene(self.document)
        self.geometry = build_geometry(self.plain)
        self.base = build_assembly(self.plain, self.geometry)
        self.names: list[str] = []
        self.sizes: list[uncertain.Uncertain] = []
        self.followers: list[_Follower] = []
        self.growths: list[list[Growth]] = [[] for _ in self.base.by_case]

    def structure(self) -> RandomStructure:
        variables_of = [self._add(path, value) for path, value in self.uncertain_values]
        self._add_products(variables_of)
        mean = np.array([float(size) for size in self.sizes])
        variables = Variables(
            names=tuple(self.names),
            mean=mean,
            deviation=np.array([size.cov for size in self.sizes]) * abs(mean),
            lognormal=np.array([size.kind == "lognormal" for size in self.sizes]),
        )
        growths = tuple(tuple(growth) for growth in self.growths)
        return RandomStructure(self.base, variables, tuple(self.followers), growths)

    def changed(self, *changes: tuple[int, float]) -> Assembly:
        """Return the assembly with some values, by position, multiplied by factors."""
        document = _copy(self.document)
        fresh = False
        for position, factor in changes:
            path, value = self.uncertain_values[position]
            if isinstance(value, uncertain.UncertainVector):
                _put(document, path, [factor * component for component in value])
            else:
                _put(document, path, factor * float(value))
            fresh = fresh or path[0] in ("elements", "interfaces")
        scene = parse_scene(document)
        return build_assembly(scene, None if fresh else self.geometry)

    def _add(self, path: uncertain.Path, value: uncertain.Uncertain | uncertain.UncertainVector) -> list[int]:
        """Add the variables of one value of the scene, and return their positions."""
        position = [owner for owner, _ in self.uncertain_values].index(path)
        size = value.size if isinstance(value, uncertain.UncertainVector) else value
        step = _STEP
        try:
            stepped = self.changed((position, 1.0 + step))
        except InputError:  # a larger value contradicts another one; a smaller one does not
            step = -_STEP
            stepped = self.changed((position, 1.0 + step))
        faces = self._following(path, stepped, float(size) * step)
        rates = self._rates(stepped, float(size) * step)
        varying = self._split(path, size, faces, rates)
        first, count = len(self.names), 1 if varying is None else len(varying)
        name = uncertain.in_words(path)
        self.names += (
            [name] if varying is None else [f"{name} of {owner}" for owner in self._owners(varying, bool(faces))]
        )
        self.sizes += [size] * count
        for field, mask, angle in faces:
            followed = np.flatnonzero(mask)
            variable = (
                np.zeros(len(followed), dtype=np.int64) if varying is None else np.searchsorted(varying, followed)
            )
            self.followers.append(_Follower(field, followed, first + variable, angle))
        self._grow(rates, first, varying if varying is not None and not faces else None)
        return list(range(first, first + count))

    def _following(self, path: uncertain.Path, other: Assembly, change: float) -> list[tuple[str, Any, bool]]:
        """Return the strengths that follow a value: name, faces (m,), whether by its tangent."""
        entries = []
        key = str(next(part for part in reversed(path) if isinstance(part, str)))
        mean = float(_value(self.document, path)) if "angle" in key else 0.0
        expected = change
        if key.endswith("friction_angle"):
            expected = float(_tangent(np.array(mean + change)) - _tangent(np.array(mean)))
        for name in vars(self.base.strengths(_ROUTE)):
            before, after = getattr(self.base.strengths(_ROUTE), name), getattr(other.strengths(_ROUTE), name)
            mask = ~((before == after) | (np.isnan(before) & np.isnan(after)))
            if not mask.any():
                continue
            size = max(abs(expected), float(abs(before[mask]).max()) * _STEP)
            if np.any(abs(after[mask] - before[mask] - expected) > _EQUAL * size):
                raise _unknown(path)
            entries.append((name, mask, key.endswith("friction_angle")))
        return entries

    def _rates(self, other: Assembly, change: float) -> list[tuple[Floats, Floats]]:
        """Return for each case the rates (n, q) of loads with a value, changed by `change`."""
        return [
            (_rate(after.dead, before.dead, change), _rate(after.live, before.live, change))
            for after, before in zip(other.by_case, self.base.by_case, strict=True)
        ]

    def _split(
        self,
        path: uncertain.Path,
        size: uncertain.Uncertain,
        faces: list[tuple[str, Any, bool]],
        rates: list[tuple[Floats, Floats]],
    ) -> Ints | None:
        """Return the faces or elements with variables of their own; None for one shared variable."""
        # faces: strength, mask (m,), growth of each; rates: growth of dead and live loads (n, q) of each case
        loaded = np.any([np.any(load, axis=1) for pair in rates for load in pair], axis=0)
        if faces and loaded.any():
            raise _unknown(path)
        if not size.each:
            return None
        used = np.flatnonzero(np.any([mask for _, mask, _ in faces], axis=0) if faces else loaded)
        return used if len(used) else None

    def _owners(self, split: Ints, faces: bool) -> list[str]:
        """Return the names of faces or elements; several faces of a pair of elements are numbered."""
        if not faces:
            return [self.base.elements.ids[owner] for owner in split]
        names = [self.base.pair(owner) for owner in split]
        return [
            f"{name} ({names[:k].count(name) + 1})" if names.count(name) > 1 else name for k, name in enumerate(names)
        ]

    def _grow(self, rates: list[tuple[Floats, Floats]], first: int, split: Ints | None) -> None:
        """Add loads that grow with the variables from `first` on, one per element of `split`, or one."""
        for growths, (dead, live) in zip(self.growths, rates, strict=True):
            if split is None:
                if dead.any() or live.any():
                    growths.append(Growth((first,), dead, live))
                continue
            for number, element in enumerate(split.tolist()):
                growths.append(Growth((first + number,), _only(dead, element), _only(live, element)))

    def _add_products(self, variables_of: list[list[int]]) -> None:
        """Add the loads that grow with products of two values: body loads, by weights."""
        weights = [k for k, (path, _) in enumerate(self.uncertain_values) if path[-1] in ("density", "weight")]
        bodies = [k for k, (path, _) in enumerate(self.uncertain_values) if "body" in path]
        for weight, body in itertools.product(weights, bodies):
            # second difference of the loads by both values: (both + none − weight − body) / (change of both)
            more_weight, more_body = (weight, 1.0 + _STEP), (body, 1.0 + _STEP)
            mean_weight, mean_body = (float(self.sizes[variables_of[k][0]]) for k in (weight, body))
            rate = partial(_rate, change=mean_weight * mean_body * _STEP**2, digits=1.0 / _STEP**2)
            cases = zip(
                self.changed(more_weight, more_body).by_case,
                self.base.by_case,
                self.changed(more_weight).by_case,
                self.changed(more_body).by_case,
                self.growths,
                strict=True,
            )
            for both, none, by_weight, by_body, growths in cases:
                dead = rate(both.dead + none.dead, by_weight.dead + by_body.dead)
                live = rate(both.live + none.live, by_weight.live + by_body.live)
                self._grow_pairs(growths, variables_of[weight], variables_of[body][0], dead, live)

    @staticmethod
    def _grow_pairs(growths: list[Growth], weights: list[int], body: int, dead: Floats, live: Floats) -> None:
        if not (dead.any() or live.any()):
            return
        if len(weights) == 1:
            growths.append(Growth((weights[0], body), dead, live))
            return
        loaded = np.flatnonzero(np.any(dead, axis=1) | np.any(live, axis=1))
        for variable, element in zip(weights, loaded.tolist(), strict=True):
            growths.append(Growth((variable, body), _only(dead, element), _only(live, element)))


def _rate(after: Floats, before: Floats, change: float, digits: float = 1.0) -> Floats:
    """Return (after − before) / change, or 0 if within `digits` rounding errors of a number."""
    difference = after - before
    rounding = digits * 16.0 * np.finfo(float).eps * np.maximum(abs(after), abs(before))
    return np.where(abs(difference) <= rounding, 0.0, difference) / change


def _only(load: Floats, element: int) -> Floats:
    part_of_load = np.zeros_like(load)
    part_of_load[element] = load[element]
    return part_of_load


def _unknown(path: uncertain.Path) -> InputError:
    """Return the error for a value that acts on several strengths together, as on a bond."""
    problem = "it acts on a bond of joints, which has several strengths"
    return InputError(
        uncertain.in_words(path), f"{problem}, so that its uncertainty is not supported", "a number alone"
    )


def _copy(part: Any) -> Any:
    """Copy nested dicts and lists; lists of numbers are shared."""
    if isinstance(part, dict):
        return {key: _copy(entry) for key, entry in part.items()}
    if isinstance(part, list):
        return [_copy(entry) for entry in part]
    return part


def _value(document: Any, path: uncertain.Path) -> Any:
    for key in path:
        document = document[key]
    return document


def _put(document: Any, path: uncertain.Path, value: Any) -> None:
    _value(document, path[:-1])[path[-1]] = value


_OPTIONS = SolveOptions()  # model of all samples: associative friction, convex contact


@dataclass(frozen=True)
class GoverningBounds:
    """Bounds on the governing factor of k samples: least λ / required of all load cases."""

    # low, high: (k,) proven bounds. Both are −inf where no λ ≥ 0 is admissible, +inf where λ is unbounded; the upper
    # one is +inf where the lower one is known to suffice.
    low: Floats
    high: Floats

    def fails(self, required: float) -> Bools:
        """Return a mask (k,) of samples that surely carry less than `required`."""
        return np.asarray(self.high < required)

    def holds(self, required: float) -> Bools:
        """Return a mask (k,) of samples that surely carry at least `required`."""
        return np.asarray(self.low >= required)


class SampleBounds:
    """Bounds on the governing load factor of samples of one layout; thread-safe."""

    def __init__(self, structure: RandomStructure, labels: Bits) -> None:
        require_materials(structure.assembly, labels, ~labels)
        self.structure, self.labels = structure, labels
        analyses = [limit_analysis(case, _OPTIONS, reference=labels) for case in structure.cases]
        self.analyses = [SampleAnalysis(analysis, labels) for analysis in analyses]

    @property
    def batched(self) -> bool:
        """True if the batch solver takes the samples of all load cases."""
        return all(analysis.batched for analysis in self.analyses)

    @one_thread()
    def of(self, values: Floats, required: float | None = None) -> GoverningBounds:
        if not self.batched:
            return self.proven(values)
        size, cases = batch_solver.SAMPLES_OF_A_CALL, range(len(self.analyses))
        lows, highs = [], []
        for k in range(0, len(values), size):
            low, high = zip(*(self._of_case(case, values[k : k + size], required) for case in cases), strict=True)
            # the governing case has the least bounds
            lows.append(np.min(low, axis=0))
            highs.append(np.min(high, axis=0))
        return GoverningBounds(np.concatenate(lows), np.concatenate(highs))

    def _of_case(self, case: int, values: Floats, required: float | None) -> tuple[Floats, Floats]:
        """Return bounds (k,) on λ over the required one under a load case."""
        unit = self.analyses[case].analysis.template.scaling.load
        factor = float(self.structure.assembly.required[case])
        strengths = self.structure.strengths(values) if self.structure.varies_in_strength else None
        enough = None if required is None else np.full(len(values), required * factor / unit)
        bounds = self.analyses[case].solve(strengths, *self.structure.loads(values, case), enough)
        low, high = bounds.low.copy(), bounds.high.copy()
        wrong = np.asarray(crossed(low, high)) | np.isnan(low) | np.isnan(high)
        low[wrong], high[wrong] = -np.inf, np.inf
        low[bounds.verdict == batch_solver.FALLS] = high[bounds.verdict == batch_solver.FALLS] = -np.inf
        low[bounds.verdict == batch_solver.LOCKED] = high[bounds.verdict == batch_solver.LOCKED] = np.inf
        return unit / factor * low, unit / factor * high

    def proven(self, values: Floats) -> GoverningBounds:
        """Compute bounds of single samples that the batch solver left open."""
        brackets = np.array([self._proven(value) for value in values]).reshape(-1, 2)
        return GoverningBounds(brackets[:, 0], brackets[:, 1])

    def _proven(self, values: Floats) -> tuple[float, float]:
        """Return the bounds on the governing factor of one sample (v,)."""
        low = high = math.inf
        for case, required in enumerate(self.structure.assembly.required.tolist()):
            analysis, proof = self.solved(values, case)
            least, most = bracket_of(analysis, proof)
            low, high = min(low, least / required), min(high, most / required)
        return low, high

    def solved(self, values: Floats, case: int) -> tuple[LimitAnalysis, Proof]:
        analysis = limit_analysis(
            self.structure.at(values, case), _OPTIONS, reference=self.labels, single_labelling=True
        )
        return analysis, solve_labelling(analysis, self.labels, _OPTIONS)


def bracket_of(analysis: LimitAnalysis, proof: Proof) -> tuple[float, float]:
    """Return proven bounds on λ, scene units: both −inf where unstable, +inf where locked."""
    if proof.status is Status.UNSTABLE:
        return -math.inf, -math.inf
    if proof.status is Status.LOCKED:
        return math.inf, math.inf
    load = analysis.template.scaling.load
    return load * proof.low, load * proof.high
