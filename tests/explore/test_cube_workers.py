"""A proof in several processes: the same optimum and bound as by one, whoever joins, leaves or is killed on the way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from joblib.externals.loky.process_executor import TerminatedWorkerError

from cases import grid_document
from jld_core import Scene, build_assembly, parse_scene
from jld_core.batch import chosen
from jld_explore import Exploration, ExploreSettings, Progress, explore, search_space
from jld_explore.drivers.exact.certifying import certify
from jld_explore.drivers.exact.context import ProofContext
from jld_explore.drivers.exact.cube_workers import CubeWorkers, TaskResult
from jld_explore.drivers.exact.driver import Exact, MinimumCount
from jld_explore.drivers.exact.formula import EVERYTHING, Formula, split_cube
from jld_explore.drivers.exact.proof_state import ProofState
from jld_explore.verification import verify

# what blocks that crack anywhere carry, test_field_searches.py tests
pytestmark = pytest.mark.usefixtures("without_field_check")

WEAK: dict[str, Any] = {"tension": 2e3, "shear": 2e3, "block_cells": [1, 3]}
SCENES: dict[str, tuple[list[str], dict[str, Any]]] = {
    "weak": (["aaaa", "aaaa", "####"], WEAK),
    "counts": (["aaa", "aaa", "###"], {"block_cells": [1, 3], "blocks": [3, 4], "dry_faces": [4, 6]}),
    "sizes ruled out as they occur": (["aaa", "aaa", "###"], {"block_extent": [None, 0.2], "tension": 5e3}),
    "crushing": (["aaa", "aaa", "###"], {"block_cells": [1, 3], "crush_inner": 1e5}),
    "nothing stands": (["aa.", ".aa", "..#"], {"block_cells": [1, 2], "tension": 0.0, "shear": 0.0}),
}
SOLO_PROGRAMS = ExploreSettings(pictures=False, small=0)
TWO = replace(SOLO_PROGRAMS, jobs=2)


def scene_of(rows: list[str], options: dict[str, Any]) -> Scene:
    return parse_scene(grid_document(rows, **options))


def prove(scene: Scene, folder: Path, settings: ExploreSettings = TWO, **options: Any) -> tuple[Exploration, Exact]:
    """By others from the first, where there are several."""
    driver = Exact(search_space(scene, build_assembly(scene)), **{"solo_relaxations": 0, "search": 0, **options})
    return explore(scene, folder, settings, driver=driver), driver


@pytest.fixture
def _in_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Threads in the place of processes: each takes a second or two to start."""
    monkeypatch.setattr("jld_explore.evaluation.pool.make_executor", ThreadPoolExecutor)
    monkeypatch.setattr("jld_explore.drivers.exact.cube_workers.TASK_SECONDS", 0.0)


@pytest.mark.usefixtures("_in_threads")
@pytest.mark.parametrize("name", SCENES)
def test_two_processes_prove_the_same_as_one(name: str, tmp_path: Path) -> None:
    scene = scene_of(*SCENES[name])
    for aim in ("best", "front"):
        one, _ = prove(scene, tmp_path / f"one {aim}", SOLO_PROGRAMS, aim=aim, by_blocks="off")
        two, driver = prove(scene, tmp_path / f"two {aim}", aim=aim, by_blocks="off")
        # the bound at the root alone may prove all
        assert driver._sources.solves > 0 or one.summary.facts["relaxations"] <= 1
        assert two.summary.proven is one.summary.proven is True
        if one.summary.best is None:
            assert two.summary.best is None
            continue
        assert two.summary.best == pytest.approx(one.summary.best, rel=1e-6)
        assert two.summary.bound == pytest.approx(one.summary.bound, rel=2e-6)
        if aim == "front":
            fronts = [
                {row["count"]: row["load_factor"] for row in done.summary.facts["best_by_count"]} for done in (one, two)
            ]
            assert fronts[1] == pytest.approx(fronts[0], rel=1e-6)


@pytest.mark.usefixtures("_in_threads")
def test_two_find_the_same_count_of_what_is_required(tmp_path: Path) -> None:
    require = {"front": {"count": "blocks", "sense": "min"}, "require": {"load_factor": 0.6}}
    scene = scene_of([*["aaaa"] * 2, "####"], {"tension": 8e3, "shear": 8e3, "block_cells": [1, 3], **require})
    found = []
    for name, settings in (("one", SOLO_PROGRAMS), ("two", TWO)):
        driver = MinimumCount(search_space(scene, build_assembly(scene)), search=0, solo_relaxations=0)
        found.append(explore(scene, tmp_path / name, settings, driver=driver).summary.facts["require"])
        assert (driver._sources.solves > 0) is (settings is TWO)
    assert found[0]["proven"] is found[1]["proven"] is True
    assert found[0]["best"] == found[1]["best"] is not None


@pytest.mark.usefixtures("_in_threads")
@pytest.mark.skipif(chosen() is None, reason="without a kernel one thread draws and shrinks")
def test_two_threads_prove_the_same_and_hand_over_to_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of([*["aaaa"] * 4, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]})
    how: dict[str, Any] = {"solo_relaxations": None, "by_blocks": "off"}
    one, _ = prove(scene, tmp_path / "one", SOLO_PROGRAMS, **how)
    for called, jobs in ((False, 2), (True, 3)):
        if called:
            monkeypatch.setattr("jld_explore.drivers.exact.cube_workers.SOLO_RELAXATIONS", (60, 1))
        two, driver = prove(scene, tmp_path / f"{jobs}", replace(TWO, jobs=jobs), **how)
        assert (driver._sources.solves > 0) is called
        assert driver.context.relaxation.solves > 60  # by threads, before others were called
        assert two.summary.proven is True
        assert two.summary.best == pytest.approx(one.summary.best, rel=1e-6)
        assert two.summary.bound == pytest.approx(one.summary.bound, rel=2e-6)
        names = [(conflict.faces.tobytes(), conflict.labels.tobytes()) for conflict in driver.state.conflicts]
        assert len(names) > 50
        assert called or len(set(names)) == len(names)  # what both threads found is kept once
        certify(driver, scene, tmp_path / "proof.jld", None)
        assert verify(tmp_path / "proof.jld", scene).claim.bound == pytest.approx(one.summary.best, rel=2e-6)


@pytest.mark.skipif(chosen() is None, reason="without a kernel there is one thread")
def test_an_exception_in_a_thread_is_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> None:
        raise ArithmeticError("of a thread")

    monkeypatch.setattr("jld_explore.drivers.exact.conflict_generation.ConflictGenerator._add_results", broken)
    with pytest.raises(ArithmeticError, match="of a thread"):
        prove(scene_of(*SCENES["weak"]), tmp_path, solo_relaxations=None, by_blocks="off")


@pytest.mark.usefixtures("_in_threads")
def test_what_is_closed_is_on_record_and_spares_the_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # many small cubes: of the few large ones of so short a proof it is chance whether any is closed before its end
    monkeypatch.setattr("jld_explore.drivers.exact.cube_workers._CUBES_PER_WORKER", 12)
    scene = scene_of([*["aaaa"] * 4, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]})
    whole, driver = prove(scene, tmp_path / "whole", by_blocks="off")
    known = driver.state.conflicts[:]
    from_cubes = [one for one in known if one.from_cube]
    assert from_cubes
    assert whole.summary.facts["conflicts"] == len(known)
    # nothing of what is closed is above its bound, by the table of all that was evaluated
    table = whole.results[whole.results["status"] == "collapse"]
    scale = driver._scale
    for text, load in zip(table["labelling"], table["bracket_lo"], strict=True):
        labels = np.array([letter == "d" for letter in text])
        for image in labels[driver.space.group]:
            for one in from_cubes:
                if (image[one.faces] == one.labels).all():
                    assert load <= one.bound * scale * (1.0 + 1e-9)
    again, _ = prove(scene, tmp_path / "whole", replace(TWO, resume=True), by_blocks="off")
    assert again.summary.proven is True
    assert again.summary.facts["relaxations"] < 0.1 * whole.summary.facts["relaxations"]
    assert again.summary.bound == pytest.approx(whole.summary.bound, rel=1e-9)
    certify(driver, scene, tmp_path / "proof.jld", None)
    assert verify(tmp_path / "proof.jld", scene).claim.bound == pytest.approx(whole.summary.best, rel=2e-6)


def test_workers_are_at_work_once_one_has_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    """A target that changes sends a second task to a process that still starts; nobody must wait for that process."""
    held: list[tuple[Future[Any], tuple[Any, ...]]] = []

    class Starting(ThreadPoolExecutor):
        def submit(self, *task: Any) -> Future[Any]:
            held.append((Future(), task))
            return held[-1][0]

    monkeypatch.setattr("jld_explore.evaluation.pool.make_executor", Starting)
    scene = scene_of([*["aaaa"] * 3, "####"], WEAK)
    space = search_space(scene, build_assembly(scene))
    formula = Formula(space, None)
    formula.aim(0.0)
    context = ProofContext.of(space, 0, list_blocks=False)
    assert context is not None
    workers = CubeWorkers(context, 2, ProofState(space))
    for _ in range(2):
        workers.begin(formula, None, 0.0)
        workers.exchange()
    assert max(state.tasks for state in workers._worker_states.values()) > 1
    assert not workers.started
    held[0][0].set_result(TaskResult())
    workers.exchange()
    assert workers.started
    workers.close(0.0)


def test_parts_of_a_cube_cover_it() -> None:
    scene = scene_of(["aaa", "aaa", "###"], WEAK)
    space = search_space(scene, build_assembly(scene))
    every = Formula(space, None)
    rows = []
    while (labels := every.next()) is not None:
        rows.append(labels)
        every.forbid(np.arange(len(labels)), labels)
    formula, cubes = Formula(space, None), [EVERYTHING]
    for _ in range(12):
        cube = cubes.pop(0)
        cubes += split_cube(cube, formula, np.arange(len(space.fixed), dtype=float))
    assert len(cubes) > 4
    assert [sum(cube.holds(labels) for cube in cubes) for labels in rows] == [1] * len(rows)


class Mortal(ThreadPoolExecutor):
    """The first two of these die of their second task."""

    made = 0

    def __init__(self) -> None:
        super().__init__(1)
        Mortal.made += 1
        self.left = 1 if Mortal.made <= 2 else 10**9

    def submit(self, *task: Any) -> Future[Any]:
        if self.left == 0:
            dead: Future[Any] = Future()
            dead.set_exception(TerminatedWorkerError("killed"))
            return dead
        self.left -= 1
        return super().submit(*task)


def mortal(jobs: int) -> ThreadPoolExecutor:
    """Those of one worker die; those that evaluate do not."""
    return Mortal() if jobs == 1 else ThreadPoolExecutor(jobs)


@pytest.mark.usefixtures("_in_threads")
def test_processes_that_die_cost_a_moment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Mortal, "made", 0)
    monkeypatch.setattr("jld_explore.evaluation.pool.make_executor", mortal)
    scene = scene_of([*["aaaa"] * 4, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]})
    one, _ = prove(scene, tmp_path / "one", SOLO_PROGRAMS)
    two, _ = prove(scene, tmp_path / "two")
    assert Mortal.made >= 3
    assert two.summary.proven is True
    assert two.summary.best == pytest.approx(one.summary.best, rel=1e-6)


@pytest.mark.usefixtures("_in_threads")
@pytest.mark.parametrize("dies", [pytest.param(False, marks=pytest.mark.long), True])
def test_a_tree_of_blocks_is_that_of_one_job(dies: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jld_explore.drivers.exact.block_bounds.SOLO_PROGRAMS", 0)
    # where the batch solver solves them nobody else is asked
    monkeypatch.setattr("jld_core.limit.block_relaxation.BlockRelaxation.batched", False)
    monkeypatch.setattr(Mortal, "made", 0)
    if dies:
        monkeypatch.setattr("jld_explore.evaluation.pool.make_executor", mortal)
    scene = scene_of([*["aaaa"] * 4, "####"], {"block_cells": [1, 2]})
    one, first = prove(scene, tmp_path / "one", SOLO_PROGRAMS, solo_relaxations=None, by_blocks="on")
    two, second = prove(scene, tmp_path / "two", solo_relaxations=None, by_blocks="on")
    assert second._block_search._bounds.solves_in_worker > 0
    assert second._block_search.solves == first._block_search.solves > 10
    assert (Mortal.made >= 3) is dies
    assert two.summary.proven is True
    assert two.summary.best == one.summary.best
    assert two.summary.bound == one.summary.bound


PROVE = """
import sys
sys.path[:0] = {paths!r}
from pathlib import Path
from test_cube_workers import prove
from jld_core import load_scene
prove(load_scene(Path(sys.argv[1]) / "scene.json"), Path(sys.argv[1]) / "out")
"""


@pytest.mark.long
def test_a_kill_loses_nothing_proven(tmp_path: Path) -> None:
    """A worker is killed, and when another is at work in its place the search itself."""
    scene = scene_of([*["aaaa"] * 5, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]})
    (tmp_path / "scene.json").write_text(scene.model_dump_json(exclude_defaults=True), encoding="utf-8")
    code = PROVE.format(paths=[str(Path(__file__).parent), str(Path(__file__).parents[1])])
    run = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)])

    def await_conflicts(more: int) -> None:
        journal = tmp_path / "out" / "records.sqlite3-wal"
        before = journal.stat().st_size if journal.exists() else 0
        while run.poll() is None and not (journal.exists() and journal.stat().st_size > before + more):
            time.sleep(0.01)

    await_conflicts(100_000)
    helpers = psutil.Process(run.pid).children(recursive=True)
    os.kill(next(one.pid for one in helpers if "popen_loky" in " ".join(one.cmdline())), signal.SIGKILL)
    await_conflicts(50_000)
    helpers += psutil.Process(run.pid).children(recursive=True)
    os.kill(run.pid, signal.SIGKILL)
    run.wait()
    assert psutil.wait_procs(helpers, timeout=60.0)[1] == []  # they do not outlive it
    driver = Exact(search_space(scene, build_assembly(scene)), search=0)
    rest = explore(scene, tmp_path / "out", replace(SOLO_PROGRAMS, resume=True), driver=driver)
    assert rest.summary.proven is True
    assert len(driver.state.conflicts) > 50


@pytest.fixture
def cluster() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed")
    found = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, worker_dashboard_address=None
    )
    yield found
    found.close()


@pytest.mark.filterwarnings("ignore")
def test_workers_of_a_cluster_prove(cluster: Any, tmp_path: Path) -> None:
    """One at first, a second joins, the first leaves: the same optimum."""
    scene = scene_of([*["aaaa"] * 5, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]})
    one, _ = prove(scene, tmp_path / "one", SOLO_PROGRAMS)
    driver = Exact(search_space(scene, build_assembly(scene)), solo_relaxations=0, search=0)
    events: list[str] = []
    (first,) = cluster.scheduler.workers

    def raise_deferred(_: Progress) -> None:
        cube_workers = driver._sources and driver._sources.cube_workers
        if cube_workers and cube_workers.started and not events:
            cluster.scale(2)
            events.append("joined")
        if cube_workers and events == ["joined"] and len(cube_workers._pool) == 2:
            cluster.sync(cluster.scheduler.retire_workers, workers=[first], close_workers=True)
            events.append("left")

    settings = replace(SOLO_PROGRAMS, cluster=cluster.scheduler_address)
    away = explore(scene, tmp_path / "away", settings, report=raise_deferred, driver=driver)
    assert driver._sources.solves > 0
    assert events == ["joined", "left"]
    assert away.summary.proven is True
    assert away.summary.best == pytest.approx(one.summary.best, rel=1e-6)
    assert away.summary.bound == pytest.approx(one.summary.bound, rel=2e-6)
