"""Common part of planar and spatial yield sets: strengths of both labels, cohesion and friction in shear."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Strengths
from jld_core.mechanics.yield_set import RowPattern


@dataclass(frozen=True)
class Frictional(Strengths):
    """Scaled strengths of m faces under either label, with Coulomb friction in shear.

    Shear is limited by |V| ≤ c + μN, in space by |V| + |mT| ≤ c + μN, docs/method.md (2.4), (2.7).

    Attributes
    ----------
    friction, cohesion : (m,) arrays
        μ and c of dry faces.
    inner_friction, shear : (m,) arrays
        μ and c = τA of inner faces.
    tension : (m,) array
        σtA of inner faces, at most c/μ.
    crush_dry, crush_inner : (m,) arrays
        σcA; inf where none is given.
    pattern : RowPattern
        Rows of the program.

    Notes
    -----
    All values except μ are divided by the force scale.
    """

    pattern: RowPattern

    @cached_property
    def has_inner_friction(self) -> bool:
        """Whether any inner face has friction; without it those terms are skipped."""
        return bool((self.inner_friction > 0.0).any())

    @cached_property
    def has_dry_cohesion(self) -> bool:
        """Whether any dry face has cohesion."""
        return bool((self.cohesion > 0.0).any())

    @property
    def associative(self) -> Self:
        """Set with associative friction, which is this set itself."""
        return self

    def is_dry(self, labels: Bits) -> Bools:
        """Return True (m,) for faces with the strengths of a dry face."""
        return labels

    def friction_of(self, labels: Bits) -> Floats:
        """Return μ (m,) under the labels."""
        return np.where(self.is_dry(labels), self.friction, self.inner_friction)

    def cohesion_of(self, labels: Bits) -> Floats:
        """Return the scaled shear capacity at N = 0 (m,) under the labels."""
        return np.where(self.is_dry(labels), self.cohesion, self.shear)

    def _holds(self, labels: Bits) -> Bools:
        """Return True (m,) for faces that resist shear; V is dropped from the others."""
        dry, inner = self.friction, self.shear
        if self.has_dry_cohesion:
            dry = dry + self.cohesion
        if self.has_inner_friction:
            inner = inner + self.inner_friction
        return np.where(self.is_dry(labels), dry, inner) > 0.0

    def _capacity(self, normal: Floats) -> tuple[Floats, Floats]:
        """Return c + μN of all faces (m,) as dry and as inner, inf where V is dropped."""
        if self.has_dry_cohesion:
            dry = np.where(self.friction + self.cohesion > 0.0, self.cohesion + self.friction * normal, np.inf)
        else:
            dry = np.where(self.friction > 0.0, self.friction * normal, np.inf)
        if self.has_inner_friction:
            inner = np.where(self.shear + self.inner_friction > 0.0, self.shear + self.inner_friction * normal, np.inf)
        else:
            inner = np.where(self.shear > 0.0, self.shear, np.inf)
        return dry, inner

    def with_friction(self, share: float) -> Self:
        """Return the set with a share of all friction; `pattern` stays the same."""
        return replace(self, friction=share * self.friction, inner_friction=share * self.inner_friction)

    def without_shear_limit(self) -> Self:
        """Return the set without any limit on shear; `pattern` stays the same."""
        none = np.zeros(len(self.friction))
        return replace(self, friction=none, inner_friction=none, cohesion=none, shear=none)


def scaled_strengths(strengths: Strengths, unit: Floats) -> Strengths:
    """Scale strengths as `Frictional` has them; unit: (m,) area over the force scale.

    A material that the scene does not name gives a face without strength. `require_materials` refuses the labellings
    that need such a material.
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
    """Scale compressive strengths (m,); inf where none is given or the area is zero."""
    given = np.isfinite(strength) & (unit > 0.0)
    return np.asarray(np.where(given, np.where(given, strength, 0.0) * unit, np.inf))
