"""Sub-contacts of every face, the arrays of the time stepping, and the balance of energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar, cast

import numpy as np
import shapely

from jld_core import Assembly, Bits, Bools, Floats, InputError, Ints, ParameterError
from jld_core.geometry import area_of

# Control of a number of steps: push, share of the dead loads, λ, rate, damping scheme (0 local, 1 viscous, 2 combined)
# and damping. In a push live·velocity follows the rate and λ is its multiplier. Pairs hold first and last step, linear
# between. Damping is the share of the unbalanced force against the velocity; of viscous damping the drag over momentum,
# per step.
Drive = tuple[bool, tuple[float, float], tuple[float, float], tuple[float, float], int, float]

# Entries of `Motion.work`, energies since the first step, scene units: work of the dead loads and of the live loads at
# the reported λ; losses by damping (less what the constraint of a push supplies), friction, plastic flow and brittle
# breaking; what contacts of corners store or lose; and, no sum, the work of contacts in the half step of the velocities
DEAD, LIVE, DAMPING, FRICTION, FLOW, FRACTURE, CORNERS, HALF = range(8)


class Bench(NamedTuple):
    """Constant arrays of the time stepping: n elements, m faces, s sub-contacts, q freedoms."""

    # dead, live: (n, q) forces, then moments about the centroid, of the dead loads and of the live loads at λ = 1
    dead: Floats
    live: Floats
    inverse: Floats  # (n, 2) inverse of mass and inertia, scaled to a time step of one; 0 on supports
    radius: Floats  # (n,) length by which moments are divided to compare them with forces
    ends: Ints  # (m, 2) elements a and b
    # (m, 6) planar: normal n (x, y), then r × n and r × t for the arm r from a and from b to the centre of the face.
    # Spatial: normal, e1, e2, and the arms from a and from b.
    frame: Floats
    first: Ints  # (m + 1,) position of the first sub-contact of each face
    place: Floats  # (s, d) coordinates along the face, and area
    # (m, 8) law of each face: two springs, friction, dilation, three strengths, residual friction, in the order of
    # `Law`
    law: Floats
    brittle: Bools  # (m,) True for faces that lose a strength that is exceeded
    gaps: Bools  # (m,) True for joints whose gaps stay open
    dry: Bools  # (m,) True for dry faces


class Motion(NamedTuple):
    """Arrays of an assembly that every time step changes in place, in scene units."""

    # moved, velocity: (n, q) displacements and rotations of the elements, and their change per time step
    moved: Floats
    velocity: Floats
    # overlap, pressure: (s,) elastic overlap (length) and compressive stress of sub-contacts
    overlap: Floats
    pressure: Floats
    shear: Floats  # (s, d − 1) shear stress of sub-contacts
    broken: Bools  # (s,) True for broken sub-contacts
    before: Floats  # (n, q) unbalanced forces of the step before, for combined damping
    work: Floats  # (8,) energies since the first step, entries as `DEAD` and following


@dataclass(frozen=True)
class EnergyBalance:
    """Energies from the unloaded structure to a state, scene units, each computed on its own."""

    # dead, live: work of the dead loads, and of the live loads at the reported λ
    dead: float
    live: float
    damping: float  # energy lost by damping, less what the constraint of a push supplies against it
    friction: float  # energy lost by sliding and crushing of dry joints and cracks
    flow: float  # energy lost by plastic flow of inner faces
    fracture: float  # elastic energy released by brittle breaking
    corners: float  # energy that contacts of corners store or lose
    # kinetic, elastic: kinetic energy, and elastic energy of the sub-contacts
    kinetic: float
    elastic: float

    @property
    def residual(self) -> float:
        """Work of the loads that is neither stored nor lost; the error of the time steps."""
        return float(self.dead + self.live - sum(astuple(self)[2:]))

    @property
    def turnover(self) -> float:
        """Energy that changed hands: half the sum of all parts by size."""
        return float(0.5 * sum(abs(part) for part in (*astuple(self), self.residual)))

    @property
    def error(self) -> float:
        """Residual over `turnover`, at least 0; 0 without any load."""
        return abs(self.residual) / self.turnover if self.turnover > 0.0 else 0.0


try:
    import numba
except ImportError as error:  # Name the missing optional dependency.
    raise InputError("jld_experiment", "numba is not installed", "pip install 'jld[experiment]'") from error

F = TypeVar("F", bound=Callable[..., object])

# Name, time and size of all source files of the package, which identify the cached code
_SOURCES: Final = tuple(
    (path.name, path.stat().st_mtime, path.stat().st_size) for path in sorted(Path(__file__).parent.glob("*.py"))
)


def compiled(function: F) -> F:
    """Return a function of arrays and numbers that numba compiles at its first call."""
    # No fast-math, so that runs are bitwise equal. The cache on disk depends on all sources of the package: numba alone
    # checks the file of the function and would keep outdated code of others.
    # Wrappers for calls from C, and from Python where `march` and its likes alone call, were a quarter of the work.
    inner = {"Bench", "Plane", "Space"} & {*function.__annotations__.values()} and "march" not in function.__name__
    options = {"no_cfunc_wrapper": True, "no_cpython_wrapper": bool(inner)}
    dispatcher: Any = numba.njit(cache=True, error_model="numpy", **options)(function)
    dispatcher._cache._cache_file._source_stamp = _SOURCES
    return cast(F, dispatcher)


SCHEMES: Final = ("trapezoid", "simpson", "midpoint", "limit")


@dataclass(frozen=True)
class SubContacts:
    """The s sub-contacts of all m faces, one face after the other."""

    first: Ints  # (m + 1,) position of the first sub-contact of each face
    # (s, 2) coordinate along e1 and area (planar), or coordinates along e1 and e2 and area (spatial), scene units
    place: Floats
    face: Ints  # (s,) face of each sub-contact


def sub_contacts(assembly: Assembly, labels: Bits, scheme: str, segments: int) -> SubContacts:
    """Compute points and areas of sub-contacts by one of `SCHEMES`; InputError for too few segments."""
    if scheme not in SCHEMES:
        raise ParameterError("scheme", f"no scheme is named {scheme!r}", " or ".join(SCHEMES))
    if segments < 1 or (scheme == "midpoint" and segments < 2):
        raise ParameterError("segments", f"{segments} give a face no resistance to rotation", "a larger number")
    faces, rows, counts = assembly.interfaces, [], []
    for face in range(len(faces)):
        if assembly.dimension == 2:
            points = _line(scheme, segments, bool(labels[face]))
            part = np.column_stack([points[:, 0] * faces.l1[face], points[:, 1] * faces.area[face]])
        elif faces.rectangle[face]:
            points = _line(scheme, segments, bool(labels[face]))
            first, second = np.repeat(points, len(points), axis=0), np.tile(points, (len(points), 1))
            part = np.column_stack(
                [
                    first[:, 0] * faces.l1[face],
                    second[:, 0] * faces.l2[face],
                    first[:, 1] * second[:, 1] * faces.area[face],
                ]
            )
        else:
            part = _polygon(assembly, face, scheme, segments, bool(labels[face]))
        rows.append(part)
        counts.append(len(part))
    first_of = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return SubContacts(first_of, np.concatenate(rows), np.repeat(np.arange(len(faces)), counts))


def _line(scheme: str, segments: int, dry: bool) -> Floats:
    """Return (k, 2) positions on a line from −1/2 to 1/2 and weights that sum to one."""
    if scheme == "limit":
        # Two points: a dry joint rocks about its edges; at ±1/6 they carry an inner face's moment f t²/6 and force f t.
        end = 0.5 if dry else 1.0 / 6.0
        return np.array([[-end, 0.5], [end, 0.5]])
    ends = np.linspace(-0.5, 0.5, segments + 1)
    middles = 0.5 * (ends[:-1] + ends[1:])
    if scheme == "midpoint":
        return np.column_stack([middles, np.full(segments, 1.0 / segments)])
    tributary = np.full(segments + 1, 1.0 / segments)
    tributary[[0, -1]] *= 0.5
    if scheme == "trapezoid":
        return np.column_stack([ends, tributary])
    positions = np.concatenate([ends, middles])
    weights = np.concatenate([tributary / 3.0, np.full(segments, 2.0 / (3.0 * segments))])
    order = np.argsort(positions, kind="stable")
    return np.column_stack([positions[order], weights[order]])


def _polygon(assembly: Assembly, face: int, scheme: str, segments: int, dry: bool) -> Floats:
    """Return (k, 3) points about the centroid and areas for a polygon that is no rectangle."""
    faces = assembly.interfaces
    arm = faces.polygon[face] - faces.origin[face]
    corners = np.column_stack([arm @ faces.e1[face], arm @ faces.e2[face]])
    triangles, size = _triangles(corners), float(faces.area[face])
    side1, side2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    share = 0.5 * np.abs(side1[:, 0] * side2[:, 1] - side1[:, 1] * side2[:, 0])
    share = share * size / float(share.sum())
    if scheme == "limit":
        ends = triangles if np.any(triangles[:, 0]) else triangles[:, 1:]
        points, areas = _merge_nodes(ends.reshape(-1, 2), np.repeat(share / ends.shape[1], ends.shape[1]))
        points = points if dry else points / 3.0
    elif scheme == "midpoint":
        points = np.concatenate([_triangle_middles(a, b, c, segments) for a, b, c in triangles])
        areas = np.repeat(share / segments**2, segments**2)
    else:
        # Split each triangle into segments² equal ones; the nodes have tributary areas.
        points, areas = _split(triangles, share, segments, scheme == "simpson")
    return np.column_stack([points, _balance_areas(points, areas)])


def _triangles(corners: Floats) -> Floats:
    """Return triangles (t, 3, 2) of a polygon about 0: a fan from there if it sees all edges."""
    after = np.roll(corners, -1, axis=0)
    signed = corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]
    if np.all(signed > 0.0) or np.all(signed < 0.0):
        return np.stack([np.zeros_like(corners), corners, after], axis=1)
    # Bridges to holes are traversed in both directions and are not edges of the region.
    cut = shapely.get_parts(shapely.constrained_delaunay_triangles(area_of(shapely.Polygon(corners))))
    return np.array([shapely.get_coordinates(part)[:3] for part in cut])


def _triangle_middles(base: Floats, second: Floats, third: Floats, segments: int) -> Floats:
    """Return (segments², 2) centroids of the equal parts of a triangle with corners base, second, third (2,)."""
    side1, side2, points = second - base, third - base, []
    for i in range(segments):
        for j in range(segments - i):
            points.append(base + ((i + 1 / 3) * side1 + (j + 1 / 3) * side2) / segments)
            if i + j < segments - 1:
                points.append(base + ((i + 2 / 3) * side1 + (j + 2 / 3) * side2) / segments)
    return np.array(points)


def _split(triangles: Floats, share: Floats, segments: int, middles: bool) -> tuple[Floats, Floats]:
    """Return nodes and areas of triangles (t, 3, 2), each split into segments² equal ones."""
    # A third of each small area goes to each corner, or with `middles` to each midpoint of its sides. The midpoints
    # integrate quadratic functions exactly.
    points, areas = [], []
    for (base, first, second), area in zip(triangles, share.tolist(), strict=True):
        side1, side2 = first - base, second - base
        small = area / segments**2
        for i in range(segments):
            for j in range(segments - i):
                for up in (True, False):
                    if not up and i + j >= segments - 1:
                        continue
                    at = [(i, j), (i + 1, j), (i, j + 1)] if up else [(i + 1, j + 1), (i + 1, j), (i, j + 1)]
                    nodes = [base + (a * side1 + b * side2) / segments for a, b in at]
                    if middles:
                        nodes = [0.5 * (nodes[x] + nodes[(x + 1) % 3]) for x in range(3)]
                    points += nodes
                    areas += [small / 3.0] * 3
    return _merge_nodes(np.array(points), np.array(areas))


def _merge_nodes(points: Floats, areas: Floats) -> tuple[Floats, Floats]:
    """Merge nodes that coincide and add their areas."""
    size = float(np.abs(points).max())
    keys = np.round(points / size, 9)
    order = np.lexsort(keys.T[::-1])
    fresh = np.concatenate([[True], np.any(np.diff(keys[order], axis=0) != 0.0, axis=1)])
    group = np.cumsum(fresh) - 1
    return points[order][fresh], np.bincount(group, weights=areas[order]).astype(float)


def _balance_areas(points: Floats, areas: Floats) -> Floats:
    """Return areas with zero first moments about the centroid, changed as little as possible."""
    rows = np.vstack([np.ones(len(areas)), points.T])
    off = rows @ areas - np.array([areas.sum(), 0.0, 0.0])
    return np.asarray(areas - areas * (rows.T @ np.linalg.solve((rows * areas) @ rows.T, off)))


# row of `law` for one face: kn, ks, friction, dilation, strength (shear at p = 0), tension, crushing, residual
Law = tuple[float, float, float, float, float, float, float, float]


@compiled
def numbers_of(law: Floats, f: int) -> Law:
    """Return row f of the laws (m, 8) as a tuple of numbers, as `sub_contact` takes it."""
    return (law[f, 0], law[f, 1], law[f, 2], law[f, 3], law[f, 4], law[f, 5], law[f, 6], law[f, 7])


@compiled
def sub_contact(
    overlap: float, size: float, law: Law, brittle: bool, gaps: bool, broken: bool
) -> tuple[float, float, float, bool]:
    """Return overlap, compressive stress, shear stress and broken state after a trial step."""
    # A brittle sub-contact breaks if it exceeds its tension or shear strength. Afterwards it has residual friction
    # alone.
    kn, ks, mu, psi, strength, tension, crushing, residual = law
    p = kn * overlap
    if broken:
        mu, psi, strength, tension = residual, 0.0, 0.0, 0.0
    failing = p < -tension or size > strength + mu * p
    if failing or p > crushing:
        if failing and brittle and not broken:
            broken = True
            mu, psi, strength, tension = residual, 0.0, 0.0, 0.0
        overlap, p, size = contact_stress(overlap, size, kn, ks, mu, psi, strength, tension, crushing, gaps or broken)
    return overlap, p, size, broken


@compiled
def record_loss(
    work: Floats,
    law: Law,
    area: float,
    face: tuple[bool, bool, bool],
    start: tuple[float, float],
    trial: tuple[float, float],
    final: tuple[float, float],
) -> None:
    """Add the energy lost from an elastic trial to the final stress to `Motion.work`."""
    # The loss is the mean stress of the step times the plastic jump, which is (trial − final)/stiffness. Sliding with a
    # dilation equal to friction therefore loses nothing without strength. A gap that opens without tension loses
    # nothing. A brittle break loses the elastic energy at the beginning, plus the work of the step, less the elastic
    # energy at the end.
    dry, was, broken = face
    breaks = broken and not was
    lost = 0.5 * (start[1] + final[1]) * (trial[1] - final[1]) / law[1]
    if breaks or final[0] != 0.0:
        lost += 0.5 * (start[0] + final[0]) * (trial[0] - final[0]) / law[0]
    if breaks:
        work[FRACTURE] += area * lost
    elif dry or broken:
        work[FRICTION] += area * lost
    else:
        work[FLOW] += area * lost


@compiled
def contact_stress(
    overlap: float,
    size: float,
    kn: float,
    ks: float,
    friction: float,
    dilation: float,
    strength: float,
    tension: float,
    crushing: float,
    gaps: bool,
) -> tuple[float, float, float]:
    """Return overlap, compressive stress and size of shear from an elastic trial to the yield surface."""
    # The return is the closest point in the elastic energy where dilation equals friction. With compressive stress p
    # and shear stress q it maps p ↦ p + kn ψ γ and |q| ↦ |q| − ks γ, where γ = (|q| − c − μp) / (ks + μ ψ kn) is the
    # slip and c the strength. At the corner p = −σt (σt: tension) the shear stress is limited to |q| ≤ c − μσt.
    p = kn * overlap
    if p > crushing:
        p = crushing
        overlap = p / kn
    over = size - strength - friction * p
    if over > 0.0:
        gamma = over / (ks + friction * dilation * kn)
        raised = p + kn * dilation * gamma
        if raised >= -tension and ks * gamma <= size:
            return overlap + dilation * gamma, raised, size - ks * gamma
    if p >= -tension:
        return overlap, p, min(size, max(strength + friction * p, 0.0))
    if not gaps:
        overlap = -tension / kn
    return overlap, -tension, min(size, max(strength - friction * tension, 0.0))
