"""Prove lower bounds step by step: each program starts where the last certificate ended.

The nearer the bound is to the solution, the fewer modes move, and the smaller the programs become. Where a step gains
little, more products are formed; where all exist, the region is split: a mode does not move, or its slack is zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jld_core import Bits, Bools, Floats, LimitAnalysis, Status, tolerances
from jld_core.limit import Proof, State
from jld_core.program import ConicProgram
from jld_core.solvers import ClarabelSolver, HighsSolver, RawSolution, RawStatus
from jld_dilation.certificate import BlockCertifier, solve_rlt_by_matrix_blocks
from jld_dilation.fixed_point_search import AlternatingPrograms, FixedPointSearch, ProximalOptions
from jld_dilation.modes import BoundedModes, Modes, Region, modes_of
from jld_dilation.product_space import PrimalDualPair
from jld_dilation.rlt_relaxation import LowerBoundProblem, RltOptions, RltSolution

# Distance from the lowest solution found, relative, below which a certificate is not refined further
_ENOUGH_SWEPT: Final = 4e-7

# Least and largest initial slack σ: decrease of λ per unit of cost, relative to λ or to 1.
_FINE, _COARSE = 1e-8, 1e-5

# Initial slack between these limits, as a fraction of the relative distance from the lowest solution found
_SHARE: Final = 1e-4

# Factor by which the slack grows where nothing is proven, or shrinks where the first program fails
_DEARER: Final = 10.0

_MOST: Final = 1e-4  # largest slack after such growth

_FIRST: Final = 1e-4  # slack of the first step of large scenes

# Fraction of the distance to the lowest solution found that the first step of large scenes tries to exclude
_PART: Final = 0.75

_FAR: Final = 0.05  # relative distance from that solution above which programs are solved with tolerance `_ROUGHLY`

_ROUGHLY: Final = 1e-3  # solver tolerance of programs that are followed by others in any case

_LESS: Final = 1e-4  # solver tolerance used after a program did not converge to full accuracy

_ROUGHEST: Final = 1e-2  # solver tolerance of the first step of large scenes

_NEAR: Final = 1e-4  # relative distance below which a certificate is refined as far as possible

_CLOSE: Final = 1e-5  # relative distance below which accuracy limits the bound, so that branching does not help

# Fraction of the distance that a step must gain; below it products are added or the region is split
_GAINS: Final = 0.5

_DEPTH: Final = 12  # maximum depth of branching


class BlockSweep:
    """Search for a lower bound by RLT relaxations, each from the last certificate, solved by matrix blocks.

    stages: names and products y_k h_l of programs, in the order in which they are tried.
    """

    def __init__(self, bounded: BoundedModes, problem: LowerBoundProblem) -> None:
        self.bounded, self.problem = bounded, problem
        self.modes = modes = bounded.modes
        same_face = np.kron(np.eye(modes.faces, dtype=bool), np.ones((4, 4), dtype=bool))
        pairs = np.hstack([modes.hinges | same_face, np.zeros((len(same_face), len(modes.loops)), dtype=bool)])
        self.near_pairs = modes.near_pairs & pairs
        self.stages = (("all hinges", pairs), ("all products", np.ones_like(pairs)))

    def near_hinge_bound(self, low: float) -> float:
        """Prove a lower bound on λ by the products of near hinges only, to full accuracy."""
        none = np.zeros(len(self.modes.rows), dtype=bool)
        return self._step("near hinges", self._region(low, none, none), self.near_pairs, _FINE, None)[1]

    def partial_bound(self, low: float, stage: int = 0) -> float:
        """Prove a bound that excludes only the first part of the interval of λ from `low`."""
        # The program takes half the steps of one that reaches up to the lowest solution found. It has enough slack that
        # its multipliers prove the bound without correction.
        none = np.zeros(len(self.modes.rows), dtype=bool)
        region = self._region(low, none, none, low + _PART * (self.problem.load - low))
        pairs = self.stages[stage][1]
        answer, proven = self._step("part of the way", region, pairs, _FIRST, _ROUGHEST)
        if answer is None and self.problem.seconds_left > 0.0:
            # The slack exceeded what mechanisms can balance: try again with less.
            proven = self._step("part of the way", region, pairs, _FIRST / _DEARER, _ROUGHEST)[1]
        return max(low, proven)

    def sweep(self, low: float, closed: Bools, held: Bools, stage: int = 0, depth: int = 0) -> float:
        """Prove a bound by steps from `low`, with branches where they stall; closed, held: (4m,)."""
        slack, problem, rough = 0.0, self.problem, False
        while not problem.closes_gap(low) and problem.seconds_left > 0.0:
            name, pairs = self.stages[stage]
            slack = max(slack, self._slack(low))
            region = self._region(low, closed, held)
            tolerance = _ROUGHLY if low < problem.load_below(_FAR) else _LESS if rough else None
            answer, proven = self._step(f"branch {depth}" if depth else name, region, pairs, slack, tolerance)
            if answer is not None and depth == 0:
                problem.offer_states(answer.states)
            last = stage + 1 == len(self.stages)
            won = problem.gains_enough(low, proven, _GAINS)
            low = max(low, proven)
            if won or problem.closes_gap(low):
                slack, rough = 0.0, False
            elif proven == -math.inf and slack < _MOST and self._worth_certifying(region, answer):
                slack = min(_DEARER * slack, _MOST)
                problem.record("more slack")
            elif not last:
                stage, slack = stage + 1, 0.0
            elif answer is None and tolerance is None:
                rough = True
                problem.record("less exact")
            elif depth < _DEPTH and answer is not None and low < problem.load_below(_CLOSE):
                return self._branch(low, region, answer, stage, depth)
            else:
                break
        return low

    # --- pieces -------------------------------------------------------------------------------------------

    def _slack(self, low: float) -> float:
        """Return the slack σ, relative to max(|λ|, 1), with which a step from `low` begins."""
        return float(np.clip(_SHARE * (self.problem.load - low) / self.problem.load_unit, _FINE, _COARSE))

    def _region(self, low: float, closed: Bools, held: Bools, high: float | None = None) -> Region:
        return self.bounded.region(low, self.problem.interval_end(low) if high is None else high, closed, held)

    def _step(
        self, name: str, region: Region, pairs: Bools, slack: float, tolerance: float | None
    ) -> tuple[RltSolution | None, float]:
        """Solve one program of a region; return its solution and proven bound, −inf without."""
        problem, earned = self.problem, self.problem.scaled_slack(slack)
        problem.record(name, 1)
        seconds = max(problem.seconds_left, 1.0)
        options = RltOptions(pairs, earned, seconds, tolerance=tolerance)
        answer = solve_rlt_by_matrix_blocks(self.bounded, region, options)
        if answer is None:
            return None, -math.inf
        if not self._worth_certifying(region, answer):
            return answer, -math.inf
        check = BlockCertifier(self.bounded, region, earned)
        near = answer.multipliers.bound >= problem.load_below(_NEAR)
        return answer, check.bound(answer.multipliers, problem.load_below(_ENOUGH_SWEPT) if near else -math.inf)

    def _worth_certifying(self, region: Region, answer: RltSolution | None) -> bool:
        """Return True if the solver's bound of a region gains enough to be worth a certificate."""
        return answer is not None and self.problem.gains_enough(region.low, answer.multipliers.bound)

    def _branch(self, low: float, region: Region, answer: RltSolution, stage: int, depth: int) -> float:
        """Split a region at one mode, sweep both parts, and return the lower of their bounds."""
        halves = region.split(answer.rates, answer.slacks)
        if halves is None:
            return low
        least = math.inf
        for half in halves:
            if least > low:
                least = min(least, self.sweep(low, half.closed, half.held, stage, depth + 1))
        return least


_STEPS: Final = 20  # Number of steps of the load path. A step without a state is halved, at most four times in all.

_SLOPE: Final = -0.01  # share of the present N in friction; negative: friction decreases as N grows

_RELAXED: Final = 0.6  # weight of the new N in the updated N that determines friction

_FALLS: Final = 15  # maximum number of programs with friction that decreases with N

# Least and largest number of alternations between mechanism and forces from a state of low compression
_START_TURNS: Final = (2, 4)

# Maximum number of rounds that match forces with the last mechanism and a mechanism with these forces
_MATCHES: Final = 3

# Mean of the random increase of resistances that selects a mechanism, for scaled forces of order one
_DRAWN: Final = 1e-3


def starts(search: FixedPointSearch, associative: Proof, thorough: bool = True) -> Iterator[Floats]:
    """Yield the scaled forces (q·m,) from which searches start, the most useful first."""
    first = initial_forces(search, associative, "associative")
    yield first
    gravity = initial_forces(search, associative, "gravity")
    yield gravity
    if thorough:
        yield forces_along_load_path(search, gravity, associative.load_factor)
        yield forces_of_decreasing_friction(search, first)


def initial_forces(search: FixedPointSearch, associative: Proof, start: str) -> Floats:
    """Return the scaled forces (q·m,) of a named start: "associative", "vertex" or "gravity"."""
    # "associative": forces of the associative solution. "vertex": a vertex of the associative problem. "gravity": the
    # state of least forces at λ = 0. If the vertex program fails, or gravity has no state, the associative forces are
    # used, and zero forces if there are none.
    labels, template = search.labels, search.analysis.template
    if start == "vertex":
        search.solves += 1
        raw = HighsSolver().solve(template.program(labels))
        if raw.status is RawStatus.OPTIMAL:
            return raw.point[: search.count]
    # The associative forces of a locked assembly are arbitrary.
    if start == "gravity" or associative.status is Status.LOCKED:
        raw = _nearest(search, np.zeros(search.count), 0.0)
        if raw.status is RawStatus.OPTIMAL:
            return raw.point[: search.count]
    return np.zeros(search.count) if associative.state is None else associative.state.forces.ravel()


def forces_along_load_path(search: FixedPointSearch, gravity: Floats, most: float) -> Floats:
    """Follow a load path from gravity (q·m,) at λ = 0 in steps of λ; return the forces at its end."""
    # Each state is the nearest to the previous one, as in distinct element analysis, where the final state depends on
    # the load path. The path ends where no further state is found.
    forces, load = gravity, 0.0
    step = (most if most > 0.0 else 1.0) / _STEPS
    least = step / 16.0
    for _ in range(2 * _STEPS):
        raw = _nearest(search, forces, load + step)
        if raw.status in (RawStatus.OPTIMAL, RawStatus.ALMOST):
            forces, load = raw.point[: search.count], load + step
        elif step > least:
            step *= 0.5
        else:
            break
    return forces


def _nearest(search: FixedPointSearch, forces: Floats, load: float) -> RawSolution:
    """Find the state of equilibrium at one scaled λ that is nearest to forces (q·m,)."""
    near = ClarabelSolver(search.analysis.template.precision.residual, proximal=(search.count, 1.0))
    return near.solve(_at_load(search, load), forces)


def _at_load(search: FixedPointSearch, load: float) -> ConicProgram:
    """Build the program of all admissible states at one scaled λ, given by `load`."""
    # λ moves from the unknowns of equilibrium to its right-hand side; its free column is minimised alone.
    template = search.analysis.template
    program = template.program(search.labels, search.margin)
    structure = program.structure
    data, objective, rhs = program.data.copy(), np.zeros(structure.shape[1]), program.rhs.copy()
    column = slice(structure.indptr[-2], structure.indptr[-1])
    data[column] = np.where(structure.indices[column] < structure.equalities, 0.0, data[column])
    rhs[: structure.equalities] -= load * template.live
    objective[-1] = 1.0
    search.solves += 1
    return ConicProgram(structure, data, rhs, objective)


def forces_of_decreasing_friction(search: FixedPointSearch, forces: Floats) -> Floats:
    """Iterate forces (q·m,) with friction that decreases as N grows, until a program fails."""
    # Decreasing friction removes thrust that the mechanism does not need.
    previous = search.normals(forces)
    for _ in range(_FALLS):
        template, _ = search.freeze_friction(_SLOPE, previous, search.areas(forces))
        raw = search.solver.solve(template.program(search.labels, search.margin))
        search.solves += 1
        if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
            break
        forces = raw.point[: search.count]
        previous = np.maximum(_RELAXED * search.normals(forces) + (1.0 - _RELAXED) * previous, 0.0)
    return forces


def low_compression_states(search: FixedPointSearch, load: float, rng: np.random.Generator) -> PrimalDualPair | None:
    """Search for a solution from a state of low compression on random faces; None where a program fails."""
    # Every solution has the λ of its own frozen friction, which grows with N: faces without compression do not resist.
    # From a state at the scaled λ `load`, a mechanism of the frozen friction and the lowest forces for it are computed
    # in turn.
    program = _at_load(search, load)
    freedoms = search.analysis.template.assembly.freedoms
    # random prices on the normal force of each face
    program.objective[: search.count : freedoms] = rng.exponential(size=len(search.labels))
    raw = search.solver.solve(program)
    if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
        return None
    forces = raw.point[: search.count]
    turns = int(rng.integers(*_START_TURNS, endpoint=True))
    for turn in range(turns):
        objective = rng.exponential(scale=_DRAWN, size=program.structure.linear)
        raw = search.mechanism(forces, objective if turn + 1 < turns else None)
        if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
            return None
        state = search.lowest_state(forces, raw.dual)
        forces = state.forces.ravel()
    pair = search.evaluate_pair(state, None)
    for _ in range(_MATCHES):
        if pair.motion is None or pair.is_solution(search.analysis.gap):
            break
        pair = search.evaluate_pair(search.minimise_gap(pair.state.forces.ravel(), pair.motion.velocity, None), None)
    return pair


def repair_and_evaluate(search: FixedPointSearch, point: Floats) -> PrimalDualPair:
    """Move a point (q·m + 1,) into the true friction cone where possible, and evaluate it."""
    areas = search.areas(point)
    state: State = search.repaired_state(point, search.analysis.template, areas)
    return search.evaluate_pair(state, areas)


_DRAWS: Final = 8  # number of random mechanisms per round, planar scenes

# Number of further rounds of random mechanisms once a solution is known, while some mechanism has forces
_ENOUGH: Final = 4

_TURNS: Final = 25  # maximum number of rounds of random mechanisms while no solution is known

_LITTLE: Final = 24  # maximum number of states of low compression used as starts

_IDLE: Final = 8  # number of consecutive starts or mixtures without a lower solution after which the search stops

_LOWER: Final = 1e-6  # relative decrease of λ that counts as a lower solution

_CLOSES: Final = 2  # number of random seeds for which the gap of a pair is closed

_SHARES: Final = (0.05, 0.2, 0.5)  # shares of a state of low compression in a mixture with the lowest solution

_TRIES: Final = 6  # number of consecutive tries without gain in a descent from a mixture


@dataclass
class Found:
    """Certified solutions of one labelling found so far, scaled."""

    width: float  # relative width of the bracket up to which a pair counts as a solution
    zero_load: float  # λ below which λ is rounding of zero
    # solution of least λ ≥ 0, as the load grows from zero. A solution with λ < 0 only if there is no other.
    lowest: PrimalDualPair | None = None
    highest: PrimalDualPair | None = None  # solution of largest λ
    best: PrimalDualPair | None = None  # best pair offered, certified or not
    loads: list[float] = field(default_factory=list)  # λ of all certified solutions

    @property
    def lowest_load(self) -> float:
        """Return the scaled λ of the lowest solution, +inf if there is none."""
        return math.inf if self.lowest is None else self.lowest.state.load

    def offer(self, pair: PrimalDualPair) -> bool:
        """Store a pair if it is a new best, lowest or highest solution; True if certified."""
        if self.best is None or (pair.state.admissible, -pair.gap) > (self.best.state.admissible, -self.best.gap):
            self.best = pair
        if not pair.is_solution(self.width):
            return False
        load = pair.state.load
        self.loads.append(load)
        if self.lowest is None or self._order(load) < self._order(self.lowest.state.load):
            self.lowest = pair
        if self.highest is None or load > self.highest.state.load:
            self.highest = pair
        return True

    def _order(self, load: float) -> tuple[bool, float]:
        """Return the sort key of a scaled λ that puts λ ≥ 0 before λ < 0."""
        return load < -self.zero_load, load


class MultiStartSearch:
    """Multi-start search for the lowest and highest solution; `found` collects certified ones."""

    # A point (q·m + 1,) holds scaled forces and λ. In space, methods that use linear programs do nothing.

    def __init__(self, analysis: LimitAnalysis, labels: Bits, options: ProximalOptions, associative: Proof) -> None:
        self.fixed_point = FixedPointSearch(analysis, labels, options)
        self.associative = associative
        self.found = Found(analysis.gap, tolerances.GAP * self.fixed_point.load_scale)
        self.modes: Modes | None = None if options.effective_area else modes_of(analysis.template, labels)
        load = associative.bracket[1]
        most = load if math.isfinite(load) else np.inf
        self.alternation = None if self.modes is None else AlternatingPrograms(self.modes, most * (1.0 + 1e-9))
        self._seed = 0
        self._ends = list[float]()  # Scaled λ at the end of each descent.

    def search(self, thorough: bool = True, sufficient_load: float = -math.inf) -> Found:
        """Search from all starts until a solution is as low as `sufficient_load`; return what was found."""
        for forces in starts(self.fixed_point, self.associative, thorough):
            self.search_from(forces)
            if self.found.lowest_load <= sufficient_load:
                return self.found
        if thorough and self.alternation is not None:
            self.search_first_solution()
            self.search_random_mechanisms()
            self.search_mixtures(sufficient_load)
        elif thorough and not self.fixed_point.options.effective_area:
            self.search_low_compression(sufficient_load)
        return self.found

    def search_first_solution(self) -> None:
        """Search from states of low compression until one solution is found (planar scenes)."""
        rng, nothing = np.random.default_rng(0), np.zeros(self.fixed_point.count + 1)
        for _ in range(_LITTLE if self.alternation is not None else 0):
            if self.found.lowest is not None:
                break
            closed = self.close_gap(self._mix(nothing, 1.0, rng))
            if closed is not None:
                self.improve(closed)

    def search_random_mechanisms(self) -> None:
        """Search for solutions whose mechanism is drawn at random, in planar scenes only."""
        # Proximal steps miss solutions whose compressed faces differ from those of every start.
        alternation, found = self.alternation, self.found
        for turn in range(_TURNS if alternation is not None else 0):
            assert alternation is not None
            points = sorted(alternation.random_solutions(turn, _DRAWS), key=lambda point: float(point[-1]))
            # the least and the largest λ of a round start one more descent where they lie outside of what was known,
            # and always where nothing was: then `end_before` is inf or NaN
            before = found.lowest_load, -_load_of(found.highest)
            self.certify_extremes(points)
            for end, sign, end_before in zip(points[:1] + points[-1:], (1.0, -1.0), before, strict=False):
                if not sign * float(end[-1]) >= end_before:
                    self.improve(end, 1)
            # Hardly any random mechanism of a wall has admissible forces.
            if found.lowest is not None and (not points or turn >= _ENOUGH):
                break

    def search_mixtures(self, sufficient_load: float = -math.inf) -> None:
        """Descend from mixtures of the lowest solution with states of low compression."""
        # The search runs only if earlier descents ended at different λ, and stops after several mixtures in a row
        # without gain. If all descents end at the same λ, hundreds of mixtures found nothing lower on walls of 83 to
        # 141 faces.
        distance = max(self._ends, default=0.0) - min(self._ends, default=0.0)
        if self.alternation is None or distance <= _LOWER * max(self._ends, default=0.0):
            return
        rng, idle = np.random.default_rng(0), 0
        while idle < _IDLE and self.found.lowest is not None and self.found.lowest_load > sufficient_load:
            low, state = self.found.lowest_load, self.found.lowest.state
            point = self._mix(np.append(state.forces.ravel(), low), float(rng.choice(_SHARES)), rng)
            closed = None if point is None else self.alternation.close_gap(point, self._seed)
            end = None if closed is None else self.alternation.descend(closed, self._seed, _TRIES)
            if end is not None:
                self.certify_extremes([end])
            self._seed += 1
            idle = 0 if self.found.lowest_load < low - _LOWER * abs(low) else idle + 1

    def _mix(self, point: Floats, share: float, rng: np.random.Generator) -> Floats | None:
        """Mix a point with a random state of low compression; None if there is none, or in space."""
        return None if self.alternation is None else self.alternation.mix_with_low_compression(point, share, rng)

    def close_gap(self, point: Floats | None) -> Floats | None:
        """Close the gap from a point by several seeds; point of least λ, uncertified, or None."""
        if self.alternation is None or point is None:
            return None
        ends = [end for k in range(_CLOSES) if (end := self.alternation.close_gap(point, self._seed + k)) is not None]
        self._seed += _CLOSES
        self.certify_extremes(ends)
        return min(ends, key=lambda end: float(end[-1]), default=None)

    def search_low_compression(self, sufficient_load: float = -math.inf) -> None:
        """Search from states of low compression on random faces, while λ decreases."""
        # The states have a λ below the lowest solution. In the plane, the descent by linear programs finds the same
        # solutions. In space, torsion reduces the friction of a joint, and the lowest solutions often have low
        # compression (docs/notes/tried.md).
        rng, idle = np.random.default_rng(0), 0
        for _ in range(_LITTLE):
            low = self.found.lowest_load
            most = min(low, self.associative.bracket[1])
            pair = low_compression_states(self.fixed_point, rng.random() * most if 0.0 < most < math.inf else 0.0, rng)
            if pair is not None:
                self.found.offer(pair)
            idle = idle + 1 if math.isclose(self.found.lowest_load, low, rel_tol=_LOWER) else 0
            if idle == _IDLE or self.found.lowest_load <= sufficient_load:
                break

    def search_from(self, forces: Floats, thorough: bool = True) -> None:
        """Search by proximal steps from scaled forces (q·m,), then improve the solution."""
        for pair in self.fixed_point.attempts(forces):
            point = np.append(pair.state.forces.ravel(), pair.state.load)
            if self.found.offer(pair) or pair.locked:
                continue
            closed = self.close_gap(point)
            if closed is not None:
                point = closed
                break
        self.improve(point, 2 if thorough else 1, thorough)

    def improve(self, point: Floats, seeds: int = 2, ascend: bool = True) -> None:
        """Search for solutions of lower and higher λ by linear programs from one solution."""
        if self.alternation is None:
            return
        for sign in (1.0, -1.0) if ascend else (1.0,):
            ends = [self.alternation.descend(point, self._seed + k, sign=sign) for k in range(seeds)]
            self.certify_extremes(end for end in ends if end is not None)
            self._ends += [float(end[-1]) for end in ends if end is not None and sign > 0.0]
        self._seed += seeds

    def certify_extremes(self, points: Iterable[Floats]) -> None:
        """Repair and certify the points of least and largest λ, unless inside the known range."""
        lowest, highest = self.found.lowest, self.found.highest
        ends = sorted(points, key=lambda point: float(point[-1]))
        for point in ends[:1] + ends[1:][-1:]:
            load, least = float(point[-1]), 1e-9 * max(abs(float(point[-1])), self.fixed_point.load_scale)
            both = lowest is not None and highest is not None
            if both and _load_of(lowest) - least <= load <= _load_of(highest) + least:
                continue
            self.found.offer(repair_and_evaluate(self.fixed_point, point))


def _load_of(pair: PrimalDualPair | None) -> float:
    return math.nan if pair is None else pair.state.load
