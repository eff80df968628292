"""Cone program of the upper bound on λ by velocity fields."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.fields.cones import Answer, ConeProgram, ConeSizes, Rows, solve_cones
from jld_core.fields.forms import COMPONENTS, DIAGONAL, across, normal_map
from jld_core.fields.problem import Problem

Entries = list[tuple[Ints, Floats | float]]


def jump_entries(problem: Problem, rows: Ints, corner: int) -> tuple[Ints, Floats]:
    """Return columns (k, 2d) and values (k, d, 2d) of the jump b − a at a corner; supports do not move."""
    # Column d·(d + 1)·simplex + d·corner + axis is a velocity; without b, its columns are those of a with values 0.
    s, d = problem.sides, problem.mesh.dimension
    own = d * (d + 1) * s.a[rows] + d * s.corner_a[rows, corner]
    there = s.b[rows] >= 0
    other = np.where(there, d * (d + 1) * s.b[rows] + d * s.corner_b[rows, corner], own)
    columns = np.concatenate([own[:, None] + np.arange(d), other[:, None] + np.arange(d)], axis=1)
    own_values = np.broadcast_to(-np.eye(d), (len(rows), d, d))
    return columns, np.concatenate([own_values, there[:, None, None] * np.eye(d)], axis=2)


def strain_entries(problem: Problem) -> tuple[Ints, Floats, Floats]:
    """Return columns and values (t, 3 or 6, d (d + 1)) of strain rates times a length, and the lengths (t,)."""
    mesh, d = problem.mesh, problem.mesh.dimension
    size = np.sqrt(mesh.volume) if d == 2 else np.cbrt(mesh.volume)
    # strain rates are the transpose of the map of stresses to tractions on the gradients
    strain = normal_map(mesh.gradient * size[:, None, None]).transpose(0, 3, 1, 2)
    columns = np.arange(len(mesh) * d * (d + 1)).reshape(len(mesh), -1)
    return columns, strain.reshape(len(mesh), COMPONENTS[d], -1), size


class VelocityProgram:
    """Cone program of the upper bound on one mesh: dissipation minus dead work at unit live work (9.10).

    Columns: velocities (t, d + 1, d), y1 and y3 of (9.3), slips and crushings on interfaces; y2 = e − sin φ y1 + y3 is
    eliminated. margin: room in flow rules. labels: for one labelling; else labellings switch rows and costs. driving:
    nodal forces whose work must not be negative.
    """

    def __init__(
        self,
        problem: Problem,
        live: Floats,
        dead: Floats,
        margin: float = 0.0,
        *,
        labels: Bits | None = None,
        driving: Floats | None = None,
        many: bool = False,
    ) -> None:
        self.problem, self._margin, self._switched = problem, margin, labels is None
        self._linear, self._threes, self._fours, self._psd, work = (Rows() for _ in range(5))
        self._owner: dict[int, list[Ints]] = {id(self._linear): [], id(self._threes): []}
        self._when_dry: dict[int, list[Bools]] = {id(self._linear): [], id(self._threes): []}
        self._cohesive: list[Ints] = [np.empty(0, dtype=np.int64)]
        self._columns = live.size
        self._costs: list[Floats] = [-dead.ravel().astype(float)]
        self._side_costs: list[tuple[Ints, Ints, Floats]] = []
        every = np.arange(live.size)[None]
        work.add([(every, live.reshape(1, -1))], 1.0, 1)
        if driving is not None:
            self._add(self._linear, [(every, -driving.reshape(1, -1))], -margin, 1)
        self._simplices()
        dry = None if labels is None else problem.is_dry(labels)
        cut = problem.jumps if dry is None else problem.jumps[~dry[problem.jumps]]
        joints = problem.on_faces if dry is None else np.flatnonzero(dry)
        for corner in range(problem.mesh.dimension):
            if cut.size:
                self._cut_corners(cut, corner)
            if joints.size:
                self._dry_corners(joints, corner)
        parts = [part for part in (work, self._linear, self._threes, self._fours, self._psd) if part.count]
        matrix = sp.csr_array(sp.vstack([part.matrix(self._columns) for part in parts]))
        rhs = np.concatenate([part.right for part in parts])
        self._fixed = np.concatenate(self._costs)
        three = self._threes.count // 3
        self._whole = matrix, rhs, ConeSizes(1, self._linear.count, three, self._fours.count // 4, self._psd.count // 6)
        if self._switched:
            groups = id(self._linear), id(self._threes)
            self._off_owner = np.concatenate([np.array([-1]), *(part for key in groups for part in self._owner[key])])
            self._off_dry = np.concatenate([[False], *(part for key in groups for part in self._when_dry[key])])
            self._off_cohesion = np.zeros(len(self._off_dry), dtype=bool)
            self._off_cohesion[1 + np.concatenate(self._cohesive)] = True
            self._program = ConeProgram(self._fixed, matrix, rhs, (1, self._linear.count, three), many)

    def solve(self, dry: Bools | None = None, undecided: Bools | None = None) -> Answer:
        """Solve the program for dry and undecided sides (f,); the answer is not certified."""
        # Undecided sides cost what inner ones do and crushing. Their shear strength is free, as cracks rarely dissipate
        # less.
        if dry is None:
            return solve_cones(self._fixed, *self._whole)
        return self._program.solve(*self._for_labels(dry, undecided))

    def solve_all(self, dry: Bools) -> list[Answer]:
        """Solve the programs of k labellings; see `solve`. dry: (k, f)."""
        off, objective = zip(*(self._for_labels(one) for one in dry), strict=True)
        return self._program.solve_all(np.array(off), np.array(objective))

    def _for_labels(self, dry: Bools, undecided: Bools | None = None) -> tuple[Bools, Floats]:
        """Return which rows (rows,) are off, and the costs (columns,), for labels of the sides."""
        off = (self._off_owner >= 0) & (dry[self._off_owner] != self._off_dry)
        if undecided is not None:
            either = (self._off_owner >= 0) & undecided[self._off_owner]
            off = np.where(either, self._off_cohesion, off)
            dry = dry & ~undecided
        objective = self._fixed.copy()
        for side, column, cost in self._side_costs:
            np.add.at(objective, column, np.where(dry[side], 0.0, cost))
        return off, objective

    def _new(self, cost: Floats) -> Ints:
        """Add k variables with the given costs (k,) and return their column numbers (k,)."""
        columns = self._columns + np.arange(len(cost))
        self._columns += len(cost)
        self._costs.append(cost)
        return columns

    def _add(
        self,
        group: Rows,
        entries: Sequence[tuple[Ints, Floats | float]],
        rhs: Floats | float,
        count: int,
        owner: Ints | None = None,
        when_dry: bool = False,
    ) -> None:
        """Append rows; owner: sides (count,) whose labels switch them, None where they always hold."""
        group.add(entries, rhs, count)
        if self._switched:
            self._owner[id(group)].append(np.full(count, -1) if owner is None else owner)
            self._when_dry[id(group)].append(np.full(count, when_dry))

    def _multipliers(self, trace: tuple[Ints, Floats], size: Floats, owner: Ints | None) -> Entries:
        """Add y1, y3 ≥ 0 and y2 = e − sin φ y1 + y3 ≥ margin of (9.3); return y1 + y2 + y3."""
        material, count, (columns, values) = self.problem.material, len(size), trace
        cost = (size * material.tension)[:, None] * values
        if owner is None:
            np.add.at(self._costs[0], columns, cost)
        else:
            self._side_costs.append((owner, columns.T, cost.T))
        first = self._new(size * (material.intercept - material.tension * material.sine))
        second: Entries = [(columns, -values), (first, material.sine)]
        total: Entries = [(columns, values), (first, 1.0 - material.sine)]
        positive, crushes = [first], bool(np.isfinite(material.crushing))
        if crushes:
            third = self._new(size * (material.tension + material.crushing))
            second.append((third, -1.0))
            total.append((third, 2.0))
            positive.append(third)
        for column in positive:
            self._add(self._linear, [(column, -1.0)], 0.0, count)
        room = 0.0 if crushes and self.problem.mesh.dimension == 3 else -self._margin
        self._add(self._linear, second, room, count, owner)
        return total

    def _simplices(self) -> None:
        """Add flow rule and dissipation of all simplices, with strain rate ε."""
        mesh, (columns, strain, size) = self.problem.mesh, strain_entries(self.problem)
        count = len(mesh)
        if mesh.dimension == 2:
            total = self._multipliers((columns, strain[:, 0]), size, None)
            self._cone(self._threes, total, columns, strain[:, 1:])
            return
        # B ⪰ 0 is a new tensor with ε + B ⪰ 0. Its trace satisfies tr ε + 2 tr B ≤ y1 + y2 + y3.
        trace = strain[:, DIAGONAL].sum(axis=1)
        negative = self._new(np.zeros(6 * count)).reshape(count, 6)
        total = self._multipliers((columns, trace), mesh.volume / size, None)
        held = [(columns, trace), (negative[:, DIAGONAL], 2.0), *((c, -v) for c, v in total)]
        self._linear.add(held, 0.0, count)
        rows, positive = 6 * count, (negative.ravel(), -1.0)
        self._psd.add([positive], 0.0, rows)
        self._psd.add([(np.repeat(columns, 6, axis=0), -strain.reshape(rows, 12)), positive], 0.0, rows)

    def _cut_corners(self, rows: Ints, corner: int) -> None:
        """Add dissipation and flow rule |δ| ≤ y1 + y2 + y3 of jumps δ in the material at a corner of sides (k,)."""
        s, d = self.problem.sides, self.problem.mesh.dimension
        columns, jump = jump_entries(self.problem, rows, corner)
        normal = s.normal[rows]
        opening = np.einsum("ki,kij->kj", normal, jump)
        owner = rows if self._switched else None
        total = self._multipliers((columns, opening), s.area[rows] / d, owner)
        if d == 2:
            jump = np.stack([opening, np.einsum("ki,kij->kj", across(normal)[0], jump)], axis=1)
        self._cone(self._threes if d == 2 else self._fours, total, columns, jump, owner)

    def _dry_corners(self, rows: Ints, corner: int) -> None:
        """Add p ≥ |δs| and δn + q ≥ μ |δs| for jumps on dry joints at one corner of sides (k,)."""
        # δn: opening. δs: slip. p ≥ 0 costs shear strength, q ≥ 0 crushing. In the plane |δs| is two inequalities.
        p, s, count = self.problem, self.problem.sides, len(rows)
        face, size = p.face[rows], s.area[rows] / p.mesh.dimension
        mu, shear, crush = p.joints.friction[face], p.joints.shear[face], p.joints.crushing[face]
        columns, jump = jump_entries(p, rows, corner)
        normal = s.normal[rows]
        opening, *slips = (np.einsum("ki,kij->kj", way, jump) for way in (normal, *across(normal)))
        finite = np.isfinite(crush)
        extra: Entries = []
        slid = self._new(size * shear) if len(slips) > 1 else None
        if slid is not None or finite.any():
            crushed = self._new(np.where(finite, size * crush, 0.0))
            extra = [(crushed, np.where(finite, -1.0, 0.0))]
            self._add(self._linear, [(crushed, -1.0)], 0.0, count)
        margin = np.where(finite & (len(slips) > 1), 0.0, -self._margin)
        if slid is not None:
            self._add(self._linear, [(columns, -opening), (slid, mu), *extra], margin, count)
            self._cone(self._threes, [(slid, 1.0)], columns, np.stack(slips, axis=1))
            return
        scale = np.maximum(1.0, mu)
        for sign in (1.0, -1.0):
            slide = (columns, (sign * mu / scale)[:, None] * slips[0])
            entries = [(columns, -opening / scale[:, None]), slide, *((c, v / scale) for c, v in extra)]
            self._add(self._linear, entries, margin, count, rows, True)
        if shear.any():
            stuck = self._new(size * shear)
            self._add(self._linear, [(stuck, -1.0)], 0.0, count)
            for sign in (1.0, -1.0):
                self._cohesive.append(self._linear.count + np.arange(count))
                self._add(self._linear, [(columns, sign * slips[0]), (stuck, -1.0)], 0.0, count, rows, True)

    def _cone(self, group: Rows, head: Entries, columns: Ints, tail: Floats, owner: Ints | None = None) -> None:
        """Append cones head ≥ |tail| (k, j, columns) to a group, rows together; owner: switching sides (k,)."""
        count, size = len(tail), tail.shape[1] + 1
        entries: Entries = []
        tails: list[Entries] = [[(columns, tail[:, j])] for j in range(size - 1)]
        for place, parts in enumerate([head, *tails]):
            for where, values in parts:
                flat = where.reshape(count, -1)
                wide = np.zeros((count, size, flat.shape[1]))
                wide[:, place] = -np.broadcast_to(values, where.shape).reshape(count, -1)
                entries.append((np.repeat(flat, size, axis=0), wide.reshape(count * size, -1)))
        self._add(group, entries, 0.0, size * count, None if owner is None else np.repeat(owner, size))
