"""Shape limits of blocks: values, bounds, and derivatives by the positions of vertices."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core import Assembly, Bits, Bools, Floats, InputError, Ints, Route, Scene, blocks_of, tolerances
from jld_core.geometry import spun
from jld_core.scene import PointLoad
from jld_core.scene import loads as scene_loads
from jld_core.scene import move as scene_move
from jld_geometry.convex_cells import EqualShapes, VertexMesh, equal_corners
from jld_geometry.moved_scene import SpatialMesh
from jld_geometry.spatial_rates import AreaRates, area_rates, face_motion, held_forces, shape_loads, volume_rates
from jld_geometry.variables import Variables, ties_of, vertex_at

EDGE: Final = 0.15  # default of the least length of an edge, relative to the mean edge of all free elements

LEAST_AREA: Final = 0.05  # least area of an element, relative to its area at the start

_KEPT: Final = 0.98  # share of its value at the start that a limit requires if the start violates the limit

_STRAIGHT: Final = 1e-6  # deviation from 180°, rad, up to which an angle of an element is straight

_BEND: Final = np.radians(11.0)  # largest bend of a block face at the end of a joint where "straight" is false, rad


@dataclass(frozen=True)
class LimitValues:
    """Values of all r limits at one position of v vertices, and their derivatives."""

    values: Floats  # (r,) dimensionless values, each to be at least `Limits.least`, or equal to it where `Limits.equal`
    rates: sp.csr_array  # (r, 2v) derivatives by the positions of vertices, column 2·vertex + axis


class Limits:
    """Limits on planar joints: r functions with least or exact values, which the start keeps."""

    def __init__(
        self, scene: Scene, assembly: Assembly, labels: Bits, mesh: VertexMesh, moving: Bools, move: scene_move.Move
    ) -> None:
        self._mesh, self._move, self._size = mesh, move, assembly.size
        if move.draft is not None and len(move.draft.direction) != 2:
            raise InputError("move.draft.direction", "it has 3 numbers", "2 in a planar scene")
        owner, edges = mesh.edges
        free = ~assembly.elements.support
        self._corners, self._straight = self._angles(mesh, moving, free)
        if move.inner == "follow":  # where no joint ends nothing has to be straight
            self._straight = self._straight[np.isin(self._straight[:, 1], mesh.ends[labels])]
        touched = moving[edges].any(axis=1)
        self._edges = np.unique(np.sort(edges[touched & free[owner]], axis=1), axis=0)
        lengths = np.linalg.norm(mesh.places[edges[:, 1]] - mesh.places[edges[:, 0]], axis=1)[free[owner]]
        self._edge = move.edge or EDGE * float(lengths.mean())
        self._areas = area_rates(mesh).area
        self._elements = np.array([k for k, loop in enumerate(mesh.loops) if moving[loop].any()], dtype=np.int64)
        self._masses = (
            mass_rows(assembly, labels, np.array([moving[loop].any() for loop in mesh.loops]))
            if any(bound is not None for bound in move.block_mass)
            else sp.csr_array((0, len(free)))
        )
        self._joints = np.flatnonzero(labels & moving[mesh.ends].any(axis=1)) if move.draft else np.empty(0, np.int64)
        outlines = [_corners_alone(loop, mesh.places) for loop in mesh.loops]
        changing = np.array([moving[loop].any() for loop in mesh.loops])
        chosen = np.flatnonzero(free).tolist() if move.ties == "equal-shapes" else []
        pairs = equal_corners([outlines[k] for k in chosen], mesh.places, changing[chosen])
        self._shapes = EqualShapes(pairs, mesh.places)
        self._loads = _loads_on_edges(scene, assembly, mesh)
        self._sign = np.ones(len(self._joints))
        start = self.at(mesh.places, drafted=True)
        self.equal = self._equal(len(start.values))
        self.least = np.where(self.equal, 0.0, np.minimum(0.0, relaxed(start.values)))

    def _angles(self, mesh: VertexMesh, moving: Bools, free: Bools) -> tuple[Ints, Ints]:
        """Return corners of free elements below 180° (c, 3), and straight ones (s, 3)."""
        # Each row holds the vertices before, at and after the corner; one of them moves.
        loops = [loop for loop, is_free in zip(mesh.loops, free.tolist(), strict=True) if is_free]
        every = [np.column_stack([np.roll(loop, 1), loop, np.roll(loop, -1)]) for loop in loops]
        corners = np.concatenate(every)
        corners = corners[moving[corners].any(axis=1)]
        angle = _angle(mesh.places, corners)
        straight = abs(angle - np.pi) <= _STRAIGHT
        # a straight corner between vertices that slide on one line stays straight by itself; its row does no harm
        return corners[(angle < np.pi) & ~straight], corners[straight]

    def _equal(self, count: int) -> Bools:
        """Mark the limits (count,) that are equations: straight corners if required, equal shapes."""
        equal = np.zeros(count, dtype=bool)
        if self._move.straight:
            equal[: len(self._straight)] = True
        equal[count - len(self._shapes) :] = True
        return equal

    def at(self, places: Floats, *, drafted: bool = False) -> LimitValues:
        """Return the values of all limits and their derivatives at positions (v, 2)."""
        rates = area_rates(VertexMesh(places, self._mesh.loops, self._mesh.ends))
        parts = [
            self._of_straight(places),
            self._of_angles(places),
            _of_edges(places, self._edges, self._edge),
            self._of_areas(rates),
        ]
        parts += [
            self._of_masses(rates),
            self._of_loads(places),
            self._of_draft(places, drafted),
            self._shapes.at(places),
        ]
        values = np.concatenate([value for value, _ in parts])
        return LimitValues(values, sp.csr_array(sp.vstack([rates for _, rates in parts])))

    def _of_straight(self, places: Floats) -> tuple[Floats, sp.csr_array]:
        """Return deviations of straight corners from 180°, or distances to the largest bend, rad; derivatives."""
        angle = _angle(places, self._straight) - np.pi
        rates = _angle_rates(places, self._straight)
        if self._move.straight:
            return angle, rates
        both = sp.csr_array(sp.vstack([rates, -rates]))
        return np.concatenate([angle + _BEND, _BEND - angle]), both

    def _of_angles(self, places: Floats) -> tuple[Floats, sp.csr_array]:
        """Return angle − least and largest − angle at corners, rad, with derivatives."""
        angle, rates = _angle(places, self._corners), _angle_rates(places, self._corners)
        low, high = np.radians(self._move.angle)
        return np.concatenate([angle - low, high - angle]), sp.csr_array(sp.vstack([rates, -rates]))

    def _of_areas(self, rates: AreaRates) -> tuple[Floats, sp.csr_array]:
        """Return area / area at the start − least share of elements, with derivatives."""
        start = self._areas[self._elements]
        scaled = sp.diags_array(1.0 / start) @ rates.by_area[self._elements]
        return rates.area[self._elements] / start - LEAST_AREA, sp.csr_array(scaled)

    def _of_masses(self, rates: AreaRates) -> tuple[Floats, sp.csr_array]:
        """Return mass / least − 1 and 1 − mass / largest of blocks, and their derivatives."""
        # Bounds that the user does not state give no values.
        low, high = self._move.block_mass
        mass: Floats = np.asarray(self._masses @ (rates.area / self._areas))
        slopes = sp.csr_array(self._masses @ sp.diags_array(1.0 / self._areas) @ rates.by_area)
        values, parts = [], [sp.csr_array((0, rates.by_area.shape[1]))]
        if low:
            values.append(mass / low - 1.0)
            parts.append(sp.csr_array(sp.diags_array(np.full(len(mass), 1.0 / low)) @ slopes))
        if high is not None:
            values.append(1.0 - mass / high)
            parts.append(sp.csr_array(sp.diags_array(np.full(len(mass), -1.0 / high)) @ slopes))
        return np.concatenate([np.empty(0), *values]), sp.csr_array(sp.vstack(parts))

    def _of_loads(self, places: Floats) -> tuple[Floats, sp.csr_array]:
        """Return distances of point loads to both ends of their edges, and their derivatives."""
        # Half the width of a load is subtracted. Values are relative to the size of the structure.
        values, rates, columns = [], [], []
        for point, first, last, half in self._loads:
            edge = places[last] - places[first]
            along = edge / np.hypot(*edge)
            for vertex, sign in ((first, 1.0), (last, -1.0)):
                values.append((sign * float((point - places[vertex]) @ along) - half) / self._size)
                rates.append(-sign * along / self._size)
                columns.append([2 * vertex, 2 * vertex + 1])
        return np.array(values), sparse_rows(
            np.array(rates).reshape(-1, 2), np.array(columns, dtype=np.int64).reshape(-1, 2), places.size
        )

    def _of_draft(self, places: Floats, drafted: bool) -> tuple[Floats, sp.csr_array]:
        """Return sine − least sine between joints and lifting direction, with derivatives."""
        draft = self._move.draft
        if draft is None:
            return np.empty(0), sp.csr_array((0, places.size))
        lift = np.array(draft.direction, dtype=float)
        lift /= np.linalg.norm(lift)
        ends = self._mesh.ends[self._joints]
        edge = places[ends[:, 1]] - places[ends[:, 0]]
        length = np.linalg.norm(edge, axis=1)[:, None]
        along = edge / length
        normal = np.column_stack([along[:, 1], -along[:, 0]])
        sine = normal @ lift
        if drafted:  # a joint keeps the side of the direction to which it leans at the start
            self._sign = np.where(sine < 0.0, -1.0, 1.0)
        slope = -(self._sign * (along @ lift))[:, None] * normal / length
        columns = np.concatenate([2 * ends[:, :1] + np.arange(2), 2 * ends[:, 1:] + np.arange(2)], axis=1)
        rows = sparse_rows(np.concatenate([-slope, slope], axis=1), columns, places.size)
        return self._sign * sine - np.sin(np.radians(draft.degrees)), rows


def relaxed(values: Floats) -> Floats:
    """Lower limit values (r,) slightly, for use as least values that the start keeps."""
    return np.asarray(values - (1.0 - _KEPT) * abs(values))


def _angle(places: Floats, corners: Ints) -> Floats:
    """Return the angles (c,) inside elements at corners (c, 3), 0 to 2π."""
    before, after = places[corners[:, 0]] - places[corners[:, 1]], places[corners[:, 2]] - places[corners[:, 1]]
    cross = after[:, 0] * before[:, 1] - after[:, 1] * before[:, 0]
    return np.asarray(np.arctan2(cross, np.einsum("ij,ij->i", after, before)) % (2.0 * np.pi))


def _angle_rates(places: Floats, corners: Ints) -> sp.csr_array:
    before, after = places[corners[:, 0]] - places[corners[:, 1]], places[corners[:, 2]] - places[corners[:, 1]]
    of_before = np.column_stack([-before[:, 1], before[:, 0]]) / np.einsum("ij,ij->i", before, before)[:, None]
    of_after = np.column_stack([-after[:, 1], after[:, 0]]) / np.einsum("ij,ij->i", after, after)[:, None]
    columns = (2 * corners[:, :, None] + np.arange(2)).reshape(len(corners), 6)
    return sparse_rows(np.concatenate([of_before, of_after - of_before, -of_after], axis=1), columns, places.size)


def sparse_rows(values: Floats, columns: Ints, size: int) -> sp.csr_array:
    """Make a sparse matrix (k, size) from values (k, j) and their columns (k, j)."""
    rows = np.repeat(np.arange(len(values)), values.shape[1])
    return sp.csr_array((values.ravel(), (rows, columns.ravel())), shape=(len(values), size))


def mass_rows(assembly: Assembly, labels: Bits, changing: Bools) -> sp.csr_array:
    """Return the masses (b, n) of elements, by block without supports that holds changing (n,) ones."""
    elements = assembly.elements
    block = blocks_of(assembly, labels)
    grounded = np.isin(block, block[elements.support])
    numbers = np.unique(block[changing & ~grounded])
    members = np.flatnonzero(np.isin(block, numbers))
    row = np.searchsorted(numbers, block[members])
    return sp.csr_array((elements.mass[members], (row, members)), shape=(len(numbers), len(elements)))


def _loads_on_edges(scene: Scene, assembly: Assembly, mesh: VertexMesh) -> list[tuple[Floats, int, int, float]]:
    """Return place (2,), first and last vertex, and half width of point loads on outlines."""
    # An edge is given by its first and last vertex. Loads inside elements are left out; half widths are 0 where none is
    # stated.
    loads = []
    for entry in loads_that_move(scene):
        if not isinstance(entry, PointLoad) or entry.at is None:
            continue
        point, loop = np.array(entry.at, dtype=float), mesh.loops[assembly.elements.index[entry.element]]
        corners = _corners_alone(loop, mesh.places)
        start, edge = mesh.places[corners], mesh.places[np.roll(corners, -1)] - mesh.places[corners]
        length = np.linalg.norm(edge, axis=1)
        arm = point - start
        along = np.einsum("ij,ij->i", arm, edge) / length
        off = abs(arm[:, 0] * edge[:, 1] - arm[:, 1] * edge[:, 0]) / length
        reach = tolerances.FACE * assembly.size
        on = np.flatnonzero((off <= reach) & (along >= -reach) & (along <= length + reach))
        if len(on):
            k = int(on[0])
            loads.append((point, int(corners[k]), int(np.roll(corners, -1)[k]), 0.5 * (entry.width or 0.0)))
    return loads


def loads_that_move(scene: Scene) -> list[scene_loads.LoadEntry]:
    """Return all load entries of a scene; InputError for one that loses its meaning while joints move."""
    loads = scene.loads
    entries: list[scene_loads.LoadEntry] = [*loads.dead, *(loads.live or [])]
    for case in loads.cases or []:
        entries += [*case.dead, *case.live]
    if scene.fill is not None:
        raise InputError("fill", "its loads do not move with the joints", "point loads in place of it")
    if loads.moving:
        raise InputError("loads.moving", "its places do not move with the joints", '"cases" with point loads')
    if any(isinstance(entry, scene_loads.FaceLoad) for entry in entries):
        raise InputError("loads", "pressure on faces does not move with its joints", "point loads and body loads")
    return entries


def _corners_alone(loop: Ints, places: Floats) -> Ints:
    """Return the vertices of a loop without those at which it is straight; places: (v, 2)."""
    angle = _angle(places, np.column_stack([np.roll(loop, 1), loop, np.roll(loop, -1)]))
    return loop[abs(angle - np.pi) > _STRAIGHT]


_ROUTE: Final = Route("joints that move in space", frozenset({"friction"}))

_PLANAR_KEYS: Final = ("angle", "draft", "straight", "inner")  # keys of "move" that have a meaning in the plane alone


def require_spatial(assembly: Assembly, labels: Bits, move: scene_move.Move) -> None:
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
    """Return the derivatives (6·free, 3v) of the equilibrium residual by the used (v,) vertices."""
    # forces: (m, 6). mechanism: (n, 6), by which corner forces are chosen that are not unique; None for any choice.
    # Corner forces, shear and torque over the torsion length of every face are held. Rows are forces and moments about
    # the present centroids, column 3·vertex + axis, all in scene units, as `residual_rates` in the plane.
    elements = assembly.elements
    row_of = np.full(len(elements), -1, dtype=np.int64)  # number of each free element, −1 for supports
    row_of[elements.free] = np.arange(len(elements.free))
    total = sp.lil_array((6 * len(elements.free), mesh.places.size))
    for face, vertices in enumerate(mesh.polygons):
        if used[vertices].any() and forces[face].any():
            _add_joint_rates(total, assembly, face, mesh.places[vertices], vertices, forces[face], mechanism, row_of)
    loads = assembly.dead_loads + load_factor * assembly.live_loads
    body_loads, centroid_loads = shape_loads(loads, elements)
    for element in elements.free.tolist():
        corner = mesh.corners[element]
        if not used[corner].any():
            continue
        volume, by_volume, by_moment = volume_rates(assembly, element)
        first, columns = 6 * int(row_of[element]), _columns(corner)
        # A body load F changes by F dV / V. A load at the centroid moves with it, and has the moment shift × F then.
        force = np.outer(body_loads[element], by_volume.ravel()) / volume
        shift = by_moment.transpose(1, 0, 2).reshape(3, -1) / volume
        moment = np.cross(shift.T, centroid_loads[element]).T
        total[first : first + 6, columns] += np.concatenate([force, moment])
    return sp.csr_array(total)


def _add_joint_rates(
    total: sp.lil_array,
    assembly: Assembly,
    face: int,
    corners: Floats,
    vertices: Ints,
    forces: Floats,
    mechanism: Floats | None,
    row_of: Ints,
) -> None:
    """Add the rates of the forces (6,) of one joint with corners (k, 3) at `vertices` (k,) to both of its elements."""
    elements, faces = assembly.elements, assembly.interfaces
    polygon = corners - faces.origin[face]
    gaps = np.zeros(len(polygon))
    if mechanism is not None:
        velocity, spin = face_motion(assembly, face, mechanism)
        gaps = (velocity + spun(spin, polygon)) @ faces.normal[face]
    rates = held_forces(assembly, face, polygon, forces, gaps).rates(polygon)
    columns = _columns(vertices)
    for element, sign in ((int(faces.a[face]), -1.0), (int(faces.b[face]), 1.0)):
        if row_of[element] < 0:
            continue
        arm = faces.origin[face] - elements.centroid[element]
        moments = rates[..., 3:] + np.cross(arm, rates[..., :3])
        block = sign * np.concatenate([rates[..., :3], moments], axis=-1).reshape(-1, 6).T
        first = 6 * int(row_of[element])
        total[first : first + 6, columns] += block


def _of_edges(places: Floats, edges: Ints, least: float) -> tuple[Floats, sp.csr_array]:
    """Return lengths of edges (k, 2) between places (v, d) over the least length, less 1, and their derivatives."""
    edge, along_axes = places[edges[:, 1]] - places[edges[:, 0]], np.arange(places.shape[1])
    length = np.linalg.norm(edge, axis=1)
    rates = edge / length[:, None] / least
    columns = np.concatenate([len(along_axes) * edges[:, k : k + 1] + along_axes for k in (0, 1)], axis=1)
    return length / least - 1.0, sparse_rows(np.concatenate([-rates, rates], axis=1), columns, places.size)


def _columns(vertices: Ints) -> Ints:
    return (3 * vertices[:, None] + np.arange(3)).ravel()


class SpatialLimits:
    """Limits on joints in space: planes of joints, edges, volumes and masses of blocks."""

    def __init__(
        self, assembly: Assembly, labels: Bits, mesh: SpatialMesh, moving: Bools, move: scene_move.Move
    ) -> None:
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
        parts = [self._of_planes(places), _of_edges(places, self._edges, self._edge), *self._of_volumes(places)]
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
        column_table = np.array(columns, dtype=np.int64).reshape(count, 12)
        return np.array(values), sparse_rows(np.array(rows).reshape(count, 12), column_table, places.size)

    def _of_volumes(self, places: Floats) -> list[tuple[Floats, sp.csr_array]]:
        """Return limits on volumes of elements and masses of blocks, with their derivatives."""
        # Values are (volume / volume at the start − least share), (mass / least − 1) and (1 − mass / largest).
        share, rates = np.ones(len(self._volumes)), sp.lil_array((len(self._volumes), places.size))
        for k in self._elements.tolist():
            volume, by_corner = _volume(self._mesh, places, k)
            share[k] = volume / self._volumes[k]
            rates[[k], _columns(self._mesh.corners[k])] = by_corner.ravel() / self._volumes[k]
        slopes = sp.csr_array(rates)
        limits = [(share[self._elements] - LEAST_AREA, sp.csr_array(slopes[self._elements]))]
        low, high = self._move.block_mass
        mass, by_place = np.asarray(self._masses @ share), sp.csr_array(self._masses @ slopes)
        if low:
            limits.append((mass / low - 1.0, sp.csr_array(by_place * (1.0 / low))))
        if high is not None:
            limits.append((1.0 - mass / high, sp.csr_array(by_place * (-1.0 / high))))
        return limits


def _volume(mesh: SpatialMesh, places: Floats, element: int) -> tuple[float, Floats]:
    """Compute the volume of an element, and its derivatives (k, 3) by its k corners."""
    corners = mesh.corners[element]
    middle = places[corners].mean(axis=0)
    position = {int(vertex): k for k, vertex in enumerate(corners)}
    volume, rates = 0.0, np.zeros((len(corners), 3))
    for ring in mesh.rings[element]:
        for second, third in itertools.pairwise(ring[1:]):
            rows = [position[int(v)] for v in (ring[0], second, third)]
            x, y, z = places[[ring[0], second, third]] - middle
            volume += float(x @ np.cross(y, z)) / 6.0
            rates[rows] += np.array([np.cross(y, z), np.cross(z, x), np.cross(x, y)]) / 6.0
    return volume, rates  # the middle drops out, since the surface is closed


def spatial_variables(assembly: Assembly, mesh: SpatialMesh, move: scene_move.Move) -> Variables:
    """Choose the variables of a structure in space: corners of joints that slide along edges."""
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
    vertices = np.array([entry[0] for entry in chosen], dtype=np.int64)
    directions = np.array([entry[1] for entry in chosen]).reshape(-1, 3)
    variables = Variables(
        mesh.places, vertices, directions, np.full_like(directions, np.nan), np.zeros((0, len(vertices)))
    )
    variables = Variables(**{**vars(variables), "ties": ties_of(variables, assembly, move)})
    if not variables.basis.shape[1]:
        raise InputError("move", "no corner of a joint can move", 'joints with four edges across, or "along"')
    return variables


def _joint_corners(assembly: Assembly, mesh: SpatialMesh, held: Bools, named: set[int]) -> list[tuple[int, Floats]]:
    """Return vertex and unit sliding direction (3,) of each corner that belongs to one joint."""
    # Each of the two elements must have exactly one edge from the corner across the joint, at more than 60° to one
    # another.
    faces, owner, edges = assembly.interfaces, *mesh.edges
    count = np.bincount(np.concatenate(mesh.polygons), minlength=len(mesh.places))
    corners = []
    for face, polygon in enumerate(mesh.polygons):
        for vertex in polygon.tolist():
            if held[vertex] or vertex in named or count[vertex] != 1:
                continue
            directions = []
            for element in (int(faces.a[face]), int(faces.b[face])):
                ends = edges[(owner == element) & (edges[:, 0] == vertex), 1]
                across = np.setdiff1d(ends, polygon)
                if len(across) == 1:
                    edge = mesh.places[across[0]] - mesh.places[vertex]
                    directions.append(edge / np.linalg.norm(edge))
            if len(directions) == 2:
                sliding = directions[1] - directions[0]
                if (length := float(np.linalg.norm(sliding))) > 1.0:
                    corners.append((vertex, sliding / length))
    return corners


def _require_corners(mesh: SpatialMesh, assembly: Assembly, moving: set[int]) -> None:
    """Raise InputError for a moving joint that is not a whole face of both elements."""
    faces = assembly.interfaces
    for face, polygon in enumerate(mesh.polygons):
        corners = set(polygon.tolist())
        if not corners & moving:
            continue
        for element in (int(faces.a[face]), int(faces.b[face])):
            if not any(set(ring.tolist()) == corners for ring in mesh.rings[element]):
                problem = f"the joint of {assembly.pair(face)} is no whole face of {assembly.elements.ids[element]!r}"
                raise InputError("move", problem, "joints that are whole faces of both elements in space")
