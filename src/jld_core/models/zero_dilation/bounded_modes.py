"""Complementarity problem with bounds on its forces and velocities, and regions of its solutions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jld_core.arrays import Bools, Floats
from jld_core.models.zero_dilation.modes import Modes
from jld_core.models.zero_dilation.statics import Statics, bound_velocities


@dataclass(frozen=True)
class Region:
    """Part of the solutions on which a bound is proven.

    low, high: ends of the interval of scaled λ. closed: (4m,) closed modes, with the rate z = 0. held: (4m,) held
    modes, with the yield slack y = 0.
    """

    low: float
    high: float
    closed: Bools
    held: Bools

    def split(self, rates: Floats, slacks: Floats) -> tuple[Region, Region] | None:
        """Split the region at the mode that most violates y z = 0; None if no mode violates it.

        The measure of a mode is min(z, 1) y. In the first part, the mode is closed. In the second part, it is held; if
        it is a slide, the other slide of its face is closed. rates, slacks: (4m,) mean z and mean y of a relaxation.
        """
        apart = np.where(self.closed | self.held, 0.0, np.minimum(rates, 1.0) * slacks)
        if not apart.max() > 0.0:
            return None
        mode = int(np.argmax(apart))
        number = np.arange(len(apart))
        one = number == mode
        other = (number == mode ^ 1) & (mode % 4 > 1)
        return replace(self, closed=self.closed | one), replace(self, closed=self.closed | other, held=self.held | one)


@dataclass(frozen=True)
class BoundedModes:
    """Complementarity problem of a planar labelling, with bounds that all its solutions keep.

    Every step of a lower-bound search takes this one description of the problem.

    modes: the complementarity problem. force_bounds: (3m + 2,) upper bounds on |F|, |λ| and 1, see
    `Statics.force_bounds`. velocity_bounds: (3n + m,) upper bounds on velocities and slides per unit of cost, see
    `bound_velocities`; None if not proven.
    """

    modes: Modes
    force_bounds: Floats
    velocity_bounds: Floats | None

    @classmethod
    def up_to(cls, modes: Modes, high: float) -> BoundedModes:
        """Compute the bounds for all solutions with 0 ≤ λ ≤ high.

        modes: the complementarity problem. high: scaled λ. Bounds that are not proven are inf, or None for velocities.
        """
        statics = Statics(modes, 0.0, high, np.zeros(len(modes.rows), dtype=bool))
        return cls(modes, statics.force_bounds, bound_velocities(statics))

    def region(self, low: float, high: float, closed: Bools, held: Bools) -> Region:
        """Return the region of solutions with low ≤ λ ≤ high and given closed and held modes.

        Modes that are proven not to move in it are closed as well. low, high: scaled λ. closed, held: (4m,) modes with
        z = 0, and with y = 0.
        """
        statics = Statics(self.modes, low, high, held, self.force_bounds)
        return Region(low, high, closed | statics.closed_modes(), held)
