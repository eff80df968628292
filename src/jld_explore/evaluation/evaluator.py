"""Labelling → Evaluation: one limit analysis per labelling, on a template that is built once."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.limit import Batch, LimitAnalysis, Proof, SolveOptions, Status, relative_width
from jld_core.models import limit_analysis, solve_labelling
from jld_explore.evaluation.certificates import Proofs, proofs_of
from jld_explore.evaluation.evaluation import BOUND, SOLVE, Evaluation
from jld_explore.evaluation.force_method import ForceMethod

_GIVEN: Final = 0.1  # share of the gap that a vertex may leave open, so that two of them still make a narrow bracket


@dataclass(frozen=True)
class EvaluatorSettings:
    """What an evaluator is asked for.

    model: what is modelled. prove: also say what a solve proves about other labellings, where bounds speak of
    more than one (`SolveOptions.modular`). many: the assembly has labellings enough for the batch solver, which is made
    in
    the time of some ten solves.
    """

    model: SolveOptions = field(default_factory=SolveOptions)
    prove: bool = False
    many: bool = True

    @property
    def batched(self) -> bool:
        """Whether bounds on λ of many labellings are all that is asked, which is what the batch solver gives."""
        return self.many and self.model.modular and not self.prove


class Evaluator:
    """Evaluates labellings of one assembly; an answer depends on what is asked alone, never on the order.

    like: another of the same assembly and settings, whose batch solver is taken. An evaluator is for one thread at a
    time; a
    batch solver is for all.
    """

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings, like: Evaluator | None = None) -> None:
        self.assembly, self.settings = assembly, settings
        self._prove = settings.prove and settings.model.modular
        self._force_method: ForceMethod | None = None
        self._batch: Batch | None
        if like is not None:
            self._batch = like._batch
        else:
            self._batch = Batch.of(self._analysis) if settings.batched else None

    @cached_property
    def _analysis(self) -> LimitAnalysis:
        """What solves one labelling at a time, made when it is first needed."""
        return limit_analysis(self.assembly, self.settings.model)

    def twin(self) -> Evaluator:
        """Another one, for another thread: it answers alike, and is made in no time where the batch solver settles
        all."""
        return Evaluator(self.assembly, self.settings, self)

    @property
    def settles(self) -> bool:
        """Whether nearly all labellings are the batch solver's to settle, so that one process does what several
        would."""
        return self._batch is not None and self._batch.worthwhile

    def evaluate_all(
        self,
        labellings: Bits,
        floors: Floats | None = None,
        waiting: Bits | None = None,
        deadline: Deadline | None = None,
    ) -> list[Evaluation]:
        """Evaluate labellings (k, m), many at once where the batch solver can, the others one by one.

        floors: (k,), waiting: see `evaluate`. deadline: after which no further labelling is begun:
        evaluations are then of the first labellings only. Each depends on its own labelling alone.
        """
        if deadline is not None and deadline.passed():
            return []
        known = self._in_lanes(labellings)
        values = [-math.inf] * len(labellings) if floors is None else floors.tolist()
        found: list[Evaluation] = []
        for labels, floor, evaluation in zip(labellings, values, known, strict=True):
            if evaluation is None:
                if deadline is not None and deadline.passed():
                    break
                evaluation = self._in_time(labels, floor, waiting, deadline)
            if evaluation is None:
                break
            found.append(evaluation)
        return found

    def _in_time(
        self, labels: Bits, floor: float, waiting: Bits | None, deadline: Deadline | None
    ) -> Evaluation | None:
        """The evaluation of one labelling; None where a search without dilation was cut short by the deadline."""
        if deadline is None or self.settings.model.friction == "associative":
            return self.evaluate(labels, floor, waiting)
        with suppress(DeadlinePassed), deadline.enforced():
            found = self.evaluate(labels, floor, waiting)
            return None if deadline.passed() else found
        return None

    def _in_lanes(self, labellings: Bits) -> list[Evaluation | None]:
        """Evaluations by the batch solver, None where it leaves a labelling open."""
        if self._batch is None:
            return [None] * len(labellings)
        start = time.perf_counter()
        answers = self._batch.prove(labellings)
        scale = self._batch.load
        low, high = (scale * answers.low).tolist(), (scale * answers.high).tolist()
        each = (time.perf_counter() - start) / max(len(labellings), 1)
        found: list[Evaluation | None] = []
        for k, (least, most) in enumerate(zip(low, high, strict=True)):
            status = answers.status(k)
            found.append(
                None if status is None else Evaluation(status, least, most, 0.5 * (least + most), seconds=each)
            )
        return found

    def evaluate(self, labels: Bits, floor: float = -math.inf, waiting: Bits | None = None) -> Evaluation:
        """Evaluate one labelling.

        labels: (m,) True dry. floor: λ, scene units, at or below which a labelling does not matter; it is not
        solved without dilation where its associative λ is no larger. waiting: (k, m) labellings that wait as
        well, and that proofs had better say something about.
        """
        start = time.perf_counter()
        if self._prove:
            found = self._at_a_vertex(labels, waiting, start)
            if found is not None:
                return found
        proof = solve_labelling(self._analysis, labels, self.settings.model, floor=floor)
        # what rigid blocks prove is proven of their own labelling
        modular = self._prove and "rigid_blocks" not in proof.extra
        return self._evaluation(proof, proofs_of(self._analysis.template, proof, labels) if modular else None, start)

    def _evaluation(self, proof: Proof, proofs: Proofs | None, start: float) -> Evaluation:
        scale = self._analysis.template.scaling.load
        (low, high), load = proof.bracket, proof.load_factor
        if self.settings.model.by_floor and not proof.outbid and proof.status is Status.COLLAPSE:
            return self._floor(proof, scale, start)
        dilates = self.settings.model.friction == "associative"
        return Evaluation(
            status=proof.status,
            low=low * scale,
            high=high * scale,
            associative=(load if dilates else proof.associative) * scale,
            zero_dilation=math.nan if dilates or proof.outbid else load * scale,
            settled=BOUND if proof.outbid else SOLVE,
            seconds=time.perf_counter() - start,
            proofs=proofs,
        )

    def _floor(self, proof: Proof, scale: float, start: float) -> Evaluation:
        """The evaluation by the bound below every λ without dilation: the lowest found closes its bracket."""
        bound, found = proof.extra["lowest_proven"], proof.extra["lowest_found"]
        return Evaluation(
            status=Status.UNCERTIFIED if bound is None else Status.COLLAPSE,
            low=math.nan if bound is None else bound,
            high=math.nan if found is None else float(found),  # time may be up before anything is found
            associative=proof.associative * scale,
            zero_dilation=math.nan if bound is None else bound,
            settled=BOUND if bound is None else SOLVE,
            seconds=time.perf_counter() - start,
        )

    def _at_a_vertex(self, labels: Bits, waiting: Bits | None, start: float) -> Evaluation | None:
        """The evaluation by the force method; None where its vertex does not prove a narrow bracket."""
        if self._force_method is None:
            own = self._analysis
            self._force_method = ForceMethod(own.template, own.prover, own.repair)
        if not self._force_method.usable:
            return None
        vertex = self._force_method.solve(labels, waiting)
        if vertex is None:
            return None
        proof = Proof()
        proof.offer_motion(vertex.motion)
        if vertex.state is not None:
            proof.offer_state(vertex.state)
        proof.status = self._analysis.judge(proof)
        narrow = relative_width(proof.low, proof.high, 0.0) <= _GIVEN * self.settings.model.gap
        if proof.status is Status.UNSTABLE or (proof.status is Status.COLLAPSE and narrow):
            return self._evaluation(proof, vertex.proofs, start)
        return None
