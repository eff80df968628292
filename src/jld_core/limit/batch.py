"""Batch solver for many labellings of one assembly.

`LimitAnalysis` proves the labellings that it leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.batch.batch_solver import FALLS, LOCKED, BatchSolver
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.bounds import crossed
from jld_core.limit.options import Status


@dataclass(frozen=True)
class BatchBounds:
    """Bounds and statuses that the batch solver settled for k labellings."""

    settled: Bools  # (k,) True where `status` is conclusive
    falls: Bools  # (k,) True where no λ ≥ 0 is admissible (unstable)
    locked: Bools  # (k,) True where λ is unbounded
    # low, high: (k,) bounds on λ, scaled. Both are NaN where a labelling is unstable; the upper bound is NaN where it
    # is locked.
    low: Floats
    high: Floats

    def status(self, position: int) -> Status | None:
        """Return the status of one labelling.

        Result: status; None where the batch solver left it open.
        """
        if not self.settled[position]:
            return None
        if self.falls[position]:
            return Status.UNSTABLE
        return Status.LOCKED if self.locked[position] else Status.COLLAPSE


class BatchAnalysis:
    """Batch solver of one limit analysis, safe for concurrent use by several threads.

    Parameters
    ----------
    analysis : LimitAnalysis
        Supplies the tolerances and the scaling.
    batch : BatchSolver
        The compiled batch solver.

    Attributes
    ----------
    load : float
        λ in scene units per scaled λ.
    batch : BatchSolver
        The compiled batch solver.
    """

    def __init__(self, analysis: LimitAnalysis, batch: BatchSolver) -> None:
        self._gap, self._load_scale = analysis.gap, analysis.load_scale
        self.load = analysis.template.scaling.load
        self.batch = batch

    @classmethod
    def of(cls, analysis: LimitAnalysis) -> BatchAnalysis | None:
        """Create the batch solver of an analysis.

        Parameters
        ----------
        analysis : LimitAnalysis
            Analysis of the assembly.

        Returns
        -------
        BatchAnalysis or None
            Batch solver; None where the analysis has none, see `LimitAnalysis.batch`.
        """
        return None if analysis.batch is None else cls(analysis, analysis.batch)

    @property
    def settles_most(self) -> bool:
        """Return True if the batch solver settled at least 80 % of its trial labellings."""
        return self.batch.settled_fraction >= 0.8

    def prove(self, labellings: Bits) -> BatchBounds:
        """Compute bounds for many labellings.

        A labelling counts as settled only where `LimitAnalysis.status_of` would reach the same status.

        Parameters
        ----------
        labellings : (k, m) bool array
            Labels, True = dry.

        Returns
        -------
        BatchBounds
            Scaled bounds and statuses.
        """
        found = self.batch.solve(labellings)
        low, high = found.low, found.high
        falls, locked = found.verdict == FALLS, found.verdict == LOCKED
        size = np.maximum(abs(low), abs(high))
        with np.errstate(invalid="ignore"):
            # Require a width relative to λ itself. A bracket that contains zero is compared with the load scale
            # instead.
            around = (low <= 0.0) & (high >= 0.0)
            narrow = high - low <= self._gap * np.where(around, np.maximum(size, self._load_scale), size)
            sound = np.isfinite(low) & np.isfinite(high) & ~np.asarray(crossed(low, high))
        settled = falls | (narrow & sound & ~locked)
        # An upper bound below zero by more than rounding proves instability. One below zero by less than that is left
        # open.
        edge = ~falls & (high < 0.0)
        settled = (settled & ~edge) | locked
        low, high = np.minimum(low, high), np.maximum(low, high)
        low[falls] = high[falls | locked] = np.nan
        return BatchBounds(settled, falls, locked, low, high)
