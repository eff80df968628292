"""Search for positions of joints with the largest λ of blocks that may crack anywhere.

The program of a step has stresses and positions as variables. Its objective is the upper bound by fields on a coarse
mesh, which is nearer to λ than lower bounds on such meshes (docs/method.md (11.9)). It proves nothing: results are
bounded from both sides afterwards.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.fields.adaptive import Fields
from jld_core.fields.conic import ConeProgram
from jld_core.fields.mesh import subdivide
from jld_core.fields.weak_equilibrium import WeakEquilibrium
from jld_geometry.field_mesh import FieldMesh
from jld_geometry.search import GeometrySearch
from jld_geometry.step import Region
from jld_geometry.vertex_mesh import VertexMesh

# Predicted gain, relative to the objective, below which a point is stationary: meshes are not more exact
_GAIN: Final = 1e-3

_LEAST: Final = 1e-4  # radius of the trust region, relative to the mean edge, below which a point is stationary


@dataclass(frozen=True)
class FieldPoint:
    """Positions of joints with stresses in weak equilibrium for each load case.

    values: (k,) variables z. objective: governing bound on λ / required from above on the meshes, not proven. meshes:
    mesh of each load case. forms: equilibrium of each load case. stresses: stresses and λ of each load case, see
    `WeakEquilibrium`.
    """

    values: Floats
    objective: float
    meshes: tuple[FieldMesh, ...]
    forms: tuple[WeakEquilibrium, ...]
    stresses: tuple[Floats, ...]

    @property
    def stands(self) -> bool:
        """True unless the meshes refute that the dead load of some case stands alone."""
        dead = [one.setting.assembly.dead for one in self.meshes]
        first = [k for k in range(len(dead)) if not any(np.array_equal(dead[k], other) for other in dead[:k])]
        return all(self.forms[k].stands() for k in first)


class FieldSearch:
    """Search over positions of joints for the largest λ of blocks that may crack anywhere.

    search: variables, limits and trust region.
    """

    def __init__(self, search: GeometrySearch) -> None:
        self._search, self._labels = search, search.evaluator.labels
        self.solves = 0

    def start(self, values: Floats, parts: int = 1) -> FieldPoint | None:
        """Return the point at variables z (k,); None if it is invalid or has no stresses.

        parts: number of parts of each edge of the coarsest meshes. Raises InputError where fields refuse the structure.
        """
        assembly, vertices = self._search.evaluator.assembly(values), self._search.evaluator.mesh(values)
        if assembly is None or not isinstance(vertices, VertexMesh):
            return None
        meshes = [FieldMesh.of(case, vertices) for case in assembly.by_case]
        return self._solved(values, assembly, tuple(one.refined(subdivide(one.mesh, parts)) for one in meshes))

    def _solved(self, values: Floats, assembly: Assembly, meshes: tuple[FieldMesh, ...]) -> FieldPoint | None:
        """Return the point at variables z (k,) on given meshes; None without stresses."""
        forms = tuple(WeakEquilibrium(one.setting.problem(one.mesh), self._labels) for one in meshes)
        found = []
        for form in forms:
            self.solves += 1
            solved = form.solve()
            if solved is None or solved[1] <= 0.0:
                return None
            found.append(solved)
        factors = [
            factor * form.problem.units.load / float(required)
            for (_, factor), form, required in zip(found, forms, assembly.required, strict=True)
        ]
        return FieldPoint(values, min(factors), meshes, forms, tuple(stress for stress, _ in found))

    def at(self, point: FieldPoint, values: Floats) -> FieldPoint | None:
        """Return the point at other variables z (k,), with the triangles of a point nearby.

        None where z is no structure, a triangle turns over, or a load case has no stresses.
        """
        assembly = self._search.evaluator.assembly(values)
        if assembly is None:
            return None
        places = self._search.variables.places
        moved = places(values) - places(point.values)
        meshes = [one.at(case, moved) for one, case in zip(point.meshes, assembly.by_case, strict=True)]
        known = tuple(one for one in meshes if one is not None)
        return self._solved(values, assembly, known) if len(known) == len(meshes) else None

    def bracket(self, point: FieldPoint) -> tuple[float, float]:
        """Return certified bounds on the governing factor, by the meshes of a point.

        A bound that the fields do not give is infinite.
        """
        low, high = [], []
        for mesh, required in zip(point.meshes, self._search.required.tolist(), strict=True):
            bounds = Fields.on(mesh.setting, mesh.mesh, self._labels).bounds
            low.append(bounds[0] / required)
            high.append(bounds[1] / required)
        return min(low), min(high)

    def step(self, point: FieldPoint, radius: float) -> tuple[Floats, float] | None:
        """Solve the program of a step over stresses and positions at once (docs/method.md (11.9)).

        Returns the step (k,) of the variables, lengths, and the objective that it promises; None without an answer.
        radius: of the trust region, a length.
        """
        unit = self._search.unit
        region = self._search.evaluator.region(point.values, *self._search.bounds(point.values, radius))
        program, first, scale = _program(point, region, self._search.required)
        answer = program.solve()
        return (answer.point[first:-1] * unit, float(answer.point[-1]) * scale) if answer.usable else None

    def improve(
        self, point: FieldPoint, deadline: float, report: Callable[[FieldPoint, float, float], None] | None = None
    ) -> tuple[FieldPoint, str]:
        """Improve a point until it is stationary; return the last point and why the search ended.

        The reason is "stationary", "locked", "time" or "points". deadline: time of `time.perf_counter`, s; a step that
        would end late by the time of the last one is not begun. report: called with every accepted point, its predicted
        objective and the trust radius, a length.
        """
        trust, unit = self._search.trust, self._search.unit
        radius, stood, last = trust.first * unit, point.stands, 0.0
        for _ in range(trust.points):
            if point.objective == math.inf:
                return point, "locked"
            began = time.perf_counter()
            if began + last > deadline:
                return point, "time"
            answer = self.step(point, radius)
            promise = -math.inf if answer is None else answer[1] - point.objective
            if answer is None or not promise > _GAIN * abs(point.objective) or radius < _LEAST * unit:
                return point, "stationary"
            target = self._search.restored(point.values + answer[0])
            new = None if target is None else self.at(point, target)
            last = time.perf_counter() - began
            gained = -math.inf if new is None else new.objective - point.objective
            if new is None or not gained > trust.accepted * promise or (stood and not new.stands):
                radius *= trust.shrinkage
                continue
            if gained > trust.good * promise:
                radius = min(trust.growth * radius, trust.largest * unit)
            point = new
            if report is not None:
                report(point, answer[1], radius)
        return point, "points"


def _program(point: FieldPoint, region: Region, required: Floats) -> tuple[ConeProgram, int, float]:
    """Set up the program of a step.

    Its columns are stresses and λ of each load case, steps of the variables, and the goal. Also returns the column of
    the first step and the unit of the goal, λ / required.
    """
    count = region.jacobian.shape[1]
    start = np.cumsum([0, *(form.width for form in point.forms)]).tolist()
    units = [form.problem.units.load / need for form, need in zip(point.forms, required.tolist(), strict=True)]
    groups: list[list[tuple[sp.csr_array, Floats]]] = [[], [], []]

    def add(group: int, rows: sp.csr_array, at: int, right: Floats) -> None:
        """Add rows, from column `at` on, and their right-hand sides to one of three groups."""
        own = sp.coo_array(rows)
        wide = sp.csr_array((own.data, (own.row, own.col + at)), shape=(rows.shape[0], start[-1] + count + 1))
        groups[group].append((wide, right))

    for k, (mesh, form) in enumerate(zip(point.meshes, point.forms, strict=True)):
        fixed = form.rows()
        rates = form.rates(point.stresses[k]) @ mesh.motion @ region.jacobian / form.problem.units.length
        ends = np.cumsum([fixed.sizes[0], fixed.sizes[1]]).tolist()
        between = sp.csr_array((fixed.sizes[0], start[-1] - start[k + 1]))
        moved = sp.hstack([fixed.matrix[: ends[0]], between, rates])
        add(0, sp.csr_array(moved), start[k], fixed.right[: ends[0]])
        add(1, fixed.matrix[ends[0] : ends[1]], start[k], fixed.right[ends[0] : ends[1]])
        add(2, fixed.matrix[ends[1] :], start[k], fixed.right[ends[1] :])
        goal = sp.csr_array(
            ([-units[k] / units[0], 1.0], ([0, 0], [0, start[-1] + count - start[k + 1] + 1])),
            shape=(1, start[-1] + count - start[k + 1] + 2),
        )
        add(1, goal, start[k + 1] - 1, np.zeros(1))
    slopes = sp.csr_array(region.limits.rates @ region.jacobian)
    used, values = np.diff(slopes.indptr) > 0, region.limits.values
    equal, bounded = np.flatnonzero(used & region.equal), np.flatnonzero(used & ~region.equal)
    add(0, slopes[equal], start[-1], -values[equal])
    add(0, sp.csr_array(region.ties), start[-1], np.zeros(len(region.ties)))
    # a limit that was missed by rounding, or by the curvature of the last step, may stay as it is
    add(1, -slopes[bounded], start[-1], (values - np.minimum(region.least, values))[bounded])
    add(1, sp.csr_array(sp.eye_array(count)), start[-1], region.high)
    add(1, -sp.csr_array(sp.eye_array(count)), start[-1], -region.low)
    objective = np.zeros(start[-1] + count + 1)
    objective[-1] = -1.0
    whole = sp.csr_array(sp.vstack([rows for group in groups for rows, _ in group]))
    right = np.concatenate([right for group in groups for _, right in group])
    numbers = [sum(rows.shape[0] for rows, _ in group) for group in groups]
    return ConeProgram(objective, whole, right, (numbers[0], numbers[1], numbers[2] // 3)), start[-1], units[0]
