"""What is drawn: paths and marks on layers, and the cells that they make."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from jld_core.arrays import Floats
from jld_core.exchange.paths import Path

MOST: Final = 200_000
"""Corners, lines or cells that a drawing may have: past that it is no structure, or no honest file."""


@dataclass(frozen=True)
class Mark:
    """A point or a text on a layer; end: where an arrow ends, for a line on a load layer."""

    at: tuple[float, float]
    layer: str
    text: str | None = None
    end: tuple[float, float] | None = None


@dataclass(frozen=True)
class Drawing:
    """What a file holds. unit: of its lengths, None where it does not say. facts: keys of a scene it carries along."""

    paths: list[Path]
    marks: list[Mark]
    unit: str | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    name: str = "drawing"


@dataclass
class Cell:
    """An element to be: its outline, layer, name, and the outline it was cut from."""

    points: Floats
    layer: str
    name: str | None
    owner: int | None = None
    support: bool = False
    block: str | None = None
