"""Round numbers to significant digits, in the form of JSON."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np

from jld_core.arrays import Floats

PLACES: Final = 9
"""Significant digits of coordinates and load factors."""
DIGITS: Final = 6
"""Significant digits of forces, velocities and utilisations."""


def rounded(values: Any, digits: int = PLACES) -> Any:
    """Round numbers to significant digits and return them in the form of JSON.

    values: a number or an array of any shape. The result is a number or nested lists; NaN and infinities become None.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim == 0:
        return float(f"{array:.{digits}g}") if np.isfinite(array) else None
    with np.errstate(divide="ignore", invalid="ignore"):
        power = np.where((array == 0.0) | ~np.isfinite(array), 0.0, np.floor(np.log10(abs(array))))
    clean = abs(power) < 280
    factor = 10.0 ** np.where(clean, digits - 1 - power, 0.0)
    # Division by a power of ten gives the double nearest to the decimal number, which prints short.
    shift = 10.0 ** np.where(clean, np.abs(digits - 1 - power), 0.0)
    whole = np.round(np.where(digits - 1 - power >= 0, array * shift, array / shift))
    short = np.where(digits - 1 - power >= 0, whole / shift, whole * shift)
    return _plain(np.where(clean & np.isfinite(factor), short, array))


def rounded_each(arrays: Sequence[Floats]) -> list[Any]:
    """Return arrays (k, d) as `rounded` does; all are rounded together, to save time."""
    if not len(arrays):
        return []
    rows, cuts = rounded(np.concatenate(arrays)), np.cumsum([0, *map(len, arrays)]).tolist()
    return [rows[start:end] for start, end in pairwise(cuts)]


def _plain(array: Floats) -> Any:
    """Return an array as nested lists, with None for values that are not finite."""
    if np.all(np.isfinite(array)):
        return array.tolist()
    if array.ndim > 1:
        return [_plain(row) for row in array]
    return [float(v) if np.isfinite(v) else None for v in array]
