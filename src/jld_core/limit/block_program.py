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
        occurrence = np.arange(len(faces)) - np.searchsorted(faces[order], faces[order])
        for pass_number in range(int(occurrence.max(initial=-1)) + 1):
            selected = order[occurrence == pass_number]
            by_face = np.zeros((count, jumps.shape[1]))
            by_face[faces[selected]] = jumps[selected]
            values[selected] = measure(by_face, labels)[faces[selected]]
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
        shortfall = -self.wedge.margin(jumps, faces)
        shortfall = np.where(shortfall > 0.0, shortfall + tolerances.ROUNDING * abs(jumps).sum(axis=1), 0.0)
        opened_jumps = jumps.copy()
        opened_jumps[:, 0] += shortfall
        cost = np.zeros(len(faces))
        np.multiply(shortfall, self.caps[faces], out=cost, where=shortfall > 0.0)
        return np.asarray(self.wedge.dissipation(opened_jumps, faces) + cost)

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
        half = self.jumps_of_parts(velocity) + self.sign[:, None] * still[self.side_shared]
        inner = np.einsum("kij,ki->kj", self.arm_a, velocity[self.joint_a])
        inner += np.einsum("kij,ki->kj", self.arm_b, velocity[self.joint_b])
        return half, inner

    def jumps_of_parts(self, velocity: Floats) -> Floats:
        """Compute the half jumps (s, q) at the sides of velocities (k, q) while all faces stand still."""
        return np.asarray(np.einsum("kij,ki->kj", self.arm, velocity[self.side_part]))

    def halved(self, motion: Motion) -> tuple[Floats, Floats]:
        """Convert a motion to velocities of parts (k, q) and of faces (f, q), halfway between their sides."""
        q = self.dead.shape[1]
        velocity = motion.velocity.reshape(-1, q)[self.part_element]
        wall, is_shared = np.zeros((self.shared, q)), self.side_shared >= 0
        half_jump = self.sign[:, None] * (0.5 * motion.jumps[self.side_face] - self.jumps_of_parts(velocity))
        wall[self.side_shared[is_shared]] = half_jump[is_shared]
        return velocity, wall

    def jump_size(self, velocity: Floats) -> Floats:
        """Return the sum of absolute terms (j,) of the jump at each joint, which bounds its rounding error."""
        size = np.einsum("kij,ki->k", abs(self.arm_a), abs(velocity[self.joint_a]))
        return np.asarray(size + np.einsum("kij,ki->k", abs(self.arm_b), abs(velocity[self.joint_b])))


def block_parts(template: Template, members: Sequence[Sequence[int]], inside: Sequence[Sequence[int]]) -> BlockParts:
    """Create the parts, sides and joints of possible blocks, in the order of blocks and of their elements."""
    assembly = template.assembly
    q = assembly.freedoms
    free, faces = assembly.elements.free, assembly.interfaces
    free_index = np.full(len(assembly.elements), -1, dtype=np.int64)
    free_index[free] = np.arange(len(free))
    around: dict[int, list[int]] = {int(element): [] for element in free}
    for face, pair in enumerate(zip(faces.a.tolist(), faces.b.tolist(), strict=True)):
        for element in pair:
            if element in around:
                around[element].append(face)
    parts: list[tuple[int, int]] = []  # block, free element
    sides: list[tuple[int, int]] = []  # part, face
    joints: list[tuple[int, int, int, int]] = []  # block, face, parts on its sides a and b
    for block, (elements, faces_inside) in enumerate(zip(members, inside, strict=True)):
        part_of = {element: len(parts) + i for i, element in enumerate(elements)}
        parts += [(block, int(free_index[element])) for element in elements]
        inner_faces = set(faces_inside)
        outer_faces = [(element, face) for element in elements for face in around[element] if face not in inner_faces]
        sides += [(part_of[element], face) for element, face in outer_faces]
        joints += [(block, face, part_of[int(faces.a[face])], part_of[int(faces.b[face])]) for face in faces_inside]
    part_block, part_element = np.array(parts, dtype=np.int64).reshape(-1, 2).T
    side_part, side_face = np.array(sides, dtype=np.int64).reshape(-1, 2).T
    joint_block, joint_face, joint_a, joint_b = np.array(joints, dtype=np.int64).reshape(-1, 4).T
    between_free = (free_index[faces.a] >= 0) & (free_index[faces.b] >= 0)
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
        sign=np.where(free_index[faces.a[side_face]] == part_element[side_part], 1.0, -1.0),
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


# Share of the threshold that the λ of every block must reach. Values nearer to 1 make the relaxation tighter. The
# program is then often infeasible, and an infeasibility proof gives a worse bound than a low λ.
LEAST_SHARE: Final = 0.5
_LEAST_CAP: Final = 1e-9  # least normal force, scaled, by which the row of a cap is divided


class AllBlocksProgram:
    """Program min −λ of the relaxation by blocks for all p possible blocks; `of` selects allowed ones."""

    # Rows: equations up to `_equalities`, linear inequalities up to `_linear`, cones of `_cone` rows. `_upper_entries`
    # and `_lower_entries` are those that bound λ of each block. A row or column of owner −1 belongs to no block.

    shape: tuple[int, int]
    x: Ints  # (p,) columns of the share of each block
    cover: Ints  # (n,) rows: the shares of the blocks of an element add up to 1
    share: Ints  # (n,) rows: the λ of the blocks of an element, times their shares, add up to λ
    equal_forces: Ints  # (f, q) rows: equal forces on both sides of each shared face
    balance: Ints  # (k, q) rows: equilibrium of each part
    _entries: SparseEntries
    _table: tuple[Ints, Ints, Floats]  # rows, columns and values of all entries
    _rhs: Floats
    _row_block: Ints
    _column_block: Ints
    _upper_entries: slice
    _lower_entries: slice
    _equalities: int
    _linear: int
    _cone: int

    def of(self, allowed: Bools, threshold: float, most: float) -> tuple[ConicProgram, Ints, Ints]:
        """Create the program of allowed blocks (p,), λ in [threshold, most]; also its rows and columns among all."""
        row, column, value = self._table
        value = value.copy()
        value[self._upper_entries] = -most
        value[self._lower_entries] = LEAST_SHARE * threshold
        block_kept = np.append(allowed, True)  # Index −1, for rows and columns of no block, is always kept.
        rows, columns = block_kept[self._row_block], block_kept[self._column_block]
        entry_kept = rows[row] & columns[column]
        # Drop the rows of faces with no remaining forces.
        row_used = np.zeros(self.shape[0], dtype=bool)
        row_used[row[entry_kept]] = True
        row_used[self._linear :] = True  # Keep each cone as a whole.
        rows &= row_used | (self._rhs != 0.0)
        new_row, new_column = np.cumsum(rows) - 1, np.cumsum(columns) - 1
        shape = int(rows.sum()), int(columns.sum())
        row, column, value = new_row[row[entry_kept]], new_column[column[entry_kept]], value[entry_kept]
        matrix = sp.csc_array((value, (row, column)), shape=shape)
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
        self.balance = rows.append(np.repeat(parts.part_block, q)).reshape(-1, q)
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
        blocks = np.arange(parts.blocks)
        of_cohesive, of_joint = parts.side_block[self.cohesive], parts.joint_block
        columns, rows = OwnedIndices(), OwnedIndices()
        self.x = columns.append(blocks)
        rays = columns.append(np.repeat(parts.side_block, 4)).reshape(-1, 4)
        resultants = columns.append(np.repeat(of_joint, 3)).reshape(-1, 3)
        shears = columns.append(of_cohesive)
        block_load = columns.append(blocks)
        load = columns.append_unowned(1)
        self._begin_rows(rows, parts, Q)
        shear = rows.append(np.repeat(of_joint, 2)).reshape(-1, 2)
        cohesive_shear = rows.append(np.repeat(of_cohesive, 2)).reshape(-1, 2)
        upper, lower = rows.append(blocks), rows.append(blocks)
        if caps is not None:
            self._add_caps(dry, inner, caps, rays, resultants, rows)
        positive = np.concatenate([self.x, rays.ravel(), resultants[:, :2].ravel(), block_load])
        above_zero = rows.append(columns.owner[positive])

        self._add_loads(parts, block_load, load)
        self._add_side_forces(dry, rays, shears)
        self._add_joint_forces(inner, resultants)
        self._add_shear_rows(inner, resultants, shear)
        for number, sign in enumerate((1.0, -1.0)):
            self._entries.add(cohesive_shear[:, number], shears, sign)
            self._entries.add(cohesive_shear[:, number], of_cohesive, -dry.shear[parts.side_face[self.cohesive]])
        self._bound_loads(upper, lower, block_load)
        self._entries.add(above_zero, positive, -1.0)
        self._linear, self._cone = len(rows), 1
        self._finish(rows, columns)

    def _add_caps(
        self, dry: CoulombWedge, inner: CoulombWedge, caps: Floats, rays: Ints, resultants: Ints, rows: OwnedIndices
    ) -> None:
        """Add the rows N ≤ c x of sides and joints whose cap c is finite, divided by c."""
        parts, add = self._parts, self._entries.add
        for face, block, columns, normal_scale, offset in (
            (parts.side_face, parts.side_block, rays, np.maximum(1.0, dry.friction), np.zeros(len(caps))),
            (parts.joint_face, parts.joint_block, resultants[:, :2], np.ones(len(caps)), inner.tension),
        ):
            capped = np.flatnonzero(np.isfinite(caps[face]))
            row, cap = rows.append(block[capped]), np.maximum(caps + offset, _LEAST_CAP)[face[capped]]
            for column in columns[capped].T:
                add(row, column, 1.0 / (normal_scale[face[capped]] * cap))
            add(row, block[capped], -1.0)

    def _add_side_forces(self, dry: CoulombWedge, rays: Ints, shears: Ints) -> None:
        """Add the forces on the dry faces around the blocks."""
        # The forces are normalised rays (1, ±μ, ±1) of the dry set, and shear without N, |V₀| ≤ c x.
        parts, cohesive, add = self._parts, self.cohesive, self._entries.add_vectors
        mu = dry.friction[parts.side_face]
        scale = np.maximum(1.0, mu)
        shared = parts.side_shared >= 0
        rows = self.equal_forces[parts.side_shared[shared]]
        for corner, (slip, moment) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
            vector = np.column_stack([1.0 / scale, slip * mu / scale, moment / scale])
            add(self.balance[parts.side_part], rays[:, corner], np.einsum("kij,kj->ki", parts.arm, vector))
            add(rows, rays[shared, corner], (parts.sign[:, None] * vector)[shared])
        add(self.balance[parts.side_part[cohesive]], shears, parts.arm[cohesive, :, 1])
        shared = shared[cohesive]
        shear_direction = parts.sign[cohesive, None] * np.eye(Q)[1]
        add(self.equal_forces[parts.side_shared[cohesive][shared]], shears[shared], shear_direction[shared])

    def _add_joint_forces(self, inner: CoulombWedge, resultants: Ints) -> None:
        """Add N = N' − σtA x with N' = r + r', m = (r − r') / bending, and V, of columns `resultants` (j, 3)."""
        parts, add, edge = self._parts, self._entries.add_vectors, 1.0 / inner.bending
        vectors = np.array([[1.0, 0.0, edge], [1.0, 0.0, -edge], [0.0, 1.0, 0.0]])
        for part, arm in ((parts.joint_a, parts.arm_a), (parts.joint_b, parts.arm_b)):
            for k, vector in enumerate(vectors):
                add(self.balance[part], resultants[:, k], arm @ vector)
            add(self.balance[part], parts.joint_block, -inner.tension[parts.joint_face][:, None] * arm[:, :, 0])

    def _add_shear_rows(self, inner: CoulombWedge, resultants: Ints, shear: Ints) -> None:
        """Add the rows |V| ≤ τA x + μN of inner faces, columns `resultants` (j, 3)."""
        # N = N' − σtA x is eliminated, so that the constant is (τA − μ σtA) x.
        parts, add = self._parts, self._entries.add
        mu = inner.friction[parts.joint_face]
        strength = inner.shear[parts.joint_face] - mu * inner.tension[parts.joint_face]
        scale = np.maximum(1.0, strength)
        frictional = np.flatnonzero(mu > 0.0)
        for k, sign in enumerate((1.0, -1.0)):
            row = shear[:, k]
            add(row, resultants[:, 2], sign / scale)
            add(row, parts.joint_block, -strength / scale)
            for ray in (0, 1):
                add(row[frictional], resultants[frictional, ray], -(mu / scale)[frictional])


class OwnedIndices:
    """Consecutive row or column indices, each with the block it belongs to (−1: none)."""

    def __init__(self) -> None:
        self.owner: Ints = np.empty(0, dtype=np.int64)

    def __len__(self) -> int:
        return len(self.owner)

    def append(self, blocks: Ints) -> Ints:
        """Append one row or column for each of the blocks (c,) and return their indices (c,)."""
        first = len(self)
        self.owner = np.concatenate([self.owner, blocks])
        return np.arange(first, len(self))

    def append_unowned(self, count: int) -> Ints:
        """Append `count` rows or columns of no block, and return their indices (count,)."""
        return self.append(np.full(count, -1))


class SparseEntries:
    """Entries of a sparse matrix, collected in groups of rows, columns and values."""

    def __init__(self) -> None:
        self._parts: list[tuple[Ints, Ints, Floats]] = []
        self._length = 0

    def add(self, row: Ints, column: Ints, value: Floats | float) -> slice:
        """Append entries at row, column (k,), and return their slice among all entries."""
        first = self._length
        self._parts.append((row, column, np.broadcast_to(np.asarray(value, dtype=float), row.shape)))
        self._length += len(row)
        return slice(first, self._length)

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
    """Columns of one block: equilibrium of its parts, shear of cohesive sides, bending of joints, then shared rows.

    `_first_row`, `_cohesive`, `_bending_row`: rows by part, side and joint; `_shared`: rows by number among all shared.
    """

    def __init__(
        self, parts: BlockParts, dry: CoulombWedge, inner: CoulombWedge, parts_of_block: Ints, sides: Ints, joints: Ints
    ) -> None:
        self._parts, self._dry, self._inner = parts, dry, inner
        self._part_numbers, self._sides, self._joints = parts_of_block, sides, joints
        self._first_row = {int(part): Q * i for i, part in enumerate(parts_of_block)}
        cohesive = sides[dry.shear[parts.side_face[sides]] > 0.0]
        self._cohesive = {int(s): Q * len(parts_of_block) + i for i, s in enumerate(cohesive)}
        self._bending_row = {int(j): Q * len(parts_of_block) + len(cohesive) + i for i, j in enumerate(joints)}
        self._rows = Q * len(parts_of_block) + len(cohesive) + len(joints)
        shared = sorted({int(f) for f in parts.side_shared[sides] if f >= 0})
        elements = [int(e) for e in parts.part_element[parts_of_block]]
        rows = [Q * f + part for f in shared for part in range(Q)]
        rows += [Q * (parts.shared + e) + part for e in elements for part in (0, 1)]
        self._shared = {row: self._rows + i for i, row in enumerate(rows)}
        self._columns: list[Column] = []

    def columns(self) -> BlockColumns:
        """Create the columns of the block: those of each side, then those of each joint."""
        parts = self._parts
        for side in self._sides.tolist():
            self._add_side(side)
        height = self._rows + len(self._shared)
        of_x, of_load = np.zeros(height), np.zeros(height)
        for part in self._part_numbers.tolist():
            first, element = self._first_row[part], Q * (parts.shared + int(parts.part_element[part]))
            of_x[first : first + Q] += parts.dead[part]
            of_load[first : first + Q] += parts.live[part]
            of_x[self._shared[element]] = 1.0
            of_load[self._shared[element + 1]] = 1.0
        for joint in self._joints.tolist():
            self._add_joint(joint, of_x)
        for row in (*self._cohesive.values(), *self._bending_row.values()):
            of_x[row] = -1.0
        columns = tuple((np.array(rows, dtype=np.int64), np.array(values)) for rows, values in self._columns)
        return BlockColumns(self._rows, np.array(list(self._shared), dtype=np.int64), columns, of_x, of_load)

    def _add_side(self, side: int) -> None:
        """Add the columns of a dry side: normalised rays, and shear ±c if it has any."""
        face = int(self._parts.side_face[side])
        mu = float(self._dry.friction[face])
        scale = max(1.0, mu)
        for slip, moment in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            self._add_side_force(side, np.array([1.0 / scale, slip * mu / scale, moment / scale]))
        if side in self._cohesive:
            for sign in (1.0, -1.0):
                self._add_side_force(side, np.array([0.0, sign * self._dry.shear[face], 0.0]), self._cohesive[side])

    def _add_side_force(self, side: int, force: Floats, row: int | None = None) -> None:
        """Add the column of a force (3,) at a side: equilibrium of the part, and the shared face."""
        parts = self._parts
        first = self._first_row[int(parts.side_part[side])]
        entries = [(first + k, value) for k, value in enumerate((parts.arm[side] @ force).tolist())]
        shared = int(parts.side_shared[side])
        if shared >= 0:
            shared_row = self._shared[Q * shared]
            entries += [(shared_row + k, value) for k, value in enumerate((parts.sign[side] * force).tolist())]
        self._store(entries, row)

    def _add_joint(self, joint: int, of_x: Floats) -> None:
        # Forces of a block are those at full strength times x, its share in the cover of the elements. With N' = N +
        # σtA x the strengths are a cone from N' = 0: its rays, and the corners ±(τA − μ σtA) of V, whose coefficients
        # sum to x by `_bending_row`. The force −σtA x is added to the column of x, `of_x`.
        inner, face = self._inner, int(self._parts.joint_face[joint])
        moment_per_push, mu = 1.0 / inner.bending, float(inner.friction[face])
        shear = float(inner.shear[face] - mu * inner.tension[face])
        for slip in (1.0, -1.0) if mu > 0.0 else (0.0,):
            for moment in (moment_per_push, -moment_per_push):
                self._store(self._joint_force(joint, np.array([1.0, slip * mu, moment])))
        for sign in (1.0, -1.0):
            self._store(self._joint_force(joint, np.array([0.0, sign * shear, 0.0])), self._bending_row[joint])
        for row, value in self._joint_force(joint, np.array([-float(inner.tension[face]), 0.0, 0.0])):
            of_x[row] += value

    def _joint_force(self, joint: int, force: Floats) -> list[tuple[int, float]]:
        """Return the entries (row, value) of a force at a joint in the equilibrium of both parts."""
        parts = self._parts
        ends = ((parts.joint_a, parts.arm_a), (parts.joint_b, parts.arm_b))
        sums: dict[int, float] = {}
        for part, arm in ends:
            first = self._first_row[int(part[joint])]
            for k, value in enumerate((arm[joint] @ force).tolist()):
                sums[first + k] = sums.get(first + k, 0.0) + value
        return list(sums.items())

    def _store(self, entries: list[tuple[int, float]], row: int | None = None) -> None:
        """Store a column of entries (row, value), without zeros, and a 1 in `row`."""
        entries = sorted([*entries, *([] if row is None else [(row, 1.0)])])
        entries = [(row_index, value) for row_index, value in entries if value != 0.0]
        self._columns.append(([row_index for row_index, _ in entries], [value for _, value in entries]))


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
        all_dry = np.ones(count, dtype=bool)
        blocks = np.arange(parts.blocks)
        columns, rows = OwnedIndices(), OwnedIndices()
        self.x = columns.append(blocks)
        self._face_columns = _group_by_face(pattern.face, pattern.column, count, q)
        sides = self._copies(columns, parts.side_face, parts.side_block, template.yield_set.active(all_dry))
        joints = self._copies(columns, parts.joint_face, parts.joint_block, template.yield_set.active(~all_dry))
        block_load = columns.append(blocks)
        load = columns.append_unowned(1)
        self._begin_rows(rows, parts, q)
        self._add_loads(parts, block_load, load)
        self._add_forces(sides, joints)
        upper, lower = rows.append(blocks), rows.append(blocks)
        above_zero = rows.append(np.concatenate([blocks, blocks]))
        self._bound_loads(upper, lower, block_load)
        self._entries.add(above_zero, np.concatenate([self.x, block_load]), -1.0)
        for linear in (True, False):
            for copies, dry in ((sides, True), (joints, False)):
                self._add_yield_rows(rows, copies, dry=dry, linear=linear)
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
            for resultant in range(q):
                vectors = arm[:, :, resultant] * copies.active[:, resultant, None]
                self._entries.add_vectors(self.balance[part], copies.column[:, resultant], vectors)
        shared = np.flatnonzero(parts.side_shared >= 0)
        rows = self.equal_forces[parts.side_shared[shared]]
        signs = parts.sign[shared, None] * sides.active[shared]
        self._entries.add(rows.ravel(), sides.column[shared].ravel(), signs.ravel())

    def _copies(self, columns: OwnedIndices, face: Ints, block: Ints, active: Bools) -> _Copies:
        """Create the columns of copies of faces (k,) for blocks (k,): active (m, q) resultants, extra variables."""
        q = self._template.assembly.freedoms
        width = np.array([len(column) for column in self._face_columns], dtype=np.int64)[face]
        indices = columns.append(np.repeat(block, width))
        begin = indices[0] + np.cumsum(width) - width if len(indices) else np.zeros(len(face), dtype=np.int64)
        # The resultants come first among the columns of a face.
        return _Copies(face, block, begin[:, None] + np.arange(q), active[face])

    def _add_yield_rows(self, rows: OwnedIndices, copies: _Copies, *, dry: bool, linear: bool) -> None:
        """Add the rows h x − G F of copies of faces: either the linear rows or the cones."""
        # h and G are right-hand sides and coefficients of a `RowPattern`, x is the share of the block of a copy, F its
        # resultants.
        pattern = self._template.yield_set.pattern
        count = len(self._template.assembly.interfaces)
        values, rhs = (pattern.dry, pattern.h_dry) if dry else (pattern.inner, pattern.h_inner)
        chosen = (np.arange(len(rhs)) < pattern.linear) == linear
        if linear:  # Leave out rows that this label does not use.
            chosen &= np.bincount(pattern.row, weights=abs(values), minlength=len(rhs)) > 0.0
        face_rows = _group_by_face(pattern.row_face[chosen], np.flatnonzero(chosen), count)
        # number of each row and column of the pattern among those of its face
        rank_of_row = np.zeros(len(rhs), dtype=np.int64)
        rank_of_column: dict[int, int] = {}
        for members in face_rows:
            rank_of_row[members] = np.arange(len(members))
        for members in self._face_columns:
            rank_of_column |= {int(column): k for k, column in enumerate(members)}
        in_use = chosen[pattern.row] & (values != 0.0)
        entries = _group_by_face(pattern.face[in_use], np.flatnonzero(in_use), count)
        height = np.array([len(members) for members in face_rows], dtype=np.int64)[copies.face]
        indices = rows.append(np.repeat(copies.block, height))
        begin = (indices[0] if len(indices) else 0) + np.cumsum(height) - height
        column_rank = np.array([rank_of_column[int(column)] for column in pattern.column], dtype=np.int64)
        for face in np.unique(copies.face).tolist():
            copies_of_face = np.flatnonzero(copies.face == face)
            face_entries = entries[face]
            row = begin[copies_of_face][:, None] + rank_of_row[pattern.row[face_entries]]
            column = copies.column[copies_of_face, 0][:, None] + column_rank[face_entries]
            self._entries.add(row.ravel(), column.ravel(), np.tile(values[face_entries], len(copies_of_face)))
            with_rhs = face_rows[face][rhs[face_rows[face]] != 0.0]
            row = begin[copies_of_face][:, None] + rank_of_row[with_rhs]
            blocks = np.repeat(copies.block[copies_of_face], len(with_rhs))
            self._entries.add(row.ravel(), blocks, np.tile(-rhs[with_rhs], len(copies_of_face)))


def _group_by_face(face: Ints, value: Ints, count: int, freedoms: int = 0) -> list[Ints]:
    """Group integer values by face: the distinct values (k,) of each, ascending."""
    face = np.concatenate([face, np.repeat(np.arange(count), freedoms)])
    value = np.concatenate([value, np.arange(count * freedoms)])
    pairs = np.unique(np.column_stack([face, value]), axis=0)
    return np.split(pairs[:, 1], np.searchsorted(pairs[:, 0], np.arange(1, count)))
