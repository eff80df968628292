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
    extra: int = 0


class Rows(Protocol):
    """What a program needs to know of the yield sets of all m faces."""

    @property
    def pattern(self) -> RowPattern:
        """Rows of the program."""

    def active(self, labels: Bits) -> Bools:
        """(m, q) False where a resultant is zero in every admissible state (no friction, no shear strength)."""


class YieldSet(Rows, Protocol):
    """What a proof needs to know besides."""

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
            faces, ids = assembly.interfaces, assembly.elements.ids
            pair = f"{ids[faces.a[lacking[0]]]}–{ids[faces.b[lacking[0]]]}"
            name = key.split(".")[1]
            raise InputError(key, "missing", f"this material, since face {pair} may be {name}")
