"""Array types by element type, and sums of arrays, for modules that do not import `Assembly`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jld_core import tolerances

Floats = NDArray[np.float64]
"""Array of float64."""


Ints = NDArray[np.int64]
"""Array of int64."""


Bools = NDArray[np.bool_]
"""Array of bool."""


Bits = NDArray[np.bool_]
"""Labels of all interfaces, shape (m,), in the order of the assembly: True = dry, False = inner."""


def summed(*parts: Floats) -> Floats:
    """Add arrays of one shape; entries that cancel up to rounding become exactly zero."""
    return without_rounding(np.sum(parts, axis=0), np.sum(np.abs(parts), axis=0))


def without_rounding(total: Floats, gross: Floats) -> Floats:
    """Return sums with zero in place of those that are rounding of the summed magnitudes of their terms."""
    return np.where(abs(total) <= tolerances.ROUNDING * gross, 0.0, total)
