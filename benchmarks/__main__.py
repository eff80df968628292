"""Run every benchmark in order; each prints its table and writes it to benchmarks/results."""

from __future__ import annotations

import importlib
import sys
import time
from typing import Final

BENCHMARKS: Final = (
    "corpus.__main__",
    "zero_dilation",
    "zero_dilation_floor",
    "exact",
    "long_proof",
    "fields_search",
    "trust_trials",
    "claims",
    "drivers",
    "speed_error",
    "hard_cases",
    "throughput",
    "field",
    "crack_fields",
    "scale",
    "growth",
    "large_answers",
    "large_search",
    "lanes",
    "lanes_hard",
    "lanes_single",
    "experiment",
    "moving_joints",
    "designs",
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
