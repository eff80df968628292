"""Proof by fields that no layout carries more than the best by a gap."""

from __future__ import annotations

import hashlib
import math
import threading
import time
import uuid
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.deadline import checkpoint
from jld_core.errors import InputError, ParameterError
from jld_core.fields.bounds import Fields, FieldSetting, PartialUpperBound, WeighedField
from jld_core.fields.mesh import Mesh
from jld_core.fields.transfer import FieldMechanism, mechanism_bounds
from jld_core.limit.mechanism import DualBound
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflict_generation import conflict_of
from jld_explore.drivers.exact.context import PossibleBlocks, free_faces
from jld_explore.drivers.exact.proof_check import Claim, counts_of, front_count
from jld_explore.drivers.exact.proof_state import Conflict, Mechanism
from jld_explore.evaluation import Pool
from jld_explore.evaluation.field_evaluator import FieldPool, FieldStep, step_of
from jld_explore.space import Count, registered, values_of
from jld_explore.space.limits import Range
from jld_explore.space.search_space import SearchSpace

_BELOW: Final = 1e-9  # relative amount by which the goal lies below best / (1 − gap), for rounding of the gap


class ProofAim(Protocol):
    """Aim of a proof by fields: ask for `target` and `goal`, refute, and `next` until None; then check `claims`.

    `best` maps each count to the largest governing factor that a layout of it is proven to carry.
    """

    count: Count | None  # count whose values are the targets; None where all labellings are one target
    gap: float  # relative distance between the best lower bound and the bound at which a target is reached
    in_steps: bool  # whether a bound far above the goal is lowered in steps

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        """Return the count, or range of counts, of the labellings to refute now; None for all."""
        ...

    def goal(self, best: Mapping[int, float]) -> float:
        """Return the governing factor above which labellings of the target must be refuted."""
        ...

    def enough(self, best: Mapping[int, float]) -> float:
        """Return the governing factor that a lower bound of a labelling must exceed to be of use."""
        ...

    def restart(self) -> None: ...

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        """Record the target's bound; return the known one of the next, None at the end. left: (k,) open counts."""
        ...

    def claims(self) -> list[Claim]:
        """Return the bounds that the check has to confirm after the last target."""
        ...

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        """Return entries of the summary, without bounds unless they are `sure`."""
        ...


def goal_of(best: float, gap: float) -> float:
    """Return best / (1 − gap), less rounding: the factor above which labellings must be refuted."""
    if best <= 0.0:
        return 0.0
    return best / (1.0 - gap) * (1.0 - _BELOW) if gap < 1.0 else math.inf


def holds(target: int | Range | None, counts: Floats) -> Bools:
    if target is None:
        return np.ones(len(counts), dtype=bool)
    return ~target.outside(counts) if isinstance(target, Range) else np.asarray(counts == target)


class StrongestAim:
    """Aim to prove the strongest layout to a gap, with all labellings as the only target."""

    count: Count | None = None
    in_steps = True

    def __init__(self, gap: float) -> None:
        self.gap = gap
        self.restart()

    def restart(self) -> None:
        self._bound = math.inf

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        return None

    def goal(self, best: Mapping[int, float]) -> float:
        return goal_of(self.enough(best), self.gap)

    def enough(self, best: Mapping[int, float]) -> float:
        return max(best.values(), default=-math.inf)

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        self._bound = bound
        return None

    def claims(self) -> list[Claim]:
        return [Claim(None, max(self._bound, 0.0))]

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        return {}


def _count_of_formula(space: SearchSpace) -> Count:
    """Return the count of a front that the formula can bound; InputError for another."""
    count, front = front_count(space), space.search.front
    if front.counts:
        raise InputError(
            "search.front.counts", "by fields two counts have no exact front", 'one, or `driver="genetic"`'
        )
    if count is None:
        names = " or ".join(count_of_formula.name for count_of_formula in registered() if count_of_formula.terms)
        raise InputError("search.front.count", f"by fields {front.count} has no exact front", names)
    return count


class FrontAim:
    """Aim to prove to a gap the strongest layout of every count of the front."""

    in_steps = True

    def __init__(self, space: SearchSpace, gap: float) -> None:
        # All labellings are bounded first, then those of one count after the other, best count first. The goal is the
        # best λ of this count or a better one: a weaker layout is not on the front.
        self.gap = gap
        count = _count_of_formula(space)
        self.count: Count | None = count
        self._sign = -1.0 if space.search.front.axes[0][1] == "max" else 1.0
        self._all = sorted(counts_of(space, count), key=lambda value: self._sign * value)
        self.restart()

    def restart(self) -> None:
        self._remaining = list(self._all)
        self._current: int | None = None
        self.bounds: dict[int | None, float] = {}

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        return self._current

    def goal(self, best: Mapping[int, float]) -> float:
        return goal_of(self.enough(best), self.gap)

    def enough(self, best: Mapping[int, float]) -> float:
        return self._no_worse(self._current, best)

    def _no_worse(self, value: int | None, best: Mapping[int, float]) -> float:
        """Return the best factor of layouts whose count is `value` or a better one, else −inf."""
        lows = (low for count, low in best.items() if value is None or self._sign * (count - value) <= 0.0)
        return max(lows, default=-math.inf)

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        self.bounds[self._current] = bound
        self._current = self._remaining.pop(0) if self._remaining else None
        return None if self._current is None else self.bounds[None]

    def claims(self) -> list[Claim]:
        return [Claim(count, max(bound, 0.0)) for count, bound in self.bounds.items()]

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        """Return the front as entry "front", one row for each count."""
        # A row has the count, the best load factor, the bound (None unless `sure`), and whether it is proven to the
        # gap. Counts of which no layout stands are left out once that is proven.
        rows: list[dict[str, Any]] = []
        for count in sorted({*best, *(count for count in self.bounds if count is not None)}):
            low, bound = best.get(count, -math.inf), self.bounds.get(count, self.bounds.get(None, math.inf))
            if low < 0.0 and bound <= 0.0:
                continue
            proven = (
                sure
                and count in self.bounds
                and bound <= goal_of(self._no_worse(count, best), self.gap) * (1.0 + 2.0 * _BELOW)
            )
            high = bound if sure and math.isfinite(bound) else None
            rows.append({"count": count, "load_factor": low if low >= 0.0 else None, "bound": high, "proven": proven})
        return {"front": rows}


class RequirementAim:
    """Aim to prove the best count of the front among layouts that carry a required factor."""

    in_steps = False

    def __init__(self, space: SearchSpace, gap: float) -> None:
        required = space.search.require
        if required is None:
            raise ParameterError("aim", "the scene requires no load factor", "search.require")
        self.gap = gap
        self.count: Count | None = _count_of_formula(space)
        self._sense, self._threshold = space.search.front.axes[0][1], required.threshold
        # a layout that is refuted carries less than what is required
        self._goal = required.threshold * (1.0 - _BELOW)
        self.restart()

    def restart(self) -> None:
        self._claim: Claim | None = None
        self.open_counts: Floats = np.empty(0)

    def met(self, best: Mapping[int, float]) -> int | None:
        """Return the best count whose factor is at least the required one, or None."""
        counts = [count for count, low in best.items() if low >= self._threshold]
        return None if not counts else min(counts) if self._sense == "min" else max(counts)

    def target(self, best: Mapping[int, float]) -> int | Range | None:
        return self._better(self.met(best))

    def _better(self, value: int | None) -> Range | None:
        if value is None:
            return None
        return Range.of((None, value - 1) if self._sense == "min" else (value + 1, None), whole=True)

    def goal(self, best: Mapping[int, float]) -> float:
        return self._goal

    def enough(self, best: Mapping[int, float]) -> float:
        return self._threshold

    def next(self, bound: float, best: Mapping[int, float], left: Floats) -> float | None:
        # without open labellings no count better than `met` carries the factor; else the best open count takes its
        # place
        value = self.met(best)
        self.open_counts = left
        if len(left):
            value = int(left.min() if self._sense == "min" else left.max())
        self._claim = Claim(self._better(value), self._goal)
        return None

    def claims(self) -> list[Claim]:
        return [] if self._claim is None else [self._claim]

    def facts(self, best: Mapping[int, float], sure: bool) -> dict[str, Any]:
        """Return the best count that may still carry the factor, and the number of open layouts."""
        value = self.met(best)
        if len(self.open_counts):
            value = int(self.open_counts.min() if self._sense == "min" else self.open_counts.max())
        return {
            "count_bound": value if sure and self._claim is not None else None,
            "open_layouts": len(self.open_counts),
        }


def aim_of(space: SearchSpace, aim: str, gap: float) -> ProofAim:
    """Make the aim of a proof from the option of the driver and the scene."""
    if space.search.require is not None:
        if aim != "best":
            raise ParameterError("aim", "a front is not what search.require asks for", "best")
        return RequirementAim(space, gap)
    return FrontAim(space, gap) if aim == "front" else StrongestAim(gap)


# Relative amount by which bounds are raised on a change of units, so that they stay valid
_ROUNDING: Final = 4.0 * float(np.finfo(float).eps)
_MOST_WEIGHING: Final = 4  # meshes, beside those that refute, whose problems are kept in memory


@dataclass(frozen=True)
class FieldProblem:
    """Mesh on which velocity fields refute load factors under one load case."""

    setting: FieldSetting  # data that all meshes of the load case share
    mesh: Mesh  # the mesh, scene units
    required: float  # required factor of the load case


class FieldRelaxation:
    """Upper bounds on governing factors of partial labellings by velocity fields.

    A problem is a load case on one mesh. The first ones are asked, those that refuted most before; later ones only
    weigh. `Mechanism.case` is the position of one.
    """

    many = False
    unit = 1.0

    def __init__(self, problems: Sequence[FieldProblem]) -> None:
        self.problems = list(problems)
        self._order = list(range(len(problems)))
        self._refuting = [PartialUpperBound(problem.setting.problem(problem.mesh), many=True) for problem in problems]
        self._mechanisms: dict[tuple[int, bytes], FieldMechanism | None] = {}
        self._weighing: OrderedDict[int, PartialUpperBound] = OrderedDict()

    @property
    def solves(self) -> int:
        return sum(solver.solves for solver in self._refuting)

    def restart(self) -> None:
        """Ask the problems in their first order, so that answers do not depend on earlier calls."""
        self._order = list(range(len(self._refuting)))

    def add(self, problem: FieldProblem) -> int:
        """Add a problem to weigh mechanisms on, not to refute; return its position."""
        self.problems.append(problem)
        return len(self.problems) - 1

    def refute(self, labels: Bits, undecided: Bools, threshold: float = math.inf) -> DualBound | None:
        # A factor is refuted where a velocity field proves a smaller bound. Problems are asked one by one; one that
        # succeeds is asked first the next time.
        for index, number in enumerate(self._order):
            checkpoint()
            field = self._refuting[number].field(labels, undecided)
            if field is None:
                continue
            required = self.problems[number].required
            bound = raised(field.bound / required)
            if bound < threshold:
                if index:
                    self._order.remove(number)
                    self._order.insert(0, number)
                cost = np.where(undecided, 0.0, field.mechanism.costs(labels) / required)
                return DualBound(threshold - bound, cost, bound, field.velocity, number)
        return None

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        return [self.refute(*arguments) for arguments in zip(labellings, undecided, thresholds.tolist(), strict=True)]

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        """Return the least upper bound over cases for partly decided labels; None without any."""
        best: DualBound | None = None
        for number, partial in enumerate(self._refuting):
            field = partial.field(labels, undecided)
            required = self.problems[number].required
            bound = math.inf if field is None else raised(field.bound / required)
            if field is not None and (best is None or bound < best.bound):
                cost = np.where(undecided, 0.0, field.mechanism.costs(labels) / required)
                best = DualBound(math.inf, cost, bound, field.velocity, number)
        return best

    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Return upper bounds (k,) by mechanisms of a case for labellings (k, m), partly undecided."""
        if not 0 <= case < len(self.problems):
            raise ValueError(f"case: there is no problem {case}; expected 0 to {len(self.problems) - 1}")
        required = self.problems[case].required
        fields = [self.weighed(case, velocity) for velocity in velocities]
        rows = zip(fields, labellings, undecided, strict=True)
        return np.array(
            [math.inf if field is None else raised(field.bound_of(*partial) / required) for field, *partial in rows]
        )

    def weighed(self, number: int, velocity: Floats) -> FieldMechanism | None:
        """Compute the dissipation of velocities (t, 3, 2), or return the stored one; None where it proves nothing."""
        key = number, hashlib.sha256(np.ascontiguousarray(velocity).tobytes()).digest()
        if key not in self._mechanisms:
            self._mechanisms[key] = self._upper_bound_of(number).weigh(velocity)
        return self._mechanisms[key]

    def forget(self) -> None:
        """Forget the stored results of `weighed`, so that a check computes them again."""
        self._mechanisms.clear()

    def _upper_bound_of(self, number: int) -> PartialUpperBound:
        # Bounds of problems that were only added for `weigh` are kept for a while, and then set up anew.
        if number < len(self._refuting):
            return self._refuting[number]
        if number not in self._weighing:
            problem = self.problems[number]
            self._weighing[number] = PartialUpperBound(problem.setting.problem(problem.mesh))
            while len(self._weighing) > _MOST_WEIGHING:
                self._weighing.popitem(last=False)
        return self._weighing[number]


def raised(bound: float) -> float:
    """Return a bound raised by the rounding that a change of units may cause."""
    return bound + abs(bound) * _ROUNDING if math.isfinite(bound) else bound


@dataclass(frozen=True)
class FieldProofContext:
    """Data that stay fixed during a proof by fields, for its check."""

    relaxation: FieldRelaxation  # relaxation that refutes labellings and evaluates mechanisms
    space: SearchSpace
    blocks: PossibleBlocks | None  # possible blocks, where they are listed
    free: Bools  # (m,) faces that may take either label in some labelling

    @property
    def labels(self) -> Bits:
        """Labels (m,), True = dry, of all faces that are not free; free ones are undecided."""
        return np.asarray(self.space.fixed | (self.space.candidates & ~self.free))


_MOST_TIMES: Final = 32  # triangles at which the refinement ends, over those of the coarsest mesh
_MOST_TRIANGLES: Final = 6000  # triangles that no mesh exceeds: a program of more takes many seconds

# Triangles of the meshes on which labellings are refuted beside the coarsest, over those of the coarsest. Of the 4 × 6
# wall, near the bound, conflicts have 10.3 faces on the coarsest mesh, 7.0 and 5.7 on these.
_SHARED: Final = (3.5, 8.0)


@dataclass(frozen=True)
class CommonBound:
    mesh: Mesh
    found: WeighedField  # velocity field with the factor that no labelling exceeds
    bound: float  # governing factor that no labelling exceeds


class CommonMeshes:
    """Meshes of one load case, each refined where all labellings dissipate most; required: factor of the case."""

    def __init__(self, setting: FieldSetting, required: float, labels: Bits, undecided: Bools) -> None:
        self._setting, self._required = setting, required
        self._labels, self._undecided = labels, undecided
        self._next: Mesh | None = setting.coarse
        self._most = min(_MOST_TRIANGLES, _MOST_TIMES * len(setting.coarse))
        self.meshes: list[Mesh] = [setting.coarse]

    @property
    def ended(self) -> bool:
        """True if `step` has no further mesh."""
        return self._next is None

    def step(self) -> CommonBound | None:
        """Bound all labellings on the next mesh; None at the end, which is also where no bound is finite."""
        mesh, self._next = self._next, None
        if mesh is None:
            return None
        if len(mesh) > len(self.meshes[-1]):
            self.meshes.append(mesh)
        partial = PartialUpperBound(self._setting.problem(mesh))
        field = partial.field(self._labels, self._undecided)
        if field is None or not math.isfinite(field.bound):
            return None
        finer = partial.finer(mesh, field.velocity, self._labels, self._undecided)
        if len(mesh) < len(finer) <= self._most:
            self._next = finer
        return CommonBound(mesh, field, raised(field.bound / self._required))

    @property
    def shared(self) -> tuple[int, ...]:
        """Positions in `meshes`, coarsest first, as many for all cases: repeated where refinement ended."""
        sizes = np.array([len(mesh) for mesh in self.meshes])
        positions = [int(np.searchsorted(sizes, times * len(self._setting.coarse))) for times in _SHARED]
        return 0, *(min(position, len(sizes) - 1) for position in positions)


def has_conflict(conflict: Conflict, labellings: Bits, group: Ints) -> Bools:
    """Return (k,) whether a conflict, or an image under the group (g, m), rules out each labelling (k, m)."""
    images = labellings[:, group[:, conflict.faces]]
    return np.asarray((images == conflict.labels).all(axis=2).any(axis=1))


class FieldIncumbents:
    """Bounds of all evaluated labellings, and the pool of those that are refined."""

    def __init__(self, space: SearchSpace, aim: ProofAim) -> None:
        self._space, self._aim = space, aim
        self.pool = FieldPool(space.assembly, np.empty((0, len(space.fixed)), dtype=bool))
        self.counts: Floats = np.empty(0)
        self._evaluated: dict[bytes, tuple[float, float, int]] = {}
        self._rows: dict[bytes, int] = {}

    def counts_of(self, labellings: Bits) -> Floats:
        """Return the value (k,) of the aim's count for labellings (k, m); 0 without a count."""
        count = self._aim.count
        if count is None or not len(labellings):
            return np.zeros(len(labellings))
        return np.asarray(values_of(count, self._space.assembly, labellings, self._space.graph), dtype=float)

    def learn(self, labellings: Bits, low: Sequence[float], high: Sequence[float]) -> None:
        """Store bounds on the governing factor of canonical labellings (k, m)."""
        for labels, *bounds, count in zip(labellings, low, high, self.counts_of(labellings).tolist(), strict=True):
            self._evaluated[labels.tobytes()] = bounds[0], bounds[1], int(count)

    def is_known(self, labels: Bits) -> bool:
        return labels.tobytes() in self._evaluated

    def in_pool(self, labels: Bits) -> bool:
        return labels.tobytes() in self._rows

    def join(self, labellings: Sequence[Bits]) -> Bits:
        """Add labellings (m,) with stored bounds to the pool; return the new ones (k, m)."""
        new = [labels for labels in labellings if not self.in_pool(labels)]
        added = np.array(new, dtype=bool).reshape(len(new), len(self._space.fixed))
        bounds = np.array([self._evaluated[labels.tobytes()] for labels in new]).reshape(-1, 3)
        for labels in new:
            self._rows[labels.tobytes()] = len(self._rows)
        self.pool.add(added, bounds[:, 0], bounds[:, 1])
        self.counts = np.concatenate([self.counts, bounds[:, 2]])
        return added

    def best(self) -> dict[int, float]:
        """Return the largest proven factor of each count; −inf where no layout is proven to stand."""
        lows: dict[int, float] = {}
        for low, _, count in self._evaluated.values():
            lows[count] = max(low, lows.get(count, -math.inf))
        for low, count in zip(self.pool.low().tolist(), self.counts.tolist(), strict=True):
            lows[int(count)] = max(low, lows.get(int(count), -math.inf))
        return lows

    def promising(self, target: int | Range | None, above: float, number: int, tolerance: float) -> list[Bits]:
        """Choose evaluated labellings of a target to refine, greatest lower bounds first."""
        # Only those with a lower bound above 0 are taken.
        rows = [(-low, key, count) for key, (low, high, count) in self._evaluated.items() if low > 0.0 and high > above]
        rows.sort()
        inside = holds(target, np.array([count for *_, count in rows]))
        chosen: list[Bits] = []
        last = -math.inf
        for (negative_low, key, _), within in zip(rows, inside.tolist(), strict=True):
            if within and negative_low - last > tolerance * abs(negative_low):
                chosen.append(np.frombuffer(key, dtype=bool))
                last = negative_low
        return chosen[:number]

    def strongest(self, number: int) -> tuple[Bits, Floats]:
        """Return at most `number` labellings (k, m) of greatest finite lower bounds, with these (k,)."""
        lows = {key: low for key, (low, *_) in self._evaluated.items()}
        for key, low in zip(self._rows, self.pool.low().tolist(), strict=True):
            lows[key] = max(low, lows.get(key, -math.inf))
        stands = sorted((-low, key) for key, low in lows.items() if math.isfinite(low))[:number]
        rows = np.frombuffer(b"".join(key for _, key in stands), dtype=bool)
        return rows.reshape(len(stands), len(self._space.fixed)), np.array([-low for low, _ in stands])


_KEPT_RELAXATIONS: Final = 4  # number of meshes whose programs a process keeps

# Single faces tried in vain on each mesh before a conflict is accepted. With three on the finest mesh alone the 4 × 6
# wall of 20 kPa takes over 168 s of processor time instead of 131 s.
_TRIES: Final = 1
_SHORT: Final = 5  # number of faces of a conflict up to which finer meshes are not tried to shorten it


class _ThreadRelaxations(threading.local):
    """Relaxations that a thread keeps, by proof and level, the latest at the end."""

    def __init__(self) -> None:
        self.relaxations: OrderedDict[tuple[str, int], FieldRelaxation] = OrderedDict()


_thread = _ThreadRelaxations()


@dataclass(frozen=True)
class ProofSetup:
    name: str  # name of the proof, unlike that of any other; each process keeps relaxations by it
    settings: tuple[FieldSetting, ...]  # setting of each load case
    required: tuple[float, ...]  # required factor of each load case
    free: Bools  # (m,) faces that may take either label
    # meshes that all labellings share, from coarse to fine: each level has one mesh for each load case
    levels: tuple[tuple[Mesh, ...], ...]

    def problems(self, level: int) -> list[FieldProblem]:
        triples = zip(self.settings, self.levels[level], self.required, strict=True)
        return [FieldProblem(*triple) for triple in triples]


@dataclass(frozen=True)
class LevelConflict:
    """Result of refuting one labelling on the meshes that all labellings share."""

    first: int  # level (position in `ProofSetup.levels`) that refutes the labelling first, −1 for none
    level: int  # level whose meshes the mechanism of the conflict belongs to, −1 for none
    # the conflict; `Mechanism.case` is the load case. None where no level refutes the labelling.
    conflict: Conflict | None
    solves: int  # programs solved


@one_thread()
def level_conflict(setup: ProofSetup, labels: Bits, threshold: float, levels: tuple[int, ...]) -> LevelConflict:
    """Refute a factor for a labelling (m,), and minimise it to the conflict of fewest faces."""
    # The first level that refutes it gives a conflict; finer levels then try to shorten it.
    solves, last = 0, len(setup.levels) - 1
    first, level, best = -1, -1, None
    for tried in range(last + 1):
        if (best is None and tried not in levels) or (best is not None and len(best.faces) <= _SHORT):
            continue
        relaxation = _relaxation(setup, tried)
        before = relaxation.solves
        faces_left = None if best is None else np.isin(np.arange(len(labels)), best.faces)
        conflict = conflict_of(relaxation, labels, setup.free, threshold, _TRIES, faces_left)
        solves += relaxation.solves - before
        if conflict is not None and (best is None or len(conflict.faces) < len(best.faces)):
            first, level, best = (tried if best is None else first), tried, conflict
    return LevelConflict(first, level, best, solves)


def _relaxation(setup: ProofSetup, level: int) -> FieldRelaxation:
    """Return the relaxation on the meshes of a level, which this thread keeps for a while."""
    # The order of its problems is reset, so that results do not depend on earlier tasks.
    key, relaxations = (setup.name, level), _thread.relaxations
    if key not in relaxations:
        relaxations[key] = FieldRelaxation(setup.problems(level))
        while len(relaxations) > _KEPT_RELAXATIONS:
            relaxations.popitem(last=False)
    relaxations.move_to_end(key)
    relaxations[key].restart()
    return relaxations[key]


@one_thread()
def refuting_step(
    setting: FieldSetting, labels: Bits, mesh: Mesh, required: float, enough: float, free: Bools, over: float
) -> FieldStep:
    """Bound a labelling (m,) on one mesh; `more` holds a conflict if its velocity field refutes `over`."""
    start = time.perf_counter()
    fields = Fields.on(setting, mesh, labels, enough * required)
    conflict = None
    if fields.bounds[1] < over * required:
        relaxation = FieldRelaxation([FieldProblem(setting, mesh, required)])
        conflict = conflict_of(relaxation, labels, free, over, tries=0)
    return step_of(fields, start, _whole_conflict(fields, required, free) if conflict is None else conflict)


def _whole_conflict(fields: Fields, required: float, free: Bools) -> Conflict | None:
    """Return the conflict of all free faces by the mechanism of fields; None without a finite bound."""
    if fields.velocity is None:
        return None
    mechanism = mechanism_bounds(fields.upper, fields.velocity.velocity)
    bound = np.inf if mechanism is None else mechanism.bound_of(fields.labels, np.zeros_like(free)) / required
    if not np.isfinite(bound):
        return None
    faces = np.flatnonzero(free)
    return Conflict(faces, fields.labels[faces], raised(bound), mechanism=Mechanism(0, fields.velocity.velocity))


_FADING: Final = 0.1  # weight of the last labelling in the share of labellings that a mesh refutes
_RARELY: Final = 0.1  # share of labellings refuted by a mesh below which it is left out
_AGAIN: Final = 8  # A mesh that is left out is still tried once in this number of batches


class FieldRefuter:
    """Refuter of the labellings of one space by velocity fields on common meshes."""

    def __init__(self, space: SearchSpace, blocks: PossibleBlocks | None) -> None:
        self._space, self._blocks = space, blocks
        self.free = free_faces(space, blocks)
        # candidates outside every possible block are dry
        self._labels = space.fixed | (space.candidates & ~self.free)
        assembly = space.assembly
        settings = tuple(FieldSetting.of(case) for case in assembly.by_case)
        coarsest = (tuple(setting.coarse for setting in settings),)
        required = tuple(assembly.required.tolist())
        self._setup = ProofSetup(uuid.uuid4().hex, settings, required, self.free, coarsest)
        self.programs = self._batches = 0
        self.restart()

    def restart(self) -> None:
        """Forget all problems but those on the coarsest mesh of each load case."""
        # the problems of each level follow each other; the finer levels are added as the proof begins
        self._setup = replace(self._setup, name=uuid.uuid4().hex, levels=self._setup.levels[:1])
        self.relaxation, self._first = FieldRelaxation(self._setup.problems(0)), [0]
        self._share = [1.0]

    @property
    def cases(self) -> int:
        return len(self._setup.settings)

    def load_case(self, problem: FieldProblem) -> int:
        return next(case for case, setting in enumerate(self._setup.settings) if setting is problem.setting)

    def add_problem(self, case: int, mesh: Mesh) -> int:
        """Add a mesh, scene units, to weigh mechanisms on; return the position of the problem."""
        return self.relaxation.add(FieldProblem(self._setup.settings[case], mesh, self._setup.required[case]))

    def weigh(self, conflict: Conflict) -> float:
        """Return the factor that no labelling with a conflict exceeds, by its mechanism; inf for none."""
        if conflict.mechanism is None:
            return math.inf
        labels, undecided = self._labels.copy(), self.free.copy()
        labels[conflict.faces], undecided[conflict.faces] = conflict.labels, False
        mechanism = conflict.mechanism
        return float(
            self.relaxation.evaluate_mechanisms(
                mechanism.case, mechanism.velocity[None], labels[None], undecided[None]
            )[0]
        )

    def common(self, case: int) -> CommonMeshes:
        """Make new meshes of a load case, to bound all labellings on."""
        return CommonMeshes(self._setup.settings[case], self._setup.required[case], self._labels, self.free)

    def refute_on(self, meshes: Sequence[CommonMeshes]) -> None:
        """Refute labellings on some finer meshes too from now on, beside the coarsest."""
        positions = dict.fromkeys(zip(*(common.shared for common in meshes), strict=True))
        levels = tuple(tuple(common.meshes[k] for common, k in zip(meshes, row, strict=True)) for row in positions)
        self._setup = replace(self._setup, levels=levels)
        self._share = [1.0] * len(levels)
        for level in range(1, len(levels)):
            self._first.append(len(self.relaxation.problems))
            for problem in self._setup.problems(level):
                self.relaxation.add(problem)

    def refute(self, labellings: Sequence[Bits], threshold: float, tasks: Pool) -> list[Conflict | None]:
        """Prove that labellings carry less than a governing factor: a conflict each, None if unproven."""
        levels = self._levels()
        results = list(tasks.run(level_conflict, [(self._setup, labels, threshold, levels) for labels in labellings]))
        self.programs += sum(result.solves for result in results)
        conflicts: list[Conflict | None] = []
        for result in results:
            # The level that refuted the labelling, and coarser ones that did not, shift the shares by which `_levels`
            # picks.
            for level in levels[: levels.index(result.first) + 1 if result.first >= 0 else None]:
                self._share[level] += _FADING * ((level == result.first) - self._share[level])
            conflict = result.conflict
            # `case` counts from the first problem of the level; in a proof it is the position among all problems
            if conflict is not None and conflict.mechanism is not None:
                number = conflict.mechanism.case + self._first[result.level]
                conflict = replace(conflict, mechanism=replace(conflict.mechanism, case=number))
            conflicts.append(conflict)
        return conflicts

    def _levels(self) -> tuple[int, ...]:
        """Return the levels of meshes to try first; those that rarely refute only at intervals."""
        self._batches += 1
        try_all = not self._batches % _AGAIN
        return tuple(level for level, share in enumerate(self._share) if share >= _RARELY or try_all)

    def context(self) -> FieldProofContext:
        """Return the data for the check of a proof, which weighs all mechanisms again."""
        self.relaxation.forget()
        return FieldProofContext(self.relaxation, self._space, self._blocks, self.free)
