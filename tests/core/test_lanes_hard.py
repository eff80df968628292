"""All hard cases through the batch solver: the scenes that break solvers, and those of the table of hard labellings.

Every bound and verdict is held against the core's own prover, λ against what must come out. The batch solver may leave
a case to others, who then settle it, but never lie.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from benchmarks.batch_solver import HARD, SEGMENTED, SPATIAL, labellings_of
from benchmarks.hard_cases import UNITS, HardCase, bricks, hard_cases, is_near

from jld_core import LimitAnalysis, SolveOptions, Status
from jld_core.batch import batch_solver, chosen
from jld_core.models import limit_analysis
from proofs import assert_proven, lanes_of

SCENES = SEGMENTED | HARD | SPATIAL
FEW = 6
"""Labellings of each scene."""

STATUS = {batch_solver.PROVEN: Status.COLLAPSE, batch_solver.LOCKED: Status.LOCKED, batch_solver.FALLS: Status.UNSTABLE}


@pytest.fixture(autouse=True)
def kernel() -> None:
    if chosen() is None:
        pytest.skip("no compiler, and no kernel")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("case", [case for case in hard_cases() if not case.kind.startswith("1 640")], ids=str)
@pytest.mark.filterwarnings("ignore")
def test_a_hard_case_is_proven_or_left(case: HardCase) -> None:
    assembly = case.make()
    labels = assembly.labels if case.labels is None else case.labels(assembly)
    analysis = LimitAnalysis(assembly)
    found = lanes_of(analysis).solve(labels[None], vectors=True)
    # strengths to 1e12 and friction of 1000 turn last digits of jumps into 1e-9 of λ
    assert_proven(analysis, labels[None], found, digits=1e-8, snap=1e-13)
    if found.verdict[0] == batch_solver.OPEN:
        assert analysis.prove(labels).status is case.status
        return
    assert STATUS[int(found.verdict[0])] is case.status
    if case.expected is not None:
        scale = analysis.template.scaling.load
        assert is_near(0.5 * scale * (found.low[0] + found.high[0]), case, case.expected)
        assert scale * found.low[0] <= case.expected + 1e-12 * max(1.0, abs(case.expected))
        assert scale * found.high[0] >= case.expected - 1e-12 * max(1.0, abs(case.expected))


def test_a_large_structure_is_left_to_the_solver_for_large_ones() -> None:
    """A wall of 420 bricks, for which a solver made for large ones is the quicker."""
    assert LimitAnalysis(bricks(20, 10, *UNITS["kN, m"])).batch is None


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", list(SCENES))
def test_a_hard_scene_is_proven(name: str) -> None:
    hard = replace(SCENES[name], count=FEW)
    options = SolveOptions(inner_bending="kern") if hard.kern else SolveOptions()
    analysis = limit_analysis(hard.make(), options)
    asked = labellings_of(analysis.assembly, hard)
    found = lanes_of(analysis).solve(asked, vectors=True)
    # a margin that two ways of summing tell apart is rounding, and strengths of 1 GPa multiply that of jumps
    assert_proven(analysis, asked, found, digits=1e-8, snap=1e-15)
    assert (found.verdict == batch_solver.OPEN).mean() <= 0.2
