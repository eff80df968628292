"""What planar and spatial yield sets have in common: strengths of both labels, cohesion and friction in shear."""

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
    """Strengths of m faces under either label, scaled: shear (|V|, in space |V| + |mT|) ≤ c + μN, docs/method.md (2.6).

    friction, cohesion: μ and c of dry faces. inner_friction, shear: μ and c = τA of inner ones. tension: σtA of inner
    ones, no more than c / μ. crush_dry, crush_inner: σcA (inf where none). All but μ over the force scale.
    """

    pattern: RowPattern

    @cached_property
    def rough(self) -> bool:
        """Have any inner faces friction? What they have not costs nothing."""
        return bool((self.inner_friction > 0.0).any())

    @cached_property
    def cohesive(self) -> bool:
        """Have any dry faces cohesion?"""
        return bool((self.cohesion > 0.0).any())

    @property
    def associative(self) -> Self:
        return self

    def is_dry(self, labels: Bits) -> Bools:
        return labels

    def friction_of(self, labels: Bits) -> Floats:
        return np.where(self.is_dry(labels), self.friction, self.inner_friction)

    def cohesion_of(self, labels: Bits) -> Floats:
        return np.where(self.is_dry(labels), self.cohesion, self.shear)

    def _holds(self, labels: Bits) -> Bools:
        """(m,) faces that resist shear at all; where they do not V is dropped."""
        dry, inner = self.friction, self.shear
        if self.cohesive:
            dry = dry + self.cohesion
        if self.rough:
            inner = inner + self.inner_friction
        return np.where(self.is_dry(labels), dry, inner) > 0.0

    def _capacity(self, normal: Floats) -> tuple[Floats, Floats]:
        """c + μN of all faces (m,) as dry and as inner; inf where V is dropped, which is zero and limits nothing."""
        if self.cohesive:
            dry = np.where(self.friction + self.cohesion > 0.0, self.cohesion + self.friction * normal, np.inf)
        else:
            dry = np.where(self.friction > 0.0, self.friction * normal, np.inf)
        if self.rough:
            inner = np.where(self.shear + self.inner_friction > 0.0, self.shear + self.inner_friction * normal, np.inf)
        else:
            inner = np.where(self.shear > 0.0, self.shear, np.inf)
        return dry, inner

    def with_friction(self, share: float) -> Self:
        return replace(self, friction=share * self.friction, inner_friction=share * self.inner_friction)

    def bending_alone(self) -> Self:
        none = np.zeros(len(self.friction))
        return replace(self, friction=none, inner_friction=none, cohesion=none, shear=none)


def scaled_strengths(strengths: Strengths, unit: Floats) -> Strengths:
    """Strengths as `Frictional` has them; unit: (m,) area over the force scale.

    A material the scene does not name becomes a face without strength: `require_materials` has refused the
    labellings that would need it.
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
    given = np.isfinite(strength) & (unit > 0.0)
    return np.asarray(np.where(given, np.where(given, strength, 0.0) * unit, np.inf))
