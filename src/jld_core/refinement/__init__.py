"""Refinement of elements into cells, which makes any structure a grid of candidate faces.

- `Refined`: refined scene, with the original element of each piece and notes
- `refine`: split every free element of a scene into cells
"""

from __future__ import annotations

from jld_core.refinement.refine import Refined, refine

__all__ = ["Refined", "refine"]
