"""Keyed and wavy joints: closed forms of climbing and breaking, the optimum between, and bad input."""

from __future__ import annotations

import csv
import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from structures import HEIGHT, flat_arch, flat_arch_load

from cases import dry_and_inner
from command import Command
from jld_core import InputError, Scene, build_assembly, parse_scene, solve
from jld_explore.cli import streams
from jld_geometry import Incline, Key, Sine, shape_joints, shaped_scene
from jld_studio import StudioSession

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
        "materials": dry_and_inner(0.0, FRICTION, tension, shear),
        "labels": {"inner": [["ground", "low"]]},
        "loads": {
            "dead": [{"element": "up", "force": [0.0, -PRESS], "at": [place, 0.1]}],
            "live": [{"element": "up", "force": [1.0, 0.0], "at": [0.0, 0.02]}],
        },
    }
    return parse_scene(document)


def load_with(shape: Any, **strengths: float) -> float:
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
    monkeypatch.setattr("jld_geometry.joint_shapes._LAST", 0.3)  # a coarse search, for time
    scene = two_blocks()
    assembly = build_assembly(scene)
    done = shape_joints(scene, assembly, assembly.labels, Key(0.025, 0.35, 0.05))
    values = [value for _, value in done.trials]
    assert done.after.load_factor == pytest.approx(np.nanmax(values), rel=1e-6)
    assert done.after.load_factor > 1.5 * values[0]


def test_a_stopped_search_writes_the_best_shape(tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """An interrupt in the third trial: the scene is that of the best before, and the exit code that of a stop."""
    file, out = tmp_path / "key.json", tmp_path / "out.json"
    file.write_text(two_blocks().model_dump_json(exclude_defaults=True))
    told: list[str] = []

    def tell(line: str) -> None:
        told.append(line)
        if len(told) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(streams, "say", tell)
    done = jld("move", file, "-o", out, "--joint", "key:0.025,0.35,0.05")
    assert done.code == 3
    assert f"the best so far is in {out}" in done.err
    best = max(float(line.rpartition(" ")[2]) for line in told)
    assert solve(parse_scene(json.loads(out.read_text()))).bracket[0] == pytest.approx(best, rel=1e-5)


def test_a_search_changes_a_falling_slope(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jld_geometry.joint_shapes._LAST", 0.3)
    scene = two_blocks()
    assembly = build_assembly(scene)
    tried = shape_joints(scene, assembly, assembly.labels, Incline(-0.1)).trials
    slopes = [shape.slope for shape, _ in tried if isinstance(shape, Incline)]
    assert len(slopes) > 1
    assert max(slopes) < 0.0


def test_the_command(tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    file, out = tmp_path / "key.json", tmp_path / "out.json"
    monkeypatch.setattr("jld_geometry.moving._GAP", 0.9)  # reached on a coarse mesh
    monkeypatch.setattr("jld_geometry.moving._SECONDS", 60.0)
    file.write_text(two_blocks().model_dump_json(exclude_defaults=True))
    facts = json.loads(jld("move", file, "-o", out, "--joint", "sine:0.05,1", "--seconds", "0", "--json").done().out)
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
    jld("move", file, "-o", out, "--joint", shape).refused(said)
    assert not out.exists()


# --- in space ---------------------------------------------------------------------------------------------------------

RUN = np.array([0.0, 1.0, 0.0])
"""Direction along which the shapes of `solid_blocks` run: into the page of `two_blocks`."""


def solid_blocks(**options: float) -> Scene:
    """`two_blocks` as solids: x to the right, y into the page, z upwards."""
    document = json.loads(two_blocks(**options).model_dump_json(exclude_defaults=True))
    thick = document.pop("thickness")
    for entry in document["elements"]:
        ring = entry.pop("polygon")
        count = len(ring)
        entry["vertices"] = [[x, y, z] for y in (0.0, thick) for x, z in ring]
        sides = [[(k + 1) % count, k, count + k, count + (k + 1) % count] for k in range(count)]
        entry["faces"] = [list(range(count)), [2 * count - 1 - k for k in range(count)], *sides]
    for entry in [*document["loads"]["dead"], *document["loads"]["live"]]:
        entry["force"].insert(1, 0.0)
        entry["at"].insert(1, 0.5 * thick)
    return parse_scene(document)


def solid_load(scene: Scene, shape: Any, *, gap: float = 1e-6) -> float:
    assembly = build_assembly(scene)
    return solve(shaped_scene(scene, assembly, assembly.labels, shape, RUN), gap=gap).load_factor


@pytest.mark.parametrize("shape", [Key(0.1, 0.4, 0.05), Sine(0.05, 1)])
def test_in_space_a_shape_has_the_load_of_its_section(shape: Any) -> None:
    """A shape that runs through blocks of one thickness fails as its section does: the planar route, meshed apart."""
    assert solid_load(solid_blocks(), shape) == pytest.approx(load_with(shape), rel=1e-6)


def turned(scene: Scene, angle: float, about: np.ndarray[Any, Any], shift: np.ndarray[Any, Any]) -> Scene:
    """A scene in space turned by an angle about an axis, and moved."""
    cross = np.cross(np.eye(3), -about)
    turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    document = json.loads(scene.model_dump_json(exclude_defaults=True))
    for entry in document["elements"]:
        entry["vertices"] = (np.array(entry["vertices"]) @ turn.T + shift).tolist()
    for entry in [*document["loads"]["dead"], *document["loads"]["live"]]:
        entry["force"] = (turn @ entry["force"]).tolist()
        entry["at"] = (turn @ entry["at"] + shift).tolist()
    return parse_scene(document)


@pytest.mark.parametrize("slope", [0.2, 0.5])
def test_an_inclined_joint_is_climbed(slope: float) -> None:
    """λ = N tan(φ + α) to 1e-9, up a plane of slope tan α, in the plane and in space."""
    expected = PRESS * (FRICTION + slope) / (1.0 - FRICTION * slope)
    # both forces meet in the middle of the joint, so that the block does not rock
    place = 0.5 * LENGTH - expected * 0.02 / PRESS
    strong = {"tension": 1e7, "shear": 1e7, "place": place}
    scene = solid_blocks(**strong)
    assembly = build_assembly(scene)
    for sign in (1.0, -1.0):
        flat = shaped_scene(
            two_blocks(**strong), build_assembly(two_blocks(**strong)), assembly.labels, Incline(sign * slope)
        )
        solid = shaped_scene(scene, assembly, assembly.labels, Incline(sign * slope), RUN)
        values = [solve(one, gap=1e-8).load_factor for one in (flat, solid)]
        if values[0] < 1.5 * expected:  # the slope that rises in the direction of the push
            assert values == pytest.approx([expected, expected], rel=1e-9)
            break
    else:
        pytest.fail("neither slope is climbed")


def test_a_key_in_space_breaks_at_its_root() -> None:
    """Without friction a deep narrow tooth is sheared: λ = τ w t to 1e-9; the push lies in the plane of the root."""
    width, depth, shear = 0.1, 0.2, 1e5
    document = json.loads(solid_blocks(tension=1e7, shear=shear).model_dump_json(exclude_defaults=True))
    document["materials"]["dry"]["friction_coefficient"] = 0.0
    document["loads"]["live"][0]["at"][2] = 0.0
    scene = parse_scene(document)
    expected = shear * width * LENGTH * THICK
    assert solid_load(scene, Key(depth, width, 0.0), gap=1e-8) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("shape", [Key(0.2, 0.4, 0.05), Sine(0.08, 2), Incline(0.3)])
def test_in_space_volumes_are_kept_wherever_blocks_lie(shape: Any) -> None:
    """Cells fill what their blocks fill, to 1e-12, and each face of a tooth is one whole face of its neighbour."""
    plain = solid_blocks()
    axis = np.array([1.0, 2.0, -0.5]) / np.sqrt(5.25)
    for scene, run in ((plain, RUN), (turned(plain, 0.7, axis, np.array([30.0, -20.0, 5.0])), None)):
        if run is None:
            cross = np.cross(np.eye(3), -axis)
            run = RUN + np.sin(0.7) * cross @ RUN + (1.0 - np.cos(0.7)) * cross @ cross @ RUN
        assembly = build_assembly(scene)
        shaped = build_assembly(shaped_scene(scene, assembly, assembly.labels, shape, run))
        assert shaped.elements.volume.sum() == pytest.approx(assembly.elements.volume.sum(), rel=1e-12)
        dry = shaped.interfaces.area[shaped.labels].sum() / assembly.interfaces.area[assembly.labels].sum()
        outlines = [np.linalg.norm(np.diff(one, axis=0), axis=1).sum() for one, _ in shape.teeth()]
        if isinstance(shape, Key):
            expected = 1.0 - shape.width + outlines[0] - shape.width + np.hypot(shape.depth, shape.flank)
        elif isinstance(shape, Incline):
            expected = float(np.hypot(1.0, shape.slope)) + 0.5 * shape.slope  # and the side of one wedge
        else:
            expected = sum(outlines)
        assert dry == pytest.approx(expected, rel=1e-9)


def test_in_space_keys_climb_then_break() -> None:
    """Between both lies an optimum, as in the plane: the trend of Mousavian, Bagi and Casapulla (2022)."""
    scene = solid_blocks()
    values = [solid_load(scene, Key(depth, 0.35, 0.05)) for depth in (0.0125, 0.1, 0.2)]
    assert values[0] < values[1] > values[2]


def test_the_command_in_space(tmp_path: Path, jld: Command) -> None:
    file, out = tmp_path / "key.json", tmp_path / "out.json"
    file.write_text(solid_blocks().model_dump_json(exclude_defaults=True))
    flags = ("--joint", "key:0.1,0.4,0.05", "--direction", "0,1,0", "--seconds", "0", "--json")
    done = jld("move", file, "-o", out, *flags).done()
    assert "no check by fields: in space it takes minutes; jld solve" in done.err
    facts = json.loads(done.out)
    assert facts["load_factor"] == pytest.approx(load_with(Key(0.1, 0.4, 0.05)), rel=1e-6)
    assert solve(parse_scene(json.loads(out.read_text()))).load_factor == pytest.approx(facts["load_factor"], rel=1e-9)
    assert out.with_suffix(".csv").exists()
    assert out.with_suffix(".png").exists()


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--joint", "key:0.1,0.4,0.05"], "--direction: joints in space run along a direction"),
        (["--joint", "key:0.1,0.4,0.05", "--direction", "0,0,0"], "--direction: '0,0,0' is no direction"),
        (["--joint", "key:0.1,0.4,0.05", "--direction", "0,1"], "is no direction"),
        (["--joint", "key:0.1,0.4,0.05", "--direction", "0,0,1"], "--direction: all joints lie across it"),
        (["--joint", "key:0.9,0.4,0.05", "--direction", "0,1,0"], "a tooth of .* does not fit into .*a smaller depth"),
        (["--joint", "sine:0.9,1", "--direction", "0,1,0"], "does not fit"),
        (["--joint", "incline:0", "--direction", "0,1,0"], "leaves the joint straight"),
        (["--direction", "0,1,0"], "--direction: it is that of shaped joints"),
    ],
)
def test_bad_shapes_in_space(tmp_path: Path, jld: Command, flags: list[str], said: str) -> None:
    file, out = tmp_path / "key.json", tmp_path / "out.json"
    file.write_text(solid_blocks().model_dump_json(exclude_defaults=True))
    done = jld("move", file, "-o", out, *flags)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert re.search(said, done.err)
    assert not out.exists()


def test_elements_that_are_not_convex_are_refused() -> None:
    document = json.loads(solid_blocks().model_dump_json(exclude_defaults=True))
    ring = [[-0.4, -0.2], [0.8, -0.2], [0.8, 0.0], [0.6, 0.0], [0.6, -0.1], [0.5, -0.1], [0.5, 0.0], [-0.4, 0.0]]
    count, low = len(ring), document["elements"][1]
    low["vertices"] = [[x, y, z] for y in (0.0, THICK) for x, z in ring]
    sides = [[(k + 1) % count, k, count + k, count + (k + 1) % count] for k in range(count)]
    low["faces"] = [list(range(count)), [2 * count - 1 - k for k in range(count)], *sides]
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    with pytest.raises(InputError, match=r"element '(low|up)': it is not convex"):
        shaped_scene(scene, assembly, assembly.labels, Sine(0.05, 1), RUN)


def test_planar_joints_have_no_direction() -> None:
    scene = two_blocks()
    assembly = build_assembly(scene)
    with pytest.raises(InputError, match="the joints of a planar scene have none"):
        shaped_scene(scene, assembly, assembly.labels, Sine(0.1, 1), RUN)


def box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


BESIDE = {
    "wide": {"base": box(-1, -0.5, 2, 0), "b": box(0, 0, 1, 1)},
    "two": {"base": box(-1, -0.5, 3, 0), "b": box(0, 0, 1, 1), "c": box(1, 0, 2, 1)},
    "pyramid": {"base": box(-1, -0.5, 2, 0), "b": box(-0.5, 0, 1.5, 0.5), "c": box(0, 0.5, 1, 1)},
    "flush": {"base": box(0, -0.5, 2, 0), "b": box(0, 0, 1, 1)},
    "bond": {"base": box(-1, -0.5, 3, 0), "b": box(0, 0, 1, 0.5), "c": box(1, 0, 2, 0.5), "d": box(0.5, 0.5, 1.5, 1)},
    "lintel": {"base": box(-1, -0.5, 0.3, 0), "s": box(2, -0.5, 3, 0), "l": box(-0.2, 0, 2.4, 0.4)},
}


@pytest.mark.sampled(12)
@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 2])
@pytest.mark.parametrize("name", BESIDE)
def test_shapes_beside_wider_elements_make_valid_scenes(name: str, turn: float) -> None:
    """In any order of elements: a scene that can be built, of the same area, or a tooth that does not fit."""
    c, s = np.cos(turn), np.sin(turn)
    entries = [
        {"id": one, "polygon": (np.array(outline) @ [[c, s], [-s, c]]).tolist(), "support": one in ("base", "s")}
        for one, outline in BESIDE[name].items()
    ]
    for elements in (entries, entries[::-1]):
        scene = parse_scene(
            {
                "elements": elements,
                "materials": {"density": 1.0, "dry": {"friction_coefficient": 0.6}},
                "loads": {"live": [{"body": [1.0, 0.0]}]},
            }
        )
        assembly = build_assembly(scene)
        fitting = 0
        for shape in (*(Incline(slope) for slope in (0.02, -0.1, 0.2, -0.5)), Key(0.1, 0.4, 0.05), Sine(0.02, 3)):
            try:
                found = build_assembly(shaped_scene(scene, assembly, assembly.labels, shape))
            except InputError as error:
                if "does not fit into" not in str(error):
                    raise
                continue
            fitting += 1
            assert found.elements.volume.sum() == pytest.approx(assembly.elements.volume.sum(), rel=1e-9)
        assert fitting >= 2


# Joints that the studio's page drags: λ against a closed form, what may move, improvements, and bad requests.


TOPS = [{"at": [1.2, HEIGHT], "direction": [1, 0]}, {"at": [-1.2, HEIGHT], "direction": [-1, 0]}]
"""Paths of the tops of both springings of the flat arch."""


@pytest.fixture(scope="module")
def desk() -> StudioSession:
    return StudioSession(parse_scene(flat_arch(20.0, 1.2, 0.2, along=TOPS, ties="mirror-x", box=0.02)))


def letters(desk: StudioSession) -> str:
    return "d" * len(desk.setup({}).assembly.interfaces)


def tops(desk: StudioSession, half: float) -> dict[str, list[float]]:
    """Vertices of the tops of both springings at a half width."""
    places = desk.joints.mesh.places
    found = [int(np.argmin(np.linalg.norm(places - [sign * 1.2, HEIGHT], axis=1))) for sign in (1, -1)]
    return {str(found[0]): [half, HEIGHT], str(found[1]): [-half, HEIGHT]}


def factor(desk: StudioSession, changes: dict[str, Any]) -> float:
    return float(desk.solve(letters(desk), changes)["solution"]["load_factor"])


@pytest.mark.parametrize("half", [1.15, 1.22, 1.3])
def test_a_dragged_joint_follows_the_closed_form(desk: StudioSession, half: float) -> None:
    """λ of (11.8) at every half width of the springings where no joint slides, and in the file that is saved."""
    changes = {"vertices": tops(desk, half)}
    assert factor(desk, changes) == pytest.approx(flat_arch_load(half, 0.2, 0.1), rel=1e-8)
    saved = parse_scene(desk.scene_with(letters(desk), changes))
    assert solve(saved).load_factor == pytest.approx(flat_arch_load(half, 0.2, 0.1), rel=1e-8)
    # points that name vertices moved with them, so that the file can be moved on
    again = StudioSession(saved)
    assert again.joints.facts()["ties"]


def test_vertices_that_may_move_and_their_directions(desk: StudioSession) -> None:
    """Tops slide along the outline and bottoms of the key too; corners and vertices of supports stay; ties mirror."""
    facts = json.loads(json.dumps(desk.joints.facts()))
    places = np.array(facts["places"])
    moving = {tuple(np.round(places[int(vertex)], 9)): path for vertex, path in facts["paths"].items()}
    assert set(moving) == {(s * x, y) for s in (1, -1) for x, y in ((1.2, HEIGHT), (0.2, HEIGHT), (0.1, 0.0))}
    assert all(abs(path["direction"][1]) < 1e-12 for path in moving.values())
    for vertex, others in facts["ties"].items():
        assert [places[other].tolist() for other, _ in others] == [[-places[int(vertex)][0], places[int(vertex)][1]]]
        assert [sign for _, sign in others] == [-1]


def test_some_steps_from_the_geometry_drawn(desk: StudioSession) -> None:
    """The improvement begins at the drawn joints, raises λ, keeps the ties, and is what the page then solves."""
    changes = {"vertices": tops(desk, 1.22), "materials": {"density": 1000.0, "dry": {"friction_angle": 21}}}
    found = desk.improve(letters(desk), changes)
    assert found["start"] == pytest.approx(flat_arch_load(1.22, 0.2, 0.1), rel=1e-8)
    assert found["value"] > 1.05 * found["start"]
    assert found["steps"] >= 1
    after = factor(desk, {**changes, "vertices": found["vertices"]})
    assert after == pytest.approx(found["value"], rel=1e-8)
    ends = np.array(list(found["vertices"].values()))
    assert np.sort(ends[:, 0]) == pytest.approx(-np.sort(ends[:, 0])[::-1], abs=1e-9)


def test_bad_vertices_are_one_line(desk: StudioSession) -> None:
    name = next(iter(tops(desk, 1.2)))
    for vertices, said in (
        ([1], "they are no JSON object"),
        ({"x": [0, 0]}, "no vertex that may move"),
        ({"99999": [0, 0]}, "no vertex that may move"),
        ({name: [1.0]}, "two finite numbers"),
        ({name: [float("nan"), 0.0]}, "two finite numbers"),
        ({name: [True, 0.0]}, "two finite numbers"),
        ({name: [0.1, HEIGHT]}, "polygon"),
    ):
        with pytest.raises(InputError, match=said):
            desk.solve(letters(desk), {"vertices": vertices})


def test_scenes_without_joints_that_move() -> None:
    """A block on a support has no vertex to drag, and says so."""
    document = flat_arch(20.0, 1.2, 0.2)
    kept = [one for one in document["elements"] if one["id"] in ("pier right", "ground")]
    loads = {"live": [{"body": [1, 0]}]}
    desk = StudioSession(parse_scene({**document, "elements": kept, "loads": loads}))
    assert desk.joints is None
    with pytest.raises(InputError, match="no vertex of this scene moves"):
        desk.improve(letters(desk), {})


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"fill": {"level": 2.0, "density": 1800.0, "friction_angle": 30.0}}, "fill: .* variable pressure"),
        (
            {"fill": {"level": 2.0, "density": 1800.0, "friction_angle": 30.0, "active": 0, "passive": 0}},
            "fill: its loads do not move with the joints",
        ),
        (
            {
                "members": [
                    {
                        "kind": "tie",
                        "from": {"element": "pier left", "at": [-1.5, -1.0]},
                        "to": {"element": "pier right", "at": [1.5, -1.0]},
                        "tension": 1.0,
                    }
                ]
            },
            "members: a move of joints does not model them",
        ),
    ],
)
def test_fill_and_members_are_named(more: dict[str, Any], said: str) -> None:
    """The button that improves joints says what excludes it; the scene is still solved."""
    desk = StudioSession(parse_scene({**flat_arch(20.0, 1.2, 0.2), **more}))
    with pytest.raises(InputError, match=said):
        desk.improve(letters(desk), {})
