"""Load cases by fields: a table names the case that governs, as `solve` does, and keeps what is known of the others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from jld_core import Status, build_assembly, parse_scene, solve, solve_many
from jld_core.limit import CaseBounds, governing
from jld_explore import explore

SCENE: dict[str, Any] = {
    "grid": {"cell": [1.0, 1.0], "thickness": 0.5, "rows": ["abc", "#.#"]},
    "materials": {
        "density": 2000,
        "dry": {"friction_coefficient": 0.6},
        "inner": {"tensile_strength": 2e5, "shear_strength": 3e5, "friction_coefficient": 0.5},
    },
    "loads": {
        "cases": [
            {"name": "down", "live": [{"element": "c1r0", "force": [0, -1e4], "at": [1.5, 2.0]}]},
            {"name": "side", "live": [{"body": [1, 0]}], "required": 0.5},
        ]
    },
    "cracks": {"kind": "fields", "gap": 0.9},
}


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("driver", ["random", "enumeration"])
def test_searches_by_fields_name_the_case_that_governs(driver: str, back: bool) -> None:
    cases = SCENE["loads"]["cases"]
    document = {**SCENE, "loads": {"cases": cases[::-1] if back else cases}}
    assembly = build_assembly(parse_scene(document))
    best = explore(document, driver=driver, seconds=20, budget=3).results.iloc[0]
    labels = np.array([letter == "d" for letter in best["labelling"]])
    assert best["governing"] == "side"
    # beside a weak bound of the case that governs stands the first one of the other
    assert best["load_factor[down]"] > 2.0 * best["load_factor[side]"]
    alone = solve(document, labels)
    assert alone.governing == "side"
    assert solve_many(assembly, [labels]).governing == ("side",)


@pytest.mark.parametrize("back", [False, True])
def test_a_wide_bracket_does_not_govern_before_a_lower_one(back: bool) -> None:
    """What is known to be at most 1.2 governs before what is between 1.1 and 47."""
    cases = [CaseBounds(Status.COLLAPSE, 1.1, 47.0, 1.1), CaseBounds(Status.COLLAPSE, 1.1, 1.2, 1.1)]
    found = governing(cases[::-1] if back else cases, [1.0, 1.0])
    assert (found.low, found.high, found.case) == (1.1, 1.2, 0 if back else 1)
