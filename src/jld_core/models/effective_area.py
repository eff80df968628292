"""Resist torsion on the effective area of dry rectangles: forces optimal where frozen at their own areas.

Central paths find such forces, and a proximal iteration where they do not; proofs hold for the frozen problem. Source:
Iannuzzo et al. 2024, eq. (5) and (8); docs/method.md (2.14) to (2.18).
"""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import replace
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import ParameterError
from jld_core.limit import Motion, Proof, State, number, relative_width
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.options import Status
from jld_core.mechanics.prescribed_friction import EffectiveAreas
from jld_core.models.central_path import FixedPoint, areas_under, find_fixed_point, frozen_areas, under_own_areas
from jld_core.solvers import ClarabelSolver
from jld_core.strengths import ADHESION, STANDARD, Route

_ROUTE: Final = Route("effective areas", STANDARD - ADHESION)
_STEPS = 5  # number of steps towards larger λ before the forces are held by the proximal term `HOLDING_WEIGHT`
_SLACK = 1e-8  # limit of the scaled slack requested of the next state; the limit grows to five times this value
_RAYS = 8  # number of rays tried, each under the effective areas of the one before

# Scaled λ along a ray, added to forces under whole faces, at which forces within their own areas are sought
_ALONG = (1.0, 1e2, 1e4)

# Shares of an opening motion that are added to an instability, relative to its largest velocity
_OPENINGS = (1e-9, 1e-6, 1e-3)
_SAME = 1e-12  # largest change of the effective areas that the last projection of a ray may cause, relative
HOLDING_WEIGHT: Final = 30.0  # weight of the proximal term that holds the forces while effective areas converge


def require_rectangles(assembly: Assembly, labels: Bits) -> None:
    """Raise InputError if effective areas do not apply to a labelling of an assembly."""
    # Effective areas do not apply to planar scenes, to dry faces of which none is a rectangle, and to dry faces with
    # a bond.
    if assembly.dimension == 2:
        raise ParameterError("effective_area", "the scene is planar", "a spatial scene")
    if assembly.members.bond is not None:
        raise ParameterError("effective_area", "dry faces have tensile strength", "joints without it")
    irregular = np.flatnonzero(labels & ~assembly.interfaces.rectangle)
    if irregular.size and irregular.size == np.count_nonzero(labels):
        problem = f"dry face {assembly.pair(irregular[0])} is no rectangle, nor is any other"
        raise ParameterError("effective_area", problem, "a scene with dry rectangles")
    assembly.strengths(_ROUTE, labels)  # refuses what it does not know


def largest_area_change(old: EffectiveAreas, new: EffectiveAreas) -> float:
    """Compute the largest change of c_T,e / c_T and of a = x / c_T over all faces, between two iterates."""
    return float(_changes(old, new).max(initial=0.0))


def _changes(old: EffectiveAreas, new: EffectiveAreas) -> Floats:
    """Return the largest change (m,) of c_T,e / c_T or a = x / c_T of each face between two iterates."""
    ratio = np.abs(1.0 / old.ratio - 1.0 / new.ratio)
    return np.asarray(np.maximum(ratio, np.abs(old.arm - new.arm).max(axis=1)))


def slack_to_request(under_own: State, margin: float, tries: int) -> float:
    """Return the scaled slack to request in the yield rows of the next state."""
    return min(max(margin, -2.0 * under_own.slack), _SLACK * min(1 + tries // 5, 5))


def prove_effective_area(
    analysis: LimitAnalysis, labels: Bits, *, stands: bool = False, most: int = 60, weight: float = 1e-2
) -> Proof:
    """Prove λ with torsion on effective areas, docs/method.md (2.14) to (2.16).

    Uncertified where the areas still change by more than 1e-8, or the bracket is wider than the gap. InputError: planar
    scene, no dry rectangle, or dry shear strength.
    """
    # The forces of the result lie within the effective areas that they cause themselves. The bracket is that of the
    # problem with those areas frozen; in general it does not bound λ of other such solutions. λ is proven unbounded by
    # a ray within the areas that the ray itself causes, since the areas approach those as λ grows.
    start = time.perf_counter()
    require_rectangles(analysis.assembly, labels)
    plain_proof = analysis.prove(labels, stands=stands)
    if plain_proof.state is None or plain_proof.status is Status.UNSTABLE:
        fall = plain_proof.collapse_below_zero or plain_proof.motion
        if plain_proof.status is Status.UNSTABLE and not (fall and _falls(analysis, labels, fall)):
            plain_proof = replace(
                plain_proof, status=Status.UNCERTIFIED, collapse_below_zero=None, motion=None, stands=None
            )
        return replace(plain_proof, extra={**plain_proof.extra, "effective_area": None})
    point = find_fixed_point(analysis, labels)
    facts: dict[str, Any] = {"fixed_point": 0.0, "frozen": True}
    solve_log: list[str] = []
    if point is not None:
        solve_log.append(f"central paths ({point.starts})")
        facts["starts"] = point.starts
    if point is not None and point.width <= analysis.gap:
        proof = _proof_of(analysis, labels, point)
    elif (locked := _prove_locked(analysis, labels, plain_proof)) is not None:
        proof = locked
        solve_log.append("ray within its own areas")
    else:
        proof, iterated = _proof_of_iteration(analysis, labels, plain_proof.state.forces.ravel(), most, weight)
        solve_log.append(f"effective area ({proof.solves})")
        if proof.status is Status.UNCERTIFIED and point is not None and point.width < iterated.get("above", math.inf):
            proof = replace(_proof_of(analysis, labels, point), solves=proof.solves)
            iterated = {"above": point.width}
        facts |= iterated
    return replace(
        proof,
        notes=[*proof.notes, *_notes(analysis, labels, plain_proof, proof)],
        stands=plain_proof.stands,
        solves=plain_proof.solves + proof.solves,
        solve_log=[*plain_proof.solve_log, *solve_log],
        seconds=time.perf_counter() - start,
        extra={
            "effective_area": facts,
            "load_factor_whole_faces": number(plain_proof.load_factor * analysis.template.scaling.load),
        },
    )


def _proof_of(analysis: LimitAnalysis, labels: Bits, fixed_point: FixedPoint) -> Proof:
    """Convert a fixed point to a proof at its areas; a wide bracket or other status becomes uncertified."""
    proof = Proof(state=fixed_point.state, motion=fixed_point.motion)
    frozen = analysis.with_template(fixed_point.prover.template, labels)
    proof.status = frozen.status_of(proof)
    if proof.status is not Status.COLLAPSE or frozen.is_open(proof):
        # other areas may hold what these do not: without forces above zero nothing is proven
        proof.status = Status.UNCERTIFIED
    return proof


def _prove_locked(analysis: LimitAnalysis, labels: Bits, plain_proof: Proof) -> Proof | None:
    """Prove that λ is unbounded, by a ray and forces within their own areas, or return None."""
    ray = ray_under_own_areas(analysis, labels, plain_proof.ray) if plain_proof.status is Status.LOCKED else None
    if ray is None or plain_proof.state is None:
        return None
    for load in _ALONG:
        forces = (plain_proof.state.forces + load * ray.forces).ravel()
        state = analysis.prover.state(np.append(forces, plain_proof.state.load + load), labels)
        under_own, _, _ = under_own_areas(analysis.prover, state, labels)
        if under_own.admissible:
            return Proof(state=under_own, ray=ray, status=Status.LOCKED)
    return None


def _proof_of_iteration(
    analysis: LimitAnalysis, labels: Bits, forces: Floats, max_solves: int, weight: float
) -> tuple[Proof, dict[str, Any]]:
    """Prove the load factor by the proximal iteration on forces and effective areas."""
    state, proof, changes, solves = _iterate(analysis, labels, forces, max_solves, weight)
    change = float(changes.max(initial=0.0))
    settled = state.admissible and change <= tolerances.FIXED_POINT
    facts: dict[str, Any] = {"fixed_point": change}
    if settled:
        proof.state = state
        width = relative_width(proof.low, proof.high, analysis.load_scale)
        if proof.status is Status.COLLAPSE and width > analysis.gap:
            facts["above"] = width  # the bracket is wider than asked for
    elif change > tolerances.FIXED_POINT:
        facts["face"] = analysis.assembly.pair(int(changes.argmax()))
    if proof.status is Status.COLLAPSE and (not settled or "above" in facts):
        proof.status = Status.UNCERTIFIED
    if proof.status is Status.UNSTABLE:
        # without forces there is no fixed point: other areas may hold what the last ones do not
        proof.status, proof.collapse_below_zero = Status.UNCERTIFIED, None
    if proof.status is Status.LOCKED:
        proof.ray = ray_under_own_areas(analysis, labels, proof.ray) if settled else None
        proof.status = Status.UNCERTIFIED if proof.ray is None else Status.LOCKED
    proof.solves = solves
    return proof, facts


def _falls(analysis: LimitAnalysis, labels: Bits, motion: Motion) -> bool:
    """Return whether a motion, opened a little if needed, proves a fall for any effective areas."""
    opening = analysis.repair.opening()
    for share in (0.0, *_OPENINGS):
        opened = motion
        if share:
            if opening is None:
                return False
            size = float(abs(motion.velocity).max()) / float(abs(opening.velocity).max())
            velocity = motion.velocity + share * size * opening.velocity
            opened = analysis.prover.motion(velocity, labels, normalise=False)
        admissible = opened.margin >= 0.0 and opened.work >= min(0.0, motion.work)
        if (
            admissible
            and opened.bound < -max(tolerances.ROUNDING, opened.noise)
            and valid_for_any_areas(analysis, labels, opened)
        ):
            return True
    return False


def valid_for_any_areas(analysis: LimitAnalysis, labels: Bits, motion: Motion) -> bool:
    """Return whether a motion opens dry rectangles enough, whatever their effective areas are."""
    # At a point x of a face the motion opens by δ_x and slips by s_x, and no effective area has a torsion length above
    # c_T. The condition δ_x ≥ μ max(|s_x|, c_T |ω|) is convex in x, so it holds everywhere if it holds at the corners
    # of all dry rectangles. A dry rectangle that can crush must not twist. Other faces are not tested.
    faces, jumps = analysis.assembly.interfaces, motion.jumps
    friction = analysis.template.yield_set.associative.friction_of(labels)
    twist = np.abs(jumps[:, 5])
    crushes = np.isfinite(analysis.assembly.strengths(_ROUTE, labels).side(dry=True).crush)
    twisting = labels & faces.rectangle & (twist > 0.0)
    # corner (x1, x2) in halves of the sides l1, l2; rotations are scaled by half-sides, the twist by c_T
    for x1, x2 in itertools.product((-1.0, 1.0), repeat=2):
        opening = jumps[:, 0] + x2 * jumps[:, 3] - x1 * jumps[:, 4]
        slip1 = jumps[:, 1] - x2 * 0.5 * faces.l2 / faces.c_t * jumps[:, 5]
        slip2 = jumps[:, 2] + x1 * 0.5 * faces.l1 / faces.c_t * jumps[:, 5]
        violates = opening < friction * np.maximum(np.hypot(slip1, slip2), twist)
        if np.any(twisting & (violates | crushes)):
            return False
    return True


def ray_under_own_areas(analysis: LimitAnalysis, labels: Bits, ray: State | None) -> State | None:
    """Find a ray of forces within the effective areas that these forces cause."""
    # Along the ray the live load grows without limit.
    for _ in range(_RAYS):
        if ray is None:
            return None
        areas = areas_under(analysis.assembly, ray.forces, labels)
        frozen = analysis.with_template(frozen_areas(analysis.template, areas), labels)
        frozen_ray = frozen.prover.ray(np.append(ray.forces.ravel(), 1.0), labels)
        if (
            analysis.prover.is_ray(frozen_ray)
            and largest_area_change(areas, areas_under(analysis.assembly, frozen_ray.forces, labels)) <= _SAME
        ):
            return frozen_ray
        ray = frozen.repair.ray(labels)
    return None


def _notes(analysis: LimitAnalysis, labels: Bits, plain_proof: Proof, proof: Proof) -> list[str]:
    """List sentences on dry faces that are no rectangles, and on an increase of λ."""
    sentences = []
    irregular = int(np.count_nonzero(labels & ~analysis.assembly.interfaces.rectangle))
    if irregular:
        count = int(labels.sum())
        sentences.append(f"{irregular} of {count} dry faces are no rectangles and keep their whole area in torsion")
    with_whole, with_areas = plain_proof.load_factor, proof.load_factor
    if (
        math.isfinite(with_whole)
        and math.isfinite(with_areas)
        and with_areas - with_whole > analysis.gap * max(abs(with_whole), analysis.load_scale)
    ):
        increase = (with_areas - with_whole) / max(abs(with_whole), analysis.load_scale)
        sentences.append(
            f"λ with effective areas is {increase:.1%} above that of whole faces: "
            "shear at the centre of pressure, not at the centroid, is what twists a face"
        )
    return sentences


def _iterate(
    analysis: LimitAnalysis, labels: Bits, forces: Floats, max_solves: int, weight: float
) -> tuple[State, Proof, Floats, int]:
    """Iterate from scaled forces (m, q) until areas belong to forces: state, proof, changes (m,), programs."""
    # `_STEPS` free steps come first, then steps that keep the forces near those before.
    template, count = analysis.template, analysis.template.matrix.shape[1]
    margin, residual = template.precision.margin, template.precision.residual
    moving_solver, holding_solver = (ClarabelSolver(residual, proximal=(count, w)) for w in (weight, HOLDING_WEIGHT))
    areas = areas_under(analysis.assembly, forces.reshape(-1, 6), labels)
    prover = analysis.prover.with_template(frozen_areas(template, areas))
    solves, steps, slack = 0, 0, margin
    while True:
        solver = moving_solver if steps < _STEPS else holding_solver
        point = solver.solve(prover.template.program(labels, slack), forces).point
        solves, steps = solves + 1, steps + 1
        state = prover.state(point, labels, passes=3)
        under_own, required_areas, prover = under_own_areas(prover, state, labels)
        changes, areas = _changes(areas, required_areas), required_areas
        forces = state.forces.ravel()
        slack = slack_to_request(under_own, margin, steps)
        settled = under_own.admissible and (changes.max(initial=0.0) <= tolerances.FIXED_POINT or steps > _STEPS)
        if settled or solves >= max_solves:
            proof = analysis.with_template(prover.template, labels).prove(labels)
            solves += proof.solves
            if not settled:
                return under_own, proof, changes, solves
            remaining_changes = _changes(areas, areas_under(analysis.assembly, under_own.forces, labels))
            low, high = under_own.load, proof.bracket[1]
            if solves >= max_solves or not high - low > analysis.gap * max(abs(high), abs(low)):
                return under_own, proof, remaining_changes, solves
            steps = 0
