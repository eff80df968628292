"""What a mechanism owes, taken from a result alone: flow rules and works (docs/method.md (3.1), (4.5)).

m interfaces, q resultants per interface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core import LimitAnalysisResult
from jld_core.arrays import Floats
from jld_core.limit.mechanism import face_jumps
from jld_core.mechanics import YieldSet, load_vectors, scaling_of, yield_set
from jld_core.mechanics.prescribed_friction import PrescribedFriction


@dataclass(frozen=True)
class FlowRule:
    """How far each face's jump and force are from its flow rule, both (m,), scaled; 0 is exact.

    margin: least slack of the conditions on the jump (δ ≥ bending + dilation), negative where violated.
    gap: D(J) + F·J ≥ 0, zero where the force works as much as any admissible force could.
    """

    margin: Floats
    gap: Floats


@dataclass(frozen=True)
class WorkBalance:
    """Powers of a mechanism, scene units: of the loads at the upper end of the bracket, and dissipated."""

    external: float
    dissipated: float
    size: float

    @property
    def error(self) -> float:
        """|external − dissipated| over the largest of the powers that make them up."""
        return abs(self.external - self.dissipated) / self.size if self.size > 0.0 else 0.0


def _yield_set(result: LimitAnalysisResult) -> YieldSet:
    """The yield set that a result's forces and mechanism answer to, scaled by `scaling_of` its assembly.

    Under zero dilation the friction is frozen at μN of the result's own forces.
    """
    scaling = scaling_of(result.assembly)
    base = yield_set(result.assembly, scaling, result.model.inner_bending)
    if result.friction == "associative":
        return base
    if result.forces is None:
        raise ValueError("the result holds no forces")
    return PrescribedFriction(base, 0.0, result.forces[:, 0] / scaling.face[:, 0])


def flow_rule(result: LimitAnalysisResult) -> FlowRule:
    """How well every face obeys its flow rule: normality, without dilation where the result has none.

    Raises ValueError without forces or mechanism.
    """
    forces, jumps = _scaled(result)
    sets = _yield_set(result)
    gap = sets.dissipation(jumps, result.labels) + np.einsum("ij,ij->i", forces, jumps)
    return FlowRule(sets.margin(jumps, result.labels), gap)


def work_balance(result: LimitAnalysisResult) -> WorkBalance:
    """Power of the loads at λ_hi against what the faces dissipate. Raises ValueError without a mechanism."""
    if result.mechanism is None:
        raise ValueError("the result holds no mechanism")
    assembly, scaling = result.assembly, scaling_of(result.assembly)
    sets = _yield_set(result)
    velocity = result.mechanism[assembly.elements.free].ravel()
    dead, live = load_vectors(assembly)
    pushed, carried = float(result.bracket[1] * (live @ velocity)), float(dead @ velocity)
    jumps = face_jumps(assembly, result.mechanism) * scaling.face
    dissipated = float(sets.dissipation(jumps, result.labels).sum())
    return WorkBalance(pushed + carried, dissipated, max(abs(pushed), abs(carried), abs(dissipated)))


def _scaled(result: LimitAnalysisResult) -> tuple[Floats, Floats]:
    """Scaled forces (m, q), and jumps (m, q) dual to them: their product is a power in scene units over none."""
    if result.mechanism is None or result.forces is None:
        raise ValueError("the result holds no mechanism" if result.mechanism is None else "no forces")
    scaling = scaling_of(result.assembly)
    jumps = face_jumps(result.assembly, result.mechanism) * scaling.face
    return result.forces / scaling.face, jumps
