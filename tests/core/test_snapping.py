"""Snapping: what nearly meets meets, nothing moves further than the tolerance, and long edges stay straight."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from jld_core import InputError, build_assembly, parse_scene, samples, solve
from jld_core.geometry import facets_of, merge_points, snap_solids, solids
from jld_core.geometry.snapping import snap_paths, snap_polygons, straight

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
    found = snap_polygons(noisy, 4e-3)
    assert found.collapsed == ()
    assert 0.0 < found.largest <= 8e-3
    document = scene.model_dump(mode="json", exclude_defaults=True)
    for entry, outline in zip(document["elements"], found.paths, strict=True):
        entry["polygon"] = outline.tolist()
    assembly = build_assembly(parse_scene(document))

    def pairs(a: object) -> set[tuple[int, int]]:
        return set(zip(a.interfaces.a.tolist(), a.interfaces.b.tolist(), strict=True))  # type: ignore[attr-defined]

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
    found = snap_polygons(outlines, 0.005)
    assert gaps_and_overlaps(found.paths) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert found.largest <= 0.005
    assert np.array_equal(found.paths[0], outlines[0])
    assert len(snap_polygons(outlines, 0.005, keep_nodes=True).paths[0]) == 7
    still = snap_polygons(outlines, 0.001)
    assert still.largest == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("gap", [0.0018, -0.0018])
def test_joints_that_cross_close_both_ways(gap: float) -> None:
    """Where four stones meet, corners across are further apart than the tolerance, and meet all the same."""
    outlines = [square(i * (0.3 + gap), j * (0.1 + gap), 0.3, 0.1) for j in range(3) for i in range(3)]
    found = snap_polygons(outlines, 0.002)
    assert gaps_and_overlaps(found.paths) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert len(np.unique(np.concatenate(found.paths).round(12), axis=0)) == 16
    assert found.largest <= 0.002 * np.sqrt(2.0)


def test_shared_nodes_make_a_coverage() -> None:
    """With nodes kept, neighbours share whole edges, as shapely's coverage functions ask for."""
    scene = samples.wall(bond="english")
    rng = np.random.default_rng(0)
    outlines = [np.array(e.polygon) + rng.uniform(-1e-4, 1e-4, (4, 2)) for e in scene.elements or []]
    assert not shapely.coverage_is_valid([shapely.Polygon(o) for o in outlines])
    kept = snap_polygons(outlines, 1e-3, keep_nodes=True)
    assert shapely.coverage_is_valid([shapely.Polygon(o) for o in kept.paths])


def test_there_are_no_chains() -> None:
    """Points a little less than the tolerance apart stay apart where their first ones are far apart."""
    points = np.column_stack([np.arange(50) * 0.9, np.zeros(50)])
    node = merge_points(points, 1.0)
    first = points[np.unique(node, return_index=True)[1]]
    assert np.diff(first[:, 0]).min() > 1.0
    assert np.abs(points - first[node]).max() <= 1.0


def test_elements_thinner_than_the_tolerance_are_reported() -> None:
    found = snap_polygons([square(0, 0), square(3, 0, 1.0, 1e-4)], 1e-3)
    assert found.collapsed == (1,)


def test_nothing_moves_without_a_tolerance() -> None:
    outlines = [square(0, 0), square(1 + 1e-12, 0)]
    found = snap_polygons(outlines, 0.0)
    assert found.largest == 0.0
    assert all(np.array_equal(a, b) for a, b in zip(found.paths, outlines, strict=True))
    with pytest.raises(InputError, match="tolerance"):
        snap_paths(outlines, [True, True], float("nan"))


def test_a_million_equal_corners_take_no_square_of_their_number() -> None:
    """Corners that all lie in one box of the tolerance: looked up, not compared each with each."""
    points = np.random.default_rng(0).uniform(0.0, 1e-6, (50_000, 2))
    assert merge_points(points, 1.0).max() == 0


def test_straight_corners_go() -> None:
    ring = np.array([[0.0, 0.0], [0.3, 0.0], [1.0, 0.0], [1.0, 1.0], [0.4, 1.0 + 1e-3], [0.0, 1.0]])
    assert straight(ring).tolist() == ring[[0, 2, 3, 4, 5]].tolist()


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
    found = snap_solids(noisy, faces, 4e-3)
    assert 0.0 < found.largest < 1e-2
    vertices, mended, volume, _ = solids(["a", "b", "c"], found.vertices, list(faces))
    assert len(facets_of(vertices, mended)) == 3 * 6
    assert volume == pytest.approx([1.0] * 3, rel=0.02)


def test_snapping_closes_a_gap_between_solids() -> None:
    """Two cubes 2 mm apart and their corners elsewhere: without snapping they do not touch."""
    lower, upper = cube(0, 0, 0), cube(0.3, 0.2, 1.002)
    found = snap_solids([lower[0], upper[0]], [lower[1], upper[1]], 0.003)
    assert found.vertices[1][:4, 2] == pytest.approx([1.0] * 4, abs=0.0021)
    assert found.vertices[1][:4, 2].min() == pytest.approx(found.vertices[0][4:, 2].max(), abs=1e-12)
