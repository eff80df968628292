"""Loads of fields are statically equivalent to those of the scene, and what cannot be spread is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import box
from command import Command, refused
from jld_core import Assembly, Floats, InputError, build_assembly, load_scene, parse_scene, solve
from jld_core.fields import bounds_by_fields, problem
from jld_core.fields import loads as field_loads
from jld_core.fields import mesh as field_mesh


def column(live: list[Any], *, dead: list[Any] | None = None, **inner: Any) -> Assembly:
    """Two cells of 1 × 1 on the ground, side by side on a third, thickness 0.3."""
    cells = {"a": [0, 1, 1, 2], "b": [1, 1, 2, 2], "c": [0, 0, 2, 1], "ground": [-1, -1, 3, 0]}
    elements = [
        {"id": name, "polygon": [[x, y], [p, y], [p, q], [x, q]], "support": name == "ground"}
        for name, (x, y, p, q) in cells.items()
    ]
    document = {
        "thickness": 0.3,
        "elements": elements,
        "materials": {
            "density": 2.0,
            "dry": {"friction_coefficient": 0.5},
            "inner": {"tensile_strength": 100.0, "shear_strength": 100.0, **inner},
        },
        "loads": {"live": live, "dead": dead or []},
    }
    return build_assembly(parse_scene(document))


def resultants(assembly: Assembly, mesh: field_mesh.Mesh, loads: field_loads.FieldLoads, live: bool) -> Floats:
    """Forces and moments (n, 3) about the centroids, by quadrature of body forces and tractions."""
    total = np.zeros((len(assembly.elements), 3))
    thickness = field_loads.thickness_of(assembly)
    middle = mesh.corners.mean(axis=1)

    def add(cell: int, place: Floats, force: Floats) -> None:
        arm = place - assembly.elements.centroid[cell]
        total[cell] += (*force, arm[0] * force[1] - arm[1] * force[0])

    for t in range(len(mesh)):
        body = (loads.live if live else loads.dead)[mesh.root[t]]
        add(int(mesh.cell[t]), middle[t], thickness * mesh.volume[t] * body)
    for segment in loads.tractions:
        length = np.hypot(*(segment.ends[1] - segment.ends[0]))
        # Gauss points of two, exact for linear tractions times linear arms
        for share in (0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0)):
            place = (1.0 - share) * segment.ends[0] + share * segment.ends[1]
            ends = segment.live if live else segment.dead
            pull = (1.0 - share) * ends[0] + share * ends[1]
            add(segment.cell, place, 0.5 * length * thickness * pull)
    return total


LIVE: list[list[dict[str, Any]]] = [
    [{"body": [0.3, -0.1]}],
    [{"element": "a", "force": [1.0, -2.0], "at": [0.5, 2.0]}],
    [{"element": "a", "force": [1.0, -2.0], "at": [0.6, 2.0]}],
    [{"element": "a", "force": [1.0, -2.0], "at": [0.8, 2.0]}],
    [{"element": "b", "force": [-3.0, 0.0], "at": [2.0, 1.9]}],
    [{"element": "b", "force": [0.0, -3.0]}],
    [{"element": "b", "force": [0.0, -3.0], "at": [1.2, 1.3]}],
    [{"element": "c", "moment": 2.0}],
    [{"element": "a", "force": [0.0, 1.0], "at": [0.2, 2.0]}, {"element": "a", "force": [0.0, -1.0], "at": [0.7, 2.0]}],
    [{"element": "a", "force": [0.0, -1.0], "at": [0.2, 2.0]}, {"body": [0.1, 0.0]}, {"element": "c", "moment": -1.0}],
]


@pytest.mark.parametrize("live", LIVE)
@pytest.mark.parametrize("patch", [None, 0.15])
def test_equivalence(live: list[dict[str, Any]], patch: float | None) -> None:
    """Forces and moments of every cell are those of the scene, dead and live."""
    assembly = column(live, dead=[{"element": "b", "force": [0.5, 0.0], "at": [2.0, 1.5]}])
    mesh, loads = field_loads.loaded_mesh(assembly, patch)
    free = assembly.elements.free
    assert resultants(assembly, mesh, loads, True)[free] == pytest.approx(assembly.live[free], abs=1e-12)
    assert resultants(assembly, mesh, loads, False)[free] == pytest.approx(assembly.dead[free], abs=1e-12)


def test_patches() -> None:
    """Whole face within the middle third, centred part beyond it, stated length on request."""

    def spans(at: float, patch: float | None) -> list[float]:
        _, loads = field_loads.loaded_mesh(column([{"element": "a", "force": [0.0, -1.0], "at": [at, 2.0]}]), patch)
        return sorted(x for segment in loads.tractions for x in segment.ends[:, 0].tolist())

    assert spans(0.6, None) == pytest.approx([0.0, 1.0])
    assert spans(0.8, None) == pytest.approx([0.6, 1.0])
    assert spans(0.6, 0.2) == pytest.approx([0.5, 0.7])


REFUSED: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
    ("no free face", {"live": [{"element": "a", "force": [0, -1], "at": [0.5, 1.0]}]}, {}),
    ("no room", {"live": [{"element": "a", "force": [0, -1], "at": [0.999, 2.0]}]}, {}),
    ("no room", {"live": [{"element": "a", "force": [0, -1], "at": [0.9, 2.0]}]}, {"patch": 0.3}),
    ("no relative gap", {"live": [{"body": [1, 0]}]}, {"gap": 0.0}),
    ("0 is too small", {"live": [{"body": [1, 0]}], "tensile_strength": 0.0}, {}),
    ("0 is too small", {"live": [{"body": [1, 0]}], "shear_strength": 0.0}, {}),
    ("labels: ", {"live": [{"body": [1, 0]}]}, {"labels": np.zeros(1, dtype=bool)}),
    ("patch: ", {"live": [{"body": [1, 0]}]}, {"patch": 0.0}),
]


@pytest.mark.parametrize(("words", "scene", "options"), REFUSED)
def test_refused_in_one_line(words: str, scene: dict[str, Any], options: dict[str, Any]) -> None:
    """What is not supported names the thing, the problem and what is expected."""
    with refused(words, "; expected "):
        bounds_by_fields(column(**scene), **options)


def test_cases_and_missing_strengths_are_refused() -> None:
    """Scenes with load cases, scenes without inner strengths."""
    assembly = column([{"body": [1, 0]}])
    cases = [{"name": name, "live": [{"body": [1, 0]}]} for name in "ab"]
    scene = parse_scene(
        {
            "grid": {"cell": [1, 1], "rows": ["a", "#"]},
            "materials": {"density": 1.0, "dry": {"friction_coefficient": 0.5}},
            "loads": {"cases": cases},
        }
    )
    built = build_assembly(scene)
    with pytest.raises(InputError, match="one load case"):
        bounds_by_fields(built)
    with pytest.raises(InputError, match="strengths"):
        problem.material_of(built)
    assert problem.material_of(assembly).tension == 100.0


def test_stated_interfaces_that_miss_the_outlines_are_refused() -> None:
    """A joint that stands 2 mm above the face it belongs to: blocks would come apart on the mesh."""
    scene = {
        "elements": [
            {"id": "ground", "polygon": [[0, -1], [1, -1], [1, 0], [0, 0]], "support": True},
            {"id": "block", "polygon": [[0, 0.004], [1, 0.004], [1, 1], [0, 1]]},
        ],
        "interfaces": [{"elements": ["ground", "block"], "polygon": [[0, 0.002], [1, 0.002]]}],
        "materials": {
            "density": 2.0,
            "dry": {"friction_coefficient": 0.5},
            "inner": {"tensile_strength": 100.0, "shear_strength": 100.0},
        },
        "loads": {"live": [{"body": [1, 0]}]},
    }
    with pytest.raises(InputError, match="does not lie on the outlines"):
        bounds_by_fields(build_assembly(parse_scene(scene)))


def test_flagship_load_is_uniform_over_the_top_of_its_cell() -> None:
    """Three forces of 1000 N in all on 0.1 × 0.1 m: 100 kPa."""
    assembly = build_assembly(load_scene(Path(__file__).parents[2] / "scenes" / "flat_beam_arch.json"))
    _, loads = field_loads.loaded_mesh(assembly)
    assert len(loads.tractions) == 1
    assert loads.tractions[0].live == pytest.approx(np.array([[0.0, -1e5], [0.0, -1e5]]), abs=1e-6)


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_force_as_steep_on_two_faces_is_asked_for(dimension: int, first: int) -> None:
    """At an edge of a block, 45° from both faces; the order of corners or faces would choose one of them."""
    if dimension == 2:
        square = [[0, 1], [1, 1], [1, 2], [0, 2]]
        block: dict[str, Any] = {"id": "a", "polygon": square[first:] + square[:first]}
        ground: dict[str, Any] = {"id": "s", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]], "support": True}
        force, at = [4e2, -4e2], [0.0, 2.0]
    else:
        block, ground = box("a", [0, 0, 1], [1, 1, 2]), box("s", [0, 0, 0], [1, 1, 1], support=True)
        block["faces"] = block["faces"][first:] + block["faces"][:first]
        force, at = [4e2, 0.0, -4e2], [0.0, 0.5, 2.0]
    document = {
        "elements": [block, ground],
        "materials": {
            "density": 2000,
            "dry": {"friction_coefficient": 0.6},
            "inner": {"tensile_strength": 1e5, "shear_strength": 1.5e5},
        },
        "loads": {"live": [{"element": "a", "force": force, "at": at}]},
        "cracks": {"kind": "fields", "gap": 5.0},
    }
    with pytest.raises(InputError, match="as steep on two free faces"):
        solve(document)


# By fields, pressures and line loads act where they stand, dead ones and linear ones too: closed forms and limits.


TENSION, CRUSHING = 1.0, 4.0
INNER = {"tensile_strength": TENSION, "shear_strength": 2.0, "compressive_strength": CRUSHING}


def rectangle(name: str, x: float, y: float, p: float, q: float, **more: Any) -> dict[str, Any]:
    return {"id": name, "polygon": [[x, y], [p, y], [p, q], [x, q]], **more}


def scene(elements: list[dict[str, Any]], live: Any, dead: Any = (), d: int = 2, **more: Any) -> dict[str, Any]:
    return {
        "elements": elements,
        "materials": {
            "density": 0.0,
            "gravity": [0.0] * (d - 1) + [-1.0],
            "dry": {"friction_coefficient": 0.6},
            "inner": INNER,
        },
        "loads": {"live": list(live), "dead": list(dead)},
        **more,
    }


def pressed_column(live: Any, dead: Any = ()) -> dict[str, Any]:
    """A weightless column 1 × 2, of thickness 0.3, one with the ground."""
    elements = [rectangle("ground", 0, -1, 1, 0, support=True), rectangle("b", 0, 0, 1, 2)]
    return scene(elements, [live], dead, thickness=0.3, labels={"inner": [["ground", "b"]]})


def on_head(*ends: float, low: float = 0.0, high: float = 1.0) -> dict[str, Any]:
    """A pressure on the head of the column."""
    return {"face": {"along": [[low, 2.0], [high, 2.0]]}, "pressure": list(ends) if len(ends) == 2 else ends[0]}


def line_on_head(*force: float) -> dict[str, Any]:
    return {"face": {"along": [[0.0, 2.0], [1.0, 2.0]]}, "line": list(force)}


AROUND = {"face": {"between": ["b", "outside"]}, "pressure": 0.5}

UNIFORM: list[tuple[str, dict[str, Any], list[dict[str, Any]], float]] = [
    # the stress is uniform over the height: dead and live pressures add up at the head, where no weight acts
    ("pull against a dead pressure", on_head(-1.0), [on_head(0.7)], TENSION + 0.7),
    ("pull beside a dead pull", on_head(-1.0), [on_head(-0.7)], TENSION - 0.7),
    ("pressure against a dead pull", on_head(2.0), [on_head(-0.7)], (CRUSHING + 0.7) / 2.0),
    ("line load, over the thickness", line_on_head(0.0, 1.0), [line_on_head(0.0, -0.3)], 0.3 * TENSION + 0.3),
    ("in two parts, turned round", on_head(-1.0), [on_head(0.7, high=0.4), on_head(0.7, low=1.0, high=0.4)], 1.7),
    ("pressure all around, from all sides alike", AROUND, [], CRUSHING / 0.5),
    # the corner under the largest pressure is crushed or torn in one direction
    ("linear pressure", on_head(0.0, 2.0), [], CRUSHING / 2.0),
    ("linear pull", on_head(-0.4, 0.0), [], TENSION / 0.4),
    ("linear dead pressure", on_head(1.0), [on_head(0.0, 1.5)], CRUSHING - 1.5),
    ("linear dead pull", on_head(-1.0), [on_head(-0.6, 0.6)], TENSION - 0.6),
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("live", "dead", "expected"), [case[1:] for case in UNIFORM], ids=[case[0] for case in UNIFORM]
)
def test_a_column_of_uniform_stress(live: dict[str, Any], dead: list[dict[str, Any]], expected: float) -> None:
    found = bounds_by_fields(build_assembly(parse_scene(pressed_column(live, dead))), gap=0.2, seconds=10.0)
    assert found.lower == pytest.approx(expected, rel=1e-5)
    assert found.upper >= expected * (1.0 - 1e-6)


def lintel(dead: list[dict[str, Any]]) -> dict[str, Any]:
    """A weightless lintel 4 × 0.5, dry on two supports 3 apart, under a live pressure on its whole top."""
    outline = [[0, 0], [0.5, 0], [3.5, 0], [4, 0], [4, 0.5], [0, 0.5]]
    supports = [rectangle("left", 0, -1, 0.5, 0, support=True), rectangle("right", 3.5, -1, 4, 0, support=True)]
    live = [{"face": {"along": [[0, 0.5], [4, 0.5]]}, "pressure": 1.0}]
    return scene([*supports, {"id": "lintel", "polygon": outline}], live, dead)


AT_MIDSPAN: list[dict[str, Any]] = [
    {"face": {"along": [[1.75, 0.5], [2.25, 0.5]]}, "pressure": 0.6},
    {"face": {"along": [[1.75, 0.5], [2.25, 0.5]]}, "line": [0.0, -0.6]},
    {"element": "lintel", "force": [0.0, -0.3], "at": [2.0, 0.5], "width": 0.5},
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("dead", AT_MIDSPAN, ids=["pressure", "line", "force with a width"])
def test_a_dead_load_on_part_of_a_lintel_bends_it_there(dead: dict[str, Any]) -> None:
    """M = 0.3 · 3/4 − 0.3 · 0.5/8 = 0.206 at midspan, above the plastic moment 0.1 of σt = 1 and σc = 4."""
    found = bounds_by_fields(build_assembly(parse_scene(lintel([dead]))), gap=0.2, seconds=5.0)
    assert found.upper < 0.0
    third = {**dead, **{key: 0.2 / 0.6 * dead[key] for key in ("pressure",) if key in dead}}
    third |= {key: [0.0, dead[key][1] / 3.0] for key in ("line", "force") if key in dead}
    found = bounds_by_fields(build_assembly(parse_scene(lintel([third]))), gap=0.1, seconds=10.0)
    assert 0.06 <= found.lower <= found.upper <= 0.078


def test_a_lintel_that_falls_under_its_dead_load_is_not_verified(tmp_path: Path, jld: Command) -> None:
    document = {**lintel([{**AT_MIDSPAN[0], "pressure": 0.6}]), "cracks": {"kind": "fields", "gap": 0.2}}
    (tmp_path / "scene.json").write_text(json.dumps(document))
    done = jld("check-design", tmp_path / "scene.json", "--out", tmp_path / "out", "--json")
    assert json.loads(done.out)["verified"] is False


def test_a_dead_patch_on_a_cantilever_turns_its_root() -> None:
    """σt = 1, σc = 4, h = 0.25: the plastic moment σt σc h²/(2(σt + σc)) t = 0.025 t at the root, less the dead one."""

    def factor(dead: list[dict[str, Any]]) -> tuple[float, float]:
        elements = [rectangle("wall", -1, -1, 0, 1, support=True), rectangle("b", 0, 0, 2, 0.25)]
        live = {"face": {"along": [[1.5, 0.25], [2.0, 0.25]]}, "pressure": 0.1}
        document = scene(elements, [live], dead, labels={"inner": [["wall", "b"]]})
        found = bounds_by_fields(build_assembly(parse_scene(document)), gap=0.02, seconds=20.0)
        return found.lower, found.upper

    for near, far in ((1.0, 1.5), (0.25, 0.5), (1.75, 2.0)):
        dead = {"face": {"along": [[near, 0.25], [far, 0.25]]}, "pressure": 0.015}
        expected = (0.025 - 0.015 * (far - near) * 0.5 * (near + far)) / (0.1 * 0.5 * 1.75)
        low, high = factor([dead])
        assert low <= expected * 1.03
        assert high >= expected * 0.99  # shear at the root takes a share that slender beams neglect
        assert high <= low * 1.1


CUBE = [box("ground", [0, 0, -1], [1, 1, 0], support=True), box("b", [0, 0, 0], [1, 1, 2])]
HEAD = [[0, 0, 2], [1, 0, 2], [1, 1, 2], [0, 1, 2]]
IN_SPACE: list[tuple[str, dict[str, Any], list[dict[str, Any]], float]] = [
    ("patch", {"face": {"patch": HEAD}, "pressure": -1.0}, [{"face": {"patch": HEAD}, "pressure": 0.7}], TENSION + 0.7),
    (
        "two halves",
        {"face": {"patch": HEAD}, "pressure": 2.0},
        [
            {"face": {"patch": [[x, 0, 2], [x + 0.5, 0, 2], [x + 0.5, 1, 2], [x, 1, 2]]}, "pressure": 1.0}
            for x in (0, 0.5)
        ],
        (CRUSHING - 1.0) / 2.0,
    ),
    ("all around", {"face": {"between": ["b", "outside"]}, "pressure": 0.5}, [], CRUSHING / 0.5),
]


@pytest.mark.parametrize(
    ("live", "dead", "expected"), [case[1:] for case in IN_SPACE], ids=[case[0] for case in IN_SPACE]
)
def test_a_column_of_uniform_stress_in_space(live: dict[str, Any], dead: list[Any], expected: float) -> None:
    document = scene(CUBE, [live], dead, d=3, labels={"inner": [["ground", "b"]]})
    found = bounds_by_fields(build_assembly(parse_scene(document)), gap=0.2, seconds=10.0)
    assert found.lower == pytest.approx(expected, rel=1e-4)
    assert found.upper >= expected * (1.0 - 1e-5)


def test_a_patch_at_midspan_in_space_bends_the_lintel_there() -> None:
    """A live patch of 8 on 0.5 × 0.5 at midspan: a plastic moment of 0.05 stands against M = 8 · 0.25 (3/4 − 0.5/8)."""
    elements = [
        box("left", [0, 0, -1], [0.5, 0.5, 0], support=True),
        box("right", [3.5, 0, -1], [4, 0.5, 0], support=True),
        box("lintel", [0, 0, 0], [4, 0.5, 0.5]),
    ]
    patch = [[1.75, 0, 0.5], [2.25, 0, 0.5], [2.25, 0.5, 0.5], [1.75, 0.5, 0.5]]
    document = scene(elements, [{"face": {"patch": patch}, "pressure": 8.0}], d=3)
    found = bounds_by_fields(build_assembly(parse_scene(document)), gap=0.5, seconds=4.0)
    assert 0.0 < found.lower <= 0.05 / (8.0 * 0.25 * (0.75 - 0.5 / 8.0)) * 1.05
