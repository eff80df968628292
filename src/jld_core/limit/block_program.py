"""Linear program of the block relaxation, and its restriction to allowed blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.batch.batch_solver import BlockColumns
from jld_core.limit.bounds import Motion
from jld_core.mechanics import YieldSet
from jld_core.mechanics.yield_set import CoulombWedge
from jld_core.program import ConicProgram, Template, pack


class BlockFaces(Protocol):
    """Margins and dissipation of scaled jumps at faces under one label; a face may occur several times."""

    def margin(self, jumps: Floats, faces: Ints) -> Floats:
        """Return the least slack (k,) of the conditions for finite dissipation of jumps (k, q) at faces (k,)."""

    def dissipation(self, jumps: Floats, faces: Ints) -> Floats:
        """Return the dissipation (k,) of jumps (k, q) with non-negative margin, at faces (k,)."""

    def strength(self, faces: Ints) -> Floats:
        """Return the largest growth (k,) of the dissipation of faces (k,) per unit of jump size."""


@dataclass(frozen=True)
class YieldSetFaces:
    """Margins and dissipation at faces of any yield set under one label; see `BlockFaces`."""

    sets: YieldSet  # yield sets of m faces
    dry: bool  # True for the dry label
    strengths: Floats  # (m,) see `BlockFaces.strength`

    @classmethod
    def of(cls, template: Template, *, dry: bool) -> YieldSetFaces:
        labels = np.full(len(template.assembly.interfaces), dry)
        return cls(template.yield_set, dry, template.yield_set.strength(labels))

    def margin(self, jumps: Floats, faces: Ints) -> Floats:
        """Return the margins (k,) of jumps (k, q) at faces (k,)."""
        return self._each(self.sets.margin, jumps, faces)

    def dissipation(self, jumps: Floats, faces: Ints) -> Floats:
        """Return the dissipation (k,) of jumps (k, q) at faces (k,)."""
        return self._each(self.sets.dissipation, jumps, faces)

    def strength(self, faces: Ints) -> Floats:
        """Return the strengths (k,) of faces (k,)."""
        return np.asarray(self.strengths[faces])

    def _each(self, measure: Callable[[Floats, Bits], Floats], jumps: Floats, faces: Ints) -> Floats:
        """Evaluate a measure of jumps (k, q) at faces (k,), at most one jump per face in each pass."""
        values = np.empty(len(faces))
        count = len(self.strengths)
        labels = np.full(count, self.dry)
        order = np.argsort(faces, kind="stable")
        turn = np.arange(len(faces)) - np.searchsorted(faces[order], faces[order])
        for each in range(int(turn.max(initial=-1)) + 1):
            of_turn = order[turn == each]
            table = np.zeros((count, jumps.shape[1]))
            table[faces[of_turn]] = jumps[of_turn]
            values[of_turn] = measure(table, labels)[faces[of_turn]]
        return values


@dataclass(frozen=True)
class CappedWedge:
    """Wedges of one label with N ≤ caps (m,), whose dissipation is finite for all jumps where the cap is."""

    wedge: CoulombWedge
    caps: Floats

    def margin(self, jumps: Floats, faces: Ints) -> Floats:
        """Return the margins (k,) of jumps (k, 3) at faces (k,); inf where the cap is finite."""
        return np.where(np.isfinite(self.caps[faces]), np.inf, self.wedge.margin(jumps, faces))

    def dissipation(self, jumps: Floats, faces: Ints) -> Floats:
        """Return the dissipation (k,) of jumps (k, 3) at faces (k,), inf where it is not finite."""
        # sup over N ≤ c of −J·F ≤ κ c + D(J + κ e_N) for any κ ≥ 0; the least κ with a finite D is taken
        short = -self.wedge.margin(jumps, faces)
        short = np.where(short > 0.0, short + tolerances.ROUNDING * abs(jumps).sum(axis=1), 0.0)
        opened = jumps.copy()
        opened[:, 0] += short
        cost = np.zeros(len(faces))
        np.multiply(short, self.caps[faces], out=cost, where=short > 0.0)
        return np.asarray(self.wedge.dissipation(opened, faces) + cost)

    def strength(self, faces: Ints) -> Floats:
        """Return the largest growth (k,) of the dissipation of faces (k,) per unit of jump size."""
        caps = self.caps[faces]
        return np.asarray(self.wedge.strength(faces) + np.where(np.isfinite(caps), caps, 0.0))


Q: Final = 3  # number of equations per element, and of resultants per face, in planar assemblies; spatial ones have 6


@dataclass(frozen=True)
class BlockParts:
    """Parts (element of a block), sides (part and face around) and joints (faces inside) of p possible blocks, scaled.

    Counts: k parts, s sides, j joints, n free elements, f faces between two free elements.
    """

    # blocks, elements, shared: counts p, n and f
    blocks: int
    elements: int
    shared: int
    # part_block, part_element: (k,) block of each part, and index of its element among the free elements
    part_block: Ints
    part_element: Ints
    # side_part, side_face, side_block: (s,) part, face and block of each side
    side_part: Ints
    side_face: Ints
    side_block: Ints
    side_shared: Ints  # (s,) index of the side's face among the f shared faces; −1 where the other side is a support
    sign: Floats  # (s,) 1 where the part is element a of its face, −1 where it is element b
    arm: Floats  # (s, q, q) matrix from the resultants of the face to the equilibrium of the part
    # joint_block, joint_face: (j,) block and face of each joint
    joint_block: Ints
    joint_face: Ints
    # joint_a, joint_b: (j,) parts on either side of each joint
    joint_a: Ints
    joint_b: Ints
    # arm_a, arm_b: (j, q, q) matrices from the resultants of the joint to the equilibrium of both parts
    arm_a: Floats
    arm_b: Floats
    # dead, live: (k, q) loads on the parts
    dead: Floats
    live: Floats

    def jumps(self, velocity: Floats, wall: Floats) -> tuple[Floats, Floats]:
        """Compute half jumps (s, q) between parts and the faces beside them, and jumps (j, q) at joints."""
        still = np.vstack([wall, np.zeros((1, wall.shape[1]))])  # Index −1 stands for supports, which do not move.
        half = self.own(velocity) + self.sign[:, None] * still[self.side_shared]
        inner = np.einsum("kij,ki->kj", self.arm_a, velocity[self.joint_a])
        inner += np.einsum("kij,ki->kj", self.arm_b, velocity[self.joint_b])
        return half, inner

    def own(self, velocity: Floats) -> Floats:
        """Compute the half jumps (s, q) at the sides of velocities (k, q) while all faces stand still."""
        return np.asarray(np.einsum("kij,ki->kj", self.arm, velocity[self.side_part]))

    def halved(self, motion: Motion) -> tuple[Floats, Floats]:
        """Convert a motion to velocities of parts (k, q) and of faces (f, q), halfway between their sides."""
        q = self.dead.shape[1]
        velocity = motion.velocity.reshape(-1, q)[self.part_element]
        wall, known = np.zeros((self.shared, q)), self.side_shared >= 0
        away = self.sign[:, None] * (0.5 * motion.jumps[self.side_face] - self.own(velocity))
        wall[self.side_shared[known]] = away[known]
        return velocity, wall

    def speed(self, velocity: Floats) -> Floats:
        """Return the sum of absolute terms (j,) of the jump at each joint, which bounds its rounding error."""
        size = np.einsum("kij,ki->k", abs(self.arm_a), abs(velocity[self.joint_a]))
        return np.asarray(size + np.einsum("kij,ki->k", abs(self.arm_b), abs(velocity[self.joint_b])))


def block_parts(template: Template, members: Sequence[Sequence[int]], inside: Sequence[Sequence[int]]) -> BlockParts:
    """Create the parts, sides and joints of possible blocks, in the order of blocks and of their elements."""
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
    parts: list[tuple[int, int]] = []  # block, free element
    sides: list[tuple[int, int]] = []  # part, face
    joints: list[tuple[int, int, int, int]] = []  # block, face, parts on its sides a and b
    for p, (elements, within) in enumerate(zip(members, inside, strict=True)):
        number = {e: len(parts) + i for i, e in enumerate(elements)}
        parts += [(p, int(place[e])) for e in elements]
        hidden = set(within)
        sides += [(number[e], face) for e in elements for face in around[e] if face not in hidden]
        joints += [(p, face, number[int(faces.a[face])], number[int(faces.b[face])]) for face in within]
    part_block, part_element = np.array(parts, dtype=np.int64).reshape(-1, 2).T
    side_part, side_face = np.array(sides, dtype=np.int64).reshape(-1, 2).T
    joint_block, joint_face, joint_a, joint_b = np.array(joints, dtype=np.int64).reshape(-1, 4).T
    between_free = (place[faces.a] >= 0) & (place[faces.b] >= 0)
    shared = np.full(len(faces), -1, dtype=np.int64)
    shared[between_free] = np.arange(int(between_free.sum()))
    matrix = sp.csr_array(template.matrix)
    return BlockParts(
        blocks=len(members),
        elements=len(free),
        shared=int(between_free.sum()),
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
    """Return the matrices (k, q, q) from resultants of faces to the equilibrium of free elements."""
    if not len(element):
        return np.zeros((0, q, q))
    rows = (q * element[:, None] + np.arange(q))[:, :, None]
    columns = (q * face[:, None] + np.arange(q))[:, None, :]
    rows, columns = np.broadcast_arrays(rows, columns)
    return np.asarray(matrix[rows.ravel(), columns.ravel()]).reshape(-1, q, q)


# Share of the threshold that the λ of every block must reach.
# Values nearer to 1 make the relaxation tighter. The program is then often infeasible, and an infeasibility proof
# gives a worse bound than a low λ.
LEAST: Final = 0.5
_LEAST_CAP: Final = 1e-9  # least normal force, scaled, by which the row of a cap is divided


class AllBlocksProgram:
    """Program min −λ of the relaxation by blocks for all p possible blocks; `of` selects allowed ones."""

    # Rows: equations up to `_equalities`, linear inequalities up to `_linear`, cones of `_cone` rows. `_upper_entries`
    # and `_lower_entries` are those that bound λ of each block. A row or column of owner −1 belongs to no block.

    shape: tuple[int, int]
    x: Ints
    cover: Ints
    share: Ints
    equal_forces: Ints
    balance: Ints
    _entries: SparseEntries
    _table: tuple[Ints, Ints, Floats]
    _rhs: Floats
    _row_block: Ints
    _column_block: Ints
    _upper_entries: slice
    _lower_entries: slice
    _equalities: int
    _linear: int
    _cone: int

    def of(self, allowed: Bools, threshold: float, most: float) -> tuple[ConicProgram, Ints, Ints]:
        """Create the program of the allowed blocks (p,); also its rows and columns among all.

        λ in [threshold, most].
        """
        row, column, value = self._table
        value = value.copy()
        value[self._upper_entries] = -most
        value[self._lower_entries] = LEAST * threshold
        keep = np.append(allowed, True)  # Index −1, for rows and columns of no block, is always kept.
        rows, columns = keep[self._row_block], keep[self._column_block]
        kept = rows[row] & columns[column]
        # Drop the rows of faces with no remaining forces.
        used = np.zeros(self.shape[0], dtype=bool)
        used[row[kept]] = True
        used[self._linear :] = True  # Keep each cone as a whole.
        rows &= used | (self._rhs != 0.0)
        new_row, new_column = np.cumsum(rows) - 1, np.cumsum(columns) - 1
        shape = int(rows.sum()), int(columns.sum())
        matrix = sp.csc_array((value[kept], (new_row[row[kept]], new_column[column[kept]])), shape=shape)
        objective = np.zeros(shape[1])
        objective[-1] = -1.0
        equal, linear = int(rows[: self._equalities].sum()), int(rows[self._equalities : self._linear].sum())
        cones = (self._cone,) * (int(rows[self._linear :].sum()) // self._cone)
        program = pack(matrix, self._rhs[rows], objective, equal, linear, cones)
        return program, np.flatnonzero(rows), np.flatnonzero(columns)

    def _begin_rows(self, rows: OwnedIndices, parts: BlockParts, q: int) -> None:
        """Append the equations: cover, shares, equal forces (shared faces, q), balance (parts, q)."""
        self.cover, self.share = rows.append_unowned(parts.elements), rows.append_unowned(parts.elements)
        self.equal_forces = rows.append_unowned(q * parts.shared).reshape(-1, q)
        self.balance = rows.of(np.repeat(parts.part_block, q)).reshape(-1, q)
        self._equalities = len(rows)

    def _add_loads(self, parts: BlockParts, block_load: Ints, load: Ints) -> None:
        """Add cover, shares of λ and loads; block_load: (p,) columns of λ times x, load: (1,) column of λ."""
        add, add_vectors = self._entries.add, self._entries.add_vectors
        add(self.cover[parts.part_element], parts.part_block, 1.0)
        add(self.share[parts.part_element], block_load[parts.part_block], 1.0)
        add(self.share, np.repeat(load, parts.elements), -1.0)
        add_vectors(self.balance, parts.part_block, parts.dead)
        add_vectors(self.balance, block_load[parts.part_block], parts.live)

    def _bound_loads(self, upper: Ints, lower: Ints, block_load: Ints) -> None:
        """Add bounds on λ of each block in rows `upper` and `lower` (p,), whose values `of` states."""
        self._entries.add(upper, block_load, 1.0)
        self._upper_entries = self._entries.add(upper, self.x, -1.0)
        self._entries.add(lower, block_load, -1.0)
        self._lower_entries = self._entries.add(lower, self.x, 1.0)

    def _finish(self, rows: OwnedIndices, columns: OwnedIndices) -> None:
        self.shape = len(rows), len(columns)
        self._rhs = np.zeros(len(rows))
        self._rhs[self.cover] = 1.0
        self._table = self._entries.arrays()
        self._row_block, self._column_block = rows.owner, columns.owner


class BlockProgram(AllBlocksProgram):
    """Linear program min −λ of the block relaxation for wedges; its dual is docs/method.md (6.5), (6.6).

    Columns: share x of each block; rays of the dry set of each side; two rays and V of the inner set of each joint;
    forces by c of each side; λ of each block times x; λ. Rows: cover, equal shares of λ, equal forces on shared faces,
    equilibrium of parts, shear, bounds on each block's λ.
    """

    def __init__(self, parts: BlockParts, dry: CoulombWedge, inner: CoulombWedge, caps: Floats | None = None) -> None:
        self._parts, self._entries = parts, SparseEntries()
        self.cohesive = np.flatnonzero(dry.shear[parts.side_face] > 0.0)
        p = np.arange(parts.blocks)
        of_cohesive, of_joint = parts.side_block[self.cohesive], parts.joint_block
        columns, rows = OwnedIndices(), OwnedIndices()
        self.x = columns.of(p)
        rays = columns.of(np.repeat(parts.side_block, 4)).reshape(-1, 4)
        bends = columns.of(np.repeat(of_joint, 3)).reshape(-1, 3)
        sticks = columns.of(of_cohesive)
        block_load = columns.of(p)
        load = columns.append_unowned(1)
        self._begin_rows(rows, parts, Q)
        shear = rows.of(np.repeat(of_joint, 2)).reshape(-1, 2)
        cohesive_shear = rows.of(np.repeat(of_cohesive, 2)).reshape(-1, 2)
        upper, lower = rows.of(p), rows.of(p)
        if caps is not None:
            self._cap(dry, inner, caps, rays, bends, rows)
        positive = np.concatenate([self.x, rays.ravel(), bends[:, :2].ravel(), block_load])
        above_zero = rows.of(columns.owner[positive])

        self._add_loads(parts, block_load, load)
        self._sides(dry, rays, sticks)
        self._joints(inner, bends)
        self._shear(inner, bends, shear)
        for turn, sign in enumerate((1.0, -1.0)):
            self._entries.add(cohesive_shear[:, turn], sticks, sign)
            self._entries.add(cohesive_shear[:, turn], of_cohesive, -dry.shear[parts.side_face[self.cohesive]])
        self._bound_loads(upper, lower, block_load)
        self._entries.add(above_zero, positive, -1.0)
        self._linear, self._cone = len(rows), 1
        self._finish(rows, columns)

    def _cap(
        self, dry: CoulombWedge, inner: CoulombWedge, caps: Floats, rays: Ints, bends: Ints, rows: OwnedIndices
    ) -> None:
        """Add the rows N ≤ c x of sides and joints whose cap c is finite, divided by c."""
        parts, add = self._parts, self._entries.add
        for face, block, presses, size, drawn in (
            (parts.side_face, parts.side_block, rays, np.maximum(1.0, dry.friction), np.zeros(len(caps))),
            (parts.joint_face, parts.joint_block, bends[:, :2], np.ones(len(caps)), inner.tension),
        ):
            held = np.flatnonzero(np.isfinite(caps[face]))
            row, cap = rows.of(block[held]), np.maximum(caps + drawn, _LEAST_CAP)[face[held]]
            for column in presses[held].T:
                add(row, column, 1.0 / (size[face[held]] * cap))
            add(row, block[held], -1.0)

    def _sides(self, dry: CoulombWedge, rays: Ints, sticks: Ints) -> None:
        """Add the forces on the dry faces around the blocks."""
        # The forces are normalised rays (1, ±μ, ±1) of the dry set, and shear without N, |V₀| ≤ c x.
        parts, cohesive, add = self._parts, self.cohesive, self._entries.add_vectors
        mu = dry.friction[parts.side_face]
        size = np.maximum(1.0, mu)
        shared = parts.side_shared >= 0
        rows = self.equal_forces[parts.side_shared[shared]]
        for turn, (slip, tip) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
            vector = np.column_stack([1.0 / size, slip * mu / size, tip / size])
            add(self.balance[parts.side_part], rays[:, turn], np.einsum("kij,kj->ki", parts.arm, vector))
            add(rows, rays[shared, turn], (parts.sign[:, None] * vector)[shared])
        add(self.balance[parts.side_part[cohesive]], sticks, parts.arm[cohesive, :, 1])
        shared = shared[cohesive]
        across = parts.sign[cohesive, None] * np.eye(Q)[1]
        add(self.equal_forces[parts.side_shared[cohesive][shared]], sticks[shared], across[shared])

    def _joints(self, inner: CoulombWedge, bends: Ints) -> None:
        """Add N = N' − σtA x with N' = r + r', m = (r − r') / bending, and V, of columns `bends` (j, 3)."""
        parts, add, lean = self._parts, self._entries.add_vectors, 1.0 / inner.bending
        for part, arm in ((parts.joint_a, parts.arm_a), (parts.joint_b, parts.arm_b)):
            for turn, vector in enumerate((np.array([1.0, 0.0, lean]), np.array([1.0, 0.0, -lean]), np.eye(Q)[1])):
                add(self.balance[part], bends[:, turn], arm @ vector)
            add(self.balance[part], parts.joint_block, -inner.tension[parts.joint_face][:, None] * arm[:, :, 0])

    def _shear(self, inner: CoulombWedge, bends: Ints, shear: Ints) -> None:
        """Add the rows |V| ≤ τA x + μN of inner faces, columns `bends` (j, 3)."""
        # N = N' − σtA x is eliminated, so that the constant is (τA − μ σtA) x.
        parts, add = self._parts, self._entries.add
        mu = inner.friction[parts.joint_face]
        strength = inner.shear[parts.joint_face] - mu * inner.tension[parts.joint_face]
        scale = np.maximum(1.0, strength)
        rubs = np.flatnonzero(mu > 0.0)
        for turn, sign in enumerate((1.0, -1.0)):
            row = shear[:, turn]
            add(row, bends[:, 2], sign / scale)
            add(row, parts.joint_block, -strength / scale)
            for bent in (0, 1):
                add(row[rubs], bends[rubs, bent], -(mu / scale)[rubs])


class OwnedIndices:
    """Consecutive row or column indices, each with the block it belongs to (−1: none)."""

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
        """Append entries at row, column (k,), and return their slice among all entries."""
        begin = self._length
        self._parts.append((row, column, np.broadcast_to(np.asarray(value, dtype=float), row.shape)))
        self._length += len(row)
        return slice(begin, self._length)

    def add_vectors(self, rows: Ints, column: Ints, value: Floats) -> None:
        """Append q entries (k, q) in each of k columns."""
        self.add(rows.ravel(), np.repeat(column, rows.shape[1]), value.ravel())

    def arrays(self) -> tuple[Ints, Ints, Floats]:
        """Return row indices, column indices and values (nnz,) of all entries."""
        rows, columns, values = zip(*self._parts, strict=True)
        return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)


Column = tuple[list[int], list[float]]  # rows and values of the entries of one column


def columns_of(parts: BlockParts, dry: CoulombWedge, inner: CoulombWedge) -> list[BlockColumns] | None:
    """Create the columns of every possible block, in the form that the batch solver takes.

    Shared rows: three for each shared face, then cover, share of λ and an unused one for each element.
    """
    if np.any(inner.shear[parts.joint_face] < inner.friction[parts.joint_face] * inner.tension[parts.joint_face]):
        return None
    of_part, of_side, of_joint = (
        np.split(np.arange(len(block)), np.searchsorted(block, np.arange(1, parts.blocks)))
        for block in (parts.part_block, parts.side_block, parts.joint_block)
    )
    return [_Block(parts, dry, inner, *lists).columns() for lists in zip(of_part, of_side, of_joint, strict=True)]


class _Block:
    def __init__(
        self, parts: BlockParts, dry: CoulombWedge, inner: CoulombWedge, own: Ints, sides: Ints, joints: Ints
    ) -> None:
        self._parts, self._dry, self._inner = parts, dry, inner
        self._own, self._sides, self._joints = own, sides, joints
        self._place = {int(k): Q * i for i, k in enumerate(own)}
        cohesive = sides[dry.shear[parts.side_face[sides]] > 0.0]
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
        """Add the columns of a dry side: normalised rays, and shear ±c if it has any."""
        face = int(self._parts.side_face[side])
        mu = float(self._dry.friction[face])
        size = max(1.0, mu)
        for slip, tip in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            self._push(side, np.array([1.0 / size, slip * mu / size, tip / size]))
        if side in self._cohesive:
            for sign in (1.0, -1.0):
                self._push(side, np.array([0.0, sign * self._dry.shear[face], 0.0]), self._cohesive[side])

    def _push(self, side: int, force: Floats, row: int | None = None) -> None:
        """Add the column of a force (3,) at a side: equilibrium of the part, and the shared face."""
        parts = self._parts
        at = self._place[int(parts.side_part[side])]
        entries = [(at + k, value) for k, value in enumerate((parts.arm[side] @ force).tolist())]
        face = int(parts.side_shared[side])
        if face >= 0:
            known = self._shared[Q * face]
            entries += [(known + k, value) for k, value in enumerate((parts.sign[side] * force).tolist())]
        self._keep(entries, row)

    def _add_joint(self, joint: int, of_x: Floats) -> None:
        # The columns are rays of N' = N + σtA x, and both corners of V at N' = 0. The term σtA is added to the column
        # of x, whose entries are `of_x`.
        inner, face = self._inner, int(self._parts.joint_face[joint])
        lean, mu = 1.0 / inner.bending, float(inner.friction[face])
        strength = float(inner.shear[face] - mu * inner.tension[face])
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
        sums: dict[int, float] = {}
        for part, arm in ends:
            at = self._place[int(part[joint])]
            for k, value in enumerate((arm[joint] @ force).tolist()):
                sums[at + k] = sums.get(at + k, 0.0) + value
        return list(sums.items())

    def _keep(self, found: list[tuple[int, float]], row: int | None = None) -> None:
        """Store a column without its zero entries.

        found: entries (row, value) of the column.
        """
        found = sorted([*found, *([] if row is None else [(row, 1.0)])])
        found = [(at, value) for at, value in found if value != 0.0]
        self._columns.append(([at for at, _ in found], [value for _, value in found]))


@dataclass(frozen=True)
class _Copies:
    """Copies of faces under one label, each for one block that the face touches."""

    # face, block: (k,) face and block of each copy
    face: Ints
    block: Ints
    column: Ints  # (k, q) columns of its resultants
    active: Bools  # (k, q) True if a resultant is used


class ConeProgram(AllBlocksProgram):
    """Program min −λ of the block relaxation for any yield set; TypeError if cones have different sizes.

    Columns: x of each block; resultants and extra variables of each side, then of each joint; λ of each block times x;
    λ. Rows: cover of every element, equal shares of λ, equal forces on shared faces, equilibrium of each part, linear
    rows, cones. Attributes are those of `BlockProgram`.
    """

    def __init__(self, template: Template, parts: BlockParts) -> None:
        self._template, self._parts, self._entries = template, parts, SparseEntries()
        pattern, q = template.yield_set.pattern, template.assembly.freedoms
        sizes = set(pattern.cones)
        if len(sizes) > 1:
            raise TypeError("cones of more than one size")
        self._cone = sizes.pop() if sizes else 1
        count = len(template.assembly.interfaces)
        every = np.ones(count, dtype=bool)
        p = np.arange(parts.blocks)
        columns, rows = OwnedIndices(), OwnedIndices()
        self.x = columns.of(p)
        self._face_columns = _lists(pattern.face, pattern.column, count, q)
        sides = self._copies(columns, parts.side_face, parts.side_block, template.yield_set.active(every))
        joints = self._copies(columns, parts.joint_face, parts.joint_block, template.yield_set.active(~every))
        block_load = columns.of(p)
        load = columns.append_unowned(1)
        self._begin_rows(rows, parts, q)
        self._add_loads(parts, block_load, load)
        self._add_forces(sides, joints)
        upper, lower, above_zero = rows.of(p), rows.of(p), rows.of(np.concatenate([p, p]))
        self._bound_loads(upper, lower, block_load)
        self._entries.add(above_zero, np.concatenate([self.x, block_load]), -1.0)
        for linear in (True, False):
            for copies, dry in ((sides, True), (joints, False)):
                self._sets(rows, copies, dry=dry, linear=linear)
            if linear:
                self._linear = len(rows)
        self._finish(rows, columns)

    def _add_forces(self, sides: _Copies, joints: _Copies) -> None:
        """Add the resultants of sides and joints to the balance of parts, and equal ones on both sides of a face."""
        parts, q = self._parts, self._template.assembly.freedoms
        for copies, part, arm in (
            (sides, parts.side_part, parts.arm),
            (joints, parts.joint_a, parts.arm_a),
            (joints, parts.joint_b, parts.arm_b),
        ):
            for turn in range(q):
                vectors = arm[:, :, turn] * copies.active[:, turn, None]
                self._entries.add_vectors(self.balance[part], copies.column[:, turn], vectors)
        shared = np.flatnonzero(parts.side_shared >= 0)
        rows = self.equal_forces[parts.side_shared[shared]]
        signs = parts.sign[shared, None] * sides.active[shared]
        self._entries.add(rows.ravel(), sides.column[shared].ravel(), signs.ravel())

    def _copies(self, columns: OwnedIndices, face: Ints, block: Ints, active: Bools) -> _Copies:
        """Create the columns of copies of faces (k,) for blocks (k,): active (m, q) resultants, extra variables."""
        q = self._template.assembly.freedoms
        number = np.array([len(column) for column in self._face_columns], dtype=np.int64)[face]
        given = columns.of(np.repeat(block, number))
        begin = given[0] + np.cumsum(number) - number if len(given) else np.zeros(len(face), dtype=np.int64)
        # The resultants come first among the columns of a face.
        return _Copies(face, block, begin[:, None] + np.arange(q), active[face])

    def _sets(self, rows: OwnedIndices, copies: _Copies, *, dry: bool, linear: bool) -> None:
        """Add the rows h x − G F of copies of faces: either the linear rows or the cones."""
        # h and G are right-hand sides and coefficients of a `RowPattern`, x is the share of the block of a copy, F its
        # resultants.
        pattern = self._template.yield_set.pattern
        count = len(self._template.assembly.interfaces)
        values, rhs = (pattern.dry, pattern.h_dry) if dry else (pattern.inner, pattern.h_inner)
        chosen = (np.arange(len(rhs)) < pattern.linear) == linear
        if linear:  # Leave out rows that this label does not use.
            chosen &= np.bincount(pattern.row, weights=abs(values), minlength=len(rhs)) > 0.0
        face_rows = _lists(pattern.row_face[chosen], np.flatnonzero(chosen), count)
        # place of each row and column of the pattern among those of its face
        place_row = np.zeros(len(rhs), dtype=np.int64)
        place_column: dict[int, int] = {}
        for listed in face_rows:
            place_row[listed] = np.arange(len(listed))
        for listed in self._face_columns:
            place_column |= {int(column): k for k, column in enumerate(listed)}
        used = chosen[pattern.row] & (values != 0.0)
        entries = _lists(pattern.face[used], np.flatnonzero(used), count)
        number = np.array([len(listed) for listed in face_rows], dtype=np.int64)[copies.face]
        given = rows.of(np.repeat(copies.block, number))
        begin = (given[0] if len(given) else 0) + np.cumsum(number) - number
        local = np.array([place_column[int(column)] for column in pattern.column], dtype=np.int64)
        for face in np.unique(copies.face).tolist():
            of_face = np.flatnonzero(copies.face == face)
            which = entries[face]
            row = begin[of_face][:, None] + place_row[pattern.row[which]]
            column = copies.column[of_face, 0][:, None] + local[which]
            self._entries.add(row.ravel(), column.ravel(), np.tile(values[which], len(of_face)))
            with_rhs = face_rows[face][rhs[face_rows[face]] != 0.0]
            row = begin[of_face][:, None] + place_row[with_rhs]
            blocks = np.repeat(copies.block[of_face], len(with_rhs))
            self._entries.add(row.ravel(), blocks, np.tile(-rhs[with_rhs], len(of_face)))


def _lists(face: Ints, value: Ints, count: int, freedoms: int = 0) -> list[Ints]:
    """Group integer values by face: the distinct values (k,) of each, ascending."""
    face = np.concatenate([face, np.repeat(np.arange(count), freedoms)])
    value = np.concatenate([value, np.arange(count * freedoms)])
    pairs = np.unique(np.column_stack([face, value]), axis=0)
    return np.split(pairs[:, 1], np.searchsorted(pairs[:, 0], np.arange(1, count)))
