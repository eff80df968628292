"""Cheap lower bound without dilation: λ with friction frozen at the least N, iterated."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.limit import LimitAnalysis
from jld_core.mechanics.prescribed_friction import PrescribedFriction
from jld_core.models.zero_dilation.lower_bound_problem import LowerBoundProblem
from jld_core.models.zero_dilation.modes import LinearModes
from jld_core.models.zero_dilation.statics import Statics

_ROUNDS: Final = 8
"""Maximum number of iterations."""


def frozen_friction(
    analysis: LimitAnalysis, labels: Bits, modes: LinearModes, normals: Ints, size: Floats, ceiling: LowerBoundProblem
) -> float:
    """Return a proven lower bound, scaled, 0 if none is found.

    normals: (m,) columns of N. size: see `Statics.size`. Every solution has the λ of its own frozen friction, which
    grows with N. Each iteration freezes friction at the least N of states with λ above the last bound. Its bound is
    the proven lower end of a bracket.
    """
    base, bound, none = analysis.template.yield_set.associative, 0.0, np.zeros(len(modes.rows), dtype=bool)
    for turn in range(1, _ROUNDS + 1):
        statics = Statics(modes, bound, ceiling.above(bound), none, size)
        least = np.array([statics.least(row) for row in np.eye(len(size))[normals]])
        template = analysis.template.renumbered(PrescribedFriction(base, 0.0, least))
        proof = LimitAnalysis(analysis.assembly, template=template, gap=analysis.gap, reference=labels).prove(labels)
        ceiling.programs += len(normals) + proof.solves
        if not ceiling.won(bound, proof.low):
            break
        bound = proof.low
        ceiling.note(f"frozen friction {turn}")
        if ceiling.met(bound):
            break
    return bound
