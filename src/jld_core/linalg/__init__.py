"""Sparse factors and projections. Knows no Assembly.

- `Factor`: a factorisation, ready to solve with
- `Fronts`: elimination order and fronts of a pattern
- `Projector`: the nearest solution of linear equations
- `components`: which nodes of a graph hang together
- `nested_dissection`: an order of elimination by bisection
- `quick`: a matrix for products with vectors, in full where it is small
"""

from __future__ import annotations

from jld_core.linalg.cholesky import Factor, Fronts
from jld_core.linalg.components import components
from jld_core.linalg.dissection import nested_dissection
from jld_core.linalg.projection import Projector, quick

__all__ = [
    "Factor",
    "Fronts",
    "Projector",
    "components",
    "nested_dissection",
    "quick",
]
