"""Operators on labellings: whatever they are given, what comes out is in the space."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases import box, canonical, counts_of, every_layout, grid_document
from cases import scene_in_space as spatial_scene
from jld_core import InputError, Scene, blocks_of, build_assembly, parse_scene
from jld_core.scene import cracks
from jld_explore import ExploreSettings, SearchSpace, explore, read_folder, search_space
from jld_explore.drivers import BufferedRandom, Register, make_driver, operators
from jld_explore.report import tables, words
from jld_explore.space import feasible, keys

DOWN = [{"body": [0, -1]}]


def space_of(rows: list[str], live: Any = None, **search: Any) -> SearchSpace:
    scene = parse_scene(grid_document(rows, live=live, **search))
    return search_space(scene, build_assembly(scene))


def rng(seed: int = 0) -> BufferedRandom:
    return BufferedRandom(np.random.default_rng(seed))


SEARCHES: list[dict[str, Any]] = [
    {},
    {"block_cells": [1, 6]},
    {"block_cells": [3, 3]},
    {"block_cells": [2, 4], "candidates": "all+supports"},
    {"blocks": [3, 5]},
    {"dry_faces": [6, 9]},
    {"block_cells": [2, 5], "blocks": [4, 5], "dry_faces": [None, 11]},
    {"block_extent": [None, 0.2]},
    {"block_extent": [0.2, 0.3]},
    {"block_weight": [25.0, 70.0], "block_extent": [None, 0.3]},
    {"keep": {"dry": [["c1r0", "c2r0"]], "inner": [["c0r1", "c1r1"], ["c1r1", "c2r1"]]}, "block_cells": [2, 7]},
    {"candidates": "inside-blocks"},
    {"segmentation": False},
    {"segmentation": False, "block_cells": [2, 5], "dry_faces": [8, 12]},
    {"segmentation": False, "dry_faces": [15, None], "candidates": "all+supports"},
    {"segmentation": False, "blocks": [2, 4], "keep": {"dry": [["c1r0", "c2r0"]]}},
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("search", SEARCHES, ids=str)
def test_all_rows_are_in_the_space(search: dict[str, Any]) -> None:
    space = space_of(["aabb", "aabb", "aabb", "#.##"], **search)
    tools, chance = operators(space), rng()
    drawn = tools.draw(200, chance)
    assert feasible(space, drawn).all()
    assert len(drawn) >= 120  # few draws are given up, even where all blocks must be of one size
    assert len(set(keys(drawn))) >= 20
    varied = tools.vary(drawn, chance)
    crossed = tools.cross(drawn, drawn[::-1], chance)
    bred = tools.breed(drawn[:60], drawn[60:120], drawn, chance)
    assert len(bred) >= 0.25 * (60 + len(drawn))  # batches are not repaired
    for rows in (varied, crossed, bred):
        assert feasible(space, rows).all()
        assert len(rows) >= 0.5 * len(drawn)
    children, of = tools.cross_indexed(drawn, drawn[::-1], chance)
    assert feasible(space, children).all()
    assert len(of) == len(children) >= 0.25 * len(drawn)
    alike, of = tools.cross_indexed(drawn, drawn, chance)
    assert (alike == drawn[of]).all()  # what both have stays, of the couple it is said to be of
    read, of = tools.read(np.array([chance.reals(tools.keys) for _ in range(50)]))
    assert feasible(space, read).all()
    assert len(set(of.tolist())) == len(read) >= 40


@pytest.mark.long
@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_random_shapes_limits_and_parents(data: st.DataObject) -> None:
    rows = ["".join(data.draw(st.sampled_from("aab.#")) for _ in range(4)) for _ in range(3)]
    bound = st.none() | st.integers(0, 6)

    def limits() -> list[int | None]:
        low, high = data.draw(bound), data.draw(bound)
        return sorted((low, high)) if low is not None and high is not None else [low, high]

    search: dict[str, Any] = {
        key: limits() for key in ("block_cells", "blocks", "dry_faces") if data.draw(st.booleans())
    }
    search["segmentation"] = data.draw(st.booleans())
    search["candidates"] = data.draw(st.sampled_from(["all", "all+supports", "inside-blocks"]))
    try:
        space = space_of(rows, data.draw(st.sampled_from([None, DOWN])), **search)
    except InputError:
        return
    tools, chance = operators(space), rng(data.draw(st.integers(0, 9)))
    rows_of = tools.draw(30, chance)
    every = make_driver("enumeration", space, 0).ask(40)
    if not len(every):
        assert not len(rows_of)
        return
    parents = np.concatenate([rows_of, every])
    bred = tools.breed(parents, parents[::-1], parents, chance)
    for found in (rows_of, tools.vary(parents, chance), tools.cross(parents, parents[::-1], chance), bred):
        assert feasible(space, found).all()
    known = set(keys(every_layout(space)))
    assert set(keys(canonical(rows_of, space.group))) <= known


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.sampled_from([{}, {"block_cells": [2, 4]}, {"segmentation": False}]))
def test_keys_are_written_and_read_back(seed: int, search: dict[str, Any]) -> None:
    space = space_of(["aaaa", "aaaa", "aaaa", "####"], **search)
    tools = operators(space)
    drawn = tools.draw(5, rng(seed))
    written = tools.write(drawn)
    assert written.shape == (len(drawn), tools.keys)
    read, of = tools.read(written)
    assert sorted(of) == list(range(len(drawn)))
    assert np.array_equal(read, drawn[of])
    same = np.array([rng(seed).reals(tools.keys)] * 2)
    one, two = tools.read(same)[0]
    assert np.array_equal(one, two)


def names(space: SearchSpace, labels: np.ndarray) -> list[int]:
    return blocks_of(space.assembly, labels)[space.assembly.elements.free].tolist()


def test_effects_of_each_operator() -> None:
    space = space_of(["aaaa", "aaaa", "####"])
    tools, chance = operators(space), rng()
    free = len(space.assembly.elements.free)
    labels = np.where(space.candidates, False, space.fixed)
    whole = tools.parts(labels[None])[0]
    ids = space.assembly.elements.ids
    west = [ids[tools.graph.first[a]][1] in "01" for a in range(len(tools.graph))]
    halves = [name if not left else -1 for name, left in zip(whole, west, strict=True)]

    def blocks(part: Any) -> int:
        return int(counts_of(space.assembly, tools.labels([part]))["blocks"][0])

    assert (blocks(whole), blocks(halves)) == (1, 2)
    assert tools.merge(whole, chance) is None  # no joint to merge across
    for _ in range(50):
        split = tools.split(whole, chance)
        assert split is None or 2 <= blocks(split) <= free
        assert blocks(tools.merge(halves, chance)) == 1
        moved = tools.labels([tools.move(halves, chance)])[0]
        changed = np.count_nonzero(moved[space.candidates] != tools.labels([halves])[0][space.candidates])
        assert 1 <= changed <= 3  # one cell of a straight joint of two faces has three faces
    shifted = {tuple(names(space, tools.labels([tools.shift(halves, chance)])[0])) for _ in range(100)}
    columns = {len(set(n)) for n in shifted}
    assert len(shifted) == 2  # the one joint line, moved by a column to the left or to the right
    assert columns == {2}


def test_children_of_equal_parents_are_their_parents() -> None:
    space = space_of(["aaaa", "aaaa", "aaaa", "####"])
    tools = operators(space)
    parents = tools.draw(40, rng(1))
    assert np.array_equal(tools.cross(parents, parents, rng(2)), parents)


def test_every_class_can_be_drawn() -> None:
    space = space_of(["aaa", "aaa", "###"], block_cells=[1, 4])
    known = set(keys(every_layout(space)))
    drawn = canonical(operators(space).draw(6000, rng()), space.group)
    assert set(keys(drawn)) == known


def test_register_admits_each_class_once() -> None:
    space = space_of(["aaa", "aaa", "###"], DOWN)
    assert len(space.group) == 2
    register, tools = Register(space), operators(space)
    rows = tools.draw(300, rng())
    broken = np.ones_like(rows[:5])
    broken[:, np.flatnonzero(space.candidates)[1:]] = False
    first = register.admit(np.concatenate([broken, rows]))
    assert feasible(space, first).all()
    assert np.array_equal(canonical(first, space.group), first)
    assert len(set(keys(first))) == len(first)
    assert len(register.admit(rows[:, space.group[1]][::1])) <= len(rows)
    mirrored = np.array([row[space.group[1]] for row in rows])
    assert len(register.admit(mirrored)) == 0
    assert len(register.admit(tools.draw(500, rng(5)), most=2)) <= 2


def test_only_limits_kept_in_the_making_make_rows_sure() -> None:
    rows = ["aabb", "aabb", "aabb", "####"]
    assert operators(space_of(rows, block_cells=[2, 4])).always_feasible
    others: tuple[dict[str, Any], ...] = (
        {"blocks": [3, 5]},
        {"convex_blocks": True},
        {"assemble": "standing"},
        {"block_extent": [None, 0.2]},
        {"shapes": [None, 3]},
        {"segmentation": False},
    )
    for search in others:
        assert not operators(space_of(rows, block_cells=[2, 4], **search)).always_feasible


def test_spatial_cubes() -> None:
    cells = [(x, y, z) for z in range(2) for y in range(2) for x in range(3)]
    elements = [box(f"c{x}{y}{z}", (x, y, z), (x + 1, y + 1, z + 1)) for x, y, z in cells]
    elements.append(box("base", (0, 0, -1), (3, 2, 0), support=True))
    parsed = parse_scene(spatial_scene(elements, search={"block_cells": [2, 4], "block_extent": [None, 2.0]}))
    space = search_space(parsed, build_assembly(parsed))
    tools = operators(space)
    drawn = tools.draw(100, rng())
    assert len(drawn) == 100
    assert feasible(space, drawn).all()
    assert feasible(space, tools.vary(drawn, rng())).all()
    assert feasible(space, tools.cross(drawn, drawn[::-1], rng())).all()


# Fronts of λ against two counts: what is on them, what is said of it, and that pictures and pages show it.


FRONT = {"counts": ["blocks", "shapes"], "sense": ["max", "min"]}


def scene_of(**search: Any) -> Scene:
    return parse_scene(grid_document(["aaa", "aaa", "###"], block_cells=[1, 3], **{"front": FRONT, **search}))


def unbeaten(values: Any) -> list[bool]:
    """By the definition, more being better in every column."""
    return [
        bool(np.isfinite(one).all() and not any((other >= one).all() and (other > one).any() for other in values))
        for one in values
    ]


@pytest.mark.parametrize("columns", [2, 3])
def test_layouts_on_a_front(columns: int) -> None:
    rng = np.random.default_rng(7)
    values = rng.integers(0, 6, size=(120, columns)).astype(float)
    values[rng.random(120) < 0.1, 0] = np.nan
    known = np.nan_to_num(values, nan=-np.inf)
    wanted = [good and not np.isnan(row[0]) for good, row in zip(unbeaten(known), values, strict=True)]
    senses = ["max", "min"][: columns - 1]
    signs = np.array([1.0, -1.0])[: columns - 1]
    assert tables.on_front(values[:, 0], values[:, 1:] * signs, *senses).tolist() == wanted


def test_enumeration_proves_the_front_of_two_counts_and_genetic_finds_it(tmp_path: Path) -> None:
    every = explore(scene_of(), tmp_path / "every", ExploreSettings(driver="enumeration"))
    ranked = every.results[every.results["status"] == "collapse"]
    # ranks are shared where λ is the same but for its brackets
    values = ranked[["rank", "blocks", "shapes"]].to_numpy(dtype=float) * [-1.0, 1.0, -1.0]
    wanted = {tuple(row) for row in np.abs(values[unbeaten(values)])}
    assert {tuple(row) for row in every.front[["rank", "blocks", "shapes"]].to_numpy(dtype=float)} == wanted
    assert len(every.front) == len(wanted)
    assert every.front["evidence"].eq("proven").all()
    pairs = {tuple(row["count"]) for row in every.summary.front}
    assert pairs == {tuple(map(int, row)) for row in every.front[["blocks", "shapes"]].to_numpy()}
    assert len(pairs) > 2
    assert all(row["proven"] and row["bound"] >= row["load_factor"] for row in every.summary.front)
    assert words.front_name(every) == "λ against blocks (max) and shapes (min)"
    assert (tmp_path / "every" / "pareto.png").stat().st_size > 10_000
    assert list(read_folder(tmp_path / "every").front["labelling"]) == list(every.front["labelling"])

    budget = len(every.results) // 2
    some = explore(scene_of(), tmp_path / "some", ExploreSettings(driver="genetic", budget=budget, pictures=False))
    assert set(some.front["evidence"]) <= {"found", "proven"}
    # its best may meet the bound known beforehand, which proves it and no other point
    assert some.summary.proven is (some.summary.gap is not None and some.summary.gap <= 1e-6)
    # half of the classes leave little of it to be found
    assert _volume(some.front) >= 0.97 * _volume(every.front)


def _volume(front: pd.DataFrame) -> float:
    """Volume that a front dominates, of λ > 0, at least one block and at most six shapes."""
    blocks, shapes = np.meshgrid(np.arange(1, 7), np.arange(1, 7))
    rows = front[["load_factor", "blocks", "shapes"]].to_numpy(dtype=float)
    best = [np.where((row[1] >= blocks) & (row[2] <= shapes), row[0], 0.0) for row in rows]
    return float(np.max(best, axis=0).sum())


def test_sizes_that_are_no_whole_numbers_are_drawn_as_dots(tmp_path: Path) -> None:
    front = {"counts": ["dry_length", "largest_block_mass"], "sense": "min"}
    done = explore(scene_of(front=front), tmp_path / "done", ExploreSettings(driver="enumeration"))
    assert (tmp_path / "done" / "pareto.png").exists()
    assert len(done.front)


def test_the_exact_driver_proves_a_front_of_two_counts_by_enumeration(tmp_path: Path) -> None:
    """Every row is the strongest of all layouts that count as well, by brute force over the whole table."""
    front = {"counts": ["sawn_length", "blocks"], "sense": ["min", "max"]}
    settings = ExploreSettings(driver="exact", pictures=False, options={"aim": "front"})
    done = explore(scene_of(front=front), tmp_path / "done", settings)
    assert done.summary.proven is True
    rows = done.summary.facts["front"]
    assert len(rows) > 2
    assert all(row["proven"] for row in rows)
    table = done.results[done.results["status"] == "collapse"]
    for row in rows:
        sawn, blocks = row["count"]
        allowed = table[(table["sawn_length"] <= sawn * (1.0 + 1e-9)) & (table["blocks"] >= blocks)]
        assert row["load_factor"] == pytest.approx(allowed["load_factor"].max(), rel=1e-9)


def test_by_fields_two_counts_have_no_exact_front(tmp_path: Path) -> None:
    settings = ExploreSettings(driver="exact", options={"aim": "front"}, pictures=False)
    scene = scene_of().model_copy(update={"cracks": cracks.FieldCracks(kind="fields")})
    with pytest.raises(InputError, match=r"search\.front\.counts: by fields two counts have no exact front"):
        explore(scene, tmp_path / "done", settings)
