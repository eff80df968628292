"""Keys of loads and of movements of supports in a scene file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Final, Self

from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from jld_core.errors import InputError
from jld_core.scene.complaints import first_complaint
from jld_core.scene.materials import FillLoad
from jld_core.scene.part import Loading, LoadVector, NonNegative, Pair, Part, Positive, VaryingPositive, Vector


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
    force: Annotated[LoadVector | None, Field(description="a vector")] = None
    at: Annotated[Vector | None, Field(description="a point")] = None
    moment: Annotated[
        Loading | Annotated[list[Loading], Field(min_length=3, max_length=3)],
        Field(description="a number, spatial a vector"),
    ] = 0.0
    width: Annotated[Positive | None, Field(description="a length above 0")] = None

    @model_validator(mode="after")
    def _something(self) -> Self:
        """Check that a force or moment is given, and a force if "at" or "width" is given."""
        if self.force is None and "moment" not in self.model_fields_set:
            raise InputError("", "it does nothing", '"force" or "moment"')
        if self.at is not None and self.force is None:
            raise InputError(".at", 'it is given without "force"', "a force to apply there")
        if self.width is not None and self.force is None:
            raise InputError(".width", 'it is given without "force"', "a force to spread")
        return self


# Largest number of forces of a moving load at all its positions; each takes some 30 µs to place.
MOST_FORCES: Final = 200_000
OUTSIDE: Final = "outside"  # name of what lies beyond the free boundary of an element


class FacePlace(Part):
    """Part of the free boundary of a structure."""

    between: Annotated[Pair | None, Field(description='[element, "outside"]')] = None
    along: Annotated[list[Vector] | None, Field(min_length=2, description="a list of at least two points")] = None
    patch: Annotated[list[Vector] | None, Field(min_length=3, description="a list of at least three points")] = None

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        """Check that exactly one of the places is given."""
        places = [key for key in ("between", "along", "patch") if getattr(self, key) is not None]
        if len(places) != 1:
            problem = f'"{places[1]}" is given together with "{places[0]}"' if places else "it names no place"
            expected = f'"between": [element, "{OUTSIDE}"], or "along" or "patch" with points'
            raise InputError("", problem, expected)
        return self


class FaceLoad(Part):
    """Load on free faces: a pressure (positive inwards), a force per length of "along", or per area of "patch".

    Two pressures hold at the first and at the last point of "along", linear between them.
    """

    face: FacePlace
    pressure: Annotated[
        Loading | Annotated[list[Loading], Field(min_length=2, max_length=2)] | None,
        Field(description="a number, or two at the first and last point"),
    ] = None
    line: Annotated[Vector | None, Field(description="a vector")] = None
    traction: Annotated[Vector | None, Field(description="a vector")] = None

    @model_validator(mode="after")
    def _one_load(self) -> Self:
        """Check that one load is given, and a place that suits it."""
        loads = [key for key in ("pressure", "line", "traction") if getattr(self, key) is not None]
        if len(loads) != 1:
            if not loads:
                raise InputError(".pressure", "missing", 'a force per area, or "line" or "traction"')
            raise InputError(f".{loads[1]}", f'it is given together with "{loads[0]}"', "one of both")
        for key, place in (("line", "along"), ("traction", "patch")):
            if loads == [key] and getattr(self.face, place) is None:
                raise InputError(f".{key}", f'it is given without "{place}"', f'"face" with "{place}"')
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """Return the pressure at the first and at the last point, 0 for another load."""
        if isinstance(self.pressure, list):
            return self.pressure[0], self.pressure[1]
        return self.pressure or 0.0, self.pressure or 0.0


class BodyLoad(Part):
    """Load on every free element: the magnitude of its weight times a vector."""

    body: Annotated[LoadVector, Field(description="a vector")]


class Tilt(Part):
    """Table on which a structure is tilted with its ground.

    towards: horizontal direction. pivot: points on the line about which it turns, for the record.
    """

    towards: Annotated[Vector, Field(description="a horizontal direction")]
    pivot: Annotated[list[Vector] | None, Field(min_length=1, max_length=2)] = None

    @model_validator(mode="after")
    def _a_direction(self) -> Self:
        """Check that the direction is one, and lies across the pivot line."""
        if not any(self.towards):
            raise InputError(".towards", "it is zero", "a horizontal direction")
        points, d = self.pivot or [], len(self.towards)
        if points and (len(points) != d - 1 or any(len(point) != d for point in points)):
            raise InputError(".pivot", f"it has {len(points)} points", "one point in the plane, two in space")
        if len(points) == 2:
            line = [end - start for start, end in zip(*points, strict=True)]
            work = sum(a * b for a, b in zip(line, self.towards, strict=True))
            if not any(line) or abs(work) > 1e-9 * math.hypot(*line) * math.hypot(*self.towards):
                raise InputError(".pivot", "it does not lie across the direction", "a line across it")
        return self


class TiltLoad(Part):
    """Self-weight that turns as a table is tilted; alone in a list of live loads: λ is the tangent of the angle."""

    tilt: Annotated[Tilt, Field(description='an object with "towards"')]

    @property
    def body(self) -> list[float]:
        """Return the unit vector of the direction, by which weights are multiplied at λ = 1."""
        size = math.hypot(*self.tilt.towards)
        return [component / size for component in self.tilt.towards]


def body_of(entry: Mapping[str, Any]) -> list[float] | None:
    """Return the vector by which a load entry of a document multiplies weights; None for another load."""
    return TiltLoad.model_validate(entry).body if "tilt" in entry else entry.get("body")


# Kinds of load entries by the key that tells them apart; others are point loads
_KINDS: Final[dict[str, type[BodyLoad] | type[FaceLoad] | type[FillLoad] | type[TiltLoad]]] = {
    "body": BodyLoad,
    "tilt": TiltLoad,
    "face": FaceLoad,
    "on_fill": FillLoad,
}


def _tell_the_kinds_apart(entries: Any, info: ValidationInfo) -> Any:
    # Kinds are body loads, pressures, loads on fill and point loads. Error messages then refer to the kind of load that
    # was meant.
    if not isinstance(entries, list):
        return entries
    kinds: list[Any] = []
    forms = {key: kind for key, kind in _KINDS.items() if kind is not TiltLoad or info.field_name == "live"}
    for index, entry in enumerate(entries):
        if isinstance(entry, PointLoad | BodyLoad | FaceLoad | FillLoad | TiltLoad):
            kinds.append(entry)
            continue
        is_body_load = isinstance(entry, dict) and "body" in entry
        kind = next((kind for key, kind in forms.items() if isinstance(entry, dict) and key in entry), PointLoad)
        if is_body_load and len(entry) > 1:
            extra = next(key for key in entry if key != "body")
            raise InputError(
                f"[{index}]",
                f'"{extra}" is given together with "body"',
                "a body load alone, others in entries of their own",
            )
        try:
            kinds.append(kind.model_validate(entry))
        except ValidationError as error:
            whole_structure = [key for key in forms if key in ("body", "tilt")]
            keys = (*whole_structure, *FaceLoad.model_fields, *FillLoad.model_fields, *PointLoad.model_fields)
            complaint = first_complaint(error, kind, keys)
            where = f"[{index}]" + (f".{complaint.where}" if complaint.where else "")
            raise InputError(where, complaint.problem, complaint.expected) from None
    return kinds


_Acting = PointLoad | BodyLoad | FaceLoad | FillLoad
LoadEntry = _Acting | TiltLoad

# load entries of a scene
_Dead = list[_Acting]
_Entries = list[LoadEntry]


def require_unique_names(key: str, names: list[str]) -> None:
    """Raise InputError if two entries of a list have the same name."""
    for position, name in enumerate(names):
        if name in names[:position]:
            raise InputError(f"{key}[{position}].name", f"{name!r} is used twice", "a name of its own for each")


class Case(Part):
    """Load case of a structure; required: load factor by which λ of the case is divided."""

    name: Annotated[str, Field(min_length=1, description="a name of its own")]
    live: Annotated[_Entries, Field(description="a list of loads that are multiplied by λ")]
    dead: _Dead = []
    required: Positive = 1.0

    _kinds = field_validator("dead", "live", mode="before")(_tell_the_kinds_apart)


class Axle(Part):
    """Axle of a vehicle, at a distance from the one before it."""

    weight: Annotated[VaryingPositive, Field(description="a force above 0")]
    distance: NonNegative = 0.0


class MovingLoad(Part):
    """Vehicle that moves along a path on a planar structure; each of its positions is a load case.

    steps: positions from the first axle at the start of the path to the last axle at its end.
    """

    name: Annotated[str, Field(min_length=1, description="a name of its own")] = "moving"
    axles: Annotated[list[Axle], Field(min_length=1, description="a list of axles with weights and distances")]
    path: Annotated[list[Vector], Field(min_length=2, description="a list of at least two points")]
    steps: Annotated[int, Field(ge=1, le=1000, description="a whole number from 1 to 1000")] = 20
    both_directions: bool = False
    required: Positive = 1.0

    @model_validator(mode="after")
    def _not_too_many(self) -> Self:
        """Check the number of forces of all positions, each of which is placed on an element."""
        forces = len(self.axles) * self.steps * (2 if self.both_directions else 1)
        if forces > MOST_FORCES:
            problem = f"{len(self.axles)} axles at {self.steps} positions are {forces} forces"
            raise InputError("", problem, f"at most {MOST_FORCES}: fewer axles or steps")
        return self


class Pushes(Part):
    """Horizontal forces in proportion to weight; each direction is a load case.

    directions: number of directions at equal angles (planar 1 or 2), or vectors of any length.
    """

    name: Annotated[str, Field(min_length=1, description="a name of its own")] = "push"
    of_weight: Annotated[Positive, Field(description="a share of the weight above 0")] = 1.0
    directions: Annotated[
        Annotated[int, Field(ge=1, le=360)] | Annotated[list[Vector], Field(min_length=1)],
        Field(description="a number of directions, or a list of vectors"),
    ]
    required: Positive = 1.0


class Loads(Part):
    """Dead loads, and either live loads, or load cases, moving loads and pushes."""

    dead: _Dead = []
    live: Annotated[_Entries | None, Field(description="a list of loads that are multiplied by λ")] = None
    cases: Annotated[list[Case] | None, Field(min_length=1)] = None
    moving: Annotated[list[MovingLoad] | None, Field(min_length=1, description="a list of moving loads")] = None
    pushes: Annotated[Pushes | None, Field(description='an object with "directions"')] = None

    _kinds = field_validator("dead", "live", mode="before")(_tell_the_kinds_apart)

    @model_validator(mode="after")
    def _one_or_several(self) -> Self:
        """Check that live loads are given, or load cases, moving loads or pushes."""
        kind = next((key for key in ("cases", "moving", "pushes") if getattr(self, key) is not None), "")
        if self.live is None and not kind:
            raise InputError(".live", "missing", 'a list of loads that are multiplied by λ, or "cases"')
        if self.live is not None and kind:
            raise InputError(".live", f'it is given together with "{kind}"', "the live loads of each case inside it")
        for key, live, dead in self._tilted():
            if len(live) > 1:
                raise InputError(key, "a tilt stands beside other live loads", "the tilt alone")
            if dead:
                raise InputError(key, "a tilt turns weights alone, and there are dead loads", "weights of elements")
        require_unique_names(".cases", [case.name for case in self.cases or []])
        require_unique_names(".moving", [load.name for load in self.moving or []])
        return self

    def _tilted(self) -> list[tuple[str, _Entries, _Dead]]:
        """Return key, live and dead loads of each case that tilts."""
        cases = [(".live", self.live or [], self.dead)]
        cases += [(f".cases[{k}].live", case.live, self.dead + case.dead) for k, case in enumerate(self.cases or [])]
        return [case for case in cases if any(isinstance(entry, TiltLoad) for entry in case[1])]

    @property
    def tilts(self) -> bool:
        """Return True if a structure is tilted."""
        return bool(self._tilted())

    @property
    def has_cases(self) -> bool:
        """Return True if the loads are load cases, stated or from moving loads and pushes."""
        return self.live is None


class Moved(Part):
    """Supports that move together as a rigid body during a settlement."""

    elements: Annotated[str | list[str], Field(description="the id of a support, or a list of them")]
    move: Annotated[Vector | None, Field(description="a vector")] = None
    turn: Annotated[
        float | Annotated[list[float], Field(min_length=3, max_length=3)],
        Field(description="a number, spatial a vector"),
    ] = 0.0
    about: Annotated[Vector | None, Field(description="a point")] = None


class Settling(Part):
    """Movement of supports in a known direction, such as a foundation that sinks or tilts.

    load: share of the live load that acts during the movement.
    """

    name: Annotated[str, Field(min_length=1, description="a name of its own")]
    supports: Annotated[list[Moved], Field(min_length=1)]
    load: NonNegative = 0.0
