"""Feasibility and counts of batches, against one labelling at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import grid_document
from jld_core import InputError, build_assembly, parse_scene
from jld_core import blocks_of as assembly_blocks
from jld_explore import SearchSpace, search_space
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.space import from_string
from jld_explore.space.counts import counts
from jld_explore.space.labelling import blocks_of
from jld_explore.space.reasons import reasons_against
from jld_explore.space.search_space import feasible

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
            block, other = blocks_of(one.graph, row), assembly_blocks(one.assembly, row)
            assert np.array_equal(block[:, None] == block, other[:, None] == other)


def test_fixed_labels_bind() -> None:
    space = space_of(ROWS)
    row = batch(space, "")
    row[0, ~space.candidates] = False
    assert not feasible(space, row).any()


def test_counts_leave_supports_out() -> None:
    space = space_of(["ab", "cd", "##"], candidates="all+supports")
    texts = ("", "c0r0-c1r0 c0r0-c0r1 c0r1-c0r2 c1r1-c1r2", "c0r1-c0r2 c1r1-c1r2")
    found = counts(space.assembly, batch(space, *texts), space.graph)
    assert found["dry_faces"].tolist() == [0, 2, 0]
    assert found["dry_length"].tolist() == pytest.approx([0, 0.2, 0])
    assert found["blocks"].tolist() == [1, 2, 1]
    assert found["largest_block_cells"].tolist() == [4, 3, 4]
    assert np.array_equal(counts(space.assembly, batch(space, *texts))["blocks"], found["blocks"])


def test_counts_of_blocks_around_supports() -> None:
    space = space_of(["a#b"], candidates="all+supports")
    found = counts(space.assembly, np.array([from_string("ii"), from_string("id"), from_string("dd")]))
    assert found["blocks"].tolist() == [1, 2, 2]
    assert found["largest_block_cells"].tolist() == [2, 1, 1]
    assert found["dry_faces"].tolist() == [0, 0, 0]


def test_no_rows() -> None:
    space = space_of(ROWS)
    none = np.empty((0, len(space.fixed)), dtype=bool)
    assert feasible(space, none).shape == (0,)
    assert counts(space.assembly, none)["blocks"].shape == (0,)


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
        return min(int(rows.sum(axis=1).min()) for rows, _ in Enumeration(space).batches() if len(rows))

    for cells, least in ((1, 7), (2, 4)):
        message = rf"search.dry_faces: \[null, {least - 1}\] asked, but there can be {least} to 7"
        with pytest.raises(InputError, match=message):
            fewest(least - 1, cells)
        assert fewest(least, cells) == least + 3  # three faces to the support are dry as well
    assert fewest(7, 6) == 3
