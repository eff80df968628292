"""Keys of materials in a scene file, with types and defaults."""

from __future__ import annotations

import math
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, model_validator

from jld_core.errors import InputError
from jld_core.scene.part import Angle, NonNegative, Pair, Part, Positive, PositiveValue, Value, Vector, Weighing
from jld_core.scene.standard import SURFACE


class StatedMaterial(Part):
    """Material of one label, which may be a criterion of a plug-in, or a yield surface."""

    criterion: str | None = None
    parameters: dict[str, Any] = {}
    surface: Annotated[dict[str, Any] | None, Field(description="an object that states a yield surface")] = None

    @property
    def named(self) -> tuple[str, dict[str, Any]] | None:
        """Return name and data of the criterion, that of yield surfaces for one; None for standard strengths."""
        if self.surface is not None:
            return SURFACE, self.surface
        return None if self.criterion is None else (self.criterion, self.parameters)

    @model_validator(mode="after")
    def _criterion_alone(self) -> Self:
        """Check that a criterion or surface stands alone, and parameters with a criterion."""
        allowed = {"surface"} if self.surface is not None else {"criterion", "parameters"}
        foreign = sorted(self.model_fields_set - allowed)
        if self.surface is not None and foreign:
            raise InputError(f".{foreign[0]}", "it stands beside a yield surface, which says all", '"surface" alone')
        if self.criterion is not None and foreign:
            raise InputError(
                f".{foreign[0]}", f'it is no part of the criterion "{self.criterion}"', '"parameters" alone'
            )
        if self.criterion is None and self.parameters:
            raise InputError(".parameters", 'they belong to a "criterion", which is missing', '"criterion"')
        return self


class Dry(StatedMaterial):
    """Material of dry joints: Mohr–Coulomb friction, optional cohesion and tensile bond; or a criterion.

    Exactly one form of friction is given; None is unlimited. The bond is at most cohesion over friction.
    """

    friction_angle: Angle | None = None
    friction_coefficient: Value | None = None
    compressive_strength: PositiveValue | None = None
    cohesion: Value = 0.0
    tensile_strength: NonNegative = 0.0

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        if self.named is None and (self.friction_angle is None) == (self.friction_coefficient is None):
            problem = "friction is missing" if self.friction_angle is None else "friction is given twice"
            raise InputError("", problem, 'exactly one of "friction_angle" and "friction_coefficient"')
        return self


def lies_within_apex(tension: float | None, shear: float | None, friction: float | None, where: str = "") -> None:
    """Raise InputError if a tensile strength lies beyond the apex of the friction cone: tension × μ above the shear."""
    if tension is not None and shear is not None and friction and tension * friction > shear * (1.0 + 1e-12):
        raise InputError(
            where,
            f"tensile_strength {tension:g} lies beyond the apex of its friction",
            f"at most shear_strength over friction, {shear / friction:g}",
        )


class Inner(StatedMaterial):
    """Material of inner faces (potential cracks): tensile and shear strength, friction; or a criterion."""

    tensile_strength: Annotated[Value | None, Field(description="a stress of at least 0")] = None
    shear_strength: Annotated[Value | None, Field(description="a stress of at least 0")] = None
    compressive_strength: PositiveValue | None = None
    friction_angle: Angle | None = None
    friction_coefficient: Value | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        """Check that both strengths are given, friction at most once, and that its apex allows the tensile strength."""
        for key in ("tensile_strength", "shear_strength"):
            if self.named is None and getattr(self, key) is None:
                raise InputError(f".{key}", "missing", "a stress of at least 0")
        if self.friction_angle is not None and self.friction_coefficient is not None:
            raise InputError("", "friction is given twice", '"friction_angle" or "friction_coefficient"')
        angle, coefficient = self.friction_angle, self.friction_coefficient
        slope = coefficient if angle is None else math.tan(math.radians(angle))
        lies_within_apex(self.tensile_strength, self.shear_strength, slope)
        return self


class DryFace(StatedMaterial):
    """Joint values that override "materials.dry" for the faces between two elements."""

    friction_angle: Angle | None = None
    friction_coefficient: Value | None = None
    compressive_strength: PositiveValue | None = None
    cohesion: Value | None = None
    tensile_strength: NonNegative | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        _at_most_one_friction(self.friction_angle, self.friction_coefficient)
        return self


class InnerFace(StatedMaterial):
    """Inner-face values that override "materials.inner" for the faces between two elements."""

    tensile_strength: Value | None = None
    shear_strength: Value | None = None
    compressive_strength: PositiveValue | None = None
    friction_angle: Angle | None = None
    friction_coefficient: Value | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        _at_most_one_friction(self.friction_angle, self.friction_coefficient)
        return self


def _at_most_one_friction(angle: float | None, coefficient: float | None) -> None:
    """Raise InputError if both angle and coefficient are given."""
    if angle is not None and coefficient is not None:
        raise InputError("", "friction is given twice", '"friction_angle" or "friction_coefficient"')


class FaceMaterial(Part):
    """Material of all faces between two elements; absent values are those of "materials"."""

    between: Annotated[Pair, Field(description="[id, id] of two elements that touch")]
    dry: DryFace | None = None
    inner: InnerFace | None = None

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.dry is None and self.inner is None:
            raise InputError("", "it states no value", '"dry", "inner" or both')
        return self


class Materials(Part):
    """Weights and strengths of all elements and faces. gravity: magnitude, acting downwards, or a vector."""

    density: Weighing | None = None
    gravity: Annotated[float | Vector, Field(description="a number or a vector")] = 9.81
    dry: Dry | None = None
    inner: Inner | None = None
    faces: list[FaceMaterial] = []


Share = Annotated[float, Field(ge=0, le=1)]  # number from 0 to 1


class Fill(Part):
    """Soil with a level surface on the upper boundary of a planar structure.

    level: height against gravity. surcharge: permanent pressure on the surface. dispersal: angle at which loads spread,
    degrees. active, passive, passive_cohesion: shares of Rankine's pressures that always act, and that weight and
    cohesion can reach. start, end: None for the ends of the structure.
    """

    model_config = ConfigDict(serialize_by_alias=True)

    level: float
    density: Positive
    friction_angle: Annotated[float, Field(ge=0, lt=90)]
    cohesion: NonNegative = 0.0
    surcharge: NonNegative = 0.0
    dispersal: Annotated[float, Field(ge=0, le=60)] = 30.0
    active: Share = 1.0
    passive: Share = 0.33
    passive_cohesion: Share = 0.01
    start: float | None = Field(None, alias="from")
    end: float | None = Field(None, alias="to")

    @model_validator(mode="after")
    def _least_below_most(self) -> Self:
        """Check that passive pressure is at least the active one, and that the range has a length."""
        if self.passive * self.passive_coefficient < self.active / self.passive_coefficient:
            problem = f"{self.passive:g} of the passive pressure is below {self.active:g} of the active one"
            least = self.active / self.passive_coefficient**2
            raise InputError(".passive", problem, f"at least {least:.4g}, or a smaller share of the active pressure")
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise InputError(".to", f"{self.end:g} does not lie beyond {self.start:g}", 'more than "from"')
        return self

    @property
    def passive_coefficient(self) -> float:
        """Return Rankine's coefficient of passive pressure; the active one is its reciprocal."""
        return math.tan(math.pi / 4.0 + math.radians(self.friction_angle) / 2.0) ** 2

    def cohesive_pressure(self, coefficient: float) -> float:
        """Return the pressure by which cohesion changes Rankine's pressure of a coefficient."""
        return 2.0 * self.cohesion * math.sqrt(coefficient)


class Strip(Part):
    """Strip on the surface of the fill: horizontal position of its middle, and width."""

    at: float
    width: NonNegative = 0.0


class FillLoad(Part):
    """Vertical load on the surface of the fill, spread over the structure below.

    Parameters
    ----------
    on_fill : Strip
        Strip of the surface that carries it.
    weight : float
        Force along gravity.
    """

    on_fill: Strip
    weight: Positive
