"""Stress and velocity fields in the blocks: two-sided bounds on λ, with cracks anywhere.

`space_bounds` has the same for one layout in space.

- `bounds_by_fields`: bounds on λ of one labelling of planar blocks
"""

from __future__ import annotations

from jld_core.fields.bounds import bounds_by_fields

__all__ = [
    "bounds_by_fields",
]
