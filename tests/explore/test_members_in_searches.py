"""Members in searches, proofs, files and pages; and the one line of every computation that does not model them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from benchmarks.claims import Tally, members

from cases import dry_and_inner
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.exchange import Layout, export
from jld_core.models import solve_by_fields
from jld_explore import explore, search_space
from jld_explore.drivers import DRIVERS
from jld_explore.report.page_contract import PageData
from jld_explore.verification import verify

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


@pytest.mark.usefixtures("without_pictures", "without_field_check")
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


@pytest.mark.usefixtures("without_pictures", "without_field_check")
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


@pytest.mark.usefixtures("without_pictures", "without_field_check")
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

    from jld_core.views.figures import figure_for
    from jld_core.views.figures import draw_forces, draw_mechanism
    from jld_explore.report.page_data import page_data, solution_of

    scene = parse_scene(wall([STRAP]))
    assembly = build_assembly(scene)
    result = solve(assembly)
    _, axes = figure_for(assembly, 2)
    assert len(draw_forces(axes[0], result)["members"]) == 2  # a line and its force
    assert len(draw_mechanism(axes[1], result)["members"]) == 1
    data = page_data(kind="report", scene=scene, assembly=assembly, candidates=assembly.free_faces, facts={},
                     solutions={0: solution_of(result)})  # fmt: skip
    TypeAdapter(PageData).validate_python(data)
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
    from jld_core.build.loads import settlements_of
    from jld_practice.reactions.force_range import settle

    down = [{"name": "s", "supports": [{"elements": ["c0r2"], "move": [0, -1]}]}]
    scene = parse_scene(wall([STRAP], settlements=down))
    assembly = build_assembly(scene)
    settle(assembly, settlements_of(scene, assembly)[0])


def _thrust() -> None:
    from jld_practice.reactions import thrust_ranges

    thrust_ranges(build_assembly(parse_scene(wall([STRAP]))))


def _move() -> None:
    from jld_geometry.search import GeometrySearch

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
    file = tmp_path / "wall.json"
    file.write_text(json.dumps(wall([STRAP], settlements=down)))
    done = jld(command, str(file))
    assert (done.code, done.out) == (2, "")
    said = [line for line in done.err.splitlines() if "warning" not in line]
    assert len(said) == 1
    assert said[0].startswith(f"jld: {file}: members: ")


@pytest.mark.usefixtures("without_pictures", "without_field_check")
def test_random_wall_of_the_claim() -> None:
    """One of the scenes of the claim `members`, with a certificate."""
    tally = Tally(members.CLAIM)
    assert members.case(8, tally) == ""
    assert "not proven" not in tally.notes
