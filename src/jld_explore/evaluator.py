"""Labelling → Evaluation: one limit analysis per labelling, on a template that is built once."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.assembly import Assembly, Bits, Bools
from jld_core.bracket import load_floor
from jld_core.condense import solve_condensed, worth_condensing
from jld_core.limit import LimitAnalysis, Proof
from jld_core.solvers.status import Status
from jld_core.zero_dilation import zero_dilation
from jld_explore.certificates import Proofs, forces_of, mechanism_of, proofs_of
from jld_explore.sharpen import Sharpener

SOLVE: Final = "solve"
CERTIFICATE: Final = "certificate"
BOUND: Final = "bound"
"""Settled without the solve it was asked for, because its upper bound is below what matters."""

_GIVEN: Final = 0.1  # share of the gap that forces and mechanisms made for reuse may give away


@dataclass(frozen=True)
class Evaluation:
    """What is known of one labelling; λ in scene units, NaN where not computed or infinite.

    status: of the objective. low, high: proven bounds. associative: λ with associative friction.
    zero_dilation: λ without dilation. settled: "solve", "certificate" or
    "bound": then only `high` is known, of a labelling that was not worth more. seconds: spent on it. proofs: what the
    solve proves about other labellings, where that was asked for.
    """

    status: Status
    low: float
    high: float
    associative: float
    zero_dilation: float = math.nan
    settled: str = SOLVE
    seconds: float = 0.0
    proofs: Proofs | None = field(default=None, compare=False, repr=False)

    @property
    def load_factor(self) -> float:
        """λ of the objective: without dilation where that was computed, else associative; NaN for a bound alone."""
        if self.settled == BOUND:
            return math.nan
        return self.associative if math.isnan(self.zero_dilation) else self.zero_dilation


FAILED: Final = Evaluation(Status.FAILED, math.nan, math.nan, math.nan)
"""The evaluation of a labelling whose worker died or hung twice."""


@dataclass(frozen=True)
class EvaluatorSettings:
    """What an evaluator is asked for.

    objective: "associative" or "zero-dilation". gap: width above which it is uncertified. prove: also say what
    a solve proves about other labellings.
    """

    objective: str = "associative"
    gap: float = tolerances.GAP
    prove: bool = False


class Evaluator:
    """Evaluates labellings of one assembly; an answer depends on what is asked alone, never on the order."""

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings) -> None:
        self.assembly, self.settings = assembly, settings
        self._analysis = LimitAnalysis(assembly, gap=settings.gap)
        self._sharpener: Sharpener | None = None

    def evaluate(self, labels: Bits, likely: float = math.inf, floor: float = -math.inf) -> Evaluation:
        """Evaluate one labelling.

        labels: (m,) True dry. likely: a proven upper bound on its scaled λ that it probably reaches; tried
        first where it is finite and proofs are asked for. floor: λ, scene units, at or below which a labelling
        does not matter; it is not solved without dilation where its associative λ is no larger.
        """
        start = time.perf_counter()
        if self.settings.prove and math.isfinite(likely):
            confirmed = self._confirm(labels, likely, start)
            if confirmed is not None:
                return confirmed
        if self.settings.objective == "zero-dilation":
            return self._without_dilation(labels, start, floor)
        if worth_condensing(self._analysis.template, labels):
            found = self._condensed(labels, start)
            if found is not None:
                return found
        status, proof = self._analysis.prove(labels)
        if status is Status.UNCERTIFIED and not labels.all():
            found = self._condensed(labels, start)
            if found is not None and found.status is not Status.UNCERTIFIED:
                return found
        proofs = self._proofs(status, proof, labels, likely) if self.settings.prove else None
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
        seconds = time.perf_counter() - start
        return Evaluation(status, low, high, load_factor, seconds=seconds, proofs=proofs)

    def _condensed(self, labels: Bits, start: float) -> Evaluation | None:
        """The evaluation with rigid blocks; None where those are no help."""
        found = solve_condensed(self._analysis, labels, stands=False)
        if found is None:
            return None
        low, high = found.bracket
        return Evaluation(found.status, low, high, found.load_factor, seconds=time.perf_counter() - start)

    @property
    def _sharp(self) -> Sharpener:
        if self._sharpener is None:
            own = self._analysis
            every: Bools = np.ones(len(self.assembly.interfaces), dtype=bool)
            self._sharpener = Sharpener(own.template, own.prover, own.interior, every)
        return self._sharpener

    def _width(self, load: float) -> float:
        """What a certificate may give away of a scaled λ, so that two of them still make a narrow bracket."""
        floor = load_floor(self._analysis.template) / self._analysis.template.scaling.load
        return _GIVEN * self.settings.gap * max(abs(load), floor)

    def _confirm(self, labels: Bits, likely: float, start: float) -> Evaluation | None:
        """The evaluation of a labelling that reaches a proven upper bound; None where it does not."""
        if not self._sharp.usable:
            return None
        state = self._sharp.forces(labels, likely - self._width(likely))
        if state is None:
            return None
        scale = self._analysis.template.scaling.load
        low, high = state.load * scale, likely * scale
        return Evaluation(
            Status.COLLAPSE,
            low,
            high,
            0.5 * (low + high),
            seconds=time.perf_counter() - start,
            proofs=Proofs((forces_of(self._analysis.template, state, labels),)),
        )

    def _proofs(self, status: Status, proof: Proof, labels: Bits, likely: float) -> Proofs:
        """What a limit analysis proves, with forces and a mechanism that prove more where they are to be had."""
        template, sharp = self._analysis.template, self._sharp
        found = proofs_of(template, proof, labels)
        if not sharp.usable:
            return found
        forces, mechanisms = found.forces, found.mechanisms
        if status is Status.COLLAPSE:
            state = sharp.forces(labels, proof.low - self._width(proof.low))
            if state is not None:
                forces += (forces_of(template, state, labels),)
            if likely - proof.low > self._width(proof.low):
                motion = sharp.motion(labels, proof.high + self._width(proof.high))
                if motion is not None:
                    mechanisms += (mechanism_of(template, motion, labels),)
        elif status is Status.UNSTABLE:
            motion = sharp.fall(labels)
            if motion is not None:
                mechanisms += (mechanism_of(template, motion, labels, falls=True),)
        return Proofs(forces, mechanisms)

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
