"""Race layouts whose blocks crack anywhere: refine only what may still be the strongest.

Every velocity field bounds λ of all layouts, every stress field that of many. The layout with the greatest upper bound
is refined next; once its own bracket is closed, no other layout has a greater upper bound, and the race is decided.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import joblib
import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.fields.adaptive import CoarseBounds, Fields, FieldSetting
from jld_core.fields.mesh import Mesh
from jld_core.fields.transfer import FieldMechanism, FieldStresses
from jld_core.threads import one_thread
from jld_explore.evaluation.field_time import mesh_seconds, time_rate

_TOGETHER: Final = 4
"""Layouts refined at a time, whatever the number of jobs, so that results do not depend on it."""

_MOST_TRIANGLES: Final = 12_000
"""Triangles at which refinement of one layout ends."""

_CAUTION: Final = 1.5
"""Factor on the expected time of a mesh, which a busy machine exceeds."""

_PATIENCE: Final = 6
"""Meshes after which a layout without one of the bounds is given up."""


@dataclass(frozen=True)
class RaceResult:
    """Bounds on the governing factor of raced layouts.

    Attributes
    ----------
    low, high : (k, c) float array
        Bounds on λ of each layout under each load case, scene units; infinite where there is none.
    gap : float
        Relative distance between the best lower and the greatest upper bound on the governing factor.
    refined : int
        Layouts that were bounded on finer meshes.
    programs : int
        Cone programs solved.
    """

    low: Floats
    high: Floats
    gap: float
    refined: int
    programs: int


@dataclass(frozen=True)
class _Step:
    """What one mesh proves: bounds of its labelling, and of others; the next mesh, None where refinement ends; time."""

    bounds: tuple[float, float]
    stresses: FieldStresses | None
    mechanism: FieldMechanism | None
    finer: Mesh | None
    seconds: float


@one_thread()
def _step(setting: FieldSetting, labels: Bits, mesh: Mesh, enough: float) -> _Step:
    """Solve for both fields of one labelling on one mesh."""
    start = time.perf_counter()
    fields = Fields.on(setting, mesh, labels, enough)
    stresses, mechanism = fields.for_all
    finer = fields.finer()
    stops = len(finer) > _MOST_TRIANGLES or len(finer) == len(mesh)
    return _Step(fields.bounds, stresses, mechanism, None if stops else finer, time.perf_counter() - start)


@dataclass
class FieldRace:
    """Race of layouts of one assembly.

    Parameters
    ----------
    assembly : Assembly
        Planar assembly, with or without load cases.
    labellings : (k, m) bool array
        Layouts, True = dry.
    gap : float
        Relative distance between the best lower and the greatest upper bound at which the race is decided.
    deadline : Deadline, optional
        Time after which no further program is begun.
    jobs : int
        Number of processes; results do not depend on it.
    report : callable, optional
        Function called with the bounds (k,) on the governing factor while the race goes on.
    """

    assembly: Assembly
    labellings: Bits
    gap: float
    deadline: Deadline = field(default_factory=Deadline)
    jobs: int = 1
    report: Callable[[Floats, Floats], None] | None = None

    def __post_init__(self) -> None:
        """Set up the programs of the coarsest mesh for every load case."""
        self._settings = [FieldSetting.of(case) for case in self.assembly.by_case]
        self._coarse = [CoarseBounds(setting) for setting in self._settings]
        self._required = self.assembly.required
        count = len(self.labellings)
        self._low = np.full((count, len(self._settings)), -np.inf)
        self._high = np.full((count, len(self._settings)), np.inf)
        self._bounded = np.zeros(count, dtype=bool)
        self._given_up = np.zeros(count, dtype=bool)
        self._meshes: dict[tuple[int, int], Mesh] = {}
        self._steps: dict[tuple[int, int], int] = {}
        self._rate = 0.0
        self.programs = 0

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds (k, c) on λ under each load case, scene units."""
        return self._low, self._high

    def low(self) -> Floats:
        """Return lower bounds (k,) on the governing factor."""
        return np.asarray((self._low / self._required).min(axis=1))

    def high(self) -> Floats:
        """Return upper bounds (k,) on the governing factor."""
        return np.asarray((self._high / self._required).min(axis=1))

    def run(self) -> RaceResult:
        """Race until the strongest is known to the gap, nothing can be refined, or time is up.

        Returns
        -------
        RaceResult
            Bounds of all layouts, each proven.
        """
        # one layout is bounded however short the time is
        while not self.programs or not self.deadline.passed():
            low, high = self.low(), self.high()
            if self.report is not None:
                self.report(low, high)
            best = float(low.max(initial=-np.inf))
            running = ~self._given_up & ~_closed(low, high, self.gap) & (high > best)
            if not running.any() or _decided(best, float(high.max()), self.gap):
                break
            order = np.flatnonzero(running)
            order = order[np.argsort(-high[order], kind="stable")]
            if not self._bounded[order[0]]:
                self._bound(int(order[0]))
                continue
            self._refine(order[self._bounded[order]][:_TOGETHER], best)
        self._place(self.low(), self.high())
        low, high = self.low(), self.high()
        best, most = float(low.max(initial=-np.inf)), float(high.max(initial=-np.inf))
        gap = (most - best) / max(abs(most), abs(best), 1e-300) if math.isfinite(best) else math.inf
        refined = len({row for row, _ in self._steps})
        return RaceResult(self._low, self._high, max(gap, 0.0), refined, self.programs)

    def _bound(self, row: int) -> None:
        """Bound one layout from above on the coarsest mesh."""
        self._bounded[row] = True
        for case, coarse in enumerate(self._coarse):
            bound, mechanism = coarse.upper(self.labellings[row])
            self.programs += 1
            self._learn(row, case, (-math.inf, bound), None, mechanism)

    def _refine(self, rows: Ints, best: float) -> None:
        """Take one mesh further the weakest load case of each of some layouts."""
        tasks = []
        for row in rows.tolist():
            # the case that is known worst decides next
            case = int(np.argmin(self._low[row] / self._required))
            mesh = self._meshes.get((row, case), self._settings[case].coarse)
            if _CAUTION * mesh_seconds(self._rate, len(mesh)) > self.deadline.remaining():
                # it would be late
                self._given_up[row] = True
                continue
            enough = best * float(self._required[case])
            tasks.append((row, case, (self._settings[case], self.labellings[row], mesh, enough)))
        if self.jobs == 1 or len(tasks) <= 1:
            found = [_step(*arguments) for _, _, arguments in tasks]
        else:
            run = joblib.Parallel(n_jobs=min(self.jobs, len(tasks)))
            found = run(joblib.delayed(_step)(*arguments) for _, _, arguments in tasks)
        self.programs += 2 * len(tasks)
        for (row, case, _), step in zip(tasks, found, strict=True):
            triangles = len(self._meshes.get((row, case), self._settings[case].coarse))
            self._rate = max(self._rate, time_rate(step.seconds, triangles))
            self._steps[row, case] = self._steps.get((row, case), 0) + 1
            self._learn(row, case, step.bounds, step.stresses, step.mechanism)
            lacking = not (math.isfinite(self._low[row, case]) and math.isfinite(self._high[row, case]))
            if step.finer is None or (lacking and self._steps[row, case] >= _PATIENCE):
                self._given_up[row] = True
            else:
                self._meshes[row, case] = step.finer

    def _learn(
        self,
        row: int,
        case: int,
        bounds: tuple[float, float],
        stresses: FieldStresses | None,
        mechanism: FieldMechanism | None,
    ) -> None:
        """Take the bounds of one layout under one load case, and those its fields give others."""
        low, high = self._low[:, case], self._high[:, case]
        if stresses is not None:
            np.maximum(low, stresses.bounds(self.labellings), out=low)
        if mechanism is not None:
            np.minimum(high, mechanism.bounds(self.labellings), out=high)
        low[row], high[row] = max(low[row], bounds[0]), min(high[row], bounds[1])

    def _place(self, low: Floats, high: Floats) -> None:
        """Bound all layouts that may still tie with the best from below, on the coarsest mesh."""
        rows = np.flatnonzero((high >= low.max(initial=-np.inf)) & ~np.isfinite(low))
        for row in rows[np.argsort(-high[rows], kind="stable")].tolist():
            for case, coarse in enumerate(self._coarse):
                if self.deadline.passed() and math.isfinite(self.low().max()):
                    return
                if not math.isfinite(self._low[row, case]):
                    bound, stresses = coarse.lower(self.labellings[row])
                    self.programs += 1
                    self._learn(row, case, (bound, math.inf), stresses, None)


def _closed(low: Floats, high: Floats, gap: float) -> Bools:
    """Return for each layout whether its own bracket is as narrow as the gap."""
    known = np.isfinite(low) & np.isfinite(high)
    low, high = np.where(known, low, 0.0), np.where(known, high, 0.0)
    return np.asarray(known & (high - low <= gap * np.maximum(abs(high), abs(low))))


def _decided(best: float, most: float, gap: float) -> bool:
    """Return whether no layout can be stronger than the best by more than the gap."""
    return math.isfinite(best) and math.isfinite(most) and most - best <= gap * max(abs(most), abs(best))
