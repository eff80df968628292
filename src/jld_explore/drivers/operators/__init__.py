"""How a labelling is changed."""

from __future__ import annotations

from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.segmentations import Operators, Segmentations, operators

__all__ = [
    "BufferedRandom",
    "Operators",
    "Segmentations",
    "operators",
]
