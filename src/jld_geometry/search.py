"""Trust region search for positions of joints: steps, restoration, phase one, starts."""

from __future__ import annotations

import itertools
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final, TypedDict

import numpy as np

from jld_core import Assembly, Bits, Floats, InputError, Route, Scene
from jld_core.scene import move
from jld_geometry.convex_cells import VertexMesh, vertex_mesh
from jld_geometry.evaluation import Evaluated, Evaluator
from jld_geometry.limits import Limits, SpatialLimits, require_spatial, spatial_variables
from jld_geometry.moved_scene import MovedScene, SpatialMesh, SpatialMovedScene, spatial_mesh
from jld_geometry.step import Goal, StepAnswer
from jld_geometry.variables import Variables, variables_of

_ROUTE: Final = Route("joints that move")


@dataclass(frozen=True)
class TrustRegion:
    """Parameters of the trust region, lengths relative to the mean edge of the structure."""

    # first, largest, least: radius at the start, largest radius, and radius at which a search ends
    first: float = 0.1
    largest: float = 1.0
    least: float = 1e-6
    accepted: float = 0.1  # share of the predicted gain that a point must keep to be accepted
    good: float = 0.7  # share of the predicted gain above which the radius grows
    # growth, shrinkage: factors on the radius
    growth: float = 2.0
    shrinkage: float = 0.3
    # coarse, gain: predicted gain, relative to the objective, below which a search from one start ends, and below which
    # the best point of all starts is stationary
    coarse: float = 1e-4
    gain: float = 1e-6
    kicks: int = 1  # number of times that a stationary point is tried with other optimal forces
    corrections: int = 0  # largest number of corrections of second order of one step
    points: int = 120  # largest number of points of one search


_RESTORED: Final = 1e-9  # violation of a dimensionless limit that counts as none

_RESTORATIONS: Final = 6  # largest number of Newton steps back into the limits

_STARTING: Final = 0.9  # share of a time limit for starts, where as many are made as it allows

_SHAKE: Final = 0.15  # standard deviation of the variables of further starts, relative to the mean edge


class GeometrySearch:
    """Search for the best positions of the joints of one structure, by variables z (k,)."""

    def __init__(self, scene: Scene, assembly: Assembly, labels: Bits, trust: TrustRegion | None = None) -> None:
        self.move, self.trust = scene.move or move.Move(), trust or TrustRegion()
        robust = assembly.has_low_values
        if robust and self.goal == "friction":
            problem = '"least_friction" has no low values, since friction is what it seeks'
            raise InputError("move.maximise", problem, '"load_factor", or nominal values')
        mesh: VertexMesh | SpatialMesh
        if assembly.dimension == 3:
            require_spatial(assembly, labels, self.move)
            mesh = space = spatial_mesh(assembly)
            self.variables: Variables = spatial_variables(assembly, space, self.move)
        else:
            mesh = plane = vertex_mesh(assembly)
            self.variables = variables_of(assembly, labels, plane, self.move)
        moving = np.zeros(len(mesh.places), dtype=bool)
        moving[self.variables.vertex] = True
        if self.variables.scaled:
            moving |= self.variables.rings != 0.0
        owner, edges = mesh.edges
        free = ~assembly.elements.support[owner]
        # trust region and tolerances are relative to the mean edge of free elements
        self.unit = float(np.linalg.norm(mesh.places[edges[:, 1]] - mesh.places[edges[:, 0]], axis=1)[free].mean())
        limits: Limits | SpatialLimits
        if isinstance(mesh, SpatialMesh):
            limits = SpatialLimits(assembly, labels, mesh, moving, self.move)
            self.moved: MovedScene | SpatialMovedScene = SpatialMovedScene(scene, assembly, labels, mesh, moving)
        else:
            limits = Limits(scene, assembly, labels, mesh, moving, self.move)
            self.moved = MovedScene(scene, assembly, labels, mesh)
        self.evaluator = Evaluator(self.moved, mesh, labels, self.variables, limits, self.unit, robust)
        self.required = assembly.required
        self._friction = float(np.nan_to_num(assembly.strengths(_ROUTE).friction[labels]).max(initial=0.0))

    # --- points -----------------------------------------------------------------------------------------

    @property
    def goal(self) -> Goal:
        """Objective of the programs of steps, from the key "maximise" of the scene."""
        goals: dict[str, Goal] = {"least_friction": "friction", "least_thickness": "thickness"}
        return goals.get(self.move.maximise, "load_factor")

    def evaluate(self, values: Floats, near: Evaluated | None) -> Evaluated | None:
        """Evaluate the objective at variables z with a proof; None where none is found."""
        if self.goal == "friction":
            return self.evaluator.friction(values, 1.0 if near is None else near.friction)
        if self.goal == "thickness":
            return self.evaluator.thickness(values)
        return self.evaluator.load_factor(values, near)

    def value_of(self, point: Evaluated) -> float:
        """Convert an objective to λ, the largest friction coefficient, or the thickness."""
        if self.goal == "friction":
            return -point.objective * self._friction
        return point.objective if self.goal == "load_factor" else -point.objective

    def restored(self, values: Floats) -> Floats | None:
        """Return variables near z that keep all limits and ties, by a few Newton steps, or None."""
        variables, limits = self.variables, self.evaluator.limits
        held = limits.equal.copy()
        for _ in range(_RESTORATIONS):
            present = limits.at(variables.places(values))
            lacks = np.where(limits.equal, abs(present.values), limits.least - present.values)
            held |= lacks > 0.1 * _RESTORED
            rows = np.flatnonzero(held)
            if lacks.max(initial=0.0) <= _RESTORED:
                return values
            target = np.where(limits.equal, 0.0, limits.least)[rows]
            slopes = (present.rates[rows] @ variables.jacobian(values)).toarray()
            matrix = np.vstack([slopes, variables.ties])
            right = np.concatenate([target - present.values[rows], np.zeros(len(variables.ties))])
            values = values + np.linalg.lstsq(matrix, right, rcond=1e-12)[0]
        return None

    def bounds(self, values: Floats, radius: float) -> tuple[Floats, Floats]:
        """Return bounds low, high (k,) on a step from z by trust region and user's box."""
        low, high = np.full(len(values), -radius), np.full(len(values), radius)
        box = self.move.box
        if box is not None:
            lines = len(self.variables.vertex)  # the thickness of an arch has no box
            low[:lines] = np.maximum(low[:lines], np.minimum(0.0, -box - values[:lines]))
            high[:lines] = np.minimum(high[:lines], np.maximum(0.0, box - values[:lines]))
        return low, high

    # --- search -----------------------------------------------------------------------------------------

    def first(self) -> Evaluated | None:
        """Return the point of the scene as it is, with its proven value, or None."""
        return self.evaluate(np.zeros(self.variables.count), None)

    def standing(self, values: Floats, deadline: float) -> Evaluated | None:
        """Move joints from variables z until the structure stands (phase one), or None."""
        point, radius = self.evaluator.missing(values), self.trust.first * self.unit
        for _ in range(self.trust.points):
            if point is None or radius < self.trust.least * self.unit or time.perf_counter() > deadline:
                return None
            answer = self.evaluator.step(point, *self.bounds(point.values, radius), "slack")
            target = None if answer is None else self.restored(point.values + answer.change)
            new = None if target is None else self.evaluator.missing(target)
            if answer is None or new is None or new.objective <= point.objective:
                radius *= self.trust.shrinkage
                continue
            point, radius = new, min(self.trust.growth * radius, self.trust.largest * self.unit)
            if point.objective > 0.0:
                standing = self.evaluate(point.values, None)
                if standing is not None:
                    return standing
        return None

    def improve(
        self, point: Evaluated, deadline: float, report: Callable[[Evaluated, float, float], None], gain: float
    ) -> tuple[Evaluated, str]:
        """Improve a point until it is "stationary" or "locked", or "time" or "points" are over."""
        # A step is the best of a linear program within a trust region, accepted if it keeps a share of its promise.
        # Derivatives rest on the forces of the point. Where the forces are not unique those found may promise nothing
        # though others would, so a point is called stationary only after `trust.kicks` other choices of forces.
        trust, radius = self.trust, self.trust.first * self.unit
        random, kicks = np.random.default_rng(0), 0
        for _ in range(trust.points):
            if point.locked:
                return point, "locked"
            if time.perf_counter() > deadline:
                return point, "time"
            new, predicted = self._try(point, radius)
            promise = predicted - point.objective
            if not promise > gain * abs(point.objective) or radius < trust.least * self.unit:
                if kicks == trust.kicks or self.goal != "load_factor":
                    return point, "stationary"
                kicks += 1
                point, radius = self._with_other_forces(point, random), trust.first * self.unit
                continue
            if new is None or not new.objective - point.objective > trust.accepted * promise:
                radius *= trust.shrinkage
                continue
            if new.objective - point.objective > trust.good * promise:
                radius = min(trust.growth * radius, trust.largest * self.unit)
            point = new
            report(point, predicted, radius)
        return point, "points"

    def _try(self, point: Evaluated, radius: float) -> tuple[Evaluated | None, float]:
        """Take one step; return the best point found or None, and the predicted objective."""
        low, high = self.bounds(point.values, radius)
        answer = self.evaluator.step(point, low, high, self.goal)
        if answer is None:
            return None, math.inf
        predicted = self._predicted(point, answer)
        needed = point.objective + self.trust.accepted * (predicted - point.objective)
        best: Evaluated | None = None
        trial = point
        for _ in range(1 + self.trust.corrections):
            target = self.restored(trial.values + answer.change)
            if target is None:
                break
            new = self.evaluate(target, self.evaluator.with_forces(point, answer))
            if new is not None and (best is None or new.objective > best.objective):
                best = new
            if self.goal != "load_factor" or (best is not None and best.objective >= needed):
                break
            again = self.evaluator.frozen(target, answer, trial.states)
            if again is None:
                break
            trial = again
            corrected = self.evaluator.step(trial, low + point.values - target, high + point.values - target, self.goal)
            if corrected is None:
                break
            answer = corrected
        return best, predicted

    def _predicted(self, point: Evaluated, answer: StepAnswer) -> float:
        if self.goal == "friction":
            return -point.friction * (1.0 + answer.value)
        if self.goal == "thickness":
            return point.objective - float(answer.change[-1])
        return answer.value

    def _with_other_forces(self, point: Evaluated, random: np.random.Generator) -> Evaluated:
        """Return a point with other, randomly chosen optimal forces, to look for an ascent."""
        still = np.zeros(self.variables.count)
        objective = random.normal(size=point.states[0].forces.size)
        answer = self.evaluator.step(point, still, still, self.goal, objective)
        if answer is None:
            return point
        states = [replace(state, forces=forces) for state, forces in zip(point.states, answer.forces, strict=True)]
        return replace(point, states=states)

    def shaken(self, number: int, best: Floats | None) -> Floats | None:
        """Draw random variables z for a further start, around `best` for odd numbers; or None."""
        random = np.random.default_rng(number)
        basis = self.variables.basis
        step = basis @ random.normal(size=basis.shape[1]) * _SHAKE * self.unit
        if self.variables.scaled:
            step[-1] = 0.0
        centre = np.zeros(len(step)) if best is None or number % 2 == 0 else best
        low, high = self.bounds(np.zeros(len(step)), math.inf)
        for share in (1.0, 0.5, 0.25, 0.1):
            moved = centre + share * step
            values = self.restored(np.clip(moved, low, high))
            if values is not None and self.evaluator.assembly(values) is not None:
                return values
        return None


@dataclass(frozen=True)
class Point:
    start: int  # number of the start, from 0
    step: int  # number of the point within its search; 0 is the start itself
    value: float  # λ, least friction coefficient factor, or least thickness
    bracket: tuple[float, float]  # proven bounds on λ; NaN where λ is not the objective or not bounded
    predicted: float  # value that the program of the step promised
    radius: float  # radius of the trust region, length
    solves: int  # number of proven solves so far
    seconds: float  # time since the search began, s


class MoveOptions(TypedDict, total=False):
    """Options that every optimisation of joints takes by keyword."""

    seconds: float  # time limit, s. The point in work is finished. Default: none.
    starts: int | None  # the scene itself, and shaken ones; None: as many as the time allows. Default: 1.
    trust: TrustRegion | None  # parameters of the search. Default: those of `TrustRegion`.
    progress: Callable[[Point], None] | None  # called with every accepted point. Default: none.


class MoveRun:
    """Starts of an optimisation under one time limit, and the record of their points."""

    def __init__(
        self,
        *,
        seconds: float = math.inf,
        starts: int | None = 1,
        trust: TrustRegion | None = None,
        progress: Callable[[Point], None] | None = None,
    ) -> None:
        self._began, self._progress = time.perf_counter(), progress
        # without a limit, as many as the time allows would never end
        self._starts = starts if starts is not None or seconds < math.inf else 1
        self.deadline, self.trust, self.watched = self._began + seconds, trust, progress is not None
        self.until = self._began + (_STARTING if starts is None else 1.0) * seconds
        self.points: list[Point] = []
        self.best: Floats | None = None
        self._taken: Counter[int] = Counter()

    def each_start(self, search: GeometrySearch) -> Iterator[tuple[int, Floats | None]]:
        """Yield number and variables (k,), None where none was found, of each start in time."""
        for number in itertools.count() if self._starts is None else range(self._starts):
            if number and time.perf_counter() > self.until:
                return
            yield number, np.zeros(search.variables.count) if number == 0 else search.shaken(number, self.best)

    def record(
        self, start: int, value: float, bracket: tuple[float, float], predicted: float, radius: float, solves: int
    ) -> None:
        spent = time.perf_counter() - self._began
        point = Point(start, self._taken[start], value, bracket, predicted, radius, solves, spent)
        self._taken[start] += 1
        self.points.append(point)
        if self._progress is not None:
            self._progress(point)
