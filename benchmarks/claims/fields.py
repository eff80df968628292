"""Random cases of bounds by fields: planar, with loads as they act, and against own fields on a uniform mesh."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import clarabel
import numpy as np
import scipy.sparse as sp

from benchmarks.claims import Tally
from benchmarks.claims.geometry import Move, document, planar_grid, polygon_entry, random_move
from benchmarks.scenes import stones
from jld_core import Assembly, InputError, LimitAnalysis, Status, build_assembly, parse_scene
from jld_core.fields import bounds_by_fields
from jld_core.fields.bounds import CoarseBounds, FieldBounds, FieldSetting
from jld_samples import box

Dice = np.random.Generator
SAME: Final = 1e-6  # relative difference of bounds that two statements of one scene may show
# relative amount by which a bound may fall back on an adaptive mesh, where opening a field may cost 1e-4 of it
ADAPTED: Final = 2e-4
_TRIANGLES: Final = 400


def case_fields(seed: int, tally: Tally) -> str:
    rng = np.random.default_rng([seed, 2026])
    still = Move(np.eye(2), 1.0, np.zeros(2))
    moved = random_move(rng, 2)
    scenes = random_scenes(rng, [still, moved])
    if scenes is None:
        return ""
    try:
        one, other = (build_assembly(parse_scene(scene)) for scene in scenes)
    except InputError as error:
        tally.count("refused by the builder")
        return "" if "no path" in str(error) else f"refused: {error}"
    found = bounds_by_fields(one, gap=1e-3, adaptive=False, most=_TRIANGLES)
    again = bounds_by_fields(other, gap=1e-3, adaptive=False, most=_TRIANGLES)
    finer = bounds_by_fields(one, gap=1e-3, most=2 * _TRIANGLES, seconds=2.0)
    tally.count(found.status.value)
    scale = max(abs(found.upper) if math.isfinite(found.upper) else 0.0, 1e-3)
    lows = [step.lower for step in (*found.history, *finer.history)]
    highs = [step.upper for step in (*found.history, *finer.history)]
    if max(lows) > min(highs) + 1e-9 * scale:
        return f"lower bound {max(lows):.9g} above upper bound {min(highs):.9g}"
    for values, most in ((found.history, SAME), (finer.history, ADAPTED)):
        for sign, name in ((1.0, "lower"), (-1.0, "upper")):
            numbers = [sign * getattr(step, name) for step in values if math.isfinite(getattr(step, name))]
            if any(b < a - most * scale for a, b in pairwise(numbers)):
                return f"{name} bounds {[sign * number for number in numbers]} do not narrow on nested meshes"
    for name in ("lower", "upper"):
        a, b = getattr(found, name), getattr(again, name)
        if not (a == b or abs(a - b) <= SAME * scale):
            return f"{name} bound {a:.9g} here and {b:.9g} when moved"
    return _transferred(one, rng) or _against_rigid(one, found)


def random_scenes(rng: Dice, moves: list[Move]) -> list[dict[str, Any]] | None:
    """One random structure, moved in several ways; None where it has a single element."""
    labels, nodes, straight = planar_grid(rng)
    names = [label for label in np.unique(labels).tolist() if label > 0]
    if len(names) < 2:
        return None
    strength = float(10.0 ** rng.uniform(-1.0, 2.0))
    rough, crushed = float(rng.choice([0.0, 0.0, 0.4])), float(rng.choice([math.inf, math.inf, 3.0]))
    joint = {"friction_coefficient": float(rng.uniform(0.1, 0.9)), "cohesion": float(rng.choice([0.0, 0.0, 0.3]))}
    soft = float(rng.choice([math.inf, math.inf, 8.0]))
    pairs = [[f"e{a}", f"e{b}"] for a in names for b in names if a < b]
    whole = [pair for pair in pairs if rng.random() < rng.choice([0.0, 0.5])]
    corners = [np.random.default_rng(int(rng.integers(1 << 30))) for _ in names]
    states = [generator.bit_generator.state for generator in corners]
    scenes = []
    for number, move in enumerate(moves):
        elements = []
        for name, generator, state in zip(names, corners, states, strict=True):
            generator.bit_generator.state = state
            elements.append(polygon_entry(generator, labels, name, nodes, move, straight))
        scene = document(elements if number == 0 else elements[::-1], move)
        weight = 1000.0 * 9.81 * move.scale
        inner = {"tensile_strength": 0.8 * strength * weight, "shear_strength": 1.1 * strength * weight}
        if rough:
            inner["friction_coefficient"] = rough
        if math.isfinite(crushed):
            inner["compressive_strength"] = crushed * strength * weight
        dry = {**joint, "cohesion": joint["cohesion"] * weight}
        if math.isfinite(soft):
            dry["compressive_strength"] = soft * weight
        scene["materials"] |= {"inner": inner, "dry": dry}
        scene["labels"] = {"default": "dry"}
        built = build_assembly(parse_scene(scene)) if whole else None
        if built is not None:
            touch = {frozenset(built.pair(face).split("–")) for face in range(len(built.interfaces))}
            scene["labels"]["inner"] = [pair for pair in whole if frozenset(pair) in touch]
        scenes.append(scene)
    return scenes


def _transferred(assembly: Assembly, rng: Dice) -> str:
    """What the fields of one labelling prove for another agrees with the bounds of the other."""
    coarse = CoarseBounds(FieldSetting.of(assembly))
    other = assembly.labels ^ (rng.random(len(assembly.labels)) < 0.4)
    mechanism, stresses = coarse.upper(assembly.labels)[1], coarse.lower(assembly.labels)[1]
    low, high = coarse.lower(other)[0], coarse.upper(other)[0]
    scale = max(abs(high) if math.isfinite(high) else 0.0, 1e-3)
    if mechanism is not None and low > float(mechanism.bounds(other[None])[0]) + 1e-9 * scale:
        return f"lower bound {low:.9g} above that of the mechanism of another labelling"
    if stresses is not None and high < float(stresses.bounds(other[None])[0]) - 1e-9 * scale:
        return f"upper bound {high:.9g} below that of the stresses of another labelling"
    return ""


def _against_rigid(assembly: Assembly, found: FieldBounds) -> str:
    """Blocks of real material carry no more than rigid ones, which may have all forces that fields have."""
    if not assembly.labels.all():
        return ""
    rigid = LimitAnalysis(assembly).solve(assembly.labels)
    if rigid.status is not Status.COLLAPSE:
        return ""
    highest = float(rigid.bracket[1])
    if found.lower > highest + 1e-9 * abs(highest):
        return f"lower bound {found.lower:.9g} above that of rigid blocks, {highest:.9g}"
    return ""


Array = np.ndarray[Any, Any]
Pull = Callable[[Array, Array], Array]  # force per area (d,) at a point (d,) of a free face with an outward normal (d,)
# entries of a symmetric 3 × 3 matrix in the order of the solver, which counts those off the diagonal √2 times
_PSD: Final = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


@dataclass(frozen=True)
class Lattice:
    """Structure of lattice boxes.

    step: (d,) size of a cell. block: number of the block of each cell by its indices. support: indices of support
    cells. dry: pairs of blocks whose face is dry, block −1 for supports. lines: (a, b) of yield R ≤ a + b m. friction,
    cohesion, crushing: of dry faces. body: dead and live force per volume (2, d). pull: dead and live tractions.
    """

    step: Array
    block: dict[tuple[int, ...], int]
    support: frozenset[tuple[int, ...]]
    dry: frozenset[frozenset[int]]
    lines: list[tuple[float, float]]
    friction: float
    cohesion: float
    crushing: float
    body: Array
    pull: tuple[list[tuple[Pull, Callable[[Array], bool]]], list[tuple[Pull, Callable[[Array], bool]]]]


@dataclass(frozen=True)
class Simplices:
    """Mesh: nodes (p, d), cells (t, d + 1) of nodes, block (t,) of each, and its facets.

    facets: (simplex, its corners, outward normal, area, second simplex or −1, its corners, kind), kind "inside",
    "joint", "support" or "free", and True where it is dry.
    """

    nodes: Array
    cells: Array
    block: Array
    facets: list[tuple[int, tuple[int, ...], Array, float, int, tuple[int, ...], str, bool]]


def mesh_of(lattice: Lattice) -> Simplices:
    """Split each square in four about its middle, each cube in six along a diagonal."""
    d, number = len(lattice.step), dict[tuple[float, ...], int]()
    cells, blocks = [], []

    def node(place: Array) -> int:
        return number.setdefault(tuple(np.round(place, 6).tolist()), len(number))

    for cell, block in lattice.block.items():
        corner = np.array(cell, dtype=float)
        if d == 2:
            ring = [corner + shift for shift in ((0, 0), (1, 0), (1, 1), (0, 1))]
            parts = [[ring[k], ring[(k + 1) % 4], corner + 0.5] for k in range(4)]
        else:
            parts = [
                [corner, *np.cumsum(np.eye(3)[list(order)], axis=0) + corner]
                for order in itertools.permutations(range(3))
            ]
        for part in parts:
            cells.append([node(place) for place in part])
            blocks.append(block)
    nodes = np.array(list(number)) * lattice.step
    sides = dict[tuple[int, ...], list[tuple[int, tuple[int, ...]]]]()
    for t, cell_nodes in enumerate(cells):
        for left_out in range(d + 1):
            own = tuple(k for k in range(d + 1) if k != left_out)
            key = tuple(sorted(cell_nodes[k] for k in own))
            ordered = tuple(sorted(own, key=lambda k, c=cell_nodes: c[k]))  # type: ignore[misc]
            sides.setdefault(key, []).append((t, ordered))
    facets = []
    for key, users in sides.items():
        places, (t, own) = nodes[list(key)], users[0]
        if d == 2:
            along = places[1] - places[0]
            vector = np.array([along[1], -along[0]])
        else:
            vector = 0.5 * np.cross(places[1] - places[0], places[2] - places[0])
        area = float(np.linalg.norm(vector))
        normal, middle = vector / area, places.mean(axis=0)
        if (nodes[cells[t]].mean(axis=0) - middle) @ normal > 0.0:
            normal = -normal
        if len(users) == 2:
            (other, theirs), pair = users[1], frozenset({blocks[t], blocks[users[1][0]]})
            kind, dry = ("inside", False) if len(pair) == 1 else ("joint", pair in lattice.dry)
        else:
            other, theirs = -1, ()
            beyond = tuple(math.floor(x) for x in (middle + 0.1 * lattice.step.min() * normal) / lattice.step)
            held = beyond in lattice.support
            kind, dry = ("support", frozenset({blocks[t], -1}) in lattice.dry) if held else ("free", False)
        facets.append((t, own, normal, area, other, theirs, kind, dry))
    return Simplices(nodes, np.array(cells), np.array(blocks), facets)


Terms = list[tuple[int, float]]  # a linear function: unknowns and their factors


class _Program:
    """Minimise cost · x; rows s = right − A x in the cones of a kind (zero, least, soc, psd) and a size."""

    def __init__(self) -> None:
        self.cost: list[float] = []
        self.rows: dict[tuple[str, int], list[tuple[Terms, float]]] = {("zero", 1): [], ("least", 1): []}

    def unknowns(self, count: int, cost: float = 0.0) -> int:
        """Return the first number of new unknowns."""
        self.cost += [cost] * count
        return len(self.cost) - count

    def equal(self, terms: Terms, right: float = 0.0) -> None:
        self.rows["zero", 1].append((terms, right))

    def least(self, terms: Terms, right: float = 0.0) -> None:
        self.rows["least", 1].append((terms, right))

    def cone(self, parts: list[tuple[Terms, float]]) -> None:
        rows = self.rows.setdefault(("soc", len(parts)), [])
        rows += [([(column, -value) for column, value in terms], constant) for terms, constant in parts]

    def semidefinite(self, entries: dict[tuple[int, int], Terms]) -> None:
        rows = self.rows.setdefault(("psd", 6), [])
        for i, j in _PSD:
            rows.append(([(c, -v * (1.0 if i == j else math.sqrt(2.0))) for c, v in entries[i, j]], 0.0))

    def solve(self) -> tuple[str, float]:
        """Return status and cost."""
        parts, right, cones = [], [], []
        for (kind, size), rows in self.rows.items():
            if not rows:
                continue
            terms = np.array([(row, column, value) for row, (own, _) in enumerate(rows) for column, value in own])
            shape = (len(rows), len(self.cost))
            parts.append(sp.csc_matrix((terms[:, 2], terms[:, :2].T.astype(int)), shape=shape))
            right += [constant for _, constant in rows]
            made = {"zero": clarabel.ZeroConeT, "least": clarabel.NonnegativeConeT, "soc": clarabel.SecondOrderConeT}
            whole = kind in ("zero", "least")
            one = clarabel.PSDTriangleConeT(3) if kind == "psd" else made[kind](len(rows) if whole else size)
            cones += [one] * (1 if whole else len(rows) // size)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        none = sp.csc_matrix((len(self.cost), len(self.cost)))
        matrix = sp.csc_matrix(sp.vstack(parts))
        found = clarabel.DefaultSolver(none, np.array(self.cost), matrix, np.array(right), cones, settings).solve()
        return str(found.status), float(found.obj_val)


def _value(status: str, cost: float, sign: float, unbounded: float) -> float | None:
    if status == "Solved":
        return sign * cost
    if status == "DualInfeasible":
        return unbounded
    return -unbounded if status == "PrimalInfeasible" else None


def _gradients(mesh: Simplices) -> tuple[Array, Array]:
    d = int(mesh.nodes.shape[1])
    edges = mesh.nodes[mesh.cells[:, 1:]] - mesh.nodes[mesh.cells[:, :1]]
    inner = np.linalg.inv(edges).transpose(0, 2, 1)
    volume = abs(np.linalg.det(edges)) / math.factorial(d)
    return np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1), volume


def _pulls(lattice: Lattice, mesh: Simplices, facet: Any) -> Array:
    t, own, normal, *_ = facet
    places = mesh.nodes[mesh.cells[t][list(own)]]
    found = np.zeros((2, len(own), places.shape[1]))
    for kind, loads in enumerate(lattice.pull):
        for value, acts in loads:
            if acts(np.append(places.mean(axis=0), mesh.block[t])):
                found[kind] += [value(place, normal) for place in places]
    return found


def lower_bound(lattice: Lattice) -> float | None:
    """Return the largest λ of a stress field, −inf without one, inf where it is unbounded, None if undecided."""
    mesh, program = mesh_of(lattice), _Program()
    d = int(mesh.nodes.shape[1])
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    gradient, _ = _gradients(mesh)
    first = program.unknowns(len(mesh.cells) * (d + 1) * len(pairs))
    load = program.unknowns(1, -1.0)

    def sigma(t: int, k: int, i: int, j: int) -> int:
        return first + (t * (d + 1) + k) * len(pairs) + pairs.index((min(i, j), max(i, j)))

    def traction(t: int, k: int, i: int, normal: Array, sign: float = 1.0) -> Terms:
        return [(sigma(t, k, i, j), sign * normal[j]) for j in range(d)]

    for t in range(len(mesh.cells)):
        for i in range(d):
            terms = [(sigma(t, k, i, j), gradient[t, k, j]) for k in range(d + 1) for j in range(d)]
            program.equal([*terms, (load, lattice.body[1, i])], -lattice.body[0, i])
        for k in range(d + 1):
            _within_yield(program, lattice, {(i, j): sigma(t, k, i, j) for i, j in pairs}, d)
    for facet in mesh.facets:
        t, own, normal, _, other, theirs, kind, dry = facet
        pulls = _pulls(lattice, mesh, facet) if kind == "free" else None
        for corner, k in enumerate(own):
            for i in range(d):
                if other >= 0:
                    terms = traction(t, k, i, normal) + traction(other, theirs[corner], i, normal, -1.0)
                    program.equal(terms)
                elif pulls is not None:
                    dead, live = pulls[:, corner, i]
                    program.equal([*traction(t, k, i, normal), (load, -live)], dead)
            if dry:
                _within_joint(program, lattice, [traction(t, k, i, normal) for i in range(d)], normal)
    return _value(*program.solve(), -1.0, math.inf)


def _within_yield(program: _Program, lattice: Lattice, s: dict[tuple[int, int], int], d: int) -> None:
    if d == 2:
        xx, yy, xy = s[0, 0], s[1, 1], s[0, 1]
        for a, b in lattice.lines:
            program.cone([([(xx, 0.5 * b), (yy, 0.5 * b)], a), ([(xx, 0.5), (yy, -0.5)], 0.0), ([(xy, 1.0)], 0.0)])
        return
    top = program.unknowns(2)
    for sign, limit in ((-1.0, top), (1.0, top + 1)):
        program.semidefinite({(i, j): [(s[i, j], sign), *([(limit, -sign)] if i == j else [])] for i, j in _PSD})
    for a, b in lattice.lines:
        program.least([(top, 0.5 - 0.5 * b), (top + 1, -0.5 - 0.5 * b)], a)


def _tangents(normal: Array) -> list[Array]:
    if len(normal) == 2:
        return [np.array([-normal[1], normal[0]])]
    one = np.cross(normal, np.eye(3)[int(np.argmin(abs(normal)))])
    one = one / np.linalg.norm(one)
    return [one, np.cross(normal, one)]


def _along(parts: list[Terms], axis: Array, factor: float = 1.0) -> Terms:
    """Return the component along an axis of a vector of linear functions."""
    return [(c, factor * axis[i] * v) for i, terms in enumerate(parts) for c, v in terms]


def _within_joint(program: _Program, lattice: Lattice, pull: list[Terms], normal: Array) -> None:
    program.least(_along(pull, normal))
    sliding = [(_along(pull, axis), 0.0) for axis in _tangents(normal)]
    program.cone([(_along(pull, normal, -lattice.friction), lattice.cohesion), *sliding])
    if math.isfinite(lattice.crushing):
        program.least(_along(pull, normal, -1.0), lattice.crushing)


def upper_bound(lattice: Lattice) -> float | None:
    """Return the least λ of a velocity field, −inf where it is unbounded, inf without one, None if undecided."""
    mesh, program = mesh_of(lattice), _Program()
    d = int(mesh.nodes.shape[1])
    gradient, volume = _gradients(mesh)
    first = program.unknowns(len(mesh.cells) * (d + 1) * d)

    def velocity(t: int, k: int, i: int, factor: float = 1.0) -> tuple[int, float]:
        return first + (t * (d + 1) + k) * d + i, factor

    work = np.zeros((2, len(program.cost)))
    for t in range(len(mesh.cells)):
        for k in range(d + 1):
            for i in range(d):
                work[:, velocity(t, k, i)[0]] += lattice.body[:, i] * volume[t] / (d + 1)

        def rate(i: int, j: int, t: int = t) -> Terms:
            return [velocity(t, k, i, 0.5 * gradient[t, k, j]) for k in range(d + 1)] + [
                velocity(t, k, j, 0.5 * gradient[t, k, i]) for k in range(d + 1)
            ]

        _strain(program, lattice, rate, volume[t], d)
    for facet in mesh.facets:
        t, own, _, area, other, theirs, kind, dry = facet
        if kind == "free":
            pulls = _pulls(lattice, mesh, facet)
            # a linear traction on a linear velocity, exactly
            share = (pulls + pulls.sum(axis=1, keepdims=True)) * (area / (d * (d + 1)))
            for corner, k in enumerate(own):
                for i in range(d):
                    work[:, velocity(t, k, i)[0]] += share[:, corner, i]
            continue
        for corner, k in enumerate(own):
            jump = [
                [velocity(t, k, i, -1.0), *([velocity(other, theirs[corner], i)] if other >= 0 else [])]
                for i in range(d)
            ]
            _jump(program, lattice, jump, facet[2], area / d, dry)
    program.equal([(k, float(v)) for k, v in enumerate(work[1]) if v], 1.0)
    for k, value in enumerate(work[0]):
        program.cost[k] -= float(value)
    return _value(*program.solve(), 1.0, -math.inf)


def _multipliers(program: _Program, lattice: Lattice, size: float) -> list[int]:
    found = []
    for a, _ in lattice.lines:
        found.append(program.unknowns(1, a * size))
        program.least([(found[-1], -1.0)])
    return found


def _strain(program: _Program, lattice: Lattice, rate: Callable[[int, int], Terms], size: float, d: int) -> None:
    y = _multipliers(program, lattice, size)
    trace = [term for i in range(d) for term in rate(i, i)]
    slopes = [b for _, b in lattice.lines]
    if d == 2:
        program.equal([*trace, *((k, b) for k, b in zip(y, slopes, strict=True))])
        spread = [*rate(0, 0), *((c, -v) for c, v in rate(1, 1))]
        twice = [(c, 2.0 * v) for c, v in rate(0, 1)]
        program.cone([([(k, 1.0) for k in y], 0.0), (spread, 0.0), (twice, 0.0)])
        return
    stretch = program.unknowns(6)
    place = {pair: stretch + k for k, pair in enumerate(_PSD)}
    program.semidefinite({pair: [(place[pair], 1.0)] for pair in _PSD})
    program.semidefinite({(i, j): [(place[i, j], 1.0), *((c, -v) for c, v in rate(i, j))] for i, j in _PSD})
    heads = [(place[i, i], 1.0) for i in range(3)]
    program.equal([*heads, *((k, -0.5 * (1.0 - b)) for k, b in zip(y, slopes, strict=True))])
    program.equal(
        [*heads, *((c, -v) for c, v in trace), *((k, -0.5 * (1.0 + b)) for k, b in zip(y, slopes, strict=True))]
    )


def _jump(program: _Program, lattice: Lattice, jump: list[Terms], normal: Array, size: float, dry: bool) -> None:
    opening = _along(jump, normal)
    if not dry:
        y = _multipliers(program, lattice, size)
        program.equal([*opening, *((k, b) for k, (_, b) in zip(y, lattice.lines, strict=True))])
        program.cone([([(k, 1.0) for k in y], 0.0), *((terms, 0.0) for terms in jump)])
        return
    slip = program.unknowns(1, lattice.cohesion * size)
    program.cone([([(slip, 1.0)], 0.0), *((_along(jump, axis), 0.0) for axis in _tangents(normal))])
    closing = [(slip, lattice.friction), *((c, -v) for c, v in opening)]
    if math.isfinite(lattice.crushing):
        crush = program.unknowns(1, lattice.crushing * size)
        program.least([(crush, -1.0)])
        closing.append((crush, -1.0))
    program.least(closing)


_IN_SPACE: Final = (9, 18, 27)  # seeds modulo 28 whose scenes are in space: 60 of 560
_SLACK: Final = 1e-5  # relative amount by which bounds may cross: the own ones are the solver's
_MOST: Final = {2: 200, 3: 60}  # most triangles or tetrahedra of the meshes of the program
# load entry of a scene; its traction, where it acts, and its force per weight
_Load = tuple[dict[str, Any], Pull | None, Callable[[Array], bool], Array]


def case_loads(seed: int, tally: Tally) -> str:
    """Return "" where no bounds of one random structure contradict each other, else which do."""
    d = 3 if seed % 28 in _IN_SPACE else 2
    scene, lattice = random_scene(np.random.default_rng([seed, 49]), d)
    try:
        assembly = build_assembly(parse_scene(scene))
    except InputError as error:
        tally.count("the live load is in balance on every block")
        return "" if "the live load is zero" in str(error) else f"refused: {error}"
    if d == 2:
        found = bounds_by_fields(assembly, gap=0.05, most=_MOST[2])
        low, high = found.lower, found.upper
    else:
        solid = bounds_by_fields(assembly, gap=0.3, most=_MOST[3])
        low, high = solid.lower, solid.upper
    own_low, own_high = lower_bound(lattice), upper_bound(lattice)
    where = "in the plane" if d == 2 else "in space"
    tally.count(where)
    tally.count("no bound of the own solver", (own_low is None) + (own_high is None))
    own_low, own_high = (-math.inf if own_low is None else own_low), (math.inf if own_high is None else own_high)
    tally.count(f"falls under its dead load {where}", high < 0.0)
    tally.count(f"both brackets finite {where}", all(map(math.isfinite, (low, high, own_low, own_high))))
    scale = max([abs(x) for x in (low, high, own_low, own_high) if math.isfinite(x)], default=1.0)
    slack = _SLACK * scale + 1e-7
    bounds = f"[{low:.6g}, {high:.6g}] of the program, own [{own_low:.6g}, {own_high:.6g}]"
    return "" if max(low, own_low) <= min(high, own_high) + slack else f"{where}: {bounds}"


def random_scene(rng: Dice, d: int) -> tuple[dict[str, Any], Lattice]:
    """Return a structure of lattice boxes as a scene, and as its own lattice."""
    shape = rng.integers(2, [7, 4] if d == 2 else [4, 3, 3]) if d == 2 else rng.integers([1, 1, 1], [4, 3, 3])
    step = rng.uniform(0.4, 1.0, d)
    if d == 3:
        step[1] = step[0]  # forces have square patches
    boxes = _cut(rng, np.zeros(d, dtype=int), shape, int(rng.integers(0, 4)))
    block = {tuple(cell): k for k, (low, high) in enumerate(boxes) for cell in _cells(low, high)}
    feet, places = list[tuple[Array, Array]](), np.arange(int(shape[0]))
    held = rng.random(len(places)) < 0.6
    held[rng.integers(len(places))] = True
    for start in np.flatnonzero(held & ~np.append(False, held[:-1])).tolist():
        end = start
        while end < len(places) and held[end]:
            end += 1
        low, high = np.zeros(d, dtype=int), np.array(shape)
        low[0], high[0], low[-1], high[-1] = start, end, -1, 0
        feet.append((low, high))
    thickness = float(rng.uniform(0.3, 2.0)) if d == 2 else 1.0
    elements = [_entry(f"b{k}", low * step, high * step) for k, (low, high) in enumerate(boxes)]
    elements += [_entry(f"s{k}", low * step, high * step, support=True) for k, (low, high) in enumerate(feet)]
    sizes: dict[str, Any] = {"boxes": boxes, "shape": shape, "step": step, "thickness": thickness}
    dead = [_load(rng, **sizes) for _ in range(int(rng.integers(0, 3)))]
    live = [_load(rng, **sizes) for _ in range(int(rng.integers(1, 4)))]
    density, strength = float(rng.uniform(0.0, 1.0)), float(10.0 ** rng.uniform(-0.3, 1.3))
    inner = {"tensile_strength": strength, "shear_strength": float(rng.uniform(0.8, 2.0)) * strength}
    rough, crushed = float(rng.choice([0.0, 0.0, 0.4])), float(rng.choice([math.inf, math.inf, 4.0])) * strength
    if rough:
        inner["friction_coefficient"] = rough
    if math.isfinite(crushed):
        inner["compressive_strength"] = crushed
    friction, cohesion = float(rng.uniform(0.2, 0.9)), float(rng.choice([0.0, 0.0, 0.2])) * strength
    soft = float(rng.choice([math.inf, math.inf, 3.0])) * strength
    joint = {"friction_coefficient": friction, "cohesion": cohesion}
    if math.isfinite(soft):
        joint["compressive_strength"] = soft
    dry, inner_pairs = _labels(rng, block, {tuple(cell) for low, high in feet for cell in _cells(low, high)}, feet)
    gravity = -np.eye(d)[-1]
    pushes = [one[0] for one in live]
    scene = stones(elements, pushes, joint, inner, density=density, gravity=gravity.tolist())
    scene |= {"labels": {"default": "dry", "inner": inner_pairs}, **({"thickness": thickness} if d == 2 else {})}
    scene["loads"]["dead"] = [one[0] for one in dead]
    cosine = 1.0 / math.hypot(1.0, rough)
    tension = min(strength, inner["shear_strength"] / rough) if rough else strength
    lines = [(inner["shear_strength"] * cosine, -rough * cosine), (tension, -1.0)]
    lines += [(crushed, 1.0)] if math.isfinite(crushed) else []
    body = np.array([gravity + sum((one[3] for one in dead), np.zeros(d)), sum((one[3] for one in live), np.zeros(d))])
    pulls = tuple([(one[1], one[2]) for one in loads if one[1] is not None] for loads in (dead, live))
    support = frozenset(tuple(cell) for low, high in feet for cell in _cells(low, high))
    return scene, Lattice(
        step, block, support, dry, lines, friction, cohesion, soft, density * body, (pulls[0], pulls[1])
    )


def _cells(low: Array, high: Array) -> list[tuple[int, ...]]:
    axes = [range(int(a), int(b)) for a, b in zip(low, high, strict=True)]
    return [tuple(int(x) for x in cell) for cell in np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, len(axes))]


def _cut(rng: Dice, low: Array, high: Array, times: int) -> list[tuple[Array, Array]]:
    wide = np.flatnonzero(high - low > 1)
    if not times or not wide.size:
        return [(low, np.array(high))]
    axis = int(rng.choice(wide))
    at = int(rng.integers(low[axis] + 1, high[axis]))
    middle_high, middle_low = np.array(high), np.array(low)
    middle_high[axis] = middle_low[axis] = at
    share = int(rng.integers(0, times))
    return _cut(rng, low, middle_high, share) + _cut(rng, middle_low, high, times - 1 - share)


def _entry(name: str, low: Array, high: Array, **more: Any) -> dict[str, Any]:
    if len(low) == 2:
        (a, b), (c, d) = low.tolist(), high.tolist()
        return {"id": name, "polygon": [[a, b], [c, b], [c, d], [a, d]], **more}
    return box(name, low.tolist(), high.tolist(), **more)


def _labels(
    rng: Dice, block: dict[tuple[int, ...], int], support: set[tuple[int, ...]], feet: list[Any]
) -> tuple[frozenset[frozenset[int]], list[list[str]]]:
    """Return the dry pairs of blocks, −1 for supports, and the pairs of ids that are inner."""
    touching = set[frozenset[int]]()
    on_foot = set[tuple[int, int]]()
    for cell, own in block.items():
        for axis in range(len(cell)):
            for shift in (-1, 1):
                there = tuple(x + shift * (k == axis) for k, x in enumerate(cell))
                if there in block and block[there] != own:
                    touching.add(frozenset({own, block[there]}))
                if there in support:
                    touching.add(frozenset({own, -1}))
                    foot = next(k for k, (low, high) in enumerate(feet) if there in _cells(low, high))
                    on_foot.add((own, foot))
    inner = {pair for pair in sorted(touching, key=sorted) if rng.random() < 0.4}
    pairs = [[f"b{k}" for k in sorted(pair)] for pair in sorted(inner, key=sorted) if -1 not in pair]
    pairs += [[f"b{own}", f"s{foot}"] for own, foot in sorted(on_foot) if frozenset({own, -1}) in inner]
    return frozenset(touching - inner), pairs


def _load(rng: Dice, boxes: list[tuple[Array, Array]], shape: Array, step: Array, thickness: float) -> _Load:
    d, none = len(step), np.zeros(len(step))
    kind = str(rng.choice(["pressure", "pressure", "line", "force", "force", "body", "around"]))
    if kind == "body":
        vector = rng.uniform(-1.0, 1.0, d)
        return {"body": vector.tolist()}, None, lambda _: False, vector
    if kind == "around":
        number, pressure = int(rng.integers(len(boxes))), float(rng.uniform(-0.5, 1.0))
        low, high = boxes[number]
        if high[-1] == shape[-1] or low[0] == 0 or high[0] == shape[0]:  # its boundary is free somewhere
            entry = {"face": {"between": [f"b{number}", "outside"]}, "pressure": pressure}
            return entry, lambda _, normal: -pressure * normal, lambda at: at[-1] == number, none
        kind = "pressure"
    if kind == "force":
        return _force(rng, boxes, shape, step, thickness)
    # part of the upper surface, between nodes of the lattice
    low, high = np.zeros(d - 1, dtype=int), np.array(shape[:-1])
    for axis in range(d - 1):
        ends = np.sort(rng.choice(int(shape[axis]) + 1, 2, replace=False))
        low[axis], high[axis] = ends
    top, first, last = float(shape[-1] * step[-1]), low * step[:-1], high * step[:-1]
    acts = _above(first, last, top)
    if d == 2:
        points = [[float(first[0]), top], [float(last[0]), top]]
        if kind == "line":
            vector = rng.uniform([-0.5, -1.0], [0.5, 0.3])
            value = vector / thickness
            return {"face": {"along": points}, "line": vector.tolist()}, lambda *_: value, acts, none
        start, end = rng.uniform(-0.3, 1.0, 2) if rng.random() < 0.6 else np.full(2, rng.uniform(0.2, 1.0))
        length = float(last[0] - first[0])

        def pressed(place: Array, normal: Array) -> Array:
            share = (place[0] - first[0]) / length
            return np.asarray(-(start + (end - start) * share) * normal)

        if rng.random() < 0.5:
            return {"face": {"along": points}, "pressure": [float(start), float(end)]}, pressed, acts, none
        return {"face": {"along": points[::-1]}, "pressure": [float(end), float(start)]}, pressed, acts, none
    (a, b), (c, e) = first.tolist(), last.tolist()
    patch = [[a, b, top], [c, b, top], [c, e, top], [a, e, top]]
    if kind == "line":
        traction = rng.uniform([-0.5, -0.5, -1.0], [0.5, 0.5, 0.3])
        return {"face": {"patch": patch}, "traction": traction.tolist()}, lambda *_: traction, acts, none
    pressure = float(rng.uniform(-0.2, 1.0))
    return {"face": {"patch": patch}, "pressure": pressure}, lambda _, normal: -pressure * normal, acts, none


def _force(rng: Dice, boxes: list[tuple[Array, Array]], shape: Array, step: Array, thickness: float) -> _Load:
    d = len(step)
    upper = [k for k, (_, high) in enumerate(boxes) if high[-1] == shape[-1]]
    number = int(rng.choice(upper))
    low, high = boxes[number]
    size = int(rng.integers(1, high[0] - low[0] + 1)) if d == 2 else 1
    start = np.array([rng.integers(low[k], high[k] - size + 1) for k in range(d - 1)])
    first, last = start * step[:-1], (start + size) * step[:-1]
    top, width = float(shape[-1] * step[-1]), float(last[0] - first[0])
    vector = np.append(rng.uniform(-0.4, 0.4, d - 1), rng.uniform(-1.0, 0.2)) * width
    value = vector / (width * thickness if d == 2 else width**2)
    at = [*(0.5 * (first + last)).tolist(), top]
    entry = {"element": f"b{number}", "force": vector.tolist(), "at": at, "width": width}
    return entry, lambda *_: value, _above(first, last, top), np.zeros(d)


def _above(first: Array, last: Array, top: float) -> Callable[[Array], bool]:
    """Whether a place lies on a part of the upper surface, between two corners."""
    return lambda at: bool(
        (first - 1e-9 <= at[: len(first)]).all() and (at[: len(first)] <= last + 1e-9).all()
        and abs(at[len(first)] - top) < 1e-9
    )  # fmt: skip
