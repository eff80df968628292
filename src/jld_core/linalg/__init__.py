"""Sparse factorisations and projections, independent of `Assembly`.

- `components`: number the connected components of a graph
"""

from __future__ import annotations

from jld_core.linalg.projection import components

__all__ = [
    "components",
]
