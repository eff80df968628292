"""Labellings in the lanes of a register: a compiled interior point over many labellings of one assembly.

- `CARRIED`: fate of a labelling whose forces were seen to carry more
- `CARRIES`: answer of a labelling that carries more than was asked
- `FALLS`: answer of a labelling that stands for no λ ≥ 0
- `LOCKED`: answer of a labelling that carries any load
- `OPEN`: answer of a labelling that is left to the usual way
- `PROVEN`: answer of a labelling with both bounds
- `REFUTED`: fate of a labelling that a mechanism proves too weak
- `SOLVED`: state of a choice of blocks of which a bound can be expected
- `BlockAnswers`: of k choices: own (k, own rows of all blocks), shared (k, shared rows): multipliers of the rows; …
- `BlockColumns`: columns of one block
- `BlockLanes`: min −λ over choices of blocks, by the kernel
- `Graph`: blocks of many labellings
- `Joining`: parts joined in the order of keys
- `LaneAnswers`: what is proven of many labellings
- `Lanes`: the kernel for one template
- `Shrinking`: how labellings are shrunk to what makes them too weak
- `Shrunk`: what shrinking k labellings with their neighbours came to, r = k · (1 + neighbours) rows, each …
- `ToShrink`: labellings to be shrunk, whoever is asked: the kernel, the relaxation of one load or that of several cases
- `chosen`: the kernel in use
- `described`: the kernel in use, in words
- `fits`: whether the kernel knows rows of a shape
"""

from jld_core.lanes.blocks import SOLVED, BlockAnswers, BlockColumns, BlockLanes
from jld_core.lanes.kernel import CARRIES, FALLS, LOCKED, OPEN, PROVEN, LaneAnswers, Lanes
from jld_core.lanes.library import chosen, described
from jld_core.lanes.parts import Graph, Joining
from jld_core.lanes.rows import fits
from jld_core.lanes.shrinking import CARRIED, REFUTED, Shrinking, Shrunk, ToShrink

__all__ = [
    "CARRIED",
    "CARRIES",
    "FALLS",
    "LOCKED",
    "OPEN",
    "PROVEN",
    "REFUTED",
    "SOLVED",
    "BlockAnswers",
    "BlockColumns",
    "BlockLanes",
    "Graph",
    "Joining",
    "LaneAnswers",
    "Lanes",
    "Shrinking",
    "Shrunk",
    "ToShrink",
    "chosen",
    "described",
    "fits",
]
