"""Upper bound: velocity fields that are linear in each simplex, with jumps on every side.

Formulas: docs/method.md (9.10), (9.11), in space (10.2) and (10.6). The solver proposes velocities. This module proves
the bound: in the plane it adds opening until every flow rule holds, in space the solver keeps a margin to them; then it
recomputes dissipation and work from the velocities alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.fields.cones import Answer
from jld_core.fields.forms import shear_rate, tangential
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


class UpperBound:
    """Upper bounds on λ by velocity fields, for many labellings of one problem; planar programs are set up once.

    live, dead: (t, d + 1, d) nodal forces of the loads, scaled. status: of the last program, "" before.
    """

    def __init__(self, problem: Problem, many: bool = False) -> None:
        self.problem, self._many = problem, many
        self._motion: Floats | None = None
        self._settling: Settling | None = None
        self._tried = False
        self.status = ""
        p, corners = problem, problem.mesh.dimension + 1
        # strain rates are velocities over heights of simplices
        self._steep = max(1.0, float(abs(p.mesh.gradient).max()))
        corner = p.mesh.volume[:, None, None] / corners
        self.live = np.repeat(p.live[:, None, :] * corner, corners, axis=1) + self._pulled(p.pull)
        self.dead = np.repeat(p.dead[:, None, :] * corner, corners, axis=1) + self._pulled(p.dead_pull)

    def _pulled(self, pull: Floats) -> Floats:
        """Return nodal forces (t, d + 1, d) of linear tractions (f, d, d) on linear velocities."""
        p, s, d = self.problem, self.problem.sides, self.problem.mesh.dimension
        forces = np.zeros((len(p.mesh), d + 1, d))
        rows = np.flatnonzero(pull.any(axis=(1, 2)))
        for corner in range(d):
            others = np.delete(pull[rows], corner, axis=1).sum(axis=1)
            share = (2.0 * pull[rows, corner] + others) * (s.area[rows] / (d * (d + 1)))[:, None]
            np.add.at(forces, (s.a[rows], s.corner_a[rows, corner]), share)
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
            found = self._proven(velocity, self.rates(velocity), labels)
            if found is not None:
                return found
        return None

    def _velocity(self, answer: Answer) -> Floats:
        """Return the velocities (t, d + 1, d) of an answer."""
        return answer.point[: self.live.size].reshape(self.live.shape)

    def _falling(self, labels: Bits) -> VelocityField | None:
        """Return a mechanism in space that the dead load drives, with positive live work, or None."""
        # The factor of the field is below 0: the blocks collapse under every live load λ ≥ 0. How far below is chance;
        # the factor is at least `_RAY`, and any larger bound holds too.
        p, none = self.problem, np.zeros_like(self.dead)
        answer = VelocityProgram(p, self.dead, none, _FALLING, labels=labels, driving=self.live).solve()
        velocity = self._velocity(answer)
        found = self._proven(velocity, self.rates(velocity), labels) if answer.usable else None
        return replace(found, factor=max(found.factor, _RAY)) if found is not None and found.factor < 0.0 else None

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
        found = self.certify(self._velocity(answer), labels, answer.objective)
        if answer.usable and (found is None or found.factor - answer.objective > _COSTLY * abs(found.factor)):
            found = self._with_margins(labels, found, answer.objective)
        if found is not None and not answer.usable:
            # how far below zero a ray leads is chance; any larger bound holds as well
            return replace(found, factor=max(found.factor, _RAY))
        return found

    def _with_margins(self, labels: Bits, found: VelocityField | None, expected: float) -> VelocityField | None:
        """Return the field of least bound: `found`, or one of programs with room in flow rules."""
        for margin in _MARGINS:
            answer = VelocityProgram(self.problem, self.live, self.dead, margin).solve(self.problem.is_dry(labels))
            if not answer.usable:
                continue
            other = self.certify(self._velocity(answer), labels, answer.objective)
            if other is not None and (found is None or other.factor < found.factor):
                found = other
            if found is not None and found.factor - expected <= _COSTLY * abs(found.factor):
                break
        return found

    def propose(self, labels: Bits, undecided: Bools | None = None) -> Answer:
        """Solve for an uncertified velocity field; undecided (m,) faces keep the flow rules of both labels.

        The first 6t entries of `Answer.point` are velocities (t, 3, 2), scaled; test `usable` first.
        """
        either = None if undecided is None else self.problem.is_dry(undecided)
        return self._velocity_program.solve(self.problem.is_dry(labels), either)

    @cached_property
    def _velocity_program(self) -> VelocityProgram:
        """The program without margins."""
        return VelocityProgram(self.problem, self.live, self.dead, many=self._many)

    def certify(self, velocity: Floats, labels: Bits, expected: float = -math.inf) -> VelocityField | None:
        """Repair velocities (t, 3, 2) until every flow rule holds, and compute their upper bound."""
        opened = self._opened(velocity, labels)
        if opened is not None and opened.factor - expected <= _CHEAP * abs(opened.factor):
            return opened
        if self._settling is None:
            self._settling = Settling(self.problem)
        near = self._opened(self._settling.settled(velocity, self.problem.is_dry(labels)), labels)
        return min((one for one in (near, opened) if one is not None), key=lambda one: one.factor, default=None)

    def _opened(self, velocity: Floats, labels: Bits) -> VelocityField | None:
        """Open velocities (t, 3, 2) until every flow rule holds, and compute their bound; or None."""
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
        """Return the missing opening that counts as rounding for velocities (t, 3, 2), scaled, for `power`."""
        return tolerances.ROUNDING * float(abs(velocity).max()) * self._steep

    def repaired(self, velocity: Floats, share: float) -> Floats:
        """Open velocities (t, 3, 2) so far that small violations vanish under either label."""
        every = np.ones(len(self.problem.joints.friction), dtype=bool)
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
        """Return the opening motion (t, 3, 2) with room ≥ 1 in every flow rule, or None."""
        # Computed at the first call and kept.
        if not self._tried:
            self._tried = True
            motion = opening_motion(self.problem)
            if motion is not None:
                rates, every = self.rates(motion), np.ones(len(self.problem.joints.friction), dtype=bool)
                least = min(
                    -float(part.max(initial=-np.inf)) for b in (every, ~every) for part in self.lacking(rates, b)
                )
                self._motion = motion / least if least > 0.0 else None
        return self._motion

    def rates(self, velocity: Floats) -> Rates:
        """Compute strain rates and jumps of velocities (t, d + 1, d); supports stand still."""
        p, s = self.problem, self.problem.sides
        slope = np.einsum("tki,tkj->tij", velocity, p.mesh.gradient)
        jump = jumps(p, velocity, np.arange(len(s)))
        opening = np.einsum("fki,fi->fk", jump, s.normal)
        trace = np.trace(slope, axis1=1, axis2=2)
        return Rates(trace, shear_rate(slope), opening, tangential(jump, s.normal))

    def lacking(self, rates: Rates, labels: Bits) -> tuple[Floats, Floats, Floats]:
        """Return the opening that flow rules lack in triangles (t,), inner (k, 2) and dry edges (j, 2).

        −inf if crushing.
        """
        p = self.problem
        dry = p.is_dry(labels)
        cut = p.jumps[~dry[p.jumps]]
        joint = np.flatnonzero(dry)
        opening, slip = rates.opening[joint], rates.slip[joint]
        face = p.face[joint]
        lack = p.joints.friction[face][:, None] * slip - opening
        return (
            p.material.missing(rates.trace, rates.shear),
            p.material.missing(rates.opening[cut], np.hypot(rates.opening[cut], rates.slip[cut])),
            np.where(np.isinf(p.joints.crushing[face])[:, None], lack, -np.inf),
        )

    def power(self, rates: Rates, labels: Bits, allowance: float = 0.0) -> Floats:
        """Return the power dissipated in each triangle with half of its edges, (t,), scaled."""
        # Power on a side is the mean of its corners, which bounds that of a linear jump from above: dissipation is
        # convex.
        p, s, dry = self.problem, self.problem.sides, self.problem.is_dry(labels)
        power = p.mesh.volume * p.material.dissipation(rates.trace, rates.shear, allowance)
        cut, joint, ends = p.jumps[~dry[p.jumps]], np.flatnonzero(dry), np.zeros_like(rates.opening)
        opening, slip = rates.opening[cut], rates.slip[cut]
        ends[cut] = p.material.dissipation(opening, np.hypot(opening, slip), allowance)
        ends[joint] = self.joint_power(rates, joint, allowance)
        total = s.area / p.mesh.dimension * ends.sum(axis=1)
        return halved(p, power, np.arange(len(s)), total)

    def joint_power(self, rates: Rates, rows: Ints, allowance: float = 0.0) -> Floats:
        """Return the power per area (k, 2) of edges (k,) as dry joints, at both ends, scaled."""
        p = self.problem
        face = p.face[rows]
        slip, opening = rates.slip[rows], rates.opening[rows]
        mu, c, crush = (v[face][:, None] for v in (p.joints.friction, p.joints.shear, p.joints.crushing))
        lack = mu * slip - opening
        with np.errstate(invalid="ignore"):
            crushed = np.where(lack > np.where(np.isinf(crush), allowance, 0.0), crush * lack, 0.0)
        return np.asarray(c * slip + crushed)


def jumps(problem: Problem, velocity: Floats, rows: Ints) -> Floats:
    """Return the velocity jumps (k, d, d), b less a, at the corners of sides (k,)."""
    s = problem.sides
    jump = -velocity[s.a[rows][:, None], s.corner_a[rows]]
    both = s.b[rows] >= 0
    jump[both] += velocity[s.b[rows[both]][:, None], s.corner_b[rows[both]]]
    return np.asarray(jump)


def halved(problem: Problem, power: Floats, rows: Ints, total: Floats) -> Floats:
    """Add values (k,) of sides to the simplices (t,) on both of their sides, half to each."""
    s, both = problem.sides, problem.sides.b[rows] >= 0
    np.add.at(power, s.a[rows], np.where(both, 0.5, 1.0) * total)
    np.add.at(power, s.b[rows[both]], 0.5 * total[both])
    return power
