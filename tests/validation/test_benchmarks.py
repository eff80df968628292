"""The machinery of the benchmarks, each on its smallest scene, so that none of them rots unseen."""

from __future__ import annotations

import pytest
from benchmarks import field, hard_cases, hard_plot, reductions, reductions_plot
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


def test_reductions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reductions, "ENOUGH", 0.0)
    found = reductions.measured(small=True)
    for one in found:
        assert one.sizes[1] < one.sizes[0] or one.name == "zero dilation skipped"
        assert one.changed < 1e-6 or "λ changes" in one.why
    assert len(reductions_plot.draw(found).axes) == 1
