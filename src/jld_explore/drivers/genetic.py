"""A genetic search: the library's selection, sorting and crowding, our operators on segmentations.

Two objectives are NSGA-II: larger λ, and the count of the scene's front; one objective looks at λ alone.
Labellings without a number rank below all that have one, in the order of `ranking.ORDER`, which the library
knows as violation of a constraint.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jld_core.assembly import Bits
from jld_explore.candidates import SearchSpace
from jld_explore.drivers.ranking import objectives, places
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluator import Evaluation


class _Constrained:
    """What the library asks of a problem: there are constraints, so that the infeasible rank below."""

    @staticmethod
    def has_constraints() -> bool:
        return True


class Genetic(Searcher):
    """Generations of `population` labellings, with `size` children in each.

    aims: 2 for λ and the scene's count, 1 for λ alone. crossing: share of children with two parents.
    newcomers: share of random labellings among the children.
    """

    name = "genetic"

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        population: int = 64,
        size: int | None = None,
        aims: int = 2,
        crossing: float = 0.5,
        newcomers: float = 0.05,
    ) -> None:
        from pymoo.core.population import Population
        from pymoo.operators.selection.tournament import TournamentSelection
        from pymoo.operators.survival.rank_and_crowding import RankAndCrowding

        super().__init__(space, seed, size or population)
        self.population, self.aims, self.crossing, self.newcomers = population, aims, crossing, newcomers
        self._generator = np.random.default_rng([seed, 1])
        self._new: Any = Population.new
        self._merge: Any = Population.merge
        self._survival: Any = RankAndCrowding()
        self._selection: Any = TournamentSelection(func_comp=self._winners)
        self._alive: Any = Population()
        self._told: list[Any] = []

    @property
    def settings(self) -> dict[str, Any]:
        """Size of population and number of aims."""
        return {"population": self.population, "aims": self.aims}

    def propose(self) -> Bits:
        """The next generation; the first is drawn at random."""
        self._survive()
        if len(self._alive) < 2:
            first = max(self.size, self.population)
            return self.fresh(self.draw, self.size if len(self._alive) else first)
        strangers = round(self.newcomers * self.size)
        rows = self.fresh(self._children, self.size - strangers)
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
        self._rank = self._alive.get("rank").astype(float)
        self._crowding = self._alive.get("crowding").astype(float)

    def _children(self, count: int) -> Bits:
        crossed = round(self.crossing * count)
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
        for values, sign in ((self._violation, 1.0), (self._rank, 1.0), (self._crowding, -1.0)):
            with np.errstate(invalid="ignore"):
                difference = np.nan_to_num(sign * (values[first] - values[second]))
            better = np.where(better == 0.0, np.sign(difference), better)
        return np.where(better > 0.0, second, first)[:, None]
