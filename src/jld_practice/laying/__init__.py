"""Assembly sequences: removal directions of blocks, order of laying, stability of stages.

- `Laying`: assembly sequence of a labelling, block by block
- `SequenceConstraint`: assembly sequence as a constraint on labellings
- `assembly_order`: find an assembly sequence by translations, with the props that its stages need
"""

from __future__ import annotations

from jld_practice.laying.constraint import SequenceConstraint
from jld_practice.laying.order import Laying, assembly_order

__all__ = [
    "Laying",
    "SequenceConstraint",
    "assembly_order",
]
