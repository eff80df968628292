"""Sparse factorisations and projections, independent of `Assembly`."""

from __future__ import annotations

from jld_core.linalg.projection import components

__all__ = [
    "components",
]
