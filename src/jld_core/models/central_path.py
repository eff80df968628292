"""Interior-point method for programs whose rows follow their own solution (quasi-variational inequalities).

Weights of the barrier select one of several paths. Source: docs/method.md (2.16) to (2.18); Facchinei, Kanzow and
Sagratella 2014, Math. Program. 144, 369–412; Nesterov and Todd 1997, Math. Oper. Res. 22, 1–42.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core import tolerances
from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import checkpoint
from jld_core.geometry.outlines import rectangle_torsion_length
from jld_core.limit import Motion, Prover, State, relative_width
from jld_core.limit.analysis import LimitAnalysis
from jld_core.mechanics.prescribed_friction import EffectiveAreas, PrescribedFriction
from jld_core.program import Template

_LEAST_NORMAL = 1e-5  # scaled N below which x tends to zero: M / N is computed as M N / (N² + _LEAST_NORMAL²)
_NARROW = 1e-6  # least side of an effective rectangle, relative to the side of the face
_AREA_RESULTANTS = (0, 3, 4)  # resultants on which the effective area of a face depends: N, m1, m2

# Resultants whose coefficients depend on the effective area: mT, V1, V2, in the order of the parameters
_TORSION_RESULTANTS = (5, 1, 2)


def areas_under(assembly: Assembly, forces: Floats, labels: Bits) -> EffectiveAreas:
    """Compute the torsion factors of the effective areas of faces under given forces.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    forces : (m, 6) array
        Scaled forces N, V1, V2, M1, M2, MT.
    labels : (m,) array of bool
        True = dry.

    Returns
    -------
    EffectiveAreas
        Those of inner faces, faces without normal force and faces that are not rectangles are whole.
    """
    # Source: docs/method.md (2.14), (2.15).
    faces = assembly.interfaces
    labels = labels & faces.rectangle
    # M1 is scaled by l2 / 2 and M2 by l1 / 2, so x1 and x2 below are relative to l1 / 2 and l2 / 2.
    share = np.where(labels, forces[:, 0] / (forces[:, 0] ** 2 + _LEAST_NORMAL**2), 0.0)
    x1 = np.clip(-forces[:, 4] * share, -1.0, 1.0)
    x2 = np.clip(forces[:, 3] * share, -1.0, 1.0)
    side1 = faces.l1 * np.maximum(1.0 - np.abs(x1), _NARROW)
    side2 = faces.l2 * np.maximum(1.0 - np.abs(x2), _NARROW)
    ratio = np.where(labels, faces.c_t / rectangle_torsion_length(side1, side2), 1.0)
    arm = np.column_stack([0.5 * faces.l2 * x2, -0.5 * faces.l1 * x1]) / faces.c_t[:, None]
    return EffectiveAreas(ratio, arm)


def area_derivatives(assembly: Assembly, forces: Floats, labels: Bits) -> tuple[Floats, Floats]:
    """Differentiate the areas by N, m1, m2 of forces (m, 6): c_T / c_T,e (m, 3), x / c_T (m, 2, 3), mean at kinks."""
    faces = assembly.interfaces
    labels = labels & faces.rectangle
    normal = forces[:, 0]
    square = normal**2 + _LEAST_NORMAL**2
    share = np.where(labels, normal / square, 0.0)
    slope = np.where(labels, (_LEAST_NORMAL**2 - normal**2) / square**2, 0.0)
    zeros = np.zeros(len(normal))
    x1, x2 = -forces[:, 4] * share, forces[:, 3] * share
    of_x1 = np.column_stack([-forces[:, 4] * slope, zeros, -share]) * (np.abs(x1) < 1.0)[:, None]
    of_x2 = np.column_stack([forces[:, 3] * slope, share, zeros]) * (np.abs(x2) < 1.0)[:, None]
    rest1, rest2 = 1.0 - np.abs(x1), 1.0 - np.abs(x2)
    side1, side2 = faces.l1 * np.maximum(rest1, _NARROW), faces.l2 * np.maximum(rest2, _NARROW)
    ratio = faces.c_t / rectangle_torsion_length(side1, side2)
    length_by_x1 = -np.sign(x1) * faces.l1 * (rest1 > _NARROW) * _torsion_length_slope(side1, side2)
    length_by_x2 = -np.sign(x2) * faces.l2 * (rest2 > _NARROW) * _torsion_length_slope(side2, side1)
    of_length = length_by_x1[:, None] * of_x1 + length_by_x2[:, None] * of_x2
    of_ratio = -(ratio**2 / faces.c_t)[:, None] * of_length
    scale1, scale2 = (0.5 * faces.l1 / faces.c_t)[:, None], (0.5 * faces.l2 / faces.c_t)[:, None]
    return np.where(labels[:, None], of_ratio, 0.0), np.stack([scale2 * of_x2, -scale1 * of_x1], axis=1)


def _torsion_length_slope(side: Floats, other: Floats) -> Floats:
    """Return the derivative (n,) of the torsion length c_T of rectangles by the first side."""
    diagonal = np.hypot(side, other)
    logarithms = side / (6.0 * other) * np.arcsinh(other / side) - other**2 / (12.0 * side**2) * np.arcsinh(
        side / other
    )
    return np.asarray(side / (12.0 * diagonal) + other**2 / (12.0 * side * diagonal) + logarithms)


def frozen_areas(template: Template, areas: EffectiveAreas) -> Template:
    """Build the template of associative friction with torsion about given effective areas."""
    base = template.yield_set.associative
    zeros = np.zeros(len(template.assembly.interfaces))
    return template.renumbered(PrescribedFriction(base, 1.0, zeros, areas))


class MovingRows:
    """Program min q·y, E y = e, G(y) y + s = r, s in a cone, whose torsion rows follow the effective areas.

    G depends on y through ρ, ρ a1, ρ a2 of each dry rectangle, see `EffectiveAreas`. rows: G of whole faces. linear:
    number of linear rows, before cones of size three. face: (rows,); 0 for the row λ ≥ −c. torsion: (k,) rows that
    depend on the areas.
    """

    def __init__(self, template: Template, labels: Bits) -> None:
        self.assembly, self.labels = template.assembly, labels
        count = len(labels)
        frozen = frozen_areas(template, EffectiveAreas(np.ones(count), np.zeros((count, 2))))
        program = frozen.program(labels)
        structure, first = program.structure, program.structure.equalities
        matrix = self._matrix(template, labels, 1.0, (0.0, 0.0))
        self.objective = program.objective
        self.balance, self.load = matrix[:first], program.rhs[:first]
        self.rows, self.rhs = matrix[first:], program.rhs[first:]
        self.linear = structure.linear
        self.face = np.concatenate([[0], frozen.yield_set.pattern.row_face])
        # Halving ρ doubles what the rows are divided by: only torsion rows of dry faces show a difference.
        halved = self._matrix(template, labels, 0.5, (0.0, 0.0))[first:]
        self.torsion = np.flatnonzero(abs(halved - self.rows).sum(axis=1) > 0.0)
        self.torsion = self.torsion[(labels & self.assembly.interfaces.rectangle)[self.face[self.torsion]]]
        self._coefficients = self._torsion_coefficients(template)

    def _torsion_coefficients(self, template: Template) -> Floats:
        """Return coefficients (3, k) by which ρ, ρ a1 and ρ a2 enter the torsion rows."""
        # Entry [i, j] is the derivative of the entry of G in torsion row j and column `_torsion_columns[i, j]` (mT, V1,
        # V2) by parameter i. G is linear in the parameters.
        labels, first = self.labels, self.balance.shape[0]
        shifted = [self._matrix(template, labels, 1.0, arm)[first:] - self.rows for arm in ((1.0, 0.0), (0.0, 1.0))]
        matrices = [self.rows, *shifted]
        if not self.torsion.size:
            return np.zeros((3, 0))
        pairs = zip(matrices, self._torsion_columns, strict=True)
        coefficients = [sp.csr_matrix(matrix)[self.torsion, columns] for matrix, columns in pairs]
        return np.stack([np.asarray(row).ravel() for row in coefficients])

    def _matrix(self, template: Template, labels: Bits, ratio: float, arm: tuple[float, float]) -> sp.csr_array:
        """Return the matrix with one and the same area of all faces; arm: (x2, −x1) / c_T."""
        count = len(labels)
        areas = EffectiveAreas(np.full(count, ratio), np.tile(np.array(arm), (count, 1)))
        program = frozen_areas(template, areas).program(labels)
        structure = program.structure
        return sp.csr_array(sp.csc_array((program.data, structure.indices, structure.indptr), shape=structure.shape))

    @property
    def size(self) -> int:
        return len(self.objective)

    @cached_property
    def _torsion_columns(self) -> Ints:
        """Return the columns (3, k) of mT, V1, V2 of the faces of the torsion rows."""
        return np.asarray(6 * self.face[self.torsion][None] + np.array(_TORSION_RESULTANTS)[:, None])

    @cached_property
    def area_columns(self) -> Ints:
        """Return the columns (3, k) of N, m1, m2 of the faces of the torsion rows."""
        return np.asarray(6 * self.face[self.torsion][None] + np.array(_AREA_RESULTANTS)[:, None])

    def parameters(self, y: Floats) -> tuple[Floats, Floats]:
        """Compute ρ, ρ a1, ρ a2 (3, k) of the torsion rows at y (n,), and slopes (3, 3, k) by N, m1, m2."""
        forces, face = y[: 6 * len(self.labels)].reshape(-1, 6), self.face[self.torsion]
        areas = areas_under(self.assembly, forces, self.labels)
        of_ratio, of_arm = area_derivatives(self.assembly, forces, self.labels)
        ratio, arm = areas.ratio[face], areas.arm[face]
        slopes = of_arm[face] * ratio[:, None, None] + arm[:, :, None] * of_ratio[face][:, None, :]
        values = np.vstack([ratio[None], (ratio[:, None] * arm).T])
        return values, np.concatenate([of_ratio[face].T[None], slopes.transpose(1, 2, 0)])

    def entries(self, values: Floats) -> tuple[Ints, Ints, Floats]:
        """Return the changes of G from whole faces to parameters (3, k): rows, columns, values (3k,)."""
        coefficients = self._coefficients * (values - np.array([1.0, 0.0, 0.0])[:, None])
        return np.tile(self.torsion, 3), self._torsion_columns.ravel(), coefficients.ravel()

    def matrix(self, values: Floats) -> sp.csr_array:
        """Return the sparse matrix G for parameters (3, k) of the torsion rows."""
        row, column, data = self.entries(values)
        return self.rows + sp.csr_array((data, (row, column)), shape=self.rows.shape)

    def row_slopes(self, y: Floats, slopes: Floats) -> tuple[Ints, Ints, Floats]:
        """Return the derivative of G(y) v by y, at v = y held fixed, for Newton steps: rows, columns, values."""
        # y enters by the parameters alone: sum their slopes (3, 3, k) by N, m1, m2 over the entries of each row.
        by_parameter = self._coefficients * y[self._torsion_columns]
        values = np.einsum("pk,pjk->jk", by_parameter, slopes)
        return np.tile(self.torsion, 3), self.area_columns.ravel(), values.ravel()

    def column_slopes(self, z: Floats, slopes: Floats) -> tuple[Ints, Ints, Floats]:
        """Return the derivative of G(y)ᵀ z by y, at fixed multipliers z (rows,): rows, columns, values."""
        # Entry [p, j, k]: row of mT, V1 or V2, whose coefficient has parameter p; column of N, m1 or m2, by which
        # `slopes` are; face k.
        by_parameter = self._coefficients * z[self.torsion]
        values = by_parameter[:, None] * slopes
        row = np.broadcast_to(self._torsion_columns[:, None], values.shape)
        column = np.broadcast_to(self.area_columns[None], values.shape)
        return row.ravel(), column.ravel(), values.ravel()


_BOUNDARY: Final = 0.9  # share of the way to the boundary of the cones that a step may go

# Added to the diagonal of the Newton matrix, for columns and equalities: free directions get no step
_REGULAR: Final = (1e-11, 1e-13)
_RESIDUAL: Final = 0.3  # residual over the gap above which a step only returns to the path

# Distance from the path, relative to its parameter and per cone, above which a step only returns to the path
_CENTRED: Final = 0.9
_REDUCTIONS: Final = (0.1, 0.3, 0.8)  # least, first and largest factor on the parameter of the path in one step
_STALLED: Final = 30  # number of steps within which the gap must halve
_UNBOUNDED: Final = 1e7  # scaled λ at which the path ends, because λ grows without limit
_CONE_SIGNS: Final = np.array([1.0, -1.0, -1.0])  # signs of the quadratic form of a second-order cone of size three


@dataclass(frozen=True)
class PathPoint:
    y: Floats  # (n,) forces, further variables, and λ as the last entry, scaled
    u: Floats  # (equalities,) multipliers of equilibrium, which are velocities
    s: Floats  # (rows,) slacks of the rows
    z: Floats  # (rows,) multipliers of the rows
    gap: float = np.inf  # gap s·z. Where residuals are zero, it bounds the distance of the frozen optimum above λ.
    residual: float = np.inf  # norm of the residuals of equilibrium, rows and stationarity

    @property
    def load(self) -> float:
        """Return the scaled λ, the last entry of `y`."""
        return float(self.y[-1])


@dataclass
class CentralPath:
    """Central path of a program whose rows depend on its own solution."""

    rows: MovingRows  # the program
    weights: Floats  # (rows,) weight of the barrier of each row; a cone has the weight of its first row
    size: float = 10.0  # size of normal forces, slacks and multipliers in the first iterate, scaled
    most: int = 120  # largest number of steps
    steps: int = field(default=0, init=False)  # number of steps so far

    def __post_init__(self) -> None:
        """Give all rows of a cone the same weight, and divide all weights by their mean."""
        linear = self.rows.linear
        heads = self.weights[linear::3]
        mean = float(np.concatenate([self.weights[:linear], heads]).mean())
        self.weights = np.concatenate([self.weights[:linear], np.repeat(heads, 3)]) / mean

    @property
    def _degree(self) -> int:
        """Return the degree of the barrier: 1 for each linear row and each cone."""
        return self.rows.linear + (len(self.rows.rhs) - self.rows.linear) // 3

    def points(self) -> Iterator[PathPoint]:
        """Follow the central path, and yield each iterate until it ends."""
        # The path ends where it converges, stalls, λ grows without limit, or rounding takes an iterate out of the
        # cones.
        point, reduction = self._start(), _REDUCTIONS[1]
        best, since_halved = np.inf, 0
        while True:
            checkpoint()
            values, slopes = self.rows.parameters(point.y)
            matrix = self.rows.matrix(values)
            dual = self.rows.objective + self.rows.balance.T @ point.u + matrix.T @ point.z
            balance = self.rows.balance @ point.y - self.rows.load
            primal = matrix @ point.y + point.s - self.rows.rhs
            gap, residual = float(point.s @ point.z), float(np.linalg.norm(np.concatenate([dual, balance, primal])))
            point = PathPoint(point.y, point.u, point.s, point.z, gap, residual)
            yield point
            parameter = gap / self._degree
            off_path = residual > _RESIDUAL * gap or self._distance(point, parameter) > _CENTRED * np.sqrt(self._degree)
            best, since_halved = (gap, 0) if gap < 0.5 * best else (best, since_halved + 1)
            if self.steps >= self.most or since_halved > _STALLED or abs(point.load) > _UNBOUNDED:
                return
            if not (np.isfinite(residual) and self._inside(point.s) and self._inside(point.z)):
                return
            target = parameter * (1.0 if off_path else reduction)
            step = self._step(point, target, (dual, balance, primal), matrix, slopes)
            if step is None:
                return
            share = min(1.0, _BOUNDARY * min(self._largest_step(point.s, step.s), self._largest_step(point.z, step.z)))
            if not off_path:
                least, _, largest = _REDUCTIONS
                reduction = max(least, 0.6 * reduction) if share > 0.7 else reduction
                reduction = min(largest, 1.6 * reduction) if share < 0.3 else reduction
            point = PathPoint(
                point.y + share * step.y, point.u + share * step.u, point.s + share * step.s, point.z + share * step.z
            )

    def _start(self) -> PathPoint:
        """Return a first iterate with compression on every face and without equilibrium."""
        rows, count = self.rows, 6 * len(self.rows.labels)
        y = np.zeros(rows.size)
        y[:count:6] = self.size
        y[count:-1] = 0.1 * self.size
        s = rows.rhs - rows.rows @ y
        linear, cones = s[: rows.linear], s[rows.linear :].reshape(-1, 3)
        linear[:] = np.maximum(linear, 0.05 * self.size)
        cones[:, 0] = np.maximum(cones[:, 0], np.hypot(cones[:, 1], cones[:, 2]) + 0.05 * self.size)
        return PathPoint(y, np.zeros(len(rows.load)), s, self.size * self.weights * self._inverse(s))

    def _inside(self, values: Floats) -> bool:
        """Return True if a vector (rows,) lies strictly inside all cones."""
        cones = values[self.rows.linear :].reshape(-1, 3)
        curved = (cones[:, 0] > 0.0) & (cones**2 @ _CONE_SIGNS > 0.0)
        return bool((values[: self.rows.linear] > 0.0).all() and curved.all())

    def _inverse(self, s: Floats) -> Floats:
        """Return the inverse of slacks s in the Jordan algebra of the cones, minus the barrier's gradient."""
        linear, cones = s[: self.rows.linear], s[self.rows.linear :].reshape(-1, 3)
        form = (cones**2 @ _CONE_SIGNS)[:, None]
        return np.concatenate([1.0 / linear, (cones * _CONE_SIGNS / form).ravel()])

    def _distance(self, point: PathPoint, parameter: float) -> float:
        """Return the norm of s∘z − weight · parameter, relative to the parameter."""
        first = self.rows.linear
        s, z = point.s[first:].reshape(-1, 3), point.z[first:].reshape(-1, 3)
        linear = point.s[:first] * point.z[:first] - parameter * self.weights[:first]
        heads = (s * z).sum(axis=1) - parameter * self.weights[first::3]
        tails = s[:, :1] * z[:, 1:] + z[:, :1] * s[:, 1:]
        return float(np.linalg.norm(np.concatenate([linear, heads, tails.ravel()]))) / parameter

    def _largest_step(self, start: Floats, direction: Floats) -> float:
        """Return the largest t ≤ 3 for which start + t · direction (rows,) still lies in the cones."""
        first, longest = self.rows.linear, 3.0
        decreasing = direction[:first] < 0.0
        longest = min(longest, float((start[:first][decreasing] / -direction[:first][decreasing]).min(initial=longest)))
        cones, changes = start[first:].reshape(-1, 3), direction[first:].reshape(-1, 3)
        # the first positive root of |cones + t changes|² = 0 in the quadratic form of the cone
        square, cross, constant = changes**2 @ _CONE_SIGNS, (cones * changes) @ _CONE_SIGNS, cones**2 @ _CONE_SIGNS
        root = np.sqrt(np.maximum(cross**2 - square * constant, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            stable_sum = -(cross + np.where(cross >= 0.0, root, -root))
            roots = np.concatenate([stable_sum / square, constant / stable_sum, -cones[:, 0] / changes[:, 0]])
        valid = np.tile(cross**2 >= square * constant, 2)
        valid = np.concatenate([valid, changes[:, 0] < 0.0]) & np.isfinite(roots) & (roots > 0.0)
        return min(longest, float(roots[valid].min(initial=longest)))

    @cached_property
    def _fixed(self) -> tuple[Ints, Ints, Floats]:
        """Return rows, columns and values of those entries of the Newton matrix that never change."""
        rows, n, e = self.rows, self.rows.size, len(self.rows.load)
        balance, yields = sp.coo_array(rows.balance), sp.coo_array(rows.rows)
        e_row, e_column, g_row, g_column = (index.astype(np.int64) for index in (*balance.coords, *yields.coords))
        row: list[Ints] = [e_row + n, e_column, g_row + n + e, g_column, np.arange(n), n + np.arange(e)]
        column: list[Ints] = [e_column, e_row + n, g_column, g_row + n + e, np.arange(n), n + np.arange(e)]
        data = [balance.data, balance.data, yields.data, yields.data, np.full(n, _REGULAR[0]), np.full(e, -_REGULAR[1])]
        return np.concatenate(row), np.concatenate(column), np.concatenate(data)

    def _step(
        self,
        point: PathPoint,
        target: float,
        residuals: tuple[Floats, Floats, Floats],
        matrix: sp.csr_array,
        slopes: Floats,
    ) -> PathPoint | None:
        """Return the Newton step of a point towards path parameter `target`; None if singular."""
        # slopes: derivatives of the parameters, see `MovingRows.parameters`
        rows, n, count = self.rows, self.rows.size, len(self.rows.rhs)
        dual, balance, primal = residuals
        parameters, _ = rows.parameters(point.y)
        g_row, g_column, g_value = rows.entries(parameters)
        slope_row, slope_column, slope_value = rows.row_slopes(point.y, slopes)
        adjoint_row, adjoint_column, adjoint_value = rows.column_slopes(point.z, slopes)
        w_row, w_column, w_value = self._scaling(point)
        # Unknowns: y, multipliers u of E y = e, multipliers z of the rows. G and Gᵀ stand below and beside y, their
        # slopes by y with them, and the scaling W² of the cones at z; `_fixed` has what never changes.
        first = n + len(self.rows.load)
        row = [self._fixed[0], g_column, g_row + first, slope_row + first, adjoint_row, w_row + first]
        column = [self._fixed[1], g_row + first, g_column, slope_column, adjoint_column, w_column + first]
        data = [self._fixed[2], g_value, g_value, slope_value, adjoint_value, -w_value]
        entries = np.concatenate(data), (np.concatenate(row), np.concatenate(column))
        newton = sp.csc_array(entries, shape=(first + count,) * 2)
        try:
            factor = splu(newton)
        except RuntimeError:
            return None
        self.steps += 1
        centring = target * self.weights * self._inverse(point.s) - point.z
        scaling = sp.csr_array((w_value, (w_row, w_column)), shape=(count,) * 2)
        right = np.concatenate([-dual, -balance, -primal - scaling @ centring])
        step = factor.solve(right)
        step = step + factor.solve(right - newton @ step)  # one refinement
        if not np.isfinite(step).all():
            return None
        y, u, z = step[:n], step[n:first], step[first:]
        slack_change = np.zeros(count)
        np.add.at(slack_change, slope_row, slope_value * y[slope_column])
        return PathPoint(y, u, -primal - matrix @ y - slack_change, z)

    def _scaling(self, point: PathPoint) -> tuple[Ints, Ints, Floats]:
        """Return rows, columns and values of the squared scaling W², for which W² z = s."""
        # s are slacks and z multipliers of the point. Source: Nesterov and Todd.
        first = self.rows.linear
        s, z = point.s[first:].reshape(-1, 3), point.z[first:].reshape(-1, 3)
        length_s, length_z = (np.sqrt(v**2 @ _CONE_SIGNS)[:, None] for v in (s, z))
        unit_s, unit_z = s / length_s, z / length_z
        cosine = np.sqrt(0.5 * (1.0 + (unit_s * unit_z).sum(axis=1)))[:, None]
        bisector = 0.5 * (unit_s + unit_z * _CONE_SIGNS) / cosine
        blocks = 2.0 * bisector[:, :, None] * bisector[:, None, :] - np.diag(_CONE_SIGNS)
        blocks *= (length_s / length_z)[:, :, None]
        cone_rows = first + np.arange(3 * len(s)).reshape(-1, 3)
        row = np.repeat(cone_rows, 3, axis=1).ravel()
        column = np.tile(cone_rows, (1, 3)).ravel()
        linear_rows = np.arange(first)
        data = np.concatenate([point.s[:first] / point.z[:first], blocks.ravel()])
        return np.concatenate([linear_rows, row]), np.concatenate([linear_rows, column]), data


STARTS: Final = 16  # number of central paths tried

# Scaled compression of the first iterate, in turn: forces of arches exceed the weight above them
_SIZES: Final = (10.0, 100.0)

# Logarithm of the largest factor on weights of the barrier, of the first four starts; later ones have the last
_SPREAD: Final = (0.0, 0.7, 0.0, 1.5)
_WAVES: Final = 40.0  # largest wave number of the weights, over half the size of the structure
_CLOSE: Final = 1e-3  # relative gap of an iterate from which on it is checked
_BALANCED: Final = 1e-4  # residual of an iterate up to which it is checked
_FINE: Final = 1e-9  # relative width of the bracket below which a path is not followed any further
_REFINEMENTS: Final = 8  # number of iterates after the first converged one, so that λ is more exact than asked

# Relative width of the bracket at the end of a path below which the frozen problem is solved once more
_PROMISING: Final = 1e-4

# Scaled λ at the end of a path above which λ may be unbounded; no third path of this kind is followed
_LARGE_LOAD: Final = 1e4
_EDGE: Final = 1e-9  # scaled violation up to which forces are moved onto the boundary of the yield sets
_PARALLEL: Final = 0.1  # sine of the angle below which two directions count as parallel


@dataclass(frozen=True)
class FixedPoint:
    """Forces, their effective areas, and a mechanism of the problem with these areas held constant."""

    state: State  # forces under the areas; a lower bound on λ of the problem with constant areas if admissible
    areas: EffectiveAreas  # effective areas of the forces
    prover: Prover  # prover of the problem with constant areas
    motion: Motion | None  # mechanism of that problem with finite dissipation
    width: float  # relative width of the bracket; inf if an end is missing
    starts: int  # number of central paths followed


def under_own_areas(prover: Prover, state: State, labels: Bits) -> tuple[State, EffectiveAreas, Prover]:
    """Evaluate a state under the effective areas of its own forces.

    Parameters
    ----------
    prover : Prover
        Prover of the labelling.
    state : State
        State.
    labels : (m,) array of bool
        True = dry.

    Returns
    -------
    (State, EffectiveAreas, Prover)
        State under these areas, the areas, and a prover with the areas frozen.
    """
    areas = areas_under(prover.template.assembly, state.forces, labels)
    frozen = prover.with_template(frozen_areas(prover.template, areas))
    return frozen.state(np.append(state.forces.ravel(), state.load), labels, passes=1), areas, frozen


def find_fixed_point(analysis: LimitAnalysis, labels: Bits, starts: int = STARTS) -> FixedPoint | None:
    """Search forces optimal under their own areas: the first within `analysis.gap`, else the narrowest, or None."""
    # Source: docs/method.md (2.16) to (2.18). Fixed points need not be unique. The weights of each start depend on the
    # structure and its loads alone.
    rows = MovingRows(analysis.template, labels)
    if not rows.torsion.size:
        return None
    best: FixedPoint | None = None
    growing = 0
    for start in range(starts):
        path = CentralPath(rows, barrier_weights(analysis.assembly, rows, start), _SIZES[start // 2 % len(_SIZES)])
        next_gap, refinements_left = np.inf, _REFINEMENTS
        for point in path.points():
            size = max(abs(point.load), analysis.load_scale)
            if point.gap <= min(_CLOSE * size, next_gap) and point.residual <= _BALANCED:
                next_gap = point.gap if point.gap < 4.0 * analysis.gap * size else 0.1 * point.gap
                candidate = _check(analysis, labels, point, start + 1)
                if best is None or candidate.width < best.width:
                    best = candidate
            if best is not None and best.width <= analysis.gap:
                refinements_left -= 1
                if best.width <= _FINE or refinements_left <= 0:
                    return best
        if best is not None and best.width <= analysis.gap:
            return best
        growing += abs(point.load) > _LARGE_LOAD
        if growing > 1:
            return best
        if best is not None and best.starts == start + 1 and best.width < _PROMISING:
            # improve a fixed point by the more accurate mechanism at its areas; the narrower bracket stays
            proof = analysis.with_template(best.prover.template, labels).prove(labels)
            if proof.motion is not None:
                width = relative_width(best.state.load, proof.motion.bound, analysis.load_scale)
                best = replace(best, motion=proof.motion, width=width) if width < best.width else best
            if best.width <= analysis.gap:
                return best
    return best


def _check(analysis: LimitAnalysis, labels: Bits, point: PathPoint, starts: int) -> FixedPoint:
    """Evaluate an iterate of a central path as a fixed point, with a proven bracket of λ."""
    # The bracket is that of the problem whose effective areas are held at those of the iterate. Its width is inf if an
    # end is missing.
    state, areas, frozen = under_own_areas(analysis.prover, analysis.prover.state(point.y, labels), labels)
    if not state.admissible and state.slack > -_EDGE:
        # faces that bear nothing have no slack at all
        boundary_state = analysis.with_template(frozen.template, labels).repair.boundary_state(point.y, labels)
        state = boundary_state or state
    motion = frozen.motion(point.u, labels)
    opening = None if motion.margin >= 0.0 else analysis.repair.opening()
    if opening is not None:
        motion = frozen.add_opening(motion, opening, labels)
    finite = motion.margin >= 0.0 and motion.work > 0.0
    low, high = state.load if state.admissible else -np.inf, motion.bound if finite else np.inf
    width = relative_width(low, high, analysis.load_scale)
    return FixedPoint(state, areas, frozen, motion if finite else None, width, starts)


def barrier_weights(assembly: Assembly, rows: MovingRows, start: int) -> Floats:
    """Compute the weights (rows,) of the barrier for path number `start`, all equal for the first."""
    # Weights vary with a face's place in axes of the loads, so that order, position, rotation and units do not matter.
    # Symmetry is broken, as symmetric paths may end at a branch point.
    spread = _SPREAD[min(start, len(_SPREAD) - 1)]
    places = assembly.interfaces.origin - assembly.interfaces.origin.mean(axis=0)
    places = places @ load_axes(assembly).T
    places = places / (np.abs(places).max() or 1.0)
    # SeedSequence and PCG64 give the same numbers on every machine
    rng = np.random.default_rng(start)
    phases = [places @ rng.uniform(-_WAVES, _WAVES, 3) + rng.uniform(0.0, 2.0 * np.pi) for _ in range(3)]
    kind_of_row = np.zeros(len(rows.face), dtype=int)
    kind_of_row[rows.torsion], kind_of_row[rows.linear :] = 1, 2
    weights = np.exp(spread * np.sin(np.stack(phases)))[kind_of_row, rows.face]
    weights[0] = 1.0
    return np.asarray(weights)


def load_axes(assembly: Assembly) -> Floats:
    """Compute three orthonormal directions (3, 3), as rows, that turn with the structure and its loads."""
    # Weights that depend on coordinates along them do not depend on the position or rotation of the scene.
    # Rows: dead load, live load across it, their cross product; where parallel or zero, the way to the middle of the
    # live load and the first face's e1 and e2.
    elements, free = assembly.elements, assembly.elements.free
    dead, live = assembly.dead[free, :3], assembly.live[free, :3]
    size = np.linalg.norm(live, axis=1)
    offset = elements.centroid[free] - elements.centroid[free].mean(axis=0)
    middle = size @ offset / (float(size.sum()) or 1.0)
    if np.linalg.norm(middle) < tolerances.CONTACT * assembly.size:
        middle = np.zeros(3)
    first = (assembly.interfaces.e1[0], assembly.interfaces.e2[0], assembly.interfaces.normal[0])
    axes: list[Floats] = []
    for direction in (dead.sum(axis=0), live.sum(axis=0), middle, *first):
        perpendicular = direction - sum((axis * (axis @ direction) for axis in axes), np.zeros(3))
        length = float(np.linalg.norm(perpendicular))
        if length > _PARALLEL * float(np.linalg.norm(direction)):
            axes.append(perpendicular / length)
        if len(axes) == 2:
            break
    return np.stack([*axes, np.cross(axes[0], axes[1])])
