"""Work balances of mechanisms, for all labellings that agree on the decided faces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.limit.bounds import Prover
from jld_core.limit.repair import Repair
from jld_core.program import Template

# Violation of a margin, relative to the largest jump, up to which a small opening motion repairs it
_TINY: Final = 1e-6


@dataclass(frozen=True)
class WorkBalance:
    """Work balances of k mechanisms, each for one partial labelling: λ · work ≤ total.

    The inequality holds for every labelling that agrees with the partial one on its decided faces.
    """

    # (k, q·free) mechanisms, scaled: q velocities of each free element, with the opening motion that repairs rounding
    # errors
    velocities: Floats
    work: Floats  # (k,) work of the live load, scaled
    # (k,) dissipation minus work of the dead load, plus a bound on rounding errors, scaled; valid where `sound` is True
    total: Floats
    sound: Bools  # (k,) True where the dissipation is finite and the work not negative
    # own, either: (k, m) dissipation of each face, scaled, or inf. `either`: the larger of its dissipations under the
    # two labels. `own`: its dissipation under its own label; equal to `either` for undecided faces.
    own: Floats
    either: Floats


class WorkBalances:
    """Work balances of mechanisms of one template, with the support function of the hull.

    prover: measures jumps and rounding. repair: supplies the opening motion.
    """

    def __init__(self, template: Template, prover: Prover, repair: Repair) -> None:
        self.template, self._prover, self._repair = template, prover, repair

    def balance(self, velocities: Floats, labels: Bits, undecided: Bools, *, known: bool = False) -> WorkBalance:
        """Compute the work balances of k mechanisms, each for one partial labelling.

        velocities: (k, q·free) scaled. labels: (k, m) True = dry. undecided: (k, m) True for faces that may have either
        label, which dissipate the larger value of both. Margins that only rounding violates are repaired by an opening
        motion: under either label of all faces, as decided faces may become undecided, or only where the label occurs
        if the mechanisms are `known` from an earlier balance, which are thus left as they are.
        """
        matters = np.array([undecided | labels, undecided | ~labels]) if known else np.True_
        velocities, jumps, finite = self._opened(velocities, matters)
        dissipation = np.where(finite >= 0.0, self._measured(jumps, margins=False), np.inf)
        either = dissipation.max(axis=0)
        own = np.where(undecided, either, np.where(labels, dissipation[0], dissipation[1]))
        # Sum row by row: the rounding of a matrix product depends on the number of rows.
        powers = velocities * self.template.live
        work = powers.sum(axis=1)
        # A remainder of cancelling terms gives no bound.
        work[abs(work) < tolerances.ROUNDING * abs(powers).sum(axis=1)] = 0.0
        total = own.sum(axis=1) - (velocities * self.template.dead).sum(axis=1)
        sound = np.isfinite(total) & (work >= 0.0)
        total = np.where(sound, total, 0.0)
        total += self._prover.noises(velocities, total)
        return WorkBalance(velocities, work, total, sound, own, either)

    def _measured(self, jumps: Floats, *, margins: bool) -> Floats:
        """Compute the margins, or the dissipation, of scaled jumps (k, m, q) under both labels.

        margins: True for margins, False for dissipation. Returns (2, k, m): all faces dry, then all faces inner.
        """
        sets, faces = self.template.yield_set, jumps.shape[1]
        measure = sets.margin if margins else sets.dissipation
        every = np.ones(faces, dtype=bool)
        if self.template.assembly.dimension == 2:
            return np.array([measure(jumps, every), measure(jumps, ~every)])
        each = [[measure(one, labels) for one in jumps] for labels in (every, ~every)]
        return np.array(each).reshape(2, *jumps.shape[:2])

    def _opened(self, velocities: Floats, matters: Bools | np.bool) -> tuple[Floats, Floats, Floats]:
        """Add an opening motion to velocities whose margins are negative only by rounding.

        velocities: (k, q·free) scaled. matters: (2, k, m), margins to repair; True for all. Returns velocities, jumps
        (k, m, q) and margins (2, k, m) of dry and of inner faces. Without an opening motion nothing is added.
        """
        jumps = self._prover.jumps(velocities)
        finite = self._measured(jumps, margins=True)
        opening = self._repair.opening()
        reach = _TINY * np.maximum(abs(jumps).max(axis=(1, 2)), 1e-300)
        lacks = np.where(matters & (finite < 0.0) & (finite > -reach[None, :, None]), -finite, 0.0).max(axis=(0, 2))
        rows = np.flatnonzero(lacks > 0.0)
        if opening is None or not rows.size:
            return velocities, jumps, finite
        velocities = velocities.copy()
        velocities[rows] += (1.01 * lacks[rows] / opening.margin)[:, None] * opening.velocity
        jumps[rows] = self._prover.jumps(velocities[rows])
        finite[:, rows] = self._measured(jumps[rows], margins=True)
        return velocities, jumps, finite
