"""The corpus: every published value agrees, and the page has each of them as it is computed today."""

from __future__ import annotations

import math

import pytest
from benchmarks.corpus import CLASSES, QUANTITIES, Value, read
from benchmarks.corpus.__main__ import PAGE, of_others, row

VALUES = read()
ROWS = [
    [cell.strip() for cell in line.split("|")[1:-1]]
    for line in PAGE.read_text("utf-8").splitlines()
    if line.startswith("| ") and not line.startswith(("| quantity", "| ---"))
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    "value", [pytest.param(one, id=one.what, marks=[pytest.mark.long] if one.slow else []) for one in VALUES]
)
def test_values_of_the_validation_page_are_reproduced(value: Value) -> None:
    ours = value.ours()
    assert value.agrees(ours)
    computed = row(value, ours)
    (written,) = [one for one in ROWS if one[0] == computed[0]]
    assert written[1:3] == computed[1:3]
    if written[3] != computed[3]:
        # a bracket that is narrower than the digits printed is one number, on other processors maybe two
        cells = [cell.replace("no end", "inf").split(" to ") for cell in (written[3], computed[3])]
        ends = [[float(one) for one in cell] for cell in cells]
        for pick in (min, max):
            assert pick(ends[0]) == pytest.approx(pick(ends[1]), rel=1e-6, abs=1e-9)


def test_the_validation_page_has_exactly_the_values_of_the_corpus() -> None:
    assert len(ROWS) == len(VALUES) == len({value.what for value in VALUES})
    assert {one[0].partition(" (")[0] for one in ROWS} == {value.what.partition(" (")[0] for value in VALUES}


def test_relations_refuse_wrong_values() -> None:
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
        elif value.relation == "below":
            assert value.agrees((off, off))
            assert not value.agrees((0.99 * value.published, 0.99 * value.published))


def test_the_corpus_has_the_stated_number_of_values() -> None:
    others = [value for value in VALUES if value.source.tier != "ours" and not value.derived]
    assert len(others) >= 50
    assert sum(value.spatial for value in others) >= 12
    assert sum(value.source.tier == "experiment" for value in others) >= 6
    assert of_others(VALUES) in PAGE.read_text("utf-8")
    assert of_others(VALUES).startswith(f"By others: {len(others)}, ")


def test_every_difference_has_its_class_on_the_page() -> None:
    text = PAGE.read_text("utf-8")
    assert f"None of {len(VALUES)} " in text
    for value in VALUES:
        if value.relation in ("above", "below"):
            assert value.kind in CLASSES
        if value.kind:
            assert f"- *{value.kind}*: {value.what}: " in text


@pytest.mark.parametrize("moved", [0.0, 0.1, 0.5])
def test_a_pushed_wall_by_moments(moved: float) -> None:
    """Moments of the upper half about its edge, and of the whole about the edge of the base; weight 1."""
    half, t = 0.75, 0.11
    turn = math.asin(moved * t / half)
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = t - t * cos + half * sin, t * sin + half * cos
    rise = half * cos + 0.5 * t * sin
    lower, upper = t - 0.5 * (t * cos - half * sin), x + 0.5 * (t * cos - half * sin)
    strut = 0.5 * (upper - x) / rise
    force = (strut * (y + rise) + 0.5 * (t - lower) + 0.5 * (t - upper)) / y
    assert QUANTITIES["pushed_wall"](height=2 * half, thickness=t, moved=moved)[0] == pytest.approx(force, rel=3e-4)
    if not moved:
        assert force == pytest.approx(t / half)
