"""Material values with a nominal and a low value, such as `{"nominal": 0.7, "low": 0.5}`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidatorFunctionWrapHandler
from pydantic_core import CoreSchema, core_schema

from jld_core.errors import InputError
from jld_core.scene import uncertain

_KEYS = ("nominal", "low")  # keys of a value with a nominal and a low value


class Spread(float):
    """Nominal value of a material, used as a float, with its low value in the attribute `low`."""

    __slots__ = ("low",)
    low: float

    def __new__(cls, nominal: float, low: float) -> Spread:
        """Make a spread from its nominal and its low value."""
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
        return {"anyOf": [number, both, uncertain.object_schema(number)]}


def _read(value: Any, number: ValidatorFunctionWrapHandler) -> Any:
    """Validate a number, an object {"nominal", "low"}, or an object with uncertainty.

    Raises InputError for other keys, or a low value above the nominal one.
    """
    if isinstance(value, Spread | uncertain.Uncertain):
        return value
    if not isinstance(value, dict):
        return number(value)
    if uncertain.is_uncertain(value):
        return uncertain.read_uncertain(value, number)
    if set(value) != set(_KEYS):
        odd = next((key for key in value if key not in _KEYS), None)
        problem = f'"{odd}" stands there' if odd is not None else "one of two values is missing"
        raise InputError("", problem, 'a number, or "nominal" and "low"')
    nominal, low = number(value["nominal"]), number(value["low"])
    if low > nominal:
        raise InputError("", f"low, {low:g}, is above nominal, {nominal:g}", "a low value of at most the nominal one")
    return Spread(nominal, low)


def _written(value: Any) -> Any:
    """Return a value for JSON: an object for low or uncertain values, else unchanged."""
    return {"nominal": float(value), "low": value.low} if isinstance(value, Spread) else uncertain.written(value)


def lowered(document: Any) -> Any:
    """Replace each object {"nominal", "low"} in a scene document by its low value."""
    if isinstance(document, dict):
        if set(document) == set(_KEYS):
            return document["low"]
        return {key: lowered(value) for key, value in document.items()}
    return [lowered(value) for value in document] if isinstance(document, list) else document
