"""What a mechanism does at every face: jumps, and the movement they amount to (docs/method.md (3.1)).

m interfaces, n elements, d = 2 or 3, q resultants per interface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.limit.result import LimitAnalysisResult
from jld_core.mechanics import equilibrium_matrix

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
    moving = assembly.elements.support & mechanism.any(axis=1)
    if moving.any():
        # supports that settle
        assembly = replace(assembly, elements=replace(assembly.elements, support=assembly.elements.support & ~moving))
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
