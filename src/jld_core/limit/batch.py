"""Batch solver for many labellings of one assembly.

`LimitAnalysis` proves the labellings that it leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.batch.batch_solver import FALLS, LOCKED, SAMPLES_OF_A_CALL, BatchResults, BatchSolver
from jld_core.batch.rows import BatchRows, rows_of_samples
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.bounds import crossed
from jld_core.limit.options import Status
from jld_core.mechanics import FrictionSet, yield_set
from jld_core.mechanics.standard import scaled_strengths
from jld_core.program import Template
from jld_core.strengths import CRITERIA, STANDARD, Route, Strengths

_ROUTE: Final = Route("bounds without crushing", STANDARD | CRITERIA)


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
        """Return the status of one labelling; None where the batch solver left it open."""
        if not self.settled[position]:
            return None
        if self.falls[position]:
            return Status.UNSTABLE
        return Status.LOCKED if self.locked[position] else Status.COLLAPSE


_MOST = 0.8  # share of settled trial labellings from which the batch solver settles most


class BatchAnalysis:
    """Batch solver of one limit analysis, safe for concurrent use by several threads.

    checked: the batch solver knows larger yield sets, so that its states are to be checked. load: λ, scene units, per
    scaled λ.
    """

    def __init__(self, analysis: LimitAnalysis, batch: BatchSolver, *, checked: bool = False) -> None:
        self._prover = analysis.prover if checked else None
        self._gap, self._load_scale = analysis.gap, analysis.load_scale
        self.load = analysis.template.scaling.load
        self.batch = batch

    @classmethod
    def of(cls, analysis: LimitAnalysis) -> BatchAnalysis | None:
        # Inner faces in space that may crush take the solver of faces that do not: its upper bounds hold, and its
        # states where they are admissible.
        if analysis.batch is not None:
            return cls(analysis, analysis.batch)
        relaxed = _without_inner_crushing(analysis)
        return None if relaxed is None else cls(analysis, relaxed, checked=True)

    @property
    def settles_most(self) -> bool:
        """Return True if the batch solver settled at least 80 % of its trial labellings."""
        return self.batch.settled_fraction >= _MOST

    def prove(self, labellings: Bits) -> BatchBounds:
        """Compute scaled bounds for labellings (k, m), settled where `LimitAnalysis.status_of` would agree."""
        results = self.batch.solve(labellings, vectors=self._prover is not None)
        low, high = results.low, results.high
        falls, locked = results.verdict == FALLS, results.verdict == LOCKED
        if self._prover is not None and results.forces is not None:
            locked[:] = False  # what crushes may have a finite λ
            for k, labels in enumerate(labellings):
                if np.isfinite(low[k]):
                    state = self._prover.state(np.append(results.forces[k], low[k]), labels)
                    low[k] = state.load if state.admissible else -np.inf
        return self.judged(low, high, np.where(locked, LOCKED, np.where(falls, FALLS, 0)))

    def judged(self, low: Floats, high: Floats, verdict: Ints) -> BatchBounds:
        """Judge scaled bounds (k,): settled if narrow, falling or locked."""
        falls, locked = verdict == FALLS, verdict == LOCKED
        size = np.maximum(abs(low), abs(high))
        with np.errstate(invalid="ignore"):
            # Require a width relative to λ itself. A bracket that contains zero is compared with the load scale
            # instead.
            contains_zero = (low <= 0.0) & (high >= 0.0)
            narrow = high - low <= self._gap * np.where(contains_zero, np.maximum(size, self._load_scale), size)
            sound = np.isfinite(low) & np.isfinite(high) & ~np.asarray(crossed(low, high))
        settled = falls | (narrow & sound & ~locked)
        # An upper bound below zero by more than rounding proves instability. One below zero by less than that is left
        # open.
        barely_negative = ~falls & (high < 0.0)
        settled = (settled & ~barely_negative) | locked
        low, high = np.minimum(low, high), np.maximum(low, high)
        low[falls] = high[falls | locked] = np.nan
        return BatchBounds(settled, falls, locked, low, high)


def _without_inner_crushing(analysis: LimitAnalysis) -> BatchSolver | None:
    """Make the batch solver of the same programs with inner faces that never crush; None where none crushes."""
    # Where blocks are far from crushing, forces of the larger yield sets lie in the smaller ones too.
    assembly, template = analysis.assembly, analysis.template
    if assembly.dimension == 2 or analysis.options.solver != "auto" or assembly.members.ends is None:
        return None
    strengths = assembly.strengths(_ROUTE)
    if not np.isfinite(strengths.crush_inner).any() or np.isfinite(strengths.crush_dry).any():
        return None
    relaxed = assembly.with_strengths(replace(strengths, crush_inner=np.full(len(assembly.interfaces), np.inf)))
    sets = yield_set(relaxed, template.scaling, analysis.options.inner_bending)
    return analysis.with_template(Template(relaxed, template.scaling, sets), analysis.reference).batch


_SAMPLE_ROUTE = Route("samples of strengths", STANDARD | CRITERIA)


class SampleAnalysis:
    """Batch solver of one labelling for samples of strengths and loads, safe for concurrent use by several threads.

    Parameters
    ----------
    analysis : LimitAnalysis
        Analysis of the structure at usual values, from which scaling and starting point are taken.
    labels : (m,) bool array
        Labels, True = dry.

    Attributes
    ----------
    analysis : LimitAnalysis
        As given.
    batched : bool
        True if the batch solver takes the samples; without it nothing else may be called.
    """

    def __init__(self, analysis: LimitAnalysis, labels: Bits) -> None:
        self.analysis, self._labels = analysis, labels
        self._assembly = analysis.assembly
        criteria = self._assembly.face_strengths.criteria
        self._rows_of_one = None if criteria else self._rows(self._assembly.strengths(_SAMPLE_ROUTE), 1)
        self.batched = analysis.batch is not None and self._rows_of_one is not None

    @cached_property
    def _stacked(self) -> FrictionSet:
        """Yield sets of the faces of all samples of a call, to receive their strengths."""
        faces = np.tile(np.arange(len(self._labels)), SAMPLES_OF_A_CALL)
        repeated = replace(
            self._assembly,
            interfaces=self._assembly.interfaces.take(faces),
            face_strengths=self._assembly.face_strengths.take(faces),
        )
        return yield_set(repeated, self.analysis.template.scaling).associative

    def _rows(self, strengths: Strengths, count: int) -> BatchRows | None:
        """Return the yield rows of one sample, or of those of a whole call."""
        template = self.analysis.template
        unit = self._assembly.interfaces.area / template.scaling.force
        sets = self._stacked if count > 1 else template.yield_set.associative
        scaled = scaled_strengths(strengths, np.tile(unit, count))
        return rows_of_samples(sets.with_strengths(scaled), np.tile(self._labels, (count, 1)), self._assembly.dimension)

    def solve(
        self,
        strengths: Strengths | None,
        dead: Floats,
        live: Floats,
        thresholds: Floats | None = None,
        *,
        vectors: bool = False,
    ) -> BatchResults:
        """Compute bounds for k samples.

        Parameters
        ----------
        strengths : Strengths or None
            Strengths (k·m,) of all faces of the first sample, then of the next; None: those of the structure.
        dead, live : (k, n, q) array
            Loads about centroids, scene units.
        thresholds : (k,) array, optional
            Scaled λ; iterations end once it is known to be exceeded.
        vectors : bool
            Return the velocities of the upper bounds as well.

        Returns
        -------
        BatchResults
            Scaled bounds and verdicts.
        """
        count, m, samples_of_call = len(dead), len(self._labels), SAMPLES_OF_A_CALL
        assert self.analysis.batch is not None
        free, scaling = self._assembly.elements.free, self.analysis.template.scaling
        dead, live = (load[:, free].reshape(count, -1) / scaling.row.ravel() for load in (dead, live))
        results = []
        for start in range(0, count, samples_of_call):
            # a call takes a whole number of samples: the last one is repeated
            samples = np.minimum(np.arange(start, start + samples_of_call), count - 1)
            if strengths is None:
                rows = self._repeated
            else:
                rows = self._rows(strengths.take((samples[:, None] * m + np.arange(m)).ravel()), samples_of_call)
            assert rows is not None
            needed_loads = None if thresholds is None else thresholds[samples]
            bounds = self.analysis.batch.solve_samples(
                rows, dead[samples], scaling.load * live[samples], needed_loads, vectors=vectors
            )
            results.append(bounds.take(slice(0, min(samples_of_call, count - start))))
        return BatchResults.joined(results)

    @cached_property
    def _repeated(self) -> BatchRows | None:
        # the rows of one sample, once for each sample of a call
        rows = self._rows_of_one
        if rows is None:
            return None
        repeated: dict[str, Any] = {}
        for name in ("rows", "keep", "parabolas"):
            array = getattr(rows, name)
            repeated[name] = None if array is None else np.repeat(array, SAMPLES_OF_A_CALL, axis=0)
        return replace(rows, **repeated)

    def bounds(self, found: BatchResults) -> BatchBounds:
        """Judge bounds as those of a labelling are judged.

        Parameters
        ----------
        found : BatchResults
            Bounds of samples without thresholds.

        Returns
        -------
        BatchBounds
            Scaled bounds and statuses.
        """
        batch = BatchAnalysis.of(self.analysis)
        assert batch is not None
        return batch.judged(found.low.copy(), found.high.copy(), found.verdict.astype(np.int64))
