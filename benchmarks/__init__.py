"""Numbers that take longer than a test may: run all with `python -m benchmarks`, or one by its module."""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # before numpy is loaded: one thread, whoever starts it
