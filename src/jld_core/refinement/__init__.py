"""Refinement of elements into cells, which makes any structure a grid of candidate faces.

- `arrangement`: cutting of planar elements by cells in one arrangement of lines
- `bonds`: masonry bonds: head joints course by course, bonded corners, walls with openings
- `crack_cells`: split the elements of a scene into cells along which blocks may crack
- `prism_of`: return a solid as a prism without holes; None if it is none
- `refine`: split every free element of a scene into cells
- `voussoirs`: cells of voussoirs in rings: joints radiate from the centres of the outline's own arcs
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.refinement.refine import refine

if TYPE_CHECKING:
    from jld_core.refinement import arrangement, bonds, voussoirs
    from jld_core.refinement.refine import crack_cells
    from jld_core.refinement.walls import prism_of

__all__ = [
    "arrangement",
    "bonds",
    "crack_cells",
    "prism_of",
    "refine",
    "voussoirs",
]

export_lazily(
    __name__,
    {
        "refine": ["crack_cells"],
        "walls": ["prism_of"],
    },
    submodules=["arrangement", "bonds", "voussoirs"],
)
