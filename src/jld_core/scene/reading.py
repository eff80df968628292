"""The scene file: a JSON document checked key by key, before anything is computed from it."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator
from pydantic_core import ErrorDetails

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

    cell: Annotated[list[Positive], Field(min_length=2, max_length=2, description="[width, height] of a cell")]
    thickness: Positive = 1.0
    rows: Annotated[list[str], Field(min_length=1, description="a list of texts, the top row first")]

    @field_validator("rows")
    @classmethod
    def _rows_are_a_rectangle(cls, rows: list[str]) -> list[str]:
        for index, row in enumerate(rows):
            if len(row) != len(rows[0]):
                raise InputError("", f"row {index} has {len(row)} cells", f"{len(rows[0])} as in row 0")
            if bad := [c for c in row if c not in ".#" and not c.isalpha()]:
                raise InputError("", f"row {index} holds {bad[0]!r}", "letters, '#' or '.'")
        if not any(c.isalpha() for row in rows for c in row):
            raise InputError("", "no free cell", "at least one letter")
        return rows


class Element(_Part):
    """One rigid element: a polygon (planar), or vertices and faces (spatial)."""

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


class Contact(_Part):
    """An interface given by hand, used as it is; material keys override "materials" for this face."""

    elements: Annotated[Pair, Field(description="[id, id] of the two elements")]
    polygon: Annotated[list[Vector], Field(min_length=2, description="two points [x, y], or a spatial polygon")]
    label: LabelName | None = None
    friction_coefficient: NonNegative | None = None
    friction_angle: Annotated[float, Field(ge=0, lt=90)] | None = None
    tensile_strength: NonNegative | None = None
    shear_strength: NonNegative | None = None
    compressive_strength: Positive | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        if self.friction_angle is not None and self.friction_coefficient is not None:
            raise InputError("", "friction is given twice", '"friction_angle" or "friction_coefficient"')
        return self


class Dry(_Part):
    """A joint between blocks: no tension, Mohr–Coulomb friction."""

    friction_angle: Annotated[float, Field(ge=0, lt=90)] | None = None
    friction_coefficient: NonNegative | None = None
    compressive_strength: Positive | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        if (self.friction_angle is None) == (self.friction_coefficient is None):
            how = "friction is missing" if self.friction_angle is None else "friction is given twice"
            raise InputError("", how, 'exactly one of "friction_angle" and "friction_coefficient"')
        return self


class Inner(_Part):
    """A crack plane inside a block: finite tensile and shear strength."""

    tensile_strength: Annotated[NonNegative, Field(description="a stress of at least 0")]
    shear_strength: Annotated[NonNegative, Field(description="a stress of at least 0")]
    compressive_strength: Positive | None = None


class Materials(_Part):
    density: NonNegative | None = None
    gravity: Annotated[float | Vector, Field(description="a number or a vector")] = 9.81
    dry: Dry | None = None
    inner: Inner | None = None


class PointLoad(_Part):
    """A force on one element, at its centroid unless "at" says where, and a moment."""

    element: Annotated[str, Field(description='the id of a free element, or "body" for a load on all')]
    force: Annotated[Vector | None, Field(description="a vector")] = None
    at: Annotated[Vector | None, Field(description="a point")] = None
    moment: Annotated[
        float | Annotated[list[float], Field(min_length=3, max_length=3)],
        Field(description="a number, spatial a vector"),
    ] = 0.0

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.force is None and "moment" not in self.model_fields_set:
            raise InputError("", "it does nothing", '"force" or "moment"')
        if self.at is not None and self.force is None:
            raise InputError(".at", 'it stands without "force"', "a force to apply there")
        return self


class BodyLoad(_Part):
    """Weight, as a positive magnitude, times this vector on every free element."""

    body: Annotated[Vector, Field(description="a vector")]


class Loads(_Part):
    dead: list[PointLoad | BodyLoad] = []
    live: Annotated[list[PointLoad | BodyLoad], Field(description="a list of loads that are multiplied by λ")]

    @field_validator("dead", "live", mode="before")
    @classmethod
    def _tell_the_kinds_apart(cls, entries: Any) -> Any:
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
                found = _first_complaint(error, BodyLoad if body else PointLoad, known)
                where = f"[{index}]" + (f".{found.where}" if found.where else "")
                raise InputError(where, found.problem, found.expected) from None
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
        raise InputError("", f"the least, {low:g}, is above the most, {high:g}", "[least, most]")
    return bounds


Counts = Annotated[list[Annotated[int, Field(ge=0)] | None], Field(min_length=2, max_length=2)]
Sizes = Annotated[list[NonNegative | None], Field(min_length=2, max_length=2)]


class Front(_Part):
    count: Literal["dry_faces", "dry_length", "blocks"] = "dry_faces"
    sense: Literal["max", "min"] = "max"


class Search(_Part):
    """What may be relabelled, and which labellings count."""

    candidates: Annotated[
        Literal["all", "all+supports", "inside-blocks"] | list[Pair],
        Field(description='"all", "all+supports", "inside-blocks" or a list of pairs of ids'),
    ] = "all"
    keep: Keep = Keep()
    segmentation: bool = True
    block_cells: Counts = [None, None]
    block_weight: Sizes = [None, None]
    block_extent: Sizes = [None, None]
    blocks: Counts = [None, None]
    dry_faces: Counts = [None, None]
    symmetry: Literal["auto", "none", "mirror-x"] = "auto"
    front: Front = Front()

    _in_order = field_validator("block_cells", "block_weight", "block_extent", "blocks", "dry_faces")(_ordered)


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
    materials: Annotated[Materials, Field(description='an object with "dry", "inner" or both')]
    loads: Annotated[Loads, Field(description='an object with "live"')]
    labels: Labels = Labels()
    search: Search = Search()

    @model_validator(mode="after")
    def _one_geometry(self) -> Self:
        if (self.grid is None) == (self.elements is None):
            how = "missing" if self.grid is None else "given twice"
            raise InputError("", f"the geometry is {how}", 'exactly one of "grid" and "elements"')
        if self.grid is not None and self.thickness is not None:
            raise InputError(".thickness", "it stands beside a grid", 'the thickness inside "grid"')
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
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(str(path), error.strerror or "it cannot be read", "a readable scene file") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "it is not UTF-8 text", "a JSON document in UTF-8") from None
    try:
        document = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_refuse_twins)
    except json.JSONDecodeError as error:
        what = error.msg.removesuffix(" at").lower()
        problem = (
            f"it is not JSON (line {error.lineno}, column {error.colno}: {what})" if text.strip() else "it is empty"
        )
        raise InputError(str(path), problem, "one JSON object") from None
    except RecursionError:
        raise InputError(str(path), "it is nested too deeply", f"at most {_DEPTH} levels") from None
    except InputError as error:
        raise error.within(str(path)) from None
    except ValueError:  # Python's own limit on the digits of a whole number
        raise InputError(str(path), "it holds a number of thousands of digits", _NUMBERS) from None
    return parse_scene(document, str(path))


def parse_scene(document: object, file: str = "scene") -> Scene:
    """Validate a scene that is already a Python object.

    document: nested dicts and lists as in the scene file; file: the name used in complaints.
    Raises InputError, one line naming the key or element and what was expected.
    """
    if not isinstance(document, dict):
        raise InputError(file, f"it holds {_shown(document)}", "one JSON object")
    try:
        _refuse_extremes(document)
        return Scene.model_validate(document)
    except InputError as error:
        raise error.within(file) from None
    except ValidationError as error:
        raise _first_complaint(error, Scene).within(file) from None


def _refuse_constant(name: str) -> float:
    raise InputError("", f"it holds the number {name}", "finite numbers only")


def _refuse_twins(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(key, "the key stands twice in one object", "each key once")
        found[key] = value
    return found


_DEPTH = 64
_LEAST, _MOST = 1e-30, 1e30
_NUMBERS = f"0 or a magnitude from {_LEAST:g} to {_MOST:g}"


def _refuse_extremes(document: object) -> None:
    """Refuse what is JSON and yet cannot be computed with or written again: depth, size, half characters."""
    pending: list[tuple[str, object, int]] = [("", document, 0)]
    while pending:
        where, value, depth = pending.pop()
        if depth > _DEPTH:
            short = where if len(where) <= 40 else where[:37] + "..."
            raise InputError(short.lstrip("."), "it is nested too deeply", f"at most {_DEPTH} levels")
        if isinstance(value, dict):
            for key in value:
                _refuse_surrogates(where, key)
            pending += [(f"{where}.{_plain(str(key))}", inner, depth + 1) for key, inner in value.items()]
        elif isinstance(value, list):
            pending += [(f"{where}[{index}]", inner, depth + 1) for index, inner in enumerate(value)]
        elif isinstance(value, str):
            _refuse_surrogates(where, value)
        elif isinstance(value, int | float) and value == value and value and not _LEAST <= abs(value) <= _MOST:
            shown = f"{value:g}" if isinstance(value, float) else f"a number of {len(str(abs(value)))} digits"
            raise InputError(where.lstrip("."), f"{shown} is out of range", _NUMBERS)


def _refuse_surrogates(where: str, text: object) -> None:
    if isinstance(text, str) and any("\ud800" <= letter <= "\udfff" for letter in text):
        raise InputError(where.lstrip("."), f"{text!a} holds half a character", "text in UTF-8")


_EXPECTED = {
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": "a text",
    "float_type": "a number",
    "int_type": "a whole number",
    "list_type": "a list",
    "dict_type": "an object",
    "model_type": "an object",
}


def _first_complaint(error: ValidationError, model: type[BaseModel], known: Iterable[str] = ()) -> InputError:
    """The complaint that says most, with its key path.

    model: what was validated; known: more keys that its top level may have.
    Where a value may have several forms pydantic complains once for each; the deepest path is the form
    the writer had in mind, the names of the forms are taken out of it, and where no form fits any better
    than the others all are named.
    """
    complaints = error.errors(include_url=False)

    def weight(complaint: ErrorDetails) -> tuple[int, bool, bool]:
        kind = complaint["type"]
        return len(_keys(complaint)), kind == "extra_forbidden", not _is_of_form(kind)

    chosen = max(complaints, key=weight)
    keys, kind, context = _keys(chosen), chosen["type"], chosen.get("ctx", {})
    where = "".join(f"[{key}]" if isinstance(key, int) else f".{_plain(key)}" for key in keys).lstrip(".")
    if kind == "value_error" and isinstance(cause := context["error"], InputError):
        return InputError((where + cause.where).lstrip("."), cause.problem, cause.expected)
    owner = _owner(model, keys)
    field = owner.model_fields.get(str(keys[-1])) if keys else None
    meaning = field.description if field is not None else None
    if kind == "extra_forbidden":
        names = [*(known if owner is model else ()), *owner.model_fields]
        names = list(dict.fromkeys(names))
        near = get_close_matches(str(keys[-1]), names, 1)
        listed = ", ".join(names)
        return InputError(where, "unknown key", f'"{near[0]}", or another of {listed}' if near else f"one of {listed}")
    if kind == "missing":
        return InputError(where, "missing", meaning or "this key to be given")
    value = chosen.get("input")
    if meaning and _is_of_form(kind):
        return InputError(where, f"{_shown(value)} is wrong", meaning)
    if kind in ("too_short", "too_long", "string_too_short"):
        least = kind != "too_long"
        size = f"at least {context['min_length']}" if least else f"at most {context['max_length']}"
        number = len(value) if isinstance(value, list | str) else 0
        plural, singular = ("letters", "letter") if kind.startswith("string") else ("entries", "entry")
        what = singular if number == 1 else plural
        return InputError(where, f"it has {number} {what}", size + (f": {meaning}" if meaning else ""))
    forms = [c for c in complaints if _keys(c) == keys and _is_of_form(c["type"])] or [chosen]
    expected = " or ".join(dict.fromkeys(_wanted(c) for c in forms))
    return InputError(where, f"{_shown(value)} is wrong", expected)


def _is_of_form(kind: str) -> bool:
    """Whether a complaint says that a value is of another kind altogether."""
    return kind.endswith("_type") or kind == "literal_error"


def _wanted(complaint: ErrorDetails) -> str:
    kind, context = complaint["type"], complaint.get("ctx", {})
    bounds = {
        "greater_than": ("a number above", "gt"),
        "greater_than_equal": ("a number of at least", "ge"),
        "less_than": ("a number below", "lt"),
    }
    if kind in bounds:
        words, bound = bounds[kind]
        return f"{words} {context[bound]:g}"
    if kind == "literal_error":
        return str(context["expected"]).replace("'", '"')
    return _EXPECTED.get(kind) or complaint["msg"]


def _keys(complaint: ErrorDetails) -> list[int | str]:
    """Path of a complaint without the names of forms."""
    forms = re.compile(r"[\[\(]|^(float|str|int|bool|list|dict)$")
    loc = complaint["loc"]
    last = len(loc) - 1 if complaint["type"] == "extra_forbidden" else len(loc)
    # an unknown key may be called anything, like a form too
    return [key for n, key in enumerate(loc) if n == last or isinstance(key, int) or not forms.search(key)]


def _owner(model: type[BaseModel], keys: list[int | str]) -> type[BaseModel]:
    """The model that the last key of a path belongs to."""
    for key in keys[:-1]:
        if isinstance(key, str) and key in model.model_fields:
            model = _model_in(model.model_fields[key].annotation) or model
    return model


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (_model_in(inner) for inner in get_args(annotation))
    return next((inner for inner in found if inner is not None), None)


def _plain(key: str) -> str:
    """A key as it stands if it is a word, else quoted, so that it cannot break the line it is shown on."""
    return key if key.isidentifier() else _shown(key)


def _shown(value: object) -> str:
    text = json.dumps(value, default=str, skipkeys=True)
    return text if len(text) <= 40 else text[:37] + "..."
