"""Bounds by fields under loads as they act, against own stress and velocity fields on a uniform mesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from benchmarks.claims.independent_fields import Array, Lattice, Pull, lower_bound, upper_bound
from benchmarks.claims.tally import Tally, run_cases
from jld_core import InputError, build_assembly, parse_scene
from jld_core.fields import bounds_by_fields

CLAIM: Final = (
    "Bounds by fields under dead and live pressures, line loads, patches, forces with widths and self-weight agree "
    "with own fields on a uniform mesh, in the plane and in space"
)
_IN_SPACE: Final = (9, 18, 27)
"""Seeds modulo 28 whose scenes are in space: 60 of 560."""
_SLACK: Final = 1e-5
"""Relative amount by which bounds may cross: the own ones are the solver's."""
_MOST: Final = {2: 200, 3: 60}
"""Most triangles or tetrahedra of the meshes of the program."""

_Load = tuple[dict[str, Any], Pull | None, Callable[[Array], bool], Array]
"""Load entry of a scene; its traction, where it acts, and its force per weight."""


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on random structures: see `run_cases`."""
    return run_cases(CLAIM, case, first_seed, cases, seconds)


def case(seed: int, tally: Tally) -> str:
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


def random_scene(rng: np.random.Generator, d: int) -> tuple[dict[str, Any], Lattice]:
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
    scene = {
        "elements": elements,
        "materials": {"density": density, "gravity": gravity.tolist(), "dry": joint, "inner": inner},
        "loads": {"dead": [one[0] for one in dead], "live": [one[0] for one in live]},
        "labels": {"default": "dry", "inner": inner_pairs},
        **({"thickness": thickness} if d == 2 else {}),
    }
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
    """Return the indices of the cells of a box of the lattice."""
    axes = [range(int(a), int(b)) for a, b in zip(low, high, strict=True)]
    return [tuple(int(x) for x in cell) for cell in np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, len(axes))]


def _cut(rng: np.random.Generator, low: Array, high: Array, times: int) -> list[tuple[Array, Array]]:
    """Cut a box of the lattice in two, again and again, at random."""
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
    """Return the scene entry of a rectangle or box."""
    if len(low) == 2:
        (a, b), (c, d) = low.tolist(), high.tolist()
        return {"id": name, "polygon": [[a, b], [c, b], [c, d], [a, d]], **more}
    ends = (low.tolist(), high.tolist())
    vertices = [[ends[i][0], ends[j][1], ends[k][2]] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return {"id": name, "vertices": vertices, "faces": faces, **more}


def _labels(
    rng: np.random.Generator, block: dict[tuple[int, ...], int], support: set[tuple[int, ...]], feet: list[Any]
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


def _load(
    rng: np.random.Generator, boxes: list[tuple[Array, Array]], shape: Array, step: Array, thickness: float
) -> _Load:
    """Return a random load."""
    d, none = len(step), np.zeros(len(step))
    kind = str(rng.choice(["pressure", "pressure", "line", "force", "force", "body", "around"]))
    if kind == "body":
        vector = rng.uniform(-1.0, 1.0, d)
        return {"body": vector.tolist()}, None, lambda _: False, vector
    if kind == "around":
        number, pressure = int(rng.integers(len(boxes))), float(rng.uniform(-0.5, 1.0))
        free = _free_surface(boxes, number, shape)
        if free:
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

    def acts(at: Array) -> bool:
        inside = (first - 1e-9 <= at[: d - 1]) & (at[: d - 1] <= last + 1e-9)
        return bool(inside.all() and abs(at[d - 1] - top) < 1e-9)

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


def _free_surface(boxes: list[tuple[Array, Array]], number: int, shape: Array) -> bool:
    """Return True if part of a block's boundary is certainly free: at the top or the sides of the structure."""
    low, high = boxes[number]
    return bool(high[-1] == shape[-1] or low[0] == 0 or high[0] == shape[0])


def _force(
    rng: np.random.Generator, boxes: list[tuple[Array, Array]], shape: Array, step: Array, thickness: float
) -> _Load:
    """Return a force with a width on the upper surface."""
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

    def acts(place: Array) -> bool:
        inside = (first - 1e-9 <= place[: d - 1]) & (place[: d - 1] <= last + 1e-9)
        return bool(inside.all() and abs(place[d - 1] - top) < 1e-9)

    return (
        {"element": f"b{number}", "force": vector.tolist(), "at": at, "width": width},
        lambda *_: value,
        acts,
        (np.zeros(d)),
    )
