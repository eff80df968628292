"""A slice of the trials of brute force against proof; `python -m benchmarks.claims trials` runs two thousand."""

from __future__ import annotations

import pytest
from benchmarks.claims import Tally, trials


@pytest.mark.parametrize("seed", [1, 4, 6, 10])
def test_proven_results_equal_brute_force(seed: int) -> None:
    assert not trials.case(seed, Tally(""))
