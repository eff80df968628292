"""Program of one step over forces and positions (11.6), and the proven value of one geometry."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import scipy.sparse as sp

from jld_core import Assembly, Bits, Floats, InputError, LimitAnalysisResult, Route, Status, build_assembly
from jld_core.build import build_robust
from jld_core.models import solve_rigid
from jld_core.program import ConicProgram, Template, pack
from jld_core.solvers import ClarabelSolver, RawStatus
from jld_geometry.convex_cells import VertexMesh
from jld_geometry.limits import Limits, LimitValues, SpatialLimits, spatial_residual_rates
from jld_geometry.moved_scene import MovedScene, SpatialMesh, SpatialMovedScene
from jld_geometry.spatial_rates import length_rates, residual_rates
from jld_geometry.variables import Variables

# λ; least factor on friction or least thickness at λ = 0; the missing strength
Goal = Literal["load_factor", "friction", "thickness", "slack"]

_TOLERANCE: Final = 1e-9  # residual and gap of the programs of steps; accepted points are proven apart


_KICKED: Final = 1e-9  # share of its value that the goal may lose while other optimal forces are sought


@dataclass(frozen=True)
class CaseState:
    template: Template  # program data of the case
    forces: Floats  # (m, q) optimal forces, scene units; q = 3, or 6 in space
    load_factor: float  # their λ
    required: float  # required load factor of the case
    dead: bool = False  # True where only the dead load acts, which has to stand; λ is 0 and no goal
    mechanism: Floats | None = None  # (n, 6) in space: mechanism by which corner forces are chosen that are not unique


@dataclass(frozen=True)
class StepAnswer:
    """Answer of the program of one step: it is not proven, and its geometry is linearised."""

    # governing λ / required; or relative change of friction, increase of thickness, or missing strength, by the goal
    value: float
    change: Floats  # (k,) step of the variables
    forces: tuple[Floats, ...]  # forces of each case, scene units
    load_factors: tuple[float, ...]  # λ of each case


@dataclass(frozen=True)
class Region:
    """Steps allowed at the present position: derivatives, limits, ties and bounds."""

    jacobian: sp.csr_array  # (d·v, k) derivatives of positions by variables
    limits: LimitValues  # values of the r limits at the present position
    least: Floats  # (r,) least value of each limit, dimensionless
    equal: Bits  # (r,) True where a limit is an equation
    ties: Floats  # (t, k) ties of variables: ties @ step = 0
    # low, high: (k,) bounds of the step
    low: Floats
    high: Floats


def solve_step(
    states: list[CaseState],
    labels: Bits,
    mesh: VertexMesh | SpatialMesh,
    region: Region,
    goal: Goal,
    kick: Floats | None = None,
) -> StepAnswer | None:
    """Solve the program of one step (11.6), unproven; None where the solver finds no answer.

    kick: objective on the forces of the first case, in place of the goal, which keeps its value.
    """
    # The answer is not proven: positions are linearised.
    rows = _Rows(states, region.jacobian.shape[1])
    if isinstance(mesh, SpatialMesh):  # joints in space that move have no strength that grows with them
        lengths = sp.csr_array((len(labels), rows.count))
    else:
        lengths = sp.diags_array(1.0 / states[0].template.assembly.interfaces.l1) @ length_rates(mesh) @ region.jacobian
    for k, state in enumerate(states):
        _add_case(rows, k, state, labels, mesh, region, sp.csr_array(lengths), goal)
    _add_shape(rows, region)
    objective = np.zeros(rows.width)
    objective[-1] = -1.0 if goal == "load_factor" else 1.0
    if goal == "thickness":
        objective[-1] = 0.0
        objective[-2] = 1.0 / max(float(abs(region.low[-1])), float(region.high[-1]))
        rows.add("equal", sp.csr_array(([1.0], ([0], [rows.width - 1])), shape=(1, rows.width)), np.zeros(1))
    if kick is not None:
        present = min(state.load_factor / state.required for state in states if not state.dead) / rows.unit
        last = sp.csr_array(([-1.0], ([0], [rows.width - 1])), shape=(1, rows.width))
        rows.add("linear", last, np.array([-present + _KICKED * abs(present)]))
        objective[:] = 0.0
        objective[: len(kick)] = kick
    raw = ClarabelSolver(_TOLERANCE).solve(rows.program(objective))
    if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
        return None
    return rows.answer(raw.point, goal)


class _Rows:
    """Constraints of the program of a step: columns of each load case, k steps, and the goal."""

    def __init__(self, states: list[CaseState], count: int) -> None:
        self._states, self.count = states, count
        self.start = np.cumsum([0, *(state.template.columns for state in states)]).tolist()
        self.width = int(self.start[-1]) + count + 1
        self.unit = states[0].template.scaling.load / states[0].required
        self._groups: dict[str, list[tuple[sp.csr_array, Floats]]] = {"equal": [], "linear": [], "cones": []}
        self.cones: list[int] = []

    def add(self, group: str, rows: sp.csr_array, right: Floats) -> None:
        """Add rows (r, width) with right-hand sides (r,) to the group "equal", "linear" or "cones"."""
        self._groups[group].append((rows, right))

    def placed(self, case: int, of_case: sp.csr_array, steps: sp.csr_array | None, goal: Floats | None) -> sp.csr_array:
        """Pad coefficients of one case, of steps (r, k) and of the goal (r,) to all columns (r, width)."""
        count = of_case.shape[0]
        before = sp.csr_array((count, self.start[case]))
        after = sp.csr_array((count, self.start[-1] - self.start[case + 1]))
        moved = sp.csr_array((count, self.count)) if steps is None else steps
        last = sp.csr_array((count, 1)) if goal is None else sp.csr_array(goal[:, None])
        return sp.csr_array(sp.hstack([before, of_case, after, moved, last]))

    def program(self, objective: Floats) -> ConicProgram:
        """Assemble the conic program of all groups; objective: (width,)."""
        groups = [self._groups[name] for name in ("equal", "linear", "cones")]
        parts = [rows for group in groups for rows, _ in group]
        right = np.concatenate([right for group in groups for _, right in group])
        sizes = [sum(rows.shape[0] for rows, _ in group) for group in groups]
        return pack(sp.vstack(parts), right, objective, sizes[0], sizes[1], tuple(self.cones))

    def answer(self, point: Floats, goal: Goal) -> StepAnswer:
        """Convert a solution (width,) to forces and λ in scene units, step and value of the goal."""
        forces, factors = [], []
        for k, state in enumerate(self._states):
            of_case = point[self.start[k] : self.start[k + 1]]
            scaling = state.template.scaling
            forces.append(of_case[: scaling.face.size].reshape(scaling.face.shape) * scaling.face)
            factors.append(float(of_case[-1]) * scaling.load)
        change = point[self.start[-1] : -1]
        values = {"load_factor": self.unit * point[-1], "thickness": change[-1] if self.count else 0.0}
        return StepAnswer(float(values.get(goal, point[-1])), change, tuple(forces), tuple(factors))


def _add_case(
    rows: _Rows,
    case: int,
    state: CaseState,
    labels: Bits,
    mesh: VertexMesh | SpatialMesh,
    region: Region,
    lengths: sp.csr_array,
    goal: Goal,
) -> None:
    """Add the equilibrium, yield and goal rows of one load case; lengths: (m, k) relative rates."""
    template = state.template
    program, scaling = template.program(labels), template.scaling
    structure = program.structure
    matrix = program.matrix.tocsr()
    assembly, jacobian = template.assembly, region.jacobian
    if isinstance(mesh, SpatialMesh):
        used = np.diff(jacobian.tocsr().indptr).reshape(-1, 3).max(axis=1) > 0
        rates = spatial_residual_rates(assembly, mesh, state.forces, state.load_factor, state.mechanism, used)
    else:
        rates = residual_rates(assembly, mesh, state.forces, state.load_factor)
    rates = rates @ jacobian
    rates = sp.csr_array(sp.diags_array(1.0 / scaling.row.ravel()) @ rates)
    rows.add(
        "equal", rows.placed(case, matrix[: structure.equalities], rates, None), program.rhs[: structure.equalities]
    )
    first = structure.equalities + 1  # after the row that bounds λ
    right = program.rhs[first:]
    # right-hand sides of yield rows grow with the length of their face
    stretched = sp.csr_array(sp.diags_array(-right) @ lengths[template.yield_set.pattern.row_face])
    column = np.zeros(len(right))  # of the goal
    if goal == "slack":
        column[: structure.linear - 1] = -1.0
        column[structure.heads - first] = -1.0
    elif goal == "friction":
        column = _friction_column(template, labels, state.forces, len(right))
    linear = structure.linear - 1
    yields = rows.placed(case, matrix[first:], stretched, column)
    rows.add("linear", yields[:linear], right[:linear])
    rows.add("cones", yields[linear:], right[linear:])
    rows.cones += list(structure.cones)
    _add_goal(rows, case, state, goal)


def _add_goal(rows: _Rows, case: int, state: CaseState, goal: Goal) -> None:
    """Add the row or rows that tie λ of one load case to the goal, or hold it at 0."""
    columns = state.template.columns
    load = sp.csr_array(([1.0], ([0], [columns - 1])), shape=(1, columns))
    if state.dead:
        rows.add("equal", rows.placed(case, load, None, None), np.zeros(1))
    elif goal == "load_factor":
        scale = state.template.scaling.load / state.required / rows.unit
        rows.add("linear", rows.placed(case, -scale * load, None, np.ones(1)), np.zeros(1))
    elif goal == "slack":
        rows.add("linear", rows.placed(case, -load, None, None), np.zeros(1))
        rows.add("linear", rows.placed(case, 0.0 * load, None, -np.ones(1)), np.ones(1))
    else:
        rows.add("equal", rows.placed(case, load, None, None), np.zeros(1))


def _friction_column(template: Template, labels: Bits, forces: Floats, count: int) -> Floats:
    """Return the derivatives (count,) of yield rows by a common factor on dry friction."""
    pattern = template.yield_set.pattern
    scaled = (forces / template.scaling.face).ravel()
    of_friction = pattern.capacity[labels[pattern.face[pattern.capacity]]]  # entries of the friction of dry faces
    rates = pattern.dry[of_friction] * scaled[pattern.column[of_friction]]
    return np.bincount(pattern.row[of_friction], weights=rates, minlength=count).astype(float)


def _add_shape(rows: _Rows, region: Region) -> None:
    """Add limits on shapes, ties and bounds of the step to its program."""
    count = rows.count

    def placed(steps: sp.csr_array) -> sp.csr_array:
        before = sp.csr_array((steps.shape[0], rows.start[-1]))
        return sp.csr_array(sp.hstack([before, steps, sp.csr_array((steps.shape[0], 1))]))

    slopes = sp.csr_array(region.limits.rates @ region.jacobian)
    used = np.diff(slopes.indptr) > 0
    equal, bounded = np.flatnonzero(used & region.equal), np.flatnonzero(used & ~region.equal)
    values = region.limits.values
    rows.add("equal", placed(slopes[equal]), -values[equal])
    rows.add("equal", placed(sp.csr_array(region.ties)), np.zeros(len(region.ties)))
    # a limit that was missed by rounding, or by the curvature of the last step, may stay as it is
    lower = np.minimum(region.least, values)
    rows.add("linear", placed(-slopes[bounded]), (values - lower)[bounded])
    unit = sp.csr_array(sp.eye_array(count))
    rows.add("linear", placed(unit), region.high)
    rows.add("linear", placed(-unit), -region.low)


_ROUTE: Final = Route("joints that move")

_ROUNDS: Final = 12  # largest number of Newton steps to the least friction or thickness of one geometry

_NEWTON: Final = 1e-10  # relative change of friction or thickness at which these steps end

# Relative increases of the least friction or thickness at which standing is proven, in the order tried
_MARGINS: Final = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5)


@dataclass(frozen=True)
class Evaluated:
    """One geometry with its value and the forces from which the next step starts."""

    values: Floats  # (k,) variables z, see `Variables`
    objective: float  # number that is maximised: λ, or minus the least friction factor, thickness or missing strength
    # analysis at this geometry. None where the objective has no proof: a missing strength, and forces that are
    # predicted by the program of a step.
    result: LimitAnalysisResult | None
    states: list[CaseState]  # forces of the load cases that can govern
    friction: float = 1.0  # factor on friction at which `result` holds

    @property
    def locked(self) -> bool:
        """True if λ is unbounded: this geometry carries any live load."""
        return self.result is not None and self.result.status is Status.LOCKED


_THICKER: Final = 0.2  # largest relative change of the thickness in one Newton step


class Evaluator:
    """Proven values of one structure at any positions of its vertices, by variables z (k,)."""

    def __init__(
        self,
        moved: MovedScene | SpatialMovedScene,
        mesh: VertexMesh | SpatialMesh,
        labels: Bits,
        variables: Variables,
        limits: Limits | SpatialLimits,
        unit: float,
        robust: bool = False,
    ) -> None:
        self._build = build_robust if robust else build_assembly
        self._moved, self._mesh, self.labels = moved, mesh, labels
        self.variables, self.limits, self.unit = variables, limits, unit
        self.dead_stands: bool | None = None
        self.solves = 0

    def assembly(self, values: Floats) -> Assembly | None:
        """Return the assembly at variables z; None where elements turn over or overlap."""
        try:
            return self._build(self._moved.at(self.variables.places(values)))
        except InputError:
            return None

    def mesh(self, values: Floats) -> VertexMesh | SpatialMesh:
        """Return the vertices at variables z, without a check that they form a structure."""
        return self._mesh.at(self.variables.places(values))

    def region(self, values: Floats, low: Floats, high: Floats) -> Region:
        """Compute the linearised limits, ties and bounds low, high (k,) of a step from variables z."""
        places, unit = self.variables.places(values), self.unit
        jacobian = self.variables.jacobian(values) * unit
        limits = self.limits.at(places)
        ties = self.variables.ties
        return Region(jacobian, limits, self.limits.least, self.limits.equal, ties, low / unit, high / unit)

    def step(
        self, point: Evaluated, low: Floats, high: Floats, goal: Goal, kick: Floats | None = None
    ) -> StepAnswer | None:
        """Solve the program of a step within low, high (k,), lengths; an unproven answer, or None."""
        region = self.region(point.values, low, high)
        answer = solve_step(point.states, self.labels, self.mesh(point.values), region, goal, kick)
        return None if answer is None else replace(answer, change=answer.change * self.unit)

    def load_factor(self, values: Floats, near: Evaluated | None) -> Evaluated | None:
        """Return the point at variables z with its proven λ; None if it has none."""
        # The first call decides whether the dead load has to stand.
        assembly = self.assembly(values)
        if assembly is None:
            return None
        self.solves += 1
        result = solve_rigid(assembly, self.labels)
        if result.status not in (Status.COLLAPSE, Status.LOCKED):
            return None
        if self.dead_stands is None:
            self.dead_stands = stands(result)
        elif self.dead_stands and not stands(result):
            return None
        if result.status is Status.LOCKED:
            return Evaluated(values, math.inf, result, [])
        cases = list(result.cases.values()) or [result]
        states = [
            CaseState(Template(case.assembly), case.forces, case.load_factor, float(required), mechanism=case.mechanism)
            for case, required in zip(cases, assembly.required, strict=True)
            if case.forces is not None and case.status is Status.COLLAPSE
        ]
        if self.dead_stands:
            states += self._dead_states(values, assembly, [] if near is None else near.states)
        return Evaluated(values, result.load_factor, result, states)

    @staticmethod
    def with_forces(point: Evaluated, answer: StepAnswer) -> Evaluated:
        """Copy a point with the unproven forces that the program of its step found."""
        states = [
            replace(state, forces=forces, mechanism=None)
            for state, forces in zip(point.states, answer.forces, strict=True)
        ]
        return replace(point, states=states)

    def _dead_states(self, values: Floats, assembly: Assembly, near: list[CaseState]) -> list[CaseState]:
        """Return admissible forces under each different dead load of the load cases."""
        dead_states = [state for state in near if state.dead]
        different: list[Assembly] = []
        for case in assembly.by_case:
            if not any(np.array_equal(case.dead, other.dead) for other in different):
                different.append(case)
        if len(dead_states) == len(different):
            return [
                replace(dead_state, template=Template(case))
                for dead_state, case in zip(dead_states, different, strict=True)
            ]
        none = np.zeros((len(self.labels), different[0].freedoms))
        states = [CaseState(Template(case), none, 0.0, 1.0, dead=True) for case in different]
        still = np.zeros(self.variables.count)
        answer = self.step(Evaluated(values, 0.0, None, states), still, still, "slack")
        if answer is None:
            return []
        return [replace(state, forces=forces) for state, forces in zip(states, answer.forces, strict=True)]

    def frozen(self, values: Floats, answer: StepAnswer, states: list[CaseState]) -> Evaluated | None:
        """Return an unproven point at variables z with the forces that a step found."""
        # A second-order correction starts from such a point.
        assembly = self.assembly(values)
        if assembly is None:
            return None
        by_name = {case.name: case for case in assembly.by_case}
        frozen_states = [
            replace(state, template=Template(by_name[state.template.assembly.name]), forces=forces, load_factor=factor)
            for state, forces, factor in zip(states, answer.forces, answer.load_factors, strict=True)
        ]
        return Evaluated(values, answer.value, None, frozen_states)

    def missing(self, values: Floats) -> Evaluated | None:
        """Return an unproven point at variables z, whose objective is its spare strength; None if invalid."""
        # The objective is minus the least force that, added to every yield condition, lets the structure stand at some
        # λ ≥ 0. Phase one maximises it until it is positive.
        assembly = self.assembly(values)
        if assembly is None:
            return None
        states = [
            CaseState(Template(case), np.zeros((len(self.labels), case.freedoms)), 0.0, float(required))
            for case, required in zip(assembly.by_case, assembly.required, strict=True)
        ]
        still = np.zeros(self.variables.count)
        answer = self.step(Evaluated(values, 0.0, None, states), still, still, "slack")
        if answer is None:
            return None
        states = [
            replace(state, forces=forces, load_factor=factor)
            for state, forces, factor in zip(states, answer.forces, answer.load_factors, strict=True)
        ]
        return Evaluated(values, -answer.value * states[0].template.scaling.force, None, states)

    def friction(self, values: Floats, first: float) -> Evaluated | None:
        """Return the point at variables z with the least factor on friction at which it stands, or None."""
        # The dead load is proven to stand at that factor, which is at most 1e-5 above the one that Newton steps found.
        assembly, factor = self.assembly(values), first
        point = None if assembly is None else self.missing(values)
        if assembly is None or point is None:
            return None
        still = np.zeros(self.variables.count)
        forces = [state.forces for state in point.states]
        for _ in range(_ROUNDS):
            states = [
                CaseState(Template(_with_friction_factor(case, factor)), forces_of_case, 0.0, 1.0)
                for case, forces_of_case in zip(assembly.by_case, forces, strict=True)
            ]
            answer = self.step(Evaluated(values, 0.0, None, states), still, still, "friction")
            if answer is None or 1.0 + answer.value <= 0.0:
                return None
            factor *= 1.0 + answer.value
            forces = list(answer.forces)
            if abs(answer.value) <= _NEWTON:
                break
        states = [replace(state, forces=forces_of_case) for state, forces_of_case in zip(states, forces, strict=True)]
        for margin in _MARGINS:
            self.solves += 1
            result = solve_rigid(_with_friction_factor(assembly, factor * (1.0 + margin)), self.labels)
            if stands(result):
                return Evaluated(values, -factor * (1.0 + margin), result, states, factor * (1.0 + margin))
        return None

    def thickness(self, values: Floats) -> Evaluated | None:
        """Return a point near variables z with the least thickness at which it stands, or None."""
        # Only the last variable, the thickness, differs from z. The dead load is proven to stand there.
        values, states = values.copy(), []
        low, high = np.zeros(self.variables.count), np.zeros(self.variables.count)
        thickness = self.variables.thickness
        for _ in range(_ROUNDS):
            point = self.missing(values)
            high[-1] = _THICKER * (thickness + values[-1])
            low[-1] = -high[-1]
            answer = None if point is None else self.step(point, low, high, "thickness")
            if point is None or answer is None:
                return None
            values[-1] += answer.change[-1]
            states = point.states
            if abs(answer.change[-1]) <= _NEWTON * thickness:
                break
        for margin in _MARGINS:
            trial = values.copy()
            trial[-1] += margin * thickness
            assembly = self.assembly(trial)
            if assembly is None:
                return None
            self.solves += 1
            result = solve_rigid(assembly, self.labels)
            if stands(result):
                return Evaluated(trial, -(thickness + trial[-1]), result, states)
        return None


def _with_friction_factor(assembly: Assembly, factor: float) -> Assembly:
    strengths = assembly.strengths(_ROUTE)
    return assembly.with_strengths(replace(strengths, friction=strengths.friction * factor))


def stands(result: LimitAnalysisResult) -> bool:
    """Return whether the dead load alone is proven to stand under every case."""
    return all(case.stands_at_zero is True for case in (result.cases.values() or [result]))
