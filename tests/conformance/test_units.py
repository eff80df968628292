"""λ is the same in other units: a share of `python -m benchmarks.claims units`, and the program that solvers see."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from benchmarks.claims import Tally, units

from jld_core import build_assembly, parse_scene
from jld_core.program import ConicProgram, Template

SCENES = (1, 3, 7, 8, 10, 13, 14, 15, 19, 22, 24, 34, 39, 45, 48, 51, 54, 55, 61, 76)
"""Seeds of quick scenes: in space and in the plane, with crushing, cohesion, load cases, voids and without weight."""


@pytest.mark.parametrize("seed", SCENES)
def test_load_factor_does_not_depend_on_units(seed: int) -> None:
    tally = Tally(units.CLAIM)
    assert units.case(seed, tally, ("kN and mm", "pounds and inches")) == ""
    assert sum(tally.notes.values()) == 2


@pytest.mark.parametrize("seed", SCENES[:10])
def test_solvers_see_the_same_program_in_other_units(seed: int) -> None:
    """Not all seeds would pass: 1 program of 100 has a number that is rounded up in one unit and down in another."""
    document, labels = units.drawn(seed)
    one, *others = [_seen(changed, labels) for changed in (document, *units.changes(document, seed).values())[:4]]
    for other in others:
        for key in ("data", "rhs", "objective"):
            assert np.array_equal(getattr(one, key), getattr(other, key)), key
        assert np.array_equal(one.structure.indices, other.structure.indices)


def _seen(document: dict[str, Any], labels: np.ndarray) -> ConicProgram:
    """Return the rounded program of the first load case."""
    return Template(build_assembly(parse_scene(document)).by_case[0]).program(labels).rounded


def test_entries_that_are_zero_by_construction_are_no_entries() -> None:
    """Arms of 1e-17 of a size came and went with the units, and with them the sparsity of all programs."""
    for seed in SCENES[1:4]:
        document, _ = units.drawn(seed)
        matrices = [
            Template(build_assembly(parse_scene(changed)).by_case[0]).matrix
            for changed in (document, *units.changes(document, seed).values())[:4]
        ]
        assert abs(matrices[0].data).min() > 1e-9
        assert all(np.array_equal(matrices[0].indices, matrix.indices) for matrix in matrices)
