"""What is counted of a labelling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly
from jld_explore.space.labelling import Connectivity, connectivity
from jld_explore.space.limits import _CHUNK, _cells


@dataclass(frozen=True)
class Counts:
    """Per labelling, (k,) each; faces between two free elements and blocks with a free element only.

    dry_faces: number of dry faces. dry_length: their length, in spatial scenes their area. blocks: number of
    blocks. largest_block_cells: free elements in the largest block.
    """

    dry_faces: Ints
    dry_length: Floats
    blocks: Ints
    largest_block_cells: Ints


def counts(assembly: Assembly, labellings: Bits, graph: Connectivity | None = None) -> Counts:
    """Counts of labellings (k, m), scene units; graph: the assembly's, made where it is not given."""
    free = assembly.free_faces
    measure = assembly.interfaces.l1 if assembly.dimension == 2 else assembly.interfaces.area
    graph = graph or connectivity(assembly)
    parts = [labellings[low : low + _CHUNK] for low in range(0, max(1, len(labellings)), _CHUNK)]
    cells = [_cells(assembly, graph, part) for part in parts]
    return Counts(
        dry_faces=labellings[:, free].sum(axis=1, dtype=np.int64),
        # summed row by row in one order, so that a labelling has one length whatever batch it came in
        dry_length=np.concatenate([np.where(part[:, free], measure[free], 0.0).sum(axis=1) for part in parts]),
        blocks=np.concatenate([(part > 0).sum(axis=0, dtype=np.int64) for part in cells]),
        largest_block_cells=np.concatenate([part.max(axis=0, initial=0) for part in cells]),
    )
