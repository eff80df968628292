"""Base class and value types shared by the parts of a scene file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from jld_core.scene.spread import MaySpread
from jld_core.scene.uncertain import MayVary, MayVaryInSize

LabelName = Literal["dry", "inner"]
"""Name of a label."""

Pair = Annotated[list[str], Field(min_length=2, max_length=2)]
"""Ids of two elements."""

Vector = Annotated[list[float], Field(min_length=2, max_length=3)]
"""Planar or spatial vector."""

Positive = Annotated[float, Field(gt=0)]
"""Number above 0."""

NonNegative = Annotated[float, Field(ge=0)]
"""Number of at least 0."""

Value = Annotated[float, Field(ge=0), MaySpread()]
"""Material value of at least 0: a number, or an object with nominal and low value."""

PositiveValue = Annotated[float, Field(gt=0), MaySpread()]
"""Material value above 0: a number, or an object with nominal and low value."""

Angle = Annotated[float, Field(ge=0, lt=90), MaySpread()]
"""Angle of friction, degrees: a number, or an object with nominal and low value."""


Weighing = Annotated[float, Field(ge=0), MayVary()]
"""Density or weight of at least 0: a number, or an object with its distribution."""

Loading = Annotated[float, MayVary(each=False)]
"""Number of a load, or an object with its distribution."""

VaryingPositive = Annotated[float, Field(gt=0), MayVary(each=False)]
"""Number of a load above 0, or an object with its distribution."""

LoadVector = Annotated[list[Loading], Field(min_length=2, max_length=3), MayVaryInSize()]
"""Vector of a load, whose components or size may have distributions."""


class Part(BaseModel):
    """Base class of the parts of a scene: immutable, without unknown keys, NaN or infinities."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True, defer_build=True)
