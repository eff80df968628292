"""Content of a drawing: paths and marks on layers, and the resulting cells."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from jld_core.arrays import Floats
from jld_core.exchange.paths import Path

MOST: Final = 200_000
"""Largest number of corners, lines or cells of a drawing; more indicate a wrong or malicious file."""


@dataclass(frozen=True)
class Mark:
    """Point or text on a layer.

    at: place. end: end of an arrow, for a line on a load layer.
    """

    at: tuple[float, float]
    layer: str
    text: str | None = None
    end: tuple[float, float] | None = None


@dataclass(frozen=True)
class Drawing:
    """Content of a planar file.

    unit: unit of length, None if unknown. facts: keys of a scene stored in the file.
    """

    paths: list[Path]
    marks: list[Mark]
    unit: str | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    name: str = "drawing"


@dataclass
class Cell:
    """Future element: outline, layer, name, and index of the outline from which it was cut."""

    points: Floats
    layer: str
    name: str | None
    owner: int | None = None
    support: bool = False
    block: str | None = None
