"""Shelf of small files as drawing, modelling and building programs write them, each with what is right of it.

Every file is written when it is asked for. `jld import` and a second route (of the library of the format, not of jld)
have to find its size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class File:
    """One file of the shelf.

    name: of the file. program: that writes such files. write: writes it to a path. elements: number of free elements.
    amount: their area or volume, m² or m³. unit: of the file, as the import says. options: of the import. doubtful,
    dropped: words of sentences that have to be there. refused: words of the error in place of all that. whole: area or
    volume with supports, in units of the file, by a second route; None where the file holds what is not to be read.
    """

    name: str
    program: str
    write: Callable[[Path], None]
    elements: int = 0
    amount: float = 0.0
    unit: str = "m"
    options: dict[str, Any] = field(default_factory=dict)
    doubtful: str = ""
    dropped: str = ""
    refused: str = ""
    whole: Callable[[Path], float] | None = None


def shelf() -> list[File]:
    """Return all files."""
    from files import buildings, drawings, meshes, pages

    return [*drawings.files(), *pages.files(), *meshes.files(), *buildings.files()]
