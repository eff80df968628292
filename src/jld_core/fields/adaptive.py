"""Stress and velocity field of one labelling on one mesh, and the choice of the next mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.fields.loads import FieldLoads, loaded_mesh
from jld_core.fields.lower import LowerBound, StressField
from jld_core.fields.material import Material, material_of
from jld_core.fields.mesh import Mesh, fanned, refine
from jld_core.fields.problem import Problem, Units, problem_of, units_of
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
    """Data that all meshes and labellings of one assembly share.

    assembly: planar assembly with one load case. material: material of the blocks, scene units. coarse: coarsest mesh.
    loads: loads over it.
    """

    assembly: Assembly
    material: Material
    units: Units
    coarse: Mesh
    loads: FieldLoads

    @classmethod
    def of(cls, assembly: Assembly, patch: float | None = None) -> FieldSetting:
        """Compute material, units, coarsest mesh and loads of a planar assembly.

        patch: length that each force on a free face is spread on; None: the whole face (see `loaded_mesh`). Raises
        InputError as `material_of` and `loaded_mesh` do.
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
    """Certified fields of one labelling on one mesh.

    mesh: triangles, scene coordinates. labels: (m,) True = dry. lower: program of the stresses, scaled. upper: program
    of the velocities, scaled. stress: stress field, None where none was certified. velocity: velocity field, None where
    none was certified.
    """

    mesh: Mesh
    labels: Bits
    lower: LowerBound
    upper: UpperBound
    stress: StressField | None
    velocity: VelocityField | None

    @classmethod
    def on(
        cls, setting: FieldSetting, mesh: Mesh, labels: Bits, enough: float = -math.inf, *, velocities: bool = True
    ) -> Fields:
        """Solve for both fields of one labelling on one mesh.

        mesh: refined from `setting.coarse`, scene units. labels: (m,) True = dry. enough: λ in scene units. Where the
        upper bound lies below it, no stress field is computed and `stress` is None. velocities: False leaves the
        velocity field out, so that `velocity` is None. Nothing is raised where a solver fails: the field is then None.
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

        labels: (m,) True = dry. Result: bound: upper bound, inf where no velocity field was certified; scene units;
        mechanism: bounds of other labellings by the same field; None where it proves none.
        """
        found = self._upper.bound(labels)
        if found is None:
            return math.inf, None
        return self._load * found.factor, mechanism_of(self._upper, found, labels)

    def lower(self, labels: Bits) -> tuple[float, FieldStresses | None]:
        """Bound λ of one labelling from below.

        labels: (m,) True = dry. Result: bound: lower bound, −inf where no stress field was certified; scene units;
        stresses: bounds of other labellings by the same field; None without a field.
        """
        found = self._lower.bound(labels)
        return (
            (-math.inf, None) if found is None else (self._load * found.factor, stresses_of(self._lower, found, labels))
        )

    def both(self, labellings: Bits) -> tuple[Floats, Floats]:
        """Bound λ of several labellings from both sides.

        labellings: (k, m) True = dry. Returns (k,): bounds, infinite where no field was certified; scene units.
        """
        lower, upper = self._lower.bound_all(labellings), self._upper.bound_all(labellings)
        low = [-math.inf if found is None else self._load * found.factor for found in lower]
        high = [math.inf if found is None else self._load * found.factor for found in upper]
        return np.array(low), np.array(high)


def _marks(problem: Problem, stress: StressField | None, velocity: VelocityField | None, wanted: float) -> Bools:
    """Mark the triangles to split, (t,) True, by the criterion of docs/method.md (9.12).

    stress: None marks all but the smallest triangles. velocity: None leaves the disagreement of the fields out. wanted:
    share of the summed criterion that the marked triangles hold, 0 to 1. With the disagreement alone as criterion the
    lower bound stalls: on the flagship [5.89, 6.49] instead of [6.15, 6.46] in 3 s.
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

    error: (t,), at least 0. wanted: the share, 0 to 1. No more than `_MOST_MARKED` of all are marked.
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
    """Return the corner (t,) at which to bisect each triangle, −1 for no preference.

    A corner counts if it holds most of `stress.rate` of its triangle and its angle is wide. Stresses jump at ends of
    loads and at corners of blocks; only a fan of triangles about such a node can follow. Without `stress` all are −1.
    """
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
    """Compute each triangle's share (t,) of the gap between the bounds, scaled λ.

    The share is the dissipation of the velocity field minus the power of the stress field on its strain rates. Half of
    the dissipation of an edge belongs to each of its triangles. Up to the opening that `UpperBound.certify` added, the
    sum is upper less lower bound. Both fields belong to `problem` and one labelling; the result steers refinement.
    """
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
