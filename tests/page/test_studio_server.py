"""What the studio's server answers and refuses, over real sockets on this machine."""

from __future__ import annotations

import base64
import errno
import http.client
import json
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import HOSTILE, scene_of_cases, small_scene, spatial_scene
from command import running, saved
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.fields import bounds_by_fields
from jld_explore import ExploreSettings, explore
from jld_views import page_data

uvicorn = pytest.importorskip("uvicorn", reason="the extra studio is not installed")

from jld_studio import Jobs, StudioSession, server  # noqa: E402
from local_studio import TOKEN, Local  # noqa: E402


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Local]:
    made = Local(tmp_path_factory.mktemp("server") / "studio", small_scene(name=HOSTILE))
    yield made
    made.close()


def letters(local: Local) -> str:
    return "".join("d" if dry else "i" for dry in local.desk.setup({}).assembly.labels)


def test_a_labelling_is_answered_with_its_proof(local: Local) -> None:
    status, found = local.api("solve", {"page": "a", "revision": 1, "labelling": letters(local), "changes": {}})
    assert status == 200
    assert found["revision"] == 1
    own = solve(build_assembly(parse_scene(small_scene())))
    case = found["solution"]["cases"][0]
    assert case["load_factor"] == pytest.approx(own.load_factor, rel=1e-8)
    assert case["bracket"][0] <= own.load_factor <= case["bracket"][1] * (1 + 1e-12)
    assert found["against"] == []


def test_changed_materials_are_solved_and_come_back(local: Local) -> None:
    document = small_scene()
    document["materials"]["dry"] = {"friction_coefficient": 0.2}
    asked = {"page": "b", "revision": 1, "labelling": letters(local), "changes": {"materials": document["materials"]}}
    expected = solve(build_assembly(parse_scene(document))).load_factor
    assert local.api("solve", asked)[1]["solution"]["cases"][0]["load_factor"] == pytest.approx(expected, rel=1e-8)


PULLED = {"live": [{"element": "c2r0", "force": [100.0, 0.0], "at": [1.2, 0.5]}]}
"""A pull on the last cell of the upper course: the slope of its joint counts."""


def test_moved_vertices_are_solved_and_improved(local: Local) -> None:
    """λ of the page is that of the file it saves; an improvement is proven when it is solved; bad ones are refused."""
    facts = server.first_data(local.desk, local.root, None)["studio"]
    assert facts is not None
    name = next(v for v in facts["joints"]["paths"] if np.allclose(facts["joints"]["places"][int(v)], [1.2, 0.4]))
    drawn = {"loads": PULLED, "vertices": {name: [1.2, 0.43]}}
    asked = {"labelling": letters(local), "changes": drawn}
    found = local.api("solve", {"page": "v", "revision": 1, **asked})[1]
    scene = local.api("scene", asked)[1]
    assert found["solution"]["load_factor"] == pytest.approx(solve(parse_scene(scene)).load_factor, rel=1e-8)
    assert len(found["bodies"]["weights"]) == len(scene["elements"])
    status, better = local.api("improve", asked)
    assert status == 200
    assert better["value"] > 1.5 * better["start"] > 0.0
    moved = {**asked, "changes": {**drawn, "vertices": better["vertices"]}}
    after = local.api("solve", {"page": "v", "revision": 2, **moved})[1]
    assert after["solution"]["load_factor"] == pytest.approx(better["value"], rel=1e-8)
    bad = {**asked, "changes": {"vertices": {"0": "here"}}}
    for call in ("solve", "improve"):
        status, said = local.api(call, {"page": "v", "revision": 3, **bad})
        assert (status, "\n" in said["error"]) == (400, False)


def test_an_older_state_is_not_solved(local: Local) -> None:
    asked = {"page": "c", "labelling": letters(local), "changes": {}}
    assert "solution" in local.api("solve", {**asked, "revision": 5})[1]
    assert local.api("solve", {**asked, "revision": 4})[1] == {"revision": 4, "superseded": True}


PUSHED = {"live": [{"body": [1, 0]}]}
"""Loads that fields take; a force of the small scene acts on an edge between cells, which they refuse."""


def soft(strength: float = 5e3) -> dict[str, Any]:
    """Changes to the small scene: loads that fields take, and blocks of 5 kPa, which crack before they slide."""
    inner = {"tensile_strength": strength, "shear_strength": strength}
    return {"materials": {**small_scene()["materials"], "inner": inner}, "loads": PUSHED}


def test_blocks_are_bracketed_at_once_and_refined(local: Local, monkeypatch: pytest.MonkeyPatch) -> None:
    """The coarsest mesh first, then narrower brackets, as `bounds_by_fields` has them, until time is up."""
    # no other test asks for this strength, so that no mesh is kept
    for name in ("SECONDS", "STEP"):  # a busy machine would end refinement early
        monkeypatch.setattr(f"jld_studio.session.{name}", 60.0)
    asked = {"page": "d", "revision": 1, "labelling": letters(local), "changes": soft(5.1e3)}
    answers = [local.api("fields", asked)[1] for _ in range(3)]
    assert [one["more"] for one in answers] == [True] * 3
    assembly = build_assembly(parse_scene(small_scene() | soft(5.1e3)))
    alone = bounds_by_fields(assembly, gap=0.05, most=answers[-1]["triangles"])
    assert [one["triangles"] for one in answers] == [step.simplices for step in alone.history]
    assert answers[-1]["bracket"] == pytest.approx([alone.lower, alone.upper], rel=1e-9)
    for one, after in pairwise(answers):
        assert one["bracket"][0] < after["bracket"][0] < after["bracket"][1] < one["bracket"][1]
    monkeypatch.setattr("jld_studio.session.SECONDS", answers[-1]["seconds"])
    assert local.api("fields", asked)[1] == {**answers[-1], "more": False}


def test_an_older_state_is_not_bracketed(local: Local) -> None:
    asked = {"page": "e", "labelling": letters(local), "changes": {"loads": PUSHED}}
    assert "bracket" in local.api("fields", {**asked, "revision": 5})[1]
    assert local.api("fields", {**asked, "revision": 4})[1] == {"revision": 4, "superseded": True}


def test_brackets_follow_the_materials(local: Local) -> None:
    """Blocks of a quarter of the strength are proven weaker."""
    strong = {"page": "f", "revision": 1, "labelling": letters(local), "changes": {"loads": PUSHED}}
    weak = {**strong, "page": "g", "changes": soft()}
    one, other = (local.api("fields", asked)[1]["bracket"] for asked in (weak, strong))
    assert one[1] < other[0]


def test_scenes_that_fields_do_not_support_are_named() -> None:
    """Space, a force on an edge between cells, and too many triangles: one line each, no failure."""
    spatial = StudioSession(parse_scene(spatial_scene()))
    told = spatial.fields("d" * len(spatial.setup({}).assembly.interfaces), {})
    assert "spatial" in told["refused"]
    assert not told["more"]
    small = StudioSession(parse_scene(small_scene()))
    told = small.fields("d" * len(small.setup({}).assembly.interfaces), {})
    assert "no free face" in told["refused"]
    wide = StudioSession(parse_scene(small_scene(rows=["ab" * 14] * 28 + ["#" * 28]) | {"loads": PUSHED}))
    told = wide.fields("d" * len(wide.setup({}).assembly.interfaces), {})
    assert "triangles are too many" in told["refused"]
    assert "\n" not in told["refused"]


def test_load_cases_are_bracketed_together() -> None:
    """The least over cases of λ / required, once every case has a mesh."""
    desk = StudioSession(parse_scene(scene_of_cases()))
    assembly = desk.setup({}).assembly
    own = "".join("d" if dry else "i" for dry in assembly.labels)
    assert desk.fields(own, {})["bracket"][0] is None
    found = desk.fields(own, {})
    each = [bounds_by_fields(case, assembly.labels, gap=1e-9, most=1) for case in assembly.by_case]
    sides = [one.lower for one in each], [one.upper for one in each]
    ends = [min(end / need for end, need in zip(side, assembly.required, strict=True)) for side in sides]
    assert found["bracket"] == pytest.approx(ends, rel=1e-9)


def test_scenes_by_fields_are_opened_and_those_by_cells_are_not(tmp_path: Path) -> None:
    path = saved(tmp_path / "scene.json", small_scene() | {"cracks": {"kind": "cells", "cell": 0.1}})
    with pytest.raises(InputError, match="by faces and by fields only"):
        server.opened(path)
    path.write_text(json.dumps(small_scene() | {"cracks": {"kind": "fields"}}))
    assert server.opened(path)[0].cracks != "faces"


def test_a_search_by_fields_is_opened_with_a_layout(tmp_path: Path) -> None:
    """The page of a folder by fields begins with the best layout, solved by faces, and its table."""
    asked = parse_scene(small_scene() | {"cracks": {"kind": "fields", "gap": 0.5}, "loads": PUSHED})
    done = explore(asked, tmp_path / "out", ExploreSettings(jobs=1, pictures=False))
    scene, root, study = server.opened(tmp_path / "out")
    data = server.first_data(StudioSession(scene), root, study)
    assert data["solutions"]["0"]["labelling"] == done.summary.best_labelling
    assert data["table"] is not None


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/", {}, 403),
        (f"/{TOKEN}", {}, 403),
        (f"/{TOKEN}x/", {}, 403),
        ("/wrong/api/data", {}, 403),
        ("/api/data", {}, 403),
        (f"/{TOKEN}/api/data", {"host": "evil.example"}, 421),
        (f"/{TOKEN}/api/data", {"host": "127.0.0.1"}, 421),
        (f"/{TOKEN}/api/data", {"origin": "http://evil.example"}, 403),
        (f"/{TOKEN}/api/data", {"origin": "null"}, 403),
        (f"/{TOKEN}/api/data", {"sec_fetch_site": "cross-site"}, 403),
        (f"/{TOKEN}/assets/../../../../etc/passwd", {}, 404),
        (f"/{TOKEN}/assets/..%2f..%2fpage.py", {}, 404),
        (f"/{TOKEN}/assets/vendor/three.LICENSE", {}, 404),
        (f"/{TOKEN}/assets/studio.html", {}, 404),
    ],
)
def test_requests_of_other_pages_are_refused(local: Local, path: str, headers: dict[str, str], status: int) -> None:
    assert local.ask(path, **headers)[0] == status


def test_posts_other_than_json_of_moderate_size_are_refused(local: Local) -> None:
    path = f"/{TOKEN}/api/solve"
    assert local.ask(path, raw=b"a=1", content_type="application/x-www-form-urlencoded")[0] == 415
    assert local.ask(path, raw=b"{}", content_type="text/plain")[0] == 415
    assert local.ask(path, raw=b"", content_length=str(server.LARGEST + 1))[0] == 413
    assert local.ask(path, raw=b"{")[0] == 400
    assert local.ask(path, raw=b"[1]")[0] == 400
    assert local.ask(path, {}, origin="http://evil.example")[0] == 403
    assert local.ask(path, raw=b"{}", method="PUT")[0] == 405


def test_a_body_without_a_length_is_cut_off(local: Local) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", local.port, timeout=120)
    piece = b" " * 100_000
    body = (piece for _ in range(server.LARGEST // len(piece) + 2))
    sent = {"content-type": "application/json", "transfer-encoding": "chunked"}
    try:
        connection.request("POST", f"/{TOKEN}/api/solve", body, sent, encode_chunked=True)
        assert connection.getresponse().status == 413
    except (BrokenPipeError, ConnectionResetError):
        pass  # cut off before all was sent, which is as good
    finally:
        connection.close()
    assert local.api("jobs")[0] == 200


def test_every_answer_carries_the_policy(local: Local) -> None:
    for path in (f"/{TOKEN}/", f"/{TOKEN}/api/data", f"/{TOKEN}/assets/studio.js", "/nowhere"):
        _, headers, _ = local.ask(path)
        policy = headers["content-security-policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'")
        assert "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "access-control-allow-origin" not in headers


def test_the_page_names_no_script_but_files_of_its_own(local: Local) -> None:
    _, headers, text = local.ask(f"/{TOKEN}/")
    assert headers["content-type"].startswith("text/html")
    assert "<script>" not in text
    assert HOSTILE not in text
    for name in page_data.asset_names():
        assert local.ask(f"/{TOKEN}/assets/{name}")[0] == 200


@pytest.mark.parametrize(
    ("name", "body", "words"),
    [
        ("solve", {"revision": 1, "labelling": "x"}, "letters d or i"),
        ("solve", {"revision": 1, "labelling": None}, "letters d or i"),
        ("solve", {"revision": "1"}, "a whole number"),
        ("solve", {"revision": 1, "changes": {"grid": {}}}, "materials or loads"),
        ("solve", {"revision": 1, "changes": [1]}, "an object"),
        ("start", {"kind": "rm"}, "improve, prove or explore"),
        ("start", {"kind": "prove", "seconds": 1e9}, "a number from"),
        ("stop", {"name": "../../x"}, "one of the list"),
        ("resume", {"name": "../../x"}, "one of the list"),
        ("results", {"name": "../../x"}, "one of the list"),
        ("export", {"format": "../x", "labelling": ""}, "one of"),
        ("export", {"format": {}, "labelling": ""}, "one of"),
        ("scene", {"scene": []}, "that the studio has opened"),
        ("edit", {"scene": {"scene": {}}}, "that the studio has opened"),
        ("save", {"name": "../x"}, "letters, digits"),
        ("save", {"name": "/etc/x"}, "letters, digits"),
        ("save", {"name": "a..b"}, "letters, digits"),
        ("save", {"name": "x" * 100}, "letters, digits"),
        ("candidates", {"candidates": "x"}, "a list"),
    ],
)
def test_wrong_questions_get_one_clear_line(local: Local, name: str, body: Any, words: str) -> None:
    before = sorted(local.root.rglob("*"))
    status, found = local.api(name, body)
    assert status == 400
    assert words in found["error"]
    assert "\n" not in found["error"]
    assert sorted(local.root.rglob("*")) == before


@pytest.mark.parametrize(
    ("kind", "begins"), [("svg", b"<"), ("dxf", b"  0"), ("obj", None), ("vtk", b"<"), ("gltf", b"glTF")]
)
def test_blocks_go_out_in_every_format(local: Local, kind: str, begins: bytes | None) -> None:
    status, found = local.api("export", {"format": kind, "labelling": letters(local)})
    assert status == 200, found
    content = base64.b64decode(found["content"])
    assert len(content) > 100
    assert begins is None or content.startswith(begins)
    assert not local.root.exists()


def test_a_saved_scene_is_replaced_only_if_that_is_asked_for(local: Local) -> None:
    letters = "".join("d" if dry else "i" for dry in local.desk.setup({}).assembly.labels)
    asked = {"name": "twice", "labelling": letters, "changes": {}}
    path = str(local.root / "twice.json")
    assert local.api("save", asked) == (200, {"path": path, "exists": False})
    Path(path).write_text("mine")
    assert local.api("save", asked) == (200, {"path": path, "exists": True})
    assert Path(path).read_text() == "mine"
    assert local.api("save", {**asked, "overwrite": True}) == (200, {"path": path, "exists": False})
    assert json.loads(Path(path).read_text())["grid"]


def test_bad_materials_are_reported_and_not_solved(local: Local) -> None:
    changes = {"materials": {"density": 2000, "dry": {"friction_coefficient": -1}}}
    status, found = local.api("solve", {"revision": 1, "labelling": letters(local), "changes": changes})
    assert status == 400
    assert "friction_coefficient" in found["error"]


def test_a_port_in_use_is_reported() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(InputError, match="cannot be opened"):
        server._listener(taken.getsockname()[1])


def test_blocks_are_exported_while_layouts_are_solved(local: Local) -> None:
    """Layouts are solved and exported side by side: one solver, one thread at a time (16 of 20 failed before)."""
    # other tests of the same server may have saved something there before
    asked, before = letters(local), sorted(local.root.rglob("*"))
    ended = threading.Event()
    found: list[tuple[int, Any]] = []

    def solving() -> None:
        revision = 0
        while not ended.is_set():
            revision += 1
            found.append(local.api("solve", {"page": "side", "revision": revision, "labelling": asked}))

    thread = threading.Thread(target=solving)
    thread.start()
    try:
        exports = [local.api("export", {"format": "vtk", "labelling": asked}) for _ in range(20)]
    finally:
        ended.set()
        thread.join()
    assert [status for status, _ in exports] == [200] * 20
    assert {status for status, _ in found} == {200}
    assert sorted(local.root.rglob("*")) == before


def test_a_number_of_thousands_of_digits_is_refused(local: Local) -> None:
    status, _, text = local.ask(f"/{TOKEN}/api/solve", raw=b'{"revision": ' + b"1" * 5000 + b"}")
    expected = {"error": "request: it is not JSON; expected one JSON object", "key": "request"}
    assert (status, json.loads(text)) == (400, expected)


def test_a_worker_that_prints_much_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More on stderr than a pipe holds, and lines on stdout that are no reports."""
    worker = tmp_path / "worker"
    code = "import sys; print('a library says hello'); print('3'); sys.stderr.write('warning\\n' * 50_000)"
    worker.write_text(
        f"#!{sys.executable}\n{code}\nprint('{{\"done\": 7}}'); sys.stderr.write('the last\\n')\nsys.exit(1)"
    )
    worker.chmod(0o755)
    monkeypatch.setattr("jld_studio.jobs.sys.executable", str(worker))
    jobs = Jobs(tmp_path / "studio")
    job = jobs.start("explore", small_scene(), {"seconds": 1.0})
    until = time.monotonic() + 120.0
    while job.state == "running" and time.monotonic() < until:
        time.sleep(0.02)
    assert (job.state, job.error, job.progress["done"]) == ("failed", "the last", 7)


def test_closing_the_studio_reads_the_output_of_its_searches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pipe of a search is closed, also where something that the search began holds its other end longer."""
    worker = tmp_path / "worker"
    worker.write_text("#!/bin/sh\n(sleep 0.3; echo '{\"done\": 7}') &\necho '{\"done\": 0}'\nexec sleep 60")
    worker.chmod(0o755)
    monkeypatch.setattr("jld_studio.jobs.sys.executable", str(worker))
    jobs = Jobs(tmp_path / "studio")
    job = jobs.start("explore", small_scene(), {"seconds": 1.0})
    until = time.monotonic() + 120.0
    while not job.progress and time.monotonic() < until:
        time.sleep(0.01)
    jobs.close()
    assert job.process is not None
    assert job.process.stdout is not None
    assert job.process.stdout.closed
    assert job.progress["done"] == 7


def test_a_search_that_cannot_start_takes_no_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that cannot be run, and a full disk: nothing half-written stays, and no place is taken for ever."""
    jobs = Jobs(tmp_path / "studio")
    with monkeypatch.context() as patch:
        patch.setattr("jld_studio.jobs.sys.executable", str(tmp_path / "missing"))
        for _ in range(5):
            with pytest.raises(FileNotFoundError):
                jobs.start("explore", small_scene(), {"seconds": 1.0})

    def full(path: Path, text: str) -> None:
        path.write_text(text[:3])
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr("jld_studio.jobs.files.write_text", full)
    with pytest.raises(OSError, match="No space left"):
        jobs.start("explore", small_scene(), {"seconds": 1.0})
    assert jobs.listed() == []
    assert list((tmp_path / "studio").iterdir()) == []


def test_a_full_disk_at_the_end_of_a_search_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    worker = tmp_path / "worker"
    worker.write_text("#!/bin/sh\nread line\nexit 0")
    worker.chmod(0o755)
    monkeypatch.setattr("jld_studio.jobs.sys.executable", str(worker))
    written = []

    def full(path: Path, text: str) -> None:
        written.append(path.name)
        if len(written) > 2:  # the scene and the settings at the start still fit
            raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr("jld_studio.jobs.files.write_text", full)
    job = Jobs(tmp_path / "studio").start("explore", small_scene(), {"seconds": 1.0})
    until = time.monotonic() + 120.0
    while "No space left" not in job.error and time.monotonic() < until:
        time.sleep(0.02)
    assert job.state == "done"
    assert job.error.startswith(str(tmp_path / "studio" / "explore-1" / "order.json"))


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"kind": "bake", "orders": {}}', "[" * 100_000])
def test_damaged_settings_of_a_search_are_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "explore-1").mkdir()
    (tmp_path / "explore-1" / "order.json").write_text(text)
    with pytest.raises(InputError, match=r"order\.json: it is damaged .*; expected the file as it was"):
        Jobs(tmp_path)


def test_a_damaged_summary_does_not_hide_other_searches(tmp_path: Path) -> None:
    for number in (1, 2):
        results = tmp_path / f"explore-{number}" / "results"
        results.mkdir(parents=True)
        (results.parent / "order.json").write_text(json.dumps({"kind": "explore", "orders": {}, "done": True}))
        (results / "summary.json").write_text('{"best": 1.5}' if number == 1 else '{"best":')
    one, two = (job.facts() for job in Jobs(tmp_path).listed())
    assert (one["summary"]["best"], one["error"]) == (1.5, "")
    assert "summary.json: it is damaged" in two["error"]


def test_a_studio_that_is_terminated_stops_its_searches(tmp_path: Path) -> None:
    """SIGTERM: the searches end as by Ctrl-C, with what they found on disk, before the studio does."""
    scene = tmp_path / "scene.json"
    document = small_scene(rows=["abcdefgh", "ijklmnop", "abcdefgh", "ijklmnop", "########"])
    scene.write_text(json.dumps(document))
    results = tmp_path / "scene_studio" / "explore-1" / "results"
    with running("studio", scene, "--no-browser") as studio:
        assert studio.stdout is not None
        address = studio.stdout.readline().split()[-1]
        port, token = address.split("/")[2].rpartition(":")[2], address.split("/")[3]
        labelling = "".join("d" if dry else "i" for dry in build_assembly(parse_scene(document)).labels)
        asked = {"kind": "explore", "labelling": labelling, "changes": {}, "seconds": 600}
        connection = http.client.HTTPConnection("127.0.0.1", int(port), timeout=120)
        with closing(connection):
            connection.request("POST", f"/{token}/api/start", json.dumps(asked), {"content-type": "application/json"})
            assert connection.getresponse().status == 200
        until = time.monotonic() + 120.0
        while not (results / "scene.json").exists() and time.monotonic() < until:
            time.sleep(0.05)
        time.sleep(0.5)
        studio.send_signal(signal.SIGTERM)
        assert studio.wait(timeout=120) == 3  # as Ctrl-C ends any command
    assert json.loads((results / "summary.json").read_text())["stop_reason"] == "interrupted"
    assert (results / "report.html").exists()
