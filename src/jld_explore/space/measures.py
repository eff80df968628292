"""Define ranges and the measures of the sizes of blocks, with rounding."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly, Elements
from jld_explore.space.labelling import totals_of


@dataclass(frozen=True)
class Range:
    """Inclusive bounds as a scene gives them, with a tolerance for rounding.

    low, high: bounds as given, None for no bound. least, most: bounds with tolerance for comparisons, ±inf for no
    bound.
    """

    low: float | None
    high: float | None
    least: float
    most: float

    @classmethod
    def of(cls, given: Sequence[float | None], *, whole: bool) -> Range:
        """Make a range from bounds [low, high]; bounds on whole numbers have no tolerance."""
        low, high = given
        slack = 0.0 if whole else tolerances.DECIMALS
        least = -inf if low is None else low * (1.0 - slack)
        return cls(low, high, least, inf if high is None else high * (1.0 + slack))

    @property
    def given(self) -> bool:
        """True if there is at least one bound."""
        return self.low is not None or self.high is not None

    def above(self, values: Floats | Ints | float, slack: float = 0.0) -> Bools:
        """Return True where values exceed the upper bound.

        `slack` is a relative tolerance in addition to that for rounding.
        """
        return np.asarray(np.asarray(values) > self.most * (1.0 + slack))

    def below(self, values: Floats | Ints | float, slack: float = 0.0) -> Bools:
        """Return True where values are less than the lower bound; `slack` is as in `above`."""
        return np.asarray(np.asarray(values) < self.least * (1.0 - slack))

    def outside(self, values: Floats | Ints | float, slack: float = 0.0) -> Bools:
        """Return True where values violate either bound; `slack` is as in `above`."""
        return np.asarray(self.above(values, slack) | self.below(values, slack))


@dataclass(frozen=True)
class Measure:
    """Measure of the size of a block over its free elements, in scene units.

    The size of a part of a block never exceeds the size of the block.

    key: key of its limit under "search". words: words after a size in messages. whole: True for whole numbers. of:
    function that returns the contribution of each element (n,). None for the longest side of the bounding box.
    """

    key: str
    words: str
    whole: bool
    of: Callable[[Elements], Floats] | None


CELLS: Final = Measure("block_cells", "free elements", True, lambda elements: np.ones(len(elements)))
"""Number of free elements of a block."""

WEIGHT: Final = Measure("block_weight", "of weight", False, lambda elements: np.linalg.norm(elements.weight, axis=1))
"""Sum of the magnitudes of the elements' weights, scene units of force."""

EXTENT: Final = Measure("block_extent", "of extent", False, None)
"""Longest side of the bounding box of a block, scene units of length."""

MASS: Final = Measure("block_mass", "of mass", False, lambda elements: elements.mass)
"""Sum of the masses of the elements."""

MEASURES: Final = (CELLS, WEIGHT, MASS, EXTENT)
"""Block measures that can be limited, in the order of messages."""

EXEMPT: Final = Measure("", "of elements that limits except", True, None)
"""Number of elements of a block that `search.except` names; blocks with such an element are exempt from limits."""

SizeOf = Callable[[Measure], Floats]
"""Function that returns the sizes of some blocks by a measure, in the shape of the blocks."""


@dataclass(frozen=True)
class Sized:
    """Sizes of n elements, or sets of elements, by every measure.

    adds: contributions to each additive measure, by its key. corner: (n, 2 d) upper corner of the bounding box,
    followed by the negative lower corner.
    """

    adds: dict[str, Floats]
    corner: Floats

    @classmethod
    def elements(cls, elements: Elements, excepted: Bools) -> Sized:
        """Compute the sizes of the elements of an assembly; supports have no size.

        `excepted` (n,) marks the elements that exempt their block from limits.
        """
        free = ~elements.support
        adds = {
            measure.key: np.where(free, measure.of(elements), 0.0).astype(float) for measure in MEASURES if measure.of
        }
        adds[EXEMPT.key] = excepted.astype(float)
        return cls(adds, np.where(free[:, None], np.hstack([elements.upper, -elements.lower]), -inf))

    def take(self, order: Ints) -> Sized:
        """Return selected entries in the given order."""
        return Sized({key: values[order] for key, values in self.adds.items()}, self.corner[order])

    def joined(self, name: Ints, count: int) -> Sized:
        """Return the sizes of sets of entries.

        name: (n,) set of each entry. count: number of sets.
        """
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
            """Return the sizes (r,) by a measure."""
            if measure.key in self.adds:
                return np.asarray(self.adds[measure.key] @ members)
            return _longest(np.array([np.where(members, side[:, None], -inf).max(axis=0) for side in self.corner.T]))

        return size

    def one(self, members: Iterable[int]) -> SizeOf:
        """Return a function that gives the size of one set."""
        rows = sorted(members)

        def size(measure: Measure) -> Floats:
            """Return the size by a measure."""
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
    """Compute the sizes of all blocks of labellings by several measures.

    assembly: structure with n elements. blocks: (k, n) block of each element, from `blocks_of`. measures: measures to
    compute. Result: sizes by the key of the measure, at the column of each block's name, scene units. Columns that name
    no block with a free element are zero.
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
