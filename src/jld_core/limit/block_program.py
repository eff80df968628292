"""The linear program of the relaxation by blocks, over all possible blocks, and its part over those allowed."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bools, Floats, Ints
from jld_core.limit.block_parts import BlockParts, Q
from jld_core.mechanics import CoulombWedge
from jld_core.program import ConicProgram, pack

LEAST: Final = 0.5
"""Share of the threshold that the λ of every block must reach: nearer to one the relaxation is tighter, but then it
has often no point at all, and proofs of that are worse than those of a low λ."""


class WholeProgram:
    """Rows and columns of all possible blocks, of which `of` takes those of the allowed ones.

    Rows: equations up to `_equalities`, linear ones up to `_linear`, then cones of `_cone` each. `_most`, `_least`:
    entries that hold the bounds on the λ of each block.
    """

    shape: tuple[int, int]
    _table: tuple[Ints, Ints, Floats]
    _rhs: Floats
    _row_block: Ints
    _column_block: Ints
    _most: slice
    _least: slice
    _equalities: int
    _linear: int
    _cone: int

    def of(self, allowed: Bools, threshold: float, most: float) -> tuple[ConicProgram, Ints, Ints]:
        """The program of the allowed blocks (p,) alone, and which rows and columns of the whole it has.

        threshold, most: scaled λ; every block's own is sought between a share `LEAST` of the one and the other.
        """
        row, column, value = self._table
        value = value.copy()
        value[self._most] = -most
        value[self._least] = LEAST * threshold
        keep = np.append(allowed, True)  # place −1: rows and columns of no block
        rows, columns = keep[self._row_block], keep[self._column_block]
        here = rows[row] & columns[column]
        # a face that only blocks around it are left of has nothing to agree on
        used = np.zeros(self.shape[0], dtype=bool)
        used[row[here]] = True
        used[self._linear :] = True  # a cone is kept whole
        rows &= used | (self._rhs != 0.0)
        new_row, new_column = np.cumsum(rows) - 1, np.cumsum(columns) - 1
        shape = int(rows.sum()), int(columns.sum())
        matrix = sp.csc_array((value[here], (new_row[row[here]], new_column[column[here]])), shape=shape)
        objective = np.zeros(shape[1])
        objective[-1] = -1.0
        equal, linear = int(rows[: self._equalities].sum()), int(rows[self._equalities : self._linear].sum())
        cones = (self._cone,) * (int(rows[self._linear :].sum()) // self._cone)
        program = pack(matrix, self._rhs[rows], objective, equal, linear, cones)
        return program, np.flatnonzero(rows), np.flatnonzero(columns)


class BlockProgram(WholeProgram):
    """min −λ under the conditions of docs/method.md (6.5), (6.6).

    Columns: x of each block, rays of the dry set of each side, what else its cohesion carries, (two rays, V) of the
    inner set of each joint, λ of each block times x, λ. Rows: every element is covered once, the shares of λ agree,
    the forces on shared faces agree, each part is in equilibrium, shear, the range of each block's λ.
    shape: of the whole. x: (p,) columns. cover, share: (n,) rows. agree: (f, 3), balance: (k, 3) rows. stuck: sides
    with cohesion.
    """

    def __init__(self, parts: BlockParts, dry: CoulombWedge, inner: CoulombWedge) -> None:
        self._parts, self._entries = parts, Entries()
        self.stuck = np.flatnonzero(dry.cohesion[parts.side_face] > 0.0)
        p, n = np.arange(parts.blocks), parts.elements
        of_stuck, of_joint = parts.side_block[self.stuck], parts.joint_block
        columns, rows = Places(), Places()
        self.x = columns.of(p)
        rays = columns.of(np.repeat(parts.side_block, 4)).reshape(-1, 4)
        bends = columns.of(np.repeat(of_joint, 3)).reshape(-1, 3)
        sticks = columns.of(of_stuck)
        own = columns.of(p)
        load = columns.of_none(1)
        self.cover, self.share = rows.of_none(n), rows.of_none(n)
        self.agree = rows.of_none(Q * parts.shared).reshape(-1, Q)
        self.balance = rows.of(np.repeat(parts.part_block, Q)).reshape(-1, Q)
        self._equalities = len(rows)
        shear = rows.of(np.repeat(of_joint, 2)).reshape(-1, 2)
        stuck_shear = rows.of(np.repeat(of_stuck, 2)).reshape(-1, 2)
        most, least = rows.of(p), rows.of(p)
        positive = np.concatenate([self.x, rays.ravel(), bends[:, :2].ravel(), own])
        above_zero = rows.of(columns.owner[positive])

        add = self._entries.add
        add(self.cover[parts.part_element], parts.part_block, 1.0)
        add(self.share[parts.part_element], own[parts.part_block], 1.0)
        add(self.share, np.repeat(load, n), -1.0)
        self._sides(dry, rays, sticks)
        self._joints(inner, bends)
        self._entries.add_vectors(self.balance, parts.part_block, parts.dead)
        self._entries.add_vectors(self.balance, own[parts.part_block], parts.live)
        self._shear(inner, bends, shear)
        for turn, sign in enumerate((1.0, -1.0)):
            add(stuck_shear[:, turn], sticks, sign)
            add(stuck_shear[:, turn], of_stuck, -dry.cohesion[parts.side_face[self.stuck]])
        add(most, own, 1.0)
        self._most = add(most, self.x, -1.0)
        add(least, own, -1.0)
        self._least = add(least, self.x, 1.0)
        add(above_zero, positive, -1.0)
        self.shape = len(rows), len(columns)
        self._linear, self._cone = len(rows), 1
        self._rhs = np.zeros(len(rows))
        self._rhs[self.cover] = 1.0
        self._table = self._entries.finished()
        self._row_block, self._column_block = rows.owner, columns.owner

    def _sides(self, dry: CoulombWedge, rays: Ints, sticks: Ints) -> None:
        """Forces on the sides: rays (1, ±μ, ±1) of dry faces, over their size; cohesion besides, |V₀| ≤ c x."""
        parts, stuck, add = self._parts, self.stuck, self._entries.add_vectors
        mu = dry.friction[parts.side_face]
        size = np.maximum(1.0, mu)
        known = parts.side_shared >= 0
        meets = self.agree[parts.side_shared[known]]
        for turn, (slip, tip) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
            vector = np.column_stack([1.0 / size, slip * mu / size, tip / size])
            add(self.balance[parts.side_part], rays[:, turn], np.einsum("kij,kj->ki", parts.arm, vector))
            add(meets, rays[known, turn], (parts.sign[:, None] * vector)[known])
        add(self.balance[parts.side_part[stuck]], sticks, parts.arm[stuck, :, 1])
        known = known[stuck]
        across = parts.sign[stuck, None] * np.eye(Q)[1]
        add(self.agree[parts.side_shared[stuck][known]], sticks[known], across[known])

    def _joints(self, inner: CoulombWedge, bends: Ints) -> None:
        """Forces at the joints: N = N' − σtA x with N' = r + r', m = (r − r') / bending."""
        parts, add, lean = self._parts, self._entries.add_vectors, 1.0 / inner.bending
        for part, arm in ((parts.joint_a, parts.arm_a), (parts.joint_b, parts.arm_b)):
            for turn, vector in enumerate((np.array([1.0, 0.0, lean]), np.array([1.0, 0.0, -lean]), np.eye(Q)[1])):
                add(self.balance[part], bends[:, turn], arm @ vector)
            add(self.balance[part], parts.joint_block, -inner.tension[parts.joint_face][:, None] * arm[:, :, 0])

    def _shear(self, inner: CoulombWedge, bends: Ints, shear: Ints) -> None:
        """|V| ≤ τA x + μN: with N' − σtA x for N what is left of τA."""
        parts, add = self._parts, self._entries.add
        mu = inner.friction[parts.joint_face]
        strength = inner.cohesion[parts.joint_face] - mu * inner.tension[parts.joint_face]
        scale = np.maximum(1.0, strength)
        rubs = np.flatnonzero(mu > 0.0)
        for turn, sign in enumerate((1.0, -1.0)):
            row = shear[:, turn]
            add(row, bends[:, 2], sign / scale)
            add(row, parts.joint_block, -strength / scale)
            for bent in (0, 1):
                add(row[rubs], bends[rubs, bent], -(mu / scale)[rubs])


class Places:
    """Rows or columns of a table, given out in their order, each with the block it belongs to (−1: none)."""

    def __init__(self) -> None:
        self.owner: Ints = np.empty(0, dtype=np.int64)

    def __len__(self) -> int:
        return len(self.owner)

    def of(self, blocks: Ints) -> Ints:
        """The next ones, one for each of these blocks (c,)."""
        first = len(self)
        self.owner = np.concatenate([self.owner, blocks])
        return np.arange(first, len(self))

    def of_none(self, count: int) -> Ints:
        """The next ones, of no block."""
        return self.of(np.full(count, -1))


class Entries:
    """Places and values of a sparse table, gathered in groups."""

    def __init__(self) -> None:
        self._parts: list[tuple[Ints, Ints, Floats]] = []
        self._length = 0

    def add(self, row: Ints, column: Ints, value: Floats | float) -> slice:
        """Entries one by one; where they are among all of them."""
        begin = self._length
        self._parts.append((row, column, np.broadcast_to(np.asarray(value, dtype=float), row.shape)))
        self._length += len(row)
        return slice(begin, self._length)

    def add_vectors(self, rows: Ints, column: Ints, value: Floats) -> None:
        """Columns (k,) with q values (k, q) in q rows (k, q)."""
        self.add(rows.ravel(), np.repeat(column, rows.shape[1]), value.ravel())

    def finished(self) -> tuple[Ints, Ints, Floats]:
        """Rows, columns and values of all of them."""
        rows, columns, values = zip(*self._parts, strict=True)
        return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
