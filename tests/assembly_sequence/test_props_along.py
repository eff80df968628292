"""Props along a line: levers, arches, words, table and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from command import Command
from jld_core import Scene, build_assembly, parse_scene, samples
from jld_core.errors import ParameterError
from jld_core.scene.units import force_in_words
from jld_practice.laying import assembly_order
from jld_practice.laying.solids import stations_below
from jld_practice.laying.standing import Parts


def corbel(scale: float = 1.0, turn: float = 0.0) -> Scene:
    """Return a block of 1 × 0.2 that rests on a support along its first 0.3, scaled and turned about the origin."""
    matrix = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    shapes = {"block": [[0, 0], [1, 0], [1, 0.2], [0, 0.2]], "pier": [[0, -1], [0.3, -1], [0.3, 0], [0, 0]]}
    elements = [
        {"id": name, "polygon": (scale * np.array(shape) @ matrix).tolist(), "support": name == "pier"}
        for name, shape in shapes.items()
    ]
    materials = {
        "density": 2000,
        "gravity": (np.array([0.0, -9.81]) @ matrix).tolist(),
        "dry": {"friction_coefficient": 0.6},
    }
    load = {"element": "block", "force": [1, 0]}
    return parse_scene({"elements": elements, "thickness": 1.0, "materials": materials, "loads": {"live": [load]}})


@pytest.mark.parametrize(("scale", "turn"), [(1.0, 0.0), (2.5, 0.0), (1.0, 0.7)])
def test_a_corbel_is_held_by_its_lever(scale: float, turn: float) -> None:
    """Moments about the edge of the support at 0.3: F (0.9 − 0.3) = W (0.5 − 0.3) at the farthest of the places."""
    assembly = build_assembly(corbel(scale, turn))
    stations = stations_below(assembly, 0.4 * scale)
    across = np.array([np.cos(turn), np.sin(turn)])
    # the place at 0.1 is above the support
    assert stations.points @ across == pytest.approx([0.5 * scale, 0.9 * scale], rel=1e-9)
    step = assembly_order(assembly, assembly.labels, parts=Parts(assembly, stations)).steps[0]
    weight = 2000 * 9.81 * 0.2 * scale**2
    assert step.stage.along == pytest.approx([0.0, weight / 3.0], rel=1e-6, abs=1e-6 * weight)
    assert step.stage.elsewhere == pytest.approx(0.0, abs=1e-6 * weight)


def test_each_stage_of_a_loaded_corbel_is_held_by_its_lever() -> None:
    """A block on the free end is laid second: F (0.9 − 0.3) = W₁ (0.5 − 0.3), then + W₂ (0.8 − 0.3)."""
    document = corbel().model_dump(mode="json", exclude_defaults=True)
    document["elements"].append({"id": "top", "polygon": [[0.6, 0.2], [1.0, 0.2], [1.0, 0.5], [0.6, 0.5]]})
    assembly = build_assembly(parse_scene(document))
    dry = np.ones(len(assembly.interfaces), dtype=bool)
    steps = assembly_order(assembly, dry, parts=Parts(assembly, stations_below(assembly, 0.4))).steps
    first, second = 2000 * 9.81 * 0.2, 2000 * 9.81 * 0.4 * 0.3
    levers = [first * 0.2 / 0.6, (first * 0.2 + second * 0.5) / 0.6]
    assert [float(step.stage.along.sum()) for step in steps] == pytest.approx(levers, rel=1e-6)
    assert all(step.stage.along[0] <= 1e-6 * first for step in steps)


@pytest.mark.parametrize("spacing", [0.125, 0.25])
def test_the_first_half_of_a_beam_is_held_by_its_lever(spacing: float) -> None:
    """Halves of 0.75 meet over piers 0.25 wide: the first turns about its pier's edge, F · lever = W (0.375 − 0.25)."""
    boxes = {
        "left": (0.0, 0.75, 0.0, 0.2),
        "right": (0.75, 1.5, 0.0, 0.2),
        "west": (0.0, 0.25, -1.0, 0.0),
        "east": (1.25, 1.5, -1.0, 0.0),
    }
    elements = [
        {"id": name, "polygon": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], "support": name in ("west", "east")}
        for name, (x0, x1, y0, y1) in boxes.items()
    ]
    document = corbel().model_dump(mode="json", exclude_defaults=True) | {"elements": elements}
    document["loads"] = {"live": [{"element": "left", "force": [1, 0]}]}
    assembly = build_assembly(parse_scene(document))
    stations = stations_below(assembly, spacing)
    dry = np.ones(len(assembly.interfaces), dtype=bool)
    step = assembly_order(assembly, dry, parts=Parts(assembly, stations)).steps[0]
    weight = 2000 * 9.81 * 0.75 * 0.2
    places = stations.points[:, 0]
    lever = places[places <= 0.75].max() - 0.25
    assert lever == pytest.approx(1.25 - places[places >= 0.75].min(), rel=1e-9)
    assert float(step.stage.along.sum()) == pytest.approx(weight * 0.125 / lever, rel=1e-6)


def test_props_that_do_not_suffice_are_reported(jld: Command, tmp_path: Path) -> None:
    """One place below the crown holds no haunch before the keystone is laid: the rest stands beside it."""
    file = tmp_path / "arch.json"
    file.write_text(samples.arch(voussoirs=7).model_dump_json(exclude_defaults=True))
    done = jld("assembly", file, "--start", "springings", "--props", "100")
    assert done.code == 0, done.err
    assert "props along  1 place," in done.out
    assert "the places alone do not hold it" in done.out


def test_an_arch_on_a_line_of_props(jld: Command, tmp_path: Path) -> None:
    """Words, table and picture of an arch laid from both springings, which may be struck once it is closed."""
    file, out = tmp_path / "arch.json", tmp_path / "out"
    file.write_text(samples.arch(voussoirs=7).model_dump_json(exclude_defaults=True))
    done = jld("assembly", file, "--start", "springings", "--props", "0.2", "--out", out, "--stages")
    assert done.code == 0, done.err
    assert "props along" in done.out
    assert "it may be struck after step 7" in done.out
    table = pd.read_csv(out / "assembly.csv")
    for row in table.itertuples():
        parts = row.props_along.split() if isinstance(row.props_along, str) else []
        assert sum(float(part.split(":")[1]) for part in parts) == pytest.approx(row.props_N, rel=1e-3, abs=1e-6)
    assert (out / "stage-7.png").exists()


@pytest.mark.parametrize(
    ("spacing", "said"),
    [(0.0, "a spacing of 0 is wrong"), (float("nan"), "is wrong"), (1e-4, "at most 500 places")],
)
def test_bad_spacings_are_one_line(spacing: float, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        stations_below(build_assembly(corbel()), spacing)


def test_props_along_a_line_are_planar() -> None:
    with pytest.raises(ParameterError, match="planar"):
        stations_below(build_assembly(samples.vault()), 0.2)


def test_a_wall_on_its_footing_has_no_underside() -> None:
    """No shorter spacing would help: the line says so, and what to do."""
    with pytest.raises(ParameterError, match="stands on supports along its whole length"):
        stations_below(build_assembly(samples.wall(opening="1.0,0.4,0.6,0.4")), 0.1)


def test_forces_in_words_have_no_exponent() -> None:
    assert force_in_words(60241.0, "N") == "60.24 kN"
    assert force_in_words(999.5, "N") == "999.5 N"
    assert force_in_words(6e4, "apples") == "6e+04 apples"
