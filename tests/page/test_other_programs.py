"""What other programs ask of the studio: a whole scene by HTTP, and the script for Rhino."""

from __future__ import annotations

import json
import re
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jsonschema
import numpy as np
import pytest
from tools import rhino_component

from cases import small_scene
from command import ROOT
from jld_core import build_assembly, parse_scene, samples, solve

pytest.importorskip("uvicorn", reason="the extra studio is not installed")

SCHEMA = json.loads(re.findall(r"```json\n(.*?)```", (ROOT / "docs/reference/http.md").read_text("utf-8"), re.S)[0])


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A studio as `jld studio` starts it, in a thread."""
    from local_studio import TOKEN, Local

    made = Local(tmp_path_factory.mktemp("studio"), small_scene())
    yield f"http://127.0.0.1:{made.port}/{TOKEN}/"
    made.close()


def post(address: str, body: Any, **headers: str) -> tuple[int, Any]:
    content = body if isinstance(body, bytes) else json.dumps(body).encode()
    sent = {"Content-Type": "application/json", **headers}
    try:
        with urllib.request.urlopen(
            urllib.request.Request(f"{address}api/evaluate", content, sent), timeout=120
        ) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.loads(error.read() or b"{}")


def arch(radius: float = 1.5) -> dict[str, Any]:
    """An arch of 23 voussoirs: 24 faces."""
    document: dict[str, Any] = samples.arch(voussoirs=23, radius=radius).model_dump(mode="json", exclude_defaults=True)
    return document


@pytest.mark.parametrize("make", [arch, small_scene, lambda: json.loads(samples.dome(meridians=6).model_dump_json())])
def test_answers_to_other_programs_equal_solve(make: Any, address: str) -> None:
    document = make()
    status, found = post(address, {"scene": document})
    assert status == 200, found
    jsonschema.validate(found, SCHEMA)
    assembly = build_assembly(parse_scene(document))
    assert found["load_factor"] == solve(assembly).load_factor
    assert found["labelling"] == "".join("d" if dry else "i" for dry in assembly.labels)
    assert found["centroids"][assembly.elements.ids[0]] == assembly.elements.centroid[0].tolist()


def test_a_labelling_is_taken(address: str) -> None:
    document = arch()
    labels = build_assembly(parse_scene(document)).labels.copy()
    labels[3] = False
    letters = "".join("d" if dry else "i" for dry in labels)
    status, found = post(address, {"scene": document, "labelling": letters})
    assert (status, found["labelling"]) == (200, letters)
    assert found["load_factor"] == solve(build_assembly(parse_scene(document)), labels).load_factor


def test_changed_geometry_is_answered_while_it_is_dragged(address: str) -> None:
    """24 faces, another radius each time. The times are in docs/notes/tried.md; here is room for a busy machine."""
    times = []
    for k in range(6):
        document = arch(1.5 + 0.01 * k)
        start = time.perf_counter()
        status, found = post(address, {"scene": document})
        times.append(time.perf_counter() - start)
        assert status == 200
        assert len(found["faces"]) == 24
    assert min(times) < 1.0


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({}, "scene: it is no JSON object"),
        ({"scene": []}, "scene: it is no JSON object"),
        ({"scene": {}}, "expected"),
        ({"scene": {"elements": []}}, "expected"),
        ({"scene": arch(), "labelling": "ddd"}, "24 letters d or i"),
        ({"scene": arch(), "label": "d"}, "label: the request has no such entry"),
        (b"{", "not JSON"),
        (b'{"scene": NaN}', "expected"),
    ],
)
def test_bad_requests_get_one_line(body: Any, words: str, address: str) -> None:
    status, found = post(address, body)
    assert status == 400, found
    assert words in found["error"]
    assert "\n" not in found["error"]


def test_a_wrong_token_is_refused(address: str) -> None:
    with pytest.raises(ValueError, match=r"^40[34]"):
        rhino_component.ask(address.replace("t0ken", "other"), {})


class Mesh:
    """A box as RhinoCommon presents it."""

    def __init__(self, low: tuple[float, ...], high: tuple[float, ...]) -> None:
        points = [(x, y, z) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
        self.Vertices = SimpleNamespace(ToPoint3dArray=lambda: [SimpleNamespace(X=x, Y=y, Z=z) for x, y, z in points])
        self.Faces = Loops((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


class Loops:
    def __init__(self, *loops: tuple[int, ...]) -> None:
        self._loops, self.Count = loops, len(loops)

    def __getitem__(self, k: int) -> SimpleNamespace:
        a, b, c, d = self._loops[k]
        return SimpleNamespace(A=a, B=b, C=c, D=d)


def component(address: str, **given: Any) -> dict[str, Any]:
    """Run the file as a script component does: inputs are variables, outputs are left behind."""
    path = Path(rhino_component.__file__)
    space = {"__name__": "component", "address": address, **given}
    exec(compile(path.read_text("utf-8"), str(path), "exec"), space)
    return space


@pytest.mark.parametrize("metres", [1.0, 0.001])
def test_the_script_for_rhino_draws_the_mechanism(metres: float, address: str) -> None:
    """A block twice as high as wide rocks under half its weight; its upper corners move, one lower edge stays."""
    unit = 1.0 / metres
    ground = Mesh((-unit, -unit, -unit), (2 * unit, 2 * unit, 0.0))
    stone = Mesh((0.0, 0.0, 0.0), (unit, unit, 2 * unit))
    space = component(address, blocks=[stone], supports=[ground], friction=0.8, metres=metres)
    assert space["status"] == "collapse"
    assert space["load_factor"] == pytest.approx(0.5, rel=1e-6)
    (moved,) = space["moved"]
    still = np.array([[p.X, p.Y, p.Z] for p in stone.Vertices.ToPoint3dArray()])
    shift = np.linalg.norm(np.array(moved) - still, axis=1)
    assert shift.max() == pytest.approx(rhino_component.SHARE * 3 * unit)
    assert np.flatnonzero(shift < 1e-6 * unit).tolist() == [1, 3]


def test_the_rhino_script_reports_errors(address: str) -> None:
    space = component(address, blocks=[Mesh((0, 0, 5), (1, 1, 6))], supports=[Mesh((0, 0, -1), (1, 1, 0))])
    assert space["load_factor"] is None
    assert "no path of interfaces" in space["status"]
    space = component("http://127.0.0.1:9/x/", blocks=[Mesh((0, 0, 0), (1, 1, 1))])
    assert "start jld studio" in space["status"]
    space = component("https://elsewhere.example/", blocks=[])
    assert "none of a studio" in space["status"]
