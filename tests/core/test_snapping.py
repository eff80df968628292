"""Snapping: what nearly meets meets, nothing moves further than the tolerance, and long edges stay straight."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import shapely

from jld_core import Assembly, InputError, build_assembly, parse_scene, samples, solve
from jld_core.geometry import area_vector, facets_of, merge_points, snapping, solids

Polygon = list[list[float]]


def square(x: float, y: float, w: float = 1.0, h: float = 1.0) -> np.ndarray:
    return np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]])


def gaps_and_overlaps(outlines: list[np.ndarray]) -> tuple[float, float]:
    """Area of the holes in the union, and area covered twice."""
    shapes = [shapely.Polygon(o) for o in outlines]
    union = shapely.union_all(shapes)
    holes = sum(shapely.Polygon(r).area for part in shapely.get_parts(union) for r in part.interiors)
    return holes, sum(s.area for s in shapes) - union.area


def test_noise_on_a_wall_is_taken_out_again() -> None:
    """A wall in flemish bond, every corner up to 1 mm off: all faces are found again, and λ within what 1 mm makes."""
    scene = samples.wall(bond="flemish", courses=6, opening="1.0,0.4,0.6,0.4")
    exact = build_assembly(scene)
    rng = np.random.default_rng(3)
    elements = scene.elements or []
    noisy = [np.array(e.polygon) + rng.uniform(-1e-3, 1e-3, (len(e.polygon or []), 2)) / np.sqrt(2) for e in elements]
    found = snapping.snap_polygons(noisy, 4e-3)
    assert found.collapsed == ()
    assert 0.0 < found.largest <= 8e-3
    document = scene.model_dump(mode="json", exclude_defaults=True)
    for entry, outline in zip(document["elements"], found.paths, strict=True):
        entry["polygon"] = outline.tolist()
    assembly = build_assembly(parse_scene(document))

    def pairs(a: object) -> set[tuple[int, int]]:
        return set(zip(a.interfaces.a.tolist(), a.interfaces.b.tolist(), strict=True))

    assert pairs(assembly) == pairs(exact)
    assert solve(assembly).load_factor == pytest.approx(solve(exact).load_factor, rel=0.05)
    document["elements"] = [e.model_dump(exclude_defaults=True) for e in elements]
    for entry, outline in zip(document["elements"], noisy, strict=True):
        entry["polygon"] = outline.tolist()
    with pytest.raises(InputError):  # unsnapped it is no structure: overlaps, or blocks that touch nothing
        build_assembly(parse_scene(document))


@pytest.mark.parametrize("gap", [0.004, -0.004])
def test_gaps_and_overlaps_close(gap: float) -> None:
    """One stone across two: its corners go onto their long edge, which stays straight."""
    outlines = [square(0.0, 0.0, 3.0), square(0.5, 1.0 + gap), square(1.5 + abs(gap) / 2, 1.0 + gap, 1.2)]
    found = snapping.snap_polygons(outlines, 0.005)
    assert gaps_and_overlaps(found.paths) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert found.largest <= 0.005
    assert np.array_equal(found.paths[0], outlines[0])
    assert len(snapping.snap_polygons(outlines, 0.005, keep_nodes=True).paths[0]) == 7
    still = snapping.snap_polygons(outlines, 0.001)
    assert still.largest == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("gap", [0.0018, -0.0018])
def test_joints_that_cross_close_both_ways(gap: float) -> None:
    """Where four stones meet, corners across are further apart than the tolerance, and meet all the same."""
    outlines = [square(i * (0.3 + gap), j * (0.1 + gap), 0.3, 0.1) for j in range(3) for i in range(3)]
    found = snapping.snap_polygons(outlines, 0.002)
    assert gaps_and_overlaps(found.paths) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert len(np.unique(np.concatenate(found.paths).round(12), axis=0)) == 16
    assert found.largest <= 0.002 * np.sqrt(2.0)


def test_shared_nodes_make_a_coverage() -> None:
    """With nodes kept, neighbours share whole edges, as shapely's coverage functions ask for."""
    scene = samples.wall(bond="english")
    rng = np.random.default_rng(0)
    outlines = [np.array(e.polygon) + rng.uniform(-1e-4, 1e-4, (4, 2)) for e in scene.elements or []]
    assert not shapely.coverage_is_valid([shapely.Polygon(o) for o in outlines])
    kept = snapping.snap_polygons(outlines, 1e-3, keep_nodes=True)
    assert shapely.coverage_is_valid([shapely.Polygon(o) for o in kept.paths])


def test_there_are_no_chains() -> None:
    """Points a little less than the tolerance apart stay apart where their first ones are far apart."""
    points = np.column_stack([np.arange(50) * 0.9, np.zeros(50)])
    node = merge_points(points, 1.0)
    first = points[np.unique(node, return_index=True)[1]]
    assert np.diff(first[:, 0]).min() > 1.0
    assert np.abs(points - first[node]).max() <= 1.0


def test_elements_thinner_than_the_tolerance_are_reported() -> None:
    found = snapping.snap_polygons([square(0, 0), square(3, 0, 1.0, 1e-4)], 1e-3)
    assert found.collapsed == (1,)


def test_nothing_moves_without_a_tolerance() -> None:
    outlines = [square(0, 0), square(1 + 1e-12, 0)]
    found = snapping.snap_polygons(outlines, 0.0)
    assert found.largest == 0.0
    assert all(np.array_equal(a, b) for a, b in zip(found.paths, outlines, strict=True))
    with pytest.raises(InputError, match="tolerance"):
        snapping.snap_paths(outlines, [True, True], float("nan"))


def test_a_million_equal_corners_take_no_square_of_their_number() -> None:
    """Corners that all lie in one box of the tolerance: looked up, not compared each with each."""
    points = np.random.default_rng(0).uniform(0.0, 1e-6, (50_000, 2))
    assert merge_points(points, 1.0).max() == 0


def test_straight_corners_go() -> None:
    ring = np.array([[0.0, 0.0], [0.3, 0.0], [1.0, 0.0], [1.0, 1.0], [0.4, 1.0 + 1e-3], [0.0, 1.0]])
    assert snapping.straight(ring).tolist() == ring[[0, 2, 3, 4, 5]].tolist()


def cube(x: float, y: float, z: float) -> tuple[np.ndarray, tuple[tuple[int, ...], ...]]:
    corners = np.array([[x + i, y + j, z + k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)
    triangles = []
    for a, b, c, d in ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)):
        triangles += [(a, b, c), (a, c, d)]
    return corners, tuple(triangles)


def test_faces_of_solids_come_to_lie_in_planes() -> None:
    """Three noisy triangulated cubes, one upon two: their sides are plane again, and their contacts too."""
    rng = np.random.default_rng(1)
    solid = [cube(0, 0, 0), cube(1, 0, 0), cube(0.5, 0, 1)]
    noisy = [v + rng.uniform(-1e-3, 1e-3, v.shape) for v, _ in solid]
    faces = [f for _, f in solid]
    assert len(facets_of(*solids(["a", "b", "c"], noisy, list(faces))[:2])) > 3 * 6
    found = snapping.snap_solids(noisy, faces, 4e-3)
    assert 0.0 < found.largest < 1e-2
    vertices, mended, volume, _ = solids(["a", "b", "c"], found.vertices, list(faces))
    assert len(facets_of(vertices, mended)) == 3 * 6
    assert volume == pytest.approx([1.0] * 3, rel=0.02)


def test_snapping_closes_a_gap_between_solids() -> None:
    """Two cubes 2 mm apart and their corners elsewhere: without snapping they do not touch."""
    lower, upper = cube(0, 0, 0), cube(0.3, 0.2, 1.002)
    found = snapping.snap_solids([lower[0], upper[0]], [lower[1], upper[1]], 0.003)
    assert found.vertices[1][:4, 2] == pytest.approx([1.0] * 4, abs=0.0021)
    assert found.vertices[1][:4, 2].min() == pytest.approx(found.vertices[0][4:, 2].max(), abs=1e-12)


# Snapping of points and solids by arrays against the same rules stated one point, one face and one node at a time.


FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
TRIANGLES = tuple(part for a, b, c, d in FACES for part in ((a, b, c), (a, c, d)))


def merged(points: np.ndarray, tolerance: float) -> np.ndarray:
    """Node of each point: each joins the first node within the tolerance, in their order."""
    nodes: list[np.ndarray] = []
    found = []
    for point in points:
        near = [k for k, node in enumerate(nodes) if np.linalg.norm(node - point) <= tolerance]
        found.append(near[0] if near else len(nodes))
        if not near:
            nodes.append(point)
    return np.array(found)


def snapped(vertices: list[np.ndarray], faces: list[tuple[tuple[int, ...], ...]], tolerance: float) -> np.ndarray:
    """All vertices after snapping: planes grow from the largest face, node after node moves onto its planes."""
    points = np.concatenate(vertices)
    node = merged(points, tolerance)
    place = points[np.unique(node, return_index=True)[1]]
    start = np.cumsum([0, *map(len, vertices)])
    loops = [node[start[solid] + np.array(loop)] for solid, own in enumerate(faces) for loop in own]
    solid = np.repeat(np.arange(len(faces)), [len(own) for own in faces])
    vector = np.array([area_vector(place[loop]) for loop in loops])
    area = np.linalg.norm(vector, axis=1)
    normal = vector / area[:, None]
    middle = np.array([place[loop].mean(axis=0) for loop in loops])
    low = np.array([place[loop].min(axis=0) for loop in loops]) - tolerance
    high = np.array([place[loop].max(axis=0) for loop in loops]) + tolerance

    def level(face: int, plane: int) -> bool:
        return bool(np.abs((place[loops[face]] - middle[plane]) @ normal[plane]).max() <= tolerance)

    def joined(a: int, b: int) -> bool:
        large, small = (a, b) if area[a] >= area[b] else (b, a)
        cosine = normal[a] @ normal[b]
        facing = (cosine if solid[a] == solid[b] else abs(cosine)) > snapping._FLAT
        return bool(facing and np.all((low[a] <= high[b]) & (low[b] <= high[a]))) and (
            level(large, large) and level(small, large)
        )

    near: dict[int, list[int]] = {k: [] for k in range(len(loops))}
    for a, b in itertools.combinations(range(len(loops)), 2):
        if joined(a, b):
            near[a].append(b)
            near[b].append(a)
    plane = [-1] * len(loops)
    for seed in np.argsort(-area, kind="stable").tolist():
        pending = [seed] if plane[seed] < 0 else []
        plane[seed] = seed if pending else plane[seed]
        while pending:
            for other in near[pending.pop()]:
                if plane[other] < 0 and level(other, seed):
                    plane[other] = seed
                    pending.append(other)
    moved = place.copy()
    for k, at in enumerate(place):
        planes = sorted({plane[f] for f, loop in enumerate(loops) if k in loop and level(f, f)})
        if planes:
            step = np.linalg.pinv(normal[planes], rcond=snapping._RANK) @ np.einsum(
                "ij,ij->i", middle[planes] - at, normal[planes]
            )
            moved[k] = at + step if np.linalg.norm(step) <= snapping._FAR * tolerance else at
    return moved[node]


DRAWN = pytest.mark.parametrize("seeds", [range(50), pytest.param(range(50, 200), marks=pytest.mark.long)])


@DRAWN
@pytest.mark.parametrize("dimension", [2, 3])
def test_points_merge_as_one_after_the_other(dimension: int, seeds: range) -> None:
    """Random sets, from sparse to chains of points: the same node of every point."""
    chained = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        points = rng.uniform(0.0, 10.0 ** rng.uniform(-1.0, 1.0), (30, dimension))
        points = np.concatenate([points, points[rng.integers(0, 30, 10)]])
        found = merge_points(points, 0.3)
        np.testing.assert_array_equal(found, merged(points, 0.3))
        chained += int(1 < found.max() < 29)
    assert chained > len(seeds) // 10


@DRAWN
def test_solids_snap_as_one_face_after_the_other(seeds: range) -> None:
    """Random piles of turned, shaken boxes, some of triangles: every vertex, to rounding."""
    moved = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        noise = 10.0 ** rng.uniform(-4.0, -1.5)
        ends = [np.cumsum([0.0, *rng.uniform(0.5, 1.5, count)]) for count in (2, 1, 1)]
        vertices, faces = [], []
        for i in range(2):
            corners = np.array(list(itertools.product(ends[0][i : i + 2], ends[1], ends[2])))
            vertices.append(corners @ turn.T + noise * rng.uniform(-1.0, 1.0, (8, 3)))
            faces.append(TRIANGLES if seed % 3 == 0 else FACES)
        found = snapping.snap_solids(vertices, faces, 0.01)
        np.testing.assert_allclose(np.concatenate(found.vertices), snapped(vertices, faces, 0.01), atol=1e-12, rtol=0.0)
        moved += found.moved
    assert moved > 2.5 * len(seeds)


# Drawings that are nearly right: gaps and overlaps within the tolerance are closed, what is outside is named.


BRICK = (0.2, 0.06)


def wall(courses: int = 6, length: int = 4, joint: float = 0.0) -> dict[str, Any]:
    """A running bond pushed along, its bricks shrunk by half a joint on every side; the slab keeps its top edge."""
    wide, high = BRICK
    half = 0.5 * joint
    slab = [[0, -high], [length * wide, -high], [length * wide, -half], [0, -half]]
    elements: list[dict[str, Any]] = [{"id": "slab", "polygon": slab, "support": True}]
    for course in range(courses):
        whole = np.arange(length + 1) * wide
        ends = whole if course % 2 == 0 else np.concatenate([[0.0], whole[:-1] + 0.5 * wide, whole[-1:]])
        low, top = course * high + half, (course + 1) * high - half
        for k, (a, b) in enumerate(zip(ends[:-1] + half, ends[1:] - half, strict=True)):
            elements.append({"id": f"c{course}b{k}", "polygon": [[a, low], [b, low], [b, top], [a, top]]})
    return {
        "elements": elements,
        "thickness": 0.1,
        "materials": {"density": 1800, "dry": {"friction_coefficient": 0.65}},
        "labels": {"default": "dry"},
        "loads": {"live": [{"body": [1, 0]}]},
    }


def shaken(document: dict[str, Any], error: float, seed: int) -> dict[str, Any]:
    """The same with every coordinate off by up to an error, each brick on its own, as drawn by hand."""
    rng = np.random.default_rng(seed)
    moved = [
        {**element, "polygon": (np.array(element["polygon"]) + rng.uniform(-error, error, (4, 2))).tolist()}
        for element in document["elements"]
    ]
    return {**document, "elements": moved}


def pairs(assembly: Assembly) -> set[tuple[str, str]]:
    ids, faces = assembly.elements.ids, assembly.interfaces
    return {(ids[a], ids[b]) for a, b in zip(faces.a, faces.b, strict=True)}


@pytest.fixture(scope="module")
def ideal() -> tuple[set[tuple[str, str]], float]:
    assembly = build_assembly(parse_scene(wall()))
    assert assembly.moved == 0.0
    assert assembly.warnings == ()
    return pairs(assembly), solve(assembly).load_factor


@pytest.mark.parametrize("error", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("seed", range(4))
def test_a_shaken_drawing_is_the_wall(error: float, seed: int, ideal: tuple[set[tuple[str, str]], float]) -> None:
    """Errors of 0.01, 0.1 and 1 mm on bricks of 200 × 60 mm; λ to the order of the error, error / 60 mm."""
    assembly = build_assembly(parse_scene({**shaken(wall(), error, seed), "tolerance": 3.5 * error}))
    assert pairs(assembly) == ideal[0]
    assert len(assembly.interfaces) == len(ideal[0])
    assert 0.0 < assembly.moved <= 3.5 * error * 1.5
    assert solve(assembly).load_factor == pytest.approx(ideal[1], rel=3.0 * error / BRICK[1])


def test_uniform_joints_close(ideal: tuple[set[tuple[str, str]], float]) -> None:
    """Joints of 1 mm left open, as bricks are drawn."""
    assembly = build_assembly(parse_scene({**wall(joint=1e-3), "tolerance": 2e-3}))
    assert pairs(assembly) == ideal[0]
    assert solve(assembly).load_factor == pytest.approx(ideal[1], rel=3e-3 / BRICK[1])


def test_a_head_joint_opened_by_a_micrometre_is_closed(ideal: tuple[set[tuple[str, str]], float]) -> None:
    """The default is 1e-4 of the shortest edge, 6 µm here."""
    assembly = build_assembly(parse_scene(wall(joint=1e-6)))
    assert pairs(assembly) == ideal[0]
    assert solve(assembly).load_factor == pytest.approx(ideal[1], rel=1e-4)


def test_elements_that_nearly_touch_are_a_warning() -> None:
    document = wall()
    for element in document["elements"]:
        if element["id"] == "c0b1":  # a head joint of 0.1 mm, open beyond the default
            element["polygon"][0][0] += 1e-4
            element["polygon"][3][0] += 1e-4
    assembly = build_assembly(parse_scene(document))
    assert "not joined: 'c0b0' and 'c0b1' are 0.0001 m apart at (0.20005, 0.03)" in assembly.warnings[0]
    assert build_assembly(parse_scene({**document, "tolerance": 2e-4})).warnings == ()


def test_all_overlaps_are_named_with_depth_and_place() -> None:
    document = wall(joint=-2e-3)
    with pytest.raises(InputError) as caught:
        build_assembly(parse_scene(document))
    text = str(caught.value)
    assert text.startswith("elements 'slab' and 'c0b0': they overlap by 0.002 at (")
    assert text.count(" by 0.002 at (") == 10
    assert "more pairs" in text
    build_assembly(parse_scene({**document, "tolerance": 4e-3}))


def test_hanging_nodes_doubled_vertices_and_outlines_that_touch_themselves() -> None:
    plain = build_assembly(parse_scene(wall()))
    document = wall()
    for element in document["elements"]:
        (x0, y0), (x1, _), (_, y1), _ = element["polygon"]
        middle = 0.5 * (x0 + x1)
        # doubled corner, a corner in a straight edge off by 1e-7, a spike of 1e-7 there and back
        element["polygon"] = [[x0, y0], [x0 + 1e-9, y0], [middle, y0 + 1e-7], [x1, y0], [x1, y1], [x1 + 1e-7, y1]]
        element["polygon"] += [[x1, y1], [x0, y1]]
    assembly = build_assembly(parse_scene({**document, "tolerance": 1e-5}))
    assert pairs(assembly) == pairs(plain)
    assert solve(assembly).load_factor == pytest.approx(solve(plain).load_factor, rel=1e-4)


def test_spatial_gaps_close() -> None:
    def cubes(gap: float) -> dict[str, Any]:
        faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]

        def box(low: float, high: float) -> list[list[float]]:
            return [[x, y, z] for z in (low, high) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]

        return {
            "elements": [
                {"id": "base", "vertices": box(-1, 0), "faces": faces, "support": True},
                {"id": "one", "vertices": box(gap, 1 + gap), "faces": faces},
                {"id": "two", "vertices": box(1 + 2 * gap, 2 + 2 * gap), "faces": faces},
            ],
            "materials": {"density": 2000, "dry": {"friction_coefficient": 0.65}},
            "labels": {"default": "dry"},
            "loads": {"live": [{"body": [1, 0, 0]}]},
        }

    assembly = build_assembly(parse_scene({**cubes(1e-3), "tolerance": 2e-3}))
    assert len(assembly.interfaces) == 2
    assert 0.0 < assembly.moved <= 2e-3
    assert solve(assembly).load_factor == pytest.approx(0.5, rel=2e-3)  # two cubes rock at b / (2 h)
    with pytest.raises(InputError, match="no path of interfaces"):
        build_assembly(parse_scene(cubes(1e-3)))
    with pytest.raises(InputError, match=r"they overlap by 0.001 at \(0\.\d+, 0\.\d+, -0.0005\); so do"):
        build_assembly(parse_scene({**cubes(-1e-3), "tolerance": 0}))


@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_the_default_is_relative(scale: float) -> None:
    """The same drawing in metres and millimetres."""
    document = shaken(wall(), 1e-6, 0)
    for element in document["elements"]:
        element["polygon"] = (scale * np.array(element["polygon"])).tolist()
    assembly = build_assembly(parse_scene({**document, "units": {"length": "mm", "force": "N"}}))
    assert len(assembly.interfaces) == len(pairs(build_assembly(parse_scene(wall()))))
