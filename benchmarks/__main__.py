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

from benchmarks import timed

# modules of this package in the order in which they run
BENCHMARKS: Final = ("corpus", "zero_dilation", "exact", "fields", "claims", "drivers", "speed_error", "hard_cases",
                     "commands", "large", "batch_solver", "experiment", "designs", "reliability")  # fmt: skip
# calls of the compiled library that solve
COMPILED: Final = ("jld_solve", "jld_minimize", "jld_solve_blocks", "jld_solve_cones")


class Timed:
    """A compiled library whose solving calls are timed."""

    def __init__(self, library: Any) -> None:
        self._library, self.spent = library, [0.0]

    def __getattr__(self, name: str) -> Any:
        function = getattr(self._library, name)
        return timed(function, time.thread_time, self.spent) if name in COMPILED else function


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
        study.run = timed(study.run, time.process_time, searched)
    with redirect_stdout(io.StringIO()), suppress(SystemExit):
        program.main()
    own, others = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    children = others.ru_utime + others.ru_stime
    total = own.ru_utime + own.ru_stime + children
    solver = sum(one.spent[0] for one in made.values())
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
