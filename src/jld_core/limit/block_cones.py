"""Conic program of the block relaxation for any yield set.

It serves spatial faces, and planar faces that crush. Each block has a copy of the rows of every face it touches, in x
times the set: s = x h − G F. Rows and columns are those of `RowPattern`, once for each side and joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bools, Ints
from jld_core.limit.block_parts import BlockParts
from jld_core.limit.block_program import AllBlocksProgram, OwnedIndices, SparseEntries
from jld_core.program import Template


@dataclass(frozen=True)
class _Copies:
    """Copies of faces under one label, each for one block that the face touches.

    face, block: (k,) face and block of each copy. column: (k, q) columns of its resultants. active: (k, q) True if a
    resultant is used.
    """

    face: Ints
    block: Ints
    column: Ints
    active: Bools


class ConeProgram(AllBlocksProgram):
    """Program min −λ of the block relaxation for any yield set.

    Its dual is docs/method.md (6.5), (6.6). Columns: x of each block; resultants and extra variables of each side,
    then of each joint; λ of each block times x; λ. Rows: cover of every element, equal shares of λ, equal forces on
    shared faces, equilibrium of each part, linear rows, cones. Attributes `shape`, `x`, `cover`, `share`,
    `equal_forces`, `balance`: as in `BlockProgram`.

    template: scaled programs of one assembly. parts: parts, sides and joints of the possible blocks. Raises TypeError
    if cones have different sizes.
    """

    def __init__(self, template: Template, parts: BlockParts) -> None:
        self._template, self._parts, self._entries = template, parts, SparseEntries()
        pattern, q = template.yield_set.pattern, template.assembly.freedoms
        count = len(template.assembly.interfaces)
        every = np.ones(count, dtype=bool)
        p, n = np.arange(parts.blocks), parts.elements
        columns, rows = OwnedIndices(), OwnedIndices()
        self.x = columns.of(p)
        self._own_columns = _lists(pattern.face, pattern.column, count, q)
        sides = self._copies(columns, parts.side_face, parts.side_block, template.yield_set.active(every))
        joints = self._copies(columns, parts.joint_face, parts.joint_block, template.yield_set.active(~every))
        own = columns.of(p)
        load = columns.append_unowned(1)
        self.cover, self.share = rows.append_unowned(n), rows.append_unowned(n)
        self.equal_forces = rows.append_unowned(q * parts.shared).reshape(-1, q)
        self.balance = rows.of(np.repeat(parts.part_block, q)).reshape(-1, q)
        self._equalities = len(rows)

        add, vectors = self._entries.add, self._entries.add_vectors
        add(self.cover[parts.part_element], parts.part_block, 1.0)
        add(self.share[parts.part_element], own[parts.part_block], 1.0)
        add(self.share, np.repeat(load, n), -1.0)
        vectors(self.balance, parts.part_block, parts.dead)
        vectors(self.balance, own[parts.part_block], parts.live)
        for copies, part, arm in (
            (sides, parts.side_part, parts.arm),
            (joints, parts.joint_a, parts.arm_a),
            (joints, parts.joint_b, parts.arm_b),
        ):
            for turn in range(q):
                vectors(self.balance[part], copies.column[:, turn], arm[:, :, turn] * copies.active[:, turn, None])
        known = np.flatnonzero(parts.side_shared >= 0)
        meets = self.equal_forces[parts.side_shared[known]]
        add(
            meets.ravel(),
            sides.column[known].ravel(),
            (parts.sign[known, None] * sides.active[known]).ravel(),
        )
        most, least, above_zero = rows.of(p), rows.of(p), rows.of(np.concatenate([p, p]))
        add(most, own, 1.0)
        self._most = add(most, self.x, -1.0)
        add(least, own, -1.0)
        self._least = add(least, self.x, 1.0)
        add(above_zero, np.concatenate([self.x, own]), -1.0)
        for linear in (True, False):
            for copies, dry in ((sides, True), (joints, False)):
                self._sets(rows, copies, dry=dry, linear=linear)
            if linear:
                self._linear = len(rows)
        self.shape = len(rows), len(columns)
        self._rhs = np.zeros(len(rows))
        self._rhs[self.cover] = 1.0
        self._table = self._entries.arrays()
        self._row_block, self._column_block = rows.owner, columns.owner
        sizes = set(pattern.cones)
        if len(sizes) > 1:
            raise TypeError("cones of more than one size")
        self._cone = sizes.pop() if sizes else 1

    def _copies(self, columns: OwnedIndices, face: Ints, block: Ints, active: Bools) -> _Copies:
        """Create the columns of copies of faces (k,), each for one block.

        They are the resultants, and the extra variables of those faces. columns: receives them. face, block: (k,) face
        and block of each copy. active: (m, q) True for resultants that are used.
        """
        q = self._template.assembly.freedoms
        number = np.array([len(one) for one in self._own_columns], dtype=np.int64)[face]
        given = columns.of(np.repeat(block, number))
        begin = given[0] + np.cumsum(number) - number if len(given) else np.zeros(len(face), dtype=np.int64)
        # The resultants come first among the columns of a face.
        return _Copies(face, block, begin[:, None] + np.arange(q), active[face])

    def _sets(self, rows: OwnedIndices, copies: _Copies, *, dry: bool, linear: bool) -> None:
        """Add the yield rows h x − G F of copies of faces: either the linear rows or the cones.

        h and G are right-hand sides and coefficients of a `RowPattern`, x is the share of the block of a copy, F its
        resultants. rows: receives the new rows. copies: of faces under one label. dry: True for the dry label. linear:
        True for linear rows.
        """
        pattern = self._template.yield_set.pattern
        count = len(self._template.assembly.interfaces)
        values, rhs = (pattern.dry, pattern.h_dry) if dry else (pattern.inner, pattern.h_inner)
        wanted = (np.arange(len(rhs)) < pattern.linear) == linear
        if linear:  # Leave out rows that this label does not use.
            wanted &= np.bincount(pattern.row, weights=abs(values), minlength=len(rhs)) > 0.0
        own_rows = _lists(pattern.row_face[wanted], np.flatnonzero(wanted), count)
        place_row = np.zeros(len(rhs), dtype=np.int64)
        place_column: dict[int, int] = {}
        for listed in own_rows:
            place_row[listed] = np.arange(len(listed))
        for listed in self._own_columns:
            place_column |= {int(column): k for k, column in enumerate(listed)}
        used = wanted[pattern.row] & (values != 0.0)
        entries = _lists(pattern.face[used], np.flatnonzero(used), count)
        number = np.array([len(one) for one in own_rows], dtype=np.int64)[copies.face]
        given = rows.of(np.repeat(copies.block, number))
        begin = (given[0] if len(given) else 0) + np.cumsum(number) - number
        local = np.array([place_column[int(column)] for column in pattern.column], dtype=np.int64)
        for face in np.unique(copies.face).tolist():
            mine = np.flatnonzero(copies.face == face)
            which, own = entries[face], own_rows[face]
            row = begin[mine][:, None] + place_row[pattern.row[which]]
            column = copies.column[mine, 0][:, None] + local[which]
            self._entries.add(row.ravel(), column.ravel(), np.tile(values[which], len(mine)))
            tall = own[rhs[own] != 0.0]
            row = begin[mine][:, None] + place_row[tall]
            self._entries.add(row.ravel(), np.repeat(copies.block[mine], len(tall)), np.tile(-rhs[tall], len(mine)))


def _lists(face: Ints, value: Ints, count: int, freedoms: int = 0) -> list[Ints]:
    """Group integer values by face: for each face its distinct values (k,), ascending.

    face, value: (pairs,) a face and a value that belongs to it. count: number of faces. freedoms: number of resultants
    per face. If above 0, the values of face f also include the indices freedoms · f to freedoms · (f + 1) − 1.
    """
    face = np.concatenate([face, np.repeat(np.arange(count), freedoms)])
    value = np.concatenate([value, np.arange(count * freedoms)])
    pairs = np.unique(np.column_stack([face, value]), axis=0)
    return np.split(pairs[:, 1], np.searchsorted(pairs[:, 0], np.arange(1, count)))
