"""Define the limits on blocks and counts under "search", with their measures and rounding."""

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
from jld_explore.space.counts import BlockShapes, Count, Terms, count_named, registered, values_of
from jld_explore.space.labelling import Connectivity, blocks_of, numbers_of, totals_of


@dataclass(frozen=True)
class Range:
    """Inclusive bounds as a scene gives them, with a tolerance for rounding."""

    # low, high: bounds as given, None for no bound
    low: float | None
    high: float | None
    # least, most: bounds with tolerance for comparisons, ±inf for no bound
    least: float
    most: float

    @classmethod
    def of(cls, bounds: Sequence[float | None], *, whole: bool) -> Range:
        """Make a range from bounds [low, high]; bounds on whole numbers have no tolerance."""
        low, high = bounds
        slack = 0.0 if whole else tolerances.DECIMALS
        least = -inf if low is None else low * (1.0 - slack)
        return cls(low, high, least, inf if high is None else high * (1.0 + slack))

    @property
    def given(self) -> bool:
        return self.low is not None or self.high is not None

    def above(self, values: Floats | Ints | float, slack: float = 0.0) -> Bools:
        """Return where values exceed the upper bound, by more than a further relative `slack`."""
        return np.asarray(np.asarray(values) > self.most * (1.0 + slack))

    def below(self, values: Floats | Ints | float, slack: float = 0.0) -> Bools:
        """Return where values are less than the lower bound, by more than a further `slack`."""
        return np.asarray(np.asarray(values) < self.least * (1.0 - slack))

    def outside(self, values: Floats | Ints | float, slack: float = 0.0) -> Bools:
        """Return where values violate either bound, by more than a further `slack`."""
        return np.asarray(self.above(values, slack) | self.below(values, slack))


@dataclass(frozen=True)
class Measure:
    """Measure of a block's size over its free elements; a part is never larger than the whole."""

    key: str  # key of its limit under "search"
    words: str  # words after a size in messages
    whole: bool  # True for whole numbers
    # function that returns the contribution of each element (n,). None for the longest side of the bounding box.
    of: Callable[[Elements], Floats] | None


# number of free elements of a block
CELLS: Final = Measure("block_cells", "free elements", True, lambda elements: np.ones(len(elements)))

# sum of the magnitudes of the elements' weights, scene units of force
WEIGHT: Final = Measure("block_weight", "of weight", False, lambda elements: np.linalg.norm(elements.weight, axis=1))

# longest side of the bounding box of a block, scene units of length
EXTENT: Final = Measure("block_extent", "of extent", False, None)

# sum of the masses of the elements
MASS: Final = Measure("block_mass", "of mass", False, lambda elements: elements.mass)
MEASURES: Final = (CELLS, WEIGHT, MASS, EXTENT)  # block measures that can be limited, in the order of messages

# number of elements of a block that `search.except` names: one exempts the block from limits
EXEMPT: Final = Measure("", "of elements that limits except", True, None)

SizeOf = Callable[[Measure], Floats]  # returns the sizes of some blocks by a measure, in the shape of the blocks


@dataclass(frozen=True)
class Sized:
    """Sizes of n elements, or sets of elements, by every measure."""

    adds: dict[str, Floats]  # contributions to each additive measure, by its key
    corner: Floats  # (n, 2 d) upper corner of the bounding box, followed by the negative lower corner

    @classmethod
    def elements(cls, elements: Elements, excepted: Bools) -> Sized:
        """Compute the sizes of elements, 0 for supports; `excepted` (n,) exempt their blocks from limits."""
        free = ~elements.support
        adds = {
            measure.key: np.where(free, measure.of(elements), 0.0).astype(float) for measure in MEASURES if measure.of
        }
        adds[EXEMPT.key] = excepted.astype(float)
        return cls(adds, np.where(free[:, None], np.hstack([elements.upper, -elements.lower]), -inf))

    def take(self, order: Ints) -> Sized:
        return Sized({key: values[order] for key, values in self.adds.items()}, self.corner[order])

    def joined(self, name: Ints, count: int) -> Sized:
        """Return the sizes of `count` sets of entries; name: (n,) set of each entry."""
        corner = np.full((count, self.corner.shape[1]), -inf)
        np.maximum.at(corner, name, self.corner)
        adds = {key: np.bincount(name, values, minlength=count).astype(float) for key, values in self.adds.items()}
        return Sized(adds, corner)

    def all(self) -> SizeOf:
        """Return a function that gives the sizes (n,) of the single entries."""
        return lambda measure: self.adds[measure.key] if measure.key in self.adds else _longest(self.corner.T)

    def together(self, members: Bools) -> SizeOf:
        """Return a function that gives the sizes (r,) of r sets with `members` (n, r)."""

        def size(measure: Measure) -> Floats:
            if measure.key in self.adds:
                return np.asarray(self.adds[measure.key] @ members)
            return _longest(np.array([np.where(members, side[:, None], -inf).max(axis=0) for side in self.corner.T]))

        return size

    def one(self, members: Iterable[int]) -> SizeOf:
        """Return the function that sizes one block of elements by a measure."""
        rows = sorted(members)

        def size(measure: Measure) -> Floats:
            if measure.key in self.adds:
                return np.asarray(self.adds[measure.key][rows].sum())
            return _longest(self.corner[rows].max(axis=0))

        return size


def _longest(corner: Floats) -> Floats:
    """Return the longest side of bounding boxes given by `Sized.corner`, transposed (2 d, …)."""
    d = len(corner) // 2
    with np.errstate(invalid="ignore"):
        return np.asarray((corner[:d] + corner[d:]).max(axis=0))


def block_sizes(assembly: Assembly, blocks: Ints, measures: Sequence[Measure] = MEASURES) -> dict[str, Floats]:
    """Compute the sizes of blocks (k, n), scene units, at the column of each name, by key of the measure."""
    elements, free = assembly.elements, assembly.elements.free
    count, width = blocks.shape
    sizes = {}
    for measure in measures:
        if measure.of:
            values = totals_of(blocks, free, measure.of(elements)[free])
        else:
            flat_name = (blocks[:, free] + width * np.arange(count)[:, None]).ravel()
            corner = np.full((count * width, 2 * assembly.dimension), -inf)
            np.maximum.at(corner, flat_name, np.tile(np.hstack([elements.upper, -elements.lower])[free], (count, 1)))
            values = np.where(np.isfinite(corner[:, 0]), _longest(corner.T), 0.0)
        sizes[measure.key] = np.asarray(values, dtype=np.float64).reshape(count, width)
    return sizes


_SAME: Final = 1e-12  # relative difference up to which sizes of elements count as equal

# limits on the shape of single blocks: key under "search", and attribute of an outline
SHAPED: Final = {"block_aspect": "aspect"}
_MEASURED: Final = 1e-6  # relative rounding allowed for values measured on the outline of a block


@dataclass(frozen=True)
class Limits:
    assembly: Assembly  # structure with n elements and m faces
    search: Search  # section "search" of a scene

    @cached_property
    def on_blocks(self) -> tuple[tuple[Measure, Range], ...]:
        ranges = ((measure, Range.of(getattr(self.search, measure.key), whole=measure.whole)) for measure in MEASURES)
        return tuple((measure, bounds) for measure, bounds in ranges if bounds.given)

    @cached_property
    def on_counts(self) -> tuple[tuple[Count, Range], ...]:
        keys = type(self.search).model_fields.keys()
        pairs = [(count, getattr(self.search, count.name)) for count in registered() if count.name in keys]
        pairs += [(count_named(name, f"search.limits.{name}"), pair) for name, pair in self.search.limits.items()]
        ranges = ((count, Range.of(pair, whole=count.integer)) for count, pair in pairs)
        return tuple((count, bounds) for count, bounds in ranges if bounds.given)

    @cached_property
    def on_terms(self) -> tuple[tuple[Terms, Range], ...]:
        """Given limits on counts that are sums of binary terms; empty if cells may be left out."""
        if self.assembly.sink >= 0:
            return ()
        return tuple((count.terms(self.assembly), bounds) for count, bounds in self.on_counts if count.terms)

    @cached_property
    def excepted(self) -> Bools:
        """(n,) mask of the elements, with the sink, that exempt their block from limits."""
        mask, elements = np.zeros(len(self.assembly.elements), dtype=bool), self.assembly.elements
        for position, name in enumerate(self.search.except_):
            if name not in elements.index or elements.support[elements.index[name]]:
                fault = "is a support" if name in elements.index else "names no element"
                raise InputError(f"search.except[{position}]", f"{name!r} {fault}", "the id of a free element")
            mask[elements.index[name]] = True
        if self.assembly.sink >= 0:
            # Omitted cells do not form a block.
            mask[self.assembly.sink] = True
        return mask

    @property
    def mendable(self) -> bool:
        """True if adding an exempt element can make a block that is too large admissible."""
        return bool(self.search.except_)

    @cached_property
    def sized(self) -> Sized:
        return Sized.elements(self.assembly.elements, self.excepted)

    @cached_property
    def block_shapes(self) -> BlockShapes:
        """Outlines of blocks; rotated or mirrored ones are equal if `search.moulds` allows it."""
        moulds = self.search.moulds
        return BlockShapes(self.assembly, rotate=moulds.rotate, flip=moulds.flip)

    @cached_property
    def on_shapes(self) -> tuple[tuple[str, Range], ...]:
        """Given limits on the shape of single whole blocks, by the attribute of an outline."""
        bounds = [(name, Range.of(getattr(self.search, key), whole=False)) for key, name in SHAPED.items()]
        convex = self.search.convex_blocks
        corners = Range.of((None, None if convex is False else 0 if convex is True else convex), whole=True)
        return tuple((name, limit) for name, limit in (*bounds, ("reentrant", corners)) if limit.given)

    def misshapen(self, members: Iterable[int]) -> bool:
        """Return whether a block, given by its free elements, violates a limit on its shape."""
        rows = np.array(sorted(members), dtype=np.int64)
        if not self.on_shapes or self.excepted[rows].any():
            return False
        shape = self.block_shapes.one(rows)
        return any(bool(bounds.outside(getattr(shape, name), _MEASURED)) for name, bounds in self.on_shapes)

    @property
    def given(self) -> bool:
        """True if any limit is given or cells may be left out."""
        return bool(self.on_blocks or self.on_counts or self.on_shapes) or self.assembly.sink >= 0

    def bounds(self, measure: Measure) -> Range:
        return Range.of(getattr(self.search, measure.key), whole=measure.whole)

    @property
    def has_most(self) -> bool:
        """True if there is an upper limit on blocks."""
        return any(bounds.high is not None for _, bounds in self.on_blocks)

    @property
    def has_least(self) -> bool:
        """True if there is a lower limit on blocks."""
        return any(bounds.low is not None for _, bounds in self.on_blocks)

    def too_large(self, size: SizeOf, slack: float = 0.0) -> Bools:
        """Return where blocks exceed an upper limit, in the shape of the sizes; False for exempt ones."""
        exceeded = [bounds.above(size(measure), slack) for measure, bounds in self.on_blocks if bounds.high is not None]
        return self._violated(exceeded, size)

    def too_small(self, size: SizeOf, slack: float = 0.0) -> Bools:
        """Return where blocks are below a lower limit; False for exempt ones."""
        missed = [bounds.below(size(measure), slack) for measure, bounds in self.on_blocks if bounds.low is not None]
        return self._violated(missed, size)

    def _violated(self, broken: list[Bools], size: SizeOf) -> Bools:
        if not broken:
            return np.asarray(False)
        violated = np.logical_or.reduce(broken)
        return np.asarray(violated & (size(EXEMPT) == 0.0) if self.excepted.any() else violated)

    def kept(self, labellings: Bits, graph: Connectivity, blocks: Ints | None = None) -> Bools:
        """Return (k,) whether labellings (k, m), of known blocks (k, n), satisfy all limits."""
        satisfied = np.ones(len(labellings), dtype=bool)
        if self.assembly.sink >= 0 and len(labellings):
            blocks = blocks_of(graph, labellings) if blocks is None else blocks
            satisfied &= self._leaves_a_structure(graph, blocks)
        if self.on_blocks:
            blocks = blocks_of(graph, labellings) if blocks is None else blocks
            sizes = block_sizes(self.assembly, blocks, [CELLS, *(m for m, _ in self.on_blocks if m is not CELLS)])
            holds = sizes[CELLS.key] > 0
            sizes[EXEMPT.key] = self._exempt(blocks)
            wrong = self.too_large(lambda m: sizes[m.key]) | self.too_small(lambda m: sizes[m.key])
            satisfied &= ~np.any(holds & wrong, axis=1)
        if self.on_shapes and satisfied.any():
            blocks = blocks_of(graph, labellings) if blocks is None else blocks
            holds, shape_of = self.block_shapes.look(blocks)
            if self.excepted.any():
                holds &= self._exempt(blocks) == 0.0
            for name, bounds in self.on_shapes:
                misshapen = bounds.outside(self.block_shapes.values(name), _MEASURED)
                satisfied &= ~np.any(holds & misshapen[shape_of], axis=1)
        for count, bounds in self.on_counts:
            satisfied &= ~bounds.outside(values_of(count, self.assembly, labellings, graph, self.block_shapes))
        return satisfied

    @property
    def most_left_out(self) -> float:
        """Largest total volume of omitted cells, scene units, with a tolerance for rounding."""
        if self.search.void is None:
            return 0.0
        elements = self.assembly.elements
        return self.search.void.most * float(elements.volume[elements.free].sum()) * (1.0 + tolerances.DECIMALS)

    def _leaves_a_structure(self, graph: Connectivity, blocks: Ints) -> Bools:
        """Return (k,) where the remaining cells of blocks (k, n) stand and few enough are omitted."""
        # Only cells that may be left out are omitted, never all.
        sink, elements, faces = self.assembly.sink, self.assembly.elements, self.assembly.interfaces
        gone = blocks == blocks[:, [sink]]
        free, support = elements.free, np.flatnonzero(elements.support & (np.arange(len(elements)) != sink))
        enough = gone[:, free] @ elements.volume[free] <= self.most_left_out
        standing = ~gone[:, support].any(axis=1) & enough & ~gone[:, free].all(axis=1)
        may = np.isin(np.arange(len(elements)), faces.a[faces.b == sink])
        standing &= ~(gone[:, free] & ~may[free]).any(axis=1)
        parts = blocks_of(graph, gone[:, faces.a] | gone[:, faces.b])
        rows = np.arange(len(blocks))[:, None]
        grounded = np.zeros(blocks.shape, dtype=bool)
        grounded[rows, parts[:, support]] = True
        return np.asarray(standing & (grounded[rows, parts[:, free]] | gone[:, free]).all(axis=1))

    def _exempt(self, blocks: Ints) -> Floats:
        """Return (k, n) number of exempt elements in each block, at the column of its name."""
        return numbers_of(blocks, np.flatnonzero(self.excepted)).astype(float)

    def by_cells(self, sized: Sized) -> dict[str, Range]:
        """Return the range of each measure by its key; equal cells turn it into a range on cells."""
        # A limit on an additive measure becomes a limit on cells if all cells have the same size.
        limits = {measure.key: self.bounds(measure) for measure in MEASURES}
        cells = limits[CELLS.key]
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
                limits[measure.key] = Range.of((None, None), whole=measure.whole)
        limits[CELLS.key] = Range(low or None, None if high == inf else high, low, high)
        return limits
