"""Refinement of elements into cells, which makes any structure a grid of candidate faces.

- `KINDS`: names of the kinds of cells
- `CrackCells`: finer cells whose faces share the labels of joint faces
- `Refined`: refined scene, with the original element of each piece and notes
- `crack_cells`: split elements into cells along which blocks may crack
- `refine`: split every free element of a scene into cells
"""

from __future__ import annotations

from jld_core.refinement.cells import CrackCells, crack_cells
from jld_core.refinement.refine import KINDS, Refined, refine

__all__ = ["KINDS", "CrackCells", "Refined", "crack_cells", "refine"]
