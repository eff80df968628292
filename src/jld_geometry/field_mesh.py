"""Meshes of fields whose nodes follow the vertices of joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from jld_core.arrays import Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.adaptive import FieldSetting
from jld_core.fields.loads import Segment, loaded_mesh, loaded_segments, loads_on
from jld_core.fields.mesh import Mesh
from jld_core.fields.problem import units_of
from jld_geometry.variables import SAME
from jld_geometry.vertex_mesh import VertexMesh

_ROUNDING: Final = 1e-12  # weights below this count as zero; weights of a node add up to 1


@dataclass(frozen=True)
class FieldMesh:
    """Mesh of one load case whose nodes are affine functions of the vertices of joints.

    setting: the case at the present positions. base: mesh that every finer one was refined from, at the present
    positions, scene units. Loads are given over it. mesh: refined mesh at the present positions, scene units. follow:
    (b, v) weights by which the b nodes of the base follow the v vertices. inside: (p, b) weights of the p nodes of the
    refined mesh in triangles of the base. loaded: (k,) nodes of the base that are ends of loads and no vertices; they
    follow the loads.
    """

    setting: FieldSetting
    base: Mesh
    mesh: Mesh
    follow: sp.csr_array
    inside: sp.csr_array
    loaded: Ints

    @classmethod
    def of(cls, assembly: Assembly, vertices: VertexMesh) -> FieldMesh:
        """Return the coarsest mesh of one load case.

        vertices: at the positions of the assembly. Raises InputError as `FieldSetting.of` does.
        """
        setting = FieldSetting.of(assembly)
        base, _ = loaded_mesh(assembly)
        distance, nearest = cKDTree(vertices.places).query(base.points)
        nearest = np.asarray(nearest, dtype=np.int64)
        own = np.flatnonzero(np.asarray(distance) <= SAME * assembly.size)
        ends = _ends(setting.loads.segments)
        loaded = np.empty(0, dtype=np.int64)
        if len(ends):
            loaded = np.unique(np.asarray(cKDTree(base.points).query(ends)[1], dtype=np.int64))
            loaded = loaded[~np.isin(loaded, own)]
        follow = _weights(base, own, nearest[own], loaded, len(vertices.places))
        return cls(setting, base, setting.coarse, follow, _interpolation(base, setting.coarse), loaded)

    def refined(self, mesh: Mesh) -> FieldMesh:
        """Return the same case on a mesh that was refined from the present one."""
        return replace(self, mesh=mesh, inside=_interpolation(self.base, mesh))

    @property
    def motion(self) -> sp.csr_array:
        """(2p, 2v) derivatives of the positions of nodes by those of vertices."""
        return sp.csr_array(sp.kron(self.inside @ self.follow, sp.eye_array(2)))

    def at(self, assembly: Assembly, moved: Floats) -> FieldMesh | None:
        """Return the mesh with vertices moved by (v, 2); None where it is no longer valid.

        Triangles may turn over, or loads may lose their faces. assembly: the load case at these positions.
        """
        old = self.setting
        points = self.base.points + self.follow @ moved
        try:
            segments, rest = loaded_segments(assembly)
            before, ends = _ends(old.loads.segments), _ends(segments)
            if len(ends) != len(before):
                return None
            for node in self.loaded.tolist():
                points[node] = ends[int(np.argmin(np.linalg.norm(before - self.base.points[node], axis=1)))]
            base = replace(self.base, points=points)
            loads = loads_on(assembly, base, segments, rest)
        except InputError:  # a place that this search leaves out, as an element that turns over
            return None
        if not _covers(assembly, base):
            return None
        mesh = replace(self.mesh, points=self.inside @ points)
        setting = FieldSetting(assembly, old.material, units_of(assembly, old.material), old.coarse, loads)
        return replace(self, setting=setting, base=base, mesh=mesh)


def _ends(segments: Sequence[Segment]) -> Floats:
    """Return the ends (k, 2) of loaded segments."""
    return np.array([end for one in segments for end in one.ends]).reshape(-1, 2)


def _covers(assembly: Assembly, mesh: Mesh) -> bool:
    """Return True if the triangles of each cell have the area of their element."""
    area = np.bincount(mesh.cell, mesh.area, minlength=len(assembly.elements))
    free = assembly.elements.free
    real = assembly.elements.volume[free] / float(assembly.interfaces.l2[0])
    return bool((abs(area[free] - real) <= SAME * real).all())


def _weights(mesh: Mesh, own: Ints, vertex: Ints, loaded: Ints, count: int) -> sp.csr_array:
    """Return the weights (c, v) by which nodes of a coarse mesh follow vertices.

    own: (k,) nodes at the vertices `vertex` (k,). Ends of loads stay. Others on outlines follow the two neighbours
    whose edge they halve, nodes inside cells the mean of all their neighbours.
    """
    size = len(mesh.points)
    unique, _ = mesh.sides
    # a node in the middle of an outline edge has two neighbours on the outline, and follows these alone
    edges = mesh.edges
    outer = (edges.b < 0) | (edges.tag >= 0)
    ends = mesh.triangles[edges.a[outer][:, None], edges.corner_a[outer]]
    on_outline = np.zeros(size, dtype=bool)
    on_outline[ends.ravel()] = True
    fixed = np.zeros(size, dtype=bool)
    fixed[own] = fixed[loaded] = True
    free = np.flatnonzero(~fixed)
    pairs = np.concatenate([unique, unique[:, ::-1]])
    outline_pairs = np.unique(np.sort(ends, axis=1), axis=0)
    along = np.concatenate([outline_pairs, outline_pairs[:, ::-1]])
    inside, outside = ~on_outline[pairs[:, 0]], on_outline[along[:, 0]]
    rows = np.concatenate([pairs[inside], along[outside]])
    length = np.linalg.norm(mesh.points[rows[:, 0]] - mesh.points[rows[:, 1]], axis=1)
    near = sp.csr_array((1.0 / length, rows.T), shape=(size, size))
    total = np.asarray(near.sum(axis=1)).ravel()
    laplace = sp.csr_array(sp.diags_array(1.0 / np.where(total > 0.0, total, 1.0)) @ near)
    placed = sp.csr_array((np.ones(len(own)), (own, vertex)), shape=(size, count))
    if not len(free):
        return placed
    inner = sp.csc_matrix(sp.eye_array(len(free)) - laplace[free][:, free])
    right = (laplace[free] @ placed).toarray()
    found = splu(inner).solve(right)
    found[abs(found) < _ROUNDING] = 0.0
    spread = sp.csr_array((np.ones(len(free)), (free, np.arange(len(free)))), shape=(size, len(free)))
    return sp.csr_array(placed + spread @ sp.csr_array(found))


def _interpolation(coarse: Mesh, mesh: Mesh) -> sp.csr_array:
    """Return the weights (p, c) of nodes of a mesh in the triangles of its coarser mesh."""
    nodes, first = np.unique(mesh.triangles.ravel(), return_index=True)
    root = mesh.root[first // 3]
    away = mesh.points[nodes][:, None] - coarse.corners[root]
    share = 1.0 + np.einsum("nki,nki->nk", away, coarse.gradient[root])
    share[abs(share) < _ROUNDING] = 0.0
    entries = (share.ravel(), (np.repeat(nodes, 3), coarse.triangles[root].ravel()))
    found = sp.csr_array(entries, shape=(len(mesh.points), len(coarse.points)))
    found.eliminate_zeros()
    return found
