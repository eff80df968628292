"""Rows of a template's yield sets in the layout of the batch solver, graphs of blocks, and elimination orders."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache
from heapq import heapify, heappop, heappush
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.batch import library
from jld_core.linalg.factors import columns_of_factor, nested_dissection
from jld_core.mechanics import YieldSet
from jld_core.mechanics.yield_set import RowPattern, Rows
from jld_core.program import Template

Names = NDArray[np.int32]  # array of int32 with the name of the part of each atom


class Graph:
    """Graph of elements and interfaces; always: (t, 2) pairs of one block under every labelling."""

    def __init__(self, elements: int, a: Ints, b: Ints, always: Ints, variant: str | None = None) -> None:
        self._elements = elements
        self._a, self._b, self._always = (np.ascontiguousarray(part, dtype=np.int32) for part in (a, b, always))
        self._variant = variant

    def blocks(self, labellings: Bits) -> Ints | None:
        """Return the block (k, n) of each element, named by its smallest element; None without a batch solver."""
        kernel = _library(self._variant)
        if kernel is None:
            return None
        labels = np.ascontiguousarray(labellings, dtype=np.uint8)
        names = np.empty((len(labels), self._elements), dtype=np.int64)
        joins, first, second = library.pointers(joins=self._always, first=self._a, second=self._b).values()
        places = library.pointers(labels=labels, names=names)
        counts = self._elements, len(self._always), len(self._a)
        library.require_success(
            kernel.jld_find_blocks(
                counts[0], counts[1], joins, counts[2], first, second, len(labels), places["labels"], places["names"]
            )
        )
        return names


class Joining:
    """Graph of atoms (cells that stay together), joined pair by pair into parts of `least` to `most` cells."""

    def __init__(
        self, first: Ints, second: Ints, cells: Ints, least: int, most: float, rounds: int, variant: str | None = None
    ) -> None:
        self._first, self._second = (np.ascontiguousarray(part, dtype=np.int32) for part in (first, second))
        self._cells = np.ascontiguousarray(cells, dtype=np.int64)
        # A limit above the number of all cells, or infinity, has no effect and must fit an integer.
        self._least, self._most = least, int(min(most, self._cells.sum()))
        self._rounds = rounds
        self._variant = variant

    def parts(self, order: Ints, wanted: Ints) -> tuple[Names, Bools] | None:
        """Join atoms by orders (k, pairs), of which the first `wanted` (k,).

        Part of each atom, and whether none is too small.
        """
        # A pair is joined unless the part would have more than `most` cells.
        kernel = _library(self._variant)
        if kernel is None:
            return None
        rows, most = (np.ascontiguousarray(part, dtype=np.int64) for part in (order, wanted))
        names = np.empty((len(rows), len(self._cells)), dtype=np.int32)
        good = np.empty(len(rows), dtype=np.uint8)
        given = library.pointers(first=self._first, second=self._second, cells=self._cells)
        places = library.pointers(order=rows, wanted=most, names=names, complete=good)
        sizes = self._least, self._most, self._rounds, len(rows)
        library.require_success(
            kernel.jld_join_parts(len(self._cells), len(self._first), *given.values(), *sizes, *places.values())
        )
        return names, good.astype(bool)


def _library(variant: str | None) -> Any:
    name = variant or library.chosen()
    return None if name is None else library.library(name)


Int32s = NDArray[np.int32]  # array of int32

# Numbers of nodes at which nested dissection stops; each order is compared with minimum degree
_LEAVES: Final = (4, 12)


@dataclass(frozen=True)
class FactorPattern:
    """Pattern of a block Cholesky factor; matrix blocks are numbered column by column."""

    order: Ints  # (n,) node eliminated at each step
    # column_start, row: (n + 1,) matrix blocks below the diagonal of each column
    column_start: Int32s
    row: Int32s
    entered: NDArray[np.uint8]  # (blocks,) 1 where the matrix itself has an entry, 0 where elimination fills one in
    # pair_start, pair: (blocks + 1,) pairs of earlier matrix blocks whose product is subtracted from each matrix block
    pair_start: Int32s
    pair: Int32s
    # left_start, left, left_column: (n + 1,) matrix blocks of each block row, and their columns
    left_start: Int32s
    left: Int32s
    left_column: Int32s

    def as_ctypes(self) -> library.FactorPattern:
        """Return the pattern as a ctypes structure that points to these arrays."""
        names = ("column_start", "row", "entered", "pair_start", "pair", "left_start", "left", "left_column")
        arrays = {name: getattr(self, name) for name in names}
        return library.FactorPattern(nodes=len(self.order), **library.pointers(**arrays))

    @property
    def products(self) -> int:
        return len(self.pair) + len(self.left)


def factor_pattern(a: Ints, b: Ints, places: Floats) -> FactorPattern:
    """Return the cached pattern of fewest products for pairs a, b (e,) of nodes at places (n, d)."""
    return _pattern(*_key(a, b, places))


def number_of_products(a: Ints, b: Ints, places: Floats) -> int:
    """Return `FactorPattern.products` without laying the pattern out."""
    return _pattern_products(_elimination(*_key(a, b, places))[1])


def _key(a: Ints, b: Ints, places: Floats) -> tuple[bytes, bytes, bytes, tuple[int, ...]]:
    """Return the key of the caches: bytes of edges and coordinates, and the shape of these."""
    a, b, places = np.asarray(a, dtype=np.int64), np.asarray(b, dtype=np.int64), np.asarray(places, dtype=float)
    proper = a != b
    return a[proper].tobytes(), b[proper].tobytes(), places.tobytes(), places.shape


def _ends(first: bytes, second: bytes) -> tuple[Ints, Ints]:
    return np.frombuffer(first, dtype=np.int64), np.frombuffer(second, dtype=np.int64)


@lru_cache(maxsize=4)
def _pattern(first: bytes, second: bytes, where: bytes, shape: tuple[int, ...]) -> FactorPattern:
    return _laid_out(*_ends(first, second), *_elimination(first, second, where, shape))


@lru_cache(maxsize=4)
def _elimination(first: bytes, second: bytes, where: bytes, shape: tuple[int, ...]) -> tuple[Ints, list[list[int]]]:
    """Return the elimination order with the fewest products, and the rows of its columns."""
    a, b = _ends(first, second)
    places = np.frombuffer(where, dtype=float).reshape(shape)
    count = len(places)
    orders = [_minimum_degree(a, b, count)]
    orders += [nested_dissection(a, b, count, leaf, places).order for leaf in _LEAVES if len(a) and count > leaf]
    places_in_order = [np.argsort(order) for order in orders]
    columns = [columns_of_factor(place[a], place[b], count) for place in places_in_order]
    # The first order wins ties.
    best = int(np.argmin([_pattern_products(pattern) for pattern in columns]))
    return orders[best], columns[best]


def _pattern_products(columns: list[list[int]]) -> int:
    """Return the number of products: k (k + 1) / 2 for a column with k matrix blocks."""
    return sum(len(column) * (len(column) + 1) // 2 for column in columns)


def _neighbours(a: Ints, b: Ints, count: int) -> list[dict[int, None]]:
    found: list[dict[int, None]] = [{} for _ in range(count)]
    for one, other in sorted(zip(a.tolist(), b.tolist(), strict=True)):
        found[one][other] = None
        found[other][one] = None
    return found


def _minimum_degree(a: Ints, b: Ints, count: int) -> Ints:
    """Return the minimum-degree elimination order of a graph with edges (e,)."""
    near = _neighbours(a, b, count)
    # entries whose degree has changed since are stale
    waiting = [(len(around), node) for node, around in enumerate(near)]
    heapify(waiting)
    done, order = [False] * count, []
    while waiting:
        degree, node = heappop(waiting)
        if done[node] or degree != len(near[node]):
            continue
        done[node] = True
        order.append(node)
        around = near[node]
        for one in around:
            mine = near[one]
            mine |= around
            del mine[node], mine[one]
            heappush(waiting, (len(mine), one))
    return np.array(order, dtype=np.int64)


def _laid_out(a: Ints, b: Ints, order: Ints, columns: list[list[int]]) -> FactorPattern:
    """List the blocks of a Cholesky factor and the products that form them."""
    start = np.concatenate([[0], np.cumsum([len(rows) for rows in columns])])
    number = {(row, j): int(start[j]) + k for j, rows in enumerate(columns) for k, row in enumerate(rows)}
    entered = np.zeros(len(number), dtype=np.uint8)  # blocks of the matrix itself; others are fill
    step = np.argsort(order)
    for one, other in zip(step[a].tolist(), step[b].tolist(), strict=True):
        entered[number[max(one, other), min(one, other)]] = 1
    lefts: list[list[tuple[int, int]]] = [[] for _ in columns]  # of each row: block and its column
    products: list[list[tuple[int, int]]] = [[] for _ in range(int(start[-1]))]
    for j, rows in enumerate(columns):
        for k, row in enumerate(rows):
            block = int(start[j]) + k
            lefts[row].append((block, j))
            # L[other, j] L[row, j]ᵀ enters block (other, row)
            for other in rows[k + 1 :]:
                products[number[other, row]].append((number[other, j], block))
    return FactorPattern(
        order=order,
        column_start=start.astype(np.int32),
        row=_flat(columns),
        entered=entered,
        pair_start=_starts(products),
        pair=_flat([list(itertools.chain(*pairs)) for pairs in products]).reshape(-1, 2),
        left_start=_starts(lefts),
        left=_flat([[block for block, _ in row] for row in lefts]),
        left_column=_flat([[column for _, column in row] for row in lefts]),
    )


def _starts(lists: list[list[tuple[int, int]]]) -> Int32s:
    """Return where each list starts in the concatenation of all, then its total length."""
    return np.concatenate([[0], np.cumsum([len(items) for items in lists])]).astype(np.int32)


def _flat(lists: list[list[int]]) -> Int32s:
    return np.array([value for items in lists for value in items], dtype=np.int32)


# Number of faces above which the batch solver is not used: it takes a tenth of the time of others at 3 160, a third at
# 4 950, nearly half at 8 128, and sets up for as long as three layouts of theirs, from there on more.
LARGEST: Final = 6000
EDGES: Final = 16  # largest number of hull edges of a spatial face
_SIZES: Final = (4, 8, EDGES)  # numbers of hull edges for which the batch solver is compiled

# Rows of the shear cone of a spatial face, columns N, V1, V2, M1, M2, MT and the bound t on shear
_CONE: Final = np.array([[0.0] * 6 + [-1.0], [0.0, -1.0] + [0.0] * 5, [0.0, 0.0, -1.0] + [0.0] * 4])

# Number of scalar products of one factorisation above which the batch solver is not used.
# 6³ cubes take 8 million, 10³ cubes 290 million, a wall of 30 × 30 cells 2.5 million. A wall of 420 bricks, 18 million,
# takes more than 100 s for 12 layouts with set-up, though 7³ cubes, 22 million, take a sixth of the time of others.
MOST: Final = 15_000_000
_SMALL: Final = 300  # number of faces up to which every structure stays below `MOST`, so that none is counted


def fits(template: Template, undecided: Rows | None = None) -> bool:
    """Return True if the batch solver supports a template's rows, size and members, none on more than two elements."""
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
    """Return the factor pattern of equilibrium, and the free elements (m,), (m,) of each face, −1 for a support."""
    graph, a, b = _graph(assembly)
    return factor_pattern(*graph), a, b


def _graph(assembly: Assembly) -> tuple[tuple[Ints, Ints, Floats], Ints, Ints]:
    """Return what `factor_pattern` takes of an assembly, and the free elements (m,) of each face."""
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
    """Scaled coefficients of all faces' rows under the labels inner, dry and, if given, undecided."""

    # (labels, m, numbers) planar: a, b, h of −a N ± b X ≤ h for each pair, where X is M, V, and M again where inner
    # faces crush. In space, where all faces bend in two pairs: a, b, h of M1, of M2, and of −a N ± b MT + b t ≤ h, with
    # t the bound on shear. In space otherwise: a, p, q, h of −a N + p M1 + q M2 ≤ h for each hull edge; the corners (p,
    # q) between edges; and a, b, h of MT.
    rows: Floats
    # number of pairs of rows; in space 2 (pairs in bending), or the number of edges for which there is space
    pairs: int
    keep: Floats  # (labels, m) 1 where V takes part in equilibrium, else 0
    # (labels, m, 2 or 14) c and n₀ of a first pair b |M| ≤ h + a N − c N² from N = n₀ on, and its tangent at n₀ below.
    # None where no face has one. With `interacts`, the numbers of `ParabolicBending.interaction` follow n₀, 0 for
    # decided labels.
    parabolas: Floats | None = None
    interacts: bool = False  # True where undecided faces crush and their V and M interact


def rows_of(template: Template, undecided: Rows | None = None) -> BatchRows | None:
    # Cached, because both `fits` and the constructor of the batch solver ask for the same template.
    return _rows_of_labels(template) if undecided is None else _rows_of(template, undecided)


def rows_of_samples(own: YieldSet, labels: Bits, dimension: int) -> BatchRows | None:
    """Compute the rows of many samples of strengths under labels (k, m); None if unsupported."""
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
def _rows_of_labels(template: Template) -> BatchRows | None:
    """Compute the rows of the labels inner and dry; cached; None if unsupported."""
    return _rows_of(template, None)


def _rows_of(template: Template, undecided: Rows | None) -> BatchRows | None:
    return rows_of_sets(template.yield_set, len(template.assembly.interfaces), template.assembly.dimension, undecided)


def rows_of_sets(own: YieldSet, faces: int, dimension: int, undecided: Rows | None = None) -> BatchRows | None:
    """Compute the rows of faces in the layout of the batch solver; None if unsupported."""
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
    """Return a, b, h of −a N ± b X ≤ h (m, pairs, 3); X: M, V and, if inner faces crush, M. Cones are ignored."""
    if pattern.extra:
        return None
    return _pairs(pattern, *((pattern.dry, pattern.h_dry) if dry else (pattern.inner, pattern.h_inner)), faces)


def _pairs(pattern: RowPattern, values: Floats, sides: Floats, faces: int) -> Floats | None:
    """Return a, b, h of one label's rows −a N ± b X ≤ h, (m, 2 or 3, 3); None where they are no such pairs."""
    # X is M, V and, where inner faces crush, M again.
    linear = pattern.row < pattern.linear
    row, resultant = pattern.row[linear], pattern.column[linear] % 3
    sides = sides[: pattern.linear]
    table = np.zeros((len(sides), 3))
    table[row, resultant] = values[linear]
    uses = np.zeros((len(sides), 3), dtype=bool)
    uses[row, resultant] = True
    if np.any(uses[:, 1] == uses[:, 2]):
        return None
    pairs = np.zeros((faces, 3, 3))
    pairs[:, :, 2] = 1.0
    owners, bends = pattern.row_face[: pattern.linear], uses[:, 2]
    bending, sliding = _by_face(np.flatnonzero(bends), owners, faces), _by_face(np.flatnonzero(~bends), owners, faces)
    if bending is None or sliding is None or sliding.shape[1] != 2 or bending.shape[1] not in (2, 4):
        return None
    filled = np.zeros((faces, 3), dtype=bool)
    for pair, column, both_rows in ((0, 2, bending[:, :2]), (1, 1, sliding), (2, 2, bending[:, 2:])):
        present = np.flatnonzero((both_rows >= 0).any(axis=1)) if both_rows.shape[1] else np.zeros(0, dtype=np.int64)
        plus, minus = both_rows[present].T if len(present) else (present, present)
        if np.any(plus < 0) or np.any(minus < 0) or (pair < 2 and len(present) < faces):
            return None
        alike = (table[plus, 0] == table[minus, 0]) & (table[plus, column] == -table[minus, column])
        if not np.all(alike & (sides[plus] == sides[minus])):
            return None
        pairs[present, pair] = np.column_stack([-table[plus, 0], abs(table[plus, column]), sides[plus]])
        filled[present, pair] = True
    if np.any(pairs[:, :2, 0] < 0.0) or np.any(pairs[:, 0, 0] == 0.0) or np.any(pairs[:, :2, 1] == 0.0):
        return None
    return pairs if filled[:, 2].any() else pairs[:, :2].copy()


def _by_face(rows: Ints, owner: Ints, faces: int) -> Ints | None:
    """Return the rows (m, most) of each face in order, padded by −1; None if a face has none."""
    rows = rows[np.argsort(owner[rows], kind="stable")]
    counts = np.bincount(owner[rows], minlength=faces)
    if not counts.all():
        return None
    table = np.full((faces, int(counts.max())), -1, dtype=np.int64)
    first = np.cumsum(counts) - counts
    table[owner[rows], np.arange(len(rows)) - np.repeat(first, counts)] = rows
    return table


def spatial_rows(pattern: RowPattern, dry: bool, faces: int) -> Floats | None:
    # Rows 0 to EDGES − 1 of a face hold a, p, q, h of −a N + p M1 + q M2 ≤ h, one per hull edge; those left over have p
    # = q = 0. The last row holds a, b, h, 0 of −a N ± b MT + b t ≤ h, where t is the bound on shear.
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
    """Return spatial rows as the compiled solver stores them; None for others."""
    # Bending rows come first: a, p, q, h of −a N + p M1 + q M2 ≤ h, idle rows last. The last row holds a, b, h, 0 of
    # torsion.
    laid_out = np.zeros((faces, EDGES + 1, 4))
    laid_out[:, :, 3] = 1.0  # an idle row is 0 ≤ 1
    owners = pattern.row_face
    twists = np.zeros(len(owners), dtype=bool)
    twists[: pattern.linear] = table[: pattern.linear, 5] != 0.0
    bends = ~twists
    bends[pattern.linear :] = False
    kinds = np.flatnonzero(bends), np.flatnonzero(twists), np.arange(pattern.linear, len(owners))
    bending, torsion, shear = (_by_face(rows, owners, faces) for rows in kinds)
    if bending is None or torsion is None or shear is None or torsion.shape[1] != 2 or shear.shape[1] != 3:
        return None
    if torsion.min() < 0 or bending[:, :3].min() < 0 or not 3 <= bending.shape[1] <= EDGES:
        return None
    # Where a face resists no shear, V is dropped and its cone has right-hand side one.
    cone = table[shear]
    if np.any(cone[:, :, :7] != _CONE) or cone[:, 1:, 7].any() or not np.isin(cone[:, 0, 7], (0.0, 1.0)).all():
        return None
    torsion_plus, torsion_minus = table[torsion].transpose(1, 0, 2)
    size, zero = abs(torsion_plus[:, 5]), np.zeros(faces)
    for row, sign in ((torsion_plus, 1.0), (torsion_minus, -1.0)):
        expected = np.column_stack(
            [torsion_plus[:, 0], zero, zero, zero, zero, sign * torsion_plus[:, 5], size, torsion_plus[:, 7]]
        )
        if not np.array_equal(row, expected):
            return None
    face, position = np.nonzero(bending >= 0)
    edges = table[bending[face, position]]
    first = table[bending[face, 0]]
    # The compiled solver relies on equal a and equal h of all edges of a face.
    if np.any(torsion_plus[:, 0] > 0.0) or np.any(edges[:, [1, 2, 6]]) or np.any(edges[:, 0] >= 0.0):
        return None
    if np.any(edges[:, [0, 7]] != first[:, [0, 7]]):
        return None
    laid_out[face, position] = np.column_stack([-edges[:, 0], edges[:, 3:5], edges[:, 7]])
    laid_out[:, EDGES] = np.column_stack([-torsion_plus[:, 0], size, torsion_plus[:, 7], zero])
    return laid_out


def _in_pairs(found: Floats) -> Floats | None:
    """Return a, b, h of ±M1, ±M2 and MT, (labels, m, 9), from rows of `_spatial_table`; None if no pairs."""
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
    """Return rows of R edges, their corners, and torsion of each face, (labels, m, 6 R + 3)."""
    # R is the smallest compiled number of edges that holds all hulls.
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
