"""A path through solutions without dilation: from the lowest to higher ones, every state on the way a solution.

All forces with y = 0 where one mechanism moves are solutions with that mechanism, and they are convex: from one to
another of them a straight line of solutions runs, along which λ changes. Where no forces carry more, another
mechanism of the same state takes over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import LimitAnalysis
from jld_core.arrays import Bits, Floats
from jld_core.models.zero_dilation.fixed_point_search import ProximalOptions
from jld_core.models.zero_dilation.multi_start_search import MultiStartSearch

_LEGS: Final = 60  # mechanisms tried at the most
_IDLE: Final = 20  # in a row that carry no more


@dataclass(frozen=True)
class SolutionPath:
    """Corners of a path: forces (k, m, q) in scene units, λ (k,), and how far along, Σ |ΔN| over the dead load (k,)."""

    forces: Floats
    load_factors: Floats
    along: Floats


def path_of_solutions(analysis: LimitAnalysis, labels: Bits, seed: int = 0) -> SolutionPath | None:
    """From the lowest λ that is found upwards; None where nothing is found, or rows are not linear.

    analysis: planar, without crushing. labels: (m,) True dry.
    """
    side = MultiStartSearch(analysis, labels, ProximalOptions(), analysis.prove(labels))
    lowest = side.search().lowest
    if lowest is None or side.alternation is None:
        return None
    points = side.alternation.ascending_path(
        np.append(lowest.state.forces.ravel(), lowest.state.load), seed, _LEGS, _IDLE
    )
    scaling = analysis.template.scaling
    forces = np.array([point[:-1].reshape(scaling.face.shape) * scaling.face for point in points])
    steps = abs(np.diff(forces[:, :, 0], axis=0)).sum(axis=1)
    weight = analysis.assembly.total_dead or 1.0
    loads = np.array([point[-1] for point in points]) * scaling.load
    return SolutionPath(forces, loads, np.concatenate([[0.0], np.cumsum(steps)]) / weight)
