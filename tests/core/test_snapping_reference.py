"""Snapping of points and solids by arrays against the same rules stated one point, one face and one node at a time."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from jld_core.arrays import Floats, Ints
from jld_core.geometry import area_vector, merge_points, snap_solids
from jld_core.geometry.snapping import _FAR, _FLAT, _RANK

FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
TRIANGLES = tuple(part for a, b, c, d in FACES for part in ((a, b, c), (a, c, d)))


def merged(points: Floats, tolerance: float) -> Ints:
    """Node of each point: each joins the first node within the tolerance, in their order."""
    nodes: list[Floats] = []
    found = []
    for point in points:
        near = [k for k, node in enumerate(nodes) if np.linalg.norm(node - point) <= tolerance]
        found.append(near[0] if near else len(nodes))
        if not near:
            nodes.append(point)
    return np.array(found)


def snapped(vertices: list[Floats], faces: list[tuple[tuple[int, ...], ...]], tolerance: float) -> Floats:
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
        facing = (cosine if solid[a] == solid[b] else abs(cosine)) > _FLAT
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
            step = np.linalg.pinv(normal[planes], rcond=_RANK) @ np.einsum(
                "ij,ij->i", middle[planes] - at, normal[planes]
            )
            moved[k] = at + step if np.linalg.norm(step) <= _FAR * tolerance else at
    return moved[node]


@pytest.mark.parametrize("dimension", [2, 3])
def test_points_merge_as_one_after_the_other(dimension: int) -> None:
    """200 random sets, from sparse to chains of points: the same node of every point."""
    chained = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        points = rng.uniform(0.0, 10.0 ** rng.uniform(-1.0, 1.0), (30, dimension))
        points = np.concatenate([points, points[rng.integers(0, 30, 10)]])
        found = merge_points(points, 0.3)
        np.testing.assert_array_equal(found, merged(points, 0.3))
        chained += int(1 < found.max() < 29)
    assert chained > 20


def test_solids_snap_as_one_face_after_the_other() -> None:
    """200 random piles of turned, shaken boxes, some of triangles: every vertex, to rounding."""
    moved = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        noise = 10.0 ** rng.uniform(-4.0, -1.5)
        ends = [np.cumsum([0.0, *rng.uniform(0.5, 1.5, count)]) for count in (2, 1, 1)]
        vertices, faces = [], []
        for i in range(2):
            corners = np.array(list(itertools.product(ends[0][i : i + 2], ends[1], ends[2])))
            vertices.append(corners @ turn.T + noise * rng.uniform(-1.0, 1.0, (8, 3)))
            faces.append(TRIANGLES if seed % 3 == 0 else FACES)
        found = snap_solids(vertices, faces, 0.01)
        np.testing.assert_allclose(np.concatenate(found.vertices), snapped(vertices, faces, 0.01), atol=1e-12, rtol=0.0)
        moved += found.moved
    assert moved > 500
