"""Numbers that take longer than a test may: run all with `python -m benchmarks`, or one by its module."""
