"""The scene format for editors and readers is that of the schema, and current."""

from __future__ import annotations

import json
from typing import Any

import jsonschema
import pytest
from tools.scene_form import json_schema, parts
from tools.scene_format import files
from tools.scene_meanings import MEANINGS

from command import ROOT
from jld_core import InputError, parse_scene

VALIDATOR = jsonschema.Draft202012Validator(json_schema())
SCENES = sorted((ROOT / "scenes").glob("*.json"))
GOOD: dict[str, Any] = {
    "grid": {"cell": [1, 1], "rows": ["a", "#"]},
    "materials": {"density": 1, "dry": {"friction_coefficient": 0.5}},
    "loads": {"live": [{"body": [1, 0]}]},
}


def test_files_are_current() -> None:
    for path, text in files().items():
        assert path.read_text("utf-8") == text, f"{path.name} is stale: python -m tools.scene_format"


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
    VALIDATOR.validate(json.loads(path.read_text("utf-8")))


def test_a_scene_that_names_its_schema_is_read() -> None:
    document = {"$schema": "docs/scene.schema.json", **GOOD}
    VALIDATOR.validate(document)
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
    assert not VALIDATOR.is_valid(document)
