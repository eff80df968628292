"""Bounds on λ of blocks that crack anywhere, refined where the two fields disagree; in the plane and in space."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.errors import InputError
from jld_core.fields.forms import Material, tensors
from jld_core.fields.loads import FieldLoads, Segment, loaded_mesh
from jld_core.fields.lower import LowerBound, StressField, tractions
from jld_core.fields.mesh import Mesh, bisect, corner_angles, fanned, refine, split_at_centroids, subdivide
from jld_core.fields.problem import Problem, Units, material_of, problem_of, require_refinement, units_of
from jld_core.fields.transfer import (
    REPAIRED,
    FieldMechanism,
    FieldStresses,
    mechanism_bounds,
    mechanism_of,
    stresses_of,
)
from jld_core.fields.upper import Settling, UpperBound, VelocityField, halved, jumps

# Share of the indicator that marked triangles hold together (Dörfler marking). With 0.5 the flagship needs 3500
# triangles for a bracket of 3.4 %, with 0.25 it has 3.1 % on 2400.
_SHARE = 0.25

# Share as `_SHARE` while a bound is missing, and in space: larger, since any field will do and each mesh takes time
_SHARE_WITHOUT = 0.5

_MOST_MARKED = {2: 0.4, 3: 0.3}  # largest share of simplices that one refinement marks

# Weight of the volume in the indicator, the disagreement having 1, so that no simplex stays coarse for ever
_EVERYWHERE = {2: 0.1, 3: 0.02}

_STRESSED = 0.5  # Weight of the multipliers of stresses in the indicator. By disagreement alone the lower bound stalls.

_SINGULAR = 0.7  # share of the multipliers of a triangle at one corner above which that corner is taken as singular

_FAN = np.radians(20.0)  # angle below which a triangle at a singular corner is not split further about it

_LEAST_AREA = 1e-9  # smallest area of a triangle over that of all: smaller ones are not split again

# Ratio of the numbers of tetrahedra of the next and the last mesh. Tetrahedra are marked and halved until it is
# reached.
_STEP_GROWTH = 1.5


def finer_in_plane(
    mesh: Mesh, problem: Problem, stress: StressField | None, velocity: VelocityField | None, steps: bool
) -> Mesh:
    """Refine triangles by disagreement, multipliers of yield and area; all but the smallest without a stress field."""
    small = problem.mesh.volume < _LEAST_AREA * problem.mesh.volume.sum()
    if stress is None:
        return refine(mesh, ~small)
    parts = [(_EVERYWHERE[2], problem.mesh.volume), (_STRESSED, np.maximum(stress.rate, 0.0).sum(axis=1))]
    if velocity is not None:
        parts.append((1.0, np.maximum(disagreement(problem, stress, velocity), 0.0)))
    error = np.zeros(len(mesh))
    for weight, part in parts:
        error += weight * part / max(float(part.sum()), 1e-300)
    error[small] = 0.0
    share = _SHARE if steps and velocity is not None else _SHARE_WITHOUT
    # Stresses jump at ends of loads and at corners of blocks; only a fan of triangles about such a node can follow. A
    # corner counts if it holds most of `stress.rate` of its triangle and its angle is wide.
    angles = corner_angles(problem.mesh.corners)
    rate, triangle = np.maximum(stress.rate, 0.0), np.arange(len(mesh))
    corner = rate.argmax(axis=1)
    singular = (rate[triangle, corner] > _SINGULAR * rate.sum(axis=1)) & (angles[triangle, corner] > _FAN)
    return refine(mesh, _leading(error, share, _MOST_MARKED[2]), np.where(singular, corner, -1))


def finer_in_space(
    mesh: Mesh,
    problem: Problem,
    fine: Problem,
    labels: Bits,
    stress: StressField,
    velocity: VelocityField | None,
    most: int,
) -> Mesh:
    """Bisect the tetrahedra with most dissipation less stress power, and most multipliers, up to `most`."""
    unsplit, volume = problem.mesh, problem.mesh.volume
    # of the four parts of each tetrahedron at their four corners; corner k of part k is the centroid
    rate = np.maximum(stress.rate, 0.0).reshape(-1, 4, 4)
    at_centroid = np.diagonal(rate, axis1=1, axis2=2)
    # multipliers of yield, summed to the corners of the unsplit tetrahedra
    corner = rate.sum(axis=1) - at_centroid + 0.25 * at_centroid.sum(axis=1, keepdims=True)
    error = corner.sum(axis=1)
    if velocity is not None:
        corner_velocity = np.repeat(velocity.velocity[:, None], 4, axis=1)
        corner_velocity[:, np.arange(4), np.arange(4)] = velocity.velocity.mean(axis=1)[:, None]
        part_velocity = corner_velocity.reshape(-1, 4, 3)
        power = stress_power(fine, stress, part_velocity)
        error = error + np.maximum(velocity.dissipation - power.reshape(-1, 4).sum(axis=1), 0.0)
        corner = corner + _joint_corners(fine, stress, part_velocity, np.flatnonzero(fine.is_dry(labels)))
    error = error + _EVERYWHERE[3] * error.sum() * volume / volume.sum()
    finer = _bisected_by(unsplit, error, corner, most)
    units = problem.units
    return replace(finer, points=finer.points * units.length + units.origin, root=mesh.root[finer.root])


def _bisected_by(unsplit: Mesh, error: Floats, corner: Floats, most: int) -> Mesh:
    """Halve the tetrahedra of greatest error (t,) until the mesh has grown by `_STEP_GROWTH`, or reaches `most`.

    corner: (t, 4) share of the error at each corner. The roots are tetrahedra of `unsplit`.
    """
    finer = replace(unsplit, root=np.arange(len(unsplit)))
    below_limit = True
    while below_limit and len(finer) < _STEP_GROWTH * len(unsplit):
        # half of a tetrahedron keeps a quarter of its share: strips along hinges lose in proportion to their width
        remaining = error[finer.root] * (finer.volume / unsplit.volume[finer.root]) ** 2
        offset = finer.corners[:, :, None] - unsplit.corners[finer.root][:, None]
        barycentric = 1.0 + np.einsum("tcki,tki->tck", offset, unsplit.gradient[finer.root])
        weight = np.maximum(np.einsum("tck,tk->tc", barycentric, corner[finer.root]), 0.0)
        weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
        marks = _leading(remaining, _SHARE_WITHOUT, _MOST_MARKED[3])
        bisected = bisect(finer, marks, weight)
        below_limit = len(bisected) <= most
        while len(bisected) > most and marks.any():
            marks &= remaining > np.median(remaining[marks])
            bisected = bisect(finer, marks, weight)
        finer = bisected
    return finer


def _leading(error: Floats, error_share: float, most_marked: float) -> Bools:
    """Mark the simplices (t,) of largest error that hold a share of its sum, at most a share of all."""
    order = np.argsort(-error, kind="stable")
    total = np.cumsum(error[order])
    count = int(np.searchsorted(total, error_share * total[-1])) + 1
    marks = np.zeros(len(error), dtype=bool)
    marks[order[: min(count, max(1, int(most_marked * len(error))))]] = True
    return marks


def disagreement(problem: Problem, stress: StressField, velocity: VelocityField) -> Floats:
    """Compute each simplex's share (t,) of upper less lower bound, scaled λ; both fields are of one labelling."""
    return np.asarray(velocity.dissipation - stress_power(problem, stress, velocity.velocity))


def stress_power(problem: Problem, stress: StressField, velocity: Floats) -> Floats:
    """Return the power (t,) of a stress field on velocities (t, d + 1, d), with half of the sides, scaled."""
    d, rows = problem.mesh.dimension, problem.jumps
    slope = np.einsum("tki,tkj->tij", velocity, problem.mesh.gradient)
    power = problem.mesh.volume * np.einsum("tij,tij->t", tensors(stress.stress.mean(axis=1)), slope)
    traction, jump = tractions(problem, stress.stress, rows), jumps(problem, velocity, rows)
    # the integral of the product of two linear functions over a side, by their values at its corners
    product = np.einsum("fki,fki->f", traction, jump) + np.einsum("fi,fi->f", traction.sum(axis=1), jump.sum(axis=1))
    return halved(problem, power, rows, problem.sides.area[rows] * product / (d * (d + 1)))


def _joint_corners(fine: Problem, stress: StressField, velocity: Floats, rows: Ints) -> Floats:
    """Compute the power (t, 4) that tractions on dry triangles lose at corners of the unsplit tetrahedra."""
    sides = fine.sides
    shares = np.zeros((len(fine.mesh) // 4, 4))
    traction, jump = tractions(fine, stress.stress, rows), jumps(fine, velocity, rows)
    lost_power = np.maximum(-np.einsum("fi,fki->fk", traction.sum(axis=1), jump), 0.0)
    lost_power *= (sides.area[rows] / 24.0)[:, None]
    two_sided = sides.b[rows] >= 0
    np.add.at(shares, (sides.a[rows][:, None] // 4, sides.corner_a[rows]), lost_power)
    np.add.at(shares, (sides.b[rows][two_sided][:, None] // 4, sides.corner_b[rows][two_sided]), lost_power[two_sided])
    return shares


# Gap at which refinement ends by the dimension, and simplices at which it ends: programs of more take minutes and
# gigabytes
_GAP = {2: 0.05, 3: 0.15}
_MOST = {2: 20_000, 3: 12_000}

_GROWTH = {2: 1.3, 3: 1.7}  # exponent of the number of simplices in the time of a mesh, to predict that of the next one

_LEAST_GROWTH = {2: 1.0, 3: 1.05}  # growth of a mesh up to which it is not worth its time

# Number of meshes after which refinement ends if a bound is still missing. The dead load needs fine meshes at few
# places.
_PATIENCE = 8
_GRACE = 1.0  # s by which a mesh in space may pass the time given

# Meshes from one upper bound to the next where the lower bound comes first. An upper bound takes three to five times as
# long as a lower one on the same mesh.
_UPPER_EACH = 3

_DEFORMS = 0.1  # share of the dissipation from which a cell that is long or flat is cut in layers


@dataclass(frozen=True)
class FieldSetting:
    """Data that all meshes of one assembly share; in the plane all labellings share it as well."""

    assembly: Assembly  # with one load case
    material: Material  # material of the blocks, scene units
    units: Units
    coarse: Mesh  # coarsest mesh
    loads: FieldLoads  # loads over it

    @classmethod
    def of(
        cls, assembly: Assembly, patch: float | None = None, labels: Bits | None = None, cut: tuple[int, ...] = ()
    ) -> FieldSetting:
        """Compute material, units, coarsest mesh and loads; patch: length that a point force is spread on.

        labels: (m,) True = dry, cut: cells in layers, of space alone.
        """
        material = material_of(assembly)
        if assembly.dimension == 2:
            coarse, loads = loaded_mesh(assembly, patch)
            ends = [end for segment in loads.tractions if isinstance(segment, Segment) for end in segment.ends]
            coarse = fanned(coarse, ends)  # where a traction ends, three triangles meet (9.5)
        else:
            from jld_core.fields.solids import loaded_solids  # planar scenes do not load it

            coarse, loads = loaded_solids(assembly, patch, labels, cut)
        return cls(assembly, material, units_of(assembly, material), coarse, loads)

    def problem(self, mesh: Mesh) -> Problem:
        """Return the scaled problem on a mesh that was refined from `coarse`; see `problem_of`."""
        return problem_of(self.assembly, self.material, self.units, mesh, self.loads)


@dataclass(frozen=True)
class Fields:
    mesh: Mesh  # simplices of the velocities, scene coordinates
    split: Mesh  # simplices of the stresses: the same in the plane; in space each is split in four at its centroid
    labels: Bits  # (m,) True = dry
    lower: LowerBound  # program of the stresses, scaled
    upper: UpperBound  # program of the velocities, scaled
    stress: StressField | None  # stress field, None where none was certified
    velocity: VelocityField | None  # velocity field, None where none was certified

    @classmethod
    def on(
        cls, setting: FieldSetting, mesh: Mesh, labels: Bits, least_upper: float = -math.inf, *, velocities: bool = True
    ) -> Fields:
        """Solve for both fields of one labelling on one mesh; None where a solver fails or a field is not asked for.

        The stress field is left out where the upper bound is below `least_upper` (λ, scene units).
        """
        problem = fine = setting.problem(mesh)
        split = mesh
        if mesh.dimension == 3:
            split = split_at_centroids(mesh)
            fine = setting.problem(split)
        lower, upper = LowerBound(fine), UpperBound(problem)
        velocity = upper.bound(labels) if velocities else None
        too_weak = velocity is not None and velocity.factor * problem.units.load < least_upper
        return cls(mesh, split, labels, lower, upper, None if too_weak else lower.bound(labels), velocity)

    @property
    def problem(self) -> Problem:
        """Scaled problem on the mesh of the velocities."""
        return self.upper.problem

    @property
    def bounds(self) -> tuple[float, float]:
        """Return the bounds on λ from this mesh alone, scene units; −inf and inf without a field."""
        load = self.problem.units.load
        lower = -math.inf if self.stress is None else load * self.stress.factor
        return lower, math.inf if self.velocity is None else load * self.velocity.factor

    @cached_property
    def for_all(self) -> tuple[FieldStresses | None, FieldMechanism | None]:
        """Return the lower and upper bounds on λ of all labellings that the fields prove.

        None where one proves nothing.
        """
        stresses = None if self.stress is None else stresses_of(self.lower, self.stress, self.labels)
        return stresses, None if self.velocity is None else mechanism_of(self.upper, self.velocity, self.labels)

    def finer(self, adaptive: bool = True, *, steps: bool = True, most: int = _MOST[3]) -> Mesh:
        """Return the next mesh, of at most `most` tetrahedra: refined everywhere, or by docs/method.md (9.12)."""
        problem, every = self.problem, np.ones(len(self.mesh), dtype=bool)
        if self.mesh.dimension == 3:
            if not adaptive or self.stress is None:
                return bisect(self.mesh, every)
            return finer_in_space(self.mesh, problem, self.lower.problem, self.labels, self.stress, self.velocity, most)
        if not adaptive:
            return refine(self.mesh, every)
        stress = self.stress
        if stress is None and problem.loaded:
            # the stress field under the largest multiple of the dead load alone shows where the mesh is too coarse
            stress = LowerBound(problem.under_dead_load()).bound(self.labels)
        return finer_in_plane(self.mesh, problem, stress, self.velocity, steps and self.stress is not None)


class CoarseBounds:
    """Bounds on λ of many planar labellings on the coarsest mesh.

    A labelling switches rows and costs of two programs.
    """

    # Labellings bounded together take a third of the time each, with the same bounds.

    def __init__(self, setting: FieldSetting, many: bool = True) -> None:
        problem = setting.problem(setting.coarse)
        self._load = problem.units.load
        self._lower, self._upper = LowerBound(problem, many), UpperBound(problem, many)

    def upper(self, labels: Bits) -> tuple[float, FieldMechanism | None]:
        """Bound λ from above, inf without proof; also the mechanism that bounds other labellings, or None."""
        field = self._upper.bound(labels)
        if field is None:
            return math.inf, None
        return self._load * field.factor, mechanism_of(self._upper, field, labels)

    def lower(self, labels: Bits) -> tuple[float, FieldStresses | None]:
        """Bound λ from below, −inf without proof; also the stresses that bound other labellings, or None."""
        field = self._lower.bound(labels)
        return (
            (-math.inf, None) if field is None else (self._load * field.factor, stresses_of(self._lower, field, labels))
        )

    def both(self, labellings: Bits) -> tuple[Floats, Floats]:
        """Bound λ of labellings (k, m) from both sides, (k,) each, infinite without proof; scene units."""
        stress_fields, velocity_fields = self._lower.bound_all(labellings), self._upper.bound_all(labellings)
        low = [-math.inf if field is None else self._load * field.factor for field in stress_fields]
        high = [math.inf if field is None else self._load * field.factor for field in velocity_fields]
        return np.array(low), np.array(high)


class FieldStatus(StrEnum):
    """How the computation by fields ended.

    CLOSED: the gap is reached. UNSTABLE: upper bound below 0, so the blocks collapse for every λ ≥ 0. OPEN: the gap is
    wider. NO_LOWER, NO_UPPER: that bound was not found. NO_TIME: one was not, as time ended on a mesh in space.
    """

    CLOSED = "closed"
    UNSTABLE = "unstable"
    OPEN = "open"
    NO_LOWER = "no lower bound"
    NO_UPPER = "no upper bound"
    NO_TIME = "no time"


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
    simplices: int  # number of triangles or tetrahedra
    # lower, upper: bounds on λ from this mesh alone, infinite where none was found
    lower: float
    upper: float
    seconds: float  # time since the start, s


@dataclass(frozen=True)
class Stresses:
    """Certified stress field, linear in each simplex."""

    mesh: Mesh  # simplices, scene units
    # stresses at the corners of each simplex, tension positive, scene units: (t, 3, 3) values (σx, σy, τxy) in the
    # plane, (t, 4, 3, 3) tensors in space
    stress: Floats


@dataclass(frozen=True)
class Velocities:
    """Certified velocity field, linear in each simplex; the live load does unit work on it."""

    mesh: Mesh  # simplices, scene units
    # (t, d + 1, d) velocities u at the corners of each simplex, scene units: b_λ·u = 1 for the live load b_λ of λ = 1
    velocity: Floats
    # (t,) power in each simplex with half of its sides, a work as b_λ·u. Their sum less the work of the dead load is λ.
    dissipation: Floats


@dataclass(frozen=True)
class FieldBounds:
    """Two-sided bound on λ of blocks that may fail in any way."""

    dimension: int  # 2 for triangles, 3 for tetrahedra
    lower: float = -math.inf  # λ that a certified stress field carries, −inf where none was found
    upper: float = math.inf  # λ that a certified velocity field allows, inf where none was found
    status: FieldStatus = FieldStatus.OPEN  # why the refinement ended
    history: tuple[FieldStep, ...] = ()  # one entry for each mesh
    stresses: Stresses | None = None  # field of the best lower bound
    velocities: Velocities | None = None  # field of the best upper bound

    @property
    def gap(self) -> float:
        """Width of the bracket over its larger end, inf where a bound is missing."""
        return relative_gap(self.lower, self.upper)

    @property
    def shape(self) -> str:
        return "triangles" if self.dimension == 2 else "tetrahedra"

    @property
    def simplices(self) -> int:
        return self.history[-1].simplices if self.history else 0

    @property
    def seconds(self) -> float:
        return self.history[-1].seconds if self.history else 0.0

    def improved(self, fields: Fields, seconds: float, gap: float) -> FieldBounds:
        """Return the better bounds with their fields, scene units, and one more step."""
        units, (lower, upper), best = fields.problem.units, fields.bounds, self
        if fields.stress is not None and lower > best.lower:
            stress = units.stress * tensors(fields.stress.stress)
            if self.dimension == 2:
                stress = np.stack([stress[..., 0, 0], stress[..., 1, 1], stress[..., 0, 1]], axis=-1)
            best = replace(best, lower=lower, stresses=Stresses(fields.split, stress))
        if fields.velocity is not None and upper < best.upper:
            velocity, power = units.velocity * fields.velocity.velocity, units.load * fields.velocity.dissipation
            best = replace(best, upper=upper, velocities=Velocities(fields.mesh, velocity, power))
        steps = (*best.history, FieldStep(len(fields.mesh), lower, upper, seconds))
        return replace(best, history=steps, status=status_of_bounds(best.lower, best.upper, gap))


def bounds_by_fields(
    assembly: Assembly,
    labels: Bits | None = None,
    *,
    gap: float | None = None,
    seconds: float | None = None,
    patch: float | None = None,
    parts: int = 1,
    adaptive: bool = True,
    most: int | None = None,
) -> FieldBounds:
    """Bound the load factor of blocks that may fail in any way, from both sides.

    Parameters
    ----------
    assembly : Assembly
        Assembly with one load case, in space of convex cells; blocks are made of its inner strengths.
    labels : (m,) bool array, optional
        True = dry joint; False = inside a block. By default the labels of the scene.
    gap : float, optional
        Width of the bracket, relative, at which refinement ends; above 0. By default 0.05, in space 0.15.
    seconds : float, optional
        No mesh is begun that is not expected to be done by then, save the first; in space even that one ends then. 0:
        the first mesh alone, whatever it takes. By default no limit, s.
    patch : float, optional
        Length of the patch that each live force on a free face is spread on; by default the whole face (docs/method.md
        (9.5)).
    parts : int
        Parts of each edge of the first mesh, in the plane.
    adaptive : bool
        Refine where the fields disagree; otherwise everywhere.
    most : int, optional
        Triangles or tetrahedra that no mesh exceeds, save the first. By default 20 000, in space 12 000.

    Returns
    -------
    FieldBounds
        The best of both bounds over all meshes, each checked without a solver. An upper bound below 0 ends refinement.

    Raises
    ------
    InputError
        Several load cases, a gap that is not above 0, and scenes that `material_of`, `loaded_mesh` or `loaded_solids`
        refuses.
    """
    refinement = FieldRefinement(
        assembly, labels, gap=gap, patch=patch, parts=parts, adaptive=adaptive, most=most, seconds=seconds
    )
    bounds = refinement.step()
    while not refinement.ended and (seconds is None or refinement.expected <= seconds):
        bounds = refinement.step()
    return bounds


class FieldRefinement:
    """Refinement of the bounds of one labelling, mesh by mesh: call `step` until `ended`.

    lower_first: raises the lower bound two to three times as fast in the plane, with an upper bound on every third
    mesh. seconds: time that meshes in space are fitted to.
    """

    def __init__(
        self,
        assembly: Assembly,
        labels: Bits | None = None,
        *,
        gap: float | None = None,
        patch: float | None = None,
        parts: int = 1,
        adaptive: bool = True,
        most: int | None = None,
        lower_first: bool = False,
        seconds: float | None = None,
    ) -> None:
        self._spent, start = 0.0, time.perf_counter()
        self._dimension = assembly.dimension
        self._gap = _GAP[self._dimension] if gap is None else gap
        self._labels = require_refinement(assembly, labels, self._gap, patch)
        if parts < 1:
            raise InputError("parts", f"{parts} is wrong", "a whole number of at least 1")
        self._adaptive, self._patch, self._seconds = adaptive, patch, seconds
        self._most = _MOST[self._dimension] if most is None else most
        self._setting = FieldSetting.of(assembly, patch, self._labels)
        self._mesh: Mesh | None = self._first(parts)
        self._best, self._lower_first = FieldBounds(self._dimension), lower_first
        self._unlayered: tuple[Fields, FieldSetting] | None = None  # of the first mesh, if its layers are tried
        self._times: dict[bool, tuple[int, float]] = {}  # with an upper bound: simplices and seconds of the last mesh
        self._spent += time.perf_counter() - start

    def _first(self, parts: int) -> Mesh:
        if self._dimension == 2:
            return subdivide(self._setting.coarse, parts)
        from jld_core.fields.rigid_joints import fitted_joints  # planar scenes do not load it

        return fitted_joints(self._setting.coarse, self._setting.problem, self._labels, self._gap)

    @property
    def ended(self) -> bool:
        """True if the gap is reached, λ < 0, or a bound missing after eight meshes.

        Or the next mesh hardly finer or too large.
        """
        return self._mesh is None

    @property
    def spent(self) -> float:
        """Time spent in the constructor and all steps so far, seconds."""
        return self._spent

    @property
    def upper_due(self) -> bool:
        """True if the next step computes an upper bound unless told otherwise."""
        return not self._lower_first or len(self._best.history) % _UPPER_EACH == 0

    @property
    def expected(self) -> float:
        """Expected value of `spent` after one more step, seconds, extrapolated from earlier steps."""
        return self.expected_with(self.upper_due)

    def expected_with(self, upper: bool) -> float:
        """Return the expected value of `spent`, s, after a step with or without an upper bound."""
        last = self._times.get(upper) or self._times.get(True)
        if last is None:
            return self._spent
        simplices, seconds = last
        return float(self._spent + seconds * (self.simplices / simplices) ** _GROWTH[self._dimension])

    @property
    def simplices(self) -> int:
        """Number of triangles or tetrahedra of the next mesh, 0 if refinement has ended."""
        return 0 if self._mesh is None else len(self._mesh)

    def step(self, upper: bool | None = None) -> FieldBounds:
        """Solve the next mesh; return the best of both bounds so far. ValueError if ended."""
        if self._mesh is None:
            raise ValueError("refinement has ended; expected a step before")
        start, mesh = time.perf_counter(), self._mesh
        with_velocities = self.upper_due if upper is None else upper
        # 0: one mesh, however long; the first one of a dome of 32 cells takes minutes
        limited = self._dimension == 3 and bool(self._seconds)
        deadline = Deadline(max((self._seconds or 0.0) - self._spent, 0.0) + _GRACE if limited else None)
        with deadline.enforced():
            fields = Fields.on(self._setting, mesh, self._labels, velocities=with_velocities)
        seconds = time.perf_counter() - start
        self._times[with_velocities] = len(mesh), seconds
        self._best = self._best.improved(fields, self._spent + seconds, self._gap)
        status = self._best.status
        if deadline.passed() and status in (FieldStatus.NO_LOWER, FieldStatus.NO_UPPER):
            self._best = replace(self._best, status=FieldStatus.NO_TIME)
        # without one of the bounds refinement helps only so far
        one_sided = status is not FieldStatus.OPEN and len(self._best.history) >= _PATIENCE
        ended = status in (FieldStatus.CLOSED, FieldStatus.UNSTABLE) or one_sided
        self._mesh = None if ended else self._next(fields, self._spent + seconds)
        self._spent += time.perf_counter() - start
        return self._best

    def _next(self, fields: Fields, spent: float) -> Mesh | None:
        """Return the next mesh, None where it would be too large or hardly finer."""
        most_simplices = self._most
        if self._dimension == 3:
            if self._seconds is not None:
                simplices, took = self._times[True]
                seconds_left = max(self._seconds - spent, 0.0)
                most_simplices = min(most_simplices, int(simplices * (seconds_left / took) ** (1.0 / _GROWTH[3])))
            layered = self._cut_in_layers(fields) if self._adaptive and len(self._best.history) == 1 else None
            if layered is not None and len(layered.coarse) <= most_simplices:
                self._unlayered, self._setting = (fields, self._setting), layered
                return layered.coarse
            if self._unlayered is not None:
                cases = self._unlayered, (fields, self._setting)
                fields, self._setting = min(cases, key=lambda case: relative_gap(*case[0].bounds))
                self._unlayered = None
        finer = fields.finer(self._adaptive, steps=not self._lower_first, most=most_simplices)
        grown = len(finer) > _LEAST_GROWTH[self._dimension] * len(fields.mesh)
        return finer if grown and len(finer) <= most_simplices else None

    def _cut_in_layers(self, fields: Fields) -> FieldSetting | None:
        """Return the setting with deforming long or flat cells cut in layers, None where none is."""
        if fields.velocity is None:
            return None
        shares = np.bincount(fields.mesh.cell, np.maximum(fields.velocity.dissipation, 0.0))
        mesh = fields.mesh
        loads = np.hstack([self._setting.loads.dead, self._setting.loads.live])
        cut = []
        for cell in np.flatnonzero(shares > _DEFORMS * shares.sum()).tolist():
            # only a cell of uniform body forces may be filled with other tetrahedra without a change of its loads
            of_cell = loads[np.unique(mesh.root[mesh.cell == cell])]
            if (np.ptp(of_cell, axis=0) <= tolerances.ROUNDING * abs(of_cell).max(initial=0.0)).all():
                cut.append(cell)
        try:
            layered = FieldSetting.of(self._setting.assembly, self._patch, self._labels, tuple(cut)) if cut else None
        except InputError:
            # the scene itself was accepted before: only its layers do not fit, and the bounds hold without them
            return None
        return layered if layered is not None and len(layered.coarse) > len(mesh) else None


def governing_bounds(
    assembly: Assembly, labels: Bits, seconds: float, *, gap: float = 0.05, lower_first: bool = True
) -> tuple[float, float]:
    """Bound the governing load factor of a planar layout whose blocks crack anywhere.

    Raises InputError as `bounds_by_fields`.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    labels : (m,) array of bool
        True = dry.
    seconds : float
        Time after which no mesh is refined, s.
    gap : float
        Relative width to reach.
    lower_first : bool
        Begin with the lower bound.

    Returns
    -------
    (float, float)
        Proven bounds on the least λ / required of all cases, infinite where none was found.
    """
    # Each step refines the mesh of the load case with the least lower bound, since the lower bound on the governing
    # factor is that one. Cases that do not govern keep their coarse mesh.
    deadline = Deadline(seconds)
    required = assembly.required.tolist()
    cases = [FieldRefinement(case, labels, gap=gap, lower_first=lower_first) for case in assembly.by_case]
    bounds = [case.step() for case in cases]
    while True:
        low = np.array([bound.lower / factor for bound, factor in zip(bounds, required, strict=True)])
        high = np.array([bound.upper / factor for bound, factor in zip(bounds, required, strict=True)])
        # the upper bound of any case bounds the governing factor
        governing = int(np.lexsort((high, low))[0])
        case, seconds_left = cases[governing], deadline.remaining()
        if case.ended or high.min() < 0.0 or relative_gap(float(low.min()), float(high.min())) <= gap:
            break
        upper = case.upper_due and case.expected - case.spent <= seconds_left
        if case.expected_with(upper) - case.spent > seconds_left:
            break
        bounds[governing] = case.step(upper)
    return float(low.min()), float(high.min())


# Multiples of a motion under the dead load alone that are added to a mechanism, in the order tried
_MULTIPLES: Final = (1e2, 1e4, 1e6)

# Largest distance of the bound of a repaired field from the solver's objective, relative, at which nothing else is
# tried
_OPENING_COST: Final = 1e-3

_LEAST: Final = -1.0  # scaled bound that is stated for collapse under the dead load alone: any larger bound holds too


@dataclass(frozen=True)
class WeighedField:
    """Velocity field with the bound that it proves for a partial labelling."""

    velocity: Floats  # (t, 3, 2) velocities at the corners of the triangles, scaled
    mechanism: FieldMechanism  # dissipation of the field in the blocks and on faces, scene units of λ
    bound: float  # λ that no labelling exceeds that agrees on the decided faces, scene units


class PartialUpperBound:
    """Upper bounds on λ of partial labellings on one mesh; many: see `ConeProgram`."""

    def __init__(self, problem: Problem, many: bool = False) -> None:
        self._upper, self._many = UpperBound(problem, many), many
        joints, material = problem.joints, problem.material
        # the flow rule that asks for more opening is the one that undecided faces are moved onto
        self._as_dry = (joints.friction >= material.friction) & np.isinf(joints.crushing)
        self.solves = 0

    def field(self, labels: Bits, undecided: Bools) -> WeighedField | None:
        """Find the velocity field with the least bound for a partial labelling; None where none is finite."""
        problem = self._upper.problem
        self.solves += 1
        answer = self._upper.propose(labels, undecided)
        ray = answer.status == "DualInfeasible"
        if not (answer.usable or ray):
            return None
        velocity = answer.point[: 6 * len(problem.mesh)].reshape(-1, 3, 2)
        if ray:
            return self._along(velocity, labels, undecided)
        good_bound = (answer.objective + _OPENING_COST * abs(answer.objective)) * problem.units.load
        field = self._repair(velocity, labels, undecided, good_bound)
        if field is not None and field.bound <= good_bound:
            return field
        settled = self._settling.settled(velocity, problem.is_dry(np.where(undecided, self._as_dry, labels)))
        fields = [field, self._repair(settled, labels, undecided, good_bound)]
        return min((field for field in fields if field is not None), key=lambda field: field.bound, default=None)

    @cached_property
    def _settling(self) -> Settling:
        return Settling(self._upper.problem)

    @cached_property
    def _without_dead_load(self) -> PartialUpperBound:
        return PartialUpperBound(self._upper.problem.without_dead_load(), self._many)

    def weigh(self, velocity: Floats) -> FieldMechanism | None:
        """Compute the bounds that velocities (t, 3, 2) prove, without a solver; None where they prove nothing."""
        return mechanism_bounds(self._upper, velocity)

    def finer(self, mesh: Mesh, velocity: Floats, labels: Bits, undecided: Bools) -> Mesh:
        """Refine the mesh where a velocity field dissipates most, undecided faces taken as inner."""
        upper = self._upper
        power = upper.power(upper.rates(velocity), labels & ~undecided, upper.allowance(velocity))
        area = mesh.volume
        error = power / max(float(power.sum()), 1e-300) + _EVERYWHERE[2] * area / float(area.sum())
        error = np.where(area < _LEAST_AREA * area.sum(), 0.0, error)
        return refine(mesh, _leading(error, _SHARE, _MOST_MARKED[2]))

    def _repair(self, velocity: Floats, labels: Bits, undecided: Bools, good_bound: float) -> WeighedField | None:
        """Repair velocities by each of `REPAIRED`; return those of least bound, or None."""
        # The first with a bound of at most `good_bound` (λ, scene units) ends the attempts.
        best: WeighedField | None = None
        for share in REPAIRED:
            moved = self._upper.repaired(velocity, share)
            mechanism = mechanism_bounds(self._upper, moved)
            bound = np.inf if mechanism is None else mechanism.bound_of(labels, undecided)
            if mechanism is not None and np.isfinite(bound) and (best is None or bound < best.bound):
                best = WeighedField(moved, mechanism, float(bound))
                if bound <= good_bound:
                    break
        return best

    def _along(self, ray: Floats, labels: Bits, undecided: Bools) -> WeighedField | None:
        """Return a field that proves collapse under the dead load alone, or None."""
        # The field is a mechanism of the live load plus a large multiple of `ray`, (t, 3, 2), along which the program
        # is unbounded.
        size = float(abs(ray).max())
        base = self._without_dead_load.field(labels, undecided)
        if base is None or not size > 0.0:
            return None
        ray = ray * (float(abs(base.velocity).max()) / size)
        below_zero = _LEAST * self._upper.problem.units.load
        for multiple in _MULTIPLES:
            field = self._repair(base.velocity + multiple * ray, labels, undecided, below_zero)
            if field is not None and field.bound <= below_zero:
                return WeighedField(field.velocity, field.mechanism, below_zero)
        return None
