"""Patterns of masonry that cut elements into stones (`jld refine`).

- `bonds`: masonry bonds: head joints course by course, bonded corners, walls with openings
- `patterns`: cells that cover a plane structure: courses of a bond, Voronoi cells, sectors of rings
- `prism_of`: return a solid as a prism without holes; None if it is none
- `voussoirs`: cells of voussoirs in rings: joints radiate from the centres of the outline's own arcs
- `walls`: walls drawn as solids: courses of a bond with bonded corners, openings and lintels
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_masonry import bonds, patterns, voussoirs, walls
    from jld_masonry.walls import prism_of

__all__ = ["bonds", "patterns", "prism_of", "voussoirs", "walls"]

export_lazily(__name__, {"walls": ["prism_of"]}, submodules=["bonds", "patterns", "voussoirs", "walls"])
