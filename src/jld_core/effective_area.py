"""Torsion about the effective area of dry rectangles, by iteration (Iannuzzo et al. 2024, eq. 5 and 8).

A rectangle pressed at x is taken as the largest rectangle about x: sides l_i − 2|x_i|, c_T of that, and MT about
x. The set is not convex; x is frozen from the iterate before, until it no longer changes. What is proven is
proven for the frozen problem.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.assembly import Assembly, Bits, Floats
from jld_core.errors import InputError
from jld_core.frozen import Contact, FrozenYield
from jld_core.limit import LimitAnalysis
from jld_core.program import Template
from jld_core.result import LimitAnalysisResult
from jld_core.sections import rectangle_torsion_length
from jld_core.solvers.proximal_ import ProximalRoute
from jld_core.solvers.status import Status
from jld_core.yield_sets import PlanarYield
from jld_core.yield_spatial import SpatialYield

FIXED: Final = 1e-8
"""Change of x / (l/2) and of c_T,e / c_T at which the effective areas count as fixed."""

_PRESSED = 1e-7  # scaled N below which a face is not pressed: x = 0
_NARROW = 1e-6  # least side of an effective rectangle, relative to the face


def base_yield(template: Template) -> PlanarYield | SpatialYield:
    """The yield set of associative friction under a template's. Raises TypeError for any other kind."""
    found = template.yield_set
    if isinstance(found, FrozenYield):
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
    pressed = labels & (forces[:, 0] > _PRESSED)
    normal = np.where(pressed, forces[:, 0], 1.0)
    # M1 is scaled by l2 / 2 and M2 by l1 / 2, so these are x2 / (l2 / 2) and x1 / (l1 / 2)
    x1 = np.clip(np.where(pressed, -forces[:, 4] / normal, 0.0), -1.0, 1.0)
    x2 = np.clip(np.where(pressed, forces[:, 3] / normal, 0.0), -1.0, 1.0)
    side1 = faces.l1 * np.maximum(1.0 - np.abs(x1), _NARROW)
    side2 = faces.l2 * np.maximum(1.0 - np.abs(x2), _NARROW)
    ratio = np.where(pressed, faces.c_t / rectangle_torsion_length(side1, side2), 1.0)
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
    return template.renumbered(FrozenYield(base, 1.0, none, contact))


def solve_effective_area(
    analysis: LimitAnalysis,
    labels: Bits | None = None,
    *,
    stands: bool = True,
    most: int = 100,
    weight: float = 1e-2,
) -> LimitAnalysisResult:
    """Associative limit analysis with effective areas, at a fixed point of x and c_T,e.

    analysis: of a spatial assembly whose dry faces are rectangles. labels: (m,) True dry. stands: decide λ = 0
    too (without effective areas). most: programs solved at most. weight: of the proximal term that keeps x from
    jumping between equally good states. The bracket is that of the frozen problem; `extra` says so:
    `effective_area` {fixed_point: last change, frozen: true}, `load_factor_whole_faces`. A change above 1e-8
    leaves the result uncertified.
    Raises InputError: planar scene, or a dry face that is no rectangle.
    """
    start = time.perf_counter()
    labels = analysis.assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    require_rectangles(analysis.assembly, labels)
    plain = analysis.solve(labels, stands=stands)
    if plain.forces is None:
        return replace(plain, extra={**plain.extra, "effective_area": None})
    template, count = analysis.template, analysis.template.matrix.shape[1]
    forces = (plain.forces / template.scaling.face).ravel()
    old = contact_of(analysis.assembly, forces.reshape(-1, 6), labels)
    frozen = frozen_contact(template, old)
    route = ProximalRoute(count, weight, template.precision.residual)
    moved, solves = np.inf, plain.iterations
    for _ in range(most):
        forces = route.solve(frozen.program(labels, template.precision.margin), forces).point[:count]
        solves += 1
        new = contact_of(analysis.assembly, forces.reshape(-1, 6), labels)
        moved, old = change(old, new), new
        frozen = frozen_contact(frozen, new)
        if moved <= FIXED:
            break
    proven = LimitAnalysis(analysis.assembly, template=frozen, gap=analysis.gap, reference=labels).solve(
        labels, stands=False
    )
    seconds = time.perf_counter() - start
    status = proven.status
    if moved > FIXED and status is Status.COLLAPSE:
        status = Status.UNCERTIFIED
    return replace(
        proven,
        status=status,
        stands_at_zero=plain.stands_at_zero,
        iterations=solves + proven.iterations,
        route=(*plain.route, f"effective area ({solves - plain.iterations})", *proven.route),
        seconds={"assemble": analysis.seconds, "solve": seconds, "total": analysis.seconds + seconds},
        extra={
            "effective_area": {"fixed_point": moved, "frozen": True},
            "load_factor_whole_faces": plain.load_factor if np.isfinite(plain.load_factor) else None,
        },
    )
