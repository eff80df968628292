"""Time limits: what is kept back for writing, and what is not begun because it would end late."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import grid_document
from jld_core import build_assembly, parse_scene, samples
from jld_core.deadline import Deadline
from jld_explore import ExploreSettings, explore, read_folder
from jld_explore.evaluation import field_pool
from jld_explore.evaluation.field_pool import FieldPool
from jld_explore.report import folder, page_of_study, write_pictures
from jld_explore.writing_time import LATENESS, PAGE, PICTURES, TABLES, lateness, later, search_deadline


@pytest.mark.parametrize(("limit", "allowed"), [(None, 2.0), (0.5, 2.0), (10.0, 2.0), (40.0, 2.0), (100.0, 5.0)])
def test_a_limit_is_passed_by_2_s_or_a_twentieth(limit: float | None, allowed: float) -> None:
    assert LATENESS == (2.0, 0.05)
    assert lateness(limit) == allowed
    settings, deadline = ExploreSettings(seconds=limit), Deadline(100.0)
    ends = [later(deadline, settings, share).end - deadline.end for share in (TABLES, PAGE, PICTURES)]
    assert ends == sorted(ends)
    assert ends[-1] < allowed


def test_drawing_is_kept_back_from_the_limit() -> None:
    """Each part of what is written prolongs it, and half of a limit is left for the search however busy the machine."""
    small, large = (build_assembly(samples.grid(columns=n, rows=n)) for n in (3, 30))

    def kept(assembly: Any, seconds: float, pictures: bool = True, fields: bool = False, busy: float = 1.0) -> float:
        deadline = Deadline(1e6, time.perf_counter() - busy * time.process_time())
        settings = ExploreSettings(seconds=seconds, pictures=pictures)
        return deadline.end - search_deadline(deadline, settings, assembly, fields=fields).end

    assert kept(small, 10.0) < kept(large, 10.0) < 1.0
    assert kept(small, 10.0) < kept(small, 10.0, fields=True)
    assert kept(small, 10.0) < kept(small, 10.0, busy=3.0) < kept(small, 10.0, busy=30.0) <= 5.0
    assert kept(small, 1000.0) == 0.0
    assert search_deadline(Deadline(), ExploreSettings(), small, fields=True).limited is False


def test_pictures_are_begun_only_if_they_end_in_time(tmp_path: Path) -> None:
    scene = parse_scene(grid_document(["ab", "cd", "##"]))
    done = explore(scene, tmp_path / "out", driver="enumeration", pictures=False, seconds=60.0)
    written, missing = write_pictures(done, deadline=Deadline(1.0))
    assert (written, len(missing)) == ([], 5)
    written, missing = write_pictures(done, deadline=Deadline(6.0), busy=6.0)
    assert (written, len(missing)) == ([], 5)


def test_pictures_of_large_scenes_take_longer(tmp_path: Path) -> None:
    """Those of 2 500 cells, whose best layout is solved again, were begun with 1.2 s left and took 4.5 s."""
    done = explore(samples.grid(columns=4, rows=3), tmp_path / "out", driver="random", budget=1, pictures=False)
    small = folder._drawing_seconds("best", done)
    large = folder._drawing_seconds("best", replace(done, assembly=build_assembly(samples.grid(columns=50, rows=50))))
    assert small < 1.4
    assert large > 4.0


def test_the_picture_of_fields_has_a_time_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It refined for 2 s whatever the limit, so that a search of 10 s ended 2.1 s late."""
    asked: list[float] = []
    monkeypatch.setattr(folder, "_field_picture", lambda _, seconds: asked.append(seconds))
    monkeypatch.setattr("jld_core.views.figures.save_figure", lambda *_: None)
    document = grid_document(["ab", "##"]) | {"cracks": {"kind": "fields"}}
    done = explore(parse_scene(document), tmp_path / "out", driver="enumeration", pictures=False, seconds=30.0)
    missing = write_pictures(done, deadline=Deadline(4.0), fields=3.0)[1]
    assert (asked, "best.png" in missing) == ([], True)
    assert "best.png" not in write_pictures(done, deadline=Deadline(60.0), fields=0.5)[1]
    assert asked == [0.5]


def test_a_page_is_written_without_forces_that_would_be_late(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The best row was solved again though its evaluation said that it takes a second."""
    done = explore(parse_scene(grid_document(["ab", "##"])), tmp_path / "out", driver="enumeration", pictures=False)
    done.results.loc[:, "seconds"] = 1.0

    def solved(*_: object) -> None:
        pytest.fail("it is solved")

    monkeypatch.setattr(page_of_study.CaseAnalysis, "solve", solved)
    page_of_study.write_report(done, deadline=Deadline(0.5))
    assert (done.folder / "report.html").exists()
    assert json.loads((read_folder(done.folder).folder / "summary.json").read_text())["best"] is not None


@pytest.mark.parametrize(("jobs", "count"), [(1, 2), (2, 4)])
def test_layouts_are_refined_together_only_as_far_as_time_allows(
    jobs: int, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four layouts one after another passed the limit, as each was expected to end in time by itself."""
    assembly = build_assembly(parse_scene(grid_document(["abc", "###"])))
    rows = np.repeat(assembly.labels[None], 4, axis=0)
    pool = FieldPool(assembly, rows, Deadline(100.0))
    pool.tasks.jobs = jobs
    monkeypatch.setattr(field_pool, "mesh_seconds", lambda *_: 30.0)  # with caution 45
    monkeypatch.setattr(field_pool, "zip", lambda *parts, strict: [], raising=False)
    taken: list[int] = []
    monkeypatch.setattr(pool.tasks, "run", lambda _, tasks: taken.append(len(tasks)) or [])
    pool.refine(range(4), np.zeros(4))
    assert taken == [count]
    assert not pool.given_up.any()
