"""Assembly sequences: removal directions of blocks, order of laying, stability of stages.

- `Freedom`: tests in which directions the blocks of one labelling can be translated away
- `Laying`: assembly sequence of a labelling, block by block
- `Parts`: store of solved parts of stages, shared by all labellings of one assembly
- `SequenceConstraint`: assembly sequence as a constraint on labellings
- `assembly_order`: find an assembly sequence by translations, with the props that its stages need
- `blocks_of_labelling`: return the blocks of labels (m,) as rigid bodies, with the contacts between them
- `locked_blocks`: return the elements of blocks that prevent any order by translations, ascending
- `order_without_stages`: find an order whose stages are not solved, or None where blocks lock one another
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_practice.laying.constraint import SequenceConstraint
    from jld_practice.laying.freedom import Freedom, blocks_of_labelling
    from jld_practice.laying.order import Laying, assembly_order, locked_blocks, order_without_stages
    from jld_practice.laying.standing import Parts

__all__ = [
    "Freedom",
    "Laying",
    "Parts",
    "SequenceConstraint",
    "assembly_order",
    "blocks_of_labelling",
    "locked_blocks",
    "order_without_stages",
]

export_lazily(
    __name__,
    {
        "constraint": ["SequenceConstraint"],
        "freedom": ["Freedom", "blocks_of_labelling"],
        "order": ["Laying", "assembly_order", "locked_blocks", "order_without_stages"],
        "standing": ["Parts"],
    },
)
