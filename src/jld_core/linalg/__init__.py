"""Sparse factorisations and projections, independent of `Assembly`."""

from __future__ import annotations

from jld_core.linalg.factors import components, merged_points

__all__ = ["components", "merged_points"]
