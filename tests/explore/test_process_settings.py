"""Settings of the whole process are as they were once the pools that need them are closed."""

from __future__ import annotations

import sys
import warnings
from concurrent.futures import BrokenExecutor, CancelledError, Future, ThreadPoolExecutor
from typing import Any

import pytest
from joblib.externals.loky import process_executor

from cases import CASES, grid_assembly
from jld_explore.evaluation import EvaluatorSettings, Pool
from jld_explore.evaluation.pool import LOST, WorkerPool, ignored_warning, switch_interval
from jld_explore.evaluation.workers import Workers, WorkerSpec


def settings() -> tuple[float, list[Any]]:
    return sys.getswitchinterval(), list(warnings.filters)


def test_overlapping_switch_intervals_end_at_the_first_value() -> None:
    before = sys.getswitchinterval()
    one, two = switch_interval(before / 4), switch_interval(before / 2)
    with one:
        two.__enter__()
        assert sys.getswitchinterval() == pytest.approx(before / 4, rel=1e-2)
    assert sys.getswitchinterval() == pytest.approx(before / 2, rel=1e-2)
    two.__exit__(None, None, None)
    assert sys.getswitchinterval() == before


def test_overlapping_filters_end_without_a_filter() -> None:
    before = list(warnings.filters)
    one, two = (ignored_warning("some words", UserWarning) for _ in range(2))
    with one:
        two.__enter__()
    warnings.warn("some words", UserWarning, stacklevel=1)  # an error in these tests, were it not ignored
    two.__exit__(None, None, None)
    assert list(warnings.filters) == before
    with pytest.raises(UserWarning, match="some words"):
        warnings.warn("some words", UserWarning, stacklevel=1)


def test_a_filter_that_was_removed_before_is_accepted() -> None:
    with warnings.catch_warnings():
        context = ignored_warning("some words")
        context.__enter__()
    context.__exit__(None, None, None)


def test_a_pool_in_threads_and_a_pool_of_processes_leave_nothing_behind() -> None:
    rows, options = CASES["wall"]
    assembly = grid_assembly(rows, **options)
    spec, m = WorkerSpec.of(assembly, EvaluatorSettings()), len(assembly.interfaces)
    before = settings()
    threads = Workers(spec, 2, m, batch=True)
    assert sys.getswitchinterval() < before[0]
    threads.close()
    processes, pool = Pool(1), WorkerPool(1)
    assert processes.submit(abs, -1).result() == 1
    assert settings() != before
    processes.close()
    pool.close()
    assert settings() == before


def test_the_limit_of_memory_that_workers_lift_is_one_of_loky() -> None:
    """A private constant: where a version of loky renames it, workers are restarted while their state grows."""
    assert process_executor._MAX_MEMORY_LEAK_SIZE > 0


def test_an_error_of_a_task_is_not_taken_for_a_lost_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was hidden: the program was solved again in this process, for ever."""
    monkeypatch.setattr("jld_explore.evaluation.pool.make_executor", ThreadPoolExecutor)
    pool = WorkerPool(1)
    worker = pool.first()
    assert worker is not None
    for error in (ValueError("a defect"), OSError("a defect: no file")):
        wrong: Future[Any] = Future()
        wrong.set_exception(error)
        with pytest.raises(type(error), match="a defect"):
            pool.result(worker, wrong)
    assert len(pool) == 1
    for loss in (BrokenExecutor("a process was killed"), CancelledError()):
        lost: Future[Any] = Future()
        lost.set_exception(loss)
        assert pool.result(worker, lost) is LOST
    assert len(pool) == 0
    pool.close()
