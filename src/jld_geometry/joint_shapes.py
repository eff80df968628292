"""Replace straight joints by shaped ones, with crack planes at the roots of teeth."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from typing import Any, Final

import numpy as np
import shapely

from jld_core import (
    Assembly,
    Bits,
    Floats,
    InputError,
    LimitAnalysisResult,
    ParameterError,
    Scene,
    Status,
    blocks_of,
    build_assembly,
    one_thread,
    parse_scene,
)
from jld_core.build import build_geometry
from jld_core.models import solve_rigid
from jld_geometry.convex_cells import ConvexCell, Plane, inside, subtract, vertex_mesh
from jld_geometry.moved_scene import MovedScene

_SEGMENTS: Final = 8  # number of straight segments of half a sine wave


@dataclass(frozen=True)
class Key:
    """Trapezoidal key in the middle of a face; lengths relative to the face."""

    depth: float  # height of the key
    width: float  # width at its root
    flank: float  # how much narrower its top is on each side, measured along the face

    def teeth(self) -> list[tuple[Floats, int]]:
        """Return outline (k, 2) along and across a face of length 1, and side 1: into the second element."""
        low, high = 0.5 - 0.5 * self.width, 0.5 + 0.5 * self.width
        outline = [[low, 0.0], [high, 0.0], [high - self.flank, self.depth], [low + self.flank, self.depth]]
        return [(np.array(outline), 1)]

    def check(self) -> None:
        if not (self.depth > 0.0 and 0.0 < self.width < 1.0 and 0.0 <= self.flank < 0.5 * self.width):
            problem = f"depth {self.depth:g}, width {self.width:g}, flank {self.flank:g} are no key"
            raise ParameterError("joint", problem, "depth > 0, 0 < width < 1, 0 <= flank < width/2, shares of the face")


@dataclass(frozen=True)
class Sine:
    """Sine wave along a face."""

    amplitude: float  # amplitude relative to the length of the face
    waves: int  # number of whole waves

    def teeth(self) -> list[tuple[Floats, int]]:
        """Return outline (k, 2) and side of each half wave, along and across a face of length 1."""
        # A tooth of side 1 reaches into the second element, one of side −1 into the first.
        outlines, count = [], 2 * self.waves
        share = np.linspace(0.0, 1.0, _SEGMENTS + 1)
        for k in range(count):
            side = 1 if k % 2 == 0 else -1
            across = side * self.amplitude * np.sin(np.pi * share)
            across[[0, -1]] = 0.0
            outlines.append((np.column_stack([(k + share) / count, across]), side))
        return outlines

    def check(self) -> None:
        if not (self.amplitude > 0.0 and self.waves >= 1):
            problem = f"amplitude {self.amplitude:g} with {self.waves} waves is no sine wave"
            raise ParameterError("joint", problem, "an amplitude > 0, a share of the face, and at least 1 wave")


@dataclass(frozen=True)
class Incline:
    """Joint turned about the middle of its face."""

    slope: float  # tangent of the angle between both; above 0 the joint rises along the face into the second element

    def teeth(self) -> list[tuple[Floats, int]]:
        """Return outline (k, 2) and side of both equal wedges, along and across a face of length 1."""
        rise, side = 0.5 * abs(self.slope), 1 if self.slope > 0.0 else -1
        first = np.array([[0.0, 0.0], [0.0, -side * rise], [0.5, 0.0]])
        second = np.array([[0.5, 0.0], [1.0, side * rise], [1.0, 0.0]])
        return [(first, -side), (second, side)]

    def check(self) -> None:
        if not 0.0 < abs(self.slope) < np.inf:
            raise ParameterError("joint", f"slope {self.slope:g} leaves the joint straight", "a slope above or below 0")


Shape = Key | Sine | Incline


_SAME: Final = 1e-9  # volume or area, relative to that of a tooth or joint, below which a difference is rounding

# Sine of the angle between a direction and the normal of a joint below which the joint is across the direction
_ACROSS: Final = 1e-6

_PLANE: Final = 1e-9  # distance of a point from a plane, relative to the structure, below which it lies on the plane


def solids_with_shape(scene: Scene, assembly: Assembly, labels: Bits, shape: Shape, direction: Floats | None) -> Scene:
    """Return the scene whose dry joints have a shape along a direction (3,)."""
    if direction is None or not np.linalg.norm(direction) > 0.0 or not np.isfinite(direction).all():
        problem = "joints in space run along a direction" if direction is None else "it is no direction"
        raise ParameterError("direction", problem, "X,Y,Z along the joints, as 0,1,0")
    elements, blocks = assembly.elements, blocks_of(assembly, labels)
    cells = [[ConvexCell(*solid)] for solid in zip(elements.shape, elements.faces, strict=True)]
    unit = direction / np.linalg.norm(direction)
    shaped = [SolidJoint(assembly, face, unit) for face in np.flatnonzero(labels).tolist()]
    shaped = [joint for joint in shaped if not joint.across]
    if not shaped:
        problem = "all joints lie across it" if labels.any() else "no joint is dry"
        raise ParameterError("direction", problem, "a direction along joints that are dry")
    for joint in shaped:
        joint.cut(shape, cells)
    document: dict[str, Any] = scene.model_dump(mode="json", exclude_defaults=True)
    for key in ("labels", "interfaces", "move", "search"):
        document.pop(key, None)
    _state_places(document["loads"], assembly)
    document["elements"], owner = [], dict[str, int]()
    for k, entry in enumerate(build_geometry(scene).entries):
        parts = _parts_of(entry.model_dump(mode="json", exclude_defaults=True), cells[k])
        document["elements"] += parts
        owner |= {part["id"]: int(blocks[k]) for part in parts}
    document["labels"] = {"default": "dry"}
    unlabelled = build_assembly(parse_scene(document, "the scene with shaped joints"))
    names, faces = unlabelled.elements.ids, unlabelled.interfaces
    pairs = {(names[a], names[b]): None for a, b in zip(faces.a.tolist(), faces.b.tolist(), strict=True)}
    document["labels"]["inner"] = [[solid, other] for solid, other in pairs if owner[solid] == owner[other]]
    return parse_scene(document, "the scene with shaped joints")


class SolidJoint:
    """Plane joint between two convex elements, with a frame along and across its shape."""

    def __init__(self, assembly: Assembly, face: int, direction: Floats) -> None:
        faces = assembly.interfaces
        self._assembly, self._polygon = assembly, faces.polygon[face]
        self._sides = int(faces.a[face]), int(faces.b[face])
        self._normal = faces.normal[face]
        run = direction - (direction @ self._normal) * self._normal
        self.across = bool(np.linalg.norm(run) < _ACROSS)
        if self.across:
            return
        self._run = run / np.linalg.norm(run)
        self._along = np.cross(self._normal, self._run)
        along = (self._polygon - faces.origin[face]) @ self._along
        self._length = float(np.ptp(along))
        self._start = faces.origin[face] + along.min() * self._along

    def cut(self, shape: Shape, cells: list[list[ConvexCell]]) -> None:
        """Cut each tooth of the joint out of one element's cells, and add it to the other's."""
        elements = self._assembly.elements
        for outline, side in shape.teeth():
            giver, receiver = self._sides[:: 1 if side > 0 else -1]
            if not ConvexCell(elements.shape[receiver], elements.faces[receiver]).is_convex():
                where = f"element {elements.ids[receiver]!r}"
                raise InputError(where, "it is not convex", "convex elements at joints with a shape")
            profile, ends = self._profile(outline), self._ends(receiver)
            root: Plane = (-side * self._normal, float(-side * self._normal @ self._start))
            both = inside(self._box(), [*profile, *ends, root])
            order = [*([] if isinstance(shape, Key) else self._around(outline, side)), *profile, *ends]
            teeth, remaining = list[ConvexCell](), list[ConvexCell]()
            for cell in cells[receiver]:
                tooth, parts = _taken(cell, order)
                teeth += [] if tooth is None else [tooth]
                remaining += parts
            volume = 0.0 if both is None else both.volume
            if both is None or sum(one.volume for one in teeth) < volume * (1.0 - _SAME):
                names = [elements.ids[k] for k in (giver, receiver)]
                problem = f"a tooth of {names[0]!r} does not fit into {names[1]!r}"
                raise InputError("joint", problem, "a smaller depth, amplitude or slope, or fewer joints")
            cells[receiver] = remaining
            cells[giver] += teeth

    def _profile(self, outline: Floats) -> list[Plane]:
        """Return the planes of a tooth (k, 2) except its root, the farthest from the root first."""
        middle, planes = outline.mean(axis=0), []  # with their distance from the root
        for start, end in itertools.pairwise([*outline, outline[0]]):
            if start[1] == end[1] == 0.0:
                continue  # the root
            edge = end - start
            normal = np.array([edge[1], -edge[0]]) / math.hypot(*edge)
            if (middle - start) @ normal > 0.0:
                normal = -normal
            distance = abs(start[1]) + abs(end[1])
            planes.append((distance, self._plane(normal, start)))
        return [plane for _, plane in sorted(planes, key=lambda plane: -plane[0])]

    def _around(self, outline: Floats, side: int) -> list[Plane]:
        """Return the planes of the box around a tooth: its level, then its ends along the joint."""
        level = outline[int(np.argmax(abs(outline[:, 1])))]
        low, high = outline[int(np.argmin(outline[:, 0]))], outline[int(np.argmax(outline[:, 0]))]
        sides = ((np.array([0.0, float(side)]), level), (np.array([-1.0, 0.0]), low), (np.array([1.0, 0.0]), high))
        return [self._plane(normal, point) for normal, point in sides]

    def _plane(self, normal: Floats, point: Floats) -> Plane:
        """Return a plane along the direction through a point (2,) with normal (2,), in shares of the length."""
        space = normal[0] * self._along + normal[1] * self._normal
        place = self._start + self._length * (point[0] * self._along + point[1] * self._normal)
        return space, float(space @ place)

    def _ends(self, receiver: int) -> list[Plane]:
        """Return the planes over the joint's edges, and over the receiver's faces at tooth ends."""
        # A tooth reaches as far as the joint, and its ends follow the faces of the element that receives it.
        elements, polygon = self._assembly.elements, self._polygon
        middle, planes, reach = polygon.mean(axis=0), [], _PLANE * self._assembly.size
        for start, end in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            out = np.cross(end - start, self._normal)
            out /= np.linalg.norm(out)
            out = -out if (middle - start) @ out > 0.0 else out
            if ((polygon - start) @ out > reach).any():
                names = " and ".join(repr(elements.ids[k]) for k in self._sides)
                raise InputError("joint", f"the face between {names} is not convex", "convex faces between elements")
            planes.append((out, float(out @ start)))
            if abs(out @ self._run) < abs(out @ self._along):
                continue  # a side along which the tooth runs: the whole profile has to fit
            for loop in elements.faces[receiver]:
                corners = elements.shape[receiver][list(loop)]
                normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
                normal /= np.linalg.norm(normal)
                on = abs((np.array([start, end]) - corners[0]) @ normal).max() <= reach
                if on and abs(normal @ self._normal) < 1.0 - _ACROSS:
                    planes.append((normal, float(normal @ corners[0])))
        return planes

    def _box(self) -> ConvexCell:
        """Return a box about the joint that is larger than any tooth."""
        half = 2.0 * self._assembly.size
        corners = np.array([[x, y, z] for x in (-half, half) for y in (-half, half) for z in (-half, half)])
        loops = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        return ConvexCell(self._start + corners, loops)


def _taken(cell: ConvexCell, planes: list[Plane]) -> tuple[ConvexCell | None, list[ConvexCell]]:
    """Divide a cell into its part inside all planes and the rest; return both."""
    tooth = inside(cell, planes)
    if tooth is None:
        return None, [cell]
    for plane in planes:
        within, outside = cell.cut(plane)
        if within is not None and within.volume <= tooth.volume * (1.0 + _SAME):
            return within, [] if outside is None else [outside]
    return subtract(cell, planes)


def _parts_of(entry: dict[str, Any], cells: list[ConvexCell]) -> list[dict[str, Any]]:
    """Return the entries of the cells of an element, which share its weight by volume; the first keeps its name."""
    if len(cells) == 1 and "vertices" in entry and len(entry["vertices"]) == len(cells[0].vertices):
        return [entry]
    volume, parts = sum(cell.volume for cell in cells), []
    for number, cell in enumerate(cells):
        part = {name: value for name, value in entry.items() if name != "centroid"}
        part |= {"vertices": cell.vertices.tolist(), "faces": [list(loop) for loop in cell.faces]}
        part |= {name: entry[name] * cell.volume / volume for name in ("weight", "volume") if name in entry}
        if number:
            part.pop("support", None)  # what is cut off a support may break off
            part["id"] = f"{entry['id']}~{number}"
        parts.append(part)
    return parts


def _state_places(loads: dict[str, Any], assembly: Assembly) -> None:
    """State the centroid as the place of every force without one, before elements are cut."""
    elements = assembly.elements
    cases = [loads, *loads.get("cases", [])]
    for entry in (one for case in cases for name in ("dead", "live") for one in case.get(name) or []):
        if "element" in entry and "force" in entry and entry.get("at") is None:
            entry["at"] = elements.centroid[elements.index[entry["element"]]].tolist()


_GRID: Final = 1e-12  # distance between coordinates of cells with shaped joints, relative to the structure

_PLAIN: Final = {"elements", "polygon", "label"}  # keys of stated interfaces that say nothing about strengths


def shaped_scene(
    scene: Scene, assembly: Assembly, labels: Bits, shape: Shape, direction: Floats | None = None
) -> Scene:
    """Return a scene whose dry faces have a shape, with stated interfaces.

    direction: (3,) in space, along which shapes run unchanged; joints across it stay straight.
    """
    # Teeth are elements of their own, joined to their block by an inner face at the root. What lies beside a key is cut
    # off its block by an inner face at the depth of the key. Crack planes elsewhere stay as they are.
    shape.check()
    assembly.members.refuse("a shape of joints")
    geometry = build_geometry(scene)
    own = any(
        contact is not None and set(contact.model_dump(exclude_defaults=True)) > _PLAIN for contact in geometry.given
    )
    if own or scene.materials.faces:
        raise InputError("interfaces", "single faces state strengths", "strengths in materials")
    if assembly.pressed:
        raise InputError("loads", "pressure on faces does not follow the shape of joints", "point loads and body loads")
    blocks, faces = blocks_of(assembly, labels), assembly.interfaces
    if (labels & (blocks[faces.a] == blocks[faces.b])).any():
        raise InputError("labels", "a dry face ends inside a block", "blocks without slits")
    if assembly.dimension == 3:
        return solids_with_shape(scene, assembly, labels, shape, direction)
    if direction is not None:
        raise ParameterError("direction", "the joints of a planar scene have none", "it for scenes in space alone")
    cells = _planar_cells(assembly, labels, shape)
    document: dict[str, Any] = scene.model_dump(mode="json", exclude_defaults=True)
    for key in ("grid", "labels", "interfaces", "move", "search"):
        document.pop(key, None)
    document["thickness"] = float(faces.l2[0]) if len(faces) else 1.0
    document["elements"], block_of_element = [], []
    for k, entry in enumerate(geometry.entries):
        parts = _polygons_of(entry.model_dump(mode="json", exclude_defaults=True), cells[k])
        document["elements"] += parts
        block_of_element += [blocks[k]] * len(parts)
    unlabelled = parse_scene(document, "the scene with shaped joints")
    shaped, block = build_assembly(unlabelled), np.array(block_of_element)
    dry = block[shaped.interfaces.a] != block[shaped.interfaces.b]
    mesh = vertex_mesh(shaped)
    return MovedScene(unlabelled, shaped, dry, mesh).at(mesh.places)


def _polygons_of(entry: dict[str, Any], cells: list[shapely.Polygon]) -> list[dict[str, Any]]:
    """Return the entries of the cells of an element, which share its weight by area; the first keeps its name."""
    area = sum(cell.area for cell in cells)
    parts = []
    for number, cell in enumerate(cells):
        part = {**entry, "polygon": _corners(cell)}
        if number:
            part.pop("support", None)  # what is cut off a support may break off
            part["id"] = f"{entry['id']}~{number}"
        if "weight" in entry:
            part["weight"] = entry["weight"] * cell.area / area
        parts.append(part)
    return parts


@dataclass(frozen=True)
class _Teeth:
    """Teeth of all planar joints, and the strips beside keys."""

    outlines: list[shapely.Polygon]
    owners: list[tuple[int, int]]  # element that a tooth belongs to, and the element that receives it
    strips: list[tuple[shapely.Geometry, int]]  # what lies beside the keys of one joint, and the element it is part of

    @classmethod
    def of(cls, assembly: Assembly, labels: Bits, shape: Shape, elements: list[shapely.Polygon]) -> _Teeth:
        """Place the teeth of a shape on all dry faces."""
        faces, teeth = assembly.interfaces, cls([], [], [])
        for face in np.flatnonzero(labels).tolist():
            first, last = faces.polygon[face][0], faces.polygon[face][1]
            across = np.array([first[1] - last[1], last[0] - first[0]])
            within = shapely.get_coordinates(elements[faces.a[face]].representative_point())[0]
            if (within - first) @ across > 0.0:  # positive teeth reach from the first element into the second
                across = -across
            axes = np.array([last - first, across])
            pair = int(faces.a[face]), int(faces.b[face])
            for outline, side in shape.teeth():
                giver, receiver = pair if side > 0 else pair[::-1]
                teeth.owners.append((giver, receiver))
                teeth.outlines.append(shapely.Polygon(first + outline @ axes))
                if isinstance(shape, Key):
                    strip = shapely.Polygon(first + _strip(shape.depth) @ axes)
                    teeth.strips.append((strip & elements[receiver], receiver))
        return teeth


def _strip(depth: float) -> Floats:
    """Return corners (4, 2) of a strip as deep as a key, far beyond a face of length 1 and a little behind it."""
    return np.array([[-50.0, -0.01], [51.0, -0.01], [51.0, depth], [-50.0, depth]])


def _planar_cells(assembly: Assembly, labels: Bits, shape: Shape) -> list[list[shapely.Polygon]]:
    """Return the cells of each element after its joints got a shape: body, pieces beside keys, teeth."""
    # All outlines are one network of lines on a grid: whatever cells share a corner, they have the same numbers there.
    elements = assembly.elements
    outlines = [shapely.Polygon(outline) for outline in elements.shape]
    teeth = _Teeth.of(assembly, labels, shape, outlines)
    places = np.concatenate(elements.shape)
    grid = _GRID * max(assembly.size, 1e-2 * float(abs(places).max()))
    lines = [*outlines, *teeth.outlines, *(strip for strip, _ in teeth.strips)]
    network = shapely.union_all([shapely.boundary(line) for line in lines], grid_size=grid)
    pieces = shapely.get_parts(shapely.polygonize([network]))
    points = shapely.point_on_surface(pieces)
    # pieces of one cell: (tooth,), or (element, strips that they lie in)
    groups: dict[tuple[Any, ...], list[shapely.Polygon]] = {}
    for piece, point, element, tooth in zip(
        pieces, points, _first_around(outlines, points), _first_around(teeth.outlines, points), strict=True
    ):
        if tooth >= 0 and element == teeth.owners[tooth][1]:
            groups.setdefault((tooth,), []).append(piece)
        elif element >= 0:
            within = tuple(n for n, (strip, of) in enumerate(teeth.strips) if of == element and strip.contains(point))
            groups.setdefault((element, within), []).append(piece)
    for number, (giver, receiver) in enumerate(teeth.owners):
        area = sum(piece.area for piece in groups.get((number,), []))
        if area < teeth.outlines[number].area * (1.0 - _SAME):
            problem = f"a tooth of {elements.ids[giver]!r} does not fit into {elements.ids[receiver]!r}"
            raise InputError("joint", problem, "a smaller depth or amplitude, or fewer joints")
    cells: list[list[shapely.Polygon]] = [[] for _ in outlines]
    # bodies first, then what lies beside keys, then teeth
    for key in sorted(groups, key=lambda key: (len(key) == 1, len(key[-1]) if len(key) == 2 else 0, key)):
        element = key[0] if len(key) == 2 else teeth.owners[key[0]][0]
        union = shapely.coverage_union_all(groups[key])
        cells[element] += [part for part in shapely.get_parts(union) if part.area > _SAME * outlines[element].area]
    return cells


def _first_around(shapes: list[shapely.Polygon], points: Any) -> list[int]:
    """Return the first of some shapes that contains each of the points, −1 where none does."""
    lowest = np.full(len(points), len(shapes))
    number, shape = shapely.STRtree(shapes).query(points, predicate="within")
    np.minimum.at(lowest, number, shape)
    first: list[int] = np.where(lowest < len(shapes), lowest, -1).tolist()
    return first


def _corners(cell: shapely.Polygon) -> list[list[float]]:
    """Return the corners of a polygon, counter-clockwise, without those on straight edges."""
    ring = np.array(shapely.geometry.polygon.orient(cell).exterior.coords)[:-1]
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    bent = abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) > _SAME * size
    return [[float(x), float(y)] for x, y in ring[bent]]


_FIRST: Final = 0.4  # relative change of a parameter in the first step

_LAST: Final = 0.02  # relative change at which the search ends

_LEAST: Final = 0.005  # first value of a parameter that is 0, as a share of the length of a face

_NOTHING: Final = 1e-4  # value of a parameter below which it is taken as 0, as a share of the length of a face


@dataclass(frozen=True)
class ShapedJoints:
    scene: Scene  # scene with joints of the best shape
    shape: Shape  # that shape
    # before, after: analyses with straight joints and with the best shape
    before: LimitAnalysisResult
    after: LimitAnalysisResult
    # all shapes tried with their λ; NaN where a tooth does not fit or λ is not proven, inf where locked
    trials: list[tuple[Shape, float]]
    end: str  # why the search ended: "stationary", "time" or "interrupted"


@one_thread()
def shape_joints(
    scene: Scene,
    assembly: Assembly,
    labels: Bits,
    shape: Shape,
    direction: Floats | None = None,
    *,
    seconds: float = math.inf,
    progress: Callable[[Shape, float], None] | None = None,
) -> ShapedJoints:
    """Find the parameters of a shape, the same for all joints, with the largest λ by faces."""
    # Each parameter in turn is raised and lowered by a factor; the factor shrinks where nothing improves. Whole numbers
    # stay. λ is that of cracks by faces, with crack planes at the roots of teeth.
    trials: list[tuple[Shape, float]] = []
    value_of: dict[tuple[float, ...], float] = {}

    def value(shape_tried: Shape) -> float:
        """Return the proven lower bound on λ with a shape, NaN without one."""
        key: tuple[float, ...] = astuple(shape_tried)
        if key not in value_of:
            result = solve_rigid(build_assembly(shaped_scene(scene, assembly, labels, shape_tried, direction)))
            locked = result.status is Status.LOCKED
            value_of[key] = math.inf if locked else result.bracket[0]
            if result.status not in (Status.COLLAPSE, Status.LOCKED):
                value_of[key] = math.nan
            trials.append((shape_tried, value_of[key]))
            if progress is not None:
                progress(shape_tried, value_of[key])
        return value_of[key]

    until = time.perf_counter() + seconds
    kept = [(shape, value(shape))]
    try:
        end = _improve(kept, value, trials, until)
    except KeyboardInterrupt:
        end = "interrupted"
    best = kept[0][0]
    shaped = shaped_scene(scene, assembly, labels, best, direction)
    return ShapedJoints(shaped, best, solve_rigid(assembly, labels), solve_rigid(build_assembly(shaped)), trials, end)


def _improve(
    kept: list[tuple[Shape, float]], value: Callable[[Shape], float], trials: list[tuple[Shape, float]], until: float
) -> str:
    """Search from the shape in `kept`, replace it by stronger ones; return why it ended."""
    best, best_load = kept[0]
    names = [field.name for field in fields(best) if isinstance(getattr(best, field.name), float)]
    step = _FIRST
    while step >= _LAST and best_load < math.inf:
        start = best
        for name in names:
            for sign in (1.0, -1.0):
                if time.perf_counter() > until:
                    return "time"
                now = getattr(best, name)
                changed = now * (1.0 + step) ** sign if now != 0.0 else max(sign, 0.0) * _LEAST
                changed = changed if abs(changed) >= _NOTHING else 0.0
                trial = type(best)(**{**vars(best), name: changed})
                try:
                    load = value(trial)
                except InputError:
                    trials.append((trial, math.nan))  # a tooth does not fit: a trial without a value
                    continue
                if load > best_load or (math.isnan(best_load) and not math.isnan(load)):
                    best, best_load = kept[0] = trial, load
                    break
        if best == start:
            step *= 0.5
    return "stationary"
