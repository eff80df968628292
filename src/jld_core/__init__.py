"""Limit analysis of one assembly: the load factor λ of a labelling, between proven bounds.

- `Assembly`: one structure with loads and materials, before any labelling is chosen
- `BatchResult`: λ of many labellings, with proven bounds
- `InputError`: error for a scene, option or folder that cannot be used, in one line
- `LimitAnalysis`: solver of many labellings of one assembly
- `LimitAnalysisResult`: λ with its bracket, status, forces and mechanism
- `Model`: how a structure is modelled and solved: crack model, friction, contact, solver
- `Result`: λ of one structure under one labelling, whatever the crack model
- `Scene`: validated content of a scene file
- `SolveOptions`: name of `Model` before version 0.4
- `SolverError`: error for a program that a solver does not support
- `Status`: status of a result: collapse, locked, unstable or uncertified
- `blocks_of`: find the blocks of a labelling
- `build_assembly`: build the assembly of a scene
- `geometry_sensitivities`: compute the derivatives of λ by the positions of vertices
- `load_scene`: read a scene file
- `parse_scene`: make a scene from a dictionary
- `samples`: parametric scenes by name
- `solve`: compute λ of one labelling, with a two-sided bracket
- `solve_many`: compute λ of many labellings by the compiled batch solver
- `solvers`: solvers of conic and linear programs
- `views`: drawings and notebook output
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core._version import __version__ as __version__
from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core import samples, solvers, views
    from jld_core.assembly import Assembly, blocks_of
    from jld_core.build import build_assembly
    from jld_core.errors import InputError, SolverError
    from jld_core.limit import LimitAnalysis, LimitAnalysisResult, Model, Result, Status
    from jld_core.models import SolveOptions, geometry_sensitivities, solve
    from jld_core.models.solve_many import BatchResult, solve_many
    from jld_core.scene import Scene, load_scene, parse_scene

__all__ = [
    "Assembly",
    "BatchResult",
    "InputError",
    "LimitAnalysis",
    "LimitAnalysisResult",
    "Model",
    "Result",
    "Scene",
    "SolveOptions",
    "SolverError",
    "Status",
    "blocks_of",
    "build_assembly",
    "geometry_sensitivities",
    "load_scene",
    "parse_scene",
    "samples",
    "solve",
    "solve_many",
    "solvers",
    "views",
]

export_lazily(
    __name__,
    {
        "assembly": ["Assembly", "blocks_of"],
        "build": ["build_assembly"],
        "errors": ["InputError", "SolverError"],
        "limit": ["LimitAnalysis", "LimitAnalysisResult", "Model", "Result", "Status"],
        "models": ["SolveOptions", "geometry_sensitivities", "solve"],
        "models.solve_many": ["BatchResult", "solve_many"],
        "scene": ["Scene", "load_scene", "parse_scene"],
    },
    submodules=["samples", "solvers", "views"],
)
