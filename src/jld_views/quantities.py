"""Quantities shown in figures: block colours, centres of pressure, utilisation, movements; without matplotlib."""

from __future__ import annotations

from enum import StrEnum
from typing import Final

import numpy as np

from jld_core import Assembly, Bits, Bools, Floats, Ints, LimitAnalysisResult, blocks_of, resultants
from jld_core.limit import displacement
from jld_core.limit import mechanism as core_mechanism
from jld_core.mechanics import scaling_of, yield_set

REACH: Final = 0.12  # largest displacement drawn, relative to the size of the scene
TURN: Final = 0.35
"""Largest rotation drawn, radians.

Displacements are linear in velocities; larger rotations would visibly enlarge elements.
"""

SMALL: Final = 0.01  # share of the largest movement or force of a figure below which nothing is drawn

# Utilisation from which a face is marked as yielding, below 1 because forces belong to a lower bound of λ.
YIELDING: Final = 0.995


class MovementSign(StrEnum):
    STILL = "still"
    HINGE = "hinge"
    SLIDE = "slide"
    OPEN = "open"
    CRACK = "crack"


def block_colours(assembly: Assembly, labels: Bits, available: int) -> Ints:
    """Choose a colour number (n,) for each element so that touching blocks differ if possible."""
    # −1 for supports. Blocks with most neighbours choose first, each the least used colour that is left.
    block, support = blocks_of(assembly, labels), assembly.elements.support
    a, b = block[assembly.interfaces.a], block[assembly.interfaces.b]
    neighbours: dict[int, set[int]] = {int(k): set() for k in block}
    for first, second in zip(a.tolist(), b.tolist(), strict=True):
        if first != second:
            neighbours[first].add(second)
            neighbours[second].add(first)
    grounded = set(block[support].tolist()) - set(block[~support].tolist())
    colour: dict[int, int] = {}
    used = [0] * available
    for k in sorted(neighbours.keys() - grounded, key=lambda k: (-len(neighbours[k]), k)):
        neighbour_colours = {colour[j] for j in neighbours[k] if j in colour}
        choice = min(range(available), key=lambda c: (c in neighbour_colours, used[c], c))
        colour[k] = choice
        used[choice] += 1
    return np.array([-1 if s else colour[int(k)] for k, s in zip(block, support, strict=True)], dtype=np.int64)


def typical(assembly: Assembly) -> float:
    """Return the median size of the free elements, by which figures scale arrows and lines.

    Root of their boxes' area or volume.
    """
    sides = (assembly.elements.upper - assembly.elements.lower)[assembly.elements.free]
    return float(np.median(np.prod(sides, axis=1) ** (1.0 / assembly.dimension)))


def body_load(assembly: Assembly) -> Floats | None:
    """Return the sum (d,) of the live forces on all bodies; None where it is zero, within rounding."""
    total = assembly.live_loads.body.sum(axis=0)
    if np.linalg.norm(total) <= 1e-9 * assembly.total_live:
        return None
    return np.asarray(total)


def live_couples(assembly: Assembly) -> Ints:
    """Return the indices of the elements whose live load is a moment without a force."""
    d = assembly.dimension
    force = np.linalg.norm(assembly.live[:, :d], axis=1)
    moment = np.linalg.norm(assembly.live[:, d:], axis=1)
    return np.flatnonzero((moment > 1e-12 * assembly.total_live * assembly.size) & (force == 0.0))


def pressure_points(assembly: Assembly, forces: Floats) -> tuple[Floats, Bools]:
    """Return the centre of pressure (m, d) of each face under forces (m, q), and a mask (m,) of those on the face.

    Others get the centroid: a moment without thrust has no centre.
    """
    faces, normal = assembly.interfaces, forces[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        if assembly.dimension == 2:
            x1, x2 = -forces[:, 2] / normal, np.zeros(len(normal))
        else:
            x1, x2 = -forces[:, 4] / normal, forces[:, 3] / normal
        shift = x1[:, None] * faces.e1
        if assembly.dimension == 3:
            shift = shift + x2[:, None] * faces.e2
    inside = np.isfinite(x1) & np.isfinite(x2)
    on_face = inside & (_gauge(assembly, np.column_stack([x1, x2]), inside) <= 1.0 + 1e-6)
    return faces.origin + np.where(on_face[:, None], np.nan_to_num(shift, posinf=0.0, neginf=0.0), 0.0), on_face


def _gauge(assembly: Assembly, points: Floats, finite: Bools) -> Floats:
    """Return the relative positions (m,) of finite points (m, 2) on their faces: 0 at the centroid, 1 on the hull."""
    faces = assembly.interfaces
    with np.errstate(divide="ignore", invalid="ignore"):
        used = abs(points[:, 0]) / (0.5 * faces.l1)
        if assembly.dimension == 2:
            return used
        used = np.maximum(used, abs(points[:, 1]) / (0.5 * faces.l2))
    for face in np.flatnonzero(finite & ~faces.rectangle):
        from scipy.spatial import ConvexHull  # slow to import, and seldom needed

        arm = faces.polygon[face] - faces.origin[face]
        hull = ConvexHull(np.column_stack([arm @ faces.e1[face], arm @ faces.e2[face]])).equations
        used[face] = np.max(hull[:, :2] @ points[face] / -hull[:, 2])
    return used


def face_vectors(assembly: Assembly, forces: Floats) -> Floats:
    """Return the force (m, d) of each interface on its element b, from resultants (m, q)."""
    faces = assembly.interfaces
    vectors = forces[:, [0]] * faces.normal + forces[:, [1]] * faces.e1
    return vectors + forces[:, [2]] * faces.e2 if assembly.dimension == 3 else vectors


def utilisation(result: LimitAnalysisResult) -> Floats:
    """Return the utilisation (m,) of each face of a result, 1 at yield.

    Raises TypeError for yield sets without a utilisation.
    """
    # Utilisation is the largest of bending, shear, tension and crushing, by the yield set of the result's own model.
    # Faces without force have 0.
    if result.forces is None:
        raise ValueError("the result holds no forces")
    scaling = scaling_of(result.assembly)
    sets = yield_set(result.assembly, scaling, result.model.inner_bending)
    forces, bond = result.forces.copy(), result.assembly.members.bond
    if bond is not None:
        forces[: len(bond), 0] += bond
    used = sets.utilisation(forces / scaling.face, result.labels)
    if used is None:
        raise TypeError("these yield sets define no utilisation")
    if bond is not None:
        # Full tension is the tip of the set, where no other share is defined.
        pulled = np.divide(-result.forces[: len(bond), 0], bond, out=np.zeros(len(bond)), where=bond > 0.0)
        used[: len(bond)] = np.maximum(used[: len(bond)], np.clip(pulled, 0.0, 1.0))
    return used


def down_the_load_path(assembly: Assembly, vectors: Floats) -> Floats:
    """Reverse those face forces (m, d) that point against the total dead load, or without one the live load."""
    d, free = assembly.dimension, assembly.elements.free
    down = resultants(assembly.dead_loads, assembly.elements)[free, :d].sum(axis=0)
    if not down.any():
        down = assembly.live[free, :d].sum(axis=0)
    return np.where((vectors @ down < 0.0)[:, None], -vectors, vectors)


def thrust_segments(assembly: Assembly, forces: Floats) -> list[Floats]:
    """Return segments (2, d) of the thrust line under resultants (m, q)."""
    # Each is of a free element that exactly two faces press; empty where fewer than half of the loaded elements have
    # one.
    points, on_face = pressure_points(assembly, forces)
    size = np.linalg.norm(face_vectors(assembly, forces), axis=1)
    pressed = (forces[:, 0] > 0.0) & on_face & (size > SMALL * size.max(initial=0.0))
    pulled = ~pressed & (size > SMALL * size.max(initial=0.0))
    touching: dict[int, list[int]] = {int(k): [] for k in assembly.elements.free}
    for face in np.flatnonzero(pressed | pulled):
        for element in (int(assembly.interfaces.a[face]), int(assembly.interfaces.b[face])):
            if element in touching:
                touching[element].append(int(face))
    pieces = [points[pair] for pair in touching.values() if len(pair) == 2 and pressed[pair].all()]
    return pieces if 2 * len(pieces) >= sum(bool(pair) for pair in touching.values()) else []


def mechanism_scale(assembly: Assembly, mechanism: Floats) -> float:
    """Return the factor by which a figure multiplies velocities (n, q), within `REACH` and `TURN`; 0 for no motion."""
    reach = max(
        float(np.linalg.norm(displacement(assembly, mechanism, k, shape), axis=1).max())
        for k, shape in enumerate(assembly.elements.shape)
    )
    turn = float(np.linalg.norm(mechanism[:, assembly.dimension :], axis=1).max())
    if reach == 0.0:
        return 0.0
    return min(REACH * assembly.size / reach, TURN / turn if turn > 0.0 else np.inf)


def movements(result: LimitAnalysisResult) -> tuple[tuple[MovementSign, ...], Floats]:
    """Return the kind of movement of each face in a result's mechanism, and its place (m, d) on the undeformed face."""
    motions = core_mechanism.face_motions(result)
    kinds = tuple(_SIGNS[motion.kind] for motion in motions)
    return kinds, np.array([motion.place for motion in motions]).reshape(len(kinds), -1)


# Kind of movement in figures by kind of movement in the analysis
_SIGNS: Final = {
    core_mechanism.Movement.CLOSED: MovementSign.STILL,
    core_mechanism.Movement.HINGE: MovementSign.HINGE,
    core_mechanism.Movement.SLIDE: MovementSign.SLIDE,
    core_mechanism.Movement.TWIST: MovementSign.SLIDE,
    core_mechanism.Movement.OPEN: MovementSign.OPEN,
    core_mechanism.Movement.CRACK_TENSION: MovementSign.CRACK,
    core_mechanism.Movement.CRACK_SHEAR: MovementSign.CRACK,
}
