"""Labelling → Evaluation: one limit analysis per labelling, on a template that is built once."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.limit import Batch, LimitAnalysis, Proof, Status, apart, relative_width
from jld_core.models import solve_condensed, worth_condensing, zero_dilation
from jld_explore.evaluation.certificates import Proofs, proofs_of
from jld_explore.evaluation.evaluation import BOUND, Evaluation
from jld_explore.evaluation.force_method import ForceMethod

_GIVEN: Final = 0.1  # share of the gap that a vertex may leave open, so that two of them still make a narrow bracket


@dataclass(frozen=True)
class EvaluatorSettings:
    """What an evaluator is asked for.

    objective: "associative" or "zero-dilation". gap: width above which it is uncertified. prove: also say what
    a solve proves about other labellings.
    """

    objective: str = "associative"
    gap: float = tolerances.GAP
    prove: bool = False

    @property
    def in_lanes(self) -> bool:
        """Whether bounds on λ are all that is asked, which is what the kernel gives."""
        return self.objective == "associative" and not self.prove


def kernel_settles(assembly: Assembly, settings: EvaluatorSettings) -> bool:
    """Whether nearly all labellings are the kernel's to settle, so that one process does what several would."""
    if not settings.in_lanes:
        return False
    batch = Batch.of(LimitAnalysis(assembly, gap=settings.gap))
    return batch is not None and batch.worthwhile


class Evaluator:
    """Evaluates labellings of one assembly; an answer depends on what is asked alone, never on the order."""

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings) -> None:
        self.assembly, self.settings = assembly, settings
        self._analysis = LimitAnalysis(assembly, gap=settings.gap)
        self._force_method: ForceMethod | None = None
        self._batch = Batch.of(self._analysis) if settings.in_lanes else None

    def evaluate_all(
        self, labellings: Bits, floors: Floats | None = None, company: Bits | None = None, deadline: float | None = None
    ) -> list[Evaluation]:
        """Evaluate labellings (k, m), many at once where the kernel can, the others one by one.

        floors: (k,), company: see `evaluate`. deadline: time since the epoch, s, after which no further labelling is
        begun: evaluations are then of the first labellings only. Each depends on its own labelling alone.
        """
        if deadline is not None and time.time() >= deadline:
            return []
        known = self._in_lanes(labellings)
        values = [-math.inf] * len(labellings) if floors is None else floors.tolist()
        found: list[Evaluation] = []
        for labels, floor, evaluation in zip(labellings, values, known, strict=True):
            if evaluation is None:
                if deadline is not None and time.time() >= deadline:
                    break
                evaluation = self.evaluate(labels, floor, company)
            found.append(evaluation)
        return found

    def _in_lanes(self, labellings: Bits) -> list[Evaluation | None]:
        """Evaluations by the kernel, None where it leaves a labelling open."""
        if self._batch is None:
            return [None] * len(labellings)
        start = time.perf_counter()
        answers = self._batch.prove(labellings)
        scale = self._analysis.template.scaling.load
        low, high = (scale * answers.low).tolist(), (scale * answers.high).tolist()
        each = (time.perf_counter() - start) / max(len(labellings), 1)
        found: list[Evaluation | None] = []
        for k, (least, most) in enumerate(zip(low, high, strict=True)):
            status = answers.status(k)
            found.append(
                None if status is None else Evaluation(status, least, most, 0.5 * (least + most), seconds=each)
            )
        return found

    def evaluate(self, labels: Bits, floor: float = -math.inf, company: Bits | None = None) -> Evaluation:
        """Evaluate one labelling.

        labels: (m,) True dry. floor: λ, scene units, at or below which a labelling does not matter; it is not
        solved without dilation where its associative λ is no larger. company: (k, m) labellings that wait as
        well, and that proofs had better say something about.
        """
        start = time.perf_counter()
        if self.settings.objective == "zero-dilation":
            return self._without_dilation(labels, start, floor)
        if self.settings.prove:
            found = self._at_a_vertex(labels, company, start)
            if found is not None:
                return found
        if worth_condensing(self._analysis.template, labels):
            found = self._condensed(labels, start)
            if found is not None:
                return found
        status, proof = self._analysis.prove(labels)
        if status is Status.UNCERTIFIED and not labels.all():
            found, scale = self._condensed(labels, start), self._analysis.template.scaling.load
            known = proof.low * scale, proof.high * scale
            # an answer that contradicts what is proven already proves nothing
            if (
                found is not None
                and found.status is not Status.UNCERTIFIED
                and not apart((found.low, found.high), known)
            ):
                return found
        proofs = proofs_of(self._analysis.template, proof, labels) if self.settings.prove else None
        return self._evaluation(status, proof, proofs, start)

    def _evaluation(self, status: Status, proof: Proof, proofs: Proofs | None, start: float) -> Evaluation:
        scale, nan = self._analysis.template.scaling.load, math.nan
        low = proof.low * scale if math.isfinite(proof.low) else nan
        high = proof.high * scale if math.isfinite(proof.high) else nan
        load_factor = 0.5 * (low + high)
        if status is Status.UNSTABLE:
            low = high = load_factor = nan
        elif status is Status.LOCKED:
            high = load_factor = nan
        elif status is Status.UNCERTIFIED and math.isnan(load_factor):
            load_factor = proof.guess * scale
        return Evaluation(status, low, high, load_factor, seconds=time.perf_counter() - start, proofs=proofs)

    def _at_a_vertex(self, labels: Bits, company: Bits | None, start: float) -> Evaluation | None:
        """The evaluation by the force method; None where its vertex does not prove a narrow bracket."""
        if self._force_method is None:
            own = self._analysis
            self._force_method = ForceMethod(own.template, own.prover, own.interior)
        if not self._force_method.usable:
            return None
        vertex = self._force_method.solve(labels, company)
        if vertex is None:
            return None
        proof = Proof()
        proof.offer_motion(vertex.motion)
        if vertex.state is not None:
            proof.offer_state(vertex.state)
        status = self._analysis.judge(proof)
        narrow = relative_width(proof.low, proof.high, 0.0) <= _GIVEN * self.settings.gap
        if status is Status.UNSTABLE or (status is Status.COLLAPSE and narrow):
            return self._evaluation(status, proof, vertex.proofs, start)
        return None

    def _condensed(self, labels: Bits, start: float) -> Evaluation | None:
        """The evaluation with rigid blocks; None where those are no help."""
        found = solve_condensed(self._analysis, labels, stands=False)
        if found is None:
            return None
        low, high = found.bracket
        return Evaluation(found.status, low, high, found.load_factor, seconds=time.perf_counter() - start)

    def _without_dilation(self, labels: Bits, start: float, floor: float) -> Evaluation:
        associative = self._analysis.solve(labels, stands=False)
        high = associative.bracket[1]
        if associative.status is Status.COLLAPSE and high <= floor:
            # no answer without dilation exceeds the associative one
            seconds, known = time.perf_counter() - start, associative.load_factor
            return Evaluation(Status.UNCERTIFIED, math.nan, high, known, settled=BOUND, seconds=seconds)
        found = zero_dilation(self._analysis, labels, associative=associative, stands=False)
        low, high = found.bracket
        return Evaluation(
            status=found.status,
            low=low,
            high=high,
            associative=associative.load_factor,
            zero_dilation=found.load_factor,
            seconds=time.perf_counter() - start,
        )
