"""Joints that move: closed forms of optima, limits, ties, phase one, the command and its bad input."""

from __future__ import annotations

import csv
import itertools
import json
import math
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.claims import run as run_claim
from structures import HEIGHT, Document, block, flat_arch, flat_arch_load

from cases import grid_document
from command import Command, saved
from jld_core import Assembly, InputError, Status, build_assembly, geometry_sensitivities, parse_scene, samples, solve
from jld_geometry import (
    EqualShapes,
    GeometrySearch,
    MovedScene,
    TrustRegion,
    equal_corners,
    move_joints,
    spatial_mesh,
    vertex_mesh,
)
from jld_geometry.limits import spatial_residual_rates

TOPS = [{"at": [1.2, HEIGHT], "direction": [1, 0]}, {"at": [-1.2, HEIGHT], "direction": [-1, 0]}]
"""Paths of the tops of both springings of the flat arch."""


def moved(document: Document, **options: float | None) -> Any:
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    return move_joints(scene, assembly, assembly.labels, **options)


def half_width(done: Any) -> float:
    """Where the top of the right springing of the flat arch was moved to."""
    return float(done.places[np.argmin(np.linalg.norm(done.places - done.moved - [1.2, HEIGHT], axis=1)), 0])


def test_flat_arch_against_its_closed_form() -> None:
    """Steeper springings slide no longer; then hinges rule, and λ is that of (11.8) at the geometry found."""
    done = moved(flat_arch(10.0, 1.2, 0.2, along=TOPS, vertices="along", ties="mirror-x", box=0.15, angle=[20, 160]))
    assert done.start == pytest.approx(466.778615, rel=1e-8)
    assert done.value == pytest.approx(flat_arch_load(half_width(done), 0.2, 0.1), rel=1e-9)
    assert done.value > 3.5 * done.start
    assert done.parameters == 1
    assert {point.start for point in done.points} == {0}
    assert all(later.value > former.value for former, later in zip(done.points, done.points[1:], strict=False))
    # what is written is what was proven, with interfaces stated or found anew
    assert done.warnings == []
    assert solve(done.scene).load_factor == pytest.approx(done.value, rel=1e-9)
    found = {key: value for key, value in done.scene.model_dump(mode="json").items() if key != "interfaces"}
    assert solve(parse_scene(found)).load_factor == pytest.approx(done.value, rel=1e-6)
    # points of the key "move" went with their vertices: the written scene can be moved again
    again = GeometrySearch(done.scene, build_assembly(done.scene), done.before.labels if done.before else np.empty(0))
    assert again.variables.basis.shape[1] == 1


def test_an_unstable_start_is_made_to_stand() -> None:
    paths = [{**path, "at": [x, HEIGHT]} for path, x in zip(TOPS, (1.1, -1.1), strict=True)]
    keys = {"vertices": "along", "ties": "mirror-x", "angle": [20, 160], "box": 0.25}
    document = flat_arch(10.0, 1.1, 0.2, along=paths, **keys)
    done = moved(document)
    assert np.isnan(done.start)
    assert done.before is None
    assert done.value > 1500.0


def test_a_locked_end_is_named_and_ends_the_starts() -> None:
    """From a half width L/2 − B h/H_p of the key on, no thrust overturns the piers of (11.8): λ has no end.

    The time given is a day.
    """
    paths = [{"at": [s * 0.2, HEIGHT], "direction": [s, 0]} for s in (1, -1)]
    limits = {"vertices": "along", "ties": "mirror-x", "edge": 0.01, "angle": [5, 175]}
    done = moved(flat_arch(55.0, 1.2, 0.2, along=paths, **limits), seconds=86400.0, starts=None)
    assert {point.start for point in done.points} == {0}
    assert (done.end, done.value) == ("locked", np.inf)
    assert done.after.status is Status.LOCKED
    assert 0.2 + abs(done.moved).max() >= 1.0 - 1.0 * HEIGHT / 5.0


def test_starts_go_on_while_there_is_time() -> None:
    document = flat_arch(10.0, 1.2, 0.2, along=TOPS, vertices="along", ties="mirror-x", box=0.15, angle=[20, 160])
    begun = time.perf_counter()
    moved(document, seconds=600.0, starts=1)
    done = moved(document, seconds=3.0 + 4.0 * (time.perf_counter() - begun), starts=None)
    assert max(point.start for point in done.points) > 1
    assert done.value == pytest.approx(flat_arch_load(half_width(done), 0.2, 0.1), rel=1e-9)
    assert done.value == pytest.approx(max(point.value for point in done.points), rel=1e-6)


def test_least_friction_of_a_semicircle() -> None:
    """Joints that turn need less friction; the start is that of radial joints, (2/π) max h1 up to the pitch."""
    scene = samples.arch(voussoirs=24, thickness=0.2)
    document = json.loads(scene.model_dump_json(exclude_defaults=True))
    document["move"] = {"along": [{"circle": [0, 0]}], "maximise": "least_friction"}
    document["materials"]["dry"] = {"friction_coefficient": 0.5}
    assembly = build_assembly(parse_scene(document))
    search = GeometrySearch(parse_scene(document), assembly, assembly.labels)
    first = search.first()
    assert first is not None
    assert search.value_of(first) == pytest.approx(0.30899, rel=2e-5)
    assert search.value_of(first) == pytest.approx(0.30808, rel=5e-3)  # the closed form, without pitch
    below, above = (
        solve(parse_scene({**document, "materials": {"density": 2000, "dry": {"friction_coefficient": mu}}}))
        for mu in (0.999 * search.value_of(first), search.value_of(first))
    )
    assert (below.stands_at_zero, above.stands_at_zero) == (False, True)


def test_least_thickness_of_a_semicircle() -> None:
    """Radial joints, 28 voussoirs: t/R = 0.106710 (another program 0.106708); the point found stands, proven."""
    scene = samples.arch(voussoirs=28, thickness=0.12)
    document = json.loads(scene.model_dump_json(exclude_defaults=True))
    document["materials"]["dry"] = {"friction_coefficient": 0.8}
    document["move"] = {"along": [{"circle": [0, 0]}], "maximise": "least_thickness"}
    assembly = build_assembly(parse_scene(document))
    search = GeometrySearch(parse_scene(document), assembly, assembly.labels)
    first = search.first()
    assert first is not None
    assert search.value_of(first) == pytest.approx(0.106710, rel=2e-5)


def test_a_wall_reaches_the_bound_of_all_geometries() -> None:
    """λ ≤ μ for every cut that leaves the base joint: a wall pushed both ways that reaches it is proven best."""
    elements: list[Document] = [{"id": "g", "polygon": [[-1, -1], [2, -1], [2, 0], [-1, 0]], "support": True}]
    for course, cuts in enumerate(([0.0, 0.2, 0.4, 0.6], [0.0, 0.1, 0.3, 0.5, 0.6], [0.0, 0.2, 0.4, 0.6])):
        low, high = 0.2 * course, 0.2 * (course + 1)
        for k, (a, b) in enumerate(itertools.pairwise(cuts)):
            elements.append({"id": f"{course}.{k}", "polygon": [[a, low], [b, low], [b, high], [a, high]]})
    cases = [{"name": name, "live": [{"body": [sign, 0.0]}]} for name, sign in (("r", 1.0), ("l", -1.0))]
    materials = {"density": 1800.0, "dry": {"friction_coefficient": 0.6}}
    done = moved({"elements": elements, "materials": materials, "loads": {"cases": cases}})
    assert done.start < 0.55
    assert done.value == pytest.approx(0.6, rel=1e-5)
    # bed joints stay straight: the ends of the head joints in them lie on lines between their ends
    for level in (0.2, 0.4):
        bed = done.places[abs(done.places[:, 1] - done.moved[:, 1] - level) < 1e-9]
        line = np.polynomial.polynomial.polyfit(bed[:, 0], bed[:, 1], 1)
        assert abs(line[0] + line[1] * bed[:, 0] - bed[:, 1]).max() < 1e-8


def test_a_step_gains_what_its_program_predicts() -> None:
    """To first order the value of a step is there (11.6): gain over promise tends to at least one."""
    document = flat_arch(15.0, 1.2, 0.2, angle=[20, 160])
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    search = GeometrySearch(scene, assembly, assembly.labels)
    point = search.first()
    for radius in (1e-3, 1e-4):
        low, high = np.full(search.variables.count, -radius), np.full(search.variables.count, radius)
        answer = search.evaluator.step(point, low, high, "load_factor")
        target = search.restored(point.values + answer.change)
        assert target is not None
        new = search.evaluate(target, point)
        assert new.objective - point.objective >= (1.0 - 50.0 * radius) * (answer.value - point.objective)


def test_limits_are_kept() -> None:
    document = flat_arch(15.0, 1.2, 0.2, along=TOPS, ties="mirror-x", box=0.03, angle=[50, 130], straight=True)
    done = moved(document, seconds=2.0)
    assert abs(done.moved).max() <= 0.03 + 1e-9
    mirrored = done.places * [-1.0, 1.0]
    distance = np.linalg.norm(done.places[:, None] - mirrored[None], axis=2).min(axis=1)
    free = np.concatenate([np.array(element.polygon) for element in done.scene.elements or [] if not element.support])
    assert distance[np.isin(done.places[:, 0], free[:, 0])].max() < 1e-8


@pytest.mark.parametrize(
    ("move", "said"),
    [
        ({"along": [{"at": [-5.0, -5.0], "direction": [1, 0]}]}, "is a vertex of a support"),
        ({"along": [{"at": [0.3, 0.3], "direction": [1, 0]}]}, "no vertex lies at"),
        ({"ties": [[[1.2, HEIGHT], [1.0, 0.0]]], "along": [TOPS[0]], "vertices": "along"}, "no direction to move in"),
        ({"angle": [150, 30]}, "are no bounds"),
        ({"along": [{"circle": [0, 0], "at": [1, 1]}]}, "it is no path"),
        ({"draft": {"direction": [0, 0], "degrees": 5}}, "move.draft.direction: it has no length"),
        ({"draft": {"direction": [0, 1, 0], "degrees": 5}}, "move.draft.direction: it has 3 numbers"),
        ({"maximise": "least_thickness"}, "the thickness is that of an arch on circles"),
    ],
)
def test_bad_keys_are_one_line(move: Document, said: str, tmp_path: Path, jld: Command) -> None:
    file = saved(tmp_path / "arch.json", {**flat_arch(15.0, 1.2), "move": move})
    done = jld("move", file, "-o", tmp_path / "out.json")
    done.refused(said)
    assert [path.name for path in tmp_path.iterdir()] == ["arch.json"]
    assert jld("check", file).err == done.err


def test_ties_of_an_asymmetric_structure_contradict() -> None:
    document = flat_arch(15.0, 1.2, ties="mirror-x")
    document["elements"][1]["polygon"][3] = [1.3, HEIGHT]
    document["elements"][3]["polygon"][2] = [1.3, HEIGHT]
    with pytest.raises(InputError, match="nothing mirrors the vertex"):
        moved(document)


def test_the_command_writes_scene_table_and_picture(tmp_path: Path, jld: Command) -> None:
    file, out = tmp_path / "arch.json", tmp_path / "moved.json"
    file.write_text(json.dumps(flat_arch(15.0, 1.2, 0.2, along=TOPS, vertices="along", ties="mirror-x", box=0.05)))
    facts = json.loads(jld("move", file, "-o", out, "--json").out)
    assert facts["load_factor"] > facts["start"] > 0.0
    assert facts["bracket"][0] <= facts["load_factor"] <= facts["bracket"][1]
    assert solve(out).load_factor == pytest.approx(facts["load_factor"], rel=1e-9)
    with out.with_suffix(".csv").open() as table:
        rows = list(csv.DictReader(table))
    assert len(rows) == facts["steps"] + 1
    assert float(rows[-1]["bracket_lo"]) == pytest.approx(facts["load_factor"], rel=1e-6)
    assert out.with_suffix(".png").stat().st_size > 1000
    jld("move", file, "-o", file).refused()


def test_crackable_blocks_are_checked_by_fields(tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lower bounds by fields stand beside λ by faces; on the coarsest mesh here, to save time."""
    monkeypatch.setattr("jld_geometry.moving._FIELD_GAP", 10.0)
    paths = [{"at": [s * 1.2, HEIGHT], "direction": [s, 0]} for s in (1, -1)]
    document = flat_arch(15.0, 1.2, 0.2, along=paths, ties="mirror-x", vertices="along", box=0.05)
    document["materials"]["inner"] = {"tensile_strength": 3e5, "shear_strength": 5e5}
    document["labels"] = {"inner": [["pier left", "ground"], ["pier right", "ground"]]}
    file = saved(tmp_path / "arch.json", document)
    facts = json.loads(jld("move", file, "-o", tmp_path / "out.json", "--json").out)
    assert facts["fields"]["skipped"] is None
    assert min(facts["fields"]["before"], facts["fields"]["after"]) > 0.0
    gains = facts["fields"]["after"] > facts["fields"]["before"]
    assert [("gain nothing" in sentence) for sentence in facts["warnings"]] == ([] if gains else [True])


def test_elements_of_equal_shape_stay_equal() -> None:
    """Wedges and piers of a flat arch are mirror images: kept equal, its optimum is that of the mirrored one, (11.8).

    Loads beside the middle would have them differ, by more than is gained when they have to be equal.
    """
    keys = {"vertices": "along", "box": 0.15, "angle": [20, 160], "along": TOPS}
    alike = moved(flat_arch(10.0, 1.2, 0.2, ties="equal-shapes", **keys))
    assert alike.parameters == 2
    tops = np.sort(alike.places[abs(abs(alike.places - alike.moved) - [1.2, HEIGHT]).max(axis=1) < 1e-9][:, 0])
    assert tops[0] == pytest.approx(-tops[1], rel=1e-8)
    assert alike.value == pytest.approx(flat_arch_load(float(tops[1]), 0.2, 0.1), rel=1e-8)
    beside = flat_arch(10.0, 1.2, 0.2, ties="equal-shapes", **keys)
    beside["loads"]["live"][0] |= {"element": "wedge right", "at": [0.6, HEIGHT]}
    free = {**beside, "move": {**beside["move"], "ties": "none"}}
    tied, loose = moved(beside), moved(free)
    assert tied.start < tied.value < loose.value
    polygons = {one.id: np.array(one.polygon) for one in tied.scene.elements or []}
    for name in ("wedge", "pier"):
        left, right = (polygons[f"{name} {side}"] for side in ("left", "right"))
        edges = [np.sort(np.linalg.norm(np.roll(one, -1, axis=0) - one, axis=1)) for one in (left, right)]
        assert edges[0] == pytest.approx(edges[1], rel=1e-8)


def test_equal_shapes_recognise_turned_and_mirrored_outlines() -> None:
    """An L turned, mirrored, and a longer one: the first two are equal to it, corner by corner; the third is not."""
    shape = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2]], dtype=float)
    turned = shape @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + [10.0, 0.0]
    longer = shape + np.array([[0, 20], [0.01, 20], [0.01, 20], [0, 20], [0, 20], [0, 20]])
    places = np.concatenate([shape, turned, shape * [-1.0, 1.0] - [5.0, 0.0], longer])
    outlines = [np.arange(6), 6 + np.roll(np.arange(6), 2), 12 + np.arange(6)[::-1], 18 + np.arange(6)]
    pairs = equal_corners(outlines, places, np.ones(4, dtype=bool))
    assert [other.tolist() for _, other in pairs] == [list(range(6, 12)), list(range(12, 18))]
    assert equal_corners(outlines, places, np.array([False, False, False, True])) == []
    equations = EqualShapes(pairs, places)
    random = np.random.default_rng(1)
    shaken, way = places + 0.1 * random.normal(size=places.shape), random.normal(size=places.shape)
    _, slopes = equations.at(shaken)
    differences = (equations.at(shaken + 1e-6 * way)[0] - equations.at(shaken - 1e-6 * way)[0]) / 2e-6
    assert slopes @ way.ravel() == pytest.approx(differences, rel=1e-7)
    assert equations.at(shaken @ np.array([[0.6, 0.8], [-0.8, 0.6]]))[0] == pytest.approx(equations.at(shaken)[0])


def test_robust_values_are_those_of_the_low_material(tmp_path: Path, jld: Command) -> None:
    """With friction of 10° and a low one of 8°, every λ is that of 8°; with the nominal one λ is larger."""
    keys = {"ties": "mirror-x", "vertices": "along", "box": 0.04, "angle": [20, 160]}
    spread = flat_arch(10.0, 1.2, 0.2, along=TOPS, **keys)
    spread["materials"]["dry"] = {"friction_angle": {"nominal": 10.0, "low": 8.0}}
    file, out = tmp_path / "arch.json", tmp_path / "moved.json"
    file.write_text(json.dumps(spread))
    facts = json.loads(jld("move", file, "-o", out, "--robust", "--json").out)
    alone = moved(flat_arch(8.0, 1.2, 0.2, along=TOPS, **keys))
    assert facts["load_factor"] == pytest.approx(alone.value, rel=1e-7)
    assert facts["load_factor_nominal"] > facts["load_factor"]
    again = json.loads(jld("solve", out, "--robust", "--json").out)
    assert again["load_factor"] == pytest.approx(facts["load_factor"], rel=1e-7)
    for options, said in ((["--prove=0.05"], "nominal values"), (["--joint", "sine:0.05,2"], "nominal values")):
        jld("move", file, "-o", tmp_path / "no.json", "--robust", *options).refused(said)
    file.write_text(json.dumps(flat_arch(10.0, 1.2, 0.2)))
    assert "has a low one" in jld("move", file, "-o", tmp_path / "no.json", "--robust").err


def test_nothing_to_move(tmp_path: Path, jld: Command) -> None:
    file = saved(tmp_path / "block.json", block(1.0, 1.0))
    assert "no vertex of a joint can move" in jld("move", file, "-o", tmp_path / "out.json").err


@pytest.mark.parametrize("passive", [0.0, 0.33])
def test_fill_and_members_are_refused_in_one_line(passive: float, tmp_path: Path, jld: Command) -> None:
    """Neither has loads or points that move with joints; nothing is written."""
    file = tmp_path / "arch.json"
    fill = {"level": 2.0, "density": 1800.0, "friction_angle": 0.0, "active": 0.0, "passive": passive}
    ends = [{"element": f"pier {side}", "at": [x, -1.0]} for side, x in (("left", -1.5), ("right", 1.5))]
    tie = {"kind": "tie", "from": ends[0], "to": ends[1], "tension": 1.0}
    for more, said in (({"fill": fill}, "fill: "), ({"members": [tie]}, "members: a move of joints")):
        file.write_text(json.dumps({**flat_arch(20.0, 1.2, 0.2), **more}))
        jld("move", file, "-o", tmp_path / "out.json").refused(said)
        assert [path.name for path in tmp_path.iterdir()] == ["arch.json"]


# Vertices of inner faces that follow joints, and loads that keep the width on which they act.


ROWS = ["aab", "aab", "###"]
"""A block of four cells beside one of two, on a ground that stays."""


def moved_to_follow(inner: str, **move: object) -> Any:
    document = {**grid_document(ROWS, friction=0.9, tension=3e5, shear=5e5), "move": {"inner": inner, **move}}
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    return move_joints(scene, assembly, assembly.labels)


def at(done: Any, x: float, y: float) -> np.ndarray:
    """Movement of the vertex that was at a point."""
    start = done.places - done.moved
    return np.asarray(done.moved[np.argmin(np.linalg.norm(start - [x, y], axis=1))])


def test_vertices_without_joints_follow_their_neighbours() -> None:
    """The middle of the four cells moves as the mean of its neighbours, vertices on the outline along it."""
    done = moved_to_follow("follow")
    assert done.value > 1.05 * done.start
    neighbours = [at(done, *point) for point in ((0.0, 0.2), (0.2, 0.2), (0.1, 0.1), (0.1, 0.3))]
    assert at(done, 0.1, 0.2) == pytest.approx(np.mean(neighbours, axis=0), abs=1e-9)
    assert np.linalg.norm(at(done, 0.1, 0.2)) > 1e-3
    assert at(done, 0.0, 0.2)[0] == pytest.approx(0.0, abs=1e-12)
    assert at(done, 0.1, 0.1) == pytest.approx(np.zeros(2), abs=1e-12)


def test_vertices_of_inner_faces_stay_by_default() -> None:
    """Without the key only the upper end of the joint between both blocks, which no inner face touches, is free."""
    done = moved_to_follow("stay")
    still = np.linalg.norm(done.moved, axis=1) == 0.0
    start = (done.places - done.moved)[~still]
    assert start == pytest.approx(np.array([[0.2, 0.3]]), abs=1e-9)


def test_a_load_keeps_the_width_on_which_it_acts() -> None:
    """The edge under a patch reaches half its width beyond the place of the force."""
    push = [{"element": "c2r0", "force": [1.0, -1.0], "at": [0.26, 0.3], "width": 0.06}]
    document = {**grid_document(ROWS, friction=0.9, live=push), "move": {"inner": "follow", "edge": 0.01}}
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    search = GeometrySearch(scene, assembly, assembly.labels)
    places = search.variables.start.copy()
    end = int(np.argmin(np.linalg.norm(places - [0.2, 0.3], axis=1)))
    places[end, 0] = 0.23
    limits = search.evaluator.limits
    assert limits.at(places).values.min() >= -1e-9
    places[end, 0] = 0.2301
    lacks = limits.least - limits.at(places).values
    assert lacks.max() == pytest.approx(1e-4 / assembly.size, rel=1e-6)


def test_an_unknown_choice_is_refused() -> None:
    with pytest.raises(InputError, match=r"move\.inner"):
        moved_to_follow("run")


# Joints that move in space: closed form, derivatives, limits, the command and what is refused.


def extruded(document: Document, depth: float = 1.0, **move: Any) -> Document:
    """A planar scene as a spatial one: x, y become x, z, and y runs over its depth."""
    elements = []
    for entry in document["elements"]:
        outline = np.array(entry["polygon"], dtype=float)
        turn = np.roll(outline, -1, axis=0)
        if (outline[:, 0] * turn[:, 1] - turn[:, 0] * outline[:, 1]).sum() < 0.0:
            outline = outline[::-1]
        count = len(outline)
        front = [[x, 0.0, z] for x, z in outline.tolist()]
        back = [[x, depth, z] for x, z in outline.tolist()]
        sides = [[k, (k + 1) % count, count + (k + 1) % count, count + k] for k in range(count)]
        faces = [list(range(count)), list(range(2 * count - 1, count - 1, -1)), *[side[::-1] for side in sides]]
        kept = {key: value for key, value in entry.items() if key != "polygon"}
        elements.append({**kept, "vertices": [*front, *back], "faces": faces})
    live = [
        {**load, "force": [load["force"][0], 0.0, load["force"][1]], "at": [load["at"][0], 0.5 * depth, load["at"][1]]}
        for load in document["loads"]["live"]
    ]
    rest = {key: value for key, value in document.items() if key not in ("elements", "loads", "move")}
    return {**rest, "elements": elements, "loads": {"live": live}, "move": move}


def strip(**move: Any) -> Document:
    """A strip of a barrel vault of six voussoirs, under a load at a quarter."""
    scene = samples.vault(voussoirs=6, courses=1, length=1.0, load="quarter", springing=20.0)
    return {**json.loads(scene.model_dump_json(exclude_defaults=True)), "move": move}


def search_of(document: Document) -> GeometrySearch:
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    return GeometrySearch(scene, assembly, assembly.labels)


def test_flat_arch_against_its_closed_form_in_space() -> None:
    """Corners of the springings slide, in planes that stay plane: λ is that of (11.8), as in the plane."""
    along = [{"at": [s * 1.2, y, HEIGHT], "direction": [s, 0, 0]} for s in (1, -1) for y in (0.0, 1.0)]
    document = extruded(flat_arch(10.0, 1.2, 0.2), along=along, vertices="along", ties="mirror-x", box=0.15)
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    done = move_joints(scene, assembly, assembly.labels)
    tops = done.places[abs(done.places[:, 2] - HEIGHT) < 1e-9]
    inner = np.sort(np.unique(np.round(tops[(tops[:, 0] > 0.9) & (tops[:, 0] < 1.9), 0], 9)))
    assert len(inner) == 1
    assert done.start == pytest.approx(466.778615, rel=1e-6)
    assert done.value == pytest.approx(flat_arch_load(float(inner[0]), 0.2, 0.1), rel=1e-6)
    assert done.value > 3.5 * done.start
    assert solve(done.scene).load_factor == pytest.approx(done.value, rel=1e-6)
    again = GeometrySearch(done.scene, build_assembly(done.scene), assembly.labels)
    assert again.variables.count == 4


def test_rates_of_the_residual_are_those_of_the_load_factor() -> None:
    """−u · ∂(A F + b + λ b_λ) is dλ of (11.5), for forces chosen with the mechanism."""
    search = search_of(strip())
    point = search.first()
    result = point.result
    assert result.forces is not None
    mesh = spatial_mesh(result.assembly)
    every = np.ones(len(mesh.places), dtype=bool)
    args = (result.assembly, mesh, result.forces, result.load_factor, result.mechanism, every)
    velocity = result.mechanism[result.assembly.elements.free].ravel()
    rates = -(velocity @ spatial_residual_rates(*args)).reshape(-1, 3)
    found = geometry_sensitivities(result)
    assert rates == pytest.approx(found.derivative, abs=1e-6 * abs(found.derivative).max())


def test_a_small_step_gains_what_its_program_predicts() -> None:
    """To first order the gain is at least what was promised; more where other forces see more, as at a kink."""
    search = search_of(strip())
    point = search.first()
    for radius, within in ((1e-3, 3e-2), (1e-4, 3e-3)):
        new, predicted = search._try(point, radius * search.unit)
        assert predicted > (1.0 + radius) * point.objective
        assert new.objective - point.objective > (1.0 - within) * (predicted - point.objective)


def test_joints_stay_plane_within_their_limits() -> None:
    """A few steps: every joint plane, moves within the box, masses within their bounds, alike where they are tied."""
    mass = build_assembly(parse_scene(strip())).elements.mass
    most = 1.1 * float(mass.max())
    corners = spatial_mesh(build_assembly(parse_scene(strip()))).places
    joint = corners[abs(corners[:, 0]) < 1e-9]
    scene = parse_scene(strip(box=0.08, block_mass=[0.5 * float(mass[mass > 0].min()), most], edge=0.1))
    assembly = build_assembly(scene)
    done = move_joints(scene, assembly, assembly.labels, trust=TrustRegion(points=4))
    assert done.value > 1.2 * done.start
    assert done.parameters == 20
    after = build_assembly(done.scene)
    for polygon in after.interfaces.polygon:
        flat = polygon - polygon.mean(axis=0)
        assert np.linalg.svd(flat)[1][-1] <= 1e-7 * abs(flat).max()
    assert abs(done.moved).max() <= 0.08 + 1e-9
    assert after.elements.mass.max() <= most * (1.0 + 1e-8)
    ties = [joint[np.argsort(joint[:, 2])[:2]].tolist()]
    tied = search_of(strip(ties=ties))
    assert tied.variables.basis.shape[1] == 19


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"move": {"angle": [20, 160]}}, "no meaning in space"),
        ({"move": {"draft": {"direction": [0, 0, 1], "degrees": 5}}}, "no meaning in space"),
        ({"move": {"maximise": "least_friction"}}, "is for planar arches"),
        ({"move": {"along": [{"circle": [0, 0]}]}}, "circles are for planar scenes"),
        ({"move": {"along": [{"at": [0, 0], "direction": [0, 1]}]}}, "it has 2 numbers"),
        ({"move": {"along": [{"at": [0, 0, 9], "direction": [0, 0, 1]}]}}, "no vertex lies at"),
        ({"move": {"vertices": "along"}}, "no corner of a joint can move"),
        ({"cohesion": 100.0}, ") is unknown to joints that move in space"),
    ],
)
def test_scenes_whose_joints_cannot_move_are_refused_in_one_line(
    change: Document, said: str, tmp_path: Path, jld: Command
) -> None:
    document = strip(**change.get("move", {}))
    if "cohesion" in change:
        document["materials"]["dry"] = {**document["materials"]["dry"], "cohesion": change["cohesion"]}
    file = saved(tmp_path / "vault.json", document)
    jld("move", file, "-o", tmp_path / "out.json").refused(said)
    assert [path.name for path in tmp_path.iterdir()] == ["vault.json"]


def test_proofs_and_searches_of_labels_are_planar(tmp_path: Path, jld: Command) -> None:
    file = saved(tmp_path / "vault.json", strip())
    assert "it bounds planar structures alone" in jld("move", file, "-o", tmp_path / "out.json", "--prove=0.1").err


def test_the_command_writes_scene_table_and_picture_in_space(
    tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, out = tmp_path / "vault.json", tmp_path / "moved.json"
    file.write_text(json.dumps(strip(box=0.03)))
    # two points, however long they take
    monkeypatch.setattr("jld_geometry.moving.move_joints", partial(move_joints, trust=TrustRegion(points=2)))
    facts = json.loads(jld("move", file, "-o", out, "--json").out)
    assert facts["load_factor"] > facts["start"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["moved.csv", "moved.json", "moved.png", "vault.json"]
    assert json.loads(jld("solve", out, "--json").out)["load_factor"] == pytest.approx(facts["load_factor"], rel=1e-6)


# Derivatives of λ by vertices: closed forms, fourth-order differences, and one-sided values at kinks.


def rates_of(document: Document) -> Any:
    found = geometry_sensitivities(solve(parse_scene(document)))
    assert found is not None
    return found


def rate_at(found: Any, *points: tuple[float, float]) -> np.ndarray:
    """Derivatives at the vertices at given points."""
    distance = np.linalg.norm(found.vertices[:, None] - np.array(points), axis=2)
    assert distance.min(axis=0).max() < 1e-9
    return found.derivative[np.argmin(distance, axis=0)]


def test_a_rocking_block() -> None:
    """λ = b/h: both right-hand vertices move by 1/h, both upper ones by −b/h²."""
    b, h = 0.6, 1.5
    found = rates_of(block(b, h))
    assert rate_at(found, (b, 0.0), (b, h))[:, 0].sum() == pytest.approx(1.0 / h, rel=1e-9)
    assert rate_at(found, (0.0, h), (b, h))[:, 1].sum() == pytest.approx(-b / h**2, rel=1e-9)


def test_a_block_pushed_up_a_slope() -> None:
    """λ = tan(φ + α), by (2.4): its derivative by α is 1/cos²(φ + α), whatever the outline of the block."""
    b, lean, friction = 1.0, 0.2, 0.4
    found = rates_of(block(b, 0.1, friction=friction, lean=lean))
    alpha, phi = math.atan2(lean, b), math.atan(friction)
    normal = np.array([-math.sin(alpha), math.cos(alpha)])
    by_angle = rate_at(found, (b, lean))[0] @ normal * math.hypot(b, lean)
    assert by_angle == pytest.approx(1.0 / math.cos(phi + alpha) ** 2, rel=1e-9)


def test_a_glued_block_that_shears() -> None:
    """λ = τ b t/W = τ/(γ h): nothing by the width, −λ/h by the height; the term D_f/l_f of (11.1) counts."""
    b, h = 1.0, 0.2
    found = rates_of(block(b, h, label="inner"))
    load_factor = 3e3 / (1000.0 * 9.81 * h)
    assert rate_at(found, (b, 0.0), (b, h))[:, 0].sum() == pytest.approx(0.0, abs=1e-9 * load_factor)
    assert rate_at(found, (0.0, h), (b, h))[:, 1].sum() == pytest.approx(-load_factor / h, rel=1e-9)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long), 7, 19])
def test_derivatives_agree_with_differences(seed: int) -> None:
    """Four of the scenes of the claim `vertex_rates`: all yield terms, crushing (7), and space (19)."""
    tally = run_claim("vertex_rates", seed, 1, 600.0)
    assert tally.disagreements == []
    assert sum(count for name, count in tally.notes.items() if name.startswith("smooth")) == 1


def lies_between(assembly: Assembly, places: np.ndarray, vertex: int, axis: int, step: float) -> float:
    """λ after one vertex of an all dry arch moved."""
    mesh = vertex_mesh(assembly)
    moved = MovedScene(SYMMETRIC, assembly, assembly.labels, mesh)
    shifted = places.copy()
    shifted[vertex, axis] += step
    return solve(build_assembly(moved.at(shifted))).load_factor


SYMMETRIC = samples.arch(voussoirs=8, thickness=0.2, load="crown")


def test_both_sides_of_a_kink() -> None:
    """A symmetric arch under a load at its crown falls in two mirrored ways: each side has a rate of its own."""
    assembly = build_assembly(SYMMETRIC)
    result = solve(assembly)
    found = geometry_sensitivities(result)
    kinks = np.argwhere(np.isnan(found.derivative))
    assert len(kinks)
    for vertex, axis in kinks[:3].tolist():
        for step, rate in ((1e-6, found.right), (-1e-6, found.left)):
            chord = (lies_between(assembly, found.vertices, vertex, axis, step) - result.load_factor) / step
            assert chord == pytest.approx(rate[vertex, axis], abs=1e-4 * np.nanmax(abs(found.right)))


def test_where_mechanisms_differ_and_the_rate_does_not() -> None:
    """A course that lags behind a sliding wall: one mechanism of many has a rate, λ = μ has none."""
    rows = ["aab", "cbb", "###"]
    materials = {"density": 2000, "dry": {"friction_coefficient": 0.6}}
    materials["inner"] = {"tensile_strength": 1e4, "shear_strength": 2e4}
    grid = {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows}
    found = rates_of({"grid": grid, "materials": materials, "loads": {"live": [{"body": [1, 0]}]}})
    assert rate_at(found, (0.1, 0.2))[0] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_governing_case_over_its_required_factor() -> None:
    document = block(0.6, 1.5)
    live = document["loads"].pop("live")
    easy = [{"body": [0.1, 0.0]}]
    document["loads"]["cases"] = [{"name": "a", "live": easy}, {"name": "b", "live": live, "required": 2.0}]
    assert rate_at(rates_of(document), (0.6, 0.0), (0.6, 1.5))[:, 0].sum() == pytest.approx(0.5 / 1.5, rel=1e-9)


def test_other_models_have_none() -> None:
    assert geometry_sensitivities(solve(parse_scene(block(0.6, 1.5)), friction="zero-dilation")) is None


def test_in_the_output_of_solve(tmp_path: Path, jld: Command) -> None:
    file = saved(tmp_path / "block.json", block(0.6, 1.5))
    rates = json.loads(jld("solve", file, "--out", tmp_path / "out", "--json").out)["geometry_sensitivities"]
    assert np.array(rates["vertices"]).shape == np.array(rates["derivative"]).shape
    assert (tmp_path / "out" / "vertices.png").exists()
