"""Dry structure with corners that move: faces and loads as exact polynomials, from its scene alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

from jld_core import InputError, Route, Scene, build_assembly
from jld_core.scene import loads as scene_loads
from jld_core.scene import uncertain
from jld_geometry.box_certificate import BoxClaim, Pair

# coefficients by the exponents of the parameters; those left out are zero
Polynomial = dict[tuple[int, ...], Fraction | int]


def product(one: Polynomial, other: Polynomial) -> Polynomial:
    found: Polynomial = {}
    for left, factor in one.items():
        for right, value in other.items():
            power = tuple(a + b for a, b in zip(left, right, strict=True))
            found[power] = found.get(power, 0) + factor * value
    return found


def add(total: Polynomial, term: Mapping[tuple[int, ...], Fraction | int], factor: Fraction | int = 1) -> None:
    """Add a multiple of a polynomial to another one, which is changed."""
    for power, value in term.items():
        total[power] = total.get(power, 0) + factor * value


def is_at_least_zero(polynomial: Polynomial, parameters: int, degree: int, *, strictly: bool = False) -> bool:
    """Return whether Bernstein coefficients prove a polynomial non-negative on the unit box."""
    terms = [(power, value) for power, value in polynomial.items() if value]
    if not terms:
        return not strictly
    if all(not any(power) for power, _ in terms):
        return terms[0][1] > 0
    weights = _weights(degree)
    places: list[tuple[int, ...]] = [()]
    for _ in range(parameters):
        places = [(*place, k) for place in places for k in range(degree + 1)]
    for place in places:
        total: Fraction | int = 0
        for power, value in terms:
            weight = 1
            for k, exponent in zip(place, power, strict=True):
                weight *= weights[k][exponent]
            total += weight * value
        if total < 0 or (strictly and total == 0):
            return False
    return True


def _weights(degree: int) -> list[list[int]]:
    """Return binom(k, j) / binom(degree, j) times a common denominator, as [k][j]."""
    shared = math.lcm(*(math.comb(degree, j) for j in range(degree + 1)))
    return [[math.comb(k, j) * shared // math.comb(degree, j) for j in range(degree + 1)] for k in range(degree + 1)]


_ROUTE: Final = Route("certificates of boxes", frozenset({"friction"}))

Vector = tuple[Fraction, Fraction]  # exact vector or point in the plane

_MOST: Final = 4  # largest number of parameters


@dataclass(frozen=True)
class Joint:
    """Dry face between two elements."""

    # a, b: elements; -1 for a support
    a: int
    b: int
    ends: tuple[Pair, Pair]  # points at which it begins and ends along the counter-clockwise outline of a
    friction: Fraction  # friction coefficient


@dataclass(frozen=True)
class Loads:
    """Loads of one kind on the elements."""

    per_area: dict[int, Vector]  # force per area of the element
    points: list[tuple[int, Vector, Vector, Fraction]]  # forces at fixed points, and moments


class BoxStructure:
    """Structure of a claim: exact outlines, joints, and loads of every case."""

    def __init__(self, scene: Scene, claim: BoxClaim) -> None:
        self.parameters = len(claim.box)
        if not 1 <= self.parameters <= _MOST:
            raise InputError("box", f"it has {self.parameters} parameters", f"one to {_MOST}")
        _require_known(scene)
        entries = scene.elements or []
        self._names = {entry.id: k for k, entry in enumerate(entries)}
        self.free = {k for k, entry in enumerate(entries) if not entry.support}
        self.outlines: list[list[Pair]] = []
        for entry in entries:
            outline = [(point[0], point[1]) for point in entry.polygon or []]
            self.outlines.append(outline if _twice_area(outline) > 0 else outline[::-1])
        self._ways = self._displacements(claim)
        self.changing = {k for k, loop in enumerate(self.outlines) if any(point in self._ways for point in loop)}
        self.joints = self._joints(scene)
        thickness = Fraction(scene.plane_thickness)
        density, sizes = self._weights(scene, thickness)
        loads = uncertain.with_means(scene.loads.model_dump(mode="json"))
        stated = loads["cases"] or [{"dead": [], "live": loads["live"], "required": 1.0}]
        self.cases = []
        for case in stated:
            dead = self._loads([*loads["dead"], *case["dead"]], sizes, density)
            self.cases.append((dead, self._loads(case["live"], sizes, {}), Fraction(case["required"])))

    def _displacements(self, claim: BoxClaim) -> dict[Pair, list[Vector]]:
        """Return the displacement by each parameter of every point that moves."""
        corners = {point for loop in self.outlines for point in loop}
        found: dict[Pair, list[Vector]] = {}
        for parameter, motion in enumerate(claim.directions):
            if len({point for point, _ in motion}) < len(motion):
                raise InputError("directions", "a point stands twice in one of them", "each point once")
            for point, way in motion:
                if point not in corners:
                    raise InputError("directions", f"{list(point)} is no corner of an element", "corners of elements")
                still = [(Fraction(0), Fraction(0)) for _ in range(self.parameters)]
                found.setdefault(point, still)[parameter] = (Fraction(way[0]), Fraction(way[1]))
        return found

    def _joints(self, scene: Scene) -> list[Joint]:
        """Return the joints of a scene, except those between two supports; InputError for others."""
        assembly = build_assembly(scene)  # for strengths, which it reads from several places of a scene
        assembly.members.refuse("a certificate of a box")
        if not assembly.labels.all():
            raise InputError("interfaces", "a face is inner", "dry joints alone")
        strengths = assembly.strengths(_ROUTE, assembly.labels)
        found: list[Joint] = []
        for entry in scene.interfaces or []:
            a, b = (self._names[name] for name in entry.elements)
            if a not in self.free and b not in self.free:
                continue
            first, second = ((point[0], point[1]) for point in entry.polygon)
            ends = next((e for e in ((first, second), (second, first)) if _follows(self.outlines[a], *e)), None)
            if ends is None or not _follows(self.outlines[b], ends[1], ends[0]):
                problem = f"the face of {entry.elements} does not run from corner to corner of both"
                raise InputError("interfaces", problem, "faces between consecutive corners")
            friction = Fraction(float(strengths.friction[len(found)]))
            sides = [k if k in self.free else -1 for k in (a, b)]
            found.append(Joint(sides[0], sides[1], ends, friction))
        if len(found) != len(assembly.interfaces):
            raise InputError("interfaces", "they are not all stated", "a scene that states its interfaces")
        return found

    def _weights(self, scene: Scene, thickness: Fraction) -> tuple[dict[int, Vector], dict[int, Fraction]]:
        """Return the self-weight per area of each free element as a vector, and its magnitude."""
        gravity = scene.materials.gravity
        vector = [0.0, -gravity] if isinstance(gravity, float | int) else list(gravity)
        size = math.hypot(*vector)
        way = (Fraction(0), Fraction(-1)) if size == 0.0 else (Fraction(vector[0] / size), Fraction(vector[1] / size))
        weights, sizes = {}, {}
        for k, entry in enumerate(scene.elements or []):
            if k not in self.free:
                continue
            if entry.weight is not None:
                if k in self.changing:
                    problem = f"the weight of {entry.id!r} is stated, and its shape changes"
                    raise InputError("elements", problem, "a density")
                sizes[k] = Fraction(entry.weight) / (_twice_area(self.outlines[k]) / 2)
                weights[k] = (sizes[k] * way[0], sizes[k] * way[1])
                continue
            density = entry.density if entry.density is not None else scene.materials.density or 0.0
            sizes[k] = Fraction(density) * thickness * Fraction(size)
            weights[k] = tuple(Fraction(density) * thickness * Fraction(one) for one in vector)  # type: ignore[assignment]
        return weights, sizes

    def _loads(self, entries: list[dict[str, Any]], sizes: dict[int, Fraction], start: dict[int, Vector]) -> Loads:
        per_area = dict(start)
        points: list[tuple[int, Vector, Vector, Fraction]] = []
        for entry in entries:
            if (body := scene_loads.body_of(entry)) is not None:
                x, y = (Fraction(value) for value in body)
                for k, size in sizes.items():
                    old = per_area.get(k, (Fraction(0), Fraction(0)))
                    per_area[k] = (old[0] + size * x, old[1] + size * y)
                continue
            if "element" not in entry or isinstance(entry["moment"], list):
                raise InputError("loads", "pressure on faces is not checked", "forces and moments on elements")
            name, force, at = entry["element"], entry["force"], entry["at"]
            k = self._names[name]
            if at is None and force is not None and k in self.changing:
                problem = f"a force acts at the centroid of {name!r}, whose shape changes"
                raise InputError("loads", problem, 'a force with "at"')
            place = _centroid(self.outlines[k]) if at is None else (Fraction(at[0]), Fraction(at[1]))
            x, y = (Fraction(value) for value in force or [0.0, 0.0])
            points.append((k, (x, y), place, Fraction(entry["moment"])))
        return Loads(per_area, points)

    # --- polynomials over a box ------------------------------------------------------------------------

    def place(self, point: Pair, low: list[Fraction], high: list[Fraction]) -> tuple[Polynomial, Polynomial]:
        """Return the coordinates x and y of a point over a box, as polynomials on the unit box."""
        # The variables of the polynomials run from 0 to 1 in the box.
        none = (0,) * self.parameters
        ways = self._ways.get(point)
        found: tuple[Polynomial, Polynomial] = ({}, {})
        for axis in range(2):
            found[axis][none] = Fraction(point[axis])
            for k, way in enumerate(ways or []):
                if way[axis]:
                    found[axis][none] += way[axis] * low[k]
                    power = tuple(int(j == k) for j in range(self.parameters))
                    found[axis][power] = way[axis] * (high[k] - low[k])
        return found

    def moments(
        self, element: int, low: list[Fraction], high: list[Fraction]
    ) -> tuple[Polynomial, Polynomial, Polynomial]:
        """Return area and first moments ∫x, ∫y of an element over a box, as polynomials."""
        corners = [self.place(point, low, high) for point in self.outlines[element]]
        area: Polynomial = {}
        first: tuple[Polynomial, Polynomial] = ({}, {})
        for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
            turn = product(x0, y1)
            add(turn, product(x1, y0), -1)
            add(area, turn, Fraction(1, 2))
            for axis, (one, other) in enumerate(((x0, x1), (y0, y1))):
                both = dict(one)
                add(both, other)
                add(first[axis], product(both, turn), Fraction(1, 6))
        return area, first[0], first[1]


def _require_known(scene: Scene) -> None:
    """Raise InputError for a scene with content that certificates of a box do not cover."""
    if scene.dimension != 2 or scene.grid is not None or scene.interfaces is None:
        raise InputError("elements", "they are no polygons with stated interfaces", "a planar scene that states them")
    if scene.loads.moving or scene.loads.pushes or scene.settlements:
        problem = "moving loads, pushes and settlements are not checked"
        raise InputError("loads", problem, '"cases" in the place of the former, and no settlements')
    for entry in scene.elements or []:
        if entry.volume is not None or entry.centroid is not None:
            raise InputError("elements", f"{entry.id!r} states its volume or centroid", "those of its polygon")


def _twice_area(outline: list[Pair]) -> Fraction:
    corners = [(Fraction(x), Fraction(y)) for x, y in outline]
    pairs = zip(corners, corners[1:] + corners[:1], strict=True)
    return sum((a[0] * b[1] - a[1] * b[0] for a, b in pairs), Fraction(0))


def _centroid(outline: list[Pair]) -> Vector:
    corners = [(Fraction(x), Fraction(y)) for x, y in outline]
    pairs = list(zip(corners, corners[1:] + corners[:1], strict=True))
    turns = [a[0] * b[1] - a[1] * b[0] for a, b in pairs]
    moments = [Fraction(0), Fraction(0)]
    for (a, b), turn in zip(pairs, turns, strict=True):
        moments = [old + (a[k] + b[k]) * turn for k, old in enumerate(moments)]
    area = 3 * sum(turns, Fraction(0))
    return moments[0] / area, moments[1] / area


def _follows(outline: list[Pair], first: Pair, second: Pair) -> bool:
    return first in outline and outline[(outline.index(first) + 1) % len(outline)] == second
