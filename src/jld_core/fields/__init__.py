"""Stress and velocity fields in the blocks: λ of blocks that may crack anywhere, from both sides.

`space_bounds` has the same for one layout in space.

- `bounds_by_fields`: bounds on λ of one labelling of planar blocks
"""

from __future__ import annotations

from jld_core.fields.bounds import bounds_by_fields

__all__ = [
    "bounds_by_fields",
]
