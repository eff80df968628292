"""Packed bits, blocks, slits and canonical forms, against definitions spelt out element by element."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from cases import grid_assembly, grid_document
from jld_core import Assembly, build_assembly, parse_scene
from jld_core.arrays import Bits
from jld_explore.space import labelling
from jld_explore.space.labelling import blocks_of, connectivity, slits
from jld_explore.space.limits import block_sizes


def plain_blocks(assembly: Assembly, labels: Bits, touching: list[tuple[int, int]]) -> list[int]:
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
def test_packing_and_text_come_back(rows: Bits) -> None:
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
    graph = connectivity(assembly)
    index = assembly.elements.index
    pairs = [(index[a], index[b]) for a, b in touching]
    assert [tuple(pair) for pair in graph.touching.tolist()] == sorted(pairs)
    m = len(assembly.interfaces)
    labels = np.array(np.unravel_index(np.arange(2**m), (2,) * m)).T.astype(bool)
    expected = np.array([plain_blocks(assembly, row, pairs) for row in labels])
    assert np.array_equal(blocks_of(graph, labels), expected)
    assert np.array_equal(blocks_of(graph, labels[5]), expected[5])
    inside = expected[:, graph.a] == expected[:, graph.b]
    assert np.array_equal(slits(graph, labels), labels & inside)
    assert np.array_equal(slits(graph, labels[5]), (labels & inside)[5])


def test_blocks_of_long_chains_and_no_rows() -> None:
    assembly = grid_assembly(["#" + "a" * 40, "." * 40 + "a", "#" + "a" * 40])
    graph = connectivity(assembly)
    m = len(assembly.interfaces)
    assert not blocks_of(graph, np.zeros(m, dtype=bool)).any()
    assert blocks_of(graph, np.ones((0, m), dtype=bool)).shape == (0, len(assembly.elements))
    assert np.array_equal(blocks_of(graph, np.ones(m, dtype=bool)), np.arange(len(assembly.elements)))


def test_blocks_do_not_depend_on_the_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = connectivity(grid_assembly(["abc", "def", "###"]))
    labels = np.random.default_rng(1).random((50, len(graph.a))) < 0.5
    whole = blocks_of(graph, labels)
    monkeypatch.setattr(labelling, "_ENTRIES", 60)
    assert np.array_equal(blocks_of(graph, labels), whole)


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
    assert connectivity(assembly).touching.tolist() == [[1, 2]]


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


def test_sizes_count_free_elements_only() -> None:
    assembly = grid_assembly(["ab", "cd", "##"])
    labels = np.zeros((1, len(assembly.interfaces)), dtype=bool)
    sizes = block_sizes(assembly, blocks_of(connectivity(assembly), labels))
    weight = 1400 * 9.81 * 0.1**3
    assert sizes["block_cells"][0].tolist() == [4, 0, 0, 0, 0, 0]
    assert sizes["block_weight"][0, 0] == pytest.approx(4 * weight)
    assert sizes["block_extent"][0, 0] == pytest.approx(0.2)
