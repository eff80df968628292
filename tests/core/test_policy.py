"""One policy: what is modelled travels with the result, solvers are handed in, rungs are tried in order."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import cases
from cases import grid_assembly
from jld_core import InputError, LimitAnalysis, SolveOptions, Status, solve
from jld_core.limit import result_of
from jld_core.limit.analysis import FALLBACKS, insert_before
from jld_core.models import limit_analysis, solve_labelling
from jld_core.models.rigid_blocks import FALLBACKS_BY_CONDENSE
from jld_core.program import ConicProgram
from jld_core.solvers import SOLVERS, HighsSolver, RawSolution, Solver, installed_solvers


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
    monkeypatch.setattr("jld_core.solvers.find_spec", lambda name: None)
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


def test_rigid_blocks_are_tried_first_and_last() -> None:
    assert FALLBACKS_BY_CONDENSE["off"] == FALLBACKS
    names = [fallback.name for fallback in FALLBACKS_BY_CONDENSE["auto"]]
    assert [name for name in names if "rigid" not in name and name != "loaded part"] == [
        fallback.name for fallback in FALLBACKS
    ]
    assert names[0].startswith("rigid")
    assert names[-1].startswith("rigid")


def test_a_fallback_is_inserted_by_name() -> None:
    names = [one.name for one in insert_before(FALLBACKS, "repair", replace(FALLBACKS[0], name="new"))]
    assert names == [name for one in FALLBACKS for name in (["new"] if one.name == "repair" else []) + [one.name]]
    assert len(set(names)) == len(names)
    with pytest.raises(ValueError, match="nowhere"):
        insert_before(FALLBACKS, "nowhere", FALLBACKS[0])


def test_no_repair_after_a_proof() -> None:
    assembly = grid_assembly(["aab", "abb", "###"])
    analysis = LimitAnalysis(assembly)
    asked: list[tuple[str, Status]] = []

    def watched(fallback: Any) -> Any:
        def run(attempt: Any) -> None:
            asked.append((fallback.name, attempt.proof.status))
            fallback.run(attempt)

        return replace(fallback, run=run)

    watched_fallbacks = tuple(watched(fallback) for fallback in FALLBACKS)
    order = [fallback.name for fallback in FALLBACKS]
    for labels in np.random.default_rng(0).random((20, len(assembly.interfaces))) < 0.5:
        asked.clear()
        analysis.prove(labels, watched_fallbacks)
        assert [name for name, _ in asked] == [name for name in order if name in dict(asked)]
        assert all(status is Status.UNCERTIFIED for name, status in asked if name in order[:5])
    assert len(asked) < len(watched_fallbacks)
