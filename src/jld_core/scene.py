"""The scene file: a JSON document checked key by key, before anything is computed from it."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from jld_core.errors import InputError

LabelName = Literal["dry", "inner"]
Pair = Annotated[list[str], Field(min_length=2, max_length=2)]
Vector = Annotated[list[float], Field(min_length=2, max_length=3)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class _Part(BaseModel):
    """A part of the scene: unknown keys, NaN and infinities are errors, and nothing changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class Units(_Part):
    """Words for tables and axes; the numbers are whatever the file says, consistently."""

    length: str = "m"
    force: str = "N"


class Grid(_Part):
    """Planar cells: row 0 is the top row, '.' no cell, '#' a support, equal joined letters one block."""

    cell: Annotated[list[Positive], Field(min_length=2, max_length=2)]
    thickness: Positive = 1.0
    rows: Annotated[list[str], Field(min_length=1)]

    @field_validator("rows")
    @classmethod
    def _rows_are_a_rectangle(cls, rows: list[str]) -> list[str]:
        for index, row in enumerate(rows):
            if len(row) != len(rows[0]):
                raise ValueError(f"row {index} has {len(row)} cells; expected {len(rows[0])} as in row 0")
            if bad := [c for c in row if c not in ".#" and not c.isalpha()]:
                raise ValueError(f"row {index} holds {bad[0]!r}; expected letters, '#' or '.'")
        if not any(c.isalpha() for row in rows for c in row):
            raise ValueError("no free cell; expected at least one letter")
        return rows


class Element(_Part):
    """One rigid element: a polygon (planar), or vertices and faces (spatial)."""

    id: Annotated[str, Field(min_length=1)]
    polygon: (
        Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=3)] | None
    ) = None
    vertices: (
        Annotated[list[Annotated[list[float], Field(min_length=3, max_length=3)]], Field(min_length=4)] | None
    ) = None
    faces: Annotated[list[Annotated[list[int], Field(min_length=3)]], Field(min_length=4)] | None = None
    weight: NonNegative | None = None
    density: NonNegative | None = None
    volume: Positive | None = None
    centroid: Vector | None = None
    block: str | None = None
    support: bool = False

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if (self.polygon is None) == (self.vertices is None):
            raise ValueError('it needs exactly one form; expected "polygon", or "vertices" with "faces"')
        if (self.vertices is None) != (self.faces is None):
            raise ValueError('"vertices" and "faces" go together; expected both or neither')
        if self.vertices is not None and self.faces is not None:
            for face in self.faces:
                if bad := [i for i in face if not 0 <= i < len(self.vertices)]:
                    raise ValueError(f"a face names vertex {bad[0]}; expected 0 to {len(self.vertices) - 1}")
        dimension = 2 if self.polygon is not None else 3
        if self.centroid is not None and len(self.centroid) != dimension:
            raise ValueError(f"centroid has {len(self.centroid)} numbers; expected {dimension}")
        return self


class Contact(_Part):
    """An interface given by hand, used as it is; material keys override "materials" for this face."""

    elements: Pair
    polygon: Annotated[list[Vector], Field(min_length=2)]
    label: LabelName | None = None
    friction_coefficient: NonNegative | None = None
    friction_angle: Annotated[float, Field(ge=0, lt=90)] | None = None
    tensile_strength: NonNegative | None = None
    shear_strength: NonNegative | None = None
    compressive_strength: Positive | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        if self.friction_angle is not None and self.friction_coefficient is not None:
            raise ValueError('friction is given twice; expected "friction_angle" or "friction_coefficient"')
        return self


class Dry(_Part):
    """A joint between blocks: no tension, Mohr–Coulomb friction."""

    friction_angle: Annotated[float, Field(ge=0, lt=90)] | None = None
    friction_coefficient: NonNegative | None = None
    compressive_strength: Positive | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        if (self.friction_angle is None) == (self.friction_coefficient is None):
            raise ValueError('it needs exactly one of "friction_angle" and "friction_coefficient"')
        return self


class Inner(_Part):
    """A crack plane inside a block: finite tensile and shear strength."""

    tensile_strength: NonNegative
    shear_strength: NonNegative
    compressive_strength: Positive | None = None


class Materials(_Part):
    density: NonNegative | None = None
    gravity: float | Vector = 9.81
    dry: Dry | None = None
    inner: Inner | None = None


class PointLoad(_Part):
    """A force on one element, at its centroid unless "at" says where, and a moment."""

    element: str
    force: Vector | None = None
    at: Vector | None = None
    moment: float | Annotated[list[float], Field(min_length=3, max_length=3)] = 0.0

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.force is None and "moment" not in self.model_fields_set:
            raise ValueError('it does nothing; expected "force" or "moment"')
        if self.at is not None and self.force is None:
            raise ValueError('"at" without "force"; expected a force to apply there')
        return self


class BodyLoad(_Part):
    """Weight, as a positive magnitude, times this vector on every free element."""

    body: Vector


class Loads(_Part):
    dead: list[PointLoad | BodyLoad] = []
    live: list[PointLoad | BodyLoad]

    @field_validator("dead", "live", mode="before")
    @classmethod
    def _tell_the_kinds_apart(cls, entries: Any) -> Any:
        if not isinstance(entries, list):
            return entries
        kinds: list[Any] = []
        for index, entry in enumerate(entries):
            kind = BodyLoad if isinstance(entry, dict) and "body" in entry else PointLoad
            try:
                kinds.append(kind.model_validate(entry))
            except ValidationError as error:
                where, problem = _first_complaint(error)
                raise ValueError(f"entry {index}{'.' + where if where else ''}: {problem}") from None
        return kinds


class Labels(_Part):
    default: LabelName | None = None
    inner: list[Pair] = []
    dry: list[Pair] = []


class Keep(_Part):
    dry: list[Pair] = []
    inner: list[Pair] = []


def _ordered(bounds: list[Any]) -> list[Any]:
    low, high = bounds
    if low is not None and high is not None and low > high:
        raise ValueError(f"least {low:g} is above most {high:g}; expected [least, most]")
    return bounds


Counts = Annotated[list[Annotated[int, Field(ge=0)] | None], Field(min_length=2, max_length=2)]
Sizes = Annotated[list[NonNegative | None], Field(min_length=2, max_length=2)]


class Front(_Part):
    count: Literal["dry_faces", "dry_length", "blocks"] = "dry_faces"
    sense: Literal["max", "min"] = "max"


class Search(_Part):
    """What may be relabelled, and which labellings count."""

    candidates: Literal["all", "all+supports", "inside-blocks"] | list[Pair] = "all"
    keep: Keep = Keep()
    segmentation: bool = True
    block_cells: Counts = [None, None]
    block_weight: Sizes = [None, None]
    block_extent: Sizes = [None, None]
    blocks: Counts = [None, None]
    dry_faces: Counts = [None, None]
    symmetry: Literal["auto", "none", "mirror-x"] = "auto"
    front: Front = Front()

    _in_order = field_validator("block_cells", "block_weight", "block_extent", "blocks", "dry_faces")(
        _ordered
    )


class Scene(_Part):
    """A whole scene file, validated; geometry is one of two forms, "grid" or "elements"."""

    name: Annotated[str, Field(min_length=1)] = "scene"
    units: Units = Units()
    source: str = ""
    notes: str = ""
    expected: dict[str, Any] = {}
    grid: Grid | None = None
    elements: Annotated[list[Element], Field(min_length=1)] | None = None
    thickness: Positive | None = None
    interfaces: list[Contact] | None = None
    materials: Materials
    loads: Loads
    labels: Labels = Labels()
    search: Search = Search()

    @model_validator(mode="after")
    def _one_geometry(self) -> Self:
        if (self.grid is None) == (self.elements is None):
            raise ValueError(
                'the geometry is missing or given twice; expected exactly one of "grid" and "elements"'
            )
        if self.grid is not None and self.thickness is not None:
            raise ValueError('"thickness" beside a grid; expected it inside "grid"')
        if self.elements is not None:
            forms = {element.polygon is None for element in self.elements}
            if len(forms) == 2:
                raise ValueError('"elements" mixes planar and spatial ones; expected one dimension')
        return self

    @property
    def dimension(self) -> Literal[2, 3]:
        """2 for a planar scene, 3 for a spatial one."""
        return 3 if self.elements is not None and self.elements[0].polygon is None else 2

    @property
    def fingerprint(self) -> str:
        """Hex digest of everything the numbers depend on (name, source, notes and expected left out)."""
        content = self.model_dump(mode="json", exclude={"name", "source", "notes", "expected"})
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def load_scene(path: str | Path) -> Scene:
    """Read and validate a scene file.

    path: a JSON file. Returns the validated scene, in the file's own units.
    Raises InputError: no such file, not UTF-8, not JSON, or a key that is unknown, missing or wrong.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(str(path), error.strerror or "it cannot be read", "a readable scene file") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "it is not UTF-8 text", "a JSON document in UTF-8") from None
    try:
        document = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_refuse_twins)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise InputError(str(path), f"it is not JSON ({error.msg} at {place})", "one JSON object") from None
    except RecursionError:
        raise InputError(str(path), "it is nested too deeply", "one JSON object") from None
    except InputError as error:
        raise error.within(str(path)) from None
    return parse_scene(document, str(path))


def parse_scene(document: object, file: str = "scene") -> Scene:
    """Validate a scene that is already a Python object.

    document: nested dicts and lists as in the scene file; file: the name used in complaints.
    Raises InputError, one line naming the key or element and what was expected.
    """
    if not isinstance(document, dict):
        raise InputError(file, f"it holds a {type(document).__name__}", "one JSON object")
    try:
        return Scene.model_validate(document)
    except ValidationError as error:
        where, problem = _first_complaint(error)
        wrong, _, right = problem.partition("; expected ")
        raise InputError(
            f"{file}: {where}" if where else file, wrong, right or "a value as docs/scene.md says"
        ) from None


def _refuse_constant(name: str) -> float:
    raise InputError("", f"it holds the number {name}", "finite numbers only")


def _refuse_twins(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(key, "the key stands twice in one object", "each key once")
        found[key] = value
    return found


_EXPECTED = {
    "missing": "this key to be given",
    "extra_forbidden": "no such key",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": "a text",
    "float_type": "a number",
    "int_type": "a whole number",
    "list_type": "a list",
    "dict_type": "an object",
    "model_type": "an object",
}


def _first_complaint(error: ValidationError) -> tuple[str, str]:
    """Key path and "what is wrong; expected what" of the complaint that says most.

    Where a value may have several forms pydantic complains once for each; the deepest path is the form
    the writer had in mind, and the names of the forms are taken out of it.
    """
    complaints = error.errors(include_url=False)
    complaint = max(complaints, key=lambda c: (len(c["loc"]), c["type"] == "extra_forbidden"))
    forms = re.compile(r"[\[\(]|^(float|str|int|bool|list|dict)$")
    keys = [key for key in complaint["loc"] if isinstance(key, int) or not forms.search(key)]
    where = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).lstrip(".")
    kind, message = complaint["type"], complaint["msg"]
    value = complaint.get("input")
    shown = json.dumps(value, default=str)
    shown = shown if len(shown) <= 40 else shown[:37] + "..."
    if kind == "value_error":
        message = message.removeprefix("Value error, ")
        return (
            where,
            message if "; expected" in message else f"{message}; expected a scene as docs/scene.md says",
        )
    if kind == "extra_forbidden":
        return where, "unknown key; expected one that docs/scene.md lists"
    if kind == "missing":
        return where, "missing; expected this key to be given"
    expected = _EXPECTED.get(kind) or re.sub(r"^Input should (be|have) ", "", message)
    return where, f"{shown} is wrong; expected {expected}"
