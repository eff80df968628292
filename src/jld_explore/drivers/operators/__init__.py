"""Operators that draw, change and cross labellings.

- `BufferedRandom`: random choices from numbers that are generated in batches
- `Following`: operator that changes labellings where their mechanism moves
- `Operators`: interface of the operators on labellings
- `Segmentations`: operators on the segmentations of a space
- `operators`: make the operators on the labellings of a space
"""

from __future__ import annotations

from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.following import Following
from jld_explore.drivers.operators.segmentations import Operators, Segmentations, operators

__all__ = [
    "BufferedRandom",
    "Following",
    "Operators",
    "Segmentations",
    "operators",
]
