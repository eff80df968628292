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
- `BlockLanes`: min −λ over choices of blocks, by the batch solver
- `Graph`: blocks of many labellings
- `Joining`: parts joined in the order of keys
- `BatchResults`: what is proven of many labellings
- `BatchSolver`: the batch solver for one template
- `MinimizationOptions`: how labellings are shrunk to what makes them too weak
- `MinimizationResults`: what shrinking k labellings with their neighbours came to, r = k · (1 + neighbours) rows, each
  …
- `ConflictRequest`: labellings to be shrunk, whoever is asked: the batch solver, the relaxation of one load or that of
  several cases
- `chosen`: the batch solver in use
- `described`: the batch solver in use, in words
- `fits`: whether the batch solver knows rows of a shape
"""

from jld_core.batch.batch_solver import CARRIES, FALLS, LOCKED, OPEN, PROVEN, BatchResults, BatchSolver
from jld_core.batch.blocks import SOLVED, BlockAnswers, BlockColumns, BlockLanes
from jld_core.batch.conflict_request import CARRIED, REFUTED, ConflictRequest, MinimizationOptions, MinimizationResults
from jld_core.batch.library import chosen, described
from jld_core.batch.parts import Graph, Joining
from jld_core.batch.rows import fits

__all__ = [
    "CARRIED",
    "CARRIES",
    "FALLS",
    "LOCKED",
    "OPEN",
    "PROVEN",
    "REFUTED",
    "SOLVED",
    "BatchResults",
    "BatchSolver",
    "BlockAnswers",
    "BlockColumns",
    "BlockLanes",
    "ConflictRequest",
    "Graph",
    "Joining",
    "MinimizationOptions",
    "MinimizationResults",
    "chosen",
    "described",
    "fits",
]
