"""The machinery of the benchmarks of scale, on walls of a few blocks."""

from __future__ import annotations

import pytest
from benchmarks import large


@pytest.mark.parametrize("case", sorted(large.DRY_WALLS))
def test_scale(case: str) -> None:
    found = [large.measure_wall(case, courses, "schur") for courses in (4, 6)]
    assert all(one["status"] == "collapse" and one["stands"] and one["gap"] < 1e-6 for one in found)
    assert set(found[0]["seconds"]) == set(large.WALL_PHASES)
    assert f"| {case} | schur |" in large._walls({(case, "schur"): found})
