"""Keys of a scene for `jld move`: variables, limits and objective."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from jld_core.errors import InputError
from jld_core.scene.part import NonNegative, Part, Positive, Vector

Limits = Annotated[list[NonNegative | None], Field(min_length=2, max_length=2)]
"""Bounds [least, most], None for no limit."""


class Path(Part):
    """Line or circle along which vertices of joints slide.

    Two entries with one vertex let it move freely. circle: centre of circles for vertices whose neighbours lie on the
    same one.
    """

    at: Annotated[Vector | None, Field(description="a point")] = None
    direction: Annotated[Vector | None, Field(description="a vector")] = None
    circle: Annotated[Vector | None, Field(description="the centre of a circle")] = None
    supports: bool = False

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        """Check that a circle, or a vertex with a direction, is given."""
        if (self.circle is None) == (self.at is None):
            raise InputError("", "it is no path", '"circle", or "at" with "direction"')
        if (self.at is None) != (self.direction is None):
            raise InputError("", "one of two keys is missing", '"at" with "direction"')
        if self.direction is not None and not any(self.direction):
            raise InputError(".direction", "it has no length", "a vector")
        if self.supports and self.circle is None:
            raise InputError(".supports", 'it is given without "circle"', "joints on a circle")
        if self.circle is not None and len(self.circle) != 2:
            raise InputError(".circle", f"it has {len(self.circle)} numbers", "2: circles are for planar scenes")
        return self


class Draft(Part):
    """Least inclination of dry joints that lets blocks be lifted out of a mould."""

    direction: Annotated[Vector, Field(description="a vector")]
    degrees: Annotated[float, Field(ge=0, lt=90)]

    @model_validator(mode="after")
    def _a_direction(self) -> Self:
        if not any(self.direction):
            raise InputError(".direction", "it has no length", "a vector")
        return self


class Move(Part):
    """Variables, limits and objective of `jld move`.

    ties: vertices that move alike. inner: vertices of inner faces "stay", or "follow" those of joints. straight: keep
    straight faces of blocks straight. edge: None for a share of the mean edge. block_mass: kg with m and N. box:
    largest distance along each direction.
    """

    vertices: Literal["joints", "along"] = "joints"
    along: list[Path] = []
    ties: Annotated[
        Literal["none", "mirror-x", "equal-shapes"] | list[Annotated[list[Vector], Field(min_length=2)]],
        Field(description='"none", "mirror-x", "equal-shapes" or lists of vertices that move alike'),
    ] = "none"
    inner: Literal["stay", "follow"] = "stay"
    straight: bool = True
    angle: Annotated[list[float], Field(min_length=2, max_length=2)] = [30.0, 150.0]
    edge: Positive | None = None
    block_mass: Limits = [None, None]
    draft: Draft | None = None
    box: Positive | None = None
    maximise: Literal["load_factor", "least_friction", "least_thickness"] = "load_factor"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        """Check that bounds are ordered and angles lie between 0 and 180 degrees."""
        low, high = self.angle
        if not 0.0 <= low < high <= 180.0:
            raise InputError(".angle", f"[{low:g}, {high:g}] are no bounds", "[least, most] from 0 to 180 degrees")
        least_mass, most_mass = self.block_mass
        if least_mass is not None and most_mass is not None and least_mass > most_mass:
            problem = f"the least, {least_mass:g}, is above the most, {most_mass:g}"
            raise InputError(".block_mass", problem, "[least, most]")
        return self
