"""Keyed and wavy joints: closed forms of climbing and breaking, the optimum between, and bad input."""

from __future__ import annotations

import csv
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command import Command
from jld_core import InputError, Scene, build_assembly, parse_scene, samples, solve
from jld_core.geometry_optimisation import shape_search
from jld_core.geometry_optimisation.joint_shapes import Key, Shape, Sine, shaped_scene
from jld_core.geometry_optimisation.shape_search import shape_joints
from jld_explore.cli import shaping

LENGTH, PRESS, FRICTION, THICK = 0.4, 4000.0, 0.4, 0.2


def two_blocks(tension: float = 2e5, shear: float = 4e5, place: float = 0.2) -> Scene:
    """A block on a longer one that stays, under 4 kN at a place and pushed just above the joint."""
    outlines = {
        "ground": [[-0.5, -0.3], [0.9, -0.3], [0.9, -0.2], [-0.5, -0.2]],
        "low": [[-0.4, -0.2], [0.8, -0.2], [0.8, 0.0], [-0.4, 0.0]],
        "up": [[0.0, 0.0], [LENGTH, 0.0], [LENGTH, 0.2], [0.0, 0.2]],
    }
    document: dict[str, Any] = {
        "thickness": THICK,
        "elements": [{"id": name, "polygon": one, "support": name == "ground"} for name, one in outlines.items()],
        "materials": {
            "density": 0.0,
            "dry": {"friction_coefficient": FRICTION},
            "inner": {"tensile_strength": tension, "shear_strength": shear},
        },
        "labels": {"inner": [["ground", "low"]]},
        "loads": {
            "dead": [{"element": "up", "force": [0.0, -PRESS], "at": [place, 0.1]}],
            "live": [{"element": "up", "force": [1.0, 0.0], "at": [0.0, 0.02]}],
        },
    }
    return parse_scene(document)


def load_with(shape: Shape, **strengths: float) -> float:
    scene = two_blocks(**strengths)
    assembly = build_assembly(scene)
    return solve(shaped_scene(scene, assembly, assembly.labels, shape)).load_factor


@pytest.mark.parametrize("slope", [0.4, 0.8])
def test_a_strong_key_is_climbed(slope: float) -> None:
    """The block slides up the flank: λ = N tan(φ + α), tan α the slope of the flank, as up an incline.

    The resultant of both forces passes through the middle of the flank, so that the block does not rock.
    """
    depth, width = 0.02, 0.5
    expected = PRESS * (FRICTION + slope) / (1.0 - FRICTION * slope)
    middle = LENGTH * np.array([0.5 * (1.0 - width) + 0.5 * depth / slope, 0.5 * depth])
    place = float(middle[0] - expected * (0.02 - middle[1]) / PRESS)
    key = Key(depth, width, depth / slope)
    assert load_with(key, tension=1e9, shear=1e9, place=place) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("depth", [0.05, 0.1, 0.2])
def test_a_key_breaks_at_its_root_at_the_latest(depth: float) -> None:
    """The root sheared while the block slides with dilation: λ ≤ μ N + (τ + μ σt) w t, an upper bound by mechanism."""
    width, tension, shear = 0.2, 2e5, 4e5
    most = FRICTION * PRESS + (shear + FRICTION * tension) * width * LENGTH * THICK
    found = load_with(Key(depth, width, 0.01), tension=tension, shear=shear)
    assert FRICTION * PRESS < found <= most * (1.0 + 1e-9)


def test_climbing_at_small_depth_breaking_at_large() -> None:
    """Between both lies an optimum, as for locks in Mousavian, Bagi and Casapulla (2022): a trend, no value."""
    values = [load_with(Key(depth, 0.35, 0.05)) for depth in (0.0125, 0.025, 0.05, 0.1, 0.2)]
    best = int(np.argmax(values))
    assert 0 < best < len(values) - 1
    assert all(a < b for a, b in itertools.pairwise(values[: best + 1]))
    assert all(a > b for a, b in itertools.pairwise(values[best:]))


def test_waves_gain_with_their_amplitude() -> None:
    """Steeper waves are climbed later, and the best is no more than the whole joint sheared: τ l t."""
    flat = FRICTION * PRESS
    values = [load_with(Sine(amplitude, 2)) for amplitude in (0.0125, 0.025, 0.05, 0.1)]
    assert flat < values[0]
    assert all(a < b for a, b in itertools.pairwise(values))
    steepest = 2 * np.pi * 2 * 0.0125
    assert values[0] <= PRESS * (FRICTION + steepest) / (1.0 - FRICTION * steepest)


def test_teeth_belong_to_their_blocks() -> None:
    scene = two_blocks()
    assembly = build_assembly(scene)
    shaped = build_assembly(shaped_scene(scene, assembly, assembly.labels, Key(0.1, 0.4, 0.05)))
    # a tooth and two shoulders more than the three elements; the roots of all of them may crack
    assert len(shaped.elements) == 6
    assert int((~shaped.labels).sum()) == 1 + 3
    free = ~shaped.elements.support
    assert shaped.elements.volume[free].sum() == pytest.approx(
        assembly.elements.volume[~assembly.elements.support].sum()
    )


def test_a_search_finds_a_better_key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shape_search, "_LAST", 0.3)  # a coarse search, for time
    scene = two_blocks()
    assembly = build_assembly(scene)
    done = shape_joints(scene, assembly, assembly.labels, Key(0.025, 0.35, 0.05))
    values = [value for _, value in done.trials]
    assert done.after.load_factor == pytest.approx(np.nanmax(values), rel=1e-6)
    assert done.after.load_factor > 1.5 * values[0]


def test_the_command(tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    file, out = tmp_path / "key.json", tmp_path / "out.json"
    monkeypatch.setattr(shaping, "_GAP", 0.9)  # reached on a coarse mesh
    monkeypatch.setattr(shaping, "_SECONDS", 60.0)
    file.write_text(two_blocks().model_dump_json(exclude_defaults=True))
    done = jld("move", file, "-o", out, "--joint", "sine:0.05,1", "--seconds", "0", "--json")
    assert done.code == 0
    facts = json.loads(done.out)
    assert facts["joint"] == {"kind": "sine", "amplitude": 0.05, "waves": 1}
    assert facts["end"] == "time"
    assert facts["fields"]["after"] > facts["fields"]["before"]
    assert solve(parse_scene(json.loads(out.read_text()))).load_factor == pytest.approx(facts["load_factor"], rel=1e-9)
    with out.with_suffix(".csv").open() as table:
        assert [float(row["load_factor"]) for row in csv.DictReader(table)] == pytest.approx([facts["load_factor"]])


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ("key:0.1", "--joint: 'key:0.1' is no shape"),
        ("sine:0.1,1.5", "is no shape"),
        ("key:0.1,0.2,0.3", "are no key"),
        ("sine:-1,2", "is no sine wave"),
        ("sine:2,1", "does not fit"),
    ],
)
def test_bad_shapes(tmp_path: Path, jld: Command, shape: str, said: str) -> None:
    file, out = tmp_path / "key.json", tmp_path / "out.json"
    file.write_text(two_blocks().model_dump_json(exclude_defaults=True))
    done = jld("move", file, "-o", out, "--joint", shape)
    assert done.code == 2
    assert said in done.err
    assert done.err.count("\n") == 1
    assert not out.exists()


def test_space_has_no_shapes() -> None:
    scene = samples.KINDS["vault"]()
    assembly = build_assembly(scene)
    with pytest.raises(InputError, match="joints in space have no shape"):
        shaped_scene(scene, assembly, assembly.labels, Sine(0.1, 1))
