"""Keys of a scene file, with types and defaults."""

from __future__ import annotations

import hashlib
import json
import math
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from jld_core.errors import InputError
from jld_core.scene.complaints import first_complaint
from jld_core.scene.cracks import FORMS, CrackModel, cracks_by_kind
from jld_core.scene.part import Angle, LabelName, NonNegative, Pair, Part, Positive, PositiveValue, Value, Vector
from jld_core.scene.search import Labels, Search


class Units(Part):
    """Names of the units for tables and axes; the numbers must be consistent with them."""

    length: str = "m"
    force: str = "N"


class Grid(Part):
    """Planar cells, given as rows of letters.

    Attributes
    ----------
    cell : [float, float]
        Width and height of a cell, length.
    thickness : float
        Out-of-plane depth, length.
    rows : list of str
        Rows from top to bottom: '.' no cell, '#' a support, connected equal letters one block.
    """

    cell: Annotated[list[Positive], Field(min_length=2, max_length=2, description="[width, height] of a cell")]
    thickness: Positive = 1.0
    rows: Annotated[list[str], Field(min_length=1, description="a list of texts, the top row first")]

    @field_validator("rows")
    @classmethod
    def _rows_are_a_rectangle(cls, rows: list[str]) -> list[str]:
        """Check that rows have equal length, valid characters and a free cell."""
        for index, row in enumerate(rows):
            if len(row) != len(rows[0]):
                raise InputError("", f"row {index} has {len(row)} cells", f"{len(rows[0])} as in row 0")
            if bad := [c for c in row if c not in ".#" and not c.isalpha()]:
                raise InputError("", f"row {index} holds {bad[0]!r}", "letters, '#' or '.'")
        if not any(c.isalpha() for row in rows for c in row):
            raise InputError("", "no free cell", "at least one letter")
        return rows


class Element(Part):
    """Rigid element: a polygon (planar), or vertices and faces (spatial).

    Attributes
    ----------
    id : str
        Unique name.
    polygon : list of [x, y] or None
        Corners of a planar element, length.
    vertices : list of [x, y, z] or None
        Vertices of a spatial element, length.
    faces : list of lists of int or None
        Faces of a spatial element as loops of vertex indices from 0.
    weight : float or None
        Weight as a force; overrides densities.
    density : float or None
        Density; overrides that of the materials.
    volume : float or None
        Volume used instead of the computed one.
    centroid : list of float or None
        Centroid used instead of the computed one.
    block : str or None
        Block name; elements of equal name form one block.
    support : bool
        True for a fixed element.
    """

    id: Annotated[str, Field(min_length=1, description="a name of its own")]
    polygon: Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=3)] | None = (
        None
    )
    vertices: Annotated[list[Annotated[list[float], Field(min_length=3, max_length=3)]], Field(min_length=4)] | None = (
        None
    )
    faces: Annotated[list[Annotated[list[int], Field(min_length=3)]], Field(min_length=4)] | None = None
    weight: NonNegative | None = None
    density: NonNegative | None = None
    volume: Positive | None = None
    centroid: Vector | None = None
    block: str | None = None
    support: bool = False

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        """Check that exactly one form of geometry is given, with valid indices and dimensions."""
        if (self.polygon is None) == (self.vertices is None):
            how = "both are" if self.polygon is not None else "neither is"
            wanted = '"polygon", or "vertices" with "faces"'
            raise InputError("", f'of "polygon" and "vertices" {how} given', wanted)
        if (self.vertices is None) != (self.faces is None):
            lone = "faces" if self.vertices is None else "vertices"
            raise InputError("", f'"{lone}" is given alone', '"vertices" and "faces" together, or "polygon"')
        if self.vertices is not None and self.faces is not None:
            for face in self.faces:
                if bad := [i for i in face if not 0 <= i < len(self.vertices)]:
                    raise InputError(
                        ".faces",
                        f"a face names vertex {bad[0]}",
                        f"numbers from 0 to {len(self.vertices) - 1}",
                    )
        dimension = 2 if self.polygon is not None else 3
        if self.centroid is not None and len(self.centroid) != dimension:
            raise InputError(".centroid", f"it has {len(self.centroid)} numbers", f"{dimension}")
        return self


class Contact(Part):
    """Interface stated in the scene, used without contact detection.

    Strengths and friction override "materials" for this interface.

    Attributes
    ----------
    elements : [str, str]
        Ids of the two elements.
    polygon : list of points
        Two points [x, y], or the corners of a spatial polygon in order, length.
    label : {"dry", "inner"} or None
        Label of the interface.
    friction_coefficient, friction_angle : float or None
        Friction of the dry joint, as a coefficient or an angle in degrees.
    tensile_strength, shear_strength : float or None
        Strengths of the inner face, stress.
    compressive_strength : float or None
        Compressive strength under either label, stress.
    cohesion : float or None
        Cohesion of the dry joint, stress.
    inner_friction_coefficient, inner_friction_angle : float or None
        Friction of the inner face, as a coefficient or an angle in degrees.
    """

    elements: Annotated[Pair, Field(description="[id, id] of the two elements")]
    polygon: Annotated[list[Vector], Field(min_length=2, description="two points [x, y], or a spatial polygon")]
    label: LabelName | None = None
    friction_coefficient: Value | None = None
    friction_angle: Angle | None = None
    tensile_strength: Value | None = None
    shear_strength: Value | None = None
    compressive_strength: PositiveValue | None = None
    cohesion: Value | None = None
    inner_friction_coefficient: Value | None = None
    inner_friction_angle: Angle | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        """Check that no friction is given both as angle and as coefficient."""
        for name in ("friction", "inner_friction"):
            if getattr(self, f"{name}_angle") is not None and getattr(self, f"{name}_coefficient") is not None:
                raise InputError("", "friction is given twice", f'"{name}_angle" or "{name}_coefficient"')
        return self


class Dry(Part):
    """Material of dry joints: no tension, Mohr–Coulomb friction, optional cohesion.

    Attributes
    ----------
    friction_angle, friction_coefficient : float or None
        Friction, as an angle in degrees or a coefficient; exactly one is given.
    compressive_strength : float or None
        Compressive strength, stress; None for unlimited.
    cohesion : float
        Cohesion, stress.
    """

    friction_angle: Angle | None = None
    friction_coefficient: Value | None = None
    compressive_strength: PositiveValue | None = None
    cohesion: Value = 0.0

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        """Check that friction is given exactly once."""
        if (self.friction_angle is None) == (self.friction_coefficient is None):
            how = "friction is missing" if self.friction_angle is None else "friction is given twice"
            raise InputError("", how, 'exactly one of "friction_angle" and "friction_coefficient"')
        return self


def lies_within_apex(tension: float | None, shear: float | None, friction: float | None, where: str = "") -> None:
    """Refuse a tensile strength beyond the apex of the friction cone, shear strength over μ.

    Parameters
    ----------
    tension, shear : float or None
        Tensile and shear strength, stress.
    friction : float or None
        Friction coefficient μ; without friction there is no apex.
    where : str
        Key for the error message.

    Raises
    ------
    InputError
        tension × μ exceeds the shear strength.
    """
    if tension is not None and shear is not None and friction and tension * friction > shear * (1.0 + 1e-12):
        raise InputError(
            where,
            f"tensile_strength {tension:g} lies beyond the apex of its friction",
            f"at most shear_strength over friction, {shear / friction:g}",
        )


class Inner(Part):
    """Material of inner faces (potential cracks): tensile and shear strength, friction.

    Attributes
    ----------
    tensile_strength, shear_strength : float
        Strengths, stress.
    compressive_strength : float or None
        Compressive strength, stress; None for unlimited.
    friction_angle, friction_coefficient : float or None
        Friction, as an angle in degrees or a coefficient; at most one is given.
    """

    tensile_strength: Annotated[Value, Field(description="a stress of at least 0")]
    shear_strength: Annotated[Value, Field(description="a stress of at least 0")]
    compressive_strength: PositiveValue | None = None
    friction_angle: Angle | None = None
    friction_coefficient: Value | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        """Check that friction is given at most once and its apex allows the tensile strength."""
        if self.friction_angle is not None and self.friction_coefficient is not None:
            raise InputError("", "friction is given twice", '"friction_angle" or "friction_coefficient"')
        angle, coefficient = self.friction_angle, self.friction_coefficient
        slope = coefficient if angle is None else math.tan(math.radians(angle))
        lies_within_apex(self.tensile_strength, self.shear_strength, slope)
        return self


class DryFace(Part):
    """Joint values that override "materials.dry" for the faces between two elements.

    Attributes
    ----------
    friction_angle, friction_coefficient : float or None
        Friction, as an angle in degrees or a coefficient; at most one is given.
    compressive_strength, cohesion : float or None
        Strengths, stress.
    """

    friction_angle: Angle | None = None
    friction_coefficient: Value | None = None
    compressive_strength: PositiveValue | None = None
    cohesion: Value | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        """Check that friction is given at most once."""
        _at_most_one_friction(self.friction_angle, self.friction_coefficient)
        return self


class InnerFace(Part):
    """Inner-face values that override "materials.inner" for the faces between two elements.

    Attributes
    ----------
    tensile_strength, shear_strength, compressive_strength : float or None
        Strengths, stress.
    friction_angle, friction_coefficient : float or None
        Friction, as an angle in degrees or a coefficient; at most one is given.
    """

    tensile_strength: Value | None = None
    shear_strength: Value | None = None
    compressive_strength: PositiveValue | None = None
    friction_angle: Angle | None = None
    friction_coefficient: Value | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        """Check that friction is given at most once."""
        _at_most_one_friction(self.friction_angle, self.friction_coefficient)
        return self


def _at_most_one_friction(angle: float | None, coefficient: float | None) -> None:
    """Raise InputError if both angle and coefficient are given."""
    if angle is not None and coefficient is not None:
        raise InputError("", "friction is given twice", '"friction_angle" or "friction_coefficient"')


class FaceMaterial(Part):
    """Material of all faces between two elements; absent values are those of "materials".

    Attributes
    ----------
    between : [str, str]
        Ids of two elements that touch.
    dry : DryFace or None
        Values of dry joints.
    inner : InnerFace or None
        Values of inner faces.
    """

    between: Annotated[Pair, Field(description="[id, id] of two elements that touch")]
    dry: DryFace | None = None
    inner: InnerFace | None = None

    @model_validator(mode="after")
    def _something(self) -> Self:
        """Check that at least one material is given."""
        if self.dry is None and self.inner is None:
            raise InputError("", "it states no value", '"dry", "inner" or both')
        return self


class Materials(Part):
    """Weights and strengths of all elements and faces.

    Attributes
    ----------
    density : float or None
        Density of elements that state none.
    gravity : float or list of float
        Magnitude, acting downwards, or a vector.
    dry : Dry or None
        Material of dry joints.
    inner : Inner or None
        Material of inner faces.
    faces : list of FaceMaterial
        Materials of the faces between pairs of elements.
    """

    density: NonNegative | None = None
    gravity: Annotated[float | Vector, Field(description="a number or a vector")] = 9.81
    dry: Dry | None = None
    inner: Inner | None = None
    faces: list[FaceMaterial] = []


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


def _names_of_their_own(key: str, names: list[str]) -> None:
    """Raise InputError for a name used twice."""
    for position, name in enumerate(names):
        if name in names[:position]:
            raise InputError(f"{key}[{position}].name", f"{name!r} is used twice", "a name of its own for each")


class Case(Part):
    """Load case: further dead loads, live loads multiplied by λ, and the required factor."""

    name: Annotated[str, Field(min_length=1, description="a name of its own")]
    live: Annotated[_Entries, Field(description="a list of loads that are multiplied by λ")]
    dead: _Entries = []
    required: Positive = 1.0

    _kinds = field_validator("dead", "live", mode="before")(_tell_the_kinds_apart)


class Loads(Part):
    """Dead loads, and either live loads or load cases."""

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
        _names_of_their_own(".cases", [case.name for case in self.cases or []])
        return self


class Moved(Part):
    """Supports that move together: translation, rotation and its centre."""

    elements: Annotated[str | list[str], Field(description="the id of a support, or a list of them")]
    move: Annotated[Vector | None, Field(description="a vector")] = None
    turn: Annotated[
        float | Annotated[list[float], Field(min_length=3, max_length=3)],
        Field(description="a number, spatial a vector"),
    ] = 0.0
    about: Annotated[Vector | None, Field(description="a point")] = None


class Settling(Part):
    """Movement of supports in a known direction: a foundation that sinks, spreads or tilts."""

    name: Annotated[str, Field(min_length=1, description="a name of its own")]
    supports: Annotated[list[Moved], Field(min_length=1)]
    load: NonNegative = 0.0


class Scene(Part):
    """Validated scene file; geometry is given as either "grid" or "elements".

    Attributes
    ----------
    name : str
        Heading of tables and figures.
    units : Units
        Names of the units of length and force.
    source, notes, expected : str, str, dict
        Free content that no computation reads.
    grid : Grid or None
        Planar cells.
    elements : list of Element or None
        Elements, all planar or all spatial.
    thickness : float or None
        Out-of-plane depth of planar elements; 1 where absent.
    tolerance : float or None
        Length up to which gaps and overlaps are closed; None for the default.
    interfaces : list of Contact or None
        Stated interfaces; None to detect contacts.
    materials : Materials
        Weights and strengths.
    loads : Loads
        Dead and live loads, or load cases.
    settlements : list of Settling
        Movements of supports.
    labels : Labels
        The scene's own labelling.
    search : Search
        Candidates, limits and objectives of a search.
    cracks : "faces", CellCracks or FieldCracks
        How blocks crack.
    """

    name: Annotated[str, Field(min_length=1)] = "scene"
    units: Units = Units()
    source: str = ""
    notes: str = ""
    expected: dict[str, Any] = {}
    grid: Grid | None = None
    elements: Annotated[list[Element], Field(min_length=1)] | None = None
    thickness: Positive | None = None
    tolerance: NonNegative | None = None
    interfaces: list[Contact] | None = None
    materials: Annotated[Materials, Field(description='an object with "dry", "inner" or both')]
    loads: Annotated[Loads, Field(description='an object with "live"')]
    settlements: list[Settling] = []
    labels: Labels = Labels()
    search: Search = Search()
    cracks: Annotated[CrackModel, Field(description=FORMS)] = "faces"

    _crack_model = field_validator("cracks", mode="before")(cracks_by_kind)

    @model_validator(mode="after")
    def _one_geometry(self) -> Self:
        """Check that the geometry is given once and has one dimension.

        Also check that names of settlements are unique.
        """
        if (self.grid is None) == (self.elements is None):
            how = "missing" if self.grid is None else "given twice"
            raise InputError("", f"the geometry is {how}", 'exactly one of "grid" and "elements"')
        if self.grid is not None and self.thickness is not None:
            raise InputError(".thickness", "it stands beside a grid", 'the thickness inside "grid"')
        _names_of_their_own(".settlements", [one.name for one in self.settlements])
        if self.elements is not None:
            planar = [element.polygon is not None for element in self.elements]
            if any(planar) and not all(planar):
                odd = planar.index(not planar[0])
                kinds = ("planar", "spatial") if planar[0] else ("spatial", "planar")
                raise InputError(
                    f".elements[{odd}]",
                    f"it is {kinds[1]} and the ones before are {kinds[0]}",
                    "elements of one dimension",
                )
        return self

    def __repr__(self) -> str:
        return f"Scene({self.name!r}, {'planar' if self.dimension == 2 else 'spatial'})"

    @property
    def dimension(self) -> Literal[2, 3]:
        """Return 2 for a planar scene, 3 for a spatial one."""
        return 3 if self.elements is not None and self.elements[0].polygon is None else 2

    @property
    def fingerprint(self) -> str:
        """Return a hex digest of all keys that results depend on.

        Name, source, notes and expected are left out.
        """
        content = self.model_dump(mode="json", exclude={"name", "source", "notes", "expected"})
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
