"""Default search of large scenes: a climb whose improvements are merged, beside annealing and a genetic population."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits, Floats, Ints
from jld_core.deadline import checkpoint
from jld_explore.drivers.anneal import Anneal
from jld_explore.drivers.base import Aim, DriverOptions
from jld_explore.drivers.searcher import Surrogate
from jld_explore.evaluation.protocol import Evaluation, sort_key
from jld_explore.space import keys
from jld_explore.space.search_space import SearchSpace

# Changes of the labelling of a climb that are evaluated together, from `_CHEAP` faces that can change and below.
_CHANGES: Final = (16, 32)
_CHEAP: Final = 200
_FIRST: Final = 8  # labellings among which a climb begins at the best
_SCREENED: Final = 2  # changes made for each one that is evaluated; the surrogate chooses
_LEARNED: Final = 32  # labellings that the surrogate must know before it chooses

_PATIENCE: Final = 3  # evaluations without progress, per face that can change, after which a climb ends
_LEAST_SHARE: Final = 0.1  # smallest share of changes of each kind
_LEAST_GAIN: Final = 1e-3  # smallest gain of a kind of change, so that shares stay defined
_MOST_STEPS: Final = 12  # largest number of changes made at once
_STEPS: Final = (1.3, 8.0)  # smallest and largest mean number of changes made at once
_MEMORY: Final = 0.02  # weight of the latest evaluation in the gain of its kind of change
_GAIN: Final = 0.05  # relative gain in λ that counts as much as any larger one
_REFRESH: Final = 3  # moves of a climb after which its mechanism is computed anew

_FACES: Final = 600  # faces that can change from which few chains are annealed, as each evaluation takes long
_CHAINS: Final = (16, 4)  # number of chains below and above that
_TURNS_OF_FRONT: Final = 2  # one turn in this number of those of chains and population is the population's for a front
_LONGEST: Final = 8  # evaluations of chains and population, at most, per evaluation of a climb that gained nothing

_NO_LOAD_FACTOR: Final = 1e300  # energy per rank of the status, as in annealing

_KINDS: Final = ("vary", "follow", "cross")  # changes at random, by the mechanism, and towards another labelling


@dataclass
class _Climb:
    """State of a climb, whose labelling is the best it has found."""

    labelling: Bits | None = None  # (m,) current labelling, True = dry; None before the first ones are evaluated
    energy: float = math.inf  # −λ of that labelling
    case: int = 0  # index of its governing load case
    moving: Floats | None = None  # (m,) relative motion of each face in a mechanism of it or of one shortly before
    moves: int = 0  # moves since that mechanism was computed
    changes: list[tuple[float, int, Bits]] = field(default_factory=list)  # energy, load case, labels evaluated since
    better: list[Bits] = field(default_factory=list)  # changes of the labelling before that were better than it
    before: Bits | None = None  # (m,) that labelling
    fallen: Bits = field(default_factory=lambda: np.empty((0, 0), dtype=bool))  # (k, m) the labellings evaluated last
    idle: int = 0  # evaluations since the last progress
    spent: int = 0  # evaluations in all


class PortfolioOptions(DriverOptions):
    # the largest λ for every value of the count, or the largest λ alone, sought by the population
    aim: Aim = Field("front", description="best, or front (the best for every count)")


class Portfolio(Anneal):
    """Driver that climbs by merged changes, and in turns anneals chains and breeds a population."""

    name = "portfolio"
    Options = PortfolioOptions

    def __init__(self, space: SearchSpace, seed: int = 0, aim: Aim = "front") -> None:
        # A climb needs few evaluations, so it comes first; where one layout takes long it does not end. Once it stalls
        # chains and population go on, all with one incumbent, and climbs start from what they find. They have the more
        # time the fewer climbs gain.
        super().__init__(space, seed, _CHAINS[int(space.candidates.sum()) >= _FACES], aim)
        if aim == "front":
            self._turns_behind = _TURNS_OF_FRONT
        self.aim, self._together = aim, _CHANGES[int(space.candidates.sum()) < _CHEAP]
        self._choice = np.random.default_rng([seed, 2])
        self._surrogate = Surrogate(space)
        self._told: list[tuple[Bits, Floats]] = []
        self._climb: _Climb | None = _Climb()
        self._climbing: dict[bytes, tuple[str, int]] = {}
        self._gain = dict.fromkeys(_KINDS, 1.0)
        self._steps = {"vary": 2.0, "follow": 2.0}
        self._known: float = math.inf  # energy of the incumbent when the last climb ended
        self._ratio, self._left = 1.0, 0.0

    @property
    def settings(self) -> dict[str, Any]:
        return {"aim": self.aim, **super().settings}

    def propose(self) -> Bits:
        rows = self._none
        if self._told:  # at once, whatever calls of `tell` they came from
            self._surrogate.learn(*(np.concatenate(parts) for parts in zip(*self._told, strict=True)))
            self._told = []
        self._accept_climb()
        if self._climb is None and self._left <= 0.0:
            self._climb = self._next_climb()
        if self._climb is not None:
            rows = self._climb_from(self._climb)
            if len(rows) >= max(1, self.size // 8):  # enumeration starts when batches become short
                return rows
            self._end_climb(self._climb)
        others = super().propose()
        self._left -= len(others)
        return np.concatenate([rows, others])

    def _next_climb(self) -> _Climb:
        """Return a climb at the incumbent if chains or population found it, else one without a labelling."""
        energy, best, case = self._best
        if best is None or energy >= self._known:
            return _Climb()
        return _Climb(best, energy, case)

    def _end_climb(self, climb: _Climb) -> None:
        """End a climb; one that gained nothing leaves more time to chains and population than the one before."""
        gained = self._best[0] < self._known and climb.energy <= self._best[0]
        gained |= self._best[0] >= _NO_LOAD_FACTOR  # nothing stands yet
        self._ratio = max(1.0, self._ratio / 2.0) if gained else min(float(_LONGEST), 2.0 * self._ratio)
        self._left = self._ratio * max(climb.spent, 2 * self.operators.keys)
        self._climb, self._known = None, self._best[0]

    def _climb_from(self, climb: _Climb) -> Bits:
        """Return changes (k, m) of the labelling of a climb, or labellings among which it begins."""
        if climb.labelling is None:
            rows = self._beginnings()
            self._climbing.update((key, ("begin", 1)) for key in keys(rows))
            return rows
        if climb.idle > _PATIENCE * self.operators.keys:
            return self._none
        if climb.energy >= _NO_LOAD_FACTOR:
            return self._walked(climb)
        batches = [self._merged(climb)]
        lacking = self._together - len(batches[0])
        for _ in range(4):
            checkpoint()
            if lacking <= 0:
                break
            batches.append(self._admitted(*self._candidates(climb, climb.labelling, lacking), lacking))
            lacking -= len(batches[-1])
        return np.concatenate(batches)

    def _beginnings(self) -> Bits:
        """Return random labellings, or crossings of the incumbent with labellings of chains, and changes of it."""
        best = self._best[1]
        if best is None or self._best[0] >= _NO_LOAD_FACTOR:
            return self.fresh(self.draw, _FIRST)
        many = np.repeat(best[None], _FIRST, axis=0)
        crossed = self.register.admit(self.operators.cross_indexed(many, self._others(_FIRST), self.rng)[0])
        return np.concatenate([crossed, self.register.admit(self.operators.breed(many[:0], many[:0], many, self.rng))])

    def _others(self, count: int) -> Bits:
        """Return symmetric images (count, m) of labellings of chains and population, or of random ones."""
        chains = [chain.labelling[None] for chain in self._chains if chain.labelling is not None]
        known = np.concatenate([*chains, self._population.leading])
        if not len(known):
            known = self.draw(_FIRST)
        group = self.space.group
        chosen = known[self._choice.integers(len(known), size=count)]
        return np.take_along_axis(chosen, group[self._choice.integers(len(group), size=count)], axis=1)

    def _walked(self, climb: _Climb) -> Bits:
        """Return changes (k, m) of labellings that do not stand, each where it falls."""
        rows = np.resize(climb.fallen, (self._together, climb.fallen.shape[1]))
        changed, _ = self._follow.changes(
            rows, self._follow.parts(rows), self._movements[climb.case].of(rows), self.rng
        )
        return self._admitted(changed, [("walk", 1)] * len(changed))

    def _merged(self, climb: _Climb) -> Bits:
        """Return labellings (k, m) with the changes of two, three, half or all improvements at once."""
        better, before = climb.better, climb.before
        climb.better = []
        if len(better) < 2 or before is None:
            return self._none
        base, found = np.array(self.operators.write(before)), []
        written = [np.array(self.operators.write(row)) for row in better]
        for number in sorted({2, min(3, len(better)), max(2, len(better) // 2), len(better)}):
            merged, taken = base.copy(), np.zeros(len(base), dtype=bool)
            for one in written[:number]:
                fresh = (one != base) & ~taken
                merged[fresh], taken = one[fresh], taken | fresh
            jitter = 0.1 * np.array(self.rng.reals(len(base)))
            found.append(self.operators.read((merged + jitter).tolist()))
        return self._admitted(np.concatenate(found), [("merge", 1)] * sum(map(len, found)))

    def _admitted(self, rows: Bits, origins: list[tuple[str, int]], most: int | None = None) -> Bits:
        """Register new labellings among rows (k, m), the most promising if there are too many, with their origins."""
        if most is not None and len(self._surrogate) > _LEARNED:
            order = np.argsort(-self._surrogate.predict(rows), kind="stable")
        else:
            order = self._choice.permutation(len(rows))
        fresh, names, places = self.register.admitted(rows[order], most, all_feasible=self.operators.always_feasible)
        self._climbing.update((name, origins[order[k]]) for name, k in zip(names, places.tolist(), strict=True))
        return fresh

    def _candidates(self, climb: _Climb, labels: Bits, count: int) -> tuple[Bits, list[tuple[str, int]]]:
        """Return changes (k, m) of labels (m,), with the kind of each and the number of changes at once."""
        share = np.array([self._gain[kind] for kind in _KINDS])
        share = _LEAST_SHARE + (1.0 - len(_KINDS) * _LEAST_SHARE) * share / share.sum()
        vary, follow, cross = self._choice.multinomial(_SCREENED * count, share / share.sum()).tolist()
        children = [self._varied(labels, vary), self._followed(climb, labels, follow)]
        if cross:
            others = self._others(cross)
            crossed = self.operators.cross_indexed(np.repeat(labels[None], cross, axis=0), others, self.rng)[0]
            children.append((crossed, [("cross", 1)] * len(crossed)))
        return np.concatenate([rows for rows, _ in children]), [one for _, origins in children for one in origins]

    def _numbers(self, kind: str, count: int) -> Ints:
        """Return how many changes (count,) to make at once, by those that gained."""
        return np.minimum(self._choice.geometric(1.0 / self._steps[kind], size=count), _MOST_STEPS)

    def _varied(self, labels: Bits, count: int) -> tuple[Bits, list[tuple[str, int]]]:
        """Return random changes (k, m) of labels (m,)."""
        many, batches, origins = self._numbers("vary", count), [self._none], []
        rows = np.repeat(labels[None], count, axis=0)
        for steps in range(1, int(many.max(initial=0)) + 1):
            checkpoint()
            rows = self.operators.breed(rows[:0], rows[:0], rows, self.rng)
            done = rows[: int(np.count_nonzero(many == steps))]
            batches.append(done)
            origins += [("vary", steps)] * len(done)
            rows = rows[len(done) :]
        return np.concatenate(batches), origins

    def _followed(self, climb: _Climb, labels: Bits, count: int) -> tuple[Bits, list[tuple[str, int]]]:
        """Return changes (count, m) of labels (m,) where its mechanism moves."""
        if not count:
            return self._none, []
        if climb.moving is None or climb.moves >= _REFRESH:
            climb.moving, climb.moves = self._movements[climb.case].of(labels[None])[0], 0
        many, rows = self._numbers("follow", count), np.repeat(labels[None], count, axis=0)
        for steps in range(int(many.max())):
            checkpoint()
            some = np.flatnonzero(many > steps)
            moving = np.repeat(climb.moving[None], len(some), axis=0)
            changed, of = self._follow.changes(rows[some], self._follow.parts(rows[some]), moving, self.rng)
            # where slits are allowed one labelling may give several changes: the last one stays
            rows[some[of]] = changed
        return rows, [("follow", k) for k in many.tolist()]

    def _accept_climb(self) -> None:
        """Move the climb to its best change unless that is worse, and keep all improvements to be merged."""
        climb = self._climb
        if climb is None or not climb.changes:
            return
        climb.changes.sort(key=lambda one: one[0])
        energy, case, row = climb.changes[0]
        climb.spent += len(climb.changes)
        climb.idle = 0 if energy < climb.energy - 1e-7 * abs(climb.energy) else climb.idle + len(climb.changes)
        if climb.labelling is not None:
            climb.better = [labels for value, _, labels in climb.changes if value < climb.energy]
        if energy <= climb.energy:
            climb.before, climb.labelling, climb.energy, climb.case = climb.labelling, row, energy, case
            climb.moves += 1
        climb.fallen = np.array([labels for _, _, labels in climb.changes])
        climb.changes = []

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        super().tell(labellings, evaluations)
        objective = []
        for key, labels, found in zip(keys(labellings), labellings, evaluations, strict=True):
            rank, loss = sort_key(found)
            objective.append(-loss if rank == 0 else -_NO_LOAD_FACTOR * rank)
            origin = self._climbing.pop(key, None)
            if origin is None or self._climb is None:
                continue
            energy = loss + _NO_LOAD_FACTOR * rank
            self._credit(self._climb, energy, *origin)
            self._climb.changes.append((energy, max(found.governing, 0), labels))
        self._told.append((labellings, np.array(objective)))

    def _credit(self, climb: _Climb, energy: float, kind: str, steps: int) -> None:
        """Count what a change of the labelling of a climb has gained."""
        if kind not in self._gain or climb.labelling is None:
            return
        finite = abs(climb.energy) < _NO_LOAD_FACTOR and climb.energy != 0.0
        gained = (climb.energy - energy) / (abs(climb.energy) if finite else max(abs(climb.energy), 1e-300))
        gained = min(max(0.0, gained) / _GAIN, 1.0) * _GAIN * 100.0
        self._gain[kind] = max(self._gain[kind] + _MEMORY * (gained - self._gain[kind]), _LEAST_GAIN)
        if gained > 0.0 and kind in self._steps:
            weight = min(1.0, 0.1 * math.sqrt(gained / self._gain[kind]))
            mean = self._steps[kind] + weight * (steps + 0.3 - self._steps[kind])
            self._steps[kind] = min(max(mean, _STEPS[0]), _STEPS[1])
