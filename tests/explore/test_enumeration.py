"""Enumeration against brute force over all 2^m labellings, and against known numbers."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases import grid_document
from jld_core import InputError, build_assembly, load_scene, parse_scene
from jld_explore import SearchSpace, search_space
from jld_explore.drivers.enumeration import Enumeration, Tally, size_up_to
from jld_explore.evaluation.protocol import FAILED
from jld_explore.space import feasible, to_string
from jld_explore.space.labelling import canonical

ROOT = Path(__file__).parents[2]
DOWN = [{"body": [0, -1]}]
CELL = 1400 * 9.81 * 0.1**3


def space_of(document: dict[str, Any], **options: Any) -> SearchSpace:
    scene = parse_scene(document)
    return search_space(scene, build_assembly(scene), **options)


def grid_space(rows: list[str], live: Any = None, **search: Any) -> SearchSpace:
    return space_of(grid_document(rows, live=live, **search), allow_empty=True)


def in_space(space: SearchSpace, labels: tuple[bool, ...]) -> bool:
    """The rules of docs/scene.md, one labelling at a time, in plain Python."""
    assembly, search = space.assembly, space.search
    elements, faces = assembly.elements, assembly.interfaces
    name = list(range(len(elements)))

    def root(i: int) -> int:
        while name[i] != i:
            i = name[i]
        return i

    links = [(a, b) for a, b, dry in zip(faces.a.tolist(), faces.b.tolist(), labels, strict=True) if not dry]
    for a, b in links + [tuple(pair) for pair in space.graph.touching.tolist()]:
        name[root(a)] = root(b)
    if search.segmentation and any(
        dry and root(a) == root(b) for a, b, dry in zip(faces.a.tolist(), faces.b.tolist(), labels, strict=True)
    ):
        return False
    members: dict[int, list[int]] = {}
    for element in elements.free.tolist():
        members.setdefault(root(element), []).append(element)

    def ok(value: float, bounds: Any) -> bool:
        low, high = bounds
        return (low is None or value >= low - 1e-9 * abs(low)) and (high is None or value <= high + 1e-9 * abs(high))

    for block in members.values():
        corners = np.vstack([elements.shape[i] for i in block])
        weight = sum(float(np.linalg.norm(elements.weight[i])) for i in block)
        extent = float(np.ptp(corners, axis=0).max())
        if not (ok(len(block), search.block_cells) and ok(weight, search.block_weight)):
            return False
        if not ok(extent, search.block_extent):
            return False
    dry = sum(d and f for d, f in zip(labels, assembly.free_faces.tolist(), strict=True))
    return ok(len(members), search.blocks) and ok(dry, search.dry_faces)


def brute_force(space: SearchSpace) -> list[str]:
    choices = [(False, True) if c else (bool(f),) for c, f in zip(space.candidates, space.fixed, strict=True)]
    return sorted(to_string(np.array(row)) for row in itertools.product(*choices) if in_space(space, row))


def everything(space: SearchSpace, rows: int | None = None) -> tuple[np.ndarray, list[int]]:
    parts = list(Enumeration(space, rows=rows).batches())
    labellings = [labels for labels, _ in parts] or [np.empty((0, len(space.fixed)), dtype=bool)]
    return np.concatenate(labellings), [n for _, multiplicity in parts for n in multiplicity.tolist()]


def check(space: SearchSpace) -> int:
    """Enumeration and brute force agree on labellings, classes and multiplicities; how many there are."""
    expected = brute_force(space)
    found, multiplicity = everything(space)
    assert feasible(space, found).all()
    assert np.array_equal(canonical(found, space.group), found)
    images = [sorted({to_string(row[g]) for g in space.group}) for row in found]
    assert [len(image) for image in images] == multiplicity
    assert sorted(itertools.chain(*images)) == expected
    assert Enumeration(space).count() == Tally(len(expected), len(found))
    return len(expected)


LIMITS: list[dict[str, Any]] = [
    {},
    {"segmentation": False},
    {"candidates": "all+supports"},
    {"candidates": "all+supports", "block_cells": [1, 3], "blocks": [2, 3]},
    {"candidates": "all+supports", "segmentation": False, "blocks": [2, 4]},
    {"block_cells": [2, None]},
    {"block_cells": [2, 4]},
    {"block_cells": [3, 3]},
    {"block_cells": [2, 3], "segmentation": False},
    {"blocks": [None, 2]},
    {"blocks": [3, 4]},
    {"dry_faces": [3, 5]},
    {"dry_faces": [1, 3], "segmentation": False},
    {"block_weight": [2 * CELL, 4 * CELL]},
    {"block_extent": [None, 0.2]},
    {"block_extent": [0.2, 0.2]},
    {"block_extent": [0.2, None], "blocks": [2, 3], "dry_faces": [2, 6]},
    {"candidates": "inside-blocks"},
    {"candidates": [["c0r0", "c1r0"], ["c0r0", "c0r1"], ["c0r1", "c0r2"], ["c1r1", "c1r2"]]},
    {"keep": {"dry": [["c1r0", "c1r1"]], "inner": [["c0r0", "c0r1"]]}},
    {"keep": {"dry": [["c1r0", "c1r1"]], "inner": [["c0r1", "c0r2"]]}, "candidates": "all+supports"},
]


@pytest.mark.parametrize("live", [None, DOWN], ids=["asymmetric", "symmetric"])
@pytest.mark.parametrize("search", LIMITS, ids=str)
def test_brute_force_on_a_wall(search: dict[str, Any], live: Any) -> None:
    assert check(grid_space(["aab", "cab", "###"], live, **search)) > 0


@pytest.mark.parametrize(
    "search", [s for s in LIMITS if "keep" not in s and not isinstance(s.get("candidates"), list)], ids=str
)
def test_brute_force_on_a_bridge(search: dict[str, Any]) -> None:
    space = grid_space(["aaaa", "b..b", "#..#"], DOWN, **search)
    assert len(space.group) == 2
    assert check(space) > 0


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.data())
def test_brute_force_on_random_shapes_and_limits(data: st.DataObject) -> None:
    rows = ["".join(data.draw(st.sampled_from("ab.#"), label="cell") for _ in range(3)) for _ in range(3)]
    bound = st.none() | st.integers(0, 5)

    def limits() -> list[int | None]:
        low, high = data.draw(bound), data.draw(bound)
        return sorted((low, high)) if low is not None and high is not None else [low, high]

    search: dict[str, Any] = {
        key: limits() for key in ("block_cells", "blocks", "dry_faces") if data.draw(st.booleans())
    }
    search["segmentation"] = data.draw(st.booleans())
    search["candidates"] = data.draw(st.sampled_from(["all", "all+supports", "inside-blocks"]))
    live = data.draw(st.sampled_from([None, DOWN]))
    plain = {k: v for k, v in search.items() if k in ("segmentation", "candidates")}
    try:
        loose = grid_space(rows, live, **plain)
    except InputError:
        return
    try:
        check(grid_space(rows, live, **search))
    except InputError:
        # refused limits are those that nothing satisfies
        strict = parse_scene(grid_document(rows, live=live, **search)).search
        space = SearchSpace(**{**vars(loose), "search": strict})
        assert brute_force(space) == []


def triangles() -> dict[str, Any]:
    """A square of four triangles on two supports that share a corner only, and a lid with two faces to it."""
    shapes = {
        "west": [[0, 0], [1, 1], [0, 2]],
        "south": [[0, 0], [2, 0], [1, 1]],
        "east": [[2, 0], [2, 2], [1, 1]],
        "north": [[0, 2], [1, 1], [2, 2]],
        "lid": [[-1, 1], [0, 1], [0, 2], [2, 2], [2, 1], [3, 1], [3, 3], [-1, 3]],
        "left": [[-1, 0], [0, 0], [0, 1], [-1, 1]],
        "right": [[2, 0], [3, 0], [3, 1], [2, 1]],
        "base": [[0, -1], [2, -1], [2, 0], [0, 0]],
    }
    document = grid_document(["a", "#"], live=DOWN)
    del document["grid"]
    supports = ("left", "right", "base")
    document["elements"] = [{"id": k, "polygon": v, "support": k in supports} for k, v in shapes.items()]
    return document


@pytest.mark.parametrize(
    "search",
    [
        {},
        {"candidates": "all+supports"},
        {"candidates": "all+supports", "segmentation": False},
        {"block_weight": [None, 9e4], "block_cells": [1, 3]},
        {"block_extent": [2.5, 4.0], "candidates": "all+supports"},
        {"blocks": [2, 3], "candidates": "all+supports", "keep": {"dry": [["lid", "north"]]}},
    ],
    ids=str,
)
def test_brute_force_on_polygons(search: dict[str, Any]) -> None:
    space = space_of(triangles() | {"search": search})
    assert len(space.group) == 2
    assert check(space) > 0


@pytest.mark.parametrize("segmentation", [True, False])
def test_several_faces_between_two_elements(segmentation: bool) -> None:
    shapes = {
        "corner": [[0, 1], [3, 1], [3, 2], [1, 2], [1, 3], [0, 3]],
        "fill": [[1, 2], [3, 2], [3, 3], [1, 3]],
        "base": [[0, 0], [3, 0], [3, 1], [0, 1]],
    }
    document = grid_document(["a", "#"], live=DOWN, segmentation=segmentation)
    del document["grid"]
    document["elements"] = [{"id": k, "polygon": v, "support": k == "base"} for k, v in shapes.items()]
    space = space_of(document)
    assert space.candidates.sum() == 2
    assert check(space) == (2 if segmentation else 4)


@pytest.mark.parametrize(
    ("side", "number"), [(1, 1), (2, 12), (3, 1434), pytest.param(4, 1691690, marks=pytest.mark.long)]
)
def test_connected_partitions_of_square_grids(side: int, number: int) -> None:
    space = grid_space(["a" * side] * side + ["#" * side], DOWN)
    tally = Enumeration(space).count()
    assert tally.labellings == number
    plain = grid_space(["a" * side] * side + ["#" * side], DOWN, symmetry="none")
    assert Enumeration(plain).count() == Tally(number, number)


@pytest.mark.parametrize(
    ("rows", "cells", "number"),
    [
        (["a" * 4] * 6, 2, 281),
        (["a" * 6] * 6, 2, 6728),
        (["a" * 5] * 5, 5, 4006),
        pytest.param(["a" * 6] * 6, 3, 80092, marks=pytest.mark.long),
    ],
)
def test_known_partitions_into_equal_blocks(rows: list[str], cells: int, number: int) -> None:
    space = grid_space([*rows, "#" * len(rows[0])], block_cells=[cells, cells])
    assert Enumeration(space).count().labellings == number


def flagship() -> SearchSpace:
    scene = load_scene(ROOT / "scenes" / "flat_beam_arch.json")
    return search_space(scene, build_assembly(scene))


def test_flagship_counts() -> None:
    driver = Enumeration(flagship())
    assert driver.count() == Tally(12694, 6382)
    assert size_up_to(flagship(), 6382) == 6382
    assert driver.size_up_to(6381) is None


def test_order_depends_on_the_space_alone() -> None:
    space = flagship()
    whole = everything(space)[0]
    assert np.array_equal(everything(space, rows=97)[0], whole)
    for portions in ([1, 3, 500, 10000, 1], [None], [6382]):
        driver, parts = Enumeration(space), []
        for limit in itertools.cycle(portions):
            driver.count()  # looking at the whole does not disturb the asking
            part = driver.ask(limit)
            assert limit is None or len(part) <= limit
            driver.tell(part, [FAILED] * len(part))
            if len(part) == 0:
                break
            parts.append(part)
            if sum(map(len, parts)) > 3000 and portions != [None]:
                break
        got = np.concatenate(parts)
        assert np.array_equal(got, whole[: len(got)])
        if portions == [None]:
            assert len(got) == len(whole)
    assert len(driver.ask(0)) == 0


@pytest.mark.long
def test_large_spaces_are_called_large_at_once() -> None:
    space = grid_space(["a" * 7] * 7 + ["#" * 7], block_cells=[2, 3])
    assert Enumeration(space).size_up_to(2000) is None
    assert len(Enumeration(space).ask(5)) == 5


def test_a_space_with_one_labelling() -> None:
    space = grid_space(["a", "#"])
    driver = Enumeration(space)
    assert driver.count() == Tally(1, 1)
    assert np.array_equal(driver.ask(), space.fixed[None])
    assert len(driver.ask()) == 0
