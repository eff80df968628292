"""Parameters of the standard criterion, stated once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class StandardParameter:
    """Number of a material: its label, fields of `Side` and `Strengths`, key, fact, words and value if absent."""

    label: str
    side: str
    field: str
    key: str
    fact: str
    words: str
    absent: float = math.nan

    @property
    def where(self) -> str:
        """Return the key in messages."""
        return f"materials.{self.label}.{self.key}" if self.fact != "friction" else "materials.dry"


PARAMETERS: Final = (  # all that units, scenes, design values, samples and pages iterate over
    StandardParameter("dry", "friction", "friction", "friction_coefficient", "friction", "friction of joints"),
    StandardParameter("dry", "shear", "cohesion", "cohesion", "cohesion", "cohesion of joints", 0.0),
    StandardParameter(
        *("dry", "crush", "crush_dry", "compressive_strength", "dry crushing"),
        *("compressive strength of joints", math.inf),
    ),
    StandardParameter("inner", "tension", "tension", "tensile_strength", "tension", "tensile strength of inner faces"),
    StandardParameter("inner", "shear", "shear", "shear_strength", "shear", "shear strength of inner faces"),
    StandardParameter(
        *("inner", "friction", "inner_friction", "friction_coefficient", "inner friction"),
        *("friction of inner faces", 0.0),
    ),
    StandardParameter(
        *("inner", "crush", "crush_inner", "compressive_strength", "inner crushing"),
        *("compressive strength of inner faces", math.inf),
    ),
)

STRESS_KEYS: Final = tuple(  # keys of materials that hold strengths, which are stresses
    dict.fromkeys(p.key for p in sorted(PARAMETERS, key=lambda p: p.side == "crush") if p.side != "friction")
)


SURFACE: Final = "surface"  # key of a material, and name of the criterion that reads what stands there
ENDS: Final = frozenset(p.field for p in PARAMETERS if math.isinf(p.absent))
"""Fields of `Strengths` that limit compression; inf where there is no limit."""


def key_of(label: str, side: str) -> str:
    """Return the key of a material that holds a field of `Side` under a label."""
    return next(parameter.key for parameter in PARAMETERS if (parameter.label, parameter.side) == (label, side))
