"""Claim: results are converged, and both ends of the bracket hold when weighed again.

Three groups of random scenes, drawn by ``seed % 3``:

- space: boxes and prisms with steps, friction mostly at exactly 45 degrees, on a floor and beside walls
- plane: grids with crushing joints and cracks, weak and strong, some without weight
- effective areas: boxes in bond, torsion about the pressed rectangle

A case disagrees if the bracket is crossed, the forces are not admissible, the mechanism does not give the upper end, or
an uncertified result has no reason.
Both are weighed in scene units by formulas stated here once more. ``notes`` counts results by group and status, and of
those that are not converged which end is missing.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from benchmarks.claims.tally import Tally, run_cases
from jld_core import Assembly, InputError, LimitAnalysisResult, build_assembly, parse_scene, solve
from jld_core.strengths import Route

ROUTE = Route("a benchmark")

CLAIM: Final = "Results are converged; forces and mechanisms give both ends of the bracket"
GROUPS: Final = ("space", "plane", "effective areas")
CLOSE: Final = 1e-7
"""Relative difference that the second statement in scene units may show: rounding of sums of a few hundred terms."""

Document = dict[str, Any]
Array = NDArray[np.float64]


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on random scenes.

    first_seed, cases: seeds to test; three consecutive seeds belong to the three groups. seconds: time limit, s.
    Returns: disagreements, and in `notes` the statuses of each group.
    """
    return run_cases(CLAIM, case, first_seed, cases, seconds)


def case(seed: int, tally: Tally) -> str:
    """Solve the scene of one seed and weigh its result again."""
    group = GROUPS[seed % 3]
    assembly, labels = drawn(seed)
    effective = group == "effective areas"
    result = solve(assembly, labels, effective_area=effective)
    name = f"{group} {result.status}"
    if str(result.status) == "uncertified":
        low, high = result.bracket
        missing = [word for word, end in (("lower", low), ("upper", high)) if not math.isfinite(end)]
        name += f" ({' and '.join(missing) or 'wide'})"
        print(f"seed {seed}: {name} {result.bracket} {result.solve_log}: {result.reason}", flush=True)
        if not result.reason:
            return "uncertified without a reason"
    tally.notes[name] = tally.notes.get(name, 0) + 1
    return weighed(assembly, labels, result, effective)


def drawn(seed: int) -> tuple[Assembly, NDArray[np.bool_]]:
    """Draw the assembly of a seed and a labelling of it."""
    document, labels = drawn_document(seed)
    return build_assembly(parse_scene(document)), labels


def drawn_document(seed: int) -> tuple[Document, NDArray[np.bool_]]:
    """Draw the scene of a seed and a labelling of it; numbers that draw no scene are drawn again."""
    rng = np.random.default_rng([seed, 45])
    draw = (_spatial, _planar, _bonded)[seed % 3]
    while True:
        document = draw(rng)
        try:
            assembly = build_assembly(parse_scene(document))
        except InputError:
            continue
        share = float(rng.choice([1.0, 0.7, 0.4])) if seed % 3 != 2 else float(rng.choice([1.0, 0.6]))
        return document, rng.random(len(assembly.interfaces)) < share


# --- scenes -------------------------------------------------------------------------------------------------


def _materials(rng: np.random.Generator, friction: float, crushing: float) -> Document:
    strength = float(rng.choice([0.0, 2e2, 5e3, 1e6], p=[0.1, 0.3, 0.4, 0.2]))
    dry: Document = {"friction_coefficient": friction}
    inner: Document = {"tensile_strength": strength, "shear_strength": strength * float(rng.choice([0.5, 1.0, 2.0]))}
    if friction == 1.0 and rng.random() < 0.5:
        dry = {"friction_angle": 45}
    if rng.random() < crushing:
        dry["compressive_strength"] = float(rng.choice([5e3, 2e4, 2e5]))
    if rng.random() < 0.5 * crushing:
        inner["compressive_strength"] = float(rng.choice([5e3, 2e4, 2e5]))
    return {"density": 1400, "dry": dry, "inner": inner}


def _prism(name: str, cells: list[tuple[int, int]], x: Array, z: Array, low: float, high: float) -> Document:
    """A prism along y over cells (column, course) that share edges."""
    edges: set[tuple[tuple[int, int], tuple[int, int]]] = set()
    for i, k in cells:
        ring = [(i, k), (i + 1, k), (i + 1, k + 1), (i, k + 1)]
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
            if (b, a) in edges:
                edges.remove((b, a))
            else:
                edges.add((a, b))
    following = dict(sorted(edges))
    loop = [min(following)]
    while following[loop[-1]] != loop[0]:
        loop.append(following[loop[-1]])
    turns = [
        p
        for o, p, q in zip(loop[-1:] + loop[:-1], loop, loop[1:] + loop[:1], strict=True)
        if (p[0] - o[0]) * (q[1] - p[1]) != (p[1] - o[1]) * (q[0] - p[0])
    ]
    count = len(turns)
    vertices = [[float(x[i]), y, float(z[k])] for y in (high, low) for i, k in turns]
    # seen from y = low, the ring (x, z) runs counter-clockwise
    sides = [[n, count + n, count + (n + 1) % count, (n + 1) % count] for n in range(count)]
    faces = [list(range(count))[::-1], list(range(count, 2 * count)), *[side[::-1] for side in sides]]
    return {"id": name, "vertices": vertices, "faces": faces}


def _box(name: str, low: Array, high: Array, support: bool = False) -> Document:
    (a, b, c), (d, e, f) = low.tolist(), high.tolist()
    vertices = [[a, b, c], [d, b, c], [d, e, c], [a, e, c], [a, b, f], [d, b, f], [d, e, f], [a, e, f]]
    faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    return {"id": name, "vertices": vertices, "faces": faces, "support": support}


def _live(rng: np.random.Generator, names: list[str]) -> list[Document]:
    if rng.random() < 0.6:
        body = [float(rng.choice([-1.0, 1.0])), float(rng.choice([0.0, 0.0, 0.5])), float(rng.choice([0.0, 1.0, -0.5]))]
        return [{"body": body}]
    force = [float(rng.choice([0.0, 1.0])), float(rng.choice([0.0, 0.3])), float(rng.choice([-1.0, 1.0]))]
    return [{"element": str(rng.choice(names)), "force": force}]


def _spatial(rng: np.random.Generator) -> Document:
    """Stepped prisms in one or two wythes on a floor, with walls at the ends in half of the scenes."""
    across, courses, wythes = (int(rng.integers(low, high)) for low, high in ((2, 4), (1, 4), (1, 3)))
    x = np.concatenate([[0.0], np.cumsum(rng.choice([0.1, 0.15, 0.2], across))])
    z = np.concatenate([[0.0], np.cumsum(rng.choice([0.1, 0.15], courses))])
    elements: list[Document] = []
    for wythe in range(wythes):
        free = {(i, k) for i in range(across) for k in range(courses)}
        while free:
            first = min(free)
            cells, end = [first], int(rng.choice([1, 1, 2, 3]))
            while len(cells) < end:
                around = {(i + a, k + b) for i, k in cells for a, b in ((1, 0), (0, 1), (-1, 0), (0, -1))}
                beside = sorted(around & free - set(cells))
                if not beside:
                    break
                cells.append(beside[int(rng.integers(len(beside)))])
            free -= set(cells)
            name = f"b{wythe}.{first[0]}.{first[1]}"
            elements.append(_prism(name, cells, x, z, 0.1 * wythe, 0.1 * (wythe + 1)))
    names = [element["id"] for element in elements]
    deep, up = 0.1 * wythes, float(z[-1])
    elements.append(_box("floor", np.array([-0.3, -0.1, -0.1]), np.array([x[-1] + 0.3, deep + 0.1, 0.0]), True))
    if rng.random() < 0.5:
        elements.append(_box("left", np.array([-0.2, 0.0, 0.0]), np.array([0.0, deep, up]), True))
        if rng.random() < 0.5:
            elements.append(_box("right", np.array([x[-1], 0.0, 0.0]), np.array([x[-1] + 0.2, deep, up]), True))
    friction = float(rng.choice([1.0, 0.6, 0.0, 1.5], p=[0.7, 0.2, 0.03, 0.07]))
    return {
        "name": "steps",
        "elements": elements,
        "materials": _materials(rng, friction, 0.0),
        "loads": {"live": _live(rng, names)},
    }


def _planar(rng: np.random.Generator) -> Document:
    """A grid of cells, most of them with compressive strength, some of them without weight."""
    across, up = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    rows = [["a"] * across for _ in range(up)]
    if rng.random() < 0.25 and across > 2 and up > 1:
        rows[-1][1] = "."
    foot = ["#"] * across
    kind = rng.random()
    if kind < 0.3:
        lines = ["#" + "".join(row) + "#" for row in rows]
    else:
        if kind < 0.6 and across > 2:
            foot = ["#", *["."] * (across - 2), "#"]
        lines = ["".join(row) for row in [*rows, foot]]
    names = [f"c{i + (kind < 0.3)}r{k}" for k, row in enumerate(rows) for i, letter in enumerate(row) if letter == "a"]
    friction = float(rng.choice([0.0, 0.3, 0.75, 1.0], p=[0.05, 0.25, 0.5, 0.2]))
    materials = _materials(rng, friction, 0.75)
    if rng.random() < 0.15:
        materials["density"] = 0.0
    elif rng.random() < 0.1:
        materials["gravity"] = 0.0
    if rng.random() < 0.2:
        materials["dry"]["cohesion"] = 500.0
    weightless = not materials["density"] or not materials.get("gravity", 1.0)
    if rng.random() < 0.5 and not weightless:
        live: list[Document] = [{"body": [float(rng.choice([-1.0, 1.0])), float(rng.choice([0.0, 0.4, -0.5]))]}]
    else:
        live = [{"element": str(rng.choice(names)), "force": [float(rng.choice([0.0, 1.0])), -1.0]}]
    return {
        "name": "grid",
        "grid": {"cell": [0.1, float(rng.choice([0.05, 0.1, 0.2]))], "thickness": 0.1, "rows": lines},
        "materials": materials,
        "loads": {"live": live},
    }


def _bonded(rng: np.random.Generator) -> Document:
    """Boxes in running bond, in one or two wythes, on a floor."""
    across, courses, wythes = (int(rng.integers(low, high)) for low, high in ((1, 4), (1, 4), (1, 3)))
    length, depth, height = (float(rng.choice([0.1, 0.15, 0.2])) for _ in range(3))
    shift = 0.5 * length if rng.random() < 0.7 else 0.0
    elements: list[Document] = []
    for course in range(courses):
        for wythe in range(wythes):
            ends = np.arange(across + 1) * length
            if shift and (course + wythe) % 2:
                ends = np.concatenate([[0.0], ends[:-1] + shift, [across * length]])
            for n, (a, b) in enumerate(itertools.pairwise(ends)):
                low = np.array([a, wythe * depth, course * height])
                high = np.array([b, (wythe + 1) * depth, (course + 1) * height])
                elements.append(_box(f"b{course}.{wythe}.{n}", low, high))
    names = [element["id"] for element in elements]
    low, high = np.array([-0.3, -0.3, -0.1]), np.array([across * length + 0.3, wythes * depth + 0.3, 0.0])
    elements.append(_box("floor", low, high, True))
    friction = float(rng.choice([0.3, 0.6, 1.0], p=[0.3, 0.4, 0.3]))
    live = _live(rng, names)
    if rng.random() < 0.3 and "element" in live[0]:
        live[0]["at"] = [float(v) for v in rng.uniform([0.0, 0.0, 0.0], [across * length, wythes * depth, height])]
    return {"name": "bond", "elements": elements, "materials": _materials(rng, friction, 0.0), "loads": {"live": live}}


# --- weighed again ------------------------------------------------------------------------------------------


def weighed(assembly: Assembly, labels: NDArray[np.bool_], result: LimitAnalysisResult, effective: bool) -> str:
    """Weigh forces and mechanism of a result by the formulas of docs/method.md, stated here once more, scene units.

    assembly: what was solved. labels: True = dry. result: the result of it. effective: torsion about effective areas:
    what is weighed is then the forces' balance alone. Returns: what is wrong, "" if nothing is.
    """
    low, high = result.bracket
    if str(result.status) not in ("collapse", "uncertified"):
        return ""
    if low > high:
        return f"bracket crossed: [{low}, {high}]"
    weight = max(assembly.total_dead, abs(low) * assembly.total_live if math.isfinite(low) else 0.0, 1e-300)
    if math.isfinite(low) and result.forces is not None:
        largest = max(weight, float(abs(result.forces[:, :1]).max()))
        left = abs(_left(assembly, result.forces, low)).max()
        if left > CLOSE * largest:
            return f"forces out of balance by {left / largest:.1e}"
        lacking = -min(0.0, float(_room(assembly, labels, result.forces, effective).min()))
        if lacking > CLOSE * largest:
            return f"forces outside of the yield sets by {lacking / largest:.1e}"
    if math.isfinite(high) and result.mechanism is not None and not effective:
        bound, noise = _work(assembly, labels, result.mechanism)
        if not abs(bound - high) <= CLOSE * max(abs(high), noise, _nothing(assembly)):
            return f"upper end {high}, mechanism gives {bound}"
    return ""


def _nothing(assembly: Assembly) -> float:
    """Load factor that counts as zero: 1e-3 of the weight, without weight of the least strength, per live load."""
    s, area = assembly.strengths(ROUTE), assembly.interfaces.area
    strengths = np.concatenate([s.tension, s.shear, s.cohesion, s.crush_dry, s.crush_inner]) * np.tile(area, 5)
    usable = strengths[np.isfinite(strengths) & (strengths > 0.0)]
    return 1e-3 * float(assembly.total_dead or usable.min(initial=np.inf)) / assembly.total_live


def _arms(assembly: Assembly) -> tuple[Array, Array, Array]:
    """Frames (m, q, q') of all faces: directions of resultants as forces (m, q, d), couples (m, q, r), arms by side."""
    faces, elements = assembly.interfaces, assembly.elements
    count, planar = len(faces), assembly.dimension == 2
    if planar:
        push = np.zeros((count, 3, 2))
        push[:, 0] = faces.normal
        push[:, 1] = np.column_stack([-faces.normal[:, 1], faces.normal[:, 0]])
        couple = np.zeros((count, 3, 1))
        couple[:, 2, 0] = 1.0
    else:
        push, couple = np.zeros((count, 6, 3)), np.zeros((count, 6, 3))
        push[:, 0], push[:, 1], push[:, 2] = faces.normal, faces.e1, faces.e2
        couple[:, 3], couple[:, 4], couple[:, 5] = faces.e1, faces.e2, faces.normal
    arms = np.stack([faces.origin - elements.centroid[faces.a], faces.origin - elements.centroid[faces.b]])
    return push, couple, arms


def _cross(arm: Array, force: Array) -> Array:
    if arm.shape[-1] == 2:
        return (arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0])[..., None]
    return np.cross(arm, force)


def _left(assembly: Assembly, forces: Array, load: float) -> Array:
    """Forces and moments / size that are left on free elements, (n, q)."""
    push, couple, arms = _arms(assembly)
    force = np.einsum("mq,mqd->md", forces, push)
    moment = np.einsum("mq,mqr->mr", forces, couple)
    left = assembly.dead + load * assembly.live
    for arm, ends, sign in zip(arms, (assembly.interfaces.a, assembly.interfaces.b), (-1.0, 1.0), strict=True):
        acting = sign * np.column_stack([force, moment + _cross(arm, force)])
        np.add.at(left, ends, acting)
    left[:, assembly.dimension :] /= assembly.size
    return np.asarray(left[assembly.elements.free])


def _room(assembly: Assembly, labels: NDArray[np.bool_], forces: Array, effective: bool) -> Array:
    """What is left of the strength of each face, in force: negative outside."""
    faces, s = assembly.interfaces, assembly.strengths(ROUTE)
    n = forces[:, 0]
    mu = np.where(labels, s.friction, s.inner_friction)
    capacity = np.where(labels, s.cohesion, s.shear) * faces.area + mu * n
    if assembly.dimension == 2:
        bent, shear = abs(forces[:, 2]) / (0.5 * faces.l1), abs(forces[:, 1])
        crush = s.crush_dry * faces.area
        dry = n - np.where(np.isfinite(crush), n * n / crush, 0.0) - bent
        inner = np.minimum(n + s.tension * faces.area, s.crush_inner * faces.area - n) / 3.0 - bent
        return np.asarray(np.minimum(np.where(labels, dry, inner), capacity - shear))
    shear = np.hypot(forces[:, 1], forces[:, 2])
    if not effective:
        shear = shear + abs(forces[:, 5]) / faces.c_t
    room = capacity - shear
    for k, polygon in enumerate(faces.polygon):
        if not faces.rectangle[k]:
            # dry: the centre of pressure within the hull, by its edges; inner faces bend by their kern, not stated here
            room[k] = min(room[k], _pressed(assembly, k, forces[k])) if labels[k] else room[k]
            continue
        corners = np.column_stack([(polygon - faces.origin[k]) @ axis[k] for axis in (faces.e1, faces.e2)])
        tension = 0.0 if labels[k] else s.tension[k] * faces.area[k]
        # stress by Navier for inner faces, both bendings apart; lever for dry ones
        share = 1.0 if labels[k] else 3.0
        half1, half2 = (0.5 * np.ptp(corners[:, axis]) for axis in (0, 1))
        pressed = (n[k] + tension) / share
        room[k] = min(room[k], pressed - abs(forces[k, 3]) / half2, pressed - abs(forces[k, 4]) / half1)
        if not labels[k]:
            rest = (s.crush_inner[k] * faces.area[k] - n[k]) / 3.0
            room[k] = min(room[k], rest - abs(forces[k, 3]) / half2, rest - abs(forces[k, 4]) / half1)
    return np.asarray(room)


def _pressed(assembly: Assembly, k: int, forces: Array) -> float:
    """Room of the centre of pressure within the hull of a face: N times its distance from the edges, over the size."""
    faces = assembly.interfaces
    corners = np.column_stack([(faces.polygon[k] - faces.origin[k]) @ axis[k] for axis in (faces.e1, faces.e2)])
    edges = ConvexHull(corners).equations
    lever = edges[:, 0] * -forces[4] + edges[:, 1] * forces[3]
    return float(-(lever + edges[:, 2] * forces[0]).max() / np.ptp(corners, axis=0).max())


def _work(assembly: Assembly, labels: NDArray[np.bool_], velocity: Array) -> tuple[float, float]:
    """Upper bound on the load factor by a mechanism (n, q), and the size of its terms; infinite jumps give infinity."""
    push, couple, arms = _arms(assembly)
    faces, s, d = assembly.interfaces, assembly.strengths(ROUTE), assembly.dimension
    jump = np.zeros((len(faces), push.shape[1]))
    for arm, ends, sign in zip(arms, (faces.a, faces.b), (-1.0, 1.0), strict=True):
        turn = velocity[ends, d:]
        moved = velocity[ends, :d] + (
            np.column_stack([-turn[:, 0] * arm[:, 1], turn[:, 0] * arm[:, 0]]) if d == 2 else np.cross(turn, arm)
        )
        jump += sign * (np.einsum("md,mqd->mq", moved, push) + np.einsum("mr,mqr->mq", turn, couple))
    opening = jump[:, 0]
    if d == 2:
        slip, turned = abs(jump[:, 1]), abs(jump[:, 2]) * 0.5 * faces.l1
    else:
        slip = np.maximum(np.hypot(jump[:, 1], jump[:, 2]), faces.c_t * abs(jump[:, 5]))
        turned = np.array([_bent(assembly, k, jump[k]) for k in range(len(faces))])
    crush_dry, tension, crush = s.crush_dry * faces.area, s.tension * faces.area, s.crush_inner * faces.area
    total, size = 0.0, 0.0
    for k in range(len(faces)):
        # inner faces that are no rectangles bend by their kern, which is not stated here again
        plain = bool(labels[k]) or d == 2 or bool(faces.rectangle[k])
        lack = turned[k] / (1.0 if labels[k] else 3.0) - opening[k] if plain else -opening[k]
        lack += (s.friction[k] if labels[k] else s.inner_friction[k]) * slip[k]
        stuck = (s.cohesion[k] if labels[k] else s.shear[k]) * faces.area[k] * slip[k]
        limit = crush_dry[k] if labels[k] else crush[k]
        if labels[k]:
            work = 0.0 if lack <= 0.0 or math.isinf(limit) else _crushing(lack, turned[k], limit)
        else:
            cracked = opening[k] - s.inner_friction[k] * slip[k]
            # corners of the set in N and m: the tip in tension, both edges and the tip in compression
            corners = [(-tension[k], 0.0)]
            if math.isfinite(limit):
                corners += [(0.5 * (limit - tension[k]), (limit + tension[k]) / 6.0), (limit, 0.0)]
            work = max(-normal * cracked + moment * turned[k] for normal, moment in corners)
        if math.isinf(limit) and lack > 1e-9 * max(turned[k], slip[k], abs(opening[k]), abs(jump).max()):
            return math.inf, 1.0
        total += work + stuck
        size += abs(work) + stuck
    capacity = np.where(labels, crush_dry, crush)
    size += 1e-6 * float(capacity[np.isfinite(capacity)].sum()) * float(abs(velocity[:, :d]).max())
    power = float((assembly.dead * velocity)[assembly.elements.free].sum())
    done = float((assembly.live * velocity)[assembly.elements.free].sum())
    size += float(abs(assembly.dead * velocity)[assembly.elements.free].sum())
    return (total - power) / done, size / abs(done)


def _bent(assembly: Assembly, k: int, jump: Array) -> float:
    """Opening that a spatial face needs so that no corner closes, by its turns."""
    faces = assembly.interfaces
    corners = np.column_stack([(faces.polygon[k] - faces.origin[k]) @ axis[k] for axis in (faces.e1, faces.e2)])
    return float(-(jump[3] * corners[:, 1] - jump[4] * corners[:, 0]).min())


def _crushing(lack: float, turned: float, limit: float) -> float:
    """max N lack − N² turned / N_c over 0 ≤ N ≤ N_c."""
    normal = limit if turned <= 0.0 else min(limit, 0.5 * lack * limit / turned)
    return normal * lack - normal * normal * turned / limit
