"""Counts of sawing: lengths, faces and set-ups of all blocks, against hand counts and the cutting list."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import grid_document
from jld_core import samples
from jld_core.build import build_assembly
from jld_core.exchange import Layout
from jld_core.scene import Scene, parse_scene
from jld_explore import explore
from jld_explore.report.making import making_of, stones_of
from jld_explore.space import search_space
from jld_explore.space.count_values import counts

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
