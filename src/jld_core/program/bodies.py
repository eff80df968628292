"""Blocks of a labelling as a hint for solvers: which equations of equilibrium add up to those of one block."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bits, Ints
from jld_core.assembly import Assembly, blocks_of
from jld_core.geometry import moment_about
from jld_core.mechanics import Scaling


@dataclass(frozen=True)
class Bodies:
    """Blocks that a labelling makes of an assembly; computed where a solver asks for them.

    assembly: elements and interfaces. labels: (m,) True = dry.
    """

    assembly: Assembly
    scaling: Scaling
    labels: Bits

    @cached_property
    def root(self) -> Ints:
        """Return the representative element (free,) of the block of each free element.

        Entries are indices among the free elements. The representative is the element nearest to the middle of the
        block. Elements of blocks that contain a support represent themselves.
        """
        elements = self.assembly.elements
        block = blocks_of(self.assembly, self.labels)
        held = np.zeros(int(block.max(initial=-1)) + 1, dtype=bool)
        held[block[elements.support]] = True
        free = elements.free
        block, centroid = block[free], elements.centroid[free]
        size = np.maximum(np.bincount(block, minlength=len(held)), 1)
        middle = np.column_stack([np.bincount(block, way, len(held)) / size for way in centroid.T])
        # Rounding lets the choice between elements at the same distance depend neither on units nor on position.
        distance = np.round(np.linalg.norm(centroid - middle[block], axis=1) / self.assembly.size, 6)
        order = np.lexsort((distance, block))
        first = np.full(len(held), -1)
        names, start = np.unique(block[order], return_index=True)
        first[names] = order[start]
        return np.asarray(np.where(held[block], np.arange(len(free)), first[block]), dtype=np.int64)

    def sums(self, equations: int) -> sp.csr_array | None:
        """Return the matrix T that replaces the equations of each root by those of its block.

        A block's equations are sums over its elements, with moments about the centroid of the root.

        equations: number of equations; those beyond equilibrium stay as they are. Returns (equations, equations): T,
        which has an inverse; None where every free block is one element.

        Source: docs/method.md (8.6).
        """
        root = self.root
        member = np.flatnonzero(root != np.arange(len(root)))
        if not len(member):
            return None
        assembly = self.assembly
        d, q = assembly.dimension, assembly.freedoms
        centroid = assembly.elements.centroid[assembly.elements.free]
        scale = self.scaling.row.reshape(-1, q)
        head = root[member]
        arm = centroid[member] - centroid[head]
        block = np.tile(np.eye(q), (len(member), 1, 1))
        for j in range(d):
            block[:, d:, j] = moment_about(arm, np.broadcast_to(np.eye(d)[j], arm.shape))
        block *= scale[member][:, None, :] / scale[head][:, :, None]
        rows = q * head[:, None, None] + np.arange(q)[:, None]
        columns = q * member[:, None, None] + np.arange(q)
        rows, columns = np.broadcast_to(rows, block.shape).ravel(), np.broadcast_to(columns, block.shape).ravel()
        kept = block.ravel() != 0.0
        shape = (equations, equations)
        return sp.eye_array(equations, format="csr") + sp.csr_array(
            (block.ravel()[kept], (rows[kept], columns[kept])), shape=shape
        )
