"""Quantities shown in figures: block colours, centres of pressure, utilisation, movements.

No function depends on matplotlib or has side effects. Shapes: m interfaces, n elements, d = 2 or 3.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly, blocks_of
from jld_core.limit import LimitAnalysisResult, displacement
from jld_core.limit.mechanism import Movement, face_motions
from jld_core.loads import resultants
from jld_core.mechanics import scaling_of, yield_set

REACH: Final = 0.12
"""Largest displacement drawn, relative to the size of the scene."""

TURN: Final = 0.35
"""Largest rotation drawn, radians.

Displacements are linear in the velocities, so that hinges stay closed; larger rotations would visibly enlarge elements.
"""

SMALL: Final = 0.01
"""Share of the largest movement or force of a figure below which nothing is drawn."""

YIELDING: Final = 0.995
"""Utilisation from which a face is marked as yielding.

It is below 1 because forces belong to the proven lower bound of λ.
"""


class MovementSign(StrEnum):
    """Kinds of face movement that figures distinguish: still, hinge, slide, open or crack."""

    STILL = "still"
    HINGE = "hinge"
    SLIDE = "slide"
    OPEN = "open"
    CRACK = "crack"


def block_colours(assembly: Assembly, labels: Bits, available: int) -> Ints:
    """Choose a colour number for each element so that touching blocks differ if possible.

    labels: (m,) True = dry. available: number of colours. The result (n,) is 0 … available − 1, or −1 for supports.
    Blocks with most neighbours choose first; each takes the least used of the colours that its neighbours do not have.
    """
    block, support = blocks_of(assembly, labels), assembly.elements.support
    a, b = block[assembly.interfaces.a], block[assembly.interfaces.b]
    neighbours: dict[int, set[int]] = {int(k): set() for k in block}
    for left, right in zip(a.tolist(), b.tolist(), strict=True):
        if left != right:
            neighbours[left].add(right)
            neighbours[right].add(left)
    grounded = set(block[support].tolist()) - set(block[~support].tolist())
    colour: dict[int, int] = {}
    used = [0] * available
    for k in sorted(neighbours.keys() - grounded, key=lambda k: (-len(neighbours[k]), k)):
        taken = {colour[j] for j in neighbours[k] if j in colour}
        choice = min(range(available), key=lambda c: (c in taken, used[c], c))
        colour[k] = choice
        used[choice] += 1
    return np.array([-1 if s else colour[int(k)] for k, s in zip(block, support, strict=True)], dtype=np.int64)


def typical(assembly: Assembly) -> float:
    """Return the median size of the free elements, by which figures scale arrows and lines.

    The size of an element, in scene units, is the square root of the area of its bounding box; in space the cube root
    of the volume.
    """
    sides = (assembly.elements.upper - assembly.elements.lower)[assembly.elements.free]
    return float(np.median(np.prod(sides, axis=1) ** (1.0 / assembly.dimension)))


def body_load(assembly: Assembly) -> Floats | None:
    """Return the sum (d,) of the live forces on all bodies, scene units.

    None where it is zero, within rounding.
    """
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
    """Return the centre of pressure of each face, and whether it lies on the face.

    forces: (m, q) resultants of the faces, scene units. The centres are (m, d), scene units: x1 = −M2/N along e1 and x2
    = M1/N along e2 from the centroid (planar M = M2). A face without a centre of pressure on it gets its centroid, and
    False in the mask (m,); an inner face may have a moment without thrust.
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
    used = np.array([_gauge(assembly, k, np.array([x1[k], x2[k]])) for k in range(len(faces))])
    on_face = np.isfinite(x1) & np.isfinite(x2) & (used <= 1.0 + 1e-6)
    return faces.origin + np.where(on_face[:, None], np.nan_to_num(shift, posinf=0.0, neginf=0.0), 0.0), on_face


def _gauge(assembly: Assembly, face: int, point: Floats) -> float:
    """Return the relative position of a point of a face: 0 at the centroid, 1 on the hull.

    point: (2,) coordinates x1, x2; in the plane only x1 counts. The result is above 1 outside the hull, and inf for a
    NaN or infinite coordinate.
    """
    faces = assembly.interfaces
    if not np.all(np.isfinite(point)):
        return np.inf
    if assembly.dimension == 2 or faces.rectangle[face]:
        second = 0.0 if assembly.dimension == 2 else abs(point[1]) / (0.5 * faces.l2[face])
        return float(max(abs(point[0]) / (0.5 * faces.l1[face]), second))
    from scipy.spatial import ConvexHull

    arm = faces.polygon[face] - faces.origin[face]
    hull = ConvexHull(np.column_stack([arm @ faces.e1[face], arm @ faces.e2[face]])).equations
    return float(np.max(hull[:, :2] @ point / -hull[:, 2]))


def face_vectors(assembly: Assembly, forces: Floats) -> Floats:
    """Return the force vector of each interface on its element b, (m, d), scene units.

    forces: (m, q) resultants of the faces; moments are not used.
    """
    faces = assembly.interfaces
    vectors = forces[:, [0]] * faces.normal + forces[:, [1]] * faces.e1
    return vectors + forces[:, [2]] * faces.e2 if assembly.dimension == 3 else vectors


def utilisation(result: LimitAnalysisResult) -> Floats:
    """Return the utilisation of each face of a result, (m,): 1 is at yield.

    Raises ValueError where the result holds no forces, and TypeError for yield sets without a utilisation.
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
    """Reverse those face forces (m, d) that point against the total dead load.

    vectors: (m, d) forces on the faces. A reversed force is that on the other element. Without dead load, the live load
    gives the direction. Self-stress of members does not count.
    """
    d, free = assembly.dimension, assembly.elements.free
    down = resultants(assembly.dead_loads, assembly.elements)[free, :d].sum(axis=0)
    if not down.any():
        down = assembly.live[free, :d].sum(axis=0)
    return np.where((vectors @ down < 0.0)[:, None], -vectors, vectors)


def thrust_segments(assembly: Assembly, forces: Floats) -> list[Floats]:
    """Return the segments of the thrust line between centres of pressure.

    forces: (m, q) resultants of the faces, scene units. There is one segment (2, d) for each free element that exactly
    two faces press. With more faces, a single line is undefined. The list is empty where fewer than half of the loaded
    elements have a segment.
    """
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
    """Return the factor by which a figure multiplies velocities; 0 for no motion.

    mechanism: (n, q) velocities. The largest displacement becomes at most `REACH` of the scene's size, and the largest
    rotation at most `TURN`.
    """
    reach = max(
        float(np.linalg.norm(displacement(assembly, mechanism, k, shape), axis=1).max())
        for k, shape in enumerate(assembly.elements.shape)
    )
    turn = float(np.linalg.norm(mechanism[:, assembly.dimension :], axis=1).max())
    if reach == 0.0:
        return 0.0
    return min(REACH * assembly.size / reach, TURN / turn if turn > 0.0 else np.inf)


def movements(result: LimitAnalysisResult) -> tuple[tuple[MovementSign, ...], Floats]:
    """Return the kind of movement of each face in a result's mechanism, and its place.

    The places (m, d) lie on the undeformed faces, scene units. Raises ValueError where the result holds no mechanism.
    """
    motions = face_motions(result)
    kinds = tuple(_SIGNS[motion.kind] for motion in motions)
    return kinds, np.array([motion.place for motion in motions]).reshape(len(kinds), -1)


# Kind of movement in figures by kind of movement in the analysis
_SIGNS: Final = {
    Movement.CLOSED: MovementSign.STILL,
    Movement.HINGE: MovementSign.HINGE,
    Movement.SLIDE: MovementSign.SLIDE,
    Movement.TWIST: MovementSign.SLIDE,
    Movement.OPEN: MovementSign.OPEN,
    Movement.CRACK_TENSION: MovementSign.CRACK,
    Movement.CRACK_SHEAR: MovementSign.CRACK,
}
