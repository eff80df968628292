"""Protocols of yield sets, as programs and proofs use them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.strengths import CRITERIA, STANDARD, Route, Strengths

_ROUTE: Final = Route("labels", STANDARD | CRITERIA)


@dataclass(frozen=True)
class RowPattern:
    """Sparsity and numbers of the yield rows s = h − G y of all m faces under both labels.

    y are the scaled resultants of all faces, then `extra` variables.
    """

    # (nnz,) entries of G: row, column, face, and the coefficient under either label
    row: Ints
    column: Ints
    face: Ints
    dry: Floats
    inner: Floats
    # (rows,) right-hand sides h under either label, and the face of each row
    h_dry: Floats
    h_inner: Floats
    row_face: Ints
    linear: int  # number of first rows, with s ≥ 0
    cones: tuple[int, ...]  # sizes of the second-order cones of the other rows
    capacity: Ints  # (k,) entries that hold −μ, the coefficient of N in a row that limits shear
    extra: int = 0


class Rows(Protocol):
    """Interface of the yield rows of all m faces, as a program uses them."""

    @property
    def pattern(self) -> RowPattern:
        """Return the sparsity and numbers of the yield rows of all faces."""

    def active(self, labels: Bits) -> Bools:
        """Return a mask (m, q), False where a resultant is zero in every admissible state."""


@dataclass(frozen=True)
class Hull:
    """Yield rows of undecided faces that enclose both sets, in place of rows of dry faces, docs/method.md (6.3)."""

    pattern: RowPattern  # `dry` and `h_dry` hold the enclosing rows
    either: Bools  # (m, q) resultants that a label allows to be non-zero

    def active(self, labels: Bits) -> Bools:
        """Return the mask `either` (m, q); the labels have no effect."""
        return self.either


@dataclass(frozen=True)
class ParabolicBending:
    """Planar faces that crush: a parabolic limit on bending, linear ones on shear.

    Bending: b |M| ≤ h + a N − c N² from N = n₀ on, and the tangent at n₀ below. Where the label is undecided, V and M
    may interact, docs/method.md (6.3). An inner copy of the face then carries a share w of a corner (n, m) of the inner
    set, and the dry copy carries N₁ = N − w n. Together |M| ≤ w m + N₁ − N₁²/((1 − w) N_c) and |V| ≤ c + μN + w v,
    where v is the shear of the corner above the dry line.
    """

    crushed: Ints  # (k,) faces
    parabola: Floats  # (k, 2) c and n₀
    # (k, 3, 3) a, b, h of bending; of −a N ± b V ≤ h; of a line −a N ± b M ≤ h that bounds bending, a = b = 0: none
    rows: Floats
    # (k, 12) interaction of V and M: n and m of the corner; v (0: no interaction); the first and last N₁/(1 − w); N_c,
    # μ and c of dry faces; σtA, N_c, shear strength and μ of inner faces. None if the label is decided.
    interaction: Floats | None = None


@dataclass(frozen=True)
class CoulombWedge:
    """Planar sets of one label without crushing: bending·|m| ≤ N + tension, |V| ≤ shear + friction·N.

    bending: 1 (dry) or 3 (inner). Directions of recession are N (1, ±μ, ±1/bending).
    """

    tension: Floats
    bending: float
    friction: Floats
    shear: Floats

    def margin(self, jumps: Floats, faces: Ints) -> Floats:
        """Return δ − μ|s| − |θ|/bending (k,) of scaled jumps (δ, s, θ) (k, 3): finite dissipation where ≥ 0."""
        slip, turn = abs(jumps[:, 1]), abs(jumps[:, 2])
        return np.asarray(jumps[:, 0] - turn / self.bending - self.friction[faces] * slip)

    def dissipation(self, jumps: Floats, faces: Ints) -> Floats:
        """Return σt (δ − μ|s|) + c|s| (k,) of scaled jumps (k, 3), where `margin` ≥ 0."""
        slip = abs(jumps[:, 1])
        return np.asarray(self.tension[faces] * (jumps[:, 0] - self.friction[faces] * slip) + self.shear[faces] * slip)

    def strength(self, faces: Ints) -> Floats:
        """Return tensile plus shear strength (k,) of faces: the largest dissipation of a jump of size 1."""
        return np.asarray(self.tension[faces] + self.shear[faces])


class YieldSet(Rows, Protocol):
    """Interface of a yield set, as proofs use it.

    Methods take forces (m, q), scaled resultants; jumps (m, q), scaled jumps; and labels (m,), True = dry.
    `utilisation`, `hull`, `parabolic_bending`, `coulomb_wedge` and `facets` may return None. The set then has no such
    result, and callers must do without it.
    """

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the least slack (m,) of forces (m, q): 0 on the boundary, negative outside."""

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of forces (m, q) in the recession cone; only `recession_active` ones count."""

    def recession_active(self, labels: Bits) -> Bools:
        """Return a mask (m, q), True where a resultant may be non-zero in the recession cone."""

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the dissipation D(J) = sup −F·J (m,) of jumps (m, q), valid where `margin` is ≥ 0."""

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of the conditions for finite dissipation of jumps (m, q); inf if always finite."""

    def strength(self, labels: Bits) -> Floats:
        """Return the largest dissipation (m,) of a jump of size 1, up to a factor of order one.

        labels: (m,) True = dry.
        """

    def utilisation(self, forces: Floats, labels: Bits) -> Floats | None:
        """Return the share of its strength (m,) that each face uses, 1 on the boundary, or None if unknown."""

    def hull(self) -> Rows | None:
        """Return yield rows that enclose both labels' sets, with the sparsity of `pattern`; None if unknown."""

    def parabolic_bending(self, *, undecided: bool) -> ParabolicBending | None:
        """Return the parabolic sets of planar joints that crush, or those of both labels; None if unknown."""

    def coulomb_wedge(self, dry: bool) -> CoulombWedge | None:
        """Return the sets of one label as wedges; None if a face has a compressive strength."""

    def facets(self, labels: Bits) -> tuple[Floats, Floats] | None:
        """Return rows C F + d ≥ 0 of (N, V, m): C (m, 4, 3), two of bending, two of shear; None for other rows."""

    @property
    def associative(self) -> FrictionSet:
        """Return the set of associative friction that this one was made from, maybe itself; TypeError if none."""


class FrictionSet(YieldSet, Protocol):
    """Interface of a yield set with friction, whose friction may be prescribed."""

    @property
    def numbers(self) -> Strengths:
        """Return the scaled strengths of the faces."""

    @property
    def tension(self) -> Floats:
        """Return the scaled tensile strength σtA (m,) of each face under the inner label."""

    @property
    def has_inner_friction(self) -> bool:
        """Return True if any inner face has friction."""

    @property
    def has_dry_shear(self) -> bool:
        """Return True if any dry face resists shear without N."""

    def is_dry(self, labels: Bits) -> Bools:
        """Return a mask (m,), True for faces that have the strengths of a dry face. labels: (m,) True = dry."""

    def friction_of(self, labels: Bits) -> Floats:
        """Return the friction coefficient μ (m,) of each face under labels (m,), True = dry."""

    def capacity_of(self, labels: Bits) -> Floats:
        """Return the scaled shear capacity (m,) of each face at N = 0. labels: (m,) True = dry."""

    def shear_of(self, forces: Floats) -> Floats:
        """Return the shear demand (m,) of resultants (m, q), to compare with c + μN: |V|, in space |V| + |mT|."""

    def slip(self, jumps: Floats) -> Floats:
        """Return the dissipation (m,) of jumps (m, q) per shear capacity: |s|, in space max(|s|, |ω|)."""

    def with_strengths(self, sets: Strengths) -> FrictionSet:
        """Return the sets of the same faces with other scaled strengths (m,), infinite as before, and rows."""

    def with_friction(self, share: float) -> FrictionSet:
        """Return a copy with all μ multiplied by `share`, for proofs only: `pattern` stays."""

    def without_shear_limit(self) -> FrictionSet:
        """Return a copy without any limit on shear, for proofs only: `pattern` stays."""


def used(demand: Floats, capacity: Floats, least: float) -> Floats:
    """Return the ratio demand / capacity of each face.

    Parameters
    ----------
    demand, capacity : (m,) array
        Scaled forces.
    least : float
        Demand up to which the ratio is 0.

    Returns
    -------
    (m,) array
        Ratios, 1 without positive capacity.
    """
    safe = np.where(capacity > 0.0, capacity, 1.0)
    return np.where(demand <= least, 0.0, np.where(capacity > 0.0, demand / safe, 1.0))


def require_materials(assembly: Assembly, dry: Bits, inner: Bits) -> None:
    """Raise InputError if a face may take a label whose material the scene does not name.

    Parameters
    ----------
    assembly : Assembly
        A planar or spatial structure.
    dry, inner : (m,) bool arrays
        Faces that may take the label.

    Raises
    ------
    InputError
        A material is missing; the message names the first such face.
    """
    strengths = assembly.strengths(_ROUTE)
    for key, mask, values in (
        ("materials.dry", dry, strengths.friction),
        ("materials.inner", inner, strengths.tension + strengths.shear),
    ):
        name = key.split(".")[1]
        of_criteria = [criterion.faces for criterion in assembly.face_strengths.criteria if criterion.label == name]
        missing = np.flatnonzero(mask & np.isnan(values) & ~np.any([~mask & mask, *of_criteria], axis=0))
        if missing.size:
            face = assembly.pair(missing[0])
            if any(faces.any() for faces in of_criteria):
                remedy = "all strengths of it, or a criterion of its own"
                raise InputError(key, f"it has a criterion, and face {face} states single strengths beside it", remedy)
            raise InputError(key, "missing", f"this material, since face {face} may be {name}")


Term = tuple[Ints, list[Floats]]  # columns (k,) of a family of rows, and their coefficients (k,) in each of the sets
Row = tuple[list[Term], list[Floats]]  # terms of a family of rows, and their right-hand sides (k,) in each of the sets


class Sheet:
    """Rows of two or three `sets` of `faces` faces, collected family by family; further numbers are left out."""

    def __init__(self, faces: int, freedoms: int, sets: int) -> None:
        self.faces, self.freedoms, self.sets, self.rows, self.extra = faces, freedoms, sets, 0, 0
        self._entries: list[tuple[Ints, Ints, Ints, Floats]] = []  # rows, columns, faces, values (sets, k)
        self._sides: list[tuple[Ints, Ints, Floats]] = []  # rows, faces, right-hand sides (sets, k)
        self._capacity: list[Ints] = []
        self._length = self._cones = 0

    def column(self, face: Ints, resultant: int) -> Ints:
        return self.freedoms * face + resultant

    def new_columns(self, count: int) -> Ints:
        columns = self.freedoms * self.faces + self.extra + np.arange(count)
        self.extra += count
        return columns

    def add(
        self,
        face: Ints,
        terms: list[Term],
        sides: list[Floats],
        rows: Ints | None = None,
        *,
        limits_shear: bool = False,
    ) -> None:
        """Add one row for each face (k,), by default after the present ones; limits_shear: the first term is −μN."""
        if rows is None:
            rows = self.rows + np.arange(len(face))
            self.rows += len(face)
        for k, (column, values) in enumerate(terms):
            coefficients = np.array(values[: self.sets])
            # Planar entries stay if they are zero: they hold the columns of a face together.
            nonzero = np.any(coefficients != 0.0, axis=0)
            if nonzero.all() or (limits_shear and self.freedoms == 3):
                entries = rows, column, face, coefficients
            else:
                entries = rows[nonzero], column[nonzero], face[nonzero], coefficients[:, nonzero]
            if len(entries[0]):
                self._entries.append(entries)
            if limits_shear and k == 0:
                self._capacity.append(self._length + np.arange(len(entries[0])))
            self._length += len(entries[0])
        self._sides.append((rows, face, np.array(sides[: self.sets])))

    def cones(self, face: Ints, rows: list[Row], *, limits_shear: bool = False) -> None:
        """Add one second-order cone per face (k,); limits_shear: True if its first row begins with −μN."""
        for offset, (terms, sides) in enumerate(rows):
            cone_rows = self.rows + len(rows) * np.arange(len(face)) + offset
            self.add(face, terms, sides, cone_rows, limits_shear=limits_shear and offset == 0)
        self.rows += len(rows) * len(face)
        self._cones += len(face)

    def patterns(self, linear: int) -> tuple[RowPattern, ...]:
        """Return the rows of both labels, and those with enclosing rows in place of dry ones."""
        row, column, face, values = (np.concatenate(part, axis=-1) for part in zip(*self._entries, strict=True))
        order = np.argsort(np.concatenate([rows for rows, _, _ in self._sides]))
        h = np.concatenate([side for _, _, side in self._sides], axis=1)[:, order]
        # sets: dry, inner, and a third that encloses both where there is one
        of_labels = RowPattern(
            row=row,
            column=column,
            face=face,
            dry=values[0],
            inner=values[1],
            h_dry=h[0],
            h_inner=h[1],
            row_face=np.concatenate([faces for _, faces, _ in self._sides])[order],
            linear=linear,
            cones=(3,) * self._cones,
            capacity=np.concatenate([np.zeros(0, dtype=np.int64), *self._capacity]),
            extra=self.extra,
        )
        enclosing = zip(values[2:], h[2:], strict=True)
        return of_labels, *(replace(of_labels, dry=dry, h_dry=h_dry) for dry, h_dry in enclosing)
