"""Default search of large scenes: climbs whose improvements are merged, beside annealing and a genetic population."""

from __future__ import annotations

import math
from collections import Counter
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
from jld_explore.evaluation.protocol import Envelope, Evaluation, front_counts, sort_key
from jld_explore.space import keys
from jld_explore.space.search_space import SearchSpace

# Changes of the labelling of a climb that are evaluated together, from `_CHEAP` faces that can change and below.
_CHANGES: Final = (16, 32)
_CHEAP: Final = 200
_MOST: Final = 4  # times as many, at most, without progress
_FIRST: Final = 8  # labellings among which a climb begins at the best
_SCREENED: Final = (2, 1)  # changes made for each one that is evaluated, likewise; the surrogate chooses
_LEARNED: Final = 32  # labellings that the surrogate must know before it chooses

_PATIENCE: Final = 3  # evaluations without progress, per face that can change, after which a climb ends
_LEAST_SHARE: Final = 0.1  # smallest share of changes of each kind
_LEAST_GAIN: Final = 1e-3  # smallest gain of a kind of change, so that shares stay defined
_MOST_STEPS: Final = 6  # largest number of changes made at once
_STEPS: Final = (1.3, 8.0)  # smallest and largest mean number of changes made at once
_MEMORY: Final = 0.02  # weight of the latest evaluation in the gain of its kind of change
_FRESH: Final = 0.1  # weight of the latest batch in what evaluations for the front have gained
_GAIN: Final = 0.05  # relative gain in λ that counts as much as any larger one
_REFRESH: Final = 3  # moves of a climb after which its mechanism is computed anew

# faces that can change from which few chains are annealed and no batch is asked ahead, as each evaluation takes long
_FACES: Final = 600
_CHAINS: Final = (16, 4)  # number of chains below and above that
_FRONT_SHARES: Final = (0.15, 0.5)  # share of evaluations for the front, and while λ has not risen in half of all
_RISE: Final = 1e-4  # relative gain of λ that counts as one
_BRIEF: Final = 2  # batches without progress of the first climb at a labelling of the front; each later one has twice
# Evaluations of chains and population per one of a climb, likewise, and how many times as many once climbs gain nothing
_RATIOS: Final = (1.0, 8.0)
_LONGEST: Final = 4.0

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
    # a labelling and changes of it that were made before its own changes were known, with their origins
    prepared: tuple[Bits, Bits, list[tuple[str, int]]] | None = None
    fallen: Bits = field(default_factory=lambda: np.empty((0, 0), dtype=bool))  # (k, m) the labellings evaluated last
    idle: int = 0  # evaluations since the last progress
    spent: int = 0  # evaluations in all
    floor: Floats | None = None  # (c,) counts that every change must have or better; None for any
    patience: int = 0  # evaluations without progress after which it ends


class PortfolioOptions(DriverOptions):
    # the largest λ for every value of the count, or the largest λ alone, sought by the population
    aim: Aim = Field("front", description="best, or front (the best for every count)")


class Portfolio(Anneal):
    """Driver that climbs by merged changes, and in turns anneals chains and breeds a population."""

    name = "portfolio"
    Options = PortfolioOptions

    def __init__(self, space: SearchSpace, seed: int = 0, aim: Aim = "front") -> None:
        # A climb needs few evaluations, so it comes first; where one layout takes long it does not end. Once it stalls
        # chains and population go on, and climbs start from the best of all. They have the more time the fewer climbs
        # gain. For a front some evaluations climb at labellings of it, each without worse counts, or are of the
        # population.
        faces = int(space.candidates.sum())
        super().__init__(space, seed, _CHAINS[faces >= _FACES], aim)
        self._cheap = cheap = faces < _CHEAP
        # Where a layout takes long, climbs have few steps, each of which should know the one before: changes are only
        # prepared meanwhile. Elsewhere one batch is made while another is evaluated.
        self.ahead = int(faces < _FACES)
        self.aim, self._together, self._screened = aim, _CHANGES[cheap], _SCREENED[cheap]
        self._others_per_climb = _RATIOS[cheap]
        self._patience = _PATIENCE * self.operators.keys
        self._choice = np.random.default_rng([seed, 2])
        self._surrogate = Surrogate(space)
        self._told: list[tuple[Bits, Floats, Ints, Ints]] = []
        self._climb: _Climb | None = _Climb(patience=self._patience)
        self._climbing: dict[bytes, tuple[_Climb, str, int]] = {}
        self._envelope = Envelope(len(space.search.front.axes))
        self._leaders: list[tuple[Bits, int]] = []  # labels and governing load case of each entry of the envelope
        self._tried: Counter[bytes] = Counter()  # climbs along the front that gained nothing, by where they began
        self._ascent: _Climb | None = None  # climb along the front
        # Evaluations for the front, of climbs and of the population, what they gained, and how many are due. The many
        # dry faces at one end of the front take long where there are many, so the first ones wait.
        self._spent, self._won, self._due = np.zeros(2), np.ones(2), -_FRONT_SHARES[0] * self.operators.keys
        # Evaluations in all, and when the largest λ, or rank of a status, last rose
        self._all, self._risen, self._top = 0, 0, -math.inf
        self._gain = dict.fromkeys(_KINDS, 1.0)
        self._steps = {"vary": 2.0, "follow": 2.0}
        # Chains know their own best alone: at a common one half of them would end where the first climb did.
        self._incumbent: tuple[float, Bits | None, int] = (math.inf, None, 0)
        self._known: float = math.inf  # energy of the incumbent when the last climb ended
        self._ratio, self._left, self._ended = 1.0, 0.0, 0  # the last: climbs that have ended

    @property
    def settings(self) -> dict[str, Any]:
        return {"aim": self.aim, **super().settings}

    def prepare(self) -> None:
        if self.ahead:
            return
        if self._climb is None and self._left > 0.0:
            super().prepare()
        for climb in (self._climb, self._ascent):
            if climb is None or climb.labelling is None or climb.prepared is not None:
                continue
            if climb.idle <= climb.patience and climb.energy < _NO_LOAD_FACTOR:
                count = min(self._together + climb.idle, _MOST * self._together)
                climb.prepared = climb.labelling, *self._candidates(climb, climb.labelling, count)

    def propose(self) -> Bits:
        self._learn()
        rows = self._no_labellings
        if min(self._spent.sum(), 2.0 * self._spent[0]) < self._due and self._leaders:
            rows = self._of_front()
            if len(rows) >= max(1, self.size // 8):
                return rows
        if self._climb is None and self._left <= 0.0:
            self._climb = self._next_climb()
        if self._climb is not None:
            rows = np.concatenate([rows, self._climb_from(self._climb)])
            if len(rows) >= max(1, self.size // 8):  # enumeration starts when batches become short
                return rows
            self._end_climb(self._climb)
        others = super().propose()
        self._left -= len(others)
        return np.concatenate([rows, others])

    def _learn(self) -> None:
        """Take in all evaluations at once, whatever calls of `tell` they came from."""
        if self._told:
            rows, values, cases, source = (np.concatenate(parts) for parts in zip(*self._told, strict=True))
            self._told = []
            self._all += len(rows)
            if (top := float(values.max())) > self._top * (1.0 + math.copysign(_RISE, self._top)):
                self._top, self._risen = top, self._all
            idle = self._all - self._risen > max(0.5 * self._all, 0.5 * self.operators.keys)
            self._due += _FRONT_SHARES[idle] * len(rows)
            self._surrogate.learn(rows, values)
            good = np.flatnonzero(values > -_NO_LOAD_FACTOR)
            if self.aim == "front" and len(good):
                self._learn_front(rows[good], values[good], cases[good], source[good])
        for climb in (self._climb, self._ascent):
            if climb is not None and climb.changes:
                self._accept(climb)

    def _learn_front(self, rows: Bits, values: Floats, cases: Ints, source: Ints) -> None:
        """Take labellings (k, m) with λ, load cases and sources (k,), 0 for climbs along it, into the front."""
        counts = front_counts(self.space, rows)
        gained = np.clip(values - np.maximum(self._envelope.best(counts), 0.0), 0.0, None)
        gained /= max(abs(self._incumbent[0]), 1e-300)
        for k in (0, 1):
            if (own := source == k).any():
                self._won[k] = max(self._won[k] + _FRESH * (gained[own].mean() - self._won[k]), 1e-12)
        known = len(self._leaders)
        self._leaders = [
            self._leaders[k] if k < known else (rows[k - known], int(cases[k - known]))
            for k in self._envelope.learn(values, counts).tolist()
        ]

    def _of_front(self) -> Bits:
        """Return changes (k, m) of a labelling of the front, at least in half of what is due, else a generation too."""
        if 2.0 * self._spent[0] < self._due or self._choice.random() * self._won.sum() < self._won[0]:
            self._ascent = self._ascent or self._next_ascent()
            rows = self._climb_from(self._ascent)
            self._spent[0] += len(rows)
            if len(rows):
                return rows
            self._tried[np.asarray(self._ascent.labelling).tobytes()] += 1
            self._ascent = None
        return self._generation()

    def _generation(self) -> Bits:
        rows = super()._generation()
        self._spent[1] += len(rows)
        return rows

    def _next_ascent(self) -> _Climb:
        """Return a climb at the labelling of the front where fewest have gained nothing."""
        tried = np.array([self._tried[labels.tobytes()] for labels, _ in self._leaders])
        k = int(self._choice.choice(np.flatnonzero(tried == tried.min())))
        labels, case = self._leaders[k]
        patience = min(_BRIEF * self._together * 2 ** int(tried[k]), self._patience)
        value = float(self._envelope.values[k])
        return _Climb(labels, -value, case, floor=self._envelope.counts[k], patience=patience)

    def _next_climb(self) -> _Climb:
        """Return a climb at the incumbent if chains or population found it, else one without a labelling."""
        energy, best, case = self._incumbent
        if best is None or energy >= self._known:
            return _Climb(patience=self._patience)
        return _Climb(best, energy, case, patience=self._patience)

    def _end_climb(self, climb: _Climb) -> None:
        """End a climb; one that gained nothing leaves more time to chains and population than the one before."""
        gained = self._incumbent[0] < self._known and climb.energy <= self._incumbent[0]
        self._ratio = max(1.0, self._ratio / 2.0) if gained else min(_LONGEST, 2.0 * self._ratio)
        if self._incumbent[0] >= _NO_LOAD_FACTOR:  # nothing stands yet
            self._ratio = 1.0 / self._others_per_climb
        # where one layout takes longer a climb has many evaluations, and chains gain little in as many more
        some = min(max(climb.spent, 2 * self.operators.keys), (math.inf if self._cheap else 4) * self.operators.keys)
        self._left, self._ended = self._others_per_climb * self._ratio * some, self._ended + 1
        self._climb, self._known = None, self._incumbent[0]

    def _climb_from(self, climb: _Climb) -> Bits:
        """Return changes (k, m) of the labelling of a climb, or labellings among which it begins."""
        if climb.labelling is None:
            rows = self._beginnings()
            self._climbing.update((key, (climb, "begin", 1)) for key in keys(rows))
            return rows
        if climb.idle > climb.patience:
            return self._no_labellings
        if climb.energy >= _NO_LOAD_FACTOR:
            return self._walk_to_standing(climb)
        batches, prepared, climb.prepared = [self._merge_improvements(climb)], climb.prepared, None
        # making changes costs about as much for many as for few, and a climb at rest loses nothing by many
        lacking = min(self._together + climb.idle, _MOST * self._together) - len(batches[0])
        if prepared is not None and lacking > 0:
            base, rows, origins = prepared
            if base is not climb.labelling:
                rows, of = self._carry_over(rows, base, climb.labelling)
                origins = [origins[k] for k in of.tolist()]
            batches.append(self._admit(climb, rows, origins, lacking))
            lacking -= len(batches[-1])
        for _ in range(4):
            checkpoint()
            if lacking <= 0:
                break
            batches.append(self._admit(climb, *self._candidates(climb, climb.labelling, lacking), lacking))
            lacking -= len(batches[-1])
        return np.concatenate(batches)

    def _beginnings(self) -> Bits:
        """Return random labellings, or every other time crossings of the incumbent with labellings of chains."""
        best = self._incumbent[1]
        if best is None or self._incumbent[0] >= _NO_LOAD_FACTOR or (self._ended % 2 and not self._cheap):
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

    def _walk_to_standing(self, climb: _Climb) -> Bits:
        """Return changes (k, m) of labellings that do not stand, each where it falls."""
        rows = np.resize(climb.fallen, (self._together, climb.fallen.shape[1]))
        changed, _ = self._follow.changes(
            rows, self._follow.parts(rows), self._movements[climb.case].of(rows), self.rng
        )
        return self._admit(climb, changed, [("walk", 1)] * len(changed))

    def _merge_improvements(self, climb: _Climb) -> Bits:
        """Return labellings (k, m) with the changes of two, three, half or all improvements at once."""
        better, before = climb.better, climb.before
        climb.better = []
        if len(better) < 2 or before is None:
            return self._no_labellings
        (base, *improved), merges = self.operators.write(np.array([before, *better])), []
        for number in sorted({2, min(3, len(better)), max(2, len(better) // 2), len(better)}):
            merged, changed = base.copy(), np.zeros(len(base), dtype=bool)
            for row_keys in improved[:number]:  # of two changes of one key the first holds
                changing = (row_keys != base) & ~changed
                merged[changing], changed = row_keys[changing], changed | changing
            merges.append(merged)
        # Merged keys may ask for no partition. Noise then decides which pairs `read` joins first; it crosses no
        # threshold.
        noise = 0.1 * np.reshape(self.rng.reals(len(merges) * len(base)), (-1, len(base)))
        rows = self.operators.read(np.array(merges) + noise)[0]
        return self._admit(climb, rows, [("merge", 1)] * len(rows))

    def _carry_over(self, rows: Bits, base: Bits, labels: Bits) -> tuple[Bits, Ints]:
        """Change labels (m,) as rows (k, m) change a base (m,), where that gives blocks: labellings, row of each."""
        base_keys, label_keys, *row_keys = self.operators.write(np.concatenate([base[None], labels[None], rows]))
        changed = np.array(row_keys) != base_keys
        apart = np.flatnonzero(~(changed & (label_keys != base_keys)).any(axis=1))  # keys that labels have changed stay
        carried = np.where(changed[apart], np.array(row_keys)[apart], label_keys)
        changed_labellings, source = self.operators.read(carried, repair=False)
        return changed_labellings, apart[source]

    def _admit(self, climb: _Climb, rows: Bits, origins: list[tuple[str, int]], most: int | None = None) -> Bits:
        """Register new labellings among rows (k, m), the most promising if there are too many, with their origins."""
        if climb.floor is not None:
            good = np.flatnonzero((front_counts(self.space, rows) <= climb.floor).all(axis=1))
            rows, origins = rows[good], [origins[k] for k in good.tolist()]
        if most is not None and len(self._surrogate) > _LEARNED:
            order = np.argsort(-self._surrogate.predict(rows), kind="stable")
        else:
            order = self._choice.permutation(len(rows))
        fresh, names, places = self.register.admitted(rows[order], most, all_feasible=self.operators.always_feasible)
        self._climbing.update(
            (name, (climb, *origins[order[k]])) for name, k in zip(names, places.tolist(), strict=True)
        )
        return fresh

    def _candidates(self, climb: _Climb, labels: Bits, count: int) -> tuple[Bits, list[tuple[str, int]]]:
        """Return changes (k, m) of labels (m,), with the kind of each and the number of changes at once."""
        share = np.array([self._gain[kind] for kind in _KINDS])
        share = _LEAST_SHARE + (1.0 - len(_KINDS) * _LEAST_SHARE) * share / share.sum()
        vary, follow, cross = self._choice.multinomial(
            self._screened * count * (1 if climb.floor is None else 2), share / share.sum()
        ).tolist()
        children = [self._vary(labels, vary), self._follow_mechanism(climb, labels, follow)]
        if cross:
            others = self._others(cross)
            crossed = self.operators.cross_indexed(np.repeat(labels[None], cross, axis=0), others, self.rng)[0]
            children.append((crossed, [("cross", 1)] * len(crossed)))
        return np.concatenate([rows for rows, _ in children]), [origin for _, origins in children for origin in origins]

    def _numbers(self, kind: str, count: int) -> Ints:
        """Return how many changes (count,) to make at once, by those that gained."""
        return np.minimum(self._choice.geometric(1.0 / self._steps[kind], size=count), _MOST_STEPS)

    def _vary(self, labels: Bits, count: int) -> tuple[Bits, list[tuple[str, int]]]:
        """Vary a labelling (m,) in `count` ways of one step or more: rows (count, m), and the origin of each."""
        steps_of_row, batches, origins = self._numbers("vary", count), [self._no_labellings], []
        rows = np.repeat(labels[None], count, axis=0)
        for steps in range(1, int(steps_of_row.max(initial=0)) + 1):
            checkpoint()
            rows = self.operators.breed(rows[:0], rows[:0], rows, self.rng)
            finished = rows[: int(np.count_nonzero(steps_of_row == steps))]
            batches.append(finished)
            origins += [("vary", steps)] * len(finished)
            rows = rows[len(finished) :]
        return np.concatenate(batches), origins

    def _follow_mechanism(self, climb: _Climb, labels: Bits, count: int) -> tuple[Bits, list[tuple[str, int]]]:
        """Return changes (count, m) of labels (m,) where its mechanism moves."""
        if not count:
            return self._no_labellings, []
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

    def _accept(self, climb: _Climb) -> None:
        """Move a climb to its best change unless that is worse, and keep all improvements to be merged."""
        climb.changes.sort(key=lambda change: change[0])
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

    def like(self, space: SearchSpace) -> Portfolio:
        return Portfolio(space, self.seed, "best")

    def go_on_from(self, rows: Bits) -> None:
        super().go_on_from(rows)
        if self._climb is None:
            self._climb, self._left = _Climb(patience=self._patience), 0.0
        self._climbing.update((name, (self._climb, "begin", 1)) for name in keys(rows))

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        names = keys(labellings)
        source = np.where([name in self._of_population for name in names], 1, 2)
        super().tell(labellings, evaluations)
        objective, cases = [], [max(found.governing, 0) for found in evaluations]
        for k, (name, labels, found, case) in enumerate(zip(names, labellings, evaluations, cases, strict=True)):
            rank, loss = sort_key(found)
            energy = loss + _NO_LOAD_FACTOR * rank
            objective.append(-energy)
            if energy < self._incumbent[0]:
                self._incumbent = (energy, labels, case)
            origin = self._climbing.pop(name, None)
            if origin is not None:
                self._credit(origin[0], energy, *origin[1:])
                source[k] = 2 if origin[0].floor is None else 0
                origin[0].changes.append((energy, case, labels))
        self._told.append((labellings, np.array(objective), np.array(cases), source))

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
