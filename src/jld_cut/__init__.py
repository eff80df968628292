"""Cut any closed solid to parts that fit a machine, go together, and carry a load.

- `Options`: what parts must fit and carry, and how they are made
- `cells`: a solid cut by planes, and the joints between its cells
- `cut`: cut a solid of a file to parts
- `keys`: keys of joints on which parts slide
- `meshes`: solids of files, and what is written of them
- `partitions`: all layouts of cells to parts that fit, with bounds
- `parts`: parts as they are made, and their files
- `search`: ways to cut a solid, and the truth on each
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_cut import cells, keys, meshes, partitions, parts, search
    from jld_cut.cut import Options, cut

__all__ = ["Options", "cells", "cut", "keys", "meshes", "partitions", "parts", "search"]

export_lazily(
    __name__, {"cut": ["Options", "cut"]}, submodules=["cells", "keys", "meshes", "partitions", "parts", "search"]
)
