"""Keys of a yield surface in a scene; docs/guide/yield_surfaces.md says what each means."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from jld_core import InputError

NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Vector = Annotated[list[float], Field(min_length=2, max_length=3)]
Two = Annotated[list[NonNegative], Field(min_length=2, max_length=2)]
Ring = Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=3)]


class Part(BaseModel):
    """Base class: immutable, without unknown keys, NaN or infinities."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class Point(Part):
    """Resultants over their units; those that are absent are 0."""

    N: float = 0.0
    V: float = 0.0
    V1: float = 0.0
    V2: float = 0.0
    M: float = 0.0
    M1: float = 0.0
    M2: float = 0.0
    MT: float = 0.0


class Row(Point):
    """Limit on a sum of resultants times factors."""

    most: Annotated[float, Field(ge=0, description="a number of at least 0: no force is inside a yield surface")]


class Cone(Part):
    """Limit √((b1 V1)² + (b2 V2)²) + k |MT| ≤ c + μN in space, as multiples of the reference strength."""

    shear: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = None
    torsion: NonNegative = 0.0
    capacity: NonNegative = 0.0
    friction: NonNegative = 0.0
    direction: Vector | None = None


class Friction(Part):
    """Friction and cohesion; in space along a direction, and across it."""

    coefficients: Annotated[NonNegative | Two, Field(description="a number of at least 0, or two in space")]
    cohesion: Annotated[NonNegative | Two, Field(description="a stress of at least 0, or two in space")] = 0.0
    direction: Vector | None = None
    cone: Literal["elliptic", "product"] = "elliptic"
    torsion: Annotated[NonNegative | None, Field(description="the coefficient of friction in torsion")] = None


class Bending(Part):
    """Limits on N and moments of a rectangle or hull: at the edges of the face, or elastic stress in its kern."""

    within: Literal["edges", "kern"] = "edges"
    tensile_strength: NonNegative = 0.0
    compressive_strength: Positive | None = None


class Section(Part):
    """Plastic cross-section of polygons in the unit square of a face, with a tension cut-off."""

    polygons: Annotated[list[Ring], Field(min_length=1, description="a list of polygons in the unit square")]
    holes: list[Ring] = []
    tensile_strength: NonNegative = 0.0
    compressive_strength: Positive | None = None
    shear_strength: NonNegative | None = None
    direction: Vector | None = None
    steps: Annotated[int, Field(ge=2, le=24)] = 6


class HoekBrown(Part):
    """Shear envelope of rock by tangents, in space by one cone."""

    compressive_strength: Positive
    m: Annotated[float, Field(gt=0, le=40)]
    s: Annotated[float, Field(ge=0, le=1)] = 1.0
    points: Annotated[list[Positive], Field(min_length=1, max_length=12)] = [0.02, 0.1, 0.3, 1.0]


class SurfaceKeys(Part):
    """A yield surface: every part that it states holds."""

    reference_strength: Positive = 1.0
    rows: list[Row] = []
    vertices: list[Point] = []
    rays: list[Point] = []
    symmetric: list[Literal["V", "V1", "V2", "M", "M1", "M2", "MT"]] = []
    cones: list[Cone] = []
    friction: Friction | None = None
    bending: Bending | None = None
    section: Section | None = None
    hoek_brown: HoekBrown | None = None

    @model_validator(mode="after")
    def _something(self) -> Self:
        """Check that some limit is stated, and vertices where there are rays."""
        if not self.model_fields_set - {"reference_strength", "symmetric", "rays"}:
            raise InputError(
                "", "it states no limit", '"rows", "vertices", "cones", "friction", "bending" or "section"'
            )
        if self.rays and not self.vertices:
            raise InputError(".rays", "they start at no vertex", '"vertices"')
        return self
