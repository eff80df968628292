"""The studio in a real browser: what a hand does, and λ that follows."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from browser_visits import Open, Visit, looks_like
from cases import HOSTILE, small_scene, spatial_scene
from command import running, saved
from jld_core import build_assembly, load_scene, parse_scene, solve
from jld_explore import ExploreSettings, explore


@contextmanager
def studio_of(source: Path) -> Iterator[str]:
    """A studio as the command runs it: its address."""
    with running("studio", source, "--no-browser") as studio:
        assert studio.stdout is not None
        try:
            yield studio.stdout.readline().strip()
        finally:
            studio.terminate()  # it ends its searches before itself
            studio.wait(timeout=120)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("studio") / "courses.json", small_scene())


@pytest.fixture(scope="module")
def address(browser: object, scene: Path) -> Iterator[str]:
    with studio_of(scene) as found:
        yield found


def answered(found: Visit) -> dict[str, object]:
    """Wait until the newest state has its answer; its solution."""
    # read where it is found: the next state may have taken its place
    ready = found.page.wait_for_function("() => !studio.live.waiting && studio.solution && studio.solution.cases[0]")
    return dict(ready.json_value())


def bracketed(found: Visit) -> None:
    """Wait for the bracket of blocks that crack anywhere: its lines move the drawing."""
    found.page.wait_for_function("() => /blocks that crack anywhere: \\[/.test(document.body.innerText)")


def leave(found: Visit) -> None:
    """Leave a page whose studio is about to end: its next request would be an error."""
    found.page.goto("about:blank")


def state(found: Visit) -> dict[str, object]:
    """Labels, materials and loads as the page has them."""
    return dict(found.run("() => studio.steps.now"))


def proven(found: Visit, source: Path) -> float:
    """λ of the page's state, solved here."""
    now = state(found)
    document = {**json.loads(source.read_text()), "materials": now["materials"], "loads": now["loads"]}
    labels = np.array([letter == "d" for letter in str(now["labelling"])])
    return solve(build_assembly(parse_scene(document)), labels).load_factor


def test_a_toggled_face_changes_the_proven_factor(visit: Open, address: str, scene: Path) -> None:
    found = visit(address)
    first = answered(found)["load_factor"]
    assert first == pytest.approx(solve(build_assembly(load_scene(scene))).load_factor, rel=1e-8)
    looks_like(found, "studio")
    before = state(found)["labelling"]
    found.page.locator("line.touch[data-face='1']").click(force=True)
    after = answered(found)
    assert sum(a != b for a, b in zip(str(before), str(state(found)["labelling"]), strict=True)) == 1
    assert after["load_factor"] == pytest.approx(proven(found, scene), rel=1e-8)
    found.page.keyboard.press("Control+z")
    assert state(found)["labelling"] == before
    assert answered(found)["load_factor"] == first
    found.page.keyboard.press("Control+y")
    assert state(found)["labelling"] != before


def test_the_keyboard_toggles_faces_and_slits_are_marked_not_refused(visit: Open, address: str) -> None:
    found = visit(address)
    answered(found)
    found.run("() => studio.change({ labelling: 'i'.repeat(studio.steps.now.labelling.length) })")
    answered(found)
    for key in ("ArrowRight", "ArrowRight", "Enter"):
        found.page.locator("svg.figure").press(key)
    answered(found)
    labels = str(state(found)["labelling"])
    assert labels.count("d") == 1
    slits = found.page.locator("#slits")
    assert slits.count() == 1
    assert "one block on both sides" in slits.inner_text()
    assert found.page.locator(".drawing line.differs").count() > 0
    assert found.run("() => studio.solution.cases[0].status") == "collapse"


def test_a_dragged_joint_moves_and_is_taken_back(visit: Open, address: str) -> None:
    """λ follows the vertex, crossing no border of its path; improving is one step; both are taken back."""
    found = visit(address)
    answered(found)
    pull = {"live": [{"element": "c2r0", "force": [100.0, 0.0], "at": [1.2, 0.5]}]}
    found.run("(loads) => studio.change({ loads, labelling: 'd'.repeat(studio.steps.now.labelling.length) })", pull)
    first = answered(found)["load_factor"]
    found.page.locator("[data-tool=joint]").click()
    handle = found.page.locator("circle.handle[data-vertex='4']")
    bracketed(found)
    box = handle.bounding_box()
    assert box is not None
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    found.page.mouse.move(x, y)
    found.page.mouse.down()
    found.page.mouse.move(x + 12.0, y + 9.0, steps=4)
    found.page.mouse.up()
    vertices = state(found)["vertices"]
    assert isinstance(vertices, dict)
    assert list(vertices) == ["4"]
    after = answered(found)["load_factor"]
    assert after != first
    bracketed(found)
    looks_like(found, "studio_joints")
    assert found.run("() => studio.steps.past.length") == 2
    drawn = found.run("() => studio.data.structure.faces.flatMap((face) => face.polygon)")
    assert any(np.allclose(point, next(iter(vertices.values()))) for point in drawn)
    found.page.locator("#improve-joints").click()
    found.page.wait_for_function("() => studio.steps.past.length === 3")
    assert float(str(answered(found)["load_factor"])) > float(str(after))
    found.page.keyboard.press("Control+z")
    found.page.keyboard.press("Control+z")
    assert state(found)["vertices"] == {}
    assert answered(found)["load_factor"] == first


def test_a_painted_block_is_a_block_of_its_own(visit: Open, address: str, scene: Path) -> None:
    found = visit(address)
    answered(found)
    found.page.locator("[data-tool=paint]").click()
    boxes = [found.page.locator(f"polygon[data-element='{k}']").bounding_box() for k in (4, 5)]
    assert boxes[0] is not None
    assert boxes[1] is not None
    middles = [(b["x"] + 0.5 * b["width"], b["y"] + 0.5 * b["height"]) for b in boxes if b]
    found.page.mouse.move(*middles[0])
    found.page.mouse.down()
    found.page.mouse.move(*middles[1], steps=5)
    found.page.mouse.up()
    assert answered(found)["load_factor"] == pytest.approx(proven(found, scene), rel=1e-8)
    assembly = build_assembly(load_scene(scene))
    faces = zip(assembly.interfaces.a.tolist(), assembly.interfaces.b.tolist(), strict=True)
    for (a, b), letter in zip(faces, str(state(found)["labelling"]), strict=True):
        if {a, b} == {4, 5}:
            assert letter == "i"
        elif {a, b} & {4, 5}:
            assert letter == "d"
    assert found.run("() => studio.steps.past.length") == 1


def test_materials_and_loads_move_the_factor(visit: Open, address: str, scene: Path) -> None:
    found = visit(address)
    first = answered(found)["load_factor"]
    slider = found.page.locator("[data-material='friction μ, dry']")
    slider.fill("0.4")
    found.page.wait_for_function("() => studio.steps.now.materials.dry.friction_coefficient === 0.4")
    second = answered(found)["load_factor"]
    assert second == pytest.approx(proven(found, scene), rel=1e-8)
    assert second != first
    found.page.locator("[data-tool=load]").click()
    arrow = found.page.locator("path.load[data-load='0']").bounding_box()
    assert arrow is not None
    tip = (arrow["x"] + 0.5 * arrow["width"], arrow["y"] + arrow["height"] - 2)
    found.page.mouse.move(*tip)
    found.page.mouse.down()
    found.page.mouse.move(tip[0] - 60, tip[1], steps=5)
    found.page.mouse.up()
    third = answered(found)["load_factor"]
    moved = [load for load in dict(state(found)["loads"])["live"] if "force" in load]  # type: ignore[call-overload]
    assert moved[0]["at"][0] < 0.6
    assert third == pytest.approx(proven(found, scene), rel=1e-8)
    field = found.page.locator("#loads input[data-load='0']").first
    before = found.page.evaluate("() => JSON.stringify(studio.steps.now)")
    field.fill("2")
    field.press("Enter")
    # the server checks the value first; the state changes after that
    found.page.wait_for_function("before => JSON.stringify(studio.steps.now) !== before", arg=before)
    assert answered(found)["load_factor"] == pytest.approx(proven(found, scene), rel=1e-8)
    for _ in range(3):
        found.page.locator("#undo").click()
    assert answered(found)["load_factor"] == first


def test_no_stale_answer_is_ever_shown(visit: Open, address: str) -> None:
    """Answers are held back and let go late: what is on the page is the newest state's, or says that it waits."""
    found = visit(address)
    answered(found)
    held: list[object] = []
    found.page.route("**/api/solve", lambda route: held.append(route))
    found.page.locator("line.touch[data-face='1']").click(force=True)
    found.page.wait_for_function("() => studio.live.busy")
    found.page.locator("line.touch[data-face='4']").click(force=True)
    found.page.wait_for_timeout(50)
    assert len(held) == 1  # one question at a time, the newest next
    assert found.page.locator(".answer.waiting").count() == 1
    held[0].continue_()  # type: ignore[attr-defined]
    for _ in range(500):  # until the next question is asked, however busy the machine
        if len(held) > 1:
            break
        found.page.wait_for_timeout(20)
    assert found.run("() => studio.solution") is None  # the answer to the state before was dropped
    held[1].continue_()  # type: ignore[attr-defined]
    answered(found)
    assert found.page.locator(".answer.waiting").count() == 0
    assert found.run("() => studio.solution.labelling === studio.steps.now.labelling")


def test_candidates_are_kept_compared_and_saved(visit: Open, address: str, scene: Path) -> None:
    found = visit(address)
    answered(found)
    found.page.locator("#keep").click()
    found.page.locator("line.touch[data-face='2']").click(force=True)
    answered(found)
    found.page.locator("#candidates li >> text=compare").first.click()
    found.page.wait_for_selector(".pane >> nth=1")
    assert found.page.locator(".drawing line.differs").count() >= 2
    with found.page.expect_download() as waiting:
        found.page.locator("#export-scene").click()
    text = Path(waiting.value.path()).read_text(encoding="utf-8")
    own = solve(build_assembly(parse_scene(json.loads(text))))
    assert own.load_factor == pytest.approx(answered(found)["load_factor"], rel=1e-8)
    found.page.get_by_label("name of the file").fill("mine")
    found.page.locator("#save").click()
    found.page.wait_for_selector("#export p:has-text('saved as')")
    saved = scene.with_name("courses_studio") / "mine.json"
    assert json.loads(saved.read_text()) == json.loads(text)
    found.page.get_by_label("name of the file").fill("../outside")
    found.page.locator("#save").click()
    found.page.wait_for_selector("#complaint:not([hidden])")
    assert not (scene.parent / "outside.json").exists()
    found.errors.clear()  # the browser notes the refusal
    again = visit(address)
    answered(again)
    assert again.page.locator("#candidates li").count() >= 1


def test_a_search_runs_behind_the_page_and_survives_it(visit: Open, address: str) -> None:
    found = visit(address)
    answered(found)
    found.page.get_by_label("seconds").fill("30")
    found.page.locator("[data-search=prove]").click()
    found.page.wait_for_selector("li[data-job=prove-1]")
    found.page.close()
    again = visit(address)
    again.page.wait_for_selector("li[data-job=prove-1][data-state=done]")
    told = again.text("li[data-job=prove-1]")
    assert "proven strongest" in told
    again.page.locator("li[data-job=prove-1] >> text=show best").click()
    again.page.wait_for_selector("#candidates li:has(.name:text-is('prove-1, rank 1'))")
    again.page.locator("#candidates li:has(.name:text-is('prove-1, rank 1')) >> text=show").click()
    best = answered(again)["load_factor"]
    summary = again.run("async () => (await (await fetch('api/jobs')).json()).jobs[0].summary")
    assert best == pytest.approx(summary["best"], rel=1e-6)
    with again.page.expect_download() as waiting:
        again.page.locator("li[data-job=prove-1] >> text=page").click()
    assert "<!doctype html>" in Path(waiting.value.path()).read_text(encoding="utf-8")


def test_a_results_folder_is_gone_on_with(visit: Open, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    explore(parse_scene(small_scene(name=HOSTILE)), folder, ExploreSettings(budget=20, pictures=False))
    with studio_of(folder) as address:
        found = visit(address)
        answered(found)
        assert found.text("h1") == " ".join(HOSTILE.split())
        assert found.page.locator("#candidates li:has(.name:text-is('this folder, rank 1'))").count() == 1
        assert found.text("li[data-job=study]").startswith("study")
        leave(found)


def drop(found: Visit, name: str, text: str) -> None:
    """Drop a file on the page."""
    script = """([name, text]) => {
      const dropped = new DataTransfer();
      dropped.items.add(new File([text], name));
      document.dispatchEvent(new DragEvent("drop", { dataTransfer: dropped, bubbles: true, cancelable: true }));
    }"""
    found.run(script, [name, text])


def scene_shown(found: Visit) -> dict[str, object]:
    """The scene file of what the page shows, and its title."""
    ask = """async () => ({ title: document.querySelector("h1").textContent, scene: await (await fetch("api/scene", {
      method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(studio.state()),
    })).json() })"""
    return dict(found.run(ask))


def test_every_kind_of_edit_is_taken_back_exactly(visit: Open, address: str) -> None:
    """An opened file, density, a limit, a load case, a support: each is one step; a bad value is none."""
    found = visit(address)
    answered(found)
    seen = [scene_shown(found)]

    def stepped() -> None:
        found.page.wait_for_function("(count) => studio.steps.past.length === count", arg=len(seen))
        answered(found)
        seen.append(scene_shown(found))

    drop(found, "wall.json", json.dumps(small_scene("a dropped wall", ["abc", "aab", "###"])))
    stepped()
    assert found.page.get_by_label("name of the file").input_value() == "a_dropped_wall"
    density = found.page.locator("[data-key='materials.density']")
    density.fill("heavy")
    density.press("Enter")
    found.page.wait_for_selector("#materials .field:has([data-key='materials.density']) .problem:has-text('a number')")
    found.errors.clear()  # the browser notes the refusal
    density.fill("1500,0")
    density.press("Enter")
    stepped()
    assert density.input_value() == "1500"  # as the scene has it
    assert found.page.locator("#materials .problem:visible").count() == 0
    found.page.locator("summary:has-text('Limits')").click()
    most = found.page.get_by_label("most blocks", exact=True)
    most.fill("4")
    most.press("Tab")
    stepped()
    found.page.locator("[data-key='add case']").click()
    stepped()
    assert found.page.locator("[data-collapse='0']").first.inner_text().startswith("λ × load = ")
    found.page.locator("[data-tool=support]").click()
    found.page.locator("polygon[data-element='5']").click()
    stepped()
    made = [json.dumps(one["scene"], sort_keys=True) for one in seen]
    assert len(set(made)) == len(made)
    found.page.keyboard.press("?")
    assert found.page.locator("dialog:has-text('take back, do again')").is_visible()
    found.page.keyboard.press("Escape")
    for before in reversed(seen[:-1]):
        found.page.keyboard.press("Control+z")
        answered(found)
        assert scene_shown(found) == before
    for _ in seen[1:]:
        found.page.keyboard.press("Control+y")
    answered(found)
    assert scene_shown(found) == seen[-1]


def test_the_best_of_a_running_search_is_drawn(visit: Open, address: str) -> None:
    found = visit(address)
    answered(found)
    tall = small_scene("a tall wall", ["abcdefgh", "ijklmnop"] * 4 + ["########"])  # no proof ends while one looks
    drop(found, "tall.json", json.dumps({**tall, "search": {"block_cells": [1, 3]}}))
    found.page.wait_for_function("() => studio.steps.past.length === 1")
    found.page.locator("[data-search=explore]").click()
    found.page.wait_for_selector("li[data-state=running] .best svg")
    entry = found.page.locator("li[data-state=running]")
    assert "best λ" in entry.inner_text()
    assert "s left" in entry.inner_text()
    entry.locator("text=take its best").click()
    found.page.wait_for_function("() => studio.steps.past.length === 2")
    best = found.run("() => [...studio.searches.entries.values()].map((entry) => entry.job.progress.best)")
    assert float(str(answered(found)["load_factor"])) <= max(filter(None, best)) * (1.0 + 1e-6)
    entry.locator("text=stop").click()
    found.page.wait_for_selector("li[data-state=stopping]")


@pytest.mark.long  # the server's answers for spatial scenes are tested without a browser
def test_a_spatial_scene_is_toggled_too(visit: Open, tmp_path: Path) -> None:
    path = saved(tmp_path / "cubes.json", spatial_scene())
    with studio_of(path) as address:
        found = visit(address)
        first = answered(found)
        before = str(state(found)["labelling"])
        found.page.get_by_label("see through").fill("0.8")
        box = found.page.locator("canvas.spatial").bounding_box()
        assert box is not None
        pixels = found.pixels("canvas.spatial")
        assert abs(pixels - pixels[0, 0]).max(axis=2).astype(bool).mean() > 0.05
        for step in range(30):
            x = box["x"] + box["width"] * (0.42 + 0.02 * (step % 6))
            y = box["y"] + box["height"] * (0.35 + 0.05 * (step // 6))
            found.page.mouse.click(x, y)
            if str(state(found)["labelling"]) != before:
                break
        after = answered(found)
        assert str(state(found)["labelling"]) != before
        assert after["load_factor"] == pytest.approx(proven(found, path), rel=1e-6)
        assert first["status"] == "collapse"
        leave(found)


DRAWING = """<svg xmlns="http://www.w3.org/2000/svg" width="4000mm" height="3000mm" viewBox="0 0 4000 3000">
<g id="MAUERWERK"><rect x="500" y="500" width="3000" height="2000"/></g>
<g id="F"><rect x="1500" y="1000" width="1000" height="800"/></g>
<g id="erde"><rect x="500" y="2500" width="3000" height="300"/></g>
<g id="Achse"><path d="M 2000 100 V 2900"/></g></svg>"""
"""A wall with a window and what it stands on, on layers whose names say nothing, and an axis."""


def test_a_dropped_drawing_is_asked_about_by_hand_and_by_keys(visit: Open, address: str) -> None:
    pytest.importorskip("svgelements")
    found = visit(address)
    answered(found)
    drop(found, "broken.svg", "<svg")
    found.page.wait_for_selector("#asking .warning:has-text('broken.svg: ')")
    found.errors.clear()  # the browser notes the refusal
    drop(found, "wand.svg", DRAWING)
    found.page.wait_for_selector("svg.understood")
    assert found.text("#asking .first").startswith("4 elements and 1 support, area 6.9 m²")
    assert found.page.locator("main.studio").is_hidden()
    assert found.page.locator("#asking-open").is_disabled()
    assert found.page.locator("#asking-design").is_enabled()
    assert found.page.locator("#asking .doubts").inner_text().startswith("doubtful: ")
    command = found.page.locator("#asking .command").first

    def says(words: str) -> None:
        found.page.wait_for_function(
            "(words) => document.querySelector('.command')?.textContent.endsWith(words)", arg=words
        )

    found.page.locator("#asking >> text=F is an opening").click()
    says("-o wand_scene.json --hole F")
    found.page.locator("svg.understood [data-layer=erde] path.touch").click(position={"x": 60, "y": 15})
    found.page.locator("#asking-bar button:has-text('ground')").click()
    says("-o wand_scene.json --support erde --hole F")
    assert found.page.locator("#asking-bar button:has-text('ground')").get_attribute("aria-pressed") == "true"
    looks_like(found, "studio_asking")
    by_keys = found.page.get_by_label("layer MAUERWERK is", exact=True)
    by_keys.focus()
    by_keys.select_option("skip")
    found.page.wait_for_selector("#asking .warning")  # nothing is left
    found.page.keyboard.press("Control+z")
    says("-o wand_scene.json --support erde --hole F")
    assert found.page.evaluate("() => document.activeElement.getAttribute('aria-label')") == "layer MAUERWERK is"
    for name in ("thickness", "tolerance"):
        found.page.locator(f"#asking [data-option={name}]").fill("0,3" if name == "thickness" else "wide")
        found.page.keyboard.press("Tab")
        found.page.wait_for_timeout(300)
    found.page.wait_for_selector("#asking .warning:has-text('a length as a number')")
    found.errors.clear()  # the browser notes the refusal
    says("--hole F --thickness 0.3")
    assert "--support erde" in command.inner_text()
    for node in found.page.locator("#asking button, #asking select, #asking input").all():
        named = "(one) => one.textContent || one.ariaLabel || one.labels?.length"
        assert node.evaluate(named), node
    found.page.locator("#asking-open").click()
    found.page.wait_for_selector("main.studio:visible")
    assert found.text("h1") == "wand"
    assert found.run("() => studio.data.scene.thickness") == 0.3
    answered(found)
    found.page.locator("text=read it in another way").click()
    found.page.wait_for_selector("svg.understood")
    says("--hole F --thickness 0.3")
    found.page.locator("#asking-close").click()
    found.page.keyboard.press("Control+z")
    assert found.text("h1") == "two courses"


def test_the_drawing_rests_while_answers_arrive(visit: Open, address: str) -> None:
    found = visit(address)
    places = set()
    for labelling in ("d", "i", "d"):
        found.run("(one) => studio.change({ labelling: one.repeat(studio.steps.now.labelling.length) })", labelling)
        for wait in ("() => true", "() => studio.solution", "() => document.getElementById('blocks')?.dataset.more"):
            found.page.wait_for_function(wait)
            places.add(found.run("() => document.getElementById('viewer').getBoundingClientRect().top"))
    assert len(places) == 1
