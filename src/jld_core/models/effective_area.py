"""Resist torsion on the effective area of dry rectangles, by fixed-point iteration.

A rectangle with centre of pressure x is replaced by the largest rectangle centred at x: sides l_i − 2|x_i|, torsion
length c_T of that rectangle, torsion MT about x. This yield set is not convex, so x is frozen at the previous iterate
until it no longer changes. Proofs hold for the problem with x frozen. Source: Iannuzzo et al. 2024, eq. (5) and (8).
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import ParameterError
from jld_core.geometry.polygons import rectangle_torsion_length
from jld_core.limit import LimitAnalysis, Motion, Proof, Prover, State, Status, number, relative_width
from jld_core.mechanics.prescribed_friction import EffectiveAreas, PrescribedFriction
from jld_core.program import Template
from jld_core.solvers import ClarabelSolver

_FAINT = 1e-5
"""Scaled N below which x tends to zero: M / N is computed as M N / (N² + _FAINT²)."""

_STEPS = 5
"""Number of steps towards larger λ before the forces are held by the proximal term `HOLD`."""

_SLACK = 1e-8
"""Limit of the scaled slack requested of the next state; the limit grows to five times this value."""

_NARROW = 1e-6
"""Least side of an effective rectangle, relative to the side of the face."""

_RAYS = 8
"""Number of rays tried, each under the effective areas of the one before."""

_OPENINGS = (1e-9, 1e-6, 1e-3)
"""Shares of an opening motion that are added to an instability, relative to its largest velocity."""

_SAME = 1e-12
"""Largest change of the effective areas that the last projection of a ray may cause, relative."""

HOLD: Final = 30.0
"""Weight of the proximal term that holds the forces while effective areas converge."""


def require_rectangles(assembly: Assembly, labels: Bits) -> None:
    """Raise InputError for a planar scene, dry faces without any rectangle, or dry cohesion."""
    if assembly.dimension == 2:
        raise ParameterError("effective_area", "the scene is planar", "a spatial scene")
    odd = np.flatnonzero(labels & ~assembly.interfaces.rectangle)
    if odd.size and odd.size == np.count_nonzero(labels):
        problem = f"dry face {assembly.pair(odd[0])} is no rectangle, nor is any other"
        raise ParameterError("effective_area", problem, "a scene with dry rectangles")
    stuck = np.flatnonzero(labels & (assembly.strengths.cohesion > 0.0))
    if stuck.size:
        problem = f"dry face {assembly.pair(stuck[0])} has cohesion"
        raise ParameterError("effective_area", problem, "friction alone, which acts where N does")


def areas_under(assembly: Assembly, forces: Floats, labels: Bits) -> EffectiveAreas:
    """Compute the effective areas of dry rectangles under given forces.

    Parameters
    ----------
    assembly : Assembly
        Spatial assembly.
    forces : (m, 6) float array
        Scaled forces N, V1, V2, M1, M2, MT.
    labels : (m,) bool array
        Labels, True = dry.

    Returns
    -------
    EffectiveAreas
        Ratio c_T / c_T,e and arm x / c_T of each face. Inner faces, faces without compression and faces that are
        not rectangles keep the whole face.

    Notes
    -----
    Source: docs/method.md (2.14), (2.15).
    """
    faces = assembly.interfaces
    labels = labels & faces.rectangle
    # M1 is scaled by l2 / 2 and M2 by l1 / 2, so x1 and x2 below are relative to l1 / 2 and l2 / 2.
    share = np.where(labels, forces[:, 0] / (forces[:, 0] ** 2 + _FAINT**2), 0.0)
    x1 = np.clip(-forces[:, 4] * share, -1.0, 1.0)
    x2 = np.clip(forces[:, 3] * share, -1.0, 1.0)
    side1 = faces.l1 * np.maximum(1.0 - np.abs(x1), _NARROW)
    side2 = faces.l2 * np.maximum(1.0 - np.abs(x2), _NARROW)
    ratio = np.where(labels, faces.c_t / rectangle_torsion_length(side1, side2), 1.0)
    arm = np.column_stack([0.5 * faces.l2 * x2, -0.5 * faces.l1 * x1]) / faces.c_t[:, None]
    return EffectiveAreas(ratio, arm)


def change(old: EffectiveAreas, new: EffectiveAreas) -> float:
    """Compute the largest change of effective areas between two iterates.

    Parameters
    ----------
    old : EffectiveAreas
        Previous iterate.
    new : EffectiveAreas
        Current iterate.

    Returns
    -------
    float
        Largest change of c_T,e / c_T and of a = x / c_T over all faces.
    """
    ratio = np.abs(1.0 / old.ratio - 1.0 / new.ratio).max(initial=0.0)
    return float(max(ratio, np.abs(old.arm - new.arm).max(initial=0.0)))


def frozen_areas(template: Template, areas: EffectiveAreas) -> Template:
    """Build the template of associative friction with torsion about given effective areas.

    Parameters
    ----------
    template : Template
        Template of the assembly with whole faces.
    areas : EffectiveAreas
        Effective areas to freeze.

    Returns
    -------
    Template
        Template with the same equilibrium, and yield sets with the effective areas.
    """
    base = template.yield_set.associative
    none = np.zeros(len(template.assembly.interfaces))
    return template.renumbered(PrescribedFriction(base, 1.0, none, areas))


def under_own_areas(prover: Prover, state: State, labels: Bits) -> tuple[State, EffectiveAreas, Prover]:
    """Evaluate a state under the effective areas of its own forces.

    prover: of any template of the assembly. Return the state, the effective areas, and a prover with these areas
    frozen.
    """
    areas = areas_under(prover.template.assembly, state.forces, labels)
    frozen = prover.under(frozen_areas(prover.template, areas))
    return frozen.state(np.append(state.forces.ravel(), state.load), labels, passes=1), areas, frozen


def slack_to_ask(own: State, margin: float, tries: int) -> float:
    """Compute the slack to request of the next state, after a state of insufficient slack.

    own: the state under the effective areas of its own forces. margin: least slack. tries: number of states so far; the
    limit of the slack grows with this number. The result is twice the violation, within these limits.
    """
    return min(max(margin, -2.0 * own.slack), _SLACK * min(1 + tries // 5, 5))


def prove_effective_area(
    analysis: LimitAnalysis, labels: Bits, *, stands: bool = False, most: int = 60, weight: float = 1e-2
) -> Proof:
    """Prove the load factor with effective areas, at a fixed point of x and c_T,e.

    analysis: of a spatial assembly with dry rectangles. labels: (m,) True dry. stands: also decide λ = 0 (with whole
    faces). most: maximum number of programs solved. weight: of the proximal term that keeps x from jumping between
    equally good states.

    The forces lie within the effective areas that result from them; `extra["effective_area"]["fixed_point"]` is the
    remaining change. The bracket is that of the problem with those areas frozen. A change above 1e-8 leaves the
    result uncertified.

    Locked needs a ray within the effective areas that result from the ray itself: as λ grows, the areas approach those.

    Raise InputError for planar scenes, without any dry rectangle, or with cohesion on a dry face.
    """
    start = time.perf_counter()
    require_rectangles(analysis.assembly, labels)
    plain = analysis.prove(labels, stands=stands)
    if plain.state is None or plain.status is Status.UNSTABLE:
        falling = plain.collapse_below_zero or plain.motion
        if plain.status is Status.UNSTABLE and not (falling and _falls(analysis, labels, falling)):
            plain = replace(plain, status=Status.UNCERTIFIED, collapse_below_zero=None, motion=None, stands=None)
        return replace(plain, extra={**plain.extra, "effective_area": None})
    state, proof, moved, solves = _iterate(analysis, labels, plain.state.forces.ravel(), most, weight)
    if state.admissible and moved <= tolerances.FIXED_POINT:
        proof.state = state
        narrow = relative_width(proof.low, proof.high, analysis.floor) <= analysis.gap
    else:
        narrow = False
    if proof.status is Status.COLLAPSE and not narrow:
        proof.status = Status.UNCERTIFIED
    if proof.status is Status.UNSTABLE:
        # without forces there is no fixed point: other areas may hold what the last ones do not
        proof.status, proof.collapse_below_zero = Status.UNCERTIFIED, None
    if proof.status is Status.LOCKED:
        settled = state.admissible and moved <= tolerances.FIXED_POINT
        proof.ray = ray_under_own_areas(analysis, labels, proof.ray) if settled else None
        proof.status = Status.UNCERTIFIED if proof.ray is None else Status.LOCKED
    return replace(
        proof,
        notes=[*proof.notes, *_notes(analysis, labels, plain, proof)],
        stands=plain.stands,
        solves=plain.solves + solves,
        route=[*plain.route, f"effective area ({solves})"],
        seconds=time.perf_counter() - start,
        extra={
            "effective_area": {"fixed_point": moved, "frozen": True},
            "load_factor_whole_faces": number(plain.load_factor * analysis.template.scaling.load),
        },
    )


def _falls(analysis: LimitAnalysis, labels: Bits, motion: Motion) -> bool:
    """Is there an instability whatever areas are pressed: a motion, or that and a little opening of all joints?"""
    opening = analysis.repair.opening()
    for share in (0.0, *_OPENINGS):
        tried = motion
        if share:
            if opening is None:
                return False
            size = float(abs(motion.velocity).max()) / float(abs(opening.velocity).max())
            velocity = motion.velocity + share * size * opening.velocity
            tried = analysis.prover.motion(velocity, labels, normalise=False)
        gains = tried.margin >= 0.0 and tried.work >= min(0.0, motion.work)
        if (
            gains
            and tried.bound < -max(tolerances.ROUNDING, tried.noise)
            and falls_for_any_areas(analysis, labels, tried)
        ):
            return True
    return False


def falls_for_any_areas(analysis: LimitAnalysis, labels: Bits, motion: Motion) -> bool:
    """Return True if the jumps of a motion have finite dissipation wherever dry rectangles are pressed.

    With N at x a face opens by δ + θ·x and slips by s + ω × x there, and no effective area twists about more than c_T:
    δ_x ≥ μ max(|s_x|, c_T |ω|) is convex in x and holds everywhere if it holds at the corners. Faces that crush count
    as they do under whole areas only if they do not twist.
    """
    faces, jumps = analysis.assembly.interfaces, motion.jumps
    friction = analysis.template.yield_set.associative.friction_of(labels)
    turned = np.abs(jumps[:, 5])
    crushes = np.isfinite(analysis.assembly.strengths.crush_dry)
    concerned = labels & faces.rectangle & (turned > 0.0)
    for one in (-1.0, 1.0):
        for two in (-1.0, 1.0):
            opening = jumps[:, 0] + two * jumps[:, 3] - one * jumps[:, 4]
            first = jumps[:, 1] - two * 0.5 * faces.l2 / faces.c_t * jumps[:, 5]
            second = jumps[:, 2] + one * 0.5 * faces.l1 / faces.c_t * jumps[:, 5]
            lacks = opening < friction * np.maximum(np.hypot(first, second), turned)
            if np.any(concerned & (lacks | crushes)):
                return False
    return True


def ray_under_own_areas(analysis: LimitAnalysis, labels: Bits, ray: State | None) -> State | None:
    """Find forces that carry ever more live load within the effective areas they ask for; None if none is found.

    analysis: of whole faces. labels: (m,) True dry. ray: to begin with, under any areas.
    """
    for _ in range(_RAYS):
        if ray is None:
            return None
        areas = areas_under(analysis.assembly, ray.forces, labels)
        frozen = analysis.under(frozen_areas(analysis.template, areas), labels)
        own = frozen.prover.ray(np.append(ray.forces.ravel(), 1.0), labels)
        if own.to_rounding and change(areas, areas_under(analysis.assembly, own.forces, labels)) <= _SAME:
            return own
        ray = frozen.repair.ray(labels)
    return None


def _notes(analysis: LimitAnalysis, labels: Bits, plain: Proof, proof: Proof) -> list[str]:
    """Write sentences on faces that keep their whole area, and on the increase of λ."""
    found = []
    odd = int(np.count_nonzero(labels & ~analysis.assembly.interfaces.rectangle))
    if odd:
        found.append(f"{odd} of {int(labels.sum())} dry faces are no rectangles and keep their whole area in torsion")
    whole, own = plain.load_factor, proof.load_factor
    if math.isfinite(whole) and math.isfinite(own) and own - whole > analysis.gap * max(abs(whole), analysis.floor):
        more = (own - whole) / max(abs(whole), analysis.floor)
        found.append(
            f"λ with effective areas is {more:.1%} above that of whole faces: "
            "shear at the centre of pressure, not at the centroid, is what twists a face"
        )
    return found


def _iterate(
    analysis: LimitAnalysis, labels: Bits, forces: Floats, most: int, weight: float
) -> tuple[State, Proof, float, int]:
    """Iterate on forces and areas until they agree: `_STEPS` free steps, then held steps.

    Return a state, the proof with the areas frozen, the remaining change of areas, and the number of programs solved.
    """
    template, count = analysis.template, analysis.template.matrix.shape[1]
    margin, residual = template.precision.margin, template.precision.residual
    stepping, holding = (ClarabelSolver(residual, proximal=(count, w)) for w in (weight, HOLD))
    areas = areas_under(analysis.assembly, forces.reshape(-1, 6), labels)
    prover = analysis.prover.under(frozen_areas(template, areas))
    solves, steps, slack, moved = 0, 0, margin, np.inf
    while True:
        route = stepping if steps < _STEPS else holding
        point = route.solve(prover.template.program(labels, slack), forces).point
        solves, steps = solves + 1, steps + 1
        state = prover.state(point, labels, passes=3)
        own, asked, prover = under_own_areas(prover, state, labels)
        moved, areas = change(areas, asked), asked
        forces = state.forces.ravel()
        slack = slack_to_ask(own, margin, steps)
        settled = own.admissible and (moved <= tolerances.FIXED_POINT or steps > _STEPS)
        if settled or solves >= most:
            proof = analysis.under(prover.template, labels).prove(labels)
            solves += proof.solves
            if not settled:
                return own, proof, moved, solves
            left = change(areas, areas_under(analysis.assembly, own.forces, labels))
            low, high = own.load, proof.bracket[1]
            if solves >= most or not high - low > analysis.gap * max(abs(high), abs(low)):
                return own, proof, left, solves
            steps = 0
