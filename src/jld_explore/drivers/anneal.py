"""Annealing over partitions, with changes that the mechanism of a labelling suggests, beside a population.

What collapses is where its mechanism moves, so little else is worth a change: blocks are joined across a face that
moves, and where nothing moves one is cut, which leaves room for others to join; now and then a labelling is crossed
with that of another chain, or with its own mirror image. Several chains run side by side, each with several changes of
its labelling at a time, so that labellings are evaluated many at once and their mechanisms asked for seldom. The best
of its changes a chain takes always where it is stronger, and where it is weaker with probability exp(−Δλ / (T λ)). T
falls over a cycle; every cycle is twice as long as the one before, and half of the chains begin it at the best
labelling known.

A genetic population has every other turn as long as it is ahead, and every eighth where it is not: it soon finds an
optimum that is put together of parts, chains find what takes many small steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits, Floats
from jld_core.deadline import checkpoint
from jld_core.limit import LimitAnalysis, Movements
from jld_explore.drivers.base import DriverOptions
from jld_explore.drivers.genetic import Genetic
from jld_explore.drivers.operators import Following
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluation import Evaluation, standing
from jld_explore.space import SearchSpace, keys

_HOT: Final = 0.04
_COLD: Final = 1e-3
"""Temperatures at the beginning and the end of a cycle, beside the largest λ known."""

_CYCLE: Final = 10
"""Labellings of the first cycle, for each face that can change."""

_TRIES: Final = 4
"""Changes of a chain's labelling that are evaluated together."""

_GREEDY: Final = 2
"""Cycles at the beginning in which half as many chains have twice as many changes each; the others are drawn then."""

_TURNS: Final = 8
"""How often changes are looked for that nobody has asked before; a chain without any begins anew."""

_CROSS: Final = 0.03
"""Share of changes that cross two labellings; with a tenth chains come to stand at one place (6 × 8 wall)."""

_OWN: Final = 0.5
"""Share of those with the chain's own image, where the scene has symmetries."""

_AHEAD: Final = 2
_BEHIND: Final = 8
"""One turn in so many is the population's, while it has the best labelling known and while it has not."""

_BARRED: Final = 1e300
"""What sets a labelling without λ below all that have one, for each place in the order of statuses."""


@dataclass
class _Chain:
    """place: (m,) where it stands, None before it is known. energy: −λ there; case: the load case that governs.
    parts, moving (m,): its blocks and how far faces move there, None until they are asked for. near: energy, case and
    labelling of changes that were evaluated since."""

    place: Bits | None = None
    energy: float = math.inf
    case: int = 0
    parts: list[int] | None = None
    moving: Floats | None = None
    near: list[tuple[float, int, Bits]] = field(default_factory=list)

    def stand(self, place: Bits, energy: float, case: int) -> None:
        """Go there."""
        self.place, self.energy, self.case, self.parts, self.moving = place, energy, case, None, None


class AnnealOptions(DriverOptions):
    """Options of the anneal driver."""

    chains: Annotated[int, Field(ge=1, le=100_000)] = Field(16, description="labellings changed side by side")


class Anneal(Searcher):
    """Chains that each change one labelling, step by step, ever colder, and a population beside them.

    chains: how many. What a mechanism moves is asked of the batch solver, or of a solver where there is none.
    """

    name = "anneal"
    Options = AnnealOptions

    def __init__(self, space: SearchSpace, seed: int = 0, chains: int = 16) -> None:
        super().__init__(space, seed, _TRIES * chains)
        self._follow = Following(space, self.operators)
        self._movements = [Movements(LimitAnalysis(case)) for case in space.assembly.by_case]
        self._most = chains
        self._chains = [_Chain() for _ in range(max(1, chains // 2) if _GREEDY else chains)]
        self._owner: dict[bytes, int] = {}
        self._best: tuple[float, Bits | None, int] = (math.inf, None, 0)
        self._told, self._began, self._cycle = 0, 0, 0
        self._length = _CYCLE * self.operators.keys
        self._population = Genetic(space, seed, aim="best")
        self._population.register = self.register
        self._bred: set[bytes] = set()
        self._bred_best = math.inf
        self._turn = 0

    @property
    def settings(self) -> dict[str, Any]:
        """How many chains, and what the population depends on."""
        return {"chains": self._most, **self._population.settings}

    def propose(self) -> Bits:
        """New changes of every chain, random labellings for those that stand nowhere yet; or a generation."""
        self._settle()
        self._cool()
        self._turn += 1
        if self._turn % (_AHEAD if self._bred_best <= self._best[0] else _BEHIND) == 0:
            return self._generation()
        rows = self._changed()
        # what waits in the population is not left to the enumeration of the rest
        return rows if len(rows) >= self.size // 8 else np.concatenate([rows, self._generation()])

    def _generation(self) -> Bits:
        """Children of the population."""
        rows = self._population.propose()
        self._bred.update(keys(rows))
        return rows

    def _changed(self) -> Bits:
        """New changes of every chain, random labellings for those that stand nowhere or have no new ones."""
        standing = [number for number, chain in enumerate(self._chains) if chain.place is not None]
        batches = [self._none]
        if standing:
            self._look(standing)
        tries = self.size // len(self._chains)
        lacking = dict.fromkeys(standing, tries)
        for _ in range(_TURNS):
            checkpoint()
            owners = [number for number, count in lacking.items() for _ in range(count)]
            if not owners:
                break
            rows, owners = self._changes(owners)
            fresh, names, places = self.register.admitted(rows)
            for name, place in zip(names, places.tolist(), strict=True):
                self._owner[name] = owners[place]
                lacking[owners[place]] -= 1
            batches.append(fresh)
        for number, count in lacking.items():
            if count == tries:
                self._chains[number] = _Chain()
        lost = [number for number, chain in enumerate(self._chains) if chain.place is None]
        if lost:
            drawn = self.fresh(self.draw, len(lost) * tries)
            self._owner.update((name, lost[k % len(lost)]) for k, name in enumerate(keys(drawn)))
            batches.append(drawn)
        return np.concatenate(batches)

    def _changes(self, owners: list[int]) -> tuple[Bits, list[int]]:
        """A change of each of these chains' labellings where one is found: rows (j, m), and whose each is."""
        crossing = [self.rng.real() < _CROSS for _ in owners]
        alone = [number for number, crossed in zip(owners, crossing, strict=True) if not crossed]
        coupled = [number for number, crossed in zip(owners, crossing, strict=True) if crossed]
        rows, whose = self._none, []
        if alone:
            chains = [self._chains[number] for number in alone]
            places, moving = np.array([chain.place for chain in chains]), np.array([chain.moving for chain in chains])
            rows, of = self._follow.changes(places, [chain.parts or [] for chain in chains], moving, self.rng)
            whose = [alone[k] for k in of.tolist()]
        if coupled:
            places = np.array([self._chains[number].place for number in coupled])
            others = np.array([self._partner(number) for number in coupled])
            children, of = self.operators.crossed(places, others, self.rng)
            rows, whose = np.concatenate([rows, children]), [*whose, *(coupled[k] for k in of.tolist())]
        return rows, whose

    def _partner(self, number: int) -> Bits:
        """What a chain's labelling is crossed with: an image of itself, or one of another chain's."""
        own, group = self._chains[number].place, self.space.group
        if len(group) > 1 and self.rng.real() < _OWN:
            other = own
        else:
            place = self._chains[self.rng.below(len(self._chains))].place
            other = own if place is None else place
        assert other is not None
        image: Bits = other[group[self.rng.below(len(group))]]
        return image

    def _look(self, standing: list[int]) -> None:
        """Blocks and what moves where chains stand that do not know it yet, all at once for each load case."""
        unknown = [chain for chain in (self._chains[number] for number in standing) if chain.moving is None]
        for case, movements in enumerate(self._movements):
            lacking = [chain for chain in unknown if chain.case == case]
            if lacking:
                rows = np.array([chain.place for chain in lacking])
                for chain, moving, parts in zip(lacking, movements.of(rows), self._follow.parts(rows), strict=True):
                    chain.moving, chain.parts = moving, parts

    def _settle(self) -> None:
        """Every chain goes to the best of its changes, or stays."""
        for chain in self._chains:
            if chain.near:
                energy, case, row = min(chain.near, key=lambda one: one[0])
                worse = energy - chain.energy
                if worse <= 0.0 or (worse < _BARRED and self.rng.real() < math.exp(-worse / self._temperature)):
                    chain.stand(row, energy, case)
                chain.near = []

    def _cool(self) -> None:
        """Begin the next cycle where one is over."""
        if self._told - self._began < self._length:
            return
        self._began, self._length, self._cycle = self._told, 2 * self._length, self._cycle + 1
        energy, best, case = self._best
        if self._cycle == _GREEDY:
            self._chains += [_Chain() for _ in range(self._most - len(self._chains))]
            return
        for chain in self._chains[::2]:
            if best is not None:
                chain.stand(best, energy, case)

    @property
    def _temperature(self) -> float:
        part = min((self._told - self._began) / max(self._length, 1), 1.0)
        energy = self._best[0]
        size = abs(energy) if abs(energy) < _BARRED else 1.0
        return float(_HOT * (_COLD / _HOT) ** part * max(size, 1e-300))

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """What became of changes, which chains step by when they are asked for the next, and of the population's."""
        bred: list[int] = []
        for k, (key, labels, found) in enumerate(zip(keys(labellings), labellings, evaluations, strict=True)):
            place, loss = standing(found)
            energy = loss + _BARRED * place
            case = max(found.governing, 0)
            if energy < self._best[0]:
                self._best = (energy, labels, case)
            if key in self._bred:
                self._bred.discard(key)
                self._bred_best = min(self._bred_best, energy)
                bred.append(k)
            number = self._owner.pop(key, None)
            if number is not None:
                self._told += 1
                self._chains[number].near.append((energy, case, labels))
        if bred:
            self._population.tell(labellings[bred], [evaluations[k] for k in bred])
