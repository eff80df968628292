"""Shapes of blocks: what is congruent, what is convex, and that every driver keeps limits on them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import box, grid_document, scene_in_space
from jld_core import blocks_of, build_assembly, parse_scene
from jld_core.geometry import outlines
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.space import count_named, values_of


def shapes_for(document: dict[str, Any], **moulds: bool) -> tuple[Any, Any]:
    """The structure of a scene, and what counts the shapes of its blocks with these moulds."""
    scene = parse_scene({**document, "search": {"moulds": moulds}})
    assembly = build_assembly(scene)
    return assembly, search_space(scene, assembly, allow_empty=True, need_materials=False).limits.block_shapes


def shapes_of(rows: list[str], **moulds: bool) -> int:
    assembly, shapes = shapes_for(grid_document(rows), **moulds)
    return int(values_of(count_named("shapes"), assembly, assembly.labels[None], shapes=shapes)[0])


def test_shapes_that_are_alike() -> None:
    dominoes = ["aab", "ccb", "###"]
    assert shapes_of(dominoes) == 2  # two lying, one standing
    assert shapes_of(dominoes, rotate=True) == 1
    # an L and the same turned by a half; a longer one and its mirror
    assert shapes_of(["abb", "aab", "###"]) == 2
    assert shapes_of(["abb", "aab", "###"], rotate=True) == 1
    handed = ["aaabbb", "a....b", "######"]
    assert shapes_of(handed) == 2
    assert shapes_of(handed, rotate=True) == 2
    assert shapes_of(handed, flip=True) == 1


def test_blocks_cut_otherwise_have_one_shape() -> None:
    """A block of two cells and one of the same outline that was drawn whole."""
    material = {"density": 2000, "dry": {"friction_coefficient": 0.6}}
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    elements = [
        {"id": "g", "polygon": [[0, -1], [6, -1], [6, 0], [0, 0]], "support": True},
        {"id": "a1", "polygon": square, "block": "a"},
        {"id": "a2", "polygon": [[x + 1, y] for x, y in square], "block": "a"},
        {"id": "b", "polygon": [[3, 0], [5, 0], [5, 1], [3, 1]]},
    ]
    inner = {"tensile_strength": 1e5, "shear_strength": 1e5}
    scene = {"elements": elements, "materials": {**material, "inner": inner}, "loads": {"live": [{"body": [1, 0]}]}}
    assembly = build_assembly(parse_scene(scene))
    assert values_of(count_named("shapes"), assembly, assembly.labels[None]).tolist() == [1]


@pytest.mark.parametrize(
    "rows",
    [
        ["aab", "cab", "ccb", "###"],
        ["aaa", "aba", "aaa", "###"],  # around a hole
        ["aab", "aba", "aaa", "###"],  # touching itself in a corner
        ["aabb", "abbc", "###."],
    ],
)
def test_outlines_by_shared_edges_are_those_of_any_union(rows: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Polygons that share whole edges against shapely's union of them; half a brick aside, edges are shared in part."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    for step in (0.0, 0.4):
        cells = [
            np.array([x + step * (row % 2), y]) + square
            for row, line in enumerate(rows)
            for x, y, name in ((k, -row, name) for k, name in enumerate(line))
            if name == "a"
        ]
        quick = outlines.flat_outline(cells, 1e-6)
        with monkeypatch.context() as patch:
            patch.setattr(outlines, "_whole", lambda *_: None)
            slow = outlines.flat_outline(cells, 1e-6)
        assert (quick.count, quick.reentrant) == (slow.count, slow.reentrant)
        assert [quick.size, quick.aspect] == pytest.approx([slow.size, slow.aspect], rel=1e-9)
        each = [sorted(map(tuple, (np.round(one.points, 6) + 0.0).tolist())) for one in (quick, slow)]
        assert each[0] == each[1]


def test_kinds_of_any_size_are_found_however_corners_are_off() -> None:
    """Squares of sizes that lie on either side of every limit by which kinds are looked up."""
    reach = 1e-3
    rng = np.random.default_rng(3)
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for size in 1.0 + reach * np.linspace(0.0, 4.0, 33):
        kinds = outlines.Kinds(reach)
        for _ in range(4):
            off = reach * rng.uniform(-1.0, 1.0, (8, 2))
            corners = np.concatenate([square, 0.5 * (square + np.roll(square, -1, axis=0))])
            kinds.number(outlines.Outline(size * corners + 0.7 * off, 4, 4.0 * size**2, 1.0, 0))
        other = kinds.number(outlines.Outline((size + 8.0 * reach) * corners, 4, 4.0 * size**2, 1.0, 0))
        assert len(set(kinds.roots(range(other)))) == 1
        assert kinds.roots([other]) == [other]


CHAINS: dict[str, tuple[list[float], list[str], Any, int]] = {
    # widths of stones beyond 1 m in units of what is tolerated, whether moulds may turn, tolerance of the scene, shapes
    "chain": ([0.0, 0.8, 1.6], [], 0, 1),
    "two chains": ([0.0, 0.8, 1.6, 40.0, 40.7], [], 0, 2),
    "far apart": ([0.0, 20.0, 40.0], [], 0, 3),
    "chain that turns": ([0.0, 0.8, 1.6], ["rotate"], 0, 1),
    "long chain": ([0.0, 0.9, 1.8, 2.7], ["rotate", "flip"], 0, 1),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", CHAINS)
def test_shapes_do_not_depend_on_order_or_place(name: str) -> None:
    """Stones whose widths differ by less than the tolerance from the next one, in random orders, moved and turned."""
    steps, moulds, tolerance, count = CHAINS[name]
    rng = np.random.default_rng(5)
    unit = 8e-6 * np.hypot(0.5 * (2.0 + 1.5 * len(steps)), 1.0)
    for trial in range(12):
        order = rng.permutation(len(steps)).tolist() if trial else list(range(len(steps)))
        angle, shift = (rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-3.0, 3.0, 2)) if trial % 2 else (0.0, np.zeros(2))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        edge, outlines_of = 0.0, {}
        for k, step in enumerate(steps):
            width = 1.0 + unit * step
            outlines_of[f"p{k}"] = np.array([[edge, 0.0], [edge + width, 0.0], [edge + width, 1.0], [edge, 1.0]])
            edge += width + 0.5
        ground = np.array([[-1.0, -1.0], [edge + 1.0, -1.0], [edge + 1.0, 0.0], [-1.0, 0.0]])
        elements = [{"id": f"p{k}", "polygon": (outlines_of[f"p{k}"] @ turn.T + shift).tolist()} for k in order]
        elements.append({"id": "s", "support": True, "polygon": (ground @ turn.T + shift).tolist()})
        scene = {
            "elements": elements,
            "tolerance": tolerance,
            "materials": {
                "density": 1.0,
                "gravity": (turn @ [0.0, -9.81]).tolist(),
                "dry": {"friction_coefficient": 0.5},
            },
            "loads": {"live": [{"body": [1, 0]}]},
        }
        assembly, shapes = shapes_for(scene, **dict.fromkeys(moulds, True))
        blocks = blocks_of(assembly, assembly.labels)[None]
        # a layout that lacks the stone in the middle is counted by the same shapes
        free = assembly.elements.free
        ends = [[int(k)] for k in free if assembly.elements.ids[k] in ("p0", f"p{len(steps) - 1}")]
        assert len(np.unique(shapes.kinds(ends))) == (1 if count == 1 else 2)
        assert shapes.different(*shapes.counted(blocks)).tolist() == [count], (order, angle)


def test_solids() -> None:
    """A brick lying along x, one along y, and one of two halves; an L of three cubes is not convex."""
    parts = [
        box("g", (0, 0, -1), (9, 9, 0), support=True),
        box("x", (0, 0, 0), (2, 1, 1)),
        box("y", (3, 0, 0), (4, 2, 1)),
        box("h1", (5, 0, 0), (6, 1, 1), block="h"),
        box("h2", (6, 0, 0), (7, 1, 1), block="h"),
        box("l1", (0, 4, 0), (1, 5, 1), block="l"),
        box("l2", (1, 4, 0), (2, 5, 1), block="l"),
        box("l3", (0, 5, 0), (1, 6, 1), block="l"),
    ]
    assembly, _ = shapes_for(document := scene_in_space(parts))
    labels = assembly.labels.copy()
    ids = np.array(assembly.elements.ids)
    for pair in (("h1", "h2"), ("l1", "l2"), ("l1", "l3")):
        both = [
            set(names) == set(pair)
            for names in zip(ids[assembly.interfaces.a], ids[assembly.interfaces.b], strict=True)
        ]
        labels[both] = False
    for rotate, number in ((False, 3), (True, 2)):
        assembly, turned = shapes_for(document, rotate=rotate)
        assert values_of(count_named("shapes"), assembly, labels[None], shapes=turned).tolist() == [number]
    brick, bent = turned.one(np.array([1])), turned.one(np.array([5, 6, 7]))
    assert brick.aspect == pytest.approx(2.0)
    assert (brick.reentrant, bent.reentrant) == (0, 1)


LIMITS: dict[str, dict[str, Any]] = {
    "convex": {"convex_blocks": True, "block_cells": [1, 3]},
    "one corner": {"convex_blocks": 1},
    "slender": {"block_aspect": [None, 2.0], "block_cells": [1, 4]},
    "shapes": {"shapes": [1, 2], "block_cells": [1, 3]},
    "moulds": {"shapes": [1, 1], "moulds": {"rotate": True, "flip": True}, "block_cells": [1, 3]},
    "mass": {"block_mass": [None, 70.0]},
    "except": {"block_cells": [2, 2], "convex_blocks": True, "except": ["c0r0"]},
}


def brute(name: str) -> Iterator[bytes]:
    """All segmentations, by the definitions: cells on a lattice, shapes by their cells."""
    rows = ["aaa", "aaa", "###"]
    scene = parse_scene(_document(rows, LIMITS[name]))
    assembly = build_assembly(scene)
    free = np.flatnonzero(assembly.free_faces)
    faces = assembly.interfaces
    place = {e: (round(c[0] / 0.4 - 0.5), round(c[1] / 0.2 - 0.5)) for e, c in enumerate(assembly.elements.centroid)}
    mass = 2000 * 0.4 * 0.2 * 0.2
    for number in range(2 ** len(free)):
        labels = np.ones(len(assembly.interfaces), dtype=bool)
        labels[free] = [bool(number >> k & 1) for k in range(len(free))]
        names = blocks_of(assembly, labels)
        if np.any(labels[free] & (names[faces.a[free]] == names[faces.b[free]])):
            continue
        groups = [
            [place[e] for e in np.flatnonzero(names == n) if not assembly.elements.support[e]]
            for n in np.unique(names[assembly.elements.free])
        ]
        corner = (0, round(assembly.elements.centroid[0][1] / 0.2 - 0.5))
        if name == "except":
            groups = [group for group in groups if corner not in group]
        if _good(name, groups, mass):
            yield np.packbits(labels).tobytes()


def _document(rows: list[str], search: dict[str, Any]) -> dict[str, Any]:
    document: dict[str, Any] = grid_document(rows)
    document["grid"]["cell"], document["grid"]["thickness"] = [0.4, 0.2], 0.2
    document["materials"]["density"] = 2000
    return {**document, "search": {**search, "symmetry": "none"}}


def _good(name: str, groups: list[list[tuple[int, int]]], mass: float) -> bool:
    most = LIMITS[name].get("block_cells", [1, 99])[1]
    if any(len(group) > most for group in groups):
        return False
    if name == "except":
        return all(len(group) == most for group in groups)
    sizes = [(np.ptp([x for x, _ in g]) + 1, np.ptp([y for _, y in g]) + 1) for g in groups]
    filled = [w * h == len(g) for (w, h), g in zip(sizes, groups, strict=True)]
    if name == "convex":
        return all(filled)
    if name == "one corner":
        return all(_inward(g) <= 1 for g in groups)
    if name == "slender":
        return all(max(2 * w / h, h / (2 * w)) <= 2.0 for w, h in sizes)
    if name == "mass":
        return all(len(g) * mass <= 70.0 for g in groups)
    flips = [(1, 1), (-1, 1), (1, -1), (-1, -1)] if name == "moulds" else [(1, 1)]
    kinds = {min(_normal([(sx * x, sy * y) for x, y in g]) for sx, sy in flips) for g in groups}
    low, high = LIMITS[name]["shapes"]
    return bool(low <= len(kinds) <= high)


def _normal(cells: list[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    x0, y0 = min(x for x, _ in cells), min(y for _, y in cells)
    return tuple(sorted((x - x0, y - y0) for x, y in cells))


def _inward(cells: list[tuple[int, int]]) -> int:
    """Corners of a set of cells with three of the four cells around them filled."""
    there = set(cells)
    corners = {(x + i, y + j) for x, y in cells for i in (0, 1) for j in (0, 1)}
    return sum(sum((x - i, y - j) in there for i in (0, 1) for j in (0, 1)) == 3 for x, y in corners)


@pytest.mark.sampled(5)
@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("name", LIMITS)
def test_enumeration_and_the_exact_driver_keep_the_limits(name: str, tmp_path: Path) -> None:
    scene = parse_scene(_document(["aaa", "aaa", "###"], LIMITS[name]))
    every = explore(scene, tmp_path / "every", ExploreSettings(pictures=False, driver="enumeration"))
    wanted = sorted(brute(name))
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    assert len(every.results) == len(wanted) > 0
    found = explore(scene, tmp_path / "exact", ExploreSettings(pictures=False, driver="exact"))
    assert found.summary.proven
    assert found.summary.best == pytest.approx(every.summary.best, rel=1e-6)
    for driver in ("genetic", "random", "anneal", "portfolio"):
        some = explore(scene, tmp_path / driver, ExploreSettings(pictures=False, driver=driver, budget=15))
        labellings = some.results["labelling"].tolist()
        assert set(labellings) <= set(every.results["labelling"])
        assert len(labellings)
    assert space.limits.given
    assert every.results["shapes"].between(1, 6).all()
    assert np.allclose(every.results["largest_block_mass"], 32.0 * every.results["largest_block_cells"])


def test_lines_alike_in_a_chain_are_one_line() -> None:
    """Neighbours are equal within the tolerance, the ends are not; a line has no sense."""
    angles = np.array([0.0, 2.4e-6, 1.2e-6, np.pi, 0.5 * np.pi])
    assert outlines.different_lines(np.column_stack([np.cos(angles), np.sin(angles)])) == 2
