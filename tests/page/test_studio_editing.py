"""What the page of the studio edits, by HTTP: files that it opens, materials, limits, loads and supports."""

from __future__ import annotations

import base64
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cases import scene_of_cases, small_scene, spatial_scene
from command import ROOT
from jld_core import build_assembly, parse_scene, solve
from jld_formats import import_file

pytest.importorskip("uvicorn", reason="the extra studio is not installed")

from jld_studio import collapse_loads
from jld_studio.session import texts_of_bounds, with_support
from local_studio import Local, fits


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Local]:
    made = Local(tmp_path_factory.mktemp("editing") / "studio", small_scene())
    yield made
    made.close()


def letters(document: dict[str, Any]) -> str:
    return "".join("d" if dry else "i" for dry in build_assembly(parse_scene(document)).labels)


def sent(path: Path, **options: Any) -> dict[str, Any]:
    """The request that opens a file."""
    return {"name": path.name, "content": base64.b64encode(path.read_bytes()).decode(), "options": options}


WALL = """<svg xmlns="http://www.w3.org/2000/svg" width="2000mm" height="1000mm" viewBox="0 0 2000 1000">
<g id="blocks"><rect x="0" y="0" width="1000" height="500"/><rect x="1000" y="0" width="1000" height="500"/>
<rect x="0" y="500" width="2000" height="300"/><path d="M 100 900 C 200 950 300 950 400 900"/></g>
<g id="supports"><rect x="0" y="800" width="2000" height="200"/></g></svg>"""
"""Three stones on a support, and a curve beside them that no stone uses."""


@pytest.fixture
def wall(tmp_path: Path) -> Path:
    pytest.importorskip("svgelements")
    path = tmp_path / "wall of three.svg"
    path.write_text(WALL)
    return path


def test_a_dropped_drawing_equals_the_result_of_jld_import(local: Local, wall: Path) -> None:
    """The scene, what was read and what was skipped; it is solved, saved and exported under its own name."""
    fits(sent(wall), "open")
    status, found = local.api("open", sent(wall))
    assert status == 200, found
    fits(found, "opened")
    own = import_file(wall)
    kinds = {kind for kind, _ in found["report"]}
    assert {"found", "skipped", "assumed"} <= kinds
    assert [text for kind, text in found["report"] if kind == "skipped"] == list(own.report.skipped)
    assert not any("--" in text for _, text in found["report"])  # the page has fields, not flags
    assert found["unit"] == own.unit
    labelling = found["data"]["solutions"]["0"]["labelling"]
    asked = {"scene": found["scene"], "labelling": labelling, "page": "a", "revision": 1, "changes": {}}
    fits(asked, "state")
    solved = local.api("solve", asked)[1]
    fits(solved, "solved")
    value = solved["solution"]["load_factor"]
    assert value == pytest.approx(solve(parse_scene(own.document)).load_factor, rel=1e-8)
    assert local.api("export", {**asked, "format": "svg"})[1]["name"] == f"{found['data']['studio']['file']}.svg"
    assert local.api("export", {**asked, "format": "svg", "name": "mine"})[1]["name"] == "mine.svg"
    assert local.api("show", {"scene": found["scene"]})[1]["data"]["structure"] == found["data"]["structure"]


def test_options_of_an_import_are_taken(local: Local, wall: Path) -> None:
    """Another unit and another layer of supports, as `jld import` takes them."""
    twice = local.api("open", sent(wall, unit="cm", thickness=0.3, support="supports, nothing"))[1]
    assert twice["data"]["structure"]["size"] == pytest.approx(20.0)
    assert twice["data"]["scene"]["thickness"] == 0.3


def test_scenes_and_files_of_compas_are_both_json(local: Local) -> None:
    status, found = local.api("open", sent(ROOT / "scenes/flat_beam_arch.json"))
    assert (status, found["unit"]) == (200, "")
    [(kind, text)] = found["report"]
    assert kind == "found"
    assert re.fullmatch(r"\d+ elements and \d+ supports, area .* m in all, a typical element .* m", text)
    assert found["data"]["studio"]["file"] == "flat_beam-arch_on_two_bearings"
    status, found = local.api("open", sent(ROOT / "tests/exchange/data/compas_dem_problem.json"))
    assert status == 200, found
    assert found["report"]


@pytest.mark.parametrize(
    ("name", "content", "options", "words"),
    [
        ("a.txt", b"x", {}, "a.txt: files that end in '.txt' are not read"),
        ("a.json", b"{", {}, "a.json: it is not JSON"),
        ("a.json", b'{"grid": {}}', {}, "a.json: grid.cell: missing"),
        ("a.dxf", b"nothing", {}, "a.dxf"),
        ("a.svg", b"<svg>", {}, "a.svg"),
        ("a.svg", b"<svg/>", {"unit": "mile"}, "unit: no unit is named"),
        ("a.svg", b"<svg/>", {"tolerance": "1"}, "a length as a number"),
        ("a.svg", b"<svg/>", {"colour": "x"}, "colour: an import has no such option"),
        ("../a.svg", b"<svg/>", {}, "the plain name of a file"),
        ("a.json", json.dumps(small_scene() | {"cracks": {"kind": "cells", "cell": 0.1}}).encode(), {}, "faces and"),
    ],
)
def test_refused_files_are_one_line(local: Local, name: str, content: bytes, options: Any, words: str) -> None:
    asked = {"name": name, "content": base64.b64encode(content).decode(), "options": options}
    status, found = local.api("open", asked)
    assert status == 400
    assert "\n" not in found["error"]
    assert "/tmp" not in found["error"]
    fits(found, "error")
    assert words in found["error"]
    assert local.api("open", {**asked, "name": "a.svg", "content": "§", "options": {}})[0] == 400


def edit(local: Local, part: str, value: Any) -> tuple[int, Any]:
    return local.api("edit", {"part": part, "changes": {part: value}})


def test_texts_with_units_become_numbers_of_the_scene(local: Local) -> None:
    materials = small_scene()["materials"] | {"density": 1800}
    materials["dry"] |= {"cohesion": "5 kPa", "compressive_strength": "2 MPa"}
    status, found = edit(local, "materials", materials)
    assert status == 200, found
    assert found["value"]["dry"]["cohesion"] == 5e3
    assert found["value"]["dry"]["compressive_strength"] == 2e6
    loads = {"live": [{"element": "c1r0", "force": [0, "-1 kN"], "at": ["600 mm", 0.4]}]}
    assert edit(local, "loads", loads)[1]["value"]["live"][0]["force"] == [0.0, -1000.0]


@pytest.mark.parametrize(
    ("part", "value", "key"),
    [
        ("materials", {"density": -1}, "materials.density"),
        ("materials", {"density": 1, "dry": {"friction_coefficient": "much"}}, "materials.dry.friction_coefficient"),
        ("materials", {"dry": {"friction_coefficient": 1, "cohesion": "2 kg"}}, "materials.dry.cohesion"),
        ("materials", {"density": 1, "inner": {"tensile_strength": 1.0}}, "materials.inner.shear_strength"),
        ("loads", {"live": [{"element": "nobody", "force": [0, 1]}]}, "loads.live[0].element"),
        ("loads", {"live": []}, "loads.live"),
        ("loads", {"live": [{"body": [None, 0]}]}, "loads.live[0].body[0]"),
        ("loads", {"cases": [{"name": "a", "live": [{"body": [1, 0]}], "required": 0}]}, "loads.cases[0].required"),
        ("search", {"block_cells": [3, 2]}, "search.block_cells"),
        ("search", {"blocks": [90, None]}, "search"),
        ("search", {"keep": {"dry": [["c0r0", "c2r0"]]}}, "search.keep.dry[0]"),
    ],
)
def test_a_refusal_names_the_key_of_its_field(local: Local, part: str, value: Any, key: str) -> None:
    status, found = edit(local, part, value)
    assert status == 400, found
    assert found["key"].startswith(key), found
    assert found["error"].startswith(found["key"])
    assert "\n" not in found["error"]


def test_limits_decide_which_layouts_a_search_admits(local: Local) -> None:
    asked = {"page": "l", "labelling": letters(small_scene())}
    limits = {"blocks": [1, 1], "keep": {"dry": [["c0r0", "c1r0"]]}}
    found = local.api("solve", {**asked, "revision": 1, "changes": {"search": {"blocks": [1, 1]}}})[1]
    assert any("blocks" in reason for reason in found["against"])
    free = found["candidates"]
    kept = local.api("solve", {**asked, "revision": 2, "changes": {"search": {"keep": limits["keep"]}}})[1]
    assert (sum(free), sum(kept["candidates"])) == (sum(kept["candidates"]) + 1, sum(free) - 1)
    impossible = local.api("solve", {**asked, "revision": 3, "changes": {"search": limits}})[1]
    assert impossible["solution"]["load_factor"] == found["solution"]["load_factor"]


def test_every_edit_is_in_the_scene_and_taken_back_exactly(local: Local) -> None:
    """Materials, loads, cases, limits, a support: each is in the file that is saved; without it the first file."""
    document = small_scene()
    asked = {"labelling": letters(document), "changes": {}}
    first = local.api("scene", asked)
    cases = scene_of_cases()["loads"]
    edits = {"materials": document["materials"] | {"density": 1500}, "loads": cases, "search": {"blocks": [2, None]}}
    for count in range(1, len(edits) + 1):
        changes = {part: edit(local, part, edits[part])[1]["value"] for part in list(edits)[:count]}
        scene = local.api("scene", {**asked, "changes": changes})[1]
        assert {part: scene[part] for part in changes} == changes
    made = local.api("support", {**asked, "changes": changes, "element": "c1r1", "support": True})[1]
    own = {"scene": made["scene"], "labelling": made["data"]["solutions"]["0"]["labelling"]}
    again = local.api("scene", own)[1]
    assert again["grid"]["rows"] == ["abb", "c#d", "###"]
    assert {part: again[part] for part in changes} == changes
    back = local.api("support", {**own, "changes": {}, "element": "c1r1", "support": False})[1]
    assert back["data"]["structure"]["faces"]
    assert local.api("scene", asked) == first


def test_supports_of_elements_and_refused_changes(local: Local) -> None:
    document = spatial_scene()
    free = with_support(document, "b", True)
    assert [entry["id"] for entry in free["elements"] if entry.get("support")] == ["slab", "b"]
    assert with_support(free, "b", False) == document
    asked = {"labelling": letters(small_scene()), "changes": {}}
    for element, support, words in (
        ("c9r9", True, "there is none named"),
        ("c1r0", "yes", "true or false"),
        ("c1r0", True, "is a support"),  # it carries a load
    ):
        status, found = local.api("support", {**asked, "element": element, "support": support})
        assert status == 400
        assert words in found["error"]
    rows = with_support({"grid": {"rows": ["a.", "##"]}}, "c0r1", False)["grid"]["rows"]
    assert rows == ["a.", "b#"]


@pytest.mark.parametrize(
    ("units", "entry", "factor", "text"),
    [
        ({}, {"element": "c1r0", "force": [0, -100], "at": [0.6, 0.4]}, 3.0, "300 N"),
        ({}, {"element": "c1r0", "force": [-600, 800]}, 1.5, "1.5 kN"),
        ({"force": "kN"}, {"element": "c1r0", "force": [0, -2000]}, 2.0, "4 MN"),
        ({"force": "kip", "length": "ft"}, {"element": "c1r0", "force": [0, -2000]}, 2.0, "4000 kip"),
        ({}, {"element": "c1r0", "moment": -20}, 0.5, "10 N·m"),
        ({}, {"face": {"between": ["c1r0", "outside"]}, "pressure": 5000}, 2.0, "2 kN/m (10 kN/m²)"),
        ({}, {"body": [0, 0.5]}, 1.0, "941.8 N"),
        ({}, {"body": {"mean": [0, 0.5], "cov": 0.1, "kind": "normal"}}, 2.0, "1.884 kN"),
    ],
)
def test_loads_at_collapse_are_given_in_readable_units(
    units: dict[str, str], entry: dict[str, Any], factor: float, text: str
) -> None:
    """λ times the load; thickness 0.2; six cells of 0.4 × 0.2 × 0.2 × 2000 × 9.81 N, half of their weight."""
    document = small_scene() | {"loads": {"live": [entry]}, "units": units}
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    result = solve(assembly)
    object.__setattr__(result, "load_factor", factor)
    assert collapse_loads(scene, assembly, result) == [[text]]


@pytest.mark.parametrize(
    ("bracket", "text"),
    [
        ((0.5, 2.0), "500 N to 2 kN"),
        ((None, 2.0), "at most 2 kN"),
        ((-1.0, 2.0), "at most 2 kN"),
        ((0.5, None), "at least 500 N"),
        ((-3.0, -2.0), ""),
    ],
)
def test_loads_at_bounds_wherever_blocks_crack(bracket: tuple[float | None, float | None], text: str) -> None:
    """Both bounds times the load, or the one that says something; nothing for a layout that falls."""
    document = small_scene() | {"loads": {"live": [{"element": "c1r0", "force": [-600, 800]}]}}
    scene = parse_scene(document)
    assert texts_of_bounds(scene, build_assembly(scene), [bracket]) == [[text]]


def test_cases_have_loads_at_collapse_of_their_own(local: Local) -> None:
    """Each entry times λ of its own case, by the answer of the server."""
    document = scene_of_cases()
    asked = {"page": "c", "revision": 1, "labelling": letters(document), "changes": {"loads": document["loads"]}}
    found = local.api("solve", asked)[1]
    assert found["cases"] == ["right", "<b>left</b>"]
    weight = 6 * 0.4 * 0.2 * 0.2 * 2000 * 9.81
    for case, (text,) in zip(found["solution"]["cases"], found["collapse"], strict=True):
        value = float(text.split()[0]) * (1e3 if text.endswith("kN") else 1.0)
        assert value == pytest.approx(case["load_factor"] * weight, rel=1e-3)


def test_a_running_search_tells_its_best_layout(tmp_path: Path) -> None:
    """The layout that it names has the λ that it tells; its results go back to the scene of the page."""
    local = Local(tmp_path / "studio", small_scene())
    try:
        _search_tells_its_best_layout(local)
    finally:
        local.close()


def _search_tells_its_best_layout(local: Local) -> None:
    document = small_scene(rows=[*["abcdefgh", "ijklmnop"] * 3, "########"])
    opened = local.api("open", {"name": "w.json", "content": base64.b64encode(json.dumps(document).encode()).decode()})
    changes = {"materials": document["materials"] | {"density": 1500.0}}
    state = {"scene": opened[1]["scene"], "labelling": letters(document), "changes": changes}
    job = local.api("start", {**state, "kind": "explore", "seconds": 60})[1]
    until = time.monotonic() + 120.0
    while not job["progress"].get("labelling") and time.monotonic() < until:
        time.sleep(0.05)
        job = local.api("jobs")[1]["jobs"][-1]
    fits(job, "job")
    assert 0.0 < job["seconds_left"] < 60.0
    assert job["shown"] == {"scene": state["scene"], "changes": changes}
    best = job["progress"]
    own = {"scene": state["scene"], "labelling": best["labelling"], "changes": changes, "page": "r", "revision": 1}
    assert local.api("solve", own)[1]["solution"]["load_factor"] == pytest.approx(best["best"], rel=1e-6)
    drawn = local.api("drawing", {"name": job["name"]})[1]
    assert drawn["solutions"] == {}
    assert len(drawn["structure"]["faces"]) == len(best["labelling"])
    local.api("stop", {"name": job["name"]})


def test_scenes_of_kept_candidates_outlive_the_studio(local: Local, tmp_path: Path) -> None:
    opened = local.api("open", sent(ROOT / "scenes/flat_beam_arch.json"))[1]
    kept = [{"name": "mine", "scene": opened["scene"], "labelling": "", "changes": {}, "text": ""}]
    assert local.api("candidates", {"candidates": kept})[1] == {"kept": 1}
    later = Local(local.root, small_scene())
    try:
        assert later.api("data")[1]["studio"]["candidates"] == kept
        assert later.api("show", {"scene": opened["scene"]})[1]["data"]["title"] == opened["data"]["title"]
        status, found = later.api("show", {"scene": "0123456789abcdef"})
        assert (status, "no longer open" in found["error"]) == (400, True)
        assert later.api("show", {"scene": "../../etc"})[0] == 400
    finally:
        later.close()
