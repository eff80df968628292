"""Stress and velocity field of one labelling in space on one mesh, and the next mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.fields.material import Material, material_of
from jld_core.fields.problem import Units
from jld_core.fields.space_cones import normal_map, tensors
from jld_core.fields.space_loads import SpatialLoads
from jld_core.fields.space_lower import SpatialLowerBound, SpatialStress
from jld_core.fields.space_mesh import SolidMesh, bisect, split_at_centroids
from jld_core.fields.space_problem import SpatialProblem, spatial_problem, spatial_units
from jld_core.fields.space_upper import SpatialUpperBound, SpatialVelocity

_SHARE = 0.5  # share of the indicator that the tetrahedra marked at a time hold together (Dörfler marking)

_MOST_MARKED = 0.3  # largest share of tetrahedra that are marked at a time

# Ratio of the numbers of tetrahedra of the next and the last mesh. Tetrahedra are marked and halved until it is
# reached.
_GROWTH = 1.5

_EVERYWHERE = 0.02  # weight of the volume in the indicator, so that no tetrahedron stays coarse for ever

_DEFORMS = 0.1  # share of the dissipation from which a cell that is long or flat is cut in layers


@dataclass(frozen=True)
class SpatialSetting:
    """Data that all meshes of one labelling of a spatial assembly share.

    assembly: with one load case. labels: (m,) True = dry. material: of the blocks, scene units. units: of the scaled
    problem. loads: over the coarsest mesh, scene units.
    """

    assembly: Assembly
    labels: Bits
    material: Material
    units: Units
    loads: SpatialLoads

    @classmethod
    def of(cls, assembly: Assembly, labels: Bits, loads: SpatialLoads) -> SpatialSetting:
        """Make the setting of a labelling (m,), True = dry; raise InputError as `material_of`.

        loads: as `loaded_solids` returns them with the coarsest mesh.
        """
        material = material_of(assembly)
        return cls(assembly, labels, material, spatial_units(assembly, material), loads)

    def problem(self, mesh: SolidMesh) -> SpatialProblem:
        """Return the scaled problem on a mesh, given in scene units; see `spatial_problem`."""
        return spatial_problem(self.assembly, self.labels, self.material, self.units, mesh, self.loads)

    def uniform(self, cell: int, mesh: SolidMesh) -> bool:
        """Return True if dead and live forces per volume are constant in a cell.

        Such a cell may be filled with other tetrahedra without a change of its loads. cell: element. mesh: any mesh of
        this setting.
        """
        own = np.unique(mesh.root[mesh.cell == cell])
        both = np.hstack([self.loads.dead[own], self.loads.live[own]])
        return bool((np.ptp(both, axis=0) <= tolerances.ROUNDING * abs(both).max(initial=0.0)).all())


@dataclass(frozen=True)
class SpatialFields:
    """Certified stress field and velocity field of one labelling on one mesh in space.

    mesh: tetrahedra of the velocities, scene units. split: the same tetrahedra, each split in four at its centroid:
    those of the stresses. problem, fine: scaled problem on `mesh`, and on `split`. stress: stress field on `split`,
    None where none was certified. velocity: velocity field on `mesh`, None where none was certified.
    """

    mesh: SolidMesh
    split: SolidMesh
    problem: SpatialProblem
    fine: SpatialProblem
    stress: SpatialStress | None
    velocity: SpatialVelocity | None

    @classmethod
    def on(cls, setting: SpatialSetting, mesh: SolidMesh) -> SpatialFields:
        """Solve for both fields on a mesh, given in scene units, and certify them.

        A field that could not be certified is None; nothing is raised.
        """
        split = split_at_centroids(mesh)
        problem, fine = setting.problem(mesh), setting.problem(split)
        velocity = SpatialUpperBound(problem).bound()
        return cls(mesh, split, problem, fine, SpatialLowerBound(fine).bound(), velocity)

    @property
    def lower(self) -> float:
        """Lower bound on λ, scene units; −inf where none was certified."""
        return -math.inf if self.stress is None else self.problem.units.load * self.stress.factor

    @property
    def upper(self) -> float:
        """Upper bound on λ, scene units; inf where none was certified."""
        return math.inf if self.velocity is None else self.problem.units.load * self.velocity.factor

    def deforming(self) -> Ints:
        """Return the cells (k,) that take a large share of the dissipation.

        The caller cuts them in layers where they are long or flat. Empty without a velocity field.
        """
        if self.velocity is None:
            return np.zeros(0, dtype=np.int64)
        shares = np.bincount(self.mesh.cell, np.maximum(self.velocity.dissipation, 0.0))
        return np.flatnonzero(shares > _DEFORMS * shares.sum())

    def finer(self, adaptive: bool, most: int) -> SolidMesh:
        """Return the next mesh, scene units: refined where the fields disagree, or everywhere.

        adaptive: False bisects every tetrahedron, as is done without a stress field. True bisects those with most
        dissipation less stress power, and most multipliers of yield, until the mesh has grown enough. most: number of
        tetrahedra that such a mesh does not exceed; where fewer fit than wanted, the worst are bisected.
        """
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
        fits = True
        while fits and len(finer) < _GROWTH * len(mesh):
            # half of a tetrahedron keeps a quarter of its share: strips along hinges lose in proportion to their width
            left = error[finer.root] * (finer.volume / volume[finer.root]) ** 2
            away = finer.corners[:, :, None] - mesh.corners[finer.root][:, None]
            share = 1.0 + np.einsum("tcki,tki->tck", away, mesh.gradient[finer.root])
            weight = np.maximum(np.einsum("tck,tk->tc", share, corner[finer.root]), 0.0)
            weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
            marks = _marks(left)
            larger = bisect(finer, marks, weight)
            fits = len(larger) <= most
            while len(larger) > most and marks.any():
                marks &= left > np.median(left[marks])
                larger = bisect(finer, marks, weight)
            finer = larger
        units = self.problem.units
        return replace(finer, points=finer.points * units.length + units.origin, root=self.mesh.root[finer.root])

    def _moved(self, velocity: Floats) -> Floats:
        """Interpolate velocities (t, 4, 3) of tetrahedra to their quarters on `split`, (4t, 4, 3)."""
        rows = np.arange(4)
        parts = np.repeat(velocity[:, None], 4, axis=1)
        parts[:, rows, rows] = velocity.mean(axis=1)[:, None]
        return parts.reshape(-1, 4, 3)

    def _joint_corners(self, stress: SpatialStress, velocity: Floats) -> Floats:
        """Compute the power (t, 4) that joint tractions lose at each corner of the tetrahedra.

        velocity: (4t, 4, 3) on `split`. The loss is minus the power of the tractions on the jump, where positive;
        scaled.
        """
        p, s = self.fine, self.fine.sides
        shares = np.zeros((len(self.mesh), 4))
        pull, jump = _across_sides(p, stress, velocity, p.dry)
        lost = np.maximum(-np.einsum("fi,fki->fk", pull.sum(axis=1), jump), 0.0) * (s.area[p.dry] / 24.0)[:, None]
        both = s.b[p.dry] >= 0
        np.add.at(shares, (s.a[p.dry][:, None] // 4, s.corner_a[p.dry]), lost)
        np.add.at(shares, (s.b[p.dry][both][:, None] // 4, s.corner_b[p.dry][both]), lost[both])
        return shares


def _marks(error: Floats) -> Bools:
    """Mark (t,) the tetrahedra of largest error that together hold a share of its sum.

    error: (t,). No more than `_MOST_MARKED` of all are marked.
    """
    order = np.argsort(-error, kind="stable")
    share = np.cumsum(error[order])
    enough = int(np.searchsorted(share, _SHARE * share[-1])) + 1
    marks = np.zeros(len(error), dtype=bool)
    marks[order[: min(enough, max(1, int(_MOST_MARKED * len(error))))]] = True
    return marks


def stress_power(problem: SpatialProblem, stress: SpatialStress, velocity: Floats) -> Floats:
    """Return the power of a stress field on velocities in each tetrahedron, (t,), scaled.

    problem: on the mesh of both fields. velocity: (t, 4, 3) at the corners. Each tetrahedron counts with half of its
    triangles. By virtual power the sum is λ times live work plus dead work. Dissipation less this power tells where the
    bounds differ.
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
    """Sum the multipliers of yield to the corners (t, 4) of the unsplit tetrahedra.

    stress: on `split`. The multiplier at a centroid is shared equally by the four corners.
    """
    rate = np.maximum(stress.rate, 0.0).reshape(-1, 4, 4)
    middle = np.diagonal(rate, axis1=1, axis2=2)
    return np.asarray(rate.sum(axis=1) - middle + 0.25 * middle.sum(axis=1, keepdims=True))


def _across_sides(
    problem: SpatialProblem, stress: SpatialStress, velocity: Floats, rows: Ints
) -> tuple[Floats, Floats]:
    """Return tractions on tetrahedron a and velocity jumps at the corners of triangles.

    rows: (k,) triangles. velocity: (t, 4, 3), scaled. Both results are (k, 3, 3): triangle, corner, axis.
    """
    s = problem.sides
    jump = -velocity[s.a[rows][:, None], s.corner_a[rows]]
    both = s.b[rows] >= 0
    jump[both] += velocity[s.b[rows[both]][:, None], s.corner_b[rows[both]]]
    own = stress.stress[s.a[rows][:, None], s.corner_a[rows]]
    return np.einsum("fij,fkj->fki", normal_map(s.normal[rows]), own), jump
