"""Evaluate labellings under several load cases, or at low and nominal material values."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from jld_core import plugins
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly, without
from jld_core.batch.batch_solver import FALLS, BatchResults, BatchSolver
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import ParameterError
from jld_core.limit import CaseBounds, Motion, State, governing
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.options import SolveOptions, Status
from jld_core.tolerances import ROUNDING
from jld_explore.evaluation.protocol import (
    BOUND,
    SOLVE,
    CutShort,
    Envelope,
    Evaluation,
    Evaluator,
    EvaluatorSettings,
    LabellingEvaluator,
    SharedEvaluator,
    front_counts,
)
from jld_explore.space.search_space import SearchSpace

# Placeholder for a load case that is not solved because another case already decides the labelling
_UNSOLVED: Final = Evaluation(Status.UNCERTIFIED, math.nan, math.nan, math.nan)


class CasesEvaluator(SharedEvaluator):
    """Evaluator of labellings of one assembly under all its load cases; the governing one decides."""

    def __init__(
        self, assembly: Assembly, settings: EvaluatorSettings, share_batch_solver_with: CasesEvaluator | None = None
    ) -> None:
        self.assembly, self.settings = assembly, settings
        self._required = assembly.required.tolist()
        if share_batch_solver_with is None:
            self._each = [Evaluator(case, settings) for case in assembly.by_case]
        else:
            self._each = [evaluator.twin() for evaluator in share_batch_solver_with._each]

    def twin(self) -> CasesEvaluator:
        return CasesEvaluator(self.assembly, self.settings, self)

    @property
    def settles_nearly_all(self) -> bool:
        return all(evaluator.settles_nearly_all for evaluator in self._each)

    def evaluate_all(
        self, labellings: Bits, pruning_thresholds: Floats | None = None, deadline: Deadline | None = None
    ) -> list[Evaluation]:
        # A labelling counts as evaluated when all its cases are. Pruning thresholds refer to the governing load factor.
        if not self.settings.batched:
            return self._one_by_one(labellings, pruning_thresholds, deadline)
        found: list[list[Evaluation]] = []
        count = len(labellings)
        for evaluator, factor in zip(self._each, self._required, strict=True):
            # A governing λ above the threshold needs every case above the threshold times its required factor.
            own = None if pruning_thresholds is None else pruning_thresholds[:count] * factor
            answers = evaluator.evaluate_all(labellings[:count], own, deadline)
            found.append(answers)
            count = len(answers)
        return [self._combined([answers[k] for answers in found]) for k in range(count)]

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        # no further case is solved once one is unstable or does not exceed the threshold
        found = [_UNSOLVED] * len(self._each)
        for case in self._order:
            factor = self._required[case]
            found[case] = self._each[case].evaluate(labels, pruning_threshold * factor)
            if found[case].settled == BOUND or found[case].status is Status.UNSTABLE:
                break
        return self._combined(found)

    @cached_property
    def _order(self) -> list[int]:
        """Positions of the load cases, most critical first."""
        # The ranking uses λ of the scene's own labelling, so that it is the same for all labellings.
        load_factors = []
        for case, factor in zip(self.assembly.by_case, self._required, strict=True):
            analysis = LimitAnalysis(case)
            proof = analysis.prove(self.assembly.labels)
            none = -math.inf if proof.status is Status.UNSTABLE else math.inf
            number = proof.load_factor * analysis.template.scaling.load / factor
            load_factors.append(number if proof.status is Status.COLLAPSE else none)
        return sorted(range(len(load_factors)), key=load_factors.__getitem__)

    def _one_by_one(
        self, labellings: Bits, pruning_thresholds: Floats | None, deadline: Deadline | None
    ) -> list[Evaluation]:
        """Evaluate labellings (k, m) in turn until the deadline passes."""
        values = [-math.inf] * len(labellings) if pruning_thresholds is None else pruning_thresholds.tolist()
        evaluations: list[Evaluation] = []
        for labels, pruning_threshold in zip(labellings, values, strict=True):
            if deadline is not None and deadline.passed():
                break
            evaluations.append(self.evaluate(labels, pruning_threshold))
        return evaluations

    def _combined(self, cases: list[Evaluation]) -> Evaluation:
        """Combine the evaluations of load cases to that of the governing factor."""
        bounds = [CaseBounds(case.status, case.low, case.high, case.load_factor) for case in cases]
        decided = governing(bounds, self._required)
        seconds = sum(case.seconds for case in cases)
        values = tuple(case.load_factor for case in cases)
        associative = [one.associative / factor for one, factor in zip(cases, self._required, strict=True)]
        pruned_at = [one.high / f for one, f in zip(cases, self._required, strict=True) if one.settled == BOUND]
        if pruned_at and decided.status not in (Status.UNSTABLE, Status.FAILED):
            # The upper bound of a single case suffices to prune the labelling.
            position = next(k for k, one in enumerate(cases) if one.settled == BOUND)
            return Evaluation(
                Status.UNCERTIFIED,
                math.nan,
                min(pruned_at),
                min(associative, key=lambda value: math.inf if math.isnan(value) else value),
                settled=BOUND,
                seconds=seconds,
                cases=values,
                governing=position,
            )
        only_associative = all(math.isnan(case.zero_dilation) for case in cases)
        least = min((value for value in associative if not math.isnan(value)), default=math.nan)
        return Evaluation(
            status=decided.status,
            low=decided.low,
            high=decided.high,
            associative=decided.load_factor if only_associative else least,
            zero_dilation=math.nan if only_associative else decided.load_factor,
            settled=SOLVE,
            seconds=seconds,
            cases=values,
            governing=decided.case,
        )


class RobustEvaluator(SharedEvaluator):
    """Evaluator at low material values; the last of `cases` is λ at nominal values."""

    def __init__(
        self, assembly: Assembly, settings: EvaluatorSettings, share_batch_solver_with: RobustEvaluator | None = None
    ) -> None:
        self.assembly, self.settings = assembly, settings
        if share_batch_solver_with is None:
            low = replace(assembly, face_strengths=assembly.face_strengths.without_nominal())
            self._low = evaluator_of(low, settings)
            self._nominal = evaluator_of(assembly.at_nominal, settings)
        else:
            self._low, self._nominal = share_batch_solver_with._low.twin(), share_batch_solver_with._nominal.twin()

    def twin(self) -> RobustEvaluator:
        return RobustEvaluator(self.assembly, self.settings, self)

    @property
    def settles_nearly_all(self) -> bool:
        return self._low.settles_nearly_all and self._nominal.settles_nearly_all

    def evaluate_all(
        self, labellings: Bits, pruning_thresholds: Floats | None = None, deadline: Deadline | None = None
    ) -> list[Evaluation]:
        # a labelling counts as evaluated when both evaluations are finished
        low = self._low.evaluate_all(labellings, pruning_thresholds, deadline)
        good = [k for k, one in enumerate(low) if one.status is Status.COLLAPSE]
        nominal = self._nominal.evaluate_all(labellings[good], None, deadline)
        known = dict(zip(good, nominal, strict=False))
        done = good[len(nominal)] if len(nominal) < len(good) else len(low)
        return [self._combined(one, known.get(k)) for k, one in enumerate(low[:done])]

    def _combined(self, low: Evaluation, nominal: Evaluation | None) -> Evaluation:
        """Append λ at nominal values to the cases of an evaluation at low values."""
        value = math.nan if nominal is None else nominal.load_factor
        seconds = low.seconds + (0.0 if nominal is None else nominal.seconds)
        cases = low.cases or (math.nan,) * len(self.assembly.cases)
        return replace(low, cases=(*cases, value), seconds=seconds)


def evaluator_of(assembly: Assembly, settings: EvaluatorSettings) -> SharedEvaluator:
    """Make the evaluator of an assembly: one load, load cases, or low and nominal materials.

    Parameters
    ----------
    assembly : Assembly
        The structure.
    settings : EvaluatorSettings
        The settings.

    Returns
    -------
    SharedEvaluator
    """
    if assembly.has_low_values:
        return RobustEvaluator(assembly, settings)
    return CasesEvaluator(assembly, settings) if assembly.cases else Evaluator(assembly, settings)


# function of an evaluation with its λ, the assembly, and the labels (m,); its value is maximised
OwnObjective = Callable[[Evaluation, Assembly, Bits], float]


class OwnObjectiveEvaluator(LabellingEvaluator):
    """Evaluator whose λ and bounds are the values of a user's function; the last of `cases` is λ."""

    def __init__(self, function: OwnObjective, assembly: Assembly, settings: EvaluatorSettings) -> None:
        self._function, self._assembly = function, assembly
        self._evaluator = evaluator_of(assembly, settings)

    def evaluate_all(
        self, labellings: Bits, pruning_thresholds: Floats | None = None, deadline: Deadline | None = None
    ) -> list[Evaluation]:
        # bounds on λ, and thus pruning thresholds, are no bounds on the objective
        found = self._evaluator.evaluate_all(labellings, None, deadline)
        values: list[Evaluation] = []
        try:
            for labels, one in zip(labellings, found, strict=False):
                values.append(self._with_value(labels, one))
        except DeadlinePassed:
            raise
        except Exception as error:  # of the user's function
            if not values:
                raise
            return CutShort(values, error)
        return values

    def _with_value(self, labels: Bits, found: Evaluation) -> Evaluation:
        """Return an evaluation with the objective in place of λ; InputError for no number."""
        cases = found.cases or (math.nan,) * len(self._assembly.cases)
        if found.status is not Status.COLLAPSE:
            return replace(found, cases=(*cases, math.nan))
        with plugins.guarded("jld.objectives", self._function):
            value: Any = self._function(found, self._assembly, labels)
        if not isinstance(value, int | float | np.integer | np.floating) or not math.isfinite(value):
            text = "".join("d" if dry else "i" for dry in labels)
            raise ParameterError("objective", f"it is {value!r} for the labelling {text}", "a finite number")
        return replace(
            found,
            low=float(value),
            high=float(value),
            associative=float(value),
            zero_dilation=math.nan,
            cases=(*cases, found.load_factor),
        )


class IncumbentFront:
    """Largest λ known for each combination of the scene's front counts."""

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self._known = Envelope(len(space.search.front.axes))

    def learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Update the front with evaluations of labellings (k, m); only those that collapse count."""
        good = np.array([found.status is Status.COLLAPSE for found in evaluations], dtype=bool)
        value = np.array([found.load_factor for found in evaluations])[good]
        self._known.learn(value, front_counts(self.space, labellings[good]))

    def thresholds(self, labellings: Bits) -> Floats:
        """Return the λ (k,), scene units, at or below which each labelling does not matter."""
        return self._known.best(front_counts(self.space, labellings))


_MOST_EVALUATORS: Final = 64  # largest number of structures whose evaluators are cached


class VoidCellsEvaluator(LabellingEvaluator):
    """Evaluator of labellings that leave cells out, each on the structure of those that remain."""

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings) -> None:
        # Nearly every labelling leaves a different structure; one solve is faster than making its batch solver.
        self.settings, self._sink = replace(settings, use_batch_solver=False), assembly.sink
        gone = np.arange(len(assembly.elements)) == assembly.sink
        self._real, self._faces = without(assembly, gone)
        self._cells = assembly.interfaces.a[len(self._faces) :]
        self._evaluators: OrderedDict[bytes, tuple[LabellingEvaluator, Ints]] = OrderedDict()

    def evaluate_all(
        self, labellings: Bits, pruning_thresholds: Floats | None = None, deadline: Deadline | None = None
    ) -> list[Evaluation]:
        # See `LabellingEvaluator.evaluate_all`. A labelling is a row (m + c,): labels of faces (True = dry), then of
        # cells (True = stays).
        evaluations: list[Evaluation | None] = [None] * len(labellings)
        groups: dict[bytes, list[int]] = {}
        for row, labels in enumerate(labellings):
            groups.setdefault(np.packbits(labels[len(self._faces) :]).tobytes(), []).append(row)
        for rows in groups.values():
            if deadline is not None and deadline.passed():
                break
            evaluator, kept = self._evaluator_of(labellings[rows[0]])
            own = None if pruning_thresholds is None else pruning_thresholds[rows]
            answers = evaluator.evaluate_all(labellings[rows][:, kept], own, deadline)
            for row, answer in zip(rows, answers, strict=False):
                evaluations[row] = answer
        done = next((row for row, answer in enumerate(evaluations) if answer is None), len(evaluations))
        return [answer for answer in evaluations[:done] if answer is not None]

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        evaluator, kept = self._evaluator_of(labels)
        return evaluator.evaluate(labels[kept], pruning_threshold)

    def _evaluator_of(self, labels: Bits) -> tuple[LabellingEvaluator, Ints]:
        """Return the evaluator, stored, of the structure of labels (m + c,), and its faces."""
        stays = labels[len(self._faces) :]
        key = np.packbits(stays).tobytes()
        if key not in self._evaluators:
            gone = np.zeros(len(self._real.elements), dtype=bool)
            gone[self._cells[~stays]] = True
            rest, kept = without(self._real, gone)
            self._evaluators[key] = evaluator_of(rest, self.settings), kept
            if len(self._evaluators) > _MOST_EVALUATORS:
                self._evaluators.popitem(last=False)
        self._evaluators.move_to_end(key)
        return self._evaluators[key]


_KEPT: Final = 64  # states and motions that are tested with every labelling
_FEW: Final = 2  # states and motions from which on what they leave open goes to the batch solver first
_SLICE: Final = 4096  # labellings of one call of the batch solver
_SHARED: Final = 16  # labellings from which on threads share such a call

_LONGER: Final = 4.0  # how much longer than λ it may take to decide whether a layout stands

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
        threads: int = 1,
    ) -> None:
        # contacts at points and effective areas admit fewer states than are looked at here: only falls are certain
        self._cells = cells
        self._by_load_factor = by_load_factor and model.friction == "associative"
        self._cases = [
            _Case(LimitAnalysis(case, inner_bending=model.inner_bending), threads) for case in assembly.by_case
        ]
        self._falls_only = assembly.dimension == 3 and (model.contact == "concave" or model.effective_area)

    def of(self, labellings: Bits, low: Floats, deadline: Deadline | None = None, solved_in: float = 0.0) -> Floats:
        """Return 1 for labellings (k, m) that stand at λ = 0, 0 for those that fall, NaN if undecided: (k,).

        low: (k,) proven lower bounds on λ, NaN where there is none. solved_in: longest time that λ of one took, s.
        """
        if not len(labellings):
            return np.empty(0)
        labels = labellings if self._cells is None else self._cells(labellings)
        carries = (low >= 0.0) & self._by_load_factor
        # whether one of thousands of faces stands takes longer than its λ: it is not begun where it would be late
        until = None if deadline is None else Deadline(deadline.remaining() - _LONGER * solved_in)
        found = np.min([case.of(labels, carries.copy(), until, deadline) for case in self._cases], axis=0)
        if self._falls_only:
            found[found == 1.0] = math.nan
        return np.asarray(found)

    def foresee(self, labellings: Bits, evaluations: Sequence[Evaluation], deadline: Deadline | None) -> None:
        """Decide for labellings (k, m), in any thread, what `told` will ask of the batch solver."""
        rows = [k for k, one in enumerate(evaluations) if one.status in (Status.COLLAPSE, Status.LOCKED)]
        labels = labellings[rows] if self._cells is None else self._cells(labellings[rows])
        carries = (np.array([evaluations[k].low for k in rows]) >= 0.0) & self._by_load_factor
        for case in self._cases if rows else ():
            case.foresee(labels, carries.copy(), math.inf if deadline is None else deadline.remaining())

    def told(
        self, labellings: Bits, evaluations: Sequence[Evaluation], deadline: Deadline | None = None
    ) -> list[Evaluation]:
        """Return evaluations of labellings (k, m) as a driver is told them: what falls at λ = 0 is unstable."""
        told = list(evaluations)
        rows = [k for k, one in enumerate(told) if one.status in (Status.COLLAPSE, Status.LOCKED)]
        longest = max((told[k].seconds for k in rows), default=0.0)
        falls = self.of(labellings[rows], np.array([told[k].low for k in rows]), deadline, longest) == 0.0
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

    def of(self, labellings: Bits, low: Floats, deadline: Deadline | None = None, solved_in: float = 0.0) -> Floats:
        texts = self._texts(labellings) if len(labellings) else []
        for k, text in enumerate(texts):
            if text not in self._known and not (deadline is not None and deadline.passed()):
                assembly, labels = self._cut(text)
                self._known[text] = float(Standing(assembly, self._model).of(labels[None], low[k : k + 1])[0])
        return np.array([self._known.get(text, math.nan) for text in texts])


class _Case:
    """States and motions at λ = 0 under one load case, tested with every labelling before one is solved."""

    def __init__(self, analysis: LimitAnalysis, threads: int) -> None:
        self._analysis, self._threads = analysis, threads
        faces = len(analysis.assembly.interfaces)
        self._every = not analysis.template.dead.any()  # whether every labelling stands
        self._both = np.ones((2, faces), dtype=bool) & [[True], [False]]  # all dry, all inner
        self._bad = np.empty(
            (0, 2, faces), dtype=bool
        )  # of each state: faces beyond their yield set, if dry and if inner
        self._cost = np.empty((0, 2, faces))  # of each motion: dissipation if dry and if inner
        self._known: dict[bytes, float] = {}  # answers by packed labels, as tables ask again
        self._dry = np.zeros(faces, dtype=bool)  # all that is dry in labellings that were open, while it stands
        self._wider = True  # while it does
        self._gain = np.empty(0)  # of each motion: dissipation below which it proves a fall

    def of(self, labellings: Bits, carries: Bools, deadline: Deadline | None, until: Deadline | None) -> Floats:
        """Return 1, 0 or NaN for labellings (k, m); carries: (k,) a state of λ ≥ 0 is known.

        After `deadline` no labelling is begun, and none goes on after `until`.
        """
        if self._every:
            return np.ones(len(labellings))
        found = np.full(len(labellings), math.nan)
        self._test(labellings, found, 0, 0)
        open_rows, late = np.isnan(found), deadline is not None and deadline.passed()
        if self._wider and np.count_nonzero(open_rows) > _FEW and not late:
            # what is dry in any of them: where that stands with room, as most walls do, all are settled at once
            dry = self._dry | labellings[open_rows].any(axis=0)
            if (dry != self._dry).any():
                self._dry = dry
                self._wider = isinstance(self._learn(dry, labellings, found, until), State)
        asked = False
        for k in range(len(labellings)):
            if not math.isnan(found[k]):
                continue
            if deadline is not None and deadline.passed():
                break
            if not asked and self._many:
                asked = True
                self._by_batch_solver(
                    labellings, carries, found, math.inf if deadline is None else deadline.remaining()
                )
                if not math.isnan(found[k]):
                    continue
            proof = self._learn(labellings[k], labellings, found, until)
            if proof is not None:
                found[k] = self._known[np.packbits(labellings[k]).tobytes()] = float(isinstance(proof, State))
        return found

    @property
    def _many(self) -> bool:
        """True once so much was asked that the batch solver, which takes long to make, is worth it."""
        return len(self._bad) + len(self._cost) >= _FEW or bool(self._dry.any())

    @cached_property
    def _reverse(self) -> BatchSolver:
        if (batch := self._analysis.batch) is None:
            raise RuntimeError("without a batch solver there is none under the opposite load")
        return batch.reversed(sampled=True)

    def foresee(self, labellings: Bits, carries: Bools, seconds: float) -> None:
        """Decide labellings (k, m) that nothing settles yet by the batch solver alone; carries: as in `of`."""
        if not self._every and self._many:
            found = np.full(len(labellings), math.nan)
            self._test(labellings, found, 0, 0)
            self._by_batch_solver(labellings, carries, found, seconds, threads=1)

    def _learn(self, labels: Bits, labellings: Bits, found: Floats, until: Deadline | None) -> State | Motion | None:
        """Find what decides labels (m,), and settle labellings (k, m) by it; `found` (k,) is changed."""
        states, motions = len(self._bad), len(self._cost)
        try:
            proof = self._analysis.repair.proof_at_zero(labels, until)
        except DeadlinePassed:
            return None
        if proof is not None:
            self._add(proof)
            self._test(labellings, found, states, motions)
        return proof

    def _test(self, labellings: Bits, found: Floats, states: int, motions: int) -> None:
        """Settle labellings (k, m) by states and motions from given positions on; `found` (k,) is changed."""
        if len(bad := self._bad[states:]):
            rows = np.flatnonzero(np.isnan(found))
            dry, (if_dry, if_inner) = labellings[rows].astype(np.float32), bad.swapaxes(0, 1).astype(np.float32)
            found[rows[(dry @ if_dry.T + (1.0 - dry) @ if_inner.T == 0.0).any(axis=1)]] = 1.0  # counts, hence exact
        for cost, gain in zip(self._cost[motions:], self._gain[motions:], strict=False):  # another thread may add one
            rows = np.flatnonzero(np.isnan(found))
            found[rows[np.where(labellings[rows], *cost).sum(axis=1) < gain]] = 0.0

    def _by_batch_solver(
        self, labellings: Bits, carries: Bools, found: Floats, seconds: float, threads: int | None = None
    ) -> None:
        """Settle open labellings (k, m) by λ in both directions; `found` and `carries` (k,) are changed."""
        # states of λ ≥ 0 and of λ ≤ 0 prove that λ = 0 between them is admissible
        batch, until = self._analysis.batch, time.perf_counter() + seconds
        rest = np.flatnonzero(np.isnan(found))
        keys = np.array([row.tobytes() for row in np.packbits(labellings[rest], axis=1)], dtype=object)
        found[rest] = [self._known.get(key, math.nan) for key in keys]
        keys, rest = (part[np.isnan(found[rest])] for part in (keys, rest))
        if batch is None or not len(rest):
            return
        for low in range(0, len(rest), _SLICE):
            rows = rest[low : low + _SLICE]
            if time.perf_counter() > until:
                return
            unknown = rows[~carries[rows]]
            carries[unknown] = self._solved(batch, labellings[unknown], threads).low >= 0.0
            answer = self._solved(self._reverse, labellings[rows], threads)
            found[rows[carries[rows] & (answer.low >= 0.0)]] = 1.0
            found[rows[answer.verdict == FALLS]] = 0.0
            self._known |= dict(zip(keys[low : low + _SLICE].tolist(), found[rows].tolist(), strict=True))

    def _solved(self, batch: BatchSolver, labellings: Bits, threads: int | None) -> BatchResults:
        """Bound λ of labellings (k, m) until above 0, many in several threads."""

        def solved(rows: Bits) -> BatchResults:
            return batch.solve(rows, thresholds=np.zeros(len(rows)))

        threads = threads or self._threads
        if threads == 1 or len(labellings) < _SHARED:
            return solved(labellings)
        with ThreadPoolExecutor(threads) as pool:
            return BatchResults.joined(list(pool.map(solved, np.array_split(labellings, threads))))

    def _add(self, proof: State | Motion) -> None:
        """Store where a state fails, or what a motion costs, under either label."""
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
        gain = float(self._analysis.template.dead @ proof.velocity) - max(ROUNDING, proof.noise)
        self._gain = np.append(self._gain, gain)
        self._cost = np.concatenate([self._cost, np.where(margins >= 0.0, cost, np.inf)[None]])
