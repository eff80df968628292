"""Yield sets with friction from prescribed normal forces, and constant effective areas.

Only the numbers in the rows |V| + |MT|/c_T ≤ c + μN change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.mechanics.yield_set import CoulombWedge, FrictionSet, ParabolicBending, RowPattern, Rows


@dataclass(frozen=True)
class EffectiveAreas:
    """Effective rectangles of m spatial faces, parts that resist torsion, as factors.

    A part lies about the centre of pressure x. With V and mT = MT / c_T the limit on shear is |V| + ρ |mT + a·V| ≤ μN.
    Source: Iannuzzo et al. 2024, eq. (5), (8); docs/method.md (2.14), (2.15).
    """

    ratio: Floats  # (m,) ρ = c_T / c_T,e ≥ 1, of the torsion lengths of the whole face and the part; 1 for whole faces
    arm: Floats  # (m, 2) a = (x2, −x1) / c_T; 0 for whole faces


@dataclass(frozen=True)
class PrescribedFriction:
    """Yield set with friction μ (α N + (1 − α) N_prev) and frozen effective areas; bending is that of `base`.

    Source: Gilbert et al. 2006; docs/method.md (4.1).
    """

    base: FrictionSet
    alpha: float  # 1 is associative friction, 0 friction without dilation
    previous: Floats  # (m,) N_prev, raised to the least N that a face carries
    areas: EffectiveAreas | None = None  # None leaves the torsion of dry faces

    @property
    def associative(self) -> FrictionSet:
        return self.base

    @cached_property
    def pattern(self) -> RowPattern:
        # With effective areas, V enters the torsion rows of dry faces too.
        base = self.base.pattern
        entries = base.capacity
        row, face = base.row[entries], base.face[entries]
        dry, h_dry, inner, h_inner = base.dry.copy(), base.h_dry.copy(), base.inner, base.h_inner
        h_dry[row] -= (1.0 - self.alpha) * dry[entries] * self._previous[0][face]
        dry[entries] *= self.alpha
        if inner[entries].any():
            inner, h_inner = inner.copy(), h_inner.copy()
            h_inner[row] -= (1.0 - self.alpha) * inner[entries] * self._previous[1][face]
            inner[entries] *= self.alpha
        changed = replace(base, dry=dry, h_dry=h_dry, inner=inner, h_inner=h_inner)
        return changed if self.areas is None else self._with_areas(changed, self.areas)

    @cached_property
    def _previous(self) -> tuple[Floats, Floats]:
        """Return N_prev (m,) for all faces dry, and inner: raised to the least N, 0 if dry, −σtA if inner."""
        return np.maximum(self.previous, 0.0), np.maximum(self.previous, -self.base.tension)

    def _frozen(self, labels: Bits) -> Floats:
        """Return the part (1 − α) μ N_prev (m,) of the shear capacity, independent of N, scaled."""
        previous = np.where(self.base.is_dry(labels), *self._previous)
        return np.asarray((1.0 - self.alpha) * self.base.friction_of(labels) * previous)

    def _with_areas(self, pattern: RowPattern, areas: EffectiveAreas) -> RowPattern:
        # The torsion rows of dry faces become t ± ρ (mT + a·V) ≤ capacity, divided by ρ to keep coefficients of order
        # one.
        face_columns = 6 * len(self.previous)
        is_torsion = (pattern.column < face_columns) & (pattern.column % 6 == 5)
        torsion_entries = np.flatnonzero(is_torsion & (pattern.dry != 0.0))
        row, face, sign = pattern.row[torsion_entries], pattern.face[torsion_entries], pattern.dry[torsion_entries]
        divisor = np.ones(len(pattern.h_dry))
        divisor[row] = areas.ratio[face]
        h_dry, dry = pattern.h_dry / divisor, pattern.dry / divisor[pattern.row]
        dry[torsion_entries] = sign
        zeros = np.zeros(len(row))
        return replace(
            pattern,
            row=np.concatenate([pattern.row, row, row]),
            column=np.concatenate([pattern.column, 6 * face + 1, 6 * face + 2]),
            face=np.concatenate([pattern.face, face, face]),
            dry=np.concatenate([dry, sign * areas.arm[face, 0], sign * areas.arm[face, 1]]),
            inner=np.concatenate([pattern.inner, zeros, zeros]),
            h_dry=h_dry,
        )

    @cached_property
    def _smooth(self) -> FrictionSet:
        """Return the base yield set without any limit on shear, for its limits in bending."""
        return self.base.without_shear_limit()

    @cached_property
    def _associated(self) -> FrictionSet:
        """Return the base yield set with friction αμ, the part that depends on the present N."""
        return self.base.with_friction(self.alpha)

    def has_friction(self, labels: Bits) -> Bools:
        return np.asarray(self.base.friction_of(labels) > 0.0)

    def slides(self, labels: Bits) -> Bools:
        """Return the faces (m,) that may slide without opening: dry ones, and inner ones with friction."""
        return np.asarray(self.base.is_dry(labels) | self.has_friction(labels))

    def shear(self, forces: Floats, labels: Bits) -> Floats:
        """Return the shear demand (m,) of forces (m, q), with torsion about effective areas."""
        return self.base.shear_of(self._forces_about(forces, labels))

    def slip(self, jumps: Floats, labels: Bits) -> Floats:
        """Return max(|s|, |ω|/ρ) (m,) of scaled jumps (m, q): slip at the centre of pressure, and spin."""
        return self.base.slip(self._jumps_about(jumps, labels))

    def price(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the friction dissipation μ · `slip` (m,) per unit of normal force, for slips without dilation."""
        return np.asarray(self.base.friction_of(labels) * self.slip(jumps, labels))

    def excess(self, forces: Floats, labels: Bits) -> Floats:
        """Return shear demand minus capacity c + μN (m,) by the present N; −inf without friction."""
        capacity = self.base.capacity_of(labels) + self.base.friction_of(labels) * forces[:, 0]
        return np.where(self.has_friction(labels), self.shear(forces, labels) - capacity, -np.inf)

    def dilation(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the opening (m,) beyond that of rotation (4.5), 0 if a face cannot slide, or crushes."""
        excess = self._smooth.margin(self._jumps_about(jumps, labels), labels)
        return np.where(self.slides(labels) & np.isfinite(excess), excess, 0.0)

    def _forces_about(self, forces: Floats, labels: Bits) -> Floats:
        """Return resultants (m, q) with the torsion ρ (mT + a·V) of dry faces about effective areas."""
        if self.areas is None:
            return forces
        result = forces.copy()
        about_area = forces[:, 5] + np.einsum("ij,ij->i", self.areas.arm, forces[:, 1:3])
        result[:, 5] = np.where(self.base.is_dry(labels), self.areas.ratio * about_area, forces[:, 5])
        return result

    def _jumps_about(self, jumps: Floats, labels: Bits) -> Floats:
        """Return jumps (m, q) that do on `_forces_about` the work of the given ones."""
        if self.areas is None:
            return jumps
        result, dry = jumps.copy(), self.base.is_dry(labels)
        slip = jumps[:, 1:3] - self.areas.arm * jumps[:, 5:6]
        result[:, 1:3] = np.where(dry[:, None], slip, jumps[:, 1:3])
        result[:, 5] = np.where(dry, jumps[:, 5] / self.areas.ratio, jumps[:, 5])
        return result

    # --- methods of the protocol YieldSet ----------------------------------------------------------------

    def active(self, labels: Bits) -> Bools:
        return self.base.active(labels)

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of scaled forces (m, q) under labels (m,), see `YieldSet.slack`."""
        present_friction = self.base.friction_of(labels) * self.alpha * forces[:, 0]
        room = self.base.capacity_of(labels) + present_friction + self._frozen(labels) - self.shear(forces, labels)
        if self.areas is not None:
            # A unit change of the resultants changes e by up to ρ (1 + |a|).
            steepness = self.areas.ratio * (1.0 + np.abs(self.areas.arm).sum(axis=1))
            room = np.where(self.base.is_dry(labels), room / steepness, room)
        resists_shear = self.base.friction_of(labels) + self.base.capacity_of(labels) > 0.0
        return np.minimum(self._smooth.slack(forces, labels), np.where(resists_shear, room, np.inf))

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        return self._associated.recession_slack(self._forces_about(forces, labels), labels)

    def recession_active(self, labels: Bits) -> Bools:
        return self._associated.recession_active(labels)

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        frozen = self._frozen(labels) * self.slip(jumps, labels)
        return np.asarray(self._associated.dissipation(self._jumps_about(jumps, labels), labels) + frozen)

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        return self._associated.margin(self._jumps_about(jumps, labels), labels)

    def strength(self, labels: Bits) -> Floats:
        """Return the strength (m,) of the faces with associative friction, see `YieldSet.strength`."""
        return self.base.strength(labels)

    def utilisation(self, forces: Floats, labels: Bits) -> Floats | None:
        """Return None: the shear capacity depends on N_prev, not on the forces given."""
        return None

    def hull(self) -> Rows | None:
        """Return None: rows of undecided faces are not available for prescribed friction."""
        return None

    def parabolic_bending(self, *, undecided: bool) -> ParabolicBending | None:
        return None

    def coulomb_wedge(self, dry: bool) -> CoulombWedge | None:
        return None

    def facets(self, labels: Bits) -> tuple[Floats, Floats] | None:
        """Return None: linear rows are not available for prescribed friction."""
        return None
