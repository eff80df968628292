"""How a labelling is changed.

- `BufferedRandom`: random choices, drawn in blocks
- `Following`: changes that a mechanism suggests
- `Operators`: what drivers ask of operators
- `Segmentations`: how a segmentation is changed
- `operators`: how labellings of a space are changed
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
