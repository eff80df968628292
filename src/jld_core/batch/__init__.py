"""Batch solver: a compiled interior-point method that bounds λ of many labellings of one assembly at once.

- `ConflictRequest`: labellings whose conflicts are to be minimised
- `chosen`: return the variant of the batch solver in use
"""

from jld_core.batch.batch_solver import ConflictRequest
from jld_core.batch.library import chosen

__all__ = [
    "ConflictRequest",
    "chosen",
]
