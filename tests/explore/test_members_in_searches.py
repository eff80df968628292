"""Members in searches, proofs, files and pages; and the one line of every computation that does not model them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from benchmarks.claims import run as run_claim

from cases import dry_and_inner, every_layout, grid_document
from command import saved
from jld_core import InputError, Layout, SolveOptions, Status, build_assembly, parse_scene, solve
from jld_core.models import solve_by_fields
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers import DRIVERS
from jld_explore.evaluation import EvaluatorSettings, evaluator_of
from jld_explore.space import from_string
from jld_explore.verification import verify
from jld_formats import export
from jld_views import page_contract

Document = dict[str, Any]

STRAP = {
    "kind": "tie",
    "name": "strap",
    "from": {"element": "c1r0", "at": [1.8, 2.8]},
    "to": {"element": "c1r2", "at": [1.8, 0.5]},
    "tension": 2e4,
}
"""Vertical tie at the right side of the wall, from its top to the ground."""


def wall(members: list[Document], **more: Any) -> Document:
    return {
        "name": "wall",
        "grid": {"cell": [1, 1], "thickness": 1.0, "rows": ["ab", "cd", "##"]},
        "materials": dry_and_inner(1000, 0.7, 2e3, 4e3),
        "loads": {"live": [{"body": [1, 0]}]},
        "members": members,
        "search": {"block_cells": [1, 2]},
        **more,
    }


def searched(document: Document, out: Path, driver: str, **options: Any) -> dict[str, Any]:
    explore(parse_scene(document), out=out, driver=driver, seconds=30, seed=1, **options)
    return dict(json.loads((out / "summary.json").read_text()))


@pytest.mark.sampled(2)
@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("driver", sorted(DRIVERS))
def test_strongest_layout_changes_with_the_tie(driver: str, tmp_path: Path) -> None:
    """Seven layouts: without the tie one with two joined pairs is proven best, with it one with a single pair."""
    budget = {} if driver in ("enumeration", "exact") else {"budget": 7}
    found = searched(wall([STRAP]), tmp_path / "tied", driver, **budget)
    assert found["best_labelling"] == "iddddd"
    assert found["best"] == pytest.approx(0.9432084, rel=1e-6)
    table = pd.read_csv(tmp_path / "tied" / "results.csv")
    faces = pd.read_csv(tmp_path / "tied" / "faces.csv")
    assert len(faces) == 6
    assert (table["labelling"].str.len() == 6).all()
    if driver in ("enumeration", "exact"):
        assert found["proven"]
        plain = searched(wall([]), tmp_path / "plain", driver)
        assert plain["proven"]
        assert plain["best_labelling"] == "iddidd"
        assert plain["best"] == pytest.approx(0.7, rel=1e-6)


@pytest.mark.usefixtures("without_pictures")
def test_proof_with_members_is_certified_and_verified(tmp_path: Path) -> None:
    """A pin, a tie and a tendon: the certificate weighs what they dissipate, and fails without them."""
    ends = {"from": {"element": "c0r0", "at": [0.4, 2.8]}, "to": {"element": "c0r2", "at": [0.5, 0.5]}}
    over = [{"element": "c0r1", "at": [0.3, 1.2]}]
    base = {"from": {"element": "c0r1", "at": [0.5, 1]}, "to": {"element": "c0r2", "at": [0.5, 1]}}
    members = [
        STRAP,
        {"kind": "pin", **base, "shear": 2e3},
        {"kind": "tendon", "name": "rod", **ends, "through": over, "prestress": 500.0, "tension": 3e3},
    ]
    file = tmp_path / "proof"
    found = searched(wall(members), tmp_path / "out", "exact", certificate=file)
    assert found["proven"]
    assert found["proof_check"]["passed"]
    done = verify(file)
    assert found["best"] <= float(done.claim.bound) <= found["best"] * (1 + 1e-5)
    lines = file.read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if '"members"' in line)
    lines[head] = lines[head].replace("20000.0", "10000.0")
    file.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError):
        verify(file)


@pytest.mark.usefixtures("without_pictures")
def test_required_factor_and_load_cases_with_members(tmp_path: Path) -> None:
    """The tie holds under the push to the left only; λ of a row is the least of both cases."""
    pushes = (("r", 1, 1.0), ("l", -1, 0.5))
    cases = {"cases": [{"name": k, "live": [{"body": [x, 0]}], "required": r} for k, x, r in pushes]}
    document = wall([STRAP], loads=cases, search={"block_cells": [1, 2], "require": {"load_factor": 0.9}})
    found = searched(document, tmp_path / "out", "exact")
    scene = parse_scene(document)
    best = solve(build_assembly(scene), found["require"]["best_labelling"])
    assert best.load_factor >= 0.9 - 1e-6
    table = pd.read_csv(tmp_path / "out" / "results.csv")
    assert found["require"]["met"] == int(table["meets"].sum())


def test_symmetry_needs_members_that_are_symmetric() -> None:
    down = {"live": [{"element": "c0r0", "force": [0, -1]}, {"element": "c1r0", "force": [0, -1]}]}
    ends = {"from": {"element": "c0r0", "at": [0.2, 2.8]}, "to": {"element": "c0r2", "at": [0.2, 0.5]}}
    other = {**STRAP, "name": "other", **ends}
    for held, size in (([], 2), ([STRAP], 1), ([STRAP, other], 2), ([STRAP, {**other, "tension": 1e4}], 1)):
        scene = parse_scene(wall(held, loads=down))
        assert len(search_space(scene, build_assembly(scene)).group) == size


def test_page_and_pictures_show_members(tmp_path: Path) -> None:
    from pydantic import TypeAdapter

    from jld_views import figures, page_data

    scene = parse_scene(wall([STRAP]))
    assembly = build_assembly(scene)
    result = solve(assembly)
    _, axes = figures.figure_for(assembly, 2)
    assert len(figures.draw_forces(axes[0], result)["members"]) == 2  # a line and its force
    assert len(figures.draw_mechanism(axes[1], result)["members"]) == 1
    data = page_data.page_data(kind="report", scene=scene, assembly=assembly, candidates=assembly.free_faces, facts={},
                     solutions={0: page_data.solution_of(result)})  # fmt: skip
    TypeAdapter(page_contract.PageData).validate_python(data)
    assert [one["name"] for one in data["structure"]["members"]] == ["strap"]
    case = data["solutions"]["0"]["cases"][0]
    assert case["members"] == pytest.approx([2e4], rel=1e-5)
    assert len(case["forces"]) == len(data["structure"]["faces"]) == 6


def test_refined_scene_keeps_its_members() -> None:
    from jld_core.refinement import refine

    scene = parse_scene(wall([STRAP], labels={"default": "dry"}))
    fine = refine(scene, (0.5, 0.5)).scene
    assert [one.from_.element for one in fine.members] == ["c1r0.3"]
    whole, cut = solve(build_assembly(scene)), solve(build_assembly(fine))
    assert cut.load_factor <= whole.load_factor * (1 + 1e-6)
    assert len(build_assembly(fine).members) == 1


# --- what does not model them ---------------------------------------------------------------------------------


def _fields() -> None:
    solve_by_fields(build_assembly(parse_scene(wall([STRAP], cracks={"kind": "fields", "gap": 0.5}))))


def _experiment() -> None:
    from jld_experiment import run_experiment

    assembly = build_assembly(parse_scene(wall([STRAP])))
    run_experiment(assembly, assembly.labels)


def _sequence() -> None:
    from jld_practice.laying import assembly_order

    assembly = build_assembly(parse_scene(wall([STRAP])))
    assembly_order(assembly, assembly.labels)


def _wish() -> None:
    scene = parse_scene(wall([STRAP], search={"assemble": "translation"}))
    search_space(scene, build_assembly(scene)).can_be_laid(np.ones((1, 7), dtype=bool))


def _void() -> None:
    scene = parse_scene(wall([STRAP], search={"segmentation": True, "void": {"cells": ["c0r0"], "most": 0.3}}))
    search_space(scene, build_assembly(scene))


def _settlement() -> None:
    from jld_core.build import loads
    from jld_practice.reactions import settle

    down = [{"name": "s", "supports": [{"elements": ["c0r2"], "move": [0, -1]}]}]
    scene = parse_scene(wall([STRAP], settlements=down))
    assembly = build_assembly(scene)
    settle(assembly, loads.settlements_of(scene, assembly)[0])


def _thrust() -> None:
    from jld_practice.reactions import thrust_ranges

    thrust_ranges(build_assembly(parse_scene(wall([STRAP]))))


def _move() -> None:
    from jld_geometry import GeometrySearch

    scene = parse_scene(wall([STRAP]))
    assembly = build_assembly(scene)
    GeometrySearch(scene, assembly, assembly.labels)


def _export() -> None:
    scene = parse_scene(wall([STRAP]))
    assembly = build_assembly(scene)
    export(Layout(scene, assembly, assembly.labels), "3dec", "unwritten.dat")


@pytest.mark.parametrize(
    "use",
    [_fields, _experiment, _sequence, _wish, _void, _settlement, _thrust, _move, _export],
    ids=lambda use: use.__name__,
)
def test_members_are_refused_in_one_line(use: Callable[[], None]) -> None:
    words = r"members: .* does not model them \('strap'\); expected a scene without members"
    with pytest.raises(InputError, match=words):
        use()


@pytest.mark.parametrize("command", ["thrust", "settlement", "assembly", "experiment"])
def test_commands_end_with_two_and_name_the_file(command: str, tmp_path: Path, jld: Callable[..., Any]) -> None:
    down = [{"name": "s", "supports": [{"elements": ["c0r2"], "move": [0, -1]}]}]
    file = saved(tmp_path / "wall.json", wall([STRAP], settlements=down))
    done = jld(command, str(file))
    assert (done.code, done.out) == (2, "")
    said = [line for line in done.err.splitlines() if "warning" not in line]
    assert len(said) == 1
    assert said[0].startswith(f"jld: {file}: members: ")


@pytest.mark.usefixtures("without_pictures")
def test_random_wall_of_the_claim() -> None:
    """One of the scenes of the claim `members`, with a certificate."""
    tally = run_claim("members", 8, 1, 600.0)
    assert tally.disagreements == []
    assert "not proven" not in tally.notes


# Fill in searches, proofs and certificates, and the one line of every computation that does not model it.


def arch(fill: dict[str, Any] | None, **more: Any) -> dict[str, Any]:
    """A ring of two courses, three pieces each, on two supports; weak blocks of at most two cells."""
    angles = [math.pi * (0.05 + 0.9 * k / 3) for k in range(4)]
    radii = [1.0, 1.12, 1.24]

    def piece(name: str, course: int, one: float, two: float, **keys: Any) -> dict[str, Any]:
        corners = [(radii[course], one), (radii[course + 1], one), (radii[course + 1], two), (radii[course], two)]
        return {"id": name, "polygon": [[-r * math.cos(a), r * math.sin(a)] for r, a in corners][::-1], **keys}

    elements = [
        piece(f"r{course}v{k}", course, one, two) for course in (0, 1) for k, (one, two) in enumerate(pairwise(angles))
    ]
    for side, one, two in (("left", 0.0, angles[0]), ("right", angles[-1], math.pi)):
        elements += [piece(f"{side}{course}", course, one, two, support=True) for course in (0, 1)]
    return {
        "name": "arch",
        "elements": elements,
        "materials": dry_and_inner(2000, 0.7, 1e5, 2e5),
        "loads": {"live": [{"element": "r1v0", "force": [0, -1e3], "at": [-0.6, 1.08]}]},
        "search": {"block_cells": [1, 2]},
        **({} if fill is None else {"fill": fill}),
        **more,
    }


SOIL = {"level": 1.5, "density": 1800.0, "friction_angle": 30.0, "passive": 1.0}


def searched_fill_in_searches(document: dict[str, Any], out: Path, driver: str, **options: Any) -> dict[str, Any]:
    explore(parse_scene(document), out=out, driver=driver, seconds=30, seed=1, **options)
    return dict(json.loads((out / "summary.json").read_text()))


@pytest.mark.usefixtures("without_pictures")
def test_proof_with_fill_is_that_of_the_enumeration_and_verified(tmp_path: Path) -> None:
    listed = searched_fill_in_searches(arch(SOIL), tmp_path / "all", "enumeration")
    file = tmp_path / "proof"
    proven = searched_fill_in_searches(arch(SOIL), tmp_path / "exact", "exact", certificate=file)
    assert proven["proven"]
    assert listed["proven"]
    assert proven["best"] == pytest.approx(listed["best"], rel=1e-6)
    assert proven["best"] <= float(verify(file).claim.bound) <= proven["best"] * (1 + 1e-5)
    plain = searched_fill_in_searches(arch(None), tmp_path / "plain", "enumeration")
    assert plain["best"] < 0.5 * listed["best"]


def test_fill_without_variable_pressure_is_a_dead_load_of_fields() -> None:
    """By fields fill is accepted where its pressure is known, and refused in one line where it varies."""
    still = SOIL | {"active": 0.0, "passive": 0.0}
    filled, bare = (solve_by_fields(build_assembly(parse_scene(arch(fill))), gap=0.8) for fill in (still, None))
    assert filled.decided.low > bare.decided.low
    with pytest.raises(InputError, match=r"fill.*does not model its variable pressure"):
        solve_by_fields(build_assembly(parse_scene(arch(SOIL))), gap=0.3)


def test_spatial_scenes_and_cells_left_out_refuse_fill(tmp_path: Path) -> None:
    cube = [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    upper = [[x, y, z + 1] for x, y, z in cube]
    elements = [{"id": "a", "vertices": cube, "faces": faces, "support": True}]
    elements.append({"id": "b", "vertices": upper, "faces": faces})
    solid = arch(SOIL, elements=elements, loads={"live": [{"element": "b", "force": [1, 0, 0]}]})
    with pytest.raises(InputError, match=r"fill.*planar"):
        build_assembly(parse_scene(solid))
    void = arch(SOIL | {"active": 0.0, "passive": 0.0}, search={"void": {"cells": "all"}, "segmentation": False})
    with pytest.raises(InputError, match=r"search\.void|fill"):
        explore(parse_scene(void), out=tmp_path / "void", driver="enumeration")


# Searches under several load cases: every driver, every row, and proofs by whichever case refutes.


RIGHT, LEFT, DOWN = [{"body": [1, 0]}], [{"body": [-1, 0]}], [{"body": [0, -1]}]
WINDS = [{"name": "left", "live": RIGHT}, {"name": "right", "live": LEFT}]

SCENES: dict[str, tuple[list[str], list[dict[str, Any]], dict[str, Any]]] = {
    "two winds": (["aaa", "aaa", "###"], WINDS, {"block_cells": [1, 3]}),
    "unequal winds": (
        ["aaa", "aaa", "##."],
        [{"name": "left", "live": RIGHT, "required": 0.5}, {"name": "right", "live": LEFT, "required": 0.8}],
        {"block_cells": [1, 3]},
    ),
    "bridge": (
        ["aaaa", "a..a", "#..#"],
        [
            {"name": "left half", "live": [{"element": "c1r0", "force": [0, -400]}]},
            {"name": "right half", "live": [{"element": "c2r0", "force": [0, -400]}]},
            {"name": "wind", "live": RIGHT, "required": 0.05},
        ],
        {"block_cells": [1, 4]},
    ),
    "snow": (
        ["aaa", "a.a", "###"],
        [{"name": "wind", "live": RIGHT}, {"name": "wind in snow", "live": LEFT, "dead": DOWN, "required": 0.9}],
        {"block_cells": [1, 2]},
    ),
    "four sides": (
        ["aa", "aa", "##"],
        [*WINDS, {"name": "lean", "live": [{"body": [1, -0.5]}]}, {"name": "lift", "live": [{"body": [-1, 0.3]}]}],
        {},
    ),
    "overhang": (
        ["aaa", "aaa", "##."],
        [{"name": "down", "live": DOWN}, {"name": "wind", "live": LEFT, "required": 0.1}],
        {},
    ),
}


def scene_of(name: str, **more: Any) -> Any:
    rows, cases, search = SCENES[name]
    return parse_scene({**grid_document(rows), "loads": {"cases": cases}, "search": {**search, **more}})


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", SCENES)
def test_exact_proves_the_same_as_enumeration(name: str, tmp_path: Path) -> None:
    scene = scene_of(name)
    every = explore(scene, tmp_path / "every", ExploreSettings(pictures=False, driver="enumeration"))
    found = explore(scene, tmp_path / "exact", ExploreSettings(pictures=False, driver="exact"))
    assert every.summary.proven
    assert found.summary.proven
    assert found.summary.best == pytest.approx(every.summary.best, rel=2e-6)
    assembly = build_assembly(scene)
    names = [case.name for case in assembly.cases]
    ranked = every.results[every.results["status"] == "collapse"]
    for _, row in ranked.iloc[:: max(1, len(ranked) // 12)].iterrows():
        result = solve(assembly, from_string(row["labelling"]))
        assert row["load_factor"] == pytest.approx(result.load_factor, rel=1e-6)
        for each in names:
            own = result.cases[each].load_factor
            assert row[f"load_factor[{each}]"] == pytest.approx(own, rel=1e-6, nan_ok=True)
        least = [result.cases[each].load_factor / factor for each, factor in zip(names, assembly.required, strict=True)]
        governed = least[names.index(row["governing"])]
        assert governed == pytest.approx(np.nanmin(least), rel=1e-6)


def test_fronts_of_cases(tmp_path: Path) -> None:
    scene = scene_of("unequal winds")
    every = explore(scene, tmp_path / "every", ExploreSettings(pictures=False, driver="enumeration"))
    settings = ExploreSettings(pictures=False, driver="exact", options={"aim": "front"})
    found = explore(scene, tmp_path / "exact", settings)
    count = scene.search.front.count
    known = every.results[every.results["status"] == "collapse"].groupby(count)["load_factor"].max()
    proven = {row["count"]: row["load_factor"] for row in found.summary.facts["best_by_count"]}
    assert found.summary.proven
    assert proven == pytest.approx({k: v for k, v in known.items() if k in proven}, rel=1e-5)
    assert set(known.index) <= set(proven)


@pytest.mark.parametrize("name", ["two winds", "unequal winds"])
def test_a_tree_of_blocks_under_cases_proves_the_same_as_enumeration(name: str) -> None:
    scene = scene_of(name)
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    driver = DRIVERS["exact"](space, by_blocks="on", search=0)
    evaluator = evaluator_of(assembly, EvaluatorSettings())
    while len(rows := driver.ask()):
        driver.tell(rows, evaluator.evaluate_all(rows))
    every = every_layout(space)
    best = max(found.load_factor for found in evaluator.evaluate_all(every) if found.status is Status.COLLAPSE)
    assert driver.finished
    assert driver.relaxations > 0
    assert driver.found[None].load_factor == pytest.approx(best, rel=2e-6)
    assert driver.found[None].bound >= best * (1.0 - 1e-9)


def test_a_case_that_cannot_matter_is_not_solved() -> None:
    """Unstable under one case: the others need no solve, and whoever asks again is told the same."""
    assembly = build_assembly(scene_of("overhang"))
    labels = np.ones(len(assembly.interfaces), dtype=bool)
    slow = evaluator_of(assembly, EvaluatorSettings(SolveOptions(friction="zero-dilation")))
    quick = evaluator_of(assembly, EvaluatorSettings())
    found, whole = slow.evaluate(labels), quick.evaluate_all(labels[None])[0]
    assert found.status is whole.status is Status.UNSTABLE
    assert np.isnan(found.cases).all()


def test_a_mirror_maps_winds_onto_one_another() -> None:
    scene = scene_of("two winds")
    assert len(search_space(scene, build_assembly(scene)).group) == 2
    other = scene_of("unequal winds")
    assert len(search_space(other, build_assembly(other)).group) == 1


@pytest.mark.sampled(2)
@pytest.mark.parametrize("driver", ["genetic", "random", "hillclimb", "anneal", "portfolio"])
def test_other_drivers_rank_by_the_governing_factor(driver: str, tmp_path: Path) -> None:
    scene = scene_of("bridge")
    done = explore(scene, tmp_path / "out", ExploreSettings(pictures=False, driver=driver, budget=40, jobs=1))
    assembly = build_assembly(scene)
    best = done.results.iloc[0]
    assert best["load_factor"] == pytest.approx(solve(assembly, from_string(best["labelling"])).load_factor, rel=1e-6)


def test_without_dilation_the_least_case_governs(tmp_path: Path) -> None:
    scene = scene_of("two winds")
    settings = ExploreSettings(pictures=False, driver="random", budget=6, model=SolveOptions(friction="zero-dilation"))
    done = explore(scene, tmp_path / "out", settings)
    for _, row in done.results[done.results["status"] == "collapse"].iterrows():
        each = [row["load_factor[left]"], row["load_factor[right]"]]
        assert row["load_factor"] == pytest.approx(min(each), rel=1e-6)
        assert row["load_factor"] <= row["load_factor_associative"] * (1.0 + 1e-6)
