"""Bounds on λ of blocks that crack anywhere, refined where the two fields disagree."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.loads import FieldLoads, loaded_mesh
from jld_core.fields.lower import LowerBound, StressField
from jld_core.fields.mesh import Mesh, fanned, refine, subdivide
from jld_core.fields.problem import (
    Material,
    Problem,
    Units,
    material_of,
    problem_of,
    require_planar,
    require_refinement,
    units_of,
)
from jld_core.fields.transfer import FieldMechanism, FieldStresses, mechanism_of, stresses_of
from jld_core.fields.upper import UpperBound, VelocityField

# Share of the indicator that marked triangles hold together (Dörfler marking). With 0.5 the flagship needs 3500
# triangles for a bracket of 3.4 %, with 0.25 it has 3.1 % on 2400.
_SHARE = 0.25

# Share as `_SHARE` while a bound is missing: larger, since any field will do and each mesh takes time
_SHARE_WITHOUT = 0.5

_MOST_MARKED = 0.4  # largest share of triangles that one refinement marks

# Weight of the area in the indicator, the disagreement having 1, so that no triangle stays coarse for ever
_EVERYWHERE = 0.1

_STRESSED = 0.5  # Weight of the multipliers of stresses in the indicator. By disagreement alone the lower bound stalls.

_SINGULAR = 0.7  # share of the multipliers of a triangle at one corner above which that corner is taken as singular

_FAN = np.radians(20.0)  # angle below which a triangle at a singular corner is not split further about it

_LEAST_AREA = 1e-9  # smallest area of a triangle over that of all: smaller ones are not split again


@dataclass(frozen=True)
class FieldSetting:
    """Data that all meshes and labellings of one assembly share."""

    assembly: Assembly  # planar assembly with one load case
    material: Material  # material of the blocks, scene units
    units: Units
    coarse: Mesh  # coarsest mesh
    loads: FieldLoads  # loads over it

    @classmethod
    def of(cls, assembly: Assembly, patch: float | None = None) -> FieldSetting:
        """Compute material, units, coarsest mesh and loads of a planar assembly.

        Raises InputError as `material_of` and `loaded_mesh` do.
        """
        material = material_of(assembly)
        coarse, loads = loaded_mesh(assembly, patch)
        ends = [end for segment in loads.segments for end in segment.ends]
        return cls(assembly, material, units_of(assembly, material), fanned(coarse, ends), loads)

    def problem(self, mesh: Mesh) -> Problem:
        """Return the scaled problem on a mesh that was refined from `coarse`; see `problem_of`."""
        return problem_of(self.assembly, self.material, self.units, mesh, self.loads)


@dataclass(frozen=True)
class Fields:
    """Certified fields of one labelling on one mesh."""

    mesh: Mesh  # triangles, scene coordinates
    labels: Bits  # (m,) True = dry
    lower: LowerBound  # program of the stresses, scaled
    upper: UpperBound  # program of the velocities, scaled
    stress: StressField | None  # stress field, None where none was certified
    velocity: VelocityField | None  # velocity field, None where none was certified

    @classmethod
    def on(
        cls, setting: FieldSetting, mesh: Mesh, labels: Bits, enough: float = -math.inf, *, velocities: bool = True
    ) -> Fields:
        """Solve for both fields of one labelling on one mesh.

        labels: (m,) True = dry. velocities: False leaves the velocity field out, so that `velocity` is None. Nothing is
        raised where a solver fails: the field is then None.
        """
        problem = setting.problem(mesh)
        lower, upper = LowerBound(problem), UpperBound(problem)
        velocity = upper.bound(labels) if velocities else None
        weak = velocity is not None and velocity.factor * problem.units.load < enough
        return cls(mesh, labels, lower, upper, None if weak else lower.bound(labels), velocity)

    @property
    def problem(self) -> Problem:
        """Scaled problem on the mesh, which both fields belong to."""
        return self.lower.problem

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound on λ from this mesh alone, scene units.

        The lower bound is −inf without a stress field, the upper one inf without a velocity field.
        """
        load = self.problem.units.load
        lower = -math.inf if self.stress is None else load * self.stress.factor
        return lower, math.inf if self.velocity is None else load * self.velocity.factor

    @cached_property
    def for_all(self) -> tuple[FieldStresses | None, FieldMechanism | None]:
        """Bounds on the λ of all labellings that the stress and velocity fields prove.

        The first is a lower, the second an upper bound. Either is None without its field; the upper one also where
        `mechanism_of` returns None.
        """
        stresses = None if self.stress is None else stresses_of(self.lower, self.stress, self.labels)
        return stresses, None if self.velocity is None else mechanism_of(self.upper, self.velocity, self.labels)

    def finer(self, adaptive: bool = True, *, steps: bool = True) -> Mesh:
        """Return the next mesh: refined where the fields disagree, or everywhere.

        adaptive: False splits every triangle in four. True splits the triangles with the largest criterion of
        docs/method.md (9.12). Without a stress field the criterion uses that for the dead load alone. Without either
        field all but the smallest triangles are split. steps: False marks more triangles at once, for fewer meshes.
        """
        if not adaptive:
            return refine(self.mesh, np.ones(len(self.mesh), dtype=bool))
        stress = self.stress if self.stress is not None else self._under_dead_load()
        both = self.stress is not None and self.velocity is not None
        share = _SHARE if steps and both else _SHARE_WITHOUT
        marks = _marks(self.problem, stress, self.velocity, share)
        return refine(self.mesh, marks, _singular_corners(self.problem, stress))

    def _under_dead_load(self) -> StressField | None:
        """Return the stress field under the largest multiple of the dead load alone.

        None without dead load, or where no field was certified. Its `rate` shows where the mesh is too coarse.
        """
        p = self.problem
        return LowerBound(p.under_dead_load()).bound(self.labels) if p.loaded else None


class CoarseBounds:
    """Bounds on λ of many labellings on the coarsest mesh.

    The two cone programs are set up once. Another labelling only switches rows and costs. Several labellings take a
    third of the time for each when they are bounded together, and their bounds are the same.

    setting: assembly with its coarsest mesh. many: False for a few labellings alone, which are solved as by `Fields`;
    see `ConeProgram`.
    """

    def __init__(self, setting: FieldSetting, many: bool = True) -> None:
        problem = setting.problem(setting.coarse)
        self._load = problem.units.load
        self._lower, self._upper = LowerBound(problem, many), UpperBound(problem, many)

    def upper(self, labels: Bits) -> tuple[float, FieldMechanism | None]:
        """Bound λ of one labelling from above.

        labels: (m,) True = dry. Result: upper bound, scene units, inf where no velocity field was certified; and the
        mechanism that bounds other labellings by the same field, None where it proves none.
        """
        found = self._upper.bound(labels)
        if found is None:
            return math.inf, None
        return self._load * found.factor, mechanism_of(self._upper, found, labels)

    def lower(self, labels: Bits) -> tuple[float, FieldStresses | None]:
        """Bound λ of one labelling from below.

        labels: (m,) True = dry. Result: lower bound, scene units, −inf where no stress field was certified; and the
        stresses that bound other labellings by the same field, None without a field.
        """
        found = self._lower.bound(labels)
        return (
            (-math.inf, None) if found is None else (self._load * found.factor, stresses_of(self._lower, found, labels))
        )

    def both(self, labellings: Bits) -> tuple[Floats, Floats]:
        """Bound λ of several labellings from both sides.

        labellings: (k, m) True = dry. Result: lower and upper bounds (k,), infinite where no field was certified; scene
        units.
        """
        lower, upper = self._lower.bound_all(labellings), self._upper.bound_all(labellings)
        low = [-math.inf if found is None else self._load * found.factor for found in lower]
        high = [math.inf if found is None else self._load * found.factor for found in upper]
        return np.array(low), np.array(high)


def _marks(problem: Problem, stress: StressField | None, velocity: VelocityField | None, wanted: float) -> Bools:
    """Mark the triangles to split, (t,) True, by the criterion of docs/method.md (9.12).

    stress: None marks all but the smallest triangles. velocity: None leaves the disagreement of the fields out.
    """
    count = len(problem.mesh)
    small = problem.mesh.area < _LEAST_AREA * problem.mesh.area.sum()
    if stress is None:
        return np.asarray(~small)
    parts = [(_EVERYWHERE, problem.mesh.area), (_STRESSED, np.maximum(stress.rate, 0.0).sum(axis=1))]
    if velocity is not None:
        parts.append((1.0, np.maximum(disagreement(problem, stress, velocity), 0.0)))
    error = np.zeros(count)
    for weight, part in parts:
        error += weight * part / max(float(part.sum()), 1e-300)
    error[small] = 0.0
    return _leading(error, wanted)


def _leading(error: Floats, wanted: float) -> Bools:
    """Mark the triangles (t,) of largest error that together hold a share of its sum.

    error: (t,), at least 0.
    """
    order = np.argsort(-error, kind="stable")
    share = np.cumsum(error[order])
    enough = int(np.searchsorted(share, wanted * share[-1])) + 1
    marks = np.zeros(len(error), dtype=bool)
    marks[order[: min(enough, max(1, int(_MOST_MARKED * len(error))))]] = True
    return marks


def finer_by_dissipation(mesh: Mesh, power: Floats) -> Mesh:
    """Refine a mesh for velocity fields alone.

    power: (t,) dissipation in each triangle with half of its edges, any unit. Result: mesh with those triangles split
    that dissipate most.
    """
    area = mesh.area
    error = power / max(float(power.sum()), 1e-300) + _EVERYWHERE * area / float(area.sum())
    return refine(mesh, _leading(np.where(area < _LEAST_AREA * area.sum(), 0.0, error), _SHARE))


def _singular_corners(problem: Problem, stress: StressField | None) -> Ints:
    """Return the corner (t,) at which to bisect each triangle, −1 for no preference."""
    # A corner counts if it holds most of `stress.rate` of its triangle and its angle is wide. Stresses jump at ends of
    # loads and at corners of blocks; only a fan of triangles about such a node can follow. Without `stress` all are −1.
    none = np.full(len(problem.mesh), -1, dtype=np.int64)
    if stress is None:
        return none
    corners = problem.mesh.corners
    one, two = np.roll(corners, -1, axis=1) - corners, np.roll(corners, -2, axis=1) - corners
    cross = one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
    angle = np.arctan2(cross, (one * two).sum(axis=2))
    rate = np.maximum(stress.rate, 0.0)
    top = rate.argmax(axis=1)
    every = np.arange(len(top))
    singular = (rate[every, top] > _SINGULAR * rate.sum(axis=1)) & (angle[every, top] > _FAN)
    return np.where(singular, top, none)


def disagreement(problem: Problem, stress: StressField, velocity: VelocityField) -> Floats:
    """Compute each triangle's share (t,) of the gap between the bounds, scaled λ."""
    # The share is the dissipation of the velocity field minus the power of the stress field on its strain rates. Half
    # of the dissipation of an edge belongs to each of its triangles. Up to the opening that `UpperBound.certify` added,
    # the sum is upper less lower bound. Both fields belong to `problem` and one labelling; the result steers
    # refinement.
    p, e = problem, problem.edges
    v = velocity.velocity
    slope = np.einsum("tki,tkj->tij", v, p.mesh.gradient)
    mean = stress.stress.mean(axis=1)
    power = mean[:, 0] * (slope[:, 0, 0] + slope[:, 1, 1]) + mean[:, 1] * (slope[:, 0, 0] - slope[:, 1, 1])
    power = p.mesh.area * (power + mean[:, 2] * (slope[:, 0, 1] + slope[:, 1, 0]))
    rows = np.flatnonzero((e.b >= 0) | (p.face >= 0))
    jump = -v[e.a[rows][:, None], e.corner_a[rows]]
    both = e.b[rows] >= 0
    jump[both] += v[e.b[rows[both]][:, None], e.corner_b[rows[both]]]
    own = stress.stress[e.a[rows][:, None], e.corner_a[rows]]
    nx, ny = e.normal[rows, 0][:, None], e.normal[rows, 1][:, None]
    m, d, s = own[..., 0], own[..., 1], own[..., 2]
    pull = np.stack([(m + d) * nx + s * ny, s * nx + (m - d) * ny], axis=-1)
    ends = (2.0 * (pull * jump).sum(axis=2) + (pull * jump[:, ::-1]).sum(axis=2)) / 6.0
    total = e.length[rows] * ends.sum(axis=1)
    np.add.at(power, e.a[rows], np.where(both, 0.5, 1.0) * total)
    np.add.at(power, e.b[rows[both]], 0.5 * total[both])
    return np.asarray(velocity.dissipation - power)


_MOST_TRIANGLES = 20_000  # triangles at which refinement ends: programs of more take minutes

_GROWTH = 1.3  # exponent of the number of triangles in the time of a mesh, to predict the time of the next one

# Number of meshes after which refinement ends if a bound is still missing. The dead load needs fine meshes at few
# places.
_PATIENCE = 8


# Meshes from one upper bound to the next where the lower bound comes first. An upper bound takes three to five times as
# long as a lower one on the same mesh.
_UPPER_EACH = 3


class FieldStatus(StrEnum):
    """How the computation of a two-sided bound by fields ended.

    CLOSED: the requested gap is reached. UNSTABLE: the upper bound is below 0, so the blocks collapse for every λ ≥ 0.
    OPEN: both bounds exist, with a wider gap. NO_LOWER, NO_UPPER: that bound was not found.
    """

    CLOSED = "closed"
    UNSTABLE = "unstable"
    OPEN = "open"
    NO_LOWER = "no lower bound"
    NO_UPPER = "no upper bound"


def relative_gap(lower: float, upper: float) -> float:
    """Return (upper − lower) / max(|upper|, |lower|), inf where a bound is infinite."""
    if not (math.isfinite(lower) and math.isfinite(upper)):
        return math.inf
    return (upper - lower) / max(abs(upper), abs(lower), 1e-300)


def status_of_bounds(lower: float, upper: float, gap: float) -> FieldStatus:
    """Classify two bounds on λ by the relative gap that was requested; see `FieldStatus`."""
    if upper < 0.0:
        return FieldStatus.UNSTABLE
    if not math.isfinite(lower):
        return FieldStatus.NO_LOWER
    if not math.isfinite(upper):
        return FieldStatus.NO_UPPER
    return FieldStatus.CLOSED if relative_gap(lower, upper) <= gap else FieldStatus.OPEN


@dataclass(frozen=True)
class FieldStep:
    """Bounds on one mesh."""

    triangles: int  # number of triangles
    # lower, upper: bounds on λ from this mesh alone, infinite where none was found
    lower: float
    upper: float
    seconds: float  # time since the start, s


@dataclass(frozen=True)
class Stresses:
    """Certified stress field, linear in each triangle."""

    mesh: Mesh  # triangles
    stress: Floats  # (t, 3, 3) stresses (σx, σy, τxy) at the three corners of each triangle, scene units


@dataclass(frozen=True)
class Velocities:
    """Certified velocity field, linear in each triangle; the live load does unit work on it."""

    mesh: Mesh  # triangles, scene units
    # (t, 3, 2) velocities u at the three corners of each triangle, scene units: b_λ·u = 1 for the live load b_λ of λ =
    # 1
    velocity: Floats
    # (t,) power in each triangle with half of its edges, a work as b_λ·u. Their sum less the work of the dead load is
    # λ.
    dissipation: Floats


@dataclass(frozen=True)
class FieldBounds:
    """Two-sided bound on λ of blocks that may fail in any way."""

    lower: float  # λ that a certified stress field carries, −inf where none was found
    upper: float  # λ that a certified velocity field allows, inf where none was found
    status: FieldStatus  # why the refinement ended
    triangles: int  # number of triangles of the last mesh
    seconds: float  # time, s
    history: tuple[FieldStep, ...]  # one entry for each mesh
    stresses: Stresses | None  # field of the best lower bound
    velocities: Velocities | None  # field of the best upper bound

    @property
    def gap(self) -> float:
        """Width of the bracket over its larger end, inf where a bound is missing."""
        return relative_gap(self.lower, self.upper)


def bounds_by_fields(
    assembly: Assembly,
    labels: Bits | None = None,
    *,
    gap: float = 0.05,
    seconds: float | None = None,
    patch: float | None = None,
    parts: int = 1,
    adaptive: bool = True,
    most_triangles: int = _MOST_TRIANGLES,
) -> FieldBounds:
    """Bound the load factor of blocks that may fail in any way, from both sides.

    Parameters
    ----------
    assembly : Assembly
        Planar assembly with one load case; blocks are made of its inner strengths.
    labels : (m,) bool array, optional
        True = dry joint; False = inside a block. By default the labels of the scene.
    gap : float
        Width of the bracket, relative, at which refinement ends; above 0.
    seconds : float, optional
        No mesh is begun that is not expected to be done by then; the first one always is. By default no limit, s.
    patch : float, optional
        Length of the patch that each live force on a free face is spread on; by default the whole face (docs/method.md
        (9.5)).
    parts : int
        Parts of each edge of the first mesh.
    adaptive : bool
        Refine where the fields disagree; otherwise everywhere.
    most_triangles : int
        Triangles that no mesh exceeds, save the first.

    Returns
    -------
    FieldBounds
        The best of both bounds over all meshes, each checked without a solver. An upper bound below 0 ends refinement.

    Raises
    ------
    InputError
        Scenes in space, several load cases, a gap that is not above 0, and scenes that `material_of` or `loaded_mesh`
        refuses.
    """
    refinement = FieldRefinement(
        assembly, labels, gap=gap, patch=patch, parts=parts, adaptive=adaptive, most_triangles=most_triangles
    )
    found = refinement.step()
    while not refinement.ended and (seconds is None or refinement.expected <= seconds):
        found = refinement.step()
    return found


class FieldRefinement:
    """Refinement of the bounds of one labelling, mesh by mesh.

    Call `step` until `ended`. Each step solves one mesh and returns the best of both bounds so far. Use it instead of
    `bounds_by_fields` where the caller decides after each mesh whether to go on.

    lower_first: True raises the lower bound two to three times as fast: each mesh marks more triangles, and only every
    third mesh has an upper bound. Raises InputError as `bounds_by_fields`.
    """

    def __init__(
        self,
        assembly: Assembly,
        labels: Bits | None = None,
        *,
        gap: float = 0.05,
        patch: float | None = None,
        parts: int = 1,
        adaptive: bool = True,
        most_triangles: int = _MOST_TRIANGLES,
        lower_first: bool = False,
    ) -> None:
        self._spent, start = 0.0, time.perf_counter()
        self._labels = _require(assembly, labels, gap, parts, patch)
        self._gap, self._adaptive, self._most = gap, adaptive, most_triangles
        self._setting = FieldSetting.of(assembly, patch)
        self._mesh: Mesh | None = subdivide(self._setting.coarse, parts)
        self._best, self._steps, self._lower_first = _Best(), list[FieldStep](), lower_first
        self._times: dict[bool, tuple[int, float]] = {}
        self._spent += time.perf_counter() - start

    @property
    def ended(self) -> bool:
        """True if `step` has nothing left to solve.

        Any of these ends refinement: the gap is reached, the upper bound is below 0, a bound is missing after eight
        meshes, the next mesh would exceed `most_triangles`.
        """
        return self._mesh is None

    @property
    def spent(self) -> float:
        """Time spent in the constructor and all steps so far, seconds."""
        return self._spent

    @property
    def upper_due(self) -> bool:
        """True if the next step computes an upper bound unless told otherwise."""
        return not self._lower_first or len(self._steps) % _UPPER_EACH == 0

    @property
    def expected(self) -> float:
        """Expected value of `spent` after one more step, seconds, extrapolated from earlier steps."""
        return self.expected_with(self.upper_due)

    def expected_with(self, upper: bool) -> float:
        """Return the expected value of `spent`, s, after a step with or without an upper bound."""
        known = self._times.get(upper) or self._times.get(True)
        if known is None:
            return self._spent
        triangles, seconds = known
        return float(self._spent + seconds * (self.triangles / triangles) ** _GROWTH)

    @property
    def triangles(self) -> int:
        """Number of triangles of the next mesh, 0 if refinement has ended."""
        return 0 if self._mesh is None else len(self._mesh)

    def step(self, upper: bool | None = None) -> FieldBounds:
        """Solve the next mesh.

        Result: the best of both bounds over all meshes so far. Raises ValueError: refinement has ended.
        """
        if self._mesh is None:
            raise ValueError("refinement has ended; expected a step before")
        began, mesh = time.perf_counter(), self._mesh
        both = self.upper_due if upper is None else upper
        fields = Fields.on(self._setting, mesh, self._labels, velocities=both)
        self._best.take(fields)
        last = time.perf_counter() - began
        self._times[both] = len(mesh), last
        self._steps.append(FieldStep(len(mesh), *fields.bounds, self._spent + last))
        found = self._best.result(tuple(self._steps), self._gap)
        # without one of the bounds refinement helps only so far
        lone = found.status is not FieldStatus.OPEN and len(self._steps) >= _PATIENCE
        if found.status in (FieldStatus.CLOSED, FieldStatus.UNSTABLE) or lone:
            self._mesh = None
        else:
            finer = fields.finer(self._adaptive, steps=not self._lower_first)
            self._mesh = None if len(finer) > self._most or len(finer) == len(mesh) else finer
        self._spent += time.perf_counter() - began
        return found


def _require(assembly: Assembly, labels: Bits | None, gap: float, parts: int, patch: float | None) -> Bits:
    """Check the arguments of `bounds_by_fields`, and return the labels (m,).

    Raises InputError for a spatial assembly, `parts` below 1, and all that `require_refinement` refuses.
    """
    require_planar(assembly)
    known = require_refinement(assembly, labels, gap, patch)
    if parts < 1:
        raise InputError("parts", f"{parts} is wrong", "a whole number of at least 1")
    return known


class _Best:
    """The best bounds so far, in scene units."""

    def __init__(self) -> None:
        self.lower, self.upper = -math.inf, math.inf
        self.stresses: Stresses | None = None
        self.velocities: Velocities | None = None

    def take(self, fields: Fields) -> None:
        """Replace each stored bound, with its field, by that of a mesh if it is better."""
        units, mesh, (lower, upper) = fields.problem.units, fields.mesh, fields.bounds
        if fields.stress is not None and lower > self.lower:
            m, d, s = np.moveaxis(fields.stress.stress, -1, 0)
            self.lower = lower
            self.stresses = Stresses(mesh, units.stress * np.stack([m + d, m - d, s], axis=-1))
        if fields.velocity is not None and upper < self.upper:
            self.upper = upper
            power = units.load * fields.velocity.dissipation
            self.velocities = Velocities(mesh, units.velocity * fields.velocity.velocity, power)

    def result(self, steps: tuple[FieldStep, ...], gap: float) -> FieldBounds:
        """Return the result after some meshes."""
        return FieldBounds(
            self.lower,
            self.upper,
            status_of_bounds(self.lower, self.upper, gap),
            steps[-1].triangles,
            steps[-1].seconds,
            steps,
            self.stresses,
            self.velocities,
        )
