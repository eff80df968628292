"""Schur-complement interior-point method for large assemblies.

- `SchurSolver`: the project's Schur-complement interior-point method for large assemblies
"""

from __future__ import annotations

from jld_core.solvers.schur.interior_point import SchurSolver

__all__ = [
    "SchurSolver",
]
