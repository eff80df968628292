"""Run a few tasks at a time, in this or other processes; return results in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from typing import Any, TypeVar

from jld_explore.evaluation.processes import is_lost, stop_processes, warning_of_stops_ignored
from jld_explore.evaluation.worker_pool import local_processes

_Result = TypeVar("_Result")


class TaskPool:
    """Pool of local processes for tasks whose results depend on their arguments alone.

    jobs: number of processes; with one all tasks are run in this process.
    """

    def __init__(self, jobs: int = 1) -> None:
        self.jobs = jobs
        self._executor: Executor | None = None
        self._settings = ExitStack()

    def run(self, work: Callable[..., _Result], tasks: Sequence[tuple[Any, ...]]) -> list[_Result]:
        """Run a function with the arguments of each task.

        work: function of a module, which other processes can import. tasks: arguments of each call. Result: results in
        the order of the tasks. Tasks that a process left undone when it died are run in this process.
        """
        if self.jobs == 1 or len(tasks) < 2:
            return [work(*task) for task in tasks]
        if self._executor is None:
            self._settings.enter_context(warning_of_stops_ignored())
            self._executor = make_executor(self.jobs)
        found: list[_Result] = []
        futures = [self._executor.submit(work, *task) for task in tasks]
        for future, task in zip(futures, tasks, strict=True):
            try:
                found.append(future.result())
            except Exception as error:  # the exception of a pool whose process died depends on the kind of pool
                if not is_lost(error):
                    raise
                self.close()
                found.append(work(*task))
        return found

    def close(self) -> None:
        """Terminate the processes at once, also those with unfinished tasks; `run` restarts them."""
        executor, self._executor = self._executor, None
        with self._settings:
            if executor is not None:
                stop_processes(executor)
                executor.shutdown(wait=True)


def make_executor(jobs: int) -> Executor:
    """Return a new executor of `jobs` local processes; tests replace it by one of threads."""
    found: Executor = local_processes(jobs)
    return found
