"""Keys of fill: soil on a planar structure, such as the backing of an arch."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from jld_core.errors import InputError
from jld_core.scene.part import NonNegative, Part, Positive

Share = Annotated[float, Field(ge=0, le=1)]
"""Number from 0 to 1."""


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

    def held(self, coefficient: float) -> float:
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
