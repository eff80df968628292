"""Proven value of one geometry: λ, least friction or least thickness, with forces for the next step."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core import Assembly, Bits, Floats, InputError, LimitAnalysisResult, Route, Status, build_assembly
from jld_core.build import build_robust
from jld_core.models import solve_rigid
from jld_core.program import Template
from jld_geometry.convex_cells import VertexMesh
from jld_geometry.limits import Limits, SpatialLimits
from jld_geometry.moved_scene import MovedScene, SpatialMesh, SpatialMovedScene
from jld_geometry.step import CaseState, Goal, Region, StepAnswer, solve_step
from jld_geometry.variables import Variables

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
            CaseState(Template(one.assembly), one.forces, one.load_factor, float(required), mechanism=one.mechanism)
            for one, required in zip(cases, assembly.required, strict=True)
            if one.forces is not None and one.status is Status.COLLAPSE
        ]
        if self.dead_stands:
            states += self._dead_states(values, assembly, [] if near is None else near.states)
        return Evaluated(values, result.load_factor, result, states)

    @staticmethod
    def with_forces(point: Evaluated, answer: StepAnswer) -> Evaluated:
        """Copy a point with the unproven forces that the program of its step found."""
        states = [
            replace(state, forces=own, mechanism=None) for state, own in zip(point.states, answer.forces, strict=True)
        ]
        return replace(point, states=states)

    def _dead_states(self, values: Floats, assembly: Assembly, near: list[CaseState]) -> list[CaseState]:
        """Return admissible forces under each different dead load of the load cases."""
        known = [state for state in near if state.dead]
        different: list[Assembly] = []
        for case in assembly.by_case:
            if not any(np.array_equal(case.dead, other.dead) for other in different):
                different.append(case)
        if len(known) == len(different):
            return [replace(one, template=Template(case)) for one, case in zip(known, different, strict=True)]
        none = np.zeros((len(self.labels), different[0].freedoms))
        states = [CaseState(Template(case), none, 0.0, 1.0, dead=True) for case in different]
        still = np.zeros(self.variables.count)
        answer = self.step(Evaluated(values, 0.0, None, states), still, still, "slack")
        if answer is None:
            return []
        return [replace(state, forces=own) for state, own in zip(states, answer.forces, strict=True)]

    def frozen(self, values: Floats, answer: StepAnswer, states: list[CaseState]) -> Evaluated | None:
        """Return an unproven point at variables z with the forces that a step found."""
        # A second-order correction starts from such a point.
        assembly = self.assembly(values)
        if assembly is None:
            return None
        named = {one.name: one for one in assembly.by_case}
        found = [
            replace(state, template=Template(named[state.template.assembly.name]), forces=forces, load_factor=factor)
            for state, forces, factor in zip(states, answer.forces, answer.load_factors, strict=True)
        ]
        return Evaluated(values, answer.value, None, found)

    def missing(self, values: Floats) -> Evaluated | None:
        """Return an unproven point at variables z, whose objective is its spare strength; None if invalid."""
        # The objective is minus the least force that, added to every yield condition, lets the structure stand at some
        # λ ≥ 0. Phase one maximises it until it is positive.
        assembly = self.assembly(values)
        if assembly is None:
            return None
        states = [
            CaseState(Template(one), np.zeros((len(self.labels), one.freedoms)), 0.0, float(required))
            for one, required in zip(assembly.by_case, assembly.required, strict=True)
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
                CaseState(Template(_with_friction_factor(one, factor)), own, 0.0, 1.0)
                for one, own in zip(assembly.by_case, forces, strict=True)
            ]
            answer = self.step(Evaluated(values, 0.0, None, states), still, still, "friction")
            if answer is None or 1.0 + answer.value <= 0.0:
                return None
            factor *= 1.0 + answer.value
            forces = list(answer.forces)
            if abs(answer.value) <= _NEWTON:
                break
        states = [replace(state, forces=own) for state, own in zip(states, forces, strict=True)]
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
        whole = self.variables.thickness
        for _ in range(_ROUNDS):
            point = self.missing(values)
            low[-1], high[-1] = -0.2 * (whole + values[-1]), 0.2 * (whole + values[-1])
            answer = None if point is None else self.step(point, low, high, "thickness")
            if point is None or answer is None:
                return None
            values[-1] += answer.change[-1]
            states = point.states
            if abs(answer.change[-1]) <= _NEWTON * whole:
                break
        for margin in _MARGINS:
            trial = values.copy()
            trial[-1] += margin * whole
            assembly = self.assembly(trial)
            if assembly is None:
                return None
            self.solves += 1
            result = solve_rigid(assembly, self.labels)
            if stands(result):
                return Evaluated(trial, -(whole + trial[-1]), result, states)
        return None


def _with_friction_factor(assembly: Assembly, factor: float) -> Assembly:
    strengths = assembly.strengths(_ROUTE)
    return assembly.with_strengths(replace(strengths, friction=strengths.friction * factor))


def stands(result: LimitAnalysisResult) -> bool:
    """Return whether the dead load alone is proven to stand under every case."""
    return all(one.stands_at_zero is True for one in (result.cases.values() or [result]))
