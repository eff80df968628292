"""Crack models of a scene: along the faces of the grid, in finer cells, or by fields."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final, Literal

from pydantic import Field, ValidationError

from jld_core.errors import InputError, ParameterError
from jld_core.parameters import typed
from jld_core.scene.complaints import first_complaint, shown
from jld_core.scene.part import Part, Positive

FORMS: Final = '"faces", {"kind": "cells", "cell": SIZE} or {"kind": "fields", "gap": GAP}'
"""Values of the key "cracks", for error messages."""

_OPTIONS: Final = "faces, cells:SIZE or fields[:GAP]"


class CellCracks(Part):
    """Cracks along the faces of finer rigid cells (a length) inside the elements."""

    kind: Literal["cells"]
    cell: Annotated[Positive, Field(description="a length above 0")]


class FieldCracks(Part):
    """Cracks anywhere, by fields in triangles (docs/method.md, section 9), refined until the bracket is `gap` wide."""

    kind: Literal["fields"]
    gap: Annotated[Positive, Field(description="a number above 0")] = 0.05


CrackModel = Literal["faces"] | CellCracks | FieldCracks  # how blocks crack


def cracks_by_kind(value: Any) -> Any:
    """Validate the value of the key "cracks" by its kind, for error messages about the kind meant."""
    if value == "faces" or isinstance(value, CellCracks | FieldCracks):
        return value
    kind = value.get("kind") if isinstance(value, dict) else None
    models: dict[Any, type[Part]] = {"cells": CellCracks, "fields": FieldCracks}
    if not isinstance(kind, str) or kind not in models:
        raise InputError("", f"{shown(value)} is wrong", FORMS)
    try:
        return models[kind].model_validate(value)
    except ValidationError as error:
        first = first_complaint(error, models[kind])
        raise InputError(f".{first.where}" if first.where else "", first.problem, first.expected) from None


def cracks_of(value: Any) -> CrackModel:
    """Return the crack model that a text, a value of the key "cracks" or a crack model names."""
    if isinstance(value, str):
        return parse_cracks(value)
    try:
        model: CrackModel = cracks_by_kind(value)
    except InputError as error:
        raise ParameterError("cracks", error.problem, error.expected) from None
    return model


@typed
def parse_cracks(text: str) -> CrackModel:
    """Return the crack model of "faces", "cells:SIZE" or "fields:GAP"; InputError for another text."""
    kind, colon, number = text.partition(":")
    if kind == "faces" and not colon:
        return "faces"
    if kind == "fields" and not colon:
        return FieldCracks(kind="fields")
    if kind not in ("cells", "fields"):
        raise ParameterError("cracks", f"{text!r} names no crack model", _OPTIONS)
    try:
        value = float(number)
    except ValueError:
        raise ParameterError("cracks", f"{text!r} has no number after its colon", _OPTIONS) from None
    if not 0.0 < value < math.inf:
        raise ParameterError("cracks", f"{number} is wrong", f"a {'length' if kind == 'cells' else 'number'} above 0")
    return CellCracks(kind="cells", cell=value) if kind == "cells" else FieldCracks(kind="fields", gap=value)


def cracks_in_words(cracks: CrackModel) -> str:
    if isinstance(cracks, CellCracks):
        return f"by cells of {cracks.cell:g} inside the elements"
    if isinstance(cracks, FieldCracks):
        return f"by fields, anywhere in the blocks, to a gap of {cracks.gap:g}"
    return "by faces of the grid alone"


def cracks_in_short(cracks: CrackModel) -> str:
    """Return "by faces", "by cells of SIZE" or "by fields", for the repr of results."""
    if isinstance(cracks, CellCracks):
        return f"by cells of {cracks.cell:g}"
    return "by fields" if isinstance(cracks, FieldCracks) else "by faces"


def cracks_to_json(cracks: CrackModel) -> Any:
    return cracks if isinstance(cracks, str) else cracks.model_dump(mode="json")
