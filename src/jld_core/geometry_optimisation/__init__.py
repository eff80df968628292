"""Geometry of joints as a variable: derivatives of λ, optimisation, bounds over boxes.

`jld_core.geometry_sensitivities` has the derivatives, `jld move` the rest: `optimise.move_joints` and
`box_search.prove_box`; keys and waves by `shape_search.shape_joints`.
"""

from __future__ import annotations

__all__: list[str] = []
