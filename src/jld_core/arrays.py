"""numpy's arrays by their elements, so that linear algebra and geometry know no Assembly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


Ints = NDArray[np.int64]


Bools = NDArray[np.bool_]


Bits = NDArray[np.bool_]
"""Labels of all interfaces, shape (m,), in the order of the assembly: True is dry, False is inner."""
