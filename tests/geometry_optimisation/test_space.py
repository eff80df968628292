"""Joints that move in space: closed form, derivatives, limits, the command and what is refused."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from structures import HEIGHT, Document, flat_arch, flat_arch_load

from command import Command
from jld_core import build_assembly, geometry_sensitivities, parse_scene, samples, solve
from jld_geometry.limits import spatial_residual_rates
from jld_geometry.moved_scene import spatial_mesh
from jld_geometry.optimise import move_joints
from jld_geometry.search import GeometrySearch, TrustRegion


def extruded(document: Document, depth: float = 1.0, **move: Any) -> Document:
    """A planar scene as a spatial one: x, y become x, z, and y runs over its depth."""
    elements = []
    for entry in document["elements"]:
        outline = np.array(entry["polygon"], dtype=float)
        turn = np.roll(outline, -1, axis=0)
        if (outline[:, 0] * turn[:, 1] - turn[:, 0] * outline[:, 1]).sum() < 0.0:
            outline = outline[::-1]
        count = len(outline)
        front = [[x, 0.0, z] for x, z in outline.tolist()]
        back = [[x, depth, z] for x, z in outline.tolist()]
        sides = [[k, (k + 1) % count, count + (k + 1) % count, count + k] for k in range(count)]
        faces = [list(range(count)), list(range(2 * count - 1, count - 1, -1)), *[side[::-1] for side in sides]]
        kept = {key: value for key, value in entry.items() if key != "polygon"}
        elements.append({**kept, "vertices": [*front, *back], "faces": faces})
    live = [
        {**load, "force": [load["force"][0], 0.0, load["force"][1]], "at": [load["at"][0], 0.5 * depth, load["at"][1]]}
        for load in document["loads"]["live"]
    ]
    rest = {key: value for key, value in document.items() if key not in ("elements", "loads", "move")}
    return {**rest, "elements": elements, "loads": {"live": live}, "move": move}


def strip(**move: Any) -> Document:
    """A strip of a barrel vault of six voussoirs, under a load at a quarter."""
    scene = samples.vault(voussoirs=6, courses=1, length=1.0, load="quarter", springing=20.0)
    return {**json.loads(scene.model_dump_json(exclude_defaults=True)), "move": move}


def search_of(document: Document) -> GeometrySearch:
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    return GeometrySearch(scene, assembly, assembly.labels)


def test_flat_arch_against_its_closed_form() -> None:
    """Corners of the springings slide, in planes that stay plane: λ is that of (11.8), as in the plane."""
    along = [{"at": [s * 1.2, y, HEIGHT], "direction": [s, 0, 0]} for s in (1, -1) for y in (0.0, 1.0)]
    document = extruded(flat_arch(10.0, 1.2, 0.2), along=along, vertices="along", ties="mirror-x", box=0.15)
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    done = move_joints(scene, assembly, assembly.labels)
    tops = done.places[abs(done.places[:, 2] - HEIGHT) < 1e-9]
    inner = np.sort(np.unique(np.round(tops[(tops[:, 0] > 0.9) & (tops[:, 0] < 1.9), 0], 9)))
    assert len(inner) == 1
    assert done.start == pytest.approx(466.778615, rel=1e-6)
    assert done.value == pytest.approx(flat_arch_load(float(inner[0]), 0.2, 0.1), rel=1e-6)
    assert done.value > 3.5 * done.start
    assert solve(done.scene).load_factor == pytest.approx(done.value, rel=1e-6)
    again = GeometrySearch(done.scene, build_assembly(done.scene), assembly.labels)
    assert again.variables.count == 4


def test_rates_of_the_residual_are_those_of_the_load_factor() -> None:
    """−u · ∂(A F + b + λ b_λ) is dλ of (11.5), for forces chosen with the mechanism."""
    search = search_of(strip())
    point = search.first()
    assert point is not None
    result = point.result
    assert result is not None
    assert result.mechanism is not None
    assert result.forces is not None
    mesh = spatial_mesh(result.assembly)
    every = np.ones(len(mesh.places), dtype=bool)
    args = (result.assembly, mesh, result.forces, result.load_factor, result.mechanism, every)
    velocity = result.mechanism[result.assembly.elements.free].ravel()
    rates = -(velocity @ spatial_residual_rates(*args)).reshape(-1, 3)
    found = geometry_sensitivities(result)
    assert found is not None
    assert rates == pytest.approx(found.derivative, abs=1e-6 * abs(found.derivative).max())


def test_a_small_step_gains_what_its_program_predicts() -> None:
    """To first order the gain is at least what was promised; more where other forces see more, as at a kink."""
    search = search_of(strip())
    point = search.first()
    assert point is not None
    for radius, within in ((1e-3, 3e-2), (1e-4, 3e-3)):
        new, predicted = search._try(point, radius * search.unit)
        assert new is not None
        assert predicted > (1.0 + radius) * point.objective
        assert new.objective - point.objective > (1.0 - within) * (predicted - point.objective)


def test_joints_stay_plane_within_their_limits() -> None:
    """A few steps: every joint plane, moves within the box, masses within their bounds, alike where they are tied."""
    mass = build_assembly(parse_scene(strip())).elements.mass
    most = 1.1 * float(mass.max())
    corners = spatial_mesh(build_assembly(parse_scene(strip()))).places
    joint = corners[abs(corners[:, 0]) < 1e-9]
    scene = parse_scene(strip(box=0.08, block_mass=[0.5 * float(mass[mass > 0].min()), most], edge=0.1))
    assembly = build_assembly(scene)
    done = move_joints(scene, assembly, assembly.labels, trust=TrustRegion(points=4))
    assert done.value > 1.2 * done.start
    assert done.parameters == 20
    after = build_assembly(done.scene)
    for polygon in after.interfaces.polygon:
        flat = polygon - polygon.mean(axis=0)
        assert np.linalg.svd(flat)[1][-1] <= 1e-7 * abs(flat).max()
    assert abs(done.moved).max() <= 0.08 + 1e-9
    assert after.elements.mass.max() <= most * (1.0 + 1e-8)
    ties = [joint[np.argsort(joint[:, 2])[:2]].tolist()]
    tied = search_of(strip(ties=ties))
    assert tied.variables.basis.shape[1] == 19


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"move": {"angle": [20, 160]}}, "no meaning in space"),
        ({"move": {"draft": {"direction": [0, 0, 1], "degrees": 5}}}, "no meaning in space"),
        ({"move": {"maximise": "least_friction"}}, "is for planar arches"),
        ({"move": {"along": [{"circle": [0, 0]}]}}, "circles are for planar scenes"),
        ({"move": {"along": [{"at": [0, 0], "direction": [0, 1]}]}}, "it has 2 numbers"),
        ({"move": {"along": [{"at": [0, 0, 9], "direction": [0, 0, 1]}]}}, "no vertex lies at"),
        ({"move": {"vertices": "along"}}, "no corner of a joint can move"),
        ({"cohesion": 100.0}, ") is unknown to joints that move in space"),
    ],
)
def test_scenes_whose_joints_cannot_move_are_refused_in_one_line(
    change: Document, said: str, tmp_path: Path, jld: Command
) -> None:
    document = strip(**change.get("move", {}))
    if "cohesion" in change:
        document["materials"]["dry"] = {**document["materials"]["dry"], "cohesion": change["cohesion"]}
    file = tmp_path / "vault.json"
    file.write_text(json.dumps(document))
    done = jld("move", file, "-o", tmp_path / "out.json")
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert said in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["vault.json"]


def test_proofs_and_searches_of_labels_are_planar(tmp_path: Path, jld: Command) -> None:
    file = tmp_path / "vault.json"
    file.write_text(json.dumps(strip()))
    assert "it bounds planar structures alone" in jld("move", file, "-o", tmp_path / "out.json", "--prove=0.1").err


def test_the_command_writes_scene_table_and_picture(
    tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, out = tmp_path / "vault.json", tmp_path / "moved.json"
    file.write_text(json.dumps(strip(box=0.03)))
    # two points, however long they take
    monkeypatch.setattr("jld_geometry.moving.move_joints", partial(move_joints, trust=TrustRegion(points=2)))
    facts = json.loads(jld("move", file, "-o", out, "--json").out)
    assert facts["load_factor"] > facts["start"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["moved.csv", "moved.json", "moved.png", "vault.json"]
    assert json.loads(jld("solve", out, "--json").out)["load_factor"] == pytest.approx(facts["load_factor"], rel=1e-6)
