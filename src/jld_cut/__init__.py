"""Cut any closed solid to parts that fit a machine, go together, and carry a load.

- `Options`: what parts must fit and carry, and how they are made
- `cut`: cut a solid of a file to parts
"""

from jld_cut.cut import Options, cut

__all__ = ["Options", "cut"]
