"""The non-dimensional problem of both bounds in space: tetrahedra, material, dry joints and loads of order one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.fields.material import Material
from jld_core.fields.problem import Joints, Units
from jld_core.fields.space_loads import SpatialLoads
from jld_core.fields.space_mesh import Sides, SolidMesh, patch_tag


@dataclass(frozen=True)
class SpatialProblem:
    """Scaled limit analysis of the blocks of one labelling on one mesh.

    mesh: scaled coordinates. dead, live: (t, 3) forces per volume. pull: (f, 3, 3) live tractions (corner, axis) of
    each triangle, zero where no load acts. labels: (m,) True = dry.
    """

    units: Units
    material: Material
    joints: Joints
    mesh: SolidMesh
    dead: Floats
    live: Floats
    pull: Floats
    labels: Bits

    @property
    def sides(self) -> Sides:
        """Triangles between the tetrahedra."""
        return self.mesh.sides

    @cached_property
    def face(self) -> Ints:
        """(f,) interface of each triangle, −1 where there is none."""
        return np.maximum(self.sides.tag, -1)

    @cached_property
    def is_dry(self) -> Bools:
        """(f,) True for the triangles on dry interfaces."""
        dry = np.zeros(len(self.face), dtype=bool)
        on = self.face >= 0
        dry[on] = self.labels[self.face[on]]
        return dry

    @cached_property
    def dry(self) -> Ints:
        """Triangles (k,) on dry interfaces, those with supports among them."""
        return np.flatnonzero(self.is_dry)

    @cached_property
    def cut(self) -> Ints:
        """Triangles (k,) in the material where velocities may jump: inside cells, and on inner interfaces."""
        return np.flatnonzero(~self.is_dry & ((self.sides.b >= 0) | (self.face >= 0)))

    @cached_property
    def joined(self) -> Ints:
        """Triangles (k,) between two tetrahedra."""
        return np.flatnonzero(self.sides.b >= 0)

    @cached_property
    def outer(self) -> Ints:
        """Triangles (k,) that belong to no interface: free, or with a live traction."""
        return np.flatnonzero((self.sides.b < 0) & (self.face < 0))


def spatial_units(assembly: Assembly, material: Material) -> Units:
    """Return units of a spatial assembly, from sizes, strengths and loads only."""
    elements, free = assembly.elements, assembly.elements.free
    length = float(np.cbrt(elements.volume[free].sum()))
    strength = min(material.cohesion, material.tension)
    dead = assembly.total_dead / length**2
    # between strength and weight, whichever governs; a weight of nothing is no measure
    stress = min(strength, float(np.sqrt(strength * max(dead, 1e-4 * strength)))) if dead > 0.0 else strength
    origin = 0.5 * (elements.lower[free].min(axis=0) + elements.upper[free].max(axis=0))
    return Units(length, stress, stress * length**2 / assembly.total_live, origin)


def spatial_problem(
    assembly: Assembly, labels: Bits, material: Material, units: Units, mesh: SolidMesh, loads: SpatialLoads
) -> SpatialProblem:
    """Return the scaled problem of a labelling (m,) on a mesh refined from the one that its loads belong to."""
    strengths = assembly.strengths
    density = units.length / units.stress
    joints = Joints(
        friction=np.nan_to_num(strengths.friction, nan=0.0),
        cohesion=strengths.cohesion / units.stress,
        crushing=np.where(np.isnan(strengths.crush_dry), np.inf, strengths.crush_dry) / units.stress,
    )
    return SpatialProblem(
        units=units,
        material=material.scaled(units.stress),
        joints=joints,
        mesh=replace(mesh, points=(mesh.points - units.origin) / units.length),
        dead=loads.dead[mesh.root] * density,
        live=loads.live[mesh.root] * (density * units.load),
        pull=_pull(mesh, loads) * (units.load / units.stress),
        labels=labels,
    )


def _pull(mesh: SolidMesh, loads: SpatialLoads) -> Floats:
    """Live tractions (f, 3, 3) at the corners of all triangles, scene units."""
    sides = mesh.sides
    pull = np.zeros((len(sides), 3, 3))
    for index, traction in enumerate(loads.tractions):
        own = np.flatnonzero((sides.tag == patch_tag(index)) & (mesh.cell[sides.a] == traction.cell))
        pull[own] = traction.at(mesh.corners[sides.a[own][:, None], sides.corner_a[own]])
    return pull
