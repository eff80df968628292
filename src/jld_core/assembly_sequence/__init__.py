"""Assembly sequences: removal directions of blocks, order of laying, stability of stages.

- `Laying`: assembly sequence of a labelling, block by block
- `assembly_order`: find an assembly sequence by translations, with the props that its stages need
"""

from __future__ import annotations

from jld_core.assembly_sequence.order import Laying, assembly_order

__all__ = [
    "Laying",
    "assembly_order",
]
