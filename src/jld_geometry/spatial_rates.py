"""Derivatives by vertices of lengths, areas, forces and loads, and of λ in space, docs/method.md (11.5)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core import Assembly, Elements, Floats, Ints, LimitAnalysisResult, Loads, Route
from jld_core.geometry import area_vector, outlines, spun
from jld_core.solvers import highs_of
from jld_geometry.convex_cells import VertexMesh
from jld_geometry.moved_scene import spatial_mesh


def length_rates(mesh: VertexMesh) -> sp.csr_array:
    """Return the derivatives (m, 2v) of the lengths of interfaces by the vertices."""
    edge = mesh.places[mesh.ends[:, 1]] - mesh.places[mesh.ends[:, 0]]
    along = edge / np.linalg.norm(edge, axis=1)[:, None]
    values = np.concatenate([-along, along], axis=1)
    rows = np.repeat(np.arange(len(edge)), 4)
    return sp.csr_array((values.ravel(), (rows, _columns(mesh.ends).ravel())), shape=(len(edge), mesh.places.size))


@dataclass(frozen=True)
class AreaRates:
    """Areas and centroids of elements, and their derivatives by the vertices."""

    area: Floats  # (n,) areas
    by_area: sp.csr_array  # (n, 2v) derivatives of the areas
    by_centroid: sp.csr_array  # (2n, 2v) derivatives of the centroids, x and y of each element in turn


def area_rates(mesh: VertexMesh) -> AreaRates:
    """Compute areas, and derivatives of areas and centroids by corners."""
    areas, rows, columns, areal, central = np.empty(len(mesh.loops)), [], [], [], []
    for chosen, loops in _by_length(mesh.loops):
        corner = mesh.places[loops] - mesh.places[loops[:, :1]]
        after, before = np.roll(corner, -1, axis=1), np.roll(corner, 1, axis=1)
        turn = corner[..., 0] * after[..., 1] - corner[..., 1] * after[..., 0]
        area = 0.5 * turn.sum(axis=1)
        centre = ((corner + after) * turn[..., None]).sum(axis=1) / (6.0 * area[:, None])
        by_area = 0.5 * np.stack([after[..., 1] - before[..., 1], before[..., 0] - after[..., 0]], axis=-1)
        moment = np.einsum("ni,jk->nijk", np.roll(turn, 1, axis=1) + turn, np.eye(2))
        moment += np.einsum("nij,nik->nijk", before + corner, np.stack([-before[..., 1], before[..., 0]], axis=-1))
        moment += np.einsum("nij,nik->nijk", corner + after, np.stack([after[..., 1], -after[..., 0]], axis=-1))
        by_centre = (moment / 6.0 - np.einsum("nj,nik->nijk", centre, by_area)) / area[:, None, None, None]
        areas[chosen] = area
        rows.append(np.repeat(chosen, 2 * loops.shape[1]))
        columns.append((2 * loops[:, :, None] + np.arange(2)).ravel())
        areal.append(by_area.ravel())
        central.append(by_centre.transpose(2, 0, 1, 3).reshape(2, -1))
    row, column = np.concatenate(rows), np.concatenate(columns)
    size = mesh.places.size
    by_areas = sp.csr_array((np.concatenate(areal), (row, column)), shape=(len(areas), size))
    values = np.concatenate(central, axis=1)
    entries = (values.ravel(), (np.concatenate([2 * row, 2 * row + 1]), np.tile(column, 2)))
    return AreaRates(areas, by_areas, sp.csr_array(entries, shape=(2 * len(areas), size)))


def _by_length(loops: tuple[Ints, ...]) -> Iterator[tuple[Ints, Ints]]:
    """Yield the indices (k,) and vertices (k, c) of all loops with c vertices, for each c."""
    lengths = np.array([len(loop) for loop in loops])
    for length in np.unique(lengths).tolist():
        chosen = np.flatnonzero(lengths == length)
        yield chosen, np.array([loops[k] for k in chosen])


def residual_rates(assembly: Assembly, mesh: VertexMesh, forces: Floats, load_factor: float) -> sp.csr_array:
    """Return the derivatives (3·free, 2v) of the equilibrium residual, (11.1), (11.2), by the vertices."""
    # N, V and M / (l/2) are held; moments are about the present centroids
    entries = face_rates(assembly, mesh, forces)
    shape = (3 * len(assembly.elements.free), mesh.places.size)
    return sp.csr_array(
        sp.csr_array((entries.value, (entries.row, entries.column)), shape=shape)
        + load_rates(assembly, mesh, load_factor)
    )


@dataclass(frozen=True)
class FaceRates:
    """Derivatives of the forces of interfaces on free elements, as k entries of a matrix."""

    # row, column, face: (k,) equilibrium row 3·(number of the free element) + freedom, coordinate 2·vertex + axis, and
    # interface
    row: Ints
    column: Ints
    face: Ints
    value: Floats  # (k,) derivatives, scene units


def face_rates(assembly: Assembly, mesh: VertexMesh, forces: Floats) -> FaceRates:
    """Compute the derivatives by vertices of what N, V and M (m, 3) of planar interfaces exert on free elements."""
    # A face from p to q with e = q − p of length l, t = e/l and n = (t_y, −t_x) exerts F = N n + V t at (p + q)/2 and
    # M on b, and the opposite on a. dt = n (n·de)/l, dn = −t (n·de)/l, and dM = M (t·de)/l, as M/l is held.
    # Moments are taken about the present centroids, which are held constant.
    faces, elements = assembly.interfaces, assembly.elements
    start, end = mesh.places[mesh.ends[:, 0]], mesh.places[mesh.ends[:, 1]]
    edge = end - start
    length = np.linalg.norm(edge, axis=1)[:, None]
    along = edge / length
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    push, shear, moment = forces[:, :1], forces[:, 1:2], forces[:, 2:]
    force = push * normal + shear * along
    force_by_edge = np.einsum("fi,fj->fij", (shear * normal - push * along) / length, normal)
    row_of = np.full(len(elements), -1, dtype=np.int64)
    row_of[elements.free] = np.arange(len(elements.free))
    columns = _columns(mesh.ends)
    rows, cols, owners, values = [], [], [], []
    for element, sign in ((faces.a, -1.0), (faces.b, 1.0)):
        free = np.flatnonzero(row_of[element] >= 0)
        arm = 0.5 * (start + end)[free] - elements.centroid[element[free]]
        lever, own_moment = np.column_stack([-arm[:, 1], arm[:, 0]]), (moment / length * along)[free]
        moment_by_edge = np.einsum("fi,fij->fj", lever, force_by_edge[free]) + own_moment
        moment_by_place = 0.5 * np.column_stack([force[free, 1], -force[free, 0]])  # by p and by q, F and e held
        block = np.empty((len(free), 3, 4))
        block[:, :2, :2], block[:, :2, 2:] = -force_by_edge[free], force_by_edge[free]
        block[:, 2, :2], block[:, 2, 2:] = moment_by_place - moment_by_edge, moment_by_place + moment_by_edge
        first = 3 * row_of[element[free]][:, None, None] + np.arange(3)[:, None]
        rows.append(np.broadcast_to(first, block.shape).ravel())
        cols.append(np.broadcast_to(columns[free][:, None, :], block.shape).ravel())
        owners.append(np.broadcast_to(free[:, None, None], block.shape).ravel())
        values.append((sign * block).ravel())
    return FaceRates(*(np.concatenate(part) for part in (rows, cols, owners, values)))


def load_rates(assembly: Assembly, mesh: VertexMesh, load_factor: float) -> sp.csr_array:
    """Return the derivatives (3·free, 2v) of the loads on free elements by the vertices."""
    # Rows are force x, force y and moment about the present centroid of each free element; column 2·vertex + axis.
    # Scene units.
    loads = assembly.dead_loads + load_factor * assembly.live_loads
    by_volume, by_centroid = shape_loads(loads, assembly.elements)
    rates, free = area_rates(mesh), assembly.elements.free
    parts = []
    for axis in range(2):
        parts.append(sp.diags_array(by_volume[:, axis] / rates.area) @ rates.by_area)
    x, y = rates.by_centroid[0::2], rates.by_centroid[1::2]
    parts.append(sp.diags_array(by_centroid[:, 1]) @ x - sp.diags_array(by_centroid[:, 0]) @ y)
    stacked = sp.csr_array(sp.vstack(parts))
    count = len(by_volume)
    order = (free[:, None] + count * np.arange(3)).ravel()
    return sp.csr_array(stacked[order])


def shape_loads(loads: Loads, elements: Elements) -> tuple[Floats, Floats]:
    """Return the forces (n, d) that grow with volumes of elements, and those that move with centroids."""
    return (
        np.where((elements.support | elements.fixed_weight)[:, None], 0.0, loads.body),
        np.where((elements.support | elements.fixed_centroid)[:, None], 0.0, loads.at_centroids),
    )


def _columns(ends: Ints) -> Ints:
    """Return the columns (m, 4) of the coordinates of both ends (m, 2)."""
    return np.concatenate([2 * ends[:, :1] + np.arange(2), 2 * ends[:, 1:] + np.arange(2)], axis=1)


_ROUTE: Final = Route("rates by the vertices of solids")

# Step of central differences of explicit functions of a polygon, relative to its size; their error is its square
_STEP: Final = 1e-5

# Share of the force of a face by which corner forces may miss its resultants before they are corrected
_ROUNDED: Final = 1e-9


def spatial_rates(result: LimitAnalysisResult, forces: Floats, mechanism: Floats) -> tuple[Floats, Floats] | None:
    """Return vertices (v, 3) and derivatives (v, 3) of λ; None for inner faces, crushing or criteria stated as rows."""
    assembly = result.assembly
    if not result.labels.all() or assembly.face_strengths.criteria:
        return None
    if np.isfinite(assembly.strengths(_ROUTE).side(dry=True).crush).any():
        return None
    mesh = spatial_mesh(assembly)
    rates = np.zeros_like(mesh.places)
    for element in assembly.elements.free.tolist():
        of_element = _element_rates(assembly, element, mechanism[element], result.load_factor)
        np.add.at(rates, mesh.corners[element], of_element)
    for face, polygon in enumerate(mesh.polygons):
        np.add.at(rates, polygon, _face_rates(assembly, face, forces[face], mechanism))
    return mesh.places, rates


def _element_rates(assembly: Assembly, element: int, motion: Floats, load_factor: float) -> Floats:
    """Return minus the derivatives (k, 3) of an element's load power; motion: (6,)."""
    loads = assembly.dead_loads + load_factor * assembly.live_loads
    body_load, centroid_load = (load[element] for load in shape_loads(loads, assembly.elements))
    volume, by_volume, by_moment = volume_rates(assembly, element)
    # Moments are about the centroid, so that the first moment of the whole vanishes. For a shift s of the centroid,
    # (s × F)·ω = s·(F × ω).
    turning = np.cross(centroid_load, motion[3:])
    power = float(body_load @ motion[:3]) * by_volume + np.einsum("j,ijk->ik", turning, by_moment)
    return np.asarray(-power / volume)


def volume_rates(assembly: Assembly, element: int) -> tuple[float, Floats, Floats]:
    """Return the volume of an element, and the rates of volume and first moment by corners."""
    # The rates are (k, 3) and (k, 3, 3). The first moment is about the present centroid. Its rate [corner, i, j] is
    # that of component i by coordinate j.
    corner = assembly.elements.shape[element] - assembly.elements.centroid[element]
    by_volume, by_moment = np.zeros_like(corner), np.zeros((len(corner), 3, 3))
    rings = assembly.elements.faces[element]
    triangles = np.array([(ring[0], *pair) for ring in rings for pair in itertools.pairwise(ring[1:])])
    x, y, z = np.moveaxis(corner[triangles], 1, 0)
    slopes = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1) / 6.0
    parts = (x * slopes[:, 0]).sum(axis=1)
    np.add.at(by_volume, triangles, slopes)
    middle = np.einsum("tj,tik->tijk", (x + y + z) / 4.0, slopes)
    np.add.at(by_moment, triangles, middle + parts[:, None, None, None] / 4.0 * np.eye(3))
    return float(parts.sum()), by_volume, by_moment


@dataclass(frozen=True)
class HeldForces:
    """Forces of one face, held while its polygon changes."""

    corner: Floats  # (k,) normal forces at the corners
    shear: Floats  # (3,) force in the plane
    normal: Floats  # (3,) present normal
    twist: float  # torque over the torsion length

    def wrenches(self, polygons: Floats) -> Floats:
        """Return force and moment about the origin (p, 6) on the second element, by corners (p, k, 3)."""
        vector = area_vector(polygons)
        vector = np.where((vector @ self.normal > 0.0)[:, None], vector, -vector)
        normal = vector / np.linalg.norm(vector, axis=1)[:, None]
        # two axes (p, 2, 3) of the planes of normals (p, 3); they change smoothly, and turn left about them
        axis = np.eye(3)[int(np.argmin(abs(self.normal)))]
        first = axis - (normal @ axis)[:, None] * normal
        first = first / np.linalg.norm(first, axis=1)[:, None]
        frame = np.stack([first, np.cross(normal, first)], axis=1)
        arm = polygons - polygons[:, :1]
        flat = np.einsum("pkd,pad->pka", arm, frame)
        middle = polygons[:, 0] + np.einsum("pa,pad->pd", outlines.centroid(flat), frame)
        middle += np.einsum("pkd,pd->pk", arm, normal).mean(axis=1)[:, None] * normal
        shear = self.shear - ((normal - self.normal) @ self.shear)[:, None] * self.normal
        moment = np.cross(np.einsum("k,pkd->pd", self.corner, polygons), normal) + np.cross(middle, shear)
        if self.twist:
            moment += self.twist * outlines.torsion_length(flat)[:, None] * normal
        return np.concatenate([float(self.corner.sum()) * normal + shear, moment], axis=1)

    def rates(self, polygon: Floats) -> Floats:
        """Return the derivatives (k, 3, 6) of `wrenches` by the corners of a polygon (k, 3)."""
        step = _STEP * float(np.ptp(polygon, axis=0).max())
        steps = step * np.eye(polygon.size).reshape(-1, *polygon.shape)
        more, less = self.wrenches(np.concatenate([polygon + steps, polygon - steps])).reshape(2, -1, 6)
        return np.asarray((more - less).reshape(*polygon.shape, 6) / (2.0 * step))


def face_motion(assembly: Assembly, face: int, mechanism: Floats) -> tuple[Floats, Floats]:
    """Return relative velocity (3,) at a face's origin and spin (3,), of the second element to the first."""
    faces = assembly.interfaces
    velocity, spin = np.zeros(3), np.zeros(3)
    for element, sign in ((int(faces.a[face]), -1.0), (int(faces.b[face]), 1.0)):
        motion = mechanism[element]
        velocity += sign * (motion[:3] + spun(motion[3:], faces.origin[face] - assembly.elements.centroid[element]))
        spin += sign * motion[3:]
    return velocity, spin


def held_forces(assembly: Assembly, face: int, polygon: Floats, forces: Floats, gaps: Floats) -> HeldForces:
    """Convert resultants (6,) of a face to corner forces of least power on gaps (k,), shear and twist."""
    faces = assembly.interfaces
    axes = np.array([faces.e1[face], faces.e2[face]])
    corner = corner_forces(polygon @ axes.T, forces, gaps)
    shear = forces[1] * axes[0] + forces[2] * axes[1]
    return HeldForces(corner, shear, faces.normal[face], float(forces[5] / faces.c_t[face]))


def _face_rates(assembly: Assembly, face: int, forces: Floats, mechanism: Floats) -> Floats:
    """Return the derivatives (k, 3) of a face's dissipation minus power by its k corners."""
    faces = assembly.interfaces
    velocity, spin = face_motion(assembly, face, mechanism)
    # coordinates about the centroid keep all digits far from the origin
    polygon = faces.polygon[face] - faces.origin[face]
    if not velocity.any() and not spin.any():
        return np.zeros_like(polygon)
    normal, axes = faces.normal[face], np.array([faces.e1[face], faces.e2[face]])
    corner_forces = held_forces(assembly, face, polygon, forces, (velocity + spun(spin, polygon)) @ normal)
    rates = -corner_forces.rates(polygon) @ np.concatenate([velocity, spin])
    slip = max(float(np.linalg.norm(axes @ velocity)), float(faces.c_t[face] * abs(normal @ spin)))
    stuck = float(assembly.strengths(_ROUTE).side(dry=True).shear[face]) * slip
    # dA/dx_i = ½ (x_{i+1} − x_{i−1}) × n, with the polygon counter-clockwise about n
    sign = np.sign(area_vector(polygon) @ normal)
    after = np.roll(polygon, -1, axis=0) - np.roll(polygon, 1, axis=0)
    return np.asarray(rates + 0.5 * stuck * sign * np.cross(after, normal))


_RESIDUAL: Final = 1e-10  # residual asked of the solver of corner forces


def corner_forces(corner: Floats, forces: Floats, gaps: Floats) -> Floats:
    """Return normal forces (k,) at corners (k, 2) of given N, M1, M2, of least power on gaps (k,)."""
    # Of all such forces they have the least power on the gaps.
    size = float(abs(corner).max())
    rows = np.vstack([np.ones(len(corner)), corner[:, 0] / size, corner[:, 1] / size])
    total = np.array([forces[0], -forces[4] / size, forces[3] / size])
    scale = float(abs(total).max())
    if scale == 0.0:
        return np.zeros(len(corner))
    widest = float(abs(gaps).max()) or 1.0
    # a centre of pressure on an edge may lie outside by rounding: the rest is shared by all corners
    slack = np.full(3, _ROUNDED)
    none, free = np.zeros(len(corner)), np.full(len(corner), np.inf)
    program = highs_of(
        sp.csc_array(rows),
        gaps / widest,
        total / scale - slack,
        total / scale + slack,
        none,
        free,
        {"primal_feasibility_tolerance": _RESIDUAL, "dual_feasibility_tolerance": _RESIDUAL},
    )
    program.run()
    solved = np.array(program.getSolution().col_value)
    residual = total / scale - rows @ solved
    return np.asarray(scale * (solved + np.linalg.pinv(rows) @ residual))
