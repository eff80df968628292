"""Elements split into cells, so that any structure becomes a grid of candidate faces.

- `KINDS`: what `jld new` makes, by name
- `Refined`: A refined scene, the element each of its elements was cut from, by id, and what had to be given up
- `refine`: split every free element of a scene into cells
"""

from __future__ import annotations

from jld_core.refinement.refine import KINDS, Refined, refine

__all__ = ["KINDS", "Refined", "refine"]
