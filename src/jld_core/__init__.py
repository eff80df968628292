"""Limit analysis of one assembly: the load factor λ of a labelling, between proven bounds.

- `FACTS`: key of a scene and a name in words for each fact about strengths
- `Assembly`: one structure with loads and materials, before any labelling is chosen
- `BatchResult`: λ of many labellings, with proven bounds
- `Bits`: labels of all interfaces, shape (m,), in the order of the assembly: True = dry, False = inner
- `Bools`: array of bool
- `Deadline`: time at which work must end, with a start from which elapsed time counts
- `DeadlinePassed`: error raised by `checkpoint` and `Deadline.check` when the deadline has passed
- `Elements`: arrays over n rigid elements, in scene units; d is 2 (planar) or 3 (spatial)
- `Floats`: array of float64
- `InputError`: error for a scene, option or folder that cannot be used, in one line
- `Ints`: array of int64
- `Layout`: assembly under one labelling, as blocks
- `LimitAnalysis`: solver of many labellings of one assembly
- `LimitAnalysisResult`: λ with its bracket, status, forces and mechanism
- `LoadCase`: one load case of an assembly: its loads, and the load factor required under them
- `Loads`: loads of one kind, dead or live, on n elements, scene units
- `Model`: how a structure is modelled and solved: crack model, friction, contact, solver
- `ParameterError`: error for a parameter of a function, or an option of a command, with a wrong value
- `Result`: λ of one structure under one labelling, whatever the crack model
- `Route`: one reader of strengths: its name in messages, and the facts that it knows
- `Scene`: validated content of a scene file
- `SolveOptions`: name of `Model` before version 0.4
- `SolverError`: error for a program that a solver does not support
- `Status`: status of a result: collapse, locked, unstable or uncertified
- `Strengths`: strengths of m interfaces, each as dry and as inner, in scene units
- `assembly`: module of assemblies: parts of one, labels that a caller gives
- `blocks_csv`: return the text of blocks.csv
- `blocks_of`: find the blocks of a labelling
- `build_assembly`: build the assembly of a scene
- `checkpoint`: raise DeadlinePassed if the deadline enforced around this call has passed
- `error_context`: add the name of a file to errors about its content
- `exchange`: files of other programs, read as scenes and written as blocks
- `export_lazily`: let a package load its exported names on first use
- `files`: write files completely or not at all, with characters that every reader accepts
- `geometry_sensitivities`: compute the derivatives of λ by the positions of vertices
- `load_scene`: read a scene file
- `one_thread`: restrict matrix products to one thread inside the context, also as a decorator
- `parameters`: check the types of what a caller gives, by the annotations of dataclasses
- `parse_scene`: make a scene from a dictionary
- `plugins`: plug-ins: what packages installed beside jld add, found by their entry points (docs/guide/plugins.md)
- `resultants`: compute the resultants of loads on elements
- `samples`: parametric scenes by name
- `solve`: compute λ of one labelling, with a two-sided bracket
- `solve_many`: compute λ of many labellings by the compiled batch solver
- `solvers`: solvers of conic and linear programs
- `time_left`: return the time left until the enforced deadline ends
- `tolerances`: tolerances that bound a result: dimensionless, each with the reason for its size
- `views`: drawings and notebook output
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core._version import __version__ as __version__
from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core import assembly, exchange, files, parameters, plugins, samples, solvers, tolerances, views
    from jld_core.arrays import Bits, Bools, Floats, Ints
    from jld_core.assembly import Assembly, Elements, LoadCase, blocks_of
    from jld_core.build.assemble import build_assembly
    from jld_core.deadline import Deadline, DeadlinePassed, checkpoint, time_left
    from jld_core.errors import InputError, ParameterError, SolverError, error_context
    from jld_core.layout import Layout, blocks_csv
    from jld_core.lazy_exports import export_lazily
    from jld_core.limit.analysis import LimitAnalysis
    from jld_core.limit.options import Model, SolveOptions, Status
    from jld_core.limit.result import LimitAnalysisResult, Result
    from jld_core.loads import Loads, resultants
    from jld_core.models.case_analysis import solve
    from jld_core.models.sensitivity import geometry_sensitivities
    from jld_core.models.solve_many import BatchResult, solve_many
    from jld_core.scene.reading import load_scene, parse_scene
    from jld_core.scene.schema import Scene
    from jld_core.strengths import FACTS, Route, Strengths
    from jld_core.threads import one_thread

__all__ = [
    "FACTS",
    "Assembly",
    "BatchResult",
    "Bits",
    "Bools",
    "Deadline",
    "DeadlinePassed",
    "Elements",
    "Floats",
    "InputError",
    "Ints",
    "Layout",
    "LimitAnalysis",
    "LimitAnalysisResult",
    "LoadCase",
    "Loads",
    "Model",
    "ParameterError",
    "Result",
    "Route",
    "Scene",
    "SolveOptions",
    "SolverError",
    "Status",
    "Strengths",
    "assembly",
    "blocks_csv",
    "blocks_of",
    "build_assembly",
    "checkpoint",
    "error_context",
    "exchange",
    "export_lazily",
    "files",
    "geometry_sensitivities",
    "load_scene",
    "one_thread",
    "parameters",
    "parse_scene",
    "plugins",
    "resultants",
    "samples",
    "solve",
    "solve_many",
    "solvers",
    "time_left",
    "tolerances",
    "views",
]

export_lazily(
    __name__,
    {
        "assembly": ["Elements", "LoadCase", "Assembly", "blocks_of"],
        "build.assemble": ["build_assembly"],
        "errors": ["ParameterError", "error_context", "InputError", "SolverError"],
        "layout": ["Layout", "blocks_csv"],
        "limit.analysis": ["LimitAnalysis"],
        "limit.result": ["LimitAnalysisResult", "Result"],
        "limit.options": ["Model", "Status", "SolveOptions"],
        "models.case_analysis": ["solve"],
        "models.sensitivity": ["geometry_sensitivities"],
        "models.solve_many": ["BatchResult", "solve_many"],
        "scene.schema": ["Scene"],
        "scene.reading": ["load_scene", "parse_scene"],
        "arrays": ["Bits", "Bools", "Floats", "Ints"],
        "strengths": ["FACTS", "Route", "Strengths"],
        "deadline": ["Deadline", "DeadlinePassed", "checkpoint", "time_left"],
        "loads": ["Loads", "resultants"],
        "threads": ["one_thread"],
        "lazy_exports": ["export_lazily"],
    },
    submodules=["assembly", "exchange", "files", "parameters", "plugins", "tolerances", "samples", "solvers", "views"],
)
