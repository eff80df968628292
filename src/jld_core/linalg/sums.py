"""Sums whose rounding errors count as zero."""

from __future__ import annotations

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats


def summed(*parts: Floats) -> Floats:
    """Add arrays of one shape; entries that cancel up to rounding become exactly zero."""
    return without_rounding(np.sum(parts, axis=0), np.sum(np.abs(parts), axis=0))


def without_rounding(total: Floats, gross: Floats) -> Floats:
    """Return sums with zero in place of those that are rounding of the summed magnitudes of their terms."""
    return np.where(abs(total) <= tolerances.ROUNDING * gross, 0.0, total)
