"""Joints moved for blocks that may crack anywhere: the dual of the upper bound, its derivatives, and what is gained."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import grid_document
from command import Command
from jld_core import InputError, Scene, build_assembly, parse_scene
from jld_core.fields import WeakEquilibrium, bounds_by_fields
from jld_core.fields.bounds import FieldSetting
from jld_core.fields.mesh import subdivide
from jld_core.fields.upper import UpperBound
from jld_geometry import FieldMesh, FieldSearch, GeometrySearch, TrustRegion, move_by_fields

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
    setting = FieldSetting.of(assembly)
    problem = setting.problem(subdivide(setting.coarse, 2))
    upper, found = UpperBound(problem).bound(dry), WeakEquilibrium(problem, dry).solve()
    assert found[1] == pytest.approx(upper.factor, rel=1e-6)


def test_rates_of_weak_equilibrium() -> None:
    """Derivatives of all equations by nodes against fourth-order differences, at random stresses."""
    assembly = build_assembly(parse_scene(wall()))
    setting = FieldSetting.of(assembly)
    problem = setting.problem(setting.coarse)
    form, random = WeakEquilibrium(problem, assembly.labels), np.random.default_rng(3)
    point, way = random.normal(size=form.width), random.normal(size=problem.mesh.points.shape)

    def rest(step: float) -> np.ndarray:
        mesh = replace(problem.mesh, points=problem.mesh.points + step * way)
        rows = WeakEquilibrium(replace(problem, mesh=mesh), assembly.labels).rows()
        return np.asarray((rows.matrix @ point - rows.right)[: rows.sizes[0]])

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
    upper = UpperBound(mesh.setting.problem(mesh.mesh)).bound(assembly.labels)
    fresh = bounds_by_fields(assembly, assembly.labels, gap=0.2, seconds=2.0)
    assert upper.factor * mesh.setting.problem(mesh.mesh).units.load >= fresh.lower * (1.0 - 1e-9)
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
    found = jld("move", file, "-o", out, "--json")
    assert found.code == 0
    facts = json.loads(found.out)
    low, high = facts["bracket"]
    assert facts["load_factor"] == low
    assert facts["start"] < low <= high
    refused = jld("move", file, "-o", tmp_path / "other.json", "--robust")
    assert refused.code == 2
    assert "--robust" in refused.err
