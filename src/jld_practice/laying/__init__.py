"""Assembly sequences: removal directions of blocks, order of laying, stability of stages."""

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
