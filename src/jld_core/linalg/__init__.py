"""Sparse factors and projections. Knows no Assembly."""

from __future__ import annotations

from jld_core.linalg.cholesky import Factor, Fronts
from jld_core.linalg.dissection import nested_dissection

__all__ = [
    "Factor",
    "Fronts",
    "nested_dissection",
]
