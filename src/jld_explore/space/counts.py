"""Define counts of labellings for tables, fronts, pictures and proofs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from threading import RLock
from typing import Any, Final, cast

import numpy as np

from jld_core import plugins
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed, checkpoint
from jld_core.errors import InputError
from jld_core.geometry.outlines import Kinds, Outline, Outlines, boundary, reach_of
from jld_core.parameters import near, typed
from jld_explore.space.labelling import Connectivity, blocks_of, connectivity, numbers_of, totals_of

# Step to which coordinates are rounded, relative to the reach of a comparison: blocks that agree there are copies
_COPY: Final = 1e-3
_SEEDS: Final = 400  # largest number of blocks that are numbered before those of any layout

# Offset before coordinates are rounded; it avoids multiples of one half, where rounding is ambiguous
_SHIFT: Final = 0.37


class BlockShapes:
    """Outlines of the blocks of one assembly, computed on request and cached; thread-safe."""

    def __init__(self, assembly: Assembly, *, rotate: bool = False, flip: bool = False) -> None:
        self.assembly = assembly
        self._kinds = Kinds(reach_of(assembly), rotate=rotate, flip=flip)
        rng = np.random.default_rng(20240711)
        self._sign = rng.integers(1, 2**63, size=len(assembly.elements), dtype=np.uint64)
        self._sign[assembly.elements.support] = 0
        self._index_of: dict[int, int] = {}
        self._shapes: list[Outline] = []
        self._shape_numbers: list[int] = []
        self._outline_of_cells: dict[bytes, Outline] = {}
        self._outlines = Outlines(assembly)
        self._number_of_outline: dict[int, int] = {}
        self._seeded = False
        self._step = _COPY * self._kinds.reach
        # Threads of a proof request blocks at the same time.
        self._lock = RLock()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = RLock()

    def look(self, blocks: Ints) -> tuple[Bools, Ints]:
        """Compute missing outlines of blocks (k, n): mask of columns with a block, and positions, else −1."""
        with self._lock:
            return self._look(blocks)

    def _look(self, blocks: Ints) -> tuple[Bools, Ints]:
        """Find the outlines as `look` does; the caller holds the lock."""
        rows, count = blocks.shape
        names = (blocks + count * np.arange(rows)[:, None]).ravel()
        key = np.zeros(rows * count, dtype=np.uint64)
        np.add.at(key, names, np.tile(self._sign, rows))
        holds = key != 0
        unique, first, inverse = np.unique(key[holds], return_index=True, return_inverse=True)
        where = np.flatnonzero(holds)[first]
        values = unique.tolist()
        new = [k for k, value in enumerate(values) if value not in self._index_of]
        if new:
            free = np.flatnonzero(np.tile(~self.assembly.elements.support, rows))
            free = free[np.argsort(names[free], kind="stable")]  # by block, ascending within each
            starts, ends = (np.searchsorted(names[free], where[new], side=side) for side in ("left", "right"))
            members = [free[start:end] % count for start, end in zip(starts.tolist(), ends.tolist(), strict=True)]
            for k, outline in zip(new, self._outlines_of(members), strict=True):
                self._shapes.append(outline)
                self._index_of[values[k]] = len(self._shapes) - 1
        outline_indices = np.array([self._index_of[value] for value in values], dtype=np.int64)
        indices = np.full(rows * count, -1, dtype=np.int64)
        indices[holds] = outline_indices[inverse.reshape(-1)]
        return holds.reshape(rows, count), indices.reshape(rows, count)

    def one(self, members: Ints) -> Outline:
        """Return the outline of one block given by its free elements in ascending order."""
        return self._shapes[self._outline_position(members)]

    def _outline_position(self, members: Ints) -> int:
        """Return the position of the outline of one block, computed if it is not yet known."""
        key = int(self._sign[members].sum(dtype=np.uint64))
        with self._lock:
            if key not in self._index_of:
                self._shapes += self._outlines_of([members])
                self._index_of[key] = len(self._shapes) - 1
            return self._index_of[key]

    def kinds(self, blocks: Sequence[Sequence[int]]) -> Ints:
        """Return the shape number (b,) of blocks, ascending free elements each; equal if congruent."""
        indices = []
        for members in blocks:
            checkpoint()
            indices.append(self._outline_position(np.array(members, dtype=np.int64)))
        with self._lock:
            return np.asarray(self._numbers()[indices])

    def counted(self, blocks: Ints, sink: int = -1) -> tuple[Bools, Ints]:
        """Return (k, n) which blocks (k, n) count, and their positions among known outlines."""
        # The block that contains the element `sink` is not counted if `sink` is at least 0.
        holds, indices = self.look(blocks)
        if sink >= 0:
            holds[np.arange(len(blocks)), blocks[:, sink]] = False
        return holds, indices

    def different(self, holds: Bools, indices: Ints) -> Ints:
        """Return (k,) number of different block shapes of each row of `counted` blocks (k, n)."""
        with self._lock:
            number = self._numbers()
        _, new = _first_of_kinds(holds, number[indices])
        return np.asarray(new.sum(axis=1), dtype=np.int64)

    def total(self, holds: Bools, indices: Ints, name: str, *, once: bool = False) -> Ints:
        """Return (k,) sums of a whole-number attribute of outlines over `counted` blocks (k, n)."""
        with self._lock:
            number = self._numbers()
        value = np.array([getattr(shape, name) for shape in self._shapes[: len(number)]], dtype=np.int64)
        if not once:
            return np.asarray(np.where(holds, value[indices], 0).sum(axis=1), dtype=np.int64)
        of_kind = np.zeros(int(number.max(initial=-1)) + 1, dtype=np.int64)
        of_kind[number[::-1]] = value[::-1]
        kind, new = _first_of_kinds(holds, number[indices])
        return np.asarray(np.where(new, of_kind[kind], 0).sum(axis=1), dtype=np.int64)

    def values(self, name: str) -> Floats:
        """Return (b,) values of one attribute of all known outlines, ordered by position."""
        with self._lock:
            shapes = self._shapes[:]
        return np.array([float(getattr(shape, name)) for shape in shapes])

    def _numbers(self) -> Ints:
        """Return (b,) shape number of each known block; congruent blocks have the same number."""
        if not self._seeded:
            self._seed()
            self._seeded = True
        for outline in self._shapes[len(self._shape_numbers) :]:
            # Blocks of equal cells in equal positions share one outline object.
            if id(outline) not in self._number_of_outline:
                self._number_of_outline[id(outline)] = self._kinds.number(outline)
            self._shape_numbers.append(self._number_of_outline[id(outline)])
        return np.array(self._kinds.roots(self._shape_numbers), dtype=np.int64)

    def _seed(self) -> None:
        """Give numbers to the smallest blocks first, so that connected shapes depend on no layout seen."""
        # The smallest blocks are single elements and, where some are alike without being copies, connected ones of
        # growing number.
        free = [k for k in self.assembly.elements.free.tolist() if k != self.assembly.sink]
        if len(free) > _SEEDS:
            return
        neighbours: dict[int, set[int]] = {k: set() for k in free}
        faces = self.assembly.interfaces
        for a, b in zip(faces.a.tolist(), faces.b.tolist(), strict=True):
            if a in neighbours and b in neighbours:
                neighbours[a].add(b)
                neighbours[b].add(a)
        level, count = {(k,) for k in free}, 0
        while level and count + len(level) <= _SEEDS:
            count += len(level)
            for outline in self._outlines_of([np.array(members, dtype=np.int64) for members in sorted(level)]):
                self._kinds.number(outline)
            if self._kinds.exact:
                return
            level = {
                tuple(sorted({*members, other}))
                for members in level
                for k in members
                for other in neighbours[k] - set(members)
            }

    def _outlines_of(self, blocks: Sequence[Ints]) -> Iterator[Outline]:
        """Yield the outline of each block, ascending free elements, cached for equal elements in equal positions."""
        if not blocks:
            return
        members, sizes = np.concatenate(blocks), np.array([len(block) for block in blocks])
        ends = np.cumsum(sizes)
        centroid = self.assembly.elements.centroid[members]
        offset = centroid - np.repeat(centroid[ends - sizes], sizes, axis=0)
        steps = np.floor(offset / self._step + _SHIFT).astype(np.int64)
        like, start = self._like[members], 0
        for block, end in zip(blocks, ends.tolist(), strict=True):
            checkpoint()
            key = like[start:end].tobytes() + steps[start:end].tobytes()
            if key not in self._outline_of_cells:
                self._outline_of_cells[key] = self._outlines.of(block)
            start = end
            yield self._outline_of_cells[key]

    @cached_property
    def _like(self) -> Ints:
        """(n,) number of each element, equal where corners and faces agree about the centroid."""
        elements = self.assembly.elements
        names: dict[object, int] = {}
        numbers = []
        for k, shape in enumerate(elements.shape):
            corners = np.floor((shape - elements.centroid[k]) / self._step + _SHIFT).astype(np.int64)
            name = (corners.shape, corners.tobytes(), elements.faces[k] if elements.faces else ())
            numbers.append(names.setdefault(name, len(names)))
        return np.array(numbers, dtype=np.int64)


def _first_of_kinds(holds: Bools, kinds: Ints) -> tuple[Ints, Bools]:
    """Return kinds (k, n) in ascending order, −1 for what does not count, and True for the first of each kind."""
    kind = np.where(holds, kinds, -1)
    kind.sort(axis=1)
    return kind, (np.diff(kind, axis=1, prepend=-1) != 0) & (kind >= 0)


@dataclass(frozen=True)
class Layouts:
    """Labellings of an assembly with cached properties for counts.

    Attributes
    ----------
    assembly : Assembly
        The structure.
    labellings : (k, m) bool array
        Labels, True = dry.
    graph : Connectivity
        Element graph of the assembly.
    block_shapes : BlockShapes
        Outlines of its blocks.
    """

    assembly: Assembly
    labellings: Bits
    graph: Connectivity
    block_shapes: BlockShapes

    @cached_property
    def blocks(self) -> Ints:
        """(k, n) block of each element, named by its smallest element."""
        return blocks_of(self.graph, self.labellings)

    @cached_property
    def cells(self) -> Ints:
        """(n, k) number of free elements per block, at the row of its smallest element, else 0."""
        cells = numbers_of(self.blocks, self.assembly.elements.free).T
        if self.assembly.sink >= 0:
            # Omitted cells do not form a block.
            cells[self.blocks[:, self.assembly.sink], np.arange(len(self.labellings))] = 0
        return cells

    @cached_property
    def outlines(self) -> tuple[Bools, Ints]:
        """(k, n) which blocks count, and their positions among known outlines."""
        return self.block_shapes.counted(self.blocks, self.assembly.sink)

    @cached_property
    def stays(self) -> Bools:
        """(k, n) mask of the elements that are not left out."""
        if self.assembly.sink < 0:
            return np.ones((len(self.labellings), len(self.assembly.elements)), dtype=bool)
        return np.asarray(self.blocks != self.blocks[:, [self.assembly.sink]])

    @cached_property
    def dry(self) -> Bits:
        """(k, f) dry labels of the faces between free elements; False beside omitted cells."""
        free = self.assembly.free_faces
        dry = self.labellings[:, free]
        if self.assembly.sink < 0:
            return dry
        a, b = self.assembly.interfaces.a[free], self.assembly.interfaces.b[free]
        return np.asarray(dry & self.stays[:, a] & self.stays[:, b])


@dataclass(frozen=True)
class Terms:
    """Count as a sum of binary terms, as required for proofs with formulas.

    Attributes
    ----------
    faces : (m,) bool array or None
        Faces that each add one when dry.
    blocks : bool
        True if every block with a free element adds one.
    """

    faces: Bools | None = None
    blocks: bool = False

    def most(self, assembly: Assembly) -> int:
        """Return an upper bound on the count over all labellings of an assembly."""
        faces = 0 if self.faces is None else int(self.faces.sum())
        return faces + (len(assembly.elements.free) if self.blocks else 0)


def _nothing(_: Assembly) -> str:
    return ""


@dataclass(frozen=True)
class Count:
    """Definition of one count of labellings.

    Attributes
    ----------
    name, column : str
        Name in scenes and tables; title of the column, by default the name with spaces.
    of : callable
        Maps `Layouts` to values (k,), equal for images under the scene's symmetries.
    axis : callable or str
        Words for an axis without unit, or a function of the assembly.
    noun : str
        Name of one counted item, or the word before a value that is not an integer.
    integer : bool
        Whether the count is whole.
    unit : callable
        Maps an assembly to the unit.
    terms : callable or None
        Maps an assembly to `Terms`, which a proof needs.
    kinds : bool
        True for the number of different shapes of blocks.
    outlines : bool
        True if outlines of blocks are needed; tables leave it blank where time ends.
    monotone : bool
        True if a further dry face never lowers the count.
    least_of_block, least_of_shape : mapping of int to int, or None
        By dimension, what each block or shape adds at least.
    """

    name: str
    of: Callable[[Layouts], Ints | Floats]
    axis: Callable[[Assembly], str] | str
    noun: str
    integer: bool = True
    unit: Callable[[Assembly], str] = _nothing
    column: str = ""
    terms: Callable[[Assembly], Terms] | None = None
    kinds: bool = False
    outlines: bool = False
    monotone: bool = False
    least_of_block: Mapping[int, int] | None = None
    least_of_shape: Mapping[int, int] | None = None

    @property
    def title(self) -> str:
        return self.column or self.name.replace("_", " ")

    def heading(self, assembly: Assembly) -> str:
        """Return the title for an assembly, for example a length in the plane or an area in space."""
        return self.title if isinstance(self.axis, str) else self.axis(assembly)

    def label(self, assembly: Assembly) -> str:
        axis, unit = self.axis if isinstance(self.axis, str) else self.axis(assembly), self.unit(assembly)
        return f"{axis} [{unit}]" if unit else axis

    def words(self, value: float, assembly: Assembly) -> str:
        """Return a value with its noun and unit as text."""
        if not self.integer:
            return f"{self.noun} {value:.3g} {self.unit(assembly)}".rstrip()
        return f"{value:g} {self.noun}" + ("" if value == 1.0 else "s")


def _planar(assembly: Assembly) -> bool:
    return assembly.dimension == 2


def _dry_length(layouts: Layouts) -> Floats:
    """Return (k,) total length, in space area, of the dry faces between free elements."""
    free = layouts.assembly.free_faces
    # Sum row by row in a fixed order, so that the result does not depend on the batch.
    return np.asarray(np.where(layouts.dry, layouts.assembly.face_sizes[free], 0.0).sum(axis=1))


def _largest_mass(layouts: Layouts) -> Floats:
    elements = layouts.assembly.elements
    stays = layouts.stays[:, elements.free] * elements.mass[elements.free]
    return np.asarray(totals_of(layouts.blocks, elements.free, stays).max(axis=1, initial=0.0))


def _mass(layouts: Layouts) -> Floats:
    elements = layouts.assembly.elements
    mass = elements.mass[elements.free]
    total = float(mass.sum()) or 1.0
    # Round, so that equal masses compare equal for any order of summation.
    return np.asarray(np.round((layouts.stays[:, elements.free] * mass).sum(axis=1) / total, 12) * total)


def _sawn_length(layouts: Layouts) -> Floats:
    """Return (k,) total length, in space area, of the faces of all blocks."""
    # Faces at supports are included. It is the boundary of all elements without the inner faces, each of which two
    # elements share, or one and a support.
    assembly, faces = layouts.assembly, layouts.assembly.interfaces
    elements, stays = assembly.elements, layouts.stays
    boundaries = np.array(
        [boundary(elements.shape[e], elements.faces[e] if elements.faces else None) for e in elements.free]
    )
    ends = [np.where(elements.support[side], False, stays[:, side]) for side in (faces.a, faces.b)]
    real = ~assembly.of_members & ((faces.b != assembly.sink) if assembly.sink >= 0 else True)
    inner = ~layouts.labellings & real & stays[:, faces.a] & stays[:, faces.b]
    within = np.where(inner, assembly.face_sizes, 0.0) * (ends[0].astype(int) + ends[1].astype(int))
    boundary_length = np.where(stays[:, elements.free], boundaries, 0.0).sum(axis=1)
    scale = float(boundaries.sum()) or 1.0
    # Round, so that equal lengths compare equal for any order of summation.
    return np.asarray(np.round((boundary_length - within.sum(axis=1)) / scale, 12) * scale)


_COUNTS: Final[dict[str, Count]] = {
    count.name: count
    for count in (
        Count(
            "dry_faces",
            of=lambda layouts: layouts.dry.sum(axis=1, dtype=np.int64),
            axis="dry faces between free elements",
            noun="dry face",
            terms=lambda assembly: Terms(faces=assembly.free_faces),
        ),
        Count(
            "dry_length",
            of=_dry_length,
            axis=lambda assembly: "dry length" if _planar(assembly) else "dry area",
            noun="dry",
            integer=False,
            monotone=True,
            unit=lambda assembly: assembly.units[0] + ("" if _planar(assembly) else "²"),
        ),
        Count(
            "blocks",
            of=lambda layouts: (layouts.cells > 0).sum(axis=0, dtype=np.int64),
            axis="blocks",
            noun="block",
            terms=lambda assembly: Terms(blocks=True),
        ),
        Count(
            "largest_block_cells",
            of=lambda layouts: layouts.cells.max(axis=0, initial=0),
            axis="free elements in the largest block",
            noun="cell",
            column="elements in the largest block",
        ),
        Count(
            "shapes",
            of=lambda layouts: layouts.block_shapes.different(*layouts.outlines),
            axis="different shapes of blocks",
            noun="shape",
            kinds=True,
            outlines=True,
        ),
        Count(
            "sawn_length",
            of=_sawn_length,
            axis=lambda assembly: "sawn length" if _planar(assembly) else "sawn area",
            noun="sawn",
            integer=False,
            monotone=True,
            unit=lambda assembly: assembly.units[0] + ("" if _planar(assembly) else "²"),
        ),
        Count(
            "saw_cuts",
            of=lambda layouts: layouts.block_shapes.total(*layouts.outlines, "faces"),
            axis="sawn faces of all blocks",
            noun="cut",
            outlines=True,
            # a triangle, a tetrahedron
            least_of_block={2: 3, 3: 4},
        ),
        Count(
            "saw_set_ups",
            of=lambda layouts: layouts.block_shapes.total(*layouts.outlines, "lines", once=True),
            axis="set-ups of the saw",
            noun="set-up",
            outlines=True,
            # a parallelogram, a parallelepiped
            least_of_shape={2: 2, 3: 3},
        ),
        Count(
            "largest_block_mass",
            of=_largest_mass,
            axis="mass of the heaviest block",
            noun="heaviest",
            integer=False,
            unit=lambda assembly: "kg" if assembly.units == ("m", "N") else "",
        ),
        Count(
            "mass",
            of=_mass,
            axis="mass of all blocks",
            noun="mass",
            integer=False,
            unit=lambda assembly: "kg" if assembly.units == ("m", "N") else "",
        ),
    )
}


_BUILT_IN: Final = tuple(_COUNTS)  # names of the counts of jld


@cache
def _add_plugins() -> None:
    """Register the counts of installed plug-ins, once; InputError for one that is no count."""
    for name, count in plugins.load_all("jld.counts", _BUILT_IN).items():
        if not isinstance(count, Count) or count.name != name or not name.isidentifier():
            raise plugins.refuse_type("jld.counts", name, f"a jld_explore.space.Count with name={name!r}")
        _COUNTS.setdefault(name, _checked(count))


def _checked(count: Count) -> Count:
    """Return the count of a plug-in whose values are checked, and weighed against its terms."""

    def terms(assembly: Assembly) -> Terms:
        with plugins.guarded("jld.counts", count.name):
            stated_terms = cast(Callable[[Assembly], Terms], count.terms)(assembly)
        faces = getattr(stated_terms, "faces", 0)
        every = np.asarray(faces)
        if faces is not None and (every.dtype.kind != "b" or every.shape != (len(assembly.interfaces),)):
            remedy = "terms that are Terms, with a truth value for each interface"
            raise plugins.refuse_type("jld.counts", count.name, remedy)
        return stated_terms

    def of(layouts: Layouts) -> Ints | Floats:
        """Return the counts of layouts; refuse wrong shapes, and sums unlike the terms."""
        with plugins.guarded("jld.counts", count.name):
            counts: Any = np.asarray(count.of(layouts))
        size = (len(layouts.labellings),)
        if counts.shape != size or counts.dtype.kind not in "biuf" or not np.isfinite(counts).all():
            remedy = f"a finite number for each of {size[0]} layouts"
            raise plugins.refuse_type("jld.counts", count.name, remedy)
        if count.terms is not None and layouts.assembly.sink < 0:
            sums, terms_of_count = np.zeros(size), terms(layouts.assembly)
            sums += 0 if terms_of_count.faces is None else layouts.labellings[:, terms_of_count.faces].sum(axis=1)
            sums += (layouts.cells > 0).sum(axis=0) if terms_of_count.blocks else 0
            wrong = sums != counts
            if wrong.any():
                problem = f"it is {counts[wrong][0]:g} where its terms add up to {sums[wrong][0]:g}"
                raise plugins.refuse_type("jld.counts", count.name, "the sum of its terms, or none stated", problem)
        values: Ints | Floats = counts.astype(int) if counts.dtype == bool else counts
        return values

    return replace(count, of=of, terms=count.terms and terms)


_TRIED: Final = 64  # labellings whose images are counted


def refuse_unlike_images(assembly: Assembly, graph: Connectivity, group: Ints, candidates: Bools, fixed: Bits) -> None:
    """Raise InputError for a count, not of jld, that tells images of random labellings under a group (g, m) apart."""
    added = [count for count in registered() if count.name not in _BUILT_IN]
    if not added:
        return
    rng = np.random.default_rng(0)
    random = rng.random((_TRIED, len(fixed))) < rng.random((_TRIED, 1))
    rows = np.where(candidates, random, fixed)
    blocks = blocks_of(graph, rows)
    rows &= ~candidates | (blocks[:, graph.a] != blocks[:, graph.b])
    for name, counted in _values(added, assembly, rows[:, group].reshape(-1, len(fixed)), graph, None).items():
        values = counted.reshape(_TRIED, -1)
        unlike = np.argwhere(abs(values - values[:, :1]) > 1e-9 * abs(values).max())
        if len(unlike):
            (row, image), remedy = unlike[0], 'equal counts of images, or search.symmetry "none"'
            problem = f"it is {values[row, 0]:g} of a layout and {values[row, image]:g} of its mirror image"
            if name in plugins.entry_points("jld.counts"):
                raise plugins.refuse_type("jld.counts", name, remedy, problem)
            raise InputError(f"count {name!r}", problem, remedy)


def registered() -> tuple[Count, ...]:
    """Return all counts, with those of plug-ins, in the order of their columns.

    Returns
    -------
    tuple of Count
    """
    _add_plugins()
    return tuple(_COUNTS.values())


@typed
def register(count: Count) -> None:
    """Add a count.

    Parameters
    ----------
    count : Count
        Count.

    Raises
    ------
    ValueError
        If the name is taken or is not a Python identifier.
    """
    if count.name in _COUNTS or not count.name.isidentifier():
        raise ValueError(f"a count cannot be named {count.name!r}")
    _COUNTS[count.name] = count


def unregister(name: str) -> None:
    """Remove a registered count.

    Parameters
    ----------
    name : str
        Name.

    Raises
    ------
    KeyError
        If no count has this name.
    """
    del _COUNTS[name]


@typed
def count_named(name: str, where: str = "search.front.count") -> Count:
    """Return a count by its name.

    Parameters
    ----------
    name : str
        Name.
    where : str
        Key that gave the name, for the error message.

    Returns
    -------
    Count

    Raises
    ------
    InputError
        If no count has this name.
    """
    _add_plugins()
    if name not in _COUNTS:
        raise InputError(where, f'"{name}" is no count', near(name, list(_COUNTS)))
    return _COUNTS[name]


Values = dict[str, Ints | Floats]  # values (k,) by the names of counts

_CHUNK: Final = 8192  # number of labellings counted together, so that arrays stay in the cache

# Number of labellings counted together where time may run out: those of an unfinished slice are lost
_SLICE: Final = 64


@typed
def values_of(
    count: Count,
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity | None = None,
    shapes: BlockShapes | None = None,
) -> Ints | Floats:
    """Compute the values of one count.

    Parameters
    ----------
    count : Count
        Count.
    assembly : Assembly
        The structure.
    labellings : (k, m) bool array
        Labels, True = dry.
    graph : Connectivity, optional
        Element graph; built if missing.
    shapes : BlockShapes, optional
        Outlines of blocks; built if missing.

    Returns
    -------
    (k,) int or float array
        Values, scene units.
    """
    return _values([count], assembly, labellings, graph, shapes)[count.name]


def counts(
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity | None = None,
    shapes: BlockShapes | None = None,
    *,
    without: Sequence[Count] = (),
) -> Values:
    """Compute the values (k,), scene units, of every registered count, by name in the order of columns."""
    return _values([count for count in registered() if count not in without], assembly, labellings, graph, shapes)


def values_until(
    count: Count, assembly: Assembly, labellings: Bits, graph: Connectivity, shapes: BlockShapes, deadline: Deadline
) -> Ints | Floats:
    """Compute a count (k,) in time: NaN from the first labelling on that is late, never the very first."""
    if not deadline.limited:
        return _values([count], assembly, labellings, graph, shapes)[count.name]
    # whoever has a layout also has its counts: the first one is never late
    parts, counted = [count.of(Layouts(assembly, labellings[:1], graph, shapes))], min(1, len(labellings))
    try:
        with deadline.enforced():
            while counted < len(labellings):
                parts.append(count.of(Layouts(assembly, labellings[counted : counted + _SLICE], graph, shapes)))
                counted = min(counted + _SLICE, len(labellings))
    except DeadlinePassed:
        parts.append(np.full(len(labellings) - counted, np.nan))
    values: Floats = np.concatenate(parts)
    return values


def _values(
    chosen: Sequence[Count],
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity | None,
    shapes: BlockShapes | None,
) -> Values:
    graph, shapes = graph or connectivity(assembly), shapes or BlockShapes(assembly)
    starts = range(0, max(1, len(labellings)), _CHUNK)
    parts = (Layouts(assembly, labellings[low : low + _CHUNK], graph, shapes) for low in starts)
    columns = [[count.of(part) for count in chosen] for part in parts]
    return {
        count.name: np.concatenate(column) for count, column in zip(chosen, zip(*columns, strict=True), strict=True)
    }
