"""Shaped joints in space: teeth along a direction, cut out of convex elements by planes."""

from __future__ import annotations

import itertools
import math
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly, blocks_of
from jld_core.build import build_assembly
from jld_core.build.assemble import build_geometry
from jld_core.errors import InputError, ParameterError
from jld_core.scene import Scene, parse_scene
from jld_geometry.convex_cells import ConvexCell, Plane, inside, subtract
from jld_geometry.joint_profiles import Key, Shape

_SAME: Final = 1e-9  # volume or area, relative to that of a tooth or joint, below which a difference is rounding

# Sine of the angle between a direction and the normal of a joint below which the joint is across the direction
_ACROSS: Final = 1e-6

_PLANE: Final = 1e-9  # distance of a point from a plane, relative to the structure, below which it lies on the plane


def solids_with_shape(scene: Scene, assembly: Assembly, labels: Bits, shape: Shape, direction: Floats | None) -> Scene:
    """Return a spatial scene with shaped dry faces; arguments as of `shaped_scene`."""
    if direction is None or not np.linalg.norm(direction) > 0.0 or not np.isfinite(direction).all():
        problem = "joints in space run along a direction" if direction is None else "it is no direction"
        raise ParameterError("direction", problem, "X,Y,Z along the joints, as 0,1,0")
    elements, blocks = assembly.elements, blocks_of(assembly, labels)
    cells = [[ConvexCell(*one)] for one in zip(elements.shape, elements.faces, strict=True)]
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
        own = entry.model_dump(mode="json", exclude_defaults=True)
        parts = _parts_of(own, cells[k])
        document["elements"] += parts
        owner |= {part["id"]: int(blocks[k]) for part in parts}
    document["labels"] = {"default": "dry"}
    found = build_assembly(parse_scene(document, "the scene with shaped joints"))
    names, faces = found.elements.ids, found.interfaces
    pairs = {(names[a], names[b]): None for a, b in zip(faces.a.tolist(), faces.b.tolist(), strict=True)}
    document["labels"]["inner"] = [[one, other] for one, other in pairs if owner[one] == owner[other]]
    return parse_scene(document, "the scene with shaped joints")


class SolidJoint:
    """Plane joint between two convex elements, with a frame along and across its shape.

    assembly: spatial assembly. face: interface that is the joint. direction: (3,) unit direction along which the shape
    runs, projected on the joint. across: True for a joint across the direction, which has no shape.
    """

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
        places = (self._polygon - faces.origin[face]) @ self._along
        self._length = float(np.ptp(places))
        self._start = faces.origin[face] + places.min() * self._along

    def cut(self, shape: Shape, cells: list[list[ConvexCell]]) -> None:
        """Cut each tooth of the joint out of one element's cells, and add it to the other's.

        cells: of each element, changed in place; the first one is its body. Raises InputError for a tooth that does
        not fit, and for elements or a joint that are not convex.
        """
        elements = self._assembly.elements
        for outline, side in shape.teeth():
            giver, receiver = self._sides[:: 1 if side > 0 else -1]
            if not ConvexCell(elements.shape[receiver], elements.faces[receiver]).is_convex():
                where = f"element {elements.ids[receiver]!r}"
                raise InputError(where, "it is not convex", "convex elements at joints with a shape")
            own, ends = self._profile(outline), self._ends(receiver)
            root: Plane = (-side * self._normal, float(-side * self._normal @ self._start))
            whole = inside(self._box(), [*own, *ends, root])
            order = [*([] if isinstance(shape, Key) else self._around(outline, side)), *own, *ends]
            teeth, rest = list[ConvexCell](), list[ConvexCell]()
            for cell in cells[receiver]:
                tooth, parts = _taken(cell, order)
                teeth += [] if tooth is None else [tooth]
                rest += parts
            volume = 0.0 if whole is None else whole.volume
            if whole is None or sum(one.volume for one in teeth) < volume * (1.0 - _SAME):
                names = [elements.ids[k] for k in (giver, receiver)]
                problem = f"a tooth of {names[0]!r} does not fit into {names[1]!r}"
                raise InputError("joint", problem, "a smaller depth, amplitude or slope, or fewer joints")
            cells[receiver] = rest
            cells[giver] += teeth

    def _profile(self, outline: Floats) -> list[Plane]:
        """Return the planes of a tooth except its root, the one farthest from the root first.

        outline: (k, 2) along and across a joint of length 1.
        """
        middle, found = outline.mean(axis=0), []
        for one, other in itertools.pairwise([*outline, outline[0]]):
            if one[1] == other[1] == 0.0:
                continue  # the root
            edge = other - one
            normal = np.array([edge[1], -edge[0]]) / math.hypot(*edge)
            if (middle - one) @ normal > 0.0:
                normal = -normal
            far = abs(one[1]) + abs(other[1])
            found.append((far, self._plane(normal, one)))
        return [plane for _, plane in sorted(found, key=lambda one: -one[0])]

    def _around(self, outline: Floats, side: int) -> list[Plane]:
        """Return the planes of the box around a tooth: its level, then its ends along the joint.

        outline: as for `_profile`. They keep cuts by inclined planes within the tooth's own reach.
        """
        level = outline[int(np.argmax(abs(outline[:, 1])))]
        low, high = outline[int(np.argmin(outline[:, 0]))], outline[int(np.argmax(outline[:, 0]))]
        sides = ((np.array([0.0, float(side)]), level), (np.array([-1.0, 0.0]), low), (np.array([1.0, 0.0]), high))
        return [self._plane(normal, point) for normal, point in sides]

    def _plane(self, normal: Floats, point: Floats) -> Plane:
        """Return a plane along the direction through a point (2,) with unit normal (2,).

        Both are in shares of the length.
        """
        space = normal[0] * self._along + normal[1] * self._normal
        place = self._start + self._length * (point[0] * self._along + point[1] * self._normal)
        return space, float(space @ place)

    def _ends(self, receiver: int) -> list[Plane]:
        """Return the planes over the joint's edges, and over the receiver's faces at tooth ends.

        A tooth reaches as far as the joint, and its ends follow the faces of the element that receives it. Raises
        InputError for a joint that is not convex.
        """
        elements, polygon = self._assembly.elements, self._polygon
        inner, found, reach = polygon.mean(axis=0), [], _PLANE * self._assembly.size
        for one, other in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            out = np.cross(other - one, self._normal)
            out /= np.linalg.norm(out)
            out = -out if (inner - one) @ out > 0.0 else out
            if ((polygon - one) @ out > reach).any():
                names = " and ".join(repr(elements.ids[k]) for k in self._sides)
                raise InputError("joint", f"the face between {names} is not convex", "convex faces between elements")
            found.append((out, float(out @ one)))
            if abs(out @ self._run) < abs(out @ self._along):
                continue  # a side along which the tooth runs: the whole profile has to fit
            for loop in elements.faces[receiver]:
                corners = elements.shape[receiver][list(loop)]
                normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
                normal /= np.linalg.norm(normal)
                on = abs((np.array([one, other]) - corners[0]) @ normal).max() <= reach
                if on and abs(normal @ self._normal) < 1.0 - _ACROSS:
                    found.append((normal, float(normal @ corners[0])))
        return found

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
        left, outside = cell.cut(plane)
        if left is not None and left.volume <= tooth.volume * (1.0 + _SAME):
            return left, [] if outside is None else [outside]
    return subtract(cell, planes)


def _parts_of(own: dict[str, Any], cells: list[ConvexCell]) -> list[dict[str, Any]]:
    """Return the entries of the cells of an element.

    own: entry of the whole element, whose weight and volume the cells share.
    """
    if len(cells) == 1 and "vertices" in own and len(own["vertices"]) == len(cells[0].vertices):
        return [own]
    whole, found = sum(cell.volume for cell in cells), []
    for number, cell in enumerate(cells):
        part = {name: value for name, value in own.items() if name != "centroid"}
        part |= {"vertices": cell.vertices.tolist(), "faces": [list(loop) for loop in cell.faces]}
        part |= {name: own[name] * cell.volume / whole for name in ("weight", "volume") if name in own}
        if number:
            part.pop("support", None)  # what is cut off a support may break off
            part["id"] = f"{own['id']}~{number}"
        found.append(part)
    return found


def _state_places(loads: dict[str, Any], assembly: Assembly) -> None:
    """State the centroid as the place of every force without one, before elements are cut.

    loads: entry of the scene, changed in place.
    """
    elements = assembly.elements
    cases = [loads, *loads.get("cases", [])]
    for entry in (one for case in cases for name in ("dead", "live") for one in case.get(name) or []):
        if "element" in entry and "force" in entry and entry.get("at") is None:
            entry["at"] = elements.centroid[elements.index[entry["element"]]].tolist()
