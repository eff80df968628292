"""A genetic search: the library's sorting into fronts, our operators, and a guess at what is worth it.

Two or three objectives are NSGA-II: larger λ, and the counts of the scene's front; one objective looks at λ alone. Far
more children are made than evaluated: new ones wait in a **pool**, and of those there the surrogate picks the
ones it expects most of, whichever generation they are from. Where generations bring no progress, another
population is begun at random; what was learned stays known, so it settles elsewhere.

Labellings without a number rank below all that have one, in the order of `ranking.ORDER`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.drivers.base import Aim, DriverOptions
from jld_explore.drivers.pool import Pool
from jld_explore.drivers.searcher import Searcher
from jld_explore.drivers.surrogate import Surrogate
from jld_explore.evaluation import Envelope, Evaluation, objectives, places
from jld_explore.space import SearchSpace

CROSSING: Final = 0.5
"""Share of children with two parents; the others are changes of one."""

IMMIGRANTS: Final = 0.05
"""Share of random labellings in a generation."""

GREED: Final = 0.5
"""Share of tournaments, and of children evaluated with two objectives, in which λ alone decides."""

PATIENCE: Final = 8
"""Evaluations without progress, for each face that can change, after which a population has settled."""

GENERATION: Final = 48
"""Children evaluated together."""

POOL: Final = 200
"""Children in the pool, at the most."""

_PER_KEY: Final = 1.5
_SIZES: Final = (32, 48)
"""Population for each face that can change, and its limits."""

_BELOW: Final = -1e300
"""Worth of labellings without a number, for each place in the order of their statuses: below all numbers."""

_SAME: Final = 2.0**20
"""Parts of λ that tell progress from rounding."""


class GeneticOptions(DriverOptions):
    """Options of the genetic driver."""

    population: Annotated[int, Field(ge=4, le=1_000_000)] | None = Field(None, description="labellings alive")
    aim: Aim = Field("front", description="best, or front (the best for every count)")


class Genetic(Searcher):
    """A population of `population` labellings, of which GENERATION children are evaluated at a time.

    population: by the size of the scene where it is not given. aim: both objectives, or λ alone.
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
        self.aims = 1 + counts if aim == "front" else 1
        self._generator = np.random.default_rng([seed, 1])
        self._surrogate = Surrogate(space)
        self._sort: Callable[..., list[Ints]] = _levels
        if self.aims > 1:
            from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

            self._sort = NonDominatedSorting().do
        self._pool = Pool(space, self._surrogate)
        self._strangers = self._none
        self._front = Envelope(counts)
        self._pending: list[tuple[Bits, Floats, Ints]] = []
        self._proposed = self._told = 0
        self._begin()

    def _begin(self) -> None:
        """Begin a population with what is proposed from now on."""
        self._first = self._proposed
        self._rows, self._place, self._values = (
            self._none,
            np.empty(0, dtype=np.int64),
            np.empty((0, 1 + len(self.space.search.front.axes))),
        )
        self._leaders: set[bytes] = set()
        self._idle = 0

    @property
    def settings(self) -> dict[str, Any]:
        """Size of population, number of aims, and the library that selects."""
        return {"population": self.population, "aim": self.aim, "pymoo": version("pymoo")}

    def propose(self) -> Bits:
        """The next generation; those before anything of a population is known are drawn at random."""
        self._learn()
        if self._idle > PATIENCE * self.operators.keys:
            self._forget(np.arange(len(self._pool)))
            self._pool.keep(np.empty(0, dtype=np.int64))
            self._begin()
        rows = self._generation() if len(self._rows) > 1 else self.fresh(self.draw, self.size)
        self._proposed += len(rows)
        return rows

    def _generation(self) -> Bits:
        strangers = self._immigrants(max(1, round(IMMIGRANTS * self.size)))
        proposed = np.concatenate([strangers, self._children(self.operators.offspring_factor * self.size)])
        rows, names, places = self.register.admitted(proposed, sure=self.operators.sure)
        own = int(np.searchsorted(places, len(strangers)))
        immigrants = rows[:own]
        self._pool.add(rows[own:], names[own:])
        wanted = self.size - len(immigrants)
        if len(self._pool) < wanted:  # all that this family can have is known by now
            immigrants = np.concatenate([immigrants, self.fresh(self.draw, wanted - len(self._pool))])
        return np.concatenate([self._chosen(wanted), immigrants])

    def _immigrants(self, count: int) -> Bits:
        """Random labellings, of which some generations' are drawn together."""
        if len(self._strangers) < count:
            self._strangers = np.concatenate([self._strangers, self.draw(max(self.size, count))])
        given, self._strangers = self._strangers[:count], self._strangers[count:]
        return given

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Keep what is known for the next generation."""
        if len(labellings) and self._rest is None:
            self._pending.append((labellings, objectives(self.space, labellings, evaluations), places(evaluations)))

    def _learn(self) -> None:
        """Take in what was told, whatever the portions it came in."""
        if not self._pending:
            return
        labellings, values, place = (np.concatenate(parts) for parts in zip(*self._pending, strict=True))
        self._pending = []
        good = place == 0
        worth = np.where(good, -values[:, 0], _BELOW * place)
        self._surrogate.learn(labellings, worth)
        self._front.learn(-values[good, 0], values[good, 1:])
        own = np.arange(self._told, self._told + len(labellings)) >= self._first
        self._told += len(labellings)
        self._rows = np.concatenate([self._rows, labellings[own]])
        self._place = np.concatenate([self._place, place[own]])
        self._values = np.concatenate([self._values, values[own]])
        self._survive()
        first = self._values[(self._rank == 0) & (self._place == 0), : self.aims]
        part, exponent = np.frexp(first)
        leaders = {row.tobytes() for row in np.ldexp(np.round(part * _SAME), exponent)}
        self._idle = 0 if leaders != self._leaders else self._idle + int(own.sum())
        self._leaders = leaders

    def _survive(self) -> None:
        """Keep the best of the population, with their ranks and crowding."""
        rank = np.asarray(self._place + len(self._place), dtype=np.float64)
        crowding = np.zeros(len(self._place))
        good = np.flatnonzero(self._place == 0)
        values = self._values[good, : self.aims]
        fronts = self._sort(values, n_stop_if_ranked=self.population) if len(good) else []
        for number, front in enumerate(fronts):
            rank[good[front]] = number
        ranked = good[np.concatenate(fronts)] if fronts else good
        crowding[ranked] = crowding_of(self._values[ranked, : self.aims], rank[ranked])
        kept = np.lexsort((-crowding, rank))[: self.population]
        self._rows, self._place, self._values = self._rows[kept], self._place[kept], self._values[kept]
        self._rank, self._crowding = rank[kept], crowding[kept]

    def _children(self, count: int) -> Bits:
        crossed = round(CROSSING * count)
        rivals = self._generator.integers(len(self._rows), size=(2 * count, 2))
        couples = self._winners(rivals).reshape(count, 2)
        first, second = self._rows[couples[:, 0]], self._rows[couples[:, 1]]
        # a mirror image is as good a parent: which one decides what the joints meet
        group = self.space.group
        turned = self._generator.integers(len(group), size=crossed)
        images = np.take_along_axis(second[:crossed], group[turned], axis=1)
        return self.operators.breed(first[:crossed], images, first[crossed:], self.rng)

    def _chosen(self, wanted: int) -> Bits:
        """Take the most promising out of the pool; of the others the most promising stay."""
        guess = self._pool.guess()
        order = np.argsort(-guess, kind="stable")
        taken = order[: wanted if self.aims == 1 else -(-wanted // 2)]
        order = order[len(taken) :]
        if self.aims > 1:
            # how much more than the best known with as good a count
            gain = guess - self._surrogate.share(self._front.best(self._pool.counts))
            second = order[np.argsort(-gain[order], kind="stable")[: wanted - len(taken)]]
            left = np.ones(len(guess), dtype=bool)
            left[second] = False
            taken, order = np.concatenate([taken, second]), order[left[order]]
        rows = self._pool.rows[taken]
        self._forget(order[POOL:])
        self._pool.keep(np.sort(order[:POOL]))
        return rows

    def _forget(self, places: Ints) -> None:
        """Let those at some places of the pool come again."""
        self.register.forget(self._pool.names[places].tolist())

    def _winners(self, pairs: Ints) -> Ints:
        """Winner of each pair (k, 2): fewer violations, then lower rank, then less crowded; (k,)."""
        first, second = pairs[:, 0], pairs[:, 1]
        # the more parents are chosen by λ alone the sooner the best is found, the fewer the wider the front
        alone = self._generator.random(len(pairs)) < GREED
        value, rank, place = self._values[:, 0], self._rank, self._place
        worse = [
            place[first] - place[second],
            np.where(alone, value[first] - value[second], rank[first] - rank[second]),
        ]
        less = np.where(worse[0] != 0, worse[0], worse[1])
        less = np.where(less != 0.0, less, self._crowding[second] > self._crowding[first])
        return np.asarray(np.where(less > 0.0, second, first))


def _levels(values: Floats, n_stop_if_ranked: int) -> list[Ints]:
    """Fronts of one objective, values (k, 1), until so many are ranked: equal values are one front."""
    order = np.argsort(values[:, 0], kind="stable")
    begins = np.flatnonzero(np.diff(values[order, 0])) + 1
    last = int(np.searchsorted(begins, n_stop_if_ranked)) + 1
    return np.split(order, begins)[:last]


def crowding_of(values: Floats, front: Floats) -> Floats:
    """How far the neighbours of each lie from one another on its front, (k,), infinite at the ends.

    values: (k, c); front: (k,) number of each one's front. Equal ones beside others are crowded out: 0. Source: Deb et
    al. 2002, section III.B; the library's is for one front, and takes as long for each as this for all.
    """
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
