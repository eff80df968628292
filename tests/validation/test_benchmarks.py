"""The machinery of the benchmarks, each on its smallest scene, so that none of them rots unseen."""

from __future__ import annotations

import pytest
from benchmarks import field, hard_cases, hard_plot
from benchmarks.hard_scenes import hard_cases as all_hard_cases


def test_field() -> None:
    pytest.importorskip("compas_cra")
    for elements, along in field.cases(large=False).values():
        mine, *others = (field.ours(elements, along), field.theirs(elements, "rbe"), field.theirs(elements, "cra"))
        assert "stands, proven" in mine.answer
        assert all(other.interfaces == mine.interfaces and other.answer.startswith("stands") for other in others)


def test_field_says_what_is_missing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(field, "find_spec", lambda _: None)
    field.main()
    assert capsys.readouterr().out == field.MISSING + "\n"


def test_hard_cases() -> None:
    cases = [case for case in all_hard_cases() if case.name in ("N, mm", "inside the cone", "-1e-06")]
    verdicts = [hard_cases.judge(case) for case in cases]
    assert [verdict.right for verdict in verdicts] == [True] * 3
    assert [hard_cases.row_of(verdict)[2] for verdict in verdicts] == ["collapse", "locked", "unstable"]
    assert len(hard_plot.draw(verdicts).axes) == 2
