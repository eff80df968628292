"""Two-sided bounds on λ of spatial blocks, refined where the two fields disagree."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.bounds import FieldStatus, relative_gap, status_of_bounds
from jld_core.fields.material import Material, material_of
from jld_core.fields.problem import Units
from jld_core.fields.requirements import require_refinement
from jld_core.fields.space_cones import normal_map, tensors
from jld_core.fields.space_loads import SpatialLoads, loaded_solids
from jld_core.fields.space_lower import SpatialLowerBound, SpatialStress
from jld_core.fields.space_mesh import SolidMesh, bisect, split_at_centroids
from jld_core.fields.space_problem import SpatialProblem, spatial_problem, spatial_units
from jld_core.fields.space_upper import SpatialUpperBound, SpatialVelocity

_MOST_TETRAHEDRA = 12_000
"""Tetrahedra at which refinement ends: programs of more take many minutes and gigabytes."""

_SHARE = 0.5
"""Share of the indicator that tetrahedra hold together which are marked at a time (Dörfler marking)."""

_MOST_MARKED = 0.3
"""Largest share of tetrahedra that are marked at a time."""

_GROWTH = 1.5
"""Number of tetrahedra of the next mesh over that of the last: marks are set and halved again until it is reached."""

_EVERYWHERE = 0.02
"""Share of the volume in the indicator, so that no tetrahedron stays coarse for ever."""

_POWER = 1.7
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
        (10.3)).
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
    mesh, loads = loaded_solids(assembly, patch, labels)
    setting = _Setting.of(assembly, labels, loads)
    best = SpatialBounds(-math.inf, math.inf, FieldStatus.OPEN, 0, 0.0, (), None, None)
    while True:
        began = time.perf_counter()
        fields = _Fields.on(setting, mesh)
        now = time.perf_counter()
        best = fields.improved(best, now - start, gap)
        lone = best.status is not FieldStatus.OPEN and len(best.history) >= _PATIENCE
        if best.status in (FieldStatus.CLOSED, FieldStatus.UNSTABLE) or lone:
            return best
        finer = fields.finer(adaptive)
        growth = (len(finer) / len(mesh)) ** _POWER
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
    return require_refinement(assembly, labels, gap, patch)


@dataclass(frozen=True)
class _Setting:
    """What all meshes of one labelling have in common."""

    assembly: Assembly
    labels: Bits
    material: Material
    units: Units
    loads: SpatialLoads

    @classmethod
    def of(cls, assembly: Assembly, labels: Bits, loads: SpatialLoads) -> _Setting:
        """Return the setting of a labelling (m,) with its loads."""
        material = material_of(assembly)
        return cls(assembly, labels, material, spatial_units(assembly, material), loads)

    def problem(self, mesh: SolidMesh) -> SpatialProblem:
        """Return the scaled problem on a mesh."""
        return spatial_problem(self.assembly, self.labels, self.material, self.units, mesh, self.loads)


@dataclass(frozen=True)
class _Fields:
    """Both certified fields on one mesh, None where none was certified.

    mesh: tetrahedra of the velocities. split: the same split at their centroids, for the stresses: four times as many
    tetrahedra, and far more freedom than as many of a finer mesh. problem, fine: the scaled problem on either.
    """

    mesh: SolidMesh
    split: SolidMesh
    problem: SpatialProblem
    fine: SpatialProblem
    stress: SpatialStress | None
    velocity: SpatialVelocity | None

    @classmethod
    def on(cls, setting: _Setting, mesh: SolidMesh) -> _Fields:
        """Solve for both fields."""
        split = split_at_centroids(mesh)
        problem, fine = setting.problem(mesh), setting.problem(split)
        velocity = SpatialUpperBound(problem).bound()
        return cls(mesh, split, problem, fine, SpatialLowerBound(fine).bound(), velocity)

    def improved(self, best: SpatialBounds, seconds: float, gap: float) -> SpatialBounds:
        """Return the best bounds of those before and these, scene units, with their status."""
        units, lower, upper = self.problem.units, -math.inf, math.inf
        if self.stress is not None:
            lower = units.load * self.stress.factor
            if lower > best.lower:
                held = SpatialStresses(self.split, units.stress * tensors(self.stress.stress))
                best = replace(best, lower=lower, stresses=held)
        if self.velocity is not None:
            upper = units.load * self.velocity.factor
            if upper < best.upper:
                moved = SpatialVelocities(self.mesh, self.velocity.velocity, self.velocity.dissipation)
                best = replace(best, upper=upper, velocities=moved)
        steps = (*best.history, SpatialStep(len(self.mesh), lower, upper, seconds))
        best = replace(best, tetrahedra=len(self.mesh), seconds=seconds, history=steps)
        return replace(best, status=status_of_bounds(best.lower, best.upper, gap))

    def finer(self, adaptive: bool) -> SolidMesh:
        """Return the next mesh: refined where the fields disagree and where the stress field is weak, or everywhere."""
        if not adaptive or self.stress is None:
            return bisect(self.mesh, np.ones(len(self.mesh), dtype=bool))
        mesh, volume = self.problem.mesh, self.problem.mesh.volume
        corner = _weak_corners(self.stress)
        error = corner.sum(axis=1)
        if self.velocity is not None:
            moved = self._moved(self.velocity.velocity)
            power = stress_power(self.fine, self.stress, moved)
            error = error + np.maximum(self.velocity.dissipation - power.reshape(-1, 4).sum(axis=1), 0.0)
            corner = corner + self._joint_corners(self.stress, moved)
        error = error + _EVERYWHERE * error.sum() * volume / volume.sum()
        finer = replace(mesh, root=np.arange(len(mesh)))
        while len(finer) < _GROWTH * len(mesh):
            # half of a tetrahedron keeps a quarter of its share: strips along hinges lose in proportion to their width
            left = error[finer.root] * (finer.volume / volume[finer.root]) ** 2
            away = finer.corners[:, :, None] - mesh.corners[finer.root][:, None]
            share = 1.0 + np.einsum("tcki,tki->tck", away, mesh.gradient[finer.root])
            weight = np.maximum(np.einsum("tck,tk->tc", share, corner[finer.root]), 0.0)
            finer = bisect(finer, _marks(left), weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300))
        units = self.problem.units
        return replace(finer, points=finer.points * units.length + units.origin, root=self.mesh.root[finer.root])

    def _moved(self, velocity: Floats) -> Floats:
        """Velocities (4t, 4, 3) of the parts at centroids, from those of the tetrahedra."""
        rows = np.arange(4)
        parts = np.repeat(velocity[:, None], 4, axis=1)
        parts[:, rows, rows] = velocity.mean(axis=1)[:, None]
        return parts.reshape(-1, 4, 3)

    def _joint_corners(self, stress: SpatialStress, velocity: Floats) -> Floats:
        """Share (t, 4) of the corners in the power of tractions on dry joints, which either open or press."""
        p, s = self.fine, self.fine.sides
        shares = np.zeros((len(self.mesh), 4))
        pull, jump = _across_sides(p, stress, velocity, p.dry)
        lost = np.maximum(-np.einsum("fi,fki->fk", pull.sum(axis=1), jump), 0.0) * (s.area[p.dry] / 24.0)[:, None]
        both = s.b[p.dry] >= 0
        np.add.at(shares, (s.a[p.dry][:, None] // 4, s.corner_a[p.dry]), lost)
        np.add.at(shares, (s.b[p.dry][both][:, None] // 4, s.corner_b[p.dry][both]), lost[both])
        return shares


def _marks(error: Floats) -> Bools:
    """Mark (t,) the tetrahedra that hold most of an error (t,) together."""
    order = np.argsort(-error, kind="stable")
    share = np.cumsum(error[order])
    enough = int(np.searchsorted(share, _SHARE * share[-1])) + 1
    marks = np.zeros(len(error), dtype=bool)
    marks[order[: min(enough, max(1, int(_MOST_MARKED * len(error))))]] = True
    return marks


def stress_power(problem: SpatialProblem, stress: SpatialStress, velocity: Floats) -> Floats:
    """Return the power (t,) of stresses on velocities (t, 4, 3), each tetrahedron with half of its triangles.

    Both are scaled. By virtual power the sum is λ times live work plus dead work, where the velocities vanish on
    supports or jump there.
    """
    p, s, v = problem, problem.sides, velocity
    slope = np.einsum("tki,tkj->tij", v, p.mesh.gradient)
    power = p.mesh.volume * np.einsum("tij,tij->t", tensors(stress.stress.mean(axis=1)), slope)
    rows = np.flatnonzero((s.b >= 0) | (p.face >= 0))
    pull, jump = _across_sides(p, stress, v, rows)
    ends = np.einsum("fki,fki->f", pull, jump) + np.einsum("fi,fi->f", pull.sum(axis=1), jump.sum(axis=1))
    total = s.area[rows] * ends / 12.0
    both = s.b[rows] >= 0
    np.add.at(power, s.a[rows], np.where(both, 0.5, 1.0) * total)
    np.add.at(power, s.b[rows[both]], 0.5 * total[both])
    return np.asarray(power)


def _weak_corners(stress: SpatialStress) -> Floats:
    """Multipliers of yield (t, 4) at the corners; those at the centroid count for all corners alike."""
    rate = np.maximum(stress.rate, 0.0).reshape(-1, 4, 4)
    middle = np.diagonal(rate, axis1=1, axis2=2)
    return np.asarray(rate.sum(axis=1) - middle + 0.25 * middle.sum(axis=1, keepdims=True))


def _across_sides(
    problem: SpatialProblem, stress: SpatialStress, velocity: Floats, rows: Ints
) -> tuple[Floats, Floats]:
    """Tractions and jumps (k, 3, 3) at the corners of some triangles."""
    s = problem.sides
    jump = -velocity[s.a[rows][:, None], s.corner_a[rows]]
    both = s.b[rows] >= 0
    jump[both] += velocity[s.b[rows[both]][:, None], s.corner_b[rows[both]]]
    own = stress.stress[s.a[rows][:, None], s.corner_a[rows]]
    return np.einsum("fij,fkj->fki", normal_map(s.normal[rows]), own), jump
