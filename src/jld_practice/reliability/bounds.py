"""Proven bounds on the governing load factor of samples, by the batch solver."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.batch.batch_solver import FALLS, LOCKED, SAMPLES_OF_A_CALL, BatchSolver
from jld_core.batch.rows import BatchRows, rows_of_samples
from jld_core.limit import LimitAnalysis, Proof, SolveOptions, Status
from jld_core.limit.bounds import crossed
from jld_core.mechanics import require_materials, yield_set
from jld_core.mechanics.standard import scaled_strengths
from jld_core.mechanics.yield_set import FrictionSet
from jld_core.models import limit_analysis, solve_labelling
from jld_core.threads import one_thread
from jld_practice.reliability.structure import RandomStructure

_OPTIONS = SolveOptions()  # model of all samples: associative friction, convex contact


@dataclass(frozen=True)
class GoverningBounds:
    """Bounds on the governing factor of k samples: least λ / required of all load cases."""

    # low, high: (k,) proven bounds. Both are −inf where no λ ≥ 0 is admissible, +inf where λ is unbounded; the upper
    # one is +inf where the lower one is known to suffice.
    low: Floats
    high: Floats

    def fails(self, required: float) -> Bools:
        """Return a mask (k,) of samples that surely carry less than `required`."""
        return np.asarray(self.high < required)

    def holds(self, required: float) -> Bools:
        """Return a mask (k,) of samples that surely carry at least `required`."""
        return np.asarray(self.low >= required)


class SampleBounds:
    """Bounds on the governing load factor of samples of one layout.

    It may be used by several threads at once.

    structure: structure as it depends on its random variables. labels: (m,) layout, True = dry. Raises InputError: a
    material that the layout needs is missing.
    """

    def __init__(self, structure: RandomStructure, labels: Bits) -> None:
        require_materials(structure.assembly, labels, ~labels)
        self.structure, self.labels = structure, labels
        self.analyses = [limit_analysis(case, _OPTIONS, reference=labels) for case in structure.cases]
        self._plain = [self._rows(case, structure.variables.mean[None]) for case in range(len(self.analyses))]

    @property
    def batched(self) -> bool:
        """Return True if the batch solver takes the samples of all load cases."""
        return all(one.batch is not None for one in self.analyses) and None not in self._plain

    @cached_property
    def _stacked(self) -> FrictionSet:
        """Return yield sets of the faces of all samples of a call, to receive their strengths."""
        assembly, template = self.structure.assembly, self.analyses[0].template
        faces = np.tile(np.arange(len(self.labels)), SAMPLES_OF_A_CALL)
        many = replace(
            assembly, interfaces=assembly.interfaces.take(faces), face_strengths=assembly.face_strengths.take(faces)
        )
        return yield_set(many, template.scaling).associative

    def _rows(self, case: int, values: Floats) -> BatchRows | None:
        """Return the yield rows of samples under a load case.

        The rows of one sample are kept for all in `_plain`. values: (k, v), one sample or as many as a call takes.
        """
        assembly, template = self.structure.assembly, self.analyses[case].template
        count, unit = len(values), assembly.interfaces.area / template.scaling.force
        scaled = scaled_strengths(self.structure.strengths(values), np.tile(unit, count))
        own = self._stacked if count > 1 else template.yield_set.associative
        return rows_of_samples(own.with_strengths(scaled), np.tile(self.labels, (count, 1)), assembly.dimension)

    @one_thread()
    def of(self, values: Floats, required: float | None = None) -> GoverningBounds:
        """Compute bounds for samples.

        values: (k, v) of the variables.
        """
        if not self.batched:
            return self.proven(values)
        parts = [
            self._portion(values[k : k + SAMPLES_OF_A_CALL], required) for k in range(0, len(values), SAMPLES_OF_A_CALL)
        ]
        return GoverningBounds(*(np.concatenate([getattr(one, name) for one in parts]) for name in ("low", "high")))

    def _portion(self, values: Floats, required: float | None) -> GoverningBounds:
        """Compute bounds for at most as many samples as one call takes."""
        count = len(values)
        full = np.concatenate([values, np.repeat(values[-1:], SAMPLES_OF_A_CALL - count, axis=0)])
        low, high = np.full(len(full), np.inf), np.full(len(full), np.inf)
        for case in range(len(self.analyses)):
            least, most = self._of_case(case, full, required)
            low, high = np.minimum(low, least), np.minimum(high, most)
        return GoverningBounds(low[:count], high[:count])

    def _of_case(self, case: int, values: Floats, required: float | None) -> tuple[Floats, Floats]:
        """Return bounds (k,) on λ over the required one under a load case."""
        analysis = self.analyses[case]
        template, batch, asked = analysis.template, analysis.batch, float(self.structure.assembly.required[case])
        assert isinstance(batch, BatchSolver)
        plain = self._plain[case]
        rows = self._rows(case, values) if self.structure.varies_in_strength else _repeated(plain, len(values))
        assert rows is not None
        dead, live = self.structure.loads(values, case)
        free, scaling = self.structure.assembly.elements.free, template.scaling
        dead, live = (load[:, free].reshape(len(values), -1) / scaling.row.ravel() for load in (dead, live))
        enough = None if required is None else np.full(len(values), required * asked / scaling.load)
        found = batch.solve_samples(rows, dead, scaling.load * live, enough)
        low, high = found.low.copy(), found.high.copy()
        wrong = np.asarray(crossed(low, high)) | np.isnan(low) | np.isnan(high)
        low[wrong], high[wrong] = -np.inf, np.inf
        low[found.verdict == FALLS] = high[found.verdict == FALLS] = -np.inf
        low[found.verdict == LOCKED] = high[found.verdict == LOCKED] = np.inf
        share = scaling.load / asked
        return share * low, share * high

    def proven(self, values: Floats) -> GoverningBounds:
        """Compute bounds of single samples that the batch solver left open."""
        brackets = np.array([self._proven(one) for one in values]).reshape(-1, 2)
        return GoverningBounds(brackets[:, 0], brackets[:, 1])

    def _proven(self, values: Floats) -> tuple[float, float]:
        """Return the bounds on the governing factor of one sample (v,)."""
        low = high = math.inf
        for case, asked in enumerate(self.structure.assembly.required.tolist()):
            analysis, proof = self.solved(values, case)
            least, most = bracket_of(analysis, proof)
            low, high = min(low, least / asked), min(high, most / asked)
        return low, high

    def solved(self, values: Floats, case: int) -> tuple[LimitAnalysis, Proof]:
        """Solve a load case at values (v,) of the variables; return analysis and proof."""
        analysis = limit_analysis(
            self.structure.at(values, case), _OPTIONS, reference=self.labels, single_labelling=True
        )
        return analysis, solve_labelling(analysis, self.labels, _OPTIONS)


def _repeated(rows: BatchRows | None, count: int) -> BatchRows | None:
    """Return rows of one sample for `count` samples."""
    if rows is None:
        return None
    many = {name: getattr(rows, name) for name in ("rows", "keep", "parabolas")}
    many = {name: None if one is None else np.repeat(one, count, axis=0) for name, one in many.items()}
    return replace(rows, **many)


def bracket_of(analysis: LimitAnalysis, proof: Proof) -> tuple[float, float]:
    """Return proven bounds on λ, scene units: both −inf where unstable, +inf where locked."""
    if proof.status is Status.UNSTABLE:
        return -math.inf, -math.inf
    if proof.status is Status.LOCKED:
        return math.inf, math.inf
    load = analysis.template.scaling.load
    return load * proof.low, load * proof.high
