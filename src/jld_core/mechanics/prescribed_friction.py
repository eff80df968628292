"""Yield sets with part of their state frozen: friction that does not know of the present N, effective areas.

The conic programs of associative limit analysis stay what they are; only the numbers of the rows that say
|V| + |MT|/c_T ≤ μN on dry faces change. Whatever takes a yield set — programs, bounds, repairs — takes these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.mechanics.yield_planar import PlanarYield
from jld_core.mechanics.yield_set import RowPattern
from jld_core.mechanics.yield_spatial import SpatialYield


@dataclass(frozen=True)
class Contact:
    """Effective rectangles of m spatial faces, as they enter torsion: e = ρ (mT + a·V), |V| + |e| ≤ capacity.

    ratio: (m,) ρ = c_T / c_T,e ≥ 1. arm: (m, 2) a = (x2, −x1) / c_T. Source: Iannuzzo et al. 2024, eq. (5), (8).
    """

    ratio: Floats
    arm: Floats


@dataclass(frozen=True)
class PrescribedFriction:
    """A yield set whose dry friction is μ (α N + (1 − α) N_prev), with torsion about frozen effective areas.

    base: the set of associative friction. alpha: α, share of the present N; 1 leaves the friction as it is, 0
    leaves none of its dilation. previous: (m,) N_prev ≥ 0, scaled. contact: None leaves torsion as it is.
    Inner faces and bending are those of the base. Source: Gilbert et al. 2006; docs/method.md (4.1).
    """

    base: PlanarYield | SpatialYield
    alpha: float
    previous: Floats
    contact: Contact | None = None

    @cached_property
    def pattern(self) -> RowPattern:
        """Rows of the base with the shear rows of dry faces changed; with a contact, V enters them too."""
        base = self.base.pattern
        head = base.row[self._capacity_entries]
        dry, h_dry = base.dry.copy(), base.h_dry.copy()
        face = base.face[self._capacity_entries]
        h_dry[head] -= (1.0 - self.alpha) * dry[self._capacity_entries] * self.previous[face]
        dry[self._capacity_entries] *= self.alpha
        changed = replace(base, dry=dry, h_dry=h_dry)
        return changed if self.contact is None else self._with_contact(changed, self.contact)

    @cached_property
    def _capacity_entries(self) -> Ints:
        """Entries of the pattern that hold −μN in a shear row of a dry face with friction."""
        p, q, own = self.base.pattern, self._freedoms, self._freedoms * len(self.previous)
        resultant = np.where(p.column < own, p.column % q, q)
        sheared = np.zeros(len(p.h_dry), dtype=bool)
        if isinstance(self.base, PlanarYield):
            sheared[p.row[(resultant == 1) & (p.dry != 0.0)]] = True
        else:
            sheared[p.row[(resultant == 5) & (p.dry != 0.0)]] = True
            # at a point the head of the cone holds μN itself, and nothing else there holds N in a cone
            sheared[p.row[(resultant == 0) & self.base.point[p.face] & (p.row >= p.linear)]] = True
        slides = self.base.friction[p.face] > 0.0
        return np.flatnonzero(sheared[p.row] & (resultant == 0) & slides)

    def _with_contact(self, pattern: RowPattern, contact: Contact) -> RowPattern:
        """Torsion rows t ± e ≤ capacity, divided by ρ so that no coefficient exceeds order one."""
        p, own = pattern, 6 * len(self.previous)
        twist = np.flatnonzero((p.column < own) & (p.column % 6 == 5) & (p.dry != 0.0))
        row, face, sign = p.row[twist], p.face[twist], p.dry[twist]
        divisor = np.ones(len(p.h_dry))
        divisor[row] = contact.ratio[face]
        h_dry, dry = p.h_dry / divisor, p.dry / divisor[p.row]
        dry[twist] = sign
        none = np.zeros(len(row))
        return replace(
            p,
            row=np.concatenate([p.row, row, row]),
            column=np.concatenate([p.column, 6 * face + 1, 6 * face + 2]),
            face=np.concatenate([p.face, face, face]),
            dry=np.concatenate([dry, sign * contact.arm[face, 0], sign * contact.arm[face, 1]]),
            inner=np.concatenate([p.inner, none, none]),
            h_dry=h_dry,
        )

    @property
    def _freedoms(self) -> int:
        return 3 if isinstance(self.base, PlanarYield) else 6

    @cached_property
    def _smooth(self) -> PlanarYield | SpatialYield:
        """The base without friction: its bending alone."""
        return replace(self.base, friction=np.zeros(len(self.previous)))

    @cached_property
    def _associated(self) -> PlanarYield | SpatialYield:
        """The base with the share of friction that follows the present N."""
        return replace(self.base, friction=self.alpha * self.base.friction)

    def dry(self, labels: Bits) -> Bools:
        """(m,) faces with dry friction: points have it under either label."""
        return np.asarray(labels if isinstance(self.base, PlanarYield) else labels | self.base.point)

    def _rubs(self, labels: Bits) -> Bools:
        return np.asarray(self.dry(labels) & (self.base.friction > 0.0))

    def shear(self, forces: Floats, labels: Bits) -> Floats:
        """(m,) |V| + |e| of scaled resultants (m, q), to be held against the capacity."""
        forces = self._forces_about(forces, labels)
        if isinstance(self.base, PlanarYield):
            return np.abs(forces[:, 1])
        twist = np.where(self.base.point, 0.0, np.abs(forces[:, 5]))
        return np.asarray(np.hypot(forces[:, 1], forces[:, 2]) + twist)

    def slip(self, jumps: Floats, labels: Bits) -> Floats:
        """(m,) rate at which friction works per unit of capacity: max(|s|, c_T,e |ω|) at the effective area."""
        jumps = self._jumps_about(jumps, labels)
        if isinstance(self.base, PlanarYield):
            return np.abs(jumps[:, 1])
        turn = np.where(self.base.point, 0.0, np.abs(jumps[:, 5]))
        return np.asarray(np.maximum(np.hypot(jumps[:, 1], jumps[:, 2]), turn))

    def excess(self, forces: Floats, labels: Bits) -> Floats:
        """(m,) how far shear exceeds μN for the present N on dry faces, ≤ 0 where it does not; −inf elsewhere."""
        over = self.shear(forces, labels) - self.base.friction * forces[:, 0]
        return np.where(self._rubs(labels), over, -np.inf)

    def dilation(self, jumps: Floats, labels: Bits) -> Floats:
        """(m,) δ beyond what bending opens on dry faces (docs/method.md (4.5)), 0 elsewhere and where they crush."""
        beyond = self._smooth.margin(self._jumps_about(jumps, labels), labels)
        return np.where(self.dry(labels) & np.isfinite(beyond), beyond, 0.0)

    def _forces_about(self, forces: Floats, labels: Bits) -> Floats:
        if self.contact is None:
            return forces
        about = forces.copy()
        push = np.einsum("ij,ij->i", self.contact.arm, forces[:, 1:3])
        about[:, 5] = np.where(self.dry(labels), self.contact.ratio * (forces[:, 5] + push), forces[:, 5])
        return about

    def _jumps_about(self, jumps: Floats, labels: Bits) -> Floats:
        """Jumps dual to (V, e): the slip at the centre of pressure, and the turn over ρ."""
        if self.contact is None:
            return jumps
        about, dry = jumps.copy(), self.dry(labels)
        moved = jumps[:, 1:3] - self.contact.arm * jumps[:, 5:6]
        about[:, 1:3] = np.where(dry[:, None], moved, jumps[:, 1:3])
        about[:, 5] = np.where(dry, jumps[:, 5] / self.contact.ratio, jumps[:, 5])
        return about

    # --- the protocol ------------------------------------------------------------------------------------

    def active(self, labels: Bits) -> Bools:
        return self.base.active(labels)

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        capacity = self.base.friction * (self.alpha * forces[:, 0] + (1.0 - self.alpha) * self.previous)
        room = capacity - self.shear(forces, labels)
        if self.contact is not None:
            # a change of the resultants by one changes e by up to ρ (1 + |a|)
            room = room / (self.contact.ratio * (1.0 + np.abs(self.contact.arm).sum(axis=1)))
        dry = np.minimum(self._smooth.slack(forces, labels), np.where(self._rubs(labels), room, np.inf))
        return np.where(self.dry(labels), dry, self.base.slack(forces, labels))

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        return self._associated.recession_slack(self._forces_about(forces, labels), labels)

    def recession_active(self, labels: Bits) -> Bools:
        return self._associated.recession_active(labels)

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        frozen = (1.0 - self.alpha) * self.base.friction * self.previous * self.slip(jumps, labels)
        rest = self._associated.dissipation(self._jumps_about(jumps, labels), labels)
        return np.asarray(rest + np.where(self._rubs(labels), frozen, 0.0))

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        return self._associated.margin(self._jumps_about(jumps, labels), labels)
