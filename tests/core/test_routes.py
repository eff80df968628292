"""Direct route = HiGHS = an independent statement in CVXPY, on random labellings of grids of every kind."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import cases
from cases import CASES, grid_assembly
from jld_core import InputError, LimitAnalysis, LimitAnalysisResult, SolveOptions, Status, solve, solvers
from jld_core.limit import result_of
from jld_core.models import limit_analysis, solve_labelling
from jld_core.program import ConicProgram, Template
from jld_core.solvers import SOLVERS, ClarabelSolver, HighsSolver, RawSolution, Solver, installed_solvers
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


@settings(max_examples=16, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(labelled_grids())
@pytest.mark.filterwarnings("ignore")  # CVXPY says where its own solver was inexact; the comparison is ours
def test_direct_equals_independent_statement(case: tuple[str, np.ndarray]) -> None:
    name, labels = case
    result = ANALYSES[name].solve(labels, stands=False)
    assert result.status is not Status.UNCERTIFIED
    assert close(signed(result), reference_load_factor(ASSEMBLIES[name], labels), name)


@settings(max_examples=40, deadline=None, derandomize=True)
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


# One policy: what is modelled travels with the result, solvers are handed in, rungs are tried in order.


class Own(Solver):
    """A solver of one's own: dual simplex, counted."""

    name = "own"

    def __init__(self) -> None:
        self.asked = 0

    def solve(self, program: ConicProgram) -> RawSolution:
        self.asked += 1
        return HighsSolver().solve(program)


@pytest.mark.parametrize("condense", ["off", "on"])
def test_a_solver_is_handed_in(condense: str) -> None:
    assembly = grid_assembly(["aab", "abb", "###"])
    own = Own()
    found = solve(assembly, solver=own, condense=condense)
    assert own.asked >= 1
    assert found.solve_log[0].endswith("own")
    assert found.model.solver is own
    assert found.model.facts()["solver"] == "own"
    assert found.load_factor == pytest.approx(solve(assembly).load_factor, rel=1e-7)


def test_a_result_has_the_options_of_its_model() -> None:
    assembly = cases.assembly_in_space(cases.wall_in_space(3, 2))
    given = {"contact": "concave", "inner_bending": "kern", "condense": "off", "gap": 1e-5}
    found = solve(assembly, **given)
    assert found.model == SolveOptions(**given)
    assert (found.contact, found.friction) == ("concave", "associative")
    assert found.forces.shape == (len(assembly.interfaces), 6)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"contact": "glued"}, "contact: no contact is named 'glued'"),
        ({"inner_bending": "elastic"}, "uncoupled or kern"),
        ({"effective_area": True, "contact": "concave"}, "point contacts have no effective area"),
        ({"gap": 0.0}, "gap: 0 is no relative width"),
        ({"solver": "simplex"}, "no solver is named"),
    ],
)
def test_invalid_options_are_refused(options: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        solve(grid_assembly(["aa", "##"]), **options)


def test_a_solver_that_is_not_installed_is_refused_and_not_advised(monkeypatch: pytest.MonkeyPatch) -> None:
    assert installed_solvers() == SOLVERS
    monkeypatch.setattr(solvers, "find_spec", lambda name: None)
    assert installed_solvers() == tuple(name for name in SOLVERS if name != "cvxpy")
    with pytest.raises(InputError, match=r"solver: cvxpy is not installed.*jld\[reference\]"):
        solve(grid_assembly(["aa", "##"]), solver="cvxpy")


@pytest.mark.parametrize(
    "options",
    [
        SolveOptions(),
        SolveOptions(contact="concave"),
        pytest.param(SolveOptions(effective_area=True), marks=pytest.mark.long),
        SolveOptions(friction="zero-dilation"),
        SolveOptions(friction="zero-dilation", contact="concave"),
        SolveOptions(condense="on"),
    ],
    ids=lambda o: ",".join(f"{k}={v}" for k, v in o.facts().items() if v != SolveOptions().facts()[k]) or "plain",
)
def test_proofs_are_about_the_assembly_whatever_was_modelled(options: SolveOptions) -> None:
    """Forces balance the loads at their λ, and the mechanism does one unit of live work: sums in scene units."""
    assembly = cases.assembly_in_space(cases.wall_in_space(3, 2))
    analysis = limit_analysis(assembly, options)
    proof = solve_labelling(analysis, assembly.labels, options, stands=True)
    assert proof.status is Status.COLLAPSE
    assert proof.stands is True
    held = proof.found or proof.state
    template = analysis.template
    left = template.matrix @ held.forces.ravel() + template.dead + held.load * template.live
    assert abs(left).max() <= 1e-8
    assert template.live @ proof.motion.velocity == pytest.approx(1.0, rel=1e-9)
    result = result_of(template, assembly.labels, options, proof, elapsed=0.0)
    assert result.load_factor == pytest.approx(solve(assembly, **vars(options)).load_factor, rel=1e-9)
