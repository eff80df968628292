"""Array types by element type, for modules that do not import `Assembly`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
"""Array of float64."""


Ints = NDArray[np.int64]
"""Array of int64."""


Bools = NDArray[np.bool_]
"""Array of bool."""


# Labels of all interfaces, shape (m,), in the order of the assembly: True = dry, False = inner.
Bits = NDArray[np.bool_]
