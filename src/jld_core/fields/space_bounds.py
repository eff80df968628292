"""Two-sided bounds on λ of spatial blocks, refined where the two fields disagree."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.bounds import FieldStatus, relative_gap, status_of_bounds
from jld_core.fields.cone_pattern import Answer, Rows
from jld_core.fields.lower import StressField
from jld_core.fields.problem import Material, Units, material_of, require_refinement
from jld_core.fields.space_cones import DIAGONAL, ConeSizes, across, normal_map, solve_cones, tensors
from jld_core.fields.space_joints import SpatialProblem, fitted_joints, spatial_problem, spatial_units
from jld_core.fields.space_layers import SolidMesh, bisect, split_at_centroids
from jld_core.fields.space_loads import SpatialLoads, loaded_solids
from jld_core.fields.space_upper import SpatialUpperBound, SpatialVelocity

# Room that the solver keeps to yield, scaled stress: more than its residual, so that the projected field has room
_MARGINS = (1e-6, 1e-5)

_INTERIOR = 1e-3  # margin of the interior field that is blended with a field that still violates yield

_STEPS = 6  # largest number of correction steps of a projection onto equilibrium

# Added to the diagonal of E Eᵀ, because rows depend on each other around edges; correction steps undo its effect
_REGULAR = 1e-10


class SpatialLowerBound:
    """Lower bound on λ by stress fields, for one labelling on one mesh in space.

    problem: the scaled problem, with its labelling. status: status by the solver at the last attempt of `bound`, ""
    before.
    """

    def __init__(self, problem: SpatialProblem) -> None:
        self.problem = problem
        self._solids = len(problem.mesh)
        self.status = ""

    def bound(self) -> StressField | None:
        """Find a stress field and certify it, with larger margins to yield where that fails.

        None if the solver failed, or no attempt passed the check.
        """
        # The last attempt is a mean with an interior field.
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

    def _blend(self, proposed: Answer) -> StressField | None:
        """Certify a mean of a field that violates yield and one with ample room, or return None."""
        # The room is concave, so that the mean has room enough.
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

    def certify(self, stress: Floats, factor: float) -> StressField | None:
        """Project stresses onto equilibrium and check yield, without a solver for cone programs.

        stress: (24t,) in the order of `StressField.stress`.
        """
        projected, rest = self._project(stress, factor)
        field = projected.reshape(-1, 4, 6)
        room = self.room(field) - rest
        return StressField(factor, field, room, rest, np.zeros((self._solids, 4))) if room >= 0.0 else None

    def room(self, stress: Floats) -> float:
        """Return the least distance of stresses to any yield condition, scaled stress.

        stress: (t, 4, 6) as in `StressField`. A negative result means that yield is violated in a block or on a dry
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

        stress: (t, 4, 6), scaled. Negative distances are violations. Shear on joints without resistance to it is not
        measured: it is made zero as equilibrium is made exact.
        """
        p, s, rows = self.problem, self.problem.sides, self.problem.dry
        own = stress[s.a[rows][:, None], s.corner_a[rows]]
        pull = np.einsum("fij,fkj->fki", normal_map(s.normal[rows]), own)
        normal = np.einsum("fki,fi->fk", pull, s.normal[rows])
        shear = np.linalg.norm(pull - normal[..., None] * s.normal[rows][:, None], axis=2)
        face = p.face[rows]
        mu, c, crush = (v[face][:, None] for v in (p.joints.friction, p.joints.shear, p.joints.crushing))
        slides = np.where(self._frictionless[:, None], np.inf, c - mu * normal - shear)
        return np.asarray(np.minimum(np.minimum(-normal, slides), crush + normal))

    @cached_property
    def _frictionless(self) -> Bools:
        """True (k,) for triangles on dry interfaces that have neither friction nor shear strength."""
        p = self.problem
        face = p.face[p.dry]
        return np.asarray((p.joints.friction[face] == 0.0) & (p.joints.shear[face] == 0.0))

    @cached_property
    def equilibrium(self) -> tuple[sp.csr_array, Floats]:
        """Matrix E (rows, 24t + 1) and right-hand side f (rows,) of equilibrium E x = f."""
        # x: stresses in the order of `StressField.stress`, then λ, scaled. The rows are docs/method.md (10.4). On dry
        # joints without friction and shear strength, two more rows at each corner exclude shear.
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

        rows: (k,) triangles. first: True for the traction of tetrahedron a, False for minus that of b.
        """
        s = self.problem.sides
        solid, local = (s.a, s.corner_a) if first else (s.b, s.corner_b)
        columns = 24 * solid[rows][:, None] + 6 * local[rows, corner][:, None] + np.arange(6)
        values = normal_map(s.normal[rows])[:, axis]
        return columns, values if first else -values

    def _along(self, rows: Ints, corner: int, along: Floats) -> tuple[Ints, Floats]:
        """Return columns and values (k, 6) of traction components along given directions.

        rows: (k,) triangles, with the tractions of tetrahedron a. along: (k, 3) directions.
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
        """Append pressure, crushing and friction of dry joints at all corners of triangles."""
        p, s, rows = self.problem, self.problem.sides, self.problem.dry
        face, normal = p.face[rows], s.normal[rows]
        one, two = across(normal)
        rough, crushed = ~self._frictionless, np.isfinite(p.joints.crushing[face])
        mu, c = p.joints.friction[face], p.joints.shear[face]
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
        """Return the `StressField.rate` (t, 4) of multipliers of all rows of the program."""
        lines = self.problem.material.lines
        start, count = self._yields
        shares = dual[start : start + len(lines) * count].reshape(len(lines), count)
        return np.asarray((lines[:, :1] * shares).sum(axis=0).reshape(-1, 4))


_SHARE = 0.5  # share of the indicator that the tetrahedra marked at a time hold together (Dörfler marking)

_MOST_MARKED = 0.3  # largest share of tetrahedra that are marked at a time

# Ratio of the numbers of tetrahedra of the next and the last mesh. Tetrahedra are marked and halved until it is
# reached.
_GROWTH = 1.5

_EVERYWHERE = 0.02  # weight of the volume in the indicator, so that no tetrahedron stays coarse for ever

_DEFORMS = 0.1  # share of the dissipation from which a cell that is long or flat is cut in layers


@dataclass(frozen=True)
class SpatialSetting:
    """Data that all meshes of one labelling of a spatial assembly share."""

    assembly: Assembly  # with one load case
    labels: Bits  # (m,) True = dry
    material: Material  # of the blocks, scene units
    units: Units  # of the scaled problem
    loads: SpatialLoads  # over the coarsest mesh, scene units

    @classmethod
    def of(cls, assembly: Assembly, labels: Bits, loads: SpatialLoads) -> SpatialSetting:
        """Make the setting of a labelling (m,), True = dry; raise InputError as `material_of`."""
        material = material_of(assembly)
        return cls(assembly, labels, material, spatial_units(assembly, material), loads)

    def problem(self, mesh: SolidMesh) -> SpatialProblem:
        """Return the scaled problem on a mesh, given in scene units; see `spatial_problem`."""
        return spatial_problem(self.assembly, self.labels, self.material, self.units, mesh, self.loads)

    def uniform(self, cell: int, mesh: SolidMesh) -> bool:
        """Return True if dead and live forces per volume are constant in a cell.

        Such a cell may be filled with other tetrahedra without a change of its loads.
        """
        own = np.unique(mesh.root[mesh.cell == cell])
        both = np.hstack([self.loads.dead[own], self.loads.live[own]])
        return bool((np.ptp(both, axis=0) <= tolerances.ROUNDING * abs(both).max(initial=0.0)).all())


@dataclass(frozen=True)
class SpatialFields:
    """Certified stress field and velocity field of one labelling on one mesh in space."""

    mesh: SolidMesh  # tetrahedra of the velocities, scene units
    split: SolidMesh  # the same tetrahedra, each split in four at its centroid: those of the stresses
    # problem, fine: scaled problem on `mesh`, and on `split`
    problem: SpatialProblem
    fine: SpatialProblem
    stress: StressField | None  # stress field on `split`, None where none was certified
    velocity: SpatialVelocity | None  # velocity field on `mesh`, None where none was certified

    @classmethod
    def on(cls, setting: SpatialSetting, mesh: SolidMesh) -> SpatialFields:
        """Solve for both fields on a mesh, given in scene units, and certify them.

        A field that could not be certified is None; nothing is raised.
        """
        split = split_at_centroids(mesh)
        problem, fine = setting.problem(mesh), setting.problem(split)
        velocity = SpatialUpperBound(problem).bound()
        return cls(mesh, split, problem, fine, SpatialLowerBound(fine).bound(), velocity)

    @property
    def lower(self) -> float:
        """Lower bound on λ, scene units; −inf where none was certified."""
        return -math.inf if self.stress is None else self.problem.units.load * self.stress.factor

    @property
    def upper(self) -> float:
        """Upper bound on λ, scene units; inf where none was certified."""
        return math.inf if self.velocity is None else self.problem.units.load * self.velocity.factor

    def deforming(self) -> Ints:
        """Return the cells (k,) that take a large share of the dissipation.

        The caller cuts them in layers where they are long or flat. Empty without a velocity field.
        """
        if self.velocity is None:
            return np.zeros(0, dtype=np.int64)
        shares = np.bincount(self.mesh.cell, np.maximum(self.velocity.dissipation, 0.0))
        return np.flatnonzero(shares > _DEFORMS * shares.sum())

    def finer(self, adaptive: bool, most: int) -> SolidMesh:
        """Return the next mesh, scene units: refined where the fields disagree, or everywhere.

        adaptive: False bisects every tetrahedron, as is done without a stress field. True bisects those with most
        dissipation less stress power, and most multipliers of yield, until the mesh has grown enough.
        """
        if not adaptive or self.stress is None:
            return bisect(self.mesh, np.ones(len(self.mesh), dtype=bool))
        mesh, volume = self.problem.mesh, self.problem.mesh.volume
        corner = _weak_corners(self.stress)
        error = corner.sum(axis=1)
        if self.velocity is not None:
            moved = self._moved(self.velocity.velocity)
            power = stress_power(self.fine, self.stress, moved)
            error = error + np.maximum(self.velocity.dissipation - power.reshape(-1, 4).sum(axis=1), 0.0)
            corner = corner + self._joint_corners(self.stress, moved)
        error = error + _EVERYWHERE * error.sum() * volume / volume.sum()
        finer = replace(mesh, root=np.arange(len(mesh)))
        fits = True
        while fits and len(finer) < _GROWTH * len(mesh):
            # half of a tetrahedron keeps a quarter of its share: strips along hinges lose in proportion to their width
            left = error[finer.root] * (finer.volume / volume[finer.root]) ** 2
            away = finer.corners[:, :, None] - mesh.corners[finer.root][:, None]
            share = 1.0 + np.einsum("tcki,tki->tck", away, mesh.gradient[finer.root])
            weight = np.maximum(np.einsum("tck,tk->tc", share, corner[finer.root]), 0.0)
            weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
            marks = _marks(left)
            larger = bisect(finer, marks, weight)
            fits = len(larger) <= most
            while len(larger) > most and marks.any():
                marks &= left > np.median(left[marks])
                larger = bisect(finer, marks, weight)
            finer = larger
        units = self.problem.units
        return replace(finer, points=finer.points * units.length + units.origin, root=self.mesh.root[finer.root])

    def _moved(self, velocity: Floats) -> Floats:
        """Interpolate velocities (t, 4, 3) of tetrahedra to their quarters on `split`, (4t, 4, 3)."""
        rows = np.arange(4)
        parts = np.repeat(velocity[:, None], 4, axis=1)
        parts[:, rows, rows] = velocity.mean(axis=1)[:, None]
        return parts.reshape(-1, 4, 3)

    def _joint_corners(self, stress: StressField, velocity: Floats) -> Floats:
        """Compute the power (t, 4) that joint tractions lose at each corner of the tetrahedra.

        velocity: (4t, 4, 3) on `split`. The loss is minus the power of the tractions on the jump, where positive;
        scaled.
        """
        p, s = self.fine, self.fine.sides
        shares = np.zeros((len(self.mesh), 4))
        pull, jump = _across_sides(p, stress, velocity, p.dry)
        lost = np.maximum(-np.einsum("fi,fki->fk", pull.sum(axis=1), jump), 0.0) * (s.area[p.dry] / 24.0)[:, None]
        both = s.b[p.dry] >= 0
        np.add.at(shares, (s.a[p.dry][:, None] // 4, s.corner_a[p.dry]), lost)
        np.add.at(shares, (s.b[p.dry][both][:, None] // 4, s.corner_b[p.dry][both]), lost[both])
        return shares


def _marks(error: Floats) -> Bools:
    """Mark (t,) the tetrahedra of largest error that together hold a share of its sum.

    error: (t,). No more than `_MOST_MARKED` of all are marked.
    """
    order = np.argsort(-error, kind="stable")
    share = np.cumsum(error[order])
    enough = int(np.searchsorted(share, _SHARE * share[-1])) + 1
    marks = np.zeros(len(error), dtype=bool)
    marks[order[: min(enough, max(1, int(_MOST_MARKED * len(error))))]] = True
    return marks


def stress_power(problem: SpatialProblem, stress: StressField, velocity: Floats) -> Floats:
    """Return the power of a stress field on velocities in each tetrahedron, (t,), scaled.

    velocity: (t, 4, 3) at the corners. Each tetrahedron counts with half of its triangles. By virtual power the sum is
    λ times live work plus dead work. Dissipation less this power tells where the bounds differ.
    """
    p, s, v = problem, problem.sides, velocity
    slope = np.einsum("tki,tkj->tij", v, p.mesh.gradient)
    power = p.mesh.volume * np.einsum("tij,tij->t", tensors(stress.stress.mean(axis=1)), slope)
    rows = np.flatnonzero((s.b >= 0) | (p.face >= 0))
    pull, jump = _across_sides(p, stress, v, rows)
    ends = np.einsum("fki,fki->f", pull, jump) + np.einsum("fi,fi->f", pull.sum(axis=1), jump.sum(axis=1))
    total = s.area[rows] * ends / 12.0
    both = s.b[rows] >= 0
    np.add.at(power, s.a[rows], np.where(both, 0.5, 1.0) * total)
    np.add.at(power, s.b[rows[both]], 0.5 * total[both])
    return np.asarray(power)


def _weak_corners(stress: StressField) -> Floats:
    """Sum the multipliers of yield to the corners (t, 4) of the unsplit tetrahedra."""
    rate = np.maximum(stress.rate, 0.0).reshape(-1, 4, 4)
    middle = np.diagonal(rate, axis1=1, axis2=2)
    return np.asarray(rate.sum(axis=1) - middle + 0.25 * middle.sum(axis=1, keepdims=True))


def _across_sides(problem: SpatialProblem, stress: StressField, velocity: Floats, rows: Ints) -> tuple[Floats, Floats]:
    """Return tractions on tetrahedron a and velocity jumps at the corners of triangles.

    rows: (k,) triangles. velocity: (t, 4, 3), scaled. Both results are (k, 3, 3): triangle, corner, axis.
    """
    s = problem.sides
    jump = -velocity[s.a[rows][:, None], s.corner_a[rows]]
    both = s.b[rows] >= 0
    jump[both] += velocity[s.b[rows[both]][:, None], s.corner_b[rows[both]]]
    own = stress.stress[s.a[rows][:, None], s.corner_a[rows]]
    return np.einsum("fij,fkj->fki", normal_map(s.normal[rows]), own), jump


_MOST_TETRAHEDRA = 12_000  # tetrahedra at which refinement ends: programs of more take many minutes and gigabytes

_POWER = 1.7  # exponent of the number of tetrahedra in the time of both programs, to predict the time of the next mesh

_LEAST_GROWTH = 1.05  # growth of a mesh below which it is not worth its time

_PATIENCE = 8  # number of meshes after which refinement ends if a bound is still missing


@dataclass(frozen=True)
class SpatialStep:
    """Bounds on one mesh."""

    tetrahedra: int  # number of tetrahedra
    # lower, upper: bounds on λ from this mesh alone, infinite where none was found
    lower: float
    upper: float
    seconds: float  # wall-clock time since the start, s


@dataclass(frozen=True)
class SpatialStresses:
    """Certified stress field, linear in each tetrahedron."""

    mesh: SolidMesh  # tetrahedra, scene units
    stress: Floats  # (t, 4, 3, 3) stresses at the four corners of each tetrahedron, tension positive, scene units


@dataclass(frozen=True)
class SpatialVelocities:
    """Certified velocity field, linear in each tetrahedron; the live load does unit work."""

    mesh: SolidMesh  # tetrahedra, scene units
    # (t, 4, 3) velocities u at the four corners of each tetrahedron, scene units: b_λ·u = 1 for the live load b_λ of λ
    # = 1
    velocity: Floats
    # (t,) power in each tetrahedron with half of its triangles, a work as b_λ·u. Their sum less the work of the dead
    # load is λ.
    dissipation: Floats


@dataclass(frozen=True)
class SpatialBounds:
    """Two-sided bound on λ of spatial blocks that may fail in any way."""

    lower: float  # λ that a certified stress field carries, −inf where none was found
    upper: float  # λ that a certified velocity field allows, inf where none was found
    status: FieldStatus  # why the refinement ended
    tetrahedra: int  # number of tetrahedra of the last mesh
    seconds: float  # wall-clock time, s
    history: tuple[SpatialStep, ...]  # one entry for each mesh
    stresses: SpatialStresses | None  # field of the best lower bound
    velocities: SpatialVelocities | None  # field of the best upper bound

    @property
    def gap(self) -> float:
        """Width of the bracket over its larger end, inf where a bound is missing."""
        return relative_gap(self.lower, self.upper)


def spatial_bounds(
    assembly: Assembly,
    labels: Bits | None = None,
    *,
    gap: float = 0.15,
    seconds: float | None = None,
    patch: float | None = None,
    adaptive: bool = True,
    most_tetrahedra: int = _MOST_TETRAHEDRA,
) -> SpatialBounds:
    """Bound the load factor of spatial blocks that may fail in any way, from both sides.

    labels: (m,) True = dry joint; False = inside a block. By default those of the scene. Result: the best of both
    bounds over all meshes, each checked without a solver. An upper bound below 0 ends refinement. Raises InputError:
    planar scenes, load cases, a gap that is not above 0, and what `material_of` and `loaded_solids` refuse.
    """
    start = time.perf_counter()
    labels = _require(assembly, labels, gap, patch)
    run = _Refinement(start, gap, seconds, most_tetrahedra)
    mesh, loads = loaded_solids(assembly, patch, labels)
    setting = SpatialSetting.of(assembly, labels, loads)
    fields = run.solve(setting, fitted_joints(mesh, setting.problem, gap))
    layered = _layered(setting, fields, patch) if adaptive and not run.ended else None
    if layered is not None and run.allows(layered[1]):
        fields, setting = _narrower((fields, setting), (run.solve(*layered), layered[0]))
    while not run.ended:
        mesh = fields.finer(adaptive, run.most)
        if len(mesh) < _LEAST_GROWTH * len(fields.mesh) or not run.allows(mesh):
            break
        fields = run.solve(setting, mesh)
    return run.best


class _Refinement:
    """Best bounds of a sequence of meshes, and whether there is time and need for another one.

    start: time at which `seconds` begin, s by `time.perf_counter`. most: greatest number of tetrahedra.
    """

    def __init__(self, start: float, gap: float, seconds: float | None, most: int) -> None:
        self._start, self._gap, self._seconds, self._most = start, gap, seconds, most
        self._last = 0, 0.0
        self.best = SpatialBounds(-math.inf, math.inf, FieldStatus.OPEN, 0, 0.0, (), None, None)

    @property
    def ended(self) -> bool:
        """True if the gap is reached, `upper` is below 0, or a bound remains missing.

        A bound that is missing after `_PATIENCE` meshes is not waited for.
        """
        status = self.best.status
        lone = status is not FieldStatus.OPEN and len(self.best.history) >= _PATIENCE
        return status in (FieldStatus.CLOSED, FieldStatus.UNSTABLE) or lone

    @property
    def most(self) -> int:
        """Largest number of tetrahedra of a mesh that fits the limit and the time left.

        The time is extrapolated from the last mesh.
        """
        if self._seconds is None:
            return self._most
        count, took = self._last
        left = max(self._seconds - (time.perf_counter() - self._start), 0.0)
        return min(self._most, int(count * (left / took) ** (1.0 / _POWER)))

    def allows(self, mesh: SolidMesh) -> bool:
        """Return True if a mesh is small enough, and expected to be done in time."""
        return len(mesh) <= self.most

    def solve(self, setting: SpatialSetting, mesh: SolidMesh) -> SpatialFields:
        """Solve for both fields on a mesh, take their bounds over into `best`, and return them."""
        began = time.perf_counter()
        fields = SpatialFields.on(setting, mesh)
        now = time.perf_counter()
        self._last = len(mesh), now - began
        self.best = _improved(self.best, fields, now - self._start, self._gap)
        return fields


def _layered(
    setting: SpatialSetting, fields: SpatialFields, patch: float | None
) -> tuple[SpatialSetting, SolidMesh] | None:
    """Cut long or flat cells that deform into layers; return new setting and coarsest mesh."""
    cut = tuple(cell for cell in fields.deforming().tolist() if setting.uniform(cell, fields.mesh))
    try:
        mesh, loads = loaded_solids(setting.assembly, patch, setting.labels, cut)
    except InputError:
        # the scene itself was accepted before: only its layers do not fit, and the bounds hold without them
        return None
    if not cut or len(mesh) <= len(fields.mesh):
        return None
    return replace(setting, loads=loads), mesh


_Case = tuple[SpatialFields, SpatialSetting]  # fields on a mesh, and the setting of that mesh


def _narrower(one: _Case, other: _Case) -> _Case:
    """Return the case with the smaller relative gap of its bounds, the first of equal ones."""
    return min(one, other, key=lambda case: relative_gap(case[0].lower, case[0].upper))


def _improved(best: SpatialBounds, fields: SpatialFields, seconds: float, gap: float) -> SpatialBounds:
    """Return `best` with each bound that the fields improve, and a further step."""
    # Bounds are in scene units.
    units, lower, upper = fields.problem.units, fields.lower, fields.upper
    if fields.stress is not None and lower > best.lower:
        held = SpatialStresses(fields.split, units.stress * tensors(fields.stress.stress))
        best = replace(best, lower=lower, stresses=held)
    if fields.velocity is not None and upper < best.upper:
        velocity, power = units.velocity * fields.velocity.velocity, units.load * fields.velocity.dissipation
        moved = SpatialVelocities(fields.mesh, velocity, power)
        best = replace(best, upper=upper, velocities=moved)
    steps = (*best.history, SpatialStep(len(fields.mesh), lower, upper, seconds))
    best = replace(best, tetrahedra=len(fields.mesh), seconds=seconds, history=steps)
    return replace(best, status=status_of_bounds(best.lower, best.upper, gap))


def require_spatial_fields(assembly: Assembly) -> None:
    """Raise InputError if fields cannot bound λ of a spatial assembly, whatever its labels.

    Refused are members, inner strengths that are missing, zero or different, cells that are not convex, loads without
    room for their patch, and interfaces that no mesh fits.
    """
    material_of(assembly)
    for case in assembly.by_case:
        loaded_solids(case)


def _require(assembly: Assembly, labels: Bits | None, gap: float, patch: float | None) -> Bits:
    """Check the arguments of `spatial_bounds`, and return the labels (m,).

    Raises InputError for a planar assembly, and for all that `require_refinement` refuses.
    """
    if assembly.dimension != 3:
        raise InputError("cracks", "fields in tetrahedra are for spatial scenes", "`bounds_by_fields`")
    return require_refinement(assembly, labels, gap, patch)
