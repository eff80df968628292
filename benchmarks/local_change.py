"""What a solved labelling says about its neighbours in the anneal driver: warm starts, and its own two bounds.

Layouts are drawn at random, or are those of the chains of the anneal driver after some evaluations. Each is changed as
that driver changes it. First table: the batch solver from its own starting point, and from the converged forces and
velocities of the layout that was changed, in the same groups of one layout's changes. The start is shifted into the
interior: slacks and multipliers are at least the shift, as scaled numbers. "Half way" takes the mean of both starts,
and the last start is common to all changes: 0.7 of the mean solution of all layouts of the sample. Times are the least
of three in turns. A
labelling counts as wrong if both starts prove it and their λ differ by more than 1e-6. Second table: the mechanism of
the layout, weighed on the changed layout, is an upper bound on its λ; its forces, where they are admissible, are a
lower one. Weaker, equal and better compare λ with that of the layout, within 1e-6. "Below λ" rejects a weaker change
without a solve; "up to λ" says only that a change is no improvement. "Any known" weighs all mechanisms of the sample.
Cost: processor time of weighing the own mechanism and forces, relative to a fresh solve. The driver accepts equal and
somewhat weaker changes, takes the best of four, and records λ of each: only "below λ" could spare solves.
`python -m benchmarks.local_change` writes both tables in less than a minute.
"""

from __future__ import annotations

import os
import time
from copy import copy
from dataclasses import dataclass, replace
from typing import Final
from unittest.mock import patch

import numpy as np

from benchmarks.common import about, table, write
from benchmarks.search_scenes import LARGE, built
from jld_core.arrays import Bits, Floats
from jld_core.batch import batch_solver
from jld_core.batch.batch_solver import BatchSolver
from jld_core.batch.verdicts import OPEN, PROVEN, BatchResults
from jld_core.limit import LimitAnalysis, Motion
from jld_explore.drivers.anneal import Anneal
from jld_explore.evaluation import EvaluatorSettings
from jld_explore.evaluation.evaluator import Evaluator
from jld_explore.space import SearchSpace

SCENES: Final = {"planar 88 faces": (24, 1500), "planar 278 faces": (12, 1500)}
"""Random layouts of each scene, and evaluations of the anneal driver before its chains are taken."""

CHANGES: Final = 16
"""Changes of each layout: they fill all lanes of the batch solver in groups of one layout."""

SAME: Final = 1e-6
"""Relative difference below which two λ are one."""

NOISE: Final = 1e-7
"""Margin and slack, scaled, below which a violation counts as rounding; an opening motion repairs that of margins."""

STARTS: Final = {
    "shift 1": (1.0, 1.0, 1.0),
    "shift 0.3": (1.0, 0.3, 0.3),
    "shift 0.1": (1.0, 0.1, 0.1),
    "shift 0.01": (1.0, 0.01, 0.01),
    "shift 1e-3": (1.0, 1e-3, 1e-3),
    "half way, shift 1": (0.5, 1.0, 1.0),
    "half way, shift 0.3": (0.5, 0.3, 0.3),
    "mean of the layouts": (0.7, 1.0, 1.0),
}
"""Weight of the known solution, least slack and least multiplier of each start."""

COMMON: Final = "mean of the layouts"
"""Start that all changes share: the mean solution of all layouts of the sample in the place of that of one."""

TURNS: Final = 3
"""Pairs of solves, in turns; the least time of each is given."""


@dataclass(frozen=True)
class Sample:
    """Layouts (k, m) with their solutions, and changes (j, m) of the layout `of` (j,) each."""

    layouts: Bits
    known: BatchResults
    changes: Bits
    of: np.ndarray[tuple[int], np.dtype[np.int64]]


def annealed(space: SearchSpace, evaluator: Evaluator, evaluations: int) -> tuple[Anneal, Bits]:
    """Run the anneal driver; return it and the different layouts of its chains."""
    driver, done = Anneal(space), 0
    while done < evaluations:
        rows = driver.ask()
        driver.tell(rows, evaluator.evaluate_all(rows))
        done += len(rows)
    found = [chain.labelling for chain in driver._chains if chain.labelling is not None]
    return driver, np.unique(np.array(found), axis=0)


def sample(driver: Anneal, analysis: LimitAnalysis, solver: BatchSolver, layouts: Bits) -> Sample:
    """Solve layouts, and change each that is proven as the anneal driver does."""
    known = solver.solve(layouts, vectors=True)
    proven = known.verdict == PROVEN
    layouts, known = layouts[proven], solver.solve(layouts[proven], vectors=True)
    jumps = [analysis.prover.motion(one, row).jumps for one, row in zip(known.velocities, layouts, strict=True)]
    size = abs(np.array(jumps)).max(axis=2)
    moving = size / size.max(axis=1, keepdims=True)
    follow = driver._follow
    parts = follow.parts(layouts)
    changes: list[Bits] = []
    of: list[int] = []
    for number, row in enumerate(layouts):
        found: dict[bytes, Bits] = {}
        for _ in range(10 * CHANGES):
            rows, _ = follow.changes(row[None], [parts[number]], moving[number][None], driver.rng)
            rows = driver.register.admit(rows)
            found.update((one.tobytes(), one) for one in rows)
            if len(found) >= CHANGES:
                break
        changes += list(found.values())
        of += [number] * len(found)
    return Sample(layouts, known, np.array(changes), np.array(of))


def started(
    solver: BatchSolver, analysis: LimitAnalysis, known: BatchResults, k: int | slice, weight: float
) -> BatchSolver:
    """A batch solver that starts at a mean of its own start and of known solutions: of one layout, or of a slice."""
    assert known.forces is not None
    own, other = solver._start, copy(solver)
    speed = np.atleast_2d(known.velocities[k]).mean(axis=0)
    forces = known.forces[k].reshape(-1, *own.forces.shape).mean(axis=0)
    jumps = (analysis.template.matrix.T @ speed).reshape(own.jumps.shape)
    other._start = batch_solver._Start(
        np.ascontiguousarray(weight * forces + (1.0 - weight) * own.forces),
        np.ascontiguousarray(weight * jumps + (1.0 - weight) * own.jumps),
        np.ascontiguousarray(weight * speed[solver._ends] + (1.0 - weight) * own.speed),
        weight * float(known.low[k].mean()) + (1.0 - weight) * own.load,
        own.least_slack,
    )
    return other


@dataclass
class Solved:
    """Results of all changes from one kind of start: bounds, verdicts, iterations, passes; processor time."""

    low: Floats
    high: Floats
    verdict: np.ndarray[tuple[int], np.dtype[np.int32]]
    iterations: Floats
    tries: Floats
    seconds: float


def solved(solver: BatchSolver, analysis: LimitAnalysis, given: Sample, start: str | None) -> Solved:
    """Solve all changes, those of one layout in one call; the time leaves out how a start is made."""
    parts, seconds = [], 0.0
    for k in range(len(given.layouts)):
        rows = given.changes[given.of == k]
        used, push = solver, batch_solver._PUSH
        if start is not None:
            weight, slack, push = STARTS[start]
            used = started(solver, analysis, given.known, slice(None) if start == COMMON else k, weight)
            used._start = replace(used._start, least_slack=slack)
        with patch.object(batch_solver, "_PUSH", push):
            begun = time.process_time()
            parts.append(used.solve(rows))
            seconds += time.process_time() - begun
    low, high, verdict, iterations, tries = (
        np.concatenate([getattr(one, name) for one in parts])
        for name in ("low", "high", "verdict", "iterations", "tries")
    )
    return Solved(low=low, high=high, verdict=verdict, iterations=iterations, tries=tries, seconds=seconds)


def opened(analysis: LimitAnalysis, velocity: Floats, labels: Bits, opening: Motion) -> Motion:
    """A motion with finite dissipation under every label of every face at which it is not by more than rounding."""
    motion, sets = analysis.prover.motion(velocity, labels), analysis.template.yield_set
    both = (np.ones_like(labels), np.zeros_like(labels))
    margins = np.array([sets.margin(motion.jumps, row) for row in both])
    wide = min(float(sets.margin(opening.jumps, row).min()) for row in both)
    lacking = -margins[(margins < 0.0) & (margins > -NOISE * abs(motion.jumps).max())]
    if not lacking.size or not wide > 0.0:
        return motion
    return analysis.prover.motion(motion.velocity + 2.0 * lacking.max() / wide * opening.velocity, labels)


def dissipations(analysis: LimitAnalysis, motion: Motion) -> tuple[Floats, float]:
    """Dissipation (2, m) of each face if it is inner or dry, infinite without margin, and work of the dead load."""
    sets, shape = analysis.template.yield_set, motion.jumps.shape[0]
    rows = [np.full(shape, label) for label in (False, True)]
    found = [
        np.where(sets.margin(motion.jumps, row) >= 0.0, sets.dissipation(motion.jumps, row), np.inf) for row in rows
    ]
    return np.array(found), float(analysis.template.dead @ motion.velocity)


def uppers(weighed: tuple[Floats, float], changes: Bits) -> Floats:
    """Upper bounds of changes (j, m) by one mechanism, given its dissipations."""
    return np.asarray(np.where(changes, weighed[0][1], weighed[0][0]).sum(axis=1) - weighed[1])


def screened(analysis: LimitAnalysis, given: Sample) -> tuple[Floats, Floats, Floats, float]:
    """Bounds of all changes by what is known: upper ones by the own mechanism and by any, whether forces hold, time."""
    opening, sets = analysis.repair.opening(), analysis.template.yield_set
    assert opening is not None
    assert given.known.forces is not None
    own, hold = np.empty(len(given.changes)), np.empty(len(given.changes), dtype=bool)
    weighed = []
    begun = time.process_time()
    for k, labels in enumerate(given.layouts):
        of = given.of == k
        rows = given.changes[of]
        weighed.append(dissipations(analysis, opened(analysis, given.known.velocities[k], labels, opening)))
        own[of] = uppers(weighed[-1], rows)
        inner, dry = (sets.slack(given.known.forces[k], np.full_like(labels, label)) for label in (False, True))
        hold[of] = np.where(rows, dry, inner).min(axis=1) >= -NOISE
    seconds = time.process_time() - begun
    return own, np.min([uppers(one, given.changes) for one in weighed], axis=0), hold, seconds


def percent(part: int | float, whole: int | float) -> str:
    """A share in per cent with the counts; a dash of nothing."""
    return f"{100.0 * part / whole:.0f} % ({int(part)} of {int(whole)})" if whole else "–"


def start_rows(name: str, solver: BatchSolver, analysis: LimitAnalysis, given: Sample) -> list[list[str]]:
    """Rows of the first table; every start is measured beside a fresh solve."""
    found = []
    fresh = solved(solver, analysis, given, None)
    for start in (None, *STARTS):
        turns = [(solved(solver, analysis, given, None), solved(solver, analysis, given, start)) for _ in range(TURNS)]
        before, seconds = (min(turn[which].seconds for turn in turns) for which in (0, 1))
        one = turns[0][1]
        both = (fresh.verdict == PROVEN) & (one.verdict == PROVEN)
        apart = abs(one.high - fresh.high)[both] / abs(fresh.high[both])
        found.append(
            [
                name,
                "fresh" if start is None else start,
                str(len(given.changes)),
                f"{one.iterations.mean():.1f}",
                percent((one.tries == 1).sum(), len(one.tries)),
                str(int((one.verdict == OPEN).sum())),
                str(int((apart > SAME).sum())),
                f"{1e6 * seconds / len(given.changes):.0f}",
                f"**{seconds / before:.2f}**",
            ]
        )
    return found


def bound_row(name: str, solver: BatchSolver, analysis: LimitAnalysis, given: Sample) -> list[str]:
    """A row of the second table, over the changes that are proven."""
    fresh = solved(solver, analysis, given, None)
    own, every, hold, seconds = screened(analysis, given)
    good = fresh.verdict == PROVEN
    base = given.known.high[given.of][good]
    high, own, every, hold = fresh.high[good], own[good], every[good], hold[good]
    # a bound below a proven λ would refute the bound, or λ
    assert (own >= fresh.low[good] * (1.0 - SAME)).all()
    assert (every >= fresh.low[good] * (1.0 - SAME)).all()
    least, most = base * (1.0 - SAME), base * (1.0 + SAME)
    weaker, better = high < least, high > most
    return [
        name,
        str(int(good.sum())),
        f"{weaker.sum()}, {(~weaker & ~better).sum()}, {better.sum()}",
        percent((own < least).sum(), weaker.sum()),
        percent((every < least).sum(), weaker.sum()),
        percent((own <= most).sum(), (~better).sum()),
        percent((hold & ~weaker).sum(), (~weaker).sum()),
        f"{100.0 * seconds / fresh.seconds:.0f} %",
    ]


def main() -> None:
    """Write benchmarks/results/local_change.md."""
    starts, bounds = [], []
    for name, (count, evaluations) in SCENES.items():
        assembly, space = built(LARGE[name]())
        analysis = LimitAnalysis(assembly)
        solver = analysis.batch
        assert solver is not None
        driver, chains = annealed(space, Evaluator(assembly, EvaluatorSettings()), evaluations)
        for kind, layouts in (("random", driver.draw(count)), ("annealed", chains)):
            given = sample(driver, analysis, solver, layouts)
            starts += start_rows(f"{name}, {kind}", solver, analysis, given)
            bounds.append(bound_row(f"{name}, {kind}", solver, analysis, given))
    first = ["layouts", "start", "changes", "iterations", "one pass", "open", "wrong", "µs each", "time / fresh"]
    second = [
        "layouts",
        "changes",
        "weaker, equal, better",
        "own mechanism below λ, of weaker",
        "any known below λ, of weaker",
        "own mechanism up to λ, of not better",
        "own forces hold, of not weaker",
        "cost",
    ]
    load = f"Load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    text = ["# Local changes", about(__doc__), table(first, starts), table(second, bounds), load]
    write("local_change", "\n\n".join(text))


if __name__ == "__main__":
    main()
