"""Steps of a bound down to the best λ known."""

from __future__ import annotations

import math

import pytest

from jld_explore.drivers.exact.context import TargetSchedule


def test_without_a_bound_or_near_the_goal_the_step_covers_the_whole_gap() -> None:
    assert TargetSchedule(100).next_target(math.inf, 0.5) == 0.5
    assert TargetSchedule(100).next_target(0.51, 0.5) == 0.5
    assert TargetSchedule(100).next_target(0.75, 0.65) == 0.65
    schedule = TargetSchedule(100)
    assert schedule.next_target(0.5, 0.5 + 1e-9) == 0.5 + 1e-9  # nothing to be refuted says nothing of steps
    assert schedule.next_target(0.9, 0.5) == pytest.approx(0.7)


def test_steps_are_half_of_a_wide_gap_and_grow_after_quick_ones() -> None:
    schedule = TargetSchedule(100)
    assert schedule.next_target(0.75, 0.25) == 0.5
    schedule.note_proven(90)
    assert schedule.next_target(0.70, 0.3) == pytest.approx(0.5)
    schedule.note_proven(10)
    assert schedule.next_target(0.70, 0.1) == 0.1  # three quarters of what is left and more go all the way


def test_a_step_that_takes_too_long_is_halved_and_has_more_patience() -> None:
    schedule = TargetSchedule(100)
    first = schedule.next_target(0.75, 0.65)
    assert not schedule.is_stuck(99, 0.75, first)
    assert schedule.is_stuck(100, 0.75, first)
    second = schedule.next_target(0.75, 0.65)
    assert 0.75 - second == pytest.approx(0.5 * (0.75 - first))
    assert not schedule.is_stuck(399, 0.75, second)
    schedule.note_proven(399)
    assert schedule.next_target(second, 0.65) == pytest.approx(0.5 * (second + 0.65))  # half of what is left now
    # a step is never so small that bounds would not move
    assert not schedule.is_stuck(10**9, 0.75, 0.75 * (1.0 - 1e-3))
