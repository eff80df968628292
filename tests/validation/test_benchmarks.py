"""The machinery of the benchmarks, each on its smallest scene, so that none of them rots unseen."""

from __future__ import annotations

import pytest
from benchmarks import field


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
