"""One assembly, one labelling → λ, with proof.

- `Assembly`: one structure with loads and materials, before any labelling is chosen
- `InputError`: a scene, option or folder that cannot be used, in one line
- `LimitAnalysis`: one assembly, to be solved under many labellings
- `LimitAnalysisResult`: λ with its bracket, status, forces and mechanism
- `Scene`: a scene file, validated
- `SolveOptions`: what is modelled, as on the command line
- `SolverError`: a solver that was asked for a program it does not take
- `Status`: collapse, locked, unstable or uncertified
- `build_assembly`: Scene → Assembly
- `load_scene`: file → Scene
- `parse_scene`: dictionary → Scene
- `samples`: parametric scenes by name
- `solve`: λ of one labelling, with a two-sided bracket
- `solvers`: ways to a raw answer
- `views`: drawings and notebooks
"""

from __future__ import annotations

from jld_core import samples, solvers, views
from jld_core._version import __version__ as __version__
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import InputError, SolverError
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, Status
from jld_core.models import SolveOptions, solve
from jld_core.scene import Scene, load_scene, parse_scene

__all__ = [
    "Assembly",
    "InputError",
    "LimitAnalysis",
    "LimitAnalysisResult",
    "Scene",
    "SolveOptions",
    "SolverError",
    "Status",
    "build_assembly",
    "load_scene",
    "parse_scene",
    "samples",
    "solve",
    "solvers",
    "views",
]
