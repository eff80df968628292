"""Non-dimensional problem of both bounds, in the plane and in space, with numbers of order one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.forms import Material
from jld_core.fields.loads import FieldLoads, loaded_mesh, thickness_of
from jld_core.fields.mesh import Mesh, Sides, patch_tag
from jld_core.scene.standard import key_of
from jld_core.strengths import Route

_ROUTE: Final = Route("cracks by fields")


def material_of(assembly: Assembly) -> Material:
    """Return the material of all blocks; InputError: no or zero inner strengths, differing faces, or members."""
    # The tensile strength is reduced to τ / μi, the apex of Mohr–Coulomb, where it is larger.
    assembly.members.refuse("an analysis by fields")
    values = np.column_stack(list(vars(assembly.strengths(_ROUTE).side(dry=False)).values()))
    stated = values[~np.isnan(values[:, :2]).any(axis=1)]
    if not len(stated):
        raise InputError(
            "materials.inner",
            "cracks by fields need the strengths of the blocks",
            " and ".join(key_of("inner", side) for side in ("tension", "shear")),
        )
    comparable = np.where(np.isinf(stated), -1.0, stated)
    if not (np.ptp(comparable, axis=0) <= tolerances.ROUNDING * abs(comparable).max(axis=0)).all():
        raise InputError(
            "interfaces", "inner strengths differ between faces; fields take one material", "one inner material"
        )
    tension, shear, friction, crushing = (float(value) for value in stated[0])
    for key, value in ((key_of("inner", "tension"), tension), (key_of("inner", "shear"), shear)):
        if not value > 0.0:
            raise InputError(f"materials.inner.{key}", f"{value:g} is too small for stress fields", "a stress above 0")
    if friction:
        # at the apex of friction the cut-off idles
        tension = min(tension, shear / friction)
    return Material(tension, shear, friction, crushing)


@dataclass(frozen=True)
class Units:
    """Units of a scaled problem: scene value = unit × scaled value."""

    length: float
    stress: float
    load: float
    velocity: float  # of velocities on which the live load does unit work, 1 / force
    origin: Floats  # (2,) or (3,) point that becomes zero


@dataclass(frozen=True)
class Joints:
    """Scaled strengths of the m interfaces as dry joints, (m,) each."""

    friction: Floats  # coefficient μ, 0 where the scene gives none
    shear: Floats  # resistance to shear without pressure, over `Units.stress`
    crushing: Floats  # compressive strength, over `Units.stress`; inf where the joint cannot crush


@dataclass(frozen=True)
class Problem:
    """Scaled limit analysis of blocks on one mesh; of unit thickness in the plane."""

    units: Units  # units of all other attributes
    material: Material  # scaled material of the blocks
    joints: Joints  # scaled strengths of the m interfaces as dry joints
    mesh: Mesh  # scaled coordinates
    # dead, live: (t, d) forces per volume, scaled; live for λ = 1
    dead: Floats
    live: Floats
    # dead_pull, pull: (f, d, d) dead and live tractions (corner, axis) at the corners of each side, scaled; live for
    # λ = 1. Zero where no load acts.
    dead_pull: Floats
    pull: Floats

    @property
    def loaded(self) -> bool:
        return bool(self.dead.any() or self.dead_pull.any())

    def without_dead_load(self) -> Problem:
        return replace(self, dead=np.zeros_like(self.dead), dead_pull=np.zeros_like(self.dead_pull))

    def under_dead_load(self) -> Problem:
        return replace(self, live=self.dead, pull=self.dead_pull).without_dead_load()

    @property
    def sides(self) -> Sides:
        return self.mesh.sides

    @cached_property
    def face(self) -> Ints:
        """(f,) interface that each side lies on, −1 for none."""
        return np.maximum(self.sides.tag, -1)

    @cached_property
    def inside(self) -> Ints:
        """(k,) sides inside a cell, between two of its simplices."""
        return np.flatnonzero((self.sides.b >= 0) & (self.face < 0))

    @cached_property
    def joined(self) -> Ints:
        """(k,) sides between two simplices, inside cells or on interfaces without support."""
        return np.flatnonzero(self.sides.b >= 0)

    @cached_property
    def jumps(self) -> Ints:
        """(k,) sides on which velocities may jump: inside cells and on interfaces, those at supports included."""
        return np.flatnonzero((self.sides.b >= 0) | (self.face >= 0))

    @cached_property
    def on_faces(self) -> Ints:
        """(k,) sides on interfaces, those at supports included."""
        return np.flatnonzero(self.face >= 0)

    @cached_property
    def outer(self) -> Ints:
        """(k,) sides on the free surface of cells, with or without a traction."""
        return np.flatnonzero((self.sides.b < 0) & (self.face < 0))

    def is_dry(self, labels: Bits) -> Bools:
        """Return (f,) True for sides on dry interfaces."""
        dry = np.zeros(len(self.face), dtype=bool)
        dry[self.on_faces] = labels[self.face[self.on_faces]]
        return dry


_LEAST_DEAD = 1e-4  # least stress of the dead load that the unit takes, over the strength


def units_of(assembly: Assembly, material: Material) -> Units:
    """Choose units by sizes, strengths and loads alone: not by position, rotation or units of the scene."""
    elements, free = assembly.elements, assembly.elements.free
    volume = elements.volume[free].sum()
    if assembly.dimension == 2:
        width = thickness_of(assembly)
        length = float(np.sqrt(volume / width))
    else:
        length = width = float(np.cbrt(volume))
    strength = min(material.shear, material.tension)
    dead = assembly.total_dead / (length * width)
    # between strength and weight, whichever governs; a weight of nothing is no measure
    stress = min(strength, float(np.sqrt(strength * max(dead, _LEAST_DEAD * strength)))) if dead > 0.0 else strength
    origin = 0.5 * (elements.lower[free].min(axis=0) + elements.upper[free].max(axis=0))
    live, force = assembly.total_live, stress * length * width if assembly.dimension == 2 else stress * length**2
    return Units(length, stress, force / live, 1.0 / live, origin)


def problem_of(assembly: Assembly, material: Material, units: Units, mesh: Mesh, loads: FieldLoads) -> Problem:
    # all data of the problem are scaled by the units
    per_volume = units.length / units.stress  # scales forces per volume
    dry_strengths, sides = assembly.strengths(_ROUTE).side(dry=True), mesh.sides
    crushing = np.where(np.isnan(dry_strengths.crush), np.inf, dry_strengths.crush)
    pull = np.zeros((2, len(sides), mesh.dimension, mesh.dimension))
    for index, traction in enumerate(loads.tractions):
        rows = np.flatnonzero((sides.tag == patch_tag(index)) & (mesh.cell[sides.a] == traction.cell))
        pull[:, rows] = traction.at(mesh.corners[sides.a[rows][:, None], sides.corner_a[rows]])
    return Problem(
        units=units,
        material=material.scaled(units.stress),
        joints=Joints(
            np.nan_to_num(dry_strengths.friction, nan=0.0), dry_strengths.shear / units.stress, crushing / units.stress
        ),
        mesh=replace(mesh, points=(mesh.points - units.origin) / units.length),
        dead=loads.dead[mesh.root] * per_volume,
        live=loads.live[mesh.root] * (per_volume * units.load),
        dead_pull=pull[0] / units.stress,
        pull=pull[1] * (units.load / units.stress),
    )


def require_fields(assembly: Assembly) -> None:
    """Raise InputError if λ cannot be bounded by fields, whatever the labels."""
    # Members, inner strengths missing, zero or different, loads without room for their patch, outlines that no mesh
    # fits, cells in space that are not convex.
    material_of(assembly)
    load: Callable[[Assembly], object] = loaded_mesh
    if assembly.dimension == 3:
        from jld_core.fields.solids import loaded_solids  # planar scenes do not load it

        load = loaded_solids
    for case in assembly.by_case:
        load(case)


def require_planar(assembly: Assembly) -> None:
    if assembly.dimension != 2:
        raise InputError("cracks", "fields are for planar scenes, and this one is spatial", '"faces"')


def require_planar_fields(assembly: Assembly) -> None:
    """Raise InputError for a spatial assembly, and as `require_fields`."""
    require_planar(assembly)
    require_fields(assembly)


def require_refinement(assembly: Assembly, labels: Bits | None, gap: float, patch: float | None) -> Bits:
    """Check the arguments of a bound by fields, and return the labels (m,); InputError for several load cases."""
    if len(assembly.cases) > 1:
        raise InputError("loads.cases", "fields take one load case", "one of Assembly.by_case")
    if not gap > 0.0:
        raise InputError("gap", f"{gap:g} is no relative gap", "a number above 0")
    if patch is not None and not patch > 0.0:
        raise InputError("patch", f"{patch:g} is wrong", "a length above 0")
    # labels (m,), by default those of the scene; InputError for shape, type, or a dry face without friction
    checked = np.asarray(assembly.labels if labels is None else labels)
    if checked.shape != (len(assembly.interfaces),) or checked.dtype != bool:
        shape = f"({len(assembly.interfaces)},) of bool"
        raise InputError("labels", f"shape {checked.shape} of {checked.dtype}", shape)
    missing = np.flatnonzero(checked & np.isnan(assembly.strengths(_ROUTE).friction))
    if missing.size:
        raise InputError("materials.dry", f"face {assembly.pair(int(missing[0]))} is dry", "a friction coefficient")
    return checked
