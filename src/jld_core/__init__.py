"""One assembly, one labelling → λ, with proof."""

from __future__ import annotations

from jld_core._version import __version__
from jld_core.assembly import DRY, INNER, Assembly
from jld_core.build.assemble import build_assembly
from jld_core.errors import InputError, RouteError
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.result import LimitAnalysisResult
from jld_core.limit.status import Status
from jld_core.models.solve import Model, solve
from jld_core.scene.reading import load_scene, parse_scene
from jld_core.scene.schema import Scene

__all__ = [
    "DRY",
    "INNER",
    "Assembly",
    "InputError",
    "LimitAnalysis",
    "LimitAnalysisResult",
    "Model",
    "RouteError",
    "Scene",
    "Status",
    "__version__",
    "build_assembly",
    "load_scene",
    "parse_scene",
    "solve",
]
