"""Forces whose own effective areas give a frozen problem of which they are the optimum, by central paths.

A central path is followed from several starts. Its points are checked by `Prover` before they count, as everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.limit import LimitAnalysis, Motion, Prover, State, relative_width
from jld_core.mechanics.prescribed_friction import EffectiveAreas
from jld_core.models.central_path import CentralPath, PathPoint
from jld_core.models.moving_rows import MovingRows, areas_under, frozen_areas

STARTS: Final = 16
"""Number of central paths tried."""

# Scaled compression of the first iterate, in turn: forces of arches exceed the weight above them
_SIZES: Final = (10.0, 100.0)

# Logarithm of the largest factor on weights of the barrier, of the first four starts; later ones have the last
_SPREAD: Final = (0.0, 0.7, 0.0, 1.5)

_WAVES: Final = 40.0  # largest wave number of the weights, over half the size of the structure

_CLOSE: Final = 1e-3  # relative gap of an iterate from which on it is checked

_BALANCED: Final = 1e-4  # residual of an iterate up to which it is checked

_FINE: Final = 1e-9  # relative width of the bracket below which a path is not followed any further

_REFINEMENTS: Final = 8  # number of iterates after the first converged one, so that λ is more exact than asked

# Relative width of the bracket at the end of a path below which the frozen problem is solved once more
_PROMISING: Final = 1e-4

# Scaled λ at the end of a path above which λ may be unbounded; no third path of this kind is followed
_GROWS: Final = 1e4

_EDGE: Final = 1e-9  # scaled violation up to which forces are moved onto the boundary of the yield sets

_PARALLEL: Final = 0.1  # sine of the angle below which two directions count as parallel


@dataclass(frozen=True)
class FixedPoint:
    """Forces, their effective areas, and a mechanism of the problem with these areas held constant.

    state: forces under the areas; a lower bound on λ of the problem with constant areas if admissible. areas: effective
    areas of the forces. prover: prover of the problem with constant areas. motion: mechanism of that problem with
    finite dissipation. width: relative width of the bracket; inf if an end is missing. starts: number of central paths
    followed.
    """

    state: State
    areas: EffectiveAreas
    prover: Prover
    motion: Motion | None
    width: float
    starts: int


def under_own_areas(prover: Prover, state: State, labels: Bits) -> tuple[State, EffectiveAreas, Prover]:
    """Evaluate a state under the effective areas of its own forces.

    prover: of any template of the assembly. state: forces. labels: (m,) True = dry. The results are the state under
    these areas, the areas, and a prover with the areas frozen.
    """
    areas = areas_under(prover.template.assembly, state.forces, labels)
    frozen = prover.with_template(frozen_areas(prover.template, areas))
    return frozen.state(np.append(state.forces.ravel(), state.load), labels, passes=1), areas, frozen


def find_fixed_point(analysis: LimitAnalysis, labels: Bits, starts: int = STARTS) -> FixedPoint | None:
    """Search forces that are an optimum of the problem frozen at their own effective areas.

    analysis: analysis of a spatial assembly with whole faces. labels: (m,) True = dry. starts: largest number of
    central paths. Result: the first one with a bracket no wider than `analysis.gap`, otherwise that with the narrowest
    bracket; None if no path comes near, or no dry rectangle resists torsion.

    Source: docs/method.md (2.16) to (2.18). Fixed points need not be unique. The weights of each start depend on the
    structure and its loads alone.
    """
    rows = MovingRows(analysis.template, labels)
    if not rows.torsion.size:
        return None
    best: FixedPoint | None = None
    growing = 0
    for start in range(starts):
        path = CentralPath(rows, barrier_weights(analysis.assembly, rows, start), _SIZES[start // 2 % len(_SIZES)])
        asked, more = np.inf, _REFINEMENTS
        for point in path.points():
            size = max(abs(point.load), analysis.load_scale)
            if point.gap <= min(_CLOSE * size, asked) and point.residual <= _BALANCED:
                asked = point.gap if point.gap < 4.0 * analysis.gap * size else 0.1 * point.gap
                found = _checked(analysis, labels, point, start + 1)
                if best is None or found.width < best.width:
                    best = found
            if best is not None and best.width <= analysis.gap:
                more -= 1
                if best.width <= _FINE or more <= 0:
                    return best
        if best is not None and best.width <= analysis.gap:
            return best
        growing += abs(point.load) > _GROWS
        if growing > 1:
            return best
        if best is not None and best.starts == start + 1 and best.width < _PROMISING:
            best = _with_frozen_mechanism(analysis, labels, best)
            if best.width <= analysis.gap:
                return best
    return best


def _checked(analysis: LimitAnalysis, labels: Bits, point: PathPoint, starts: int) -> FixedPoint:
    """Evaluate an iterate of a central path as a fixed point, with a proven bracket of λ.

    The bracket is that of the problem whose effective areas are held at those of the iterate. Its width is inf if an
    end is missing.
    labels: (m,) True = dry. point: the iterate. starts: number of paths followed.
    """
    state, areas, frozen = under_own_areas(analysis.prover, analysis.prover.state(point.y, labels), labels)
    if not state.admissible and state.slack > -_EDGE:
        # faces that bear nothing have no slack at all
        at_edge = analysis.with_template(frozen.template, labels).repair.boundary_state(point.y, labels)
        state = at_edge or state
    motion = frozen.motion(point.u, labels)
    opening = None if motion.margin >= 0.0 else analysis.repair.opening()
    if opening is not None:
        motion = frozen.add_opening(motion, opening, labels)
    finite = motion.margin >= 0.0 and motion.work > 0.0
    low, high = state.load if state.admissible else -np.inf, motion.bound if finite else np.inf
    width = relative_width(low, high, analysis.load_scale)
    return FixedPoint(state, areas, frozen, motion if finite else None, width, starts)


def _with_frozen_mechanism(analysis: LimitAnalysis, labels: Bits, found: FixedPoint) -> FixedPoint:
    """Improve the mechanism of a fixed point by an analysis at its effective areas.

    The mechanism of that analysis is more accurate than the multipliers of an iterate. The narrower bracket is kept.
    labels: (m,) True = dry.
    """
    proof = analysis.with_template(found.prover.template, labels).prove(labels)
    width = (
        np.inf if proof.motion is None else relative_width(found.state.load, proof.motion.bound, analysis.load_scale)
    )
    return replace(found, motion=proof.motion, width=width) if width < found.width else found


def barrier_weights(assembly: Assembly, rows: MovingRows, start: int) -> Floats:
    """Compute the weights of the barrier for one of several central paths.

    assembly: spatial assembly. rows: program of one labelling. start: number of the path. All weights of the first one
    are equal. Returns (rows,): weights. They vary with the place of a face in axes of the loads, so that order,
    position, rotation and units do not change them. Symmetry is broken: symmetric paths may end at a branch point.
    """
    spread = _SPREAD[min(start, len(_SPREAD) - 1)]
    places = assembly.interfaces.origin - assembly.interfaces.origin.mean(axis=0)
    places = places @ load_axes(assembly).T
    places = places / (np.abs(places).max() or 1.0)
    # SeedSequence and PCG64 give the same numbers on every machine
    rng = np.random.default_rng(start)
    kinds = [places @ rng.uniform(-_WAVES, _WAVES, 3) + rng.uniform(0.0, 2.0 * np.pi) for _ in range(3)]
    kind = np.zeros(len(rows.face), dtype=int)
    kind[rows.torsion], kind[rows.linear :] = 1, 2
    weights = np.exp(spread * np.sin(np.stack(kinds)))[kind, rows.face]
    weights[0] = 1.0
    return np.asarray(weights)


def load_axes(assembly: Assembly) -> Floats:
    """Compute three orthonormal directions that turn with the structure and its loads.

    Weights that depend on coordinates along them do not depend on the position or rotation of the scene.

    assembly: spatial assembly. Returns (3, 3): rows: direction of the dead load, of the live load across it, and their
    cross product. Where loads are parallel or zero, the way to the middle of the live load and the first face's e1 and
    e2 take their place.
    """
    elements, free = assembly.elements, assembly.elements.free
    dead, live = assembly.dead[free, :3], assembly.live[free, :3]
    size = np.linalg.norm(live, axis=1)
    away = elements.centroid[free] - elements.centroid[free].mean(axis=0)
    middle = size @ away / (float(size.sum()) or 1.0)
    if np.linalg.norm(middle) < tolerances.CONTACT * assembly.size:
        middle = np.zeros(3)
    first = (assembly.interfaces.e1[0], assembly.interfaces.e2[0], assembly.interfaces.normal[0])
    axes: list[Floats] = []
    for direction in (dead.sum(axis=0), live.sum(axis=0), middle, *first):
        across = direction - sum((axis * (axis @ direction) for axis in axes), np.zeros(3))
        length = float(np.linalg.norm(across))
        if length > _PARALLEL * float(np.linalg.norm(direction)):
            axes.append(across / length)
        if len(axes) == 2:
            break
    return np.stack([*axes, np.cross(axes[0], axes[1])])
