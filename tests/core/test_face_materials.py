"""Materials of the faces between two elements, beside interfaces that are found."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
import pytest

from cases import grid_document
from jld_core import InputError, Scene, build_assembly, parse_scene, solve
from jld_core.build import build_robust
from jld_core.exchange import Layout, export, import_file
from jld_core.refinement import refine
from jld_core.strengths import Route

ROUTE = Route("a test")

FACES: list[dict[str, Any]] = [
    {"between": ["c0r0", "c1r0"], "inner": {"tensile_strength": 1e3}},
    {"between": ["c1r1", "c1r0"], "dry": {"friction_coefficient": 0.2, "cohesion": 50.0}},
    {
        "between": ["c0r1", "c0r2"],
        "dry": {"friction_angle": 20, "compressive_strength": 1e5},
        "inner": {
            "tensile_strength": 9e2,
            "shear_strength": 7e3,
            "compressive_strength": 2e5,
            "friction_coefficient": 0.1,
        },
    },
]


def document(faces: list[dict[str, Any]], **changes: Any) -> dict[str, Any]:
    found = grid_document(["aa", "aa", "##"], tension=5e3, shear=5e3, friction=0.6)
    found["materials"]["faces"] = faces
    return {**found, **changes}


def listed(faces: list[dict[str, Any]]) -> Scene:
    """The same scene with elements and all interfaces listed one by one."""
    plain = build_assembly(parse_scene(document([])))
    elements, found = plain.elements, plain.interfaces
    names = {"friction_coefficient": "inner_friction_coefficient", "friction_angle": "inner_friction_angle"}
    interfaces = []
    for a, b, polygon in zip(found.a, found.b, found.polygon, strict=True):
        pair = [elements.ids[a], elements.ids[b]]
        own: dict[str, Any] = {}
        for entry in faces:
            if set(entry["between"]) == set(pair):
                own |= entry.get("dry", {})
                own |= {names.get(key, key): value for key, value in entry.get("inner", {}).items()}
        interfaces.append({"elements": pair, "polygon": polygon.tolist(), **own})
    shapes = [
        {"id": name, "polygon": shape.tolist(), "support": bool(support), "block": None if support else "a"}
        for name, shape, support in zip(elements.ids, elements.shape, elements.support, strict=True)
    ]
    found_document = document([], elements=shapes, interfaces=interfaces, thickness=0.1)
    del found_document["grid"]
    return parse_scene(found_document)


@pytest.mark.parametrize(
    "entries", [FACES[:1], FACES[:2], [FACES[0], FACES[1]][::-1]], ids=["inner", "both", "reversed"]
)
def test_the_load_factor_is_that_of_all_interfaces_listed(entries: list[dict[str, Any]]) -> None:
    assembly, other = build_assembly(parse_scene(document(entries))), build_assembly(listed(entries))
    for name, values in vars(assembly.strengths(ROUTE)).items():
        assert np.array_equal(values, getattr(other.strengths(ROUTE), name), equal_nan=True), name
    plain, changed = build_assembly(parse_scene(document([]))), []
    for number in range(0, 2 ** len(assembly.interfaces), 5):
        labels = (number >> np.arange(len(assembly.interfaces))) & 1 > 0
        found, expected = solve(assembly, labels), solve(other, labels)
        assert found.status == expected.status
        if found.load_factor is not None:
            assert found.load_factor == pytest.approx(expected.load_factor, rel=1e-9)
            changed.append(abs(found.load_factor / solve(plain, labels).load_factor - 1.0) > 1e-3)
    assert any(changed)


def test_crushing_is_stated_for_each_label_alone() -> None:
    """An interface that is listed has one compressive strength; an entry of faces has one for either label."""
    assembly = build_assembly(parse_scene(document(FACES)))
    ids, faces = assembly.elements.ids, assembly.interfaces
    pairs = [{ids[a], ids[b]} for a, b in zip(faces.a, faces.b, strict=True)]
    face, strengths = pairs.index({"c0r1", "c0r2"}), assembly.strengths(ROUTE)
    assert (strengths.crush_dry[face], strengths.crush_inner[face]) == (1e5, 2e5)
    assert strengths.friction[face] == pytest.approx(np.tan(np.radians(20)))
    assert (strengths.tension[face], strengths.shear[face], strengths.inner_friction[face]) == (9e2, 7e3, 0.1)
    assert np.isinf(np.delete(strengths.crush_dry, face)).all()


def test_a_block_on_a_face_of_its_own_slides_at_its_friction() -> None:
    """A block under its weight and a horizontal body load slides at λ = μ of its joint."""
    scene = grid_document(["a", "#"], friction=0.9)
    scene["materials"]["faces"] = [{"between": ["c0r1", "c0r0"], "dry": {"friction_coefficient": 0.25}}]
    assert solve(build_assembly(parse_scene(scene))).load_factor == pytest.approx(0.25, rel=1e-9)


def test_low_values_of_faces_are_those_of_a_robust_search() -> None:
    low = {"nominal": 1e3, "low": 4e2}
    scene = parse_scene(document([{"between": ["c0r0", "c1r0"], "inner": {"tensile_strength": low}}]))
    robust = build_robust(scene)
    assert (robust.strengths(ROUTE).tension.min(), robust.at_nominal.strengths(ROUTE).tension.min()) == (4e2, 1e3)
    assert parse_scene(json.loads(scene.model_dump_json(exclude_defaults=True))) == scene


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"between": ["c0r0", "c9r9"], "dry": {"cohesion": 1.0}}, "materials.faces[0].between[0]: no element"),
        ({"between": ["c0r0", "c1r1"], "dry": {"cohesion": 1.0}}, "share no interface"),
        ({"between": ["c0r0", "c1r0"]}, "materials.faces[0]: it states no value"),
        ({"between": ["c0r0"], "dry": {}}, "materials.faces[0].between"),
        ({"between": ["c0r0", "c1r0"], "dry": {"shear_strength": 1.0}}, "materials.faces[0].dry"),
        (
            {"between": ["c0r0", "c1r0"], "dry": {"tensile_strength": 1.0}},
            "materials.faces of c0r0–c1r0: dry.tensile_strength: 1 is beyond the apex",
        ),
        ({"between": ["c0r0", "c1r0"], "dry": {"friction_angle": 1, "friction_coefficient": 1}}, "given twice"),
        (
            {"between": ["c0r0", "c1r0"], "inner": {"friction_coefficient": 2.0}},
            "materials.faces of c0r0–c1r0: tensile_strength 5000 lies beyond the apex",
        ),
    ],
)
def test_bad_entries_are_named(entry: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words).replace(r"between\[0\]", "between.*")):
        build_assembly(parse_scene(document([entry])))


def test_a_pair_has_one_entry() -> None:
    twice = [FACES[0], {**FACES[0], "between": FACES[0]["between"][::-1]}]
    with pytest.raises(InputError, match=r"materials\.faces\[1\]\.between: .* twice"):
        build_assembly(parse_scene(document(twice)))


def test_operations_that_would_lose_them_are_refused_and_drawings_keep_them(tmp_path: Any) -> None:
    scene = parse_scene(document(FACES))
    with pytest.raises(InputError, match=r"materials\.faces"):
        refine(scene, (0.05, 0.05))
    assembly = build_assembly(scene)
    path = export(Layout(scene, assembly, assembly.labels, None), "dxf", tmp_path / "a.dxf")
    assert import_file(path).document["materials"]["faces"] == document(FACES)["materials"]["faces"]
