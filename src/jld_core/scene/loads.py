"""Define the keys of loads and of movements of supports in a scene file."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from jld_core.errors import InputError
from jld_core.scene.complaints import first_complaint
from jld_core.scene.part import NonNegative, Part, Positive, Vector


class PointLoad(Part):
    """Force and moment on one free element.

    Attributes
    ----------
    element : str
        Id of a free element.
    force : list of float or None
        Force vector.
    at : list of float or None
        Point of application in the scene; None for the element's centroid.
    moment : float or list of float
        Moment, planar a number, spatial a vector.
    width : float or None
        Length of the patch on a free face that the force is spread on where blocks crack by fields.
    """

    element: Annotated[str, Field(description='the id of a free element, or "body" for a load on all')]
    force: Annotated[Vector | None, Field(description="a vector")] = None
    at: Annotated[Vector | None, Field(description="a point")] = None
    moment: Annotated[
        float | Annotated[list[float], Field(min_length=3, max_length=3)],
        Field(description="a number, spatial a vector"),
    ] = 0.0
    width: Annotated[Positive | None, Field(description="a length above 0")] = None

    @model_validator(mode="after")
    def _something(self) -> Self:
        """Check that a force or moment is given, and a force if "at" or "width" is given."""
        if self.force is None and "moment" not in self.model_fields_set:
            raise InputError("", "it does nothing", '"force" or "moment"')
        if self.at is not None and self.force is None:
            raise InputError(".at", 'it stands without "force"', "a force to apply there")
        if self.width is not None and self.force is None:
            raise InputError(".width", 'it stands without "force"', "a force to spread")
        return self


class BodyLoad(Part):
    """Load on every free element: the magnitude of its weight times a vector.

    Attributes
    ----------
    body : list of float
        Vector, dimensionless.
    """

    body: Annotated[Vector, Field(description="a vector")]


def _tell_the_kinds_apart(entries: Any) -> Any:
    """Validate load entries as body loads or point loads, chosen by their keys.

    Error messages then refer to the kind of load that was meant.
    """
    if not isinstance(entries, list):
        return entries
    kinds: list[Any] = []
    for index, entry in enumerate(entries):
        body = isinstance(entry, dict) and "body" in entry
        if body and len(entry) > 1:
            other = next(key for key in entry if key != "body")
            raise InputError(
                f"[{index}]",
                f'"{other}" stands beside "body"',
                "a body load alone, others in entries of their own",
            )
        try:
            kinds.append((BodyLoad if body else PointLoad).model_validate(entry))
        except ValidationError as error:
            known = ("body", *PointLoad.model_fields)
            found = first_complaint(error, BodyLoad if body else PointLoad, known)
            where = f"[{index}]" + (f".{found.where}" if found.where else "")
            raise InputError(where, found.problem, found.expected) from None
    return kinds


_Entries = list[PointLoad | BodyLoad]
"""Load entries of a scene."""


def require_unique_names(key: str, names: list[str]) -> None:
    """Raise InputError if two entries of a list have the same name.

    key: key of the list in the scene, for the message. names: names of its entries.
    """
    for position, name in enumerate(names):
        if name in names[:position]:
            raise InputError(f"{key}[{position}].name", f"{name!r} is used twice", "a name of its own for each")


class Case(Part):
    """Load case of a structure.

    Attributes
    ----------
    name : str
        Name of its own.
    live : list of PointLoad or BodyLoad
        Loads that are multiplied by λ.
    dead : list of PointLoad or BodyLoad
        Loads that act beside the dead loads of all cases.
    required : float
        Required load factor, by which λ of the case is divided.
    """

    name: Annotated[str, Field(min_length=1, description="a name of its own")]
    live: Annotated[_Entries, Field(description="a list of loads that are multiplied by λ")]
    dead: _Entries = []
    required: Positive = 1.0

    _kinds = field_validator("dead", "live", mode="before")(_tell_the_kinds_apart)


class Loads(Part):
    """Dead loads, and either live loads or load cases.

    Attributes
    ----------
    dead : list of PointLoad or BodyLoad
        Loads beside self-weight that are not multiplied by λ.
    live : list of PointLoad or BodyLoad, or None
        Loads that are multiplied by λ; None if there are cases.
    cases : list of Case or None
        Load cases; None if there is one live load.
    """

    dead: _Entries = []
    live: Annotated[_Entries | None, Field(description="a list of loads that are multiplied by λ")] = None
    cases: Annotated[list[Case] | None, Field(min_length=1)] = None

    _kinds = field_validator("dead", "live", mode="before")(_tell_the_kinds_apart)

    @model_validator(mode="after")
    def _one_or_several(self) -> Self:
        """Check that exactly one of live loads and load cases is given."""
        if self.live is None and self.cases is None:
            raise InputError(".live", "missing", 'a list of loads that are multiplied by λ, or "cases"')
        if self.live is not None and self.cases is not None:
            raise InputError(".live", 'it stands beside "cases"', "the live loads of each case inside it")
        require_unique_names(".cases", [case.name for case in self.cases or []])
        return self


class Moved(Part):
    """Supports that move together as a rigid body during a settlement.

    Attributes
    ----------
    elements : str or list of str
        Ids of the supports.
    move : list of float or None
        Direction and relative size of the translation; None for none.
    turn : float or list of float
        Rotation relative to the translation: a number, counter-clockwise, or a spatial vector.
    about : list of float or None
        Centre of the rotation; None for the mean of the supports' centroids.
    """

    elements: Annotated[str | list[str], Field(description="the id of a support, or a list of them")]
    move: Annotated[Vector | None, Field(description="a vector")] = None
    turn: Annotated[
        float | Annotated[list[float], Field(min_length=3, max_length=3)],
        Field(description="a number, spatial a vector"),
    ] = 0.0
    about: Annotated[Vector | None, Field(description="a point")] = None


class Settling(Part):
    """Movement of supports in a known direction, such as a foundation that sinks or tilts.

    Attributes
    ----------
    name : str
        Name of its own.
    supports : list of Moved
        Supports that move; all others stay.
    load : float
        Share of the live load that acts meanwhile.
    """

    name: Annotated[str, Field(min_length=1, description="a name of its own")]
    supports: Annotated[list[Moved], Field(min_length=1)]
    load: NonNegative = 0.0
