"""The page of a notebook in a browser: static, with scripts switched off, and connected with the kernel."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from browser_visits import Open, Visit, looks_like
from command import SCENES
from jld_core import build_assembly, load_scene, samples, solve
from jld_explore.report.page_data import asset
from jld_studio.notebook import NotebookPage

MODEL = """<script type="module">
%s
const heard = [];
const model = {
  get: () => %s, on: (_, handler) => heard.push(handler), off() {},
  send: async (message) => {
    const answer = await window.kernel(message);
    heard.forEach((handler) => handler(answer));
  },
};
bridge.render({ model, el: document.body });
</script>"""
"""What anywidget does with the bridge: messages go to the kernel, and its answers come back."""


@pytest.fixture(scope="module")
def arch() -> NotebookPage:
    page: NotebookPage = load_scene(SCENES / "flat_beam_arch.json").show()
    return page


def saved(page: NotebookPage, path: Path, live: bool = False) -> Path:
    """A notebook with one output, as a file."""
    bridge = asset("bridge.js").replace("export default", "const bridge =")
    model = MODEL % (bridge, json.dumps(page._name)) if live else ""
    path.write_text(f"<!doctype html><meta charset=utf-8><body data-ready>{page.html}{model}", encoding="utf-8")
    return path


def connected(visit: Open, page: NotebookPage, path: Path) -> tuple[Visit, Any, list[str]]:
    """A notebook whose kernel runs; its frame, and the kinds of the messages that the kernel got."""
    asked: list[str] = []

    def kernel(message: dict[str, Any]) -> dict[str, Any]:
        asked.append(message["kind"])
        return page.answer(message)

    found = visit("about:blank", ready=False)
    found.page.expose_function("kernel", kernel)
    found.page.goto(saved(page, path, live=True).as_uri())
    frame = found.page.frame_locator("iframe")
    frame.locator("body[data-ready=yes]").wait_for(timeout=20_000)
    return found, frame, asked


def test_a_saved_notebook_shows_the_page_and_says_why_sliders_rest(
    visit: Open, arch: NotebookPage, tmp_path: Path
) -> None:
    found = visit(saved(arch, tmp_path / "a.html"))
    frame = found.page.frame_locator("iframe")
    frame.locator("body[data-ready=yes]").wait_for(timeout=20_000)
    frame.locator("[data-view=mechanism]").click()
    assert not found.page.locator("[data-plain]").is_visible()
    sliders = frame.locator("#materials input[type=range]")
    assert sliders.count() == 3
    assert all(not sliders.nth(k).is_enabled() for k in range(3))
    assert frame.locator("#kernel").inner_text() == "The sliders need a running kernel: run this cell again."
    looks_like(found, "notebook")


def test_without_scripts_facts_and_picture_are_there(visit: Open, arch: NotebookPage, tmp_path: Path) -> None:
    found = visit(saved(arch, tmp_path / "a.html"), java_script_enabled=False)
    assert found.page.locator("[data-plain] img").is_visible()
    assert "11.8763940004" in found.text("[data-plain] table")
    assert "need a running kernel" in found.text("[data-plain]")


def test_sliders_are_solved_by_the_kernel(visit: Open, tmp_path: Path) -> None:
    scene = samples.arch(voussoirs=5)
    page = scene.show()
    found, frame, asked = connected(visit, page, tmp_path / "a.html")
    friction = frame.locator("input[data-material^=friction]")
    found.page.wait_for_function("window.frames[0].document.querySelector('#materials input:not(:disabled)')")
    before = frame.locator(".verdict").first.inner_text()
    friction.fill("0.3")
    frame.get_by_text("materials changed").wait_for()
    assembly = build_assembly(scene.model_copy(update={"materials": scene.materials.model_copy(update={
        "dry": scene.materials.dry.model_copy(update={"friction_coefficient": 0.3, "friction_angle": None}),
    })}))  # fmt: skip
    known = solve(assembly)
    frame.locator(".verdict", has_text=f"λ = {known.load_factor:.6g}").wait_for(timeout=5000)
    frame.locator("[data-view=forces]").click()
    assert frame.locator(".lacking").first.inner_text() == ""
    frame.get_by_role("button", name="materials of the scene").click()
    frame.locator(".verdict", has_text=before).wait_for()
    assert asked == ["hello", "solve"]


def test_a_page_that_is_too_large_comes_from_the_kernel(visit: Open, tmp_path: Path) -> None:
    """Spatial pages need WebGL code of 150 kB: a saved notebook has the picture alone."""
    page = samples.vault("cross", voussoirs=4, courses=1).show()
    assert "<iframe" not in page.html
    found, frame, asked = connected(visit, page, tmp_path / "a.html")
    assert asked[:2] == ["hello", "page"]
    frame.locator("canvas.spatial").wait_for()
    assert not found.page.locator("[data-plain]").is_visible()
