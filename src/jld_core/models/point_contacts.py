"""Concave contact: dry faces touch only at hull corners, with Coulomb friction there."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import DRY, INNER, Assembly
from jld_core.errors import ParameterError
from jld_core.limit import LimitAnalysis, Proof, State
from jld_core.limit.result_building import element_velocities
from jld_core.mechanics.bending import local_hulls
from jld_core.strengths import STANDARD, Route

_ROUTE: Final = Route("contact at points", STANDARD - {"cohesion", "dry crushing"})


def point_contact_assembly(assembly: Assembly, labels: Bits) -> tuple[Assembly, Ints]:
    """Build the assembly of concave contact: one point face per hull corner of a dry face.

    assembly: assembly with whole faces. labels: (m,) True = dry. Result: expanded: assembly with m' faces. Its labels
    are dry for point faces and inner for all others. A point face has no area, no moments and a polygon of one point.
    Its sizes are those of its parent face; they only scale moments, which a point face does not have; parent: (m',)
    face of `assembly` from which each face of `expanded` comes, sorted. Raises InputError if a dry face has a
    compressive strength or cohesion, since a point has no area.

    Corners inside the hull are omitted: their cones are sums of the cones of the hull corners. Source: Livesley 1992;
    docs/method.md (2.13).
    """
    faces = assembly.interfaces
    if assembly.members.bond is not None:
        raise ParameterError("contact", "points have no tensile strength of bond", "convex contact there")
    assembly.strengths(_ROUTE, labels)  # refuses what it does not know
    points: list[Floats] = [faces.polygon[face].mean(axis=0)[None] for face in range(len(faces))]
    dry = np.flatnonzero(labels)
    for face, outline in zip(dry.tolist(), local_hulls(faces, dry), strict=True):
        points[face] = faces.origin[face] + outline @ np.array([faces.e1[face], faces.e2[face]])
    parent = np.repeat(np.arange(len(faces)), [len(p) for p in points])
    place = np.concatenate(points) if points else np.zeros((0, 3))
    is_point = labels[parent]
    spread = faces.take(parent)
    spread = replace(
        spread,
        origin=np.where(is_point[:, None], place, spread.origin),
        area=np.where(is_point, 0.0, spread.area),
        rectangle=spread.rectangle & ~is_point,
        polygon=tuple(place[[k]] if is_point[k] else outline for k, outline in enumerate(spread.polygon)),
    )
    expanded = replace(
        assembly,
        interfaces=spread,
        face_strengths=assembly.face_strengths.take(parent),
        labels=np.where(is_point, DRY, INNER).astype(bool),
        members=assembly.members.joined(np.arange(len(assembly.elements)), parent),
    )
    return expanded, parent


def proof_of_faces(full: LimitAnalysis, points: LimitAnalysis, parent: Ints, proof: Proof) -> Proof:
    """Convert a proof about point contacts into a proof about whole faces.

    full: analysis of the assembly with whole faces. points: analysis of the assembly with point contacts. parent: (m',)
    face of `full` for each face of `points`. proof: proof about `points`, in the scaled units of `points`. Result: the
    same bounds for whole faces, in the scaled units of `full`. The ray of unbounded forces and the collapse below zero
    are dropped.
    """
    one, other = full.template.scaling, points.template.scaling
    unit = other.load / one.load

    def state(found: State | None) -> State | None:
        """Convert a state of the point assembly, None if there is none."""
        if found is None:
            return None
        forces = resultants_of_faces(full.assembly, points.assembly, parent, found.forces * other.face) / one.face
        return replace(found, forces=forces, load=found.load * unit)

    motion = proof.motion
    if motion is not None:
        moves = element_velocities(points.template, motion.velocity)[full.assembly.elements.free]
        velocity = moves.ravel() * one.row.ravel() / one.load
        jumps = (full.prover.transposed @ velocity).reshape(one.face.shape)
        motion = replace(motion, velocity=velocity, jumps=jumps, bound=motion.bound * unit, noise=motion.noise * unit)
    return replace(
        proof,
        state=state(proof.state),
        found=state(proof.found),
        ray=None,
        collapse_below_zero=None,
        motion=motion,
        guess=proof.guess * unit,
        associative=proof.associative * unit,
    )


def resultants_of_faces(assembly: Assembly, points: Assembly, parent: Ints, forces: Floats) -> Floats:
    """Compute the resultants (m, 6) of whole faces about their centroids from point forces.

    assembly: with m whole faces. points: its assembly of m' point contacts. parent: (m',) whole face of each point.
    forces: (m', 6) resultants of the points, scene units, as is the result.
    """
    faces = assembly.interfaces
    arm = points.interfaces.origin - faces.origin[parent]
    x1 = np.einsum("ij,ij->i", arm, faces.e1[parent])
    x2 = np.einsum("ij,ij->i", arm, faces.e2[parent])
    n, v1, v2 = forces[:, 0], forces[:, 1], forces[:, 2]
    # Moment of n·N + e1·V1 + e2·V2 acting at x1 e1 + x2 e2, in the frame (e1, e2, n) with e1 × e2 = n.
    moved = forces.copy()
    moved[:, 3] += x2 * n
    moved[:, 4] -= x1 * n
    moved[:, 5] += x1 * v2 - x2 * v1
    total = np.zeros((len(faces), 6))
    np.add.at(total, parent, moved)
    return total
