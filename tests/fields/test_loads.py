"""Loads of fields are statically equivalent to those of the scene, and what cannot be spread is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import box
from jld_core import Assembly, Floats, InputError, build_assembly, load_scene, parse_scene, solve
from jld_core.fields import bounds_by_fields
from jld_core.fields.loads import FieldLoads, loaded_mesh, thickness_of
from jld_core.fields.mesh import Mesh
from jld_core.fields.problem import material_of


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


def resultants(assembly: Assembly, mesh: Mesh, loads: FieldLoads, live: bool) -> Floats:
    """Forces and moments (n, 3) about the centroids, by quadrature of body forces and tractions."""
    total = np.zeros((len(assembly.elements), 3))
    thickness = thickness_of(assembly)
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
    mesh, loads = loaded_mesh(assembly, patch)
    free = assembly.elements.free
    assert resultants(assembly, mesh, loads, True)[free] == pytest.approx(assembly.live[free], abs=1e-12)
    assert resultants(assembly, mesh, loads, False)[free] == pytest.approx(assembly.dead[free], abs=1e-12)


def test_patches() -> None:
    """Whole face within the middle third, centred part beyond it, stated length on request."""

    def spans(at: float, patch: float | None) -> list[float]:
        _, loads = loaded_mesh(column([{"element": "a", "force": [0.0, -1.0], "at": [at, 2.0]}]), patch)
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
    with pytest.raises(InputError) as error:
        bounds_by_fields(column(**scene), **options)
    assert words in str(error.value)
    assert "; expected " in str(error.value)
    assert "\n" not in str(error.value)


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
        material_of(built)
    assert material_of(assembly).tension == 100.0


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
    _, loads = loaded_mesh(assembly)
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
