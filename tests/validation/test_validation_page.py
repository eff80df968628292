"""The corpus: every published value agrees, and the page has each of them as it is computed today."""

from __future__ import annotations

import math

import pytest
from benchmarks.corpus import Value, read
from benchmarks.corpus.__main__ import PAGE, row

VALUES = read()
ROWS = [
    [cell.strip() for cell in line.split("|")[1:-1]]
    for line in PAGE.read_text("utf-8").splitlines()
    if line.startswith("| ") and not line.startswith(("| quantity", "| ---"))
]


@pytest.mark.parametrize("value", [one for one in VALUES if not one.slow], ids=lambda value: value.what)
def test_value(value: Value) -> None:
    ours = value.ours()
    assert value.agrees(ours)
    computed = row(value, ours)
    (written,) = [one for one in ROWS if one[0] == computed[0]]
    assert written[1:3] == computed[1:3]
    for one, other in zip(written[3].split(" to "), computed[3].split(" to "), strict=True):
        assert one == other or float(one) == pytest.approx(float(other), rel=1e-6, abs=1e-9)


def test_the_page_has_all_values_and_no_other() -> None:
    assert len(ROWS) == len(VALUES) == len({value.what for value in VALUES})
    assert {one[0].partition(" (")[0] for one in ROWS} == {value.what.partition(" (")[0] for value in VALUES}


def test_a_wrong_value_would_be_seen() -> None:
    """Each relation refuses what it must refuse."""
    for value in VALUES:
        off = value.published * (1.0 + 10.0 * value.tolerance) + 1e-6
        if value.relation == "equal":
            assert value.agrees((value.published, value.published))
            assert not value.agrees((off, off))
        elif value.relation == "inside":
            assert not value.agrees((value.published + 1.0, math.inf))
        elif value.relation == "above":
            assert not value.agrees((off, off))


def test_the_corpus_is_as_large_as_it_says() -> None:
    others = [value for value in VALUES if value.source.tier != "ours"]
    assert len(others) >= 50
    assert sum(value.spatial for value in others) >= 12
