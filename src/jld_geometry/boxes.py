"""Check proofs over boxes exactly, docs/method.md (11.7), sharing only the reading of scenes with the search."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Floats, InputError, Route, Scene, build_assembly, parse_scene
from jld_core.scene import loads as scene_loads
from jld_core.scene import uncertain
from jld_explore.verification import certificate

VERSION: Final = 1  # version of the file format

KEY: Final = "jld box certificate"  # key of the version in the first line

# Remedy in error messages about a damaged certificate
_EXPECTED: Final = "a certificate as jld move --prove --certificate writes it"

Pair = tuple[float, float]  # a point, a displacement, or the ends of an interval


@dataclass(frozen=True)
class BoxClaim:
    """Statement of a certificate: no position in the box carries more than `bound`."""

    scene: dict[str, Any]  # scene with stated interfaces as JSON, not validated; positions are measured from it
    bound: float  # upper bound on λ, scene units; with load cases on the governing factor
    box: tuple[Pair, ...]  # least and greatest value of each parameter, lengths
    # for each parameter the points that it moves, and their displacement for a parameter of one
    directions: tuple[tuple[tuple[Pair, Pair], ...], ...]
    parameters: tuple[float, ...] | None = None  # best position found
    load_factor: float | None = None  # λ that it carries; None if no position was found to stand
    made_by: str = ""  # name of the program that wrote the certificate


@dataclass(frozen=True)
class Split:
    """Node of the tree: the box is split into two along one parameter, the lower half first."""

    axis: int  # index of the parameter
    at: float  # value of the parameter at the common end of both halves, length


@dataclass(frozen=True)
class Leaf:
    """Node of the tree: a mechanism that bounds λ of all positions in the box."""

    case: int  # position of the load case
    digits: int  # binary digits of the velocities after the point
    # velocities (ux, uy, ω) of elements as integers over 2**digits: a point (x, y) of the plane has the velocity (ux −
    # ω y, uy + ω x)
    moves: dict[int, tuple[int, ...]]


Node = Split | Leaf


def write(path: Path, claim: BoxClaim, nodes: Iterable[Node]) -> None:
    head = {KEY: VERSION, **{name: value for name, value in vars(claim).items() if name != "scene"}}
    lines = [{**head, "scene": claim.scene}, *(_line(node) for node in nodes)]
    certificate.write_lines(path, lines)


def _line(node: Node) -> dict[str, Any]:
    if isinstance(node, Split):
        return {"split": node.axis, "at": node.at}
    moves = {str(element): velocity for element, velocity in node.moves.items()}
    return {"case": node.case, "digits": node.digits, "moves": moves}


def read(path: Path) -> tuple[BoxClaim, list[Node]]:
    """Read a certificate without checking scene and tree; InputError if it is damaged."""

    def parse(head: dict[str, Any], lines: list[Any]) -> tuple[BoxClaim, list[Node]]:
        if head.keys() != BoxClaim.__dataclass_fields__.keys():
            raise InputError(str(path), "the keys of its first line are not those of a certificate", _EXPECTED)
        return _claim(head), [_node(line) for line in lines]

    return certificate.read_lines(path, KEY, _EXPECTED, VERSION, parse)


def _claim(head: dict[str, Any]) -> BoxClaim:
    """Read the claim of a first line without its version; raise ValueError if it is invalid."""
    if not isinstance(head["scene"], dict) or not isinstance(head["made_by"], str):
        raise ValueError
    box = tuple(_pair(ends) for ends in head["box"])
    directions = tuple(tuple((_pair(point), _pair(step)) for point, step in motion) for motion in head["directions"])
    factor = head["load_factor"]
    best = None if head["parameters"] is None else tuple(_number(value) for value in head["parameters"])
    if not box or len(directions) != len(box) or any(low >= high for low, high in box):
        raise ValueError
    if (factor is None) != (best is None) or (best is not None and len(best) != len(box)):
        raise ValueError
    load_factor = None if factor is None else _number(factor)
    return BoxClaim(head["scene"], _number(head["bound"]), box, directions, best, load_factor, head["made_by"])


def _node(line: dict[str, Any]) -> Node:
    """Read a line of a certificate: a split, or the mechanism of a leaf; ValueError otherwise."""
    if line.keys() == {"split", "at"}:
        (axis,) = certificate.numbers_of([line["split"]])
        return Split(axis, _number(line["at"]))
    if line.keys() != {"case", "digits", "moves"}:
        raise ValueError
    case, digits = certificate.numbers_of([line["case"], line["digits"]])
    moves = {int(element): certificate.numbers_of(velocity) for element, velocity in line["moves"].items()}
    if not 0 <= digits < certificate.MOST_DIGITS or [str(element) for element in moves] != list(line["moves"]):
        raise ValueError
    if any(len(velocity) != 3 for velocity in moves.values()):
        raise ValueError
    return Leaf(case, digits, moves)


def _number(value: object) -> float:
    """Return a finite number; raise ValueError for anything else."""
    number = certificate.finite(value)
    if number is None:
        raise ValueError
    return number


def _pair(values: object) -> Pair:
    """Return two finite numbers; raise ValueError for anything else."""
    if not isinstance(values, list) or len(values) != 2:
        raise ValueError
    return _number(values[0]), _number(values[1])


# coefficients by the exponents of the parameters; those left out are zero
Polynomial = dict[tuple[int, ...], Fraction | int]


def product(first: Polynomial, second: Polynomial) -> Polynomial:
    polynomial: Polynomial = {}
    for power_of_first, factor in first.items():
        for power_of_second, value in second.items():
            power = tuple(a + b for a, b in zip(power_of_first, power_of_second, strict=True))
            polynomial[power] = polynomial.get(power, 0) + factor * value
    return polynomial


def add(total: Polynomial, term: Mapping[tuple[int, ...], Fraction | int], factor: Fraction | int = 1) -> None:
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
    indices: list[tuple[int, ...]] = [()]
    for _ in range(parameters):
        indices = [(*index, k) for index in indices for k in range(degree + 1)]
    for index in indices:
        total: Fraction | int = 0
        for power, value in terms:
            weight = 1
            for k, exponent in zip(index, power, strict=True):
                weight *= weights[k][exponent]
            total += weight * value
        if total < 0 or (strictly and total == 0):
            return False
    return True


def _weights(degree: int) -> list[list[int]]:
    """Return binom(k, j) / binom(degree, j) times a common denominator, as [k][j]."""
    shared = math.lcm(*(math.comb(degree, j) for j in range(degree + 1)))
    return [[math.comb(k, j) * shared // math.comb(degree, j) for j in range(degree + 1)] for k in range(degree + 1)]


_STRUCTURE_ROUTE: Final = Route("certificates of boxes", frozenset({"friction"}))

Vector = tuple[Fraction, Fraction]  # exact vector or point in the plane

_MOST: Final = 4  # largest number of parameters
_SAME: Final = 1e-9  # relative difference of numbers up to which two scenes are the same


@dataclass(frozen=True)
class Joint:
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
        self._steps = self._displacements(claim)
        self.changing = {k for k, loop in enumerate(self.outlines) if any(point in self._steps for point in loop)}
        self.joints = self._joints(scene)
        thickness = Fraction(scene.plane_thickness)
        density, sizes = self._weights(scene, thickness)
        loads = uncertain.with_means(scene.loads.model_dump(mode="json"))
        cases = loads["cases"] or [{"dead": [], "live": loads["live"], "required": 1.0}]
        self.cases = []
        for case in cases:
            dead = self._loads([*loads["dead"], *case["dead"]], sizes, density)
            self.cases.append((dead, self._loads(case["live"], sizes, {}), Fraction(case["required"])))
        self._require_all_loads(build_assembly(scene))

    def _require_all_loads(self, assembly: Assembly) -> None:
        """Raise InputError unless the loads read here are all of an assembly; fill, for example, is not read."""
        for (*own_loads, _), case in zip(self.cases, assembly.by_case, strict=True):
            for loads, resultants in zip(own_loads, (case.dead, case.live), strict=True):
                sums = np.zeros_like(resultants)
                for k, force in loads.per_area.items():
                    sums[k, :2] += [float(component * _twice_area(self.outlines[k]) / 2) for component in force]
                for k, (x, y), at, moment in loads.points:
                    centre = _centroid(self.outlines[k])
                    turn = (at[0] - centre[0]) * y - (at[1] - centre[1]) * x + moment
                    sums[k] += [float(x), float(y), float(turn)]
                least = _SAME * max(1.0, assembly.size) * abs(resultants).max(initial=0.0)
                if not np.allclose(sums, resultants, rtol=_SAME, atol=least):
                    raise InputError("loads", "some, such as fill, are not checked", "forces and moments on elements")

    def _displacements(self, claim: BoxClaim) -> dict[Pair, list[Vector]]:
        """Return the step of each corner by each parameter of the box."""
        corners = {point for loop in self.outlines for point in loop}
        steps: dict[Pair, list[Vector]] = {}
        for parameter, motion in enumerate(claim.directions):
            if len({point for point, _ in motion}) < len(motion):
                raise InputError("directions", "a point stands twice in one of them", "each point once")
            for point, step in motion:
                if point not in corners:
                    raise InputError("directions", f"{list(point)} is no corner of an element", "corners of elements")
                no_steps = [(Fraction(0), Fraction(0)) for _ in range(self.parameters)]
                steps.setdefault(point, no_steps)[parameter] = (Fraction(step[0]), Fraction(step[1]))
        return steps

    def _joints(self, scene: Scene) -> list[Joint]:
        """Return the joints of a scene, except those between two supports; InputError for others."""
        assembly = build_assembly(scene)  # for strengths, which it reads from several places of a scene
        assembly.members.refuse("a certificate of a box")
        if not assembly.labels.all():
            raise InputError("interfaces", "a face is inner", "dry joints alone")
        strengths = assembly.strengths(_STRUCTURE_ROUTE, assembly.labels)
        joints: list[Joint] = []
        for entry in scene.interfaces or []:
            a, b = (self._names[name] for name in entry.elements)
            if a not in self.free and b not in self.free:
                continue
            first, second = ((point[0], point[1]) for point in entry.polygon)
            ends = next((e for e in ((first, second), (second, first)) if _follows(self.outlines[a], *e)), None)
            if ends is None or not _follows(self.outlines[b], ends[1], ends[0]):
                problem = f"the face of {entry.elements} does not run from corner to corner of both"
                raise InputError("interfaces", problem, "faces between consecutive corners")
            friction = Fraction(float(strengths.friction[len(joints)]))
            sides = [k if k in self.free else -1 for k in (a, b)]
            joints.append(Joint(sides[0], sides[1], ends, friction))
        if len(joints) != len(assembly.interfaces):
            raise InputError("interfaces", "they are not all stated", "a scene that states its interfaces")
        return joints

    def _weights(self, scene: Scene, thickness: Fraction) -> tuple[dict[int, Vector], dict[int, Fraction]]:
        """Return the self-weight per area of each free element as a vector, and its magnitude."""
        gravity = scene.materials.gravity
        vector = [0.0, -gravity] if isinstance(gravity, float | int) else list(gravity)
        size = math.hypot(*vector)
        down = (Fraction(0), Fraction(-1)) if size == 0.0 else (Fraction(vector[0] / size), Fraction(vector[1] / size))
        weights, sizes = {}, {}
        for k, entry in enumerate(scene.elements or []):
            if k not in self.free:
                continue
            if entry.weight is not None:
                if k in self.changing:
                    problem = f"the weight of {entry.id!r} is stated, and its shape changes"
                    raise InputError("elements", problem, "a density")
                sizes[k] = Fraction(entry.weight) / (_twice_area(self.outlines[k]) / 2)
                weights[k] = (sizes[k] * down[0], sizes[k] * down[1])
                continue
            density = entry.density if entry.density is not None else scene.materials.density or 0.0
            sizes[k] = Fraction(density) * thickness * Fraction(size)
            weights[k] = tuple(Fraction(density) * thickness * Fraction(component) for component in vector)  # type: ignore[assignment]
        return weights, sizes

    def _loads(self, entries: list[dict[str, Any]], sizes: dict[int, Fraction], weights: dict[int, Vector]) -> Loads:
        # in fractions, which nothing rounds; `sizes`: weight per area, of which a body load is a multiple
        per_area = dict(weights)
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
            at_point = _centroid(self.outlines[k]) if at is None else (Fraction(at[0]), Fraction(at[1]))
            x, y = (Fraction(value) for value in force or [0.0, 0.0])
            points.append((k, (x, y), at_point, Fraction(entry["moment"])))
        return Loads(per_area, points)

    # --- polynomials over a box ------------------------------------------------------------------------

    def place(self, point: Pair, low: list[Fraction], high: list[Fraction]) -> tuple[Polynomial, Polynomial]:
        """Return the coordinates x and y of a point over a box, as polynomials on the unit box."""
        # The variables of the polynomials run from 0 to 1 in the box.
        constant = (0,) * self.parameters
        steps = self._steps.get(point)
        coordinates: tuple[Polynomial, Polynomial] = ({}, {})
        for axis in range(2):
            coordinates[axis][constant] = Fraction(point[axis])
            for k, step in enumerate(steps or []):
                if step[axis]:
                    coordinates[axis][constant] += step[axis] * low[k]
                    power = tuple(int(j == k) for j in range(self.parameters))
                    coordinates[axis][power] = step[axis] * (high[k] - low[k])
        return coordinates

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
            for axis, (start, end) in enumerate(((x0, x1), (y0, y1))):
                total = dict(start)
                add(total, end)
                add(first[axis], product(total, turn), Fraction(1, 6))
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


_ROUTE: Final = Route("certificates of boxes")

Velocity = tuple[Fraction, Fraction, Fraction]  # exact velocity (ux, uy, ω) about the origin of coordinates

# Degrees in one parameter: of jumps times the length of a joint, and of powers, as weights act at first moments
_JUMP_DEGREE: Final = 2
_POWER_DEGREE: Final = 3

_STILL: Velocity = (Fraction(0), Fraction(0), Fraction(0))  # velocity of elements that do not move


@dataclass(frozen=True)
class VerifiedBox:
    """Result of a successful check: no position in the box carries a λ above `claim.bound`."""

    claim: BoxClaim  # statement of the certificate
    scene: Scene  # scene that the certificate holds
    boxes: int  # number of boxes with a mechanism of their own
    size: int  # size of the file, bytes
    seconds: float  # time of the check, s


def is_box_certificate(path: Path) -> bool:
    """Return whether a file begins like the certificate of a proof over a box."""
    try:
        with path.open("rb") as file:
            return file.read(len(KEY) + 16).lstrip().startswith(f'{{"{KEY}"'.encode())
    except (OSError, ValueError):
        return False


def verify_box(path: Path, scene: Scene | None = None) -> VerifiedBox:
    """Check a certificate of `jld move --prove`; InputError for the first thing that does not hold."""
    start = time.perf_counter()
    claim, nodes = read(path)
    own_scene = parse_scene(claim.scene, str(path))
    if scene is not None:
        _require_same(scene, own_scene, str(path))
    try:
        boxes = check_boxes(own_scene, claim, nodes)
    except InputError as error:
        raise error.within(str(path)) from None
    return VerifiedBox(claim, own_scene, boxes, path.stat().st_size, time.perf_counter() - start)


def _require_same(scene: Scene, own: Scene, path: str) -> None:
    """Raise InputError unless two scenes are the same structure and loads, to 1e-9."""
    given, stated = build_assembly(scene), build_assembly(own)
    if given.elements.ids != stated.elements.ids or _numbers(given).shape != _numbers(stated).shape:
        same = False
    else:
        same = np.allclose(_numbers(given), _numbers(stated), rtol=_SAME, atol=_SAME)
    if not same:
        raise InputError(path, f"it is of another scene ({own.name!r})", f"a certificate of {scene.name!r}")


def _numbers(assembly: Assembly) -> Floats:
    """Return geometry, loads, friction and labels of an assembly as one vector."""
    # Lengths are relative to the size of the structure, and loads to the largest one.
    elements, faces, size = assembly.elements, assembly.interfaces, assembly.size
    loads = [load for case in assembly.by_case for load in (case.dead, case.live)]
    largest = np.array([abs(load).max(initial=0.0) for load in loads])
    scaled = [load / (most or 1.0) for load, most in zip(loads, largest.tolist(), strict=True)]
    parts = [elements.centroid / size, elements.volume, faces.origin / size, faces.l1, largest, *scaled]
    parts += [assembly.strengths(_ROUTE).friction, assembly.required]
    parts += [values.astype(float) for values in (faces.a, faces.b, assembly.labels)]
    return np.concatenate([part.ravel() for part in parts])


def check_boxes(scene: Scene, claim: BoxClaim, nodes: list[Node]) -> int:
    """Check the tree of a certificate; return its number of boxes with a mechanism."""
    checker = _Checker(BoxStructure(scene, claim), claim)
    start = [Fraction(low) for low, _ in claim.box], [Fraction(high) for _, high in claim.box]
    open_boxes, leaves = [start], 0
    for number, node in enumerate(nodes, 1):
        if not open_boxes:
            raise InputError(f"node {number}", "the tree ends before it", "one tree")
        low, high = open_boxes.pop()
        if isinstance(node, Leaf):
            checker.check(node, low, high, number)
            leaves += 1
            continue
        open_boxes += _halves(node, low, high, number)
    if open_boxes:
        raise InputError("tree", f"it leaves {len(open_boxes)} boxes without a mechanism", "a tree of the whole box")
    return leaves


def _halves(
    node: Split, low: list[Fraction], high: list[Fraction], number: int
) -> list[tuple[list[Fraction], list[Fraction]]]:
    """Return the upper and the lower half of a box, each as (low, high)."""
    at = Fraction(node.at)
    if not 0 <= node.axis < len(low) or not low[node.axis] < at < high[node.axis]:
        raise InputError(f"node {number}", "it splits outside of its box", "a split inside")
    upper, lower = list(low), list(high)
    upper[node.axis] = lower[node.axis] = at
    return [(upper, high), (low, lower)]


class _Checker:
    def __init__(self, structure: BoxStructure, claim: BoxClaim) -> None:
        self._structure, self._bound = structure, Fraction(claim.bound)

    def check(self, leaf: Leaf, low: list[Fraction], high: list[Fraction], number: int) -> None:
        """Raise InputError unless a mechanism proves the bound for all positions of a box."""
        structure, unit = self._structure, 1 << leaf.digits
        if not 0 <= leaf.case < len(structure.cases) or not leaf.moves.keys() <= structure.free:
            raise InputError(
                f"node {number}", "it names a load case or element that is not there", "those of the scene"
            )
        moves = {
            k: (Fraction(ux, unit), Fraction(uy, unit), Fraction(turn, unit))
            for k, (ux, uy, turn) in leaf.moves.items()
        }
        if not self._opens(moves, low, high):
            problem = "in its mechanism a joint closes, or slides without opening, somewhere in the box"
            raise InputError(f"node {number}", problem, "a mechanism that holds in the whole box")
        dead, live, required = structure.cases[leaf.case]
        dead_power, live_power = self._power(dead, moves, low, high), self._power(live, moves, low, high)
        balance = dict(dead_power)
        add(balance, live_power, self._bound * required)
        # no joint dissipates, so λ ≤ bound · required where dead_power + bound · required · live_power ≥ 0
        below = self._is_positive(live_power, strictly=True) and self._is_positive(balance)
        # or it falls under its own weight
        falls = self._is_positive(dead_power, strictly=True) and self._is_positive(live_power)
        if not (below or falls):
            raise InputError(f"node {number}", "its mechanism lets positions carry more than the bound", "a proof")

    def _is_positive(self, power: Polynomial, *, strictly: bool = False) -> bool:
        return is_at_least_zero(power, self._structure.parameters, _POWER_DEGREE, strictly=strictly)

    def _opens(self, moves: dict[int, Velocity], low: list[Fraction], high: list[Fraction]) -> bool:
        """Return whether no joint resists a mechanism, at any position in the box."""
        # A joint does not resist if it opens at both ends by at least friction times the slip.
        structure, none = self._structure, (0,) * self._structure.parameters
        for joint in structure.joints:
            jump = [b - a for a, b in zip(moves.get(joint.a, _STILL), moves.get(joint.b, _STILL), strict=True)]
            if not any(jump):
                continue
            (x0, y0), (x1, y1) = ends = [structure.place(end, low, high) for end in joint.ends]
            along: tuple[Polynomial, Polynomial] = (dict(x1), dict(y1))
            add(along[0], x0, -1)
            add(along[1], y0, -1)
            for x, y in ends:
                speed: tuple[Polynomial, Polynomial] = ({none: jump[0]}, {none: jump[1]})
                add(speed[0], y, -jump[2])
                add(speed[1], x, jump[2])
                # components of the speed along the normal (e_y, −e_x) and along the joint e, times its length
                normal = product(along[1], speed[0])
                add(normal, product(along[0], speed[1]), -1)
                slide = product(along[0], speed[0])
                add(slide, product(along[1], speed[1]))
                for sign in (-1, 1):
                    total = dict(normal)
                    add(total, slide, sign * joint.friction)
                    if not is_at_least_zero(total, structure.parameters, _JUMP_DEGREE):
                        return False
        return True

    def _power(self, loads: Loads, moves: dict[int, Velocity], low: list[Fraction], high: list[Fraction]) -> Polynomial:
        """Return the power of loads under a mechanism over a box, as a polynomial."""
        none = (0,) * self._structure.parameters
        total: Polynomial = {none: Fraction(0)}
        for element, (ux, uy, turn) in moves.items():
            force = loads.per_area.get(element)
            if force is not None and any(force):
                area, first_x, first_y = self._structure.moments(element, low, high)
                add(total, area, force[0] * ux + force[1] * uy)
                add(total, first_y, -turn * force[0])
                add(total, first_x, turn * force[1])
        for element, force, (x, y), moment in loads.points:
            ux, uy, turn = moves.get(element, _STILL)
            total[none] += force[0] * (ux - turn * y) + force[1] * (uy + turn * x) + moment * turn
        return total


def box_facts(done: VerifiedBox) -> dict[str, object]:
    """Return the outcome of a successful check as JSON data."""
    claim = done.claim
    return {
        "scene": done.scene.name,
        "bound": claim.bound,
        "found": claim.load_factor,
        "box": [list(ends) for ends in claim.box],
        "parameters": None if claim.parameters is None else list(claim.parameters),
        "boxes": done.boxes,
        "bytes": done.size,
        "seconds": done.seconds,
    }


def box_words(done: VerifiedBox) -> str:
    """Describe the outcome of a successful check for the terminal."""
    claim = done.claim
    box = " × ".join(f"[{low:.6g}, {high:.6g}]" for low, high in claim.box)
    lines = [
        f"verified: no position of the joints of {done.scene.name!r} in {box} carries more than λ = {claim.bound:.9g}",
        f"  by mechanisms for {done.boxes} boxes, in {done.size / 1e3:.0f} kB, checked in {done.seconds:.2f} s",
    ]
    if claim.load_factor is not None and claim.parameters is not None:
        where = ", ".join(f"{value:.6g}" for value in claim.parameters)
        lines.append(f"  found (by the search; not part of what is checked): λ = {claim.load_factor:.9g} at {where}")
    return "\n".join(lines)
