"""Derivatives of planar equilibrium by positions of vertices, docs/method.md section 11."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats, Ints
from jld_core.assembly import Assembly, Elements
from jld_core.loads import Loads
from jld_geometry.vertex_mesh import VertexMesh


def length_rates(mesh: VertexMesh) -> sp.csr_array:
    """Return the derivatives (m, 2v) of the lengths of interfaces by the vertices.

    Column 2·vertex + axis. With ends p, q and unit direction t of an interface, dl = t·(dq − dp).
    """
    edge = mesh.places[mesh.ends[:, 1]] - mesh.places[mesh.ends[:, 0]]
    along = edge / np.linalg.norm(edge, axis=1)[:, None]
    values = np.concatenate([-along, along], axis=1)
    rows = np.repeat(np.arange(len(edge)), 4)
    return sp.csr_array((values.ravel(), (rows, _columns(mesh.ends).ravel())), shape=(len(edge), mesh.places.size))


@dataclass(frozen=True)
class AreaRates:
    """Areas and centroids of elements, and their derivatives by the vertices.

    area: (n,) areas. by_area: (n, 2v) derivatives of the areas. by_centroid: (2n, 2v) derivatives of the centroids, x
    and y of each element in turn.
    """

    area: Floats
    by_area: sp.csr_array
    by_centroid: sp.csr_array


def area_rates(mesh: VertexMesh) -> AreaRates:
    """Compute areas of elements and the derivatives of areas and centroids (11.3)."""
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
    both = np.concatenate(central, axis=1)
    entries = (both.ravel(), (np.concatenate([2 * row, 2 * row + 1]), np.tile(column, 2)))
    return AreaRates(areas, by_areas, sp.csr_array(entries, shape=(2 * len(areas), size)))


def _by_length(loops: tuple[Ints, ...]) -> Iterator[tuple[Ints, Ints]]:
    """Yield the indices (k,) and vertices (k, c) of all loops with c vertices, for each c."""
    lengths = np.array([len(loop) for loop in loops])
    for length in np.unique(lengths).tolist():
        chosen = np.flatnonzero(lengths == length)
        yield chosen, np.array([loops[k] for k in chosen])


def residual_rates(assembly: Assembly, mesh: VertexMesh, forces: Floats, load_factor: float) -> sp.csr_array:
    """Return the derivatives (3·free, 2v) of the equilibrium residual by the vertices.

    The residual is A_eq F + b + λ b_λ, see (11.1) and (11.2). Resultants N, V and M / (l/2) are held constant, and
    moments are taken about the present centroids. Rows are force x, force y and moment of each free element; column
    2·vertex + axis. All is in scene units.

    forces: (m, 3) N, V, M.
    """
    entries = face_rates(assembly, mesh, forces)
    shape = (3 * len(assembly.elements.free), mesh.places.size)
    return sp.csr_array(
        sp.csr_array((entries.value, (entries.row, entries.column)), shape=shape)
        + load_rates(assembly, mesh, load_factor)
    )


@dataclass(frozen=True)
class FaceRates:
    """Derivatives of the forces of interfaces on free elements, as k entries of a matrix.

    row, column, face: (k,) equilibrium row 3·(number of the free element) + freedom, coordinate 2·vertex + axis, and
    interface. value: (k,) derivatives, scene units.
    """

    row: Ints
    column: Ints
    face: Ints
    value: Floats


def face_rates(assembly: Assembly, mesh: VertexMesh, forces: Floats) -> FaceRates:
    """Compute the derivatives by the vertices of the forces of interfaces on free elements.

    Moments are taken about the present centroids, which are held constant. forces: (m, 3) N, V, M, scene units.
    """
    faces, elements = assembly.interfaces, assembly.elements
    start, end = mesh.places[mesh.ends[:, 0]], mesh.places[mesh.ends[:, 1]]
    edge = end - start
    length = np.linalg.norm(edge, axis=1)[:, None]
    along = edge / length
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    push, shear, moment = forces[:, :1], forces[:, 1:2], forces[:, 2:]
    force = push * normal + shear * along
    turned = np.einsum("fi,fj->fij", (shear * normal - push * along) / length, normal)
    row_of = np.full(len(elements), -1, dtype=np.int64)
    row_of[elements.free] = np.arange(len(elements.free))
    columns = _columns(mesh.ends)
    rows, cols, owners, values = [], [], [], []
    for element, sign in ((faces.a, -1.0), (faces.b, 1.0)):
        free = np.flatnonzero(row_of[element] >= 0)
        arm = 0.5 * (start + end)[free] - elements.centroid[element[free]]
        stretch = (moment / length * along)[free]
        swing = np.einsum("fi,fij->fj", np.column_stack([-arm[:, 1], arm[:, 0]]), turned[free]) + stretch
        shift = 0.5 * np.column_stack([force[free, 1], -force[free, 0]])
        block = np.empty((len(free), 3, 4))
        block[:, :2, :2], block[:, :2, 2:] = -turned[free], turned[free]
        block[:, 2, :2], block[:, 2, 2:] = shift - swing, shift + swing
        first = 3 * row_of[element[free]][:, None, None] + np.arange(3)[:, None]
        rows.append(np.broadcast_to(first, block.shape).ravel())
        cols.append(np.broadcast_to(columns[free][:, None, :], block.shape).ravel())
        owners.append(np.broadcast_to(free[:, None, None], block.shape).ravel())
        values.append((sign * block).ravel())
    return FaceRates(*(np.concatenate(part) for part in (rows, cols, owners, values)))


def load_rates(assembly: Assembly, mesh: VertexMesh, load_factor: float) -> sp.csr_array:
    """Return the derivatives (3·free, 2v) of the loads on free elements by the vertices.

    Rows are force x, force y and moment about the present centroid of each free element; column 2·vertex + axis. Scene
    units. load_factor: λ of the live loads.
    """
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
    body, riding = loads.body, loads.at_centroids
    return (
        np.where((elements.support | elements.fixed_weight)[:, None], 0.0, body),
        np.where((elements.support | elements.fixed_centroid)[:, None], 0.0, riding),
    )


def _columns(ends: Ints) -> Ints:
    """Return the columns (m, 4) of the coordinates of both end vertices; ends: (m, 2)."""
    return np.concatenate([2 * ends[:, :1] + np.arange(2), 2 * ends[:, 1:] + np.arange(2)], axis=1)
