"""Limit loads of spatial blocks with closed forms, from scene to bracket, and planar fields as a second route."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import all_inner, box, prism, rotation
from command import Command, saved
from jld_core import Assembly, InputError, Status, build_assembly, parse_scene
from jld_core.fields import bounds, bounds_by_fields
from jld_core.models import solve_by_fields
from proofs import fields_of, holds

STRONG = {"tensile_strength": 1e3, "shear_strength": 1e3}


def scene(elements: list[dict[str, Any]], live: list[Any], label: str = "inner", **materials: Any) -> Assembly:
    """Weightless elements unless stated otherwise."""
    document = {
        "elements": elements,
        "materials": {
            "gravity": 1.0,
            "density": 0.0,
            "dry": {"friction_coefficient": 0.5},
            **materials,
            "inner": {"tensile_strength": 0.7, "shear_strength": 1.0, **materials.get("inner", {})},
        },
        "loads": {"live": live},
    }
    return build_assembly(parse_scene(all_inner(document, label)))


GROUND = box("ground", [-1, -1, -1], [2, 2, 0], support=True)


@pytest.mark.parametrize(("tension", "factor"), [(0.7, 0.7), (5.0, 2.0)])
def test_pulled_cube(tension: float, factor: float) -> None:
    """A cube glued to its support breaks at σt A, or slides at 45° by 2τ A where σt is larger."""
    live = [{"element": "cube", "force": [0, 0, 1], "at": [0.5, 0.5, 1.0]}]
    parts = [box("base", [0, 0, -1], [1, 1, 0], support=True), box("cube", [0, 0, 0], [1, 1, 1])]
    holds(bounds_by_fields(scene(parts, live, inner={"tensile_strength": tension}), gap=1e-4, most=30), factor, 1e-4)


def test_sheared_slab() -> None:
    """A flat slab glued to its support slides by τ A under a body load; its height limits the lower bound."""
    parts = [GROUND, box("slab", [0, 0, 0], [1, 1, 0.1])]
    found = bounds_by_fields(
        scene(parts, [{"element": "slab", "force": [1, 0, 0]}], inner={"tensile_strength": 5.0}), gap=0.7
    )
    holds(found, 1.0, 0.7)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_block_that_slides(friction: float) -> None:
    """A strong block of weight W on a dry joint slides at λ = μ + c A/W, in any direction."""
    parts = [GROUND, box("block", [0, 0, 0], [1, 1, 0.5], weight=3.0)]
    dry = {"friction_coefficient": friction, "cohesion": 0.6 if friction else 0.0}
    assembly = scene(parts, [{"body": [0.6, 0.8, 0]}], "dry", inner=STRONG, dry=dry)
    found = bounds_by_fields(assembly, gap=1e-3, most=50)
    if friction:
        holds(found, 0.3 + 0.6 / 3.0, 1e-3)
    else:
        assert -1e-5 <= found.lower <= 1e-12
        assert found.upper >= 0.0
        assert found.upper - found.lower <= 1e-4


def test_block_that_tips_over_a_crushed_edge() -> None:
    """λ W h/2 = W (b − W/(σc l))/2 for a block b × l × h on a joint of strength σc."""
    parts = [GROUND, box("block", [0, 0, 0], [1, 0.5, 2], weight=3.0)]
    dry = {"friction_coefficient": 0.9, "compressive_strength": 30.0}
    assembly = scene(parts, [{"body": [1, 0, 0]}], "dry", inner=STRONG, dry=dry)
    holds(bounds_by_fields(assembly, gap=0.3, most=60), (1.0 - 3.0 / (30.0 * 0.5)) / 2.0, 0.3)


@pytest.mark.parametrize("tension", [2.0, 0.5])
def test_cantilever_in_plastic_bending(tension: float) -> None:
    """M = σt f b h²/(2 (σt + f)) with f = 2τ: tension over f h/(σt + f), compression over the rest of the depth."""
    length, depth = 4.0, 1.0
    parts = [box("wall", [-1, 0, 0], [0, 0.5, depth], support=True), box("beam", [0, 0, 0], [length, 0.5, depth])]
    live = [{"element": "beam", "force": [0, 0, -1], "at": [length, 0.25, 0.5 * depth]}]
    found = bounds_by_fields(scene(parts, live, inner={"tensile_strength": tension}), gap=0.6, most=30)
    plastic = tension * 2.0 * 0.5 * depth**2 / (2.0 * (tension + 2.0))
    # at the clamp the beam cannot thin, which strengthens it; a section h/2 away does not feel the clamp
    assert found.lower <= plastic / (length - 0.5 * depth)
    # a thrust line at the strength of the material in every section is a stress field, but for a little shear
    assert found.upper >= 0.97 * plastic / length


def test_blocks_too_weak_for_their_own_weight() -> None:
    """A bar hung from its support tears under its weight where γ h > σt: proven by a mechanism on the first mesh."""
    parts = [box("ceiling", [0, 0, 2], [1, 1, 3], support=True), box("bar", [0, 0, 0], [1, 1, 2], density=1.0)]
    live = [{"element": "bar", "force": [0, 0, -1], "at": [0.5, 0.5, 0]}]
    weak = bounds_by_fields(
        scene(parts, live, inner={"tensile_strength": 1.9, "shear_strength": 5.0}), gap=0.01, most=50
    )
    assert weak.status is bounds.FieldStatus.UNSTABLE
    assert weak.upper == pytest.approx(1.9 - 2.0, rel=1e-4)
    strong = bounds_by_fields(
        scene(parts, live, inner={"tensile_strength": 2.1, "shear_strength": 5.0}), gap=0.01, most=50
    )
    holds(strong, 0.1, 0.01)


def test_more_weight_than_any_live_load_can_hold() -> None:
    """A bar that tears under its weight beside another one, which is loaded: no live load helps."""
    parts = [box("ceiling", [0, 0, 2], [3, 1, 3], support=True), box("bar", [0, 0, 0], [1, 1, 2], density=1.0)]
    parts.append(box("stub", [2, 0, 1], [3, 1, 2]))
    live = [{"element": "stub", "force": [0, 0, -1], "at": [2.5, 0.5, 1]}]
    found = bounds_by_fields(
        scene(parts, live, inner={"tensile_strength": 1.9, "shear_strength": 5.0}), gap=0.01, most=50
    )
    assert found.status is bounds.FieldStatus.UNSTABLE
    assert found.upper < 0.0


@pytest.mark.long
def test_planar_fields_bound_extruded_blocks_from_both_sides() -> None:
    """λ by planar fields with σc ≤ 2τ ≤ λ in space ≤ λ by planar fields, docs/method.md (10.7)."""
    planar = [
        {"id": "g", "polygon": [[-1, -1], [2, -1], [2, 0], [-1, 0]], "support": True},
        {"id": "a", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]], "weight": 0.2},
        {"id": "b", "polygon": [[0.3, 1], [1, 1], [0.6, 2]], "weight": 0.1},
    ]
    thick = 0.6
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    spatial = [
        {**{k: v for k, v in part.items() if k != "polygon"}, **prism(part["id"], part["polygon"], 0.0, thick, turn)}
        for part in planar
    ]
    inner = {"tensile_strength": 0.5, "shear_strength": 0.6}

    def flat(**more: float) -> Assembly:
        document = {
            "elements": planar,
            "thickness": thick,
            "materials": {"gravity": 1.0, "dry": {"friction_coefficient": 0.5}, "inner": {**inner, **more}},
            "loads": {"live": [{"body": [1, -0.5]}]},
        }
        return build_assembly(parse_scene(all_inner(document, dry=[["a", "b"]])))

    solid = scene(spatial, [{"body": [1, 0, -0.5]}], inner=inner)
    dry = np.array([solid.pair(face) == "a–b" for face in range(len(solid.interfaces))])
    assert dry.sum() == 1
    found = bounds_by_fields(solid, dry, gap=0.5, most=30)
    above, below = bounds_by_fields(flat(), gap=0.3), bounds_by_fields(flat(compressive_strength=1.2), gap=0.3)
    assert found.lower <= above.upper
    assert found.upper >= below.lower
    assert found.gap <= 0.5


def test_position_rotation_and_units_leave_the_bounds() -> None:
    """A turned and moved scene in other units has the same coarsest mesh, and bounds that agree to 1e-4."""
    found = []
    for turn, scale, force in ((np.eye(3), 1.0, 1.0), (rotation(0.3, -0.4, 0.5), 1000.0, 1e-3)):
        parts = []
        for part in (GROUND, box("a", [0, 0, 0], [1, 1, 1.5])):
            places = (np.array(part["vertices"]) @ turn.T + [3.0, -2.0, 1.0]) * scale
            weight = {} if part.get("support") else {"weight": 0.3 * force}
            parts.append({**part, **weight, "vertices": places.tolist()})
        stress = force / scale**2
        document = {
            "elements": parts,
            "materials": {
                "gravity": (turn @ [0.0, 0.0, -1.0]).tolist(),
                "dry": {"friction_coefficient": 0.5},
                "inner": {"tensile_strength": 0.5 * stress, "shear_strength": 0.6 * stress},
            },
            "loads": {"live": [{"body": (turn @ [1.0, 0.2, 0.0]).tolist()}]},
            "labels": {"default": "dry"},
        }
        found.append(bounds_by_fields(build_assembly(parse_scene(document)), gap=10.0))
    assert found[1].lower == pytest.approx(found[0].lower, rel=1e-4)
    assert found[1].upper == pytest.approx(found[0].upper, rel=1e-4)


def test_bounds_stay_in_order_under_refinement() -> None:
    """Every lower bound lies below every upper bound, and bounds of nested meshes do not get worse."""
    parts = [GROUND, box("a", [0, 0, 0], [1, 1, 1], weight=1.0)]
    found = bounds_by_fields(scene(parts, [{"body": [1, 0, 0]}]), gap=1e-3, adaptive=False, most=70)
    steps = found.history
    assert len(steps) == 2
    assert max(step.lower for step in steps) <= min(step.upper for step in steps)
    assert [s.upper for s in steps] == pytest.approx(sorted((s.upper for s in steps), reverse=True), rel=1e-5)


def test_virtual_power_of_both_fields() -> None:
    """Dissipation less stress power is the width of the bracket: both fields meet equilibrium and compatibility."""
    parts = [GROUND, box("a", [0, 0, 0], [1, 1, 1], weight=1.0)]
    assembly = scene(parts, [{"element": "a", "force": [1, 0, -0.2], "at": [0.5, 0.5, 1.0]}], "dry")
    setting = bounds.FieldSetting.of(assembly, None, assembly.labels)
    given = setting.problem(setting.coarse)
    stress, velocity = fields_of(given, assembly.labels)
    power = bounds.stress_power(given, stress, velocity.velocity)
    width = velocity.factor - stress.factor
    assert velocity.dissipation.sum() - power.sum() == pytest.approx(width, abs=1e-9)
    # no tetrahedron dissipates less than the stresses work on it
    assert (velocity.dissipation - power).min() >= -1e-9


LOADS = [
    [{"element": "a", "force": [1, 2, -3], "at": [0.5, 0.4, 1.0]}],
    [{"element": "a", "force": [1, 2, -3], "at": [0.9, 0.4, 1.0]}],
    [{"element": "a", "force": [1, 0, -3], "at": [0.5, 0.4, 1.0], "width": 0.3}],
    [
        {"element": "a", "force": [0, 0, -3], "at": [0.5, 0.5, 1.0]},
        {"element": "a", "force": [0, 0, -1], "at": [0.5, 0.25, 1.0], "width": 0.4},
    ],
    [{"element": "a", "force": [1, 2, 3], "moment": [0.1, 0.2, 0.3]}],
    [{"element": "a", "force": [1, 2, 3], "at": [0.2, 0.7, 0.4]}],
    [{"body": [1, 2, 3]}],
]


@pytest.mark.parametrize("live", LOADS)
def test_loads_are_statically_equivalent(live: list[Any]) -> None:
    """Body forces and tractions have the resultants of the scene, by quadrature over the mesh."""
    assembly = scene([GROUND, box("a", [0, 0, 0], [1, 1, 1], weight=0.3)], live)
    setting = bounds.FieldSetting.of(assembly)
    mesh, loads = setting.coarse, setting.loads
    total = np.zeros(6)
    centroid = assembly.elements.centroid[1]

    def add(place: Any, force: Any) -> None:
        total[:3] += force
        total[3:] += np.cross(place - centroid, force)

    for place, volume, body in zip(mesh.corners.mean(axis=1), mesh.volume, loads.live, strict=True):
        add(place, volume * body)
    for index, traction in enumerate(loads.tractions):
        own = np.flatnonzero(mesh.sides.tag == -2 - index)
        corners = mesh.corners[mesh.sides.a[own][:, None], mesh.sides.corner_a[own]]
        for area, three in zip(mesh.sides.area[own], corners, strict=True):
            # middles of sides integrate products of two linear functions exactly
            for place in 0.5 * (three + np.roll(three, 1, axis=0)):
                add(place, area / 3.0 * traction.at(place)[1])
    assert total == pytest.approx(assembly.live[1], abs=1e-9)


def test_refused_assemblies_and_options() -> None:
    """Cells that are not convex, forces without room, and one line for each."""
    ell = prism("ell", [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], 0.0, 1.0, weight=1.0)
    cube = box("a", [0, 0, 0], [1, 1, 1])
    refused: list[tuple[list[dict[str, Any]], list[Any], str]] = [
        ([GROUND, ell], [{"body": [1, 0, 0]}], "convex"),
        ([GROUND, cube], [{"element": "a", "force": [0, 0, -1], "at": [1, 1, 1]}], "no room"),
        ([GROUND, cube], [{"element": "a", "force": [0, 0, -1], "at": [0.9, 0.5, 1], "width": 0.5}], "no room"),
        ([GROUND, cube], [{"element": "a", "force": [0, 0, 1], "at": [0.5, 0.5, 0]}], "no free face"),
        ([GROUND, cube], [{"element": "a", "force": [0, 0, 1], "at": [0.5, 0.5, 0.5], "width": 0.1}], "no free face"),
    ]
    for parts, live, words in refused:
        with pytest.raises(InputError, match=words):
            bounds_by_fields(scene(parts, live), most=30)
    with pytest.raises(InputError, match="gap"):
        bounds_by_fields(scene([GROUND, cube], LOADS[0]), gap=0.0)


# `jld solve --cracks fields` on spatial scenes: what is printed, and what is refused in one line.


SCENE: dict[str, Any] = {
    "name": "cube",
    "elements": [box("base", [0, 0, -1], [1, 1, 0], support=True), box("cube", [0, 0, 0], [1, 1, 1])],
    "materials": {
        "density": 0.0,
        "dry": {"friction_coefficient": 0.5},
        "inner": {"tensile_strength": 0.7, "shear_strength": 1.0},
    },
    "loads": {"live": [{"element": "cube", "force": [0, 0, 1], "at": [0.5, 0.5, 1.0]}]},
    "labels": {"default": "inner", "inner": [["base", "cube"]]},
}


def test_both_bounds_are_printed(jld: Command, tmp_path: Path) -> None:
    """A cube pulled to σt A: the keys of planar scenes, with tetrahedra in the place of triangles."""
    path = saved(tmp_path / "scene.json", SCENE)
    found = json.loads(jld("solve", path, "--cracks", "fields:0.01", "--json").out)
    assert found["cracks"] == {"kind": "fields", "gap": 0.01}
    assert (found["status"], found["dimension"]) == ("collapse", 3)
    assert found["load_factor"] == found["bracket"][0] <= 0.7 * (1 + 1e-9)
    assert found["bracket"][1] >= 0.7 * (1 - 1e-9)
    assert found["tetrahedra"] == found["history"][-1]["tetrahedra"] == 24
    assert "tetrahedra" in jld("solve", path, "--cracks", "fields:0.01").out


def test_models_that_fields_do_not_support_are_refused_in_one_line(jld: Command, tmp_path: Path) -> None:
    path = saved(tmp_path / "scene.json", SCENE)
    for more in (["--contact", "concave"], ["--effective-area"], ["--inner-bending", "kern"]):
        found = jld("solve", path, "--cracks", "fields", *more)
        assert (found.code, found.out) == (2, "")
        assert found.err.startswith(f"jld: {more[0]}: cracks by fields")
        assert found.err.count("\n") == 1
    found = jld("explore", path, "--cracks", "fields", "--out", tmp_path / "out")
    assert (found.code, found.out) == (2, "")
    assert found.err.startswith("jld: --cracks: ")
    assert found.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_mesh_in_space_ends_with_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first mesh of a dome of 32 cells went on for eight minutes after five seconds were given."""
    monkeypatch.setattr("jld_core.fields.bounds._GRACE", 0.0)
    live = [{"element": "b", "force": [0, 0, 1]}]
    cube = scene([GROUND, box("b", [0, 0, 0], [1, 1, 1])], live)
    ended, whole = (bounds_by_fields(cube, seconds=seconds) for seconds in (1e-9, 0.0))
    assert (ended.lower, ended.upper, ended.status) == (-np.inf, np.inf, "no time")
    assert np.isfinite([whole.lower, whole.upper]).all()
    reason = solve_by_fields(cube, seconds=1e-9).reason
    assert reason is not None
    assert reason.startswith("time ended on ")


def test_load_cases_in_space() -> None:
    """λ is the least over cases of λ / required."""
    live = SCENE["loads"]["live"]
    sideways = [{"element": "cube", "force": [0, 0, 0.5], "at": [0.5, 0.5, 1.0]}]
    cases = [{"name": "one", "live": live}, {"name": "half", "live": sideways, "required": 4.0}]
    found = solve_by_fields(build_assembly(parse_scene({**SCENE, "loads": {"cases": cases}})), gap=0.01)
    assert found.status is Status.COLLAPSE
    assert np.isclose(found.decided.low, 1.4 / 4.0, rtol=1e-3)
