"""Rows of a template's yield sets in the kernel's shape, or the answer that they have another."""

from __future__ import annotations

import numpy as np

from jld_core.arrays import Floats
from jld_core.mechanics import RowPattern
from jld_core.program import Template


def fits(template: Template) -> bool:
    """Whether the kernel knows rows of this shape."""
    return planar_rows(template) is not None


def planar_rows(template: Template) -> tuple[Floats, Floats] | None:
    """(labels, m, pairs, 3) numbers a, b, h of rows −a N ± b X ≤ h, inner then dry, and (labels, m) 1 where V counts.

    X is M, V, M. None where the pattern has other rows.
    """
    pattern = template.yield_set.pattern
    if template.assembly.dimension != 2 or pattern.cones or pattern.extra:
        return None
    sheets = [_pairs(pattern, values, sides, template) for values, sides in (
        (pattern.inner, pattern.h_inner), (pattern.dry, pattern.h_dry))]  # fmt: skip
    if any(sheet is None for sheet in sheets):
        return None
    every = np.ones(len(template.assembly.interfaces), dtype=bool)
    active = [template.yield_set.active(~every), template.yield_set.active(every)]
    if not all(mask[:, [0, 2]].all() for mask in active):
        return None
    keep = np.array([mask[:, 1].astype(float) for mask in active])
    return np.ascontiguousarray(np.array(sheets)), np.ascontiguousarray(keep)


def _pairs(pattern: RowPattern, values: Floats, sides: Floats, template: Template) -> Floats | None:
    """(m, pairs, 3) of one label, pairs in the order M, V, M."""
    faces = len(template.assembly.interfaces)
    table = np.zeros((len(sides), 3))
    table[pattern.row, pattern.column % 3] = values
    uses = np.zeros((len(sides), 3), dtype=bool)
    uses[pattern.row, pattern.column % 3] = True
    if np.any(uses[:, 1] == uses[:, 2]):
        return None
    found = np.zeros((faces, 3, 3))
    found[:, :, 2] = 1.0
    filled = np.zeros((faces, 3), dtype=bool)
    for face in range(faces):
        own = np.flatnonzero(pattern.row_face == face)
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
