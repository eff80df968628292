"""Yield sets with part of their state frozen: friction that does not know of the present N, effective areas.

The conic programs of associative limit analysis stay what they are; only the numbers of the rows that say
|V| + |MT|/c_T ≤ c + μN change. Whatever takes a yield set — programs, bounds, repairs — takes these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.mechanics.yield_set import CoulombWedge, FrictionSet, ParabolicBending, RowPattern, Rows


@dataclass(frozen=True)
class EffectiveAreas:
    """Effective rectangles of m spatial faces, as they enter torsion: e = ρ (mT + a·V), |V| + |e| ≤ capacity.

    ratio: (m,) ρ = c_T / c_T,e ≥ 1. arm: (m, 2) a = (x2, −x1) / c_T. Source: Iannuzzo et al. 2024, eq. (5), (8).
    """

    ratio: Floats
    arm: Floats


@dataclass(frozen=True)
class PrescribedFriction:
    """A yield set whose friction is μ (α N + (1 − α) N_prev), with torsion about frozen effective areas.

    base: the set of associative friction. alpha: α, share of the present N; 1 leaves the friction as it is, 0
    leaves none of its dilation. previous: (m,) N_prev, scaled, taken as no less than a face can carry. areas: None
    leaves torsion of dry faces as it is. Bending and cohesion are those of the base. Faces of either label rub.
    Source: Gilbert et al. 2006; docs/method.md (4.1).
    """

    base: FrictionSet
    alpha: float
    previous: Floats
    areas: EffectiveAreas | None = None

    @property
    def associative(self) -> FrictionSet:
        return self.base

    @cached_property
    def pattern(self) -> RowPattern:
        """Rows of the base with what limits shear changed; with areas, V enters those of dry faces too."""
        base = self.base.pattern
        entries = base.capacity
        head, face = base.row[entries], base.face[entries]
        dry, h_dry, inner, h_inner = base.dry.copy(), base.h_dry.copy(), base.inner, base.h_inner
        h_dry[head] -= (1.0 - self.alpha) * dry[entries] * self._previous[0][face]
        dry[entries] *= self.alpha
        if inner[entries].any():
            inner, h_inner = inner.copy(), h_inner.copy()
            h_inner[head] -= (1.0 - self.alpha) * inner[entries] * self._previous[1][face]
            inner[entries] *= self.alpha
        changed = replace(base, dry=dry, h_dry=h_dry, inner=inner, h_inner=h_inner)
        return changed if self.areas is None else self._with_areas(changed, self.areas)

    @cached_property
    def _previous(self) -> tuple[Floats, Floats]:
        """N_prev of faces as dry and as inner."""
        return np.maximum(self.previous, 0.0), np.maximum(self.previous, -self.base.tension)

    def _frozen(self, labels: Bits) -> Floats:
        """(m,) (1 − α) μ N_prev."""
        previous = np.where(self.base.is_dry(labels), *self._previous)
        return np.asarray((1.0 - self.alpha) * self.base.friction_of(labels) * previous)

    def _with_areas(self, pattern: RowPattern, areas: EffectiveAreas) -> RowPattern:
        """Torsion rows t ± e ≤ capacity, divided by ρ so that no coefficient exceeds order one."""
        p, own = pattern, 6 * len(self.previous)
        twist = np.flatnonzero((p.column < own) & (p.column % 6 == 5) & (p.dry != 0.0))
        row, face, sign = p.row[twist], p.face[twist], p.dry[twist]
        divisor = np.ones(len(p.h_dry))
        divisor[row] = areas.ratio[face]
        h_dry, dry = p.h_dry / divisor, p.dry / divisor[p.row]
        dry[twist] = sign
        none = np.zeros(len(row))
        return replace(
            p,
            row=np.concatenate([p.row, row, row]),
            column=np.concatenate([p.column, 6 * face + 1, 6 * face + 2]),
            face=np.concatenate([p.face, face, face]),
            dry=np.concatenate([dry, sign * areas.arm[face, 0], sign * areas.arm[face, 1]]),
            inner=np.concatenate([p.inner, none, none]),
            h_dry=h_dry,
        )

    @cached_property
    def _smooth(self) -> FrictionSet:
        """The base in bending alone."""
        return self.base.bending_alone()

    @cached_property
    def _associated(self) -> FrictionSet:
        """The base with the share of friction that follows the present N."""
        return self.base.with_friction(self.alpha)

    def rubs(self, labels: Bits) -> Bools:
        """(m,) faces with friction."""
        return np.asarray(self.base.friction_of(labels) > 0.0)

    def slides(self, labels: Bits) -> Bools:
        """(m,) faces that may slide without opening: dry ones, and inner ones with friction."""
        return np.asarray(self.base.is_dry(labels) | self.rubs(labels))

    def shear(self, forces: Floats, labels: Bits) -> Floats:
        """(m,) |V| + |e| of scaled resultants (m, q), to be held against the capacity."""
        return self.base.shear_of(self._forces_about(forces, labels))

    def slip(self, jumps: Floats, labels: Bits) -> Floats:
        """(m,) rate at which friction works per unit of capacity: max(|s|, c_T,e |ω|) at the effective area."""
        return self.base.slip(self._jumps_about(jumps, labels))

    def price(self, jumps: Floats, labels: Bits) -> Floats:
        """(m,) what one unit of N costs in friction that sliding without dilation overcomes: μ times slip."""
        return np.asarray(self.base.friction_of(labels) * self.slip(jumps, labels))

    def excess(self, forces: Floats, labels: Bits) -> Floats:
        """(m,) how far shear exceeds c + μN for the present N, ≤ 0 where it does not; −inf where nothing rubs."""
        capacity = self.base.cohesion_of(labels) + self.base.friction_of(labels) * forces[:, 0]
        return np.where(self.rubs(labels), self.shear(forces, labels) - capacity, -np.inf)

    def dilation(self, jumps: Floats, labels: Bits) -> Floats:
        """(m,) δ beyond what bending opens, docs/method.md (4.5), where faces slide; else 0, and where they crush."""
        beyond = self._smooth.margin(self._jumps_about(jumps, labels), labels)
        return np.where(self.slides(labels) & np.isfinite(beyond), beyond, 0.0)

    def _forces_about(self, forces: Floats, labels: Bits) -> Floats:
        if self.areas is None:
            return forces
        about = forces.copy()
        push = np.einsum("ij,ij->i", self.areas.arm, forces[:, 1:3])
        about[:, 5] = np.where(self.base.is_dry(labels), self.areas.ratio * (forces[:, 5] + push), forces[:, 5])
        return about

    def _jumps_about(self, jumps: Floats, labels: Bits) -> Floats:
        """Jumps dual to (V, e): the slip at the centre of pressure, and the turn over ρ."""
        if self.areas is None:
            return jumps
        about, dry = jumps.copy(), self.base.is_dry(labels)
        moved = jumps[:, 1:3] - self.areas.arm * jumps[:, 5:6]
        about[:, 1:3] = np.where(dry[:, None], moved, jumps[:, 1:3])
        about[:, 5] = np.where(dry, jumps[:, 5] / self.areas.ratio, jumps[:, 5])
        return about

    # --- the protocol ------------------------------------------------------------------------------------

    def active(self, labels: Bits) -> Bools:
        return self.base.active(labels)

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        follows = self.base.friction_of(labels) * self.alpha * forces[:, 0]
        room = self.base.cohesion_of(labels) + follows + self._frozen(labels) - self.shear(forces, labels)
        if self.areas is not None:
            # a change of the resultants by one changes e by up to ρ (1 + |a|)
            steep = self.areas.ratio * (1.0 + np.abs(self.areas.arm).sum(axis=1))
            room = np.where(self.base.is_dry(labels), room / steep, room)
        holds = self.base.friction_of(labels) + self.base.cohesion_of(labels) > 0.0
        return np.minimum(self._smooth.slack(forces, labels), np.where(holds, room, np.inf))

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        return self._associated.recession_slack(self._forces_about(forces, labels), labels)

    def recession_active(self, labels: Bits) -> Bools:
        return self._associated.recession_active(labels)

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        frozen = self._frozen(labels) * self.slip(jumps, labels)
        return np.asarray(self._associated.dissipation(self._jumps_about(jumps, labels), labels) + frozen)

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        return self._associated.margin(self._jumps_about(jumps, labels), labels)

    def utilisation(self, forces: Floats, labels: Bits) -> Floats | None:
        return None  # of a capacity that is not that of these forces

    def hull(self) -> Rows | None:
        return None

    def bow(self, *, undecided: bool) -> ParabolicBending | None:
        return None

    def wedge(self, dry: bool) -> CoulombWedge | None:
        return None

    def facets(self, labels: Bits) -> tuple[Floats, Floats] | None:
        return None
