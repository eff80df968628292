"""Two-sided bounds on λ of spatial blocks, refined where the two fields disagree."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.bounds import FieldStatus, relative_gap, status_of_bounds
from jld_core.fields.material import material_of
from jld_core.fields.requirements import require_refinement
from jld_core.fields.space_adaptive import SpatialFields, SpatialSetting
from jld_core.fields.space_cones import tensors
from jld_core.fields.space_joints import fitted_joints
from jld_core.fields.space_loads import loaded_solids
from jld_core.fields.space_mesh import SolidMesh

_MOST_TETRAHEDRA = 12_000  # tetrahedra at which refinement ends: programs of more take many minutes and gigabytes

_POWER = 1.7  # exponent of the number of tetrahedra in the time of both programs, to predict the time of the next mesh

_LEAST_GROWTH = 1.05  # growth of a mesh below which it is not worth its time

_PATIENCE = 8  # number of meshes after which refinement ends if a bound is still missing


@dataclass(frozen=True)
class SpatialStep:
    """Bounds on one mesh.

    tetrahedra: number of tetrahedra. lower, upper: bounds on λ from this mesh alone, infinite where none was found.
    seconds: wall-clock time since the start, s.
    """

    tetrahedra: int
    lower: float
    upper: float
    seconds: float


@dataclass(frozen=True)
class SpatialStresses:
    """Certified stress field, linear in each tetrahedron.

    mesh: tetrahedra, scene units. stress: (t, 4, 3, 3) stresses at the four corners of each tetrahedron, tension
    positive, scene units.
    """

    mesh: SolidMesh
    stress: Floats


@dataclass(frozen=True)
class SpatialVelocities:
    """Certified velocity field, linear in each tetrahedron; the live load does unit work.

    mesh: tetrahedra, scene units. velocity: (t, 4, 3) velocities u at the four corners of each tetrahedron, scene
    units: b_λ·u = 1 for the live load b_λ of λ = 1. dissipation: (t,) power in each tetrahedron with half of its
    triangles, a work as b_λ·u. Their sum less the work of the dead load is λ.
    """

    mesh: SolidMesh
    velocity: Floats
    dissipation: Floats


@dataclass(frozen=True)
class SpatialBounds:
    """Two-sided bound on λ of spatial blocks that may fail in any way.

    lower: λ that a certified stress field carries, −inf where none was found. upper: λ that a certified velocity field
    allows, inf where none was found. status: why the refinement ended. tetrahedra: number of tetrahedra of the last
    mesh. seconds: wall-clock time, s. history: one entry for each mesh. stresses: field of the best lower bound.
    velocities: field of the best upper bound.
    """

    lower: float
    upper: float
    status: FieldStatus
    tetrahedra: int
    seconds: float
    history: tuple[SpatialStep, ...]
    stresses: SpatialStresses | None
    velocities: SpatialVelocities | None

    @property
    def gap(self) -> float:
        """Width of the bracket over its larger end, inf where a bound is missing."""
        return relative_gap(self.lower, self.upper)


def spatial_bounds(
    assembly: Assembly,
    labels: Bits | None = None,
    *,
    gap: float = 0.15,
    seconds: float | None = None,
    patch: float | None = None,
    adaptive: bool = True,
    most_tetrahedra: int = _MOST_TETRAHEDRA,
) -> SpatialBounds:
    """Bound the load factor of spatial blocks that may fail in any way, from both sides.

    assembly: spatial assembly with one load case, of convex cells; blocks are made of its inner strengths. labels: (m,)
    True = dry joint; False = inside a block. By default those of the scene. gap: width of the bracket, relative, at
    which refinement ends; above 0. seconds: no mesh is begun that is not expected to be done by then; the first one
    always is. patch: side of the square that each force on a free face is spread on; by default the whole face
    (docs/method.md (10.3)). adaptive: refine where the fields disagree; otherwise everywhere. most_tetrahedra:
    tetrahedra that no mesh exceeds, save the first. Result: the best of both bounds over all meshes, each checked
    without a solver. An upper bound below 0 ends refinement. Raises InputError: planar scenes, load cases, a gap that
    is not above 0, and what `material_of` and `loaded_solids` refuse.
    """
    start = time.perf_counter()
    labels = _require(assembly, labels, gap, patch)
    run = _Refinement(start, gap, seconds, most_tetrahedra)
    mesh, loads = loaded_solids(assembly, patch, labels)
    setting = SpatialSetting.of(assembly, labels, loads)
    fields = run.solve(setting, fitted_joints(mesh, setting.problem, gap))
    layered = _layered(setting, fields, patch) if adaptive and not run.ended else None
    if layered is not None and run.allows(layered[1]):
        fields, setting = _narrower((fields, setting), (run.solve(*layered), layered[0]))
    while not run.ended:
        mesh = fields.finer(adaptive, run.most)
        if len(mesh) < _LEAST_GROWTH * len(fields.mesh) or not run.allows(mesh):
            break
        fields = run.solve(setting, mesh)
    return run.best


class _Refinement:
    """Best bounds of a sequence of meshes, and whether there is time and need for another one.

    start: time at which `seconds` begin, s by `time.perf_counter`. most: greatest number of tetrahedra.
    """

    def __init__(self, start: float, gap: float, seconds: float | None, most: int) -> None:
        self._start, self._gap, self._seconds, self._most = start, gap, seconds, most
        self._last = 0, 0.0
        self.best = SpatialBounds(-math.inf, math.inf, FieldStatus.OPEN, 0, 0.0, (), None, None)

    @property
    def ended(self) -> bool:
        """True if the gap is reached, `upper` is below 0, or a bound remains missing.

        A bound that is missing after `_PATIENCE` meshes is not waited for.
        """
        status = self.best.status
        lone = status is not FieldStatus.OPEN and len(self.best.history) >= _PATIENCE
        return status in (FieldStatus.CLOSED, FieldStatus.UNSTABLE) or lone

    @property
    def most(self) -> int:
        """Largest number of tetrahedra of a mesh that fits the limit and the time left.

        The time is extrapolated from the last mesh.
        """
        if self._seconds is None:
            return self._most
        count, took = self._last
        left = max(self._seconds - (time.perf_counter() - self._start), 0.0)
        return min(self._most, int(count * (left / took) ** (1.0 / _POWER)))

    def allows(self, mesh: SolidMesh) -> bool:
        """Return True if a mesh is small enough, and expected to be done in time."""
        return len(mesh) <= self.most

    def solve(self, setting: SpatialSetting, mesh: SolidMesh) -> SpatialFields:
        """Solve for both fields on a mesh, take their bounds over into `best`, and return them."""
        began = time.perf_counter()
        fields = SpatialFields.on(setting, mesh)
        now = time.perf_counter()
        self._last = len(mesh), now - began
        self.best = _improved(self.best, fields, now - self._start, self._gap)
        return fields


def _layered(
    setting: SpatialSetting, fields: SpatialFields, patch: float | None
) -> tuple[SpatialSetting, SolidMesh] | None:
    """Cut long or flat cells that deform into layers; return new setting and coarsest mesh.

    fields: decide which cells deform. patch: as in `loaded_solids`. None if no cell is cut, if the mesh would not grow,
    or if the layers do not fit.
    """
    cut = tuple(cell for cell in fields.deforming().tolist() if setting.uniform(cell, fields.mesh))
    try:
        mesh, loads = loaded_solids(setting.assembly, patch, setting.labels, cut)
    except InputError:
        # the scene itself was accepted before: only its layers do not fit, and the bounds hold without them
        return None
    if not cut or len(mesh) <= len(fields.mesh):
        return None
    return replace(setting, loads=loads), mesh


_Case = tuple[SpatialFields, SpatialSetting]  # fields on a mesh, and the setting of that mesh


def _narrower(one: _Case, other: _Case) -> _Case:
    """Return the case with the smaller relative gap of its bounds, the first of equal ones."""
    return min(one, other, key=lambda case: relative_gap(case[0].lower, case[0].upper))


def _improved(best: SpatialBounds, fields: SpatialFields, seconds: float, gap: float) -> SpatialBounds:
    """Return `best` with each bound that the fields improve, and a further step.

    Bounds are in scene units. seconds: since the start. gap: relative, for the status.
    """
    units, lower, upper = fields.problem.units, fields.lower, fields.upper
    if fields.stress is not None and lower > best.lower:
        held = SpatialStresses(fields.split, units.stress * tensors(fields.stress.stress))
        best = replace(best, lower=lower, stresses=held)
    if fields.velocity is not None and upper < best.upper:
        velocity, power = units.velocity * fields.velocity.velocity, units.load * fields.velocity.dissipation
        moved = SpatialVelocities(fields.mesh, velocity, power)
        best = replace(best, upper=upper, velocities=moved)
    steps = (*best.history, SpatialStep(len(fields.mesh), lower, upper, seconds))
    best = replace(best, tetrahedra=len(fields.mesh), seconds=seconds, history=steps)
    return replace(best, status=status_of_bounds(best.lower, best.upper, gap))


def require_spatial_fields(assembly: Assembly) -> None:
    """Raise InputError if fields cannot bound λ of a spatial assembly, whatever its labels.

    assembly: assembly, with or without load cases. Raises InputError: members, inner strengths that are missing, zero
    or different, cells that are not convex, loads without room for their patch, and interfaces that no mesh fits.
    """
    material_of(assembly)
    for case in assembly.by_case:
        loaded_solids(case)


def _require(assembly: Assembly, labels: Bits | None, gap: float, patch: float | None) -> Bits:
    """Check the arguments of `spatial_bounds`, and return the labels (m,).

    Raises InputError for a planar assembly, and for all that `require_refinement` refuses.
    """
    if assembly.dimension != 3:
        raise InputError("cracks", "fields in tetrahedra are for spatial scenes", "`bounds_by_fields`")
    return require_refinement(assembly, labels, gap, patch)
