"""Elements split into cells, so that any structure becomes a grid of candidate faces."""

from __future__ import annotations

from jld_core.refinement.refine import KINDS, Refined, refine

__all__ = ["KINDS", "Refined", "refine"]
