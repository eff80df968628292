"""Define the interface of all evaluators: labellings in, evaluations out."""

from __future__ import annotations

import math
import time
import zlib
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import repeat
from operator import attrgetter
from typing import Any, Final, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import ParameterError
from jld_core.limit import Proof
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.batch import BatchAnalysis
from jld_core.limit.options import SolveOptions, Status
from jld_core.models import limit_analysis, solve_labelling
from jld_core.models.solve_many import BatchResult
from jld_explore.space import count_named, values_of
from jld_explore.space.search_space import SearchSpace

SOLVE: Final = "solve"  # settled by a limit analysis of the labelling itself


BOUND: Final = "bound"  # the solve was omitted because the upper bound is too low to matter


@dataclass(frozen=True)
class Evaluation:
    """Result of evaluating one labelling; λ in scene units, NaN if not computed or infinite.

    With load cases all values except `cases` refer to the governing factor.

    Attributes
    ----------
    status : Status
        Status of the objective.
    low, high : float
        Proven bounds on λ of the objective.
    associative, zero_dilation : float
        λ with associative friction, and without dilation.
    settled : str
        `SOLVE`, or `BOUND` for a pruned labelling, of which only `high` is known.
    seconds : float
        Time spent on the labelling, s.
    cases : tuple of float
        λ of each load case, then at nominal material values; NaN where there is none.
    governing : int
        Position of the governing load case, −1 for a single load.
    """

    status: Status
    low: float
    high: float
    associative: float
    zero_dilation: float = math.nan
    settled: str = SOLVE
    seconds: float = 0.0
    cases: tuple[float, ...] = ()
    governing: int = -1

    @property
    def load_factor(self) -> float:
        """λ of the objective: without dilation if computed, else associative; NaN if pruned."""
        if self.settled == BOUND:
            return math.nan
        return self.associative if math.isnan(self.zero_dilation) else self.zero_dilation


# evaluation of a labelling whose worker died or hung twice
FAILED: Final = Evaluation(Status.FAILED, math.nan, math.nan, math.nan)


def evaluations_of(found: Sequence[Evaluation] | BatchResult) -> Sequence[Evaluation]:
    """Return the evaluations of a result of `jld_core.solve_many`, and evaluations as they are."""
    if not isinstance(found, BatchResult):
        if not isinstance(found, Sequence) or not all(isinstance(evaluation, Evaluation) for evaluation in found):
            raise ParameterError("evaluations", "they are wrong", "a list of them, or what solve_many returned")
        return found
    names = list(found.cases)
    cases = [tuple(case.load_factor[k] for case in found.cases.values()) for k in range(len(found))]
    dilatant = found.model.friction == "associative"
    value = found.load_factor.tolist()
    return [
        Evaluation(
            status,
            found.low[k],
            found.high[k],
            value[k] if dilatant else math.nan,
            math.nan if dilatant else value[k],
            cases=cases[k],
            governing=names.index(found.governing[k]) if names else -1,
        )
        for k, status in enumerate(found.status)
    ]


@dataclass(frozen=True)
class EvaluatorSettings:
    """Settings of an evaluator.

    Attributes
    ----------
    model : SolveOptions
        Friction model, tolerances and other options.
    use_batch_solver : bool
        Whether there are enough labellings to make the batch solver, which costs about ten solves.
    """

    model: SolveOptions = field(default_factory=SolveOptions)
    use_batch_solver: bool = True

    @property
    def batched(self) -> bool:
        """True if the batch solver is wanted, and the model has bounds over labellings."""
        return self.use_batch_solver and self.model.supports_bounds_over_labellings


class CutShort(list[Evaluation]):
    """Evaluations that were finished before one ended in an error, to be raised once they are recorded."""

    def __init__(self, finished: Iterable[Evaluation], error: Exception) -> None:
        super().__init__(finished)
        self.error = error

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (list(self), self.error)


class LabellingEvaluator(Protocol):
    """Evaluator of one assembly's labellings, each by its own alone, for one thread at a time."""

    @abstractmethod
    def evaluate_all(
        self, labellings: Bits, pruning_thresholds: Floats | None = None, deadline: Deadline | None = None
    ) -> list[Evaluation]:
        """Evaluate labellings (k, m), the first ones where the deadline passes.

        pruning_thresholds: (k,) λ, scene units, at or below which a labelling need not be solved to the end.
        """

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        """Evaluate one labelling (m,)."""
        return self.evaluate_all(labels[None], np.array([pruning_threshold]))[0]


@runtime_checkable
class SharedEvaluator(LabellingEvaluator, Protocol):
    """Evaluator that can share its batch solver with evaluators of other threads."""

    @property
    @abstractmethod
    def settles_nearly_all(self) -> bool:
        """True if the batch solver settles nearly all labellings, so that one process is enough."""

    @abstractmethod
    def twin(self) -> Self:
        """Return an evaluator with the same results for another thread, sharing the batch solver."""


# makes the evaluator of a worker; defined at module level so that it can be pickled
MakeEvaluator = Callable[[Assembly, EvaluatorSettings], LabellingEvaluator]


class Evaluator(SharedEvaluator):
    """Evaluator of labellings of one assembly under one load.

    The batch solver may be shared by several threads.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    settings : EvaluatorSettings
        Model and settings.
    share_batch_solver_with : Evaluator, optional
        Evaluator of the same assembly and settings whose batch solver is shared.
    """

    def __init__(
        self, assembly: Assembly, settings: EvaluatorSettings, share_batch_solver_with: Evaluator | None = None
    ) -> None:
        self.assembly, self.settings = assembly, settings
        self._shortest = self._batch_share = 0.0
        self._batch: BatchAnalysis | None
        if share_batch_solver_with is not None:
            self._batch = share_batch_solver_with._batch
        else:
            self._batch = BatchAnalysis.of(self._analysis) if settings.batched else None

    @cached_property
    def _analysis(self) -> LimitAnalysis:
        """Limit analysis for one labelling at a time, made on first use."""
        return limit_analysis(self.assembly, self.settings.model)

    def twin(self) -> Evaluator:
        return Evaluator(self.assembly, self.settings, self)

    @property
    def settles_nearly_all(self) -> bool:
        return self._batch is not None and self._batch.settles_most

    def evaluate_all(
        self, labellings: Bits, pruning_thresholds: Floats | None = None, deadline: Deadline | None = None
    ) -> list[Evaluation]:
        # See `LabellingEvaluator.evaluate_all`.
        if deadline is not None and deadline.passed():
            return []
        if deadline is not None and self._batch_share > 0.0:
            # no more than there is time for, at least one
            labellings = labellings[: max(1, int(min(deadline.remaining() / self._batch_share, len(labellings))))]
            pruning_thresholds = None if pruning_thresholds is None else pruning_thresholds[: len(labellings)]
        known = self._by_batch_solver(labellings)
        values = [-math.inf] * len(labellings) if pruning_thresholds is None else pruning_thresholds.tolist()
        evaluations: list[Evaluation] = []
        for labels, pruning_threshold, evaluation in zip(labellings, values, known, strict=True):
            if evaluation is None:
                # one that takes a second would surely end late
                if deadline is not None and deadline.remaining() <= self._shortest:
                    break
                evaluation = self._before_deadline(labels, pruning_threshold, deadline)
            if evaluation is None:
                break
            evaluations.append(evaluation)
        return evaluations

    def _before_deadline(self, labels: Bits, pruning_threshold: float, deadline: Deadline | None) -> Evaluation | None:
        """Evaluate one labelling; None if the deadline passes before λ without dilation is known."""
        if deadline is None or self.settings.model.friction == "associative":
            return self.evaluate(labels, pruning_threshold)
        with suppress(DeadlinePassed), deadline.enforced():
            evaluation = self.evaluate(labels, pruning_threshold)
            return None if deadline.passed() else evaluation
        return None

    def _by_batch_solver(self, labellings: Bits) -> list[Evaluation | None]:
        """Evaluate labellings by the batch solver; None where it proves nothing."""
        if self._batch is None:
            return [None] * len(labellings)
        start = time.perf_counter()
        batch_results = self._batch.prove(labellings)
        scale = self._batch.load
        low, high = (scale * batch_results.low).tolist(), (scale * batch_results.high).tolist()
        share = self._batch_share = (time.perf_counter() - start) / max(len(labellings), 1)
        evaluations: list[Evaluation | None] = []
        for k, (low_end, high_end) in enumerate(zip(low, high, strict=True)):
            status = batch_results.status(k)
            evaluations.append(
                None
                if status is None
                else Evaluation(status, low_end, high_end, 0.5 * (low_end + high_end), seconds=share)
            )
        return evaluations

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        start = time.perf_counter()
        proof = solve_labelling(self._analysis, labels, self.settings.model, pruning_threshold=pruning_threshold)
        evaluation = self._evaluation(proof, start)
        self._shortest = min(self._shortest or evaluation.seconds, evaluation.seconds)
        return evaluation

    def _evaluation(self, proof: Proof, start: float) -> Evaluation:
        """Convert the proof of a limit analysis, begun at `start`, to an evaluation (scene units)."""
        scale = self._analysis.template.scaling.load
        (low, high), load = proof.bracket, proof.load_factor
        if self.settings.model.ranks_by_lower_bound and not proof.outbid and proof.status is Status.COLLAPSE:
            return self._floor_evaluation(proof, scale, start)
        dilates = self.settings.model.friction == "associative"
        return Evaluation(
            status=proof.status,
            low=low * scale,
            high=high * scale,
            associative=(load if dilates else proof.associative) * scale,
            zero_dilation=math.nan if dilates or proof.outbid else load * scale,
            settled=BOUND if proof.outbid else SOLVE,
            seconds=time.perf_counter() - start,
        )

    def _floor_evaluation(self, proof: Proof, scale: float, start: float) -> Evaluation:
        """Convert a proof of a lower bound on λ over all solutions without dilation."""
        # `low` is the proven bound and `high` the lowest λ found.
        bound, found = proof.extra["lowest_proven"], proof.extra["lowest_found"]
        return Evaluation(
            status=Status.UNCERTIFIED if bound is None else Status.COLLAPSE,
            low=math.nan if bound is None else bound,
            high=math.nan if found is None else float(found),  # None if nothing was found in time
            associative=proof.associative * scale,
            zero_dilation=math.nan if bound is None else bound,
            settled=BOUND if bound is None else SOLVE,
            seconds=time.perf_counter() - start,
        )


# statuses in the order of the results table, best first: collapse alone has a finite λ to be raised
ORDER: Final = (Status.COLLAPSE, Status.LOCKED, Status.UNCERTIFIED, Status.UNSTABLE, Status.FAILED)


def comparison_value(evaluation: Evaluation) -> float:
    """Return λ of a collapse, the upper bound of a pruned labelling, else 0; scene units."""
    if evaluation.settled == BOUND:
        return evaluation.high
    return evaluation.load_factor if evaluation.status is Status.COLLAPSE else 0.0


def meets_requirement(space: SearchSpace, evaluation: Evaluation) -> bool:
    """Return whether a labelling provably reaches the required load factor, if any; locked ones do."""
    required = space.search.require
    if required is None or evaluation.status is Status.LOCKED:
        return True
    return evaluation.status is Status.COLLAPSE and evaluation.low >= required.threshold


def may_meet_requirement(space: SearchSpace, evaluation: Evaluation) -> bool:
    """Return False where a labelling provably misses the required load factor."""
    required = space.search.require
    if required is None or meets_requirement(space, evaluation):
        return True
    if evaluation.status is Status.UNSTABLE:
        return False
    # Solutions without dilation are not unique; the associative λ bounds all of them from above.
    high = evaluation.high if math.isnan(evaluation.zero_dilation) else evaluation.associative
    return not high < required.threshold


def objective_values(space: SearchSpace, labellings: Bits, evaluations: Sequence[Evaluation]) -> Floats:
    """Compute the objectives (k,), scene units of λ, that a driver maximises; 0 without a number."""
    # Without a requirement the objective is `comparison_value`. With a required load factor it is λ up to the
    # requirement. Beyond the requirement it grows with the quality of the first count of the scene's front.
    value = np.array([comparison_value(found) for found in evaluations], dtype=np.float64)
    required = space.search.require
    if required is None:
        return value
    met = np.array([meets_requirement(space, found) for found in evaluations], dtype=bool)
    share = 1.0 / (1.0 + abs(front_counts(space, labellings)[:, 0]))
    gain = share if space.search.front.axes[0][1] == "min" else 1.0 - share
    short = np.minimum(value, required.threshold * (1.0 - tolerances.PROVEN))
    return np.asarray(np.where(met, required.load_factor * (1.0 + gain), short))


def sort_key(evaluation: Evaluation, objective: float | None = None) -> tuple[int, float]:
    """Return the key that sorts evaluations, best first: rank of the status, minus objective."""
    rank = _status_rank(evaluation)
    return rank, -(comparison_value(evaluation) if objective is None else objective) if rank == 0 else 0.0


def _status_rank(evaluation: Evaluation) -> int:
    """Return the rank of the status in `ORDER`, 0 for an evaluation settled by a bound."""
    return 0 if evaluation.settled == BOUND else ORDER.index(evaluation.status)


def status_ranks(evaluations: Sequence[Evaluation]) -> Ints:
    """Return the rank (k,) of the status of each evaluation; 0 for collapse and for pruned ones."""
    return np.array([_status_rank(found) for found in evaluations], dtype=np.int64)


def front_counts(space: SearchSpace, labellings: Bits) -> Floats:
    """Compute the counts (k, c) of the scene's front, signed so that less is better."""
    graph, shapes = space.graph, space.limits.block_shapes
    found = [
        (-1.0 if sense == "max" else 1.0) * values_of(count_named(name), space.assembly, labellings, graph, shapes)
        for name, sense in space.search.front.axes
    ]
    return np.column_stack(found)


class Envelope:
    """Largest λ known among labellings whose counts are equal or better."""

    def __init__(self, size: int) -> None:
        self.values, self.counts = np.empty(0), np.empty((0, size))

    def learn(self, values: Floats, counts: Floats) -> Ints:
        """Add λ (k,) of labellings with counts (k, c), less is better; return which of old and new ones stay (n,)."""
        values, counts = np.concatenate([self.values, values]), np.concatenate([self.counts, counts])
        # Sort by descending λ: a later entry matters only if no earlier one has equal or better counts.
        order = np.lexsort((*counts.T, -values))
        values, counts = values[order], counts[order]
        kept = ~np.triu(_as_good(counts, counts), 1).any(axis=0)
        self.values, self.counts = values[kept], counts[kept]
        return np.asarray(order[kept])

    def best(self, counts: Floats) -> Floats:
        """Return (k,) largest λ known for counts (k, c) or better; −inf if nothing is known."""
        if not len(self.values):
            return np.full(len(counts), -np.inf)
        as_good = _as_good(self.counts, counts)
        return np.asarray(np.where(as_good, self.values[:, None], -np.inf).max(axis=0))


def _as_good(counts: Floats, others: Floats) -> Bools:
    """Return (a, b) True where counts (a, c) are equal to or better than others (b, c)."""
    found = np.ones((len(counts), len(others)), dtype=bool)
    for one, other in zip(counts.T, others.T, strict=True):
        found &= one[:, None] <= other[None]
    return found


def objectives(space: SearchSpace, labellings: Bits, evaluations: Sequence[Evaluation]) -> Floats:
    """Compute the objectives (k, 1 + c) that a driver minimises: −λ, 0 without one, and the counts."""
    return np.column_stack([-objective_values(space, labellings, evaluations), front_counts(space, labellings)])


Rows = NDArray[np.void]  # structured array of evaluations with the fields of `record_type`

_STATUSES: Final = tuple(Status)  # statuses; the position is the code in a row
_SETTLED: Final = (SOLVE, BOUND)  # ways in which a labelling is settled; the position is the code in a row
# Attributes of `Evaluation` that are stored as float64
_NUMBERS: Final = ("low", "high", "associative", "zero_dilation", "seconds")
# columns of the table of evaluations, without their number
COLUMNS: Final = ("labelling", "multiplicity", "status", "settled", *_NUMBERS, "governing", "cases", "checksum")

_CODES: Final = {str(status): code for code, status in enumerate(_STATUSES)}
_SETTLED_CODES: Final = {name: code for code, name in enumerate(_SETTLED)}
_STATUS_NAMES: Final = np.array([str(status) for status in _STATUSES], dtype=object)
_SETTLED_NAMES: Final = np.array(_SETTLED, dtype=object)
_numbers: Final = attrgetter(*_NUMBERS)


def record_type(faces: int, cases: int = 0) -> np.dtype[np.void]:
    """Return the structured type of one evaluation for m faces and c load cases, scene units."""
    fields = [(name, "<f8") for name in _NUMBERS]
    head = [("labelling", "u1", ((faces + 7) // 8,)), ("multiplicity", "<u4"), ("status", "u1"), ("settled", "u1")]
    return np.dtype([*head, *fields, ("governing", "<i4"), ("cases", "<f8", (cases,))])


def rows_of(
    kind: np.dtype[np.void], labellings: Bits, multiplicities: Sequence[int], found: Sequence[Evaluation]
) -> Rows:
    """Return the rows (k,) of evaluations of labellings (k, m), for a record or a table."""
    rows = np.zeros(len(found), dtype=kind)
    rows["labelling"] = np.packbits(labellings, axis=1)
    rows["multiplicity"] = multiplicities
    rows["status"] = [_CODES[evaluation.status] for evaluation in found]
    rows["settled"] = [_SETTLED_CODES[evaluation.settled] for evaluation in found]
    values = np.array([_numbers(evaluation) for evaluation in found], dtype=np.float64).reshape(-1, len(_NUMBERS))
    # The file has one zero and one NaN, so remove the sign of zeros and the payload of NaNs.
    values = np.where(np.isnan(values), np.nan, values + 0.0)
    for name, column in zip(_NUMBERS, values.T, strict=True):
        rows[name] = column
    rows["governing"] = [evaluation.governing for evaluation in found]
    if width := rows["cases"].shape[1]:
        cases = [evaluation.cases or (math.nan,) * width for evaluation in found]
        # Reshape also works for an empty list, if time ran out before the first evaluation.
        rows["cases"] = np.array(cases, dtype=np.float64).reshape(-1, width)
    return rows


def columns_of(rows: Rows) -> Iterator[tuple[Any, ...]]:
    """Yield each row as a tuple of the columns `COLUMNS`, as SQLite stores them."""
    # mypy takes seconds for the types of so many columns, which are any in the end
    columns: list[Iterable[Any]] = [
        keys_of(rows),
        rows["multiplicity"].tolist(),
        statuses(rows).tolist(),
        settled(rows).tolist(),
        *(rows[name].tolist() for name in _NUMBERS),
        rows["governing"].tolist(),
        (one.tobytes() for one in rows["cases"]) if rows["cases"].shape[1] else repeat(b"", len(rows)),
        checksums(rows),
    ]
    return zip(*columns, strict=True)


def from_columns(kind: np.dtype[np.void], content: Sequence[tuple[Any, ...]]) -> tuple[Rows, int | None]:
    """Return the rows of stored columns, and the index of the first row that is damaged."""
    # The index is that of the first wrong checksum, None if all are right.
    rows = np.zeros(len(content), dtype=kind)
    columns = dict(zip(COLUMNS, zip(*content, strict=True), strict=True))
    packed = np.frombuffer(b"".join(columns["labelling"]), np.uint8)
    rows["labelling"] = packed.reshape(len(rows), kind["labelling"].itemsize)
    rows["multiplicity"] = columns["multiplicity"]
    rows["status"] = [_CODES[name] for name in columns["status"]]
    rows["settled"] = [_SETTLED_CODES[name] for name in columns["settled"]]
    for name in _NUMBERS:
        rows[name] = np.array(columns[name], dtype=np.float64)
    rows["governing"] = columns["governing"]
    rows["cases"] = np.frombuffer(b"".join(columns["cases"]), "<f8").reshape(rows["cases"].shape)
    made, kept = checksums(rows), list(columns["checksum"])
    if made == kept:
        return rows, None
    return rows, next(n for n, (one, other) in enumerate(zip(made, kept, strict=True)) if one != other)


def keys_of(rows: Rows) -> list[bytes]:
    """Return the packed labelling of each row as bytes, by which a labelling is found."""
    width = rows.dtype["labelling"].itemsize
    content = rows["labelling"].tobytes()
    return [content[n : n + width] for n in range(0, len(content), width)]


def statuses(rows: Rows) -> NDArray[np.object_]:
    codes = rows["status"]
    return _STATUS_NAMES.take(codes)


def settled(rows: Rows) -> NDArray[np.object_]:
    """Return the way (k,) in which each row was settled, "solve" or "bound"."""
    codes = rows["settled"]
    return _SETTLED_NAMES.take(codes)


def load_factors(rows: Rows) -> Floats:
    zero = rows["zero_dilation"]
    found = np.where(np.isnan(zero), rows["associative"], zero)
    return np.asarray(np.where(rows["settled"] == _SETTLED_CODES[BOUND], np.nan, found))


def checksums(rows: Rows) -> list[int]:
    """Return the CRC-32 of each row's bytes."""
    raw, size = memoryview(rows.tobytes()), rows.dtype.itemsize
    return [zlib.crc32(raw[n : n + size]) for n in range(0, len(raw), size)]


def evaluation_of(row: np.void) -> Evaluation:
    status, settled_by = _STATUSES[row["status"]], _SETTLED[row["settled"]]
    low, high, associative, zero_dilation, seconds = (float(row[name]) for name in _NUMBERS)
    cases, governing = tuple(row["cases"].tolist()), int(row["governing"])
    return Evaluation(
        status, low, high, associative, zero_dilation, settled_by, seconds, cases=cases, governing=governing
    )
