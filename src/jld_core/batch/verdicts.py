"""Verdicts of the batch solver, and its proven bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Floats
from jld_core.batch import interface

_VERDICTS: Final = interface.codes("JldVerdict")

OPEN: Final = _VERDICTS["OPEN"]
"""Verdict: nothing proven yet."""

PROVEN: Final = _VERDICTS["PROVEN"]
"""Verdict: both bounds are proven and the bracket is narrow."""

FALLS: Final = _VERDICTS["FALLS"]
"""Verdict: no λ ≥ 0 is admissible."""

CARRIES: Final = _VERDICTS["CARRIES"]
"""Verdict: λ is above its threshold."""

LOCKED: Final = _VERDICTS["LOCKED"]
"""Verdict: λ is unbounded."""


@dataclass(frozen=True)
class BatchResults:
    """Proven bounds on λ of k labellings, scaled.

    low, high: (k,) lower and upper bound on λ; infinite where there is none. verdict: (k,) `OPEN`; `PROVEN` (both
    bounds, a narrow bracket); `FALLS` (no λ ≥ 0 is admissible); `CARRIES` (λ above its threshold); or `LOCKED` (λ is
    unbounded, proven by an admissible state and a ray). iterations: (k,) iterations of all passes. tries: (k,) number
    of passes. forces: (k, m, q) forces of the lower bound; only with `vectors=True`, as all that follow. velocity: (k,
    q·free) velocities of the upper bound, in the order of the elements. diagnosis: (k, 4) slack, equilibrium error,
    margin of the jumps (before the opening motion is added) and gap at the last pass. rays: (k, m, q) rays of `LOCKED`
    labellings, for λ = 1.
    """

    low: Floats
    high: Floats
    verdict: NDArray[np.int32]
    iterations: NDArray[np.int32]
    tries: NDArray[np.int32]
    forces: Floats | None = None
    velocity: Floats | None = None
    diagnosis: Floats | None = None
    rays: Floats | None = None

    @property
    def velocities(self) -> Floats:
        """Return the velocities (k, q·free) of the upper bounds.

        Raises ValueError if the results were computed without `vectors=True`.
        """
        if self.velocity is None:
            raise ValueError("the batch solver was asked for no velocities; solve with `vectors=True`")
        return self.velocity
