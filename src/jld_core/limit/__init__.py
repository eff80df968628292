"""A raw answer → a proof: bounds, repairs, status, result.

- `FLOOR_SECONDS`: processor time for the bound below every λ without dilation
- `FALLBACKS`: what `LimitAnalysis.prove` tries by default, from the top down
- `AnyBlockRelaxation`: the relaxation by blocks, under one load or several
- `AnyRelaxation`: what refutes partial labellings, under one load or several
- `Asked`: what `BlockRelaxation.choose` is asked: blocks allowed, λ to reach, λ that is not exceeded
- `Batch`: the batch solver for one limit analysis
- `BatchAnswers`: what is settled of k labellings
- `BlockRelaxation`: bounds on λ over all choices of blocks
- `CaseBlockRelaxation`: the same of the choice of blocks
- `CaseRelaxation`: bounds on the governing factor where faces are undecided
- `Choice`: what that relaxation says of some blocks
- `ProofAttempt`: one labelling on its way up
- `Condense`: when blocks are taken as rigid: auto, on or off
- `Contacts`: how dry faces touch: convex or concave
- `DualBound`: why no labelling that agrees on some faces reaches a λ
- `MinimizedConflict`: what became of a labelling, or of a neighbour of it, that was shrunk
- `Friction`: associative or zero-dilation
- `Governing`: what is known of the governing factor
- `Known`: what is known of one load case
- `LimitAnalysis`: one assembly, to be solved under many labellings
- `LimitAnalysisResult`: λ with its bracket, status, forces and mechanism
- `Motion`: velocities with their jumps, margin and bound
- `Movement`: what a face does in a mechanism
- `Movements`: how far faces move in the mechanisms of many labellings
- `Proof`: what has been proven of one labelling, and by what
- `Prover`: raw points and multipliers → checked bounds
- `Relaxation`: bounds on λ where some faces are undecided
- `Repair`: auxiliary programs that make an answer admissible
- `Fallback`: one way to a proof
- `Settled`: what a settlement leaves
- `SolveOptions`: what is modelled, as on the command line
- `State`: forces and λ with their slack and error
- `Status`: collapse, locked, unstable or uncertified
- `Thrust`: one end of the range
- `apart`: whether two brackets of one λ have nothing in common
- `applies_to`: whether there is a relaxation by blocks
- `block_relaxation_of`: the relaxation by blocks of a structure under its load or all of its cases
- `crossed`: whether two bounds contradict each other
- `displacement`: velocities of points that move with an element
- `element_velocities`: scaled velocities → scene units
- `exceeds`: whether a layout carries more than a bound on all layouts
- `face_jumps`: velocities → jumps of the faces
- `face_motions`: what each face does in a mechanism
- `governing`: the governing factor of a labelling from what is known of its load cases
- `governing_result`: results of load cases → the result of the structure
- `load_scale`: λ below which differences are no matter
- `number`: a JSON number, or null
- `reactions`: (k, q) what interfaces put on some elements (k,), supports too, about their centroids
- `relative_width`: width of a bracket, relative
- `relaxation_of`: the relaxation of a structure under its load or all of its cases
- `result_of`: a proof → a result in scene units
- `settle`: the range of thrust that a settlement leaves, and the mechanisms at its ends; associative, convex contact
"""

from __future__ import annotations

from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.batch import Batch, BatchAnswers
from jld_core.limit.block_relaxation import Asked, BlockRelaxation, Choice, applies_to
from jld_core.limit.bounds import Motion, Prover, State, apart, crossed, exceeds, load_scale, relative_width
from jld_core.limit.case_relaxation import (
    AnyBlockRelaxation,
    AnyRelaxation,
    CaseBlockRelaxation,
    CaseRelaxation,
    block_relaxation_of,
    relaxation_of,
)
from jld_core.limit.governing import Governing, Known, governing
from jld_core.limit.mechanism import (
    Movement,
    displacement,
    face_jumps,
    face_motions,
)
from jld_core.limit.movements import Movements
from jld_core.limit.options import FLOOR_SECONDS, Condense, Contacts, Friction, SolveOptions
from jld_core.limit.proof import Proof
from jld_core.limit.proof_attempt import FALLBACKS, Fallback, ProofAttempt
from jld_core.limit.relaxation import DualBound, MinimizedConflict, Relaxation
from jld_core.limit.repair import Repair
from jld_core.limit.result import LimitAnalysisResult, element_velocities, governing_result, number, result_of
from jld_core.limit.settlement import Settled, Thrust, reactions, settle
from jld_core.limit.status import Status

__all__ = [
    "FALLBACKS",
    "FLOOR_SECONDS",
    "AnyBlockRelaxation",
    "AnyRelaxation",
    "Asked",
    "Batch",
    "BatchAnswers",
    "BlockRelaxation",
    "CaseBlockRelaxation",
    "CaseRelaxation",
    "Choice",
    "Condense",
    "Contacts",
    "DualBound",
    "Fallback",
    "Friction",
    "Governing",
    "Known",
    "LimitAnalysis",
    "LimitAnalysisResult",
    "MinimizedConflict",
    "Motion",
    "Movement",
    "Movements",
    "Proof",
    "ProofAttempt",
    "Prover",
    "Relaxation",
    "Repair",
    "Settled",
    "SolveOptions",
    "State",
    "Status",
    "Thrust",
    "apart",
    "applies_to",
    "block_relaxation_of",
    "crossed",
    "displacement",
    "element_velocities",
    "exceeds",
    "face_jumps",
    "face_motions",
    "governing",
    "governing_result",
    "load_scale",
    "number",
    "reactions",
    "relative_width",
    "relaxation_of",
    "result_of",
    "settle",
]
