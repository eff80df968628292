"""Bounds on λ of blocks that crack anywhere, refined where the two fields disagree."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.adaptive import Fields, FieldSetting
from jld_core.fields.mesh import Mesh, subdivide
from jld_core.fields.requirements import require_planar, require_refinement

_MOST_TRIANGLES = 20_000  # triangles at which refinement ends: programs of more take minutes

_GROWTH = 1.3  # exponent of the number of triangles in the time of a mesh, to predict the time of the next one

# Number of meshes after which refinement ends if a bound is still missing. The dead load needs fine meshes at few
# places.
_PATIENCE = 8


# Meshes from one upper bound to the next where the lower bound comes first. An upper bound takes three to five times as
# long as a lower one on the same mesh.
_UPPER_EACH = 3


class FieldStatus(StrEnum):
    """How the computation of a two-sided bound by fields ended.

    CLOSED: the requested gap is reached. UNSTABLE: the upper bound is below 0, so the blocks collapse for every λ ≥ 0.
    OPEN: both bounds exist, with a wider gap. NO_LOWER, NO_UPPER: that bound was not found.
    """

    CLOSED = "closed"
    UNSTABLE = "unstable"
    OPEN = "open"
    NO_LOWER = "no lower bound"
    NO_UPPER = "no upper bound"


def relative_gap(lower: float, upper: float) -> float:
    """Return (upper − lower) / max(|upper|, |lower|), inf where a bound is infinite."""
    if not (math.isfinite(lower) and math.isfinite(upper)):
        return math.inf
    return (upper - lower) / max(abs(upper), abs(lower), 1e-300)


def status_of_bounds(lower: float, upper: float, gap: float) -> FieldStatus:
    """Classify two bounds on λ by the relative gap that was requested; see `FieldStatus`.

    lower, upper: −inf and inf where none was found. gap: greatest `relative_gap` that counts as closed.
    """
    if upper < 0.0:
        return FieldStatus.UNSTABLE
    if not math.isfinite(lower):
        return FieldStatus.NO_LOWER
    if not math.isfinite(upper):
        return FieldStatus.NO_UPPER
    return FieldStatus.CLOSED if relative_gap(lower, upper) <= gap else FieldStatus.OPEN


@dataclass(frozen=True)
class FieldStep:
    """Bounds on one mesh.

    triangles: number of triangles. lower, upper: bounds on λ from this mesh alone, infinite where none was found.
    seconds: time since the start, s.
    """

    triangles: int
    lower: float
    upper: float
    seconds: float


@dataclass(frozen=True)
class Stresses:
    """Certified stress field, linear in each triangle.

    mesh: triangles. stress: (t, 3, 3) stresses (σx, σy, τxy) at the three corners of each triangle, scene units.
    """

    mesh: Mesh
    stress: Floats


@dataclass(frozen=True)
class Velocities:
    """Certified velocity field, linear in each triangle; the live load does unit work on it.

    mesh: triangles, scene units. velocity: (t, 3, 2) velocities u at the three corners of each triangle, scene units:
    b_λ·u = 1 for the live load b_λ of λ = 1. dissipation: (t,) power in each triangle with half of its edges, a work as
    b_λ·u. Their sum less the work of the dead load is λ.
    """

    mesh: Mesh
    velocity: Floats
    dissipation: Floats


@dataclass(frozen=True)
class FieldBounds:
    """Two-sided bound on λ of blocks that may fail in any way.

    lower: λ that a certified stress field carries, −inf where none was found. upper: λ that a certified velocity field
    allows, inf where none was found. status: why the refinement ended. triangles: number of triangles of the last mesh.
    seconds: time, s. history: one entry for each mesh. stresses: field of the best lower bound. velocities: field of
    the best upper bound.
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
        return relative_gap(self.lower, self.upper)


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
        True = dry joint; False = inside a block. By default the labels of the scene.
    gap : float
        Width of the bracket, relative, at which refinement ends; above 0.
    seconds : float, optional
        No mesh is begun that is not expected to be done by then; the first one always is. By default no limit, s.
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
        The best of both bounds over all meshes, each checked without a solver. An upper bound below 0 ends refinement.

    Raises
    ------
    InputError
        Scenes in space, several load cases, a gap that is not above 0, and scenes that `material_of` or `loaded_mesh`
        refuses.
    """
    refinement = FieldRefinement(
        assembly, labels, gap=gap, patch=patch, parts=parts, adaptive=adaptive, most_triangles=most_triangles
    )
    found = refinement.step()
    while not refinement.ended and (seconds is None or refinement.expected <= seconds):
        found = refinement.step()
    return found


class FieldRefinement:
    """Refinement of the bounds of one labelling, mesh by mesh.

    Call `step` until `ended`. Each step solves one mesh and returns the best of both bounds so far. Use it instead of
    `bounds_by_fields` where the caller decides after each mesh whether to go on.

    lower_first: True raises the lower bound two to three times as fast: each mesh marks more triangles, and only every
    third mesh has an upper bound. Raises InputError as `bounds_by_fields`.
    """

    def __init__(
        self,
        assembly: Assembly,
        labels: Bits | None = None,
        *,
        gap: float = 0.05,
        patch: float | None = None,
        parts: int = 1,
        adaptive: bool = True,
        most_triangles: int = _MOST_TRIANGLES,
        lower_first: bool = False,
    ) -> None:
        self._spent, start = 0.0, time.perf_counter()
        self._labels = _require(assembly, labels, gap, parts, patch)
        self._gap, self._adaptive, self._most = gap, adaptive, most_triangles
        self._setting = FieldSetting.of(assembly, patch)
        self._mesh: Mesh | None = subdivide(self._setting.coarse, parts)
        self._best, self._steps, self._lower_first = _Best(), list[FieldStep](), lower_first
        self._times: dict[bool, tuple[int, float]] = {}
        self._spent += time.perf_counter() - start

    @property
    def ended(self) -> bool:
        """True if `step` has nothing left to solve.

        Any of these ends refinement: the gap is reached, the upper bound is below 0, a bound is missing after eight
        meshes, the next mesh would exceed `most_triangles`.
        """
        return self._mesh is None

    @property
    def spent(self) -> float:
        """Time spent in the constructor and all steps so far, seconds."""
        return self._spent

    @property
    def upper_due(self) -> bool:
        """True if the next step computes an upper bound unless told otherwise."""
        return not self._lower_first or len(self._steps) % _UPPER_EACH == 0

    @property
    def expected(self) -> float:
        """Expected value of `spent` after one more step, seconds, extrapolated from earlier steps."""
        return self.expected_with(self.upper_due)

    def expected_with(self, upper: bool) -> float:
        """Return the expected value of `spent`, s, after a step with or without an upper bound."""
        known = self._times.get(upper) or self._times.get(True)
        if known is None:
            return self._spent
        triangles, seconds = known
        return float(self._spent + seconds * (self.triangles / triangles) ** _GROWTH)

    @property
    def triangles(self) -> int:
        """Number of triangles of the next mesh, 0 if refinement has ended."""
        return 0 if self._mesh is None else len(self._mesh)

    def step(self, upper: bool | None = None) -> FieldBounds:
        """Solve the next mesh.

        upper: whether an upper bound is computed as well; by default `upper_due`. Result: the best of both bounds over
        all meshes so far. Raises ValueError: refinement has ended.
        """
        if self._mesh is None:
            raise ValueError("refinement has ended; expected a step before")
        began, mesh = time.perf_counter(), self._mesh
        both = self.upper_due if upper is None else upper
        fields = Fields.on(self._setting, mesh, self._labels, velocities=both)
        self._best.take(fields)
        last = time.perf_counter() - began
        self._times[both] = len(mesh), last
        self._steps.append(FieldStep(len(mesh), *fields.bounds, self._spent + last))
        found = self._best.result(tuple(self._steps), self._gap)
        # without one of the bounds refinement helps only so far
        lone = found.status is not FieldStatus.OPEN and len(self._steps) >= _PATIENCE
        if found.status in (FieldStatus.CLOSED, FieldStatus.UNSTABLE) or lone:
            self._mesh = None
        else:
            finer = fields.finer(self._adaptive, steps=not self._lower_first)
            self._mesh = None if len(finer) > self._most or len(finer) == len(mesh) else finer
        self._spent += time.perf_counter() - began
        return found


def _require(assembly: Assembly, labels: Bits | None, gap: float, parts: int, patch: float | None) -> Bits:
    """Check the arguments of `bounds_by_fields`, and return the labels (m,).

    Raises InputError for a spatial assembly, `parts` below 1, and all that `require_refinement` refuses.
    """
    require_planar(assembly)
    known = require_refinement(assembly, labels, gap, patch)
    if parts < 1:
        raise InputError("parts", f"{parts} is wrong", "a whole number of at least 1")
    return known


class _Best:
    """The best bounds so far, in scene units."""

    def __init__(self) -> None:
        self.lower, self.upper = -math.inf, math.inf
        self.stresses: Stresses | None = None
        self.velocities: Velocities | None = None

    def take(self, fields: Fields) -> None:
        """Replace each stored bound, with its field, by that of a mesh if it is better."""
        units, mesh, (lower, upper) = fields.problem.units, fields.mesh, fields.bounds
        if fields.stress is not None and lower > self.lower:
            m, d, s = np.moveaxis(fields.stress.stress, -1, 0)
            self.lower = lower
            self.stresses = Stresses(mesh, units.stress * np.stack([m + d, m - d, s], axis=-1))
        if fields.velocity is not None and upper < self.upper:
            self.upper = upper
            power = units.load * fields.velocity.dissipation
            self.velocities = Velocities(mesh, units.velocity * fields.velocity.velocity, power)

    def result(self, steps: tuple[FieldStep, ...], gap: float) -> FieldBounds:
        """Return the result after some meshes."""
        return FieldBounds(
            self.lower,
            self.upper,
            status_of_bounds(self.lower, self.upper, gap),
            steps[-1].triangles,
            steps[-1].seconds,
            steps,
            self.stresses,
            self.velocities,
        )
