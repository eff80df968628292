"""Non-dimensional planar problem of both bounds, with numbers of order one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.loads import FieldLoads, loaded_mesh, thickness_of
from jld_core.fields.mesh import Edges, Mesh
from jld_core.fields.outlines import FREE
from jld_core.scene.standard import key_of
from jld_core.strengths import Route

_ROUTE: Final = Route("cracks by fields")


@dataclass(frozen=True)
class Material:
    """Mohr–Coulomb material with tension cut-off in plane stress."""

    tension: float  # tensile strength σt, a stress
    shear: float  # shear strength τ without normal stress, a stress
    friction: float = 0.0  # friction μi = tan φ of crack planes
    crushing: float = np.inf  # compressive strength σc, a stress; inf where none is given

    @property
    def sine(self) -> float:
        """Sine of the angle of friction φ of crack planes, tan φ = `friction`."""
        return self.friction / float(np.hypot(1.0, self.friction))

    @property
    def intercept(self) -> float:
        """Largest R = (σ1 − σ2)/2 that Mohr–Coulomb admits at m = 0: τ cos φ, stress."""
        return self.shear / float(np.hypot(1.0, self.friction))

    def scaled(self, unit: float) -> Material:
        """Return the same material with its strengths divided by `unit`, a stress above 0."""
        return Material(self.tension / unit, self.shear / unit, self.friction, self.crushing / unit)

    @cached_property
    def lines(self) -> Floats:
        """(k, 2) coefficients (a, b) of the yield conditions R ≤ a + b m.

        m = (σx + σy)/2 and R = (σ1 − σ2)/2. The rows are Mohr–Coulomb, tension cut-off and, where a compressive
        strength is given, crushing.
        """
        rows = [(self.intercept, -self.sine), (self.tension, -1.0)]
        if np.isfinite(self.crushing):
            rows.append((self.crushing, 1.0))
        return np.array(rows)

    @cached_property
    def vertices(self) -> Floats:
        """(k, 2) corners (m, R) of the yield set in the half-plane R ≥ 0, stress."""
        # m = (σx + σy)/2 and R = (σ1 − σ2)/2. Without a compressive strength the set is unbounded towards m = −∞; that
        # end has no corner.
        corners = [(self.tension, 0.0)]
        if np.isfinite(self.crushing):
            corners.append((-self.crushing, 0.0))
        for i, (a, b) in enumerate(self.lines):
            for c, d in self.lines[i + 1 :]:
                if b != d:
                    m = (c - a) / (b - d)
                    corners.append((m, a + b * m))
        slack = 1e-12 * max(self.tension, self.shear)
        kept = [(m, r) for m, r in corners if r >= 0.0 and (r <= self.lines @ (1.0, m) + slack).all()]
        return np.array(kept)

    def slack(self, stress: Floats) -> Floats:
        """Return the least slack a + b m − R over all yield conditions (see `lines`), a stress.

        stress: (..., 3) values (m, d, s) = ((σx + σy)/2, (σx − σy)/2, τxy). The result is (...,); negative means that
        yield is violated.
        """
        radius = np.hypot(stress[..., 1], stress[..., 2])
        heads = self.lines[:, 0] + self.lines[:, 1] * stress[..., :1]
        return np.asarray(heads.min(axis=-1) - radius)

    def missing(self, trace: Floats, shear: Floats) -> Floats:
        """Return the trace that strain rates lack to obey the flow rule, (k,).

        trace, shear: (k,) e and g of docs/method.md (9.2). The result is g sin φ − e; above 0 the dissipation is
        infinite. It is −inf for a material that crushes, which has no such rule.
        """
        if np.isfinite(self.crushing):
            return np.full_like(trace, -np.inf)
        return self.sine * shear - trace

    def dissipation(self, trace: Floats, shear: Floats, allowance: float = 0.0) -> Floats:
        """Return the power per volume of strain rates, (...,): docs/method.md (9.2)."""
        power = (trace[..., None] * self.vertices[:, 0] + shear[..., None] * self.vertices[:, 1]).max(axis=-1)
        return np.asarray(np.where(self.missing(trace, shear) > allowance, np.inf, power))


def material_of(assembly: Assembly) -> Material:
    """Return the material of all blocks, from the inner strengths of the faces.

    Raises InputError: no inner strengths, strengths of 0, strengths that differ between faces, or members.
    """
    # The tensile strength is reduced to τ / μi, the apex of Mohr–Coulomb, where it is larger.
    assembly.members.refuse("an analysis by fields")
    values = np.column_stack(list(vars(assembly.strengths(_ROUTE).side(dry=False)).values()))
    named = values[~np.isnan(values[:, :2]).any(axis=1)]
    if not len(named):
        raise InputError(
            "materials.inner",
            "cracks by fields need the strengths of the blocks",
            " and ".join(key_of("inner", side) for side in ("tension", "shear")),
        )
    plain = np.where(np.isinf(named), -1.0, named)
    if not (np.ptp(plain, axis=0) <= tolerances.ROUNDING * abs(plain).max(axis=0)).all():
        raise InputError(
            "interfaces", "inner strengths differ between faces; fields take one material", "one inner material"
        )
    tension, shear, friction, crushing = (float(value) for value in named[0])
    for key, value in ((key_of("inner", "tension"), tension), (key_of("inner", "shear"), shear)):
        if not value > 0.0:
            raise InputError(f"materials.inner.{key}", f"{value:g} is too small for stress fields", "a stress above 0")
    if friction:
        # at the apex of friction the cut-off idles
        tension = min(tension, shear / friction)
    return Material(tension, shear, friction, crushing)


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

    friction: coefficient μ, 0 where the scene gives none. shear: resistance to shear without pressure, and crushing:
    compressive strength, over `Units.stress`; inf where the joint cannot crush.
    """

    friction: Floats
    shear: Floats
    crushing: Floats


def joints_of(assembly: Assembly, units: Units) -> Joints:
    """Return the scaled strengths of all interfaces as dry joints."""
    own = assembly.strengths(_ROUTE).side(dry=True)
    crushing = np.where(np.isnan(own.crush), np.inf, own.crush)
    return Joints(np.nan_to_num(own.friction, nan=0.0), own.shear / units.stress, crushing / units.stress)


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
        """Edges of the mesh, (e,) each."""
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
    strength = min(material.shear, material.tension)
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
    faces, support = assembly.interfaces, assembly.elements.support
    scaled = replace(mesh, points=(mesh.points - units.origin) / units.length)
    density = units.length / units.stress
    joints = joints_of(assembly, units)
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
    """Compute the dead and the live tractions (2, e, 2, 2) at both ends of all edges, scene units."""
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


def require_fields(assembly: Assembly) -> None:
    """Raise InputError if λ of an assembly cannot be bounded by fields, whatever its labels.

    Refused are members, spatial scenes, inner strengths that are missing, zero or different, loads without room for
    their patch, and outlines or interfaces that no mesh fits.
    """
    require_planar(assembly)
    material_of(assembly)
    for case in assembly.by_case:
        loaded_mesh(case)


def require_planar(assembly: Assembly) -> None:
    """Raise InputError for a spatial assembly; do nothing for a planar one."""
    if assembly.dimension != 2:
        raise InputError("cracks", "fields are for planar scenes, and this one is spatial", '"faces"')


def require_labels(assembly: Assembly, labels: Bits | None) -> Bits:
    """Check labels of an assembly, and return them as a (m,) bool array.

    labels: (m,) bool, True = dry; None: those of the scene. Raises InputError for another shape or type, and for a dry
    face without a friction coefficient.
    """
    given = np.asarray(assembly.labels if labels is None else labels)
    if given.shape != (len(assembly.interfaces),) or given.dtype != bool:
        raise InputError("labels", f"shape {given.shape} of {given.dtype}", f"({len(assembly.interfaces)},) of bool")
    missing = np.flatnonzero(given & np.isnan(assembly.strengths(_ROUTE).friction))
    if missing.size:
        raise InputError("materials.dry", f"face {assembly.pair(int(missing[0]))} is dry", "a friction coefficient")
    return given


def require_refinement(assembly: Assembly, labels: Bits | None, gap: float, patch: float | None) -> Bits:
    """Check the arguments of a bound by fields, and return the labels (m,).

    Raises InputError for several load cases, and for an argument that is out of bounds or refused by `require_labels`.
    """
    if len(assembly.cases) > 1:
        raise InputError("loads.cases", "fields take one load case", "one of Assembly.by_case")
    if not gap > 0.0:
        raise InputError("gap", f"{gap:g} is no relative gap", "a number above 0")
    if patch is not None and not patch > 0.0:
        raise InputError("patch", f"{patch:g} is wrong", "a length above 0")
    return require_labels(assembly, labels)
