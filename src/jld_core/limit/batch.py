"""Many labellings of one assembly at once, where the batch solver can: what it leaves open is for `LimitAnalysis`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.batch import FALLS, LOCKED, BatchSolver
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.bounds import crossed
from jld_core.limit.status import Status


@dataclass(frozen=True)
class BatchAnswers:
    """What is settled of k labellings: settled, falls, locked (k,), and bounds (k,) on scaled λ.

    Bounds are NaN where a labelling falls, and the upper one where it is locked.
    """

    settled: Bools
    falls: Bools
    locked: Bools
    low: Floats
    high: Floats

    def status(self, position: int) -> Status | None:
        """Of one labelling; None where it is left open."""
        if not self.settled[position]:
            return None
        if self.falls[position]:
            return Status.UNSTABLE
        return Status.LOCKED if self.locked[position] else Status.COLLAPSE


class Batch:
    """The batch solver for one limit analysis, for any number of threads at once. lanes: the batch solver itself. load:
    λ in scene
    units for each scaled one."""

    def __init__(self, analysis: LimitAnalysis, batch: BatchSolver) -> None:
        self._gap, self._floor = analysis.gap, analysis.floor
        self.load = analysis.template.scaling.load
        self.batch = batch

    @classmethod
    def of(cls, analysis: LimitAnalysis) -> Batch | None:
        """For analyses whose rows have the batch solver's shape, where there is a batch solver; else None."""
        return None if analysis.batch is None else cls(analysis, analysis.batch)

    @property
    def worthwhile(self) -> bool:
        """Does the batch solver settle most labellings here?"""
        return self.batch.settles >= 0.8

    def prove(self, labellings: Bits) -> BatchAnswers:
        """Bounds of labellings (k, m), True dry; what stands as settled is what `LimitAnalysis.judge` would settle."""
        found = self.batch.solve(labellings)
        low, high = found.low, found.high
        falls, locked = found.verdict == FALLS, found.verdict == LOCKED
        size = np.maximum(abs(low), abs(high))
        with np.errstate(invalid="ignore"):
            # beside λ itself, or beside the weight of the whole around zero: what is neither a vertex has to tell
            around = (low <= 0.0) & (high >= 0.0)
            narrow = high - low <= self._gap * np.where(around, np.maximum(size, self._floor), size)
            sound = np.isfinite(low) & np.isfinite(high) & ~np.asarray(crossed(low, high))
        settled = falls | (narrow & sound & ~locked)
        # an upper bound below zero by more than rounding is a fall; one within it is for others to tell
        edge = ~falls & (high < 0.0)
        settled = (settled & ~edge) | locked
        low, high = np.minimum(low, high), np.maximum(low, high)
        low[falls] = high[falls | locked] = np.nan
        return BatchAnswers(settled, falls, locked, low, high)
