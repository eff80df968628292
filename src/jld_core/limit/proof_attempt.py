"""Try one solution method after another on one labelling.

Everything that a method offers is checked by `Prover` before it counts.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.batch.batch_solver import FALLS, BatchResults, BatchSolver
from jld_core.limit.batch_results import offer_results
from jld_core.limit.bounds import Motion, Prover, State, apart, relative_width
from jld_core.limit.options import Model, Status
from jld_core.limit.proof import Proof
from jld_core.limit.repair import Repair
from jld_core.program import Template
from jld_core.solvers import ClarabelSolver, HighsSolver, RawSolution, RawStatus, Solver, is_large
from jld_core.solvers.base import EARLY
from jld_core.solvers.schur.system import SchurSolver

_GROWS: Final = 1e3  # Scaled λ above which a state without an upper bound may be unbounded.
_SIMPLEX: Final = 6000  # Number of columns up to which a dual simplex is tried.
_VERTEX: Final = 600  # Number of columns up to which it is tried for digits alone: .05 s.
_SCHUR: Final = (
    900  # Equations from which Schur complements take less time than a dual simplex: 0.3 against 4 s at 1452.
)
EARLY_FROM: Final = 5000
"""Number of equations from which a solver may stop at a bracket of relative width `EARLY`."""


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

    def adopt(self, found: Proof) -> None:
        """Adopt a finished proof of the same labelling, unless the brackets are disjoint."""
        # If they are disjoint, only its solve log is kept; of a proof that is open, its bounds are kept where they are
        # better.
        mine = self.proof
        mine.solve_log += found.solve_log
        mine.solves += found.solves
        if apart((found.low, found.high), (mine.low, mine.high)):
            return
        if self.analysis.is_open(found):
            if found.state is not None:
                mine.offer_state(found.state)
            if found.motion is not None:
                mine.offer_motion(found.motion)
        else:
            found.solve_log, found.solves = mine.solve_log, mine.solves
            self.proof, self.settled = found, True

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
        return self.open and self.proof.motion is None and state is not None and state.load > _GROWS

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
        return not structure.cones and structure.shape[1] <= _SIMPLEX

    @property
    def inaccurate_at_medium_size(self) -> bool:
        """Return True if Clarabel ended early on a linear program that Schur complements solve fast."""
        structure, raw = self.template.structure, self.raw
        medium = not structure.cones and structure.equalities >= _SCHUR and not is_large(structure)
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
        if (
            not analysis.single_labelling
            or not self._narrow
            or self.settled_by_batch
            or is_large(self.template.structure)
        ):
            return False
        return self._width(analysis.load_scale) > tolerances.DIGITS

    @property
    def _narrow(self) -> bool:
        """Return True if the proof so far has a bracket as narrow as aimed at."""
        return self.proof.status is Status.COLLAPSE and not self.open

    def _width(self, load_scale: float) -> float:
        """Return the width of the bracket relative to its ends, or to `load_scale` if larger."""
        return relative_width(self.proof.low, self.proof.high, load_scale)


_NARROW: Final = 1e-10  # Rise of an upper bound, relative to λ, up to which the simplest opening motion is taken.


class ProofAttempt(AttemptState):
    """Solution methods for one labelling: each adds to `proof` the bounds that `Prover` confirms."""

    def solve_by_batch_solver(self) -> None:
        """Offer the bounds of the batch solver; rays too, where immobile faces can only be unloaded."""
        batch = self.analysis.batch
        if batch is None:
            return
        found = self.batch_results = batch.solve(self.labels[None], vectors=True)
        self.proof.solves += 1
        self.proof.solve_log.append("batch solver")
        self._offer_batch_results(found)

    def try_batch_solver_last(self) -> None:
        """Offer the batch solver's bounds where other methods left a wide bracket or a bound missing."""
        if self.batch_results is None:
            self.solve_by_batch_solver()
        else:
            self._offer_batch_results(self.batch_results)

    def _offer_batch_results(self, found: BatchResults) -> None:
        """Offer the bounds, or the instability, that the batch solver's results prove."""
        if found.verdict[0] == FALLS and found.velocity is not None:
            self._offer_instability(found.velocity[0])
        offer_results(found, self.labels, self.proof, self.prover, self.repair.opening)

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
        route, template, analysis = self.analysis.first_solver, self.template, self.analysis
        route.prepare(template.structure, lambda: template.program(analysis.reference, analysis.margin))
        self.solve_by(route, analysis.margin)

    def solve_until_narrow(self) -> None:
        """Solve by Schur complements up to the first iterate of close bounds: later ones may lose in one of them."""
        earlier = self.raw
        self.solve_by(SchurSolver(self.template.precision.residual), self.analysis.margin, early=True)
        if self.raw is not None and self.raw.status is not RawStatus.OPTIMAL:
            self.raw = earlier

    def solve_by(self, route: Solver, margin: float, *, early: bool = False) -> None:
        """Solve by one solver, and offer the bounds that the raw answer proves without repairs."""
        # The answer is kept in `raw`. If the solver reports an infeasible program, its multipliers are offered as a
        # proof of instability. If it reports an unbounded one, its point becomes the ray of the proof if it is one;
        # otherwise the proof has no ray. The solver of a very large program stops as soon as both bounds of an iterate
        # are close enough.
        program = self.template.program(self.labels, margin)
        early = early or program.structure.equalities >= EARLY_FROM
        raw = self.raw = route.solve_until(program, self._suffices if early else None)
        self.mechanism_found = False
        proof = self.proof
        proof.solves += 1
        proof.solve_log.append(route.name if raw.status is RawStatus.OPTIMAL else f"{route.name} ({raw.status})")
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
        width = relative_width(state.load, motion.bound, 0.0)
        return (
            motion.margin >= 0.0
            and motion.work > 0.0
            and width <= min(EARLY, EARLY / tolerances.GAP * self.analysis.gap)
        )

    def _offer_instability(self, dual: Floats) -> None:
        """Offer a proof that no λ ≥ 0 is admissible (docs/method.md (3.15))."""
        # The proof is a motion with Σ D − b·u < 0 and b_λ·u ≥ 0.
        velocity = dual[: self.template.matrix.shape[0]]
        size = float(abs(velocity).max())
        if not (np.isfinite(size) and size > 0.0):
            return
        motion = given = self.prover.motion(velocity / size, self.labels, normalise=False)
        if motion.margin < 0.0:
            motion = self._opened(motion, normalise=False)
        if motion.margin >= 0.0 and motion.bound < -max(tolerances.ROUNDING, motion.noise):
            # Negative live work proves nothing about large λ, unless the work is zero up to rounding.
            idle = -1e-3 * tolerances.ROUNDING * float(abs(self.template.live).sum() * abs(motion.velocity).max())
            if motion.work < idle:
                motion = self.repair.make_work_positive(motion, self.labels)
            if motion.work < idle:
                # Where a ray carries the live load, the live work cannot be positive: it is zero, and so are the ray's
                # jumps.
                self.proof.solve_log.append("facial reduction")
                self.reduction_tried = True
                motion = self.repair.reduced(given, self.labels, normalise=False) or motion
            fine = motion.margin >= 0.0 and motion.work >= idle
            if fine and motion.bound < -max(tolerances.ROUNDING, motion.noise):
                self.proof.collapse_below_zero = motion

    def _opened(self, motion: Motion, normalise: bool = True) -> Motion:
        """Add an opening motion to a motion until its dissipation is finite, else reduce faces."""
        # Facial reduction serves confined assemblies, which have no opening motion.
        simple = self.repair.expansion()
        if simple is not None:
            opened = self.prover.add_opening(motion, simple, self.labels)
            raised = opened.bound - motion.bound
            if opened.margin >= 0.0 and raised <= _NARROW * max(abs(opened.bound), self.analysis.load_scale):
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
        found = self.repair.of_positive_multipliers(motion, raw.dual, labels) if motion.margin < 0.0 else None
        if found is not None:
            self.proof.solve_log.append("positive multipliers")
            self.proof.offer_motion(found)
            scale = max(abs(found.bound), self.analysis.load_scale)
            self.mechanism_found = found.bound - motion.bound <= _NARROW * scale

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
            proof.offer_motion(self._opened(motion))

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
        small = self.is_small_linear and self.template.structure.shape[1] <= _VERTEX
        if small and self._width(self.analysis.load_scale) > tolerances.DIGITS:
            self.solve_by_dual_simplex()

    def _solve_refined(self, tolerance: float, margin: float) -> None:
        """Solve with refined systems, large structures by Schur complements, and repair the answer."""
        large = is_large(self.template.structure)
        refined = ClarabelSolver(tolerance, iterative_refinement_enable=True)
        self.solve_by(SchurSolver(tolerance, gap=1e-10) if large else refined, margin)
        self.repair_answer()
