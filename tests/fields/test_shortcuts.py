"""Shortcuts of solves: linear systems without refinement and fields that are not settled, where nothing is lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jld_core import build_assembly, load_scene
from jld_core.fields import ConeProgram
from jld_core.fields.bounds import FieldSetting
from jld_core.fields.cones import Answer
from jld_core.fields.lower import LowerBound
from jld_core.fields.problem import Problem
from jld_core.fields.upper import Settling, UpperBound

SCENE = Path(__file__).parents[2] / "scenes" / "flat_beam_arch.json"
LABELS = np.array([letter == "d" for letter in "iiidididddddiididdidiiid"])


@pytest.fixture(scope="module")
def problem() -> Problem:
    setting = FieldSetting.of(build_assembly(load_scene(SCENE)))
    return setting.problem(setting.coarse)


def test_bounds_do_not_depend_on_refined_linear_systems(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both bounds with and without iterative refinement, to a tenth of what scenes may differ by (1e-6)."""

    def careful(self: ConeProgram, off: object = None, objective: object = None) -> Answer:
        return self._solve(off, objective, careful=True)  # type: ignore[arg-type]

    quick = LowerBound(problem).bound(LABELS), UpperBound(problem).bound(LABELS)
    monkeypatch.setattr(ConeProgram, "solve", careful)
    slow = LowerBound(problem).bound(LABELS), UpperBound(problem).bound(LABELS)
    for one, other in zip(quick, slow, strict=True):
        assert one is not None
        assert other is not None
        assert one.factor == pytest.approx(other.factor, rel=1e-7)


def test_an_answer_that_is_not_solved_is_asked_for_again(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """What fails without refinement is solved with it, and that answer counts."""
    original, asked = ConeProgram._solve, []

    def failing(self: ConeProgram, off: object, objective: object, careful: bool) -> Answer:
        asked.append(careful)
        found = original(self, off, objective, careful)  # type: ignore[arg-type]
        return found if careful else Answer(0.0 * found.point, found.dual, 0.0, False, "NumericalError")

    monkeypatch.setattr(ConeProgram, "_solve", failing)
    found = LowerBound(problem).bound(LABELS)
    assert asked == [False, True]
    assert found is not None
    assert found.factor > 0.0


def test_a_field_is_settled_where_opening_costs(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Velocities with slips of 1e-6 where nothing moves are settled, those of the solver are not; λ is the same."""
    upper, settled = UpperBound(problem), []
    original = Settling.settled

    def watched(self: Settling, velocity: np.ndarray, dry: np.ndarray) -> np.ndarray:
        settled.append(True)
        return original(self, velocity, dry)

    monkeypatch.setattr(Settling, "settled", watched)
    answer = upper.propose(LABELS)
    velocity = answer.point[: 6 * len(problem.mesh)].reshape(-1, 3, 2)
    found = upper.certify(velocity, LABELS, answer.objective)
    assert not settled
    noise = 1e-6 * abs(velocity).max() * np.random.default_rng(1).uniform(-1.0, 1.0, velocity.shape)
    shaken = upper.certify(velocity + noise, LABELS, answer.objective)
    assert settled
    assert found is not None
    assert shaken is not None
    assert found.factor == pytest.approx(answer.objective, rel=1e-7)
    assert shaken.factor == pytest.approx(found.factor, rel=1e-2)
    assert shaken.factor >= answer.objective * (1.0 - 1e-9)
