"""Define properties of joints and numerical settings of experiments."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

from jld_core import InputError, ParameterError, parameters

# relative difference of the collapse loads at two rates above which an experiment is uncertified
RATE_ERROR: Final = 5e-3

# Smallest relative accuracy of a collapse load that can be claimed: runs with the laws of limit analysis ended up to 1
# % below λ.
ACCURACY: Final = 1e-2

REST: Final = 1e-7  # unbalanced force, relative to the largest load on an element, below which an assembly is at rest

FALL: Final = 0.1  # fall of λ, as a share of the highest λ, that counts as collapse


_STIFFEST: Final = 1e100  # stiffnesses and ratios beyond it overflow in products

# damping schemes of `Settings`, in the order of their numbers in the time stepping
DAMPING_SCHEMES: Final = ("local", "viscous", "combined")


@dataclass(frozen=True)
class Joints:
    """Properties of faces that limit analysis does not have.

    Attributes
    ----------
    normal_stiffness, shear_stiffness : float or None
        Springs, stress per length in scene units (Pa/m). None: dead loads move the assembly by about 1e-6 of its size.
    inner_ratio : float
        Stiffness of inner faces over that of dry faces.
    dilation : float or "friction"
        Tangent of the dilation angle of dry joints; "friction" is associative.
    inner : str
        "plastic" keeps tension and shear strength of inner faces; "brittle" loses both when either is exceeded.
    residual_friction : float
        Friction coefficient of a crack.
    """

    normal_stiffness: float | None = None
    shear_stiffness: float | None = None
    inner_ratio: float = 1.0
    dilation: float | Literal["friction"] = 0.0
    inner: Literal["plastic", "brittle"] = "brittle"
    residual_friction: float = 0.0

    def __post_init__(self) -> None:
        parameters.require_field_types(self)
        for name in ("normal_stiffness", "shear_stiffness", "inner_ratio"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < _STIFFEST:
                raise ParameterError(name, f"{value!r} is no stiffness", f"above 0 and below {_STIFFEST:g}")
        if self.dilation != "friction" and not (isinstance(self.dilation, (int, float)) and self.dilation >= 0.0):
            raise ParameterError(
                "dilation", f"{self.dilation!r} is no dilation", "0, friction, or the tangent of an angle"
            )
        if self.inner not in ("plastic", "brittle"):
            raise ParameterError("inner", f"no law of inner faces is named {self.inner!r}", "brittle or plastic")
        if not (self.residual_friction >= 0.0 and math.isfinite(self.residual_friction)):
            raise ParameterError(
                "residual_friction", f"{self.residual_friction!r} is no friction", "a number, 0 or more"
            )


@dataclass(frozen=True)
class Settings:
    """Numerical settings of an experiment.

    Attributes
    ----------
    scheme, segments
        Positions of sub-contacts on a face, and number of segments.
    gaps : str
        "free": an opened joint closes without resistance; "plastic": opening is plastic, for comparison with λ.
    moving : bool
        Follow the geometry, with new contacts at corners.
    periods : float
        Slowest periods per elastic displacement in the faster push.
    slower : float
        Factor by which the second push takes longer.
    hasten, length : float
        Elastic displacements after which the rate grows, and after which a push ends.
    records : float
        Points of a curve per slowest period.
    damping_scheme : str
        "local": a share of the unbalanced force acts against the velocity (Cundall 1987). "combined": half of it
        against the change of that force, which damps steady movement less. "viscous": a drag on momentum.
    damping : float
        That share, or the share of critical damping.
    step : float
        Share of the critical time step.
    """

    scheme: Literal["trapezoid", "simpson", "midpoint", "limit"] = "trapezoid"
    segments: int = 4
    gaps: Literal["free", "plastic"] = "free"
    moving: bool = False
    periods: float = 150.0
    slower: float = 2.0
    hasten: float = 8.0
    length: float = 100.0
    records: float = 2.0
    damping_scheme: Literal["local", "viscous", "combined"] = "local"
    damping: float = 0.5
    step: float = 0.5

    def __post_init__(self) -> None:
        parameters.require_field_types(self)
        for name, low, high in (("damping", 0.0, 1.0), ("step", 0.0, 0.9)):
            if not low < getattr(self, name) < high:
                raise InputError(f"settings.{name}", f"{getattr(self, name)!r}", f"a number between {low} and {high}")
        for name, low in (("periods", 0.0), ("hasten", 0.0), ("length", 0.0), ("records", 0.0), ("slower", 1.0)):
            if not getattr(self, name) > low:
                raise InputError(f"settings.{name}", f"{getattr(self, name)!r}", f"a number above {low:g}")
        if self.damping_scheme not in DAMPING_SCHEMES:
            problem = f"no damping scheme is named {self.damping_scheme!r}"
            raise InputError("settings.damping_scheme", problem, " or ".join(DAMPING_SCHEMES))
        if self.gaps not in ("free", "plastic"):
            raise InputError("settings.gaps", f"no kind of gaps is named {self.gaps!r}", "free or plastic")
