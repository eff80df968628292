"""Sparse factors and projections. Knows no Assembly.

- `Factor`: a factorisation, ready to solve with
- `Fronts`: elimination order and fronts of a pattern
- `nested_dissection`: an order of elimination by bisection
"""

from __future__ import annotations

from jld_core.linalg.cholesky import Factor, Fronts
from jld_core.linalg.dissection import nested_dissection

__all__ = [
    "Factor",
    "Fronts",
    "nested_dissection",
]
