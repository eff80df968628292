"""Evaluate labellings whose blocks crack along finer cells, or anywhere by fields."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.fields.bounds import CoarseBounds, Fields, FieldSetting
from jld_core.fields.mesh import Mesh
from jld_core.fields.transfer import FieldMechanism, FieldStresses
from jld_core.limit import CaseBounds, governing
from jld_core.limit.options import Status
from jld_core.refinement.refine import CrackCells
from jld_core.threads import one_thread
from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.pool import Pool
from jld_explore.evaluation.protocol import BOUND, SOLVE, Envelope, Evaluation, EvaluatorSettings, LabellingEvaluator


def field_evaluation(
    low: Floats,
    high: Floats,
    required: Floats,
    *,
    most: float = math.inf,
    best: float = -math.inf,
    seconds: float = 0.0,
    nominal: float | None = None,
) -> Evaluation:
    """Return the evaluation of bounds by fields (c,) on λ under each case; λ is the lower bound."""
    lowest, most = float((low / required).min()), min(most, float((high / required).min()))
    several = len(low) > 1
    cases = tuple(float(value) if math.isfinite(value) else math.nan for value in low) if several else ()
    if nominal is not None:
        # with nominal values the entries of load cases and then that value are expected
        cases = (*cases, nominal if math.isfinite(nominal) else math.nan)
    bounds = [
        CaseBounds(Status.COLLAPSE, below, above, below)
        for below, above in zip(low.tolist(), high.tolist(), strict=True)
    ]
    case = governing(bounds, required.tolist()).case if several else -1
    nan = math.nan
    low_end, high_end = (end if math.isfinite(end) else nan for end in (lowest, most))
    if most < 0.0:
        status, low_end, high_end, value, settled = Status.UNSTABLE, nan, nan, nan, SOLVE
    elif math.isfinite(lowest) and math.isfinite(most):
        status, value, settled = Status.COLLAPSE, lowest, SOLVE
    else:
        status, value = Status.UNCERTIFIED, nan
        settled = BOUND if math.isnan(low_end) and most < best else SOLVE
    return Evaluation(status, low_end, high_end, value, settled=settled, seconds=seconds, cases=cases, governing=case)


_TOGETHER: Final = 16  # most labellings that are bounded together: two vectors of the widest processors

# Time that labellings take together above which fewer are, as time limits are kept between them; s
_SECONDS: Final = 0.25


class FieldEvaluator(LabellingEvaluator):
    """Evaluator of labellings by fields on the coarsest mesh, under all load cases."""

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings | None = None) -> None:
        self._coarse = [CoarseBounds(FieldSetting.of(case)) for case in assembly.by_case]
        self._required, self._count = assembly.required, 1
        self._nominal: list[CoarseBounds] | None = None
        if assembly.has_low_values:
            self._nominal = [CoarseBounds(FieldSetting.of(case)) for case in assembly.at_nominal.by_case]

    def evaluate_all(
        self, labellings: Bits, pruning_thresholds: Floats | None = None, deadline: Deadline | None = None
    ) -> list[Evaluation]:
        # Pruning thresholds are ignored: bounds by fields have no cheap part.
        evaluations: list[Evaluation] = []
        while len(evaluations) < len(labellings) and not (deadline is not None and deadline.passed()):
            start = time.perf_counter()
            evaluations += self._together(labellings[len(evaluations) : len(evaluations) + self._count])
            # how many are taken together does not change their bounds
            late = time.perf_counter() - start > _SECONDS
            self._count = max(1, self._count // 2) if late else min(_TOGETHER, 2 * self._count)
        return evaluations

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        return self._together(labels[None])[0]

    def _together(self, labellings: Bits) -> list[Evaluation]:
        start = time.perf_counter()
        lows, highs = np.moveaxis(np.array([coarse.both(labellings) for coarse in self._coarse]), 1, 0)
        nominal: list[float | None] = [None] * len(labellings)
        if self._nominal is not None:
            least = np.array([coarse.both(labellings)[0] for coarse in self._nominal])
            nominal = [float(value) for value in (least / self._required[:, None]).min(axis=0)]
        seconds = (time.perf_counter() - start) / len(labellings)
        return [
            field_evaluation(low, high, self._required, seconds=seconds, nominal=value)
            for low, high, value in zip(lows.T, highs.T, nominal, strict=True)
        ]


@dataclass(frozen=True)
class MakeCellEvaluator:
    """Maker of evaluators on finer cells, which can be sent to the workers of a study."""

    cells: CrackCells  # the cells, and the joint face of each of their faces

    def __call__(self, assembly: Assembly, settings: EvaluatorSettings) -> LabellingEvaluator:
        """Return an evaluator of labellings of the joint grid that solves the finer cells."""
        return CellEvaluator(self.cells, settings)


class CellEvaluator(LabellingEvaluator):
    """Evaluator of labellings of the joint grid on finer cells, whose faces share labels."""

    def __init__(self, cells: CrackCells, settings: EvaluatorSettings) -> None:
        self._cells, self._fine = cells, evaluator_of(cells.fine, settings)

    def evaluate_all(
        self, labellings: Bits, pruning_thresholds: Floats | None = None, deadline: Deadline | None = None
    ) -> list[Evaluation]:
        return self._fine.evaluate_all(self._cells.labels(labellings), pruning_thresholds, deadline)

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        return self._fine.evaluate(self._cells.labels(labels), pruning_threshold)


TIME_POWER: Final = 1.3  # power of the number of triangles that the time of a large mesh grows with


def time_rate(seconds: float, triangles: float) -> float:
    """Return the time of a mesh over the power `TIME_POWER` of its number of triangles."""
    return float(seconds / triangles**TIME_POWER)


def mesh_seconds(rate: float, triangles: float) -> float:
    """Return the expected processor time of bounds by fields on a mesh."""
    return float(rate * triangles**TIME_POWER)


# rate of both bounds on a coarsest mesh, s; a mesh of 60 triangles takes 24 ms
COARSE_RATE: Final = time_rate(0.024, 60)


TOGETHER: Final = 4  # layouts refined at a time, whatever the number of jobs, so that results do not depend on it

_MOST_TRIANGLES: Final = 12_000  # triangles at which refinement of one layout ends

_CAUTION: Final = 1.5  # factor on the expected time of a mesh, which a busy machine exceeds

_PATIENCE: Final = 6  # meshes after which a layout without one of the bounds is given up


@dataclass(frozen=True)
class FieldStep:
    """Bounds that one mesh proves for one labelling under one load case."""

    # lower and upper bound on λ of the labelling, scene units; infinite where there is none
    bounds: tuple[float, float]
    # stresses, mechanism: fields of the mesh, which bound other labellings as well
    stresses: FieldStresses | None
    mechanism: FieldMechanism | None
    finer: Mesh | None  # the next mesh, None where refinement ends
    seconds: float  # wall-clock time, s
    more: Any = None  # additional result of the function that made the step, None if there is none


def step_of(fields: Fields, start: float, more: Any = None) -> FieldStep:
    """Make the `FieldStep` of fields that have been solved: their bounds and the next mesh."""
    stresses, mechanism = fields.for_all
    finer = fields.finer()
    stops = len(finer) > _MOST_TRIANGLES or len(finer) == len(fields.mesh)
    return FieldStep(fields.bounds, stresses, mechanism, None if stops else finer, time.perf_counter() - start, more)


@one_thread()
def refined_step(setting: FieldSetting, labels: Bits, mesh: Mesh, required: float, enough: float) -> FieldStep:
    """Solve for both fields of a labelling (m,) on a mesh; no stresses if λ / required is below `enough`."""
    start = time.perf_counter()
    return step_of(Fields.on(setting, mesh, labels, enough * required), start)


class FieldPool:
    """Bounds on λ of many labellings of one planar assembly, by stress and velocity fields."""

    def __init__(self, assembly: Assembly, labellings: Bits, deadline: Deadline | None = None, jobs: int = 1) -> None:
        self.deadline, self.tasks = Deadline() if deadline is None else deadline, Pool(jobs)
        self.settings = [FieldSetting.of(case) for case in assembly.by_case]
        self._coarse: list[CoarseBounds] | None = None
        self.required = assembly.required
        self.labellings = np.empty((0, len(assembly.interfaces)), dtype=bool)
        self._low, self._high = np.empty((2, 0, len(self.settings)))
        self._least, self._most = np.empty((2, 0))
        self.bounded = np.zeros(0, dtype=bool)
        self.given_up = np.zeros(0, dtype=bool)  # refined no more, even if their brackets are wide
        self._meshes: dict[tuple[int, int], Mesh] = {}
        self._steps: dict[tuple[int, int], int] = {}
        # time of a mesh over a power of its triangles, s; cone programs solved; whether time ended a refinement
        self.rate, self.programs, self.late = 0.0, 0, False
        self.add(labellings)

    def add(
        self, labellings: Bits, low: Floats | None = None, high: Floats | None = None, cases: Floats | None = None
    ) -> None:
        """Add labellings (k, m) with known bounds (k,), NaN if unknown, and lower bounds (k, c) of cases."""
        count, several = len(labellings), len(self.settings)
        self.labellings = np.concatenate([self.labellings, labellings])
        lowest = np.full((count, several), -np.inf)
        self._low = np.concatenate([self._low, lowest if cases is None else np.fmax(lowest, cases)])
        self._high = np.concatenate([self._high, np.full((count, several), np.inf)])
        least = np.full(count, -np.inf) if low is None else np.where(np.isnan(low), -np.inf, low)
        most = np.full(count, np.inf) if high is None else np.where(np.isnan(high), np.inf, high)
        self._least, self._most = np.concatenate([self._least, least]), np.concatenate([self._most, most])
        self.bounded = np.concatenate([self.bounded, np.isfinite(most)])
        self.given_up = np.concatenate([self.given_up, np.zeros(count, dtype=bool)])

    def take_from(self, other: FieldPool) -> None:
        """Take over the bounds and the number of programs of another pool of the same assembly."""
        row_of = {labels.tobytes(): row for row, labels in enumerate(self.labellings)}
        ends = zip(other.low().tolist(), other.high().tolist(), strict=True)
        for other_row, (labels, (low, high)) in enumerate(zip(other.labellings, ends, strict=True)):
            row = row_of.get(labels.tobytes())
            if row is not None:
                self._low[row] = np.maximum(self._low[row], other._low[other_row])
                self._high[row] = np.minimum(self._high[row], other._high[other_row])
                self._least[row], self._most[row] = max(self._least[row], low), min(self._most[row], high)
        self._steps.update(other._steps)
        self.programs += other.programs

    def cap(self, high: Floats) -> None:
        """Lower the upper bounds on the governing factor to values (k,) proven elsewhere."""
        self._most = np.minimum(self._most, high)

    def __len__(self) -> int:
        return len(self.labellings)

    @property
    def refined(self) -> int:
        return len({row for row, _ in self._steps})

    @property
    def coarse(self) -> list[CoarseBounds]:
        """Bounds on the coarsest mesh under each load case, set up when first needed."""
        if self._coarse is None:
            self._coarse = [CoarseBounds(setting) for setting in self.settings]
        return self._coarse

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds (k, c) on λ under each load case, scene units, infinite where unknown."""
        # bounds on the governing factor that were known before hold for every case from below
        return np.maximum(self._low, self._least[:, None] * self.required), self._high

    def low(self) -> Floats:
        """Return the lower bounds (k,) on the governing factor, −inf where there is none."""
        return np.asarray(np.maximum(self._least, (self._low / self.required).min(axis=1)))

    def high(self) -> Floats:
        """Return the upper bounds (k,) on the governing factor, inf where there is none."""
        return np.asarray(np.minimum(self._most, (self._high / self.required).min(axis=1)))

    def closed(self, gap: float) -> Bools:
        """Return the labellings (k,) whose bounds, both known, lie within a relative gap."""
        low, high = self.low(), self.high()
        known = np.isfinite(low) & np.isfinite(high)
        low, high = np.where(known, low, 0.0), np.where(known, high, 0.0)
        return np.asarray(known & (high - low <= gap * np.maximum(abs(high), abs(low))))

    def bound_above(self, row: int) -> None:
        """Bound a labelling from above on the coarsest mesh, and others by its mechanisms."""
        self.bounded[row] = True
        for case, coarse in enumerate(self.coarse):
            bound, mechanism = coarse.upper(self.labellings[row])
            self.programs += 1
            self._learn(row, case, (-math.inf, bound), None, mechanism)

    def bound_below(self, row: int) -> None:
        """Bound a labelling from below on the coarsest mesh, and others by its stresses."""
        for case, coarse in enumerate(self.coarse):
            if not math.isfinite(self._low[row, case]):
                bound, stresses = coarse.lower(self.labellings[row])
                self.programs += 1
                self._learn(row, case, (bound, math.inf), stresses, None)

    def _next(self, row: int) -> tuple[int, Mesh]:
        """Return the load case of least lower bound, and the mesh on which a labelling is refined next."""
        case = int(np.argmin(self._low[row] / self.required))
        return case, self._meshes.get((row, case), self.settings[case].coarse)

    def expected_seconds(self, row: int) -> float:
        """Return the expected time of the next mesh of a labelling, s; 0 if unknown."""
        return mesh_seconds(self.rate, len(self._next(row)[1]))

    def refine(
        self,
        rows: Sequence[int],
        enough: Floats,
        step: Callable[..., FieldStep] = refined_step,
        more: tuple[Any, ...] = (),
    ) -> list[tuple[int, int, Mesh, FieldStep]]:
        """Refine labellings by one mesh: row, load case, mesh and step of each; hopeless ones are given up."""
        tasks: list[tuple[int, int, Mesh, tuple[Any, ...]]] = []
        for row in rows:
            case, mesh = self._next(row)
            seconds = _CAUTION * mesh_seconds(self.rate, len(mesh))
            if seconds > self.deadline.remaining():
                self.given_up[row] = self.late = True
                continue
            if (len(tasks) // self.tasks.jobs + 1) * seconds > self.deadline.remaining():
                break  # it is refined later, if there is time for it beside the others
            required, least = float(self.required[case]), float(enough[row])
            tasks.append((row, case, mesh, (self.settings[case], self.labellings[row], mesh, required, least, *more)))
        found = list(self.tasks.run(step, [arguments for *_, arguments in tasks]))
        self.programs += 2 * len(tasks)
        for (row, case, mesh, _), one in zip(tasks, found, strict=True):
            self.rate = max(self.rate, time_rate(one.seconds, len(mesh)))
            self._steps[row, case] = self._steps.get((row, case), 0) + 1
            self._learn(row, case, one.bounds, one.stresses, one.mechanism)
            lacking = not (math.isfinite(self._low[row, case]) and math.isfinite(self._high[row, case]))
            if one.finer is None or (lacking and self._steps[row, case] >= _PATIENCE):
                self.given_up[row] = True
            else:
                self._meshes[row, case] = one.finer
        return [(row, case, mesh, one) for (row, case, mesh, _), one in zip(tasks, found, strict=True)]

    def _learn(
        self,
        row: int,
        case: int,
        bounds: tuple[float, float],
        stresses: FieldStresses | None,
        mechanism: FieldMechanism | None,
    ) -> None:
        """Update the bounds under one load case: of one labelling, and of all by its fields."""
        low, high = self._low[:, case], self._high[:, case]
        if stresses is not None:
            np.maximum(low, stresses.bounds(self.labellings), out=low)
        if mechanism is not None:
            np.minimum(high, mechanism.bounds(self.labellings), out=high)
        low[row], high[row] = max(low[row], bounds[0]), min(high[row], bounds[1])


class RaceAim(Protocol):
    """Aim of a race of k layouts, by their proven bounds: which to refine next, when it is decided."""

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        """Return the layouts (k,) to refine; none once decided. closed: (k,) both bounds within `gap`."""
        ...

    def order(self, rows: Ints, high: Floats) -> Ints: ...

    def enough(self, low: Floats) -> Floats:
        """Return the factor (k,) below which a lower bound does not matter."""
        ...


class BestAim:
    """Aim for the strongest layout, in order of upper bounds, until no other can be stronger."""

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        best, most = low.max(initial=-np.inf), high.max(initial=-np.inf)
        if _near(np.asarray(best), np.asarray(most), gap):
            return np.zeros(len(low), dtype=bool)
        return np.asarray(~closed & (high > best))

    def order(self, rows: Ints, high: Floats) -> Ints:
        """Return `rows` sorted by upper bound, the greatest first."""
        return rows[np.argsort(-high[rows], kind="stable")]

    def enough(self, low: Floats) -> Floats:
        """Return the best lower bound, the same for all layouts."""
        return np.full(len(low), low.max(initial=-np.inf))


class FrontAim(BestAim):
    """Aim for the strongest layout of every combination of counts (k, c), less is better."""

    def __init__(self, counts: Floats) -> None:
        self._counts = counts

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        return np.asarray(~closed & ~_near(self.enough(low), high, gap) & (high > self.enough(low)))

    def enough(self, low: Floats) -> Floats:
        """Return, for each layout, the best lower bound among equal or better counts. See `RaceAim.enough`."""
        envelope = Envelope(self._counts.shape[1])
        known = np.isfinite(low)
        envelope.learn(low[known], self._counts[known])
        return envelope.best(self._counts)


class RequirementAim:
    """Aim for the best count (k,), less is better, among layouts that carry a required factor."""

    def __init__(self, required: float, counts: Floats) -> None:
        self._required, self._counts = required, counts

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        met = low >= self._required
        best = self._counts[met].min(initial=np.inf)
        return np.asarray(~met & (high >= self._required) & (self._counts < best))

    def order(self, rows: Ints, high: Floats) -> Ints:
        """Return `rows` sorted by count, then by upper bound, the best first. See `RaceAim.order`."""
        return rows[np.lexsort((-high[rows], self._counts[rows]))]

    def enough(self, low: Floats) -> Floats:
        return np.full(len(low), self._required)


def _near(best: Floats, most: Floats, gap: float) -> Bools:
    """Return True where both bounds are finite and differ by at most a relative gap."""
    known = np.isfinite(best) & np.isfinite(most)
    low, high = np.where(known, best, 0.0), np.where(known, most, 0.0)
    return np.asarray(known & (high - low <= gap * np.maximum(abs(high), abs(low))))


@dataclass(frozen=True)
class RaceResult:
    # low, high: (k, c) bounds on λ of each layout under each load case, scene units; infinite where there is none
    low: Floats
    high: Floats
    gap: float  # relative distance between the best lower and the greatest upper bound on the governing factor
    refined: int  # number of layouts that were refined
    programs: int  # number of cone programs solved
    decided: bool  # True if the aim asks for no further refinement
    best: tuple[float, float]  # greatest lower and greatest upper bound on the governing factor
    rivals: int  # number of layouts whose upper bound is at least the best lower bound, the best layout included


class FieldRace:
    """Race of a pool's layouts: those that may still be the strongest get finer meshes; decided at `gap`."""

    def __init__(
        self,
        pool: FieldPool,
        gap: float,
        report: Callable[[Floats, Floats], None] | None = None,
        aim: RaceAim | None = None,
    ) -> None:
        self.pool, self._gap, self._report = pool, gap, report
        self._aim: RaceAim = BestAim() if aim is None else aim

    def run(self) -> RaceResult:
        """Race until the aim is reached to the gap, nothing can be refined, or time is up; proven bounds of all."""
        pool, begun = self.pool, False
        # one layout is bounded however short the time is
        while len(pool) and (not begun or not pool.deadline.passed()):
            low, high = pool.low(), pool.high()
            if self._report is not None:
                self._report(low, high)
            begun |= bool(np.isfinite(high).any())
            left = ~pool.given_up & self._aim.open(low, high, pool.closed(self._gap), self._gap)
            if not left.any():
                break
            order = self._aim.order(np.flatnonzero(left), high)
            if not pool.bounded[order[0]]:
                pool.bound_above(int(order[0]))
            else:
                pool.refine(order[pool.bounded[order]][:TOGETHER].tolist(), self._aim.enough(low))
        self._place()
        return self.result()

    def _place(self) -> None:
        """Bound from below, on the coarsest mesh, layouts that may be the strongest, greatest upper bounds first."""
        pool = self.pool
        low, high = pool.low(), pool.high()
        rows = np.flatnonzero((high >= low.max(initial=-np.inf)) & ~np.isfinite(low))
        for row in rows[np.argsort(-high[rows], kind="stable")].tolist():
            if pool.deadline.passed() and math.isfinite(pool.low().max()):
                return
            pool.bound_below(row)

    def result(self) -> RaceResult:
        pool = self.pool
        low, high = pool.low(), pool.high()
        best, most = float(low.max(initial=-np.inf)), float(high.max(initial=-np.inf))
        gap = (most - best) / max(abs(most), abs(best), 1e-300) if math.isfinite(best) else math.inf
        decided = not self._aim.open(low, high, pool.closed(self._gap), self._gap).any() and math.isfinite(best)
        rivals = int((high >= best).sum())
        bounds, least = pool.bounds, max(gap, 0.0)
        return RaceResult(*bounds, least, pool.refined, pool.programs, decided, (best, most), rivals)
