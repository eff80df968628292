"""What the compiled batch solver says of labellings, held against the core's own prover and its own way to λ."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from jld_core import LimitAnalysis, Status, tolerances
from jld_core.arrays import Bits, Floats
from jld_core.batch.batch_solver import FALLS, LOCKED, OPEN, PROVEN, BatchResults, BatchSolver

LAST_DIGITS = 1e-9
"""What may separate two sums of the same dissipation, relative."""


def lanes_of(analysis: LimitAnalysis, variant: str | None = None, **keys: object) -> BatchSolver:
    """The batch solver for an analysis, as the analysis itself makes it; variant: see `BatchSolver`."""
    opening = analysis.repair.opening()
    velocity = None if opening is None else opening.velocity
    return BatchSolver(analysis.template, velocity, load_scale=analysis.load_scale, variant=variant, **keys)


def assert_proven(
    analysis: LimitAnalysis, asked: Bits, found: BatchResults, digits: float = LAST_DIGITS, snap: float = 0.0
) -> None:
    """Every bound of labellings (k, m) by the core's own prover, every verdict by `LimitAnalysis.prove`.

    digits: how near the prover's sum of a dissipation must be, relative. snap: what rounding may make of a margin,
    beside the fastest velocity, and friction where that is above 1. At the least this is `tolerances.EXACT`: both sums
    of a jump are rounded, in another order. That the exact margin is not negative is tested by `exact_margin`.
    """
    floor = 1e-3 * analysis.assembly.total_dead / analysis.assembly.total_live / analysis.template.scaling.load
    assert found.forces is not None
    assert found.velocity is not None
    for k, labels in enumerate(asked):
        proof = analysis.prove(labels)
        if np.isfinite(found.low[k]):
            state = analysis.prover.state(np.append(found.forces[k].ravel(), found.low[k]), labels, held=True)
            near = abs(state.load - found.low[k]) <= 1e-9 * max(1.0, abs(found.low[k]))
            assert (state.admissible and near) or exact(analysis, found.forces[k], found.low[k], labels)
        if np.isfinite(found.high[k]):
            motion = analysis.prover.motion(found.velocity[k], labels)
            # where joints cannot all open, jumps that must be zero are so but for rounding
            confined = analysis.repair.opening() is None
            rough = max(1.0, float(analysis.template.yield_set.associative.friction_of(labels).max()))
            least = max(snap, tolerances.EXACT, 1e-12 * confined) * rough
            assert motion.margin >= -least * abs(motion.velocity).max()
            # what falls may move the live load by next to nothing, which the bound is divided by
            near = max(digits, 1e-9 * confined, 1e-8 * (found.verdict[k] == FALLS))
            assert motion.bound == pytest.approx(found.high[k], rel=near, abs=1e-12)
        if found.verdict[k] == FALLS:
            assert proof.status is Status.UNSTABLE
        elif found.verdict[k] == LOCKED:
            assert proof.status in (Status.LOCKED, Status.UNCERTIFIED)
            ray = analysis.prover.ray(np.append(found.rays[k].ravel(), 1.0), labels)
            assert ray.slack >= -tolerances.ROUNDING
            assert ray.error <= tolerances.ROUNDING
            assert np.isfinite(found.low[k])
            assert np.isinf(found.high[k])
        elif found.verdict[k] == PROVEN:
            assert proof.status is Status.COLLAPSE
            size = max(abs(proof.low), floor)
            assert found.low[k] <= proof.high + 1e-9 * size + 1e-15
            assert found.high[k] >= proof.low - 1e-9 * size - 1e-15
            around = floor if found.low[k] <= 0.0 <= found.high[k] else 0.0
            assert found.high[k] - found.low[k] <= 1e-6 * max(abs(found.low[k]), abs(found.high[k]), around)
        else:
            assert found.verdict[k] == OPEN


def exact_margin(analysis: LimitAnalysis, velocity: Floats, labels: Bits) -> Fraction:
    """Least margin δ − μ|s| − |θ|/bending of planar faces that do not crush, without any rounding, scaled.

    velocity: (3·free,) as returned. Every number of the equilibrium matrix counts as it is stored.
    """
    matrix, sets = analysis.template.matrix.tocsc(), analysis.template.yield_set.associative
    exactly = [Fraction(value) for value in velocity.tolist()]
    data, rows, start = [Fraction(value) for value in matrix.data.tolist()], matrix.indices, matrix.indptr
    jumps = [
        sum((data[k] * exactly[rows[k]] for k in range(start[column], start[column + 1])), Fraction(0))
        for column in range(matrix.shape[1])
    ]
    friction, slides = sets.friction_of(labels), sets.active(labels)[:, 1]
    margins = []
    for face, dry in enumerate(labels.tolist()):
        opening, slip, turn = jumps[3 * face : 3 * face + 3]
        rub = Fraction(float(friction[face])) * abs(slip) if slides[face] else Fraction(0)
        margins.append(opening - rub - abs(turn) / (1 if dry else 3))
    return min(margins)


def exact(analysis: LimitAnalysis, forces: Floats, load: float, labels: Bits) -> bool:
    """Whether forces meet all equations and rows to rounding, at the edge of sets that leave them no room."""
    template = analysis.template
    flat = np.where(template.yield_set.active(labels), forces, 0.0).ravel()
    left = template.matrix @ flat + template.dead + load * template.live
    met = abs(template.matrix) @ abs(flat) + abs(template.dead) + abs(load * template.live)
    largest = max(1.0, float(abs(flat).max()))
    slack = template.yield_set.slack(flat.reshape(forces.shape), labels)
    return bool((abs(left) <= 2e-12 * met + 1e-15 * largest).all() and (slack >= -2e-12 * largest).all())
