"""Reliability of one layout: first-order method and simulation side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.special import ndtr, ndtri

from jld_core import Assembly, Bits, Floats, InputError, ParameterError, Scene
from jld_core.batch import batch_solver
from jld_practice.reliability.monte_carlo import (
    CONFIDENCE,
    Form,
    LimitFunction,
    MonteCarlo,
    decided,
    design_point,
    exact_interval,
    in_threads,
    is_rare,
    simulate,
)
from jld_practice.reliability.structure import RandomStructure, SampleBounds, Variables, random_structure

# Probability of unseen failures, over that of known ones, that the spread of samples is chosen for
_SHARE: Final = 0.05

_SPREADS: Final = (1.05, 4.0)  # least and largest spread of the samples

_NEAR: Final = 0.85  # share of the distance of a design point from which on failures in its direction belong to it

# Factor on the share of unexplained samples: some lie beyond known design points too, some regions have corners
_DOUBT: Final = 2.0

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
    vain = 0
    for _ in range(_SEARCHES):
        left = np.flatnonzero(_unexplained(failing, points) & ~tried)
        if not len(left) or vain == _VAIN:
            break
        start = left[np.argmin((failing[left] ** 2).sum(axis=1))]
        tried[start] = True
        form = design_point(function, failing[start])
        new = form.found and form.beta > 0.0 and bool(_unexplained(form.point[None], points)[0])
        points += [form] if new else []
        vain = 0 if new else vain + 1
    count = int(_unexplained(failing, points).sum())
    share = min(1.0, _DOUBT * exact_interval(count, 0, samples)[1])
    unseen = float(ndtr(spread * ndtri(share))) if share < 0.5 else share
    return Exploration(tuple(sorted(points, key=lambda one: one.beta)), unseen)


def _spread_for(probability: float, samples: int) -> float:
    """Return the spread at which samples without an unexplained failure leave a probability unseen at most."""
    share = min(0.4, _DOUBT * exact_interval(0, 0, samples)[1])
    return float(np.clip(ndtri(min(probability, 0.4)) / ndtri(share), *_SPREADS))


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


def _unexplained(samples: Floats, points: list[Form]) -> np.ndarray:
    """Return a mask (k,) of the samples (k, v) that lie beyond no design point."""
    if not points or not len(samples):
        return np.ones(len(samples), dtype=bool)
    centres = np.array([one.point for one in points])
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
    """Reliability of one layout by both methods."""

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
            "mechanisms": [{"beta": one.beta, "probability": one.probability} for one in self.points],
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
