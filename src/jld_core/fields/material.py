"""Material of the blocks: yield set in plane stress, and dissipation of strain rates.

With m = (σx + σy)/2, d = (σx − σy)/2, s = τxy and R = √(d² + s²), tension positive, the set is R ≤ τ cos φ − m sin φ
(Mohr–Coulomb), R ≤ σt − m (tension cut-off), R ≤ σc + m (crushing); tan φ = μi. Formulas: docs/method.md (9.1) to
(9.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.strengths import Route

_ROUTE: Final = Route("cracks by fields")


@dataclass(frozen=True)
class Material:
    """Mohr–Coulomb material with tension cut-off in plane stress.

    tension: tensile strength σt, a stress. cohesion: shear strength τ without normal stress, a stress. friction:
    friction μi = tan φ of crack planes. crushing: compressive strength σc, a stress; inf where none is given.
    """

    tension: float
    cohesion: float
    friction: float = 0.0
    crushing: float = np.inf

    @property
    def sine(self) -> float:
        """Sine of the angle of friction φ of crack planes, tan φ = `friction`."""
        return self.friction / float(np.hypot(1.0, self.friction))

    @property
    def intercept(self) -> float:
        """Largest R = (σ1 − σ2)/2 that Mohr–Coulomb admits at m = 0: τ cos φ, stress."""
        return self.cohesion / float(np.hypot(1.0, self.friction))

    def scaled(self, unit: float) -> Material:
        """Return the same material with its strengths divided by `unit`, a stress above 0."""
        return Material(self.tension / unit, self.cohesion / unit, self.friction, self.crushing / unit)

    @cached_property
    def lines(self) -> Floats:
        """(k, 2) coefficients (a, b) of the yield conditions R ≤ a + b m.

        m = (σx + σy)/2 and R = (σ1 − σ2)/2. The rows are Mohr–Coulomb, tension cut-off and, where a compressive
        strength is given, crushing.
        """
        rows = [(self.intercept, -self.sine), (self.tension, -1.0)]
        if np.isfinite(self.crushing):
            rows.append((self.crushing, 1.0))
        return np.array(rows)

    @cached_property
    def vertices(self) -> Floats:
        """(k, 2) corners (m, R) of the yield set in the half-plane R ≥ 0, stress.

        m = (σx + σy)/2 and R = (σ1 − σ2)/2. Without a compressive strength the set is unbounded towards m = −∞; that
        end has no corner.
        """
        corners = [(self.tension, 0.0)]
        if np.isfinite(self.crushing):
            corners.append((-self.crushing, 0.0))
        for i, (a, b) in enumerate(self.lines):
            for c, d in self.lines[i + 1 :]:
                if b != d:
                    m = (c - a) / (b - d)
                    corners.append((m, a + b * m))
        slack = 1e-12 * max(self.tension, self.cohesion)
        kept = [(m, r) for m, r in corners if r >= 0.0 and (r <= self.lines @ (1.0, m) + slack).all()]
        return np.array(kept)

    def slack(self, stress: Floats) -> Floats:
        """Return the least slack a + b m − R over all yield conditions (see `lines`), a stress.

        stress: (..., 3) values (m, d, s) = ((σx + σy)/2, (σx − σy)/2, τxy). The result is (...,); negative means that
        yield is violated.
        """
        radius = np.hypot(stress[..., 1], stress[..., 2])
        heads = self.lines[:, 0] + self.lines[:, 1] * stress[..., :1]
        return np.asarray(heads.min(axis=-1) - radius)

    def missing(self, trace: Floats, shear: Floats) -> Floats:
        """Return the trace that strain rates lack to obey the flow rule, (k,).

        trace, shear: (k,) e and g of docs/method.md (9.2). The result is g sin φ − e; above 0 the dissipation is
        infinite. It is −inf for a material that crushes, which has no such rule.
        """
        if np.isfinite(self.crushing):
            return np.full_like(trace, -np.inf)
        return self.sine * shear - trace

    def dissipation(self, trace: Floats, shear: Floats, allowance: float = 0.0) -> Floats:
        """Return the power per volume of strain rates, (...,): docs/method.md (9.2).

        trace, shear: (...,) e = εx + εy and g = √((εx − εy)² + γ²). For a jump (δn, δs) take e = δn and g = √(δn² +
        δs²); the power is then per area. allowance: value of `missing` above which the power is infinite.
        """
        power = (trace[..., None] * self.vertices[:, 0] + shear[..., None] * self.vertices[:, 1]).max(axis=-1)
        return np.asarray(np.where(self.missing(trace, shear) > allowance, np.inf, power))


def material_of(assembly: Assembly) -> Material:
    """Return the material of all blocks, from the inner strengths of the faces.

    The tensile strength is reduced to τ / μi, the apex of Mohr–Coulomb, where it is larger.

    assembly: planar or spatial assembly whose inner faces all have the same strengths. Raises InputError: no inner
    strengths, strengths of 0, strengths that differ between faces, or members.
    """
    assembly.members.refuse("an analysis by fields")
    given = assembly.strengths(_ROUTE)
    values = np.column_stack([given.tension, given.shear, given.inner_friction, given.crush_inner])
    named = values[~np.isnan(values[:, :2]).any(axis=1)]
    if not len(named):
        raise InputError(
            "materials.inner",
            "cracks by fields need the strengths of the blocks",
            "tensile_strength and shear_strength",
        )
    plain = np.where(np.isinf(named), -1.0, named)
    if not (np.ptp(plain, axis=0) <= tolerances.ROUNDING * abs(plain).max(axis=0)).all():
        raise InputError(
            "interfaces", "inner strengths differ between faces; fields take one material", "one inner material"
        )
    tension, cohesion, friction, crushing = (float(value) for value in named[0])
    for key, value in (("tensile_strength", tension), ("shear_strength", cohesion)):
        if not value > 0.0:
            raise InputError(f"materials.inner.{key}", f"{value:g} is too small for stress fields", "a stress above 0")
    if friction:
        # at the apex of friction the cut-off idles
        tension = min(tension, cohesion / friction)
    return Material(tension, cohesion, friction, crushing)
