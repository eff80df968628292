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
    """Point, text or arrow on a layer of a drawing.

    at: its place, drawing units. text: None for a bare point. end: end of an arrow, for a line on a load layer.
    """

    at: tuple[float, float]
    layer: str
    text: str | None = None
    end: tuple[float, float] | None = None

    def scaled(self, factor: float) -> Mark:
        """Return the mark with all coordinates multiplied by a factor."""
        end = None if self.end is None else (self.end[0] * factor, self.end[1] * factor)
        return Mark((self.at[0] * factor, self.at[1] * factor), self.layer, self.text, end)


@dataclass(frozen=True)
class SolidMark:
    """Point, text or arrow on a layer of a spatial file.

    at: (3,) its place, the tip of an arrow, file units. text: None for a bare point. tail: (3,) start of an arrow.
    """

    at: Floats
    layer: str
    text: str | None = None
    tail: Floats | None = None

    def scaled(self, factor: float) -> SolidMark:
        """Return the mark with all coordinates multiplied by a factor."""
        return SolidMark(factor * self.at, self.layer, self.text, None if self.tail is None else factor * self.tail)


@dataclass(frozen=True)
class Drawing:
    """Content of a planar file before it is converted to elements.

    paths: outlines and lines in the file's unit. marks: points and texts. unit: unit of length, such as "mm"; None if
    unknown. facts: keys of a scene that an earlier export stored in the file. name: name of the scene.
    """

    paths: list[Path]
    marks: list[Mark]
    unit: str | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    name: str = "drawing"


@dataclass
class Cell:
    """Future planar element, before it is written to a scene document.

    points: (k, 2) corners, scene units. name: id in the scene, None where not yet known. joined: cell with which it is
    one block, as parts of one stone around an opening; None where it is a block by itself.
    """

    points: Floats
    layer: str
    name: str | None
    support: bool = False
    joined: Cell | None = None
