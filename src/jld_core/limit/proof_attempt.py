"""Fallbacks by which bounds for one labelling are proven, tried only as far as needed.

Each entry of `FALLBACKS` states when it is tried and what it offers. Everything offered is checked by `Prover` before
it counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.batch.batch_solver import FALLS, BatchSolver
from jld_core.limit.batch_results import offer
from jld_core.limit.bounds import Motion, Prover, State, apart, relative_width
from jld_core.limit.proof import Proof
from jld_core.limit.repair import Repair
from jld_core.limit.status import Status
from jld_core.program import Template
from jld_core.solvers import ClarabelSolver, HighsSolver, RawSolution, RawStatus, Solver, is_large
from jld_core.solvers.schur.interior_point import SchurSolver

_GROWS: Final = 1e3  # Scaled λ above which a state without an upper bound may be unbounded.
_NARROW: Final = 1e-10  # Rise of an upper bound, relative to λ, up to which the simplest opening motion is taken.
_SIMPLEX: Final = 6000  # Number of columns up to which a dual simplex is tried.


class Analysis(Protocol):
    """Interface of `LimitAnalysis` that `ProofAttempt` needs."""

    assembly: Assembly
    template: Template
    prover: Prover
    repair: Repair
    route: Solver
    reference: Bits
    margin: float
    gap: float
    floor: float
    single: bool

    @property
    def batch(self) -> BatchSolver | None:
        """Return the batch solver for labellings of this analysis."""

    @property
    def quick(self) -> bool:
        """Return True if the batch solver is faster for one labelling than one solver call."""

    def unloaded(self, labels: Bits) -> State | None:
        """Return the state without forces at λ = 0, where there is no dead load."""

    def judge(self, proof: Proof) -> Status:
        """Return the status that a proof supports."""


class ProofAttempt:
    """Mutable state while fallbacks are tried for one labelling.

    Parameters
    ----------
    analysis : Analysis
        Limit analysis of the assembly.
    labels : (m,) bool array
        Labels, True = dry.

    Attributes
    ----------
    proof : Proof
        Bounds proven so far.
    raw : RawSolution or None
        Last raw solver answer, from which repairs start.
    settled : bool
        True if no further fallback is to be tried.
    """

    def __init__(self, analysis: Analysis, labels: Bits) -> None:
        self.analysis, self.labels = analysis, labels
        self.template, self.prover, self.repair = analysis.template, analysis.prover, analysis.repair
        self.proof = Proof()
        self.raw: RawSolution | None = None
        self.settled = False
        unloaded = analysis.unloaded(labels)
        if unloaded is not None:
            self.proof.offer_state(unloaded)

    def up(self, ladder: tuple[Fallback, ...]) -> Proof:
        """Try all fallbacks whose condition holds, in order.

        Parameters
        ----------
        ladder : tuple of Fallback
            Solution methods, in the order in which they are tried.

        Returns
        -------
        Proof
            Bounds and status after the last fallback.
        """
        for rung in ladder:
            if rung.when(self) and not self.settled:
                rung.take(self)
                if not self.settled:
                    self.proof.status = self.analysis.judge(self.proof)
        return self.proof

    def take(self, found: Proof) -> None:
        """Adopt a finished proof of the same labelling, unless the brackets are disjoint.

        If they are disjoint, only the solve log of the finished proof is kept.

        Parameters
        ----------
        found : Proof
            Finished proof, scaled.
        """
        mine = self.proof
        mine.route += found.route
        mine.solves += found.solves
        if not apart((found.low, found.high), (mine.low, mine.high)):
            found.route, found.solves = mine.route, mine.solves
            self.proof, self.settled = found, True

    # --- when -------------------------------------------------------------------------------------------

    @property
    def open(self) -> bool:
        """Return True if the status is still uncertified."""
        return self.proof.status is Status.UNCERTIFIED

    @property
    def open_inside(self) -> bool:
        """Return True if the status is uncertified and the last raw answer is not infeasible."""
        return self.open and self.raw is not None and self.raw.status is not RawStatus.INFEASIBLE

    @property
    def reduced(self) -> bool:
        """Return True if the bracket is open although facial reduction was tried.

        It applies only to programs with friction cones, which the reduction replaces by rays.
        """
        return self.open and bool(self.template.structure.cones) and "facial reduction" in self.proof.route

    @property
    def grows(self) -> bool:
        """Return True if λ is so large without an upper bound that it may be unbounded."""
        state = self.proof.state
        return self.open and self.proof.motion is None and state is not None and state.load > _GROWS

    @property
    def runs_away(self) -> bool:
        """Return True if the last raw answer is unbounded and the batch solver has not been tried."""
        unasked = "lanes" not in self.proof.route
        return self.open and unasked and self.raw is not None and self.raw.status is RawStatus.UNBOUNDED

    @property
    def alone(self) -> bool:
        """Return True if only one labelling is analysed and the batch solver is faster."""
        analysis = self.analysis
        return self.open and analysis.single and analysis.quick and analysis.batch is not None

    @property
    def settled_by_batch(self) -> bool:
        """Return True if the batch solver's bracket is conclusive and narrow enough.

        A bracket much wider than those of other solvers does not count.
        """
        if "lanes" not in self.proof.route or self.open:
            return False
        return not self._collapses or self._width(0.0) <= tolerances.ALONE

    @property
    def linear(self) -> bool:
        """Return True if the program is linear and small enough for a dual simplex."""
        structure = self.template.structure
        return not structure.cones and structure.shape[1] <= _SIMPLEX

    @property
    def crushed_wide(self) -> bool:
        """Return True if crushing leaves the bracket wider than `CRUSHING_WIDTH`.

        A smaller margin than most crushable scenes need may then narrow it.
        """
        crushing = self.template.precision is tolerances.CRUSHING
        return crushing and self._collapses and self._width(self.analysis.floor) > tolerances.CRUSHING_WIDTH

    @property
    def wide_beside_load(self) -> bool:
        """Return True if the bracket is narrow relative to the load scale but wide relative to λ.

        λ may then be small, or zero.
        """
        return self._collapses and self._width(0.0) > self.analysis.gap

    @property
    def wide_alone(self) -> bool:
        """Return True if the bracket of a labelling solved alone leaves digits of λ open.

        Where λ is in a wide bracket depends on the order of the elements. Searches do not need these digits.
        """
        analysis = self.analysis
        if not analysis.single or not self._collapses or self.settled_by_batch or is_large(self.template.structure):
            return False
        return self._width(analysis.floor) > tolerances.DIGITS

    @property
    def _collapses(self) -> bool:
        """Return True if the status is collapse."""
        return self.proof.status is Status.COLLAPSE

    def _width(self, floor: float) -> float:
        """Return the width of the bracket relative to its ends, or to `floor` if larger."""
        return relative_width(self.proof.low, self.proof.high, floor)

    # --- what is tried ----------------------------------------------------------------------------------

    def batched(self) -> None:
        """Solve by the batch solver and offer what it proves.

        It also finds rays for structures in which some immobile faces can only be unloaded.
        """
        batch = self.analysis.batch
        if batch is None:
            return
        found = batch.solve(self.labels[None], vectors=True)
        self.proof.solves += 1
        self.proof.route.append("lanes")
        if found.verdict[0] == FALLS and found.velocity is not None:
            self._offer_instability(found.velocity[0])
        offer(found, self.labels, self.proof, self.prover, self.repair.opening)

    def alone_in_lanes(self) -> None:
        """Solve by the batch solver before any other solver, and drop a wide bracket.

        The next solver converges better without the bounds of a wide bracket.
        """
        proof = self.proof
        state = proof.state
        self.batched()
        proof.status = self.analysis.judge(proof)
        if not self.settled_by_batch:
            proof.state, proof.motion, proof.ray, proof.collapse_below_zero = state, None, None, None

    def solve(self) -> None:
        """Solve by the solver of the analysis."""
        route, template, analysis = self.analysis.route, self.template, self.analysis
        route.prepare(template.structure, lambda: template.program(analysis.reference, analysis.margin))
        self.attempt(route, analysis.margin)

    def attempt(self, route: Solver, margin: float) -> None:
        """Solve by one solver and offer what its raw answer proves.

        Parameters
        ----------
        route : Solver
            Solver to run.
        margin : float
            Slack kept in every yield row, scaled.
        """
        raw = self.raw = route.solve(self.template.program(self.labels, margin))
        proof = self.proof
        proof.solves += 1
        proof.route.append(route.name if raw.status is RawStatus.OPTIMAL else f"{route.name} ({raw.status})")
        if raw.status is RawStatus.INFEASIBLE:
            self._offer_instability(raw.dual)
        elif raw.status is RawStatus.UNBOUNDED:
            ray = self.prover.ray(raw.point, self.labels)
            proof.ray = ray if self.prover.is_ray(ray) else None
        else:
            proof.guess = float(raw.point[-1])
            proof.offer_state(self.prover.state(raw.point, self.labels))
            proof.offer_motion(self.prover.motion(raw.dual, self.labels))

    def _offer_instability(self, dual: Floats) -> None:
        """Offer a proof that no λ ≥ 0 is admissible (docs/method.md (3.15)).

        The proof is a motion with Σ D − b·u < 0 and b_λ·u ≥ 0.
        """
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
                self.proof.route.append("facial reduction")
                motion = self.repair.reduced(given, self.labels, normalise=False) or motion
            fine = motion.margin >= 0.0 and motion.work >= idle
            if fine and motion.bound < -max(tolerances.ROUNDING, motion.noise):
                self.proof.collapse_below_zero = motion

    def _opened(self, motion: Motion, normalise: bool = True) -> Motion:
        """Make the dissipation finite by an opening motion, else by facial reduction.

        Facial reduction serves confined assemblies.
        """
        simple = self.repair.expansion()
        if simple is not None:
            opened = self.prover.open_up(motion, simple, self.labels)
            raised = opened.bound - motion.bound
            if opened.margin >= 0.0 and raised <= _NARROW * max(abs(opened.bound), self.analysis.floor):
                self.proof.route.append("opened")
                return opened
        opening = self.repair.opening()
        if opening is not None:
            self.proof.route.append("opened")
            return self.prover.open_up(motion, opening, self.labels)
        self.proof.route.append("facial reduction")
        self.proof.solves += 2
        return self.repair.reduced(motion, self.labels, normalise) or motion

    def repair_answer(self) -> None:
        """Repair the last raw answer and offer the results.

        The answer is blended with strictly admissible states and opening motions.
        """
        raw, proof, labels = self.raw, self.proof, self.labels
        if raw is None or raw.status is RawStatus.INFEASIBLE:
            return
        unbounded = raw.status is RawStatus.UNBOUNDED
        state = self.prover.state(raw.point, labels, passes=3)
        if unbounded or not state.admissible:
            inside = self.repair.state(labels)
            proof.solves += 1
            proof.route.append("state inside")
            if inside is not None:
                proof.offer_state(inside)
                if not unbounded:
                    proof.offer_state(self.prover.blend(state, inside, labels))
            elif unbounded:
                # A program may have a ray but no feasible point; the multipliers of the largest slack prove it.
                self._offer_instability(self.repair.fall(labels))
        if unbounded:
            if proof.ray is None and proof.collapse_below_zero is None:
                proof.ray = self.repair.ray(labels)
                proof.solves += 1
                proof.route.append("ray inside")
            return
        motion = self.prover.motion(raw.dual, labels)
        if motion.margin < 0.0:
            proof.offer_motion(self._opened(motion))

    def vertex(self) -> None:
        """Solve by dual simplex for a vertex that is exact to rounding, then repair it."""
        self.attempt(HighsSolver(), 0.0)
        self.repair_answer()

    def edge(self) -> None:
        """Offer a state in yield sets without interior, where no other method found one."""
        raw = self.raw
        self.proof.solves += 1
        self.proof.route.append("edge")
        point = None if raw is None or raw.status is RawStatus.UNBOUNDED else raw.point
        state: State | None = self.repair.edge_state(point, self.labels)
        if state is not None:
            self.proof.offer_state(state)

    def ray(self) -> None:
        """Find a ray where the solver stopped at a large λ."""
        self.proof.solves += 1
        self.proof.route.append("ray inside")
        self.proof.ray = self.repair.ray(self.labels)

    def ray_beside_self_stress(self) -> None:
        """Find a ray that a self-stress at the boundary of the friction cones makes admissible."""
        self.proof.solves += 2
        self.proof.route.append("ray beside self-stress")
        self.proof.ray = self.repair.ray_beside_self_stress(self.labels)
        if self.proof.ray is not None:
            self.proof.notes.append(
                "locked by forces that grow with the square of the load factor: friction of exactly 45° leaves no room"
            )

    def lean(self) -> None:
        """Offer states that rely on a self-stress at the boundary of the friction cones."""
        self.proof.solves += 2
        self.proof.route.append("self-stress")
        for state in self.repair.leaning(self.labels):
            self.proof.offer_state(state)

    def unshrunk(self) -> None:
        """Solve by an interior-point method with refined linear systems and no margin."""
        self._refined(self.template.precision.residual, 0.0)

    def less_margin(self) -> None:
        """Solve by a refined interior-point method with a smaller margin.

        The margin is ten times that of linear programs.
        """
        self._refined(tolerances.LINEAR.residual, 10.0 * tolerances.LINEAR.margin)

    def narrow(self) -> None:
        """Narrow a bracket by the most accurate solver of each kind of program."""
        if self.linear:
            self.vertex()
        elif self.template.precision is tolerances.CRUSHING:
            self.less_margin()
        else:
            self._refined(tolerances.LINEAR.residual, 0.0)

    def _refined(self, tolerance: float, margin: float) -> None:
        """Solve with refined linear systems and repair the answer.

        Large structures use the Schur complement solver instead of iterative refinement.
        """
        large = is_large(self.template.structure)
        refined = ClarabelSolver(tolerance, iterative_refinement_enable=True)
        self.attempt(SchurSolver(tolerance, gap=1e-10) if large else refined, margin)
        self.repair_answer()


@dataclass(frozen=True)
class Fallback:
    """One named solution method with the condition under which it is tried.

    Attributes
    ----------
    name : str
        Name of the fallback.
    when : callable
        Takes the `ProofAttempt`; returns True if the fallback is to be tried.
    take : callable
        Takes the `ProofAttempt` and tries the fallback.
    offers : str
        Bounds that the fallback may supply.
    """

    name: str
    when: Callable[[ProofAttempt], bool]
    take: Callable[[ProofAttempt], None]
    offers: str


FALLBACKS: Final = (
    Fallback(
        "lanes", lambda c: c.alone, ProofAttempt.alone_in_lanes, "both sides by the kernel, of one labelling alone"
    ),
    Fallback(
        "first", lambda c: not c.settled_by_batch, ProofAttempt.solve, "forces and multipliers of an interior point"
    ),
    Fallback(
        "repair",
        lambda c: c.open_inside,
        ProofAttempt.repair_answer,
        "states blended with one well inside, opened motions, rays",
    ),
    Fallback(
        "ray in lanes", lambda c: c.runs_away, ProofAttempt.batched, "a ray where some faces can only be unpressed"
    ),
    # Try a vertex before an edge state: it separates unstable structures from those that barely stand.
    Fallback(
        "vertex",
        lambda c: c.open and c.linear,
        ProofAttempt.vertex,
        "both sides of a linear program, exact to rounding",
    ),
    Fallback("edge", lambda c: c.open_inside, ProofAttempt.edge, "a state where yield sets leave no room"),
    Fallback("ray", lambda c: c.grows, ProofAttempt.ray, "a ray where the solver stopped on its way to infinity"),
    Fallback(
        "ray beside self-stress",
        lambda c: c.grows and bool(c.template.structure.cones),
        ProofAttempt.ray_beside_self_stress,
        "a ray that is admissible beside a self-stress that grows faster",
    ),
    Fallback(
        "self-stress",
        lambda c: c.reduced,
        ProofAttempt.lean,
        "a state that leans on self-stress at friction's boundary",
    ),
    Fallback(
        "unshrunk",
        lambda c: c.open,
        ProofAttempt.unshrunk,
        "an interior point without margin, for sets that leave none",
    ),
    Fallback("last edge", lambda c: c.open_inside, ProofAttempt.edge, "the same, from the better answer"),
    Fallback(
        "less margin", lambda c: c.crushed_wide, ProofAttempt.less_margin, "a narrower bracket of crushable scenes"
    ),
    Fallback("narrow", lambda c: c.wide_alone, ProofAttempt.narrow, "digits of λ that a wide bracket leaves open"),
    Fallback("small λ", lambda c: c.wide_beside_load and c.linear, ProofAttempt.vertex, "whether λ is small or zero"),
)
"""Solution methods that `LimitAnalysis.prove` tries by default, in order."""
