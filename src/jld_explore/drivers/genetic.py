"""Genetic search: non-dominated sorting, operators on blocks, and a surrogate.

With two or three objectives the algorithm is NSGA-II: λ and the counts of the front of the scene. With one objective
only λ counts. The driver makes far more children than it evaluates. New children wait in a **pool**; the surrogate
selects the most promising ones, whatever their generation. If generations bring no progress, a new random population
is started. The surrogate is kept, so the new population converges elsewhere.

Labellings without a number rank below all others, in the order of `ranking.ORDER`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.drivers.base import Aim, DriverOptions
from jld_explore.drivers.nondominated import crowding_of, fronts_of
from jld_explore.drivers.pool import Pool
from jld_explore.drivers.searcher import Searcher
from jld_explore.drivers.surrogate import Surrogate
from jld_explore.evaluation import Evaluation
from jld_explore.evaluation.ranking import Envelope, objectives, status_ranks
from jld_explore.space import SearchSpace

CROSSING_SHARE: Final = 0.5
"""Share of children with two parents; the others are mutations of one parent."""

IMMIGRANT_SHARE: Final = 0.05
"""Share of random labellings among the proposals of a generation."""

LOAD_FACTOR_SHARE: Final = 0.5
"""Share of tournaments that λ alone decides.

With several objectives λ alone also selects half of the evaluated children. `Genetic._chosen` fixes that half.
"""

PATIENCE: Final = 8
"""Evaluations without progress, per face that can change, before a population restarts."""

GENERATION: Final = 48
"""Number of children evaluated per generation."""

POOL: Final = 200
"""Largest number of children that remain in the pool."""

_PER_KEY: Final = 1.5  # default population size per face that can change
_SIZES: Final = (32, 48)  # smallest and largest default population size

# Objective value of labellings without a number, times the rank of their status. The value is below all numbers.
_NO_LOAD_FACTOR: Final = -1e300

_RESOLUTION: Final = 2.0**20  # reciprocal of the relative resolution that distinguishes progress in λ from rounding


class GeneticOptions(DriverOptions):
    """Options of the genetic driver.

    population: population size. aim: search for the largest λ, or for the largest λ for every value of the count.
    """

    population: Annotated[int, Field(ge=4, le=1_000_000)] | None = Field(None, description="population size")
    aim: Aim = Field("front", description="best, or front (the best for every count)")


class Genetic(Searcher):
    """Driver that runs a genetic algorithm with a surrogate.

    Each generation evaluates `GENERATION` children.

    population: population size. Default: by the number of faces that can change. aim: objectives: λ alone, or λ and the
    counts of the front. population: population size. objective_count: number of objectives.
    """

    name = "genetic"
    Options = GeneticOptions
    ahead: ClassVar[int] = 1

    def __init__(self, space: SearchSpace, seed: int, population: int | None = None, aim: Aim = "front") -> None:
        super().__init__(space, seed, GENERATION)
        if population is None:
            population = int(np.clip(_PER_KEY * self.operators.keys, *_SIZES))
        self.population, self.aim = population, aim
        counts = len(space.search.front.axes)
        self.objective_count = 1 + counts if aim == "front" else 1
        self._generator = np.random.default_rng([seed, 1])
        self._surrogate = Surrogate(space)
        self._pool = Pool(space, self._surrogate)
        self._drawn_immigrants = self._none
        self._front = Envelope(counts)
        self._pending: list[tuple[Bits, Floats, Ints]] = []
        self._proposed = self._evaluated = 0
        self._start_population()

    def _start_population(self) -> None:
        """Start an empty population with the proposals from now on."""
        self._first = self._proposed
        self._rows, self._status_rank, self._values = (
            self._none,
            np.empty(0, dtype=np.int64),
            np.empty((0, 1 + len(self.space.search.front.axes))),
        )
        self._leaders: set[bytes] = set()
        self._idle = 0

    @property
    def settings(self) -> dict[str, Any]:
        """Population size and aim by name; see `Driver.settings`."""
        return {"population": self.population, "aim": self.aim}

    def propose(self) -> Bits:
        """Return the next generation: new canonical labellings (k, m), registered as proposed.

        They are random while the population has fewer than two labellings. A population without progress is given up
        first, and another one started.
        """
        self._learn()
        if self._idle > PATIENCE * self.operators.keys:
            self._forget(np.arange(len(self._pool)))
            self._pool.keep(np.empty(0, dtype=np.int64))
            self._start_population()
        rows = self._generation() if len(self._rows) > 1 else self.fresh(self.draw, self.size)
        self._proposed += len(rows)
        return rows

    def _generation(self) -> Bits:
        """Make children and immigrants; return the most promising children and the immigrants."""
        immigrants_drawn = self._immigrants(max(1, round(IMMIGRANT_SHARE * self.size)))
        proposed = np.concatenate([immigrants_drawn, self._children(self.operators.offspring_factor * self.size)])
        rows, names, places = self.register.admitted(proposed, all_feasible=self.operators.always_feasible)
        own = int(np.searchsorted(places, len(immigrants_drawn)))
        immigrants = rows[:own]
        self._pool.add(rows[own:], names[own:])
        wanted = self.size - len(immigrants)
        if len(self._pool) < wanted:  # this population has hardly any new children left
            immigrants = np.concatenate([immigrants, self.fresh(self.draw, wanted - len(self._pool))])
        return np.concatenate([self._chosen(wanted), immigrants])

    def _immigrants(self, count: int) -> Bits:
        """Return at most `count` random labellings; one draw serves several generations."""
        if len(self._drawn_immigrants) < count:
            self._drawn_immigrants = np.concatenate([self._drawn_immigrants, self.draw(max(self.size, count))])
        given, self._drawn_immigrants = self._drawn_immigrants[:count], self._drawn_immigrants[count:]
        return given

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Store evaluations of labellings (k, m), True = dry, until the next call of `propose`.

        Nothing is stored once the remaining classes are enumerated.
        """
        if len(labellings) and self._enumeration is None:
            self._pending.append(
                (labellings, objectives(self.space, labellings, evaluations), status_ranks(evaluations))
            )

    def _learn(self) -> None:
        """Take in all stored evaluations at once, whatever calls of `tell` they came from."""
        if not self._pending:
            return
        labellings, values, status_rank = (np.concatenate(parts) for parts in zip(*self._pending, strict=True))
        self._pending = []
        good = status_rank == 0
        objective = np.where(good, -values[:, 0], _NO_LOAD_FACTOR * status_rank)
        self._surrogate.learn(labellings, objective)
        self._front.learn(-values[good, 0], values[good, 1:])
        own = np.arange(self._evaluated, self._evaluated + len(labellings)) >= self._first
        self._evaluated += len(labellings)
        self._rows = np.concatenate([self._rows, labellings[own]])
        self._status_rank = np.concatenate([self._status_rank, status_rank[own]])
        self._values = np.concatenate([self._values, values[own]])
        self._survive()
        first = self._values[(self._rank == 0) & (self._status_rank == 0), : self.objective_count]
        part, exponent = np.frexp(first)
        leaders = {row.tobytes() for row in np.ldexp(np.round(part * _RESOLUTION), exponent)}
        self._idle = 0 if leaders != self._leaders else self._idle + int(own.sum())
        self._leaders = leaders

    def _survive(self) -> None:
        """Keep the best of the population, with their ranks and crowding distances."""
        rank = np.asarray(self._status_rank + len(self._status_rank), dtype=np.float64)
        crowding = np.zeros(len(self._status_rank))
        good = np.flatnonzero(self._status_rank == 0)
        values = self._values[good, : self.objective_count]
        fronts = fronts_of(values, self.population) if len(good) else []
        for number, front in enumerate(fronts):
            rank[good[front]] = number
        ranked = good[np.concatenate(fronts)] if fronts else good
        crowding[ranked] = crowding_of(self._values[ranked, : self.objective_count], rank[ranked])
        kept = np.lexsort((-crowding, rank))[: self.population]
        self._rows, self._status_rank, self._values = self._rows[kept], self._status_rank[kept], self._values[kept]
        self._rank, self._crowding = rank[kept], crowding[kept]

    def _children(self, count: int) -> Bits:
        """Return at most `count` children of parents selected by tournaments."""
        crossed = round(CROSSING_SHARE * count)
        rivals = self._generator.integers(len(self._rows), size=(2 * count, 2))
        couples = self._winners(rivals).reshape(count, 2)
        first, second = self._rows[couples[:, 0]], self._rows[couples[:, 1]]
        # any symmetric image is an equally good parent; the choice decides which joints are combined
        group = self.space.group
        turned = self._generator.integers(len(group), size=crossed)
        images = np.take_along_axis(second[:crossed], group[turned], axis=1)
        return self.operators.breed(first[:crossed], images, first[crossed:], self.rng)

    def _chosen(self, wanted: int) -> Bits:
        """Take the most promising children out of the pool, and keep the next `POOL` ones."""
        prediction = self._pool.predict()
        order = np.argsort(-prediction, kind="stable")
        taken = order[: wanted if self.objective_count == 1 else -(-wanted // 2)]
        order = order[len(taken) :]
        if self.objective_count > 1:
            # expected improvement over the best known labelling of equal or better counts
            gain = prediction - self._surrogate.share_below(self._front.best(self._pool.counts))
            second = order[np.argsort(-gain[order], kind="stable")[: wanted - len(taken)]]
            left = np.ones(len(prediction), dtype=bool)
            left[second] = False
            taken, order = np.concatenate([taken, second]), order[left[order]]
        rows = self._pool.rows[taken]
        self._forget(order[POOL:])
        self._pool.keep(np.sort(order[:POOL]))
        return rows

    def _forget(self, places: Ints) -> None:
        """Remove children of the pool, by position, from the register so that they may recur."""
        self.register.forget(self._pool.names[places].tolist())

    def _winners(self, pairs: Ints) -> Ints:
        """Return the winner (k,) of each pair (k, 2) of positions in the population.

        The status decides first, then λ or the rank (at random), then the crowding distance.
        """
        first, second = pairs[:, 0], pairs[:, 1]
        # choosing more parents by λ alone finds the best labelling earlier, choosing fewer widens the front
        alone = self._generator.random(len(pairs)) < LOAD_FACTOR_SHARE
        value, rank, status_rank = self._values[:, 0], self._rank, self._status_rank
        worse = [
            status_rank[first] - status_rank[second],
            np.where(alone, value[first] - value[second], rank[first] - rank[second]),
        ]
        less = np.where(worse[0] != 0, worse[0], worse[1])
        less = np.where(less != 0.0, less, self._crowding[second] > self._crowding[first])
        return np.asarray(np.where(less > 0.0, second, first))
