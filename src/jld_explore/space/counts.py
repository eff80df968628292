"""What is counted of a labelling: each count stated once, with all that tables, fronts, pictures and proofs ask of it.

A count that is registered is a column of the results, may be the count of a scene's front, and is a limit where
"search" has a key of its name. `register` takes one of your own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_explore.space.labelling import Connectivity, blocks_of, connectivity, numbers_of, totals_of
from jld_explore.space.shapes import BlockShapes

Values = dict[str, Ints | Floats]
"""Values (k,) by the names of counts."""

_CHUNK: Final = 8192
"""Rows counted together: what stays in a cache level."""


@dataclass(frozen=True)
class Layouts:
    """Labellings (k, m) of an assembly, as counts look at them. graph, block_shapes: the assembly's."""

    assembly: Assembly
    labellings: Bits
    graph: Connectivity
    block_shapes: BlockShapes

    @cached_property
    def blocks(self) -> Ints:
        """(k, n) the block of each element, named by its smallest element."""
        return blocks_of(self.graph, self.labellings)

    @cached_property
    def cells(self) -> Ints:
        """(n, k) free elements in each block, at the row of its smallest element, 0 elsewhere."""
        found = numbers_of(self.blocks, self.assembly.elements.free).T
        if self.assembly.sink >= 0:
            # what is left out is no block
            found[self.blocks[:, self.assembly.sink], np.arange(len(self.labellings))] = 0
        return found

    @cached_property
    def stays(self) -> Bools:
        """(k, n) elements that are not left out."""
        if self.assembly.sink < 0:
            return np.ones((len(self.labellings), len(self.assembly.elements)), dtype=bool)
        return np.asarray(self.blocks != self.blocks[:, [self.assembly.sink]])

    @cached_property
    def dry(self) -> Bits:
        """(k, f) dry labels of the faces between free elements, without those beside what is left out."""
        free = self.assembly.free_faces
        dry = self.labellings[:, free]
        if self.assembly.sink < 0:
            return dry
        a, b = self.assembly.interfaces.a[free], self.assembly.interfaces.b[free]
        return np.asarray(dry & self.stays[:, a] & self.stays[:, b])


@dataclass(frozen=True)
class Terms:
    """A count as a sum of ones, which is what a proof over formulas needs.

    faces: (m,) faces of which each adds one where it is dry, or None. blocks: every block that holds a free element
    adds one.
    """

    faces: Bools | None = None
    blocks: bool = False

    def most(self, assembly: Assembly) -> int:
        """What the count cannot exceed, whatever the labels."""
        faces = 0 if self.faces is None else int(self.faces.sum())
        return faces + (len(assembly.elements.free) if self.blocks else 0)


def _nothing(_: Assembly) -> str:
    return ""


@dataclass(frozen=True)
class Count:
    """One count of labellings.

    name: in scenes and tables. of: its values (k,), equal for images under the scene's symmetries. axis: what it is,
    without its unit. noun: of one of them, or the word before a size. integer: whole numbers. unit: of the assembly.
    column: above a column, its name in words where not given. terms: what a proof of a front needs; None: there is
    none, and a limit on it makes the exact driver enumerate.
    """

    name: str
    of: Callable[[Layouts], Ints | Floats]
    axis: Callable[[Assembly], str] | str
    noun: str
    integer: bool = True
    unit: Callable[[Assembly], str] = _nothing
    column: str = ""
    terms: Callable[[Assembly], Terms] | None = None

    @property
    def title(self) -> str:
        """Words above a column."""
        return self.column or self.name.replace("_", " ")

    def heading(self, assembly: Assembly) -> str:
        """The same of one assembly: what is a length in the plane is an area in space."""
        return self.title if isinstance(self.axis, str) else self.axis(assembly)

    def label(self, assembly: Assembly) -> str:
        """Words for an axis, with the unit in brackets."""
        axis, unit = self.axis if isinstance(self.axis, str) else self.axis(assembly), self.unit(assembly)
        return f"{axis} [{unit}]" if unit else axis

    def words(self, value: float, assembly: Assembly) -> str:
        """A value with what it counts."""
        if not self.integer:
            return f"{self.noun} {value:.3g} {self.unit(assembly)}".rstrip()
        return f"{value:g} {self.noun}" + ("" if value == 1.0 else "s")


def _planar(assembly: Assembly) -> bool:
    return assembly.dimension == 2


def _dry_length(layouts: Layouts) -> Floats:
    free = layouts.assembly.free_faces
    # summed row by row in one order, so that a labelling has one length whatever batch it came in
    return np.asarray(np.where(layouts.dry, layouts.assembly.face_sizes[free], 0.0).sum(axis=1))


def _largest_mass(layouts: Layouts) -> Floats:
    elements = layouts.assembly.elements
    stays = layouts.stays[:, elements.free] * elements.mass[elements.free]
    return np.asarray(totals_of(layouts.blocks, elements.free, stays).max(axis=1, initial=0.0))


def _mass(layouts: Layouts) -> Floats:
    elements = layouts.assembly.elements
    mass = elements.mass[elements.free]
    total = float(mass.sum()) or 1.0
    # what weighs the same has one mass, whatever the order of its elements
    return np.asarray(np.round((layouts.stays[:, elements.free] * mass).sum(axis=1) / total, 12) * total)


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


def registered() -> tuple[Count, ...]:
    """All counts, in the order of their columns."""
    return tuple(_COUNTS.values())


def register(count: Count) -> None:
    """Add a count. Raises ValueError for a name that is taken or cannot be a key."""
    if count.name in _COUNTS or not count.name.isidentifier():
        raise ValueError(f"a count cannot be named {count.name!r}")
    _COUNTS[count.name] = count


def unregister(name: str) -> None:
    """Take a count back that was registered."""
    del _COUNTS[name]


def count_named(name: str, where: str = "search.front.count") -> Count:
    """A count by its name. where: what gave the name. Raises InputError for a name that is none."""
    if name not in _COUNTS:
        known = ", ".join(f'"{other}"' for other in _COUNTS)
        raise InputError(where, f'"{name}" is no count', f"one of {known}")
    return _COUNTS[name]


def values_of(
    count: Count,
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity | None = None,
    shapes: BlockShapes | None = None,
) -> Ints | Floats:
    """Values (k,) of one count of labellings (k, m), scene units; graph, shapes: the space's, made where not given."""
    return _values([count], assembly, labellings, graph, shapes)[count.name]


def counts(
    assembly: Assembly, labellings: Bits, graph: Connectivity | None = None, shapes: BlockShapes | None = None
) -> Values:
    """Values (k,) of every count by its name, in the order of their columns."""
    return _values(registered(), assembly, labellings, graph, shapes)


def _values(
    wanted: Sequence[Count],
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity | None,
    shapes: BlockShapes | None,
) -> Values:
    graph, shapes = graph or connectivity(assembly), shapes or BlockShapes(assembly)
    starts = range(0, max(1, len(labellings)), _CHUNK)
    parts = (Layouts(assembly, labellings[low : low + _CHUNK], graph, shapes) for low in starts)
    found = [[count.of(part) for count in wanted] for part in parts]
    return {count.name: np.concatenate(column) for count, column in zip(wanted, zip(*found, strict=True), strict=True)}
