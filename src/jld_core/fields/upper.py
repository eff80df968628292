"""Upper bound: velocity fields that are linear in each simplex, with jumps on every side, proven without the solver.

Formulas: docs/method.md (9.10), (9.11), in space (10.2) and (10.6). In the plane opening is added until every flow rule
holds; in space the solver keeps a margin to them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.fields.cones import Answer, ConeProgram, ConeSizes, Rows, solve_cones
from jld_core.fields.forms import COMPONENTS, DIAGONAL, across, normal_map, shear_rate, tangential
from jld_core.fields.problem import Problem

Entries = list[tuple[Ints, Floats | float]]


def jump_entries(problem: Problem, rows: Ints, corner: int) -> tuple[Ints, Floats]:
    """Return columns (k, 2d) and values (k, d, 2d) of the jump b − a at a corner; supports do not move."""
    # Column d·(d + 1)·simplex + d·corner + axis is a velocity; without b, its columns are those of a with values 0.
    sides, d = problem.sides, problem.mesh.dimension
    of_a = d * (d + 1) * sides.a[rows] + d * sides.corner_a[rows, corner]
    moves = sides.b[rows] >= 0  # b is a simplex and no support
    of_b = np.where(moves, d * (d + 1) * sides.b[rows] + d * sides.corner_b[rows, corner], of_a)
    columns = np.concatenate([of_a[:, None] + np.arange(d), of_b[:, None] + np.arange(d)], axis=1)
    values_of_a = np.broadcast_to(-np.eye(d), (len(rows), d, d))
    return columns, np.concatenate([values_of_a, moves[:, None, None] * np.eye(d)], axis=2)


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
        self._side_costs: list[tuple[Ints, Ints, Floats]] = []  # side, columns, cost where it is not dry
        velocities = np.arange(live.size)[None]
        work.add([(velocities, live.reshape(1, -1))], 1.0, 1)
        if driving is not None:
            self._add(self._linear, [(velocities, -driving.reshape(1, -1))], -margin, 1)
        self._simplices()
        # sides with jumps in the material, and those on dry joints: without labels a side can be both
        dry = None if labels is None else problem.is_dry(labels)
        cut = problem.jumps if dry is None else problem.jumps[~dry[problem.jumps]]
        joints = problem.on_faces if dry is None else np.flatnonzero(dry)
        for corner in range(problem.mesh.dimension):
            if cut.size:
                self._cut_corners(cut, corner)
            if joints.size:
                self._dry_corners(joints, corner)
        groups = [rows for rows in (work, self._linear, self._threes, self._fours, self._psd) if rows.count]
        matrix = sp.csr_array(sp.vstack([rows.matrix(self._columns) for rows in groups]))
        rhs = np.concatenate([rows.right for rows in groups])
        self._fixed = np.concatenate(self._costs)
        threes = self._threes.count // 3
        sizes = ConeSizes(1, self._linear.count, threes, self._fours.count // 4, self._psd.count // 6)
        self._whole = matrix, rhs, sizes
        if self._switched:
            # only linear rows and cones of three are switched, and the one row of live work stands before them
            linear, cones = id(self._linear), id(self._threes)
            self._off_owner = np.concatenate([np.array([-1]), *self._owner[linear], *self._owner[cones]])
            self._off_dry = np.concatenate([[False], *self._when_dry[linear], *self._when_dry[cones]])
            self._off_cohesion = np.zeros(len(self._off_dry), dtype=bool)
            self._off_cohesion[1 + np.concatenate(self._cohesive)] = True
            self._program = ConeProgram(self._fixed, matrix, rhs, ConeSizes(1, self._linear.count, threes), many)

    def solve(self, dry: Bools | None = None, undecided: Bools | None = None) -> Answer:
        """Solve the program for dry and undecided sides (f,); the answer is not certified."""
        # Undecided sides cost what inner ones do and crushing. Their shear strength is free, as cracks rarely dissipate
        # less.
        if dry is None:
            return solve_cones(self._fixed, *self._whole)
        return self._program.solve(*self._for_labels(dry, undecided))

    def solve_all(self, dry: Bools) -> list[Answer]:
        """Solve the programs of k labellings; see `solve`. dry: (k, f)."""
        off, objective = zip(*(self._for_labels(dry_sides) for dry_sides in dry), strict=True)
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
        trace_rule = [(columns, trace), (negative[:, DIAGONAL], 2.0), *((c, -v) for c, v in total)]
        self._linear.add(trace_rule, 0.0, count)
        rows, positive = 6 * count, (negative.ravel(), -1.0)
        self._psd.add([positive], 0.0, rows)
        self._psd.add([(np.repeat(columns, 6, axis=0), -strain.reshape(rows, 12)), positive], 0.0, rows)

    def _cut_corners(self, rows: Ints, corner: int) -> None:
        """Add dissipation and flow rule |δ| ≤ y1 + y2 + y3 of jumps δ in the material at a corner of sides (k,)."""
        sides, d = self.problem.sides, self.problem.mesh.dimension
        columns, jump = jump_entries(self.problem, rows, corner)
        normal = sides.normal[rows]
        opening = np.einsum("ki,kij->kj", normal, jump)
        owner = rows if self._switched else None
        total = self._multipliers((columns, opening), sides.area[rows] / d, owner)
        if d == 2:
            jump = np.stack([opening, np.einsum("ki,kij->kj", across(normal)[0], jump)], axis=1)
        self._cone(self._threes if d == 2 else self._fours, total, columns, jump, owner)

    def _dry_corners(self, rows: Ints, corner: int) -> None:
        """Add p ≥ |δs| and δn + q ≥ μ |δs| for jumps on dry joints at one corner of sides (k,)."""
        # δn: opening. δs: slip. p ≥ 0 costs shear strength, q ≥ 0 crushing. In the plane |δs| is two inequalities.
        problem, sides, count = self.problem, self.problem.sides, len(rows)
        spatial = problem.mesh.dimension == 3
        face, size = problem.face[rows], sides.area[rows] / problem.mesh.dimension  # share of the side at a corner
        joints = problem.joints
        mu, shear, crush = joints.friction[face], joints.shear[face], joints.crushing[face]
        columns, jump = jump_entries(problem, rows, corner)
        normal = sides.normal[rows]
        opening, *slips = (np.einsum("ki,kij->kj", way, jump) for way in (normal, *across(normal)))
        crushes = np.isfinite(crush)
        plus_q: Entries = []
        p = self._new(size * shear) if spatial else None
        if spatial or crushes.any():
            q = self._new(np.where(crushes, size * crush, 0.0))
            plus_q = [(q, np.where(crushes, -1.0, 0.0))]
            self._add(self._linear, [(q, -1.0)], 0.0, count)
        margin = np.where(crushes & spatial, 0.0, -self._margin)
        if p is not None:
            self._add(self._linear, [(columns, -opening), (p, mu), *plus_q], margin, count)
            self._cone(self._threes, [(p, 1.0)], columns, np.stack(slips, axis=1))
            return
        slip, scale = slips[0], np.maximum(1.0, mu)  # rows of a size of one, also for steep friction
        for sign in (1.0, -1.0):
            friction = (columns, (sign * mu / scale)[:, None] * slip)
            entries = [(columns, -opening / scale[:, None]), friction, *((c, v / scale) for c, v in plus_q)]
            self._add(self._linear, entries, margin, count, rows, True)
        if shear.any():
            p = self._new(size * shear)
            self._add(self._linear, [(p, -1.0)], 0.0, count)
            for sign in (1.0, -1.0):
                self._cohesive.append(self._linear.count + np.arange(count))
                self._add(self._linear, [(columns, sign * slip), (p, -1.0)], 0.0, count, rows, True)

    def _cone(self, group: Rows, head: Entries, columns: Ints, tail: Floats, owner: Ints | None = None) -> None:
        """Append cones head ≥ |tail| (k, j, columns) to a group, rows together; owner: switching sides (k,)."""
        count, size = len(tail), tail.shape[1] + 1
        entries: Entries = []
        tails: list[Entries] = [[(columns, tail[:, j])] for j in range(size - 1)]
        for row, entries_of_row in enumerate([head, *tails]):
            for columns_of_entry, values in entries_of_row:
                entry_columns = columns_of_entry.reshape(count, -1)
                values_by_row = np.zeros((count, size, entry_columns.shape[1]))
                values_by_row[:, row] = -np.broadcast_to(values, columns_of_entry.shape).reshape(count, -1)
                entries.append((np.repeat(entry_columns, size, axis=0), values_by_row.reshape(count * size, -1)))
        self._add(group, entries, 0.0, size * count, None if owner is None else np.repeat(owner, size))


_LEAST = 1e-9  # least room in all flow rules, at velocities of one, of a motion that counts as found


def opening_motion(problem: Problem) -> Floats | None:
    """Find scaled velocities (t, 3, 2) that open every edge and dilate every triangle; None as for enclosed cells."""
    # A small multiple of them added to a velocity field repairs flow rules that rounding violates. Cells move apart and
    # stretch, each affinely, so that interfaces open despite friction of joint and material. Inside a cell, triangles
    # move by the gradient of a convex function that is linear on triangles. Such a gradient jumps along the normals of
    # edges: they open without sliding.
    mesh = problem.mesh
    cell_numbers, cell = np.unique(mesh.cell, return_inverse=True)
    area = np.bincount(cell, mesh.volume)
    middle = mesh.corners.mean(axis=1)
    centre = np.column_stack([np.bincount(cell, mesh.volume * middle[:, axis]) / area for axis in (0, 1)])
    motion, gradients = _cell_motion(problem, cell, centre, len(cell_numbers)), _convex_gradients(problem, cell)
    if motion is None or gradients is None:
        return None
    cell_motions, slack = motion
    arm = mesh.corners - centre[cell][:, None]
    gradient = cell_motions[:, 2:6].reshape(-1, 2, 2)[cell]
    velocity = cell_motions[cell, :2][:, None] + np.einsum("tij,tkj->tki", gradient, arm)
    # jumps of at most a quarter of the slack from each side leave half of it on interfaces
    steep = 1.0 + max(float(problem.joints.friction.max(initial=0.0)), problem.material.friction)
    share = 0.25 * slack / (steep * float(np.hypot(*gradients.T).max(initial=1e-300)))
    return np.asarray(velocity + share * gradients[:, None])


def _convex_gradients(problem: Problem, cell: Ints) -> Floats | None:
    """Find gradients (t, 2) of a function linear on triangles and convex in each cell, by a linear program; or None."""
    # One exists for every mesh of fans, trees of triangles and their bisections, which are regular subdivisions.
    mesh, sides = problem.mesh, problem.sides
    # one value of the function for each node of each cell
    key = cell[:, None] * len(mesh.points) + mesh.simplices
    unique, node = np.unique(key, return_inverse=True)
    node = node.reshape(-1, 3)
    inside = problem.inside
    rows, count = np.arange(len(inside)), len(unique)
    entries = []
    for triangle, sign in ((sides.b[inside], 1.0), (sides.a[inside], -1.0)):
        jump = sign * np.einsum("eki,ei->ek", mesh.gradient[triangle], sides.normal[inside])
        entries += [(rows, node[triangle, k], jump[:, k]) for k in range(3)]
    row, column, value = (np.concatenate([entry[k] for entry in entries]) for k in range(3))
    matrix = sp.csr_array((value, (row, column)), shape=(len(inside), count))
    # jumps in proportion to the size of triangles, as those of |x|² are
    size = np.minimum(np.sqrt(mesh.volume[sides.a[inside]]), np.sqrt(mesh.volume[sides.b[inside]]))
    convex = sp.hstack([-matrix, sp.csr_array(size[:, None])])
    objective = np.zeros(count + 1)
    objective[-1] = -1.0
    whole = sp.csr_array(sp.vstack([convex, sp.eye_array(count + 1), -sp.eye_array(count + 1)]))
    rhs = np.repeat([0.0, 1.0], [len(inside), 2 * count + 2])
    answer = ConeProgram(objective, whole, rhs, ConeSizes(0, len(rhs), 0)).solve()
    if not answer.usable or not answer.point[-1] > _LEAST:
        return None
    return np.asarray(np.einsum("tki,tk->ti", mesh.gradient, answer.point[:-1][node]))


def _cell_motion(problem: Problem, cell: Ints, centre: Floats, count: int) -> tuple[Floats, float] | None:
    """Find motions of the cells (count, 6), coefficients ≤ 1, of the largest slack in all flow rules; or None."""
    # Columns: velocity (2) and gradient G (2, 2), row by row, of each cell, then the slack.
    width = 6 * count + 1
    linear, cones = Rows(), Rows()
    coefficients = np.arange(6 * count)
    for sign in (1.0, -1.0):
        linear.add([(coefficients, sign)], 1.0, len(coefficients))
    linear.add([(np.array([width - 1]), 1.0)], 1.0, 1)
    _add_joint_rules(linear, problem, cell, centre, width)
    _add_cell_rules(linear, cones, problem.material.sine, count, width)
    parts = [part for part in (linear, cones) if part.count]
    objective = np.zeros(width)
    objective[-1] = -1.0
    whole = sp.csr_array(sp.vstack([part.matrix(width) for part in parts]))
    rhs = np.concatenate([part.right for part in parts])
    answer = ConeProgram(objective, whole, rhs, ConeSizes(0, linear.count, cones.count // 3)).solve()
    slack = float(answer.point[-1]) if answer.usable else 0.0
    return (answer.point[:-1].reshape(-1, 6), slack) if slack > _LEAST else None


def _add_joint_rules(linear: Rows, problem: Problem, cell: Ints, centre: Floats, width: int) -> None:
    """Append slack √(1 + μ²) ≤ δn ± μ δs at both ends of edges on interfaces, μ the larger of joint and material."""
    sides, rows = problem.sides, problem.on_faces
    slope = np.maximum(problem.joints.friction, problem.material.friction)[problem.face[rows]]
    size = np.hypot(1.0, slope)
    slack = np.full(len(rows), width - 1)
    normal = sides.normal[rows]
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    for end in (0, 1):
        point = problem.mesh.corners[sides.a[rows], sides.corner_a[rows, end]]
        for sign in (1.0, -1.0):
            opening_direction = normal - sign * slope[:, None] * tangent
            entries = [(slack, 1.0 * size)]
            for triangle, weight in ((sides.a[rows], -1.0), (sides.b[rows], 1.0)):
                # a support has no columns: those of the other side stand in, with values 0
                moves = triangle >= 0
                cell_beside = cell[np.maximum(triangle, 0)]
                first = np.where(moves, 6 * cell_beside, 6 * cell[sides.a[rows]])
                arm = point - centre[cell_beside]
                for axis in (0, 1):
                    value = -np.where(moves, weight, 0.0) * opening_direction[:, axis]
                    entries.append((first + axis, value))
                    entries += [(first + 2 + 2 * axis + k, value * arm[:, k]) for k in (0, 1)]
            linear.add(entries, 0.0, len(rows))


def _add_cell_rules(linear: Rows, cones: Rows, sine: float, count: int, width: int) -> None:
    """Append slack ≤ e and g sin φ ≤ e − slack of each cell, with e and g of docs/method.md (9.2)."""
    # Columns 6 c + 2 … 6 c + 5 are the velocity gradient of cell c, row by row; the last column is the slack.
    gradient_column, slack, ones = 6 * np.arange(count) + 2, np.full(count, width - 1), np.ones(count)
    trace = [(gradient_column, -ones), (gradient_column + 3, -ones), (slack, ones)]
    linear.add(trace, 0.0, count)
    if not sine > 0.0:
        return
    differences = [(gradient_column, -sine * ones), (gradient_column + 3, sine * ones)]
    sums = [(gradient_column + 1, -sine * ones), (gradient_column + 2, -sine * ones)]
    for k in range(count):
        for part in (trace, differences, sums):
            cones.add([(column[k : k + 1], value[k : k + 1]) for column, value in part], 0.0, 1)


# Rate, relative to the largest velocity, below which it counts as zero: far above the residual of the solver
_ACTIVE = 1e-7

# Largest number of linearisations of flow rules with friction. Where many slide, two leave errors of 4e-9 of the
# velocities, four 1e-14.
_ROUNDS = 4


_REGULAR = 1e-10  # added to the diagonal of the normal equations, since active flow rules may depend on each other


class Settling:
    """Correction of velocities of one problem, so that active flow rules hold exactly, between solver and check."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        p, self._cut = problem, problem.jumps
        normal, count = p.sides.normal[self._cut], len(p.mesh)
        columns, strain, _ = strain_entries(p)
        rates = Rows()
        self._groups = [[rates.add([(columns, strain[:, j])], 0.0, count) for j in range(strain.shape[1])]]
        for end in (0, 1):
            columns, jump = jump_entries(p, self._cut, end)
            values = (np.einsum("ki,kij->kj", way, jump) for way in (normal, *across(normal)))
            self._groups.append([rates.add([(columns, value)], 0.0, len(self._cut)) for value in values])
        self._rates = rates.matrix(6 * count)

    def settled(self, velocity: Floats, dry: Bools) -> Floats:
        """Move velocities (t, 3, 2) by about the solver's residual so that active flow rules hold; without proof."""
        # A flow rule is active if it is violated, or met with a margin below a small share of the largest velocity.
        moved = velocity.ravel()
        for _ in range(_ROUNDS if self.problem.material.sine or self.problem.joints.friction.any() else 1):
            matrix = self._active(moved, dry)
            if matrix is None:
                break
            square = sp.csc_matrix(matrix @ matrix.T + _REGULAR * sp.eye_array(matrix.shape[0]))
            solver = splu(square, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
            previous = moved
            for _ in range(4):
                moved = moved - matrix.T @ solver.solve(matrix @ moved)
            if float(abs(moved - previous).max()) <= tolerances.ROUNDING * float(abs(moved).max()):
                break
        return np.asarray(moved.reshape(velocity.shape))

    def _active(self, velocity: Floats, dry: Bools) -> sp.csr_array | None:
        """Return equations over velocities (6t,) that keep active flow rules at equality; None if none is active."""
        problem, small = self.problem, _ACTIVE * float(abs(velocity).max())
        rates = self._rates @ velocity
        rigid = bool(np.isinf(problem.material.crushing))
        joint, face = dry[self._cut], problem.face[self._cut]
        # of a joint the flow rule is δn ≥ μ|δs|, of the material δn ≥ sin φ √(δn² + δs²), so δn ≥ tan φ |δs|
        slope = np.full(len(face), problem.material.friction)
        slope[joint] = problem.joints.friction[face[joint]]
        without_crushing = np.full(len(face), rigid)  # where crushing does not replace the flow rule
        without_crushing[joint] = np.isinf(problem.joints.crushing[face[joint]])
        count = len(problem.mesh)
        # of triangles, and of both ends of edges
        at_end = slope, without_crushing
        rules = [(np.full(count, problem.material.sine), np.full(count, rigid)), at_end, at_end]
        equations = Rows()
        for (openings, *slips), (factor, rule_holds) in zip(self._groups, rules, strict=True):
            _add_active_rules(equations, rates, openings, slips, factor, rule_holds, small)
        return sp.csr_array(equations.matrix(len(rates)) @ self._rates) if equations.count else None


def _add_active_rules(
    equations: Rows, rates: Floats, head: Ints, tail: list[Ints], slope: Floats, applies: Bools, small: float
) -> None:
    """Append equations that keep active flow rules rates[head] = slope · |rates[tail]| (k,).

    head, tail: rows of `rates` with openings and slips; applies: (k,) False where crushing replaces the rule; small:
    rate that counts as zero.
    """
    opening, slips = rates[head], [rates[columns] for columns in tail]
    slip = np.sqrt(sum((columns**2 for columns in slips), np.zeros(len(opening))))
    active = applies & (opening - slope * slip <= small)
    at_rest = active & (slip <= small)
    frictionless = slope == 0.0
    # opening 0 where nothing resists slip or nothing slips, slip 0 where nothing slips, else the tangent of the cone
    for rows in (head[(active & frictionless) | at_rest], *(columns[at_rest] for columns in tail)):
        equations.add([(rows, 1.0)], 0.0, len(rows))
    sliding = np.flatnonzero(active & ~at_rest & ~frictionless)
    if sliding.size:
        shares = [-(slope * rate)[sliding] / slip[sliding] for rate in slips]
        tangent = [(columns[sliding], share) for columns, share in zip(tail, shares, strict=True)]
        equations.add([(head[sliding], 1.0), *tangent], 0.0, len(sliding))


# Largest relative rise of λ above the solver's at which an opened field is taken without settling: ten times the usual
# rise
_CHEAP = 1e-7

# Relative rise of λ above the solver's from which a program with margins is tried: opening then costs too much. The
# least at which the first margin ends the tries. What opening costs depends on rounding, and so on where a scene
# stands; with 1e-4 two of 186 random scenes had upper bounds that differed by 2e-5 and 6e-5 when moved.
_COSTLY = 1e-6

# Room of flow rules in such programs, scaled velocity: above residuals of the solver, below what moves λ
_MARGINS = (1e-8, 1e-6)

# Margins of opening to every flow rule in space, scaled, at live work one, in the order tried. The first whose answer
# passes the check is taken.
_MARGINS_IN_SPACE = (1e-8, 1e-7, 1e-6, 1e-5)

# Statuses of unbounded programs: the blocks are too weak for their dead load
_UNBOUNDED = ("DualInfeasible", "AlmostDualInfeasible")

_FALLING = 1e-7  # margin of the program of a mechanism in space that the dead load drives

_RAY = -1.0  # scaled bound that is stated where the program is unbounded: any larger bound holds too


@dataclass(frozen=True)
class VelocityField:
    """Certified velocity field of one labelling, scaled (see `Units`)."""

    factor: float  # upper bound on λ that the field proves
    # (t, d + 1, d) velocities at the corners of each simplex, on which the live load does unit work
    velocity: Floats
    dissipation: Floats  # (t,) power in each simplex with half of its sides
    opened: float  # multiple of the opening motion that was added to repair flow rules, before scaling to unit work


@dataclass(frozen=True)
class Rates:
    """Strain rates and jumps of a velocity field, scaled."""

    # trace, shear: (t,) e and g of docs/method.md (9.2) and (10.2)
    trace: Floats
    shear: Floats
    # opening, slip: (f, d) normal jump δn, opening positive, and size |δs| of the tangential jump at corners of sides
    opening: Floats
    slip: Floats


_MORE = 1.0 + 1e-9  # factor on the opening that flow rules lack: a little more is added


class UpperBound:
    """Upper bounds on λ by velocity fields, for many labellings of one problem; planar programs are set up once.

    live, dead: (t, d + 1, d) nodal forces of the loads, scaled. status: of the last program, "" before.
    """

    def __init__(self, problem: Problem, many: bool = False) -> None:
        self.problem, self._many = problem, many
        self.status = ""
        corners = problem.mesh.dimension + 1
        # strain rates are velocities over heights of simplices
        self._steep = max(1.0, float(abs(problem.mesh.gradient).max()))
        corner = problem.mesh.volume[:, None, None] / corners
        self.live, self.dead = (
            np.repeat(volume_force[:, None, :] * corner, corners, axis=1) + self._nodal_forces(pull)
            for volume_force, pull in ((problem.live, problem.pull), (problem.dead, problem.dead_pull))
        )

    def _nodal_forces(self, pull: Floats) -> Floats:
        """Return nodal forces (t, d + 1, d) of linear tractions (f, d, d) on linear velocities."""
        problem, sides, d = self.problem, self.problem.sides, self.problem.mesh.dimension
        forces = np.zeros((len(problem.mesh), d + 1, d))
        rows = np.flatnonzero(pull.any(axis=(1, 2)))
        for corner in range(d):
            others = np.delete(pull[rows], corner, axis=1).sum(axis=1)
            share = (2.0 * pull[rows, corner] + others) * (sides.area[rows] / (d * (d + 1)))[:, None]
            np.add.at(forces, (sides.a[rows], sides.corner_a[rows, corner]), share)
        return forces

    def bound(self, labels: Bits) -> VelocityField | None:
        """Find and certify a velocity field; below 0 for collapse under dead load. None: solver or repair failed."""
        if self.problem.mesh.dimension == 2:
            return self._bound_by(self.propose(labels), labels)
        for margin in _MARGINS_IN_SPACE:
            answer = VelocityProgram(self.problem, self.live, self.dead, margin, labels=labels).solve()
            self.status = answer.status
            if answer.status in _UNBOUNDED:
                return self._falling(labels)
            if not answer.usable:
                return None
            velocity = self._velocity(answer)
            field = self._proven(velocity, self.rates(velocity), labels)
            if field is not None:
                return field
        return None

    def _velocity(self, answer: Answer) -> Floats:
        return answer.point[: self.live.size].reshape(self.live.shape)

    def _falling(self, labels: Bits) -> VelocityField | None:
        """Return a mechanism in space that the dead load drives, with positive live work, or None."""
        # The factor of the field is below 0: the blocks collapse under every live load λ ≥ 0. How far below is chance;
        # the factor is at least `_RAY`, and any larger bound holds too.
        problem, zero = self.problem, np.zeros_like(self.dead)
        answer = VelocityProgram(problem, self.dead, zero, _FALLING, labels=labels, driving=self.live).solve()
        velocity = self._velocity(answer)
        field = self._proven(velocity, self.rates(velocity), labels) if answer.usable else None
        return replace(field, factor=max(field.factor, _RAY)) if field is not None and field.factor < 0.0 else None

    def bound_all(self, labellings: Bits) -> list[VelocityField | None]:
        """Find velocity fields for labellings (k, m) in the plane, solved together where possible."""
        answers = self._velocity_program.solve_all(np.array([self.problem.is_dry(labels) for labels in labellings]))
        return [self._bound_by(answer, labels) for answer, labels in zip(answers, labellings, strict=True)]

    def _bound_by(self, answer: Answer, labels: Bits) -> VelocityField | None:
        """Certify an answer of the solver; try programs with margins if repairs cost much λ."""
        self.status = answer.status
        # a ray of an unbounded program is a mechanism too: the blocks are too weak for their dead load
        if not (answer.usable or answer.status == "DualInfeasible"):
            return None
        field = self.certify(self._velocity(answer), labels, answer.objective)
        if answer.usable and (field is None or field.factor - answer.objective > _COSTLY * abs(field.factor)):
            field = self._with_margins(labels, field, answer.objective)
        if field is not None and not answer.usable:
            # how far below zero a ray leads is chance; any larger bound holds as well
            return replace(field, factor=max(field.factor, _RAY))
        return field

    def _with_margins(self, labels: Bits, best: VelocityField | None, expected: float) -> VelocityField | None:
        """Return the field of least bound: `best`, or one of programs with room in flow rules."""
        for margin in _MARGINS:
            answer = VelocityProgram(self.problem, self.live, self.dead, margin).solve(self.problem.is_dry(labels))
            if not answer.usable:
                continue
            field = self.certify(self._velocity(answer), labels, answer.objective)
            if field is not None and (best is None or field.factor < best.factor):
                best = field
            if best is not None and best.factor - expected <= _COSTLY * abs(best.factor):
                break
        return best

    def propose(self, labels: Bits, undecided: Bools | None = None) -> Answer:
        """Solve for an uncertified velocity field; undecided (m,) faces keep the flow rules of both labels.

        The first 6t entries of `Answer.point` are velocities (t, 3, 2), scaled; test `usable` first.
        """
        either = None if undecided is None else self.problem.is_dry(undecided)
        return self._velocity_program.solve(self.problem.is_dry(labels), either)

    @cached_property
    def _velocity_program(self) -> VelocityProgram:
        return VelocityProgram(self.problem, self.live, self.dead, many=self._many)

    @cached_property
    def _settling(self) -> Settling:
        return Settling(self.problem)

    def certify(self, velocity: Floats, labels: Bits, expected: float = -math.inf) -> VelocityField | None:
        """Repair velocities (t, 3, 2) until every flow rule holds, and compute their upper bound."""
        opened = self._open_until_valid(velocity, labels)
        if opened is not None and opened.factor - expected <= _CHEAP * abs(opened.factor):
            return opened
        settled = self._open_until_valid(self._settling.settled(velocity, self.problem.is_dry(labels)), labels)
        fields = [field for field in (settled, opened) if field is not None]
        return min(fields, key=lambda field: field.factor, default=None)

    def _open_until_valid(self, velocity: Floats, labels: Bits) -> VelocityField | None:
        """Open velocities (t, 3, 2) until every flow rule holds, and compute their bound; or None."""
        rates = self.rates(velocity)
        worst, share, allowance = self._worst(rates, labels), 0.0, 0.0
        if worst > 0.0:
            motion = self._opening
            if motion is not None:
                # the room of the motion is at least one in every flow rule, and flow rules are concave
                share = worst * _MORE
                velocity = velocity + share * motion
                rates = self.rates(velocity)
            allowance = self.allowance(velocity)
            if self._worst(rates, labels) > allowance:
                return None
        return self._proven(velocity, rates, labels, allowance, share)

    def _proven(
        self, velocity: Floats, rates: Rates, labels: Bits, allowance: float = 0.0, opened: float = 0.0
    ) -> VelocityField | None:
        """Compute the upper bound that velocities prove; None: a flow rule violated, or no positive live work."""
        work = float((self.live * velocity).sum())
        if not work > 0.0:
            return None
        power = self.power(rates, labels, allowance)
        dead = self.dead * velocity
        # sums in another order round differently
        slack = tolerances.SUMMATION * (float(power.sum()) + float(abs(dead).sum()))
        factor = (float(power.sum()) - float(dead.sum()) + slack) / work
        return VelocityField(factor, velocity / work, power / work, opened) if np.isfinite(factor) else None

    def allowance(self, velocity: Floats) -> float:
        """Return the missing opening that counts as rounding for velocities (t, d + 1, d), scaled, for `power`."""
        return tolerances.ROUNDING * float(abs(velocity).max()) * self._steep

    def repaired(self, velocity: Floats, share: float) -> Floats:
        """Open velocities (t, 3, 2) so far that small violations vanish under either label."""
        # Violations up to a share of the fastest velocity are rounding of the solver. The opening motion, which exceeds
        # every flow rule by at least 1, is added as often as the worst of them lacks. Larger ones are no rounding and
        # stay: for the labels whose flow rule they violate the field proves nothing.
        lacks = np.concatenate([part.ravel() for part in self._lacking_under_either(self.rates(velocity))])
        small = lacks[lacks <= share * float(abs(velocity).max())]
        worst = float(small.max(initial=0.0))
        motion = self._opening if worst > 0.0 else None
        return velocity if motion is None else velocity + worst * _MORE * motion

    def _worst(self, rates: Rates, labels: Bits) -> float:
        """Return the largest opening that any flow rule lacks, scaled; up to 0 where all hold."""
        return max(float(part.max(initial=-np.inf)) for part in self.lacking(rates, labels))

    @cached_property
    def _opening(self) -> Floats | None:
        """Opening motion (t, 3, 2) with room ≥ 1 in every flow rule, or None."""
        motion = opening_motion(self.problem)
        if motion is None:
            return None
        lack = max(float(part.max(initial=-np.inf)) for part in self._lacking_under_either(self.rates(motion)))
        return motion / -lack if lack < 0.0 else None

    def _lacking_under_either(self, rates: Rates) -> list[Floats]:
        """Return the opening that flow rules lack, `lacking` with all faces dry and with all inner."""
        dry = np.ones(len(self.problem.joints.friction), dtype=bool)
        return [part for labels in (dry, ~dry) for part in self.lacking(rates, labels)]

    def rates(self, velocity: Floats) -> Rates:
        """Compute strain rates and jumps of velocities (t, d + 1, d); supports stand still."""
        problem, sides = self.problem, self.problem.sides
        slope = np.einsum("tki,tkj->tij", velocity, problem.mesh.gradient)
        jump = jumps(problem, velocity, np.arange(len(sides)))
        opening = np.einsum("fki,fi->fk", jump, sides.normal)
        trace = np.trace(slope, axis1=1, axis2=2)
        return Rates(trace, shear_rate(slope), opening, tangential(jump, sides.normal))

    def lacking(self, rates: Rates, labels: Bits) -> tuple[Floats, Floats, Floats]:
        """Return the opening that flow rules lack in triangles (t,), inner (k, 2) and dry edges (j, 2).

        −inf if crushing.
        """
        problem = self.problem
        dry = problem.is_dry(labels)
        cut = problem.jumps[~dry[problem.jumps]]
        joint = np.flatnonzero(dry)
        opening, slip = rates.opening[joint], rates.slip[joint]
        face = problem.face[joint]
        lack = problem.joints.friction[face][:, None] * slip - opening
        return (
            problem.material.missing(rates.trace, rates.shear),
            problem.material.missing(rates.opening[cut], np.hypot(rates.opening[cut], rates.slip[cut])),
            np.where(np.isinf(problem.joints.crushing[face])[:, None], lack, -np.inf),
        )

    def power(self, rates: Rates, labels: Bits, allowance: float = 0.0) -> Floats:
        """Return the power dissipated in each triangle with half of its edges, (t,), scaled."""
        # Power on a side is the mean of its corners, which bounds that of a linear jump from above: dissipation is
        # convex.
        problem, sides, dry = self.problem, self.problem.sides, self.problem.is_dry(labels)
        power = problem.mesh.volume * problem.material.dissipation(rates.trace, rates.shear, allowance)
        cut, joint, ends = problem.jumps[~dry[problem.jumps]], np.flatnonzero(dry), np.zeros_like(rates.opening)
        opening, slip = rates.opening[cut], rates.slip[cut]
        ends[cut] = problem.material.dissipation(opening, np.hypot(opening, slip), allowance)
        ends[joint] = self.joint_power(rates, joint, allowance)
        total = sides.area / problem.mesh.dimension * ends.sum(axis=1)
        return halved(problem, power, np.arange(len(sides)), total)

    def joint_power(self, rates: Rates, rows: Ints, allowance: float = 0.0) -> Floats:
        """Return the power per area (k, 2) of edges (k,) as dry joints, at both ends, scaled."""
        problem = self.problem
        face = problem.face[rows]
        slip, opening = rates.slip[rows], rates.opening[rows]
        mu, c, crush = (
            v[face][:, None] for v in (problem.joints.friction, problem.joints.shear, problem.joints.crushing)
        )
        lack = mu * slip - opening
        with np.errstate(invalid="ignore"):
            crushed = np.where(lack > np.where(np.isinf(crush), allowance, 0.0), crush * lack, 0.0)
        return np.asarray(c * slip + crushed)


def jumps(problem: Problem, velocity: Floats, rows: Ints) -> Floats:
    """Return the velocity jumps (k, d, d), b less a, at the corners of sides (k,)."""
    sides = problem.sides
    jump = -velocity[sides.a[rows][:, None], sides.corner_a[rows]]
    both = sides.b[rows] >= 0
    jump[both] += velocity[sides.b[rows[both]][:, None], sides.corner_b[rows[both]]]
    return np.asarray(jump)


def halved(problem: Problem, power: Floats, rows: Ints, total: Floats) -> Floats:
    """Add values (k,) of sides to the simplices (t,) on both of their sides, half to each."""
    sides, both = problem.sides, problem.sides.b[rows] >= 0
    np.add.at(power, sides.a[rows], np.where(both, 0.5, 1.0) * total)
    np.add.at(power, sides.b[rows[both]], 0.5 * total[both])
    return power
