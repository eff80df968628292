"""A bracket is a proof whatever its width: what is finite is a collapse, ranked by its lower end."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from benchmarks.claims import Tally, refined

from cases import grid_document
from jld_core import Status, build_assembly, parse_scene, solve, solve_many
from jld_core.views import facts_of_result
from jld_explore.report.tables import _ties, is_ahead


@pytest.mark.parametrize("seed", [28, 42, 76, 134, 147])
def test_strong_refined_samples_have_narrow_brackets(seed: int) -> None:
    """Tensile strengths of 1e8 Pa and more, beside weights of some kilonewtons."""
    tally = Tally("")
    assert refined.case(seed, tally) == ""
    assert tally.notes == {"collapse": 1}


@pytest.mark.parametrize(
    ("cell", "crush", "push"),
    [
        ((0.103, 0.505), 51157847.475701064, (-0.29868210051896954, -0.45822670143651395)),
        ((0.11, 0.4), 3e7, (-0.3, -0.4)),
        ((0.2, 0.3), 1e8, (0.3, -0.2)),
        ((0.3, 0.5), 2e8, (0.4, -0.5)),
    ],
)
def test_one_layout_is_known_as_well_as_many(
    cell: tuple[float, float], crush: float, push: tuple[float, float]
) -> None:
    """Cells whose dry joints crush: `solve` is as narrow as `solve_many`, which asks the batch solver first."""
    document = grid_document(["aa", "##"], live=[{"body": list(push)}])
    document["grid"].update(cell=list(cell), thickness=0.13)
    document["materials"] = {
        "density": 2000.0,
        "dry": {"friction_coefficient": 0.75, "compressive_strength": crush},
        "inner": {"tensile_strength": 1083198.151321064, "shear_strength": 108768.34980765745},
    }
    document["labels"] = {"default": "dry"}
    assembly = build_assembly(parse_scene(document))
    alone, many = solve(assembly), solve_many(assembly, [assembly.labels])
    assert alone.status is many.status[0] is Status.COLLAPSE
    assert alone.gap <= 1e-6
    assert alone.bracket[0] <= many.high[0]
    assert many.low[0] <= alone.bracket[1]


def test_a_wide_bracket_is_a_collapse_that_says_how_wide_it_is() -> None:
    """λ is the lower end of a wide bracket; advice names solvers that accept the scene."""
    # cones of crushing: HiGHS refuses them
    document = grid_document(["ab", "##"])
    document["materials"]["dry"]["compressive_strength"] = 1e6
    result = solve(build_assembly(parse_scene(document)), gap=1e-17)
    facts = facts_of_result(result)
    assert result.status is Status.COLLAPSE
    assert any("apart, relative" in warning for warning in result.warnings)
    assert "may narrow" in facts["next"]
    assert "highs" not in facts["next"]


def test_ranks_count_what_is_proven_stronger() -> None:
    """A wide bracket shares the rank of all that it overlaps, and keeps nothing else from its place."""
    value, low, high = np.array(
        [
            [2.0, 2.0, 2.0],
            [1.5, 1.5, 1.5],
            [0.2, 0.2, 3.4],
            [1.5, 1.5 - 1e-9, 1.5 + 1e-9],
            [1.0, 1.0, 1.2],
            [math.nan] * 3,
        ]
    ).T
    group, level = _ties(value, low, high)
    assert group.tolist() == [1, 2, 1, 2, 4, 0]
    assert level.tolist() == [1, 2, 4, 2, 3, 0]
    table = pd.DataFrame({"rank": [1, 1, 3], "bracket_lo": [2.0, 0.2, 1.5], "bracket_hi": [2.0, 3.4, 1.5]})
    assert not is_ahead(table, None, 1e-6)
    assert is_ahead(table, 2.0, 1e-6)
    assert is_ahead(table.assign(rank=[1, 2, 3]), None, 1e-6)
