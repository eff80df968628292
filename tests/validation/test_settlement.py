"""Supports that move: thrusts against closed forms, planar and spatial, and what is said of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies.families import semicircular_arch

from cases_spatial import box
from command import Command
from jld_core import Scene, build_assembly, parse_scene
from jld_core.build.loads import settlements_of
from jld_core.limit import Settled
from jld_core.scene import Scene
from jld_practice.reactions import Settled
from jld_practice.reactions.force_range import reactions, settle

SPREAD = {
    "name": "spread",
    "supports": [{"elements": "left", "move": [-0.5, 0]}, {"elements": "right", "move": [0.5, 0]}],
}


def wedge(alpha: float, mu: float, spatial: bool = False, scale: float = 1.0, force: str = "N") -> Scene:
    """A keystone between two abutments whose faces lean by alpha from the vertical; they give way by a half each."""
    t, unit = np.tan(np.radians(alpha)) * scale, scale
    outlines = {
        "left": [[-3 * unit, 0], [-unit, 0], [-unit - t, unit], [-3 * unit, unit]],
        "key": [[-unit, 0], [unit, 0], [unit + t, unit], [-unit - t, unit]],
        "right": [[unit, 0], [3 * unit, 0], [3 * unit, unit], [unit + t, unit]],
    }
    elements: list[dict[str, Any]] = []
    for name, outline in outlines.items():
        if spatial:
            low = [[x, 0.0, z] for x, z in outline]
            high = [[x, 0.5 * unit, z] for x, z in outline]
            faces = [[0, 1, 2, 3], [7, 6, 5, 4], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]]
            form: dict[str, Any] = {"vertices": low + high, "faces": faces}
        else:
            form = {"polygon": outline}
        elements.append({"id": name, **form, "weight": 1.0, "support": name != "key"})
    moves = [[-0.5, 0, 0], [0.5, 0, 0]] if spatial else [[-0.5, 0], [0.5, 0]]
    return parse_scene(
        {
            "name": "wedge",
            "units": {"force": force},
            "elements": elements,
            "materials": {"dry": {"friction_coefficient": mu}},
            "loads": {"live": [{"element": "key", "force": [0, 0, -1] if spatial else [0, -1]}]},
            "settlements": [
                {
                    "name": "spread",
                    "supports": [
                        {"elements": "left", "move": moves[0]},
                        {"elements": ["right"], "move": moves[1]},
                    ],
                }
            ],
        }
    )


def settled(scene: Scene, which: int = 0) -> Settled:
    assembly = build_assembly(scene)
    return settle(assembly, settlements_of(scene, assembly)[which])


@pytest.mark.parametrize("spatial", [False, True], ids=["planar", "spatial"])
@pytest.mark.parametrize("mu", [0.1, 0.3])
def test_a_keystone_between_abutments(mu: float, spatial: bool) -> None:
    """Statics of a wedge: each side carries W/2 at the angle of friction to its normal, H = W/2 cot(α ± φ)."""
    alpha, phi = np.radians(25.0), np.arctan(mu)
    found = settled(wedge(25.0, mu, spatial))
    assert found.stands
    assert found.least is not None
    assert found.most is not None
    for end, angle in ((found.least, alpha + phi), (found.most, alpha - phi)):
        assert end.status == "certified"
        assert end.value == pytest.approx(0.5 / np.tan(angle), rel=1e-6)
        assert end.bracket[0] <= end.value <= end.bracket[1]
        assert end.state is not None
        assert end.state.forces is not None
        # what the abutments feel is that thrust, and half the weight each
        push = reactions(found.assembly, end.state.forces, np.array([0, 2]))
        up = 2 if spatial else 1
        assert push[:, 0] == pytest.approx([-end.value, end.value], rel=1e-5)
        assert push[:, up] == pytest.approx([-0.5, -0.5], rel=1e-5)
    # the key sinks with the abutments by the rule of friction without another choice: flow at the angle φ
    assert found.least.state is not None
    assert found.least.state.mechanism is not None
    sinks = found.least.state.mechanism[1, 2 if spatial else 1]
    assert sinks == pytest.approx(-0.5 / np.tan(alpha + phi), rel=1e-5)


def test_a_keystone_that_cannot_be_pushed_out_has_no_greatest_thrust() -> None:
    """Friction above the lean of the faces: the wedge jams (α < φ)."""
    found = settled(wedge(10.0, 0.5))
    assert found.most is not None
    assert found.least is not None
    assert found.most.status == "unbounded"
    assert found.most.to_json()["reaction"] is None
    assert found.least.value == pytest.approx(0.5 / np.tan(np.radians(10.0) + np.arctan(0.5)), rel=1e-6)


def test_units_make_no_difference() -> None:
    one, other = settled(wedge(25.0, 0.3)), settled(wedge(25.0, 0.3, scale=1000.0, force="MN"))
    assert one.least is not None
    assert other.least is not None
    assert other.least.value == pytest.approx(one.least.value, rel=1e-9)
    # nor does the size of the movement, per unit of which the work is
    document = wedge(25.0, 0.3).model_dump(mode="json", exclude_defaults=True)
    for size in (1e-12, 1e12):
        for part, way in zip(document["settlements"][0]["supports"], (-0.5, 0.5), strict=True):
            part["move"] = [way * size, 0.0]
        sized = settled(parse_scene(document)).least
        assert sized is not None
        assert sized.status == "certified"
        assert sized.value == pytest.approx(size * one.least.value, rel=1e-9)
        assert sized.state is not None
        assert one.least.state is not None
        assert np.allclose(sized.state.mechanism / size, one.least.state.mechanism, atol=1e-6)


def arch(count: int, thickness: float, settlement: dict[str, Any] = SPREAD) -> Scene:
    document = semicircular_arch(count, thickness, 0.9, [{"element": "v0", "force": [0, -1]}]).model_dump(
        mode="json", exclude_defaults=True
    )
    return parse_scene({**document, "settlements": [settlement]})


def thrust(thickness: float, count: int, sign: float) -> Any:
    """Thrusts over the weight of half the ring, R = 1, for hinges at every pair of joints of one half.

    Moments of the part of the ring between two hinges about the lower one, with weight along the centreline, the part
    above pressing with its weight on the upper one (Heyman 1969, The safety of masonry arches). sign 1: the upper hinge
    at the extrados and the lower at the intrados, else the other way round. NaN where the upper is no higher.
    """
    joints = np.pi / count * np.arange(count // 2 + 1)
    upper, lower = np.meshgrid(joints, joints, indexing="ij")
    above, below = 1.0 + sign * thickness / 2.0, 1.0 - sign * thickness / 2.0
    x1, y1 = above * np.sin(upper), above * np.cos(upper)
    x2, y2 = below * np.sin(lower), below * np.cos(lower)
    moment = x2 * (lower - upper) - (np.cos(upper) - np.cos(lower)) + upper * (x2 - x1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((lower > upper) & (y1 > y2), moment / (y1 - y2) / (np.pi / 2.0), np.nan)


@pytest.mark.parametrize("thickness", [0.12, 0.2])
def test_a_semicircular_arch_on_abutments_that_move(thickness: float) -> None:
    """The least thrust is the largest of the closed form over all pairs of joints, the greatest the least of it with
    the hinges on the other sides."""
    count = 36
    found = settled(arch(count, thickness))
    half = 0.5 * found.assembly.total_dead
    assert found.least is not None
    assert found.most is not None
    assert found.least.value / half == pytest.approx(float(np.nanmax(thrust(thickness, count, 1.0))), rel=1e-7)
    assert found.most.value / half == pytest.approx(float(np.nanmin(thrust(thickness, count, -1.0))), rel=1e-7)
    assert found.least.value < found.most.value


def test_one_abutment_that_sinks_and_tilts() -> None:
    """Work is linear: the range of a movement twice as large is twice as large; a turn about its springing is one."""
    sinks = {"name": "sinks", "supports": [{"elements": "left", "move": [0, -1], "turn": 0.2, "about": [-1, 0]}]}
    twice = {"name": "sinks", "supports": [{"elements": "left", "move": [0, -2], "turn": 0.4, "about": [-1, 0]}]}
    one, two = settled(arch(16, 0.2, sinks)), settled(arch(16, 0.2, twice))
    for end, other in ((one.least, two.least), (one.most, two.most)):
        assert end is not None
        assert other is not None
        assert end.status == other.status == "certified"
        assert other.value == pytest.approx(2.0 * end.value, rel=1e-7)


def test_a_structure_that_falls_has_no_range_of_thrust() -> None:
    found = settled(arch(16, 0.05))
    assert found.stands is False
    assert found.least is None
    assert found.to_json()["most"] is None


def test_the_command(tmp_path: Path, jld: Command) -> None:
    file, out = tmp_path / "arch.json", tmp_path / "out"
    file.write_text(arch(12, 0.2).model_dump_json(exclude_defaults=True))
    done = jld("settlement", file, "--out", out, "--json")
    assert (done.code, done.err) == (0, "")
    told = json.loads(done.out)
    assert told == json.loads((out / "settlement.json").read_text())
    (one,) = told["settlements"]
    assert one["least"]["status"] == "certified"
    assert one["least"]["bracket"][0] <= one["least"]["reaction"] <= one["most"]["reaction"]
    assert one["supports"] == {"left": [-0.5, 0.0, 0.0], "right": [0.5, 0.0, 0.0]}
    assert len(list(out.glob("*.png"))) == 1
    assert "least reaction" in jld("settlement", file).out


@pytest.mark.parametrize(
    ("settlement", "words"),
    [
        ({"supports": []}, "settlements[0].name: missing"),
        ({"name": "a", "supports": [{"elements": "x", "move": [1, 0]}]}, "no element is named 'x'"),
        ({"name": "a", "supports": [{"elements": "v1", "move": [1, 0]}]}, "'v1' is no support"),
        ({"name": "a", "supports": [{"elements": "left", "move": [1, 0, 0]}]}, "move: it has 3 numbers; expected 2"),
        ({"name": "a", "supports": [{"elements": "left"}]}, "settlements[0]: nothing moves"),
        ({"name": "a", "supports": [{"elements": 3, "move": [1, 0]}]}, "the id of a support"),
    ],
)
def test_bad_input(settlement: Any, words: str, tmp_path: Path, jld: Command) -> None:
    document = {**arch(6, 0.2).model_dump(mode="json", exclude_defaults=True), "settlements": [settlement]}
    file = tmp_path / "arch.json"
    file.write_text(json.dumps(document))
    done = jld("settlement", file)
    assert (done.code, done.out) == (2, "")
    assert done.err.count("\n") == 1
    assert words in done.err


def test_a_scene_without_settlements_is_refused(tmp_path: Path, jld: Command) -> None:
    file = tmp_path / "box.json"
    parts = [box("g", (0, 0, -1), (1, 1, 0), support=True), box("b", (0, 0, 0), (1, 1, 1))]
    materials = {"density": 2000, "dry": {"friction_coefficient": 0.6}}
    file.write_text(json.dumps({"elements": parts, "materials": materials, "loads": {"live": [{"body": [1, 0, 0]}]}}))
    done = jld("settlement", file)
    assert done.code == 2
    assert "the scene has none" in done.err
