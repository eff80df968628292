"""Run every benchmark in order; each prints its table and writes it to benchmarks/results."""

from __future__ import annotations

import runpy
import sys
import time
from typing import Final

BENCHMARKS: Final = (
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
    "moving_joints",
    "designs",
    "reliability",
)
"""Modules of this package in the order in which they run."""


def main() -> None:
    """Run the benchmarks named on the command line, or all."""
    wanted = sys.argv[1:] or BENCHMARKS
    del sys.argv[1:]  # names of benchmarks are no options of theirs
    for name in wanted:
        start = time.perf_counter()
        print(f"== {name}", flush=True)
        runpy.run_module(f"benchmarks.{name}", run_name="__main__")
        print(f"== {name}: {time.perf_counter() - start:.0f} s\n", flush=True)


if __name__ == "__main__":
    main()
