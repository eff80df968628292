"""Assembly sequences: removal directions of blocks, order of laying, stability of stages.

- `Blocks`: k blocks of a labelling, numbered by their first element
- `Laying`: assembly sequence of a labelling, block by block
- `SequenceConstraint`: test whether labellings can be assembled, with the labels that prevent it
- `Step`: one step of an assembly sequence
- `assembly_order`: find an assembly sequence by translations, with the props that its stages need
- `blocks_of_labelling`: return the blocks of a labelling as rigid bodies
- `locked_blocks`: return the elements of blocks that lock one another
"""

from __future__ import annotations

from jld_core.assembly_sequence.blocks import Blocks, blocks_of_labelling
from jld_core.assembly_sequence.constraint import SequenceConstraint
from jld_core.assembly_sequence.order import Laying, Step, assembly_order, locked_blocks

__all__ = [
    "Blocks",
    "Laying",
    "SequenceConstraint",
    "Step",
    "assembly_order",
    "blocks_of_labelling",
    "locked_blocks",
]
