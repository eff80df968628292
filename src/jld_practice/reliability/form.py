"""First-order reliability method by the iteration of Hasofer, Lind, Rackwitz, Fiessler."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import ndtr

from jld_core import Floats, one_thread
from jld_core.limit import LimitAnalysis, Proof, Status
from jld_core.mechanics import FrictionSet
from jld_core.scene import standard
from jld_practice.reliability.structure import SampleBounds

_STEPS: Final = 60  # largest number of iterations

_HALVINGS: Final = 3  # largest number of halvings of a step along one gradient, and along several

# Largest number of targets of one step at a kink; every one that fails adds the gradients that it met
_TRIALS: Final = 6

_KEPT: Final = 24  # largest number of gradients kept for a kink: the latest ones

# Distance between points, over the larger of 1 and |u|, up to which their gradients belong to one kink
_NEAR: Final = 0.3

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
        """Return value and gradient by the values (v,) of the variables themselves."""
        found: list[tuple[float, Floats | None]] = []
        for case, asked in enumerate(self.bounds.structure.assembly.required.tolist()):
            analysis, proof = self.bounds.solved(values, case)
            value, rates = self._of_case(analysis, proof, values, case)
            found.append((value / asked, None if rates is None else rates / asked))
        value, rates = min(found, key=lambda one: math.inf if math.isnan(one[0]) else one[0])
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
    frictions = [one for one in standard.PARAMETERS if one.side == "friction"]
    found = {one.field: np.where(labels == (one.label == "dry"), slip, 0.0) for one in frictions}
    for name, values in sets.numbers.stresses.items():
        step = np.where(np.isfinite(values), _DIFFERENCE * np.maximum(values, 1.0), 0.0)
        ends = [
            sets.with_strengths(replace(sets.numbers, **{name: values + sign * step})).dissipation(jumps, labels)
            for sign in (0.0, 1.0)
        ]
        found[name] = np.where(step > 0.0, (ends[1] - ends[0]) / np.where(step > 0.0, step, 1.0), 0.0)
    return found


class _Iteration:
    """Iteration for the design point, with the gradients that it met."""

    def __init__(self, function: LimitFunction, point: Floats) -> None:
        self.function, self.point, self.reach = function, point, function.variables.reach
        self.met: list[tuple[Floats, Limit]] = []
        self.here = self.limit(point)

    def limit(self, point: Floats) -> Limit:
        """Return the limit function at a point, and keep its gradient."""
        found = self.function.at(point)
        if math.isfinite(found.distance):
            self.met = [*self.met, (point, found)][-_KEPT:]
        return found

    def nearest(self, around: bool) -> Floats:
        """Return the point (v,) nearest to the means where linearised limit functions are ≤ 0."""
        reach = _NEAR * max(1.0, float(np.linalg.norm(self.point)))
        chosen = [(self.point, self.here)]
        if around:
            chosen += [(at, one) for at, one in self.met if np.linalg.norm(at - self.point) <= reach]
        slopes = np.array(
            [one.gradient / np.linalg.norm(one.gradient) for _, one in chosen if one.gradient is not None]
        )
        sides = np.array([slope @ at - one.distance for slope, (at, one) in zip(slopes, chosen, strict=True)])
        found = _least_distance(slopes, sides) if around else None
        point = np.asarray(sides[0] * slopes[0]) if found is None else found
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


def _close(one: Floats, other: Floats) -> bool:
    """Return whether two points are equal to the accuracy of a design point."""
    return float(np.linalg.norm(one - other)) <= _POINT * max(1.0, float(np.linalg.norm(other)))


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
    rest = system @ nnls(system, last)[0] - last
    return None if abs(rest[-1]) <= _SURFACE else np.asarray(-rest[:-1] / rest[-1])


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
            return Form(math.nan, work.point, number, True, "no step leads nearer to the failure surface")
    return Form(math.nan, work.point, _STEPS, True, f"no design point after {_STEPS} steps")


def _found(work: _Iteration, steps: int, inside: bool, kink: bool) -> Form:
    """Return the result of a converged iteration; β < 0 if the structure fails at the means."""
    size = float(np.linalg.norm(work.point))
    return Form(-size if inside else size, work.point, steps, kink)
