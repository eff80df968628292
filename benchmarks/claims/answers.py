"""Random cases of single answers: converged, the same in other units, under other kernels and in mirror images."""

from __future__ import annotations

import copy
import itertools
import json
import math
import os
import subprocess
import sys
import time
import warnings
from dataclasses import fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from benchmarks.claims import Tally
from benchmarks.hard_cases import hard_cases
from benchmarks.scenes import cells, names_of
from jld_core import (
    Assembly,
    InputError,
    LimitAnalysisResult,
    Scene,
    Status,
    build_assembly,
    parse_scene,
    samples,
    solve,
    tolerances,
)
from jld_core.arrays import Bits, Floats
from jld_core.fields import bounds_by_fields
from jld_core.limit import load_scale
from jld_core.limit.bounds import are_disjoint
from jld_core.loads import Loads
from jld_core.refinement import crack_cells, refine
from jld_core.scene.cracks import CellCracks, FieldCracks
from jld_core.strengths import Route
from jld_explore import search_space
from jld_samples import box

ROUTE = Route("a benchmark")
GROUPS: Final = ("space", "plane", "effective areas")
# relative difference that the second statement in scene units may show: rounding of sums of a few hundred terms
CLOSE: Final = 1e-7
Document = dict[str, Any]
Array = NDArray[np.float64]


def case_converged(seed: int, tally: Tally) -> str:
    """Solve the scene of one seed and weigh its result again.

    Three groups of random scenes, drawn by ``seed % 3``:

    - space: boxes and prisms with steps, friction mostly at exactly 45 degrees, on a floor and beside walls
    - plane: grids with crushing joints and cracks, weak and strong, some without weight
    - effective areas: boxes in bond, torsion about the pressed rectangle

    A case disagrees if the bracket is crossed, the forces are not admissible, the mechanism does not give the upper
    end, or an uncertified result has no reason. Both are weighed in scene units by formulas stated here once more.
    ``notes`` counts results by group and status, and of those that are not converged which end is missing.
    """
    group = GROUPS[seed % 3]
    assembly, labels = drawn_converged(seed)
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
    tally.count(name)
    return weighed(assembly, labels, result, effective)


def drawn_converged(seed: int) -> tuple[Assembly, NDArray[np.bool_]]:
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


def _prism(name: str, places: list[tuple[int, int]], x: Array, z: Array, low: float, high: float) -> Document:
    rings = [[(i, k), (i + 1, k), (i + 1, k + 1), (i, k + 1)] for i, k in places]
    edges = {edge for ring in rings for edge in itertools.pairwise([*ring, ring[0]])}
    following = dict(sorted((a, b) for a, b in edges if (b, a) not in edges))
    loop = [min(following)]
    while following[loop[-1]] != loop[0]:
        loop.append(following[loop[-1]])

    def bends(o: tuple[int, int], p: tuple[int, int], q: tuple[int, int]) -> bool:
        return (p[0] - o[0]) * (q[1] - p[1]) != (p[1] - o[1]) * (q[0] - p[0])

    turns = [loop[k] for k in range(len(loop)) if bends(loop[k - 1], loop[k], loop[(k + 1) % len(loop)])]
    count = len(turns)
    vertices = [[float(x[i]), y, float(z[k])] for y in (high, low) for i, k in turns]
    # seen from y = low, the ring (x, z) runs counter-clockwise
    sides = [[n, count + n, count + (n + 1) % count, (n + 1) % count] for n in range(count)]
    faces = [list(range(count))[::-1], list(range(count, 2 * count)), *[side[::-1] for side in sides]]
    return {"id": name, "vertices": vertices, "faces": faces}


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
    long = float(x[-1])
    elements.append(box("floor", (-0.3, -0.1, -0.1), (long + 0.3, deep + 0.1, 0.0), support=True))
    if rng.random() < 0.5:
        elements.append(box("left", (-0.2, 0.0, 0.0), (0.0, deep, up), support=True))
        if rng.random() < 0.5:
            elements.append(box("right", (long, 0.0, 0.0), (long + 0.2, deep, up), support=True))
    friction = float(rng.choice([1.0, 0.6, 0.0, 1.5], p=[0.7, 0.2, 0.03, 0.07]))
    return {"elements": elements, "materials": _materials(rng, friction, 0.0), "loads": {"live": _live(rng, names)}}


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
    names = names_of(lines)
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
    grid = {"cell": [0.1, float(rng.choice([0.05, 0.1, 0.2]))], "thickness": 0.1, "rows": lines}
    return {"grid": grid, "materials": materials, "loads": {"live": live}}


def _bonded(rng: np.random.Generator) -> Document:
    across, courses, wythes = (int(rng.integers(low, high)) for low, high in ((1, 4), (1, 4), (1, 3)))
    length, depth, height = (float(rng.choice([0.1, 0.15, 0.2])) for _ in range(3))
    shift = 0.5 * length if rng.random() < 0.7 else 0.0
    elements: list[Document] = []
    for course, wythe in itertools.product(range(courses), range(wythes)):
        ends = np.arange(across + 1) * length
        if shift and (course + wythe) % 2:
            ends = np.concatenate([[0.0], ends[:-1] + shift, [across * length]])
        for n, (a, b) in enumerate(itertools.pairwise(ends.tolist())):
            low, high = (a, wythe * depth, course * height), (b, (wythe + 1) * depth, (course + 1) * height)
            elements.append(box(f"b{course}.{wythe}.{n}", low, high))
    names = [element["id"] for element in elements]
    high = (across * length + 0.3, wythes * depth + 0.3, 0.0)
    elements.append(box("floor", (-0.3, -0.3, -0.1), high, support=True))
    friction = float(rng.choice([0.3, 0.6, 1.0], p=[0.3, 0.4, 0.3]))
    live = _live(rng, names)
    if rng.random() < 0.3 and "element" in live[0]:
        live[0]["at"] = [float(v) for v in rng.uniform([0.0, 0.0, 0.0], [across * length, wythes * depth, height])]
    return {"elements": elements, "materials": _materials(rng, friction, 0.0), "loads": {"live": live}}


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
        bound, noise = _work_converged(assembly, labels, result.mechanism)
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
    count = len(faces)
    if assembly.dimension == 2:
        push, couple = np.zeros((count, 3, 2)), np.zeros((count, 3, 1))
        push[:, 0], push[:, 1] = faces.normal, np.column_stack([-faces.normal[:, 1], faces.normal[:, 0]])
        couple[:, 2, 0] = 1.0
    else:
        push, couple = np.zeros((count, 6, 3)), np.zeros((count, 6, 3))
        push[:, 0], push[:, 1], push[:, 2] = faces.normal, faces.e1, faces.e2
        couple[:, 3], couple[:, 4], couple[:, 5] = faces.e1, faces.e2, faces.normal
    arms = np.stack([faces.origin - elements.centroid[faces.a], faces.origin - elements.centroid[faces.b]])
    return push, couple, arms


def _left(assembly: Assembly, forces: Array, load: float) -> Array:
    push, couple, arms = _arms(assembly)
    force = np.einsum("mq,mqd->md", forces, push)
    moment = np.einsum("mq,mqr->mr", forces, couple)
    left, planar = assembly.dead + load * assembly.live, assembly.dimension == 2
    for arm, ends, sign in zip(arms, (assembly.interfaces.a, assembly.interfaces.b), (-1.0, 1.0), strict=True):
        turn = (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0])[:, None] if planar else np.cross(arm, force)
        np.add.at(left, ends, sign * np.column_stack([force, moment + turn]))
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


def _work_converged(assembly: Assembly, labels: NDArray[np.bool_], velocity: Array) -> tuple[float, float]:
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
            # max N lack − N² turned / N_c over 0 ≤ N ≤ N_c
            normal = 0.0 if lack <= 0.0 or math.isinf(limit) else limit
            normal = min(normal, 0.5 * lack * normal / turned[k]) if turned[k] > 0.0 else normal
            work = normal * lack - (normal * normal * turned[k] / limit if normal else 0.0)
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


ALIKE: Final = 1e-9  # largest relative difference of λ in other units
UNITS: Final = {"kN and mm": (1e3, 1e-3), "MN and m": (1.0, 1e-6)}  # numbers per metre and per newton
UNITS["pounds and inches"] = (1.0 / 0.0254, 1.0 / 4.4482216152605)
FAR: Final = 500.0  # distance by which a scene is moved, m: its size is about half a metre


def case_units(seed: int, tally: Tally, names: tuple[str, ...] = ()) -> str:
    """Solve the scene of one seed in all units, places and orders, or after the named changes only.

    Random scenes of the claim `converged`, some of them with two load cases. Each is solved in N and m, and again in kN
    and mm, MN and m, pounds and inches; moved by about a thousand sizes; and with its elements in another order. A case
    disagrees if a status differs, or λ by more than 1e-9 of λ or of the load factor that counts as zero. Where a scene
    is moved or its elements renumbered, coordinates are rounded and solvers take other paths: there λ may differ by the
    width that a bracket may have, 1e-6. ``notes`` counts pairs by the decade of that difference.
    """
    document, labels = drawn_units(seed)
    assembly = build_assembly(parse_scene(document))
    first = solve(assembly, labels)
    problems = []
    for name, changed in changes(document, seed).items():
        if names and name not in names:
            continue
        other = build_assembly(parse_scene(changed))
        second = solve(other, matched(assembly, labels, other))
        wrong = _difference(assembly, first, second, name, tally)
        if wrong:
            problems.append(wrong)
    return "; ".join(problems)


def drawn_units(seed: int) -> tuple[Document, np.ndarray]:
    document, labels = drawn_document(seed)
    if seed % 5 == 0:
        live = document["loads"]["live"]
        elements = build_assembly(parse_scene(document)).elements
        force = [0.5, 0.0, -1.0] if "elements" in document else [0.5, -1.0]
        other = [{"element": elements.ids[elements.free[0]], "force": force}]
        cases = [{"name": "one", "live": live}, {"name": "two", "live": other, "required": 1.5}]
        document["loads"] = {"cases": cases}
    return document, labels


def changes(document: Document, seed: int) -> dict[str, Document]:
    found = {name: in_units(document, length, force) for name, (length, force) in UNITS.items()}
    if "elements" in document:
        found["moved"] = in_units(document, 1.0, 1.0, (FAR, -0.7 * FAR, 0.4 * FAR))
        found["renumbered"] = copy.deepcopy(document)
        order = np.random.default_rng(seed).permutation(len(document["elements"]))
        found["renumbered"]["elements"] = [document["elements"][k] for k in order]
    return found


def in_units(
    document: Document, length: float, force: float, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Document:
    """Return a scene with numbers of length times `length` and forces times `force`, moved by `shift` before."""

    def placed(point: list[float]) -> list[float]:
        return [length * (x + by) for x, by in zip(point, shift, strict=False)]

    changed = copy.deepcopy(document)
    if "grid" in changed:
        changed["grid"]["cell"] = [length * x for x in changed["grid"]["cell"]]
        changed["grid"]["thickness"] *= length
    for element in changed.get("elements", []):
        element["vertices"] = [placed(point) for point in element["vertices"]]
    materials = changed["materials"]
    materials["density"] *= force / length**3
    for label in ("dry", "inner"):
        for key in materials[label]:
            if key.endswith("strength") or key == "cohesion":
                materials[label][key] *= force / length**2
    loads = changed["loads"]
    for live in (loads["live"],) if "live" in loads else tuple(one["live"] for one in loads["cases"]):
        for entry in live:
            if "force" in entry:
                entry["force"] = [force * x for x in entry["force"]]
            if "at" in entry:
                entry["at"] = placed(entry["at"])
    return changed


def matched(assembly: Assembly, labels: np.ndarray, other: Assembly) -> np.ndarray:
    """Return the labels of `assembly` in the order of the interfaces of `other`, by the names of their elements."""
    if len(labels) != len(other.interfaces):
        raise ValueError(f"{len(labels)} interfaces became {len(other.interfaces)}")
    # Several faces of one pair have the order of their places.
    of = dict(zip(_names(assembly), labels.tolist(), strict=True))
    return np.array([of[name] for name in _names(other)])


def _names(assembly: Assembly) -> list[tuple[str, str, int]]:
    """Return the pair of elements of each interface, and the number of the interface within its pair."""
    ids, faces, seen = assembly.elements.ids, assembly.interfaces, dict[tuple[str, str], list[int]]()
    pairs = [tuple(sorted((ids[a], ids[b]))) for a, b in zip(faces.a, faces.b, strict=True)]
    for k, (one, two) in enumerate(pairs):
        seen.setdefault((one, two), []).append(k)
    numbers = {}
    for own in seen.values():
        way = np.round((faces.origin[own] - faces.origin[own].min(axis=0)) / assembly.size, 6)
        for rank, place in enumerate(np.lexsort(way.T[::-1])):
            numbers[own[place]] = rank
    return [(one, two, numbers[k]) for k, (one, two) in enumerate(pairs)]


def _difference(
    assembly: Assembly, first: LimitAnalysisResult, second: LimitAnalysisResult, name: str, tally: Tally
) -> str:
    """Compare two results; count the decade of their difference and return what is wrong, "" if nothing is."""
    kind = "units" if name in UNITS else name
    if first.status is not second.status:
        tally.count(f"{kind}: status")
        return f"{name}: {first.status} became {second.status}"
    one, two = first.load_factor, second.load_factor
    if math.isnan(one) or str(first.status) == "uncertified":
        tally.count(f"{kind}: {first.status}")
        return ""
    apart = abs(two - one) / max(abs(one), abs(two), load_scale(assembly))
    decade = max(math.ceil(math.log10(apart)), -15) if apart else -15
    tally.count(f"{kind}: to 1e{decade}")
    wrong = apart > (ALIKE if name in UNITS else tolerances.GAP)
    return f"{name}: {one!r} became {two!r} ({apart:.1e}, {first.solve_log})" if wrong else ""


NARROW: Final = 1e-6  # relative width of a bracket that counts as narrow
MOST: Final = {2: 260, 3: 110}  # largest number of cells of a case by dimension, so that a case takes a second


def case_refined(seed: int, tally: Tally) -> str:
    """Solve one refined sample.

    Arches, walls, vaults and buttresses of `jld_core.samples` with inner faces of 1e5 to 1e10 Pa, refined into cells. A
    case disagrees where its status is `uncertified`. Brackets of 1e-6 and more are counted in ``notes``.
    """
    kind, scene = scene_of_refined(seed)
    result = solve(scene)
    tally.count(str(result.status))
    if result.status is Status.UNCERTIFIED:
        return f"{kind}: {result.reason}"
    if result.status is Status.COLLAPSE and not result.gap < NARROW:
        tally.count(f"width of 1e-6 or more, {kind}")
    return ""


def scene_of_refined(seed: int) -> tuple[str, Scene]:
    """Return the kind and the refined scene of a seed; refinements of too many cells are drawn again."""
    rng = np.random.default_rng(seed)
    while True:
        kind = ("arch", "wall", "vault", "buttress")[seed % 4]
        scene, how = _drawn(kind, rng)
        try:
            fine = refine(scene, **how).scene
            assembly = build_assembly(fine)
        except InputError:  # cells that leave no element of such a shape whole
            continue
        if len(assembly.elements) <= MOST[assembly.dimension]:
            return kind, fine


def _drawn(kind: str, rng: np.random.Generator) -> tuple[Scene, dict[str, Any]]:
    strength, shear = 10.0 ** rng.uniform(5.0, 10.0, 2)
    if rng.random() < 0.5:
        shear = strength
    stone = samples.Stone(float(rng.uniform(1600, 2800)), float(rng.uniform(0.4, 0.9)), float(strength), float(shear))
    load = str(rng.choice(["push", "crown", "quarter"]))
    cell = float(rng.uniform(0.06, 0.3))
    if kind == "arch":
        thickness = float(rng.uniform(0.1, 0.3))
        scene = samples.arch(
            thickness=thickness, embrace=float(rng.uniform(90, 180)), voussoirs=int(rng.integers(5, 15)),
            rings=int(rng.integers(1, 3)), load=load, stone=stone,
        )  # fmt: skip
        if rng.random() < 0.5:
            return scene, {"kind": "radial", "centre": (0.0, 0.0), "cell": (thickness / 3, float(rng.uniform(4, 10)))}
        return scene, {"cell": (cell,)}
    if kind == "wall":
        scene = samples.wall(
            courses=int(rng.integers(3, 8)), length=0.4 * int(rng.integers(3, 7)), load=load, stone=stone,
            opening="0.4,0.2,0.4,0.2" if rng.random() < 0.4 else None,
        )  # fmt: skip
        return scene, {"cell": (cell, float(rng.uniform(0.08, 0.2)))}
    if kind == "buttress":
        scene = samples.buttress(
            courses=int(rng.integers(3, 9)), columns=int(rng.integers(1, 4)), thrust=float(rng.uniform(0.5, 0.9)),
            rise=float(rng.uniform(0.0, 0.5)), stone=stone,
        )  # fmt: skip
        return scene, {"cell": (4 * cell,), "kind": str(rng.choice(["grid", "voronoi"])), "seed": int(rng.integers(99))}
    scene = samples.vault(
        kind=str(rng.choice(["barrel", "cross"], p=[0.8, 0.2])),
        voussoirs=2 * int(rng.integers(2, 5)), courses=int(rng.integers(1, 4)), length=float(rng.uniform(0.6, 2.0)),
        load=load, stone=stone,
    )  # fmt: skip
    return scene, {"cell": tuple(float(v) for v in rng.uniform(0.3, 0.9, 3))}


KERNELS: Final = ("Haswell", "ZEN", "SKYLAKEX", "SANDYBRIDGE")
DISTURBANCES: Final = 10
SIZE: Final = 1e-15  # relative size of a disturbance
APART: Final = 1e-10  # relative distance up to which brackets meet: what a disturbance changes in λ itself
SHARE: Final = 0.002  # greatest difference of the shares settled
_LARGE: Final = ("1000 blocks", "µN, mm")
_CELLS: Final = 60
Answer = tuple[str, float, float]  # status, and both ends of the bracket


def run_digits(claim: str, first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on scenes; the kernels work on the same ones, one after another.

    Hard and ordinary scenes, each solved as it is and ten times with coefficients disturbed by 1e-15, relative, under
    four kernels of OpenBLAS. Each kernel has a process of its own, which reads ``OPENBLAS_CORETYPE`` as it loads the
    library. A scene disagrees where two of its answers have different statuses, or brackets that do not meet. ``notes``
    counts the answers that are not `uncertified` under each kernel; these shares may differ by 0.2 %.
    """
    tally, start = Tally(claim), time.perf_counter()
    places = {seed: _place(seed) for seed in range(first_seed, first_seed + cases)}
    answers: dict[str, dict[int, list[Answer]]] = {}
    names: dict[int, tuple[str, float]] = {}
    for kernel in KERNELS:
        command = [sys.executable, "-m", "benchmarks.claims.answers", str(seconds)]
        environment = {**os.environ, "OPENBLAS_CORETYPE": kernel}
        done = subprocess.run(
            command, input=json.dumps(places), env=environment, stdout=subprocess.PIPE, text=True, check=True
        )
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        answers[kernel] = {line["seed"]: [tuple(one) for one in line["answers"]] for line in lines}
        names |= {line["seed"]: (line["name"], line["floor"]) for line in lines}
        print(f"  {kernel}: {len(lines)} scenes, {time.perf_counter() - start:.0f} s", flush=True)
    common = set.intersection(*(set(found) for found in answers.values()))
    settled = {}
    for kernel, found in answers.items():
        statuses = [status for seed in common for status, _, _ in found[seed]]
        settled[kernel] = sum(status != "uncertified" for status in statuses)
        tally.count(f"answers settled under {kernel}", settled[kernel])
    count = len(common) * (1 + DISTURBANCES)
    tally.count("answers under each kernel", count)
    for seed in sorted(common):
        tally.cases += 1
        problem = _problem({kernel: found[seed] for kernel, found in answers.items()}, *names[seed])
        if problem:
            tally.disagreements.append(f"seed {seed}: {problem}")
    if max(settled.values()) - min(settled.values()) > SHARE * count:
        tally.disagreements.append(f"shares settled differ: {settled} of {count}")
    tally.seconds = time.perf_counter() - start
    return tally


def _problem(found: dict[str, list[Answer]], name: str, floor: float) -> str:
    """Return what the answers to one scene contradict each other in; "" for nothing. floor: its least load scale."""
    statuses = {kernel: sorted({status for status, _, _ in answers}) for kernel, answers in found.items()}
    if len({status for names in statuses.values() for status in names}) > 1:
        return f"{name}: {statuses}"
    ends = np.array([(low, high) for answers in found.values() for _, low, high in answers])
    low, high = ends[:, 0].max(), ends[:, 1].min()
    if low - high > APART * max(abs(low), abs(high), floor):
        return f"{name}: a lower bound of {low!r} and an upper bound of {high!r}"
    return ""


def _place(seed: int) -> int:
    if seed % 5 not in (1, 2):
        return 0
    return next(k for k in range(1000) if len(_refined(seed, k)[1].elements) <= _CELLS)


def _refined(seed: int, place: int) -> tuple[str, Assembly]:
    kind, scene = scene_of_refined(4000 + 1000 * seed + place)
    return f"refined {kind}", build_assembly(scene)


def scene_of_digits(seed: int, place: int) -> tuple[str, Assembly, Bits]:
    """Return name, assembly and labels of a seed: of five, one is a hard case, two are refined samples, two grids."""
    if seed % 5 == 0:
        known = [case for case in hard_cases() if case.name not in _LARGE]
        case = known[seed // 5 % len(known)]
        assembly = case.make()
        return str(case), assembly, assembly.labels if case.labels is None else case.labels(assembly)
    if seed % 5 in (1, 2):
        name, assembly = _refined(seed, place)
        return name, assembly, assembly.labels
    return _grid(seed)


def _grid(seed: int) -> tuple[str, Assembly, Bits]:
    rng = np.random.default_rng(seed)
    wide, high = (int(value) for value in rng.integers(2, 7, 2))
    crush = {"compressive_strength": float(10 ** rng.uniform(5, 8))} if rng.random() < 0.4 else {}
    inner = {"tensile_strength": float(10 ** rng.uniform(3, 7)), "shear_strength": float(10 ** rng.uniform(3, 7))}
    rows, cell = ["a" * wide] * high + ["#" * wide], rng.uniform(0.1, 0.5, 2).tolist()
    dry = {"friction_coefficient": float(rng.uniform(0.2, 0.9)), **crush}
    loads = {"live": [{"body": rng.normal(size=2).tolist()}]}
    document = cells(rows, cell, dry, {**inner, **crush}, loads, thickness=0.2, density=2000)
    assembly = build_assembly(parse_scene(document))
    return "grid", assembly, rng.random(len(assembly.interfaces)) < rng.random()


def disturbed(assembly: Assembly, rng: np.random.Generator) -> Assembly:
    """Return an assembly whose loads, strengths and centroids are changed in their last digits."""

    def changed(values: Floats) -> Floats:
        return np.asarray(values * (1.0 + SIZE * rng.uniform(-1.0, 1.0, values.shape)))

    def changed_loads(loads: Loads) -> Loads:
        return loads.weighted(changed(np.ones(len(loads.body))))

    strengths, elements = assembly.strengths(ROUTE), assembly.elements
    known = {one.name: getattr(strengths, one.name) for one in fields(strengths)}
    known = {name: value for name, value in known.items() if isinstance(value, np.ndarray) and value.dtype.kind == "f"}
    numbers = {name: changed(value) for name, value in known.items()}
    return replace(
        assembly.with_strengths(replace(strengths, **numbers)),
        dead_loads=changed_loads(assembly.dead_loads),
        live_loads=changed_loads(assembly.live_loads),
        elements=replace(elements, centroid=changed(elements.centroid)),
    )


def answers_of(seed: int, place: int) -> dict[str, Any]:
    name, assembly, labels = scene_of_digits(seed, place)
    rng = np.random.default_rng(seed)
    results = [solve(one, labels) for one in (assembly, *(disturbed(assembly, rng) for _ in range(DISTURBANCES)))]
    unknown = {"unstable": (0.0, 0.0), "locked": (0.0, 0.0)}

    def ends(low: float, high: float) -> tuple[float, float]:
        return (low if np.isfinite(low) else -np.inf), (high if np.isfinite(high) else np.inf)

    answers = [(str(one.status), *unknown.get(str(one.status), ends(*one.bracket))) for one in results]
    floor = min(load_scale(case) for case in assembly.by_case)
    return {"seed": seed, "name": name, "floor": floor, "answers": answers}


def _work_digits(places: dict[str, int], seconds: float) -> None:
    warnings.simplefilter("ignore")
    end = time.perf_counter() + seconds
    for seed, place in places.items():
        if time.perf_counter() > end:
            break
        print(json.dumps(answers_of(int(seed), place)), flush=True)


_LAYOUTS: Final = 3  # random layouts of one scene
DIGITS: Final = 1e-9  # largest relative difference of both bounds by faces and by cells
# largest difference of both bounds by fields, relative to the upper one, which solvers know less accurately
FIELD_DIGITS: Final = 1e-6


def case_symmetry(seed: int, tally: Tally) -> str:
    """Return "" where images of a random layout have its λ, or where nothing is merged; else what differs.

    Walls whose geometry is its own mirror image, under loads that are so or nearly so: patches of other widths,
    pressures that rise one way, members on one side, forces at common corners of cells. Every case mirrors its file
    with a random layout; layouts that the search merges as images of each other are compared besides.
    """
    rng = np.random.default_rng([seed, 49])
    kind = ("faces", "cells", "fields")[seed % 3]
    try:
        scene = parse_scene(wall(rng, kind))
        assembly = build_assembly(scene)
        space = search_space(scene, assembly)
    except InputError as error:
        return f"refused: {error}"
    group = space.group
    tally.count(f"{kind}: {'merged' if len(group) > 1 else 'told apart'}")
    labels = assembly.labels.copy()
    labels[: assembly.faces] = rng.random(assembly.faces) < 0.3
    problem = _differs_mirrored(scene, assembly, labels, kind, tally)
    if problem:
        return problem
    for _ in range(_LAYOUTS):
        labels = np.where(space.candidates, rng.random(len(space.fixed)) < 0.25, space.fixed)
        problem = _differs(scene, assembly, np.unique(labels[group], axis=0), kind)
        if problem:
            return problem
    return ""


def _differs(scene: Scene, assembly: Assembly, images: Bits, kind: str) -> str:
    found = [_bracket(scene, assembly, labels) for labels in images]
    for status, bracket in found[1:]:
        if status != found[0][0]:
            return f"{kind}: status {found[0][0]} and {status}"
        first = found[0][1]
        if are_disjoint(bracket, first) or (kind != "fields" and abs(bracket[0] - first[0]) > DIGITS * abs(first[0])):
            return f"{kind}: {first} and {bracket}"
    return ""


def _differs_mirrored(scene: Scene, assembly: Assembly, labels: Bits, kind: str, tally: Tally) -> str:
    """Return how λ of a layout and that of its image in a mirrored file differ; "" where it does not."""
    image = parse_scene(mirrored(scene.model_dump(mode="json", exclude_defaults=True)))
    other = build_assembly(image)
    width = float(scene.grid.cell[0] * len(scene.grid.rows[0])) if scene.grid else 0.0
    place = {(round(x, 6), round(y, 6)): k for k, (x, y) in enumerate(other.interfaces.origin[: other.faces].tolist())}
    turned = other.labels.copy()
    for k, (x, y) in enumerate(assembly.interfaces.origin[: assembly.faces].tolist()):
        turned[place[round(width - x, 6), round(y, 6)]] = labels[k]
    (status, one), (same, two) = _bracket(scene, assembly, labels), _bracket(image, other, turned)
    if status != same:
        return f"{kind}, mirrored: status {status} and {same}"
    known = [abs(value) for value in (*one, *two) if np.isfinite(value)]
    away = max((abs(a - b) for a, b in zip(one, two, strict=True) if a != b), default=0.0) / max([*known, 1e-300])
    tally.count(f"{kind}, mirrored: {'beyond' if away > DIGITS else 'to'} 1e-9")
    return "" if away <= (FIELD_DIGITS if kind == "fields" else DIGITS) else f"{kind}, mirrored: {one} and {two}"


def mirrored(document: Document) -> Document:
    """Return the document of a wall with left and right exchanged."""
    rows = document["grid"]["rows"]
    across = len(rows[0])
    width = across * document["grid"]["cell"][0]

    def at(point: list[float]) -> list[float]:
        return [width - point[0], point[1]]

    def name(element: str) -> str:
        column, row = element[1:].split("r")
        return f"c{across - 1 - int(column)}r{row}"

    def load(entry: Document) -> Document:
        if "face" in entry:
            return {**entry, "face": {"along": [at(point) for point in entry["face"]["along"]]}}
        force = [-entry["force"][0], entry["force"][1]]
        return {**entry, "element": name(entry["element"]), "at": at(entry["at"]), "force": force}

    members = [
        {**one, **{key: {"element": name(one[key]["element"]), "at": at(one[key]["at"])} for key in ("from", "to")}}
        for one in document.get("members", [])
    ]
    grid = {**document["grid"], "rows": [row[::-1] for row in rows]}
    live = [load(entry) for entry in document["loads"]["live"]]
    return {**document, "grid": grid, "loads": {"live": live}, "members": members}


def _bracket(scene: Scene, assembly: Assembly, labels: Bits) -> tuple[str, tuple[float, float]]:
    """Return status and bracket of one layout under the crack model of its scene."""
    if isinstance(scene.cracks, FieldCracks):
        bounds = bounds_by_fields(assembly, labels, gap=10.0)
        return "collapse", (bounds.lower, bounds.upper)
    if isinstance(scene.cracks, CellCracks):
        cells = crack_cells(scene, assembly, scene.cracks.cell)
        assembly, labels = cells.fine, cells.labels(labels)
    result = solve(assembly, labels)
    low, high = result.bracket
    return str(result.status), (low, high) if result.status is Status.COLLAPSE else (0.0, 0.0)


def wall(rng: np.random.Generator, kind: str) -> Document:
    """Return a lintel of 4 × 1 or 2 cells of 1 m, whose loads are their own mirror image or differ in one thing."""
    across, up = 4, int(rng.integers(1, 3))
    width, top = float(across), float(up + 1)
    odd = str(rng.choice(["nothing", "width", "size", "pressure", "member", "corner"]))
    reach = [float(rng.uniform(0.2, 0.6))] * 2
    size = [float(rng.uniform(1e3, 5e3))] * 2
    if odd == "width":
        reach[1] *= 0.05
    if odd == "size":
        size[1] *= 1.3
    live: list[Document] = []
    inset = 1.5 if odd == "corner" else 1.35  # four of the finer cells meet at 1.5
    places = [inset, width - inset]
    push = float(rng.uniform(0.1, 0.6))
    for side, x in enumerate(places):
        patch = {"width": reach[side]} if kind == "fields" else {}
        force = [push * size[side] * (1 - 2 * side), -size[side]]
        live.append({"element": f"c{int(x)}r0", "force": force, "at": [x, top], **patch})
    if kind != "fields" and (rng.random() < 0.5 or odd == "pressure"):
        value, half = float(rng.uniform(1e3, 5e3)), 0.45
        for side, (x, share) in enumerate(((1.5, 1.0), (width - 1.5, 0.2 if odd == "pressure" else 1.0))):
            # the same resultant on a shorter part of the face
            ends = [[x - share * half, top], [x + share * half, top]]
            live.append({"face": {"along": ends[:: 1 - 2 * side]}, "pressure": value / share})
    members: list[Document] = []
    if kind != "fields" and (rng.random() < 0.4 or odd == "member"):
        sides = [0] if odd == "member" else [0, 1]
        for side in sides:
            points = [[abs(side * width - x), y] for x, y in ([0.25, top - 0.25], [0.75, 0.5])]
            column = side * (across - 1)
            held = [f"c{column}r0", f"c{column}r{up}"]
            anchors = [{"element": name, "at": at} for name, at in zip(held, points, strict=True)]
            members.append({"kind": "tie", "from": anchors[0], "to": anchors[1], "tension": 3e3})
    inner = {"tensile_strength": 1e5, "shear_strength": 1.5e5}
    rows, dry = ["a" * across] * up + ["#..#"], {"friction_coefficient": float(rng.uniform(0.4, 0.8))}
    cracks = {"faces": "faces", "cells": {"kind": "cells", "cell": 0.5}, "fields": {"kind": "fields"}}[kind]
    own: Document = {"members": members, "search": {"segmentation": False}, "cracks": cracks, "density": 2000.0}
    return cells(rows, [1.0, 1.0], dry, inner, {"live": live}, thickness=1.0, **own)


if __name__ == "__main__":
    _work_digits(json.loads(sys.stdin.read()), float(sys.argv[1]))
