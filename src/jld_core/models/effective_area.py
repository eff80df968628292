"""Torsion about the effective area of dry rectangles, by iteration (Iannuzzo et al. 2024, eq. 5 and 8).

A rectangle pressed at x is taken as the largest rectangle about x: sides l_i − 2|x_i|, c_T of that, and MT about
x. The set is not convex; x is frozen from the iterate before, until it no longer changes. What is proven is
proven for the frozen problem.
"""

from __future__ import annotations

import copy
import time
from dataclasses import dataclass, replace

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.geometry import rectangle_torsion_length
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, State, Status, number, relative_width
from jld_core.mechanics import Contact, PlanarYield, PrescribedFriction, SpatialYield
from jld_core.program import Template
from jld_core.solvers import ProximalSolver

_PRESSED = 1e-5  # scaled N below which x goes to zero, as the MN / (N² + this²) that stands for M / N
_STEPS = 5  # steps towards larger λ before the forces are held
_HOLD = 30.0  # weight of the proximal term while effective areas settle
_SHY = 1e-8  # slack asked of a state so that it fits the effective areas of its own forces, five times it at most
_NARROW = 1e-6  # least side of an effective rectangle, relative to the face


def base_yield(template: Template) -> PlanarYield | SpatialYield:
    """The yield set of associative friction under a template's. Raises TypeError for any other kind."""
    found = template.yield_set
    if isinstance(found, PrescribedFriction):
        return found.base
    if isinstance(found, PlanarYield | SpatialYield):
        return found
    raise TypeError(f"no friction to freeze in {type(found).__name__}")


def require_rectangles(assembly: Assembly, labels: Bits) -> None:
    """Raise InputError where effective areas are asked for on planar scenes or dry faces that are no rectangles."""
    if assembly.dimension == 2:
        raise InputError("--effective-area", "the scene is planar", "a spatial scene")
    faces, ids = assembly.interfaces, assembly.elements.ids
    odd = np.flatnonzero(labels & ~faces.rectangle)
    if odd.size:
        pair = f"{ids[faces.a[odd[0]]]}–{ids[faces.b[odd[0]]]}"
        raise InputError("--effective-area", f"dry face {pair} is no rectangle", "rectangles only")


def contact_of(assembly: Assembly, forces: Floats, labels: Bits) -> Contact:
    """Effective areas under scaled forces (m, 6); inner faces and those without pressure keep the whole face."""
    faces = assembly.interfaces
    # M1 is scaled by l2 / 2 and M2 by l1 / 2, so these are x2 / (l2 / 2) and x1 / (l1 / 2)
    share = np.where(labels, forces[:, 0] / (forces[:, 0] ** 2 + _PRESSED**2), 0.0)
    x1 = np.clip(-forces[:, 4] * share, -1.0, 1.0)
    x2 = np.clip(forces[:, 3] * share, -1.0, 1.0)
    side1 = faces.l1 * np.maximum(1.0 - np.abs(x1), _NARROW)
    side2 = faces.l2 * np.maximum(1.0 - np.abs(x2), _NARROW)
    ratio = np.where(labels, faces.c_t / rectangle_torsion_length(side1, side2), 1.0)
    arm = np.column_stack([0.5 * faces.l2 * x2, -0.5 * faces.l1 * x1]) / faces.c_t[:, None]
    return Contact(ratio, arm)


def change(old: Contact, new: Contact) -> float:
    """Largest change of c_T,e / c_T and of a = x / c_T between two iterates."""
    ratio = np.abs(1.0 / old.ratio - 1.0 / new.ratio).max(initial=0.0)
    return float(max(ratio, np.abs(old.arm - new.arm).max(initial=0.0)))


def frozen_contact(template: Template, contact: Contact) -> Template:
    """The template of associative friction with torsion about given effective areas."""
    base = base_yield(template)
    none = np.zeros(len(template.assembly.interfaces))
    return template.renumbered(PrescribedFriction(base, 1.0, none, contact))


@dataclass(frozen=True)
class _Fixed:
    """Where the iteration stands: frozen template, a state of it, its result, and the change still asked for."""

    state: State
    proven: LimitAnalysisResult
    moved: float


def solve_effective_area(
    analysis: LimitAnalysis,
    labels: Bits | None = None,
    *,
    stands: bool = True,
    most: int = 60,
    weight: float = 1e-2,
) -> LimitAnalysisResult:
    """Associative limit analysis with effective areas, at a fixed point of x and c_T,e.

    analysis: of a spatial assembly whose dry faces are rectangles. labels: (m,) True dry. stands: decide λ = 0
    too (without effective areas). most: programs solved at most. weight: of the proximal term that keeps x from
    jumping between equally good states. The forces lie within the effective areas that they themselves ask for
    (`extra["effective_area"]["fixed_point"]` is the change left), and the bracket is that of the problem with
    those areas frozen. A change above 1e-8 leaves the result uncertified.
    Raises InputError: planar scene, or a dry face that is no rectangle.
    """
    start = time.perf_counter()
    labels = analysis.assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    require_rectangles(analysis.assembly, labels)
    plain = analysis.solve(labels, stands=stands)
    if plain.forces is None:
        return replace(plain, extra={**plain.extra, "effective_area": None})
    forces = (plain.forces / analysis.template.scaling.face).ravel()
    fixed, solves = _iterate(analysis, labels, forces, most, weight)
    seconds, proven, scaling = time.perf_counter() - start, fixed.proven, analysis.template.scaling
    if fixed.state.admissible and fixed.moved <= tolerances.FIXED_POINT:
        bracket = (fixed.state.load * scaling.load, proven.bracket[1])
        floor = tolerances.GAP_FLOOR * analysis.assembly.total_dead / analysis.assembly.total_live
        gap = relative_width(*bracket, floor)
        wide = proven.status is Status.COLLAPSE and not gap <= analysis.gap
        proven = replace(
            proven,
            status=Status.UNCERTIFIED if wide else proven.status,
            load_factor=0.5 * sum(bracket),
            bracket=bracket,
            gap=gap,
            forces=fixed.state.forces * scaling.face,
        )
    elif proven.status is Status.COLLAPSE:
        proven = replace(proven, status=Status.UNCERTIFIED)
    return replace(
        proven,
        stands_at_zero=plain.stands_at_zero,
        iterations=plain.iterations + solves,
        route=(*plain.route, f"effective area ({solves})"),
        seconds={"assemble": analysis.seconds, "solve": seconds, "total": analysis.seconds + seconds},
        extra={
            "effective_area": {"fixed_point": fixed.moved, "frozen": True},
            "load_factor_whole_faces": number(plain.load_factor),
        },
    )


def _iterate(analysis: LimitAnalysis, labels: Bits, forces: Floats, most: int, weight: float) -> tuple[_Fixed, int]:
    """Steps to better forces while areas change much, then steps that hold the forces until areas and forces agree."""
    template, count = analysis.template, analysis.template.matrix.shape[1]
    margin = template.precision.margin
    walk, hold = (ProximalSolver(count, w, template.precision.residual) for w in (weight, _HOLD))
    prover = copy.copy(analysis.prover)
    contact = contact_of(analysis.assembly, forces.reshape(-1, 6), labels)
    frozen = frozen_contact(template, contact)
    solves, steps, slack, moved = 0, 0, margin, np.inf
    while True:
        route = walk if steps < _STEPS else hold
        point = route.solve(frozen.program(labels, slack), forces).point
        solves, steps = solves + 1, steps + 1
        prover.template = frozen
        state = prover.state(point, labels, passes=3)
        new = contact_of(analysis.assembly, state.forces, labels)
        moved, contact = change(contact, new), new
        frozen = frozen_contact(frozen, contact)
        prover.template = frozen
        forces = state.forces.ravel()
        own = prover.state(np.append(forces, state.load), labels, passes=1)
        slack = min(max(margin, -2.0 * own.slack), _SHY * min(1 + steps // 5, 5))
        if own.admissible and (moved <= tolerances.FIXED_POINT or steps > _STEPS):
            proven = _proven(analysis, frozen, labels)
            solves += proven.iterations
            left = change(contact, contact_of(analysis.assembly, own.forces, labels))
            low, high = own.load, proven.bracket[1] / template.scaling.load
            if solves >= most or not high - low > analysis.gap * max(abs(high), abs(low)):
                return _Fixed(own, proven, left), solves
            steps = 0
        elif solves >= most:
            proven = _proven(analysis, frozen, labels)
            return _Fixed(own, proven, moved), solves + proven.iterations


def _proven(analysis: LimitAnalysis, frozen: Template, labels: Bits) -> LimitAnalysisResult:
    other = LimitAnalysis(analysis.assembly, template=frozen, gap=analysis.gap, reference=labels)
    return other.solve(labels, stands=False)
