"""A slice of the trials of brute force against proof; `python -m benchmarks.trust_trials` runs two thousand."""

from __future__ import annotations

import pytest
from benchmarks.trust_scenes import drawn
from benchmarks.trust_trials import trial


@pytest.mark.parametrize("seed", [1, 4, 6, 10])
def test_proven_results_equal_brute_force(seed: int) -> None:
    found = trial(seed)
    assert not found.problem
    assert found.faces == int(drawn(seed)[1].candidates.sum())
