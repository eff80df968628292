"""Ranges of reactions against statics, an independent linear program, and published thrusts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog
from studies.families import semicircular_arch

from cases import ROUTE, as_elements, box, rotated
from command import Command, saved
from jld_core import InputError, Scene, build_assembly, parse_scene
from jld_core.build import loads
from jld_practice.reactions import (
    Settled,
    reactions,
    reactions_of_supports,
    resultant_of_joint,
    resultant_of_section,
    settle,
    thrust_ranges,
)
from jld_samples import arch


def ranges(scene: Scene, **options: Any) -> dict[tuple[str, str], Any]:
    found = thrust_ranges(build_assembly(scene), **options)
    assert found.stands
    return {(one.resultant.place, one.resultant.component): one for one in found.ranges}


def ends(one: Any) -> tuple[float, float]:
    assert one.least.status == one.most.status == "certified"
    return one.least.value, one.most.value


def wedge(degrees: float, friction: float) -> Scene:
    """A keystone of weight 1 between two fixed abutments whose faces lean by an angle from the vertical."""
    t = np.tan(np.radians(degrees))
    outlines = {
        "left": [[-3, 0], [-1, 0], [-1 - t, 1], [-3, 1]],
        "key": [[-1, 0], [1, 0], [1 + t, 1], [-1 - t, 1]],
        "right": [[1, 0], [3, 0], [3, 1], [1 + t, 1]],
    }
    return parse_scene(
        {
            "name": "keystone",
            "elements": [
                {"id": name, "polygon": outline, "weight": 1.0, "support": name != "key"}
                for name, outline in outlines.items()
            ],
            "materials": {"dry": {"friction_coefficient": friction}},
            "loads": {"live": [{"element": "key", "force": [0, -1]}]},
        }
    )


@pytest.mark.parametrize("load", [0.0, 2.0])
def test_a_keystone_presses_within_the_cone_of_friction(load: float) -> None:
    """Statics: each side carries (W + λP)/2 at the angle of friction to its normal, H = (W + λP)/2 cot(α ± φ)."""
    alpha, phi = np.radians(25.0), np.arctan(0.2)
    found = ranges(wedge(25.0, 0.2), load_factor=load)
    half = 0.5 * (1.0 + load)
    least, most = ends(found["support left", "Fx"])
    assert (least, most) == pytest.approx((half / np.tan(alpha + phi), half / np.tan(alpha - phi)), rel=1e-6)
    assert ends(found["support right", "Fx"]) == pytest.approx((-most, -least), rel=1e-6)
    # the two sides may carry unequal shares as long as moments and horizontals balance: their sum is the load
    low, high = ends(found["support left", "Fy"])
    assert low == pytest.approx(1.0 + load - high, rel=1e-6)


def test_a_jammed_keystone_has_no_greatest_thrust() -> None:
    """Friction above the lean of the faces (α < φ): self-stress may grow without end."""
    one = ranges(wedge(10.0, 0.5))["support left", "Fx"]
    assert one.most.status == "unbounded"
    assert one.interval[1] is None
    assert one.least.value == pytest.approx(0.5 / np.tan(np.radians(10.0) + np.arctan(0.5)), rel=1e-6)


def by_linear_program(scene: Scene, weights: Any) -> tuple[float, float]:
    """Both ends by HiGHS, with rows written here: three-hinge statics of a planar dry structure."""
    assembly = build_assembly(scene)
    faces, elements = assembly.interfaces, assembly.elements
    count = len(faces)
    rows = np.zeros((3 * len(elements), 3 * count))
    for k in range(count):
        n, t = faces.normal[k], faces.e1[k]
        for element, sign in ((faces.a[k], -1.0), (faces.b[k], 1.0)):
            arm = faces.origin[k] - elements.centroid[element]
            for j, way in enumerate((n, t)):
                rows[3 * element : 3 * element + 2, 3 * k + j] = sign * way
                rows[3 * element + 2, 3 * k + j] = sign * (arm[0] * way[1] - arm[1] * way[0])
            rows[3 * element + 2, 3 * k + 2] = sign
    kept = np.repeat(~elements.support, 3)
    limits = np.zeros((4 * count, 3 * count))
    mu = assembly.strengths(ROUTE).friction
    for k in range(count):
        limits[4 * k : 4 * k + 2, 3 * k : 3 * k + 2] = [[-mu[k], 1.0], [-mu[k], -1.0]]
        limits[4 * k + 2, [3 * k, 3 * k + 2]] = [-faces.l1[k] / 2.0, 1.0]
        limits[4 * k + 3, [3 * k, 3 * k + 2]] = [-faces.l1[k] / 2.0, -1.0]
    dead = np.zeros((len(elements), 3))
    dead[:, :2] = elements.weight
    values = []
    for sign in (1.0, -1.0):
        found = linprog(
            sign * weights.ravel(), A_ub=limits, b_ub=np.zeros(4 * count),
            A_eq=rows[kept], b_eq=-dead.ravel()[kept], bounds=(None, None), method="highs",
        )  # fmt: skip
        values.append(sign * found.fun)
    return values[0], values[1]


def test_an_arch_agrees_with_an_independent_linear_program() -> None:
    scene = arch(voussoirs=10, thickness=0.24)
    assembly = build_assembly(scene)
    wanted = (*reactions_of_supports(assembly, ["left"]), *resultant_of_joint(assembly, "v4r0", "v5r0"))
    for one in thrust_ranges(assembly, resultants=wanted).ranges:
        low, high = by_linear_program(scene, one.resultant.function.weights)
        assert ends(one) == pytest.approx((low, high), rel=1e-6, abs=1e-6 * assembly.total_dead), one.resultant
        assert one.least.bracket[0] <= low * (1 + np.sign(low) * 1e-9)
        assert high * (1 - np.sign(high) * 1e-9) <= one.most.bracket[1]


def test_a_section_through_a_stack_carries_the_weight_above() -> None:
    """Statics: N is the weight above; V and M vanish, as no horizontal force acts. A turned scene has the same."""

    def cell(name: str, x: float, y: float, support: bool = False) -> dict[str, Any]:
        outline = [[x, y], [x + 0.5, y], [x + 0.5, y + 0.4], [x, y + 0.4]]
        return {"id": name, "polygon": outline, "support": support}

    cells = [cell(f"c{i}r{j}", 0.5 * i, 0.8 - 0.4 * j, support=j == 2) for i in range(2) for j in range(3)]
    grid = {
        "elements": cells,
        "thickness": 1.0,
        "materials": {"density": 1000.0, "dry": {"friction_coefficient": 0.6}},
        "loads": {"live": [{"body": [1, 0]}]},
    }
    scene = parse_scene({"name": "stack", **grid})
    assembly = build_assembly(scene)
    above = 2 * 0.5 * 0.4 * 1000.0 * 9.81
    normal, shear, _ = resultant_of_section(assembly, (1.0, 0.8), (0.0, 0.8))
    found = thrust_ranges(assembly, resultants=[normal, shear])
    # left of the way from right to left lies what is below: compression is positive on either side
    assert ends(found.ranges[0]) == pytest.approx((above, above), rel=1e-6)
    assert ends(found.ranges[1]) == pytest.approx((0.0, 0.0), abs=1e-6 * above)
    turned = build_assembly(parse_scene(rotated(as_elements(scene), 30.0)))
    here = tuple(resultant_of_joint(turned, "c0r1", "c1r1"))
    there = tuple(resultant_of_joint(assembly, "c0r1", "c1r1"))
    for one, other in zip(
        thrust_ranges(turned, resultants=here).ranges, thrust_ranges(assembly, resultants=there).ranges, strict=True
    ):
        assert one.least.value == pytest.approx(other.least.value, rel=1e-6, abs=1e-6 * above)
        assert one.most.value == pytest.approx(other.most.value, rel=1e-6, abs=1e-6 * above)


def test_a_table_in_space_shares_its_weight_between_legs() -> None:
    """A block on two supports: one may carry between half of the weight and, pressed at the inner edge, more."""
    scene = parse_scene(
        {
            "name": "bridge",
            "elements": [
                box("left", (0, 0, 0), (1, 1, 1), support=True),
                box("right", (3, 0, 0), (4, 1, 1), support=True),
                box("slab", (0, 0, 1), (4, 1, 2), weight=8.0),
            ],
            "materials": {"dry": {"friction_coefficient": 0.5}},
            "loads": {"live": [{"element": "slab", "force": [1, 0, 0]}]},
        }
    )
    found = ranges(scene)
    # levers about the other support's edges: at the least 8 · (2 − 1)/(4 − 1) of the left, pressed at x = 1 and 4
    assert ends(found["support left", "Fz"]) == pytest.approx((8.0 / 3.0, 16.0 / 3.0), rel=1e-6)
    # friction locks the slab between the supports: each holds against the other with μ N, N as above, and 4 at best
    assert ends(found["support left", "Fx"])[1] == pytest.approx(2.0, rel=1e-5)
    assert found["support left", "MZ".capitalize()].interval[0] is not None


def test_the_command(tmp_path: Path, jld: Command) -> None:
    scene = tmp_path / "arch.json"
    assert jld("new", "arch", "--voussoirs", "7", "-o", scene).code == 0
    done = jld("thrust", scene, "--json", "--support", "left", "--out", tmp_path / "out").done()
    told = json.loads(done.out)
    assert [one["component"] for one in told["ranges"]] == ["Fx", "Fy", "M"]
    assert told["stands"] is True
    for one in told["ranges"]:
        assert one["interval"][0] == one["least"]["bracket"][0] <= one["most"]["bracket"][1] == one["interval"][1]
    assert json.loads((tmp_path / "out" / "thrust.json").read_text()) == told
    assert len(list((tmp_path / "out").glob("thrust-*.png"))) == 3
    fallen = jld("thrust", scene, "--load-factor", "100").done()
    assert "falls under 100 × the live load" in fallen.out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--support", "x"), "--support: no support that bears something is named 'x'; expected left, right"),
        (("--joint", "v0r0"), "--joint: 'v0r0' is not a pair"),
        (("--joint", "v0r0,v3r0"), "--joint: 'v0r0' and 'v3r0' do not touch"),
        (("--joint", "v0r0,x"), "--joint: no element is named 'x'"),
        (("--section", "0,1"), "--section: '0,1' is not a line"),
        (("--section", "0,0,nan,1"), "is not a line"),
        (("--section", "5,5,6,6"), "--section: no face lies on the line"),
        (("--load-factor", "nan"), "--load-factor: nan is wrong; expected a finite number"),
        (("--section", "1,1,1,1"), "--section: both ends of the line are the same point"),
    ],
)
def test_bad_input(tmp_path: Path, jld: Command, options: tuple[str, str], message: str) -> None:
    scene = tmp_path / "arch.json"
    jld("new", "arch", "-o", scene)
    jld("thrust", scene, *options).refused(message)


def test_a_section_of_a_spatial_scene_is_refused() -> None:
    assembly = build_assembly(
        parse_scene(
            {
                "name": "block",
                "elements": [
                    box("ground", (0, 0, 0), (1, 1, 1), support=True),
                    box("block", (0, 0, 1), (1, 1, 2), weight=1.0),
                ],
                "materials": {"dry": {"friction_coefficient": 0.5}},
                "loads": {"live": [{"element": "block", "force": [1, 0, 0]}]},
            }
        )
    )
    with pytest.raises(InputError, match="planar structures only"):
        resultant_of_section(assembly, (0, 1), (1, 1))


# Supports that move: thrusts against closed forms, planar and spatial, and what is said of them.


SPREAD = {
    "name": "spread",
    "supports": [{"elements": "left", "move": [-0.5, 0]}, {"elements": "right", "move": [0.5, 0]}],
}


def wedge_of_settlement(alpha: float, mu: float, spatial: bool = False, scale: float = 1.0, force: str = "N") -> Scene:
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
                    "supports": [{"elements": "left", "move": moves[0]}, {"elements": ["right"], "move": moves[1]}],
                }
            ],
        }
    )


def settled(scene: Scene, which: int = 0) -> Settled:
    assembly = build_assembly(scene)
    return settle(assembly, loads.settlements_of(scene, assembly)[which])


@pytest.mark.parametrize("spatial", [False, True], ids=["planar", "spatial"])
@pytest.mark.parametrize("mu", [0.1, 0.3])
def test_a_keystone_between_abutments(mu: float, spatial: bool) -> None:
    """Statics of a wedge: each side carries W/2 at the angle of friction to its normal, H = W/2 cot(α ± φ)."""
    alpha, phi = np.radians(25.0), np.arctan(mu)
    found = settled(wedge_of_settlement(25.0, mu, spatial))
    assert found.stands
    assert found.most is not None
    for end, angle in ((found.least, alpha + phi), (found.most, alpha - phi)):
        assert end.status == "certified"
        assert end.value == pytest.approx(0.5 / np.tan(angle), rel=1e-6)
        assert end.bracket[0] <= end.value <= end.bracket[1]
        assert end.state.forces is not None
        # what the abutments feel is that thrust, and half the weight each
        push = reactions(found.assembly, end.state.forces, np.array([0, 2]))
        up = 2 if spatial else 1
        assert push[:, 0] == pytest.approx([-end.value, end.value], rel=1e-5)
        assert push[:, up] == pytest.approx([-0.5, -0.5], rel=1e-5)
    # the key sinks with the abutments by the rule of friction without another choice: flow at the angle φ
    sinks = found.least.state.mechanism[1, 2 if spatial else 1]
    assert sinks == pytest.approx(-0.5 / np.tan(alpha + phi), rel=1e-5)


def test_a_keystone_that_cannot_be_pushed_out_has_no_greatest_thrust() -> None:
    """Friction above the lean of the faces: the wedge jams (α < φ)."""
    found = settled(wedge_of_settlement(10.0, 0.5))
    assert found.most.status == "unbounded"
    assert found.most.to_json()["reaction"] is None
    assert found.least.value == pytest.approx(0.5 / np.tan(np.radians(10.0) + np.arctan(0.5)), rel=1e-6)


def test_units_make_no_difference() -> None:
    one, other = (
        settled(wedge_of_settlement(25.0, 0.3)),
        settled(wedge_of_settlement(25.0, 0.3, scale=1000.0, force="MN")),
    )
    assert other.least.value == pytest.approx(one.least.value, rel=1e-9)
    # nor does the size of the movement, per unit of which the work is
    document = wedge_of_settlement(25.0, 0.3).model_dump(mode="json", exclude_defaults=True)
    for size in (1e-12, 1e12):
        for part, way in zip(document["settlements"][0]["supports"], (-0.5, 0.5), strict=True):
            part["move"] = [way * size, 0.0]
        sized = settled(parse_scene(document)).least
        assert sized.status == "certified"
        assert sized.value == pytest.approx(size * one.least.value, rel=1e-9)
        assert np.allclose(sized.state.mechanism / size, one.least.state.mechanism, atol=1e-6)


def arch_of_settlement(count: int, thickness: float, settlement: dict[str, Any] = SPREAD) -> Scene:
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
    found = settled(arch_of_settlement(count, thickness))
    half = 0.5 * found.assembly.total_dead
    assert found.least.value / half == pytest.approx(float(np.nanmax(thrust(thickness, count, 1.0))), rel=1e-7)
    assert found.most.value / half == pytest.approx(float(np.nanmin(thrust(thickness, count, -1.0))), rel=1e-7)
    assert found.least.value < found.most.value


def test_one_abutment_that_sinks_and_tilts() -> None:
    """Work is linear: the range of a movement twice as large is twice as large; a turn about its springing is one."""
    sinks = {"name": "sinks", "supports": [{"elements": "left", "move": [0, -1], "turn": 0.2, "about": [-1, 0]}]}
    twice = {"name": "sinks", "supports": [{"elements": "left", "move": [0, -2], "turn": 0.4, "about": [-1, 0]}]}
    one, two = settled(arch_of_settlement(16, 0.2, sinks)), settled(arch_of_settlement(16, 0.2, twice))
    for end, other in ((one.least, two.least), (one.most, two.most)):
        assert end.status == other.status == "certified"
        assert other.value == pytest.approx(2.0 * end.value, rel=1e-7)


def test_a_structure_that_falls_has_no_range_of_thrust() -> None:
    found = settled(arch_of_settlement(16, 0.05))
    assert found.stands is False
    assert found.least is None
    assert found.to_json()["most"] is None


def test_the_command_of_settlement(tmp_path: Path, jld: Command) -> None:
    file, out = tmp_path / "arch.json", tmp_path / "out"
    file.write_text(arch_of_settlement(12, 0.2).model_dump_json(exclude_defaults=True))
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
def test_bad_input_of_settlement(settlement: Any, words: str, tmp_path: Path, jld: Command) -> None:
    document = {
        **arch_of_settlement(6, 0.2).model_dump(mode="json", exclude_defaults=True),
        "settlements": [settlement],
    }
    file = saved(tmp_path / "arch.json", document)
    jld("settlement", file).refused(words)


def test_a_scene_without_settlements_is_refused(tmp_path: Path, jld: Command) -> None:
    file = tmp_path / "box.json"
    parts = [box("g", (0, 0, -1), (1, 1, 0), support=True), box("b", (0, 0, 0), (1, 1, 1))]
    materials = {"density": 2000, "dry": {"friction_coefficient": 0.6}}
    file.write_text(json.dumps({"elements": parts, "materials": materials, "loads": {"live": [{"body": [1, 0, 0]}]}}))
    jld("settlement", file).refused("the scene has none")
