"""Labellings in the lanes of a register: a compiled interior point over many labellings of one assembly.

- `CARRIES`: answer of a labelling that carries more than was asked
- `FALLS`: answer of a labelling that stands for no λ ≥ 0
- `LOCKED`: answer of a labelling that carries any load
- `OPEN`: answer of a labelling that is left to the usual way
- `PROVEN`: answer of a labelling with both bounds
- `Graph`: blocks of many labellings
- `Joining`: parts joined in the order of keys
- `LaneAnswers`: what is proven of many labellings
- `Lanes`: the kernel for one template
- `chosen`: the kernel in use
- `described`: the kernel in use, in words
- `fits`: whether the kernel knows rows of a shape
"""

from jld_core.lanes.kernel import CARRIES, FALLS, LOCKED, OPEN, PROVEN, LaneAnswers, Lanes
from jld_core.lanes.library import chosen, described
from jld_core.lanes.parts import Graph, Joining
from jld_core.lanes.rows import fits

__all__ = [
    "CARRIES",
    "FALLS",
    "LOCKED",
    "OPEN",
    "PROVEN",
    "Graph",
    "Joining",
    "LaneAnswers",
    "Lanes",
    "chosen",
    "described",
    "fits",
]
