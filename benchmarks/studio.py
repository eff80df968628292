"""From a click to its proven λ on the page: what the studio spends on a changed face, and on a changed material.

Core: processor time of the whole answer (checking, solving with both bounds, drawing quantities, JSON) in this process.
Browser: wall clock in a headless Chromium where there is one, over the studio's own server: from a toggled face, and
from a moved friction slider, until the proven λ stands in the page, and from the toggled face until the next frame is
painted, which headless Chromium does in software. On a machine that does other work all are larger.
Layouts are the scene's own with three faces toggled.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common import about, table, write
from benchmarks.scenes import bonded, cubes, grid
from jld_core import Scene
from jld_explore.studio.session import StudioSession

TRIES: Final = 20
GOAL: Final = 50.0  # ms, for scenes of up to 100 faces


@dataclass(frozen=True)
class Times:
    """Milliseconds of one scene: median and 95 % of answers, of those after a changed material, and in the browser."""

    name: str
    faces: int
    core: tuple[float, float]
    material: tuple[float, float]
    browser: list[tuple[float, float]] | None


def scenes() -> dict[str, Scene]:
    """Planar walls in running bond, and a spatial block of cubes."""
    sizes = {"wall 3 × 5": (3, 5), "wall 4 × 7": (4, 7), "wall 6 × 8": (6, 8)}
    made = {name: grid(bonded(["a" * c] * r + ["#" * c])) for name, (r, c) in sizes.items()}
    return {**made, "cubes 2 × 2 × 2": cubes(2), "cubes 3 × 3 × 3": cubes(3)}


def measured(name: str, scene: Scene) -> Times:
    """Times of one scene."""
    desk, rng = StudioSession(scene), np.random.default_rng(1)
    own = desk.setup({}).assembly.labels
    asked = []
    for _ in range(TRIES):
        labels = own.copy()
        labels[rng.integers(0, len(own), 3)] ^= True
        asked.append("".join("d" if dry else "i" for dry in labels))
    core = [_spent(desk, letters, {}) for letters in asked]
    material = []
    for k, letters in enumerate(asked[: TRIES // 2]):
        materials = json.loads(json.dumps(desk.document["materials"]))
        materials["dry"] = {"friction_coefficient": 0.4 + 0.01 * k}
        material.append(_spent(desk, letters, {"materials": materials}))
    return Times(name, len(own), _range(core), _range(material), _in_browser(scene))


def _spent(desk: StudioSession, letters: str, changes: dict[str, Any]) -> float:
    start = time.process_time()
    json.dumps(desk.solve(letters, changes))
    return 1e3 * (time.process_time() - start)


def _range(values: list[float]) -> tuple[float, float]:
    return float(np.median(values)), float(np.quantile(values, 0.95))


def _in_browser(scene: Scene) -> list[tuple[float, float]] | None:
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if path is None or importlib.util.find_spec("playwright") is None:
        return None
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        file = Path(folder) / "scene.json"
        file.write_text(scene.model_dump_json(exclude_defaults=True), encoding="utf-8")
        command = [sys.executable, "-m", "jld_explore", "studio", str(file), "--no-browser"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert server.stdout is not None
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = driver.chromium.launch(executable_path=path, args=arguments)
        page = browser.new_page()
        page.goto(server.stdout.readline().strip())
        page.wait_for_selector("body[data-ready=yes]")
        found = page.evaluate(
            """async (tries) => {
              const faces = [], frames = [], sliders = [], n = studio.steps.now.labelling.length;
              const frame = () => new Promise((r) => requestAnimationFrame(() => setTimeout(r, 0)));
              const until = async (start) => {
                while (studio.live.waiting) await new Promise((r) => setTimeout(r, 1));
                return performance.now() - start;
              };
              await until(0);
              for (let k = 0; k < tries + 3; k++) {
                const face = (k * 7) % n, old = studio.steps.now.labelling;
                const letter = old[face] === "d" ? "i" : "d";
                let start = performance.now();
                studio.change({ labelling: old.slice(0, face) + letter + old.slice(face + 1) });
                const shown = await until(start);
                await frame();
                if (k > 2) faces.push(shown), frames.push(performance.now() - start);
                const materials = structuredClone(studio.steps.now.materials);
                materials.dry = { friction_coefficient: 0.4 + 0.01 * k };
                start = performance.now();
                studio.steps.preview({ materials });
                studio.refresh();
                const slid = await until(start);
                if (k > 2) sliders.push(slid);
                await frame();
                studio.steps.commit();
                studio.undo();
                studio.undo();
                await until(0);
                await frame();
              }
              return [faces, sliders, frames];
            }""",
            TRIES,
        )
        browser.close()
        server.terminate()
        server.wait(timeout=20.0)
        server.stdout.close()
    return [_range(list(times)) for times in found]


def main() -> None:
    """Measure every scene and write the table."""
    rows = []
    for name, scene in scenes().items():
        found = measured(name, scene)
        cells = [f"{a:.0f} / {b:.0f}" for a, b in (found.core, found.material, *(found.browser or ()))]
        rows.append([found.name, str(found.faces), *cells, *["no browser"] * (5 - len(cells))])
    head = ["scene", "faces", "core, face [ms]", "core, material [ms]"]
    head += ["face to λ in the page [ms]", "slider to λ in the page [ms]", "face to painted frame [ms]"]
    load = f"Load average of the machine at the end: {os.getloadavg()[0]:.1f}."
    goal = f"Median / 95 % of {TRIES} tries. Goal for scenes of up to 100 faces: {GOAL:.0f} ms. {load}"
    write("studio", f"# The studio\n\n{about(__doc__)}\n\n{goal}\n\n{table(head, rows)}", also=("starlette", "uvicorn"))


if __name__ == "__main__":
    main()
