"""Define the interface of the operators on labellings."""

from __future__ import annotations

from typing import Protocol

from jld_core.arrays import Bits, Ints
from jld_explore.drivers.operators.atom_graph import BufferedRandom


class Operators(Protocol):
    """Interface of the operators on labellings: draw, change and cross them.

    Labellings are rows (k, m), True = dry. Results (j, m) hold at most one row per requested one: those are left out
    that cannot be made to keep the limits. They may be neither canonical nor new.

    keys: number of keys that `read` takes. offspring_factor: number of children to make for each evaluated one.
    always_feasible: whether every row is feasible without a check.
    """

    keys: int
    """Number of keys that `read` takes."""

    offspring_factor: int
    """Number of children that are cheap enough to make for each evaluated one."""

    always_feasible: bool
    """True if every row is feasible, because the operators keep all limits of the space."""

    def draw(self, count: int, rng: BufferedRandom) -> Bits:
        """Draw random labellings, at most `count`."""

    def vary(self, parents: Bits, rng: BufferedRandom) -> Bits:
        """Return one child of each parent (k, m), which differs by a small change."""

    def cross(self, first: Bits, second: Bits, rng: BufferedRandom) -> Bits:
        """Return one child of each couple of `first` and `second` (k, m)."""

    def cross_indexed(self, first: Bits, second: Bits, rng: BufferedRandom) -> tuple[Bits, Ints]:
        """Return one child of each couple where one is found.

        first, second: (k, m) parents of each couple. rng: source of random numbers. Result: (j, m) children; (j,)
        couple of each child.
        """

    def breed(self, first: Bits, second: Bits, single: Bits, rng: BufferedRandom) -> Bits:
        """Return one child of each couple, then one change of each single parent.

        first, second: (k, m) parents of the couples. single: (i, m) single parents. Both are made in one batch where
        possible.
        """

    def read(self, keys: list[float]) -> Bits:
        """Convert keys in [0, 1] to a labelling (1, m), or (0, m) if none is found.

        The same keys always give the same labelling.
        """

    def write(self, labelling: Bits) -> list[float]:
        """Return keys of a labelling (m,), from which `read` makes the same labelling again."""
