"""Numbers of a scene that are written as text with a unit."""

from __future__ import annotations

from typing import Any

import pytest

from cases import ROUTE
from jld_core import InputError, build_assembly, parse_scene

PLAIN: dict[str, Any] = {
    "elements": [
        {"id": "ground", "support": True, "polygon": [[0, -1], [1, -1], [1, 0], [0, 0]]},
        {"id": "b", "polygon": [[0, 0], [1, 0], [1, 2], [0, 2]]},
    ],
    "materials": {"density": 2000, "dry": {"friction_coefficient": 0.6, "cohesion": 5000.0}},
    "loads": {"live": [{"element": "b", "force": [2500.0, 0.0], "at": [1.0, 1.5], "moment": 300.0}]},
}


def scene(units: dict[str, str] | None = None, cohesion: Any = 5000.0, **load: Any) -> dict[str, Any]:
    """Return the plain scene with other texts in its load and its cohesion."""
    live = {"element": "b", "force": [2500.0, 0.0], "at": [1.0, 1.5], "moment": 300.0, **load}
    dry = {"friction_coefficient": 0.6, "cohesion": cohesion}
    found = {**PLAIN, "materials": {"density": 2000, "dry": dry}, "loads": {"live": [live]}}
    return found if units is None else {**found, "units": units}


@pytest.mark.parametrize(
    "written",
    [
        {"force": ["2.5 kN", 0.0]},
        {"force": ["2.5kN", "0 N"], "at": ["100 cm", "1500 mm"]},
        {"moment": "0.3 kNm"},
        {"moment": "0.3 kN·m"},
        {"moment": "300 N*m", "cohesion": "5 kPa"},
        {"cohesion": "0.005 MPa"},
        {"cohesion": "5 kN/m²"},
        {"cohesion": "0.005 N/mm^2"},
        {"cohesion": "5000"},
    ],
)
def test_texts_are_the_numbers_that_they_state(written: dict[str, Any]) -> None:
    one, other = (build_assembly(parse_scene(document)) for document in (PLAIN, scene(**written)))
    assert one.live == pytest.approx(other.live, rel=1e-14)
    assert one.strengths(ROUTE).cohesion == pytest.approx(other.strengths(ROUTE).cohesion, rel=1e-14)


def test_texts_become_numbers_of_the_units_of_the_scene() -> None:
    units = {"force": "kN", "length": "mm"}
    live = build_assembly(parse_scene(scene(units, force=["2500 N", 0.0], at=[0.5, 1.0], moment="3 kN·m"))).live
    assert live[1] == pytest.approx([2.5, 0.0, 3000.0], rel=1e-14)
    one = parse_scene(scene(units, cohesion="5 kPa")).materials.dry
    assert one is not None
    assert one.cohesion == pytest.approx(5e-6, rel=1e-14)


def test_a_mass_in_place_of_a_force_is_its_weight() -> None:
    live = build_assembly(parse_scene(scene(force=[0.0, "-1 t"], at=[0.5, 1.0], moment=0.0))).live
    assert live[1] == pytest.approx([0.0, -9810.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    ("written", "key", "words"),
    [
        ({"force": ["2.5 kM", 0.0]}, "loads.live[0].force[0]", "'kM'"),
        ({"force": ["2.5 kN/m", 0.0]}, "loads.live[0].force[0]", "no unit of this quantity"),
        ({"force": ["2,5 kN", 0.0]}, "loads.live[0].force[0]", "no unit is named ',5 kN'"),
        ({"force": ["much", 0.0]}, "loads.live[0].force[0]", "no number with a unit"),
        ({"force": ["1e999 N", 0.0]}, "loads.live[0].force[0]", "no number with a unit"),
        ({"force": ["1 /kN", 0.0]}, "loads.live[0].force[0]", "no unit is named"),
        ({"moment": "3 kN"}, "loads.live[0].moment", "no unit of this quantity"),
        ({"cohesion": "5 kN"}, "materials.dry.cohesion", "no unit of this quantity"),
        ({"force": "10 kN"}, "loads.live[0].force", "expected a vector"),
        ({"units": {"force": "pond"}, "force": ["1 N", 0]}, "loads.live[0].force[0]", "'pond'"),
    ],
)
def test_wrong_texts_are_refused_in_one_line(written: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(InputError) as refused:
        parse_scene(scene(**written))
    assert key in str(refused.value)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
