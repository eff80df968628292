"""Rows of a template's yield sets in the kernel's shape, or the answer that they have another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.mechanics import RowPattern, Rows
from jld_core.program import Template

LARGEST: Final = 3000
"""Faces above which one labelling alone is a long solve, and a solver made for large ones is the quicker."""


def fits(template: Template, undecided: Rows | None = None) -> bool:
    """Whether the kernel knows rows of this shape and the structure is small enough for it; undecided: rows of a third
    label, see `rows_of`."""
    return len(template.assembly.interfaces) <= LARGEST and rows_of(template, undecided) is not None


@dataclass(frozen=True)
class Sheets:
    """Numbers of all labels, inner then dry, then undecided where there is a third.

    rows: (labels, m, pairs, 3) a, b, h of −a N ± b X ≤ h; X is M, V, and M where inner faces crush; in space M1, M2,
    and MT with t, the bound on shear. keep: (labels, m) 1 where V counts. bows: (labels, m, 2) c and n₀ of a first pair
    b |M| ≤ h + a N − c N² from N = n₀ on and its tangent at n₀ below, None where no face has one.
    """

    rows: Floats
    keep: Floats
    bows: Floats | None = None


def rows_of(template: Template, undecided: Rows | None = None) -> Sheets | None:
    """The kernel's numbers. undecided: rows of a third label, in the place of those of dry faces.

    None where the pattern has rows of another shape.
    """
    own = template.yield_set
    every = np.ones(len(template.assembly.interfaces), dtype=bool)
    labels = [(own.pattern, False), (own.pattern, True)] + ([] if undecided is None else [(undecided.pattern, True)])
    active = [own.active(~every), own.active(every)] + ([] if undecided is None else [undecided.active(every)])
    make = planar_rows if template.assembly.dimension == 2 else spatial_rows
    sheets = [make(pattern, dry, len(every)) for pattern, dry in labels]
    loose = [0, 2] if template.assembly.dimension == 2 else [0, 1, 2, 3, 4, 5]
    if any(sheet is None for sheet in sheets) or not all(mask[:, loose].all() for mask in active):
        return None
    keep = np.array([mask[:, 1].astype(float) for mask in active])
    rows, bows = np.ascontiguousarray(np.array(sheets)), None
    if own.pattern.cones and template.assembly.dimension == 2:
        bowed = [own.bow(undecided=False), *([] if undecided is None else [own.bow(undecided=True)])]
        if any(one is None for one in bowed):
            return None
        bows = np.zeros((len(rows), len(every), 2))
        for label, one in enumerate(bowed, start=1):
            assert one is not None
            crushed = one.crushed
            bows[label, crushed] = one.bow
            rows[label, crushed] = one.rows[:, : rows.shape[2]]
    return Sheets(rows, np.ascontiguousarray(keep), bows)


def planar_rows(pattern: RowPattern, dry: bool, faces: int) -> Floats | None:
    """(m, pairs, 3) of one label of planar faces, see `rows_of`; cones are the parabolas of crushing joints."""
    if pattern.extra:
        return None
    return _pairs(pattern, *((pattern.dry, pattern.h_dry) if dry else (pattern.inner, pattern.h_inner)), faces)


def _pairs(pattern: RowPattern, values: Floats, sides: Floats, faces: int) -> Floats | None:
    """(m, pairs, 3) of one label, pairs in the order M, V, M."""
    linear = pattern.row < pattern.linear
    row, resultant = pattern.row[linear], pattern.column[linear] % 3
    sides = sides[: pattern.linear]
    table = np.zeros((len(sides), 3))
    table[row, resultant] = values[linear]
    uses = np.zeros((len(sides), 3), dtype=bool)
    uses[row, resultant] = True
    if np.any(uses[:, 1] == uses[:, 2]):
        return None
    found = np.zeros((faces, 3, 3))
    found[:, :, 2] = 1.0
    filled = np.zeros((faces, 3), dtype=bool)
    for face in range(faces):
        own = np.flatnonzero(pattern.row_face[: pattern.linear] == face)
        bending, sliding = own[uses[own, 2]], own[uses[own, 1]]
        if len(sliding) != 2 or len(bending) not in (2, 4):
            return None
        for pair, column, two in ((0, 2, bending[:2]), (1, 1, sliding), (2, 2, bending[2:])):
            if not len(two):
                continue
            (n, k), (x, y), (h, i) = table[two, 0], table[two, column], sides[two]
            if n != k or x != -y or h != i:
                return None
            found[face, pair] = -n, abs(x), h
            filled[face, pair] = True
    if np.any(found[:, :2, 0] < 0.0) or np.any(found[:, 0, 0] == 0.0) or np.any(found[:, :2, 1] == 0.0):
        return None
    return found if filled[:, 2].any() else found[:, :2].copy()


def spatial_rows(pattern: RowPattern, dry: bool, faces: int) -> Floats | None:
    """The same of spatial faces: rectangles in the uncoupled form."""
    if pattern.cones != (3,) * faces or pattern.extra != faces or pattern.linear != 6 * faces:
        return None
    values, sides = (pattern.dry, pattern.h_dry) if dry else (pattern.inner, pattern.h_inner)
    bound = np.zeros(faces, dtype=np.int64)
    extra = pattern.column >= 6 * faces
    bound[pattern.face[extra]] = pattern.column[extra]
    # columns by face: its six resultants, then its bound on shear
    if np.any(extra & (pattern.column != bound[pattern.face])):
        return None
    table = np.zeros((len(sides), 7))
    table[pattern.row, np.where(extra, 6, pattern.column % 6)] = values
    return _spatial_pairs(table, sides, pattern, faces)


def _spatial_pairs(table: Floats, sides: Floats, pattern: RowPattern, faces: int) -> Floats | None:
    """(m, 3, 3) of one label, pairs in the order M1, M2, MT."""
    found = np.zeros((faces, 3, 3))
    cone = np.array([[0.0] * 6 + [-1.0], [0.0, -1.0] + [0.0] * 5, [0.0, 0.0, -1.0] + [0.0] * 4])
    for face in range(faces):
        own = np.flatnonzero(pattern.row_face == face)
        linear, last = own[own < pattern.linear], own[own >= pattern.linear]
        if not np.array_equal(table[last], cone) or sides[last].any():
            return None
        for pair, moment in enumerate((3, 4, 5)):
            two = linear[table[linear, moment] != 0.0]
            if len(two) != 2:
                return None
            rows, (h, other) = table[two], sides[two]
            size = abs(rows[0, moment])
            expected = np.zeros((2, 7))
            expected[:, 0] = rows[0, 0]
            expected[:, moment] = rows[0, moment] * np.array([1.0, -1.0])
            expected[:, 6] = size if moment == 5 else 0.0
            if not np.array_equal(rows, expected) or h != other or rows[0, 0] > 0.0:
                return None
            found[face, pair] = -rows[0, 0], size, h
        if not found[face, :2, 0].all():
            return None
    return found
