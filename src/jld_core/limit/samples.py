"""Bounds on λ of one labelling under many samples of the strengths and loads of one structure."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.batch.batch_solver import SAMPLES_OF_A_CALL, BatchResults
from jld_core.batch.rows import BatchRows, rows_of_samples
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.batch import BatchAnalysis, BatchBounds
from jld_core.mechanics import FrictionSet, yield_set
from jld_core.mechanics.standard import scaled_strengths
from jld_core.strengths import CRITERIA, STANDARD, Route, Strengths

_ROUTE = Route("samples of strengths", STANDARD | CRITERIA)


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
        stated = self._assembly.face_strengths.criteria
        self._plain = None if stated else self._rows(self._assembly.strengths(_ROUTE), 1)
        self.batched = analysis.batch is not None and self._plain is not None

    @cached_property
    def _stacked(self) -> FrictionSet:
        """Yield sets of the faces of all samples of a call, to receive their strengths."""
        faces = np.tile(np.arange(len(self._labels)), SAMPLES_OF_A_CALL)
        many = replace(
            self._assembly,
            interfaces=self._assembly.interfaces.take(faces),
            face_strengths=self._assembly.face_strengths.take(faces),
        )
        return yield_set(many, self.analysis.template.scaling).associative

    def _rows(self, strengths: Strengths, count: int) -> BatchRows | None:
        """Return the yield rows of one sample, or of those of a whole call."""
        template = self.analysis.template
        unit = self._assembly.interfaces.area / template.scaling.force
        own = self._stacked if count > 1 else template.yield_set.associative
        scaled = scaled_strengths(strengths, np.tile(unit, count))
        return rows_of_samples(own.with_strengths(scaled), np.tile(self._labels, (count, 1)), self._assembly.dimension)

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
        count, m, size = len(dead), len(self._labels), SAMPLES_OF_A_CALL
        assert self.analysis.batch is not None
        free, scaling = self._assembly.elements.free, self.analysis.template.scaling
        dead, live = (load[:, free].reshape(count, -1) / scaling.row.ravel() for load in (dead, live))
        parts = []
        for start in range(0, count, size):
            # a call takes a whole number of samples: the last one is repeated
            own = np.minimum(np.arange(start, start + size), count - 1)
            if strengths is None:
                rows = self._repeated
            else:
                rows = self._rows(strengths.take((own[:, None] * m + np.arange(m)).ravel()), size)
            assert rows is not None
            least = None if thresholds is None else thresholds[own]
            found = self.analysis.batch.solve_samples(rows, dead[own], scaling.load * live[own], least, vectors=vectors)
            parts.append(found.take(slice(0, min(size, count - start))))
        return BatchResults.joined(parts)

    @cached_property
    def _repeated(self) -> BatchRows | None:
        """Return the rows of the structure for all samples of a call."""
        rows = self._plain
        if rows is None:
            return None
        arrays = {one: getattr(rows, one) for one in ("rows", "keep", "parabolas")}
        size = SAMPLES_OF_A_CALL
        many: dict[str, Any] = {k: None if one is None else np.repeat(one, size, axis=0) for k, one in arrays.items()}
        return replace(rows, **many)

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
