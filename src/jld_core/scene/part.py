"""Parts of a scene file: the common base, and members. docs/scene_keys.md has the meaning of every key."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from jld_core.errors import InputError
from jld_core.scene.uncertain import MaySpread, MayVary, MayVaryInSize

LabelName = Literal["dry", "inner"]
Pair = Annotated[list[str], Field(min_length=2, max_length=2)]
Vector = Annotated[list[float], Field(min_length=2, max_length=3)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Value = Annotated[float, Field(ge=0), MaySpread()]
"""Material value of at least 0: a number, or an object with nominal and low value."""

PositiveValue = Annotated[float, Field(gt=0), MaySpread()]  # the same above 0
Angle = Annotated[float, Field(ge=0, lt=90), MaySpread()]  # angle of friction, degrees, as a `Value`
Weighing = Annotated[float, Field(ge=0), MayVary()]
"""Density or weight of at least 0: a number, or an object with its distribution."""

Loading = Annotated[float, MayVary(each=False)]  # number of a load, or an object with its distribution
VaryingPositive = Annotated[float, Field(gt=0), MayVary(each=False)]  # the same above 0
LoadVector = Annotated[list[Loading], Field(min_length=2, max_length=3), MayVaryInSize()]
"""Vector of a load, whose components or size may have distributions."""


class Part(BaseModel):
    """Base class of the parts of a scene: immutable, without unknown keys, NaN or infinities."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True, defer_build=True)


MemberKind = Literal["tie", "tendon", "pin"]


class Anchor(Part):
    """Point of an element at which a member is fixed, or over which it slides."""

    element: Annotated[str, Field(description="the id of an element")]
    at: Annotated[Vector, Field(description="a point of the element")]


class Member(Part):
    """Bar or pin that acts on two elements, in addition to the faces between them.

    A tie or tendon slides without friction over the points `through`. tension: None for the prestress, which always
    acts.
    """

    model_config = ConfigDict(serialize_by_alias=True)

    kind: MemberKind
    from_: Annotated[Anchor, Field(description='{"element": ID, "at": point}')] = Field(alias="from")
    to: Annotated[Anchor, Field(description='{"element": ID, "at": point}')]
    through: list[Anchor] = []
    tension: Value | None = None
    compression: Value = 0.0
    prestress: NonNegative = 0.0
    shear: Value | None = None
    name: Annotated[str, Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _of_its_kind(self) -> Self:
        """Check that the forces that the kind needs are given, and no others."""
        if self.kind == "pin":
            if not self.shear:
                raise InputError(".shear", "a pin without shear capacity", "a force above 0")
            if self.through:
                raise InputError(".through", "a pin has two ends only", "a pin for each face")
        elif self.shear is not None:
            raise InputError(".shear", f"a {self.kind} carries no shear", 'a force along its axis, or "kind": "pin"')
        elif self.kind == "tendon" and not self.prestress:
            raise InputError(".prestress", "a tendon without prestress", 'a force above 0, or "kind": "tie"')
        elif self.kind == "tie" and not (self.tension or self.compression or self.prestress):
            raise InputError(".tension", "a tie without capacity", "a force above 0")
        if self.prestress and self.compression:
            problem = f"{self.compression:g} is given together with a prestress, which never becomes less"
            raise InputError(".compression", problem, "one of both")
        if self.through and self.compression:
            raise InputError(
                ".compression", "a bar over points in between carries tension alone", "0, or bars of two ends"
            )
        if self.tension is not None and self.prestress > self.tension:
            problem = f"{self.prestress:g} exceeds the tension of {self.tension:g} that the {self.kind} carries"
            raise InputError(".prestress", problem, "at most the tension")
        return self

    @property
    def most(self) -> float:
        """Return the largest tension, a force."""
        return self.prestress if self.tension is None else self.tension
