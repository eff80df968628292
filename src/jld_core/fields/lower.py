"""Lower bound: stress fields in equilibrium and within yield, linear in each simplex, proven without the solver.

Formulas: docs/method.md (9.6) to (9.9), in space (10.1), (10.4) and (10.5).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.fields.cones import Answer, ConeProgram, ConeSizes, Rows, solve_cones
from jld_core.fields.forms import COMPONENTS, DIAGONAL, across, normal_map, slack, tangential
from jld_core.fields.problem import Problem

# Room that the solver keeps to yield by the dimension, scaled stress: more than its residual, so that the projected
# field has room. The solver often fails by chance; the others are tried where an answer violates yield.
_MARGINS = {2: (1e-7, 3e-7, 1e-6), 3: (1e-6, 1e-5)}

# Margins of the interior fields that are blended with a field that still violates yield, in the order tried
_INTERIOR = {2: (1e-3, 1e-5), 3: (1e-3,)}

# Added to the diagonal of E Eᵀ, because rows depend on each other around nodes; correction steps undo its effect
_REGULAR = 1e-10

_STEPS = 6  # largest number of correction steps of a projection onto equilibrium


@dataclass(frozen=True)
class StressField:
    """Certified stress field of one labelling, scaled (see `Units`)."""

    factor: float  # λ that the field carries, a lower bound
    stress: Floats  # (t, d + 1, 3 or 6) stresses at the corners of each simplex, as in `forms`; tension is positive
    room: float  # least distance to a yield condition, less `charge`; at least 0
    charge: float  # stress that covers the residual of equilibrium, subtracted from the distance to yield
    # (t, d + 1) multipliers of the yield conditions at the corners times strengths, as the solver gave them. They
    # estimate how λ grows with strength, and steer refinement; no bound depends on them.
    rate: Floats


_MORE = 1.01  # factor on the least share of an interior field that a mean needs


class LowerBound:
    """Lower bounds on λ by stress fields, for many labellings of one problem; planar programs and factors are stored.

    many: True where hundreds are bounded in the plane, see `ConeProgram`. status: of the last labelling, "" before.
    """

    def __init__(self, problem: Problem, many: bool = False) -> None:
        self.problem, self._many = problem, many
        self._dimension = problem.mesh.dimension
        self._shape = len(problem.mesh), self._dimension + 1, COMPONENTS[self._dimension]
        self._size = int(np.prod(self._shape))
        self._margins = _MARGINS[self._dimension]
        self._programs: dict[float, tuple[ConeProgram, Ints]] = {}  # by margin
        self._factors: dict[bytes, tuple[sp.csr_array, object]] = {}  # by the sides whose stresses are continuous
        self.status = ""

    def bound(self, labels: Bits) -> StressField | None:
        """Find and certify a stress field for one labelling; None where the solver or every check fails."""
        # Where the proposed field violates yield, larger margins and a mean with an interior field are tried.
        return self._bound_by(self.propose(labels, self._margins[0]), labels)

    def bound_all(self, labellings: Bits) -> list[StressField | None]:
        """Find stress fields for labellings (k, m) in the plane, solved together where possible."""
        program, owner = self._program_with(self._margins[0])
        answers = program.solve_all(np.array([self._off(owner, labels) for labels in labellings]))
        return [self._bound_by(answer, labels) for answer, labels in zip(answers, labellings, strict=True)]

    def _bound_by(self, answer: Answer, labels: Bits) -> StressField | None:
        """Certify a solver's answer; where that fails, those of further programs."""
        self.status = answer.status
        if not answer.usable:
            return None
        field = self.certify(*self._parts(answer), labels)
        for margin in self._margins[1:]:
            if field is None:
                wider = self.propose(labels, margin)
                field = self.certify(*self._parts(wider), labels) if wider.usable else None
        field = field or self._blend(answer, labels)
        return None if field is None else replace(field, rate=self._rate(answer.dual))

    def _parts(self, answer: Answer) -> tuple[Floats, float]:
        return answer.point[: self._size], float(answer.point[-1])

    def _blend(self, proposed: Answer, labels: Bits) -> StressField | None:
        """Certify a mean of a field that violates yield and one with ample room, or return None."""
        # The room is concave, so that the mean has room enough.
        for margin in _INTERIOR[self._dimension]:
            interior = self.propose(labels, margin)
            if not interior.usable:
                continue
            room_of_proposed, room_of_interior = (self._room_of(answer, labels) for answer in (proposed, interior))
            if room_of_interior > 0.0:
                # a little more than the mean needs
                missing = max(-room_of_proposed, 0.0)
                share = min(1.0, _MORE * missing / (room_of_interior + missing))
                point = (1.0 - share) * proposed.point + share * interior.point
                field = self.certify(point[: self._size], float(point[-1]), labels)
                if field is not None:
                    return field
        return None

    def _room_of(self, answer: Answer, labels: Bits) -> float:
        """Return the room of an answer once it is projected, less twice the error of that."""
        field, error = self._project(*self._parts(answer), labels)
        return self.room(field.reshape(self._shape), labels) - 2.0 * error

    def propose(self, labels: Bits, margin: float) -> Answer:
        """Solve for the stress field of largest λ with slack `margin` in yield; uncertified.

        `Answer.point` begins with the stresses, as `StressField.stress` in C order, and ends with λ.
        """
        if self._dimension == 2:
            program, owner = self._program_with(margin)
            return program.solve(self._off(owner, labels))
        return solve_cones(*self._program(np.flatnonzero(self.problem.is_dry(labels)), margin, labels)[0])

    def _program_with(self, margin: float) -> tuple[ConeProgram, Ints]:
        """Return the planar program of a margin, and the edge whose label switches each row, −1 for none."""
        # Each program is set up once. Further margins are for few labellings.
        if margin not in self._programs:
            (objective, matrix, rhs, sizes), owner = self._program(self.problem.on_faces, margin)
            many = self._many and margin == self._margins[0]
            program = ConeProgram(objective, matrix, rhs, sizes, many)
            self._programs[margin] = program, owner
        return self._programs[margin]

    def _off(self, owner: Ints, labels: Bits) -> Bools:
        """Mark the rows (rows,) whose owner edge is not on a dry joint."""
        return (owner >= 0) & ~self.problem.is_dry(labels)[owner]

    def certify(self, stress: Floats, factor: float, labels: Bits) -> StressField | None:
        """Project stresses (size,) onto equilibrium and check yield; None if either is missed by more than rounding."""
        projected, error = self._project(stress, factor, labels)
        field = projected.reshape(self._shape)
        room = self.room(field, labels) - error
        return StressField(factor, field, room, error, np.zeros(self._shape[:2])) if room >= 0.0 else None

    def _rate(self, dual: Floats) -> Floats:
        """Compute `StressField.rate` from the multipliers `dual` of all rows of the last program."""
        lines, count = self.problem.material.lines, self._shape[0] * self._shape[1]
        shares = dual[self._equations : self._equations + len(lines) * count].reshape(len(lines), count)
        return np.asarray((lines[:, :1] * shares).sum(axis=0).reshape(self._shape[:2]))

    def room(self, stress: Floats, labels: Bits) -> float:
        """Return the least distance of stresses to yield in blocks and on dry joints; equilibrium is not checked."""
        rows = np.flatnonzero(self.problem.is_dry(labels))
        in_blocks = float(slack(self.problem.material, stress).min())
        return min(in_blocks, float(self.joint_room(stress, rows).min())) if rows.size else in_blocks

    def joint_room(self, stress: Floats, rows: Ints) -> Floats:
        """Return the distances (k, d) of tractions at corners of sides (k,) to yield as dry joints, scaled."""
        # Shear on joints without friction and shear strength is left out: `certify` makes it zero.
        problem, normals = self.problem, self.problem.sides.normal[rows]
        traction = tractions(problem, stress, rows)
        normal = np.einsum("fki,fi->fk", traction, normals)
        face = problem.face[rows]
        joints = problem.joints
        mu, c, crush = (strength[face][:, None] for strength in (joints.friction, joints.shear, joints.crushing))
        sliding_room = c - mu * normal - tangential(traction, normals)
        sliding_room = np.where(self.frictionless[face][:, None], np.inf, sliding_room)
        return np.asarray(np.minimum(np.minimum(-normal, sliding_room), crush + normal))

    @cached_property
    def frictionless(self) -> Bools:
        """(m,) True for interfaces whose dry joint has neither friction nor shear strength."""
        return np.asarray((self.problem.joints.friction == 0.0) & (self.problem.joints.shear == 0.0))

    @cached_property
    def equilibrium(self) -> tuple[sp.csr_array, Floats]:
        """Matrix E (rows, size + 1) and right-hand side f (rows,) of equilibrium E x = f."""
        # x: stresses in the order of `StressField.stress`, then λ, scaled. The rows are docs/method.md (9.6), (9.7) and
        # (10.4): equilibrium of simplices, equal tractions across sides, given tractions on free sides.
        problem, sides, d = self.problem, self.problem.sides, self._dimension
        count, rows, column_of_load = self._shape[0], Rows(), self._size
        size = np.sqrt(2.0 * problem.mesh.volume) if d == 2 else np.cbrt(6.0 * problem.mesh.volume)
        slope = normal_map(problem.mesh.gradient * size[:, None, None])
        columns = np.arange(column_of_load).reshape(count, -1)
        for axis in range(d):
            entries = [
                (columns, slope[:, :, axis].reshape(count, -1)),
                (np.full(count, column_of_load), size * problem.live[:, axis]),
            ]
            rows.add(entries, -size * problem.dead[:, axis], count)
        joined, outer = problem.joined, problem.outer
        joined_map, outer_map = normal_map(sides.normal[joined]), normal_map(sides.normal[outer])
        for corner in range(d):
            in_a, in_b = self._columns(joined, corner), self._columns(joined, corner, other=True)
            in_outer = self._columns(outer, corner)
            for axis in range(d):
                rows.add([(in_a, joined_map[:, axis]), (in_b, -joined_map[:, axis])], 0.0, len(joined))
                of_load = (np.full(len(outer), column_of_load), -problem.pull[outer, corner, axis])
                rows.add([(in_outer, outer_map[:, axis]), of_load], problem.dead_pull[outer, corner, axis], len(outer))
        return rows.matrix(column_of_load + 1), rows.right

    def _columns(self, rows: Ints, corner: int, other: bool = False) -> Ints:
        """Return the columns (k, 3 or 6) of stresses at one corner of sides (k,), in simplex a or the other one."""
        sides, (_, corners, size) = self.problem.sides, self._shape
        simplex, local = (sides.b, sides.corner_b) if other else (sides.a, sides.corner_a)
        return np.asarray(size * (corners * simplex[rows] + local[rows, corner])[:, None] + np.arange(size))

    def _equalities(self, labels: Bits) -> tuple[sp.csr_array, object]:
        """Return the matrix A (rows, size) of all equations on the stresses, and a factor of A Aᵀ; stored by labels."""
        # The equations are equilibrium, and no shear on dry joints without friction and shear strength. λ is no unknown
        # here: its dense column would fill A Aᵀ.
        smooth = self._frictionless_sides(labels)
        key = smooth.tobytes()
        if key not in self._factors:
            matrix = sp.csr_array(self.equilibrium[0][:, :-1])
            if smooth.size:
                matrix = sp.csr_array(sp.vstack([matrix, self._no_shear(smooth, self._size)]))
            square = sp.csc_matrix(matrix @ matrix.T + _REGULAR * sp.eye_array(matrix.shape[0]))
            options = {"SymmetricMode": True}
            solver = splu(square, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
            self._factors[key] = matrix, solver
        return self._factors[key]

    def _frictionless_sides(self, labels: Bits) -> Ints:
        """Return the sides (k,) on dry joints without friction and shear strength."""
        rows = self.problem.on_faces
        return rows[self.problem.is_dry(labels)[rows] & self.frictionless[self.problem.face[rows]]]

    def _no_shear(self, sides: Ints, width: int) -> sp.csr_array:
        """Return rows over `width` columns that give the shear tractions at the corners of sides (k,)."""
        rows, normal = Rows(), self.problem.sides.normal[sides]
        for corner in range(self._dimension):
            columns = self._columns(sides, corner)
            for direction in across(normal):
                rows.add([(columns, np.einsum("ki,kij->kj", direction, normal_map(normal)))], 0.0, len(sides))
        return rows.matrix(width)

    def _project(self, stress: Floats, load_factor: float, labels: Bits) -> tuple[Floats, float]:
        """Return the nearest stresses (size,) in equilibrium under λ, and a bound on their error."""
        # The error is at most twice the last correction plus the largest residual. A residual beyond rounding means
        # that the equations contradict each other.
        matrix, solver = self._equalities(labels)
        with_load_column, rhs = self.equilibrium
        rhs = rhs - load_factor * with_load_column[:, [-1]].toarray().ravel()
        rhs = np.concatenate([rhs, np.zeros(matrix.shape[0] - len(rhs))])
        previous, size = np.inf, np.inf
        for _ in range(_STEPS):
            step = matrix.T @ solver.solve(rhs - matrix @ stress)  # type: ignore[attr-defined]
            size = float(abs(step).max())
            if size >= 0.25 * previous:
                break
            stress, previous = stress + step, size
        residual = float(abs(rhs - matrix @ stress).max())
        terms = float((abs(matrix) @ abs(stress) + abs(rhs)).max())
        # corrections contract from step to step, so that all further ones together change less than twice this one
        error = 2.0 * size + residual
        return stress, error if residual <= tolerances.ROUNDING * terms else np.inf

    def _program(
        self, rows: Ints, margin: float, labels: Bits | None = None
    ) -> tuple[tuple[Floats, sp.csr_array, Floats, ConeSizes], Ints]:
        """Set up the program that maximises λ; return it, and the side whose label switches each row, −1 for none."""
        # Columns: stresses, what holds them within a circle (a radius ≥ √(d² + s²)) or between principal stresses (α ≥
        # σ1 and β ≤ σ3, docs/method.md (10.1)) at each corner, and λ. Rows: equilibrium, yield of the material, yield
        # of dry joints at the corners of sides, and the cones of radii or of tensors.
        problem, corners, components = self.problem, self._shape[0] * self._shape[1], self._shape[2]
        matrix, rhs = self.equilibrium
        corner, planar = np.arange(corners), self._dimension == 2
        n_bounds = corners if planar else 2 * corners  # number of columns that bound the stresses
        width = self._size + n_bounds + 1
        linear, threes, tensors = Rows(), Rows(), Rows()
        radius = largest = self._size + corner  # columns of radii in the plane, of α in space
        smallest = largest + corners  # columns of β
        for a, b in problem.material.lines:
            in_space = [(largest, 0.5 - 0.5 * b), (smallest, -0.5 - 0.5 * b)]
            linear.add([(radius, 1.0), (components * corner, -b)] if planar else in_space, a - margin, corners)
        owner_of_linear = [np.full(linear.count, -1, dtype=np.int64), *self._joint_rows(rows, linear, threes, margin)]
        if planar:
            circles = np.stack([radius, components * corner + 1, components * corner + 2], axis=1).reshape(-1)
            threes.add([(circles, -1.0)], 0.0, 3 * corners)
        else:
            for sign, bound in ((1.0, largest), (-1.0, smallest)):
                columns, values = np.zeros((corners, 6, 2), dtype=np.int64), np.zeros((corners, 6, 2))
                columns[..., 0], values[..., 0] = 6 * corner[:, None] + np.arange(6), sign
                columns[..., 1] = bound[:, None]
                values[:, DIAGONAL, 1] = -sign
                tensors.add([(columns.reshape(-1, 2), values.reshape(-1, 2))], 0.0, 6 * corners)
        equilibrium = sp.hstack([matrix[:, :-1], sp.csr_array((matrix.shape[0], n_bounds)), matrix[:, -1:]])
        smooth = np.zeros(0, dtype=np.int64) if labels is None else self._frictionless_sides(labels)
        blocks = [equilibrium, self._no_shear(smooth, width)] if smooth.size else [equilibrium]
        self._equations = sum(block.shape[0] for block in blocks)
        cones = [part for part in (linear, threes, tensors) if part.count]
        whole = sp.csr_array(sp.vstack([*blocks, *(part.matrix(width) for part in cones)]))
        right = np.concatenate([rhs, np.zeros(self._equations - len(rhs)), *(part.right for part in cones)])
        objective = np.zeros(width)
        objective[-1] = -1.0
        owners = np.full(len(right), -1, dtype=np.int64)
        owners[self._equations : self._equations + linear.count] = np.concatenate(owner_of_linear)
        sizes = ConeSizes(self._equations, linear.count, threes.count // 3, tensors=tensors.count // 6)
        return (objective, whole, right, sizes), owners

    def _joint_rows(self, rows: Ints, linear: Rows, threes: Rows, margin: float) -> list[Ints]:
        """Append pressure, friction and crushing of joints at the corners of sides (k,); return the sides of rows."""
        # Friction is two inequalities in the plane, and a cone in space.
        problem, normal = self.problem, self.problem.sides.normal[rows]
        face = problem.face[rows]
        mu, c, smooth = problem.joints.friction[face], problem.joints.shear[face], self.frictionless[face]
        size, crushable = np.maximum(1.0, mu), np.flatnonzero(np.isfinite(problem.joints.crushing[face]))
        crush = problem.joints.crushing[face[crushable]]
        pressed, *shears = (np.einsum("ki,kij->kj", axis, normal_map(normal)) for axis in (normal, *across(normal)))
        owner = []
        for corner in range(self._dimension):
            columns = self._columns(rows, corner)
            linear.add([(columns, pressed)], -margin, len(rows))
            if len(shears) == 1:
                for sign in (1.0, -1.0):
                    value = (mu[:, None] * pressed + sign * shears[0]) / size[:, None]
                    linear.add([(columns, value)], np.where(smooth, 0.0, c - margin) / size, len(rows))
            else:
                cone = np.stack([mu[:, None] * pressed, *shears], axis=1)[~smooth]  # head μ σ, then the shear tractions
                cone_rhs = np.zeros((len(cone), 3))
                cone_rhs[:, 0] = c[~smooth] - margin
                entries = [(np.repeat(columns[~smooth], 3, axis=0), cone.reshape(-1, 6))]
                threes.add(entries, cone_rhs.ravel(), 3 * len(cone))
            linear.add([(columns[crushable], -pressed[crushable])], crush - margin, len(crushable))
            owner += [*[rows] * (3 if len(shears) == 1 else 1), rows[crushable]]
        return owner


def tractions(problem: Problem, stress: Floats, rows: Ints) -> Floats:
    """Return the tractions (side, corner, axis), (k, d, d), on simplex a at sides (k,); tension positive."""
    sides = problem.sides
    corner_stress = stress[sides.a[rows][:, None], sides.corner_a[rows]]
    return np.asarray(np.einsum("fij,fkj->fki", normal_map(sides.normal[rows]), corner_stress))
