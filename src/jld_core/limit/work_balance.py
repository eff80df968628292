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
    """Work balances λ · work ≤ total of k mechanisms, for all labellings that agree where decided."""

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
    def __init__(self, template: Template, prover: Prover, repair: Repair) -> None:
        self.template, self._prover, self._repair = template, prover, repair

    def balance(self, velocities: Floats, labels: Bits, undecided: Bools, *, known: bool = False) -> WorkBalance:
        """Compute the work balances of k mechanisms; undecided faces dissipate the larger value of both labels."""
        # Margins that only rounding violates are opened: under either label of all faces, as decided faces may become
        # undecided; or where the label occurs, if the mechanisms are `known` from an earlier balance, which leaves them
        # as they are.
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
        """Compute margins, or dissipation, of scaled jumps (k, m, q): (2, k, m), all dry, then all inner."""
        sets, faces = self.template.yield_set, jumps.shape[1]
        measure = sets.margin if margins else sets.dissipation
        every = np.ones(faces, dtype=bool)
        if self.template.assembly.dimension == 2:
            return np.array([measure(jumps, every), measure(jumps, ~every)])
        each = [[measure(one, labels) for one in jumps] for labels in (every, ~every)]
        return np.array(each).reshape(2, *jumps.shape[:2])

    def _opened(self, velocities: Floats, matters: Bools | np.bool) -> tuple[Floats, Floats, Floats]:
        """Add an opening motion where margins `matters` (2, k, m) are negative by rounding alone."""
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


@dataclass(frozen=True)
class DualBound:
    """Mechanism whose work balance refutes a λ for every labelling that agrees on the decided faces."""

    excess: float  # threshold · b_λ·u + b·u − Σ D, scaled, rounding deducted; positive (docs/method.md (6.4))
    cost: Floats  # (m,) reduction of the excess if a face becomes undecided, scaled; inf where no bound remains
    # λ that no such labelling exceeds, scaled; −inf where none is admissible at any λ. In the unit of the governing
    # factor if it comes from `CaseRelaxation`.
    bound: float
    velocity: Floats  # (q·free,) the mechanism, scaled
    case: int = 0  # index of the load case of the mechanism


@dataclass(frozen=True)
class MinimizedConflict:
    """Result of minimising the conflict of a labelling, or of one of its neighbours."""

    labelling: int  # index of the requested labelling
    drawn: bool  # True for the labelling itself, False for a neighbour
    decided: Bools  # (m,) faces whose labels are part of the conflict
    # scaled λ that no labelling with these labels exceeds; −inf where none is admissible at any λ. None where nothing
    # refuted it. In the unit of the governing factor if it comes from `CaseRelaxation`.
    bound: float | None
    carries: bool = False  # True if the forces found carry more than the threshold
    velocity: Floats | None = None  # (q·free,) mechanism that refuted the labelling, scaled
    case: int = 0  # index of the load case of the mechanism
