"""Bounds by fields on the governing case: those of the cases, with the lower bound raised first."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jld_core import Assembly, build_assembly, parse_scene
from jld_core.fields import bounds_by_fields, governing_bounds
from jld_core.fields.bounds import FieldRefinement


@pytest.fixture(scope="module")
def blocks() -> Assembly:
    """Two blocks side by side on a support: a push slides them, a force on one overturns it."""
    elements = [{"id": f"b{k}", "polygon": [[k, 0.0], [k + 1.0, 0.0], [k + 1.0, 1.0], [k, 1.0]]} for k in (0, 1)]
    ground = {"id": "s", "polygon": [[-1.0, -0.5], [3.0, -0.5], [3.0, 0.0], [-1.0, 0.0]], "support": True}
    cases = [
        {"name": "push", "live": [{"body": [0.1, 0.0]}]},
        {"name": "pull", "live": [{"body": [0.5, 0.0]}], "required": 1.0},
    ]
    materials = {
        "density": 2000.0,
        "dry": {"friction_coefficient": 0.4},
        "inner": {"tensile_strength": 1e6, "shear_strength": 1e6},
    }
    document = {"elements": [*elements, ground], "thickness": 0.5, "materials": materials, "loads": {"cases": cases}}
    return build_assembly(parse_scene(document))


def test_the_governing_bracket_holds_the_closed_form(blocks: Assembly) -> None:
    """Blocks slide at μ over the push: 0.4/0.5 governs, whatever comes first; both routes agree."""
    for lower_first in (True, False):
        low, high = governing_bounds(blocks, blocks.labels, 20.0, gap=0.02, lower_first=lower_first)
        assert low <= 0.8 * (1.0 + 1e-6)
        assert high >= 0.8 * (1.0 - 1e-6)
        assert low == pytest.approx(0.8, rel=0.05)
    single = [bounds_by_fields(case, blocks.labels, gap=0.05) for case in blocks.by_case]
    assert min(one.lower for one in single) <= high * (1.0 + 1e-9)
    assert low <= min(one.upper for one in single) * (1.0 + 1e-9)


def test_the_upper_bound_is_left_out_of_two_meshes_in_three(blocks: Assembly) -> None:
    """Meshes 1, 4, ... have both bounds; a caller may leave more of them out, and the best bound stays."""
    refinement = FieldRefinement(blocks.by_case[1], gap=1e-9, lower_first=True)
    steps = [refinement.step() for _ in range(4)]
    uppers = [step.upper for step in steps[-1].history]
    assert [math.isfinite(upper) for upper in uppers] == [True, False, False, True]
    assert steps[-1].upper == min(uppers)
    assert refinement.step(upper=True).history[-1].upper < np.inf
    assert refinement.step(upper=False).history[-1].upper == np.inf
    assert refinement.expected_with(upper=True) > refinement.expected_with(upper=False) > refinement.spent


def test_no_time_leaves_the_first_meshes(blocks: Assembly) -> None:
    """With no time the bounds are those of the coarsest meshes, and still hold."""
    low, high = governing_bounds(blocks, blocks.labels, 0.0)
    assert low <= 0.8 * (1.0 + 1e-6) <= high * (1.0 + 2e-6)
