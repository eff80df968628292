"""Limit analysis of one assembly under any of its labellings."""

from __future__ import annotations

import time
from functools import cached_property

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.batch import chosen
from jld_core.batch.batch_solver import BatchSolver
from jld_core.batch.rows import fits
from jld_core.limit.batch_results import FACES_WHERE_BATCH_IS_FASTER
from jld_core.limit.bounds import Prover, State, load_scale, relative_width
from jld_core.limit.fallbacks import FALLBACKS, Fallback, run_fallbacks
from jld_core.limit.options import Model, Status
from jld_core.limit.proof import Proof
from jld_core.limit.proof_attempt import ProofAttempt
from jld_core.limit.repair import Repair
from jld_core.limit.result import LimitAnalysisResult, result_of
from jld_core.mechanics import InnerBending, require_materials, scaling_of, yield_set
from jld_core.program import Template
from jld_core.solvers import (
    Solver,
    make_solver,
)
from jld_core.threads import one_thread


class LimitAnalysis:
    """Limit analysis of one assembly under any labelling, with associative friction.

    Contacts are convex. Structure, scaling and projectors are built once. The result for a labelling does not depend on
    earlier solves.

    Parameters
    ----------
    assembly : Assembly
        Structure to analyse.
    solver : str or Solver
        Solver of the first attempt, see `Model`.
    gap : float
        Relative width of the bracket to aim at.
    inner_bending : {"uncoupled", "kern"}
        Bending of inner faces, see `Model`.
    margin : float or None
        Slack kept in every yield row while solving, scaled, see `Template.program`. Default: that of the template.
    reference : (m,) bool array or None
        Labelling, True = dry, on which solvers are set up. Default: all faces dry.
    template : Template or None
        Template of the assembly, if it exists already.
    single_labelling : bool
        State that only one labelling will be analysed. The batch solver is then made for it alone, where that is
        faster.
    seconds : float or None
        Time after which no further solution method is begun, s. None: no limit.
    """

    def __init__(
        self,
        assembly: Assembly,
        *,
        solver: str | Solver = "auto",
        gap: float = tolerances.GAP,
        inner_bending: InnerBending = "uncoupled",
        margin: float | None = None,
        reference: Bits | None = None,
        template: Template | None = None,
        single_labelling: bool = False,
        seconds: float | None = None,
    ) -> None:
        start = time.perf_counter()
        self.assembly, self.gap, self.single_labelling = assembly, gap, single_labelling
        self.options = Model(inner_bending=inner_bending, condense="off", solver=solver, gap=gap, seconds=seconds)
        if template is None:
            scaling = scaling_of(assembly)
            template = Template(assembly, scaling, yield_set(assembly, scaling, self.options.inner_bending))
        self.template = template
        self.prover = Prover(self.template)
        precision = self.template.precision
        self.first_solver = make_solver(solver, tolerance=precision.residual, structure=self.template.structure)
        self.repair = Repair(self.template, self.prover)
        self.margin = precision.margin if margin is None else margin
        self.load_scale = load_scale(self.template.assembly) / self.template.scaling.load
        self.reference = np.ones(len(assembly.interfaces), dtype=bool) if reference is None else reference
        self.seconds = time.perf_counter() - start

    @cached_property
    def batch(self) -> BatchSolver | None:
        """Return the batch solver; None with a named solver, without library, or for unsupported rows."""
        if self.options.solver != "auto" or chosen() is None or not fits(self.template):
            return None
        plain = self.repair.expansion() if self.single_labelling else None
        opening = self.repair.opening() if plain is None else plain
        return BatchSolver(
            self.template,
            None if opening is None else opening.velocity,
            load_scale=self.load_scale,
            sampled_start=not self.single_labelling,
        )

    @property
    def batch_is_faster(self) -> bool:
        """Return True if the batch solver is faster for one labelling than one solver call.

        The time includes creating the batch solver.
        """
        return (
            self.assembly.dimension == 3
            and FACES_WHERE_BATCH_IS_FASTER[0] <= len(self.assembly.interfaces) <= FACES_WHERE_BATCH_IS_FASTER[1]
        )

    def with_template(self, template: Template, reference: Bits) -> LimitAnalysis:
        """Create an analysis with another template, of the same gap and default solver options."""
        return LimitAnalysis(self.assembly, template=template, gap=self.gap, reference=reference)

    def prove(self, labels: Bits, fallbacks: tuple[Fallback, ...] = FALLBACKS, *, stands: bool = False) -> Proof:
        """Prove scaled bounds on λ for one labelling; stands: also decide whether λ = 0 is admissible."""
        start = time.perf_counter()
        proof = run_fallbacks(ProofAttempt(self, labels), fallbacks)
        proof.seconds = time.perf_counter() - start
        if stands:
            proof.stands = False if proof.status is Status.UNSTABLE else self.stands(labels, proof.state)
            proof.solves += proof.status is not Status.UNSTABLE
        return proof

    def status_of(self, proof: Proof) -> Status:
        """Return the status that a proof supports: unstable, locked, collapse or uncertified."""
        falls = proof.motion is not None and proof.motion.bound < -proof.motion.noise and not proof.crossed
        if proof.collapse_below_zero is not None or falls:
            return Status.UNSTABLE
        if proof.ray is not None and proof.state is not None:
            return Status.LOCKED
        bounded = np.isfinite(proof.low) and np.isfinite(proof.high)
        return Status.COLLAPSE if bounded else Status.UNCERTIFIED

    def is_open(self, proof: Proof) -> bool:
        """Return True if a bound is missing, or the bracket wider than the gap aimed at.

        False if unstable or locked.
        """
        if proof.status is Status.COLLAPSE:
            return relative_width(proof.low, proof.high, self.load_scale) > self.gap
        return proof.status is Status.UNCERTIFIED

    def unloaded(self, labels: Bits) -> State | None:
        """Return the exact state without forces at λ = 0, or None if there is dead load."""
        if self.template.dead.any():
            return None
        nothing = np.zeros(self.template.scaling.face.shape)
        return State(nothing, 0.0, float(self.template.yield_set.slack(nothing, labels).min()), 0.0)

    def stands(self, labels: Bits, known: State | None = None) -> bool | None:
        """Decide whether λ = 0 is admissible: True without dead load; None if neither state nor motion decides."""
        # With a known state of λ ≥ 0, one that carries the reversed live load proves λ = 0 between them, which saves
        # programs for single labellings.
        if not self.template.dead.any():
            return True
        if (
            known is not None
            and known.load >= 0.0
            and self.single_labelling
            and self.batch_is_faster
            and self.batch is not None
        ):
            found = self.batch.reversed().solve(labels[None], thresholds=np.zeros(1), vectors=True)
            if found.forces is not None and found.low[0] >= 0.0:
                state = self.prover.state(np.append(found.forces[0], -found.low[0]), labels)
                if state.admissible and state.load <= 0.0:
                    return True
        return self.repair.stands(labels)

    @one_thread()
    def solve(self, labels: Bits | None = None, *, stands: bool = True) -> LimitAnalysisResult:
        """Solve one labelling, by default the assembly's: scene units. InputError if a material is missing."""
        start = time.perf_counter()
        labels = self.assembly.labels if labels is None else np.asarray(labels, dtype=bool)
        require_materials(self.assembly, labels, ~labels)
        proof = self.prove(labels, stands=stands)
        elapsed = time.perf_counter() - start
        return result_of(self.template, labels, self.options, proof, assemble=self.seconds, elapsed=elapsed)
