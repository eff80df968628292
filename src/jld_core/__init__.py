"""One assembly, one labelling → λ, with proof.

`load_scene` and `parse_scene` give a `Scene`, `build_assembly` an `Assembly`, `solve` (with `SolveOptions`) or, for
many labellings of one assembly, `LimitAnalysis` a `LimitAnalysisResult` with its `Status`. What goes wrong is an
`InputError` or a `SolverError`. `samples` are parametric scenes, `views` draw, `solvers` are the ways to a raw answer.
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
