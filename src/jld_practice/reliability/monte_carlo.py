"""Monte Carlo simulation of a layout, decided by proven bounds; rare failures by importance sampling."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from scipy.special import betaincinv, ndtri

from jld_core import Bools, Floats, Ints
from jld_core.batch import batch_solver
from jld_explore.evaluation import Pool
from jld_practice.reliability.form import Form
from jld_practice.reliability.structure import GoverningBounds, SampleBounds

_FEW: Final = 1000  # failures expected of plain sampling below which samples are drawn around the design points

# One of so many samples of importance sampling is drawn around the means, so that no weight exceeds this number
_PLAIN: Final = 10

# Share of the other samples that is divided evenly among the design points; the rest follows their probabilities
_EVEN: Final = 0.5

CONFIDENCE: Final = 0.95  # of intervals

_Result = TypeVar("_Result")


@dataclass(frozen=True)
class MonteCarlo:
    """Result of a simulation."""

    # samples, failures, resolved, undecided: samples; those that surely fail; those that the batch solver left open and
    # another route solved; those that stay open, which count as failures
    samples: int
    failures: int
    resolved: int
    undecided: int
    probability: float  # estimated probability of failure
    # confidence interval of it; its lower end counts undecided samples as safe, its upper end what was not seen
    interval: tuple[float, float]
    importance: bool  # True for importance sampling
    nearest: Floats | None  # (v,) failing sample nearest to the means, in standard normal space; None where none fails
    unseen: float = 0.0  # what the upper end of the interval counts for failures away from all design points

    @property
    def beta(self) -> float | None:
        """Reliability index −Φ⁻¹(p); None where no sample or every sample fails."""
        return index_of(self.probability)

    @property
    def beta_interval(self) -> tuple[float | None, float | None]:
        """Confidence interval of the reliability index; None for an unbounded end."""
        return index_of(self.interval[1]), index_of(self.interval[0])


def index_of(probability: float) -> float | None:
    """Return the reliability index of a probability of failure; None for 0 and 1."""
    return -float(ndtri(probability)) if 0.0 < probability < 1.0 else None


@dataclass(frozen=True)
class _Part:
    """Counts of a portion of the samples."""

    failures: int
    resolved: int
    undecided: int
    # weights, squares: sums over failing, then over undecided samples
    weights: Floats
    squares: Floats
    nearest: Floats | None  # see `MonteCarlo`


def is_rare(points: Sequence[Form], samples: int) -> bool:
    """Return whether plain samples are expected to fail too seldom."""
    return bool(points) and samples * sum(one.probability for one in points) < _FEW


def simulate(
    bounds: SampleBounds,
    required: float,
    samples: int,
    seed: int,
    jobs: int = 1,
    points: Sequence[Form] = (),
    unseen: float = 0.0,
) -> MonteCarlo:
    """Estimate the probability that a layout carries less than `required`."""
    rare = is_rare(points, samples)
    drawing = _Drawing.around(points if rare else points[:1], samples, seed, len(bounds.structure.variables), rare)

    def one(part: int) -> _Part:
        return _counted(bounds, required, *drawing.part(part))

    parts = in_threads(one, -(-samples // batch_solver.SAMPLES_OF_A_CALL), jobs)
    failures, resolved, undecided = (
        sum(getattr(p, key) for p in parts) for key in ("failures", "resolved", "undecided")
    )
    weights, squares = np.sum([p.weights for p in parts], axis=0), np.sum([p.squares for p in parts], axis=0)
    near = [p.nearest for p in parts if p.nearest is not None]
    nearest = min(near, key=lambda point: float(point @ point)) if near else None
    if not rare:
        interval = exact_interval(failures, undecided, samples)
        probability = (failures + undecided) / samples
        return MonteCarlo(samples, failures, resolved, undecided, probability, interval, rare, nearest)
    probability = min(1.0, float(weights.sum()) / samples)
    low, high = (_normal_interval(weights[:n].sum(), squares[:n].sum(), samples) for n in (1, 2))
    if failures + undecided == 0:  # those drawn around the means alone say how rare failures are
        unseen = exact_interval(0, 0, drawing.counts[0])[1]
    interval = low[0], min(1.0, high[1] + unseen)
    return MonteCarlo(samples, failures, resolved, undecided, probability, interval, rare, nearest, unseen)


def in_threads(one: Callable[[int], _Result], parts: int, jobs: int) -> list[_Result]:
    """Call a function for portions of the samples in `jobs` threads; keep their order."""
    with Pool(min(jobs, parts), threads=True) as pool:
        return list(pool.run(one, [(part,) for part in range(parts)]))


@dataclass(frozen=True)
class _Drawing:
    """Samples in standard normal space, by portions with random numbers of their own."""

    seed: int
    counts: Ints  # (c,) number of samples around each centre. Samples of one centre follow one another.
    centres: Floats  # (c, v) points around which samples are drawn; the first one is the means
    # (c, v) direction in which the samples of each centre are stratified, one in each of as many strata of equal
    # probability; 0 for independent samples
    along: Floats

    @classmethod
    def around(cls, points: Sequence[Form], samples: int, seed: int, variables: int, rare: bool) -> _Drawing:
        """Return the drawing of samples around the means alone, or around rare design points too."""
        ends = np.array([one.point for one in points]).reshape(-1, variables)
        first = ends[:1] if len(ends) else np.zeros((1, variables))
        if not rare:
            return cls(seed, np.array([samples]), np.zeros((1, variables)), first)
        share = np.array([one.probability for one in points])
        share = _EVEN / len(share) + (1.0 - _EVEN) * share / share.sum() if share.any() else 1.0 / len(share) + share
        plain = -(-samples // _PLAIN)
        last = np.round((samples - plain) * np.cumsum(share)).astype(np.int64)
        counts = np.diff(np.concatenate([[0, plain], plain + last]))
        return cls(seed, counts, np.vstack([np.zeros((1, variables)), ends]), np.vstack([first, ends]))

    def part(self, number: int) -> tuple[Floats, Floats]:
        """Return the points (k, v) of a portion and their weights (k,)."""
        samples = int(self.counts.sum())
        index = np.arange(
            number * batch_solver.SAMPLES_OF_A_CALL, min((number + 1) * batch_solver.SAMPLES_OF_A_CALL, samples)
        )
        dice = np.random.default_rng([self.seed, number])
        points = dice.standard_normal((len(index), self.centres.shape[1]))
        within = dice.uniform(0.0, 1.0, len(index))
        begin = np.cumsum(self.counts) - self.counts
        centre = np.searchsorted(begin + self.counts, index, side="right")
        place = (index - begin[centre] + within) / self.counts[centre]
        # 0 has no quantile; half of the smallest share that numbers of a generator can have stands for it
        level = ndtri(np.maximum(place, 0.5 * 2.0**-53 / samples))
        size = np.linalg.norm(self.along, axis=1, keepdims=True)
        unit = (self.along / np.where(size > 0.0, size, 1.0))[centre]
        ahead = np.where(size[centre, 0] > 0.0, level - (points * unit).sum(axis=1), 0.0)
        points += ahead[:, None] * unit + self.centres[centre]
        exponents = points @ self.centres.T - 0.5 * (self.centres**2).sum(axis=1)
        with np.errstate(over="ignore"):
            return points, 1.0 / (np.exp(exponents) @ (self.counts / samples))


def decided(bounds: SampleBounds, required: float, values: Floats) -> tuple[Bools, Bools, int]:
    """Return (k,) which samples (k, v) surely fail and which stay open, and how many were solved again."""
    found = bounds.of(values, required)
    fails, open_ = found.fails(required), ~(found.fails(required) | found.holds(required))
    again = np.flatnonzero(open_) if bounds.batched else np.zeros(0, dtype=np.int64)
    if len(again):
        proven = bounds.proven(values[again])
        fails[again], open_[again] = proven.fails(required), ~(proven.fails(required) | proven.holds(required))
    return fails, open_, len(again)


def _counted(bounds: SampleBounds, required: float, points: Floats, weights: Floats) -> _Part:
    """Decide the samples of a portion and count them."""
    fails, open_, again = decided(bounds, required, bounds.structure.variables.values(points))
    masks = (fails, open_)
    sums = np.array([weights[mask].sum() for mask in masks])
    squares = np.array([(weights[mask] ** 2).sum() for mask in masks])
    nearest = points[fails][np.argmin((points[fails] ** 2).sum(axis=1))] if fails.any() else None
    return _Part(int(fails.sum()), again, int(open_.sum()), sums, squares, nearest)


def exact_interval(failures: int, undecided: int, samples: int) -> tuple[float, float]:
    """Return the Clopper–Pearson interval; undecided samples are safe below and fail above."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    most = failures + undecided
    low = 0.0 if failures == 0 else float(betaincinv(failures, samples - failures + 1, tail))
    high = 1.0 if most == samples else float(betaincinv(most + 1, samples - most, 1.0 - tail))
    return low, high


def _normal_interval(weight: Any, square: Any, samples: int) -> tuple[float, float]:
    """Return the interval of a mean of weights by its standard error, within 0 and 1."""
    mean = float(weight) / samples
    error = float(np.sqrt(max(float(square) / samples - mean * mean, 0.0) / samples))
    reach = float(ndtri(0.5 + 0.5 * CONFIDENCE)) * error
    return max(0.0, mean - reach), min(1.0, mean + reach)


@dataclass(frozen=True)
class Comparison:
    """Which of two layouts of a structure carries more, over samples of their common values."""

    # samples, stronger, weaker, undecided: samples; those in which the first layout surely carries more; surely less;
    # and all others, in which both carry alike or bounds overlap
    samples: int
    stronger: int
    weaker: int
    undecided: int

    @property
    def probability(self) -> float:
        """Share of samples in which the first layout surely carries more."""
        return self.stronger / self.samples

    @property
    def interval(self) -> tuple[float, float]:
        """Confidence interval of the probability that the first carries more, undecided ones above."""
        return exact_interval(self.stronger, self.undecided, self.samples)


def compare(one: SampleBounds, other: SampleBounds, samples: int, seed: int, jobs: int = 1) -> Comparison:
    """Compare two layouts of a structure on the same samples, by proven bounds on λ."""
    drawing = _Drawing.around((), samples, seed, len(one.structure.variables), rare=False)

    def count(part: int) -> tuple[int, int]:
        points, _ = drawing.part(part)
        values = one.structure.variables.values(points)
        first, second = one.of(values), other.of(values)
        for bounds, found in ((one, first), (other, second)):
            _prove_open(bounds, found, values)
        stronger = (first.low > second.high) | (np.isposinf(first.low) & ~np.isposinf(second.high))
        weaker = (second.low > first.high) | (np.isposinf(second.low) & ~np.isposinf(first.high))
        return int(stronger.sum()), int(weaker.sum())

    parts = in_threads(count, -(-samples // batch_solver.SAMPLES_OF_A_CALL), jobs)
    stronger, weaker = (sum(part[k] for part in parts) for k in (0, 1))
    return Comparison(samples, stronger, weaker, samples - stronger - weaker)


def _prove_open(bounds: SampleBounds, found: GoverningBounds, values: Floats) -> None:
    """Solve samples (k, v) again that lack one of two bounds, and replace their bounds."""
    again = np.flatnonzero(np.isneginf(found.low) != np.isneginf(found.high))
    again = np.union1d(again, np.flatnonzero(np.isposinf(found.low) != np.isposinf(found.high)))
    if len(again) and bounds.batched:
        proven = bounds.proven(values[again])
        found.low[again], found.high[again] = proven.low, proven.high
