"""Data of a block in files of other programs: mass, mould, order of laying, λ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core.assembly_sequence import assembly_order
from jld_core.errors import InputError
from jld_core.exchange.layout import Layout

# Largest number of blocks whose order of laying is computed for a file, by dimension; it takes seconds for more
_MOST: Final = {2: 150, 3: 40}


@dataclass(frozen=True)
class BlockFacts:
    """Facts of one block for a file of another program.

    block, elements: ids. mass: scene units, kg with m and N. volume: scene units. shape: number of its mould, 0 for
    supports. order: number of the step in which it is laid, from 1; None for supports, and where none is computed.
    load_factor: λ of the layout; None without a collapse. dry, inner: neighbours across dry faces, and number of inner
    faces within it.
    """

    block: str
    elements: tuple[str, ...]
    support: bool
    mass: float
    volume: float
    shape: int
    order: int | None
    load_factor: float | None
    dry: tuple[str, ...]
    inner: int

    def entries(self) -> dict[str, Any]:
        """Return the facts by name, as texts and numbers, without those that are unknown."""
        found = {
            "block": self.block,
            "elements": " ".join(self.elements),
            "support": self.support,
            "mass": self.mass,
            "volume": self.volume,
            "mould": self.shape or None,
            "order": self.order,
            "load_factor": self.load_factor,
            "dry_faces_to": " ".join(self.dry),
            "inner_faces": self.inner,
        }
        return {key: value for key, value in found.items() if value is not None}


def block_facts(layout: Layout) -> list[BlockFacts]:
    """Return the facts of each block of a layout, in the order of `Layout.blocks`."""
    assembly, labels = layout.assembly, layout.labels
    ids, faces = assembly.elements.ids, assembly.interfaces
    order = _order(layout)
    factor = None if layout.result is None else layout.result.load_factor
    a, b = layout.block_of[faces.a], layout.block_of[faces.b]
    found = []
    for k, block in enumerate(layout.blocks):
        beside = {int(other) for other in np.concatenate([b[labels & (a == k)], a[labels & (b == k)]])} - {k}
        found.append(
            BlockFacts(
                block=block.name,
                elements=tuple(ids[e] for e in block.elements),
                support=block.support,
                mass=float(f"{block.mass:.12g}"),
                volume=float(f"{block.volume:.12g}"),
                shape=block.shape,
                order=order.get(k),
                load_factor=None if factor is None or not np.isfinite(factor) else float(factor),
                dry=tuple(layout.blocks[other].name for other in sorted(beside)),
                inner=int((~labels & (a == k) & (b == k)).sum()),
            )
        )
    return found


def _order(layout: Layout) -> dict[int, int]:
    """Return the step, from 1, in which each block is laid, by the block's index.

    The index is that in `Layout.blocks`. Empty where no order of single blocks is found, for layouts that an assembly
    sequence does not model, and for those with too many blocks.
    """
    if sum(1 for block in layout.blocks if block.cells) > _MOST[layout.assembly.dimension]:
        return {}
    sideways = layout.scene.search.assemble_out_of_plane
    try:
        # groups of blocks that move together take minutes to find in space: jld assembly looks for them
        laying = assembly_order(layout.assembly, layout.labels, sideways=sideways, group=1)
    except InputError:  # of what an assembly sequence does not model, as members and bond
        return {}
    return {
        int(layout.block_of[int(laying.blocks.elements(block)[0])]): number
        for number, step in enumerate(laying.steps, 1)
        for block in step.blocks
    }
