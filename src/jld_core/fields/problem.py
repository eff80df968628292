"""Non-dimensional planar problem of both bounds, with numbers of order one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.fields.loads import FieldLoads, thickness_of
from jld_core.fields.material import Material
from jld_core.fields.mesh import Edges, Mesh
from jld_core.fields.outlines import FREE
from jld_core.strengths import Route

_ROUTE: Final = Route("cracks by fields")


@dataclass(frozen=True)
class Units:
    """Units of a scaled problem: scene value = unit × scaled value.

    length, stress: in scene units. load: unit of λ, and of power at unit work of the live load. velocity: unit of the
    velocities on which the live load does unit work, in 1 / force. origin: (2,) or (3,) point of the scene that becomes
    zero.
    """

    length: float
    stress: float
    load: float
    velocity: float
    origin: Floats


@dataclass(frozen=True)
class Joints:
    """Scaled strengths of the m interfaces as dry joints, (m,) each.

    friction: coefficient μ, 0 where the scene gives none. cohesion: over `Units.stress`. crushing: compressive strength
    over `Units.stress`, inf where the joint cannot crush.
    """

    friction: Floats
    cohesion: Floats
    crushing: Floats


@dataclass(frozen=True)
class Problem:
    """Scaled limit analysis of planar blocks on one mesh, for unit thickness.

    Attributes
    ----------
    units : Units
        Units of all other attributes.
    material : Material
        Scaled material of the blocks.
    joints : Joints
        Scaled strengths of the dry joints.
    mesh : Mesh
        Triangles, scaled coordinates.
    dead, live : (t, 2) float array
        Forces per volume, scaled; live for λ = 1.
    dead_pull, pull : (e, 2, 2) float array
        Dead and live tractions (end, axis) at both ends of each edge, scaled; live for λ = 1. Zero where no load acts.
    supported : (m,) bool array
        Interfaces that touch a support.
    """

    units: Units
    material: Material
    joints: Joints
    mesh: Mesh
    dead: Floats
    live: Floats
    dead_pull: Floats
    pull: Floats
    supported: Bools

    @property
    def loaded(self) -> bool:
        """True where any dead load acts."""
        return bool(self.dead.any() or self.dead_pull.any())

    def without_dead_load(self) -> Problem:
        """Return the problem under its live load alone."""
        return replace(self, dead=np.zeros_like(self.dead), dead_pull=np.zeros_like(self.dead_pull))

    def under_dead_load(self) -> Problem:
        """Return the problem whose live load is the dead one."""
        return replace(self, live=self.dead, pull=self.dead_pull).without_dead_load()

    @property
    def edges(self) -> Edges:
        """Edges of the mesh, (e,) each; see `Mesh.edges`."""
        return self.mesh.edges

    @cached_property
    def face(self) -> Ints:
        """(e,) interface that each edge lies on, −1 for none."""
        tag = self.edges.tag
        return np.where(tag < len(self.supported), tag, -1)

    @cached_property
    def inside(self) -> Ints:
        """(k,) edges inside a cell, between two of its triangles."""
        return np.flatnonzero((self.edges.b >= 0) & (self.face < 0))

    @cached_property
    def joined(self) -> Ints:
        """(k,) edges between two triangles, inside cells or on interfaces without support."""
        return np.flatnonzero(self.edges.b >= 0)

    @cached_property
    def on_faces(self) -> Ints:
        """(k,) edges on interfaces, those at supports included."""
        return np.flatnonzero(self.face >= 0)

    @cached_property
    def outer(self) -> Ints:
        """(k,) edges on the free outline of cells, with or without a live traction."""
        return np.flatnonzero((self.edges.b < 0) & (self.face < 0))

    def is_dry(self, labels: Bits) -> Bools:
        """Return (e,) True for edges on dry interfaces; labels: (m,) True = dry."""
        dry = np.zeros(len(self.face), dtype=bool)
        dry[self.on_faces] = labels[self.face[self.on_faces]]
        return dry


def units_of(assembly: Assembly, material: Material) -> Units:
    """Choose the units in which a planar problem has numbers of order one.

    material: in scene units. Units depend on sizes, strengths and loads alone, so that scaled problems do not depend on
    position, rotation and units of the scene.
    """
    elements, free, thickness = assembly.elements, assembly.elements.free, thickness_of(assembly)
    length = float(np.sqrt(elements.volume[free].sum() / thickness))
    strength = min(material.cohesion, material.tension)
    dead = assembly.total_dead / (length * thickness)
    # between strength and weight, whichever governs; a weight of nothing is no measure
    stress = min(strength, float(np.sqrt(strength * max(dead, 1e-4 * strength)))) if dead > 0.0 else strength
    origin = 0.5 * (elements.lower[free].min(axis=0) + elements.upper[free].max(axis=0))
    live = assembly.total_live
    return Units(length, stress, stress * length * thickness / live, 1.0 / live, origin)


def problem_of(assembly: Assembly, material: Material, units: Units, mesh: Mesh, loads: FieldLoads) -> Problem:
    """Scale an assembly and its loads to the problem on one mesh.

    Parameters
    ----------
    assembly : Assembly
        Planar assembly.
    material : Material
        Material of the blocks, scene units.
    units : Units
        Units of the assembly.
    mesh : Mesh
        Scene coordinates; refined from the mesh that the loads belong to.
    loads : FieldLoads
        Over the roots of the mesh, scene units.

    Returns
    -------
    Problem
        Stresses, lengths and loads of order one.
    """
    faces, strengths, support = assembly.interfaces, assembly.strengths(_ROUTE), assembly.elements.support
    scaled = replace(mesh, points=(mesh.points - units.origin) / units.length)
    density = units.length / units.stress
    joints = Joints(
        friction=np.nan_to_num(strengths.friction, nan=0.0),
        cohesion=strengths.cohesion / units.stress,
        crushing=np.where(np.isnan(strengths.crush_dry), np.inf, strengths.crush_dry) / units.stress,
    )
    dead_pull, pull = _pulls(mesh, loads, len(faces))
    return Problem(
        units=units,
        material=material.scaled(units.stress),
        joints=joints,
        mesh=scaled,
        dead=loads.dead[mesh.root] * density,
        live=loads.live[mesh.root] * (density * units.load),
        dead_pull=dead_pull / units.stress,
        pull=pull * (units.load / units.stress),
        supported=support[faces.a] | support[faces.b],
    )


def _pulls(mesh: Mesh, loads: FieldLoads, faces: int) -> Floats:
    """Compute the dead and the live tractions (2, e, 2, 2) at both ends of all edges, scene units.

    faces: number of interfaces; load segment i has the tag faces + i.
    """
    edges = mesh.edges
    pull = np.zeros((2, len(edges), 2, 2))
    for index, segment in enumerate(loads.segments):
        own = np.flatnonzero(edges.tag == faces + index)
        along = segment.ends[1] - segment.ends[0]
        places = mesh.corners[edges.a[own][:, None], edges.corner_a[own]]
        share = ((places - segment.ends[0]) @ along / (along @ along))[..., None]
        for k, ends in enumerate((segment.dead, segment.live)):
            pull[k, own] = ends[0] * (1.0 - share) + ends[1] * share
    return pull


__all__ = ["FREE", "Joints", "Problem", "Units", "problem_of", "units_of"]
