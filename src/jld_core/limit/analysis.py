"""Limit analysis of one assembly under any of its labellings."""

from __future__ import annotations

import math
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.batch import chosen
from jld_core.batch.batch_solver import FALLS, BatchResults, BatchSolver
from jld_core.batch.rows import fits
from jld_core.limit.bounds import (
    FACES_WHERE_BATCH_IS_FASTER,
    Motion,
    Proof,
    Prover,
    State,
    are_disjoint,
    load_scale,
    offer_results,
    relative_width,
)
from jld_core.limit.options import Model, Status
from jld_core.limit.repair import Repair
from jld_core.limit.result import LimitAnalysisResult, result_of
from jld_core.mechanics import require_materials, scaling_of, yield_set
from jld_core.mechanics.standard import InnerBending
from jld_core.program import Template
from jld_core.solvers import ClarabelSolver, HighsSolver, RawSolution, RawStatus, Solver, is_large, make_solver
from jld_core.solvers.base import EARLY
from jld_core.solvers.schur import SchurSolver
from jld_core.threads import one_thread

_LARGE_LOAD: Final = 1e3  # Scaled λ above which a state without an upper bound may be unbounded.
_SIMPLEX_COLUMNS: Final = 6000  # Number of columns up to which a dual simplex is tried.
_VERTEX_COLUMNS: Final = 600  # Number of columns up to which it is tried for digits alone: .05 s.
# Equations from which Schur complements take less time than a dual simplex: 0.3 against 4 s at 1452.
_SCHUR_EQUATIONS: Final = 900
EARLY_FROM: Final = 5000  # number of equations from which a solver may stop at a bracket of relative width `EARLY`

# Batch solvers of assemblies in use, by their id: a search analyses one for its λ, for what stands and for mechanisms.
_batch_solvers: Final[dict[int, dict[tuple[str, bool], BatchSolver]]] = {}


class Analysis(Protocol):
    """Interface to those members of `LimitAnalysis` that `ProofAttempt` uses."""

    assembly: Assembly
    template: Template
    # prover, repair: for `template`
    prover: Prover
    repair: Repair
    first_solver: Solver  # solver of the first attempt
    reference: Bits  # (m,) labelling, True = dry, on which solvers are set up
    margin: float  # slack kept in every yield row while solving, scaled
    gap: float  # relative width of brackets to aim at
    load_scale: float  # scaled λ below which differences are negligible
    single_labelling: bool  # True if only one labelling will be analysed
    options: Model  # model and solver options; `seconds` ends the attempts

    @property
    def batch(self) -> BatchSolver | None:
        """Return the batch solver for labellings of this analysis; None if there is none."""

    @property
    def batch_is_faster(self) -> bool:
        """Return True if the batch solver is faster for one labelling than one solver call."""

    def unloaded(self, labels: Bits) -> State | None:
        """Return the state without forces at λ = 0, or None if there is dead load."""

    def status_of(self, proof: Proof) -> Status:
        """Return the status that a proof supports."""

    def is_open(self, proof: Proof) -> bool:
        pass


class AttemptState:
    """Bounds proven so far for one labelling, and the conditions under which fallbacks are tried.

    raw: last solver answer, from which repairs start; mechanism_found: its mechanism is proven without loss.
    """

    def __init__(self, analysis: Analysis, labels: Bits) -> None:
        self.analysis, self.labels = analysis, labels
        self.template, self.prover, self.repair = analysis.template, analysis.prover, analysis.repair
        self.proof = Proof()
        self.raw: RawSolution | None = None
        self.settled = self.reduction_tried = self.less_margin_tried = False
        self.mechanism_found = False
        self.batch_results: BatchResults | None = None
        unloaded = analysis.unloaded(labels)
        if unloaded is not None:
            self.proof.offer_state(unloaded)

    def adopt(self, other: Proof) -> None:
        """Adopt a finished proof of the same labelling, unless the brackets are disjoint."""
        # If they are disjoint, only its solve log is kept; of a proof that is open, its bounds are kept where they are
        # better.
        proof = self.proof
        proof.solve_log += other.solve_log
        proof.solves += other.solves
        if are_disjoint((other.low, other.high), (proof.low, proof.high)):
            return
        if self.analysis.is_open(other):
            if other.state is not None:
                proof.offer_state(other.state)
            if other.motion is not None:
                proof.offer_motion(other.motion)
        else:
            other.solve_log, other.solves = proof.solve_log, proof.solves
            self.proof, self.settled = other, True

    @property
    def open(self) -> bool:
        """Return True if a bound is missing, or the bracket is wider than the gap aimed at."""
        return self.analysis.is_open(self.proof)

    @property
    def open_with_point(self) -> bool:
        """Return True if the attempt is open and the last answer is a point, not "infeasible"."""
        return self.open and self.raw is not None and self.raw.status is not RawStatus.INFEASIBLE

    @property
    def open_after_reduction(self) -> bool:
        """Return True if facial reduction left a program with cones open; False without cones."""
        return self.open and bool(self.template.structure.cones) and self.reduction_tried

    @property
    def may_be_unbounded(self) -> bool:
        """Return True if λ may be unbounded: large (scaled, above 1000), without an upper bound."""
        state = self.proof.state
        return self.open and self.proof.motion is None and state is not None and state.load > _LARGE_LOAD

    @property
    def reported_unbounded(self) -> bool:
        """Return True if a solver reports unbounded λ and the batch solver was not tried."""
        unbounded = self.raw is not None and self.raw.status is RawStatus.UNBOUNDED
        return self.open and self.batch_results is None and unbounded

    @property
    def batch_goes_first(self) -> bool:
        """Return True if only one labelling is analysed and the batch solver is faster."""
        analysis = self.analysis
        return self.open and analysis.single_labelling and analysis.batch_is_faster and analysis.batch is not None

    @property
    def settled_by_batch(self) -> bool:
        """Return True if the batch solver's bracket is conclusive, and not much wider than other solvers'."""
        if self.batch_results is None or self.open:
            return False
        return not self._narrow or self._width(0.0) <= tolerances.ALONE

    @property
    def is_small_linear(self) -> bool:
        """Return True if the program is linear and small enough for a dual simplex."""
        structure = self.template.structure
        return not structure.cones and structure.shape[1] <= _SIMPLEX_COLUMNS

    @property
    def inaccurate_at_medium_size(self) -> bool:
        """Return True if Clarabel ended early on a linear program that Schur complements solve fast."""
        structure, raw = self.template.structure, self.raw
        medium = not structure.cones and structure.equalities >= _SCHUR_EQUATIONS and not is_large(structure)
        return self.open and medium and raw is not None and raw.status is RawStatus.ALMOST

    @property
    def lacks_large_mechanism(self) -> bool:
        """Return True if a large linear program has an answer, no ray, but no mechanism of its own."""
        structure, raw = self.template.structure, self.raw
        answered = raw is not None and raw.status in (RawStatus.OPTIMAL, RawStatus.ALMOST, RawStatus.LIMIT)
        linear = is_large(structure) and not structure.cones
        return self.open and linear and answered and self.proof.motion is None

    @property
    def stalled_with_cones(self) -> bool:
        """Return True if Schur complements made no further progress on a large program with cones."""
        structure, raw = self.template.structure, self.raw
        solved = bool(structure.cones) and is_large(structure) and structure.equalities < EARLY_FROM
        by_schur = isinstance(self.analysis.first_solver, SchurSolver)
        stalled = raw is not None and raw.status in (RawStatus.ALMOST, RawStatus.LIMIT)
        return self.open and solved and by_schur and stalled

    @property
    def wide_by_crushing(self) -> bool:
        """Return True if crushing leaves a bracket wider than `CRUSHING_WIDTH`; less margin may help."""
        crushing = self.template.precision is tolerances.CRUSHING
        return crushing and self._narrow and self._width(self.analysis.load_scale) > tolerances.CRUSHING_WIDTH

    @property
    def wide_relative_to_load_factor(self) -> bool:
        """Return True if the bracket is narrow by load scale but wide by λ, which is small or zero."""
        return self._narrow and self._width(0.0) > self.analysis.gap

    @property
    def wide_for_single_labelling(self) -> bool:
        """Return True if the collapse bracket of a single labelling is wider than `tolerances.DIGITS`."""
        # A narrower bracket makes the reported λ independent of the order of elements.
        analysis = self.analysis
        improvable = self._narrow and not self.settled_by_batch and not is_large(self.template.structure)
        if not (analysis.single_labelling and improvable):
            return False
        return self._width(analysis.load_scale) > tolerances.DIGITS

    @property
    def _narrow(self) -> bool:
        """Return True if the proof so far has a bracket as narrow as aimed at."""
        return self.proof.status is Status.COLLAPSE and not self.open

    def _width(self, load_scale: float) -> float:
        return relative_width(self.proof.low, self.proof.high, load_scale)


_SMALL_RISE: Final = 1e-10  # Rise of an upper bound, relative to λ, up to which the simplest opening motion is taken.


class ProofAttempt(AttemptState):
    """Solution methods for one labelling: each adds to `proof` the bounds that `Prover` confirms."""

    def solve_by_batch_solver(self) -> None:
        """Offer the bounds of the batch solver; rays too, where immobile faces can only be unloaded."""
        batch = self.analysis.batch
        if batch is None:
            return
        results = self.batch_results = batch.solve(self.labels[None], vectors=True)
        self.proof.solves += 1
        self.proof.solve_log.append("batch solver")
        self._offer_batch_results(results)

    def try_batch_solver_last(self) -> None:
        """Offer the batch solver's bounds where other methods left a wide bracket or a bound missing."""
        if self.batch_results is None:
            self.solve_by_batch_solver()
        else:
            self._offer_batch_results(self.batch_results)

    def _offer_batch_results(self, results: BatchResults) -> None:
        """Offer the bounds, or the instability, that the batch solver's results prove."""
        if results.verdict[0] == FALLS and results.velocity is not None:
            self._offer_instability(results.velocity[0])
        offer_results(results, self.labels, self.proof, self.prover, self.repair.opening)

    def try_batch_solver_first(self) -> None:
        """Solve by the batch solver first, and drop a wide bracket, as the next solver converges better without."""
        proof = self.proof
        state = proof.state
        self.solve_by_batch_solver()
        proof.status = self.analysis.status_of(proof)
        if not self.settled_by_batch:
            proof.state, proof.motion, proof.ray, proof.collapse_below_zero = state, None, None, None

    def solve_by_first_solver(self) -> None:
        """Solve by the solver of the analysis, set up on its reference labelling; see `solve_by`."""
        solver, template, analysis = self.analysis.first_solver, self.template, self.analysis
        solver.prepare(template.structure, lambda: template.program(analysis.reference, analysis.margin))
        self.solve_by(solver, analysis.margin)

    def solve_until_narrow(self) -> None:
        """Solve by Schur complements up to the first iterate of close bounds: later ones may lose in one of them."""
        earlier = self.raw
        self.solve_by(SchurSolver(self.template.precision.residual), self.analysis.margin, early=True)
        if self.raw is not None and self.raw.status is not RawStatus.OPTIMAL:
            self.raw = earlier

    def solve_by(self, solver: Solver, margin: float, *, early: bool = False) -> None:
        """Solve by one solver, and offer the bounds that the raw answer proves without repairs."""
        # The answer is kept in `raw`. If the solver reports an infeasible program, its multipliers are offered as a
        # proof of instability. If it reports an unbounded one, its point becomes the ray of the proof if it is one;
        # otherwise the proof has no ray. The solver of a very large program stops as soon as both bounds of an iterate
        # are close enough.
        program = self.template.program(self.labels, margin)
        early = early or program.structure.equalities >= EARLY_FROM
        raw = self.raw = solver.solve_until(program, self._suffices if early else None)
        self.mechanism_found = False
        proof = self.proof
        proof.solves += 1
        proof.solve_log.append(solver.name if raw.status is RawStatus.OPTIMAL else f"{solver.name} ({raw.status})")
        if raw.status in (RawStatus.INFEASIBLE, RawStatus.NEARLY_INFEASIBLE):
            self._offer_instability(raw.dual)
        elif raw.status is RawStatus.UNBOUNDED:
            ray = self.prover.ray(raw.point, self.labels)
            proof.ray = ray if self.prover.is_ray(ray) else None
        else:
            proof.guess = float(raw.point[-1])
            proof.offer_state(self.prover.state(raw.point, self.labels))
            proof.offer_motion(self.prover.motion(raw.dual, self.labels))

    def _suffices(self, point: Floats, dual: Floats) -> bool:
        """Return True if an iterate of a solver proves a bracket narrow enough to stop."""
        state = self.prover.state(point, self.labels)
        if not state.admissible:
            return False
        motion = self.prover.motion(dual, self.labels)
        enough = min(EARLY, EARLY / tolerances.GAP * self.analysis.gap)
        narrow = relative_width(state.load, motion.bound, 0.0) <= enough
        return motion.margin >= 0.0 and motion.work > 0.0 and narrow

    def _offer_instability(self, dual: Floats) -> None:
        """Offer a proof that no λ ≥ 0 is admissible (docs/method.md (3.15))."""
        # The proof is a motion with Σ D − b·u < 0 and b_λ·u ≥ 0.
        velocity = dual[: self.template.matrix.shape[0]]
        size = float(abs(velocity).max())
        if not (np.isfinite(size) and size > 0.0):
            return
        motion = unopened = self.prover.motion(velocity / size, self.labels, normalise=False)
        if motion.margin < 0.0:
            motion = self._add_opening(motion, normalise=False)
        if motion.margin >= 0.0 and motion.bound < -max(tolerances.ROUNDING, motion.noise):
            # Negative live work proves nothing about large λ, unless the work is zero up to rounding.
            least_work = -1e-3 * tolerances.ROUNDING * float(abs(self.template.live).sum() * abs(motion.velocity).max())
            if motion.work < least_work:
                motion = self.repair.make_work_positive(motion, self.labels)
            if motion.work < least_work:
                # Where a ray carries the live load, the live work cannot be positive: it is zero, and so are the ray's
                # jumps.
                self.proof.solve_log.append("facial reduction")
                self.reduction_tried = True
                motion = self.repair.reduced(unopened, self.labels, normalise=False) or motion
            admissible = motion.margin >= 0.0 and motion.work >= least_work
            if admissible and motion.bound < -max(tolerances.ROUNDING, motion.noise):
                self.proof.collapse_below_zero = motion

    def _add_opening(self, motion: Motion, normalise: bool = True) -> Motion:
        """Add an opening motion to a motion until its dissipation is finite, else reduce faces."""
        # Facial reduction serves confined assemblies, which have no opening motion.
        expansion = self.repair.expansion()
        if expansion is not None:
            opened = self.prover.add_opening(motion, expansion, self.labels)
            rise = opened.bound - motion.bound
            if opened.margin >= 0.0 and rise <= _SMALL_RISE * max(abs(opened.bound), self.analysis.load_scale):
                self.proof.solve_log.append("opened")
                return opened
        opening = self.repair.opening()
        if opening is not None:
            self.proof.solve_log.append("opened")
            return self.prover.add_opening(motion, opening, self.labels)
        self.proof.solve_log.append("facial reduction")
        self.reduction_tried = True
        self.proof.solves += 2
        return self.repair.reduced(motion, self.labels, normalise) or motion

    def find_mechanism(self) -> None:
        """Offer the mechanism of the yield rows whose multipliers are positive in the last raw answer."""
        # If this mechanism does not raise the bound of the raw one, repairs need no other.
        raw, labels = self.raw, self.labels
        if raw is None:
            return
        motion = self.prover.motion(raw.dual, labels)
        projected = self.repair.of_positive_multipliers(motion, raw.dual, labels) if motion.margin < 0.0 else None
        if projected is not None:
            self.proof.solve_log.append("positive multipliers")
            self.proof.offer_motion(projected)
            scale = max(abs(projected.bound), self.analysis.load_scale)
            self.mechanism_found = projected.bound - motion.bound <= _SMALL_RISE * scale

    def repair_answer(self) -> None:
        """Repair the last raw answer of a solver, and offer the bounds that the repair proves."""
        # The answer is blended with strictly admissible states and opening motions.
        raw, proof, labels = self.raw, self.proof, self.labels
        if raw is None or raw.status is RawStatus.INFEASIBLE:
            return
        unbounded = raw.status is RawStatus.UNBOUNDED
        state = self.prover.state(raw.point, labels, passes=3)
        if unbounded or not state.admissible:
            inside = self.repair.state(labels)
            proof.solves += 1
            proof.solve_log.append("state inside")
            if inside is not None:
                proof.offer_state(inside)
                if not unbounded:
                    proof.offer_state(self.prover.blend(state, inside, labels))
            elif unbounded:
                # A program may have a ray but no feasible point; the multipliers of the largest slack prove it.
                self._offer_instability(self.repair.instability_velocities(labels))
        if unbounded:
            if proof.ray is None and proof.collapse_below_zero is None:
                proof.ray = self.repair.ray(labels)
                proof.solves += 1
                proof.solve_log.append("ray inside")
            return
        motion = self.prover.motion(raw.dual, labels)
        if motion.margin < 0.0 and not self.mechanism_found:
            proof.offer_motion(self._add_opening(motion))

    def solve_by_schur_complement(self) -> None:
        """Solve by Schur complements, which keep digits that Clarabel loses; inaccurate answers are dropped."""
        earlier = self.raw
        self.solve_by(SchurSolver(self.template.precision.residual), self.analysis.margin)
        if self.raw is not None and self.raw.status is not RawStatus.OPTIMAL:
            self.raw = earlier

    def solve_by_dual_simplex(self) -> None:
        """Solve by dual simplex for a vertex that is exact to rounding, then repair it."""
        self.solve_by(HighsSolver(), 0.0)
        self.repair_answer()

    def find_boundary_state(self) -> None:
        raw = self.raw
        self.proof.solves += 1
        self.proof.solve_log.append("boundary state")
        point = None if raw is None or raw.status is RawStatus.UNBOUNDED else raw.point
        state: State | None = self.repair.boundary_state(point, self.labels)
        if state is not None:
            self.proof.offer_state(state)

    def find_ray(self) -> None:
        """Find a ray, which proves λ unbounded, where the solver stopped at a large λ."""
        self.proof.solves += 1
        self.proof.solve_log.append("ray inside")
        self.proof.ray = self.repair.ray(self.labels)

    def find_ray_with_self_stress(self) -> None:
        self.proof.solves += 2
        self.proof.solve_log.append("ray beside self-stress")
        self.proof.ray = self.repair.ray_with_self_stress(self.labels)
        if self.proof.ray is not None:
            self.proof.notes.append(
                "locked by forces that grow with the square of the load factor: friction of exactly 45° leaves no room"
            )

    def find_self_stress_states(self) -> None:
        self.proof.solves += 2
        self.proof.solve_log.append("self-stress")
        for state in self.repair.self_stress_states(self.labels):
            self.proof.offer_state(state)

    def solve_without_margin(self) -> None:
        """Solve with refined linear systems and no slack kept in yield rows, and repair the answer."""
        self._solve_refined(self.template.precision.residual, 0.0)

    def solve_with_less_margin(self) -> None:
        """Solve again, once, with refined linear systems and a margin of 1e-11, and repair the answer."""
        # Ten times the margin of linear programs; the first solve of a crushable program has 1e-9.
        if self.less_margin_tried:
            return
        self.less_margin_tried = True
        self._solve_refined(tolerances.LINEAR.residual, 10.0 * tolerances.LINEAR.margin)

    def narrow_bracket(self) -> None:
        """Solve once more by a refined interior point, without margin, crushable programs with a smaller one."""
        # It is as accurate as a vertex of dual simplex, which takes the cube of the number of faces: 6 against .25 s at
        # 1128 faces. Only a small program that stays wide is solved by simplex too.
        if self.template.precision is tolerances.CRUSHING:
            self.solve_with_less_margin()
            return
        self._solve_refined(tolerances.LINEAR.residual, 0.0)
        small = self.is_small_linear and self.template.structure.shape[1] <= _VERTEX_COLUMNS
        if small and self._width(self.analysis.load_scale) > tolerances.DIGITS:
            self.solve_by_dual_simplex()

    def _solve_refined(self, tolerance: float, margin: float) -> None:
        """Solve with refined systems, large structures by Schur complements, and repair the answer."""
        large = is_large(self.template.structure)
        refined = ClarabelSolver(tolerance, iterative_refinement_enable=True)
        self.solve_by(SchurSolver(tolerance, gap=1e-10) if large else refined, margin)
        self.repair_answer()


@dataclass(frozen=True)
class Fallback:
    """One named solution method with the condition under which it is tried."""

    name: str
    when: Callable[[ProofAttempt], bool]  # takes the `ProofAttempt`; returns True if the method is to be tried
    # takes the `ProofAttempt`, tries the method and offers its bounds to `ProofAttempt.proof`
    run: Callable[[ProofAttempt], None]
    supplies: str  # description of the bounds that the method may supply


FALLBACKS: Final = (  # solution methods that `LimitAnalysis.prove` tries by default, in order
    Fallback(
        "batch solver",
        lambda attempt: attempt.batch_goes_first,
        ProofAttempt.try_batch_solver_first,
        "both bounds, where one labelling alone is analysed",
    ),
    Fallback(
        "first solver",
        lambda attempt: not attempt.settled_by_batch,
        ProofAttempt.solve_by_first_solver,
        "both bounds, from forces and multipliers of an interior point",
    ),
    Fallback(
        "Schur complement",
        lambda attempt: attempt.inaccurate_at_medium_size,
        ProofAttempt.solve_by_schur_complement,
        "both bounds of a linear program of some thousand equations",
    ),
    Fallback(
        "mechanism",
        lambda attempt: attempt.lacks_large_mechanism,
        ProofAttempt.find_mechanism,
        "an upper bound of a large linear program, from the signs of multipliers",
    ),
    Fallback(
        "Schur complement stopped early",
        lambda attempt: attempt.stalled_with_cones,
        ProofAttempt.solve_until_narrow,
        "both bounds of a program with cones, from an iterate before the last",
    ),
    Fallback(
        "repair",
        lambda attempt: attempt.open_with_point,
        ProofAttempt.repair_answer,
        "states blended with a strictly admissible one, opened motions, rays",
    ),
    Fallback(
        "ray by batch solver",
        lambda attempt: attempt.reported_unbounded,
        ProofAttempt.solve_by_batch_solver,
        "a ray, where some faces can only be unloaded",
    ),
    # Try a vertex before a boundary state: it separates unstable structures from those that barely stand.
    Fallback(
        "dual simplex",
        lambda attempt: attempt.open and attempt.is_small_linear,
        ProofAttempt.solve_by_dual_simplex,
        "both bounds of a linear program, exact to rounding",
    ),
    Fallback(
        "boundary state",
        lambda attempt: attempt.open_with_point,
        ProofAttempt.find_boundary_state,
        "a state in yield sets without interior",
    ),
    Fallback(
        "ray",
        lambda attempt: attempt.may_be_unbounded,
        ProofAttempt.find_ray,
        "a ray, where the solver stopped at a very large λ",
    ),
    Fallback(
        "ray with self-stress",
        lambda attempt: attempt.may_be_unbounded and bool(attempt.template.structure.cones),
        ProofAttempt.find_ray_with_self_stress,
        "a ray that is admissible together with a self-stress that grows faster",
    ),
    Fallback(
        "self-stress",
        lambda attempt: attempt.open_after_reduction,
        ProofAttempt.find_self_stress_states,
        "a state that relies on a self-stress at the boundary of the friction cones",
    ),
    Fallback(
        "no margin",
        lambda attempt: attempt.open,
        ProofAttempt.solve_without_margin,
        "both bounds, for yield sets that leave no margin",
    ),
    Fallback(
        "boundary state again",
        lambda attempt: attempt.open_with_point,
        ProofAttempt.find_boundary_state,
        "a state in yield sets without interior, from the more accurate answer",
    ),
    Fallback(
        "less margin",
        lambda attempt: attempt.wide_by_crushing,
        ProofAttempt.solve_with_less_margin,
        "a narrower bracket of crushable scenes",
    ),
    Fallback(
        "narrow bracket",
        lambda attempt: attempt.wide_for_single_labelling,
        ProofAttempt.narrow_bracket,
        "digits of λ that a wide bracket leaves open",
    ),
    Fallback(
        "small λ",
        lambda attempt: attempt.wide_relative_to_load_factor and attempt.is_small_linear,
        ProofAttempt.solve_by_dual_simplex,
        "a bracket that shows whether λ is small or zero",
    ),
    Fallback(
        "batch solver last",
        lambda attempt: attempt.open,
        ProofAttempt.try_batch_solver_last,
        "bounds where all others left some open",
    ),
)


def insert_before(fallbacks: tuple[Fallback, ...], name: str, inserted: Fallback) -> tuple[Fallback, ...]:
    names = [fallback.name for fallback in fallbacks]
    if name not in names:
        raise ValueError(f"there is no fallback {name!r}; expected one of {', '.join(names)}")
    position = names.index(name)
    return (*fallbacks[:position], inserted, *fallbacks[position:])


def run_fallbacks(attempt: ProofAttempt, fallbacks: tuple[Fallback, ...]) -> Proof:
    """Run every method whose condition holds, in order, until the attempt is settled."""
    limit = attempt.analysis.options.seconds
    until = math.inf if limit is None else time.perf_counter() + limit
    for fallback in fallbacks:
        if attempt.proof.solve_log and time.perf_counter() > until:
            break
        if fallback.when(attempt) and not attempt.settled:
            fallback.run(attempt)
            if not attempt.settled:
                attempt.proof.status = attempt.analysis.status_of(attempt.proof)
    return attempt.proof


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
        start = time.process_time()
        self.assembly, self.gap, self.single_labelling = assembly, gap, single_labelling
        self.options = Model(inner_bending=inner_bending, condense="off", solver=solver, gap=gap, seconds=seconds)
        self._own_template = template is None
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
        self.seconds = time.process_time() - start

    @cached_property
    def batch(self) -> BatchSolver | None:
        """Return the batch solver; None with a named solver, without library, or for unsupported rows."""
        if self.options.solver != "auto" or chosen() is None or not fits(self.template):
            return None
        if not self._own_template:
            return self._new_batch()
        if id(self.assembly) not in _batch_solvers:
            weakref.finalize(self.assembly, _batch_solvers.pop, id(self.assembly), None)
        cache = _batch_solvers.setdefault(id(self.assembly), {})
        key = f"{chosen()} {self.options.inner_bending}", self.single_labelling
        if key not in cache:
            cache[key] = self._new_batch()
        return cache[key]

    def _new_batch(self) -> BatchSolver:
        # An expansion opens every face as `opening` does, but needs no program, which one labelling would not repay.
        expansion = self.repair.expansion() if self.single_labelling else None
        opening = self.repair.opening() if expansion is None else expansion
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
        start = time.process_time()
        proof = run_fallbacks(ProofAttempt(self, labels), fallbacks)
        proof.seconds = time.process_time() - start
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
        """Return True if a bound is missing or the bracket too wide; False if unstable or locked."""
        if proof.status is Status.COLLAPSE:
            return relative_width(proof.low, proof.high, self.load_scale) > self.gap
        return proof.status is Status.UNCERTIFIED

    def unloaded(self, labels: Bits) -> State | None:
        """Return the exact state without forces at λ = 0, or None if there is dead load."""
        if self.template.dead.any():
            return None
        zeros = np.zeros(self.template.scaling.face.shape)
        return State(zeros, 0.0, float(self.template.yield_set.slack(zeros, labels).min()), 0.0)

    def stands(self, labels: Bits, known: State | None = None) -> bool | None:
        """Decide whether λ = 0 is admissible: True without dead load; None if neither state nor motion decides."""
        # With a known state of λ ≥ 0, one that carries the reversed live load proves λ = 0 between them, which saves
        # programs for single labellings.
        if not self.template.dead.any():
            return True
        batch = self.batch if self.single_labelling and self.batch_is_faster else None
        if batch is not None and known is not None and known.load >= 0.0:
            results = batch.reversed().solve(labels[None], thresholds=np.zeros(1), vectors=True)
            if results.forces is not None and results.low[0] >= 0.0:
                state = self.prover.state(np.append(results.forces[0], -results.low[0]), labels)
                if state.admissible and state.load <= 0.0:
                    return True
        return self.repair.stands(labels)

    @one_thread()
    def solve(self, labels: Bits | None = None, *, stands: bool = True) -> LimitAnalysisResult:
        """Solve one labelling, by default the assembly's: scene units. InputError if a material is missing."""
        start = time.process_time()
        labels = self.assembly.labels if labels is None else np.asarray(labels, dtype=bool)
        require_materials(self.assembly, labels, ~labels)
        proof = self.prove(labels, stands=stands)
        elapsed = time.process_time() - start
        return result_of(self.template, labels, self.options, proof, assemble=self.seconds, elapsed=elapsed)
