"""Cut any closed solid to parts that fit a machine, go together, and carry a load.

- `Options`: what parts must fit and carry, and how they are made
- `cut`: cut a solid of a file to parts
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_cut.cut import Options, cut

__all__ = ["Options", "cut"]

export_lazily(__name__, {"cut": ["Options", "cut"]})
