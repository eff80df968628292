"""Cheap lower bound without dilation: λ under friction frozen at the least normal forces."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.limit import LimitAnalysis
from jld_core.mechanics.prescribed_friction import PrescribedFriction
from jld_core.models.zero_dilation.lower_bound_problem import LowerBoundProblem
from jld_core.models.zero_dilation.modes import LinearModes
from jld_core.models.zero_dilation.statics import Statics

_ROUNDS: Final = 8  # maximum number of iterations


def frozen_friction_bound(
    analysis: LimitAnalysis,
    labels: Bits,
    modes: LinearModes,
    normals: Ints,
    force_bounds: Floats,
    problem: LowerBoundProblem,
) -> float:
    """Prove a lower bound on λ by freezing friction at the least normal force of each face.

    A solution is the optimum of the problem whose friction is frozen at its own normal forces N, and this optimum grows
    with N. Each iteration computes the least N of all states with λ above the last bound, and freezes friction there.
    The proven lower bound on λ of that problem is the next bound.

    analysis: of the assembly. labels: (m,) True = dry. modes: complementarity problem. normals: (m,) columns of N in F.
    force_bounds: (q + 2,), see `Statics.force_bounds`. problem: lowest solution found, time budget and log, updated.
    The result is scaled, and 0 if no bound is proven.
    """
    base, bound, none = analysis.template.yield_set.associative, 0.0, np.zeros(len(modes.rows), dtype=bool)
    for turn in range(1, _ROUNDS + 1):
        statics = Statics(modes, bound, problem.interval_end(bound), none, force_bounds)
        least = np.array([statics.least(row) for row in np.eye(len(force_bounds))[normals]])
        template = analysis.template.renumbered(PrescribedFriction(base, 0.0, least))
        proof = LimitAnalysis(analysis.assembly, template=template, gap=analysis.gap, reference=labels).prove(labels)
        problem.programs += len(normals) + proof.solves
        if not problem.gains_enough(bound, proof.low):
            break
        bound = proof.low
        problem.record(f"frozen friction {turn}")
        if problem.closes_gap(bound):
            break
    return bound
