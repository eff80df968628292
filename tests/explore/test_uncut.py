"""A cut layout that is stronger than the uncut structure: said where it is proven, and nowhere else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cases import grid_document
from jld_core import build_assembly, parse_scene, solve
from jld_explore import Exploration, ExploreSettings, explore, read_folder, search_space
from jld_explore.report import words
from jld_explore.report.languages import stronger_cut
from jld_practice.printing import content_of


def searched(folder: Path, shear: float) -> Exploration:
    """Search a pressed column that is pushed sideways: a crack has its shear strength alone, a joint has friction."""
    pushed: list[dict[str, Any]] = [{"element": "c0r0", "force": [1, 0]}]
    document = grid_document(["a", "a", "#"], live=pushed, tension=1e9, shear=shear)
    settings = ExploreSettings(driver="enumeration", jobs=1, pictures=False, check_fields=0)
    return explore(parse_scene(document), folder, settings)


def test_a_stronger_layout_is_reported_where_it_is_proven(tmp_path: Path) -> None:
    done = searched(tmp_path / "a", 1.0)
    space = search_space(done.scene, done.assembly)
    alone = solve(done.assembly, space.fixed & ~space.candidates)
    high = json.loads((tmp_path / "a" / "summary.json").read_text("utf-8"))["uncut_at_most"]
    assert high == pytest.approx(alone.load_factor, rel=1e-6)
    assert done.summary.facts["best"] > high
    assert words.facts_of_exploration(read_folder(tmp_path / "a"))["cuts"] == stronger_cut(high)
    assert content_of(tmp_path / "a", None).uncut == high
    assert content_of(tmp_path / "a", 2).uncut is None


def test_silent_where_cuts_gain_nothing(tmp_path: Path) -> None:
    done = searched(tmp_path / "a", 1e9)
    assert "uncut_at_most" not in done.summary.facts
    assert "cuts" not in words.facts_of_exploration(done)
    assert build_assembly(done.scene).labels.shape == done.assembly.labels.shape
