"""Searches none of whose first layouts stands: they look for the least bond of joints that lets one stand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import box, every_layout, grid_document, standing_of
from jld_core import Status, build_assembly, parse_scene
from jld_explore import Evaluation, SearchSpace, search_space
from jld_explore.drivers import DRIVERS
from jld_explore.evaluation import Evaluator, EvaluatorSettings

# Cells that overhang a support, in blocks of two to four: few layouts balance.
DOCUMENT = grid_document([*["aaaaa"] * 3, "..#.."], block_cells=[2, 4], friction=0.2)
LOOKED = 150  # layouts evaluated; by chance one search in five finds what stands among so many


def space_of(document: dict[str, Any]) -> SearchSpace:
    scene = parse_scene(document)
    return search_space(scene, build_assembly(scene))


def bonds(space: SearchSpace, labellings: Any) -> tuple[Any, Any]:
    start = DRIVERS["portfolio"](space, 0).standing_start
    assert start._make_driver() is not None
    return start._bonds(labellings)


def test_the_bond_is_what_keeps_a_lever_from_tipping() -> None:
    """Three cells on a joint of one: W a = (W + t a) a / 2 about its edge, so t = 3 γ a, γ times the size."""
    document = grid_document(["aaa", "#.."], tension=1e6, shear=1e6)
    tip = [{"element": "c2r0", "force": [0, -1400 * 9.81 * 0.1**3]}]
    live = document["loads"]["live"]
    document["loads"] = {"cases": [{"name": "own", "live": live}, {"name": "tip", "live": live, "dead": tip}]}
    space = space_of(document)
    found, case = bonds(space, ~space.candidates[None])
    # the weight of a fourth cell at the tip doubles that: 4 · 1.25 = (4 + 6) / 2
    assert found[0] == pytest.approx(2.0, rel=1e-5)
    assert case[0] == 1
    document["loads"] = {"live": live}
    assert bonds(space_of(document), ~space.candidates[None])[0][0] == pytest.approx(1.0, rel=1e-5)


def test_searches_find_what_stands_where_chance_does_not() -> None:
    """Five of 4 173 layouts need no bond, which are those that stand; searches that learn find one."""
    space = space_of(DOCUMENT)
    every = every_layout(space)
    stands = standing_of(space.assembly, every) == 1.0
    assert len(every) == 4173
    assert stands.sum() == 5
    assert ((bonds(space, every)[0] <= 1e-6) == stands).all()
    solver = Evaluator(space.assembly, EvaluatorSettings())
    fallen = Evaluation(Status.UNSTABLE, np.nan, np.nan, np.nan)
    for name in ("portfolio", "anneal", "genetic"):
        driver, left, found = DRIVERS[name](space, 0), LOOKED, 0
        while left > 0 and not found:
            rows = driver.ask()
            falls, answers = standing_of(space.assembly, rows) == 0.0, solver.evaluate_all(rows)
            driver.tell(rows, [fallen if fell else one for one, fell in zip(answers, falls, strict=True)])
            left -= len(rows)
            found += sum(~falls)
        assert found, name


def overhang_in_space() -> dict[str, Any]:
    """The cells of `DOCUMENT` as boxes."""
    places = [(f"c{x}{z}", 0.1 * x, 0.1 * z) for z in range(3) for x in range(5)]
    cells = [box(name, (x, 0.0, z), (x + 0.1, 0.1, z + 0.1)) for name, x, z in places]
    base = box("base", (0.2, 0.0, -0.1), (0.3, 0.1, 0.0), support=True)
    values = {key: DOCUMENT[key] for key in ("materials", "search")}
    return {"name": "space", "elements": [*cells, base], "loads": {"live": [{"body": [1, 0, 0]}]}, **values}


TIE = {"kind": "tie", "from": {"element": "c0r0", "at": [0.05, 0.35]}, "to": {"element": "c4r0", "at": [0.45, 0.35]}}


@pytest.mark.parametrize("document", [overhang_in_space(), {**DOCUMENT, "members": [{**TIE, "tension": 50.0}]}])
def test_what_needs_no_bond_stands_in_space_and_with_ties_too(document: dict[str, Any]) -> None:
    space = space_of(document)
    rows = every_layout(space)
    stands = standing_of(space.assembly, rows) == 1.0
    assert 0 < stands.sum() < len(rows)
    assert ((bonds(space, rows)[0] <= 1e-5) == stands).all()


def test_nothing_is_looked_at_where_layouts_stand() -> None:
    """Nor without dead load, where all do."""
    space = space_of(grid_document(["aaaa"] * 4 + ["####"], block_cells=[1, 3]))
    solver = Evaluator(space.assembly, EvaluatorSettings())
    driver = DRIVERS["portfolio"](space, 0)
    for _ in range(8):
        rows = driver.ask()
        driver.tell(rows, solver.evaluate_all(rows))
    assert driver.standing_start._driver is None
    pushed = {"live": [{"element": "c0r0", "force": [1, 0]}]}
    weightless = space_of({**DOCUMENT, "loads": pushed, "materials": {**DOCUMENT["materials"], "density": 0}})
    assert DRIVERS["portfolio"](weightless, 0).standing_start._make_driver() is None
