"""Workers that die or hang, and a cluster in the place of processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from cases import grid_document
from command import refused
from fatal_labelling import FatalLabelling
from jld_core import Assembly, Deadline, InputError, Status, build_assembly, parse_scene
from jld_explore import Evaluation, ExploreSettings, Interrupted, Progress, explore, search_space
from jld_explore.drivers import DRIVERS
from jld_explore.evaluation import EvaluatorSettings, raise_deferred
from jld_explore.evaluation.pool import done_in
from jld_explore.evaluation.workers import Workers, WorkerSpec

CANCELLED = "ignore:.*tasks which were still being processed.*:UserWarning"
"""What joblib says of the tasks of a pool that was given up, which is what is tested."""


def wall() -> tuple[Assembly, Any, np.ndarray]:
    scene = parse_scene(grid_document(["aaa", "aaa", "###"]))
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    return assembly, space, DRIVERS["enumeration"](space).ask(90)


class Struck(threading.Condition):
    """The lock of a future, with a signal when it has been taken."""

    def __init__(self) -> None:
        super().__init__()
        take = self.acquire

        def acquire() -> bool:
            taken = take()
            raise_deferred(Interrupted())
            return taken

        setattr(self, "acquire", acquire)  # noqa: B010 – the class sets it for each of its objects, too


def test_a_signal_leaves_no_lock_of_a_task_taken() -> None:
    """Between the locks that `wait` takes it left them taken, and an executor waited for its own end."""
    future: Future[int] = Future()
    future._condition = Struck()
    with pytest.raises(Interrupted):
        done_in([future], 1.0)
    other = threading.Thread(target=future.set_result, args=(1,), daemon=True)
    other.start()
    other.join(120.0)
    assert not other.is_alive()


def everything(workers: Workers, rows: np.ndarray) -> list[Evaluation]:
    found: dict[int, Evaluation] = {}
    for part, evaluations in workers.run(rows):
        assert part.stop - part.start == len(evaluations)
        found |= dict(zip(range(part.start, part.stop), evaluations, strict=True))
    assert sorted(found) == list(range(len(rows)))
    return [found[n] for n in range(len(rows))]


def values(evaluations: list[Evaluation]) -> list[tuple[str, str]]:
    return [(str(e.status), repr(e.load_factor)) for e in evaluations]


def test_threads_give_the_same_result_as_one() -> None:
    assembly, _, rows = wall()
    recipe = WorkerSpec.of(assembly, EvaluatorSettings(use_batch_solver=False))
    pool = Workers(recipe, 2, rows.shape[1], batch=True)
    try:
        for some in (rows, rows[:1], rows[:3]):
            assert values(everything(pool, some)) == values(everything(Workers(recipe, 1, rows.shape[1]), some))
    finally:
        pool.close()


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_deadline_is_kept_inside_batches(jobs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JLD_KERNEL", "off")  # it would be done by then
    assembly, _, rows = wall()
    workers = Workers(WorkerSpec.of(assembly, EvaluatorSettings()), jobs, rows.shape[1], batch=jobs > 1)
    try:
        assert [part for part, found in workers.run(rows, Deadline(-1.0)) if found] == []
        found: list[Any] = []
        for seconds in (0.05, 0.25, 1.0):  # the shortest in which this machine evaluates anything
            run = workers.run(np.concatenate([rows] * 20), Deadline(seconds))
            found = found or [(part, some) for part, some in run if some]
        assert 0 < sum(len(some) for _, some in found) < 20 * len(rows)
        assert all(part.stop - part.start == len(some) for part, some in found)
    finally:
        workers.close()


@pytest.mark.filterwarnings(CANCELLED)
def test_a_worker_killed_once_costs_nothing(tmp_path: Path) -> None:
    """Workers killed from outside: their batches are tried again, and all results are those of one job."""
    assembly, _, rows = wall()
    rows = np.concatenate([rows] * 4)
    recipe = WorkerSpec.of(assembly, EvaluatorSettings())
    pool, found, killed = Workers(recipe, 2, rows.shape[1]), {}, 0
    try:
        for part, evaluations in pool.run(rows):
            found |= dict(zip(range(part.start, part.stop), evaluations, strict=True))
            if not killed:  # a second death of the same batch would rightly be recorded
                victims = [p for p in psutil.Process().children() if "popen_loky" in " ".join(p.cmdline())]
                for victim in victims[:1]:
                    os.kill(victim.pid, signal.SIGKILL)
                    killed += 1
    finally:
        pool.close()
    assert killed
    reference = everything(Workers(recipe, 1, rows.shape[1]), rows)
    assert values([found[n] for n in range(len(rows))]) == values(reference)


@pytest.mark.filterwarnings(CANCELLED)
@pytest.mark.parametrize("way", ["dies", pytest.param("hangs", marks=pytest.mark.long)])
def test_a_labelling_that_takes_its_worker_along_is_recorded_as_failed(
    way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its batch is tried twice and given up; all others are evaluated."""
    monkeypatch.setenv("JLD_KERNEL", "off")  # what dies is the evaluation of one labelling
    assembly, _, rows = wall()
    recipe = WorkerSpec.of(FatalLabelling(assembly, rows[17], way), EvaluatorSettings())
    pool = Workers(recipe, 2, rows.shape[1], hang_seconds=60.0 if way == "dies" else 10.0)
    try:
        found = everything(pool, rows)
    finally:
        pool.close()
    lost = [n for n, e in enumerate(found) if e.status is Status.FAILED]
    assert 17 in lost
    assert lost == list(range(lost[0], lost[-1] + 1))  # one batch
    assert len(lost) < len(rows)
    assert pool.deaths >= 2


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_workers_of_a_cluster_join_and_die(tmp_path: Path) -> None:
    """One worker at first, another joins, and the first is killed on the way: the same table as one job."""
    distributed = pytest.importorskip("distributed")
    scene = parse_scene(grid_document(["aaaa", "aaaa", "aaaa", "####"], block_cells=[1, 3]))
    settings = ExploreSettings(driver="genetic", seed=3, budget=250, pictures=False)
    alone = explore(scene, tmp_path / "alone", settings)
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, worker_dashboard_address=None
    )
    try:
        address = cluster.scheduler_address
        with distributed.Client(address) as client:
            (first,) = client.run(os.getpid).values()
        events: list[str] = []

        def raise_deferred(now: Progress) -> None:
            if now.done >= 60 and not events:
                cluster.scale(2)
                events.append("joined")
            if now.done >= 140 and events == ["joined"]:
                os.kill(first, signal.SIGKILL)
                events.append("killed")

        away = explore(scene, tmp_path / "away", replace(settings, cluster=address), report=raise_deferred)
        assert events == ["joined", "killed"]
    finally:
        cluster.close()
    assert alone.results.drop(columns="seconds").equals(away.results.drop(columns="seconds"))


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_that_is_none_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("jld_explore.evaluation.pool._ANSWER", 0.5)
    scene = parse_scene(grid_document(["aa", "##"]))
    for url in ("tcp://127.0.0.1:9", "nonsense"):
        with refused(match="cluster: "):
            explore(scene, tmp_path / "out", ExploreSettings(pictures=False, cluster=url))
        assert not (tmp_path / "out").exists()


@pytest.mark.filterwarnings("ignore")
def test_a_worker_of_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, worker_dashboard_address=None
    )
    try:
        monkeypatch.setattr("jld_explore.evaluation.pool.__version__", "0.0.1")
        settings = ExploreSettings(pictures=False, cluster=cluster.scheduler_address)
        with pytest.raises(InputError, match=r"has jld .*expected jld 0\.0\.1"):
            explore(parse_scene(grid_document(["aa", "##"])), tmp_path / "out", settings)
        assert not (tmp_path / "out").exists()
    finally:
        cluster.close()


def test_a_task_for_another_version_is_refused() -> None:
    spec = WorkerSpec(b"", "of no evaluator", 0, "0.0.1")
    with pytest.raises(InputError, match=r"expected jld 0\.0\.1"):
        spec.evaluator()


def test_processes_start_after_the_first_labelling() -> None:
    """Two processes that load their modules beside it delayed the first λ of a search."""
    assembly, _, rows = wall()
    settings = EvaluatorSettings(use_batch_solver=False)
    workers = Workers(WorkerSpec.of(assembly, settings), jobs=2, faces=rows.shape[1])
    try:
        first = workers.run(rows[:3], Deadline(60.0), first_required=True)
        second = workers.run(rows[3:6], Deadline(60.0))
        assert not workers.processes.started
        found = iter(first)
        part, _ = next(found)
        assert (part, workers.processes.started) == (slice(0, 1), False)
        parts = [part, *(part for part, _ in found)]
        assert workers.processes.started
        assert sorted(one.start for one in parts) == [0, 1, 2]
        assert sum(len(answers) for _, answers in second) == 3
    finally:
        workers.close()


STARTED = """
import signal
import subprocess
import sys
from joblib.externals.loky.backend import fork_exec
from jld_explore.evaluation import Pool
blocked = lambda: signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])
plain = fork_exec.fork_exec
fork_exec.fork_exec = lambda *known, **named: print(blocked()) or plain(*known, **named)
with Pool(2) as pool:
    there = pool.submit(signal.getsignal, signal.SIGINT), pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, [])
    print(there[0].result() == signal.SIG_IGN, there[1].result(), blocked())
"""


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no masks of signals")
def test_ctrl_c_does_not_reach_processes_that_start() -> None:
    """A terminal sends it to all: one that still imports would end with a traceback."""
    done = subprocess.run([sys.executable, "-c", STARTED], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["True", "True", "True set() False"]
