"""Matrices of binary fractions of any length: sums and products without rounding."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core.arrays import Floats

BITS: Final = 70
"""Number of binary places to which numbers are rounded."""


@dataclass(frozen=True)
class BinaryFractions:
    """Matrix of binary fractions of any length, for sums and products without rounding.

    The operators +, − and @ are exact.

    values: (r, c) integers of any length. scale: each entry is its integer divided by 2^scale.
    """

    values: Any
    scale: int

    @staticmethod
    def of(table: Floats) -> BinaryFractions:
        """Convert a matrix of finite doubles to binary fractions, exactly.

        table: (r, c) doubles.
        """
        part, power = np.frexp(table)
        used = table != 0.0
        least = int(power[used].min(initial=0))
        digits = np.ldexp(part, 53).astype(np.int64).astype(object)
        return BinaryFractions(digits << np.where(used, power - least, 0).astype(object), 53 - least)

    def transposed(self) -> BinaryFractions:
        """Return the transposed matrix."""
        return BinaryFractions(self.values.T, self.scale)

    def rows(self, chosen: Any) -> BinaryFractions:
        """Return the matrix of the chosen rows, given by indices, a mask or a slice."""
        return BinaryFractions(self.values[chosen], self.scale)

    def times(self, factor: float) -> BinaryFractions:
        """Multiply every entry by the double `factor`, exactly."""
        by = BinaryFractions.of(np.array([[factor]]))
        return BinaryFractions(self.values * by.values[0, 0], self.scale + by.scale)

    def __add__(self, other: BinaryFractions) -> BinaryFractions:
        """Add two matrices exactly."""
        scale = max(self.scale, other.scale)
        one, two = self.values << (scale - self.scale), other.values << (scale - other.scale)
        return BinaryFractions(one + two, scale)

    def __sub__(self, other: BinaryFractions) -> BinaryFractions:
        """Subtract two matrices exactly."""
        return self + BinaryFractions(-other.values, other.scale)

    def __matmul__(self, other: BinaryFractions) -> BinaryFractions:
        """Multiply two matrices exactly, skipping zero entries."""
        out = np.zeros((self.values.shape[0], other.values.shape[1]), dtype=object)
        columns = [np.flatnonzero(row) for row in other.values]
        held = [row[at] for row, at in zip(other.values, columns, strict=True)]
        for i, k in zip(*np.nonzero(self.values), strict=True):
            out[i, columns[k]] += self.values[i, k] * held[k]
        return BinaryFractions(out, self.scale + other.scale)

    def floats(self) -> Floats:
        """Convert the entries to doubles, correct to about 15 digits."""
        drop = max(self.scale - 300, 0)
        doubles = [
            math.ldexp(float(v >> drop if v >= 0 else -(-v >> drop)), drop - self.scale) for v in self.values.flat
        ]
        # A matrix without rows keeps its number of columns: structures without loops have such matrices.
        return np.array(doubles, dtype=float).reshape(self.values.shape)


def round_to_bits(table: Floats, bits: int = BITS) -> Floats:
    """Return an array of doubles rounded to multiples of 2^−bits.

    table: doubles of any shape. Sums of such numbers need few digits as binary fractions.
    """
    return np.asarray(np.ldexp(np.rint(np.ldexp(table, bits)), -bits))
