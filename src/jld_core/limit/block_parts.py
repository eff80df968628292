"""Parts, sides and joints of the possible blocks of an assembly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats, Ints
from jld_core.limit.admissible import Motion
from jld_core.program import Template

Q: Final = 3
"""Number of equations per element, and of resultants per face, in planar assemblies; spatial ones have 6."""


@dataclass(frozen=True)
class BlockParts:
    """Struct of arrays over the parts, sides and joints of p possible blocks.

    All values are scaled as in `Template`. A part is an element of a block. A side is a part and a face around its
    block. A joint is a face inside a block. Counts: k parts, s sides, j joints, n free elements, f faces between two
    free elements; q = 3, in space 6.

    blocks, elements, shared: counts p, n and f. part_block, part_element: (k,) block of each part, and index of its
    element among the free elements. side_part, side_face, side_block: (s,) part, face and block of each side.
    side_shared: (s,) index of the side's face among the f shared faces; −1 where the other side is a support. sign:
    (s,) 1 where the part is element a of its face, −1 where it is element b. arm: (s, q, q) matrix from the resultants
    of the face to the equilibrium of the part. joint_block, joint_face: (j,) block and face of each joint. joint_a,
    joint_b: (j,) parts on either side of each joint. arm_a, arm_b: (j, q, q) matrices from the resultants of the joint
    to the equilibrium of both parts. dead, live: (k, q) loads on the parts.
    """

    blocks: int
    elements: int
    shared: int
    part_block: Ints
    part_element: Ints
    side_part: Ints
    side_face: Ints
    side_block: Ints
    side_shared: Ints
    sign: Floats
    arm: Floats
    joint_block: Ints
    joint_face: Ints
    joint_a: Ints
    joint_b: Ints
    arm_a: Floats
    arm_b: Floats
    dead: Floats
    live: Floats

    def jumps(self, velocity: Floats, wall: Floats) -> tuple[Floats, Floats]:
        """Compute half jumps (s, q) at the sides and jumps (j, q) at the joints.

        A half jump is the jump between a part and the face beside it, which has a velocity of its own. velocity: (k, q)
        of the parts. wall: (f, q) of the shared faces; those to supports do not move.
        """
        still = np.vstack([wall, np.zeros((1, wall.shape[1]))])  # Index −1 stands for supports, which do not move.
        half = self.own(velocity) + self.sign[:, None] * still[self.side_shared]
        inner = np.einsum("kij,ki->kj", self.arm_a, velocity[self.joint_a])
        inner += np.einsum("kij,ki->kj", self.arm_b, velocity[self.joint_b])
        return half, inner

    def own(self, velocity: Floats) -> Floats:
        """Compute the half jumps (s, q) at the sides while all faces stand still.

        velocity: (k, q) of the parts.
        """
        return np.asarray(np.einsum("kij,ki->kj", self.arm, velocity[self.side_part]))

    def halved(self, motion: Motion) -> tuple[Floats, Floats]:
        """Convert a motion to velocities of parts (k, q) and of shared faces (f, q).

        Each face moves halfway between its two sides. motion: of the whole assembly, scaled.
        """
        q = self.dead.shape[1]
        velocity = motion.velocity.reshape(-1, q)[self.part_element]
        wall, known = np.zeros((self.shared, q)), self.side_shared >= 0
        away = self.sign[:, None] * (0.5 * motion.jumps[self.side_face] - self.own(velocity))
        wall[self.side_shared[known]] = away[known]
        return velocity, wall

    def speed(self, velocity: Floats) -> Floats:
        """Return the sum of the absolute terms (j,) of the jump at each joint.

        It bounds the rounding error of the jump. velocity: (k, q) of the parts.
        """
        size = np.einsum("kij,ki->k", abs(self.arm_a), abs(velocity[self.joint_a]))
        return np.asarray(size + np.einsum("kij,ki->k", abs(self.arm_b), abs(velocity[self.joint_b])))


def block_parts(template: Template, members: Sequence[Sequence[int]], inside: Sequence[Sequence[int]]) -> BlockParts:
    """Create the parts, sides and joints of possible blocks.

    template: supplies the assembly, the equilibrium matrix and the loads. members: elements of each block. inside:
    faces inside each block. Result: parts in the order of blocks and of their elements.
    """
    assembly = template.assembly
    q = assembly.freedoms
    free, faces = assembly.elements.free, assembly.interfaces
    place = np.full(len(assembly.elements), -1, dtype=np.int64)
    place[free] = np.arange(len(free))
    around: dict[int, list[int]] = {int(e): [] for e in free}
    for face, pair in enumerate(zip(faces.a.tolist(), faces.b.tolist(), strict=True)):
        for e in pair:
            if e in around:
                around[e].append(face)
    parts: list[tuple[int, int]] = []
    sides: list[tuple[int, int]] = []
    joints: list[tuple[int, int, int, int]] = []
    for p, (elements, within) in enumerate(zip(members, inside, strict=True)):
        number = {e: len(parts) + i for i, e in enumerate(elements)}
        parts += [(p, int(place[e])) for e in elements]
        hidden = set(within)
        sides += [(number[e], face) for e in elements for face in around[e] if face not in hidden]
        joints += [(p, face, number[int(faces.a[face])], number[int(faces.b[face])]) for face in within]
    part_block, part_element = np.array(parts, dtype=np.int64).reshape(-1, 2).T
    side_part, side_face = np.array(sides, dtype=np.int64).reshape(-1, 2).T
    joint_block, joint_face, joint_a, joint_b = np.array(joints, dtype=np.int64).reshape(-1, 4).T
    both = (place[faces.a] >= 0) & (place[faces.b] >= 0)
    shared = np.full(len(faces), -1, dtype=np.int64)
    shared[both] = np.arange(int(both.sum()))
    matrix = sp.csr_array(template.matrix)
    return BlockParts(
        blocks=len(members),
        elements=len(free),
        shared=int(both.sum()),
        part_block=part_block,
        part_element=part_element,
        side_part=side_part,
        side_face=side_face,
        side_block=part_block[side_part],
        side_shared=shared[side_face],
        sign=np.where(place[faces.a[side_face]] == part_element[side_part], 1.0, -1.0),
        arm=_arms(matrix, part_element[side_part], side_face, q),
        joint_block=joint_block,
        joint_face=joint_face,
        joint_a=joint_a,
        joint_b=joint_b,
        arm_a=_arms(matrix, part_element[joint_a], joint_face, q),
        arm_b=_arms(matrix, part_element[joint_b], joint_face, q),
        dead=template.dead.reshape(-1, q)[part_element],
        live=template.live.reshape(-1, q)[part_element],
    )


def _arms(matrix: sp.csr_array, element: Ints, face: Ints, q: int) -> Floats:
    """Return the matrices (k, q, q) from resultants of faces to the equilibrium of elements.

    matrix: scaled A_eq. element, face: (k,) pairs; elements are indices among the free elements.
    """
    if not len(element):
        return np.zeros((0, q, q))
    rows = (q * element[:, None] + np.arange(q))[:, :, None]
    columns = (q * face[:, None] + np.arange(q))[:, None, :]
    rows, columns = np.broadcast_arrays(rows, columns)
    return np.asarray(matrix[rows.ravel(), columns.ravel()]).reshape(-1, q, q)
