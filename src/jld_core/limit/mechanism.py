"""Jumps and kinds of movement of the faces in a mechanism (docs/method.md (3.1)), and the balance of work by face.

Shapes: m interfaces, n elements, d = 2 or 3 dimensions, q resultants per interface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly, faces_of
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.bounds import Prover, usable
from jld_core.limit.repair import Repair
from jld_core.limit.result import LimitAnalysisResult
from jld_core.mechanics import equilibrium_matrix, scaling_of, yield_set
from jld_core.program import Template
from jld_core.solvers import make_solver
from jld_core.strengths import CRITERIA, STANDARD, Route

_ROUTE: Final = Route("movements of faces", STANDARD | CRITERIA)
SMALL: Final = 0.01  # share of the largest movement of a mechanism below which a face counts as closed


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
    settling = assembly.elements.support & mechanism.any(axis=1)
    if settling.any():
        # Supports that settle have velocities of their own: count them as free.
        assembly = replace(assembly, elements=replace(assembly.elements, support=assembly.elements.support & ~settling))
    velocity = mechanism[assembly.elements.free].ravel()
    return np.asarray(equilibrium_matrix(assembly).T @ velocity).reshape(-1, assembly.freedoms)


def face_motions(result: LimitAnalysisResult) -> tuple[FaceMotion, ...]:
    """Classify the movement of each face (m,) in a mechanism; ValueError without one."""
    if result.mechanism is None:
        raise ValueError("the result holds no mechanism")
    assembly, faces = result.assembly, result.assembly.interfaces
    friction = np.nan_to_num(assembly.strengths(_ROUTE).friction)
    dilates = friction if result.friction == "associative" else np.zeros(len(faces))
    jumps = face_jumps(assembly, result.mechanism)
    kinds, size, gap = movements(assembly, result.labels, jumps[None], dilates)
    motions = []
    for k, kind in enumerate(kinds[0]):
        place, opening = faces.origin[k], gap[0, k, : len(faces.polygon[k])]
        if kind is Movement.HINGE:
            place = faces.polygon[k][opening <= opening.min() + _AT_HINGE * np.ptp(opening)].mean(axis=0)
        motions.append(FaceMotion(kind, place, float(size[0, k])))
    return tuple(motions)


_AT_HINGE: Final = 0.1  # share of the range of openings up to which corners lie at the hinge
_LIFTS: Final = 0.05  # share of its movement from which a face that opens everywhere counts as open


def movements(assembly: Assembly, labels: Bits, jumps: Floats, dilates: Floats) -> tuple[Any, Floats, Floats]:
    """Classify the movements of all faces in k mechanisms.

    Parameters
    ----------
    assembly : Assembly
        Structure with m interfaces.
    labels : (m,) bool array
        Labels, True = dry.
    jumps : (k, m, q) array
        Jumps as of `face_jumps`, any unit.
    dilates : (m,) or (k, m) array
        Opening of each dry face per slip: its friction coefficient, or 0 without dilation.

    Returns
    -------
    kinds : (k, m) array of Movement
        Kinds.
    size : (k, m) array
        Largest of the opening at the corners, the slip at the centroid and the slip by spin alone.
    gap : (k, m, c) array
        Opening at the corners, the last one repeated.
    """
    # A dry face is open if it opens everywhere by more than the dilation of its friction. Otherwise the largest of
    # rotation about an axis in the face (hinge), slip (slide) and spin about the normal (twist) names the movement. An
    # inner face that moves is a crack, in shear where it slips more than it opens. Slip is taken at the centroid, slip
    # by spin at the farthest corner. In space a face opens by μ max(|s|, c_T |ω|).
    faces, corner_count = assembly.interfaces, max(map(len, assembly.interfaces.polygon), default=1)
    corners = np.array([polygon[np.minimum(np.arange(corner_count), len(polygon) - 1)] for polygon in faces.polygon])
    arm = corners.reshape(len(faces), corner_count, -1) - faces.origin[:, None]
    x = np.einsum("mcd,md->mc", arm, faces.e1)
    if assembly.dimension == 2:
        gap = jumps[..., 0, None] - jumps[..., 2, None] * x
        slip, spin_slip, friction_slip = abs(jumps[..., 1]), np.zeros(jumps.shape[:2]), abs(jumps[..., 1])
    else:
        y = np.einsum("mcd,md->mc", arm, faces.e2)
        gap = jumps[..., 0, None] + jumps[..., 3, None] * y - jumps[..., 4, None] * x
        slip, spin = np.hypot(jumps[..., 1], jumps[..., 2]), abs(jumps[..., 5])
        spin_slip = np.linalg.norm(arm, axis=2).max(axis=1) * spin
        friction_slip = np.maximum(slip, faces.c_t * spin)
    shear = np.maximum(slip, spin_slip)
    size = np.maximum(abs(gap).max(axis=2, initial=0.0), shear)
    cracks = np.where(shear > gap.max(axis=2, initial=-np.inf), Movement.CRACK_SHEAR, Movement.CRACK_TENSION)
    slides = np.where(
        np.ptp(gap, axis=2) >= shear, Movement.HINGE, np.where(spin_slip > slip, Movement.TWIST, Movement.SLIDE)
    )
    lift = gap.min(axis=2, initial=np.inf) - dilates * friction_slip
    if criteria := assembly.face_strengths.criteria:  # these state no friction: their rows say what is dilation
        margin = _margin(assembly, labels, jumps)
        stated = np.logical_or.reduce([criterion.faces for criterion in criteria])
        lift = np.where(stated & np.isfinite(margin), margin, lift)
    opens = lift > _LIFTS * size
    kinds = np.where(labels, np.where(opens, Movement.OPEN, slides), cracks)
    smallest = SMALL * size.max(axis=1, initial=0.0)[:, None]
    kinds = np.where(size <= smallest, Movement.CLOSED, kinds)
    return np.array([Movement(kind) for kind in kinds.ravel()], dtype=object).reshape(size.shape), size, gap


def _margin(assembly: Assembly, labels: Bits, jumps: Floats) -> Floats:
    """Return by how much jumps (k, m, q) open beyond what forces without end allow (k, m), scene units."""
    faces, ones = assembly.interfaces, np.ones(len(assembly.interfaces))
    lever = [faces.l1 / 2.0] if assembly.dimension == 2 else [faces.l2 / 2.0, faces.l1 / 2.0, faces.c_t]
    scaled = jumps * np.column_stack([*[ones] * assembly.dimension, *lever])
    return np.asarray(yield_set(assembly, scaling_of(assembly)).margin(scaled, labels))


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
        patterns = np.zeros(labellings.shape)
        for k, velocity in enumerate(velocities):
            if usable(velocity):
                size = abs(self._prover.motion(velocity, labellings[k], normalise=False).jumps).max(axis=1)
                patterns[k] = size / max(float(size.max()), 1e-300)
        return patterns


def result_of_faces(result: LimitAnalysisResult) -> LimitAnalysisResult:
    """Return a result whose interfaces, labels and forces are those of faces, not of members."""
    # Figures and tables of faces use it. A result without members is returned as it is.
    assembly = faces_of(result.assembly)
    if assembly is result.assembly:
        return result
    rows = slice(assembly.faces)
    forces = None if result.forces is None else result.forces[rows]
    unbounded = None if result.unbounded_forces is None else result.unbounded_forces[rows]
    return replace(
        result,
        assembly=assembly,
        labels=result.labels[rows],
        forces=forces,
        unbounded_forces=unbounded,
        cases={name: result_of_faces(values) for name, values in result.cases.items()},
    )


# Violation of a margin, relative to the largest jump, up to which a small opening motion repairs it
_TINY: Final = 1e-6


@dataclass(frozen=True)
class WorkBalance:
    """Work balances λ · work ≤ total of k mechanisms, for all labellings that agree where decided."""

    # (k, q·free) mechanisms, scaled: q velocities of each free element, with the opening motion that repairs rounding
    # errors
    velocities: Floats
    work: Floats  # (k,) work of the live load, scaled
    # (k,) dissipation minus work of the dead load, plus a bound on rounding errors, scaled; valid where `sound` is True
    total: Floats
    sound: Bools  # (k,) True where the dissipation is finite and the work not negative
    # labelled, larger: (k, m) dissipation of each face, scaled, or inf: under its label, and the larger one of both
    # labels; equal for undecided faces
    labelled: Floats
    larger: Floats


class WorkBalances:
    def __init__(self, template: Template, prover: Prover, repair: Repair) -> None:
        self.template, self._prover, self._repair = template, prover, repair

    def balance(self, velocities: Floats, labels: Bits, undecided: Bools, *, from_earlier: bool = False) -> WorkBalance:
        """Compute the work balances of k mechanisms; undecided faces dissipate the larger value of both labels."""
        # Margins that only rounding violates are opened: under either label of all faces, as decided faces may become
        # undecided; or where the label occurs, if the mechanisms are `from_earlier` balances, which leaves them
        # as they are.
        repairable = np.array([undecided | labels, undecided | ~labels]) if from_earlier else np.True_
        velocities, jumps, margin = self._opened(velocities, repairable)
        dissipation = np.where(margin >= 0.0, self._measured(jumps, margins=False), np.inf)
        larger = dissipation.max(axis=0)
        labelled = np.where(undecided, larger, np.where(labels, dissipation[0], dissipation[1]))
        # Sum row by row: the rounding of a matrix product depends on the number of rows.
        powers = velocities * self.template.live
        work = powers.sum(axis=1)
        # A remainder of cancelling terms gives no bound.
        work[abs(work) < tolerances.ROUNDING * abs(powers).sum(axis=1)] = 0.0
        total = labelled.sum(axis=1) - (velocities * self.template.dead).sum(axis=1)
        sound = np.isfinite(total) & (work >= 0.0)
        total = np.where(sound, total, 0.0)
        total += self._prover.noises(velocities, total)
        return WorkBalance(velocities, work, total, sound, labelled, larger)

    def _measured(self, jumps: Floats, *, margins: bool) -> Floats:
        """Compute margins, or dissipation, of scaled jumps (k, m, q): (2, k, m), all dry, then all inner."""
        sets, faces = self.template.yield_set, jumps.shape[1]
        measure = sets.margin if margins else sets.dissipation
        all_dry = np.ones(faces, dtype=bool)
        if self.template.assembly.dimension == 2:
            return np.array([measure(jumps, all_dry), measure(jumps, ~all_dry)])
        values = [[measure(jump, labels) for jump in jumps] for labels in (all_dry, ~all_dry)]
        return np.array(values).reshape(2, *jumps.shape[:2])

    def _opened(self, velocities: Floats, repairable: Bools | np.bool) -> tuple[Floats, Floats, Floats]:
        """Add an opening motion where margins `repairable` (2, k, m) are negative by rounding alone."""
        jumps = self._prover.jumps(velocities)
        margin = self._measured(jumps, margins=True)
        opening = self._repair.opening()
        rounding = _TINY * np.maximum(abs(jumps).max(axis=(1, 2)), 1e-300)
        small = repairable & (margin < 0.0) & (margin > -rounding[None, :, None])
        lack = np.where(small, -margin, 0.0).max(axis=(0, 2))
        rows = np.flatnonzero(lack > 0.0)
        if opening is None or not rows.size:
            return velocities, jumps, margin
        velocities = velocities.copy()
        velocities[rows] += (1.01 * lack[rows] / opening.margin)[:, None] * opening.velocity
        jumps[rows] = self._prover.jumps(velocities[rows])
        margin[:, rows] = self._measured(jumps[rows], margins=True)
        return velocities, jumps, margin


@dataclass(frozen=True)
class DualBound:
    """Mechanism whose work balance refutes a λ for every labelling that agrees on the decided faces."""

    excess: float  # threshold · b_λ·u + b·u − Σ D, scaled, rounding deducted; positive (docs/method.md (6.4))
    cost: Floats  # (m,) reduction of the excess if a face becomes undecided, scaled; inf where no bound remains
    # λ that no such labelling exceeds, scaled; −inf where none is admissible at any λ. In the unit of the governing
    # factor if it comes from `CaseRelaxation`.
    bound: float
    velocity: Floats  # (q·free,) the mechanism, scaled
    case: int = 0  # index of the load case of the mechanism


@dataclass(frozen=True)
class MinimizedConflict:
    """Result of minimising the conflict of a labelling, or of one of its neighbours."""

    labelling: int  # index of the requested labelling
    drawn: bool  # True for the labelling itself, False for a neighbour
    decided: Bools  # (m,) faces whose labels are part of the conflict
    # scaled λ that no labelling with these labels exceeds; −inf where none is admissible at any λ. None where nothing
    # refuted it. In the unit of the governing factor if it comes from `CaseRelaxation`.
    bound: float | None
    carries: bool = False  # True if the forces found carry more than the threshold
    velocity: Floats | None = None  # (q·free,) mechanism that refuted the labelling, scaled
    case: int = 0  # index of the load case of the mechanism
