"""What the parts of a scene file share: strictness, and the kinds of values."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from jld_core.scene.spread import MaySpread

LabelName = Literal["dry", "inner"]
Pair = Annotated[list[str], Field(min_length=2, max_length=2)]
Vector = Annotated[list[float], Field(min_length=2, max_length=3)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Value = Annotated[float, Field(ge=0), MaySpread()]
PositiveValue = Annotated[float, Field(gt=0), MaySpread()]
Angle = Annotated[float, Field(ge=0, lt=90), MaySpread()]
"""Material values: a number, or a nominal one with a low one."""


class Part(BaseModel):
    """A part of the scene: unknown keys, NaN and infinities are errors, and nothing changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)
