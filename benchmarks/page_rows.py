"""How long the report page of 20 000 layouts takes to open.

The page of a random search at 88 faces, in the system's Chromium without a display as tests/browser drives it: the
median of several openings by the clock, from the address to the moment at which the page says that it is ready. Tasks:
what the browser's main thread was busy with meanwhile. Loaded once before, so that the file is in memory.
`python -m benchmarks.page_rows` writes the table; without playwright or Chromium it says so and writes nothing.
"""

from __future__ import annotations

import os
import shutil
import statistics
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from benchmarks.common import about, table, write
from benchmarks.search_scenes import LARGE
from jld_explore.explore import explore
from jld_explore.settings import ExploreSettings

if TYPE_CHECKING:
    from playwright.sync_api import Browser

ROWS: Final = 20_000
"""Layouts of the page, the most that it holds."""

TURNS: Final = 5
"""Openings that are timed."""

TARGET: Final = 2.0
"""Longest time to open that was asked for, s."""

ARGUMENTS: Final = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]
"""As in tests/browser: a container has neither a sandbox for root nor a graphics card."""


def opened(browser: Browser, page_file: Path) -> tuple[float, float]:
    """Open a page once; return seconds by the clock until it is ready, and of tasks of its main thread."""
    page = browser.new_context(viewport={"width": 1200, "height": 900}).new_page()
    watch = page.context.new_cdp_session(page)
    watch.send("Performance.enable")
    start = time.perf_counter()
    page.goto(page_file.as_uri())
    page.wait_for_selector("body[data-ready]", timeout=120_000)
    clock = time.perf_counter() - start
    metrics = {one["name"]: float(one["value"]) for one in watch.send("Performance.getMetrics")["metrics"]}
    page.context.close()
    return clock, metrics["TaskDuration"]


def measure(folder: Path, path: str) -> list[list[str]]:
    """Search, write the page and open it several times; return the rows of the table."""
    from playwright.sync_api import sync_playwright

    done = explore(LARGE["planar 88 faces"](), folder, ExploreSettings(driver="random", budget=ROWS, jobs=1))
    report = folder / "report.html"
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=ARGUMENTS)
        found = [opened(browser, report) for _ in range(1 + TURNS)][1:]
        browser.close()
    clock, tasks = (statistics.median(values) for values in zip(*found, strict=True))
    return [[str(len(done.results)), f"{report.stat().st_size / 1e6:.1f}", f"{clock:.2f}", f"{tasks:.2f}", f"{TARGET}"]]


def main() -> None:
    """Measure and write the table."""
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    path = os.environ.get("JLD_BROWSER") or path
    try:
        import playwright.sync_api  # noqa: F401
    except ModuleNotFoundError:
        path = None
    if path is None:
        print("page_rows: not measured, since playwright or Chromium is missing; make browser installs them")
        return
    with tempfile.TemporaryDirectory() as folder:
        rows = measure(Path(folder) / "study", path)
    head = ["layouts", "page, MB", "opens in, s", "tasks, s", "asked for, s"]
    load = f"Load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    write("page_rows", "\n\n".join(["# Page of 20 000 layouts", about(__doc__), table(head, rows), load]))


if __name__ == "__main__":
    main()
