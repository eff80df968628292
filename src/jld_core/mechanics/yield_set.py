"""What a yield set is: what a program and a proof may ask of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError


@dataclass(frozen=True)
class RowPattern:
    """Sparsity of G in s = h − G y: linear rows first, then second-order cones.

    row, column, face: (nnz,) place of each coefficient (columns as in A_eq; face it belongs to).
    dry, inner: (nnz,) its value under either label. h_dry, h_inner: (rows,). row_face: (rows,).
    linear: how many rows are linear; cones: sizes of the second-order cones that follow.
    capacity: (k,) which entries hold −μN in a row that limits shear.
    extra: columns beyond the resultants (bounds on shear of spatial faces).
    """

    row: Ints
    column: Ints
    face: Ints
    dry: Floats
    inner: Floats
    h_dry: Floats
    h_inner: Floats
    row_face: Ints
    linear: int
    cones: tuple[int, ...]
    capacity: Ints
    extra: int = 0


class Rows(Protocol):
    """What a program needs to know of the yield sets of all m faces."""

    @property
    def pattern(self) -> RowPattern:
        """Rows of the program."""

    def active(self, labels: Bits) -> Bools:
        """(m, q) False where a resultant is zero in every admissible state (no friction, no shear strength)."""


@dataclass(frozen=True)
class Hull:
    """Rows of faces that may have either label, in the place of those of a dry face; either: (m, q) resultants kept."""

    pattern: RowPattern
    either: Bools

    def active(self, labels: Bits) -> Bools:
        return self.either


@dataclass(frozen=True)
class ParabolicBending:
    """Planar faces that crush: b |M| ≤ h + a N − c N² from N = n₀ on and its tangent at n₀ below, and their shear.

    crushed: (k,) faces. bow: (k, 2) c and n₀. rows: (k, 3, 3) a, b, h of bending, of −a N ± b V ≤ h, and of a line
    −a N ± b M ≤ h that bounds bending too, with a = b = 0 where there is none. meeting: (k, 12) where V and M
    meet, |M| ≤ w m + N₁ − N₁²/((1 − w) N_c) with N₁ = N − w n and |V| = c + μN + w (shear above): N and m of a corner
    of the inner set, its shear above the dry line (0: nowhere), the first and the last N₁/(1 − w); then both labels,
    N_c, μ and c of dry joints, σtA, N_c, shear strength and μ of inner ones. None of decided faces.
    """

    crushed: Ints
    bow: Floats
    rows: Floats
    meeting: Floats | None = None


@dataclass(frozen=True)
class CoulombWedge:
    """Planar faces of one label that nothing crushes: bending |m| ≤ N + tension, |V| ≤ cohesion + friction N, scaled.

    tension, friction, cohesion: (m,). bending: 1 or 3, of all faces. Directions of recession are N (1, ±μ, ±1/bending).
    """

    tension: Floats
    bending: float
    friction: Floats
    cohesion: Floats

    def margin(self, jumps: Floats, faces: Ints) -> Floats:
        """(k,) δ − μ|s| − |θ|/bending of jumps (k, 3) at faces (k,): not negative where D is finite."""
        slip, turn = abs(jumps[:, 1]), abs(jumps[:, 2])
        return np.asarray(jumps[:, 0] - turn / self.bending - self.friction[faces] * slip)

    def dissipation(self, jumps: Floats, faces: Ints) -> Floats:
        """(k,) D = σt (δ − μ|s|) + c|s| of jumps (k, 3) whose margin is not negative."""
        slip = abs(jumps[:, 1])
        return np.asarray(
            self.tension[faces] * (jumps[:, 0] - self.friction[faces] * slip) + self.cohesion[faces] * slip
        )

    def strength(self, faces: Ints) -> Floats:
        """(k,) what D grows by at the most, beside the size of a jump."""
        return np.asarray(self.tension[faces] + self.cohesion[faces])


class YieldSet(Rows, Protocol):
    """What a proof needs to know besides.

    The last four may answer None: then what needs them is not to be had for this set, and nobody may guess.
    """

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        """(m,) least distance of scaled resultants (m, q) to the boundary, negative outside."""

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        """(m,) the same for the recession cone: the directions in which a face can be loaded for ever.

        Resultants outside `recession_active` are taken as zero.
        """

    def recession_active(self, labels: Bits) -> Bools:
        """(m, q) False where a resultant is bounded, so that it is zero in every direction of recession."""

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        """(m,) D(J) = sup −F·J for scaled jumps (m, q) whose `margin` is not negative."""

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        """(m,) least slack of the conditions for D(J) to be finite; +inf where it always is."""

    def utilisation(self, forces: Floats, labels: Bits) -> Floats | None:
        """(m,) share of its strength that each face uses under scaled resultants (m, q): 1 on the boundary."""

    def hull(self) -> Rows | None:
        """Rows that hold whatever either label admits, with the sparsity of `pattern`."""

    def bow(self, *, undecided: bool) -> ParabolicBending | None:
        """Dry planar faces that crush, or what encloses either label where those are undecided; None: not known."""

    def wedge(self, dry: bool) -> CoulombWedge | None:
        """All faces under one label, as wedges with recession directions."""

    def facets(self, labels: Bits) -> tuple[Floats, Floats] | None:
        """Rows C F + d ≥ 0 of each face, (m, 4, 3) and (m, 4): two of bending, then two of shear."""

    @property
    def associative(self) -> FrictionSet:
        """The set whose friction follows N, of which this one is or was made. TypeError where there is none."""


class FrictionSet(YieldSet, Protocol):
    """A yield set of cohesion and friction, (m,) for either label, of which friction may be prescribed."""

    @property
    def tension(self) -> Floats:
        """(m,) σtA of inner faces."""

    @property
    def rough(self) -> bool:
        """Have any inner faces friction?"""

    @property
    def cohesive(self) -> bool:
        """Have any dry faces cohesion?"""

    def is_dry(self, labels: Bits) -> Bools:
        """(m,) faces with the strengths of a dry one."""

    def friction_of(self, labels: Bits) -> Floats:
        """(m,) μ under the labels."""

    def cohesion_of(self, labels: Bits) -> Floats:
        """(m,) scaled shear capacity at N = 0 under the labels."""

    def shear_of(self, forces: Floats) -> Floats:
        """(m,) |V|, in space |V| + |mT|, of scaled resultants: to be held against c + μN."""

    def slip(self, jumps: Floats) -> Floats:
        """(m,) rate at which shear works per unit of capacity."""

    def with_friction(self, share: float) -> FrictionSet:
        """The same with a share of all friction, for proofs: `pattern` stays as it is."""

    def bending_alone(self) -> FrictionSet:
        """The same without any limit on shear, for proofs: `pattern` stays as it is."""


def used(demand: Floats, capacity: Floats, least: float) -> Floats:
    """demand / capacity, 0 where hardly anything is asked (at most `least`), 1 where there is no capacity for it."""
    safe = np.where(capacity > 0.0, capacity, 1.0)
    return np.where(demand <= least, 0.0, np.where(capacity > 0.0, demand / safe, 1.0))


def require_materials(assembly: Assembly, dry: Bits, inner: Bits) -> None:
    """Raise InputError where a face may take a label whose material the scene does not name.

    dry, inner: (m,) masks of the faces that may take the label.
    """
    strengths = assembly.strengths
    for key, mask, values in (
        ("materials.dry", dry, strengths.friction),
        ("materials.inner", inner, strengths.tension + strengths.shear),
    ):
        lacking = np.flatnonzero(mask & np.isnan(values))
        if lacking.size:
            name = key.split(".")[1]
            raise InputError(key, "missing", f"this material, since face {assembly.pair(lacking[0])} may be {name}")
