"""Decide which layouts stand under their dead load alone, from states and mechanisms of earlier ones."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.batch.batch_solver import FALLS
from jld_core.deadline import Deadline
from jld_core.limit import LimitAnalysis, Motion, SolveOptions, State, Status
from jld_core.tolerances import ROUNDING
from jld_explore.evaluation.protocol import Evaluation

_KEPT: Final = 64  # states and motions that are tested with every labelling
_FEW: Final = 2  # states and motions from which on what they leave open goes to the batch solver first
_SLICE: Final = 4096  # labellings of one call of the batch solver

# What a driver is told of a layout that falls
_UNSTABLE: Final = Evaluation(Status.UNSTABLE, math.nan, math.nan, math.nan)


class Standing:
    """Decide which labellings stand at λ = 0, in all load cases."""

    def __init__(
        self,
        assembly: Assembly,
        model: SolveOptions,
        cells: Callable[[Bits], Bits] | None = None,
        *,
        by_load_factor: bool = True,
    ) -> None:
        # contacts at points and effective areas admit fewer states than are looked at here: only falls are certain
        self._cells = cells
        self._by_load_factor = by_load_factor and model.friction == "associative"
        self._cases = [_Case(LimitAnalysis(case, inner_bending=model.inner_bending)) for case in assembly.by_case]
        self._falls_only = assembly.dimension == 3 and (model.contact == "concave" or model.effective_area)

    def of(self, labellings: Bits, low: Floats, deadline: Deadline | None = None) -> Floats:
        """Return 1 for labellings (k, m) that stand at λ = 0, 0 for those that fall, NaN if undecided: (k,).

        low: (k,) proven lower bounds on λ, NaN where there is none.
        """
        if not len(labellings):
            return np.empty(0)
        labels = labellings if self._cells is None else self._cells(labellings)
        carries = (low >= 0.0) & self._by_load_factor
        found = np.min([case.of(labels, carries.copy(), deadline) for case in self._cases], axis=0)
        if self._falls_only:
            found[found == 1.0] = math.nan
        return np.asarray(found)

    def told(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> list[Evaluation]:
        """Return evaluations of labellings (k, m) as a driver is told them: what falls at λ = 0 is unstable."""
        told = list(evaluations)
        rows = [k for k, one in enumerate(told) if one.status in (Status.COLLAPSE, Status.LOCKED)]
        falls = self.of(labellings[rows], np.array([told[k].low for k in rows])) == 0.0
        for k in np.array(rows, dtype=int)[falls].tolist():
            none = (math.nan,) * len(told[k].cases)
            told[k] = replace(_UNSTABLE, cases=none, seconds=told[k].seconds)
        return told


class VoidStanding(Standing):
    """Decide which labellings stand where a search may leave cells out, each as its own structure."""

    def __init__(
        self, cut: Callable[[str], tuple[Assembly, Bits]], texts: Callable[[Bits], list[str]], model: SolveOptions
    ) -> None:
        self._cut, self._texts, self._model = cut, texts, model
        self._known: dict[str, float] = {}

    def of(self, labellings: Bits, low: Floats, deadline: Deadline | None = None) -> Floats:
        texts = self._texts(labellings) if len(labellings) else []
        for k, text in enumerate(texts):
            if text not in self._known and not (deadline is not None and deadline.passed()):
                assembly, labels = self._cut(text)
                self._known[text] = float(Standing(assembly, self._model).of(labels[None], low[k : k + 1])[0])
        return np.array([self._known.get(text, math.nan) for text in texts])


class _Case:
    """States and motions at λ = 0 under one load case, tested with every labelling before one is solved."""

    def __init__(self, analysis: LimitAnalysis) -> None:
        self._analysis = analysis
        faces = len(analysis.assembly.interfaces)
        self._every = not analysis.template.dead.any()  # whether every labelling stands
        self._both = np.ones((2, faces), dtype=bool) & [[True], [False]]  # all dry, all inner
        self._bad = np.empty(
            (0, 2, faces), dtype=bool
        )  # of each state: faces beyond their yield set, if dry and if inner
        self._cost = np.empty((0, 2, faces))  # of each motion: dissipation if dry and if inner
        self._known: dict[bytes, float] = {}  # answers by packed labels, as tables ask again
        self._gain = np.empty(0)  # of each motion: dissipation below which it proves a fall

    def of(self, labellings: Bits, carries: Bools, deadline: Deadline | None) -> Floats:
        """Return 1, 0 or NaN for labellings (k, m); carries: (k,) a state of λ ≥ 0 is known."""
        if self._every:
            return np.ones(len(labellings))
        found = np.full(len(labellings), math.nan)
        self._test(labellings, found, 0, 0)
        asked = False
        for k in range(len(labellings)):
            if not math.isnan(found[k]):
                continue
            if deadline is not None and deadline.passed():
                break
            if not asked and len(self._bad) + len(self._cost) >= _FEW:
                asked = True
                self._by_batch_solver(
                    labellings, carries, found, math.inf if deadline is None else deadline.remaining()
                )
                if not math.isnan(found[k]):
                    continue
            states, motions = len(self._bad), len(self._cost)
            proof = self._analysis.repair.proof_at_zero(labellings[k])
            if proof is None:
                continue
            self._add(proof)
            found[k] = self._known[np.packbits(labellings[k]).tobytes()] = float(isinstance(proof, State))
            self._test(labellings, found, states, motions)
        return found

    def _test(self, labellings: Bits, found: Floats, states: int, motions: int) -> None:
        """Settle labellings (k, m) by states and motions from given positions on; `found` (k,) is changed."""
        for bad in self._bad[states:]:
            rows = np.flatnonzero(np.isnan(found))
            found[rows[~np.where(labellings[rows], *bad).any(axis=1)]] = 1.0
        for cost, gain in zip(self._cost[motions:], self._gain[motions:], strict=True):
            rows = np.flatnonzero(np.isnan(found))
            found[rows[np.where(labellings[rows], *cost).sum(axis=1) < gain]] = 0.0

    def _by_batch_solver(self, labellings: Bits, carries: Bools, found: Floats, seconds: float) -> None:
        """Settle open labellings (k, m) by λ in both directions; `found` and `carries` (k,) are changed."""
        # states of λ ≥ 0 and of λ ≤ 0 prove that λ = 0 between them is admissible
        batch, until = self._analysis.batch, time.perf_counter() + seconds
        if batch is None:
            return
        reverse = batch.reversed()
        rest = np.flatnonzero(np.isnan(found))
        keys = np.array([row.tobytes() for row in np.packbits(labellings[rest], axis=1)], dtype=object)
        found[rest] = [self._known.get(key, math.nan) for key in keys]
        keys, rest = (part[np.isnan(found[rest])] for part in (keys, rest))
        for low in range(0, len(rest), _SLICE):
            rows = rest[low : low + _SLICE]
            if time.perf_counter() > until:
                return
            unknown = rows[~carries[rows]]
            carries[unknown] = batch.solve(labellings[unknown], thresholds=np.zeros(len(unknown))).low >= 0.0
            answer = reverse.solve(labellings[rows], thresholds=np.zeros(len(rows)))
            found[rows[carries[rows] & (answer.low >= 0.0)]] = 1.0
            found[rows[answer.verdict == FALLS]] = 0.0
            self._known |= dict(zip(keys[low : low + _SLICE].tolist(), found[rows].tolist(), strict=True))

    def _add(self, proof: State | Motion) -> None:
        """Keep a state or a motion for other labellings."""
        if len(self._bad) + len(self._cost) >= _KEPT:
            return
        sets = self._analysis.template.yield_set
        if isinstance(proof, State):
            bad = [sets.slack(proof.forces, labels) < 2.0 * proof.error for labels in self._both]
            self._bad = np.concatenate([self._bad, np.array(bad)[None]])
            self._every |= not np.any(bad)
            return
        margins = np.array([sets.margin(proof.jumps, labels) for labels in self._both])
        cost = np.array([sets.dissipation(proof.jumps, labels) for labels in self._both])
        self._cost = np.concatenate([self._cost, np.where(margins >= 0.0, cost, np.inf)[None]])
        gain = float(self._analysis.template.dead @ proof.velocity) - max(ROUNDING, proof.noise)
        self._gain = np.append(self._gain, gain)
