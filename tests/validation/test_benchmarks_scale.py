"""The machinery of the benchmarks of scale and of batches, on walls of a few blocks."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks import batched, scale, scale_one
from benchmarks.common import random_segmentations, wall

from jld_core.program import Template
from jld_core.solvers import ClarabelSolver


@pytest.mark.parametrize("case", sorted(scale_one.CASES))
def test_scale(case: str) -> None:
    found = [scale_one.measure(case, courses, "schur") for courses in (4, 6)]
    assert all(one["status"] == "collapse" and one["stands"] and one["gap"] < 1e-6 for one in found)
    assert set(found[0]["seconds"]) == set(scale_one.PHASES)
    assert len(scale.draw({(case, "schur"): found}).axes) == 2
    assert f"| {case} | schur |" in scale._walls({(case, "schur"): found})


def test_batched() -> None:
    """The same λ as Clarabel, labelling by labelling, wherever the batch says it is done."""
    template = Template(wall(3, 4))
    labellings = random_segmentations(template.assembly, 32, seed=8)
    with np.errstate(all="ignore"):
        answers = batched.Batch(template).solve(labellings, *batched.ASKED)
    assert answers.done.mean() > 0.5
    route = ClarabelSolver(template.precision.residual)
    for labels, load, done in zip(labellings, answers.points[-1], answers.done, strict=True):
        if done:
            one = route.solve(template.program(labels, template.precision.margin))
            assert load == pytest.approx(one.point[-1], rel=1e-6)
