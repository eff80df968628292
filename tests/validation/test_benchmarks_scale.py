"""The machinery of the benchmarks of scale, on walls of a few blocks."""

from __future__ import annotations

import pytest
from benchmarks import scale


@pytest.mark.parametrize("case", sorted(scale.CASES))
def test_scale(case: str) -> None:
    found = [scale.measure(case, courses, "schur") for courses in (4, 6)]
    assert all(one["status"] == "collapse" and one["stands"] and one["gap"] < 1e-6 for one in found)
    assert set(found[0]["seconds"]) == set(scale.PHASES)
    assert f"| {case} | schur |" in scale._walls({(case, "schur"): found})
