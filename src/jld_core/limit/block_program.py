"""Linear program of the block relaxation, and its restriction to allowed blocks."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bools, Floats, Ints
from jld_core.limit.block_parts import BlockParts, Q
from jld_core.mechanics.yield_set import CoulombWedge
from jld_core.program import ConicProgram, pack

LEAST: Final = 0.5
"""Share of the threshold that the λ of every block must reach.

Values nearer to 1 make the relaxation tighter. The program is then often infeasible, and an infeasibility proof gives a
worse bound than a low λ.
"""


class AllBlocksProgram:
    """Program min −λ of the relaxation by blocks for all p possible blocks of an assembly.

    Subclasses set it up once; `of` selects the rows and columns of the allowed blocks. `shape`: numbers of rows and
    columns. Rows are equations up to `_equalities`, linear inequalities up to `_linear`, then cones of `_cone` rows
    each. `_most` and `_least` are the entries with the bounds on the λ of each block.
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
        """Create the program that has only the allowed blocks.

        allowed: (p,) blocks that may be chosen. threshold, most: scaled λ. The λ of each block is bounded by the share
        `LEAST` of `threshold` from below and by `most` from above. Result: program: the program; rows, columns: indices
        of its rows and columns in the program of all blocks.
        """
        row, column, value = self._table
        value = value.copy()
        value[self._most] = -most
        value[self._least] = LEAST * threshold
        keep = np.append(allowed, True)  # Index −1, for rows and columns of no block, is always kept.
        rows, columns = keep[self._row_block], keep[self._column_block]
        here = rows[row] & columns[column]
        # Drop the rows of faces with no remaining forces.
        used = np.zeros(self.shape[0], dtype=bool)
        used[row[here]] = True
        used[self._linear :] = True  # Keep each cone as a whole.
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


class BlockProgram(AllBlocksProgram):
    """Linear program min −λ of the block relaxation, for yield sets that are wedges.

    Its dual is docs/method.md (6.5), (6.6). Columns: share x of each block; rays of the dry set of each side; two rays
    and the shear V of the inner set of each joint; forces by cohesion of each side; λ of each block times x; λ. Rows:
    cover of every element, equal shares of λ, equal forces on shared faces, equilibrium of each part, shear, bounds on
    each block's λ.

    parts: parts, sides and joints of the possible blocks. dry, inner: yield sets of all faces under either label.
    shape: (int, int) numbers of rows and columns of the program of all blocks. x: (p,) columns of x. cover, share: (n,)
    rows of the cover and of the shares of λ, per element. equal_forces: (f, 3) rows of the equal forces on shared
    faces. balance: (k, 3) equilibrium rows of the parts. cohesive: indices of the sides with cohesion.
    """

    def __init__(self, parts: BlockParts, dry: CoulombWedge, inner: CoulombWedge) -> None:
        self._parts, self._entries = parts, SparseEntries()
        self.cohesive = np.flatnonzero(dry.cohesion[parts.side_face] > 0.0)
        p, n = np.arange(parts.blocks), parts.elements
        of_cohesive, of_joint = parts.side_block[self.cohesive], parts.joint_block
        columns, rows = OwnedIndices(), OwnedIndices()
        self.x = columns.of(p)
        rays = columns.of(np.repeat(parts.side_block, 4)).reshape(-1, 4)
        bends = columns.of(np.repeat(of_joint, 3)).reshape(-1, 3)
        sticks = columns.of(of_cohesive)
        own = columns.of(p)
        load = columns.append_unowned(1)
        self.cover, self.share = rows.append_unowned(n), rows.append_unowned(n)
        self.equal_forces = rows.append_unowned(Q * parts.shared).reshape(-1, Q)
        self.balance = rows.of(np.repeat(parts.part_block, Q)).reshape(-1, Q)
        self._equalities = len(rows)
        shear = rows.of(np.repeat(of_joint, 2)).reshape(-1, 2)
        cohesive_shear = rows.of(np.repeat(of_cohesive, 2)).reshape(-1, 2)
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
            add(cohesive_shear[:, turn], sticks, sign)
            add(cohesive_shear[:, turn], of_cohesive, -dry.cohesion[parts.side_face[self.cohesive]])
        add(most, own, 1.0)
        self._most = add(most, self.x, -1.0)
        add(least, own, -1.0)
        self._least = add(least, self.x, 1.0)
        add(above_zero, positive, -1.0)
        self.shape = len(rows), len(columns)
        self._linear, self._cone = len(rows), 1
        self._rhs = np.zeros(len(rows))
        self._rhs[self.cover] = 1.0
        self._table = self._entries.arrays()
        self._row_block, self._column_block = rows.owner, columns.owner

    def _sides(self, dry: CoulombWedge, rays: Ints, sticks: Ints) -> None:
        """Add the forces on the dry faces around the blocks.

        They are normalised rays (1, ±μ, ±1) of the dry set, and shear by cohesion, |V₀| ≤ c x. dry: yield sets. rays,
        sticks: columns of the rays and of the shear by cohesion.
        """
        parts, cohesive, add = self._parts, self.cohesive, self._entries.add_vectors
        mu = dry.friction[parts.side_face]
        size = np.maximum(1.0, mu)
        known = parts.side_shared >= 0
        meets = self.equal_forces[parts.side_shared[known]]
        for turn, (slip, tip) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
            vector = np.column_stack([1.0 / size, slip * mu / size, tip / size])
            add(self.balance[parts.side_part], rays[:, turn], np.einsum("kij,kj->ki", parts.arm, vector))
            add(meets, rays[known, turn], (parts.sign[:, None] * vector)[known])
        add(self.balance[parts.side_part[cohesive]], sticks, parts.arm[cohesive, :, 1])
        known = known[cohesive]
        across = parts.sign[cohesive, None] * np.eye(Q)[1]
        add(self.equal_forces[parts.side_shared[cohesive][known]], sticks[known], across[known])

    def _joints(self, inner: CoulombWedge, bends: Ints) -> None:
        """Add the forces on the inner faces of the blocks.

        They are N = N' − σtA x with N' = r + r', m = (r − r') / bending, and V. inner: yield sets. bends: (j, 3)
        columns of r, r' and V.
        """
        parts, add, lean = self._parts, self._entries.add_vectors, 1.0 / inner.bending
        for part, arm in ((parts.joint_a, parts.arm_a), (parts.joint_b, parts.arm_b)):
            for turn, vector in enumerate((np.array([1.0, 0.0, lean]), np.array([1.0, 0.0, -lean]), np.eye(Q)[1])):
                add(self.balance[part], bends[:, turn], arm @ vector)
            add(self.balance[part], parts.joint_block, -inner.tension[parts.joint_face][:, None] * arm[:, :, 0])

    def _shear(self, inner: CoulombWedge, bends: Ints, shear: Ints) -> None:
        """Add the rows |V| ≤ τA x + μN of inner faces of blocks chosen by x.

        N = N' − σtA x is eliminated, so that the constant is (τA − μ σtA) x. bends: (j, 3) columns of the variables r,
        r' and V of j inner faces. shear: (j, 2) rows.
        """
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


class OwnedIndices:
    """Consecutive row or column indices, each with the block it belongs to (−1: none).

    owner: (count,) block of each index.
    """

    def __init__(self) -> None:
        self.owner: Ints = np.empty(0, dtype=np.int64)

    def __len__(self) -> int:
        return len(self.owner)

    def of(self, blocks: Ints) -> Ints:
        """Append one row or column for each of the blocks (c,) and return their indices (c,)."""
        first = len(self)
        self.owner = np.concatenate([self.owner, blocks])
        return np.arange(first, len(self))

    def append_unowned(self, count: int) -> Ints:
        """Append `count` rows or columns of no block, and return their indices (count,)."""
        return self.of(np.full(count, -1))


class SparseEntries:
    """Entries of a sparse matrix, collected in groups of rows, columns and values."""

    def __init__(self) -> None:
        self._parts: list[tuple[Ints, Ints, Floats]] = []
        self._length = 0

    def add(self, row: Ints, column: Ints, value: Floats | float) -> slice:
        """Append entries, and return the slice that they occupy among all entries.

        row, column: (k,) positions. value: (k,) values, or one value for all.
        """
        begin = self._length
        self._parts.append((row, column, np.broadcast_to(np.asarray(value, dtype=float), row.shape)))
        self._length += len(row)
        return slice(begin, self._length)

    def add_vectors(self, rows: Ints, column: Ints, value: Floats) -> None:
        """Append q entries in each of k columns.

        rows: (k, q) row indices. column: (k,) column indices. value: (k, q) values.
        """
        self.add(rows.ravel(), np.repeat(column, rows.shape[1]), value.ravel())

    def arrays(self) -> tuple[Ints, Ints, Floats]:
        """Return row indices, column indices and values (nnz,) of all entries."""
        rows, columns, values = zip(*self._parts, strict=True)
        return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
