"""Loads of cells as body forces and tractions with the resultants of the scene, docs/method.md (9.5).

Forces that no free face takes are constant in each triangle of the coarsest mesh, so that refinement never changes the
load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.mesh import FREE, Mesh, Outlines, coarse_mesh, outlines_of, patch_tag
from jld_core.loads import Loads, Traction, resultants

# Least length of a patch, relative to its free face. A shorter one means a force at an end of the face.
_LEAST_PATCH = 0.02


# Relative difference between the length of an interface and that of its edges, above which the mesh does not fit it
_COVER, _COVER_IN_SPACE = 1e-5, 1e-4


@dataclass(frozen=True)
class Segment:
    """Part of a free edge of a cell that carries linear tractions."""

    cell: int  # element
    ends: Floats  # (2, 2) start and end, scene units; the cell lies on the left from start to end
    # dead, live: (2, 2) stress vectors at both ends, live for λ = 1, scene units
    dead: Floats
    live: Floats

    def at(self, places: Floats) -> Floats:
        """Return the dead and live stress vectors (2, ..., 2) at places (..., 2)."""
        direction = self.ends[1] - self.ends[0]
        share = ((places - self.ends[0]) @ direction / (direction @ direction))[..., None]
        return np.stack([ends[0] * (1.0 - share) + ends[1] * share for ends in (self.dead, self.live)])


@dataclass(frozen=True)
class PatchLoad:
    """Linear tractions on a patch of a free face in space, scene units."""

    cell: int  # element
    origin: Floats  # (3,) reference point
    mean: Floats  # (2, 3) dead stress vector there, and live one for λ = 1
    slope: Floats  # (2, 3, 3) their derivatives; column k by coordinate k

    def at(self, places: Floats) -> Floats:
        """Return the dead and live stress vectors (2, ..., 3) at places (..., 3)."""
        offset = places - self.origin
        return np.stack([mean + offset @ slope.T for mean, slope in zip(self.mean, self.slope, strict=True)])


@dataclass(frozen=True)
class FieldLoads:
    """Loads of an assembly over its coarsest mesh, scene units."""

    # dead, live: (r, d) force per volume in each of the r simplices of the coarsest mesh, live for λ = 1
    dead: Floats
    live: Floats
    tractions: tuple[Segment | PatchLoad, ...]  # number i acts on the sides with tag `patch_tag(i)`


@dataclass(frozen=True)
class _FreeFace:
    """Straight run of free outline edges of a cell, scene units."""

    cell: int  # element
    start: Floats  # (2,) first point
    along: Floats  # (2,) unit direction, the cell on its left
    length: float  # of the run


@dataclass(frozen=True)
class _Force:
    at: float  # distance of its place from the start of the face
    vector: Floats  # (2,)
    width: float | None  # of its patch, None where none is stated


class _Piece(NamedTuple):
    """Part of a free face, from and to a distance from its start, with the tractions (2, 2) at its ends."""

    low: float
    high: float
    ends: Floats


def thickness_of(assembly: Assembly) -> float:
    """Return the out-of-plane thickness of a planar assembly, scene units."""
    return float(assembly.interfaces.l2[0])


def loaded_mesh(assembly: Assembly, patch: float | None = None) -> tuple[Mesh, FieldLoads]:
    """Return the coarsest mesh, tagged, with body forces and tractions; InputError for a force without face or room."""
    outlines = outlines_of(assembly)
    segments, remainder = loaded_segments(assembly, patch, outlines)
    ends = np.array([end for segment in segments for end in segment.ends]).reshape(-1, 2)
    coarse = coarse_mesh(outlines_of(assembly, ends) if len(ends) else outlines)
    mesh = _tag_loaded_edges(coarse, segments)
    return mesh, loads_on(assembly, mesh, segments, remainder)


def loaded_segments(
    assembly: Assembly, patch: float | None = None, outlines: Outlines | None = None
) -> tuple[list[Segment], tuple[Floats, Floats]]:
    """Return the parts of free faces with tractions, and the loads (n, 3) that they leave.

    outlines: those of the assembly, if known. InputError as `loaded_mesh`.
    """
    outlines = outlines or outlines_of(assembly)
    faces = [face for cell in range(len(outlines.cells)) for face in _free_faces(outlines, cell)]
    dead, dead_remainder = _pieces(assembly, faces, assembly.dead_loads, patch)
    live, live_remainder = _pieces(assembly, faces, assembly.live_loads, patch)
    segments: list[Segment] = []
    for index in sorted({*dead, *live}):
        segments += _segments(assembly, faces[index], dead.get(index, []), live.get(index, []))
    return segments, (dead_remainder, live_remainder)


def _pieces(
    assembly: Assembly, faces: list[_FreeFace], loads: Loads, patch: float | None
) -> tuple[dict[int, list[_Piece]], Floats]:
    """Return the tractions on free faces, by the index of the face, and the rest (n, 3) of the loads."""
    pieces: dict[int, list[_Piece]] = {}
    for traction in loads.tractions:
        index, piece = _pressed_face(assembly, faces, traction)
        pieces.setdefault(index, []).append(piece)
    # forces without a width by their face, and points of loads on no free face: these stay body forces
    points, without_width = loads.points, dict[int, list[_Force]]()
    inside = np.ones(len(points), dtype=bool)
    for k, (cell, place, vector) in enumerate(zip(points.element, points.at, points.force, strict=True)):
        width = None if np.isnan(points.width[k]) else float(points.width[k])
        at_face = _face_of(assembly, faces, int(cell), place, vector)
        if at_face is None:
            if width is not None:
                raise InputError(
                    f"element {assembly.elements.ids[cell]!r}",
                    f"the force at ({place[0]:g}, {place[1]:g}) has a width and no free face",
                    "a place on a free face of the element, or no width",
                )
            continue
        inside[k] = False
        face = faces[at_face]
        force = _Force(float((place - face.start) @ face.along), vector, patch if width is None else width)
        if force.width is None:
            without_width.setdefault(at_face, []).append(force)
        else:
            pieces.setdefault(at_face, []).append(_patch_of_width(assembly, face, force, force.width))
    for index, forces in without_width.items():
        pieces.setdefault(index, []).append(_spread(assembly, faces[index], forces))
    body_points = replace(points, **{name: values[inside] for name, values in vars(points).items()})
    return pieces, resultants(replace(loads, points=body_points, tractions=()), assembly.elements)


def _pressed_face(assembly: Assembly, faces: list[_FreeFace], traction: Traction) -> tuple[int, _Piece]:
    """Return the index of the free face that a traction acts on, and its part; InputError if none."""
    reach = 2.0 * tolerances.ON_OUTLINE * assembly.size
    ends = traction.rings[0]
    for index, face in enumerate(faces):
        if face.cell != traction.element:
            continue
        offset = ends - face.start
        distances, height = offset @ face.along, offset[:, 0] * face.along[1] - offset[:, 1] * face.along[0]
        if abs(height).max() <= reach and distances.min() >= -reach and distances.max() <= face.length + reach:
            low, high = (min(max(float(place), 0.0), face.length) for place in np.sort(distances))
            end_points = face.start + np.array([[low], [high]]) * face.along
            return index, _Piece(low, high, traction.at(end_points) / thickness_of(assembly))
    (x, y), (u, v) = ends
    raise InputError(
        f"element {assembly.elements.ids[traction.element]!r}",
        f"the load from ({x:g}, {y:g}) to ({u:g}, {v:g}) lies on no free face",
        "a load on free boundary",
    )


def loads_on(assembly: Assembly, mesh: Mesh, segments: list[Segment], rest: tuple[Floats, Floats]) -> FieldLoads:
    """Return the loads over the coarsest mesh; InputError as `require_cover`."""
    require_cover(assembly, mesh)
    return FieldLoads(body_forces(assembly, mesh, rest[0]), body_forces(assembly, mesh, rest[1]), tuple(segments))


def require_cover(assembly: Assembly, mesh: Mesh) -> None:
    """Raise InputError for an interface off the boundary of one of its cells, or a flat simplex."""
    planar = mesh.dimension == 2
    flat = np.flatnonzero(mesh.volume <= 0.0)
    if flat.size:
        name = assembly.elements.ids[int(mesh.cell[flat[0]])]
        words = ("its outline", "triangles", "outline") if planar else ("it", "tetrahedra", "element")
        raise InputError(f"element {name!r}", f"{words[0]} cannot be filled with {words[1]}", f"a plainer {words[2]}")
    faces, sides, support = assembly.interfaces, mesh.sides, assembly.elements.support
    on_interface = sides.tag >= 0
    face_of_side = np.where(on_interface, sides.tag, 0)
    # an interface has a cell on both sides, one at a support on one
    paired = (sides.b >= 0) != (support[faces.a] | support[faces.b])[face_of_side]
    covered = np.bincount(face_of_side[on_interface & paired], sides.area[on_interface & paired], minlength=len(faces))
    size, cover = (faces.l1, _COVER) if planar else (faces.area, _COVER_IN_SPACE)
    wrong = np.flatnonzero((abs(covered - size) > cover * size) & ~(support[faces.a] & support[faces.b]))
    if wrong.size or not paired[on_interface].all():
        face = int(wrong[0]) if wrong.size else int(face_of_side[on_interface & ~paired][0])
        problem = f"it does not lie on the {'outlines' if planar else 'faces'} of both elements"
        remedy = "interfaces found from the elements, without stated ones"
        raise InputError(f"interface {assembly.pair(face)}", problem, remedy)


def _free_faces(outlines: Outlines, index: int) -> list[_FreeFace]:
    """Return the straight runs of free edges of outline number `index`."""
    ring, tags = outlines.rings[index], outlines.tags[index]
    corners = outlines.points[ring]
    edge = np.roll(corners, -1, axis=0) - corners
    direction = edge / np.hypot(*edge.T)[:, None]
    count = len(ring)
    # True where a free edge continues the one before it
    continues = [
        tags[k] == FREE and tags[k - 1] == FREE and direction[k] @ direction[k - 1] > 1.0 - tolerances.CONTACT
        for k in range(count)
    ]
    faces = []
    for k in range(count):
        if tags[k] != FREE or continues[k]:
            continue
        end = k + 1
        while continues[end % count]:
            end += 1
        chord = corners[end % count] - corners[k]
        length = float(np.hypot(*chord))
        faces.append(_FreeFace(int(outlines.cells[index]), corners[k], chord / length, length))
    return faces


def _face_of(assembly: Assembly, faces: list[_FreeFace], cell: int, place: Floats, vector: Floats) -> int | None:
    """Return the free face of a cell that a force (2,) acts on, None if none.

    InputError on outlines where it is not clear.
    """
    reach = tolerances.ON_OUTLINE * assembly.size
    if shapely.Polygon(assembly.elements.shape[cell]).exterior.distance(shapely.Point(*place)) > reach:
        return None
    candidates: list[tuple[float, int]] = []
    for index, face in enumerate(faces):
        offset = place - face.start
        height, distance = abs(offset[0] * face.along[1] - offset[1] * face.along[0]), float(offset @ face.along)
        if face.cell == cell and height <= reach and -reach <= distance <= face.length + reach:
            candidates.append((float(abs(vector[0] * face.along[1] - vector[1] * face.along[0])), index))
    if not candidates:
        raise InputError(
            f"element {assembly.elements.ids[cell]!r}",
            f"a force acts on its outline at ({place[0]:g}, {place[1]:g}), where it has no free face",
            "a force on a free face or inside the element",
        )
    return steepest(candidates, assembly.elements.ids[cell], place)


def steepest(candidates: list[tuple[float, int]], element: str, place: Floats) -> int:
    """Return the number of the largest push among (push, number); InputError for two alike."""
    (push, number), *lesser = sorted(candidates, reverse=True)
    if lesser and lesser[0][0] >= push * (1.0 - tolerances.CONTACT):
        place_text = ", ".join(f"{value:g}" for value in place)
        raise InputError(
            f"element {element!r}",
            f"the force at ({place_text}) is as steep on two free faces, and would be spread over either",
            "a place on one of them, or another direction",
        )
    return number


def _segments(assembly: Assembly, face: _FreeFace, dead: Sequence[_Piece], live: Sequence[_Piece]) -> list[Segment]:
    """Return the loaded segments of one free face, split and summed where loads overlap."""
    reach = tolerances.ON_OUTLINE * assembly.size
    breaks: list[float] = []
    for end in sorted(end for piece in (*dead, *live) for end in (piece.low, piece.high)):
        if not breaks or end - breaks[-1] > reach:
            breaks.append(end)
    segments = []
    for low, high in pairwise(breaks):
        middle = 0.5 * (low + high)
        pieces_here = [[piece for piece in pieces if piece.low <= middle <= piece.high] for pieces in (dead, live)]
        if any(pieces_here):
            ends = np.array([face.start + low * face.along, face.start + high * face.along])
            segments.append(Segment(face.cell, ends, *(_sum_of_tractions(pieces, low, high) for pieces in pieces_here)))
    return segments


def _sum_of_tractions(pieces: Sequence[_Piece], low: float, high: float) -> Floats:
    """Return the sum of tractions (2, 2) of pieces from `low` to `high` along their face."""
    total = np.zeros((2, 2))
    for start, stop, ends in pieces:
        shares = ((np.array([low, high]) - start) / (stop - start))[:, None]
        total += ends[0] * (1.0 - shares) + ends[1] * shares
    return total


def _spread(assembly: Assembly, face: _FreeFace, forces: list[_Force]) -> _Piece:
    """Spread forces without a width over one face as a linear traction; InputError without room."""
    # The traction covers the face. If forces of one sign have their resultant beyond the middle third, the traction is
    # uniform about the resultant instead.
    thickness = thickness_of(assembly)
    normal = np.array([face.along[1], -face.along[0]])
    total = np.sum([force.vector for force in forces], axis=0)
    pushes = [float(force.vector @ normal) for force in forces]
    moment = sum(p * (force.at - 0.5 * face.length) for p, force in zip(pushes, forces, strict=True))
    absolute_push = float(np.sum(np.abs(pushes)))
    one_sign = absolute_push > 0.0 and abs(sum(pushes)) >= absolute_push * (1.0 - tolerances.ROUNDING)
    offset = moment / sum(pushes) if one_sign else 0.0
    if one_sign and abs(offset) > face.length * (1.0 / 6.0 + tolerances.CONTACT):
        middle, half = 0.5 * face.length + offset, 0.5 * face.length - abs(offset)
        if 2.0 * half < _LEAST_PATCH * face.length:
            raise _no_room(assembly, face, middle)
        traction = total / (2.0 * half * thickness)
        return _Piece(middle - half, middle + half, np.array([traction, traction]))
    mean = total / (face.length * thickness)
    difference = 6.0 * moment / (face.length**2 * thickness) * normal
    return _Piece(0.0, face.length, np.array([mean - difference, mean + difference]))


def _patch_of_width(assembly: Assembly, face: _FreeFace, force: _Force, width: float) -> _Piece:
    """Return a uniform patch of stated width about one force; raise InputError without room."""
    reach = tolerances.ON_OUTLINE * assembly.size
    low, high = force.at - 0.5 * width, force.at + 0.5 * width
    if low < -reach or high > face.length + reach:
        raise _no_room(assembly, face, force.at)
    traction = force.vector / (width * thickness_of(assembly))
    return _Piece(max(0.0, low), min(face.length, high), np.array([traction, traction]))


def _no_room(assembly: Assembly, face: _FreeFace, at: float) -> InputError:
    """Return the error for a patch that does not fit; at: distance from the start."""
    place = face.start + at * face.along
    return InputError(
        f"element {assembly.elements.ids[face.cell]!r}",
        f"the free face of {face.length:g} has no room for the patch of the force at ({place[0]:g}, {place[1]:g})",
        "a force farther from the ends of the face, or a shorter patch",
    )


_ON_SEGMENT = 1e-6  # distance, relative to the length of a loaded segment, within which an edge lies on it


def _tag_loaded_edges(mesh: Mesh, segments: list[Segment]) -> Mesh:
    """Tag the free outline edges of a mesh that lie on loaded segments."""
    unique, number = mesh.side_nodes
    tagged, tags = [mesh.tagged], [mesh.tag]
    for index, segment in enumerate(segments):
        direction = segment.ends[1] - segment.ends[0]
        length = float(np.hypot(*direction))
        for t, k in np.argwhere((mesh.side_tags[number] == FREE) & (mesh.cell == segment.cell)[:, None]).tolist():
            edge = unique[number[t, k]]
            middle = mesh.points[edge].mean(axis=0) - segment.ends[0]
            height = abs(middle[0] * direction[1] - middle[1] * direction[0]) / length
            if height <= _ON_SEGMENT * length and 0.0 < middle @ direction < length * length:
                tagged.append(edge[None])
                tags.append(np.array([patch_tag(index)]))
    return replace(mesh, tagged=np.concatenate(tagged), tag=np.concatenate(tags).astype(np.int64))


def body_forces(assembly: Assembly, mesh: Mesh, loads: Floats) -> Floats:
    """Spread loads (n, 3 or 6) over root simplices as forces per volume (t, d) with the same resultants."""
    d = mesh.dimension
    thickness = thickness_of(assembly) if d == 2 else 1.0
    centres = mesh.corners.mean(axis=1)
    body = np.zeros((len(mesh), d))
    for cell in np.unique(mesh.cell).tolist():
        if not loads[cell].any():
            continue
        of_cell = np.flatnonzero(mesh.cell == cell)
        volume = mesh.volume[of_cell]
        centroid = volume @ centres[of_cell] / volume.sum()
        force, offset = loads[cell, :d], centres[of_cell] - centroid
        arm = assembly.elements.centroid[cell] - centroid
        body[of_cell] = force / (volume.sum() * thickness)
        # the moment is carried by forces as of a rotation, which have no resultant
        if d == 2:
            size, moment = np.sqrt(volume.sum()), loads[cell, 2:] + arm[0] * force[1] - arm[1] * force[0]
            spin = moment / (thickness * float(volume @ (offset**2).sum(axis=1)))
            rotation_force = spin * np.column_stack([-offset[:, 1], offset[:, 0]])
        else:
            size, moment = np.cbrt(volume.sum()), loads[cell, 3:] + np.cross(arm, force)
            square = np.einsum("t,ti,tj->ij", volume, offset, offset)
            inertia = np.einsum("t,ti,ti->", volume, offset, offset) * np.eye(3) - square
            rotation_force = np.cross(np.linalg.solve(inertia, moment), offset)
        if np.linalg.norm(moment) > tolerances.ROUNDING * size * np.linalg.norm(force):
            body[of_cell] += rotation_force
    return body
