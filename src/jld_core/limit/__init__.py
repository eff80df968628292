"""Limit analysis of labelled assemblies: proven bounds on λ, results and relaxations.

- `FIELD_SECONDS`: default time for the bounds of one load case by fields, seconds
- `FLOOR_SECONDS`: default processor time for the lower bound on λ over all non-dilatant solutions, seconds
- `BatchAnalysis`: batch solver of one limit analysis
- `CaseBounds`: status and bounds of one load case
- `Condense`: when blocks are modelled as rigid: auto, on or off
- `Contacts`: contact model of dry faces: convex or concave
- `EffectiveAreas`: convergence of effective areas
- `Friction`: friction model: associative or zero-dilation
- `LimitAnalysis`: limit analysis of one assembly, reusable for many labellings
- `LimitAnalysisResult`: λ with its bracket, status, forces and mechanism
- `Model`: how a structure is modelled and solved, as on the command line
- `Motion`: velocities with their jumps, margin and upper bound on λ
- `Proof`: bounds, status and solve log of one labelling
- `Prover`: turns raw solver points and multipliers into checked bounds
- `Result`: λ of one structure under one labelling: what all results have
- `SolveOptions`: name of `Model` before version 0.4
- `State`: forces and λ with their slack and equilibrium error
- `Status`: outcome of a limit analysis: collapse, locked, unstable, uncertified or failed
- `ZeroDilation`: evidence and range of solutions without dilation
- `displacement`: compute velocities of points that move with an element
- `exceeds`: return whether a proven lower bound contradicts an upper bound
- `governing`: compute the governing factor of a labelling from its load cases
- `governing_result`: combine the results of load cases into the result of the structure
- `load_scale`: compute the λ below which differences are negligible
- `number`: convert a float to a JSON number or null
- `relative_width`: compute the relative width of a bracket
- `result_of`: convert a proof to a result in scene units
- `stands_in_words`: say whether a structure stands without live load
"""

from __future__ import annotations

from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.batch import BatchAnalysis
from jld_core.limit.bounds import Motion, Prover, State, exceeds, load_scale, relative_width
from jld_core.limit.mechanism import displacement
from jld_core.limit.options import (
    FIELD_SECONDS,
    FLOOR_SECONDS,
    CaseBounds,
    Condense,
    Contacts,
    EffectiveAreas,
    Friction,
    Model,
    SolveOptions,
    Status,
    ZeroDilation,
    governing,
)
from jld_core.limit.proof import Proof
from jld_core.limit.result import LimitAnalysisResult, Result, governing_result, number, result_of, stands_in_words

__all__ = [
    "FIELD_SECONDS",
    "FLOOR_SECONDS",
    "BatchAnalysis",
    "CaseBounds",
    "Condense",
    "Contacts",
    "EffectiveAreas",
    "Friction",
    "LimitAnalysis",
    "LimitAnalysisResult",
    "Model",
    "Motion",
    "Proof",
    "Prover",
    "Result",
    "SolveOptions",
    "State",
    "Status",
    "ZeroDilation",
    "displacement",
    "exceeds",
    "governing",
    "governing_result",
    "load_scale",
    "number",
    "relative_width",
    "result_of",
    "stands_in_words",
]
