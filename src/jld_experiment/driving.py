"""Load a settled assembly: estimate the scale of λ, push, check by a load ramp, keep on disk."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from jld_core import Floats, InputError, Ints
from jld_experiment.settings import FALL
from jld_experiment.specimen import Specimen, Standing, State, copied

GROWTH = 1.03  # Growth factor of the scout's displacement per slowest period.
PLATEAU = 5e-4  # Relative rise of the highest λ over the second half of a push below which it is a plateau.
GONE = 0.5  # Share of the highest λ below which the structure counts as collapsed.
# Multiple of the scout's initial load, 1e-3 of the dead load, at which a λ that still rises means no collapse; 1e6 took
# layouts for locked that collapse at 50 times their weight.
ENDLESS = 1e9


@dataclass(frozen=True)
class Push:
    """Curve of λ over displacement of one push: k records at equal times.

    Attributes
    ----------
    distance : (k,) float array
        Displacement live·u at the end of each record, scene units of work.
    load_factor : (k,) float array
        Mean λ of each record.
    unbalanced : (k,) float array
        Largest unbalanced force over `Specimen.largest`.
    broken : (k,) int array
        Broken sub-contacts.
    energy_error : (k,) float array
        `EnergyBalance.error`.
    at_collapse, at_end : State
        At the highest λ before its first fall, and at the end.
    periods : float
        Duration, slowest periods.
    rising : bool
        True if λ neither fell nor reached a plateau.
    stopped : bool
        True if the push made the records asked for.
    """

    distance: Floats
    load_factor: Floats
    unbalanced: Floats
    broken: Ints
    energy_error: Floats
    at_collapse: State
    at_end: State
    periods: float
    rising: bool
    stopped: bool = False

    @property
    def collapse(self) -> int:
        return collapse_record(self.load_factor)


def collapse_record(load_factor: Floats) -> int:
    """Return the index of the largest λ (k,) before λ first falls by `FALL` of the highest λ."""
    # a fall relative to the running maximum alone would take a small drop at half the load for collapse
    so_far = np.maximum.accumulate(load_factor)
    fallen = np.flatnonzero(so_far - load_factor > FALL * float(so_far[-1]))
    end = int(fallen[0]) if fallen.size else len(load_factor)
    return int(np.argmax(load_factor[: max(end, 1)]))


def scout(specimen: Specimen, settled: State) -> float:
    """Estimate the highest λ by a quick push with geometrically growing displacement."""
    # The estimate provides the unit of displacement for `push`. `settled` is the state under the dead loads; it is not
    # changed. The estimate is inf if λ never stops rising, and 0 if the structure has neither dead load nor strength.
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
            # Inertia alone makes λ rise slightly at all times.
            if highest < 1.1 * before:
                return float(highest)
            before, mark = highest, 3.0 * distance
    return np.inf


@dataclass
class _Progress:
    """Decide from records whether a push goes on; a continued push replays its records."""

    unit: float  # elastic displacement live·u at the scale of λ
    distance: float = 0.0
    highest: float = -np.inf
    highest_at: float = 0.0
    carried: float = 0.0
    half: float = -np.inf
    half_at: float = 0.0
    fell: bool = False

    def add(self, distance: float, factor: float) -> bool:
        """Take a record; return whether λ is the highest so far and has not fallen yet."""
        best = factor > self.highest and not self.fell
        self.distance = distance
        if factor > self.highest:
            self.highest, self.highest_at = factor, distance
        if self.highest - factor > FALL * self.highest:
            self.fell = True
        if factor > GONE * self.highest:
            self.carried = distance
        return best

    def ends(self) -> bool:
        """Return, once per record, whether λ stays below half of its highest value or is on a plateau."""
        if self.highest_at > 0.0 and self.distance - self.carried > max(0.3 * self.unit, 0.2 * self.highest_at):
            return True
        if self.distance > 2.0 * self.half_at:
            if self.highest <= self.half + PLATEAU * abs(self.half):
                return True
            self.half, self.half_at = self.highest, self.distance
        return False


def push(
    specimen: Specimen,
    settled: State,
    scale: float,
    periods: float,
    endless: bool = False,
    *,
    records: int | None = None,
    continued: Push | None = None,
) -> Push:
    """Push a settled assembly so that live·u grows at a constant rate, later faster.

    λ is the multiplier of the rate. The push ends when λ stays below half of its highest value or on a plateau.

    Parameters
    ----------
    specimen : Specimen
        What is loaded.
    settled : State
        State under the dead loads; not changed.
    scale : float
        λ that defines the unit of displacement.
    periods : float
        Slowest periods per elastic displacement.
    endless : bool
        Go on to the set length in any case.
    records : int, optional
        Number of records after which the push stops.
    continued : Push, optional
        Stopped push to continue with the same arguments, to the same digits as without a stop.

    Returns
    -------
    Push
    """
    settings, system = specimen.settings, specimen.system
    unit = scale * system.reach
    steps = max(1, round(system.period / settings.records))
    pace = unit / (periods * system.period)
    state, best = copied(settled), copied(settled)
    speed = float((specimen.assembly.live * state.velocity).sum())
    rows, progress, stopped = list[Row](), _Progress(unit, half_at=2.0 * unit), False
    ended = False

    def target() -> float:
        return pace * max(1.0, progress.distance / (settings.hasten * unit))

    if continued is not None:
        state, best = copied(continued.at_end), copied(continued.at_collapse)
        for row in _rows(continued):
            speed = target()
            rows.append(row)
            progress.add(row[0], row[1])
            ended = not endless and progress.ends()
    while not ended and progress.distance < settings.length * unit:
        if records is not None and len(rows) >= records:
            stopped = True
            break
        after = target()
        factor, worst, _ = specimen.march(state, steps, rate=(speed, after))
        distance = progress.distance + 0.5 * (speed + after) * steps + 0.5 * (after - speed)
        speed = after
        rows.append((distance, factor, worst, float(state.broken.sum()), specimen.energy(state).error))
        if progress.add(distance, factor):
            best = copied(state)
        ended = not endless and progress.ends()
    table = np.array(rows).reshape(-1, 5)
    spent = len(rows) * steps / system.period
    before = table[:, 0] <= 0.5 * table[-1, 0]
    rose = table[:, 1].max() > 1.01 * table[before, 1].max(initial=-np.inf)  # by over 1 % in the second half
    rising = not ended and not stopped and bool(rose)
    broken = table[:, 3].astype(np.int64)
    return Push(table[:, 0], table[:, 1], table[:, 2], broken, table[:, 4], best, state, spent, rising, stopped)


# one record: displacement, λ, unbalanced force, broken sub-contacts, error of energy
Row = tuple[float, float, float, float, float]


def _rows(found: Push) -> list[Row]:
    columns = (found.distance, found.load_factor, found.unbalanced, found.broken.astype(float), found.energy_error)
    return [(a, b, c, d, e) for a, b, c, d, e in np.column_stack(columns).tolist()]


@dataclass(frozen=True)
class Ramp:
    """Result of raising the load step by step (force control).

    Attributes
    ----------
    rests : float
        Largest λ at which the assembly came to rest.
    fails : float
        Smallest λ at which it did not.
    how : Standing
        Behaviour at `fails`.
    state : State
        State at `rests`.
    """

    rests: float
    fails: float
    how: Standing
    state: State


def ramp(specimen: Specimen, settled: State, scale: float, first: float = 0.1, width: float = 2.5e-3) -> Ramp:
    """Raise λ step by step, wait for rest at each step, and bisect where there is none.

    Parameters
    ----------
    specimen : Specimen
        What is loaded.
    settled : State
        State under the dead loads; not changed.
    scale : float
        λ to which `first` and `width` are relative.
    first : float
        First step.
    width : float
        Final width of the bracket.

    Returns
    -------
    Ramp
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


_STATES = ("at_collapse", "at_end")


def write_push(path: Path, found: Push) -> None:
    """Write a push with its states to a file of NumPy arrays (.npz), with all digits."""
    arrays = dict[str, Any]()
    for field in fields(found):
        value = getattr(found, field.name)
        if field.name in _STATES:
            arrays |= {f"{field.name}.{name}": array for name, array in _arrays(value).items()}
        else:
            arrays[field.name] = value
    with path.open("wb") as file:
        np.savez(file, **arrays)


def read_push(path: Path, specimen: Specimen) -> Push:
    """Read a push from a file of `write_push`; InputError for another structure or settings."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    states = dict[str, Any]()
    for name in _STATES:
        fresh = specimen.fresh()
        for key, array in _arrays(fresh).items():
            found = arrays.get(f"{name}.{key}")
            if found is None or found.shape != array.shape:
                problem = f"{name}.{key} does not fit the structure and settings"
                raise InputError(str(path), problem, "a file of the same scene, labels and settings")
            array[...] = found
        states[name] = fresh
    rest = {field.name: arrays[field.name] for field in fields(Push) if field.name not in _STATES}
    for name in ("periods", "rising", "stopped"):
        rest[name] = rest[name].item()
    return Push(**states, **rest)


def _arrays(state: State) -> dict[str, Any]:
    """Return all arrays of a state by name; those of its geometry begin with "geometry."."""
    found = {field.name: getattr(state, field.name) for field in fields(state) if field.name != "geometry"}
    if state.geometry is not None:
        found |= {f"geometry.{name}": array for name, array in state.geometry._asdict().items()}
    return found
