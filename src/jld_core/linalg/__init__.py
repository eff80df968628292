"""Sparse factorisations and projections, independent of `Assembly`.

- `Factor`: Cholesky factorisation that solves linear systems
- `Fronts`: elimination order and fronts of a symmetric pattern
- `Projector`: projection on the solutions of linear equations
- `components`: number the connected components of a graph
- `nested_dissection`: compute an elimination order by recursive bisection
- `quick`: return a small sparse matrix as a dense one, for faster products with vectors
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
