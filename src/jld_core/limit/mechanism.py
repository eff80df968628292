"""Jumps and kinds of movement of the faces in a mechanism (docs/method.md (3.1)).

Shapes: m interfaces, n elements, d = 2 or 3 dimensions, q resultants per interface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly, faces_of
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.bounds import usable
from jld_core.limit.result import LimitAnalysisResult
from jld_core.mechanics import equilibrium_matrix
from jld_core.solvers import make_solver
from jld_core.strengths import CRITERIA, STANDARD, Route

_ROUTE: Final = Route("movements of faces", STANDARD | CRITERIA)

SMALL: Final = 0.01
"""Share of the largest movement of a mechanism below which a face counts as closed."""


class Movement(StrEnum):
    """Movement of a face: crack (inner), hinge, slide, open or twist (dry), or closed."""

    CLOSED = "closed"
    HINGE = "hinge"
    SLIDE = "slide"
    OPEN = "open"
    TWIST = "twist"
    CRACK_TENSION = "crack in tension"
    CRACK_SHEAR = "crack in shear"


@dataclass(frozen=True)
class FaceMotion:
    """Movement of one face in a mechanism."""

    kind: Movement
    place: Floats  # (d,) position of the hinge, or the centroid of the face, scene units
    # largest of the opening at the corners, the slip at the centroid and the slip by spin alone, scene units
    size: float


def displacement(assembly: Assembly, mechanism: Floats, element: int, points: Floats) -> Floats:
    """Compute the velocities of points that move with an element.

    Parameters
    ----------
    assembly : Assembly
        The structure.
    mechanism : (n, q) float array
        Velocities about the centroids, scene units.
    element : int
        Index of the element.
    points : (k, d) float array
        Positions of the points, scene units.

    Returns
    -------
    (k, d) float array
        Velocities of the points.
    """
    d = assembly.dimension
    arm, motion = points - assembly.elements.centroid[element], mechanism[element]
    if d == 2:
        return np.asarray(motion[:2] + motion[2] * np.column_stack([-arm[:, 1], arm[:, 0]]))
    a, b, c = motion[3:]
    return np.asarray(motion[:3] + arm @ np.array([[0.0, c, -b], [-c, 0.0, a], [b, -a, 0.0]]))


def face_jumps(assembly: Assembly, mechanism: Floats) -> Floats:
    """Compute the velocity jumps J = A_eqᵀ u of all faces in a mechanism.

    See docs/method.md (3.1).

    Parameters
    ----------
    assembly : Assembly
        Structure.
    mechanism : (n, q) array
        Velocities about the centroids, scene units; supports may move.

    Returns
    -------
    (m, q) array
        Jumps (δ, s, θ) or (δ, s1, s2, θ1, θ2, ω), scene units.
    """
    moving = assembly.elements.support & mechanism.any(axis=1)
    if moving.any():
        # Supports that settle have velocities of their own: count them as free.
        assembly = replace(assembly, elements=replace(assembly.elements, support=assembly.elements.support & ~moving))
    velocity = mechanism[assembly.elements.free].ravel()
    return np.asarray(equilibrium_matrix(assembly).T @ velocity).reshape(-1, assembly.freedoms)


def face_motions(result: LimitAnalysisResult) -> tuple[FaceMotion, ...]:
    """Classify the movement of each face (m,) in a mechanism; ValueError without one."""
    # A dry face is open if it opens everywhere by more than the dilation of its friction. Otherwise the largest of
    # rotation about an axis in the face (hinge), slip (slide) and spin about the normal (twist) names the movement. An
    # inner face that moves is a crack, in shear where it slips more than it opens.
    if result.mechanism is None:
        raise ValueError("the result holds no mechanism")
    assembly, faces = result.assembly, result.assembly.interfaces
    jumps = face_jumps(assembly, result.mechanism)
    friction = np.nan_to_num(assembly.strengths(_ROUTE).friction)
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
    """Compute the opening (k,) at the corners of a face, its slip, and its slip by spin alone."""
    # Slip is taken at the centroid, slip by spin at the farthest corner; in the plane the latter is 0.
    faces, polygon = assembly.interfaces, assembly.interfaces.polygon[face]
    jump = displacement(assembly, mechanism, int(faces.b[face]), polygon)
    jump = jump - displacement(assembly, mechanism, int(faces.a[face]), polygon)
    gap = jump @ faces.normal[face]
    if assembly.dimension == 2:
        return gap, float(abs(jumps[face, 1])), 0.0
    radius = float(np.linalg.norm(polygon - faces.origin[face], axis=1).max())
    return gap, float(np.hypot(jumps[face, 1], jumps[face, 2])), radius * float(abs(jumps[face, 5]))


def _rubbing(assembly: Assembly, jumps: Floats, face: int) -> float:
    """Return the slip that opens a face μ times as wide, max(|s|, c_T |ω|), or |s| in the plane."""
    if assembly.dimension == 2:
        return float(abs(jumps[face, 1]))
    slip = float(np.hypot(jumps[face, 1], jumps[face, 2]))
    return max(slip, float(assembly.interfaces.c_t[face] * abs(jumps[face, 5])))


# Residual requested from the solver where there is no batch solver; a heuristic needs no more digits
_RESIDUAL: Final = 1e-8


class Movements:
    """Movements of all faces at collapse for many labellings: hints for searches, nothing proven."""

    def __init__(self, analysis: LimitAnalysis) -> None:
        self.template, self._prover = analysis.template, analysis.prover
        self._batch = analysis.batch
        self._solver = make_solver("clarabel", tolerance=_RESIDUAL)

    def of(self, labellings: Bits) -> Floats:
        """Compute the jump of each face over the largest, (k, m); zero where no mechanism is found."""
        if self._batch is not None:
            velocities = self._batch.solve(labellings, vectors=True).velocities
        else:
            rows = self.template.matrix.shape[0]
            velocities = np.array([self._solver.solve(self.template.program(row)).dual[:rows] for row in labellings])
        found = np.zeros(labellings.shape)
        for k, velocity in enumerate(velocities):
            if usable(velocity):
                size = abs(self._prover.motion(velocity, labellings[k], normalise=False).jumps).max(axis=1)
                found[k] = size / max(float(size.max()), 1e-300)
        return found


def result_of_faces(result: LimitAnalysisResult) -> LimitAnalysisResult:
    """Return a result whose interfaces, labels and forces are those of faces, not of members."""
    # Figures and tables of faces use it. A result without members is returned as it is.
    assembly = faces_of(result.assembly)
    if assembly is result.assembly:
        return result
    rows = slice(assembly.faces)
    forces, unbounded = (None if one is None else one[rows] for one in (result.forces, result.unbounded_forces))
    return replace(
        result,
        assembly=assembly,
        labels=result.labels[rows],
        forces=forces,
        unbounded_forces=unbounded,
        cases={name: result_of_faces(one) for name, one in result.cases.items()},
    )
