"""Stress and velocity fields in the blocks: two-sided bounds on λ, with cracks anywhere.

- `bounds_by_fields`: bounds on λ of one labelling, in the plane or in space
"""

from __future__ import annotations

from jld_core.fields.bounds import bounds_by_fields

__all__ = [
    "bounds_by_fields",
]
