"""Cone program of the upper bound on λ by velocity fields."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bools, Floats, Ints
from jld_core.fields.cone_pattern import Answer, ConeProgram, Rows
from jld_core.fields.problem import Problem

Entries = list[tuple[Ints, Floats]]


def jump_entries(problem: Problem, rows: Ints, end: int, along: Floats) -> Entries:
    """Return the coefficients of velocity jumps at one end of edges, for rows of a program.

    rows: (k,) edges. along: (k, 2) directions of the component. The result is a list of four pairs (columns (k,),
    values (k,)): two for triangle a, then two for b. Column 6·triangle + 2·corner + axis is a nodal velocity. Without
    triangle b, at a support, its values are 0.
    """
    e = problem.edges
    a = 6 * e.a[rows] + 2 * e.corner_a[rows, end]
    there = e.b[rows] >= 0
    b = np.where(there, 6 * e.b[rows] + 2 * e.corner_b[rows, end], a)
    entries: Entries = [(a + axis, -along[:, axis]) for axis in (0, 1)]
    return entries + [(b + axis, np.where(there, along[:, axis], 0.0)) for axis in (0, 1)]


def strain_entries(problem: Problem, rows: Ints, size: Floats) -> tuple[Entries, Entries, Entries]:
    """Return the coefficients of the strain rates of triangles over nodal velocities.

    rows: (k,) triangles. size: (k,) factor on each. The results are εx + εy, εx − εy and γ = ∂u/∂y + ∂v/∂x. Each is a
    list of six pairs (columns (k,), values (k,)); column 6·triangle + 2·corner + axis.
    """
    base = 6 * rows
    slope = problem.mesh.gradient[rows] * size[:, None, None]
    places = [(k, axis) for k in range(3) for axis in (0, 1)]
    trace: Entries = [(base + 2 * k + axis, slope[:, k, axis]) for k, axis in places]
    stretch: Entries = [(base + 2 * k + axis, (1.0 - 2.0 * axis) * slope[:, k, axis]) for k, axis in places]
    shear: Entries = [(base + 2 * k + axis, slope[:, k, 1 - axis]) for k, axis in places]
    return trace, stretch, shear


class VelocityProgram:
    """Cone program of the upper bound on one mesh, set up once for all labellings.

    It minimises dissipation minus work of the dead load at unit work of the live load, docs/method.md (9.10). Labels
    switch rows and costs. Columns are the velocities (6t,), the multipliers y1 and y3 of (9.3) for triangles and edge
    ends, and slips and crushings of interface ends. y2 = e − sin φ y1 + y3 is eliminated.

    problem: the scaled problem. live, dead: (t, 3, 2) nodal forces of the loads at the corners of triangles, scaled.
    margin: room that all flow rules keep, scaled velocity. many: True where hundreds of labellings are solved; see
    `ConeProgram`.
    """

    def __init__(self, problem: Problem, live: Floats, dead: Floats, margin: float = 0.0, many: bool = False) -> None:
        """Set up the program; see the class for the parameters."""
        self.problem, self._margin = problem, margin
        self._linear, self._cones = Rows(), Rows()
        self._owner: tuple[list[Ints], list[Ints]] = ([], [])
        self._when_dry: tuple[list[Bools], list[Bools]] = ([], [])
        self._cohesive: list[Ints] = []
        self._columns = live.size
        self._costs: list[Floats] = []
        self._base = -dead.ravel().astype(float)
        e = problem.edges
        self._edge_costs: list[tuple[Ints, Ints, Floats]] = []
        self._triangles()
        material = np.flatnonzero((e.b >= 0) | (problem.face >= 0))
        for end in (0, 1):
            self._material_ends(material, end)
            self._dry_ends(problem.on_faces, end)
        work = Rows()
        work.add([(np.arange(live.size), live.ravel())], 1.0, 1)
        parts = (work, self._linear, self._cones)
        matrix = sp.csr_array(sp.vstack([part.matrix(self._columns) for part in parts]))
        self._off_owner = np.concatenate([np.array([-1]), *self._owner[0], *self._owner[1]])
        self._off_dry = np.concatenate([np.array([False]), *self._when_dry[0], *self._when_dry[1]])
        self._off_cohesion = np.zeros(len(self._off_dry), dtype=bool)
        self._off_cohesion[1 + np.concatenate([np.empty(0, dtype=np.int64), *self._cohesive])] = True
        self._fixed = np.concatenate([self._base, *self._costs])
        rhs = np.concatenate([part.right for part in parts])
        sizes = (1, self._linear.count, self._cones.count // 3)
        self._program = ConeProgram(self._fixed, matrix, rhs, sizes, many)

    def solve(self, dry: Bools, undecided: Bools | None = None) -> Answer:
        """Solve the program for labels of the edges; the answer is not certified.

        dry: (e,) True for edges on dry interfaces. undecided: (e,) True for edges that keep the flow rules of both
        labels; `dry` is ignored there. Their cost is that of inner ones and of crushing. Cohesion of undecided joints
        costs nothing, as cracks rarely dissipate less.
        """
        return self._program.solve(*self._switched(dry, undecided))

    def solve_all(self, dry: Bools) -> list[Answer]:
        """Solve the programs of k labellings; see `solve`. dry: (k, e)."""
        off, objective = zip(*(self._switched(one) for one in dry), strict=True)
        return self._program.solve_all(np.array(off), np.array(objective))

    def _switched(self, dry: Bools, undecided: Bools | None = None) -> tuple[Bools, Floats]:
        """Return which rows (rows,) are off, and the costs (columns,), for labels of the edges.

        dry, undecided: (e,) as for `solve`.
        """
        off = (self._off_owner >= 0) & (dry[self._off_owner] != self._off_dry)
        if undecided is not None:
            either = (self._off_owner >= 0) & undecided[self._off_owner]
            off = np.where(either, self._off_cohesion, off)
            dry = dry & ~undecided
        objective = self._fixed.copy()
        for edge, column, cost in self._edge_costs:
            np.add.at(objective, column, np.where(dry[edge], 0.0, cost))
        return off, objective

    def _new(self, cost: Floats) -> Ints:
        """Add k variables with the given costs (k,) and return their column numbers (k,)."""
        columns = self._columns + np.arange(len(cost))
        self._columns += len(cost)
        self._costs.append(cost)
        return columns

    def _rows(self, entries: Entries, rhs: float, count: int, owner: Ints | None, when_dry: bool, cone: bool) -> None:
        """Append rows of one kind, which always hold or depend on labels.

        owner: edges (count,) whose labels switch them, None where they always hold.
        """
        (self._cones if cone else self._linear).add(entries, rhs, count)
        self._owner[cone].append(np.full(count, -1) if owner is None else owner)
        self._when_dry[cone].append(np.full(count, when_dry))

    def _power(self, trace: Entries, shear: tuple[Entries, Entries], size: Floats, owner: Ints | None) -> None:
        """Add flow rule and dissipation of the material for k triangles or edge ends, docs/method.md (9.3).

        trace, shear: entries of e and of both parts of g. size: (k,) area over the scale of its entries, or half a
        length. owner: (k,) edges whose labels switch the rows, None where they always hold.
        """
        material, count = self.problem.material, len(size)
        # y1 is `first`, y3 `third`; `second` are the entries of y2 = e − sin φ y1 + y3, `head` those of y1 + y2 + y3 ≥
        # |g|.
        first = self._new(size * (material.intercept - material.tension * material.sine))
        one = np.ones(count)
        second: Entries = [*trace, (first, -material.sine * one)]
        head: Entries = [*trace, (first, (1.0 - material.sine) * one)]
        positive = [first]
        if np.isfinite(material.crushing):
            third = self._new(size * (material.tension + material.crushing))
            second.append((third, one))
            head.append((third, 2.0 * one))
            positive.append(third)
        for column in positive:
            self._rows([(column, -one)], 0.0, count, None, False, False)
        self._rows([(column, -value) for column, value in second], -self._margin, count, owner, False, False)
        stacked = [head, *shear]
        # the three rows of a cone stand together
        entries: Entries = []
        for place, part in enumerate(stacked):
            for column, value in part:
                wide = np.zeros((count, 3))
                wide[:, place] = -value
                keep = np.repeat(column[:, None], 3, axis=1)
                entries.append((keep.ravel(), wide.ravel()))
        owners = None if owner is None else np.repeat(owner, 3)
        self._rows(entries, 0.0, 3 * count, owners, False, True)

    def _triangles(self) -> None:
        """Add flow rule and dissipation of all triangles."""
        mesh, material = self.problem.mesh, self.problem.material
        count = len(mesh)
        size = np.sqrt(mesh.area)
        trace, stretch, shear = strain_entries(self.problem, np.arange(count), size)
        for column, value in trace:
            np.add.at(self._base, column, size * material.tension * value)
        self._power(trace, (stretch, shear), size, None)

    def _material_ends(self, rows: Ints, end: int) -> None:
        """Add flow rule and dissipation of jumps in the material at one end of edges.

        rows: (k,) edges.
        """
        e, material = self.problem.edges, self.problem.material
        normal = e.normal[rows]
        opening = jump_entries(self.problem, rows, end, normal)
        slip = jump_entries(self.problem, rows, end, np.column_stack([-normal[:, 1], normal[:, 0]]))
        half = 0.5 * e.length[rows]
        for column, value in opening:
            self._edge_costs.append((rows, column, half * material.tension * value))
        self._power(opening, (opening, slip), half, rows)

    def _dry_ends(self, rows: Ints, end: int) -> None:
        """Add δn + q ≥ μ|δs| and p ≥ |δs| for jumps on dry joints at one end of edges.

        rows: (k,) edges.
        """
        p, e = self.problem, self.problem.edges
        face, normal, half = p.face[rows], e.normal[rows], 0.5 * e.length[rows]
        opening = jump_entries(self.problem, rows, end, normal)
        slip = jump_entries(self.problem, rows, end, np.column_stack([-normal[:, 1], normal[:, 0]]))
        mu, shear, crush = p.joints.friction[face], p.joints.shear[face], p.joints.crushing[face]
        one = np.ones(len(rows))
        extra: Entries = []
        if np.isfinite(crush).any():
            crushed = self._new(np.where(np.isfinite(crush), half * crush, 0.0))
            extra = [(crushed, np.where(np.isfinite(crush), -one, 0.0))]
            self._rows([(crushed, -one)], 0.0, len(rows), None, False, False)
        size = np.maximum(1.0, mu)
        for sign in (1.0, -1.0):
            entries = [(c, -v / size) for c, v in opening] + [(c, sign * mu * v / size) for c, v in slip]
            self._rows(entries + [(c, v / size) for c, v in extra], -self._margin, len(rows), rows, True, False)
        if shear.any():
            stuck = self._new(half * shear)
            self._rows([(stuck, -one)], 0.0, len(rows), None, False, False)
            for sign in (1.0, -1.0):
                entries = [(c, sign * v) for c, v in slip] + [(stuck, -one)]
                self._cohesive.append(self._linear.count + np.arange(len(rows)))
                self._rows(entries, 0.0, len(rows), rows, True, False)
