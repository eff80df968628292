"""Forces written as text: every spelling that is read, and that nothing else is."""

from __future__ import annotations

import pytest

from jld_core import InputError
from jld_core.exchange.forces import parse_force


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("10 kN", (1e4,)),
        ("10kN", (1e4,)),
        ("10 KN", (1e4,)),
        ("2,5 kN", (2500.0,)),
        ("2,5", (2.5,)),
        ("2.5", (2.5,)),
        ("-2.5e3 N", (-2500.0,)),
        (".5 MN", (5e5,)),
        (",5 MN", (5e5,)),
        ("7 daN", (70.0,)),
        ("1 t", (9810.0,)),
        ("500 kg", (4905.0,)),
        ("100 kgf", (980.665,)),
        ("1 lbf", (4.4482216152605,)),
        ("2 kips", (8896.443230521,)),
        ("F1 = 10 kN", (1e4,)),
        ("F1=10 kN", (1e4,)),
        ("H: 250 N", (250.0,)),
        ("  F1 =\n10 kN ", (1e4,)),
        ("q.left = 3", (3.0,)),
        ("3, -4", (3.0, -4.0)),
        ("3,-4", (3.0, -4.0)),
        ("3; 4", (3.0, 4.0)),
        ("3 kN; -4,5 kN", (3000.0, -4500.0)),
        ("3,5, 4,5", (3.5, 4.5)),
        ("Fx = 3 kN, Fy = -4 kN", (3000.0, -4000.0)),
        ("Fy = -4 kN; Fx = 3 kN", (3000.0, -4000.0)),
        ("fx = 3", (3.0, 0.0)),
        ("F_y = 3", (0.0, 3.0)),
    ],
)
def test_spellings(text: str, values: tuple[float, ...]) -> None:
    found = parse_force(text)
    assert found.values == pytest.approx(values, rel=1e-15)
    assert found.components == (len(values) == 2)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("10 kN/m", "per length"),
        ("10 kN / m²", "per length"),
        ("10 N/mm", "per length"),
        ("1,000 kN", "thousands"),
        ("100,200", "thousands"),
        ("1 000 N", "'000 N'"),
        ("1.000,5 N", "',5 N'"),
        ("10 mN", "'mN'"),
        ("10 T", "'T'"),
        ("10 furlong", "'furlong'"),
        ("F1 10 kN", "no force"),
        ("10 kN wind", "'wind'"),
        ("10 kN (live)", "'(live)'"),
        ("10 kN + 2 kN", "'+ 2 kN'"),
        ("3 kN; 4", "not all of its numbers have a unit"),
        ("1; 2; 3", "3 numbers"),
        ("Fx = 3; 4", "name no component"),
        ("1e999 N", "out of range"),
        ("10 kN;", "nothing"),
        ("wind", "no force"),
        ("", "no force"),
        ("nan", "no force"),
        ("10 kN 5", "'5'"),
        ("2*5", "'*5'"),
    ],
)
def test_unparsed_rests_of_force_texts_are_refused_and_quoted(text: str, problem: str) -> None:
    with pytest.raises(InputError) as complaint:
        parse_force(text)
    assert problem in str(complaint.value)
    assert " ".join(repr(text).split()) in str(complaint.value)
    assert "\n" not in str(complaint.value)


def test_the_unit_of_the_scene_is_the_unit_of_the_result() -> None:
    assert parse_force("10 kN", "kN").values == (10.0,)
    assert parse_force("1 t", "kN").values == pytest.approx((9.81,))
    assert parse_force("7", "kN").values == (7.0,)
    assert parse_force("7", "blocks").values == (7.0,)
    with pytest.raises(InputError, match="that of the scene"):
        parse_force("7 N", "blocks")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1 kN; 2 kN; -3 kN", (1e3, 2e3, -3e3)),
        ("Fz = -4; Fx = 1", (1.0, 0.0, -4.0)),
        ("Fz = 5 kN", (0.0, 0.0, 5e3)),
        ("5 kN", (5e3,)),
    ],
)
def test_forces_in_space(text: str, values: tuple[float, ...]) -> None:
    found = parse_force(text, dimension=3)
    assert (found.values, found.components) == (values, len(values) == 3)


@pytest.mark.parametrize(
    ("text", "dimension", "problem"),
    [("1; 2", 3, "2 numbers for 3"), ("Fz = 1", 2, "no component along z"), ("Fx = 1; Fx = 2", 3, "or the same one")],
)
def test_components_that_do_not_fit(text: str, dimension: int, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        parse_force(text, dimension=dimension)


@pytest.mark.parametrize(
    ("text", "per"),
    [("10 kN/m", (1.0, 1)), ("10 N/mm²", (1e-3, 2)), ("F = 1 kN / m^2", (1.0, 2)), ("3 lbf/ft", (0.3048, 1))],
)
def test_loads_per_length_or_area(text: str, per: tuple[float, int]) -> None:
    assert parse_force(text, distributed=True).per == per
