"""Numbers that take longer than a test may: run all with `python -m benchmarks`, or one by its module."""

import os
from collections.abc import Callable
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # before numpy is loaded: one thread, whoever starts it


def timed(function: Callable[..., Any], clock: Callable[[], float], spent: list[float]) -> Callable[..., Any]:
    """A function that adds the seconds of its calls to the first number of a list."""

    def run(*given: Any, **others: Any) -> Any:
        start = clock()
        try:
            return function(*given, **others)
        finally:
            spent[0] += clock() - start

    return run
