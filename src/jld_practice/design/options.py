"""Options of a design, the edges that carry its loads, and the keys that they set in a scene."""

from __future__ import annotations

import itertools
import json
import math
import os
from dataclasses import dataclass, fields, replace
from pathlib import Path as File
from typing import Any, Final, Literal

import numpy as np
import shapely

from jld_core import (
    Assembly,
    Elements,
    Floats,
    InputError,
    ParameterError,
    Scene,
    build_assembly,
    load_scene,
    parse_scene,
)
from jld_core.build import build_geometry
from jld_core.geometry import unions
from jld_core.scene import units
from jld_formats import ImportOptions, Notes, cells, forces, import_file, libraries
from jld_formats import options as exchange_options
from jld_masonry import prism_of, voussoirs
from jld_practice.laying.order import LAID

SIDES: Final = ("top", "bottom", "left", "right")

EXTRADOS: Final = "extrados"  # the largest arc of an outline that is round outwards

_FACING: Final = 0.3  # least component of the normal of an edge towards the side on which it lies

# Share of a load below which its part on a piece is left to the neighbours; meshes would be fine around it
_SLIVER: Final = 0.1

_ON: Final = 1e-6  # distance from a line, circle or support, relative to the structure, up to which a point lies on it


@dataclass(frozen=True)
class Edge:
    element: int  # index of the element
    # low, high: places of both ends along the side or line, length
    low: float
    high: float
    # p, q: (2,) its corners at these places
    p: Floats
    q: Floats


@dataclass(frozen=True)
class LoadedLine:
    """Edges along which a load acts, with the direction in which the outermost one counts."""

    edges: list[Edge]  # all edges that face the side, element by element
    facing: Floats  # (2,) unit vector out of the structure; 0 where edges do not cover one another

    @property
    def ends(self) -> tuple[float, float]:
        return min(edge.low for edge in self.edges), max(edge.high for edge in self.edges)

    def spread(self, low: float, high: float) -> list[tuple[Edge, float, float]]:
        """Return the outermost edges between two places, each with its interval."""
        # Slivers, and stretches without an edge, are left out.
        stops = sorted({low, high, *(end for edge in self.edges for end in (edge.low, edge.high) if low < end < high)})
        parts: list[tuple[Edge, float, float]] = []
        for a, b in itertools.pairwise(stops):
            if b - a <= _SLIVER * (high - low):
                continue
            middle = 0.5 * (a + b)
            over = [edge for edge in self.edges if edge.low <= middle <= edge.high]
            if not over:
                continue
            points = [edge.p + (middle - edge.low) / (edge.high - edge.low) * (edge.q - edge.p) for edge in over]
            edge = over[int(np.argmax(np.array(points) @ self.facing))]
            if parts and parts[-1][0] is edge and parts[-1][2] == a:
                parts[-1] = (edge, parts[-1][1], b)
            else:
                parts.append((edge, a, b))
        return parts


def points_of(along: str) -> tuple[Floats, Floats] | None:
    """Return the two points that a text X,Y,X,Y states; None for any other text."""
    try:
        numbers = np.array([float(part) for part in along.split(",")])
    except ValueError:
        return None
    if len(numbers) != 4 or not np.isfinite(numbers).all() or np.array_equal(numbers[:2], numbers[2:]):
        return None
    return numbers[:2], numbers[2:]


def loaded_line(assembly: Assembly, along: str, down: Floats) -> LoadedLine:
    """Return the edges of a planar structure along which a load acts; down: (2,) of weight."""
    # Edges on supports carry no load.
    points = points_of(along)
    if points is not None:
        return _between(assembly, *points)
    if along == EXTRADOS:
        return _extrados(assembly, down)
    right = np.array([-down[1], down[0]])
    facing = {"top": -down, "bottom": down, "left": -right, "right": right}[along]
    # places are counted from the left, and from below
    edges = _facing_edges(assembly, np.asarray(facing), right if along in ("top", "bottom") else -down)
    if not edges:
        where = {"top": "upwards", "bottom": "downwards"}.get(along, f"to the {along}")
        problem = f"no free edge of the outline faces {where}"
        raise ParameterError("along", problem, "another side, or two points of its outline")
    return LoadedLine(edges, np.asarray(facing))


def _free_edges(assembly: Assembly) -> list[tuple[int, Floats, Floats]]:
    """Return element and ends (2,) of the edges of free elements that do not lie on a support."""
    # Elements are counter-clockwise, so that material lies to the left of an edge.
    elements = assembly.elements
    size = float((elements.upper.max(axis=0) - elements.lower.min(axis=0)).max())
    supports = shapely.union_all([shapely.Polygon(elements.shape[k]) for k in np.flatnonzero(elements.support)])
    every = [
        (int(k), p, q)
        for k in elements.free.tolist()
        for p, q in zip(elements.shape[k], np.roll(elements.shape[k], -1, axis=0), strict=True)
    ]
    middles = shapely.points([0.5 * (p + q) for _, p, q in every])
    is_free = ~shapely.dwithin(middles, supports, _ON * size) if not supports.is_empty else np.ones(len(every), bool)
    return [edge for edge, free in zip(every, is_free.tolist(), strict=True) if free]


def _facing_edges(assembly: Assembly, facing: Floats, axis: Floats) -> list[Edge]:
    """Return the edges of free elements that face a direction (2,), by places along `axis` (2,)."""
    edges = []
    for element, p, q in _outer_edges(assembly):
        outward = np.array([q[1] - p[1], p[0] - q[0]])
        if float(outward @ facing) > _FACING * float(np.hypot(*outward)):
            a, b = (p, q) if float(p @ axis) < float(q @ axis) else (q, p)
            edges.append(Edge(element, float(a @ axis), float(b @ axis), a, b))
    return edges


_UNCOVERED: Final = 1e-3  # share of the line between two points on which no edge may lie


def _between(assembly: Assembly, first: Floats, last: Floats) -> LoadedLine:
    """Return the edges on the line between two points (2,); places are distances from the first."""
    elements = assembly.elements
    size = float((elements.upper.max(axis=0) - elements.lower.min(axis=0)).max())
    length = float(np.hypot(*(last - first)))
    axis = (last - first) / length
    normal = np.array([-axis[1], axis[0]])
    edges = []
    for element, p, q in _outer_edges(assembly):
        away = np.array([p - first, q - first])
        level, along = away @ normal, away @ axis
        if (abs(level) > _ON * size).any() or along.max() <= 0.0 or along.min() >= length:
            continue
        a, b = (p, q) if along[0] < along[1] else (q, p)
        low, high = float(along.min()), float(along.max())
        ends = np.clip([low, high], 0.0, length)
        p, q = (a + (end - low) / (high - low) * (b - a) for end in ends)
        edges.append(Edge(element, float(ends[0]), float(ends[1]), p, q))
    covered = sum(edge.high - edge.low for edge in edges)
    if covered < (1.0 - _UNCOVERED) * length:
        points = "({:.6g}, {:.6g}) and ({:.6g}, {:.6g})".format(*first, *last)
        problem = f"no free straight edge of the outline joins {points}"
        raise ParameterError("along", problem, "two points of one edge, in the unit of the outline")
    return LoadedLine(edges, np.zeros(2))


def _extrados(assembly: Assembly, down: Floats) -> LoadedLine:
    """Return the edges on the largest arc that is round outwards and upwards; places are lengths along it."""
    elements = assembly.elements
    parts = unions.union_outlines([elements.shape[k] for k in elements.free])
    arcs = [arc for part in parts for arc in voussoirs.find_arcs(part.shell) if not arc.hollow]
    arcs = [arc for arc in arcs if float((arc.point(0.5 * (arc.angles[0] + arc.angles[-1])) - arc.centre) @ down) < 0.0]
    if not arcs:
        problem = "no arc of the outline is round upwards"
        raise ParameterError("along", problem, "a side, or two points of its outline")
    arc = max(arcs, key=lambda arc: (arc.sweep * arc.radius, arc.radius))
    corners = np.array([arc.point(angle) for angle in arc.angles])
    line = shapely.LineString(corners)
    edges = []
    for element, p, q in _outer_edges(assembly):
        if (shapely.distance(shapely.points([p, q]), line) > 2.0 * _ON * arc.radius).any():
            continue
        # counter-clockwise, the angle grows along an edge; places run from the left
        ends = [line.length - float(line.project(shapely.Point(point))) for point in (q, p)]
        if ends[1] > ends[0]:
            edges.append(Edge(element, ends[0], ends[1], q, p))
    if not edges:
        raise ParameterError("along", "the extrados lies on supports", "a side, or two points of its outline")
    return LoadedLine(edges, np.zeros(2))


def _outer_edges(assembly: Assembly) -> list[tuple[int, Floats, Floats]]:
    """Return the free edges that no other free element touches."""
    elements = assembly.elements
    parts = unions.union_outlines([elements.shape[k] for k in elements.free])
    rings = [shapely.LinearRing(ring) for part in parts for ring in (part.shell, *part.holes)]
    outline = shapely.MultiLineString(rings)
    size = float((elements.upper.max(axis=0) - elements.lower.min(axis=0)).max())
    edges = _free_edges(assembly)
    near = shapely.dwithin(shapely.points([0.5 * (p + q) for _, p, q in edges]), outline, _ON * size)
    return [edge for edge, outer in zip(edges, near.tolist(), strict=True) if outer]


LEAST_SECONDS: Final = 10.0  # s; program start, reading, one solve and the page take some seconds

LOW_FRICTION: Final = 0.8  # share of the friction that the winner is checked at, where no low value is given

# options of reading a file that is no scene
READING: Final = (
    *("thickness", "tolerance", "unit", "up"),
    *("layer", "skip", "hole", "support", "load_layer", "dry", "inner"),
)

_PLACES: Final = 50  # largest number of places of a load; each is a load case


@dataclass(frozen=True)
class DesignOptions:
    """Limits, loads, materials and resources of a design; None keeps the value of the outline's file."""

    block_mass: float | None = None  # largest mass of a block, kg
    shapes: int | None = None  # largest number of different blocks, that is, of moulds
    load: str | None = None  # force that acts downwards, as "10 kN"; each place is a load case
    # part of the outline on which the load acts: "top", "bottom", "left", "right", "extrados" (the largest arc that is
    # round upwards), or two points of an edge as "X,Y,X,Y"
    along: str = "top"
    places: str = "1"  # number of places of the load at equal distances, or their shares of the length, as "0.25,0.5"
    # length over which the load is spread, m; None for a tenth of the length that it acts along
    width: float | None = None
    push: float | None = None  # horizontal load to either side, as a share of the weight; each side is a load case
    # friction, friction_low: friction coefficient of joints, and the low value at which the winner is checked
    friction: float | None = None
    friction_low: float | None = None
    # density, tension, shear: density, tensile and shear strength of the stone, kg/m³ and Pa
    density: float | None = None
    tension: float | None = None
    shear: float | None = None
    thickness: float | None = None  # out-of-plane thickness of a drawing
    # how a file that is no scene is read, as in `ImportOptions`
    tolerance: float | None = None
    unit: str | None = None
    up: Literal["y", "z"] | None = None
    layer: tuple[str, ...] = ()
    skip: tuple[str, ...] = ()
    hole: tuple[str, ...] = ()
    support: tuple[str, ...] = ()
    load_layer: tuple[str, ...] = ()
    dry: tuple[str, ...] = ()
    inner: tuple[str, ...] = ()
    # name of one of `LAID`: keep to layouts that can be laid, from a side or from the springings, or whose every stage
    # stands
    laid: str | None = None
    seconds: float = 300.0  # time limit of the whole design, s
    jobs: int = os.cpu_count() or 1  # number of worker processes
    seed: int = 0  # seed of searches and of random cells

    def __post_init__(self) -> None:
        for name in ("block_mass", "push", "friction", "friction_low", "density", "tension", "shear", "width"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ParameterError(name, f"{value:g} is wrong", "a number above 0")
        if self.shapes is not None and self.shapes < 1:
            raise ParameterError("shapes", f"{self.shapes} is no number of shapes", "a whole number from 1")
        if not self.seconds >= LEAST_SECONDS:
            problem = f"{self.seconds:g} s are too short to cut and solve anything"
            raise ParameterError("seconds", problem, f"at least {LEAST_SECONDS:g}; a wall takes some minutes")
        if self.jobs < 1:
            raise ParameterError("jobs", f"{self.jobs} is no number of processes", "a whole number from 1")
        if self.along not in (*SIDES, EXTRADOS) and points_of(self.along) is None:
            expected = f"{', '.join(SIDES)}, {EXTRADOS}, or two points X,Y,X,Y of an edge"
            raise ParameterError("along", f"{self.along!r} is no part of an outline", expected)
        if self.along != "top" and self.load is None:
            raise ParameterError("along", "no force acts there", "`load` with a force as well")
        if self.laid is not None and self.laid not in LAID:
            raise ParameterError("laid", f"{self.laid!r} is no order", "one of " + ", ".join(LAID))
        self._check_friction()
        self.shares()
        self.force("N")
        _ = self.reading

    def _check_friction(self) -> None:
        """Raise ParameterError if the low friction exceeds the nominal one, or stands alone."""
        if self.friction_low is not None and self.friction is None:
            raise ParameterError("friction_low", "it is given without `friction`", "both values")
        if self.friction_low is not None and self.friction is not None and self.friction_low > self.friction:
            problem = f"{self.friction_low:g} is above the friction, {self.friction:g}"
            raise ParameterError("friction_low", problem, "a value at most that of `friction`")

    def shares(self) -> list[float]:
        """Return where the load acts, as ascending shares (0 to 1) of the loaded length."""
        # A number of places gives the middles of as many equal parts.
        text = self.places.strip()
        try:
            if text.isdigit():
                count = int(text)
                shares = [(k + 0.5) / count for k in range(count)]
            else:
                shares = sorted(float(part) for part in text.split(","))
        except ValueError:
            shares = []
        if not 1 <= len(shares) <= _PLACES or not all(0.0 < share < 1.0 for share in shares):
            expected = f"a number of places up to {_PLACES}, or shares of the length between 0 and 1, as 0.25,0.5"
            raise ParameterError("places", f"{self.places!r} is wrong", expected)
        return shares

    def force(self, unit: str) -> float | None:
        """Return the downward load in a unit of force; None if no load is stated."""
        if self.load is None:
            return None
        try:
            written = forces.parse_force(self.load, unit)
        except InputError as error:
            raise ParameterError("load", error.problem, error.expected) from None
        if written.components or not written.values[0] > 0.0:
            raise ParameterError("load", f"{self.load!r} is no force downwards", 'one number above 0, as "10 kN"')
        return written.values[0]

    def of(self, scene: Scene) -> DesignOptions:
        """Return the options with numbers in the units of a scene, as they are where it names units unknown here."""
        system = units.system_of(scene.model_dump(exclude_defaults=True, include={"units", "materials"}))
        if not system.known:
            return self
        density, stress, length = 1.0 / system.density, 1.0 / system.si((1, -2)), 1.0 / system.si((0, 1))
        sizes = {"density": density, "tension": stress, "shear": stress}
        sizes |= {"block_mass": density * length**3, "width": length}
        return replace(
            self, **{k: size * getattr(self, k) for k, size in sizes.items() if getattr(self, k) is not None}
        )

    @property
    def reading(self) -> ImportOptions:
        """Options of reading a file that is no scene."""
        shared = {name: getattr(self, name) for name in READING if name != "load_layer"}
        return ImportOptions(load=self.load_layer, seconds=self.seconds, **shared)

    def given(self) -> dict[str, Any]:
        """Return the values by name of those options that differ from their defaults."""
        return {
            field.name: getattr(self, field.name)
            for field in fields(self)
            if getattr(self, field.name) != field.default and getattr(self, field.name) not in ((), None)
        }


_SPREAD: Final = 0.1  # default length over which a load is spread, relative to the length that it acts along

# Share of its width by which a load in space lies beside the middle, which is a joint of many tessellations
_BESIDE: Final = 1e-3


def with_loads(scene: Scene, options: DesignOptions, side: Floats | None = None) -> Scene:
    """Replace the live loads of a scene by those of the options, along `side` (d,)."""
    # The scene is returned as it is if the options state no load. The force at each place is a load case, as is the
    # push to either side. A force is spread on the pieces below it by their lengths, so that every tessellation carries
    # the same load.
    if options.load is None and options.push is None:
        return scene
    assembly = build_assembly(scene)
    side = side_of(assembly) if side is None else side
    document = scene.model_dump(mode="json", exclude_defaults=True)
    cases: list[dict[str, Any]] = []
    size = options.force(assembly.units[1])
    if size is not None:
        for at, live in _forces(assembly, size, options, side):
            cases.append({"name": f"load at {at:.4g}", "live": live})
    if options.push is not None:
        for name, sign in (("push to the right", 1.0), ("push to the left", -1.0)):
            cases.append({"name": name, "live": [{"body": (sign * options.push * side + 0.0).tolist()}]})
    loads = {key: value for key, value in document["loads"].items() if key == "dead"}
    document["loads"] = loads | ({"cases": cases} if len(cases) > 1 else {"live": cases[0]["live"]})
    return parse_scene(document, scene.name)


def side_of(assembly: Assembly) -> Floats:
    """Return the horizontal unit vector (d,) along which a structure spans."""
    # In the plane it is at right angles to gravity. In space it is a horizontal axis of the scene. If the largest free
    # element is a prism that does not stand upright, it is the axis most nearly across the prism. Otherwise it is the
    # longer side of the plan.
    down = _down(assembly)
    if assembly.dimension == 2:
        return np.array([-down[1], down[0]])
    elements = assembly.elements
    largest = int(max(elements.free, key=lambda k: elements.volume[k]))
    flat = [axis for axis in range(3) if abs(down[axis]) < 0.5]
    prism = prism_of(elements.shape[largest], elements.faces[largest])
    if prism is not None and abs(float(prism.axes[2] @ down)) < 0.5:
        axis = min(flat, key=lambda k: abs(prism.axes[2][k]))
    else:
        extent = elements.upper[elements.free].max(axis=0) - elements.lower[elements.free].min(axis=0)
        axis = max(flat, key=lambda k: extent[k])
    return np.asarray(np.eye(3)[axis])


def _down(assembly: Assembly) -> Floats:
    """Return the unit vector (d,) of the total weight; the negative last axis without weight."""
    total = assembly.elements.weight.sum(axis=0)
    length = float(np.linalg.norm(total))
    return np.asarray(total / length) if length > 0.0 else -np.asarray(np.eye(assembly.dimension)[-1])


def _forces(
    assembly: Assembly, size: float, options: DesignOptions, side: Floats
) -> list[tuple[float, list[dict[str, Any]]]]:
    """Return the coordinate along `side` (d,) and the point loads of the force at each place."""
    # in the plane places lie along the edges that the options name, and the force is spread on the outermost ones
    if assembly.dimension == 3:
        if options.along != "top":
            raise ParameterError("along", "loads in space act from above", "top, or a planar outline")
        return _forces_in_space(assembly, size, options, side)
    down = _down(assembly)
    line = loaded_line(assembly, options.along, down)
    low, high = line.ends
    width = options.width if options.width is not None else _SPREAD * (high - low)
    if not width < high - low:
        raise ParameterError("width", f"{width:g} is not below the loaded length, {high - low:g}", "a shorter length")
    points = []
    for share in options.shares():
        middle = min(max(low + share * (high - low), low + 0.5 * width), high - 0.5 * width)
        parts = line.spread(middle - 0.5 * width, middle + 0.5 * width)
        total = sum(right - left for _, left, right in parts)
        if not total > 0.0:
            problem = f"no free edge lies at the place {middle:.4g}"
            raise ParameterError("places", problem, "a place at the structure, away from its supports")
        live = []
        for edge, a, b in parts:
            # middle of the part as a share of its edge, and length of the part along the edge
            along = (0.5 * (a + b) - edge.low) / (edge.high - edge.low)
            reach = float(np.hypot(*(edge.q - edge.p))) * (b - a) / (edge.high - edge.low)
            live.append(
                {
                    "element": assembly.elements.ids[edge.element],
                    "force": ((b - a) / total * size * down).tolist(),
                    "at": (edge.p + along * (edge.q - edge.p)).tolist(),
                    # a patch that ends at a corner must not pass it by rounding
                    "width": (1.0 - 1e-9) * reach,
                }
            )
        points.append((middle, live))
    return points


def _forces_in_space(
    assembly: Assembly, size: float, options: DesignOptions, direction: Floats
) -> list[tuple[float, list[dict[str, Any]]]]:
    """Return the coordinate along `direction` (3,) and the point load at each place, on the uppermost face."""
    # across it the load acts near the middle of the plan, or of the nearest wall where nothing lies there
    if options.width is not None:
        raise ParameterError("width", "loads in space act at points", "a planar outline, or no width")
    plan = _Plan(assembly, direction)
    points = []
    for share in options.shares():
        at = plan.loaded_point(share)
        element, at[plan.vertical] = plan.uppermost(at)
        live = [{"element": assembly.elements.ids[element], "force": (size * plan.down).tolist(), "at": at.tolist()}]
        points.append((float(at[plan.side]), live))
    return points


class _Plan:
    """Faces of the free elements of a spatial structure, seen from above."""

    def __init__(self, assembly: Assembly, direction: Floats) -> None:
        elements = assembly.elements
        self.down = _down(assembly)
        # axes: the vertical one, both of the plan, that along which places lie, the other one of the plan
        self.vertical, self.side = int(np.argmax(abs(self.down))), int(np.argmax(abs(direction)))
        self._flat = [axis for axis in range(3) if axis != self.vertical]
        self._other = next(axis for axis in self._flat if axis != self.side)
        corners = np.concatenate([elements.shape[k] for k in elements.free])
        self._lower, self._upper = corners.min(axis=0), corners.max(axis=0)
        faces = [(k, elements.shape[k][list(loop)]) for k in elements.free.tolist() for loop in elements.faces[k]]
        outlines = [(k, face, shapely.Polygon(face[:, self._flat])) for k, face in faces]
        # element, corners and outline in the plan of each face that is not upright
        self._faces = [(k, face, outline) for k, face, outline in outlines if outline.area > 0.0]
        self._covered = shapely.union_all([shapely.buffer(outline, 0.0) for _, _, outline in self._faces])

    def loaded_point(self, share: float) -> Floats:
        """Return the point (3,) of the plan, vertical coordinate 0, for a share of its length."""
        point, side, other = np.zeros(3), self.side, self._other
        point[side] = self._lower[side] + share * (self._upper[side] - self._lower[side])
        ends = np.array([self._lower, self._upper])
        ends[:, side] = point[side]
        parts = shapely.get_parts(shapely.intersection(self._covered, shapely.LineString(ends[:, self._flat])))
        spans = [shapely.get_coordinates(part)[:, self._flat.index(other)] for part in parts]
        if not spans:
            raise ParameterError("places", f"nothing lies below the place {point[side]:.4g}", "another place")
        middle = self._lower[other] + (0.5 - _BESIDE) * (self._upper[other] - self._lower[other])
        if any(span.min() <= middle <= span.max() for span in spans):
            point[other] = middle
            return point
        # of walls about as near as the nearest, the first
        extent = np.ptp(ends)
        nearest = min(spans, key=lambda span: (round(float(abs(span - middle).min() / extent), 2), span.min()))
        point[other] = nearest.min() + (0.5 - _BESIDE) * np.ptp(nearest)
        return point

    def uppermost(self, point: Floats) -> tuple[int, float]:
        """Return the element on top at a point (3,) of the plan, the first of equals, and its vertical coordinate."""
        spot = shapely.Point(point[self._flat])
        hits = [(self._height(face, point), -k) for k, face, outline in self._faces if outline.covers(spot)]
        height, element = max(hits)
        return -element, float(-height * np.sign(self.down[self.vertical]))

    def _height(self, corners: Floats, point: Floats) -> float:
        """Return the height of a plane face (k, 3) above a point (3,) of the plan; −inf for an upright face."""
        middle, flat, vertical = corners.mean(axis=0), self._flat, self.vertical
        normal = np.linalg.svd(corners - middle)[2][2]
        if abs(normal[vertical]) < _UPRIGHT:
            return -np.inf
        level = middle[vertical] - (normal[flat] @ (point[flat] - middle[flat])) / normal[vertical]
        return float(-level * np.sign(self.down[vertical]))


_UPRIGHT: Final = 1e-9  # vertical component of a unit normal below which a face is upright


# Keys of a search that speak of the cells of a scene, which a design cuts anew
_OF_CELLS: Final = ("block_cells", "dry_faces", "candidates", "keep", "except", "symmetry", "void")


@dataclass(frozen=True)
class Outline:
    """Scene of an outline to be cut, with the values that were assumed."""

    scene: Scene  # scene with the outline as its free elements, and the loads that its file states
    assumed: tuple[str, ...]  # values and choices that the file does not state, one phrase each


def read_outline(file: File, options: DesignOptions) -> Outline:
    """Read the scene, drawing or solid of an outline, and apply the options to it."""
    if _is_scene(file):
        for name in READING:
            if getattr(options, name):
                raise ParameterError(
                    name.partition("_")[0],
                    "the outline is a scene, which states this itself",
                    "a drawing, or no such option",
                )
        notes = Notes()
        with libraries.reading(file):
            scene = _unite_elements(load_scene(file), notes)
    else:
        scene, notes = _import(file, options)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    options = options.of(scene)
    document["materials"] = _materials(document, options, notes, scene.dimension)
    search = dict(document.get("search", {}))
    if options.block_mass is not None:
        search["block_mass"] = [None, options.block_mass]
    if options.shapes is not None:
        search["shapes"] = [1, options.shapes]
        # as moulds are counted on the page and in the cutting list; a planar stone may be turned over
        search.setdefault("moulds", {"rotate": True, "flip": scene.dimension == 2})
    if options.laid is not None:
        search["assemble"] = LAID[options.laid][0]
    if search:
        document["search"] = search
    with libraries.reading(file):
        completed = parse_scene(document, str(file))
        build_assembly(completed)
    return Outline(completed, tuple(notes.assumed))


def _is_scene(file: File) -> bool:
    """Return whether a file is a scene; broken JSON counts as one, whose reader names the error."""
    if file.suffix.lower() != ".json":
        return False
    try:
        document = json.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return True  # the reader of scenes says in one line what is wrong
    return not isinstance(document, dict) or "loads" in document or "elements" in document or "grid" in document


def _unite_elements(scene: Scene, notes: Notes) -> Scene:
    """Unite the free elements of a planar scene of one material to outlines without holes; return others unchanged."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    # entries of `document`, changed in place
    owners = [document["loads"], *document["loads"].get("cases", [])]
    entries = [entry.model_dump(mode="json", exclude_defaults=True) for entry in build_geometry(scene).entries]
    free = [entry for entry in entries if not entry.get("support")]
    is_uniform = not any(key in entry for entry in free for key in ("density", "weight", "volume", "centroid"))
    if (
        scene.dimension == 3
        or len(free) == 1
        or scene.interfaces is not None
        or not is_uniform
        or scene.materials.faces
    ):
        return scene
    _refuse_named_elements(scene, owners)
    elements = build_assembly(scene).elements
    parts = unions.union_outlines([elements.shape[k] for k in elements.free])
    if any(part.holes for part in parts):
        return scene
    united = [{"id": f"outline{k}", "polygon": part.shell.tolist()} for k, part in enumerate(parts)]
    shapes = [shapely.Polygon(part.shell) for part in parts]

    for owner in owners:
        for key in ("live", "dead"):
            if key in owner:
                owner[key] = [_on_outline(entry, elements, shapes) for entry in owner[key]]
    if scene.grid is not None:
        document["thickness"] = scene.grid.thickness
    dropped = [key for key in _OF_CELLS if document.get("search", {}).pop(key, None) is not None]
    notes.assumed.append(f"the {len(free)} elements of the scene are one outline, whose joints are chosen anew")
    if dropped:
        notes.assumed.append(f"search.{', search.'.join(dropped)} left out: they speak of the cells of the scene")
    for key in ("grid", "labels", "move"):
        document.pop(key, None)
    document["elements"] = [*united, *(entry for entry in entries if entry.get("support"))]
    return parse_scene(document, scene.name)


def _on_outline(entry: dict[str, Any], elements: Elements, outlines: list[shapely.Polygon]) -> dict[str, Any]:
    """Return a load that refers to the outline that its element is part of, wherever it acts."""
    if "element" not in entry:
        return entry
    k = elements.index[entry["element"]]
    inside = shapely.Polygon(elements.shape[k]).representative_point()
    number = int(np.argmin(shapely.distance(outlines, inside)))
    at = entry.get("at") or elements.centroid[k].tolist()
    return {**entry, "element": f"outline{number}", **({"at": at} if entry.get("force") is not None else {})}


def _refuse_named_elements(scene: Scene, owners: list[dict[str, Any]]) -> None:
    """Raise InputError for members, or loads on faces between elements; owners: the loads and their cases as JSON."""
    pairs = [
        entry["face"].get("between")
        for owner in owners
        for entry in owner.get("live", []) + owner.get("dead", [])
        if "face" in entry
    ]
    if scene.members or any(pairs):
        where = "members" if scene.members else "loads"
        problem = "they name elements, and the free ones of the scene become one outline"
        remedy = 'a pressure "along" a line' if any(pairs) else "a drawing or scene with one element for each part"
        raise InputError(where, problem, remedy)


def _import(file: File, options: DesignOptions) -> tuple[Scene, Notes]:
    """Convert a drawing or a file of solids to a scene, and collect what was assumed."""
    # Supports are added below it if the file has none.
    if options.load is not None and options.force("N") == options.force("kN"):
        raise ParameterError("load", f"{options.load!r} names no unit of force", 'a force, as "10 kN"')
    imported = import_file(file, options.reading, feet=True)
    report = imported.report
    notes = Notes(found=list(report.found), assumed=list(report.assumed), doubtful=list(report.doubtful))
    with libraries.reading(file):
        # the options say what was assumed instead
        complaint = ("no load was found", "edit materials")
        loadless = any(complaint[0] in note for note in notes.assumed)
        notes.assumed = [note for note in notes.assumed if not any(words in note for words in complaint)]
        if loadless and options.load is None and options.push is None:
            notes.assumed.append("the live load is the weight acting sideways: no load was given or drawn")
        if imported.document["materials"] == exchange_options.DEFAULT_MATERIALS:
            notes.assumed += _defaults(options)
        scene = parse_scene(imported.document, str(file))
    if scene.dimension == 3 and options.thickness is not None:
        raise ParameterError("thickness", "the outline is a solid, which has its own", "a drawing, or no such option")
    _refuse_size(scene, options, notes)
    return scene, notes


def _refuse_size(scene: Scene, options: DesignOptions, notes: Notes) -> None:
    """Raise ParameterError for an outline of a size that no structure has, if no unit is stated."""
    elements = build_geometry(scene).elements if scene.units.length == "m" else None
    for doubt in notes.doubtful:
        problem, _, unit = doubt.partition(", --unit ")
        if unit and options.unit is None and elements is not None:
            free = elements.free
            extent = elements.upper[free].max(axis=0) - elements.lower[free].min(axis=0)
            if cells.hardly_meant(float(extent.max())):
                raise ParameterError("unit", problem, f"a unit, such as {unit}")
        notes.assumed.append(f"doubtful: {problem}")


def _defaults(options: DesignOptions) -> list[str]:
    """List the default material values in words, without those that the options state."""
    defaults = exchange_options.DEFAULT_MATERIALS
    values = {
        "density": ("density", defaults["density"], " kg/m³"),
        "friction": ("friction", defaults["dry"]["friction_coefficient"], ""),
        "tension": ("tensile strength of the stone", defaults["inner"]["tensile_strength"] / 1e6, " N/mm²"),
        "shear": ("shear strength of the stone", defaults["inner"]["shear_strength"] / 1e6, " N/mm²"),
    }
    return [
        f"{words} {value:g}{unit}" for name, (words, value, unit) in values.items() if getattr(options, name) is None
    ]


def _materials(document: dict[str, Any], options: DesignOptions, notes: Notes, dimension: int) -> dict[str, Any]:
    # Default strengths and friction replace missing ones, and a low friction is added.
    completed = {**document["materials"]}
    if options.density is not None:
        completed["density"] = options.density
    dry = dict(completed.get("dry") or exchange_options.DEFAULT_MATERIALS["dry"])
    usual = {"materials": exchange_options.DEFAULT_MATERIALS}
    file_units = {"force": "N", "length": "m"} | document.get("units", {})
    if units.UnitSystem.named(**file_units).known:
        usual = units.in_units(usual, file_units, dimension)
    inner = dict(completed.get("inner") or usual["materials"]["inner"])
    if not completed.get("dry") and options.friction is None:
        notes.assumed.append(f"friction {exchange_options.DEFAULT_MATERIALS['dry']['friction_coefficient']:g}")
    if not completed.get("inner") and (options.tension is None or options.shear is None):
        notes.assumed.append(f"{exchange_options.DEFAULT_STRENGTHS}, where not given")
    if options.friction is not None:
        dry.pop("friction_angle", None)
        dry["friction_coefficient"] = {"nominal": options.friction, "low": options.friction_low or 0.0}
    value = dry.get("friction_coefficient")
    if options.friction_low is None and (options.friction is not None or isinstance(value, float | int)):
        nominal = float(options.friction if options.friction is not None else value)  # type: ignore[arg-type]
        dry["friction_coefficient"] = {"nominal": nominal, "low": LOW_FRICTION * nominal}
        notes.assumed.append(f"low friction {LOW_FRICTION * nominal:.3g}, {LOW_FRICTION:g} of {nominal:g}")
    for name, key in (("tension", "tensile_strength"), ("shear", "shear_strength")):
        if getattr(options, name) is not None:
            inner[key] = getattr(options, name)
    return {**completed, "dry": dry, "inner": inner}
