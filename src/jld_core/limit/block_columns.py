"""Columns of the block relaxation per block, in standard form, for the batch solver.

`BlockProgram` has rows that bound a variable by a block's share x; here columns express the same bounds. The load
factor of a block lies between two bounds because its share is the sum of two parts, one at each bound. Shear lies
between ±τA x because x is the sum of two parts, one with each sign, and so on. The multipliers of the rows that both
forms have are equal.
"""

from __future__ import annotations

import numpy as np

from jld_core.arrays import Floats, Ints
from jld_core.batch.blocks import BlockColumns
from jld_core.limit.block_parts import BlockParts, Q
from jld_core.mechanics.yield_set import CoulombWedge

Column = tuple[list[int], list[float]]
"""Rows and values of the entries of one column."""


def columns_of(parts: BlockParts, dry: CoulombWedge, inner: CoulombWedge) -> list[BlockColumns] | None:
    """Create the columns of every possible block, in the form that the batch solver takes.

    Shared rows: three for each shared face, then three for each element, namely its cover, its share of λ, and one
    unused. parts: parts, sides and joints of the possible blocks. dry, inner: yield sets of all faces under either
    label. The result is None where a joint has no shear strength without compression.
    """
    if np.any(inner.cohesion[parts.joint_face] < inner.friction[parts.joint_face] * inner.tension[parts.joint_face]):
        return None
    of_part, of_side, of_joint = (
        np.split(np.arange(len(block)), np.searchsorted(block, np.arange(1, parts.blocks)))
        for block in (parts.part_block, parts.side_block, parts.joint_block)
    )
    return [_Block(parts, dry, inner, *lists).columns() for lists in zip(of_part, of_side, of_joint, strict=True)]


class _Block:
    """Builder of the columns of one block.

    own, sides, joints: indices of its parts (k,), sides (s,) and joints (j,) in `BlockParts`.
    """

    def __init__(
        self, parts: BlockParts, dry: CoulombWedge, inner: CoulombWedge, own: Ints, sides: Ints, joints: Ints
    ) -> None:
        self._parts, self._dry, self._inner = parts, dry, inner
        self._own, self._sides, self._joints = own, sides, joints
        self._place = {int(k): Q * i for i, k in enumerate(own)}
        cohesive = sides[dry.cohesion[parts.side_face[sides]] > 0.0]
        self._cohesive = {int(s): Q * len(own) + i for i, s in enumerate(cohesive)}
        self._bent = {int(j): Q * len(own) + len(cohesive) + i for i, j in enumerate(joints)}
        self._rows = Q * len(own) + len(cohesive) + len(joints)
        shared = sorted({int(f) for f in parts.side_shared[sides] if f >= 0})
        elements = [int(e) for e in parts.part_element[own]]
        rows = [Q * f + k for f in shared for k in range(Q)]
        rows += [Q * (parts.shared + e) + k for e in elements for k in (0, 1)]
        self._shared = {row: self._rows + i for i, row in enumerate(rows)}
        self._columns: list[Column] = []

    def columns(self) -> BlockColumns:
        """Create the columns of the block: those of each side, then those of each joint."""
        parts = self._parts
        for side in self._sides.tolist():
            self._add_side(side)
        total = self._rows + len(self._shared)
        of_x, of_load = np.zeros(total), np.zeros(total)
        for part in self._own.tolist():
            at, element = self._place[part], Q * (parts.shared + int(parts.part_element[part]))
            of_x[at : at + Q] += parts.dead[part]
            of_load[at : at + Q] += parts.live[part]
            of_x[self._shared[element]] = 1.0
            of_load[self._shared[element + 1]] = 1.0
        for joint in self._joints.tolist():
            self._add_joint(joint, of_x)
        for row in (*self._cohesive.values(), *self._bent.values()):
            of_x[row] = -1.0
        columns = tuple((np.array(rows, dtype=np.int64), np.array(values)) for rows, values in self._columns)
        return BlockColumns(self._rows, np.array(list(self._shared), dtype=np.int64), columns, of_x, of_load)

    def _add_side(self, side: int) -> None:
        """Add the columns of a dry side: normalised rays, and shear ±c if it has cohesion.

        side: index in `BlockParts`.
        """
        face = int(self._parts.side_face[side])
        mu = float(self._dry.friction[face])
        size = max(1.0, mu)
        for slip, tip in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            self._push(side, np.array([1.0 / size, slip * mu / size, tip / size]))
        if side in self._cohesive:
            for sign in (1.0, -1.0):
                self._push(side, np.array([0.0, sign * self._dry.cohesion[face], 0.0]), self._cohesive[side])

    def _push(self, side: int, force: Floats, row: int | None = None) -> None:
        """Add the column of a force at a side: its part in equilibrium and on the shared face.

        side: index in `BlockParts`. force: (3,) resultants. row: row that also gets an entry 1; None for none.
        """
        parts = self._parts
        at = self._place[int(parts.side_part[side])]
        found = [(at + k, value) for k, value in enumerate((parts.arm[side] @ force).tolist())]
        face = int(parts.side_shared[side])
        if face >= 0:
            known = self._shared[Q * face]
            found += [(known + k, value) for k, value in enumerate((parts.sign[side] * force).tolist())]
        self._keep(found, row)

    def _add_joint(self, joint: int, of_x: Floats) -> None:
        """Add the columns of a joint, an inner face of the block.

        They are rays of N' = N + σtA x, and both corners of V at N' = 0. The term σtA is added to the column of x,
        whose entries are `of_x`.
        """
        inner, face = self._inner, int(self._parts.joint_face[joint])
        lean, mu = 1.0 / inner.bending, float(inner.friction[face])
        strength = float(inner.cohesion[face] - mu * inner.tension[face])
        for slip in (1.0, -1.0) if mu > 0.0 else (0.0,):
            for tip in (lean, -lean):
                self._keep(self._bending(joint, np.array([1.0, slip * mu, tip])))
        for sign in (1.0, -1.0):
            self._keep(self._bending(joint, np.array([0.0, sign * strength, 0.0])), self._bent[joint])
        for row, value in self._bending(joint, np.array([-float(inner.tension[face]), 0.0, 0.0])):
            of_x[row] += value

    def _bending(self, joint: int, force: Floats) -> list[tuple[int, float]]:
        """Return the entries (row, value) of a force at a joint in the equilibrium of both parts."""
        parts = self._parts
        ends = ((parts.joint_a, parts.arm_a), (parts.joint_b, parts.arm_b))
        found: dict[int, float] = {}
        for part, arm in ends:
            at = self._place[int(part[joint])]
            for k, value in enumerate((arm[joint] @ force).tolist()):
                found[at + k] = found.get(at + k, 0.0) + value
        return list(found.items())

    def _keep(self, found: list[tuple[int, float]], row: int | None = None) -> None:
        """Store a column without its zero entries.

        found: entries (row, value) of the column. row: row that also gets an entry 1; None for none.
        """
        found = sorted([*found, *([] if row is None else [(row, 1.0)])])
        found = [(at, value) for at, value in found if value != 0.0]
        self._columns.append(([at for at, _ in found], [value for _, value in found]))
