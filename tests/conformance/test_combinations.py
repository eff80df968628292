"""Things that each are right and do not go together: refused in one line before anything is begun, or made to work."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cases import box, grid_document
from cases import scene_in_space as spatial
from command import Command, saved

Document = dict[str, Any]

WALL = grid_document(["aa", "##"])
CASES: Document = {**WALL, "loads": {"cases": [{"name": "wind", "live": [{"body": [1, 0]}]}]}}
CRUSHING = grid_document(["aa", "##"], crush_dry=1e6, crush_inner=1e6)
CUBES = spatial([box("s", [0, 0, 0], [1, 1, 1], support=True), box("a", [0, 0, 1], [1, 1, 2])])

REFUSED: list[tuple[Document, list[str], str]] = [
    (WALL, ["explore", "--effective-area"], "--effective-area: the scene is planar; expected a spatial scene"),
    (CRUSHING, ["explore", "--solver", "highs"], "--solver: highs takes linear programs only"),
    (CRUSHING, ["solve", "--solver", "highs"], "--solver: highs takes linear programs only"),
    (CASES, ["explore", "--experiment", "2"], "loads.cases: an experiment pushes with one live load"),
    (CASES, ["explore", "--objective", "experiment"], "loads.cases: an experiment pushes with one live load"),
    (CASES, ["experiment"], "loads.cases: an experiment pushes with one live load"),
]


@pytest.mark.parametrize(("document", "line", "words"), REFUSED)
def test_refused_before_anything_is_begun(
    document: Document, line: list[str], words: str, tmp_path: Path, jld: Command
) -> None:
    out = tmp_path / "out"
    jld(line[0], saved(tmp_path / "scene.json", document), "--out", out, *line[1:]).refused(words)
    assert not out.exists()


@pytest.mark.parametrize("line", [["check"], ["solve", "--effective-area"]])
def test_a_refusal_stands_alone(line: list[str], tmp_path: Path, jld: Command) -> None:
    """Whatever warnings there would have been."""
    document = {**WALL, "search": {"candidates": []}} if line == ["check"] else WALL
    document = {**document, "materials": {**WALL["materials"], "gravity": -9.81}}
    outcome = jld(line[0], saved(tmp_path / "scene.json", document), *line[1:])
    assert (outcome.code, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    assert "warning" not in outcome.err


def test_loads_that_cancel_leave_nothing_but_a_complaint(tmp_path: Path, jld: Command) -> None:
    """0.1 + 0.2 − 0.3 is 6e-17 in floating point, under which λ was 6e20 and certified."""
    parts = [{"element": "c0r0", "force": [force, 0.0], "at": [0.3, 0.7]} for force in (0.1, 0.2, -0.3)]
    jld("solve", saved(tmp_path / "scene.json", {**WALL, "loads": {"live": parts}})).refused(
        "loads.live: the live load is zero"
    )


def test_lost_contacts_are_reported_with_their_gap(tmp_path: Path, jld: Command) -> None:
    """Far from the origin as well, where five digits are no place."""
    document = spatial(
        [box("s", [1e6, 0, 0], [1e6 + 2, 1, 1], support=True), box("a", [1e6, 0, 1.005], [1e6 + 2, 1, 2])]
    )
    jld("check", saved(tmp_path / "scene.json", document)).refused(
        "element 'a': no path of interfaces leads from it to a support",
        "'s' and 'a' are 0.005 m apart at (1000001, ",
        '"tolerance": 0.0055 closes',
    )


def test_a_tolerance_larger_than_solids_is_refused(tmp_path: Path, jld: Command) -> None:
    jld("check", saved(tmp_path / "scene.json", {**CUBES, "tolerance": 1.5})).refused(
        "tolerance: within 1.5 element 's' cannot be kept"
    )


def test_values_without_effect_are_warnings_and_misplaced_ones_errors(tmp_path: Path, jld: Command) -> None:
    outcome = jld("check", saved(tmp_path / "scene.json", {**CUBES, "thickness": 2.0})).done()
    assert "warning" in outcome.err
    assert "thickness is 2 and the elements are spatial, so it changes nothing" in outcome.err
    face = [[0.0, 9.0, 1.0], [1.0, 9.0, 1.0], [1.0, 10.0, 1.0], [0.0, 10.0, 1.0]]
    stated = {**CUBES, "interfaces": [{"elements": ["s", "a"], "polygon": face}]}
    jld("check", saved(tmp_path / "scene.json", stated)).refused(
        "interfaces[0].polygon: element 's' has no face there; expected an interface on the common"
    )


def test_wrong_settlements_are_seen_by_whoever_reads_the_scene(tmp_path: Path, jld: Command) -> None:
    for end, words in (
        ([{"name": "x", "supports": [{"elements": "c0r0", "move": [1, 0]}]}], "'c0r0' is no support"),
        ([{"name": "x", "supports": [{"elements": "c0r1", "turn": 1}]}] * 2, "settlements[1].name: 'x' is used twice"),
    ):
        scene = saved(tmp_path / "scene.json", {**WALL, "settlements": end})
        for command in ("check", "solve"):
            jld(command, scene).refused(words)


def test_no_command_writes_over_the_scene(tmp_path: Path, jld: Command) -> None:
    scene = saved(tmp_path / "scene.json", WALL)
    lines = [["explore", scene, "--out", tmp_path / "out", "--driver", "exact", "--certificate", scene]]
    for name in ("wall.png", "wall.gif", "wall.blocks.csv"):
        (tmp_path / name).write_text(scene.read_text())
    lines.append(["plot", tmp_path / "wall.png", "--out", tmp_path / "wall.png"])
    lines.append(["plot", tmp_path / "wall.gif", "--out", tmp_path / "wall.gif"])
    lines.append(["export", tmp_path / "wall.blocks.csv", "--format", "obj", "-o", tmp_path / "wall.obj"])
    for line in lines:
        jld(*line).refused("it is the file that is read; expected another file")


def test_invalid_numbers_are_refused(tmp_path: Path, jld: Command) -> None:
    scene = saved(tmp_path / "scene.json", WALL)
    outcome = jld("refine", scene, "-o", tmp_path / "o.json", "--kind", "radial", "--cell=0.3,30", "--centre=nan,0")
    assert (outcome.code, outcome.err) == (2, "jld: --centre: nan,0 is no point; expected x,y\n")
    outcome = jld("plot", scene, "--format", "gif", "--rank", "²")
    assert (outcome.code, outcome.err) == (2, "jld: --rank: '²' is wrong; expected one rank for an animation\n")
