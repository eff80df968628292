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

REPAIRED = (1e-7, 1e-9, 0.0)
"""Opening that a flow rule may lack, over the largest velocity, and that an opening motion makes good.

The first that costs little is taken: where cells hardly open, their motion dissipates much.
"""

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
        found = self.constant + inner.sum() + labellings @ (dry - inner)
        wrong = (labellings & np.isinf(self.dry)) | (~labellings & np.isinf(self.inner))
        # sums in another order round differently
        size = abs(self.constant) + float((np.abs(dry) + np.abs(inner)).sum())
        return np.where(wrong.any(axis=1), np.inf, found + tolerances.SUMMATION * size)

    def bound_of(self, labels: Bits, undecided: Bools) -> float:
        """Return the upper bound on λ of all labellings that agree where decided (9.15).

        Inf where a flow rule is violated.
        """
        parts = np.where(undecided, np.maximum(self.dry, self.inner), np.where(labels, self.dry, self.inner))
        size = abs(self.constant) + float(np.abs(parts).sum())
        return self.constant + float(parts.sum()) + tolerances.SUMMATION * size

    def costs(self, labels: Bits) -> Floats:
        """Return by how much (m,) the bound rises if one face becomes undecided; inf where a flow rule is violated."""
        own, other = np.where(labels, self.dry, self.inner), np.where(labels, self.inner, self.dry)
        return np.where(np.isfinite(own), np.maximum(other, own) - np.where(np.isfinite(own), own, 0.0), np.inf)


@dataclass(frozen=True)
class FieldStresses:
    """Lower bound of all labellings whose dry faces are among `may_be_dry`, docs/method.md (9.14)."""

    load_factor: float  # λ that the field carries, scene units
    may_be_dry: Bools  # (m,) faces on which tractions are within friction, shear strength and crushing of the dry joint

    def bounds(self, labellings: Bits) -> Floats:
        """Return the lower bound on λ (k,) of labellings (k, m); −inf where it does not hold."""
        return np.where((labellings & ~self.may_be_dry).any(axis=1), -np.inf, self.load_factor)


def mechanism_of(upper: UpperBound, field: VelocityField, labels: Bits) -> FieldMechanism | None:
    """Compute the upper bounds that a velocity field proves for all labellings, still faces opened a little.

    Or None.
    """
    own = field.factor * upper.problem.units.load
    for share in REPAIRED:
        found = weighed(upper, upper.repaired(field.velocity, share))
        if found is not None and found.bounds(labels[None])[0] <= own + _COST * abs(own):
            return found
    return None


def weighed(upper: UpperBound, velocity: Floats) -> FieldMechanism | None:
    """Compute dissipation of velocities (t, 3, 2) in blocks and on faces under both labels, for a proof.

    None if infinite.
    """
    p, s = upper.problem, upper.problem.sides
    rates = upper.rates(velocity)
    allowance = upper.allowance(velocity)
    work = float((upper.live * velocity).sum())
    if not work > 0.0:
        return None
    half = s.area / p.mesh.dimension
    ends = p.material.dissipation(rates.opening, np.hypot(rates.opening, rates.slip), allowance)
    inside = half[p.inside] * ends[p.inside].sum(axis=1)
    blocks = p.mesh.volume * p.material.dissipation(rates.trace, rates.shear, allowance)
    dead = upper.dead * velocity
    slack = tolerances.SUMMATION * (float(inside.sum()) + float(blocks.sum()) + float(np.abs(dead).sum()))
    constant = (float(inside.sum()) + float(blocks.sum()) - float(dead.sum()) + slack) / work
    if not np.isfinite(constant):
        return None
    rows = p.on_faces
    face, count = p.face[rows], len(p.joints.friction)
    joint = half[rows] * upper.joint_power(rates, rows, allowance).sum(axis=1)
    crack = half[rows] * ends[rows].sum(axis=1)
    load = p.units.load
    dry, inner = (np.asarray(np.bincount(face, part, minlength=count) * (load / work)) for part in (joint, crack))
    return FieldMechanism(constant * load, dry.astype(np.float64), inner.astype(np.float64))


def stresses_of(lower: LowerBound, field: StressField, labels: Bits) -> FieldStresses:
    """Compute the labellings for which a certified stress field proves its bound, with `field.charge` to spare."""
    p = lower.problem
    rows = p.on_faces
    fits = lower.joint_room(field.stress, rows).min(axis=1) >= field.charge
    fits &= labels[p.face[rows]] | ~lower.frictionless[p.face[rows]]
    wrong = np.bincount(p.face[rows], ~fits, minlength=len(p.joints.friction))
    return FieldStresses(field.factor * p.units.load, wrong == 0)
