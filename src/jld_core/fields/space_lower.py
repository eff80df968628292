"""Lower bound in space: stresses in equilibrium and within yield, linear in tetrahedra.

Formulas: docs/method.md (10.1), (10.4) and (10.5). The solver proposes a field. This module proves the bound: it
projects the field onto equilibrium and checks every yield condition by the eigenvalues of stresses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.fields.conic import Answer, Rows
from jld_core.fields.space_cones import DIAGONAL, ConeSizes, across, normal_map, solve_cones, tensors
from jld_core.fields.space_problem import SpatialProblem

# Room that the solver keeps to yield, scaled stress: more than its residual, so that the projected field has room
_MARGINS = (1e-6, 1e-5)

_INTERIOR = 1e-3  # margin of the interior field that is blended with a field that still violates yield

_STEPS = 6  # largest number of correction steps of a projection onto equilibrium

# Added to the diagonal of E Eᵀ, because rows depend on each other around edges; correction steps undo its effect
_REGULAR = 1e-10


@dataclass(frozen=True)
class SpatialStress:
    """Certified stress field in space, scaled (see `Units`).

    factor: λ that the field carries, a lower bound. stress: (t, 4, 6) stresses at the four corners of each tetrahedron
    as vectors (xx, √2 xy, yy, √2 xz, √2 yz, zz), tension positive. room: least distance to a yield condition, less
    `charge`; at least 0. charge: stress that covers the residual of equilibrium, subtracted from the distance to yield.
    rate: (t, 4) multipliers of the yield conditions at the corners times strengths, as the solver gave them. They
    estimate how λ grows with strength, and steer refinement; no bound depends on them.
    """

    factor: float
    stress: Floats
    room: float
    charge: float
    rate: Floats


class SpatialLowerBound:
    """Lower bound on λ by stress fields, for one labelling on one mesh in space.

    problem: the scaled problem, with its labelling. status: status by the solver at the last attempt of `bound`, ""
    before.
    """

    def __init__(self, problem: SpatialProblem) -> None:
        self.problem = problem
        self._solids = len(problem.mesh)
        self.status = ""

    def bound(self) -> SpatialStress | None:
        """Find a stress field and certify it, with larger margins to yield where that fails.

        The last attempt is a mean with an interior field. None: the solver failed, or no attempt passed the check.
        """
        proposed: Answer | None = None
        for margin in _MARGINS:
            answer = self.propose(margin)
            self.status = answer.status
            if not answer.usable:
                continue
            found = self.certify(answer.point[: 24 * self._solids], float(answer.point[-1]))
            if found is not None:
                return replace(found, rate=self._rate(answer.dual))
            proposed = answer
        return None if proposed is None else self._blend(proposed)

    def _blend(self, proposed: Answer) -> SpatialStress | None:
        """Certify a mean of a field that violates yield and one with ample room, or return None.

        The room is concave, so that the mean has room enough.
        """
        inner = self.propose(_INTERIOR)
        if not inner.usable:
            return None
        rooms = []
        for answer in (proposed, inner):
            field, rest = self._project(answer.point[: 24 * self._solids], float(answer.point[-1]))
            rooms.append(self.room(field.reshape(-1, 4, 6)) - 2.0 * rest)
        if not rooms[1] > 0.0:
            return None
        share = min(1.0, 1.01 * max(-rooms[0], 0.0) / (rooms[1] - min(rooms[0], 0.0)))
        point = (1.0 - share) * proposed.point + share * inner.point
        found = self.certify(point[: 24 * self._solids], float(point[-1]))
        return None if found is None else replace(found, rate=self._rate(proposed.dual))

    def certify(self, stress: Floats, factor: float) -> SpatialStress | None:
        """Project stresses onto equilibrium and check yield, without a solver for cone programs.

        stress: (24t,) in the order of `SpatialStress.stress`. factor: λ. Both are scaled. The `rate` of the result is
        zero. None: the projected stresses violate yield, or miss equilibrium by more than rounding.
        """
        projected, rest = self._project(stress, factor)
        field = projected.reshape(-1, 4, 6)
        room = self.room(field) - rest
        return SpatialStress(factor, field, room, rest, np.zeros((self._solids, 4))) if room >= 0.0 else None

    def room(self, stress: Floats) -> float:
        """Return the least distance of stresses to any yield condition, scaled stress.

        stress: (t, 4, 6) as in `SpatialStress`. A negative result means that yield is violated in a block or on a dry
        joint. Rounding of eigenvalues is subtracted. Equilibrium is not checked.
        """
        p = self.problem
        principal = np.linalg.eigvalsh(tensors(stress))
        low, high = principal[..., 0], principal[..., 2]
        none = np.zeros_like(low)
        least = float(p.material.slack(np.stack([0.5 * (low + high), 0.5 * (high - low), none], axis=-1)).min())
        if p.dry.size:
            least = min(least, float(self._joint_room(stress).min()))
        # eigenvalues are exact but for rounding
        return least - tolerances.ROUNDING * float(abs(principal).max())

    def _joint_room(self, stress: Floats) -> Floats:
        """Return the distances (k, 3) to yield at the corners of the k dry triangles.

        stress: (t, 4, 6), scaled. Negative distances are violations. Shear on joints without friction and cohesion is
        not measured: it is made zero as equilibrium is made exact.
        """
        p, s, rows = self.problem, self.problem.sides, self.problem.dry
        own = stress[s.a[rows][:, None], s.corner_a[rows]]
        pull = np.einsum("fij,fkj->fki", normal_map(s.normal[rows]), own)
        normal = np.einsum("fki,fi->fk", pull, s.normal[rows])
        shear = np.linalg.norm(pull - normal[..., None] * s.normal[rows][:, None], axis=2)
        face = p.face[rows]
        mu, c, crush = (v[face][:, None] for v in (p.joints.friction, p.joints.cohesion, p.joints.crushing))
        slides = np.where(self._frictionless[:, None], np.inf, c - mu * normal - shear)
        return np.asarray(np.minimum(np.minimum(-normal, slides), crush + normal))

    @cached_property
    def _frictionless(self) -> Bools:
        """True (k,) for triangles on dry interfaces that have neither friction nor cohesion."""
        p = self.problem
        face = p.face[p.dry]
        return np.asarray((p.joints.friction[face] == 0.0) & (p.joints.cohesion[face] == 0.0))

    @cached_property
    def equilibrium(self) -> tuple[sp.csr_array, Floats]:
        """Matrix E (rows, 24t + 1) and right-hand side f (rows,) of equilibrium E x = f.

        x: stresses in the order of `SpatialStress.stress`, then λ, scaled. The rows are docs/method.md (10.4). On dry
        joints without friction and cohesion, two more rows at each corner exclude shear.
        """
        p, count, s = self.problem, self._solids, self.problem.sides
        rows, last = Rows(), 24 * count
        size = np.cbrt(6.0 * p.mesh.volume)
        slope = normal_map(p.mesh.gradient * size[:, None, None])
        base = 24 * np.arange(count)[:, None, None] + np.arange(24).reshape(4, 6)
        for axis in range(3):
            entries = [(base.reshape(count, 24), slope[:, :, axis].reshape(count, 24))]
            rows.add([*entries, (np.full(count, last), size * p.live[:, axis])], -size * p.dead[:, axis], count)
        for corner in range(3):
            two, one = p.joined, p.outer
            for axis in range(3):
                entries = [self._traction(two, corner, axis, True), self._traction(two, corner, axis, False)]
                rows.add(entries, 0.0, len(two))
                pull = (np.full(len(one), last), -p.pull[one, corner, axis])
                rows.add([self._traction(one, corner, axis, True), pull], p.dead_pull[one, corner, axis], len(one))
            smooth = p.dry[self._frictionless]
            for along in across(s.normal[smooth]):
                rows.add([self._along(smooth, corner, along)], 0.0, len(smooth))
        return rows.matrix(last + 1), rows.right

    def _traction(self, rows: Ints, corner: int, axis: int, first: bool) -> tuple[Ints, Floats]:
        """Return columns and values (k, 6) of one traction component at one corner of triangles.

        rows: (k,) triangles. corner: 0 to 2. axis: 0 to 2. first: True for the traction of tetrahedron a, False for
        minus that of b.
        """
        s = self.problem.sides
        solid, local = (s.a, s.corner_a) if first else (s.b, s.corner_b)
        columns = 24 * solid[rows][:, None] + 6 * local[rows, corner][:, None] + np.arange(6)
        values = normal_map(s.normal[rows])[:, axis]
        return columns, values if first else -values

    def _along(self, rows: Ints, corner: int, along: Floats) -> tuple[Ints, Floats]:
        """Return columns and values (k, 6) of traction components along given directions.

        rows: (k,) triangles, with the tractions of tetrahedron a. corner: 0 to 2. along: (k, 3) directions.
        """
        s = self.problem.sides
        columns = 24 * s.a[rows][:, None] + 6 * s.corner_a[rows, corner][:, None] + np.arange(6)
        return columns, np.einsum("ki,kij->kj", along, normal_map(s.normal[rows]))

    @cached_property
    def _statics(self) -> tuple[sp.csr_array, Any]:
        """Matrix E (rows, 24t) of equilibrium over the stresses, and a factor of E Eᵀ."""
        matrix = sp.csr_array(self.equilibrium[0][:, :-1])
        square = sp.csc_matrix(matrix @ matrix.T + _REGULAR * sp.eye_array(matrix.shape[0]))
        options = {"SymmetricMode": True}
        return matrix, splu(square, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)

    def _project(self, stress: Floats, factor: float) -> tuple[Floats, float]:
        """Return the nearest stresses (24t,) in equilibrium under λ, and a bound on their error.

        stress: (24t,), factor: λ, both scaled. The error, a scaled stress, is at most twice the last correction plus
        the largest residual. It is inf where the residual exceeds rounding, since the equations then contradict each
        other.
        """
        (matrix, solver), (whole, rhs) = self._statics, self.equilibrium
        rhs = rhs - factor * whole[:, [-1]].toarray().ravel()
        last, size = np.inf, np.inf
        for _ in range(_STEPS):
            step = matrix.T @ solver.solve(rhs - matrix @ stress)
            size = float(abs(step).max())
            if size >= 0.25 * last:
                break
            stress, last = stress + step, size
        residual = float(abs(rhs - matrix @ stress).max())
        terms = float((abs(matrix) @ abs(stress) + abs(rhs)).max())
        rest = 2.0 * size + residual
        return stress, rest if residual <= tolerances.ROUNDING * terms else np.inf

    def propose(self, margin: float) -> Answer:
        """Solve for the stress field of largest λ; the answer is not certified, see `certify`.

        margin: slack that the solver keeps to each yield condition, scaled stress. `Answer.point` holds the stresses
        (24t,), α (4t,), β (4t,) and λ. α ≥ σ1 and β ≤ σ3 are the unknowns of docs/method.md (10.1).
        """
        p, corners = self.problem, 4 * self._solids
        matrix, rhs = self.equilibrium
        top, low = 6 * corners + np.arange(corners), 7 * corners + np.arange(corners)
        width = 8 * corners + 1
        linear, threes, psd = Rows(), Rows(), Rows()
        for a, b in p.material.lines:
            # R ≤ a + b m with m = (α + β)/2 and R = (α − β)/2
            linear.add([(top, 0.5 - 0.5 * b), (low, -0.5 - 0.5 * b)], a - margin, corners)
        self._joint_rows(linear, threes, margin)
        every = np.arange(corners)
        for sign, bound in ((1.0, top), (-1.0, low)):
            columns, values = np.full((corners, 6, 2), 0, dtype=np.int64), np.zeros((corners, 6, 2))
            columns[..., 0], values[..., 0] = 6 * every[:, None] + np.arange(6), sign
            columns[..., 1] = bound[:, None]
            values[:, DIAGONAL, 1] = -sign
            psd.add([(columns.reshape(-1, 2), values.reshape(-1, 2))], 0.0, 6 * corners)
        wide = sp.hstack([matrix[:, :-1], sp.csr_array((matrix.shape[0], 2 * corners)), matrix[:, -1:]])
        parts = [part for part in (linear, threes, psd) if part.count]
        whole = sp.csr_array(sp.vstack([wide, *(part.matrix(width) for part in parts)]))
        objective = np.zeros(width)
        objective[-1] = -1.0
        sizes = ConeSizes(len(rhs), linear.count, threes.count // 3, 0, 2 * corners)
        self._yields = len(rhs), corners
        return solve_cones(objective, whole, np.concatenate([rhs, *(part.right for part in parts)]), sizes)

    def _joint_rows(self, linear: Rows, threes: Rows, margin: float) -> None:
        """Append pressure, crushing and friction of dry joints at all corners of triangles.

        linear: takes the first two, threes: friction. margin: slack to each, scaled stress.
        """
        p, s, rows = self.problem, self.problem.sides, self.problem.dry
        face, normal = p.face[rows], s.normal[rows]
        one, two = across(normal)
        rough, crushed = ~self._frictionless, np.isfinite(p.joints.crushing[face])
        mu, c = p.joints.friction[face], p.joints.cohesion[face]
        for corner in range(3):
            columns, pressed = self._along(rows, corner, normal)
            linear.add([(columns, pressed)], -margin, len(rows))
            some = np.flatnonzero(crushed)
            linear.add([(columns[some], -pressed[some])], p.joints.crushing[face[some]] - margin, len(some))
            parts = [mu[:, None] * pressed, *(self._along(rows, corner, along)[1] for along in (one, two))]
            wide = np.stack(parts, axis=1)[rough]
            right = np.zeros((len(wide), 3))
            right[:, 0] = c[rough] - margin
            threes.add([(np.repeat(columns[rough], 3, axis=0), wide.reshape(-1, 6))], right.ravel(), 3 * len(wide))

    def _rate(self, dual: Floats) -> Floats:
        """Return the `SpatialStress.rate` (t, 4) of multipliers of all rows of the program."""
        lines = self.problem.material.lines
        start, count = self._yields
        shares = dual[start : start + len(lines) * count].reshape(len(lines), count)
        return np.asarray((lines[:, :1] * shares).sum(axis=0).reshape(-1, 4))
