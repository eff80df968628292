"""A file format: boxes as lines of text, and blocks as lines of a list."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jld_core import InputError, Layout
from jld_formats import Format, ImportOptions, Notes, Part, Solids

CORNERS = [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


def read(path: Path, options: ImportOptions, notes: Notes) -> Solids:
    """Read lines `name x y z dx dy dz`; names that begin with # are supports."""
    parts = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        try:
            name, *values = line.split()
            place, size = np.array(values, dtype=float).reshape(2, 3)
        except ValueError:
            raise InputError(f"line {number}", "it is no box", "a line 'name x y z dx dy dz'") from None
        parts.append(Part(name, "boxes", place + size * CORNERS, FACES, support=name.startswith("#")))
    notes.found.append(f"{len(parts)} boxes")
    return Solids(parts, unit="m")


def write(layout: Layout, path: Path, *, cells: bool) -> None:
    """Write one line for each block: name and mass."""
    path.write_text("".join(f"{block.name} {block.mass:.6g}\n" for block in layout.blocks), encoding="utf-8")


BOXES = Format("boxes", ".boxes", read, ("boxes",), write=write, keeps=("elements.id",))
