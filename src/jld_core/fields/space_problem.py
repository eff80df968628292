"""The non-dimensional problem of both bounds in space, with numbers of order one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.fields.material import Material
from jld_core.fields.problem import Joints, Units
from jld_core.fields.space_loads import SpatialLoads
from jld_core.fields.space_mesh import Sides, SolidMesh, patch_tag
from jld_core.strengths import Route

_ROUTE: Final = Route("cracks by fields")


@dataclass(frozen=True)
class SpatialProblem:
    """Scaled limit analysis of spatial blocks of one labelling on one mesh.

    units: units of all other attributes. material: scaled material of the blocks. joints: scaled strengths of the dry
    joints. mesh: tetrahedra, scaled coordinates. dead, live: (t, 3) forces per volume, scaled; live for λ = 1.
    dead_pull, pull: (f, 3, 3) dead and live tractions (corner, axis) of each triangle, scaled; live for λ = 1. Zero
    where no load acts. labels: (m,) True = dry.
    """

    units: Units
    material: Material
    joints: Joints
    mesh: SolidMesh
    dead: Floats
    live: Floats
    dead_pull: Floats
    pull: Floats
    labels: Bits

    @property
    def sides(self) -> Sides:
        """Triangles of the mesh, (f,) each; see `SolidMesh.sides`."""
        return self.mesh.sides

    @cached_property
    def face(self) -> Ints:
        """(f,) interface that each triangle lies on, −1 for none."""
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
        """(k,) triangles on dry interfaces, those at supports included."""
        return np.flatnonzero(self.is_dry)

    @cached_property
    def cut(self) -> Ints:
        """(k,) triangles in the material on which velocities may jump.

        They lie inside cells and on inner interfaces, those at supports included.
        """
        return np.flatnonzero(~self.is_dry & ((self.sides.b >= 0) | (self.face >= 0)))

    @cached_property
    def joined(self) -> Ints:
        """(k,) triangles between two tetrahedra, in cells or on interfaces without support."""
        return np.flatnonzero(self.sides.b >= 0)

    @cached_property
    def outer(self) -> Ints:
        """(k,) triangles on the free surface of cells, with or without a live traction."""
        return np.flatnonzero((self.sides.b < 0) & (self.face < 0))


def spatial_units(assembly: Assembly, material: Material) -> Units:
    """Choose the units in which a spatial problem has numbers of order one.

    material: in scene units. Units depend on sizes, strengths and loads alone, so that scaled problems do not depend on
    position, rotation and units of the scene.
    """
    elements, free = assembly.elements, assembly.elements.free
    length = float(np.cbrt(elements.volume[free].sum()))
    strength = min(material.cohesion, material.tension)
    dead = assembly.total_dead / length**2
    # between strength and weight, whichever governs; a weight of nothing is no measure
    stress = min(strength, float(np.sqrt(strength * max(dead, 1e-4 * strength)))) if dead > 0.0 else strength
    origin = 0.5 * (elements.lower[free].min(axis=0) + elements.upper[free].max(axis=0))
    live = assembly.total_live
    return Units(length, stress, stress * length**2 / live, 1.0 / live, origin)


def spatial_problem(
    assembly: Assembly, labels: Bits, material: Material, units: Units, mesh: SolidMesh, loads: SpatialLoads
) -> SpatialProblem:
    """Scale a spatial assembly and its loads to the problem of a labelling on one mesh.

    labels: (m,) True = dry. material, units: of the assembly, scene units. mesh: scene coordinates, refined from the
    coarsest one. loads: over that coarsest mesh, scene units.
    """
    strengths = assembly.strengths(_ROUTE)
    density = units.length / units.stress
    joints = Joints(
        friction=np.nan_to_num(strengths.friction, nan=0.0),
        cohesion=strengths.cohesion / units.stress,
        crushing=np.where(np.isnan(strengths.crush_dry), np.inf, strengths.crush_dry) / units.stress,
    )
    dead_pull, pull = _pulls(mesh, loads)
    return SpatialProblem(
        units=units,
        material=material.scaled(units.stress),
        joints=joints,
        mesh=replace(mesh, points=(mesh.points - units.origin) / units.length),
        dead=loads.dead[mesh.root] * density,
        live=loads.live[mesh.root] * (density * units.load),
        dead_pull=dead_pull / units.stress,
        pull=pull * (units.load / units.stress),
        labels=labels,
    )


def _pulls(mesh: SolidMesh, loads: SpatialLoads) -> Floats:
    """Compute the dead and the live tractions (2, f, 3, 3) at the corners of all triangles, scene units."""
    sides = mesh.sides
    pull = np.zeros((2, len(sides), 3, 3))
    for index, traction in enumerate(loads.tractions):
        own = np.flatnonzero((sides.tag == patch_tag(index)) & (mesh.cell[sides.a] == traction.cell))
        pull[:, own] = traction.at(mesh.corners[sides.a[own][:, None], sides.corner_a[own]])
    return pull
