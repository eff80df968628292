"""A genetic search: the library's selection, sorting and crowding, our operators on segmentations.

Two objectives are NSGA-II: larger λ, and the count of the scene's front; one objective looks at λ alone.
Labellings without a number rank below all that have one, in the order of `ranking.ORDER`, which the library
knows as violation of a constraint.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from typing import Any, Final

import numpy as np

from jld_core.assembly import Bits
from jld_explore.candidates import SearchSpace
from jld_explore.drivers.ranking import objectives, places
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluator import Evaluation

CROSSING: Final = 0.8
"""Share of children with two parents; the others are changes of one."""

NEWCOMERS: Final = 0.05
"""Share of random labellings in a generation."""

GREED: Final = 0.5
"""Share of tournaments in which λ alone decides between labellings of different rank."""

SETTLED: Final = 0.35
"""Share of new classes among the children below which a population has settled."""

_PER_KEY: Final = 1.5
_SIZES: Final = (32, 128)
"""Population for each face that can change, and its limits."""


class _Constrained:
    """What the library asks of a problem: there are constraints, so that the infeasible rank below."""

    @staticmethod
    def has_constraints() -> bool:
        return True


class Genetic(Searcher):
    """Generations of `population` labellings, with `size` children in each.

    population: by the size of the scene where it is not given. aims: 2 for λ and the scene's count, 1 for λ
    alone. Where few of the children are new, the population has settled, and another one is begun at random;
    what was asked before stays asked, so it has to settle elsewhere.
    """

    name = "genetic"

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        population: int | None = None,
        aims: int = 2,
    ) -> None:
        from pymoo.core.population import Population
        from pymoo.operators.selection.tournament import TournamentSelection
        from pymoo.operators.survival.rank_and_crowding import RankAndCrowding

        super().__init__(space, seed, population or 0)
        if population is None:
            self.size = int(np.clip(_PER_KEY * self.operators.keys, *_SIZES))
        self.population, self.aims = self.size, aims
        self._generator = np.random.default_rng([seed, 1])
        self._new: Any = Population.new
        self._merge: Any = Population.merge
        self._survival: Any = RankAndCrowding()
        self._selection: Any = TournamentSelection(func_comp=self._winners)
        self._alive: Any = Population()
        self._told: list[Any] = []

    @property
    def settings(self) -> dict[str, Any]:
        """Size of population, number of aims, and the library that selects."""
        return {"population": self.population, "aims": self.aims, "pymoo": version("pymoo")}

    def propose(self) -> Bits:
        """The next generation; the first is drawn at random."""
        self._survive()
        if len(self._alive) < 2:
            return self.fresh(self.draw, self.population)
        strangers = round(NEWCOMERS * self.size)
        rows = self.fresh(self._children, self.size - strangers)
        if self.luck < SETTLED:
            # the population has become one family, and what it can still have is known: begin another one
            self._alive = self._alive[:0]
        return np.concatenate([rows, self.fresh(self.draw, self.size - len(rows))])

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take what is known into the next selection."""
        if len(labellings) and self._rest is None:
            values = objectives(self.space, labellings, evaluations)[:, : self.aims]
            apart = places(evaluations).astype(float)[:, None]
            self._told.append(self._new("X", labellings, "F", values, "G", apart))

    def _survive(self) -> None:
        if not self._told:
            return
        everyone = self._merge(self._alive, *self._told)
        self._told = []
        for person in everyone:
            person.set("rank", np.inf)
            person.set("crowding", 0.0)
        self._alive = self._survival.do(
            _Constrained(), everyone, n_survive=self.population, random_state=self._generator
        )
        self._rows = np.asarray(self._alive.get("X"), dtype=bool)
        self._violation = self._alive.get("CV")[:, 0]
        self._value = self._alive.get("F")[:, 0]
        self._rank = self._alive.get("rank").astype(float)
        self._crowding = self._alive.get("crowding").astype(float)

    def _children(self, count: int) -> Bits:
        crossed = round(CROSSING * count)
        couples = self._selection.do(_Constrained(), self._alive, count, 2, to_pop=False, random_state=self._generator)
        first, second = self._rows[couples[:, 0]], self._rows[couples[:, 1]]
        # a mirror image is as good a parent: which one decides what the joints meet
        group = self.space.group
        turned = [self.dice.below(len(group)) for _ in range(crossed)]
        images = np.take_along_axis(second[:crossed], group[turned], axis=1)
        return np.concatenate(
            [
                self.operators.cross(first[:crossed], images, self.dice),
                self.operators.vary(first[crossed:], self.dice),
            ]
        )

    def _winners(self, population: Any, pairs: Any, **_: Any) -> Any:
        """Winner of each pair (k, 2): fewer violations, then lower rank, then less crowded; (k, 1)."""
        first, second = pairs[:, 0], pairs[:, 1]
        better = np.zeros(len(pairs))
        # the more parents are chosen by λ alone the sooner the best is found, the fewer the wider the front
        alone = self._generator.random(len(pairs)) < GREED
        value, rank = self._value, self._rank
        for one, two in (
            (self._violation[first], self._violation[second]),
            (np.where(alone, value[first], rank[first]), np.where(alone, value[second], rank[second])),
            (self._crowding[second], self._crowding[first]),
        ):
            better = np.where(better == 0.0, (one > two) * 1.0 - (one < two), better)
        return np.where(better > 0.0, second, first)[:, None]
