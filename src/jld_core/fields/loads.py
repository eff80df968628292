"""Loads of cells as body forces and tractions with the resultants of the scene.

Rules: docs/method.md (9.5). Self-weight and body loads are uniform in each cell. A force on a free face of its cell is
a traction on that face or on a patch of it. All other forces and moments are body forces that are constant in each
triangle of the coarsest mesh, so that refinement never changes the load.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.mesh import Mesh, coarse_mesh
from jld_core.fields.outlines import FREE, Outlines, outlines_of

_LEAST_PATCH = 0.02
"""Least length of a patch, relative to its free face. A shorter one means a force at an end of the face."""


_COVER = 1e-5
"""Relative difference between the length of an interface and that of its edges, above which the mesh does not fit
it."""


@dataclass(frozen=True)
class Segment:
    """Part of a free edge of a cell that carries a linear live traction.

    cell: element. ends: (2, 2) start and end, scene units; the cell lies on the left from start to end. traction: (2,
    2) stress vectors at both ends for λ = 1, scene units.
    """

    cell: int
    ends: Floats
    traction: Floats


@dataclass(frozen=True)
class FieldLoads:
    """Loads of an assembly over its coarsest mesh, scene units.

    dead, live: (r, 2) force per volume in each of the r triangles of the coarsest mesh, live for λ = 1. segments: parts
    of free edges with live traction; number i has the tag m + i in the mesh, m interfaces.
    """

    dead: Floats
    live: Floats
    segments: tuple[Segment, ...]


@dataclass(frozen=True)
class _FreeFace:
    """Straight run of free outline edges of a cell.

    cell: element. start: (2,) first point. along: (2,) unit direction, the cell on its left. length: of the run. All
    are in scene units.
    """

    cell: int
    start: Floats
    along: Floats
    length: float


@dataclass(frozen=True)
class _Force:
    """Live force on a free face, scene units.

    at: distance of its place from the start of the face. vector: (2,). width: of its patch, None where none is stated.
    """

    at: float
    vector: Floats
    width: float | None


_Piece = tuple[float, float, Floats]
"""Part of a free face, from and to a distance from its start, with the tractions (2, 2) at its ends."""


def thickness_of(assembly: Assembly) -> float:
    """Return the out-of-plane thickness of a planar assembly, scene units."""
    return float(assembly.interfaces.l2[0])


def loaded_mesh(assembly: Assembly, patch: float | None = None) -> tuple[Mesh, FieldLoads]:
    """Return the coarsest mesh of an assembly with its loads.

    Parameters
    ----------
    assembly : Assembly
        Planar assembly with one load case.
    patch : float, optional
        Length of the patch that each live force without a width of its own is spread on, centred at its place. By
        default all of these on one face become one linear traction: over the whole face where the resultant lies within
        its middle third, else uniform over the largest part of the face that is centred at the resultant.

    Returns
    -------
    mesh : Mesh
        Edges of interfaces and of loaded segments are tagged.
    loads : FieldLoads
        Forces per volume and tractions.

    Raises
    ------
    InputError
        A force on the outline of its cell without a free face, or without room for its patch.
    """
    segments, rest = live_segments(assembly, patch)
    ends = np.array([end for segment in segments for end in segment.ends]).reshape(-1, 2)
    coarse = coarse_mesh(outlines_of(assembly, ends))
    mesh = _tagged(coarse, segments, len(assembly.interfaces))
    return mesh, loads_on(assembly, mesh, segments, rest)


def live_segments(assembly: Assembly, patch: float | None = None) -> tuple[list[Segment], Floats]:
    """Return the parts of free faces with live tractions, and the live loads that they leave.

    patch: as for `loaded_mesh`. The second result (n, 3) holds forces and moments about centroids, scene units. Raises
    InputError as `loaded_mesh` does.
    """
    plain = outlines_of(assembly)
    faces = [face for cell in range(len(plain.cells)) for face in _free_faces(plain, cell)]
    chosen: dict[int, list[_Force]] = {}
    taken = np.zeros_like(assembly.live)
    for place, vector, width in _points(assembly):
        found = _face_of(assembly, faces, place, vector, taken)
        if found is None:
            if width is not None:
                raise InputError(
                    "loads.live",
                    f"the force at ({place[0]:g}, {place[1]:g}) has a width and no free face",
                    "a place on a free face of the element, or no width",
                )
            continue
        face = faces[found]
        at = float((place - face.start) @ face.along)
        chosen.setdefault(found, []).append(_Force(at, vector, patch if width is None else width))
        arm = place - assembly.elements.centroid[face.cell]
        taken[face.cell] += (*vector, arm[0] * vector[1] - arm[1] * vector[0])
    segments: list[Segment] = []
    for index, forces in chosen.items():
        segments += _segments(assembly, faces[index], forces)
    rest = assembly.live - taken
    gross = abs(assembly.live) + abs(taken)
    gross[:, 2] += gross[:, :2].sum(axis=1) * assembly.size
    rest[abs(rest) <= tolerances.ROUNDING * gross] = 0.0
    return segments, rest


def loads_on(assembly: Assembly, mesh: Mesh, segments: list[Segment], rest: Floats) -> FieldLoads:
    """Return the loads of an assembly over its coarsest mesh.

    mesh: coarsest mesh, its edges on segments tagged. segments, rest: as `live_segments` returns them. Raises
    InputError for a flat triangle, and for an interface off the outlines of its cells.
    """
    _require_cover(assembly, mesh)
    return FieldLoads(_body(assembly, mesh, assembly.dead), _body(assembly, mesh, rest), tuple(segments))


def _require_cover(assembly: Assembly, mesh: Mesh) -> None:
    """Raise InputError for an interface off the outlines of its cells, or a flat triangle."""
    flat = np.flatnonzero(mesh.area <= 0.0)
    if flat.size:
        name = assembly.elements.ids[int(mesh.cell[flat[0]])]
        raise InputError(f"element {name!r}", "its outline cannot be filled with triangles", "a plainer outline")
    faces, e, support = assembly.interfaces, mesh.edges, assembly.elements.support
    joined = (e.tag >= 0) & (e.tag < len(faces))
    paired = (e.b >= 0) | (support[faces.a] | support[faces.b])[np.where(joined, e.tag, 0)]
    length = np.bincount(e.tag[joined & paired], e.length[joined & paired], minlength=len(faces))
    off = np.flatnonzero(abs(length - faces.l1) > _COVER * faces.l1)
    if off.size or not paired[joined].all():
        face = int(off[0]) if off.size else int(e.tag[joined & ~paired][0])
        raise InputError(
            f"interface {assembly.pair(face)}",
            "it does not lie on the outlines of both elements",
            "interfaces found from the elements, without stated ones",
        )


def _points(assembly: Assembly) -> list[tuple[Floats, Floats, float | None]]:
    """Return place (2,), vector (2,) and stated width or None of each live point force."""
    widths = assembly.live_widths or (None,) * len(assembly.live_points)
    return [
        (np.array(place, dtype=float), np.array(vector, dtype=float), width)
        for (place, vector), width in zip(assembly.live_points, widths, strict=True)
    ]


def _free_faces(outlines: Outlines, index: int) -> list[_FreeFace]:
    """Return the straight runs of free edges of outline number `index`."""
    ring, tags = outlines.rings[index], outlines.tags[index]
    places = outlines.points[ring]
    step = np.roll(places, -1, axis=0) - places
    along = step / np.hypot(*step.T)[:, None]
    count = len(ring)
    joined = [
        tags[k] == FREE and tags[k - 1] == FREE and along[k] @ along[k - 1] > 1.0 - tolerances.CONTACT
        for k in range(count)
    ]
    faces = []
    for k in range(count):
        if tags[k] != FREE or joined[k]:
            continue
        end = k + 1
        while joined[end % count]:
            end += 1
        run = places[end % count] - places[k]
        length = float(np.hypot(*run))
        faces.append(_FreeFace(int(outlines.cells[index]), places[k], run / length, length))
    return faces


def _face_of(assembly: Assembly, faces: list[_FreeFace], place: Floats, vector: Floats, taken: Floats) -> int | None:
    """Return the index of the free face that a live force acts on; None if inside a cell.

    place, vector: (2,) of the force. taken: (n, 3) live forces that faces took before. Of several faces, one of the
    cell whose remaining live force is nearest to `vector` is taken, then the steepest push. Raises InputError for a
    force on the outline of a cell without a free face there.
    """
    reach = tolerances.ON_OUTLINE * assembly.size
    loaded = [int(cell) for cell in assembly.elements.free if assembly.live[cell].any()]
    point = shapely.Point(*place)
    near = [cell for cell in loaded if shapely.Polygon(assembly.elements.shape[cell]).distance(point) <= reach]
    if not near:
        return None
    for cell in near:
        if shapely.Polygon(assembly.elements.shape[cell]).exterior.distance(point) > reach:
            return None

    def misfit(cell: int) -> float:
        """Return the distance of a cell's remaining live force from the vector."""
        return float(np.hypot(*(assembly.live[cell, :2] - taken[cell, :2] - vector)))

    def push(face: _FreeFace) -> float:
        """Return the size of the component of the force normal to a face."""
        return float(abs(vector[0] * face.along[1] - vector[1] * face.along[0]))

    best: tuple[float, float, int] | None = None
    for index, face in enumerate(faces):
        away = place - face.start
        off, at = abs(away[0] * face.along[1] - away[1] * face.along[0]), float(away @ face.along)
        if face.cell in near and off <= reach and -reach <= at <= face.length + reach:
            key = (misfit(face.cell), -push(face), index)
            best = key if best is None or key < best else best
    if best is None:
        raise InputError(
            f"element {assembly.elements.ids[near[0]]!r}",
            f"a live force acts on its outline at ({place[0]:g}, {place[1]:g}), where it has no free face",
            "a force on a free face or inside the element",
        )
    return best[2]


def _segments(assembly: Assembly, face: _FreeFace, forces: list[_Force]) -> list[Segment]:
    """Return the loaded segments of one free face, split and summed where loads overlap.

    forces: live forces on the face, with or without a stated width. Raises InputError where one has no room.
    """
    pieces = [_stated(assembly, face, force, force.width) for force in forces if force.width is not None]
    plain = [force for force in forces if force.width is None]
    if plain:
        pieces.append(_spread(assembly, face, plain))
    if len(pieces) == 1:
        low, high, ends = pieces[0]
        return [_segment(face, low, high, ends)]
    reach = tolerances.ON_OUTLINE * assembly.size
    cuts = sorted(end for piece in pieces for end in piece[:2])
    segments = []
    for low, high in pairwise(cuts):
        over = [one for one in pieces if one[0] <= 0.5 * (low + high) <= one[1]]
        if high - low > reach and over:
            segments.append(
                _segment(face, low, high, sum((_between(one, low, high) for one in over), np.zeros((2, 2))))
            )
    return segments


def _between(piece: _Piece, low: float, high: float) -> Floats:
    """Interpolate the tractions (2, 2) of a piece at distances `low`, `high` along its face."""
    start, stop, ends = piece
    shares = (np.array([low, high]) - start) / (stop - start)
    return np.asarray(ends[0] * (1.0 - shares[:, None]) + ends[1] * shares[:, None])


def _spread(assembly: Assembly, face: _FreeFace, forces: list[_Force]) -> _Piece:
    """Spread forces without a stated width over one face as a linear traction.

    It covers the face. If forces of one sign have their resultant beyond the middle third, it is uniform about the
    resultant instead. Raises InputError without room for that.
    """
    thickness = thickness_of(assembly)
    normal = np.array([face.along[1], -face.along[0]])
    total = np.sum([force.vector for force in forces], axis=0)
    push = [float(force.vector @ normal) for force in forces]
    moment = sum(p * (force.at - 0.5 * face.length) for p, force in zip(push, forces, strict=True))
    gross = float(np.sum(np.abs(push)))
    one_sign = gross > 0.0 and abs(sum(push)) >= gross * (1.0 - tolerances.ROUNDING)
    offset = moment / sum(push) if one_sign else 0.0
    if one_sign and abs(offset) > face.length * (1.0 / 6.0 + tolerances.CONTACT):
        middle, half = 0.5 * face.length + offset, 0.5 * face.length - abs(offset)
        if 2.0 * half < _LEAST_PATCH * face.length:
            raise _no_room(assembly, face, middle)
        traction = total / (2.0 * half * thickness)
        return middle - half, middle + half, np.array([traction, traction])
    mean = total / (face.length * thickness)
    lean = 6.0 * moment / (face.length**2 * thickness) * normal
    return 0.0, face.length, np.array([mean - lean, mean + lean])


def _stated(assembly: Assembly, face: _FreeFace, force: _Force, width: float) -> _Piece:
    """Return a uniform patch of stated width about one force; raise InputError without room."""
    reach = tolerances.ON_OUTLINE * assembly.size
    low, high = force.at - 0.5 * width, force.at + 0.5 * width
    if low < -reach or high > face.length + reach:
        raise _no_room(assembly, face, force.at)
    traction = force.vector / (width * thickness_of(assembly))
    return max(0.0, low), min(face.length, high), np.array([traction, traction])


def _segment(face: _FreeFace, low: float, high: float, traction: Floats) -> Segment:
    """Return the segment of a face from distance `low` to `high`; traction: (2, 2) at both."""
    ends = np.array([face.start + low * face.along, face.start + high * face.along])
    return Segment(face.cell, ends, traction)


def _no_room(assembly: Assembly, face: _FreeFace, at: float) -> InputError:
    """Return the error for a patch that does not fit; at: distance from the start."""
    place = face.start + at * face.along
    return InputError(
        f"element {assembly.elements.ids[face.cell]!r}",
        f"the free face of {face.length:g} has no room for the patch of the live force at ({place[0]:g}, {place[1]:g})",
        "a force farther from the ends of the face, or a shorter patch",
    )


def _tagged(mesh: Mesh, segments: list[Segment], faces: int) -> Mesh:
    """Tag the free outline edges of a mesh that lie on loaded segments.

    faces: number of interfaces. Segment i gets the tag faces + i.
    """
    unique, number = mesh.sides
    pairs, tags = [mesh.tagged], [mesh.tag]
    for index, segment in enumerate(segments):
        along = segment.ends[1] - segment.ends[0]
        length = float(np.hypot(*along))
        for t, k in np.argwhere((mesh.side_tags[number] == FREE) & (mesh.cell == segment.cell)[:, None]).tolist():
            edge = unique[number[t, k]]
            middle = mesh.points[edge].mean(axis=0) - segment.ends[0]
            off = abs(middle[0] * along[1] - middle[1] * along[0]) / length
            if off <= 1e-6 * length and 0.0 < middle @ along < length * length:
                pairs.append(edge[None])
                tags.append(np.array([faces + index]))
    return Mesh(
        mesh.points, mesh.triangles, mesh.cell, mesh.root, np.concatenate(pairs), np.concatenate(tags).astype(np.int64)
    )


def _body(assembly: Assembly, mesh: Mesh, loads: Floats) -> Floats:
    """Spread loads on cells over their root triangles as forces per volume (t, 2).

    loads: (n, 3) forces and moments about the centroids of the elements, scene units. Force and moment of each cell are
    kept.
    """
    thickness = thickness_of(assembly)
    middle = mesh.corners.mean(axis=1)
    body = np.zeros((len(mesh), 2))
    for cell in np.unique(mesh.cell).tolist():
        if not loads[cell].any():
            continue
        own = np.flatnonzero(mesh.cell == cell)
        area = mesh.area[own]
        centroid = area @ middle[own] / area.sum()
        force = loads[cell, :2]
        arm = assembly.elements.centroid[cell] - centroid
        moment = loads[cell, 2] + arm[0] * force[1] - arm[1] * force[0]
        body[own] = force / (area.sum() * thickness)
        away = middle[own] - centroid
        if abs(moment) > tolerances.ROUNDING * np.hypot(*force) * np.sqrt(area.sum()):
            spin = moment / (thickness * float(area @ (away**2).sum(axis=1)))
            body[own] += spin * np.column_stack([-away[:, 1], away[:, 0]])
    return body
