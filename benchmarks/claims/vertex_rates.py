"""Claim: derivatives of λ by vertices agree with fourth-order differences.

Random arches, walls and grids with shaken vertices: labels, strengths, cohesion, friction of cracks, stated weights,
loads at centroids and at fixed places differ, and every seventh crushes. Every fifth scene is a strip of a vault in
space with leaning joints. All vertices move at once along random directions, by steps of 2e-5 of the size, 3e-4 where
joints crush, in space 1e-3. A case disagrees where the relative difference, over |gradient| |direction|, exceeds 1e-7
in the plane or 1e-6 in space. Scenes without collapse, and those whose differences with half the step are not alike (a
kink lies between), are counted in ``notes``.
"""

from __future__ import annotations

import itertools
import json
import math
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.claims.tally import Tally, run_cases
from jld_core import Assembly, Status, build_assembly, geometry_sensitivities, parse_scene, samples, solve
from jld_core.arrays import Floats
from jld_core.strengths import Route
from jld_geometry import MovedScene, vertex_mesh

ROUTE = Route("a benchmark")

CLAIM: Final = "derivatives of λ by vertices agree with fourth-order differences to 1e-7 in the plane, 1e-6 in space"
PLANAR: Final = 1e-7
"""Largest relative difference in the plane."""
SPATIAL: Final = 1e-6
"""Largest relative difference in space."""
Document = dict[str, Any]


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on random scenes.

    first_seed, cases: seeds to test. seconds: time limit, s. Returns: disagreements, and in `notes` the number of
    smooth scenes, of kinks and of scenes without collapse.
    """
    return run_cases(CLAIM, case, first_seed, cases, seconds)


def case(seed: int, tally: Tally) -> str:
    """Hold the derivatives of one scene against differences."""
    spatial = seed % 5 == 4
    rates, difference, other, size = (_of_strip if spatial else _of_plane)(seed)
    if math.isnan(rates):
        tally.count("no collapse")
        return ""
    allowed = (SPATIAL if spatial else PLANAR) * size
    if abs(difference - other) > allowed:
        tally.count("kink within the steps")
        return ""
    tally.count("smooth in space" if spatial else "smooth in the plane")
    if abs(rates - difference) <= allowed:
        return ""
    return f"derivative {rates:.12g}, difference {difference:.12g}, relative {abs(rates - difference) / size:.2g}"


def drawn(seed: int) -> Document:
    """Draw the document of a planar scene, with interfaces as stated ones."""
    random = np.random.default_rng(seed)
    kind = ("arch", "wall", "grid")[seed % 3]
    options: Document = {}
    if kind == "arch":
        options = {"thickness": float(random.uniform(0.2, 0.35)), "voussoirs": int(random.integers(5, 11))}
        options |= {"rings": int(random.integers(1, 3)), "load": str(random.choice(["push", "quarter"]))}
    elif kind == "wall":
        options = {"length": float(random.uniform(0.8, 1.6)), "courses": int(random.integers(2, 5))}
    scene = samples.KINDS[kind](**options)
    assembly = build_assembly(scene)
    mesh = vertex_mesh(assembly)
    faces = len(assembly.interfaces)
    labels = random.random(faces) < 0.6 if random.random() < 0.6 else np.ones(faces, dtype=bool)
    shift = 0.01 * assembly.size / np.sqrt(len(assembly.elements)) * random.normal(size=mesh.places.shape)
    document = MovedScene(scene, assembly, labels, mesh).document(mesh.places + shift)
    document.pop("search", None)
    weight = float(np.linalg.norm(assembly.elements.weight, axis=1)[assembly.elements.free].sum())
    stress = weight / float(assembly.interfaces.area.mean())
    dry: Document = {"friction_coefficient": float(random.uniform(0.3, 0.9))}
    inner: Document = {"tensile_strength": stress * float(random.uniform(0.05, 0.5))}
    inner["shear_strength"] = stress * float(random.uniform(0.5, 2.0))
    if random.random() < 0.5:
        inner["friction_coefficient"] = 0.3
    if random.random() < 0.5:
        dry["cohesion"] = 0.02 * stress
    if seed % 7 == 0:
        dry["compressive_strength"] = inner["compressive_strength"] = stress * float(random.uniform(3.0, 10.0))
    document["materials"] = {**document["materials"], "dry": dry, "inner": inner}
    element = assembly.elements.ids[int(random.choice(assembly.elements.free))]
    if random.random() < 0.5:
        document["loads"]["live"].append({"element": element, "force": [0.1 * weight, -0.1 * weight]})
    if random.random() < 0.3:
        for entry in document["elements"]:
            if entry["id"] == element:
                entry["weight"] = 0.1 * weight
    return json.loads(json.dumps(document))  # type: ignore[no-any-return]


def _of_plane(seed: int) -> tuple[float, float, float, float]:
    """Return the derivative along a random direction, its difference by two steps, and its scale."""
    scene = parse_scene(drawn(seed))
    assembly = build_assembly(scene)
    result = solve(assembly)
    if result.status is not Status.COLLAPSE:
        return math.nan, math.nan, math.nan, math.nan
    found = geometry_sensitivities(result, one_sided=False)
    assert found is not None
    mesh = vertex_mesh(assembly)
    moved = MovedScene(scene, assembly, assembly.labels, mesh)
    way = np.random.default_rng(seed + 1).normal(size=mesh.places.shape)

    def load_factor(share: float) -> float:
        return solve(build_assembly(moved.at(mesh.places + share * way))).load_factor

    size = float(np.linalg.norm(found.derivative) * np.linalg.norm(way))
    # brackets of scenes that crush are wider, and steps have to be larger for rates to stand out
    step = 3e-4 if np.isfinite(assembly.strengths(ROUTE).crush_dry).any() else 2e-5
    return float((found.derivative * way).sum()), *_differences(load_factor, step * assembly.size), size


def _differences(function: Any, step: float) -> tuple[float, float]:
    """Return fourth-order central differences with a step and with half of it."""

    def difference(by: float) -> float:
        return float((8.0 * (function(by) - function(-by)) - (function(2.0 * by) - function(-2.0 * by))) / (12.0 * by))

    return difference(step), difference(0.5 * step)


def strip(seed: int) -> tuple[Floats, Floats, Document]:
    """Draw the joints (k, 4, 3) of a strip of a vault, directions that keep them plane, and its load."""
    random = np.random.default_rng(seed)
    angles = np.linspace(np.pi, 0.0, 7)
    radii, widths = np.array([0.88, 1.12, 1.12, 0.88]), np.array([0.0, 0.0, 0.4, 0.4])
    joints, ways = np.empty((7, 4, 3)), np.empty((7, 4, 3))
    for k, angle in enumerate(angles):
        along = np.array([np.sin(angle), 0.0, -np.cos(angle)])
        corners = np.column_stack([radii * np.cos(angle), widths, radii * np.sin(angle)])
        plane = np.column_stack([np.ones(4), radii - 1.0, widths - 0.2])
        joints[k] = corners + (plane @ (random.normal(size=3) * [0.02, 0.1, 0.1]))[:, None] * along
        ways[k] = (plane @ (random.normal(size=3) * [0.1, 1.0, 1.0]))[:, None] * along
    live = [{"body": [0.5, 0.4, 0.0]}] if seed % 2 else [{"element": "v1", "force": [0.3, 0.2, -1.0]}]
    return joints, ways, {"live": live}


def strip_scene(joints: Floats, loads: Document, cohesion: float = 0.0) -> Assembly:
    """Build the strip between joints (k, 4, 3) as solids with triangular sides."""
    down = np.array([0.0, 0.0, -0.3])
    sections = [joints[0] + down, *joints, joints[-1] + down]
    names = ["left", *(f"v{k}" for k in range(len(joints) - 1)), "right"]
    sides = [face for i in range(4) for j in [(i + 1) % 4] for face in ([i, j, j + 4], [i, j + 4, i + 4])]
    faces = [[3, 2, 1, 0], [4, 5, 6, 7], *sides]
    elements = []
    for name, first, last in zip(names, sections[:-1], sections[1:], strict=True):
        corners = np.vstack([first, last])
        volume = sum(
            float(corners[f[0]] @ np.cross(corners[a], corners[b])) for f in faces for a, b in itertools.pairwise(f[1:])
        )
        own = faces if volume > 0.0 else [face[::-1] for face in faces]
        support = name in ("left", "right")
        elements.append({"id": name, "vertices": corners.tolist(), "faces": own, "support": support})
    interfaces = [{"elements": [names[k], names[k + 1]], "polygon": joint.tolist()} for k, joint in enumerate(joints)]
    dry = {"friction_coefficient": 0.6, "cohesion": cohesion}
    document = {"elements": elements, "interfaces": interfaces, "loads": loads}
    return build_assembly(parse_scene({**document, "materials": {"density": 2000, "dry": dry}}))


def _of_strip(seed: int) -> tuple[float, float, float, float]:
    """Return the derivative of a strip along plane motions of its joints, its differences, and its scale."""
    joints, ways, loads = strip(seed)
    cohesion = 300.0 if seed % 3 == 0 else 0.0
    result = solve(strip_scene(joints, loads, cohesion))
    if result.status is not Status.COLLAPSE:
        return math.nan, math.nan, math.nan, math.nan
    found = geometry_sensitivities(result)
    assert found is not None
    vertices = cKDTree(found.vertices).query(joints.reshape(-1, 3))[1]
    way = ways.reshape(-1, 3)

    def load_factor(share: float) -> float:
        return solve(strip_scene(joints + share * ways, loads, cohesion)).load_factor

    size = float(np.linalg.norm(found.derivative) * np.linalg.norm(way))
    return float((found.derivative[vertices] * way).sum()), *_differences(load_factor, 1e-3), size
