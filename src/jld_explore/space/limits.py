"""What blocks and counts of a labelling must satisfy under "search": every limit, its measure and its rounding.

A limit is a range on the size of each block, by one of MEASURES, or on a count that has a key of its name. Whoever
keeps limits asks `Limits` for those that are given and compares by `Range`, in whatever form it holds its blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, inf
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly, Elements
from jld_core.errors import InputError
from jld_core.scene import Search
from jld_explore.space.counts import Count, Terms, registered, values_of
from jld_explore.space.labelling import Connectivity, blocks_of, numbers_of, totals_of
from jld_explore.space.shapes import BlockShapes

_SAME: Final = 1e-12
"""Relative difference between sizes of elements that are one."""


SHAPED: Final = {"block_aspect": "aspect"}
"""Limits on the shape of single blocks with bounds: key under "search" and attribute of `BlockShapes`."""

_MEASURED: Final = 1e-6
"""Relative rounding of what is measured on the outline of a block."""


@dataclass(frozen=True)
class Range:
    """Inclusive bounds as a scene gives them, None for none, and as numbers that rounding is allowed for.

    low, high: as given. least, most: what to compare with, ±inf for none.
    """

    low: float | None
    high: float | None
    least: float
    most: float

    @classmethod
    def of(cls, given: Sequence[float | None], *, whole: bool) -> Range:
        """Bounds [low, high]. whole: on whole numbers, which do not round."""
        low, high = given
        slack = 0.0 if whole else tolerances.DECIMALS
        least = -inf if low is None else low * (1.0 - slack)
        return cls(low, high, least, inf if high is None else high * (1.0 + slack))

    @property
    def given(self) -> bool:
        """Whether there is a bound."""
        return self.low is not None or self.high is not None

    def above(self, values: Floats | Ints | float, slack: float = 0.0) -> Bools:
        """True where values exceed the range by more than rounding; slack: relative, allowed beside."""
        return np.asarray(np.asarray(values) > self.most * (1.0 + slack))

    def below(self, values: Floats | Ints | float, slack: float = 0.0) -> Bools:
        """True where values fall short of the range by more than rounding."""
        return np.asarray(np.asarray(values) < self.least * (1.0 - slack))

    def outside(self, values: Floats | Ints | float, slack: float = 0.0) -> Bools:
        """True where values do either."""
        return np.asarray(self.above(values, slack) | self.below(values, slack))


@dataclass(frozen=True)
class Measure:
    """How large a block is, over its free elements, scene units; a part of a block is never larger than it.

    key: of its limit under "search". words: what it is in. whole: a whole number. of: what each element (n,) adds;
    None: the longest side of the box around the block.
    """

    key: str
    words: str
    whole: bool
    of: Callable[[Elements], Floats] | None


CELLS: Final = Measure("block_cells", "free elements", True, lambda elements: np.ones(len(elements)))
WEIGHT: Final = Measure("block_weight", "of weight", False, lambda elements: np.linalg.norm(elements.weight, axis=1))
EXTENT: Final = Measure("block_extent", "of extent", False, None)
MASS: Final = Measure("block_mass", "of mass", False, lambda elements: elements.mass)

MEASURES: Final = (CELLS, WEIGHT, MASS, EXTENT)

EXEMPT: Final = Measure("", "of elements that limits except", True, None)
"""How many elements that limits on single blocks except a block holds; no limit speaks of it."""

SizeOf = Callable[[Measure], Floats]
"""Sizes of some blocks by a measure, in whatever shape the blocks come."""


@dataclass(frozen=True)
class Sized:
    """n things with a size by every measure, elements or sets of them: what they add, and the corners of their boxes.

    adds: by key, (n,). corner: (n, 2 d) upper corner followed by the negative lower one.
    """

    adds: dict[str, Floats]
    corner: Floats

    @classmethod
    def elements(cls, elements: Elements, excepted: Bools) -> Sized:
        """The elements of an assembly; supports have no size. excepted: (n,) those that limits except."""
        free = ~elements.support
        adds = {
            measure.key: np.where(free, measure.of(elements), 0.0).astype(float) for measure in MEASURES if measure.of
        }
        adds[EXEMPT.key] = excepted.astype(float)
        return cls(adds, np.where(free[:, None], np.hstack([elements.upper, -elements.lower]), -inf))

    def take(self, order: Ints) -> Sized:
        """The same of some, in an order."""
        return Sized({key: values[order] for key, values in self.adds.items()}, self.corner[order])

    def joined(self, name: Ints, count: int) -> Sized:
        """Sets of them. name: (n,) the set that each is in, of `count`."""
        corner = np.full((count, self.corner.shape[1]), -inf)
        np.maximum.at(corner, name, self.corner)
        adds = {key: np.bincount(name, values, minlength=count).astype(float) for key, values in self.adds.items()}
        return Sized(adds, corner)

    def all(self) -> SizeOf:
        """Sizes (n,) of each by itself."""
        return lambda measure: self.adds[measure.key] if measure.key in self.adds else _longest(self.corner.T)

    def together(self, members: Bools) -> SizeOf:
        """Sizes (r,) of r sets at once; members: (n, r)."""

        def size(measure: Measure) -> Floats:
            if measure.key in self.adds:
                return np.asarray(self.adds[measure.key] @ members)
            return _longest(np.array([np.where(members, side[:, None], -inf).max(axis=0) for side in self.corner.T]))

        return size

    def one(self, members: Iterable[int]) -> SizeOf:
        """The size of one set."""
        rows = sorted(members)

        def size(measure: Measure) -> Floats:
            if measure.key in self.adds:
                return np.asarray(self.adds[measure.key][rows].sum())
            return _longest(self.corner[rows].max(axis=0))

        return size


def _longest(corner: Floats) -> Floats:
    """Longest side of boxes given by their corners (2 d, …)."""
    d = len(corner) // 2
    with np.errstate(invalid="ignore"):
        return np.asarray((corner[:d] + corner[d:]).max(axis=0))


def block_sizes(assembly: Assembly, blocks: Ints, measures: Sequence[Measure] = MEASURES) -> dict[str, Floats]:
    """Sizes of all blocks of labellings by the keys of measures, scene units.

    blocks: (k, n) from `blocks_of`. Returns (k, n) arrays at the column of each block's name, zero in every column
    that names no block with a free element.
    """
    elements, free = assembly.elements, assembly.elements.free
    count, width = blocks.shape
    found = {}
    for measure in measures:
        if measure.of:
            values = totals_of(blocks, free, measure.of(elements)[free])
        else:
            place = (blocks[:, free] + width * np.arange(count)[:, None]).ravel()
            corner = np.full((count * width, 2 * assembly.dimension), -inf)
            np.maximum.at(corner, place, np.tile(np.hstack([elements.upper, -elements.lower])[free], (count, 1)))
            values = np.where(np.isfinite(corner[:, 0]), _longest(corner.T), 0.0)
        found[measure.key] = np.asarray(values, dtype=np.float64).reshape(count, width)
    return found


@dataclass(frozen=True)
class Limits:
    """All limits of a search over an assembly."""

    assembly: Assembly
    search: Search

    @cached_property
    def on_blocks(self) -> tuple[tuple[Measure, Range], ...]:
        """Limits on single blocks that are given."""
        ranges = ((measure, Range.of(getattr(self.search, measure.key), whole=measure.whole)) for measure in MEASURES)
        return tuple((measure, bounds) for measure, bounds in ranges if bounds.given)

    @cached_property
    def on_counts(self) -> tuple[tuple[Count, Range], ...]:
        """Limits on counts that are given."""
        known = (count for count in registered() if count.name in type(self.search).model_fields)
        ranges = ((count, Range.of(getattr(self.search, count.name), whole=count.integer)) for count in known)
        return tuple((count, bounds) for count, bounds in ranges if bounds.given)

    @cached_property
    def on_terms(self) -> tuple[tuple[Terms, Range], ...]:
        """Those limits on counts that are sums of ones; none where cells may be left out."""
        if self.assembly.sink >= 0:
            return ()
        return tuple((count.terms(self.assembly), bounds) for count, bounds in self.on_counts if count.terms)

    @cached_property
    def excepted(self) -> Bools:
        """(n,) elements that limits on single blocks except, with the blocks that hold them.

        Raises InputError for an id that is none of a free element.
        """
        found, elements = np.zeros(len(self.assembly.elements), dtype=bool), self.assembly.elements
        for place, name in enumerate(self.search.except_):
            if name not in elements.index or elements.support[elements.index[name]]:
                what = "is a support" if name in elements.index else "names no element"
                raise InputError(f"search.except[{place}]", f"{name!r} {what}", "the id of a free element")
            found[elements.index[name]] = True
        if self.assembly.sink >= 0:
            # what is left out is no block
            found[self.assembly.sink] = True
        return found

    @property
    def mendable(self) -> bool:
        """Whether a block that is too large may be mended by what is added: an element that limits except."""
        return bool(self.search.except_)

    @cached_property
    def sized(self) -> Sized:
        """The sizes of the elements."""
        return Sized.elements(self.assembly.elements, self.excepted)

    @cached_property
    def block_shapes(self) -> BlockShapes:
        """The shapes of blocks, as moulds may be."""
        moulds = self.search.moulds
        return BlockShapes(self.assembly, rotate=moulds.rotate, flip=moulds.flip)

    @cached_property
    def on_shapes(self) -> tuple[tuple[str, Range], ...]:
        """Limits on the shape of single blocks that are given, by the attribute of `BlockShapes`.

        A part of a block may break what the whole keeps, so they say nothing of blocks that still grow.
        """
        bounds = [(name, Range.of(getattr(self.search, key), whole=False)) for key, name in SHAPED.items()]
        convex = self.search.convex_blocks
        corners = Range.of((None, None if convex is False else 0 if convex is True else convex), whole=True)
        return tuple((name, one) for name, one in (*bounds, ("reentrant", corners)) if one.given)

    def misshapen(self, members: Iterable[int]) -> bool:
        """Whether one block, by its free elements, has a shape that is not wanted."""
        rows = np.array(sorted(members), dtype=np.int64)
        if not self.on_shapes or self.excepted[rows].any():
            return False
        shape = self.block_shapes.one(rows)
        return any(bool(bounds.outside(getattr(shape, name), _MEASURED)) for name, bounds in self.on_shapes)

    @property
    def given(self) -> bool:
        """Whether there is any limit."""
        return bool(self.on_blocks or self.on_counts or self.on_shapes) or self.assembly.sink >= 0

    def bounds(self, measure: Measure) -> Range:
        """The limit on blocks by one measure."""
        return Range.of(getattr(self.search, measure.key), whole=measure.whole)

    @property
    def has_most(self) -> bool:
        """Whether a block can be too large."""
        return any(bounds.high is not None for _, bounds in self.on_blocks)

    @property
    def has_least(self) -> bool:
        """Whether a block can be too small."""
        return any(bounds.low is not None for _, bounds in self.on_blocks)

    def too_large(self, size: SizeOf, slack: float = 0.0) -> Bools:
        """Where blocks of some sizes exceed a limit; unless `mendable` nothing that is added can mend it."""
        found = [bounds.above(size(measure), slack) for measure, bounds in self.on_blocks if bounds.high is not None]
        return self._held(found, size)

    def too_small(self, size: SizeOf, slack: float = 0.0) -> Bools:
        """Where blocks of some sizes fall short of a limit."""
        found = [bounds.below(size(measure), slack) for measure, bounds in self.on_blocks if bounds.low is not None]
        return self._held(found, size)

    def _held(self, broken: list[Bools], size: SizeOf) -> Bools:
        """Where any is broken and the block is not excepted."""
        if not broken:
            return np.asarray(False)
        found = np.logical_or.reduce(broken)
        return np.asarray(found & (size(EXEMPT) == 0.0) if self.excepted.any() else found)

    def kept(self, labellings: Bits, graph: Connectivity, blocks: Ints | None = None) -> Bools:
        """(k,) True where all limits are kept. labellings: (k, m); blocks: (k, n), theirs, where they are known."""
        good = np.ones(len(labellings), dtype=bool)
        if self.assembly.sink >= 0 and len(labellings):
            blocks = blocks_of(graph, labellings) if blocks is None else blocks
            good &= self._leaves_a_structure(graph, blocks)
        if self.on_blocks:
            blocks = blocks_of(graph, labellings) if blocks is None else blocks
            sizes = block_sizes(self.assembly, blocks, [CELLS, *(m for m, _ in self.on_blocks if m is not CELLS)])
            holds = sizes[CELLS.key] > 0
            sizes[EXEMPT.key] = self._exempt(blocks)
            wrong = self.too_large(lambda m: sizes[m.key]) | self.too_small(lambda m: sizes[m.key])
            good &= ~np.any(holds & wrong, axis=1)
        if self.on_shapes and good.any():
            blocks = blocks_of(graph, labellings) if blocks is None else blocks
            holds, places = self.block_shapes.look(blocks)
            if self.excepted.any():
                holds &= self._exempt(blocks) == 0.0
            for name, bounds in self.on_shapes:
                odd = bounds.outside(self.block_shapes.values(name), _MEASURED)
                good &= ~np.any(holds & odd[places], axis=1)
        for count, bounds in self.on_counts:
            good &= ~bounds.outside(values_of(count, self.assembly, labellings, graph, self.block_shapes))
        return good

    @property
    def most_left_out(self) -> float:
        """Volume of the cells that may be left out together, scene units, rounding allowed for; 0 where none may."""
        if self.search.void is None:
            return 0.0
        elements = self.assembly.elements
        return self.search.void.most * float(elements.volume[elements.free].sum()) * (1.0 + tolerances.DECIMALS)

    def _leaves_a_structure(self, graph: Connectivity, blocks: Ints) -> Bools:
        """(k,) True where no more is left out than may be, and all that stays is joined to a support."""
        sink, elements, faces = self.assembly.sink, self.assembly.elements, self.assembly.interfaces
        gone = blocks == blocks[:, [sink]]
        free, support = elements.free, np.flatnonzero(elements.support & (np.arange(len(elements)) != sink))
        enough = gone[:, free] @ elements.volume[free] <= self.most_left_out
        good = ~gone[:, support].any(axis=1) & enough & ~gone[:, free].all(axis=1)
        may = np.isin(np.arange(len(elements)), faces.a[faces.b == sink])
        good &= ~(gone[:, free] & ~may[free]).any(axis=1)
        parts = blocks_of(graph, gone[:, faces.a] | gone[:, faces.b])
        rows = np.arange(len(blocks))[:, None]
        grounded = np.zeros(blocks.shape, dtype=bool)
        grounded[rows, parts[:, support]] = True
        return np.asarray(good & (grounded[rows, parts[:, free]] | gone[:, free]).all(axis=1))

    def _exempt(self, blocks: Ints) -> Floats:
        """(k, n) elements that are excepted in each block (k, n), at the column of its name."""
        return numbers_of(blocks, np.flatnonzero(self.excepted)).astype(float)

    def by_cells(self, sized: Sized) -> dict[str, Range]:
        """Ranges on single blocks made of some sets, by key; where sizes go with cells, as limits on cells.

        Every measure has its range, and one of cells is in whole numbers.
        """
        found = {measure.key: self.bounds(measure) for measure in MEASURES}
        cells = found[CELLS.key]
        low, high = max(cells.least, 0.0), cells.most
        count = sized.adds[CELLS.key]
        for measure, bounds in self.on_blocks:
            if measure.of is None or measure is CELLS:
                continue
            share = sized.adds[measure.key][count > 0] / count[count > 0]
            unit = float(share.max())
            if unit - float(share.min()) <= _SAME * unit and unit > 0.0:
                low = max(low, ceil(bounds.least / unit - tolerances.DECIMALS) if bounds.least > 0.0 else low)
                high = min(high, floor(bounds.most / unit + tolerances.DECIMALS) if bounds.most < inf else high)
                found[measure.key] = Range.of((None, None), whole=measure.whole)
        found[CELLS.key] = Range(low or None, None if high == inf else high, low, high)
        return found
