"""Refinement of elements into cells, which makes any structure a grid of candidate faces."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.plugins import door
from jld_core.refinement.refine import refine

if TYPE_CHECKING:
    from jld_core.refinement import arrangement
    from jld_core.refinement.refine import KINDS, crack_cells

__all__ = ["KINDS", "arrangement", "crack_cells", "refine"]

__getattr__ = door("masonry")  # bonds, voussoirs, walls

export_lazily(__name__, {"refine": ["KINDS", "crack_cells"]}, submodules=["arrangement"])
