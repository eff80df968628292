"""Several load cases: one structure, the factor that governs, and every case's own proof."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import dry_and_inner, grid_document
from command import Command, saved
from jld_core import InputError, LimitAnalysis, SolveOptions, SolverError, Status, build_assembly, parse_scene, solve
from jld_core.limit import CaseBounds, case_relaxation, governing
from jld_core.models import CaseAnalysis
from jld_core.program import Template
from jld_core.solvers import HighsSolver

ROWS = ["aab", "cbb", "###"]
RIGHT, LEFT = [{"body": [1, 0]}], [{"body": [-1, 0]}]


def document(cases: list[dict[str, Any]], rows: list[str] = ROWS, **keys: Any) -> dict[str, Any]:
    return {**grid_document(rows, **keys), "loads": {"cases": cases}}


def single(live: list[dict[str, Any]], dead: list[dict[str, Any]] | None = None, **keys: Any) -> float:
    scene = {**grid_document(ROWS, **keys), "loads": {"live": live, "dead": dead or []}}
    return solve(build_assembly(parse_scene(scene))).load_factor


def test_the_case_with_the_least_ratio_to_the_required_factor_governs() -> None:
    push = [{"element": "c0r0", "force": [0, -400.0]}]
    cases = [
        {"name": "right", "live": RIGHT, "required": 0.5},
        {"name": "left", "live": LEFT, "dead": push, "required": 2.0},
    ]
    assembly = build_assembly(parse_scene(document(cases)))
    found = solve(assembly)
    right, left = single(RIGHT) / 0.5, single(LEFT, push) / 2.0
    assert found.status is Status.COLLAPSE
    assert found.load_factor == pytest.approx(min(right, left), rel=1e-9)
    assert found.governing == ("right" if right < left else "left")
    assert found.cases["right"].load_factor == pytest.approx(0.5 * right, rel=1e-9)
    assert found.cases["left"].load_factor == pytest.approx(2.0 * left, rel=1e-9)
    assert found.bracket[0] <= found.load_factor <= found.bracket[1]
    assert found.gap < 1e-6
    with pytest.raises(ValueError, match="by_case"):
        Template(assembly)


def test_an_analysis_of_all_cases_serves_many_labellings() -> None:
    """Analyses that are kept give what `solve` gives, whatever was solved before; without cases there is one result."""
    cases = [{"name": "right", "live": RIGHT}, {"name": "left", "live": LEFT, "required": 2.0}]
    assembly = build_assembly(parse_scene(document(cases)))
    kept = CaseAnalysis(assembly)
    for labels in (np.ones(len(assembly.interfaces), dtype=bool), assembly.labels):
        found, alone = kept.solve(labels, stands=True), solve(assembly, labels)
        assert list(found.cases) == ["right", "left"]
        assert found.governing == alone.governing
        assert found.load_factor == pytest.approx(alone.load_factor, rel=1e-9)
        assert found.stands_at_zero is alone.stands_at_zero
    (one, _) = assembly.by_case
    assert CaseAnalysis(one).solve(assembly.labels).load_factor == found.cases["right"].load_factor
    with pytest.raises(InputError, match="solver"):
        CaseAnalysis(build_assembly(parse_scene(document(cases, crush_dry=1e6))), SolveOptions(solver="highs"))


def known(status: Status, low: float = math.nan, high: float = math.nan) -> CaseBounds:
    return CaseBounds(status, low, high, 0.5 * (low + high))


def test_the_governing_case() -> None:
    collapse, locked = known(Status.COLLAPSE, 1.0, 1.0), known(Status.LOCKED, 0.2)
    assert governing([collapse, locked], [1, 1]).status is Status.COLLAPSE
    assert governing([collapse, locked], [1, 1]).load_factor == 1.0
    both = governing([locked, locked], [1, 2])
    assert (both.status, both.low, both.case) == (Status.LOCKED, 0.1, 1)
    assert math.isnan(both.high)
    assert governing([collapse, known(Status.UNSTABLE)], [1, 1]).status is Status.UNSTABLE
    # a case that is open matters where it may be the least, and not where it is certain not to be
    assert governing([collapse, known(Status.UNCERTIFIED, 0.5, 3.0)], [1, 1]).status is Status.UNCERTIFIED
    assert governing([collapse, known(Status.UNCERTIFIED, 1.5, 3.0)], [1, 1]).status is Status.COLLAPSE
    assert governing([collapse, known(Status.UNCERTIFIED, 1.5, 3.0)], [1, 2]).status is Status.UNCERTIFIED
    assert governing([collapse, known(Status.UNCERTIFIED, 0.5, math.nan)], [1, 1]).status is Status.COLLAPSE
    open_end = governing([known(Status.UNCERTIFIED, math.nan, 2.0), collapse], [1, 1])
    assert (open_end.status, open_end.high) == (Status.UNCERTIFIED, 1.0)
    assert math.isnan(open_end.low)
    # of brackets that overlap none is the lower: two routes to one λ shall name one case, not one each by rounding
    near, nearer = known(Status.COLLAPSE, 1.0 - 2e-9, 1.0 + 1e-9), known(Status.COLLAPSE, 1.0 - 1e-9, 1.0)
    assert [governing(pair, [1, 1]).case for pair in ([near, nearer], [nearer, near])] == [0, 0]
    assert governing([near, nearer], [1, 1]).high == 1.0
    assert governing([known(Status.COLLAPSE, 1.1, 1.1), nearer], [1, 1]).case == 1


def test_a_bound_of_any_case_bounds_the_factor() -> None:
    """Against all labellings: with everything undecided the bound is above the best governing factor."""
    cases = [{"name": "r", "live": RIGHT}, {"name": "l", "live": LEFT, "required": 1.7}]
    assembly = build_assembly(parse_scene(document(cases)))
    each = [case_relaxation.Relaxation(LimitAnalysis(case)) for case in assembly.by_case]
    relaxation = case_relaxation.CaseRelaxation(each, assembly.required.tolist())
    count = len(assembly.interfaces)
    free = assembly.free_faces
    values = []
    for number in range(0, 2 ** int(free.sum()), 3):
        labels = np.ones(count, dtype=bool)
        labels[free] = [bool(number >> k & 1) for k in range(int(free.sum()))]
        found = solve(assembly, labels)
        if found.status is Status.COLLAPSE:
            values.append(found.load_factor)
            decided = np.zeros(count, dtype=bool)
            assert relaxation.refute(labels, decided, found.load_factor * (1.0 - 1e-6)) is None
            proof = relaxation.refute(labels, decided, found.load_factor * (1.0 + 1e-5))
            assert proof.bound >= found.load_factor * (1.0 - 1e-7)
    assert relaxation.bound(np.ones(count, dtype=bool), free) >= max(values) * (1.0 - 1e-9)


@pytest.mark.parametrize(
    ("loads", "words"),
    [
        ({"live": RIGHT, "cases": [{"name": "a", "live": RIGHT}]}, 'loads.live: it is given together with "cases"'),
        ({"cases": []}, "loads.cases"),
        ({"cases": [{"name": "a"}]}, "loads.cases[0].live: missing"),
        ({"cases": [{"name": "a", "live": []}]}, "loads.cases[0].live: the live load is zero"),
        ({"cases": [{"name": "a", "live": RIGHT}] * 2}, "loads.cases[1].name: 'a' is used twice"),
        ({"cases": [{"name": "a", "live": RIGHT, "required": 0}]}, "loads.cases[0].required"),
        ({"cases": [{"name": "a", "live": [{"element": "x", "force": [1, 0]}]}]}, "loads.cases[0].live[0].element"),
        ({"cases": [{"name": "a", "live": RIGHT, "dead": [{"body": "x"}]}]}, "loads.cases[0].dead[0].body"),
        ({"cases": [{"name": "a", "live": RIGHT, "lvie": 1}]}, "loads.cases[0].lvie: unknown key"),
    ],
)
def test_wrong_cases(loads: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        build_assembly(parse_scene({**grid_document(ROWS), "loads": loads}))
    assert str(caught.value).removeprefix("scene: ").startswith(words)


def test_the_command_line(tmp_path: Path, jld: Command) -> None:
    file = saved(
        tmp_path / "scene.json", document([{"name": "r", "live": RIGHT}, {"name": "l", "live": LEFT, "required": 2.0}])
    )
    found = json.loads(jld("solve", file, "--json").out)
    assert set(found["cases"]) == {"r", "l"}
    assert found["governing"] in found["cases"]
    ratios = {"r": found["cases"]["r"]["load_factor"], "l": found["cases"]["l"]["load_factor"] / 2.0}
    assert found["load_factor"] == pytest.approx(min(ratios.values()), rel=1e-9)
    assert ratios[found["governing"]] == min(ratios.values())
    out = jld("solve", file, "--out", tmp_path / "out").out
    assert "λ r" in out
    assert sorted(p.name for p in (tmp_path / "out").glob("*.png")) == ["result-1.png", "result-2.png", "vertices.png"]
    checked = jld("check", file).out
    assert "live load l" in checked
    assert "symmetries" in checked


def test_the_solver_must_support_every_load_case(monkeypatch: pytest.MonkeyPatch, jld: Command, tmp_path: Path) -> None:
    """Only the first load case was asked before the work began."""
    cases = [{"name": "right", "live": RIGHT}, {"name": "left", "live": LEFT}]
    (tmp_path / "a.json").write_text(json.dumps(document(cases)))
    asked: list[Any] = []

    def refuse_second(_: Any, structure: Any) -> None:
        asked.append(structure)
        if len(asked) > 1:
            raise SolverError("the second case is too much")

    monkeypatch.setattr(HighsSolver, "require", refuse_second)
    assert "solver: the second case is too much" in jld("solve", tmp_path / "a.json", "--solver", "highs").err


# Load cases of a scene that cracks by cells, whose sizes may be texts with a unit.


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
