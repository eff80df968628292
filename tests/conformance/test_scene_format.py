"""The scene format for editors and readers is that of the schema, and current."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import json
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import typer
from benchmarks.claims import Tally, answers
from tools.scene_form import json_schema, parts
from tools.scene_format import files
from tools.scene_meanings import MEANINGS

from command import ROOT, app
from jld_core import InputError, Scene, build_assembly, parse_scene
from jld_core.program import ConicProgram, Template
from jld_explore import ExploreSettings, explore
from jld_formats import FORMATS

SCENES = sorted((ROOT / "scenes").glob("*.json"))
GOOD: dict[str, Any] = {
    "grid": {"cell": [1, 1], "rows": ["a", "#"]},
    "materials": {"density": 1, "dry": {"friction_coefficient": 0.5}},
    "loads": {"live": [{"body": [1, 0]}]},
}


@cache
def validator() -> Any:
    return jsonschema.Draft202012Validator(json_schema())


def test_files_are_current() -> None:
    for path, text in files().items():
        assert path.read_text("utf-8") == text, f"{path.name} is stale: python -m tools.scene_format"


def test_keywords_of_python_are_the_settings() -> None:
    """Settings are stated once: keywords of `explore`, flags and docs/settings.md follow from the fields."""
    known = {one.name for one in dataclasses.fields(ExploreSettings)}
    keywords = {
        name
        for name, one in inspect.signature(explore).parameters.items()
        if one.kind is inspect.Parameter.KEYWORD_ONLY
    }
    assert keywords - known == {"objective", "started"}
    assert {"check_fields", "reliability", "csv", "small", "by_experiment", "own_objective"} == known - keywords


def test_every_key_has_a_meaning_and_no_meaning_is_left_over() -> None:
    models = {model for _, model in parts()}
    assert models == set(MEANINGS), "see tools/scene_meanings.py"
    for model, meanings in MEANINGS.items():
        assert list(meanings) == list(model.model_fields), f"{model.__name__}: see tools/scene_meanings.py"
        assert all(meaning.text.endswith(".") for meaning in meanings.values())


def test_the_schema_is_one() -> None:
    jsonschema.Draft202012Validator.check_schema(json_schema())


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_scenes_that_come_along_are_valid(path: Any) -> None:
    validator().validate(json.loads(path.read_text("utf-8")))


def test_a_scene_that_names_its_schema_is_read() -> None:
    document = {"$schema": "docs/scene.schema.json", **GOOD}
    validator().validate(document)
    assert parse_scene(document) == parse_scene(GOOD)


@pytest.mark.parametrize(
    "change",
    [
        {"grids": {}},
        {"thickness": -1.0},
        {"materials": {"dry": {"friction_angle": 90}}},
        {"search": {"block_cells": [1.5, None]}},
        {"loads": {"live": 1}},
        {"labels": {"default": "wet"}},
    ],
    ids=lambda change: next(iter(change)),
)
def test_the_schema_refuses_the_scenes_that_the_program_refuses(change: dict[str, Any]) -> None:
    document = {**GOOD, **change}
    with pytest.raises(InputError):
        parse_scene(document)
    assert not validator().is_valid(document)


# λ is the same in other units: a share of `python -m benchmarks.claims units`, and the program that solvers see.


SCENES_IN_UNITS = (1, 3, 7, 8, 10, 13, 14, 15, 19, 22, 24, 34, 39, 45, 48, 51, 54, 55, 61, 76)
"""Seeds of quick scenes: in space and in the plane, with crushing, cohesion, load cases, voids and without weight."""


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", SCENES_IN_UNITS)
def test_load_factor_does_not_depend_on_units(seed: int) -> None:
    tally = Tally("")
    assert answers.case_units(seed, tally, ("kN and mm", "pounds and inches")) == ""
    assert sum(tally.notes.values()) == 2


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", SCENES_IN_UNITS[:10])
def test_solvers_see_the_same_program_in_other_units(seed: int) -> None:
    """Not all seeds would pass: 1 program of 100 has a number that is rounded up in one unit and down in another."""
    document, labels = answers.drawn_units(seed)
    one, *others = [_seen(changed, labels) for changed in (document, *answers.changes(document, seed).values())[:4]]
    for other in others:
        for key in ("data", "rhs", "objective"):
            assert np.array_equal(getattr(one, key), getattr(other, key)), key
        assert np.array_equal(one.structure.indices, other.structure.indices)


def _seen(document: dict[str, Any], labels: np.ndarray) -> ConicProgram:
    """Return the rounded program of the first load case."""
    return Template(build_assembly(parse_scene(document)).by_case[0]).program(labels).rounded


def test_entries_that_are_zero_by_construction_are_no_entries() -> None:
    """Arms of 1e-17 of a size came and went with the units, and with them the sparsity of all programs."""
    for seed in SCENES_IN_UNITS[1:4]:
        document, _ = answers.drawn_units(seed)
        matrices = [
            Template(build_assembly(parse_scene(changed)).by_case[0]).matrix
            for changed in (document, *answers.changes(document, seed).values())[:4]
        ]
        assert abs(matrices[0].data).min() > 1e-9
        assert all(np.array_equal(matrices[0].indices, matrix.indices) for matrix in matrices)


# What version 0.3 had, users still have: commands with options, keys of a scene, file formats, exported names.


BEFORE = json.loads((Path(__file__).parents[1] / "golden" / "interface_0_3.json").read_text("utf-8"))
"""Lists of version 0.3; `explore --certificates`, which had no effect, is left out."""


def command(name: str) -> Any:
    found: Any = typer.main.get_command(app)
    for part in name.split():
        found = found.get_command(None, part)
    return found


@pytest.mark.parametrize("name", BEFORE["commands"])
def test_every_option_is_there(name: str) -> None:
    options = {one for parameter in command(name).params for one in (*parameter.opts, *parameter.secondary_opts)}
    assert set(BEFORE["commands"][name]) - options == set()


def test_every_key_of_a_scene_is_there() -> None:
    schema = Scene.model_json_schema()
    parts = {"Scene": schema, **schema["$defs"]}
    assert (
        set(BEFORE["keys"]) - {f"{name}.{key}" for name, part in parts.items() for key in part["properties"]} == set()
    )


def test_every_format_and_name_is_there() -> None:
    assert set(BEFORE["formats"]) - set(FORMATS) == set()
    for package, names in BEFORE["names"].items():
        module = importlib.import_module(package)
        assert [name for name in names if not hasattr(module, name)] == []
