"""Loads of a scene as loads of the assembly: forces, pushes, settlements and pressures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import Assembly, Elements, Interfaces
from jld_core.build.fill import Backing, PointEntry
from jld_core.errors import InputError
from jld_core.geometry import across, area_vector, spun
from jld_core.loads import Loads, Traction, edge_traction, points_of
from jld_core.scene import FillLoad, PointLoad
from jld_core.scene.loads import OUTSIDE, BodyLoad, Case, FaceLoad, LoadEntry, MovingLoad, Pushes, TiltLoad
from jld_core.scene.materials import Strip
from jld_core.scene.schema import Scene


class PlacedCase(NamedTuple):
    where: str  # key in the scene
    case: Case  # the load case
    # of a moving load: its name and direction, and the distance of its first axle along the path; None for other cases
    place: tuple[str, float] | None = None


_Axle = tuple[Floats, Floats, float]  # point, direction of travel, weight


def cases_of(
    moving: MovingLoad, elements: Elements, downwards: Floats, where: str, backing: Backing | None = None
) -> list[PlacedCase]:
    """Return one load case for each position of a vehicle, named by the place of its first axle along the path.

    Axles on joints give a case for each side; positions with no axle on a free element are left out. downwards: (2,)
    unit direction of weights.
    """
    if elements.centroid.shape[1] == 3 or any(len(point) != 2 for point in moving.path):
        raise InputError(where, "it is for planar scenes", '"cases" with the positions of the loads')
    cases: list[PlacedCase] = []
    path = np.array(moving.path, dtype=float)
    directions = [("", path), (" back", path[::-1])] if moving.both_directions else [("", path)]
    for suffix, points in directions:
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if not (lengths > 0.0).all():
            raise InputError(f"{where}.path", "two of its points coincide", "points apart from each other")
        for front, axles in _positions(moving, points, lengths):
            on_fill, on_elements = _split_by_bearing(axles, elements, downwards, where, backing)
            name = f"{moving.name}{suffix} at {front:.6g}"
            # an axle on a joint stands on either side of it: the limits of the positions ahead and behind
            for side in range(max((len(owners) for owners, _ in on_elements), default=1)):
                bearing = [(owners[min(side, len(owners) - 1)], load) for owners, load in on_elements]
                live = on_fill + [
                    load.model_copy(update={"element": elements.ids[k]})
                    for k, load in bearing
                    if not elements.support[k]
                ]
                if live:
                    title = name if side == 0 else f"{name} behind the joint" + f" {side}" * (side > 1)
                    case = Case(name=title, live=live, required=moving.required)
                    cases.append(PlacedCase(where, case, (f"{moving.name}{suffix}", front)))
    if not cases:
        raise InputError(f"{where}.path", "it touches supports alone", "points on free elements")
    return cases


def _split_by_bearing(
    axles: list[_Axle], elements: Elements, downwards: Floats, where: str, backing: Backing | None
) -> tuple[list[LoadEntry], list[tuple[list[int], PointLoad]]]:
    """Return loads of the axles on fill, and those on elements, each with the elements at its point."""
    on_fill: list[LoadEntry] = []
    on_elements: list[tuple[list[int], PointLoad]] = []
    for point, unit, weight in axles:
        if backing is not None and backing.carries(point):
            position = backing.position(point)
            if backing.covers(position):
                on_fill.append(FillLoad(on_fill=Strip(at=position), weight=weight))
            continue
        owners = _elements_under(elements, point, unit)
        if not owners:
            problem = f"no element is at ({point[0]:.6g}, {point[1]:.6g})"
            raise InputError(f"{where}.path", problem, "points on the outline of the structure")
        force = (weight * downwards).tolist()
        on_elements.append((owners, PointLoad(element="", force=force, at=point.tolist())))
    return on_fill, on_elements


def _positions(moving: MovingLoad, points: Floats, lengths: Floats) -> Iterator[tuple[float, list[_Axle]]]:
    """Yield in equal steps the distance of the first axle along a path (k, 2), and the axles on the path."""
    offsets = np.cumsum([0.0, *(axle.distance for axle in moving.axles[1:])])
    ends = np.append(0.0, np.cumsum(lengths))
    length = float(ends[-1])
    for front in np.linspace(0.0, length + float(offsets[-1]), moving.steps).tolist():
        forces = []
        for position, axle in zip((front - offsets).tolist(), moving.axles, strict=True):
            if -tolerances.ON_OUTLINE * length <= position <= (1.0 + tolerances.ON_OUTLINE) * length:
                leg = min(int(np.searchsorted(ends, position, side="right")) - 1, len(lengths) - 1)
                leg = max(leg, 0)
                unit = (points[leg + 1] - points[leg]) / lengths[leg]
                forces.append((points[leg] + (position - ends[leg]) * unit, unit, axle.weight))
        yield front, forces


def _elements_under(elements: Elements, point: Floats, unit: Floats) -> list[int]:
    """Return the elements that a point (2,) touches, the farthest along `unit` (2,) first."""
    reach = tolerances.ON_OUTLINE * elements.size
    near: Ints = np.flatnonzero(((elements.lower - reach <= point) & (point <= elements.upper + reach)).all(axis=1))
    location = shapely.Point(*point)
    touching = [k for k in near.tolist() if shapely.Polygon(elements.shape[k]).distance(location) <= reach]
    return sorted(touching, key=lambda k: -float(elements.centroid[k] @ unit))


def patch_tractions(elements: Elements, interfaces: Interfaces, entry: FaceLoad, where: str) -> list[Traction]:
    """Return a uniform load on a plane patch as tractions on the element faces below it, without those of supports."""
    key = f"{where}.face.patch"
    corners = _corners(elements, entry, key)
    normal = area_vector(corners)
    area = float(np.linalg.norm(normal))
    reach, origin = tolerances.ON_OUTLINE * elements.size, corners.mean(axis=0)
    if not (area > reach * elements.size and np.abs((corners - origin) @ normal).max() <= reach * area):
        raise InputError(key, "its corners lie on no plane", "the corners of a plane polygon, in order")
    normal = normal / area
    frame = across(normal)
    patch = shapely.Polygon((corners - origin) @ np.transpose(frame))
    if not patch.is_valid:
        raise InputError(key, "its outline crosses itself", "the corners of a plane polygon, in order")
    tractions, covered = list[Traction](), 0.0
    low, high = corners.min(axis=0) - reach, corners.max(axis=0) + reach
    for index in np.flatnonzero(((elements.lower <= high) & (low <= elements.upper)).all(axis=1)).tolist():
        for loop in elements.faces[index]:
            face = elements.shape[index][list(loop)]
            outward = _unit_vector(face)
            if abs(float(outward @ normal)) < 1.0 - tolerances.ON_OUTLINE:
                continue
            if np.abs((face - origin) @ normal).max() > reach:
                continue
            part = patch.intersection(_flat(face, frame, origin))
            part = _free(part, interfaces, index, normal, frame, origin, reach)
            covered += part.area
            if not elements.support[index]:
                tractions += _tractions(index, part, _force_per_area(entry, outward), frame, origin, reach)
    if abs(covered - patch.area) > 4.0 * reach * patch.length:
        problem = f"of its area of {patch.area:.6g}, {covered:.6g} is free surface"
        raise InputError(key, problem, "a polygon on faces of solids that touch no others there")
    return tractions


def _corners(elements: Elements, entry: FaceLoad, key: str) -> Floats:
    """Return the corners (k, 3) of a patch; raise InputError for a planar scene or uneven pressure."""
    points = [*(entry.face.patch or []), *([entry.traction] if entry.traction is not None else [])]
    if elements.centroid.shape[1] == 2 or any(len(point) != 3 for point in points):
        raise InputError(
            key, "it is for spatial scenes, with points and vectors of three numbers", '"along" in the plane'
        )
    first, last = entry.ends
    if first != last:
        raise InputError(key, "the pressure varies, and a patch has no first and last point", "one number")
    return np.array(entry.face.patch, dtype=float)


def _force_per_area(entry: FaceLoad, outward: Floats) -> Floats:
    return -entry.ends[0] * outward if entry.traction is None else np.array(entry.traction, dtype=float)


def surface_tractions(elements: Elements, interfaces: Interfaces, index: int, pressure: float) -> list[Traction]:
    """Return a uniform pressure on the whole free surface of a solid, one traction per free part of a face."""
    reach, tractions = tolerances.ON_OUTLINE * elements.size, list[Traction]()
    for loop in elements.faces[index]:
        face = elements.shape[index][list(loop)]
        outward, origin = _unit_vector(face), face.mean(axis=0)
        frame = across(outward)
        part = _free(_flat(face, frame, origin), interfaces, index, outward, frame, origin, reach)
        tractions += _tractions(index, part, -pressure * outward, frame, origin, reach)
    return tractions


def _unit_vector(face: Floats) -> Floats:
    vector = area_vector(face)
    return np.asarray(vector / np.linalg.norm(vector))


def _flat(face: Floats, frame: Floats, origin: Floats) -> shapely.Polygon:
    return shapely.Polygon((face - origin) @ np.transpose(frame))


def _free(
    part: shapely.Geometry,
    interfaces: Interfaces,
    index: int,
    normal: Floats,
    frame: Floats,
    origin: Floats,
    reach: float,
) -> shapely.Geometry:
    """Return what the interfaces of an element leave of a part of its face, in the coordinates of `frame`."""
    for face in np.flatnonzero((interfaces.a == index) | (interfaces.b == index)).tolist():
        outline = interfaces.polygon[face]
        if part.area > 0.0 and np.abs((outline - origin) @ normal).max() <= reach:
            part = part.difference(_flat(outline, frame, origin))
    return part


def _tractions(
    index: int, part: shapely.Geometry, value: Floats, frame: Floats, origin: Floats, reach: float
) -> list[Traction]:
    """Return a uniform force per area (3,) on the polygons of a part of a face, in the coordinates of `frame`."""
    tractions = []
    for polygon in shapely.get_parts(part):
        if polygon.geom_type == "Polygon" and polygon.area > reach**2:
            rings = tuple(origin + np.asarray(r.coords)[:-1] @ frame for r in (polygon.exterior, *polygon.interiors))
            centroid = origin + np.array([polygon.centroid.x, polygon.centroid.y]) @ frame
            tractions.append(Traction(index, rings, centroid, value, np.zeros((3, 3))))
    return tractions


def body_forces(entry: BodyLoad | TiltLoad, elements: Elements, where: str) -> Floats:
    """Return the forces (n, d) of a body load: magnitudes of weights times its vector, zero on supports."""
    tilts = isinstance(entry, TiltLoad)
    body = _vector(entry.body, elements.centroid.shape[1], f"{where}.{'tilt.towards' if tilts else 'body'}")
    magnitude = np.linalg.norm(elements.weight, axis=1)
    if tilts and abs(elements.weight @ body).max(initial=0.0) > 1e-9 * magnitude.max(initial=0.0):
        raise InputError(f"{where}.tilt.towards", "it is not horizontal", "a direction across gravity")
    return np.asarray(np.where(elements.support, 0.0, magnitude)[:, None] * body)


def couple_of(entry: PointLoad, elements: Elements, where: str) -> tuple[int, Floats]:
    index = elements.named(entry.element, f"{where}.element", "the id of a free element", support=False)
    expected = 1 if elements.centroid.shape[1] == 2 else 3
    if elements.support[index]:
        raise InputError(f"{where}.element", f"{entry.element!r} is a support", "the id of a free element")
    moment = np.atleast_1d(np.asarray(entry.moment, dtype=float))
    if expected == 3 and moment.size == 1 and moment[0] == 0.0:
        moment = np.zeros(3)
    if moment.size != expected:
        raise InputError(f"{where}.moment", f"it has {moment.size} numbers", f"{expected} in this scene")
    return index, moment


def force_of(entry: PointLoad, index: int, elements: Elements, where: str) -> PointEntry:
    d = elements.centroid.shape[1]
    force = _vector(entry.force or [], d, f"{where}.force")
    at = elements.centroid[index] if entry.at is None else _vector(entry.at, d, f"{where}.at")
    return index, at, force, entry.width, entry.at is None


def _vector(values: list[float], dimension: int, where: str) -> Floats:
    """Convert numbers to a vector; raise InputError unless their number is `dimension`."""
    if len(values) != dimension:
        raise InputError(where, f"it has {len(values)} number{'s' * (len(values) != 1)}", f"{dimension} in this scene")
    return np.array(values, dtype=float)


_PLANAR: Final = 2  # number of horizontal directions of a planar structure


def cases_of_pushes(pushes: Pushes, downwards: Floats, where: str) -> list[Case]:
    """Return one load case for each direction of a push, named by its angle in degrees.

    Angles are planar 0 or 180, spatial from the first horizontal axis; downwards: (d,) unit direction of weights.
    """
    d = len(downwards)
    # angles count from gravity turned by +90°, in space from the horizontal part of the first axis that has one
    zero_angle = np.array([-downwards[-1], downwards[0]])
    if d == 3:
        axis = next(row for row in np.eye(3) if abs(float(row @ downwards)) < 0.9)
        horizontal = axis - (axis @ downwards) * downwards
        zero_angle = np.asarray(horizontal / np.linalg.norm(horizontal))
    if isinstance(pushes.directions, int):
        if d == 2 and pushes.directions > _PLANAR:
            problem = f"{pushes.directions} horizontal directions in a planar scene"
            raise InputError(f"{where}.directions", problem, "1 or 2, or a list of vectors")
        units = _horizontal(pushes.directions, zero_angle, downwards)
    else:
        units = [_unit(vector, d, f"{where}.directions[{k}]") for k, vector in enumerate(pushes.directions)]
    names = [f"{pushes.name} {_angles(unit, zero_angle, downwards)}" for unit in units]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError(f"{where}.directions[{k}]", "it is a direction that stands before", "each direction once")
    return [
        Case(name=name, live=[BodyLoad(body=(pushes.of_weight * unit + 0.0).tolist())], required=pushes.required)
        for name, unit in zip(names, units, strict=True)
    ]


def _horizontal(count: int, zero_angle: Floats, downwards: Floats) -> list[Floats]:
    """Return horizontal unit vectors (d,) at equal angles, beginning with `zero_angle`."""
    if len(zero_angle) == 2:
        return [sign * zero_angle for sign in (1.0, -1.0)[:count]]
    second = np.cross(-downwards, zero_angle)
    angles = [2.0 * math.pi * k / count for k in range(count)]
    units = np.array([math.cos(angle) * zero_angle + math.sin(angle) * second for angle in angles])
    units[np.abs(units) <= tolerances.ROUNDING] = 0.0
    return list(units)


def _unit(vector: list[float], dimension: int, where: str) -> Floats:
    """Return the unit vector (d,) of a direction; raise InputError for a wrong length or a zero vector."""
    if len(vector) != dimension:
        raise InputError(where, f"it has {len(vector)} numbers", f"{dimension} in this scene")
    length = float(np.linalg.norm(vector))
    if not length > 0.0:
        raise InputError(where, "it is zero", "a direction")
    return np.array(vector, dtype=float) / length


def _angles(unit: Floats, zero_angle: Floats, downwards: Floats) -> str:
    """Return the angle of a direction as text, degrees; in space also its slope, if any."""
    if len(zero_angle) == 2:
        return f"at {_degrees(float(unit @ -downwards), float(unit @ zero_angle))}°"
    second = np.cross(-downwards, zero_angle)
    rise = float(unit @ -downwards)
    slope = "" if abs(rise) <= tolerances.ROUNDING else f" up {math.degrees(math.asin(min(1.0, max(-1.0, rise)))):.6g}°"
    return f"at {_degrees(float(unit @ second), float(unit @ zero_angle))}°{slope}"


def _degrees(rise: float, run: float) -> str:
    """Return an angle as text, from 0 up to below 360 degrees."""
    angle = math.degrees(math.atan2(rise, run)) % 360.0
    return f"{0.0 if min(angle, 360.0 - angle) < 1e-9 else angle:.6g}"


@dataclass(frozen=True)
class Settlement:
    """Movement of supports with a given direction and an unknown magnitude."""

    name: str  # name in the scene
    # (n, 3) velocity of each element about its centroid, translation then rotation; zero except for supports that move
    velocity: Floats
    load: float = 0.0  # share of the live load that acts during the settlement


def settlements_of(scene: Scene, assembly: Assembly) -> tuple[Settlement, ...]:
    return tuple(
        Settlement(entry.name, _velocity(scene, assembly, k), entry.load) for k, entry in enumerate(scene.settlements)
    )


def _velocity(scene: Scene, assembly: Assembly, position: int) -> Floats:
    """Return the velocities (n, q) of all elements for one settlement."""
    elements, d, q = assembly.elements, assembly.dimension, assembly.freedoms
    velocity = np.zeros((len(elements), q))
    faces = assembly.interfaces
    in_contact = set(np.concatenate([faces.a, faces.b]).tolist())
    for number, entry in enumerate(scene.settlements[position].supports):
        key = f"settlements[{position}].supports[{number}]"
        names = [entry.elements] if isinstance(entry.elements, str) else entry.elements
        rows = []
        for name in names:
            row = elements.named(name, f"{key}.elements", "ids of supports", support=True)
            if not elements.support[row]:
                raise InputError(f"{key}.elements", f"{name!r} is no support", "ids of supports")
            rows.append(row)
        if not in_contact.intersection(rows):
            raise InputError(f"{key}.elements", "no free element touches them", "supports that bear something")
        move = _vector(entry.move if entry.move is not None else [0.0] * d, d, f"{key}.move")
        turn = _vector(
            np.atleast_1d(entry.turn).tolist() if np.any(entry.turn) else [0.0] * (q - d), q - d, f"{key}.turn"
        )
        centre = (
            elements.centroid[rows].mean(axis=0) if entry.about is None else _vector(entry.about, d, f"{key}.about")
        )
        for row in rows:
            arm = elements.centroid[row] - centre
            velocity[row] += np.concatenate([move + spun(turn, arm), turn])
    if not velocity.any():
        raise InputError(f"settlements[{position}]", "nothing moves", '"move" or "turn" of some support')
    return velocity


@dataclass(frozen=True)
class Boundary:
    """Elements and interfaces of a structure, from which free boundaries follow."""

    elements: Elements
    interfaces: Interfaces  # all interfaces, also those that a scene states
    thickness: float  # thickness of planar elements, length
    backing: Backing | None = None  # fill on the structure, None without fill

    def loads(self, entries: Sequence[LoadEntry], key: str) -> Loads:
        """Return load entries as loads on elements. Pressures become tractions on free edges or faces."""
        d = self.elements.centroid.shape[1]
        body = np.zeros((len(self.elements), d))
        couples = np.zeros((len(self.elements), 1 if d == 2 else 3))
        points, tractions = [], list[Traction]()
        for position, entry in enumerate(entries):
            where = f"{key}[{position}]"
            if isinstance(entry, BodyLoad | TiltLoad):
                body += body_forces(entry, self.elements, where)
            elif isinstance(entry, PointLoad):
                index, couple = couple_of(entry, self.elements, where)
                couples[index] += couple
                if entry.force is not None:
                    points.append(force_of(entry, index, self.elements, where))
            elif isinstance(entry, FillLoad):
                spread = self._on_fill(entry, where)
                tractions += [load for load in spread if isinstance(load, Traction)]
                points += [load for load in spread if not isinstance(load, Traction)]
            elif entry.face.along is not None:
                tractions += self._along(entry, entry.face.along, where)
            elif entry.face.patch is not None:
                tractions += patch_tractions(self.elements, self.interfaces, entry, where)
            else:
                tractions += self._around(entry, where)
        return Loads(body, couples, points_of(points, d), tuple(tractions))

    def _on_fill(self, entry: FillLoad, where: str) -> list[Traction | PointEntry]:
        if self.backing is None:
            raise InputError(f"{where}.on_fill", "the scene has no fill", '"fill" with level, density and friction')
        return self.backing.spread(entry, where)

    @property
    def _reach(self) -> float:
        """Return the distance up to which a point counts as on an outline, length."""
        return tolerances.ON_OUTLINE * self.elements.size

    def _around(self, entry: FaceLoad, where: str) -> list[Traction]:
        """Return the tractions of a uniform pressure on the whole free boundary of one element."""
        name, neighbour = entry.face.between or ("", "")
        if neighbour != OUTSIDE or name not in self.elements.index:
            problem = f"no free face lies between {name!r} and {neighbour!r}"
            raise InputError(f"{where}.face.between", problem, f'the id of a free element, and "{OUTSIDE}"')
        index = self.elements.index[name]
        if self.elements.support[index]:
            raise InputError(f"{where}.face.between", f"{name!r} is a support", "the id of a free element")
        first, last = entry.ends
        if first != last:
            problem = "the pressure varies, and the faces of an element have no first and last point"
            raise InputError(f"{where}.pressure", problem, 'one number, or "along" with two points')
        if self.elements.centroid.shape[1] == 3:
            return surface_tractions(self.elements, self.interfaces, index, first)
        free = [
            self._piece(index, start, end, (first, first))
            for _, _, pieces in self._edges(index)
            for start, end in pieces
        ]
        if not free:
            raise InputError(f"{where}.face.between", f"no face of {name!r} is free", "an element with a free face")
        return free

    def _along(self, entry: FaceLoad, along: list[list[float]], where: str) -> list[Traction]:
        """Return the tractions of a pressure or line load along a polyline, all of which must be free boundary."""
        if self.elements.centroid.shape[1] == 3 or any(len(point) != 2 for point in (*along, entry.line or (0, 0))):
            raise InputError(f"{where}.face.along", "it is for planar scenes", '"between" or "patch"')
        points = np.array(along, dtype=float)
        legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if not (legs > self._reach).all():
            raise InputError(f"{where}.face.along", "two of its points coincide", "points apart from each other")
        share_at = np.append(0.0, np.cumsum(legs)) / legs.sum()
        first, last = entry.ends
        tractions: list[Traction] = []
        for k, leg in enumerate(legs.tolist()):
            ends = [first + (last - first) * share for share in (share_at[k], share_at[k + 1])]
            pieces = list(self._on_leg(points[k], (points[k + 1] - points[k]) / leg, leg))
            covered = sum(high - low for _, low, high, _ in pieces)
            if abs(covered - leg) > self._reach * (1 + len(pieces)):
                problem = f"of its {leg:.6g} from point {k + 1} to {k + 2}, {covered:.6g} is free boundary"
                raise InputError(f"{where}.face.along", problem, "points on the outline of the structure")
            for index, low, high, forward in pieces:
                values = [ends[0] + (ends[1] - ends[0]) * share / leg for share in (low, high)]
                start, end = (points[k] + share * (points[k + 1] - points[k]) / leg for share in (low, high))
                if self.elements.support[index]:
                    continue
                if entry.line is not None:
                    tractions.append(edge_traction(index, np.array([start, end]), np.array([entry.line, entry.line])))
                elif forward:
                    tractions.append(self._piece(index, start, end, (values[0], values[1])))
                else:
                    tractions.append(self._piece(index, end, start, (values[1], values[0])))
        return tractions

    def _on_leg(self, start: Floats, unit: Floats, length: float) -> Iterator[tuple[int, float, float, bool]]:
        """Yield the pieces of free boundary along one leg of a polyline from `start` (2,) along `unit` (2,)."""
        reach = self._reach
        ends = np.array([start, start + length * unit])
        low, high = ends.min(axis=0) - reach, ends.max(axis=0) + reach
        touches_box = ((self.elements.lower <= high) & (low <= self.elements.upper)).all(axis=1)
        for index in np.flatnonzero(touches_box).tolist():
            for first, last, pieces in self._edges(index):
                offsets = [abs((p - start)[0] * unit[1] - (p - start)[1] * unit[0]) for p in (first, last)]
                if max(offsets) > reach:
                    continue
                forward = bool((last - first) @ unit > 0.0)
                for free_start, free_end in pieces:
                    low_end, high_end = sorted((float((free_start - start) @ unit), float((free_end - start) @ unit)))
                    low_end, high_end = max(low_end, 0.0), min(high_end, length)
                    if high_end - low_end > reach:
                        yield index, low_end, high_end, forward

    def _edges(self, index: int) -> Iterator[tuple[Floats, Floats, list[tuple[Floats, Floats]]]]:
        """Yield the ends of each edge of a planar element, with its free intervals."""
        reach = self._reach
        outline = self.elements.shape[index]
        faces_of_element = np.flatnonzero((self.interfaces.a == index) | (self.interfaces.b == index))
        for first, last in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            length = float(np.hypot(*(last - first)))
            if length <= reach:
                continue
            unit = (last - first) / length
            covered = []
            for face in faces_of_element.tolist():
                arm = self.interfaces.polygon[face] - first
                if abs(arm[:, 0] * unit[1] - arm[:, 1] * unit[0]).max() <= reach:
                    low, high = sorted((arm @ unit).tolist())
                    covered.append((max(low, 0.0), min(high, length)))
            free, covered_to = [], 0.0
            for low, high in [*sorted(span for span in covered if span[1] > span[0]), (length, length)]:
                if low - covered_to > reach:
                    free.append((first + covered_to * unit, first + low * unit))
                covered_to = max(covered_to, high)
            yield first, last, free

    def _piece(self, index: int, start: Floats, end: Floats, pressures: tuple[float, float]) -> Traction:
        """Return a linear pressure on a straight free piece of an outline (planar)."""
        inward = np.array([start[1] - end[1], end[0] - start[0]]) / np.hypot(*(end - start))
        return edge_traction(index, np.array([start, end]), np.outer(pressures, self.thickness * inward))
