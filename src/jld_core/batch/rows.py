"""Convert the rows of a template's yield sets to the layout of the batch solver, if that supports them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.batch.pattern import FactorPattern, factor_pattern, number_of_products
from jld_core.mechanics import RowPattern, Rows, YieldSet
from jld_core.program import Template

LARGEST: Final = 3000
"""Number of faces above which the batch solver is not used: others solve large structures faster, one at a time."""

EDGES: Final = 8
"""Largest number of hull edges of a spatial face."""

_SIZES: Final = (4, EDGES)  # numbers of hull edges for which the batch solver is compiled

# Rows of the shear cone of a spatial face, columns N, V1, V2, M1, M2, MT and the bound t on shear
_CONE: Final = np.array([[0.0] * 6 + [-1.0], [0.0, -1.0] + [0.0] * 5, [0.0, 0.0, -1.0] + [0.0] * 4])

MOST: Final = 15_000_000
"""Number of scalar products of one factorisation above which the batch solver is not used.

Measured: 6³ cubes 8 million, 10³ cubes 290 million, a wall of 30 × 30 cells 2.5 million.
"""

_SMALL: Final = 300  # number of faces up to which every structure stays below `MOST`, so that none is counted


def fits(template: Template, undecided: Rows | None = None) -> bool:
    """Return True if the batch solver supports the rows and the size of a template.

    template: assembly and yield sets. undecided: rows of undecided faces (see `rows_of`). Result: False for more than
    `LARGEST` faces, more than `MOST` products in a factorisation, rows of another shape, or for a member that acts on
    more than two elements.
    """
    return (
        len(template.assembly.interfaces) <= LARGEST
        and template.assembly.members.ends is not None
        and rows_of(template, undecided) is not None
        and (len(template.assembly.interfaces) <= _SMALL or _products(template.assembly) <= MOST)
    )


def _products(assembly: Assembly) -> int:
    """Return the number of scalar multiplications in one block Cholesky factorisation."""
    return number_of_products(*_graph(assembly)[0]) * assembly.freedoms**3


def pattern_of(assembly: Assembly) -> tuple[FactorPattern, Ints, Ints]:
    """Return the factor pattern of an assembly's equilibrium, and the elements of each face.

    The elements of each face are arrays (m,), numbered among the free elements; −1 stands for a support.
    """
    graph, a, b = _graph(assembly)
    return factor_pattern(*graph), a, b


def _graph(assembly: Assembly) -> tuple[tuple[Ints, Ints, Floats], Ints, Ints]:
    """Return what `factor_pattern` takes of an assembly, and the elements of each face as `pattern_of` does."""
    elements, faces = assembly.elements, assembly.interfaces
    node = np.full(len(elements), -1, dtype=np.int64)
    node[elements.free] = np.arange(len(elements.free))
    first, second = faces.a.copy(), faces.b.copy()
    members = assembly.members
    own = members.face >= 0
    if members.ends is not None:
        first[members.face[own]], second[members.face[own]] = members.ends[own].T
    a, b = node[first], node[second]
    both = (a >= 0) & (b >= 0)
    return (a[both], b[both], elements.centroid[elements.free]), a, b


@dataclass(frozen=True)
class BatchRows:
    """Coefficients of the yield rows of all faces, under each label, for the batch solver.

    Resultants are scaled. The labels are inner, dry and, where given, undecided, in this order.

    rows: (labels, m, numbers) planar: a, b, h of −a N ± b X ≤ h for each pair, where X is M, V, and M again where inner
    faces crush. In space, where all faces bend in two pairs: a, b, h of M1, of M2, and of −a N ± b MT + b t ≤ h, with t
    the bound on shear. In space otherwise: a, p, q, h of −a N + p M1 + q M2 ≤ h for each hull edge; the corners (p, q)
    between edges; and a, b, h of MT. pairs: number of pairs of rows; in space 2 (pairs in bending), or the number of
    edges for which there is space. keep: (labels, m) 1 where V takes part in equilibrium, else 0. parabolas: (labels,
    m, 2 or 14) c and n₀ of a first pair b |M| ≤ h + a N − c N² from N = n₀ on, and its tangent at n₀ below. None where
    no face has one. With `interacts`, the numbers of `ParabolicBending.interaction` follow n₀, 0 for decided labels.
    interacts: True where undecided faces crush and their V and M interact.
    """

    rows: Floats
    pairs: int
    keep: Floats
    parabolas: Floats | None = None
    interacts: bool = False


def rows_of(template: Template, undecided: Rows | None = None) -> BatchRows | None:
    """Return a template's yield rows in the layout of the batch solver.

    undecided: rows of undecided faces, which become a third label beside inner and dry. The result is None if the batch
    solver does not support the rows.
    """
    # Cached, because both `fits` and the constructor of the batch solver ask for the same template.
    return _decided(template) if undecided is None else _rows_of(template, undecided)


def rows_of_samples(own: YieldSet, labels: Bits, dimension: int) -> BatchRows | None:
    """Compute the yield rows of many samples of strengths under one labelling.

    own: yield sets of the faces of all samples, sample by sample. labels: (k, m) labels of each sample, True = dry.
    dimension: 2 or 3. Result: rows of k samples; None if the batch solver does not support them.
    """
    both = rows_of_sets(own, labels.size, dimension)
    if both is None:
        return None
    label, face = labels.astype(np.int64).ravel(), np.arange(labels.size)
    bent = both.parabolas
    rows, keep, parabolas = (
        np.ascontiguousarray(one[label, face].reshape(*labels.shape, *one.shape[2:]))
        for one in (both.rows, both.keep, np.zeros((*both.keep.shape, 0)) if bent is None else bent)
    )
    return BatchRows(rows, both.pairs, keep, None if bent is None else parabolas, both.interacts)


@lru_cache(maxsize=2)
def _decided(template: Template) -> BatchRows | None:
    """Compute the rows of the labels inner and dry; cached; None if unsupported."""
    return _rows_of(template, None)


def _rows_of(template: Template, undecided: Rows | None) -> BatchRows | None:
    """Compute the rows of all labels; None if the batch solver does not support them.

    undecided: rows of a third label, None without one.
    """
    return rows_of_sets(template.yield_set, len(template.assembly.interfaces), template.assembly.dimension, undecided)


def rows_of_sets(own: YieldSet, faces: int, dimension: int, undecided: Rows | None = None) -> BatchRows | None:
    """Compute the rows of the yield sets of faces, in the layout of the batch solver.

    own: yield sets of all faces under both labels. faces: number m of faces. dimension: 2 or 3. undecided: rows of
    undecided faces, which become a third label. Result: None if the batch solver does not support the rows.
    """
    every = np.ones(faces, dtype=bool)
    labels = [(own.pattern, False), (own.pattern, True)] + ([] if undecided is None else [(undecided.pattern, True)])
    active = [own.active(~every), own.active(every)] + ([] if undecided is None else [undecided.active(every)])
    planar = dimension == 2
    make = planar_rows if planar else spatial_rows
    sheets = [make(pattern, dry, faces) for pattern, dry in labels]
    loose, held = ([0, 2], [1]) if planar else ([0, 3, 4], [1, 2, 5])
    if any(sheet is None for sheet in sheets):
        return None
    # The layout has one flag per face, so shear and torsion must be dropped together.
    if not all(mask[:, loose].all() and (mask[:, held] == mask[:, held[:1]]).all() for mask in active):
        return None
    keep = np.ascontiguousarray([mask[:, 1].astype(float) for mask in active])
    rows = np.array(sheets)
    if not planar:
        paired = _in_pairs(rows)
        if paired is not None:
            return BatchRows(np.ascontiguousarray(paired), 2, keep)
        rows = _along_edges(rows)
        return BatchRows(np.ascontiguousarray(rows), (rows.shape[-1] - 3) // 6, keep)
    parabolas, interacts = None, False
    if own.pattern.cones:
        asked = [
            own.parabolic_bending(undecided=False),
            *([] if undecided is None else [own.parabolic_bending(undecided=True)]),
        ]
        bowed = [one for one in asked if one is not None]
        if len(bowed) < len(asked):
            return None
        interacts = rows.shape[2] == 3 and any(one.interaction is not None for one in bowed)
        parabolas = np.zeros((len(rows), faces, 14 if interacts else 2))
        for label, one in enumerate(bowed, start=1):
            crushed = one.crushed
            parabolas[label, crushed, :2] = one.parabola
            rows[label, crushed] = one.rows[:, : rows.shape[2]]
            if interacts and one.interaction is not None:
                parabolas[label, crushed, 2:] = one.interaction
    flat = np.ascontiguousarray(rows.reshape(*rows.shape[:2], -1))
    return BatchRows(flat, rows.shape[2], keep, parabolas, interacts)


def planar_rows(pattern: RowPattern, dry: bool, faces: int) -> Floats | None:
    """Return the linear rows (m, pairs, 3) of planar faces under one label.

    A pair is a, b, h of −a N ± b X ≤ h. X is M, V and, where inner faces crush, M again. Cones are ignored here: they
    are the parabolas of crushing joints. pattern: rows of the yield sets. dry: True for the dry label. faces: m. The
    result is None if the batch solver does not support the rows.
    """
    if pattern.extra:
        return None
    return _pairs(pattern, *((pattern.dry, pattern.h_dry) if dry else (pattern.inner, pattern.h_inner)), faces)


def _pairs(pattern: RowPattern, values: Floats, sides: Floats, faces: int) -> Floats | None:
    """Return the coefficients a, b, h of one label's rows −a N ± b X ≤ h, (m, pairs, 3).

    X is M, V and, where inner faces crush, M again. pattern: rows of the yield sets. values, sides: coefficients and
    right-hand sides of the label. faces: m. None if the rows form no such pairs.
    """
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
    own, bends = pattern.row_face[: pattern.linear], uses[:, 2]
    bending, sliding = _by_face(np.flatnonzero(bends), own, faces), _by_face(np.flatnonzero(~bends), own, faces)
    if bending is None or sliding is None or sliding.shape[1] != 2 or bending.shape[1] not in (2, 4):
        return None
    filled = np.zeros((faces, 3), dtype=bool)
    for pair, column, two in ((0, 2, bending[:, :2]), (1, 1, sliding), (2, 2, bending[:, 2:])):
        some = np.flatnonzero((two >= 0).any(axis=1)) if two.shape[1] else np.zeros(0, dtype=np.int64)
        one, other = two[some].T if len(some) else (some, some)
        if np.any(one < 0) or np.any(other < 0) or (pair < 2 and len(some) < faces):
            return None
        alike = (table[one, 0] == table[other, 0]) & (table[one, column] == -table[other, column])
        if not np.all(alike & (sides[one] == sides[other])):
            return None
        found[some, pair] = np.column_stack([-table[one, 0], abs(table[one, column]), sides[one]])
        filled[some, pair] = True
    if np.any(found[:, :2, 0] < 0.0) or np.any(found[:, 0, 0] == 0.0) or np.any(found[:, :2, 1] == 0.0):
        return None
    return found if filled[:, 2].any() else found[:, :2].copy()


def _by_face(rows: Ints, owner: Ints, faces: int) -> Ints | None:
    """Return the rows (m, most) of each face in order, −1 where a face has fewer; None if a face has none.

    rows: numbers of rows, ascending. owner: (all rows,) face of each.
    """
    rows = rows[np.argsort(owner[rows], kind="stable")]
    counts = np.bincount(owner[rows], minlength=faces)
    if not counts.all():
        return None
    table = np.full((faces, int(counts.max())), -1, dtype=np.int64)
    first = np.cumsum(counts) - counts
    table[owner[rows], np.arange(len(rows)) - np.repeat(first, counts)] = rows
    return table


def spatial_rows(pattern: RowPattern, dry: bool, faces: int) -> Floats | None:
    """Return the yield rows (m, EDGES + 1, 4) of spatial faces under one label.

    Rows 0 to EDGES − 1 of a face hold a, p, q, h of −a N + p M1 + q M2 ≤ h, one per hull edge; those left over have p =
    q = 0. The last row holds a, b, h, 0 of −a N ± b MT + b t ≤ h, where t is the bound on shear. pattern: rows of the
    yield sets. dry: True for the dry label. faces: m. The result is None if the batch solver does not support the rows.
    """
    if pattern.cones != (3,) * faces or pattern.extra != faces:
        return None
    values, sides = (pattern.dry, pattern.h_dry) if dry else (pattern.inner, pattern.h_inner)
    bound = np.zeros(faces, dtype=np.int64)
    extra = pattern.column >= 6 * faces
    bound[pattern.face[extra]] = pattern.column[extra]
    # Columns of the table: six resultants of the face, its bound on shear, the right-hand side.
    if np.any(extra & (pattern.column != bound[pattern.face])):
        return None
    table = np.zeros((len(sides), 8))
    table[pattern.row, np.where(extra, 6, pattern.column % 6)] = values
    table[:, 7] = sides
    return _spatial_table(table, pattern, faces)


def _spatial_table(table: Floats, pattern: RowPattern, faces: int) -> Floats | None:
    """Return the coefficients (m, EDGES + 1, 4) of spatial yield rows under one label.

    Bending rows come first: a, p, q, h of −a N + p M1 + q M2 ≤ h, idle rows last. The last row holds a, b, h, 0 of
    torsion. table: dense rows of the program. None if unsupported.
    """
    found = np.zeros((faces, EDGES + 1, 4))
    found[:, :, 3] = 1.0
    owners = pattern.row_face
    twists = np.zeros(len(owners), dtype=bool)
    twists[: pattern.linear] = table[: pattern.linear, 5] != 0.0
    bends = ~twists
    bends[pattern.linear :] = False
    parts = [np.flatnonzero(mask) for mask in (bends, twists)] + [np.arange(pattern.linear, len(owners))]
    bending, torsion, last = (_by_face(part, owners, faces) for part in parts)
    if bending is None or torsion is None or last is None or torsion.shape[1] != 2 or last.shape[1] != 3:
        return None
    if torsion.min() < 0 or bending[:, :3].min() < 0 or not 3 <= bending.shape[1] <= EDGES:
        return None
    # Where a face resists no shear, V is dropped and its cone has right-hand side one.
    cone = table[last]
    if np.any(cone[:, :, :7] != _CONE) or cone[:, 1:, 7].any() or not np.isin(cone[:, 0, 7], (0.0, 1.0)).all():
        return None
    one, other = table[torsion].transpose(1, 0, 2)
    size, none = abs(one[:, 5]), np.zeros(faces)
    for row, sign in ((one, 1.0), (other, -1.0)):
        expected = np.column_stack([one[:, 0], none, none, none, none, sign * one[:, 5], size, one[:, 7]])
        if not np.array_equal(row, expected):
            return None
    face, place = np.nonzero(bending >= 0)
    edges = table[bending[face, place]]
    first = table[bending[face, 0]]
    # The compiled solver relies on equal a and equal h of all edges of a face.
    if np.any(one[:, 0] > 0.0) or np.any(edges[:, [1, 2, 6]]) or np.any(edges[:, 0] >= 0.0):
        return None
    if np.any(edges[:, [0, 7]] != first[:, [0, 7]]):
        return None
    found[face, place] = np.column_stack([-edges[:, 0], edges[:, 3:5], edges[:, 7]])
    found[:, EDGES] = np.column_stack([-one[:, 0], size, one[:, 7], none])
    return found


def _in_pairs(found: Floats) -> Floats | None:
    """Return a, b, h of M1, M2 and MT, (labels, m, 9), if bending rows are pairs; else None.

    found: (labels, m, EDGES + 1, 4) rows of `_spatial_table`. Pairs are ±M1 and ±M2 with the same b.
    """
    edges = found[:, :, :4]
    used = edges[..., 1:3].any(axis=-1)
    across = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    size = edges[:, :, 0, 1]
    fits = used.all() and not found[:, :, 4:EDGES, 1:3].any()
    if not fits or not np.array_equal(edges[..., 1:3], size[:, :, None, None] * across):
        return None
    a, h = edges[:, :, 0, 0], edges[:, :, 0, 3]
    twist = found[:, :, EDGES, :3]
    return np.concatenate([np.stack([a, size, h, a, size, h], axis=-1), twist], axis=-1)


def _along_edges(found: Floats) -> Floats:
    """Return rows of R edges, their corners, and torsion of each face, (labels, m, 6 R + 3).

    R is the smallest compiled number of edges that holds all hulls. found: (labels, m, EDGES + 1, 4) rows of
    `_spatial_table`.
    """
    used = int(found[:, :, :EDGES, 1:3].any(axis=-1).sum(axis=-1).max())
    most = next(size for size in _SIZES if size >= used)
    corners = np.zeros((*found.shape[:2], most, 2))
    for label, face in np.ndindex(found.shape[:2]):
        rows = found[label, face, :EDGES]
        rows = rows[rows[:, 1:3].any(axis=1)]
        onward = np.roll(rows, -1, axis=0)
        # Corners of {p x + q y ≤ a} between each row and the next, in order of angle.
        cross = rows[:, 1] * onward[:, 2] - rows[:, 2] * onward[:, 1]
        ends = np.stack([onward[:, 2] - rows[:, 2], rows[:, 1] - onward[:, 1]], axis=1) * rows[:, :1] / cross[:, None]
        corners[label, face, : len(rows)] = ends
        corners[label, face, len(rows) :] = ends[0]
    count = found.shape[:2]
    parts = [found[:, :, :most].reshape(*count, -1), corners.reshape(*count, -1), found[:, :, EDGES, :3]]
    return np.concatenate(parts, axis=-1)
