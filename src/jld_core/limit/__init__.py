"""Limit analysis of labelled assemblies: proven bounds on λ, results and relaxations.

- `FALLBACKS`: solution methods that `LimitAnalysis.prove` tries by default, in order
- `FLOOR_SECONDS`: default processor time for the lower bound on λ over all non-dilatant solutions, seconds
- `RENAMED_BENDING`: values of `inner_bending` of version 0.2, by their new names
- `AnyBlockRelaxation`: block relaxation of one load or of several load cases
- `AnyRelaxation`: relaxation of partial labellings under one load or several load cases
- `Asked`: arguments of `BlockRelaxation.choose`: allowed blocks, threshold and upper bound on λ
- `Batch`: batch solver of one limit analysis
- `BatchAnswers`: bounds and statuses that the batch solver settled for k labellings
- `BlockRelaxation`: upper bounds on λ over all choices of blocks that cover an assembly
- `CaseBlockRelaxation`: block relaxation under several load cases
- `CaseRelaxation`: upper bounds on the governing factor of partial labellings under several load cases
- `Choice`: result of the block relaxation for one set of allowed blocks
- `Condense`: when blocks are modelled as rigid: auto, on or off
- `Contacts`: contact model of dry faces: convex or concave
- `DualBound`: mechanism that refutes a λ for every labelling with the same decided faces
- `EffectiveAreas`: convergence of effective areas
- `Fallback`: one named solution method with the condition under which it is tried
- `Friction`: friction model: associative or zero-dilation
- `Governing`: status and bounds of the governing factor
- `Known`: status and bounds of one load case
- `LimitAnalysis`: limit analysis of one assembly, reusable for many labellings
- `LimitAnalysisResult`: λ with its bracket, status, forces and mechanism
- `MinimizedConflict`: result of minimising the conflict of a labelling or of one of its neighbours
- `Motion`: velocities with their jumps, margin and upper bound on λ
- `Movement`: kind of movement of a face in a mechanism
- `Movements`: computes how far each face moves in the mechanisms of many labellings
- `Proof`: bounds, status and solve log of one labelling
- `ProofAttempt`: mutable state while fallbacks are tried for one labelling
- `Prover`: turns raw solver points and multipliers into checked bounds
- `Relaxation`: upper bounds on λ of partial labellings, where some faces are undecided
- `Repair`: auxiliary programs that make a solver's answer admissible
- `Settled`: range of thrust after a support movement
- `SolveOptions`: model and solver options, as on the command line
- `State`: forces and λ with their slack and equilibrium error
- `Status`: outcome of a limit analysis: collapse, locked, unstable, uncertified or failed
- `Thrust`: least or greatest thrust after a support movement
- `ZeroDilation`: evidence and range of solutions without dilation
- `apart`: return whether two brackets of one λ are disjoint
- `applies_to`: return whether a block relaxation of an assembly exists
- `block_relaxation_of`: create the block relaxation of a structure, for its load or all its load cases
- `crossed`: return whether a lower and an upper bound contradict each other
- `displacement`: compute velocities of points that move with an element
- `element_velocities`: convert scaled velocities to scene units
- `exceeds`: return whether a proven lower bound contradicts an upper bound
- `face_jumps`: compute the velocity jumps of all faces in a mechanism
- `face_motions`: classify the movement of each face in a mechanism
- `governing`: compute the governing factor of a labelling from its load cases
- `governing_result`: combine the results of load cases into the result of the structure
- `load_scale`: compute the λ below which differences are negligible
- `number`: convert a float to a JSON number or null
- `reactions`: compute the resultants (k, q) of the interface forces on k elements, supports included
- `relative_width`: compute the relative width of a bracket
- `relaxation_of`: create the relaxation of a structure, for its load or all its load cases
- `result_of`: convert a proof to a result in scene units
- `settle`: compute the range of thrust after a support movement, and the mechanisms at its ends
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
from jld_core.limit.model_facts import EffectiveAreas, ZeroDilation
from jld_core.limit.movements import Movements
from jld_core.limit.options import FLOOR_SECONDS, RENAMED_BENDING, Condense, Contacts, Friction, SolveOptions
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
    "RENAMED_BENDING",
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
    "EffectiveAreas",
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
    "ZeroDilation",
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
