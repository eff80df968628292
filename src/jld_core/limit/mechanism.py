"""What a mechanism does at every face, and whether it balances: jumps, flow rules, work (docs/method.md (3.1), (4.5)).

m interfaces, n elements, d = 2 or 3, q resultants per interface. Nothing here solves anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.limit.result import LimitAnalysisResult
from jld_core.mechanics import (
    Contact,
    InnerBending,
    PrescribedFriction,
    YieldSet,
    equilibrium_matrix,
    load_vectors,
    scaling_of,
    yield_set,
)

SMALL: Final = 0.01
"""Share of the largest movement of a mechanism below which a face counts as closed."""


class Movement(StrEnum):
    """What a face does in a mechanism. Cracks are of inner faces, the rest of dry ones; either may be closed."""

    CLOSED = "closed"
    HINGE = "hinge"
    SLIDE = "slide"
    OPEN = "open"
    TWIST = "twist"
    CRACK_TENSION = "crack in tension"
    CRACK_SHEAR = "crack in shear"


@dataclass(frozen=True)
class FaceMotion:
    """Movement of one face.

    kind; place: (d,) its hinge or its centroid; size: largest velocity jump at a corner, scene units.
    """

    kind: Movement
    place: Floats
    size: float


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


def displacement(assembly: Assembly, mechanism: Floats, element: int, points: Floats) -> Floats:
    """(k, d) velocities of points (k, d) that move with an element; mechanism: (n, q)."""
    d = assembly.dimension
    arm, motion = points - assembly.elements.centroid[element], mechanism[element]
    if d == 2:
        return np.asarray(motion[:2] + motion[2] * np.column_stack([-arm[:, 1], arm[:, 0]]))
    a, b, c = motion[3:]
    return np.asarray(motion[:3] + arm @ np.array([[0.0, c, -b], [-c, 0.0, a], [b, -a, 0.0]]))


def face_jumps(assembly: Assembly, mechanism: Floats) -> Floats:
    """(m, q) jumps J = A_eqᵀ u of a mechanism (n, q), scene units: (δ, s, θ) or (δ, s1, s2, θ1, θ2, ω)."""
    velocity = mechanism[assembly.elements.free].ravel()
    return np.asarray(equilibrium_matrix(assembly).T @ velocity).reshape(-1, assembly.freedoms)


def face_motions(result: LimitAnalysisResult) -> tuple[FaceMotion, ...]:
    """What each of the m faces does in the mechanism of a result.

    A dry face that opens everywhere beyond the dilation of its friction is open; of turning about an axis in
    the face, slipping and spinning about its normal the largest names the rest. An inner face that moves is a
    crack, in shear where it slips more than it opens.
    Raises ValueError where the result holds no mechanism.
    """
    if result.mechanism is None:
        raise ValueError("the result holds no mechanism")
    assembly, faces = result.assembly, result.assembly.interfaces
    jumps = face_jumps(assembly, result.mechanism)
    friction = np.nan_to_num(assembly.strengths.friction)
    dilates = friction if result.friction == "associative" else np.zeros(len(faces))
    parts = [_parts(assembly, result.mechanism, jumps, k) for k in range(len(faces))]
    size = np.array([max(abs(gap).max(), slip, spin) for gap, slip, spin in parts])
    least = SMALL * size.max(initial=0.0)
    motions = []
    for k, (gap, slip, spin) in enumerate(parts):
        turning, place = float(np.ptp(gap)), faces.origin[k]
        if size[k] <= least:
            kind = Movement.CLOSED
        elif not result.labels[k]:
            sheared = max(slip, spin) > gap.max()
            kind = Movement.CRACK_SHEAR if sheared else Movement.CRACK_TENSION
        elif gap.min() - dilates[k] * _rubbing(assembly, jumps, k) > 0.05 * size[k]:
            kind = Movement.OPEN
        elif turning >= max(slip, spin):
            kind = Movement.HINGE
            place = faces.polygon[k][gap <= gap.min() + 0.1 * turning].mean(axis=0)
        else:
            kind = Movement.TWIST if spin > slip else Movement.SLIDE
        motions.append(FaceMotion(kind, place, float(size[k])))
    return tuple(motions)


def _parts(assembly: Assembly, mechanism: Floats, jumps: Floats, face: int) -> tuple[Floats, float, float]:
    """Gaps (k,) at the corners of a face, slip at its centroid, and slip at its farthest corner by spin alone."""
    faces, polygon = assembly.interfaces, assembly.interfaces.polygon[face]
    jump = displacement(assembly, mechanism, int(faces.b[face]), polygon)
    jump = jump - displacement(assembly, mechanism, int(faces.a[face]), polygon)
    gap = jump @ faces.normal[face]
    if assembly.dimension == 2:
        return gap, float(abs(jumps[face, 1])), 0.0
    radius = float(np.linalg.norm(polygon - faces.origin[face], axis=1).max())
    return gap, float(np.hypot(jumps[face, 1], jumps[face, 2])), radius * float(abs(jumps[face, 5]))


def _rubbing(assembly: Assembly, jumps: Floats, face: int) -> float:
    """max(|s|, c_T |ω|), which dilates with μ under associative friction."""
    if assembly.dimension == 2:
        return float(abs(jumps[face, 1]))
    slip = float(np.hypot(jumps[face, 1], jumps[face, 2]))
    return max(slip, float(assembly.interfaces.c_t[face] * abs(jumps[face, 5])))


def yield_set_of(
    result: LimitAnalysisResult, inner_bending: InnerBending = "paper", contact: Contact | None = None
) -> YieldSet:
    """The yield set that a result's forces and mechanism answer to, scaled by `scaling_of` its assembly.

    Under zero dilation the friction is frozen at μN of the result's own forces. inner_bending, contact: what
    the run was given. Raises ValueError where friction is to be frozen and the result holds no forces.
    """
    assembly = result.assembly
    scaling = scaling_of(assembly)
    base = yield_set(assembly, scaling, inner_bending)
    none = np.zeros(len(assembly.interfaces))
    if result.friction == "associative":
        return base if contact is None else PrescribedFriction(base, 1.0, none, contact)
    if result.forces is None:
        raise ValueError("the result holds no forces")
    return PrescribedFriction(base, 0.0, result.forces[:, 0] / scaling.face[:, 0], contact)


def flow_rule(result: LimitAnalysisResult, sets: YieldSet | None = None) -> FlowRule:
    """How well every face obeys its flow rule: normality, without dilation where the result has none.

    sets: the yield set where `yield_set_of` does not know it. Raises ValueError without forces or mechanism.
    """
    forces, jumps = _scaled(result)
    sets = sets or yield_set_of(result)
    gap = sets.dissipation(jumps, result.labels) + np.einsum("ij,ij->i", forces, jumps)
    return FlowRule(sets.margin(jumps, result.labels), gap)


def work_balance(result: LimitAnalysisResult, sets: YieldSet | None = None) -> WorkBalance:
    """Power of the loads at λ_hi against what the faces dissipate. Arguments and errors as for `flow_rule`."""
    if result.mechanism is None:
        raise ValueError("the result holds no mechanism")
    assembly, scaling = result.assembly, scaling_of(result.assembly)
    sets = sets or yield_set_of(result)
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
