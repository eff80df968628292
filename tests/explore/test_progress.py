"""What a running search reports: the best layout so far."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import pytest

from jld_core import build_assembly, parse_scene, solve
from jld_explore import ExploreSettings, Progress, explore
from jld_explore.cli import explore as progress
from jld_explore.space import from_string
from scenes_of_pages import small_scene


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("driver", ["enumeration", "exact", "hillclimb"])
def test_progress_names_the_layout_of_its_best(driver: str, tmp_path: Path) -> None:
    """Solved here, the layout reported last has the λ reported with it, which is the best of the search."""
    scene = parse_scene(small_scene())
    told: list[Progress] = []
    settings = ExploreSettings(driver=driver, jobs=1, pictures=False)
    done = explore(scene, tmp_path / "out", settings, report=told.append)
    assert told[-1].best == pytest.approx(done.summary.best, rel=1e-6)
    labels = from_string(told[-1].labelling)
    assert solve(build_assembly(scene), labels).load_factor == pytest.approx(told[-1].best, rel=1e-6)
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


@pytest.mark.parametrize(
    ("done", "total", "left", "words"),
    [(50, 100, 7.0, "7 s left"), (50, 100, 700.0, "10 s left"), (0, 100, 3.0, "3 s left"), (9, None, math.inf, "")],
)
def test_progress_says_how_much_time_is_left(done: int, total: int | None, left: float, words: str) -> None:
    """That of the limit, or of the layouts that are left if they end earlier; it was that of the layouts alone."""
    assert progress._time_left(Progress(done, total, done, 1.0, 10.0, left=left)) == words


@pytest.mark.usefixtures("without_pictures")
def test_the_bar_shows_time_left_bound_and_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Progress] = []
    explore(parse_scene(small_scene()), tmp_path / "out", driver="enumeration", seconds=100.0, report=told.append)
    assert all(0.0 < one.left < 100.0 for one in told)
    bar = progress.ProgressBar("wall")
    shown: dict[str, object] = {}
    monkeypatch.setattr(bar._bar, "update", lambda _, **fields: shown.update(fields))
    bar(Progress(9, None, 9, 1.5, 10.0, 2.0, 0.25, "", 40.0))
    assert (shown["best"], shown["left"]) == ("best λ 1.5 ≤ 2, gap 25.00%", "40 s left")
