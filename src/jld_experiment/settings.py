"""What is experimented on, and how: the properties of joints, and the numbers of the method."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

from jld_core.errors import InputError

RATE_ERROR: Final = 5e-3
"""Difference of the collapse loads at two rates, relative, above which an experiment is uncertified."""

ACCURACY: Final = 1e-2
"""Relative accuracy of a collapse load that can be claimed where two rates agree. Runs with limit analysis' own laws
(plastic, associative) ended up to 1 % below λ: the push stops on a plateau, and the default scheme and gaps that close
freely are a model of their own."""

REST: Final = 1e-7
"""Out-of-balance force, relative to the largest load on an element, below which an assembly is at rest."""

FALL: Final = 0.1
"""Share of the highest load by which it has to fall to be called collapse."""


@dataclass(frozen=True)
class Joints:
    """Properties of the faces that limit analysis does not know.

    normal_stiffness, shear_stiffness: springs, stress per length in scene units (Pa/m); None: such that the dead
    loads move the assembly by a millionth of its size, and shear as normal. inner_ratio: stiffness of inner faces
    over that of dry ones. dilation: tan of the angle at dry joints, or "friction" (associative). inner: do tension and
    cohesion of inner faces last ("plastic"), or does exceeding either lose both ("brittle"). residual_friction: of
    a crack, 0 in Table 2 of the paper.
    """

    normal_stiffness: float | None = None
    shear_stiffness: float | None = None
    inner_ratio: float = 1.0
    dilation: float | Literal["friction"] = 0.0
    inner: Literal["plastic", "brittle"] = "brittle"
    residual_friction: float = 0.0

    def __post_init__(self) -> None:
        for name in ("normal_stiffness", "shear_stiffness", "inner_ratio"):
            value = getattr(self, name)
            if value is not None and not (value > 0.0 and math.isfinite(value)):
                raise InputError(f"--{name.replace('_', '-')}", f"{value!r} is no stiffness", "a number above 0")
        if self.dilation != "friction" and not (isinstance(self.dilation, (int, float)) and self.dilation >= 0.0):
            raise InputError(
                "--dilation", f"{self.dilation!r} is no dilation", "0, friction, or the tangent of an angle"
            )
        if self.inner not in ("plastic", "brittle"):
            raise InputError("--inner", f"no law of inner faces is named {self.inner!r}", "brittle or plastic")
        if not (self.residual_friction >= 0.0 and math.isfinite(self.residual_friction)):
            raise InputError("--residual-friction", f"{self.residual_friction!r} is no friction", "a number, 0 or more")


@dataclass(frozen=True)
class Settings:
    """How an experiment is run.

    scheme, segments: of sub-contacts on a face, see `sub_contacts`. gaps: a joint that opened closes without
    resistance ("free"), or is plastic like everything else ("plastic", for proofs against λ). moving: follow the
    geometry, with new contacts where corners meet other faces.

    A push is measured in elastic movements, live·u at the load it ends at if nothing yielded. periods: slowest periods
    for one of them in the faster of two pushes; the other takes `slower` times as long. hasten: elastic movements after
    which the rate grows with the distance. length: at which a push ends at the latest. records: points of a curve
    in a slowest period. damping: local, share of the out-of-balance force. step: share of the critical step.
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
    damping: float = 0.5
    step: float = 0.5

    def __post_init__(self) -> None:
        for name, low, high in (("damping", 0.0, 1.0), ("step", 0.0, 0.9)):
            if not low < getattr(self, name) < high:
                raise InputError(f"settings.{name}", f"{getattr(self, name)!r}", f"a number between {low} and {high}")
        for name, low in (("periods", 0.0), ("hasten", 0.0), ("length", 0.0), ("records", 0.0), ("slower", 1.0)):
            if not getattr(self, name) > low:
                raise InputError(f"settings.{name}", f"{getattr(self, name)!r}", f"a number above {low:g}")
        if self.gaps not in ("free", "plastic"):
            raise InputError("settings.gaps", f"no kind of gaps is named {self.gaps!r}", "free or plastic")
