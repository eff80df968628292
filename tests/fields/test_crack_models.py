"""The key `cracks` and `jld solve --cracks`: what is parsed, what is refused, what is printed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies.crack_models import HALVES, VORONOI, finer

from cases import grid_document
from command import Command, saved
from jld_core import InputError, Status, build_assembly, parse_scene, solve
from jld_core.fields import bounds_by_fields
from jld_core.fields import loads as field_loads
from jld_core.models import require_cracks, solve_by_fields
from jld_core.refinement import crack_cells

BAR: dict[str, Any] = {
    "name": "bar",
    "elements": [
        {"id": "wall", "polygon": [[0, -1], [0.5, -1], [0.5, 0], [0, 0]], "support": True},
        {"id": "bar", "polygon": [[0, 0], [0.5, 0], [0.5, 1.5], [0, 1.5]]},
    ],
    "materials": {
        "density": 0.0,
        "dry": {"friction_coefficient": 0.5},
        "inner": {"tensile_strength": 1.2, "shear_strength": 1.0},
    },
    "loads": {"live": [{"element": "bar", "force": [0, 1], "at": [0.25, 1.5]}]},
    "labels": {"default": "inner", "inner": [["wall", "bar"]]},
}
PULLED = 1.2 * 0.5
"""Strength times section of the bar."""


@pytest.mark.parametrize(
    ("cracks", "where"),
    [
        ("cells", "cracks"),
        ({"kind": "cells"}, "cracks.cell"),
        ({"kind": "cells", "cell": 0.0}, "cracks.cell"),
        ({"kind": "fields", "gap": 0}, "cracks.gap"),
        ({"kind": "fields", "gap": -0.1}, "cracks.gap"),
        ({"kind": "fields", "cell": 0.1}, "cracks.cell"),
        ({"kind": "voronoi"}, "cracks"),
        (5, "cracks"),
        (None, "cracks"),
    ],
)
def test_wrong_keys_are_one_line(cracks: Any, where: str) -> None:
    with pytest.raises(InputError) as refused:
        parse_scene({**BAR, "cracks": cracks})
    assert refused.value.where == f"scene: {where}"
    assert "\n" not in str(refused.value)


def test_the_key_is_kept_and_part_of_the_fingerprint() -> None:
    scenes = [parse_scene({**BAR, **more}) for more in ({}, {"cracks": "faces"}, {"cracks": {"kind": "fields"}})]
    assert scenes[0].fingerprint == scenes[1].fingerprint != scenes[2].fingerprint
    written_again = scenes[2].model_dump(mode="json", exclude_defaults=True)
    assert parse_scene(written_again) == scenes[2]


def test_solve_by_fields_names_its_model(jld: Command, tmp_path: Path) -> None:
    """A bar pulled to σt: both bounds, and the lower one as λ."""
    path = saved(tmp_path / "scene.json", {**BAR, "cracks": {"kind": "fields", "gap": 0.01}})
    found = json.loads(jld("solve", path, "--json", "--out", tmp_path / "out").out)
    assert found["cracks"] == {"kind": "fields", "gap": 0.01}
    assert found["status"] == "collapse"
    assert found["load_factor"] == found["bracket"][0] <= PULLED * (1 + 1e-9)
    assert found["bracket"][1] >= PULLED * (1 - 1e-9)
    assert found["gap"] <= 0.01
    assert json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))["bracket"] == found["bracket"]
    faces = json.loads(jld("solve", path, "--json", "--cracks", "faces").out)
    assert faces["cracks"] == "faces"
    text = jld("solve", path, "--cracks", "fields:0.1").out
    assert "by fields" in text
    assert "by faces" in jld("solve", path, "--cracks", "faces").out


@pytest.mark.parametrize("option", ["fields:0", "fields:x", "cells", "cells:-1", "anything", "faces:1"])
def test_wrong_options_are_one_line(jld: Command, tmp_path: Path, option: str) -> None:
    found = jld("solve", saved(tmp_path / "scene.json", BAR), "--cracks", option)
    assert (found.code, found.out) == (2, "")
    assert found.err.startswith("jld: --cracks: ")
    assert found.err.count("\n") == 1


def test_fields_refuse_unsupported_options(jld: Command, tmp_path: Path) -> None:
    path = saved(tmp_path / "scene.json", BAR)
    for more in (["--contact", "concave"], ["--inner-bending", "kern"], ["--friction", "zero-dilation"]):
        found = jld("solve", path, "--cracks", "fields", *more)
        assert found.code == 2
        assert found.err.startswith(f"jld: {more[0]}: cracks by fields")
    spread = {**BAR["materials"], "dry": {"friction_coefficient": {"nominal": 0.5, "low": 0.4}}}
    found = jld("solve", saved(tmp_path / "scene.json", {**BAR, "materials": spread}), "--cracks", "fields", "--robust")
    assert found.code == 2
    assert found.err.startswith("jld: --robust: by fields, strengths have one value")
    fields = {"cracks": {"kind": "fields"}}
    assert "rigid cells" in jld("experiment", saved(tmp_path / "scene.json", {**BAR, **fields})).err
    weak = {**BAR["materials"], "inner": {"tensile_strength": 0, "shear_strength": 1}}
    jld("check", saved(tmp_path / "scene.json", {**BAR, **fields, "materials": weak})).refused("tensile_strength")
    corner = {"live": [{"element": "bar", "force": [0, 1], "at": [0.25, 1.5], "width": 0.6}]}
    jld("check", saved(tmp_path / "scene.json", {**BAR, **fields, "loads": corner})).refused("no room for the patch")


def test_cells_divide_the_grid() -> None:
    document = grid_document(["aa", "##"])
    for cell, fits in ((0.05, True), (0.1, True), (0.03, False), (0.2, False)):
        scene = parse_scene({**document, "cracks": {"kind": "cells", "cell": cell}})
        if fits:
            require_cracks(build_assembly(scene))
            continue
        with pytest.raises(InputError, match="do not divide the width"):
            require_cracks(build_assembly(scene))


def test_pieces_share_the_label_of_their_face() -> None:
    """Every finer face on a joint has its label, all others are inner; one cell is the grid itself."""
    scene = parse_scene(grid_document(["aab", "abb", "###"]))
    joints = build_assembly(scene)
    cells = crack_cells(scene, joints, 0.05)
    pieces = np.bincount(cells.face[cells.face >= 0], minlength=len(joints.interfaces))
    assert (pieces == 2).all()
    assert len(cells.fine.elements.free) == 4 * len(joints.elements.free)
    own = cells.labels(joints.labels)
    assert (own[cells.face >= 0] == joints.labels[cells.face[cells.face >= 0]]).all()
    assert not own[cells.face < 0].any()
    for face in range(len(joints.interfaces)):
        ends = np.asarray(joints.interfaces.polygon[face])
        low, high = ends.min(axis=0) - 1e-12, ends.max(axis=0) + 1e-12
        origin = cells.fine.interfaces.origin[cells.face == face]
        assert ((origin >= low) & (origin <= high)).all()
    same = crack_cells(scene, joints, 0.1)
    assert same.fine is joints
    assert (same.labels(joints.labels) == joints.labels).all()


def test_cells_are_those_of_the_refined_scene(jld: Command, tmp_path: Path) -> None:
    """λ by `--cracks cells:a` is that of `jld refine --cell a`, whose labels are those of the scene."""
    path = saved(tmp_path / "scene.json", grid_document(["aab", "abb", "###"], tension=3e3, shear=2e3))
    jld("refine", path, "-o", tmp_path / "fine.json", "--cell", "0.05")
    fine = json.loads(jld("solve", tmp_path / "fine.json", "--json").out)
    cells = json.loads(jld("solve", path, "--cracks", "cells:0.05", "--json").out)
    assert cells["cracks"] == {"kind": "cells", "cell": 0.05}
    assert cells["load_factor"] == pytest.approx(fine["load_factor"], rel=1e-9)
    assert cells["interfaces"] == fine["interfaces"]
    one = json.loads(jld("solve", path, "--cracks", "cells:0.1", "--json").out)
    assert one["load_factor"] == json.loads(jld("solve", path, "--json").out)["load_factor"]


def test_load_cases_by_fields() -> None:
    """λ is the least over cases of λ / required, each case as if it stood alone."""
    pull = {"name": "pull", "live": BAR["loads"]["live"]}
    push = {"name": "push", "live": [{"element": "bar", "force": [0, -1], "at": [0.25, 1.5]}], "required": 4.0}
    assembly = build_assembly(parse_scene({**BAR, "loads": {"cases": [pull, push]}}))
    found = solve_by_fields(assembly, gap=0.02)
    alone = [bounds_by_fields(one, gap=0.02) for one in assembly.by_case]
    governing = found.decided
    assert found.status is Status.COLLAPSE
    assert governing.load_factor == governing.low == pytest.approx(alone[1].lower / 4.0, rel=1e-12)
    assert governing.high == pytest.approx(alone[1].upper / 4.0, rel=1e-12)
    assert found.to_json()["governing"] == found.governing == "push"
    # pushed it slides at 45°: 2τ A
    assert governing.low <= 2.0 * 0.5 / 4.0 * (1 + 1e-9)
    assert governing.high >= 2.0 * 0.5 / 4.0 * (1 - 1e-9)


def test_a_fall_is_unstable_and_a_wide_bracket_a_collapse(jld: Command, tmp_path: Path) -> None:
    heavy = {**BAR["materials"], "density": 5.0}
    falls = {**BAR, "materials": {**heavy, "gravity": [0.0, 1.0]}}
    found = jld("solve", saved(tmp_path / "scene.json", falls), "--cracks", "fields", "--json")
    assert json.loads(found.out)["status"] == "unstable"
    assert json.loads(found.out)["bracket"] == [None, None]
    path = saved(
        tmp_path / "scene.json", {**BAR, "loads": {"live": [{"element": "bar", "force": [1, 0], "at": [0.0, 1.0]}]}}
    )
    told = json.loads(jld("solve", path, "--cracks", "fields:1e-6", "--seconds", "0", "--json").done().out)
    assert (told["status"], told["gap"] > 1e-6) == ("collapse", True)
    assert told["bracket"][0] < told["bracket"][1]


def test_widths_of_point_loads() -> None:
    """Each force on its own patch; patches that overlap add up, and the rest goes over the face."""
    live = [
        {"element": "bar", "force": [0, 1], "at": [0.2, 1.5], "width": 0.2},
        {"element": "bar", "force": [0.5, 0], "at": [0.25, 1.5], "width": 0.2},
        {"element": "bar", "force": [0, -2], "at": [0.25, 1.5]},
    ]
    assembly = build_assembly(parse_scene({**BAR, "loads": {"live": live}}))
    _, loads = field_loads.loaded_mesh(assembly)
    total, moment = np.zeros(2), 0.0
    for segment in loads.tractions:
        step = segment.ends[1] - segment.ends[0]
        force = np.hypot(*step) * field_loads.thickness_of(assembly) * segment.live.mean(axis=0)
        total += force
        moment += segment.ends.mean(axis=0)[0] * force[1]
    assert total == pytest.approx([0.5, -1.0], abs=1e-12)
    assert moment == pytest.approx(0.2 * 1.0 - 0.25 * 2.0, abs=1e-12)
    patches = {tuple(np.round(np.sort(segment.ends[:, 0]), 9)) for segment in loads.tractions}
    assert patches == {(0.0, 0.1), (0.1, 0.15), (0.15, 0.3), (0.3, 0.35), (0.35, 0.5)}
    inside = {"element": "bar", "force": [0, 1], "at": [0.2, 1.0], "width": 0.1}
    assembly = build_assembly(parse_scene({**BAR, "loads": {"live": [inside]}}))
    with pytest.raises(InputError, match="has a width and no free face"):
        field_loads.loaded_mesh(assembly)


def test_cells_by_hand() -> None:
    """A column torn off its base by its own weight upwards: λ W = W + σt A, whatever the cells."""
    materials = {**BAR["materials"], "density": 1.0}
    scene = parse_scene({**BAR, "materials": materials, "loads": {"live": [{"body": [0, 1]}]}})
    joints = build_assembly(scene)
    cells = crack_cells(scene, joints, 0.25)
    found = solve(cells.fine, cells.labels(joints.labels))
    assert len(cells.fine.elements.free) == 12
    assert found.load_factor == pytest.approx(1.0 + PULLED / (9.81 * 0.75), rel=1e-6)


def test_cells_of_the_study_are_those_of_the_crack_model() -> None:
    """Halved cells against `crack_cells` of half the size: the same λ. Voronoi cells cover the same area."""
    scene = parse_scene(grid_document(["aab", "cdd", "#.#"], tension=2e6, shear=2e5))
    assembly = build_assembly(scene)
    halves, cells = finer(scene, assembly, HALVES), crack_cells(scene, assembly, 0.05)
    assert len(halves.fine.interfaces) == len(cells.fine.interfaces)
    one, other = (solve(own.fine, own.labels(assembly.labels)).load_factor for own in (halves, cells))
    assert one == pytest.approx(other, rel=1e-9)
    random = finer(scene, assembly, VORONOI)
    assert set(random.face.tolist()) == set(range(-1, len(assembly.interfaces)))
    area = random.fine.elements.volume[random.fine.elements.free].sum()
    assert area == pytest.approx(assembly.elements.volume[assembly.elements.free].sum(), rel=1e-9)
