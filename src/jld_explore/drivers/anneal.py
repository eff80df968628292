"""Simulated annealing of segmentations, guided by collapse mechanisms, beside a genetic population."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits, Floats
from jld_core.deadline import checkpoint
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.mechanism import Movements
from jld_explore.drivers.base import Aim, DriverOptions
from jld_explore.drivers.genetic import Genetic
from jld_explore.drivers.operators.segmentations import Following
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluation.protocol import Evaluation, sort_key
from jld_explore.space import keys
from jld_explore.space.search_space import SearchSpace

_FIRST_TEMPERATURE: Final = 0.04  # temperature at the start of a cycle, relative to the largest λ known
_LAST_TEMPERATURE: Final = 1e-3  # temperature at the end of a cycle, relative to the largest λ known

_FIRST_CYCLE: Final = 10  # labellings evaluated in the first cycle, per face that can change

_TRIES: Final = 4  # changes of the labelling of a chain that are evaluated together, of every other chain at a time

# Number of first cycles with half as many chains and twice as many changes each. The other chains are drawn at random
# after these cycles.
_GREEDY_CYCLES: Final = 2

_ATTEMPTS: Final = 8  # attempts to find new changes of a chain; a chain without any restarts at random

# Share of changes that cross two labellings. With a share of 0.1 chains converge to one labelling (6 × 8 wall).
_CROSSING_SHARE: Final = 0.03

_OWN_IMAGE_SHARE: Final = 0.5  # share of crossings with an image of the own labelling, where the scene has symmetries

_TURNS_AHEAD: Final = 2  # one turn in this number is the population's while it has the best labelling known
_TURNS_BEHIND: Final = 8  # one turn in this number is the population's while a chain has the best labelling known

# Energy added per rank of the status, so that labellings without λ rank below all others
_NO_LOAD_FACTOR: Final = 1e300


@dataclass
class _Chain:
    labelling: Bits | None = None  # (m,) current labelling, True = dry; None before the first one is evaluated
    energy: float = math.inf  # −λ of the current labelling
    case: int = 0  # index of its governing load case
    parts: list[int] | None = None  # its partition into blocks; None until needed
    moving: Floats | None = None  # (m,) relative motion of each face in its mechanism; None until needed
    # energy, load case and labels of the changes evaluated since
    changes: list[tuple[float, int, Bits]] = field(default_factory=list)

    def move_to(self, labelling: Bits, energy: float, case: int) -> None:
        self.labelling, self.energy, self.case, self.parts, self.moving = labelling, energy, case, None, None
        self.changes = []


class AnnealOptions(DriverOptions):
    chains: Annotated[int, Field(ge=1, le=100_000)] = Field(16, description="labellings changed side by side")


class Anneal(Searcher):
    """Driver that anneals several chains at faces that move in the collapse mechanism."""

    name = "anneal"
    Options: ClassVar[type[DriverOptions]] = AnnealOptions

    def __init__(self, space: SearchSpace, seed: int = 0, chains: int = 16, aim: Aim = "best") -> None:
        # A layout fails where its mechanism moves: a change merges blocks across a moving face, cuts a block without
        # one, or crosses labellings. Each cycle is twice as long as the one before. The population finds optima that
        # combine parts; chains find those that need many small steps. While changes of one half of the chains are
        # evaluated, those of the other half are made.
        super().__init__(space, seed, max(1, _TRIES * chains // 2))
        self._follow = Following(space, self.operators)
        self._chain_count = chains
        self._chains = [_Chain() for _ in range(max(1, chains // 2) if _GREEDY_CYCLES else chains)]
        self._owner: dict[bytes, int] = {}
        self._best: tuple[float, Bits | None, int] = (math.inf, None, 0)  # of chains and population
        self._evaluated, self._cycle_start, self._cycle = 0, 0, 0
        self._cycle_length = _FIRST_CYCLE * self.operators.keys
        self._population = Genetic(space, seed, aim=aim)
        self._population.register = self.register
        self._of_population: set[bytes] = set()
        self._population_best = math.inf
        self._turn, self._turns_behind, self._half = 0, _TURNS_BEHIND, 1
        self._prepared: Bits | None = None
        self._all_begin = False  # whether all chains that fall go on from the first layout that stands

    @cached_property
    def _movements(self) -> list[Movements]:
        return [Movements(LimitAnalysis(case)) for case in self.space.assembly.by_case]

    @property
    def settings(self) -> dict[str, Any]:
        return {"chains": self._chain_count, **self._population.settings}

    def prepare(self) -> None:
        if self._prepared is None and self._turn and self._enumeration is None:
            self._prepared = self._next()

    def propose(self) -> Bits:
        rows, self._prepared = self._next() if self._prepared is None else self._prepared, None
        return rows

    def _next(self) -> Bits:
        # Every chain gives changes of its labelling, chains without one random labellings. In some turns the genetic
        # population gives a generation instead.
        self._advance_cycle()
        energy, best, case = self._best
        if self._all_begin and best is not None and energy < _NO_LOAD_FACTOR:
            self._all_begin = False
            for chain in (one for one in self._chains if one.energy >= _NO_LOAD_FACTOR):
                chain.move_to(best, energy, case)
        self._turn += 1
        if self._turn % (_TURNS_AHEAD if self._population_best <= self._best[0] else self._turns_behind) == 0:
            return self._generation()
        rows = self._changed()
        # A generation is added to a short batch, because enumeration starts when batches become short.
        return rows if len(rows) >= self.size // 8 else np.concatenate([rows, self._generation()])

    def _generation(self) -> Bits:
        """Return a generation (k, m) of the population, and remember its origin."""
        rows = self._population.propose()
        self._of_population.update(keys(rows))
        return rows

    def _changed(self) -> Bits:
        """Return new changes (k, m) of the other half of the chains; a chain without any restarts at random."""
        self._half = 1 - self._half
        half = list(range(len(self._chains)))[self._half :: 2] or [0]
        self._accept_changes(half)
        with_labelling = [number for number in half if self._chains[number].labelling is not None]
        batches = [self._no_labellings]
        if with_labelling:
            self._compute_mechanisms(with_labelling)
        tries = max(1, self.size // len(half))
        lacking = dict.fromkeys(with_labelling, tries)
        for _ in range(_ATTEMPTS):
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
        lost = [number for number in half if self._chains[number].labelling is None]
        if lost:
            drawn = self.fresh(self.draw, len(lost) * tries)
            self._owner.update((name, lost[k % len(lost)]) for k, name in enumerate(keys(drawn)))
            batches.append(drawn)
        return np.concatenate(batches)

    def _changes(self, owners: list[int]) -> tuple[Bits, list[int]]:
        """Change or cross the labellings of chains, by number: new rows (j, m), and the chain of each."""
        crossing = [self.rng.real() < _CROSSING_SHARE for _ in owners]
        alone = [number for number, crossed in zip(owners, crossing, strict=True) if not crossed]
        coupled = [number for number, crossed in zip(owners, crossing, strict=True) if crossed]
        # An operator gives no row or several for a labelling, and `source`: which labelling each row comes from.
        rows, chain_of_row = self._no_labellings, []
        if alone:
            chains = [self._chains[number] for number in alone]
            labellings = np.array([chain.labelling for chain in chains])
            moving = np.array([chain.moving for chain in chains])
            parts = [chain.parts or [] for chain in chains]
            rows, source = self._follow.changes(labellings, parts, moving, self.rng)
            chain_of_row = [alone[k] for k in source.tolist()]
        if coupled:
            labellings = np.array([self._chains[number].labelling for number in coupled])
            partners = np.array([self._partner(number) for number in coupled])
            children, source = self.operators.cross_indexed(labellings, partners, self.rng)
            rows = np.concatenate([rows, children])
            chain_of_row += [coupled[k] for k in source.tolist()]
        return rows, chain_of_row

    def _partner(self, number: int) -> Bits:
        """Return a symmetric image (m,) of a labelling to cross with that of chain `number`."""
        own, group = self._chains[number].labelling, self.space.group
        if len(group) > 1 and self.rng.real() < _OWN_IMAGE_SHARE:
            other = own
        else:
            place = self._chains[self.rng.below(len(self._chains))].labelling
            other = own if place is None else place
        if other is None:
            raise ValueError(f"chain {number} has no labelling yet, so it cannot be crossed")
        image: Bits = other[group[self.rng.below(len(group))]]
        return image

    def _compute_mechanisms(self, with_labelling: list[int]) -> None:
        """Compute blocks and mechanisms of chains that lack them, together for each load case."""
        unknown = [chain for chain in (self._chains[number] for number in with_labelling) if chain.moving is None]
        for case, movements in enumerate(self._movements):
            lacking = [chain for chain in unknown if chain.case == case]
            if lacking:
                rows = np.array([chain.labelling for chain in lacking])
                for chain, moving, parts in zip(lacking, movements.of(rows), self._follow.parts(rows), strict=True):
                    chain.moving, chain.parts = moving, parts

    def _accept_changes(self, half: list[int]) -> None:
        """Move every chain of a half to its best evaluated change, or reject that change."""
        # a weaker change is accepted with probability exp(−Δλ / T)
        for chain in (self._chains[number] for number in half):
            if chain.changes:
                energy, case, row = min(chain.changes, key=lambda change: change[0])
                worse = energy - chain.energy
                if worse <= 0.0 or (worse < _NO_LOAD_FACTOR and self.rng.real() < math.exp(-worse / self._temperature)):
                    chain.move_to(row, energy, case)
                chain.changes = []

    def _advance_cycle(self) -> None:
        """Start the next cycle if the current one is over, half of the chains at the best labelling."""
        if self._evaluated - self._cycle_start < self._cycle_length:
            return
        self._cycle_start, self._cycle_length, self._cycle = self._evaluated, 2 * self._cycle_length, self._cycle + 1
        energy, best, case = self._best
        if self._cycle == _GREEDY_CYCLES:
            self._chains += [_Chain() for _ in range(self._chain_count - len(self._chains))]
        for chain in self._chains[::2]:
            if best is not None:
                chain.move_to(best, energy, case)

    @property
    def _temperature(self) -> float:
        part = min((self._evaluated - self._cycle_start) / max(self._cycle_length, 1), 1.0)
        energy = self._best[0]
        size = abs(energy) if abs(energy) < _NO_LOAD_FACTOR else 1.0
        return float(_FIRST_TEMPERATURE * (_LAST_TEMPERATURE / _FIRST_TEMPERATURE) ** part * max(size, 1e-300))

    def like(self, space: SearchSpace) -> Anneal:
        return Anneal(space, self.seed, self._chain_count)

    def go_on_from(self, rows: Bits) -> None:
        names = keys(rows)
        self._owner.update((name, number % len(self._chains)) for number, name in enumerate(names))
        self._of_population.update(names)
        self._all_begin = True

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        # Chains accept or reject their changes when their half is changed again.
        self.prepare()
        self.standing_start.watch(evaluations)
        bred: list[int] = []
        for k, (key, labels, found) in enumerate(zip(keys(labellings), labellings, evaluations, strict=True)):
            rank, loss = sort_key(found)
            energy = loss + _NO_LOAD_FACTOR * rank
            case = max(found.governing, 0)
            number = self._owner.pop(key, None)
            if key in self._of_population:
                self._of_population.discard(key)
                self._population_best = min(self._population_best, energy)
                bred.append(k)
            elif number is None:
                continue
            if energy < self._best[0]:
                self._best = (energy, labels, case)
            if number is not None:
                self._evaluated += 1
                self._chains[number].changes.append((energy, case, labels))
        if bred:
            self._population.tell(labellings[bred], [evaluations[k] for k in bred])
