"""Annealing over partitions, with changes that the mechanism of a labelling suggests.

What collapses is where its mechanism moves, so little else is worth a change: blocks are joined across a face that
moves, and where nothing moves one is cut, which leaves room for others to join. Several chains run side by side, so
that labellings are asked many at a time; each takes what is stronger always and what is weaker with probability
exp(−Δλ / (T λ)). T falls over a cycle; every cycle is twice as long as the one before, and half of the chains begin it
at the best labelling known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits, Floats
from jld_core.limit import LimitAnalysis, Movements
from jld_explore.drivers.base import DriverOptions
from jld_explore.drivers.operators import Following
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluation import Evaluation, standing
from jld_explore.space import SearchSpace, canonical, keys

_HOT: Final = 0.02
_COLD: Final = 1e-3
"""Temperatures at the beginning and the end of a cycle, beside the largest λ known."""

_CYCLE: Final = 10
"""Labellings of the first cycle, for each face that can change."""

_TURNS: Final = 12
"""Changes a chain tries, among those known already, before another chance is given to it later."""

_BARRED: Final = 1e300
"""What sets a labelling without λ below all that have one, for each place in the order of statuses."""


@dataclass
class _Chain:
    """place: (m,) where it stands, None before it is known. energy: −λ there; case: the load case that governs.
    parts, moving (m,): its blocks and how far faces move there, None until they are asked for."""

    place: Bits | None = None
    energy: float = math.inf
    case: int = 0
    parts: list[int] | None = None
    moving: Floats | None = None

    def stand(self, place: Bits, energy: float, case: int) -> None:
        """Go there."""
        self.place, self.energy, self.case, self.parts, self.moving = place, energy, case, None, None


class AnnealOptions(DriverOptions):
    """Options of the anneal driver."""

    chains: Annotated[int, Field(ge=1, le=100_000)] = Field(16, description="labellings changed side by side")


class Anneal(Searcher):
    """Chains that each change one labelling, step by step, ever colder.

    chains: how many. What a mechanism moves is asked of the kernel, or of a solver where there is none.
    """

    name = "anneal"
    Options = AnnealOptions

    def __init__(self, space: SearchSpace, seed: int = 0, chains: int = 16) -> None:
        super().__init__(space, seed, chains)
        self._follow = Following(space, self.operators)
        self._movements = [Movements(LimitAnalysis(case)) for case in space.assembly.by_case]
        self._chains = [_Chain() for _ in range(chains)]
        self._owner: dict[bytes, int] = {}
        self._known: dict[bytes, tuple[float, int]] = {}
        self._best: tuple[float, Bits | None, int] = (math.inf, None, 0)
        self._steps, self._began = 0, 0
        self._length = max(1, _CYCLE * self.operators.keys // chains)

    @property
    def settings(self) -> dict[str, Any]:
        """How many chains."""
        return {"chains": len(self._chains)}

    def propose(self) -> Bits:
        """One new change of every chain, or a random labelling for one that stands nowhere yet."""
        self._cool()
        batches: list[Bits] = []
        waiting = list(range(len(self._chains)))
        for _ in range(_TURNS):
            waiting = self._turn(waiting, batches)
            if not waiting:
                break
        if waiting:
            # all around is known: what a chain cannot find near it is drawn
            rows = self.fresh(self.draw, len(waiting))
            self._owner.update(zip(keys(rows), waiting, strict=False))
            batches.append(rows)
        return np.concatenate(batches) if batches else self._none

    def _turn(self, waiting: list[int], batches: list[Bits]) -> list[int]:
        """One change of each waiting chain: new ones are proposed, known ones taken or left; those that wait on."""
        standing = [number for number in waiting if self._chains[number].place is not None]
        lost = [number for number in waiting if self._chains[number].place is None]
        rows, owners = self.draw(len(lost)), lost
        owners = owners[: len(rows)]
        if standing:
            self._look(standing)
            chains = [self._chains[number] for number in standing]
            places, moving = np.array([chain.place for chain in chains]), np.array([chain.moving for chain in chains])
            changed, of = self._follow.changes(places, [chain.parts or [] for chain in chains], moving, self.rng)
            rows = np.concatenate([rows, changed])
            owners = owners + [standing[k] for k in of.tolist()]
        rows = canonical(rows, self.space.group)
        names = keys(rows)
        owner_of: dict[bytes, int] = {}
        for name, number, row in zip(names, owners, rows, strict=True):
            if name in self._known:
                self._step(number, row, *self._known[name])
            elif name not in self._owner:
                owner_of.setdefault(name, number)
        fresh = self.register.admit(rows[[k for k, name in enumerate(names) if name in owner_of]])
        found = {name: owner_of[name] for name in keys(fresh)}
        self._owner.update(found)
        batches.append(fresh)
        served = set(found.values())
        return [number for number in waiting if number not in served]

    def _look(self, standing: list[int]) -> None:
        """Blocks and what moves where chains stand that do not know it yet, all at once for each load case."""
        unknown = [chain for chain in (self._chains[number] for number in standing) if chain.moving is None]
        for case, movements in enumerate(self._movements):
            lacking = [chain for chain in unknown if chain.case == case]
            if lacking:
                rows = np.array([chain.place for chain in lacking])
                for chain, moving, parts in zip(lacking, movements.of(rows), self._follow.parts(rows), strict=True):
                    chain.moving, chain.parts = moving, parts

    def _cool(self) -> None:
        """Count a step, and begin the next cycle where one is over."""
        self._steps += 1
        if self._steps - self._began < self._length:
            return
        self._began, self._length = self._steps, 2 * self._length
        energy, best, case = self._best
        for chain in self._chains[::2]:
            if best is not None:
                chain.stand(best, energy, case)

    @property
    def _temperature(self) -> float:
        part = min((self._steps - self._began) / self._length, 1.0)
        energy = self._best[0]
        size = abs(energy) if abs(energy) < _BARRED else 1.0
        return float(_HOT * (_COLD / _HOT) ** part * max(size, 1e-300))

    def _step(self, number: int, row: Bits, energy: float, case: int) -> None:
        """A chain goes to a labelling, or stays."""
        chain = self._chains[number]
        worse = energy - chain.energy
        if worse <= 0.0 or (worse < _BARRED and self.rng.real() < math.exp(-worse / self._temperature)):
            chain.stand(row, energy, case)

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Chains step to what they proposed, or stay."""
        for key, labels, found in zip(keys(labellings), labellings, evaluations, strict=True):
            place, loss = standing(found)
            energy = loss + _BARRED * place
            case = max(found.governing, 0)
            self._known[key] = (energy, case)
            if energy < self._best[0]:
                self._best = (energy, labels, case)
            number = self._owner.pop(key, None)
            if number is not None:
                self._step(number, labels, energy, case)
