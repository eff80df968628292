"""The non-dimensional problem that both bounds share: mesh, material, joints and loads of order one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.fields.loads import FieldLoads, thickness_of
from jld_core.fields.material import Material
from jld_core.fields.mesh import Edges, Mesh
from jld_core.fields.outlines import FREE


@dataclass(frozen=True)
class Units:
    """Scene value = unit × scaled value: length, stress, load factor; origin: (2,) place that becomes zero."""

    length: float
    stress: float
    load: float
    origin: Floats


@dataclass(frozen=True)
class Joints:
    """Strengths of the m interfaces as dry: friction μ, cohesion and crushing over the unit of stress, (m,) each."""

    friction: Floats
    cohesion: Floats
    crushing: Floats


@dataclass(frozen=True)
class Problem:
    """Scaled limit analysis of the blocks on one mesh, unit thickness.

    mesh: scaled coordinates. dead, live: (t, 2) forces per volume. pull: (e, 2, 2) live tractions (end, axis) at both
    ends of each edge, zero where no load acts. supported: (m,) True where an interface touches a support.
    """

    units: Units
    material: Material
    joints: Joints
    mesh: Mesh
    dead: Floats
    live: Floats
    pull: Floats
    supported: Bools

    @property
    def edges(self) -> Edges:
        """Edges of the mesh."""
        return self.mesh.edges

    @cached_property
    def face(self) -> Ints:
        """(e,) interface of each edge, −1 where there is none."""
        tag = self.edges.tag
        return np.where(tag < len(self.supported), tag, -1)

    @cached_property
    def inside(self) -> Ints:
        """Edges (k,) between two triangles of one cell."""
        return np.flatnonzero((self.edges.b >= 0) & (self.face < 0))

    @cached_property
    def joined(self) -> Ints:
        """Edges (k,) between two triangles, inside cells or on interfaces."""
        return np.flatnonzero(self.edges.b >= 0)

    @cached_property
    def on_faces(self) -> Ints:
        """Edges (k,) on interfaces, those with supports among them."""
        return np.flatnonzero(self.face >= 0)

    @cached_property
    def outer(self) -> Ints:
        """Edges (k,) of cells that belong to no interface: free, or with a live traction."""
        return np.flatnonzero((self.edges.b < 0) & (self.face < 0))

    def is_dry(self, labels: Bits) -> Bools:
        """(e,) True for the edges on dry interfaces."""
        dry = np.zeros(len(self.face), dtype=bool)
        dry[self.on_faces] = labels[self.face[self.on_faces]]
        return dry


def units_of(assembly: Assembly, material: Material) -> Units:
    """Return units of an assembly, from sizes, strengths and loads only."""
    elements, free, thickness = assembly.elements, assembly.elements.free, thickness_of(assembly)
    length = float(np.sqrt(elements.volume[free].sum() / thickness))
    strength = min(material.cohesion, material.tension)
    dead = assembly.total_dead / (length * thickness)
    # between strength and weight, whichever governs; a weight of nothing is no measure
    stress = min(strength, float(np.sqrt(strength * max(dead, 1e-4 * strength)))) if dead > 0.0 else strength
    origin = 0.5 * (elements.lower[free].min(axis=0) + elements.upper[free].max(axis=0))
    return Units(length, stress, stress * length * thickness / assembly.total_live, origin)


def problem_of(assembly: Assembly, material: Material, units: Units, mesh: Mesh, loads: FieldLoads) -> Problem:
    """Return the scaled problem of an assembly on a mesh refined from the one that its loads belong to.

    Parameters
    ----------
    assembly : Assembly
        Planar assembly.
    material : Material
        Material of the blocks, scene units.
    units : Units
        Units of the assembly.
    mesh : Mesh
        Scene coordinates.
    loads : FieldLoads
        Over the roots of the mesh, scene units.

    Returns
    -------
    Problem
        Stresses, lengths and loads of order one.
    """
    faces, strengths, support = assembly.interfaces, assembly.strengths, assembly.elements.support
    scaled = replace(mesh, points=(mesh.points - units.origin) / units.length)
    density = units.length / units.stress
    joints = Joints(
        friction=np.nan_to_num(strengths.friction, nan=0.0),
        cohesion=strengths.cohesion / units.stress,
        crushing=np.where(np.isnan(strengths.crush_dry), np.inf, strengths.crush_dry) / units.stress,
    )
    return Problem(
        units=units,
        material=material.scaled(units.stress),
        joints=joints,
        mesh=scaled,
        dead=loads.dead[mesh.root] * density,
        live=loads.live[mesh.root] * (density * units.load),
        pull=_pull(mesh, loads, len(faces)) * (units.load / units.stress),
        supported=support[faces.a] | support[faces.b],
    )


def _pull(mesh: Mesh, loads: FieldLoads, faces: int) -> Floats:
    """Live tractions (e, 2, 2) at both ends of all edges, scene units."""
    edges = mesh.edges
    pull = np.zeros((len(edges), 2, 2))
    for index, segment in enumerate(loads.segments):
        own = np.flatnonzero(edges.tag == faces + index)
        along = segment.ends[1] - segment.ends[0]
        places = mesh.corners[edges.a[own][:, None], edges.corner_a[own]]
        share = ((places - segment.ends[0]) @ along / (along @ along))[..., None]
        pull[own] = segment.traction[0] * (1.0 - share) + segment.traction[1] * share
    return pull


__all__ = ["FREE", "Joints", "Problem", "Units", "problem_of", "units_of"]
