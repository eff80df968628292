"""Load cases of a scene that cracks by cells, whose sizes may be texts with a unit."""

from __future__ import annotations

from typing import Any

import pytest

from cases import dry_and_inner
from jld_core import solve

SCENE: dict[str, Any] = {
    "grid": {"cell": [1.0, 1.0], "thickness": 0.5, "rows": ["abc", "#.#"]},
    "materials": dry_and_inner(2000, 0.6, 1e5, 1.5e5),
    "loads": {
        "cases": [
            {"name": "down", "live": [{"element": "c1r0", "force": [0, -1e4], "at": [1.5, 2.0]}]},
            {"name": "side", "live": [{"body": [1, 0]}]},
        ]
    },
    "members": [
        {
            "kind": "tendon",
            "from": {"element": "c0r0", "at": [0.5, 1.5]},
            "to": {"element": "c2r0", "at": [2.5, 1.5]},
            "prestress": 4e4,
        }
    ],
}
CELLS: dict[str, Any] = {**SCENE, "cracks": {"kind": "cells", "cell": 0.5}}


def test_each_case_says_by_which_cracks_its_load_factor_is() -> None:
    found = solve(CELLS)
    assert {name: one.cracks for name, one in found.cases.items()} == dict.fromkeys(("down", "side"), found.cracks)
    assert all(one["cracks"] == {"kind": "cells", "cell": 0.5} for one in found.to_json()["cases"].values())
    assert not any("along the faces drawn alone" in words for one in found.cases.values() for words in one.warnings)


@pytest.mark.parametrize("length", ["50 cm", "500 mm", "0.5 m"])
def test_sizes_of_cells_may_have_a_unit(length: str) -> None:
    grid = {**CELLS["grid"], "cell": ["100 cm", "1 m"]}
    found = solve({**CELLS, "grid": grid, "cracks": {"kind": "cells", "cell": length}, "tolerance": "0.1 mm"})
    assert found.load_factor == pytest.approx(solve(CELLS).load_factor, rel=1e-9)
