"""Batch solver: a compiled interior-point method that bounds λ of many labellings of one assembly at once.

- `CARRIED`: fate of a labelling whose forces carry more than its threshold
- `CARRIES`: verdict for a labelling whose λ exceeds its threshold
- `FALLS`: verdict for a labelling for which no λ ≥ 0 is admissible
- `LOCKED`: verdict for a labelling that carries any live load
- `OPEN`: verdict for a labelling that the batch solver could not settle
- `PROVEN`: verdict for a labelling with both bounds and a narrow bracket
- `REFUTED`: fate of a labelling that a mechanism refutes at its threshold
- `SOLVED`: state of a choice of blocks whose multipliers are ready to give a bound
- `BatchResults`: proven bounds on λ of many labellings
- `BatchSolver`: batch solver for the labellings of one template
- `BlockAnswers`: multipliers, shares and λ of k choices of allowed blocks
- `BlockColumns`: rows and columns of one block in the relaxation by blocks
- `BlockLanes`: batch solver for the relaxation by blocks
- `ConflictRequest`: labellings whose conflicts are to be minimised
- `Graph`: graph of elements and interfaces that finds the blocks of many labellings
- `Joining`: graph of atoms that are joined into parts in a given order
- `MinimizationOptions`: options of conflict minimisation
- `MinimizationResults`: minimised conflicts of k labellings and their neighbours
- `chosen`: return the variant of the batch solver in use
- `described`: describe the batch solver in use in words
- `fits`: test whether the batch solver takes a template
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
