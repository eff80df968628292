"""Upper bound in space: velocity fields, linear in tetrahedra, with jumps between them.

Formulas: docs/method.md (10.2) and (10.6). The solver proposes velocities that keep a margin to every flow rule.
This module proves the bound: it checks the flow rules and computes dissipation and work from the velocities alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.fields.cone_pattern import Answer, Rows
from jld_core.fields.space_cones import DIAGONAL, ConeSizes, across, normal_map, solve_cones
from jld_core.fields.space_joints import SpatialProblem

# Margins of opening to every flow rule, scaled, at live work one, in the order tried. The first whose answer passes the
# check is taken.
_MARGINS = (1e-8, 1e-7, 1e-6, 1e-5)

# Statuses of unbounded programs: the blocks are too weak for their dead load
_UNBOUNDED = ("DualInfeasible", "AlmostDualInfeasible")

_RAY = -1.0  # scaled bound that is stated where the program is unbounded: any larger bound holds too


@dataclass(frozen=True)
class SpatialVelocity:
    """Certified velocity field in space, scaled (see `Units`)."""

    factor: float  # upper bound on λ
    velocity: Floats  # (t, 4, 3) velocities at the corners of the tetrahedra, on which the live load does unit work
    dissipation: Floats  # (t,) power in each tetrahedron with half of its triangles


@dataclass(frozen=True)
class SpatialRates:
    """Strain rates and jumps of a velocity field in space, scaled."""

    # trace, shear: (t,) e = tr ε and g = Σ |ε_i| over principal rates, docs/method.md (10.2)
    trace: Floats
    shear: Floats
    # opening, slip: (f, 3) normal jump δn, opening positive, and size |δs| of the tangential jump at the corners of the
    # triangles
    opening: Floats
    slip: Floats


class SpatialUpperBound:
    """Upper bound on λ by velocity fields, for one labelling on one mesh in space.

    problem: the scaled problem, with its labelling. live, dead: (t, 4, 3) nodal forces at the corners of the
    tetrahedra, equivalent to the loads, scaled. status: status by the solver at the last attempt of `bound`, "" before.
    """

    def __init__(self, problem: SpatialProblem) -> None:
        self.problem = problem
        self.status = ""
        p = problem
        corner = p.mesh.volume[:, None, None] / 4.0
        self.live = np.repeat(p.live[:, None, :] * corner, 4, axis=1) + self._pulled(p.pull)
        self.dead = np.repeat(p.dead[:, None, :] * corner, 4, axis=1) + self._pulled(p.dead_pull)

    def _pulled(self, pull: Floats) -> Floats:
        """Nodal forces (t, 4, 3) of tractions (f, 3, 3): a linear traction on a linear velocity."""
        p, s = self.problem, self.problem.sides
        forces = np.zeros((len(p.mesh), 4, 3))
        rows = np.flatnonzero(pull.any(axis=(1, 2)))
        for corner in range(3):
            share = (pull[rows, corner] + pull[rows].sum(axis=1)) * (s.area[rows] / 12.0)[:, None]
            np.add.at(forces, (s.a[rows], s.corner_a[rows, corner]), share)
        return forces

    def bound(self) -> SpatialVelocity | None:
        """Find a velocity field and certify it, with larger margins where that fails.

        None if the solver failed, or no field obeys all flow rules, as for enclosed cells.
        """
        # The factor is below 0 for blocks that collapse under their dead load alone.
        for margin in _MARGINS:
            answer = self.propose(margin)
            self.status = answer.status
            if answer.status in _UNBOUNDED:
                return self._falling()
            if not answer.usable:
                return None
            found = self.certify(answer.point[: self.live.size].reshape(-1, 4, 3))
            if found is not None:
                return found
        return None

    def _falling(self) -> SpatialVelocity | None:
        """Return a mechanism that the dead load drives, with positive live work.

        None if the solver failed, or the field proves nothing.
        """
        # The factor of the field is below 0: the blocks collapse under every live load λ ≥ 0. How far below is chance;
        # the factor is at least `_RAY`, and any larger bound holds too.
        answer = _Program(self.problem, self.dead, np.zeros_like(self.dead), _MARGINS[1], self.live).solve()
        if not answer.usable:
            return None
        velocity = answer.point[: self.live.size].reshape(-1, 4, 3)
        work, dead = float((self.live * velocity).sum()), self.dead * velocity
        power = self.power(self.rates(velocity))
        excess = float(power.sum() - dead.sum()) + tolerances.SUMMATION * float(power.sum() + abs(dead).sum())
        if not (work > 0.0 and excess < 0.0):
            return None
        return SpatialVelocity(max(excess / work, _RAY), velocity / work, power / work)

    def certify(self, velocity: Floats) -> SpatialVelocity | None:
        """Compute the upper bound on λ that velocities prove, without a solver.

        velocity: (t, 4, 3), scaled by any factor; the result has live work one. None: a flow rule is violated, or the
        live load does no positive work.
        """
        rates = self.rates(velocity)
        work = float((self.live * velocity).sum())
        if not work > 0.0:
            return None
        power = self.power(rates)
        dead = self.dead * velocity
        # sums in another order round differently
        slack = tolerances.SUMMATION * (float(power.sum()) + float(abs(dead).sum()))
        factor = (float(power.sum()) - float(dead.sum()) + slack) / work
        return SpatialVelocity(factor, velocity / work, power / work) if np.isfinite(factor) else None

    def rates(self, velocity: Floats) -> SpatialRates:
        """Compute strain rates and jumps of velocities (t, 4, 3); supports stand still."""
        p, s = self.problem, self.problem.sides
        slope = np.einsum("tki,tkj->tij", velocity, p.mesh.gradient)
        principal = np.linalg.eigvalsh(0.5 * (slope + slope.transpose(0, 2, 1)))
        jump = -velocity[s.a[:, None], s.corner_a]
        both = s.b >= 0
        jump[both] += velocity[s.b[both][:, None], s.corner_b[both]]
        opening = np.einsum("fki,fi->fk", jump, s.normal)
        slip = np.linalg.norm(jump - opening[..., None] * s.normal[:, None], axis=2)
        return SpatialRates(np.trace(slope, axis1=1, axis2=2), abs(principal).sum(axis=1), opening, slip)

    def power(self, rates: SpatialRates) -> Floats:
        """Return the power (t,) in each tetrahedron with half of its triangles, scaled.

        The power is inf where a flow rule is violated.
        """
        # Power on a triangle is the mean of its three corners, which bounds that of a linear jump from above:
        # dissipation is convex.
        p, s = self.problem, self.problem.sides
        power = p.mesh.volume * p.material.dissipation(rates.trace, rates.shear)
        total = np.zeros(len(s))
        opening, slip = rates.opening[p.cut], rates.slip[p.cut]
        total[p.cut] = p.material.dissipation(opening, np.hypot(opening, slip)).mean(axis=1)
        total[p.dry] = self._joint_power(rates).mean(axis=1)
        total *= s.area
        both = s.b >= 0
        np.add.at(power, s.a, np.where(both, 0.5, 1.0) * total)
        np.add.at(power, s.b[both], 0.5 * total[both])
        return power

    def _joint_power(self, rates: SpatialRates) -> Floats:
        """Compute the power per area (k, 3) at the corners of the k dry triangles, scaled."""
        # Slip costs shear strength. Opening that friction lacks costs crushing; it is inf where the joint cannot crush.
        p = self.problem
        face = p.face[p.dry]
        slip, opening = rates.slip[p.dry], rates.opening[p.dry]
        mu, c, crush = (v[face][:, None] for v in (p.joints.friction, p.joints.shear, p.joints.crushing))
        lack = mu * slip - opening
        with np.errstate(invalid="ignore"):
            crushed = np.where(lack > 0.0, crush * lack, 0.0)
        return np.asarray(c * slip + crushed)

    def propose(self, margin: float) -> Answer:
        """Minimise dissipation minus dead-load work, at unit work of the live load.

        The velocities are not certified yet, see `certify`. margin: room that the solver keeps to every flow rule,
        scaled velocity. `Answer.point` begins with the velocities (12t,), as (t, 4, 3) in C order. The objective is the
        scaled λ that the solver expects.
        """
        program = _Program(self.problem, self.live, self.dead, margin)
        return program.solve()


class _Program:
    """Cone program of the upper bound under construction; y1, y3 as in docs/method.md (9.3).

    live: (t, 4, 3) nodal forces that do unit work. dead: those whose work is subtracted. driving: those whose work must
    not be negative, where given.
    """

    def __init__(
        self, problem: SpatialProblem, live: Floats, dead: Floats, margin: float, driving: Floats | None = None
    ) -> None:
        self.problem, self._margin = problem, margin
        self._work, self._linear, self._threes, self._fours, self._psd = (Rows() for _ in range(5))
        self._columns = live.size
        self._costs = [-dead.ravel()]
        every = np.arange(live.size)[None]
        self._work.add([(every, live.reshape(1, -1))], 1.0, 1)
        if driving is not None:
            self._linear.add([(every, -driving.reshape(1, -1))], -margin, 1)
        self._solids()
        for corner in range(3):
            self._cut_corners(corner)
            self._dry_corners(corner)

    def solve(self) -> Answer:
        """Solve the program."""
        groups = (self._work, self._linear, self._threes, self._fours, self._psd)
        parts = [part for part in groups if part.count]
        matrix = sp.csr_array(sp.vstack([part.matrix(self._columns) for part in parts]))
        rhs = np.concatenate([part.right for part in parts])
        four, three, psd = self._fours.count // 4, self._threes.count // 3, self._psd.count // 6
        sizes = ConeSizes(1, self._linear.count, three, four, psd)
        return solve_cones(np.concatenate(self._costs), matrix, rhs, sizes)

    def _new(self, cost: Floats) -> Ints:
        """Add k variables with the given costs (k,) and return their column numbers (k,)."""
        columns = self._columns + np.arange(len(cost))
        self._columns += len(cost)
        self._costs.append(cost)
        return columns

    def _multipliers(self, size: Floats, trace: tuple[Ints, Floats]) -> list[tuple[Ints, Floats | float]]:
        """Add the multipliers y1, y3 ≥ 0 and y2 = e − sin φ y1 + y3 ≥ margin of (9.3).

        size: (k,) factors on the dissipation.
        """
        material, count = self.problem.material, len(size)
        columns, values = trace
        np.add.at(self._costs[0], columns, material.tension * size[:, None] * values)
        first = self._new(size * (material.intercept - material.tension * material.sine))
        second: list[tuple[Ints, Floats | float]] = [(columns, -values), (first, material.sine)]
        total: list[tuple[Ints, Floats | float]] = [(columns, values), (first, 1.0 - material.sine)]
        self._linear.add([(first, -1.0)], 0.0, count)
        if np.isfinite(material.crushing):
            third = self._new(size * (material.tension + material.crushing))
            self._linear.add([(third, -1.0)], 0.0, count)
            second.append((third, -1.0))
            total.append((third, 2.0))
        self._linear.add(second, 0.0 if np.isfinite(material.crushing) else -self._margin, count)
        return total

    def _solids(self) -> None:
        """Add flow rule and dissipation of every tetrahedron, with strain rate ε."""
        # B ⪰ 0 is a new tensor with ε + B ⪰ 0. Its trace satisfies tr ε + 2 tr B ≤ y1 + y2 + y3.
        mesh = self.problem.mesh
        count = len(mesh)
        height = np.cbrt(mesh.volume)
        columns = np.broadcast_to(12 * np.arange(count)[:, None] + np.arange(12), (count, 12))
        # ε in the vector form of tensors is the transpose of the map of stresses to tractions on the gradients
        strain = normal_map(mesh.gradient * height[:, None, None]).transpose(0, 3, 1, 2).reshape(count, 6, 12)
        trace = strain[:, DIAGONAL].sum(axis=1)
        negative = self._new(np.zeros(6 * count)).reshape(count, 6)
        total = self._multipliers(mesh.volume / height, (columns, trace))
        self._linear.add([(columns, trace), (negative[:, DIAGONAL], 2.0), *((c, -v) for c, v in total)], 0.0, count)
        rows = 6 * count
        self._psd.add([(negative.ravel(), -1.0)], 0.0, rows)
        self._psd.add([(np.repeat(columns, 6, axis=0), -strain.reshape(rows, 12)), (negative.ravel(), -1.0)], 0.0, rows)

    def _jump(self, rows: Ints, corner: int) -> tuple[Ints, Floats]:
        """Return columns (k, 6) and values (k, 3, 6) of velocity jumps at a corner of triangles.

        rows: (k,) triangles. corner: 0 to 2. The jump is that of b minus a; b at a support does not move.
        """
        # Column 12·tetrahedron + 3·corner + axis is a velocity; without b, its columns are those of a with values 0.
        s = self.problem.sides
        own = 12 * s.a[rows] + 3 * s.corner_a[rows, corner]
        there = s.b[rows] >= 0
        other = np.where(there, 12 * s.b[rows] + 3 * s.corner_b[rows, corner], own)
        columns = np.concatenate([own[:, None] + np.arange(3), other[:, None] + np.arange(3)], axis=1)
        values = np.concatenate(
            [np.broadcast_to(-np.eye(3), (len(rows), 3, 3)), there[:, None, None] * np.eye(3)], axis=2
        )
        return columns, values

    def _cut_corners(self, corner: int) -> None:
        """Add dissipation and flow rule |δ| ≤ y1 + y2 + y3 of jumps δ in the material at a corner."""
        rows, s = self.problem.cut, self.problem.sides
        columns, jump = self._jump(rows, corner)
        opening = np.einsum("ki,kij->kj", s.normal[rows], jump)
        total = self._multipliers(s.area[rows] / 3.0, (columns, opening))
        self._cone(self._fours, total, [(columns, jump[:, axis]) for axis in range(3)], len(rows))

    def _dry_corners(self, corner: int) -> None:
        """Add p ≥ |δs| and δn + q ≥ μ p for jumps on dry joints at one corner, 0 to 2."""
        # δn: opening. δs: slip. p ≥ 0 costs shear strength, q ≥ 0 crushing.
        p, s, rows = self.problem, self.problem.sides, self.problem.dry
        if not rows.size:
            return
        face, size = p.face[rows], s.area[rows] / 3.0
        mu, crush = p.joints.friction[face], p.joints.crushing[face]
        columns, jump = self._jump(rows, corner)
        opening = np.einsum("ki,kij->kj", s.normal[rows], jump)
        slid = self._new(size * p.joints.shear[face])
        crushed = self._new(np.where(np.isfinite(crush), size * crush, 0.0))
        self._linear.add([(crushed, -1.0)], 0.0, len(rows))
        free = np.where(np.isfinite(crush), -1.0, 0.0)
        margin = np.where(np.isfinite(crush), 0.0, -self._margin)
        self._linear.add([(columns, -opening), (slid, mu), (crushed, free)], margin, len(rows))
        one, two = across(s.normal[rows])
        tail = [(columns, np.einsum("ki,kij->kj", along, jump)) for along in (one, two)]
        self._cone(self._threes, [(slid, 1.0)], tail, len(rows))

    @staticmethod
    def _cone(rows: Rows, head: list[tuple[Ints, Floats | float]], tail: list[tuple[Ints, Floats]], count: int) -> None:
        """Append cones head ≥ |tail| to `rows`, each with all of its rows together.

        tail: one entry (columns, values) for each further row.
        """
        parts: list[Sequence[tuple[Ints, Floats | float]]] = [head, *([one] for one in tail)]
        size = len(parts)
        entries = []
        for place, part in enumerate(parts):
            for columns, values in part:
                flat = np.asarray(columns).reshape(count, -1)
                value = np.broadcast_to(np.asarray(values) if np.ndim(values) else values, np.shape(columns)).reshape(
                    count, -1
                )
                wide = np.zeros((count, size, flat.shape[1]))
                wide[:, place] = -value
                entries.append((np.repeat(flat, size, axis=0), wide.reshape(count * size, -1)))
        rows.add(entries, 0.0, size * count)
