"""Run every benchmark in order; each prints its table and writes it to benchmarks/results."""

from __future__ import annotations

import importlib
import sys
import time
from typing import Final

BENCHMARKS: Final = (
    "corpus.__main__",
    "flagship",
    "zero_dilation",
    "zero_dilation_floor",
    "exact",
    "long_proof",
    "fields_search",
    "relaxing",
    "trust_trials",
    "claims",
    "reach",
    "drivers",
    "convergence",
    "speed_error",
    "hard_cases",
    "reductions",
    "throughput",
    "field",
    "crack_fields",
    "crack_models",
    "scale",
    "growth",
    "large",
    "large_answers",
    "large_search",
    "lanes",
    "lanes_hard",
    "lanes_single",
    "million",
    "start_up",
    "two_jobs",
    "local_change",
    "experiment",
    "studio",
    "exchange",
    "moving_joints",
    "moved_opening",
    "designs",
    "joint_shapes",
    "reliability",
)
"""Modules of this package that hold a `main()`, in the order in which they run."""


def main() -> None:
    """Run the benchmarks named on the command line, or all."""
    wanted = sys.argv[1:] or BENCHMARKS
    del sys.argv[1:]  # names of benchmarks are no options of theirs
    for name in wanted:
        start = time.perf_counter()
        print(f"== {name}", flush=True)
        importlib.import_module(f"benchmarks.{name}").main()
        print(f"== {name}: {time.perf_counter() - start:.0f} s\n", flush=True)


if __name__ == "__main__":
    main()
