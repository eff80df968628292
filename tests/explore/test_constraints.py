"""Feasibility and counts of batches, against one labelling at a time."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from cases import counts_of, every_layout, grid_assembly, grid_document
from command import Command, refused, saved
from jld_core import Assembly, InputError, Scene, build_assembly, parse_scene, solve
from jld_core import blocks_of as assembly_blocks
from jld_explore import ExploreSettings, SearchSpace, explore, read_folder, search_space
from jld_explore.report import words
from jld_explore.space import cut, feasible, from_string, labelling, reasons_against

ROWS = ["abc", "#.#"]  # faces: c0r0-c1r0, c0r0-c0r1, c1r0-c2r0, c2r0-c2r1
CELL = 1400 * 9.81 * 0.1**3


def space_of(rows: list[str], **search: Any) -> SearchSpace:
    scene = parse_scene(grid_document(rows, **search))
    return search_space(scene, build_assembly(scene))


def batch(space: SearchSpace, *pairs_dry: str) -> Any:
    """One row per text of dry pairs, '' for none; the other candidates are inner, the rest as fixed."""
    ids, faces = space.assembly.elements.ids, space.assembly.interfaces
    names = [f"{ids[a]}-{ids[b]}" for a, b in zip(faces.a, faces.b, strict=True)]
    rows = []
    for text in pairs_dry:
        row = np.where(space.candidates, False, space.fixed)
        row[[names.index(name) for name in text.split()]] = True
        rows.append(row)
    return np.array(rows)


ALL = ("", "c0r0-c1r0", "c1r0-c2r0", "c0r0-c1r0 c1r0-c2r0")


@pytest.mark.parametrize(
    ("search", "expected"),
    [
        ({}, [1, 1, 1, 1]),
        ({"block_cells": [None, 2]}, [0, 1, 1, 1]),
        ({"block_cells": [1, 1]}, [0, 0, 0, 1]),
        ({"block_cells": [3, None]}, [1, 0, 0, 0]),
        ({"block_weight": [None, 2 * CELL]}, [0, 1, 1, 1]),
        ({"block_weight": [None, 1.99 * CELL]}, [0, 0, 0, 1]),
        ({"block_weight": [3 * CELL, None]}, [1, 0, 0, 0]),
        ({"block_extent": [None, 0.2]}, [0, 1, 1, 1]),
        ({"block_extent": [None, 0.1]}, [0, 0, 0, 1]),
        ({"block_extent": [0.3, None]}, [1, 0, 0, 0]),
        ({"blocks": [2, 2]}, [0, 1, 1, 0]),
        ({"blocks": [3, None]}, [0, 0, 0, 1]),
        ({"dry_faces": [1, 1]}, [0, 1, 1, 0]),
        ({"dry_faces": [None, 0]}, [1, 0, 0, 0]),
        ({"keep": {"dry": [["c0r0", "c1r0"]]}}, [0, 1, 0, 1]),
    ],
)
def test_limits_are_inclusive(search: dict[str, Any], expected: list[int]) -> None:
    plain = space_of(ROWS)
    space = space_of(ROWS, **search)
    assert feasible(space, batch(plain, *ALL)).astype(int).tolist() == expected


def test_slits() -> None:
    rows = ["ab", "cd", "##"]
    texts = ("c0r0-c1r0", "c0r0-c1r0 c0r1-c1r1", "c0r0-c1r0 c0r0-c0r1", "")
    space = space_of(rows)
    assert feasible(space, batch(space, *texts)).tolist() == [False, True, True, True]
    free = space_of(rows, segmentation=False)
    assert feasible(free, batch(free, *texts)).all()
    # one block with a slit: limits still look at the component through inner faces
    small = space_of(rows, segmentation=False, block_cells=[None, 3])
    assert feasible(small, batch(small, *texts)).tolist() == [False, True, True, False]


def test_touching_supports_are_one_block() -> None:
    space = space_of(["ab", "##"], candidates="all+supports")
    texts = ("c0r0-c1r0", "c0r0-c1r0 c0r0-c0r1", "c0r0-c0r1 c1r0-c1r1")
    assert feasible(space, batch(space, *texts)).tolist() == [False, True, True]
    apart = space_of(["abc", "#.#"], candidates="all+supports")
    assert feasible(apart, batch(apart, "c0r0-c1r0", "c0r0-c1r0 c0r0-c0r1")).all()
    # in pictures and files as in counts
    for one in (space, apart):
        for row in batch(one, *texts[:2]):
            block, other = labelling.blocks_of(one.graph, row), assembly_blocks(one.assembly, row)
            assert np.array_equal(block[:, None] == block, other[:, None] == other)


def test_fixed_labels_bind() -> None:
    space = space_of(ROWS)
    row = batch(space, "")
    row[0, ~space.candidates] = False
    assert not feasible(space, row).any()


def test_counts_leave_supports_out() -> None:
    space = space_of(["ab", "cd", "##"], candidates="all+supports")
    texts = ("", "c0r0-c1r0 c0r0-c0r1 c0r1-c0r2 c1r1-c1r2", "c0r1-c0r2 c1r1-c1r2")
    found = counts_of(space.assembly, batch(space, *texts), space.graph)
    assert found["dry_faces"].tolist() == [0, 2, 0]
    assert found["dry_length"].tolist() == pytest.approx([0, 0.2, 0])
    assert found["blocks"].tolist() == [1, 2, 1]
    assert found["largest_block_cells"].tolist() == [4, 3, 4]
    assert np.array_equal(counts_of(space.assembly, batch(space, *texts))["blocks"], found["blocks"])


def test_counts_of_blocks_around_supports() -> None:
    space = space_of(["a#b"], candidates="all+supports")
    found = counts_of(space.assembly, np.array([from_string("ii"), from_string("id"), from_string("dd")]))
    assert found["blocks"].tolist() == [1, 2, 2]
    assert found["largest_block_cells"].tolist() == [2, 1, 1]
    assert found["dry_faces"].tolist() == [0, 0, 0]


def test_no_rows() -> None:
    space = space_of(ROWS)
    none = np.empty((0, len(space.fixed)), dtype=bool)
    assert feasible(space, none).shape == (0,)
    assert counts_of(space.assembly, none)["blocks"].shape == (0,)


@pytest.mark.parametrize(
    ("search", "words"),
    [
        ({"block_cells": [2, 3]}, "block_cells allows 2 to 3"),
        ({"block_weight": [None, 2 * CELL]}, "of weight; block_weight allows at most"),
        ({"block_extent": [None, 0.2]}, "of extent; block_extent allows at most 0.2"),
        ({"blocks": [3, None]}, "blocks is 2; the search allows at least 3"),
        ({"dry_faces": [1, 3]}, "dry_faces is 0; the search allows 1 to 3"),
        ({"shapes": [None, 1]}, "shapes is 2; the search allows at most 1"),
        ({"convex_blocks": True}, "has a shape that is not allowed (reentrant at most 0)"),
        ({"keep": {"dry": [["c0r0", "c1r0"]]}}, "face c0r0–c1r0 must be dry"),
        ({"assemble": "translation"}, "it cannot be laid as assemble: translation asks"),
        ({"block_cells": [2, 3], "except": ["c1r1"]}, "block_cells allows 2 to 3"),
    ],
)
def test_reasons_are_given_where_a_labelling_is_not_feasible(search: dict[str, Any], words: str) -> None:
    """For all labellings of a small space, slits among them: no reason exactly where it is feasible."""
    space = space_of(["aab", "acb", "###"], **search)
    count = len(space.fixed)
    some = np.random.default_rng(3).random((300, count)) < np.linspace(0.05, 0.95, 300)[:, None]
    every = np.concatenate([some, [space.fixed, np.ones(count, dtype=bool), np.zeros(count, dtype=bool)]])
    given = [reasons_against(space, labels) for labels in every]
    assert [not reasons for reasons in given] == feasible(space, every).tolist()
    assert any(words in reason for reasons in given for reason in reasons), {r for found in given for r in found}


def test_fewest_dry_faces_follow_from_the_size_of_blocks() -> None:
    """Blocks of two cells leave at least 4 of the 7 faces of six cells dry; no search is needed to see that."""

    def fewest(asked: int, cells: int) -> int:
        scene = parse_scene(grid_document(["aaa", "aaa", "###"], block_cells=[1, cells], dry_faces=[None, asked]))
        space = search_space(scene, build_assembly(scene))
        return int(every_layout(space).sum(axis=1).min())

    for cells, least in ((1, 7), (2, 4)):
        message = rf"search.dry_faces: \[null, {least - 1}\] asked, but there can be {least} to 7"
        with pytest.raises(InputError, match=message):
            fewest(least - 1, cells)
        assert fewest(least, cells) == least + 3  # three faces to the support are dry as well
    assert fewest(7, 6) == 3


# A load factor is required and a count is made best: every driver, and the exact one against brute force.


WALL = ["aaa", "aaa", "###"]
REQUIRED = (0.3, 0.52, 0.66, 0.75, 2.0)
"""Load factors that all, most, some, few and none of the layouts have."""
WINDS = [{"name": "a", "live": [{"body": [1, 0]}]}, {"name": "b", "live": [{"body": [-1, 0]}], "required": 1.1}]


def scene_of(count: str, sense: str, least: float, *, cases: bool = False, limits: dict[str, Any] | None = None) -> Any:
    document = grid_document(
        WALL,
        **{"block_cells": [1, 3], **(limits or {})},
        front={"count": count, "sense": sense},
        require={"load_factor": least},
    )
    if cases:
        document["loads"] = {"cases": WINDS}
    return parse_scene(document)


def best_of(results: pd.DataFrame, count: str, sense: str, least: float) -> float | None:
    """By brute force, from the numbers of the table."""
    good = results[(results["status"] == "collapse") & (results["bracket_lo"] >= least * (1.0 - 1e-6))]
    good = pd.concat([good, results[results["status"] == "locked"]])
    if good.empty:
        return None
    return float(good[count].min() if sense == "min" else good[count].max())


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("count", "sense", "cases", "required"),
    [
        ("blocks", "min", False, REQUIRED),
        ("dry_faces", "max", False, REQUIRED),
        ("shapes", "min", False, REQUIRED[::3]),
        ("blocks", "max", True, REQUIRED[1::3]),
    ],
)
def test_exact_is_brute_force(count: str, sense: str, cases: bool, required: tuple[float, ...], tmp_path: Path) -> None:
    wide = {"block_cells": [1, 2]}
    for number, least in enumerate(required):
        scene = scene_of(count, sense, least, cases=cases, limits=wide)
        every = explore(scene, tmp_path / f"every{number}", ExploreSettings(pictures=False, driver="enumeration"))
        found = explore(scene, tmp_path / f"exact{number}", ExploreSettings(pictures=False, driver="exact"))
        expected = best_of(every.results, count, sense, least)
        for done in (every, found):
            asked = done.summary.facts["require"]
            assert done.summary.proven is asked["proven"] is True
            assert asked["best"] == expected
            if expected is not None:
                row = done.results.iloc[0]
                assert row["meets"]
                assert row[count] == expected
                assert row["labelling"] == asked["best_labelling"] == done.summary.best_labelling
        assert ("proven that there is none" in words.facts_of_exploration(found)["required"]) == (expected is None)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("driver", ["genetic", "hillclimb", "random", "optuna"])
def test_other_drivers_optimise_the_count_among_layouts_that_meet_the_requirement(driver: str, tmp_path: Path) -> None:
    scene = scene_of("blocks", "min", 0.6)
    settings = ExploreSettings(pictures=False, driver=driver, budget=25, seed=1)
    done = explore(scene, tmp_path / "out", settings)
    asked = done.summary.facts["require"]
    met = done.results[done.results["meets"]]
    assert asked["met"] == len(met) > 0
    assert asked["best"] == met["blocks"].min() == done.results.iloc[0]["blocks"]
    assert not asked["proven"]
    assert not done.summary.proven
    # what meets it stands first, and by the count
    ranked = done.results[done.results["status"] == "collapse"]
    assert (np.diff(ranked["meets"].astype(int)) <= 0).all()
    assert (np.diff(ranked[ranked["meets"]]["blocks"]) >= 0).all()


@pytest.mark.parametrize(
    ("require", "words"),
    [
        ({"load_factor": 0}, "search.require.load_factor"),
        ({"load_factor": "much"}, "search.require.load_factor"),
        ({}, "search.require.load_factor: missing"),
        ({"load_factor": 1, "blocks": 3}, "search.require.blocks: unknown key"),
    ],
)
def test_wrong_requirements(require: Any, words: str) -> None:
    with refused(words):
        parse_scene(grid_document(WALL, require=require))


def test_a_front_is_refused_where_a_load_factor_is_required(tmp_path: Path) -> None:
    settings = ExploreSettings(pictures=False, driver="exact", options={"aim": "front"})
    with pytest.raises(InputError, match=r"search\.require"):
        explore(scene_of("blocks", "min", 0.5), tmp_path / "out", settings)


# Packed bits, blocks, slits and canonical forms, against definitions spelt out element by element.


def plain_blocks(assembly: Assembly, labels: np.ndarray, touching: list[tuple[int, int]]) -> list[int]:
    """Smallest index in each element's block, by repeated relabelling."""
    name = list(range(len(assembly.elements)))
    faces = assembly.interfaces
    links = [(int(a), int(b)) for a, b, dry in zip(faces.a, faces.b, labels, strict=True) if not dry] + touching
    changed = True
    while changed:
        changed = False
        for a, b in links:
            if name[a] != name[b]:
                name[a] = name[b] = min(name[a], name[b])
                changed = True
    return name


@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=80)))
def test_packing_and_text_come_back(rows: np.ndarray) -> None:
    assert np.array_equal(labelling.unpack(labelling.pack(rows), rows.shape[1]), rows)
    for row in rows:
        text = labelling.to_string(row)
        assert text == "".join("d" if dry else "i" for dry in row)
        assert np.array_equal(labelling.from_string(text), row)
    order = sorted(range(len(rows)), key=lambda i: labelling.keys(rows)[i])
    assert [labelling.to_string(rows[i]) for i in order] == sorted(map(labelling.to_string, rows), reverse=True)


def test_text_holds_only_its_letters() -> None:
    with pytest.raises(ValueError, match="'1'"):
        labelling.from_string("di1d")


@pytest.mark.parametrize(
    ("rows", "touching"),
    [
        (["ab", "cd", "##"], [("c0r2", "c1r2")]),
        (["abc", "d.e", "#.#"], []),
        (["#ab#", "#cd#"], [("c0r0", "c0r1"), ("c3r0", "c3r1")]),
        (["a#", "#b"], []),  # supports that share a corner only
    ],
)
def test_blocks_and_slits_of_all_labellings(rows: list[str], touching: list[tuple[str, str]]) -> None:
    assembly = grid_assembly(rows)
    graph = labelling.connectivity(assembly)
    index = assembly.elements.index
    pairs = [(index[a], index[b]) for a, b in touching]
    assert [tuple(pair) for pair in graph.touching.tolist()] == sorted(pairs)
    m = len(assembly.interfaces)
    labels = np.array(np.unravel_index(np.arange(2**m), (2,) * m)).T.astype(bool)
    expected = np.array([plain_blocks(assembly, row, pairs) for row in labels])
    assert np.array_equal(labelling.blocks_of(graph, labels), expected)
    assert np.array_equal(labelling.blocks_of(graph, labels[5]), expected[5])
    inside = expected[:, graph.a] == expected[:, graph.b]
    assert np.array_equal(labelling.slits(graph, labels), labels & inside)
    assert np.array_equal(labelling.slits(graph, labels[5]), (labels & inside)[5])


def test_blocks_of_long_chains_and_no_rows() -> None:
    assembly = grid_assembly(["#" + "a" * 40, "." * 40 + "a", "#" + "a" * 40])
    graph = labelling.connectivity(assembly)
    m = len(assembly.interfaces)
    assert not labelling.blocks_of(graph, np.zeros(m, dtype=bool)).any()
    assert labelling.blocks_of(graph, np.ones((0, m), dtype=bool)).shape == (0, len(assembly.elements))
    assert np.array_equal(labelling.blocks_of(graph, np.ones(m, dtype=bool)), np.arange(len(assembly.elements)))


def test_blocks_do_not_depend_on_the_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = labelling.connectivity(grid_assembly(["abc", "def", "###"]))
    labels = np.random.default_rng(1).random((50, len(graph.a))) < 0.5
    whole = labelling.blocks_of(graph, labels)
    monkeypatch.setattr(labelling, "_ENTRIES", 60)
    assert np.array_equal(labelling.blocks_of(graph, labels), whole)


def test_supports_in_space_touch_through_faces_only() -> None:
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]

    def box(name: str, corner: list[float], support: bool) -> dict[str, object]:
        steps = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        vertices = [[float(c + s) for c, s in zip(corner, step, strict=True)] for step in steps]
        return {"id": name, "vertices": vertices, "faces": faces, "support": support}

    # s0 and s1 share half a face; s2 touches s1 along an edge only
    corners = {"a": [0, 0, 1], "s0": [0, 0, 0], "s1": [1, 0.5, 0], "s2": [2, 0.5, 1]}
    document = grid_document(["a", "#"], live=[{"body": [1, 0, 0]}])
    del document["grid"]
    document["elements"] = [box(name, corner, name != "a") for name, corner in corners.items()]
    assembly = build_assembly(parse_scene(json.loads(json.dumps(document))))
    assert labelling.connectivity(assembly).touching.tolist() == [[1, 2]]


@given(st.integers(1, 90), st.integers(0, 2**32 - 1))
def test_canonical_is_the_smallest_image(faces: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.roll(np.arange(faces), faces // 3) if faces % 3 == 0 else np.arange(faces)
    group = np.array([np.arange(faces), turn, turn[turn]]) if faces % 3 == 0 else np.array([turn, turn[::-1]])
    group = group[: 1 if faces == 1 else len(group)]
    rows = rng.random((40, faces)) < rng.choice([0.1, 0.5, 0.9])
    images = [sorted({labelling.to_string(row[g]) for g in group}, reverse=True) for row in rows]
    best = labelling.canonical(rows, group)
    assert [labelling.to_string(row) for row in best] == [image[0] for image in images]
    sizes = labelling.orbit_sizes(rows, group)
    assert sizes.tolist() == [len(image) for image in images]
    kept, orbits = labelling.representatives(rows, group)
    assert kept.tolist() == [i for i in range(40) if labelling.to_string(rows[i]) == images[i][0]]
    assert np.array_equal(orbits, sizes[kept])


@pytest.mark.parametrize(("limit", "size"), [("block_cells", 4), ("block_weight", 4 * CELL), ("block_extent", 0.2)])
def test_sizes_count_free_elements_only(limit: str, size: float) -> None:
    """One block of four cells and the supports below them."""
    rows, less = ["ab", "cd", "##"], 3 if limit == "block_cells" else 0.99 * size
    for bounds, expected in (([None, less], False), ([None, size], True), ([size, None], True)):
        space = space_of(rows, candidates="all+supports", **{limit: bounds})
        assert feasible(space, np.zeros((1, len(space.fixed)), dtype=bool)).tolist() == [expected]
    with pytest.raises(InputError, match=f"has {size:g} .* at most"):
        space_of(rows, candidates="all+supports", **{limit: [size + 1, None]})


# Cells that may be left out: which layouts there are, and that each is the structure drawn without them.


PIERCED = ["aaa", "aaa", "###"]
LIMITS = {"block_cells": [1, 2], "dry_faces": [2, None]}


def pierced(rows: list[str] = PIERCED, void: Any = None, **search: Any) -> Scene:
    """A wall pushed by a share of its weight and at the middle of its top."""
    document = grid_document(rows, **{**LIMITS, "symmetry": "none", **search})
    document["loads"] = {"live": [{"element": "c1r0", "force": [1e-3, 0]}, {"body": [0.1, 0]}]}
    if void is not None:
        document["search"]["void"] = void
    return parse_scene(document)


def drawn_without(cells: tuple[str, ...]) -> Scene | None:
    """The scene without some cells; None where something then hangs in the air."""
    rows = [
        "".join("." if f"c{x}r{y}" in cells else letter for x, letter in enumerate(row))
        for y, row in enumerate(PIERCED)
    ]
    try:
        scene = pierced(rows)
        build_assembly(scene)
    except InputError:
        return None
    return scene


@pytest.fixture(scope="module")
def every(tmp_path_factory: pytest.TempPathFactory) -> Any:
    scene = pierced(void={"most": 0.34}, front={"count": "mass", "sense": "min"})
    return explore(scene, tmp_path_factory.mktemp("void") / "every", ExploreSettings(driver="enumeration"))


@pytest.mark.usefixtures("without_pictures")
def test_all_layouts_of_all_structures(every: Any) -> None:
    """Brute force over what may be left out: every structure that is drawn without, with all of its own layouts."""
    cells = [f"c{x}r{y}" for y in range(2) for x in range(3) if (x, y) != (1, 0)]
    found = dict(zip(every.results["labelling"], every.results.to_dict("records"), strict=True))
    assert len(found) == len(every.results)
    seen = 0
    for gone in itertools.chain(*(itertools.combinations(cells, k) for k in (0, 1, 2))):
        scene = drawn_without(gone)
        if scene is None:
            continue
        space = search_space(scene, build_assembly(scene))
        own = {text for text in found if {every.assembly.elements.ids[k] for k in _rows(every, text)} == set(gone)}
        bits = every_layout(space)
        assert len(own) == len(bits)
        seen += len(own)
        pairs = {tuple(row) for row in bits.tolist()}
        assert {tuple(cut(every.assembly, text)[1].tolist()) for text in own} == pairs
    assert seen == len(found)


def _rows(every: Any, text: str) -> list[int]:
    found: list[int] = np.flatnonzero(labelling.omitted(every.assembly, text)).tolist()
    return found


def test_a_layout_with_cells_left_out_equals_the_scene_without_them(every: Any) -> None:
    """λ and counts of a layout with cells left out are those of the scene drawn without them."""
    some = every.results[every.results["labelling"].str.contains("v")].iloc[::17]
    assert len(some) > 5
    for row in some.to_dict("records"):
        gone = tuple(every.assembly.elements.ids[k] for k in _rows(every, row["labelling"]))
        scene = drawn_without(gone)
        assert scene is not None
        assembly = build_assembly(scene)
        labels = cut(every.assembly, row["labelling"])[1]
        result = solve(assembly, labels)
        assert str(result.status) == row["status"]
        if row["status"] == "collapse":
            assert row["load_factor"] == pytest.approx(result.load_factor, rel=1e-6)
        space = search_space(scene, assembly)
        assert row["mass"] == pytest.approx(float(assembly.elements.mass[assembly.elements.free].sum()))
        for name, values in counts_of(assembly, labels[None], space.graph, space.limits.block_shapes).items():
            assert row[name] == pytest.approx(float(values[0])), name


def test_the_strongest_for_its_weight(every: Any) -> None:
    masses = every.front["mass"].to_numpy()
    assert len(masses) > 1
    assert every.front["evidence"].eq("proven").all()
    assert (np.diff(every.front["load_factor"].to_numpy(dtype=float)) <= 0.0).all()
    assert every.summary.proven
    for file in ("pareto.png", "best.png", "report.html", "blocks.csv"):
        assert (every.folder / file).exists()


def test_other_drivers_keep_to_the_same_layouts(every: Any, tmp_path: Path) -> None:
    known = dict(zip(every.results["labelling"], every.results["load_factor"], strict=True))
    for driver in ("genetic", "hillclimb", "random"):
        settings = ExploreSettings(driver=driver, budget=40, pictures=False)
        done = explore(every.scene, tmp_path / driver, settings)
        assert set(done.results["labelling"]) <= set(known)
        assert done.results["labelling"].str.contains("v").any()
        best = done.results.iloc[0]
        assert best["load_factor"] == pytest.approx(known[best["labelling"]], rel=1e-6)


def test_mirror_images_are_one_class(tmp_path: Path) -> None:
    scene = pierced(void={"cells": ["c0r0", "c2r0"]}, symmetry="auto")
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["loads"] = {"live": [{"element": "c1r0", "force": [0, -1e-3]}]}
    one = explore(parse_scene(document), tmp_path / "one", ExploreSettings(pictures=False))
    document["search"]["symmetry"] = "none"
    two = explore(parse_scene(document), tmp_path / "two", ExploreSettings(pictures=False))
    assert one.summary.labellings == two.summary.labellings == len(two.results)
    assert len(one.results) < len(two.results)


def test_ranks_are_solved_drawn_and_exported(every: Any, tmp_path: Path, jld: Command) -> None:
    ranked = every.results[every.results["status"] == "collapse"]["labelling"].reset_index(drop=True)
    rank = int(np.flatnonzero(ranked.str.contains("v"))[0]) + 1
    told = json.loads(jld("solve", every.folder, "--rank", rank, "--json").done().out)
    assert told["load_factor"] == pytest.approx(float(every.results["load_factor"].iloc[rank - 1]), rel=1e-6)
    assert told["elements"] < len(every.assembly.elements)
    assert jld("plot", every.folder, "--rank", rank, "--out", tmp_path / "r.png").code == 0
    file = tmp_path / "blocks.obj"
    assert jld("export", every.folder, "--format", "obj", "--rank", rank, "-o", file).code == 0
    again = read_folder(every.folder)
    assert again.layout(rank).assembly.elements.ids == every.layout(rank).assembly.elements.ids


@pytest.mark.parametrize(
    ("search", "words"),
    [
        ({"void": {"cells": ["x"]}}, "search.void.cells[0]: 'x' names no element"),
        ({"void": {"cells": ["c0r2"]}}, "'c0r2' is a support"),
        ({"void": {"cells": ["c1r0"]}}, "'c1r0' carries a load"),
        ({"void": {"cells": 3}}, "search.void.cells: 3"),
        ({"void": {"most": 1.0}}, "search.void.most: 1.0"),
        ({"void": {}, "segmentation": False}, "is given together with search.segmentation"),
        ({"void": {}, "keep": {"dry": [["c0r0", "c0r1"]]}}, "'c0r0', 'c0r1' between two of them is fixed dry"),
    ],
)
def test_bad_input(search: dict[str, Any], words: str, tmp_path: Path, jld: Command) -> None:
    document = pierced().model_dump(mode="json", exclude_defaults=True)
    document["search"] = {**document["search"], **search}
    file = saved(tmp_path / "scene.json", document)
    jld("explore", file, "--out", tmp_path / "out").refused(words)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (ExploreSettings(driver="exact"), "exact proves nothing where cells may be left out"),
        (ExploreSettings(experiment=1), "experiment: it needs one structure"),
    ],
)
def test_options_for_one_structure_are_refused_with_void_cells(
    settings: ExploreSettings, words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words):
        explore(pierced(void={}), tmp_path / "out", settings)
    assert not (tmp_path / "out").exists()
