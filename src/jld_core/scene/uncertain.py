"""Values of a scene that are no plain numbers: with a distribution, or with a nominal and a low value."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from pydantic import BaseModel, GetCoreSchemaHandler, GetJsonSchemaHandler, ValidatorFunctionWrapHandler
from pydantic_core import CoreSchema, core_schema

from jld_core.errors import InputError
from jld_core.scene.complaints import shown

KINDS: Final = ("normal", "lognormal")
KEYS: Final = ("mean", "cov", "kind")
EACH: Final = "each"  # optional key: true where each face or element has an independent value of its own
_FORM: Final = '"mean", "cov" and "kind"'


class Uncertain(float):
    """Mean of an uncertain value, used as a float, with its distribution in the attributes.

    cov: standard deviation over |mean|. each: True where each face or element has an independent value.
    """

    __slots__ = ("cov", "each", "kind")
    cov: float
    kind: str
    each: bool

    def __new__(cls, mean: float, cov: float, kind: str, each: bool = False) -> Uncertain:
        self = super().__new__(cls, mean)
        self.cov, self.kind, self.each = cov, kind, each
        return self

    def __getnewargs__(self) -> tuple[float, float, str, bool]:  # type: ignore[override]
        return float(self), self.cov, self.kind, self.each


class UncertainVector(list[float]):
    """Mean of a load of certain direction and uncertain size, used as a list of numbers.

    size: 1 with the distribution by which the vector is multiplied.
    """

    def __init__(self, mean: list[float], size: Uncertain) -> None:
        super().__init__(mean)
        self.size = size

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (list(self), self.size)


def is_uncertain(value: Any) -> bool:
    """Return True for an object that has a key of a value with uncertainty."""
    return isinstance(value, dict) and not value.keys().isdisjoint(KEYS)


def read_uncertain(value: dict[str, Any], number: ValidatorFunctionWrapHandler, *, each: bool = True) -> Uncertain:
    """Validate an object {"mean", "cov", "kind"}; its mean must not be zero."""
    cov, kind, for_each = _distribution(value, each=each)
    mean = number(value["mean"])
    if mean == 0.0:
        problem = f"a {kind} value of mean 0 has no coefficient of variation"
        raise InputError(".mean", problem, "a mean other than 0, or a number alone")
    return Uncertain(mean, cov, kind, for_each)


def _distribution(value: dict[str, Any], *, each: bool) -> tuple[float, str, bool]:
    """Return coefficient of variation, kind and "each" of an object."""
    form = f"a number, or {_FORM}"
    unknown = next((key for key in value if key not in (*KEYS, *([EACH] if each else []))), None)
    if unknown is not None:
        raise InputError(f".{unknown}", "unknown key of a value with uncertainty", form)
    missing = next((key for key in KEYS if key not in value), None)
    if missing is not None:
        raise InputError("", f'"{missing}" of its distribution is missing', form)
    cov, kind, for_each = value["cov"], value["kind"], value.get(EACH, False)
    if isinstance(cov, bool) or not isinstance(cov, int | float) or not math.isfinite(cov) or cov < 0.0:
        raise InputError(".cov", f"{shown(cov)} is wrong", "a coefficient of variation of at least 0")
    if kind not in KINDS:
        raise InputError(".kind", f"{shown(kind)} is wrong", " or ".join(f'"{name}"' for name in KINDS))
    if not isinstance(for_each, bool):
        raise InputError(f".{EACH}", f"{shown(for_each)} is wrong", "true or false")
    return float(cov), str(kind), for_each


def written(value: Any) -> Any:
    """Return a value for JSON: an object for one with uncertainty, else unchanged."""
    if isinstance(value, Uncertain):
        each = {EACH: True} if value.each else {}
        return {"mean": float(value), "cov": value.cov, "kind": value.kind, **each}
    return value


def object_schema(mean: dict[str, Any], *, each: bool = True) -> dict[str, Any]:
    """Return the JSON schema of a value with uncertainty."""
    keys: dict[str, Any] = {"mean": mean, "cov": {"type": "number", "minimum": 0}, "kind": {"enum": list(KINDS)}}
    return {
        "type": "object",
        "properties": keys | ({EACH: {"type": "boolean"}} if each else {}),
        "required": list(KEYS),
        "additionalProperties": False,
    }


@dataclass(frozen=True)
class MayVary:
    """Annotation of a pydantic field whose number may have uncertainty; each: for every face or element."""

    each: bool = True

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        serializer = core_schema.plain_serializer_function_ser_schema(written)
        return core_schema.no_info_wrap_validator_function(self._read, handler(source), serialization=serializer)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        number = handler(schema["schema"])
        return {"anyOf": [number, object_schema(number, each=self.each)]}

    def _read(self, value: Any, number: ValidatorFunctionWrapHandler) -> Any:
        """Validate a number, or an object that becomes an `Uncertain`."""
        if isinstance(value, Uncertain):
            return value
        return read_uncertain(value, number, each=self.each) if is_uncertain(value) else number(value)


@dataclass(frozen=True)
class MayVaryInSize:
    """Annotation of a pydantic field whose vector may have an uncertain size."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        serializer = core_schema.plain_serializer_function_ser_schema(_written_vector)
        return core_schema.no_info_wrap_validator_function(_read_vector, handler(source), serialization=serializer)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        vector = handler(schema["schema"])
        mean = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 3}
        return {"anyOf": [vector, object_schema(mean, each=False)]}


def _read_vector(value: Any, vector: ValidatorFunctionWrapHandler) -> Any:
    """Validate a vector, or an object with a mean vector, as an `UncertainVector`."""
    if isinstance(value, UncertainVector) or not is_uncertain(value):
        return value if isinstance(value, UncertainVector) else vector(value)
    cov, kind, _ = _distribution(value, each=False)
    mean = vector(value["mean"])
    if any(isinstance(component, Uncertain) for component in mean):
        raise InputError(".mean", "its components have distributions too", "one distribution, of size or components")
    if not any(mean):
        problem = f"a {kind} value of mean 0 has no coefficient of variation"
        raise InputError(".mean", problem, "a mean other than 0, or a vector alone")
    return UncertainVector(mean, Uncertain(1.0, cov, kind))


def _written_vector(value: Any) -> Any:
    """Return a vector for JSON, as it stood in the scene."""
    if isinstance(value, UncertainVector):
        return {"mean": list(value), "cov": value.size.cov, "kind": value.size.kind}
    return None if value is None else [written(component) for component in value]


Path = tuple[str | int, ...]  # keys and positions that lead to a value of a scene


def uncertain_values(part: Any) -> Iterator[tuple[Path, Uncertain | UncertainVector]]:
    """Yield path and value of every value of a scene with uncertainty, in its order."""
    for path, value in stated_values(part):
        if (value if isinstance(value, Uncertain) else value.size).cov > 0.0:
            yield path, value


def stated_values(part: Any, path: Path = ()) -> Iterator[tuple[Path, Uncertain | UncertainVector]]:
    """Yield what `uncertain_values` yields, and values whose distribution has no width."""
    if isinstance(part, Uncertain | UncertainVector):
        yield path, part
    elif isinstance(part, BaseModel):
        for name, field in type(part).model_fields.items():
            yield from stated_values(getattr(part, name), (*path, field.alias or name))
    elif isinstance(part, list):
        for position, entry in enumerate(part):
            if isinstance(entry, BaseModel | Uncertain):  # lists of lists hold coordinates: most of a large scene
                yield from stated_values(entry, (*path, position))


def in_words(path: Path) -> str:
    """Return the path of a value as messages write it: `loads.live[0].force[1]`."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path).lstrip(".")


def with_means(document: Any) -> Any:
    """Replace each value with uncertainty in a scene document by its mean."""
    if isinstance(document, dict):
        if document.keys() >= set(KEYS) and document.keys() <= {*KEYS, EACH}:
            return document["mean"]
        return {key: with_means(value) for key, value in document.items()}
    if isinstance(document, list) and any(isinstance(entry, dict | list) for entry in document):
        return [with_means(value) for value in document]
    return document


_KEYS = ("nominal", "low")  # keys of a value with a nominal and a low value


class Spread(float):
    """Nominal value of a material, used as a float, with its low value in the attribute `low`."""

    __slots__ = ("low",)
    low: float

    def __new__(cls, nominal: float, low: float) -> Spread:
        self = super().__new__(cls, nominal)
        self.low = low
        return self

    def __getnewargs__(self) -> tuple[float, float]:  # type: ignore[override]
        return float(self), self.low


@dataclass(frozen=True)
class MaySpread:
    """Annotation of a field whose number may have a nominal and a low value, or uncertainty."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        written = core_schema.plain_serializer_function_ser_schema(_written)
        return core_schema.no_info_wrap_validator_function(_read, handler(source), serialization=written)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        number = handler(schema["schema"])
        both = {
            "type": "object",
            "properties": dict.fromkeys(_KEYS, number),
            "required": list(_KEYS),
            "additionalProperties": False,
        }
        return {"anyOf": [number, both, object_schema(number)]}


def _read(value: Any, number: ValidatorFunctionWrapHandler) -> Any:
    """Validate a number, an object {"nominal", "low"}, or an object with uncertainty."""
    if isinstance(value, Spread | Uncertain):
        return value
    if not isinstance(value, dict):
        return number(value)
    if is_uncertain(value):
        return read_uncertain(value, number)
    if set(value) != set(_KEYS):
        unknown = next((key for key in value if key not in _KEYS), None)
        problem = f'"{unknown}" stands there' if unknown is not None else "one of two values is missing"
        raise InputError("", problem, 'a number, or "nominal" and "low"')
    nominal, low = number(value["nominal"]), number(value["low"])
    if low > nominal:
        raise InputError("", f"low, {low:g}, is above nominal, {nominal:g}", "a low value of at most the nominal one")
    return Spread(nominal, low)


def _written(value: Any) -> Any:
    """Return a value for JSON: an object for low or uncertain values, else unchanged."""
    return {"nominal": float(value), "low": value.low} if isinstance(value, Spread) else written(value)


def lowered(document: Any) -> Any:
    """Replace each object {"nominal", "low"} in a scene document by its low value."""
    if isinstance(document, dict):
        if set(document) == set(_KEYS):
            return document["low"]
        return {key: lowered(value) for key, value in document.items()}
    return [lowered(value) for value in document] if isinstance(document, list) else document
