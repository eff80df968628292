"""Monte Carlo simulation of a layout, decided by proven bounds; rare failures by importance sampling."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, TypeVar

import numpy as np
from scipy.special import betaincinv, ndtr, ndtri

from jld_core import (
    Assembly,
    Bits,
    Bools,
    Floats,
    InputError,
    Ints,
    LimitAnalysis,
    ParameterError,
    Scene,
    Status,
    one_thread,
)
from jld_core.batch import batch_solver
from jld_core.limit import Proof
from jld_core.mechanics import FrictionSet
from jld_core.scene import standard
from jld_explore.evaluation import Pool
from jld_practice.reliability.structure import (
    GoverningBounds,
    RandomStructure,
    SampleBounds,
    Variables,
    random_structure,
)

_STEPS: Final = 60  # largest number of iterations

_HALVINGS: Final = 3  # largest number of halvings of a step along one gradient, and along several

# Largest number of targets of one step at a kink; every one that fails adds the gradients that it met
_TRIALS: Final = 6

_KEPT: Final = 24  # largest number of gradients kept for a kink: the latest ones

# Distance between points, over the larger of 1 and |u|, up to which their gradients belong to one kink
_NEAR_POINT: Final = 0.3

_SURFACE: Final = 1e-6  # distance from the failure surface at which the iteration ends, in standard normal space

# Distance from the point of the linearised surface nearest to the means at which the iteration ends
_POINT: Final = 1e-4

# Distance to the failure surface, linearised at the means, beyond which there is no search for it
_HOPELESS: Final = 1e4

# Relative step of the derivatives of the dissipation by strengths, in which it is linear or smooth
_DIFFERENCE: Final = 1e-6


@dataclass(frozen=True)
class Limit:
    """Value and gradient of the limit function at a point of the standard normal space."""

    value: float  # governing factor less the required one; +inf where λ is unbounded
    gradient: Floats | None  # (v,) gradient by the standard normal variables; None where it is unknown

    @property
    def distance(self) -> float:
        """Distance to the linearised failure surface, positive if safe; inf if unknown."""
        if self.gradient is None or not math.isfinite(self.value):
            return math.inf
        size = float(np.linalg.norm(self.gradient))
        return self.value / size if size > 0.0 else math.inf


@dataclass(frozen=True)
class Form:
    """Result of the first-order method."""

    beta: float  # reliability index; NaN where the iteration found no design point
    point: Floats  # (v,) design point in standard normal space
    steps: int  # iterations
    kink: bool = False  # True if the design point lies on a kink of λ, between one-sided gradients
    problem: str = ""  # why there is no design point; "" where there is one
    far: bool = False  # True if there is none since failures are too far from the means

    @property
    def found(self) -> bool:
        return not self.problem

    @property
    def probability(self) -> float:
        """Probability of failure of the linearised problem, Φ(−β)."""
        return float(ndtr(-self.beta))

    @property
    def direction(self) -> Floats:
        """Unit vector α (v,) to the design point; squares are shares of the variance."""
        return self.point / self.beta if self.beta else np.zeros_like(self.point)


class LimitFunction:
    """Governing factor less the required one, as a function of standard normal variables."""

    def __init__(self, bounds: SampleBounds, required: float) -> None:
        self.bounds, self.required = bounds, required
        self.variables = bounds.structure.variables

    def at(self, point: Floats) -> Limit:
        """Return value and gradient at a point (v,) of the standard normal space."""
        limit = self.at_values(self.variables.values(point))
        slopes = self.variables.slopes(point)
        return limit if limit.gradient is None else replace(limit, gradient=limit.gradient * slopes)

    @one_thread()
    def at_values(self, values: Floats) -> Limit:
        values_of_cases: list[tuple[float, Floats | None]] = []
        for case, required in enumerate(self.bounds.structure.assembly.required.tolist()):
            analysis, proof = self.bounds.solved(values, case)
            value, rates = self._of_case(analysis, proof, values, case)
            values_of_cases.append((value / required, None if rates is None else rates / required))
        value, rates = min(values_of_cases, key=lambda pair: math.inf if math.isnan(pair[0]) else pair[0])
        return Limit(value - self.required, rates)

    def _of_case(self, analysis: LimitAnalysis, proof: Proof, values: Floats, case: int) -> tuple[float, Floats | None]:
        """Return λ of a load case and its rates (v,) with the variables, docs/method.md (12.4)."""
        # Where λ is negative it is that of the mechanism that proves instability.
        template = analysis.template
        if proof.status is Status.LOCKED:
            return math.inf, None
        motion, state, load = proof.motion, proof.state, template.scaling.load
        if motion is None or state is None or motion.work <= 0.0:
            return (-math.inf if proof.status is Status.UNSTABLE else math.nan), None
        velocity, jumps = motion.velocity / motion.work, motion.jumps / motion.work
        scaled = motion.bound / motion.work
        by_strength = _by_strength(template.yield_set.associative, jumps, state.forces[:, 0], self.bounds.labels)
        unit = load * template.assembly.interfaces.area / template.scaling.force
        by_strength = {name: rate * (load if name.endswith("friction") else unit) for name, rate in by_strength.items()}
        by_dead = np.zeros_like(template.assembly.dead)
        by_dead[template.assembly.elements.free] = -load * (velocity / template.scaling.row.ravel()).reshape(
            -1, template.assembly.freedoms
        )
        value = load * scaled
        rates = self.bounds.structure.rates(values, case, by_strength, (by_dead, value * by_dead))
        return value, rates


def _by_strength(sets: FrictionSet, jumps: Floats, normal: Floats, labels: np.ndarray) -> dict[str, Floats]:
    """Return derivatives (m,) of scaled λ by scaled strengths, at unit live work, from jumps (m, q)."""
    slip = sets.slip(jumps) * normal
    frictions = [parameter for parameter in standard.PARAMETERS if parameter.side == "friction"]
    rates = {friction.field: np.where(labels == (friction.label == "dry"), slip, 0.0) for friction in frictions}
    for name, values in sets.numbers.stresses.items():
        step = np.where(np.isfinite(values), _DIFFERENCE * np.maximum(values, 1.0), 0.0)
        ends = [
            sets.with_strengths(replace(sets.numbers, **{name: values + sign * step})).dissipation(jumps, labels)
            for sign in (0.0, 1.0)
        ]
        rates[name] = np.where(step > 0.0, (ends[1] - ends[0]) / np.where(step > 0.0, step, 1.0), 0.0)
    return rates


class _Iteration:
    def __init__(self, function: LimitFunction, point: Floats) -> None:
        self.function, self.point, self.reach = function, point, function.variables.reach
        self.met: list[tuple[Floats, Limit]] = []
        self.here = self.limit(point)

    def limit(self, point: Floats) -> Limit:
        limit = self.function.at(point)
        if math.isfinite(limit.distance):
            self.met = [*self.met, (point, limit)][-_KEPT:]
        return limit

    def nearest(self, around: bool) -> Floats:
        """Return the point (v,) nearest to the means where linearised limit functions are ≤ 0."""
        reach = _NEAR_POINT * max(1.0, float(np.linalg.norm(self.point)))
        chosen = [(self.point, self.here)]
        if around:
            chosen += [(at, limit) for at, limit in self.met if np.linalg.norm(at - self.point) <= reach]
        slopes = np.array(
            [limit.gradient / np.linalg.norm(limit.gradient) for _, limit in chosen if limit.gradient is not None]
        )
        sides = np.array([slope @ at - limit.distance for slope, (at, limit) in zip(slopes, chosen, strict=True)])
        nearest = _least_distance(slopes, sides) if around else None
        point = np.asarray(sides[0] * slopes[0]) if nearest is None else nearest
        return point * min(1.0, float((self.reach / np.maximum(abs(point), self.reach)).min()))

    def step(self, target: Floats) -> bool:
        """Move towards a target by the largest share that improves; return False if none does."""
        assert self.here.gradient is not None
        far = max(float(np.linalg.norm(self.point)), float(np.linalg.norm(target)))
        penalty = (2.0 * far + 1.0) / float(np.linalg.norm(self.here.gradient))
        before = _merit(self.point, self.here, penalty)
        for share in 0.5 ** np.arange(_HALVINGS + 1):
            trial = self.point + share * (target - self.point)
            limit = self.limit(trial)
            if math.isfinite(limit.distance) and _merit(trial, limit, penalty) < before:
                self.point, self.here = trial, limit
                return True
        return False

    def arrived(self, target: Floats) -> bool:
        """Return whether the point lies on the failure surface and equals the target."""
        return abs(self.here.distance) <= _SURFACE and _close(target, self.point)


def _close(first: Floats, second: Floats) -> bool:
    """Return whether two points are equal to the accuracy of a design point."""
    return float(np.linalg.norm(first - second)) <= _POINT * max(1.0, float(np.linalg.norm(second)))


def _merit(point: Floats, limit: Limit, penalty: float) -> float:
    """Return ½|u|² + c |g|, docs/method.md (12.5); penalty: c."""
    return 0.5 * float(point @ point) + penalty * abs(limit.value)


def _least_distance(slopes: Floats, sides: Floats) -> Floats | None:
    """Return the u (v,) of least norm with slopes (k, v)·u ≤ sides (k,); None if there is none."""
    # Lawson and Hanson, Solving Least Squares Problems (1974), problem LDP
    from scipy.optimize import nnls  # takes long to import, and every search would wait for it

    system = np.vstack([-slopes.T, -sides])
    last = np.zeros(len(system))
    last[-1] = 1.0
    residual = system @ nnls(system, last)[0] - last
    return None if abs(residual[-1]) <= _SURFACE else np.asarray(-residual[:-1] / residual[-1])


def design_point(function: LimitFunction, start: Floats | None = None) -> Form:
    """Find the point of the failure surface nearest to the means, in standard normal space."""
    # a step that does not lessen ½|u|² + c |g| is halved; at a kink of λ the gradients of both sides are linearised
    # together
    # docs/method.md (12.3) to (12.5). Sources: Hasofer and Lind (1974); Rackwitz and Fiessler (1978); the step control
    # follows Zhang and Der Kiureghian (1995).
    means = np.zeros(len(function.variables))
    work = _Iteration(function, means if start is None else start)
    if not math.isfinite(work.here.distance):
        where = "at the means" if start is None else "at its start"
        why = "is unbounded" if work.here.value == math.inf else "has no rates"
        return Form(math.nan, work.point, 0, problem=f"the load factor {where} {why}", far=work.here.value > 0.0)
    inside = (work.here if start is None else function.at(means)).value < 0.0
    for number in range(1, _STEPS + 1):
        plain = work.nearest(around=False)
        stuck = (abs(plain) >= (1.0 - 1e-9) * work.reach).any() and _close(plain, work.point)
        if stuck or (number == 1 and abs(work.here.distance) > _HOPELESS):
            problem = "λ hardly depends on the random values: none that can occur changes the outcome"
            return Form(math.nan, work.point, number, problem=problem, far=not inside)
        if work.arrived(plain):
            return _found(work, number, inside, kink=False)
        if work.step(plain):
            continue
        # A structure that fails at the means leaves its failure region by the first mechanism that holds.
        moved = False
        for _ in range(_TRIALS if not inside else 0):
            around = work.nearest(around=True)
            if work.arrived(around):
                return _found(work, number, inside, kink=True)
            moved = work.step(around)
            if moved:
                break
        if not moved:
            return Form(math.nan, work.point, number, kink=True, problem="no step leads nearer to the failure surface")
    return Form(math.nan, work.point, _STEPS, kink=True, problem=f"no design point after {_STEPS} steps")


def _found(work: _Iteration, steps: int, inside: bool, kink: bool) -> Form:
    """Return the result of a converged iteration; β < 0 if the structure fails at the means."""
    size = float(np.linalg.norm(work.point))
    return Form(-size if inside else size, work.point, steps, kink)


_FEW: Final = 1000  # failures expected of plain sampling below which samples are drawn around the design points

# One of so many samples of importance sampling is drawn around the means, so that no weight exceeds this number
_PLAIN: Final = 10

# Share of the other samples that is divided evenly among the design points; the rest follows their probabilities
_EVEN: Final = 0.5

CONFIDENCE: Final = 0.95  # of intervals

_Result = TypeVar("_Result")


@dataclass(frozen=True)
class MonteCarlo:
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
    failures: int
    resolved: int
    undecided: int
    # weights, squares: sums over failing, then over undecided samples
    weights: Floats
    squares: Floats
    nearest: Floats | None  # see `MonteCarlo`


def is_rare(points: Sequence[Form], samples: int) -> bool:
    """Return whether plain samples are expected to fail too seldom."""
    return bool(points) and samples * sum(point.probability for point in points) < _FEW


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


def in_threads(task: Callable[[int], _Result], parts: int, jobs: int) -> list[_Result]:
    """Call a function for portions of the samples in `jobs` threads; keep their order."""
    with Pool(min(jobs, parts), threads=True) as pool:
        return list(pool.run(task, [(part,) for part in range(parts)]))


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
        ends = np.array([point.point for point in points]).reshape(-1, variables)
        first = ends[:1] if len(ends) else np.zeros((1, variables))
        if not rare:
            return cls(seed, np.array([samples]), np.zeros((1, variables)), first)
        share = np.array([point.probability for point in points])
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
        quantile = (index - begin[centre] + within) / self.counts[centre]
        # 0 has no quantile; half of the smallest share that numbers of a generator can have stands for it
        level = ndtri(np.maximum(quantile, 0.5 * 2.0**-53 / samples))
        size = np.linalg.norm(self.along, axis=1, keepdims=True)
        unit = (self.along / np.where(size > 0.0, size, 1.0))[centre]
        ahead = np.where(size[centre, 0] > 0.0, level - (points * unit).sum(axis=1), 0.0)
        points += ahead[:, None] * unit + self.centres[centre]
        exponents = points @ self.centres.T - 0.5 * (self.centres**2).sum(axis=1)
        with np.errstate(over="ignore"):
            return points, 1.0 / (np.exp(exponents) @ (self.counts / samples))


def decided(bounds: SampleBounds, required: float, values: Floats) -> tuple[Bools, Bools, int]:
    """Return (k,) which samples (k, v) surely fail and which stay open, and how many were solved again."""
    bounds_found = bounds.of(values, required)
    fails, open_ = bounds_found.fails(required), ~(bounds_found.fails(required) | bounds_found.holds(required))
    open_rows = np.flatnonzero(open_) if bounds.batched else np.zeros(0, dtype=np.int64)
    if len(open_rows):
        proven = bounds.proven(values[open_rows])
        fails[open_rows], open_[open_rows] = proven.fails(required), ~(proven.fails(required) | proven.holds(required))
    return fails, open_, len(open_rows)


def _counted(bounds: SampleBounds, required: float, points: Floats, weights: Floats) -> _Part:
    fails, open_, open_rows = decided(bounds, required, bounds.structure.variables.values(points))
    masks = (fails, open_)
    sums = np.array([weights[mask].sum() for mask in masks])
    squares = np.array([(weights[mask] ** 2).sum() for mask in masks])
    nearest = points[fails][np.argmin((points[fails] ** 2).sum(axis=1))] if fails.any() else None
    return _Part(int(fails.sum()), open_rows, int(open_.sum()), sums, squares, nearest)


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
        for bounds, brackets in ((one, first), (other, second)):
            _prove_open(bounds, brackets, values)
        stronger = (first.low > second.high) | (np.isposinf(first.low) & ~np.isposinf(second.high))
        weaker = (second.low > first.high) | (np.isposinf(second.low) & ~np.isposinf(first.high))
        return int(stronger.sum()), int(weaker.sum())

    parts = in_threads(count, -(-samples // batch_solver.SAMPLES_OF_A_CALL), jobs)
    stronger, weaker = (sum(part[k] for part in parts) for k in (0, 1))
    return Comparison(samples, stronger, weaker, samples - stronger - weaker)


def _prove_open(bounds: SampleBounds, brackets: GoverningBounds, values: Floats) -> None:
    """Solve samples (k, v) again that lack one of two bounds, and replace their bounds."""
    half_open = np.flatnonzero(np.isneginf(brackets.low) != np.isneginf(brackets.high))
    half_open = np.union1d(half_open, np.flatnonzero(np.isposinf(brackets.low) != np.isposinf(brackets.high)))
    if len(half_open) and bounds.batched:
        proven = bounds.proven(values[half_open])
        brackets.low[half_open], brackets.high[half_open] = proven.low, proven.high


# Probability of unseen failures, over that of known ones, that the spread of samples is chosen for
_SHARE: Final = 0.05

_SPREADS: Final = (1.05, 4.0)  # least and largest spread of the samples

_NEAR: Final = 0.85  # share of the distance of a design point from which on failures in its direction belong to it

# Factor on the share of unexplained samples: some lie beyond known design points too, some regions have corners
_DOUBT: Final = 2.0

_BELOW_HALF: Final = 0.4  # largest share and probability taken there: the quantile of one half is 0

_SEARCHES: Final = 60  # largest number of searches for a design point

_VAIN: Final = 5  # number of searches in a row without a new design point after which no other one begins

_STREAM: Final = 1  # number that keeps these random numbers apart from those of the simulation


@dataclass(frozen=True)
class Exploration:
    """Design points of a layout, nearest first, and what they do not explain."""

    points: tuple[Form, ...]
    unseen: float  # upper end of the confidence interval of failures away from them; 1 if unknown


def explore_failures(function: LimitFunction, first: Form, samples: int, seed: int, jobs: int) -> Exploration:
    """Find design points with samples of larger variance, from that of the first-order method."""
    # The result does not depend on `jobs`, the number of threads.
    points = [first] if first.found else []
    expected = first.probability if first.found else 1.0 / samples
    spread = _spread_for(_SHARE * expected, samples)
    failing = _failing(function, spread, samples, seed, jobs)
    tried = np.zeros(len(failing), dtype=bool)
    in_vain = 0
    for _ in range(_SEARCHES):
        unexplained = np.flatnonzero(_beyond_design_points(failing, points) & ~tried)
        if not len(unexplained) or in_vain == _VAIN:
            break
        start = unexplained[np.argmin((failing[unexplained] ** 2).sum(axis=1))]
        tried[start] = True
        form = design_point(function, failing[start])
        new = form.found and form.beta > 0.0 and bool(_beyond_design_points(form.point[None], points)[0])
        points += [form] if new else []
        in_vain = 0 if new else in_vain + 1
    count = int(_beyond_design_points(failing, points).sum())
    share = min(1.0, _DOUBT * exact_interval(count, 0, samples)[1])
    return Exploration(tuple(sorted(points, key=lambda point: point.beta)), _unseen_probability(share, spread))


def _unseen_probability(share: float, spread: float) -> float:
    """Return the probability of a half-space that holds a share of the samples."""
    # a half-space at distance b holds Φ(−b/spread) of the samples and the probability Φ(−b)
    return float(ndtr(spread * ndtri(share))) if share < 0.5 else share


def _spread_for(probability: float, samples: int) -> float:
    """Return the spread at which `_unseen_probability` of samples without an unexplained failure is a probability."""
    share = min(_BELOW_HALF, _DOUBT * exact_interval(0, 0, samples)[1])
    return float(np.clip(ndtri(min(probability, _BELOW_HALF)) / ndtri(share), *_SPREADS))


def _failing(function: LimitFunction, spread: float, samples: int, seed: int, jobs: int) -> Floats:
    """Return the samples (k, v) in standard normal space, multiplied by the spread, that do not surely hold."""
    variables = function.variables

    def part(number: int) -> Floats:
        count = min(batch_solver.SAMPLES_OF_A_CALL, samples - number * batch_solver.SAMPLES_OF_A_CALL)
        dice = np.random.default_rng([seed, number, _STREAM])
        points = spread * dice.standard_normal((count, len(variables)))
        fails, open_, _ = decided(function.bounds, function.required, variables.values(points))
        return np.asarray(points[fails | open_])

    return np.concatenate(in_threads(part, -(-samples // batch_solver.SAMPLES_OF_A_CALL), jobs))


def _beyond_design_points(samples: Floats, points: list[Form]) -> np.ndarray:
    """Return a mask (k,) of the samples (k, v) that lie beyond no design point."""
    if not points or not len(samples):
        return np.ones(len(samples), dtype=bool)
    centres = np.array([point.point for point in points])
    return np.asarray((samples @ centres.T < _NEAR * (centres**2).sum(axis=1)).all(axis=1))


SAMPLES: Final = 100_000  # default number of samples

# Relative difference by which a failing sample must be nearer to the means than the design point to replace it
_NEARER: Final = 1e-3


@dataclass(frozen=True)
class ReliabilityOptions:
    required: float = 1.0  # governing load factor below which the structure fails
    samples: int = SAMPLES
    seed: int = 0
    jobs: int = 1  # threads; they change no result

    def __post_init__(self) -> None:
        if not 0.0 < self.required < float("inf"):
            raise ParameterError("required", f"{self.required:g} is no load factor to be carried", "a number above 0")
        if self.samples < 1:
            raise ParameterError("samples", f"{self.samples} is no number of samples", "a whole number from 1")
        if self.seed < 0:
            raise ParameterError("seed", f"{self.seed} is negative", "a whole number from 0")
        if self.jobs < 1:
            raise ParameterError("jobs", f"{self.jobs} is no number of threads", "a whole number from 1")


@dataclass(frozen=True)
class Reliability:
    variables: Variables  # random variables of the structure
    form: Form  # result of the first-order method
    simulation: MonteCarlo  # result of the simulation
    # design points of several mechanisms, nearest first, around which rare failures are sampled
    points: tuple[Form, ...]
    options: ReliabilityOptions  # options of both

    @property
    def design_values(self) -> Floats | None:
        """Values (v,) of the variables at the design point; None where there is none."""
        return self.variables.values(self.form.point) if self.form.found else None

    def to_json(self) -> dict[str, Any]:
        form, simulation, names = self.form, self.simulation, self.variables.names
        alpha = form.direction.tolist() if form.found else [None] * len(names)
        values = self.design_values
        return {
            "beta_form": form.beta if form.found else None,
            "beta_monte_carlo": simulation.beta,
            "failures": simulation.failures,
            "samples": simulation.samples,
            "required": self.options.required,
            "seed": self.options.seed,
            "probability_form": form.probability if form.found else None,
            "probability": simulation.probability,
            "probability_interval": list(simulation.interval),
            "beta_interval": list(simulation.beta_interval),
            "confidence": CONFIDENCE,
            "importance_sampling": simulation.importance,
            "unseen": simulation.unseen,
            "mechanisms": [{"beta": point.beta, "probability": point.probability} for point in self.points],
            "resolved": simulation.resolved,
            "undecided": simulation.undecided,
            "form": {"iterations": form.steps, "kink": form.kink, "problem": form.problem or None},
            "design_point": None if values is None else dict(zip(names, values.tolist(), strict=True)),
            "importance": dict(zip(names, alpha, strict=True)),
            "variables": [
                {"name": name, "kind": "lognormal" if log else "normal", "mean": mean, "standard_deviation": deviation}
                for name, log, mean, deviation in zip(
                    names,
                    self.variables.lognormal.tolist(),
                    self.variables.mean.tolist(),
                    self.variables.deviation.tolist(),
                    strict=True,
                )
            ],
        }


def structure_of(scene: Scene, assembly: Assembly, labels: Bits) -> RandomStructure:
    """Return the random structure of a scene; InputError for models that samples do not have."""
    if scene.cracks != "faces":
        raise InputError("cracks", "reliability supports cracks by faces only", '"faces"')
    structure = random_structure(scene)
    if len(labels) != len(structure.assembly.interfaces) or len(assembly.elements) != len(structure.assembly.elements):
        raise InputError("search.void", "reliability supports whole structures only", "a scene without cells left out")
    return structure


def analyse(structure: RandomStructure, labels: Bits, options: ReliabilityOptions) -> Reliability:
    """Compute the reliability of a layout (m,) by the first-order method and by simulation."""
    bounds = SampleBounds(structure, labels)
    function = LimitFunction(bounds, options.required)
    return estimate(function, structure.variables, options)


def estimate(function: LimitFunction, variables: Variables, options: ReliabilityOptions) -> Reliability:
    """Estimate the probability of failure, by samples weighed at the design points."""
    # where failures are rare other design points are searched for, and what they leave unseen counts at the upper end
    samples, seed, jobs = options.samples, options.seed, options.jobs
    form = design_point(function)
    points: tuple[Form, ...] = (form,) if form.found else ()
    unseen = 0.0
    if is_rare(points, samples) or form.far:
        explored = explore_failures(function, form, max(1, samples // 2), seed, jobs)
        points, unseen = explored.points, explored.unseen
        form = points[0] if points else form
    simulation = simulate(function.bounds, function.required, samples, seed, jobs, points, unseen)
    nearest = simulation.nearest
    if nearest is not None and (not form.found or np.linalg.norm(nearest) < (1.0 - _NEARER) * form.beta):
        other = design_point(function, nearest)
        if other.found and (not form.found or other.beta < form.beta):
            form = other
    return Reliability(variables, form, simulation, points, options)
