"""Blocks that are not decided: what bounds λ over all ways to choose blocks that cover a planar assembly.

Where the possible blocks p can be listed, a segmentation is a choice x_p ∈ {0, 1} with every element in exactly one.
The **relaxation by blocks** gives every block forces of its own: on the faces around it in x_p times the dry set, on
those inside in x_p times the inner one (`YieldSet.wedge`), in equilibrium under x_p times its weight and its share of
λ; the forces on a face agree on both sides, and the shares agree on all elements (docs/method.md (6.5), (6.6)). It is
much tighter than face by face (`relaxation`) where blocks are of a few elements, as it knows that a block is one body.

Its dual is a mechanism for every block: velocities u of each element of each block, and a velocity w of each face,
that the blocks on either side open against. For a load factor θ a block then has an **excess**

    e_p = θ b_λ·u_p + b·u_p − Σ_{inside} D_inner(J) − Σ_{around} D_dry(half jump),

and a segmentation whose blocks have Σ e_p > 0 does not reach θ. Numbers v on elements bound Σ e_p from below for all
choices at once: Σ e_p ≥ Σ v + Σ_p min(0, e_p − Σ_{e ∈ p} v_e). All of it is computed here from whatever the solver
returned, with no trust in its status.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.bounds import Motion, usable
from jld_core.mechanics import Wedge
from jld_core.program import ConicProgram, pack
from jld_core.solvers import ClarabelSolver, Solver

_RESIDUAL: Final = 1e-7
"""Asked of the solver: bounds are computed from its answer, so that it need not be exact."""

_FINE: Final = 1e-10
"""Asked where the answer is nearer to the threshold than `_NEAR`."""

_NEAR: Final = 1e-4

_LEAST: Final = 0.5
"""Share of the threshold that the λ of every block must reach: nearer to one the relaxation is tighter, but then it
has often no point at all, and proofs of that are worse than those of a low λ."""

_STEPS: Final = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
"""How far above the solver's λ, relative, a bound is tried."""

_Q: Final = 3


@dataclass(frozen=True)
class Choice:
    """What the relaxation says of the segmentations made of some blocks.

    bound: scaled λ that none of them exceeds, inf where none was found. refuted: none reaches the threshold.
    share: (p,) x of the solver in [0, 1], no proof of anything. useless: (p,) blocks that no segmentation holds that
    reaches the threshold.
    """

    bound: float
    refuted: bool
    share: Floats
    useless: Bools


@dataclass(frozen=True)
class _Mechanism:
    """Per block: live work, dissipation less dead work, and size of the sums; per element: dual numbers v, σ."""

    live: Floats
    cost: Floats
    size: Floats
    price: Floats
    portion: Floats


class BlockRelaxation:
    """Upper bounds on λ over the segmentations of one assembly into blocks that may be chosen.

    members: elements of each block. inside: faces inside each. Everything is scaled as in `Template`.
    """

    def __init__(
        self, analysis: LimitAnalysis, members: Sequence[Sequence[int]], inside: Sequence[Sequence[int]]
    ) -> None:
        opening = analysis.interior.opening()
        if not applies_to(analysis) or opening is None:
            raise TypeError("no relaxation by blocks is known of this assembly")
        self.template = analysis.template
        self._dry, self._inner = _wedges(analysis)
        self.solves = 0
        self._count = len(members)
        self._lay_out(members, inside)
        self._state_program()
        self._open(opening)
        self._quick = ClarabelSolver(_RESIDUAL)
        self._careful = ClarabelSolver(_FINE, iterative_refinement_enable=True)

    # --- layout -----------------------------------------------------------------------------------------

    def _lay_out(self, members: Sequence[Sequence[int]], inside: Sequence[Sequence[int]]) -> None:
        """Parts (an element of a block), sides (a part and a face around its block), joints (a face inside)."""
        assembly = self.template.assembly
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
        self._part_block, self._part_place = np.array(parts, dtype=np.int64).reshape(-1, 2).T
        self._side_part, self._side_face = np.array(sides, dtype=np.int64).reshape(-1, 2).T
        table = np.array(joints, dtype=np.int64).reshape(-1, 4)
        self._joint_block, self._joint_face, self._joint_a, self._joint_b = table.T
        self._side_block = self._part_block[self._side_part]
        # which side of its face a part is on, and A's 3 × 3 blocks there
        at_a = place[faces.a[self._side_face]] == self._part_place[self._side_part]
        self._sign = np.where(at_a, 1.0, -1.0)
        self._arm = self._blocks(self._part_place[self._side_part], self._side_face)
        self._arm_a = self._blocks(self._part_place[self._joint_a], self._joint_face)
        self._arm_b = self._blocks(self._part_place[self._joint_b], self._joint_face)
        both = (place[faces.a] >= 0) & (place[faces.b] >= 0)
        self._shared = np.full(len(faces), -1, dtype=np.int64)
        self._shared[both] = np.arange(int(both.sum()))
        self._dead = self.template.dead.reshape(-1, _Q)[self._part_place]
        self._live = self.template.live.reshape(-1, _Q)[self._part_place]

    def _blocks(self, element: Ints, face: Ints) -> Floats:
        """A_eq (k, 3, 3) of elements (k,), by place among the free ones, and faces (k,)."""
        if not len(element):
            return np.zeros((0, _Q, _Q))
        table = sp.csr_array(self.template.matrix)
        rows = (_Q * element[:, None] + np.arange(_Q))[:, :, None]
        columns = (_Q * face[:, None] + np.arange(_Q))[:, None, :]
        rows, columns = np.broadcast_arrays(rows, columns)
        return np.asarray(table[rows.ravel(), columns.ravel()]).reshape(-1, _Q, _Q)

    def _state_program(self) -> None:
        """min −λ over all blocks: columns x, rays of dry sets, (two rays, V) of inner ones, own λ, λ."""
        dry, glued = self._dry, self._inner
        p, k, s, j = self._count, len(self._part_block), len(self._side_part), len(self._joint_block)
        elements, shared = len(self.template.assembly.elements.free), int((self._shared >= 0).sum())
        stuck = self._stuck = np.flatnonzero(dry.cohesion[self._side_face] > 0.0)
        c = len(stuck)
        ray, bend, stick, own = p, p + 4 * s, p + 4 * s + 3 * j, p + 4 * s + 3 * j + c
        load = own + p
        cover, share = 0, elements
        agree, balance = 2 * elements, 2 * elements + _Q * shared
        shear = balance + _Q * k
        limit = shear + 2 * j + 2 * c
        entries = _Entries()
        entries.add(cover + self._part_place, self._part_block, 1.0)
        entries.add(share + self._part_place, own + self._part_block, 1.0)
        entries.add(share + np.arange(elements), np.full(elements, load), -1.0)
        # rays (1, ±μ, ±1) of dry faces, over their size
        mu = dry.friction[self._side_face]
        size = np.maximum(1.0, mu)
        meets = self._shared[self._side_face]
        for turn, (slip, tip) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
            vector = np.column_stack([1.0 / size, slip * mu / size, tip / size])
            column = ray + 4 * np.arange(s) + turn
            entries.add_vectors(balance + _Q * self._side_part, column, np.einsum("kij,kj->ki", self._arm, vector))
            known = meets >= 0
            entries.add_vectors(agree + _Q * meets[known], column[known], (self._sign[:, None] * vector)[known])
        # cohesion: V₀ besides, |V₀| ≤ c x
        entries.add_vectors(balance + _Q * self._side_part[stuck], stick + np.arange(c), self._arm[stuck, :, 1])
        known = meets[stuck] >= 0
        across = self._sign[stuck, None] * np.eye(_Q)[1]
        entries.add_vectors(agree + _Q * meets[stuck][known], stick + np.flatnonzero(known), across[known])
        # N = N' − σtA x with N' = r + r', m = (r − r')/3
        for part, arm in ((self._joint_a, self._arm_a), (self._joint_b, self._arm_b)):
            row = balance + _Q * part
            lean = 1.0 / glued.bending
            for turn, vector in enumerate((np.array([1.0, 0.0, lean]), np.array([1.0, 0.0, -lean]), np.eye(3)[1])):
                entries.add_vectors(row, bend + 3 * np.arange(j) + turn, arm @ vector)
            pull = -glued.tension[self._joint_face][:, None] * arm[:, :, 0]
            entries.add_vectors(row, self._joint_block, pull)
        entries.add_vectors(balance + _Q * np.arange(k), self._part_block, self._dead)
        entries.add_vectors(balance + _Q * np.arange(k), own + self._part_block, self._live)
        # |V| ≤ τA x + μN: with N' − σtA x for N what is left of τA
        mu = glued.friction[self._joint_face]
        strength = glued.cohesion[self._joint_face] - mu * glued.tension[self._joint_face]
        scale = np.maximum(1.0, strength)
        rubs = np.flatnonzero(mu > 0.0)
        for turn, sign in enumerate((1.0, -1.0)):
            row = shear + 2 * np.arange(j) + turn
            entries.add(row, bend + 3 * np.arange(j) + 2, sign / scale)
            entries.add(row, self._joint_block, -strength / scale)
            for bent in (0, 1):
                entries.add(row[rubs], bend + 3 * rubs + bent, -(mu / scale)[rubs])
            row = shear + 2 * j + 2 * np.arange(c) + turn
            entries.add(row, stick + np.arange(c), sign)
            entries.add(row, self._side_block[stuck], -dry.cohesion[self._side_face[stuck]])
        entries.add(limit + np.arange(p), own + np.arange(p), 1.0)
        self._limits = entries.add(limit + np.arange(p), np.arange(p), -1.0)
        entries.add(limit + p + np.arange(p), own + np.arange(p), -1.0)
        self._floors = entries.add(limit + p + np.arange(p), np.arange(p), 1.0)
        limit += p
        bounded = np.ones(load, dtype=bool)
        bounded[bend + 2 : stick : 3] = False
        bounded[stick:own] = False
        positive = np.flatnonzero(bounded)
        entries.add(limit + p + np.arange(len(positive)), positive, -1.0)
        self._equalities = shear
        rows = limit + p + len(positive)
        self._rhs = np.zeros(rows)
        self._rhs[cover : cover + elements] = 1.0
        self._entries, self._shape = entries.finished(), (rows, load + 1)
        owner = np.concatenate(
            [
                np.arange(p),
                np.repeat(self._side_block, 4),
                np.repeat(self._joint_block, 3),
                self._side_block[stuck],
                np.arange(p),
                [-1],
            ]
        )
        self._column_block = owner
        self._row_block = np.concatenate(
            [
                np.full(balance, -1),
                np.repeat(self._part_block, _Q),
                np.repeat(self._joint_block, 2),
                np.repeat(self._side_block[stuck], 2),
                np.tile(np.arange(p), 2),
                owner[positive],
            ]
        )
        self._places = (cover, share, agree, balance)

    def _open(self, opening: Motion) -> None:
        """The motion that opens all faces, divided between both sides of each, and the least it opens any."""
        velocity = opening.velocity.reshape(-1, _Q)[self._part_place]
        half = 0.5 * opening.jumps[self._side_face]
        own = np.einsum("kij,ki->kj", self._arm, velocity[self._side_part])
        wall = np.zeros((int((self._shared >= 0).sum()), _Q))
        meets = self._shared[self._side_face]
        known = meets >= 0
        wall[meets[known]] = (self._sign[:, None] * (half - own))[known]
        self._opening = velocity, wall
        self._opening_margin = self._margin(velocity, wall)
        if not self._opening_margin > 0.0:
            raise ArithmeticError("the motion that opens all faces does not open them on both sides")

    # --- solving ----------------------------------------------------------------------------------------

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        """What is known of the segmentations into allowed blocks (p,).

        threshold: scaled λ that segmentations must reach to be of interest. most: scaled λ that those allowed do not
        exceed, finite.
        """
        found = self._choose(allowed, threshold, most, self._quick)
        if found.refuted or found.bound > threshold + _NEAR * max(1.0, abs(threshold)):
            return found
        # segmentations as strong as the best one known are refuted by a hair
        return self._choose(allowed, threshold, found.bound, self._careful)

    def _choose(self, allowed: Bools, threshold: float, most: float, route: Solver) -> Choice:
        program, rows, columns = self._program(allowed, threshold, most)
        raw = route.solve(program)
        self.solves += 1
        dual, point = np.zeros(self._shape[0]), np.zeros(self._shape[1])
        dual[rows], point[columns] = raw.dual, raw.point
        share, nothing = np.clip(np.nan_to_num(point[: self._count]), 0.0, 1.0), np.zeros(self._count, dtype=bool)
        mechanism = self._repair(dual, allowed, most) if usable(dual) else None
        if mechanism is None:
            return Choice(most, False, share, nothing)
        # what bounds Σ e_p is concave in θ: above zero at two load factors, it is so between them
        end, spare_end = self._excess(mechanism, most, allowed)
        excess, spare = self._excess(mechanism, threshold, allowed)
        useless = allowed & (excess + spare > 0.0) & (end + spare_end > 0.0)
        if not end > 0.0:
            return Choice(most, False, share, useless)
        if excess > 0.0:
            return Choice(min(most, threshold), True, share, useless)
        start = float(mechanism.price.sum())
        for step in _STEPS:
            tried = start + step * max(1.0, abs(start))
            if 0.0 <= tried < most and self._excess(mechanism, tried, allowed)[0] > 0.0:
                return Choice(tried, False, share, useless)
        return Choice(most, False, share, useless)

    def _program(self, allowed: Bools, threshold: float, most: float) -> tuple[ConicProgram, Ints, Ints]:
        """The program of the allowed blocks alone, and which rows and columns of the whole it has."""
        row, column, value = self._entries
        value = value.copy()
        value[self._limits] = -most
        value[self._floors] = _LEAST * threshold
        keep = np.append(allowed, True)  # place −1: rows and columns of no block
        rows, columns = keep[self._row_block], keep[self._column_block]
        here = rows[row] & columns[column]
        # a face that only blocks around it are left of has nothing to agree on
        used = np.zeros(self._shape[0], dtype=bool)
        used[row[here]] = True
        rows &= used | (self._rhs != 0.0)
        new_row, new_column = np.cumsum(rows) - 1, np.cumsum(columns) - 1
        shape = int(rows.sum()), int(columns.sum())
        matrix = sp.csc_array((value[here], (new_row[row[here]], new_column[column[here]])), shape=shape)
        objective = np.zeros(shape[1])
        objective[-1] = -1.0
        equal = int(rows[: self._equalities].sum())
        program = pack(matrix, self._rhs[rows], objective, equal, shape[0] - equal, ())
        return program, np.flatnonzero(rows), np.flatnonzero(columns)

    # --- proof ------------------------------------------------------------------------------------------

    def _jumps(self, velocity: Floats, wall: Floats) -> tuple[Floats, Floats]:
        """Half jumps (s, 3) at the sides, jumps (j, 3) at the joints, of parts (k, 3) and shared faces (f, 3)."""
        still = np.vstack([wall, np.zeros((1, _Q))])  # place −1: supports do not move
        half = np.einsum("kij,ki->kj", self._arm, velocity[self._side_part])
        half += self._sign[:, None] * still[self._shared[self._side_face]]
        inner = np.einsum("kij,ki->kj", self._arm_a, velocity[self._joint_a])
        inner += np.einsum("kij,ki->kj", self._arm_b, velocity[self._joint_b])
        return half, inner

    def _margin(self, velocity: Floats, wall: Floats, allowed: Bools | None = None) -> float:
        half, inner = self._jumps(velocity, wall)
        margins = self._opens(half, inner)
        if allowed is not None:
            margins = margins[np.concatenate([allowed[self._side_block], allowed[self._joint_block]])]
        return float(margins.min(initial=np.inf))

    def _opens(self, half: Floats, inner: Floats) -> Floats:
        """By how much the jumps are ones of finite dissipation."""
        return np.concatenate([self._dry.margin(half, self._side_face), self._inner.margin(inner, self._joint_face)])

    def _repair(self, dual: Floats, allowed: Bools, most: float) -> _Mechanism | None:
        """Velocities from multipliers, opened until every dissipation is finite, and their sums for each block."""
        cover, share, agree, balance = self._places
        velocity = dual[balance : balance + _Q * len(self._part_block)].reshape(-1, _Q)
        wall = dual[agree:balance].reshape(-1, _Q)
        margin = self._margin(velocity, wall, allowed)
        if margin < 0.0:
            more = -1.01 * margin / self._opening_margin
            velocity, wall = velocity + more * self._opening[0], wall + more * self._opening[1]
            if self._margin(velocity, wall, allowed) < 0.0:
                return None
        half, inner = self._jumps(velocity, wall)
        spent = self._inner.dissipation(inner, self._joint_face)
        live, dead, size = np.zeros(self._count), np.zeros(self._count), np.zeros(self._count)
        np.add.at(live, self._part_block, (self._live * velocity).sum(axis=1))
        np.add.at(dead, self._part_block, (self._dead * velocity).sum(axis=1))
        cost = -dead
        np.add.at(cost, self._joint_block, spent)
        stuck = self._stuck
        cohesion, block = self._dry.cohesion[self._side_face[stuck]], self._side_block[stuck]
        np.add.at(cost, block, cohesion * abs(half[stuck, 1]))
        # what rounding may take counts before terms cancel; a jump is six products, far fewer than ROUNDING allows for
        work = (abs(self._dead) + most * abs(self._live)) * abs(velocity)
        np.add.at(size, self._part_block, work.sum(axis=1))
        strength = self._inner.tension[self._joint_face] + self._inner.cohesion[self._joint_face]
        speed = np.einsum("kij,ki->k", abs(self._arm_a), abs(velocity[self._joint_a]))
        speed += np.einsum("kij,ki->k", abs(self._arm_b), abs(velocity[self._joint_b]))
        np.add.at(size, self._joint_block, 1e-2 * strength * speed)
        speed = np.einsum("kij,ki->k", abs(self._arm[stuck]), abs(velocity[self._side_part[stuck]]))
        still = np.append(abs(wall).sum(axis=1), 0.0)
        np.add.at(size, block, 1e-2 * cohesion * (speed + still[self._shared[self._side_face[stuck]]]))
        return _Mechanism(live, cost, size, dual[cover:share], -dual[share:agree])

    def _excess(self, mechanism: _Mechanism, load: float, allowed: Bools) -> tuple[float, Floats]:
        """Σ e_p of any choice at least, less what rounding may take; and (p,) how much more of one with block p."""
        value = load * mechanism.portion - mechanism.price
        held = np.zeros(self._count)
        np.add.at(held, self._part_block, value[self._part_place])
        slack = load * mechanism.live - mechanism.cost - held
        size = mechanism.size + abs(held)
        noise = tolerances.ROUNDING * (float(size[allowed].sum()) + float(abs(value).sum()))
        excess = float(value.sum()) + float(np.minimum(slack[allowed], 0.0).sum()) - noise
        return excess, np.maximum(slack, 0.0)


def applies_to(analysis: LimitAnalysis) -> bool:
    """Whether there is a relaxation by blocks: faces are wedges under either label, and joints can all open."""
    sets = analysis.template.yield_set
    wedges = sets.wedge(True) is not None and sets.wedge(False) is not None
    return wedges and analysis.interior.opening() is not None


def _wedges(analysis: LimitAnalysis) -> tuple[Wedge, Wedge]:
    """Faces as dry and as inner ones. Raises TypeError where they are no wedges."""
    dry, inner = (analysis.template.yield_set.wedge(label) for label in (True, False))
    if dry is None or inner is None:
        raise TypeError("no relaxation by blocks is known of these yield sets")
    return dry, inner


class _Entries:
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

    def add_vectors(self, row: Ints, column: Ints, value: Floats) -> None:
        """Columns (k, 3) that begin at rows (k,)."""
        self.add((row[:, None] + np.arange(_Q)).ravel(), np.repeat(column, _Q), value.ravel())

    def finished(self) -> tuple[Ints, Ints, Floats]:
        rows, columns, values = zip(*self._parts, strict=True)
        return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
