"""Random variables of a scene, and their transformation to standard normal ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats

_FARTHEST: Final = 1e3  # largest size of a standard normal variable

_FACTOR: Final = 12.0  # natural logarithm of the largest factor on the median of a lognormal value


@dataclass(frozen=True)
class Variables:
    """Independent normal and lognormal random variables.

    names: key of each in the scene, with the face or element where each has its own. mean, deviation: (v,) means and
    standard deviations, in the units of the scene. lognormal: (v,) True where |x| is lognormal, else x is normal.

    docs/method.md (12.1), (12.2): a normal variable is x = m + s u, a lognormal one |x| = exp(ν + ζ u) with ζ² = ln(1 +
    s²/m²) and ν = ln |m| − ζ²/2.
    """

    names: tuple[str, ...]
    mean: Floats
    deviation: Floats
    lognormal: Bools

    def __len__(self) -> int:
        return len(self.names)

    def _spread(self) -> Floats:
        """Return ζ of the lognormal variables (v,), with the formula also for the others."""
        return np.sqrt(np.log1p((self.deviation / self.mean) ** 2))

    @property
    def reach(self) -> Floats:
        """Return the largest sizes (v,) of standard normal variables at which values are computed."""
        return np.where(self.lognormal, np.minimum(_FARTHEST, _FACTOR / self._spread()), _FARTHEST)

    def values(self, normal: Floats) -> Floats:
        """Return the values (..., v) that belong to independent standard normal ones (..., v)."""
        spread = self._spread()
        with np.errstate(over="ignore"):
            scaled = self.mean * np.exp(spread * normal - 0.5 * spread * spread)
        return np.where(self.lognormal, scaled, self.mean + self.deviation * normal)

    def slopes(self, normal: Floats) -> Floats:
        """Return the derivatives (..., v) of `values` by the standard normal variables."""
        return np.where(self.lognormal, self._spread() * self.values(normal), self.deviation)
