"""What one certified field proves for other labellings: upper and lower bounds on λ, docs/method.md (9.13), (9.14).

Only the dissipation of faces depends on labels, each on its own. A stress field within yield everywhere stands under
every labelling whose dry faces it presses within friction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.fields.lower import LowerBound, StressField
from jld_core.fields.upper import UpperBound, VelocityField

# Opening that a flow rule may lack, over the largest velocity, and that an opening motion makes good.
# The first that costs little is taken: where cells hardly open, their motion dissipates much.
REPAIRED = (1e-7, 1e-9, 0.0)

_COST = 1e-3  # relative rise of the bound of the field's own labelling up to which a repair is accepted


@dataclass(frozen=True)
class FieldMechanism:
    """Upper bounds that one velocity field proves: `constant` plus `dry` or `inner` of each face (9.13)."""

    constant: float  # dissipation in the blocks less dead work, at live work one; scene units of λ
    # dry, inner: (m,) dissipation on each face under that label, scene units of λ; inf where its flow rule is violated
    dry: Floats
    inner: Floats

    def bounds(self, labellings: Bits) -> Floats:
        """Return the upper bound on λ (k,) of labellings (k, m); inf where a flow rule is violated."""
        dry, inner = (np.where(np.isfinite(part), part, 0.0) for part in (self.dry, self.inner))
        bounds = self.constant + inner.sum() + labellings @ (dry - inner)
        violated = (labellings & np.isinf(self.dry)) | (~labellings & np.isinf(self.inner))
        # sums in another order round differently
        size = abs(self.constant) + float((np.abs(dry) + np.abs(inner)).sum())
        return np.where(violated.any(axis=1), np.inf, bounds + tolerances.SUMMATION * size)

    def bound_of(self, labels: Bits, undecided: Bools) -> float:
        """Return the upper bound on λ of all labellings that agree where decided (9.15).

        Inf where a flow rule is violated.
        """
        parts = np.where(undecided, np.maximum(self.dry, self.inner), np.where(labels, self.dry, self.inner))
        size = abs(self.constant) + float(np.abs(parts).sum())
        return self.constant + float(parts.sum()) + tolerances.SUMMATION * size

    def costs(self, labels: Bits) -> Floats:
        """Return by how much (m,) the bound rises if one face becomes undecided; inf where a flow rule is violated."""
        labelled, relabelled = np.where(labels, self.dry, self.inner), np.where(labels, self.inner, self.dry)
        finite = np.isfinite(labelled)
        return np.where(finite, np.maximum(relabelled, labelled) - np.where(finite, labelled, 0.0), np.inf)


@dataclass(frozen=True)
class FieldStresses:
    """Lower bound of all labellings whose dry faces are among `may_be_dry`, docs/method.md (9.14)."""

    load_factor: float  # λ that the field carries, scene units
    may_be_dry: Bools  # (m,) faces on which tractions are within friction, shear strength and crushing of the dry joint

    def bounds(self, labellings: Bits) -> Floats:
        """Return the lower bound on λ (k,) of labellings (k, m); −inf where it does not hold."""
        return np.where((labellings & ~self.may_be_dry).any(axis=1), -np.inf, self.load_factor)


def mechanism_of(upper: UpperBound, field: VelocityField, labels: Bits) -> FieldMechanism | None:
    """Compute the upper bounds that the velocity field of labels (m,) proves for all labellings.

    Small violations under either label are opened first, where that costs little; None where nothing is proven.
    """
    bound = field.factor * upper.problem.units.load
    for share in REPAIRED:
        mechanism = mechanism_bounds(upper, upper.repaired(field.velocity, share))
        if mechanism is not None and mechanism.bounds(labels[None])[0] <= bound + _COST * abs(bound):
            return mechanism
    return None


def mechanism_bounds(upper: UpperBound, velocity: Floats) -> FieldMechanism | None:
    """Compute the upper bounds that velocities (t, d + 1, d) prove under either label of each face (9.13).

    None without live work, or with infinite dissipation in blocks.
    """
    problem, sides = upper.problem, upper.problem.sides
    rates = upper.rates(velocity)
    allowance = upper.allowance(velocity)
    work = float((upper.live * velocity).sum())
    if not work > 0.0:
        return None
    # dissipation is convex along a side, so its corner values bound it
    corner_share = sides.area / problem.mesh.dimension
    crack_power = problem.material.dissipation(rates.opening, np.hypot(rates.opening, rates.slip), allowance)
    in_cells = corner_share[problem.inside] * crack_power[problem.inside].sum(axis=1)
    in_simplices = problem.mesh.volume * problem.material.dissipation(rates.trace, rates.shear, allowance)
    dead = upper.dead * velocity
    slack = tolerances.SUMMATION * (float(in_cells.sum()) + float(in_simplices.sum()) + float(np.abs(dead).sum()))
    constant = (float(in_cells.sum()) + float(in_simplices.sum()) - float(dead.sum()) + slack) / work
    if not np.isfinite(constant):
        return None
    rows = problem.on_faces
    face, count = problem.face[rows], len(problem.joints.friction)
    joint = corner_share[rows] * upper.joint_power(rates, rows, allowance).sum(axis=1)
    crack = corner_share[rows] * crack_power[rows].sum(axis=1)
    load = problem.units.load
    dry, inner = (np.asarray(np.bincount(face, part, minlength=count) * (load / work)) for part in (joint, crack))
    return FieldMechanism(constant * load, dry.astype(np.float64), inner.astype(np.float64))


def stresses_of(lower: LowerBound, field: StressField, labels: Bits) -> FieldStresses:
    """Compute the labellings for which a certified stress field proves its bound, with `field.charge` to spare."""
    problem = lower.problem
    rows = problem.on_faces
    fits = lower.joint_room(field.stress, rows).min(axis=1) >= field.charge
    fits &= labels[problem.face[rows]] | ~lower.frictionless[problem.face[rows]]
    misfits = np.bincount(problem.face[rows], ~fits, minlength=len(problem.joints.friction))
    return FieldStresses(field.factor * problem.units.load, misfits == 0)
