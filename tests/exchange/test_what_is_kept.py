"""Every key of a scene is kept by a format, or named as lost: no list of keys by hand can forget one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from command import Command
from jld_core import InputError, Layout, Scene, build_assembly, parse_scene, solve
from jld_core.scene import uncertain
from jld_formats import FORMATS, export, facts, import_file
from jld_formats import formats as formats_of_exchange

LIBRARY = {"dxf": "ezdxf", "3dm": "rhino3dm", "ifc": "ifcopenshell", "obj": "meshio", "ply": "meshio", "vtk": "meshio"}
READ_BACK = ("dxf", "3dm", "compas")
"""Formats that hold scene data beside the geometry."""


PLANAR = {"rows": [{"N": -1, "M": 3, "most": 1}], "symmetric": ["M"], "friction": {"coefficients": 0.3}}


@pytest.mark.parametrize(
    ("surface", "key"), [(PLANAR, "rows"), ({"hoek_brown": {"compressive_strength": 4e6, "m": 10}}, "hoek_brown")]
)
def test_a_surface_of_the_plane_is_refused_by_files_of_solids(surface: Any, key: str, tmp_path: Path) -> None:
    scene = wall()
    scene["materials"]["inner"] = {"surface": surface}
    assembly = build_assembly(parse_scene(scene))
    layout = Layout(parse_scene(scene), assembly, assembly.labels)
    with pytest.raises(InputError, match=rf"materials.inner.surface.{key}: it speaks of the plane"):
        export(layout, "compas", tmp_path / "out.json")


def wall(**keys: Any) -> dict[str, Any]:
    """A wall of four stones with a value for many keys."""
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    elements = [
        {"id": "g", "support": True, "polygon": [[0, -1], [2, -1], [2, 0], [1, 0], [0, 0]]},
        *(
            {
                "id": f"s{x}{y}",
                "polygon": [[x + a, y + b] for a, b in square],
                "density": 2000 + 10 * x,
                "block": f"B{x}",
            }
            for x in range(2)
            for y in range(2)
        ),
    ]
    return {
        "name": "wall",
        "source": "here",
        "notes": "a note",
        "expected": {"λ": 1},
        "units": {"length": "m", "force": "N"},
        "thickness": 0.5,
        "elements": elements,
        "materials": {
            "density": 1900,
            "gravity": 9.7,
            "dry": {"friction_coefficient": 0.55, "cohesion": 100.0, "compressive_strength": 1e7},
            "inner": {
                "tensile_strength": 2e4,
                "shear_strength": 3e4,
                "compressive_strength": 2e7,
                "friction_coefficient": 0.3,
            },
        },
        "loads": {"live": [{"element": "s01", "force": [5.0, -1.0], "at": [0.3, 2.0], "width": 0.2, "moment": 3.0}]},
        "search": {"candidates": "all+supports", "segmentation": False, "block_cells": [1, 3], "symmetry": "none"},
        **keys,
    }


FACE = {"between": ["s01", "s11"]}
PLANAR: dict[str, dict[str, Any]] = {
    "fields": wall(cracks={"kind": "fields", "gap": 0.2}, design={"set": "EN 1990"}, tolerance=1e-4),
    "cases": wall(
        loads={
            "cases": [
                {
                    "name": "one",
                    "required": 1.5,
                    "live": [{"body": [1, 0]}, {"face": {"between": ["s01", "outside"]}, "pressure": 3.0}],
                    "dead": [{"element": "s00", "force": [0, -7.0]}],
                }
            ],
            "dead": [{"element": "s10", "force": [0, -2.0], "at": [1.4, 0.5]}],
        },
        cracks={"kind": "cells", "cell": 0.5},
    ),
    "members": wall(
        members=[
            {
                "kind": "tendon",
                "name": "t",
                "from": {"element": "s01", "at": [0.5, 1.8]},
                "to": {"element": "s00", "at": [0.5, 0.2]},
                "tension": 5e3,
                "prestress": 1e3,
            }
        ],
        settlements=[{"name": "down", "supports": [{"elements": ["g"], "move": [0, -1]}], "load": 0.5}],
    ),
    "faces": wall(
        materials={
            **wall()["materials"],
            "faces": [
                {"between": ["s00", "s10"], "dry": {"friction_coefficient": 0.2}, "inner": {"tensile_strength": 9.0}}
            ],
        },
        search={
            "keep": {"dry": [["s00", "s01"]], "inner": []},
            "require": {"load_factor": 0.1},
            "moulds": {"flip": False},
        },
        labels={"inner": [["s10", "s11"]]},
    ),
    "moving": wall(
        loads={
            "moving": [
                {
                    "name": "cart",
                    "path": [[0.1, 2.0], [1.9, 2.0]],
                    "axles": [{"weight": 100.0}, {"weight": 50.0, "distance": 0.4}],
                    "steps": 4,
                }
            ]
        },
        move={"edge": 0.05, "box": 0.1},
    ),
    "pushes": wall(loads={"pushes": {"directions": 2}}),
    "bond": wall(
        materials={
            **wall()["materials"],
            "dry": {"friction_coefficient": 0.5, "cohesion": 1e3, "tensile_strength": 1e3},
        }
    ),
    "stated": wall(
        interfaces=[
            {"elements": ["g", "s00"], "polygon": [[0, 0], [1, 0]], "friction_coefficient": 0.45},
            {"elements": ["g", "s10"], "polygon": [[1, 0], [2, 0]], "label": "dry"},
            {"elements": ["s00", "s01"], "polygon": [[0, 1], [1, 1]], "label": "inner", "tensile_strength": 5e3},
            {"elements": ["s10", "s11"], "polygon": [[1, 1], [2, 1]], "cohesion": 50.0},
            {"elements": ["s01", "s11"], "polygon": [[1, 1], [1, 2]]},
        ]
    ),
    "fill": wall(fill={"density": 1800, "friction_angle": 35, "level": 2.4, "from": 0.0, "to": 2.0}),
}


def tower(**keys: Any) -> dict[str, Any]:
    """Three cubes on a support, one with stated weight."""
    sides = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]

    def cube(z: float) -> dict[str, Any]:
        """Return a cube of side 1."""
        square = [[0, 0], [1, 0], [1, 1], [0, 1]]
        return {"vertices": [[x, y, z + h] for h in (0, 1) for x, y in square], "faces": sides}

    return {
        **{key: value for key, value in wall().items() if key not in ("thickness", "search")},
        "name": "tower",
        "elements": [
            {"id": "g", "support": True, **cube(-1)},
            {"id": "a", **cube(0), "block": "A"},
            {"id": "b", **cube(1), "density": 2100, "block": "A"},
            {"id": "c", **cube(2), "weight": 1000.0},
        ],
        "materials": {
            "density": 1900,
            "dry": {"friction_angle": 30, "cohesion": 100.0},
            "inner": {"tensile_strength": 2e4, "shear_strength": 3e4},
        },
        "loads": {"live": [{"element": "c", "force": [5.0, 0.0, 0.0], "at": [0.5, 0.5, 2.5]}]},
        "search": {"block_cells": [1, 2]},
        **keys,
    }


SPATIAL: dict[str, dict[str, Any]] = {
    "tower": tower(design={"set": "EN 1990"}, cracks={"kind": "fields", "gap": 0.3}),
    "tied": tower(
        members=[
            {
                "kind": "tie",
                "from": {"element": "a", "at": [0.5, 0.5, 0.5]},
                "to": {"element": "c", "at": [0.5, 0.5, 2.5]},
                "tension": 100.0,
            }
        ]
    ),
    "patch": tower(
        loads={"live": [{"face": {"patch": [[0, 0, 3], [1, 0, 3], [1, 1, 3], [0, 1, 3]]}, "pressure": 2.0}]}
    ),
}
SCENES = PLANAR | SPATIAL


def stated_paths(value: Any, head: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the keys of a document with their values, lists of objects by their places."""
    if isinstance(value, dict):
        for key, one in value.items():
            yield from stated_paths(one, f"{head}.{key}" if head else str(key))
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for one in value:
            yield from stated_paths(one, head)
    else:
        yield head, value


def values_of(document: dict[str, Any]) -> dict[str, list[str]]:
    """Return the values under each key of a scene, without geometry and without what labels decide."""
    scene = parse_scene(document)
    found: dict[str, list[str]] = {}
    for path, value in stated_paths(uncertain.with_means(scene.model_dump(mode="json", exclude_defaults=True))):
        found.setdefault(path, []).append(json.dumps(value, sort_keys=True))
    return {path: sorted(values) for path, values in found.items()}


@cache
def layout(name: str) -> Layout:
    scene = parse_scene(SCENES[name])
    assembly = build_assembly(scene)
    return Layout(scene, assembly, assembly.labels)


GEOMETRY = (
    *("elements.polygon", "elements.vertices", "elements.faces", "elements.id", "grid", "labels"),
    *("interfaces.polygon", "interfaces.label", "tolerance"),
)
TURNED = ("force", "at", "moment", "body", "gravity")
"""Vectors of the plane that become vectors of space."""


@pytest.mark.sampled(6)
@pytest.mark.parametrize("cells", [False, True])
@pytest.mark.parametrize("kind", READ_BACK)
@pytest.mark.parametrize("name", SCENES)
def test_every_key_is_kept_or_named(name: str, kind: str, cells: bool, tmp_path: Path) -> None:
    pytest.importorskip(LIBRARY.get(kind, "json"))
    made = layout(name)
    path = tmp_path / f"file{FORMATS[kind]}"
    try:
        export(made, kind, path, cells=cells)
    except InputError:
        return
    back = import_file(path).document
    gone = facts.lost(made, kind, cells=cells)
    before, after = values_of(SCENES[name]), values_of(back)
    planar = made.assembly.dimension == 2
    for key, values in before.items():
        if key.startswith(GEOMETRY) or any(key == one or key.startswith(f"{one}.") for one in gone):
            continue
        if kind == "compas" and key.split(".")[-1] in TURNED and planar:
            continue
        if not cells and key.startswith(("elements", "loads")) and (kind == "compas" or not planar):
            continue  # blocks have names, weights and loads of their own
        if kind == "compas" and key.startswith(("elements", "thickness")):
            continue  # weights of extruded elements
        assert after.get(key) == values, f"{key} is lost and not named"


@pytest.mark.sampled(6)
@pytest.mark.parametrize("kind", ["dxf", "3dm"])
@pytest.mark.parametrize("name", PLANAR)
def test_the_same_load_factor_there_and_back(name: str, kind: str, tmp_path: Path) -> None:
    pytest.importorskip(LIBRARY[kind])
    made = layout(name)
    path = export(made, kind, tmp_path / f"file{FORMATS[kind]}")
    again = parse_scene(import_file(path).document)
    before, after = solve(made.assembly, made.labels), solve(build_assembly(again))
    assert after.load_factor == pytest.approx(before.load_factor, rel=1e-7, nan_ok=True)
    assert (after.status, again.cracks) == (before.status, made.scene.cracks)


def schema_paths(model: type[BaseModel], head: str = "") -> Iterator[str]:
    """Yield every key of the scene's models."""

    def models(kind: Any) -> Iterator[type[BaseModel]]:
        """Yield the models within an annotation."""
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield kind
        for part in get_args(kind):
            yield from models(part)

    for name, field in model.model_fields.items():
        path = f"{head}{field.alias or name}"
        yield path
        for inner in models(field.annotation):
            yield from schema_paths(inner, f"{path}.")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", FORMATS)
def test_a_key_of_the_schema_is_known_or_named(kind: str) -> None:
    """What a format knows are keys of the schema, and any other key is named: also one that comes later."""
    every = set(schema_paths(Scene))
    keeps = formats_of_exchange.formats()[kind].keeps
    assert set(keeps) <= every
    for name in SCENES:
        made = layout(name)
        named = facts.lost(made, kind)
        for key, _ in stated_paths(made.scene.model_dump(mode="json", exclude_defaults=True)):
            known = any(key == one or key.startswith(f"{one}.") for one in keeps)
            whole = kind in ("dxf", "3dm") and made.assembly.dimension == 2
            assert (
                known
                or whole
                or key.startswith("labels")
                or any(key == one or key.startswith(f"{one}.") for one in named)
            ), name


def test_the_samples_state_every_key_of_the_top_level() -> None:
    stated = {key.partition(".")[0] for document in SCENES.values() for key in document}
    assert {field.alias or name for name, field in Scene.model_fields.items()} - stated <= {"grid"}


@pytest.mark.parametrize("kind", ["3dm", "ifc", "gltf", "obj"])
def test_bond_is_exported_or_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    pytest.importorskip(LIBRARY.get(kind, "json"))
    assert export(layout("bond"), kind, tmp_path / f"file{FORMATS[kind]}").stat().st_size > 100


def test_the_command_names_what_is_lost(jld: Command, tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(PLANAR["fields"]))
    done = jld("export", tmp_path / "scene.json", "--format", "obj", "-o", tmp_path / "a.obj").done()
    (line,) = [one for one in done.out.splitlines() if one.startswith("not kept")]
    for word in ("cracks", "design", "loads", "materials", "search", "labels (2 inner faces)"):
        assert word in line
    done = jld("export", tmp_path / "scene.json", "--format", "dxf", "-o", tmp_path / "a.dxf")
    assert "not kept" not in done.out
