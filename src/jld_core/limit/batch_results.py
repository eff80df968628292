"""Use the batch solver's answer for a single labelling, after the core has checked it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.batch.batch_solver import LOCKED, BatchResults
from jld_core.limit.bounds import Motion, Prover
from jld_core.limit.proof import Proof

FACES_WHERE_BATCH_IS_FASTER: Final = (48, 400)
"""Least and largest number of faces of a spatial assembly for which the batch solver is faster for one labelling.

Its setup is included. Source: benchmarks/results/batch_solver_single.md.
"""


def offer_results(
    found: BatchResults, labels: Bits, proof: Proof, prover: Prover, opening: Callable[[], Motion | None]
) -> None:
    """Check the batch solver's bounds of one labelling, and add the valid ones to a proof."""
    if found.forces is None:
        return
    if np.isfinite(found.low[0]):
        proof.offer_state(prover.state(np.append(found.forces[0], found.low[0]), labels))
    if found.verdict[0] == LOCKED and found.rays is not None:
        ray = prover.ray(np.append(found.rays[0], 1.0), labels)
        proof.ray = ray if prover.is_ray(ray) else proof.ray
    elif found.velocity is not None and found.velocity[0].any():
        motion = prover.motion(found.velocity[0], labels)
        wider = opening() if motion.margin < 0.0 else None
        proof.offer_motion(motion if wider is None else prover.add_opening(motion, wider, labels))
