"""Wrong values of parameters are one line that names them; what a guide promises of parameters works."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jld_core as jc
import jld_explore as je
from command import SCENES
from jld_explore.drivers import make_driver
from jld_explore.report.words import facts_of_exploration

ARCH = SCENES / "flat_beam_arch.json"
SCENE = jc.load_scene(ARCH)
ASSEMBLY = jc.build_assembly(SCENE)
SPACE = je.search_space(SCENE, ASSEMBLY)
SOLVE = {"gap": ["small", None, -1], "floor_seconds": ["x"], "effective_area": ["yes"], "condense": [1], "solver": [3]}
EXPLORE = {
    "jobs": [1.5, "two", 0, True],
    "budget": [2.5, "x"],
    "seconds": ["x"],
    "seed": ["x", 1.5, -1],
    "driver": ["exat", 3],
    "options": [[1]],
    "model": [{"gap": 1}],
    "settings": [{"gap": 1}],
    "report": [3],
    "certificate": [3],
    "experiment": ["x"],
    "popultion": [10],
    "population": ["x"],
    "out": [3, "exact"],
}
CALLS: dict[str, Callable[[], Any]] = {
    **{f"{key}={v!r}": lambda key=key, v=v: jc.solve(ASSEMBLY, **{key: v}) for key in SOLVE for v in SOLVE[key]},
    **{
        f"{key}={v!r} of a search": lambda key=key, v=v: je.explore(
            SCENE, **{"budget": 2, "driver": "genetic", "pictures": False, key: v}
        )
        for key in EXPLORE
        for v in EXPLORE[key]
    },
    "driver=exat": lambda: make_driver("exat", SPACE, 0),
    "seed=x": lambda: make_driver("random", SPACE, "x"),
    "space=3": lambda: make_driver("random", 3, 0),
    "assembly=3": lambda: je.search_space(SCENE, 3),
    "result=3": lambda: jc.geometry_sensitivities(3),
    "number=9": lambda: jc.solve_many(ASSEMBLY, [ASSEMBLY.labels]).result(9),
}


@pytest.mark.parametrize("name", CALLS)
def test_one_line_that_names_the_parameter(name: str) -> None:
    with pytest.raises(jc.InputError) as caught:
        CALLS[name]()
    text = str(caught.value)
    assert text.startswith(name.partition("=")[0] + ": ")
    assert "\n" not in text
    assert "object" not in text


def test_the_name_that_was_meant_is_offered() -> None:
    with pytest.raises(jc.InputError, match='expected "exact", one of enumeration'):
        make_driver("exat", SPACE, 0)
    with pytest.raises(jc.InputError, match='expected "population"'):
        je.explore(SCENE, driver="genetic", popultion=3)


@pytest.mark.parametrize("name", ["random", "hillclimb", "anneal", "genetic", "optuna", "exact", "enumeration"])
def test_a_driver_is_told_what_solve_many_returns(name: str) -> None:
    """Five rounds of a program's own loop give the proposals that evaluations of a search would."""
    driver, other = (make_driver(name, SPACE, 3) for _ in range(2))
    for _ in range(3):
        labels = driver.ask(6)
        assert labels.tolist() == other.ask(6).tolist()
        found = jc.solve_many(ASSEMBLY, labels)
        driver.tell(labels, found)
        rows = zip(found.status, found.low, found.high, found.load_factor, strict=True)
        other.tell(labels, [je.Evaluation(*row) for row in rows])


@pytest.mark.usefixtures("without_pictures")
def test_options_of_a_driver_are_keywords() -> None:
    same = {"driver": "genetic", "budget": 40, "seed": 2}
    one = je.explore(SCENE, **same, population=10).results.drop(columns="seconds")
    assert one.equals(je.explore(SCENE, **same, options={"population": 10}).results.drop(columns="seconds"))


def test_arrays_and_tuples_are_lists_of_a_scene() -> None:
    document: dict[str, Any] = {
        "name": "block",
        "elements": [
            {"id": "s", "support": True, "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]]},
            {"id": "b", "polygon": [[0, 1], [1, 1], [1, 2], [0, 2]]},
        ],
        "materials": {"density": 1.0, "dry": {"friction_coefficient": 0.5}},
        "loads": {"live": [{"body": [1, 0]}]},
    }
    other = json.loads(json.dumps(document))
    other["elements"][0]["polygon"] = np.array(other["elements"][0]["polygon"])
    other["elements"][1]["polygon"] = tuple(map(tuple, other["elements"][1]["polygon"]))
    other["loads"]["live"][0]["body"] = np.array([1.0, 0.0])
    other["materials"]["density"] = np.int64(1)
    assert jc.parse_scene(other).fingerprint == jc.parse_scene(document).fingerprint


@pytest.mark.usefixtures("without_pictures")
def test_a_resumed_search_without_solves_names_no_speed(tmp_path: Path) -> None:
    settings: dict[str, Any] = {"driver": "random", "budget": 5}
    first = je.explore(SCENE, tmp_path / "a", **settings)
    again = je.explore(SCENE, tmp_path / "a", **settings, resume=True)
    said = [facts_of_exploration(one)["stopped"] for one in (first, again)]
    assert "solves/s" in said[0]
    assert "solves/s" not in said[1]
