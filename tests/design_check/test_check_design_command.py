"""`jld check-design`: JSON, page in three languages, results folders, moving loads, and bad input in one line."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from command import Command, saved
from jld_core import parse_scene, solve
from jld_core.scene import design
from jld_practice.design_check import content_of, design_check, html_of, in_words, path_of, sheet_of, to_json
from jld_views import moved_joints, page_data, page_of_study

WALL: dict[str, Any] = {
    "name": "wall <1>",
    "units": {"length": "m", "force": "kN"},
    "elements": [
        {"id": "ground", "support": True, "polygon": [[-1, -1], [2, -1], [2, 0], [-1, 0]]},
        {"id": "low", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]], "weight": 20.0},
        {"id": "high", "polygon": [[0, 1], [1, 1], [1, 2], [0, 2]], "weight": 20.0},
    ],
    "materials": {
        "dry": {"friction_coefficient": 0.8, "compressive_strength": 500.0},
        "inner": {"tensile_strength": 100.0, "shear_strength": 100.0},
    },
    "loads": {"pushes": {"of_weight": 0.1, "directions": 2}},
    "design": {"set": "own", "factors": {"self_weight": [0.9, 1.2], "live": 1.5, "friction": 1.25}},
}


def file_of(folder: Path, **more: Any) -> Path:
    return saved(folder / "wall.json", {**WALL, **more})


def texts(figure: Figure) -> str:
    """All texts of a figure."""
    return "\n".join(text.get_text() for text in figure.findobj(lambda one: hasattr(one, "get_text")))


def test_json_and_files(jld: Command, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = jld("check-design", file_of(tmp_path), "--out", out, "--json")
    assert (done.code, done.err) == (0, "")
    told = json.loads(done.out)
    assert told == json.loads((out / "design_check.json").read_text(encoding="utf-8"))
    # sliding at 0.64 · 0.9 W = λ · 0.15 W, toppling at 0.9 · 0.5 W = λ 0.15 W · 1, less what crushes at the toe
    assert told["utilisation"] == pytest.approx(0.15 / (0.9 * 0.5), rel=0.15)
    assert (told["set"], told["verified"], told["governing"]) == ("own", True, "push at 0°")
    assert told["friction"] == {"factor": 1.25, "source": "stated in the scene"}
    assert [case["case"] for case in told["cases"]] == ["push at 0°", "push at 180°"]
    assert len(told["cases"][0]["combinations"]) == 2
    assert {part["component"] for part in told["reactions"]} == {"Fx", "Fy", "M"}
    assert [joint["elements"] for joint in told["joints"]] == [["ground", "low"], ["low", "high"]]
    # under the design loads the base carries 36 kN and H = 6 kN at 1 m: e = 1/6
    assert told["joints"][0]["N"] == pytest.approx(36.0, rel=1e-6)
    assert told["joints"][0]["eccentricity"] == pytest.approx(6 / 36, rel=1e-6)
    assert told["joints"][0]["slip_reserve"] == pytest.approx(1.0 - 6 / (0.64 * 36), rel=1e-6)
    assert (out / "design_check.pdf").read_bytes().startswith(b"%PDF")
    page = (out / "design_check.html").read_text(encoding="utf-8")
    assert "wall &lt;1&gt;" in page
    assert "<svg" in page
    assert re.search(r"jld \d+\.\d+", page)
    first = {path.name: path.read_bytes() for path in out.iterdir()}
    jld("check-design", file_of(tmp_path), "--out", out)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == first


def test_pages_speak_three_languages() -> None:
    scene = parse_scene({**WALL, "labels": {"inner": [["low", "high"]]}})
    check = design_check(scene, None, design.partial_factors(scene.design))
    told = {}
    for language in ("en", "de", "it"):
        content = content_of(check, language)
        told[language] = texts(sheet_of(check, content))
        page = html_of(check, content, language)
        assert f'lang="{language}"' in page
        for line in (*content.result, *content.notes, *(table.title for table in content.tables)):
            assert line.split(":")[0][:20] in told[language].replace("\n", " ")
        for word in (content.words["blocks"], "low–high", "0.9 / 1.2", "tan φ 0.8 / 0.64"):
            assert word in told[language]
    assert len(set(told.values())) == 3
    assert "Verified: utilisation 0.3" in in_words(check)


def test_everything_fits_on_one_sheet() -> None:
    """Many cases, supports and joints: rows are counted, and letters shrink until the last line is on the sheet."""
    columns = range(12)
    elements: list[dict[str, Any]] = []
    for k in columns:
        for level, name in enumerate(("g", "b", "t")):
            corners = [[k, level - 1], [k + 1, level - 1], [k + 1, level], [k, level]]
            elements.append({"id": f"{name}{k}", "polygon": corners, "support": name == "g", "weight": 5.0})
    cases = [{"name": f"case {k}", "live": [{"element": f"t{k}", "force": [0.1 + 0.1 * k, 0]}]} for k in columns]
    rigid = {"dry": WALL["materials"]["dry"]}  # no fields are solved for what is printed
    scene = parse_scene({**WALL, "elements": elements, "materials": rigid, "loads": {"cases": cases}})
    check = design_check(scene, None, design.partial_factors(scene.design))
    content = content_of(check, "de")
    figure = sheet_of(check, content)
    assert min(text.get_position()[1] for text in figure.texts) == pytest.approx(0.025)
    assert sorted(text.get_position()[1] for text in figure.texts)[1] > 0.035
    assert "und 4 weitere, in design_check.json" in texts(figure)
    assert len(to_json(check)["cases"]) == 12


ARCH = {
    "elements": [
        {"id": "left", "support": True, "polygon": [[-1.5, -0.5], [-1, -0.5], [-1, 0.4], [-1.5, 0.4]]},
        {"id": "right", "support": True, "polygon": [[1, -0.5], [1.5, -0.5], [1.5, 0.4], [1, 0.4]]},
        {"id": "a", "polygon": [[-1, 0], [-0.1, 0], [-0.1, 0.4], [-1, 0.4]]},
        {"id": "b", "polygon": [[-0.1, 0], [0.1, 0], [0.1, 0.4], [-0.1, 0.4]]},
        {"id": "c", "polygon": [[0.1, 0], [1, 0], [1, 0.4], [0.1, 0.4]]},
    ],
    "thickness": 0.3,
    "materials": {
        "density": 2000.0,
        "dry": {"friction_coefficient": 0.7, "compressive_strength": 2e7},
        "inner": {"tensile_strength": 2e5, "shear_strength": 2e5, "compressive_strength": 2e7},
    },
    "loads": {"live": [{"element": "b", "force": [0, -2e4], "at": [0.0, 0.4]}]},
    "design": {"set": "EN 1990"},
}
"""A flat arch whose joints crush at 20 MPa and whose blocks, sheared, at 2 · 0.2 MPa."""


def test_the_weaker_of_both_crack_models_governs(jld: Command, tmp_path: Path) -> None:
    """By the faces drawn the arch is verified; where its blocks crack anywhere it is not: H ≤ 0.4 MPa · 0.2 m · 0.3 m
    = 24 kN with a lever below 0.3 m carries less than 1.5 · 20 kN at 1 m.
    """
    path = saved(tmp_path / "arch.json", ARCH)
    done = jld("check-design", path, "--seconds", 5, "--out", tmp_path / "out")
    told = json.loads((tmp_path / "out" / "design_check.json").read_text(encoding="utf-8"))
    assert told["by_drawn"]["verified"] is True
    assert told["anywhere"]["verified"] is False
    assert told["verified"] is False
    assert told["utilisation"] == told["anywhere"]["utilisation"]
    assert told["anywhere"]["utilisation_bracket"][0] > 1.0 > told["by_drawn"]["utilisation_bracket"][1]
    lines = done.out.splitlines()
    assert lines[1].startswith("Not verified: utilisation")
    assert lines[3].startswith("By the faces drawn: λ = ")
    assert "Wherever blocks crack: λ between" in lines[3]
    assert lines[3].endswith("This governs.")
    page = (tmp_path / "out" / "design_check.html").read_text(encoding="utf-8")
    assert "Wherever blocks crack" in page


def test_a_verified_design_is_verified_by_both_crack_models(jld: Command, tmp_path: Path) -> None:
    path = tmp_path / "arch.json"
    materials = {**ARCH["materials"], "inner": {"tensile_strength": 2e6, "shear_strength": 6e6}}
    path.write_text(json.dumps({**ARCH, "materials": materials}))
    told = json.loads(jld("check-design", path, "--json", "--seconds", 20).out)
    assert told["verified"] is told["by_drawn"]["verified"] is told["anywhere"]["verified"] is True
    assert told["reactions"]


@pytest.mark.parametrize(
    ("more", "reason", "words"),
    [
        ({"materials": {"density": 2000, "dry": {"friction_coefficient": 0.7}}}, "rigid", "Blocks do not crack"),
        ({"design": {"set": "EN 1990 EQU"}}, "equilibrium", "Bodies are rigid"),
    ],
)
def test_what_is_not_checked_is_said(
    jld: Command, tmp_path: Path, more: dict[str, Any], reason: str, words: str
) -> None:
    path = saved(tmp_path / "arch.json", {**ARCH, **more})
    told = json.loads(jld("check-design", path, "--json").out)
    assert (told["anywhere"], told["not_anywhere"]) == (None, reason)
    assert words in jld("check-design", path).out.splitlines()[3]


def test_moving_loads_are_plotted(jld: Command, tmp_path: Path) -> None:
    """Statics of a vehicle at x from the middle of a block, beyond its base: W b/2 = λ P (x − b/2)."""
    ground = {"id": "g", "support": True, "polygon": [[-1, -1], [1, -1], [1, 0], [-1, 0]]}
    table = {"id": "t", "polygon": [[-1, 0], [1, 0], [3, 1], [-3, 1]], "weight": 10.0}
    cart = {"name": "cart", "axles": [{"weight": 2.0}], "path": [[-3, 1], [3, 1]], "steps": 7, "both_directions": True}
    path = file_of(
        tmp_path, elements=[ground, table], loads={"moving": [cart]}, materials={"dry": {"friction_angle": 40}}
    )
    result = solve(path)
    values = moved_joints.path_values(result)
    assert [one.vehicle for one in values] == ["cart"] * 7 + ["cart back"] * 7
    for one in values:
        beyond = abs(one.distance - 3.0) - 1.0
        if beyond > 1e-9:
            assert one.middle == pytest.approx(10.0 / (2.0 * beyond), rel=1e-9)
    lines = moved_joints.figure_of_path(result.assembly, values).axes[0].get_lines()
    assert lines[0].get_xdata() == pytest.approx([0, 1, 2, 3, 4, 5, 6])
    scene = parse_scene(json.loads(path.read_text(encoding="utf-8")))
    check = design_check(scene, None, design.partial_factors(scene.design), states=False)
    assert path_of(check)[0].middle == pytest.approx(0.9 * 10.0 / (1.5 * 2.0 * 2.0), rel=1e-9)
    assert "λ along the path" in texts(sheet_of(check, content_of(check)))
    (picture,) = page_of_study.path_pictures(result.assembly, page_data.solution_of(result))
    assert "paths of moving loads" in picture["title"]
    assert base64.b64decode(picture["png"]).startswith(b"\x89PNG")
    pushed = solve(parse_scene(WALL))
    assert page_of_study.path_pictures(pushed.assembly, page_data.solution_of(pushed)) == []
    short = {**cart, "steps": 1, "both_directions": False}
    done = jld(
        "solve", file_of(tmp_path, elements=[ground, table], loads={"moving": [short]}), "--out", tmp_path / "solved"
    )
    assert (done.code, (tmp_path / "solved" / "path.png").exists()) == (0, True)


@pytest.mark.usefixtures("without_pictures", "without_field_check")
def test_layouts_of_a_search_are_checked(jld: Command, tmp_path: Path) -> None:
    scene = file_of(tmp_path)
    assert jld("explore", scene, "--out", tmp_path / "found").code == 0
    values = []
    for rank in ("1", "2"):
        done = jld("check-design", tmp_path / "found", "--rank", rank, "--set", "EN 1990", "--json").done()
        values.append(json.loads(done.out))
    assert [value["set"] for value in values] == ["EN 1990"] * 2
    assert (len(values[0]["joints"]), len(values[0]["blocks"])) in {(1, 1), (2, 0)}
    assert len(values[0]["joints"]) + len(values[1]["joints"]) == 3
    jld("check-design", tmp_path / "found", "--rank", "9").refused()


@pytest.mark.parametrize(
    ("arguments", "more", "message"),
    [
        (["--set", "EN 1992"], {}, "--set: no set of partial factors is named 'EN 1992'"),
        (["--rank", "1"], {}, "--rank: "),
        (["--seconds=-1"], {}, "--seconds: "),
        (["--seconds", "nan"], {}, "--seconds: "),
        ([], {"design": {"set": "EN 1996"}}, "design.set: no set is named 'EN 1996'"),
        ([], {"materials": {"inner": {"tensile_strength": 1, "shear_strength": 1}}}, "materials.dry: missing"),
    ],
)
def test_bad_input_is_one_line(
    jld: Command, tmp_path: Path, arguments: list[str], more: dict[str, Any], message: str
) -> None:
    jld("check-design", file_of(tmp_path, **more), *arguments, "--out", tmp_path / "out").refused(message)
    assert not (tmp_path / "out").exists()
