"""What a second job brings to searches with the batch solver: by an event model of two free cores, and by the clock.

A search with one and with two jobs at 88 faces, each in a process of its own. Of the search with two jobs every task of
a worker and every stretch of the first thread between two of its waits is timed by the processor. The model replays
them on two cores which serve all that can run in equal shares: the first thread breeds and records, tasks start where
it began them, and it waits for results where it did. What the model leaves out: waits for the interpreter, the disk,
and caches that two cores share. The clock means something on a quiet machine only. Idle: share of two cores that
nothing uses. Lag 0 lets the first thread wait for each portion before it breeds the next.
`python -m benchmarks.two_jobs` writes the table.
"""

from __future__ import annotations

import heapq
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

from benchmarks.common import about, table, write
from benchmarks.search_scenes import LARGE

SCENE: Final = "planar 88 faces"
"""Scene that is searched."""

BUDGET: Final = {"genetic": 6000, "random": 30000}
"""Classes evaluated by each driver."""

TURNS: Final = 3
"""Searches of each kind; the least of every number is given."""

Event = tuple[str, float]
"""What the first thread does: "run" for seconds, "begin" task number, or "wait" for task number."""


class Watch:
    """Times of the first thread and of all tasks of one search."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.tasks: list[float] = []
        self._last = 0.0

    def start(self) -> None:
        """Begin to time the first thread."""
        self._last = time.thread_time()

    def stretch(self) -> None:
        """End a stretch of the first thread."""
        now = time.thread_time()
        self.events.append(("run", now - self._last))
        self._last = now

    def task(self, number: int, call: Callable[..., Any], *arguments: Any) -> Any:
        """Run a task, and time it where it runs beside the first thread."""
        begun = time.thread_time()
        result = call(*arguments)
        self.tasks[number] = time.thread_time() - begun
        return result

    def submitted(self, pool: Any, call: Callable[..., Any], tasks: Iterable[tuple[Any, ...]]) -> list[Any]:
        """Begin tasks in a pool of threads; return functions that wait for their results."""
        waits = []
        for arguments in tasks:
            self.stretch()
            number = len(self.tasks)
            self.tasks.append(0.0)
            self.events.append(("begin", number))
            future = pool.submit(self.task, number, call, *arguments)
            waits.append(lambda future=future, number=number: self.waited(future, number))
        return waits

    def waited(self, future: Any, number: int) -> Any:
        """Wait for the result of a task."""
        self.stretch()
        self.events.append(("wait", number))
        result = future.result()
        self._last = time.thread_time()
        return result


def replay(events: list[Event], tasks: list[float], threads: int, cores: int = 2) -> float:
    """Seconds of a search on free cores, from what its first thread does and from the seconds of its tasks.

    At most `threads` tasks run beside the first thread, in the order in which they began. All that can run shares the
    cores equally, one core at most each.
    """
    clock, place, left = 0.0, 0, 0.0
    queue: list[int] = []
    running: dict[int, float] = {}
    done: set[int] = set()
    while True:
        while not left and place < len(events):
            kind, value = events[place]
            if kind == "wait" and int(value) not in done:
                break
            place += 1
            if kind == "run":
                left = value
            elif kind == "begin":
                heapq.heappush(queue, int(value))
        while queue and len(running) < threads:
            number = heapq.heappop(queue)
            running[number] = tasks[number]
        active = len(running) + bool(left)
        if not active:
            return clock
        speed = min(1.0, cores / active)
        step = min([*running.values(), *([left] if left else [])]) / speed
        clock += step
        left = max(left - step * speed, 0.0)
        if left < 1e-12:
            left = 0.0
        running = {number: rest - step * speed for number, rest in running.items()}
        ended = [number for number, rest in running.items() if rest < 1e-12]
        done.update(ended)
        running = {number: rest for number, rest in running.items() if number not in ended}


def search(driver: str, jobs: int, lag: int | None) -> dict[str, Any]:
    """Search, and return clock, processor, and with two jobs what the model says."""
    from jld_explore.drivers.genetic import Genetic
    from jld_explore.evaluation import workers
    from jld_explore.evaluation.worker_tasks import evaluate_batch
    from jld_explore.explore import explore
    from jld_explore.settings import ExploreSettings
    from jld_explore.study import Study

    watch, found, run, submit = Watch(), dict[str, Any](), Study.run, workers.Workers.submit
    first = threading.get_ident()

    def submitted(self: Any, tasks: Iterable[tuple[Any, ...]]) -> Any:
        if self._threads is None or threading.get_ident() != first:
            return submit(self, tasks)
        found["threads"] = self.threads
        return watch.submitted(self._threads, evaluate_batch, tasks)

    def timed(study: Any) -> Any:
        clock, processor = time.perf_counter(), time.process_time()
        watch.start()
        reason = run(study)
        watch.stretch()
        found["clock"], found["processor"] = time.perf_counter() - clock, time.process_time() - processor
        return reason

    settings = ExploreSettings(driver=driver, budget=BUDGET[driver], jobs=jobs, pictures=False)
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.object(Study, "run", timed),
        patch.object(workers.Workers, "submit", submitted),
        patch.object(Genetic, "ahead", Genetic.ahead if lag is None else lag),
    ):
        done = explore(LARGE[SCENE](), Path(folder) / "study", settings)
    found["best"] = done.summary.best
    if jobs > 1:
        found["first"] = sum(value for kind, value in watch.events if kind == "run")
        found["model"] = replay(watch.events, watch.tasks, found["threads"])
    return found


def elsewhere(driver: str, jobs: int, lag: int | None) -> dict[str, Any]:
    """The same in a process of its own, the least of several turns by each number."""
    command = [sys.executable, "-m", "benchmarks.two_jobs", driver, str(jobs), *([] if lag is None else [str(lag)])]
    turns = [
        json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()[-1])
        for _ in range(TURNS)
    ]
    return {name: min(turn[name] for turn in turns) for name in turns[0]}


def main() -> None:
    """Write benchmarks/results/two_jobs.md."""
    rows = []
    for driver, lag in (("genetic", 0), ("genetic", None), ("random", None)):
        one, two = elsewhere(driver, 1, lag), elsewhere(driver, 2, lag)
        assert one["best"] == two["best"]
        rows.append(
            [
                driver + (", lag 0" if lag == 0 else ""),
                *(f"{value:.2f}" for value in (one["processor"], two["processor"], two["first"], two["model"])),
                f"{100.0 * (1.0 - two['processor'] / (2.0 * two['model'])):.0f} %",
                f"**{one['processor'] / two['model']:.2f}**",
                f"{one['clock']:.1f}, {two['clock']:.1f}",
            ]
        )
    head = [
        "driver",
        "1 job, s",
        "2 jobs, s of both cores",
        "of them first thread",
        "model, s",
        "idle",
        "times",
        "clock, s",
    ]
    load = f"Load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    write("two_jobs", "\n\n".join(["# Two jobs", about(__doc__), table(head, rows), load]))


if __name__ == "__main__":
    if sys.argv[1:]:
        lag = int(sys.argv[3]) if sys.argv[3:] else None
        sys.stdout.write(json.dumps(search(sys.argv[1], int(sys.argv[2]), lag)) + "\n")
    else:
        main()
