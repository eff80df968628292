"""Shape limits of blocks: values, bounds, and derivatives by the positions of vertices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly, blocks_of
from jld_core.errors import InputError
from jld_core.scene import PointLoad, Scene
from jld_core.scene.loads import FaceLoad, LoadEntry
from jld_core.scene.move import Move
from jld_geometry.convex_cells import EqualShapes, VertexMesh, equal_corners
from jld_geometry.spatial_rates import AreaRates, area_rates

EDGE: Final = 0.15
"""Default of the least length of an edge, relative to the mean edge of all free elements."""

LEAST_AREA: Final = 0.05
"""Least area of an element, relative to its area at the start."""

_KEPT: Final = 0.98  # share of its value at the start that a limit requires if the start violates the limit

_STRAIGHT: Final = 1e-6  # deviation from 180°, rad, up to which an angle of an element is straight

_BEND: Final = np.radians(11.0)  # largest bend of a block face at the end of a joint where "straight" is false, rad


@dataclass(frozen=True)
class LimitValues:
    """Values of all r limits at one position of v vertices, and their derivatives."""

    values: Floats  # (r,) dimensionless values, each to be at least `Limits.least`, or equal to it where `Limits.equal`
    rates: sp.csr_array  # (r, 2v) derivatives by the positions of vertices, column 2·vertex + axis


class Limits:
    """Limits on the geometry of planar joints: r functions with least or exact values.

    They limit angles, edges, areas, masses, draft, equal shapes and places of loads.

    A limit that the start violates is relaxed to its value at the start.

    scene: scene with its loads. labels: (m,) True = dry. mesh: vertices at the start. moving: (v,) True for the
    vertices that move; limits of others are left out. move: limits of the user. least: (r,) least values,
    dimensionless. equal: (r,) True where the value is to be kept exactly.
    """

    def __init__(
        self, scene: Scene, assembly: Assembly, labels: Bits, mesh: VertexMesh, moving: Bools, move: Move
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
        loops = [loop for loop, one in zip(mesh.loops, free.tolist(), strict=True) if one]
        every = [np.column_stack([np.roll(loop, 1), loop, np.roll(loop, -1)]) for loop in loops]
        corners = np.concatenate(every)
        corners = corners[moving[corners].any(axis=1)]
        angle = _angle(mesh.places, corners)
        straight = abs(angle - np.pi) <= _STRAIGHT
        # a straight corner between vertices that slide on one line stays straight by itself; its row does no harm
        return corners[(angle < np.pi) & ~straight], corners[straight]

    def _equal(self, count: int) -> Bools:
        """Mark the limits (count,) that are equations: straight corners if required, equal shapes."""
        found = np.zeros(count, dtype=bool)
        if self._move.straight:
            found[: len(self._straight)] = True
        found[count - len(self._shapes) :] = True
        return found

    def at(self, places: Floats, *, drafted: bool = False) -> LimitValues:
        """Return the values of all limits and their derivatives at positions (v, 2)."""
        rates = area_rates(VertexMesh(places, self._mesh.loops, self._mesh.ends))
        parts = [self._of_straight(places), self._of_angles(places), self._of_edges(places), self._of_areas(rates)]
        parts += [
            self._of_masses(rates),
            self._of_loads(places),
            self._of_draft(places, drafted),
            self._shapes.at(places),
        ]
        values = np.concatenate([value for value, _ in parts])
        return LimitValues(values, sp.csr_array(sp.vstack([rates for _, rates in parts])))

    def _of_straight(self, places: Floats) -> tuple[Floats, sp.csr_array]:
        """Return deviations of straight corners from 180°, rad, and their derivatives.

        Where corners need not stay straight, the values are distances to the largest bend on either side.
        """
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

    def _of_edges(self, places: Floats) -> tuple[Floats, sp.csr_array]:
        """Return edge lengths over the least length, less 1, and their derivatives."""
        edge = places[self._edges[:, 1]] - places[self._edges[:, 0]]
        length = np.linalg.norm(edge, axis=1)
        along = edge / length[:, None] / self._edge
        columns = np.concatenate([2 * self._edges[:, :1] + np.arange(2), 2 * self._edges[:, 1:] + np.arange(2)], axis=1)
        return length / self._edge - 1.0, sparse_rows(np.concatenate([-along, along], axis=1), columns, places.size)

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
        if drafted:
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
    """Return the derivatives (c, 2v) of the angles at corners."""
    before, after = places[corners[:, 0]] - places[corners[:, 1]], places[corners[:, 2]] - places[corners[:, 1]]
    one = np.column_stack([-before[:, 1], before[:, 0]]) / np.einsum("ij,ij->i", before, before)[:, None]
    two = np.column_stack([-after[:, 1], after[:, 0]]) / np.einsum("ij,ij->i", after, after)[:, None]
    columns = (2 * corners[:, :, None] + np.arange(2)).reshape(len(corners), 6)
    return sparse_rows(np.concatenate([one, two - one, -two], axis=1), columns, places.size)


def sparse_rows(values: Floats, columns: Ints, size: int) -> sp.csr_array:
    """Make a sparse matrix (k, size) from values (k, j) and their columns (k, j)."""
    rows = np.repeat(np.arange(len(values)), values.shape[1])
    return sp.csr_array((values.ravel(), (rows, columns.ravel())), shape=(len(values), size))


def mass_rows(assembly: Assembly, labels: Bits, changing: Bools) -> sp.csr_array:
    """Return the masses (b, n) of the elements in blocks that change, by block.

    A row holds the masses of one block's elements, zeros elsewhere. Blocks that hold a support or no changing element
    have no row. labels: (m,) True = dry. changing: (n,) True for elements with a vertex that moves.
    """
    elements = assembly.elements
    block = blocks_of(assembly, labels)
    grounded = np.isin(block, block[elements.support])
    numbers = np.unique(block[changing & ~grounded])
    members = np.flatnonzero(np.isin(block, numbers))
    place = np.searchsorted(numbers, block[members])
    return sp.csr_array((elements.mass[members], (place, members)), shape=(len(numbers), len(elements)))


def _loads_on_edges(scene: Scene, assembly: Assembly, mesh: VertexMesh) -> list[tuple[Floats, int, int, float]]:
    """Return place (2,), edge and half width of each point load on its element's outline.

    Raises InputError as `loads_that_move`.
    """
    # An edge is given by its first and last vertex. Loads inside elements are left out; half widths are 0 where none is
    # stated.
    found = []
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
            found.append((point, int(corners[k]), int(np.roll(corners, -1)[k]), 0.5 * (entry.width or 0.0)))
    return found


def loads_that_move(scene: Scene) -> list[LoadEntry]:
    """Return all entries of the loads of a scene, if each keeps its meaning while joints move.

    Raises InputError for fill, moving loads and pressure on faces.
    """
    loads = scene.loads
    entries: list[LoadEntry] = [*loads.dead, *(loads.live or [])]
    for case in loads.cases or []:
        entries += [*case.dead, *case.live]
    if scene.fill is not None:
        raise InputError("fill", "its loads do not move with the joints", "point loads in place of it")
    if loads.moving:
        raise InputError("loads.moving", "its places do not move with the joints", '"cases" with point loads')
    if any(isinstance(entry, FaceLoad) for entry in entries):
        raise InputError("loads", "pressure on faces does not move with its joints", "point loads and body loads")
    return entries


def _corners_alone(loop: Ints, places: Floats) -> Ints:
    """Return the vertices of a loop without those at which it is straight; places: (v, 2)."""
    angle = _angle(places, np.column_stack([np.roll(loop, 1), loop, np.roll(loop, -1)]))
    return loop[abs(angle - np.pi) > _STRAIGHT]
