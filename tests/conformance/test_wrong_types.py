"""Python at the door: whatever is given in place of an argument, it is taken or refused in one plain line."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jld_core
from cases import grid_document
from jld_core import InputError, Layout, Model, blocks_csv, build_assembly, load_scene, parse_scene, solve, solve_many
from jld_core.models import cost_estimate, sensitivities
from jld_core.refinement import refine
from jld_core.scene import cracks
from jld_experiment import Joints, Settings, run_experiment
from jld_explore import ExploreSettings, explore, read_folder, search_space
from jld_explore.cli import check
from jld_explore.drivers import make_driver
from jld_explore.space import count_named, from_string, to_string
from jld_formats import ImportOptions, export, import_file
from jld_practice.laying import assembly_order
from jld_samples import Stone, arch, buttress, corner, dome, flat_arch, grid, vault, wall

DOCUMENT = grid_document(["aa", "aa", "##"])

CSV = "id,x,y,support\na,0,0,1\na,1,0,1\na,1,1,1\na,0,1,1\nb,0,1,0\nb,1,1,0\nb,1,2,0\nb,0,2,0\n"

# None stands for "not given" where it is the default, and is refused elsewhere
WRONG: tuple[Any, ...] = (
    *(None, -3, 2.5, float("nan"), 10**30, "nonsense", b"bytes", True, 1 + 2j, object()),
    *([], [1, "a"], {"a": 1}, np.zeros(3), np.zeros((2, 2), object), Path("nowhere"), print),
)

# What is left out: arguments whose values are functions of the caller's own, and what takes minutes
LEFT_OUT = {("explore", "objective"), ("explore", "experiment"), ("import_file", "progress"), ("blocks_of", "joined")}

LIBRARIES = ("Error", "Traceback", "pydantic", "numpy", "shapely", " at 0x", "__")


@cache
def calls() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Functions by name, with arguments that are right."""
    scene = parse_scene(DOCUMENT)
    assembly = build_assembly(scene)
    space, result = search_space(scene, assembly), solve(assembly)

    def ask(limit: int | None) -> None:
        make_driver("random", space, 0).ask(limit)

    def tell(labellings: Any, evaluations: Any) -> None:
        make_driver("random", space, 0).tell(labellings, evaluations)

    rows, layout = assembly.labels[None], Layout(scene, assembly, assembly.labels)
    quick: dict[str, Any] = {"driver": "random", "budget": 1, "pictures": False, "seconds": 20.0}
    found: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
        "solve": (solve, {"structure": scene}),
        "solve_many": (solve_many, {"structure": scene, "labellings": rows}),
        "load_scene": (load_scene, {"path": DOCUMENT}),
        "parse_scene": (parse_scene, {"document": DOCUMENT}),
        "build_assembly": (build_assembly, {"scene": scene}),
        "blocks_of": (jld_core.blocks_of, {"assembly": assembly, "labels": assembly.labels}),
        "geometry_sensitivities": (jld_core.geometry_sensitivities, {"result": result}),
        "sensitivities": (sensitivities, {"result": result}),
        "explore": (explore, {"scene": scene, **quick}),
        "read_folder": (read_folder, {"folder": "out"}),
        "search_space": (search_space, {"scene": scene, "assembly": assembly}),
        "make_driver": (make_driver, {"name": "random", "space": space, "seed": 0}),
        "ask": (ask, {"limit": 3}),
        "tell": (tell, {"labellings": rows, "evaluations": solve_many(assembly, rows)}),
        "import_file": (import_file, {"path": "a.csv"}),
        "export": (export, {"layout": layout, "kind": "obj", "path": "a.obj"}),
        "blocks_csv": (blocks_csv, {"layout": layout}),
        "refine": (refine, {"scene": scene, "cell": (0.5, 0.5)}),
        "run_experiment": (run_experiment, {"assembly": assembly, "settings": Settings(periods=1.0)}),
        "assembly_order": (assembly_order, {"assembly": assembly, "labels": assembly.labels}),
        "check.require_memory": (check.require_memory, {"structure": assembly}),
        "cost_estimate": (cost_estimate, {"assembly": assembly}),
        "count_named": (count_named, {"name": "blocks"}),
        "from_string": (from_string, {"text": "did"}),
        "to_string": (to_string, {"labelling": assembly.labels}),
        "parse_cracks": (cracks.parse_cracks, {"text": "faces"}),
    }
    made = (Model, ExploreSettings, ImportOptions, Joints, Settings, Stone, arch, buttress, corner, dome, flat_arch)
    return found | {one.__name__: (one, {}) for one in (*made, grid, vault, wall)}


def arguments() -> Iterator[tuple[str, str]]:
    for name, (function, _) in calls().items():
        for one in inspect.signature(function).parameters.values():
            if one.kind not in (one.VAR_KEYWORD, one.VAR_POSITIONAL) and (name, one.name) not in LEFT_OUT:
                yield name, one.name


@pytest.mark.sampled(4)
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("part", [0, *(pytest.param(part, marks=pytest.mark.long) for part in (1, 2))])
@pytest.mark.parametrize(("name", "argument"), list(arguments()))
def test_a_wrong_value_is_one_line(
    name: str, argument: str, part: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A third of the values for each argument, others for the next one; `make bench` gives all to each."""
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text(CSV)
    function, right = calls()[name]
    first = (list(inspect.signature(function).parameters).index(argument) + part) % 3
    for wrong in WRONG[first::3]:
        try:
            function(**{**right, argument: wrong})
        except InputError as error:
            said = str(error)
            assert "\n" not in said, said
            assert not any(word in said for word in LIBRARIES), said


def test_arrays_tuples_and_texts_are_taken(tmp_path: Path) -> None:
    """Polygons as arrays and tuples, dicts for scenes, texts for folders."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    document: dict[str, Any] = {
        "elements": (
            {"id": "g", "polygon": square, "support": True},
            {"id": "b", "polygon": square + np.array([0.0, 1.0])},
            {"id": "c", "polygon": [tuple(corner) for corner in square + np.array([0.0, 2.0])]},
        ),
        "materials": {
            "density": np.float64(1.0),
            "dry": {"friction_coefficient": np.float32(0.5)},
            "inner": {"tensile_strength": 1, "shear_strength": 1},
        },
        "loads": {"live": ({"body": (1.0, 0.0)},)},
    }
    assert solve(document).load_factor == pytest.approx(0.5)
    assert solve(build_assembly(document)).load_factor == pytest.approx(0.5)
    found = explore(document, str(tmp_path / "out"), driver="anneal", chains=1, pictures=False)
    assert read_folder(str(tmp_path / "out")).summary.best == found.summary.best
    layout = Layout(parse_scene(document), build_assembly(document), build_assembly(document).labels)
    export(layout, "dxf", str(tmp_path / "a.dxf"))
    assert len(import_file(str(tmp_path / "a.dxf")).document["elements"]) == 3
