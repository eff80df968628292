"""Parts of a cut solid: clearance, boxes, beds, numbers, arrows, tenons, and files that are read again."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Floats, InputError, Ints, ParameterError, checkpoint, files, time_left
from jld_core.geometry import unions
from jld_cut.cells import Joint, basis, closed, sides_of, union
from jld_cut.meshes import (
    as_read,
    as_single,
    as_written,
    doubled_edges,
    kind_of,
    manifold3d,
    moments,
    normals_of,
    obj_text,
    open_edges,
    pieces_of,
    stl_bytes,
    surface_of,
    volume_of,
    write_3mf,
)

_SPLINTER: Final = 1e-6  # of the volume of a part
_LOST: Final = 0.5  # share of its volume that clearance may take of a part
_TRUE: Final = 1e-6  # error of a volume that a file may have
_BEDS: Final = 12  # largest faces that a part may lie on


@dataclass
class Part:
    number: int  # from 1
    cells: list[int]
    exact: Any  # union of its cells
    solid: Any  # the same with clearance
    mass: float  # kg, without clearance
    box: Floats = field(default_factory=lambda: np.zeros(3))  # (3,) sides of its smallest box, ascending
    bed: Floats = field(default_factory=lambda: np.eye(3))  # (3, 3) rotation that lays it on the bed
    open: int = 0  # edges of its file that other than two faces meet at
    step: int = 0  # of the assembly at which it is laid, from 1; 0: not known
    direction: Floats = field(default_factory=lambda: np.zeros(3))  # (3,) in which it moves when it is laid
    marked: bool = False  # number and arrow are engraved
    error: float = 0.0  # of the volume in its file, or of what was cut, whichever is more

    @property
    def watertight(self) -> bool:
        return not self.open and self.error <= _TRUE

    @property
    def fault(self) -> str:
        edges = f"{self.open} edges that other than two faces meet at" if self.open else ""
        volume = f"a volume that differs by {self.error:.1e}" if self.error > _TRUE else ""
        return f"part {self.number} has {' and '.join(word for word in (edges, volume) if word)}"

    @property
    def name(self) -> str:
        return f"part_{self.number:02d}"


def parts_of(cells: list[Any], block: Ints, joints: list[Joint], density: float, clearance: float) -> list[Part]:
    """Return the parts of cells by their blocks (n,), numbered from 1, with clearance at dry joints."""
    names = sorted(set(block.tolist()))
    members = [np.flatnonzero(block == name).tolist() for name in names]
    exact = [union([cells[k] for k in group]) for group in members]
    index_of = {name: k for k, name in enumerate(names)}
    solids = list(exact)
    cleared: set[tuple[Any, ...]] = set()
    for joint in joints if clearance > 0.0 else ():
        a, b = index_of[int(block[joint.a])], index_of[int(block[joint.b])]
        key = (a, b, *np.round(joint.normal, 9).tolist())
        if a == b or key in cleared:
            continue
        cleared.add(key)
        move = 0.5 * clearance * joint.normal
        solids[a] -= exact[b].translate(tuple(-move))
        solids[b] -= exact[a].translate(tuple(move))
    parts = []
    for k, (group, exact_solid, solid) in enumerate(zip(members, exact, solids, strict=True)):
        pieces = [piece for piece in pieces_of(solid) if piece.volume() > _SPLINTER * exact_solid.volume()]
        volume = sum(piece.volume() for piece in pieces)
        if volume < _LOST * exact_solid.volume():
            problem = f"part {k + 1} is thinner than a clearance of {clearance:g} m leaves whole"
            raise ParameterError("clearance", problem, "a smaller clearance")
        joined = (closed(pieces, volume) if solid is not exact_solid else None) or union(pieces)
        part = Part(k + 1, group, exact_solid, joined, density * exact_solid.volume())
        of_cells = sum(cells[i].volume() for i in group)
        part.error = max(abs(exact_solid.volume() / of_cells - 1.0), abs(joined.volume() / solid.volume() - 1.0))
        parts.append(part)
    return parts


def different(parts: list[Part]) -> int:
    """Return how many parts are of different shape: a part and its mirror image are alike."""
    moments_of_parts = np.array([moments(part.exact) for part in parts])
    return len({kind_of(moment, float(moments_of_parts[:, 0].max())) for moment in moments_of_parts})


def lay(part: Part, fit: Floats, rotations: Floats = np.zeros((0, 3, 3))) -> bool:  # noqa: B008
    """Find box and bed of a part; return whether it fits into a box of sides `fit` (3,), ascending.

    rotations: tried beside those that lay it on a face.
    """
    points, triangles = surface_of(part.exact)
    corners = points[triangles]
    normal, area = normals_of(corners)
    kinds, kind = np.unique(np.round(normal / np.maximum(area, 1e-300)[:, None], 4), axis=0, return_inverse=True)
    share = np.bincount(kind.reshape(-1), area)
    largest = np.argsort(-share)[:_BEDS].tolist()
    spins = []
    for down, size in [*((kinds[k], float(share[k])) for k in largest), *((axis, 0.0) for axis in np.eye(3))]:
        if np.linalg.norm(down) < 0.5:
            continue
        up = -down / np.linalg.norm(down)
        frame = np.array([*basis(up), up])
        plan = points @ frame[:2].T
        rectangle = shapely.minimum_rotated_rectangle(shapely.MultiPoint(plan))
        ring = shapely.get_coordinates(rectangle)
        edge = ring[1] - ring[0]
        # the smallest rectangle may be long where one along the axes is not
        for turn in (float(np.arctan2(edge[1], edge[0])), 0.0):
            spin = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]) @ frame
            spins.append((size, spin))
    best: tuple[Any, ...] | None = None
    for size, spin in [*spins, *((0.0, rotation) for rotation in rotations)]:
        sides = np.sort(np.ptp(points @ spin.T, axis=0))
        scale = float((sides / fit).max())
        fits = scale <= 1.0 + 1e-6
        key = (fits, size if fits else -scale, -scale)
        if best is None or key > best[0]:
            best = key, sides, spin, fits
    assert best is not None
    _, part.box, part.bed, fits_box = best
    return bool(fits_box)


def plain_surface(solid: Any) -> unions.Surface:
    """Return the surface of a solid with each plane region as one face where that keeps its volume, else triangles."""
    checkpoint()
    points, triangles = surface_of(solid)
    try:
        surface = unions.union_solids([points], [triangles.tolist()])
    except (shapely.errors.GEOSException, InputError, ValueError):  # regions that touch themselves
        surface = None
    if surface is not None:
        fans = np.array([(f[0], f[k], f[k + 1]) for f in surface.faces for k in range(1, len(f) - 1)])
        volumes = [volume_of(surface.points, corners) for corners in (fans, np.array(surface.triangles))]
        if not len(open_edges(fans)) and np.allclose(volumes, volume_of(points, triangles), rtol=1e-6, atol=0.0):
            return surface
    faces = tuple((a, b, c) for a, b, c in triangles.tolist())
    return unions.Surface(points, faces, faces)


def write_parts(
    folder: Path, parts: list[Part], unit: float, moved: Floats | tuple[float, ...] = (0.0, 0.0, 0.0)
) -> None:
    """Write each part as STL, OBJ and 3MF where it stands, moved, as STL on its bed, all as one 3MF; read STL again."""
    for name in ("parts", "bed"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    surfaces = []
    for part in parts:
        points, triangles = as_written(part.solid.translate(tuple(moved)) if any(moved) else part.solid, unit)
        path = folder / "parts" / f"{part.name}.stl"
        path.write_bytes(stl_bytes(points, triangles))
        surface_read = as_read(path.read_bytes())
        part.error = max(part.error, abs(unit**3 * volume_of(*surface_read) / part.solid.volume() - 1.0))
        part.open = doubled_edges(*surface_read)
        files.write_text(folder / "parts" / f"{part.name}.obj", obj_text(points, triangles, part.name))
        turned = points @ part.bed.T
        lying = as_single(turned - turned.min(axis=0), triangles)
        (folder / "bed" / f"{part.name}.stl").write_bytes(stl_bytes(*lying))
        surfaces.append((part.name, points * (1e3 * unit), triangles))
        write_3mf(folder / "parts" / f"{part.name}.3mf", surfaces[-1:])
    write_3mf(folder / "parts.3mf", surfaces)


# segments of digits 0 to 9: top, upper left and right, middle, lower left and right, bottom
_DIGITS: Final = ("012456", "25", "02346", "02356", "1235", "01356", "013456", "025", "0123456", "012356")
_STROKE: Final = 0.16  # width of a segment by the height of a digit
_WIDTH: Final = 0.62  # of a digit, by its height
_DEPTH: Final = 0.12  # of an engraving, by the height
_FACES: Final = 6  # faces of a part on which a number is tried
_EXACT: Final = 1e-6  # error of a volume by that of the tool
_TENON: Final = 0.2  # side of a tenon by the root of the area of its joint


def _bars(number: int) -> list[tuple[float, float, float, float]]:
    """Return rectangles x0, y0, x1, y1 of the digits of a number, 1 high, and of an arrow above them that points up."""
    s, w, rectangles = _STROKE, _WIDTH, []
    bars = [
        (0.0, 1.0 - s, w, 1.0),
        (0.0, 0.5, s, 1.0),
        (w - s, 0.5, w, 1.0),
        (0.0, 0.5 - s / 2, w, 0.5 + s / 2),
        (0.0, 0.0, s, 0.5),
        (w - s, 0.0, w, 0.5),
        (0.0, 0.0, w, s),
    ]
    step = w + 1.5 * s
    text = str(number)
    for position, digit in enumerate(text):
        rectangles += [
            (x0 + position * step, y0, x1 + position * step, y1)
            for x0, y0, x1, y1 in (bars[int(k)] for k in _DIGITS[int(digit)])
        ]
    middle = ((len(text) - 1) * step + w) / 2
    # three steps that narrow upwards: cut by planes along the frame alone
    for row, half in enumerate((2.0 * s, 1.25 * s, 0.5 * s)):
        rectangles.append((middle - half, 1.3 + row * s, middle + half, 1.3 + (row + 1) * s))
    return rectangles


@dataclass(frozen=True)
class Spot:
    """Circle in a plane face: centre (3,), radius, outward normal and upward direction in the plane."""

    centre: Floats
    radius: float
    normal: Floats
    up: Floats


def _spot(region: Any, plane: Floats) -> Spot | None:
    """Return the largest circle in a region of a plane, that faces along its normal."""
    polygons = [part for part in shapely.get_parts(region).tolist() if part.geom_type == "Polygon"]
    if not polygons:
        return None
    line = shapely.maximum_inscribed_circle(max(polygons, key=lambda polygon: polygon.area))
    normal, frame = plane[:3], basis(plane[:3])
    centre = np.array(line.coords[0]) @ frame + plane[3] * normal
    up = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    up = frame[0] if np.linalg.norm(up) < 0.1 else up / np.linalg.norm(up)
    return Spot(centre, line.length, normal, up)


def spots(solid: Any) -> list[Spot]:
    """Return the largest circles in the plane faces of a solid, the largest faces first."""
    points, triangles = surface_of(solid)
    corners = points[triangles]
    normal, area = normals_of(corners)
    large = area > 1e-12 * area.max()
    corners, area, normal = corners[large], area[large], normal[large] / area[large, None]
    size = float(np.ptp(points, axis=0).max())
    planes = np.column_stack([normal, np.einsum("ij,ij->i", normal, corners[:, 0])])
    _, first, plane_of = np.unique(
        np.round(planes / [1e-5, 1e-5, 1e-5, 1e-6 * size]), axis=0, return_index=True, return_inverse=True
    )
    share = np.bincount(plane_of.reshape(-1), area)
    circles = [_spot(sides_of(solid, planes[first[k]], size)[0], planes[first[k]]) for k in np.argsort(-share)[:_FACES]]
    return [circle for circle in circles if circle is not None]


def _tool(spot: Spot, number: int, height: float, low: float, high: float) -> Any:
    """Return number and arrow as a body that reaches from `low` to `high` along the normal of a face."""
    bars = np.array(_bars(number))
    middle = (bars.reshape(-1, 2, 2).min(axis=(0, 1)) + bars.reshape(-1, 2, 2).max(axis=(0, 1))) / 2
    sheet = manifold3d().Manifold
    boxes = [
        sheet.cube((height * (x1 - x0), height * (y1 - y0), high - low)).translate(
            (height * (x0 - middle[0]), height * (y0 - middle[1]), low)
        )
        for x0, y0, x1, y1 in bars.tolist()
    ]
    body = sheet.batch_boolean(boxes, manifold3d().OpType.Add)
    right = np.cross(spot.up, spot.normal)
    return body.transform(np.column_stack([right, spot.up, spot.normal, spot.centre]))


def mark(part: Part, unit: float) -> bool:
    """Engrave number and arrow into a face of a part; return whether one had the room."""
    for spot in spots(part.solid):
        checkpoint()
        bars = np.array(_bars(part.number)).reshape(-1, 2)
        height = 0.9 * 2.0 * spot.radius / float(np.linalg.norm(np.ptp(bars, axis=0)))
        depth = _DEPTH * height
        inside = _tool(spot, part.number, height, -depth, 0.0)
        content = part.solid ^ inside
        if abs(content.volume() - inside.volume()) > 1e-3 * inside.volume():
            continue
        body = part.solid - _tool(spot, part.number, height, -depth, depth)
        if _sound(body, part.solid.volume() - inside.volume(), inside.volume(), unit):
            part.solid, part.marked = body, True
            return True
    return False


def _sound(body: Any, volume: float, tool: float, unit: float) -> bool:
    is_whole = len(pieces_of(body)) == 1 and abs(body.volume() - volume) <= _EXACT * max(tool, 1e-3 * volume)
    return is_whole and doubled_edges(*as_written(body, unit)) == 0


def tenons(parts: list[Part], block: Ints, joints: list[Joint], clearance: float, fit: Floats, unit: float) -> int:
    """Put a square tenon on the part that comes later at each joint along its way, where one fits; return how many."""
    part_of = {int(block[part.cells[0]]): part for part in parts}
    done_pairs: set[tuple[int, int]] = set()
    for joint in sorted(joints, key=lambda joint: -joint.area):
        if time_left() <= 0.0:
            break
        first, second = part_of[int(block[joint.a])], part_of[int(block[joint.b])]
        pair = (min(first.number, second.number), max(first.number, second.number))
        if first is second or pair in done_pairs or not (first.step and second.step) or first.step == second.step:
            continue
        comes, stays = (first, second) if first.step > second.step else (second, first)
        into = joint.normal if comes is first else -joint.normal
        if comes.direction @ into > 0.999 and _tenon(comes, stays, joint, into, clearance, fit, unit):
            done_pairs.add(pair)
    return len(done_pairs)


def _tenon(comes: Part, stays: Part, joint: Joint, into: Floats, clearance: float, fit: Floats, unit: float) -> bool:
    """Add a tenon and its hole if both parts stay sound and fit; True if done."""
    plane = np.array([*into, float(joint.polygon[0] @ into)])
    spot = _spot(shapely.Polygon(joint.polygon @ basis(into).T), plane)
    side = _TENON * np.sqrt(joint.area)
    if spot is None or spot.radius < side:
        return False
    frame = np.column_stack([np.cross(spot.up, into), spot.up, into, spot.centre])

    def peg(half: float, low: float, high: float) -> Any:
        cube = manifold3d().Manifold.cube((2 * half, 2 * half, high - low)).translate((-half, -half, low))
        return cube.transform(frame)

    # it begins within its own part, beyond the gap of the joint
    pin, hole = peg(side / 2, -clearance - side / 2, side), peg(side / 2 + clearance / 2, -clearance, side + clearance)
    root, deep = (
        peg(side / 2, -clearance - side / 2, -clearance),
        peg(side / 2 + clearance / 2, clearance, side + clearance),
    )
    if (comes.solid ^ root).volume() < (1 - 1e-6) * root.volume():
        return False
    if (stays.solid ^ deep).volume() < (1 - 1e-6) * deep.volume():
        return False
    longer, holed = comes.solid + pin, stays.solid - hole
    grown, cut = longer.volume() - comes.solid.volume(), stays.solid.volume() - holed.volume()
    slack = 1 + 1e-9
    if not (0.0 < grown <= slack * pin.volume() and 0.0 < cut <= slack * hole.volume()):
        return False
    if (longer ^ holed).volume() > 1e-9 * cut:
        return False
    if not all(_sound(body, body.volume(), cut, unit) for body in (longer, holed)):
        return False
    lengthened = Part(comes.number, comes.cells, longer, longer, comes.mass)
    if not lay(lengthened, fit, comes.bed[None]):
        return False
    comes.solid, stays.solid, comes.box, comes.bed = longer, holed, lengthened.box, lengthened.bed
    return True
