"""The blocks of a labelling as bodies that are moved: which elements, what they touch and in which direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly, blocks_of


@dataclass(frozen=True)
class Blocks:
    """k blocks of a labelling, numbered by their first element; what is joined to a support is one of them, and fixed.

    of: (n,) block of each element. fixed: (k,) True where it holds a support. first, second: (c,) blocks on either
    side of each dry contact between two of them. normal: (c, d) unit normals from the first to the second.
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
        """Elements of a block."""
        return np.flatnonzero(self.of == block)

    def name(self, block: int) -> str:
        """A block by the name of its first element."""
        return self.assembly.elements.ids[int(self.elements(block)[0])]

    def contacts_of(self, block: int) -> tuple[Ints, Floats]:
        """What a block touches: (c,) other blocks, and (c, d) unit normals from the block to them."""
        out, back = self.first == block, self.second == block
        return (
            np.concatenate([self.second[out], self.first[back]]),
            np.concatenate([self.normal[out], -self.normal[back]]),
        )


def blocks_of_labelling(assembly: Assembly, labels: Bits) -> Blocks:
    """The blocks of a labelling. labels: (m,) True dry. All supports are one fixed body of the ground."""
    faces, elements = assembly.interfaces, assembly.elements
    ground = np.flatnonzero(elements.support)
    of = blocks_of(assembly, labels, (ground[:-1], ground[1:]))
    fixed = np.zeros(int(of.max()) + 1, dtype=bool)
    fixed[of[elements.support]] = True
    between = np.flatnonzero(of[faces.a] != of[faces.b])
    return Blocks(assembly, of, fixed, of[faces.a[between]], of[faces.b[between]], faces.normal[between])
