"""How blocks are laid: cones of free directions, sweeps, groups, locks, and the props that stages need."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from scipy.spatial import ConvexHull

from cases import assembly_in_space as spatial_assembly
from cases import box, dry_and_inner, grid_assembly
from command import Command, saved
from jld_core import (
    Assembly,
    DeadlinePassed,
    InputError,
    LimitAnalysis,
    Scene,
    build_assembly,
    load_scene,
    parse_scene,
    samples,
)
from jld_core.scene import units
from jld_practice.laying import (
    Freedom,
    Laying,
    Parts,
    assembly_order,
    blocks_of_labelling,
    locked_blocks,
    order_without_stages,
)
from jld_practice.laying import freedom as freedom_of_blocks
from jld_practice.laying.command import words_of


def names(assembly: Assembly, elements: tuple[int, ...]) -> list[str]:
    return [assembly.elements.ids[e] for e in elements]


def planar(elements: list[dict[str, Any]], **keys: Any) -> Assembly:
    scene = {
        "elements": elements,
        "materials": dry_and_inner(2000, 0.65, 1e6, 1e6),
        "loads": {"live": [{"body": [1, 0]}]},
        **keys,
    }
    return build_assembly(parse_scene(scene))


def test_a_pile_is_laid_from_the_ground() -> None:
    assembly = grid_assembly(["a", "b", "c", "#"])
    found = assembly_order(assembly, assembly.labels)
    assert [names(assembly, (int(found.blocks.elements(s.blocks[0])[0]),))[0] for s in found.steps] == [
        "c0r2",
        "c0r1",
        "c0r0",
    ]
    assert found.possible
    assert found.stands
    assert all(step.direction[1] > -1e-9 for step in found.steps)


DOVETAIL = {
    "base": [[0, 0], [4, 0], [4, 2], [2.5, 2], [3, 1], [1, 1], [1.5, 2], [0, 2]],
    "key": [[1, 1], [3, 1], [2.5, 2], [1.5, 2]],
}


def dovetail() -> Assembly:
    return planar(
        [{"id": "base", "polygon": DOVETAIL["base"], "support": True}, {"id": "key", "polygon": DOVETAIL["key"]}]
    )


def test_a_dovetail_locks_in_its_plane_and_slides_out_of_it() -> None:
    assembly = dovetail()
    assert names(assembly, locked_blocks(assembly, assembly.labels)) == ["key"]
    found = assembly_order(assembly, assembly.labels)
    assert not found.possible
    assert [found.blocks.name(block) for block in found.locked] == ["key"]
    beside = assembly_order(assembly, assembly.labels, sideways=True)
    assert beside.possible
    assert beside.steps[0].direction.tolist() == [0.0, 0.0, 1.0]


def test_a_dovetail_in_space_slides_along_its_groove() -> None:
    def prism(outline: list[list[float]]) -> dict[str, Any]:
        count = len(outline)
        front, back = [[x, 0.0, z] for x, z in outline], [[x, 1.0, z] for x, z in outline]
        sides = [[k, (k + 1) % count, count + (k + 1) % count, count + k] for k in range(count)]
        return {
            "vertices": front + back,
            "faces": [list(range(count))[::-1], list(range(count, 2 * count)), *[side[::-1] for side in sides]],
        }

    # the groove in three convex pieces of one support: nothing that is not convex is swept for its hull
    left = [[0, 0], [1, 1], [1.5, 2], [0, 2]]
    right = [[4, 0], [4, 2], [2.5, 2], [3, 1]]
    floor = [[0, 0], [4, 0], [3, 1], [1, 1]]
    elements = [{"id": n, **prism(o), "support": True} for n, o in (("l", left), ("r", right), ("f", floor))]
    elements.append({"id": "key", **prism(DOVETAIL["key"])})
    assembly = spatial_assembly(elements)
    found = assembly_order(assembly, assembly.labels)
    assert found.possible
    assert abs(found.steps[0].direction) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)


def test_two_that_hold_one_another_leave_together() -> None:
    """A key in its dovetail, both loose on a slab: neither leaves the other, together they are lifted."""
    base = [[x, y + 1] for x, y in DOVETAIL["base"]]
    key = [[x, y + 1] for x, y in DOVETAIL["key"]]
    slab = [[0, 0], [4, 0], [4, 1], [0, 1]]
    assembly = planar(
        [
            {"id": "slab", "polygon": slab, "support": True},
            {"id": "base", "polygon": base},
            {"id": "key", "polygon": key},
        ]
    )
    # the key must go with the base: neither is free, whichever is asked first
    alone = assembly_order(assembly, assembly.labels, group=1)
    assert sorted(alone.blocks.name(k) for k in alone.locked) == ["base", "key"]
    together = assembly_order(assembly, assembly.labels, group=2)
    assert [len(step.blocks) for step in together.steps] == [2]


def test_a_block_may_be_free_at_first_and_meet_another_on_its_way_out() -> None:
    """Below a lid that does not touch it, between two posts: nothing touches it above, and it cannot leave."""
    posts = [[[0, 0], [1, 0], [1, 3], [0, 3]], [[2, 0], [3, 0], [3, 3], [2, 3]]]
    elements: list[dict[str, Any]] = [
        {"id": "floor", "polygon": [[0, -1], [3, -1], [3, 0], [0, 0]], "support": True},
        {"id": "lid", "polygon": [[0, 3], [3, 3], [3, 4], [0, 4]], "support": True},
        {"id": "block", "polygon": [[1, 0], [2, 0], [2, 1], [1, 1]]},
    ]
    elements += [{"id": f"post{k}", "polygon": post, "support": True} for k, post in enumerate(posts)]
    assembly = planar(elements)
    assert names(assembly, locked_blocks(assembly, assembly.labels)) == ["block"]
    without = planar([e for e in elements if e["id"] != "lid"])
    assert locked_blocks(without, without.labels) == ()
    # the same in space, where the sweep is of hulls
    solids = [
        box("floor", (0, 0, -1), (3, 1, 0), support=True),
        box("front", (1, -1, 0), (2, 0, 3), support=True),
        box("back", (1, 1, 0), (2, 2, 3), support=True),
        box("left", (0, 0, 0), (1, 1, 3), support=True),
        box("right", (2, 0, 0), (3, 1, 3), support=True),
        box("block", (1, 0, 0), (2, 1, 1)),
    ]
    pit = spatial_assembly(solids)
    assert locked_blocks(pit, pit.labels) == ()
    covered = spatial_assembly([*solids, box("lid", (0, 0, 3), (3, 1, 4), support=True)])
    assert names(covered, locked_blocks(covered, covered.labels)) == ["block"]


def test_the_prop_of_an_overhang() -> None:
    """Weight W, width b, resting on a: W (b/2 − a) = p (b − a) about the edge, by moments."""
    a, b = 0.3, 1.0
    assembly = planar(
        [
            {"id": "base", "polygon": [[0, 0], [a, 0], [a, 1], [0, 1]], "support": True},
            {"id": "slab", "polygon": [[0, 1], [b, 1], [b, 1.2], [0, 1.2]]},
        ]
    )
    (step,) = assembly_order(assembly, assembly.labels).steps
    weight = 2000 * 9.81 * 0.2 * b
    assert step.stage.stands is False
    assert step.stage.props.sum() == pytest.approx(weight * (0.5 * b - a) / (b - a), rel=1e-6)


def test_an_arch_needs_centring_until_it_is_closed() -> None:
    rows = ["#aabcc#", "##...##"]
    assembly = grid_assembly(rows, friction=0.8)
    found = assembly_order(assembly, assembly.labels)
    assert found.possible
    for step in found.steps:
        laid = step.stage
        assert laid.error < 1e-6
    assert assembly_order(assembly, assembly.labels, wish="standing").searched == (found.stands is not True)


@pytest.mark.parametrize("seed", range(6))
def test_stages_agree_with_the_limit_analysis(seed: int) -> None:
    """The last stage is the structure itself: it stands without props where λ = 0 is proven admissible."""
    rng = np.random.default_rng(seed)
    assembly = grid_assembly(["aaa", "aaa", ".a.", "###"])
    labels = rng.random(len(assembly.interfaces)) < 0.6
    found = assembly_order(assembly, labels, sideways=True)
    result = LimitAnalysis(assembly).solve(labels)
    if found.steps and result.stands_at_zero is not None:
        assert found.steps[-1].stage.stands == result.stands_at_zero


# Orders without solved stages: every block has a way out, and the command gives them where time is short.


@pytest.mark.parametrize("make", [samples.wall, samples.arch])
def test_every_block_can_be_removed_in_reverse(make: Callable[[], Scene]) -> None:
    """Replay the order backwards: each block has a way out, and all free blocks are laid once."""
    assembly = build_assembly(make())
    labels = np.ones_like(assembly.labels)
    laying = order_without_stages(assembly, labels)
    blocks = blocks_of_labelling(assembly, labels)
    freedom, there = Freedom(blocks), np.ones(len(blocks), dtype=bool)
    for step in reversed(laying.steps):
        assert len(step.blocks) == 1
        assert freedom.way_out(step.blocks[0], there) is not None
        there[list(step.blocks)] = False
    assert np.array_equal(there, blocks.fixed)
    assert laying.stands is None


def test_an_order_is_given_where_stages_take_too_long(
    jld: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The time is over at the first stage: the order says that its props are not known, and the table is blank."""

    def too_late(*_: object) -> None:
        raise DeadlinePassed

    monkeypatch.setattr(Parts, "_least_props", too_late)
    file = saved(tmp_path / "arch.json", samples.arch(voussoirs=7))
    for line in ((), ("--props", "100")):
        done = jld("assembly", file, "--seconds", "60", "--out", tmp_path / "out", *line).done()
        assert "7 blocks in 7 steps, props not known and not minimal" in done.out
        table = pd.read_csv(tmp_path / "out" / "assembly.csv")
        assert len(table) == 7
        forces = [column for column in table.columns if column.startswith("props_") and column != "props_along"]
        assert table[forces].isna().all().all()


# Where laying starts: the ground, a side or the springings; and the first stage that falls.


def places(laying: Laying) -> list[float]:
    """x of the blocks in the order in which they are laid."""
    blocks = laying.blocks
    centroid = blocks.assembly.elements.centroid
    return [round(float(centroid[blocks.elements(step.blocks[0])][:, 0].mean()), 9) for step in laying.steps]


def row() -> Assembly:
    """Five blocks side by side on the ground, in two courses."""
    return grid_assembly(["fghij", "abcde", "#####"])


def test_a_row_is_laid_from_a_side() -> None:
    """Columns follow one another from the left or the right; from the ground the lower course comes first."""
    assembly = row()
    order = {
        start: places(assembly_order(assembly, assembly.labels, start=start)) for start in ("left", "right", "ground")
    }
    assert order["left"] == sorted(order["left"])
    assert order["right"] == sorted(order["right"], reverse=True)
    ground = assembly_order(assembly, assembly.labels)
    first = [int(ground.blocks.elements(step.blocks[0])[0]) for step in ground.steps]
    heights = assembly.elements.centroid[first, 1].round(9).tolist()
    assert heights == sorted(heights)


WINDOWS = [
    ["aabbbbcc", "ddbeefff", "ghh..iij", "kkk..llm", "nnn..oom", "########"],
    ["aaabbbcc", "addefggg", "hhh..iij", "hkk..llj", "mnnoolpp", "########"],
    ["aaabbbbc", "addbefff", "ggh..iij", "kkh..ill", "mmmnnopq", "########"],
]
"""Walls with a window or a door, of stones some of which need a prop until the next course loads them."""


@pytest.mark.parametrize("rows", WINDOWS, ids=["window", "door", "high window"])
def test_a_wall_with_a_window_grows_by_courses(rows: list[str]) -> None:
    """No stone is laid before the courses below are complete, whatever props its own course needs."""
    assembly = grid_assembly(rows)
    found = assembly_order(assembly, assembly.labels)
    assert found.possible
    bottoms = [
        min(float(assembly.elements.lower[e, 1]) for e in found.blocks.elements(step.blocks[0])) for step in found.steps
    ]
    assert [round(bottom, 6) for bottom in bottoms] == sorted(round(bottom, 6) for bottom in bottoms)


def test_an_arch_is_laid_from_its_springings() -> None:
    """Voussoirs come in pairs from both springings, and the keystone last, by symmetry in this order only."""
    assembly = build_assembly(samples.arch(voussoirs=7))
    found = assembly_order(assembly, assembly.labels, start="springings")
    assert found.possible
    distance = [abs(x) for x in places(found)]
    assert all(a >= b - 1e-9 for a, b in zip(distance, distance[2:], strict=False))
    assert distance[-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("start", ["left", "right", "springings", "ground"])
def test_every_start_is_an_order_of_all_blocks(start: str) -> None:
    """Each free block is laid once, in a direction that is free: the same blocks whatever the start."""
    assembly = build_assembly(samples.wall(courses=3, length=1.2))
    found = assembly_order(assembly, assembly.labels, start=start)
    laid = [block for step in found.steps for block in step.blocks]
    assert sorted(laid) == np.flatnonzero(~found.blocks.fixed).tolist()
    assert found.stands


def test_another_start_is_refused() -> None:
    """A name that is no start is one line."""
    assembly = row()
    with pytest.raises(InputError, match="'middle' is no start of laying"):
        assembly_order(assembly, assembly.labels, start="middle")


def test_the_first_stage_that_falls_is_named(jld: Command, tmp_path: Path) -> None:
    """An arch without centring: the answer to `standing` names step, stone and prop, and draws every stage."""
    scene = tmp_path / "arch.json"
    assert jld("new", "arch", "--voussoirs", "3", "--embrace", "120", "-o", scene).code == 0
    done = jld(
        "assembly", scene, "--wish", "standing", "--start", "springings", "--out", tmp_path / "out", "--stages"
    ).done()
    assert "none whose every stage stands" in done.out
    assert "the first that falls is step " in done.out
    assert sorted(path.name for path in (tmp_path / "out").glob("stage-*.png")) == [
        f"stage-{k}.png" for k in range(1, 4)
    ]
    refused = jld("assembly", scene, "--stages")
    assert refused.code == 2
    assert refused.err.startswith("jld: --stages: there is no folder")


# Centring of an arch: when it may be struck; stages as an animation; the time limit of `jld assembly`.


@pytest.fixture
def arch(tmp_path: Path) -> Path:
    """Arch of seven voussoirs, which stands once its keystone is laid and not before."""
    return saved(tmp_path / "arch.json", samples.arch(voussoirs=7))


def test_an_arch_is_struck_when_its_keystone_is_laid(jld: Command, arch: Path, tmp_path: Path) -> None:
    """Props stand until the last stone closes the arch; the line names the step of the table."""
    out = tmp_path / "out"
    done = jld("assembly", arch, "--start", "springings", "--out", out, "--animation").done()
    table = pd.read_csv(out / "assembly.csv")
    needed = table["step"][table["props_N"] > 0.0]
    assert needed.max() == len(table) - 1 == 6
    assert table["stands"].iloc[-1] == "yes"
    assert dict(zip(table["stone"], table["block"], strict=True))[3] == "v2r0"
    assert f"centring     from step {needed.min()}, in turn below" in done.out
    assert "it may be struck after step 7" in done.out
    with Image.open(out / "assembly.gif") as animation:
        assert getattr(animation, "n_frames", 1) == len(table)


def test_a_stage_that_was_not_solved_keeps_the_centring(arch: Path) -> None:
    """Without props and without a proof the last stage does not free it."""
    assembly = build_assembly(load_scene(arch))
    laying = assembly_order(assembly, assembly.labels, start="springings")
    last = laying.steps[-1]
    assert "it may be struck after step 7" in words_of(laying)
    undecided = replace(last, stage=replace(last.stage, error=math.inf))
    words = words_of(replace(laying, steps=(*laying.steps[:-1], undecided)))
    assert "may be struck" not in words
    assert "that the finished structure stands without it is not proven" in words


def test_a_wall_needs_no_centring(jld: Command, tmp_path: Path) -> None:
    """Courses on the ground stand; the line of the centring is left out."""
    wall = saved(tmp_path / "wall.json", samples.wall(courses=2, length=0.8))
    done = jld("assembly", wall).done()
    assert "stands without props" in done.out
    assert "centring" not in done.out


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--animation"], "--animation: there is no folder"),
        (["--seconds", "-1"], "--seconds: -1 s are no time"),
        (["--seconds", "1e-9"], "--seconds: no order was found in 1e-09 s"),
    ],
)
def test_bad_options_are_one_line(jld: Command, arch: Path, flags: list[str], words: str) -> None:
    """Exit code 2, one line."""
    jld("assembly", arch, *flags).refused(words)


# Props along a line: levers, arches, words, table and refusals.


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
    stations = freedom_of_blocks.stations_below(assembly, 0.4 * scale)
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
    steps = assembly_order(assembly, dry, parts=Parts(assembly, freedom_of_blocks.stations_below(assembly, 0.4))).steps
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
    stations = freedom_of_blocks.stations_below(assembly, spacing)
    dry = np.ones(len(assembly.interfaces), dtype=bool)
    step = assembly_order(assembly, dry, parts=Parts(assembly, stations)).steps[0]
    weight = 2000 * 9.81 * 0.75 * 0.2
    places = stations.points[:, 0]
    lever = places[places <= 0.75].max() - 0.25
    assert lever == pytest.approx(1.25 - places[places >= 0.75].min(), rel=1e-9)
    assert float(step.stage.along.sum()) == pytest.approx(weight * 0.125 / lever, rel=1e-6)


def test_props_that_do_not_suffice_are_reported(jld: Command, tmp_path: Path) -> None:
    """One place below the crown holds no haunch before the keystone is laid: the rest stands beside it."""
    file = saved(tmp_path / "arch.json", samples.arch(voussoirs=7))
    done = jld("assembly", file, "--start", "springings", "--props", "100").done()
    assert "props along  1 place," in done.out
    assert "the places alone do not hold it" in done.out


def test_an_arch_on_a_line_of_props(jld: Command, tmp_path: Path) -> None:
    """Words, table and picture of an arch laid from both springings, which may be struck once it is closed."""
    file, out = tmp_path / "arch.json", tmp_path / "out"
    file.write_text(samples.arch(voussoirs=7).model_dump_json(exclude_defaults=True))
    done = jld("assembly", file, "--start", "springings", "--props", "0.2", "--out", out, "--stages").done()
    assert "props along" in done.out
    assert "it may be struck after step 7" in done.out
    table = pd.read_csv(out / "assembly.csv")
    for row in table.itertuples():
        parts = row.props_along.split() if isinstance(row.props_along, str) else []
        assert sum(float(part.split(":")[1]) for part in parts) == pytest.approx(row.props_N, rel=1e-3, abs=1e-6)
    assert (out / "stage-7.png").exists()


@pytest.mark.parametrize(
    ("spacing", "said"), [(0.0, "a spacing of 0 is wrong"), (float("nan"), "is wrong"), (1e-4, "at most 500 places")]
)
def test_bad_spacings_are_one_line(spacing: float, said: str) -> None:
    with pytest.raises(InputError, match=said):
        freedom_of_blocks.stations_below(build_assembly(corbel()), spacing)


def test_props_along_a_line_are_planar() -> None:
    with pytest.raises(InputError, match="planar"):
        freedom_of_blocks.stations_below(build_assembly(samples.vault()), 0.2)


def test_a_wall_on_its_footing_has_no_underside() -> None:
    """No shorter spacing would help: the line says so, and what to do."""
    with pytest.raises(InputError, match="stands on supports along its whole length"):
        freedom_of_blocks.stations_below(build_assembly(samples.wall(opening="1.0,0.4,0.6,0.4")), 0.1)


def test_forces_in_words_have_no_exponent() -> None:
    assert units.force_in_words(60241.0, "N") == "60.24 kN"
    assert units.force_in_words(999.5, "N") == "999.5 N"
    assert units.force_in_words(6e4, "apples") == "6e+04 apples"


@pytest.mark.parametrize("corners", [8, 60])
def test_the_shadow_of_a_solid_needs_few_planes(corners: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a convex solid passes along a direction is the same without the planes that do not bound it."""
    random = np.random.default_rng(corners)
    points = random.normal(size=(corners, 3))
    planes = np.unique(np.round(ConvexHull(points / np.linalg.norm(points, axis=1)[:, None]).equations, 12), axis=0)
    spots = random.uniform(-3.0, 3.0, size=(20_000, 3))
    for direction in (np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, -0.8]), np.ones(3) / np.sqrt(3.0)):
        found = []
        for most in (freedom_of_blocks._SIDES, 10**9):
            monkeypatch.setattr(freedom_of_blocks, "_SIDES", most)
            one = freedom_of_blocks._swept(planes, direction, np.zeros(3))
            found.append((len(one), (spots @ one[:, :3].T + one[:, 3]).max(axis=1) <= 0.0))
            monkeypatch.undo()
        (few, within), (many, same) = found
        assert np.array_equal(within, same)
        assert 0 < within.sum() < len(spots)
        assert few < (many / 4 if corners == 60 else many + 1)
