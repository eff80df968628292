"""What a running search reports: the best layout so far."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from jld_core import build_assembly, parse_scene, solve
from jld_explore import ExploreSettings, explore
from jld_explore.space import from_string
from jld_explore.study_state import Progress
from scenes_of_pages import small_scene


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("driver", ["enumeration", "exact", "hillclimb"])
def test_progress_names_the_layout_of_its_best(driver: str, tmp_path: Path) -> None:
    """Solved here, the layout reported last has the λ reported with it, which is the best of the search."""
    scene = parse_scene(small_scene())
    told: list[Progress] = []
    settings = ExploreSettings(driver=driver, jobs=1, pictures=False)
    done = explore(scene, tmp_path / "out", settings, report=told.append)
    assert told[-1].best == done.summary.best
    labels = from_string(told[-1].labelling)
    assert solve(build_assembly(scene), labels).load_factor == pytest.approx(told[-1].best, rel=1e-8)
    firsts = [one for one in told if one.labelling]
    assert all(a.best <= b.best for a, b in itertools.pairwise(firsts))


@pytest.mark.usefixtures("without_pictures")
def test_cells_left_out_are_letters_of_their_own(tmp_path: Path) -> None:
    document = small_scene()
    document["search"] = {"void": {"cells": ["c2r0"], "most": 0.3}}
    told: list[Progress] = []
    explore(parse_scene(document), tmp_path / "out", ExploreSettings(jobs=1, pictures=False), report=told.append)
    faces = build_assembly(parse_scene(document)).faces
    assert {len(one.labelling) for one in told if one.labelling} == {faces}
    assert all(set(one.labelling) <= set("div") for one in told)
