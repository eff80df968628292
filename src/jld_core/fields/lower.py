"""Lower bound: stress fields in equilibrium and within yield, linear in each triangle.

Formulas: docs/method.md (9.6) to (9.9). The solver proposes a field. This module proves the bound: it projects the
field onto equilibrium and checks every yield condition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.fields.cone_pattern import Answer, ConeProgram, Rows
from jld_core.fields.problem import Problem

# Room that the solver keeps to yield, scaled stress: more than its residual, so that the projected field has room
_MARGIN = 1e-7

# Margins with which a program is solved again if its answer violates yield. The solver often fails by chance.
_WIDER = (3e-7, 1e-6)

# Margins of the interior fields that are blended with a field that still violates yield, in the order tried
_INTERIOR = (1e-3, 1e-5)

# Added to the diagonal of E Eᵀ, because rows depend on each other around nodes; correction steps undo its effect
_REGULAR = 1e-10

_STEPS = 6  # largest number of correction steps of a projection onto equilibrium


@dataclass(frozen=True)
class StressField:
    """Certified stress field of one labelling, in the plane or in space, scaled (see `Units`)."""

    factor: float  # λ that the field carries, a lower bound
    # Tension is positive. In the plane: (t, 3, 3) stresses (m, d, s) at the three corners of each triangle,
    # (σx + σy)/2, (σx − σy)/2 and τxy. In space: (t, 4, 6) stresses at the four corners of each tetrahedron as vectors
    # (xx, √2 xy, yy, √2 xz, √2 yz, zz).
    stress: Floats
    room: float  # least distance to a yield condition, less `charge`; at least 0
    charge: float  # stress that covers the residual of equilibrium, subtracted from the distance to yield
    # (t, 3 or 4) multipliers of the yield conditions at the corners times strengths, as the solver gave them. They
    # estimate how λ grows with strength, and steer refinement; no bound depends on them.
    rate: Floats


class LowerBound:
    """Lower bounds on λ by stress fields, for many labellings of one problem.

    `bound` returns a certified field. Programs and factors are kept, so that later labellings cost less.

    problem: the scaled problem on one mesh. many: True where hundreds of labellings are bounded; see `ConeProgram`.
    status: status by the solver of the last labelling that was bounded, "" before.
    """

    def __init__(self, problem: Problem, many: bool = False) -> None:
        self.problem, self._many = problem, many
        self._triangles = len(problem.mesh)
        self._width = 12 * self._triangles + 1
        self._programs: dict[float, tuple[ConeProgram, Ints]] = {}
        self._factors: dict[bytes, tuple[sp.csr_array, object]] = {}
        self.status = ""

    def bound(self, labels: Bits) -> StressField | None:
        """Find a stress field for one labelling, and certify it.

        labels: (m,) True = dry. Where the proposed field violates yield, larger margins and a mean with an interior
        field are tried. None: the solver failed, or no attempt passed the check.
        """
        return self._bound_by(self.propose(labels, _MARGIN), labels)

    def bound_all(self, labellings: Bits) -> list[StressField | None]:
        """Find stress fields for labellings (k, m), solved together where possible; see `bound`."""
        program, owner = self._program_with(_MARGIN)
        answers = program.solve_all(np.array([self._off(owner, labels) for labels in labellings]))
        return [self._bound_by(answer, labels) for answer, labels in zip(answers, labellings, strict=True)]

    def _bound_by(self, answer: Answer, labels: Bits) -> StressField | None:
        """Certify a solver's answer; where that fails, those of further programs."""
        self.status = answer.status
        if not answer.usable:
            return None
        proposed = answer.point[: 9 * self._triangles], float(answer.point[-1])
        found = self.certify(*proposed, labels) or self._with_larger_margins(labels) or self._blend(*proposed, labels)
        return replace(found, rate=self._rate(answer.dual)) if found is not None else None

    def _with_larger_margins(self, labels: Bits) -> StressField | None:
        """Solve with larger margins, and return the first field that passes the check, else None."""
        for margin in _WIDER:
            answer = self.propose(labels, margin)
            if answer.usable:
                found = self.certify(answer.point[: 9 * self._triangles], float(answer.point[-1]), labels)
                if found is not None:
                    return found
        return None

    def _blend(self, stress: Floats, factor: float, labels: Bits) -> StressField | None:
        """Certify a mean of a field that violates yield and one with ample room, or return None.

        stress: (9t,) of the first, factor: its λ, both scaled. The room is concave, so that the mean has room enough.
        """
        for margin in _INTERIOR:
            inner = self.propose(labels, margin)
            if not inner.usable:
                continue
            rooms = []
            for point, load in ((stress, factor), (inner.point[: 9 * self._triangles], float(inner.point[-1]))):
                field, rest = self._project(point, load, labels)
                rooms.append(self.room(field.reshape(-1, 3, 3), labels) - 2.0 * rest)
            if rooms[1] > 0.0:
                share = min(1.0, 1.01 * max(-rooms[0], 0.0) / (rooms[1] - min(rooms[0], 0.0)))
                point = (1.0 - share) * stress + share * inner.point[: 9 * self._triangles]
                load = (1.0 - share) * factor + share * float(inner.point[-1])
                found = self.certify(point, load, labels)
                if found is not None:
                    return found
        return None

    def propose(self, labels: Bits, margin: float) -> Answer:
        """Solve for the stress field of largest λ; the answer is not certified, see `certify`.

        labels: (m,) True = dry. margin: slack that the solver keeps to each yield condition, scaled stress. Shear of
        joints without friction and shear strength has no slack. `Answer.point` begins with the stresses (9t,), as
        `StressField.stress` in C order, and ends with λ.
        """
        program, owner = self._program_with(margin)
        return program.solve(self._off(owner, labels))

    def _program_with(self, margin: float) -> tuple[ConeProgram, Ints]:
        """Return the program of a margin and the edge whose label switches each row, −1 for none.

        Each program is set up once and kept.
        """
        if margin not in self._programs:
            self._programs[margin] = self._program(margin)
        return self._programs[margin]

    def _off(self, owner: Ints, labels: Bits) -> Bools:
        """Mark the rows (rows,) to switch off: those whose owner edge is not on a dry joint.

        owner: (rows,) edge of each row, −1 for none. labels: (m,) True = dry.
        """
        return (owner >= 0) & ~self.problem.is_dry(labels)[owner]

    def certify(self, stress: Floats, factor: float, labels: Bits) -> StressField | None:
        """Project stresses onto equilibrium and check yield, without a solver for cone programs.

        stress: (9t,) in the order of `StressField.stress`. labels: (m,) True = dry. All are scaled. The `rate` of the
        result is zero. None: the projected stresses violate yield, or miss equilibrium by more than rounding.
        """
        projected, rest = self._project(stress, factor, labels)
        field = projected.reshape(-1, 3, 3)
        room = self.room(field, labels) - rest
        return StressField(factor, field, room, rest, np.zeros((self._triangles, 3))) if room >= 0.0 else None

    def _rate(self, dual: Floats) -> Floats:
        """Compute `StressField.rate` (t, 3) from the multipliers `dual` of all rows."""
        lines = self.problem.material.lines
        start, count = len(self.equilibrium[1]), 3 * self._triangles
        shares = dual[start : start + len(lines) * count].reshape(len(lines), count)
        return np.asarray((lines[:, :1] * shares).sum(axis=0).reshape(-1, 3))

    def room(self, stress: Floats, labels: Bits) -> float:
        """Return the least distance of stresses to any yield condition, scaled stress.

        stress: (t, 3, 3) as in `StressField`. labels: (m,) True = dry. A negative result means that yield is violated
        in a block or on a dry joint. Equilibrium is not checked.
        """
        p = self.problem
        least = [float(p.material.slack(stress).min())]
        rows = np.flatnonzero(p.is_dry(labels))
        if rows.size:
            least.append(float(self.joint_room(stress, rows).min()))
        return min(least)

    def joint_room(self, stress: Floats, rows: Ints) -> Floats:
        """Return the distances of tractions to the yield of dry joints, (k, 2), scaled stress.

        stress: (t, 3, 3) as in `StressField`. rows: (k,) edges on interfaces, taken as dry. The columns are both ends
        of an edge; a negative distance is a violation. Shear on joints without friction and shear strength is left out:
        `certify` makes it zero.
        """
        p = self.problem
        normal, shear = self.tractions(stress, rows)
        face = p.face[rows]
        mu, c, crush = (v[face][:, None] for v in (p.joints.friction, p.joints.shear, p.joints.crushing))
        slides = np.where(self.frictionless[face][:, None], np.inf, c - mu * normal - abs(shear))
        return np.minimum(np.minimum(-normal, slides), crush + normal)

    @cached_property
    def frictionless(self) -> Bools:
        """(m,) True for interfaces whose dry joint has neither friction nor shear strength."""
        return np.asarray((self.problem.joints.friction == 0.0) & (self.problem.joints.shear == 0.0))

    def tractions(self, stress: Floats, rows: Ints) -> tuple[Floats, Floats]:
        """Return normal and shear tractions at both ends of some edges, (k, 2) each.

        stress: (t, 3, 3) as in `StressField`. rows: (k,) edges. The tractions are those of triangle a, tension
        positive, scaled.
        """
        e = self.problem.edges
        own = stress[e.a[rows][:, None], e.corner_a[rows]]
        nx, ny = e.normal[rows, 0][:, None], e.normal[rows, 1][:, None]
        m, d, s = own[..., 0], own[..., 1], own[..., 2]
        return m + d * (nx**2 - ny**2) + 2.0 * s * nx * ny, -2.0 * d * nx * ny + s * (nx**2 - ny**2)

    @cached_property
    def equilibrium(self) -> tuple[sp.csr_array, Floats]:
        """Matrix E (rows, 9t + 1) and right-hand side f (rows,) of equilibrium E x = f."""
        # x: stresses in the order of `StressField.stress`, then λ, scaled. The rows are docs/method.md (9.6) and (9.7):
        # equilibrium of triangles, equal tractions across edges, given tractions on free edges.
        p, count = self.problem, self._triangles
        rows, last = Rows(), 9 * count
        size = np.sqrt(2.0 * p.mesh.area)
        gradient = p.mesh.gradient * size[:, None, None]
        base = 9 * np.arange(count)[:, None] + 3 * np.arange(3)
        gx, gy = gradient[..., 0], gradient[..., 1]
        for axis, parts in enumerate(((gx, gx, gy), (gy, -gy, gx))):
            entries = [(base + k, part) for k, part in enumerate(parts)]
            load = (np.full(count, last), size * p.live[:, axis])
            rows.add([*entries, load], -size * p.dead[:, axis], count)
        for end in (0, 1):
            for axis in (0, 1):
                two = p.joined
                entries = self._traction(two, end, axis, 1.0) + self._traction(two, end, axis, -1.0)
                rows.add(entries, 0.0, len(two))
                one = p.outer
                pull = (np.full(len(one), last), -p.pull[one, end, axis])
                rows.add([*self._traction(one, end, axis, 1.0), pull], p.dead_pull[one, end, axis], len(one))
        return rows.matrix(last + 1), rows.right

    def _traction(self, rows: Ints, end: int, axis: int, sign: float) -> list[tuple[Ints, Floats]]:
        """Return columns and values (k,) of one traction component at one end of edges.

        rows: (k,) edges.
        """
        e = self.problem.edges
        triangle, corner = (e.a, e.corner_a) if sign > 0.0 else (e.b, e.corner_b)
        base = 9 * triangle[rows] + 3 * corner[rows, end]
        nx, ny = sign * e.normal[rows, 0], sign * e.normal[rows, 1]
        return [(base + k, part) for k, part in enumerate((nx, nx, ny) if axis == 0 else (ny, -ny, nx))]

    def _equalities(self, labels: Bits) -> tuple[sp.csr_array, object]:
        """Return the matrix A (rows, 9t) of all equations on the stresses, and a factor of A Aᵀ.

        labels: (m,) True = dry. Factors are kept.
        """
        # The equations are equilibrium, and no shear on dry joints without friction and shear strength. λ is no unknown
        # here: its dense column would fill A Aᵀ.
        p = self.problem
        edges = p.on_faces[p.is_dry(labels)[p.on_faces] & self.frictionless[p.face[p.on_faces]]]
        key = edges.tobytes()
        if key not in self._factors:
            matrix = sp.csr_array(self.equilibrium[0][:, :-1])
            if edges.size:
                matrix = sp.csr_array(sp.vstack([matrix, self._no_shear(edges)]))
            square = sp.csc_matrix(matrix @ matrix.T + _REGULAR * sp.eye_array(matrix.shape[0]))
            options = {"SymmetricMode": True}
            self._factors[key] = (
                matrix,
                splu(square, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options),
            )
        return self._factors[key]

    def _no_shear(self, edges: Ints) -> sp.csr_array:
        """Return rows (2k, 9t) that give the shear tractions at both ends of k edges."""
        e, rows = self.problem.edges, Rows()
        nx, ny = e.normal[edges, 0], e.normal[edges, 1]
        for end in (0, 1):
            base = 9 * e.a[edges] + 3 * e.corner_a[edges, end]
            rows.add([(base + 1, -2.0 * nx * ny), (base + 2, nx**2 - ny**2)], 0.0, len(edges))
        return rows.matrix(9 * self._triangles)

    def _project(self, stress: Floats, factor: float, labels: Bits) -> tuple[Floats, float]:
        """Return the nearest stresses (9t,) in equilibrium under λ, and a bound on their error.

        stress: (9t,), factor: λ, both scaled. The error, a scaled stress, is at most twice the last correction plus the
        largest residual. It is inf where the residual exceeds rounding, since the equations then contradict each other.
        """
        matrix, solver = self._equalities(labels)
        whole, rhs = self.equilibrium
        rhs = rhs - factor * whole[:, [-1]].toarray().ravel()
        rhs = np.concatenate([rhs, np.zeros(matrix.shape[0] - len(rhs))])
        last, size = np.inf, np.inf
        for _ in range(_STEPS):
            step = matrix.T @ solver.solve(rhs - matrix @ stress)  # type: ignore[attr-defined]
            size = float(abs(step).max())
            if size >= 0.25 * last:
                break
            stress, last = stress + step, size
        residual = float(abs(rhs - matrix @ stress).max())
        terms = float((abs(matrix) @ abs(stress) + abs(rhs)).max())
        # corrections contract from step to step, so that all further ones together change less than twice this one
        rest = 2.0 * size + residual
        return stress, rest if residual <= tolerances.ROUNDING * terms else np.inf

    def _program(self, margin: float) -> tuple[ConeProgram, Ints]:
        """Set up the program that maximises λ; return it, and the edge whose label switches each row, −1 for none."""
        # Columns: stresses (9t,), a radius ≥ √(d² + s²) of each corner (3t,), and λ. Rows: equilibrium, yield of the
        # material over the radius, yield of dry joints at both ends of edges, and the cones of the radii.
        p, count = self.problem, self._triangles
        matrix, rhs = self.equilibrium
        every = np.arange(3 * count)
        radius = 9 * count + every
        linear = Rows()
        for a, b in p.material.lines:
            linear.add([(radius, 1.0), (3 * every, -b)], a - margin, len(every))
        yields = linear.count
        owner = [np.full(yields, -1, dtype=np.int64)]
        rows = p.on_faces
        face = p.face[rows]
        e = p.edges
        nx, ny = e.normal[rows, 0], e.normal[rows, 1]
        one = np.ones(len(rows))
        normal = (one, nx**2 - ny**2, 2.0 * nx * ny)
        shear = (0.0 * one, -2.0 * nx * ny, nx**2 - ny**2)
        mu, c = p.joints.friction[face], p.joints.shear[face]
        size = np.maximum(1.0, mu)
        for end in (0, 1):
            base = 9 * e.a[rows] + 3 * e.corner_a[rows, end]
            linear.add([(base + k, normal[k]) for k in range(3)], -margin, len(rows))
            for sign in (1.0, -1.0):
                entries = [(base + k, (mu * normal[k] + sign * shear[k]) / size) for k in range(3)]
                linear.add(entries, np.where(self.frictionless[face], 0.0, c - margin) / size, len(rows))
            owner += [rows] * 3
            some = np.flatnonzero(np.isfinite(p.joints.crushing[face]))
            crush = p.joints.crushing[face[some]]
            linear.add([(base[some] + k, -normal[k][some]) for k in range(3)], crush - margin, len(some))
            owner.append(rows[some])
        cones = Rows()
        cones.add([(np.stack([radius, 3 * every + 1, 3 * every + 2], axis=1).reshape(-1), -1.0)], 0.0, 3 * len(every))
        wide = sp.hstack([matrix[:, :-1], sp.csr_array((matrix.shape[0], 3 * count)), matrix[:, -1:]])
        whole = sp.vstack([wide, linear.matrix(self._width), cones.matrix(self._width)])
        right = np.concatenate([rhs, linear.right, cones.right])
        objective = np.zeros(self._width)
        objective[-1] = -1.0
        owners = np.full(len(right), -1, dtype=np.int64)
        owners[len(rhs) : len(rhs) + linear.count] = np.concatenate(owner)
        sizes = (len(rhs), linear.count, len(every))
        # further margins are for few labellings
        many = self._many and margin == _MARGIN
        return ConeProgram(objective, sp.csr_array(whole), right, sizes, many), owners
