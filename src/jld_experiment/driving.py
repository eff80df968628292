"""How a settled assembly is driven: a scout for the scale of things, the push, and the ramp that checks it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Floats, Ints
from jld_experiment.settings import FALL
from jld_experiment.specimen import Specimen, Standing, State, copied

GROWTH = 1.03  # of the distance in one slowest period of the scout
PLATEAU = 5e-4  # rise of the highest load, relative, over half the way, below which nothing more is to come
GONE = 0.5  # share of the highest load below which a push has nothing left to carry
ENDLESS = 1e6  # times the load at which the scout starts; still rising there, nothing will give way


@dataclass(frozen=True)
class Push:
    """One push. distance, load_factor, unbalanced, broken: (k,) live·u, λ as the mean of each record, largest out-of-
    balance force of each, sub-contacts broken by then. at_collapse, at_end: states. periods: slowest periods it
    took. rising: had the load neither fallen nor come to a plateau when it ended?"""

    distance: Floats
    load_factor: Floats
    unbalanced: Floats
    broken: Ints
    at_collapse: State
    at_end: State
    periods: float
    rising: bool

    @property
    def collapse(self) -> int:
        """Record of the collapse load."""
        return collapse_record(self.load_factor)


def collapse_record(load_factor: Floats) -> int:
    """Where λ is largest before its first fall by a tenth of the highest λ of the whole curve.

    Measured by the highest so far, a stumble at half the load would be mistaken for collapse.
    """
    so_far = np.maximum.accumulate(load_factor)
    fallen = np.flatnonzero(so_far - load_factor > FALL * float(so_far[-1]))
    end = int(fallen[0]) if fallen.size else len(load_factor)
    return int(np.argmax(load_factor[: max(end, 1)]))


def scout(specimen: Specimen, settled: State) -> float:
    """About the highest λ of a quick push whose distance grows by a constant ratio; inf where it never ends.

    A push needs a length to be measured in, and this takes it from the experiment itself.
    """
    state, system = copied(settled), specimen.system
    assembly = specimen.assembly
    strength = float(np.nanmax(specimen.bench.law[:, 4:6].max(axis=1) * assembly.interfaces.area, initial=0.0))
    start = 1e-3 * (assembly.total_dead or strength) / assembly.total_live
    if start == 0.0:
        return 0.0
    steps = max(1, round(system.period))
    distance, speed = start * system.reach, float((assembly.live * state.velocity).sum())
    highest, before, mark = -np.inf, -np.inf, 3.0 * distance
    while distance < ENDLESS * start * system.reach:
        target = (GROWTH - 1.0) * distance / steps
        factor, _, _ = specimen.march(state, steps, rate=(speed, target))
        speed, distance = target, distance * GROWTH
        highest = max(highest, factor)
        if distance > mark:
            # inertia alone makes it rise a little for ever
            if highest < 1.1 * before:
                return float(highest)
            before, mark = highest, 3.0 * distance
    return np.inf


def push(specimen: Specimen, settled: State, scale: float, periods: float, endless: bool = False) -> Push:
    """Push a settled assembly so that live·u grows at a constant rate, and faster when far from where it began.

    scale: λ in which the way is measured. periods: slowest periods for one elastic movement. endless: go the whole
    length whatever happens. λ is the multiplier of the prescribed rate. It ends when the load has been below half of
    its highest for some way, when it has not risen over half the way, or at the length that is set.
    """
    settings, system = specimen.settings, specimen.system
    unit = scale * system.reach
    steps = max(1, round(system.period / settings.records))
    pace = unit / (periods * system.period)
    state, best = copied(settled), copied(settled)
    speed = float((specimen.assembly.live * state.velocity).sum())
    distance, rows = 0.0, []
    highest, highest_at, carried, half, half_at, fell = -np.inf, 0.0, 0.0, -np.inf, 2.0 * unit, False
    rising = True
    while distance < settings.length * unit:
        target = pace * max(1.0, distance / (settings.hasten * unit))
        factor, worst, _ = specimen.march(state, steps, rate=(speed, target))
        distance += 0.5 * (speed + target) * steps + 0.5 * (target - speed)
        speed = target
        rows.append((distance, factor, worst, float(state.broken.sum())))
        if factor > highest and not fell:
            best = copied(state)
        if factor > highest:
            highest, highest_at = factor, distance
        if highest - factor > FALL * highest:
            fell = True
        if factor > GONE * highest:
            carried = distance
        if endless:
            continue
        if highest_at > 0.0 and distance - carried > max(0.3 * unit, 0.2 * highest_at):
            rising = False
            break
        if distance > 2.0 * half_at:
            if highest <= half + PLATEAU * abs(half):
                rising = False
                break
            half, half_at = highest, distance
    table = np.array(rows)
    spent = len(rows) * steps / system.period
    if rising:
        rising = _still_rising(table)
    return Push(table[:, 0], table[:, 1], table[:, 2], table[:, 3].astype(np.int64), best, state, spent, rising)


def _still_rising(table: Floats) -> bool:
    """Is λ higher by a hundredth at the end of the way than halfway along it?"""
    before = table[:, 0] <= 0.5 * table[-1, 0]
    return bool(table[:, 1].max() > 1.01 * table[before, 1].max(initial=-np.inf))


@dataclass(frozen=True)
class Ramp:
    """Force control. rests: largest λ at which everything came to rest, and state there. fails: least λ at which it
    did not, and how."""

    rests: float
    fails: float
    how: Standing
    state: State


def ramp(specimen: Specimen, settled: State, scale: float, first: float = 0.1, width: float = 2.5e-3) -> Ramp:
    """Raise λ step by step, waiting for rest at each, and halve the step where it does not come.

    scale: λ that first (the first step) and width (of the bracket in the end) are shares of.
    """
    state, low, step = copied(settled), 0.0, first
    fails, how = np.inf, Standing.RESTS
    while fails - low > width and low < 100.0:
        there = min(low + step, 0.5 * (low + fails))
        trial = copied(state)
        ends = (low * scale, there * scale)
        specimen.march(trial, round(20.0 * specimen.system.period), load_factor=ends)
        found = specimen.rest(trial, there * scale)
        if found is Standing.RESTS:
            low, state = there, trial
        else:
            fails, how = there, found
    return Ramp(low * scale, fails * scale, how, state)
