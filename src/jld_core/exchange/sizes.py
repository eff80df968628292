"""Sizes of a drawing that can hardly be meant, and the unit that probably is."""

from __future__ import annotations

from collections.abc import Sequence
from math import log
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.exchange.options import Notes
from jld_core.geometry import polygons
from jld_core.scene.units import METRES

# Least and largest extent of a structure that passes without a word, m: models on a table to long bridges
_WHOLE: Final = (0.05, 300.0)

_BLOCK: Final = 3.0  # largest usual block, m, in a structure larger than `_LONG`

_LONG: Final = 20.0  # extent of a structure, m, up to which blocks may be outlines that are still to be cut

_USUAL: Final = (3.0, 0.35)  # usual extent of a structure and of a block, m, by which the likely unit is chosen

_COMMON: Final = ("mm", "cm", "m", "in", "ft")  # units that are proposed


def hardly_meant(size: float) -> bool:
    """Return True if a largest extent, m, is that of no structure."""
    return not _WHOLE[0] <= size <= _WHOLE[1]


def say_size(size: float, outlines: Sequence[Floats], unit: str, drawn_in: str, notes: Notes) -> None:
    """Note a size of a structure or of its blocks that can hardly be meant, and a likely unit.

    size: largest extent, scene units. outlines: (k, 2) corners of each free element. unit: unit of the scene. drawn_in:
    unit of the file, of which size and outlines were converted.
    """
    if unit != "m" or not outlines:
        return
    block = float(np.median([abs(polygons.area(outline[None])[0]) ** 0.5 for outline in outlines]))
    if not hardly_meant(size) and (block <= _BLOCK or size <= _LONG):
        return
    per_unit = 1.0 / METRES[drawn_in]

    def strangeness(name: str) -> float:
        """Return the sum of |log(size / usual size)| of structure and block, in unit `name`."""
        factor = METRES[name] * per_unit
        return abs(log(size * factor / _USUAL[0])) + abs(log(block * factor / _USUAL[1]))

    likely = min(_COMMON, key=strangeness)
    factor = METRES[likely] * per_unit
    what = f"the structure is {size:.3g} m large, its median element {block:.3g} m, with lengths in {drawn_in}"
    if likely == drawn_in:
        notes.doubtful.append(what)
        return
    notes.doubtful.append(
        f"{what}: in {likely} it is {size * factor:.3g} m and {block * factor:.3g} m, --unit {likely}"
    )
