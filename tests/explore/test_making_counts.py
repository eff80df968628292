"""Counts of sawing: lengths, faces and set-ups of all blocks, against hand counts and the cutting list."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cases import grid_document
from jld_core import InputError, Scene, build_assembly, parse_scene, samples
from jld_core.exchange import Layout
from jld_explore import explore, search_space
from jld_explore.space.counts import counts
from jld_explore.space.search_space import feasible
from jld_practice.printed import making_of, stones_of

ROWS = ["aaa", "aaa", "###"]


def values(scene: Scene, labels: list[np.ndarray[Any, Any]]) -> dict[str, np.ndarray[Any, Any]]:
    """Values of all counts of some labellings."""
    assembly = build_assembly(scene)
    space = search_space(scene, assembly, allow_empty=True, need_materials=False)
    return dict(counts(assembly, np.array(labels), space.graph, space.limits.block_shapes))


def test_sawing_is_counted_by_hand() -> None:
    """Cells of 0.1 m: six squares; one rectangle of 3 × 2; three columns of two."""
    scene = parse_scene(grid_document(ROWS))
    assembly = build_assembly(scene)
    upright = abs(assembly.interfaces.normal[:, 0]) > 0.5
    every = np.ones(len(assembly.interfaces), dtype=bool)
    one = ~assembly.free_faces
    columns = np.where(assembly.free_faces, upright, True)
    found = values(scene, [every, one, columns])
    assert found["sawn_length"] == pytest.approx([6 * 0.4, 1.0, 3 * 0.6], rel=1e-12)
    assert found["saw_cuts"].tolist() == [24, 4, 12]
    assert found["saw_set_ups"].tolist() == [2, 2, 2]


@pytest.mark.parametrize("name", ["grid", "arch", "vault"])
def test_counts_are_those_of_the_cutting_list(name: str) -> None:
    """Random layouts without slits: the counts come from elements and faces, the list from the united outlines."""
    moulds: dict[str, Any] = {"moulds": {"rotate": True, "flip": True}}
    if name == "grid":
        scene = parse_scene(grid_document(ROWS, **moulds))
    else:
        made = samples.arch(voussoirs=7) if name == "arch" else samples.vault(voussoirs=5, courses=2)
        document = made.model_dump(mode="json", exclude_defaults=True)
        document["search"] = {**document.get("search", {}), **moulds}
        scene = parse_scene(document)
    assembly = build_assembly(scene)
    rng = np.random.default_rng(5)
    labels = []
    for _ in range(6):
        kept = np.ones(len(assembly.interfaces), dtype=bool)
        part = rng.integers(0, 3, len(assembly.elements))
        a, b = assembly.interfaces.a, assembly.interfaces.b
        kept[assembly.free_faces] = (part[a] != part[b])[assembly.free_faces]
        labels.append(kept)
    found = values(scene, labels)
    for k, row in enumerate(labels):
        layout = Layout(scene, assembly, row)
        made_of = making_of(stones_of(layout))
        depth = layout.thickness if assembly.dimension == 2 else 1.0
        assert found["sawn_length"][k] * depth == pytest.approx(made_of.sawn, rel=1e-6)
        assert found["saw_cuts"][k] == made_of.cuts
        assert found["shapes"][k] == made_of.moulds
        assert found["saw_set_ups"][k] == made_of.set_ups


def test_a_limit_on_sawing_is_kept_and_the_front_is_that_of_all_layouts() -> None:
    document = grid_document(ROWS, front={"counts": ["sawn_length", "shapes"], "sense": "min"})
    every = explore(parse_scene(document), driver="enumeration").results
    document["search"] |= {"sawn_length": [None, 1.6], "saw_cuts": [None, 12], "saw_set_ups": [None, 4]}
    limited = explore(parse_scene(document), driver="enumeration").results
    kept = (every["sawn_length"] <= 1.6 + 1e-9) & (every["saw_cuts"] <= 12) & (every["saw_set_ups"] <= 4)
    assert 0 < len(limited) < len(every)
    assert sorted(limited["labelling"]) == sorted(every["labelling"][kept])


@pytest.mark.parametrize(
    ("search", "words"),
    [
        (
            {"blocks": [None, 2], "block_mass": [None, 3.0]},
            "search.blocks: [null, 2] asked, but there can be 3 to 6, since search.block_mass is [null, 3]; "
            "expected a range that meets this, or a wider search.block_mass",
        ),
        ({"shapes": [4, None], "block_cells": [2, None]}, "search.shapes: [4, null] asked, but there can be 1 to 3"),
        ({"shapes": [None, 0]}, "search.shapes: [null, 0] asked, but there can be 1 to 6"),
        ({"sawn_length": [None, 0.9]}, "search.sawn_length: [null, 0.9] asked, but there can be 1 to 2.4"),
        (
            {"saw_cuts": [None, 8], "block_cells": [None, 2]},
            "search.saw_cuts: [null, 8] asked, but there can be 9 and more (of at least 3 blocks",
        ),
        ({"saw_set_ups": [None, 1]}, "search.saw_set_ups: [null, 1] asked, but there can be 2 and more"),
    ],
)
def test_contradicting_limits_are_refused_with_the_contradiction(search: dict[str, Any], words: str) -> None:
    scene = parse_scene(grid_document(ROWS, **search))
    with pytest.raises(InputError) as caught:
        search_space(scene, build_assembly(scene))
    assert str(caught.value).startswith(words)


def test_shapes_that_must_exist_are_counted() -> None:
    """Stones that are too heavy to be joined keep their shapes: three of them are no two moulds."""
    squares = [[[x, 0], [x + w, 0], [x + w, 1], [x, 1]] for x, w in ((0, 1), (1, 2), (3, 3))]
    elements = [{"id": f"e{k}", "polygon": p, "weight": float(10 * (k + 1))} for k, p in enumerate(squares)]
    elements.append({"id": "s", "polygon": [[0, -1], [6, -1], [6, 0], [0, 0]], "support": True})
    document: dict[str, Any] = {
        "elements": elements,
        "materials": {"dry": {"friction_angle": 30}, "inner": {"tensile_strength": 1e3, "shear_strength": 1e3}},
        "loads": {"live": [{"body": [1, 0]}]},
        "search": {"block_weight": [None, 30.0], "shapes": [None, 2]},
    }
    scene = parse_scene(document)
    # the two lightest may be joined, the third stands alone
    search_space(scene, build_assembly(scene))
    document["search"]["block_weight"] = [None, 29.0]
    document["elements"][2]["weight"] = 29.0
    scene = parse_scene(document)
    with pytest.raises(InputError, match=r"search.shapes: \[null, 2\] asked, but there can be 3 to 3"):
        search_space(scene, build_assembly(scene))


def test_only_limits_that_no_layout_meets_are_refused() -> None:
    """All 128 labellings of six cells: what is refused has none, with random limits of every kind."""
    plain = parse_scene(grid_document(ROWS))
    assembly = build_assembly(plain)
    free = np.flatnonzero(assembly.free_faces)
    every = np.ones((2 ** len(free), len(assembly.interfaces)), dtype=bool)
    every[:, free] = (np.arange(len(every))[:, None] >> np.arange(len(free))) & 1
    rng = np.random.default_rng(8)
    refused = 0
    for _ in range(150):
        search: dict[str, Any] = {}
        for key, most in (("blocks", 7), ("shapes", 4), ("saw_cuts", 26), ("saw_set_ups", 9), ("sawn_length", 2.6)):
            if rng.random() < 0.4:
                low, high = sorted(rng.random(2) * most)
                if key != "sawn_length":
                    low, high = int(low), int(high)
                search[key] = [None if rng.random() < 0.5 else low, None if rng.random() < 0.3 else high]
        search["block_cells"] = [None, int(rng.integers(1, 7))]
        scene = parse_scene(grid_document(ROWS, **search))
        try:
            search_space(scene, assembly)
        except InputError:
            refused += 1
            space = search_space(plain, assembly)
            limited = replace(space, search=scene.search)
            assert not feasible(limited, every).any(), search
    assert 20 < refused < 140
