"""Program of one step of a geometry optimisation, over forces and positions, docs/method.md (11.6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import scipy.sparse as sp

from jld_core import Bits, Floats
from jld_core.program import ConicProgram, Template, pack
from jld_core.solvers import ClarabelSolver, RawStatus
from jld_geometry.convex_cells import VertexMesh
from jld_geometry.limits import LimitValues, spatial_residual_rates
from jld_geometry.moved_scene import SpatialMesh
from jld_geometry.spatial_rates import length_rates, residual_rates

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
    s = program.structure
    matrix = program.matrix.tocsr()
    assembly, jacobian = template.assembly, region.jacobian
    if isinstance(mesh, SpatialMesh):
        used = np.diff(jacobian.tocsr().indptr).reshape(-1, 3).max(axis=1) > 0
        rates = spatial_residual_rates(assembly, mesh, state.forces, state.load_factor, state.mechanism, used)
    else:
        rates = residual_rates(assembly, mesh, state.forces, state.load_factor)
    rates = rates @ jacobian
    rates = sp.csr_array(sp.diags_array(1.0 / scaling.row.ravel()) @ rates)
    rows.add("equal", rows.placed(case, matrix[: s.equalities], rates, None), program.rhs[: s.equalities])
    first = s.equalities + 1  # after the row that bounds λ
    right = program.rhs[first:]
    # right-hand sides of yield rows grow with the length of their face
    stretched = sp.csr_array(sp.diags_array(-right) @ lengths[template.yield_set.pattern.row_face])
    column = np.zeros(len(right))  # of the goal
    if goal == "slack":
        column[: s.linear - 1] = -1.0
        column[s.heads - first] = -1.0
    elif goal == "friction":
        column = _friction_column(template, labels, state.forces, len(right))
    linear = s.linear - 1
    yields = rows.placed(case, matrix[first:], stretched, column)
    rows.add("linear", yields[:linear], right[:linear])
    rows.add("cones", yields[linear:], right[linear:])
    rows.cones += list(s.cones)
    load = sp.csr_array(([1.0], ([0], [s.shape[1] - 1])), shape=(1, s.shape[1]))
    if state.dead:
        rows.add("equal", rows.placed(case, load, None, None), np.zeros(1))
    elif goal == "load_factor":
        scale = scaling.load / state.required / rows.unit
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
    kept = np.diff(slopes.indptr) > 0
    equal, bounded = np.flatnonzero(kept & region.equal), np.flatnonzero(kept & ~region.equal)
    values = region.limits.values
    rows.add("equal", placed(slopes[equal]), -values[equal])
    rows.add("equal", placed(sp.csr_array(region.ties)), np.zeros(len(region.ties)))
    # a limit that was missed by rounding, or by the curvature of the last step, may stay as it is
    lower = np.minimum(region.least, values)
    rows.add("linear", placed(-slopes[bounded]), (values - lower)[bounded])
    unit = sp.csr_array(sp.eye_array(count))
    rows.add("linear", placed(unit), region.high)
    rows.add("linear", placed(-unit), -region.low)
