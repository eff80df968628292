"""Maps: λ and mechanisms over values of a scene, as single solves give them; borders in closed form; bad input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from studies.scenes import stacked_cubes

import jld_core as jc
import jld_explore as je
from cases import grid_document
from command import ROOT, Command
from jld_maps import borders

ARCH = ROOT / "scenes" / "flat_beam_arch.json"
MU, TAU = "materials.dry.friction_coefficient", "materials.inner.shear_strength"
NAMES = ("sliding at the base", "inner shear", "inner opening", "rocking")


@pytest.mark.parametrize("tension", [0.0, 1.0])
def test_two_cubes_have_the_mechanisms_and_borders_of_figure_4(tension: float) -> None:
    """λ = min(μ, τA/W, (1 + σtA/W)/3, 1/2); a border is where two of them are equal."""

    def forms(mu: Any, tau: Any) -> Any:
        return np.stack(np.broadcast_arrays(mu, tau, (1.0 + tension) / 3.0, 0.5))

    grid = {MU: np.linspace(0.02, 0.9, 5).tolist(), TAU: np.linspace(0.03, 0.93, 6).tolist()}
    scene = stacked_cubes(2, friction=0.5, tension=tension, shear=0.5)
    table = je.sweep(scene, grid)
    values = forms(table[MU].to_numpy(), table[TAU].to_numpy())
    assert table["load_factor"].to_numpy() == pytest.approx(values.min(axis=0), rel=1e-6)
    assert table["proven"].all()
    alone = np.sort(values, axis=0)[1] - values.min(axis=0) > 1e-6
    assert (table["mechanism"][alone] == np.array(NAMES)[values.argmin(axis=0)][alone]).all()
    assert {NAMES[2 if tension == 0.0 else 3], *NAMES[:2]} <= set(table["mechanism"])
    found = borders(scene, grid, table)
    assert len(found) > 6
    least = np.sort(forms(found[MU].to_numpy(dtype=float), found[TAU].to_numpy(dtype=float)), axis=0)
    assert least[1] - least[0] == pytest.approx(np.zeros(len(found)), abs=1e-6)


def test_borders_over_a_key_on_which_strengths_do_not_depend_linearly() -> None:
    """tan φ = τA/W where sliding and shear meet."""
    scene = stacked_cubes(2, friction=0.5, tension=1.0, shear=0.5)
    grid = {"materials.dry.friction_angle": [5.0, 15.0, 25.0], TAU: [0.1, 0.2, 0.3]}
    found = borders(scene, grid, je.sweep(scene, grid))
    assert set(found["along"]) == set(grid)
    slopes = np.tan(np.radians(found["materials.dry.friction_angle"].to_numpy(dtype=float)))
    assert slopes == pytest.approx(found[TAU].to_numpy(dtype=float), abs=1e-4)


def test_borders_stay_within_a_map_that_begins_where_values_end() -> None:
    """Shear strength and friction from 0 on, where the next value outside is refused."""
    scene, grid = stacked_cubes(2, friction=0.5, tension=0.0, shear=0.5), {MU: [0.0, 0.1, 0.2], TAU: [0.0, 0.15, 0.3]}
    found = borders(scene, grid, je.sweep(scene, grid))
    assert len(found)
    assert (found[[MU, TAU]].to_numpy(dtype=float) >= 0.0).all()
    assert np.isfinite(found["load_factor"].to_numpy(dtype=float)).all()


WALL = grid_document(["abba", "accb", "####"], tension=3e3, shear=3e3)
CASES = {
    **WALL,
    "loads": {
        "cases": [
            {"name": "x", "live": [{"body": [1, 0]}]},
            {"name": "y", "live": [{"body": [-1, 0.2]}], "required": 0.5},
        ]
    },
}
CUBE = {
    "name": "cubes", "materials": WALL["materials"], "loads": {"live": [{"body": [1, 0.5, 0]}]},
    "labels": {"inner": [["a", "b"]]},
    "elements": [jc.samples.box("a", (0, 0, 0), (0.3, 0.2, 0.2)), jc.samples.box("b", (0, 0, 0.2), (0.3, 0.2, 0.4)),
                 jc.samples.box("g", (0, 0, -0.1), (0.3, 0.2, 0.0), support=True)],
}  # fmt: skip


@pytest.mark.parametrize(
    ("document", "grid"),
    [
        (WALL, {"materials.dry.friction_angle": [10.0, 30.0, 60.0], "materials.density": [800.0, 1e3, "2400 kg/m³"]}),
        (WALL, {"loads.angle": [0.0, 40.0, 180.0], "loads.live[0].body[0]": [0.5, 1.0]}),
        (WALL, {"materials.inner.tensile_strength": [0.0, 1e3], "materials.inner.friction_coefficient": [0.0, 0.4]}),
        (WALL, {"materials.dry.cohesion": [0.0, 2e3], "grid.cell[1]": [0.1, 0.12]}),
        (CASES, {MU: [0.2, 0.7], "loads.cases[1].required": [0.5, 2.0]}),
        (CASES, {MU: [0.2, 0.7], TAU: ["0 kPa", "4 kPa"]}),
        (CUBE, {MU: [0.2, 0.7], TAU: [100.0, 1e4]}),
    ],
)
def test_each_point_is_as_a_scene_solved_alone(document: dict[str, Any], grid: dict[str, Any]) -> None:
    table = je.sweep(document, grid)
    assert len(table) == np.prod([len(one) for one in grid.values()])
    for row in table.to_dict("records"):
        changed = json.loads(json.dumps(document))
        for key, value in row.items():
            if key in grid and key != "loads.angle":
                place = changed
                *way, last = key.replace("[", ".").replace("]", "").split(".")
                for part in way:
                    place = place[int(part)] if part.isdigit() else place[part]
                place[int(last) if last.isdigit() else last] = value
                if last == "friction_angle":
                    del place["friction_coefficient"]
        if "loads.angle" in grid:
            x, angle = row["loads.live[0].body[0]"], np.radians(row["loads.angle"])
            changed["loads"]["live"] = [{"body": [x * np.cos(angle), x * np.sin(angle)]}]
        alone = jc.solve(changed)
        assert row["status"] == str(alone.status)
        assert row["load_factor"] == pytest.approx(alone.load_factor, rel=3e-6, abs=1e-9, nan_ok=True)
        structure = jc.build_assembly(changed)
        whole = jc.solve(structure, structure.labels & ~structure.free_faces).bracket[1]
        assert row["uncut"] == pytest.approx(whole, rel=3e-6, abs=1e-9, nan_ok=True)


def test_geometry_by_a_function_and_fields() -> None:
    def block(height: float) -> dict[str, Any]:
        return {**grid_document(["a", "#"]), "grid": {"cell": [0.1, height], "thickness": 0.1, "rows": ["a", "#"]}}

    table = je.sweep(block, {"height": [0.2, 0.4]}, fields=True, seconds=0.3)
    assert table["load_factor"].to_numpy() == pytest.approx([0.5, 0.25], rel=1e-6)
    as_dict = je.sweep(lambda point: block(point["height"]), {"height": [0.2, 0.4]})
    assert as_dict["load_factor"].to_numpy() == pytest.approx([0.5, 0.25], rel=1e-6)
    assert list(table["mechanism"]) == ["rocking", "rocking"]
    assert (table["fields_lo"] <= table["load_factor"] * (1 + 1e-6)).all()


@pytest.mark.usefixtures("without_field_check", "without_pictures")
def test_the_strongest_layout_changes_with_friction() -> None:
    scene = grid_document(["aa", "aa", "##"], tension=1e3, shear=1e3, block_cells=[1, 2])
    table = je.sweep(scene, {MU: [0.2, 0.9]}, explore=True)
    assert table["proven"].all()
    row = table.iloc[1]
    scene["materials"]["dry"]["friction_coefficient"] = row[MU]
    best = je.explore(scene, pictures=False).summary
    assert (row["load_factor"], row["labelling"]) == (pytest.approx(best.best), best.best_labelling)


@pytest.mark.parametrize("value", [{"nominal": 0.6, "low": 0.5}, {"mean": 0.6, "cov": 0.1, "kind": "normal"}])
def test_a_number_takes_the_place_of_a_value_with_uncertainty(value: dict[str, Any]) -> None:
    scene = grid_document(["aa", "aa", "##"], tension=1e3, shear=1e3)
    plain = je.sweep(scene, {MU: [0.2, 0.9]})["load_factor"]
    scene["materials"]["dry"] = {"friction_coefficient": value}
    assert je.sweep(scene, {MU: [0.2, 0.9]})["load_factor"].tolist() == plain.tolist()


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ("materials.inner.sher_strength=0:1:3", "materials.inner.sher_strength: unknown key"),
        ("materials.dry.friction_angle=0:40:2000000", "--over: it asks for 2000000 points; expected at most 1000000"),
        ("materials.dry=0:1:3", "materials.dry: it is no number"),
        ("loads.live[7].force[0]=0:1:3", "there is no 7 in loads.live; expected an entry from 0 to 2"),
        ("source=0:1:3", "source: it is no number that λ depends on"),
        ("materials.dry.friction_angle=0:1", "--over: 'materials.dry.friction_angle=0:1' is no range of values"),
        ("materials.dry.friction_angle=1 kN:2 kPa:3", "is no range of values"),
        ("search.block_cells[1]=4:6:2", "search.block_cells[1]: λ of one layout does not depend on it"),
    ],
)
def test_what_cannot_be_mapped_is_refused_in_one_line(jld: Command, tmp_path: Path, over: str, words: str) -> None:
    jld("map", ARCH, "--over", over, "-o", tmp_path / "out").refused(words)
    assert not (tmp_path / "out").exists()


def test_the_command_writes_table_borders_and_picture(jld: Command, tmp_path: Path) -> None:
    over = ("--over", f"{MU}=0.1:0.9:9", "--over", f"{TAU}=20 kPa:200 kPa:4")
    found = jld("map", ARCH, *over, "-o", tmp_path, "--json").done()
    told, table = json.loads(found.out), pd.read_csv(tmp_path / "map.csv")
    assert (told["points"], told["proven"], len(table)) == (36, 36, 36)
    assert table[TAU].max() == pytest.approx(2e5)
    assert sum(told["regions"].values()) == 36
    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert list(pd.read_csv(tmp_path / "borders.csv").columns) == [MU, TAU, "along", "one", "other", "load_factor"]


def test_a_key_of_one_value_has_no_axis(jld: Command, tmp_path: Path) -> None:
    over = ("--over", "materials.density=1400:1400:1", "--over", f"{MU}=0.2:0.8:3", "--over", f"{TAU}=2e4:2e5:2")
    jld("map", ARCH, *over, "-o", tmp_path).done()
    assert len(pd.read_csv(tmp_path / "map.csv")) == 6
    assert (tmp_path / "map.png").stat().st_size > 10_000
