"""The search space: candidates, fixed labels, refusals and symmetry groups."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import all_inner, grid_document, space_of
from jld_core import InputError, build_assembly, load_scene, parse_scene
from jld_explore import SearchSpace, search_space
from jld_explore.space import feasible

ROOT = Path(__file__).parents[2]
SQUARE = ["ab", "cd", "##"]
DOWN = [{"body": [0, -1]}]


def grid_space(rows: list[str], live: list[dict[str, Any]] | None = None, **search: Any) -> SearchSpace:
    return space_of(grid_document(rows, live=live, **search))


def pairs(space: SearchSpace, mask: Any) -> list[str]:
    ids, faces = space.assembly.elements.ids, space.assembly.interfaces
    return sorted(f"{ids[faces.a[f]]}-{ids[faces.b[f]]}" for f in np.flatnonzero(mask))


def polygons(shapes: dict[str, list[list[float]]], supports: list[str], live: Any = None) -> dict[str, Any]:
    document = grid_document(["a", "#"], live=live)
    del document["grid"]
    document["elements"] = [{"id": k, "polygon": v, "support": k in supports} for k, v in shapes.items()]
    return document


def test_candidates_by_word_and_by_list() -> None:
    inner = ["c0r0-c0r1", "c0r0-c1r0", "c0r1-c1r1", "c1r0-c1r1"]
    space = grid_space(SQUARE)
    assert pairs(space, space.candidates) == inner
    everything = grid_space(SQUARE, candidates="all+supports")
    assert everything.candidates.all()
    assert len(everything.candidates) == 6
    space = grid_space(["aa", "bb", "##"], candidates="inside-blocks")
    assert pairs(space, space.candidates) == [inner[1], inner[2]]
    space = grid_space(SQUARE, candidates=[["c1r0", "c0r0"]])
    assert pairs(space, space.candidates) == [inner[1]]
    # elements without a name are blocks of their own, not one block
    unnamed = polygons({"a": [[0, 1], [1, 1], [1, 2], [0, 2]], "b": [[0, 2], [1, 2], [1, 3], [0, 3]]}, [])
    unnamed["elements"].append({"id": "s", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]], "support": True})
    unnamed["search"] = {"candidates": "inside-blocks"}
    with pytest.raises(InputError, match=r"search\.candidates: no face is a candidate"):
        space_of(unnamed)


def test_kept_pairs_are_fixed_whatever_their_label_was() -> None:
    keep = {"dry": [["c0r0", "c1r0"]], "inner": [["c1r1", "c1r2"], ["c0r0", "c0r1"]]}
    space = grid_space(["aa", "cd", "##"], keep=keep)
    assert pairs(space, space.candidates) == ["c0r1-c1r1", "c1r0-c1r1"]
    assert pairs(space, ~space.candidates & space.fixed) == ["c0r0-c1r0", "c0r1-c0r2"]
    assert pairs(space, ~space.candidates & ~space.fixed) == ["c0r0-c0r1", "c1r1-c1r2"]


@pytest.mark.parametrize(
    ("rows", "search", "message"),
    [
        (["a", "#"], {}, "search.candidates: no face is a candidate; expected at least one face"),
        (SQUARE, {"candidates": []}, "search.candidates: no face is a candidate"),
        (
            ["ab", "##"],
            {"keep": {"dry": [["c0r0", "c1r0"]]}},
            "search.candidates: no face is a candidate; expected at least one face that search.keep",
        ),
        (SQUARE, {"candidates": [["c0r0", "x"]]}, "search.candidates[0]: no element is named 'x'"),
        (SQUARE, {"candidates": [["c0r0", "c1r1"]]}, "search.candidates[0]: 'c0r0' and 'c1r1' share no interface"),
        (SQUARE, {"keep": {"dry": [["c0r0", "x"]]}}, "search.keep.dry[0]: no element is named 'x'"),
        (SQUARE, {"keep": {"inner": [["c0r0", "c1r1"]]}}, "search.keep.inner[0]: 'c0r0' and 'c1r1' share no"),
        (
            SQUARE,
            {"keep": {"dry": [["c0r0", "c1r0"]], "inner": [["c1r0", "c0r0"]]}},
            "search.keep: the pair 'c0r0', 'c1r0' is listed under both dry and inner",
        ),
        (
            SQUARE,
            {"keep": {"dry": [["c0r0", "c1r0"]], "inner": [["c0r0", "c0r1"], ["c0r1", "c1r1"], ["c1r1", "c1r0"]]}},
            "search.keep.dry: the face 'c0r0', 'c1r0' is fixed dry inside a block of fixed inner faces",
        ),
        (
            ["abc", "###"],  # supports that touch are one block, so both cells are one with them
            {"keep": {"dry": [["c0r0", "c1r0"]], "inner": [["c0r0", "c0r1"], ["c1r0", "c1r1"]]}},
            "search.keep.dry: the face 'c0r0', 'c1r0' is fixed dry inside a block of fixed inner faces",
        ),
        (SQUARE, {"block_cells": [5, None]}, "search.block_cells: the least is 5, but the block of 'c0r0' has 4 free"),
        (SQUARE, {"block_cells": [None, 0]}, "search.block_cells: the most is 0, but the block of 'c0r0' has 1 free"),
        (["ab", "a#"], {"block_cells": [3, 3], "candidates": [["c0r0", "c0r1"]]}, "search.block_cells: the least is 3"),
        (SQUARE, {"block_cells": [3, 3]}, "search.block_cells: no number of blocks fits (at least 2, at most 1)"),
        (
            SQUARE,
            {"block_weight": [None, 13.0]},
            "search.block_weight: the most is 13, but the block of 'c0r0' has 13.7",
        ),
        (
            SQUARE,
            {"block_weight": [60.0, None]},
            "search.block_weight: the least is 60, but the block of 'c0r0' has 54.9",
        ),
        (
            SQUARE,
            {"block_extent": [None, 0.09]},
            "search.block_extent: the most is 0.09, but the block of 'c0r0' has 0.1",
        ),
        (SQUARE, {"block_extent": [0.21, None]}, "search.block_extent: the least is 0.21"),
        (SQUARE, {"blocks": [5, None]}, "search.blocks: [5, null] asked, but there can be 1 to 4"),
        (
            SQUARE,
            {"blocks": [None, 1], "block_cells": [1, 2]},
            "search.blocks: [null, 1] asked, but there can be 2 to 4",
        ),
        (SQUARE, {"dry_faces": [5, None]}, "search.dry_faces: [5, null] asked, but there can be 0 to 4"),
        (
            SQUARE,
            {"dry_faces": [None, 0], "keep": {"dry": [["c0r0", "c1r0"]]}},
            "search.dry_faces: [null, 0] asked, but there can be 1 to 4",
        ),
        (SQUARE, {"symmetry": "mirror-x"}, "search.symmetry: the scene has no mirror-x symmetry: its loads are not"),
        (["ab", "c.", "##"], {"symmetry": "mirror-x"}, "search.symmetry: the scene has no mirror-x symmetry: its elem"),
    ],
)
def test_refusals_name_the_key(rows: list[str], search: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        grid_space(rows, **search)
    text = str(caught.value)
    assert text.startswith(message)
    assert "; expected " in text
    assert "\n" not in text


def test_contradicting_scene_labels_are_refused_only_without_slits() -> None:
    document = grid_document(SQUARE, candidates=[["c0r0", "c1r0"]])
    document["labels"] = all_inner(document, dry=[["c0r1", "c0r2"]])["labels"]
    with pytest.raises(InputError, match=r"search\.segmentation: the face 'c0r1', 'c0r2' is fixed dry inside a block"):
        space_of(document)
    document["search"]["segmentation"] = False
    assert space_of(document).candidates.sum() == 1


def test_materials_are_needed_only_for_labels_that_can_occur() -> None:
    document = grid_document(SQUARE)
    del document["materials"]["inner"]
    with pytest.raises(InputError, match=r"materials\.inner"):
        space_of(document)
    document["search"] = {"block_cells": [None, 1]}
    assert space_of(document).candidates.sum() == 4
    document = grid_document(SQUARE)
    del document["materials"]["dry"]
    with pytest.raises(InputError, match=r"materials\.dry"):
        space_of(document)
    assert space_of(document, need_materials=False).candidates.sum() == 4


def test_a_space_without_candidates_on_demand() -> None:
    space = space_of(grid_document(["a", "#"]), allow_empty=True)
    assert not space.candidates.any()
    assert feasible(space, space.fixed[None]).all()


@pytest.mark.parametrize(
    ("rows", "live", "order"),
    [
        (SQUARE, None, 1),  # a horizontal body load kills the mirror
        (SQUARE, DOWN, 2),
        (SQUARE, [{"element": "c0r0", "force": [0, -1]}], 1),
        (SQUARE, [{"element": "c0r0", "force": [1, 0]}, {"element": "c1r0", "force": [-1, 0]}], 2),
        (SQUARE, [{"element": "c0r0", "moment": 1}, {"element": "c1r0", "moment": -1}], 2),
        (SQUARE, [{"element": "c0r0", "moment": 1}, {"element": "c1r0", "moment": 1}], 1),
        (SQUARE, [{"element": "c0r0", "force": [0, -1], "at": [0.1, 0.3]}], 1),  # its moment about the centroid tells
        (["ab#", "##c"], DOWN, 1),
        (["a", "b", "#"], DOWN, 1),  # the mirror moves no face
    ],
)
def test_symmetry_is_what_the_loads_leave(rows: list[str], live: Any, order: int) -> None:
    space = grid_space(rows, live)
    assert len(space.group) == order
    assert np.array_equal(space.group[0], np.arange(len(space.fixed)))


def ring(live: Any) -> dict[str, Any]:
    """A weightless 3 × 3 grid between four supports, as symmetric as a square can be."""
    document = grid_document([".###.", "#aaa#", "#aaa#", "#aaa#", ".###."], live=live)
    document["materials"]["density"] = 0
    return document


def test_all_symmetries_of_a_square() -> None:
    spin = [{"element": "c2r2", "moment": 1.0}]
    assert len(space_of(ring(spin)).group) == 4
    pull = [{"element": e, "force": f} for e, f in (("c1r2", [-1, 0]), ("c3r2", [1, 0]))]
    assert len(space_of(ring(pull)).group) == 4
    pull += [{"element": e, "force": f} for e, f in (("c2r1", [0, 1]), ("c2r3", [0, -1]))]
    space = space_of(ring(pull))
    assert len(space.group) == 8
    images = {tuple(p) for p in space.group.tolist()}
    assert {tuple(p[q]) for p in space.group for q in space.group} == images
    assert len(space_of(ring(pull) | {"search": {"symmetry": "none"}}).group) == 1
    mirror = space_of(ring(pull) | {"search": {"symmetry": "mirror-x"}})
    assert mirror.symmetry.matrices[1].tolist() == [[-1, 0], [0, 1]]


def test_points_of_large_scenes_are_matched_by_a_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    """All distances or a tree of points: the same isometries, elements and faces."""
    rows = ["." + "a" * 6 + "."] * 3 + ["#" * 8]
    document = grid_document(rows, live=[{"element": "c3r0", "force": [0, -1]}, {"element": "c4r0", "force": [0, -1]}])
    by_distances = space_of(document).symmetry
    monkeypatch.setattr("jld_explore.space.symmetry._FEW", 0)
    by_tree = space_of(document).symmetry
    assert len(by_tree) == 2
    for one, other in ((by_distances.elements, by_tree.elements), (by_distances.faces, by_tree.faces)):
        assert np.array_equal(one, other)


def test_labels_strengths_and_candidates_break_symmetry() -> None:
    assert len(grid_space(["abc", "def", "###"], DOWN).group) == 2
    assert len(grid_space(["abc", "def", "###"], DOWN, keep={"dry": [["c0r0", "c1r0"]]}).group) == 1
    assert len(grid_space(["abc", "def", "###"], DOWN, keep={"dry": [["c1r0", "c1r1"]]}).group) == 2
    document = grid_document(SQUARE, live=DOWN)
    ends = {"c0": [[0, 0.1], [0.1, 0.1]], "c1": [[0.1, 0.1], [0.2, 0.1]]}
    contacts: list[dict[str, Any]] = [
        {"elements": [f"{c}r1", f"{c}r2"], "polygon": polygon} for c, polygon in ends.items()
    ]
    contacts += [
        {"elements": [f"{c}r0", f"{c}r1"], "polygon": [[x, 0.2], [x + 0.1, 0.2]]} for c, x in (("c0", 0), ("c1", 0.1))
    ]
    document["interfaces"] = contacts
    assert len(space_of(document).group) == 2
    contacts[0]["friction_coefficient"] = 0.5
    assert len(space_of(document).group) == 1


def test_turned_assembly_keeps_its_symmetry_but_not_its_boxes() -> None:
    angle = 2 * np.pi / 6
    corner = [[float(np.cos(i * angle)), float(np.sin(i * angle))] for i in range(6)]
    shapes = {f"t{i}": [[0.0, 0.0], corner[i], corner[(i + 1) % 6]] for i in range(6)}
    for i in range(6):
        middle = np.array(corner[i]) + np.array(corner[(i + 1) % 6])
        outer = [(np.array(c) + middle).tolist() for c in (corner[(i + 1) % 6], corner[i])]
        shapes[f"s{i}"] = [corner[i], corner[(i + 1) % 6]][::-1] + outer[::-1]
    spin = [{"element": f"t{i}", "moment": 1.0} for i in range(6)]
    document = polygons(shapes, [f"s{i}" for i in range(6)], spin)
    document["materials"]["density"] = 0
    assert len(space_of(document).group) == 6
    document["search"] = {"block_extent": [None, 5.0]}
    assert len(space_of(document).group) == 2


def test_group_of_boxes_in_space() -> None:
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]

    def order(live: list[dict[str, Any]]) -> int:
        document = grid_document(["a", "#"], live=live)
        del document["grid"]
        document["elements"] = [
            {
                "id": f"c{i}{j}{k}",
                "vertices": [
                    [float(i + x), float(j + y), float(k + z)] for x in (0, 1) for y in (0, 1) for z in (0, 1)
                ],
                "faces": faces,
                "support": k == 0,
            }
            for i in range(2)
            for j in range(2)
            for k in range(2)
        ]
        return len(space_of(document).group)

    top = [f"c{i}{j}1" for i in range(2) for j in range(2)]
    assert order([{"body": [0, 0, -1]}]) == 8
    assert order([{"body": [1, 0, 0]}]) == 2
    assert order([{"body": [1, 1, 0]}]) == 2
    assert order([{"body": [1, 2, 0]}]) == 1
    assert order([{"element": e, "moment": [0, 0, 1]} for e in top]) == 4  # a moment turns over in a mirror
    assert order([{"element": e, "moment": [1, 0, 0]} for e in top]) == 2


def test_flagship_group() -> None:
    scene = load_scene(ROOT / "scenes" / "flat_beam_arch.json")
    space = search_space(scene, build_assembly(scene))
    assert space.candidates.sum() == 22
    assert space.symmetry.matrices[1].tolist() == [[-1, 0], [0, 1]]
    ids, moved = space.assembly.elements.ids, space.symmetry.elements[1]
    assert [ids[moved[space.assembly.elements.index[e]]] for e in ("c0r0", "c2r1", "c0r3")] == ["c4r0", "c2r1", "c4r3"]


def test_groups_of_large_scenes_are_found_at_once() -> None:
    space = grid_space(["a" * 17] * 17 + ["#" * 17], DOWN)
    assert len(space.group) == 2


def test_symmetries_of_a_large_grid_take_no_table_of_pairs() -> None:
    """3 600 cells: a table of pairs alone would be 100 MB."""
    rows = ["a" * 60] * 60 + ["#" * 60]
    scene = parse_scene(grid_document(rows, live=[{"body": [0, -1]}]))
    assembly = build_assembly(scene)
    tracemalloc.start()
    space = search_space(scene, assembly)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(space.group) == 2
    assert peak < 40e6
