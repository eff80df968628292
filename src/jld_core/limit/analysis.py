"""Limit analysis of one assembly under any of its labellings."""

from __future__ import annotations

import time
from functools import cached_property

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.batch import BatchSolver, chosen, fits
from jld_core.limit.batch_results import ALONE
from jld_core.limit.bounds import Prover, State, load_scale, relative_width
from jld_core.limit.options import SolveOptions
from jld_core.limit.proof import Proof
from jld_core.limit.proof_attempt import FALLBACKS, Fallback, ProofAttempt
from jld_core.limit.repair import Repair
from jld_core.limit.result import LimitAnalysisResult, result_of
from jld_core.limit.status import Status
from jld_core.mechanics import InnerBending, require_materials, scaling_of, yield_set
from jld_core.program import Template
from jld_core.solvers import (
    Solver,
    make_solver,
)
from jld_core.threads import one_thread


class LimitAnalysis:
    """Limit analysis of one assembly under any of its labellings: convex contact, associative friction.

    assembly: the structure. solver, gap, inner_bending: see `SolveOptions`. margin: see `Template.program`. reference:
    (m,) labelling that solvers are set up on. template: where it exists already. single: one labelling is all that
    will be asked, so the batch solver is made for it alone where that is the quicker way. Structure, scaling and
    projectors
    are built once; the answer for a labelling does not depend on what was solved before it.
    """

    def __init__(
        self,
        assembly: Assembly,
        *,
        solver: str | Solver = "auto",
        gap: float = tolerances.GAP,
        inner_bending: InnerBending = "paper",
        margin: float | None = None,
        reference: Bits | None = None,
        template: Template | None = None,
        single: bool = False,
    ) -> None:
        start = time.perf_counter()
        self.assembly, self.gap, self.single = assembly, gap, single
        self.options = SolveOptions(inner_bending=inner_bending, condense="off", solver=solver, gap=gap)
        if template is None:
            scaling = scaling_of(assembly)
            template = Template(assembly, scaling, yield_set(assembly, scaling, inner_bending))
        self.template = template
        self.prover = Prover(self.template)
        precision = self.template.precision
        self.route = make_solver(solver, tolerance=precision.residual, structure=self.template.structure)
        self.repair = Repair(self.template, self.prover)
        self.margin = precision.margin if margin is None else margin
        self.floor = load_scale(self.template.assembly) / self.template.scaling.load
        self.reference = np.ones(len(assembly.interfaces), dtype=bool) if reference is None else reference
        self.seconds = time.perf_counter() - start

    @cached_property
    def batch(self) -> BatchSolver | None:
        """The batch solver for labellings of this analysis, where there is one that knows its rows."""
        if self.options.solver != "auto" or chosen() is None or not fits(self.template):
            return None
        plain = self.repair.expansion() if self.single else None
        opening = self.repair.opening() if plain is None else plain
        return BatchSolver(
            self.template, None if opening is None else opening.velocity, zero=self.floor, drawn=not self.single
        )

    @property
    def quick(self) -> bool:
        """Is a batch solver made and asked sooner than a solver answers one labelling?"""
        return self.assembly.dimension == 3 and ALONE[0] <= len(self.assembly.interfaces) <= ALONE[1]

    def under(self, template: Template, reference: Bits) -> LimitAnalysis:
        """An analysis of the same assembly by another template of it; reference: (m,) labelling it is set up on."""
        return LimitAnalysis(self.assembly, template=template, gap=self.gap, reference=reference)

    def prove(self, labels: Bits, ladder: tuple[Fallback, ...] = FALLBACKS, *, stands: bool = False) -> Proof:
        """Proof of one labelling, by as many rungs as it takes.

        labels: (m,) True dry. stands: also decide whether it stands at λ = 0.
        """
        start = time.perf_counter()
        proof = ProofAttempt(self, labels).up(ladder)
        proof.seconds = time.perf_counter() - start
        if stands:
            proof.stands = False if proof.status is Status.UNSTABLE else self.stands(labels, proof.state)
            proof.solves += proof.status is not Status.UNSTABLE
        return proof

    def judge(self, proof: Proof) -> Status:
        """The status that a proof amounts to."""
        falls = proof.motion is not None and proof.motion.bound < -proof.motion.noise and not proof.crossed
        if proof.collapse_below_zero is not None or falls:
            return Status.UNSTABLE
        if proof.ray is not None and proof.state is not None:
            return Status.LOCKED
        if relative_width(proof.low, proof.high, self.floor) <= self.gap:
            return Status.COLLAPSE
        return Status.UNCERTIFIED

    def unloaded(self, labels: Bits) -> State | None:
        """Without dead load no force at all is a state, at λ = 0: exact where rounding leaves nothing else."""
        if self.template.dead.any():
            return None
        nothing = np.zeros(self.template.scaling.face.shape)
        return State(nothing, 0.0, float(self.template.yield_set.slack(nothing, labels).min()), 0.0)

    def stands(self, labels: Bits, known: State | None = None) -> bool | None:
        """Is λ = 0 admissible? None where neither a state nor a motion settles it.

        labels: (m,) True dry. known: a state of it; λ = 0 lies between it and one that bears the opposite load.
        """
        if not self.template.dead.any():
            return True
        if known is not None and known.load >= 0.0 and self.single and self.quick and self.batch is not None:
            found = self.batch.reversed().solve(labels[None], thresholds=np.zeros(1), vectors=True)
            if found.forces is not None and found.low[0] >= 0.0:
                state = self.prover.state(np.append(found.forces[0], -found.low[0]), labels)
                if state.admissible and state.load <= 0.0:
                    return True
        return self.repair.stands(labels)

    @one_thread()
    def solve(self, labels: Bits | None = None, *, stands: bool = True) -> LimitAnalysisResult:
        """Limit analysis of one labelling, in full.

        labels: (m,) True dry; default the assembly's own. stands: also decide whether it stands at λ = 0.
        Raises InputError where a material that the labelling needs is missing.
        """
        start = time.perf_counter()
        labels = self.assembly.labels if labels is None else np.asarray(labels, dtype=bool)
        require_materials(self.assembly, labels, ~labels)
        proof = self.prove(labels, stands=stands)
        elapsed = time.perf_counter() - start
        return result_of(self.template, labels, self.options, proof, assemble=self.seconds, elapsed=elapsed)
