"""Blocks of a labelling as rigid bodies: elements, neighbours and contact normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly, blocks_of


@dataclass(frozen=True)
class Blocks:
    """Blocks of a labelling, numbered by their first element.

    All elements joined to a support belong to one fixed block.

    of: (n,) block of each element. fixed: (k,) True for the block that holds the supports. first, second: (c,) blocks
    on both sides of each contact between two blocks. normal: (c, d) unit normals from the first to the second block.
    """

    assembly: Assembly
    of: Ints
    fixed: Bools
    first: Ints
    second: Ints
    normal: Floats

    def __len__(self) -> int:
        return len(self.fixed)

    def elements(self, block: int) -> Ints:
        """Return the indices of the elements of a block, ascending."""
        return np.flatnonzero(self.of == block)

    def name(self, block: int) -> str:
        """Return the name of a block: the id of its first element."""
        return self.assembly.elements.ids[int(self.elements(block)[0])]

    def contacts_of(self, block: int) -> tuple[Ints, Floats]:
        """Return the neighbour across each contact of a block (c,), and unit normals (c, d) to it.

        A neighbour with several contacts is listed several times.
        """
        out, back = self.first == block, self.second == block
        return (
            np.concatenate([self.second[out], self.first[back]]),
            np.concatenate([self.normal[out], -self.normal[back]]),
        )


def blocks_of_labelling(assembly: Assembly, labels: Bits) -> Blocks:
    """Return the blocks of a labelling as rigid bodies; all supports form one fixed body.

    assembly: assembly with n elements and m interfaces. labels: (m,) True = dry. Result: the k blocks and the contacts
    between them.
    """
    faces, elements = assembly.interfaces, assembly.elements
    ground = np.flatnonzero(elements.support)
    of = blocks_of(assembly, labels, (ground[:-1], ground[1:]))
    fixed = np.zeros(int(of.max()) + 1, dtype=bool)
    fixed[of[elements.support]] = True
    between = np.flatnonzero(of[faces.a] != of[faces.b])
    return Blocks(assembly, of, fixed, of[faces.a[between]], of[faces.b[between]], faces.normal[between])
