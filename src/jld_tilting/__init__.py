"""Tilting tables in searches: angles of the best layouts, the layout that tilts furthest, and its proof.

- `Tilting`: step after a search of a tilted scene
- `furthest`: objective of a search, the proven angle of a layout
"""

from jld_tilting.furthest import Tilting, furthest

__all__ = ["Tilting", "furthest"]
