"""The validation page: every value within what its source allows, and the page as it is computed today."""

from __future__ import annotations

import pytest
from benchmarks.validation import PAGE, checks

ROWS = [
    [cell.strip() for cell in line.split("|")[1:-1]] for line in PAGE.read_text("utf-8").splitlines() if "|" in line
]


@pytest.mark.parametrize(
    "check",
    # vertical cuts through the same arch take half the time of radial ones
    [pytest.param(one, id=one.what, marks=[pytest.mark.long] if "radial" in one.what else []) for one in checks()],
)
def test_value(check: object) -> None:
    value = check.find()  # type: ignore[attr-defined]
    expected, tolerance = check.expected, check.tolerance  # type: ignore[attr-defined]
    assert abs(value - expected) <= tolerance * abs(expected)
    (row,) = [row for row in ROWS if row[0] == check.what]  # type: ignore[attr-defined]
    assert float(row[2]) == pytest.approx(expected, rel=1e-9)
    assert float(row[3]) == pytest.approx(value, rel=1e-6)


def test_the_page_has_no_other_rows() -> None:
    assert [row[0] for row in ROWS[2:]] == [check.what for check in checks()]
