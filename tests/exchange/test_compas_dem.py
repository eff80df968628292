"""Problems and results of compas_dem: loads, movements and joints in; forces, contacts and mechanism out."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import ROUTE
from command import SCENES, call, refused, saved
from jld_core import InputError, Layout, build_assembly, load_scene, parse_scene, samples, solve
from jld_core.limit import displacement
from jld_formats import dem_solver, export, import_file

PROBLEM = Path(__file__).parent / "data" / "compas_dem_problem.json"
"""Written by compas_dem 0.6: three blocks on one another, loads of every kind, and a support that sinks."""


def test_a_problem_becomes_loads_joints_and_settlements() -> None:
    """Each number as it was given to compas_dem, worked out by hand."""
    found = import_file(PROBLEM)
    document = found.document
    live = document["loads"]["live"]
    assert live[0] == {"element": "b2", "force": [1000.0, 0.0, 0.0], "at": [-0.5, 0.0, 1.5]}
    assert live[1] == {"element": "b1", "moment": [0.0, 5.0, 0.0]}
    assert live[2]["body"] == pytest.approx([0.1, 0.0, 0.0])  # 0.981 m/s² of 9.81
    assert live[3] == {"element": "b2", "force": [0.0, 0.0, -100.0], "at": [0.0, 0.0, 2.0]}  # 100 N/m² on 1 m²
    assert document["materials"]["gravity"] == 9.81
    joints = {"friction_coefficient": 0.6, "cohesion": 1000.0, "tensile_strength": 500.0}
    assert document["materials"]["dry"] == joints
    assert [entry.get("density") for entry in document["elements"]] == [2400.0] * 3
    moves = [{"elements": "b0", "move": [0.0, 0.0, -0.01]}]
    assert document["settlements"] == [{"name": "Live", "supports": moves}]
    assembly = build_assembly(parse_scene(document))
    weight = np.linalg.norm(assembly.elements.weight[assembly.elements.free], axis=1)
    assert weight == pytest.approx([2400 * 9.81] * 2)
    # the cubes rock about an edge of the lower one, held by weight and by 500 N/m² on 1 m² of the joint
    push = 1000 * 1.5 + 2 * 2354.4 * 1.0 + 5 - 100 * 0.5
    assert solve(assembly).load_factor == pytest.approx((2 * 23544 + 500) * 0.5 / push, rel=1e-6)


def edited(change: Any) -> dict[str, Any]:
    document = copy.deepcopy(json.loads(PROBLEM.read_text()))
    problem = document["data"]["problems"][0]["data"]
    change(document, problem, problem["boundary_conditions"][0]["data"])
    return document


def two_groups(_: Any, problem: Any, group: Any) -> None:
    for name in ("Dead load", "Wind"):
        other = copy.deepcopy(problem["boundary_conditions"][0])
        other["data"] |= {"name": name, "displacements": [], "body_forces": []}
        problem["boundary_conditions"].append(other)


def test_groups_are_cases_and_dead_loads(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.json", edited(two_groups))
    loads = import_file(path).document["loads"]
    assert [case["name"] for case in loads["cases"]] == ["Live", "Wind"]
    assert [len(case["live"]) for case in loads["cases"]] == [4, 3]
    assert len(loads["dead"]) == 3


@pytest.mark.parametrize(("capacity", "strength"), [(500.0, 500.0), (5000.0, 1000 / 0.6)])
def test_tensile_capacity_ends_at_the_apex(capacity: float, strength: float, tmp_path: Path) -> None:
    def change(_: Any, problem: Any, __: Any) -> None:
        problem["contact_properties"]["data"]["contact_model"]["data"]["t_c"] = capacity

    path = saved(tmp_path / "a.json", edited(change))
    found = import_file(path)
    assert found.document["materials"]["dry"]["tensile_strength"] == pytest.approx(strength)
    assert ("the apex of friction" in str(found.report)) == (strength < capacity)


def test_model_and_problem_beside_one_another(tmp_path: Path) -> None:
    """As compas.json_dump writes a list or a dict of both."""
    data = json.loads(PROBLEM.read_text())["data"]
    wanted = import_file(PROBLEM).document
    for content in ([data["model"], *data["problems"]], {"m": data["model"], "p": data["problems"][0]}):
        path = saved(tmp_path / "compas_dem_problem.json", content)
        assert import_file(path).document["loads"] == wanted["loads"]


def ghost(_: Any, __: Any, group: Any) -> None:
    group["point_loads"][0]["data"]["block_index"] = 77


def no_face(_: Any, __: Any, group: Any) -> None:
    group["surface_loads"][0]["data"]["face_index"] = 60


def free_moves(_: Any, __: Any, group: Any) -> None:
    group["displacements"][0]["data"]["block_index"] = 1


def two_gravities(_: Any, problem: Any, group: Any) -> None:
    problem["boundary_conditions"].append(copy.deepcopy(problem["boundary_conditions"][0]))
    group["g"] = 1.62


def other_law(_: Any, problem: Any, __: Any) -> None:
    problem["contact_properties"]["data"]["contact_model"]["dtype"] = "compas_dem.interactions/Glue"


def no_model(document: Any, problem: Any, _: Any) -> None:
    document["data"]["model"] = None


def nonsense(_: Any, __: Any, group: Any) -> None:
    group["point_loads"][0]["data"]["force"] = "much"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (ghost, "block 77, which is not there"),
        (no_face, "no face 60"),
        (free_moves, "'b1' is no support"),
        (two_gravities, "2 values of g"),
        (other_law, "it is Glue"),
        (no_model, "without its model"),
        (nonsense, "no COMPAS assembly"),
    ],
)
def test_problems_that_cannot_be_read(change: Any, words: str, tmp_path: Path) -> None:
    path = saved(tmp_path / "a.json", edited(change))
    with refused(match=words):
        import_file(path)


SCENES_THERE = {
    "dome": lambda: samples.dome(bond="running", meridians=6),
    "cubes": lambda: load_scene(SCENES / "spatial_cubes.json"),
    "arch": lambda: samples.arch(voussoirs=7, load="quarter"),
}


def written(name: str, path: Path, cells: bool = True) -> tuple[Layout, dict[str, Any]]:
    scene = SCENES_THERE[name]()
    assembly = build_assembly(scene)
    labels = np.ones_like(assembly.labels)
    layout = Layout(scene, assembly, labels, solve(assembly, labels))
    export(layout, "compas_dem", path, cells=cells)
    return layout, json.loads(path.read_text())


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SCENES_THERE)
def test_there_and_back_has_the_same_load_factor(name: str, tmp_path: Path) -> None:
    layout, _ = written(name, tmp_path / "a.json")
    back = build_assembly(parse_scene(import_file(tmp_path / "a.json").document))
    assert back.elements.ids == layout.assembly.elements.ids
    assert layout.result is not None
    again = solve(back)
    width = 1e-9 * layout.result.load_factor
    width += sum(hi - lo for lo, hi in (again.bracket, layout.result.bracket))
    assert again.load_factor == pytest.approx(layout.result.load_factor, abs=width)


@pytest.mark.parametrize("name", SCENES_THERE)
def test_corner_forces_balance_every_block(name: str, tmp_path: Path) -> None:
    """Forces at corners by their frames, weight and λ times the live load: no force and no moment is left."""
    layout, document = written(name, tmp_path / "a.json")
    model = document["analysis"]["data"]["model"]["data"]
    assembly, result = layout.assembly, layout.result
    assert result is not None
    planar = assembly.dimension == 2
    left = np.zeros((len(assembly.elements), 6))
    flow = assembly.elements.weight, assembly.dead, assembly.live
    size = float(np.linalg.norm(flow[0], axis=1).max() + abs(flow[2]).max() * result.load_factor)
    for k, centre in enumerate(assembly.elements.centroid):
        own = assembly.dead[k] + result.load_factor * assembly.live[k]
        left[k] = [own[0], 0.0, own[1], 0.0, -own[2], 0.0] if planar else own
        assert len(centre) == assembly.dimension
    for a, others in model["graph"]["edge"].items():
        for b, entry in others.items():
            for contact in entry["contacts"]:
                data = contact["data"]
                x, y = (np.array(data["frame"]["data"][axis]) for axis in ("xaxis", "yaxis"))
                for point, f in zip(data["points"], data["forces"], strict=True):
                    force = (f["c_np"] - f["c_nn"]) * np.cross(x, y) + f["c_u"] * x + f["c_v"] * y
                    for node, sign in ((int(b), 1.0), (int(a), -1.0)):
                        c = assembly.elements.centroid[node]
                        centre = np.array([c[0], 0.5 * layout.thickness, c[1]]) if planar else c
                        arm = np.array(point["data"]) - centre
                        left[node] += sign * np.concatenate([force, np.cross(arm, force)])
    free = assembly.elements.free
    assert np.abs(left[free]).max() <= 1e-5 * size * max(1.0, assembly.size)


def test_results_hold_mechanism_and_load_factor(tmp_path: Path) -> None:
    """Blocks move by their transformation as the mechanism says, to first order in its scale."""
    layout, document = written("cubes", tmp_path / "a.json")
    results = document["results"]["data"]
    assembly, result = layout.assembly, layout.result
    assert result is not None
    assert result.mechanism is not None
    assert results["metadata"]["load_factor"] == result.load_factor
    scale = results["metadata"]["mechanism_scale"]
    for k in range(len(assembly.elements)):
        matrix = np.array(results["node_data"][str(k)]["transformation"]["data"]["matrix"])
        np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
        centre = assembly.elements.centroid[k]
        moved = matrix[:3, :3] @ centre + matrix[:3, 3] - centre
        wanted = scale * displacement(assembly, result.mechanism, k, centre[None])[0]
        np.testing.assert_allclose(moved, wanted, atol=1e-12)
    assert results["problem_id"] == document["analysis"]["data"]["problems"][0]["guid"]
    assert results["model_id"] == document["analysis"]["data"]["model"]["guid"]


def test_joints_that_differ_have_no_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    document = samples.dome(meridians=6).model_dump(mode="json", exclude_defaults=True)
    document["materials"]["gravity"] = [1.0, 0.0, -9.0]
    scene, out = tmp_path / "scene.json", tmp_path / "a.json"
    scene.write_text(json.dumps(document))
    done = call(monkeypatch, capsys, "export", scene, "--format", "compas_dem", "-o", out)
    assert (done.code, done.err.count("\n"), out.exists()) == (2, 1, False), done.err
    assert "materials.gravity" in done.err


@pytest.mark.filterwarnings("ignore")
def test_compas_dem_opens_what_is_written(tmp_path: Path) -> None:
    """Where compas_dem is installed: its own classes, resultants by its own formula."""
    pytest.importorskip("compas_dem")
    import compas

    layout, _ = written("dome", tmp_path / "a.json")
    document = compas.json_load(tmp_path / "a.json")
    analysis, results = document["analysis"], document["results"]
    problem = analysis.problems[0]
    problem.load_model(analysis.model)
    assert len(list(analysis.model.elements())) == len(layout.assembly.elements)
    strengths = layout.assembly.strengths(ROUTE)
    assert problem._contact_properties.contact_model.mu == pytest.approx(strengths.friction[0])
    (group,) = problem.boundary_conditions
    assert group.g == 9.81
    reaction = np.zeros(3)
    for u, v in results.edges():
        supports = [analysis.model.graph.node_element(node).is_support for node in (u, v)]
        force = np.array(results.resultant_global((u, v)))
        reaction += force * (supports[0] - 1.0 * supports[1])
    free = layout.assembly.elements.free
    weight = np.linalg.norm(layout.assembly.elements.weight[free], axis=1).sum()
    assert layout.result is not None
    wanted = [-layout.result.load_factor * weight, 0.0, weight]
    np.testing.assert_allclose(reaction, wanted, atol=1e-6 * weight)


# jld as a solver of compas_dem: stored problems always, their own classes and templates where these are installed.


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
    path = saved(tmp_path / "a.json", document)
    results = dem_solver.solve_document(document)
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

    values = [
        dem_solver.solve_document(stored(change))["data"]["metadata"]["load_factor"] for change in (halved, whole)
    ]
    assert values[0] == pytest.approx(values[1], rel=1e-8)


def test_prescribed_movements_and_missing_packages_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="limit analysis knows no prescribed movement"):
        dem_solver.solve_document(json.loads(PROBLEM.read_text()))
    with pytest.raises(InputError, match="friction"):
        dem_solver.jld_solver(friction="sticky")
    monkeypatch.setitem(__import__("sys").modules, "compas_dem.problem", None)
    with pytest.raises(InputError, match=r"compas_dem is not installed; expected pip install 'jld\[compas\]'"):
        dem_solver.jld_solver()


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
    problem.set_solver(dem_solver.jld_solver())
    results = problem.solve()
    assert type(results).__name__ == "Results"
    assert results.metadata["status"] == "collapse"
    assert problem._solver.name == "JLD"
    direct = dem_solver.dem_solve(problem, model)
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
