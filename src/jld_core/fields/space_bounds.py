"""Two-sided bounds on λ of spatial blocks, refined where the two fields disagree."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.bounds import FieldStatus
from jld_core.fields.material import Material, material_of
from jld_core.fields.problem import Units
from jld_core.fields.requirements import require_labels
from jld_core.fields.space_cones import normal_map, tensors
from jld_core.fields.space_loads import SpatialLoads, loaded_solids
from jld_core.fields.space_lower import SpatialLowerBound, SpatialStress
from jld_core.fields.space_mesh import SolidMesh, bisect
from jld_core.fields.space_problem import SpatialProblem, spatial_problem, spatial_units
from jld_core.fields.space_upper import SpatialUpperBound, SpatialVelocity

_MOST_TETRAHEDRA = 12_000
"""Tetrahedra at which refinement ends: programs of more take many minutes and gigabytes."""

_SHARE = 0.6
"""Share of the indicator that marked tetrahedra hold together (Dörfler marking)."""

_MOST_MARKED = 0.3
"""Largest share of tetrahedra that one refinement marks."""

_EVERYWHERE = 0.1
"""Share of the volume in the indicator, so that no tetrahedron stays coarse for ever."""

_GROWTH = 1.7
"""Power of the number of tetrahedra that the time of both programs grows with, for the forecast of the next mesh."""

_PATIENCE = 8
"""Meshes after which bounds of which one is missing are given up."""


@dataclass(frozen=True)
class SpatialStep:
    """Bounds on one mesh.

    Attributes
    ----------
    tetrahedra : int
        Number of tetrahedra.
    lower, upper : float
        Bounds on λ from this mesh alone, infinite where none was found.
    seconds : float
        Wall-clock time since the start, s.
    """

    tetrahedra: int
    lower: float
    upper: float
    seconds: float


@dataclass(frozen=True)
class SpatialStresses:
    """Certified stress field, linear in each tetrahedron.

    Attributes
    ----------
    mesh : SolidMesh
        Tetrahedra, scene units.
    stress : (t, 4, 3, 3) float array
        Stresses at the four corners of each tetrahedron, tension positive, scene units.
    """

    mesh: SolidMesh
    stress: Floats


@dataclass(frozen=True)
class SpatialVelocities:
    """Certified velocity field, linear in each tetrahedron, for which the live load does one unit of work.

    Attributes
    ----------
    mesh : SolidMesh
        Tetrahedra, scene units.
    velocity : (t, 4, 3) float array
        Velocities at the four corners of each tetrahedron, scene units.
    dissipation : (t,) float array
        Share of each tetrahedron, with half of its triangles, in the dissipation.
    """

    mesh: SolidMesh
    velocity: Floats
    dissipation: Floats


@dataclass(frozen=True)
class SpatialBounds:
    """Two-sided bound on λ of spatial blocks that may fail in any way.

    Attributes
    ----------
    lower : float
        λ that a certified stress field carries, −inf where none was found.
    upper : float
        λ that a certified velocity field allows, inf where none was found.
    status : FieldStatus
        Why the refinement ended.
    tetrahedra : int
        Number of tetrahedra of the last mesh.
    seconds : float
        Wall-clock time, s.
    history : tuple of SpatialStep
        One entry for each mesh.
    stresses : SpatialStresses or None
        Field of the best lower bound.
    velocities : SpatialVelocities or None
        Field of the best upper bound.
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
        if not (math.isfinite(self.lower) and math.isfinite(self.upper)):
            return math.inf
        return (self.upper - self.lower) / max(abs(self.upper), abs(self.lower), 1e-300)


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

    Parameters
    ----------
    assembly : Assembly
        Spatial assembly with one load case, of convex cells; blocks are made of its inner strengths.
    labels : (m,) bool array, optional
        True = dry joint; False = inside a block. By default those of the scene.
    gap : float
        Width of the bracket, relative, at which refinement ends; above 0.
    seconds : float, optional
        No mesh is begun that is not expected to be done by then; the first one always is.
    patch : float, optional
        Side of the square that each live force on a free face is spread on; by default the whole face (docs/method.md
        (9.15)).
    adaptive : bool
        Refine where the fields disagree; otherwise everywhere.
    most_tetrahedra : int
        Tetrahedra that no mesh exceeds, save the first.

    Returns
    -------
    SpatialBounds
        The best of both bounds over all meshes, each checked without a solver. An upper bound below 0 ends refinement.

    Raises
    ------
    InputError
        Planar scenes, load cases, a gap that is not above 0, and what `material_of` and `loaded_solids` refuse.
    """
    start = time.perf_counter()
    labels = _require(assembly, labels, gap, patch)
    material, units = material_of(assembly), None
    mesh, loads = loaded_solids(assembly, patch)
    units = spatial_units(assembly, material)
    setting = _Setting(assembly, labels, material, units, loads)
    best = SpatialBounds(-math.inf, math.inf, FieldStatus.OPEN, 0, 0.0, (), None, None)
    while True:
        began = time.perf_counter()
        fields = _Fields.on(setting, mesh)
        now = time.perf_counter()
        best = fields.improved(best, now - start, gap)
        lone = best.status is not FieldStatus.OPEN and len(best.history) >= _PATIENCE
        if best.status in (FieldStatus.CLOSED, FieldStatus.UNSTABLE) or lone:
            return best
        finer = bisect(mesh, fields.marks(adaptive))
        growth = (len(finer) / len(mesh)) ** _GROWTH
        late = seconds is not None and now - start + growth * (now - began) > seconds
        if late or len(finer) > most_tetrahedra or len(finer) == len(mesh):
            return best
        mesh = finer


def require_spatial_fields(assembly: Assembly, patch: float | None = None) -> None:
    """Raise InputError if λ of a spatial assembly cannot be bounded by fields, whatever its labels.

    Parameters
    ----------
    assembly : Assembly
        Assembly, with or without load cases.
    patch : float, optional
        As in `spatial_bounds`.

    Raises
    ------
    InputError
        Inner strengths that are missing, zero or different, cells that are not convex, loads without room for their
        patch, and interfaces that no mesh fits.
    """
    material_of(assembly)
    for case in assembly.by_case:
        loaded_solids(case, patch)


def _require(assembly: Assembly, labels: Bits | None, gap: float, patch: float | None) -> Bits:
    """Return the labels; raise InputError for what cannot be bounded."""
    if assembly.dimension != 3:
        raise InputError("cracks", "fields in tetrahedra are for spatial scenes", "`bounds_by_fields`")
    if len(assembly.cases) > 1:
        raise InputError("loads.cases", "fields take one load case", "one of Assembly.by_case")
    if not gap > 0.0:
        raise InputError("gap", f"{gap:g} is never reached", "a number above 0")
    if patch is not None and not patch > 0.0:
        raise InputError("patch", f"{patch:g} is wrong", "a length above 0")
    return require_labels(assembly, labels)


@dataclass(frozen=True)
class _Setting:
    """What all meshes of one labelling have in common."""

    assembly: Assembly
    labels: Bits
    material: Material
    units: Units
    loads: SpatialLoads


@dataclass(frozen=True)
class _Fields:
    """Both certified fields on one mesh, None where none was certified."""

    mesh: SolidMesh
    problem: SpatialProblem
    stress: SpatialStress | None
    velocity: SpatialVelocity | None

    @classmethod
    def on(cls, setting: _Setting, mesh: SolidMesh) -> _Fields:
        """Solve for both fields."""
        s = setting
        problem = spatial_problem(s.assembly, s.labels, s.material, s.units, mesh, s.loads)
        return cls(mesh, problem, SpatialLowerBound(problem).bound(), SpatialUpperBound(problem).bound())

    def improved(self, best: SpatialBounds, seconds: float, gap: float) -> SpatialBounds:
        """Return the best bounds of those before and these, scene units, with their status."""
        units, lower, upper = self.problem.units, -math.inf, math.inf
        if self.stress is not None:
            lower = units.load * self.stress.factor
            if lower > best.lower:
                held = SpatialStresses(self.mesh, units.stress * tensors(self.stress.stress))
                best = replace(best, lower=lower, stresses=held)
        if self.velocity is not None:
            upper = units.load * self.velocity.factor
            if upper < best.upper:
                moved = SpatialVelocities(self.mesh, self.velocity.velocity, self.velocity.dissipation)
                best = replace(best, upper=upper, velocities=moved)
        steps = (*best.history, SpatialStep(len(self.mesh), lower, upper, seconds))
        best = replace(best, tetrahedra=len(self.mesh), seconds=seconds, history=steps)
        status = FieldStatus.CLOSED if best.gap <= gap else FieldStatus.OPEN
        if best.upper < 0.0:
            status = FieldStatus.UNSTABLE
        elif not math.isfinite(best.lower):
            status = FieldStatus.NO_LOWER
        elif not math.isfinite(best.upper):
            status = FieldStatus.NO_UPPER
        return replace(best, status=status)

    def marks(self, adaptive: bool) -> Bools:
        """Tetrahedra to split (t,): where the fields disagree, where the stress field is weak, a little everywhere."""
        volume = self.problem.mesh.volume
        if not adaptive or self.stress is None:
            return np.ones(len(volume), dtype=bool)
        parts = [np.maximum(self.stress.rate, 0.0)]
        if self.velocity is not None:
            parts.append(np.maximum(disagreement(self.problem, self.stress, self.velocity), 0.0))
        error = _EVERYWHERE * volume / volume.sum()
        for part in parts:
            error = error + part / max(float(part.sum()), 1e-300)
        order = np.argsort(-error, kind="stable")
        share = np.cumsum(error[order])
        enough = int(np.searchsorted(share, _SHARE * share[-1])) + 1
        marks = np.zeros(len(volume), dtype=bool)
        marks[order[: min(enough, max(1, int(_MOST_MARKED * len(volume))))]] = True
        return marks


def disagreement(problem: SpatialProblem, stress: SpatialStress, velocity: SpatialVelocity) -> Floats:
    """Return dissipation less stress power (t,), each tetrahedron with half of its triangles.

    Both fields are scaled; the sum is that of the scaled bounds.
    """
    p, s, v = problem, problem.sides, velocity.velocity
    slope = np.einsum("tki,tkj->tij", v, p.mesh.gradient)
    power = p.mesh.volume * np.einsum("tij,tij->t", tensors(stress.stress.mean(axis=1)), slope)
    rows = np.flatnonzero((s.b >= 0) | (p.face >= 0))
    jump = -v[s.a[rows][:, None], s.corner_a[rows]]
    both = s.b[rows] >= 0
    jump[both] += v[s.b[rows[both]][:, None], s.corner_b[rows[both]]]
    own = stress.stress[s.a[rows][:, None], s.corner_a[rows]]
    pull = np.einsum("fij,fkj->fki", normal_map(s.normal[rows]), own)
    ends = np.einsum("fki,fki->f", pull, jump) + np.einsum("fi,fi->f", pull.sum(axis=1), jump.sum(axis=1))
    total = s.area[rows] * ends / 12.0
    np.add.at(power, s.a[rows], np.where(both, 0.5, 1.0) * total)
    np.add.at(power, s.b[rows[both]], 0.5 * total[both])
    return np.asarray(velocity.dissipation - power)
