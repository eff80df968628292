"""Joints moved for blocks that may crack anywhere: the dual of the upper bound, its derivatives, and what is gained."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import grid_document
from command import Command
from jld_core import InputError, Scene, build_assembly, parse_scene, solve
from jld_core.fields import WeakEquilibrium, bounds, bounds_by_fields
from jld_core.fields import mesh as field_mesh
from jld_core.models import solve_by_fields
from jld_explore import ExploreSettings, Interrupted
from jld_geometry import (
    FieldMesh,
    FieldSearch,
    GeometrySearch,
    TrustRegion,
    explore_and_move,
    move_by_fields,
    write_moved,
)

FRICTION = 0.9


def wall(**keys: Any) -> dict[str, Any]:
    """Two courses of two cells on a ground, pushed to the side; both vertical joints may lean."""
    push: list[dict[str, Any]] = [{"body": [1.0, 0.0]}]
    document = grid_document(["ab", "cd", "##"], live=push, tension=3e5, shear=5e5, friction=FRICTION)
    return {**document, **keys}


def search_of(scene: Scene) -> GeometrySearch:
    assembly = build_assembly(scene)
    return GeometrySearch(scene, assembly, assembly.labels)


@pytest.mark.parametrize("labels", ["joints", "inner"])
def test_weak_equilibrium_is_dual_to_velocities(labels: str) -> None:
    """Strong duality: λ is that of the velocity field on the same mesh, with dry joints and with cracks."""
    force = [{"element": "c0r0", "force": [1e3, -1e3], "at": [0.05, 0.3], "width": 0.04}]
    document = grid_document(["aa", "bb", "##"], live=force, tension=2e4, shear=3e4, friction=0.6)
    document["materials"]["dry"] |= {"cohesion": 2e3, "compressive_strength": 1e6}
    document["materials"]["inner"] |= {"friction_coefficient": 0.5, "compressive_strength": 2e6}
    assembly = build_assembly(parse_scene(document))
    dry = assembly.labels if labels == "joints" else np.zeros_like(assembly.labels)
    setting = bounds.FieldSetting.of(assembly)
    fields = bounds.Fields.on(setting, field_mesh.subdivide(setting.coarse, 2), dry)
    upper, found = fields.velocity, WeakEquilibrium(fields.problem, dry).solve()
    assert found[1] == pytest.approx(upper.factor, rel=1e-6)


def test_rates_of_weak_equilibrium() -> None:
    """Derivatives of all equations by nodes against fourth-order differences, at random stresses."""
    assembly = build_assembly(parse_scene(wall()))
    setting = bounds.FieldSetting.of(assembly)
    problem = setting.problem(setting.coarse)
    form, random = WeakEquilibrium(problem, assembly.labels), np.random.default_rng(3)
    point, way = random.normal(size=form.width), random.normal(size=problem.mesh.points.shape)

    def rest(step: float) -> np.ndarray:
        mesh = replace(problem.mesh, points=problem.mesh.points + step * way)
        rows = WeakEquilibrium(replace(problem, mesh=mesh), assembly.labels).rows()
        return np.asarray((rows.matrix @ point - rows.right)[: rows.sizes.zero])

    step = 1e-3
    rates = (8.0 * (rest(step) - rest(-step)) - (rest(2.0 * step) - rest(-2.0 * step))) / (12.0 * step)
    found = form.rates(point) @ way.ravel()
    assert abs(found - rates).max() <= 1e-9 * abs(rates).max()


def test_meshes_follow_vertices() -> None:
    """A refined mesh that follows moved vertices is that of the moved scene: it covers its elements, and so its λ."""
    force = [{"element": "c0r0", "force": [1e3, -1e3], "at": [0.05, 0.3], "width": 0.04}]
    scene = parse_scene(wall(loads={"live": force}))
    search = search_of(scene)
    point = FieldSearch(search).start(np.zeros(search.variables.count), 2)
    values = 0.01 * np.random.default_rng(1).normal(size=search.variables.count)
    assembly = search.evaluator.assembly(values)
    moved = search.variables.places(values) - search.variables.start
    mesh = point.meshes[0].at(assembly, moved)
    area = np.bincount(mesh.mesh.cell, mesh.mesh.volume, minlength=len(assembly.elements))
    free = assembly.elements.free
    assert area[free] * assembly.interfaces.l2[0] == pytest.approx(assembly.elements.volume[free], rel=1e-12)
    linear = mesh.mesh.points - point.meshes[0].mesh.points
    assert linear.ravel() == pytest.approx(point.meshes[0].motion @ moved.ravel(), abs=1e-12)
    # the bound on the mesh that followed holds for the scene as it would be meshed anew
    upper = bounds.Fields.on(mesh.setting, mesh.mesh, assembly.labels).bounds[1]
    fresh = bounds_by_fields(assembly, assembly.labels, gap=0.2, seconds=2.0)
    assert upper >= fresh.lower * (1.0 - 1e-9)
    assert isinstance(mesh, FieldMesh)


def test_a_small_step_gains_what_its_program_predicts() -> None:
    """To first order the program of a step predicts the bound at its end."""
    search = search_of(parse_scene(wall(move={"inner": "follow"})))
    fields = FieldSearch(search)
    point = fields.start(np.zeros(search.variables.count))
    for radius in (1e-3, 1e-4):
        answer = fields.step(point, radius * search.unit)
        new = fields.at(point, point.values + answer[0])
        promised = answer[1] - point.objective
        assert promised > 0.0
        assert new.objective - point.objective >= promised * (1.0 - 30.0 * radius) - 1e-6 * point.objective


def test_moved_joints_carry_more_by_fields() -> None:
    """λ ≤ μ, since the base stays, is reached by the bound from above; that from below grows on meshes as fine."""
    scene = parse_scene(wall(move={"inner": "follow"}))
    assembly = build_assembly(scene)
    done = move_by_fields(scene, assembly, assembly.labels, seconds=120.0)
    after = build_assembly(done.scene)
    before, moved = (bounds_by_fields(one, gap=0.05, most=70) for one in (assembly, after))
    assert before.upper == pytest.approx(0.78125, rel=1e-3)  # both upper bricks turn, as by faces
    assert moved.upper == pytest.approx(FRICTION, rel=1e-3)
    assert before.lower < 0.9 * moved.lower
    assert done.end == "stationary"
    values = [point.value for point in done.points if point.start == 0]
    assert values[-1] <= FRICTION * (1.0 + 1e-6)


def test_options_that_fields_do_not_support_are_refused() -> None:
    document = wall(move={"maximise": "least_friction"})
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    with pytest.raises(InputError, match=r"move\.maximise"):
        move_by_fields(scene, assembly, assembly.labels)


def test_the_command_moves_by_fields(
    tmp_path: Path, jld: Command, without_pictures: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """λ of the command is the bound by fields from below, and the scene written carries it."""
    # a few points and brackets as wide as a coarse mesh makes them, however long they take
    monkeypatch.setattr("jld_geometry.moving.move_by_fields", partial(move_by_fields, trust=TrustRegion(points=4)))
    monkeypatch.setattr("jld_geometry.moving._FIELD_GAP", 0.5)
    file, out = tmp_path / "wall.json", tmp_path / "moved.json"
    file.write_text(json.dumps(wall(cracks={"kind": "fields"})))
    facts = json.loads(jld("move", file, "-o", out, "--json").done().out)
    low, high = facts["bracket"]
    assert facts["load_factor"] == low
    assert facts["start"] < low <= high
    jld("move", file, "-o", tmp_path / "other.json", "--robust").refused("--robust")


# Labels and geometry searched together: `jld explore --move`, its table, scene and page, and its bad input.


def weak_wall(**keys: Any) -> dict[str, Any]:
    """Two courses of two cells under a push to the side, whose joints may lean; all faces stay dry."""
    push: list[dict[str, Any]] = [{"body": [1.0, 0.0]}]
    document = grid_document(["ab", "cd", "##"], live=push, tension=3e5, shear=5e5, friction=FRICTION, blocks=[4, None])
    return {**document, **keys}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("moved") / "out"
    settings = ExploreSettings(driver="enumeration", pictures=False, check_fields=0)
    found = explore_and_move(parse_scene(weak_wall()), folder, 1, settings, gap=0.4)
    write_moved(found, folder, pictures=False)
    return found


def test_moved_layouts_gain_by_fields(done: Any) -> None:
    """λ ≤ μ since the base joints stay (sliding of the whole wall), and the best layout reaches it by faces."""
    assert done.stop == "nothing improves"
    assert len(done.rounds) == 2
    stated = next(one for one in done.layouts if one.row == 0)
    assert stated.start == pytest.approx(0.78125, rel=1e-6)
    assert stated.load_factor == pytest.approx(FRICTION, rel=1e-6)
    assert 0.0 < stated.fields_start[0] < done.best.low <= FRICTION * (1.0 + 1e-9)
    again = solve_by_fields(solve(done.best.scene).assembly, gap=0.4, seconds=5.0).decided
    assert again.low <= done.best.high * (1.0 + 1e-9)
    assert again.high >= done.best.low * (1.0 - 1e-9)


def test_tables_of_moved_layouts(done: Any) -> None:
    table = pd.read_csv(done.first.folder / "moved.csv")
    assert table["rank"].tolist() == list(range(1, len(done.layouts) + 1))
    assert table["fields_lo"].fillna(table["fields_lo_start"]).is_monotonic_decreasing
    facts = json.loads((done.first.folder / "summary.json").read_text())["moved"]
    assert facts["fields_lo"] == pytest.approx(done.best.low)
    assert (done.first.folder / "round-2" / "results.csv").exists()
    written = parse_scene(json.loads((done.first.folder / "moved.json").read_text()))
    assert solve(written).load_factor == pytest.approx(solve(done.best.scene).load_factor, rel=1e-9)


def test_the_command_keeps_one_clock(tmp_path: Path, jld: Command, without_pictures: None) -> None:
    file, folder = tmp_path / "wall.json", tmp_path / "out"
    file.write_text(json.dumps(weak_wall()))
    found = jld("explore", file, "--out", folder, "--move", "1", "--seconds", "6", "--jobs", "1", "--json").done()
    facts = json.loads(found.out)["moved"]
    assert facts["fields_lo"] > 0.0
    assert "moved.png" in (folder / "moved.html").read_text()
    assert (folder / "moved.png").stat().st_size > 1000


def test_a_signal_leaves_the_best_moved_layout(
    tmp_path: Path, jld: Command, without_pictures: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped while bounds are refined, the search writes table, scene and page of the layouts moved so far."""

    def stop(*_: object) -> None:
        raise Interrupted

    monkeypatch.setattr("jld_geometry.moved_search._refined", stop)
    file, folder = tmp_path / "wall.json", tmp_path / "out"
    file.write_text(json.dumps(weak_wall()))
    found = jld("explore", file, "--out", folder, "--move", "1", "--seconds", "4", "--jobs", "1")
    assert (found.code, found.err) == (3, f"stopped; the best so far is in {folder}\n")
    facts = json.loads((folder / "summary.json").read_text())
    assert facts["moved"]["stop"] == "interrupted"
    assert facts["best"] > 0.0
    assert (folder / "moved.json").exists()
    assert "moved.png" in (folder / "moved.html").read_text()


@pytest.mark.parametrize(
    ("keys", "flags", "said"),
    [
        ({"cracks": {"kind": "fields"}}, [], "--move: the search of labels needs cracks by faces"),
        ({"move": {"maximise": "least_friction"}}, [], "move.maximise"),
        ({"move": {"along": [{"at": [9.0, 9.0], "direction": [1, 0]}]}}, [], "no vertex lies at"),
        ({}, ["--robust"], "--robust: layouts whose joints move do not support it"),
        ({}, ["--effective-area"], "layouts whose joints move"),
        ({}, ["--certificate", "proof.json"], "--certificate: layouts whose joints move"),
    ],
)
def test_bad_input(tmp_path: Path, jld: Command, keys: dict[str, Any], flags: list[str], said: str) -> None:
    file, folder = tmp_path / "wall.json", tmp_path / "out"
    file.write_text(json.dumps(weak_wall(**keys)))
    jld("explore", file, "--out", folder, "--move", "2", *flags).refused(said)
    assert not folder.exists()


def test_less_than_one_layout_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="0 is no number of layouts"):
        explore_and_move(parse_scene(weak_wall()), tmp_path / "out", 0)
