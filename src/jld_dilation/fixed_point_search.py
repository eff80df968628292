"""Fixed-point search for a solution of friction without dilation; see `solve`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np

from jld_core import (
    Bits,
    Bools,
    Floats,
    InputError,
    Ints,
    LimitAnalysis,
    ParameterError,
    Status,
    checkpoint,
    tolerances,
)
from jld_core.limit import Prover, State, load_scale
from jld_core.mechanics import prescribed_friction
from jld_core.models import areas_under, under_own_areas
from jld_core.models import effective_area as models_effective_area
from jld_core.program import ConicProgram, Template
from jld_core.solvers import ClarabelSolver, RawSolution, RawStatus
from jld_dilation.modes import LinearModes, LinearRows, Modes, Statics
from jld_dilation.product_space import PrimalDualPair, rank
from jld_dilation.rlt_relaxation import LowerBoundProblem

_STEP, _GAP = 1e-9, 1e-11  # solver residuals: of proximal steps (`_STEP`) and of the minimisation of Γ (`_GAP`)
_BACK = 6  # maximum number of solves of one proximal step; after each failure its centre moves back half way
_DOWN = 0.02  # relative reduction of the weight of λ in Γ, so that the lowest λ is preferred among equal Γ
_LEAST = 0.1  # least fraction of a proximal step that is applied
_LOST = 1e30  # size of scaled forces at which the solver is considered to have failed
_LIGHT = 1e-3  # lower limit of the largest scaled N in the test for compressed faces; below it N is rounding
_PRESSED = 1e-6  # N relative to the largest N above which a face counts as compressed and may not dilate


@dataclass(frozen=True)
class ProximalOptions:
    """Parameters of the fixed-point search: proximal steps and minimisation of Γ in turn."""

    # share of the present N in friction at the first step, 0 to 1. The share falls tenfold with each step, down to 0,
    # and is 0 in the last step before each minimisation of Γ.
    alpha: float = 0.01
    # weight ε of the proximal term about the previous forces, for scaled forces of order one; positive
    damping: float = 1e-2
    anchor: float = 1e-3  # weight of the same term where Γ is minimised; positive
    # number of proximal steps before a minimisation of Γ, apart from a last step with alpha = 0; at least 1
    block: int = 5
    # forces to start from: those of the associative solution, the state of least forces at λ = 0, or a vertex of the
    # associative problem (planar)
    start: Literal["associative", "gravity", "vertex"] = "associative"
    most: int = 60  # number of programs from each start after which no further attempt begins; at least 1
    effective_area: bool = False  # update effective areas in the same iteration (spatial, dry rectangles)

    def __post_init__(self) -> None:
        """Raise InputError if a value is outside its range."""
        if self.start not in (allowed := ("associative", "gravity", "vertex")):
            raise ParameterError("start", f"there is no {self.start!r}", " or ".join(allowed))
        if not 0.0 <= self.alpha <= 1.0:
            raise InputError("alpha", f"{self.alpha}", "0 ≤ alpha ≤ 1")
        if not (self.damping > 0.0 and self.anchor > 0.0 and self.block >= 1 and self.most >= 1):
            raise InputError("damping, anchor, block, most", "not positive", "positive numbers")


class Step(NamedTuple):
    """One step of a fixed-point search: of friction frozen at the previous N, or a minimised gap."""

    kind: Literal["frozen friction", "least gap"]
    alpha: float
    load: float  # scaled λ
    violation: float  # max(|V| − μN)⁺ / max N
    dilation: float  # largest opening of pressed faces over the largest slip
    gap: float  # Γ over the dissipation; NaN for frozen friction


class FixedPointSearch:
    """Search for forces that solve the problem frozen at their own N (4.1), so that the gap Γ (4.3) is zero.

    `pair_from` or `attempts` run it; all its programs share solvers.
    """

    def __init__(self, analysis: LimitAnalysis, labels: Bits, options: ProximalOptions) -> None:
        self.analysis, self.labels, self.options = analysis, labels, options
        template = analysis.template
        self.count = template.matrix.shape[1]
        self.margin = analysis.margin
        self.base = template.yield_set.associative
        residual = template.precision.residual
        # Quadratic programs converge less tightly than linear ones; only the last of them must be exact.
        self.step_solver = ClarabelSolver(max(_STEP, residual), proximal=(self.count, options.damping))
        self.gap_solver = ClarabelSolver(max(_GAP, residual), proximal=(self.count, options.anchor))
        self.holding_solver = ClarabelSolver(
            max(_GAP, residual), proximal=(self.count, models_effective_area.HOLDING_WEIGHT)
        )
        self.solver = ClarabelSolver(residual)
        self.shared: Template = template  # its rows are renumbered for the N of each step
        self.load_scale = load_scale(template.assembly) / template.scaling.load
        self.last_feasible = np.zeros(self.count)  # forces to return towards where a step finds none
        self.solves = self.program_limit = 0  # programs solved so far, and at most
        self.history: list[Step] | None = None  # a list here receives every step

    # --- frozen problems ----------------------------------------------------------------------------------

    def areas(self, forces: Floats) -> prescribed_friction.EffectiveAreas | None:
        """Return the effective areas of the faces under scaled forces (q·m,); None if not used."""
        if not self.options.effective_area:
            return None
        return areas_under(self.analysis.assembly, self.table(forces), self.labels)

    def prover(self, template: Template) -> Prover:
        """Return the analysis' prover for another template of the same equilibrium matrix."""
        return self.analysis.prover.with_template(template)

    def freeze_friction(
        self, alpha: float, previous: Floats, areas: prescribed_friction.EffectiveAreas | None
    ) -> tuple[Template, prescribed_friction.PrescribedFriction]:
        """Return template and yield sets with friction μ(αN + (1 − α)N_prev), N_prev (m,) scaled."""
        sets = prescribed_friction.PrescribedFriction(self.base, alpha, previous, areas)
        self.shared = self.shared.renumbered(sets)
        return self.shared, sets

    def table(self, forces: Floats) -> Floats:
        """Return scaled forces (q·m,) as a table (m, q); a trailing λ is dropped."""
        return forces[: self.count].reshape(len(self.labels), -1)

    def normals(self, forces: Floats) -> Floats:
        """Return the normal forces (m,) of scaled forces (q·m,)."""
        return self.table(forces)[:, 0]

    # --- the two steps ------------------------------------------------------------------------------------

    def step_from(self, forces: Floats, alpha: float) -> RawSolution:
        """Solve the problem with friction frozen at N of forces (q·m,), near these forces."""
        # A proximal term holds the solution near them. If the solver fails, the step is tried again from forces half
        # way back to the last feasible ones, up to six times. Then the failed answer is returned.
        centre = forces[: self.count]
        for _ in range(_BACK):
            template, _ = self.freeze_friction(alpha, self.normals(centre), self.areas(centre))
            raw = self.step_solver.solve(template.program(self.labels, self.margin), centre)
            self.solves += 1
            if raw.status in (RawStatus.OPTIMAL, RawStatus.ALMOST):
                self.last_feasible = centre
                break
            # A frozen N that is too small can leave no equilibrium at all: move the centre back half way.
            centre = 0.5 * (centre + self.last_feasible)
        return raw

    def minimise_gap(
        self,
        forces: Floats,
        dual: Floats,
        areas: prescribed_friction.EffectiveAreas | None,
        held_margin: float | None = None,
    ) -> State:
        """Minimise Γ for given velocities: the nearest state of true friction, to be checked."""
        # held_margin: margin of the yield sets for forces that stay close to the given ones; None: they need not
        template, program = self._gap_program(forces, dual, areas, self.margin if held_margin is None else held_margin)
        solver = self.gap_solver if held_margin is None else self.holding_solver
        point = solver.solve(program, forces[: self.count]).point
        return self.repaired_state(point, template, areas)

    def lowest_state(self, forces: Floats, dual: Floats) -> State:
        """Find the state of least λ among those of least Γ for given velocities, also far from forces."""
        template, program = self._gap_program(forces, dual, self.areas(forces), self.margin)
        # Γ contains −λ. A slightly smaller weight of λ prefers the lowest λ among states of equal Γ.
        program.objective[-1] *= 1.0 - _DOWN
        return self.repaired_state(self.solver.solve(program).point, template, self.areas(forces))

    def _gap_program(
        self, forces: Floats, dual: Floats, areas: prescribed_friction.EffectiveAreas | None, margin: float
    ) -> tuple[Template, ConicProgram]:
        """Build the program that minimises Γ for given velocities; forces (q·m,) give the first N."""
        # Friction is that of the true cone. Terms that are constant for given velocities are omitted.
        template, sets = self.freeze_friction(1.0, self.normals(forces), areas)
        velocity = dual[: template.matrix.shape[0]]
        jumps = (template.matrix.T @ velocity).reshape(len(self.labels), -1)
        work = float(template.live @ velocity)
        # Multipliers satisfy b_λ·u = 1 up to the multiplier of λ ≥ −floor.
        rate = sets.price(jumps, self.labels) / (work if work > 0.0 else 1.0)
        program = template.program(self.labels, margin)
        objective = program.objective.copy()
        objective[np.arange(0, self.count, template.assembly.freedoms)] += rate
        self.solves += 1
        return template, ConicProgram(program.structure, program.data, program.rhs, objective)

    def mechanism(self, forces: Floats, raised: Floats | None = None) -> RawSolution:
        """Solve the problem frozen at N of forces; its multipliers are velocities, unverified.

        raised: (linear rows,) increase of resistances, which selects one of several optimal mechanisms.
        """
        template, _ = self.freeze_friction(0.0, self.normals(forces), self.areas(forces))
        program = template.program(self.labels, self.margin)
        structure, rhs = program.structure, program.rhs.copy()
        if raised is not None:
            rhs[structure.equalities : structure.equalities + structure.linear] += raised
        self.solves += 1
        return self.solver.solve(ConicProgram(structure, program.data, rhs, program.objective))

    def repaired_state(
        self, point: Floats, template: Template, areas: prescribed_friction.EffectiveAreas | None
    ) -> State:
        """Make a state in equilibrium from a point (columns,), within the friction cone if possible."""
        # Check `State.admissible`: repairs may fail. Each repair tried adds one to `solves`.
        labels, prover = self.labels, self.prover(template)
        state = prover.state(point, labels, passes=3)
        if state.admissible:
            return state
        analysis = self.analysis if areas is None else self.analysis.with_template(template, labels)
        inside = analysis.repair.state(labels)
        self.solves += 1
        if inside is not None:
            state = prover.blend(state, inside, labels)
        if not state.admissible:
            self.solves += 1
            state = analysis.repair.boundary_state(point, labels) or state
        return state

    def evaluate_pair(self, state: State, areas: prescribed_friction.EffectiveAreas | None) -> PrimalDualPair:
        """Complete a state to a pair: compute velocities without dilation, and evaluate Γ."""
        # The velocities are those of the problem frozen at N of the state.
        labels = self.labels
        template, sets = self.freeze_friction(0.0, state.forces[:, 0], areas)
        prover = self.prover(template)
        raw = self.solver.solve(template.program(labels, self.margin))
        self.solves += 1
        motion = prover.motion(raw.dual, labels)
        opening = None if motion.margin >= 0.0 else self.analysis.repair.opening()
        if opening is not None:
            motion = prover.add_opening(motion, opening, labels)
        locked = False
        finite = motion.margin >= 0.0 and motion.work > 0.0
        size = max(abs(motion.bound), abs(state.load), self.load_scale)
        if not finite or raw.status is RawStatus.UNBOUNDED or motion.bound - state.load > tolerances.GAP * size:
            # a proof of the frozen problem may find a motion of a lower bound, or that it is locked
            proof = self.analysis.with_template(template, labels).prove(labels)
            self.solves += proof.solves
            locked = proof.status is Status.LOCKED
            if proof.motion is not None and (motion.margin < 0.0 or proof.motion.bound < motion.bound):
                motion = proof.motion
        largest = float(np.abs(state.forces[:, 0]).max(initial=0.0)) or 1.0
        violation = float(max(0.0, sets.excess(state.forces, labels).max(initial=0.0))) / largest
        if locked or motion.margin < 0.0 or not motion.work > 0.0:
            return PrimalDualPair(
                state, None, locked, violation, math.inf, math.inf, 0.0, 0.0, self.load_scale, settled=False
            )
        jumps = motion.jumps
        dilation = self._dilation(sets, jumps, state.forces)
        dissipation = float(sets.dissipation(jumps, labels).sum())
        gap = motion.bound - state.load
        area_change = (
            0.0
            if areas is None
            else models_effective_area.largest_area_change(
                areas, areas_under(self.analysis.assembly, state.forces, labels)
            )
        )
        size = max(abs(motion.bound), abs(state.load), self.load_scale)
        settled = abs(gap) <= tolerances.SETTLED * size
        return PrimalDualPair(
            state,
            motion,
            locked=False,
            violation=violation,
            dilation=dilation,
            gap=gap,
            dissipation=dissipation,
            area_change=area_change,
            load_scale=self.load_scale,
            settled=settled,
        )

    # --- the search ----------------------------------------------------------------------------------------

    def pair_from(self, forces: Floats) -> PrimalDualPair:
        """Search from forces (q·m,), and return the best pair, maybe no solution, of all rounds."""
        best: PrimalDualPair | None = None
        for pair in self.attempts(forces):
            if best is None or pair.locked or rank(pair) > rank(best):
                best = pair
        assert best is not None
        return best

    def attempts(self, forces: Floats) -> Iterator[PrimalDualPair]:
        """Alternate proximal steps with a minimisation of Γ, and yield a pair after each round."""
        # The iteration ends with a locked pair, with a solution, or after `options.most` programs. With effective
        # areas, later rounds hold the forces and omit proximal steps: such steps move the forces along the many
        # solutions, and the areas would follow.
        options, held_margin = self.options, None
        self.last_feasible, self.program_limit = forces[: self.count], self.solves + self.options.most
        alpha, dual, share, last = options.alpha, np.zeros(0), 1.0, np.zeros(self.count)
        while True:
            if held_margin is None:
                for step in range(options.block + 1):
                    checkpoint()
                    raw = self.step_from(forces, alpha if step < options.block else 0.0)
                    if not abs(raw.point).max() < _LOST:
                        dual = dual if dual.size else np.zeros_like(raw.dual)
                        break
                    direction = raw.point[: self.count] - forces[: self.count]
                    # A reversal of direction shows that the previous step was too long: shorten this one.
                    back = float(direction @ last) < 0.0
                    share = max(0.5 * share, _LEAST) if back else min(2.0 * share, 1.0)
                    forces, dual, last = forces[: self.count] + share * direction, raw.dual, direction
                    self._record(forces, raw, alpha if step < options.block else 0.0)
                    alpha = 0.1 * alpha if alpha > 1e-6 else 0.0
            areas = self.areas(forces)
            state = self.minimise_gap(forces, dual, areas, held_margin)
            if areas is not None:
                state, areas = self.settle_areas(state, dual, areas)
            pair = self.evaluate_pair(state, areas)
            if self.history is not None:
                numbers = state.load, pair.violation, pair.dilation, pair.relative_gap
                self.history.append(Step("least gap", 0.0, *numbers))
            yield pair
            width = (0.1 if areas is None else 1.0) * tolerances.GAP
            if (
                pair.locked
                or (pair.converged and pair.bracket_within(width))
                or self.solves + options.block + 3 > self.program_limit
            ):
                return
            forces = self.last_feasible = state.forces.ravel()
            if areas is not None and pair.motion is not None:
                held_margin, dual = self.margin, pair.motion.velocity

    def _record(self, forces: Floats, raw: RawSolution, alpha: float) -> None:
        """Add a step of frozen friction to the history: λ, and what its forces and velocities violate."""
        if self.history is None:
            return
        table = self.table(forces)
        sets = prescribed_friction.PrescribedFriction(self.base, 0.0, table[:, 0], self.areas(forces))
        largest = float(abs(table[:, 0]).max(initial=0.0)) or 1.0
        template = self.analysis.template
        velocity = raw.dual[: template.matrix.shape[0]]
        violation = max(0.0, float(sets.excess(table, self.labels).max(initial=0.0))) / largest
        dilation = self._dilation(sets, (template.matrix.T @ velocity).reshape(table.shape), table)
        self.history.append(Step("frozen friction", alpha, float(raw.point[self.count]), violation, dilation, math.nan))

    def _dilation(self, sets: prescribed_friction.PrescribedFriction, jumps: Floats, forces: Floats) -> float:
        """Return the largest opening of pressed faces over the largest slip. jumps, forces: (m, q) scaled."""
        slip = sets.slip(jumps, self.labels)[sets.slides(self.labels)].max(initial=0.0)
        widest = slip if slip > 1e-6 * np.abs(jumps).max() else np.abs(jumps).max()
        # Where the live load lifts all weight, N is rounding on every face; scaled forces are of order one.
        pressed = forces[:, 0] > _PRESSED * max(float(abs(forces[:, 0]).max(initial=0.0)) or 1.0, _LIGHT)
        return max(0.0, float(sets.dilation(jumps, self.labels)[pressed].max(initial=0.0)) / float(widest or 1.0))

    def settle_areas(
        self, state: State, dual: Floats, areas: prescribed_friction.EffectiveAreas
    ) -> tuple[State, prescribed_friction.EffectiveAreas]:
        """Minimise Γ for fixed velocities until the state is admissible in its own areas."""
        tries = 0
        while self.solves < self.program_limit - 2:
            checkpoint()
            tries += 1
            settled, areas, _ = under_own_areas(self.prover(self.shared), state, self.labels)
            if settled.admissible:
                return settled, areas
            slack = models_effective_area.slack_to_request(settled, self.margin, tries)
            state = self.minimise_gap(state.forces.ravel(), dual, areas, slack)
        return state, areas


# Values of y below which a mode may move, tried in order until some mechanism exists
_CLOSED: Final = (1e-9, 1e-7, 1e-5)
_MOVING: Final = 1e-9  # value of z above which a mode counts as moving
_BETTER: Final = 1e-9  # relative gain in λ that counts
_IDLES: Final = 1e-3  # scaled weight of a mode whose slack is zero, so that few of these modes move
_SWAY: Final = 1e-3  # size of the random objective that selects another vertex of the same λ

# Random change of the weights y where the gap is closed: relative, absolute. The second is also the weight of λ.
_UNEVEN: Final = (0.2, 1e-6)
_ROUNDS: Final = 6  # maximum number of rounds to close the gap
_CLOSING: Final = 0.9  # factor by which Σ yz must decrease in each round


class AlternatingPrograms:
    """Linear programs of one planar labelling: mechanisms for forces, forces for mechanisms (4.6)."""

    # A point (3m + 1,) holds scaled forces and λ. most: λ above which solutions are ignored. Nothing is certified yet.

    def __init__(self, modes: Modes, most: float) -> None:
        # statics: equilibrium of forces and λ, forms of yield rows ≥ 0; motions: rates of rows ≥ 0, live power 1
        self.modes = modes
        count, columns = modes.rows.shape
        self._first = len(modes.dead)
        rows = np.block([[modes.matrix, modes.live[:, None]], [modes.rows, np.zeros((count, 1))]])
        low, high = np.concatenate([-modes.dead, -modes.constants]), np.full(len(rows), np.inf)
        high[: self._first] = -modes.dead
        least, largest = np.full(columns + 1, -np.inf), np.full(columns + 1, np.inf)
        least[-1], largest[-1] = 0.0, most
        self._statics = LinearRows(rows, low, high, least, largest)
        width = modes.rates.shape[1]
        unit = np.vstack([modes.rates, modes.live_rate[None]])
        free = np.full(width, np.inf)
        ends = np.append(np.full(count, np.inf), 1.0)
        self._motions = LinearRows(unit, np.append(np.zeros(count), 1.0), ends, -free, free)

    def mechanism(self, closed: Bools, weights: Floats) -> Floats | None:
        """Return z (4m,) ≥ 0 of live work 1 that minimises weights·z, moving `closed` slacks alone, or None."""
        self._motions.bound(slice(0, len(closed)), np.zeros(len(closed)), np.where(closed, np.inf, 0.0))
        answer = self._motions.minimise(weights @ self.modes.rates)
        return self.modes.rates @ answer.point if answer.found else None

    def forces(self, moving: Bools, objective: Floats) -> Floats | None:
        """Minimise an objective (3m + 1,) over forces whose slacks of `moving` (4m,) are zero, or None."""
        d = self.modes.constants
        self._statics.bound(slice(self._first, self._first + len(d)), -d, np.where(moving, -d, np.inf))
        answer = self._statics.minimise(objective)
        return answer.point if answer.found else None

    def close_gap(self, point: Floats, seed: int) -> Floats | None:
        """Find a solution by reducing Σ y z from a point to zero; None on failure."""
        # Mechanism and forces are updated in turn.
        rng, count, last = np.random.default_rng(seed), len(self.modes.constants), np.inf
        every, none = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
        for _ in range(_ROUNDS):
            checkpoint()
            slack = np.maximum(self.modes.slacks_of(point[:-1]), 0.0)
            weights = slack * (1.0 + _UNEVEN[0] * rng.random(count)) + _UNEVEN[1] * rng.random(count)
            z = self.mechanism(every, weights)
            if z is None:
                return None
            moving = z > _MOVING
            forces_found = self.forces(moving, np.append(np.zeros(len(point) - 1), 1.0))
            gap = float(slack @ z)
            if forces_found is not None or gap > _CLOSING * last:
                return forces_found
            # Prefer the lowest λ among forces of equal Σ yz.
            nearest = self.forces(none, np.append(np.where(moving, z, 0.0) @ self.modes.rows, _UNEVEN[1]))
            if nearest is None:
                return None
            point, last = nearest, gap
        return None

    def mix_with_low_compression(self, point: Floats, share: float, rng: np.random.Generator) -> Floats | None:
        """Mix a point with the state of least Σ w N of random weights w."""
        objective = np.zeros(len(point))
        objective[:-1:3] = rng.exponential(size=self.modes.faces)
        state = self.forces(np.zeros(len(self.modes.constants), dtype=bool), objective)
        return None if state is None else (1.0 - share) * point + share * state

    def descend(self, point: Floats, seed: int, tries: int = 24, sign: float = 1.0) -> Floats | None:
        """Search for a solution of lower λ (sign 1) or higher λ (sign −1) from a solution."""
        rng = np.random.default_rng(seed)
        count = len(self.modes.constants)
        goal = np.append(np.zeros(len(point) - 1), sign)
        closed, best = self._start(point, rng), point
        if closed is None:
            return None
        idle = 0
        while idle < tries:
            checkpoint()
            z = self.mechanism(closed, rng.exponential(size=count))
            forces_found = None if z is None else self.forces(z > _MOVING, goal)
            if z is None or forces_found is None:
                idle += 1
                continue
            if sign * (forces_found[-1] - best[-1]) < -_BETTER * max(abs(best[-1]), _BETTER):
                best, point, idle = forces_found, forces_found, 0
            else:
                idle += 1
                if idle % 3 == 0:
                    sway = np.append(_SWAY * rng.standard_normal(len(point) - 1), sign)
                    other = self.forces(z > _MOVING, sway)
                    if other is not None and sign * (other[-1] - best[-1]) <= _BETTER * abs(best[-1]):
                        point = other
            closed = self.modes.slacks_of(point[:-1]) < _CLOSED[1]
        return best

    def random_solutions(self, seed: int, draws: int) -> list[Floats]:
        """Return the solutions of lowest and highest λ for each of many random mechanisms."""
        rng, solutions = np.random.default_rng(seed), list[Floats]()
        count, columns = len(self.modes.constants), self.modes.rows.shape[1]
        none, goal = np.zeros(count, dtype=bool), np.append(np.zeros(columns), 1.0)
        for draw in range(draws):
            checkpoint()
            weights = rng.exponential(size=count)
            if draw % 2:
                # A random objective yields high compression on some faces and low compression on others.
                state = self.forces(none, np.append(rng.standard_normal(columns), rng.standard_normal()))
                if state is not None:
                    weights *= np.maximum(self.modes.slacks_of(state[:-1]), 0.0) + _IDLES
            z = self.mechanism(~none, weights)
            if z is None:
                continue
            for sign in (1.0, -1.0):
                point = self.forces(z > _MOVING, sign * goal)
                if point is not None:
                    solutions.append(point)
        return solutions

    def ascending_path(self, point: Floats, seed: int, steps: int, idle: int) -> list[Floats]:
        """Return the points of a path of solutions with increasing λ, the given one first."""
        # Each step maximises λ for one random mechanism, of the modes without slack in the last point. idle: steps
        # without a larger λ after which the path ends.
        rng = np.random.default_rng(seed)
        objective = np.append(np.zeros(len(point) - 1), -1.0)
        closed, path, missed = self._start(point, rng), [point], 0
        for _ in range(steps):
            checkpoint()
            rates = None if closed is None else self.mechanism(closed, rng.exponential(size=len(self.modes.constants)))
            next_point = None if rates is None else self.forces(rates > _MOVING, objective)
            load, last_load = -np.inf if next_point is None else next_point[-1], path[-1][-1]
            if next_point is not None and load > last_load + 1e-6 * abs(last_load):
                path.append(next_point)
                closed, missed = self.modes.slacks_of(next_point[:-1]) < _CLOSED[1], 0
            else:
                missed += 1
            if missed > idle:
                break
        return path

    def _start(self, point: Floats, rng: np.random.Generator) -> Bools | None:
        """Return the modes (4m,) of zero slack within the least tolerance that leaves a mechanism, or None."""
        slack = self.modes.slacks_of(point[:-1])
        for allowance in _CLOSED:
            if self.mechanism(slack < allowance, rng.exponential(size=len(slack))) is not None:
                return np.asarray(slack < allowance)
        return None


_FROZEN_ROUNDS: Final = 8  # maximum number of iterations


def frozen_friction_bound(
    analysis: LimitAnalysis,
    labels: Bits,
    modes: LinearModes,
    normals: Ints,
    force_bounds: Floats,
    problem: LowerBoundProblem,
) -> float:
    """Prove a lower bound on λ by freezing friction at the least normal force of each face."""
    # A solution is the optimum of the problem whose friction is frozen at its own normal forces N, and this optimum
    # grows with N. Each iteration computes the least N of all states with λ above the last bound, and freezes friction
    # there. The proven lower bound on λ of that problem is the next bound.
    base, bound, none = analysis.template.yield_set.associative, 0.0, np.zeros(len(modes.rows), dtype=bool)
    for turn in range(1, _FROZEN_ROUNDS + 1):
        statics = Statics(modes, bound, problem.interval_end(bound), none, force_bounds)
        least = np.array([statics.least(row) for row in np.eye(len(force_bounds))[normals]])
        template = analysis.template.renumbered(prescribed_friction.PrescribedFriction(base, 0.0, least))
        proof = LimitAnalysis(analysis.assembly, template=template, gap=analysis.gap, reference=labels).prove(labels)
        problem.programs += len(normals) + proof.solves
        if not problem.gains_enough(bound, proof.low):
            break
        bound = proof.low
        problem.record(f"frozen friction {turn}")
        if problem.closes_gap(bound):
            break
    return bound
