"""Two-sided bounds on λ of the blocks themselves, refined where the two fields disagree."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.loads import loaded_mesh
from jld_core.fields.lower import LowerBound, StressField
from jld_core.fields.material import material_of
from jld_core.fields.mesh import Mesh, refine, subdivide
from jld_core.fields.problem import Problem, problem_of, units_of
from jld_core.fields.requirements import require_labels, require_planar
from jld_core.fields.upper import UpperBound, VelocityField

_MOST_TRIANGLES = 20_000
"""Triangles at which refinement ends: programs of more take minutes."""

_SHARE = 0.5
"""Share of the indicator that marked triangles hold together (Dörfler marking)."""

_MOST_MARKED = 0.4
"""Largest share of triangles that one refinement marks."""

_EVERYWHERE = 0.2
"""Share of the area in the indicator, so that no triangle stays coarse for ever."""

_SINGULAR = 0.7
"""Share of the multipliers of a triangle at one corner above which that corner is taken as singular."""

_FAN = np.radians(20.0)
"""Angle below which a triangle at a singular corner is not split further about it."""

_LEAST_AREA = 1e-9
"""Smallest area of a triangle over that of all: smaller ones are not split again."""


class FieldStatus(StrEnum):
    """How a two-sided bound ended: gap reached, out of time or triangles, or without one of the bounds."""

    CLOSED = "closed"
    OPEN = "open"
    NO_LOWER = "no lower bound"
    NO_UPPER = "no upper bound"


@dataclass(frozen=True)
class FieldStep:
    """Bounds on one mesh.

    Attributes
    ----------
    triangles : int
        Number of triangles.
    lower, upper : float
        Bounds on λ from this mesh alone, infinite where none was found.
    seconds : float
        Processor time since the start, s.
    """

    triangles: int
    lower: float
    upper: float
    seconds: float


@dataclass(frozen=True)
class Stresses:
    """Certified stress field, linear in each triangle.

    Attributes
    ----------
    mesh : Mesh
        Triangles.
    stress : (t, 3, 3) float array
        Stresses (σx, σy, τxy) at the three corners of each triangle, scene units.
    """

    mesh: Mesh
    stress: Floats


@dataclass(frozen=True)
class Velocities:
    """Certified velocity field, linear in each triangle, for which the live load does one unit of work.

    Attributes
    ----------
    mesh : Mesh
        Triangles.
    velocity : (t, 3, 2) float array
        Velocities at the three corners of each triangle, scene units.
    dissipation : (t,) float array
        Dissipation in each triangle, scene units.
    """

    mesh: Mesh
    velocity: Floats
    dissipation: Floats


@dataclass(frozen=True)
class FieldBounds:
    """Two-sided bound on λ of blocks that may fail in any way.

    Attributes
    ----------
    lower : float
        λ that a certified stress field carries, −inf where none was found.
    upper : float
        λ that a certified velocity field allows, inf where none was found.
    status : FieldStatus
        Why the refinement ended.
    triangles : int
        Number of triangles of the last mesh.
    seconds : float
        Processor time, s.
    history : tuple of FieldStep
        One entry for each mesh.
    stresses : Stresses or None
        Field of the best lower bound.
    velocities : Velocities or None
        Field of the best upper bound.
    """

    lower: float
    upper: float
    status: FieldStatus
    triangles: int
    seconds: float
    history: tuple[FieldStep, ...]
    stresses: Stresses | None
    velocities: Velocities | None

    @property
    def gap(self) -> float:
        """Width of the bracket over its larger end, inf where a bound is missing."""
        if not (math.isfinite(self.lower) and math.isfinite(self.upper)):
            return math.inf
        return (self.upper - self.lower) / max(abs(self.upper), abs(self.lower), 1e-300)


def bounds_by_fields(
    assembly: Assembly,
    labels: Bits | None = None,
    *,
    gap: float = 0.05,
    seconds: float | None = None,
    patch: float | None = None,
    parts: int = 1,
    adaptive: bool = True,
    most_triangles: int = _MOST_TRIANGLES,
) -> FieldBounds:
    """Bound the load factor of blocks that may fail in any way, from both sides.

    Parameters
    ----------
    assembly : Assembly
        Planar assembly with one load case; blocks are made of its inner strengths.
    labels : (m,) bool array, optional
        True = dry joint; False = inside a block. By default those of the scene.
    gap : float
        Width of the bracket, relative, at which refinement ends; above 0.
    seconds : float, optional
        No mesh is begun that is not expected to be done by then; the first one always is.
    patch : float, optional
        Length of the patch that each live force on a free face is spread on; by default the whole face (docs/method.md
        (9.5)).
    parts : int
        Parts of each edge of the first mesh.
    adaptive : bool
        Refine where the fields disagree; otherwise everywhere.
    most_triangles : int
        Triangles that no mesh exceeds, save the first.

    Returns
    -------
    FieldBounds
        The best of both bounds over all meshes, each checked without a solver.

    Raises
    ------
    InputError
        Scenes in space, load cases, a gap that is not above 0, and what `material_of` and `loaded_mesh` refuse.
    """
    start = time.perf_counter()
    labels = _require(assembly, labels, gap, parts, patch)
    material = material_of(assembly)
    units = units_of(assembly, material)
    coarse, loads = loaded_mesh(assembly, patch)
    mesh = subdivide(coarse, parts)
    best = _Best()
    steps: list[FieldStep] = []
    while True:
        began = time.perf_counter()
        problem = problem_of(assembly, material, units, mesh, loads)
        stress, velocity = LowerBound(problem).bound(labels), UpperBound(problem).bound(labels)
        best.take(problem, mesh, stress, velocity)
        now = time.perf_counter()
        steps.append(_step(problem, stress, velocity, now - start))
        found = best.result(tuple(steps), gap)
        # without one of the bounds only uniform refinement can help, and only so far
        lone = found.status is not FieldStatus.OPEN and len(steps) >= 3
        if found.status is FieldStatus.CLOSED or lone:
            return found
        finer = _finer(mesh, problem, stress, velocity, adaptive)
        growth = (len(finer) / len(mesh)) ** 1.3
        late = seconds is not None and now - start + growth * (now - began) > seconds
        if late or len(finer) > most_triangles or len(finer) == len(mesh):
            return found
        mesh = finer


def _step(problem: Problem, stress: StressField | None, velocity: VelocityField | None, seconds: float) -> FieldStep:
    load = problem.units.load
    lower = -math.inf if stress is None else load * stress.factor
    upper = math.inf if velocity is None else load * velocity.factor
    return FieldStep(len(problem.mesh), lower, upper, seconds)


def _finer(
    mesh: Mesh, problem: Problem, stress: StressField | None, velocity: VelocityField | None, adaptive: bool
) -> Mesh:
    """The next mesh: refined where it matters, or everywhere."""
    if not adaptive:
        return refine(mesh, np.ones(len(mesh), dtype=bool))
    return refine(mesh, _marks(problem, stress, velocity), _singular_corners(problem, stress))


def _require(assembly: Assembly, labels: Bits | None, gap: float, parts: int, patch: float | None) -> Bits:
    """Return the labels; raise InputError for what cannot be bounded."""
    require_planar(assembly)
    if len(assembly.cases) > 1:
        raise InputError("loads.cases", "fields take one load case", "one of Assembly.by_case")
    if not gap > 0.0:
        raise InputError("gap", f"{gap:g} is never reached", "a number above 0")
    if patch is not None and not patch > 0.0:
        raise InputError("patch", f"{patch:g} is wrong", "a length above 0")
    if parts < 1:
        raise InputError("parts", f"{parts} is wrong", "a whole number of at least 1")
    return require_labels(assembly, labels)


class _Best:
    """The best bounds so far, in scene units."""

    def __init__(self) -> None:
        self.lower, self.upper = -math.inf, math.inf
        self.stresses: Stresses | None = None
        self.velocities: Velocities | None = None

    def take(self, problem: Problem, mesh: Mesh, stress: StressField | None, velocity: VelocityField | None) -> None:
        """Keep what is better than before."""
        units = problem.units
        if stress is not None and units.load * stress.factor > self.lower:
            m, d, s = np.moveaxis(stress.stress, -1, 0)
            self.lower = units.load * stress.factor
            self.stresses = Stresses(mesh, units.stress * np.stack([m + d, m - d, s], axis=-1))
        if velocity is not None and units.load * velocity.factor < self.upper:
            self.upper = units.load * velocity.factor
            self.velocities = Velocities(mesh, velocity.velocity, velocity.dissipation)

    def result(self, steps: tuple[FieldStep, ...], gap: float) -> FieldBounds:
        """Return the result after some meshes."""
        status = FieldStatus.OPEN
        if not math.isfinite(self.lower):
            status = FieldStatus.NO_LOWER
        elif not math.isfinite(self.upper):
            status = FieldStatus.NO_UPPER
        found = FieldBounds(
            self.lower,
            self.upper,
            status,
            steps[-1].triangles,
            steps[-1].seconds,
            steps,
            self.stresses,
            self.velocities,
        )
        if status is FieldStatus.OPEN and found.gap <= gap:
            return FieldBounds(**{**vars(found), "status": FieldStatus.CLOSED})
        return found


def _marks(problem: Problem, stress: StressField | None, velocity: VelocityField | None) -> Bools:
    """Triangles to split (t,): where the fields disagree, where the stress field is weak, and a little everywhere.

    By the disagreement alone the lower bound stalls: on the flagship [5.89, 6.49] instead of [6.15, 6.46] in 3 s.
    """
    count = len(problem.mesh)
    small = problem.mesh.area < _LEAST_AREA * problem.mesh.area.sum()
    if stress is None or velocity is None:
        return np.asarray(~small)
    parts = [np.maximum(disagreement(problem, stress, velocity), 0.0), np.maximum(stress.rate, 0.0).sum(axis=1)]
    error = _EVERYWHERE * problem.mesh.area / problem.mesh.area.sum()
    for part in parts:
        error = error + part / max(float(part.sum()), 1e-300)
    error[small] = 0.0
    order = np.argsort(-error, kind="stable")
    share = np.cumsum(error[order])
    enough = int(np.searchsorted(share, _SHARE * share[-1])) + 1
    marks = np.zeros(count, dtype=bool)
    marks[order[: min(enough, max(1, int(_MOST_MARKED * count)))]] = True
    return marks


def _singular_corners(problem: Problem, stress: StressField | None) -> Ints:
    """Corner (t,) that a triangle should be split at, where most of its multipliers stand there; −1 elsewhere.

    Stresses jump at ends of loads and at corners of blocks; only a fan of triangles about such a node can follow.
    """
    none = np.full(len(problem.mesh), -1, dtype=np.int64)
    if stress is None:
        return none
    corners = problem.mesh.corners
    one, two = np.roll(corners, -1, axis=1) - corners, np.roll(corners, -2, axis=1) - corners
    cross = one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
    angle = np.arctan2(cross, (one * two).sum(axis=2))
    rate = np.maximum(stress.rate, 0.0)
    top = rate.argmax(axis=1)
    every = np.arange(len(top))
    singular = (rate[every, top] > _SINGULAR * rate.sum(axis=1)) & (angle[every, top] > _FAN)
    return np.where(singular, top, none)


def disagreement(problem: Problem, stress: StressField, velocity: VelocityField) -> Floats:
    """Return dissipation less stress power (t,), each triangle with half of its edges; the sum is upper less lower.

    Both fields are scaled; the sum is that of the scaled bounds, up to the opening of edges.
    """
    p, e = problem, problem.edges
    v = velocity.velocity
    slope = np.einsum("tki,tkj->tij", v, p.mesh.gradient)
    mean = stress.stress.mean(axis=1)
    power = mean[:, 0] * (slope[:, 0, 0] + slope[:, 1, 1]) + mean[:, 1] * (slope[:, 0, 0] - slope[:, 1, 1])
    power = p.mesh.area * (power + mean[:, 2] * (slope[:, 0, 1] + slope[:, 1, 0]))
    rows = np.flatnonzero((e.b >= 0) | (p.face >= 0))
    jump = -v[e.a[rows][:, None], e.corner_a[rows]]
    both = e.b[rows] >= 0
    jump[both] += v[e.b[rows[both]][:, None], e.corner_b[rows[both]]]
    own = stress.stress[e.a[rows][:, None], e.corner_a[rows]]
    nx, ny = e.normal[rows, 0][:, None], e.normal[rows, 1][:, None]
    m, d, s = own[..., 0], own[..., 1], own[..., 2]
    pull = np.stack([(m + d) * nx + s * ny, s * nx + (m - d) * ny], axis=-1)
    ends = (2.0 * (pull * jump).sum(axis=2) + (pull * jump[:, ::-1]).sum(axis=2)) / 6.0
    total = e.length[rows] * ends.sum(axis=1)
    np.add.at(power, e.a[rows], np.where(both, 0.5, 1.0) * total)
    np.add.at(power, e.b[rows[both]], 0.5 * total[both])
    return np.asarray(velocity.dissipation - power)
