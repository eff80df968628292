"""Limit analysis of one labelling: solve, repair, prove; other routes only where the first does not prove."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.limit.bounds import Motion, Prover, State, crossed, load_floor, relative_width
from jld_core.limit.repair import Repair
from jld_core.limit.result import LimitAnalysisResult
from jld_core.limit.status import Status
from jld_core.mechanics import require_materials
from jld_core.program import Template
from jld_core.solvers import (
    ClarabelSolver,
    HighsSolver,
    RawSolution,
    RawStatus,
    SchurSolver,
    Solver,
    is_large,
    make_solver,
)


@dataclass
class Proof:
    """What has been proven so far about one labelling, and by what."""

    state: State | None = None
    motion: Motion | None = None
    ray: State | None = None
    collapse_below_zero: Motion | None = None
    route: list[str] = field(default_factory=list)
    solves: int = 0
    guess: float = math.nan

    def offer_state(self, state: State) -> None:
        """Keep an admissible state if its λ is the highest so far."""
        if state.admissible and (self.state is None or state.load > self.state.load):
            self.state = state

    def offer_motion(self, motion: Motion) -> None:
        """Keep a motion with finite dissipation if its bound is the lowest so far."""
        if motion.margin >= 0.0 and motion.work > 0.0 and (self.motion is None or motion.bound < self.motion.bound):
            self.motion = motion

    @property
    def crossed(self) -> bool:
        """Do the two proofs contradict each other by more than rounding? Then neither is to be relied on."""
        if self.state is None or self.motion is None:
            return False
        return bool(crossed(self.state.load, self.motion.bound))

    @property
    def low(self) -> float:
        """Proven lower bound, scaled; −inf where there is none."""
        if self.state is None or self.crossed:
            return -math.inf
        return self.state.load if self.motion is None else min(self.state.load, self.motion.bound)

    @property
    def high(self) -> float:
        """Proven upper bound, scaled; +inf where there is none."""
        if self.motion is None or self.crossed:
            return math.inf
        return self.motion.bound if self.state is None else max(self.state.load, self.motion.bound)


class LimitAnalysis:
    """Limit analysis of one assembly under any of its labellings.

    assembly: the structure. gap: relative width of the bracket that counts as solved. solver: name of the
    first route. margin: see `Template.program`. Structure, scaling and projectors are built once; the answer
    for a labelling does not depend on what was solved before it.
    """

    def __init__(
        self,
        assembly: Assembly,
        *,
        solver: str = "auto",
        gap: float = tolerances.GAP,
        margin: float | None = None,
        reference: Bits | None = None,
        template: Template | None = None,
    ) -> None:
        start = time.perf_counter()
        self.assembly, self.solver = assembly, solver
        self.template = template or Template(assembly)
        self.prover = Prover(self.template)
        self.route: Solver = make_solver(
            solver, tolerance=self.template.precision.residual, structure=self.template.structure
        )
        self.interior = Repair(self.template, self.prover)
        self.gap, self.margin = gap, self.template.precision.margin if margin is None else margin
        self._floor = load_floor(self.template) / self.template.scaling.load
        self._reference = np.ones(len(assembly.interfaces), dtype=bool) if reference is None else reference
        self._reference_known = False
        self.seconds = time.perf_counter() - start

    def prove(self, labels: Bits, *, harder: bool = True) -> tuple[Status, Proof]:
        """Status and proof of one labelling, by as many routes as it takes.

        labels: (m,) True dry. harder: repair an answer that does not prove itself, and try other routes.
        """
        proof = Proof()
        unloaded = self.unloaded(labels)
        if unloaded is not None:
            proof.offer_state(unloaded)
        if not self._reference_known and hasattr(self.route, "rebuilds"):
            self.route.solve(self.template.program(self._reference, self.margin))
            self._reference_known = True
        raw = self._attempt(proof, self.route, labels, self.margin)
        status = self.judge(proof)
        if status is Status.UNCERTIFIED and not harder:
            return status, proof
        if status is Status.UNCERTIFIED:
            status = self._try_harder(proof, raw, labels)
        width = relative_width(proof.low, proof.high, self._floor)
        crushing = self.template.precision is tolerances.CRUSHING
        if status is Status.COLLAPSE and crushing and width > tolerances.CRUSHING_WIDTH:
            # the margin that most crushable scenes need is more than this one does
            refined = self._refined(tolerances.LINEAR.residual)
            self._repair(proof, self._attempt(proof, refined, labels, 10.0 * tolerances.LINEAR.margin), labels)
        if status is Status.COLLAPSE and relative_width(proof.low, proof.high, 0.0) > self.gap:
            # narrow beside the weight of the whole, wide beside λ: a vertex says whether λ is small or zero
            self._crossover(proof, raw, labels)
            status = self.judge(proof)
        return status, proof

    def unloaded(self, labels: Bits) -> State | None:
        """Without dead load no force at all is a state, at λ = 0: exact where rounding leaves nothing else."""
        if self.template.dead.any():
            return None
        nothing = np.zeros(self.template.scaling.face.shape)
        return State(nothing, 0.0, float(self.template.yield_set.slack(nothing, labels).min()), 0.0)

    def _attempt(self, proof: Proof, route: Solver, labels: Bits, margin: float) -> RawSolution:
        raw = route.solve(self.template.program(labels, margin))
        proof.solves += 1
        proof.route.append(route.name if raw.status is RawStatus.OPTIMAL else f"{route.name} ({raw.status})")
        self._harvest(proof, raw, labels)
        return raw

    def _harvest(self, proof: Proof, raw: RawSolution, labels: Bits) -> None:
        """Take from a raw answer whatever it proves, in the order its status makes likely."""
        if raw.status is RawStatus.INFEASIBLE:
            self._offer_instability(proof, raw.dual, labels)
            return
        if raw.status is RawStatus.UNBOUNDED:
            proof.ray = self._checked_ray(raw.point, labels)
            return
        proof.guess = float(raw.point[-1])
        proof.offer_state(self.prover.state(raw.point, labels))
        proof.offer_motion(self.prover.motion(raw.dual, labels))

    def _checked_ray(self, point: Floats, labels: Bits) -> State | None:
        ray = self.prover.ray(point, labels)
        return ray if ray.slack >= -tolerances.ROUNDING and ray.error <= tolerances.ROUNDING else None

    def _offer_instability(self, proof: Proof, dual: Floats, labels: Bits) -> None:
        """Σ D − b·u < 0 with b_λ·u ≥ 0 proves that no λ ≥ 0 is admissible."""
        velocity = dual[: self.template.matrix.shape[0]]
        size = float(abs(velocity).max())
        if not (np.isfinite(size) and size > 0.0):
            return
        motion = self.prover.motion(velocity / size, labels, normalise=False)
        if motion.margin < 0.0:
            motion = self._opened(proof, motion, labels, normalise=False)
        if motion.margin >= 0.0 and motion.bound < -max(tolerances.ROUNDING, motion.noise):
            # work below zero proves nothing of large λ, unless it is the rounding of a work that is zero
            idle = -1e-3 * tolerances.ROUNDING * float(abs(self.template.live).sum() * abs(motion.velocity).max())
            if motion.work < idle:
                motion = self.interior.make_work_positive(motion, labels)
            fine = motion.margin >= 0.0 and motion.work >= idle
            if fine and motion.bound < -max(tolerances.ROUNDING, motion.noise):
                proof.collapse_below_zero = motion

    def judge(self, proof: Proof) -> Status:
        """The status that a proof amounts to."""
        falls = proof.motion is not None and proof.motion.bound < -proof.motion.noise and not proof.crossed
        if proof.collapse_below_zero is not None or falls:
            return Status.UNSTABLE
        if proof.ray is not None and proof.state is not None:
            return Status.LOCKED
        if relative_width(proof.low, proof.high, self._floor) <= self.gap:
            return Status.COLLAPSE
        return Status.UNCERTIFIED

    def _try_harder(self, proof: Proof, raw: RawSolution, labels: Bits) -> Status:
        """Repairs by interior points, then other routes; each step is named in the route."""
        # a vertex comes before the edge: it tells unstable scenes from those that stand by a hair
        steps = (self._repair, self._crossover, self._at_the_edge, self._phase_one, self._unshrunk)
        for step in steps:
            raw = step(proof, raw, labels)
            status = self.judge(proof)
            if status is not Status.UNCERTIFIED:
                return status
        return Status.UNCERTIFIED

    def _repair(self, proof: Proof, raw: RawSolution, labels: Bits) -> RawSolution:
        """Blend the answer at hand with states well inside and motions that open everywhere they may."""
        if raw.status is RawStatus.INFEASIBLE:
            return raw
        state = self.prover.state(raw.point, labels, passes=3)
        if raw.status is RawStatus.UNBOUNDED or not state.admissible:
            inside = self.interior.state(labels)
            proof.solves += 1
            proof.route.append("state inside")
            if inside is not None:
                proof.offer_state(inside)
                if raw.status is not RawStatus.UNBOUNDED:
                    proof.offer_state(self.prover.blend(state, inside, labels))
        if raw.status is RawStatus.UNBOUNDED:
            if proof.ray is None:
                proof.ray = self.interior.ray(labels)
                proof.solves += 1
                proof.route.append("ray inside")
            return raw
        motion = self.prover.motion(raw.dual, labels)
        if motion.margin < 0.0:
            proof.offer_motion(self._opened(proof, motion, labels))
        return raw

    def _opened(self, proof: Proof, motion: Motion, labels: Bits, normalise: bool = True) -> Motion:
        """A motion of finite dissipation: by opening all joints, or where they cannot, by facial reduction."""
        opening = self.interior.opening()
        if opening is not None:
            proof.route.append("opened")
            return self.prover.open_up(motion, opening, labels)
        proof.route.append("facial reduction")
        proof.solves += 2
        return self.interior.reduced(motion, labels, normalise) or motion

    def _at_the_edge(self, proof: Proof, raw: RawSolution, labels: Bits) -> RawSolution:
        """A state in yield sets that leave no room, where nothing else gave one."""
        if raw.status is not RawStatus.INFEASIBLE:
            proof.solves += 1
            proof.route.append("edge")
            point = None if raw.status is RawStatus.UNBOUNDED else raw.point
            state = self.interior.edge_state(point, labels)
            if state is not None:
                proof.offer_state(state)
        return raw

    def _crossover(self, proof: Proof, raw: RawSolution, labels: Bits) -> RawSolution:
        """A vertex by dual simplex, exact to rounding, where the program is linear."""
        if self.template.structure.cones or self.template.structure.shape[1] > 6000:
            return raw
        found = self._attempt(proof, HighsSolver(), labels, 0.0)
        return self._repair(proof, found, labels)

    def _phase_one(self, proof: Proof, raw: RawSolution, labels: Bits) -> RawSolution:
        """Least shrinkage under which any λ ≥ −c is admissible; its multipliers prove instability."""
        answer = self.interior.phase_one(labels)
        proof.solves += 1
        proof.route.append("phase one")
        self._offer_instability(proof, answer, labels)
        return raw

    def _unshrunk(self, proof: Proof, raw: RawSolution, labels: Bits) -> RawSolution:
        """An interior point with refined linear systems and no margins, for yield sets that leave none."""
        refined = self._refined(self.template.precision.residual)
        return self._repair(proof, self._attempt(proof, refined, labels, 0.0), labels)

    def _refined(self, tolerance: float) -> Solver:
        if is_large(self.template.structure):
            return SchurSolver(tolerance, gap=1e-10)
        return ClarabelSolver(tolerance, iterative_refinement_enable=True)

    def solve(self, labels: Bits | None = None, *, stands: bool = True, harder: bool = True) -> LimitAnalysisResult:
        """Limit analysis of one labelling, in full.

        labels: (m,) True dry; default the assembly's own. stands: also decide whether it stands at λ = 0.
        harder: see `prove`; without it an uncertified result is not examined further.
        Raises InputError where a material that the labelling needs is missing.
        """
        start = time.perf_counter()
        labels = self.assembly.labels if labels is None else np.asarray(labels, dtype=bool)
        require_materials(self.assembly, labels, ~labels)
        status, proof = self.prove(labels, harder=harder)
        stands = stands and (harder or status is not Status.UNCERTIFIED)
        solved = time.perf_counter() - start
        at_zero = self._stands(status, proof, labels) if stands else None
        return self._result(labels, status, proof, at_zero, solved, time.perf_counter() - start)

    def _stands(self, status: Status, proof: Proof, labels: Bits) -> bool | None:
        """Is λ = 0 admissible? The admissible λ are an interval, so a proven state below 0 would do too."""
        if status is Status.UNSTABLE:
            return False
        proof.solves += 1
        return self.stands(labels)

    def stands(self, labels: Bits) -> bool | None:
        """Is λ = 0 admissible? None where neither a state nor a motion settles it. labels: (m,) True dry."""
        return True if not self.template.dead.any() else self.interior.stands(labels)

    def _result(
        self, labels: Bits, status: Status, proof: Proof, at_zero: bool | None, solved: float, total: float
    ) -> LimitAnalysisResult:
        scaling, nan = self.template.scaling, math.nan
        low, high = proof.low * scaling.load, proof.high * scaling.load
        bracket = (low if math.isfinite(low) else nan, high if math.isfinite(high) else nan)
        gap = relative_width(proof.low, proof.high, self._floor)
        forces = None if proof.state is None else proof.state.forces * scaling.face
        mechanism = None
        if proof.motion is not None:
            mechanism = np.zeros((len(self.assembly.elements), self.assembly.freedoms))
            free = scaling.load * proof.motion.velocity / scaling.row.ravel()
            mechanism[self.assembly.elements.free] = free.reshape(-1, self.assembly.freedoms)
        load_factor = 0.5 * (low + high)
        if status is Status.UNSTABLE:
            load_factor, bracket, gap, forces, mechanism = nan, (nan, nan), nan, None, None
        elif status is Status.LOCKED:
            load_factor, bracket, gap, mechanism = nan, (bracket[0], nan), nan, None
        elif status is Status.UNCERTIFIED and not math.isfinite(load_factor):
            load_factor = proof.guess * scaling.load
        return LimitAnalysisResult(
            assembly=self.assembly,
            labels=labels,
            status=status,
            load_factor=load_factor,
            bracket=bracket,
            gap=gap,
            stands_at_zero=at_zero,
            forces=forces,
            mechanism=mechanism,
            iterations=proof.solves,
            route=tuple(proof.route),
            seconds={"assemble": self.seconds, "solve": solved, "total": self.seconds + total},
        )
