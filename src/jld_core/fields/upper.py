"""Upper bound: velocity fields that are linear in each triangle, with jumps on every edge.

Formulas: docs/method.md (9.10) and (9.11). The solver proposes velocities. This module proves the bound: it
adds opening until every flow rule holds, and recomputes dissipation and work.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.fields.cone_pattern import Answer
from jld_core.fields.opening import Settling, opening_motion
from jld_core.fields.problem import Problem
from jld_core.fields.velocity_program import VelocityProgram

# Largest relative rise of λ above the solver's at which an opened field is taken without settling: ten times the usual
# rise
_CHEAP = 1e-7

# Relative rise of λ above the solver's from which a program with margins is tried: opening then costs too much. The
# least at which the first margin ends the tries. What opening costs depends on rounding, and so on where a scene
# stands; with 1e-4 two of 186 random scenes had upper bounds that differed by 2e-5 and 6e-5 when moved.
_COSTLY = 1e-6

# Room of flow rules in such programs, scaled velocity: above residuals of the solver, below what moves λ
_MARGINS = (1e-8, 1e-6)

_RAY = -1.0  # scaled bound that is stated where the program is unbounded: any larger bound holds too


@dataclass(frozen=True)
class VelocityField:
    """Certified velocity field of one labelling, scaled (see `Units`)."""

    factor: float  # upper bound on λ that the field proves
    # (t, 3, 2) velocities at the three corners of each triangle, on which the live load does unit work
    velocity: Floats
    dissipation: Floats  # (t,) power in each triangle with half of its edges
    opened: float  # multiple of the opening motion that was added to repair flow rules, before scaling to unit work


@dataclass(frozen=True)
class Rates:
    """Strain rates and jumps of a planar velocity field, scaled."""

    # trace, shear: (t,) e = εx + εy and g = √((εx − εy)² + γ²) of the triangles
    trace: Floats
    shear: Floats
    # opening, slip: (e, 2) normal jump δn, opening positive, and tangential jump δs at both ends of the edges
    opening: Floats
    slip: Floats


class UpperBound:
    """Upper bounds on λ by velocity fields, for many labellings of one problem.

    `bound` returns a certified field. The cone program is set up once; labels switch rows and costs.

    problem: the scaled problem on one mesh. many: True where hundreds of labellings are bounded; see `ConeProgram`.
    live, dead: (t, 3, 2) nodal forces at the corners of the triangles, equivalent to the loads, scaled. status: status
    by the solver of the last labelling that was bounded, "" before.
    """

    def __init__(self, problem: Problem, many: bool = False) -> None:
        self.problem, self._many = problem, many
        self._triangles = len(problem.mesh)
        self._motion: Floats | None = None
        self._settling: Settling | None = None
        self._tried = False
        self.status = ""
        p = problem
        # strain rates are velocities over heights of triangles
        self._steep = max(1.0, float(abs(p.mesh.gradient).max()))
        corner = p.mesh.area[:, None, None] / 3.0
        self.live = np.repeat(p.live[:, None, :] * corner, 3, axis=1) + self._pulled(p.pull)
        self.dead = np.repeat(p.dead[:, None, :] * corner, 3, axis=1) + self._pulled(p.dead_pull)

    def _pulled(self, pull: Floats) -> Floats:
        """Nodal forces (t, 3, 2) of tractions (e, 2, 2): a linear traction on a linear velocity."""
        e = self.problem.edges
        forces = np.zeros((self._triangles, 3, 2))
        rows = np.flatnonzero(pull.any(axis=(1, 2)))
        for end in (0, 1):
            share = (2.0 * pull[rows, end] + pull[rows, 1 - end]) * (e.length[rows] / 6.0)[:, None]
            np.add.at(forces, (e.a[rows], e.corner_a[rows, end]), share)
        return forces

    def bound(self, labels: Bits) -> VelocityField | None:
        """Find a velocity field for one labelling, and certify it.

        labels: (m,) True = dry. Where repairs cost much of λ, the program is solved again with room in every flow rule.
        The factor is below 0 for blocks that collapse under their dead load alone. None: the solver failed, or no field
        could be repaired.
        """
        return self._bound_by(self.propose(labels), labels)

    def bound_all(self, labellings: Bits) -> list[VelocityField | None]:
        """Find velocity fields for labellings (k, m), solved together where possible; see `bound`."""
        answers = self._velocity_program.solve_all(np.array([self.problem.is_dry(labels) for labels in labellings]))
        return [self._bound_by(answer, labels) for answer, labels in zip(answers, labellings, strict=True)]

    def _bound_by(self, answer: Answer, labels: Bits) -> VelocityField | None:
        """Certify an answer of the solver; try programs with margins if repairs cost much λ.

        labels: (m,) True = dry. See `bound` for the result.
        """
        self.status = answer.status
        # a ray of an unbounded program is a mechanism too: the blocks are too weak for their dead load
        if not (answer.usable or answer.status == "DualInfeasible"):
            return None
        found = self.certify(answer.point[: 6 * self._triangles].reshape(-1, 3, 2), labels, answer.objective)
        if answer.usable and (found is None or found.factor - answer.objective > _COSTLY * abs(found.factor)):
            found = self._with_margins(labels, found, answer.objective)
        if found is not None and not answer.usable:
            # how far below zero a ray leads is chance; any larger bound holds as well
            return replace(found, factor=max(found.factor, _RAY))
        return found

    def _with_margins(self, labels: Bits, found: VelocityField | None, expected: float) -> VelocityField | None:
        """Return the field of least bound: `found`, or one of programs with room in flow rules.

        labels: (m,) True = dry.
        """
        for margin in _MARGINS:
            answer = VelocityProgram(self.problem, self.live, self.dead, margin).solve(self.problem.is_dry(labels))
            if not answer.usable:
                continue
            other = self.certify(answer.point[: 6 * self._triangles].reshape(-1, 3, 2), labels, answer.objective)
            if other is not None and (found is None or other.factor < found.factor):
                found = other
            if found is not None and found.factor - expected <= _COSTLY * abs(found.factor):
                break
        return found

    def propose(self, labels: Bits, undecided: Bools | None = None) -> Answer:
        """Solve the program of a labelling for an uncertified velocity field; see `certify`.

        labels: (m,) True = dry; ignored where undecided. undecided: (m,) True where a face keeps the flow rules of both
        labels. The first 6t entries of `Answer.point` are velocities (t, 3, 2), scaled. Test `usable` before using it.
        """
        either = None if undecided is None else self.problem.is_dry(undecided)
        return self._velocity_program.solve(self.problem.is_dry(labels), either)

    @cached_property
    def _velocity_program(self) -> VelocityProgram:
        """The program without margins."""
        return VelocityProgram(self.problem, self.live, self.dead, many=self._many)

    def certify(self, velocity: Floats, labels: Bits, expected: float = -math.inf) -> VelocityField | None:
        """Repair proposed velocities until every flow rule holds, and compute their upper bound.

        velocity: (t, 3, 2), scaled. labels: (m,) True = dry.
        """
        opened = self._opened(velocity, labels)
        if opened is not None and opened.factor - expected <= _CHEAP * abs(opened.factor):
            return opened
        if self._settling is None:
            self._settling = Settling(self.problem)
        near = self._opened(self._settling.settled(velocity, self.problem.is_dry(labels)), labels)
        return min((one for one in (near, opened) if one is not None), key=lambda one: one.factor, default=None)

    def _opened(self, velocity: Floats, labels: Bits) -> VelocityField | None:
        """Open one field until every flow rule holds, and compute its bound on λ.

        velocity: (t, 3, 2), scaled. labels: (m,) True = dry. None: a flow rule stays violated, or the live load does no
        positive work.
        """
        rates = self.rates(velocity)
        worst, share, allowance = self._worst(rates, labels), 0.0, 0.0
        if worst > 0.0:
            motion = self._opening()
            if motion is not None:
                # the room of the motion is at least one in every flow rule, and flow rules are concave
                share = worst * (1.0 + 1e-9)
                velocity = velocity + share * motion
                rates = self.rates(velocity)
            allowance = self.allowance(velocity)
            if self._worst(rates, labels) > allowance:
                return None
        work = float((self.live * velocity).sum())
        if not work > 0.0:
            return None
        power = self.power(rates, labels, allowance)
        dead = self.dead * velocity
        # sums in another order round differently
        slack = tolerances.SUMMATION * (float(power.sum()) + float(abs(dead).sum()))
        factor = (float(power.sum()) - float(dead.sum()) + slack) / work
        return VelocityField(factor, velocity / work, power / work, share) if np.isfinite(factor) else None

    def allowance(self, velocity: Floats) -> float:
        """Return the missing opening that counts as rounding for velocities (t, 3, 2), scaled.

        Flow rules that hold with equality by construction are missed by no more. Pass it to `power`.
        """
        return tolerances.ROUNDING * float(abs(velocity).max()) * self._steep

    def repaired(self, velocity: Floats, share: float) -> Floats:
        """Open velocities so far that small violations of flow rules vanish, under either label.

        velocity: (t, 3, 2), scaled.
        """
        every = np.ones(len(self.problem.supported), dtype=bool)
        rates = self.rates(velocity)
        lacks = np.concatenate([part.ravel() for b in (every, ~every) for part in self.lacking(rates, b)])
        small = lacks[lacks <= share * float(abs(velocity).max())]
        worst = float(small.max(initial=0.0))
        motion = self._opening() if worst > 0.0 else None
        return velocity if motion is None else velocity + worst * (1.0 + 1e-9) * motion

    def _worst(self, rates: Rates, labels: Bits) -> float:
        """Return the largest opening that any flow rule lacks, scaled; up to 0 where all hold."""
        return max(float(part.max(initial=-np.inf)) for part in self.lacking(rates, labels))

    def _opening(self) -> Floats | None:
        """Return the opening motion (t, 3, 2) with room of one or more in every flow rule.

        None without such a motion.
        """
        # Computed at the first call and kept.
        if not self._tried:
            self._tried = True
            motion = opening_motion(self.problem)
            if motion is not None:
                rates, every = self.rates(motion), np.ones(len(self.problem.supported), dtype=bool)
                least = min(
                    -float(part.max(initial=-np.inf)) for b in (every, ~every) for part in self.lacking(rates, b)
                )
                self._motion = motion / least if least > 0.0 else None
        return self._motion

    def rates(self, velocity: Floats) -> Rates:
        """Compute strain rates and jumps of velocities (t, 3, 2); supports stand still."""
        p, e = self.problem, self.problem.edges
        slope = np.einsum("tki,tkj->tij", velocity, p.mesh.gradient)
        shear = np.hypot(slope[:, 0, 0] - slope[:, 1, 1], slope[:, 0, 1] + slope[:, 1, 0])
        jump = -velocity[e.a[:, None], e.corner_a]
        both = e.b >= 0
        jump[both] += velocity[e.b[both][:, None], e.corner_b[both]]
        opening = np.einsum("eki,ei->ek", jump, e.normal)
        slip = jump[..., 1] * e.normal[:, :1] - jump[..., 0] * e.normal[:, 1:]
        return Rates(slope[:, 0, 0] + slope[:, 1, 1], shear, opening, slip)

    def lacking(self, rates: Rates, labels: Bits) -> tuple[Floats, Floats, Floats]:
        """Return the opening that flow rules lack, scaled velocity; 0 or less where they hold.

        labels: (m,) True = dry. The arrays are for triangles (t,), edges in the material (k, 2) and dry edges (j, 2),
        with both ends in columns. −inf stands where crushing allows any rate.
        """
        p = self.problem
        dry = p.is_dry(labels)
        cut = np.flatnonzero(~dry & ((p.edges.b >= 0) | (p.face >= 0)))
        joint = np.flatnonzero(dry)
        opening, slip = rates.opening[joint], abs(rates.slip[joint])
        face = p.face[joint]
        lack = p.joints.friction[face][:, None] * slip - opening
        return (
            p.material.missing(rates.trace, rates.shear),
            p.material.missing(rates.opening[cut], np.hypot(rates.opening[cut], rates.slip[cut])),
            np.where(np.isinf(p.joints.crushing[face])[:, None], lack, -np.inf),
        )

    def power(self, rates: Rates, labels: Bits, allowance: float = 0.0) -> Floats:
        """Return the power dissipated in each triangle with half of its edges, (t,), scaled.

        labels: (m,) True = dry.
        """
        p, e = self.problem, self.problem.edges
        power = p.mesh.area * p.material.dissipation(rates.trace, rates.shear, allowance)
        dry = p.is_dry(labels)
        ends = p.material.dissipation(rates.opening, np.hypot(rates.opening, rates.slip), allowance)
        ends[dry] = self.joint_power(rates, np.flatnonzero(dry), allowance)
        ends[p.outer] = 0.0
        total = 0.5 * e.length * ends.sum(axis=1)
        both = e.b >= 0
        np.add.at(power, e.a, np.where(both, 0.5, 1.0) * total)
        np.add.at(power, e.b[both], 0.5 * total[both])
        return power

    def joint_power(self, rates: Rates, rows: Ints, allowance: float = 0.0) -> Floats:
        """Return the power per area of edges as dry joints, (k, 2), at both ends, scaled.

        rows: (k,) edges on interfaces.
        """
        p = self.problem
        face = p.face[rows]
        slip, opening = abs(rates.slip[rows]), rates.opening[rows]
        mu, c, crush = (v[face][:, None] for v in (p.joints.friction, p.joints.shear, p.joints.crushing))
        lack = mu * slip - opening
        with np.errstate(invalid="ignore"):
            crushed = np.where(lack > np.where(np.isinf(crush), allowance, 0.0), crush * lack, 0.0)
        return np.asarray(c * slip + crushed)
