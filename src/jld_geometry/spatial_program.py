"""Rates, limits and variables of a geometry optimisation in space.

Source: docs/method.md (11.5), (11.6).
"""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.geometry import spun
from jld_core.scene.move import Move
from jld_core.strengths import Route
from jld_geometry.limits import EDGE, LEAST_AREA, LimitValues, mass_rows, relaxed, sparse_rows
from jld_geometry.spatial_mesh import SpatialMesh
from jld_geometry.spatial_rates import face_motion, held_forces, shape_loads, volume_rates
from jld_geometry.variables import Variables, ties_of, vertex_at

_ROUTE: Final = Route("joints that move in space", frozenset({"friction"}))

_PLANAR_KEYS: Final = ("angle", "draft", "straight", "inner")  # keys of "move" that have a meaning in the plane alone


def require_spatial(assembly: Assembly, labels: Bits, move: Move) -> None:
    """Raise InputError for labels, strengths, options or loads that joints in space exclude."""
    # Excluded are inner faces, shear and compressive strength, pressure on faces, and planar options of the key "move".
    if not labels.all():
        raise InputError("move", "in space only joints move, and no inner faces", "a scene of joints alone")
    assembly.strengths(_ROUTE, labels)  # refuses what it does not know
    for key in _PLANAR_KEYS:
        if key in move.model_fields_set:
            raise InputError(f"move.{key}", "it has no meaning in space", '"edge", "box", "block_mass" or "ties"')
    if move.maximise != "load_factor":
        raise InputError("move.maximise", f'"{move.maximise}" is for planar arches', '"load_factor" in space')
    if move.ties == "equal-shapes":
        raise InputError("move.ties", '"equal-shapes" is for planar scenes', '"mirror-x" or lists of points in space')
    if any(path.circle is not None for path in move.along):
        raise InputError("move.along", "circles are for planar scenes", '"at" with "direction" in space')
    if assembly.pressed:
        raise InputError("loads", "pressure on faces does not move with its joints", "point loads and body loads")


def spatial_residual_rates(
    assembly: Assembly, mesh: SpatialMesh, forces: Floats, load_factor: float, mechanism: Floats | None, used: Bools
) -> sp.csr_array:
    """Return the derivatives (6·free, 3v) of the equilibrium residual by the vertices.

    forces: (m, 6). mechanism: (n, 6), by which corner forces are chosen that are not unique; None for any choice. used:
    (v,) True for the vertices whose derivatives are asked for.
    """
    # Corner forces, shear and torque over the torsion length of every face are held. Rows are forces and moments about
    # the present centroids, column 3·vertex + axis, all in scene units, as `residual_rates` in the plane.
    elements, faces = assembly.elements, assembly.interfaces
    row_of = np.full(len(elements), -1, dtype=np.int64)
    row_of[elements.free] = np.arange(len(elements.free))
    total = sp.lil_array((6 * len(elements.free), mesh.places.size))
    for face, vertices in enumerate(mesh.polygons):
        if not used[vertices].any() or not forces[face].any():
            continue
        polygon = mesh.places[vertices] - faces.origin[face]
        gaps = np.zeros(len(polygon))
        if mechanism is not None:
            velocity, spin = face_motion(assembly, face, mechanism)
            gaps = (velocity + spun(spin, polygon)) @ faces.normal[face]
        rates = held_forces(assembly, face, polygon, forces[face], gaps).rates(polygon)
        columns = _columns(vertices)
        for element, sign in ((int(faces.a[face]), -1.0), (int(faces.b[face]), 1.0)):
            if row_of[element] < 0:
                continue
            arm = faces.origin[face] - elements.centroid[element]
            turned = np.cross(arm, rates[..., :3])
            moments = rates[..., 3:] + turned
            block = sign * np.concatenate([rates[..., :3], moments], axis=-1).reshape(-1, 6).T
            first = 6 * int(row_of[element])
            total[first : first + 6, columns] += block
    loads = assembly.dead_loads + load_factor * assembly.live_loads
    growing, riding = shape_loads(loads, assembly.elements)
    for element in elements.free.tolist():
        corner = mesh.corners[element]
        if not used[corner].any():
            continue
        volume, by_volume, by_moment = volume_rates(assembly, element)
        first, columns = 6 * int(row_of[element]), _columns(corner)
        force = np.outer(growing[element], by_volume.ravel()) / volume
        shift = by_moment.transpose(1, 0, 2).reshape(3, -1) / volume
        moment = np.cross(shift.T, riding[element]).T
        total[first : first + 6, columns] += np.concatenate([force, moment])
    return sp.csr_array(total)


def _columns(vertices: Ints) -> Ints:
    """Return the columns (3k,) of the coordinates of some vertices."""
    return (3 * vertices[:, None] + np.arange(3)).ravel()


class SpatialLimits:
    """Limits on the geometry of joints in space: r functions with least or exact values.

    They limit planes of joints, lengths of edges, volumes of elements and masses of blocks.

    assembly: structure at the start. labels: (m,) True = dry. mesh: vertices at the start. moving: (v,) True for the
    vertices that move. move: limits of the user. least: (r,) least values, dimensionless. equal: (r,) True where the
    value is to be kept exactly.
    """

    def __init__(self, assembly: Assembly, labels: Bits, mesh: SpatialMesh, moving: Bools, move: Move) -> None:
        self._assembly, self._mesh, self._move = assembly, mesh, move
        # every corner beyond the third of a joint that moves lies in the plane of three others
        self._plane = [
            np.array([polygon[0], polygon[1], polygon[2], corner])
            for polygon in mesh.polygons
            if moving[polygon].any()
            for corner in polygon[3:]
        ]
        owner, edges = mesh.edges
        free = ~assembly.elements.support[owner]
        self._edges = np.unique(np.sort(edges[free & moving[edges].any(axis=1)], axis=1), axis=0)
        lengths = np.linalg.norm(mesh.places[edges[:, 1]] - mesh.places[edges[:, 0]], axis=1)[free]
        self._edge = move.edge or EDGE * float(lengths.mean())
        changing = np.array([moving[corner].any() for corner in mesh.corners])
        self._elements = np.flatnonzero(changing & ~assembly.elements.support)
        self._volumes = np.array([_volume(mesh, mesh.places, k)[0] for k in range(len(mesh.corners))])
        bounded = any(bound is not None for bound in move.block_mass)
        self._masses = mass_rows(assembly, labels, changing) if bounded else sp.csr_array((0, len(changing)))
        start = self.at(mesh.places)
        self.equal = np.zeros(len(start.values), dtype=bool)
        self.equal[: len(self._plane)] = True
        self.least = np.where(self.equal, 0.0, np.minimum(0.0, relaxed(start.values)))

    def at(self, places: Floats) -> LimitValues:
        """Return the values of all limits and their derivatives at positions (v, 3)."""
        parts = [self._of_planes(places), self._of_edges(places), *self._of_volumes(places)]
        values = np.concatenate([value for value, _ in parts])
        return LimitValues(values, sp.csr_array(sp.vstack([rates for _, rates in parts])))

    def _of_planes(self, places: Floats) -> tuple[Floats, sp.csr_array]:
        """Return distances of corners of joints from the plane of three others, and derivatives."""
        # Values are relative to the size of the joint; 0 keeps a joint plane.
        values, rows, columns = [], [], []
        for four in self._plane:
            p, q, r, s = places[four]
            first, second = self._mesh.places[four[1:3]] - self._mesh.places[four[0]]
            unit = float(np.linalg.norm(np.cross(first, second))) ** 1.5
            a, b, c = q - p, r - p, s - p
            slopes = np.array([np.zeros(3), np.cross(b, c), np.cross(c, a), np.cross(a, b)])
            slopes[0] = -slopes.sum(axis=0)
            values.append(float(np.cross(a, b) @ c) / unit)
            rows.append(slopes.ravel() / unit)
            columns.append(_columns(four))
        count = len(self._plane)
        places_of = np.array(columns, dtype=np.int64).reshape(count, 12)
        return np.array(values), sparse_rows(np.array(rows).reshape(count, 12), places_of, places.size)

    def _of_edges(self, places: Floats) -> tuple[Floats, sp.csr_array]:
        """Return edge lengths over the least length, less 1, and their derivatives."""
        edge = places[self._edges[:, 1]] - places[self._edges[:, 0]]
        length = np.linalg.norm(edge, axis=1)
        along = edge / length[:, None] / self._edge
        columns = np.concatenate([3 * self._edges[:, :1] + np.arange(3), 3 * self._edges[:, 1:] + np.arange(3)], axis=1)
        return length / self._edge - 1.0, sparse_rows(np.concatenate([-along, along], axis=1), columns, places.size)

    def _of_volumes(self, places: Floats) -> list[tuple[Floats, sp.csr_array]]:
        """Return limits on volumes of elements and masses of blocks, with their derivatives."""
        # Values are (volume / volume at the start − least share), (mass / least − 1) and (1 − mass / largest).
        share, rates = np.ones(len(self._volumes)), sp.lil_array((len(self._volumes), places.size))
        for k in self._elements.tolist():
            volume, by_corner = _volume(self._mesh, places, k)
            share[k] = volume / self._volumes[k]
            rates[[k], _columns(self._mesh.corners[k])] = by_corner.ravel() / self._volumes[k]
        slopes = sp.csr_array(rates)
        found = [(share[self._elements] - LEAST_AREA, sp.csr_array(slopes[self._elements]))]
        low, high = self._move.block_mass
        mass, by_place = np.asarray(self._masses @ share), sp.csr_array(self._masses @ slopes)
        if low:
            found.append((mass / low - 1.0, sp.csr_array(by_place * (1.0 / low))))
        if high is not None:
            found.append((1.0 - mass / high, sp.csr_array(by_place * (-1.0 / high))))
        return found


def _volume(mesh: SpatialMesh, places: Floats, element: int) -> tuple[float, Floats]:
    """Compute the volume of an element, and its derivatives (k, 3) by its k corners.

    places: (v, 3) positions of all vertices.
    """
    corners = mesh.corners[element]
    middle = places[corners].mean(axis=0)
    position = {int(vertex): k for k, vertex in enumerate(corners)}
    volume, rates = 0.0, np.zeros((len(corners), 3))
    for ring in mesh.rings[element]:
        for second, third in itertools.pairwise(ring[1:]):
            own = [position[int(v)] for v in (ring[0], second, third)]
            x, y, z = places[[ring[0], second, third]] - middle
            volume += float(x @ np.cross(y, z)) / 6.0
            rates[own] += np.array([np.cross(y, z), np.cross(z, x), np.cross(x, y)]) / 6.0
    return volume, rates  # the middle drops out, since the surface is closed


def spatial_variables(assembly: Assembly, mesh: SpatialMesh, move: Move) -> Variables:
    """Choose the variables of a structure in space: corners of joints that slide along edges.

    Raises InputError as `variables_of`.
    """
    # A corner that belongs to one joint of two free elements slides along the mean of the edges on both sides. Corners
    # that "along" names move in its direction.
    held = np.zeros(len(mesh.places), dtype=bool)
    for element in np.flatnonzero(assembly.elements.support).tolist():
        held[mesh.corners[element]] = True
    chosen: list[tuple[int, Floats]] = []
    for position, path in enumerate(move.along):
        where = f"move.along[{position}].at"
        if path.at is None or path.direction is None:
            raise InputError(where, "it is no line", '"at" and "direction"')
        vertex = vertex_at(mesh.places, path.at, assembly.size, where)
        if held[vertex]:
            raise InputError(where, f"{path.at} is a vertex of a support", "a vertex between free elements")
        if len(path.direction) != 3:
            raise InputError(f"move.along[{position}].direction", "it has 2 numbers", "3 in space")
        direction = np.array(path.direction, dtype=float)
        chosen.append((vertex, direction / np.linalg.norm(direction)))
    if move.vertices == "joints":
        chosen += _joint_corners(assembly, mesh, held, {vertex for vertex, _ in chosen})
    _require_corners(mesh, assembly, {vertex for vertex, _ in chosen})
    vertices = np.array([one[0] for one in chosen], dtype=np.int64)
    ways = np.array([one[1] for one in chosen]).reshape(-1, 3)
    found = Variables(mesh.places, vertices, ways, np.full_like(ways, np.nan), np.zeros((0, len(vertices))))
    found = Variables(**{**vars(found), "ties": ties_of(found, assembly, move)})
    if not found.basis.shape[1]:
        raise InputError("move", "no corner of a joint can move", 'joints with four edges across, or "along"')
    return found


def _joint_corners(assembly: Assembly, mesh: SpatialMesh, held: Bools, taken: set[int]) -> list[tuple[int, Floats]]:
    """Return vertex and unit sliding direction (3,) of each corner that belongs to one joint.

    held: (v,) True for vertices that stay.
    """
    # Each of the two elements must have exactly one edge from the corner across the joint, at more than 60° to one
    # another.
    faces, owner, edges = assembly.interfaces, *mesh.edges
    count = np.bincount(np.concatenate(mesh.polygons), minlength=len(mesh.places))
    found = []
    for face, polygon in enumerate(mesh.polygons):
        for vertex in polygon.tolist():
            if held[vertex] or vertex in taken or count[vertex] != 1:
                continue
            ways = []
            for element in (int(faces.a[face]), int(faces.b[face])):
                ends = edges[(owner == element) & (edges[:, 0] == vertex), 1]
                across = np.setdiff1d(ends, polygon)
                if len(across) == 1:
                    way = mesh.places[across[0]] - mesh.places[vertex]
                    ways.append(way / np.linalg.norm(way))
            if len(ways) == 2 and np.linalg.norm(ways[1] - ways[0]) > 1.0:
                found.append((vertex, (ways[1] - ways[0]) / float(np.linalg.norm(ways[1] - ways[0]))))
    return found


def _require_corners(mesh: SpatialMesh, assembly: Assembly, moving: set[int]) -> None:
    """Raise InputError for a moving joint that is not a whole face of both elements."""
    faces = assembly.interfaces
    for face, polygon in enumerate(mesh.polygons):
        own = set(polygon.tolist())
        if not own & moving:
            continue
        for element in (int(faces.a[face]), int(faces.b[face])):
            if not any(set(ring.tolist()) == own for ring in mesh.rings[element]):
                problem = f"the joint of {assembly.pair(face)} is no whole face of {assembly.elements.ids[element]!r}"
                raise InputError("move", problem, "joints that are whole faces of both elements in space")
