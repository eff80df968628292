"""The record of a study: torn anywhere it is repaired, and a million rows stay usable."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from cases import grid_document
from jld_core.arrays import Bits
from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.limit import Status
from jld_core.scene import load_scene, parse_scene
from jld_explore.evaluation import CERTIFICATE, STORE_FILE, Evaluation, Store
from jld_explore.report import tables
from jld_explore.space import block_sizes, blocks_of, connectivity, counts, search_space, unpack
from paths import SCENES

HEADER = {"scene": "a", "seed": 1}


def labellings(count: int, faces: int = 11) -> Bits:
    return ((np.arange(count)[:, None] >> np.arange(faces)) & 1).astype(bool)


def evaluations(count: int) -> list[Evaluation]:
    nan = float("nan")
    kinds = [
        lambda n: Evaluation(Status.COLLAPSE, n - 0.5, n + 0.5, float(n), seconds=0.001),
        lambda n: Evaluation(Status.LOCKED, float(n), nan, nan),
        lambda n: Evaluation(Status.UNSTABLE, nan, nan, nan, settled=CERTIFICATE),
        lambda n: Evaluation(Status.COLLAPSE, nan, nan, n + 1.0, zero_dilation=float(n)),
    ]
    return [kinds[n % 4](n) for n in range(count)]


def filled(folder: Path, count: int = 6) -> Path:
    store = Store(folder, HEADER, 11)
    store.append(labellings(count)[:2], [1, 2], evaluations(count)[:2])
    store.append(labellings(count)[2:], [1] * (count - 2), evaluations(count)[2:])
    store.close()
    return folder / STORE_FILE


def test_what_was_written_is_found(tmp_path: Path) -> None:
    filled(tmp_path)
    store = Store(tmp_path, HEADER, 11)
    for labels, expected in zip(labellings(6), evaluations(6), strict=True):
        assert repr(store.find(labels)) == repr(expected)
    assert store.find(labellings(7)[6]) is None
    assert len(store) == 6
    assert store.rows["multiplicity"].tolist() == [1, 2, 1, 1, 1, 1]
    assert store.repaired == 0
    store.close()


def test_torn_at_every_byte(tmp_path: Path) -> None:
    """A file cut anywhere holds all records that were whole, takes the rest again, and ends up the same."""
    path = filled(tmp_path / "whole")
    content = path.read_bytes()
    start = content.index(b"\n") + 1
    size = (len(content) - start) // 6
    for cut in range(len(content) + 1):
        folder = tmp_path / "torn"
        folder.mkdir(exist_ok=True)
        (folder / STORE_FILE).write_bytes(content[:cut])
        store = Store(folder, HEADER, 11)
        whole = max(0, cut - start) // size
        assert len(store) == whole
        assert store.repaired == (cut - start - whole * size if cut >= start else 0)
        store.append(labellings(6)[whole:], [1, 2, 1, 1, 1, 1][whole:], evaluations(6)[whole:])
        store.close()
        assert (folder / STORE_FILE).read_bytes() == content


def test_torn_and_filled_with_garbage(tmp_path: Path) -> None:
    """A flipped byte ends what is believed; nothing before it is lost."""
    path = filled(tmp_path)
    content = path.read_bytes()
    start = content.index(b"\n") + 1
    size = (len(content) - start) // 6
    for place in range(start, len(content), 7):
        path.write_bytes(content[:place] + bytes([content[place] ^ 0x55]) + content[place + 1 :])
        store = Store(tmp_path, HEADER, 11)
        assert len(store) == (place - start) // size
        store.close()


def test_another_header_is_refused_by_name(tmp_path: Path) -> None:
    filled(tmp_path)
    before = (tmp_path / STORE_FILE).read_bytes()
    with pytest.raises(InputError, match="seed 1, not 2"):
        Store(tmp_path, HEADER | {"seed": 2}, 11)
    with pytest.raises(InputError, match="faces 11, not 12"):
        Store(tmp_path, HEADER, 12)
    assert (tmp_path / STORE_FILE).read_bytes() == before


def test_counts_agree_with_the_blocks() -> None:
    """The fast count and the general one, on random labellings with supports that touch and that do not."""
    for rows in (["abc", "aab", "#.#"], ["aab", "###"], ["#ab#", "#cd#"]):
        assembly = build_assembly(parse_scene(grid_document(rows, candidates="all+supports")))
        rng = np.random.default_rng(0)
        some = rng.random((9000, len(assembly.interfaces))) < rng.random((9000, 1))
        cells = block_sizes(assembly, blocks_of(connectivity(assembly), some))["block_cells"]
        found = counts(assembly, some)
        assert np.array_equal(found["blocks"], (cells > 0).sum(axis=1))
        assert np.array_equal(found["largest_block_cells"], cells.max(axis=1))


def test_a_million_rows(tmp_path: Path) -> None:
    """Opened, and its table and front made, in seconds."""
    scene = load_scene(SCENES / "flat_beam_arch.json")
    assembly = build_assembly(scene)
    space, faces, count = search_space(scene, assembly), len(assembly.interfaces), 1_000_000
    store = Store(tmp_path, HEADER, faces)
    part, rng = 50_000, np.random.default_rng(0)
    every = labellings(count, faces)
    for low in range(0, count, part):
        values = rng.random(part)
        found = [Evaluation(Status.COLLAPSE, value, value, value) for value in values.tolist()]
        store.append(every[low : low + part], [1] * part, found)
    store.close()
    start = time.perf_counter()
    store = Store(tmp_path, HEADER, faces)
    assert len(store) == count
    table = tables.results_table(store, assembly, space, "any")
    front = tables.front_table(table, "dry_faces", "max")
    seconds = time.perf_counter() - start
    store.close()
    assert len(table) == count
    assert table["rank"].iloc[-1] == count
    assert table["load_factor"].is_monotonic_decreasing
    assert front["dry_faces"].is_unique
    assert table["labelling"].iloc[0] in set(front["labelling"])
    assert np.array_equal(unpack(store.rows["labelling"][:100], faces), every[:100])
    assert seconds < 30.0  # about 5 on one core of its own
