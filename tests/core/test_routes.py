"""Direct route = HiGHS = an independent statement in CVXPY, on random labellings of grids of every kind."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cases import CASES, grid_assembly
from jld_core import InputError, LimitAnalysis, LimitAnalysisResult, Status, solve
from jld_core.program import Template
from jld_core.solvers import ClarabelSolver
from proofs import reference_load_factor

ASSEMBLIES = {name: grid_assembly(rows, **options) for name, (rows, options) in CASES.items()}
ANALYSES = {name: LimitAnalysis(assembly) for name, assembly in ASSEMBLIES.items()}
LINEAR = [name for name, analysis in ANALYSES.items() if not analysis.template.structure.cones]


def signed(result: LimitAnalysisResult) -> float:
    """λ, or the infinity that stands for the status, as the reference gives it."""
    return {Status.LOCKED: np.inf, Status.UNSTABLE: -np.inf}.get(result.status, result.load_factor)


def close(first: float, second: float, name: str) -> bool:
    """Equal to 1e-7 of λ, or of the weight ratio below which λ counts as zero."""
    if not (np.isfinite(first) and np.isfinite(second)):
        return first == second
    floor = 1e-3 * ASSEMBLIES[name].total_dead / ASSEMBLIES[name].total_live
    tolerance = 1e-6 if "strong" in name else 3e-7 if ANALYSES[name].template.structure.cones else 1e-7
    return abs(first - second) <= tolerance * max(abs(first), abs(second), floor)


@st.composite
def labelled_grids(draw: st.DrawFn) -> tuple[str, np.ndarray]:
    name = draw(st.sampled_from(sorted(CASES)))
    share = draw(st.sampled_from([0.15, 0.5, 0.8, 1.0]))
    seed = draw(st.integers(0, 2**32 - 1))
    return name, np.random.default_rng(seed).random(len(ASSEMBLIES[name].interfaces)) < share


@settings(max_examples=32, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(labelled_grids())
@pytest.mark.filterwarnings("ignore")  # CVXPY says where its own solver was inexact; the comparison is ours
def test_direct_equals_independent_statement(case: tuple[str, np.ndarray]) -> None:
    name, labels = case
    result = ANALYSES[name].solve(labels, stands=False)
    assert result.status is not Status.UNCERTIFIED
    assert close(signed(result), reference_load_factor(ASSEMBLIES[name], labels), name)


@settings(max_examples=80, deadline=None, derandomize=True)
@given(labelled_grids())
def test_direct_equals_highs(case: tuple[str, np.ndarray]) -> None:
    name, labels = case
    if name not in LINEAR:
        return
    direct = ANALYSES[name].solve(labels, stands=False)
    simplex = LimitAnalysis(ASSEMBLIES[name], solver="highs").solve(labels, stands=False)
    assert close(signed(direct), signed(simplex), name)


def test_answers_do_not_depend_on_what_was_solved_before() -> None:
    rng = np.random.default_rng(3)
    for name, assembly in ASSEMBLIES.items():
        labellings = rng.random((6, len(assembly.interfaces))) < 0.6
        onward = [ANALYSES[name].solve(labels, stands=False).bracket for labels in labellings]
        fresh = LimitAnalysis(assembly)
        backward = [fresh.solve(labels, stands=False).bracket for labels in labellings[::-1]][::-1]
        np.testing.assert_array_equal(onward, backward)


def test_updated_program_equals_rebuilt_one() -> None:
    """A relabelling changes numbers in place and never the structure; both are counted."""
    assembly = ASSEMBLIES["wall"]
    template, route = Template(assembly), ClarabelSolver()
    rng = np.random.default_rng(5)
    route.solve(template.program(np.ones(len(assembly.interfaces), dtype=bool)))
    for _ in range(10):
        labels = rng.random(len(assembly.interfaces)) < 0.5
        updated = route.solve(template.program(labels)).point[-1]
        rebuilt = ClarabelSolver().solve(Template(assembly).program(labels)).point[-1]
        assert updated == pytest.approx(rebuilt, rel=1e-9)
    assert (route.updates, route.rebuilds) == (10, 1)


def test_a_solver_that_does_not_take_the_scene_is_bad_input() -> None:
    """As `solve` promises: it was a SolverError."""
    name = next(name for name in CASES if name not in LINEAR)
    with pytest.raises(InputError, match=r"solver: highs takes linear programs only; .* expected a solver"):
        solve(ASSEMBLIES[name], solver="highs")
    assert solve(ASSEMBLIES[LINEAR[0]], solver="highs").status is Status.COLLAPSE
