"""An interior point on the Schur complement, for large assemblies.

- `SchurSolver`: our interior point for large assemblies
"""

from __future__ import annotations

from jld_core.solvers.schur.interior_point import SchurSolver

__all__ = [
    "SchurSolver",
]
