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
        pairs, a, b = library.pointers(joins=self._always, first=self._a, second=self._b).values()
        outputs = library.pointers(labels=labels, names=names)
        counts = self._elements, len(self._always), len(self._a)
        library.require_success(
            kernel.jld_find_blocks(
                counts[0], counts[1], pairs, counts[2], a, b, len(labels), outputs["labels"], outputs["names"]
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

    def parts(self, order: Ints, counts: Ints) -> tuple[Names, Bools] | None:
        """Join atoms by the first `counts` (k,) of orders (k, pairs): part of each, and whether none is too small."""
        # A pair is joined unless the part would have more than `most` cells.
        kernel = _library(self._variant)
        if kernel is None:
            return None
        rows, count_array = (np.ascontiguousarray(part, dtype=np.int64) for part in (order, counts))
        names = np.empty((len(rows), len(self._cells)), dtype=np.int32)
        complete = np.empty(len(rows), dtype=np.uint8)
        inputs = library.pointers(first=self._first, second=self._second, cells=self._cells)
        outputs = library.pointers(order=rows, wanted=count_array, names=names, complete=complete)
        sizes = self._least, self._most, self._rounds, len(rows)
        library.require_success(
            kernel.jld_join_parts(len(self._cells), len(self._first), *inputs.values(), *sizes, *outputs.values())
        )
        return names, complete.astype(bool)


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
    return _lay_out_factor(*_ends(first, second), *_elimination(first, second, where, shape))


@lru_cache(maxsize=4)
def _elimination(first: bytes, second: bytes, where: bytes, shape: tuple[int, ...]) -> tuple[Ints, list[list[int]]]:
    """Return the elimination order with the fewest products, and the rows of its columns."""
    a, b = _ends(first, second)
    places = np.frombuffer(where, dtype=float).reshape(shape)
    count = len(places)
    orders = [_minimum_degree(a, b, count)]
    orders += [nested_dissection(a, b, count, leaf, places).order for leaf in _LEAVES if len(a) and count > leaf]
    ranks = [np.argsort(order) for order in orders]
    columns = [columns_of_factor(rank[a], rank[b], count) for rank in ranks]
    # The first order wins ties.
    best = int(np.argmin([_pattern_products(pattern) for pattern in columns]))
    return orders[best], columns[best]


def _pattern_products(columns: list[list[int]]) -> int:
    """Return the number of products: k (k + 1) / 2 for a column with k matrix blocks."""
    return sum(len(column) * (len(column) + 1) // 2 for column in columns)


def _neighbours(a: Ints, b: Ints, count: int) -> list[dict[int, None]]:
    neighbours: list[dict[int, None]] = [{} for _ in range(count)]
    for a_node, b_node in sorted(zip(a.tolist(), b.tolist(), strict=True)):
        neighbours[a_node][b_node] = None
        neighbours[b_node][a_node] = None
    return neighbours


def _minimum_degree(a: Ints, b: Ints, count: int) -> Ints:
    """Return the minimum-degree elimination order of a graph with edges (e,)."""
    neighbours = _neighbours(a, b, count)
    # entries whose degree has changed since are stale
    queue = [(len(clique), node) for node, clique in enumerate(neighbours)]
    heapify(queue)
    eliminated, order = [False] * count, []
    while queue:
        degree, node = heappop(queue)
        if eliminated[node] or degree != len(neighbours[node]):
            continue
        eliminated[node] = True
        order.append(node)
        clique = neighbours[node]
        for neighbour in clique:
            of_neighbour = neighbours[neighbour]
            of_neighbour |= clique
            del of_neighbour[node], of_neighbour[neighbour]
            heappush(queue, (len(of_neighbour), neighbour))
    return np.array(order, dtype=np.int64)


def _lay_out_factor(a: Ints, b: Ints, order: Ints, columns: list[list[int]]) -> FactorPattern:
    """List the blocks of a Cholesky factor and the products that form them."""
    start = np.concatenate([[0], np.cumsum([len(rows) for rows in columns])])
    number = {(row, j): int(start[j]) + k for j, rows in enumerate(columns) for k, row in enumerate(rows)}
    entered = np.zeros(len(number), dtype=np.uint8)  # blocks of the matrix itself; others are fill
    step = np.argsort(order)
    for first, second in zip(step[a].tolist(), step[b].tolist(), strict=True):
        entered[number[max(first, second), min(first, second)]] = 1
    lefts: list[list[tuple[int, int]]] = [[] for _ in columns]  # of each row: block and its column
    products: list[list[tuple[int, int]]] = [[] for _ in range(int(start[-1]))]
    for j, rows in enumerate(columns):
        for k, row in enumerate(rows):
            block = int(start[j]) + k
            lefts[row].append((block, j))
            # L[second, j] L[row, j]ᵀ enters block (second, row)
            for second in rows[k + 1 :]:
                products[number[second, row]].append((number[second, j], block))
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
    """Return the graph of free elements: (its edges (e,), (e,), centroids), and both ends (m,) of all faces."""
    # free elements are numbered from 0; −1 is a support
    elements, faces = assembly.elements, assembly.interfaces
    node = np.full(len(elements), -1, dtype=np.int64)
    node[elements.free] = np.arange(len(elements.free))
    first, second = faces.a.copy(), faces.b.copy()
    members = assembly.members
    in_program = members.face >= 0
    if members.ends is not None:
        first[members.face[in_program]], second[members.face[in_program]] = members.ends[in_program].T
    a, b = node[first], node[second]
    between_free = (a >= 0) & (b >= 0)
    return (a[between_free], b[between_free], elements.centroid[elements.free]), a, b


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


def rows_of_samples(sets: YieldSet, labels: Bits, dimension: int) -> BatchRows | None:
    """Compute the rows of k samples of strengths under labels (k, m); None if unsupported."""
    # `sets` holds the m faces of each sample in turn; first the rows of these k·m faces under both labels
    both = rows_of_sets(sets, labels.size, dimension)
    if both is None:
        return None
    label, face = labels.astype(np.int64).ravel(), np.arange(labels.size)

    def select(array: Floats) -> Floats:
        """Select from (2, k·m, ...) the label of each face: (k, m, ...)."""
        return np.ascontiguousarray(array[label, face].reshape(*labels.shape, *array.shape[2:]))

    parabolas = None if both.parabolas is None else select(both.parabolas)
    return BatchRows(select(both.rows), both.pairs, select(both.keep), parabolas, both.interacts)


@lru_cache(maxsize=2)
def _rows_of_labels(template: Template) -> BatchRows | None:
    """Compute the rows of the labels inner and dry; cached; None if unsupported."""
    return _rows_of(template, None)


def _rows_of(template: Template, undecided: Rows | None) -> BatchRows | None:
    return rows_of_sets(template.yield_set, len(template.assembly.interfaces), template.assembly.dimension, undecided)


def rows_of_sets(sets: YieldSet, faces: int, dimension: int, undecided: Rows | None = None) -> BatchRows | None:
    """Compute the rows of faces in the layout of the batch solver; None if unsupported."""
    all_dry = np.ones(faces, dtype=bool)
    labels = [(sets.pattern, False), (sets.pattern, True)] + ([] if undecided is None else [(undecided.pattern, True)])
    active = [sets.active(~all_dry), sets.active(all_dry)] + ([] if undecided is None else [undecided.active(all_dry)])
    planar = dimension == 2
    rows_of_label = planar_rows if planar else spatial_rows
    tables = [rows_of_label(pattern, dry, faces) for pattern, dry in labels]
    always, together = ([0, 2], [1]) if planar else ([0, 3, 4], [1, 2, 5])
    if any(sheet is None for sheet in tables):
        return None
    # The layout has one flag per face, so shear and torsion must be dropped together.
    if not all(mask[:, always].all() and (mask[:, together] == mask[:, together[:1]]).all() for mask in active):
        return None
    keep = np.ascontiguousarray([mask[:, 1].astype(float) for mask in active])
    rows = np.array(tables)
    if not planar:
        paired = _in_pairs(rows)
        if paired is not None:
            return BatchRows(np.ascontiguousarray(paired), 2, keep)
        rows = _along_edges(rows)
        return BatchRows(np.ascontiguousarray(rows), (rows.shape[-1] - 3) // 6, keep)
    parabolas, interacts = None, False
    if sets.pattern.cones:
        requested = [sets.parabolic_bending(undecided=False)]
        requested += [] if undecided is None else [sets.parabolic_bending(undecided=True)]
        bending = [parabola for parabola in requested if parabola is not None]
        if len(bending) < len(requested):
            return None
        interacts = rows.shape[2] == 3 and any(parabola.interaction is not None for parabola in bending)
        parabolas = np.zeros((len(rows), faces, 14 if interacts else 2))
        for label, parabola in enumerate(bending, start=1):
            crushed = parabola.crushed
            parabolas[label, crushed, :2] = parabola.parabola
            rows[label, crushed] = parabola.rows[:, : rows.shape[2]]
            if interacts and parabola.interaction is not None:
                parabolas[label, crushed, 2:] = parabola.interaction
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
    coefficients = np.zeros((len(sides), 3))
    coefficients[row, resultant] = values[linear]
    uses = np.zeros((len(sides), 3), dtype=bool)
    uses[row, resultant] = True
    if np.any(uses[:, 1] == uses[:, 2]):
        return None
    pairs = np.zeros((faces, 3, 3))
    pairs[:, :, 2] = 1.0
    owners, is_bending = pattern.row_face[: pattern.linear], uses[:, 2]
    bending, sliding = (_by_face(np.flatnonzero(chosen), owners, faces) for chosen in (is_bending, ~is_bending))
    if bending is None or sliding is None or sliding.shape[1] != 2 or bending.shape[1] not in (2, 4):
        return None
    has_pair = np.zeros((faces, 3), dtype=bool)
    for pair, column, both_rows in ((0, 2, bending[:, :2]), (1, 1, sliding), (2, 2, bending[:, 2:])):
        present = np.flatnonzero((both_rows >= 0).any(axis=1)) if both_rows.shape[1] else np.zeros(0, dtype=np.int64)
        plus, minus = both_rows[present].T if len(present) else (present, present)
        if np.any(plus < 0) or np.any(minus < 0) or (pair < 2 and len(present) < faces):
            return None
        above, below = coefficients[plus], coefficients[minus]
        mirrored = (above[:, 0] == below[:, 0]) & (above[:, column] == -below[:, column])
        if not np.all(mirrored & (sides[plus] == sides[minus])):
            return None
        pairs[present, pair] = np.column_stack([-above[:, 0], abs(above[:, column]), sides[plus]])
        has_pair[present, pair] = True
    if np.any(pairs[:, :2, 0] < 0.0) or np.any(pairs[:, 0, 0] == 0.0) or np.any(pairs[:, :2, 1] == 0.0):
        return None
    return pairs if has_pair[:, 2].any() else pairs[:, :2].copy()


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
    result = np.zeros((faces, EDGES + 1, 4))
    result[:, :, 3] = 1.0  # an idle row is 0 ≤ 1
    owners = pattern.row_face
    is_torsion = np.zeros(len(owners), dtype=bool)
    is_torsion[: pattern.linear] = table[: pattern.linear, 5] != 0.0
    is_bending = ~is_torsion
    is_bending[pattern.linear :] = False
    kinds = np.flatnonzero(is_bending), np.flatnonzero(is_torsion), np.arange(pattern.linear, len(owners))
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
    torsion_size, zero = abs(torsion_plus[:, 5]), np.zeros(faces)
    for row, sign in ((torsion_plus, 1.0), (torsion_minus, -1.0)):
        expected = np.column_stack(
            [torsion_plus[:, 0], zero, zero, zero, zero, sign * torsion_plus[:, 5], torsion_size, torsion_plus[:, 7]]
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
    result[face, position] = np.column_stack([-edges[:, 0], edges[:, 3:5], edges[:, 7]])
    result[:, EDGES] = np.column_stack([-torsion_plus[:, 0], torsion_size, torsion_plus[:, 7], zero])
    return result


def _in_pairs(rows: Floats) -> Floats | None:
    """Return a, b, h of ±M1, ±M2 and MT, (labels, m, 9), from rows of `_spatial_table`; None if no pairs."""
    edges = rows[:, :, :4]
    in_use = edges[..., 1:3].any(axis=-1)
    axes = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    size = edges[:, :, 0, 1]
    is_paired = in_use.all() and not rows[:, :, 4:EDGES, 1:3].any()
    if not is_paired or not np.array_equal(edges[..., 1:3], size[:, :, None, None] * axes):
        return None
    a, h = edges[:, :, 0, 0], edges[:, :, 0, 3]
    torsion = rows[:, :, EDGES, :3]
    return np.concatenate([np.stack([a, size, h, a, size, h], axis=-1), torsion], axis=-1)


def _along_edges(rows: Floats) -> Floats:
    """Return rows of R edges, their corners, and torsion of each face, (labels, m, 6 R + 3)."""
    # R is the smallest compiled number of edges that holds all hulls.
    most_edges = int(rows[:, :, :EDGES, 1:3].any(axis=-1).sum(axis=-1).max())
    edge_count = next(size for size in _SIZES if size >= most_edges)
    corners = np.zeros((*rows.shape[:2], edge_count, 2))
    for label, face in np.ndindex(rows.shape[:2]):
        edges = rows[label, face, :EDGES]
        edges = edges[edges[:, 1:3].any(axis=1)]
        following = np.roll(edges, -1, axis=0)
        # Corners of {p x + q y ≤ a} between each row and the next, in order of angle.
        cross = edges[:, 1] * following[:, 2] - edges[:, 2] * following[:, 1]
        intersections = np.stack([following[:, 2] - edges[:, 2], edges[:, 1] - following[:, 1]], axis=1)
        intersections = intersections * edges[:, :1] / cross[:, None]
        corners[label, face, : len(edges)] = intersections
        corners[label, face, len(edges) :] = intersections[0]
    shape = rows.shape[:2]
    blocks = [rows[:, :, :edge_count].reshape(*shape, -1), corners.reshape(*shape, -1), rows[:, :, EDGES, :3]]
    return np.concatenate(blocks, axis=-1)
