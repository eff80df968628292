"""Search for several design points, and a bound on failures away from all of them.

Samples of larger variance fail where rare mechanisms do. Each that no known design point explains starts a search for
another one. What stays unexplained bounds the probability that was not seen, docs/method.md (12.9).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtr, ndtri

from jld_core.arrays import Floats
from jld_core.batch.batch_solver import SAMPLES_OF_A_CALL
from jld_practice.reliability.form import Form, LimitFunction, design_point
from jld_practice.reliability.monte_carlo import decided, exact_interval, in_threads

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
    """Design points of a layout, nearest first, and what they do not explain.

    unseen: upper end of the confidence interval of the probability of failures away from them; 1 if unknown.
    """

    points: tuple[Form, ...]
    unseen: float


def explore_failures(function: LimitFunction, first: Form, samples: int, seed: int, jobs: int) -> Exploration:
    """Find design points with samples of larger variance; first: result of the first-order method from the means.

    The result does not depend on `jobs`, the number of threads.
    """
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
        count = min(SAMPLES_OF_A_CALL, samples - number * SAMPLES_OF_A_CALL)
        dice = np.random.default_rng([seed, number, _STREAM])
        points = spread * dice.standard_normal((count, len(variables)))
        fails, open_, _ = decided(function.bounds, function.required, variables.values(points))
        return np.asarray(points[fails | open_])

    return np.concatenate(in_threads(part, -(-samples // SAMPLES_OF_A_CALL), jobs))


def _unexplained(samples: Floats, points: list[Form]) -> np.ndarray:
    """Return a mask (k,) of the samples (k, v) that lie beyond no design point."""
    if not points or not len(samples):
        return np.ones(len(samples), dtype=bool)
    centres = np.array([one.point for one in points])
    return np.asarray((samples @ centres.T < _NEAR * (centres**2).sum(axis=1)).all(axis=1))
