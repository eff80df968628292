"""Load a settled assembly: estimate the scale of λ, push, check by a load ramp, keep on disk."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from jld_core import Assembly, Bits, Floats, InputError, Ints, parameters
from jld_core import assembly as structures
from jld_experiment.settings import ACCURACY, FALL, RATE_ERROR, Joints, Settings
from jld_experiment.specimen import Specimen, Standing, State, copied, specimen_of
from jld_experiment.subcontacts import EnergyBalance

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
        # the index of the largest λ (k,) before λ first falls by `FALL` of the highest λ
        # a fall relative to the running maximum alone would take a small drop at half the load for collapse
        so_far = np.maximum.accumulate(self.load_factor)
        fallen = np.flatnonzero(so_far - self.load_factor > FALL * float(so_far[-1]))
        end = int(fallen[0]) if fallen.size else len(self.load_factor)
        return int(np.argmax(self.load_factor[: max(end, 1)]))


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


def _rows(push: Push) -> list[Row]:
    columns = (push.distance, push.load_factor, push.unbalanced, push.broken.astype(float), push.energy_error)
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
        standing = specimen.rest(trial, there * scale)
        if standing is Standing.RESTS:
            low, state = there, trial
        else:
            fails, how = there, standing
    return Ramp(low * scale, fails * scale, how, state)


_STATES = ("at_collapse", "at_end")


def write_push(path: Path, push: Push) -> None:
    """Write a push with its states to a file of NumPy arrays (.npz), with all digits."""
    arrays = dict[str, Any]()
    for entry in fields(push):
        value = getattr(push, entry.name)
        if entry.name in _STATES:
            arrays |= {f"{entry.name}.{name}": array for name, array in _arrays(value).items()}
        else:
            arrays[entry.name] = value
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
            loaded = arrays.get(f"{name}.{key}")
            if loaded is None or loaded.shape != array.shape:
                problem = f"{name}.{key} does not fit the structure and settings"
                raise InputError(str(path), problem, "a file of the same scene, labels and settings")
            array[...] = loaded
        states[name] = fresh
    other_fields = {field.name: arrays[field.name] for field in fields(Push) if field.name not in _STATES}
    for name in ("periods", "rising", "stopped"):
        other_fields[name] = other_fields[name].item()
    return Push(**states, **other_fields)


def _arrays(state: State) -> dict[str, Any]:
    """Return all arrays of a state by name; those of its geometry begin with "geometry."."""
    arrays = {field.name: getattr(state, field.name) for field in fields(state) if field.name != "geometry"}
    if state.geometry is not None:
        arrays |= {f"geometry.{name}": array for name, array in state.geometry._asdict().items()}
    return arrays


def require_one_load(assembly: Assembly) -> None:
    """Raise InputError if an assembly has load cases or members, which are not modelled.

    Parameters
    ----------
    assembly : Assembly
        The structure.

    Raises
    ------
    InputError
        If it has load cases or members.
    """
    assembly.members.refuse("an experiment")
    if assembly.cases:
        problem = f"an experiment pushes with one live load, and there are {len(assembly.cases)} cases"
        raise InputError("loads.cases", problem, '"loads.live" with the load of one of them')


@dataclass(frozen=True)
class Curve:
    """Result of an experiment; arrays are empty if the dead loads alone cause collapse.

    Attributes
    ----------
    assembly, labels, joints, settings
        As given.
    standing : Standing
        Behaviour under the dead loads alone.
    reach : float
        Displacement (live·u, scene units) of the elastic structure at λ = 1.
    collapse_load : float
        λ at collapse.
    rising : bool
        True if the load neither fell nor reached a plateau.
    at_collapse, at_end : (n, q) float array
        Displacements since the dead loads rested.
    cracked : (m,) float array
        Broken share of the area of each face at the end.
    distance, load_factor, unbalanced, energy_error : (k,) float array
        Displacement, λ, unbalanced force over the largest dead load, and `EnergyBalance.error` of the slower push.
    broken : (k,) int array
        Its broken sub-contacts.
    faster : (k', 2) float array
        Displacement and λ of the faster push.
    collapse : int
        Record of the collapse load.
    rate_error : float
        Relative difference of both collapse loads.
    first_crack : float
        λ at which a brittle face first broke, or NaN.
    periods : float
        Duration of both pushes, slowest periods.
    energy_at_collapse, energy : EnergyBalance or None
        Up to the collapse load, and to the end of the slower push.
    """

    assembly: Assembly
    labels: Bits
    joints: Joints
    settings: Settings
    standing: Standing
    reach: float
    collapse_load: float
    rising: bool
    at_collapse: Floats
    at_end: Floats
    cracked: Floats
    distance: Floats = field(default_factory=lambda: np.zeros(0))
    load_factor: Floats = field(default_factory=lambda: np.zeros(0))
    unbalanced: Floats = field(default_factory=lambda: np.zeros(0))
    broken: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    faster: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    collapse: int = 0
    rate_error: float = 0.0
    first_crack: float = np.nan
    periods: float = 0.0
    energy_error: Floats = field(default_factory=lambda: np.zeros(0))
    energy_at_collapse: EnergyBalance | None = None
    energy: EnergyBalance | None = None

    @property
    def stands(self) -> bool:
        """True if the structure stands under the dead loads."""
        return self.standing is Standing.RESTS

    @property
    def rates_agree(self) -> bool:
        """True if two rates give the same collapse load within `RATE_ERROR`; no bound on λ."""
        return self.stands and not self.rising and self.rate_error <= RATE_ERROR

    @property
    def accuracy(self) -> float:
        """Relative accuracy of the collapse load: the rate error, at least `ACCURACY`."""
        return max(self.rate_error, ACCURACY)


@parameters.typed
def run_experiment(
    assembly: Assembly, labels: Bits | None = None, *, joints: Joints | None = None, settings: Settings | None = None
) -> Curve:
    """Load one labelling of an assembly until collapse, twice, at two rates.

    The assembly settles under its dead loads; then live·u grows at a constant rate, and λ is its multiplier.

    Parameters
    ----------
    assembly : Assembly
        Structure with one live load.
    labels : (m,) bool array, optional
        Default: the scene's own.
    joints : Joints, optional
        Laws of the joints.
    settings : Settings, optional
        The settings.

    Returns
    -------
    Curve
        With the collapse load of the slower push.

    Raises
    ------
    InputError
        If a material is missing, a setting is invalid, or there are load cases.
    """
    require_one_load(assembly)
    layout_labels = structures.labels_of(assembly, labels)
    joints, settings = joints or Joints(), settings or Settings()
    specimen = specimen_of(assembly, layout_labels, joints, settings)
    settled, standing = specimen.settle()
    if standing is not Standing.RESTS:
        return _nothing(specimen, joints, standing, settled.moved)
    scale = scout(specimen, settled)
    if not 0.0 < scale < np.inf:
        return _nothing(specimen, joints, standing, settled.moved, rising=scale > 0.0)
    fast = push(specimen, settled, scale, settings.periods)
    slow = push(specimen, settled, scale, settings.periods * settings.slower)
    load = slow.load_factor[slow.collapse]
    area = specimen.points.place[:, -1]
    broken = np.bincount(specimen.points.face, weights=area * slow.at_end.broken, minlength=len(layout_labels))
    first = np.flatnonzero(slow.broken > int(settled.broken.sum()))
    return Curve(
        assembly=assembly,
        labels=layout_labels,
        joints=joints,
        settings=settings,
        standing=standing,
        distance=slow.distance,
        load_factor=slow.load_factor,
        unbalanced=slow.unbalanced,
        broken=slow.broken,
        faster=np.column_stack([fast.distance, fast.load_factor]),
        reach=specimen.system.reach,
        collapse=slow.collapse,
        collapse_load=float(load),
        rate_error=float(abs(fast.load_factor[fast.collapse] / load - 1.0)),
        rising=fast.rising or slow.rising,
        at_collapse=slow.at_collapse.moved - settled.moved,
        at_end=slow.at_end.moved - settled.moved,
        cracked=broken / assembly.interfaces.area,
        first_crack=float(slow.load_factor[max(first[0] - 1, 0)]) if first.size else np.nan,
        periods=fast.periods + slow.periods,
        energy_error=slow.energy_error,
        energy_at_collapse=specimen.energy(slow.at_collapse),
        energy=specimen.energy(slow.at_end),
    )


def _nothing(specimen: Specimen, joints: Joints, standing: Standing, moved: Floats, rising: bool = False) -> Curve:
    """Return the curve of a structure that is not pushed: it falls, has no strength or is locked."""
    load = 0.0 if standing is Standing.RESTS and not rising else np.nan
    return Curve(
        assembly=specimen.assembly,
        labels=specimen.labels,
        joints=joints,
        settings=specimen.settings,
        standing=standing,
        reach=specimen.system.reach,
        collapse_load=load,
        rising=rising,
        at_collapse=moved,
        at_end=moved,
        cracked=np.zeros(len(specimen.labels)),
    )
