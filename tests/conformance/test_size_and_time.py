"""Scenes too large and times too short: what is said beforehand, what is refused, and what a search has to show."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks import large as growth
from benchmarks.scenes import brick_wall, cubes, vault

from cases import grid_document
from command import Command, saved
from jld_core import Scene, build_assembly, parse_scene, samples
from jld_core.geometry import planar_contacts
from jld_core.models import cost_estimate
from jld_explore import ExploreSettings, explore
from jld_explore.cli import check, ending
from jld_explore.drivers import DRIVERS
from jld_explore.evaluation import EvaluatorSettings, evaluator_of

SCENE = grid_document(["aaaa", "aaaa", "aaaa", "####"], block_cells=[1, 3])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("driver", DRIVERS)
def test_a_search_with_hardly_any_time_has_a_result(driver: str, tmp_path: Path) -> None:
    settings = ExploreSettings(driver=driver, seconds=0.0, jobs=1, pictures=False)
    done = explore(parse_scene(SCENE), tmp_path / "out", settings)
    assert (done.summary.stop_reason, len(done.results)) == ("time", 1)
    assert done.summary.bound >= done.summary.best


def test_an_evaluation_that_outlasts_the_limit_is_done_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers that answer nothing in time: the labelling that is owed is evaluated by the search itself."""
    monkeypatch.setenv("JLD_KERNEL", "off")
    monkeypatch.setattr("jld_explore.evaluation.pool.GRACE", 0.0)
    scene = parse_scene(SCENE)
    settings = ExploreSettings(driver="random", seconds=0.0, jobs=2, pictures=False)
    done = explore(scene, tmp_path / "out", settings)
    assert (done.summary.stop_reason, len(done.results)) == ("time", 1)
    alone = evaluator_of(build_assembly(scene), EvaluatorSettings())
    assert done.summary.best == pytest.approx(alone.evaluate(done.layout(1).labels).load_factor, rel=1e-9)


def test_long_analyses_are_announced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    large = build_assembly(parse_scene(growth.document("planar", 80)))
    assert 5.0 < cost_estimate(large).seconds < 60.0
    assert cost_estimate(build_assembly(parse_scene(SCENE))).long is None
    monkeypatch.setattr("jld_core.models.costs.LONG", 0.0)
    said: list[str] = []
    settings = ExploreSettings(driver="random", budget=1, seconds=9.0, jobs=1, pictures=False)
    explore(parse_scene(SCENE), tmp_path / "out", settings, announce=said.append)
    assert said[0].startswith("one layout of this size is expected to take some 0 s to evaluate; the time limit may")


@pytest.mark.parametrize("command", ["check", "solve", "explore"])
@pytest.mark.parametrize(
    ("content", "limit", "faces"),
    [
        (SCENE, 1.5025e8, "at least 21 faces take at least"),
        (growth.document("spatial", 2), 1.502e8, "at least 16 faces take at least"),
        (brick_wall(2, 2).model_dump(mode="json", exclude_defaults=True), 1.505e8, "at least 27 faces take at least"),
        (samples.wall().model_dump(mode="json", exclude_defaults=True), 1.508e8, "99 faces take some"),
    ],
)
def test_a_scene_too_large_for_the_memory_is_refused(
    command: str,
    content: dict[str, Any],
    limit: float,
    faces: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    jld: Command,
) -> None:
    """Of hopeless scenes, contacts are not even built; others are refused by the number of their faces."""
    file = saved(tmp_path / "scene.json", content)
    monkeypatch.setattr("jld_core.models.costs.memory_limit", lambda: limit)
    if faces.startswith("at least"):
        monkeypatch.delattr("jld_explore.cli.check.build_assembly")
    out = ("--out", tmp_path / "out") if command == "explore" else ()
    jld(command, file, *out).refused(
        f"{file}: {faces} 0.2 GB of memory to evaluate; expected a scene that the {limit / 1e9:.1f} GB"
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("make", [lambda: cubes(3), lambda: brick_wall(3, 2), vault])
def test_contacts_that_are_certain_are_no_more_than_there_are(make: Callable[[], Scene], *, turned: bool) -> None:
    """Certain contacts are all of boxes along the axes and of elements with equal faces, and never too many."""
    scene = make()
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0] if turned else np.eye(3)
    elements = scene.elements or []
    vertices = [np.array(element.vertices) @ turn.T for element in elements]
    faces = [tuple(tuple(loop) for loop in element.faces or ()) for element in elements]
    found = planar_contacts.certain_contacts(vertices, faces, np.array([element.support for element in elements]))
    there = len(build_assembly(scene).interfaces)
    assert 0 < found <= there
    assert found == there or (turned and make is not vault)


def test_memory_that_runs_out_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jld: Command) -> None:
    def fail(*_: object) -> None:
        raise MemoryError("Unable to allocate 61.0 GiB for an array")

    monkeypatch.setattr(check, "load_scene", fail)
    outcome = jld("check", tmp_path / "scene.json")
    assert (outcome.code, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    assert outcome.err.startswith(
        "jld: memory ran out: Unable to allocate 61.0 GiB for an array; expected a scene that"
    )
    assert 1e8 < ending.memory_limit() <= os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


@pytest.mark.parametrize("kind", growth.SIZES)
def test_growth_is_measured_phase_by_phase(kind: str, tmp_path: Path) -> None:
    file = saved(tmp_path / "scene.json", growth.document(kind, 4))
    told = list(growth.phases(file))
    expected = ("scene", "contacts", "λ") if kind in growth.DRY_WALLS else growth.PHASES
    assert sorted(one["phase"] for one in told) == sorted(expected)
    found = {"kind": kind, "edge": 4, "seconds": {one["phase"]: one["seconds"] for one in told}}
    found |= {"memory": {one["phase"]: one["memory"] for one in told}}
    assert "over 90 s" in growth.row_of({**found, "memory": {}, "ended": "90 s"})
