"""The rungs by which one labelling is proven: solve, repair, try other ways, only as far as it takes.

`FALLBACKS` says when each rung is tried and what it offers; what it offers is checked (`Prover`) and believed only
then.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.batch import FALLS, BatchSolver
from jld_core.limit.batch_results import offer
from jld_core.limit.bounds import Motion, Prover, State, apart, relative_width
from jld_core.limit.proof import Proof
from jld_core.limit.repair import Repair
from jld_core.limit.status import Status
from jld_core.program import Template
from jld_core.solvers import ClarabelSolver, HighsSolver, RawSolution, RawStatus, SchurSolver, Solver, is_large

_GROWS: Final = 1e3  # λ, scaled, from which it may have no end
_SIMPLEX: Final = 6000  # columns up to which a dual simplex is a way out


class Analysis(Protocol):
    """What a `ProofAttempt` asks of a `LimitAnalysis`."""

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
        """The batch solver for labellings of this analysis."""

    @property
    def quick(self) -> bool:
        """Is a batch solver made and asked sooner than a solver answers one labelling?"""

    def unloaded(self, labels: Bits) -> State | None:
        """The state without any force, where nothing loads the structure at λ = 0."""

    def judge(self, proof: Proof) -> Status:
        """The status that a proof amounts to."""


class ProofAttempt:
    """One labelling on its way up: what is proven so far, and the raw answer that repairs begin with.

    labels: (m,) True dry. settled: nothing further is to be tried.
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
        """The proof after all rungs that its state asks for."""
        for rung in ladder:
            if rung.when(self) and not self.settled:
                rung.take(self)
                if not self.settled:
                    self.proof.status = self.analysis.judge(self.proof)
        return self.proof

    def take(self, found: Proof) -> None:
        """Take a finished proof of the same labelling, unless it contradicts what is proven: then it proves nothing."""
        mine = self.proof
        mine.route += found.route
        mine.solves += found.solves
        if not apart((found.low, found.high), (mine.low, mine.high)):
            found.route, found.solves = mine.route, mine.solves
            self.proof, self.settled = found, True

    # --- when -------------------------------------------------------------------------------------------

    @property
    def open(self) -> bool:
        """Is nothing certain yet?"""
        return self.proof.status is Status.UNCERTIFIED

    @property
    def open_inside(self) -> bool:
        """The same, of a program that the last raw answer does not call infeasible."""
        return self.open and self.raw is not None and self.raw.status is not RawStatus.INFEASIBLE

    @property
    def reduced(self) -> bool:
        """Is a bracket open although friction's cones were reduced to rays?"""
        return self.open and bool(self.template.structure.cones) and "facial reduction" in self.proof.route

    @property
    def grows(self) -> bool:
        """Is λ so large without an upper bound that it may have none?"""
        state = self.proof.state
        return self.open and self.proof.motion is None and state is not None and state.load > _GROWS

    @property
    def runs_away(self) -> bool:
        """The same, of a program that the last raw answer calls unbounded, and that the batch solver was not asked
        yet."""
        unasked = "lanes" not in self.proof.route
        return self.open and unasked and self.raw is not None and self.raw.status is RawStatus.UNBOUNDED

    @property
    def alone(self) -> bool:
        """Is one labelling all that will be asked, and the batch solver the quicker way to it?"""
        analysis = self.analysis
        return self.open and analysis.single and analysis.quick and analysis.batch is not None

    @property
    def settled_by_batch(self) -> bool:
        """Has the batch solver left nothing to do? Brackets far wider than those of others do not count."""
        if "lanes" not in self.proof.route or self.open:
            return False
        return not self._collapses or self._width(0.0) <= tolerances.ALONE

    @property
    def linear(self) -> bool:
        """Can a dual simplex be asked?"""
        structure = self.template.structure
        return not structure.cones and structure.shape[1] <= _SIMPLEX

    @property
    def crushed_wide(self) -> bool:
        """Is a proof as wide as the margin that most crushable scenes need? This one may need less."""
        crushing = self.template.precision is tolerances.CRUSHING
        return crushing and self._collapses and self._width(self.analysis.floor) > tolerances.CRUSHING_WIDTH

    @property
    def wide_beside_load(self) -> bool:
        """Is a proof narrow beside the weight of the whole, but wide beside λ? λ may be small, or zero."""
        return self._collapses and self._width(0.0) > self.analysis.gap

    @property
    def _collapses(self) -> bool:
        return self.proof.status is Status.COLLAPSE

    def _width(self, floor: float) -> float:
        return relative_width(self.proof.low, self.proof.high, floor)

    # --- what is tried ----------------------------------------------------------------------------------

    def batched(self) -> None:
        """Whatever the batch solver proves of it: of faces between which nothing moves, a ray that takes them out."""
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
        """The same where a solver would be asked first: a wide bracket is dropped, which that begins better without."""
        proof = self.proof
        state = proof.state
        self.batched()
        proof.status = self.analysis.judge(proof)
        if not self.settled_by_batch:
            proof.state, proof.motion, proof.ray, proof.collapse_below_zero = state, None, None, None

    def solve(self) -> None:
        """The analysis' own solver."""
        route, template, analysis = self.analysis.route, self.template, self.analysis
        route.prepare(template.structure, lambda: template.program(analysis.reference, analysis.margin))
        self.attempt(route, analysis.margin)

    def attempt(self, route: Solver, margin: float) -> None:
        """Solve, and take from the raw answer whatever it proves, in the order its status makes likely."""
        raw = self.raw = route.solve(self.template.program(self.labels, margin))
        proof = self.proof
        proof.solves += 1
        proof.route.append(route.name if raw.status is RawStatus.OPTIMAL else f"{route.name} ({raw.status})")
        if raw.status is RawStatus.INFEASIBLE:
            self._offer_instability(raw.dual)
        elif raw.status is RawStatus.UNBOUNDED:
            ray = self.prover.ray(raw.point, self.labels)
            proof.ray = ray if ray.to_rounding else None
        else:
            proof.guess = float(raw.point[-1])
            proof.offer_state(self.prover.state(raw.point, self.labels))
            proof.offer_motion(self.prover.motion(raw.dual, self.labels))

    def _offer_instability(self, dual: Floats) -> None:
        """Σ D − b·u < 0 with b_λ·u ≥ 0 proves that no λ ≥ 0 is admissible."""
        velocity = dual[: self.template.matrix.shape[0]]
        size = float(abs(velocity).max())
        if not (np.isfinite(size) and size > 0.0):
            return
        motion = given = self.prover.motion(velocity / size, self.labels, normalise=False)
        if motion.margin < 0.0:
            motion = self._opened(motion, normalise=False)
        if motion.margin >= 0.0 and motion.bound < -max(tolerances.ROUNDING, motion.noise):
            # work below zero proves nothing of large λ, unless it is the rounding of a work that is zero
            idle = -1e-3 * tolerances.ROUNDING * float(abs(self.template.live).sum() * abs(motion.velocity).max())
            if motion.work < idle:
                motion = self.repair.make_work_positive(motion, self.labels)
            if motion.work < idle:
                # nor can it be positive where a ray carries the live load: then it is zero, and so are the ray's jumps
                self.proof.route.append("facial reduction")
                motion = self.repair.reduced(given, self.labels, normalise=False) or motion
            fine = motion.margin >= 0.0 and motion.work >= idle
            if fine and motion.bound < -max(tolerances.ROUNDING, motion.noise):
                self.proof.collapse_below_zero = motion

    def _opened(self, motion: Motion, normalise: bool = True) -> Motion:
        """A motion of finite dissipation: by opening all joints, or where they cannot, by facial reduction."""
        opening = self.repair.opening()
        if opening is not None:
            self.proof.route.append("opened")
            return self.prover.open_up(motion, opening, self.labels)
        self.proof.route.append("facial reduction")
        self.proof.solves += 2
        return self.repair.reduced(motion, self.labels, normalise) or motion

    def repair_answer(self) -> None:
        """Blend the answer at hand with states well inside and motions that open everywhere they may."""
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
                # a program may have a ray and no point: the multipliers of the largest slack say why
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
        """A vertex by dual simplex, exact to rounding."""
        self.attempt(HighsSolver(), 0.0)
        self.repair_answer()

    def edge(self) -> None:
        """A state in yield sets that leave no room, where nothing else gave one."""
        raw = self.raw
        self.proof.solves += 1
        self.proof.route.append("edge")
        point = None if raw is None or raw.status is RawStatus.UNBOUNDED else raw.point
        state: State | None = self.repair.edge_state(point, self.labels)
        if state is not None:
            self.proof.offer_state(state)

    def ray(self) -> None:
        """A ray where the solver stopped on its way to infinity."""
        self.proof.solves += 1
        self.proof.route.append("ray inside")
        self.proof.ray = self.repair.ray(self.labels)

    def lean(self) -> None:
        """States that lean on a self-stress at the boundary of friction's cones."""
        self.proof.solves += 2
        self.proof.route.append("self-stress")
        for state in self.repair.leaning(self.labels):
            self.proof.offer_state(state)

    def unshrunk(self) -> None:
        """An interior point with refined linear systems and no margin."""
        self._refined(self.template.precision.residual, 0.0)

    def less_margin(self) -> None:
        """The same with as little margin as linear programs need."""
        self._refined(tolerances.LINEAR.residual, 10.0 * tolerances.LINEAR.margin)

    def _refined(self, tolerance: float, margin: float) -> None:
        large = is_large(self.template.structure)
        refined = ClarabelSolver(tolerance, iterative_refinement_enable=True)
        self.attempt(SchurSolver(tolerance, gap=1e-10) if large else refined, margin)
        self.repair_answer()


@dataclass(frozen=True)
class Fallback:
    """One way to a proof. when: is it tried, as things stand? take: try it. offers: what it may give."""

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
    # a vertex comes before the edge: it tells unstable scenes from those that stand by a hair
    Fallback(
        "vertex",
        lambda c: c.open and c.linear,
        ProofAttempt.vertex,
        "both sides of a linear program, exact to rounding",
    ),
    Fallback("edge", lambda c: c.open_inside, ProofAttempt.edge, "a state where yield sets leave no room"),
    Fallback("ray", lambda c: c.grows, ProofAttempt.ray, "a ray where the solver stopped on its way to infinity"),
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
    Fallback("small λ", lambda c: c.wide_beside_load and c.linear, ProofAttempt.vertex, "whether λ is small or zero"),
)
"""What `LimitAnalysis.prove` tries by default, from the top down."""
