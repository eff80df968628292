"""What version 0.3 had, users still have: commands with options, keys of a scene, file formats, exported names."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import pytest
import typer

from jld_core import Scene
from jld_core.exchange import FORMATS
from jld_explore.cli.command import app

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
