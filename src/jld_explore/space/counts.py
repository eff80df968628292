"""Define counts of labellings for tables, fronts, pictures and proofs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Final

import numpy as np

from jld_core import plugins
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import InputError
from jld_core.geometry.outlines import boundary
from jld_core.parameters import near, typed
from jld_explore.space.labelling import Connectivity, blocks_of, connectivity, numbers_of, totals_of
from jld_explore.space.shapes import BlockShapes


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
        found = numbers_of(self.blocks, self.assembly.elements.free).T
        if self.assembly.sink >= 0:
            # Omitted cells do not form a block.
            found[self.blocks[:, self.assembly.sink], np.arange(len(self.labellings))] = 0
        return found

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
        """Title of the column."""
        return self.column or self.name.replace("_", " ")

    def heading(self, assembly: Assembly) -> str:
        """Return the title for an assembly, for example a length in the plane or an area in space."""
        return self.title if isinstance(self.axis, str) else self.axis(assembly)

    def label(self, assembly: Assembly) -> str:
        """Return the axis label, with the unit in brackets."""
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
    """Return (k,) mass of the heaviest block."""
    elements = layouts.assembly.elements
    stays = layouts.stays[:, elements.free] * elements.mass[elements.free]
    return np.asarray(totals_of(layouts.blocks, elements.free, stays).max(axis=1, initial=0.0))


def _mass(layouts: Layouts) -> Floats:
    """Return (k,) mass of all elements that are not left out."""
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
    around = np.array(
        [boundary(elements.shape[e], elements.faces[e] if elements.faces else None) for e in elements.free]
    )
    ends = [np.where(elements.support[side], False, stays[:, side]) for side in (faces.a, faces.b)]
    real = ~assembly.of_members & ((faces.b != assembly.sink) if assembly.sink >= 0 else True)
    inner = ~layouts.labellings & real & stays[:, faces.a] & stays[:, faces.b]
    within = np.where(inner, assembly.face_sizes, 0.0) * (ends[0].astype(int) + ends[1].astype(int))
    whole = np.where(stays[:, elements.free], around, 0.0).sum(axis=1)
    scale = float(around.sum()) or 1.0
    # Round, so that equal lengths compare equal for any order of summation.
    return np.asarray(np.round((whole - within.sum(axis=1)) / scale, 12) * scale)


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
            of=lambda layouts: layouts.block_shapes.different(layouts.blocks, layouts.assembly.sink),
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
            of=lambda layouts: layouts.block_shapes.total(layouts.blocks, "faces", layouts.assembly.sink),
            axis="sawn faces of all blocks",
            noun="cut",
            outlines=True,
            # a triangle, a tetrahedron
            least_of_block={2: 3, 3: 4},
        ),
        Count(
            "saw_set_ups",
            of=lambda layouts: layouts.block_shapes.total(layouts.blocks, "lines", layouts.assembly.sink, once=True),
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
        _COUNTS.setdefault(name, count)


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
    count: Count,
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity,
    shapes: BlockShapes,
    deadline: Deadline,
) -> Ints | Floats:
    """Compute a count (k,) in time: NaN from the first labelling on that is late, never the very first."""
    if not deadline.limited:
        return _values([count], assembly, labellings, graph, shapes)[count.name]
    # whoever has a layout also has its counts: the first one is never late
    known, done = [count.of(Layouts(assembly, labellings[:1], graph, shapes))], min(1, len(labellings))
    try:
        with deadline.enforced():
            while done < len(labellings):
                known.append(count.of(Layouts(assembly, labellings[done : done + _SLICE], graph, shapes)))
                done = min(done + _SLICE, len(labellings))
    except DeadlinePassed:
        known.append(np.full(len(labellings) - done, np.nan))
    values: Floats = np.concatenate(known)
    return values


def _values(
    wanted: Sequence[Count],
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity | None,
    shapes: BlockShapes | None,
) -> Values:
    """Compute the values of several counts in chunks of `_CHUNK` labellings."""
    graph, shapes = graph or connectivity(assembly), shapes or BlockShapes(assembly)
    starts = range(0, max(1, len(labellings)), _CHUNK)
    parts = (Layouts(assembly, labellings[low : low + _CHUNK], graph, shapes) for low in starts)
    found = [[count.of(part) for count in wanted] for part in parts]
    return {count.name: np.concatenate(column) for count, column in zip(wanted, zip(*found, strict=True), strict=True)}
