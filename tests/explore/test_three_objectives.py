"""Fronts of λ against two counts: what is on them, what is said of it, and that pictures and pages show it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import grid_document
from jld_core import InputError, Scene, parse_scene
from jld_core.scene.cracks import FieldCracks
from jld_explore import ExploreSettings, explore, read_folder
from jld_explore.report import words
from jld_explore.report.tables import on_front

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
    assert on_front(values[:, 0], values[:, 1:] * signs, *senses).tolist() == wanted


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
    scene = scene_of().model_copy(update={"cracks": FieldCracks(kind="fields")})
    with pytest.raises(InputError, match=r"search\.front\.counts: by fields two counts have no exact front"):
        explore(scene, tmp_path / "done", settings)
