"""Genetic search (NSGA-II): operators on blocks, and a surrogate that selects among many children."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.drivers.base import Aim, DriverOptions
from jld_explore.drivers.searcher import Pool, Searcher, Surrogate
from jld_explore.evaluation.protocol import Envelope, Evaluation, objectives, status_ranks
from jld_explore.space.search_space import SearchSpace

_PAIRS: Final = 1 << 22  # largest number of pairs compared in one step; limits temporary memory to some 10 MB


def fronts_of(values: Floats, enough: int) -> list[Ints]:
    """Sort values (k, c), to be minimised, into fronts of row numbers until enough rows are ranked."""
    # A row dominates another if it is nowhere larger and somewhere smaller. The first front holds the rows that none
    # dominates, each further front those that only rows of earlier fronts dominate. Equal rows share a front.
    # Deb et al. 2002, section III.A: count the rows that dominate each row, and take away the fronts one by one. Up to
    # two objectives take O(k log k), more take O(k² c).
    if values.shape[1] <= 2:
        rank = _ranks_of_pairs(values)
        order = np.argsort(rank, kind="stable")
        begins = np.flatnonzero(np.diff(rank[order])) + 1
        return np.split(order, begins)[: int(np.searchsorted(begins, enough)) + 1]
    left = _dominators(values, np.arange(len(values)))
    fronts: list[Ints] = []
    ranked = 0
    front = np.flatnonzero(left == 0)
    while len(front) and ranked < enough:
        fronts.append(front)
        ranked += len(front)
        left -= _dominators(values, front)
        left[front] = -1
        front = np.flatnonzero(left == 0)
    return fronts


def _ranks_of_pairs(values: Floats) -> Ints:
    """Return the front number of each row of values (k, 1 or 2)."""
    order = np.lexsort(values.T[::-1])
    rows = values[order]
    new = np.append(True, (rows[1:] != rows[:-1]).any(axis=1)).tolist()
    least: list[float] = []  # Smallest last value on each front, ascending: an earlier row with one as small dominates.
    rank = np.empty(len(values), dtype=np.int64)
    place = 0
    for position, value, differs in zip(order.tolist(), rows[:, -1].tolist(), new, strict=True):
        if differs:
            place = bisect_right(least, value)
            least[place : place + 1] = [value]
        rank[position] = place
    return rank


def _dominators(values: Floats, rivals: Ints) -> Ints:
    """Count for each row of values (k, c) the rivals, given by position, that dominate it."""
    found = np.zeros(len(values), dtype=np.int64)
    step = max(1, _PAIRS // max(1, len(values)))
    for start in range(0, len(rivals), step):
        some = values[rivals[start : start + step]]
        weak: Bits = np.ones((len(some), len(values)), dtype=bool)
        strict: Bits = np.zeros((len(some), len(values)), dtype=bool)
        for column in range(values.shape[1]):
            weak &= some[:, column, None] <= values[:, column]
            strict |= some[:, column, None] < values[:, column]
        found += np.count_nonzero(weak & strict, axis=0)
    return found


def crowding_of(values: Floats, front: Floats) -> Floats:
    """Return the crowding distance (k,) of values (k, c) on the front (k,) of each row."""
    # Selection prefers labellings of large distance. It is infinite at the ends of a front, and 0 for labellings of
    # equal values between others. Deb et al. 2002, section III.B, for all fronts at once.
    found = np.zeros(len(values))
    for column in values.T if len(values) else ():
        order = np.lexsort((column, front))
        own, name = column[order], front[order]
        begins = np.append(True, name[1:] != name[:-1])
        first, last = np.flatnonzero(begins), np.flatnonzero(np.append(begins[1:], True))
        gap = np.diff(own)
        before, after = np.append(np.inf, gap), np.append(gap, np.inf)
        before[first] = after[last] = np.inf
        width = np.repeat(own[last] - own[first], last - first + 1)
        found[order] += np.divide(before + after, width, out=np.zeros(len(own)), where=width > 0.0)
    found /= max(1, values.shape[1])
    return found


CROSSING_SHARE: Final = 0.5  # share of children with two parents; the others are mutations of one parent

IMMIGRANT_SHARE: Final = 0.05  # share of random labellings among the proposals of a generation

LOAD_FACTOR_SHARE: Final = 0.5  # share of tournaments that λ alone decides

PATIENCE: Final = 8  # evaluations without progress, per face that can change, before a population restarts

GENERATION: Final = 48  # number of children evaluated per generation

POOL: Final = 200  # largest number of children that remain in the pool

_PER_KEY: Final = 1.5  # default population size per face that can change
_SIZES: Final = (32, 48)  # smallest and largest default population size

# Objective value of labellings without a number, times the rank of their status. The value is below all numbers.
_NO_LOAD_FACTOR: Final = -1e300

_RESOLUTION: Final = 2.0**20  # reciprocal of the relative resolution that distinguishes progress in λ from rounding


class GeneticOptions(DriverOptions):
    population: Annotated[int, Field(ge=4, le=1_000_000)] | None = Field(None, description="population size")
    # search for the largest λ, or for the largest λ for every value of the count
    aim: Aim = Field("front", description="best, or front (the best for every count)")


class Genetic(Searcher):
    """Driver that runs a genetic algorithm with a surrogate.

    Each generation evaluates `GENERATION` children.

    Parameters
    ----------
    space : SearchSpace
        Labellings that may be searched.
    seed : int
        Seed of random numbers.
    population : int, optional
        Population size; default: by the number of faces that can change.
    aim : {"front", "best"}
        λ and the counts of the front, or λ alone.
    """

    name = "genetic"
    Options = GeneticOptions
    ahead: int = 1

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
        self._drawn_immigrants = self._no_labellings
        self._front = Envelope(counts)
        self._pending: list[tuple[Bits, Floats, Ints]] = []
        self._proposed = self._evaluated = 0
        self._start_population()

    def _start_population(self) -> None:
        """Start an empty population with the proposals from now on; the surrogate stays."""
        self._first = self._proposed
        self._rows, self._status_rank, self._values = (
            self._no_labellings,
            np.empty(0, dtype=np.int64),
            np.empty((0, 1 + len(self.space.search.front.axes))),
        )
        self._leaders: set[bytes] = set()
        self._idle = 0

    @property
    def settings(self) -> dict[str, Any]:
        return {"population": self.population, "aim": self.aim}

    @property
    def leading(self) -> Bits:
        """Labellings (k, m) of the population that have a λ."""
        return np.asarray(self._rows[self._status_rank == 0])

    def propose(self) -> Bits:
        # Labellings are random while the population has fewer than two. A population without progress is given up
        # first, and another one started.
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

    def like(self, space: SearchSpace) -> Genetic:
        return Genetic(space, self.seed, self.population, "best")

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        self.standing_start.watch(evaluations)
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
        """Return the winner (k,) of each pair (k, 2) of positions in the population."""
        # The status decides first, then λ or the rank (at random), then the crowding distance.
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
