"""Every drawing is made of planar and of spatial structures: a function without a row here fails."""

from __future__ import annotations

import inspect
import json
import pkgutil
from collections.abc import Callable
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import jld_core.views
import jld_practice.laying
import jld_practice.reactions
from cases import dry_and_inner
from command import Command
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.build.loads import settlements_of
from jld_core.models import solve_by_fields
from jld_core.views.moved_joints import PathValue
from jld_practice.laying import assembly_order
from jld_practice.reactions import thrust_ranges
from jld_practice.reactions.force_range import settle

SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
SIDES = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]


def tower(dimension: int) -> dict[str, Any]:
    """Three stones on a support, with a tie, a settlement and a push."""

    def shape(level: float) -> dict[str, Any]:
        """Return the outline of a stone."""
        if dimension == 2:
            return {"polygon": [[x, level + y] for x, y in SQUARE]}
        return {"vertices": [[x, y, level + z] for z in (0, 1) for x, y in SQUARE], "faces": SIDES}

    down = [0.0] * (dimension - 1) + [-1.0]
    middle = [0.5] * (dimension - 1)
    return {
        "name": f"tower {dimension}",
        "elements": [
            {"id": "ground", "support": True, **shape(-1)},
            *({"id": f"s{k}", **shape(k)} for k in range(3)),
        ],
        "materials": dry_and_inner(2000, 0.6, 1e5, 1e5),
        "loads": {"live": [{"element": "s2", "force": [1.0] + [0.0] * (dimension - 1)}]},
        "members": [
            {
                "kind": "tie",
                "from": {"element": "s1", "at": [*middle, 1.6]},
                "to": {"element": "s2", "at": [*middle, 2.4]},
                "tension": 50.0,
            }
        ],
        "settlements": [{"name": "down", "supports": [{"elements": ["ground"], "move": down}]}],
    }


def drawings() -> dict[str, Any]:
    """Return the functions of views, laying and reactions that make a figure or write a file, by name."""
    found = {}
    packages = jld_core.views, jld_practice.laying, jld_practice.reactions
    for package, module in ((one, module) for one in packages for module in pkgutil.iter_modules(one.__path__)):
        code = import_module(f"{package.__name__}.{module.name}")
        for name, one in vars(code).items():
            made = inspect.isfunction(one) and one.__module__ == code.__name__ and not name.startswith("_")
            if made and name.startswith(("figure_of", "save_")):
                found[f"{module.name}.{name}"] = one
    return found


class Made:
    """What the drawings of one structure need, each computed once."""

    def __init__(self, dimension: int) -> None:
        document = tower(dimension)
        self.scene = parse_scene(document)
        self.assembly = build_assembly(self.scene)
        self.result = solve(self.assembly)
        document.pop("members")  # which an order of laying does not know, nor do fields
        self.bare = parse_scene(document)
        self.plain = build_assembly(self.bare)
        self.laying = assembly_order(self.plain, self.plain.labels)
        self.vertices = np.unique(np.concatenate(self.plain.elements.shape), axis=0)
        self.ranges = thrust_ranges(self.plain)
        self.settled = settle(self.plain, settlements_of(self.bare, self.plain)[0])

    @cached_property
    def fields(self) -> Any:
        """Return assembly, labels and bounds by fields of a coarse mesh."""
        return solve_by_fields(self.plain, gap=0.5, seconds=0.0).governing_case


@pytest.fixture(scope="module", params=[2, 3], ids=["planar", "spatial"])
def made(request: pytest.FixtureRequest) -> Made:
    return Made(request.param)


PATH = [PathValue("cart", 0.5 * k, 1.0, 1.0, 1.0) for k in range(3)]
CALLS: dict[str, Callable[[Any, Made, Path], Any]] = {
    "animation.save_animation": lambda draw, made, folder: draw(made.result, folder / "motion.gif"),
    "animation.save_laying_animation": lambda draw, made, folder: draw(made.laying, folder / "laying.gif"),
    "figures.figure_of_assembly": lambda draw, made, _: draw(made.assembly, ids=True, values=True),
    "figures.figure_of_mechanism": lambda draw, made, _: draw(made.result)[0],
    "figures.figure_of_result": lambda draw, made, _: draw(made.result, ids=True, values=True),
    "figures.figure_of_layouts": lambda draw, made, _: draw([made.result] * 2, ["one", "other"]),
    "figures.save_figure": lambda draw, made, folder: draw(made.result.plot(), folder / "result.svg"),
    "field_figures.figure_of_fields": lambda draw, made, _: draw(*made.fields),
    "field_figures.figure_of_field_layouts": lambda draw, made, _: draw([made.fields], ["one"]),
    "moved_joints.figure_of_move": lambda draw, made, _: draw(
        made.plain, made.plain, made.plain.labels, made.vertices, 0.1 * made.vertices, ("before", "after")
    ),
    "moved_joints.figure_of_vertex_rates": lambda draw, made, _: draw(
        made.plain, made.plain.labels, made.vertices, made.vertices
    ),
    "path.figure_of_path": lambda draw, made, _: draw(made.plain, PATH),
    "settled_figure.figure_of_settled": lambda draw, made, _: draw(made.settled),
    "strip.figure_of_laying": lambda draw, made, _: draw(made.laying, "laying"),
    "strip.figure_of_stage": lambda draw, made, _: draw(made.laying, 2),
    "thrust_figure.figure_of_range": lambda draw, made, _: draw(made.ranges, made.ranges.ranges[0]),
}


def test_every_drawing_has_a_row() -> None:
    assert set(CALLS) == set(drawings())


@pytest.mark.parametrize("name", CALLS)
def test_drawing(name: str, made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jld_core.views.animation.FRAMES", 2)
    try:
        figure = CALLS[name](drawings()[name], made, tmp_path)
    except InputError:
        assert (name.partition(".")[0], made.assembly.dimension) == ("field_figures", 3)
        return
    if figure is None:
        assert [file.stat().st_size > 1000 for file in tmp_path.iterdir()] == [True]
        return
    assert isinstance(figure, Figure)
    figure.savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 1000


@pytest.mark.parametrize("dimension", [2, 3])
def test_pictures_of_a_laying_by_command(dimension: int, jld: Command, tmp_path: Path) -> None:
    document = tower(dimension)
    document.pop("members")
    (tmp_path / "scene.json").write_text(json.dumps(document))
    out = tmp_path / "out"
    done = jld("assembly", tmp_path / "scene.json", "-o", out, "--stages", "--animation")
    assert done.code == 0
    written = {file.name for file in out.iterdir()}
    assert {"assembly.csv", "assembly.png", "assembly.gif", "stage-1.png", "stage-3.png"} <= written
