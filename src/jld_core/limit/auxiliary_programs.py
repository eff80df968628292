"""Auxiliary programs for repairs, derived from the program of a template."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bools, Floats, Ints
from jld_core.linalg.factors import ConsistentProjector
from jld_core.program import ConicProgram, beginnings, pack
from jld_core.program.template import Structure
from jld_core.solvers import ClarabelSolver, HighsSolver, RawSolution, RawStatus, is_large, solve_auxiliary

# Largest force, scaled, of a self-stress that gives a row slack 1.
# A self-stress that needs more counts as none, for example that of friction a rounding error below 45°.
LARGEST: Final = 1e3


# Number of sides of the polygons inscribed in friction circles, with corners on both axes and between them
_SIDES: Final = 16

_SIMPLEX: Final = 6000  # number of columns up to which a vertex is sought
_SMALL: Final = 800  # number of columns up to which a dual simplex finds it


def slack_rows(structure: Structure) -> Ints:
    """Return the rows (k,) in which slack is measured: linear ones, then first rows of cones; not that of λ."""
    linear = np.arange(structure.equalities + 1, structure.equalities + structure.linear)
    return np.concatenate([linear, structure.heads]).astype(np.int64)


def largest_slack_program(program: ConicProgram, load_fixed: bool = False) -> ConicProgram:
    """Return the program max t ≤ 1, the least slack of all yield rows; load_fixed: λ = 0."""
    # t is the last column, and t ≤ 1 the last linear row.
    structure = program.structure
    matrix = program.matrix.tocsr()
    slack_column = np.zeros(structure.shape[0])
    slack_column[slack_rows(structure)] = 1.0
    unknowns = matrix[:, :-1] if load_fixed else matrix
    first_cone = structure.equalities + structure.linear
    slack_at_most_one = sp.csr_array(([1.0], ([0], [unknowns.shape[1]])), shape=(1, unknowns.shape[1] + 1))
    with_slack = sp.hstack([unknowns, sp.csr_array(slack_column[:, None])]).tocsr()
    rows = sp.vstack([with_slack[:first_cone], slack_at_most_one, with_slack[first_cone:]])
    rhs = np.concatenate([program.rhs[:first_cone], [1.0], program.rhs[first_cone:]])
    objective = np.zeros(with_slack.shape[1])
    objective[-1] = -1.0
    return pack(
        rows,
        rhs,
        objective,
        structure.equalities,
        structure.linear + 1,
        structure.cones,
        structure.places,
        program.bodies,
    )


def restrict_columns(program: ConicProgram, columns_kept: Bools) -> ConicProgram:
    """Return the program of some columns (columns,), without empty rows; cones stay or go as a whole."""
    structure = program.structure
    matrix = program.matrix.tocsr()[:, np.flatnonzero(columns_kept)]
    row_kept = np.diff(matrix.indptr) > 0
    row_kept[: structure.equalities + 1] = True
    start = structure.equalities + structure.linear
    ends = start + np.cumsum(structure.cones, dtype=np.int64)
    cones = tuple(size for size, end in zip(structure.cones, ends, strict=True) if row_kept[end - size : end].any())
    for size, end in zip(structure.cones, ends, strict=True):
        row_kept[end - size : end] = row_kept[end - size : end].any()
    rows = np.flatnonzero(row_kept)
    linear = int(row_kept[structure.equalities : start].sum())
    return pack(
        matrix[rows],
        program.rhs[rows],
        program.objective[columns_kept],
        structure.equalities,
        linear,
        cones,
        structure.places,
        program.bodies,
    )


def maximise_slacks(program: ConicProgram, rhs: Floats, columns: int, cap: float = 1.0) -> tuple[RawSolution, Floats]:
    """Find a point with slack in most yield rows: solution, and slacks (rows,) of `slack_rows` in [0, cap]."""
    raw = solve_auxiliary(_slack_sum_program(program, rhs, columns, cap))
    return raw, raw.point[columns:]


@dataclass(frozen=True)
class LargestSupport:
    """Point of the recession cones at which as many rows as possible have positive slack."""

    point: Floats  # (columns,) the point
    # (linear rows + cones,) slack of each row of `slack_rows`: 1 where slack is possible, else 0, up to the solver's
    # residual
    slack: Floats
    values: Floats  # (rows,) values −M y of the program's matrix M at the point y, which give its position in each cone

    def boundary_direction(self, start: int, size: int, least: float = 0.5) -> Floats | None:
        """Return the unit vector (size − 1,) of a point on a cone's boundary; None where it is not there."""
        vector = self.values[start : start + size]
        length = float(np.linalg.norm(vector[1:]))
        return vector[1:] / length if vector[0] > least and length > 0.5 * vector[0] else None


def largest_support(
    program: ConicProgram, columns: int, target: Floats | None = None, largest: float = LARGEST
) -> LargestSupport:
    """Find a point of the recession cones with slack in most rows; unchecked, arbitrary if the solver fails.

    columns: number of first columns that are unknown, the others are 0. target: (equalities,) right-hand side of
    equilibrium, None: 0. largest: bound on the size of each unknown.
    """
    # Among such points it has the most cones whose first row is positive.
    structure = program.structure
    rhs = np.zeros(structure.shape[0])
    if target is not None:
        rhs[: structure.equalities] = target
    slack_program = _slack_sum_program(program, rhs, columns, 1.0, largest, heads=True)
    # Where the cones have no interior point, full accuracy is out of reach. Half the digits suffice to separate 0 from
    # 1.
    raw = (
        solve_auxiliary(slack_program)
        if is_large(structure)
        else ClarabelSolver(1e-7, iterative_refinement_enable=True).solve(slack_program)
    )
    point = np.where(np.isfinite(raw.point), raw.point, 0.0)
    slack = point[columns : columns + len(slack_rows(structure))]
    return LargestSupport(point[:columns], slack, -(program.matrix[:, :columns] @ point[:columns]))


def polygonal_support(program: ConicProgram, columns: int, target: Floats | None = None) -> LargestSupport | None:
    """Find a point of largest support by simplex, polygons in place of cones; None where not possible."""
    # The point is exact to rounding. The corners of a polygon lie on its cone, among them those on the axes of the
    # face's frame. A self-stress on the friction boundary along an axis is a vertex here, while an interior-point
    # method finds only half its digits. The method needs cones of three rows.
    structure = program.structure
    if set(structure.cones) - {3} or structure.shape[1] > _SIMPLEX:
        return None
    matrix = program.matrix.tocsr()
    start, count = structure.equalities + structure.linear, len(structure.cones)
    angle = (np.arange(_SIDES) + 0.5) * 2.0 * np.pi / _SIDES
    side_rows = np.column_stack([np.full(_SIDES, np.cos(np.pi / _SIDES)), -np.cos(angle), -np.sin(angle)])
    polygon_rows = sp.kron(sp.eye_array(count), sp.csr_array(side_rows / side_rows[0, 0])) @ matrix[start:]
    rows = sp.vstack([matrix[:start], matrix[structure.heads], polygon_rows])
    rhs = np.zeros(rows.shape[0])
    if target is not None:
        rhs[: structure.equalities] = target
    linear = structure.linear + count * (1 + _SIDES)
    zeros = np.zeros(rows.shape[0])
    polygonal = pack(rows, zeros, program.objective, structure.equalities, linear, (), structure.places)
    # Simplex takes 33 s for 7 400 columns of stiff cubes, an interior point with crossover 2 s for the same vertex.
    solver = HighsSolver("highs" if structure.shape[1] <= _SMALL else "highs-ipm")
    raw = solver.solve(_slack_sum_program(polygonal, rhs, columns, 1.0))
    if raw.status is not RawStatus.OPTIMAL:
        return None
    point = raw.point[:columns]
    values = -(matrix[:, :columns] @ point)
    cones = values[start:].reshape(count, 3)
    slack = np.concatenate(
        [raw.point[columns : columns + structure.linear - 1], cones[:, 0] - np.hypot(*cones[:, 1:].T)]
    )
    return LargestSupport(point, slack, values)


def project_onto_faces(
    program: ConicProgram, support: LargestSupport, target: Floats, snap: float, tight: float = 0.5
) -> Floats:
    """Project a point of largest support (columns,) onto the faces of the cones it lies on."""
    # The projection removes the solver's residual. Rows without slack become equations, and so do all rows of a cone at
    # whose tip the point lies. In a cone on whose boundary the point lies, the rows after the first keep their
    # direction.
    structure, columns = program.structure, len(support.point)
    matrix = program.matrix.tocsr()[:, :columns]
    linear = structure.linear - 1
    rows = [matrix[: structure.equalities], matrix[slack_rows(structure)[:linear][support.slack[:linear] < tight]]]
    for start, size, slack in zip(structure.heads, structure.cones, support.slack[linear:], strict=True):
        if slack > tight:
            continue
        of_cone, direction = matrix[start : start + size], support.boundary_direction(start, size, tight)
        if direction is None:
            rows.append(of_cone)
        else:
            rows.append(of_cone[1:] - sp.csr_array(without_small_components(direction, snap)[:, None]) @ of_cone[:1])
    equations = sp.csr_array(sp.vstack(rows))
    rhs = np.concatenate([target, np.zeros(equations.shape[0] - structure.equalities)])
    return ConsistentProjector(equations).project(support.point, rhs)


def without_small_components(direction: Floats, snap: float) -> Floats:
    """Return a unit vector (k,) without components below `snap`, normalised again."""
    large_components = np.where(abs(direction) < snap, 0.0, direction)
    return np.asarray(large_components / np.linalg.norm(large_components))


def _slack_sum_program(
    program: ConicProgram, rhs: Floats, columns: int, cap: float, largest: float = np.inf, *, heads: bool = False
) -> ConicProgram:
    """Return the program that maximises the sum of slacks; heads: also those of first rows of cones."""
    structure = program.structure
    matrix = program.matrix.tocsr()[:, :columns]
    measured = slack_rows(structure)
    # columns: point, slacks, slacks of first rows of cones
    count, heads_count = len(measured), len(structure.cones) if heads else 0
    shape = structure.shape[0], count + heads_count
    slack_entries = sp.csr_array((np.ones(count), (measured, np.arange(count))), shape=shape)
    first_cone = structure.equalities + structure.linear
    with_slacks = sp.hstack([matrix, slack_entries]).tocsr()
    bound = sp.hstack([sp.csr_array((count + heads_count, columns)), sp.eye_array(count + heads_count)])
    head_rows = []
    if heads_count:
        head_columns = [sp.csr_array((heads_count, count)), sp.eye_array(heads_count)]
        head_rows = [sp.hstack([matrix[structure.heads], *head_columns])]
    box_rows = []
    if np.isfinite(largest):
        point = sp.hstack([sp.eye_array(columns), sp.csr_array((columns, count + heads_count))])
        box_rows = [point, -point]
    rows = sp.vstack([with_slacks[:first_cone], bound, -bound, *head_rows, *box_rows, with_slacks[first_cone:]])
    right_sides = [rhs[:first_cone], np.full(count, cap), np.ones(heads_count), np.zeros(count + 2 * heads_count)]
    right_sides += [np.full(len(box_rows) * columns, largest), rhs[first_cone:]]
    objective = np.concatenate([np.zeros(columns), -np.ones(count + heads_count)])
    inequalities = structure.linear + 2 * count + 3 * heads_count + len(box_rows) * columns
    return pack(
        rows,
        np.concatenate(right_sides),
        objective,
        structure.equalities,
        inequalities,
        structure.cones,
        structure.places,
        program.bodies,
    )


_BALANCED = 1e-6  # residual of balance, scaled, up to which multipliers count as a solution


def interior_motion(program: ConicProgram, columns: int) -> Floats | None:
    """Find velocities (equalities,) with jumps strictly inside those of finite dissipation; None if there are none."""
    # The jumps are −Gᵀz, where G are the yield rows and z lies at least 1 inside their dual cones.
    structure = program.structure
    matrix = program.matrix.tocsr()[:, :columns]
    yields = matrix[structure.equalities + 1 :]
    linear = structure.linear - 1
    at_least = np.zeros(yields.shape[0])
    at_least[:linear] = 1.0
    starts = linear + beginnings(structure.cones)
    at_least[starts] = 1.0
    point = least_multipliers(matrix[: structure.equalities], yields, at_least, linear, structure.cones, structure)
    residual = sp.hstack([matrix[: structure.equalities].T, yields.T]) @ point
    multipliers = point[structure.equalities :]
    if not np.all(np.isfinite(residual)) or abs(residual).max(initial=0.0) > _BALANCED:
        return None
    if np.any(multipliers[:linear] < 0.5) or np.any(multipliers[starts] < 0.5):
        return None
    return point[: structure.equalities]


def least_multipliers(
    equations: sp.csr_array,
    yields: sp.csr_array,
    least: Floats,
    linear: int,
    cones: tuple[int, ...],
    structure: Structure,
) -> Floats:
    """Compute u and z ≥ least of yield rows with the least weighted sum; NaN if the dual is unbounded."""
    # The multipliers minimise least·z subject to Eᵀu + Gᵀz = 0, with z − least in the cones. Large programs are solved
    # as their dual, min least·G y, E y = 0, G y + s = least: a program in forces, whose columns separate by face.
    equalities, columns = equations.shape
    if is_large(structure):
        rows = sp.vstack([equations, yields])
        rhs = np.concatenate([np.zeros(equalities), least])
        forces = pack(rows, rhs, yields.T @ least, equalities, linear, cones, structure.places)
        raw = solve_auxiliary(forces, 1e-2)
        dual = np.concatenate([raw.dual[:equalities], raw.dual[equalities:] + least])
        return np.full(len(dual), np.nan) if raw.status is RawStatus.UNBOUNDED else dual
    identity = sp.csr_array(sp.hstack([sp.csr_array((len(least), equalities)), sp.eye_array(len(least))]))
    transposed = sp.hstack([equations.T, yields.T])
    balance = sp.csr_array(transposed)
    rows = sp.vstack([balance, -identity])
    rhs = np.concatenate([np.zeros(columns), -least])
    objective = np.concatenate([np.zeros(equalities), least])
    return ClarabelSolver().solve(pack(rows, rhs, objective, columns, linear, cones)).point
