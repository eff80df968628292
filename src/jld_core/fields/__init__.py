"""Stress and velocity fields in the blocks: λ of planar blocks that may crack anywhere, from both sides.

- `bounds_by_fields`: bounds on λ of one labelling
"""

from __future__ import annotations

from jld_core.fields.bounds import bounds_by_fields

__all__ = [
    "bounds_by_fields",
]
