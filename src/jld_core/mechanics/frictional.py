"""Common part of planar and spatial yield sets: strengths, cohesion and friction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.mechanics.yield_set import RowPattern
from jld_core.strengths import Strengths


@dataclass(frozen=True)
class Frictional(Strengths):
    """Scaled strengths of m faces under either label, with Coulomb friction in shear.

    Shear is limited by |V| ≤ c + μN, in space by |V| + |mT| ≤ c + μN, docs/method.md (2.4), (2.7).

    friction, cohesion: (m,) μ and c of dry faces. inner_friction, shear: (m,) μ and c = τA of inner faces. tension:
    (m,) σtA of inner faces, at most c/μ. crush_dry, crush_inner: (m,) σcA; inf where none is given. pattern: rows of
    the program.

    All values except μ are divided by the force scale.
    """

    pattern: RowPattern

    @cached_property
    def has_inner_friction(self) -> bool:
        """Return True if any inner face has friction; without it those terms are skipped."""
        return bool((self.inner_friction > 0.0).any())

    @cached_property
    def has_dry_cohesion(self) -> bool:
        """Return True if any dry face has cohesion."""
        return bool((self.cohesion > 0.0).any())

    @property
    def associative(self) -> Self:
        """Return the set with associative friction, which is this set itself."""
        return self

    def is_dry(self, labels: Bits) -> Bools:
        """Return a mask (m,), True for faces that have the strengths of a dry face.

        labels: (m,) True = dry. The mask is `labels` itself; spatial sets add points.
        """
        return labels

    def friction_of(self, labels: Bits) -> Floats:
        """Return the friction coefficient μ (m,) of each face under these labels (m,), True = dry."""
        return np.where(self.is_dry(labels), self.friction, self.inner_friction)

    def cohesion_of(self, labels: Bits) -> Floats:
        """Return the scaled shear capacity (m,) of each face at N = 0.

        labels: (m,) True = dry.
        """
        return np.where(self.is_dry(labels), self.cohesion, self.shear)

    def _holds(self, labels: Bits) -> Bools:
        """Return a mask (m,), True for faces that resist shear by friction or strength.

        V is left out of the program at all others. labels: (m,) True = dry.
        """
        dry, inner = self.friction, self.shear
        if self.has_dry_cohesion:
            dry = dry + self.cohesion
        if self.has_inner_friction:
            inner = inner + self.inner_friction
        return np.where(self.is_dry(labels), dry, inner) > 0.0

    def _capacity(self, normal: Floats) -> tuple[Floats, Floats]:
        """Return the scaled shear capacities c + μN (m,) of all faces as dry, and of all as inner.

        A capacity is inf where V is left out of the program. normal: (m,) scaled normal forces N.
        """
        if self.has_dry_cohesion:
            dry = np.where(self.friction + self.cohesion > 0.0, self.cohesion + self.friction * normal, np.inf)
        else:
            dry = np.where(self.friction > 0.0, self.friction * normal, np.inf)
        if self.has_inner_friction:
            inner = np.where(self.shear + self.inner_friction > 0.0, self.shear + self.inner_friction * normal, np.inf)
        else:
            inner = np.where(self.shear > 0.0, self.shear, np.inf)
        return dry, inner

    def strength(self, labels: Bits) -> Floats:
        """Return the largest dissipation (m,) of a jump of size 1, up to a factor of order one.

        labels: (m,) True = dry.
        """
        crushing = np.where(labels, self.crush_dry, self.crush_inner)
        held = np.where(labels, self.cohesion, self.tension + self.shear)
        return np.asarray(held + np.where(np.isfinite(crushing), crushing, 0.0))

    def with_friction(self, share: float) -> Self:
        """Return a copy of the set with all friction coefficients multiplied by `share`.

        The rows in `pattern` stay those of the original set, so use the copy for slacks and dissipation only.
        """
        return replace(self, friction=share * self.friction, inner_friction=share * self.inner_friction)

    def without_shear_limit(self) -> Self:
        """Return a copy of the set without any limit on shear, for tests of bending alone.

        The rows in `pattern` stay those of the original set.
        """
        none = np.zeros(len(self.friction))
        return replace(self, friction=none, inner_friction=none, cohesion=none, shear=none)


def scaled_strengths(strengths: Strengths, unit: Floats) -> Strengths:
    """Convert strengths to forces, stress times area, and divide them by the force scale.

    strengths: of m faces, scene units; friction coefficients stay. unit: (m,) area of each face over the force scale. A
    material that the scene does not name gives a face without strength. `require_materials` refuses the labellings that
    need such a material.
    """
    return Strengths(
        friction=np.nan_to_num(strengths.friction, nan=0.0),
        tension=np.nan_to_num(strengths.tension, nan=0.0) * unit,
        shear=np.nan_to_num(strengths.shear, nan=0.0) * unit,
        crush_dry=_bounded(strengths.crush_dry, unit),
        crush_inner=_bounded(strengths.crush_inner, unit),
        cohesion=strengths.cohesion * unit,
        inner_friction=strengths.inner_friction.copy(),
    )


def _bounded(strength: Floats, unit: Floats) -> Floats:
    """Return scaled compressive strengths (m,), inf where none is given or a face has no area.

    strength: (m,) scene units. unit: (m,) area of each face over the force scale.
    """
    given = np.isfinite(strength) & (unit > 0.0)
    return np.asarray(np.where(given, np.where(given, strength, 0.0) * unit, np.inf))
