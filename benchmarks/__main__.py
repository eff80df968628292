"""Run every benchmark in order; each prints its table and writes it to benchmarks/results.

`python -m benchmarks spent WORDS` runs one command of `jld` in a process that loads nothing else, for `commands`.
"""

from __future__ import annotations

import importlib
import io
import json
import resource
import runpy
import sys
import time
from contextlib import redirect_stdout, suppress
from typing import Any, Final

BENCHMARKS: Final = (  # modules of this package in the order in which they run
    "corpus",
    "zero_dilation",
    "exact",
    "fields",
    "claims",
    "drivers",
    "speed_error",
    "hard_cases",
    "commands",
    "large",
    "batch_solver",
    "experiment",
    "designs",
    "reliability",
)


COMPILED: Final = ("jld_solve", "jld_minimize", "jld_solve_blocks", "jld_solve_cones")
"""Calls of the compiled library that solve."""


class Timed:
    """A compiled library whose solving calls are timed."""

    def __init__(self, library: Any) -> None:
        self._library, self.seconds = library, 0.0

    def __getattr__(self, name: str) -> Any:
        function = getattr(self._library, name)
        if name not in COMPILED:
            return function

        def timed(*arguments: Any) -> Any:
            start = time.thread_time()
            try:
                return function(*arguments)
            finally:
                self.seconds += time.thread_time() - start

        return timed


def spent() -> None:
    """Run `jld` with the words given, and print seconds: of all, of children, of search and compiled solver."""
    del sys.argv[1]
    program = importlib.import_module("jld_explore.__main__")
    program._import_scipy()  # first, as the command does
    library: Any = importlib.import_module("jld_core.batch.library")
    real, made, searched = library.library, dict[str, Timed](), [0.0]
    library.library = lambda variant: made.setdefault(variant, Timed(real(variant)))
    if sys.argv[1] == "explore":
        study = importlib.import_module("jld_explore.search.study").Study
        run = study.run

        def timed(self: Any) -> Any:
            start = time.process_time()
            try:
                return run(self)
            finally:
                searched[0] = time.process_time() - start

        study.run = timed
    with redirect_stdout(io.StringIO()), suppress(SystemExit):
        program.main()
    own, others = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    children = others.ru_utime + others.ru_stime
    total = own.ru_utime + own.ru_stime + children
    solver = sum(one.seconds for one in made.values())
    print(json.dumps({"total": total, "children": children, "search": searched[0], "solver": solver}))


def main() -> None:
    wanted = sys.argv[1:] or BENCHMARKS
    del sys.argv[1:]  # names of benchmarks are no options of theirs
    for name in wanted:
        start = time.perf_counter()
        print(f"== {name}", flush=True)
        runpy.run_module(f"benchmarks.{name}", run_name="__main__")
        print(f"== {name}: {time.perf_counter() - start:.0f} s\n", flush=True)


if __name__ == "__main__":
    (spent if sys.argv[1:2] == ["spent"] else main)()
