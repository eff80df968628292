"""What the page asks about a drawing before it is opened, by HTTP: what was understood, choices, commands, a design."""

from __future__ import annotations

import base64
import json
import math
import shlex
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cases import small_scene
from command import ROOT, Command
from files.make import File, shelf
from jld_core import InputError
from jld_formats import ImportOptions, import_file

ezdxf = pytest.importorskip("ezdxf")
for library in ("uvicorn", "svgelements", "meshio", "rhino3dm", "ifcopenshell"):
    pytest.importorskip(library)

from jld_studio import server  # noqa: E402
from local_studio import Local, fits  # noqa: E402


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Local]:
    made = Local(tmp_path_factory.mktemp("asking") / "studio", small_scene())
    yield made
    made.close()


def sent(path: Path, settings: Any = None, **options: Any) -> dict[str, Any]:
    content = base64.b64encode(path.read_bytes()).decode()
    return {"name": path.name, "content": content, "options": options, "settings": settings or {}}


def read(local: Local, path: Path, **options: Any) -> dict[str, Any]:
    fits(sent(path, **options), "open")
    status, found = local.api("read", sent(path, **options))
    assert status == 200, found
    fits(found, "understood")
    return dict(found)


def box(space: Any, x0: float, y0: float, x1: float, y1: float, layer: str) -> None:
    space.add_lwpolyline([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], close=True, dxfattribs={"layer": layer})


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wall whose layers have no telling names, with a window, an axis and a frame."""
    document = ezdxf.new("R2010", setup=True)
    document.header["$INSUNITS"] = 6
    space = document.modelspace()
    box(space, 0, 0, 3, 2, "W 1")
    box(space, 1, 0.8, 2, 1.4, "X[1]")
    box(space, 0, -0.3, 3, 0, "-G")
    box(space, -1, -1, 4, 3, "PLANRAHMEN")
    space.add_line((1.5, -1), (1.5, 3), dxfattribs={"layer": "ACHSE"})
    space.add_line((2.5, 2.5), (2.5, 2), dxfattribs={"layer": "PFEILE"})
    path = tmp_path_factory.mktemp("wall") / "a wall.dxf"
    document.saveas(path)
    return path


KINDS = [*{(Path(file.name).suffix, bool(file.refused), bool(file.doubtful)): file for file in shelf()}.values()]
"""One file of the shelf for each format, and for those of each format that are refused or doubtful."""


@pytest.mark.sampled(2)
@pytest.mark.parametrize("file", KINDS, ids=[file.name for file in KINDS])
def test_every_kind_of_file_is_shown_or_one_line(local: Local, file: File, tmp_path: Path) -> None:
    path = tmp_path / file.name
    file.write(path)
    status, found = local.api("read", sent(path, **json.loads(json.dumps(file.options))))
    line = found["error"] if status == 400 else (found["refused"] or [""])[0]
    assert bool(line) == bool(file.refused), found
    if line:
        assert file.refused in line
        assert line.startswith(file.name)
        assert "\n" not in line
        assert "/tmp" not in line
    if status == 200:
        fits(found, "understood")
        assert found["shapes"]
        layers = {shape["layer"] for shape in found["shapes"]} - {None}  # supports that were added have none
        assert layers <= {layer["name"] for layer in found["layers"]}
    if not line:
        free = [one for one in found["elements"] if not one["support"]]
        assert not found["planar"] or len(free) == file.elements
        assert found["unit"] == file.unit
        assert found["report"][0][1].startswith(f"{file.elements} element")
    assert local.api("jobs")[0] == 200  # the server is up


def test_bad_files_are_one_line_and_the_server_stays_up(local: Local, tmp_path: Path) -> None:
    for name, content in (
        ("a.dxf", b"\0" * 50), ("a.svg", b"<svg"), ("a.ifc", b"ISO"), ("a.3dm", b"3D"), ("a.stl", b"solid"),
        ("a.step", b"ISO-10303-21;"), ("a.csv", b"x"), ("a.obj", b"f 1 2 3"), ("a.ply", b"ply"), ("a.json", b"[]"),
        ("a.dwg", b"AC1032"), ("a", b""), ("a.svg", b""), ("a.json", b'{"loads": 1}'),
    ):  # fmt: skip
        path = tmp_path / name
        path.write_bytes(content)
        status, found = local.api("read", sent(path))
        assert status == 400, (name, found)
        assert found["error"].startswith(name)
        assert "\n" not in found["error"]
        assert not any(word in found["error"] for word in ("Error", "Traceback", "/tmp", "None")), found
    assert local.api("read", sent(ROOT / "scenes/flat_beam_arch.json")) == (200, {"scene": True})


def roles(found: dict[str, Any]) -> dict[str, str]:
    return {layer["name"]: layer["role"] for layer in found["layers"]}


def test_choices_are_the_options_of_the_command_line(local: Local, wall: Path, tmp_path: Path, jld: Command) -> None:
    """Shown without a support, then as said by hand; the command of the page and `open` make the same scene."""
    found = read(local, wall)
    assert "it has no support" in found["refused"][0]
    assert found["refused"][1] == {"option": "support", "value": "lowest"}
    assert found["undesigned"] is None  # a design adds supports
    assert roles(found) == {
        "W 1": "block", "X[1]": "block", "-G": "block", "PLANRAHMEN": "skip", "ACHSE": "skip", "PFEILE": "block",
    }  # fmt: skip
    assert [one["role"] for one in found["shapes"] if one["layer"] == "PFEILE"] == ["unused"]
    doubt = next(line for line in found["report"] if line[0] == "doubtful")
    assert doubt[2] == {"option": "hole", "value": "X[1]"}
    assert [one["id"] for one in found["elements"] if one["doubtful"]]
    options = {"support": ["-G"], "hole": ["X[[]1]"], "load": ["PFEILE"], "skip": ["ACHSE", "PLANRAHMEN"]}
    found = read(local, wall, **options, thickness=0.4)
    assert found["refused"] is None
    assert roles(found) == {
        "W 1": "block", "X[1]": "hole", "-G": "support", "PLANRAHMEN": "skip", "ACHSE": "skip", "PFEILE": "load",
    }  # fmt: skip
    assert not any(one["doubtful"] for one in found["elements"])
    assert (found["size"], found["length"]) == ([pytest.approx(3.0), pytest.approx(2.3)], "m")
    words = shlex.split(found["commands"]["import"])
    assert words[:3] == ["jld", "import", wall.name]
    words[2], words[4] = str(wall), str(tmp_path / "a.json")
    assert jld(*words[1:]).code == 0
    scene = local.api("open", sent(wall, **options, thickness=0.4))[1]["scene"]
    assert local.api("read", sent(wall, **found["options"]))[1]["commands"] == found["commands"]
    written = json.loads((tmp_path / "a.json").read_text())
    assert written["elements"] == local.api("show", {"scene": scene})[1]["data"]["scene"]["elements"]


def test_axis_unit_and_lowest_of_solids(local: Local, tmp_path: Path) -> None:
    path = tmp_path / "two.obj"
    corners = [(x, y, z) for y in (0, 1, 2) for x in (0, 1) for z in (0, 1)]
    loops = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines = [f"v {1000 * x} {1000 * y} {1000 * z}" for x, y, z in corners]
    for number, name in enumerate(("below", "above")):
        lines += [f"o {name}", *("f " + " ".join(str(k + 4 * number) for k in loop) for loop in loops)]
    path.write_text("\n".join(lines))
    assert "no support" in read(local, path)["refused"][0]
    found = read(local, path, support=["below"])
    advice = [line[2] for line in found["report"] if line[2]]
    assert {"option": "up", "value": "y"} in advice
    assert {"option": "unit", "value": "mm"} in advice
    found = read(local, path, support=["lowest"], up="y", unit="mm")
    assert [(one["layer"], one["role"]) for one in found["shapes"]] == [("below", "support"), ("above", "block")]
    assert found["size"] == pytest.approx([1.0, 1.0, 2.0])
    assert "--support lowest --unit mm --up y" in found["commands"]["import"]


def ended(local: Local, job: dict[str, Any]) -> dict[str, Any]:
    begun = time.monotonic()
    while job["state"] == "running" and time.monotonic() < begun + 120.0:
        time.sleep(0.2)
        fits(job, "job")
        job = next(one for one in local.api("jobs")[1]["jobs"] if one["name"] == job["name"])
    return job


def test_a_design_starts_from_what_was_said(local: Local, wall: Path) -> None:
    """The command of the page is the one that runs; its layout opens; its page holds its picture."""
    asked = sent(wall, {"seconds": 10, "force": "2 kN"}, support=["-G"], hole=["X[[]1]"])
    command = local.api("read", asked)[1]["commands"]["design"]
    assert shlex.split(command)[-4:] == ["--seconds", "10", "--load", "2 kN"]
    status, job = local.api("design", asked)
    assert (status, job["kind"]) == (200, "design"), job
    job = ended(local, job)
    assert (job["state"], job["error"]) == ("done", ""), job
    status, found = local.api("results", {"name": job["name"]})
    assert status == 200, found
    assert found["data"]["structure"]["faces"]
    assert "<h1>" in local.api("report", {"name": job["name"]})[1]["text"]
    assert local.api("resume", {"name": job["name"]})[0] == 400


def test_a_design_can_be_stopped(local: Local, wall: Path) -> None:
    job = local.api("design", sent(wall, {"seconds": 60}))[1]
    assert local.api("stop", {"name": job["name"]})[1]["state"] == "stopping"
    begun = time.monotonic()
    while job["state"] != "stopped" and time.monotonic() < begun + 120.0:
        time.sleep(0.1)
        job = next(one for one in local.api("jobs")[1]["jobs"] if one["name"] == job["name"])
    assert (job["state"], job["error"]) == ("stopped", "")


@pytest.mark.parametrize(
    ("settings", "options", "words"),
    [
        ({"colour": 1}, {}, "colour: '1' is wrong; expected mass and seconds as numbers"),
        ({"seconds": "long"}, {}, "seconds: 'long' is wrong"),
        ([], {}, "settings: they are no JSON object"),
        ({}, {"facet": 0.1}, "facet: jld design has no such option"),
        ({}, {"hole": ["NONE"]}, "no layer of the file is like 'NONE'"),
        ({}, {"support": [1]}, "support: '[1]' is wrong"),
    ],
)
def test_wrong_settings_are_one_line(local: Local, wall: Path, settings: Any, options: Any, words: str) -> None:
    status, found = local.api("read", {**sent(wall), "settings": settings, "options": options})
    assert status == 400
    assert words in found["error"]


def test_a_design_that_is_refused_says_why(local: Local, wall: Path) -> None:
    job = local.api("design", sent(wall, {"seconds": 3}))[1]
    job = ended(local, job)
    assert job["state"] == "failed"
    assert job["error"].startswith("--seconds: 3 s are too short")
    assert local.api("report", {"name": job["name"]}) == (
        400, {"error": "design: it has no page yet; expected a design that has found a layout", "key": "design"},
    )  # fmt: skip


def test_a_drawing_without_supports_is_asked_about(wall: Path, tmp_path: Path) -> None:
    """`jld studio FILE` serves the page where a hand can say what is ground; a file that is none is refused."""
    said: list[str] = []
    scene, root, study = server.opened(wall, ImportOptions(), said.append)
    assert (scene.name, root.name, study) == ("a wall to begin with", "a wall_studio", None)
    assert "it has no support" in said[0]
    for name, content in (("none.dxf", None), ("broken.svg", "<svg"), ("a.dwg", "AC1032")):
        if content is not None:
            (tmp_path / name).write_text(content)
        with pytest.raises(InputError, match=name):
            server.opened(tmp_path / name, ImportOptions(), said.append)
    with pytest.raises(InputError, match="no layer of the file is like 'NONE'"):
        server.opened(wall, ImportOptions(hole=("NONE",)), said.append)
    assert math.isclose(import_file(wall, ImportOptions(support=("-G",))).facts()["area"], 6.0)
