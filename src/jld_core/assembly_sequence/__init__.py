"""How blocks are laid: which way they come, in which order, and what stands while they do.

- `Blocks`: k blocks of a labelling, numbered by their first element
- `SequenceConstraint`: whether labellings of one assembly can be laid, and by which labels not
- `Laying`: how a labelling is laid, block by block
- `Step`: one step of laying
- `blocks_of_labelling`: the blocks of a labelling as bodies → `Blocks`
- `assembly_order`: an order of laying by translations, with the props that its stages need → `Laying` of `Step`s
- `locked_blocks`: elements of blocks that lock one another
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
