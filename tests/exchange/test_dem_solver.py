"""jld as a solver of compas_dem: stored problems always, their own classes and templates where these are installed."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.exchange import import_file
from jld_formats.dem_solver import NAME, dem_solve, jld_solver, solve_document

PROBLEM = Path(__file__).parent / "data" / "compas_dem_problem.json"


def stored(change: Callable[[Any, Any], None] | None = None) -> Any:
    """The stored analysis without prescribed movements; change: of its problem and its first group."""
    document = json.loads(PROBLEM.read_text())
    problem = document["data"]["problems"][0]
    for group in problem["data"]["boundary_conditions"]:
        group["data"]["displacements"] = []
    if change is not None:
        change(problem["data"], problem["data"]["boundary_conditions"][0]["data"])
    return document


def numbers(value: Any) -> list[float]:
    """All numbers in nested dicts and lists, in order."""
    if isinstance(value, dict | list):
        return [one for part in (value.values() if isinstance(value, dict) else value) for one in numbers(part)]
    return [float(value)] if isinstance(value, int | float) else []


def balance(results: Any) -> Any:
    """Sum of the corner forces at each node, in space."""
    left: dict[str, Any] = {}
    for edge, entry in results["data"]["edge_data"].items():
        frame = entry["contact_data"]["data"]["frame"]["data"]
        x, y = np.array(frame["xaxis"]), np.array(frame["yaxis"])
        own = np.zeros(3)
        for n, u, v in zip(*(entry[f"force_{key}"] for key in ("normal", "tangent1", "tangent2")), strict=True):
            own += n * np.cross(x, y) + u * x + v * y
        np.testing.assert_allclose(own, entry["resultant_global"], rtol=1e-9, atol=1e-9 * np.abs(own).max())
        a, b = edge.split(",")
        left[a] = left.get(a, 0.0) - own
        left[b] = left.get(b, 0.0) + own
    return left


def test_a_stored_problem_is_solved_as_its_import_is(tmp_path: Path) -> None:
    document = stored()
    path = tmp_path / "a.json"
    path.write_text(json.dumps(document))
    results = solve_document(document)
    metadata = results["data"]["metadata"]
    again = solve(build_assembly(parse_scene(import_file(path).document)))
    assert metadata["status"] == "collapse"
    assert metadata["load_factor"] == pytest.approx(again.load_factor, rel=1e-8)
    assert results["dtype"] == "compas_dem.problem/Results"
    assert results["data"]["problem_id"] == document["data"]["problems"][0]["guid"]
    assert set(results["data"]["node_data"]) == set(document["data"]["model"]["data"]["graph"]["node"])
    assert len(balance(results)) == len(results["data"]["node_data"])


def test_groups_act_together() -> None:
    """Two groups with half of the loads each give the λ of one with all of them."""

    def halved(problem: Any, group: Any) -> None:
        for load in group["point_loads"]:
            load["data"]["force"] = [0.5 * value for value in load["data"]["force"]]
            load["data"]["moment"] = None
        group["body_forces"], group["surface_loads"] = [], []
        problem["boundary_conditions"] = [problem["boundary_conditions"][0]]
        twin = copy.deepcopy(problem["boundary_conditions"][0])
        twin["data"]["name"] = "twin"
        problem["boundary_conditions"].append(twin)

    def whole(problem: Any, group: Any) -> None:
        for load in group["point_loads"]:
            load["data"]["moment"] = None
        group["body_forces"], group["surface_loads"] = [], []
        problem["boundary_conditions"] = [problem["boundary_conditions"][0]]

    values = [solve_document(stored(change))["data"]["metadata"]["load_factor"] for change in (halved, whole)]
    assert values[0] == pytest.approx(values[1], rel=1e-8)


def test_prescribed_movements_and_missing_packages_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="limit analysis knows no prescribed movement"):
        solve_document(json.loads(PROBLEM.read_text()))
    with pytest.raises(InputError, match="friction"):
        jld_solver(friction="sticky")
    monkeypatch.setitem(__import__("sys").modules, "compas_dem.problem", None)
    with pytest.raises(InputError, match=r"compas_dem is not installed; expected pip install 'jld\[compas\]'"):
        jld_solver()


TEMPLATES = {
    "arch": ("ArchTemplate", {"rise": 3.0, "span": 6.0, "thickness": 0.6, "depth": 0.5, "n": 11}),
    "barrel": ("BarrelVaultTemplate", {"vou_span": 7, "vou_length": 2}),
    "staggered": ("BarrelVaultStaggeredTemplate", {"vou_span": 7, "vou_length": 2}),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", TEMPLATES)
def test_templates_are_solved_by_their_own_classes(name: str) -> None:
    compas = pytest.importorskip("compas", reason="compas_dem is not installed")
    pytest.importorskip("compas_dem", reason="compas_dem is not installed")
    templates, models, problems, material = (
        pytest.importorskip(f"compas_dem.{part}") for part in ("templates", "models", "problem", "material")
    )
    kind, options = TEMPLATES[name]
    model = models.BlockModel.from_template(getattr(templates, kind)(**options))
    stone = material.GenericMaterial(density=2000.0)
    model.add_material(stone)
    blocks = list(model.elements())
    model.assign_material(stone, elements=blocks)
    low = min(float(block.modelgeometry.aabb().zmin) for block in blocks)
    for block in blocks:
        if float(block.modelgeometry.aabb().zmin) < low + 1e-3:
            block.is_support = True
    model.compute_contacts(tolerance=1e-3)
    problem = problems.Problem(model)
    group = problems.BoundaryConditionGroup(name="Live")
    group.add_global_body_force(9.81, 0.0, 0.0)
    problem.add_boundary_condition(group)
    problem.set_contact_model("MohrCoulomb", mu=0.6)
    problem.set_solver(jld_solver())
    results = problem.solve()
    assert type(results).__name__ == "Results"
    assert results.metadata["status"] == "collapse"
    assert problem._solver.name == NAME
    direct = dem_solve(problem, model)
    assert direct.metadata["load_factor"] == pytest.approx(results.metadata["load_factor"], rel=1e-9)
    text = compas.json_dumps(results)
    back = json.loads(compas.json_dumps(compas.json_loads(text)))
    size = max(abs(value) for value in numbers(back["data"]))
    np.testing.assert_allclose(numbers(back["data"]), numbers(json.loads(text)["data"]), rtol=1e-9, atol=1e-12 * size)
    weight = sum(9.81 * 2000.0 * abs(block.modelgeometry.volume()) for block in blocks if not block.is_support)
    reaction = np.zeros(3)
    for u, v in results.edges():
        fixed = [model.graph.node_element(node).is_support for node in (u, v)]
        reaction += np.array(results.resultant_global((u, v))) * (fixed[0] - 1.0 * fixed[1])
    wanted = [-results.metadata["load_factor"] * weight, 0.0, weight]
    np.testing.assert_allclose(reaction, wanted, atol=1e-5 * weight)
